"""What every camera model hands to the device: rays, blur, film, timing and exposure."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import field, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LUMENS_PER_WATT
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import CAMERA, DISPERSION_NM, SURFACE, VIEW, PupilKind
from rptcam_cl.optics.best_focus import blur_variances
from rptcam_cl.optics.film_probe import UNMOVED, FilmFrame
from rptcam_cl.optics.lens import FirstOrder, Lens, ThickLens
from rptcam_cl.optics.ray_trace import passed_rays
from rptcam_cl.optics.surface import StopMask, StopShape
from rptcam_cl.rendering.cameras import setting as settings
from rptcam_cl.rendering.cameras.pupil import content_of
from rptcam_cl.rendering.cameras.setting import CameraMetadata, EntrancePupil, Intrinsics, LensSetting, half_film_mm
from rptcam_cl.scene.base import FLOAT32_MAX, FLOAT32_MIN_NORMAL
from rptcam_cl.scene.camera import CameraKind, pose_matrix
from rptcam_cl.scene.exposure import Exposure, Shutter
from rptcam_cl.scene.film import Film, FilmFilter
from rptcam_cl.scene.placement import moments
from rptcam_cl.scene.scene import Scene

#
# The circle of confusion: how wide the camera blurs a point, by where it is seen and how far away it is.
#
# The diameter is that of the evenly lit disk whose light spreads as much (mean square distance) as that of the point;
# a uniform round pupil out of focus makes exactly that disk. With u = 1 / distance it is, in pixels, sqrt(a + b (u -
# focus) + c (u - focus)^2) / |scale + shift u|: a perfect lens has c alone, and the denominator tells how the
# magnification depends on the distance when that is not counted from the entrance pupil.

Array = NDArray[np.float64]

_BLUR_NODES = 11  # across and down the film
# Of a tilted film, whose blur vanishes along a line: squares of it lie between nodes linearly, so that its least value
# is what the tilt makes of half a step.
_FINE_NODES = 129
FAR_FOCAL_LENGTHS = 25.0  # distance that the table is fitted at when the focus lies at infinity


@dataclass(frozen=True)
class Blur:
    """What `kernels/integrator/layers.h` reads.

    Attributes
    ----------
    table : (rows, columns, 4) array
        a, b, c [pixels^2, with u in 1/m] at points of the film, spread evenly from edge to edge; the last is unused.
    focus : float
        Vergence that a, b and c stand for [1/m].
    scale, shift : float
        Of the denominator [1, m].
    origin_z : float
        Where distances count from, on the axis in the camera's frame [m].
    by_depth : bool
        Whether distances are depths along the axis; otherwise they run along the ray.
    """

    table: NDArray[np.float32] = field(default_factory=lambda: np.zeros((1, 1, 4), np.float32))
    focus: float = 0.0
    scale: float = 1.0
    shift: float = 0.0
    origin_z: float = 0.0
    by_depth: bool = True


def film_depths(scene: Scene) -> Array:
    """Return how far behind the film distance nodes of the film lie (rows, columns) [mm]; one node where all agree."""
    frame = settings.film_frame(scene.camera)
    if frame.is_flat:
        return np.zeros((1, 1))
    return frame.depth(frame.grid(half_film_mm(scene), _FINE_NODES))


def perfect_blur(gains: Array, focuses: Array, *, shift: float = 0.0, origin_z: float = 0.0) -> Blur:
    """Return the blur of a lens without aberrations; the other parameters as in `Blur`.

    Parameters
    ----------
    gains, focuses
        At nodes of the film (rows, columns): diameter [pixels] per vergence away from the focus [1/m], and the vergence
        that is sharp there [1/m].
    """
    focus = float(focuses.mean())
    square, away = np.square(gains), focuses - focus
    table = np.stack([square * away**2, -2.0 * square * away, square, np.zeros_like(square)], axis=-1)
    return Blur(table.astype(np.float32), focus, 1.0, shift, origin_z)


def thin_lens_blur(scene: Scene, gain: float, focus: float, film_distance_m: float) -> Blur:
    """Return the circle of confusion: a film point farther back has its plane of focus nearer, and a longer lever."""
    nearer = 1.0 + film_depths(scene) * 1e-3 / film_distance_m
    return perfect_blur(gain * nearer, focus + (1.0 - 1.0 / nearer) / film_distance_m)


def thick_lens_blur(thick: ThickLens, scene: Scene, first_vertex_m: float) -> Blur:
    """Return the circle of confusion: where a point is seen, its rays spread over the film as the pupil's points do.

    A point x at a distance D from the first vertex belongs to film points h with x = (height + D slope) (h, p). A film
    point farther back sees a point p of the pupil through h' = (h - depth film_slope p) / (1 + depth film_slope h).
    """
    film = scene.film
    width_m, height_m = film.size_m()
    pixels_per_mm = math.sqrt(film.resolution[0] / width_m * film.resolution[1] / height_m) * 1e-3
    (at, across), (turn, spread) = thick.height, thick.slope
    depths = film_depths(scene)
    nearer = 1.0 + depths * thick.film_slope[0]
    moved = depths * thick.film_slope[1] / nearer
    across_there, spread_there = across - moved * at, spread - moved * turn
    gains = 2 * pixels_per_mm * np.abs(across_there / turn * nearer) * 1e-3
    focuses = -spread_there / across_there * 1e3
    return perfect_blur(gains, focuses, shift=at / turn * 1e-3, origin_z=first_vertex_m)


def traced_blur(
    lens: Lens,
    film_distance_mm: float,
    focus_distance_mm: float | None,
    half_film_mm: tuple[float, float],
    pixels_per_mm: tuple[float, float],
    wavelength_nm: float,
    frame: FilmFrame = UNMOVED,
) -> Blur:
    """Return the blur of a lens by exact rays at three distances: infinity, the focus, and twice nearer.

    Parameters
    ----------
    focus_distance_mm
        Object plane in focus to film; None when no object is sharp.
    """
    length = lens.film_z(film_distance_mm)
    first = lens.first_order(wavelength_nm)
    focus, step = 0.0, 1.0 / (FAR_FOCAL_LENGTHS * min(abs(first.focal_length_mm), 1e9))
    if focus_distance_mm is not None and length < focus_distance_mm < 1.0 / step:
        focus = step = 1.0 / (focus_distance_mm - length)
    vergences: Array = step * np.arange(3, dtype=np.float64)
    pupil_mm = first.entrance_pupil.distance_mm
    scale, shift = (1.0, pupil_mm) if np.isfinite(pupil_mm) else (0.0, 1.0)
    variances, lit = _variances(lens, film_distance_mm, half_film_mm, vergences, wavelength_nm, frame)
    square = 8.0 * variances @ np.square(pixels_per_mm) * (scale + shift * vergences) ** 2
    square = _fill_dark(square, lit)
    away = vergences - focus
    coefficients = square @ np.linalg.inv(np.vander(away, 3, increasing=True)).T * np.array([1.0, 1e-3, 1e-6])
    if not frame.is_flat and lit.all():
        coefficients = _finer(coefficients)
    table = np.concatenate([coefficients, np.zeros((*coefficients.shape[:2], 1))], axis=-1).astype(np.float32)
    return Blur(table, focus * 1e3, scale, shift * 1e-3, -length * 1e-3, by_depth=False)


def _finer(values: Array) -> Array:
    """Return values (NODES, NODES, n) at more nodes, by the cubics through the nearest four along each axis."""
    places = np.linspace(0, _BLUR_NODES - 1, _FINE_NODES)
    first = np.clip(np.floor(places).astype(np.intp) - 1, 0, _BLUR_NODES - 4)
    weights = np.zeros((_FINE_NODES, _BLUR_NODES))
    for node in range(4):
        others = [other for other in range(4) if other != node]
        factors = [(places - first - other) / (node - other) for other in others]
        weights[np.arange(_FINE_NODES), first + node] = np.prod(factors, axis=0)
    return np.asarray(np.einsum("ri,ijn,cj->rcn", weights, values, weights))


def _variances(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    vergences: Array,
    wavelength_nm: float,
    frame: FilmFrame,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the variances (rows, columns, vergences, 2) and which nodes are lit; by a quarter for a round lens."""
    symmetric = lens.is_rotational and not frame.is_moved
    count = _BLUR_NODES // 2 + 1 if symmetric else _BLUR_NODES
    film = frame.grid(half_film_mm, _BLUR_NODES)[-count:, -count:].reshape(-1, 2)
    variances, lit = blur_variances(lens, film_distance_mm, film, vergences, wavelength_nm, frame)
    variances, lit = variances.reshape(count, count, len(vergences), 2), lit.reshape(count, count)
    if symmetric:
        mirror = np.abs(np.arange(_BLUR_NODES) - _BLUR_NODES // 2)
        return variances[np.ix_(mirror, mirror)], lit[np.ix_(mirror, mirror)]
    return variances, lit


def _fill_dark(values: Array, lit: NDArray[np.bool_]) -> Array:
    """Return the values (rows, columns, n) with dark nodes taking those of the nearest lit one."""
    if lit.all() or not lit.any():
        return values
    nodes = np.argwhere(lit)
    filled = values.copy()
    for dark in np.argwhere(~lit):
        filled[tuple(dark)] = values[tuple(nodes[np.argmin(np.sum((nodes - dark) ** 2, axis=1))])]
    return filled


#
# Where the light of a point of the scene goes: through places of the pupil to points of the film, in float64.
#
# Both in the coordinates of the camera's kernel: the pupil as `kernels/lens/pupil.h` or a unit disk, the film in
# millimetres or tangents.

WIDER = 1.6  # than the paraxial entrance pupil is where the true one is looked for
COARSE = 14  # rays across it
NEAR = (2, 2)  # low and high, across and down


@dataclass(frozen=True)
class Reached:
    """Rays of n points, m each.

    Attributes
    ----------
    film, pupil : (n, m, 2) arrays
        Where they meet the film and the pupil.
    entry : (n, m, 2) array
        Where they enter the camera [m], in its frame, in the plane of `LampReach.entry_z_m`.
    passed : (n, m) array
        Which the lens lets through.
    """

    film: Array
    pupil: Array
    entry: Array
    passed: NDArray[np.bool_]

    def of(self, points: Sequence[int] | NDArray[np.intp]) -> Reached:
        """Return those of some of the points."""
        rows = np.asarray(points)
        return Reached(self.film[rows], self.pupil[rows], self.entry[rows], self.passed[rows])


@dataclass(frozen=True)
class LampReach:
    """How a camera sees points of the scene.

    Attributes
    ----------
    rays : callable
        Takes points (n, 3) in the camera's frame [m], how many rays across the pupil, a wavelength [nm] or None for
        that of the camera, and what ``near`` returns of them; returns what they reach.
    film_scale : (float, float)
        Film coordinates of the right and the upper edge of the upright picture.
    entry_z_m : float
        Where rays enter the camera, on its axis.
    made_of : tuple
        All that rays follow from, as `content_name` takes it.
    area : float
        Of the pupil, where all film points have the same; 0 elsewhere.
    near : callable
        Takes points and a wavelength; returns the corners of boxes of the pupil (n, *NEAR) that they are seen through.
    """

    rays: Callable[[Array, int, float | None, Array], Reached]
    film_scale: tuple[float, float]
    made_of: tuple[object, ...]
    entry_z_m: float = 0.0
    area: float = 0.0
    near: Callable[[Array, float | None], Array] = lambda points, _: np.zeros((len(points), *NEAR))


@lru_cache(maxsize=8)
def _square(across: int) -> Array:
    steps = (np.arange(across) + 0.5) * 2 / across - 1
    nodes = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    nodes.flags.writeable = False
    return nodes


def _disk(across: int) -> Array:
    points = _square(across)
    return np.asarray(points[np.hypot(*points.T) <= 1.0])


def thin_lens_reach(
    radius_m: float, focus_m: float, half_tangents: tuple[float, float], shape: StopShape | StopMask | None
) -> LampReach:
    """Return the reach of a thin lens; the film is its tangents, the pupil its opening in radii."""

    def rays(points: Array, across: int, _: float | None, __: Array) -> Reached:
        disk = _disk(across)
        disk = disk if shape is None else disk[shape.holds(*disk.T)]
        depth = np.where(points[:, 2] < 0, -points[:, 2], np.nan)[:, None, None]
        on_lens = disk * radius_m
        film = on_lens / focus_m + (points[:, None, :2] - on_lens) / depth
        pupil, entry = np.broadcast_to(disk, film.shape), np.broadcast_to(on_lens, film.shape)
        return Reached(film, pupil, entry, np.asarray(np.isfinite(film).all(axis=-1)))

    made_of = ("thin", radius_m, focus_m, shape)
    return LampReach(rays, half_tangents, made_of, area=np.pi if shape is None else shape.area)


def thick_lens_reach(
    height: tuple[float, float], slope: tuple[float, float], first_vertex_m: float, half_film_mm: tuple[float, float]
) -> LampReach:
    """Return the reach of a thick lens; heights and slopes per millimetre of the film and per radius of the pupil."""

    def rays(points: Array, across: int, _: float | None, __: Array) -> Reached:
        disk = _disk(across)
        ahead = (first_vertex_m - points[:, 2]) * 1e3
        ahead = np.where(ahead > 0, ahead, np.nan)[:, None, None]
        by_pupil = (height[1] + ahead * slope[1]) * disk
        film = (points[:, None, :2] * 1e3 - by_pupil) / (height[0] + ahead * slope[0])
        entry = (height[0] * film + height[1] * disk) * 1e-3
        return Reached(film, np.broadcast_to(disk, film.shape), entry, np.asarray(np.isfinite(film).all(axis=-1)))

    made_of = ("thick", height, slope, first_vertex_m)
    return LampReach(rays, (-half_film_mm[0], -half_film_mm[1]), made_of, first_vertex_m, np.pi)


def lens_reach(
    lens: Lens, film_distance_mm: float, wavelength_nm: float, half_film_mm: tuple[float, float]
) -> LampReach | None:
    """Return the reach of a lens by exact rays; None where its entrance pupil lies at infinity."""
    pupil = lens.first_order(wavelength_nm).entrance_pupil
    if not (np.isfinite(pupil.distance_mm) and np.isfinite(pupil.diameter_mm)):
        return None
    film_z = lens.film_z(film_distance_mm)
    last_z = film_z - lens.sense * film_distance_mm

    def through(start: Array, aims: Array, nm: float) -> Reached:
        away = np.concatenate([aims, np.full((*aims.shape[:2], 1), pupil.distance_mm)], axis=-1) - start[:, None]
        away *= np.sign(away[..., 2:])
        shape, away = away.shape[:2], away.reshape(-1, 3)
        origins = np.broadcast_to(start[:, None], (*shape, 3)).reshape(-1, 3)
        rows, p, d = passed_rays(lens, origins, away, nm, "scene")
        with np.errstate(all="ignore"):
            film, last = (p[:2] + d[:2] * ((z - p[2]) / d[2]) for z in (film_z, last_z))
        ahead = origins[rows, 2] < 0
        met = np.isfinite(film).all(axis=0) & np.isfinite(last).all(axis=0) & ahead
        passed, kept = np.zeros(len(away), np.bool_), rows[met]
        passed[kept] = True
        o, a = origins[kept], away[kept]
        traced = np.zeros((3, len(away), 2))
        traced[:, kept] = film.T[met], last.T[met], (o[:, :2] - a[:, :2] * (o[:, 2:] / a[:, 2:])) * 1e-3
        on_film, on_last, entry = traced.reshape(3, *shape, 2)
        return Reached(on_film, on_last, entry, passed.reshape(shape))

    def starts(points: Array) -> Array:
        return np.asarray(points * 1e3 + (0.0, 0.0, film_z))

    def near(points: Array, nm: float | None) -> Array:
        coarse = _square(COARSE) * (WIDER * pupil.diameter_mm / 2)
        wide = np.broadcast_to(coarse, (len(points), *coarse.shape))
        passed = through(starts(points), wide, wavelength_nm if nm is None else nm).passed[..., None]
        if not passed.any():
            return np.zeros((len(points), *NEAR))
        none = ~passed.any(axis=1)
        low = np.where(none, 0.0, np.where(passed, wide, np.inf).min(axis=1))
        high = np.where(none, 0.0, np.where(passed, wide, -np.inf).max(axis=1))
        return np.stack([low, high], axis=1)

    def rays(points: Array, across: int, nm: float | None, seen: Array) -> Reached:
        low, high = seen[:, :1], seen[:, 1:]
        middle, half = (low + high) / 2, (high - low) / 2
        cell = WIDER * pupil.diameter_mm / COARSE
        aims = middle + _square(across) * (half + cell / 2)
        return through(starts(points), aims, wavelength_nm if nm is None else nm)

    made_of = (content_of(lens), film_distance_mm, wavelength_nm)
    return LampReach(rays, (-half_film_mm[0], -half_film_mm[1]), made_of, -film_z * 1e-3, near=near)


# Reconstruction filters of the film as tables of places to sample.

CELLS = 1024  # of the table: places between its entries are off by less than 1e-3 of the filter's integral
STEPS = 1 << 16  # of the quadrature over the radius


def _filter_value(kind: str, x: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Return a filter at a distance ``x`` from the centre [pixels], 0 beyond its radius; its scale is arbitrary."""
    t = np.abs(x) / radius
    value: NDArray[np.float64]
    if kind == "box":
        value = np.ones_like(t)
    elif kind == "tent":
        value = 1 - t
    elif kind == "gaussian":  # falls to e^-4.5 at its radius, three standard deviations out, and by that much to zero
        value = np.exp(-4.5 * t * t) - np.exp(-4.5)
    elif kind == "blackman_harris":  # four terms, minimum side lobes (Harris 1978, table 1)
        turn = np.pi * (1 + t)
        value = 0.35875 - 0.48829 * np.cos(turn) + 0.14128 * np.cos(2 * turn) - 0.01168 * np.cos(3 * turn)
    else:
        value = _mitchell(2 * t)
    return np.where(t <= 1, value, 0.0)


def _mitchell(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mitchell and Netravali 1988 with B = C = 1/3, radius 2."""
    near = (7 * x**3 - 12 * x**2 + 16 / 3) / 6
    far = (-7 / 3 * x**3 + 12 * x**2 - 20 * x + 32 / 3) / 6
    return np.where(x < 1, near, far)


def filter_table(film_filter: FilmFilter) -> NDArray[np.float32]:
    """Return the table of a filter for ``kernels/camera/filter.h``: the inverse of the integral of its magnitude.

    First where it changes its sign [pixels] and the ratio of the integrals of |f| and f, then `CELLS` + 1 places. A box
    of one pixel needs none of them.
    """
    kind, radius = film_filter.kind, film_filter.radius
    if kind == "box" and radius == 0.5:
        return np.zeros(1, np.float32)
    edges = np.linspace(0, radius, STEPS + 1)
    middles = 0.5 * (edges[1:] + edges[:-1])
    value = _filter_value(kind, middles, radius)
    half = np.concatenate([[0.0], np.cumsum(np.abs(value))]) / np.abs(value).sum()
    places = np.interp(np.linspace(0, 1, CELLS // 2 + 1), half, edges)
    changes = middles[value < 0]
    head = [changes[0] if len(changes) else 2 * radius, np.abs(value).sum() / value.sum()]
    table = np.concatenate([head, -places[:0:-1], places])
    return table.astype(np.float32)


# The geometry of a camera for programs that measure in its pictures: pose, film and intrinsics.


def intrinsics(
    scene: Scene,
    per_tangent: tuple[float, float],
    *,
    distortion: Literal["none", "traced lens"] = "none",
    lever: float = 1.0,
) -> Intrinsics:
    """The intrinsics that project a point (x, y, z) of the camera's frame on the picture, in pixels of the film.

    The point is seen at column ``cx + fx x / -z`` and row ``cy - fy y / -z``; pixel (0, 0) covers 0 to 1. A film
    that is tilted or swung has a ``matrix`` by rows in their place: it takes (x, y, -z) to a multiple of (column, row,
    1).

    Parameters
    ----------
    per_tangent
        Widths and heights of the whole film per unit of the tangent, across and down.
    lever
        By how much more than by its depth over the focal length in pixels a film point farther back sees less: 1 where
        the pupils are as large as each other.
    distortion
        ``traced lens``: the true projection bends away from this one as the lens does.
    """
    width, height = scene.film.resolution
    sign = 1.0 if scene.camera.flip else -1.0
    focal = sign * per_tangent[0] * width, sign * per_tangent[1] * height
    frame = settings.film_frame(scene.camera)
    if frame.is_flat:
        per_mm = [sign * pixels / (2 * half) for pixels, half in zip((width, height), half_film_mm(scene), strict=True)]
        cx, cy = width / 2 + frame.centre[0] * per_mm[0], height / 2 - frame.centre[1] * per_mm[1]
        return {"fx": focal[0], "fy": focal[1], "cx": cx, "cy": cy, "distortion": distortion}
    return {"matrix": _homography(scene, per_tangent, lever), "distortion": distortion}


def thick_lens_intrinsics(
    scene: Scene, thick: ThickLens, distortion: Literal["none", "traced lens"] = "none"
) -> Intrinsics:
    """Return the intrinsics of a scene's camera, whose lens is that thick lens to first order."""
    return intrinsics(scene, thick.film_per_tangent(*scene.film.size_m()), distortion=distortion, lever=thick.lever)


def _homography(scene: Scene, per_tangent: tuple[float, float], lever: float) -> list[list[float]]:
    """Return the 3x3 matrix by rows from tangents in the scene to columns and rows of a film that is turned."""
    frame, half = settings.film_frame(scene.camera), np.array(half_film_mm(scene))
    distance = 2 * half[0] * per_tangent[0]  # of an equivalent pinhole, turned with the film
    # a point of the film, in sides of the picture from its centre, lies at centre - x across - y up behind the pinhole
    sides = [-np.array(side) * length for side, length in zip((frame.across, frame.up), half, strict=True)]
    columns = np.stack([*sides, np.array([*frame.centre, distance])], axis=1)
    columns[2, :2] *= lever
    to_picture = np.linalg.inv(columns) @ np.diag([-1.0, -1.0, 1.0])
    (width, height), sign = scene.film.resolution, 1.0 if scene.camera.flip else -1.0
    pixels = np.array([[sign * width / 2, 0, width / 2], [0, -sign * height / 2, height / 2], [0, 0, 1]])
    rows: list[list[float]] = (pixels @ to_picture * distance).tolist()
    return rows


def camera_geometry(scene: Scene) -> dict[str, Any]:
    """Return pose [m], resolution and size of the film, and the nearest distance seen by a pinhole.

    ``world_from_camera`` is the 4x4 matrix by rows whose columns are right, up, back and eye, in the axes of the scene;
    of a moving camera when the shutter opens, and ``world_from_camera_at_close`` when the last light falls on the film.
    """
    camera, (opens, closes) = scene.camera, scene.shutter.span_s
    last = {"world_from_camera_at_close": _matrix(scene, closes)} if camera.motion else {}
    moves = camera.motion or any(item.motion for item in scene.objects)
    sliced = None if scene.shutter.keys else {"keys", "steps"}
    width, height = scene.film.size_m()
    near_m = getattr(scene.camera, "near_m", None)
    return {
        "world_from_camera": _matrix(scene, opens),
        **last,
        **({"shutter": scene.shutter.model_dump(exclude_none=True, exclude=sliced)} if moves else {}),
        "resolution": list(scene.film.resolution),
        "film_size_mm": [width * 1e3, height * 1e3],
        **({"near_m": near_m} if near_m else {}),
    }


def _matrix(scene: Scene, time_s: float) -> list[list[float]]:
    """Return the rows of the pose at a moment [m]."""
    matrix = pose_matrix(scene.camera.pose_at(time_s))
    matrix[:3, 3] *= scene.metres_per_unit
    rows: list[list[float]] = matrix.tolist()
    return rows


# When light falls on each pixel, and where the camera is then: what ``kernels/camera/trajectory.h`` reads.

_Array32 = NDArray[np.float32]


def camera_trajectory(scene: Scene) -> tuple[_Array32, int]:
    """Return rows of 4 numbers, and how many segments the way of the camera has; none where it stands still.

    A segment is the way between two moments during which eye, view and up change uniformly.

    Parameters
    ----------
    scene
        As it is when the shutter opens (`at_opening`): the eye there is the origin.
    """
    segments = _segments(scene)
    header = np.zeros((2, 4))
    header[0] = exposure_timing(scene.shutter, scene.film.resolution)
    header[1, 0] = len(segments)
    return np.concatenate([header, *segments]).astype(np.float32), len(segments)


def exposure_timing(shutter: Shutter, resolution: tuple[int, int]) -> tuple[float, float, float, float]:
    """Return time open, start of pixel (0, 0), and how much later each column and row start [s]."""
    if shutter.readout_s is None:
        return shutter.time_s, 0.0, 0.0, 0.0
    along_columns = shutter.direction in ("left_right", "right_left")
    rows = resolution[0 if along_columns else 1]
    step = shutter.readout_s / max(rows - 1, 1)
    backwards = shutter.direction in ("bottom_up", "right_left")
    start, step = (step * (rows - 1), -step) if backwards else (0.0, step)
    return (shutter.time_s, start, step, 0.0) if along_columns else (shutter.time_s, start, 0.0, step)


def _segments(scene: Scene) -> list[NDArray[np.float64]]:
    camera, (begin, end) = scene.camera, scene.shutter.span_s
    times = moments(camera.motion, begin, end)
    poses = [camera.pose_at(time) for time in times]
    if all(np.array_equal(pose, poses[0]) for pose in poses):
        return []
    eye, unit = poses[0][0], scene.metres_per_unit
    rows = [np.stack([unit * (pose[0] - eye), pose[1] - pose[0], pose[2]]) for pose in poses]
    for part in (1, 2):  # only the directions of view and up count
        largest = max(np.abs(row[part]).max() for row in rows)
        for row in rows:
            row[part] /= largest
    segments = []
    for (t0, t1), (first, second) in zip(pairwise(times), pairwise(rows), strict=True):
        segment = np.zeros((6, 4))
        segment[::2, :3], segment[1::2, :3] = first, second - first
        segment[0, 3], segment[1, 3] = t0 - begin, 1.0 / (t1 - t0)
        segments.append(segment)
    return segments


# What every camera model hands to the device.

SURFACE_BY_SURFACE = "camera/realistic.h"


@dataclass(frozen=True)
class CameraView:
    """What the auxiliary layers need to know of a camera; without arguments, of a point.

    Attributes
    ----------
    pupil_z_m : float
        Where the entrance pupil lies on the axis of the camera's frame [m].
    pupil_radius_m : float
        Its radius [m]; 0 for a point.
    blur : callable
        Returns the circle of confusion; a function, because to trace it takes a while.
    starts_ahead : bool
        Whether rays start ahead of the eye, that distances along them count from.
    """

    pupil_z_m: float = 0.0
    pupil_radius_m: float = 0.0
    blur: Callable[[], Blur] = Blur
    starts_ahead: bool = False

    def packed(self, *, with_blur: bool) -> tuple[NDArray[np.void], NDArray[np.float32]]:
        """Return the record for the device and the table of the circle of confusion, empty where it is not wanted."""
        blur = self.blur() if with_blur else Blur()
        record = VIEW.zeros(1)
        record["blur_focus"], record["blur_scale"], record["blur_shift"] = blur.focus, blur.scale, blur.shift
        record["blur_origin_z"], record["pupil_z"] = blur.origin_z, self.pupil_z_m
        record["per_pupil_radius"] = 1.0 / self.pupil_radius_m if self.pupil_radius_m else 0.0
        record["rows"], record["columns"] = blur.table.shape[:2]
        record["by_depth"], record["from_eye"] = blur.by_depth, self.starts_ahead
        return record, blur.table


@dataclass(frozen=True)
class CameraModel:
    """A camera ready for the device.

    Attributes
    ----------
    kernel : str
        The helper under ``kernels/`` that defines ``camera_ray``.
    record : array of one ``Camera`` record
    tables : float32 array
        What the helper looks up; empty for most.
    surfaces : array of ``Surface`` records
        Of a lens, film side first; in float64 where it is traced so.
    stop : array
        Shape of its stop, in the same precision.
    facts : dict
        Facts for the compilation of the camera's kernel.
    has_lens : bool
        Whether rays can be blocked.
    metadata : CameraMetadata
    view : CameraView
    usable_nm : (low, high)
        Wavelengths that its lens is known for [nm].
    axial_colour : (wavelengths, irradiances) or None
        What its lens lets pass of light of each wavelength [nm] on the axis, relative to `on_axis_irradiance`; None
        where paths have no wavelength.
    on_axis_irradiance : float or None
        Irradiance of the film's centre in a uniform world of radiance 1; None for a camera without a lens opening.
    passed : float
        Share of that light which the lens leaves of what enters it: 1 unless its losses count.
    axial_weight : float
        Mean weight there: the same number, or 1 where the weights leave radiance as it is.
    reach : LampReach or None
        How it sees points of the scene; None for a camera without a lens opening.
    setting : LensSetting or None
        The lens in use, where rays are traced through it.
    pupil : EntrancePupil or None
        Its entrance pupil, with its drift, where that was found.
    shares : (n, n) array or None
        How much of the aberrations of its lens its rays leave out for waves to bring, by rows from edge to edge of the
        film; None where they leave out none.
    """

    kernel: str
    record: NDArray[np.void]
    facts: dict[str, int]
    tables: NDArray[np.float32] = field(default_factory=lambda: np.zeros(1, np.float32))
    surfaces: NDArray[np.void] = field(default_factory=lambda: SURFACE.zeros(1))
    stop: NDArray[np.floating] = field(default_factory=lambda: np.zeros(1, np.float32))
    has_lens: bool = False
    metadata: CameraMetadata = field(default_factory=lambda: CameraMetadata())
    view: CameraView = CameraView()
    usable_nm: tuple[float, float] = DISPERSION_NM
    axial_colour: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    on_axis_irradiance: float | None = None
    passed: float = 1.0
    axial_weight: float = 1.0
    reach: LampReach | None = None
    setting: LensSetting | None = None
    pupil: EntrancePupil | None = None
    shares: NDArray[np.float64] | None = None

    @property
    def value(self) -> float:
        """The film's value in its middle for radiance 1."""
        return float(self.record[0]["exposure"]) * self.axial_weight

    @property
    def bends_colours(self) -> bool:
        """Whether light of each wavelength goes its own way through the lens."""
        return self.facts.get("LENS_DISPERSION", 0) > 0 or self.facts.get("MAP_COLOURS", 0) > 0

    @property
    def crosses_surfaces(self) -> bool:
        """Whether the kernel takes rays through surface after surface."""
        return self.kernel == SURFACE_BY_SURFACE

    @property
    def blocks_many(self) -> bool:
        """Whether many of its rays bring nothing: they aim at more than what passes, or half of the pupil counts."""
        return self.facts.get("PUPIL_KIND") != PupilKind.OUTLINES or bool(self.facts.get("HALF_PUPIL"))


def camera_record(pose: CameraKind, film: Film, kind: str, **own: float) -> NDArray[np.void]:
    """Return a camera record with pose and resolution in place, and what a camera of a kind has of its own."""
    record = _place_camera(CAMERA.zeros(1), pose)
    width, height = film.resolution
    sign = 1.0 if pose.flip else -1.0
    record["width"], record["height"] = width, height
    record["per_width"], record["per_height"] = sign / width, sign / height
    record["exposure"] = 1.0
    for name, value in own.items():
        record["own"][kind][name] = value
    return record


def turned(camera: CameraModel, pose: CameraKind) -> CameraModel:
    """Return the same camera in another pose, which it does not focus by."""
    setting, lens = camera.setting, pose.lens_camera
    if setting is not None and lens is not None:
        setting = replace(setting, camera=lens)
    return replace(camera, record=_place_camera(camera.record.copy(), pose), setting=setting)


def _place_camera(record: NDArray[np.void], pose: CameraKind) -> NDArray[np.void]:
    assert not pose.stands_by_pupil, "where its film stands is to be found first (`on_film`)"
    matrix = pose.world_from_camera()
    for index, name in enumerate(("right", "up", "back")):
        record[name][0, :3] = matrix[:3, index]
    return record


def entrance_pupil_view(first: FirstOrder, first_vertex_z_m: float, blur: Callable[[], Blur]) -> CameraView:
    """Return the view of a lens from its first-order data; a pupil at infinity has no coordinates.

    Parameters
    ----------
    first_vertex_z_m
        Where the first vertex lies on the axis of the camera's frame [m].
    """
    pupil = first.entrance_pupil
    return CameraView(first_vertex_z_m + pupil.distance_mm * 1e-3, pupil.diameter_mm / 2 * 1e-3, blur)


def half_tangents(
    fov_degrees: float, axis: Literal["horizontal", "vertical", "diagonal"], film: Film
) -> tuple[float, float]:
    """Return the tangents of half the field of view across and down the film."""
    width, height = film.size_m()
    side = {"horizontal": width, "vertical": height, "diagonal": math.hypot(width, height)}[axis]
    tangent = math.tan(math.radians(fov_degrees) / 2)
    return tangent * width / side, tangent * height / side


#
# The factor from the weights of a camera's rays to the values of the film, as the scene's exposure has it.
#
# ISO 12232 (2019, saturation-based speed): a sensor of speed S saturates at a luminous exposure of H = 78 / S lx s,
# so that ``physical`` values are E t S / 78 for an illuminance E [lx] of the film over a time t [s].


def opening_irradiance(shape: StopShape | StopMask | None, radius: float, distance: float) -> float:
    """Return the irradiance on the axis for radiance 1 through a flat opening: integral of cos^4 / distance^2.

    Parameters
    ----------
    shape
        Outline in units of the radius; None for a circle.
    radius, distance
        Of the opening, and from it to the film, in the same unit.
    """
    if shape is None:
        return math.pi * radius**2 / (radius**2 + distance**2)
    if isinstance(shape, StopMask):
        return _through_cells(shape.cells, radius / distance)
    return sum(_through_polygon(triangle * (radius / distance)) for triangle in shape.triangles)


def _through_cells(cells: NDArray[np.bool_], radius: float) -> float:
    """Return the irradiance at unit distance, each cell being small."""
    side = 2.0 * radius / len(cells)
    row, column = np.nonzero(cells)
    middle = (len(cells) - 1) / 2
    square = ((row - middle) ** 2 + (column - middle) ** 2) * side**2
    return float(np.sum(side**2 / (1.0 + square) ** 2))


def _through_polygon(corners: Array) -> float:
    """Return the irradiance at unit distance from a polygon (n, 2), by the angles of its edges (Lambert 1760)."""
    here = np.column_stack([corners, np.ones(len(corners))])
    there = np.roll(here, -1, axis=0)
    normal = np.cross(here, there)
    sine, cosine = np.linalg.norm(normal, axis=1), np.sum(here * there, axis=1)
    angle_over_sine = np.divide(np.arctan2(sine, cosine), sine, out=1.0 / cosine, where=sine > 0)
    return abs(float(np.sum(angle_over_sine * normal[:, 2]))) / 2


_SATURATION_LX_S = 78.0  # of ISO 1


def values_per_irradiance(time_s: float, iso: float) -> float:
    """Return the film's value for 1 W/m² over an exposure time [s] at a sensitivity."""
    return LUMENS_PER_WATT * time_s * iso / _SATURATION_LX_S


def f_number_by_light(on_axis_irradiance: float) -> float:
    """Return the f-number of the aplanatic lens that lights the film's centre as much: 1 / (2 sin u')."""
    return math.sqrt(math.pi / (4.0 * on_axis_irradiance))


def camera_irradiance(model: CameraModel, exposure: Exposure) -> float | None:
    """Return the irradiance of the film's centre for radiance 1; None where there is no film to speak of."""
    if model.on_axis_irradiance is not None:
        return model.on_axis_irradiance
    return None if exposure.f_number is None else math.pi / (4.0 * exposure.f_number**2)


def exposed(model: CameraModel, scene: Scene) -> CameraModel:
    """Return a camera whose record holds the factor of the exposure; ``auto`` counts as relative until it is metered.

    Raises
    ------
    InputError
        When the factor is beyond the range of float32.
    """
    exposure, on_axis = scene.exposure, camera_irradiance(model, scene.exposure)
    per_value = 1.0  # values of the film per value of mode relative
    metadata: CameraMetadata = {}
    if exposure.mode in ("irradiance", "physical"):
        assert on_axis is not None
        scale = 1.0
        if exposure.mode == "physical":
            scale = values_per_irradiance(scene.shutter.time_s, exposure.iso)
            metadata = _photographic(scene, on_axis)
        per_value = on_axis * scale
    per_value *= exposure.factor
    if on_axis is not None:
        metadata["working_f_number"] = f_number_by_light(on_axis / model.passed)
        metadata["t_number"] = f_number_by_light(on_axis)
        metadata["values_per_irradiance"] = per_value / on_axis
    record = model.record.copy()
    record["exposure"] = _in_float32(per_value / model.axial_weight)
    return replace(model, record=record, metadata=model.metadata | metadata)


def _photographic(scene: Scene, on_axis: float) -> CameraMetadata:
    """The exposure as a photographer writes it down; EV at ISO 100 by the f-number that the irradiance stands for."""
    exposure, time_s = scene.exposure, scene.shutter.time_s
    return {
        **({} if exposure.f_number is None else {"f_number": exposure.f_number}),
        "exposure_time_s": time_s,
        "iso": exposure.iso,
        "ev100": math.log2(f_number_by_light(on_axis) ** 2 / time_s * 100.0 / exposure.iso),
        "exposure_ev": exposure.ev,
        "neutral_density_stops": exposure.neutral_density_stops,
    }


def _in_float32(factor: float) -> float:
    if FLOAT32_MIN_NORMAL <= factor <= FLOAT32_MAX:
        return factor
    raise InputError(
        f"exposure: makes values that float32 cannot hold (got a factor of {factor:.3g};"
        f" allowed: {FLOAT32_MIN_NORMAL:.3g} to {FLOAT32_MAX:.3g})"
    )
