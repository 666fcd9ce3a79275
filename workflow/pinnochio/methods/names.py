"""Names of methods as people write them; CSV files and the configuration keep the short ones."""

import re
from collections.abc import Iterable

WRITTEN = {
    "floor_scan": "Noise of the scan",
    "oracle": "Sliding FEM, true motion",
    "oracle_learner": "Perfect learner",
    "no_change": "No change",
    "ratio": "Soft-to-hard ratios",
    "pca_linear": "Linear regression",
    "elastic": "Linear elasticity",
    "fem_bonded": "Bonded FEM",
    "fem_sliding": "Sliding FEM",
    "fem_learned": "Sliding FEM, learned loads",
    "fem_lips": "Sliding FEM, lips in contact",
    "fem_rlse_bonded": "FEM-RLSE, bonded",
    "fem_rlse_mucosa": "FEM-RLSE, sliding",
    "fem_rlse": "FEM-RLSE, lips in contact",
    "acmt": "ACMT-Net",
    "acmt_pretrained": "ACMT-Net, pretrained",
    "fscnet": "FSC-Net",
    "fscnet_pretrained": "FSC-Net, pretrained",
    "dgcfp": "DGCFP",
    "dgcfp_pretrained": "DGCFP, pretrained",
    "pinnochio_unified": "PINNOCHIO, one network",
    "pinnochio_unified_narrow": "PINNOCHIO, one narrow network",
    "pinnochio_narrow": "PINNOCHIO, narrow",
    "pinnochio_shallow": "PINNOCHIO, shallow",
    "pinnochio_tissues": "PINNOCHIO, a P_vol for each tissue",
    "pinnochio_no_physics": "PINNOCHIO, no physics",
    "pinnochio": "PINNOCHIO",
    "pinnochio_plus": "PINNOCHIO plus",
}
WORDS = {"oracle", "ratio", "elastic"}  # that a text may hold without speaking of the method
SWITCH = "design_"  # of a design study's network: the switch follows
_WITHIN = re.compile(rf"(^|[.:] )?\b({'|'.join(sorted(WRITTEN.keys() - WORDS))}|{SWITCH}\w+)\b")
# Explained is what a method does better than the one, of what the other leaves to be done.
BASELINE, FLOOR, CEILING = "fem_sliding", "floor_scan", "oracle_learner"
# What a reader wants to see first where there is room for few: what the paper compares, and the better network.
FIRST = ("fem_sliding", "pinnochio", "pinnochio_plus", "fem_rlse", "acmt", "dgcfp", "no_change", "elastic", "ratio")


def written(method: str) -> str:
    """The name as people write it; that of a user's own method as it is."""
    if method.startswith(SWITCH):
        return f"Design {method.removeprefix(SWITCH).replace('_', ' ')}"
    return WRITTEN.get(method, method)


def in_sentence(method: str) -> str:
    """The name within a sentence: no capital but an abbreviation's."""
    name = written(method)
    return name[0].lower() + name[1:] if name[1:2].islower() and name != method else name


def spoken(text: str) -> str:
    """A cell or a text in which methods bear the names that people write."""
    if text in WRITTEN:
        return WRITTEN[text]
    return _WITHIN.sub(lambda match: _spoken(*match.groups()), text)


def _spoken(before: str | None, method: str) -> str:
    return in_sentence(method) if before is None else before + written(method)


def few(methods: Iterable[str], count: int) -> list[str]:
    """At most so many of the methods, in their order: those that are wanted first, then the others as they come."""
    methods = list(methods)
    wanted = [name for name in FIRST if name in methods]
    chosen = [*wanted, *(name for name in methods if name not in wanted)][:count]
    return [name for name in methods if name in chosen]
