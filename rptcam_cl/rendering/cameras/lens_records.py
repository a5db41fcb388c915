"""A lens as device records: its surfaces, their dispersion, ways of light between them, and the outline of its stop."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import records as layout
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import SURFACE, RegionKind, StopKind, SurfaceKind, curves
from rptcam_cl.core.remember import remember
from rptcam_cl.optics.as_built import Copies
from rptcam_cl.optics.film_probe import UNMOVED, FilmFrame
from rptcam_cl.optics.ghosts import steps
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import IDEAL, LensTransmission, is_tinted, known_nm, passed_rays
from rptcam_cl.optics.surface import (
    Region,
    StopMask,
    StopShape,
    Surface,
    SurfacePose,
    blades,
    fit_to_stop,
    heart,
    polygon,
    star,
)
from rptcam_cl.rendering.cameras.setting import LensSetting, LossFiller, lens_setting
from rptcam_cl.scene import lens_settings
from rptcam_cl.scene.assets.pictures import bright_pixels
from rptcam_cl.scene.changes import at_opening
from rptcam_cl.scene.film import Film
from rptcam_cl.scene.scene import Scene

# How a lens bends each wavelength: ratios of indices as polynomials for the device, and whether a picture shows it.

Array = NDArray[np.float64]

NODES = 48
ENOUGH = 1e-8  # error of an index ratio that float32 does not see
_ENOUGH_IN_DOUBLE = 1e-13
EXTREMES_NM = (440.0, 640.0)  # between which nine tenths of what the eye sees in daylight lies
_ALL_BUT = 0.9  # share of the light whose colours fall no farther from their place
FEWEST, MANY, MOST = 1024, 4096, 16384  # rays that it is sought by, and that tell how well it is known
STAYS = 0.005  # share of it that its sampling error may be
_CLEARLY = 4  # sampling errors off a bound, from which it needs to be known no better
WIDER = 1.2  # radii of the exit pupil that rays aim at, as it grows and moves off the axis
LATTICE = np.array([1, 182667, 469891, 498753])  # Cools, Kuo and Nuyens 2006
FAR_MM = 1e9  # stands for everything farther: the object plane where none is sharp


def disperses(lens: Lens) -> bool:
    """Return whether any surface bends one wavelength more than another."""
    low, high = usable_nm(lens)
    indices = lens.indices(np.linspace(low, high, 9))
    ratios = indices[1:] / indices[:-1]
    return bool(np.any(np.ptp(ratios, axis=1) > 0))


def usable_nm(lens: Lens, transmission: LensTransmission = IDEAL) -> tuple[float, float]:
    """Return the wavelengths of `DISPERSION_NM` that every glass of a lens, and what it loses, is known for [nm]."""
    ranges = (lens.known_nm, known_nm(lens, transmission), layout.DISPERSION_NM)
    return max(low for low, _ in ranges), min(high for _, high in ranges)


def fitted(ratio_at: ArrayLike, wavelengths_nm: Array, terms: int) -> tuple[Array, float]:
    """Return ``terms`` coefficients of a polynomial in x = scale / wavelength - shift, and its largest error."""
    x = layout.DISPERSION_SCALE / wavelengths_nm - layout.DISPERSION_SHIFT
    values = np.asarray(ratio_at, dtype=np.float64)
    curve = np.polynomial.Polynomial.fit(x, values, terms - 1).convert()
    coefficients = np.zeros(terms)
    coefficients[: len(curve.coef)] = curve.coef
    return coefficients, float(np.abs(np.polynomial.Polynomial(coefficients)(x) - values).max())


def fit_nodes(low_nm: float, high_nm: float) -> Array:
    """Return wavelengths [nm] at which a polynomial that is fitted comes close everywhere between (Chebyshev)."""
    inverse = np.cos((np.arange(NODES) + 0.5) * np.pi / NODES)
    ends = np.array([1 / high_nm, 1 / low_nm])
    return np.asarray(1 / (ends.mean() + inverse * np.ptp(ends) / 2))


@remember(most=128, by=lambda ratios, *others: (ratios.tobytes(), *(np.asarray(each).tobytes() for each in others)))
def fewest_terms(ratios: Array, wavelengths_nm: Array, enough: float = ENOUGH) -> list[Array]:
    """Return the coefficients of polynomials through values (n, wavelengths): as few as give all to an error."""
    fits: list[tuple[Array, float]] = []
    for terms in range(1, layout.DISPERSION_TERMS + 1):
        fits = [fitted(ratio, wavelengths_nm, terms) for ratio in ratios]
        if all(error <= enough for _, error in fits):
            break
    return [coefficients for coefficients, _ in fits]


def _fill_dispersion(records: NDArray[np.void], lens: Lens, backwards: bool) -> int:
    """Fill the polynomials of every surface, in order of travel; return how many coefficients they take."""
    wavelengths = fit_nodes(*usable_nm(lens))
    indices = lens.indices(wavelengths)
    ratios = (indices[1:] / indices[:-1])[::-1] if backwards else indices[:-1] / indices[1:]
    double = records["eta"].dtype == np.float64
    polynomials = fewest_terms(ratios, wavelengths, _ENOUGH_IN_DOUBLE if double else ENOUGH)
    for record, ratio, coefficients in zip(records, ratios, polynomials, strict=True):
        record["dispersion"][: len(coefficients)] = coefficients
        if record["refracts"] >= 0:
            record["refracts"] = bool(np.any(ratio != 1.0))
    return len(polynomials[0])


def colour_error_px(
    lens: Lens,
    film_distance_mm: float,
    focus_distance_mm: float | None,
    film: Film,
    wavelength_nm: float,
    frame: FilmFrame = UNMOVED,
    bound_px: float | None = None,
) -> tuple[float, float]:
    """Find how far from its place at the camera's wavelength light of another falls on the film, all but a tenth of it.

    Rays from the whole film through the whole exit pupil go on at the wavelength of the camera and at those of
    `EXTREMES_NM`, the worse of which counts: where they meet the object plane tells how far apart their image points
    lie. Lateral and axial colour both count. They become more until the sampling error is small, or the bound so far
    away that it does not matter.

    Parameters
    ----------
    bound_px
        What the result is going to be compared with, if anything.

    Returns
    -------
    error_px, sampling_px : float
        The second is the standard error of the first, by the quarters of the rays.
    """
    low, high = usable_nm(lens)
    half_film_mm = np.array(film.size_m()) / 2 * 1e3
    pitch_mm = 2 * half_film_mm[0] / film.resolution[0]
    sharp = focus_distance_mm is not None and focus_distance_mm < FAR_MM
    plane_mm = lens.film_z(film_distance_mm) - (focus_distance_mm if sharp and focus_distance_mm else FAR_MM)
    probe = _Probe(lens, film_distance_mm, plane_mm, wavelength_nm, frame)
    ends_nm = [min(max(end, low), high) for end in EXTREMES_NM]
    apart = np.empty((0, len(ends_nm)))
    traced = 0
    while True:
        places = _lattice(traced, max(traced, FEWEST))
        traced += len(places)
        apart = np.concatenate([apart, probe.colours(places, half_film_mm, 1e-3 * pitch_mm, ends_nm) / pitch_mm])
        if len(apart) < 4:  # next to nothing passes
            error, spread = float(apart.max(initial=0.0)), np.inf
        else:
            error = float(np.quantile(apart, _ALL_BUT, axis=0).max())
            quarters = [np.quantile(part, _ALL_BUT, axis=0).max() for part in np.array_split(apart, 4)]
            spread = float(np.std(quarters, ddof=1)) / 2
        is_clear = bound_px is not None and abs(error - bound_px) > _CLEARLY * spread
        if traced >= MOST or is_clear or (traced >= MANY and spread <= STAYS * error):
            return error, min(spread, error)


def _lattice(start: int, count: int) -> Array:
    """Return points of an endless lattice (count, 4) that fills the unit cube more and more evenly."""
    numbers, halves, share = np.arange(start, start + count), np.zeros(count), 0.5
    while numbers.any():  # van der Corput: the digits of two in reverse
        halves, numbers, share = halves + share * (numbers & 1), numbers >> 1, share / 2
    return np.asarray((np.outer(halves, LATTICE) + 0.5 / MOST) % 1.0)


class _Probe:
    """Rays from film points through points of the paraxial exit pupil to a plane of the scene."""

    def __init__(
        self, lens: Lens, film_distance_mm: float, plane_mm: float, wavelength_nm: float, frame: FilmFrame
    ) -> None:
        self.lens, self.film_z, self.plane_mm = lens, lens.film_z(film_distance_mm), plane_mm
        self.wavelength_nm, self.frame = wavelength_nm, frame
        pupil = lens.first_order(wavelength_nm).exit_pupil
        distance, radius = pupil.distance_mm, pupil.diameter_mm / 2
        if not (np.isfinite(distance) and np.isfinite(radius)):
            distance, radius = 0.0, lens.surfaces[-1].semi_diameter
        self.aim_z, self.radius = lens.film_z(distance), WIDER * radius

    def colours(self, places: Array, half_film_mm: Array, nudge_mm: float, ends_nm: list[float]) -> Array:
        """Return how far on the film light of other wavelengths falls from its place (rays that pass, wavelengths).

        Parameters
        ----------
        places
            (n, 4) in the unit cube: two coordinates on the film, two in the pupil.
        nudge_mm
            Between film points that tell the scale of the picture.
        """
        film = (2 * places[:, :2] - 1) * half_film_mm
        reach, turn = self.radius * np.sqrt(places[:, 2]), 2 * np.pi * places[:, 3]
        aims = np.stack([reach * np.cos(turn), reach * np.sin(turn), np.full(len(reach), self.aim_z)], axis=1)
        here = self._meets(film, aims, self.wavelength_nm)
        seen = np.isfinite(here[:, 0])
        film, aims, here = film[seen], aims[seen], here[seen]
        right, up = (
            (here - self._meets(film - step, aims, self.wavelength_nm)) / nudge_mm for step in np.eye(2) * nudge_mm
        )
        with np.errstate(all="ignore"):
            area = right[:, 0] * up[:, 1] - right[:, 1] * up[:, 0]
            moved = [self._meets(film, aims, end) - here for end in ends_nm]
            apart = [
                np.hypot(x * up[:, 1] - y * up[:, 0], right[:, 0] * y - right[:, 1] * x) / abs(area)
                for x, y in (each.T for each in moved)
            ]
        lengths = np.stack(apart, axis=1)
        return np.asarray(lengths[np.isfinite(lengths).all(axis=1)])

    def _meets(self, film: Array, aims: Array, wavelength_nm: float) -> Array:
        """Return where rays from points of the film (n, 2) meet the plane (n, 2); not a number where one is blocked."""
        origins = self.frame.points(film) + np.array([0.0, 0.0, self.film_z])
        directions = aims - origins
        directions *= -self.lens.sense * np.sign(directions[:, 2:])  # also through a pupil behind the film
        places = np.full((len(origins), 2), np.nan)
        passed, p, d = passed_rays(self.lens, origins, directions, wavelength_nm)
        with np.errstate(all="ignore"):
            places[passed] = (p[:2] + (self.plane_mm - p[2]) / d[2] * d[:2]).T
        return places


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
    lens.refuse_phases("devices trace none (rptcam lens measures it; camera.kind thin_lens renders an ideal lens)")
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
    terms = _fill_dispersion(records, lens, backwards) if dispersive else 0
    filler = LossFiller(transmission, wavelength_nm, usable_nm(lens, transmission) if dispersive else None, len(stop))
    facts = filler.fill(records, lens, backwards) | {"LENS_DISPERSION": terms}
    stop = np.concatenate([stop, *filler.tables]).astype(real)
    return LensRecords(records, stop, _facts(lens, records) | facts)


def copy_records(copies: Copies, wavelength_nm: float, *, double: bool = False) -> LensRecords:
    """Return the records (copies, surfaces) of copies of a lens for rays from the scene; no rim takes any of them."""
    lens = copies.lens
    design = lens_records(lens, wavelength_nm, "scene", 0.0, double=double)
    records = np.repeat(design.surfaces[None], copies.count, axis=0)
    senses, indices = np.array(lens.senses[:-1]), copies.indices(wavelength_nm)
    records["curvature"] = senses * copies.curvatures
    records["gap"][:, 1:] = senses[1:] * np.diff(copies.vertices)
    records["eta"] = indices[:, :-1] / indices[:, 1:]
    records["refracts"] = np.where(design.surfaces["refracts"] < 0, -1.0, indices[:, :-1] != indices[:, 1:])
    records["semi_diameter2"], records["inner_semi_diameter2"] = float(np.finfo(np.float32).max), 0.0
    records["stop_shape"] = 0
    for k, (rotation, offset) in copies.poses.items():
        mirror = np.array([1.0, 1.0, senses[k]])
        records["posed"][:, k] = 1
        records["offset"][:, k, :3] = offset * mirror
        records["rotation"][:, k, :9] = (mirror[:, None] * rotation * mirror).reshape(copies.count, 9)
    rims = {"LENS_OUTLINE": 0, "LENS_MASK": 0, "LENS_RING": 0}
    return LensRecords(records, design.stop, design.facts | rims | {"LENS_POSE": int(bool(copies.poses))})


def _fill_shape(record: np.void, surface: Surface, sense: float, where: str) -> None:
    """Fill curvature, conic and polynomial; ``sense`` is -1 for a mirrored z."""
    record["curvature"], record["conic"] = sense * surface.curvature, surface.conic
    record["weight_x"], record["weight_y"] = surface.axes()
    surface.shape.fill(record, sense)
    for power, coefficient in surface.aspheric:
        name, place = ("odd", power // 2) if power % 2 else ("even", power // 2 - 1)
        if place >= (layout.ODD_TERMS if power % 2 else layout.EVEN_TERMS):
            raise InputError(
                f"{where}: aspheric: power {power} is too high for a device (allowed up to {2 * layout.EVEN_TERMS - 1})"
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

_GHOST_FACTS = {"LENS_MIRROR": 1, "LENS_POLARISED": 1, "LENS_DISPERSION": 0}


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
    records: NDArray[np.void]
    stop: NDArray[np.floating]
    facts: dict[str, int]

    @staticmethod
    def of(lens: Lens, wavelength_nm: float, transmission: LensTransmission) -> WayRecords:
        """Return the records of a lens at a wavelength [nm]."""
        onward = lens_records(lens, wavelength_nm, "scene", 0.0, transmission=transmission)
        back = lens_records(lens, wavelength_nm, "film", 0.0, transmission=transmission)
        facts = {name: max(value, back.facts[name]) for name, value in onward.facts.items()}
        records = np.concatenate([onward.surfaces, back.surfaces[::-1]])
        return WayRecords(lens, records, onward.stop, facts | _GHOST_FACTS)

    def way(self, turns: tuple[int, ...]) -> NDArray[np.void]:
        """Return the records that light meets, reflected at the surfaces of `turns` in order."""
        way = list(steps(turns, len(self.lens.surfaces)))
        met, forward = np.array([step.surface for step in way]), np.array([step.forward for step in way])
        records = self.records[np.where(forward, met, met + len(self.records) // 2)]
        vertices, senses = np.array(self.lens.vertices), np.array(self.lens.senses)
        records["gap"] = np.where(forward, senses[met], -senses[met + 1]) * np.diff(
            vertices[met], prepend=vertices[met[0]]
        )
        records["refracts"][[step.reflects for step in way]] = -1.0
        return records


# The shape of an aperture for the device: tables to draw points of a thin lens from, or the shape of a stop.

_LARGEST_MASK = 512  # pixels along a side


def stop_shape(scene: Scene, aperture: lens_settings.Aperture) -> StopShape | StopMask | None:
    """Return the shape of an aperture of radius 1; None for a circle.

    Raises
    ------
    InputError
        When an outline crosses itself, or a picture cannot be used as a mask.
    """
    match aperture:
        case lens_settings.PolygonAperture():
            return blades(aperture.blades, aperture.rotation_degrees, aperture.curvature)
        case lens_settings.StarAperture():
            return star(aperture.points, aperture.inner_radius, aperture.rotation_degrees)
        case lens_settings.HeartAperture():
            return heart(aperture.rotation_degrees)
        case lens_settings.OutlineAperture():
            return polygon(fit_to_stop(aperture.points), aperture.rotation_degrees)
        case lens_settings.ImageAperture():
            where = aperture.place.rstrip(": ")
            cells = bright_pixels(scene.content_of(aperture), where)
            rows, columns = cells.shape
            if rows != columns or columns > _LARGEST_MASK:
                raise InputError(
                    f"{where}: is {columns} x {rows} pixels"
                    f" (allowed: square, at most {_LARGEST_MASK} x {_LARGEST_MASK})"
                )
            return StopMask(cells)
    return None


def shaped(scene: Scene, setting: LensSetting) -> LensSetting:
    """Return a lens in use with its stop in the shape of the camera's aperture.

    Raises
    ------
    InputError
        When the lens has no stop to shape.
    """
    shape = stop_shape(scene, scene.camera.outline)
    if shape is None:
        return setting
    if setting.lens.stop is None:
        raise InputError(f"camera.aperture: {setting.lens.name} has no stop to shape (mark one with stop: true)")
    return replace(setting, lens=setting.lens.with_stop_shape(shape))


def aperture_tables(scene: Scene, aperture: lens_settings.Aperture) -> tuple[NDArray[np.float32], dict[str, int]]:
    """Return the tables of an aperture of radius 1 and its facts, both as `kernels/lens/aperture.h` describes them."""
    shape = stop_shape(scene, aperture)
    facts = {"APERTURE_PARTS": 0, "APERTURE_ROWS": 0}
    if shape is None:
        return np.zeros(1, np.float32), facts
    if isinstance(shape, StopMask):
        cells = shape.cells[::-1].astype(np.float64)
        tables = np.concatenate([curves(cells.sum(axis=1)[None])[0], curves(cells)[0]])
        return tables.ravel(), facts | {"APERTURE_ROWS": len(cells)}
    apex, first, second = (shape.triangles[:, k] for k in range(3))
    corners = np.concatenate([apex, first - apex, second - first], axis=1).astype(np.float32)
    curve, _ = curves(shape.triangle_areas[None])
    return np.concatenate([curve.ravel(), corners.ravel()]), facts | {"APERTURE_PARTS": len(corners)}
