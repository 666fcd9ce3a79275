"""The lateral cephalogram as a tracing in SVG: skin and bone before, bone as planned, skin as predicted."""

import contourpy
import numpy as np
import pyvista as pv
from PIL import Image, ImageDraw
from scipy import ndimage

from pinnochio.figures.profile import MidlineProfile
from pinnochio.mechanics.held_lips import CROSSED, OPEN, held_lips
from pinnochio.model.bone_landmarks import bone_landmarks
from pinnochio.model.carried import CarriedLandmarks
from pinnochio.model.measures import LANDMARKS
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.plans.roles import known_role

BEFORE, PLANNED, PREDICTED, FILLED = "#455a64", "#1565c0", "#c62828", "#f3efe4"
SKIN_MARKS = {"sellion": "N′", "pronasale": "Prn", "subnasale": "Sn", "subspinale": "A′", "labrale_superius": "Ls",
              "labrale_inferius": "Li", "sublabiale": "B′", "pogonion": "Pog′", "menton": "Me′"}  # fmt: skip
SLAB = np.linspace(-5.0, 5.0, 5)  # mm from the midline: sections whose union is what a film shows of teeth and chin [I]
PIXEL, SMOOTH, RIM = 0.5, 1.2, 4.0  # of the raster that outlines are traced on: mm, blur in pixels, mm round a bone
CHORDS = (("N", "A", "Pog"), ("N", "B"), ("Me", "Go"))
ABOVE, BELOW, BESIDE, HEADER = 45.0, 14.0, 18.0, 12.0  # mm round what the tracing shows
AT_LEFT = {"U1": (-2, 0), "L1": (-2, 3.5), "ANS": (-2, -0.5), "A": (-2, 3), "Me": (0, 6), "Go": (-2, 3)}  # mm of labels
HALO = f'fill="{BEFORE}" stroke="#fff" stroke-width="0.8" paint-order="stroke"'


class Cephalogram:
    """The tracing of one patient; :meth:`svg` serves every plan. Outlines go with their segment."""

    def __init__(self, patient: PatientModel, landmarks: CarriedLandmarks):
        self._patient, self._landmarks = patient, landmarks
        sellion = landmarks.positions[LANDMARKS.index("sellion")]
        middle = float(landmarks.positions[LANDMARKS.index("subnasale"), 0])
        self.bone = bone_landmarks(patient, middle, sellion)
        self._skin = MidlineProfile(patient.skin_points, patient.skin_faces, middle)
        owner = patient.bone_segment[patient.bone_faces[:, 0]]
        cranium = MidlineProfile(patient.bone_points, patient.bone_faces[owner < 0], middle, whole=True)
        self._cranium = cranium.of(patient.bone_points)
        self._outlines = []
        for index, name in enumerate(patient.segments):
            faces = patient.bone_faces[owner == index]
            if len(faces):
                lines = _outlines(patient.bone_points, faces, middle, name)
                self._outlines += [(name, line, width) for line, width in lines]
        moving = np.vstack([line for _, line, _ in self._outlines] or [self._cranium])
        low, high = moving.min(axis=0), moving.max(axis=0)
        nose = np.nanmin(landmarks.positions[:, 1])
        chin = np.nanmin(landmarks.positions[:, 2])
        above = np.fmin(sellion[2] + ABOVE, patient.skin_points[:, 2].max()) + HEADER
        self._window = (-high[1] - BESIDE, -above, -nose + BESIDE, -min(low[2], chin) + BELOW)

    def svg(self, plan: Plan, displacement: np.ndarray) -> str:
        """The tracing under a plan and a displacement (n, 3) mm of the mesh, in mm: forward to the right."""
        patient, rest = self._patient, Plan(plan.case, {})
        lips = held_lips(patient, displacement, closing=0.0)  # at rest, as the measures are
        displacement = lips.displacement
        left, top, right, bottom = self._window
        parts = [_path(line, BEFORE, width, FILLED) for _, line, width in self._outlines]
        parts += [_path(line, BEFORE, width) for _, line, width in self._outlines]
        parts.append(_lines(self._cranium, BEFORE, 0.4))
        parts += [
            _path(plan.motion(name).apply(line), PLANNED, width)
            for name, line, width in self._outlines
            if not Plan("", {name: plan.motion(name)}).still
        ]
        marks = []
        states = (rest, 0 * displacement, (BEFORE, BEFORE)), (plan, displacement, (PLANNED, PREDICTED))
        for one, field, colours in states:
            bone, skin = self.bone.under(one), dict(zip(LANDMARKS, self._landmarks.moved(field), strict=True))
            ways = [[bone[name] for name in way if name in bone] for way in CHORDS]
            nose, chin = skin["pronasale"], skin["pogonion"]
            aesthetic = [nose - 0.1 * (chin - nose), chin + 0.15 * (chin - nose)]
            chords = [(way, colours[0]) for way in ways if len(way) > 1] + [(aesthetic, colours[1])]
            chords = [(np.array(way), colour) for way, colour in chords if np.isfinite(way).all()]
            parts += [_path(*chord, 0.2, dashed=True) for chord in chords]
            parts.append(_lines(self._skin.of(patient.moved_skin(field)), colours[1], 0.7))
            marks += [_mark(place, colours[0], name if one is rest else "", False) for name, place in bone.items()]
            seen = {name: title for name, title in SKIN_MARKS.items() if np.isfinite(skin[name]).all()}
            marks += [_mark(skin[name], colours[1], title if one is rest else "", True) for name, title in seen.items()]
        parts += marks[::-1]
        said = f"lips cross by {lips.crossed:.1f} mm; drawn in contact" if lips.crossed >= CROSSED else ""
        said = said or ("lips at rest, not closed" if lips.parted > OPEN else "")
        parts.append(f'<text x="{left + 3:.1f}" y="{top + 11:.1f}" fill="#b26a00">{said}</text>')
        legend = {"before": BEFORE, "bones after the plan": PLANNED, "skin predicted": PREDICTED}
        words = "".join(f'<tspan fill="{colour}">{title}</tspan>   ' for title, colour in legend.items())
        parts.append(
            f'<text x="{left + 3:.1f}" y="{top + 6:.1f}" font-weight="bold" xml:space="preserve">{words}</text>'
        )
        box = f"{left:.1f} {top:.1f} {right - left:.1f} {bottom - top:.1f}"
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" font-family="sans-serif" font-size="4" '
            'stroke-linecap="round" stroke-linejoin="round" role="img" aria-label="lateral cephalogram">'
            f'<rect x="{left:.1f}" y="{top:.1f}" width="100%" height="100%" fill="#fff"/>{"".join(parts)}</svg>'
        )


def _outlines(points: np.ndarray, faces: np.ndarray, middle: float, name: str) -> list[tuple[np.ndarray, float]]:
    """Closed lines (k, 3) mm round what a segment shows from the side, and how thick they are drawn: about the midline
    and, of a lower jaw, also as a whole."""
    surface, lines = pv.PolyData.from_regular_faces(points, faces), []
    cuts = [surface.slice(normal=(1, 0, 0), origin=(middle + off, 0, 0)).strip() for off in SLAB]
    kinds = [([cut.points[cell.point_ids, 1:] for cut in cuts for cell in cut.cell], middle, 0.55)]
    if known_role(name) != "maxilla":
        kinds.append((points[faces][:, :, 1:], points[faces][:, :, 0].mean(), 0.35))
    for polygons, x, width in kinds:
        if not len(polygons):
            continue
        places = np.vstack(list(polygons))
        low, size = places.min(axis=0) - RIM, np.ptp(places, axis=0) + 2 * RIM
        image = Image.new("L", tuple(np.ceil(size / PIXEL).astype(int)))
        draw = ImageDraw.Draw(image)
        for polygon in polygons:
            draw.polygon([tuple(place) for place in (polygon - low) / PIXEL], fill=255)
        filled = ndimage.gaussian_filter(np.asarray(image, float), SMOOTH)
        for line in contourpy.contour_generator(z=filled).lines(127.5):
            lines.append((np.column_stack([np.full(len(line), x), line * PIXEL + low]), width))
    return lines


def _xy(places: np.ndarray) -> list[str]:
    return [f"{-y:.1f} {-z:.1f}" for y, z in places[:, 1:]]


def _path(line: np.ndarray, colour: str, width: float, fill: str = "none", dashed: bool = False) -> str:
    dash = ' stroke-dasharray="1.5 1"' if dashed else ""
    return f'<path d="M{"L".join(_xy(line))}" fill="{fill}" stroke="{colour}" stroke-width="{width}"{dash}/>'


def _lines(ends: np.ndarray, colour: str, width: float) -> str:
    places = _xy(ends)
    way = "".join(f"M{one}L{two}" for one, two in zip(places[::2], places[1::2], strict=True))
    return f'<path d="{way}" fill="none" stroke="{colour}" stroke-width="{width}"/>'


def _mark(place: np.ndarray, colour: str, title: str, skin: bool) -> str:
    """A landmark with its name, of the skin in front of it and of bone behind it."""
    x, y = -place[1], -place[2]
    right, down = (2, 1.4) if skin else AT_LEFT.get(title, (-2, 1.4))
    words = (
        f'<text x="{x + right:.1f}" y="{y + down:.1f}" text-anchor="{"start" if skin else "end"}" {HALO}>{title}</text>'
    )
    dot = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="0.8" fill="{colour}"/>'
    return dot + words if title else dot
