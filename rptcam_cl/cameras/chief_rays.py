"""Chief rays: one ray for each place of the picture, through the middle of the opening, in float64.

They are the rays that a picture taken through the smallest opening is made of, so what they meet lies where the picture
shows it. Those of a real lens run from the film through the centre of its stop and on through every surface.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.film_grid import FilmGrid
from rptcam_cl.cameras.model import half_tangents
from rptcam_cl.cameras.movements import film_frame, half_film_mm
from rptcam_cl.cameras.setting import LensSetting, lens_setting
from rptcam_cl.cameras.thick_lens import thick_lens_of
from rptcam_cl.cameras.thin_lens import optics_of
from rptcam_cl.optics import ChiefRays, aimed_rays, film_chief_rays
from rptcam_cl.scene import (
    EnvironmentCamera,
    PinholeCamera,
    RealisticCamera,
    Scene,
    ThickLensCamera,
    ThinLensCamera,
    at_opening,
    unknown_camera,
)

Array = NDArray[np.float64]

NODES = 65  # across the film and down, at which chief rays are aimed
REACH = 1.25  # of these nodes, in half films, so that places beside the picture are known too


class CameraRays(ABC):
    """The chief rays of a camera, in its frame: x to the right, y up, looking along -z, the eye at the origin.

    Attributes
    ----------
    resolution : (width, height)
        Of the whole film [pixels]; places are columns and rows in it, and pixel (0, 0) covers 0 to 1.
    """

    def __init__(self, scene: Scene) -> None:
        self.resolution = scene.film.resolution
        self._sign = 1.0 if scene.camera.flip else -1.0

    @abstractmethod
    def rays(self, places: Array) -> tuple[Array, Array]:
        """Return origins [m] and unit directions (n, 3) of the chief rays of places (n, 2); nan where none passes."""

    def unlimited(self, places: Array) -> tuple[Array, Array]:
        """Return the same as if the lens had no rims."""
        return self.rays(places)

    def smooth(self, places: Array) -> tuple[Array, Array]:
        """Return about the same as `unlimited` in a part of its time, for searches."""
        return self.rays(places)

    @property
    def wraps(self) -> bool:
        """Whether the left edge of the picture follows its right edge."""
        return False

    def upright(self, places: Array) -> Array:
        """Return places (n, 2) right and up in the upright picture, to 1 at its edges."""
        film = 2.0 * np.asarray(places, np.float64) / self.resolution - 1.0
        return np.asarray(film * (self._sign, -self._sign))

    def on_picture(self, upright: Array) -> Array:
        """Return the places (n, 2) of what `upright` returns."""
        return np.asarray((upright * (self._sign, -self._sign) + 1.0) / 2.0 * self.resolution)


class _WholeSphere(CameraRays):
    """Of an environment camera."""

    def rays(self, places: Array) -> tuple[Array, Array]:
        longitude, latitude = (self.upright(places) * (np.pi, np.pi / 2)).T
        flat = np.cos(latitude)
        directions = np.stack([flat * np.sin(longitude), np.sin(latitude), -flat * np.cos(longitude)], axis=1)
        return np.zeros_like(directions), directions

    @property
    def wraps(self) -> bool:
        return True


class _Perspective(CameraRays):
    """Of an ideal camera: a film point h is joined to the scene by ``height h + z slope h``.

    Parameters
    ----------
    scene : Scene
    height, slope : float
        Factors of a film point [mm]: where its ray meets the plane at ``origin_z`` [m], and its tangent in the scene.
    film_slope : float
        The tangent behind the lens, likewise, by which a film that is tilted sees another point.
    origin_z : float
        Of that plane in the frame of the camera [m].
    """

    def __init__(self, scene: Scene, height: float, slope: float, film_slope: float, origin_z: float) -> None:
        super().__init__(scene)
        self._frame, self._half = film_frame(scene.camera), np.array(half_film_mm(scene))
        self._height, self._slope, self._film_slope, self._z = height, slope, film_slope, origin_z

    def rays(self, places: Array) -> tuple[Array, Array]:
        film = self._frame.points(-self.upright(places) * self._half)
        there = film[:, :2] / (1.0 + film[:, 2:] * self._film_slope)
        one = np.ones((len(there), 1))
        directions = np.hstack([self._slope * there, -one])
        origins = np.hstack([self._height * there, self._z * one])
        return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


class _Traced(CameraRays):
    """Of a lens, traced surface by surface; where rims stop the chief ray there is none."""

    def __init__(self, scene: Scene, setting: LensSetting) -> None:
        super().__init__(scene)
        self._frame, self._half = film_frame(scene.camera), np.array(half_film_mm(scene))
        self._lens, self._back, self._nm = setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm
        sides = np.linspace(-REACH, REACH, NODES)
        nodes = np.stack(np.meshgrid(sides, sides), axis=-1).reshape(-1, 2)
        rays = film_chief_rays(self._lens, self._film(nodes), self._nm)
        values = np.where(rays.found[:, None], np.hstack([rays.aims, *self._in_camera(rays)]), np.nan)
        self._grid = FilmGrid(values.reshape(NODES, NODES, -1), REACH)

    def rays(self, places: Array) -> tuple[Array, Array]:
        upright = self.upright(places)
        found = self._aimed(upright)
        return _kept(self._in_camera(found), found.clear)

    def unlimited(self, places: Array) -> tuple[Array, Array]:
        found = self._aimed(self.upright(places))
        return _kept(self._in_camera(found), found.found)

    def smooth(self, places: Array) -> tuple[Array, Array]:
        found = self._grid.at(self.upright(places))
        directions = found[:, 5:]
        return found[:, 2:5], directions / np.linalg.norm(directions, axis=1, keepdims=True)

    def _film(self, upright: Array) -> Array:
        """Return places right and up in the picture on the film (n, 3), in the frame of the lens [mm]: it inverts."""
        points = self._frame.points(-upright * self._half)
        points[:, 2] = self._lens.film_z(self._back) + self._lens.sense * points[:, 2]
        return points

    def _aimed(self, upright: Array) -> ChiefRays:
        return aimed_rays(self._lens, self._film(upright), self._grid.at(upright)[:, :2], self._nm)

    def _in_camera(self, rays: ChiefRays) -> tuple[Array, Array]:
        """Return origins [m] and directions in the frame of the camera."""
        return (rays.origins - [0.0, 0.0, self._lens.film_z(self._back)]) * 1e-3, rays.directions


def _kept(rays: tuple[Array, Array], keep: NDArray[np.bool_]) -> tuple[Array, Array]:
    origins, directions = (np.where(keep[:, None], each, np.nan) for each in rays)
    return origins, directions


def chief_rays(scene: Scene) -> CameraRays:
    """Return the chief rays of a scene's camera, whose focus is known.

    Raises
    ------
    InputError
        When the lens cannot be set as requested, and for a kind of camera whose chief rays are not known.
    """
    scene = at_opening(scene)
    camera = scene.camera
    if isinstance(camera, RealisticCamera):
        return _Traced(scene, lens_setting(scene))
    if isinstance(camera, ThickLensCamera):
        setting = lens_setting(scene)
        thick = thick_lens_of(setting.lens, setting.film_distance_mm, camera.wavelength_nm)
        first_vertex_m = -setting.lens.film_z(setting.film_distance_mm) * 1e-3
        height = thick.height[0] * 1e-3
        return _Perspective(scene, height, thick.slope[0], thick.film_slope[0], first_vertex_m)
    if isinstance(camera, ThinLensCamera | PinholeCamera):
        if isinstance(camera, PinholeCamera):
            across, _ = half_tangents(camera.fov_degrees, camera.fov_axis, scene.film)
        else:
            across, _, _ = optics_of(camera, scene.film)
        per_mm = across / half_film_mm(scene)[0]
        return _Perspective(scene, 0.0, -per_mm, per_mm, 0.0)
    if isinstance(camera, EnvironmentCamera):
        return _WholeSphere(scene)
    raise unknown_camera(scene.camera.kind, "its chief rays (rptcam_cl/cameras/chief_rays.py)")
