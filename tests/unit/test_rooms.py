"""The library's rooms stand in one order, and no module imports from a room above its own."""

import re
from pathlib import Path

import pytest

from tests.helpers.settings import ROOT
from tests.helpers.sources import imported

LIBRARY = ROOT / "workflow/pinnochio"
# From the bottom to the top; rooms of one line do not import each other. The modules at the root stand below all.
_LINES = "geometry, plans, model, importing mechanics, meshing, networks, training, methods, metrics, statistics"
ORDER = [set(line.split()) for line in f"{_LINES}, tables, figures, virtual, patients, report, study".split(", ")]
FLOOR = {room: number for number, rooms in enumerate(ORDER, 1) for room in rooms}
MODULES = sorted(path for path in LIBRARY.rglob("*.py") if path.name != "__init__.py")


def room(path: Path) -> str:
    """Room of a file of the library; "" at its root."""
    return path.relative_to(LIBRARY).parts[0] if path.parent != LIBRARY else ""


def rooms_imported(path: Path) -> set[str]:
    """Rooms of the library from which a file imports; modules at the root are left out."""
    parts = [name.split(".")[1] for name in imported(path) if name.startswith("pinnochio.")]
    return {part for part in parts if (LIBRARY / part).is_dir()}


def test_every_room_has_its_place():
    folders = {path.name for path in LIBRARY.iterdir() if (path / "__init__.py").exists()}
    assert folders == set(FLOOR)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(LIBRARY)))
def test_no_module_imports_upwards(path):
    home = room(path)
    for other in rooms_imported(path) - {home}:
        assert FLOOR[other] < FLOOR.get(home, 0), f"{home or 'the root'} imports {other}"


def test_networks_know_geometry_alone():
    for path in (LIBRARY / "networks").rglob("*.py"):
        assert rooms_imported(path) <= {"geometry", "networks"}, path


def test_metrics_and_statistics_know_no_method():
    for path in [*(LIBRARY / "metrics").rglob("*.py"), *(LIBRARY / "statistics").rglob("*.py")]:
        assert "methods" not in rooms_imported(path), path


def test_mechanics_is_built_from_its_elements_up():
    above = {"elements": {"boundary", "solvers"}, "boundary": {"solvers"}, "solvers": set()}
    for part, others in above.items():
        for path in (LIBRARY / "mechanics" / part).rglob("*.py"):
            parts = {name.split(".")[2] for name in imported(path) if name.startswith("pinnochio.mechanics.")}
            assert not parts & others, path


def test_the_door_of_mechanics_is_imported_from_its_module():
    """What the package gives on demand, the hash of the code that a stage uses does not see."""
    lazy = {f"pinnochio.mechanics.{name}" for name in ("simulate", "Simulator")}
    others = [*(ROOT / "scripts").rglob("*.py"), *(ROOT / "workflow/studies").rglob("*.py")]
    for path in [*MODULES, *others]:
        assert not lazy & imported(path), path


def test_the_library_knows_neither_snakemake_nor_the_scripts():
    for path in MODULES:
        assert not {name.split(".")[0] for name in imported(path)} & {"snakemake", "scripts", "rules", "tests"}, path


def test_the_core_knows_no_study():
    for path in [*MODULES, *(ROOT / "scripts").rglob("*.py")]:
        assert "studies" not in {name.split(".")[0] for name in imported(path)}, path
    for path in [*(ROOT / "rules").glob("*.smk"), *(ROOT / "workflow").glob("*.smk")]:
        assert not re.search(r"\bstudies\.", path.read_text(encoding="utf-8")), path
