"""Makes the page to look at a new patient's prediction."""

from pinnochio.json_text import read_stored_json
from pinnochio.model.patient import PatientModel
from pinnochio.patients.face_measures import read_face, unknown_rows, write_face
from pinnochio.patients.prediction_page import write_page
from pinnochio.patients.result import read_result
from pinnochio.plans.plan import Plan
from pinnochio.statistics.intervals import Calibration


def show_prediction(
    case: str, model: str, plan: str, result: str, certificate: str, measures: str, page: str, calibration: str = ""
) -> None:
    """Write pictures, maps, measures and the certificate in words as one HTML file, and the measures as a table.

    calibration: that of the interval, empty of a result that is none.
    """
    patient = PatientModel.read(model)
    prediction = read_result(result, case, patient)
    planned, face = Plan.read(plan, case), read_face(patient)
    rows, tracing = unknown_rows(), ""
    if face:
        known = (prediction, Calibration.read(calibration)) if calibration else ()
        rows = face.rows(prediction.displacement, *known) + face.bone_rows(planned)
        tracing = face.tracing(planned, prediction.displacement)
    write_face(rows, measures)
    write_page(
        patient=patient,
        plan=planned,
        displacement=prediction.displacement,
        half_width=prediction.half_width,
        certificate=read_stored_json(certificate),
        rows=rows,
        tracing=tracing,
        path=page,
    )
