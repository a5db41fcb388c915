"""How the colour of light is carried along paths."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import model_validator

from rptcam_cl.scene.base import SceneModel

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
