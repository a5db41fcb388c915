"""The circle of confusion: how wide the camera blurs a point, by where it is seen and how far away it is.

The diameter is that of the evenly lit disk whose light spreads as much (mean square distance) as that of the point; a
uniform round pupil out of focus makes exactly that disk. With u = 1 / distance it is, in pixels,
sqrt(a + b (u - focus) + c (u - focus)^2) / |scale + shift u|: a perfect lens has c alone, and the denominator tells how
the magnification depends on the distance when that is not counted from the entrance pupil.
"""

from __future__ import annotations

from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.movements import film_frame, half_film_mm
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics import UNMOVED, FilmFrame, Lens, blur_variances
from rptcam_cl.scene import Scene

Array = NDArray[np.float64]

NODES = 11  # across and down the film
# Of a tilted film, whose blur vanishes along a line: squares of it lie between nodes linearly, so that its least value
# is what the tilt makes of half a step.
FINE_NODES = 129
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
    frame = film_frame(scene.camera)
    if frame.is_flat:
        return np.zeros((1, 1))
    return frame.depth(frame.grid(half_film_mm(scene), FINE_NODES))


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
    square = _filled(square, lit)
    away = vergences - focus
    coefficients = square @ np.linalg.inv(np.vander(away, 3, increasing=True)).T * np.array([1.0, 1e-3, 1e-6])
    if not frame.is_flat and lit.all():
        coefficients = _finer(coefficients)
    table = np.concatenate([coefficients, np.zeros((*coefficients.shape[:2], 1))], axis=-1).astype(np.float32)
    return Blur(table, focus * 1e3, scale, shift * 1e-3, -length * 1e-3, by_depth=False)


def _finer(values: Array) -> Array:
    """Return values (NODES, NODES, n) at more nodes, by the cubics through the nearest four along each axis."""
    places = np.linspace(0, NODES - 1, FINE_NODES)
    first = np.clip(np.floor(places).astype(np.intp) - 1, 0, NODES - 4)
    weights = np.zeros((FINE_NODES, NODES))
    for node in range(4):
        others = [other for other in range(4) if other != node]
        factors = [(places - first - other) / (node - other) for other in others]
        weights[np.arange(FINE_NODES), first + node] = np.prod(factors, axis=0)
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
    count = NODES // 2 + 1 if symmetric else NODES
    film = frame.grid(half_film_mm, NODES)[-count:, -count:].reshape(-1, 2)
    variances, lit = blur_variances(lens, film_distance_mm, film, vergences, wavelength_nm, frame)
    variances, lit = variances.reshape(count, count, len(vergences), 2), lit.reshape(count, count)
    if symmetric:
        mirror = np.abs(np.arange(NODES) - NODES // 2)
        return variances[np.ix_(mirror, mirror)], lit[np.ix_(mirror, mirror)]
    return variances, lit


def _filled(values: Array, lit: NDArray[np.bool_]) -> Array:
    """Return the values (rows, columns, n) with dark nodes taking those of the nearest lit one."""
    if lit.all() or not lit.any():
        return values
    nodes = np.argwhere(lit)
    filled = values.copy()
    for dark in np.argwhere(~lit):
        filled[tuple(dark)] = values[tuple(nodes[np.argmin(np.sum((nodes - dark) ** 2, axis=1))])]
    return filled
