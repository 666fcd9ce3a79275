"""What every method is: the one table that configuration, rules and studies ask.

Stage scripts do not read it: what a job needs of its method reaches it by params, so that a further method reruns no
job of another one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from pinnochio.overlays import overlaid

PRETRAINED = "_pretrained"  # ends the name of a surface network that is pretrained on finite-element fields


@dataclass(frozen=True)
class Method:
    """A method that predicts how the soft tissue follows a plan.

    predictor: reference, `module:name`, of the class that predicts. learner: that of the function `fit` (trains at
    once) or of the class (by steps) that trains. sections: of the configuration that it reads; options: further values,
    fixed. mesh: "study", or "lips" for the mesh that resolves the lips. trains: "no", "at once" or "by steps".
    new_patients: whether it predicts patients of no study. truth: what a bound reads of the virtual truth, "motion" or
    "field"; empty for every method proper. covariates: whether it reads what else is known of a patient. settings:
    values of the sections and options, by section, once the configuration is known.
    """

    name: str
    family: str
    predictor: str
    learner: str = ""
    sections: tuple[str, ...] = ()
    options: Mapping[str, object] = field(default_factory=dict)
    mesh: str = "study"
    trains: str = "no"
    new_patients: bool = False
    truth: str = ""
    covariates: bool = False
    settings: Mapping[str, object] = field(default_factory=dict)

    @property
    def bound(self) -> bool:
        """Whether it says how near a method can come, and is none itself: it knows what happened."""
        return bool(self.truth)

    @property
    def lift(self) -> str:
        """Kind of the lift that the method's network wants."""
        return self.settings.get("network", {}).get("lift", "none")


def _finite_elements(name: str, contact: str, **more) -> Method:
    """A method by `methods/finite_elements.py`; contact: which interfaces slide."""
    predictor = "pinnochio.methods.finite_elements:FiniteElementPredictor"
    return Method(name, "finite elements", predictor, sections=("fem",), options={"contact": contact}, **more)


BUILT_IN = (
    Method("no_change", "floor", "pinnochio.methods.no_change:NoChangePredictor"),
    Method("ratio", "floor", "pinnochio.methods.ratio:RatioPredictor"),
    Method(
        "pca_linear",
        "regression",
        "pinnochio.methods.pca_linear:PcaPredictor",
        "pinnochio.methods.pca_linear:fit",
        trains="at once",
    ),
    Method(
        "elastic", "finite elements", "pinnochio.methods.elastic:ElasticPredictor", sections=("fem",), new_patients=True
    ),
    _finite_elements("fem_bonded", "bonded", new_patients=True),
    _finite_elements("fem_sliding", "mucosa", new_patients=True),
    Method(
        "fem_learned",
        "finite elements",
        "pinnochio.methods.fem_learned:LearnedLoadPredictor",
        "pinnochio.methods.fem_learned:fit",
        ("fem",),
        trains="at once",
    ),
    _finite_elements("fem_rlse_bonded", "bonded", mesh="lips"),
    _finite_elements("fem_rlse_mucosa", "mucosa", mesh="lips"),
    _finite_elements("fem_rlse", "mucosa+lip", mesh="lips"),
    _finite_elements("oracle", "mucosa", truth="motion"),
    Method("oracle_learner", "scan", "pinnochio.methods.oracle_learner:OracleLearnerPredictor", truth="field"),
    Method("floor_scan", "scan", "pinnochio.methods.floor_scan:ScanFloorPredictor", truth="field"),
)
# Those that the configuration names: in `variants`, in `surface.networks`, in `external`.
GRAPH_NETWORK = Method(
    "",
    "graph network",
    "pinnochio.methods.pinnochio.predictor:GraphPredictor",
    "pinnochio.methods.pinnochio.learner:GraphLearner",
    ("network", "pretraining", "finetuning", "newton_corrections", "fem"),
    trains="by steps",
    new_patients=True,
)
SURFACE_NETWORK = Method(
    "",
    "surface network",
    "pinnochio.methods.surface.predictor:SurfacePredictor",
    "pinnochio.methods.surface.learner:SurfaceLearner",
    trains="by steps",
)
EXTERNAL = Method("", "external", "")


def registry(config: Mapping) -> dict[str, Method]:
    """Every method that the configuration knows by its name, with its settings."""
    methods = {method.name: replace(method, settings=_settings(method, config)) for method in BUILT_IN}
    for name, settings in graph_networks(config).items():
        methods[name] = graph_network(name, settings, config["fem"])
    for name, settings in surface_networks(config).items():
        methods[name] = replace(SURFACE_NETWORK, name=name, settings=settings)
    return methods | {name: replace(EXTERNAL, name=name) for name in config["external"]}


def graph_network(name: str, settings: Mapping, fem: Mapping) -> Method:
    """The graph network of these settings; fem: section of the configuration."""
    return replace(GRAPH_NETWORK, name=name, settings={**settings, "fem": fem})


def _settings(method: Method, config: Mapping) -> dict:
    settings = {name: config[name] for name in method.sections} | method.options
    if method.mesh == "lips":
        lips = config["fem_rlse"]
        solver = {name: lips[name] for name in ("increments", "tolerance")}
        settings["fem"] = settings["fem"] | solver
    return settings


def graph_networks(config: Mapping) -> dict[str, dict]:
    """Settings of every graph network by its name: network, pretraining, finetuning, newton_corrections.

    Overlays of the configuration's sections.
    """
    sections = {name: config[name] for name in GRAPH_NETWORK.sections if name != "fem"}
    return {name: overlaid(sections, overlay) for name, overlay in config["variants"].items()}


def surface_networks(config: Mapping) -> dict[str, dict]:
    """Settings of every surface network by its name: network, finetuning, and pretraining where the name says so."""
    networks = {}
    for name, section in config["surface"]["networks"].items():
        switches = {key: value for key, value in section.items() if key not in ("pretraining", "finetuning")}
        network = {key: config["surface"][key] for key in ("points", "neighbours", "repeats")} | switches
        networks[name] = {"network": network, "finetuning": section["finetuning"]}
        networks[name + PRETRAINED] = networks[name] | {"pretraining": section["pretraining"]}
    return networks
