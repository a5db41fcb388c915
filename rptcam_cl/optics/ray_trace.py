"""Exact rays through every surface in float64, with the light they lose: the reference for every other tracer."""

from __future__ import annotations

from dataclasses import replace
from enum import IntEnum
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.optics import glass
from rptcam_cl.optics.shapes import WORTH_MOVING, Hits
from rptcam_cl.optics.surface import Prescription, Region, Surface, sides

#
# What a lens takes from the light that crosses it: reflection at its surfaces, absorption in its glass and mirrors.
#
# Reflected light is lost here; `ghosts` follows it. Each surface counts with the mean of both polarisations.

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
L = TypeVar("L", bound=Prescription)

_AIR_LIKE = 1e-3  # a medium whose index is nearer to 1 takes a lens's own coating like air


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

    def coating_of(self, surface: Surface) -> glass.Coating:
        """Return the coating of a surface, as far as coatings count."""
        return surface.coating if self.coatings and surface.coating is not None else glass.BARE

    def mirror_share(self, mirror: Surface, wavelength_nm: ArrayLike) -> Array:
        """Return the share of light that a mirror reflects at wavelengths [nm]: all, unless it says how much."""
        coating = self.coating_of(mirror)
        if isinstance(coating, glass.MeasuredReflectance):
            return coating.reflectance(wavelength_nm)
        return np.ones(np.shape(wavelength_nm))


IDEAL = LensTransmission(fresnel=False, coatings=False, absorption=False)
UNCOATED = LensTransmission(coatings=False)
COATED = LensTransmission()
BY_NAME = {"ideal": IDEAL, "bare": UNCOATED, "coated": COATED}


def meets_air(before: glass.Medium, after: glass.Medium) -> bool:
    """Return whether a surface between two media lies between glass and air: where a coating of a whole lens goes."""
    close = [abs(float(medium.index(LINE_D_NM)) - 1.0) < _AIR_LIKE for medium in (before, after)]
    return any(close) and not all(close)


def with_coating(lens: L, coating: glass.Coating) -> L:
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
            np.broadcast_to(glass.attenuation(medium, wavelengths) if transmission.absorption else 0.0, (count,))
            for medium in lens.media
        ]
        self.share = np.ones(count)

    def through(self, medium: int, length: Array, beside: Mask) -> None:
        """Take away what a medium (0 in front of the lens) absorbs over a length [mm], but beside a half lens."""
        if self.transmission.absorption:
            self.share = self.share * np.where(beside, 1.0, np.exp(-self.attenuations[medium] * length))

    def across(self, surface: Surface, interface: glass.Interface, beside: Mask) -> None:
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
            interface = glass.Interface(indices[k], indices[k + 1])
            passed = passed * transmission.coating_of(surface).transmittance(interface, wavelengths)
        if transmission.absorption and k + 1 < len(lens.surfaces):
            passed = passed * np.exp(-glass.attenuation(surface.glass, wavelengths) * abs(surface.thickness))
    return passed


def known_nm(lens: Prescription, transmission: LensTransmission) -> tuple[float, float]:
    """Return the wavelengths for which the losses are known [nm]; without limits, 0 and infinity."""
    limits = [(0.0, np.inf)]
    if transmission.absorption:
        inside = [surface.glass.absorption for surface in lens.surfaces[:-1]]
        limits += [(a.wavelengths_nm[0], a.wavelengths_nm[-1]) for a in inside if a is not None]
    if transmission.fresnel:
        coatings = [transmission.coating_of(surface) for surface in lens.surfaces]
        limits += [c.range_nm for c in coatings if isinstance(c, glass.MeasuredReflectance)]
    return max(low for low, _ in limits), min(high for _, high in limits)


def is_tinted(lens: Prescription, transmission: LensTransmission) -> bool:
    """Return whether coatings or glass take more from one colour than from another."""
    low, high = known_nm(lens, transmission)
    if not low < high:
        return False
    coatings = {transmission.coating_of(surface) for surface in lens.surfaces if transmission.fresnel}
    layers = any(isinstance(coating, glass.QuarterWave | glass.LayerStack) for coating in coatings)
    measured = any(
        isinstance(coating, glass.MeasuredReflectance) and np.ptp(coating.values) > 0 for coating in coatings
    )
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

    def put(self, chosen: NDArray[np.int_], rays: Rays) -> None:
        """Write others over some of the rays, without what is left of their light."""
        for name in ("origins", "directions", "status", "surface", "optical_path"):
            getattr(self, name)[chosen] = getattr(rays, name)


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
        hits, d, met = arrive(lens, k, forward, p, d)
        good &= met & surface.clears(hits.points[0], hits.points[1])
        if surface.region is not None or previous is not None:
            beside, apart = sides(surface.region, previous, hits.points[0], hits.points[1], beside)
            good &= apart
        bent, through = bend(surface, hits, d, *_on_both_sides(indices, k, forward), wavelength_nm)
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
            hits, d, met = arrive(lens, k, towards_film, p, d)
            lost |= ~met
            places[k] = np.where(lost[:, None], np.nan, hits.points[:2].T)
            d, through = bend(lens.surfaces[k], hits, d, *_on_both_sides(indices, k, towards_film), wavelength_nm)
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


def arrive(lens: Prescription, k: int, forward: bool, p: Array, d: Array) -> tuple[Hits, Array, Mask]:
    """Return where rays (3, n) hit a surface and their directions, both in its frame, and which of them meet it.

    They have to come to it as light does on its way to the film (`forward`), or away from it.
    """
    surface, sense = lens.surfaces[k], lens.senses[k] if forward else -lens.senses[k + 1]
    p = p - lens.shifts[k]
    p, d = surface.pose.inward(p, d) if surface.pose else (p, d)
    hits = surface.meet(p, d)
    return hits, d, hits.met & np.isfinite(hits.distances) & (d[2] * sense > 0)


def leave(lens: Prescription, k: int, p: Array, d: Array) -> tuple[Array, Array]:
    """Return points and directions (3, n) of the frame of a surface in that of the lens."""
    pose = lens.surfaces[k].pose
    p, d = pose.outward(p, d) if pose else (p, d)
    return p + lens.shifts[k], d


def _on_both_sides(indices: Array, k: int, forward: bool) -> tuple[Array, Array]:
    """Return the indices of the media before and behind a surface, as rays meet them."""
    return (indices[k], indices[k + 1]) if forward else (indices[k + 1], indices[k])


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
        hits, directions, met = arrive(lens, number, forward, self.p, self.d)
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
            self.losses.across(
                surface, glass.Interface(self.indices[before], self.indices[after], *cosines), self.beside
            )
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
