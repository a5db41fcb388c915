"""The true outline of the exit pupil, seen from film points on the plane of the last vertex: the tight pupil.

Rays drawn inside the outline nearly all pass. The outline is kept as a star-shaped curve: a centre, two half axes, and
in their frame a radius r per direction, near 1. A point drawn by direction theta (uniform) and rho = r(theta) sqrt(u)
has the density 1 / (pi a b r(theta)^2), so any r that holds the pupil gives the same picture; a loose one only wastes
rays. Outlines stand at nodes of the film and are interpolated between them; they are wide enough to hold the pupils
traced between the nodes as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.optics.glass import WAVELENGTH_D
from rptcam_cl.optics.probe import FilmProbe, narrowed, searched

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DIRECTIONS = 64  # of the table, all round
FINER = 2  # directions traced per direction of the table
SCAN = 14
FARTHEST = 1.75  # in the frame of the box round the pupil
BISECTIONS = 7
RADIAL_NODES = 49
FILM_NODES = 9  # along each side of the film, for a lens without rotational symmetry
COARSE = (24, 24)
DENSE = (96, 96)
MARGIN = 0.003  # of the radius, beyond what was traced
FILM_MARGIN = 0.01  # the same for a grid over the film, whose nodes stand farther apart


@dataclass(frozen=True)
class PupilShapes:
    """Outlines of the pupil at nodes of the film.

    Attributes
    ----------
    radial : bool
        True: nodes lie along a film radius and u runs outwards along it; the lens is rotationally symmetric. False:
        nodes lie on a grid over the film and u, v run along x, y.
    x, y : arrays
        Film coordinates of the nodes [mm], increasing and evenly spaced; y is (0,) when radial.
    centres : (len(y), len(x), 2) array
        Centre of each outline on the plane of the last vertex [mm].
    axes : (len(y), len(x), 2) array
        Half axes along u and v [mm]; 0 where no light arrives.
    radii : (len(y), len(x), DIRECTIONS) array
        Radius in the frame of the axes, per direction k / DIRECTIONS of a turn.
    """

    radial: bool
    x: Array
    y: Array
    centres: Array
    axes: Array
    radii: Array


def pupil_shapes(
    lens: Lens, film_distance_mm: float, half_film_mm: tuple[float, float], wavelength_nm: float = WAVELENGTH_D
) -> PupilShapes:
    """Return the outlines of the pupil over the film.

    Parameters
    ----------
    lens : Lens
    film_distance_mm : float
        Last vertex to film.
    half_film_mm : (width, height)
        Half the sides of the film.
    wavelength_nm : float

    Raises
    ------
    InputError
        When no light reaches the film at all.
    """
    probe = FilmProbe(lens, film_distance_mm, wavelength_nm)
    if lens.is_rotational:
        x, y = np.linspace(0.0, _lit_radius(probe, float(np.hypot(*half_film_mm))), RADIAL_NODES), np.zeros(1)
    else:
        x, y = (np.linspace(-half, half, FILM_NODES) for half in half_film_mm)
    film = np.stack(np.meshgrid(_with_middles(x), _with_middles(y)), axis=-1)
    nodes = film[::2, ::2].copy()
    if lens.is_rotational:
        nodes[0, -1, 0] -= 0.1 * (x[1] - x[0])  # at the edge itself the pupil has closed
    centres, axes = _frames(probe, nodes)
    if not axes.any():
        raise InputError(f"{lens.name}: no light reaches the film {film_distance_mm:g} mm behind the lens")
    reach = _reach(probe, film, _between(centres), _between(axes))
    radii = _envelope(reach) * (1.0 + (MARGIN if lens.is_rotational else FILM_MARGIN))
    return PupilShapes(bool(lens.is_rotational), x, y, centres, axes, radii)


def _lit_radius(probe: FilmProbe, film_radius: float) -> float:
    """Return the film radius up to which light arrives, at most `film_radius`; found in two scans."""
    low, high = 0.0, film_radius
    for _ in range(2):
        radii = np.linspace(low, high, SCAN)
        film = np.stack([radii, np.zeros(SCAN)], axis=1)
        _, found = searched(probe, film, COARSE, DENSE)
        last = int(np.flatnonzero(found)[-1]) if found.any() else 0
        if last == SCAN - 1:
            return high
        low, high = radii[last], radii[last + 1]
    return float(high)


def _frames(probe: FilmProbe, nodes: Array) -> tuple[Array, Array]:
    """Return centres and half axes of boxes round the pupil at film points (rows, columns, 2); 0 where it is closed.

    A closed node next to open ones takes the mean of theirs, so that interpolation reaches the edge of the light.
    """
    film = nodes.reshape(-1, 2)
    boxes, found = searched(probe, film, COARSE, DENSE)
    boxes, again = narrowed(probe, film, boxes, COARSE)
    found &= again
    centres = np.stack([boxes[:, 0] + boxes[:, 1], boxes[:, 2] + boxes[:, 3]], axis=1) / 2
    axes = np.where(found[:, None], np.stack([boxes[:, 1] - boxes[:, 0], boxes[:, 3] - boxes[:, 2]], axis=1) / 2, 0.0)
    rows, columns = nodes.shape[:2]
    centres, axes, lit = (
        centres.reshape(rows, columns, 2),
        axes.reshape(rows, columns, 2),
        found.reshape(rows, columns, 1),
    )
    weight = _neighbours(lit.astype(np.float64))
    borrow = ~lit & (weight > 0)
    weight = np.maximum(weight, 1.0)
    return (
        np.where(borrow, _neighbours(np.where(lit, centres, 0.0)) / weight, centres),
        np.where(borrow, _neighbours(axes) / weight, axes),
    )


def _neighbours(values: Array) -> Array:
    """Return the sums over the 3 x 3 neighbourhoods of a grid (rows, columns, components)."""
    padded = np.pad(values, ((1, 1), (1, 1), (0, 0)))
    rows, columns = values.shape[:2]
    shifted = [padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    return np.asarray(np.sum(shifted, axis=0), dtype=np.float64)


def _with_middles(nodes: Array) -> Array:
    """Return nodes and the middles between them."""
    return np.interp(np.arange(2 * len(nodes) - 1) / 2, np.arange(len(nodes)), nodes)


def _between(values: Array) -> Array:
    """Return values at the nodes of a grid (rows, columns, components) and, by interpolation, at the middles."""
    for axis in (0, 1):
        if values.shape[axis] > 1:
            moved = np.moveaxis(values, axis, 0)
            fine = np.empty((2 * len(moved) - 1, *moved.shape[1:]))
            fine[::2], fine[1::2] = moved, (moved[1:] + moved[:-1]) / 2
            values = np.moveaxis(fine, 0, axis)
    return values


def _reach(probe: FilmProbe, film: Array, centres: Array, axes: Array) -> Array:
    """Return how far the pupil reaches in its frame, shape (rows, columns, FINER * DIRECTIONS).

    Along each direction the farthest passing of SCAN points is taken, then the edge behind it bisected; so an outline
    that is not star-shaped from the centre is still held.
    """
    shape = (*film.shape[:2], FINER * DIRECTIONS)
    mirrored = film.shape[0] == 1  # radial nodes: v and -v are alike
    count = shape[2] // 2 + 1 if mirrored else shape[2]
    angles = np.arange(count) * 2 * np.pi / shape[2]
    frame = axes[:, :, None, :] * np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def passing(rho: Array) -> Mask:
        return probe.passes(film[:, :, None, :], centres[:, :, None, :] + frame * rho[..., None])

    low = np.zeros((*shape[:2], count))
    step = FARTHEST / SCAN
    for k in range(1, SCAN + 1):
        rho = np.full(low.shape, k * step)
        low = np.where(passing(rho), rho, low)
    high = low + step
    lit = low > 0
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        inside = passing(middle)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    reach = np.where(lit.any(axis=2, keepdims=True), high, 0.0)
    return np.concatenate([reach, reach[..., -2:0:-1]], axis=2) if mirrored else reach


def _envelope(reach: Array) -> Array:
    """Return radii at the nodes that, interpolated over film and direction, hold the outlines traced at every point."""
    around = np.maximum(reach, np.maximum(np.roll(reach, 1, axis=2), np.roll(reach, -1, axis=2)))[..., ::FINER]
    for axis in (0, 1):
        if around.shape[axis] > 1:
            moved = np.moveaxis(around, axis, 0)
            nodes, middles = moved[::2].copy(), moved[1::2]
            nodes[:-1] = np.maximum(nodes[:-1], middles)
            nodes[1:] = np.maximum(nodes[1:], middles)
            around = np.moveaxis(nodes, 0, axis)
    return around
