"""What the rules of the virtual cohort ask."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pinnochio.study.cohort import virtual_names
from pinnochio.study.study import Study
from pinnochio.virtual.case_files import CHECKSUMS, FILES, INPUTS, OUTCOME_CHECKSUMS, OUTCOMES
from pinnochio.virtual.procedures import dealt


@dataclass(frozen=True)
class CohortInputs:
    study: Study

    @cached_property
    def drawn(self) -> dict[str, dict]:
        """Number and procedure of each virtual patient as they are drawn, those that are not made included."""
        virtual = self.study.config["virtual"]
        names = virtual_names(virtual["patients"])
        procedures = dealt(virtual["procedures"], len(names))
        return {
            name: {"number": number, "procedure": vars(procedure)}
            for number, (name, procedure) in enumerate(zip(names, procedures, strict=True))
        }

    @property
    def label_values(self) -> Mapping:
        """Voxel values by structure, of which a preset has none of its own."""
        labels = self.study.config["labels"]
        return {} if isinstance(labels, str) else labels

    @property
    def memory(self) -> int:
        """MB for an outcome, by the nodes of its mesh."""
        outcome = self.study.config["virtual"]["outcome"]
        effects = outcome["effects"]
        nodes = effects if effects == "nominal" else effects["nodes"]
        return 2000 + (outcome["mesh"]["nodes"] if nodes == "nominal" else nodes) // 10

    def files(self, *names: str) -> list[str]:
        """These files of every virtual patient."""
        return [f"<results>/virtual/{case}/{name}" for case in self.study.cohort.cases for name in names]

    def summed_up(self, wildcards) -> list[str]:
        """The files of the virtual cohort that a file of checksums holds: of a locked one its outcomes apart."""
        if not self.study.cohort.locked:
            return self.files(*FILES)
        return self.files(*(OUTCOMES if wildcards.sums == OUTCOME_CHECKSUMS else INPUTS))

    @property
    def sums(self) -> list[str]:
        """The files of checksums that are made; of a locked cohort's outcomes where they have been revealed."""
        study = self.study
        revealed = study.cohort.locked and Path(study.results, "virtual", OUTCOME_CHECKSUMS).is_file()
        return [CHECKSUMS, *([OUTCOME_CHECKSUMS] if revealed else [])]
