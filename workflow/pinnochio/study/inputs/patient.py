"""What the rules of one patient ask, of the study or new."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pinnochio.errors import InputError
from pinnochio.study.patients import markups_in
from pinnochio.study.study import Study


@dataclass(frozen=True)
class PatientInputs:
    study: Study

    def file(self, name: str) -> Callable:
        """Input function: what is brought of the patient under that name, where it is."""
        return lambda wildcards: getattr(self.study.patient(wildcards), name) or []

    def setting(self, *keys: str) -> Callable:
        """Params function: a value of the patient's configuration."""

        def value(wildcards):
            section = self.study.patient(wildcards).config
            for key in keys:
                section = section[key]
            return section

        return value

    def markups(self, wildcards) -> list[str]:
        """The files of the patient's markups: landmarks, planes, regions."""
        markups = self.study.patient(wildcards).markups
        if markups and Path(markups).is_dir():
            return markups_in(markups)
        return [markups] if markups else []

    def plan(self, wildcards) -> str:
        """The plan as the user, or the virtual cohort, brings it."""
        return self.study.patient(wildcards).plans[getattr(wildcards, "plan", "").removeprefix("/")]

    def postop(self, wildcards) -> str:
        return self._after_surgery(
            wildcards, "postop", "there is no post-operative scan", "ask for fem/mucosa.png, or give a scan"
        )

    def postop_bones(self, wildcards) -> str:
        return self._after_surgery(wildcards, "postop_bones", "there are no post-operative bones", "give them")

    def bones_of_postop(self, wildcards) -> str | list:
        """The bones that the skin after surgery is registered by: those of its own scan."""
        return self.postop_bones(wildcards) if self.study.patient(wildcards).postop_frame else []

    def labels_of_postop(self, wildcards) -> str | list:
        """The labels before surgery, where the skin after it is registered by bones."""
        return "<results>/cases/{case}/labels.nii.gz" if self.study.patient(wildcards).postop_frame else []

    def _after_surgery(self, wildcards, name: str, problem: str, remedy: str) -> str:
        file = getattr(self.study.patient(wildcards), name)
        if not file:
            raise InputError(wildcards.case, self.study.config["cohort"], problem, remedy)
        return file

    def covariates(self, wildcards) -> dict | None:
        """What is said of the patient beside the files; None where a file says it."""
        patient = self.study.patient(wildcards)
        return None if patient.covariates_file else dict(patient.covariates)

    def nodes(self, wildcards) -> int:
        """Nodes of the mesh."""
        return int(getattr(wildcards, "nodes", 0)) or self.study.patient(wildcards).config["mesh"]["nodes"]

    @property
    def lift(self) -> dict[str, str]:
        """The lift that comes with the model of a new patient, where its networks want one."""
        wanted = self.study.choice and self.study.choice.lift != "none"
        return {"lift": "<results>/{home}/{case}/lift_elastic.h5"} if wanted else {}

    @property
    def to_train_on(self) -> dict[str, str]:
        """What comes with the model of a case of the study for what is trained: the lift, and samples of plans."""
        methods, folder = self.study.methods, "<results>/cases/{case}"
        sampled = [*methods.pretrained, *methods.trained("at once")]
        return {
            **({"lift": f"{folder}/lift_elastic.h5"} if methods.learned else {}),
            **({"fem_samples": f"{folder}/fem_samples.h5"} if {*methods.used} & {*sampled} else {}),
        }

    def motion(self, wildcards) -> str:
        """The motion that predictions of a patient take: of the study's as everywhere, of a new one the plan."""
        if plan := getattr(wildcards, "plan", ""):
            return f"{self.study.patient(wildcards).folder}{plan}/plan.json"
        return self.study.motion_of(wildcards.case)
