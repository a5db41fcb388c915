"""A colour that is known at every wavelength, and how the colour of light is carried along paths."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from rptcam_cl.colour import Spectrum, srgb_from_reflectance, srgb_from_spectrum, within_srgb
from rptcam_cl.scene.base import SceneModel

Lines = tuple[tuple[float, float], ...]


class SpectralColour(tuple[float, float, float]):
    """Linear sRGB of a spectrum, which it keeps.

    Attributes
    ----------
    samples : array (401,)
        Values at `rptcam_cl.colour.WAVELENGTHS_NM`, read-only: shares of light, coefficients, or densities of a light
        per nm.
    lines : tuple of (float, float)
        Lines of a light, wavelength [nm] and amount; `samples` has them too, shared by their neighbours on the grid.
    """

    samples: Spectrum
    lines: Lines

    def __new__(cls, srgb: ArrayLike, samples: ArrayLike, lines: Lines = ()) -> SpectralColour:
        """Return the colour of three channels that has these samples and lines."""
        red, green, blue = map(float, np.asarray(srgb))
        made = super().__new__(cls, (red, green, blue))
        made.samples = np.array(samples, np.float64)
        made.samples.setflags(write=False)
        made.lines = lines
        return made

    @classmethod
    def of_light(cls, samples: ArrayLike, lines: Lines = ()) -> SpectralColour:
        """Return a light of densities [1/nm]; a colour outside sRGB is cut, its luminance stays."""
        return cls(within_srgb(srgb_from_spectrum(samples)), samples, lines)

    @classmethod
    def of_reflectance(cls, samples: ArrayLike) -> SpectralColour:
        """Return shares of light, whose colour is that under D65, cut to 0 … 1."""
        return cls(np.clip(srgb_from_reflectance(samples), 0.0, 1.0), samples)

    @classmethod
    def of_coefficient(cls, samples: ArrayLike) -> SpectralColour:
        """Return coefficients of absorption, whose channels are means over what a channel sees of D65, cut at 0."""
        return cls(np.maximum(srgb_from_reflectance(samples), 0.0), samples)

    def scaled(self, factor: float) -> SpectralColour:
        """Return a light that is so many times as strong."""
        lines = tuple((wavelength, amount * factor) for wavelength, amount in self.lines)
        return SpectralColour(np.multiply(self, factor), self.samples * factor, lines)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, SpectralColour)
            and tuple(self) == tuple(other)
            and np.array_equal(self.samples, other.samples)
            and self.lines == other.lines
        )

    def __ne__(self, other: object) -> bool:  # a tuple has one of its own
        return not self == other

    def __hash__(self) -> int:
        return hash((tuple(self), self.samples.tobytes(), self.lines))

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return SpectralColour, (tuple(self), self.samples, self.lines)

    def __repr__(self) -> str:
        return f"SpectralColour({', '.join(f'{channel:.6g}' for channel in self)})"

    def described(self) -> dict[str, Any]:
        """Return it as plain data, with as many digits as tell two pictures apart."""
        samples = [float(f"{value:.9g}") for value in self.samples]
        return {"samples": samples, "lines": [list(line) for line in self.lines]}


LensColour = Literal["off", "auto", "on"]


class SpectrumSettings(SceneModel):
    """How the colour of light is carried along paths; a word alone is the mode."""

    mode: Literal["auto", "rgb", "dispersive", "spectral"] = "auto"
    """Red, green and blue through a lens of one wavelength; the same with a wavelength per path, which lens and glass
    disperse; spectra at three wavelengths per path. By default what the scene needs."""

    lens: LensColour | None = None
    """Whether the lens bends each wavelength by itself; `auto`: where that moves light by more than half a pixel, or
    than `camera.accuracy` allows."""

    @model_validator(mode="before")
    @classmethod
    def _word(cls, value: Any) -> Any:
        return {"mode": value} if isinstance(value, str) else value

    @property
    def lens_colour(self) -> LensColour:
        """Whether the lens bends each wavelength by itself."""
        if self.mode == "rgb":
            return "off"
        return self.lens or ("on" if self.mode == "dispersive" else "auto")
