"""Makes repaired and checked labels, then bone and skin surfaces, in LPS mm of a patient's segmentation."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pinnochio.beside import second_process
from pinnochio.errors import InputError
from pinnochio.importing.anatomy import AS_IT_SHOULD_BE, check_anatomy
from pinnochio.importing.head_parts import read_head_parts
from pinnochio.importing.markups import read_markups
from pinnochio.importing.muscle_layer import DERIVED, muscle_layer
from pinnochio.importing.osteotomy import osteotomy
from pinnochio.importing.plausible import check_plausible, judged, unlike_people
from pinnochio.importing.presets import LOWER_TEETH, UPPER_TEETH
from pinnochio.importing.registration import upper_face_plane
from pinnochio.importing.repair import repair
from pinnochio.importing.segmentation import Segmentation, read_labels, read_segmentation, write_segmentation
from pinnochio.json_text import read_stored_json, write_json
from pinnochio.logs import collected
from pinnochio.model.labels import CRANIUM, MUSCLE, SUPERFICIAL, internal_codes
from pinnochio.model.surfaces import bone_surface, skin_surface, write_surface
from pinnochio.plans.roles import GUESS, UNCUT

LOG = logging.getLogger("pinnochio.importing")  # what is warned of there is shown


def import_labels(
    case: str,
    segmentation: str,
    label_values: Mapping[str, int | str] | str,
    segments: tuple[str, ...],
    orientation: str,
    repair_limit: float,
    unlabelled_muscle: str,
    bone_edge: float,
    head: str,
    labels: str,
    volume: str | None = None,
    markups: Sequence[str] = (),
    cuts: Sequence[str] = (),
    accept: bool = False,
) -> None:
    """Read, repair and check one patient; write labels, and as `head` what is known of volumes, repairs and warnings.

    label_values maps each structure's name to its voxel value or to its name in the file, or names the tool that made
    the segmentation; then volume is the scan that soft tissue may come from, and cuts are made where the files of
    markups or the bone say. segments are those that a case may have, its own those that the file holds or the cuts
    make; orientation is "header", or where the voxel axes point if the header is wrong; repair_limit is the share of a
    structure in percent that repairs may change and unnamed voxels may take from it; unlabelled_muscle (derived |
    single | refuse) serves where no muscle is labelled; accept: bones unlike people's go in, to be looked at with care.
    Raises InputError for what the user must mend.
    """
    with collected() as warnings:
        read, frame, made, repairs, care = _checked_head(
            case, segmentation, label_values, segments, orientation, repair_limit, volume, markups, cuts, accept
        )
        voxel, segments, top = float(np.prod(read.spacing)), read.segments, 0.0
        if unlabelled_muscle == DERIVED and not (read.labels == MUSCLE).any():
            movable = np.where(read.labels == CRANIUM, SUPERFICIAL, read.labels)  # the cranium takes longest
            top = upper_face_plane(bone_surface(movable, read.spacing, read.origin, segments, bone_edge), segments, 0.0)
        final, muscle = muscle_layer(*read.label_map, top, unlabelled_muscle, case, segmentation)
    report = {
        "case": case,
        "spacing_mm": np.asarray(read.spacing).tolist(),
        "shape": list(final.shape),
        "frame": frame,
        "muscle": muscle,
        "volume_cm3": {
            name: round(voxel / 1000 * int((final == code).sum()), 3) for name, code in internal_codes(segments).items()
        },
        "repairs": repairs,
        "warnings": warnings,
        "care": care,
    } | made
    write_segmentation(labels=final, spacing=read.spacing, origin=read.origin, path=labels)
    write_json(head, {"segments": segments, "report": report})


def import_surfaces(labels: str, head: str, bone_edge: float, bone: str, skin: str, report: str) -> None:
    """Write bone, skin and the report of what :func:`import_labels` wrote, with warnings of the surfaces."""
    read, known = read_labels(labels), read_stored_json(head)
    with collected() as warnings, second_process() as aside:
        contoured = aside.submit(skin_surface, *read.label_map)
        bones = bone_surface(*read.label_map, tuple(known["segments"]), bone_edge)
    bones.write(bone)
    write_surface(*contoured.result(), skin)
    write_json(report, known["report"] | {"warnings": list(dict.fromkeys(known["report"]["warnings"] + warnings))})


def _checked_head(
    case, segmentation, label_values, segments, orientation, repair_limit, volume, markups, cuts, accept
) -> tuple[Segmentation, dict, dict, list, list[str]]:
    """The head, repaired and checked; what its anatomy says of its frame; how it was made; its repairs; and what of it
    must be looked at with care. Arguments as in :func:`import_labels`."""
    if isinstance(label_values, str):
        head, frame, made = _cut_head(
            case, segmentation, label_values, segments, orientation, repair_limit, volume, markups, cuts
        )
    else:
        head = read_segmentation(segmentation, case, label_values, segments, orientation, repair_limit)
        made = {"closed": head.closed} if head.closed else {}
        if unused := [Path(file).name for file in (volume, *markups) if file]:
            LOG.warning("case %r: not used, because 'labels' names what is cut already: %s", case, ", ".join(unused))
        frame = check_anatomy(head.labels, head.spacing, head.segments, head.axes, case, segmentation)
    voxel = float(np.prod(head.spacing))
    labels, repairs = repair(head.labels, head.segments, repair_limit, case, segmentation, voxel)
    check_plausible(labels=labels, spacing=head.spacing, segments=head.segments, case=case, file=segmentation)
    odd = unlike_people(labels, head.spacing, head.segments)
    guessed = any(why.endswith(GUESS) for why in made.get("cuts", {}).values())
    care = judged(odd, accept, guessed, case, segmentation)
    return replace(head, labels=labels), frame, made, repairs, care


def _cut_head(case, path, tool, segments, orientation, limit, volume, markups, cuts) -> tuple[Segmentation, dict, dict]:
    """The head that a tool has segmented, with its cuts made; what its anatomy says of its frame; how it was made.

    limit: percent of a bone that loose pieces may make up; the rest as in :func:`import_labels`.
    """
    marked = read_markups(markups, case)
    parts = read_head_parts(path, volume, case, tool, orientation, marked.regions, limit)
    upper, lower = (parts.parts == teeth for teeth in (UPPER_TEETH, LOWER_TEETH))
    frame = check_anatomy(parts.uncut(), parts.spacing, (UNCUT,), parts.axes, case, path, upper, lower)
    frame |= {"sides": AS_IT_SHOULD_BE} if parts.sided else {}
    made = osteotomy(parts, cuts, marked, case, path)
    marked_sides = [made.landmarks.get(name, ("", ""))[1] == "given" for name in ("RCo", "LCo")]
    frame |= {"sides": f"{AS_IT_SHOULD_BE}, by RCo and LCo"} if all(marked_sides) else {}
    if unknown := [name for name in made.segments if name not in segments]:
        problem = f"the cuts make {', '.join(unknown)}, which 'segments' does not name"
        raise InputError(case, "configuration", problem, "add them to 'segments', or change 'osteotomy.cuts'")
    landmarks = {
        name: {"place": np.round(place, 2).tolist(), "source": source}
        for name, (place, source) in sorted(made.landmarks.items())
    }
    head = Segmentation(made.labels, parts.spacing, parts.origin, made.segments, parts.axes)
    said = {"tool": tool, "soft_tissue": parts.soft, "closed": parts.closed}
    return head, frame, said | {"cuts": made.cuts, "landmarks": landmarks}
