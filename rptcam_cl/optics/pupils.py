"""Outlines of the exit pupil as points of the film see it, and at every width of a round stop."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import film_probe
from rptcam_cl.optics.beams import ChiefRays, round_chief_rays
from rptcam_cl.optics.lens import Lens, limiting_surface
from rptcam_cl.optics.ray_trace import trace_crossings

#
# The true outline of the exit pupil, seen from film points on the plane of the last vertex: the tight pupil.
#
# Rays drawn inside the outline nearly all pass. The outline is kept as a star-shaped curve: a centre, two half axes,
# and in their frame a radius r per direction, near 1. A point drawn by direction theta (uniform) and rho = r(theta)
# sqrt(u) has the density 1 / (pi a b r(theta)^2), so any r that holds the pupil gives the same picture; a loose one
# only wastes rays. Outlines stand at nodes of the film and are interpolated between them; they are wide enough to
# hold the pupils traced between the nodes as well.
#
# Nodes lie on lines from the axis outwards, up to where the light ends or the film: there pupils close to slivers,
# and on a grid of squares would close within a cell. A round lens and a film across its axis need one line.

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DIRECTIONS = 64  # of the table, all round
_RING_SCAN = 40  # points along a direction where the middle is obstructed, beside which slivers of light may pass
_SLIVER_SCAN = 8  # as many points beside each of them
_LIT_SCAN = 14  # film points
_LIT_BISECTIONS = 8
_EDGE_NODES = 2  # nearest to the edge of the light, where the pupil closes faster than nodes follow
_EDGE_MARGIN = 0.15
_LINE_EDGE_MARGIN = 0.03  # the same on lines, whose nodes are dense there
_HOLE_MARGIN = 0.004  # share of the pupil's radius by which its hole is taken smaller than it was traced
_BEYOND_LIT = 0.0005  # share of the way to the edge of the light by which lines of a lens that is not round go on


@dataclass(frozen=True)
class Fineness:
    """How finely outlines are traced; coarse ones are wider, and hold the pupil all but for slivers.

    Attributes
    ----------
    radial_nodes : int
        Along a film radius, where one line is enough.
    line_nodes : int
        Along each line of a lens without rotational symmetry.
    lines, round_lines : int
        In a quarter of a turn, of such a lens, and of a round one before a film that is tilted.
    directions : int
        Traced per direction of the table.
    scan, bisections : int
        Points along a direction, and steps between two of them.
    margin, tilted_margin : float
        Share of the radius beyond what was traced; for a round lens before a film that is tilted.
    farthest : float
        How far they are sought in their frame.
    """

    radial_nodes: int
    line_nodes: int
    lines: int
    round_lines: int
    directions: int
    scan: int
    bisections: int
    margin: float
    tilted_margin: float
    farthest: float = 1.75


FINE_OUTLINES = Fineness(41, 21, 8, 2, 2, 10, 6, 0.003, 0.006)
FINEST_OUTLINES = Fineness(161, 41, 16, 4, 2, 120, 6, 0.003, 0.006)  # where the fine ones lose light
COARSE_OUTLINES = Fineness(9, 7, 3, 1, 1, 7, 4, 0.02, 0.02)


@dataclass(frozen=True)
class PupilShapes:
    """Outlines of the pupil at nodes of the film.

    Attributes
    ----------
    reach : (lines,) array
        How far from the axis each line goes [mm], of one line (a lens without need of more) or of lines all round:
        line k has the direction `direction_of(4 k / lines)`. Nodes lie evenly on each, the first on the axis.
    centres : (lines, nodes, 2) array
        Centre of each outline on the plane of the last vertex [mm], along the line and a quarter of a turn ahead.
    axes : (lines, nodes, 2) array
        Half axes in the same directions [mm]; 0 where no light arrives.
    radii : (lines, nodes, DIRECTIONS) array
        Radius in the frame of the axes, per direction k / DIRECTIONS of a turn.
    inner : array like radii, or None
        Within what radius nothing passes, of lenses whose middle is obstructed.
    opens : (lines, nodes, 2) array, or None
        Directions [turns, to 0.5] from which and up to which light passes, and in their mirror images, of crescents.
    """

    reach: Array
    centres: Array
    axes: Array
    radii: Array
    inner: Array | None = None
    opens: Array | None = None

    @property
    def radial(self) -> bool:
        """Whether one line stands for all."""
        return len(self.reach) == 1


def direction_of(quarters: float) -> tuple[float, float]:
    """Return the unit vector at a place round the axis, 0 to 4: on the square |x| + |y| = 1 it goes evenly."""
    x, y = abs(quarters % 4 - 2) - 1, abs((quarters + 3) % 4 - 2) - 1
    length = float(np.hypot(x, y))
    return x / length, y / length


def quarters_of(points: Array) -> Array:
    """Return the places round the axis of points (..., 2), the inverse of `direction_of`."""
    x, y = points[..., 0], points[..., 1]
    share = y / np.maximum(np.abs(x) + np.abs(y), 1e-300)
    return np.asarray(np.where(x >= 0, share, 2 - share) % 4)


def pupil_shapes(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: film_probe.Wavelengths = LINE_D_NM,
    fineness: Fineness = FINE_OUTLINES,
    frame: film_probe.FilmFrame = film_probe.UNMOVED,
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
    frame : FilmFrame
        How the film stands.

    Raises
    ------
    InputError
        When no light reaches the film at all.
    """
    if lens.is_rotational and frame.is_flat:
        radius = float(np.hypot(*frame.corners(half_film_mm)[:, :2].T).max()) if frame.is_moved else None
        line = _one_line(lens, film_distance_mm, radius or float(np.hypot(*half_film_mm)), wavelength_nm, fineness)
    else:
        line = _lines(lens, film_distance_mm, half_film_mm, wavelength_nm, fineness, frame)
    if not line.axes.any():
        raise InputError(f"{lens.name}: no light reaches the film {film_distance_mm:g} mm behind the lens")
    return line


def shared_shapes(
    states: Sequence[tuple[Lens, float]], radius_mm: float, wavelength_nm: film_probe.Wavelengths = LINE_D_NM
) -> PupilShapes:
    """Return outlines along one line that hold the pupils of a round lens in several states.

    Parameters
    ----------
    states
        The lens, and its last vertex to film [mm]. A film point of another state than the first stands at the place of
        the first's that lies in its direction from the last vertex.
    radius_mm
        Of the film of the first.
    """
    (lens, film_distance_mm), *others = states
    return _one_line(lens, film_distance_mm, radius_mm, wavelength_nm, FINE_OUTLINES, others)


def _one_line(
    lens: Lens,
    film_distance_mm: float,
    radius_mm: float,
    wavelength_nm: film_probe.Wavelengths,
    fineness: Fineness,
    others: Sequence[tuple[Lens, float]] = (),
) -> PupilShapes:
    every = (lens, film_distance_mm), *others
    states = [(film_probe.narrowing_probes(each, mm, wavelength_nm), mm / film_distance_mm) for each, mm in every]
    probes = states[0][0]
    probed = [(of[-1], scale) for of, scale in states]
    if lens.is_obstructed and (ring := _ring_line(probed, radius_mm, _of_rings(fineness))):
        return ring
    # Coarse outlines find out by tracing them whether light reaches the corner; fine ones find how far it reaches.
    lit = radius_mm
    if fineness is not COARSE_OUTLINES:
        lit = max(_lit_radius(of, radius_mm * scale, radial=True) / scale for of, scale in states)
    film = _film_line(lit, fineness.radial_nodes)
    centres, axes = _frames(probes, film, radial=True, soon=fineness is COARSE_OUTLINES)
    if fineness is COARSE_OUTLINES and not axes.all():
        lit = _lit_radius(probes, radius_mm, radial=True)
        film = _film_line(lit, fineness.radial_nodes)
        centres, axes = _frames(probes, film, radial=True)
    frames = between(centres), between(axes)
    reach = np.max([reach_of(of[-1], scale * film, *frames, fineness, mirrored=True) for of, scale in states], axis=0)
    radii = _envelope(reach[None], fineness.directions) * (1.0 + fineness.margin)
    if fineness is FINEST_OUTLINES:
        radii = _from_neighbours(radii, radii == 0.0)
    if lit < radius_mm:
        radii[:, -_EDGE_NODES:] *= 1.0 + _EDGE_MARGIN
    return PupilShapes(np.array([lit]), centres[None], axes[None], radii)


#
# Pupils of a round lens that something in the middle obstructs: rings, farther out crescents. Seen in the frame of the
# stop's rim, their outer edge, even thin ones are smooth.

_RING_FARTHEST = 1.1  # in that frame
_RING_OUTLINES = replace(FINE_OUTLINES, bisections=9, margin=0.001, farthest=_RING_FARTHEST)
_COARSE_RINGS = replace(_RING_OUTLINES, radial_nodes=11, bisections=6, margin=0.004)
_RING_NODES = 20, 161  # as many as a ring moves by its radius over the film, at most
_RIM_STEPS = 4  # of a secant towards the rim
_TIP_SCAN, _TIP_BISECTIONS = 16, 5  # points along a direction by which it is seen whether a crescent reaches it
_TIP_ROOM = 0.01  # of its radius, to both sides of where light passes in the next direction
_TIP_MARGIN = 2e-4  # turns
STRAIGHT = 6  # directions beside a crescent, to which its edges go on


def _of_rings(fineness: Fineness) -> Fineness:
    return _COARSE_RINGS if fineness is COARSE_OUTLINES else _RING_OUTLINES


def _ring_line(
    states: Sequence[tuple[film_probe.FilmProbe, float]], radius_mm: float, fineness: Fineness
) -> PupilShapes | None:
    """Return outlines along one line and the holes in them; None where the rim of the stop is not seen or no light.

    Parameters
    ----------
    states
        Probes, and the scale of their films.
    """

    def seen(film: Array) -> tuple[Array, ...]:
        frames = _stop_frames(states[0][0], film)
        edges = [_edges(of, scale * film, frames, fineness, mirrored=True, holed=True) for of, scale in states]
        return *frames, np.max([reach for reach, _ in edges], axis=0), np.min([hole for _, hole in edges], axis=0)

    radii = np.linspace(0.0, radius_mm, _LIT_SCAN)
    film = np.stack([radii, np.zeros(_LIT_SCAN)], axis=1)
    lit = np.flatnonzero(seen(film)[2].any(axis=1))
    if not len(lit):
        return None
    low = high = radii[lit[-1]]
    for k in range(1, _LIT_BISECTIONS + 1) if low < radius_mm else ():
        high = low + radius_mm / (_LIT_SCAN - 1) / 2**k
        low = high if seen(np.array([[high, 0.0]]))[2].any() else low
    (centres,), (axes,) = _stop_frames(states[0][0], np.array([[high, 0.0]]))
    if not np.isfinite([centres, axes]).all():
        return None
    nodes = int(np.clip(_RING_NODES[0] * abs(centres[0]) / axes[0], fineness.radial_nodes, _RING_NODES[1]))
    film = _film_line(high, nodes)
    centres, axes, reach, holes = seen(film)
    if not reach.any():
        return None
    opens = _held_tips(np.stack([*_tips(states, film, (centres, axes), reach, holes)]))
    bright = reach > 0
    outer = _held(reach, bright) * (1.0 + fineness.margin)
    inner = np.maximum(-_held(-holes, bright) - fineness.margin, 0.0)
    return PupilShapes(np.array([high]), centres[None, ::2], axes[None, ::2], outer[None], inner[None], opens[None])


def _tips(
    states: Sequence[tuple[film_probe.FilmProbe, float]],
    film: Array,
    frames: tuple[Array, Array],
    reach: Array,
    holes: Array,
) -> Iterator[Array]:
    """Yield in which directions [turns] the upper halves of crescents begin and end (points,); not a number where dark.

    Between the last direction of which rays pass and the next one, directions are bisected.
    """
    count = reach.shape[1]
    lit, rows = reach[:, : count // 2 + 1] > 0, np.arange(len(film))
    for first, out in ((np.argmax(lit, axis=1), -1), (count // 2 - np.argmax(lit[:, ::-1], axis=1), 1)):
        ends = (first == 0) | (first == count // 2)
        low, high, near = first[:, None] + 0.0, first[:, None] + out * ~ends[:, None], (first - out) % count
        far, hole = reach[rows, first], np.where(np.isfinite(holes[rows, first]), holes[rows, first], 0.0)
        other = holes[rows, near]
        bend = np.where(np.isfinite(other), 1.5 * np.abs(hole - other), 0.0) + _TIP_ROOM
        shares = np.linspace(0.0, 1.0, _TIP_SCAN)
        rho = hole[:, None] - bend[:, None] + shares * (far - hole + bend + _TIP_ROOM)[:, None]
        for _ in range(_TIP_BISECTIONS):
            turns = (low + high) / 2 * (2 * np.pi / count)
            points = (
                frames[0][:, None] + frames[1][:, None] * np.stack([np.cos(turns), np.sin(turns)], -1) * rho[..., None]
            )
            passed = [of.passes(scale * film[:, None], points) for of, scale in states]
            bright = np.any(passed, axis=(0, 2))[:, None]
            low, high = np.where(bright, (low + high) / 2, low), np.where(bright, high, (low + high) / 2)
        yield np.where(lit.any(axis=1), high[:, 0] / count, np.nan)


def _held_tips(tips: Array) -> Array:
    """Return where crescents begin and end (nodes, 2), held between nodes too, from both at all points (2, points)."""
    points = np.arange(tips.shape[1])
    lit = np.isfinite(tips[0])
    wide = np.stack(
        [-np.interp(points, points[lit], tips[0, lit]), np.interp(points, points[lit], tips[1, lit])], axis=1
    )
    nodes = wide[::2].copy()
    short = np.maximum(wide - between(nodes), 0.0)
    short[wide >= [0.0, 0.5]] = 0.5  # a ring becomes a crescent at once
    for padded in (np.pad(short, ((1, 0), (0, 0)))[:-1], np.pad(short, ((0, 1), (0, 0)))[1:]):
        nodes += padded[::2]
    nodes[nodes[:, 0] < 0, 0] += _TIP_MARGIN
    return np.asarray(np.clip(nodes * [-1.0, 1.0], 0.0, 0.5))


def _stop_frames(probe: film_probe.FilmProbe, film: Array) -> tuple[Array, Array]:
    """Return centres and half axes (points, 2) of the stop's rim seen from points on +x; not a number if it is not."""
    lens, nm = probe.lens, probe.wavelength_nm
    stop, pupil = limiting_surface(lens, nm), lens.first_order(nm).exit_pupil
    away = probe.distances(film)
    chief, turns = _chief(lens, away, film, nm), np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])
    size = np.abs(pupil.diameter_mm / 2 * away / (away - pupil.distance_mm))
    reach = np.repeat(size, 3).reshape(-1, 3, 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        for _ in range(_RIM_STEPS):
            points = chief.aims[:, None, :2] + reach * turns
            heights = _stop_heights(lens, np.repeat(away, 3), np.repeat(film[:, 0], 3), points.reshape(-1, 2), nm)
            reach *= lens.surfaces[stop].semi_diameter / heights.reshape(reach.shape)
    right, left, up = np.moveaxis(reach[..., 0], 1, 0)
    centres = np.stack([chief.aims[:, 0] + (right - left) / 2, np.zeros(len(film))], axis=1)
    return centres, np.stack([(right + left) / 2, up], axis=1)


def _held(values: Array, lit: Mask) -> Array:
    """Return values (nodes, DIRECTIONS) that, interpolated, hold those at points and directions between them too.

    Parameters
    ----------
    values, lit
        (points, directions) as of `_RING_OUTLINES`, and where any ray passes; beside those they go on straight.
    """
    whole = _continued(values, lit)
    nodes = whole[::2, ::2]
    fine = between(nodes)
    fine = np.stack([fine, (fine + np.roll(fine, -1, axis=1)) / 2], axis=2).reshape(values.shape)
    short = np.where(lit, np.maximum(whole - fine, 0.0), 0.0)
    return np.asarray(nodes + _envelope(short[None], _RING_OUTLINES.directions)[0])


def _continued(values: Array, lit: Mask) -> Array:
    """Return values (points, directions) whose dark directions go on from the nearest lit one, at first straight."""
    any_lit = np.flatnonzero(lit.any(axis=1))
    nearest = any_lit[np.argmin(np.abs(np.arange(len(lit))[:, None] - any_lit), axis=1)]
    values, lit = values[nearest], lit[nearest]
    count = values.shape[1]
    away = np.where(lit, 0, count)
    sense = np.zeros(lit.shape, int)
    for step in range(1, count // 2 + 1):
        for out in (-1, 1):
            found = (away == count) & np.roll(lit, out * step, axis=1)
            away[found], sense[found] = step, out
    columns, rows = np.arange(count), np.arange(len(lit))[:, None]
    near, before = (columns - sense * away) % count, (columns - sense * (away + 1)) % count
    slope = np.where(lit[rows, before], values[rows, near] - values[rows, before], 0.0)
    with np.errstate(invalid="ignore"):
        slope = np.maximum(np.nan_to_num(slope), 0.0)  # those that close end at corners
        return np.where(lit, values, values[rows, near] + np.minimum(away, STRAIGHT) * slope)


def _inner(holes: Array, radii: Array, fineness: Fineness, closes: Mask, margin: float) -> Array:
    """Return radii at the nodes within which nothing passes between them either; 0 next to where the light ends."""
    held = _envelope(-holes, fineness.directions)
    held = -_from_neighbours(held, np.isinf(held))
    inner = np.maximum(np.where(np.isfinite(held), held, 0.0) - margin * radii, 0.0)
    inner[closes, -_EDGE_NODES:] = 0.0
    return inner


def _lines(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: film_probe.Wavelengths,
    fineness: Fineness,
    frame: film_probe.FilmFrame,
) -> PupilShapes:
    """Return outlines along lines all round the axis; their neighbours hold what lines in between see."""
    ring = lens.is_obstructed and lens.is_rotational
    if ring:
        of = _of_rings(fineness)
        fineness = replace(fineness, bisections=of.bisections, tilted_margin=of.margin, farthest=of.farthest)
    count = 8 * (fineness.round_lines if lens.is_rotational else fineness.lines)
    turns = [direction_of(4 * k / count) for k in range(count)]
    like = _alike(lens, frame, count)
    probes = {
        k: film_probe.narrowing_probes(lens, film_distance_mm, wavelength_nm, frame, turns[k])
        for k in sorted({k for k, _ in like})
    }
    ends = _film_ends(frame, half_film_mm, turns)
    lit_radii = {k: _lit_radius(probe, float(ends[k])) if ends[k] > 0 else 0.0 for k, probe in probes.items()}
    lit = np.array([lit_radii[k] for k, _ in like])
    reach = _lengthen(np.where(lit < ends, (1.0 + _BEYOND_LIT) * lit, ends))
    centres, axes = _frames_of_lines(probes, reach, like, fineness.line_nodes, ring)
    edges, holes = _edges_of_lines(probes, reach, like, (centres, axes), fineness, holed=lens.is_obstructed)
    margin = fineness.tilted_margin if lens.is_rotational else fineness.margin
    radii = _envelope(edges, fineness.directions) * (1.0 + margin)
    if lens.is_obstructed or fineness is FINEST_OUTLINES:
        radii = _from_neighbours(radii, radii == 0.0)
    radii[(lit < ends)[::2], -_EDGE_NODES:] *= 1.0 + _LINE_EDGE_MARGIN
    margin = margin if ring else _HOLE_MARGIN
    inner = _inner(holes, radii, fineness, (lit < ends)[::2], margin) if np.isfinite(holes).any() else None
    return PupilShapes(reach[::2], centres[::2, ::2], axes[::2, ::2], radii, inner)


def _frames_of_lines(
    probes: dict[int, list[film_probe.FilmProbe]], reach: Array, like: list[tuple[int, bool]], nodes: int, ring: bool
) -> tuple[Array, Array]:
    """Return centres and half axes (lines, places, 2) of the pupil along each line; of every second by its neighbours.

    Parameters
    ----------
    like
        As of `_alike`: what is found on one line counts for those that see the same.
    """
    centres, axes = np.zeros((2, len(like), 2 * nodes - 1, 2))
    for k in range(0, len(like), 2):
        other, mirrored = like[k]
        if other == k and reach[k] > 0:
            line = _closing_line(reach[k], nodes)
            found = _stop_frames(probes[k][-1], line[::2]) if ring else ()
            if not (ring and np.isfinite(found).all()):
                found = _frames(probes[k], line)
            centres[k], axes[k] = (between(values) for values in found)
        centres[k], axes[k] = centres[other] * (1.0, -1.0 if mirrored else 1.0), axes[other]
    for values in (centres, axes):
        values[1::2] = (values[::2] + np.roll(values[::2], -1, axis=0)) / 2
    return centres, axes


def _edges_of_lines(
    probes: dict[int, list[film_probe.FilmProbe]],
    reach: Array,
    like: list[tuple[int, bool]],
    frames: tuple[Array, Array],
    fineness: Fineness,
    *,
    holed: bool,
) -> tuple[Array, Array]:
    """Return where the pupil ends along each line (lines, places, directions), and its hole; the others as before."""
    nodes, (centres, axes) = fineness.line_nodes, frames
    edges, holes = np.zeros((2, len(like), 2 * nodes - 1, fineness.directions * DIRECTIONS))
    holes[:] = np.inf
    for k, (other, mirrored) in enumerate(like):
        if other == k and axes[k].any():
            seen = probes[k][-1], _closing_line(reach[k], nodes), (centres[k], axes[k]), fineness
            edges[k], holes[k] = _edges(*seen, mirrored=False, holed=holed)
        for values in (edges, holes):
            values[k] = np.roll(values[other][:, ::-1], 1, axis=1) if mirrored else values[other]
    return edges, holes


def _alike(lens: Lens, frame: film_probe.FilmFrame, count: int) -> list[tuple[int, bool]]:
    """Return for each line which one sees the same pupils, itself or one before it, and whether in a mirror."""
    even = all(surface.is_even for surface in lens.surfaces)
    left_right = even and frame.centre[0] == 0.0 and frame.across == (1.0, 0.0, 0.0)
    up_down = even and frame.centre[1] == 0.0 and frame.up == (0.0, 1.0, 0.0)
    pairs = []
    for k in range(count):
        same = [(k, False)]
        if left_right:
            same.append(((count // 2 - k) % count, True))
        if up_down:
            same.append((-k % count, True))
        if left_right and up_down:
            same.append(((k + count // 2) % count, False))
        pairs.append(min(same))
    return pairs


def _film_ends(
    frame: film_probe.FilmFrame, half_film_mm: tuple[float, float], turns: list[tuple[float, float]]
) -> Array:
    """Return how far lines have to go, so that lines and what lies between them hold the film."""
    fine = 8
    quarters = np.arange(fine * len(turns)) * 4 / (fine * len(turns))
    corners = quarters_of(frame.corners(half_film_mm)[:, :2])
    lengths = frame.reach(half_film_mm, np.array([direction_of(q) for q in [*quarters.tolist(), *corners.tolist()]]))
    place = np.concatenate([np.arange(len(quarters)) / fine, corners * len(turns) / 4])
    apart = np.abs((place - np.arange(len(turns))[:, None] + len(turns) / 2) % len(turns) - len(turns) / 2)
    return np.asarray(np.where(apart <= 2.0, lengths, 0.0).max(axis=1))


def _lengthen(reach: Array) -> Array:
    """Return lengths of lines that, interpolated from every second one, are at least those of the ones in between."""
    even, odd = reach[::2].copy(), reach[1::2]
    with np.errstate(divide="ignore", invalid="ignore"):
        short = np.maximum(np.nan_to_num(odd / ((even + np.roll(even, -1)) / 2), nan=1.0, posinf=1.0), 1.0)
    even *= np.maximum(short, np.roll(short, 1))
    held = np.empty_like(reach)
    held[::2], held[1::2] = even, (even + np.roll(even, -1)) / 2
    return held


def _film_line(reach: float, nodes: int) -> Array:
    """Return points (2 nodes - 1, 2) on a line of a length: the nodes and the middles between them."""
    x = _with_middles(np.linspace(0.0, reach, nodes))
    return np.stack([x, np.zeros(len(x))], axis=1)


def _closing_line(reach: float, nodes: int) -> Array:
    """Return the same, ever denser towards the end, where pupils close: at 1 - (1 - t)^2 of the way for even t."""
    x = reach * (1.0 - (1.0 - _with_middles(np.linspace(0.0, 1.0, nodes))) ** 2)
    return np.stack([x, np.zeros(len(x))], axis=1)


def _lit_radius(probes: list[film_probe.FilmProbe], film_radius: float, *, radial: bool = False) -> float:
    """Return the film radius up to which light arrives, at most `film_radius`: by a scan and by following the pupil."""
    radii = np.linspace(0.0, film_radius, _LIT_SCAN)
    film = np.stack([radii, np.zeros(_LIT_SCAN)], axis=1)
    boxes, lit = film_probe.pupil_boxes(probes, film, radial=radial, in_order=True)
    last = int(np.flatnonzero(lit)[-1]) if lit.any() else 0
    if last == _LIT_SCAN - 1 or not lit[last]:
        return float(film_radius)
    low, high, box = radii[last], radii[last + 1], boxes[last]
    for _ in range(_LIT_BISECTIONS):
        middle = (low + high) / 2
        there, hit = film_probe.box_near(probes[-1], np.array([[middle, 0.0]]), box, radial=radial)
        low, high, box = (middle, high, there) if hit else (low, middle, box)
    return float(high)


def _frames(
    probes: list[film_probe.FilmProbe], film: Array, *, radial: bool = False, soon: bool = False
) -> tuple[Array, Array]:
    """Return centres and half axes of boxes round the pupil at the nodes of a line (nodes, 2); 0 where it is closed.

    A closed node next to open ones takes the mean of theirs, so that interpolation reaches the edge of the light.
    """
    nodes = film[::2].copy()
    nodes[-1, 0] -= 0.1 * (nodes[1, 0] - nodes[0, 0])  # at the edge itself the pupil has closed
    boxes, is_lit = film_probe.pupil_boxes(probes, nodes, radial=radial, in_order=True, soon=soon)
    lit = is_lit[:, None]
    low, high = boxes[:, ::2], boxes[:, 1::2]
    centres, axes = (low + high) / 2, np.where(lit, (high - low) / 2, 0.0)
    weight = _neighbours(lit.astype(np.float64))
    borrow = ~lit & (weight > 0)
    weight = np.maximum(weight, 1.0)
    centres = np.where(borrow, _neighbours(np.where(lit, centres, 0.0)) / weight, centres)
    axes = np.where(borrow, _neighbours(axes) / weight, axes)
    return centres, axes


def _neighbours(values: Array) -> Array:
    """Return the sums over the neighbours of the nodes of a line (nodes, components), themselves included."""
    padded = np.pad(values, ((1, 1), (0, 0)))
    return np.asarray(padded[:-2] + padded[1:-1] + padded[2:], dtype=np.float64)


def _with_middles(nodes: Array) -> Array:
    """Return nodes and the middles between them."""
    return np.interp(np.arange(2 * len(nodes) - 1) / 2, np.arange(len(nodes)), nodes)


def between(values: Array) -> Array:
    """Return values at the nodes of a line (nodes, components) and, by interpolation, at the middles."""
    fine = np.empty((2 * len(values) - 1, *values.shape[1:]))
    fine[::2], fine[1::2] = values, (values[1:] + values[:-1]) / 2
    return fine


def reach_of(
    probe: film_probe.FilmProbe, film: Array, centres: Array, axes: Array, fineness: Fineness, *, mirrored: bool = False
) -> Array:
    """Return how far the pupil reaches in its frame, shape (film points, directions); `mirrored`: as above, so below.

    Where a pupil is not parted, directions in which nothing passes count as its middle.
    """
    return _edges(probe, film, (centres, axes), fineness, mirrored=mirrored, holed=False)[0]


def _edges(
    probe: film_probe.FilmProbe,
    film: Array,
    frames: tuple[Array, Array],
    fineness: Fineness,
    *,
    mirrored: bool,
    holed: bool,
) -> tuple[Array, Array]:
    """Return the reach as `reach_of`, and within what radius no ray of an obstructed lens passes.

    Along each direction points are tried from the outside inwards until one passes, then the edge behind it is
    bisected; so an outline that is not star-shaped from the centre is still held.
    """
    directions = fineness.directions * DIRECTIONS
    count = directions // 2 + 1 if mirrored else directions
    angles = np.arange(count) * 2 * np.pi / directions
    across = frames[1][:, None, :] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points, origins = (np.broadcast_to(values[:, None, :], across.shape) for values in (film, frames[0]))
    scan = _RING_SCAN if probe.lens.is_obstructed else fineness.scan
    step = fineness.farthest / scan
    parted = probe.lens.is_obstructed or fineness is FINEST_OUTLINES  # whether directions in which nothing passes count

    def passing(rho: Array, of: Mask) -> Mask:
        return probe.passes(points[of], origins[of] + across[of] * rho[:, None])

    if fineness is COARSE_OUTLINES and not parted:
        reach = _all_round(_reach_at_once(probe, points, origins, across, fineness), mirrored)
        return reach, np.inf + reach

    low, steps = np.zeros((len(film), count)), np.full((len(film), count), step)
    for parts in (1, _SLIVER_SCAN) if parted else (1,):  # slivers in single directions
        dark = low == 0.0
        if parts > 1 and fineness.farthest > _RING_FARTHEST:
            dark &= np.any(low > 0, axis=1, keepdims=True)
        steps[dark] = step / parts
        for k in range(parts * scan, parts - 1, -1):
            rho = k * step / parts
            low[dark] = np.where(passing(np.full(int(dark.sum()), rho), dark), rho, 0.0)
            dark &= low == 0.0
    high, lit = low + steps, low > 0
    for _ in range(fineness.bisections):
        middle = (low[lit] + high[lit]) / 2
        inside = passing(middle, lit)
        low[lit], high[lit] = np.where(inside, middle, low[lit]), np.where(inside, high[lit], middle)
    reach = np.where(lit if parted else lit.any(axis=1, keepdims=True), high, 0.0)
    hole = _hole_of(probe, film, frames[0], across, low, fineness) if holed else np.inf + low
    return _all_round(reach, mirrored), _all_round(hole, mirrored)


def _all_round(half: Array, mirrored: bool) -> Array:
    """Return values of directions (film points, directions), of the upper half where what is below is the same."""
    return np.concatenate([half, half[:, -2:0:-1]], axis=1) if mirrored else half


_PIECES = 4  # in which an edge is sought at once


def _reach_at_once(probe: film_probe.FilmProbe, film: Array, centres: Array, across: Array, fine: Fineness) -> Array:
    """Return the reach (film points, directions) as `_edges` does, in three calls: of few rays, they take the time."""
    low, lit = np.zeros(across.shape[:2]), np.ones(across.shape[:2], dtype=bool)
    steps = fine.farthest / fine.scan / np.array([1, _PIECES, _PIECES**2])
    for step, pieces in zip(steps, (fine.scan + 1, _PIECES, _PIECES), strict=True):
        places = low + step * np.arange(1, pieces)[:, None, None]
        hits = lit & probe.passes(film, centres + across * places[..., None])
        low = np.max(np.where(hits, places, low), axis=0)
        lit = low > 0
    return np.where(lit.any(axis=1, keepdims=True), np.where(lit, low + steps[-1], steps[0]), 0.0)


def _hole_of(
    probe: film_probe.FilmProbe, film: Array, centres: Array, across: Array, inside: Array, fineness: Fineness
) -> Array:
    """Return within what radius no ray passes, up to where they do, which is `inside` (film points, directions).

    The edge before the first of some points that passes is bisected. Infinite in directions of which no ray passes; 0
    in all where the middle passes.
    """

    def passing(rho: Array) -> Mask:
        return probe.passes(film[:, None], centres[:, None] + across * rho[..., None])

    tried = [passing(inside * (k / _RING_SCAN)) for k in range(_RING_SCAN)]
    first = np.where(np.any(tried, axis=0), np.argmax(tried, axis=0), _RING_SCAN)
    low, high = inside * (np.maximum(first - 1, 0) / _RING_SCAN), inside * (first / _RING_SCAN)
    for _ in range(fineness.bisections):
        middle = (low + high) / 2
        bright = passing(middle)
        low, high = np.where(bright, low, middle), np.where(bright, middle, high)
    hole = np.where(high > 0, low, 0.0)
    return np.where(np.all((hole > 0) | (inside == 0), axis=1, keepdims=True), np.where(inside > 0, hole, np.inf), 0.0)


def _envelope(reach: Array, directions: int) -> Array:
    """Return radii at the nodes that, interpolated over film and direction, hold the outlines traced at every point.

    Parameters
    ----------
    reach
        (lines, points, directions): of one line, or of twice as many lines as hold them.
    """
    around = np.maximum(reach, np.maximum(np.roll(reach, 1, axis=2), np.roll(reach, -1, axis=2)))[..., ::directions]
    nodes, middles = around[:, ::2].copy(), around[:, 1::2]
    nodes[:, :-1] = np.maximum(nodes[:, :-1], middles)
    nodes[:, 1:] = np.maximum(nodes[:, 1:], middles)
    if len(nodes) == 1:
        return nodes
    return np.maximum(nodes[::2], np.maximum(nodes[1::2], np.roll(nodes[1::2], 1, axis=0)))


def _from_neighbours(values: Array, closed: Mask) -> Array:
    """Return values (lines, nodes, directions) with those of closed nodes replaced by their neighbours' greatest.

    Where a pupil is open in some directions only, its outline jumps; both ends of what lies between hold it then.
    """
    wide = values
    for axis in (0, 2):
        wide = np.maximum(wide, np.maximum(np.roll(wide, 1, axis=axis), np.roll(wide, -1, axis=axis)))
    padded = np.concatenate([wide[:, :1], wide, wide[:, -1:]], axis=1)
    wide = np.maximum(np.maximum(padded[:, :-2], wide), padded[:, 2:])
    return np.asarray(np.where(closed, wide, values))


#
# Pupils of a round lens at every width of its stop, from rays traced once.
#
# From where the chief ray of a film point crosses the plane of the last vertex, rays are traced outwards: how far
# they pass with the stop wide open, and at which height each crosses the stop. Along each direction a narrower stop
# lets rays through up to the height of its rim, or as far as other rims let them.

_FINENESS = replace(FINE_OUTLINES, scan=10, bisections=8, margin=0.005)
LEVELS = 8  # of rays between the middle and the farthest that passes
WIDEST = 0.95  # first-order radii of the pupil, of which rays are sought up to `farthest` times as far


@dataclass(frozen=True, eq=False)
class StoppedPupils:
    """Rays of some states of a lens that are near each other: of its film, its focus or the wavelength.

    Attributes
    ----------
    radius_mm : float
        Of the film of the first state, up to which it goes. A film point of another stands at the place of the first's
        that lies in its direction from the last vertex.
    centres : (states, points) array
        Where chief rays of points on a film radius cross the plane of the last vertex [mm].
    reach : (states, points, directions) array
        How far from there rays pass with the stop wide open [mm], over half a turn.
    heights : (states, levels, points, directions) array
        Where rays at 1, 2, … of so many parts of this reach cross the stop: distance from its middle [mm].
    """

    radius_mm: float
    centres: Array
    reach: Array
    heights: Array

    def shapes(self, semi_diameter_mm: float) -> PupilShapes | None:
        """Return outlines that hold the pupils of all states with a stop of some radius; None where they are not
        star-shaped."""
        angles = np.linspace(0.0, np.pi, self.reach.shape[-1])
        reach = self._reach(semi_diameter_mm)
        u, v = self.centres[..., None] + reach * np.cos(angles), reach * np.sin(angles)
        low, high = u.min(axis=(0, 2))[::2], u.max(axis=(0, 2))[::2]
        axes = np.stack([(high - low) / 2, v.max(axis=(0, 2))[::2]], axis=1)
        centres = np.stack([(low + high) / 2, np.zeros(len(low))], axis=1)
        middle, half = between(centres)[:, :1], between(axes)
        u, v = (u - middle) / half[:, :1], v / half[:, 1:]
        turns, radii = np.arctan2(v, u), np.hypot(u, v)
        turns[..., 0], turns[..., -1] = 0.0, np.pi
        if not (np.all(np.diff(turns) > 0) and np.all(u[..., 0] > 0) and np.all(u[..., -1] < 0)):
            return None
        pairs = zip(turns.reshape(-1, len(angles)), radii.reshape(-1, len(angles)), strict=True)
        even = np.array([np.interp(angles, turn, radius) for turn, radius in pairs]).reshape(reach.shape).max(axis=0)
        outline = np.concatenate([even, even[:, -2:0:-1]], axis=1)
        wider = _envelope(outline[None], _FINENESS.directions) * (1.0 + _FINENESS.margin)
        return PupilShapes(np.array([self.radius_mm]), centres[None], axes[None], wider)

    def _reach(self, height: float) -> Array:
        """Return how far rays pass a stop that is open up to a height."""
        levels = np.arange(1, LEVELS + 1)[:, None, None] / LEVELS
        scales = levels * self.reach[:, None] / self.heights
        above = np.clip(np.sum(self.heights <= height, axis=1, keepdims=True), 1, LEVELS - 1)
        low, high = above - 1, above
        h0, h1 = (np.take_along_axis(self.heights, at, axis=1)[:, 0] for at in (low, high))
        s0, s1 = (np.take_along_axis(scales, at, axis=1)[:, 0] for at in (low, high))
        return np.minimum(height * (s0 + (s1 - s0) * (height - h0) / (h1 - h0)), self.reach)


def stopped_pupils(
    states: Sequence[tuple[Lens, float]], radius_mm: float, wavelengths_nm: Sequence[float]
) -> StoppedPupils | None:
    """Return rays of a round lens with its stop wide open, by which pupils of narrower stops are known.

    They go as far as the film, or as chief rays come through. None where something stands in the middle of a pupil or
    where rays bend too much to say.

    Parameters
    ----------
    states
        The lens, and its last vertex to film [mm].
    """
    first_mm, line = states[0][1], _film_line(radius_mm, _FINENESS.radial_nodes)
    clear = np.logical_and.reduce([
        _chief(lens, film_distance_mm, line * (film_distance_mm / first_mm), nm).clear
        for lens, film_distance_mm in states for nm in wavelengths_nm
    ])  # fmt: skip
    if not clear.all():
        radius_mm = float(line[max(int(np.argmin(clear)) - 1, 0), 0])
    if not radius_mm > 0:
        return None
    film = _film_line(radius_mm, _FINENESS.radial_nodes)
    traced = []
    for lens, film_distance_mm in states:
        for wavelength_nm in wavelengths_nm:
            of_state = _trace_state(lens, film_distance_mm, film * (film_distance_mm / first_mm), wavelength_nm)
            if of_state is None:
                return None
            traced.append(of_state)
    centres, reach, heights = (np.array(values) for values in zip(*traced, strict=True))
    return StoppedPupils(radius_mm, centres, reach, heights)


def _chief(lens: Lens, film_distance_mm: float | Array, film: Array, wavelength_nm: float) -> ChiefRays:
    points = np.column_stack([film, np.broadcast_to(lens.length + lens.sense * film_distance_mm, len(film))])
    return round_chief_rays(lens, points, wavelength_nm)


def _trace_state(
    lens: Lens, film_distance_mm: float, film: Array, wavelength_nm: float
) -> tuple[Array, Array, Array] | None:
    """Return centres, reach and heights of one state."""
    pupil = lens.first_order(wavelength_nm).exit_pupil
    size = abs(WIDEST * pupil.diameter_mm / 2 * film_distance_mm / (film_distance_mm - pupil.distance_mm))
    chief = _chief(lens, film_distance_mm, film, wavelength_nm)
    if not (np.isfinite(size) and chief.clear.all()) or lens.is_obstructed:
        return None
    centres, axes = chief.aims, np.full(film.shape, size)
    half = reach_of(
        film_probe.FilmProbe(lens, film_distance_mm, wavelength_nm), film, centres, axes, _FINENESS, mirrored=True
    )
    reach = half[:, : half.shape[1] // 2 + 1] * size
    if not (reach.all() and reach.max() < (1.0 - 1.0 / _FINENESS.scan) * _FINENESS.farthest * size):
        return None
    angles = np.linspace(0.0, np.pi, reach.shape[1])
    away = np.arange(1, LEVELS + 1)[:, None, None] / LEVELS * reach
    u, v = centres[:, :1] + away * np.cos(angles), away * np.sin(angles)
    rear = np.stack([u.ravel(), v.ravel()], axis=1)
    at_x = np.broadcast_to(film[:, :1], u.shape).ravel()
    heights = _stop_heights(lens, film_distance_mm, at_x, rear, wavelength_nm).reshape(u.shape)
    if not (np.isfinite(heights).all() and heights[0].min() > 0 and np.all(np.diff(heights, axis=0) > 0)):
        return None
    return centres[:, 0], reach, heights


def _stop_heights(
    lens: Lens, film_distance_mm: float | Array, film_x: Array, rear: Array, wavelength_nm: float
) -> Array:
    """Return where rays cross the stop: distance from its middle [mm].

    They go from film points on +x (n,) through points (n, 2) of the plane of the last vertex; rims do not count.
    """
    points = np.zeros((3, len(rear)))
    depth = np.broadcast_to(lens.sense * film_distance_mm, len(rear))
    points[0], points[2] = film_x, lens.length + depth
    across = np.stack([rear[:, 0] - film_x, rear[:, 1], -depth])
    order = range(len(lens.surfaces) - 1, limiting_surface(lens, wavelength_nm) - 1, -1)
    at, _, _ = trace_crossings(lens, order, points, across / np.sqrt(np.sum(across**2, axis=0)), wavelength_nm)
    return np.hypot(at[0, :, 0], at[0, :, 1])
