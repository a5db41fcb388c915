"""Tolerance runs: copies of a lens made at random; yield, worst offenders, the loosest set, a copy to render by."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import cached_property
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import remember
from rptcam_cl.optics.as_built import Copies, Deviation, check_copies, film_points
from rptcam_cl.optics.charts import FAINT, INK, new_figure, series, styled
from rptcam_cl.optics.design import Problem
from rptcam_cl.optics.lens import Lens, brought_to_focus, in_configuration
from rptcam_cl.rendering import tolerances as tolerancing
from rptcam_cl.rendering.tolerances import FilmPoints, Judge, Limit, Scores, Specification, limits, specification
from rptcam_cl.scene.lens_settings import Tolerances

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# A tolerance run: many copies of a lens made at random and judged, and each tolerance alone at its limits.

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
        With their compensators as they were set, behind what was drawn.
    compensators : sequence of Limit
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
    compensators: Sequence[Limit]
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
            of_copies = percentile(merit, percent)
            return Interval(
                of_copies.value, of_copies.low * (1 - self.spot_error), of_copies.high * (1 + self.spot_error)
            )
        of_copies = percentile(-merit, percent)
        return Interval(-of_copies.value, -of_copies.high - self.mtf_error, -of_copies.low + self.mtf_error)

    def yield_at(self, limit: float) -> Interval:
        """The share of all copies that is at least as good as a limit, with the bounds of its 95 % interval.

        They hold what more copies and what more rays would change.
        """
        merit = self.scores.by(self.rank_by)
        if self.rank_by == "spot":
            merit, limit, error = -merit, -limit, limit * self.spot_error
        else:
            error = self.mtf_error
        of_copies, worst, best = (
            share(int(np.count_nonzero(merit >= limit + off)), len(merit)) for off in (0.0, error, -error)
        )
        return Interval(of_copies.value, worst.low, best.high)

    def adjustments(self) -> list[tuple[str, float, float]]:
        """List each compensator with the rms of its settings and the share of the copies at its end, both of 1."""
        rows = []
        for number, limit in enumerate(self.compensators, start=len(self.limits)):
            axes = 2 if limit.deviation.is_pair else 1
            shares = np.abs(self.copies.values[:, number, :axes]) / (limit.size or 1.0)
            at_end = np.any(shares > 1 - 1e-9, axis=1)
            rows.append((limit.label, float(np.sqrt(np.mean(shares**2))), float(at_end.mean())))
        return rows

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
    trace: FilmPoints = film_points,
) -> ToleranceRun:
    """Find how copies of a lens turn out within tolerances.

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
    trace : FilmPoints
        What traces the copies: the host, or the method of a `CopiesTracer` of `rptcam_cl.rendering.traceable_lens`.

    Raises
    ------
    InputError
        When the specification is wrong or names what the lens does not have, or the lens cannot be judged by it.
    StateError
        When its file cannot be read.
    """
    spec = spec if isinstance(spec, Specification) else specification(spec)
    wanted = spec.tolerances
    check_copies(lens)
    within = limits(lens, spec)
    state, front = _state(lens, spec)
    deviations = tuple(limit.deviation for limit in within)
    count = copies or wanted.copies
    sample = Copies(state, deviations, draw_values(within, count, wanted.seed if seed is None else seed))
    plain = Copies(state, deviations, np.zeros((1, len(within), 2)))
    tried = Copies(state, deviations, np.concatenate([plain.values, sample.values[:PROBES]]))
    adjusted = limits(lens, spec, "compensators")
    judge, fields, errors = tolerancing.judge_of(spec, tried, front, adjusted, trace)
    design = judge.scores(plain, wanted.refocus)
    rows = _sensitivities(state, within, judge, design, wanted.refocus) if with_sensitivities else ()
    sample = judge.adjusted(sample, wanted.refocus)
    scores = judge.scores(sample, wanted.refocus)
    return ToleranceRun(state, wanted, within, fields, judge.film, design, scores, sample, adjusted, rows, *errors)


def _state(lens: Lens, given: Specification) -> tuple[Lens, float]:
    """Return the design as copies are judged, and the distance from the object to its first vertex [mm]."""
    wanted = given.tolerances
    if wanted.zoom is not None:
        lens = in_configuration(lens, wanted.zoom)
    if wanted.heat is not None:
        lens = wanted.heat.lens(lens)
    wave = wanted.merit.wavelengths_nm[len(wanted.merit.wavelengths_nm) // 2]
    if wanted.f_number is not None:
        lens = lens.with_stop_diameter(lens.stop_diameter_for(wanted.f_number, wave))
    if wanted.focus_distance_m is None:
        return lens, math.inf
    distance = 1e3 * wanted.focus_distance_m
    lens, film = brought_to_focus(lens, distance, wave)
    return lens, distance - lens.length - film


def _sensitivities(
    lens: Lens, within: Sequence[Limit], judge: Judge, design: Scores, refocus: bool
) -> tuple[Sensitivity, ...]:
    """Score the design with each tolerance alone at each of its ends."""
    rows: list[tuple[int, int, float, str]] = []
    for number, limit in enumerate(within):
        for k, axis in enumerate(("x", "y") if limit.deviation.is_pair else ("",)):
            rows += [(number, k, limit.size, f"+{axis}"), (number, k, -limit.size, f"-{axis}")]
    values = np.zeros((len(rows), len(within), 2))
    for place, (number, k, value, _) in enumerate(rows):
        values[place, number, k] = value
    alone_at_ends = Copies(lens, tuple(limit.deviation for limit in within), values)
    scores = judge.scores(judge.adjusted(alone_at_ends, refocus), refocus)
    spots, mtf = scores.spot_um, scores.modulation
    return tuple(
        Sensitivity(
            within[number].label, direction, float(spots[k]), float(mtf[k]), float(spots[k] - design.spot_um[0]),
            float(mtf[k] - design.modulation[0]), float(scores.shifts_mm[k]),
        )
        for k, (number, _, _, direction) in enumerate(rows)
    )  # fmt: skip


def _cost(rank_by: str, one: Sensitivity) -> float:
    return one.spot_change_um if rank_by == "spot" else -one.mtf_change


# The spot of copies as a number that an optimiser follows: all lenses that it tries get the same errors.

COPIES = 32


def spot_of_copies(problem: Problem) -> Callable[[Lens, float], float]:
    """Return the function that finds the rms spot of copies of a lens [um], by the tolerances of a problem.

    It is the root of the mean square over copies, at fields and wavelengths of the problem; infinite where the lens
    cannot be judged.
    """
    given = specification(problem.tolerances)
    beams = {"fields_degrees": problem.fields_degrees, "wavelengths_nm": problem.wavelengths_nm}
    merit, heat = given.tolerances.merit.model_copy(update=beams), given.tolerances.heat

    def spot_um(lens: Lens, film_distance_mm: float) -> float:
        try:
            if heat is not None:
                lens, film_distance_mm = heat.lens(lens), heat.film(film_distance_mm)
            within = limits(lens, given)
            values = draw_values(within, COPIES, given.tolerances.seed)
            copies = Copies(lens, tuple(limit.deviation for limit in within), values)
            distance, nm = problem.object_distance_mm, merit.wavelengths_nm[0]
            fields = [tolerancing.sample_field(lens, degrees, distance, nm)(4, 8) for degrees in problem.fields_degrees]
            rays = [one for field in fields for one in field]
            judge = Judge(lens, rays, merit, film_distance_mm, limits(lens, given, "compensators"))
            refocus = given.tolerances.refocus
            scores = judge.scores(judge.adjusted(copies, refocus), refocus)
        except InputError:
            return math.inf
        return float(np.sqrt(np.mean(scores.spot_um**2)))

    return spot_um


# The loosest set of tolerances with which enough copies are good enough.

_LOOSEST, _TIGHTEST = 10.0, 1e-3  # times what the specification says
_LEAST_COST = 1e-4  # of the worst: tolerances that cost less are treated alike
STEPS = 12  # of the bisection for the common factor, each a sample of copies


@dataclass(frozen=True)
class LoosestSet:
    """Tolerances that make a yield.

    Attributes
    ----------
    specification : dict
        As a file has it: an entry for each thing that may be off.
    factors : (limits,) array
        By which each is looser than in the specification that it comes from.
    labels : tuple of str
        What they were of, and how large.
    run : ToleranceRun
        Other copies, made within it.
    """

    specification: dict[str, Any]
    factors: Array
    labels: tuple[str, ...]
    run: ToleranceRun


def loosest_set(
    lens: Lens,
    spec: str | Path | Mapping[str, Any] | Tolerances | Specification,
    limit: float,
    percent: float,
    *,
    copies: int | None = None,
    seed: int | None = None,
    trace: FilmPoints = film_points,
) -> LoosestSet:
    """Find the loosest tolerances of the kinds of a specification, so that this percent of the copies reach a limit.

    What makes a tolerance narrow costs as 1 / size (Sutherland and Roth 1975). With variances of the spot that add up,
    least cost for a variance gives each the size a^(-1/3) of what it adds at its limit; their common factor is found by
    copies, all of which have the same random numbers, such that the 95 % interval of their yield begins at what is
    wanted. None becomes looser than ten times the specification.

    Parameters
    ----------
    limit : float
        Rms spot [µm], or modulation where copies are ranked by it.
    percent : float
        Above 0 and below 100.
    copies, seed, trace
        As of `tolerance`.

    Raises
    ------
    InputError
        Where the design itself does not reach the limit.
    """
    spec = spec if isinstance(spec, Specification) else specification(spec)
    run = tolerance(lens, spec, copies=copies, seed=seed, trace=trace)
    by_spot, design = run.rank_by == "spot", float(run.design.by(run.rank_by)[0])
    if not (design < limit if by_spot else design > limit):
        unit = " µm of rms spot" if by_spot else " of modulation"
        raise InputError(f"{lens.name}: no tolerances reach {limit:g}{unit}: the design itself has {design:.4g}")
    shares = _shares_by_cost(run, design, by_spot=by_spot)
    front, adjusted = _state(lens, spec)[1], limits(lens, spec, "compensators")
    judge, _, _ = tolerancing.judge_of(spec, run.copies, front, adjusted, trace)
    drawn, refocus = len(run.limits), run.tolerances.refocus
    made = Copies(run.copies.lens, run.copies.deviations[:drawn], run.copies.values[:, :drawn])

    def reached(scale: float) -> float:
        values = made.values * np.minimum(scale * shares, _LOOSEST)[:, None]
        merit = judge.scores(judge.adjusted(replace(made, values=values), refocus), refocus).by(run.rank_by)
        good = merit <= limit if by_spot else merit >= limit
        return share(int(np.count_nonzero(good)), len(good)).low

    factors = np.minimum(_loosest_scale(lambda scale: 100 * reached(scale) >= percent) * shares, _LOOSEST)
    name = f"{spec.tolerances.name or 'tolerances'}, {percent:g} % of {lens.name} at {limit:g}"
    entries = [
        tolerancing.alone(lens, spec, one, factor) for one, factor in zip(run.limits, factors.tolist(), strict=True)
    ]
    written = _with_entries(spec, name, entries)
    return LoosestSet(
        written, factors, tuple(one.label for one in run.limits),
        tolerance(lens, written, copies=copies, seed=seed, with_sensitivities=False, trace=trace),
    )  # fmt: skip


def _loosest_scale(is_enough: Callable[[float], bool]) -> float:
    """Return the largest scale of all tolerances at which copies are good enough."""
    low, high = math.log(_TIGHTEST), math.log(_LOOSEST)
    if is_enough(math.exp(high)):
        return math.exp(high)
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if is_enough(math.exp(middle)) else (low, middle)
    return math.exp(low)


def _with_entries(spec: Specification, name: str, entries: list[dict[str, Any]]) -> dict[str, Any]:
    """Return a specification as data, under a name, with other tolerances."""
    given = spec.tolerances.model_dump(mode="json", exclude_none=True, exclude={"tolerances", "source"})
    kept = ("compensators", "distribution", "sigmas", "copies", "seed", "refocus", "f_number", "focus_distance_m",
            "zoom", "temperature_c", "pressure_hpa", "barrel", "merit")  # fmt: skip
    return {"name": name} | {key: given[key] for key in kept if key in given} | {"tolerances": entries}


def _shares_by_cost(run: ToleranceRun, design: float, *, by_spot: bool) -> NDArray[np.float64]:
    """Return the size of each tolerance, relative to the others, of least cost for what they add to the merit."""
    cost = dict.fromkeys((one.label for one in run.limits), 0.0)
    for one in run.sensitivities:
        added = one.spot_um**2 - design**2 if by_spot else design - one.mtf
        cost[one.label] = max(cost[one.label], added if math.isfinite(added) else math.inf)
    adds = np.array([cost[one.label] for one in run.limits])
    worst = adds[np.isfinite(adds)].max(initial=0.0) or 1.0
    return np.clip(np.where(np.isfinite(adds), adds, worst) / worst, _LEAST_COST, 1.0) ** (-1 / 3)


# One copy of a lens, chosen by how good it is among all: the lens behind which a picture is taken.

REMEMBERED = 8  # runs


@dataclass(frozen=True)
class ChosenCopy:
    """A copy at a percentile.

    Attributes
    ----------
    percent : float
        Of the copies are as good or better.
    number : int
        Which one it is.
    deviations : sequence of Deviation
    values : (1, deviations, 2) array
        What is off, as `Copies` has it.
    shift_mm : float
        How far refocusing moves its film along the light.
    spot_um, mtf : float
        Its merit.
    """

    percent: float
    number: int
    deviations: Sequence[Deviation]
    values: NDArray[np.float64]
    shift_mm: float
    spot_um: float
    mtf: float

    def lens(self, state: Lens) -> Lens:
        """Return the copy in the state that its design has: zoomed, stopped down, focused."""
        return Copies(state, self.deviations, self.values).copy(0)


def chosen_copy(lens: Lens, spec: Specification, percent: float) -> ChosenCopy:
    """Return the copy of a lens at a percentile; the run is remembered.

    Parameters
    ----------
    lens : Lens
        The design as its file has it: the copy stays the same however the lens is set.
    percent : float
        Above 0, at most 100.

    Raises
    ------
    InputError
        As `tolerance`.
    """
    limits(lens, spec)  # whose errors name the place in the specification
    run = _tolerance_run(lens, spec.tolerances)
    number, scores = run.copy_at(percent), run.scores
    own = (float(each[number]) for each in (scores.shifts_mm, scores.spot_um, scores.modulation))
    return ChosenCopy(percent, number, run.copies.deviations, run.copies.values[number : number + 1], *own)


def _key(lens: Lens, tolerances: Tolerances) -> Hashable:
    content = lens.name, lens.surfaces, lens.stop_index, lens.object_medium, lens.configurations, lens.floating
    return content, tolerances


@remember(most=REMEMBERED, by=_key)
def _tolerance_run(lens: Lens, tolerances: Tolerances) -> ToleranceRun:
    return tolerance(lens, tolerances, with_sensitivities=False)


# A tolerance run as plain data: for JSON, and for tables.

PERCENTILES = (10.0, 25.0, 50.0, 75.0, 90.0, 95.0, 98.0)
CURVE = 41  # points of a yield curve


def percentile_rows(run: ToleranceRun) -> list[dict[str, Any]]:
    """Return a row for each of `PERCENTILES`: the merit that this percent of copies reach, and which copy does."""
    rows = []
    for percent in PERCENTILES:
        number = run.copy_at(percent)
        interval = run.percentile(percent)
        rows.append(
            {
                "percent": percent,
                "copy": number,
                "spot_um": float(run.scores.spot_um[number]),
                "mtf": float(run.scores.modulation[number]),
                "low": interval.low,
                "high": interval.high,
                "shift_mm": float(run.scores.shifts_mm[number]),
            }
        )
    return rows


def yield_curve(run: ToleranceRun, points: int = CURVE) -> list[tuple[float, Interval]]:
    """List limits of the merit and the share of all copies that is as good: from the best to the worst in whose fields
    light arrives.
    """
    merit = run.scores.by(run.rank_by)
    merit = merit[np.isfinite(merit)]
    if not len(merit):
        raise InputError(f"{run.lens.name}: every copy loses the light of some field; the tolerances are too wide")
    return [(float(limit), run.yield_at(float(limit))) for limit in np.linspace(merit.min(), merit.max(), points)]


def report(run: ToleranceRun) -> dict[str, Any]:
    """Everything about a run but the numbers of each copy."""
    merit = run.tolerances.merit
    return {
        "lens": run.lens.name,
        "tolerances": run.tolerances.name,
        "source": run.tolerances.source,
        "rank_by": run.rank_by,
        "copies": run.copies.count,
        "refocus": run.tolerances.refocus,
        "fields_degrees": list(run.fields_degrees),
        "wavelengths_nm": list(merit.wavelengths_nm),
        "mtf_per_mm": merit.mtf_per_mm,
        "film_distance_mm": run.film_distance_mm,
        "design": {"spot_um": float(run.design.spot_um[0]), "mtf": float(run.design.modulation[0])},
        "sampling_error": {"spot_share": run.spot_error, "mtf": run.mtf_error},
        "percentiles": percentile_rows(run),
        "yield": [{"limit": limit, **asdict(each)} for limit, each in yield_curve(run)],
        "compensators": [
            {"label": label, "rms_of_range": rms, "at_end": at_end} for label, rms, at_end in run.adjustments()
        ],
        "sensitivities": [asdict(one) for one in run.sensitivities],
    }


# The chart of a tolerance run: how many copies are good enough, and which tolerances cost most.

_CHART_SIZE = (8.0, 7.6)  # inches
_OFFENDERS = 10
LIMITS = 101


@styled()
def tolerance_chart(run: ToleranceRun) -> Figure:
    """Return the yield curve with its 95 % band, above the worst offenders."""
    tolerances = f" within {run.tolerances.name} tolerances" if run.tolerances.name else ""
    figure = new_figure(f"{run.lens.name}: {run.copies.count} copies{tolerances}", _CHART_SIZE)
    parts = figure.subfigures(2, 1, squeeze=False, height_ratios=(5, 4))
    _draw_yield(parts[0, 0].add_subplot(), run)
    _draw_offenders(parts[1, 0].add_subplot(), run)
    return figure


def _draw_yield(axes: Axes, run: ToleranceRun) -> None:

    scale, unit = _scale(run)
    curve = yield_curve(run, LIMITS)
    limits = scale * np.array([limit for limit, _ in curve])
    value, low, high = (100 * np.array(row) for row in zip(*(interval for _, interval in curve), strict=True))
    axes.fill_between(limits, low, high, color=series(0), alpha=0.2, linewidth=0)
    axes.plot(limits, value, color=series(0))
    design = scale * float(run.design.by(run.rank_by)[0])
    axes.axvline(design, color=FAINT, linestyle=":")
    axes.text(design, 93, " design", color=INK)
    side = "or less" if run.rank_by == "spot" else "or more"
    axes.set(xlabel=f"{unit}, {side}", ylabel="copies [%]", ylim=(0, 102))


def _draw_offenders(axes: Axes, run: ToleranceRun) -> None:
    scale, _ = _scale(run)
    change = "spot with one tolerance at its limit, less the design's [µm]"
    if run.rank_by != "spot":
        change = "modulation with one tolerance at its limit, less the design's [%]"
    worst = run.worst_offenders(_OFFENDERS)[::-1]
    changes = [scale * (one.spot_change_um if run.rank_by == "spot" else one.mtf_change) for one in worst]
    axes.barh([f"{one.label}, {one.direction}" for one in worst], changes, color=series(1))
    axes.set(xlabel=change)
    axes.tick_params(axis="y", labelsize=8)
    axes.grid(False, axis="y")


def _scale(run: ToleranceRun) -> tuple[float, str]:
    if run.rank_by == "spot":
        return 1.0, "rms spot over the fields [µm]"
    return 100.0, f"modulation at {run.tolerances.merit.mtf_per_mm:g} cycles/mm [%]"


#
# The random numbers of a tolerance run, each keyed by seed, tolerance and copy.
#
# A copy is therefore the same however many are made, and a tolerance added at the end of a specification leaves what
# the others draw as it was.

_NORMAL = np.vectorize(NormalDist().inv_cdf, otypes=[np.float64])


def draw_values(limits: Sequence[Limit], copies: int, seed: int) -> Array:
    """Draw values (copies, limits, 2) of all that may be off.

    A single number lies within ± its size: evenly, by a normal distribution cut off there, or at one of the two ends. A
    pair lies in the disc of that radius: evenly over its area, by the normal distribution of both cut off at its rim,
    or on the rim.
    """
    values = np.zeros((copies, len(limits), 2))
    for number, limit in enumerate(limits):
        key = np.random.SeedSequence([seed, *limit.key])
        chances = np.random.Generator(np.random.Philox(key)).random((copies, 2))
        values[:, number] = _pairs(limit, chances) if limit.deviation.is_pair else _numbers(limit, chances)
    return values


def _numbers(limit: Limit, chances: Array) -> Array:
    chance = chances[:, 0]
    match limit.distribution:
        case "uniform":
            share = 2.0 * chance - 1.0
        case "end_point":
            share = np.where(chance < 0.5, -1.0, 1.0)
        case "normal":
            outside = NormalDist().cdf(-limit.sigmas)
            share = np.clip(_NORMAL(outside + chance * (1.0 - 2.0 * outside)) / limit.sigmas, -1.0, 1.0)
    return np.stack([limit.size * share, np.zeros_like(share)], axis=1)


def _pairs(limit: Limit, chances: Array) -> Array:
    chance, angle = chances[:, 0], 2.0 * np.pi * chances[:, 1]
    match limit.distribution:
        case "uniform":
            share = np.sqrt(chance)
        case "end_point":
            share = np.ones_like(chance)
        case "normal":  # the distance from the middle has the distribution of Rayleigh
            inside = -np.expm1(-0.5 * limit.sigmas**2)
            share = np.sqrt(-2.0 * np.log1p(-chance * inside)) / limit.sigmas
    return np.asarray((limit.size * share)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))


# Shares and percentiles of a sample, each with the interval in which that of all copies lies.

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Interval:
    """An estimate and the bounds that hold it with a given confidence; each may be infinite."""

    value: float
    low: float
    high: float

    def __iter__(self) -> Iterator[float]:
        return iter((self.value, self.low, self.high))


def share(hits: int, count: int) -> Interval:
    """The share of all copies that is good, of how many of a sample are (Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    z = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2)
    ratio, weight = hits / count, 1.0 / (1.0 + z * z / count)
    middle = weight * (ratio + z * z / (2 * count))
    half = weight * z * math.sqrt(ratio * (1 - ratio) / count + (z / (2 * count)) ** 2)
    low, high = (0.0 if hits == 0 else middle - half), (1.0 if hits == count else middle + half)
    return Interval(ratio, low, high)


def rank(percent: float, count: int) -> int:
    """Return the place, from 0, of a percentile among sorted copies: that percent of them are at most as bad.

    Raises
    ------
    InputError
        For a percentile that is not above 0 and at most 100.
    """
    if not 0 < percent <= 100:
        raise InputError(f"a percentile must be above 0 and at most 100 % (got {percent:g} %)")
    return max(math.ceil(percent / 100 * count - 1e-9), 1) - 1


def percentile(ordered: Array, percent: float) -> Interval:
    """Return a percentile of sorted numbers, and the bounds that hold that of all copies, whatever their distribution.

    How many of a sample lie below the true percentile is binomial, so the bounds are two of the sorted numbers (David
    and Nagaraja, Order Statistics, 3rd ed., 7.1); a sample too small for the confidence has its ends.
    """
    count, p = len(ordered), percent / 100
    place = rank(percent, count)
    below = np.cumsum(_binomial(count, p))  # chance that at most k of the sample lie below it
    tail = (1 - CONFIDENCE) / 2
    low = int(np.searchsorted(below, tail, side="right")) - 1
    high = int(np.searchsorted(below, 1 - tail, side="left"))
    low, high = max(low, 0), min(high, count - 1)
    return Interval(float(ordered[place]), float(ordered[min(low, place)]), float(ordered[max(high, place)]))


def _binomial(count: int, p: float) -> Array:
    """Return the chance of k hits of `count`, for k from 0 to `count`."""
    if p >= 1:
        return np.asarray(np.eye(count + 1)[-1])
    k = np.arange(count + 1)
    factorials = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, count + 1)))])
    logarithm = factorials[-1] - factorials[k] - factorials[count - k] + k * math.log(p) + (count - k) * math.log1p(-p)
    return np.asarray(np.exp(logarithm))
