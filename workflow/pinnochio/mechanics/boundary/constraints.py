"""The boundary condition of one mesh, checked: which unknowns it fixes, and the axes that sliding nodes have."""

import copy

import numpy as np

from pinnochio.errors import InputError
from pinnochio.geometry.mesh_topology import pieces
from pinnochio.mechanics.boundary.conditions import BoundaryConditions
from pinnochio.mechanics.boundary.sliding import SlidingSurfaces


class Constraints:
    """Prescribed and sliding nodes of a mesh, points (n, 3) mm and cells (m, 4).

    constrained (n, 3) bool: unknowns that the boundary condition fixes, in local axes; sliding: the sliding sets;
    prescribed (p,): prescribed nodes. InputError if a node does not exist or has two conditions, or if a piece of the
    mesh could move as a whole.
    """

    def __init__(self, points, cells, boundary: BoundaryConditions):
        self.points, self.boundary = np.asarray(points, float), boundary
        self.sliding = SlidingSurfaces(self.points, boundary.sliding)
        self.prescribed = np.asarray(boundary.prescribed_nodes, int)
        self._check()
        self.constrained = np.zeros((len(self.points), 3), bool)
        self.constrained[self.prescribed] = True
        self.constrained[self.sliding.nodes, 0] = True
        self._check_pieces(cells)

    def under(self, boundary: BoundaryConditions) -> "Constraints":
        """The same constraints under another motion: what was measured of mesh and surfaces is kept."""
        prescribed = np.asarray(boundary.prescribed_nodes, int)
        sliding = np.concatenate([np.zeros(0, int)] + [np.asarray(item.nodes, int) for item in boundary.sliding])
        if not (np.array_equal(prescribed, self.prescribed) and np.array_equal(sliding, self.sliding.nodes)):
            raise InputError("-", "boundary", "constrains other nodes than the factors are of", "make a new solver")
        other = copy.copy(self)
        other.boundary, other.sliding = boundary, self.sliding.under(boundary.sliding)
        return other

    def motions(self) -> np.ndarray:
        """Displacement (n, 3) mm of the constrained nodes at full load, sliding ones carried; zero elsewhere."""
        moved = np.zeros_like(self.points)
        moved[self.prescribed] = self.boundary.displacement(1.0)
        for item in self.sliding.sets:
            moved[item.nodes] = item.motion(1.0).displacement(self.points[item.nodes])
        return moved

    def met(self, displacement, fraction: float) -> np.ndarray:
        """The admissible displacement (n, 3) next to another one."""
        target = np.array(displacement, float)
        self.sliding.at(fraction).project(target)
        target[self.prescribed] = self.boundary.displacement(fraction)
        return target

    def local(self, vectors, frames) -> np.ndarray:
        """Vectors (n, 3) with those of the sliding nodes in their own axes, frames (s, 3, 3)."""
        turned = np.array(vectors)
        turned[self.sliding.nodes] = np.einsum("sij,sj->si", frames, turned[self.sliding.nodes])
        return turned

    def world(self, vectors, frames) -> np.ndarray:
        """Vectors (n, 3) with those of the sliding nodes back in the common axes."""
        turned = np.array(vectors)
        turned[self.sliding.nodes] = np.einsum("sij,si->sj", frames, turned[self.sliding.nodes])
        return turned

    def turned(self, blocks, pairs, frames) -> np.ndarray:
        """Blocks (k, 3, 3) of a tangent at node pairs (k, 2), from the common axes into those of their nodes."""
        return turned(blocks, pairs, len(self.points), self.sliding.nodes, frames)

    def _check(self) -> None:
        fixed = np.concatenate([self.prescribed, self.sliding.nodes])
        if len(fixed) and (fixed.min() < 0 or fixed.max() >= len(self.points)):
            raise InputError("-", "boundary", "a constrained node does not exist", "mend the node list")
        if len(np.unique(fixed)) != len(fixed):
            raise InputError("-", "boundary", "a node is constrained twice", "give each node one condition")
        for fraction in (0.0, 1.0):
            moved = self.boundary.displacement(fraction)
            if moved.shape != (len(self.prescribed), 3) or not np.isfinite(moved).all():
                raise InputError("-", "boundary", f"prescribed motion of shape {moved.shape}", "give (p, 3), finite")

    def _check_pieces(self, cells) -> None:
        """Refuse a boundary condition that leaves a connected piece of the mesh a rigid motion, to first order."""
        piece = pieces(cells, len(self.points))
        axes = np.tile(np.eye(3), (len(self.points), 1, 1))
        axes[self.sliding.nodes] = self.sliding.bones.frames
        node, axis = np.nonzero(self.constrained)
        direction = axes[node, axis]
        for index in np.unique(piece[cells[:, 0]]):
            inside = piece == index
            arm = self.points - self.points[inside].mean(axis=0)
            arm /= np.linalg.norm(arm[inside], axis=1).max()
            here = inside[node]
            rows = np.hstack([direction[here], np.cross(arm[node[here]], direction[here])])
            # 1e-6: the squared lever, relative to the piece, below which a constraint counts as none.
            if np.linalg.eigvalsh(rows.T @ rows)[0] < 1e-6:
                problem = f"a piece of {inside.sum()} of the mesh's nodes is free to move or turn as a whole"
                raise InputError("-", "boundary", problem, "constrain three nodes of it, or drop it from the mesh")


def turned(blocks, pairs, count: int, nodes, frames) -> np.ndarray:
    """Blocks (k, 3, 3) at pairs (k, 2) of `count` nodes, from the common axes into those, frames (s, 3, 3), that some
    nodes (s,) have."""
    axes = np.tile(np.eye(3), (count, 1, 1))
    axes[nodes] = frames
    return axes[pairs[:, 0]] @ blocks @ axes[pairs[:, 1]].transpose(0, 2, 1)
