"""The trade-off's stages on one patient."""

from dataclasses import replace
from pathlib import Path

import pytest

from pinnochio.columns import read_table
from pinnochio.patients.model_archive import network_file
from studies.tradeoff.cases import TRADEOFF_CASES
from studies.tradeoff.measure_fem import measure_fem
from studies.tradeoff.measure_networks import measure_networks
from studies.tradeoff.settings import Setting

NODES = 700
FEM = [
    Setting("fem_sliding", "nodes", "700", NODES, "mucosa"),
    Setting("elastic", "nodes", "700, as in the study", NODES),
    Setting("fem_sliding", "solver", "Newton's method", NODES, "mucosa", {"kept_factors": False}),
]
NETWORKS = [Setting("pinnochio_plus", "corrections", str(count), NODES, corrections=count) for count in (0, 2)]


@pytest.fixture(scope="module")
def rows(patient, prepared, tmp_path_factory) -> dict[str, Path]:
    """The file of rows of each family, and the reference's."""
    folder = tmp_path_factory.mktemp("tradeoff")
    files = {name: folder / f"{name}.csv" for name in ("fem", "networks")} | {"reference": folder / "r.h5"}
    known = {"case": patient.case, "fem": patient.fem}
    solving = {"plan": patient.plan, "models": {NODES: patient.model}, "threads": 1}
    measure_fem(**known, **solving, settings=FEM, nodes=NODES, rows=files["fem"], reference=files["reference"])
    measure_networks(
        **known,
        **solving,
        settings=NETWORKS,
        networks={"pinnochio_plus": Path(prepared.archive, network_file("pinnochio_plus", "1"))},
        kinds={"pinnochio_plus": "elastic"},
        lifts={("elastic", NODES): prepared.lift},
        reference=(files["reference"], NODES),
        device="cpu",
        rows=files["networks"],
    )
    return files


def test_every_setting_has_a_row_beside_the_reference(patient, rows):
    fem, networks = (read_table(rows[name], TRADEOFF_CASES) for name in ("fem", "networks"))
    assert list(fem["method"]) == ["fem_sliding", "elastic", "fem_sliding"] and len(networks) == 2
    assert fem["face_error"].iloc[0] == 0 and fem["converged"].all()
    assert fem["face_error"].iloc[2] < 1e-3 < fem["face_error"].iloc[1]  # the same equations by another solver
    # Corrections take a network's field to equilibrium, near to the reference's.
    assert networks["eqres_rel"].iloc[1] < 0.1 * networks["eqres_rel"].iloc[0]


def test_a_reference_that_does_not_converge_leaves_its_distances_out(patient, tmp_path):
    files = {"rows": tmp_path / "fem.csv", "reference": tmp_path / "r.h5"}
    no_solver = replace(patient.fem, max_systems=0, kept_factors=False)
    known = {"case": patient.case, "fem": no_solver}
    measure_fem(
        **known, plan=patient.plan, models={NODES: patient.model}, threads=1, settings=FEM[:2], nodes=NODES, **files
    )
    fem = read_table(files["rows"], TRADEOFF_CASES)
    assert not fem["converged"].iloc[0] and fem["eqres_rel"].notna().all()
    assert fem[["face_error", "face_error_max", "volume_error"]].isna().all(axis=None)
