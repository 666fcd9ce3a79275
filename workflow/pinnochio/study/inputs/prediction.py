"""What the rules of prediction ask: the held-out patients of a fold, or the plans of a new patient."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.methods.registry import GRAPH_NETWORK, registry
from pinnochio.patients.model_archive import FALLBACK
from pinnochio.study.inputs.gathered import GatheredInputs
from pinnochio.study.study import Study, filled

TRAINED = {"no": "", "at once": "fitted.h5", "by steps": "network.pt"}  # what training leaves


@dataclass(frozen=True)
class Batch:
    """What is predicted and judged in one job: cases, what it reads of the settings, and its files.

    scanned: the cases that can be judged; folders: where models, scans, what is judged, and lifts and covariates of a
    method that reads them, are gathered; truths and executed are files of the virtual truth, for a bound that is it.
    """

    cases: list[str]
    scanned: list[str]
    settings: dict
    folders: dict[str, list[str]]
    trained: list[str]
    truths: list[str]
    executed: list[str]


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

    def gathered(self, wildcards) -> dict[str, list[str]]:
        """Input function: the files of the job's batch."""
        batch = self._batch_of(wildcards)
        return batch.folders | {name: getattr(batch, name) for name in ("trained", "truths", "executed")}

    def batch(self, batch: str, method: str) -> Batch:
        """A batch, folds/N or planned/N, as the method predicts it."""
        key = batch, method
        if key not in self._batches:
            self._batches[key] = self._held_out(batch.split("/")[1], method)
        return self._batches[key]

    def _held_out(self, fold: str, name: str) -> Batch:
        study, method = self.study, self.study.methods[name]
        cases, trained, virtual = study.folds.kept_from(fold), TRAINED[method.trains], "<results>/virtual/{case}"
        kinds = {"models": "lips" if method.mesh == "lips" else "model", "scans": "scan", "judged": "judged"}
        kinds |= {} if method.lift == "none" else {"lifts": "lift"}
        kinds |= {"covariates": "covariates"} if method.covariates else {}
        return Batch(
            cases=cases,
            scanned=study.folds.judged(fold),
            settings=predicting(method.settings),
            folders={name: GatheredInputs(study).held_out(fold, kind) for name, kind in kinds.items()},
            trained=[f"<results>/folds/{fold}/{name}/{trained}"] if trained else [],
            truths=filled(f"{virtual}/truth.h5", cases) if method.truth == "field" else [],
            executed=filled(f"{virtual}/executed.json", cases) if method.truth == "motion" else [],
        )

    def of_ensemble(self, name: str) -> Callable:
        """Input or params function: one entry of :meth:`ensemble`."""
        return lambda wildcards: getattr(self.ensemble(wildcards), name)

    def others(self, wildcards) -> dict:
        """Predictor and settings, by name, of what stands in for networks and what predict.seconds chooses among."""
        known = registry(self.study.patient(wildcards).config)
        pairs = ((name, known[name]) for name in ("elastic", FALLBACK))
        return {name: {"predictor": one.predictor, "settings": predicting(one.settings)} for name, one in pairs}

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
        method, folds = self.study.methods[wildcards.method], list(self.study.folds.held_out)
        return Ensemble(
            folds=folds,
            networks=[f"<results>/folds/{fold}/{wildcards.method}/network.pt" for fold in folds],
            lifts=[] if method.lift == "none" else [f"{patient.folder}/lift_{method.lift}.h5"],
            covariates=[f"{patient.folder}/covariates.json"] if method.covariates else [],
            settings=predicting(method.settings),
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
