"""Accuracy of the elements on the block problem: `python tests/benchmarks/elements.py` prints Markdown tables.

Error of the top of the block against Taylor-Hood elements on a finer mesh, mean / max in mm; least J (Taylor-Hood: at
its quadrature points; else of the cells); seconds of one solve, on so many threads. The finer mesh is fixed and moved
where the faces of the coarse one are, not further: the coarse mesh holds the bottom only as far as its nodes go.
A reference of 30 x 22 x 12 cubes takes 4.4 GiB, and two to three minutes of one core per nu.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))

from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.elements.mixed import MIXED
from pinnochio.mechanics.elements.tetrahedra import VOLUMETRIC
from pinnochio.mechanics.problems import BLOCK, BLOCK_STEPS, block_boundary, box, uniform
from pinnochio.mechanics.solvers.mixed_newton import solve_mixed
from pinnochio.mechanics.solvers.newton import solve
from tests.helpers.settings import fem_settings

OPTIONS = {"increments": 2, "tolerance": 1e-6, "max_iterations": 30, "max_systems": 300, "linear_solver": "auto"}


def constrained_like(coarse, fine, shear: bool) -> tuple[BoundaryConditions, BoundaryConditions]:
    """Boundary conditions of the coarse mesh, and of the fine one on the faces that the coarse one holds."""
    own, whole = (block_boundary(points, shear) for points in (coarse, fine))
    edge, x = coarse[own.prescribed_nodes, 0], fine[whole.prescribed_nodes, 0]
    left, right = edge[edge < BLOCK[0] / 2].max(), edge[edge > BLOCK[0] / 2].min()
    kept = (x <= left + 1e-9) | (x >= right - 1e-9)
    reached = x[kept & (x < BLOCK[0] / 2)].max(), x[kept & (x > BLOCK[0] / 2)].min()
    if not np.allclose(reached, (left, right)):
        sys.exit(f"choose meshes that share the planes x = {left:g} and x = {right:g}")
    return own, BoundaryConditions(whole.prescribed_nodes[kept], lambda t: whole.displacement(t)[kept])


def on_top(points, displacement, wanted) -> np.ndarray:
    """Displacement (s, 3) at points `wanted` (s, 3) of the top, from nodes on a lattice."""
    top = np.isclose(points[:, 2], BLOCK[2])
    x, y = (np.unique(points[top, axis].round(9)) for axis in (0, 1))
    order = np.lexsort((points[top, 1].round(9), points[top, 0].round(9)))
    grid = displacement[top][order].reshape(len(x), len(y), 3)
    return np.stack([RectBivariateSpline(x, y, grid[..., i]).ev(wanted[:, 0], wanted[:, 1]) for i in range(3)], axis=1)


def table(title: str, nus, rows: dict) -> None:
    print(f"\n| {title} | " + " | ".join(f"nu {nu:g}" for nu in nus) + " |")
    print("|---" * (len(nus) + 1) + "|")
    for name, values in rows.items():
        print(f"| {name} | " + " | ".join(values) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nus", type=float, nargs="+", default=[0.3, 0.45, 0.49, 0.499, 0.4999])
    parser.add_argument("--steps", type=int, nargs=3, default=BLOCK_STEPS[3], help="cubes of the mesh")
    parser.add_argument("--reference", type=int, nargs=3, default=(30, 22, 12), help="cubes of the reference mesh")
    parser.add_argument("--elements", nargs="+", default=[*VOLUMETRIC[::-1], *MIXED[::-1]])
    parser.add_argument("--shear", action="store_true", help="the other motion of the block problem")
    options = parser.parse_args()
    points, cells = box(BLOCK, options.steps)
    fine, fine_cells = box(BLOCK, options.reference)
    boundary, same = constrained_like(points, fine, options.shear)
    top = points[:, 2] == BLOCK[2]
    errors, jacobians, seconds = ({name: [] for name in options.elements} for _ in range(3))
    for nu in options.nus:
        truth = solve_mixed(fine, fine_cells, uniform(len(fine_cells), nu), same, increments=1, tolerance=1e-6)
        wanted = on_top(truth.points, truth.everywhere, points[top])
        size = np.linalg.norm(wanted, axis=1)
        print(
            f"nu {nu:g}: reference {truth.reason}, {len(truth.points)} nodes, {truth.seconds:.0f} s, "
            f"J {truth.min_jacobian:.2f}; top moves {size.mean():.2f} mean, {size.max():.2f} max",
            flush=True,
        )
        law = uniform(len(cells), nu)
        for name in options.elements:
            if name in MIXED:
                result = solve_mixed(points, cells, law, boundary, name, increments=1, tolerance=1e-6)
            else:
                result = solve(points, cells, law, boundary, fem_settings(volumetric=name, **OPTIONS))
            off = np.linalg.norm(result.displacement[top] - wanted, axis=1)
            good = result.converged and truth.converged
            errors[name].append(f"{off.mean():.3f} / {off.max():.3f}" if good else "failed")
            jacobians[name].append(f"{result.min_jacobian:.2f}")
            seconds[name].append(f"{result.seconds:.1f}")
            print(f"nu {nu:g}: {name}: {errors[name][-1]}, {result.reason}", file=sys.stderr, flush=True)
    print(f"\n{len(points)} nodes, {'shear' if options.shear else 'lift'}")
    table("error of the top, mean / max mm", options.nus, errors)
    table("least J", options.nus, jacobians)
    table("seconds", options.nus, seconds)


if __name__ == "__main__":
    main()
