"""Thin and thick lenses to first order, and the outline of the stop, for the kinds of camera."""

from __future__ import annotations

import io
import math
import struct
import warnings
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import name_errors, read_whole
from rptcam_cl.core.records import curves
from rptcam_cl.optics.lens import Lens, limiting_surface, system_matrix
from rptcam_cl.optics.surface import StopMask, StopShape, blades, fit_to_stop, heart, polygon, star
from rptcam_cl.rendering.cameras.model import Blur, film_depths, intrinsics, perfect_blur
from rptcam_cl.rendering.cameras.setting import Intrinsics, LensSetting
from rptcam_cl.scene import lens_settings
from rptcam_cl.scene.scene import Scene

#
# Dust and scratches in the plane of the stop, as holes in its outline.
#
# Specks are numbered from the middle outwards, so that a wider stop shows those of a smaller one and more.

Array = NDArray[np.float64]

_SPECK_CORNERS = 9
_RAGGED = 0.3  # how far corners of a speck lie beside its circle, in its radius
MOST = 1000  # specks, and scratches; of more the largest count
ALONG = 65  # places along a scratch that are looked at
ROOM = 0.999  # share of the outline's radius that dirt lies within


def edges_of(polygon: Array) -> Array:
    """Return the edges (n, 4), from x, y to x, y, of a polygon (n, 2)."""
    return np.concatenate([polygon, np.roll(polygon, -1, axis=0)], axis=1)


def dirt_edges(dirt: lens_settings.Dirt, outline: Array, radius_mm: float) -> Array:
    """Return the edges (n, 4) of dirt within an outline, clockwise, as holes have them.

    Parameters
    ----------
    dirt : Dirt
    outline : (n, 2) array
        Anticlockwise about its middle, from which every corner is seen; of any unit.
    radius_mm : float
        What its farthest corner is from the middle, in the plane of the stop.
    """
    middle = _middle(outline)
    about = outline - middle
    reach = np.hypot(*about.T)
    scale = float(reach.max()) / radius_mm
    order = np.argsort(np.arctan2(about[:, 1], about[:, 0]))
    rim = (np.arctan2(about[order, 1], about[order, 0]), reach[order] / scale * ROOM)
    specks = [polygon for polygon in _specks(dirt, radius_mm) if _inside(polygon, rim).all()]
    scratches = [
        polygon for line in _scratches(dirt, radius_mm) if (polygon := _clip_line(line, dirt, rim)) is not None
    ]
    edges = [edges_of(middle + scale * polygon[::-1]) for polygon in (*specks, *scratches)]
    return np.concatenate([np.zeros((0, 4)), *edges])


def _middle(polygon: Array) -> Array:
    """Return the centroid of the area of a polygon."""
    following = np.roll(polygon, -1, axis=0)
    cross = polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]
    return np.asarray(cross @ (polygon + following) / (3 * cross.sum()))


def _inside(points: Array, rim: tuple[Array, Array]) -> NDArray[np.bool_]:
    angles = np.arctan2(points[:, 1], points[:, 0])
    return np.asarray(np.hypot(*points.T) < np.interp(angles, *rim, period=2 * np.pi))


def _spread(density: float, radius_mm: float, seed: int, numbers: int) -> tuple[Array, Array]:
    """Return places (n, 2) about the middle [mm], and random numbers (n, numbers) beside each."""
    count = int(np.ceil(density * np.pi * radius_mm**2))
    drawn = np.random.default_rng(seed).random((count, 2 + numbers))
    distance = np.sqrt((np.arange(count) + drawn[:, 0]) / (np.pi * max(density, 1e-300)))
    angle = 2 * np.pi * drawn[:, 1]
    return np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1), drawn[:, 2:]


def _sizes(drawn: Array) -> Array:
    """Return factors of median 1 that are nearly log-normal, of three random numbers each."""
    return np.asarray(np.exp(drawn[:, :3].sum(axis=1) - 1.5))


def _specks(dirt: lens_settings.Dirt, radius_mm: float) -> list[Array]:
    """Return the corners of ragged specks about the middle [mm]."""
    at, drawn = _spread(dirt.dust_per_mm2, radius_mm, dirt.seed, 3 + _SPECK_CORNERS)
    radii = 0.5e-3 * dirt.dust_um * _sizes(drawn)
    angles = 2 * np.pi * np.arange(_SPECK_CORNERS) / _SPECK_CORNERS
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    chosen = np.sort(np.argsort(-radii, kind="stable")[:MOST])
    return [at[k] + (radii[k] * (1 + _RAGGED * (2 * drawn[k, 3:] - 1)))[:, None] * ring for k in chosen]


def _scratches(dirt: lens_settings.Dirt, radius_mm: float) -> list[tuple[Array, Array]]:
    """Return both ends of scratches about the middle [mm]."""
    at, drawn = _spread(dirt.scratches_per_mm2, radius_mm, dirt.seed + 1, 4)
    halves = 0.5 * dirt.scratch_mm * _sizes(drawn)
    angles = np.pi * drawn[:, 3]
    away = halves[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return [(at[k] - away[k], at[k] + away[k]) for k in np.sort(np.argsort(-halves, kind="stable")[:MOST])]


def _clip_line(line: tuple[Array, Array], dirt: lens_settings.Dirt, rim: tuple[Array, Array]) -> Array | None:
    """Return the corners of the part of a scratch within the rim; None where it is not longer than wide."""
    first, last = line
    wide = 0.5e-3 * dirt.scratch_um
    across = np.array([first[1] - last[1], last[0] - first[0]])
    across *= wide / np.hypot(*across)
    places = first + np.linspace(0, 1, ALONG)[:, None] * (last - first)
    good = _inside(places - across, rim) & _inside(places + across, rim)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    if not len(ends):
        return None
    longest = int(np.argmax(ends[1::2] - ends[::2]))
    a, b = places[ends[2 * longest]], places[ends[2 * longest + 1] - 1]
    if np.hypot(*(b - a)) <= 2 * wide:
        return None
    return np.stack([a - across, b - across, b + across, a + across])


# The shape of an aperture for the device: tables to draw points of a thin lens from, or the shape of a stop.

_LARGEST_MASK = 512  # pixels along a side
LARGEST_FILE = 16_000_000  # bytes

# What Pillow raises on damaged pictures.
_DAMAGED = (OSError, SyntaxError, ValueError, TypeError, KeyError, IndexError, EOFError, OverflowError, MemoryError,
           struct.error, zlib.error)  # fmt: skip


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
            cells = bright_parts(scene.content_of(aperture), where)
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


def bright_parts(source: Path | bytes, where: str) -> NDArray[np.bool_]:
    """Return which pixels (height, width) of a mask picture are brighter than half, of an array which are above zero.

    Parameters
    ----------
    source
        The file, or its content.
    where
        What errors call it.

    Raises
    ------
    InputError
        When it is no picture, or none are.
    """
    from PIL import Image, UnidentifiedImageError

    with name_errors(where):
        content = read_whole(source, LARGEST_FILE)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            if content.startswith(b"\x93NUMPY"):
                cells = np.load(io.BytesIO(content), allow_pickle=False) > 0
                if cells.ndim != 2:
                    raise InputError(f"{where}: has {cells.ndim} dimensions (allowed: an array (height, width))")
            else:
                with Image.open(io.BytesIO(content), formats=["PNG", "JPEG", "TIFF"]) as picture:
                    cells = np.asarray(picture.convert("L")) > 127
    except (*_DAMAGED, UnidentifiedImageError, Image.DecompressionBombError, Warning) as problem:
        raise InputError(f"{where}: is not a readable PNG, JPEG or TIFF picture ({problem})") from None
    if not cells.any():
        raise InputError(f"{where}: is dark everywhere (allowed: some pixels brighter than half)")
    return np.asarray(cells)


# The thin lens: an ideal lens of no thickness with one plane of focus.


def thin_lens_blur(scene: Scene, gain: float, focus: float, film_distance_m: float) -> Blur:
    """Return the circle of confusion: a film point farther back has its plane of focus nearer, and a longer lever."""
    nearer = 1.0 + film_depths(scene) * 1e-3 / film_distance_m
    return perfect_blur(gain * nearer, focus + (1.0 - 1.0 / nearer) / film_distance_m)


# The thick lens: what the cardinal points and the pupils of a lens say, and nothing of its aberrations and rims.

_AT_THE_PUPIL = 1e-9  # distance from film to exit pupil, as a share of the film distance, that counts as none


@dataclass(frozen=True)
class ThickLens:
    """The ray that leads from a film point through a point of the pupil, both sides of the lens to first order.

    Every number is a factor for the film point [mm] and one for the point of the unit disk that the pupil is, in x and
    y alike. To first order the exit pupil, the entrance pupil and the stop are images of each other, so a point of that
    disk is a point of each. In this form nothing is infinite when a pupil is (a telecentric lens).

    Attributes
    ----------
    film_slope : tuple of float
        Sideways per unit towards the film, between the exit pupil and the film.
    height : tuple of float
        Where the ray meets the plane of the first vertex [mm].
    slope : tuple of float
        Sideways per unit towards the scene, in the scene.
    """

    film_slope: tuple[float, float]
    height: tuple[float, float]
    slope: tuple[float, float]

    @property
    def pupil_solid_angle(self) -> float:
        """Area of the exit pupil over the square of its distance from the film."""
        return math.pi * self.film_slope[1] ** 2

    def film_per_tangent(self, width_m: float, height_m: float) -> tuple[float, float]:
        """Return how many widths and heights of a film the image moves per unit of the tangent in the scene."""
        per_mm = 1e-3 / abs(self.slope[0])
        return per_mm / width_m, per_mm / height_m

    @property
    def lever(self) -> float:
        """Slope of chief rays at the film over that in the scene: the pupil's size there over its size at the film."""
        return self.film_slope[0] / abs(self.slope[0])

    @property
    def axial_cone(self) -> float:
        """Projected solid angle of the pupil from the centre of the film: pi sin^2 of the half angle."""
        square = self.film_slope[1] ** 2
        return math.pi * square / (1.0 + square)


def thick_lens_of(lens: Lens, film_distance_mm: float, wavelength_nm: float) -> ThickLens:
    """Return the thick lens of a lens and a film at a distance from its last vertex [mm].

    With matrices on (height, index * slope), front from the first vertex to the stop and rear from the stop to the
    film, a film point h and a stop point s belong to h = A s + B v, v being the slope at the stop times the index.

    Raises
    ------
    InputError
        For a lens that has no cardinal points, or other ones in x than in y, or whose exit pupil lies on the film.
    """
    _check(lens, wavelength_nm)
    stop = limiting_surface(lens, wavelength_nm)
    radius = lens.surfaces[stop].semi_diameter
    indices = lens.indices(wavelength_nm)
    n_scene, n_film = float(indices[0]), float(indices[-1])
    to_film = np.array([[1.0, film_distance_mm / n_film], [0.0, 1.0]])
    (at, along), (_, turn) = (to_film @ system_matrix(lens, wavelength_nm, stop)).tolist()
    (a, b), (c, d) = system_matrix(lens, wavelength_nm, 0, stop, refract_last=False).tolist()
    if abs(along) <= _AT_THE_PUPIL * film_distance_mm:
        raise InputError(f"{lens.name}: its exit pupil lies on the film, {film_distance_mm:g} mm behind the lens")
    return ThickLens(
        film_slope=(turn / along / n_film, -radius / along / n_film),
        height=(-b / along, radius * (d + b * at / along)),
        slope=(-a / along / n_scene, radius * (c + a * at / along) / n_scene),
    )


def _check(lens: Lens, wavelength_nm: float) -> None:
    if not lens.is_rotational:
        raise InputError(
            f"{lens.name}: is not the same from every side, so no single thick lens stands for it;"
            " take camera.kind: realistic"
        )
    if not math.isfinite(lens.first_order(wavelength_nm).focal_length_mm):
        raise InputError(f"{lens.name}: is afocal, so it has no cardinal points; take camera.kind: realistic")
    if lens.is_obstructed:
        raise InputError(
            f"{lens.name}: its pupil is a ring, for which no thick lens stands; take camera.kind: realistic"
        )
    if lens.stop is not None and lens.stop.stop_shape is not None:
        raise InputError(f"{lens.name}: its stop is not round; take camera.kind: realistic")


def thick_lens_intrinsics(
    scene: Scene, thick: ThickLens, distortion: Literal["none", "traced lens"] = "none"
) -> Intrinsics:
    """Return the intrinsics of a scene's camera, whose lens is that thick lens to first order."""
    return intrinsics(scene, thick.film_per_tangent(*scene.film.size_m()), distortion=distortion, lever=thick.lever)


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
