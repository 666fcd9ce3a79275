"""The checks of a study's configuration that a schema cannot express, and the settings of its learned methods."""

import itertools
from collections.abc import Mapping

from pinnochio.errors import InputError
from pinnochio.methods.surface.settings import SurfaceSettings
from pinnochio.networks.settings import NetworkSettings
from pinnochio.overlays import overlaid

UNTRAINED = (
    *("no_change", "ratio", "elastic", "fem_bonded", "fem_sliding"),
    *("fem_rlse_bonded", "fem_rlse_mucosa", "fem_rlse"),
)


REGRESSION = "pca_linear"


PRETRAINED = "_pretrained"  # ends the name of a surface network that is pretrained on finite-element fields


def variants(config: Mapping) -> dict[str, dict]:
    """Settings of every learned method by its name: network, pretraining, finetuning, newton_corrections.

    Those of `variants` are overlays of the configuration's own sections, those of `design.switches`, named
    design_{switch}, overlays of the variant `design.base`.
    """
    own = {key: config[key] for key in ("network", "pretraining", "finetuning", "newton_corrections")}
    settings = {name: overlaid(own, overlay) for name, overlay in config["variants"].items()}
    design = config["design"]
    if base := settings.get(design["base"]):
        settings |= {f"design_{name}": overlaid(base, overlay) for name, overlay in design["switches"].items()}
    return settings


def surface_networks(config: Mapping) -> dict[str, dict]:
    """Settings of every surface network by its name: network, finetuning, and pretraining where the name says so."""
    settings = {}
    for name, own in config["surface"]["networks"].items():
        switches = {key: value for key, value in own.items() if key not in ("pretraining", "finetuning")}
        network = {key: config["surface"][key] for key in ("points", "neighbours", "repeats")} | switches
        settings[name] = {"network": network, "finetuning": own["finetuning"]}
        settings[name + PRETRAINED] = settings[name] | {"pretraining": own["pretraining"]}
    return settings


def left_out(config: Mapping, scanned: int) -> list[str]:
    """The learned methods, where fewer patients have a post-operative scan than there are folds to train in turn."""
    learned = {REGRESSION, *config["variants"], *surface_networks(config)}
    left = [method for method in config["methods"] if method in learned and scanned < config["folds"]]
    if len(left) == len(config["methods"]) and not config["external"]:
        raise InputError(
            "-",
            "configuration",
            f"none of 'methods' is left: {scanned} scanned patients do not fill {config['folds']} folds to train on",
            "add a method that needs no training, or lower 'folds'",
        )
    return left


def check_config(config: Mapping) -> None:
    """Refuse a configuration whose keys contradict each other; the message names the keys."""

    def refuse(problem: str, remedy: str):
        raise InputError("-", "configuration", problem, remedy)

    known = ["superficial", "muscle", "cranium", *config["segments"]]
    labels = config["labels"]
    if missing := [name for name in config["segments"] if name not in labels]:
        refuse(f"segments {missing} have no entry in 'labels'", "give each segment its voxel value")
    values = [labels[name] for name in known if name in labels]
    if len(set(values)) < len(values):
        refuse("two structures share one value in 'labels'", "give each structure its own value")
    learned, surface, built_in = config["variants"], surface_networks(config), (*UNTRAINED, REGRESSION)
    if unknown := [name for name in config["methods"] if name not in {*built_in, *learned, *surface}]:
        refuse(
            f"method {unknown[0]!r} is none of {built_in} and not among 'variants' and 'surface.networks'",
            "correct its name, or describe it in 'variants'",
        )
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
    named = {
        "ablation": config["ablation"],
        "design.base": [config["design"]["base"]],
        "corrections.methods": config["corrections"]["methods"],
        "uncertainty.methods": config["uncertainty"]["methods"],
        "tradeoff.networks": config["tradeoff"]["networks"],
        "scaling.methods": config["scaling"]["methods"],
    }
    for section, names in named.items():
        if unknown := [name for name in names if name not in learned]:
            refuse(f"{section} names {unknown[0]!r}, which is not among 'variants'", "name a learned method")
    if unknown := [name for name in config["tradeoff"]["further"] if name not in variants(config)]:
        refuse(f"tradeoff.further names {unknown[0]!r}, which is no variant and no design_ switch", "correct its name")
    for name, settings in surface.items():
        try:
            SurfaceSettings(**settings["network"])
        except ValueError as error:
            refuse(f"the network of {name!r} cannot be built: {error}", "change its keys in 'surface'")
    for name, settings in variants(config).items():
        try:
            NetworkSettings(**settings["network"])
        except ValueError as error:
            refuse(f"the network of {name!r} cannot be built: {error}", "change its keys in 'network' or 'variants'")
        if settings["finetuning"]["execution_prior"] and settings["network"]["lift"] == "none":
            refuse(
                f"{name!r} has an execution_prior and no lift", "choose a lift, or set finetuning.execution_prior to 0"
            )
    if config["cohort"] == "virtual" and config["virtual"]["patients"] < config["folds"]:
        refuse("there are fewer virtual patients than folds", "lower 'folds' or raise virtual.patients")
