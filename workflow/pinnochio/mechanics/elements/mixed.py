"""Tetrahedra with a pressure unknown: the reference that the displacement elements are judged by.

The law of materials.py with its bulk term U(J) = lam/2 (ln J)^2 written as the largest value over q of q J - U*(q):

    W(u, q) = int mu/2 (I1 - 3) + stiffening/2 (I1 - 3)^2 - mu ln J + q (J - theta) + U(theta),  dU/dtheta(theta) = q.

theta = exp(-W0(-q/lam)), Lambert's function; the pressure is q theta = lam ln theta, tension positive. That is a
three-field formulation (Simo, Taylor, Pister 1985, CMAME 51:177) without theta, which q determines. The field conjugate
to ln J instead, p ln J - p^2/(2 lam), is the same law, but leaves changes of J that the pressure does not resolve a
stiffness of mu - p: the uniform state under a tension of a few mu is then unstable. J stays below e, where U ceases to
be convex.

Each element is a four-point rule with shape functions for u and q:

"taylor_hood": quadratic u on straight-sided ten-node tetrahedra, continuous linear q. Stable where every element has a
    node inside (Boffi 1997, SIAM J Numer Anal 34:664). Gauss points: exact at small strain, whose integrands are
    quadratic; the weights are positive, so that J -> 0 at a point never lowers the energy.
"stabilised": both linear, which is unstable; what q lacks to be constant in the element is penalised by
    - int (q - mean q)^2/(2 mu), free of parameters (Dohrmann and Bochev 2004, IJNMF 46:183, weight 1/viscosity). It is
    zero where q is constant, so the patch test holds; its compliance vanishes with the square of the edge.
"averaged": both linear, points at the corners: the bulk term sees the averaged nodal volumes
    J_a = sum V_e J_e / sum V_e alone, with lam averaged likewise.

q is continuous across tissues, though the pressure may jump there: read it near interfaces with care. The law is not
extended: a step that leads to J at or below the extension of the material at a point of the rule is shortened.
"""

import numpy as np
from scipy import sparse
from scipy.special import lambertw

from pinnochio.errors import InputError
from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.tetrahedra import EPSILON, check_mesh, lumped, mean_edge, shape_gradients

MIXED = ("taylor_hood", "stabilised", "averaged")
# Ends of the six edges, in the order of VTK's quadratic tetrahedron.
EDGES = np.array([(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)])
FACES = np.array([(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)])
_INNER, _OUTER = (5 + 3 * np.sqrt(5)) / 20, (5 - np.sqrt(5)) / 20
# F (9,) @ _CURL = d2J/dF2 (81,); half of its product with F is the cofactor.
_CURL = np.einsum("ijk,pqr->kripjq", EPSILON, EPSILON).reshape(9, 81)


class MixedElements:
    """A mesh at rest, its residual and its tangent.

    points (k, 3) mm: all nodes, corners first; cells (m, 4 or 10); corners (m, 4); node_volumes (n,) mm3;
    midside_ends (k - n, 2): corners that a midside node lies between.
    """

    def __init__(self, points, cells, material: Material, element: str):
        corners, cells = check_mesh(points, cells)
        if element not in MIXED:
            raise InputError("-", "options", f"element is {element!r}", f"choose one of {MIXED}")
        if len(material.mu) != len(cells):
            raise InputError("-", "material", f"{len(material.mu)} constants, {len(cells)} cells", "one per cell")
        if len(np.unique(cells)) != len(corners):
            raise InputError("-", "mesh", "a point belongs to no cell", "drop it")
        self.element, self.material, self.corners = element, material, cells
        self.points, self.cells, self.midside_ends = corners, cells, np.zeros((0, 2), int)
        linear, volumes = shape_gradients(corners, cells)
        self._weight = volumes / 4
        self.node_volumes = lumped(cells, volumes, len(corners))
        # Per point of the rule: shape functions of q (4,), gradients of those of u (m, nodes, 3), lam (m,).
        self._shapes = np.eye(4) if element == "averaged" else _OUTER + (_INNER - _OUTER) * np.eye(4)
        self._gradients, self._lam = [linear] * 4, [material.lam] * 4
        if element == "averaged":
            node_lam = lumped(cells, volumes * material.lam, len(corners)) / self.node_volumes
            self._lam = list(node_lam[cells].T)
        if element == "taylor_hood":
            ends = np.sort(cells[:, EDGES], axis=2).reshape(-1, 2)
            self.midside_ends, number = np.unique(ends, axis=0, return_inverse=True)
            self.points = np.vstack([corners, corners[self.midside_ends].mean(axis=1)])
            self.cells = np.hstack([cells, len(corners) + number.reshape(-1, 6)])
            self._gradients = [_quadratic(linear, shape) for shape in self._shapes]
        # Matrix (4, 4) of int (q - mean q)^2 over one element of unit volume.
        self._penalty = (1 + np.eye(4)) / 20 - 1 / 16
        self._compliance = volumes / material.mu if element == "stabilised" else np.zeros(len(cells))
        nodes = len(self.points)
        # Unknowns: three displacements per node, then q per corner.
        moves = (3 * self.cells[:, :, None] + np.arange(3)).reshape(len(cells), -1)
        self.unknowns = np.hstack([moves, 3 * nodes + cells]).astype(np.int32)
        self.count = 3 * nodes + len(corners)
        self.edge, self.modulus = mean_edge(corners, cells), float(np.average(material.mu, weights=volumes))

    def _fields(self, u, q, part=slice(None)):
        """Per point of the rule: shapes, gradients (m, nodes, 3), F and its cofactor (m, 3, 3), J, I1 - 3, q, theta."""
        for shape, gradient, lam in zip(self._shapes, self._gradients, self._lam, strict=True):
            h = np.einsum("eai,eap->eip", u[self.cells[part]], gradient[part], optimize=True)
            f = h + np.eye(3)
            cofactor = 0.5 * (_curl(f) @ f.reshape(-1, 9, 1)).reshape(-1, 3, 3)
            excess = (h**2).sum(axis=(1, 2)) + 2 * np.trace(h, axis1=1, axis2=2)
            at = q[self.corners[part]] @ shape
            theta = _volume(at, lam[part])
            yield shape, gradient[part], f, cofactor, (f[:, 0] * cofactor[:, 0]).sum(axis=1), excess, at, theta

    def pressure(self, q) -> np.ndarray:
        """Pressure (n,) in kPa, tension positive, at the corners."""
        lam = np.bincount(self.corners.ravel(), (self._weight[:, None] * np.stack(self._lam, axis=1)).ravel())
        return q * _volume(q, lam / self.node_volumes)

    def evaluate(self, u, q) -> tuple[float, np.ndarray, float]:
        """W in mN mm, its gradient (3 k + n,) by u and q, and the least J; nan where J <= 0 or q has no theta."""
        law, w = self.material, self._weight
        at_corners = q[self.corners]
        soft = self._compliance[:, None] * (at_corners @ self._penalty)
        energy, least, gradient = -0.5 * np.sum(at_corners * soft), np.inf, np.zeros(self.count)
        gradient[-len(q) :] -= np.bincount(self.corners.ravel(), soft.ravel())
        with np.errstate(invalid="ignore", divide="ignore"):
            for (shape, g, f, cofactor, j, excess, at, theta), lam in zip(self._fields(u, q), self._lam, strict=True):
                log, shear = np.log(j), law.mu + 2 * law.stiffening * excess
                stress = shear[:, None, None] * f + (at - law.mu / j)[:, None, None] * cofactor
                force = np.einsum("e,eip,eap->eai", w, stress, g, optimize=True).reshape(len(w), -1)
                values = np.hstack([force, (w * (j - theta))[:, None] * shape])
                gradient += np.bincount(self.unknowns.ravel(), values.ravel(), self.count)
                energy += w @ (0.5 * law.mu * excess + 0.5 * law.stiffening * excess**2 - law.mu * log)
                energy += w @ (at * (j - theta) + 0.5 * lam * np.log(theta) ** 2)
                least = min(least, j.min())
        return energy, gradient, least

    def tangent(self, u, q, step, free) -> tuple[sparse.csr_matrix, np.ndarray]:
        """Hessian of W on the unknowns `free` (c,), upper triangle, and its product with `step` (3 k + n,), all rows.

        The pattern is the same at every call.
        """
        place = np.full(self.count, -1, np.int32)
        place[free] = np.arange(len(free), dtype=np.int32)
        product, blocks, rows, columns = np.zeros(self.count), [], [], []
        for begin in range(0, len(self.cells), 4096):
            part = slice(begin, begin + 4096)
            matrix, unknowns = self._blocks(u, q, part), self.unknowns[part]
            product += np.bincount(
                unknowns.ravel(), (matrix @ step[unknowns][:, :, None]).ravel(), minlength=self.count
            )
            row, column = np.broadcast_arrays(place[unknowns][:, :, None], place[unknowns][:, None, :])
            kept = (row >= 0) & (row <= column)
            blocks.append(matrix[kept])
            rows.append(row[kept])
            columns.append(column[kept])
        entries = np.concatenate(blocks), (np.concatenate(rows), np.concatenate(columns))
        return sparse.coo_matrix(entries, shape=(len(free),) * 2).tocsr(), product

    def _blocks(self, u, q, part) -> np.ndarray:
        """Element Hessians (m, unknowns, unknowns) of the cells in `part`."""
        law, w, d = self.material, self._weight[part], 3 * self.cells.shape[1]
        mu, stiffening = law.mu[part], law.stiffening[part]
        matrix, b = np.zeros((len(w), d + 4, d + 4)), np.zeros((len(w), 9, d))  # b: dF/du
        for (shape, g, f, cofactor, j, excess, at, theta), lam in zip(self._fields(u, q, part), self._lam, strict=True):
            for i in range(3):
                b[:, 3 * i : 3 * i + 3, i::3] = g.transpose(0, 2, 1)
            curl, f, c = _curl(f), f.reshape(-1, 9, 1), cofactor.reshape(-1, 9, 1)
            h = (w * (mu + 2 * stiffening * excess))[:, None, None] * np.eye(9)
            h += (4 * w * stiffening)[:, None, None] * (f @ f.transpose(0, 2, 1))
            h += (w * mu / j**2)[:, None, None] * (c @ c.transpose(0, 2, 1))
            h += (w * (at - mu / j))[:, None, None] * curl
            matrix[:, :d, :d] += b.transpose(0, 2, 1) @ (h @ b)
            matrix[:, :d, d:] += b.transpose(0, 2, 1) @ (w[:, None, None] * c * shape)
            # d theta/dq = 1/U''(theta).
            slope = theta**2 / (lam[part] * (1 - np.log(theta)))
            matrix[:, d:, d:] -= np.einsum("e,a,b->eab", w * slope, shape, shape)
        matrix[:, d:, d:] -= self._compliance[part, None, None] * self._penalty
        matrix[:, d:, :d] = matrix[:, :d, d:].transpose(0, 2, 1)
        return matrix


def _curl(f) -> np.ndarray:
    """d2J/dF2 (m, 9, 9) at F (m, 3, 3)."""
    return (f.reshape(-1, 9) @ _CURL).reshape(-1, 9, 9)


def _volume(q, lam) -> np.ndarray:
    """theta at which dU/dtheta = lam ln theta / theta is q; nan beyond q = lam/e, where there is none."""
    share = -q / lam
    return np.exp(-lambertw(np.where(share >= -np.exp(-1), share, np.nan)).real)


def _quadratic(linear, at) -> np.ndarray:
    """Gradients (m, 10, 3) of the ten shape functions at barycentric coordinates `at` (4,); linear: (m, 4, 3)."""
    corner = linear * (4 * at - 1)[:, None]
    i, j = EDGES.T
    return np.hstack([corner, 4 * (at[i, None] * linear[:, j] + at[j, None] * linear[:, i])])
