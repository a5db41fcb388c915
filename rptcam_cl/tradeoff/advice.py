"""Which configuration to take for a time or an error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from rptcam_cl.tradeoff.measurement import Measurement
from rptcam_cl.tradeoff.report import Advice

WORTH = 1.05  # times better than the most accurate configuration that another one has to be


def for_time(found: Sequence[Measurement], seconds: float) -> Advice:
    """Return the configuration that errs least after a time; the most accurate one unless another is clearly better.

    None of them where the time is not enough for a sample in every pixel.
    """
    errors = [each.error_after(seconds) for each in found]
    likely = [each.error_after(seconds, each.likely_bias) for each in found]
    best = _clear_best([each.error_after(seconds) for each in _surely(found)])
    name = found[best].name if math.isfinite(errors[best]) else None
    perhaps = _better_yet(found, likely, errors, best)
    return Advice("time", seconds, name, seconds, errors[best], seconds, errors[0], perhaps)


def for_error(found: Sequence[Measurement], error: float) -> Advice:
    """Return the configuration that is soonest at an error; the most accurate one unless another is clearly faster."""
    times = [each.seconds_until(error) for each in found]
    likely = [each.seconds_until(error, each.likely_bias) for each in found]
    best = _clear_best([each.seconds_until(error) for each in _surely(found)])
    name = found[best].name if math.isfinite(times[best]) else None
    perhaps = _better_yet(found, likely, times, best)
    return Advice("error", error, name, times[best], error, times[0], error, perhaps)


def _surely(found: Sequence[Measurement]) -> list[Measurement]:
    """Return measurements as slow against the most accurate one as the interval of their gain allows."""
    full = found[0].rate
    return [
        replace(each, rate=replace(full, value=full.value / each.gain.low if each.gain.low > 0 else math.inf))
        for each in found
    ]


def _clear_best(values: Sequence[float]) -> int:
    """Return the place of the least value, or the first place unless that is clearly less."""
    best = min(range(len(values)), key=values.__getitem__)
    return 0 if values[0] <= WORTH * values[best] else best


def _better_yet(
    found: Sequence[Measurement], likely: Sequence[float], sure: Sequence[float], chosen: int
) -> str | None:
    """Return the name of the least likely value where that is another's and clearly less than the sure one chosen."""
    best = min(range(len(found)), key=likely.__getitem__)
    return found[best].name if best != chosen and WORTH * likely[best] < sure[chosen] else None
