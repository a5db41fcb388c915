"""Media of a scene: what fills its solids or lies around all, absorbs light, scatters it and shines."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from rptcam_cl.scene import quantities, textures
from rptcam_cl.scene.base import Alternatives, FileReference, SceneModel, refuse

# What fills the space around a scene or the inside of its solids: fog, smoke, water, milk.

_LEFT_AT_VISIBILITY = 0.05  # of light, by which the World Meteorological Organization defines how far one sees
MOST_ASYMMETRY = 0.99
_LEAST_ASYMMETRY = 1e-3  # below it float32 does not tell scattering from even scattering
_BLACK: quantities.Colour = (0.0, 0.0, 0.0)
_STAND_IN: quantities.Colour = (0.5, 0.5, 0.5)
_FreePath = Annotated[float, Field(ge=1e-6, le=1e9), quantities.NUMBER]
_FREE_PATHS = BeforeValidator(
    lambda value: [value] * 3 if isinstance(value, (int, float)) and not isinstance(value, bool) else value
)


_Substance = Literal[
    "apple", "chicken", "cream", "ketchup", "marble", "potato", "skim_milk", "skin", "skin_pale", "spectralon",
    "whole_milk",
]  # fmt: skip
# Scattering, reduced, and absorption [1/mm] in red, green and blue, by Jensen et al. (2001, fig. 5); pale skin
# is their skin2, chicken their chicken1.
SUBSTANCES: dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "apple": ((2.29, 2.39, 1.97), (0.0030, 0.0034, 0.046)),
    "chicken": ((0.15, 0.21, 0.38), (0.015, 0.077, 0.19)),
    "cream": ((7.38, 5.47, 3.15), (0.0002, 0.0028, 0.0163)),
    "ketchup": ((0.18, 0.07, 0.03), (0.061, 0.97, 1.45)),
    "marble": ((2.19, 2.62, 3.00), (0.0021, 0.0041, 0.0071)),
    "potato": ((0.68, 0.70, 0.55), (0.0024, 0.0090, 0.12)),
    "skim_milk": ((0.70, 1.22, 1.90), (0.0014, 0.0025, 0.0142)),
    "skin": ((0.74, 0.88, 1.01), (0.032, 0.17, 0.48)),
    "skin_pale": ((1.09, 1.59, 1.79), (0.013, 0.070, 0.145)),
    "spectralon": ((11.6, 20.4, 14.9), (0.0, 0.0, 0.0)),
    "whole_milk": ((2.55, 3.21, 3.77), (0.0011, 0.0024, 0.014)),
}


def albedo_for(colour: float) -> float:
    """Return the share of light that an even medium must scatter so that a deep body of it gives back ``colour``.

    Of light from all sides, without a surface that reflects (Kulla and Conty 2017, inverting van de Hulst's fit).
    """
    s = 4.09712 + 4.20863 * colour - math.sqrt(9.59217 + colour * (41.6808 + 17.7126 * colour))
    return 1.0 - min(max(s, 0.0), 1.0) ** 2


# Fog by the size of its droplets: Jendersie and d'Eon, «An approximate Mie scattering function for fog and cloud
# rendering», SIGGRAPH 2023 talks, eq. 4 to 7.
_Droplet = Annotated[float, Field(ge=5, le=50), quantities.NUMBER]


class Droplets(NamedTuple):
    """The phase function of droplets of water: means of Henyey and Greenstein's part, and of Draine's; its share."""

    asymmetry: float
    g: float
    alpha: float
    share: float

    @classmethod
    def of(cls, diameter_um: float) -> Droplets:
        """Return the phase function of droplets of a diameter of 5 to 50 micrometres."""
        d = diameter_um
        return cls(
            math.exp(-0.0990567 / (d - 1.67154)),
            math.exp(-2.20679 / (d + 3.91029) - 0.428934),
            math.exp(3.62489 - 8.29288 / (d + 5.52825)),
            math.exp(-0.599085 / (d - 0.641583) - 0.665888),
        )

    @property
    def mean_cosine(self) -> float:
        """Mean cosine of the whole."""
        g, alpha = self.g, self.alpha
        draine = g * (1 + alpha * (3 + 2 * g * g) / 5) / (1 + alpha * (1 + 2 * g * g) / 3)
        return (1 - self.share) * self.asymmetry + self.share * draine


class DensityGrid(FileReference):
    """How dense a medium is from place to place: numbers by which its coefficients and emission are multiplied.

    They are given in the middles of voxels, change evenly between them, and are nothing outside of their box.
    """

    grid: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    """Of an OpenVDB file: the name of the grid; by default `density`, or the only one."""

    min: quantities.Position | None = None
    """Lowest corner of the box [scene units]; of an OpenVDB file where its own coordinates say, by default."""

    max: quantities.Position | None = None
    """Highest corner of the box [scene units], as above."""

    @model_validator(mode="after")
    def _check_corners(self) -> DensityGrid:
        if (self.min is None) != (self.max is None):
            missing = "max" if self.max is None else "min"
            raise refuse("is needed beside the other corner", allowed="both corners, or none", path=(missing,))
        if self.min is not None and self.max is not None and any(
            high - low <= 0 for low, high in zip(self.min, self.max, strict=True)
        ):  # fmt: skip
            raise refuse("must lie above min along every axis", got=self.max, path=("max",))
        return self


class ScatteringMedium(SceneModel):
    """A medium: it absorbs, scatters and emits light, alike everywhere unless its density lies on a grid.

    How dense it is, is said by its coefficients, by how far one sees in it, by the colour of a deep body, or by a name.
    """

    absorption_per_m: quantities.Coefficient | None = None
    """Absorption coefficient [1/m]; a colour."""

    scattering_per_m: quantities.Coefficient | None = None
    """Scattering coefficient [1/m]; a colour."""

    visibility_m: Annotated[float, Field(ge=1e-6, le=1e9), quantities.NUMBER] | None = None
    """Distance after which 5 % of light are left, the meteorological optical range [m]; in place of both."""

    albedo: quantities.Albedo | None = None
    """With `visibility_m`: share of light that is scattered and not absorbed; of fog 1, as by default."""

    asymmetry: Annotated[float, Field(ge=-MOST_ASYMMETRY, le=MOST_ASYMMETRY), quantities.NUMBER] = 0.0
    """Mean cosine of scattering (Henyey and Greenstein): above 0 forwards, as fog, some 0.8; 0 evenly."""

    droplets_um: _Droplet | None = None
    """Diameter of droplets of water that scatter as in fog and clouds [micrometres], 5 to 50; in place of asymmetry."""

    substance: _Substance | None = None
    """What it is, with the coefficients that Jensen et al. measured in 2001; in place of all these."""

    color: textures.Reflectance | None = None
    """With `free_path_mm`: colour of a deep body of it in light from all sides, of what enters the surface. In a solid
    with a surface also a texture, of which light takes the colour where it enters."""

    free_path_mm: Annotated[tuple[_FreePath, _FreePath, _FreePath], _FREE_PATHS] | None = None
    """With `color`: mean way of light between two events [mm], were scattering even; a number, or one a channel."""

    emission_per_m: quantities.Radiance = _BLACK
    """Radiance that is emitted per metre [W/(m³ sr) per channel]; a colour."""

    density: DensityGrid | None = None
    """Grid of numbers by which all this is multiplied; without it the medium is the same everywhere."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("droplets_um", "asymmetry"), required=False),
        Alternatives(("droplets_um", "substance"), required=False),
        Alternatives(("visibility_m", "absorption_per_m"), required=False),
        Alternatives(("visibility_m", "scattering_per_m"), required=False),
        Alternatives(("substance", "visibility_m", "free_path_mm"), required=False),
        Alternatives(("substance", "absorption_per_m", "free_path_mm"), required=False),
        Alternatives(("substance", "scattering_per_m", "free_path_mm"), required=False),
    )

    @model_validator(mode="after")
    def _check_albedo(self) -> ScatteringMedium:
        if self.albedo is not None and self.visibility_m is None:
            raise refuse("needs visibility_m", allowed="visibility_m beside it, or both coefficients", path=("albedo",))
        if (self.color is None) != (self.free_path_mm is None):
            missing = "free_path_mm" if self.free_path_mm is None else "color"
            raise refuse(f"is needed beside {'color' if missing != 'color' else 'free_path_mm'}", path=(missing,))
        if self.by_entry and self.mean_cosine != 0:
            key = "asymmetry" if self.droplets_um is None else "droplets_um"
            allowed = "even scattering, or one colour"
            raise refuse("does not go with a color from a texture", allowed=allowed, path=(key,))
        return self

    @property
    def by_entry(self) -> bool:
        """Whether its colour is that of a texture where a path enters it."""
        return self.color is not None and not isinstance(self.color, tuple)

    @property
    def _reduced(self) -> tuple[quantities.Colour, quantities.Colour] | None:
        """Scattering, were it even, and absorption per channel [1/m], of a substance or a colour."""
        if self.substance is not None:
            scattering, absorption = SUBSTANCES[self.substance]
            return _scale_colour(scattering, 1e3), _scale_colour(absorption, 1e3)
        if self.color is None or self.free_path_mm is None:
            return None
        per_m = [1e3 / way for way in self.free_path_mm]
        colour = self.color if isinstance(self.color, tuple) else _STAND_IN  # paths take the texture's where they enter
        red, green, blue = (albedo_for(channel) * rate for channel, rate in zip(colour, per_m, strict=True))
        return (red, green, blue), (per_m[0] - red, per_m[1] - green, per_m[2] - blue)

    @property
    def scattering(self) -> quantities.Colour:
        """Scattering coefficient per channel [1/m]."""
        if (reduced := self._reduced) is not None:
            return _scale_colour(reduced[0], 1 / (1 - self.mean_cosine))
        if self.visibility_m is None:
            return _BLACK if self.scattering_per_m is None else self.scattering_per_m
        return _scale_colour((1.0, 1.0, 1.0) if self.albedo is None else self.albedo, self._extinction)

    @property
    def absorption(self) -> quantities.Colour:
        """Absorption coefficient per channel [1/m]."""
        if (reduced := self._reduced) is not None:
            return reduced[1]
        if self.visibility_m is None:
            return _BLACK if self.absorption_per_m is None else self.absorption_per_m
        return _BLACK if self.albedo is None else _scale_colour(_rest(self.albedo), self._extinction)

    @property
    def mean_cosine(self) -> float:
        """The asymmetry, 0 where float32 takes it for even scattering."""
        if self.droplets_um is not None:
            return Droplets.of(self.droplets_um).mean_cosine
        return 0.0 if abs(self.asymmetry) < _LEAST_ASYMMETRY else self.asymmetry

    @property
    def _extinction(self) -> float:
        assert self.visibility_m is not None
        return float(-np.log(_LEFT_AT_VISIBILITY) / self.visibility_m)


def refuse_texture(medium: ScatteringMedium, path: tuple[str, ...]) -> None:
    """Refuse a colour that paths could not take where they enter a medium."""
    if medium.by_entry:
        allowed = "one colour; a texture in `interior` of dielectric or principled"
        raise refuse("is a texture, but paths do not enter here by a surface", allowed=allowed, path=path)


class FogLayer(SceneModel):
    """How a medium thins out upwards: even below a height, and above it less and less, exponentially."""

    scale_height_m: Annotated[float, Field(ge=1e-6, le=1e9), quantities.NUMBER]
    """Height above the base in which the density falls to 1/e, 37 % [m]."""

    base: quantities.Coordinate = 0.0
    """Height up to which the medium is as dense as its coefficients say: `up`, from the origin [scene units]."""

    up: quantities.Direction = (0.0, 1.0, 0.0)
    """Direction in which it thins out; any length. In a scene the default is the `up` of the camera."""

    def scale_heights(self, eye: tuple[float, ...], metres_per_unit: float) -> tuple[float, ...]:
        """Return a [1/m] and b, by which places p about the eye [m] lie a . p - b scale heights above the base."""
        x, y, z = np.divide(self.up, np.linalg.norm(self.up)).tolist()
        above = self.base - float(np.dot((x, y, z), eye))
        scale = 1.0 / self.scale_height_m
        return x * scale, y * scale, z * scale, above * metres_per_unit * scale


class SurroundingMedium(ScatteringMedium):
    """A medium round everything, which may lie in a layer as ground fog does."""

    layer: FogLayer | None = None
    """How it thins out upwards; by default it is alike everywhere."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        *ScatteringMedium.alternatives,
        Alternatives(("layer", "density"), required=False),
    )

    @model_validator(mode="after")
    def _check_color(self) -> SurroundingMedium:
        refuse_texture(self, ("color",))
        return self


def _scale_colour(colour: quantities.Colour, factor: float) -> quantities.Colour:
    if isinstance(colour, quantities.SpectralColour):
        return colour.scaled(factor)
    red, green, blue = (factor * channel for channel in colour)
    return (red, green, blue)


def _rest(colour: quantities.Colour) -> quantities.Colour:
    red, green, blue = (1.0 - channel for channel in colour)
    if isinstance(colour, quantities.SpectralColour):
        return quantities.SpectralColour((red, green, blue), 1.0 - colour.samples)
    return red, green, blue


# What solids of other materials absorb (Beer and Lambert).

# What a colour channel of 0 stands for after a finite way: it must have a logarithm.
_DARKEST = 1e-6


class Attenuation(SceneModel):
    """What a solid leaves of white light after a distance."""

    color: quantities.Albedo
    """Colour that is left; channels 0 to 1."""

    distance_m: Annotated[float, Field(ge=1e-9, le=1e9), quantities.NUMBER]
    """After which distance [m]."""


class AbsorbingMaterial(SceneModel):
    """A solid that may absorb light on its way inside (Beer and Lambert)."""

    absorption_per_m: quantities.Coefficient | None = None
    """Absorption coefficient [1/m]; a colour."""

    attenuation: Attenuation | None = None
    """The same, as the colour that is left after a distance."""

    interior: ScatteringMedium | None = None
    """What fills it, where that scatters light as well."""

    @property
    def absorption(self) -> quantities.Colour:
        """Absorption coefficient per channel [1/m]."""
        if self.absorption_per_m is not None:
            return self.absorption_per_m
        if self.attenuation is None:
            return (0.0, 0.0, 0.0)
        return depth_of(self.attenuation.color, self.attenuation.distance_m)


def depth_of(left: quantities.Colour, distance: float) -> quantities.Colour:
    """Return the coefficient of absorption that leaves a share of light after a distance."""
    red, green, blue = (-math.log(max(share, _DARKEST)) / distance for share in left)
    if isinstance(left, quantities.SpectralColour):
        return quantities.SpectralColour((red, green, blue), -np.log(np.maximum(left.samples, _DARKEST)) / distance)
    return (red, green, blue)


ABSORPTION = Alternatives(("absorption_per_m", "attenuation", "interior"), required=False)
