"""Calls whose kernels are recorded once on a GPU, and replayed from then on."""

from collections.abc import Callable

import torch


class ReplayedCalls:
    """Calls of a function without arguments: on a GPU its kernels are recorded at the second call and then replayed."""

    def __init__(self, function: Callable[[], None], device: torch.device):
        self._function, self._records, self._graph, self._warm = function, device.type == "cuda", None, False

    def __call__(self) -> None:
        if self._graph is not None:
            self._graph.replay()
        elif not self._records or not self._warm:
            self._function()  # compiles, and sizes the libraries' buffers
            self._warm = True
        else:
            torch.cuda.synchronize()
            self._graph = torch.cuda.CUDAGraph()
            with torch.cuda.graph(self._graph):
                self._function()
            self._graph.replay()
