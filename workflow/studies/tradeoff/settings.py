"""The settings that are measured: each method at its own in the study, then one parameter varied at a time."""

from collections.abc import Mapping
from dataclasses import dataclass, field

BASE = "as in the study"  # ends the value of a setting that changes nothing
# What is varied of each method by finite elements.
VARIED = {
    "elastic": ("nodes",),
    "fem_bonded": ("nodes", "element", "solver"),
    "fem_sliding": ("nodes", "element", "solver", "accuracy"),
}


@dataclass(frozen=True)
class Setting:
    """method and the parameter that is set to `value`; what differs from the study: nodes of the mesh, `fem` settings,
    corrections after a network. contact: which interfaces slide, of finite elements; empty of linear elasticity.
    """

    method: str
    parameter: str
    value: str
    nodes: int
    contact: str = ""
    fem: Mapping[str, object] = field(default_factory=dict)
    corrections: int | None = None


def fem_settings(nodes: int, config: Mapping, contacts: Mapping[str, str]) -> list[Setting]:
    """Finite elements along their parameters, the reference first.

    nodes: of the study; config: section `tradeoff` of the configuration; contacts: of each method.
    """

    def setting(method: str, parameter: str, value: str, size: int = nodes, **more) -> list[Setting]:
        single = Setting(method, parameter, value, size, contacts.get(method, ""), **more)
        return [single] if parameter in VARIED[method] else []

    finest = config["reference"]
    settings = setting("fem_sliding", "nodes", str(finest), finest, fem={"accuracy": "exact"})
    for method in VARIED:
        settings += setting(method, "nodes", f"{nodes}, {BASE}")
        for size in config["nodes"]:
            settings += setting(method, "nodes", str(size), size) if size != nodes else []
    for method in VARIED:
        settings += setting(method, "element", "p1", fem={"volumetric": "p1"})
        for accuracy in config["accuracies"]:
            settings += setting(method, "accuracy", str(accuracy), fem={"accuracy": accuracy})
        settings += setting(method, "solver", "Newton's method", fem={"kept_factors": False})
    return settings


def network_settings(nodes: int, config: Mapping, variants: Mapping[str, Mapping]) -> list[Setting]:
    """Networks along their parameters, mesh and corrections; variants: settings by method, see
    methods.registry.graph_networks."""
    settings = []
    for method in config["networks"]:
        usual = variants[method]["newton_corrections"]
        for count in sorted({usual, *config["corrections"]}):
            value = f"{count}, {BASE}" if count == usual else str(count)
            settings.append(Setting(method, "corrections", value, nodes, corrections=count))
        settings += [
            Setting(method, "nodes", str(size), size, corrections=usual)
            for size in config["nodes"]
            if size != nodes and size <= config["largest_network"]
        ]
    return settings
