"""The lines that matter: what to set, what it costs, what it gains; then what is probable or too close to call."""

from __future__ import annotations

import math
from collections.abc import Callable

from rptcam_cl.tradeoff.comparison import Advice, Comparison
from rptcam_cl.tradeoff.ladder import AS_IT_IS, REFERENCE
from rptcam_cl.tradeoff.words import between, bias, odds, per_cent, seconds

FULL = "full accuracy"
COMMAND = "rptcam render SCENE"
PROBABLE = 0.75  # odds from which one configuration is called probably better
LONGER = 4  # times the measurement, which halves its intervals


def headline(report: Comparison) -> list[str]:
    """Return three lines, then one for each configuration that may be better than the advised one."""
    said = [_each("Set", report, _set), _each("Costs", report, _cost), _each("Gains", report, _gain)]
    return said + list(dict.fromkeys(line for advice in report.advice for line in _open(report, advice)))


def called(report: Comparison, name: str) -> str:
    """Return the name of a configuration in a sentence."""
    found = report.named(name)
    if AS_IT_IS in (name, *found.same_as):
        return f"the scene as it is{f' ({FULL})' if name == REFERENCE else ''}"
    if name == REFERENCE:
        return FULL
    return f"the {name}" if found.knob == "camera" else f"«{name}»"


def _each(title: str, report: Comparison, say: Callable[[Comparison, Advice], str]) -> str:
    return f"{title}: {'; '.join(say(report, advice) for advice in report.advice)}."


def _wish(advice: Advice) -> str:
    return f"in {seconds(advice.amount)}" if advice.wish == "time" else f"to an error of {per_cent(advice.amount)}"


def _settings(report: Comparison, name: str, samples: int = 0) -> str:
    found = report.named(name)
    sets = " ".join(f" --set '{text}'" for text in found.settings)
    return f"{COMMAND}{sets}{f' --spp {samples}' if samples else ''} ({called(report, name)})"


def _set(report: Comparison, advice: Advice) -> str:
    if advice.chosen is None:
        return f"{_wish(advice)} nothing does"
    return f"{_wish(advice)} {_settings(report, advice.chosen, advice.samples)}"


def _cost(report: Comparison, advice: Advice) -> str:
    if advice.chosen is None and advice.wish == "time":
        fastest = min(found.sample_s.value for found in report.measurements)
        return f"one sample per pixel takes at least {seconds(fastest)}"
    if advice.chosen is None:
        return f"no configuration reaches {per_cent(advice.amount)}"
    off = report.named(advice.chosen)
    sharp = "" if advice.chosen == REFERENCE or off.unbiased else f", {bias(off.bias)} of it for good"
    if advice.wish == "time":
        error = between(advice.least_error, advice.most_error)
        return f"an error of {error} after {advice.samples} samples per pixel{sharp}"
    return f"{seconds(advice.seconds)} ({advice.samples} samples per pixel) to {per_cent(advice.amount)}{sharp}"


def _gain(report: Comparison, advice: Advice) -> str:
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


def _open(report: Comparison, advice: Advice) -> list[str]:
    """Return a line about what may be better than what is advised, with its odds where they are known."""
    if advice.perhaps is None:
        return []
    other, wish = called(report, advice.perhaps), _wish(advice)
    longer = f"measure longer (--budget {seconds(LONGER * (report.budget or report.seconds)).replace(' ', '')})"
    share = _odds(report, advice)
    if share is None:
        return [f"Perhaps better {wish}: {other}; {longer}."]
    if share >= PROBABLE:
        return [f"Probably better {wish}, {odds(share)}: {_settings(report, advice.perhaps)}; {longer} to be sure."]
    both = f"{called(report, REFERENCE)} and {other}"
    return [f"Too close to call {wish} between {both}, {odds(1 - share)}: {longer}."]


def _odds(report: Comparison, advice: Advice) -> float | None:
    """Return how probable it is that what may be better is; None where that was not drawn."""
    assert advice.perhaps is not None
    at = advice.amount if advice.wish == "time" else advice.full_seconds
    if advice.chosen != REFERENCE or not math.isfinite(at):
        return None
    return report.named(advice.perhaps).odds_after(at)
