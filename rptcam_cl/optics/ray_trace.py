"""Exact rays through every surface in float64: the reference for every other tracer."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.coating import Interface
from rptcam_cl.optics.placement import IN_PLACE
from rptcam_cl.optics.prescription import Prescription
from rptcam_cl.optics.region import Region, sides
from rptcam_cl.optics.shapes import WORTH_MOVING
from rptcam_cl.optics.surface import Surface
from rptcam_cl.optics.transmission import LensTransmission, Losses

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

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

    def _arrays(self) -> tuple[NDArray[Any], ...]:
        return self.origins, self.directions, self.status, self.surface, self.optical_path


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
        Points [mm] and directions of any length in the frame of the lens, z = 0 at its first vertex and +z to the film.
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
    indices = lens.indices(wavelength_nm)
    passed = np.zeros(len(origins), dtype=bool)
    with np.errstate(all="ignore"):
        for low in range(0, len(origins), CHUNK):
            rows = np.arange(low, min(low + CHUNK, len(origins)))
            p, d = np.ascontiguousarray(origins[rows].T), np.ascontiguousarray(directions[rows].T)
            d /= np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
            good, beside = np.ones(len(rows), dtype=bool), np.zeros(len(rows), dtype=bool)
            for k in range(len(lens.surfaces) - 1, -1, -1):
                ratio, previous = indices[k + 1] / indices[k], _region_of(lens, k + 1)
                p, d, beside, through = _crossed(
                    lens.surfaces[k], float(lens.vertices[k]), p, d, ratio, beside, previous, -lens.senses[k + 1]
                )
                good &= through
                if np.count_nonzero(good) < WORTH_MOVING * len(rows):
                    rows, p, d, beside, good = rows[good], p[:, good], d[:, good], beside[good], good[good]
                if not len(rows):
                    break
            passed[rows] = good
    return passed


def passed_rays(
    lens: Prescription, origins: Array, directions: Array, wavelength_nm: float = LINE_D_NM, start: str = "film"
) -> tuple[NDArray[np.intp], Array, Array]:
    """Return which rays (n, 3) come through, and their last points and directions (3, m): those of `trace`, sooner."""
    if not all(surface.is_rotational and not surface.aspheric for surface in lens.surfaces):
        rays = trace(lens, origins, directions, wavelength_nm, start)
        passed = np.flatnonzero(rays.passed)
        return passed, rays.origins[passed].T, rays.directions[passed].T
    indices, forward, count = lens.indices(wavelength_nm), start == "scene", len(lens.surfaces)
    rows: NDArray[Any] = np.arange(len(origins))
    p, d = np.ascontiguousarray(origins.T), np.ascontiguousarray(directions.T)
    with np.errstate(all="ignore"):
        d = d / np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        for k in range(count) if forward else range(count - 1, -1, -1):
            surface, shift = lens.surfaces[k], np.array([[0.0], [0.0], [float(lens.vertices[k])]])
            before, after = (indices[k], indices[k + 1]) if forward else (indices[k + 1], indices[k])
            sense = lens.senses[k] if forward else -lens.senses[k + 1]
            hits = surface.meet(p - shift, d)
            good = hits.met & np.isfinite(hits.distances) & (d[2] * sense > 0)
            good &= surface.clears(hits.points[0], hits.points[1])
            rows, at, normal, cosine, d = _kept(good, rows, hits.points, hits.normals, hits.cosines, d)
            if not len(rows):
                return rows, at, d
            p = at + shift
            if surface.is_mirror:
                d = reflect(d, normal, cosine)
            elif before != after:
                bent, good = refract(d, normal, cosine, before / after)
                rows, p, d = _kept(good, rows, p, bent)
    return rows, p, d


def _kept(good: Mask, *arrays: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """Return arrays over rays, of those of a mask."""
    kept = np.flatnonzero(good)
    return arrays if len(kept) == len(good) else tuple(array.take(kept, axis=-1) for array in arrays)


def _crossed(
    surface: Surface,
    vertex: float,
    p: Array,
    d: Array,
    ratio: Array,
    beside: Mask,
    previous: Region | None,
    sense: float,
) -> tuple[Array, Array, Mask, Mask]:
    """Return rays (3, n) from the film on and behind a surface, which are beside a half lens, and which have passed.

    They have to come to the surface with z in the given sense.
    """
    pose, shift = surface.pose, np.array([[0.0], [0.0], [vertex]])
    points, d = pose.inward(p - shift, d) if pose else (p - shift, d)
    hits = surface.meet(points, d)
    good = hits.met & np.isfinite(hits.distances) & (d[2] * sense > 0) & surface.clears(hits.points[0], hits.points[1])
    if surface.region is not None or previous is not None:
        beside, apart = sides(surface.region, previous, hits.points[0], hits.points[1], beside)
        good &= apart
    if surface.is_mirror:
        d = reflect(d, hits.normals, hits.cosines)
    elif ratio != 1.0:
        bent, through = refract(d, hits.normals, hits.cosines, ratio)
        d = np.where(beside, d, bent) if surface.region else bent
        good &= through | beside if surface.region else through
    at, d = pose.outward(hits.points, d) if pose else (hits.points, d)
    return at + shift, d, beside, good


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
    indices = lens.indices(wavelengths)
    count = len(points)
    rays = Rays(points.copy(), vectors.copy(), np.zeros(count, np.int32), np.full(count, -1, np.int32), np.zeros(count),
                np.zeros(count) if transmission else None)  # fmt: skip
    with np.errstate(all="ignore"):
        for low in range(0, count, CHUNK):
            part = slice(low, min(low + CHUNK, count))
            of_part = wavelengths[part] if wavelengths.ndim else wavelengths
            losses = Losses(lens, transmission, of_part, part.stop - low) if transmission else None
            _trace_part(lens, rays, part, indices if indices.ndim == 1 else indices[:, part], forward, losses)
    return rays


def _trace_part(
    lens: Prescription, rays: Rays, part: slice, indices: Array, forward: bool, losses: Losses | None
) -> None:
    """Trace some of the rays and write the results in their place."""
    beam = _Beam(rays, part, indices, losses)
    for k in range(len(lens.surfaces)) if forward else range(len(lens.surfaces) - 1, -1, -1):
        previous = _region_of(lens, k - 1 if forward else k + 1)
        sense = lens.senses[k] if forward else -lens.senses[k + 1]
        beam.cross(lens.surfaces[k], k, float(lens.vertices[k]), forward, sense, previous)
        if not len(beam.rows):
            return
    beam.store(slice(None), Status.ok, -1)
    if losses is not None and rays.transmittance is not None:
        rays.transmittance[beam.rows] = losses.share


class _Beam:
    """Rays still under way, by components; those that fail are stored and dropped."""

    def __init__(self, rays: Rays, part: slice, indices: Array, losses: Losses | None) -> None:
        self.rays = rays
        self.losses = losses
        self.entered = False
        self.rows = np.arange(part.start, part.stop)
        self.p = np.ascontiguousarray(rays.origins[part].T)
        d = np.ascontiguousarray(rays.directions[part].T)
        self.d = d / np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        self.path = np.zeros(len(self.rows))
        self.indices = indices
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
        return tuple(array[..., good] for array in others)

    def cross(
        self, surface: Surface, number: int, vertex: float, forward: bool, sense: float, previous: Region | None
    ) -> None:
        """Move every ray, travelling in a sense of z, to a surface, and refract or reflect it there."""
        pose = surface.pose or IN_PLACE
        shift = np.array([[0.0], [0.0], [vertex]])
        points, directions = pose.inward(self.p - shift, self.d) if surface.pose else (self.p - shift, self.d)
        hits = surface.meet(points, directions)
        met = hits.met & np.isfinite(hits.distances) & (directions[2] * sense > 0)
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
        self.p = (pose.outward(at, at)[0] if surface.pose else at) + shift
        opens = surface.region is not None and surface.region != previous
        clear = surface.clears(at[0], at[1])
        if halved:
            self.beside, apart = sides(surface.region, previous, at[0], at[1], self.beside)
            clear = clear & apart
        clipped = ~clear
        normal, cosine, directions = self.drop(clipped, Status.clipped, number, normal, cosine, directions)
        if opens:
            self.outside_index = self.indices[before]
        if surface.is_mirror:
            if self.losses:
                self.losses.off(surface)
            bent = reflect(directions, normal, cosine)
            self.d = pose.matrix() @ bent if surface.pose else bent
            return
        if np.array_equal(self.indices[before], self.indices[after]):
            return
        bent, through = refract(directions, normal, cosine, self.indices[before] / self.indices[after])
        if halved:
            bent, through = np.where(self.beside, directions, bent), through | self.beside
        bent, normal, cosine = self.drop(~through, Status.total_internal_reflection, number, bent, normal, cosine)
        if self.losses:
            cosines = np.abs(cosine), np.abs(np.sum(bent * normal, axis=0))
            self.losses.across(surface, Interface(self.indices[before], self.indices[after], *cosines), self.beside)
        self.d = pose.matrix() @ bent if surface.pose else bent


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
