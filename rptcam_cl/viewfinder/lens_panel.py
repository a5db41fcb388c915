"""The lens panel: cross-section, numbers, rays from the pixel under the pointer; what a lens state needs is kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_C_NM, LINE_D_NM, LINE_F_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import Memory, remember
from rptcam_cl.device.session import Session
from rptcam_cl.optics.charts import wavelength_colour
from rptcam_cl.optics.drawing import blades, glass, lines, obstruction
from rptcam_cl.optics.film_probe import FilmProbe, narrow_boxes
from rptcam_cl.optics.lens import Lens, thick_lens_of
from rptcam_cl.optics.ray_trace import IDEAL, Rays, Status
from rptcam_cl.optics.spots import COLUMNS, FilmSpot, field_mtf
from rptcam_cl.rendering.cameras import lens_records
from rptcam_cl.rendering.cameras.kinds import Perspective, camera_of
from rptcam_cl.rendering.cameras.setting import LensSetting, film_frame, film_point, lens_setting
from rptcam_cl.rendering.traceable_lens import LensTracer
from rptcam_cl.scene import changes, lens_settings
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.drives import focus_drive
from rptcam_cl.studies.focus.probe import circle_of_confusion
from rptcam_cl.viewfinder.panel import DIAGONAL_35_MM, KEPT, f_number_of_camera, focal_length_mm, optics_key

# The lens of a camera in one state, as the panel shows it: focused, stopped down, shaped, with its tracers ready.

Array = NDArray[np.float64]

LINES_NM = (LINE_F_NM, LINE_D_NM, LINE_C_NM)  # blue, yellow, red


class KeptTracer:
    """Traces small bundles of rays through a lens on a device; the lens stays there between them.

    Parameters
    ----------
    lens, device
        What is traced, and where.
    start
        ``film`` or ``scene``.
    """

    def __init__(self, lens: Lens, device: Session, start: str) -> None:
        low, high = lens_records.usable_nm(lens)
        self._lens, self._device, self._start = lens, device, start
        self._coloured = lens_records.disperses(lens) and low <= min(LINES_NM) and max(LINES_NM) <= high
        self._tracers: dict[float, LensTracer] = {}

    def _tracer(self, wavelength_nm: float) -> LensTracer:
        """Return the tracer of a wavelength; of all where rays bring their own."""
        key = 0.0 if self._coloured else wavelength_nm
        if key not in self._tracers:
            self._tracers[key] = LensTracer(
                self._lens, self._device, wavelength_nm, self._start, "single", IDEAL, dispersive=self._coloured
            )
        return self._tracers[key]

    def trace(self, points: Array, vectors: Array, wavelengths_nm: Array) -> Rays:
        """Return rays (n, 3) with a wavelength each, behind the last surface."""
        return self.paths(points, vectors, wavelengths_nm, every=False)[1]

    def paths(self, points: Array, vectors: Array, wavelengths_nm: Array, *, every: bool = True) -> tuple[Array, Rays]:
        """Return where rays (n, 3) start and meet each surface (surfaces + 1, n, 3), and what becomes of them.

        Parameters
        ----------
        every
            False for their ends alone: the points are those of the start then.
        """
        count = len(points)
        found = Rays(
            np.empty((count, 3)), np.empty((count, 3)), np.empty(count, np.int32), np.empty(count, np.int32),
            np.empty(0),
        )  # fmt: skip
        corners = np.empty((len(self._lens.surfaces) + 1 if every else 1, count, 3))
        corners[0] = points
        for wavelength in [LINE_D_NM] if self._coloured else np.unique(wavelengths_nm).tolist():
            rows = np.arange(count) if self._coloured else np.flatnonzero(wavelengths_nm == wavelength)
            own = wavelengths_nm[rows] if self._coloured else None
            tracer = self._tracer(wavelength)
            if every:
                corners[:, rows], rays = tracer.paths(points[rows], vectors[rows], own)
                for name in ("origins", "directions", "status", "surface"):
                    getattr(found, name)[rows] = getattr(rays, name)
            else:
                tracer.trace(points, vectors, found, slice(0, count) if own is not None else rows, own)
        return corners, found


@dataclass(frozen=True)
class LensState:
    """A lens in one state.

    Attributes
    ----------
    scene : Scene
    setting : LensSetting
    lens : Lens
        That of the setting, its stop in the shape of the camera's aperture.
    device : Session
    """

    scene: Scene
    setting: LensSetting
    lens: Lens
    device: Session

    @property
    def film_z(self) -> float:
        """Film plane in the frame of the lens [mm]."""
        return self.lens.film_z(self.setting.film_distance_mm)

    @property
    def object_mm(self) -> float:
        """Plane in focus to the first vertex [mm]; infinite where there is none or it is very far."""
        focus = self.setting.focus_distance_mm
        return np.inf if focus is None or focus > 1e9 or focus <= self.film_z else focus - self.film_z

    @property
    def size_mm(self) -> float:
        """The larger of the length and the diameter of the glass."""
        finite = [surface.semi_diameter for surface in self.lens.surfaces if np.isfinite(surface.semi_diameter)]
        return float(max(abs(self.lens.length), 2 * max(finite, default=0.0)))

    @cached_property
    def wavelengths_nm(self) -> tuple[float, ...]:
        """Wavelengths whose rays differ: one where the glass bends all of them alike."""
        return LINES_NM if lens_records.disperses(self.lens) else (self.setting.camera.wavelength_nm,)

    @cached_property
    def from_film(self) -> KeptTracer:
        """What traces rays from the film."""
        return KeptTracer(self.lens, self.device, "film")

    @cached_property
    def from_scene(self) -> KeptTracer:
        """What traces rays from the scene."""
        return KeptTracer(self.lens, self.device, "scene")


def lens_state(scene: Scene, device: Session) -> LensState:
    """Return the lens of a scene in focus, whose camera has one."""
    setting = lens_setting(scene)
    lens = setting.lens if setting.lens.stop is None else lens_records.shaped(scene, setting).lens
    return LensState(scene, setting, lens, device)


#
# Depth of field, hyperfocal distance, breathing and the engraved focus scale, by first-order optics.
#
# Seen from the entrance pupil of diameter D, a point at the distance u' blurs a plane in focus at u to D |u - u'| /
# u', which the film shows P / u times as large, P being how far the image moves per unit of the tangent. A blur of c
# counts as sharp, so that the field reaches from u D P / (D P + c u) to u D P / (D P - c u). Nothing is assumed of
# the lens but that it has pupils: their magnification and a moving group count.

INFINITY_M = 1e6  # what the focus dial calls infinity
_MARKS_M = (0.1, 0.12, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0)
_DEPTH_STOPS = (2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0)  # engraved about the focus mark
FEWEST, MOST = 3, 12  # marks of a focus scale


@remember(most=KEPT, by=optics_key)
def perspective(scene: Scene) -> Perspective | None:
    """Return the first-order picture of a scene's camera; None where no plane is in focus or there is no focus.

    Parameters
    ----------
    scene
        In focus.
    """
    return camera_of(scene).perspective()


_DEPTH_KEYS = ("distance_m", "near_m", "far_m", "hyperfocal_m", "circle_mm", "magnification", "breathing")


def depth_of_field(scene: Scene) -> dict[str, float | None] | None:
    """Find what a scene's camera shows sharply; None where it has no focus.

    Parameters
    ----------
    scene
        In focus.

    Returns
    -------
    distance_m, near_m : float
        Plane in focus and the near end, from the film (thin lens: from the lens); infinite focus counts as 1000 km.
    far_m, hyperfocal_m : float or None
        The far end, None at infinity; the nearest focus for which it is infinite.
    circle_mm : float
        Blur that counts as sharp: the film's diagonal / 1500, as on depth-of-field scales.
    magnification : float
        Image over object size in the plane in focus.
    breathing : float or None
        By how much the image of a field is larger than with the focus at infinity, as a share.
    """
    here = perspective(scene)
    if here is None:
        return None
    circle = circle_of_confusion(scene)
    near, far = here.field(circle)
    distant = at_infinity(scene)
    horizon = distant or here
    hyperfocal = horizon.diameter_mm * horizon.per_tangent_mm / circle + horizon.pupil_mm
    values = (
        here.focus_mm * 1e-3,
        near * 1e-3,
        far * 1e-3 if math.isfinite(far) else None,
        hyperfocal * 1e-3,
        circle,
        here.per_tangent_mm / (here.focus_mm - here.pupil_mm),
        None if distant is None else here.per_tangent_mm / distant.per_tangent_mm - 1.0,
    )
    return dict(zip(_DEPTH_KEYS, values, strict=True))


def at_infinity(scene: Scene) -> Perspective | None:
    """Return the first-order picture with the focus at infinity; None where the lens does not go there."""
    try:
        return perspective(changes.change_scene(scene, camera=scene.camera.focus_keys(INFINITY_M)))
    except InputError:
        return None


def nearest_focus_m(scene: Scene) -> float | None:
    """Return the shortest focus distance that the camera reaches [m]; None where it has no focus.

    A lens that moves as a whole reaches natural size.
    """
    camera = scene.camera
    if not camera.focuses:
        return None
    update = camera.focus_keys(INFINITY_M)
    if camera.lens_camera is not None:  # wherever it stands, perhaps beyond the reach, and however wide it is open
        focus = lens_settings.Focus(distance_m=INFINITY_M)
        update = {"focus": focus, "f_number": None, "stop_diameter_mm": None, "stands_at": "film"}
    return _nearest(scene.model_copy(update={"camera": camera.model_copy(update=update)}))


@remember(most=KEPT, by=optics_key)
def _nearest(scene: Scene) -> float | None:
    try:
        drive = focus_drive(scene)
        near = max(drive.limits, key=lambda state: drive.nearer * drive.coordinate(state))
        return drive.first_order_distance(near)
    except InputError:
        return None


def focus_scale(scene: Scene) -> dict[str, Any] | None:
    """Return the engraving of the focus ring: marks, the depth of field at full stops, and where the focus stands.

    Positions go from 0 at the nearest focus to 1 at infinity, evenly in 1 / distance, as a lens moves. None where there
    is no focus.
    """
    here, nearest = perspective(scene), nearest_focus_m(scene)
    if here is None or nearest is None:
        return None
    circle = circle_of_confusion(scene)

    def position(metres: float | None) -> float:
        return 1.0 if metres is None or math.isinf(metres) else min(max(1.0 - nearest / metres, 0.0), 1.0)

    marks = [metres for metres in _MARKS_M if metres > nearest * 1.02]
    marks = marks[:: max(1, math.ceil(len(marks) / MOST))] if len(marks) > FEWEST else marks
    depth = []
    f_number = here.focal_length_mm / here.diameter_mm
    for stop in _DEPTH_STOPS:
        near, far = (end * 1e-3 for end in here.field(circle, f_number / stop))
        depth.append({"f_number": stop, "near": position(near), "far": position(far)})
    near, far = (end * 1e-3 for end in here.field(circle))
    return {
        "near_m": near,
        "far_m": far if math.isfinite(far) else None,
        "position": position(here.focus_mm * 1e-3),
        "marks": [
            {"m": nearest, "text": f"{nearest:.2g}", "position": 0.0},
            *({"m": metres, "text": f"{metres:g}", "position": position(metres)} for metres in marks),
            {"m": INFINITY_M, "text": "∞", "position": 1.0},
        ],
        "depth": depth,
    }


# The numbers of a camera in its state: focal length, f-numbers, pupils, depth of field, breathing, angles.

RADII = 24  # at which the edge of the image circle is sought at a time
FAN = (384, 1)  # rays from each, along the line where the last ones pass
LARGEST = 2.5  # image circle that is sought, over the film's own


def camera_numbers(scene: Scene) -> dict[str, Any]:
    """The numbers of any camera in focus; None where there is no such number."""
    focal_mm = focal_length_mm(scene)
    depth: dict[str, Any] = depth_of_field(scene) or dict.fromkeys(_DEPTH_KEYS)
    numbers = {
        "focal_length_mm": focal_mm,
        "equivalent_mm": None if focal_mm is None else focal_mm * DIAGONAL_35_MM / (scene.film.diagonal_m() * 1e3),
        "f_number": f_number_of_camera(scene),
        "working_f_number": _working_f_number(scene),
    }
    return depth | numbers | _angles(scene, focal_mm)


def _working_f_number(scene: Scene) -> float | None:
    """Return the f-number of the light on the axis, from the film distance, to first order."""
    here = perspective(scene)
    if here is None:
        return None
    setting = camera_of(scene).setting
    if setting is None:
        return here.per_tangent_mm / here.diameter_mm
    pupil = setting.lens.first_order(setting.camera.wavelength_nm).exit_pupil
    index = float(setting.lens.indices(setting.camera.wavelength_nm)[-1])
    return abs(setting.film_distance_mm - pupil.distance_mm) / (index * pupil.diameter_mm)


def _angles(scene: Scene, focal_mm: float | None) -> dict[str, Any]:
    """Return the angles of view by the first-order projection [degrees]."""
    if focal_mm is None:
        return {"field_degrees": None, "fields_degrees": None}
    found = perspective(scene)
    per_tangent = focal_mm if found is None else found.per_tangent_mm
    sides = {"horizontal": scene.film.size_m()[0], "vertical": scene.film.size_m()[1]}
    sides["diagonal"] = scene.film.diagonal_m()
    angles = {name: math.degrees(2 * math.atan(side * 500 / per_tangent)) for name, side in sides.items()}
    return {"field_degrees": angles["diagonal"], "fields_degrees": angles}


def _lens_numbers(state: LensState) -> dict[str, Any]:
    """Return the pupils and distances of a lens, besides what is known of any camera."""
    lens, setting = state.lens, state.setting
    first = lens.first_order(setting.camera.wavelength_nm)
    exit_z = lens.length + lens.sense * first.exit_pupil.distance_mm
    return camera_numbers(state.scene) | {
        "lens": lens.name,
        "entrance_pupil": _pupil(first.entrance_pupil.distance_mm, first.entrance_pupil.diameter_mm),
        "exit_pupil": _pupil(exit_z, first.exit_pupil.diameter_mm),
        "stop_diameter_mm": None if lens.stop is None else 2 * lens.stop.semi_diameter,
        "film_distance_mm": setting.film_distance_mm,
        "length_mm": lens.length,
        "surfaces": len(lens.surfaces),
    }


def _pupil(z_mm: float, diameter_mm: float, round_to: Callable[[float], float] = float) -> dict[str, float] | None:
    """Return a pupil as plain values; None where it lies infinitely far away."""
    if not (math.isfinite(z_mm) and math.isfinite(diameter_mm)):
        return None
    return {"z_mm": round_to(z_mm), "radius_mm": round_to(diameter_mm / 2)}


def image_circle_mm(state: LensState) -> float | None:
    """Return the radius on the film beyond which no ray arrives [mm], within 0.5 %; None beyond 2.5 times the film.

    Rays are traced in float64 along the line where the last of them pass, at some radii at a time.
    """
    half_mm = state.scene.film.diagonal_m() * 500
    probe = FilmProbe(state.lens, state.setting.film_distance_mm, state.setting.camera.wavelength_nm)
    low, high = 0.0, LARGEST * half_mm
    for _ in range(2):
        radii = np.linspace(low, high, RADII)
        film = np.column_stack([radii, np.zeros(RADII)])
        lit = np.asarray(narrow_boxes(probe, film, probe.windows(film), FAN)[1], bool)
        if lit.all():
            return None if high == LARGEST * half_mm else float(high)
        dark = int(np.argmin(lit))
        if dark == 0:
            return float(low) or None
        low, high = float(radii[dark - 1]), float(radii[dark])
    return (low + high) / 2


# The cross-section of a camera as lines to draw, in millimetres of the frame of its lens: z to the film, height.

EVERY = 4  # of the points of an outline
CORNER = 0.15  # turn of an outline that is a corner [radians]
_DIGITS = 3
APPROACH = 0.35  # of the axis drawn before the lens, in its size
_IDEAL_BLADE = 1.6  # radius of an ideal opening's screen over its own


def _lens_section(state: LensState) -> dict[str, Any]:
    """Return surfaces, glass, stop, pupils, film and axis of a lens."""
    lens, wavelength_nm = state.lens, state.setting.camera.wavelength_nm
    first = lens.first_order(wavelength_nm)
    surfaces = []
    for k, surface in enumerate(lens.surfaces):
        block = obstruction(lens, k, "y")
        if block is not None:
            surfaces.append({"surface": k, "points": _plain(block), "kind": "obstruction"})
        elif not (surface.is_stop and surface.is_sphere and not surface.curvature):
            kind = "mirror" if surface.is_mirror else "glass"
            surfaces += [{"surface": k, "points": _plain(line), "kind": kind} for line in lines(lens, k, "y")]
    half_mm = state.scene.film.diagonal_m() * 500
    exit_z = lens.length + lens.sense * first.exit_pupil.distance_mm
    pupils = {
        "entrance": _pupil(first.entrance_pupil.distance_mm, first.entrance_pupil.diameter_mm, _round),
        "exit": _pupil(exit_z, first.exit_pupil.diameter_mm, _round),
    }
    return {
        "kind": state.scene.camera.kind,
        "name": lens.name,
        "surfaces": surfaces,
        "glass": [
            {"index": round(index, 4), "points": _plain(outline)} for index, outline in glass(lens, "y", wavelength_nm)
        ],
        "stop": [{"surface": lens.stop_index, "points": _plain(blade)} for blade in blades(lens, "y")],
        "film": {"points": [[_round(state.film_z), _round(h)] for h in (-half_mm, half_mm)]},
        "pupils": pupils,
        "axis": [_round(-APPROACH * state.size_mm), _round(max(state.film_z, lens.length))],
    }  # fmt: skip


def _ideal_section(scene: Scene) -> dict[str, Any]:
    """Return opening, film and axis of a camera without a lens of glass: the opening is at z = 0."""
    kind = scene.camera.kind
    empty: dict[str, Any] = {"kind": kind, "name": kind.replace("_", " "), "surfaces": [], "glass": [], "stop": []}
    if scene.camera.sees_all_around:
        return empty | {"film": None, "pupils": {"entrance": None, "exit": None}, "axis": [0.0, 0.0]}
    radius, film_z = _ideal_opening(scene)
    half_mm = scene.film.diagonal_m() * 500
    screen = max(_IDEAL_BLADE * radius, 0.25 * half_mm)
    pupil = _pupil(0.0, 2 * radius, _round)
    sides = [[[0.0, side * _round(radius)], [0.0, side * _round(screen)]] for side in (1, -1)]
    return empty | {
        "stop": [{"surface": None, "points": points} for points in sides],
        "film": {"points": [[_round(film_z), _round(h)] for h in (-half_mm, half_mm)]},
        "pupils": {"entrance": pupil, "exit": pupil},
        "axis": [_round(-film_z), _round(film_z)],
    }  # fmt: skip


def _ideal_opening(scene: Scene) -> tuple[float, float]:
    """Return the radius of an ideal camera's opening and how far behind it the film lies [mm]."""
    found = perspective(scene)
    if found is not None:
        return found.diameter_mm / 2, found.per_tangent_mm
    return 0.0, focal_length_mm(scene) or 0.0


def _plain(points: Array) -> list[list[float]]:
    """Return points (m, 2) as rounded numbers: every few of a curve, its ends and its corners."""
    kept = np.zeros(len(points), bool)
    kept[::EVERY] = kept[-1] = True
    steps = np.diff(points, axis=0)
    along = np.arctan2(steps[:, 1], steps[:, 0])
    turn = np.abs(np.angle(np.exp(1j * np.diff(along))))
    kept[1:-1] |= turn > CORNER
    rounded: list[list[float]] = np.round(points[kept], _DIGITS).tolist()
    return rounded


def _round(value: float) -> float:
    return round(float(value), _DIGITS)


#
# Rays from the pixel under the pointer: the fan through the section, the spot and the transfer of its light.
#
# The device traces them, by the kernel that traces given rays. They lie in the plane of the axis and the film point,
# in which heights are counted; of a lens that is not the same from every side, in its y-z plane.

RAY_FAN = 9  # rays of each wavelength that pass
BEYOND = 3  # and on each side, as far as there is glass, that do not
LINE = 145  # rays that find out which pass
SCOUTS = (40, 40)
ACROSS = 24  # rays that span the beam of a film point each way
FINER = (48, 96)  # and those of its spot, until its radius moves by less than
CONVERGED = 0.005
DOTS = 120  # of each wavelength that are drawn
_FREQUENCIES = np.arange(0.0, 101.0, 5.0)  # [cycles/mm]
_CENTRED_MM = 1e-6


def _pointer_rays(state: LensState, x: float, y: float) -> dict[str, Any]:
    """Return fan, spot and transfer of a point of the picture, in fractions from its left and top."""
    camera = state.setting.camera
    *place, depth = film_point(state.scene, camera, x, y)
    start = np.array([*place, state.film_z + state.lens.sense * depth])
    across = _section(state, start)
    probe = FilmProbe(state.lens, state.setting.film_distance_mm, camera.wavelength_nm, film_frame(camera))
    film = start[None, :2]
    window = probe.windows(film)
    boxes, found = narrow_boxes(probe, film, window, SCOUTS)
    passes = bool(found[0])
    rays = _fan(state, start, across, boxes[0] if passes else window[0], window[0])
    result = {"x": x, "y": y, "film_mm": [round(float(value), 4) for value in start[:2]], "rays": rays}
    return result | (_beam(state, start, across, boxes[0]) if passes else _NO_LIGHT)


_NO_LIGHT: dict[str, Any] = {"field_degrees": None, "spot": None, "mtf": None}


def _section(state: LensState, start: Array) -> Array:
    """Return the unit vector of heights on the film."""
    radius = float(np.hypot(*start[:2]))
    if radius < _CENTRED_MM or not state.lens.is_rotational:
        return np.array([0.0, 1.0])
    away = start[:2] / radius
    return away if away[1] >= 0 else -away


def _fan(state: LensState, start: Array, across: Array, box: Array, window: Array) -> list[dict[str, Any]]:
    """Return the rays of every wavelength, evenly over what passes and on beyond it."""
    foot = np.array([box[0] + box[1], box[2] + box[3]]) / 2
    heights = _heights(state, start, across, foot, window)
    targets = np.column_stack([foot + heights[:, None] * across, np.full(len(heights), state.lens.length)])
    wavelengths = np.repeat(state.wavelengths_nm, len(heights))
    vectors = np.tile(targets - start, (len(state.wavelengths_nm), 1))
    points = np.broadcast_to(start, vectors.shape).copy()
    corners, rays = state.from_film.paths(points, vectors, wavelengths)
    return [_draw(state, corners[:, ray], rays, ray, across, float(wavelengths[ray])) for ray in range(len(points))]


def _heights(state: LensState, start: Array, across: Array, foot: Array, window: Array) -> Array:
    """Return where the fan meets the plane of the last vertex: heights about a point of it.

    They step evenly over what passes, by the device's own judgement, and on beyond it as far as there is glass.
    """
    w0, w1, t0, t1 = window
    reach = float(np.abs(across) @ [w1 - w0, t1 - t0]) / 2
    middle = float(across @ (foot - np.array([w0 + w1, t0 + t1]) / 2))
    line = np.linspace(-reach - middle, reach - middle, LINE)
    targets = np.column_stack([foot + line[:, None] * across, np.full(LINE, state.lens.length)])
    points = np.broadcast_to(start, targets.shape).copy()
    rays = state.from_film.trace(points, targets - start, np.full(LINE, state.setting.camera.wavelength_nm))
    passed = np.flatnonzero(rays.passed)
    if len(passed) < 2:
        return np.asarray(line[:: LINE // RAY_FAN])
    if state.lens.is_obstructed:  # even steps would mostly end at the obstruction
        stopped = np.flatnonzero(~rays.passed)
        few = (passed[np.linspace(0, len(passed) - 1, RAY_FAN).astype(int)], stopped[:: max(1, len(stopped) // BEYOND)])
        return np.asarray(line[np.sort(np.concatenate(few))])
    low, high = line[passed[0]], line[passed[-1]]
    step = (high - low) / (RAY_FAN - 1)
    below, above = (int(min(BEYOND, room // step)) for room in (low - line[0], line[-1] - high))
    return np.asarray(low + step * np.arange(-below, RAY_FAN + above))


def _draw(
    state: LensState, corners: Array, rays: Rays, ray: int, across: Array, wavelength_nm: float
) -> dict[str, Any]:
    """Return a ray as drawn, from the film to before the lens, or to where it was stopped."""
    status, surface = Status(int(rays.status[ray])), int(rays.surface[ray])
    direction, lens = rays.directions[ray], state.lens
    if status == Status.ok:
        ahead = min(APPROACH * state.size_mm, state.object_mm)
        line = np.concatenate([corners, corners[-1:] + ahead * direction])
    else:
        line = corners[: len(lens.surfaces) - surface + 1]
        if status == Status.missed and direction[2]:
            step = (lens.vertices[surface] - line[-1, 2]) / direction[2]
            line = np.concatenate([line[:-1], line[-1:] + max(float(step), 0.0) * direction])
    points = np.column_stack([line[:, 2], line[:, :2] @ across])
    return {
        "points": np.round(points, 4).tolist(),
        "wavelength_nm": round(wavelength_nm, 2),
        "colour": wavelength_colour(wavelength_nm),
        "passed": status == Status.ok,
        "stopped_by": None if status == Status.ok else surface,
        "why": None if status == Status.ok else status.name.replace("_", " "),
    }


def _beam(state: LensState, start: Array, across: Array, box: Array) -> dict[str, Any]:
    """Return the angle of the beam of a film point in the scene, and the spot of the object point that it shows."""
    rays = _scouts(state, start, box)
    good = rays.passed
    if good.sum() < 4:
        return _NO_LIGHT
    origins, directions = rays.origins[good], rays.directions[good]
    entrance = origins - directions * (origins[:, 2:] / directions[:, 2:])
    mean = directions.mean(axis=0)
    angle = float(np.degrees(np.arctan2(np.hypot(*mean[:2]), -mean[2])))
    spots, moved = _spots(state, entrance, mean, across, ACROSS), np.inf
    for count in FINER:
        radius, spots = _radius(spots), _spots(state, entrance, mean, across, count)
        moved = abs(radius / _radius(spots) - 1) if _radius(spots) else 0.0
        if moved < CONVERGED:
            break
    spot = _spot(spots)
    return {
        "field_degrees": round(angle, 3),
        "spot": spot and spot | {"relative_error": round(moved, 4)},
        "mtf": _mtf(spots),
    }


def _scouts(state: LensState, start: Array, box: Array) -> Rays:
    """Return rays from a film point over the box that holds its beam."""
    u, v = (np.linspace(low, high, ACROSS) for low, high in (box[:2], box[2:]))
    targets = np.column_stack([*(axis.ravel() for axis in np.meshgrid(u, v)), np.full(ACROSS**2, state.lens.length)])
    points = np.broadcast_to(start, targets.shape).copy()
    return state.from_film.trace(points, targets - start, np.full(len(targets), state.setting.camera.wavelength_nm))


def _radius(spots: list[FilmSpot]) -> float:
    """Return the root mean square radius of spots about their common centroid [mm]; 0 without rays."""
    together = np.concatenate([spot.points for spot in spots])
    return float(np.sqrt(together.var(axis=0).sum())) if len(together) else 0.0


def _spots(state: LensState, entrance: Array, mean: Array, across: Array, count: int) -> list[FilmSpot]:
    """Return the spots of each wavelength: rays of one object point, spread over the plane of the first vertex.

    Their axes are sagittal and tangential: across the plane of the section, and in it.
    """
    (u0, v0), (u1, v1) = entrance[:, :2].min(axis=0), entrance[:, :2].max(axis=0)
    margin = np.array([u1 - u0, v1 - v0]) / ACROSS
    u, v = (np.linspace(low - gap, high + gap, count) for low, high, gap in ((u0, u1, margin[0]), (v0, v1, margin[1])))
    grid = np.column_stack([*(axis.ravel() for axis in np.meshgrid(u, v)), np.zeros(count**2)])
    along = -mean / np.linalg.norm(mean)
    if np.isinf(state.object_mm):
        vectors = np.broadcast_to(along, grid.shape)
    else:
        source = entrance.mean(axis=0) - along * state.object_mm / along[2]
        vectors = grid - source
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    back = (
        np.full_like(lengths, 2 * state.size_mm)
        if np.isinf(state.object_mm)
        else np.minimum(2 * state.size_mm, lengths)
    )
    origins = grid - vectors / lengths * back
    colours, axes = len(state.wavelengths_nm), np.stack([[across[1], -across[0]], across], axis=1)
    wavelengths = np.repeat(state.wavelengths_nm, len(grid))
    rays = state.from_scene.trace(np.tile(origins, (colours, 1)), np.tile(vectors, (colours, 1)), wavelengths)
    good = rays.passed
    step = (state.film_z - rays.origins[:, 2:]) / np.where(good[:, None], rays.directions[:, 2:], 1.0)
    film = (rays.origins[:, :2] + rays.directions[:, :2] * step) @ axes
    turned = rays.directions[:, :2] @ axes
    spots = []
    for wavelength in state.wavelengths_nm:
        rows = good & (wavelengths == wavelength)
        index = float(state.lens.indices(wavelength)[-1])
        cone = 2.0 * index * np.std(turned[rows], axis=0) if rows.any() else np.zeros(2)
        spots.append(FilmSpot(0.0, wavelength, film[rows], (float(cone[0]), float(cone[1]))))
    return spots


def _spot(spots: list[FilmSpot]) -> dict[str, Any] | None:
    """Return the dots [µm] about their centroid, sagittal and tangential, and their root mean square radius."""
    together = np.concatenate([spot.points for spot in spots])
    if not len(together):
        return None
    centroid = together.mean(axis=0)
    dots, colours = [], []
    for spot in spots:
        few = spot.points[:: max(1, len(spot.points) // DOTS)]
        dots.append(np.round((few - centroid) * 1e3, 2))
        colours += [wavelength_colour(spot.wavelength_nm)] * len(few)
    square = np.mean(np.square((together - centroid) * 1e3), axis=0)
    return {
        "points_um": np.concatenate(dots).tolist(),
        "colours": colours,
        "rms_um": float(np.sqrt(square.sum())),
        "rms_sagittal_um": float(np.sqrt(square[0])),
        "rms_tangential_um": float(np.sqrt(square[1])),
        "rays": len(together),
    }


def _mtf(spots: list[FilmSpot]) -> dict[str, Any] | None:
    """Return the modulation by frequency [cycles/mm], tangential and sagittal, and the limits of diffraction."""
    lit = [spot for spot in spots if len(spot.points)]
    curves = field_mtf(lit, _FREQUENCIES) if lit else None
    if curves is None:
        return None
    plain = {name: np.round(curve, 4).tolist() for name, curve in zip(COLUMNS, curves, strict=True)}
    return {"frequencies": _FREQUENCIES.tolist()} | plain


def _thick_rays(state: LensState, x: float, y: float) -> dict[str, Any]:
    """Return the rays of a thick lens: straight lines between film, lens and scene, through points of its pupil."""
    camera = state.setting.camera
    film = np.array(film_point(state.scene, camera, x, y)[:2])
    across = _section(state, np.array([*film, 0.0]))
    height = float(film @ across)
    thick = thick_lens_of(state.setting.lens, state.setting.film_distance_mm, camera.wavelength_nm)
    ahead = min(APPROACH * state.size_mm, state.object_mm)
    lines = []
    for pupil in np.linspace(-1.0, 1.0, RAY_FAN).tolist():
        behind = height - (thick.film_slope[0] * height + thick.film_slope[1] * pupil) * state.setting.film_distance_mm
        before = thick.height[0] * height + thick.height[1] * pupil
        slope = thick.slope[0] * height + thick.slope[1] * pupil
        lines.append(
            [[state.film_z, height], [state.lens.length, behind], [0.0, before], [-ahead, before + slope * ahead]]
        )
    angle = float(np.degrees(np.arctan(abs(thick.slope[0] * height))))
    return _ideal(x, y, film, lines, angle)


def _ideal_rays(scene: Scene, x: float, y: float) -> dict[str, Any]:
    """Return the rays of a thin lens or a pinhole."""
    radius, film_z = _ideal_opening(scene)
    camera = scene.camera
    if film_z <= 0:
        return {"x": x, "y": y, "rays": []} | _NO_LIGHT
    film = np.array(film_point(scene, camera, x, y)[:2])
    away = float(np.hypot(*film))
    height = away if film[1] >= 0 else -away
    found = perspective(scene)
    vergence = 0.0 if found is None else 1.0 / found.focus_mm
    lines = []
    for pupil in np.linspace(-radius, radius, RAY_FAN if radius else 1).tolist():
        # towards the object point at -height / film_z per unit of distance, from where the ray leaves the lens
        slope = -height / film_z - pupil * vergence
        lines.append([[film_z, height], [0.0, pupil], [-film_z, pupil + slope * film_z]])
    return _ideal(x, y, film, lines, float(np.degrees(np.arctan2(away, film_z))))


def _ideal(x: float, y: float, film: Array, lines: list[list[list[float]]], angle: float) -> dict[str, Any]:
    nm = LINES_NM[1]
    rays = [
        {"points": np.round(line, 4).tolist(), "wavelength_nm": round(nm, 2), "colour": wavelength_colour(nm),
         "passed": True, "stopped_by": None, "why": None}
        for line in lines
    ]  # fmt: skip
    place = [round(float(value), 4) for value in film]
    return {"x": x, "y": y, "film_mm": place, "rays": rays, "field_degrees": round(angle, 3), "spot": None, "mtf": None}


_PANELS_KEPT = 8  # lens states


class LensPanel:
    """What the viewfinder shows of the lens.

    Parameters
    ----------
    device
        What traces the rays; used by one thread at a time.
    """

    def __init__(self, device: Session) -> None:
        self._device = device
        self._states: Memory[LensState] = Memory(_PANELS_KEPT)
        self._results: Memory[Any] = Memory(4 * _PANELS_KEPT)

    def section(self, resolved: Scene) -> dict[str, Any]:
        """Return the lines of the cross-section [mm]: surfaces, glass, stop, film, pupils; fewer for ideal cameras."""
        if resolved.camera.lens_camera is None:
            return _ideal_section(resolved)
        found: dict[str, Any] = self._once("section", resolved, lambda: _lens_section(self._state(resolved)))
        return found

    def numbers(self, resolved: Scene) -> dict[str, Any]:
        """Return the numbers of the camera in its state; None where there is no such number."""

        def find() -> dict[str, Any]:
            if resolved.camera.lens_camera is not None:
                return _lens_numbers(self._state(resolved))
            return camera_numbers(resolved) | {"entrance_pupil": None, "exit_pupil": None}

        found: dict[str, Any] = self._once("numbers", resolved, find)
        return found

    def pointer(self, resolved: Scene, x: float, y: float) -> dict[str, Any]:
        """Return rays, spot and transfer of a point of the picture, in fractions from its left and top.

        Raises
        ------
        InputError
            The point lies outside the picture.
        """
        if not (0 <= x <= 1 and 0 <= y <= 1):
            raise InputError(f"pointer: lies outside the picture (got {x:g}, {y:g}; allowed: 0 to 1)")
        if resolved.camera.traced_camera is not None:
            return _pointer_rays(self._state(resolved), x, y)
        if resolved.camera.lens_camera is not None:
            return _thick_rays(self._state(resolved), x, y)
        return _ideal_rays(resolved, x, y)

    def guides(self, resolved: Scene) -> dict[str, Any]:
        """Return the image circle as an ellipse in fractions of the picture; None where it does not limit the film."""
        radius = None
        if resolved.camera.traced_camera is not None:
            radius = self._once("circle", resolved, lambda: image_circle_mm(self._state(resolved)))
        if radius is None:
            return {"image_circle": None}
        width_mm, height_mm = (side * 1e3 for side in resolved.film.size_m())
        return {"image_circle": {"x": 0.5, "y": 0.5, "rx": radius / width_mm, "ry": radius / height_mm}}

    def _state(self, resolved: Scene) -> LensState:
        return self._states.find_or_make(optics_key(resolved), lambda: lens_state(resolved, self._device))

    def _once(self, what: str, resolved: Scene, find: Callable[[], Any]) -> Any:
        """Look up a result for this state of the lens, or compute it."""
        return self._results.find_or_make((what, optics_key(resolved)), find)
