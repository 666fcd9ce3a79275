"""Cases, folds and the checks of a study's configuration that a schema cannot express."""

import csv
import hashlib
import itertools
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pinnochio.baselines.settings import SurfaceSettings
from pinnochio.errors import InputError
from pinnochio.networks.settings import NetworkSettings
from pinnochio.seeds import generator

COLUMNS = ("case", "segmentation", "plan", "postop")
UNTRAINED = (
    *("no_change", "ratio", "elastic", "fem_bonded", "fem_sliding"),
    *("fem_rlse_bonded", "fem_rlse_mucosa", "fem_rlse"),
)
REGRESSION = "pca_linear"
PRETRAINED = "_pretrained"  # ends the name of a surface network that finite-element fields have taught first


@dataclass(frozen=True)
class Case:
    """One patient of a cohort table; `postop` is empty where there is no post-operative scan."""

    name: str
    segmentation: str
    plan: str
    postop: str = ""


def virtual_cases(patients: int, folder: str) -> list[Case]:
    """The cases of the virtual cohort; their files lie in `folder`/{case}/."""
    width = max(2, len(str(patients)))
    names = [f"V{number:0{width}d}" for number in range(1, patients + 1)]
    return [
        Case(
            name,
            f"{folder}/{name}/segmentation.nii.gz",
            f"{folder}/{name}/plan.json",
            f"{folder}/{name}/postop.ply",
        )
        for name in names
    ]


def read_cases(table: str | os.PathLike) -> list[Case]:
    """Read a cohort table (tab-separated; paths relative to the table) and check that its files exist."""
    table = Path(table)
    if not table.is_file():
        raise InputError("-", table, "the cohort table does not exist", "set 'cohort' to 'virtual' or to a table")
    with open(table, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file, delimiter="\t")
        if tuple(reader.fieldnames or ()) != COLUMNS:
            raise InputError(
                "-",
                table,
                f"its columns are {reader.fieldnames}",
                f"use tab-separated columns {', '.join(COLUMNS)}",
            )
        rows = [{key: (value or "").strip() for key, value in row.items() if key} for row in reader]
    cases = []
    for row in rows:
        name = row["case"]
        if not name.replace("_", "").replace("-", "").isalnum():
            raise InputError(name, table, "the name is not of letters, digits, '-' and '_'", "rename the case")
        if name in {case.name for case in cases}:
            raise InputError(name, table, "two rows carry this name", "give each case its own name, once")
        paths = {key: str(table.parent / row[key]) if row[key] else "" for key in COLUMNS[1:]}
        for key, path in paths.items():
            if not path and key != "postop":
                raise InputError(name, table, f"column {key} is empty", f"name the {key} file of the case")
            # A segmentation may be a folder of surfaces, a plan one of transforms.
            if path and not (Path(path).is_file() or (key != "postop" and Path(path).is_dir())):
                raise InputError(name, path, f"the {key} file does not exist", f"correct the path in {table}")
        cases.append(Case(name, **paths))
    if not cases:
        raise InputError("-", table, "the cohort table has no case", "add one row per case")
    return cases


def assign_folds(scanned: Sequence[str], unscanned: Sequence[str], folds: int, seed: int) -> dict[str, list[str]]:
    """Held-out cases of each fold ("1", "2", ...), drawn once from the seed; fold sizes differ by at most one.

    The patients without a post-operative scan are dealt after the scanned ones, whose folds they leave as they are.
    """
    held_out: dict[str, list[str]] = {str(fold + 1): [] for fold in range(folds)}
    shuffled = [
        group[i]
        for group in (scanned, unscanned)
        for i in generator(seed, "folds", ",".join(group)).permutation(len(group))
    ]
    for number, name in enumerate(shuffled):
        held_out[str(number % folds + 1)].append(name)
    return {fold: sorted(cases) for fold, cases in held_out.items() if cases}


def overlaid(base: Mapping, overlay: Mapping) -> dict:
    """`base` with the values of `overlay` in place of its own, mapping by mapping."""
    merged = dict(base)
    for key, value in overlay.items():
        merged[key] = overlaid(merged.get(key, {}), value) if isinstance(value, Mapping) else value
    return merged


def changes(base: Mapping, other: Mapping, prefix: str = "") -> Sequence[str]:
    """What differs between two settings, as "key value" in words; keys of nested mappings are joined by dots."""
    found = []
    for key in sorted({*base, *other}):
        one, two = base.get(key), other.get(key)
        if isinstance(one, Mapping) and isinstance(two, Mapping):
            found += changes(one, two, f"{prefix}{key}.")
        elif one != two:
            found.append(f"{prefix}{key} {two}")
    return found


def variants(config: Mapping) -> dict[str, dict]:
    """Settings of every learned method by its name: network, pretraining, finetuning, refine.

    Those of `variants` are overlays of the configuration's own sections, those of `design.switches`, named
    design_{switch}, overlays of the variant `design.base`.
    """
    own = {key: config[key] for key in ("network", "pretraining", "finetuning", "refine")}
    found = {name: overlaid(own, overlay) for name, overlay in config["variants"].items()}
    design = config["design"]
    if base := found.get(design["base"]):
        found |= {f"design_{name}": overlaid(base, overlay) for name, overlay in design["switches"].items()}
    return found


def surface_networks(config: Mapping) -> dict[str, dict]:
    """Settings of every surface network by its name: network, finetuning, and pretraining where the name says so."""
    found = {}
    for name, own in config["surface"]["networks"].items():
        switches = {key: value for key, value in own.items() if key not in ("pretraining", "finetuning")}
        network = {key: config["surface"][key] for key in ("points", "neighbours", "repeats")} | switches
        found[name] = {"network": network, "finetuning": own["finetuning"]}
        found[name + PRETRAINED] = found[name] | {"pretraining": own["pretraining"]}
    return found


def left_out(config: Mapping, scanned: int) -> list[str]:
    """The learned methods, where fewer patients have a post-operative scan than there are folds to train in turn."""
    learned = {REGRESSION, *config["variants"], *surface_networks(config)}
    found = [method for method in config["methods"] if method in learned and scanned < config["folds"]]
    if len(found) == len(config["methods"]) and not config["external"]:
        raise InputError(
            "-",
            "configuration",
            f"none of 'methods' is left: {scanned} scanned patients do not fill {config['folds']} folds to train on",
            "add a method that needs no training, or lower 'folds'",
        )
    return found


def external_file(folder: str | os.PathLike, case: str) -> str:
    """The file in which a method made elsewhere delivers a case: {case}.npz, else {case}.vtu."""
    names = [f"{case}.npz", f"{case}.vtu"]
    for name in names:
        if (Path(folder) / name).is_file():
            return str(Path(folder) / name)
    raise InputError(
        case, folder, f"there is neither {names[0]} nor {names[1]}", "put the prediction of every case into the folder"
    )


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
        "dial.methods": config["dial"]["methods"],
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


def code_hash(files: Iterable[str | os.PathLike], root: str | os.PathLike) -> str:
    """Short content hash of source files; depends on their paths below `root` alone, not on where that lies."""
    digest = hashlib.sha256()
    for path in sorted(Path(file) for file in files):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:12]
