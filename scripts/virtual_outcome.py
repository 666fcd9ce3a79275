"""Makes what surgery did to a virtual patient: the scan of the new face, and the volumetric truth for evaluation."""

import json
import logging

import h5py
import numpy as np
import trimesh
from scipy.spatial import cKDTree

from pinnochio.anatomy.plan import Plan
from pinnochio.anatomy.plan_sampling import execution_error
from pinnochio.anatomy.segmentation import read_segmentation
from pinnochio.anatomy.surfaces import bone_surface, skin_surface
from pinnochio.files import replacing
from pinnochio.logs import attach_log
from pinnochio.mechanics.simulation import FemSettings, simulate
from pinnochio.meshing.interfaces import label_interfaces
from pinnochio.meshing.lattice import tetrahedralize
from pinnochio.seeds import generator
from pinnochio.virtual.scan import lip_change, scan

LIP_THICKNESS = 10.0  # mm
ATTEMPTS = 4  # an executed plan that tissue cannot follow is drawn again


def virtual_outcome(
    case: str,
    inputs: dict[str, str],
    reality: dict,
    noise: float,
    interfaces: dict[str, float],
    bone_edge: float,
    fem: FemSettings,
    label_values: dict[str, int],
    segments: tuple[str, ...],
    seed: int,
    outputs: dict[str, str],
) -> None:
    """Operate with other mechanics than any method uses, then scan.

    inputs: segmentation, plan, landmarks. The executed plan differs from the planned one; the mesh is finer and lies
    elsewhere; the tissue stiffens with strain, is less incompressible and its modulus is the patient's own; more of the
    mucosa slides; the lips change (`reality` and `noise`: config section `virtual`). outputs: postop (PLY, mm, in the
    scanner's frame), truth (HDF5: points, cells, displacement). RuntimeError if none of a few has a solution.
    """
    rng = generator(seed, "virtual_outcome", case)
    head = read_segmentation(inputs["segmentation"], case, label_values, segments)
    with open(inputs["landmarks"], encoding="utf-8") as file:
        landmarks = {name: np.array(place) for name, place in json.load(file).items()}
    plan = Plan.read(inputs["plan"], case)
    mesh = tetrahedralize(head.labels, head.spacing, head.origin, reality["nodes"], shift=rng.uniform(0, 3, 3))
    thresholds = interfaces | {"sliding_band": interfaces["sliding_band"] * reality["sliding_band_factor"]}
    patient = label_interfaces(
        mesh,
        head.labels,
        head.spacing,
        head.origin,
        segments,
        bone_surface(head.labels, head.spacing, head.origin, segments, bone_edge),
        skin_surface(head.labels, head.spacing, head.origin),
        **{f"{name}_mm": value for name, value in thresholds.items()},
    )
    moduli = {
        tissue: modulus * float(np.exp(reality["stiffness_spread"] * rng.normal()))
        for tissue, modulus in sorted(fem.youngs_modulus.items())
    }
    own = FemSettings(
        moduli, reality["poisson"], "anp", time_limit=fem.time_limit, stiffening=reality["stiffening"]
    )  # fmt: skip
    for _ in range(ATTEMPTS):
        executed = execution_error(plan, rng, reality["execution_error"])
        result = simulate(patient, executed, "mucosa", own)
        logging.info("%s; moduli %s kPa; %.1f s", result.reason, moduli, result.seconds)
        if result.converged:
            break
    else:
        raise RuntimeError(f"case {case!r}: the simulated outcome did not converge: {result.reason}")
    # The lips change, the bone does not: nothing at the bone, everything at the thickness of a lip [I].
    loose = np.clip(cKDTree(patient.bone_points).query(patient.points)[0] / LIP_THICKNESS, 0, 1)
    change = reality["lip_change"] * lip_change(patient.points, landmarks, weight=loose)
    displacement = result.displacement + change
    seen = scan(patient.moved_skin(displacement), patient.skin_faces, rng, noise_mm=noise)
    with replacing(outputs["postop"]) as temporary:
        trimesh.Trimesh(seen.points, seen.faces, process=False).export(temporary)
    with replacing(outputs["truth"]) as temporary, h5py.File(temporary, "w", track_order=True) as file:
        for name, values in (("points", patient.points), ("cells", patient.cells), ("displacement", displacement)):
            file.create_dataset(name, data=values, compression="gzip", track_times=False)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    virtual_outcome(
        snakemake.wildcards.case,
        dict(snakemake.input.items()),
        snakemake.params.reality,
        snakemake.params.noise,
        snakemake.params.interfaces,
        snakemake.params.bone_edge,
        FemSettings(**snakemake.params.fem),
        snakemake.params.labels,
        tuple(snakemake.params.segments),
        snakemake.params.seed,
        dict(snakemake.output.items()),
    )
