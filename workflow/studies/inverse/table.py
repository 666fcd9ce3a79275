"""The table of the inverse: how well the motion is found that made a face, against a regression, what is reached."""

import os
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from scipy import stats

from pinnochio.columns import Column, check, number, read_tables, words
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.methods.pca_linear import ridge
from pinnochio.model.bones import segment_points
from pinnochio.model.patient import PatientModel
from pinnochio.plans.roles import known_role
from pinnochio.seeds import derive_seed
from pinnochio.statistics.conformal import half_width
from pinnochio.statistics.wilcoxon import compare, holm
from pinnochio.tables.document import Block, Table, View, views
from studies.inverse.columns import FACES, MARKED, RECOVERED, SEEN, TASK
from studies.inverse.freedom import LPS, QUANTITIES
from studies.inverse.measuring import EXACT, LANDMARKS, OUTCOME, SIMULATED, TASKS, apart

METHODS = INVERSE, SURE, CHOSEN, REGRESSION = "inverse", "inverse, exact", "inverse, tolerance chosen", "regression"
ALL = "all"
FEWEST = 5  # training patients with a bone, below which nothing is regressed on it
LEVEL = 0.9  # of the landmarks' half-widths
ERRORS = ("error", "degrees", "told_error", "told_degrees")
WITHIN = {"error": 0.2, "degrees": 0.3}  # medians that the motion of a simulated face should be found within
WORST = {"told_error": 1.0, "told_degrees": 1.5}

INVERSES = (
    TASK,
    Column("method", str, "", "inverse: exact (least tolerance), tolerance chosen in training, or regression"),
    Column("bone", str, "", "maxilla, distal (lower jaw), mandible (uncut), proximal (ramus), chin, or all"),
    Column("patients", int, "", "patients"),
    Column("bones", int, "", "bones"),
    number("moved", "mm", "median motion of the bones", ".3f"),
    number("error", "mm", "median of the bones' mean distance from the true motion", ".4f"),
    number("error_low", "mm", "end of the bootstrap 95% interval of error", ".4f"),
    number("error_high", "mm", "end of the bootstrap 95% interval of error", ".4f"),
    number("error_worst", "mm", "largest error", ".4f"),
    number("degrees", "deg", "median angle from the true rotation", ".4f"),
    number("degrees_low", "deg", "end of the bootstrap 95% interval of degrees", ".4f"),
    number("degrees_high", "deg", "end of the bootstrap 95% interval of degrees", ".4f"),
    number("degrees_worst", "deg", "largest degrees", ".4f"),
    number("told_error", "mm", "median distance without the null space of the wish", ".4f"),
    number("told_error_worst", "mm", "largest told_error", ".4f"),
    number("told_degrees", "deg", "median angle without the null space of the wish", ".4f"),
    number("told_degrees_worst", "deg", "largest told_degrees", ".4f"),
    number("pairs", "", "patients that are compared with the regression", ".0f"),
    number("difference", "mm", "mean over patients of the mean error over bones minus the regression's", ".4f"),
    number("difference_low", "mm", "end of the bootstrap 95% interval of difference", ".4f"),
    number("difference_high", "mm", "end of the bootstrap 95% interval of difference", ".4f"),
    number("p", "", "two-sided Wilcoxon signed-rank test of it over patients, Holm-corrected over the rows", ".3g"),
    Column("test", str, "", "how p was made, or why there is none"),
)


def tabulate(
    recovered: Sequence[str | os.PathLike],
    faces: Sequence[str | os.PathLike],
    marked: Sequence[str | os.PathLike],
    seen: Sequence[str | os.PathLike],
    models: Sequence[str | os.PathLike],
    cases: Sequence[str],
    held_out: Mapping[str, Sequence[str]],
    tolerance: float,
    cohort: str,
    seed: int,
) -> Table:
    """One file of each kind per patient, in the order of `cases`; held_out: patients of each fold; tolerance: that of
    the configuration, mm."""
    results, looked = read_tables(recovered, RECOVERED), read_tables(seen, SEEN)
    bones = {case: segment_points(PatientModel.read(path)) for case, path in zip(cases, models, strict=True)}
    subset = results[np.isclose(results["tolerance"], tolerance)]
    sure = results[(results["task"] == SIMULATED) & np.isclose(results["tolerance"], EXACT)]
    parts = [
        sure.assign(method=SURE),
        subset.assign(method=INVERSE),
        chosen(results, held_out, tolerance),
        regressed(subset, looked, bones, held_out).assign(method=REGRESSION),
    ]
    rows = pd.concat([part for part in parts if len(part)], ignore_index=True)
    frame = summarise(rows, seed)
    blocks = [recovered_block(frame, sure, cohort), faces_block(read_tables(faces, FACES), tolerance)]
    places = read_tables(marked, MARKED)
    places = places[places["error"].notna()]
    if len(places):
        blocks.append(reached_block(places))
    about = (
        "A simulated face is made by the same mesh and mechanics that seek its motion, from a plan with rami that turn "
        "about their condyles: its rows say that the method finds what can be found, not how well a surgeon is served. "
        "That is what the outcome's rows say: the scanned face holds what no mechanics here knows."
    )
    return Table(frame, INVERSES, blocks, [about])


def chosen(results: pd.DataFrame, held_out: Mapping[str, Sequence[str]], tolerance: float) -> pd.DataFrame:
    """Rows of the real faces with the tolerance that finds the motions of the training patients of a fold best."""
    parts = []
    for task in (OUTCOME, LANDMARKS):
        rows = results[results["task"] == task]
        errors = rows.groupby(["case", "tolerance"])["error"].mean().unstack()
        for cases in held_out.values():
            training = errors[~errors.index.isin(cases)]
            best = training.mean().idxmin() if len(training) else tolerance
            parts.append(rows[rows["case"].isin(cases) & np.isclose(rows["tolerance"], best)].assign(method=CHOSEN))
    return pd.concat(parts, ignore_index=True)


def regressed(
    subset: pd.DataFrame, looked: pd.DataFrame, bones: Mapping[str, Mapping], held_out: Mapping[str, Sequence[str]]
) -> pd.DataFrame:
    """Motions by ridge regression on where landmarks and regions go: one model per fold, task and bone.

    own: rows of RECOVERED, whose true motions are learned; looked: rows of SEEN; bones: points by case and segment.
    """
    rows = []
    for (task, segment), group in subset.groupby(["task", "segment"], sort=False):
        group = group.set_index("case")
        features = looked[looked["task"] == task].pivot(index="case", columns="feature", values="value")
        motions = group[[f"true_{name}" for name in QUANTITIES]]
        for cases in held_out.values():
            training = [case for case in group.index if case not in cases]
            if len(training) < FEWEST:
                continue
            known = features.loc[training].to_numpy()
            scale = np.where(known.std(axis=0) > 1e-9, known.std(axis=0), 1.0)
            weights = ridge(known / scale, motions.loc[training].to_numpy(), np.arange(len(training)))
            for case in (case for case in group.index if case in cases):
                guess = np.append(features.loc[case].to_numpy() / scale, 1) @ weights
                error, degrees = _off(guess, motions.loc[case].to_numpy(), bones[case][segment])
                rows.append({"case": case, "task": task, "segment": segment, "error": error, "degrees": degrees}
                            | {"moved": group.loc[case, "moved"]})  # fmt: skip
    return pd.DataFrame(rows, columns=["case", "task", "segment", "moved", *ERRORS])


def _off(guess: np.ndarray, true: np.ndarray, bone: np.ndarray) -> tuple[float, float]:
    """Mean distance (mm) of a bone (b, 3) under two motions given as QUANTITIES (6,), and the angle between them."""
    one, other = (RigidMotion.from_degrees(subset[3:], LPS * subset[:3], bone.mean(axis=0)) for subset in (guess, true))
    return apart(one, other, bone)


def summarise(rows: pd.DataFrame, seed: int) -> pd.DataFrame:
    """One row of INVERSES per task, method and kind of bone, and of all bones."""
    rows = rows.assign(bone=rows["segment"].map(known_role))
    results = []
    for task in TASKS:
        for method in METHODS:
            subset = rows[(rows["task"] == task) & (rows["method"] == method)]
            for bone in (ALL, *dict.fromkeys(subset["bone"])) if len(subset) else ():
                part = subset if bone == ALL else subset[subset["bone"] == bone]
                row = {"task": task, "method": method, "bone": bone, "patients": part["case"].nunique()}
                row |= {"bones": len(part), "moved": part["moved"].median()}
                for name in ERRORS:
                    row |= {name: part[name].median(), f"{name}_worst": part[name].max()}
                for name in ("error", "degrees"):
                    low, high = _interval(part[name].to_numpy(float), derive_seed(seed, "inverse", f"{task} {bone}"))
                    row |= {f"{name}_low": low, f"{name}_high": high}
                peer = rows[(rows["task"] == task) & (rows["method"] == REGRESSION)]
                peer = peer if bone == ALL else peer[peer["bone"] == bone]
                one, other = (
                    each.set_index(["case", "segment"])["error"] for each in (part, peer)
                )  # the same bones of the same patients
                both = one.index.intersection(other.index)
                one, other = (each.loc[both].groupby("case").mean() for each in (one, other))
                if method == REGRESSION:
                    results.append(row | {"test": "the regression itself"})
                    continue
                test = compare(one, other, derive_seed(seed, "inverse regression", f"{task} {bone}"))
                row |= {"pairs": test.n, "difference": test.mean, "difference_low": test.low}
                results.append(row | {"difference_high": test.high, "p": test.p, "test": test.statement})
    frame = pd.DataFrame(results)
    if "p" in frame:
        frame["p"] = holm(frame["p"].to_numpy(float))
    return check(frame.reindex(columns=[column.name for column in INVERSES]), INVERSES)


def _interval(values: np.ndarray, seed: int) -> tuple[float, float]:
    """95% bootstrap interval of the median."""
    if len(values) < 2:
        return np.nan, np.nan
    rng = np.random.default_rng(seed)
    subset = stats.bootstrap((values,), np.median, n_resamples=2000, method="percentile", rng=rng).confidence_interval
    return float(subset.low), float(subset.high)


def recovered_block(frame: pd.DataFrame, simulated: pd.DataFrame, cohort: str) -> Block:
    """The motions found, and whether they are found as they should be on simulated faces."""
    by_name = {column.name: column for column in INVERSES}

    def spread(name: str):
        def text(row) -> str:
            middle, low, high, worst = (by_name[f"{name}{end}"].text(row[f"{name}{end}"]) for end in
                                        ("", "_low", "_high", "_worst"))  # fmt: skip
            return f"{middle} [{low}, {high}] ({worst})" if middle else ""

        return text

    def visible_part(name: str):
        def text(row) -> str:
            middle, worst = (by_name[f"{name}{end}"].text(row[f"{name}{end}"]) for end in ("", "_worst"))
            return f"{middle} ({worst})" if middle else ""

        return text

    def against(row) -> str:
        parts = [by_name[f"difference{end}"].text(row[f"difference{end}"]) for end in ("", "_low", "_high")]
        return f"{parts[0]} [{parts[1]}, {parts[2]}]" if parts[0] else ""

    view = [
        *views(
            INVERSES,
            {
                "task": "Wished",
                "method": "Method",
                "bone": "Bones",
                "patients": "Patients",
                "bones": "n",
                "moved": "Moved mm",
            },
        ),  # fmt: skip
        View("Error mm", spread("error")),
        View("Error deg", spread("degrees")),
        View("Told mm", visible_part("told_error")),
        View("Told deg", visible_part("told_degrees")),
        View("Minus regression mm", against),
        View("p", lambda row: by_name["p"].text(row["p"]) or row["test"]),
    ]
    good = all(simulated[name].median() <= limit for name, limit in WITHIN.items())
    fine = all((simulated[name].max() <= limit) for name, limit in WORST.items())
    caption = (
        f"From a wished face to the motion that made it, {cohort}: median [bootstrap 95 % interval over bones] "
        "(largest). Error: mean distance of a bone from where it went, and angle. Told: without combinations of "
        "motions that the wish cannot tell apart. Simulated: the finite-element face of the plan; outcome: the scan "
        "after surgery, against the registered motion; landmarks: where those of the outcome are. Exact: the plan that "
        "comes nearest; else the least motion of those that miss the wish by no more than it and the tolerance, which "
        "is the configuration's or chosen by the training patients of each fold. Minus regression: mean over patients, "
        "ridge regression "
        "on where landmarks and regions go, folds as in the study; p: Wilcoxon, Holm-corrected over the rows. "
        f"Exact on simulated faces: medians below {WITHIN['error']} mm and {WITHIN['degrees']} degrees: "
        f"{'yes' if good else 'no'}; worst of what is told below {WORST['told_error']} mm and "
        f"{WORST['told_degrees']} degrees: {'yes' if fine else 'no'}."
    )
    return Block.of(frame, view, caption)


def faces_block(faces: pd.DataFrame, tolerance: float) -> Block:
    """How near the faces come, and what it takes, with the tolerance of the configuration."""
    subset = faces[np.isclose(faces["tolerance"], tolerance)]
    groups = subset.groupby("task", sort=False)

    def middle(name: str, form: str):
        return lambda row: "{} ({})".format(*(format(value, form) for value in (row[name].median(), row[name].max())))

    shown = pd.DataFrame([{"task": task} | {name: group[name] for name in group} for task, group in groups])
    shown["task"] = list(groups.groups)
    view = [
        View("Wished", lambda row: row["task"]),
        View("Patients", lambda row: len(row["case"])),
        View("Asked mm", middle("asked", ".2f")),
        View("Left mm", middle("misfit", ".3f")),
        View("Elastic map off mm", middle("elastic_gap", ".3f")),
        View("Not told apart", middle("untold", ".0f")),
        View("of", middle("parameters", ".0f")),
        View("On a bound", middle("bounded", ".0f")),
        View("Corrections", middle("corrections", ".0f")),
        View("Elastic s", middle("seconds_elastic", ".2f")),
        View("In all s", middle("seconds", ".2f")),
        View("Solved", lambda row: int(row["solved"].sum())),
    ]
    caption = (
        "The faces of the proposals: median (largest) over the patients of the wish's root mean square error before "
        "and after, of the distance of the elastic map from finite elements, of the combinations of motions that the "
        "wish cannot tell apart, and of the seconds of a first proposal by the elastic map and of all corrections."
    )
    return Block.of(shown, view, caption, "Faces")


def reached_block(places: pd.DataFrame) -> Block:
    """Which landmarks are reached within what finite elements are usually off, and on how many patients all are."""
    width = {}
    for place, group in places.groupby("place", sort=False):
        for case in group["case"]:
            others = group.loc[group["case"] != case, "forward_error"].to_numpy()
            width[case, place] = half_width(others[:, None], LEVEL)
    limit = np.array([width[case, place] for case, place in zip(places["case"], places["place"], strict=True)])
    places = places.assign(limit=limit, reached=places["error"] <= limit)
    known = places[np.isfinite(places["limit"])]
    all_reached = known.groupby("case")["reached"].all()
    groups = places.groupby("place", sort=False)
    shown = pd.DataFrame({"place": list(groups.groups)})
    view = [
        View("Landmark", lambda row: words(row["place"])),
        View("Moved mm", lambda row: f"{groups.get_group(row['place'])['moved'].median():.2f}"),
        View("Missed mm", lambda row: f"{groups.get_group(row['place'])['error'].median():.2f}"),
        View("Achieved motion mm", lambda row: f"{groups.get_group(row['place'])['forward_error'].median():.2f}"),
        View("Half-width mm", lambda row: f"{groups.get_group(row['place'])['limit'].median():.2f}"),
        View(
            "Reached",
            lambda row: (
                f"{int(groups.get_group(row['place'])['reached'].sum())} of {len(groups.get_group(row['place']))}"
            ),
        ),  # fmt: skip
    ]
    caption = (
        f"Landmarks of the outcome as a wish: medians over {places['case'].nunique()} patients. Missed: by the "
        "finite-element face of the proposal; achieved motion: by that of the motion that surgery made. Half-width: "
        f"conformal, {100 * LEVEL:g} % of the errors of finite elements with the achieved motion on all other "
        f"patients. Reached: missed by less. All landmarks reached: {int(all_reached.sum())} of "
        f"{len(all_reached)} patients."
    )
    return Block.of(shown, view, caption, "Landmarks")
