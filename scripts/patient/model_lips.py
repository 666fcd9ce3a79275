"""Makes the mesh that resolves the lips of a mesh, by bisection around the mouth, with its model."""

import logging

from pinnochio.importing.segmentation import read_labels
from pinnochio.logs import attach_log
from pinnochio.meshing.interfaces import opposing_pairs
from pinnochio.meshing.lips import bite
from pinnochio.meshing.mesh import TetMesh
from pinnochio.meshing.refinement import refine_mouth
from pinnochio.model.surfaces import BoneSurface
from scripts.cohort.carry_truth import carry_truth
from scripts.patient.label_interfaces import label_case


def refine_lips(mesh: str, labels: str, bone: str, sliding_band: float, lip_edge: float, lips: str) -> None:
    """Write the mesh whose edges around the mouth have `lip_edge` mm in the mean; the mesh itself if there is no bite.

    sliding_band in mm: as for the interfaces, which find the bite by it too.
    """
    head, surface, coarse = read_labels(labels), BoneSurface.read(bone), TetMesh.read(mesh)
    pairs = opposing_pairs(
        bone=surface,
        labels=head.labels,
        spacing=head.spacing,
        origin=head.origin,
        segments=surface.segments,
        band=sliding_band,
    )
    fine = refine_mouth(coarse, bite(surface, pairs, sliding_band), lip_edge)
    for name, one in (("before", coarse), ("after", fine)):
        logging.info("%s: %d nodes, smallest dihedral angle %.1f", name, len(one.points), one.dihedral_angles().min())
    fine.write(lips)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    files, outputs, interfaces = snakemake.input, snakemake.output, snakemake.params.interfaces
    imported = {name: files[name] for name in ("labels", "bone", "skin", "report")}
    refine_lips(
        mesh=files.mesh,
        labels=files.labels,
        bone=files.bone,
        sliding_band=interfaces["sliding_band"],
        lip_edge=snakemake.params.lip_edge,
        lips=outputs.mesh,
    )
    label_case(**imported, mesh=outputs.mesh, interfaces=interfaces, model=outputs.model)
    if files.truth:
        carry_truth(case=snakemake.wildcards.case, truth=files.truth, model=outputs.model, motion=outputs.motion)
