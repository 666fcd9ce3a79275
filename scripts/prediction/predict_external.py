"""Makes the predictions of a fold's held-out patients from files that were made elsewhere."""

from collections.abc import Sequence

from pinnochio.logs import attach_log
from pinnochio.meshing.mesh import TetMesh
from pinnochio.model.predictions import read_external, write_predictions


def predict_external(cases: Sequence[str], files: Sequence[str], meshes: Sequence[str], predictions: str) -> None:
    """Read each case's displacement of the nodes of its mesh; InputError where a file does not fit."""
    made = {}
    for case, file, path in zip(cases, files, meshes, strict=True):
        mesh = TetMesh.read(path)
        made[case] = read_external(path=file, case=case, points=mesh.points, cells=mesh.cells)
    write_predictions(predictions, made)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    predict_external(
        cases=snakemake.params.cases, **dict(snakemake.input.items()), predictions=snakemake.output.predictions
    )
