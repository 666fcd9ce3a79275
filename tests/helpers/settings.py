"""Where the project lies, and the settings that the tests take from its configuration."""

from pathlib import Path

import yaml

from pinnochio.mechanics.settings import FemSettings
from pinnochio.methods.surface.settings import SurfaceSettings
from pinnochio.networks.settings import NetworkSettings
from pinnochio.overlays import overlaid
from pinnochio.study.schema import checked, read_schema
from pinnochio.training.settings import TrainingSettings
from pinnochio.virtual.procedures import Procedure

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared/data"  # real heads, which are not part of the project
DEFAULT = checked(yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8")), read_schema(ROOT))
CONFIG = overlaid(DEFAULT, {"fem": {"accuracy": "exact"}})  # tests compare with equilibria
SEGMENTS = Procedure().segments
SEED = 7
MESH = {"nodes": 700, "minimum_dihedral": 12.0, "bone_edge": 6.0}
OUTCOME = overlaid(CONFIG["virtual"]["outcome"], {"effects": {"nodes": 1000}, "mesh": MESH})


def fem_settings(**changes) -> FemSettings:
    """The settings of finite elements, with changes."""
    return FemSettings(**CONFIG["fem"] | changes)


def network_settings(**changes) -> NetworkSettings:
    """The form of the networks, with changes."""
    return NetworkSettings(**CONFIG["network"] | changes)


def training_settings(steps: int, learning_rate: float, **changes) -> TrainingSettings:
    """The settings of pretraining, with what fine-tuning alone reads, and with changes."""
    phase = CONFIG["finetuning"] | CONFIG["pretraining"]
    return TrainingSettings(**phase | {"steps": steps, "learning_rate": learning_rate} | changes)


def surface_settings(architecture: str, **changes) -> SurfaceSettings:
    """The settings of a surface network with all of its switches off, with changes."""
    sizes = {key: CONFIG["surface"][key] for key in ("points", "neighbours", "repeats")}
    return SurfaceSettings(architecture, **sizes | changes)
