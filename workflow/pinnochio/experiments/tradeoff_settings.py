"""The settings that are measured: each method at its own in the study, then one dial turned at a time."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

from pinnochio.overlays import changes

ARMS = {"fem_bonded": "bonded", "fem_sliding": "mucosa", "fem_lips": "mucosa+lip"}
BASE = "as in the study"


@dataclass(frozen=True)
class Setting:
    """method and the dial that is turned to `value`; what differs from the study: nodes of the mesh, `fem` settings,
    corrections after a network, double precision. A recipe holds what a prediction needs to repeat it; settings that
    serve the comparison alone have none.
    """

    method: str
    dial: str
    value: str
    nodes: int
    fem: Mapping[str, object] = field(default_factory=dict)
    corrections: int | None = None
    double: bool = False
    repeatable: bool = True

    @property
    def recipe(self) -> str:
        """JSON: method, nodes, fem, corrections; empty where nothing can repeat it."""
        if not self.repeatable:
            return ""
        return json.dumps(
            {"method": self.method, "nodes": self.nodes, "fem": dict(self.fem), "corrections": self.corrections}
        )


def fem_settings(nodes: int, config: Mapping) -> list[Setting]:
    """Finite elements along their dials; nodes: of the study; config: section `tradeoff` of the configuration."""
    settings = [Setting("fem_sliding", "nodes", str(config["reference"]), config["reference"])]
    for method in ("elastic", "fem_bonded", "fem_sliding"):
        settings.append(Setting(method, "nodes", f"{nodes}, {BASE}", nodes))
        settings += [Setting(method, "nodes", str(size), size) for size in config["nodes"] if size != nodes]
    settings += [
        Setting("fem_lips", "arm", "mucosa+lip", nodes, repeatable=False),
        Setting("fem_sliding", "element", "p1", nodes, {"volumetric": "p1"}),
        Setting("fem_bonded", "element", "p1", nodes, {"volumetric": "p1"}),
    ]
    settings += [
        Setting("fem_bonded", "element", name, nodes, {"volumetric": name}, repeatable=False)
        for name in config["mixed"]
    ]
    settings += [Setting("fem_sliding", "increments", str(n), nodes, {"increments": n}) for n in config["increments"]]
    settings += [Setting("fem_sliding", "tolerance", f"{x:g}", nodes, {"tolerance": x}) for x in config["tolerances"]]
    return [*settings, Setting("fem_sliding", "precision", "double factors", nodes, double=True, repeatable=False)]


def network_settings(nodes: int, config: Mapping, variants: Mapping[str, Mapping]) -> list[Setting]:
    """Learned methods along their dials: those of `networks` by mesh, corrections and precision, those of `further`
    (other widths, depths, lifts) as they are. variants: settings by method, as pinnochio.study.variants gives them.
    """
    settings = []
    for method in config["networks"]:
        own = variants[method]["newton_corrections"]
        for count in sorted({own, *config["corrections"]}):
            value = f"{count}, {BASE}" if count == own else str(count)
            settings.append(Setting(method, "corrections", value, nodes, corrections=count))
        settings += [
            Setting(method, "nodes", str(size), size, corrections=own)
            for size in config["nodes"]
            if size != nodes and size <= config["largest_network"]
        ]
        settings.append(Setting(method, "precision", "double", nodes, corrections=own, double=True, repeatable=False))
    for method in config["further"]:
        base = nearest(variants[method], {name: variants[name] for name in config["networks"]})
        differences = " and ".join(
            change.removeprefix("network.") for change in changes(variants[base], variants[method])
        )
        settings.append(
            Setting(method, "network", differences, nodes, corrections=variants[method]["newton_corrections"])
        )
    return settings


def nearest(settings: Mapping, bases: Mapping[str, Mapping]) -> str:
    """The base from which the settings differ in the fewest keys."""
    return min(bases, key=lambda name: len(changes(bases[name], settings)))


def as_in_the_study(method: str, nodes: int) -> Setting:
    """A method as the study predicts by it."""
    return Setting(method, "none", BASE, nodes, repeatable=False)
