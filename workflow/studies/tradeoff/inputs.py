"""What the trade-off measures: held-out patients, fold after fold, each by the networks of its own fold."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from pinnochio.errors import InputError
from pinnochio.methods.registry import Method
from studies.tradeoff.settings import VARIED, Setting, fem_settings, network_settings

FAMILIES = ("fem", "networks")


@dataclass(frozen=True)
class Tradeoff:
    """config: of the study; judged: its patients with a scan, fold after fold; registry: every method by its name;
    variants: settings of every graph network."""

    config: Mapping
    judged: Sequence[str]
    registry: Mapping[str, Method]
    variants: Mapping[str, Mapping]

    @property
    def section(self) -> Mapping:
        return self.config["tradeoff"]

    @cached_property
    def cases(self) -> list[str]:
        """Patients that are measured."""
        return list(self.judged)[: self.section["patients"]]

    @cached_property
    def networks(self) -> list[str]:
        """Those that are varied."""
        return self.section["networks"] if self.cases else []

    @cached_property
    def sizes(self) -> list[int]:
        """Nodes of the meshes."""
        return sorted({self.config["mesh"]["nodes"], self.section["reference"], *self.section["nodes"]})

    @cached_property
    def fem_settings(self) -> list[Setting]:
        """Finite elements along their parameters."""
        contacts = {name: self.registry[name].options.get("contact", "") for name in VARIED}
        return fem_settings(self.config["mesh"]["nodes"], self.section, contacts)

    @cached_property
    def network_settings(self) -> list[Setting]:
        """Networks along their parameters."""
        return network_settings(self.config["mesh"]["nodes"], self.section, self.variants) if self.cases else []

    @cached_property
    def lifts(self) -> list[tuple[str, int]]:
        """Kind and nodes of the lifts that the networks want."""
        kinds = {(self.registry[setting.method].lift, setting.nodes) for setting in self.network_settings}
        return sorted(pair for pair in kinds if pair[0] != "none")

    def rows(self, wildcards) -> dict[str, list[str]]:
        """The files of measured rows; InputError where there are too few patients."""
        if len(self.cases) < 2:
            raise InputError(
                "-",
                self.config["cohort"],
                f"{len(self.cases)} patients have a post-operative scan, and the trade-off wants two",
                "give more scans",
            )
        return {"rows": [f"<results>/tradeoff/{case}/{family}.csv" for case in self.cases for family in FAMILIES]}
