"""The film behind a lens and rays from its points: how it stands, which of them come through, boxes round pupils."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import Rays, passing
from rptcam_cl.optics.surface import Surface

#
# How the film of a camera stands behind its lens: straight across the axis, or moved, tilted and swung.
#
# Film points have two names. *On the film*: millimetres along its own sides from its centre, as the lens draws them,
# so that what is right in an upright picture is left on the film. *In the frame of the lens*: x to the right, y up,
# and how much deeper than the film distance the point lies. A film that is not moved has the same x and y in both.

Array = NDArray[np.float64]
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class FilmFrame:
    """Where the film stands; without arguments where its lens expects it.

    Attributes
    ----------
    centre : (x, y)
        Of the film, in the frame of the lens [mm]. It lies at the film distance.
    across, up : (x, y, depth)
        Unit vectors along the film's sides, right and up in the frame of the lens where it is not turned.
    """

    centre: tuple[float, float] = (0.0, 0.0)
    across: Triple = (1.0, 0.0, 0.0)
    up: Triple = (0.0, 1.0, 0.0)

    @property
    def is_flat(self) -> bool:
        """Whether the film stands across the axis, so that all of it lies at the film distance."""
        return self.across[2] == 0.0 and self.up[2] == 0.0

    @property
    def is_moved(self) -> bool:
        """Whether it stands in another way than its lens expects."""
        return self != UNMOVED

    @cached_property
    def normal(self) -> Triple:
        """Unit vector across the film, away from the lens."""
        x, y, z = np.cross(self.across, self.up).tolist()
        return x, y, z

    @cached_property
    def slopes(self) -> tuple[float, float]:
        """How much deeper the film lies per millimetre to the right and up."""
        x, y, z = self.normal
        return -x / z, -y / z

    def depth(self, points: Array) -> Array:
        """Return how far behind the film distance points (..., 2) of the film lie, x and y in the frame of the lens."""
        away = points - np.array(self.centre)
        return np.asarray(away[..., 0] * self.slopes[0] + away[..., 1] * self.slopes[1])

    def points(self, film: Array) -> Array:
        """Return points (..., 2) on the film in the frame of the lens, (..., 3) with their depths [mm]."""
        film = np.asarray(film, dtype=np.float64)
        along = film[..., :1] * np.array(self.across) + film[..., 1:] * np.array(self.up)
        return np.asarray(along + np.array([*self.centre, 0.0]))

    def on_film(self, points: Array) -> Array:
        """Return points (..., 2) of the frame of the lens that lie in the film's plane as points on the film."""
        columns = np.array([self.across[:2], self.up[:2]]).T
        return np.asarray((points - np.array(self.centre)) @ np.linalg.inv(columns).T)

    def corners(self, half_film_mm: tuple[float, float]) -> Array:
        """Return the corners (4, 3) of a film of such half sides, in order round it."""
        return self.points(np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(half_film_mm))

    def bounds(self, half_film_mm: tuple[float, float]) -> tuple[float, float]:
        """Return half the sides of the rectangle about the axis that holds the film, across the axis [mm]."""
        if not self.is_moved:
            return half_film_mm
        x, y = np.abs(self.corners(half_film_mm)[:, :2]).max(axis=0).tolist()
        return x, y

    def grid(self, half_film_mm: tuple[float, float], count: int) -> Array:
        """Return points (count, count, 2) from edge to edge of the film, rows upwards, x and y in the lens's frame."""
        x, y = (np.linspace(-half, half, count) for half in half_film_mm)
        return self.points(np.stack(np.meshgrid(x, y), axis=-1))[..., :2]

    def reach(self, half_film_mm: tuple[float, float], directions: Array) -> Array:
        """Return how far from the axis the film goes in directions (n, 2), 0 where it is not [mm]."""
        corners = self.corners(half_film_mm)[:, :2]
        sides = np.roll(corners, -1, axis=0) - corners
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = directions[:, :1] * sides[:, 1] - directions[:, 1:] * sides[:, 0]
            out = (corners[:, 0] * sides[:, 1] - corners[:, 1] * sides[:, 0]) / turn
            along = (corners[:, 0] * directions[:, 1:] - corners[:, 1] * directions[:, :1]) / turn
        slack = 1e-12
        meets = (turn != 0) & (out > 0) & (along >= -slack) & (along <= 1 + slack)
        return np.asarray(np.where(meets, out, 0.0).max(axis=1))


UNMOVED = FilmFrame()


#
# Which rays from points of the film come through the lens: the ground on which pupils and irradiance are measured.
#
# A ray is named by its film point (x, y on the film) and the point (u, v) where it crosses the plane of the last
# vertex.

_PATCH_AZIMUTHS = 32
PATCH_RADII = 257  # so many that the outline of a bulging surface, which lies between two, is met within 1e-4
BULGE = 1e-4
_LEAST_GAP = 1e-3  # of the film distance, between the last surface and points whose windows are sought

Mask = NDArray[np.bool_]
Wavelengths = float | tuple[float, ...]


class FilmProbe:
    """Traces bundles of rays from film points through a lens.

    Parameters
    ----------
    lens : Lens
    film_distance_mm : float
        Last vertex to film.
    wavelength_nm : float or tuple
        With several, rays pass that pass at any of them.
    frame : FilmFrame
        How the film stands; points in front of the last surface see no light.
    azimuth : (x, y)
        Unit vector: direction of the first axis of film points and points of the rear plane; the second is a quarter of
        a turn ahead.
    """

    def __init__(
        self,
        lens: Lens,
        film_distance_mm: float,
        wavelength_nm: Wavelengths,
        frame: FilmFrame = UNMOVED,
        azimuth: tuple[float, float] = (1.0, 0.0),
    ) -> None:
        if not np.isfinite(lens.surfaces[-1].semi_diameter):
            raise InputError(f"{lens.name}: the last surface needs a diameter")
        self.patch = _patch(lens.surfaces[-1], lens.sense)
        if not film_distance_mm > max(0.0, float(self.patch[:, 2].max())):
            raise InputError(
                f"{lens.name}: the film must stand behind the last surface "
                f"(got {film_distance_mm:g} mm from its vertex)"
            )
        self.lens = lens
        self.frame = frame
        self.azimuth = azimuth
        if not lens.surfaces[-1].is_rotational:
            self.patch[:, :2] = self.turned(self.patch[:, :2], back=True)
        self.distance = float(film_distance_mm)
        self.wavelength_nm, *self.others_nm = wavelength_nm if isinstance(wavelength_nm, tuple) else (wavelength_nm,)

    def turned(self, points: Array, *, back: bool = False) -> Array:
        """Return points (..., 2) of the probe's axes in those of the lens, or back."""
        c, s = self.azimuth
        if s == 0.0 and c == 1.0:
            return points
        x, y = points[..., 0], points[..., 1] * (-1.0 if back else 1.0)
        return np.stack([c * x - s * y, (s * x + c * y) * (-1.0 if back else 1.0)], axis=-1)

    def distances(self, film: Array) -> Array:
        """Return how far behind the last vertex film points (..., 2) lie [mm]."""
        if self.frame.is_flat:
            return np.full(film.shape[:-1], self.distance)
        return self.distance + self.frame.depth(self.turned(film))

    def windows(self, film: Array) -> Array:
        """Return boxes (m, 4) u0, u1, v0, v1 [mm] that hold every ray from film points (m, 2) to the last surface."""
        points = film[:1] if self.frame.is_flat else film
        distances = np.maximum(self.distances(points), _LEAST_GAP * self.distance + self.patch[:, 2].max())[:, None]
        scale = distances / (distances - self.patch[:, 2])
        crossing = film[:, None, :] * (1.0 - scale)[..., None] + self.patch[:, :2] * scale[..., None]
        low, high = crossing.min(axis=1), crossing.max(axis=1)
        ring = crossing[:, -(len(self.patch) // PATCH_RADII) :]
        if np.any(ring.min(axis=1) > low) or np.any(ring.max(axis=1) < high):  # a bulge beyond the rim
            middle, half = (low + high) / 2, (high - low) / 2 * (1.0 + BULGE)
            low, high = middle - half, middle + half
        if not self.lens.surfaces[-1].is_rotational:  # the rim bulges between the azimuths that were taken
            middle, half = (low + high) / 2, (high - low) / 2 / np.cos(np.pi / _PATCH_AZIMUTHS)
            low, high = middle - half, middle + half
        return boxes_of(low, high)

    def passes(self, film: Array, rear: Array) -> Mask:
        """Return which rays pass: film points (..., 2) through points (..., 2) of the plane of the last vertex."""
        film, rear = np.broadcast_arrays(film, rear)
        shape = rear.shape[:-1]
        distances = self.distances(film)
        origins = np.empty((*shape, 3))
        origins[..., :2] = self.turned(film)
        origins[..., 2] = self.lens.length + self.lens.sense * distances
        directions = np.empty((*shape, 3))
        directions[..., :2] = self.turned(rear - film)
        directions[..., 2] = -self.lens.sense * distances
        origins, directions = origins.reshape(-1, 3), directions.reshape(-1, 3)
        passed = passing(self.lens, origins, directions, self.wavelength_nm)
        for wavelength_nm in self.others_nm:
            dark = np.flatnonzero(~passed)
            passed[dark] = passing(self.lens, origins[dark], directions[dark], wavelength_nm)
        return passed.reshape(shape)

    def trace(self, film: Array, rear: Array) -> Rays:
        """Return the rays of a film point (2,) through points (n, 2) of the plane of the last vertex, in the scene."""
        targets = np.column_stack([rear, np.full(len(rear), self.lens.length)])
        start = np.array([*film, self.lens.film_z(self.distance)])
        return self.lens.trace(np.broadcast_to(start, targets.shape), targets - start, self.wavelength_nm)

    def reaches_lens(self, half_film_mm: tuple[float, float]) -> bool:
        """Return whether some corner of a film of such half sides stands in or in front of the last surface."""
        corners = self.frame.corners(half_film_mm)
        return bool(np.any(self.distance + corners[:, 2] <= max(0.0, float(self.patch[:, 2].max()))))


def _patch(surface: Surface, sense: float) -> Array:
    """Return points (n, 3) spread over the clear area of the last surface about its vertex, z towards the film."""
    azimuths = 4 if surface.is_rotational else _PATCH_AZIMUTHS
    angles = np.arange(azimuths) * 2 * np.pi / azimuths
    radii = np.linspace(0.0, surface.semi_diameter * (1 - 1e-12), PATCH_RADII)
    x, y = (np.outer(radii, turn(angles)).ravel() for turn in (np.cos, np.sin))
    if surface.region and np.isfinite(surface.region.radius) and surface.region.blocks:  # which holds the clear area
        share = surface.region.radius / surface.semi_diameter
        x, y = share * x + surface.region.centre[0], share * y + surface.region.centre[1]
    points = np.stack([x, y, surface.sag(x, y)])
    if surface.pose:
        points, _ = surface.pose.outward(points, points)
    return points.T * [1.0, 1.0, sense]


def boxes_of(low: Array, high: Array) -> Array:
    """Return boxes (m, 4) u0, u1, v0, v1 of their lower and upper corners (m, 2)."""
    return np.stack([low, high], axis=2).reshape(-1, 4)


def grid(boxes: Array, nu: int, nv: int) -> Array:
    """Return the centres (m, nu * nv, 2) of the cells of boxes (m, 4) u0, u1, v0, v1."""
    u = boxes[:, 0, None] + (boxes[:, 1] - boxes[:, 0])[:, None] * (np.arange(nu) + 0.5) / nu
    v = boxes[:, 2, None] + (boxes[:, 3] - boxes[:, 2])[:, None] * (np.arange(nv) + 0.5) / nv
    points = np.empty((len(boxes), nu, nv, 2))
    points[..., 0] = u[:, :, None]
    points[..., 1] = v[:, None, :]
    return points.reshape(len(boxes), nu * nv, 2)


def spread_points(boxes: Array, count: int) -> Array:
    """Return points (m, count, 2) spread over boxes (m, 4) more evenly than by chance (R2, Roberts 2018)."""
    share = (0.5 + np.arange(1, count + 1)[:, None] * np.array([0.7548776662466927, 0.5698402909980532])) % 1.0
    low, high = boxes[:, None, ::2], boxes[:, None, 1::2]
    return np.asarray(low + (high - low) * share)


def cells(boxes: Array, nu: int, nv: int) -> Array:
    """Return the size (m, 2) of the cells of boxes."""
    return np.stack([(boxes[:, 1] - boxes[:, 0]) / nu, (boxes[:, 3] - boxes[:, 2]) / nv], axis=1)


def narrow_boxes(probe: FilmProbe, film: Array, boxes: Array, shape: tuple[int, int]) -> tuple[Array, Mask]:
    """Return boxes round the rays of a grid that pass, widened by a cell, and which film points have any.

    Film points (m, 2) and boxes (m, 4) as in `FilmProbe.windows`; without a passing ray the box stays as it was.
    """
    points = grid(boxes, *shape)
    hits = probe.passes(film[:, None], points)
    return boxes_round(points, hits, cells(boxes, *shape), boxes)


def boxes_round(points: Array, hits: Mask, margin: Array, otherwise: Array) -> tuple[Array, Mask]:
    """Return boxes round those of points (m, n, 2) that are hits (m, n), a margin (m, 2) wider, and which have any."""
    low = np.where(hits[..., None], points, np.inf).min(axis=1) - margin
    high = np.where(hits[..., None], points, -np.inf).max(axis=1) + margin
    lit: Mask = np.asarray(np.any(hits, axis=1))
    return np.where(lit[:, None], boxes_of(low, high), otherwise), lit


# Boxes round the pupils that film points see: found even where they are much smaller than the rear element.

COARSE = (16, 16)
FINE = (32, 16)  # half of a pupil, at one film point
COLUMNS = (48, 128)  # of a grid over the window as fine as the first-order pupil: from how many it is tried, at most
NEAR = 1.0  # sizes of a pupil, round it, in which that of the next film point is sought


def narrowing_probes(
    lens: Lens,
    film_distance_mm: float,
    wavelength_nm: Wavelengths,
    frame: FilmFrame = UNMOVED,
    azimuth: tuple[float, float] = (1.0, 0.0),
) -> list[FilmProbe]:
    """Return probes of the lens with its stop ever smaller: first as wide as any rim, then half that, last its own.

    A small pupil slips through a grid over the rear element; the next wider one tells where to look for it.
    """
    stops = [lens]
    if lens.stop_index is not None:
        widest = max(surface.semi_diameter for surface in lens.surfaces if np.isfinite(surface.semi_diameter))
        while (radius := stops[0].surfaces[lens.stop_index].semi_diameter) < widest:
            stops.insert(0, lens.with_changes({lens.stop_index: {"semi_diameter": 2 * radius}}))
    return [FilmProbe(stopped, film_distance_mm, wavelength_nm, frame, azimuth) for stopped in stops]


def pupil_boxes(
    probes: list[FilmProbe],
    film: Array,
    shape: tuple[int, int] = COARSE,
    *,
    radial: bool = False,
    in_order: bool = False,
    soon: bool = False,
) -> tuple[Array, Mask]:
    """Return boxes (m, 4) round the pupil as seen from film points (m, 2), a cell wider, and where it is open.

    Film points along +x of a rotationally symmetric lens (`radial`) see pupils that are the same above as below, so
    that half of each is enough. Of film points `in_order` each is near the one before. ``soon`` seeks the pupils about
    their paraxial images, and only where one is not there from wider stops down.
    """
    if radial:
        shape = (shape[0], shape[1] // 2)
    if soon:
        boxes, lit = _sought_near(probes[-1], film, shape, radial)
        if lit.all():
            boxes[:, 2] = np.where(radial, -boxes[:, 3], boxes[:, 2])
            return boxes, lit
    boxes = upper(probes[-1].windows(film), radial)
    lit = np.ones(len(film), dtype=bool)
    for probe in (*probes, probes[-1]):
        boxes, hit = narrow_boxes(probe, film, boxes, shape)
        boxes = upper(boxes, radial)
        lit &= hit
    if not lit.all():
        boxes[~lit], lit[~lit] = _sought_near(probes[-1], film[~lit], shape, radial)
    if radial or in_order:
        _follow(probes[-1], film, boxes, lit, radial)
    for k in np.flatnonzero(~lit):
        box = _sought_finely(probes, film[k : k + 1], radial)
        if box is not None:
            boxes[k], lit[k] = box, True
    if radial:
        boxes[:, 2] = -boxes[:, 3]
    return boxes, lit


def _sought_near(probe: FilmProbe, film: Array, shape: tuple[int, int], radial: bool) -> tuple[Array, Mask]:
    """Return the boxes round the pupils of film points, sought about their paraxial images, and which are there."""
    near = upper(_paraxial_boxes(probe, film), radial)
    for _ in range(2):
        near, lit = narrow_boxes(probe, film, near, shape)
        near = upper(near, radial)
    return near, lit


def _sought_finely(probes: list[FilmProbe], film: Array, radial: bool) -> Array | None:
    """Return the box round the pupil of one film point (1, 2), None where it is closed or not small in the window.

    Close behind a lens whose rims cut the beam even the pupil of a wide stop slips through a coarse grid.
    """
    box, near = upper(probes[-1].windows(film), radial), _paraxial_boxes(probes[-1], film)
    columns = int(6 * (box[0, 1] - box[0, 0]) / (near[0, 1] - near[0, 0]))
    if columns < COLUMNS[0]:
        return None
    for number, probe in enumerate((*probes, probes[-1])):
        across = COARSE[0] if number else min(columns, COLUMNS[1])
        box, hit = narrow_boxes(probe, film, box, (across, across // 2 if radial else across))
        box = upper(box, radial)
        if not hit[0]:
            return None
    return np.asarray(box[0])


def _follow(probe: FilmProbe, film: Array, boxes: Array, lit: Mask, radial: bool) -> None:
    """Find pupils that slipped through, near those of the film points before: they shrink and move step by step."""
    for k in range(1, len(film)):
        if lit[k - 1] and not lit[k]:
            boxes[k], lit[k] = box_near(probe, film[k : k + 1], boxes[k - 1], radial=radial)


def box_near(
    probe: FilmProbe, film: Array, box: Array, *, radial: bool, shape: tuple[int, int] = FINE
) -> tuple[Array, bool]:
    """Return the box round the pupil seen from one film point (1, 2), sought near another one's, and if it is open."""
    width, height = NEAR * (box[1] - box[0]), box[3] if radial else NEAR * (box[3] - box[2])
    low, high = (0.0, (1.0 + NEAR) * height) if radial else (box[2] - height, box[3] + height)
    around = np.array([[box[0] - width, box[1] + width, low, high]])
    around, hit = narrow_boxes(probe, film, around, shape)
    return around[0], bool(hit[0])


def upper(boxes: Array, radial: bool) -> Array:
    """Return boxes without their lower halves."""
    if radial:
        boxes[:, 2] = 0.0
    return boxes


def _paraxial_boxes(probe: FilmProbe, film: Array) -> Array:
    """Return boxes (m, 4) thrice as large as the paraxial exit pupil, on the plane of the last vertex."""
    pupil = probe.lens.first_order(probe.wavelength_nm).exit_pupil
    distances = probe.distances(film)[:, None]
    from_film = distances - pupil.distance_mm
    if not np.all(np.isfinite(from_film) & (from_film != 0.0)):
        return probe.windows(film)
    shrink = distances / from_film
    centres, reach = film * (1.0 - shrink), 1.5 * abs(shrink) * pupil.diameter_mm
    low, high = centres - reach, centres + reach
    return boxes_of(low, high)
