"""How the colour of light is carried along paths."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import model_validator

from rptcam_cl.scene.base import SceneModel

MODES = ("auto", "rgb", "dispersive", "spectral")


class SpectrumSettings(SceneModel):
    """How the colour of light is carried along paths; a word alone is the mode."""

    mode: Literal["auto", "rgb", "dispersive", "spectral"] = "auto"
    """Red, green and blue through a lens of one wavelength; the same with a wavelength per path, which lens and glass
    disperse; spectra at three wavelengths per path. By default what the scene needs."""

    @model_validator(mode="before")
    @classmethod
    def _word(cls, value: Any) -> Any:
        return {"mode": value} if isinstance(value, str) else value
