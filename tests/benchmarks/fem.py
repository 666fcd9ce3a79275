"""The solver against felupe + pypardiso on the block problem, and against its own floor, in one run.

python tests/benchmarks/fem.py [--nodes 3 10 30] [--repeats 3]

Every solve is a process of its own, single-threaded, with compiled code loaded beforehand; the processes take turns.
"direct": five increments, tolerance 1e-8 at each, every Newton system factorised, as felupe does. "free": two
increments, the first only to 1e-2, conjugate gradients on kept factors. The floor is the number of factorisations
times one factorisation.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))

from tests.helpers.settings import fem_settings

TOLERANCE, INCREMENTS = 1e-8, 5
SOLVERS = ("felupe + pypardiso", "direct p1", "direct patch", "free p1", "free patch")


def ours(points, cells, kind: str, volumetric: str) -> dict:
    """Time, counts and floor of this project's solver."""
    from pinnochio.mechanics.elements.assembly import Assembler
    from pinnochio.mechanics.elements.tetrahedra import Elements
    from pinnochio.mechanics.problems import block_boundary, box, uniform
    from pinnochio.mechanics.solvers.linear_algebra import linear_solver
    from pinnochio.mechanics.solvers.newton import solve

    limits = {"max_iterations": 30, "max_systems": 300, "linear_solver": "auto"}
    fixed = {"increments": INCREMENTS, "growth": 1.0, "loose": TOLERANCE, "reuse": False}
    options = fem_settings(volumetric=volumetric, tolerance=TOLERANCE, **fixed, **limits)
    if kind == "free":
        options = fem_settings(volumetric=volumetric, increments=2, tolerance=TOLERANCE, **limits)
    small, few = box((80, 60, 30), (4, 3, 2))
    solve(small, few, uniform(len(few)), block_boundary(small), options)
    law, boundary = uniform(len(cells)), block_boundary(points)
    began = time.perf_counter()
    result = solve(points, cells, law, boundary, options)
    seconds = time.perf_counter() - began
    assert result.converged, result.reason
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    constrained = np.zeros(points.shape, bool)
    constrained[boundary.prescribed_nodes] = True
    assembler = Assembler(Elements.build(points, cells, law, volumetric), constrained, [])
    data, _ = assembler.tangent(result.displacement, np.zeros((0, 3, 3)))
    linear, one = linear_solver(assembler.indptr, assembler.indices, single=options.reuse), []
    for _ in range(4):  # the first one analyses the pattern
        began = time.perf_counter()
        linear.factorize(data)
        one.append(time.perf_counter() - began)
    floor = result.factorizations * float(np.median(one[1:]))
    counts = {"factorizations": result.factorizations, "linear_iterations": result.linear_iterations}
    return {"seconds": seconds, "floor": floor, "memory": memory, "u": result.displacement} | counts


def peer(points, cells) -> dict:
    """Time of felupe's Newton-Raphson method with PARDISO."""
    import felupe
    import pypardiso

    from pinnochio.mechanics.elements.materials import lame
    from pinnochio.mechanics.problems import block_boundary

    mu, lam = lame(5.0, 0.49)
    boundary = block_boundary(points)
    pypardiso.spsolve(felupe_matrix(), np.ones(3))
    began = time.perf_counter()
    mesh = felupe.Mesh(points, cells, "tetra")
    field = felupe.FieldContainer([felupe.Field(felupe.RegionTetra(mesh), dim=3)])
    body = felupe.SolidBody(felupe.NeoHookeCompressible(mu=mu, lmbda=lam), field)
    unknowns = np.arange(points.size).reshape(points.shape)
    fixed = unknowns[boundary.prescribed_nodes].ravel()
    free = np.setdiff1d(unknowns.ravel(), fixed)
    count = 0
    for increment in range(1, INCREMENTS + 1):
        prescribed = boundary.displacement(increment / INCREMENTS).ravel()
        solution = felupe.newtonrhapson(
            items=[body], dof0=fixed, dof1=free, ext0=prescribed, solver=pypardiso.spsolve, tol=TOLERANCE, verbose=False
        )
        count += solution.iterations
    seconds = time.perf_counter() - began
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"seconds": seconds, "memory": memory, "u": field[0].values, "factorizations": count}


def felupe_matrix():
    from scipy import sparse

    return sparse.csr_matrix(np.diag([2.0, 3.0, 4.0]))


def once(solver: str, nodes: int) -> dict:
    """Result of one solver in a process of its own."""
    with tempfile.NamedTemporaryFile(suffix=".npy") as field:
        command = [sys.executable, __file__, "--one", solver, "--nodes", str(nodes), "--field", field.name]
        libraries = "OMP", "MKL", "OPENBLAS", "NUMBA"
        threads = {f"{library}_NUM_THREADS": "1" for library in libraries}
        done = subprocess.run(command, env=os.environ | threads, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(done.stderr)
        return json.loads(done.stdout.splitlines()[-1]) | {"u": np.load(field.name)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, nargs="+", default=[3, 10, 30], help="thousands of nodes")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--one", choices=SOLVERS, help=argparse.SUPPRESS)
    parser.add_argument("--field", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        from pinnochio.mechanics.problems import BLOCK, box

        # cubes along its edges for about so many thousand nodes
        points, cells = box(BLOCK, {3: (20, 15, 8), 10: (31, 23, 12), 30: (46, 34, 17)}[options.nodes[0]])
        result = peer(points, cells) if options.one == SOLVERS[0] else ours(points, cells, *options.one.split())
        np.save(options.field, result.pop("u"))
        print(json.dumps(result))
        return
    print("| nodes | solver | seconds | times felupe's speed | floor s | over the floor | factorisations | CG "
          "iterations | peak memory MB | max difference mm |")  # fmt: skip
    print("|---" * 10 + "|")
    for nodes in options.nodes:
        runs = {solver: [] for solver in SOLVERS}
        for _ in range(options.repeats):
            for solver in SOLVERS:
                runs[solver].append(once(solver, nodes))
        for solver, repeats in runs.items():
            first, seconds = repeats[0], float(np.median([run["seconds"] for run in repeats]))
            ratios = [a["seconds"] / b["seconds"] for a, b in zip(runs[SOLVERS[0]], repeats, strict=True)]
            floor = float(np.median([run.get("floor", np.nan) for run in repeats]))
            over = float(np.median([run["seconds"] / run.get("floor", np.nan) for run in repeats]))
            same = np.abs(first["u"] - runs[SOLVERS[0]][0]["u"]).max() if "patch" not in solver else np.nan
            print(
                f"| {nodes}k | {solver} | {seconds:.2f} | {np.median(ratios):.2f} | {floor:.2f} | {over:.2f} | "
                f"{first['factorizations']} | {first.get('linear_iterations', 0)} | {first['memory'] / 1024:.0f} | "
                f"{same:.1e} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
