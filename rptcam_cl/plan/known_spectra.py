"""The spectra that colours of the scene are known by, counted as the records name them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.scene.spectrum import SpectralColour


@dataclass
class KnownSpectra:
    """Spectra in the order of their numbers, from 1.

    Attributes
    ----------
    samples : list of arrays (401,)
        At `rptcam_cl.spectra.WAVELENGTHS_NM`.
    lights : list of arrays (401,)
        Those of them that shine.
    colours : int
        How many times a colour of the scene was given as a spectrum.
    """

    samples: list[NDArray[np.float64]] = field(default_factory=list)
    lights: list[NDArray[np.float64]] = field(default_factory=list)
    colours: int = 0
    _numbers: dict[bytes, int] = field(default_factory=dict)

    def number(self, value: Any, *, light: bool = False, gain: float = 1.0) -> int:
        """Return the number of a colour's spectrum, times a gain; 0 for a colour that has none."""
        if not isinstance(value, SpectralColour):
            return 0
        self.colours += 1
        samples = gain * value.samples
        if light:
            self.lights.append(samples)
        return self.add(samples)

    def add(self, samples: NDArray[np.float64]) -> int:
        """Return the number of samples."""
        key = samples.tobytes()
        if key not in self._numbers:
            self.samples.append(samples)
            self._numbers[key] = len(self.samples)
        return self._numbers[key]
