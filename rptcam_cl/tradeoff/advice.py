"""Which configuration to use for a time or an error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from rptcam_cl.tradeoff.comparison import Advice
from rptcam_cl.tradeoff.measurement import Measurement

WORTH = 1.05  # factor by which another configuration must be better than the most accurate one


def for_time(found: Sequence[Measurement], seconds: float) -> Advice:
    """Return the configuration with the least error after a time; the first one unless another is clearly better.

    Its name is None where the time is too short for one sample per pixel.
    """
    found = _trusted(found)
    errors = [each.error_after(seconds) for each in found]
    likely = [each.error_after(seconds, each.likely_bias) for each in found]
    best = _clear_best([each.error_after(seconds) for each in _surely(found)])
    name = found[best].name if math.isfinite(errors[best]) else None
    perhaps = _better_yet(found, likely, errors, best)
    if name is None:
        return Advice("time", seconds, None, seconds, math.inf, 0, math.inf, math.inf, seconds, math.inf, perhaps)
    samples = int(seconds / found[best].sample_s.value)
    ends = found[best].errors_after(samples * found[best].sample_s.value)
    return Advice("time", seconds, name, seconds, errors[best], samples, *ends, seconds, errors[0], perhaps)


def for_error(found: Sequence[Measurement], error: float) -> Advice:
    """Return the configuration that reaches an error first; the most accurate one unless another is clearly faster."""
    found = _trusted(found)
    times = [each.seconds_until(error) for each in found]
    likely = [each.seconds_until(error, each.likely_bias) for each in found]
    best = _clear_best([each.seconds_until(error) for each in _surely(found)])
    perhaps = _better_yet(found, likely, times, best)
    if math.isinf(times[best]):
        return Advice("error", error, None, math.inf, error, 0, 0.0, math.inf, times[0], error, perhaps)
    samples = max(math.ceil(times[best] / found[best].sample_s.value), 1)
    ends = found[best].errors_after(samples * found[best].sample_s.value)
    return Advice("error", error, found[best].name, times[best], error, samples, *ends, times[0], error, perhaps)


def _trusted(found: Sequence[Measurement]) -> list[Measurement]:
    """Return the measurements that may be advised, the most accurate one first.

    Independent samples show what the lattice gains; they can be better only by chance. Where noise comes from rare
    paths, configurations that differ only in noise cannot be compared.
    """
    full = found[0]
    rare = [full.has_rare_paths or each.has_rare_paths for each in found]
    kept = [
        each
        for each, by_chance in zip(found[1:], rare[1:], strict=True)
        if each.knob != "sampler" and not (each.unbiased and by_chance)
    ]
    return [full, *kept]


def _surely(found: Sequence[Measurement]) -> list[Measurement]:
    """Return the measurements with the worst noise and time, relative to the first, that their intervals allow."""
    return [found[0], *(_at_worst(each, found[0].rate.value) for each in found[1:])]


def _at_worst(found: Measurement, full_rate: float) -> Measurement:
    if not (full_rate > 0 and found.rate.value > 0):
        return replace(found, sample_s=replace(found.sample_s, value=found.sample_s.high))
    times = full_rate / found.gain.low / found.rate.value if found.gain.low > 0 else math.inf
    first, last = (replace(end, value=end.value * times) for end in found.noise)
    return replace(found, noise=(first, last))


def _clear_best(values: Sequence[float]) -> int:
    """Return the index of the least value if it is clearly less than the first, else 0."""
    best = min(range(len(values)), key=values.__getitem__)
    return 0 if values[0] <= WORTH * values[best] else best


def _better_yet(
    found: Sequence[Measurement], likely: Sequence[float], sure: Sequence[float], chosen: int
) -> str | None:
    """Return the name of another one whose likely value is clearly less than the sure value of the one chosen."""
    best = min(range(len(found)), key=likely.__getitem__)
    return found[best].name if best != chosen and WORTH * likely[best] < sure[chosen] else None
