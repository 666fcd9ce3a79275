"""Bones of a virtual head: reference points and lines from the parameters, and the implicit skull and mandible.

Frame: LPS mm, x = 0 the midline, y = 0 the coronal plane of the tragi, z = 0 the Frankfort horizontal.
"""

from dataclasses import dataclass

import numpy as np

from pinnochio.virtual.implicit import Field, Shape, ellipsoid, plate, tube, wall
from pinnochio.virtual.parameters import REST_GAP, HeadParameters

SIDES = (1.0, -1.0)  # left, right


def resampled(line: np.ndarray, step: float = 1.0) -> np.ndarray:
    """Polyline (m, d) with points every `step` mm."""
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0, length[-1], int(length[-1] / step) + 1)
    return np.stack([np.interp(at, length, column) for column in line.T], 1)


def arch(front: float, half_width: float, depth: float) -> np.ndarray:
    """Elliptic dental arch (m, 2) in the axial plane, right to left, apex at y = front."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 181)
    return resampled(np.stack([half_width * np.sin(angle), front + depth * (1 - np.cos(angle))], 1))


@dataclass(frozen=True)
class Skeleton:
    """Reference geometry of one patient; points (3,) mm, `arch_*` axial polylines, all from the parameters."""

    p: HeadParameters

    def __post_init__(self):
        p = self.p
        put = lambda name, value: object.__setattr__(self, name, value)  # noqa: E731
        put("wide", p.face_width / 134.0)
        put("deep", p.face_depth / 90.0)
        put("tall", p.face_height / 119.0)
        top = 28.0 * self.tall
        spine_z = top - (1 - p.lower_share) * p.face_height
        a_y = -p.face_depth - p.maxilla_position
        put("nasion", np.array([0.0, -p.face_depth, top]))
        put("a_point", np.array([0.0, a_y, spine_z - 6]))
        put("spine", np.array([0.0, a_y - 3, spine_z]))
        upper = np.array([0.0, a_y - 4, spine_z - 0.43 * p.lower_share * p.face_height])
        lower_x = 0.8 * p.chin_deviation
        lower = np.array([lower_x, upper[1] + p.overjet, upper[2] - REST_GAP - p.open_bite])
        put("upper_incisor", upper)
        put("lower_incisor", lower)
        low = top - p.face_height
        pogonion = np.array([p.chin_deviation, lower[1] + 7.5 - p.chin_prominence, low + 9])
        put("pogonion", pogonion)
        put("menton", np.array([p.chin_deviation, pogonion[1] + 7, low]))
        put("condyle", np.array([50.0 * self.wide, -13.0, -4.0]))
        gonion_z = 1.0 - p.ramus_height
        reach = np.sqrt(max(p.mandible_length**2 - (gonion_z - pogonion[2]) ** 2, 0.0))
        gonion_y = np.clip(pogonion[1] + reach, -26.0, -5.0)
        put("gonion", np.array([p.gonial_width / 2, gonion_y, gonion_z]))
        depth = 45.0 * self.deep
        put("molar_y", upper[1] + depth)
        put("arch_upper", arch(upper[1] + 3, 25.5 * self.wide, depth))
        line = arch(lower[1] + 3, 24.5 * self.wide, self.molar_y - lower[1])
        line[:, 0] += 0.8 * p.chin_deviation * self.jaw_share(line[:, 1])
        put("arch_lower", line)

    def jaw_share(self, y):
        """Part of the chin's deviation that the mandible has at depth y: 0 at the condyles, 1 at the chin."""
        return np.clip((self.condyle[1] - y) / (self.condyle[1] - self.pogonion[1]), 0, 1)

    def upper_edge(self, y):
        """Height of the upper occlusal edges at depth y."""
        return self.upper_incisor[2] + 0.12 * (y - self.upper_incisor[1])

    def lower_edge(self, y):
        """Height of the lower occlusal edges: the incisor gap closes to the rest gap at the molars."""
        back = self.upper_edge(self.molar_y) - REST_GAP
        share = (y - self.lower_incisor[1]) / (self.molar_y - self.lower_incisor[1])
        return self.lower_incisor[2] + share * (back - self.lower_incisor[2])

    def cut_height(self, y):
        """Height of the Le Fort I cut at depth y: just above the nasal floor, falling to the tuberosity."""
        return self.spine[2] + 4.0 - 0.06 * (y - self.spine[1])

    def gonion_of(self, side: float) -> np.ndarray:
        """Gonion of the left (1) or right (-1) side with the cant of the jaw."""
        return self.gonion * [side, 1, 1] - [0, 0, side * self.p.occlusal_cant]

    def condyle_of(self, side: float) -> np.ndarray:
        """Centre of the condyle of one side."""
        return self.condyle * [side, 1, 1]

    def border(self) -> np.ndarray:
        """Centre line of the mandibular body, right gonion over the chin to left gonion, (m, 3); z the lower border."""
        chin = self.menton
        points = []
        for side in SIDES:
            go = self.gonion_of(side)
            mental = np.array([side * 19.0 * self.wide + chin[0], chin[1] + 7, chin[2] + 0.5])
            mid = 0.5 * (mental + go) + [side * 3.0, 2, -2.0]
            ante = np.array([side * 9.0 * self.wide + chin[0], chin[1] + 0.5, chin[2]])
            points.append([ante, mental, mid, go + [0, -6, 1]])
        return resampled(np.array([*points[1][::-1], *points[0]]))


def _crowns(line: np.ndarray) -> np.ndarray:
    """Relative thickness along an arch: one hump per tooth, eight on a side."""
    along = np.abs(np.arange(len(line)) - len(line) // 2) / len(line) * 2
    return 0.62 + 0.38 * np.sqrt(np.abs(np.sin(np.pi * 8.0 * along)))


def teeth(line: np.ndarray, deep: np.ndarray, edge: np.ndarray, half: float) -> Shape:
    """Tooth row along a dental arch between the gum height `deep` and the biting `edge`, scalloped into crowns."""
    along = np.abs(np.arange(len(line)) - len(line) // 2) / len(line) * 2
    thickness = (half + 2.0 * np.clip(3 * along - 0.8, 0, 1)) * _crowns(line)
    return wall(line, thickness, np.minimum(deep, edge), np.maximum(deep, edge), rounding=1.2)


def upper_skull(s: Skeleton, axes, reach: float) -> tuple[Field, Field]:
    """Cranium with the whole maxilla (not yet cut), and the cheek bones alone (the soft tissue needs those)."""
    w, d, t = s.wide, s.deep, s.tall
    nasion, spine = s.nasion, s.spine
    mid = spine[1] + 3 + s.p.face_depth  # maxilla behind the nasion vertical
    field = Field(axes, reach)
    vault = ellipsoid([0, 3, 52 * t], [65 * w, 3 + 94 * d, 80 * t])
    field.union(vault)
    # flat skull base
    base = field.axes[2][None, None, :] - 0.0
    field.values[:] = np.maximum(field.values, -(base + 4.0))
    brow = s.p.brow_prominence
    field.union(tube([[0, nasion[1] + 4, 38 * t], [0, nasion[1] + 3, 28 * t]], [6.5 + 0.5 * brow, 4.0]), k=8)
    cheeks = Field(axes, reach)
    for side in SIDES:

        def at(x, y, z, side=side):
            return [side * x * w, y * d, z * t]

        rim = [at(7, -91.5 - brow, 37), at(22, -88 - brow, 39), at(36, -80, 36), at(46.5, -70, 26)]
        field.union(tube(rim, [4.5, 4.5, 4.5, 4]), k=6)
        field.union(tube([at(46.5, -70, 26), at(48, -66, 12), at(47, -66, -2)], [4, 3.2, 5]), k=4)
        infra = [at(47, -66, -4), at(36, -76, -4), at(23, -81, -3), at(13, -84, 6), at(8, -87, 22)]
        field.union(tube(infra, [6, 5, 4, 3.4, 3.4]), k=4)
        nose = [
            nasion + [side * 2.5, 1.5, -2],
            [side * 3.2, nasion[1] - 4.5, 14 * t],
            [side * 3.5, nasion[1] - 8.5, 6 * t],
        ]
        field.union(tube(nose, [3.2, 2.6, 1.9]), k=4)
        side_wall = [
            at(8, -86, 14),
            [side * 11.5 * w, -82 * d + mid * 0.5, -4 * t],
            [side * 14 * w, -81 * d + mid, spine[2] + 3],
        ]
        field.union(tube(side_wall, [3.4, 3.2, 4.5]), k=5)
        body = ellipsoid(at(47, -62, -7), [9 * w, 11 * d, 9.5 * t], tilt=20)
        arch_ = tube(
            [at(47, -60, -6), at(53, -48, -4), at(56, -32, -1), at(56, -14, 3), at(54, -2, 6)], [6, 4, 3.4, 4, 6]
        )
        cheeks.union(body, k=0).union(arch_, k=5)
        buttress = tube([at(44, -62, -12), [side * 31 * w, -60 * d + mid, spine[2] - 4]], [6, 6])
        field.union(buttress, k=6)
        field.union(ellipsoid([side * 55 * w, 2, 2], [8, 13, 11]), k=4)  # temporal bone beside the joint
    field.values[:] = np.minimum(field.values, cheeks.values)
    # maxilla
    floor = spine[2]
    field.union(ellipsoid([0, -54 * d + mid, floor / 2 + 1], [36 * w, 30 * d, 0.5 * abs(floor) + 11]), k=6)
    field.union(ellipsoid([0, -36, -4], [26 * w, 26, 12]), k=6)
    line = s.arch_upper + [0, 4.5]
    crest = s.upper_edge(line[:, 1]) + 9.0
    thick = 5.0 + 1.5 * np.clip(np.abs(line[:, 0]) / 20, 0, 1) + 0.8 * (_crowns(line) - 0.8)
    field.union(wall(line, thick, crest, np.full(len(line), floor + 5), rounding=3), k=5)
    # openings
    for side in SIDES:
        x = side * (s.p.eye_spacing / 2 + 1.5)
        field.subtract(ellipsoid([x, -70 * d, 15 * t], [18.5 * w, 27 * d, 16.5 * t]), k=3)
        field.subtract(ellipsoid([side * 6 * w, spine[1] + 6, floor + 8.5], [6.2 * w, 14, 8.5]), k=2)
    field.subtract(ellipsoid([0, spine[1] + 4, floor + 16], [6.5 * w, 14, 15 * t]), k=2)
    field.union(tube([spine + [0, 16, 0], spine + [0, 1.5, 0]], [2.6, 1.5]), k=2)
    field.union(teeth(s.arch_upper, crest + 3, s.upper_edge(s.arch_upper[:, 1]), 3.4), k=1.5)
    return field, cheeks


def mandible(s: Skeleton, axes, reach: float) -> Field:
    """Whole mandible with the lower tooth row (not yet split)."""
    p = s.p
    field = Field(axes, reach)
    border = s.border()
    top = np.minimum(border[:, 2] + 21, s.lower_edge(border[:, 1]) - 12)
    back = np.clip((border[:, 1] - s.molar_y) / 10, 0, 1)
    top = (1 - back) * top + back * (border[:, 2] + 20)
    field.union(wall(border[:, :2], 5.8 - 1.2 * back, border[:, 2], np.maximum(top, border[:, 2] + 12), rounding=4))
    line = s.arch_lower + [0, 1] * np.array([0, 4.5])
    share = np.interp(line[:, 0], border[:, 0], border[:, 2])
    cant = -0.3 * p.occlusal_cant * line[:, 0] / 25
    edge = s.lower_edge(s.arch_lower[:, 1]) + cant
    field.union(
        wall(
            line,
            5.0 + 1.0 * np.clip(np.abs(line[:, 0]) / 20, 0, 1),
            np.maximum(share + 9, edge - 24),
            edge - 9,
            rounding=3,
        ),
        k=8,
    )
    chin, dev = s.pogonion, p.chin_deviation
    field.union(ellipsoid([dev, chin[1] + 7, chin[2] + 1], [13, 7, 9]), k=6)
    for side in SIDES:
        go, co = s.gonion_of(side), s.condyle_of(side)

        def centre(y, z, side=side, go=go, co=co):
            rise = np.clip((z - go[2]) / (co[2] - go[2]), -0.2, 1)
            flare = np.clip(go[1] - 8 - y, 0, 32) * (1 - 0.8 * np.clip(rise, 0, 1))  # narrower towards the teeth
            return np.float32(go[0]) + np.float32(co[0] - side - go[0]) * rise - np.float32(0.3 * side) * flare

        front = s.molar_y + 3
        edge_low, edge_up = s.lower_edge(front) - 9, s.upper_edge(front) + 2
        coronoid = [[front + 7, -14], [front + 7, -1], [front + 11, 0], [front + 15, -9]]
        neck = [[-23, -14], [-18, -8], [-14, -4], [-9, -6], [-9.5, -16]]
        rear = [
            [0.5 * (go[1] - 8), go[2] + 20],
            [go[1] + 3, go[2] + 6],
            [go[1] - 2, go[2] - 1],
            [go[1] - 12, go[2] - 1],
        ]
        outline = [[front + 1, edge_low], [front + 4, edge_up], *coronoid, *neck, *rear, [front + 1, go[2] - 7]]
        field.union(plate(np.array(outline), centre, 4.0, rounding=2), k=5)
        field.union(ellipsoid(co, [8.5, 4.5, 5.0]), k=3)
    field.union(teeth(s.arch_lower, edge - 12, edge, 3.1), k=1.5)
    return field


def split_sides(s: Skeleton, x: np.ndarray, y: np.ndarray, z: np.ndarray, side: float) -> np.ndarray:
    """Where the sagittal split leaves mandible with the ramus of one side (proximal segment).

    Lateral plate from the second molar back, whole thickness behind the lingula and above it.
    """
    border = s.border()
    half = border[border[:, 0] * side > abs(s.menton[0])]
    half = half[np.argsort(half[:, 1])]
    middle = np.interp(y, half[:, 1], half[:, 0] * side).astype(np.float32)
    lateral = (x * side > middle) & (y > s.lower_incisor[1] + 37 * s.deep)
    lateral &= np.abs(x) > 28 * s.wide
    return (x * side > 0) & (
        lateral
        | (y > s.gonion[1] - 12) & (y > s.molar_y + 12)
        | (z > s.upper_edge(s.molar_y) + 14)
        | (z > s.upper_edge(s.molar_y) - 1) & (y > s.molar_y + 6)
    )
