"""Accuracy of the elements in a head: `python tests/benchmarks/head_elements.py model.h5 plan.json` prints a table.

What is not free goes where the default elements put it, in every solution alike. The reference is the default element
on the same mesh with every element cut into eight, --levels times; with --quadratic Taylor-Hood elements on the mesh
that is cut once less. Distance of the free nodes from it, mean / max in mm, apart for those of a single element.
5,000 nodes cut once take 2 min of one core; 1,500 nodes cut twice, with --quadratic, 5 min and 10 GiB.
"""

import argparse
import sys
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))

from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.elements.mixed import FACES
from pinnochio.mechanics.elements.tetrahedra import VOLUMETRIC
from pinnochio.mechanics.simulation import simulate
from pinnochio.mechanics.solvers.mixed_newton import solve_mixed
from pinnochio.mechanics.solvers.newton import solve
from pinnochio.meshing.mesh import volumes
from pinnochio.model.patient import FREE, PatientModel
from pinnochio.plans.plan import Plan
from tests.helpers.settings import fem_settings

EDGES = list(combinations(range(4), 2))
# The octahedron that is left inside a cell, by the edges (numbers in EDGES) of its axis and those around it.
OCTAHEDRA = (((0, 5), (1, 2, 4, 3)), ((1, 4), (0, 2, 5, 3)), ((2, 3), (0, 1, 5, 4)))


def cut(points, cells, held, moved):
    """Every cell (m, 4) as eight, the octahedron along its shortest axis: points, cells (8 m, 4), held nodes and their
    displacements; the middle of an edge of a boundary face whose corners are held is held between its ends."""
    ends, number = np.unique(np.sort(cells[:, EDGES], axis=2).reshape(-1, 2), axis=0, return_inverse=True)
    middle = len(points) + number.reshape(-1, 6)
    every = np.vstack([points, points[ends].mean(axis=1)])
    parts = []
    for corner in range(4):
        beside = [middle[:, i] for i, pair in enumerate(EDGES) if corner in pair]
        parts.append(np.stack([cells[:, corner], *beside], axis=1))
    axes = [np.linalg.norm(every[middle[:, a]] - every[middle[:, b]], axis=1) for (a, b), _ in OCTAHEDRA]
    chosen = np.argmin(axes, axis=0)
    for turn in range(4):
        part = np.zeros_like(cells)
        for index, (axis, ring) in enumerate(OCTAHEDRA):
            own = chosen == index
            part[own] = middle[own][:, [*axis, ring[turn], ring[(turn + 1) % 4]]]
        parts.append(part)
    fine = np.concatenate(parts)
    inverted = volumes(every, fine) < 0
    fine[inverted] = fine[inverted][:, [0, 1, 3, 2]]

    row = np.full(len(points), -1)
    row[held] = np.arange(len(held))
    faces, uses = np.unique(np.sort(cells[:, FACES], axis=2).reshape(-1, 3), axis=0, return_counts=True)
    bonded = faces[(uses == 1) & (row[faces] >= 0).all(axis=1)]
    pairs = np.unique(bonded[:, [(0, 1), (0, 2), (1, 2)]].reshape(-1, 2), axis=0)
    place = {tuple(pair): len(points) + at for at, pair in enumerate(ends.tolist())}
    between = np.array([place[tuple(pair)] for pair in pairs.tolist()], int)
    return every, fine, np.concatenate([held, between]), np.vstack([moved, moved[row[pairs]].mean(axis=1)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", help="model.h5 of a patient")
    parser.add_argument("plan", help="plan.json of its segments")
    parser.add_argument("--levels", type=int, default=1, help="how often every element is cut into eight")
    parser.add_argument(
        "--quadratic", action="store_true", help="judge by Taylor-Hood elements on the mesh cut once less"
    )
    options = parser.parse_args()
    patient, settings = PatientModel.read(options.model), fem_settings(kept_factors=False)
    plan = Plan.read(options.plan, "head", foreign=True)
    given = simulate(patient, [plan], settings)[0].displacement
    held, count = np.flatnonzero(patient.node_type != FREE), len(patient.points)
    mesh, tissue, fields = (patient.points, patient.cells, held, given[held]), patient.tissue, {}
    for level in range(options.levels + 1):
        points, cells, nodes, moved = mesh
        boundary, law = BoundaryConditions(nodes, moved), settings.material(tissue)
        results = {name: solve(points, cells, law, boundary, replace(settings, volumetric=name)) for name in VOLUMETRIC}
        if level < max(options.levels, 1) and (level == 0 or options.quadratic):
            results["Taylor-Hood"] = solve_mixed(points, cells, law, boundary, "taylor_hood", 4, 1e-6, 12)
        for name, result in results.items():
            fields[name, level] = result.displacement[:count]
            print(
                f"{name}, {len(points)} nodes: {result.reason}, J {result.min_jacobian:.2f}",
                file=sys.stderr,
                flush=True,
            )
        mesh, tissue = cut(*mesh), np.tile(tissue, 8)
    truth = fields["Taylor-Hood", options.levels - 1] if options.quadratic else fields["patch", options.levels]
    elements = np.bincount(patient.cells.ravel(), minlength=count)
    free = patient.node_type == FREE
    groups = {"single element": free & (elements == 1), "other free nodes": free & (elements > 1)}
    print("| element | cut | " + " | ".join(f"{name} ({own.sum()})" for name, own in groups.items()) + " |")
    print("|---" * (2 + len(groups)) + "|")
    for (name, level), field in fields.items():
        off = np.linalg.norm(field - truth, axis=1)
        print(
            f"| {name} | {level} | "
            + " | ".join(f"{off[m].mean():.2f} / {off[m].max():.1f}" for m in groups.values())
            + " |"
        )


if __name__ == "__main__":
    main()
