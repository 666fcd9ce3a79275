"""A muscle layer for segmentations without muscle labels, by a stated rule."""

import logging

import numpy as np
from scipy import ndimage

from pinnochio.errors import refusal
from pinnochio.importing.soft_tissue import larger
from pinnochio.model.labels import AIR, CRANIUM, MUSCLE, SUPERFICIAL

LOG = logging.getLogger(__name__)
LABELLED, DERIVED, SINGLE, REFUSE = "labelled", "derived", "single", "refuse"
# The rule; volume and overlap on labelled muscles of virtual heads are in tests/unit/importing/test_muscle_layer.py.
BELOW_SKIN = 3.5  # mm
OFF_MUCOSA = 2.0  # mm
OPENING = 8.0  # mm; air behind a narrower opening is mouth, not outside
SMALLEST = 1000.0  # mm3; smaller pieces are no muscle


def muscle_layer(
    labels, spacing, origin, top: float, unlabelled: str, case: str, file: object
) -> tuple[np.ndarray, str]:
    """Labels with a muscle layer where muscle is not labelled, and where it comes from.

    labels (nx, ny, nz) internal codes, LPS; spacing, origin (3,) mm; top: height z (mm) of the upper jaw's top;
    unlabelled: derived | single | refuse. The word is "labelled" if the map has muscle, and then nothing is done;
    "single" if all soft tissue stays superficial; "derived" if :func:`derive_muscle` made the layer. Raises InputError
    with `refuse`, and where no tissue fits the rule.
    """
    refuse = refusal(case, file)
    labels = np.asarray(labels)
    if (labels == MUSCLE).any():
        return labels, LABELLED
    if unlabelled == REFUSE:
        refuse("no muscle is labelled", "label 'muscle', or set 'unlabelled_muscle' to derived or single")
    if unlabelled == SINGLE:
        return labels, SINGLE
    muscle = derive_muscle(labels, spacing, origin, top)
    if not muscle.any():
        problem = "no muscle is labelled, and no tissue fits the rule that derives it"
        refuse(problem, "check that bone and skin are labelled as one face, or set 'unlabelled_muscle' to single")
    LOG.warning(
        "case %r: no muscle is labelled; %.0f %% of the soft tissue is taken as muscle by rule",
        case,
        100 * muscle.sum() / (labels == SUPERFICIAL).sum(),
    )
    return np.where(muscle, MUSCLE, labels).astype(labels.dtype), DERIVED


def derive_muscle(labels, spacing, origin, top: float) -> np.ndarray:
    """Soft tissue (nx, ny, nz) bool that counts as muscle [I].

    Nearer to bone than to the skin, at least BELOW_SKIN mm under the skin, OFF_MUCOSA mm away from the
    lining of mouth, nose and throat, below the upper jaw's top (above it lie thin mimic muscles and orbits), in
    connected pieces of SMALLEST mm3 at least.
    """

    def distance(mask):
        if not mask.any():
            return np.full(mask.shape, np.inf)
        return ndimage.distance_transform_edt(~mask, sampling=spacing)

    soft = labels == SUPERFICIAL
    outside = _outside(labels == AIR, spacing, distance)
    lining = (labels == AIR) & ~outside & ndimage.binary_dilation(soft)
    to_bone, to_skin = distance(labels >= CRANIUM), distance(outside)
    height = origin[2] + spacing[2] * np.arange(labels.shape[2])
    muscle = soft & (to_bone < to_skin) & (to_skin > BELOW_SKIN)
    muscle &= (distance(lining) > OFF_MUCOSA) & (height < top)
    return larger(muscle, SMALLEST / np.prod(spacing))


def _outside(air, spacing, distance) -> np.ndarray:
    """Air in front of and beside the head that a ball of diameter OPENING reaches."""
    # A tightly cropped volume may end at the nose and at the cheeks.
    air = np.pad(air, ((1, 1), (1, 0), (0, 0)), constant_values=True)
    region, _ = ndimage.label(distance(~air) > OPENING / 2)
    front = region == region[0, 0, 0]
    reached = air & (distance(front) < OPENING / 2 + np.max(spacing))
    return reached[1:-1, 1:]
