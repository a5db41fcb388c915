"""The scales engraved on dials: f-numbers, exposure times and ISO in thirds of a stop.

A step is an exact third, 2^(1/6) in f-number and 2^(1/3) in time and ISO, so that steps on two dials cancel to the bit
of rounding; what is written on it is the rounded number that cameras write (ISO 517, APEX), f/5.6 for 2^2.5.
"""

from __future__ import annotations

import math

from rptcam_cl.core.dataclass import dataclass

THIRDS = 3  # steps of a stop
SAME = 1e-6  # relative difference within which a number is the one that is engraved


@dataclass(frozen=True)
class Scale:
    """A dial in thirds of a stop.

    Attributes
    ----------
    per_stop : float
        Stops of light for a factor of two: 2 for f-numbers, 1 for times and ISO.
    origin : float
        Value of step 0.
    first : int
        Step of the first engraving.
    engraved : tuple of str
        What is written on the steps.
    numbers : tuple of float
        The same as numbers.
    prefix, suffix : str
        Around what is written.
    """

    per_stop: float
    origin: float
    first: int
    engraved: tuple[str, ...]
    numbers: tuple[float, ...]
    prefix: str = ""
    suffix: str = ""

    @property
    def last(self) -> int:
        """The last step."""
        return self.first + len(self.engraved) - 1

    def value(self, step: int) -> float:
        """Return the exact value of a step."""
        return float(self.origin * 2.0 ** (step / (THIRDS * self.per_stop)))

    def nearest(self, value: float) -> int:
        """Return the step nearest to a value, on the scale."""
        step = round(THIRDS * self.per_stop * math.log2(value / self.origin))
        return min(max(step, self.first), self.last)

    def exact(self, value: float) -> float:
        """Return the exact value of a step where a value is what is engraved on it, else the value."""
        for place, number in enumerate(self.numbers):
            if math.isclose(value, number, rel_tol=SAME):
                return self.value(self.first + place)
        return value

    def text(self, value: float) -> str:
        """Return what a value is called: the engraving of its step, or its own digits between and beyond steps."""
        step = self.nearest(value)
        off = THIRDS * self.per_stop * math.log2(value / self.value(step))
        if abs(off) <= 0.51 and step == round(THIRDS * self.per_stop * math.log2(value / self.origin)):
            return f"{self.prefix}{self.engraved[step - self.first]}{self.suffix}"
        return f"{self.prefix}{value:.3g}{self.suffix}"

    def steps(self, low: float, high: float) -> list[float]:
        """Return the exact values of the steps from a value to another, these included."""
        values = [self.value(step) for step in range(self.first, self.last + 1)]
        return [value for value in values if low * (1 - SAME) <= value <= high * (1 + SAME)]


def _engraved(text: str) -> tuple[str, ...]:
    return tuple(text.split())


_F = _engraved(
    "0.5 0.56 0.63 0.7 0.8 0.9 1 1.1 1.2 1.4 1.6 1.8 2 2.2 2.5 2.8 3.2 3.5 4 4.5 5 5.6 6.3 7.1 8 9 10 11 13 14 16 18 20"
    " 22 25 29 32 36 40 45 51 57 64"
)
_FRACTIONS = _engraved(
    "32000 25600 20000 16000 12800 10000 8000 6400 5000 4000 3200 2500 2000 1600 1250 1000 800 640 500 400 320 250 200"
    " 160 125 100 80 60 50 40 30 25 20 15 13 10 8 6 5 4"
)
_SECONDS = _engraved("0.3 0.4 0.5 0.6 0.8 1 1.3 1.6 2 2.5 3.2 4 5 6 8 10 13 15 20 25 30 40 50 60")
_SPEEDS = _engraved(
    "6 8 10 12 16 20 25 32 40 50 64 80 100 125 160 200 250 320 400 500 640 800 1000 1250 1600 2000 2500 3200 4000 5000"
    " 6400 8000 10000 12800 16000 20000 25600 32000 40000 51200 64000 80000 102400 128000 160000 204800 256000 320000"
    " 409600"
)

F_NUMBERS = Scale(2.0, 1.0, -6, _F, tuple(map(float, _F)), prefix="f/")
TIMES = Scale(
    1.0,
    1.0,
    -45,
    (*(f"1/{text}" for text in _FRACTIONS), *(f"{text} s" for text in _SECONDS)),
    (*(1.0 / float(text) for text in _FRACTIONS), *map(float, _SECONDS)),
)
SPEEDS = Scale(1.0, 100.0, -12, _SPEEDS, tuple(map(float, _SPEEDS)), prefix="ISO ")
EV_STEPS = [step / THIRDS for step in range(-5 * THIRDS, 5 * THIRDS + 1)]


def ev_text(ev: float) -> str:
    """Return exposure compensation as cameras write it, in thirds where it is thirds."""
    thirds = round(ev * THIRDS)
    if abs(ev * THIRDS - thirds) > 1e-9:
        return f"{ev:+.2f} EV"
    sign, (whole, rest) = ("-" if thirds < 0 else "+" if thirds else "±"), divmod(abs(thirds), THIRDS)
    return f"{sign}{whole if whole or not rest else ''}{('', '⅓', '⅔')[rest]} EV"
