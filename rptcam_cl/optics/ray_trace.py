"""Exact rays through every surface in float64, with the light they lose: the reference for every other tracer.

Then rays from the scene with their derivatives by the numbers of the lens.
"""

from __future__ import annotations

from dataclasses import field, replace
from enum import IntEnum
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import SurfaceKind
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.optics.glass import (
    BARE,
    Coating,
    Interface,
    LayerStack,
    MeasuredReflectance,
    Medium,
    QuarterWave,
    attenuation,
)
from rptcam_cl.optics.shapes import WORTH_MOVING, Hits, sag_of_profile
from rptcam_cl.optics.surface import Prescription, Region, Surface, sides

#
# What a lens takes from the light that crosses it: reflection at its surfaces, absorption in its glass and mirrors.
#
# Reflected light is lost here; `ghosts` follows it. Each surface counts with the mean of both polarisations.

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
L = TypeVar("L", bound=Prescription)

AIR_LIKE = 1e-3  # a medium whose index is nearer to 1 takes a lens's own coating like air


@dataclass(frozen=True)
class LensTransmission:
    """Which losses count.

    Attributes
    ----------
    fresnel : bool
        Whether surfaces reflect.
    coatings : bool
        Whether they do so through their coatings, where they have any; otherwise every surface is bare.
    absorption : bool
        Whether glass absorbs, where it is known how much.
    """

    fresnel: bool = True
    coatings: bool = True
    absorption: bool = True

    def __bool__(self) -> bool:
        """Whether anything is lost."""
        return self.fresnel or self.absorption

    def coating_of(self, surface: Surface) -> Coating:
        """Return the coating of a surface, as far as coatings count."""
        return surface.coating if self.coatings and surface.coating is not None else BARE

    def mirror_share(self, mirror: Surface, wavelength_nm: ArrayLike) -> Array:
        """Return the share of light that a mirror reflects at wavelengths [nm]: all, unless it says how much."""
        coating = self.coating_of(mirror)
        if isinstance(coating, MeasuredReflectance):
            return coating.reflectance(wavelength_nm)
        return np.ones(np.shape(wavelength_nm))


IDEAL = LensTransmission(fresnel=False, coatings=False, absorption=False)
UNCOATED = LensTransmission(coatings=False)
COATED = LensTransmission()
BY_NAME = {"ideal": IDEAL, "bare": UNCOATED, "coated": COATED}


def meets_air(before: Medium, after: Medium) -> bool:
    """Return whether a surface between two media lies between glass and air: where a coating of a whole lens goes."""
    close = [abs(float(medium.index(LINE_D_NM)) - 1.0) < AIR_LIKE for medium in (before, after)]
    return any(close) and not all(close)


def with_coating(lens: L, coating: Coating) -> L:
    """Return the lens with a coating on every surface between glass and air."""
    sides = zip(lens.media, lens.media[1:], strict=False)
    surfaces = [
        replace(surface, coating=coating) if meets_air(*media) else surface
        for surface, media in zip(lens.surfaces, sides, strict=True)
    ]
    return replace(lens, surfaces=tuple(surfaces))


def has_coatings(lens: Prescription) -> bool:
    """Return whether the lens says what lies on any of its surfaces."""
    return any(surface.coating is not None for surface in lens.surfaces)


class Losses:
    """What is left of rays on their way through a lens.

    Parameters
    ----------
    lens : Prescription
    transmission : LensTransmission
    wavelengths : float or (n,) array
        Of the rays [nm].
    count : int
        Number of rays.
    """

    def __init__(self, lens: Prescription, transmission: LensTransmission, wavelengths: Array, count: int) -> None:
        self.transmission = transmission
        self.wavelengths = np.broadcast_to(wavelengths, (count,))
        self.attenuations = [
            np.broadcast_to(attenuation(medium, wavelengths) if transmission.absorption else 0.0, (count,))
            for medium in lens.media
        ]
        self.share = np.ones(count)

    def through(self, medium: int, length: Array, beside: Mask) -> None:
        """Take away what a medium (0 in front of the lens) absorbs over a length [mm], but beside a half lens."""
        if self.transmission.absorption:
            self.share = self.share * np.where(beside, 1.0, np.exp(-self.attenuations[medium] * length))

    def across(self, surface: Surface, interface: Interface, beside: Mask) -> None:
        """Take away what a surface reflects, but beside a half lens."""
        if self.transmission.fresnel:
            passed = self.transmission.coating_of(surface).transmittance(interface, self.wavelengths)
            self.share = self.share * np.where(beside, 1.0, passed)

    def off(self, mirror: Surface) -> None:
        """Take away what a mirror does not reflect."""
        if self.transmission.fresnel:
            self.share = self.share * self.transmission.mirror_share(mirror, self.wavelengths)

    def keep(self, good: Mask) -> None:
        """Forget the other rays."""
        self.share, self.wavelengths = self.share[good], self.wavelengths[good]
        self.attenuations = [values[good] for values in self.attenuations]


def axial_transmittance(
    lens: Prescription, wavelength_nm: ArrayLike = LINE_D_NM, transmission: LensTransmission = COATED
) -> Array:
    """Return the share of light that passes along the axis, from the first vertex to the last, at wavelengths [nm]."""
    wavelengths = np.asarray(wavelength_nm, dtype=np.float64)
    indices = lens.indices(wavelengths)
    passed = np.ones(wavelengths.shape)
    for k, surface in enumerate(lens.surfaces):
        if surface.is_mirror:
            passed = passed * (transmission.mirror_share(surface, wavelengths) if transmission.fresnel else 1.0)
        elif transmission.fresnel and not surface.phase and np.any(indices[k] != indices[k + 1]):
            interface = Interface(indices[k], indices[k + 1])
            passed = passed * transmission.coating_of(surface).transmittance(interface, wavelengths)
        if transmission.absorption and k + 1 < len(lens.surfaces):
            passed = passed * np.exp(-attenuation(surface.glass, wavelengths) * abs(surface.thickness))
    return passed


def known_nm(lens: Prescription, transmission: LensTransmission) -> tuple[float, float]:
    """Return the wavelengths for which the losses are known [nm]; without limits, 0 and infinity."""
    limits = [(0.0, np.inf)]
    if transmission.absorption:
        inside = [surface.glass.absorption for surface in lens.surfaces[:-1]]
        limits += [(a.wavelengths_nm[0], a.wavelengths_nm[-1]) for a in inside if a is not None]
    if transmission.fresnel:
        coatings = [transmission.coating_of(surface) for surface in lens.surfaces]
        limits += [c.range_nm for c in coatings if isinstance(c, MeasuredReflectance)]
    return max(low for low, _ in limits), min(high for _, high in limits)


def is_tinted(lens: Prescription, transmission: LensTransmission) -> bool:
    """Return whether coatings or glass take more from one colour than from another."""
    low, high = known_nm(lens, transmission)
    if not low < high:
        return False
    coatings = {transmission.coating_of(surface) for surface in lens.surfaces if transmission.fresnel}
    layers = any(isinstance(coating, QuarterWave | LayerStack) for coating in coatings)
    measured = any(isinstance(coating, MeasuredReflectance) and np.ptp(coating.values) > 0 for coating in coatings)
    inside = [surface.glass.absorption for surface in lens.surfaces[:-1]] if transmission.absorption else []
    return layers or measured or any(absorption is not None and np.ptp(absorption.per_mm) > 0 for absorption in inside)


# Exact rays through every surface in float64: the reference for every other tracer.

CHUNK = 8192  # rays whose components stay in the processor's cache while they cross the lens


class Status(IntEnum):
    """What became of a ray."""

    ok = 0
    missed = 1
    clipped = 2
    total_internal_reflection = 3
    no_convergence = 4


@dataclass(frozen=True)
class Rays:
    """Rays after the lens, in its frame [mm].

    Attributes
    ----------
    origins, directions : (n, 3) arrays
        Point on the last surface met and unit direction after it; of a failed ray, where it was stopped and how it
        came there.
    status : (n,) array of `Status` values
    surface : (n,) array
        Index of the surface where the ray failed, -1 if it did not.
    optical_path : (n,) array
        Sum of index times length from the start to the origin [mm].
    transmittance : (n,) array or None
        Share of the light that is left after the last surface, counted from the first one met; 0 for a failed ray. None
        when no losses were requested.
    """

    origins: Array
    directions: Array
    status: NDArray[np.int32]
    surface: NDArray[np.int32]
    optical_path: Array
    transmittance: Array | None = None

    @property
    def passed(self) -> Mask:
        """Which rays came through."""
        return np.asarray(self.status == Status.ok)

    def some(self, chosen: Mask) -> Rays:
        """Return some of the rays, without what is left of their light."""
        return Rays(
            self.origins[chosen], self.directions[chosen], self.status[chosen], self.surface[chosen],
            self.optical_path[chosen],
        )  # fmt: skip


def trace(
    lens: Prescription,
    origins: ArrayLike,
    directions: ArrayLike,
    wavelength_nm: ArrayLike = LINE_D_NM,
    start: str = "film",
    transmission: LensTransmission | None = None,
) -> Rays:
    """Return the rays after they have crossed every surface.

    Parameters
    ----------
    lens : Prescription
    origins, directions : (n, 3) arrays
        Points [mm] and directions of any length in the frame of the lens, z = 0 at its first vertex and +z to the film;
        before the first surface in the axes of the scene (`Prescription.fold`), as are those that are returned there.
    wavelength_nm : float or (n,) array
    start : "film" or "scene"
        Side where the rays begin: from the scene they travel to +z, from the film to -z, or to +z behind an odd number
        of mirrors.
    transmission : LensTransmission, optional
        Losses to count.
    """
    if start not in ("film", "scene"):
        raise InputError(f'start must be "film" or "scene" (got {start!r})')
    points, vectors = np.broadcast_arrays(
        np.atleast_2d(np.asarray(origins, dtype=np.float64)), np.atleast_2d(np.asarray(directions, dtype=np.float64))
    )
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"rays need origins and directions of shape (n, 3) (got {points.shape})")
    wavelengths = np.asarray(wavelength_nm, dtype=np.float64)
    return _trace(lens, points, vectors, wavelengths, start == "scene", transmission)


def passing(lens: Prescription, origins: Array, directions: Array, wavelength_nm: float = LINE_D_NM) -> Mask:
    """Return which rays (n, 3) from the film come through: those of `trace`, in about half of its time."""
    passed = np.zeros(len(origins), dtype=bool)
    passed[passed_rays(lens, origins, directions, wavelength_nm)[0]] = True
    return passed


def passed_rays(
    lens: Prescription, origins: Array, directions: Array, wavelength_nm: float = LINE_D_NM, start: str = "film"
) -> tuple[NDArray[np.intp], Array, Array]:
    """Return which rays (n, 3) come through, and their last points and directions (3, m): those of `trace`, sooner."""
    parts = []
    with np.errstate(all="ignore"):
        for low in range(0, max(len(origins), 1), CHUNK):
            checkpoint()
            rows = np.arange(low, min(low + CHUNK, len(origins)))
            p, d = np.ascontiguousarray(origins[rows].T), np.ascontiguousarray(directions[rows].T)
            d /= np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
            p, d = lens.from_scene_axes(p, d) if start == "scene" else (p, d)
            parts.append(_trace_passing(lens, rows, p, d, wavelength_nm, start == "scene"))
    rows, p, d = (np.concatenate(values, axis=-1) for values in zip(*parts, strict=True))
    return rows, p, d


def _trace_passing(
    lens: Prescription, rows: NDArray[np.intp], p: Array, d: Array, wavelength_nm: float, forward: bool
) -> tuple[NDArray[np.intp], Array, Array]:
    """Return the rays (3, n) that come through, with their numbers, behind the last surface."""
    indices = lens.indices(wavelength_nm)
    good, beside = np.ones(len(rows), dtype=bool), np.zeros(len(rows), dtype=bool)
    for k in range(len(lens.surfaces)) if forward else range(len(lens.surfaces) - 1, -1, -1):
        surface, previous = lens.surfaces[k], _region_of(lens, k - 1 if forward else k + 1)
        hits, d, met = arrive(lens, k, lens.senses[k] if forward else -lens.senses[k + 1], p, d)
        good &= met & surface.clears(hits.points[0], hits.points[1])
        if surface.region is not None or previous is not None:
            beside, apart = sides(surface.region, previous, hits.points[0], hits.points[1], beside)
            good &= apart
        before, after = (indices[k], indices[k + 1]) if forward else (indices[k + 1], indices[k])
        bent, through = bend(surface, hits, d, before, after, wavelength_nm)
        d = np.where(beside, d, bent) if surface.region else bent
        good &= through | beside if surface.region else through
        p, d = leave(lens, k, hits.points, d)
        if np.count_nonzero(good) < WORTH_MOVING * len(rows):
            rows, p, d, beside, good = rows[good], p[:, good], d[:, good], beside[good], good[good]
        if not len(rows):
            break
    p, d = (p, d) if forward else lens.in_scene_axes(p, d)
    return (rows, p, d) if good.all() else (rows[good], p[:, good], d[:, good])


def trace_crossings(
    lens: Prescription, order: range, p: Array, d: Array, wavelength_nm: float, *, towards_film: bool = False
) -> tuple[Array, Array, Array]:
    """Return where rays cross neighbouring surfaces, whose rims do not count, and how they leave the last of them.

    Parameters
    ----------
    order
        Surfaces in the order in which the rays meet them.
    p, d : (3, n) arrays
        Points [mm] and unit directions in the frame of the lens, in the medium before the first of them.
    wavelength_nm
        Of all rays.

    Returns
    -------
    places : (surfaces, n, 2) array
        x and y in the frame of each surface, scene side first; not a number from where a ray misses one or is totally
        reflected.
    points, directions : (n, 3) arrays
        In the frame of the lens; not a number for rays that do not cross them all.
    """
    places, indices = np.empty((len(lens.surfaces), p.shape[1], 2)), lens.indices(wavelength_nm)
    lost = np.zeros(p.shape[1], dtype=bool)
    with np.errstate(all="ignore"):
        for k in order:
            hits, d, met = arrive(lens, k, lens.senses[k] if towards_film else -lens.senses[k + 1], p, d)
            lost |= ~met
            places[k] = np.where(lost[:, None], np.nan, hits.points[:2].T)
            before, after = (indices[k], indices[k + 1]) if towards_film else (indices[k + 1], indices[k])
            d, through = bend(lens.surfaces[k], hits, d, before, after, wavelength_nm)
            lost |= ~through
            p, d = leave(lens, k, hits.points, d)
    points, directions = (np.where(lost[:, None], np.nan, values.T) for values in (p, d))
    return places[min(order, default=0) : max(order, default=-1) + 1], points, directions


def bend(
    surface: Surface, hits: Hits, d: Array, before: Array, after: Array, wavelength_nm: ArrayLike
) -> tuple[Array, Mask]:
    """Return directions (3, n) behind a surface, in its frame, and which rays go on.

    Parameters
    ----------
    before, after
        Indices on the side that rays come from, and on the other.
    """
    if surface.phase is not None:
        return surface.phase.bend(hits, d, before, after, np.asarray(wavelength_nm), surface.is_mirror)
    if surface.is_mirror:
        return reflect(d, hits.normals, hits.cosines), np.isfinite(hits.cosines)
    if (before == after).all():
        return d, np.isfinite(hits.cosines)
    return refract(d, hits.normals, hits.cosines, before / after)


def at_plane(origins: Array, directions: Array, z: float) -> Array:
    """Return the points (n, 3) where rays cross a plane across the axis."""
    return origins + directions * ((z - origins[:, 2]) / directions[:, 2])[:, None]


def axis_points(origins: Array, directions: Array) -> Array:
    """Return z (n,) where rays, drawn on either way, come nearest to the axis [mm]; not-a-number along it."""
    across = np.sum(directions[:, :2] ** 2, axis=1)
    with np.errstate(all="ignore"):
        step = -np.sum(origins[:, :2] * directions[:, :2], axis=1) / across
        return np.where(across > 1e-14, origins[:, 2] + step * directions[:, 2], np.nan)


def arrive(lens: Prescription, k: int, sense: float, p: Array, d: Array) -> tuple[Hits, Array, Mask]:
    """Return where rays (3, n) hit a surface and their directions, both in its frame, and which of them meet it.

    They have to come to it with z in a sense, 1 or -1.
    """
    surface = lens.surfaces[k]
    p = p - lens.shifts[k]
    p, d = surface.pose.inward(p, d) if surface.pose else (p, d)
    hits = surface.meet(p, d)
    return hits, d, hits.met & np.isfinite(hits.distances) & (d[2] * sense > 0)


def leave(lens: Prescription, k: int, p: Array, d: Array) -> tuple[Array, Array]:
    """Return points and directions (3, n) of the frame of a surface in that of the lens."""
    pose = lens.surfaces[k].pose
    p, d = pose.outward(p, d) if pose else (p, d)
    return p + lens.shifts[k], d


def _region_of(lens: Prescription, k: int) -> Region | None:
    """Return the region of a surface; None where there is no such surface."""
    return lens.surfaces[k].region if 0 <= k < len(lens.surfaces) else None


def _trace(
    lens: Prescription,
    points: Array,
    vectors: Array,
    wavelengths: Array,
    forward: bool,
    transmission: LensTransmission | None,
) -> Rays:
    """Return the rays after they have crossed every surface in turn."""
    count = len(points)
    rays = Rays(points.copy(), vectors.copy(), np.zeros(count, np.int32), np.full(count, -1, np.int32), np.zeros(count),
                np.zeros(count) if transmission else None)  # fmt: skip
    with np.errstate(all="ignore"):
        for low in range(0, count, CHUNK):
            checkpoint()
            part = slice(low, min(low + CHUNK, count))
            of_part = wavelengths[part] if wavelengths.ndim else wavelengths
            losses = Losses(lens, transmission, of_part, part.stop - low) if transmission else None
            _trace_part(lens, rays, part, of_part, forward, losses)
    return rays


def _trace_part(
    lens: Prescription, rays: Rays, part: slice, wavelengths: Array, forward: bool, losses: Losses | None
) -> None:
    """Trace some of the rays and write the results in their place."""
    beam = _RaysUnderWay(rays, part, lens.indices(wavelengths), wavelengths, losses)
    if forward:
        beam.p, beam.d = lens.from_scene_axes(beam.p, beam.d)
    for k in range(len(lens.surfaces)) if forward else range(len(lens.surfaces) - 1, -1, -1):
        beam.cross(lens, k, forward)
        if not len(beam.rows):
            return
    if not forward:
        beam.p, beam.d = lens.in_scene_axes(beam.p, beam.d)
    beam.store(slice(None), Status.ok, -1)
    if losses is not None and rays.transmittance is not None:
        rays.transmittance[beam.rows] = losses.share


class _RaysUnderWay:
    """Rays still under way, by components; those that fail are stored and dropped."""

    def __init__(self, rays: Rays, part: slice, indices: Array, wavelengths: Array, losses: Losses | None) -> None:
        self.rays = rays
        self.losses = losses
        self.entered = False
        self.rows = np.arange(part.start, part.stop)
        self.p = np.ascontiguousarray(rays.origins[part].T)
        d = np.ascontiguousarray(rays.directions[part].T)
        self.d = d / np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        self.path = np.zeros(len(self.rows))
        self.indices, self.wavelengths = indices, wavelengths
        self.beside = np.zeros(len(self.rows), dtype=bool)  # which pass beside the half lens at hand
        self.outside_index = indices[0]  # there

    def store(self, mask: Mask | slice, status: Status, surface: int) -> None:
        """Write the state of some rays as their result."""
        rows = self.rows[mask]
        self.rays.origins[rows] = self.p[:, mask].T
        self.rays.directions[rows] = self.d[:, mask].T
        self.rays.optical_path[rows] = self.path[mask]
        self.rays.status[rows] = status
        self.rays.surface[rows] = surface

    def drop(self, bad: Mask, status: Status, surface: int, *others: Array) -> tuple[Array, ...]:
        """Store and forget the rays of a mask. Return `others`, arrays over the rays, without them."""
        if not bad.any():
            return others
        self.store(bad, status, surface)
        good = ~bad
        self.rows, self.p, self.d, self.path = self.rows[good], self.p[:, good], self.d[:, good], self.path[good]
        self.beside = self.beside[good]
        if self.losses:
            self.losses.keep(good)
        if self.indices.ndim > 1:
            self.indices, self.outside_index = self.indices[:, good], self.outside_index[good]
            self.wavelengths = self.wavelengths[good]
        return tuple(array[..., good] for array in others)

    def cross(self, lens: Prescription, number: int, forward: bool) -> None:
        """Move every ray to a surface, and refract or reflect it there."""
        surface, previous = lens.surfaces[number], _region_of(lens, number - 1 if forward else number + 1)
        sense = lens.senses[number] if forward else -lens.senses[number + 1]
        hits, directions, met = arrive(lens, number, sense, self.p, self.d)
        kept: tuple[Array, ...] = (hits.points, hits.distances, hits.normals, hits.cosines, directions)
        if hits.undecided is not None:
            lost = hits.undecided & ~met
            kept = self.drop(lost, Status.no_convergence, number, *kept)
            met = met[~lost]
        at, length, normal, cosine, directions = self.drop(~met, Status.missed, number, *kept)
        before, after = (number, number + 1) if forward else (number + 1, number)
        halved = surface.region is not None or previous is not None  # otherwise no ray is beside a half lens
        index = np.where(self.beside, self.outside_index, self.indices[before]) if halved else self.indices[before]
        self.path = self.path + index * length
        if self.losses and self.entered:
            self.losses.through(before, length, self.beside)
        self.entered = True
        self.p = leave(lens, number, at, at)[0]
        clear = surface.clears(at[0], at[1])
        if halved:
            self.beside, apart = sides(surface.region, previous, at[0], at[1], self.beside)
            clear = clear & apart
        at, normal, cosine, directions = self.drop(~clear, Status.clipped, number, at, normal, cosine, directions)
        if surface.region is not None and surface.region != previous:  # here a half lens begins
            self.outside_index = self.indices[before]
        n, m = self.indices[before], self.indices[after]
        if not (surface.is_mirror or surface.phase) and (n == m).all():
            return
        met_at = hits._replace(points=at, normals=normal, cosines=cosine)
        bent, through = bend(surface, met_at, directions, n, m, self.wavelengths)
        if halved:
            bent, through = np.where(self.beside, directions, bent), through | self.beside
        if surface.phase:
            self.path = self.path + surface.phase.path(met_at, directions, bent, n, m, self.wavelengths, forward)
        bent, normal, cosine = self.drop(~through, Status.total_internal_reflection, number, bent, normal, cosine)
        if self.losses and surface.is_mirror:
            self.losses.off(surface)
        elif self.losses and not surface.phase:
            cosines = np.abs(cosine), np.abs(np.sum(bent * normal, axis=0))
            self.losses.across(surface, Interface(self.indices[before], self.indices[after], *cosines), self.beside)
        self.d = surface.pose.matrix() @ bent if surface.pose else bent


def reflect(directions: Array, normals: Array, cosines: Array) -> Array:
    """Return directions (3, n) after a mirror."""
    return directions - 2.0 * cosines * normals


def refract(directions: Array, normals: Array, cosines: Array, ratio: Array) -> tuple[Array, Mask]:
    """Return directions (3, n) after Snell's law with `ratio` = index before / index after, and which rays are bent.

    The others are totally reflected.
    """
    square = 1.0 - ratio * ratio * (1.0 - cosines * cosines)
    through = square >= 0
    bend = np.copysign(np.sqrt(np.maximum(square, 0.0)), cosines) - ratio * cosines
    return ratio * directions + bend * normals, through


# Rays from the scene and paraxial rays, with exact derivatives by the numbers that a lens is made of (forward mode).
#
# Each ray carries, beside point and direction, their derivatives by all variables. Where it meets a surface F(p) = 0
# the derivative of the distance follows from dF = 0, however the hit was found; refraction is differentiated as it
# stands.

LEAST_SQUARE = 1e-24  # [mm^2]; a ray on the axis, where odd powers of r have no second derivative
STEEP = 1.0  # how fast the penalty of a lost ray grows, so that it leads back
REACH = 0.9  # of the square of the height that a conic reaches
KINDS = (SurfaceKind.SPHERE, SurfaceKind.CONIC_KIND, SurfaceKind.ASPHERE)


def follows_derivatives(surface: Surface) -> bool:
    """Whether derivatives are known through a surface: a sphere, conic or asphere about the axis that refracts."""
    bends_otherwise = surface.is_mirror or surface.phase is not None
    return surface.is_rotational and not bends_otherwise and surface.shape.kind in KINDS


@dataclass(frozen=True)
class Seeds:
    """Derivatives of the numbers of a lens by some variables.

    Attributes
    ----------
    curvatures, thicknesses, conics : (surfaces, variables) arrays
        The thickness behind the last surface is the distance to the film.
    aspheric : mapping of (surface, power) to (variables,) array
    """

    curvatures: Array
    thicknesses: Array
    conics: Array
    aspheric: dict[tuple[int, int], Array] = field(default_factory=dict)

    @classmethod
    def none(cls, surfaces: int, variables: int) -> Seeds:
        """Return derivatives that are all 0, to be filled in."""
        curvatures, thicknesses, conics = np.zeros((3, surfaces, variables))
        return cls(curvatures, thicknesses, conics)

    def active(self, launched: Array) -> list[int]:
        """Return how many of the variables, counted from the first, matter to a ray up to behind each surface."""
        rows = np.abs(self.curvatures) + np.abs(self.conics)
        for (k, _), values in self.aspheric.items():
            rows[k] = rows[k] + np.abs(values)
        rows[0] = rows[0] + np.abs(launched)
        rows[1:] += np.abs(self.thicknesses[:-1])
        last = [int(np.flatnonzero(row)[-1]) + 1 if row.any() else 0 for row in rows]
        return list(np.maximum.accumulate(last))


class ProfileDerivatives:
    """Sag z of a profile over s = r^2 with z' = dz/ds and z'', and the derivatives of z and z' by its numbers."""

    def __init__(self, surface: Surface, s: Array) -> None:
        self.s, self.c, self.q = s, np.float64(surface.curvature), np.float64(1.0 + surface.conic)
        with np.errstate(invalid="ignore"):
            self.root = np.sqrt(1.0 - self.q * self.c * self.c * s)
        self.conic_sag = self.c * s / (1.0 + self.root)
        if surface.aspheric:
            self.z, self.slope = sag_of_profile(surface, s)
        else:
            self.z, self.slope = self.conic_sag, 0.5 * self.c / self.root
        self.bend = 0.25 * self.q * self.c**3 / self.root**3
        for power, a in surface.aspheric:
            half = power / 2
            if half != 1:
                self.bend = self.bend + a * half * (half - 1) * np.maximum(s, LEAST_SQUARE) ** (half - 2)

    def by_curvature(self) -> tuple[Array, Array]:
        """Return the derivatives of z and z' by the curvature."""
        z = (self.s + self.q * self.conic_sag**2) / (2.0 * self.root)
        return z, 0.5 / self.root + 0.5 * self.q * self.c**2 * self.s / self.root**3

    def by_conic(self) -> tuple[Array, Array]:
        """Return the derivatives of z and z' by the conic constant."""
        return self.c * self.conic_sag**2 / (2.0 * self.root), 0.25 * self.c**3 * self.s / self.root**3

    def by_power(self, power: int) -> tuple[Array, Array]:
        """Return the derivatives of z and z' by the coefficient of a power of r."""
        half = power / 2
        return self.s**half, half * np.maximum(self.s, LEAST_SQUARE) ** (half - 1)

    def seeded(self, seeds: Seeds, k: int, count: int) -> list[tuple[Array, Array, Array]]:
        """Return (seed, dz, dz') of each number of surface k that depends on one of the first `count` variables."""
        rows = []
        if seeds.curvatures[k, :count].any():
            rows.append((seeds.curvatures[k, :count], *self.by_curvature()))
        if seeds.conics[k, :count].any():
            rows.append((seeds.conics[k, :count], *self.by_conic()))
        for (surface, power), values in seeds.aspheric.items():
            if surface == k:
                rows.append((values[:count], *self.by_power(power)))
        return rows


def sag_with_derivatives(surface: Surface, height: float, seeds: Seeds, k: int) -> tuple[float, Array]:
    """Return the sag of surface k at a height from its axis [mm], and its derivatives.

    Near the edge of what a conic reaches, and beyond, it goes on straight in s, so that bounds lead back from there.
    """
    s, q, c = height * height, 1.0 + surface.conic, surface.curvature
    near = min(s, REACH / (q * c * c)) if q * c * c > 0 else s
    profile, beyond = ProfileDerivatives(surface, np.array([near])), s - near
    total = np.zeros(seeds.curvatures.shape[1])
    for seed, z, slope in profile.seeded(seeds, k, len(total)):
        total = total + seed * (z[0] + slope[0] * beyond)
    if beyond > 0:
        moved = -near * (2.0 * seeds.curvatures[k] / c + seeds.conics[k] / q)
        total = total + profile.bend[0] * beyond * moved
    return float(profile.z[0] + profile.slope[0] * beyond), total


def trace_with_derivatives(
    lens: Prescription,
    points: Array,
    directions: Array,
    paths: Array,
    indices: Array,
    film_mm: float,
    seeds: Seeds,
    points_by_z: Array,
    paths_by: Array,
    directions_by: list[Array] | None = None,
) -> RaysWithDerivatives:
    """Trace rays from the scene to the film, with their derivatives.

    Parameters
    ----------
    lens : Prescription
        All surfaces are such that `follows_derivatives` holds; rims stop no ray.
    points, directions : (3, n) arrays
        In the frame of the first vertex [mm]; directions have unit length.
    paths : (n,) array
        Optical path up to the points [mm].
    indices : (surfaces + 1, n) array
        Of the media for each ray.
    film_mm : float
        From the last vertex to the film.
    seeds : Seeds
        Those of no variables trace without derivatives.
    points_by_z : (variables,) array
        Derivative of z of all starting points; x and y are fixed.
    paths_by : (variables, n) array
        Derivatives of `paths`.
    directions_by : list of three (variables, n) arrays, optional
        Derivatives of directions; without them they do not depend on the variables.
    """
    rays = RaysWithDerivatives(lens, points, directions, paths, seeds, points_by_z, paths_by)
    launched = np.abs(points_by_z)
    if directions_by is not None:
        rays.directions_by = [by.copy() for by in directions_by]
        launched = launched + sum(np.abs(by).sum(axis=1) for by in directions_by)
    with np.errstate(all="ignore"):
        for k, count in enumerate(seeds.active(launched)):
            rays.cross(k, lens.surfaces[k], indices[k], indices[k + 1], count)
            gap = film_mm if k + 1 == len(lens.surfaces) else lens.surfaces[k].thickness
            rays.shift(gap, seeds.thicknesses[k])
        rays.to_plane(indices[-1])
    return rays


class RaysWithDerivatives:
    """Rays with their derivatives by the variables: on their way in the frame of the next vertex, at last of the film.

    Attributes
    ----------
    points, directions : (3, n) arrays
        On the film z is 0.
    paths : (n,) array
        Optical path [mm] from the start.
    points_by, directions_by : lists of three (variables, n) arrays
    paths_by : (variables, n) array
    status, surface : (n,) arrays
        As of `ray_trace.Rays`.
    excess : (n,) array
        Of a ray that fails how far it is from coming through, 1 or more and smooth; 0 of the others.
    excess_by : (variables, n) array
    heights : (surfaces, n) array
        Distance from the axis where each surface was met; 0 from where a ray fails.
    """

    def __init__(
        self, lens: Prescription, p: Array, d: Array, paths: Array, seeds: Seeds, by_z: Array, paths_by: Array
    ) -> None:
        count, n = len(by_z), p.shape[1]
        self.seeds, self.points, self.directions, self.paths = seeds, p, d, paths
        self.points_by = [np.zeros((count, n)) for _ in range(3)]
        self.points_by[2] += by_z[:, None]
        self.directions_by = [np.zeros((count, n)) for _ in range(3)]
        self.paths_by = paths_by.copy()
        self.status = np.zeros(n, dtype=np.int32)
        self.surface = np.full(n, -1, dtype=np.int32)
        self.excess, self.excess_by = np.zeros(n), np.zeros((count, n))
        self.heights = np.zeros((len(lens.surfaces), n))

    def shift(self, gap: float, by: Array) -> None:
        """Go to the frame of the next vertex."""
        self.points = self.points.copy()
        self.points[2] -= gap
        if by.any():
            self.points_by[2] -= by[:, None]

    def cross(self, k: int, surface: Surface, before: Array, after: Array, count: int) -> None:
        """Refract at a surface; `count` variables matter up to there."""
        hits = surface.meet(self.points, self.directions)
        met = hits.met & np.isfinite(hits.distances)
        if not met.all():
            self._lose(~met & (self.status == Status.ok), Status.missed, k, *self._miss(surface, k))
            hits = surface.meet(self.points, self.directions)
        dn, dcos = self._hit(k, surface, hits.points, hits.normals, hits.cosines, hits.distances, before, count)
        self.heights[k] = np.where(self.status == Status.ok, np.hypot(self.points[0], self.points[1]), 0.0)
        ratio = before / after
        if np.all(ratio == 1.0):
            return
        cos, normal = hits.cosines, hits.normals
        square = 1.0 - ratio * ratio * (1.0 - cos * cos)
        lost = ~(square > 0)
        if lost.any():
            self._lose(lost, Status.total_internal_reflection, k, 1.0 - square, -2.0 * ratio * ratio * cos * dcos)
            cos, square = np.where(lost, 1.0, cos), np.where(lost, 1.0, square)
            normal = np.where(lost, np.array([[0.0], [0.0], [1.0]]), normal)
            dn, dcos = [np.where(lost, 0.0, a) for a in dn], np.where(lost, 0.0, dcos)
        root = np.sqrt(square)
        bend, dbend = root - ratio * cos, (ratio * ratio * cos / root - ratio) * dcos
        self.directions = ratio * self.directions + bend * normal
        for i in range(3):
            self.directions_by[i][:count] = ratio * self.directions_by[i][:count] + dbend * normal[i] + bend * dn[i]

    def _hit(
        self, k: int, surface: Surface, at: Array, normal: Array, cos: Array, length: Array, index: Array, count: int
    ) -> tuple[list[Array], Array]:
        """Move to the points where rays hit; return the derivatives of unit normals and of cosines."""
        self.paths = self.paths + index * length
        self.points = at
        if not count:
            nothing = np.zeros((0, len(length)))
            return [nothing] * 3, nothing
        d, dp, dd = self.directions, [a[:count] for a in self.points_by], [a[:count] for a in self.directions_by]
        moved = [dp[i] + length * dd[i] for i in range(3)]
        x, y = at[0], at[1]
        profile = ProfileDerivatives(surface, x * x + y * y)
        rows = profile.seeded(self.seeds, k, count)
        dlength = -(normal[0] * moved[0] + normal[1] * moved[1] + normal[2] * moved[2])
        for seed, z, _ in rows:
            dlength += seed[:, None] * (normal[2] * z)
        dlength /= cos
        for i in range(3):
            moved[i] += dlength * d[i]
            self.points_by[i][:count] = moved[i]
        self.paths_by[:count] += index * dlength
        # N = (-2 x z', -2 y z', 1) and n = N / |N|, with 1 / |N| the z of n
        dslope = (2.0 * profile.bend) * (x * moved[0] + y * moved[1])
        for seed, _, slope in rows:
            dslope += seed[:, None] * slope
        twice = 2.0 * profile.slope
        nx, ny = -(twice * moved[0] + (2.0 * x) * dslope), -(twice * moved[1] + (2.0 * y) * dslope)
        along = normal[0] * nx + normal[1] * ny
        dn = [(nx - along * normal[0]) * normal[2], (ny - along * normal[1]) * normal[2],
              -along * (normal[2] * normal[2])]  # fmt: skip
        dcos = sum(dn[i] * d[i] + normal[i] * dd[i] for i in range(3))
        return dn, np.asarray(dcos)

    def _miss(self, surface: Surface, k: int) -> tuple[Array, Array]:
        """Return by how much rays miss a surface, more for steeper ones and rays farther out, and its derivative."""
        step = -self.points[2] / self.directions[2]
        dstep = -(self.points_by[2] + step * self.directions_by[2]) / self.directions[2]
        x, y = (self.points[i] + step * self.directions[i] for i in range(2))
        dx, dy = (self.points_by[i] + step * self.directions_by[i] + dstep * self.directions[i] for i in range(2))
        inverse = 1.0 / surface.semi_diameter**2 if np.isfinite(surface.semi_diameter) else 0.0
        scale = surface.curvature**2 + inverse
        square = x * x + y * y
        change = 2.0 * scale * (x * dx + y * dy)
        change = change + 2.0 * surface.curvature * self.seeds.curvatures[k][:, None] * square
        return 1.0 + scale * square, change

    def _lose(self, lost: NDArray[np.bool_], status: Status, k: int, excess: Array, by: Array) -> None:
        """Note rays that fail, and send them on along the axis, where they harm nothing."""
        self.status[lost], self.surface[lost] = status, k
        ok = np.isfinite(excess)
        self.excess = np.where(lost, np.where(ok, 1.0 + STEEP * (excess - 1.0), 1.0), self.excess)
        fits = lost & ok
        self.excess_by[: len(by)] = np.where(fits, STEEP * by, self.excess_by[: len(by)])
        self.excess_by[~np.isfinite(self.excess_by)] = 0.0
        axis = np.array([[0.0], [0.0], [1.0]])
        self.points, self.directions = np.where(lost, 0.0, self.points), np.where(lost, axis, self.directions)
        for arrays in (self.points_by, self.directions_by):
            for a in arrays:
                a[:, lost] = 0.0

    def to_plane(self, index: Array) -> None:
        """Go to the plane of the film; the path goes on to there."""
        length = -self.points[2] / self.directions[2]
        dlength = -(self.points_by[2] + length * self.directions_by[2]) / self.directions[2]
        self.points = self.points + length * self.directions
        for i in range(3):
            self.points_by[i] += length * self.directions_by[i] + dlength * self.directions[i]
        self.paths, self.paths_by = self.paths + index * length, self.paths_by + index * dlength


@dataclass(frozen=True)
class Paraxial:
    """Two paraxial rays through a lens, (y, n u) = (1, 0) and (0, 1) before it, at several wavelengths.

    Attributes
    ----------
    at_stop : (wavelengths, 2) array
        Heights in the plane of the stop.
    behind : (2, wavelengths, 2) array
        Heights and n u behind the last surface: the system matrix.
    at_stop_by, behind_by : arrays with the variables in front
    index : (wavelengths,) array
        Behind the lens.
    """

    at_stop: Array
    behind: Array
    at_stop_by: Array
    behind_by: Array
    index: Array

    def focal_lengths(self) -> tuple[Array, Array]:
        """Return the focal length at each wavelength [mm] and its derivatives (variables, wavelengths)."""
        power = self.behind[1, :, 0]
        return -self.index / power, self.index / power**2 * self.behind_by[:, 1, :, 0]

    def back_focal_distances(self) -> tuple[Array, Array]:
        """Return last vertex to rear focal point at each wavelength [mm] and its derivatives."""
        length, by = self.focal_lengths()
        a = self.behind[0, :, 0]
        return a * length, self.behind_by[:, 0, :, 0] * length + a * by

    def images(self, object_mm: float, index: Array) -> tuple[Array, Array, Array, Array]:
        """Return where the image of a plane lies, from the last vertex [mm], and the magnification, by wavelength, each
        with its derivatives. The plane is so far before the first vertex, in media of some index."""
        at = np.stack([object_mm / index, np.ones_like(index)], axis=1)  # (y, n u) at the first vertex of an axial ray
        y, v = np.sum(self.behind * at, axis=2)
        dy, dv = np.moveaxis(np.sum(self.behind_by * at, axis=3), 1, 0)
        return -self.index * y / v, self.index * (y * dv / v - dy) / v, 1 / v, -dv / v**2

    def entrance_pupil(self, wave: int, index: float) -> tuple[float, Array, float]:
        """Return its place from the first vertex [mm] with derivatives, and height at the stop per height in it."""
        (a, b), by = self.at_stop[wave], self.at_stop_by[:, wave]
        return float(b * index / a), np.asarray((by[:, 1] - b / a * by[:, 0]) * index / a), float(abs(a))


def trace_paraxial(lens: Prescription, indices: Array, seeds: Seeds, stop: int) -> Paraxial:
    """Trace the two paraxial rays with their derivatives; `indices` (surfaces + 1, wavelengths) of the media."""
    count, waves = seeds.curvatures.shape[1], indices.shape[1]
    y, v = np.tile([1.0, 0.0], (waves, 1)), np.tile([0.0, 1.0], (waves, 1))
    dy, dv = np.zeros((count, waves, 2)), np.zeros((count, waves, 2))
    at_stop, at_stop_by = y, dy
    for k, surface in enumerate(lens.surfaces):
        if k == stop:
            at_stop, at_stop_by = y.copy(), dy.copy()
        step = (indices[k + 1] - indices[k])[:, None]
        power = step * surface.paraxial_curvature()
        by = seeds.curvatures[k] + 2.0 * seeds.aspheric.get((k, 2), 0.0)
        dv = dv - power * dy - by[:, None, None] * (step * y)
        v = v - power * y
        if k + 1 < len(lens.surfaces):
            gap = surface.thickness / indices[k + 1][:, None]
            dy = dy + gap * dv + seeds.thicknesses[k][:, None, None] * (v / indices[k + 1][:, None])
            y = y + gap * v
    return Paraxial(at_stop, np.stack([y, v]), at_stop_by, np.stack([dy, dv], axis=1), indices[-1])
