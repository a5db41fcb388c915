"""The lens of a camera as its scene sets it: a copy, zoomed, stopped down, focused, moved; its entrance pupil."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import field
from functools import partial
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, Literal, TypedDict

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import LOSS_TABLE_LENGTH, LOSS_TABLE_NM
from rptcam_cl.core.remember import remember
from rptcam_cl.optics import lens as lenses
from rptcam_cl.optics.as_built import Heat
from rptcam_cl.optics.beams import ChiefRays, film_chief_rays, round_chief_rays
from rptcam_cl.optics.best_focus import best_film_distance, best_film_distance_at
from rptcam_cl.optics.files.glasses import coating_of
from rptcam_cl.optics.film_probe import UNMOVED, FilmFrame, FilmProbe
from rptcam_cl.optics.glass import BARE, Coating, Interface, Layer, LayerStack, Medium, QuarterWave, attenuation
from rptcam_cl.optics.lens import Lens, film_distance
from rptcam_cl.optics.ray_trace import LensTransmission, axis_points, has_coatings, known_nm, with_coating
from rptcam_cl.rendering.cameras.pupil import SamplingMetadata, by_content, on_disk, without_shape
from rptcam_cl.scene.camera import NO_MOVEMENTS, NOT_FOUND_YET, CameraKind, LensCamera, pose_matrix
from rptcam_cl.scene.changes import at_opening, set_keys
from rptcam_cl.scene.lens_settings import CoatingLayers, Focus
from rptcam_cl.scene.placement import CameraKeyframe
from rptcam_cl.scene.scene import Scene

if TYPE_CHECKING:
    from rptcam_cl.rendering.tolerance_run import ChosenCopy


# The film of a view camera: how a scene's movements place it, on the host and for ``kernels/camera/film_point.h``.

Array = NDArray[np.float64]


# What a picture's metadata say of its camera.


class Intrinsics(TypedDict, total=False):
    """What projects points of a camera's frame on the picture, as `intrinsics` says."""

    fx: float
    fy: float
    cx: float
    cy: float
    matrix: list[list[float]]
    distortion: Literal["none", "traced lens"]


class PupilMetadata(TypedDict, total=False):
    """What metadata say of an entrance pupil; None of what is infinite."""

    world_m: list[float] | None  # added where a picture is described
    ahead_of_eye_mm: float | None
    diameter_mm: float | None
    drift_mm: dict[str, float]  # by the field


class CameraMetadata(SamplingMetadata, total=False):
    """What a picture's metadata say of its camera; what a kind has not is left out."""

    camera: str  # its kind
    lens: str
    zoom: str | None
    focal_length_mm: float | None  # None of a lens without power
    f_number: float | None
    film_distance_mm: float
    focus_distance_m: float | None  # None where nothing is sharp
    focus_method: str | None
    focus_field: list[float] | None
    focused_by: str | None
    wavelength_nm: float
    as_built: dict[str, Any]
    temperature_c: float
    pressure_hpa: float
    movements: dict[str, Any]
    intrinsics: Intrinsics
    entrance_pupil: PupilMetadata
    on_axis_irradiance: float | None  # for radiance 1
    transmittance: float  # on the axis
    lens_precision: str
    lens_rays: str
    lens_degree: int
    lens_rims: int
    lens_error_px: float
    lens_light_error: float
    lens_colour_px: float
    lens_colour_sampling_px: float  # its standard error
    lens_tint: float
    lamps_aimed_at: int
    working_f_number: float
    t_number: float
    values_per_irradiance: float
    exposure_time_s: float
    iso: float
    ev100: float
    exposure_ev: float
    neutral_density_stops: float


# How the film stands behind the lens.


def film_frame(camera: CameraKind) -> FilmFrame:
    """Return how the film of a camera stands behind its lens [mm]."""
    movements = camera.film_movements
    if movements == NO_MOVEMENTS:
        return UNMOVED
    return FilmFrame((-movements.shift_mm, -movements.rise_mm), *movements.sides())


def half_film_mm(scene: Scene) -> tuple[float, float]:
    """Return half the sides of a scene's film [mm]."""
    width, height = scene.film.size_m()
    return width * 500.0, height * 500.0


def place_film(record: NDArray[np.void], scene: Scene, distance_mm: float | None = None) -> dict[str, int]:
    """Write where the film stands into a camera record, and return the facts that say whether it does so.

    Parameters
    ----------
    distance_mm
        Of the film of an ideal camera, whose lengths are then in its units; by default they are millimetres.

    Raises
    ------
    InputError
        When the film of an ideal camera reaches its lens.
    """
    frame = film_frame(scene.camera)
    if not frame.is_moved:
        return {}
    unit = 1.0 if distance_mm is None else distance_mm
    if distance_mm is not None and np.any(distance_mm + frame.corners(half_film_mm(scene))[:, 2] <= 0):
        raise reaches_lens(distance_mm)
    for name, vector, length in (
        ("film_centre", (*frame.centre, 0.0), 1.0),
        ("film_across", frame.across, half_film_mm(scene)[0]),
        ("film_up", frame.up, half_film_mm(scene)[1]),
        ("film_normal", frame.normal, unit),
    ):
        record[name][0, :3] = np.array(vector) * length / unit
    record["film_centre"][0, 3] = 1e3 / unit
    return {"FILM_MOVED": 1}


def place_fold(record: NDArray[np.void], lens: Lens) -> dict[str, int]:
    """Write to a camera's record how the axes of the scene stand in the frame of its lens; return the facts."""
    if lens.fold is None:
        return {}
    turn = lens.fold.matrix().T
    rows = np.column_stack([turn, -turn @ np.array(lens.fold.offset)])
    for name, row in zip(("fold_x", "fold_y", "fold_z"), rows, strict=True):
        record[name][0] = row
    return {"LENS_FOLD": 1}


def check_film(lens: Lens, film_distance_mm: float, scene: Scene) -> None:
    """Refuse a film that reaches the lens.

    Raises
    ------
    InputError
        When a corner of the film stands in the last surface, or before it.
    """
    frame = film_frame(scene.camera)
    if not frame.is_flat:
        probe = FilmProbe(lens, film_distance_mm, scene.camera.wavelength_nm, frame)  # type: ignore[union-attr]
        if probe.reaches_lens(half_film_mm(scene)):
            raise reaches_lens(film_distance_mm)


def reaches_lens(distance_mm: float) -> InputError:
    """Return the error of a film that is turned into its lens."""
    return InputError(
        f"camera.movements: a corner of the film would stand in the lens ({distance_mm:.6g} mm before its centre;"
        " allowed: less tilt and swing, or a smaller film)"
    )


def movements_metadata(camera: CameraKind) -> CameraMetadata:
    """The movements for a picture's metadata, and which way the film faces."""
    movements = camera.film_movements
    if movements == NO_MOVEMENTS:
        return {}
    frame = film_frame(camera)
    return {
        "movements": movements.model_dump()
        | {"film_centre_mm": [*frame.centre, 0.0], "film_normal": list(frame.normal)}
    }


# The lens of a camera as it really is: the copy of its design that its scene names, at its temperature.


@dataclass(frozen=True)
class RealState:
    """How the lens of a camera differs from its design.

    A camera is focused by the scale of its design: the film is where the design would be sharp, moved by what was
    adjusted when the copy was made, and then by the barrel, which grows with heat.

    Attributes
    ----------
    copy : ChosenCopy or None
    heat : Heat or None
    """

    copy: ChosenCopy | None = None
    heat: Heat | None = None

    def lens(self, state: Lens) -> Lens:
        """The lens as it is made and as warm as it is, in a state of its design."""
        made = state if self.copy is None else self.copy.lens(state)
        return made if self.heat is None else self.heat.lens(made)

    def film(self, film_distance_mm: float) -> float:
        """Return where the film really stands, behind the last vertex, that the design has at a distance [mm]."""
        cold = film_distance_mm if self.copy is None else film_distance_mm + self.copy.shift_mm
        return cold if self.heat is None else self.heat.film(cold)

    @property
    def metadata(self) -> CameraMetadata:
        """What the picture's metadata should say; nothing of a design."""
        said: CameraMetadata = {}
        if self.copy is not None:
            copy = self.copy
            merit = {"spot_um": copy.spot_um, "mtf": copy.mtf, "refocus_mm": copy.shift_mm}
            said["as_built"] = {"percentile": copy.percent, "copy": copy.number, **merit}
        if self.heat is not None:
            said["temperature_c"], said["pressure_hpa"] = self.heat.celsius, self.heat.pressure_hpa
        return said


DESIGN = RealState()


def lens_camera(scene: Scene) -> LensCamera:
    """Return the camera of a scene.

    Raises
    ------
    InputError
        When it has no lens of surfaces.
    """
    camera = scene.camera.lens_camera
    if camera is None:
        raise scene.camera.lacks("a lens of surfaces")
    return camera


def _real_state(scene: Scene) -> RealState:
    """Return how the lens of a scene's camera differs from its design.

    Raises
    ------
    InputError
        When the tolerances are wrong or do not suit the lens, or nothing says how one of its glasses takes heat.
    """
    camera = lens_camera(scene)
    heat = camera.heat
    if heat is not None:
        try:
            heat.lens(scene.load_lens())
        except InputError as problem:
            raise InputError(f"camera.lens.temperature_c: {problem}") from None
    if camera.as_built is None:
        return DESIGN if heat is None else RealState(heat=heat)
    from rptcam_cl.rendering.tolerance_run import chosen_copy
    from rptcam_cl.rendering.tolerances import specification

    source = scene.tolerances_source()
    assert source is not None
    try:
        return RealState(chosen_copy(scene.load_lens(), specification(source), camera.as_built.percent), heat)
    except InputError as problem:
        place = "camera.lens.as_built: " if isinstance(source, str) else ""
        raise InputError(f"{place}{problem}") from None


# Light that surfaces and glass take: from the settings of the scene to the numbers of the device.


def _transmission_of(camera: LensCamera) -> LensTransmission:
    """Return the losses that count."""
    requested = camera.transmission
    return LensTransmission(
        fresnel=requested.fresnel,
        coatings=requested.fresnel and requested.coatings is not False,
        absorption=requested.absorption,
    )


def _as_coated(lens: Lens, camera: LensCamera) -> Lens:
    """Return the lens with the coating that the camera puts on it, if any.

    Raises
    ------
    InputError
        When coatings must count and the lens does not say how it is coated, or when losses that count are not known at
        the camera's wavelength.
    """
    lens = _coat(lens, camera)
    low, high = known_nm(lens, _transmission_of(camera))
    if not low <= camera.wavelength_nm <= high:
        raise InputError(
            f"camera.transmission: what {lens.name} absorbs or reflects is known from {low:g} to {high:g} nm"
            f" (camera.wavelength_nm is {camera.wavelength_nm:g})"
        )
    return lens


def _coat(lens: Lens, camera: LensCamera) -> Lens:
    coating = camera.transmission.coating
    if coating is not None:
        return with_coating(lens, _coating_of(coating))
    if camera.transmission.coatings and not has_coatings(lens):
        raise InputError(
            f"camera.transmission: {lens.name} does not say how it is coated"
            " (allowed: ideal, bare, or a coating for it such as {coating: mgf2})"
        )
    return lens


def _coating_of(coating: str | float | CoatingLayers) -> Coating:
    if isinstance(coating, CoatingLayers):
        return coating_of(tuple(Layer(layer.index, layer.thickness_nm, layer.extinction) for layer in coating.layers))
    return coating_of(coating)


Values = Callable[[Array], Array]  # of wavelengths [nm]

_TABLE_NM = LOSS_TABLE_NM + np.arange(float(LOSS_TABLE_LENGTH))  # catalogues measure at whole nanometres
FACTS = ("LENS_FRESNEL", "LENS_LAYERS", "LENS_STACKS", "LENS_DARK_LAYERS", "LENS_ABSORPTION", "LENS_TINTED")
_NO_LOSSES = dict.fromkeys(FACTS, 0)


@dataclass
class LossFiller:
    """Fills records of surfaces.

    Attributes
    ----------
    transmission : LensTransmission
    wavelength_nm : float
        Of all rays; where there are tables, of those values that do not depend on it.
    range_nm : (low, high) or None
        Wavelengths that the lens is known for [nm]; beyond them the last value stays. None when all rays have one
        wavelength.
    start : int
        Where the first table over the wavelength will stand.
    tables : list of array
        Each of which is there once.
    """

    transmission: LensTransmission
    wavelength_nm: float
    range_nm: tuple[float, float] | None
    start: int
    tables: list[Array] = field(default_factory=list)

    def fill(self, records: NDArray[np.void], lens: Lens, backwards: bool) -> dict[str, int]:
        """Fill what each surface, and the glass before it, let through, in order of travel; return the facts."""
        if not self.transmission:
            return _NO_LOSSES
        count = len(lens.surfaces)
        for name in ("index", "gain", "attenuation"):
            records[f"{name}_table"] = -1
        for number, record in enumerate(records):
            k = count - 1 - number if backwards else number
            before, after = (lens.media[k + 1], lens.media[k]) if backwards else (lens.media[k], lens.media[k + 1])
            if lens.surfaces[k].is_mirror:
                self._put(record, "gain", partial(self.transmission.mirror_share, lens.surfaces[k]))
            elif self.transmission.fresnel:
                self._fill_surface(record, before, after, self.transmission.coating_of(lens.surfaces[k]))
            if self.transmission.absorption and number > 0 and before.absorption is not None:
                self._put(record, "attenuation", partial(attenuation, before))
        stacks = bool(np.any(records["stacked"] > 0))
        layers = stacks or bool(np.any(records["layer"] > 0))
        return {
            "LENS_FRESNEL": int(self.transmission.fresnel),
            "LENS_LAYERS": int(layers),
            "LENS_STACKS": int(stacks),
            "LENS_DARK_LAYERS": int(bool(np.any(records["extinction"] > 0))),
            "LENS_ABSORPTION": int(bool(np.any((records["attenuation"] > 0) | (records["attenuation_table"] >= 0)))),
            "LENS_TINTED": int(self.range_nm is not None and (layers or bool(self.tables))),
        }

    def _fill_surface(self, record: np.void, before: Medium, after: Medium, coating: Coating) -> None:
        record["gain"] = 1.0
        if isinstance(coating, QuarterWave):
            record["layer"] = coating.index
            record["layer_turns"] = 0.5 * coating.wavelength_nm / (self.wavelength_nm if self.range_nm is None else 1.0)
            self._put(record, "index", before.index)
        elif isinstance(coating, LayerStack):
            layers = coating.from_behind(before.index(LINE_D_NM), after.index(LINE_D_NM))
            per = self.wavelength_nm if self.range_nm is None else 1.0
            record["stack"][: 2 * len(layers)] = [x for f in layers for x in (f.index, f.index * f.thickness_nm / per)]
            record["extinction"][: len(layers)] = [layer.extinction for layer in layers]
            record["stacked"] = len(layers)
            self._put(record, "index", before.index)
        elif coating != BARE:

            def gain(nm: Array) -> Array:
                head_on = Interface(before.index(nm), after.index(nm))
                return coating.transmittance(head_on, nm) / BARE.transmittance(head_on, nm)

            self._put(record, "gain", gain)

    def _put(self, record: np.void, name: str, values: Values) -> None:
        """Fill a value and the place of its table."""
        record[name] = values(np.asarray(self.wavelength_nm))
        record[f"{name}_table"] = self._place(values)

    def _place(self, values: Values) -> int:
        """Find where the table of a function of wavelengths [nm] stands, -1 when it is the same everywhere."""
        if self.range_nm is None:
            return -1
        row = np.asarray(values(np.clip(_TABLE_NM, *self.range_nm)))
        if np.ptp(row) == 0:
            return -1
        known = [k for k, other in enumerate(self.tables) if np.array_equal(row, other)]
        if not known:
            self.tables.append(row)
        return self.start + (known[0] if known else len(self.tables) - 1) * LOSS_TABLE_LENGTH


# The lens of a camera as its scene sets it: zoomed, stopped down and focused.

Method = Literal["thick", "spot"]
Side = Literal["film", "front"]
_FilmPoint = tuple[float, float, float] | None

ROUNDS = 30  # of the searches below, which need three to six
CONVERGED = 1e-8  # of a distance, between two rounds
CONVERGED_AT_A_POINT = 1e-5  # the same for a spot off the axis, found to a millionth


def focused(
    lens: Lens,
    distance_mm: float,
    measured_from: Side,
    method: Method,
    wavelength_nm: float,
    film_point_mm: _FilmPoint = None,
) -> tuple[Lens, float]:
    """Return the lens focused on an object plane, and the distance from its last vertex to the film [mm].

    Parameters
    ----------
    lens
        At its working aperture.
    distance_mm
        From the object plane to the film or to the first vertex.
    method
        ``thick``: by first-order optics. ``spot``: by the least rms spot of traced rays.
    film_point_mm
        Where that spot lies on the film: x and y in the frame of the lens, and how far behind the film distance; on the
        axis when absent.

    Raises
    ------
    InputError
        When the distance is out of reach; the nearest possible is named.
    """
    if lens.floating and not lens.focuses_by_group:
        lens = _float_groups_for(lens, distance_mm, measured_from, wavelength_nm)
    if not lens.focuses_by_group:
        return lens, _film_distance(lens, distance_mm, measured_from, method, wavelength_nm, film_point_mm)
    film = film_distance(lens, np.inf, wavelength_nm=wavelength_nm)
    if measured_from == "film":
        return _by_group(lens, distance_mm, film, method, wavelength_nm, film_point_mm)
    converged = CONVERGED if film_point_mm is None else CONVERGED_AT_A_POINT
    whole = distance_mm + lens.length + lens.sense * film
    for _ in range(ROUNDS):
        state, back = _by_group(lens, whole, film, method, wavelength_nm, film_point_mm)
        new = distance_mm + state.length + state.sense * back  # the first vertex may belong to the group
        if abs(new - whole) <= converged * whole:
            return state, back
        whole = new
    raise InputError(f"{lens.name}: its group finds no focus {distance_mm:g} mm in front of the first surface")


def _float_groups_for(lens: Lens, distance_mm: float, measured_from: Side, wavelength_nm: float) -> Lens:
    """Return the lens with its floating groups set for an object plane."""
    if measured_from == "film":
        return lenses.float_groups(lens, distance_mm)
    state = lens
    for _ in range(ROUNDS):  # the state decides how far the film is, which decides the state
        film = film_distance(state, distance_mm, "front", wavelength_nm)
        new = lenses.float_groups(lens, distance_mm + state.length + film)
        if abs(new.length - state.length) <= CONVERGED * lens.length:
            return new
        state = new
    return state


def _film_distance(
    lens: Lens, distance_mm: float, measured_from: Side, method: Method, wavelength_nm: float, film_point_mm: _FilmPoint
) -> float:
    if method == "spot" and film_point_mm is not None:
        x, y, depth = film_point_mm
        there = distance_mm + depth if measured_from == "film" else distance_mm
        return best_film_distance_at(lens, (x, y), there, measured_from, wavelength_nm) - depth
    if method == "spot":
        return best_film_distance(lens, distance_mm, measured_from, (wavelength_nm,))
    return film_distance(lens, distance_mm, measured_from, wavelength_nm)


def _by_group(
    lens: Lens,
    distance_mm: float,
    film_distance_mm: float,
    method: Method,
    wavelength_nm: float,
    film_point_mm: _FilmPoint,
) -> tuple[Lens, float]:
    """Return the lens with its group moved, for a film that stays, and the film distance [mm].

    The least spot lies at an offset from the first-order image. So the group is focused by first-order optics for a
    film displaced by an offset the other way; a secant search finds the offset that is that of the lens so moved.
    """
    offset = before = error_before = 0.0
    for _ in range(ROUNDS):
        state, image = lenses.focused_by_group(lens, distance_mm - offset, film_distance_mm - offset, wavelength_nm)
        if method == "thick":
            return state, image
        front = distance_mm - offset - state.length - state.sense * image
        error = _film_distance(state, front, "front", method, wavelength_nm, film_point_mm) - image - offset
        if abs(error) <= (CONVERGED if film_point_mm is None else CONVERGED_AT_A_POINT) * film_distance_mm:
            return state, image + offset
        slope = (error - error_before) / (offset - before) if offset != before else -1.0
        offset, before, error_before = offset - error / slope, offset, error
    raise InputError(f"{lens.name}: its group finds no least spot for {distance_mm:g} mm from the film")


@dataclass(frozen=True)
class LensSetting:
    """A lens in use.

    Attributes
    ----------
    lens : Lens
        Zoomed, stopped down, and with its focusing group in place.
    film_distance_mm : float
        Last vertex to film.
    focus_distance_mm : float or None
        Object plane in focus to film; None when the film stands where no object is sharp.
    camera : LensCamera
        The request.
    real : RealState
        How the lens differs from its design.
    """

    lens: Lens
    film_distance_mm: float
    focus_distance_mm: float | None
    camera: LensCamera
    real: RealState = DESIGN

    @property
    def gain(self) -> float:
        """Irradiance over that of the same rays in one medium: what a ray keeps is radiance over the squared index."""
        indices = self.lens.indices(self.camera.wavelength_nm)
        return float(indices[-1] / indices[0]) ** 2

    @property
    def transmission(self) -> LensTransmission:
        """Losses in the lens that count."""
        return _transmission_of(self.camera)

    @property
    def metadata(self) -> CameraMetadata:
        """What the picture's metadata should say."""
        first = self.lens.first_order(self.camera.wavelength_nm)
        focus = self.camera.focus
        sought = focus.film_distance_mm is None and focus.group_shift_mm is None
        return {
            "lens": self.lens.name,
            "zoom": self.camera.zoom,
            "focal_length_mm": _finite(first.focal_length_mm),
            "f_number": _finite(first.f_number),
            "film_distance_mm": self.film_distance_mm,
            "focus_distance_m": None if self.focus_distance_mm is None else self.focus_distance_mm * 1e-3,
            "focus_method": focus.method if sought else None,
            "focus_field": None if focus.field is None else list(focus.field),
            "focused_by": ("group" if self.lens.focuses_by_group else "whole lens") if sought else None,
            "wavelength_nm": self.camera.wavelength_nm,
            **self.real.metadata,
        }


def _finite(value: float) -> float | None:
    """Return a number, or None for the infinite focal length of a lens without power."""
    return value if np.isfinite(value) else None


def lens_setting(scene: Scene) -> LensSetting:
    """Return the lens of a scene's camera in use.

    Raises
    ------
    InputError
        When it cannot be zoomed, stopped down or focused as requested.
    """
    if scene.camera.followed is not None or scene.camera.stands_by_pupil:
        scene = at_opening(on_film(scene))
    camera = lens_camera(scene)
    lens, focus, real = design_to_focus(scene, camera), camera.focus, _real_state(scene)
    if focus.film_distance_mm is not None:
        lens, film_distance_mm = real.lens(lens), focus.film_distance_mm
        return LensSetting(lens, film_distance_mm, _sharp_at(lens, film_distance_mm, camera), camera, real)
    if focus.group_shift_mm is not None:
        return _at_shift(lens, focus.group_shift_mm, camera, real)
    if focus.auto is not None:
        raise InputError(NOT_FOUND_YET)
    if focus.front_distance_m is not None:
        distance_mm = focus.front_distance_m * 1e3
    elif focus.point is not None:
        distance_mm = camera.ahead(focus.point) * scene.metres_per_unit * 1e3
    else:
        assert focus.distance_m is not None
        distance_mm = focus.distance_m * 1e3
    side: Side = "film" if focus.front_distance_m is None else "front"
    nm, field = camera.wavelength_nm, focus.field
    sharpest = None if field is None else film_point(scene, camera, *field)
    lens, film_distance_mm = focused(lens, distance_mm, side, focus.method, nm, sharpest)
    if side == "front":
        distance_mm = distance_mm + lens.length + lens.sense * film_distance_mm
    return LensSetting(real.lens(lens), real.film(film_distance_mm), distance_mm, camera, real)


# Where the film is of a camera that stands by its entrance pupil.
#
# Everything but this takes the eye for the centre of the film, so that such a scene is replaced by one that says the
# same of its film before anything is made of it.

_LEAST_TURN = 0.01  # radians of view between keyframes: the film is on its arc within its lever / 80,000
FARTHEST_MM = 1e6  # between eye and film; a pupil that lies farther away is no place to stand at
PLACED = 1e-12  # relative change of the pupil's place at which it is found


def on_film(scene: Scene) -> Scene:
    """Return a scene whose eye is the centre of the film: itself, unless its camera stands by its entrance pupil.

    The pupil is that of the lens in use when the shutter opens, on the axis, to first order. A focus at a point or an
    object becomes one at its distance then.

    Raises
    ------
    InputError
        When the entrance pupil lies at infinity.
    """
    if not scene.camera.stands_by_pupil:
        return scene
    still = at_opening(scene)
    camera, here = lens_camera(scene), lens_camera(still)
    found = {} if here.focus.point is None else {"focus": _from_pupil(still, here, here.focus.point)}
    state = still.model_copy(update={"camera": here.model_copy(update={"stands_at": "film"} | found)})
    ahead_mm = entrance_pupil(state, lens_setting(state), drifts=False).ahead_mm
    if not abs(ahead_mm) < FARTHEST_MM:
        name = lens_setting(state).lens.name
        raise InputError(f"camera.stands_at: the entrance pupil of {name} lies at infinity, or nearly (allowed: film)")
    behind = ahead_mm * 1e-3 / scene.metres_per_unit
    eye, target, _ = _set_back(np.array([camera.eye, camera.target, camera.up]), behind)
    motion = _motion_set_back(camera, behind, scene.shutter.span_s)
    update = {"eye": eye, "target": target, "motion": motion, "stands_at": "film"} | found
    if scene.shutter.keys:  # which make the scene anew of its keys
        return set_keys(scene, {f"camera.{name}": value for name, value in update.items()})
    return scene.model_copy(update={"camera": camera.model_copy(update=update)})


def _from_pupil(scene: Scene, camera: LensCamera, point: tuple[float, float, float]) -> Focus:
    """Return the focus at a point that is known from the entrance pupil, by its distance from the first surface."""
    wanted_mm = camera.ahead(point) * scene.metres_per_unit * 1e3
    pupil_mm, focus = 0.0, camera.focus
    for _ in range(ROUNDS):  # what focuses the lens may move its pupil
        front_m = (wanted_mm - pupil_mm) * 1e-3
        focus = Focus(front_distance_m=front_m, method=camera.focus.method, field=camera.focus.field)
        known = camera.model_copy(update={"focus": focus, "stands_at": "film"})
        setting = lens_setting(scene.model_copy(update={"camera": known}))
        before, pupil_mm = pupil_mm, setting.lens.first_order(camera.wavelength_nm).entrance_pupil.distance_mm
        if not abs(pupil_mm - before) > PLACED * wanted_mm:  # also at infinity, which is no place to measure from
            break
    return focus


def _set_back(pose: Array, behind: float) -> tuple[tuple[float, ...], ...]:
    """Return eye, target and up (3, 3) of a camera that stands further back, looking the same way."""
    shift = behind * pose_matrix(pose)[:3, 2]
    eye, target, up = (tuple(row.tolist()) for row in pose + np.array([shift, shift, 0.0 * shift]))
    return eye, target, up


def _motion_set_back(camera: LensCamera, behind: float, shutter_s: tuple[float, float]) -> tuple[CameraKeyframe, ...]:
    """Return keyframes of the film: as it turns about the pupil it goes along an arc, while the shutter is open by
    short steps."""
    frames: list[CameraKeyframe] = []
    times = [frame.time_s for frame in camera.motion]
    for begin, end in zip_longest(times, times[1:]):
        steps = 1
        if end is not None and end > shutter_s[0] and begin < shutter_s[1]:
            turn = math.acos(np.clip(_view(camera, begin) @ _view(camera, end), -1.0, 1.0))
            steps = max(math.ceil(turn / _LEAST_TURN), 1)
        for time_s in [begin] if end is None else np.linspace(begin, end, steps, endpoint=False).tolist():
            eye, target, up = _set_back(camera.pose_at(time_s), behind)
            frames.append(CameraKeyframe(time_s=time_s, eye=eye, target=target, up=up))
    return tuple(frames)


def _view(camera: LensCamera, time_s: float) -> Array:
    return -pose_matrix(camera.pose_at(time_s))[:3, 2]


def film_point(scene: Scene, camera: CameraKind, right: float, down: float) -> tuple[float, float, float]:
    """Return where on the film a point of the picture lies [mm]: x, y in the frame of the lens, depth behind the film
    distance.

    A lens inverts: right and up in an upright picture are left and down on the film.

    Parameters
    ----------
    right, down
        Fractions of the picture from its left and top edges.
    """
    width_mm, height_mm = (side * 1e3 for side in scene.film.size_m())
    sense = -1.0 if camera.flip else 1.0
    film = np.array([sense * (right - 0.5) * width_mm, sense * (0.5 - down) * height_mm])
    x, y, depth = film_frame(camera).points(film).tolist()
    return x, y, depth


def lens_to_focus(scene: Scene, camera: LensCamera) -> Lens:
    """Return the lens as it really is, at its focal length and working aperture."""
    return _real_state(scene).lens(design_to_focus(scene, camera))


def film_for_infinity(scene: Scene, camera: LensCamera) -> float:
    """Return the distance from the last vertex to a film that stays where the scale says infinity [mm]."""
    design = design_to_focus(scene, camera)
    return _real_state(scene).film(film_distance(design, np.inf, wavelength_nm=camera.wavelength_nm))


def design_to_focus(scene: Scene, camera: LensCamera) -> Lens:
    """Return the design of the lens at its focal length and working aperture."""
    lens = _as_coated(scene.load_lens(), camera)
    lens = lenses.at_position(lens, camera.zoom, camera.focal_length_mm, camera.wavelength_nm)
    if camera.f_number is not None:
        return lens.with_stop_diameter(lens.stop_diameter_for(camera.f_number, camera.wavelength_nm))
    if camera.stop_diameter_mm is not None:
        return lens.with_stop_diameter(camera.stop_diameter_mm)
    return lens


def _at_shift(lens: Lens, shift_mm: float, camera: LensCamera, real: RealState) -> LensSetting:
    if not lens.focuses_by_group:
        raise InputError(f"camera.focus.group_shift_mm: {lens.name}: has no focusing group (allowed: film_distance_mm)")
    low, high = lenses.travel_mm(lens)
    if not low <= shift_mm <= high:
        raise InputError(
            f"camera.focus.group_shift_mm: beyond the travel of the group (got {shift_mm:g};"
            f" allowed: {low:g} to {high:g})"
        )
    infinity_mm = real.film(film_distance(lens, np.inf, wavelength_nm=camera.wavelength_nm))
    state, film_distance_mm = (
        lenses.move_group(real.lens(lens), shift_mm),
        lenses.film_behind(lens, shift_mm, infinity_mm),
    )
    return LensSetting(state, film_distance_mm, _sharp_at(state, film_distance_mm, camera), camera, real)


def _sharp_at(lens: Lens, film_distance_mm: float, camera: LensCamera) -> float | None:
    try:
        return lenses.object_distance(lens, film_distance_mm, camera.wavelength_nm)
    except InputError:  # the film lies where no object images: legal, just never sharp
        return None


#
# Where the entrance pupil of a camera lies: the centre of its perspective, and how it drifts over the field.
#
# Programs that measure in pictures take the camera for a point. That point is the entrance pupil, which lies ahead of
# the eye with most lenses: the eye is the middle of the film. Away from the axis a real lens has its entrance pupil
# elsewhere, which near objects show.

FIELDS = (0.5, 1.0)  # of the way from the middle of the film to its corners, where the drift is found
REMEMBERED = 64  # lens states whose drift is kept


@dataclass(frozen=True)
class EntrancePupil:
    """The entrance pupil of a camera.

    Attributes
    ----------
    ahead_mm : float
        How far it lies ahead of the eye on the axis [mm]; infinite where it has no place.
    diameter_mm : float
        0 for a point.
    drift_mm : tuple of (field, drift)
        For places of the film, of how far they are from its middle (1: its corners), the mean distance from `ahead_mm`
        to where chief rays come nearest to the axis [mm], towards the scene; places without chief rays are left out.
    """

    ahead_mm: float = 0.0
    diameter_mm: float = 0.0
    drift_mm: tuple[tuple[float, float], ...] = ()

    def described(self) -> PupilMetadata:
        """The pupil for the metadata of a picture, but for its place in the world."""
        metadata: PupilMetadata = {
            "ahead_of_eye_mm": self.ahead_mm if math.isfinite(self.ahead_mm) else None,
            "diameter_mm": self.diameter_mm if math.isfinite(self.diameter_mm) else None,
        }
        if self.drift_mm:
            metadata["drift_mm"] = {f"{field:g}": drift for field, drift in self.drift_mm}
        return metadata


def pupil_in_world(scene: Scene, described: PupilMetadata) -> PupilMetadata:
    """Return a described entrance pupil with its place in the world [m], in the axes of the scene; None without one."""
    ahead_mm = described["ahead_of_eye_mm"]
    if ahead_mm is None:
        return {"world_m": None, **described}
    matrix = pose_matrix(scene.camera.pose_at(scene.shutter.span_s[0]))
    place = matrix[:3, 3] * scene.metres_per_unit - matrix[:3, 2] * ahead_mm * 1e-3
    return {"world_m": place.tolist(), **described}


def entrance_pupil(scene: Scene, setting: LensSetting, *, drifts: bool = True) -> EntrancePupil:
    """Return the entrance pupil of the lens of a scene, with its drift where that is wanted."""
    lens, back, wavelength = setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm
    pupil = lens.first_order(wavelength).entrance_pupil
    if not math.isfinite(pupil.distance_mm):
        return EntrancePupil(math.inf, math.inf)
    ahead = lens.film_z(back) - pupil.distance_mm
    drift = _drift(scene, setting, pupil.distance_mm) if drifts else ()
    return EntrancePupil(ahead, pupil.diameter_mm, drift)


def _drift(scene: Scene, setting: LensSetting, pupil_z: float) -> tuple[tuple[float, float], ...]:
    lens, frame = setting.lens, film_frame(scene.camera)
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(half_film_mm(scene))
    film = frame.points(np.concatenate([corners * field for field in FIELDS]))
    film[:, 2] = lens.film_z(setting.film_distance_mm) + lens.sense * film[:, 2]
    points = tuple(map(tuple, film.tolist()))
    of, wavelength_nm = without_shape(lens), setting.camera.wavelength_nm
    if of.is_rotational and len({z for _, _, z in points}) == 1:
        return tuple(_round_drift(of, points, wavelength_nm, pupil_z))
    return tuple((field, drift) for field, drift in _film_drift(of, points, wavelength_nm, pupil_z))


@remember(most=REMEMBERED, by=by_content)
def _round_drift(
    lens: Lens, film: tuple[tuple[float, ...], ...], wavelength_nm: float, pupil_z: float
) -> list[tuple[float, float]]:
    return _drift_by(round_chief_rays, lens, film, wavelength_nm, pupil_z)


@remember(most=REMEMBERED, by=by_content, disk=on_disk())
def _film_drift(
    lens: Lens, film: tuple[tuple[float, ...], ...], wavelength_nm: float, pupil_z: float
) -> list[tuple[float, float]]:
    return _drift_by(film_chief_rays, lens, film, wavelength_nm, pupil_z)


def _drift_by(
    chief_rays: Callable[[Lens, Array, float], ChiefRays],
    lens: Lens,
    film: tuple[tuple[float, ...], ...],
    wavelength_nm: float,
    pupil_z: float,
) -> list[tuple[float, float]]:
    try:
        rays = chief_rays(lens, np.array(film), wavelength_nm)
    except InputError:  # no surface of the lens limits the light
        return []
    places = np.where(rays.clear, pupil_z - axis_points(rays.origins, rays.directions), np.nan).reshape(len(FIELDS), -1)
    return [
        (field, float(np.mean(row[np.isfinite(row)])))
        for field, row in zip(FIELDS, places, strict=True)
        if np.isfinite(row).any()
    ]
