"""What the tests of importing share."""

import numpy as np
import pytest

from pinnochio.importing import registration


@pytest.fixture
def from_in_place(monkeypatch):
    """A registration that begins where the scan is, one start instead of 141: for scans that lie in place."""
    monkeypatch.setattr(registration, "_starts", lambda moving, front: [(np.eye(3), np.zeros(3))])
