"""Draws the model of one patient."""

from pinnochio.figures.quality import quality_picture
from pinnochio.logs import attach_log
from pinnochio.model.patient import PatientModel


def show_quality(case: str, model: str, picture: str) -> None:
    """Render bones under the skin, tissues and node types of the mesh."""
    quality_picture(PatientModel.read(model), case, picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    show_quality(case=snakemake.wildcards.case, model=snakemake.input.model, picture=snakemake.output.picture)
