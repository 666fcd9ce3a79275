"""Linear tetrahedra: energy and internal force of a mesh, compiled, summed in a fixed order.

The bulk term alone is averaged over patches of elements,

    W = sum_e V_e [mu/2 (I1 - 3) + stiffening/2 (I1 - 3)^2 - mu ln J_e] + sum_p V_p lam_p/2 (ln J_p)^2,
    J_p = sum_{e in p} V_e J_e / V_p,    V_p = sum V_e,    lam_p = sum V_e lam_e / V_p.

Two volumetric options: "p1", every element its own patch, the plain linear tetrahedron; "patch", patches of
neighbours in one tissue (:mod:`pinnochio.mechanics.elements.patches`), which do not lock: fewer constraints than
unknowns [S: F-bar patches, de Souza Neto 2005]. -mu ln J stays with the element: it holds up each element's J where
averaging would let one collapse beside another, and it cancels mu/2 (I1 - 3) at rest element by element, so that the
rest state is free of stress where tissues meet. A uniform J gives the same energy in both, so the patch test holds and
the linearisation is isotropic elasticity. The force is the exact gradient of W.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pinnochio.compiled import compiled
from pinnochio.errors import InputError
from pinnochio.geometry.mesh_topology import edges_of
from pinnochio.mechanics.elements.materials import Material
from pinnochio.mechanics.elements.patches import make_patches

VOLUMETRIC = ("patch", "p1")
RELATIVE_ROUND_OFF = 1e-13  # of an energy that is far from that at rest


class ElementArrays(NamedTuple):
    """What the compiled kernels read of :class:`Elements` and of its :class:`Material`, by the same names."""

    cells: np.ndarray
    gradients: np.ndarray
    volumes: np.ndarray
    patch: np.ndarray
    patch_volumes: np.ndarray
    patch_lam: np.ndarray
    mu: np.ndarray
    stiffening: np.ndarray
    extension: float


@dataclass(frozen=True)
class Elements:
    """Geometry and constants of a mesh at rest.

    cells (m, 4) int32; gradients (m, 4, 3) of the shape functions, 1/mm; volumes (m,) mm3; patch (m,) int32, the
    patch of each element; patch_volumes (p,) mm3, patch_lam (p,) kPa; nodes: their number; edge: mean edge length in
    mm; modulus: mean mu in kPa.
    """

    cells: np.ndarray
    gradients: np.ndarray
    volumes: np.ndarray
    patch: np.ndarray
    patch_volumes: np.ndarray
    patch_lam: np.ndarray
    material: Material
    nodes: int
    edge: float
    modulus: float

    @classmethod
    def build(cls, points, cells, material: Material, volumetric: str = VOLUMETRIC[0]) -> "Elements":
        """Check a mesh, points (n, 3) mm and cells (m, 4) of positive volume, and measure it."""
        points, cells = check_mesh(points, cells)
        if volumetric not in VOLUMETRIC:
            raise InputError("-", "options", f"volumetric is {volumetric!r}", f"choose one of {VOLUMETRIC}")
        if len(material.mu) != len(cells):
            raise InputError(
                "-", "material", f"{len(material.mu)} constants for {len(cells)} cells", "give one per cell"
            )
        gradients, volumes = shape_gradients(points, cells)
        patch = np.arange(len(cells), dtype=np.int32)
        if volumetric == "patch":
            patch = make_patches(points, cells, material.lam)
        patch_volumes = np.bincount(patch, volumes)
        patch_lam = np.bincount(patch, volumes * material.lam) / patch_volumes
        mean_mu = float(np.average(material.mu, weights=volumes))
        edge = mean_edge(points, cells)
        return cls(cells, gradients, volumes, patch, patch_volumes, patch_lam, material, len(points), edge, mean_mu)

    @property
    def arrays(self) -> ElementArrays:
        """What the compiled kernels take."""
        fields, law = vars(self), vars(self.material)
        return ElementArrays(**{name: fields[name] if name in fields else law[name] for name in ElementArrays._fields})

    @property
    def round_off(self) -> float:
        """Round-off, mN mm, of the energy, a sum over all elements, near rest."""
        return 1e-14 * self.modulus * self.volumes.sum()

    def noise(self, energy: float) -> float:
        """Round-off, mN mm, of an energy in mN mm: below it the energy cannot tell two states apart."""
        return self.round_off + RELATIVE_ROUND_OFF * abs(energy)

    def of(self, material: Material) -> "Elements":
        """The same mesh of a material with other constants, tissue by tissue."""
        lam = np.bincount(self.patch, self.volumes * material.lam) / self.patch_volumes
        mean_mu = float(np.average(material.mu, weights=self.volumes))
        return replace(self, material=material, patch_lam=lam, modulus=mean_mu)

    def with_extension(self, extension: float) -> "Elements":
        """The same mesh with ln J replaced by its Taylor polynomial below another J."""
        return replace(self, material=replace(self.material, extension=extension))

    def evaluate(self, displacement) -> tuple[float, np.ndarray, float]:
        """Energy in mN mm, internal force (n, 3) in mN and least J of a displacement (n, 3) mm."""
        energy, force, least, _ = self._measured(displacement, 0)
        return energy, force, least

    def measure(self, displacement) -> tuple[float, np.ndarray, np.ndarray]:
        """Energy in mN mm, internal force (n, 3) in mN and, of each element, J and I1 (m, 2) of a displacement
        (n, 3) mm."""
        energy, force, _, state = self._measured(displacement, len(self.cells))
        return energy, force, state

    def _measured(self, displacement, count: int) -> tuple[float, np.ndarray, float, np.ndarray]:
        force, state = np.zeros((self.nodes, 3)), np.empty((count, 2))
        energy, least = _evaluate(np.ascontiguousarray(displacement, float), self.arrays, force, state)
        return energy, force, least, state


def least_reaction(mesh: Elements, unknowns: int) -> float:
    """Force, mN, on so many constrained unknowns at a strain of 1e-4: what a residual is measured by where the load
    needs no force, as in a rigid motion."""
    return max(1e-4 * mesh.modulus * mesh.edge**2 * np.sqrt(unknowns), np.finfo(float).tiny)


def check_mesh(points, cells) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) float and cells (m, 4) int32, or InputError that says what is wrong with them."""
    points, cells = np.ascontiguousarray(points, float), np.ascontiguousarray(cells, np.int32)
    if points.ndim != 2 or points.shape[1] != 3 or cells.ndim != 2 or cells.shape[1:] != (4,) or not len(cells):
        raise InputError("-", "mesh", f"shapes {points.shape} and {cells.shape}", "give (n, 3) and (m, 4)")
    if not np.isfinite(points).all():
        raise InputError("-", "mesh", "a point is not finite", "mend the points")
    if cells.min() < 0 or cells.max() >= len(points):
        raise InputError("-", "mesh", "a cell names a point that does not exist", "mend the cells")
    edges = _edges(points, cells)
    # 1e-12: below it the gradients of a sliver have no correct digit left.
    flat = np.linalg.det(edges) <= 1e-12 * np.linalg.norm(edges, axis=2).max(axis=1) ** 3
    if flat.any():
        raise InputError("-", "mesh", f"{flat.sum()} cells have no positive volume", "orient or drop them")
    return points, cells


def shape_gradients(points, cells) -> tuple[np.ndarray, np.ndarray]:
    """Gradients (m, 4, 3) 1/mm of the linear shape functions and volumes (m,) mm3."""
    edges = _edges(points, cells)
    rest = np.linalg.inv(edges).transpose(0, 2, 1)
    gradients = np.concatenate([-rest.sum(axis=1, keepdims=True), rest], axis=1)
    return np.ascontiguousarray(gradients), np.linalg.det(edges) / 6


def cell_volumes(points, cells) -> np.ndarray:
    """Volume (m,) mm3 of every cell, negative where it is inside out."""
    return np.linalg.det(_edges(points, cells)) / 6


def _edges(points, cells) -> np.ndarray:
    """Edges (m, 3, 3) mm of every cell from its first corner."""
    x = np.asarray(points, float)[cells]
    return x[:, 1:] - x[:, :1]


def lumped(cells, amounts, nodes: int) -> np.ndarray:
    """Amounts (m,) of the cells (m, 4) at their nodes (nodes,): a quarter of each at every corner."""
    return np.bincount(cells.ravel(), np.repeat(amounts / 4, 4), nodes)


def node_volumes(points, cells) -> np.ndarray:
    """Tissue (n,) mm3 that belongs to each node: a quarter of its cells."""
    return lumped(cells, cell_volumes(points, cells), len(points))


def mean_edge(points, cells) -> float:
    """Mean length in mm of the edges of the cells."""
    one, two = edges_of(cells)[0].T
    return float(np.linalg.norm(points[one] - points[two], axis=1).mean())


def jacobians(points, cells, displacement) -> np.ndarray:
    """det F (m,) of every cell under a displacement (n, 3) mm."""
    rest, ratios = np.asarray(points, float), np.empty(len(cells))
    _ratios(rest, rest + displacement, np.asarray(cells), ratios)
    return ratios


@compiled
def _ratios(rest, moved, cells, ratios):
    for e in range(len(cells)):
        ratios[e] = _volume(moved, cells[e]) / _volume(rest, cells[e])


@compiled
def _volume(x, cell):
    """Six times the signed volume of a tetrahedron."""
    a, b, c, d = cell
    p0, p1, p2 = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    q0, q1, q2 = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
    r0, r1, r2 = x[d, 0] - x[a, 0], x[d, 1] - x[a, 1], x[d, 2] - x[a, 2]
    return p0 * (q1 * r2 - q2 * r1) + p1 * (q2 * r0 - q0 * r2) + p2 * (q0 * r1 - q1 * r0)


@compiled
def extended_log(j, extension):
    """ln J and its first two derivatives, extended below `extension` by the Taylor polynomial there."""
    if j >= extension:
        return np.log(j), 1 / j, -1 / (j * j)
    d = (j - extension) / extension
    return np.log(extension) + d - 0.5 * d * d, (1 - d) / extension, -1 / (extension * extension)


@compiled
def cofactor(f, cof):
    """Cofactor of f (3, 3) into `cof`."""
    for i in range(3):
        p, q = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            r, s = (j + 1) % 3, (j + 2) % 3
            cof[i, j] = f[p, r] * f[q, s] - f[p, s] * f[q, r]


@compiled
def deformation(u, cell, gradient, f, cof):
    """F into `f`, its cofactor into `cof`; returns J and I1 - 3 (free of cancellation near rest)."""
    excess = 0.0
    for i in range(3):
        for j in range(3):
            h = 0.0
            for a in range(4):
                h += u[cell[a], i] * gradient[a, j]
            excess += h * h + (2 * h if i == j else 0.0)
            f[i, j] = h + (1.0 if i == j else 0.0)
    cofactor(f, cof)
    return f[0, 0] * cof[0, 0] + f[0, 1] * cof[0, 1] + f[0, 2] * cof[0, 2], excess


@compiled
def bulk_energy(ratio, mesh: ElementArrays, first, second):
    """Energy of all patches, whose volumes are now `ratio` (p,) mm3; first, second: as in :func:`patch_bulk`."""
    energy = 0.0
    for p in range(len(mesh.patch_volumes)):
        volume, lam = mesh.patch_volumes[p], mesh.patch_lam[p]
        log, d, dd = extended_log(ratio[p] / volume, mesh.extension)
        energy += 0.5 * volume * lam * log * log
        first[p] = lam * log * d
        second[p] = lam * (d * d + log * dd)
    return energy


@compiled
def patch_bulk(u, mesh: ElementArrays, first, second):
    """dU/dJ_p and d2U/dJ_p2 of each patch, U = lam_p/2 (ln J_p)^2; returns the energy of all."""
    f, cof = np.empty((3, 3)), np.empty((3, 3))
    ratio = np.zeros(len(mesh.patch_volumes))
    for e in range(len(mesh.cells)):
        j, _ = deformation(u, mesh.cells[e], mesh.gradients[e], f, cof)
        ratio[mesh.patch[e]] += mesh.volumes[e] * j
    return bulk_energy(ratio, mesh, first, second)


@compiled
def _evaluate(u, mesh: ElementArrays, force, state):
    """Adds to force (n, 3); J and I1 of the elements go into state (m, 2), which may be empty."""
    count, patches = len(mesh.cells), len(mesh.patch_volumes)
    fs, cof, js = np.empty((count, 3, 3)), np.empty((3, 3)), np.empty((count, 2))
    ratio, first, second = np.zeros(patches), np.empty(patches), np.empty(patches)
    for e in range(count):
        js[e] = deformation(u, mesh.cells[e], mesh.gradients[e], fs[e], cof)
        ratio[mesh.patch[e]] += mesh.volumes[e] * js[e, 0]
    energy, least = bulk_energy(ratio, mesh, first, second), np.inf
    for e in range(count):
        cell, volume, mu, stiffening = mesh.cells[e], mesh.volumes[e], mesh.mu[e], mesh.stiffening[e]
        f, j, excess = fs[e], js[e, 0], js[e, 1]
        cofactor(f, cof)
        least = min(least, j)
        if len(state):
            state[e, 0], state[e, 1] = j, excess + 3
        log, d, _ = extended_log(j, mesh.extension)
        energy += volume * (0.5 * mu * excess + 0.5 * stiffening * excess**2 - mu * log)
        shear = volume * (mu + 2 * stiffening * excess)
        bulk = volume * (first[mesh.patch[e]] - mu * d)
        for i in range(3):
            p0 = shear * f[i, 0] + bulk * cof[i, 0]
            p1 = shear * f[i, 1] + bulk * cof[i, 1]
            p2 = shear * f[i, 2] + bulk * cof[i, 2]
            for a in range(4):
                g = mesh.gradients[e, a]
                force[cell[a], i] += p0 * g[0] + p1 * g[1] + p2 * g[2]
    return energy, least
