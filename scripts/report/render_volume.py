"""Makes the picture of one patient's tissue from behind, with and without physics."""

from collections.abc import Mapping

from pinnochio.figures.patient import volume_picture
from pinnochio.logs import attach_log
from pinnochio.model.patient import PatientModel
from pinnochio.model.predictions import read_prediction


def render_volume(case: str, model: str, predictions: Mapping[str, str], picture: str) -> None:
    """Draw the predicted volume of every method, by the file of its fold."""
    displacements = {method: read_prediction(path, case).displacement for method, path in predictions.items()}
    volume_picture(PatientModel.read(model), displacements, picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    render_volume(
        case=snakemake.wildcards.case,
        model=snakemake.input.model,
        predictions=dict(zip(snakemake.params.methods, snakemake.input.predictions, strict=True)),
        picture=snakemake.output.picture,
    )
