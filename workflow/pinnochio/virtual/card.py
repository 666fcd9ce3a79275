"""The data card of a virtual cohort: what it is, how it was made, from which distributions, and where it ends."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinnochio.plans.plan import Plan
from pinnochio.virtual.case_files import CHECKSUMS, FILES, INPUTS, LOCKED, OUTCOME_CHECKSUMS, OUTCOMES
from pinnochio.virtual.covariates import MEANING
from pinnochio.virtual.ground_truth import EFFECTS, NOMINAL, REALITIES, in_reality
from pinnochio.virtual.parameters import FITTED, SHIFTS, TABLE
from pinnochio.virtual.procedures import DEFORMITIES

ROLES = {
    "development": "development: settings are chosen on it",
    "calibration": "calibration: the dials of the outcome are found on it",
    LOCKED: "locked: for final tables; no setting is ever chosen on it",
}
HIDDEN = f"""\
The outcomes of this cohort ({", ".join(f"`{name}`" for name in OUTCOMES)}) are not in this packet. `snakemake reveal
--configfile config/locked.yaml --cores 2` makes them, with their checksums in `{OUTCOME_CHECKSUMS}`; do \
so once, when every
setting is final, and report all that you then find."""
LIMITS = """\
* Every patient, plan and outcome is simulated: results on this cohort are results on a virtual cohort. Nothing was
  validated against clinical outcomes, and nothing is for planning or treating patients.
* The outcome is itself computed by finite elements (another mesh, another law, other stiffness than a method can know),
  which favours methods of that kind. What goes beyond mechanics is a handful of smooth fields of fixed shape.
* Two soft tissues, each homogeneous and isotropic in a patient: no fibre direction, no skin layer of its own, no growth
  or scarring. The tension of the skin acts by its change alone. The lips do not touch each other in the mechanics.
* Posture moves the skin as published by region and the tissue below it as elastic; the jaw itself does not turn.
* Adults with one of four deformities in equal numbers. The distributions are literature means [R] and choices [I], not
  a fit to one population; origin, clefts and syndromes are not modelled; age and body mass act on the outcome alone.
* Given sex and deformity the numbers are drawn independently of each other, but for the thicknesses of a face.
* Segmentations before surgery are free of artefacts: no metal, no motion, no wrong label. Those after surgery have
  metal, streaks and noise of our own making, not those of a scanner.
* The scan lacks what two cameras do not see, and some millimetres around every open border.
* The face model is one of neutral expressions without hair; its teeth are modelled, not scanned, and of its sample
  sexes, ages and origins are not stated. Women and men are told apart by size and proportion alone.
* The lips of the deformed head stay closed, however far apart the jaws are; the airway is a pair of plain passages.
* The skull is a parametric one in every patient: only the landmarks follow the person."""
ATTRIBUTION = (
    "The faces are drawn from a model derived from ICT-FaceKit, light-stage scans of real persons (Copyright (c) 2020 "
    "USC Institute for Creative Technologies, MIT licence; `workflow/pinnochio/virtual/face_model/`)."
)
FACES = """\
Each patient starts as a normal person. The face is a draw of the model's coordinates (standard normal within 2.5; women
and men differ by what the table of differences in `virtual/morphable_model.py` says [R]); the skull is fitted inside
it, so that the bone lies the drawn thickness below the skin at the landmarks; height and arch of the teeth are the
model's, the incisors lie the lips' thickness behind the lips. Then the jaws are moved and grown as the deformity has
it, and the skin goes with them as elastic tissue that slides over teeth and gums (Poisson's ratio 0.45, small strains).
Numbers marked *the face* follow from the draw; thicknesses hold before the deformity."""
EVALUATION = """\
1. `snakemake inputs --cores 2` makes what a method may read, per case `mesh.vtu` and `model.h5` (tetrahedra, tissues,
   interfaces, bone), `achieved.json` (the motions registered on the bones after surgery, with which every method is
   judged), `plan.json` and `postop.h5` (registered scan) in `cases/{case}/`, and `folds.csv`.
2. Predict every case by a model that has not seen it: `folds.csv` names the fold that holds each case out.
3. Write one file per case: `{case}.npz` with `displacement` (n, 3) in mm, LPS, for the n nodes of `mesh.vtu` in their
   order, or `{case}.vtu` with that mesh, in any order, and `displacement` as point data. `seconds` and `setup_seconds`
   are optional.
4. `snakemake --cores 2 --config external="{my_method: path/to/folder}"` adds the row `my_method` to every table."""


def markdown_table(headers: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table; bars in the cells are escaped."""
    lines = [headers, ["---"] * len(headers), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def spread(values: Sequence[float], digits: int = 1) -> str:
    """Mean ± SD [lowest, highest]; one value has no spread."""
    values = np.asarray(values, float)
    numbers = values.mean(), values.std(ddof=min(1, len(values) - 1)), values.min(), values.max()
    mean, sd, low, high = (f"{round(number, digits) + 0.0:.{digits}f}" for number in numbers)  # + 0.0: no minus zero
    return f"{mean} ± {sd} [{low}, {high}]"


def procedures_table(anatomies: Sequence[Mapping[str, Any]]) -> str:
    """Counts of the operations by deformity."""
    count = Counter((anatomy["procedure"], anatomy["deformity"]) for anatomy in anatomies)
    rows = [
        (name, *counts, sum(counts))
        for name in sorted({name for name, _ in count})
        for counts in [[count[name, deformity] for deformity in DEFORMITIES]]
    ]
    return markdown_table(("operation", *DEFORMITIES, "all"), rows)


def patients_table(anatomies: Sequence[Mapping[str, Any]]) -> str:
    """Counts by deformity and sex."""
    count = Counter((anatomy["deformity"], anatomy["male"]) for anatomy in anatomies)
    rows = [(name, count[name, False], count[name, True]) for name in DEFORMITIES]
    rows.append(("all", *(sum(row[column] for row in rows) for column in (1, 2))))
    return markdown_table(("deformity", "women", "men", "all"), [(*row, row[1] + row[2]) for row in rows])


def parameters_table(anatomies: Sequence[Mapping[str, Any]]) -> str:
    """Each number: its distribution, or that the scanned face decides it, and what this cohort has of it."""
    rows = []
    for name in TABLE:
        entry = TABLE[name]
        drawn = f"{entry.mean:g} ± {entry.sd:g}", f"{entry.male:+g}" if entry.male else ""
        drawn += f"{entry.low:g} to {entry.high:g}", entry.source
        cohort = spread([anatomy[name] for anatomy in anatomies], max(1, 1 - int(np.floor(np.log10(entry.sd)))))
        about = ("the face", "", "", "") if name in FITTED else drawn
        rows.append((f"`{name}`", entry.meaning, entry.unit, *about, cohort))
    headers = ("name", "meaning", "unit", "women: mean ± SD", "men", "bounds", "source", "this cohort")
    return markdown_table(headers, rows)


def shifts_table() -> str:
    """What each deformity changes of the distributions."""
    rows = []
    for deformity, changes in SHIFTS.items():
        for name, change in changes.items():
            if change[0] == "+":
                text = f"mean {change[1]:+g}"
            else:
                mean, sd, low, high = change
                text = f"{mean:g} ± {sd:g}, {low:g} to {high:g}"
            rows.append((deformity, f"`{name}`", text, TABLE[name].unit))
    return markdown_table(("deformity", "name", "distribution", "unit"), rows)


def plans_table(anatomies: Sequence[Mapping[str, Any]], plans: Sequence[Plan]) -> str:
    """Planned motion of each segment by deformity: translation at the plan's pivot and angle of rotation."""
    rows = []
    for deformity in DEFORMITIES:
        treated = [plan for plan, anatomy in zip(plans, anatomies, strict=True) if anatomy["deformity"] == deformity]
        for segment in sorted({segment for plan in treated for segment in plan.motions}):
            motions = [plan.motions[segment] for plan in treated if segment in plan.motions]
            left, back, up = np.array([motion.translation for motion in motions]).T
            angles = [motion.angle for motion in motions]
            rows.append((deformity, segment, len(motions), *map(spread, (-back, up, left, angles))))
    headers = ("deformity", "segment", "n", "forward mm", "up mm", "left mm", "rotation degrees")
    return markdown_table(headers, rows)


def effects_table(effects: Mapping[str, Any] | str, reality: str) -> str:
    """The effects of the outcome with their magnitude in this cohort, and what of them is noise."""
    rows = []
    for name, value in in_reality(effects, reality).items():
        effect = EFFECTS[name]
        size = "off" if value == effect.nominal else f"{value:g}"
        rows.append((f"`{name}`", effect.meaning, size, effect.unit, effect.noise, effect.source))
    return markdown_table(("effect", "meaning", "magnitude", "unit", "noise", "source"), rows)


def covariates_table() -> str:
    """The covariates, their distributions and what they decide."""
    rows = [(f"`{name}`", *about) for name, about in MEANING.items()]
    return markdown_table(("covariate", "distribution", "source", "decides"), rows)


def reality_of(reality: str, learnable: int) -> str:
    """How hard the outcome is, and how much of it could be learned, in a sentence."""
    if reality == NOMINAL:
        return (
            "Reality `nominal`: the methods' own mechanics on their own mesh, without effects but for the error of "
            "carrying out the plan and the noise of the scan."
        )
    settings = REALITIES[reality]
    decided, opened = settings.dials[learnable]
    return (
        f"Reality `{reality}`: what is open is multiplied by {opened:g}, what is decided by {decided:g} where its size "
        "is stated nowhere and by no more than 1 where it is published; found on other patients so that sliding finite "
        f"elements with the true motion are {settings.target:g} ± 0.1 mm off ({settings.source}) and a perfect learner "
        f"explains {learnable} % of the square, and frozen."
    )


def data_card(
    anatomies: Sequence[Mapping[str, Any]],
    plans: Sequence[Plan],
    *,
    seed: int,
    code: str,
    virtual: Mapping[str, Any],
    labels: Mapping[str, int | str],
) -> str:
    """The card as Markdown.

    anatomies: per patient `deformity`, `male` and the numbers of :data:`TABLE`; plans in the same order; virtual: that
    section of the configuration; labels: voxel value of each structure.
    """
    count = len(anatomies)
    men = sum(bool(anatomy["male"]) for anatomy in anatomies)
    sections = [
        "# Data card: virtual cohort for facial soft-tissue prediction",
        f"{count} simulated patients ({count - men} women, {men} men) with a dentofacial deformity, a plan "
        "that treats it in one jaw or both, and the face after surgery: a benchmark with a volumetric truth for "
        "methods that predict how soft tissue follows bone. **Virtual, not clinical**: no patient is a person. "
        "Licence: MIT.",
        ATTRIBUTION,
        "Tags of sources: **[S]** sourced, **[R]** recalled from the literature, **[I]** our choice. Units are mm, kPa "
        "and degrees; the frame is LPS (+x the patient's left, +y posterior, +z up).",
        "## How it was made",
        origin_table(count, seed, code, virtual),
        "The same configuration, seed and code give the same patients.",
        *_patients(anatomies, plans),
        *_outcome(virtual["outcome"]),
        *_files(labels, virtual["role"] == LOCKED),
        "## Beside patients",
        "`snakemake --cores 2 structure soft_tissue` writes three tables beside this card: every measure of the "
        "deviation from finite elements, ratios and thickness, with patients' and why one lies outside.",
        "## Evaluate your own method",
        EVALUATION,
        "## Limits",
        LIMITS,
        "## Cite",
        "Cite this software by its `CITATION.cff`, with seed and code hash from above, and the paper whose task it "
        'poses: Lee et al. 2026, PINNOCHIO, arXiv 2606.01572. Say "virtual cohort" beside every number.',
    ]
    return "\n\n".join(sections) + "\n"


def origin_table(count: int, seed: int, code: str, virtual: Mapping[str, Any]) -> str:
    """By which command, seed, code and configuration the cohort was made."""
    rows = [
        ("command", "`snakemake cohort --cores 2`"),
        ("seed", seed),
        ("role", ROLES[virtual["role"]]),
        ("code", f"`{code}` (content hash of the modules that made it, whatever the commit)"),
        ("patients", count),
        ("voxel edge", f"{virtual['spacing']:g} mm"),
    ]
    return markdown_table(("what", "value"), rows)


def _patients(anatomies: Sequence[Mapping[str, Any]], plans: Sequence[Plan]) -> list[str]:
    """Who they are, from which distributions, and how they are operated on."""
    return [
        "## Patients",
        patients_table(anatomies),
        "## Sampled numbers",
        FACES,
        "Truncated normal distributions; a man's mean differs by the column *men*. The last column is what this cohort "
        "has: mean ± SD [lowest, highest], all deformities together.",
        parameters_table(anatomies),
        "A deformity has distributions of its own for some of them (same meaning and source):",
        shifts_table(),
        "## Operations",
        "Dealt by the shares of `virtual.procedures` among those that suit the deformity. A patient's segments are "
        "those that its operation cuts free; a mandible that is not cut turns about its condyles.",
        procedures_table(anatomies),
        "## Plans",
        "Planned motion, mean ± SD [lowest, highest]: translation at the pivot of the plan, and angle of rotation.",
        plans_table(anatomies, plans),
    ]


def _outcome(settings: Mapping[str, Any]) -> list[str]:
    """How the face after surgery came about; settings: the section `virtual.outcome`."""
    return [
        "## Outcome",
        "What makes the simulated outcome other than any method's computation. Each effect has a switch of its own "
        "(`virtual.outcome.effects` in the configuration) and draws of its own.",
        reality_of(settings["reality"], settings["learnable"]),
        effects_table(settings["effects"], settings["reality"]),
        "The column *noise* is what no plan, anatomy or covariate decides. Covariates (`covariates.json`) are inputs "
        "that a method may read; all of them are drawn, with these distributions:",
        covariates_table(),
    ]


def _files(labels: Mapping[str, int | str], locked: bool) -> list[str]:
    """What a patient's folder holds; of a locked cohort without its outcomes."""
    files = [(f"`{name}`", *about) for name, about in (INPUTS if locked else FILES).items()]
    values = [("air", 0), *labels.items()]
    return [
        "## Files",
        f"Each patient has a folder; `{CHECKSUMS}` holds the checksum of every file (`sha256sum -c {CHECKSUMS}`).",
        markdown_table(("file", "format", "units and frame", "content", "for"), files),
        *([HIDDEN] if locked else []),
        "`truth.h5` is for evaluation only: a method that reads it, in training or prediction, is not comparable.",
        f"Values of `segmentation.nii.gz`: {', '.join(f'{value} {name}' for name, value in values)}.",
    ]
