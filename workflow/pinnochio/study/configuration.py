"""The checks of a study's configuration that a schema cannot express."""

import itertools
from collections.abc import Mapping

from pinnochio.errors import InputError
from pinnochio.methods.registry import BUILT_IN, graph_networks, surface_networks
from pinnochio.methods.surface.settings import SurfaceSettings
from pinnochio.networks.settings import NetworkSettings
from pinnochio.study.cases import virtual_cases
from pinnochio.virtual.procedures import dealt


def check_config(config: Mapping) -> None:
    """Refuse a configuration whose keys contradict each other; the message names the keys."""

    def refuse(problem: str, remedy: str):
        raise InputError("-", "configuration", problem, remedy)

    known = ["superficial", "muscle", "cranium", *config["segments"]]
    labels = config["labels"]
    if isinstance(labels, str):
        if config["cohort"] == "virtual" and not config["patient"]:
            refuse(
                f"'labels' is the preset {labels!r}, and virtual patients need values",
                "name a cohort or a patient that the tool has segmented",
            )
    else:
        if missing := [name for name in config["segments"] if name not in labels]:
            refuse(f"segments {missing} have no entry in 'labels'", "give each segment its voxel value")
        values = [labels[name] for name in known if name in labels]
        if len(set(values)) < len(values):
            refuse("two structures share one value in 'labels'", "give each structure its own value")
    learned, surface = config["variants"], surface_networks(config)
    built_in = tuple(method.name for method in BUILT_IN)
    if unknown := [name for name in config["methods"] if name not in {*built_in, *learned, *surface}]:
        refuse(
            f"method {unknown[0]!r} is none of {built_in} and not among 'variants' and 'surface.networks'",
            "correct its name, or describe it in 'variants'",
        )
    for section, key in (("planned", "without"), ("uncertainty", "methods")):
        if unknown := [name for name in config[section][key] if name not in {*built_in, *learned, *surface}]:
            refuse(f"{section}.{key} names {unknown[0]!r}, which is no method", "correct its name")
    if taken := [name for name in [*config["external"], *learned, *surface] if name in built_in]:
        refuse(f"{taken[0]!r} is the name of a built-in method", "choose another name in 'external' or 'variants'")
    named = {"external": config["external"], "variants": learned, "surface.networks": surface}
    for (one, first), (other, second) in itertools.combinations(named.items(), 2):
        if taken := [name for name in first if name in second]:
            refuse(f"{taken[0]!r} stands in {one!r} and in {other!r}", "give each method its own name")
    if config["reference"] not in [*config["methods"], *config["external"]]:
        refuse(
            f"reference {config['reference']!r} is not among 'methods' and 'external'",
            "add it, or choose another reference",
        )
    if config["reference"] in [method.name for method in BUILT_IN if method.bound]:
        refuse(f"reference {config['reference']!r} is a bound, which knows what happened", "choose a method")
    named = {
        "ablation": config["ablation"],
        "better": [config["better"]],
    }
    for section, names in named.items():
        if unknown := [name for name in names if name not in learned]:
            refuse(f"{section} names {unknown[0]!r}, which is not among 'variants'", "name a learned method")
    for name, settings in surface.items():
        try:
            SurfaceSettings(**settings["network"])
        except ValueError as error:
            refuse(f"the network of {name!r} cannot be built: {error}", "change its keys in 'surface'")
    for name, settings in graph_networks(config).items():
        try:
            NetworkSettings(**settings["network"])
        except ValueError as error:
            refuse(f"the network of {name!r} cannot be built: {error}", "change its keys in 'network' or 'variants'")
    for kind, own in config["invert"]["bounds"].items():
        if shut := [name for name, (low, high) in own.items() if not low <= 0 <= high]:
            refuse(
                f"invert.bounds.{kind}.{shut[0]} is {own[shut[0]]}, which shuts out the bone where it is",
                "let it reach from 0 or less to 0 or more: a proposal begins with nothing moved",
            )
    if config["cohort"] == "virtual" and not config["patient"]:
        every = dealt(config["virtual"]["procedures"], config["virtual"]["patients"])
        made = dict.fromkeys(name for own in every for name in own.segments)
        if missing := [name for name in made if name not in config["segments"]]:
            refuse(
                f"the procedures of the virtual patients have segments {missing}, and 'segments' lacks them",
                "add them to 'segments', or set the share of their procedures in 'virtual.procedures' to 0",
            )
    if config["cohort"] == "virtual":
        names = [case.name for case in virtual_cases(config["virtual"]["patients"], "")]
        without = config["virtual"]["without"]
        if unknown := sorted(set(without) - set(names)):
            refuse(f"virtual.without names {unknown}, and the patients are {names[0]} to {names[-1]}", "take them out")
        if len(names) - len(without) < config["folds"]:
            refuse("there are fewer virtual patients than folds", "lower 'folds' or raise virtual.patients")
