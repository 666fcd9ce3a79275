"""Heights over a plane."""

import numpy as np

from pinnochio.geometry.plane import Plane


def test_height_over_a_plane():
    plane = Plane(np.array([0.0, 0, 2]), np.array([0.0, 0.6, 0.8]))
    assert np.allclose(plane.height(np.array([[7.0, 0, 2], [0, 3, 6], [0, 0, 1]])), [0, 5, -0.8])
