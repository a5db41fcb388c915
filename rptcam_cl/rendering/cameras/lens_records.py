"""A lens as device records: its surfaces, their dispersion, and ways of light between them."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import (
    DISPERSION_NM,
    DISPERSION_SCALE,
    DISPERSION_SHIFT,
    DISPERSION_TERMS,
    EVEN_TERMS,
    ODD_TERMS,
    SURFACE,
    RegionKind,
    StopKind,
    SurfaceKind,
)
from rptcam_cl.optics.ghosts import steps
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import IDEAL, LensTransmission, is_tinted, known_nm, passed_rays
from rptcam_cl.optics.stop_shape import StopMask, StopShape
from rptcam_cl.optics.surface import Region, Surface, SurfacePose
from rptcam_cl.rendering.cameras.ideal import shaped
from rptcam_cl.rendering.cameras.setting import LensSetting, LossFiller, lens_setting
from rptcam_cl.scene.film import Film
from rptcam_cl.scene.load import at_opening
from rptcam_cl.scene.scene import Scene

# How a lens bends each wavelength: ratios of indices as polynomials for the device, and whether a picture shows it.

Array = NDArray[np.float64]

NODES = 48
ENOUGH = 1e-8  # error of an index ratio that float32 does not see
ENOUGH_IN_DOUBLE = 1e-13
EXTREMES_NM = (440.0, 640.0)  # between which nine tenths of what the eye sees in daylight lies
FIELDS = (0.0, 0.7, 1.0)  # film points along the half diagonal that are probed
PUPIL = 5  # rays along a side of the square of rays of each of them
FAR_MM = 1e9  # object plane where none is sharp


def disperses(lens: Lens) -> bool:
    """Return whether any surface bends one wavelength more than another."""
    low, high = usable_nm(lens)
    indices = lens.indices(np.linspace(low, high, 9))
    ratios = indices[1:] / indices[:-1]
    return bool(np.any(np.ptp(ratios, axis=1) > 0))


def usable_nm(lens: Lens, transmission: LensTransmission = IDEAL) -> tuple[float, float]:
    """Return the wavelengths of `DISPERSION_NM` that every glass of a lens, and what it loses, is known for [nm]."""
    ranges = (lens.known_nm, known_nm(lens, transmission), DISPERSION_NM)
    return max(low for low, _ in ranges), min(high for _, high in ranges)


def fitted(ratio_at: ArrayLike, wavelengths_nm: Array, terms: int) -> tuple[Array, float]:
    """Return ``terms`` coefficients of a polynomial in x = scale / wavelength - shift, and its largest error."""
    x = DISPERSION_SCALE / wavelengths_nm - DISPERSION_SHIFT
    values = np.asarray(ratio_at, dtype=np.float64)
    curve = Polynomial.fit(x, values, terms - 1).convert()
    coefficients = np.zeros(terms)
    coefficients[: len(curve.coef)] = curve.coef
    return coefficients, float(np.abs(Polynomial(coefficients)(x) - values).max())


def fit_nodes(low_nm: float, high_nm: float) -> Array:
    """Return wavelengths [nm] at which a polynomial that is fitted comes close everywhere between (Chebyshev)."""
    inverse = np.cos((np.arange(NODES) + 0.5) * np.pi / NODES)
    ends = np.array([1 / high_nm, 1 / low_nm])
    return np.asarray(1 / (ends.mean() + inverse * np.ptp(ends) / 2))


def fewest_terms(ratios: Array, wavelengths_nm: Array, enough: float = ENOUGH) -> list[Array]:
    """Return the coefficients of polynomials through values (n, wavelengths): as few as give all to an error."""
    fits: list[tuple[Array, float]] = []
    for terms in range(1, DISPERSION_TERMS + 1):
        fits = [fitted(ratio, wavelengths_nm, terms) for ratio in ratios]
        if all(error <= enough for _, error in fits):
            break
    return [coefficients for coefficients, _ in fits]


def fill_dispersion(records: NDArray[np.void], lens: Lens, backwards: bool) -> int:
    """Fill the polynomials of every surface, in order of travel; return how many coefficients they take."""
    wavelengths = fit_nodes(*usable_nm(lens))
    indices = lens.indices(wavelengths)
    ratios = (indices[1:] / indices[:-1])[::-1] if backwards else indices[:-1] / indices[1:]
    double = records["eta"].dtype == np.float64
    polynomials = fewest_terms(ratios, wavelengths, ENOUGH_IN_DOUBLE if double else ENOUGH)
    for record, ratio, coefficients in zip(records, ratios, polynomials, strict=True):
        record["dispersion"][: len(coefficients)] = coefficients
        if record["refracts"] >= 0:
            record["refracts"] = bool(np.any(ratio != 1.0))
    return len(polynomials[0])


def colour_error_px(
    lens: Lens, film_distance_mm: float, focus_distance_mm: float | None, film: Film, wavelength_nm: float
) -> float:
    """Return how far from its place at the camera's wavelength light of another falls on the film, at most [pixels].

    Rays from film points on the axis, at 0.7 and 1 of the half diagonal go through a square of points of the exit pupil
    at the wavelength of the camera and at those of `EXTREMES_NM`; where they meet the object plane tells how far their
    image points lie apart. Lateral and axial colour both count. It is coarse on purpose, as it decides whether colours
    are rendered: 17 x 17 points of the pupil and 9 of the film find up to 41 % more for lenses that vignette much, and
    a stray ray at a rim (petzval-51mm) made it 3.6 times as large as those find it.
    """
    low, high = usable_nm(lens)
    half_film_mm = np.array(film.size_m()) / 2 * 1e3
    pitch_mm = 2 * half_film_mm[0] / film.resolution[0]
    sharp = focus_distance_mm is not None and focus_distance_mm < FAR_MM
    plane_mm = lens.film_z(film_distance_mm) - (focus_distance_mm if sharp and focus_distance_mm else FAR_MM)
    probe = _Probe(lens, film_distance_mm, plane_mm, wavelength_nm)
    nudge, points = np.full(2, 1e-3 * pitch_mm), np.array(FIELDS)[:, None] * half_film_mm
    here, beside = np.split(probe.meets(np.concatenate([points, points - nudge]), wavelength_nm), 2)
    ends = [probe.meets(points, min(max(end, low), high)) for end in EXTREMES_NM]
    worst = 0.0
    for field, meets in enumerate(here):
        scale = _largest(beside[field] - meets) / float(np.linalg.norm(nudge))
        for end in ends:
            worst = max(worst, _largest(end[field] - meets) / (scale * pitch_mm) if scale > 0 else 0.0)
    return worst


def _largest(places: Array) -> float:
    """Return the largest length of vectors (n, 2), of those that are numbers; 0 where none is."""
    lengths = np.hypot(places[:, 0], places[:, 1])
    return float(lengths[np.isfinite(lengths)].max(initial=0.0))


class _Probe:
    """Rays from film points through a square of points of the paraxial exit pupil to a plane of the scene."""

    def __init__(self, lens: Lens, film_distance_mm: float, plane_mm: float, wavelength_nm: float) -> None:
        self.lens, self.film_z, self.plane_mm = lens, lens.film_z(film_distance_mm), plane_mm
        pupil = lens.first_order(wavelength_nm).exit_pupil
        distance, radius = pupil.distance_mm, pupil.diameter_mm / 2
        if not (np.isfinite(distance) and np.isfinite(radius)):
            distance, radius = 0.0, lens.surfaces[-1].semi_diameter
        side = np.linspace(-0.6, 0.6, PUPIL) * radius
        x, y = (values.ravel() for values in np.meshgrid(side, side))
        self.aims = np.stack([x, y, np.full(len(x), lens.film_z(distance))], axis=1)

    def meets(self, points: Array, wavelength_nm: float) -> Array:
        """Return where rays from film points (k, 2) meet the plane, (k, n, 2); not a number where they are blocked."""
        origins = np.concatenate([points, np.full((len(points), 1), self.film_z)], axis=1)[:, None]
        directions = self.aims - origins
        directions *= -self.lens.sense * np.sign(directions[..., 2:])  # also through a pupil behind the film
        origins = np.broadcast_to(origins, directions.shape).reshape(-1, 3)
        places = np.full((len(origins), 2), np.nan)
        passed, p, d = passed_rays(self.lens, origins, directions.reshape(-1, 3), wavelength_nm)
        with np.errstate(all="ignore"):
            places[passed] = (p[:2] + (self.plane_mm - p[2]) / d[2] * d[:2]).T
        return places.reshape(len(points), -1, 2)


# The surfaces of a lens as device records, in the order in which rays from one side meet them, and their facts.

MIRRORED = np.diag([1.0, 1.0, -1.0])


@dataclass(frozen=True)
class LensRecords:
    """Surface records in order of travel, the shape of the stop, and the facts that say which code they need.

    Behind the shape of the stop stand tables of what the lens lets through, where that takes any.
    """

    surfaces: NDArray[np.void]
    stop: NDArray[np.floating]
    facts: dict[str, int]


def lens_records(
    lens: Lens,
    wavelength_nm: float,
    start: Literal["film", "scene"],
    first_gap_mm: float,
    *,
    double: bool = False,
    dispersive: bool = False,
    transmission: LensTransmission = IDEAL,
) -> LensRecords:
    """Return the records of a lens for rays that start on one side.

    Parameters
    ----------
    start
        Side where rays begin. The device's z runs along the direction of travel, so shapes are mirrored where rays
        travel to -z: on their way from the film, or between mirrors.
    first_gap_mm
        Distance along the travel from the plane z = 0 of the rays to the first vertex they meet.
    double
        Whether the records are for the float64 tracer.
    dispersive
        Whether every ray has its own wavelength, in place of ``wavelength_nm``.
    transmission
        Losses that rays suffer.
    """
    indices = lens.indices(wavelength_nm)
    count = len(lens.surfaces)
    backwards = start == "film"
    order = range(count - 1, -1, -1) if backwards else range(count)
    real = "<f8" if double else "<f4"
    records = SURFACE.zeros(count, real)
    stop = np.zeros(1)
    previous = None
    for record, k in zip(records, order, strict=True):
        surface = lens.surfaces[k]
        before, after = (indices[k + 1], indices[k]) if backwards else (indices[k], indices[k + 1])
        record["eta"], record["refracts"] = before / after, -1.0 if surface.is_mirror else before != after
        sense = -lens.senses[k + 1] if backwards else lens.senses[k]
        record["gap"] = first_gap_mm if previous is None else sense * (lens.vertices[k] - lens.vertices[previous])
        record["inner_semi_diameter2"] = np.square(surface.inner_semi_diameter)
        record["semi_diameter2"] = min(np.square(surface.semi_diameter), float(np.finfo(np.float32).max))
        _fill_shape(record, surface, sense, f"{lens.name}: surfaces[{k}]")
        if surface.pose is not None:
            _fill_pose(record, surface.pose, sense)
        if surface.stop_shape is not None:
            stop = _fill_stop(record, surface.stop_shape, surface.semi_diameter)
        if surface.region is not None:
            joins = previous is not None and _same_half_lens(lens.surfaces[previous], surface)
            _fill_region(record, surface.region, joins)
        previous = k
    terms = fill_dispersion(records, lens, backwards) if dispersive else 0
    filler = LossFiller(transmission, wavelength_nm, usable_nm(lens, transmission) if dispersive else None, len(stop))
    facts = filler.fill(records, lens, backwards) | {"LENS_DISPERSION": terms}
    stop = np.concatenate([stop, *filler.tables]).astype(real)
    return LensRecords(records, stop, _facts(lens, records) | facts)


def _fill_shape(record: np.void, surface: Surface, sense: float, where: str) -> None:
    """Fill curvature, conic and polynomial; ``sense`` is -1 for a mirrored z."""
    record["curvature"], record["conic"] = sense * surface.curvature, surface.conic
    record["weight_x"], record["weight_y"] = surface.axes()
    surface.shape.fill(record, sense)
    for power, coefficient in surface.aspheric:
        name, place = ("odd", power // 2) if power % 2 else ("even", power // 2 - 1)
        if place >= (ODD_TERMS if power % 2 else EVEN_TERMS):
            raise InputError(
                f"{where}: aspheric: power {power} is too high for a device (allowed up to {2 * EVEN_TERMS - 1})"
            )
        record[name][place] += sense * coefficient
        record[f"{name}_terms"] = max(int(record[f"{name}_terms"]), place + 1)


def _fill_pose(record: np.void, pose: SurfacePose, sense: float) -> None:
    mirror = MIRRORED if sense < 0 else np.eye(3)
    record["posed"] = 1
    record["offset"][:3] = mirror @ np.array(pose.offset)
    record["rotation"][:9] = (mirror @ pose.matrix() @ mirror).ravel()


def _fill_region(record: np.void, region: Region, joins: bool) -> None:
    record["region"] = RegionKind.BLOCKS if region.blocks else RegionKind.GOES_ON if joins else RegionKind.OPENS
    record["inverted"] = region.inverted
    largest = float(np.finfo(np.float32).max)
    record["half_width"], record["half_height"] = min(region.half_width, largest), min(region.half_height, largest)
    record["centre_x"], record["centre_y"] = region.centre
    record["radius2"], record["inner_radius2"] = min(region.radius**2, largest), region.inner_radius**2
    record["edge"] = -largest
    if region.normal_degrees is not None:
        angle = np.radians(region.normal_degrees)
        record["edge"], record["edge_x"], record["edge_y"] = region.edge, np.cos(angle), np.sin(angle)


def _fill_stop(record: np.void, shape: StopShape | StopMask, semi_diameter_mm: float) -> NDArray[np.float64]:
    """Fill the shape of the stop and return its table [mm]."""
    if isinstance(shape, StopShape):
        edges = shape.edges() * (semi_diameter_mm, semi_diameter_mm, semi_diameter_mm, 1.0)
        record["stop_shape"], record["stop_count"] = StopKind.OUTLINE, len(edges)
        return np.asarray(edges.ravel())
    record["stop_shape"], record["stop_count"] = StopKind.MASK, len(shape.cells)
    record["stop_radius"] = semi_diameter_mm
    return shape.cells.astype(np.float64).ravel()


def _same_half_lens(previous: Surface, surface: Surface) -> bool:
    return previous.region is not None and not previous.region.blocks and previous.region == surface.region


def _facts(lens: Lens, records: NDArray[np.void]) -> dict[str, int]:
    kinds = records["kind"]
    general = bool(np.any(kinds >= SurfaceKind.ASPHERE))
    of_forms = {fact: 1 for surface in lens.surfaces if surface.form for fact in surface.form.facts}
    return (
        of_forms
        | {
            "LENS_CONIC": int(bool(np.any(kinds == SurfaceKind.CONIC_KIND))),
            "LENS_GENERAL": int(general),
            "LENS_CYLINDER": int(any(surface.cylinder is not None for surface in lens.surfaces)),
            "LENS_ODD": int(bool(np.any(records["odd_terms"] > 0))),
            "LENS_POSE": int(any(surface.pose is not None for surface in lens.surfaces)),
            "LENS_OUTLINE": int(bool(np.any(records["stop_shape"] == StopKind.OUTLINE))),
            "LENS_MASK": int(bool(np.any(records["stop_shape"] == StopKind.MASK))),
            "LENS_MIRROR": int(lens.has_mirrors),
            "LENS_RING": int(lens.is_obstructed),
            "LENS_REGION": int(any(surface.region is not None for surface in lens.surfaces)),
        }
        | ({"LENS_ROUND_REGION": 1} if any(s.region and s.region.is_round for s in lens.surfaces) else {})
    )


# A way of light between the surfaces of a lens as device records, in the order in which light meets them.

GHOST_FACTS = {"LENS_MIRROR": 1, "LENS_POLARISED": 1, "LENS_DISPERSION": 0}


def ghost_setting(scene: Scene) -> LensSetting:
    """Return the lens of a scene's camera with its stop in shape, whose surfaces reflect.

    Raises
    ------
    InputError
        When the camera has no surfaces, or they are ideal and reflect nothing.
    """
    scene = at_opening(scene)
    camera = scene.camera.traced_camera
    if camera is None:
        raise InputError("camera.ghosts: the camera has no surfaces that reflect (allowed: off, or kind realistic)")
    if not camera.transmission.fresnel:
        raise InputError(
            "camera.ghosts: ideal surfaces reflect nothing (allowed: off, or a camera.transmission such as bare,"
            " coated or {coating: mgf2})"
        )
    return shaped(scene, lens_setting(scene))


def ghosts_have_colours(setting: LensSetting) -> bool:
    """Return whether surfaces reflect or bend one colour otherwise than another."""
    return disperses(setting.lens) or is_tinted(setting.lens, setting.transmission)


@dataclass(frozen=True)
class WayRecords:
    """The records of a lens for one wavelength, from which those of any way are picked."""

    lens: Lens
    onward: NDArray[np.void]
    back: NDArray[np.void]
    stop: NDArray[np.floating]
    facts: dict[str, int]

    @staticmethod
    def of(lens: Lens, wavelength_nm: float, transmission: LensTransmission) -> WayRecords:
        """Return the records of a lens at a wavelength [nm]."""
        onward = lens_records(lens, wavelength_nm, "scene", 0.0, transmission=transmission)
        back = lens_records(lens, wavelength_nm, "film", 0.0, transmission=transmission)
        facts = {name: max(value, back.facts[name]) for name, value in onward.facts.items()}
        return WayRecords(lens, onward.surfaces, back.surfaces[::-1], onward.stop, facts | GHOST_FACTS)

    def way(self, turns: tuple[int, ...]) -> NDArray[np.void]:
        """Return the records that light meets, reflected at the surfaces of `turns` in order."""
        way = list(steps(turns, len(self.lens.surfaces)))
        met, forward = np.array([step.surface for step in way]), np.array([step.forward for step in way])
        records = np.concatenate([self.onward, self.back])[np.where(forward, met, met + len(self.onward))]
        vertices, senses = np.array(self.lens.vertices), np.array(self.lens.senses)
        records["gap"] = np.where(forward, senses[met], -senses[met + 1]) * np.diff(
            vertices[met], prepend=vertices[met[0]]
        )
        records["refracts"][[step.reflects for step in way]] = -1.0
        return records
