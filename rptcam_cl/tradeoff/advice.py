"""Which configuration to take for a time or an error."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rptcam_cl.tradeoff.measurement import Measurement
from rptcam_cl.tradeoff.report import Advice

WORTH = 1.05  # times better than the most accurate configuration that another one has to be


def for_time(found: Sequence[Measurement], seconds: float) -> Advice:
    """Return the configuration that errs least after a time; the most accurate one unless another is clearly better."""
    full = found[0]
    best = min(found, key=lambda each: each.error_after(seconds))
    if full.error_after(seconds) <= WORTH * best.error_after(seconds):
        best = full
    return Advice("time", seconds, best.name, seconds, best.error_after(seconds), seconds, full.error_after(seconds))


def for_error(found: Sequence[Measurement], error: float) -> Advice:
    """Return the configuration that is soonest at an error; the most accurate one unless another is clearly faster."""
    full = found[0]
    best = min(found, key=lambda each: each.seconds_until(error))
    if full.seconds_until(error) <= WORTH * best.seconds_until(error):
        best = full
    seconds = best.seconds_until(error)
    name = best.name if math.isfinite(seconds) else None
    return Advice("error", error, name, seconds, error, full.seconds_until(error), error)
