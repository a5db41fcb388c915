"""What fills the space around a scene or the inside of its solids: fog, smoke, water, milk."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from rptcam_cl.scene.base import Alternatives, SceneModel, refuse
from rptcam_cl.scene.quantities import NUMBER, Albedo, Coefficient, Colour, Radiance, SpectralColour

LEFT_AT_VISIBILITY = 0.05  # of light, by which the World Meteorological Organization defines how far one sees
MOST_ASYMMETRY = 0.99
LEAST_ASYMMETRY = 1e-3  # below it float32 does not tell scattering from even scattering
BLACK: Colour = (0.0, 0.0, 0.0)


class ScatteringMedium(SceneModel):
    """A homogeneous medium: it absorbs, scatters and emits light alike everywhere.

    How dense it is, is said by its two coefficients, or by how far one sees in it and its albedo.
    """

    absorption_per_m: Coefficient | None = None
    """Absorption coefficient [1/m]; a colour."""

    scattering_per_m: Coefficient | None = None
    """Scattering coefficient [1/m]; a colour."""

    visibility_m: Annotated[float, Field(ge=1e-6, le=1e9), NUMBER] | None = None
    """Distance after which 5 % of light are left, the meteorological optical range [m]; in place of both."""

    albedo: Albedo | None = None
    """With `visibility_m`: share of light that is scattered and not absorbed; of fog 1, as by default."""

    asymmetry: Annotated[float, Field(ge=-MOST_ASYMMETRY, le=MOST_ASYMMETRY), NUMBER] = 0.0
    """Mean cosine of scattering (Henyey and Greenstein): above 0 forwards, as fog, some 0.8; 0 evenly."""

    emission_per_m: Radiance = BLACK
    """Radiance that is emitted per metre [W/(m³ sr) per channel]; a colour."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("visibility_m", "absorption_per_m"), required=False),
        Alternatives(("visibility_m", "scattering_per_m"), required=False),
    )

    @model_validator(mode="after")
    def _check_albedo(self) -> ScatteringMedium:
        if self.albedo is not None and self.visibility_m is None:
            raise refuse("needs visibility_m", allowed="visibility_m beside it, or both coefficients", path=("albedo",))
        return self

    @property
    def scattering(self) -> Colour:
        """Scattering coefficient per channel [1/m]."""
        if self.visibility_m is None:
            return BLACK if self.scattering_per_m is None else self.scattering_per_m
        return _scaled((1.0, 1.0, 1.0) if self.albedo is None else self.albedo, self._extinction)

    @property
    def absorption(self) -> Colour:
        """Absorption coefficient per channel [1/m]."""
        if self.visibility_m is None:
            return BLACK if self.absorption_per_m is None else self.absorption_per_m
        return BLACK if self.albedo is None else _scaled(_rest(self.albedo), self._extinction)

    @property
    def mean_cosine(self) -> float:
        """The asymmetry, 0 where float32 takes it for even scattering."""
        return 0.0 if abs(self.asymmetry) < LEAST_ASYMMETRY else self.asymmetry

    @property
    def _extinction(self) -> float:
        assert self.visibility_m is not None
        return float(-np.log(LEFT_AT_VISIBILITY) / self.visibility_m)


def _scaled(colour: Colour, factor: float) -> Colour:
    if isinstance(colour, SpectralColour):
        return colour.scaled(factor)
    red, green, blue = (factor * channel for channel in colour)
    return (red, green, blue)


def _rest(colour: Colour) -> Colour:
    red, green, blue = (1.0 - channel for channel in colour)
    return SpectralColour((red, green, blue), 1.0 - colour.samples) if isinstance(colour, SpectralColour) else (
        red, green, blue,
    )  # fmt: skip
