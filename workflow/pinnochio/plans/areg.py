"""The motion that was achieved, from the matrices that AReg of the Slicer Automated Dental Tools writes of two scans.

AReg registers the scan after surgery on the one before, once on the cranial base and once on each jaw, and saves
`PATIENT_CB*_matrix.tfm`, `PATIENT_MAX*_matrix.tfm` and `PATIENT_MAND*_matrix.tfm`. As in all ITK files, each takes a
point of the scan before surgery to where the same bone lies in the scan after it [S: AREG_CBCT]. By way of the cranial
base that place is brought back into the frame before surgery: a jaw has moved by CB^-1 JAW.
"""

import logging
import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pinnochio.errors import refusal
from pinnochio.files import entries
from pinnochio.geometry.rigid import RigidMotion
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import UNCUT, of_role
from pinnochio.plans.transforms import about_its_axis, read_rigid

LOG = logging.getLogger(__name__)
NAME = re.compile(r"(?:.*_)?(CB|MAX|MAND)(?:_?[A-Za-z0-9]+)*_matrix")
BASE, JAWS = "CB", {"MAX": ("maxilla",), "MAND": ("distal", UNCUT, "chin")}  # and the roles of the bone that each holds


def matrices(folder: str | os.PathLike) -> list[Path]:
    """The matrices of AReg in a folder; none where the path is no folder."""
    return [file for file in entries(folder) if file.suffix.lower() == ".tfm" and NAME.fullmatch(file.stem)]


def read_areg(folder: str | os.PathLike, case: str, segments: Sequence[str]) -> Plan:
    """The achieved motion of the patient's segments; those of which there is no matrix stay where they were.

    InputError without a matrix of the cranial base, for two of one region, and for a jaw in pieces, whose motions one
    matrix cannot tell.
    """
    refuse, files = refusal(case, folder), {}
    for file in matrices(folder):
        region = NAME.fullmatch(file.stem)[1]
        if region in files:
            refuse(f"{files[region].name} is of the same region", "keep one patient's matrices in a folder", file=file)
        files[region] = file
    if BASE not in files or len(files) == 1:
        lacking = "the cranial base (*_CB*_matrix.tfm)" if BASE not in files else "a jaw (*_MAX*, *_MAND*_matrix.tfm)"
        refuse(f"AReg's matrix of {lacking} is not there", "register the two scans on it as well")
    turn, back, _ = read_rigid(files.pop(BASE), case)  # CB^-1 x = turn (x - back)
    motions = {}
    for region, file in files.items():
        members = of_role(segments, *JAWS[region])
        if len(members) != 1:
            held = ", ".join(members) or "no segment"
            refuse(f"the patient has {held} there", "give a segmentation made after surgery as the plan", file=file)
        rotation, offset, _ = read_rigid(file, case)  # JAW x = rotation' x + offset
        whole = turn @ rotation.T
        motions[members[0]] = about_its_axis(whole, whole.T @ turn @ (back - offset), np.zeros(3))
    if still := [name for name in segments if name not in motions]:
        LOG.warning("case %r: %s: no matrix of %s; taken to have stayed in place", case, folder, ", ".join(still))
    return Plan(case, {name: motions.get(name, RigidMotion()) for name in segments})
