"""The true outline of the exit pupil, seen from film points on the plane of the last vertex: the tight pupil.

Rays drawn inside the outline nearly all pass. The outline is kept as a star-shaped curve: a centre, two half axes, and
in their frame a radius r per direction, near 1. A point drawn by direction theta (uniform) and rho = r(theta) sqrt(u)
has the density 1 / (pi a b r(theta)^2), so any r that holds the pupil gives the same picture; a loose one only wastes
rays. Outlines stand at nodes of the film and are interpolated between them; they are wide enough to hold the pupils
traced between the nodes as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.probe import FilmProbe, Wavelengths, narrowed

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DIRECTIONS = 64  # of the table, all round
RING_SCAN = 40  # points along a direction where the middle is obstructed, beside which slivers of light may pass
LIT_SCAN = 14  # film points
LIT_BISECTIONS = 8
FARTHEST = 1.75  # in the frame of the box round the pupil
COARSE = (16, 16)
FINE = (32, 16)  # half of a pupil, at one film point
NEAR = 1.0  # sizes of a pupil, round it, in which that of the next film point is sought
EDGE_NODES = 2  # nearest to the edge of the light, where the pupil closes faster than nodes follow
EDGE_MARGIN = 0.15


@dataclass(frozen=True)
class Fineness:
    """How finely outlines are traced; coarse ones are wider, and hold the pupil all but for slivers.

    Attributes
    ----------
    radial_nodes : int
        Along a film radius.
    film_nodes : int
        Along each side of the film, for a lens without rotational symmetry.
    directions : int
        Traced per direction of the table.
    scan, bisections : int
        Points along a direction, and steps between two of them.
    margin, film_margin : float
        Share of the radius beyond what was traced; for a grid over the film, whose nodes stand farther apart.
    """

    radial_nodes: int
    film_nodes: int
    directions: int
    scan: int
    bisections: int
    margin: float
    film_margin: float


FINE_OUTLINES = Fineness(41, 9, 2, 10, 6, 0.003, 0.01)
COARSE_OUTLINES = Fineness(9, 4, 1, 7, 4, 0.02, 0.04)


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
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: Wavelengths = LINE_D_NM,
    fineness: Fineness = FINE_OUTLINES,
) -> PupilShapes:
    """Return the outlines of the pupil over the film.

    Parameters
    ----------
    lens : Lens
    film_distance_mm : float
        Last vertex to film.
    half_film_mm : (width, height)
        Half the sides of the film.
    wavelength_nm : float or tuple
        With several, the outlines hold the pupil of each.
    fineness : Fineness
        `COARSE_OUTLINES` take a fifth of the time.

    Raises
    ------
    InputError
        When no light reaches the film at all.
    """
    probes = narrowing_probes(lens, film_distance_mm, wavelength_nm)
    if lens.is_rotational:
        lit = _lit_radius(probes, float(np.hypot(*half_film_mm)))
        x, y = np.linspace(0.0, lit, fineness.radial_nodes), np.zeros(1)
    else:
        x, y = (np.linspace(-half, half, fineness.film_nodes) for half in half_film_mm)
    film = np.stack(np.meshgrid(_with_middles(x), _with_middles(y)), axis=-1)
    nodes = film[::2, ::2].copy()
    if lens.is_rotational:
        nodes[0, -1, 0] -= 0.1 * (x[1] - x[0])  # at the edge itself the pupil has closed
    centres, axes = _frames(probes, nodes)
    if not axes.any():
        raise InputError(f"{lens.name}: no light reaches the film {film_distance_mm:g} mm behind the lens")
    reach = _reach(probes[-1], film, _between(centres), _between(axes), fineness)
    margin = fineness.margin if lens.is_rotational else fineness.film_margin
    radii = _envelope(reach, fineness.directions) * (1.0 + margin)
    if lens.is_rotational and x[-1] < np.hypot(*half_film_mm):
        radii[:, -EDGE_NODES:] *= 1.0 + EDGE_MARGIN
    return PupilShapes(bool(lens.is_rotational), x, y, centres, axes, radii)


def narrowing_probes(lens: Lens, film_distance_mm: float, wavelength_nm: Wavelengths) -> list[FilmProbe]:
    """Return probes of the lens with its stop ever smaller: first as wide as any rim, then half that, last its own.

    A small pupil slips through a grid over the rear element; the next wider one tells where to look for it.
    """
    stops = [lens]
    if lens.stop is not None and lens.stop_index is not None:
        widest = max(surface.semi_diameter for surface in lens.surfaces if np.isfinite(surface.semi_diameter))
        while (radius := _stop_radius(stops[0])) < widest:
            surfaces = list(lens.surfaces)
            surfaces[lens.stop_index] = replace(lens.stop, semi_diameter=2 * radius)
            stops.insert(0, replace(lens, surfaces=tuple(surfaces)))
    return [FilmProbe(stopped, film_distance_mm, wavelength_nm) for stopped in stops]


def _stop_radius(lens: Lens) -> float:
    assert lens.stop is not None
    return lens.stop.semi_diameter


def pupil_boxes(
    probes: list[FilmProbe], film: Array, shape: tuple[int, int] = COARSE, *, radial: bool = False
) -> tuple[Array, Mask]:
    """Return boxes (m, 4) round the pupil as seen from film points (m, 2), a cell wider, and where it is open.

    Film points along +x of a rotationally symmetric lens (`radial`) see pupils that are the same above as below, so
    that half of each is enough.
    """
    if radial:
        shape = (shape[0], shape[1] // 2)
    boxes = _upper(probes[-1].windows(film), radial)
    found = np.ones(len(film), dtype=bool)
    for probe in (*probes, probes[-1]):
        boxes, hit = narrowed(probe, film, boxes, shape)
        boxes = _upper(boxes, radial)
        found &= hit
    if not found.all():
        near = _upper(_paraxial_boxes(probes[-1], film[~found]), radial)
        for _ in range(2):
            near, again = narrowed(probes[-1], film[~found], near, shape)
            near = _upper(near, radial)
        boxes[~found] = near
        found[~found] = again
    if radial:
        _follow(probes[-1], film, boxes, found)
        boxes[:, 2] = -boxes[:, 3]
    return boxes, found


def _follow(probe: FilmProbe, film: Array, boxes: Array, found: Mask) -> None:
    """Find pupils that slipped through, near those of the film points before: they shrink and move step by step."""
    for k in range(1, len(film)):
        if found[k - 1] and not found[k]:
            boxes[k], found[k] = _near(probe, film[k : k + 1], boxes[k - 1])


def _near(probe: FilmProbe, film: Array, box: Array) -> tuple[Array, bool]:
    """Return the box round the pupil seen from one film point (1, 2), sought near another one's, and if it is open."""
    width, height = box[1] - box[0], box[3]
    around = np.array([[box[0] - NEAR * width, box[1] + NEAR * width, 0.0, (1.0 + NEAR) * height]])
    around, hit = narrowed(probe, film, around, FINE)
    return around[0], bool(hit[0])


def _upper(boxes: Array, radial: bool) -> Array:
    """Return boxes without their lower halves."""
    if radial:
        boxes[:, 2] = 0.0
    return boxes


def _paraxial_boxes(probe: FilmProbe, film: Array) -> Array:
    """Return boxes (m, 4) thrice as large as the paraxial exit pupil, on the plane of the last vertex."""
    pupil = probe.lens.first_order(probe.wavelength_nm).exit_pupil
    from_film = probe.distance - pupil.distance_mm
    if not (np.isfinite(from_film) and from_film != 0.0):
        return probe.windows(film)
    shrink = probe.distance / from_film
    centres, reach = film * (1.0 - shrink), 1.5 * abs(shrink) * pupil.diameter_mm
    low, high = centres - reach, centres + reach
    return np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1)


def _lit_radius(probes: list[FilmProbe], film_radius: float) -> float:
    """Return the film radius up to which light arrives, at most `film_radius`: by a scan and by following the pupil."""
    radii = np.linspace(0.0, film_radius, LIT_SCAN)
    boxes, found = pupil_boxes(probes, np.stack([radii, np.zeros(LIT_SCAN)], axis=1), radial=True)
    last = int(np.flatnonzero(found)[-1]) if found.any() else 0
    if last == LIT_SCAN - 1 or not found[last]:
        return float(film_radius)
    low, high, box = radii[last], radii[last + 1], boxes[last]
    for _ in range(LIT_BISECTIONS):
        middle = (low + high) / 2
        there, hit = _near(probes[-1], np.array([[middle, 0.0]]), box)
        low, high, box = (middle, high, there) if hit else (low, middle, box)
    return float(high)


def _frames(probes: list[FilmProbe], nodes: Array) -> tuple[Array, Array]:
    """Return centres and half axes of boxes round the pupil at film points (rows, columns, 2); 0 where it is closed.

    A closed node next to open ones takes the mean of theirs, so that interpolation reaches the edge of the light.
    """
    boxes, found = pupil_boxes(probes, nodes.reshape(-1, 2), radial=len(nodes) == 1)
    rows, columns = nodes.shape[:2]
    lit = found.reshape(rows, columns, 1)
    low, high = boxes[:, ::2].reshape(rows, columns, 2), boxes[:, 1::2].reshape(rows, columns, 2)
    centres, axes = (low + high) / 2, np.where(lit, (high - low) / 2, 0.0)
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


def _reach(probe: FilmProbe, film: Array, centres: Array, axes: Array, fineness: Fineness) -> Array:
    """Return how far the pupil reaches in its frame, shape (rows, columns, directions).

    Along each direction points are tried from the outside inwards until one passes, then the edge behind it is
    bisected; so an outline that is not star-shaped from the centre is still held.
    """
    shape = (*film.shape[:2], fineness.directions * DIRECTIONS)
    mirrored = film.shape[0] == 1  # radial nodes: v and -v are alike
    count = shape[2] // 2 + 1 if mirrored else shape[2]
    angles = np.arange(count) * 2 * np.pi / shape[2]
    frame = axes[:, :, None, :] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points, origins = (np.broadcast_to(values[:, :, None, :], frame.shape) for values in (film, centres))
    scan = RING_SCAN if probe.lens.is_obstructed else fineness.scan
    step = FARTHEST / scan

    def passing(rho: Array, of: Mask) -> Mask:
        return probe.passes(points[of], origins[of] + frame[of] * rho[:, None])

    low = np.zeros((*shape[:2], count))
    for k in range(scan, 0, -1):
        dark = low == 0.0
        low[dark] = np.where(passing(np.full(int(dark.sum()), k * step), dark), k * step, 0.0)
    high, lit = low + step, low > 0
    for _ in range(fineness.bisections):
        middle = (low[lit] + high[lit]) / 2
        inside = passing(middle, lit)
        low[lit], high[lit] = np.where(inside, middle, low[lit]), np.where(inside, high[lit], middle)
    reach = np.where(lit.any(axis=2, keepdims=True), high, 0.0)
    return np.concatenate([reach, reach[..., -2:0:-1]], axis=2) if mirrored else reach


def _envelope(reach: Array, directions: int) -> Array:
    """Return radii at the nodes that, interpolated over film and direction, hold the outlines traced at every point."""
    around = np.maximum(reach, np.maximum(np.roll(reach, 1, axis=2), np.roll(reach, -1, axis=2)))[..., ::directions]
    for axis in (0, 1):
        if around.shape[axis] > 1:
            moved = np.moveaxis(around, axis, 0)
            nodes, middles = moved[::2].copy(), moved[1::2]
            nodes[:-1] = np.maximum(nodes[:-1], middles)
            nodes[1:] = np.maximum(nodes[1:], middles)
            around = np.moveaxis(nodes, 0, axis)
    return around
