"""Where the plane of the midline cuts a surface, as lines that go with its points."""

import numpy as np

from pinnochio.geometry.mesh_topology import pieces


class MidlineProfile:
    """Lines of the skin's front, points (s, 3) mm and faces (f, 3), in the plane x = middle, without loops inside the
    head; whole: of all of a surface."""

    def __init__(self, points: np.ndarray, faces: np.ndarray, middle: float, whole: bool = False):
        side = points[:, 0] - middle
        front = points[faces][:, :, 1].max(axis=1) < (points[:, 1].min() + points[:, 1].max()) / 2  # not the back
        shown = faces[front | whole]
        edges = shown[:, [[0, 1], [1, 2], [2, 0]]]
        cut = (side[edges[:, :, 0]] < 0) != (side[edges[:, :, 1]] < 0)
        self._edges = edges[cut.sum(axis=1) == 2][cut[cut.sum(axis=1) == 2]]
        if not whole and len(self._edges):
            _, end = np.unique(np.sort(self._edges, axis=1), axis=0, return_inverse=True)
            piece = pieces(end.reshape(-1, 2), end.max() + 1)
            open_ended = np.unique(piece[np.bincount(end) == 1])
            self._edges = self._edges[np.isin(piece[end], open_ended)]
        ends = side[self._edges]
        self._share = (ends[:, 0] / (ends[:, 0] - ends[:, 1]))[:, None]
        self.lines = np.column_stack([np.full(len(self._edges) // 2, 2), np.arange(len(self._edges)).reshape(-1, 2)])

    def of(self, points: np.ndarray) -> np.ndarray:
        """Ends (2 l, 3) mm of the lines on a moved skin."""
        start, end = points[self._edges[:, 0]], points[self._edges[:, 1]]
        return start + self._share * (end - start)
