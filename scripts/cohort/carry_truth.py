"""Makes the true motion of a virtual patient at the points of its model, which every method is judged by."""

from pinnochio.model.patient import PatientModel
from pinnochio.model.truth import TrueMotion, read_truth


def carry_truth(case: str, truth: str, model: str, motion: str) -> None:
    """Write the truth, which is on the outcome's own mesh, as it is at the nodes and at the skin points."""
    TrueMotion.of(PatientModel.read(model), *read_truth(truth, case)[:3]).write(motion)
