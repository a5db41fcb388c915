"""How far cheaper camera models are from a traced lens, and which is the cheapest that a picture bears."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.irradiance import on_axis_irradiance
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.surface import StopMask, StopShape
from rptcam_cl.rendering.cameras import kinds, lens_records, ray_map, realistic
from rptcam_cl.rendering.cameras.lens_records import EXTREMES_NM, FAR_MM, colour_error_px, disperses, usable_nm
from rptcam_cl.rendering.cameras.setting import LensSetting, film_frame, lens_setting, on_film
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.film import LensColour
from rptcam_cl.scene.lens_settings import Accuracy
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies import tier_models

# What the traced lens of a scene does, found by rays in float64: cheaper camera models are measured by it.

Array = NDArray[np.float64]

NUDGE = 0.01  # of the half diagonal, between film points that tell the scale of the picture
_SHAPED_RINGS = 16  # of rays through a stop that is not round
CORNERS = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])


@dataclass(frozen=True)
class FieldPoint:
    """What the traced lens does at a film point.

    Attributes
    ----------
    point : (2,) array
        On the film [mm].
    bundle : RayBundle
        Its rays at the wavelength of the camera.
    neighbour : RayBundle
        The same rays from a film point close by.
    apart_px : float
        How many pixels lie between the two.
    colours : tuple of Bundle
        The same rays at other wavelengths.
    light : (n,) array
        Irradiance in a world of radiance 1 as far from the axis as the point; with a stop that is not round, towards
        each corner of the film.
    """

    point: Array
    bundle: tier_models.RayBundle
    neighbour: tier_models.RayBundle
    apart_px: float
    colours: tuple[tier_models.RayBundle, ...]
    light: Array

    @property
    def along(self) -> Array:
        """Direction of the field (2,), of length 1."""
        length = float(np.hypot(*self.point))
        return self.point / length if length else np.array([1.0, 0.0])

    def pixels_per_mm(self, plane_mm: float) -> float:
        """Return the scale of the picture of a plane across the axis; infinite where it has none."""
        steps = self.neighbour.places(plane_mm) - self.bundle.places(plane_mm)
        good = np.isfinite(steps[:, 0])
        step = float(np.hypot(*steps[good].mean(axis=0))) if good.any() else 0.0
        return self.apart_px / step if step > 0 else np.inf

    def colour_mm(self, plane_mm: float) -> float:
        """Return by how much rays of other wavelengths meet a plane beside their place, at most."""
        here = self.bundle.places(plane_mm)
        apart = [np.hypot(*(other.places(plane_mm) - here).T) for other in self.colours]
        return float(max((np.max(each[np.isfinite(each)], initial=0.0) for each in apart), default=0.0))


def _trace_fields(
    setting: LensSetting,
    shape: StopShape | StopMask | None,
    half_film_mm: Array,
    pixel_mm: float,
    shares: Sequence[float],
    colours_nm: Sequence[float] = (),
) -> list[FieldPoint | None]:
    """Trace a lens at film points along the half diagonal; None where it lets no light through.

    Parameters
    ----------
    setting
        The lens in use.
    shape
        Of its stop; None is round.
    half_film_mm
        (2,) half the sides of the film.
    pixel_mm
        Side of a pixel.
    shares
        Of the half diagonal: where the film points lie.
    colours_nm
        Other wavelengths.
    """
    lens, film_distance_mm, own_nm = setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm
    points = np.outer(shares, half_film_mm)
    pupils = tier_models.Pupils.of(lens, film_distance_mm, points, own_nm)
    rear, area = pupils.nodes(tier_models.RINGS)
    nudges = np.where(np.any(points, axis=1)[:, None], -NUDGE, NUDGE) * half_film_mm
    moved = rear + (nudges * _exit_pupil_shift(lens, film_distance_mm, own_nm))[:, None]
    here = _bundles(setting, points, rear, area)
    neighbours = _bundles(setting, points + nudges, moved, area)
    others = [_bundles(setting, points, rear, area, nm) for nm in colours_nm]
    light = np.array([[bundle.light for bundle in here]]) if shape is None else _shaped_light(setting, shape, pupils)
    fields: list[FieldPoint | None] = []
    for k, point in enumerate(points):
        if not here[k].light > 0:
            fields.append(None)
            continue
        good = np.isfinite(here[k].origins[:, 0])
        colours = tuple(other[k].only(good) for other in others)
        apart_px = float(np.hypot(*nudges[k])) / pixel_mm
        fields.append(FieldPoint(point, here[k].only(good), neighbours[k].only(good), apart_px, colours, light[:, k]))
    return fields


def _bundles(
    setting: LensSetting, points: Array, rear: Array, area: Array, wavelength_nm: float | None = None
) -> list[tier_models.RayBundle]:
    """Return the rays from film points (m, 2) through points (m, n, 2) of the plane of the last vertex.

    Parameters
    ----------
    area
        (m, n) of that plane which each ray stands for [mm2].
    wavelength_nm
        That of the camera by default, which losses in the lens are known for.
    """
    lens, film_distance_mm = setting.lens, setting.film_distance_mm
    origins, towards = _from_film(lens, film_distance_mm, points, rear)
    rays = lens.trace(
        origins,
        towards,
        setting.camera.wavelength_nm if wavelength_nm is None else wavelength_nm,
        transmission=setting.transmission if wavelength_nm is None and setting.transmission else None,
    )
    good = rays.passed
    weights = np.where(good, area.ravel() * (film_distance_mm / np.sum(towards**2, axis=1)) ** 2, 0.0)
    if rays.transmittance is not None:
        weights = weights * rays.transmittance
    starts = np.where(good[:, None], rays.origins * (1, 1, -1) + (0, 0, lens.film_z(film_distance_mm)), np.nan)
    leaving = np.where(good[:, None], rays.directions / -rays.directions[:, 2:], np.nan)
    leaving[:, 2] *= -1.0
    shape = (len(points), -1)
    parts = (starts.reshape(*shape, 3), leaving.reshape(*shape, 3), weights.reshape(shape))
    return [tier_models.RayBundle(*part) for part in zip(*parts, strict=True)]


def _exit_pupil_shift(lens: Lens, film_distance_mm: float, wavelength_nm: float) -> float:
    """Return how far rays through a point of the exit pupil move at the last vertex per distance along the film."""
    from_film = film_distance_mm - lens.first_order(wavelength_nm).exit_pupil.distance_mm
    return 1.0 - film_distance_mm / from_film if np.isfinite(from_film) and from_film else 1.0


def _shaped_light(setting: LensSetting, shape: StopShape | StopMask, pupils: tier_models.Pupils) -> Array:
    """Return the irradiance (corners, m) through a stop that is not round, whose mirror images the corners see."""
    rear, area = pupils.nodes(_SHAPED_RINGS)
    light = np.array([bundle.weights for bundle in _bundles(setting, pupils.film, rear, area)])
    at_stop = _at_stop(setting, pupils.film, rear)
    return np.array([np.sum(light * tier_models.coverage(shape, at_stop * side), axis=1) for side in CORNERS])


def _at_stop(setting: LensSetting, film: Array, rear: Array) -> Array:
    """Return where rays from film points (m, 2) cross the stop (m, n, 2), in units of its radius."""
    lens, film_distance_mm = setting.lens, setting.film_distance_mm
    assert lens.stop is not None and lens.stop_index is not None
    behind = replace(lens, surfaces=lens.surfaces[lens.stop_index :], stop_index=0)
    origins, towards = _from_film(behind, film_distance_mm, film, rear)
    rays = behind.trace(origins, towards, setting.camera.wavelength_nm)
    return rays.origins[:, :2].reshape(rear.shape) / lens.stop.semi_diameter


def _from_film(lens: Lens, film_distance_mm: float, film: Array, rear: Array) -> tuple[Array, Array]:
    """Return origins and directions of rays from film points (m, 2) through points (m, n, 2) behind the last vertex."""
    origins, towards = np.empty((2, *rear.shape[:2], 3))
    origins[..., :2], origins[..., 2] = film[:, None], lens.film_z(film_distance_mm)
    towards[..., :2], towards[..., 2] = rear - film[:, None], -lens.sense * film_distance_mm
    return origins.reshape(-1, 3), towards.reshape(-1, 3)


FIELDS = (0.0, 0.25, 0.5, 0.7, 0.85, 1.0)  # film points along its half diagonal
BETWEEN = tuple(low + share * (high - low) for low, high in pairwise(FIELDS) for share in (0.25, 0.5, 0.75))


@dataclass(frozen=True)
class Truth:
    """The traced lens of a scene.

    Attributes
    ----------
    scene : Scene
    first : FirstOrderCamera
        What the lens is to first order.
    shaped : Lens
        It, with its stop in the shape that it has.
    half_film_mm : (2,) array
        Half the sides of the film.
    shares : tuple of float
        Where film points lie along the half diagonal.
    fields : tuple of Field or None
        What the lens does at each of them; None where it sees nothing.
    shape_apart : float
        How far a round stop of the same area lies from its stop, at most, in radii; 0 for a stop that is round.
    tint : float
        How much more of one colour than of another the lens takes, where the picture shows it.
    coloured : bool
        Whether the scene uses the lens's own colours and it has any.
    """

    scene: Scene
    first: tier_models.FirstOrderCamera
    shaped: Lens
    half_film_mm: Array
    shares: tuple[float, ...]
    fields: tuple[FieldPoint | None, ...]
    shape_apart: float
    tint: float
    coloured: bool

    @classmethod
    def of(cls, scene: Scene, first: tier_models.FirstOrderCamera, shares: tuple[float, ...] = FIELDS) -> Truth:
        """Trace the lens of a scene."""
        setting = first.setting
        half_film_mm = np.array(scene.film.size_m()) / 2 * 1e3
        shape = lens_records.stop_shape(scene, scene.camera.outline)
        low, high = usable_nm(setting.lens)
        requested = scene.spectrum.lens_colour != "off"
        coloured = requested and disperses(setting.lens)
        colours_nm = [min(max(end, low), high) for end in EXTREMES_NM] if coloured else []
        pixel_mm = float(2 * half_film_mm[0] / scene.film.resolution[0])
        fields = _trace_fields(setting, shape, half_film_mm, pixel_mm, shares, colours_nm)
        tint = realistic.lens_tint(scene, setting) if requested else 0.0
        lens = lens_records.shaped(scene, setting).lens
        return cls(
            scene, first, lens, half_film_mm, shares, tuple(fields), tier_models.round_stop(shape)[1], tint, coloured
        )

    @property
    def view(self) -> tier_models.VisibleWorld:
        """What the camera may see, ahead of the film: at least as much as to first order."""
        setting = self.first.setting
        start = setting.lens.film_z(setting.film_distance_mm)
        half, slopes = np.zeros(2), self.half_film_mm / self.first.film_mm_per_tangent
        for each in self.fields:
            if each is not None:
                half = np.maximum(half, np.abs(each.bundle.places(start)).max(axis=0))
                slopes = np.maximum(slopes, np.abs(each.bundle.directions[:, :2]).max(axis=0))
        return tier_models.VisibleWorld(start, half, slopes)

    def blur_px(self, depths_mm: Sequence[float]) -> tuple[float, ...]:
        """Return how far light of a point falls from its middle at each film point, at most [pixels]."""
        return tuple(
            np.inf
            if field is None
            else max(
                float(field.bundle.spot(depth, field.along)[2].max()) * field.pixels_per_mm(depth)
                for depth in depths_mm
            )
            for field in self.fields
        )

    def colour_px(self, depths_mm: Sequence[float]) -> tuple[float, ...]:
        """Return how far light of other wavelengths falls from its place at each film point, at most [pixels]."""
        return tuple(
            0.0 if field is None else max(field.colour_mm(depth) * field.pixels_per_mm(depth) for depth in depths_mm)
            for field in self.fields
        )

    def axial(self, tier: tier_models.Tier) -> float:
        """Return the brightness of the film's centre in the picture of a tier, over that of the traced lens."""
        if not realistic.shows_losses(self.scene):
            return 1.0
        setting = self.first.setting
        own = kinds.camera_model(tier_models.equivalent(self.scene, tier)).on_axis_irradiance
        assert own is not None
        true = on_axis_irradiance(
            self.shaped, setting.film_distance_mm, setting.camera.wavelength_nm, setting.transmission
        )
        return own / true


# How far the pictures of cheaper camera models lie from that of the traced lens, found by rays in float64.

EFFECTS = ("distortion", "blur", "outline", "shape", "colour")  # what moves light over the film


@dataclass(frozen=True)
class TierError:
    """What a tier does wrong at each of `FIELDS`.

    Attributes
    ----------
    tier : str
    effects : mapping
        By name of `EFFECTS`: how far light falls from its place, at the worst of the depths [pixels]. Infinite where
        the lens sees nothing. The shift of the middle of a bundle; the change of its spread (standard deviation, along
        the field, across it and in all); the largest distance between the outlines, their middles laid on each other; a
        round stop in place of another; light of another wavelength in the place of the camera's.
    illumination : tuple of float
        Relative error of the irradiance, both being 1 on the axis unless the exposure shows the light there too.
    tint : float
        How much more of one colour than of another is missing, as a share.
    between : mapping
        The largest of each effect between `FIELDS`, where vignetting begins or aberrations turn [pixels].
    """

    tier: tier_models.Tier
    effects: Mapping[str, tuple[float, ...]]
    illumination: tuple[float, ...]
    tint: float = 0.0
    between: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def pixels(self) -> tuple[float, ...]:
        """The largest of the effects at each of `FIELDS` [pixels]."""
        return tuple(max(each) for each in zip(*self.effects.values(), strict=True))

    @property
    def worst_px(self) -> float:
        """The largest error of place [pixels]."""
        return max(*self.pixels, *self.between.values())

    @property
    def worst_illumination(self) -> float:
        """The largest error of brightness."""
        return max(*self.illumination, self.tint)


def tier_error(truth: Truth, depths_mm: Sequence[float], tier: tier_models.Tier) -> TierError:
    """Find the errors of a tier against the traced lens, which has none itself.

    Parameters
    ----------
    depths_mm
        Distances of what the picture shows ahead of the film, along the axis [mm].
    """
    none = (0.0,) * len(truth.fields)
    if tier == "realistic":
        return TierError(tier, dict.fromkeys(EFFECTS, none), none)
    if tier == "fitted":
        return _errors_of_polynomials(tier_models.fit_polynomials(truth.scene, colours=truth.coloured))
    bundles = [tier_models.tier_bundle(truth.first, tier, field * truth.half_film_mm) for field in truth.shares]
    apart = [_bundle_errors(*pair, depths_mm) for pair in zip(truth.fields, bundles, strict=True)]
    distortion, blur, outline = (tuple(column) for column in zip(*apart, strict=True))
    effects = {"distortion": distortion, "blur": blur, "outline": outline, "shape": none, "colour": none}
    if truth.shape_apart and tier not in tier_models.WITH_SHAPES and tier != "pinhole":
        effects["shape"] = tuple(truth.shape_apart * radius for radius in truth.blur_px(depths_mm))
    has_colours = tier in tier_models.WITH_COLOURS
    if not has_colours:
        effects["colour"] = truth.colour_px(depths_mm)
    lit = [bundle.light / bundles[0].light for bundle in bundles]
    return TierError(tier, effects, _illumination(truth, lit, truth.axial(tier)), 0.0 if has_colours else truth.tint)


def _errors_of_polynomials(polynomials: ray_map.RayMap) -> TierError:
    """Return the errors of polynomials in place of a lens: one bound for the whole film."""
    none = (0.0,) * len(FIELDS)
    effects = dict.fromkeys(EFFECTS, none) | {"distortion": (polynomials.error_px,) * len(FIELDS)}
    return TierError("fitted", effects, (polynomials.light_error,) * len(FIELDS))


def _bundle_errors(
    field: FieldPoint | None, other: tier_models.RayBundle, depths_mm: Sequence[float]
) -> tuple[float, float, float]:
    """Return by how much middle, spread and outline of a bundle differ from those of the lens, at most [pixels]."""
    if field is None:
        return np.inf, np.inf, np.inf
    by_depth = []
    for depth in depths_mm:
        spots = zip(field.bundle.spot(depth, field.along), other.spot(depth, field.along), strict=True)
        shift, spread, outline = (np.abs(own - true) for true, own in spots)
        per_mm = field.pixels_per_mm(depth)
        by_depth.append([float(np.hypot(*shift)) * per_mm, spread.max() * per_mm, outline.max() * per_mm])
    distortion, blur, outlines = np.max(by_depth, axis=0).tolist()
    return distortion, blur, outlines


def _illumination(truth: Truth, lit: Sequence[float], axial: float) -> tuple[float, ...]:
    """Return the relative errors of brightness of a tier whose film is lit so, 1 on the axis.

    Parameters
    ----------
    axial
        Brightness of the centre of the film over that of the traced lens, as the exposure shows it.
    """
    centre = truth.fields[0]
    if centre is None:
        return (np.inf,) * len(lit)
    errors = []
    for each, own in zip(truth.fields, lit, strict=True):
        true = np.zeros(1) if each is None else each.light / centre.light
        errors.append(float(np.abs(axial * own / true - 1).max()) if np.all(true > 0) else np.inf)
    return tuple(errors)


# What was measured of a scene's lens, the camera model chosen from it, and both in words.


@dataclass(frozen=True)
class Decision:
    """The camera model that was chosen, and the numbers behind the choice, over the whole film and all depths.

    Attributes
    ----------
    scene : Scene
        With the camera that was chosen, and with `spectrum.lens` set.
    allowed : Accuracy or None
        What `camera.accuracy` allows; None where the scene asks for no choice.
    errors : tuple of TierError
        Of every tier that there is for the lens, cheapest first.
    reason : str
        Why there is none; empty where there is.
    depths_m : (float, float or None)
        The nearest and the farthest thing ahead of the film [m]; None for infinitely far away.
    blur_px : float
        How far light of a point falls from its middle, at most [pixels].
    shape_px : float or None
        How far from its place a round stop would bring light, at most [pixels]; None for a stop that is round.
    colour_px : float or None
        How far light of other wavelengths falls from its place, at most [pixels]; None where the scene leaves it out,
        or the lens has no colours.
    tint : float
        How much more of one colour than of another the lens takes, where the picture shows it.
    tier : str
        The camera model that was chosen.
    colours : str
        Whether the lens refracts each wavelength separately.
    """

    scene: Scene
    allowed: Accuracy | None = None
    errors: tuple[TierError, ...] = ()
    reason: str = ""
    depths_m: tuple[float, float | None] | None = None
    blur_px: float | None = None
    shape_px: float | None = None
    colour_px: float | None = None
    tint: float = 0.0
    tier: tier_models.Tier = "realistic"
    colours: LensColour = "off"

    @property
    def metadata(self) -> dict[str, Any]:
        """The ``accuracy`` of the picture's metadata; empty where the scene asks for no choice."""
        return {} if self.allowed is None else {"accuracy": describe(self, self.allowed)}


NAMES = dict(zip(EFFECTS, ("distortion", "blur", "outline of blurs", "round stop", "colour"), strict=True))


def describe(decision: Decision, allowed: Accuracy) -> dict[str, Any]:
    """Describe a decision for the picture's metadata; null stands for what the lens does not see."""
    numbers = {
        "depths_m": decision.depths_m,
        "blur_px": decision.blur_px,
        "stop_shape_px": decision.shape_px,
        "lens_colour_px": decision.colour_px,
        "lens_tint": decision.tint or None,
    }
    return {
        "camera_model": decision.tier,
        "lens_colour": decision.colours,
        "says": list(_sentences(decision, allowed)),
        "max_error_px": allowed.max_error_px,
        "max_illumination_error": allowed.max_illumination_error,
        **{key: _plain(value) for key, value in numbers.items() if value is not None},
        "errors": [_as_data(error) for error in decision.errors],
        **({"reason": decision.reason} if decision.reason else {}),
    }


def _as_data(error: TierError) -> dict[str, Any]:
    return {
        "camera_model": error.tier,
        "pixels": _plain(error.pixels),
        "between_px": {name: _plain(value) for name, value in error.between.items()},
        "effects_px": {name: _plain(values) for name, values in error.effects.items()},
        "illumination": _plain(error.illumination),
    }


def _plain(value: float | Sequence[float | None] | None) -> Any:
    """Return numbers to four digits, as JSON can hold them."""
    if value is None or value == math.inf:
        return None
    return float(f"{value:.4g}") if isinstance(value, (int, float)) else [_plain(each) for each in value]


def _sentences(decision: Decision, allowed: Accuracy) -> Iterator[str]:
    """Yield what was chosen, then what was found of the lens, then why no cheaper model was taken."""
    bounds = f"allowed are {pixels(allowed.max_error_px)} and {per_cent(allowed.max_illumination_error)}"
    chosen = next((error for error in decision.errors if error.tier == decision.tier), None)
    errs = "every ray is traced" if chosen is None else _effects_text(chosen)
    yield f"{decision.tier}: {errs} ({bounds})"
    yield from _lens_sentences(decision, allowed)
    if decision.reason:
        yield f"no cheaper camera model: {decision.reason}"
    for error in decision.errors:
        if error.tier == decision.tier or decision.blur_px == math.inf:
            break
        yield f"not {error.tier}: {_effects_text(error, allowed)}"


def _lens_sentences(decision: Decision, allowed: Accuracy) -> Iterator[str]:
    """Yield what is visible of the lens at this size of pixels."""
    if decision.blur_px == math.inf:
        yield "part of the film sees nothing through the lens"
    elif decision.blur_px is not None:
        shows = "the aperture shows" if decision.blur_px > allowed.max_error_px else "the aperture does not show"
        yield f"blur up to {pixels(2 * decision.blur_px)} across: {shows}"
    if decision.shape_px is not None and decision.shape_px < math.inf:
        shows = "its shape shows" if decision.shape_px > allowed.max_error_px else "its shape does not show"
        yield f"a round stop of the same area would be {pixels(decision.shape_px)} off: {shows}"
    if decision.colour_px is not None:
        tint = f", tint {per_cent(decision.tint)}" if decision.tint else ""
        separately = "the lens refracts each wavelength separately"
        refracts = separately if decision.colours == "on" else "one wavelength stands for all"
        yield f"colour {pixels(decision.colour_px)}{tint}: {refracts}"


def _effects_text(error: TierError, beyond: Accuracy | None = None) -> str:
    """Return the effects of a tier with their numbers: all that are any, or those beyond what is allowed."""
    least = 0.0 if beyond is None else beyond.max_error_px
    largest = {name: max(*error.effects[name], error.between.get(name, 0.0)) for name in EFFECTS}
    said = [f"{NAMES[name]} {pixels(worst)}" for name, worst in largest.items() if worst > least]
    light = max(error.illumination)
    for name, value in (("light", light), ("tint", error.tint)):
        if value > (0.0 if beyond is None else beyond.max_illumination_error):
            said.append(f"{name} {per_cent(value)}")
    return ", ".join(said)


def pixels(value: float) -> str:
    """Return a number of pixels for readers."""
    return f"{value:.2g} px" if value < 10 else f"{value:.0f} px"


def per_cent(share: float) -> str:
    """Return a share for readers."""
    return f"{100 * share:.2g} %" if share < 0.1 else f"{100 * share:.0f} %"


# The cheapest camera model whose error a picture bears.

_MULTIPLY_ADDS = 25  # of polynomials per surface, up to which they take two thirds of the time (benchmarks/ray_maps.py)
_WORTH_FITTING = 1e9  # surfaces that all samples cross: fewer take less time than fitting polynomials
_FIRST_ORDER: tuple[tier_models.Tier, ...] = ("pinhole", "thin_lens", "thick_lens")


def choose_camera(scene: Scene) -> Decision:
    """Return a scene with the cheapest camera whose errors its `camera.accuracy` allows; as it was without that key.

    Whether the lens refracts each wavelength separately follows from the same bounds, where `spectrum` leaves it
    open.
    """
    camera = scene.camera.traced_camera
    if camera is None or camera.accuracy is None:
        return Decision(scene)
    allowed = camera.accuracy
    decision = measure_lens(scene)
    lens_colour = _lens_colour(scene, decision, allowed)
    tier: tier_models.Tier | None = next((each.tier for each in decision.errors if _is_allowed(each, allowed)), None)
    if tier is None:
        decision, tier = _polynomials(scene, decision, allowed, lens_colour)
    chosen = tier_models.equivalent(scene, tier)
    if tier in tier_models.WITH_COLOURS:
        chosen = change_scene(chosen, spectrum={"lens": lens_colour})
    colours = lens_colour if tier in tier_models.WITH_COLOURS else "off"
    return replace(decision, scene=chosen, allowed=allowed, tier=tier, colours=colours)


def _lens_colour(scene: Scene, decision: Decision, allowed: Accuracy) -> LensColour:
    """Return whether the lens refracts each wavelength separately: as requested, or as the bounds say."""
    if scene.spectrum.lens_colour != "auto":
        return scene.spectrum.lens_colour
    shows = (decision.colour_px or 0.0) > allowed.max_error_px or decision.tint > allowed.max_illumination_error
    return "on" if shows else "off"


def _polynomials(
    scene: Scene, decision: Decision, allowed: Accuracy, lens_colour: LensColour
) -> tuple[Decision, Literal["fitted", "realistic"]]:
    """Add the errors of polynomials where they are requested or worth it, and choose between them and the lens."""
    camera, (columns, rows) = scene.camera.traced_camera, scene.film.resolution
    requested = camera is not None and camera.rays == "fitted"
    surfaces = len(lens_setting(scene).lens.surfaces)
    if not requested and columns * rows * scene.render.spp * surfaces < _WORTH_FITTING:
        return decision, "realistic"
    try:
        polynomials = tier_models.fit_polynomials(scene, colours=lens_colour == "on")
    except InputError:
        return decision, "realistic"
    if not requested and polynomials.multiply_adds > _MULTIPLY_ADDS * surfaces:
        return decision, "realistic"
    errors = _errors_of_polynomials(polynomials)
    return replace(decision, errors=(*decision.errors, errors)), "fitted" if _is_allowed(
        errors, allowed
    ) else "realistic"


def _is_allowed(error: TierError, allowed: Accuracy) -> bool:
    return error.worst_px <= allowed.max_error_px and error.worst_illumination <= allowed.max_illumination_error


def measure_lens(scene: Scene) -> Decision:
    """Measure the lens of a scene at its size of pixels, and the errors of the cheaper models that there are."""
    scene = on_film(scene)
    try:
        first = tier_models.first_order_camera(scene)
    except InputError as problem:
        return _decide_by_colour(scene, str(problem))
    truth = Truth.of(scene, first)
    depths = _depths(scene, truth)
    missing = {tier: _why_no_equivalent(scene, tier) for tier in _FIRST_ORDER}
    tiers = [tier for tier in _FIRST_ORDER if not missing[tier]]
    between = Truth.of(scene, first, BETWEEN)
    both = truth, between
    errors = [(tier_error(truth, depths, tier), tier_error(between, depths, tier)) for tier in tiers]
    blur_px, far = max(max(each.blur_px(depths)) for each in both), depths[-1]
    return Decision(
        scene,
        errors=tuple(
            replace(error, between={name: max(values) for name, values in other.effects.items()})
            for error, other in errors
        ),
        reason="" if tiers else missing["thick_lens"],
        depths_m=(depths[0] * 1e-3, far * 1e-3 if far < FAR_MM else None),
        blur_px=blur_px,
        shape_px=truth.shape_apart * blur_px if truth.shape_apart else None,
        colour_px=max(max(each.colour_px(depths)) for each in both) if truth.coloured else None,
        tint=truth.tint,
    )


def _why_no_equivalent(scene: Scene, tier: tier_models.Tier) -> str:
    """Return why the lens of a scene has no equivalent of a tier; nothing where it has."""
    try:
        tier_models.equivalent(scene, tier)
    except InputError as problem:
        return str(problem)
    return ""


def _decide_by_colour(scene: Scene, reason: str) -> Decision:
    """Measure how far off the colours of a lens are in focus, where no cheaper model stands for it."""
    setting = lens_setting(scene)
    if scene.spectrum.lens_colour == "off" or not disperses(setting.lens):
        return Decision(scene, reason=reason)
    colour_px, _ = colour_error_px(
        setting.lens, setting.film_distance_mm, setting.focus_distance_mm, scene.film, setting.camera.wavelength_nm,
        film_frame(scene.camera),
    )  # fmt: skip
    return Decision(scene, reason=reason, colour_px=colour_px, tint=realistic.lens_tint(scene, setting))


def _depths(scene: Scene, truth: Truth) -> list[float]:
    """Return the distances ahead of the film at which errors are measured [mm]: both ends of what is seen, and the
    plane in focus."""
    setting = truth.first.setting
    ends = tier_models.depth_range_mm(scene, truth.view)
    focus = setting.focus_distance_mm
    inside = [] if focus is None else [min(focus, FAR_MM)]
    return sorted({max(depth, truth.view.start_mm * 1.01) for depth in (*ends, *inside)})
