"""A tolerance run: many copies of a lens made at random and judged, and each tolerance alone at its limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Copies, Lens, brought_to_focus, check_copies, configured, film_distance
from rptcam_cl.scene import Merit, Tolerances
from rptcam_cl.tolerances.beams import Field, FieldRays, default_fields, fields_of
from rptcam_cl.tolerances.draws import drawn
from rptcam_cl.tolerances.limits import Limit, limits
from rptcam_cl.tolerances.scores import Judge, Scores
from rptcam_cl.tolerances.specification import Specification, specification
from rptcam_cl.tolerances.statistics import Interval, percentile, rank, share

Array = NDArray[np.float64]

RINGS = (6, 8, 10, 12, 16, 24, 32, 48)  # of rays in a beam, with twice as many in a ring, till figures stay
SPOTS_STAY, MODULATION_STAYS = 0.0025, 0.005  # share of a spot, and modulation, by which more rays may change a field
PROBES = 3  # copies that are tried


@dataclass(frozen=True)
class Sensitivity:
    """What one tolerance alone does at its limit.

    Attributes
    ----------
    label : str
        What is off: ``radius ±0.2 % of surface 3``.
    direction : str
        ``+``, ``-``, or of what lies across the axis ``+x``, ``-x``, ``+y`` or ``-y``; a tilt about that axis.
    spot_um, mtf : float
        The merit so changed.
    spot_change_um, mtf_change : float
        Less that of the design.
    shift_mm : float
        How far refocusing moves the film.
    """

    label: str
    direction: str
    spot_um: float
    mtf: float
    spot_change_um: float
    mtf_change: float
    shift_mm: float


@dataclass(frozen=True)
class ToleranceRun:
    """The result.

    Attributes
    ----------
    lens : Lens
        The design, in the state in which copies are judged.
    tolerances : Tolerances
    limits : sequence of Limit
        All that may be off.
    fields_degrees : tuple of float
        Angles from the axis that were judged; those beside 0 from four sides.
    film_distance_mm : float
        Where the film of the design stands, at the least spots of all fields together.
    design : Scores
        Those of the design, as of a single copy.
    scores : Scores
        Those of the copies, in the order in which they were made.
    copies : Copies
    sensitivities : tuple of Sensitivity
    spot_error, mtf_error : float
        By which share more rays change the spots of the design and some copies at most, and by how much the modulation.
    """

    lens: Lens
    tolerances: Tolerances
    limits: Sequence[Limit]
    fields_degrees: tuple[float, ...]
    film_distance_mm: float
    design: Scores
    scores: Scores
    copies: Copies
    sensitivities: tuple[Sensitivity, ...]
    spot_error: float
    mtf_error: float

    @property
    def rank_by(self) -> str:
        """``spot`` or ``mtf``."""
        return self.tolerances.merit.rank_by

    @cached_property
    def order(self) -> NDArray[np.intp]:
        """Numbers of the copies, the best first."""
        merit = self.scores.by(self.rank_by)
        return np.argsort(merit if self.rank_by == "spot" else -merit, kind="stable")

    def copy_at(self, percent: float) -> int:
        """Return the number of the copy at a percentile: that percent of all are as good or better.

        Raises
        ------
        InputError
            For a percentile that is not above 0 and at most 100.
        """
        return int(self.order[rank(percent, len(self.order))])

    def percentile(self, percent: float) -> Interval:
        """Return the merit that this percent of the copies reach, with the bounds of its 95 % interval.

        They hold what more copies and what more rays would change.
        """
        merit = self.scores.by(self.rank_by)[self.order]
        if self.rank_by == "spot":
            found = percentile(merit, percent)
            return Interval(found.value, found.low * (1 - self.spot_error), found.high * (1 + self.spot_error))
        found = percentile(-merit, percent)
        return Interval(-found.value, -found.high - self.mtf_error, -found.low + self.mtf_error)

    def yield_at(self, limit: float) -> Interval:
        """Return which share of all copies is at least as good as a limit, with the bounds of its 95 % interval.

        They hold what more copies and what more rays would change.
        """
        merit = self.scores.by(self.rank_by)
        if self.rank_by == "spot":
            merit, limit, error = -merit, -limit, limit * self.spot_error
        else:
            error = self.mtf_error
        found, worst, best = (
            share(int(np.count_nonzero(merit >= limit + off)), len(merit)) for off in (0.0, error, -error)
        )
        return Interval(found.value, worst.low, best.high)

    def worst_offenders(self, count: int = 10) -> list[Sensitivity]:
        """Return the tolerances that cost most, each in its worst direction."""
        worst: dict[str, Sensitivity] = {}
        for one in self.sensitivities:
            if one.label not in worst or _cost(self.rank_by, one) > _cost(self.rank_by, worst[one.label]):
                worst[one.label] = one
        return sorted(worst.values(), key=lambda one: -_cost(self.rank_by, one))[:count]

    def lens_of(self, number: int) -> Lens:
        """Return a copy as a lens, by its number."""
        return self.copies.copy(number)


def tolerance(
    lens: Lens,
    spec: str | Path | Mapping[str, Any] | Tolerances | Specification,
    *,
    copies: int | None = None,
    seed: int | None = None,
    with_sensitivities: bool = True,
) -> ToleranceRun:
    """Return how copies of a lens turn out within tolerances.

    Parameters
    ----------
    lens : Lens
        The design.
    spec
        ``commercial``, ``precision`` or ``high_precision``; a YAML file; or the same as Python data.
    copies, seed : int, optional
        In place of what the specification says.
    with_sensitivities : bool
        Whether each tolerance is taken alone to its limits as well.

    Raises
    ------
    InputError
        When the specification is wrong or names what the lens does not have, or the lens cannot be judged by it.
    StateError
        When its file cannot be read.
    """
    given = spec if isinstance(spec, Specification) else specification(spec)
    wanted = given.tolerances
    check_copies(lens)
    found = limits(lens, given)
    state, front = _state(lens, given)
    deviations = tuple(limit.deviation for limit in found)
    count = copies or wanted.copies
    made = Copies(state, deviations, drawn(found, count, wanted.seed if seed is None else seed))
    plain = Copies(state, deviations, np.zeros((1, len(found), 2)))
    tried = Copies(state, deviations, np.concatenate([plain.values, made.values[:PROBES]]))
    judge, fields, errors = _judge(given, tried, front)
    design = judge.scores(plain, wanted.refocus)
    rows = _sensitivities(state, found, judge, design, wanted.refocus) if with_sensitivities else ()
    scores = judge.scores(made, wanted.refocus)
    return ToleranceRun(state, wanted, found, fields, judge.film, design, scores, made, rows, *errors)


def _state(lens: Lens, given: Specification) -> tuple[Lens, float]:
    """Return the design as copies are judged, and the distance from the object to its first vertex [mm]."""
    wanted = given.tolerances
    if wanted.zoom is not None:
        lens = configured(lens, wanted.zoom)
    wave = wanted.merit.wavelengths_nm[len(wanted.merit.wavelengths_nm) // 2]
    if wanted.f_number is not None:
        lens = lens.with_stop_diameter(lens.stop_diameter_for(wanted.f_number, wave))
    if wanted.focus_distance_m is None:
        return lens, math.inf
    distance = 1e3 * wanted.focus_distance_m
    lens, film = brought_to_focus(lens, distance, wave)
    return lens, distance - lens.length - film


def _judge(given: Specification, tried: Copies, front: float) -> tuple[Judge, tuple[float, ...], tuple[float, float]]:
    """Return what gives scores, with the film of the design at its best; the fields; and the errors of its rays.

    Each field has as many rays as leave the scores of some copies, the first of which is the design, where they are.
    """
    lens, merit = tried.lens, given.tolerances.merit
    wave = merit.wavelengths_nm[len(merit.wavelengths_nm) // 2]
    film = film_distance(lens, front, "front", wave)
    degrees = tuple(dict.fromkeys(merit.fields_degrees or default_fields(lens, film, front, wave)))
    try:
        fields = fields_of(lens, degrees, front, wave)
        rays = [field.rays(RINGS[1], 2 * RINGS[1]) for field in fields]
    except InputError as problem:
        raise given.problem(("merit", "fields_degrees"), str(problem)) from None

    def judge(rays: Sequence[list[FieldRays]], film: float) -> Judge:
        return Judge(lens, [one for each in rays for one in each], merit, film)

    film += judge(rays, film).best_shift(lens)
    shifts = judge(rays, film).scores(tried, given.tolerances.refocus).shifts_mm
    found = [_enough(field, merit, film, tried, shifts) for field in fields]
    rays = [field_rays for field_rays, _ in found]
    few, many = (_joined([scores[k] for _, scores in found]) for k in (0, 1))
    film += judge(rays, film).best_shift(lens)
    errors = _moves(few.spot_um, many.spot_um, many.spot_um), _moves(few.modulation, many.modulation, 1.0)
    return judge(rays, film), degrees, errors


def _enough(
    field: Field, merit: Merit, film: float, tried: Copies, shifts: Array
) -> tuple[list[FieldRays], tuple[Scores, Scores]]:
    """Return the rays of a field, and what some copies are worth by them and by more.

    They are as many as spots need. Modulation needs many more where spots are large: what rays do between these is by
    polynomials, which traced rays confirm.
    """

    def judged(rays: list[FieldRays]) -> Scores:
        return Judge(tried.lens, rays, merit, film).scores(tried, False, shifts)

    def spots_move(few: Scores, many: Scores) -> float:
        return _moves(few.spots_um, many.spots_um, many.spots_um)

    def modulation_moves(few: Scores, many: Scores) -> float:
        return _moves(few.modulation, many.modulation, 1.0)

    if merit.rings is not None or merit.arms is not None:
        rings = merit.rings or max(2, (merit.arms or 0) // 2)
        rays = field.rays(rings, merit.arms or 2 * rings)
        return rays, (judged(rays), judged(field.rays(2 * rings, 2 * (merit.arms or 2 * rings))))
    tries = [field.rays(rings, 2 * rings) for rings in RINGS[:2]]
    scores = [judged(rays) for rays in tries]
    while len(tries) < len(RINGS) and (
        spots_move(*scores[-2:]) > SPOTS_STAY or modulation_moves(*scores[-2:]) > MODULATION_STAYS
    ):
        tries.append(field.rays(RINGS[len(tries)], 2 * RINGS[len(tries)]))
        scores.append(judged(tries[-1]))
    # Where figures do not come to rest, as those of copies that lose rays at an edge do, few rays are as good as many.
    allowed = max(SPOTS_STAY, 2 * spots_move(*scores[-2:])), max(MODULATION_STAYS, 2 * modulation_moves(*scores[-2:]))
    for number, rays in enumerate(tries[:-2]):
        if spots_move(scores[number], scores[-1]) <= allowed[0]:
            filled = [few.filled_in(many) for few, many in zip(rays, tries[-2], strict=True)]
            found = judged(filled)
            if modulation_moves(found, scores[-1]) <= allowed[1]:
                return filled, (found, scores[-1])
    return tries[-2], (scores[-2], scores[-1])


def _joined(scores: Sequence[Scores]) -> Scores:
    """Return the scores of several fields as those of one lens."""
    spots, mtf = (np.concatenate([getattr(one, name) for one in scores], axis=1) for name in ("spots_um", "mtf"))
    return Scores(spots, mtf, scores[0].shifts_mm)


def _moves(one: Array, other: Array, scale: Array | float) -> float:
    """Return the largest difference, in units of a scale, of numbers that are finite."""
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.abs(one - other) / scale
    return float(np.max(found, where=np.isfinite(found), initial=0.0))


def _sensitivities(
    lens: Lens, found: Sequence[Limit], judge: Judge, design: Scores, refocus: bool
) -> tuple[Sensitivity, ...]:
    """Return what each tolerance alone does, at each of its ends."""
    rows: list[tuple[int, int, float, str]] = []
    for number, limit in enumerate(found):
        for k, axis in enumerate(("x", "y") if limit.deviation.is_pair else ("",)):
            rows += [(number, k, limit.size, f"+{axis}"), (number, k, -limit.size, f"-{axis}")]
    values = np.zeros((len(rows), len(found), 2))
    for place, (number, k, value, _) in enumerate(rows):
        values[place, number, k] = value
    scores = judge.scores(Copies(lens, tuple(limit.deviation for limit in found), values), refocus)
    spots, mtf = scores.spot_um, scores.modulation
    return tuple(
        Sensitivity(
            found[number].label, direction, float(spots[k]), float(mtf[k]), float(spots[k] - design.spot_um[0]),
            float(mtf[k] - design.modulation[0]), float(scores.shifts_mm[k]),
        )
        for k, (number, _, _, direction) in enumerate(rows)
    )  # fmt: skip


def _cost(rank_by: str, one: Sensitivity) -> float:
    return one.spot_change_um if rank_by == "spot" else -one.mtf_change
