"""The opening of a camera as points of its film see it: which directions light comes from.

Directions are cosines (l, m) in x and y of the lens's frame, true ones also off the axis: in them the field that an
opening diffracts onto the film is a Fourier integral.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import waves as wave_optics
from rptcam_cl.optics.beams import without_rims
from rptcam_cl.optics.film_probe import cells, grid, narrowing_probes, pupil_boxes
from rptcam_cl.optics.ghosts import with_wider_stop
from rptcam_cl.optics.lens import Lens, ThickLens
from rptcam_cl.optics.ray_trace import Rays, passing
from rptcam_cl.optics.surface import StopMask, StopShape
from rptcam_cl.rendering.cameras.lens_records import shaped
from rptcam_cl.rendering.cameras.model import CameraModel
from rptcam_cl.rendering.cameras.ray_map import allowed_px, fitted_map
from rptcam_cl.rendering.cameras.setting import LensSetting, film_frame
from rptcam_cl.scene.scene import Scene

# The rays that points of the film receive, in float64: what `kernels/camera` draws at random, on a grid.

Array = NDArray[np.float64]

ACROSS = 40  # rays across a pupil


@dataclass(frozen=True)
class PupilRays:
    """Rays of m film points, n each, in the camera's frame.

    Attributes
    ----------
    origins : (m, n, 3) array
        Where they leave the lens [m].
    slopes : (m, n, 2) array
        Sideways per metre ahead.
    weights : (m, n) array
        Their shares in the light of the film point; 0 for those that the lens blocks. A row sums to 1.
    pupil : (m, n, 2) array
        The point of the pupil as the camera's kernel chooses it: of the plane of the last vertex [mm] or a unit disk.
    cell : (m, 2) array
        How far these points stand apart.
    film : (m, 2) array
        The film points [mm]; zero where the pupil's coordinates do not depend on them.
    """

    origins: Array
    slopes: Array
    weights: Array
    pupil: Array
    cell: Array
    film: Array

    def seen(self, vergence: float) -> Array:
        """Return where rays meet the plane at 1 / vergence [m] in front of the eye, over that distance (m, n, 2)."""
        ahead = 1.0 + vergence * self.origins[..., 2:]
        return np.asarray(vergence * self.origins[..., :2] + ahead * self.slopes)


def film_points(scene: Scene, places: Array) -> Array:
    """Return places of the picture (n, 2) [pixels] on the film (n, 3) [mm], in the frame of the lens: it inverts."""
    film = 2.0 * np.asarray(places, np.float64) / scene.film.resolution - 1.0
    upright = film * (1.0, -1.0) * (1.0 if scene.camera.flip else -1.0)
    return film_frame(scene.camera).points(-upright * np.array(scene.film.size_m()) * 500.0)


def _unit_grid() -> Array:
    steps = (np.arange(ACROSS) + 0.5) * 2 / ACROSS - 1
    return np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)


def thin_lens_rays(
    scene: Scene, places: Array, radius_m: float, film_m: float, plane_m: float, shape: StopShape | StopMask | None
) -> PupilRays:
    """Return the rays of places of the picture (m, 2) [pixels] through a thin lens, by its radius and distances."""
    film = film_points(scene, places) * 1e-3 / film_m
    nearer = 1.0 + film[:, None, 2:]
    points = _unit_grid()
    x, y = points.T
    points = points[np.hypot(x, y) <= 1.0 if shape is None else shape.holds(x, y)]
    many = (len(film), len(points), 2)
    on_lens = np.broadcast_to(points * radius_m, many)
    vergence = 1.0 / plane_m + (1.0 - 1.0 / nearer) / film_m
    slopes = -film[:, None, :2] / nearer - on_lens * vergence
    origins = np.concatenate([on_lens, np.zeros((*many[:2], 1))], axis=-1)
    weights = np.full(many[:2], 1.0 / len(points))
    cell = np.full((len(film), 2), 2.0 / ACROSS)
    return PupilRays(origins, slopes, weights, np.broadcast_to(points, many), cell, np.zeros_like(film[:, :2]))


def thick_lens_rays(scene: Scene, places: Array, thick: ThickLens, first_vertex_m: float) -> PupilRays:
    """Return the rays of places of the picture (m, 2) [pixels] through a thick lens."""
    film_mm, normal = film_points(scene, places), np.array(film_frame(scene.camera).normal)
    points = _unit_grid()
    points = points[np.hypot(*points.T) <= 1.0]
    many = (len(film_mm), len(points), 2)
    depth, slope = film_mm[:, None, 2:], thick.film_slope
    nearer = 1.0 + depth * slope[0]
    there = (film_mm[:, None, :2] - depth * slope[1] * points) / nearer  # in the plane through the film's centre

    def together(factors: tuple[float, float]) -> Array:
        return np.asarray(factors[0] * there + factors[1] * points)

    z = np.full((*many[:2], 1), first_vertex_m)
    origins = np.concatenate([together(thick.height) * 1e-3, z], axis=-1)
    slopes = together(slope)
    facing = np.maximum(slopes @ normal[:2] + normal[2], 0.0)
    cos4 = (1.0 + np.sum(slopes**2, axis=-1)) ** -2 * facing
    cell = np.full((len(film_mm), 2), 2.0 / ACROSS)
    weights = cos4 / cos4.sum(axis=1, keepdims=True)
    film = np.zeros_like(film_mm[:, :2])
    return PupilRays(origins, together(thick.slope), weights, np.broadcast_to(points, many), cell, film)


def traced_lens_rays(scene: Scene, setting: LensSetting, places: Array) -> PupilRays:
    """Return the rays of places of the picture (m, 2) [pixels] through the surfaces of a lens.

    Raises
    ------
    InputError
        When a place receives no light.
    """
    points_mm, frame = film_points(scene, places), film_frame(scene.camera)
    film_mm, depths = points_mm[:, :2], points_mm[:, 2]
    lens, back, wavelength = shaped(scene, setting).lens, setting.film_distance_mm, setting.camera.wavelength_nm
    boxes, lit = pupil_boxes(narrowing_probes(lens, back, wavelength, frame), film_mm)
    if not lit.all():
        x, y = film_mm[~lit][0]
        raise InputError(f"{lens.name}: no light reaches the film point ({x:g}, {y:g}) mm")
    rear = grid(boxes, ACROSS, ACROSS)
    distances = np.broadcast_to((back + depths)[:, None, None], (*rear.shape[:2], 1))
    away = np.concatenate([rear - film_mm[:, None], -distances], axis=-1)
    film = np.broadcast_to(film_mm[:, None], rear.shape)
    origins, directions, passed = _through(scene, setting, lens, film, rear, distances)
    facing = np.maximum(-away @ np.array(frame.normal), 0.0) / distances[..., 0]
    weights = np.where(passed, np.sum(away * away, axis=-1) ** -2 * facing, 0.0)  # cos^4, as Z is the same
    weights /= weights.sum(axis=1, keepdims=True)
    keep = passed[..., None]
    origins = np.where(keep, (origins - [0.0, 0.0, lens.film_z(back)]) * 1e-3, 0.0)
    slopes = np.where(keep, directions[..., :2] / -np.where(keep, directions[..., 2:], -1.0), 0.0)
    return PupilRays(origins, slopes, weights, rear, cells(boxes, ACROSS, ACROSS), film_mm)


def _through(
    scene: Scene, setting: LensSetting, lens: Lens, film: Array, rear: Array, distances: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return where rays from film points through places of the plane of the last vertex (m, n, 2) leave the lens, their
    directions (m, n, 3), and which do, as the camera lets them: traced, or by polynomials."""
    shape, traced = (*rear.shape[:2], 3), setting.camera.traced_camera
    if traced is not None and traced.rays == "fitted":
        fitted = fitted_map(lens, setting, scene.film, None, allowed_px(traced.accuracy))
        flat = film.reshape(-1, 2), rear.reshape(-1, 2), np.zeros(film.size // 2)
        origins, directions = (values * (1.0, 1.0, -1.0) for values in fitted.trace(*flat))
        passed = fitted.passes(lens, *flat)
    else:
        start = np.concatenate([film, lens.length + lens.sense * distances], axis=-1)
        away = np.concatenate([rear - film, -lens.sense * distances], axis=-1)
        rays = lens.trace(start.reshape(-1, 3), away.reshape(-1, 3), setting.camera.wavelength_nm)
        origins, directions, passed = rays.origins, rays.directions, rays.passed
    return origins.reshape(shape), directions.reshape(shape), passed.reshape(shape[:2])


Mask = NDArray[np.bool_]

_NUDGE_MM = 1e-3  # by which a ray starts beside a point of the film, to see where that leads
_MET_MM = 1e-9  # of the film, within which a ray of a source is found
NEWTON = 12
_PUPIL_ACROSS = 144  # cells across the opening
_FIRST_ACROSS = 48  # of the search for it
WIDER = (64.0, 16.0, 4.0)  # times the stop, through which an opening is found that no direction of the search meets
FINER = 4  # points across a cell that the edge runs through
CORNERS = 1024  # of an outline
FINEST, ROUGH = 2.0**-24, 0.02  # of its widest, to which each is found; and of radii, within which a rough one is
_SAME_AREA = 0.02  # within which an outline and the cells inside it are one opening

OpenTo = Callable[..., Mask]
"""Finds which directions (n, 2), as cosines, are open to a point of the film, or each to a point (n, 2) of its own."""


@dataclass(frozen=True)
class Arrivals:
    """Rays of a point of the scene that reach the film in given directions, as if no rim stopped them.

    Attributes
    ----------
    places : (n, 2) array
        Where they meet the film [mm].
    path_mm : (n,) array
        Optical path to the foot of the perpendicular from a common point of the film, but for a constant.
    density : (n,) array
        Flux of an even source per unit of direction cosines, to a common factor; nan where no ray is found.
    """

    places: Array
    path_mm: Array
    density: Array


_Arrive = Callable[[Array, Array, float, Array], Arrivals]
"""Of a film point [mm], a source [mm] in the frame of the lens, a wavelength [nm] and directions (n, n, 2)."""


@dataclass(frozen=True)
class FilmPupil:
    """The opening as one point of the film sees it, on a square grid.

    Attributes
    ----------
    coverage : (n, n) array
        Share of each cell that is open; rows by m, columns by l.
    cosines_x, cosines_y : (n,) arrays
        l of the columns and m of the rows.
    index : float
        Of the medium in front of the film.
    """

    coverage: Array
    cosines_x: Array
    cosines_y: Array
    index: float

    @property
    def step(self) -> float:
        """Side of a cell in direction cosines."""
        return float(self.cosines_x[1] - self.cosines_x[0])

    @property
    def aperture(self) -> float:
        """Numerical aperture of the round opening of the same area, in the medium."""
        return float(np.sqrt(self.coverage.sum() / np.pi)) * self.step


@dataclass(frozen=True)
class FilmPupils:
    """What gives the opening that a point of the film (x, y) sees [mm], in the frame of the lens.

    Attributes
    ----------
    directions : callable
        Gives which directions are open to a point, and the middle and half width of a square of cosines about them.
    index : float
        Of the medium in front of the film.
    radius_mm : float
        Of the stop: of the circle that its shape touches.
    arrive : callable
        Gives the rays of a point of the scene that reach the film about a point.
    pupil_mm : float
        How far before the film the exit pupil is; negative behind it.
    power : int
        Of the cosine by which what light of each direction cosine counts for the film goes.
    """

    directions: Callable[[Array], tuple[OpenTo, Array]]
    index: float
    radius_mm: float
    arrive: _Arrive
    pupil_mm: float
    power: int = 0

    def __call__(self, point: Array, across: int = _PUPIL_ACROSS) -> FilmPupil:
        """Return the opening as a grid of so many cells each way.

        Raises
        ------
        InputError
            Where no light reaches the film.
        """
        return _pupil(*self.directions(point), self.index, across)

    def brightness(self, point: Array, across: int = _FIRST_ACROSS) -> float:
        """Return the film's value there for even light, to a common factor; raises as the opening does."""
        seen = self(point, across)
        square = 1 - seen.cosines_x**2 - seen.cosines_y[:, None] ** 2
        return float((seen.coverage * np.maximum(square, 1e-9) ** (self.power / 2)).sum() * seen.step**2)

    def outline(self, point: Array) -> Array | None:
        """Return corners (n, 2) of the outline in direction cosines, anticlockwise about its middle, within 1e-6.

        None where a line from the middle crosses the outline twice, as in a mask of several holes.
        """
        opens, box = self.directions(point)
        grid = _pupil(opens, box, self.index)
        share = grid.coverage / grid.coverage.sum()
        middle = np.array([share.sum(axis=0) @ grid.cosines_x, share.sum(axis=1) @ grid.cosines_y])
        corners = _corners(opens, middle, CORNERS, (0.0, grid.step * _PUPIL_ACROSS * np.sqrt(2)), FINEST)
        x, y = (corners - middle).T
        area = 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
        return None if abs(area / (grid.coverage.sum() * grid.step**2) - 1) > _SAME_AREA else corners

    def rough_outline(self, point: Array) -> Array | None:
        """Return a quarter of these corners, within a thousandth of its radius, of an opening without several holes.

        None where no light comes from.
        """
        opens, box = self.directions(point)
        for _ in range(2):
            inside = _open_directions(opens, box)
            if not len(inside):
                return None
            box = _about(inside, box)
        widest = 2 * np.sqrt(2) * float(box[1, 0])
        return _corners(opens, inside.mean(axis=0), CORNERS // 4, (0.0, widest), 2.0**-12)

    def finer_outline(self, point: Array, rough: Array) -> Array:
        """Return the corners that `outline` does, by those of `rough_outline`."""
        middle = rough.mean(axis=0)
        x, y = (rough - middle).T
        order, angles = np.argsort(np.arctan2(y, x)), _turns(CORNERS)
        radii = np.interp(angles, np.arctan2(y, x)[order], np.hypot(x, y)[order], period=2 * np.pi)
        near, far = radii * (1 - ROUGH), radii * (1 + ROUGH)
        return _corners(self.directions(point)[0], middle, CORNERS, (near, far), 8 * FINEST)


def _turns(count: int) -> Array:
    return 2 * np.pi * (np.arange(count) + 0.5) / count


def _corners(opens: OpenTo, middle: Array, count: int, ends: tuple[Array | float, Array | float], part: float) -> Array:
    """Return so many corners (n, 2) of an opening, each between two radii, or beyond these, to a part of the widest."""
    angles = _turns(count)
    towards = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    near, far = (np.broadcast_to(radius, count) for radius in ends)
    widest = 2.0 * float(far.max())
    if near.any():
        near = np.where(opens(middle + near[:, None] * towards), near, 0.0)
        far = np.where(opens(middle + far[:, None] * towards), widest, far)
    while (far - near).max() > 0.75 * part * widest:
        half = (near + far) / 2
        open_there = opens(middle + half[:, None] * towards)
        near, far = np.where(open_there, half, near), np.where(open_there, far, half)
    return np.asarray(middle + near[:, None] * towards)


def traced_pupils(setting: LensSetting) -> FilmPupils:
    """Return the openings of a lens with its stop in shape, by rays traced from the film."""
    lens, wavelength = setting.lens, setting.camera.wavelength_nm
    if not any(np.isfinite(lens.first_order(wavelength, section).focal_length_mm) for section in "xy"):
        raise InputError(f"camera.diffraction: {lens.name}: is afocal, so it forms no image (allowed: off)")
    film_z = lens.film_z(setting.film_distance_mm)
    rear = lens.surfaces[-1].semi_diameter

    def seen(point: Array) -> tuple[OpenTo, Array]:
        origin = np.array([point[0], point[1], film_z])

        def opens_through(stopped: Lens) -> OpenTo:
            def opens(cosines: Array, places: Array | None = None) -> Mask:
                inside, directions = _backwards(lens, cosines)
                origins = np.empty_like(directions)
                origins[:, :2], origins[:, 2] = point if places is None else places, film_z
                return np.asarray(inside & passing(stopped, origins, directions, wavelength))

            return opens

        opens, box = opens_through(lens), _rear_box(lens, origin, rear)
        for factor in WIDER if lens.stop_index is not None and not len(_open_directions(opens, box)) else ():
            wider = _open_directions(opens_through(with_wider_stop(lens, factor)), box)
            if not len(wider):
                break
            box = _about(wider, box)
        return opens, box

    stop = lens.stop or lens.surfaces[0]
    index = float(lens.indices(wavelength)[-1])
    away = lens.sense * (film_z - lens.film_z(lens.first_order(wavelength).exit_pupil.distance_mm))
    arrive = partial(_traced_arrivals, without_rims(lens), film_z)
    return FilmPupils(seen, index, float(stop.semi_diameter), arrive, float(away) or np.inf)


def _backwards(lens: Lens, cosines: Array) -> tuple[Mask, Array]:
    """Return which cosines (n, 2) are directions of light, and these turned towards the scene (n, 3)."""
    square = np.sum(cosines * cosines, axis=1)
    inside = np.asarray(square < 1)
    return inside, np.column_stack([-cosines, -lens.sense * np.sqrt(np.where(inside, 1 - square, 1.0))])


def _traced_arrivals(lens: Lens, film_z: float, point: Array, source: Array, nm: float, cosines: Array) -> Arrivals:
    """Return the rays of a source that leave a lens without rims in some directions (n, n, 2).

    Traced from the film; where each starts there is found by Newton's iteration, until it meets the source.
    """
    flat = cosines.reshape(-1, 2)
    inside, back = _backwards(lens, flat)
    places = np.tile(np.asarray(point, np.float64), (len(flat), 1))

    def trace(starts: Array, ways: Array) -> tuple[Rays, Array]:
        rays = lens.trace(np.column_stack([starts, np.full(len(starts), film_z)]), ways, nm)
        with np.errstate(all="ignore"):
            along = (source[2] - rays.origins[:, 2]) / rays.directions[:, 2]
        there = rays.origins[:, :2] + along[:, None] * rays.directions[:, :2]
        return rays, np.where(rays.passed[:, None], there, np.nan)

    middle = int(np.argmin(np.sum((flat - flat.mean(axis=0)) ** 2, axis=1)))
    moved = np.asarray(point) + _NUDGE_MM * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    _, there = trace(moved, np.repeat(back[middle : middle + 1], 3, axis=0))
    try:
        inverse = np.linalg.inv((there[1:] - there[0]).T / _NUDGE_MM)
    except np.linalg.LinAlgError:
        inverse = np.full((2, 2), np.nan)
    for _ in range(NEWTON):
        rays, there = trace(places, back)
        step = (source[:2] - there) @ inverse.T
        if not np.nanmax(np.abs(step), initial=0.0) > _MET_MM:
            break
        places = places + np.where(np.isfinite(step), step, 0.0)
    met = inside & rays.passed & (np.abs(step).max(axis=1, initial=0.0) < 1e3 * _MET_MM)
    to_source = source - rays.origins
    path = rays.optical_path + lens.indices(nm)[0] * np.einsum("ij,ij->i", to_source, rays.directions)
    path += lens.indices(nm)[-1] * np.einsum("ij,ij->i", point - places, -back[:, :2])
    front = rays.origins - (rays.origins[:, 2] / rays.directions[:, 2])[:, None] * rays.directions
    plane = np.where(met[:, None], front[:, :2], np.nan).reshape(cosines.shape)
    axes = cosines[:, 0, 1], cosines[0, :, 0]
    (xm, xl), (ym, yl) = (np.gradient(plane[..., axis], *axes, edge_order=2) for axis in (0, 1))
    area = np.abs(xl * ym - xm * yl).ravel()
    reach = np.hypot(np.linalg.norm(source - front, axis=1), 1e-9)
    density = area * np.abs(rays.directions[:, 2]) * (abs(source[2]) / reach) ** 2
    return Arrivals(places, path, np.where(met, density, np.nan))


def _rear_box(lens: Lens, origin: Array, rear: float) -> Array:
    """Return the middle and half width of a square of cosines that holds every ray through the rear surface."""
    turns = np.linspace(0.0, 2 * np.pi, 65)
    edge = rear * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    depths = lens.length + np.linspace(0.0, lens.surfaces[-1].rim_sag(rear * (1 - 1e-9)), 3)
    to_film = np.concatenate([np.column_stack([origin[:2] - edge, np.full(len(edge), origin[2] - z)]) for z in depths])
    return _square_about(to_film[:, :2] / np.linalg.norm(to_film, axis=1)[:, None], 1.02)


def _square_about(cosines: Array, room: float = 1.0, step: float = 0.0) -> Array:
    """Return the middle and half width of a square about directions, with room of a factor and a step."""
    low, high = cosines.min(axis=0) - step, cosines.max(axis=0) + step
    return np.stack([(low + high) / 2, np.full(2, float((high - low).max()) / 2 * room)])


def flat_pupils(
    slopes: tuple[float, float],
    shape: StopShape | StopMask | None,
    sense: float,
    index: float,
    radius_mm: float,
    ahead: tuple[Callable[[float], tuple[float, float]], int],
) -> FilmPupils:
    """Return the openings of an ideal lens: its pupil is a disk across the axis.

    Parameters
    ----------
    slopes
        Sideways per unit of the axis, for a film point [mm] and for the edge of the pupil.
    sense
        1 where the slopes are those towards the pupil, and light has the opposite ones.
    index, radius_mm
        As in `FilmPupils`.
    ahead
        What gives, for a plane at z in the frame of the lens [mm], where rays meet it: factors of the film point [mm]
        and of the pupil's; and the power of the cosine by which the light per direction cosines goes.
    """

    def seen(point: Array) -> tuple[OpenTo, Array]:
        middle = slopes[0] * np.asarray(point, dtype=np.float64)

        def opens(cosines: Array, places: Array | None = None) -> Mask:
            square = np.sum(cosines * cosines, axis=1)
            towards = -sense * cosines / np.sqrt(np.where(square < 1, 1 - square, 1.0))[:, None]
            x, y = ((towards - (middle if places is None else slopes[0] * places)) / slopes[1]).T
            inside = (square < 1) & (x * x + y * y <= 1)
            return np.asarray(inside if shape is None else inside & shape.holds(x, y))

        turns = np.linspace(0.0, 2 * np.pi, 65)
        edge = middle + abs(slopes[1]) * np.stack([np.cos(turns), np.sin(turns)], axis=1)
        return opens, _square_about(-sense * edge / np.sqrt(1 + np.sum(edge * edge, axis=1))[:, None], 1.02)

    def arrive(point: Array, source: Array, nm: float, cosines: Array) -> Arrivals:
        """A perfect lens: all rays of the source meet in one point, C + t (slope) of the film point that sees it."""
        flat = cosines.reshape(-1, 2)
        per_film, per_pupil = ahead[0](float(source[2]))
        at, drift = source[:2] / per_film, -per_pupil / per_film  # a film point is at + drift times the pupil's
        square = np.sum(flat * flat, axis=1)
        cosine = np.sqrt(np.where(square < 1, 1 - square, 1.0))
        towards = -sense * flat / cosine[:, None]
        pupil = (towards - slopes[0] * at) / (slopes[1] + slopes[0] * drift)
        places = at + drift * pupil
        t = -drift / (slopes[1] + slopes[0] * drift)  # towards the pupil, where `places + t towards` is the same point
        image = np.append(at + t * slopes[0] * at, t) - np.append(point, 0.0)
        path = -index * (flat @ image[:2] - sense * cosine * image[2])
        return Arrivals(places, path, np.where(square < 1, cosine ** ahead[1], np.nan))

    return FilmPupils(seen, index, radius_mm, arrive, -sense / slopes[0] if slopes[0] else np.inf, ahead[1])


def _pupil(opens: OpenTo, box: Array, index: float, across: int = _PUPIL_ACROSS) -> FilmPupil:
    """Return the opening that lies within a box (middle, half width) of cosines."""
    for _ in range(4):  # a small opening behind a large rear surface is found step by step
        inside, before = _open_directions(opens, box), box
        if not len(inside):
            raise InputError("camera.diffraction: no light reaches the film there (allowed: off, or a smaller film)")
        box = _about(inside, before)
        if not box[1, 0] < 0.7 * before[1, 0]:
            break
    x, y = _axes(box, across)
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    within = ((np.arange(FINER) + 0.5) / FINER - 0.5) * (x[1] - x[0])
    moves = np.stack(np.meshgrid(within, within), axis=-1).reshape(-1, 2)
    centre = opens(grid.reshape(-1, 2)).reshape(across, across)
    edge = by_an_edge(centre)
    coverage = centre.astype(np.float64)
    coverage[edge] = np.mean([opens(grid[edge] + move) for move in moves], axis=0)
    return FilmPupil(coverage, x, y, index)


def _open_directions(opens: OpenTo, box: Array) -> Array:
    """Return those of some directions (n, 2) over a box that are open."""
    points = np.stack(np.meshgrid(*_axes(box, _FIRST_ACROSS)), axis=-1).reshape(-1, 2)
    return np.asarray(points[opens(points)])


def _about(inside: Array, box: Array) -> Array:
    """Return the box about directions that `_open_directions` returns, with room of a step."""
    x, _ = _axes(box, _FIRST_ACROSS)
    return _square_about(inside, step=float(x[1] - x[0]))


def _axes(box: Array, count: int) -> tuple[Array, Array]:
    offsets = ((np.arange(count) + 0.5) / count * 2 - 1) * box[1, 0]
    return box[0, 0] + offsets, box[0, 1] + offsets


def by_an_edge(inside: Mask) -> Mask:
    """Return which cells touch one that differs; outside of the grid nothing is open."""
    return wave_optics.by_an_edge(np.pad(inside, 1))[1:-1, 1:-1]


# Half pupils: the line that parts the pupil into two halves of equal light, as a zone of the picture sees it.

Split = Literal["x", "y"]


@dataclass(frozen=True)
class PupilLine:
    """A line across the pupil, in the coordinates in which the camera's kernel chooses a point of it.

    Attributes
    ----------
    normal : (x, y)
        Unit vector across the line.
    offset : float
        Points q and film points f [mm] with ``normal . (q + share * f) > offset`` lie beyond it.
    share : float
        How far the line moves against the film point, so that it stays in the middle of the pupil.
    """

    normal: tuple[float, float]
    offset: float
    share: float

    def beyond(self, rays: PupilRays) -> Array:
        """Return which share (m, n) of the cell of the pupil that each ray stands for lies beyond the line."""
        normal = np.array(self.normal)
        place = (rays.pupil + self.share * rays.film[:, None]) @ normal - self.offset
        width = rays.cell @ np.abs(normal)
        return np.asarray(np.clip(0.5 + place / width[:, None], 0.0, 1.0))


def pupil_line(rays: PupilRays, split: Split) -> PupilLine:
    """Return the line through the middle of the light that a zone receives.

    Parameters
    ----------
    rays
        Of the middle of the zone, first, and of places round it.
    split
        ``x``: a left and a right half; ``y``: a lower and an upper one.
    """
    axis = ("x", "y").index(split)
    normal = (1.0, 0.0) if split == "x" else (0.0, 1.0)
    middle = np.sum(rays.weights[..., None] * rays.pupil, axis=1)[:, axis]
    away = rays.film[1:, axis] - rays.film[0, axis]
    share = -float(away @ (middle[1:] - middle[0]) / (away @ away)) if away.any() else 0.0
    return PupilLine(normal, float(middle[0] + share * rays.film[0, axis]), share)


def halved(model: CameraModel, line: PupilLine, *, beyond: bool) -> CameraModel:
    """Return a camera that lets only the light of one half of its pupil count."""
    record = model.record.copy()
    record["half_pupil"] = (*line.normal, line.offset, line.share, beyond)
    return replace(model, record=record, facts=model.facts | {"HALF_PUPIL": 1})


# What the halves of a pupil do to the picture of a plane at any distance, by exact rays.

_CLEAREST_TRIALS, _CLEAREST_ROUNDS = 17, 3  # of the search for the greatest contrast
STEP = 12.0  # pixels to the places round the middle of a zone that tell the plane's scale


def places_round(middle: tuple[float, float]) -> Array:
    """Return the places (5, 2) [pixels] whose rays a view needs: its middle, right, left, below, above."""
    return np.array(middle) + STEP * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])


@dataclass(frozen=True)
class HalfView:
    """Two halves of the pupil, seen from the middle of a zone in one focus state.

    Attributes
    ----------
    rays : PupilRays
        Of the places of `places_round`.
    split : "x" or "y"
    """

    rays: PupilRays
    split: Split

    @cached_property
    def line(self) -> PupilLine:
        """The line across the pupil that parts it into halves of equal light."""
        return pupil_line(self.rays, self.split)

    @property
    def axis(self) -> int:
        """Along which the halves lie apart: 0 across, 1 down."""
        return 0 if self.split == "x" else 1

    @cached_property
    def _weights(self) -> Array:
        """The weights (n,) of the rays from the middle that pass."""
        weights = self.rays.weights[0]
        return np.asarray(weights[weights > 0])

    @cached_property
    def _lines(self) -> tuple[Array, Array, Array, Array]:
        """Constant and slope, over the vergence, of where rays meet a plane (n, 2) and of its scale (2, 2)."""
        at, along = self.rays.seen(0.0), self.rays.seen(1.0)
        means = [np.einsum("mn,mnk->mk", self.rays.weights, places) for places in (at, along - at)]
        scales = [np.stack([mean[1] - mean[2], mean[3] - mean[4]], axis=1) / (2 * STEP) for mean in means]
        open_ = self.rays.weights[0] > 0
        return (at[0] - means[0][0])[open_], (along[0] - at[0] - means[1][0])[open_], *scales

    @cached_property
    def shares(self) -> Array:
        """The weights (2, n) of the rays of the half before the line and of that beyond it; each sums to 1."""
        beyond = self.line.beyond(self.rays)[0]
        weights = (self.rays.weights[0] * np.stack([1 - beyond, beyond]))[:, self.rays.weights[0] > 0]
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))

    def offsets(self, vergence: float) -> Array:
        """Return x (n, 2) of the rays that pass [pixels], for the plane at 1 / vergence [m] from the eye."""
        at, along, scale, scale_along = self._lines
        return np.asarray((at + vergence * along) @ np.linalg.inv(scale + vergence * scale_along).T)

    def displacement(self, vergence: float) -> float:
        """Return how far the picture beyond the line lies from that before it, along the split [pixels]."""
        before, beyond = self.shares @ self.offsets(vergence)
        return float((before - beyond)[self.axis])

    @property
    def nearest(self) -> float:
        """The vergence of planes that lie safely in front of the lens [1/m]."""
        ahead = -float(self.rays.origins[..., 2].min())
        return 0.8 / ahead if ahead > 0 else np.inf

    def sharpest(self) -> float:
        """Return the vergence at which the rays of the whole pupil spread least over a plane [1/m]."""
        at, along = self._lines[:2]
        weights = self._weights[:, None]
        return -float(np.sum(weights * at * along) / np.sum(weights * along * along))

    def clearest(self, cycles: float) -> float:
        """Return the vergence at which details of so many cycles per pixel keep most contrast, across and down [1/m].

        With spherical aberration a small core in a wide halo shows them better than the least spot does.
        """
        middle, weights = self.sharpest(), self._weights

        def lost(vergence: float) -> float:
            waves = np.exp(2j * np.pi * cycles * self.offsets(vergence))
            return -float(np.abs(weights @ waves).sum())

        # from the least spot to where defocus alone blurs by two periods
        aberrated = self.offsets(middle)
        defocused = (self.offsets(middle + 1e-3) - aberrated) / 1e-3
        blur, per_vergence = (float(np.sqrt(weights @ np.sum(each**2, axis=1))) for each in (aberrated, defocused))
        reach = 2.0 * max(1.0 / cycles, blur) / per_vergence
        trials = middle + reach * np.linspace(-1, 1, _CLEAREST_TRIALS)
        for _ in range(_CLEAREST_ROUNDS):
            best = trials[int(np.argmin([lost(trial) for trial in trials]))]
            step = trials[1] - trials[0]
            trials = best + step * np.linspace(-1, 1, _CLEAREST_TRIALS)
        return float(best)

    def sharpest_along(self) -> tuple[float, float]:
        """Return the vergences at which the rays spread least across and least down [1/m]: apart by astigmatism."""
        at, along = self._lines[:2]
        weights = self._weights[:, None]
        across, down = -np.sum(weights * at * along, axis=0) / np.sum(weights * along * along, axis=0)
        return float(across), float(down)
