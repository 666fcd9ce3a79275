"""The coarse virtual head of the stages' tests."""

import pytest

from pinnochio.virtual import head
from scripts.cohort.virtual_patient import virtual_patient


def make_head(*arguments) -> None:
    """A virtual patient whose tissue over bone is as thin as in heads of 1 mm: the tests expect what it gives."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(head, "BETWEEN", 0.0)
        virtual_patient(*arguments)
