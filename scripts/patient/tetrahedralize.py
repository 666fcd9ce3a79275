"""Makes the tetrahedral mesh of muscle and superficial tissue of a label map."""

import logging

from pinnochio.importing.segmentation import read_labels
from pinnochio.meshing.tetrahedralize import tetrahedralize


def mesh_case(labels: str, nodes: int, minimum_dihedral: float, mesh: str) -> None:
    """Mesh an imported label map with `nodes` nodes (within 10 %) and dihedral angles of at least minimum_dihedral."""
    result = tetrahedralize(*read_labels(labels).label_map, nodes, minimum_dihedral=minimum_dihedral)
    logging.info("%d nodes, %d tetrahedra", len(result.points), len(result.cells))
    result.write(mesh)
