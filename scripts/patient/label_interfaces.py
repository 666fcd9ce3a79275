"""Makes the patient model (interfaces, what each boundary node is attached to) of mesh, labels and bone."""

import logging
from dataclasses import replace

import numpy as np

from pinnochio.importing.segmentation import read_labels
from pinnochio.json_text import read_stored_json
from pinnochio.meshing.interfaces import label_interfaces
from pinnochio.meshing.mesh import TetMesh
from pinnochio.model.patient import FIXED, MOVING, SLIDING
from pinnochio.model.surfaces import BoneSurface, read_surface


def label_case(
    mesh: str, labels: str, bone: str, skin: str, report: str, interfaces: dict[str, float], model: str
) -> None:
    """Write the patient model; `interfaces` holds the thresholds in mm (config section of the same name).

    report: the import's, which knows where the muscle layer comes from.
    """
    head, surface = read_labels(labels), BoneSurface.read(bone)
    patient = label_interfaces(
        TetMesh.read(mesh), *head.label_map, surface.segments, surface, read_surface(skin), **interfaces
    )
    kinds = np.bincount(patient.node_type, minlength=4)
    logging.info("%d nodes: %d fixed, %d moving, %d sliding", kinds.sum(), *kinds[[FIXED, MOVING, SLIDING]])
    replace(patient, muscle=read_stored_json(report)["muscle"]).write(model)
