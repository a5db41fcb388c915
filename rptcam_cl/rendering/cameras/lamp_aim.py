"""Tables by which camera rays aim at small lamps out of focus, as `kernels/lens/lamp_aim.h` reads them.

For every lamp that the film sees unsharp, the place in the pupil through which a film point sees it is a smooth
function of the film point. In a block of pixels it is taken as affine, and the lamp's part of the pupil as the image of
a disk or a square, as large as what the affine map leaves out requires. Rays are weighed by the density with which they
are chosen, so that errors of the tables change noise and never the mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import DISPERSION_SCALE, DISPERSION_SHIFT
from rptcam_cl.core.remember import Disk, Memory, checkpoint, content_name
from rptcam_cl.rendering.cameras.model import NEAR, CameraModel, LampReach, Reached
from rptcam_cl.rendering.cameras.setting import CameraMetadata

# How the film sees one lamp through the pupil: polynomials in the film point, fitted to exact rays from the lamp.

Array = NDArray[np.float64]

_SCANT_ACROSS = 4  # rays across the pupil for whether a lamp is worth more
ACROSS, FEW_ACROSS = 16, 12  # rays across the pupil for the middle of a lamp, and for its edges and other colours
_DEGREE = 5  # of the polynomials
CELLS = 12  # across the pupil, each with a ray or more where it is open
AT_ONCE = 32  # lamps whose rays are traced together
FEWEST = 40  # rays that a lamp needs
_LARGEST_ERROR = (
    0.15  # of a polynomial, in radii of the pupil: beyond it, a film point sees a lamp through several places
)


@dataclass(frozen=True)
class SeenLamp:
    """A lamp as the camera sees it.

    Attributes
    ----------
    centre : (3,) array
        In the camera's frame [m].
    axes : (2, 3) array
        From there to the edge, in two directions.
    is_round : bool
        Whether it is an ellipse with these half axes; otherwise the parallelogram of half edges.
    radiance : float
        Luminance of what it emits [W/(m² sr)].
    """

    centre: Array
    axes: Array
    is_round: bool
    radiance: float


class Polynomial:
    """The polynomial in a point (n, 2) that is fitted to values (n, k)."""

    def __init__(self, points: Array, values: Array, degree: int = _DEGREE) -> None:
        self._degree = degree
        self._middle = points.mean(axis=0)
        self._scale = np.maximum(np.abs(points - self._middle).max(axis=0), np.finfo(np.float64).tiny)
        x, y = self._powers(0, points[:, 0]), self._powers(1, points[:, 1])
        i, j = np.array([(i, k - i) for k in range(degree + 1) for i in range(k + 1)]).T
        terms = x[:, i] * y[:, j]
        coefficients = np.linalg.lstsq(terms, values, rcond=1e-10)[0]
        self._coefficients = np.zeros((degree + 1, degree + 1, values.shape[1]))
        self._coefficients[i, j] = coefficients
        off = terms @ coefficients - values
        self.error = float(np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1))))

    def _powers(self, axis: int, places: Array) -> Array:
        """Return the powers (n, degree + 1) of places along an axis."""
        powers = np.ones((len(places), self._degree + 1))
        powers[:, 1:] = ((places - self._middle[axis]) / self._scale[axis])[:, None]
        return np.asarray(np.multiply.accumulate(powers, axis=1))

    def at(self, points: Array) -> Array:
        """Return its values (n, k) at points (n, 2)."""
        x, y = self._powers(0, points[:, 0]), self._powers(1, points[:, 1])
        return np.asarray(np.einsum("ni,nj,ijk->nk", x, y, self._coefficients))

    def on_grid(self, x: Array, y: Array) -> Array:
        """Return its values (y, x, k) at all points of a grid."""
        along = np.tensordot(self._powers(0, x), self._coefficients, 1)
        return np.asarray(np.tensordot(self._powers(1, y), along, ([1], [1])))


@dataclass(frozen=True)
class LampFit:
    """Polynomials in the film point.

    Attributes
    ----------
    middle : Polynomial
        Place in the pupil, and where the ray enters the camera [m], of rays to the lamp's middle.
    edges : pairs of Polynomial
        Place in the pupil of rays to the ends of both axes.
    colours : pair of Polynomial or None
        That of rays to its middle of two wavelengths.
    film, pupil : (n, 2) arrays
        What rays of the middle reach.
    """

    middle: Polynomial
    edges: tuple[tuple[Polynomial, Polynomial], tuple[Polynomial, Polynomial]]
    colours: tuple[Polynomial, Polynomial] | None
    film: Array
    pupil: Array

    @property
    def pupil_middle(self) -> Array:
        """Middle of the part of the pupil that the lens opens to the lamp."""
        return np.asarray((self.pupil.min(axis=0) + self.pupil.max(axis=0)) / 2)

    @property
    def pupil_radius(self) -> float:
        """Of the circle about it."""
        return float(np.linalg.norm(self.pupil - self.pupil_middle, axis=1).max())

    @property
    def pupil_area(self) -> float:
        """About that of this part."""
        away = self.pupil.T - self.pupil.mean(axis=0)[:, None]
        return float(4 * np.pi * np.sqrt(np.linalg.det(np.dot(away, away.T) * (1 / (away.shape[1] - 1)))))

    def near(self, places: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which places of the pupil (..., 2) have rays that pass in their neighbourhood, and all over it."""
        low, high = self.pupil.min(axis=0), self.pupil.max(axis=0)

        def cells(points: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
            cell = np.clip((points - low) * (CELLS / (high - low)) + 2, 0, CELLS + 3).astype(np.intp)
            return cell[..., 0], cell[..., 1]

        lit = np.zeros((CELLS + 6, CELLS + 6), dtype=bool)
        row, column = cells(self.pupil * (1 - 1e-9) + (low + high) / 2 * 1e-9)
        lit[row + 1, column + 1] = True
        around = np.array([lit[i : CELLS + 4 + i, j : CELLS + 4 + j] for i, j in np.ndindex(3, 3)])
        at = cells(places)
        return np.any(around, axis=0)[at], np.all(around, axis=0)[at]


def fits_of_small(
    lamps: Sequence[SeenLamp], reach: LampReach, colours_nm: tuple[float, float] | None, largest: float
) -> dict[int, LampFit]:
    """Return how lamps are seen, by their numbers.

    Left out are those that fill a larger part of the pupil, those of which too little light comes through, and those
    that a film point sees twice.
    """
    if not lamps:
        return {}
    points = np.array([[lamp.centre, *(lamp.centre + lamp.axes)] for lamp in lamps])
    near = _near(points, reach)
    small = np.flatnonzero(_parts_of_pupil(points, near, reach) < largest)
    fits = {}
    for low in range(0, len(small), AT_ONCE):
        some = small[low : low + AT_ONCE]
        middles = reach.rays(points[some, 0], ACROSS, None, near[some, 0])
        enough = np.flatnonzero(middles.passed.sum(axis=1) >= FEWEST)
        if not len(enough):
            continue
        some, middles = some[enough], middles.of(enough)
        ends, near_ends = _ends([lamps[number] for number in some.tolist()], near[some, 1:], reach)
        of_ends = reach.rays(ends, FEW_ACROSS, None, near_ends)
        centres = points[some, 0]
        colours = [reach.rays(centres, FEW_ACROSS, nm, reach.near(centres, nm)) for nm in colours_nm or ()]
        for k, number in enumerate(some.tolist()):
            checkpoint()
            fit = _fit(middles.of([k]), of_ends.of(range(4 * k, 4 * k + 4)), [each.of([k]) for each in colours])
            if fit is not None:
                fits[number] = fit
    return fits


def _near(points: Array, reach: LampReach) -> Array:
    """Return where the middles and the first ends of lamps (n, 3, 3) are seen; of the ends where a middle is."""
    near = np.zeros((*points.shape[:2], *NEAR))
    near[:, 0] = reach.near(points[:, 0], None)
    seen = np.flatnonzero(reach.rays(points[:, 0], _SCANT_ACROSS, None, near[:, 0]).passed.any(axis=1))
    near[seen, 1:] = reach.near(points[seen, 1:].reshape(-1, 3), None).reshape(-1, 2, *NEAR)
    return near


def _parts_of_pupil(points: Array, near: Array, reach: LampReach) -> Array:
    """Return about which part of the pupil each lamp fills (n,), by a few rays; 0 where none come through.

    A lamp's image and its disk of defocus share the film, so that the part is the ratio of their areas.

    Parameters
    ----------
    points : (n, 3, 3) array
        Its middle and the ends of its axes.
    near
        Where they are seen through the lens, as `LampReach.near` has it.
    """
    rays = reach.rays(points.reshape(-1, 3), _SCANT_ACROSS, None, near.reshape(-1, *NEAR))
    if not rays.passed.any():
        return np.zeros(len(points))
    film, passed = rays.film.reshape(*points.shape[:2], -1, 2), rays.passed.reshape(*points.shape[:2], -1)
    count = np.maximum(passed.sum(axis=-1), 1)[..., None]
    middle = np.where(passed[..., None], film, 0.0).sum(axis=2) / count
    square = np.sum(np.where(passed, np.sum((film - middle[:, :, None]) ** 2, axis=-1), 0.0), axis=-1) / count[..., 0]
    axes = middle[:, 1:] - middle[:, :1]
    with np.errstate(all="ignore"):
        part = np.abs(np.linalg.det(axes)) / square[:, 0]
    return np.where(passed.any(axis=-1).all(axis=-1) & np.isfinite(part), part, 0.0)


def _ends(lamps: Sequence[SeenLamp], near: Array, reach: LampReach) -> tuple[Array, Array]:
    """Return the ends of the axes of lamps (4 n, 3), and where these are seen; of the first two that is known."""
    ends = np.array([lamp.centre + np.concatenate([lamp.axes, -lamp.axes]) for lamp in lamps])
    others = reach.near(ends[:, 2:].reshape(-1, 3), None).reshape(near.shape)
    return ends.reshape(-1, 3), np.concatenate([near, others], axis=1).reshape(-1, *NEAR)


def _fit(rays: Reached, ends: Reached, colours: Sequence[Reached]) -> LampFit | None:
    if min(each.passed.sum(axis=1).min() for each in (ends, *colours)) < FEWEST:
        return None
    passed = rays.passed[0]
    film, pupil = rays.film[0][passed], rays.pupil[0][passed]
    middle = Polynomial(film, np.concatenate([pupil, rays.entry[0][passed]], axis=1))
    edges = [_fit_polynomial(*each) for each in zip(ends.film, ends.pupil, ends.passed, strict=True)]
    by_colour = tuple(_fit_polynomial(r.film[0], r.pupil[0], r.passed[0]) for r in colours) or None
    fit = LampFit(middle, ((edges[0], edges[2]), (edges[1], edges[3])), by_colour, film, pupil)  # type: ignore[arg-type]
    return None if middle.error > _LARGEST_ERROR * fit.pupil_radius else fit


def _fit_polynomial(film: Array, pupil: Array, passed: NDArray[np.bool_]) -> Polynomial:
    return Polynomial(film[passed], pupil[passed])


LAMP = 18  # floats of a lamp in a block
_LARGEST_PART = 0.15  # of the pupil: a lamp that fills more is found by other rays
_FAR_TOO_LARGE = 2.5  # times that part, by a few rays: such a lamp is not examined closer
_LARGEST_AIM = 0.4  # of the pupil that rays at a lamp are spread over
_AIM_WIDER = 1.05  # than a lamp's part of the pupil is found to be
_MOST_SHARE = 0.7  # of the rays of a film point
_TIPS = 1.12  # times as far as rays of the middle go corners of the pupil may reach, between these rays
_INWARDS = 2.0  # times how far a lamp reaches lies the outline, towards the middle, off a corner of 60 degrees
# Value of the film that a lamp's disk has to be bright against: that of a picture with white at 1, or in a dimmer one a
# tenth of what grey at the eye sends on.
_DIM, _GREY = 0.02, 0.1 * 0.2 / math.pi
MOST_ENTRIES = 20_000
_SEEN_NM = (440.0, 650.0)  # between which colours are taken as a line
COLOURS = tuple(DISPERSION_SCALE / nm - DISPERSION_SHIFT for nm in _SEEN_NM)
_MOST_BLOCKS = 1_000_000  # of a film
REMEMBERED = 8  # states of camera and lamps whose places are remembered
GRID = np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]), axis=-1).reshape(9, 2)  # of a block


@dataclass(frozen=True)
class Sights:
    """Lines of sight: from where rays enter the camera to the middle of a lamp, in the camera's frame [m].

    Attributes
    ----------
    origins, targets : (n, 3) arrays
    short : (n,) array
        How far before the target they end.
    """

    origins: Array
    targets: Array
    short: Array


Shows = Callable[[Sights], NDArray[np.bool_]]


@dataclass(frozen=True)
class _Blocks:
    """Blocks of pixels over a film."""

    shift: int
    resolution: tuple[int, int]
    film_scale: Array  # film coordinates of the upright picture's edges
    flip: float

    @property
    def counts(self) -> tuple[int, int]:
        """How many there are across and down."""
        across, down = (((side - 1) >> self.shift) + 1 for side in self.resolution)
        return across, down

    @property
    def half(self) -> Array:
        """Half the sides of one on the film."""
        place = np.full(2, 2.0 ** (self.shift - 1))
        return np.abs(self.film(place) - self.film(np.zeros(2)))

    def film(self, pixels: Array) -> Array:
        """Return the film coordinates of places right and down in pixels."""
        place = (2.0 * pixels / self.resolution - 1.0) * (1.0, -1.0)
        return np.asarray(place * self.flip * self.film_scale)

    def pixels(self, film: Array) -> Array:
        """Return where film coordinates lie, right and down in pixels."""
        place = film / self.film_scale * self.flip
        return np.asarray((place * (1.0, -1.0) + 1.0) / 2.0 * self.resolution)

    def area(self, fit: LampFit) -> float:
        """Return how many pixels the disk of a lamp touches."""
        pixels = np.clip(self.pixels(fit.film), 0.0, self.resolution)
        return float(np.prod(np.ptp(pixels, axis=0) + 4.0))

    def touched(self, fit: LampFit) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the columns and the rows of the blocks that a lamp's disk may touch."""
        size, pixels = 1 << self.shift, self.pixels(fit.film)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        beyond = 0.05 * (high - low) + 2.0
        first = np.maximum(np.floor((low - beyond) / size), 0).astype(int)
        last = np.minimum(np.floor((high + beyond) / size), np.array(self.counts) - 1).astype(int)
        return np.arange(first[0], last[0] + 1), np.arange(first[1], last[1] + 1)

    def places(self, columns: NDArray[np.int64], rows: NDArray[np.int64]) -> tuple[Array, Array]:
        """Return x and y on the film of the edges and middles of blocks side by side: 2 n + 1 of each."""
        x, y = (2 ** (self.shift - 1) * np.arange(2 * k[0], 2 * k[-1] + 3.0) for k in (columns, rows))
        return self.film(np.stack([x, x], axis=1))[:, 0], self.film(np.stack([y, y], axis=1))[:, 1]


def _fine_enough(blocks: _Blocks, fits: Sequence[LampFit]) -> _Blocks:
    """Return the smallest blocks whose tables are not too large: at best single pixels."""
    entries, shift = sum(map(blocks.area, fits)), 0
    while entries > MOST_ENTRIES * 4**shift or np.prod(blocks.counts) > _MOST_BLOCKS * 4**shift:
        shift += 1
    return replace(blocks, shift=shift)


@dataclass(frozen=True)
class _Entries:
    """What the table has of one lamp: the blocks, the floats but for its share, how much of the pupil it fills, and the
    points where rays of a block enter the camera (n, 9, 2)."""

    blocks: NDArray[np.int64]
    floats: Array
    part: Array
    entry: Array

    def kept(self, keep: NDArray[Any]) -> _Entries:
        return _Entries(self.blocks[keep], self.floats[keep], self.part[keep], self.entry[keep])


_NO_ENTRIES = _Entries(np.zeros(0, np.int64), np.zeros((0, LAMP)), np.zeros(0), np.zeros((0, 9, 2)))


def _nine(grid: Array, which: NDArray[np.intp], flips: tuple[bool, bool]) -> Array:
    """Return the values of some blocks at the points of `GRID` (n, 9, k), from those at all edges and middles
    (y, x, k)."""
    row, column = np.divmod(which, (grid.shape[1] - 1) // 2)
    down, across = (np.array([2, 1, 0] if flip else [0, 1, 2]) for flip in flips[::-1])
    rows, columns = 2 * row[:, None, None] + down[:, None], 2 * column[:, None, None] + across
    return np.asarray(grid[rows, columns].reshape(-1, 9, grid.shape[-1]))


def _polar(m: Array) -> tuple[Array, Array]:
    """Return the orthogonal factors (n, 2, 2) of matrices, and their largest singular values (n,), in closed form."""
    (a, b), (c, d) = np.moveaxis(m, 0, -1)
    turn, mirror = np.hypot(a + d, b - c), np.hypot(a - d, b + c)
    turns = turn >= mirror
    cosine, sine = np.where(turns, a + d, a - d), np.where(turns, c - b, b + c)
    length = np.where(turns, turn, mirror)
    cosine = np.where(length > 0, cosine, 1.0) / np.where(length > 0, length, 1.0)
    sine = sine / np.where(length > 0, length, 1.0)
    sign = np.where(turns, -1.0, 1.0)
    factors = np.stack([cosine, sign * sine, sine, -sign * cosine], axis=-1).reshape(-1, 2, 2)
    return factors, (turn + mirror) / 2


def _entries(lamp: SeenLamp, fit: LampFit, blocks: _Blocks) -> _Entries:
    columns, rows = blocks.touched(fit)
    if not (len(columns) and len(rows)):
        return _NO_ENTRIES
    x, y = blocks.places(columns, rows)

    def at_middles(polynomial: Polynomial) -> Array:
        return polynomial.on_grid(x[1::2], y[1::2]).reshape(len(rows) * len(columns), -1)

    # The lamp's part of the pupil; only blocks that see it small need more.
    ends = np.array([[at_middles(end) for end in pair] for pair in fit.edges])
    parts = np.moveaxis((ends[:, 0] - ends[:, 1]) / 2, 0, -1)
    full, pupil_area, pupil_middle = np.pi if lamp.is_round else 4.0, fit.pupil_area, fit.pupil_middle
    part = full * np.abs(_determinants(parts)) / pupil_area
    which = np.flatnonzero(part < _LARGEST_PART)
    if not len(which):
        return _NO_ENTRIES
    part, parts, ends = part[which], parts[which], ends[:, :, which]
    # The place in the pupil as an affine map of the film point, and what it leaves out at the corners.
    about = _nine(fit.middle.on_grid(x, y), which, (x[0] > x[-1], y[0] > y[-1]))
    places, entry = about[..., :2], about[..., 2:]
    some, everywhere = fit.near(places)
    half = blocks.half
    slope = np.stack([places[:, 5] - places[:, 3], places[:, 7] - places[:, 1]], axis=-1) / (2 * half)
    at = places[:, 4]
    corners = GRID * half
    left_out = places - at[:, None] - (slope[:, None, :, 0] * corners[:, :1] + slope[:, None, :, 1] * corners[:, 1:])
    margin = np.where(some, np.hypot(left_out[..., 0], left_out[..., 1]), 0.0).max(axis=1) + 2 * fit.middle.error
    margin = margin + np.linalg.norm((ends[:, 0] + ends[:, 1]) / 2 - at, axis=-1).max(axis=0)
    shift = np.zeros_like(at)
    if fit.colours is not None:
        first, second = (at_middles(each)[which] for each in fit.colours)
        shift = (second - first) / (COLOURS[1] - COLOURS[0])
        margin = margin + np.linalg.norm(at - (first + second) / 2, axis=1) / 2
        at = (first + second) / 2 - shift * sum(COLOURS) / 2
    # The lamp's part of the pupil, wide enough for that.
    factors, largest = _polar(parts)
    widened = parts * _AIM_WIDER + margin[:, None, None] * factors
    taken = full * np.abs(_determinants(widened)) / pupil_area
    beyond = largest + margin
    radius = fit.pupil_radius * _TIPS + beyond
    middle = np.column_stack([x[1::2][which % len(columns)], y[1::2][which // len(columns)]])
    constant = at - (slope @ middle[..., None])[..., 0]
    n = len(which)
    floats = np.column_stack([
        np.zeros(n), constant[:, 0], slope[:, 0], constant[:, 1], slope[:, 1], shift, widened.reshape(n, 4),
        np.full(n, float(lamp.is_round)), np.broadcast_to(pupil_middle, (n, 2)), radius**2,
        np.where(everywhere.all(axis=1), 0.0, _INWARDS * beyond),
    ])  # fmt: skip
    numbers = (rows[:, None] * blocks.counts[0] + columns).ravel()[which]
    return _Entries(numbers, floats, part, entry).kept(np.flatnonzero(some.any(axis=1) * (taken < _LARGEST_AIM)))


def _determinants(m: Array) -> Array:
    return np.asarray(m[:, 0, 0] * m[:, 1, 1] - m[:, 0, 1] * m[:, 1, 0])


def _that_show(entries: _Entries, lamp: SeenLamp, entry_z_m: float, shows: Shows) -> _Entries:
    """Return the entries of blocks from where a lamp shows, its share as large as it does there."""
    origins = np.concatenate([entries.entry, np.full((*entries.entry.shape[:2], 1), entry_z_m)], axis=-1).reshape(-1, 3)
    short = np.full(len(origins), 1.1 * float(np.linalg.norm(lamp.axes, axis=1).sum()))
    seen = shows(Sights(origins, np.broadcast_to(lamp.centre, origins.shape), short)).reshape(-1, len(GRID))
    return replace(entries, part=entries.part * seen.mean(axis=1)).kept(np.flatnonzero(seen.any(axis=1)))


@dataclass(frozen=True)
class _LampTables:
    """What a camera needs to aim at lamps.

    Attributes
    ----------
    table : float32 array
        Area of the pupil, then places and counts of all blocks, and behind them their lamps.
    shift : int
        Blocks have 2 ** shift pixels along each side.
    counts : (int, int)
        Blocks across and down.
    lamps : int
        How many lamps there are in it.
    """

    table: NDArray[np.float32]
    shift: int
    counts: tuple[int, int]
    lamps: int


def aimed_at_lamps(
    camera: CameraModel,
    lamps: Sequence[SeenLamp],
    shows: Shows,
    sights: str | None = None,
    *,
    irradiance: float = math.inf,
    on_disk: bool = True,
) -> CameraModel:
    """Return the camera with tables that aim some of its rays at lamps out of focus; its metadata say at how many.

    Without any, or with a film that is tilted or shifted, it is the camera that was given.

    Parameters
    ----------
    shows
        Returns which lines of sight nothing blocks.
    sights
        Names all that ``shows`` depends on: with a name, what is found is remembered.
    irradiance
        About that of the eye [W/m², luminance].
    on_disk
        Whether tables with a name are kept from one run to the next.
    """
    if camera.reach is None or camera.facts.get("FILM_MOVED") or camera.facts.get("LENS_FOLD"):
        return camera

    def make() -> _LampTables:
        return _tables(camera, lamps, _find_or_fit(camera, lamps, shows, sights), dim)

    dim = min(_DIM, _GREY * irradiance * camera.value)
    aim = make() if sights is None or not on_disk else _DISK.find_or_make((*_key(camera, lamps, sights), dim), make)
    if not aim.lamps:
        return camera
    new = camera.record.copy()
    new["lamp_table"], new["lamp_shift"] = len(camera.tables), aim.shift
    new["lamp_across"], new["lamp_down"] = aim.counts
    facts = camera.facts | {"LAMP_AIM": 1, "LAMP_COLOURS": int(camera.bends_colours)}
    metadata: CameraMetadata = {**camera.metadata, "lamps_aimed_at": aim.lamps}
    return replace(
        camera, record=new, facts=facts, tables=np.concatenate([camera.tables, aim.table]), metadata=metadata
    )


_NO_LAMPS = _LampTables(np.zeros(0, np.float32), 0, (0, 0), 0)


_Seen = tuple[_Blocks, list[tuple[int, _Entries]]]  # where the film sees which lamps, by number, whatever they emit


def _seen(camera: CameraModel, lamps: Sequence[SeenLamp], shows: Shows) -> _Seen:
    """Return which lamps the film sees unsharp, and through which pixels they show."""
    record, reach = camera.record[0], camera.reach
    assert reach is not None
    resolution = int(record["width"]), int(record["height"])
    flip = 1.0 if record["per_width"] > 0 else -1.0
    fits = _fits(camera, reach, lamps)
    blocks = _fine_enough(_Blocks(0, resolution, np.array(reach.film_scale), flip), list(fits.values()))
    shown = []
    for number, fit in fits.items():
        checkpoint()
        entries = _entries(lamps[number], fit, blocks)
        if len(entries.blocks) and len((seen := _that_show(entries, lamps[number], reach.entry_z_m, shows)).blocks):
            shown.append((number, seen))
    return blocks, shown


_seen_lamps: Memory[_Seen] = Memory(REMEMBERED)
_small_lamp_fits: Memory[dict[int, LampFit]] = Memory(REMEMBERED)


def _places(lamps: Sequence[SeenLamp]) -> tuple[object, ...]:
    """Find how a lens shows lamps, whatever they emit."""
    return tuple((each.centre.tobytes(), each.axes.tobytes(), each.is_round) for each in lamps)


def _fits(camera: CameraModel, reach: LampReach, lamps: Sequence[SeenLamp]) -> dict[int, LampFit]:
    """Return how lamps are seen: found once for places and a lens, whatever the size of the film."""
    colours_nm = _SEEN_NM if camera.bends_colours else None
    key = content_name(reach.made_of), colours_nm, _places(lamps)
    return _small_lamp_fits.find_or_make(
        key, lambda: fits_of_small(lamps, reach, colours_nm, _FAR_TOO_LARGE * _LARGEST_PART)
    )


def _find_or_fit(camera: CameraModel, lamps: Sequence[SeenLamp], shows: Shows, sights: str | None) -> _Seen:
    """Return where the film sees lamps: found once for the same places and sights."""
    if sights is None:
        return _seen(camera, lamps, shows)
    assert camera.reach is not None
    record, reach = camera.record[0], camera.reach
    film = record["width"], record["height"], record["per_width"] > 0, reach.film_scale, camera.bends_colours
    key = sights, content_name(reach.made_of), film, _places(lamps)
    return _seen_lamps.find_or_make(key, lambda: _seen(camera, lamps, shows))


def _tables(camera: CameraModel, lamps: Sequence[SeenLamp], seen: _Seen, dim: float) -> _LampTables:
    """Return the tables for lamps that emit so much, in a picture as bright as `_DIM` says."""
    blocks, shown = seen
    if not shown:
        return _NO_LAMPS
    assert camera.reach is not None
    values = np.concatenate([entries.part * lamps[number].radiance * camera.value for number, entries in shown])
    numbers, floats = (np.concatenate([getattr(e, name) for _, e in shown]) for name in ("blocks", "floats"))
    table = np.concatenate(
        [np.array([camera.reach.area], np.float32), _pack_table(numbers, floats, values, blocks, dim)]
    )
    return _LampTables(table, blocks.shift, blocks.counts, len(shown))


_DISK = Disk(
    "lamps",
    ("core", "optics", "rendering/cameras"),
    pack=lambda aim: ({"table": aim.table}, {"of": [aim.shift, aim.counts, aim.lamps]}),
    unpack=lambda arrays, facts: _LampTables(arrays["table"], facts["of"][0], tuple(facts["of"][1]), facts["of"][2]),
)


def _key(camera: CameraModel, lamps: Sequence[SeenLamp], sights: str) -> tuple[object, ...]:
    """The key of the tables of a camera for lamps that show as ``sights`` names it."""
    assert camera.reach is not None
    lamp_content = [(each.centre, each.axes, each.is_round, each.radiance) for each in lamps]
    state = camera.record.tobytes(), camera.bends_colours, camera.axial_weight, lamp_content
    return sights, camera.reach.made_of, camera.reach.film_scale, state


def _pack_table(
    numbers: NDArray[np.int64], floats: Array, values: Array, blocks: _Blocks, dim: float
) -> NDArray[np.float32]:
    """Return places and counts of all blocks, and behind them their lamps, each with its share of the rays."""
    count = int(np.prod(blocks.counts))
    sums = np.bincount(numbers, values, count)
    floats[:, 0] = _MOST_SHARE * values / np.maximum(dim + sums[numbers], np.finfo(np.float64).tiny)
    order = np.argsort(numbers, kind="stable")
    counts = np.bincount(numbers, minlength=count)
    places = 1 + 2 * count + LAMP * (np.cumsum(counts) - counts)
    return np.concatenate([np.column_stack([places, counts]).ravel(), floats[order].ravel()]).astype(np.float32)
