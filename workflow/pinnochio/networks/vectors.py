"""Vectors of float32 numbers for compiled loops: what the compiler keeps in registers, whatever their width.

Numba vectorises a loop only if it can prove that the arrays in it do not overlap, which it cannot where a loop reads
and writes several; so the kernels say themselves what is a vector. A vector of 16 numbers is one AVX-512 register, two
of AVX2, four of NEON. Products and sums may be fused, and sums reordered, as the instruction set likes it.
"""

import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

_FREE = ("contract", "reassoc", "nsz", "arcp")
_FLOAT, _INT = ir.FloatType(), ir.IntType(32)


class Vector(types.Type):
    """Numba's type of a vector of `lanes` float32."""

    def __init__(self, lanes: int):
        self.lanes = lanes
        super().__init__(name=f"Vector({lanes})")


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.VectorType(_FLOAT, kind.lanes))


def _splat(builder, scalar, lanes):
    vector = ir.VectorType(scalar.type, lanes)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), scalar, _INT(0))
    return builder.shuffle_vector(first, first, ir.Constant(ir.VectorType(_INT, lanes), None))


def _constant(value, lanes):
    return ir.Constant(ir.VectorType(_FLOAT, lanes), [_FLOAT(float(np.float32(value)))] * lanes)


def _call(builder, name, result, *arguments):
    """A call of one of LLVM's own functions."""
    kind = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)


def _place(context, builder, kind, array, index, lanes):
    """Pointer to `lanes` numbers from the flat `index` on."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), ir.VectorType(_FLOAT, lanes).as_pointer())


@intrinsic(prefer_literal=True)
def load(_, array, index, lanes):
    """array.flat[index : index + lanes] of a contiguous float32 array; nothing is checked."""
    width = lanes.literal_value

    def build(context, builder, signature, values):
        index = context.cast(builder, values[1], signature.args[1], types.intp)
        place = _place(context, builder, signature.args[0], values[0], index, width)
        return builder.load(place, align=4)

    return Vector(width)(array, types.unliteral(index), lanes), build


@intrinsic
def store(_, array, index, vector):
    """Write the vector to array.flat[index:] of a contiguous float32 array; nothing is checked."""

    def build(context, builder, signature, values):
        index = context.cast(builder, values[1], signature.args[1], types.intp)
        place = _place(context, builder, signature.args[0], values[0], index, vector.lanes)
        builder.store(values[2], place, align=4)
        return context.get_dummy_value()

    return types.void(array, index, vector), build


@intrinsic
def element(_, array, index):
    """array.flat[index] of a contiguous array, integers as intp; nothing is checked, no negative index is turned."""
    kind = types.intp if isinstance(array.dtype, types.Integer) else array.dtype

    def build(context, builder, signature, values):
        index = context.cast(builder, values[1], signature.args[1], types.intp)
        data = context.make_array(signature.args[0])(context, builder, values[0]).data
        return context.cast(builder, builder.load(builder.gep(data, [index])), array.dtype, kind)

    return kind(array, index), build


@intrinsic(prefer_literal=True)
def spread(_, scalar, lanes):
    """A vector of `lanes` times the scalar."""
    width = lanes.literal_value

    def build(context, builder, signature, values):
        return _splat(builder, context.cast(builder, values[0], signature.args[0], types.float32), width)

    return Vector(width)(types.unliteral(scalar), lanes), build


@intrinsic
def scaled(_, array, index, vector):
    """array.flat[index] times the vector."""

    def build(context, builder, signature, values):
        index = context.cast(builder, values[1], signature.args[1], types.intp)
        data = context.make_array(signature.args[0])(context, builder, values[0]).data
        factor = _splat(builder, builder.load(builder.gep(data, [index])), vector.lanes)
        return builder.fmul(factor, values[2], flags=_FREE)

    return vector(array, index, vector), build


def _binary(name):
    """Elementwise operation of two vectors."""

    @intrinsic
    def operation(_, a, b):
        return a(a, b), lambda context, builder, signature, values: getattr(builder, name)(*values, flags=_FREE)

    return operation


_add, _multiply, _divide = _binary("fadd"), _binary("fmul"), _binary("fdiv")


@intrinsic
def positive(_, choice, a, b):
    """a where choice > 0, else b, by element."""

    def build(context, builder, signature, values):
        zero = _constant(0.0, choice.lanes)
        return builder.select(builder.fcmp_ordered(">", values[0], zero), values[1], values[2])

    return a(choice, a, b), build


@intrinsic
def total(_, vector):
    """Sum of the elements."""

    def build(context, builder, signature, values):
        name = f"llvm.vector.reduce.fadd.v{vector.lanes}f32"
        kind = ir.FunctionType(_FLOAT, [_FLOAT, values[0].type])
        function = cgutils.get_or_insert_function(builder.module, kind, name)
        return builder.call(function, [_FLOAT(-0.0), values[0]], fastmath=_FREE)

    return types.float32(vector), build


@intrinsic
def larger(_, a, b):
    """The larger of two elements."""
    return a(a, b), lambda context, builder, signature, v: builder.select(builder.fcmp_ordered(">", *v), *v)


@intrinsic
def largest(_, vector):
    """The largest element."""

    def build(context, builder, signature, values):
        name = f"llvm.vector.reduce.fmax.v{vector.lanes}f32"
        return _call(builder, name, _FLOAT, values[0])

    return types.float32(vector), build


@intrinsic
def exponential(_, vector):
    """exp by element, to 3e-7 relative; arguments are clipped to [-60, 60]."""

    def build(context, builder, signature, values):
        lanes = vector.lanes
        floats, integers = ir.VectorType(_FLOAT, lanes), ir.VectorType(_INT, lanes)

        def number(value):
            return _constant(value, lanes)

        def fused(a, b, c):  # in this order, or the two parts of ln 2 would be one
            return builder.fadd(builder.fmul(a, b, flags=("contract",)), c, flags=("contract",))

        x = values[0]
        for sign, bound in ((">", 60.0), ("<", -60.0)):
            x = builder.select(builder.fcmp_ordered(sign, x, number(bound)), number(bound), x)
        # x = k ln 2 + r with |r| <= ln 2 / 2, so exp(x) = 2^k exp(r); ln 2 in two parts keeps r exact.
        k = _call(builder, f"llvm.rint.v{lanes}f32", floats, builder.fmul(x, number(1.4426950408889634)))
        r = fused(k, number(-0.693359375), x)
        r = fused(k, number(2.12194440e-4), r)
        power = number(1 / 720)
        for factor in (1 / 120, 1 / 24, 1 / 6, 0.5, 1.0, 1.0):
            power = fused(power, r, number(factor))
        bits = builder.add(builder.fptosi(k, integers), ir.Constant(integers, [_INT(127)] * lanes))
        scale = builder.bitcast(builder.shl(bits, ir.Constant(integers, [_INT(23)] * lanes)), floats)
        return builder.fmul(power, scale)

    return vector(vector), build


def _operator(symbol, operation):
    """The operator between vectors, or a vector and a number."""

    @overload(symbol)
    def between(a, b):
        if isinstance(a, Vector) and isinstance(b, Vector):
            return lambda a, b: operation(a, b)
        if isinstance(a, Vector) and isinstance(b, types.Float):
            lanes = a.lanes
            return lambda a, b: operation(a, spread(b, lanes))
        if isinstance(b, Vector) and isinstance(a, types.Float):
            lanes = b.lanes
            return lambda a, b: operation(spread(a, lanes), b)
        return None


for _symbol, _operation in ((operator.add, _add), (operator.mul, _multiply), (operator.truediv, _divide)):
    _operator(_symbol, _operation)
