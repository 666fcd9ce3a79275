"""Makes a patient's table and figure of which move of which bone moves which place of the face."""

from contextlib import closing

from pinnochio.columns import write_csv
from pinnochio.logs import attach_log
from pinnochio.mechanics.settings import FemSettings
from pinnochio.model.patient import PatientModel
from studies.inverse.elastic_face import ElasticFace
from studies.inverse.sensitivity import sensitivity
from studies.inverse.sensitivity_figure import sensitivity_figure
from studies.inverse.wish_columns import SENSITIVITY


def measure_sensitivity(case: str, model: str, fem: FemSettings, code: str, table: str, picture: str) -> None:
    """Write the table (CSV) and the figure (PNG)."""
    with closing(ElasticFace(PatientModel.read(model), fem)) as face:
        frame = sensitivity(face, case, code)
    write_csv(frame, table, SENSITIVITY)
    sensitivity_figure(frame, picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    measure_sensitivity(
        case=snakemake.wildcards.case,
        model=snakemake.input.model,
        fem=FemSettings(**snakemake.params.fem),
        code=snakemake.params.code,
        **dict(snakemake.output.items()),
    )
