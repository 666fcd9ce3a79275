"""What the rules of prediction ask: the held-out patients of a fold, or the plans of a new patient."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.methods.registry import GRAPH_NETWORK, registry
from pinnochio.patients.model_archive import FALLBACK
from pinnochio.study.study import STUDY_FILES, Study, filled

TRAINED = {"no": "", "at once": "fitted.h5", "by steps": "network.pt"}  # what training leaves


@dataclass(frozen=True)
class Batch:
    """What is predicted and judged in one job: cases with their files, the trained file, and what it reads of the
    settings.

    truths are the files of the virtual truth, for a bound that is it; scanned: the cases that can be judged, postops
    and judged their files; motions: true ones at the points of the models, where they are known.
    """

    cases: list[str]
    models: list[str]
    plans: list[str]
    settings: dict
    truths: list[str]
    lifts: list[str]
    covariates: list[str]
    trained: list[str]
    scanned: list[str]
    postops: list[str]
    judged: list[str]
    motions: list[str]


@dataclass(frozen=True)
class Ensemble:
    """The networks that predict a patient together, and what they read."""

    folds: list[str]
    networks: list[str]
    lifts: list[str]
    covariates: list[str]
    settings: dict


@dataclass(frozen=True)
class PredictionInputs:
    study: Study
    _batches: dict[tuple[str, str], Batch] = field(default_factory=dict)  # once they have been asked for

    def predictor(self, wildcards) -> str:
        """Reference of the predictor of the job's method; one that an archive alone knows is a graph network."""
        return self.study.methods.registry.get(wildcards.method, GRAPH_NETWORK).predictor

    def held_out(self, wildcards) -> list[str]:
        return self.study.folds.kept_from(wildcards.fold)

    def of_held_out(self, pattern: str) -> Callable:
        """`pattern` for each held-out case of the fold."""
        return lambda wildcards: filled(pattern, self.held_out(wildcards))

    def external_files(self, wildcards) -> list[str]:
        """The files in which an external method delivers the held-out cases of the fold."""
        folder = self.study.config["external"][wildcards.method]
        return [external_file(folder, case) for case in self.held_out(wildcards)]

    def of_batch(self, name: str) -> Callable:
        """Input or params function: one entry of the job's batch."""
        return lambda wildcards: getattr(self._batch_of(wildcards), name)

    def _batch_of(self, wildcards) -> Batch:
        """A job that names a fold alone predicts from both motions, first from that of `folds`."""
        batch = wildcards.batch if hasattr(wildcards, "batch") else f"folds/{wildcards.fold}"
        return self.batch(batch, wildcards.method)

    def of_one(self, wildcards) -> dict[str, str | list[str]]:
        """Input function: the files of the job's batch."""
        batch = vars(self._batch_of(wildcards))
        return {name: files for name, files in batch.items() if name not in ("cases", "scanned", "settings")}

    def of_both(self, wildcards) -> dict[str, str | list[str]]:
        """Input function: the same with the plans that the fold is predicted from besides."""
        planned = self.batch(f"planned/{wildcards.fold}", wildcards.method)
        return self.of_one(wildcards) | {"planned": planned.plans}

    def batch(self, batch: str, method: str) -> Batch:
        """A batch, folds/N or planned/N, as the method predicts it."""
        key = batch, method
        if key not in self._batches:
            self._batches[key] = self._held_out(batch, batch.split("/")[1], method)
        return self._batches[key]

    def _held_out(self, batch: str, fold: str, name: str) -> Batch:
        study, method = self.study, self.study.methods[name]
        cases, trained, scanned = study.folds.kept_from(fold), TRAINED[method.trains], study.folds.judged(fold)
        virtual = study.cohort.virtual
        return Batch(
            cases=cases,
            models=[study.model_of(case, name) for case in cases],
            plans=[study.motion_of(case, name, batch) for case in cases],
            settings=predicting(method.settings),
            truths=filled("<results>/virtual/{case}/truth.h5", cases) if method.truth == "field" else [],
            lifts=study.lifts(name, cases),
            covariates=study.covariates(name, cases),
            trained=[f"<results>/folds/{fold}/{name}/{trained}"] if trained else [],
            scanned=scanned,
            postops=filled(f"{STUDY_FILES}/postop.h5", scanned),
            judged=filled(f"{STUDY_FILES}/judged.h5", scanned),
            motions=[study.model_of(case, name, "true_motion.h5") for case in cases] if virtual else [],
        )

    def of_ensemble(self, name: str) -> Callable:
        """Input or params function: one entry of :meth:`ensemble`."""
        return lambda wildcards: getattr(self.ensemble(wildcards), name)

    def fallback(self, wildcards) -> dict:
        """Predictor and settings of what stands in for networks."""
        other = registry(self.study.patient(wildcards).config)[FALLBACK]
        return {"predictor": other.predictor, "settings": predicting(other.settings)}

    def ensemble(self, wildcards) -> Ensemble:
        """Of every fold of the study, or of the archive that was chosen for the patient."""
        patient = self.study.patient(wildcards)
        if (choice := patient.choice) and not choice.archive:
            settings = predicting(registry(patient.config)[choice.method].settings)
            return Ensemble(folds=[], networks=[], lifts=[], covariates=[], settings=settings)
        if choice:
            return Ensemble(
                folds=choice.archive.folds,
                networks=choice.networks,
                lifts=[] if choice.lift == "none" else [f"{patient.folder}/lift_{choice.lift}.h5"],
                covariates=[f"{patient.folder}/covariates.json"],
                settings={"fem": choice.settings["fem"], "newton_corrections": choice.corrections},
            )
        study, method, folds = self.study, wildcards.method, list(self.study.folds.held_out)
        return Ensemble(
            folds=folds,
            networks=[f"<results>/folds/{fold}/{method}/network.pt" for fold in folds],
            lifts=study.lifts(method, [patient.name]),
            covariates=study.covariates(method, [patient.name]),
            settings=predicting(study.methods[method].settings),
        )


def predicting(settings: Mapping) -> dict:
    """What a prediction reads of a method's settings: a trained network knows its own form, and needs no training."""
    return {name: value for name, value in settings.items() if name not in ("network", "pretraining", "finetuning")}


def external_file(folder: str | os.PathLike, case: str) -> str:
    """The file in which a method made elsewhere delivers a case: {case}.npz, else {case}.vtu."""
    names = [f"{case}.npz", f"{case}.vtu"]
    for name in names:
        if (Path(folder) / name).is_file():
            return str(Path(folder) / name)
    raise InputError(
        case, folder, f"there is neither {names[0]} nor {names[1]}", "put the prediction of every case into the folder"
    )
