"""What a lens does to even light over the picture: its vignetting, and its blur of points at a distance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.calibration.view import View
from rptcam_cl.cameras import camera_model, film_frame, stop_shape
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Lens, film_irradiance
from rptcam_cl.scene import RealisticCamera, ThickLensCamera

Array = NDArray[np.float64]
Pixels = NDArray[np.float32]

RADII = 49  # from the axis to the farthest pixel, where a round lens is measured
NODES = (17, 13)  # across and down, where any other is


def vignetting_map(view: View) -> Pixels:
    """Return the irradiance of each pixel under a uniform world, over that of a pixel on the axis (rows, columns).

    By quadrature over the pupil, for the camera's wavelength.

    Raises
    ------
    InputError
        Of a film that is turned; of a lens that lets nothing through to the axis.
    """
    scene = view.scene
    columns, rows = view.size
    if not isinstance(scene.camera, RealisticCamera):
        return _ideal_falloff(view)
    setting, frame = view.setting, film_frame(scene.camera)
    assert setting is not None
    if not frame.is_flat:
        raise InputError("--vignetting: is known on a film across the axis alone (allowed: no tilt, no swing)")
    shape = stop_shape(scene, scene.camera.aperture)
    lens: Lens = setting.lens if shape is None else setting.lens.with_stop_shape(shape)
    back, wavelength = setting.film_distance_mm, setting.camera.wavelength_nm
    centre = float(film_irradiance(lens, back, 0.0, wavelength, transmission=setting.transmission))
    if not centre > 0:
        raise InputError(f"{lens.name}: no light reaches the axis on the film")
    x, y = np.arange(columns) + 0.5, np.arange(rows) + 0.5
    if lens.is_rotational and shape is None:
        film = view.film_points(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))[:, :2]
        distance = np.hypot(*film.T)
        radii = np.linspace(0.0, float(distance.max()), min(RADII, max(columns, rows)))
        values = film_irradiance(lens, back, radii, wavelength, transmission=setting.transmission) / centre
        return np.asarray(np.interp(distance**2, radii**2, values).reshape(rows, columns), np.float32)
    at = [np.linspace(0.0, side, count) for side, count in zip(view.size, NODES, strict=True)]
    film = view.film_points(np.stack(np.meshgrid(*at), axis=-1).reshape(-1, 2))[:, :2]
    nodes = [
        film_irradiance(
            lens, back, np.hypot(*point), wavelength, np.degrees(np.arctan2(point[1], point[0])), setting.transmission
        )
        for point in film
    ]
    return (between(np.array(nodes).reshape(NODES[::-1]), view.size) / centre).astype(np.float32)


def _ideal_falloff(view: View) -> Pixels:
    """Return 1 everywhere, or of a thick lens the fourth power of the cosine on the film."""
    columns, rows = view.size
    if not isinstance(view.scene.camera, ThickLensCamera):
        return np.ones((rows, columns), np.float32)
    setting = view.setting
    assert setting is not None
    x, y = np.arange(columns) + 0.5, np.arange(rows) + 0.5
    film = view.film_points(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))[:, :2]
    pupil = setting.lens.first_order(setting.camera.wavelength_nm).exit_pupil.distance_mm
    slope = np.sum(film**2, axis=1) / (setting.film_distance_mm - pupil) ** 2  # 0 for a pupil at infinity
    return np.asarray(((1.0 + slope) ** -2).reshape(rows, columns), np.float32)


def coc_map(view: View, distances_m: Sequence[float]) -> Pixels:
    """Return the diameter of the circle of confusion in each pixel [pixels], (distances, rows, columns).

    As the layer `coc` has it, of points at distances along the ray from the front of the camera.
    """
    blur = camera_model(view.scene).view.blur()
    x, y, width, height = view.window
    full = view.scene.film.resolution
    maps = []
    for distance in distances_m:
        away = 1.0 / distance - blur.focus
        a, b, c = (blur.table[..., k].astype(np.float64) for k in range(3))
        square = between(np.maximum(a + away * (b + away * c), 0.0), full)[y : y + height, x : x + width]
        maps.append(np.sqrt(square) / abs(blur.scale + blur.shift / distance))
    return np.stack(maps).astype(np.float32)


def between(nodes: Array, size: tuple[int, int]) -> Array:
    """Return values at the centres of pixels (rows, columns), between nodes spread evenly from edge to edge."""
    at = [(np.arange(count) + 0.5) / count * (have - 1) for count, have in zip(size, nodes.shape[::-1], strict=True)]
    (left, right), (top, down) = ((np.floor(one).astype(int), one % 1.0) for one in at)
    next_left, next_top = np.minimum(left + 1, nodes.shape[1] - 1), np.minimum(top + 1, nodes.shape[0] - 1)
    upper = nodes[np.ix_(top, left)] * (1 - right) + nodes[np.ix_(top, next_left)] * right
    lower = nodes[np.ix_(next_top, left)] * (1 - right) + nodes[np.ix_(next_top, next_left)] * right
    return np.asarray(upper * (1 - down[:, None]) + lower * down[:, None])
