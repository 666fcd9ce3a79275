"""A plane in space."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Plane:
    """Plane through point (3,) mm with the unit normal (3,), LPS."""

    point: np.ndarray
    normal: np.ndarray

    def height(self, places) -> np.ndarray:
        """Signed distance (...,) mm of places (..., 3), positive on the side that the normal points to."""
        return (places - self.point) @ self.normal
