"""The rays that points of the film receive, in float64: what `kernels/camera` draws at random, on a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.aperture import stop_shape
from rptcam_cl.cameras.movements import film_frame
from rptcam_cl.cameras.rays import allowed_px, fitted_map
from rptcam_cl.cameras.setting import LensSetting, lens_setting
from rptcam_cl.cameras.thick_lens import thick_lens_of
from rptcam_cl.cameras.thin_lens import optics_of, radius_of
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import FilmFrame, Lens, cells, grid, narrowing_probes, pupil_boxes
from rptcam_cl.scene import (
    EnvironmentCamera,
    LensCamera,
    PinholeCamera,
    RealisticCamera,
    Scene,
    ThinLensCamera,
    unknown_camera,
)

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


def pupil_rays(scene: Scene, places: Array) -> PupilRays:
    """Return the rays of places of the picture (m, 2), right and down in pixels.

    Raises
    ------
    InputError
        When the camera has no aperture, or a place receives no light.
    """
    camera = scene.camera
    if isinstance(camera, ThinLensCamera):
        return thin_lens_rays(scene, camera, places)
    if isinstance(camera, LensCamera):
        return lens_rays(scene, lens_setting(scene), places)
    if not isinstance(camera, PinholeCamera | EnvironmentCamera):
        raise unknown_camera(scene.camera.kind, "the rays of its pupil (rptcam_cl/cameras/pupil_rays.py)")
    raise InputError(f"camera.kind: {camera.kind} has no pupil (allowed: thin_lens, thick_lens, realistic)")


def _on_film(scene: Scene, places: Array) -> Array:
    """Return places right and up in the upright picture, to 1 at its edges."""
    film = 2.0 * np.asarray(places, np.float64) / scene.film.resolution - 1.0
    return np.asarray(film * (1.0, -1.0) * (1.0 if scene.camera.flip else -1.0))


def _unit_grid() -> Array:
    steps = (np.arange(ACROSS) + 0.5) * 2 / ACROSS - 1
    return np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)


def thin_lens_rays(scene: Scene, camera: ThinLensCamera, places: Array) -> PupilRays:
    """Return the rays of places of the picture as `pupil_rays` does, for a thin lens on the scene's film."""
    across, _, focal_length = optics_of(camera, scene.film)
    distance = scene.film.size_m()[0] / 2 / across
    film = film_frame(camera).points(-_on_film(scene, places) * np.array(scene.film.size_m()) * 500.0) * 1e-3 / distance
    nearer = 1.0 + film[:, None, 2:]
    points, shape = _unit_grid(), stop_shape(scene, camera.aperture)
    x, y = points.T
    points = points[np.hypot(x, y) <= 1.0 if shape is None else shape.holds(x, y)]
    many = (len(film), len(points), 2)
    on_lens = np.broadcast_to(points * radius_of(camera, focal_length), many)
    vergence = 1.0 / camera.plane_m + (1.0 - 1.0 / nearer) / distance
    slopes = -film[:, None, :2] / nearer - on_lens * vergence
    origins = np.concatenate([on_lens, np.zeros((*many[:2], 1))], axis=-1)
    weights = np.full(many[:2], 1.0 / len(points))
    cell = np.full((len(film), 2), 2.0 / ACROSS)
    return PupilRays(origins, slopes, weights, np.broadcast_to(points, many), cell, np.zeros_like(film[:, :2]))


def lens_rays(scene: Scene, setting: LensSetting, places: Array) -> PupilRays:
    """Return the rays of places of the picture as `pupil_rays` does, for a lens as it is set."""
    frame = film_frame(scene.camera)
    film_mm = frame.points(-_on_film(scene, places) * np.array(scene.film.size_m()) * 500.0)  # a lens inverts
    if isinstance(setting.camera, RealisticCamera):
        return _traced(scene, setting, film_mm, frame)
    return _thick(setting, film_mm, np.array(frame.normal))


def _thick(setting: LensSetting, film_mm: Array, normal: Array) -> PupilRays:
    thick = thick_lens_of(setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm)
    points = _unit_grid()
    points = points[np.hypot(*points.T) <= 1.0]
    many = (len(film_mm), len(points), 2)
    depth, slope = film_mm[:, None, 2:], thick.film_slope
    nearer = 1.0 + depth * slope[0]
    there = (film_mm[:, None, :2] - depth * slope[1] * points) / nearer  # in the plane through the film's centre

    def together(factors: tuple[float, float]) -> Array:
        return np.asarray(factors[0] * there + factors[1] * points)

    z = np.full((*many[:2], 1), -setting.lens.film_z(setting.film_distance_mm) * 1e-3)
    origins = np.concatenate([together(thick.height) * 1e-3, z], axis=-1)
    slopes = together(slope)
    facing = np.maximum(slopes @ normal[:2] + normal[2], 0.0)
    cos4 = (1.0 + np.sum(slopes**2, axis=-1)) ** -2 * facing
    cell = np.full((len(film_mm), 2), 2.0 / ACROSS)
    weights = cos4 / cos4.sum(axis=1, keepdims=True)
    film = np.zeros_like(film_mm[:, :2])
    return PupilRays(origins, together(thick.slope), weights, np.broadcast_to(points, many), cell, film)


def _traced(scene: Scene, setting: LensSetting, points_mm: Array, frame: FilmFrame) -> PupilRays:
    film_mm, depths = points_mm[:, :2], points_mm[:, 2]
    lens, back, wavelength = setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm
    assert isinstance(setting.camera, RealisticCamera)
    shape = stop_shape(scene, setting.camera.aperture)
    lens = lens if shape is None else lens.with_stop_shape(shape)
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
    camera, shape = setting.camera, (*rear.shape[:2], 3)
    if isinstance(camera, RealisticCamera) and camera.rays == "fitted":
        found = fitted_map(lens, setting, scene.film, None, allowed_px(camera))
        flat = film.reshape(-1, 2), rear.reshape(-1, 2), np.zeros(film.size // 2)
        origins, directions = (values * (1.0, 1.0, -1.0) for values in found.trace(*flat))
        passed = found.passes(lens, *flat)
    else:
        start = np.concatenate([film, lens.length + lens.sense * distances], axis=-1)
        away = np.concatenate([rear - film, -lens.sense * distances], axis=-1)
        rays = lens.trace(start.reshape(-1, 3), away.reshape(-1, 3), camera.wavelength_nm)
        origins, directions, passed = rays.origins, rays.directions, rays.passed
    return origins.reshape(shape), directions.reshape(shape), passed.reshape(shape[:2])
