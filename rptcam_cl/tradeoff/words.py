"""Numbers and intervals as people read them."""

from __future__ import annotations

import math
from collections.abc import Callable

from rptcam_cl.tradeoff.statistics import Interval

MINUTE, HOUR, DAY = 60.0, 3600.0, 86400.0
LONGEST = DAY  # renders of which nobody asks when they cross
VAGUE = 30.0  # times the lower end of an interval that the upper is, where a crossing is too close to call


def seconds(value: float) -> str:
    """Return a time, as ``23 ms``, ``4.2 s`` or ``1.5 h``; an infinite one is ``never``."""
    if math.isinf(value):
        return "never"
    for below, unit, scale in (
        (1.0, "ms", 1e-3),
        (2 * MINUTE, "s", 1.0),
        (2 * HOUR, "min", MINUTE),
        (2 * DAY, "h", HOUR),
    ):
        if value < below:
            return f"{_short(value / scale)} {unit}"
    return f"{_short(value / DAY)} days"


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


def bias(found: Interval) -> str:
    """Return the root of a bias (relMSE) with its interval; only the upper end where it may be zero."""
    low, value, high = (math.sqrt(max(end, 0.0)) for end in (found.low, found.value, found.high))
    if high == 0:
        return "none"
    if low == 0:
        return f"below {per_cent(high)}"
    least, most = _short(100 * low), _short(100 * high)
    return per_cent(value) if least == most == _short(100 * value) else f"{per_cent(value)} ({least} to {most})"


def ends(found: Interval, say: Callable[[float], str] = seconds) -> str:
    """Return an estimate with the ends of its interval in brackets, once where they are the same."""
    value, low, high = (say(end) for end in (found.value, found.low, found.high))
    if low == high == value:
        return value
    units = {text.rpartition(" ")[2] for text in (value, low, high)}
    if len(units) == 1:
        low, high = (text.rpartition(" ")[0] for text in (low, high))
    return f"{value} ({low} to {high})"


def crossing(found: Interval) -> str:
    """Return the time until which something is better, with its interval where that says anything."""
    if found.high <= 0:
        return "never"
    if found.low >= LONGEST:
        return "always"
    beside = not found.low <= found.value <= found.high  # an estimate that its own interval leaves out
    if found.low <= 0 or found.high > VAGUE * found.low or beside:
        below = found.high < LONGEST and (found.low > 0 or found.value > 0)
        return f"too close to call (before {until(found.high)})" if below else "too close to call"
    return ends(found, until)


def _short(value: float) -> str:
    """Return a number with two digits, or as a whole number from 10 on."""
    if value != 0 and abs(value) < 0.001:
        return f"{value:.1g}"
    return f"{value:.0f}" if abs(value) >= 9.95 else f"{value:.2g}"
