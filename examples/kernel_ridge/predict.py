"""Kernel ridge regression on finite-element stress, in the manner of Pan et al. 2016: a method made elsewhere.

Of each patient finite elements compute the stress of the skin [S]; a Gaussian kernel leads from it to the displacement
of the face (`krr`). The increment adds the new patient's own finite elements as one more sample (`ikrr`) [I].
"""

import argparse
import csv
import os
import sys
from collections import namedtuple
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.append("workflow")  # run at the root of the repository

import numpy as np  # noqa: E402
import yaml  # noqa: E402
from scipy.spatial import cKDTree, distance  # noqa: E402

from pinnochio.geometry.closest_points import closest_points  # noqa: E402
from pinnochio.geometry.scattered import farthest, nearest, spread  # noqa: E402
from pinnochio.mechanics import simulate  # noqa: E402
from pinnochio.mechanics.elements.tetrahedra import Elements, lumped  # noqa: E402
from pinnochio.mechanics.settings import FemSettings  # noqa: E402
from pinnochio.model.correspondence import corresponding, marks  # noqa: E402
from pinnochio.model.patient import FIXED, MOVING, PatientModel  # noqa: E402
from pinnochio.model.postop import PostopSkin  # noqa: E402
from pinnochio.plans.plan import Plan  # noqa: E402

TEMPLATE = 400  # points of the face
WIDTHS = 2.0 ** np.arange(-1, 4)  # of the kernel, in median distances between training patients
PENALTIES = 10.0 ** np.arange(-5, 1)  # of the training patients
INCREMENTS = 10.0 ** np.arange(-3, 2)  # of the new patient's own sample; NONE leaves nothing of it
NONE = 1e9
# Stress (6 t,), displacement by finite elements (3 t,) and towards the scan (3 t,) or None, at the template's points.
Sample = namedtuple("Sample", "stress fem target")


def solve(folder: Path) -> tuple[PatientModel, np.ndarray, np.ndarray]:
    """A patient with its nodes' displacement (n, 3) mm and stress (n, 6) kPa by finite elements with sliding."""
    model = PatientModel.read(folder / "model.h5")
    fem = FemSettings(**yaml.safe_load(Path("config/config.yaml").read_bytes())["fem"])
    motion = next(path for name in ("achieved", "plan") if (path := folder / f"{name}.json").exists())
    (solved,) = simulate(model, [Plan.read(motion, folder.name)], fem)
    print(f"{folder.name}: {solved.reason}", flush=True)
    mesh = Elements.build(model.points, model.cells, fem.material(model.tissue), fem.volumetric)
    return model, solved.displacement, nodal_stress(mesh, solved.displacement)


def nodal_stress(mesh: Elements, displacement: np.ndarray) -> np.ndarray:
    """Cauchy stress (n, 6) kPa at the nodes: that of the elements around each, weighted by volume."""
    one, volumes = np.eye(3), mesh.volumes
    gradient = one + np.einsum("eai,eaj->eij", displacement[mesh.cells], mesh.gradients)
    ratio = np.maximum(np.linalg.det(gradient), mesh.material.extension)
    patch = np.bincount(mesh.patch, volumes * ratio) / mesh.patch_volumes
    bulk = (mesh.patch_lam * np.log(patch) / patch)[mesh.patch, None, None] * one
    shear = (mesh.material.mu / ratio)[:, None, None] * (gradient @ gradient.transpose(0, 2, 1) - one)
    parts = (shear + bulk)[:, *np.triu_indices(3)].T
    nodal = np.transpose([lumped(mesh.cells, volumes * part, mesh.nodes) for part in parts])
    return nodal / lumped(mesh.cells, volumes, mesh.nodes)[:, None]


def sample(model: PatientModel, displacement, stress, place: np.ndarray, scan: Path | None = None) -> Sample:
    """A solved patient at the skin points (t,) where the template's stand; scan: the file of one to learn from."""
    nodes, weights = model.skin_nodes[place], model.skin_weights[place]
    fem, stress = (np.einsum("tc,tcx->tx", weights, values[nodes]) for values in (displacement, stress))
    if scan is None:
        return Sample(stress.ravel(), fem.ravel(), None)
    near = closest_points(model.skin_points[place] + fem, *PostopSkin.read(scan).surface)
    target = np.where(near.border[:, None], fem, near.points - model.skin_points[place])
    return Sample(stress.ravel(), fem.ravel(), target.ravel())


def regress(known: list[Sample], new: Sample, width: float, penalty: float, increment: float) -> np.ndarray:
    """Displacement (3 t,) mm of a new patient; increment: penalty of its own finite elements as a sample."""
    stress, values = [each.stress for each in [*known, new]], [*(each.target for each in known), new.fem]
    kernel = np.exp(-distance.cdist(stress, stress, "sqeuclidean") / (2 * width**2))
    ridge = np.diag([*[penalty] * len(known), increment])
    return kernel[-1] @ np.linalg.solve(kernel + ridge, np.array(values))


def choose(known: list[Sample], increments) -> tuple[float, float, float]:
    """Width, penalty and increment that predict each training patient best from the others."""
    settings = product(np.median(distance.pdist([each.stress for each in known])) * WIDTHS, PENALTIES, increments)
    left_out = [(known[:n] + known[n + 1 :], each) for n, each in enumerate(known)]
    return min(settings, key=lambda chosen: sum(np.square(regress(*x, *chosen) - x[1].target).sum() for x in left_out))


def whole(model: PatientModel, field: np.ndarray, place: np.ndarray, more: np.ndarray) -> np.ndarray:
    """Field (n, 3) mm with `more` (t, 3) mm added at the face, fading towards the bone."""
    to_bone = cKDTree(model.points[np.isin(model.node_type, (FIXED, MOVING))]).query(model.points)[0]
    to_face = cKDTree(model.skin_points[model.judged_points]).query(model.points)[0]
    share = to_bone / np.maximum(to_bone + to_face, 1e-9)
    return field + share[:, None] * spread(more, *nearest(model.points, model.skin_points[place]))


def predict(results: Path, output: Path, cores: int) -> None:
    """Write OUTPUT/krr/CASE.npz and OUTPUT/ikrr/CASE.npz of every case, from training patients of the other folds."""
    with open(results / "folds.csv", encoding="utf-8") as file:
        rows = {row["case"]: row for row in csv.DictReader(file)}
    folders = {case: results / "cases" / case for case in rows}
    with ProcessPoolExecutor(cores) as pool:
        solved = dict(zip(rows, pool.map(solve, folders.values()), strict=True))
    for fold in sorted({row["fold"] for row in rows.values()}):
        training = [case for case, row in rows.items() if row["scanned"] == "True" and row["fold"] != fold]
        first = solved[training[0]][0]
        face = first.skin_points[first.judged_points]
        template, landmarks = face[farthest(face, TEMPLATE)], marks(first)
        places = {case: corresponding(template, landmarks, model) for case, (model, *_) in solved.items()}
        known = [sample(*solved[case], places[case], folders[case] / "postop.h5") for case in training]
        for method, increments in {"krr": [NONE], "ikrr": INCREMENTS}.items():
            setting = choose(known, increments)
            print(fold, method, "width, penalty, increment:", *setting, flush=True)
            (output / method).mkdir(parents=True, exist_ok=True)
            for case in (case for case, row in rows.items() if row["fold"] == fold):
                new = sample(*solved[case], places[case])
                more = (regress(known, new, *setting) - new.fem).reshape(-1, 3)
                np.savez(output / method / case, displacement=whole(*solved[case][:2], places[case], more))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("results", type=Path, help="folder of the study after `snakemake inputs`")
    parser.add_argument("output", type=Path, help="folder for the predictions")
    parser.add_argument("--cores", type=int, default=1, help="patients that are solved side by side")
    predict(**vars(parser.parse_args()))
