"""Bones of a virtual head: reference points and lines from the parameters, and the implicit skull and mandible.

Frame: LPS mm, x = 0 the midline, y = 0 the coronal plane of the tragi, z = 0 the Frankfort horizontal.
"""

import numpy as np
from scipy.optimize import least_squares

from pinnochio.virtual.implicit import Field, Shape, ellipsoid, plate, rounded, smooth_minimum, tube, wall
from pinnochio.virtual.parameters import REST_GAP, TABLE, HeadParameters

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


class Skeleton:
    """Reference geometry of one patient; points (3,) mm, `arch_*` axial polylines, all from the parameters."""

    def __init__(self, p: HeadParameters):
        self.p = p
        self.wide = p.face_width / 134.0
        self.deep = p.face_depth / 90.0
        here = p.scanned.anchors
        self.tall, top, spine_z = here.tall, here.nasion, here.spine
        a_y = -p.face_depth - p.maxilla_position
        self.nasion = np.array([0.0, -p.face_depth, top])
        self.a_point = np.array([0.0, a_y, spine_z - 6])
        self.spine = np.array([0.0, a_y - 3, spine_z])
        upper = np.array([0.0, a_y - here.incisor_ahead, here.incisor])
        lower_x = 0.8 * p.chin_deviation
        lower = np.array([lower_x, upper[1] + p.overjet, upper[2] - REST_GAP - p.open_bite])
        self.upper_incisor = upper
        self.lower_incisor = lower
        low = top - p.face_height
        pogonion = np.array([p.chin_deviation, lower[1] + 7.0 - p.chin_prominence, low + here.chin_height])
        self.pogonion = pogonion
        self.menton = np.array([p.chin_deviation, pogonion[1] + 7, low])
        self.condyle = np.array([50.0 * self.wide, -10.5, -4.0])
        self.gonion = np.array([p.gonial_width / 2, *self._gonion()])
        self.molar_y = upper[1] + here.arch_depth
        self.arch_upper = arch(upper[1] + 3, here.arch_half_width, here.arch_depth)
        line = arch(lower[1] + 3, here.arch_half_width - self.wide, self.molar_y - lower[1])
        line[:, 0] += 0.8 * p.chin_deviation * self.jaw_share(line[:, 1])
        self.arch_lower = line

    def _gonion(self) -> np.ndarray:
        """Sagittal place (y, z) of the gonion that suits ramus, body and angle best, each weighted by its spread.

        The bite sets condyle and chin; three sampled lengths and angles meet in a point only nearly.
        """
        p, top, chin = self.p, self.condyle[1:] + [0, 5], self.pogonion[1:]

        def misfit(gonion):
            ramus, body = top - gonion, chin - gonion
            lengths = np.linalg.norm(ramus), np.linalg.norm(body)
            angle = np.degrees(np.arccos(ramus @ body / (lengths[0] * lengths[1])))
            wanted = ((p.ramus_height, "ramus_height"), (p.mandible_length, "mandible_length"))
            miss = [(f - a) / TABLE[n].sd for f, (a, n) in zip(lengths, wanted, strict=True)]
            return [*miss, (angle - p.gonial_angle) / TABLE["gonial_angle"].sd]

        return least_squares(misfit, [-14.0, top[1] - p.ramus_height], bounds=([-30, -80], [-4, -30])).x

    @property
    def gonial_angle(self) -> float:
        """Angle (degrees) at gonion between condyle and pogonion, sagittal."""
        ramus, body = self.condyle[1:] + [0, 5] - self.gonion[1:], self.pogonion[1:] - self.gonion[1:]
        return float(np.degrees(np.arccos(ramus @ body / np.linalg.norm(ramus) / np.linalg.norm(body))))

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
            mental = np.array([side * 19.0 * self.wide + chin[0], chin[1] + 8, chin[2] + 2.0])
            mid = 0.5 * (mental + go) + [side * 3.0, 2, -2.0]
            ante = np.array([side * 7.0 * self.wide + chin[0], chin[1] + 0.5, chin[2]])
            points.append([ante, mental, mid - [side * 2, 0, 0], go + [-side * 4, -6, 1]])
        return resampled(np.array([*points[1][::-1], *points[0]]))


# Mesiodistal and buccolingual widths and heights of the crowns, first incisor to second molar, mm [R].
UPPER_TEETH = np.array([[8.5, 6.6, 7.6, 7, 6.8, 10.2, 9.6], [7, 6.2, 7.6, 8.6, 8.8, 10.5, 10.5],
                        [10.5, 9.5, 10.5, 8.5, 8, 7.5, 7]]).T  # fmt: skip
LOWER_TEETH = np.array([[5.4, 6, 6.9, 7, 7.2, 11, 10.5], [6.2, 6.4, 7.2, 7.6, 8, 9.8, 9.6],
                        [9, 9.5, 10.5, 8.5, 8, 7.5, 7]]).T  # fmt: skip
ALVEOLUS = 9.0  # mm from the biting edge to the crest of the bone [R]


def tooth_row(line: np.ndarray, edge, sizes: np.ndarray, up: float) -> list[Shape]:
    """Crowns and necks along a dental arch (m, 2), labial faces on the line, biting edges at the heights edge (m,).

    sizes (7, 3) as above, scaled to the arch; `up` +1 for the upper row (the roots point up), -1 for the lower.
    """
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    apex = length[np.argmin(line[:, 1])]
    # What fills the gaps between the crowns to a groove of 1 mm: lips slide over the row as over one surface.
    ends = np.stack([edge + up * 1.0, edge + up * 12.0])
    row = [wall(line * [0.87, 1] + [0, 3.3], 2.3, ends.min(0), ends.max(0), rounding=1)]
    for side in SIDES:
        room = length[-1] - apex if side > 0 else apex
        scale = room / sizes[:, 0].sum()
        for (width, across, height), end in zip(sizes, np.cumsum(sizes[:, 0]), strict=True):
            at = apex + side * scale * (end - width / 2)
            centre, ahead = ([np.interp(at + step, length, column) for column in line.T] for step in (0, 0.5))
            along = np.subtract(ahead, centre)
            half = np.array([scale * width - 0.7, across, height + 3]) / 2  # the neck goes 3 mm into the bone
            tip = np.interp(at, length, np.broadcast_to(edge, len(line)))
            row.append(_crown(np.array([*centre, tip]), along / np.linalg.norm(along), half, up, width < 7.9))
    return row


def _crown(tip: np.ndarray, along: np.ndarray, half: np.ndarray, up: float, front: bool) -> Shape:
    """Rounded box behind `tip`, the middle of its labial edge; front teeth thin out towards the edge."""
    inward = np.float32([-along[1], along[0]])  # to the inside of the arch
    along, half, tip = np.float32(along), np.float32(half), np.float32(tip)
    rounding, corner = np.float32(1.6), np.float32(0.75) * half[:2].min()

    def distance(x, y, z):
        dx, dy, height = x - tip[0], y - tip[1], (z - tip[2]) * np.float32(up)
        u = np.abs(dx * along[0] + dy * along[1]) - half[0]
        depth = half[1] * (np.clip(0.45 + height / 12, 0.45, 1) if front else 1)
        v = np.abs(dx * inward[0] + dy * inward[1] - depth) - depth
        w = np.abs(height - half[2]) - half[2]
        u, v = u + corner, v + corner
        flat = rounded(u, v) - corner + rounding
        return rounded(flat, w + rounding) - rounding

    reach = np.hypot(half[0], 2 * half[1])
    centre = tip + np.float32([0, 0, up * half[2]])
    extent = np.array([reach, reach, half[2]])
    return Shape(centre - extent, centre + extent, distance)


def upper_skull(s: Skeleton, axes, reach: float) -> Field:
    """Cranium with the whole maxilla (not yet cut)."""
    w, d, t = s.wide, s.deep, s.tall
    nasion, spine, floor = s.nasion, s.spine, s.spine[2]
    mid = spine[1] + 3 + s.p.face_depth  # maxilla behind the nasion vertical
    brow, eye = s.p.brow_prominence, s.p.eye_spacing / 2 + 1.5
    field = Field(axes, reach)
    field.union(ellipsoid([0, 3, 52 * t], [65 * w, 3 + 93 * d, 80 * t]))
    field.values[:] = np.maximum(field.values, -(field.axes[2][None, None, :] + 4.0))  # flat skull base
    field.union(tube([[0, nasion[1] + 5, 40 * t], [0, nasion[1] + 3.5, 28 * t]], [7 + 0.5 * brow, 4.5]), k=9)
    cheeks = Field(axes, reach)
    for side in SIDES:

        def at(x, y, z, side=side):
            return [side * x * w, y * d, z * t]

        rim = [at(6, -87 - brow, 33), at(20, -84.5 - brow, 37.5), at(34, -78 - 0.5 * brow, 36), at(46, -68, 27)]
        field.union(tube(rim, [5, 4.2, 4, 4]), k=9)
        infra = [at(47, -65, -4), at(37, -75, -4.5), at(24, -81, -3), at(14, -84, 6), at(8.5, -86, 22)]
        field.union(tube(infra, [7, 5.5, 4.5, 3.6, 3.6]), k=6)
        body = ellipsoid(at(45.5, -63, -8), [9 * w, 11 * d, 10.5 * t], tilt=20)
        arch_ = [at(48, -60, -6), at(53.5, -48, -5), at(56, -32, -2), at(56, -14, 2), at(54, -2, 6)]
        cheeks.union(body, k=0).union(tube(arch_, [6.5, 4.2, 3.2, 3.8, 6]), k=7)
        buttress = [at(44, -62, -12), [side * 33 * w, -61 * d + 0.5 * mid, 0.5 * (floor - 14 * t)]]
        field.union(tube([*buttress, [side * 29 * w, -60 * d + mid, floor - 6]], [7, 4.5, 5]), k=9)
        field.union(ellipsoid([side * 55 * w, 2, 2], [8, 13, 11]), k=6)  # temporal bone beside the joint
        field.union(tube([at(20, -40, -4), at(18, -45, -22)], [7, 6]), k=6)  # pterygoid process
        # frontal process of the maxilla and the rim of the nasal aperture
        wall_ = [at(8, -86, 22), [side * 9.5 * w, -85.5 * d + 0.3 * mid, 6 * t]]
        wall_ += [[side * 14 * w, -83 * d + mid, 0.45 * floor], [side * 13 * w, -83 * d + mid, floor + 2]]
        field.union(tube(wall_, [4, 3.6, 4.0, 5]), k=6)
    field.values[:] = smooth_minimum(field.values, cheeks.values, 4)
    field.union(ellipsoid([0, -54 * d + mid, floor / 2 + 1], [36 * w, 29.5 * d, 0.5 * abs(floor) + 12]), k=8)
    field.union(ellipsoid([0, -36, -4], [26 * w, 26, 12]), k=6)
    line = s.arch_upper + [0, 5.3]
    crest = s.upper_edge(line[:, 1]) + ALVEOLUS
    thick = 4.8 + 1.7 * np.clip(np.abs(line[:, 0]) / 20, 0, 1)
    field.union(wall(line, thick, crest, np.full(len(line), floor + 6), rounding=4), k=9)
    for side in SIDES:
        field.brush([[side * 25 * w, -82 * d + mid, 0.62 * floor]], -2.5, 8)  # canine fossa
        orbit = [side * eye, -70 * d, 15 * t]
        field.subtract(ellipsoid(orbit, [18 * w, 24 * d, 16.5 * t]), k=4)
        lateral = [[side * 46 * w, -68 * d, 28 * t], [side * 50 * w, -64 * d, 13 * t], [side * 49 * w, -64 * d, -3 * t]]
        field.union(tube(lateral, [4, 3.6, 5]), k=4)  # lateral orbital rim
        field.subtract(ellipsoid([side * 5.5 * w, spine[1] + 8, 0.68 * floor], [6.4 * w, 20, 0.36 * -floor]), k=3)
    field.subtract(ellipsoid([0, spine[1] + 4, 0.22 * floor], [6.2 * w, 16, 13 * t]), k=3)
    bridge = [nasion + [0, 3.5, 1], [0, nasion[1] - 2.5, 17 * t], [0, nasion[1] - 6, 8.5 * t]]
    field.union(tube(bridge, [4.4, 3.6, 2.6]), k=3)  # nasal bones
    for side in SIDES:
        flank = [[side * 6, nasion[1] + 3.5, 17 * t], [side * 5, nasion[1] - 2.5, 9 * t]]
        field.union(tube(flank, [3.4, 2.4]), k=4)
    field.union(tube([spine + [0, 20, 14], spine + [0, 16, 0], spine + [0, 2.2, 0]], [1.4, 2.4, 2.2]), k=2)
    field.union(*tooth_row(s.arch_upper - [0, 3], s.upper_edge(s.arch_upper[:, 1]), UPPER_TEETH, 1.0))
    return field


def mandible(s: Skeleton, axes, reach: float) -> Field:
    """Whole mandible with the lower tooth row (not yet split)."""
    p = s.p
    field = Field(axes, reach)
    border = s.border()
    back = np.clip((border[:, 1] - s.molar_y + 8) / 14, 0, 1)
    top = (1 - back) * np.minimum(border[:, 2] + 20, s.lower_edge(border[:, 1]) - 12) + back * (border[:, 2] + 22)
    body = wall(border[:, :2], 5.6 - 1.2 * back, border[:, 2], np.maximum(top, border[:, 2] + 12), rounding=4.3)
    field.union(body)
    line = s.arch_lower + [0, 6.3]
    base = np.interp(line[:, 0], border[:, 0], border[:, 2])
    edge = s.lower_edge(s.arch_lower[:, 1]) - 0.3 * p.occlusal_cant * line[:, 0] / 25
    thick = 4.6 + 1.4 * np.clip(np.abs(line[:, 0]) / 20, 0, 1)
    field.union(wall(line, thick, np.maximum(base + 9, edge - 24), edge - ALVEOLUS, rounding=4), k=9)
    chin, menton = s.pogonion, s.menton
    field.union(ellipsoid([chin[0], chin[1] + 7, chin[2] + 1], [0.5 * p.chin_width, 7, 9]), k=6)
    for side in SIDES:
        tubercle = [chin[0] + side * 0.55 * p.chin_width, chin[1] + 8, menton[2] + 6.5]
        field.union(ellipsoid(tubercle, [6, 5.5, 6]), k=6)
        go, co = s.gonion_of(side), s.condyle_of(side)

        def centre(y, z, side=side, go=go, co=co):
            rise = np.clip((z - go[2]) / (co[2] - go[2]), -0.2, 1)
            flare = np.clip(go[1] - 8 - y, 0, 32) * (1 - 0.8 * np.clip(rise, 0, 1))  # narrower towards the teeth
            middle = np.float32(go[0] - 4 * side) + np.float32(co[0] - go[0] + 3 * side) * rise
            return middle - np.float32(0.3 * side) * flare

        front = s.molar_y + 3
        edge_low, edge_up = s.lower_edge(front) - 9, s.upper_edge(front) + 2
        coronoid = [[front + 6, -16], [front + 7.5, -3], [front + 10, 1], [front + 13, 0], [front + 15, -8]]
        notch = [[0.5 * (front - 8), -17], [-18.5, -14], [-15.5, -8], [-11.5, -4], [-6.5, -6], [-7, -16]]
        rear = [
            [0.5 * (go[1] - 10), 0.5 * (go[2] - 16)],
            [go[1] + 1.5, go[2] + 9],
            [go[1] - 1, go[2] + 2],
            [go[1] - 8, go[2] - 1.5],
        ]
        outline = [[front + 1, edge_low], [front + 4, edge_up], *coronoid, *notch, *rear, [front + 1, go[2] - 7]]
        field.union(plate(np.array(outline), centre, 4.2, rounding=3), k=9)
        field.union(ellipsoid(co, [8.5, 4.6, 5.0]), k=4)
    field.union(*tooth_row(s.arch_lower - [0, 3], edge, LOWER_TEETH, -1.0))
    return field
