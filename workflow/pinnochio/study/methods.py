"""The methods of a study: what predicts its cohort, and where networks come from."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from pinnochio.errors import InputError
from pinnochio.methods.registry import Method, registry
from pinnochio.study.cohort import Cohort
from pinnochio.study.folds import Folds
from pinnochio.training.settings import PHASES


@dataclass(frozen=True)
class Methods:
    """The methods that a configuration knows, and those of them that a cohort can have."""

    config: Mapping
    cohort: Cohort
    folds: Folds

    @cached_property
    def registry(self) -> dict[str, Method]:
        """Every method that the configuration knows."""
        return registry(self.config)

    def __getitem__(self, name: str) -> Method:
        return self.registry[name]

    @property
    def untrained(self) -> list[str]:
        """Named methods that train, where fewer patients have a scan than there are folds to train in turn."""
        few = len(self.cohort.scanned) < self.config["folds"]
        return [name for name in self.config["methods"] if few and self.registry[name].trains != "no"]

    @property
    def unbounded(self) -> list[str]:
        """Named bounds, where the truth is not known."""
        return [name for name in self.config["methods"] if not self.cohort.virtual and self.registry[name].bound]

    @cached_property
    def left_out(self) -> list[str]:
        """Named methods that this cohort cannot have; InputError where none would be left."""
        names = [*self.untrained, *self.unbounded]
        if len(names) == len(self.config["methods"]) and not self.config["external"]:
            raise InputError(
                "-",
                "configuration",
                f"none of 'methods' is left: {len(self.cohort.scanned)} scanned patients do not fill "
                f"{self.config['folds']} folds to train on, and bounds need the virtual truth",
                "add a method that needs no training, or lower 'folds'",
            )
        return names

    @cached_property
    def used(self) -> list[str]:
        """What predicts the cohort, bounds among it, in the order of the configuration."""
        return [name for name in [*self.config["methods"], *self.config["external"]] if name not in self.left_out]

    @cached_property
    def bounds(self) -> list[str]:
        """The bounds among them, which no method is tested against."""
        return [name for name in self.used if self.registry[name].bound]

    @cached_property
    def compared(self) -> list[str]:
        """The methods proper among them."""
        return [name for name in self.used if name not in self.bounds]

    @cached_property
    def learned(self) -> list[str]:
        """Those that are trained by steps."""
        return [name for name in self.used if self.registry[name].trains == "by steps"]

    @property
    def reference(self) -> str | None:
        """The method that tables test the others against."""
        return self.config["reference"] if self.config["reference"] in self.used else None

    @property
    def calibrated(self) -> list[str]:
        """Methods whose interval is calibrated."""
        return [name for name in self.compared if name in self.config["uncertainty"]["methods"]]

    def of_family(self, *families: str) -> list[str]:
        """Known methods of the families."""
        return [name for name, method in self.registry.items() if method.family in families]

    def trained(self, how: str) -> list[str]:
        """Known methods that train so: "at once" or "by steps"."""
        return [name for name, method in self.registry.items() if method.trains == how]

    @property
    def predicting(self) -> list[str]:
        """Known methods that the project itself predicts by."""
        return [name for name, method in self.registry.items() if method.predictor]

    @property
    def pretrained(self) -> list[str]:
        """Methods that finite-element samples pretrain before they train by steps."""
        return [name for name in self.trained("by steps") if "pretraining" in self.registry[name].settings]

    def phases(self, method: str) -> dict[str, Mapping | None]:
        """Settings of each phase that the method's networks are trained in."""
        return {phase: self.registry[method].settings.get(phase) for phase in PHASES.values()}
