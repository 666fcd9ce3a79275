"""Makes the page to look at a new patient's prediction."""

from collections.abc import Sequence

from pinnochio.json_text import read_stored_json, write_json
from pinnochio.patients.face_measures import read_face, unknown_rows, write_face
from pinnochio.patients.prediction_page import draw_bones, draw_faces, write_page
from pinnochio.patients.result import read_patient, read_result
from pinnochio.plans.plan import Plan
from pinnochio.statistics.intervals import Calibration


def draw(case: str, model: str, plan: str, pictures: str, result: str | None = None) -> None:
    """Draw faces and maps of a result; without one the bones after the plan, which no prediction moves."""
    patient, planned = read_patient(model), Plan.read(plan, case)
    known = read_result(result, case, patient) if result else None
    write_json(pictures, draw_faces(patient, planned, known) if known else draw_bones(patient, planned))


def show_prediction(
    case: str,
    model: str,
    plan: str,
    result: str,
    certificate: str,
    drawn: Sequence[str],
    measures: str,
    page: str,
    calibration: str = "",
) -> None:
    """Write pictures, measures and the certificate in words as one HTML file, and the measures as a table.

    drawn: files of :func:`draw`; calibration: that of the interval, empty of a result that is none.
    """
    patient, planned = read_patient(model), Plan.read(plan, case)
    prediction, face = read_result(result, case, patient), read_face(patient)
    rows, tracing = unknown_rows(), ""
    if face:
        known = (prediction, Calibration.read(calibration)) if calibration else ()
        rows = face.rows(prediction.displacement, *known) + face.bone_rows(planned)
        tracing = face.tracing(planned, prediction.displacement)
    write_face(rows, measures)
    write_page(
        patient=patient,
        plan=planned,
        certificate=read_stored_json(certificate),
        pictures={name: shown for path in drawn for name, shown in read_stored_json(path).items()},
        rows=rows,
        tracing=tracing,
        path=page,
    )
