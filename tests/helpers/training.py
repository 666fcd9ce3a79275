"""Two phases of training on tiny patients, as a whole or stopped at a step."""

import signal
from dataclasses import asdict, replace
from pathlib import Path

import h5py
import pandas as pd
import torch

from pinnochio.methods.pinnochio.learner import GraphLearner
from pinnochio.methods.sources import SourceModel
from pinnochio.model.postop import PostopSkin
from pinnochio.networks.building import build
from pinnochio.training import loop
from pinnochio.training.case_files import CaseFiles
from pinnochio.training.checkpoint import save_network
from pinnochio.training.fold import train_fold
from pinnochio.training.settings import TrainingSettings
from scripts.prediction.predict import predict
from scripts.tables.evaluate import evaluate
from scripts.training.fit import fit
from tests.helpers.patients import tiny_patient, tiny_plan
from tests.helpers.settings import CONFIG, SEED, network_settings, training_settings

SMALL = network_settings(boundary_layers=1, volume_layers=1, rest_layers=1, channels=8, heads=2, decoder_width=8)
# One patient of four held back, everything on that a checkpoint has to carry.
TRAINING = training_settings(24, 3e-3, physics_ramp=0.2, validation=1, validate_every=4, checkpoint_every=5)
FEM = CONFIG["fem"]
PHASES = {"pretrain": ("pretrained.pt", "pretraining.csv"), "finetune": ("network.pt", "finetuning.csv")}


def save_case(folder: Path, seed: int, model, plans, fields, swelling: float) -> CaseFiles:
    """Files of a patient: a field of each plan, the first of which is its own, and a skin so many mm above that one."""
    paths = {name: folder / f"{name}_{seed}" for name in ("model", "fem_samples", "plan", "postop")}
    model.write(paths["model"])
    plans[0].write(paths["plan"])
    with h5py.File(paths["fem_samples"], "w") as file:
        for number, (plan, field) in enumerate(zip(plans, fields, strict=True)):
            file[f"plan_{number}/displacement"] = field
            file[f"plan_{number}"].attrs["plan"] = plan.to_json()
    PostopSkin(model.points + fields[0] + [0, 0, swelling], model.skin_faces, 0.0).write(paths["postop"])
    return CaseFiles(plans[0].case, **paths)


def make_cases(folder: Path, count: int = 4) -> list[CaseFiles]:
    """Files of tiny patients: the whole block follows the bone, more or less, and the skin swells by 1 mm."""
    cases = []
    for seed in range(count):
        model, plan = tiny_patient(seed, (5, 4, 3)), replace(tiny_plan(x=float(seed)), case=f"tiny{seed}")
        field = plan.motion("left").displacement(model.points) * (0.8, 0.9, 1.0)
        cases.append(save_case(folder, seed, model, [plan], [field], 1.0))
    return cases


def run(
    phase: str, cases: list[CaseFiles], folder: Path, training: TrainingSettings = TRAINING, code: str = "code"
) -> None:
    """Do a phase in `folder`; fine-tuning starts from the network that is there."""
    out, history = (folder / name for name in PHASES[phase])
    plain = dict.fromkeys(("pretraining", "finetuning"), asdict(training))
    learner = GraphLearner({"network": asdict(SMALL), "fem": FEM} | plain, phase, "cpu")
    start = None if phase == "pretrain" else folder / PHASES["pretrain"][0]
    train_fold(learner, phase, cases, start, seed=3, code=code, out=out, history=history)


def run_and_hang(phase: str, inputs: str, folder: str, threads: str, at: str) -> None:
    """What the child process does: a phase that goes to sleep for good in the step number `at`."""
    torch.set_num_threads(int(threads))
    sample_at = loop.sample_at

    def hanging(step, *rest):
        while step == int(at):
            signal.pause()
        return sample_at(step, *rest)

    loop.sample_at = hanging
    run(phase, make_cases(Path(inputs)), Path(folder))


def save_random(path: Path, settings, start: int = 0, size: float = 0.02, **more) -> str:
    """Write a network of random weights, by the seed `start`: as it is built it gives out next to nothing."""
    torch.manual_seed(start)
    network = build(settings)
    with torch.no_grad():
        for weights in network.parameters():
            weights += size * torch.randn_like(weights)
    save_network(path, network, settings, **more)
    return str(path)


def learn_loads(patients, fitted: str) -> SourceModel:
    """What sliding finite elements leave of the patients' faces, learned; written to `fitted`, too."""
    fit(
        learner="pinnochio.methods.fem_learned:fit",
        **{f"{name}s": [getattr(each, name) for each in patients] for name in ("case", "model", "plan", "postop")},
        fem_samples=[patient.fem_samples for patient in patients],
        covariates=[],
        settings={"fem": vars(patients[0].fem)},
        fitted=fitted,
    )
    return SourceModel.read(fitted)


def measured(patient, predictions: str, metrics: str, method: str = "some", **changes) -> pd.DataFrame:
    """The rows that a method gets on one patient, with changes of what is handed to the stage."""
    files = {
        "cases": [patient.case],
        "models": [patient.model],
        "plans": [[patient.plan]],
        "motions": [patient.true_motion],
    }
    scans = {"postops": {patient.case: patient.postop}, "judged": {patient.case: patient.judged}}
    labels = {"fold": "1", "method": method, "code": "0" * 12}
    about = {"predictions": [predictions], "fem": patient.fem, "labels": labels, "seed": SEED, "metrics": [metrics]}
    evaluate(**files | scans | about | changes)
    return pd.read_csv(metrics)


def predict_all(networks: dict[str, str], patient, ensemble: str, corrections: int = 0, plan=None, lift=None) -> None:
    """Write what the network of each fold predicts of a patient."""
    files = {"trained": list(networks.values()), "lifts": [lift] if lift else [], "covariates": []}
    settings = {"fem": CONFIG["fem"], "newton_corrections": corrections}
    predict_by("pinnochio.predictor:GraphPredictor", patient, ensemble, plan=plan, names=networks, **files, **settings)


def predict_by(
    predictor: str, patient, predictions: str, model=None, trained=(), plan=None, truths=(), lifts=(), covariates=None,
    names=(), **settings,
) -> None:  # fmt: skip
    """Write the predictions of a patient by the method of a module, on its model and plan or others; names: of folds,
    one for each file of `trained`."""
    predict(
        predictor=f"pinnochio.methods.{predictor}",
        settings=settings,
        trained=[trained] if isinstance(trained, str) else trained,
        names=list(names) or [patient.case],
        cases=[patient.case],
        models=[model or patient.model],
        lifts=lifts,
        plans=[[plan or patient.plan]],
        truths=truths,
        covariates=[patient.covariates] if covariates is None else covariates,
        device="cpu",
        threads=1,
        predictions=[predictions],
    )
