"""One study as its workflow asks for it: cases, folds, methods and the files that jobs read, from the configuration."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace

from pinnochio.code import ROOT
from pinnochio.errors import InputError
from pinnochio.importing.cohort import Case, read_cases
from pinnochio.manifest import MANIFEST
from pinnochio.methods.names import few
from pinnochio.methods.registry import GRAPH_NETWORK, Method, registry
from pinnochio.patients.model_archive import configuration_hash
from pinnochio.statistics.attainable import attainable
from pinnochio.study.cases import assign_folds, external_file, some, virtual_cases, whole_fold
from pinnochio.study.choice import Choice, choose
from pinnochio.study.new_patients import NewPatient, markups_in, read_patients
from pinnochio.study.provenance import PLACES
from pinnochio.training.network_archive import NetworkArchive
from pinnochio.training.settings import PHASES
from pinnochio.virtual.case_files import CHECKSUMS, FILES, INPUTS, LOCKED, OUTCOME_CHECKSUMS, OUTCOMES
from pinnochio.virtual.procedures import Procedure, dealt

STUDY_FILES = "<results>/cases/{case}"
PICTURED = 6  # methods side by side in a picture
SHIPPED = ROOT / "models"  # an archive that comes with the project


@dataclass(frozen=True)
class Study:
    """Everything that the configuration, its case table and the new patients that it names decide.

    Patterns begin with <results>/, which Snakemake fills in. `wildcards` of the functions below are those of a job:
    `home` is the folder of imported patients below the results: cases of the study or patients that are new, and
    `case` the name; `mesh` is empty, /lips or /nodes_N; `plan` is empty for the study's own plan, /NAME for one of a
    new patient; `batch` is what is predicted in one job: folds/N, planned/N (the same patients from their plans) or
    patients/NAME/PLAN; `arm` is folds or planned.
    """

    config: Mapping
    results: str

    @cached_property
    def virtual(self) -> bool:
        return self.config["cohort"] == "virtual"

    @property
    def cohort(self) -> str:
        """What tables call the cohort: of a virtual one whether settings are chosen on it."""
        role = self.config["virtual"]["role"]
        return f"virtual cohort ({role})" if self.virtual else Path(self.config["cohort"]).stem

    @property
    def locked(self) -> bool:
        """Whether the cohort is a virtual one whose outcomes are kept apart."""
        return self.virtual and self.config["virtual"]["role"] == LOCKED

    @cached_property
    def cases(self) -> dict[str, Case]:
        """The patients of the cohort by name."""
        if self.virtual:
            own = self.config["virtual"]
            cases = virtual_cases(own["patients"], f"{self.results}/virtual", own["without"])
        else:
            cases = read_cases(self.config["cohort"])
        return {case.name: case for case in cases}

    @cached_property
    def scanned(self) -> list[str]:
        """Patients with a post-operative scan; every patient is predicted, but only these train and judge."""
        return [name for name, case in self.cases.items() if case.postop]

    @cached_property
    def unscanned(self) -> list[str]:
        return [name for name, case in self.cases.items() if not case.postop]

    @cached_property
    def held_out(self) -> dict[str, list[str]]:
        """Held-out patients of each fold."""
        return assign_folds(self.scanned, self.unscanned, self.config["folds"], self.config["seed"])

    @cached_property
    def registered(self) -> list[str]:
        """Patients whose segments are registered on post-operative bones: their achieved motion is known."""
        return [name for name, case in self.cases.items() if case.postop_bones]

    def motion_of(self, case: str, method: str = "", batch: str = "") -> str:
        """The file of the motion that the method's prediction of the study's patient takes, and training with it.

        The achieved motion where it is known and the configuration does not ask for the plan; in the batches `planned`
        the plan; the true one for a bound that reads it.
        """
        if method in self.bounds and self.registry[method].truth == "motion":
            return f"<results>/virtual/{case}/executed.json"
        achieved = self.config["motion"] == "achieved" and case in self.registered and not batch.startswith("planned")
        return f"<results>/cases/{case}/{'achieved' if achieved else 'plan'}.json"

    @property
    def both_motions(self) -> list[str]:
        """Patients with a scan that are predicted from the achieved motion and from the plan."""
        return [name for name in self.scanned if self.motion_of(name) != self.motion_of(name, batch="planned")]

    @property
    def planned(self) -> list[str]:
        """Methods that are also predicted from the plan; those made elsewhere predict once."""
        without = self.config["planned"]["without"]
        names = [name for name in self.compared if self.registry[name].predictor and name not in without]
        return names if self.both_motions else []

    def fold_of(self, case: str) -> str:
        """The fold that holds the case out."""
        return next(fold for fold, cases in self.held_out.items() if case in cases)

    def kept_from(self, fold: str) -> list[str]:
        """Patients that the fold, or one of the learning curve, holds out."""
        return self.held_out[whole_fold(fold)[0]]

    def training(self, fold: str) -> list[str]:
        """Patients that the fold trains on."""
        names, (own, patients) = [name for name in self.scanned if name not in self.kept_from(fold)], whole_fold(fold)
        return names if patients is None else some(names, patients, self.config["seed"], own)

    def judged(self, fold: str) -> list[str]:
        """Held-out patients of the fold that have a scan."""
        return [name for name in self.kept_from(fold) if name in self.scanned]

    @cached_property
    def registry(self) -> dict[str, Method]:
        """Every method that the configuration knows."""
        return registry(self.config)

    @property
    def untrained(self) -> list[str]:
        """Named methods that train, where fewer patients have a scan than there are folds to train in turn."""
        few = len(self.scanned) < self.config["folds"]
        return [name for name in self.config["methods"] if few and self.registry[name].trains != "no"]

    @property
    def unbounded(self) -> list[str]:
        """Named bounds, where the truth is not known."""
        return [name for name in self.config["methods"] if not self.virtual and self.registry[name].bound]

    @cached_property
    def left_out(self) -> list[str]:
        """Named methods that this cohort cannot have; InputError where none would be left."""
        names = [*self.untrained, *self.unbounded]
        if len(names) == len(self.config["methods"]) and not self.config["external"]:
            raise InputError(
                "-",
                "configuration",
                f"none of 'methods' is left: {len(self.scanned)} scanned patients do not fill {self.config['folds']} "
                "folds to train on, and bounds need the virtual truth",
                "add a method that needs no training, or lower 'folds'",
            )
        return names

    @cached_property
    def methods(self) -> list[str]:
        """What predicts the cohort, bounds among it, in the order of the configuration."""
        return [name for name in [*self.config["methods"], *self.config["external"]] if name not in self.left_out]

    @cached_property
    def bounds(self) -> list[str]:
        """The bounds among them, which no method is tested against."""
        return [name for name in self.methods if self.registry[name].bound]

    @cached_property
    def compared(self) -> list[str]:
        """The methods proper among them."""
        return [name for name in self.methods if name not in self.bounds]

    def of_family(self, *families: str) -> list[str]:
        """Known methods of the families."""
        return [name for name, method in self.registry.items() if method.family in families]

    def trained(self, how: str) -> list[str]:
        """Known methods that train so: "at once" or "by steps"."""
        return [name for name, method in self.registry.items() if method.trains == how]

    @property
    def pretrained_first(self) -> list[str]:
        """Known methods that the study pretrains on finite-element samples."""
        return [name for name in self.trained_here if "pretraining" in self.registry[name].settings]

    @property
    def predicting(self) -> list[str]:
        """Known methods that the project itself predicts by."""
        return [name for name, method in self.registry.items() if method.predictor]

    @cached_property
    def learned(self) -> list[str]:
        """Methods of the study that are trained by steps."""
        return [name for name in self.methods if self.registry[name].trains == "by steps"]

    @cached_property
    def archive_of_networks(self) -> NetworkArchive | None:
        """The archive that networks are taken from, if the configuration says so; InputError where it is no archive of
        networks that were trained on this cohort and these folds."""
        if self.config["networks"] == "train":
            return None
        folder = self.config["networks_archive"]
        archive = NetworkArchive.read(folder)
        archive.refuse_others(folder, self.config, self.held_out)
        return archive

    @cached_property
    def taken(self) -> list[str]:
        """Methods whose networks are taken from the archive, which may not hold all."""
        own = self.archive_of_networks.methods if self.archive_of_networks else ()
        return [name for name in self.trained("by steps") if name in own]

    @property
    def trained_here(self) -> list[str]:
        """Known methods that the study trains by steps itself."""
        return [name for name in self.trained("by steps") if name not in self.taken]

    def phases(self, method: str) -> dict[str, Mapping | None]:
        """Settings of each phase that the method's networks are trained in, or were, where they are taken."""
        settings = self.registry[method].settings
        if method in self.taken:
            settings = self.archive_of_networks.methods[method]
        return {phase: settings.get(phase) for phase in PHASES.values()}

    def of_archive(self, *names: str) -> Callable:
        """Params function: the archive's names of these files of the job's network."""
        return lambda wildcards: [f"{wildcards.fold}/{wildcards.method}/{name}" for name in names]

    def manifest_of_networks(self, wildcards) -> str:
        """The manifest of that archive."""
        return f"{self.config['networks_archive']}/{MANIFEST}"

    @property
    def histories(self) -> list[str]:
        """The loss histories of the study's networks: of each method, phase by phase, fold by fold."""
        return [
            f"<results>/folds/{fold}/{method}/{phase}.csv"
            for method in self.learned
            for phase, settings in self.phases(method).items()
            if settings
            for fold in self.held_out
        ]

    def asked(self, section: str) -> list[str]:
        """Methods that a section of the configuration names and that the study trains."""
        return [name for name in self.config[section]["methods"] if name in self.learned]

    @property
    def covered(self) -> list[str]:
        """Methods whose interval is calibrated."""
        return [name for name in self.compared if name in self.config["uncertainty"]["methods"]]

    @property
    def reference(self) -> str | None:
        """The method that tables test the others against."""
        return self.config["reference"] if self.config["reference"] in self.methods else None

    @property
    def better(self) -> bool:
        """Whether the better network is there to be compared with, by patients enough for a test to say something."""
        return self.config["better"] in self.methods and attainable(len(self.scanned), len(self.compared) - 1)

    @property
    def ablated(self) -> bool:
        """Whether the ablation has all of its variants."""
        names = self.config["ablation"]
        return bool(self.scanned and names) and set(names) <= set(self.learned)

    @cached_property
    def packed(self) -> list[str]:
        """What is packed for new patients: every method with an interval, and the one that shall predict them."""
        names = dict.fromkeys([*self.config["uncertainty"]["methods"], self.config["predict"]["method"]])
        return [name for name in names if name in self.of_family("graph network") and name in self.learned]

    @property
    def packed_intervals(self) -> list[str]:
        """Methods whose calibration is packed: those above, and finite elements, whose faces answer wishes."""
        return [*self.packed, *(name for name in self.covered if name == "fem_sliding")]

    @property
    def shown(self) -> list[str]:
        """Patients in the report."""
        return self.scanned[: self.config["report"]["patients"]]

    @property
    def pictured(self) -> list[str]:
        """Methods that the picture of a patient shows."""
        return few(self.compared, PICTURED)

    @property
    def volumes(self) -> list[str]:
        """Networks whose volume the report shows: with and without physics, and the better one."""
        names = dict.fromkeys([*self.config["ablation"], self.config["better"]])
        return [name for name in names if name in self.learned]

    @property
    def tables(self) -> list[str]:
        """Tables of what is measured of the methods."""
        return [
            "cases",
            *(["accuracy", "regions"] if self.scanned else []),
            *(["better"] if self.better else []),
            *(["planned"] if self.planned else []),
            *(["landmarks"] if self.scanned and self.virtual else []),
            *(["ablation"] if self.ablated else []),
            *(["claims"] if self.scanned and "pinnochio" in self.methods else []),
            *(["segments"] if self.registered else []),
        ]

    @property
    def costs(self) -> list[str]:
        """Tables of what the study costs."""
        return ["stages", *(["training"] if self.learned else [])]

    @property
    def card_tables(self) -> list[str]:
        """Tables of the data card; the effects are measured on as many patients as the configuration says. A locked
        cohort's say nothing of its outcomes."""
        if self.locked:
            return ["thickness"]
        return ["thickness", "ratios", *(["nasolabial", "effects"] if self.config["virtual"]["effects"] else [])]

    @cached_property
    def procedures(self) -> dict[str, Procedure]:
        """The operation of each virtual patient as they are drawn, those that are not made included."""
        own = self.config["virtual"]
        names = [case.name for case in virtual_cases(own["patients"], "")]
        return dict(zip(names, dealt(own["procedures"], len(names)), strict=True))

    def virtual_files(self, *names: str) -> list[str]:
        """These files of every virtual patient."""
        return [f"<results>/virtual/{case}/{name}" for case in self.cases for name in names]

    def summed_up(self, wildcards) -> list[str]:
        """The files of the virtual cohort that a file of checksums holds: of a locked one its outcomes apart."""
        if not self.locked:
            return self.virtual_files(*FILES)
        return self.virtual_files(*(OUTCOMES if wildcards.sums == OUTCOME_CHECKSUMS else INPUTS))

    @property
    def sums(self) -> list[str]:
        """The files of checksums that are made; of a locked cohort's outcomes where they have been revealed."""
        revealed = self.locked and Path(self.results, "virtual", OUTCOME_CHECKSUMS).is_file()
        return [CHECKSUMS, *([OUTCOME_CHECKSUMS] if revealed else [])]

    @property
    def first_fold(self) -> str:
        return next(iter(self.held_out))

    # New patients.

    @cached_property
    def patients(self) -> dict[str, NewPatient]:
        """The new patients that the configuration names."""
        return read_patients(self.config["patient"]) if self.config["patient"] else {}

    @cached_property
    def plans(self) -> list[str]:
        """Names of the new patients' plans."""
        return sorted({plan for patient in self.patients.values() for plan in patient.plans})

    @cached_property
    def choice(self) -> Choice | None:
        """What predicts the new patients: read from the archive that the configuration names, for them alone."""
        if not self.patients:
            return None
        front = self.config["predict"]["pareto_front"] or f"{self.results}/tables/tradeoff.csv"
        return choose(self.config, self.models, front)

    @property
    def models(self) -> str:
        """The archive that predicts new patients: the one that is named, else the study's, else the project's own."""
        own = f"{self.results}/archive"
        shipped = (SHIPPED / MANIFEST).is_file() and not Path(own, MANIFEST).is_file()
        return self.config["models"] or (str(SHIPPED) if shipped else own)

    @property
    def configuration(self) -> str:
        """Hash of what decides about the models, not of where files lie and who is predicted."""
        return configuration_hash({name: own for name, own in self.config.items() if name not in PLACES})

    def archived(self, wildcards) -> list[str]:
        """The archive of the study, where it trains what is to be packed."""
        if not self.packed:
            raise InputError(
                "-",
                "configuration",
                "no method of uncertainty.methods and predict.method is trained here",
                "add one to 'methods', with a scan of at least one patient per fold",
            )
        return ["<results>/archive/archive.json"]

    def named_patients(self) -> list[NewPatient]:
        """The new patients; InputError where none is named."""
        if not self.patients:
            raise InputError("-", "configuration", "no new patient is named", "add --config patient=FOLDER")
        return list(self.patients.values())

    def results_of_patients(self, wildcards) -> list[str]:
        """What is handed over of every new patient and plan."""
        for patient in self.named_patients():
            if not patient.plans:
                raise InputError(
                    patient.name,
                    patient.home,
                    "there is no plan",
                    "add plan.json, or plans/NAME.json for several, or make one with the planner (make planner)",
                )
        return [
            f"<results>/patients/{patient.name}/{plan}/{self.choice.method}/{name}"
            for patient in self.patients.values()
            for plan in patient.plans
            for name in ("certificate.json", "index.html", "deformed.vtu")
        ] + [
            f"<results>/patients/{patient.name}/{name}"
            for patient in self.patients.values()
            for name in ["segments.png", *([f"plans_{self.choice.method}.html"] if len(patient.plans) > 1 else [])]
        ]

    def planners_of_patients(self, wildcards) -> list[str]:
        """What the planner needs of every new patient."""
        files = [f"<results>/patients/{patient.name}/planner.json" for patient in self.named_patients()]
        if not self.choice.archive:
            raise InputError(
                "-",
                "configuration",
                f"the planner shows the interval of a trained method, and {self.choice.method} has none",
                "leave predict.method, budget_seconds and tolerance_mm as they are, or name a method of the archive",
            )
        return files

    def proposals_of_patients(self, wildcards) -> list[str]:
        """What is handed over of every new patient of whom a face is wished."""
        wished = [patient.name for patient in self.named_patients() if patient.wishes]
        if not wished:
            raise InputError(
                "-", self.config["patient"], "nobody's face is wished otherwise", "add wish.mrk.json or wish.ply"
            )
        files = ("invert/index.html", "sensitivity.png")
        return [f"<results>/patients/{name}/{file}" for name in wished for file in files]

    def planner_settings(self, wildcards) -> dict:
        """What the planner needs to know of the patient and its models."""
        choice = self.choice
        return {
            "home": self.patients[wildcards.case].home,
            "archive": choice.folder,
            "method": choice.method,
            "corrections": choice.corrections,
            "fem": choice.settings["fem"],
            "invert": self.config["invert"],
        }

    @property
    def wildcards(self) -> dict[str, str]:
        """What each wildcard of the rules may be; where there is nothing, a name that nothing bears."""
        plans = "|".join(self.plans) or "none"
        folds = rf"(?:{'|'.join(self.held_out)})(?:of\d+)?"
        return {
            "home": "cases|patients",
            "case": "|".join([*self.cases, *self.patients]),
            "mesh": r"|/lips|/nodes_\d+",
            "plan": f"|/(?:{plans})",
            "fold": folds,
            "arm": "folds|planned",
            "batch": f"(?:folds|planned)/(?:{folds})|patients/(?:{'|'.join(self.patients) or 'none'})/(?:{plans})",
            "nodes": r"\d+",
            "method": "|".join([*self.registry, self.config["predict"]["method"]]),
        }

    # A patient's files.

    def config_of(self, home: str) -> Mapping:
        """The configuration that patients are made with: new ones with the settings that their models were trained
        with."""
        return {**self.config, **self.choice.settings} if home == "patients" else self.config

    def of_patient(self, *keys: str) -> Callable:
        """Params function: a value of the patient's configuration."""

        def value(wildcards):
            section = self.config_of(wildcards.home)
            for key in keys:
                section = section[key]
            return section

        return value

    def nodes(self, wildcards) -> int:
        """Nodes of the mesh."""
        own = wildcards.mesh.removeprefix("/nodes_")
        return int(own) if own else self.config_of(wildcards.home)["mesh"]["nodes"]

    def sized(self, nodes: int, file: str) -> str:
        """A file of the patient on the mesh of so many nodes."""
        own = "" if nodes == self.config["mesh"]["nodes"] else f"/nodes_{nodes}"
        return f"{STUDY_FILES}{own}/{file}"

    def segmentation(self, wildcards) -> str:
        return (self.patients if wildcards.home == "patients" else self.cases)[wildcards.case].segmentation

    def volume(self, wildcards) -> str | list:
        """The scan that the segmentation was made of, where there is one."""
        return (self.patients if wildcards.home == "patients" else self.cases)[wildcards.case].volume or []

    def markups(self, wildcards) -> list[str]:
        """The files of the patient's markups: landmarks, planes, regions."""
        own = (self.patients if wildcards.home == "patients" else self.cases)[wildcards.case].markups
        if own and Path(own).is_dir():
            return markups_in(own)
        return [own] if own else []

    def wish(self, wildcards) -> list[str]:
        """The files that say how the patient's face shall be."""
        return list(self.patients[wildcards.case].wishes)

    def occlusion(self, wildcards) -> list[str]:
        """The plan of a new patient whose relation of the jaws every proposal keeps, if there is one."""
        name = self.config["invert"]["occlusion"]
        if name in ("free", "rest"):
            return []
        plans = self.patients[wildcards.case].plans
        if name not in plans:
            known = ", ".join(plans) or "none"
            raise InputError(
                wildcards.case,
                "configuration",
                f"invert.occlusion names the plan {name!r}, and the patient's plans are: {known}",
                "name one of them, or 'rest' for the occlusion as it is, or 'free'",
            )
        return [f"<results>/patients/{wildcards.case}/{name}/plan.json"]

    def calibration_of_wishes(self, wildcards) -> list[str]:
        """The calibration of the intervals of finite elements: a plain file of the archive or the study, if there."""
        folders = [self.choice.folder, f"{self.results}/methods"] if self.choice.folder else [f"{self.results}/methods"]
        files = [Path(folder, "fem_sliding", "calibration.json").resolve() for folder in folders]
        return [str(file) for file in files if file.is_file()][:1]

    @property
    def label_values(self) -> Mapping:
        """Voxel values by structure, of which a preset has none of its own."""
        return {} if isinstance(self.config["labels"], str) else self.config["labels"]

    def plan(self, wildcards) -> str:
        """The plan as the user, or the virtual cohort, brings it."""
        if wildcards.home == "patients":
            return self.patients[wildcards.case].plans[wildcards.plan[1:]]
        return self.cases[wildcards.case].plan

    def postop(self, wildcards) -> str:
        case = self.cases[wildcards.case]
        if not case.postop:
            raise InputError(
                case.name,
                self.config["cohort"],
                "there is no post-operative scan",
                "ask for fem/mucosa.png, or give a scan",
            )
        return case.postop

    def postop_bones(self, wildcards) -> str:
        case = self.cases[wildcards.case]
        if not case.postop_bones:
            raise InputError(case.name, self.config["cohort"], "there are no post-operative bones", "give them")
        return case.postop_bones

    def covariates(self, wildcards) -> dict | None:
        """What is said of the patient beside the files; None where a file says it."""
        if wildcards.home == "patients":
            return dict(self.patients[wildcards.case].covariates)
        case = self.cases[wildcards.case]
        return None if case.covariates_file else dict(case.covariates)

    def covariates_file(self, wildcards) -> str | list:
        """The file that says it instead, as the virtual cohort brings it."""
        return [] if wildcards.home == "patients" else self.cases[wildcards.case].covariates_file or []

    @property
    def described(self) -> list[str]:
        """Patients of whom covariates are known."""
        return [name for name, case in self.cases.items() if case.covariates or case.covariates_file]

    def checked(self, wildcards) -> str:
        """The table that says that every file of the cohort, or of the new patient, has been read and checked."""
        return (
            f"<results>/patients/{wildcards.case}/imported.csv"
            if wildcards.home == "patients"
            else "<results>/cohort.csv"
        )

    def plans_of_patient(self, wildcards) -> list[str]:
        """The checked plans of a new patient."""
        return [f"<results>/patients/{wildcards.case}/{plan}/plan.json" for plan in self.patients[wildcards.case].plans]

    def model_of(self, case: str, method: str, file: str = "model.h5") -> str:
        """The model of the study's patient that the method predicts on, or another file of the same mesh."""
        return f"<results>/cases/{case}{'/lips' if self.registry[method].mesh == 'lips' else ''}/{file}"

    # Input functions of training and prediction.

    def of_training(self, pattern: str) -> Callable:
        """`pattern` for each training case of the fold, which no held-out case is."""
        return lambda wildcards: filled(pattern, self.training(wildcards.fold))

    def of_held_out(self, pattern: str) -> Callable:
        """`pattern` for each held-out case of the fold."""
        return lambda wildcards: filled(pattern, self.kept_from(wildcards.fold))

    def of_judged(self, pattern: str) -> Callable:
        """`pattern` for each held-out case of the fold that can be judged."""
        return lambda wildcards: filled(pattern, self.judged(wildcards.fold))

    def covariates_of_training(self, wildcards) -> list[str]:
        """What else is known of the training patients, for a method that reads it."""
        return self._covariates(wildcards.method, self.training(wildcards.fold))

    def _covariates(self, method: str, cases: Iterable[str]) -> list[str]:
        return filled(f"{STUDY_FILES}/covariates.json", cases) if self.registry[method].covariates else []

    def lifts_of_training(self, wildcards) -> list[str]:
        return self._lifts(wildcards.method, self.training(wildcards.fold))

    def predictor(self, wildcards) -> str:
        """Reference of the predictor of the job's method; one that an archive alone knows is a graph network."""
        return self.registry.get(wildcards.method, GRAPH_NETWORK).predictor

    def learner(self, wildcards) -> str:
        """Reference of the learner, or of the function `fit`, of the job's method."""
        return self.registry[wildcards.method].learner

    def settings(self, *names: str) -> Callable:
        """Params function: of the settings of the job's method those of the names."""
        return lambda wildcards: {
            name: own for name, own in self.registry[wildcards.method].settings.items() if name in names
        }

    def training_cases(self, wildcards) -> list[str]:
        return self.training(wildcards.fold)

    def held_out_cases(self, wildcards) -> list[str]:
        return self.kept_from(wildcards.fold)

    def judged_cases(self, wildcards) -> list[str]:
        return self.judged(wildcards.fold)

    def models_of_held_out(self, wildcards) -> list[str]:
        """The models that the method predicts the held-out cases of the fold on."""
        return [self.model_of(case, wildcards.method) for case in self.kept_from(wildcards.fold)]

    def truths_of_held_out(self, wildcards) -> list[str]:
        """The true motions at the points of these models."""
        cases = self.kept_from(wildcards.fold)
        return [self.model_of(case, wildcards.method, "true_motion.h5") for case in cases]

    def motions_of_held_out(self, wildcards) -> list[str]:
        """The motions that the method predicts the held-out cases of the fold with."""
        return [self.motion_of(case, wildcards.method, wildcards.arm) for case in self.kept_from(wildcards.fold)]

    def motions_of_training(self, wildcards) -> list[str]:
        """The motions that made the skins which the method trains on."""
        return [self.motion_of(case, wildcards.method) for case in self.training(wildcards.fold)]

    def motion(self, wildcards) -> str:
        """The motion that predictions of a patient take: of the study's own as everywhere, of a new one the plan."""
        if getattr(wildcards, "home", "cases") == "cases":
            return self.motion_of(wildcards.case, getattr(wildcards, "method", ""))
        return f"<results>/{wildcards.home}/{wildcards.case}{wildcards.plan}/plan.json"

    def _lifts(self, method: str, cases: Iterable[str]) -> list[str]:
        kind = self.registry[method].lift
        return [] if kind == "none" else filled(f"{STUDY_FILES}/lift_{kind}.h5", cases)

    def pretrained(self, wildcards) -> str | list:
        """The network that finite-element fields have pretrained, where the method has such a phase."""
        own = "pretraining" in self.registry[wildcards.method].settings
        return f"<results>/folds/{wildcards.fold}/{wildcards.method}/pretrained.pt" if own else []

    def predicted(self, wildcards) -> SimpleNamespace:
        """What a batch holds: cases with their files, the trained file, and the method's settings.

        truths are the files of the virtual truth: of a bound that is it, of nothing else.
        """
        method = self.registry[wildcards.method]
        if wildcards.batch.startswith("patients/"):
            _, name, plan = wildcards.batch.split("/")
            folder = f"<results>/patients/{name}"
            own = registry(self.config_of("patients"))[wildcards.method]
            return SimpleNamespace(
                cases=[name],
                models=[f"{folder}/model.h5"],
                plans=[f"{folder}/{plan}/plan.json"],
                truths=[],
                lifts=[],
                covariates=[],
                trained=[],
                settings=_predicting(own.settings),
            )
        fold = wildcards.batch.split("/")[1]
        cases = self.kept_from(fold)
        name = {"no": "", "at once": "fitted.h5", "by steps": "network.pt"}[method.trains]
        return SimpleNamespace(
            cases=cases,
            models=[self.model_of(case, wildcards.method) for case in cases],
            plans=[self.motion_of(case, wildcards.method, wildcards.batch) for case in cases],
            truths=filled("<results>/virtual/{case}/truth.h5", cases) if method.truth == "field" else [],
            lifts=self._lifts(wildcards.method, cases),
            covariates=self._covariates(wildcards.method, cases),
            trained=f"<results>/folds/{fold}/{wildcards.method}/{name}" if name else [],
            settings=_predicting(method.settings),
        )

    def of_batch(self, name: str) -> Callable:
        """Input or params function: one entry of :meth:`predicted`."""
        return lambda wildcards: getattr(self.predicted(wildcards), name)

    def ensemble(self, wildcards) -> SimpleNamespace:
        """The networks that predict a patient together: of every fold of the study, or of the archive."""
        if wildcards.home == "patients":
            choice = self.choice
            lift = f"<results>/patients/{wildcards.case}/lift_{choice.lift}.h5"
            lifts = [] if choice.lift == "none" else [lift]
            settings = {"fem": choice.settings["fem"], "newton_corrections": choice.corrections}
            return SimpleNamespace(
                folds=choice.archive.folds,
                networks=choice.networks,
                lifts=lifts,
                covariates=[f"<results>/patients/{wildcards.case}/covariates.json"],
                settings=settings,
                calibration=choice.calibration,
                ranges=choice.ranges,
            )
        case, method = wildcards.case, wildcards.method
        return SimpleNamespace(
            folds=list(self.held_out),
            networks=[f"<results>/folds/{fold}/{method}/network.pt" for fold in self.held_out],
            lifts=self._lifts(method, [case]),
            covariates=self._covariates(method, [case]),
            settings=_predicting(self.registry[method].settings),
            calibration=f"<results>/methods/{method}/calibration.json",
            ranges="<results>/methods/ranges.json",
        )

    def of_ensemble(self, name: str) -> Callable:
        """Input or params function: one entry of :meth:`ensemble`."""
        return lambda wildcards: getattr(self.ensemble(wildcards), name)

    def result_of_patient(self, wildcards) -> str:
        """The file that holds a new patient's displacement, and the interval of a learned method."""
        return f"<results>/patients/{wildcards.case}{wildcards.plan}/{wildcards.method}/{self.result}.h5"

    @property
    def result(self) -> str:
        """What the file of a new patient's prediction is called: it holds the interval of a learned method."""
        return "interval" if self.choice.archive else "predictions"

    def of_plans(self, name: str) -> Callable:
        """Input function: a file of every plan of a new patient; `{result}` stands for the prediction's."""

        def files(wildcards) -> list[str]:
            folder = f"<results>/patients/{wildcards.case}"
            own = name.replace("{result}", self.result)
            return [f"{folder}/{plan}/{wildcards.method}/{own}" for plan in self.patients[wildcards.case].plans]

        return files

    def external_files(self, wildcards) -> list[str]:
        """The files in which an external method delivers the held-out cases of the fold."""
        folder = self.config["external"][wildcards.method]
        return [external_file(folder, case) for case in self.kept_from(wildcards.fold)]


def _predicting(settings: Mapping) -> dict:
    """What a prediction reads of a method's settings: a trained network knows its own form, and needs no training."""
    return {name: own for name, own in settings.items() if name not in ("network", "pretraining", "finetuning")}


def filled(pattern: str, cases: Iterable[str]) -> list[str]:
    """The pattern for each case."""
    return [pattern.replace("{case}", case) for case in cases]
