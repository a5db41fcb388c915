"""What a lens does to even light over the picture: its vignetting, and its blur of points at a distance."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.calibration.view import View, check_distances
from rptcam_cl.cameras import camera_model, film_frame, stop_shape
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Lens, film_irradiance
from rptcam_cl.scene import RealisticCamera, ThickLensCamera

Array = NDArray[np.float64]
Pixels = NDArray[np.float32]
Mask = NDArray[np.bool_]

RADII = 25  # from the axis to the farthest pixel, where a round lens is measured first
ROUNDS = 6  # of halving the way between two of them, where straight lines err
PLANE_ROUNDS = 1  # the same of nodes
LINE_ERROR = 2e-3  # of the irradiance there that calls for halving, which takes three quarters of it
FAINT = 0.05  # of the light on the axis: of less, that share of this counts
LIT = 0.02  # of the light on the axis: in the dark beyond, a shaped stop is not compared with a round one
NODES = (17, 13)  # across and down, where lenses that are not round are measured, and shaped stops


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

    def light(of: Lens, radii: ArrayLike, degrees: float = 0.0) -> Array:
        return film_irradiance(of, back, radii, wavelength, degrees, setting.transmission)

    centre = float(light(lens, 0.0))
    if not centre > 0:
        raise InputError(f"{lens.name}: no light reaches the axis on the film")
    round_lens = lens if shape is None else lens.with_stop_shape(None)
    if not round_lens.is_rotational:
        values = _over_plane(view, lambda r, degrees: float(light(lens, r, degrees)) / centre)
        return between(values, view.size).astype(np.float32)
    x, y = np.arange(columns) + 0.5, np.arange(rows) + 0.5
    film = view.film_points(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))[:, :2]
    known, values = _along_radius(lambda r: light(round_lens, r), float(np.hypot(*film.T).max()))
    falloff = np.interp(np.sum(film**2, axis=1), known**2, values).reshape(rows, columns)
    if shape is None:
        return np.asarray(falloff / centre, np.float32)
    # what the shape of the stop takes is smooth up to the edge of the image circle, where the falloff is not
    last = known[values > LIT * values[0]].max()

    def share(r: float, degrees: float) -> float:
        r = min(r, last)
        return float(light(lens, r, degrees) / np.interp(r**2, known**2, values))

    return np.asarray(falloff * between(_over_plane(view, share), view.size) / centre, np.float32)


def _over_plane(view: View, value: Callable[[float, float], float]) -> Array:
    """Return values of radius and azimuth at nodes spread evenly over the picture, closer nodes where they bend."""
    known: dict[tuple[float, float], float] = {}

    def fill(nodes: Array, which: Mask) -> None:
        at = [np.linspace(0.0, side, count) for side, count in zip(view.size, nodes.shape[::-1], strict=True)]
        places = np.stack(np.meshgrid(*at), axis=-1)[which]
        points = [(round(float(x), 9), round(float(y), 9)) for x, y in view.film_points(places)[:, :2]]
        for point in points:
            if point not in known:
                known[point] = value(float(np.hypot(*point)), float(np.degrees(np.arctan2(point[1], point[0]))))
        nodes[which] = [known[point] for point in points]

    nodes = np.empty(NODES[::-1])
    fill(nodes, np.ones_like(nodes, bool))
    for _ in range(PLANE_ROUNDS):
        bend = np.zeros_like(nodes)
        bend[1:-1] = np.abs(np.diff(nodes, 2, axis=0))
        bend[:, 1:-1] = np.maximum(bend[:, 1:-1], np.abs(np.diff(nodes, 2, axis=1)))
        bent = bend > 4 * LINE_ERROR * np.maximum(np.abs(nodes), FAINT)  # straight lines err by a quarter at most
        size = (2 * nodes.shape[1] - 1, 2 * nodes.shape[0] - 1)
        near = np.zeros(size[::-1], bool)
        for down, across in np.argwhere(bent):
            near[max(2 * down - 2, 0) : 2 * down + 3, max(2 * across - 2, 0) : 2 * across + 3] = True
        finer = np.empty(near.shape)
        finer[::2, ::2] = nodes
        finer[1::2, ::2] = (nodes[1:] + nodes[:-1]) / 2
        finer[:, 1::2] = (finer[:, 2::2] + finer[:, :-2:2]) / 2
        fill(finer, near)
        nodes = finer
    return nodes


def _along_radius(light: Callable[[Array], Array], farthest: float) -> tuple[Array, Array]:
    """Return radii from the axis and the light there, so close that straight lines over their squares join it."""
    radii = np.linspace(0.0, farthest, RADII)
    values = light(radii)
    unsure = np.arange(RADII - 1)  # stretches by the index of their inner end
    for _ in range(ROUNDS):
        middle = (radii[unsure] + radii[unsure + 1]) / 2
        found = light(middle)
        error = np.abs(found - np.interp(middle**2, radii**2, values))
        bent = error > LINE_ERROR * np.maximum(found, FAINT * values[0])
        # a stretch is halved where it bends; its halves lie behind as many new radii as are before them
        at = unsure + 1
        radii, values = np.insert(radii, at, middle), np.insert(values, at, found)
        inner = unsure + np.arange(len(unsure))
        unsure = np.sort(np.concatenate([inner[bent], inner[bent] + 1]))
        if not unsure.size:
            break
    return radii, values


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

    As the layer `coc` has it, of points at distances along the ray from the front of the camera, infinite for far away.

    Raises
    ------
    InputError
        For no distances, and for one that is not above 0.
    """
    check_distances(distances_m)
    blur = camera_model(view.scene).view.blur()
    # the table counts along the film, on which a lens turns the picture over
    table = (blur.table[:, ::-1] if view.scene.camera.flip else blur.table[::-1]).astype(np.float64)
    x, y, width, height = view.window
    full = view.scene.film.resolution
    maps = []
    for distance in distances_m:
        away = 1.0 / distance - blur.focus
        a, b, c = (table[..., k] for k in range(3))
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
