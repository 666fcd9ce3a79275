"""The checks of a study's configuration that a schema cannot express."""

import itertools
from collections.abc import Mapping
from typing import NoReturn

from pinnochio.errors import InputError
from pinnochio.methods.registry import BUILT_IN, graph_networks, surface_networks
from pinnochio.methods.surface.settings import SurfaceSettings
from pinnochio.networks.settings import NetworkSettings
from pinnochio.study.cohort import virtual_names
from pinnochio.virtual.procedures import dealt


def check_config(config: Mapping) -> None:
    """Refuse a configuration whose keys contradict each other; the message names the keys."""
    _check_labels(config)
    _check_methods(config)
    _check_reference(config)
    _check_named_networks(config)
    _check_settings(config)
    if config["cohort"] == "virtual":
        _check_virtual(config)


def _refuse(problem: str, remedy: str) -> NoReturn:
    raise InputError("-", "configuration", problem, remedy)


def _check_labels(config: Mapping) -> None:
    labels = config["labels"]
    if isinstance(labels, str):
        if config["cohort"] == "virtual" and not config["patient"]:
            _refuse(
                f"'labels' is the preset {labels!r}, and virtual patients need values",
                "name a cohort or a patient that the tool has segmented",
            )
        return
    if missing := [name for name in config["segments"] if name not in labels]:
        _refuse(f"segments {missing} have no entry in 'labels'", "give each segment its voxel value")
    structures = ["superficial", "muscle", "cranium", *config["segments"]]
    values = [labels[name] for name in structures if name in labels]
    if len(set(values)) < len(values):
        _refuse("two structures share one value in 'labels'", "give each structure its own value")


def _check_methods(config: Mapping) -> None:
    """Each name stands for one method, and every method that is named is one."""
    variants, surface = config["variants"], surface_networks(config)
    built_in = tuple(method.name for method in BUILT_IN)
    known = {*built_in, *variants, *surface}
    if unknown := [name for name in config["methods"] if name not in known]:
        _refuse(
            f"method {unknown[0]!r} is none of {built_in} and not among 'variants' and 'surface.networks'",
            "correct its name, or describe it in 'variants'",
        )
    for section, key in (("planned", "without"), ("uncertainty", "methods")):
        if unknown := [name for name in config[section][key] if name not in known]:
            _refuse(f"{section}.{key} names {unknown[0]!r}, which is no method", "correct its name")
    if taken := [name for name in [*config["external"], *variants, *surface] if name in built_in]:
        _refuse(f"{taken[0]!r} is the name of a built-in method", "choose another name in 'external' or 'variants'")
    sections = {"external": config["external"], "variants": variants, "surface.networks": surface}
    for (one, first), (other, second) in itertools.combinations(sections.items(), 2):
        if taken := [name for name in first if name in second]:
            _refuse(f"{taken[0]!r} stands in {one!r} and in {other!r}", "give each method its own name")


def _check_reference(config: Mapping) -> None:
    reference = config["reference"]
    if reference not in [*config["methods"], *config["external"]]:
        _refuse(f"reference {reference!r} is not among 'methods' and 'external'", "add it, or choose another reference")
    if reference in [method.name for method in BUILT_IN if method.bound]:
        _refuse(f"reference {reference!r} is a bound, which knows what happened", "choose a method")


def _check_named_networks(config: Mapping) -> None:
    """What sections name is a learned method."""
    for section, names in {"ablation": config["ablation"], "better": [config["better"]]}.items():
        if unknown := [name for name in names if name not in config["variants"]]:
            _refuse(f"{section} names {unknown[0]!r}, which is not among 'variants'", "name a learned method")


def _check_settings(config: Mapping) -> None:
    """Every network can be built."""
    for networks, build, sections in (
        (surface_networks(config), SurfaceSettings, "'surface'"),
        (graph_networks(config), NetworkSettings, "'network' or 'variants'"),
    ):
        for name, settings in networks.items():
            try:
                build(**settings["network"])
            except ValueError as error:
                _refuse(f"the network of {name!r} cannot be built: {error}", f"change its keys in {sections}")


def _check_virtual(config: Mapping) -> None:
    virtual = config["virtual"]
    names, without = virtual_names(virtual["patients"]), virtual["without"]
    if not config["patient"]:
        procedures = dealt(virtual["procedures"], virtual["patients"])
        segments = dict.fromkeys(name for procedure in procedures for name in procedure.segments)
        if missing := [name for name in segments if name not in config["segments"]]:
            _refuse(
                f"the procedures of the virtual patients have segments {missing}, and 'segments' lacks them",
                "add them to 'segments', or set the share of their procedures in 'virtual.procedures' to 0",
            )
    if unknown := sorted(set(without) - set(names)):
        _refuse(f"virtual.without names {unknown}, and the patients are {names[0]} to {names[-1]}", "take them out")
    if len(names) - len(without) < config["folds"]:
        _refuse("there are fewer virtual patients than folds", "lower 'folds' or raise virtual.patients")
