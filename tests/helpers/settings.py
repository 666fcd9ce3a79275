"""Where the project lies, and the settings that the tests take from its configuration."""

from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared/data"  # real heads, which are not part of the project
CONFIG = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))
SEGMENTS = tuple(CONFIG["segments"])
SEED = 7
MESH = {"nodes": 700, "minimum_dihedral": 12.0, "bone_edge": 6.0}
