"""How far camera models are from each other, measured afresh: by dense rays through every surface, at any film point.

Nothing here comes from `rptcam_cl.studies.tiers`: rays are those of
`rptcam_cl.rendering.cameras.film_pupil`, as the kernels draw them, and a pinhole is its field of view.
"""

from dataclasses import dataclass
from unittest import mock

import numpy as np
from scipy.spatial import cKDTree

from rptcam_cl.optics.film_probe import FilmProbe
from rptcam_cl.rendering.cameras import film_pupil
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.lens_records import stop_shape
from rptcam_cl.rendering.cameras.setting import lens_setting
from rptcam_cl.scene.changes import change_scene

ACROSS = 120  # rays across a pupil
LIGHT_RAYS = 4  # for each of these, where its light is measured
APART_PX = 4.0  # on both sides of a place, to tell the scale
WAVELENGTHS_NM = (440.0, 475.0, 550.0, 610.0, 640.0)
TURNS = np.arange(48) * 2 * np.pi / 48


@dataclass(frozen=True)
class Cloud:
    """Rays of one place of the picture: where they cross a plane ahead of the traced camera's eye."""

    starts: np.ndarray  # (n, 3) [m], z ahead of that eye
    slopes: np.ndarray
    weights: np.ndarray

    def on(self, plane_m):
        return self.starts[:, :2] + (plane_m - self.starts[:, 2:]) * self.slopes

    def middle(self, plane_m):
        return self.weights @ self.on(plane_m) / self.weights.sum()


def dense_rays(scene, places):
    with mock.patch.object(film_pupil, "ACROSS", ACROSS):
        return camera_of(scene).pupil_rays(np.asarray(places))


def clouds(scene, places, eye_ahead_m=0.0):
    """The rays of places of the picture [pixels]; the eye of the scene's camera lies ahead of the traced one's."""
    camera = scene.camera
    if camera.kind == "pinhole":
        width, height = scene.film.resolution
        across = np.tan(np.radians(camera.fov_degrees) / 2)
        film = (2 * np.asarray(places) / (width, height) - 1) * (across, -across * height / width)
        ahead = np.array([[0.0, 0.0, eye_ahead_m]])
        return [Cloud(ahead, slope[None], np.ones(1)) for slope in film]
    rays = dense_rays(scene, places)
    found = []
    for origins, slopes, weights in zip(rays.origins, rays.slopes, rays.weights, strict=True):
        lit = weights > 0
        starts = origins[lit] * (1, 1, -1) + (0, 0, eye_ahead_m)
        found.append(Cloud(starts, slopes[lit], weights[lit]))
    return found


def eye_ahead_m(traced, other):
    """How far the eye of another camera lies ahead of the traced one's."""
    back = traced.camera.world_from_camera()[:3, 2]
    return float(np.subtract(traced.camera.eye, other.camera.eye) @ back) * traced.metres_per_unit


class Scales:
    """Pixels per metre at places of the picture, along the line to its middle."""

    def __init__(self, full, places):
        out = np.asarray(places) - np.array(full.film.resolution) / 2
        length = np.linalg.norm(out, axis=1, keepdims=True)
        step = APART_PX * np.where(length > 0, out / np.maximum(length, 1e-9), (1.0, 0.0))
        self.sides = [clouds(full, places + sign * step) for sign in (-1, 1)]

    def on(self, plane_m):
        first, second = ([cloud.middle(plane_m) for cloud in side] for side in self.sides)
        return 2 * APART_PX / np.linalg.norm(np.subtract(second, first), axis=1)


def apart(one, other, plane_m, scale):
    """Shift, change of spread, and distance of the outlines of two clouds on a plane [pixels], and the grain of it."""
    spots, reach, spread = [], [], []
    for cloud in (one, other):
        places, share = cloud.on(plane_m) * scale, cloud.weights / cloud.weights.sum()
        middle = share @ places
        away = places - middle
        spots.append(middle)
        spread.append(np.sqrt(share @ away**2))
        reach.append((away @ np.stack([np.cos(TURNS), np.sin(TURNS)])).max(axis=0))
    changes = np.array([*spread[0], np.hypot(*spread[0])]) - np.array([*spread[1], np.hypot(*spread[1])])
    grain = 2 * max(each.max() for each in reach) / ACROSS
    return np.hypot(*(spots[0] - spots[1])), np.abs(changes).max(), np.abs(reach[0] - reach[1]).max(), grain


def hausdorff_px(one, other, plane_m, scale):
    """The largest distance from a ray of either cloud to the other cloud [pixels]."""
    trees = [cKDTree(cloud.on(plane_m) * scale) for cloud in (one, other)]
    return max(trees[0].query(trees[1].data)[0].max(), trees[1].query(trees[0].data)[0].max())


def colour_px(full, places, planes_m):
    """How far rays of other wavelengths fall from their place, at most [pixels]."""
    setting, rays = lens_setting(full), dense_rays(full, places)
    lens, back, worst = setting.lens, setting.film_distance_mm, 0.0
    scales = np.array([Scales(full, places).on(plane) for plane in planes_m])
    for k, (film, pupil, weights) in enumerate(zip(rays.film, rays.pupil, rays.weights, strict=True)):
        rear = pupil[weights > 0][::5]
        towards = np.column_stack([rear - film, np.full(len(rear), -back)])
        origin = np.tile([*film, lens.length + back], (len(rear), 1))
        traced = [lens.trace(origin, towards, nm) for nm in (setting.camera.wavelength_nm, *WAVELENGTHS_NM)]
        for plane, per_m in zip(planes_m, scales[:, k], strict=True):
            own, *others = (_meets(some, lens.length + back, plane * 1e3) for some in traced)
            offsets = np.array([np.hypot(*(other - own).T) for other in others])
            worst = max(worst, float(np.nanmax(offsets)) * 1e-3 * per_m)
    return worst


def _meets(rays, film_z, plane_mm):
    slopes = rays.directions[:, :2] / -rays.directions[:, 2:]
    places = rays.origins[:, :2] + (plane_mm - film_z + rays.origins[:, 2:]) * slopes
    places[~rays.passed] = np.nan
    return places


def light(full, chosen, places):
    """Relative errors of brightness at places, both pictures being 1 on the axis."""
    setting, shape = lens_setting(full), stop_shape(full, full.camera.aperture)
    lens = setting.lens if shape is None else setting.lens.with_stop_shape(shape)
    middle = np.array(full.film.resolution) / 2
    wide = dense_rays(rounded(full), np.concatenate([[middle], places]))  # whose pupils hold that of any shape
    probe = FilmProbe(lens, setting.film_distance_mm, setting.camera.wavelength_nm)
    jitter = np.random.default_rng(0).uniform(-0.5, 0.5, (LIGHT_RAYS, *wide.pupil.shape[1:]))
    traced = []
    for film, pupil, cell in zip(wide.film, wide.pupil, wide.cell, strict=True):
        rear = pupil + jitter * cell
        square = setting.film_distance_mm**2 + np.sum((rear - film) ** 2, axis=-1)
        traced.append(np.prod(cell) * np.sum(probe.passes(film, rear) * square**-2.0))
    own = np.array([_lit(chosen, film) for film in wide.film[1:]])
    return np.abs(own / (np.array(traced[1:]) / traced[0]) - 1)


def _lit(scene, point):
    """Brightness of a film point [mm] in the picture of a cheaper camera, 1 on the axis."""
    if scene.camera.kind != "thick_lens":
        return 1.0
    setting = lens_setting(scene)
    pupil = setting.lens.first_order(setting.camera.wavelength_nm).exit_pupil
    distance, radius = setting.film_distance_mm - pupil.distance_mm, pupil.diameter_mm / 2
    steps = (np.arange(100) + 0.5) / 50 - 1
    disk = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    disk = disk[np.hypot(*disk.T) <= 1] * radius
    values = [
        np.mean((distance**2 + np.sum((disk - at) ** 2, axis=1)) ** -2.0) for at in (np.asarray(point), np.zeros(2))
    ]
    return values[0] / values[1]


def rounded(scene):
    """The scene with a round stop."""
    return change_scene(scene, camera={"aperture": {"shape": "circle"}})
