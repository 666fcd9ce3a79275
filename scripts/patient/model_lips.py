"""Makes the mesh that resolves the lips of a mesh, by bisection around the mouth."""

import logging

from pinnochio.importing.segmentation import read_labels
from pinnochio.meshing.interfaces import opposing_pairs
from pinnochio.meshing.lips import bite
from pinnochio.meshing.mesh import TetMesh
from pinnochio.meshing.refinement import refine_mouth
from pinnochio.model.surfaces import BoneSurface


def refine_lips(mesh: str, labels: str, bone: str, sliding_band: float, lip_edge: float, lips: str) -> None:
    """Write the mesh whose edges around the mouth have `lip_edge` mm in the mean; the mesh itself if there is no bite.

    sliding_band in mm: as for the interfaces, which find the bite by it too.
    """
    head, surface, coarse = read_labels(labels), BoneSurface.read(bone), TetMesh.read(mesh)
    pairs = opposing_pairs(surface, *head.label_map, surface.segments, sliding_band)
    fine = refine_mouth(coarse, bite(surface, pairs, sliding_band), lip_edge)
    for name, one in (("before", coarse), ("after", fine)):
        logging.info("%s: %d nodes, smallest dihedral angle %.1f", name, len(one.points), one.dihedral_angles().min())
    fine.write(lips)
