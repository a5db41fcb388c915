"""What a comparison of approximations found: its report, and its advice in words, tables and a plot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.charts import FAINT, INK, add_key, chart_svg, new_figure, series, styled
from rptcam_cl.rendering.tolerance_run import CONFIDENCE, Interval
from rptcam_cl.studies.tiers import FIELDS, TierError
from rptcam_cl.studies.tradeoff_errors import AS_IT_IS, REFERENCE, TARGETS, MeasuredVariant

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure


# What a comparison of configurations found, as data.

TITLE = "Accuracy and time"


@dataclass(frozen=True)
class Advice:
    """Which configuration suits a request.

    Attributes
    ----------
    wish : str
        ``time`` or ``error``.
    amount : float
        Time [s] or relative error (root of relMSE).
    chosen : str or None
        Name of the configuration; None where none reaches the error, or gives every pixel a sample in the time.
    seconds, error : float
        Its time [s] and its error, with the bias at the upper end of its interval.
    samples : int
        Samples per pixel for that; 0 where none reaches the error.
    least_error, most_error : float
        Interval of the error after these samples, from the ends of those of noise and bias.
    full_seconds, full_error : float
        The same of the most accurate configuration.
    perhaps : str or None
        Another one that is clearly better if its bias is what was measured, and not the upper end of its interval.
    """

    wish: str
    amount: float
    chosen: str | None
    seconds: float
    error: float
    samples: int
    least_error: float
    most_error: float
    full_seconds: float
    full_error: float
    perhaps: str | None


@dataclass(frozen=True)
class TradeoffReport:
    """What a comparison of configurations found; it writes itself as text, as Markdown and as a plot.

    Attributes
    ----------
    scene, device : str
    resolution : (width, height)
    tiles : (rendered, all)
        Number of tiles of 8 x 8 pixels.
    grid : (rows, columns)
        Rows and columns of the rendered tiles.
    samples : (int, int, int)
        Samples per pixel of the three sets of pictures; the last has some of the tiles only.
    long_tiles : int
        How many tiles the last set has.
    seeds : int
        Number of independent pictures in each of the first two sets.
    seconds : float
        Time of the whole measurement [s].
    by_cpu : bool
        Whether times are CPU times divided by the number of cores.
    measurements : tuple of MeasuredVariant
        The most accurate configuration first.
    cameras : tuple of TierError
        Errors of cheaper camera models over the field, traced in float64.
    allowed : str
        Camera model that `camera.accuracy: auto` takes; empty without a lens of surfaces.
    lens_colour_px : float or None
        Greatest displacement of light of other wavelengths by the lens [pixels].
    diffraction : dict or None
        What `camera.diffraction: auto` decides, with the Airy radius [pixels]; none of the pictures has it.
    ghosts : float or None
        Share of a lamp's light on the axis that `camera.ghosts` adds within the frame; none of the pictures has it.
        None where surfaces reflect nothing.
    budget : float
        How long the measurement was to take [s]; 0 where that is not known.
    truncation : dict
        Bound on the light of paths beyond the scene's depth.
    advice : tuple of Advice
    skipped : dict
        Configurations that could not be rendered, and why.
    """

    scene: str
    device: str
    resolution: tuple[int, int]
    tiles: tuple[int, int]
    grid: tuple[int, int]
    samples: tuple[int, int, int]
    long_tiles: int
    seeds: int
    seconds: float
    by_cpu: bool
    measurements: tuple[MeasuredVariant, ...]
    cameras: tuple[TierError, ...]
    allowed: str
    lens_colour_px: float | None
    truncation: dict[str, Any]
    advice: tuple[Advice, ...] = ()
    skipped: dict[str, str] = field(default_factory=dict)
    diffraction: dict[str, Any] | None = None
    ghosts: float | None = None
    budget: float = 0.0

    def named(self, name: str) -> MeasuredVariant:
        """Return the measurement of a configuration by its name or by that of another that is the same way."""
        for measurement in self.measurements:
            if name in (measurement.name, *measurement.same_as):
                return measurement
        names = [known for measurement in self.measurements for known in (measurement.name, *measurement.same_as)]
        raise InputError(f"{name}: was not compared (there are: {', '.join(names)})")

    def camera_of(self, measurement: MeasuredVariant) -> TierError | None:
        """Return the errors of a configuration's camera model, where it is not the traced lens."""
        return next((each for each in self.cameras if each.tier == measurement.tier), None)

    @property
    def slowed(self) -> float:
        """How many times as long renders took by the clock as on an idle machine."""
        full = self.measurements[0]
        return full.wall_sample_s.value / full.sample_s.value

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values; what is infinite becomes null in JSON, which means never (or always)."""
        values = asdict(self)
        for measurement in values["measurements"]:
            measurement["seconds_to"] = {f"{target:g}": value for target, value in measurement["seconds_to"].items()}
        return values | {"fields": list(FIELDS), "confidence": CONFIDENCE}

    def __str__(self) -> str:
        """Return advice, tables and how they were found, as ``rptcam tradeoff --details`` prints them."""
        return _plain_text(self)

    def markdown(self, title: str = TITLE) -> str:
        """Return the same as Markdown."""
        return markdown(self, title)

    def svg(self, title: str = TITLE) -> str:
        """Return the three pictures as the text of an SVG file: errors over time and over the field, and where."""
        return chart_svg(tradeoff_plot(self, title))

    def _repr_markdown_(self) -> str:
        return self.markdown()


# Numbers and intervals as people read them.

_MINUTE, _HOUR, _DAY = 60.0, 3600.0, 86400.0
_LONGEST = _DAY  # renders of which nobody asks when they cross
_VAGUE = 30.0  # times the lower end of an interval that the upper is, where a crossing is too close to call


def seconds(value: float) -> str:
    """Return a time, as ``23 ms``, ``4.2 s`` or ``1.5 h``; an infinite one is ``never``."""
    if math.isinf(value):
        return "never"
    for below, unit, scale in (
        (1.0, "ms", 1e-3),
        (2 * _MINUTE, "s", 1.0),
        (2 * _HOUR, "min", _MINUTE),
        (2 * _DAY, "h", _HOUR),
    ):
        if value < below:
            return f"{_short(value / scale)} {unit}"
    return f"{_short(value / _DAY)} days"


def odds(share: float) -> str:
    """Return a probability as odds, ``odds 9 to 1``."""
    if share >= 0.99:
        return "odds of 99 to 1 or more"
    if share <= 0.01:
        return "odds of 1 to 99 or less"
    for_, against = share / min(share, 1 - share), (1 - share) / min(share, 1 - share)
    return f"odds {_short(for_)} to {_short(against)}"


def noise(share: float) -> str:
    """Return a noise as ``1.8 %``; above the brightness itself all are alike."""
    return "above 100 %" if share > 1 else per_cent(share)


def until(value: float) -> str:
    """Return a time until which something is better: ``never`` for 0, ``always`` for an infinite one."""
    if value <= 0:
        return "never"
    return "always" if math.isinf(value) else seconds(value)


def per_cent(share: float) -> str:
    """Return a share as ``1.8 %``."""
    return f"{_short(100 * share)} %"


def between(low: float, high: float) -> str:
    """Return two shares as ``1.8 to 2.1 %``; once where they are the same."""
    first, last = _short(100 * low), per_cent(high)
    return last if per_cent(low) == last else f"{first} to {last}"


def pixels(value: float) -> str:
    """Return a distance in pixels; an infinite one is where a lens sees nothing."""
    return "dark" if math.isinf(value) else f"{_short(value)} px"


def bias(interval: Interval) -> str:
    """Return the root of a bias (relMSE) with its interval; only the upper end where it may be zero."""
    low, value, high = (math.sqrt(max(end, 0.0)) for end in (interval.low, interval.value, interval.high))
    if high == 0:
        return "none"
    if low == 0:
        return f"below {per_cent(high)}"
    least, most = _short(100 * low), _short(100 * high)
    return per_cent(value) if least == most == _short(100 * value) else f"{per_cent(value)} ({least} to {most})"


def ends(interval: Interval, say: Callable[[float], str] = seconds) -> str:
    """Return an estimate with the ends of its interval in brackets, once where they are the same."""
    value, low, high = (say(end) for end in (interval.value, interval.low, interval.high))
    if low == high == value:
        return value
    units = {text.rpartition(" ")[2] for text in (value, low, high)}
    if len(units) == 1:
        low, high = (text.rpartition(" ")[0] for text in (low, high))
    return f"{value} ({low} to {high})"


def crossing(interval: Interval) -> str:
    """Return the time until which something is better, with its interval where that says anything."""
    if interval.high <= 0:
        return "never"
    if interval.low >= _LONGEST:
        return "always"
    beside = not interval.low <= interval.value <= interval.high  # an estimate that its own interval leaves out
    if interval.low <= 0 or interval.high > _VAGUE * interval.low or beside:
        below = interval.high < _LONGEST and (interval.low > 0 or interval.value > 0)
        return f"too close to call (before {until(interval.high)})" if below else "too close to call"
    return ends(interval, until)


def _short(value: float) -> str:
    """Return a number with two digits, or as a whole number from 10 on."""
    if value != 0 and abs(value) < 0.001:
        return f"{value:.1g}"
    return f"{value:.0f}" if abs(value) >= 9.95 else f"{value:.2g}"


# Which configuration to use for a time or an error.

WORTH = 1.05  # factor by which another configuration must be better than the most accurate one


def advise_for_time(measurements: Sequence[MeasuredVariant], seconds: float) -> Advice:
    """Return the configuration with the least error after a time; the first one unless another is clearly better.

    Its name is None where the time is too short for one sample per pixel.
    """
    best, error, full_error, perhaps = _choose(measurements, lambda each, end: each.error_after(seconds, end))
    if math.isinf(error):
        return Advice("time", seconds, None, seconds, math.inf, 0, math.inf, math.inf, seconds, math.inf, perhaps)
    samples = int(seconds / best.sample_s.value)
    ends = best.errors_after(samples * best.sample_s.value)
    return Advice("time", seconds, best.name, seconds, error, samples, *ends, seconds, full_error, perhaps)


def advise_for_error(measurements: Sequence[MeasuredVariant], error: float) -> Advice:
    """Return the configuration that reaches an error first; the most accurate one unless another is clearly faster."""
    best, time, full_time, perhaps = _choose(measurements, lambda each, end: each.seconds_until(error, end))
    if math.isinf(time):
        return Advice("error", error, None, math.inf, error, 0, 0.0, math.inf, full_time, error, perhaps)
    samples = max(math.ceil(time / best.sample_s.value), 1)
    ends = best.errors_after(samples * best.sample_s.value)
    return Advice("error", error, best.name, time, error, samples, *ends, full_time, error, perhaps)


def _choose(
    measurements: Sequence[MeasuredVariant], value_of: Callable[[MeasuredVariant, str], float]
) -> tuple[MeasuredVariant, float, float, str | None]:
    """Return the measurement of the least value, that value and that of the first one, and what may be better still.

    The first one is it unless another is clearly better with the worst noise and time that its interval allows. What
    may be better is another whose likely value, with its bias as measured, is clearly less than the value of the best.
    """
    measurements = _may_be_advised(measurements)
    full, *others = measurements
    at_worst = [full, *(_at_worst(other, full.rate.value) for other in others)]
    best = _clear_best([value_of(each, "high") for each in at_worst])
    likely = [value_of(each, "value") for each in measurements]
    value, perhaps = value_of(measurements[best], "high"), likely.index(min(likely))
    is_open = perhaps != best and WORTH * likely[perhaps] < value
    return measurements[best], value, value_of(full, "high"), measurements[perhaps].name if is_open else None


def _may_be_advised(measurements: Sequence[MeasuredVariant]) -> list[MeasuredVariant]:
    """Return the measurements that may be advised, the most accurate one first.

    Independent samples show what the lattice gains; they can be better only by chance. Where noise comes from rare
    paths, configurations that differ only in noise cannot be compared.
    """
    full = measurements[0]
    rare = [full.has_rare_paths or each.has_rare_paths for each in measurements]
    kept = [
        each
        for each, by_chance in zip(measurements[1:], rare[1:], strict=True)
        if each.knob != "sampler" and not (each.unbiased and by_chance)
    ]
    return [full, *kept]


def _at_worst(measurement: MeasuredVariant, full_rate: float) -> MeasuredVariant:
    """Return a measurement with the worst noise and time, relative to the first, that its interval allows."""
    if not (full_rate > 0 and measurement.rate.value > 0):
        return replace(measurement, sample_s=replace(measurement.sample_s, value=measurement.sample_s.high))
    times = full_rate / measurement.gain.low / measurement.rate.value if measurement.gain.low > 0 else math.inf
    first, last = (replace(end, value=end.value * times) for end in measurement.noise)
    return replace(measurement, noise=(first, last))


def _clear_best(values: Sequence[float]) -> int:
    """Return the index of the least value if it is clearly less than the first, else 0."""
    best = min(range(len(values)), key=values.__getitem__)
    return 0 if values[0] <= WORTH * values[best] else best


# The lines that matter: what to set, what it costs, what it gains; then what is probable or too close to call.

FULL = "full accuracy"
COMMAND = "rptcam render SCENE"
_PROBABLE = 0.75  # odds from which one configuration is called probably better
_LONGER = 4  # times the measurement, which halves its intervals


def _headline(report: TradeoffReport) -> list[str]:
    """Return three lines, then one for each configuration that may be better than the advised one."""
    said = [_each("Set", report, _set), _each("Costs", report, _cost), _each("Gains", report, _gain)]
    return said + list(dict.fromkeys(line for advice in report.advice for line in _open_questions(report, advice)))


def _name_in_sentence(report: TradeoffReport, name: str) -> str:
    """Return the name of a configuration in a sentence."""
    measurement = report.named(name)
    if AS_IT_IS in (name, *measurement.same_as):
        return f"the scene as it is{f' ({FULL})' if name == REFERENCE else ''}"
    if name == REFERENCE:
        return FULL
    return f"the {name}" if measurement.knob == "camera" else f"«{name}»"


def _each(title: str, report: TradeoffReport, say: Callable[[TradeoffReport, Advice], str]) -> str:
    return f"{title}: {'; '.join(say(report, advice) for advice in report.advice)}."


def _wish(advice: Advice) -> str:
    return f"in {seconds(advice.amount)}" if advice.wish == "time" else f"to an error of {per_cent(advice.amount)}"


def _settings(report: TradeoffReport, name: str, samples: int = 0) -> str:
    measurement = report.named(name)
    sets = "".join(f" --set '{text}'" for text in measurement.settings)
    return f"{COMMAND}{sets}{f' --spp {samples}' if samples else ''} ({_name_in_sentence(report, name)})"


def _set(report: TradeoffReport, advice: Advice) -> str:
    if advice.chosen is None:
        return f"{_wish(advice)} nothing does"
    return f"{_wish(advice)} {_settings(report, advice.chosen, advice.samples)}"


def _cost(report: TradeoffReport, advice: Advice) -> str:
    if advice.chosen is None and advice.wish == "time":
        fastest = min(each.sample_s.value for each in report.measurements)
        return f"one sample per pixel takes at least {seconds(fastest)}"
    if advice.chosen is None:
        return f"no configuration reaches {per_cent(advice.amount)}"
    off = report.named(advice.chosen)
    sharp = "" if advice.chosen == REFERENCE or off.unbiased else f", {bias(off.bias)} of it for good"
    if advice.wish == "time":
        error = between(advice.least_error, advice.most_error)
        return f"an error of {error} after {advice.samples} samples per pixel{sharp}"
    return f"{seconds(advice.seconds)} ({advice.samples} samples per pixel) to {per_cent(advice.amount)}{sharp}"


def _gain(report: TradeoffReport, advice: Advice) -> str:
    if advice.chosen is None:
        return "nothing"
    if advice.chosen == REFERENCE:
        return f"{_wish(advice)} no approximation is certainly better"
    if advice.wish == "time":
        if math.isinf(advice.full_error):
            return f"{FULL} has no picture {_wish(advice)}"
        return f"{_wish(advice)} {FULL} has an error of {per_cent(advice.full_error)}"
    times = advice.full_seconds / advice.seconds
    return f"{times:.1f} times as fast {_wish(advice)} as {FULL} ({seconds(advice.full_seconds)})"


def _open_questions(report: TradeoffReport, advice: Advice) -> list[str]:
    """Return a line about what may be better than what is advised, with its odds where they are known."""
    if advice.perhaps is None:
        return []
    other, wish = _name_in_sentence(report, advice.perhaps), _wish(advice)
    longer = f"measure longer (--budget {seconds(_LONGER * (report.budget or report.seconds)).replace(' ', '')})"
    share = _odds(report, advice)
    if share is None:
        return [f"Perhaps better {wish}: {other}; {longer}."]
    if share >= _PROBABLE:
        return [f"Probably better {wish}, {odds(share)}: {_settings(report, advice.perhaps)}; {longer} to be sure."]
    both = f"{_name_in_sentence(report, REFERENCE)} and {other}"
    return [f"Too close to call {wish} between {both}, {odds(1 - share)}: {longer}."]


def _odds(report: TradeoffReport, advice: Advice) -> float | None:
    """Return how probable it is that what may be better is; None where that was not drawn."""
    assert advice.perhaps is not None
    at = advice.amount if advice.wish == "time" else advice.full_seconds
    if advice.chosen != REFERENCE or not math.isfinite(at):
        return None
    return report.named(advice.perhaps).odds_after(at)


# The advice in plain words, and how reliable its numbers are.

MEANT = "Errors are relative to each pixel's brightness (root mean square over the picture), noise included."
LATE = 1.1  # times the budget, from which the report says what took longer
_SHOWS_LOAD = 1.3  # ratio of wall time to CPU time from which the report mentions it
PLACES = (("top", "middle", "bottom"), ("left", "centre", "right"))


def recommendation(report: TradeoffReport) -> list[str]:
    """Return sentences: the advice, the meaning of its terms, then what else was found."""
    chosen = list(dict.fromkeys(advice.chosen for advice in report.advice if advice.chosen is not None))
    said = [*_headline(report), *_terms(report)]
    said += [_difference_text(report, report.named(name)) for name in chosen if name != REFERENCE]
    said += _camera(report)
    said += _depth(report)
    return said


def caveats(report: TradeoffReport) -> list[str]:
    """Return sentences on how the numbers were found."""
    rendered, every = report.tiles
    made = "every tile" if rendered == every else f"{rendered} of {every} tiles"
    first, second, most = report.samples
    said = [
        f"Measured in {seconds(report.seconds)} on {report.device}: {made} of a picture of"
        f" {report.resolution[0]} x {report.resolution[1]} pixels, {report.seeds} seeds with {first} and {second}"
        f" samples per pixel, {report.long_tiles} tiles with {most}. Brackets are intervals of 95 %."
    ]
    said += [*_rare_path_warnings(report), *_why_longer(report)]
    if report.by_cpu:
        said.append("Times are CPU times divided by the number of cores: those of a render on an idle machine.")
    if report.slowed > _SHOWS_LOAD:
        slowed = f"{report.slowed:.1f} times as long"
        said.append(f"Wall times were {slowed}, as other work shared the machine or cores were idle.")
    said += [f"The same picture: {' = '.join((f.name, *f.same_as))}." for f in report.measurements if f.same_as]
    reasons: dict[str, list[str]] = {}
    for name, why in report.skipped.items():
        reasons.setdefault(why, []).append(name)
    said += [f"Not compared: {', '.join(names)} ({why})." for why, names in reasons.items()]
    return said


def _rare_path_warnings(report: TradeoffReport) -> list[str]:
    """Return a warning where the noise of an advised configuration or the reference comes from rare bright paths."""
    names = dict.fromkeys([REFERENCE, *(advice.chosen for advice in report.advice)])
    rare = [_name_in_sentence(report, name) for name in names if name is not None and report.named(name).has_rare_paths]
    if not rare:
        return []
    return [
        f"The noise of {' and of '.join(rare)} comes from rare bright paths: errors and times may be off by more than"
        " the intervals show; a longer measurement (--budget) meets more of them."
    ]


def _why_longer(report: TradeoffReport) -> list[str]:
    """Return why measuring took longer than it was to."""
    if not report.budget or report.seconds <= LATE * report.budget:
        return []
    preparing = sum(each.start_s for each in report.measurements)
    busy = report.slowed > _SHOWS_LOAD
    shared = f"; renders took {report.slowed:.1f} times as long as on an idle machine" if busy else ""
    return [
        f"Measuring took {seconds(report.seconds)} in place of {seconds(report.budget)}: preparing"
        f" {len(report.measurements)} ways to render took {seconds(preparing)}, renders and all else"
        f" {seconds(report.seconds - preparing)}{shared}."
    ]


def _terms(report: TradeoffReport) -> list[str]:
    """Explain an error and full accuracy."""
    how = ": every ray through every surface of the lens" if report.allowed else ", with its own camera"
    return [
        MEANT,
        f"{FULL[0].upper()}{FULL[1:]} ({REFERENCE} in the tables) is the most accurate way to render the scene{how}.",
    ]


def _difference_text(report: TradeoffReport, measurement: MeasuredVariant) -> str:
    name = _name_in_sentence(report, measurement.name)
    if measurement.unbiased:
        return f"The only change by {name} is in the noise."
    sure = measurement.sure_bias_of_tiles
    where = f", most at the {place(sure, report.grid)}" if sure.any() and measurement.bias.low > 0 else ""
    camera = report.camera_of(measurement)
    at = f", {_over_field(camera)}" if camera is not None else ""
    apart = bias(measurement.bias)
    if apart == "none":
        return f"No difference between {name} and {FULL} was measured, except in time."
    more = "; a longer measurement would be more precise" if measurement.bias.low <= 0 else ""
    apart = apart.replace("below", "less than")
    return f"Without noise, {name} differs from {FULL} by {apart}{where}{at}{more}."


def place(values: np.ndarray, grid: tuple[int, int]) -> str:
    """Return in words which ninth of the picture has the largest mean."""
    rows, columns = grid
    cells = values.reshape(rows, columns)
    means = [
        (float(part.mean()), y, x)
        for y, band in enumerate(np.array_split(cells, 3, axis=0))
        for x, part in enumerate(np.array_split(band, 3, axis=1))
        if part.size
    ]
    _, y, x = max(means)
    return " ".join(dict.fromkeys((PLACES[0][y], PLACES[1][x]))) if (y, x) != (1, 1) else "centre"


def _over_field(camera: TierError) -> str:
    worst = int(np.argmax(camera.pixels))
    if math.isinf(camera.pixels[worst]):
        return (
            f"{pixels(camera.pixels[0])} on the axis; at {FIELDS[worst]:g} of the half diagonal the lens sees nothing"
        )
    between = f", {pixels(camera.worst_px)} between" if camera.worst_px > camera.pixels[worst] else ""
    return (
        f"{pixels(camera.pixels[0])} on the axis and at most {pixels(camera.pixels[worst])}"
        f" (at {FIELDS[worst]:g} of the half diagonal{between}),"
        f" brightness by up to {per_cent(camera.worst_illumination)}"
    )


def _camera(report: TradeoffReport) -> list[str]:
    said = []
    if report.allowed == "realistic":
        said.append("camera.accuracy: auto traces every ray, as no cheaper camera is within half a pixel and 1 %.")
    elif report.allowed:
        camera = next(each for each in report.cameras if each.tier == report.allowed)
        said.append(f"camera.accuracy: auto uses the {report.allowed.replace('_', ' ')}: {_over_field(camera)}.")
    if report.lens_colour_px is not None:
        said.append(f"The lens moves light of other wavelengths by up to {pixels(report.lens_colour_px)}.")
    if report.diffraction is not None:
        said.append(f"camera.diffraction: auto is {report.diffraction['says']}. None of the pictures here has it.")
    if report.ghosts is not None:
        said.append(
            f"camera.ghosts: on adds {per_cent(report.ghosts)} of the light of a lamp in the middle of the frame, out"
            " of focus. None of the pictures here has it."
        )
    return said


def _depth(report: TradeoffReport) -> list[str]:
    depth, bound = report.truncation["max_depth"], report.truncation["bound"]
    paths = f"Light paths end after {depth} edges (render.max_depth), also with {FULL}"
    if bound is None:
        return [f"{paths}; there is no bound on what longer ones add ({report.truncation['no_bound_because']})."]
    largest = report.truncation["largest_albedo"]
    return [
        f"{paths}; longer ones add at most {per_cent(bound)} of the radiance of the brightest lamp"
        f" (reflectances up to {largest:.2g})."
    ]


# The measurements as tables, and the whole report as Markdown.

_SHOWN_FIELDS = (0.0, 0.5, 0.7, 1.0)
_ERROR_COLUMNS = ("configuration", "bias", "brightness", f"better than {REFERENCE} until")
_COST_COLUMNS = (
    "configuration", "a sample", "noise after 1 s", *(f"to {per_cent(target)}" for target in TARGETS), "start"
)  # fmt: skip
_CAMERA_COLUMNS = ("camera", *(f"at {field:g}" for field in _SHOWN_FIELDS), "brightness at 1")


Table = tuple[str, tuple[str, ...], list[list[str]]]
"""A title, the names of columns, and rows of texts."""


def tables(report: TradeoffReport) -> list[Table]:
    """Return the errors of the configurations, their costs, and the errors of cheaper cameras if there are any."""
    measured = report.measurements
    wrong = f"Error against {REFERENCE}, without noise"
    taken = "Cost: time of one sample per pixel, noise, time to an error, time before the first ray"
    over = "How far cheaper cameras displace light, from the middle of the picture (0) to its corner (1)"
    shown: list[Table] = [
        (wrong, _ERROR_COLUMNS, [_errors(each) for each in measured if each.knob]),
        (taken, _COST_COLUMNS, [_costs(each) for each in measured]),
    ]
    if cameras := _cameras(report):
        shown.append((over, _CAMERA_COLUMNS, cameras))
    return shown


def _errors(measurement: MeasuredVariant) -> list[str]:
    return [
        measurement.name,
        bias(measurement.bias),
        ends(measurement.energy, per_cent),
        crossing(measurement.better_until),
    ]


def _costs(measurement: MeasuredVariant) -> list[str]:
    return [
        measurement.name,
        ends(measurement.sample_s),
        noise(max(measurement.rate.value, 0.0) ** 0.5),
        *(ends(measurement.seconds_to[target]) for target in TARGETS),
        seconds(measurement.start_s),
    ]


def _cameras(report: TradeoffReport) -> list[list[str]]:
    at = [FIELDS.index(field) for field in _SHOWN_FIELDS]
    return [
        [
            camera.tier.replace("_", " "),
            *(pixels(camera.pixels[place]) for place in at),
            "dark" if camera.illumination[-1] == float("inf") else per_cent(camera.illumination[-1]),
        ]
        for camera in report.cameras
        if camera.tier != "realistic"
    ]


def summary(report: TradeoffReport) -> list[str]:
    """Return the lines that the command prints without its details: the advice, its terms, and doubts."""
    doubts = [*_rare_path_warnings(report), *_why_longer(report)]
    return [*_headline(report), "", MEANT, *doubts, "All numbers and how they were found: --details."]


def _plain_text(report: TradeoffReport) -> str:
    """Return the report as text, its tables in plain columns."""
    parts = [f"{title}\n{_align([columns, *rows])}" for title, columns, rows in tables(report)]
    return "\n\n".join(["\n".join(recommendation(report)), *parts, "\n".join(caveats(report))])


def _align(lines: Sequence[Sequence[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join("  ".join(map(str.rjust, line, widths)).rstrip() for line in lines)


def markdown(report: TradeoffReport, title: str) -> str:
    """Return the report as Markdown."""
    parts = [f"# {title}", "\n".join(f"- {line}" for line in recommendation(report))]
    for heading, columns, rows in tables(report):
        lines = [columns, ["---"] * len(columns), *rows]
        marked = ["| " + " | ".join(text.replace("|", "\\|") for text in line) + " |" for line in lines]
        parts.append(f"{heading}:\n\n" + "\n".join(marked))
    return "\n\n".join([*parts, "\n".join(f"- {line}" for line in caveats(report))]) + "\n"


# Three pictures of a comparison in one: error against time, error over the field, and where pictures differ.

WIDTH, CHARTS, MAPS = 8.0, 4.8, 1.3  # of the plot, its charts and the frame of its maps [inches]
_WIDTHS = (3, 2)  # of the charts, one to the other
_MOST_MAPS = 4
_LOW, _HIGH = 0.003, 1.0  # differences between which the shade of a map changes, by logarithm
POINTS = 200  # of a curve
FINEST, COARSEST = 0.005, 3.0  # errors that the chart reaches from the one to the other, about
# Colours after those of `series`, so that no two curves share one.
MORE = ("#e377c2", "#8c564b", "#6fb7ff", "#a7c957", "#000000", "#ffa62b", "#7a0c2e", "#a9a2e8", "#63d2a1", "#c9ada7")
_DASHES = {"thick_lens": "--"}  # which often lies on the thin lens's curve


@styled()
def tradeoff_plot(report: TradeoffReport, title: str) -> Figure:
    """Return the three pictures.

    On the left is the root of relMSE over time, one line for each configuration. A line becomes level where it reaches
    its bias; noise falls along the dotted guide. A dot marks where a line crosses that of the most accurate one. On the
    right is how far cheaper cameras displace light. Below are maps, tile by tile, of the configurations that differ
    most; those that are advised come first.
    """
    shown = _choose_maps(report)
    columns, rows = report.resolution
    height = MAPS + min(WIDTH / _MOST_MAPS * rows / columns, WIDTH / 2) if shown else 0.0
    figure = new_figure(title, (WIDTH, CHARTS + height))
    rooms = figure.subfigures(1 + bool(shown), 1, squeeze=False, height_ratios=(CHARTS, height)[: 1 + bool(shown)])
    charts = rooms[0, 0]
    if shown:
        _draw_maps(rooms[1, 0], report, shown)
    left, right = charts.subplots(1, 2, width_ratios=_WIDTHS)
    different = [*dict.fromkeys(map(series, range(len(MORE)))), *MORE]
    colours = {each.name: different[number % len(different)] for number, each in enumerate(report.measurements)}
    _errors_over_time(left, report.measurements, colours)
    _errors_over_field(right, report, colours)
    add_key(charts, left.lines)
    return figure


def _errors_over_time(axes: Axes, measured: Sequence[MeasuredVariant], colours: dict[str, str]) -> None:
    """Draw a curve for each configuration, with its band, and where it meets the most accurate one."""
    full = measured[0].rate.value or measured[0].sample_s.value  # an even picture has no noise
    first, last = _decades(full, full / FINEST**2)  # from an error of 100 % of the most accurate one
    low, high = _decades(FINEST / 5, COARSEST)
    times = np.geomspace(first, last, POINTS)
    curves = {each.name: _error(each, times) for each in measured}
    axes.set(title="error over time, with bands of 95 %", xlabel="time to render the picture",
             ylabel="error: root of relMSE [%]", xscale="log", yscale="log", xlim=(first, last),
             ylim=(100 * low, 100 * high))  # fmt: skip
    axes.minorticks_off()
    axes.xaxis.set_major_formatter(lambda value, _: seconds(value))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    for number, each in enumerate(measured):
        colour, line = colours[each.name], "-" if colours[each.name] not in list(colours.values())[:number] else "--"
        band = [100 * np.maximum(_error(each, times, end), low / 10) for end in ("low", "high")]
        axes.fill_between(times, *band, color=colour, alpha=0.16, linewidth=0)
        axes.plot(times, 100 * np.maximum(curves[each.name], low / 10), line, color=colour, label=each.name)
    guide = first * 10.0 ** np.array([0.3, 2.3])
    axes.plot(guide, 100 * low * np.array([25.0, 2.5]), ":", color=FAINT, label="slope of noise")
    for each in measured:
        meets = each.better_until.value
        if each.knob and first < meets < last:
            axes.scatter([meets], 100 * _error(each, np.array([meets])), color=colours[each.name], zorder=3)
    _name_curves_off_chart(axes, curves, (low, high))


def _name_curves_off_chart(axes: Axes, curves: dict[str, np.ndarray], shown: tuple[float, float]) -> None:
    """Say which curves lie wholly above or below the chart."""
    for where, place, out in (
        ("above", 0.97, {name for name, curve in curves.items() if (curve > shown[1]).all()}),
        ("below", 0.03, {name for name, curve in curves.items() if (curve < shown[0]).all()}),
    ):
        if out:
            names = "all" if len(out) == len(curves) else ", ".join(name for name in curves if name in out)
            words, edge = f"{where} the chart: {names}", "top" if where == "above" else "bottom"
            axes.text(0.98, place, words, color=FAINT, transform=axes.transAxes, horizontalalignment="right",
                      verticalalignment=edge)  # fmt: skip


def _decades(low: float, high: float) -> tuple[float, float]:
    """Return the powers of ten, two different ones, that hold a range."""
    first = math.floor(math.log10(low))
    return 10.0**first, 10.0 ** max(math.ceil(math.log10(high)), first + 1)


def _error(measurement: MeasuredVariant, times: np.ndarray, end: str = "value") -> np.ndarray:
    """Return the root of relMSE after times, with bias and noise at an end of their intervals."""
    return np.asarray(np.sqrt(measurement.bias_at(end) + measurement.law(end).even(times / measurement.sample_s.value)))


def _errors_over_field(axes: Axes, report: TradeoffReport, colours: dict[str, str]) -> None:
    cameras = [each for each in report.cameras if each.tier != "realistic"]
    axes.set(title="error of cheaper cameras", xlim=(0.0, 1.0), xlabel="film point, share of half diagonal",
             ylabel="light beside its place [pixels]")  # fmt: skip
    if not cameras:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "The camera has\nno cheaper model.", color=FAINT, transform=axes.transAxes,
                  horizontalalignment="center")  # fmt: skip
        return
    axes.axhline(0.5, color=FAINT, linestyle="--", linewidth=1.2)
    for each in cameras:
        colour = colours.get(each.tier.replace("_", " "), INK)
        pixels = [value if math.isfinite(value) else math.nan for value in each.pixels]
        axes.plot(FIELDS, pixels, _DASHES.get(each.tier, "-"), marker="o", markersize=4, color=colour)
    if any(math.isinf(value) for each in cameras for value in each.pixels):
        axes.text(0.03, 0.97, "a line ends where\nthe lens sees nothing", color=FAINT, transform=axes.transAxes,
                  verticalalignment="top")  # fmt: skip
    axes.set_ylim(0.0, max(1.08, axes.get_ylim()[1]))


def _choose_maps(report: TradeoffReport) -> list[MeasuredVariant]:
    """Return the configurations that get a map: those that are advised, then those that differ most."""
    biased = [each for each in report.measurements if each.knob and not each.unbiased]
    chosen = {advice.chosen for advice in report.advice}
    return sorted(biased, key=lambda each: (each.name in chosen, each.bias.value), reverse=True)[:_MOST_MAPS]


def _draw_maps(figure: SubFigure, report: TradeoffReport, shown: Sequence[MeasuredVariant]) -> None:
    """Draw how much each tile of the pictures differs, all in the same shades."""
    from matplotlib.colors import LogNorm

    figure.suptitle("where pictures differ from the most accurate one (white: it may be noise)", fontsize=10,
                    x=0.01, horizontalalignment="left")  # fmt: skip
    panels = figure.subplots(1, _MOST_MAPS)
    columns, rows = report.resolution
    for axes, measurement in zip(panels, shown, strict=False):
        bias = np.sqrt(np.maximum(measurement.sure_bias_of_tiles.reshape(report.grid), _LOW**2))
        image = axes.imshow(100 * bias, cmap="BuPu", norm=LogNorm(100 * _LOW, 100 * _HIGH, clip=True),
                            extent=(0, columns, rows, 0), interpolation="nearest")  # fmt: skip
        axes.set_title(measurement.name)
        axes.set(xticks=(), yticks=())
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    label = "root of relMSE of a tile [%]"
    ticks = (0.3, 1, 3, 10, 30, 100)
    figure.colorbar(image, ax=panels, label=label, ticks=ticks, format="%g", orientation="horizontal", aspect=50)
