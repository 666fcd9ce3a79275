"""Heads of the same four persons for all tests: to carry a face into its deformity takes seconds."""

from functools import cache

import numpy as np
import pytest

from pinnochio.model.patient import PatientModel
from pinnochio.virtual.head import USUAL, Head, build_head
from pinnochio.virtual.parameters import HeadParameters
from pinnochio.virtual.procedures import DEFORMITIES, Procedure
from pinnochio.virtual.scanned import sample_patient
from tests.helpers.patients import as_model

# Others than the shared ones, for what has to hold of everybody.
PERSONS = [0, *(pytest.param(number, marks=pytest.mark.full) for number in (1, 2, 3))]


@cache
def person(deformity: str, number: int = 0) -> HeadParameters:
    """The person with a deformity whom tests share, or another one."""
    return sample_patient(np.random.default_rng(3 + DEFORMITIES.index(deformity) + 4 * number), deformity)


@cache
def virtual_head(deformity: str, spacing: float = 2.0, procedure: Procedure = USUAL, number: int = 0) -> Head:
    """The person's head on voxels of `spacing` mm; its labels are shared and cannot be written."""
    head = build_head(person(deformity, number), spacing, procedure)
    head.labels.flags.writeable = False
    return head


@cache
def face_alone(deformity: str, spacing: float = 2.0) -> PatientModel:
    """The person's bone and skin as a patient, of whom nothing is written."""
    return as_model(virtual_head(deformity, spacing))
