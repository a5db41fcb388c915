"""Transparent materials: solids, smooth or rough, that may absorb, and thin panes."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from rptcam_cl.optics.glass import WAVELENGTH_D
from rptcam_cl.scene.base import Alternatives, SceneModel
from rptcam_cl.scene.colours import Colour
from rptcam_cl.scene.coverage import BumpyMaterial, CoveringMaterial
from rptcam_cl.scene.glass import LARGEST_INDEX, SMALLEST_INDEX, Glass, nearest_to_one
from rptcam_cl.scene.quantities import NUMBER, Albedo, Coefficient
from rptcam_cl.scene.refusal import refuse
from rptcam_cl.scene.roughness import RoughMaterial
from rptcam_cl.scene.spectrum import SpectralColour

Index = Annotated[float, Field(ge=SMALLEST_INDEX, le=LARGEST_INDEX), NUMBER]

# A rough surface whose index is nearer to 1 bends light by less than its facets' normals can be told from in float32.
LEAST_BEND = 0.01

# What a colour channel of 0 stands for after a finite way: it must have a logarithm.
DARKEST = 1e-6


class Attenuation(SceneModel):
    """What a solid leaves of white light after a distance."""

    color: Albedo
    """Colour that is left; channels 0 to 1."""

    distance_m: Annotated[float, Field(ge=1e-9, le=1e9), NUMBER]
    """After which distance [m]."""


class AbsorbingMaterial(SceneModel):
    """A solid that may absorb light on its way inside (Beer and Lambert)."""

    absorption_per_m: Coefficient | None = None
    """Absorption coefficient [1/m]; a colour."""

    attenuation: Attenuation | None = None
    """The same, as the colour that is left after a distance."""

    @property
    def absorption(self) -> Colour:
        """Absorption coefficient per channel [1/m]."""
        if self.absorption_per_m is not None:
            return self.absorption_per_m
        if self.attenuation is None:
            return (0.0, 0.0, 0.0)
        return _depth(self.attenuation.color, self.attenuation.distance_m)


def _depth(left: Colour, distance: float) -> Colour:
    """Return the coefficient of absorption that leaves a share of light after a distance."""
    red, green, blue = (-math.log(max(share, DARKEST)) / distance for share in left)
    if isinstance(left, SpectralColour):
        return SpectralColour((red, green, blue), -np.log(np.maximum(left.samples, DARKEST)) / distance)
    return (red, green, blue)


ABSORPTION = Alternatives(("absorption_per_m", "attenuation"), required=False)
ROUGHNESS = Alternatives(("alpha", "roughness"), required=False)


class Dielectric(RoughMaterial, AbsorbingMaterial, BumpyMaterial):
    """A transparent solid such as glass; the normal points out of it. Smooth without `alpha` and `roughness`."""

    kind: Literal["dielectric"]
    """Kind of material."""

    index: Index = 1.5
    """Refractive index inside, relative to the outside."""

    glass: Glass | None = None
    """What is inside instead, with its dispersion: a name, or a law as lens files have them."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (Alternatives(("index", "glass"), False), ROUGHNESS, ABSORPTION)

    @property
    def n_d(self) -> float:
        """Refractive index at 587.56 nm."""
        return self.index if self.glass is None else float(self.glass.index(WAVELENGTH_D))

    @model_validator(mode="after")
    def _check_bend(self) -> Self:
        nearest = self.index if self.glass is None else nearest_to_one(self.glass)
        if self.alphas is not None and abs(nearest - 1) < LEAST_BEND:
            raise refuse(
                "bends light too little for a rough surface", got=nearest,
                allowed=f"1 +- {LEAST_BEND:g} or farther from 1; or a smooth surface",
                path=("index" if self.glass is None else "glass",),
            )  # fmt: skip
        return self


class ThinGlass(CoveringMaterial):
    """A pane or bubble too thin to shift light: both its faces, with all reflections between them."""

    kind: Literal["thin_glass"]
    """Kind of material."""

    index: Index = 1.5
    """Refractive index of the pane, relative to the outside."""

    transmittance: Albedo = (1.0, 1.0, 1.0)
    """Share of light that one way straight through the pane leaves; a colour of channels 0 to 1."""

    @property
    def depth(self) -> Colour:
        """Optical depth per channel at normal incidence."""
        return _depth(self.transmittance, 1.0)
