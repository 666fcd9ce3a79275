"""Gradients by recorded kernels: on a GPU a step then costs its kernels, not their launches."""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pinnochio.training.loop import Step


@dataclass(frozen=True)
class Piece:
    """The loss of one sample: its terms as a function of tensors whose shapes belong to the key.

    key: the same for samples whose terms are the same function; inputs: what else they depend on.
    """

    key: Hashable
    inputs: tuple[Tensor, ...]
    function: Callable[..., Mapping[str, Tensor]]

    def terms(self) -> Mapping[str, Tensor]:
        """The loss terms, differentiable."""
        return self.function(*self.inputs)


class RecordedGradients:
    """As :data:`~pinnochio.training.loop.Gradients`: the gradient of each sample's piece, added up.

    On a GPU the kernels of a key, forward and backward, are recorded once as a CUDA graph and replayed whenever a
    sample has it; all recordings share their memory, since one runs at a time. Elsewhere they run as they are. A
    parameter that no sample reaches has a gradient of zero here, and none where a step is not recorded.
    """

    def __init__(self, network: nn.Module, piece: Callable[[int, Step], Piece]):
        """piece(sample, step): that of the sample of this number, as the step shows it."""
        self._piece, self._known = piece, {}
        self._parameters = [weight for weight in network.parameters() if weight.requires_grad]
        for weight in self._parameters:
            weight.grad = torch.zeros_like(weight)
        self._weights: dict[str, Tensor] = {}
        device = self._parameters[0].device
        self._pool = torch.cuda.graph_pool_handle() if device.type == "cuda" else None

    def __call__(self, step: Step, weights: Mapping[str, float]) -> dict[str, Tensor]:
        """Leave the gradient of the weighted mean over the step's samples in the parameters; the mean terms."""
        for weight in self._parameters:
            self._check_gradient(weight)
        torch._foreach_zero_([weight.grad for weight in self._parameters])
        share, device = 1 / len(step.samples), self._parameters[0].device
        for name, value in weights.items():
            factor = self._weights.setdefault(name, torch.zeros((), device=device))
            factor.fill_(share * value)
        each = [self._run(self._piece(sample, step)) for sample in step.samples]
        return {name: sum(terms[name] for terms in each) * share for name in each[0]}

    def _check_gradient(self, weight: nn.Parameter) -> None:
        if weight.grad is None:
            raise RuntimeError("a recorded gradient was taken away: do not set gradients to none")

    def _run(self, piece: Piece) -> dict[str, Tensor]:
        if self._pool is None:
            values, gradients = self._differentiate(piece)
            self._add(gradients)
            return values
        if piece.key not in self._known:
            self._known[piece.key] = self._record(piece)
        graph, inputs, values = self._known[piece.key]
        for old, new in zip(inputs, piece.inputs, strict=True):
            old.copy_(new)
        graph.replay()
        return {name: value.clone() for name, value in values.items()}

    def _record(self, piece: Piece) -> tuple:
        copied = Piece(piece.key, tuple(value.clone() for value in piece.inputs), piece.function)
        aside = torch.cuda.Stream()
        aside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(aside):  # compiles, finds the layouts of the graphs, sizes the libraries' buffers
            self._differentiate(copied)
        torch.cuda.current_stream().wait_stream(aside)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, pool=self._pool):
            values, gradients = self._differentiate(copied)
            self._add(gradients)
        return graph, copied.inputs, values

    def _differentiate(self, piece: Piece) -> tuple[dict[str, Tensor], tuple[Tensor | None, ...]]:
        """The terms, and the gradient of their weighted sum by parameter."""
        terms = piece.terms()
        total = sum(self._weights[name] * value for name, value in terms.items())
        gradients = torch.autograd.grad(total, self._parameters, allow_unused=True)
        return {name: value.detach() for name, value in terms.items()}, gradients

    def _add(self, gradients: tuple[Tensor | None, ...]) -> None:
        pairs = [
            (weight.grad, gradient)
            for weight, gradient in zip(self._parameters, gradients, strict=True)
            if gradient is not None
        ]
        torch._foreach_add_(*(list(part) for part in zip(*pairs, strict=True)))
