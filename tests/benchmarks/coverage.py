"""Whether the intervals of the models that come along hold on patients whom they never saw.

python tests/benchmarks/coverage.py RESULTS [RESULTS ...]

RESULTS: a folder of `snakemake inputs`, of virtual patients of another seed, or unlike the training. Those finished are
predicted by networks and finite elements into RESULTS/coverage, from the motion that surgery achieved and from the
plan. Printed by method, and as `make predict` ships them: patients shipped, and within the training; error, mm;
verdicts; % of points and measures within half-widths.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

sys.path.extend(str(Path(__file__).parents[2] / folder) for folder in ("", "workflow"))

from pinnochio.json_text import read_stored_json
from pinnochio.mechanics.settings import FemSettings
from pinnochio.methods.registry import GRAPH_NETWORK, registry
from pinnochio.metrics.judged import Judged
from pinnochio.model.measures import MEASURES
from pinnochio.model.patient import PatientModel
from pinnochio.model.postop import PostopSkin
from pinnochio.model.regions import NAMES
from pinnochio.model.truth import TrueMotion
from pinnochio.patients.face_measures import FaceMeasures
from pinnochio.patients.in_distribution import out_of_range, widening
from pinnochio.patients.model_archive import FALLBACK, RANGES, calibration_file
from pinnochio.statistics.conformal import ALL, FACE, held_out, measures_held_out
from pinnochio.statistics.intervals import Calibration, Interval
from pinnochio.study.choice import choose
from pinnochio.study.study import SHIPPED
from scripts.patients.certify import certify
from scripts.patients.predict_plan import compare, torn
from scripts.prediction.predict import predict
from scripts.prediction.predict_interval import predict_interval
from tests.helpers.settings import DEFAULT

CHOICE, BY = choose(DEFAULT, SHIPPED), ["results", "motion", "method"]
SKIN, READ = [*NAMES, FACE], [*MEASURES, ALL]
FEM, SOLVED = FemSettings(**CHOICE.settings["fem"]), registry(DEFAULT | CHOICE.settings)[FALLBACK]
LEARNED = {"predictor": GRAPH_NETWORK.predictor, "names": CHOICE.archive.folds, "trained": CHOICE.networks}
LEARNED |= {"settings": {"fem": CHOICE.settings["fem"], "newton_corrections": CHOICE.corrections}}
SOLVED = {"predictor": SOLVED.predictor, "names": [FALLBACK], "trained": [], "settings": SOLVED.settings}
ALIKE = {"covariates": [], "truths": [], "device": "cpu", "threads": 1, "warm": False}


def judged(folder: Path, made: Path) -> pd.DataFrame:
    """A patient's error and % covered by motion, method, and region or measure; as scripts/patients/predict_plan.py."""
    case, kept, parts, patient = folder.name, False, [], PatientModel.read(model := folder / "model.h5")
    scan, samples = PostopSkin.read(folder / "postop.h5"), Judged.read(folder / "judged.h5")
    truth, lifts = TrueMotion.read(folder / "true_motion.h5", patient, case), [folder / f"lift_{CHOICE.lift}.h5"]
    for motion, method in ((motion, method) for motion in ("achieved", "plan") for method in (CHOICE.method, FALLBACK)):
        each, result, said = (made / f"{motion}_{method}{end}" for end in ("_each.h5", ".h5", ".json"))
        read = {"cases": [case], "models": [model], "plans": [[plan := folder / f"{motion}.json"]], "lifts": lifts}
        predict(**read, **ALIKE, **(SOLVED if method == FALLBACK else LEARNED), predictions=[each])
        compared = compare(case, model, plan, quality := folder / "quality.json", SHIPPED / RANGES)
        kept = not kept if method == FALLBACK else not out_of_range(compared) and not torn(case, each, model, plan)
        calibration = SHIPPED / calibration_file(method)
        predict_interval(case, model, each, calibration, widening(compared), FEM, result)
        about = {"case": case, "method": method} | ({"instead_of": CHOICE.method} if method == FALLBACK else {})
        certify(about, model, plan, quality, result, FEM, SHIPPED, compared, said)
        said = read_stored_json(said)
        row = {"motion": motion, "method": method, "shipped": kept, "within": compared["within"]}
        row["verdict"] = said["verdict"]["grade"]
        interval, calibration = Interval.read(result), Calibration.read(calibration)
        field, known = interval.displacement, np.flatnonzero(np.isfinite(interval.half_width))
        skin = held_out(case, "", patient, samples, patient.moved_skin(field), *scan.surface)
        near = known[cKDTree(patient.skin_points[known]).query(samples.skin[samples.skin_region >= 0])[1]]
        read = measures_held_out(case, "", patient, field, scan, truth)
        wide = np.array([one.half_width for one in FaceMeasures(patient).rows(field, interval, calibration)])
        for held, width, names in ((skin, interval.half_width[near], SKIN), (read, wide[read.region], READ)):
            part = pd.DataFrame({"error": held.error, "covered": 100.0 * (held.error <= width)})
            part = pd.concat([part.groupby(held.region).mean(), part.mean().to_frame(len(names) - 1).T])
            parts.append(part.assign(region=np.array(names)[part.index], **row))
    return pd.concat(parts).assign(results=folder.parents[1].name, case=case)


def main() -> None:
    frames = []
    for folder in sorted(file.parent for path in sys.argv[1:] for file in Path(path).glob("cases/*/judged.h5")):
        (made := folder.parents[1] / "coverage" / folder.name).mkdir(parents=True, exist_ok=True)
        if not (table := made / "rows.csv").is_file():
            judged(folder, made).to_csv(table, index=False)
        frames.append(pd.read_csv(table))
    frame = pd.concat(frames)
    frame = pd.concat([frame, frame[frame["shipped"]].assign(method="shipped")], ignore_index=True)
    cells, face = frame.groupby([*BY, "region"])["covered"], frame[frame["region"] == FACE].groupby(BY)
    cells = cells.agg(lambda part: f"{part.mean():.1f} ± {part.sem():.1f}").unstack()
    whole = face.agg(shipped=("shipped", "sum"), within=("within", "sum"), mm=("error", "mean")).round(2)
    print(whole.join(face["verdict"].value_counts().unstack(fill_value=0)).join(cells.filter([*SKIN, ALL])).to_string())


if __name__ == "__main__":
    main()
