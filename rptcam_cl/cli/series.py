"""Lists of values with an ellipsis: ``2,2.8,…,22`` goes on as it began, in stops for f-numbers, in equal steps else."""

import math
from typing import Any

from rptcam_cl.core.errors import InputError

ELLIPSES = ("…", "...")
MOST_VALUES = 10_000
ON_THE_WAY = 1e-6  # of a step, by which the last value may miss it

# As engraved on lenses and shown by cameras: full, half and third stops.
F_NUMBERS = (
    (0.5, 0.7, 1, 1.4, 2, 2.8, 4, 5.6, 8, 11, 16, 22, 32, 45, 64, 90, 128),
    (1, 1.2, 1.4, 1.7, 2, 2.4, 2.8, 3.3, 4, 4.8, 5.6, 6.7, 8, 9.5, 11, 13, 16, 19, 22, 27, 32, 38, 45, 54, 64),
    (
        1, 1.1, 1.2, 1.4, 1.6, 1.8, 2, 2.2, 2.5, 2.8, 3.2, 3.5, 4, 4.5, 5, 5.6, 6.3, 7.1, 8, 9, 10, 11, 13, 14, 16, 18,
        20, 22, 25, 29, 32, 36, 40, 45, 51, 57, 64,
    ),
)  # fmt: skip


def expanded(key: str, values: list[Any], where: str) -> list[Any]:
    """Return the values with those in place of an ellipsis.

    Raises
    ------
    InputError
        When it does not stand between numbers that make a series.
    """
    places = [k for k, value in enumerate(values) if value in ELLIPSES]
    if not places:
        return values
    place = places[0]
    before, after = values[:place], values[place + 1 :]
    if not (before and after and all(_is_number(value) for value in [*before, *after])):
        raise InputError(f"{where}: the ellipsis has to stand between numbers (as 2,2.8,…,22)")
    is_stops = key.rpartition(".")[2] == "f_number"
    middle = (_stops if is_stops else _steps)(before[-2:], after[0], where)
    return [*before, *middle, *after]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _stops(before: list[float], last: float, where: str) -> list[float]:
    """Return the f-numbers between the last one before an ellipsis and the one behind it, of a scale with all."""
    for scale in F_NUMBERS:
        if not all(value in scale for value in (*before, last)):
            continue
        first, end = scale.index(before[-1]), scale.index(last)
        step = 1 if first < end else -1
        if len(before) == 1 or scale.index(before[0]) + step == first:
            return list(scale[first + step : end : step])
    raise InputError(
        f"{where}: is no series of full, half or third stops (got {', '.join(map(str, before))}, …, {last};"
        " allowed: as 2,2.8,…,22, 2,2.4,…,8 or 2,2.2,…,4)"
    )


def _steps(before: list[float], last: float, where: str) -> list[float]:
    """Return the numbers between, in steps of the two before the ellipsis."""
    step = before[-1] - before[0]
    count = (last - before[-1]) / step if step else 0.0
    if len(before) < 2 or not 1 - ON_THE_WAY <= count <= MOST_VALUES or abs(count - round(count)) > ON_THE_WAY:
        raise InputError(
            f"{where}: is no series of equal steps (got {', '.join(map(str, before))}, …, {last};"
            " allowed: as 1,1.5,…,4)"
        )
    whole = all(isinstance(value, int) for value in (*before, last))
    values = [before[-1] + k * (last - before[-1]) / round(count) for k in range(1, round(count))]
    return [round(value) for value in values] if whole else [float(f"{value:.12g}") for value in values]
