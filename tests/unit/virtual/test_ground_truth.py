"""The switches of the simulated outcome."""

import yaml

from pinnochio.virtual.ground_truth import EFFECTS, NOMINAL, in_reality, resolve
from tests.helpers.settings import ROOT

DEFAULT = yaml.safe_load((ROOT / "config/config.yaml").read_text())["virtual"]["outcome"]["effects"]


def test_config_names_every_effect():
    assert list(DEFAULT) == list(EFFECTS)


def test_a_reality_keeps_the_motion_and_the_noise_of_the_scan():
    off, all_on = resolve(NOMINAL), resolve(DEFAULT)
    assert in_reality(DEFAULT, "clinic") == all_on
    assert in_reality(DEFAULT, "same_modality") == all_on | {"posture": 0.0}
    plain = in_reality(DEFAULT, "nominal")
    kept = {"execution_error", "noise", "holes", "coverage", "frame"}
    assert plain == off | {name: all_on[name] for name in kept}


def test_nominal_switches_all_or_some():
    off = {name: effect.nominal for name, effect in EFFECTS.items()}
    assert resolve(NOMINAL) == off
    assert resolve(DEFAULT | {"swelling": NOMINAL}) == DEFAULT | {"swelling": 0.0}
    for effect in EFFECTS:
        alone = resolve(dict.fromkeys(EFFECTS, NOMINAL) | {effect: DEFAULT[effect]})
        assert {name for name, value in alone.items() if value != off[name]} == {effect}
