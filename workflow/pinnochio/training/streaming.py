"""Samples of more patients than memory holds: read while others are shown, and let go."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from pinnochio.training.case_files import CaseFiles, count_samples


class StreamedSamples:
    """As a list of all samples of the cases, of which at most `patients` patients are in memory.

    An epoch shows the cases in blocks of half as many, their samples mixed within a block (`order`), so that a thread
    reads the next block meanwhile. read(files): all samples of a patient; InputError where they are not right.
    """

    def __init__(self, read: Callable[[CaseFiles], list], cases: Sequence[CaseFiles], patients: int):
        counts = [count_samples(files) for files in cases]
        self._read, self._cases, self._size = read, cases, max(1, patients // 2)
        self._case = np.repeat(np.arange(len(cases)), counts)
        self._first = np.cumsum([0, *counts])
        self._block = np.zeros(len(cases), int)  # of each case in this epoch
        self._shown, self._kept = -1, {}
        self._reader = ThreadPoolExecutor(1)

    def __len__(self) -> int:
        return len(self._case)

    def order(self, rng: np.random.Generator) -> np.ndarray:
        """Every sample once, as an epoch shows them, which is the epoch that is read from now on."""
        block = np.empty(len(self._cases), int)
        block[rng.permutation(len(block))] = np.arange(len(block)) // self._size
        if (block != self._block).any():
            self._block, self._shown = block, -1
        mixed = rng.permutation(len(self))
        return mixed[np.argsort(block[self._case[mixed]], kind="stable")]

    def __getitem__(self, index: int):
        case = int(self._case[index])
        if self._block[case] != self._shown:
            self._turn_to(int(self._block[case]))
        return self._kept[case].result()[index - self._first[case]]

    def _turn_to(self, block: int) -> None:
        """Let go of all patients but those of a block and the next, and have these read."""
        near = [case for at in (block, block + 1) for case in np.flatnonzero(self._block == at).tolist()]
        kept: dict[int, Future] = {case: self._kept[case] for case in near if case in self._kept}
        self._shown, self._kept = block, kept
        for case in near:
            if case not in kept:
                kept[case] = self._reader.submit(self._read, self._cases[case])
