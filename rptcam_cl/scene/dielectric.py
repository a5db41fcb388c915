"""Transparent materials: solids of glass, smooth or rough, that may absorb, and thin panes."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, PlainSerializer, PlainValidator, ValidationInfo, WithJsonSchema, model_validator

from rptcam_cl.colour import LINE_D_NM, WAVELENGTHS_NM
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.references import Folders, References
from rptcam_cl.core.strict_yaml import Document
from rptcam_cl.optics import GLASS, FieldError, Law, glass_json_schema, held_index, known_range, read_glass
from rptcam_cl.scene.base import Alternatives, SceneModel, refuse
from rptcam_cl.scene.material_parts import BumpyMaterial, CoveringMaterial, RoughMaterial
from rptcam_cl.scene.quantities import NUMBER, Albedo, Coefficient, Colour
from rptcam_cl.scene.spectrum import SpectralColour

SMALLEST_INDEX, LARGEST_INDEX = 0.2, 5.0

KEYS = {name: key for name, key in GLASS.items() if name != "transmittance"}


def _read(value: Any, info: ValidationInfo) -> Law:
    """Return the law of a glass that is a name or a mapping."""
    if isinstance(value, Law):
        return value
    if not isinstance(value, (str, dict)):
        raise refuse("must be a glass", allowed="a name such as N-BK7, or a mapping such as {nd: 1.5168, vd: 64.17}")
    if isinstance(value, dict) and "transmittance" in value:
        raise refuse("is not read here", allowed="absorption_per_m or attenuation of the material",
                     path=("transmittance",))  # fmt: skip
    folders = info.context["folders"] if info.context else Folders()
    document = Document({"glass": value}, "glass", {}, {}, References(folders))
    try:
        medium = read_glass(document, ("glass",))
    except FieldError as problem:
        raise refuse(problem.text, path=problem.path[1:]) from None
    except (InputError, StateError) as problem:
        raise refuse(str(problem)) from None
    assert isinstance(medium, Law)
    _check(medium)
    return medium


def _check(medium: Law) -> None:
    limits = known_range(medium)
    if limits is not None and not limits[0] <= LINE_D_NM <= limits[1]:
        raise refuse(f"is known from {limits[0]:g} to {limits[1]:g} nm only", allowed="a glass known at 587.56 nm")
    try:
        with np.errstate(divide="ignore"):  # at a resonance
            index = held_index(medium, WAVELENGTHS_NM)
    except InputError as problem:
        raise refuse(str(problem)) from None
    if not np.all((index >= SMALLEST_INDEX) & (index <= LARGEST_INDEX)):
        span = f"{SMALLEST_INDEX:g} to {LARGEST_INDEX:g} at every wavelength from 380 to 780 nm"
        raise refuse(f"has a refractive index from {index.min():.4g} to {index.max():.4g}", allowed=span)


def nearest_to_one(medium: Law) -> float:
    """Return the refractive index from 380 to 780 nm that is nearest to 1."""
    index = held_index(medium, WAVELENGTHS_NM)
    return float(index[np.abs(index - 1).argmin()])


Glass = Annotated[
    Law,
    PlainValidator(_read),
    PlainSerializer(repr, when_used="json"),
    WithJsonSchema(glass_json_schema(KEYS)),
]

Index = Annotated[float, Field(ge=SMALLEST_INDEX, le=LARGEST_INDEX), NUMBER]

# A rough surface whose index is nearer to 1 bends light by less than float32 resolves of its facets' normals.
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
        return self.index if self.glass is None else float(self.glass.index(LINE_D_NM))

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

    @property
    def parameter(self) -> float:
        """The number of its own that the kernels read: the index."""
        return self.index
