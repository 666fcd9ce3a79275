"""Makes the floor prediction: the face stays as it was."""

from collections.abc import Sequence

import numpy as np

from pinnochio.logs import attach_log
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import Prediction, write_predictions


def predict_no_change(cases: Sequence[str], models: Sequence[str], predictions: str) -> None:
    """Write a zero displacement for each case."""
    write_predictions(
        predictions,
        {
            case: Prediction(np.zeros_like(PatientModel.read(model).points))
            for case, model in zip(cases, models, strict=True)
        },
    )


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    predict_no_change(
        cases=snakemake.params.cases, models=snakemake.input.models, predictions=snakemake.output.predictions
    )
