"""Measured luminaires: IES files (ANSI/IESNA LM-63, 1986 to 2019) of photometric type C.

Intensities in candela become W/sr by the definition of the candela: 683 lm of light are taken as 1 W in every channel.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LUMENS_PER_WATT
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.references import read_whole

_LARGEST_FILE = 4_000_000  # bytes
_MOST_ANGLES = 4096
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Luminaire:
    """Intensities of a luminaire.

    Attributes
    ----------
    vertical : (m,) array
        Angles from straight down [degrees], rising.
    horizontal : (n,) array
        Angles about the vertical axis [degrees], rising from 0; the last is 0, 90, 180 or 360.
    watts : (n, m) array
        Intensity [W/sr].
    """

    vertical: Array
    horizontal: Array
    watts: Array

    def intensity(self, vertical: Array, horizontal: Array) -> Array:
        """Return intensities [W/sr] for all pairs of angles [degrees], shape (vertical, horizontal).

        Straight lines between the angles of the file; nothing beyond its vertical angles; planes that the file leaves
        out follow from its symmetry.
        """
        beyond = {"left": 0.0, "right": 0.0}
        planes = np.array([np.interp(vertical, self.vertical, row, **beyond) for row in self.watts])
        last = self.horizontal[-1]
        turned = np.mod(horizontal, 360.0)
        if last <= 180:
            turned = np.minimum(turned, 360 - turned)
        if last <= 90:
            turned = np.minimum(turned, 180 - turned)
        return np.array([np.interp(turned, self.horizontal, column) for column in planes.T])


def read_luminaire(source: Path | bytes) -> Luminaire:
    """Return the luminaire of an IES file, or of the content of one.

    Raises
    ------
    InputError
        When it is no IES file of type C that can be used; the message says why, not which file.
    StateError
        When it cannot be read.
    """
    return _luminaire(_numbers(read_whole(source, _LARGEST_FILE).decode("latin-1")))


def _numbers(text: str) -> list[float]:
    """Return the numbers behind the line TILT."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    tilt = next((index for index, line in enumerate(lines) if line.strip().upper().startswith("TILT")), None)
    if tilt is None:
        raise InputError("is not an IES file: it has no line TILT= (allowed: IESNA LM-63)")
    words = " ".join(lines[tilt + 1 :]).replace(",", " ").split()
    try:
        numbers = [float(word) for word in words]
    except ValueError as problem:
        raise InputError(f"has text among its numbers ({problem})") from None
    if not all(math.isfinite(number) for number in numbers):
        raise InputError("holds a number that is not finite")
    if (
        lines[tilt].strip().upper() == "TILT=INCLUDE"
    ):  # how output depends on the lamp's tilt: orientation, angles, factors
        pairs = int(numbers[1]) if len(numbers) > 1 and 0 <= numbers[1] <= _MOST_ANGLES else 0
        numbers = numbers[2 + 2 * pairs :]
    return numbers


def _luminaire(numbers: list[float]) -> Luminaire:
    if len(numbers) < 13:
        raise InputError("is cut off before its angles")
    multiplier, kind, factors = numbers[2], numbers[5], numbers[10] * numbers[11]
    counts = (numbers[3], numbers[4])
    if not all(count == int(count) and 1 <= count <= _MOST_ANGLES for count in counts):
        raise InputError(
            f"has unusable numbers of angles (got {counts[0]:g} and {counts[1]:g}; allowed: 1 to {_MOST_ANGLES})"
        )
    if kind != 1:
        raise InputError(f"is of photometric type {({2: 'B', 3: 'A'}).get(int(kind), kind)} (allowed: type C)")
    m, n = int(counts[0]), int(counts[1])
    values = np.array(numbers[13 : 13 + m + n + m * n])
    if len(values) != m + n + m * n:
        raise InputError(f"is cut off (got {len(values)} of {m + n + m * n} angles and intensities)")
    vertical, horizontal, candela = values[:m], values[m : m + n], values[m + n :].reshape(n, m)
    _check_angles(vertical, horizontal)
    if multiplier * factors <= 0 or (candela < 0).any():
        raise InputError("holds a negative intensity, or a factor that is not above 0")
    return Luminaire(vertical, horizontal, candela * (multiplier * factors / LUMENS_PER_WATT))


def _check_angles(vertical: Array, horizontal: Array) -> None:
    if (np.diff(vertical) <= 0).any() or vertical[0] < 0 or vertical[-1] > 180:
        raise InputError("has vertical angles that do not rise from 0 or more to at most 180 degrees")
    if (np.diff(horizontal) <= 0).any() or horizontal[0] != 0 or horizontal[-1] not in (0, 90, 180, 360):
        raise InputError("has horizontal angles that do not rise from 0 to 0, 90, 180 or 360 degrees")
