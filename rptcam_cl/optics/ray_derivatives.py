"""Rays from the scene and paraxial rays, with exact derivatives by the numbers that a lens is made of (forward mode).

Each ray carries, beside point and direction, their derivatives by all variables. Where it meets a surface F(p) = 0 the
derivative of the distance follows from dF = 0, however the hit was found; refraction is differentiated as it stands.
"""

from __future__ import annotations

from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import SurfaceKind
from rptcam_cl.optics.ray_trace import Status
from rptcam_cl.optics.shapes import sag_of_profile
from rptcam_cl.optics.surface import Prescription, Surface

Array = NDArray[np.float64]

_LEAST_SQUARE = 1e-24  # [mm^2]; a ray on the axis, where odd powers of r have no second derivative
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


class _ProfileDerivatives:
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
                self.bend = self.bend + a * half * (half - 1) * np.maximum(s, _LEAST_SQUARE) ** (half - 2)

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
        return self.s**half, half * np.maximum(self.s, _LEAST_SQUARE) ** (half - 1)

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
    profile, beyond = _ProfileDerivatives(surface, np.array([near])), s - near
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
        profile = _ProfileDerivatives(surface, x * x + y * y)
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
