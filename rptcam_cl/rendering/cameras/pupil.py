"""Pupil sampling of a lens camera: tables of where rays aim, as tiers that change the noise and nothing else."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import field, replace
from typing import Any, Literal, NamedTuple, TypedDict

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import PupilKind
from rptcam_cl.core.remember import Disk, content_name, remember
from rptcam_cl.optics import film_probe, pupils
from rptcam_cl.optics.lens import Lens

# Values known at nodes all over a film and beside it, and between them by cubics.

Array = NDArray[np.float64]

NEIGHBOURS = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column]


class FilmGrid:
    """A square grid of nodes; what is missing is continued from what is there.

    Parameters
    ----------
    values : (n, n, k) array
        At the nodes, rows upwards and columns to the right; nan where unknown.
    reach : float
        Where the outermost nodes are, in half films.
    """

    def __init__(self, values: Array, reach: float) -> None:
        self._values, self._reach = _continue_values(values), reach
        self._per_side = (len(values) - 1) / (2 * reach)

    def at(self, places: Array) -> Array:
        """Return the values (m, k) at places (m, 2) right and up, to 1 at the edges of the film; nan beyond the nodes.

        Cubics through four nodes each way.
        """
        count, flat = len(self._values), self._values.reshape(-1, self._values.shape[2])
        with np.errstate(invalid="ignore"):
            scaled = (places + self._reach) * self._per_side
            known = np.all((scaled >= -1e-9) & (scaled <= count - 1 + 1e-9), axis=1)
        scaled = np.where(known[:, None], scaled, 1.0)
        first = np.clip(np.floor(scaled).astype(np.int64) - 1, 0, count - 4)
        (across, along), values = (_weights(t) for t in (scaled - first).T), np.zeros((len(places), flat.shape[1]))
        for row in range(4):
            start = (first[:, 1] + row) * count + first[:, 0]
            for column in range(4):
                values += (along[row] * across[column])[:, None] * flat[start + column]
        values[~known] = np.nan
        return values


def _weights(t: Array) -> tuple[Array, Array, Array, Array]:
    """Return the weights of the nodes 0, 1, 2 and 3 at places between them (Lagrange)."""
    a, b, c = t - 1.0, t - 2.0, t - 3.0
    return -a * b * c / 6.0, t * b * c / 2.0, -t * a * c / 2.0, t * a * b / 6.0


def _continue_values(values: Array) -> Array:
    """Return values (n, n, k) without nan: each missing node goes on straight or in a parabola."""
    values, count = values.copy(), len(values)
    known = np.asarray(np.isfinite(values).all(axis=2))
    while known.any() and not known.all():
        sums, votes = np.zeros_like(values), np.zeros((count, count, 1))
        for row, column in NEIGHBOURS:
            (one, near), (two, far), (three, last) = (
                _move_cells(values, known, row * k, column * k) for k in (1, 2, 3)
            )
            bent = near & far & last
            guess = np.where(bent[..., None], 3 * one - 3 * two + three, 2 * one - two)
            usable = (near & far & ~known)[..., None]
            sums += np.where(usable, guess, 0.0)
            votes += usable
        fresh = votes[..., 0] > 0
        if not fresh.any():
            break
        values[fresh] = sums[fresh] / votes[fresh]
        known |= fresh
    return values


def _move_cells(values: Array, known: NDArray[np.bool_], rows: int, columns: int) -> tuple[Array, NDArray[np.bool_]]:
    """The values of the nodes so many rows and columns farther, and which of them are known."""
    count = len(values)
    index = np.arange(count)
    row, column = np.clip(index + rows, 0, count - 1), np.clip(index + columns, 0, count - 1)
    inside = ((index + rows == row)[:, None]) & ((index + columns == column)[None, :])
    there = np.ix_(row, column)
    return np.nan_to_num(values[there]), known[there] & inside


# A sampling of the pupil as the camera's kernel reads it: kind and facts, a few numbers and a table.


class PupilCircle(NamedTuple):
    """One circle: how far its centre moves per mm of the film point, and its radius [mm]."""

    shift: float
    radius: float


class PupilGrid(NamedTuple):
    """Boxes of the film's cells, or outlines along a film radius: how many there are per mm, and how many in all."""

    per_mm_across: float
    per_mm_down: float
    across: float
    down: float


class PupilLines(NamedTuple):
    """Outlines along lines from the axis outwards: lines in a quarter of a turn, nodes of each, and lines in all."""

    per_quarter: float
    nodes: float
    lines: float


class SamplingMetadata(TypedDict, total=False):
    """What a picture's metadata say of how rays aim at the pupil."""

    pupil: str  # the tier
    pupil_instead_of: str
    pupil_widened: float


@dataclass(frozen=True)
class PupilSampling:
    """What `kernels/lens/pupil.h` reads: kind and facts, a few numbers and a table."""

    tier: str
    kind: PupilKind
    parameters: PupilCircle | PupilGrid | PupilLines
    table: NDArray[np.float32] = field(default_factory=lambda: np.zeros(1, np.float32))
    instead_of: str = ""  # the requested tier, where its tables would lose light
    widened: float = 1.0  # factor on the paraxial pupil of the thick tier, without which it would lose light
    ring: bool = False  # whether the table of outlines has those of the hole in their middle as well

    def facts_but_table(self) -> dict[str, Any]:
        """Return all but the table, as JSON holds it; see `of_facts`."""
        facts = {name: value for name, value in vars(self).items() if name != "table"}
        return facts | {"kind": int(self.kind), "parameters": [float(value) for value in self.parameters]}

    @classmethod
    def of_facts(cls, facts: dict[str, Any], table: NDArray[np.float32]) -> PupilSampling:
        """Return the sampling of a table and of what `facts_but_table` returned."""
        numbers = facts["parameters"]
        parameters = next(each for each in (PupilCircle, PupilGrid, PupilLines) if len(each._fields) == len(numbers))
        made = parameters(*numbers)
        return cls(**facts | {"kind": PupilKind(facts["kind"]), "parameters": made}, table=table)

    @property
    def radial(self) -> bool:
        """Whether outlines along one film radius stand for all."""
        return self.kind == PupilKind.OUTLINES and isinstance(self.parameters, PupilGrid)

    @property
    def member(self) -> str:
        """Which member of the record ``Pupil`` the parameters are."""
        return {PupilCircle: "circle", PupilGrid: "grid", PupilLines: "lines"}[type(self.parameters)]

    @property
    def metadata(self) -> SamplingMetadata:
        """What the picture's metadata should say."""
        metadata: SamplingMetadata = {"pupil": self.tier}
        if self.instead_of:
            metadata["pupil_instead_of"] = f"{self.instead_of}: the pupil has parts that its tables do not hold"
        if self.widened > 1.0:
            metadata["pupil_widened"] = self.widened
        return metadata

    @property
    def facts(self) -> dict[str, int]:
        """Facts for the compilation."""
        return {
            "PUPIL_KIND": int(self.kind),
            "PUPIL_RADIAL": int(self.radial),
            "PUPIL_RING": int(self.ring),
            "PUPIL_DIRECTIONS": pupils.DIRECTIONS,
        }


#
# Whether a sampling of the pupil holds the rays that pass: what lies apart from the main pupil slips through tables.
#
# A ball behind a small window, for one, also passes a ring of rays round its main pupil: they cross the axis within
# the glass, and spherical aberration brings them back to the window.

Mask = NDArray[np.bool_]

RAYS = 6000  # over the rear window, from each film point that is tried
_FILM_RADII = 9  # film points, of a rotationally symmetric lens
FARTHEST = 0.97  # of the way to the corner: at the corner itself pupils close, and tables blur their slivers
FILM_NODES = 4  # the same along each side of the film, of other lenses
APART = 0.03  # sizes of the pupil by which a ray lies outside of it, and not at an edge that tables blur
FEW = 2  # such rays, that prove a part of its own


def loses_light(sampling: PupilSampling, probe: film_probe.FilmProbe, half_film_mm: tuple[float, float]) -> bool:
    """Return whether rays pass that lie well outside of what a sampling draws from."""
    corners = probe.frame.corners(half_film_mm)[:, :2]
    if probe.lens.is_rotational and probe.frame.is_flat:
        farthest = corners[np.argmax(np.hypot(*corners.T))]
        corner = (float(np.hypot(*farthest)), 0.0) if sampling.radial else farthest
        film = np.linspace(0.0, FARTHEST, _FILM_RADII)[:, None] * corner
    else:
        film = probe.frame.grid(half_film_mm, FILM_NODES).reshape(-1, 2)
    points = film_probe.spread_points(probe.windows(film), RAYS)
    which = np.repeat(np.arange(len(film)), RAYS)
    film, points = film[which], points.reshape(-1, 2)
    outside = left_out(sampling, probe.frame.bounds(half_film_mm), film, points, APART)
    return bool(probe.passes(film[outside], points[outside]).sum() >= FEW)


def left_out(
    sampling: PupilSampling, half_film_mm: tuple[float, float], film: Array, points: Array, margin: float = 0.0
) -> Mask:
    """Return which points (n, 2) of the plane of the last vertex a sampling never draws from film points (n, 2).

    Parameters
    ----------
    sampling
        For outlines along a film radius, only film points on +x are given.
    margin
        Shares of the pupil's size by which a point must lie outside.
    """
    if isinstance(sampling.parameters, PupilCircle):
        shift, radius = sampling.parameters
        return np.asarray(np.hypot(*(points - shift * film).T) > (1.0 + margin) * radius)
    if sampling.kind == PupilKind.BOXES:
        return _out_of_boxes(sampling, half_film_mm, film, points, margin)
    return _out_of_outlines(sampling, film, points, margin)


def _out_of_boxes(
    sampling: PupilSampling, half_film_mm: tuple[float, float], film: Array, points: Array, margin: float
) -> Mask:
    assert isinstance(sampling.parameters, PupilGrid)
    count = np.array([sampling.parameters.across, sampling.parameters.down])
    cell = np.clip((film / half_film_mm + 1) / 2 * count, 0, count - 1).astype(int)
    table = sampling.table.reshape(int(count[1]), int(count[0]), 4).astype(np.float64)
    low, size = np.split(table[cell[:, 1], cell[:, 0]], 2, axis=1)
    out = (points < low - margin * size) | (points > low + (1.0 + margin) * size)
    return np.asarray(np.any(out, axis=1) & (size[:, 0] > 0))


def _out_of_outlines(sampling: PupilSampling, film: Array, points: Array, margin: float) -> Mask:
    nodes, start, corners, turn = outlines_around(sampling, film)
    frames = sampling.table[: 4 * nodes].reshape(-1, 4).astype(np.float64)
    radii = outline_radii(sampling, nodes, start)
    frame = sum((share[:, None] * frames[node] for node, share in corners), np.zeros((len(film), 4)))
    x, y = points.T
    points = np.stack([x * turn[:, 0] + y * turn[:, 1], y * turn[:, 0] - x * turn[:, 1]], axis=1)
    away = (points - frame[:, :2]) / np.maximum(frame[:, 2:], 1e-300)
    place = np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi) % 1.0 * pupils.DIRECTIONS
    first = np.minimum(place.astype(int), pupils.DIRECTIONS - 1)
    away_by = np.hypot(*away.T)

    def between(table: Array) -> Array:
        here, ahead = (
            sum((share * table[node, k % pupils.DIRECTIONS] for node, share in corners), np.zeros(len(film)))
            for k in (first, first + 1)
        )
        return np.asarray(here + (place - first) * (ahead - here))

    out = away_by > between(radii[0]) + margin
    if sampling.ring:
        out |= away_by < between(radii[1]) - margin
        begin, end = (sum(share * radii[2][node, k] for node, share in corners) for k in (0, -1))
        beside = margin / (2 * np.pi) + 1e-7
        out |= (place < pupils.DIRECTIONS * (begin - beside)) | (place > pupils.DIRECTIONS * (end + beside))
    return np.asarray(out & (frame[:, 2] > 0))


def outline_radii(sampling: PupilSampling, nodes: int, start: int) -> list[Array]:
    """Return the radii (nodes, directions) of the outlines in a table; of rings those of holes, and `_knots`, too."""
    size = 4 * nodes * pupils.DIRECTIONS
    tables = (
        sampling.table[at : at + size : 4]
        for at in range(start, start + (2 * sampling.ring + 1) * (size + 4), size + 4)
    )
    radii = [table.reshape(-1, pupils.DIRECTIONS).astype(np.float64) for table in tables]
    if sampling.ring:
        end = start + 2 * (size + 4) + 4 * pupils.DIRECTIONS - 3
        radii[2] = np.column_stack([radii[2], sampling.table[end : end + size : 4 * pupils.DIRECTIONS]])
    return radii


def outlines_around(
    sampling: PupilSampling, film: Array
) -> tuple[int, int, list[tuple[NDArray[np.int64], Array]], Array]:
    """Return how many nodes a table has, where its radii start, the nodes round film points with the share that each
    has in what lies between, and the directions (n, 2) of the axes of the outlines there."""
    radius = np.hypot(*film.T)
    if isinstance(sampling.parameters, PupilLines):
        per_quarter, columns, lines = sampling.parameters
        nodes = int(lines + 1) * int(columns)
        start = 4 * (nodes + 1)
        radii = (1 + 2 * sampling.ring) * 4 * (nodes * pupils.DIRECTIONS + 1)
        reaches = sampling.table[start + radii :].astype(np.float64)
        along = pupils.quarters_of(film) * per_quarter
        line = np.minimum(along.astype(int), int(lines) - 1)
        rows = [(line, 1.0 - (along - line)), (line + 1, along - line)]
        share_of_line = radius / sum(share * reaches[row] for row, share in rows)
        places = (1.0 - np.sqrt(np.maximum(1.0 - share_of_line, 0.0))) * (columns - 1)
        turn = np.where(radius[:, None] > 0, film / np.maximum(radius, 1e-300)[:, None], [1.0, 0.0])
    else:
        assert isinstance(sampling.parameters, PupilGrid)
        columns = sampling.parameters.across
        nodes, rows = int(columns), [(np.zeros(len(film), int), np.ones(len(film)))]
        start, places = 4 * (nodes + 1), radius * sampling.parameters.per_mm_across
        turn = np.broadcast_to([1.0, 0.0], film.shape)  # such film points are given on +x
    places = np.clip(places, 0.0, columns - 1)
    low = np.minimum(places.astype(int), int(columns) - 2)
    beside = [(low, 1.0 - (places - low)), (low + 1, places - low)]
    corners = [(row * int(columns) + column, share * other) for row, share in rows for column, other in beside]
    return nodes, start, corners, np.asarray(turn)


Tier = Literal["auto", "rear", "thick", "bounds", "tight"]
KEPT = "pupils"  # folder of the cache on disk
REMEMBERED = 64  # lens states whose tables are kept, of 30 to 150 kB each
NOWHERE = (np.inf, -np.inf)  # low and high corner of a box that holds nothing
CELLS = 16  # of the film across and down, for the boxes
SPREAD = 0.05  # share of its size that a box is widened by, for what lies between the corners of its cell
EDGE_SPREAD = 0.2  # the same where the pupil closes within the cell
PROBES = (18, 18)  # rays per box and film point
_MOVED_GRID = 9  # points along each side of a film that is moved, seen from which the rear rim is held


class _View(NamedTuple):
    """A lens, its stop round, as points of the film behind it see it, from which all tables of its pupil follow."""

    lens: Lens
    film_distance_mm: float
    half_film_mm: tuple[float, float]
    wavelength_nm: film_probe.Wavelengths
    frame: film_probe.FilmFrame

    def narrowing_probes(self) -> list[film_probe.FilmProbe]:
        return film_probe.narrowing_probes(self.lens, self.film_distance_mm, self.wavelength_nm, self.frame)

    def shapes(self, fineness: pupils.Fineness = pupils.FINE_OUTLINES) -> pupils.PupilShapes:
        return pupils.pupil_shapes(*self[:4], fineness, self.frame)


def pupil_sampling(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: film_probe.Wavelengths,
    tier: Tier,
    frame: film_probe.FilmFrame = film_probe.UNMOVED,
    *,
    coarse: bool = False,
) -> PupilSampling:
    """Return the sampling of a tier.

    Parameters
    ----------
    half_film_mm
        Half the sides of the film.
    wavelength_nm
        With several, the sampling holds the rays of each.
    tier
        ``rear``: the whole rear element (CS348b 2015). ``thick``: the paraxial image of the stop (CS348b 2003), widened
        where it would lose light. ``bounds``: a box per film cell (pbrt). ``tight``: the outline of the true pupil.
        A table that proves to lose light, as with a pupil of several parts, gives way to ``rear``.
        ``auto``: tight, which needs the fewest samples on the four lenses it was measured on.
    frame
        How the film stands.
    coarse
        Makes ``tight`` in a fifth of the time, and unchecked. It may leave out slivers of the pupil, less than a
        thousandth of the light of the lenses that it was tried on.
    """
    view = _View(without_shape(lens), film_distance_mm, half_film_mm, wavelength_nm, frame)
    sampling = _coarse(view) if coarse and tier in ("auto", "tight") else _check_sampling(view, tier)
    sampling.table.flags.writeable = False
    return sampling


def without_shape(lens: Lens) -> Lens:
    """Return the lens with a round stop: what holds it holds every shape in it."""
    return lens.with_stop_shape(None) if has_shape(lens) else lens


def has_shape(lens: Lens) -> bool:
    """Return whether the stop of a lens is not round."""
    return lens.stop is not None and lens.stop.stop_shape is not None


def content_of(lens: Lens) -> tuple[object, ...]:
    """Return all that rays through a lens follow from, and its name: the key of what is remembered of it."""
    return lens.name, lens.surfaces, lens.stop_index, lens.object_medium


def by_content(lens: Lens, *state: Hashable) -> Hashable:
    """Return the key of what follows from a lens in some state."""
    key = content_of(lens), state
    return content_name(key) if has_shape(lens) else key  # outlines and masks of stops are arrays, which have no hash


def on_disk(**ways: Any) -> Disk:
    """Return where it is kept what follows from lenses, with the ``pack`` and ``unpack`` of `Disk`."""
    return Disk(KEPT, ("core", "optics", "rendering/cameras"), **ways)


@remember(
    most=REMEMBERED,
    by=lambda view, tier: by_content(*view, tier),
    disk=on_disk(
        pack=lambda sampling: ({"table": sampling.table}, sampling.facts_but_table()),
        unpack=lambda arrays, facts: PupilSampling.of_facts(facts, arrays["table"]),
    ),
)
def _check_sampling(view: _View, tier: Tier) -> PupilSampling:
    """Return the sampling of a tier, or of another one where its tables would lose light."""
    if tier == "rear":
        return _rear(view)
    if tier == "thick":
        sampling = _thick(view)
    elif tier == "bounds":
        sampling = _bounds(view.narrowing_probes(), view.frame.bounds(view.half_film_mm))
    else:
        sampling = tight_sampling(view.shapes())
    probe = film_probe.FilmProbe(view.lens, view.film_distance_mm, view.wavelength_nm, view.frame)
    loses = loses_light(sampling, probe, view.half_film_mm)
    if loses and sampling.tier == "tight":
        sampling = tight_sampling(view.shapes(pupils.FINEST_OUTLINES))
        loses = loses_light(sampling, probe, view.half_film_mm)
    return replace(_rear(view), instead_of=sampling.tier) if loses else sampling


@remember(most=REMEMBERED, by=lambda view: by_content(*view))
def _coarse(view: _View) -> PupilSampling:
    return tight_sampling(view.shapes(pupils.COARSE_OUTLINES))


def _rear(view: _View) -> PupilSampling:
    """The rear rim, projected from the film point on the plane of the last vertex.

    A rim at depth t behind that plane shows as a circle, scaled by Z / (Z + t) and shifted towards the film point.
    Where the surface bulges out of the cone to its rim, as a ball's does, the circle is widened to hold it.
    """
    probe = film_probe.FilmProbe(view.lens, view.film_distance_mm, view.wavelength_nm)
    scale = view.film_distance_mm / (view.film_distance_mm - probe.patch[:, 2])
    shift = 1.0 - scale[-1]  # of the rim, the last ring of the patch
    film = np.linspace(0.0, float(np.hypot(*view.half_film_mm)), 9)[:, None]
    if view.frame.is_moved:
        return PupilSampling("rear", PupilKind.CIRCLE, _round_windows(view, float(shift)))
    u = film * (1.0 - scale) + probe.patch[:, 0] * scale - shift * film
    reach = np.hypot(u, probe.patch[:, 1] * scale)
    radius = float(reach.max())
    if radius > reach[:, -(len(scale) // film_probe.PATCH_RADII) :].max():
        radius *= 1.0 + film_probe.BULGE
    return PupilSampling("rear", PupilKind.CIRCLE, PupilCircle(float(shift), radius))


def _round_windows(view: _View, shift: float) -> PupilCircle:
    """Return the circle that holds the rear rim as points all over a film that is moved see it."""
    film = view.frame.grid(view.half_film_mm, _MOVED_GRID).reshape(-1, 2)
    boxes = film_probe.FilmProbe(view.lens, view.film_distance_mm, view.wavelength_nm, view.frame).windows(film)
    middles, halves = (boxes[:, 1::2] + boxes[:, ::2]) / 2, (boxes[:, 1::2] - boxes[:, ::2]) / 2
    reach = np.hypot(*(np.abs(middles - shift * film) + halves).T)
    return PupilCircle(shift, float(reach.max()))


def _thick(view: _View) -> PupilSampling:
    """The paraxial exit pupil, seen on the plane of the last vertex; widened where it would lose light."""
    nm = view.wavelength_nm
    pupil = view.lens.first_order(nm[0] if isinstance(nm, tuple) else nm).exit_pupil
    from_film = view.film_distance_mm - pupil.distance_mm
    if not (np.isfinite(from_film) and from_film > 0):
        raise InputError(
            f"camera.pupil: {view.lens.name}: its exit pupil lies behind the film, so it bounds no rays"
            " (allowed: rear, bounds, tight)"
        )
    shrink = view.film_distance_mm / from_film
    shift, radius = 1.0 - shrink, pupil.diameter_mm / 2 * shrink
    needed = _needed_radius(view.narrowing_probes(), view.half_film_mm, shift)
    widened = max(1.0, needed / radius)
    return PupilSampling("thick", PupilKind.CIRCLE, PupilCircle(shift, radius * widened), widened=widened)


def _needed_radius(probes: list[film_probe.FilmProbe], half_film_mm: tuple[float, float], shift: float) -> float:
    """Return the radius [mm] of a circle, shifted with the film point, that holds every probed ray that passes."""
    radial = probes[-1].lens.is_rotational and not probes[-1].frame.is_moved
    if radial:
        film = np.stack([np.linspace(0.0, float(np.hypot(*half_film_mm)), 17), np.zeros(17)], axis=1)
    else:
        film = probes[-1].frame.grid(half_film_mm, 11).reshape(-1, 2)
    windows, lit = film_probe.pupil_boxes(probes, film, PROBES, radial=radial)
    film, windows = film[lit], windows[lit]
    points = film_probe.grid(windows, 2 * PROBES[0], 2 * PROBES[1])
    passes = probes[-1].passes(film[:, None], points)
    away = points - shift * film[:, None]
    cell = np.hypot(*film_probe.cells(windows, 2 * PROBES[0], 2 * PROBES[1]).T)[:, None]
    return float(np.max((np.hypot(away[..., 0], away[..., 1]) + cell) * passes, initial=0.0))


def _bounds(probes: list[film_probe.FilmProbe], half_film_mm: tuple[float, float]) -> PupilSampling:
    """A box per film cell that holds the pupils of its corners, and a little more."""
    low, high, is_open = _corner_boxes(probes, half_film_mm)
    corners = [(slice(i, i + CELLS), slice(j, j + CELLS)) for i in (0, 1) for j in (0, 1)]
    low = np.min([low[corner] for corner in corners], axis=0)
    high = np.max([high[corner] for corner in corners], axis=0)
    lit = np.isfinite(low[..., 0])
    closed = ~np.all([is_open[corner] for corner in corners], axis=0)
    spread = np.where(closed, EDGE_SPREAD, SPREAD)[..., None] * np.where(lit[..., None], high - low, 0.0)
    low, high = low - spread, high + spread
    if not lit.any():
        where = f"the film {probes[-1].distance:g} mm behind the lens"
        raise InputError(f"{probes[-1].lens.name}: no light reaches {where}")
    size = np.where(lit[..., None], high - low, 0.0)
    table = np.concatenate([np.where(lit[..., None], low, 0.0), size], axis=-1).astype(np.float32).ravel()
    per_mm = (CELLS / (2 * half_film_mm[0]), CELLS / (2 * half_film_mm[1]))
    return PupilSampling("bounds", PupilKind.BOXES, PupilGrid(*per_mm, CELLS, CELLS), table)


def _corner_boxes(
    probes: list[film_probe.FilmProbe], half_film_mm: tuple[float, float]
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the low and high corners (n, n, 2) of boxes round the pupils at the corners of the film's cells, and where
    it is open. Of a rotationally symmetric lens a quarter of the film is traced."""
    film = film_probe.UNMOVED.grid(half_film_mm, CELLS + 1)
    symmetric = probes[-1].lens.is_rotational and probes[-1].frame.is_flat
    part = film[CELLS // 2 :, CELLS // 2 :] if symmetric else film
    boxes, lit = film_probe.pupil_boxes(probes, part.reshape(-1, 2), PROBES)
    lit = lit.reshape(part.shape[:2])
    low, high = (np.where(lit[..., None], boxes[:, k::2].reshape(part.shape), none) for k, none in enumerate(NOWHERE))
    if symmetric:
        for axis in (0, 1):
            low, high = _mirror_boxes(low, high, axis)
    return low, high, np.isfinite(low[..., 0])


def _mirror_boxes(low: Array, high: Array, axis: int) -> tuple[Array, Array]:
    """Return boxes over half a film, of rows along y (axis 0) or columns along x, with their mirror images before."""
    other_low, other_high = (np.flip(np.delete(values, 0, axis), axis).copy() for values in (low, high))
    component = 1 - axis
    other_low[..., component], other_high[..., component] = -other_high[..., component], -other_low[..., component]
    return np.concatenate([other_low, low], axis=axis), np.concatenate([other_high, high], axis=axis)


def tight_sampling(shapes: pupils.PupilShapes) -> PupilSampling:
    """Return the sampling of outlines."""
    frames, last = np.concatenate([shapes.centres, shapes.axes], axis=-1), np.zeros(4)
    lines, nodes = frames.shape[:2]
    radii = [_with_ahead(values) for values in (shapes.radii, shapes.inner) if values is not None]
    if shapes.inner is not None:
        knots = _knots(shapes.radii, shapes.inner, shapes.opens)
        radii.append(_with_next(np.stack([knots[..., :-1], knots[..., 1:]], axis=-1)))
    if shapes.radial:
        parameters: PupilGrid | PupilLines = PupilGrid(1 / (shapes.reach[0] / (nodes - 1)), 0.0, nodes, 1)
        reaches: list[Array] = []
    else:  # the first line follows on the last
        parameters = PupilLines(lines / 4, nodes, lines)
        frames, *radii = (np.concatenate([values, values[:1]]) for values in (frames, *radii))
        reaches = [shapes.reach, shapes.reach[:1]]
    table = [frames.ravel(), last, *(part for values in radii for part in (values.ravel(), last)), *reaches]
    numbers, ring = np.concatenate(table).astype(np.float32), shapes.inner is not None
    return PupilSampling("tight", PupilKind.OUTLINES, parameters, numbers, ring=ring)


_FINE = 16  # steps of a direction, by which shares of the area are found


def _knots(radii: Array, inner: Array, opens: Array | None) -> Array:
    """Return the directions (lines, nodes, DIRECTIONS + 1) up to which equal shares of the area of rings lie [turns].

    They begin and end where light does. Where there are two crescents, one step leads from the end of the first to the
    other, which has a step less.
    """
    turns = np.arange(_FINE * pupils.DIRECTIONS + 1) / (_FINE * pupils.DIRECTIONS)
    every = np.arange(pupils.DIRECTIONS + 1) / pupils.DIRECTIONS
    half = pupils.DIRECTIONS // 2
    knots = []
    opens = np.broadcast_to([0.0, 0.5], (*radii.shape[:2], 2)) if opens is None else opens
    rows = zip(
        radii.reshape(-1, pupils.DIRECTIONS), inner.reshape(-1, pupils.DIRECTIONS), opens.reshape(-1, 2), strict=True
    )
    for outer, hole, (first, last) in rows:
        areas = np.interp(turns, every, np.append(outer, outer[0])) ** 2
        areas -= np.interp(turns, every, np.append(hole, hole[0])) ** 2
        below = np.concatenate([[0.0], np.cumsum(np.maximum(areas[1:] + areas[:-1], 0.0) + 1e-9)])
        if last - first < 1e-6:
            first, last = 0.0, 0.5
        low, high, low2, high2 = np.interp([first, last, 1.0 - last, 1.0 - first], turns, below)
        if last >= 0.5:
            knots.append(np.interp(np.linspace(low, high2, len(every)), below, turns))
        else:
            parts = np.linspace(low, high, half + 1), np.linspace(low2, high2, half)
            knots.append(np.interp(np.concatenate(parts), below, turns))
        knots[-1][[0, -1]] = first, 1.0 - first
    return np.reshape(knots, (*radii.shape[:2], -1))


def _with_ahead(values: Array) -> Array:
    """Return values (lines, nodes, directions) with those of the next direction, and both at the next node, beside."""
    return _with_next(np.stack([values, np.roll(values, -1, axis=-1)], axis=-1))


def _with_next(rows: Array) -> Array:
    """Return rows (lines, nodes, directions, 2) with those of the next node beside."""
    return np.concatenate([rows, np.concatenate([rows[:, 1:], rows[:, -1:]], axis=1)], axis=-1)
