"""The cases of the virtual cohort, the folds that hold cases out, and the files of methods made elsewhere."""

import os
from collections.abc import Collection, Sequence
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.importing.cohort import Case
from pinnochio.seeds import generator


def virtual_cases(patients: int, folder: str, without: Collection[str] = ()) -> list[Case]:
    """The cases of the virtual cohort but those `without`, in the order in which they are drawn; their files lie in
    `folder`/{case}/."""
    width = max(2, len(str(patients)))
    names = [f"V{number:0{width}d}" for number in range(1, patients + 1)]
    return [
        Case(
            name,
            f"{folder}/{name}/segmentation.nii.gz",
            f"{folder}/{name}/plan.json",
            f"{folder}/{name}/postop.ply",
            f"{folder}/{name}/postop_bones.nii.gz",
            covariates_file=f"{folder}/{name}/covariates.json",
        )
        for name in names
        if name not in without
    ]


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


def of_fewer(fold: str, patients: int) -> str:
    """What the fold is called that holds out the same cases and trains on so many patients only."""
    return f"{fold}of{patients}"


def whole_fold(fold: str) -> tuple[str, int | None]:
    """The fold that holds the same cases out, and how many patients it trains on; None for all."""
    own, _, patients = fold.partition("of")
    return own, int(patients) if patients else None


def some(names: Sequence[str], patients: int, seed: int, fold: str) -> list[str]:
    """So many of the names, in their order: drawn so that fewer are among more."""
    drawn = generator(seed, "learning", fold).permutation(len(names))[:patients]
    return [names[i] for i in sorted(drawn)]


def external_file(folder: str | os.PathLike, case: str) -> str:
    """The file in which a method made elsewhere delivers a case: {case}.npz, else {case}.vtu."""
    names = [f"{case}.npz", f"{case}.vtu"]
    for name in names:
        if (Path(folder) / name).is_file():
            return str(Path(folder) / name)
    raise InputError(
        case, folder, f"there is neither {names[0]} nor {names[1]}", "put the prediction of every case into the folder"
    )
