"""Materials of a scene: matte, plastic, glass, metal, mirror, principled, emissive, and mixtures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetPydanticSchema,
    PlainSerializer,
    PlainValidator,
    Tag,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from rptcam_cl.core import LINE_D_NM, files, strict_yaml
from rptcam_cl.core.colour import WAVELENGTHS_NM, Spectrum, on_grid
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.optics.files import glasses, keys
from rptcam_cl.optics.glass import Medium, held_index, known_range
from rptcam_cl.scene import quantities
from rptcam_cl.scene.base import Alternatives, FileName, FileReference, SceneModel, read_number, refuse, unknown_name
from rptcam_cl.scene.media import ABSORPTION, AbsorbingMaterial, ScatteringMedium, depth_of, refuse_texture
from rptcam_cl.scene.textures import AnisotropyMap, Bump, Emission, NormalMap, Reflectance, Share

# What most materials have besides how they scatter: holes, normals from a picture, roughness of facets.


class CoveringMaterial(SceneModel):
    """A material that may have holes."""

    opacity: Share = 1.0
    """Share of the surface that is there: a number, or a texture (an image with `channel: a` for its alpha)."""

    opacity_mode: Literal["blend", "mask"] = "blend"
    """Whether rays pass with the probability that opacity leaves, or wherever opacity is below the cutoff."""

    opacity_cutoff: quantities.Fraction = 0.5
    """Opacity from which on a mask is there."""

    @model_validator(mode="after")
    def _check_opacity(self) -> Self:
        if not isinstance(self.opacity, float) and self.opacity.mapping is not None:
            raise refuse("does not count for opacity", allowed="u and v of the shape", path=("opacity", "mapping"))
        return self


def has_holes(material: SceneModel) -> bool:
    """Return whether rays may pass a surface of this material as if it were not there."""
    return isinstance(material, CoveringMaterial) and material.opacity != 1.0


class BumpyMaterial(CoveringMaterial):
    """A material whose normals may come from a picture."""

    normal_map: NormalMap | None = None
    """Normals from a picture; the shape needs texture coordinates."""

    bump: Bump | None = None
    """Normals from heights, in place of `normal_map`."""

    @model_validator(mode="after")
    def _check_normals(self) -> Self:
        if self.bump is not None and self.normal_map is not None:
            raise refuse("does not count beside normal_map", got="bump", path=("bump",), allowed="one of the two")
        return self


SMALLEST_ALPHA = 1e-3  # what float32 still resolves about a highlight

_ALPHA = {"type": "number", "minimum": SMALLEST_ALPHA, "maximum": 1}


def _alphas(value: Any) -> tuple[float, float]:
    """Return the pair that a number or a pair stands for."""

    def alpha(item: Any, path: tuple[int, ...]) -> float:
        number = read_number(item)
        if not SMALLEST_ALPHA <= number <= 1:
            bound = f"at least {SMALLEST_ALPHA:g}" if number < 1 else "at most 1"
            raise refuse("is out of range", got=number, allowed=bound, path=path)
        return number

    if not isinstance(value, (list, tuple)):
        return alpha(value, ()), alpha(value, ())
    if len(value) != 2:
        raise refuse(f"has {len(value)} numbers instead of 2", allowed="a number, or a pair [along u, across]")
    return alpha(value[0], (0,)), alpha(value[1], (1,))


_AlphaPair = Annotated[
    tuple[float, float],
    BeforeValidator(_alphas),
    WithJsonSchema({"anyOf": [_ALPHA, {"type": "array", "items": _ALPHA, "minItems": 2, "maxItems": 2}]}),
]


def alpha_pair(roughness: float, anisotropy: float) -> tuple[float, float]:
    """Return GGX's alpha along u and across (Burley 2012, section 5.4): their ratio is sqrt(1 - 0.9 anisotropy)."""
    alpha = max(roughness**2, SMALLEST_ALPHA)
    aspect = math.sqrt(1 - 0.9 * anisotropy)
    return max(alpha / aspect, SMALLEST_ALPHA), max(alpha * aspect, SMALLEST_ALPHA)


class RoughMaterial(SceneModel):
    """What says how rough a material is."""

    alpha: _AlphaPair | None = None
    """GGX roughness: a number, or [along u, across]."""

    roughness: quantities.Fraction | None = None
    """Roughness as most programs show it: the root of alpha."""

    anisotropy: quantities.Fraction = 0.0
    """With `roughness`: stretch of highlights along u; 0 is none."""

    anisotropy_rotation_degrees: quantities.Turn = 0.0
    """Turn of the directions along u and across, from u towards v."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (Alternatives(("alpha", "roughness"), required=False),)

    @property
    def alphas(self) -> tuple[float, float] | None:
        """GGX's alpha along u and across; None where the material is smooth."""
        if self.alpha is not None:
            return self.alpha
        return None if not self.roughness else alpha_pair(self.roughness, self.anisotropy)


# Transparent materials: solids of glass, smooth or rough, that may absorb, and thin panes.

SMALLEST_INDEX, LARGEST_INDEX = 0.2, 5.0

_KEYS = {name: key for name, key in keys.GLASS.items() if name != "transmittance"}


def _read_medium(value: Any, info: ValidationInfo) -> Medium:
    """Return the law of a glass that is a name or a mapping."""
    if isinstance(value, Medium):
        return value
    if not isinstance(value, (str, dict)):
        raise refuse("must be a glass", allowed="a name such as N-BK7, or a mapping such as {nd: 1.5168, vd: 64.17}")
    if isinstance(value, dict) and "transmittance" in value:
        raise refuse("is not read here", allowed="absorption_per_m or attenuation of the material",
                     path=("transmittance",))  # fmt: skip
    folders = info.context["folders"] if info.context else files.Folders()
    document = strict_yaml.Document({"glass": value}, "glass", {}, {}, files.References(folders))
    try:
        medium = glasses.read_glass(document, ("glass",))
    except strict_yaml.FieldError as problem:
        raise refuse(problem.text, path=problem.path[1:]) from None
    except (InputError, StateError) as problem:
        raise refuse(str(problem)) from None
    _check_medium(medium)
    return medium


def _check_medium(medium: Medium) -> None:
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


def _nearest_to_one(medium: Medium) -> float:
    """Return the refractive index from 380 to 780 nm that is nearest to 1."""
    index = held_index(medium, WAVELENGTHS_NM)
    return float(index[np.abs(index - 1).argmin()])


Glass = Annotated[
    Medium,
    PlainValidator(_read_medium),
    PlainSerializer(repr, when_used="json"),
    WithJsonSchema(keys.glass_json_schema(_KEYS)),
]

Index = Annotated[float, Field(ge=SMALLEST_INDEX, le=LARGEST_INDEX), quantities.NUMBER]

# A rough surface whose index is nearer to 1 bends light by less than float32 resolves of its facets' normals.
LEAST_BEND = 0.01

_ROUGHNESS = Alternatives(("alpha", "roughness"), required=False)


class Dielectric(RoughMaterial, AbsorbingMaterial, BumpyMaterial):
    """A transparent solid such as glass; the normal points out of it. Smooth without `alpha` and `roughness`."""

    kind: Literal["dielectric"]
    """Kind of material."""

    index: Index = 1.5
    """Refractive index inside, relative to the outside."""

    glass: Glass | None = None
    """What is inside instead, with its dispersion: a name, or a law as lens files have them."""

    reflectance: Reflectance = (1.0, 1.0, 1.0)
    """Factor on what the surface reflects: a colour of channels 0 to 1, or a texture; of real glass 1."""

    transmittance: Reflectance = (1.0, 1.0, 1.0)
    """Factor on what the surface refracts, at each passage: a colour of channels 0 to 1, or a texture; of real glass
    1."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (Alternatives(("index", "glass"), False), _ROUGHNESS, ABSORPTION)

    @property
    def n_d(self) -> float:
        """Refractive index at 587.56 nm."""
        return self.index if self.glass is None else float(self.glass.index(LINE_D_NM))

    @model_validator(mode="after")
    def _check_bend(self) -> Self:
        nearest = self.index if self.glass is None else _nearest_to_one(self.glass)
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

    transmittance: quantities.Albedo = (1.0, 1.0, 1.0)
    """Share of light that one way straight through the pane leaves; a colour of channels 0 to 1."""

    @property
    def depth(self) -> quantities.Colour:
        """Optical depth per channel at normal incidence."""
        return depth_of(self.transmittance, 1.0)


# Metals: rough conductors, by a colour or by the optical constants of what they are made of.

Metal = Literal["aluminium", "chromium", "copper", "gold", "iron", "nickel", "platinum", "silver", "tungsten"]

WRITTEN_OUT, MEASURED = "written out", "a table"  # forms of a metal that is no name; not keys
_SMALLEST_CONSTANT, _LARGEST_CONSTANT = 1e-3, 100.0

Constant = Annotated[float, Field(ge=_SMALLEST_CONSTANT, le=_LARGEST_CONSTANT), quantities.NUMBER]
_PER_CHANNEL = BeforeValidator(quantities.list_of(3, "one number each for red, green and blue"))


class OpticalConstants(SceneModel):
    """The refractive index n + i k of a metal in three channels."""

    n: Annotated[tuple[Constant, Constant, Constant], _PER_CHANNEL]
    """Real part [red, green, blue]."""

    k: Annotated[tuple[Constant, Constant, Constant], _PER_CHANNEL]
    """Imaginary part [red, green, blue]."""


class MetalTable(SceneModel):
    """The refractive index n + i k of a metal as a table, with straight lines between its rows."""

    wavelengths_nm: quantities.Numbers | None = None
    """Wavelengths of the rows [nm], rising; beside `n` and `k`."""

    n: quantities.Numbers | None = None
    """Real part in each row."""

    k: quantities.Numbers | None = None
    """Imaginary part in each row."""

    file: FileName | None = None
    """Table in the scene's folder: a wavelength [nm], n and k a line."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (Alternatives(("wavelengths_nm", "file"), required=True),)


@dataclass(frozen=True, eq=False)
class MetalSpectrum:
    """The refractive index n + i k of a metal at `rptcam_cl.core.colour.WAVELENGTHS_NM`."""

    n: Spectrum
    k: Spectrum

    def described(self) -> dict[str, list[float]]:
        """Return it as plain data."""
        return {name: [float(f"{x:.9g}") for x in getattr(self, name)] for name in ("n", "k")}


def _metal_spectrum(table: MetalTable, info: core_schema.ValidationInfo) -> MetalSpectrum:
    if table.file is not None:
        for name in ("n", "k"):
            if getattr(table, name) is not None:
                raise refuse("cannot be given together with file", allowed="wavelengths_nm, or no file", path=(name,))
        folders = info.context["folders"] if info.context else files.Folders()
        try:
            wavelengths, (n, k) = quantities.read_rows(table.file, folders, ("n", "k"))
        except InputError as problem:
            raise refuse(str(problem), path=("file",)) from None
    else:
        wavelengths, n, k = _written_rows(table)
    for name, column in (("n", n), ("k", k)):
        if np.any((column < _SMALLEST_CONSTANT) | (column > _LARGEST_CONSTANT)):
            span = f"{_SMALLEST_CONSTANT:g} to {_LARGEST_CONSTANT:g}"
            path = ("file",) if table.file is not None else (name,)
            raise refuse(f"{name} is out of range", got=column.tolist(), allowed=span, path=path)
    return MetalSpectrum(on_grid(wavelengths, n), on_grid(wavelengths, k))


def _written_rows(table: MetalTable) -> tuple[Spectrum, Spectrum, Spectrum]:
    """Return wavelengths, n and k of a table in the scene itself."""
    assert table.wavelengths_nm is not None
    wavelengths = np.array(table.wavelengths_nm)
    for name in ("n", "k"):
        column = getattr(table, name)
        if column is None or len(column) != len(wavelengths):
            raise refuse("does not fit wavelengths_nm", allowed=f"{len(wavelengths)} numbers", path=(name,))
    quantities.check_wavelengths(table.wavelengths_nm)
    return wavelengths, np.array(table.n), np.array(table.k)


def _metal_schema(source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
    """The schema that reads a metal from its table."""
    return core_schema.with_info_after_validator_function(
        _metal_spectrum,
        handler.generate_schema(MetalTable),
        serialization=core_schema.plain_serializer_function_ser_schema(MetalSpectrum.described, when_used="json"),
    )


def _metal_form(value: Any) -> str:
    if isinstance(value, dict):
        return MEASURED if "wavelengths_nm" in value or "file" in value else WRITTEN_OUT
    if isinstance(value, (MetalSpectrum, MetalTable)):
        return MEASURED
    return WRITTEN_OUT if isinstance(value, OpticalConstants) else "name"


class Conductor(RoughMaterial, BumpyMaterial):
    """A rough metal: GGX microfacets that reflect `reflectance` at every angle, or as the `metal` does."""

    kind: Literal["conductor"]
    """Kind of material."""

    reflectance: Reflectance | None = None
    """Share of light that a microfacet reflects: a colour of channels 0 to 1, or a texture."""

    metal: (
        Annotated[
            Annotated[Metal, Tag("name")]
            | Annotated[OpticalConstants, Tag(WRITTEN_OUT)]
            | Annotated[MetalSpectrum, GetPydanticSchema(_metal_schema), Tag(MEASURED)],
            Discriminator(_metal_form),
        ]
        | None
    ) = None
    """What it is made of: a name, or its optical constants, in three channels or as a table."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("reflectance", "metal"), required=True),
        Alternatives(("alpha", "roughness"), required=True),
    )

    @model_validator(mode="after")
    def _check_rough(self) -> Self:
        if self.alphas is None:
            raise refuse(
                "must be more than 0", allowed="above 0 to 1; for a smooth surface take a mirror", path=("roughness",)
            )
        return self


# Materials of a scene: matte, plastic, mirror, principled, emissive, and mixtures of them.

MOST_INDEX = 1000.0  # reflects 0.996 of the light at normal incidence
MOST_BEND = 5.0  # index of what light passes


class ThinFilm(SceneModel):
    """A film thinner than light is coherent, on a surface: soap, oil, the oxide of heated steel."""

    thickness_nm: Annotated[float, Field(ge=0, le=20_000), quantities.NUMBER]
    """Thickness of the film [nm]."""

    index: Annotated[float, Field(ge=1, le=5), quantities.NUMBER] = 1.3
    """Refractive index of the film."""

    share: quantities.Fraction = 1.0
    """Share of the surface that has it."""


class Principled(AbsorbingMaterial, BumpyMaterial):
    """A mixture of a dielectric over a diffuse or transparent base, and a metal; with sheen, a coat and emission."""

    kind: Literal["principled"]
    """Kind of material."""

    base_color: Reflectance = (0.8, 0.8, 0.8)
    """Colour of the diffuse base, of transmission, and of the metal: channels 0 to 1, or a texture."""

    metallic: Share = 0.0
    """Share of metal: a number, or a texture."""

    roughness: Share = 0.5
    """Roughness of the surface, the root of GGX's alpha: a number, or a texture."""

    anisotropy: quantities.Fraction = 0.0
    """Stretch of highlights along u; 0 is none."""

    anisotropy_rotation_degrees: quantities.Turn = 0.0
    """Turn of that direction, from u towards v."""

    anisotropy_map: AnisotropyMap | None = None
    """Direction and strength of the stretch from a picture, in place of `anisotropy`; the shape needs texture
    coordinates."""

    specular: Share = 1.0
    """Factor on the reflectance of the dielectric: a number, or a texture."""

    specular_color: Reflectance = (1.0, 1.0, 1.0)
    """Colour of that reflectance at normal incidence, not of grazing light: channels 0 to 1, or a texture."""

    index: Annotated[float, Field(ge=1, le=MOST_INDEX), quantities.NUMBER] = 1.5
    """Refractive index of the dielectric; at most 5 beside transmission."""

    transmission: Share = 0.0
    """Share of the dielectric's base that is transparent, a solid that refracts: a number, or a texture."""

    clearcoat: Share = 0.0
    """Share of the surface under a clear coat of index 1.5: a number, or a texture."""

    clearcoat_roughness: Share = 0.03
    """Roughness of the clear coat, the root of GGX's alpha: a number, or a texture."""

    clearcoat_normal_map: NormalMap | None = None
    """Normals of the clear coat from a picture; the shape needs texture coordinates."""

    clearcoat_flat: bool = Field(default=False, strict=True)
    """Whether the clear coat lies flat over what is below, and does not follow its normals."""

    sheen: Reflectance = (0.0, 0.0, 0.0)
    """Colour of the light that fibres standing up from a cloth send back at grazing angles: channels 0 to 1, or a
    texture."""

    sheen_roughness: quantities.Fraction = 0.5
    """Roughness of the sheen: the smaller, the nearer it keeps to grazing angles."""

    emission: Emission = (0.0, 0.0, 0.0)
    """Radiance emitted from the side of the normal [W/(m² sr) per channel]: a colour, or a texture."""

    two_sided: bool = Field(default=False, strict=True)
    """Whether the back emits too."""

    thin_film: ThinFilm | None = None
    """Film on the surface, in which light interferes; not beside transmission, nor beside textures of what reflects."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (ABSORPTION,)

    @property
    def takes_film(self) -> bool:
        """Whether a thin film may lie on it: its reflectance follows from numbers."""
        numbers = (self.metallic, self.specular, self.transmission)
        plain = all(isinstance(each, float) for each in numbers) and isinstance(self.specular_color, tuple)
        return plain and self.transmission == 0 and (self.metallic == 0 or isinstance(self.base_color, tuple))

    @model_validator(mode="after")
    def _check_film(self) -> Self:
        if self.thin_film is not None and not self.takes_film:
            raise refuse(
                "does not count here", got="a film", path=("thin_film",),
                allowed="beside numbers for metallic, specular and specular_color, a colour of metal, no transmission",
            )  # fmt: skip
        return self

    @model_validator(mode="after")
    def _check_maps(self) -> Self:
        if self.anisotropy_map is not None and self.anisotropy > 0:
            raise refuse(
                "does not count beside anisotropy_map", got=self.anisotropy, path=("anisotropy",),
                allowed="strength of the map",
            )  # fmt: skip
        if self.clearcoat_normal_map is not None and self.clearcoat_flat:
            raise refuse(
                "does not count beside clearcoat_normal_map", got=True, path=("clearcoat_flat",), allowed="false"
            )
        return self

    @model_validator(mode="after")
    def _check_bend(self) -> Self:
        if self.transmission == 0:
            return self
        if self.index < 1 + LEAST_BEND:
            raise refuse(
                "bends light too little for transmission", got=self.index, path=("index",),
                allowed=f"at least {1 + LEAST_BEND:g} beside transmission",
            )  # fmt: skip
        if self.index > MOST_BEND:
            raise refuse(
                "is out of range", got=self.index, path=("index",), allowed=f"at most {MOST_BEND:g} beside transmission"
            )
        return self


class Matte(BumpyMaterial):
    """A surface that scatters light evenly (Lambert), or of facets that do (Oren and Nayar)."""

    kind: Literal["matte"]
    """Kind of material."""

    reflectance: Reflectance
    """Share of light reflected: a colour of channels 0 to 1, or a texture."""

    sigma_degrees: Annotated[float, Field(ge=0, le=90), quantities.NUMBER] = 0.0
    """Standard deviation of the angles of facets (Oren and Nayar): plaster, clay and the moon have some 20 to 40."""

    @property
    def parameter(self) -> float:
        """The number of its own that the kernels read: the variance of the angles [rad²]."""
        return math.radians(self.sigma_degrees) ** 2


class Translucent(BumpyMaterial):
    """A thin sheet that scatters light evenly to both sides: a leaf, paper, a lampshade."""

    kind: Literal["translucent"]
    """Kind of material."""

    reflectance: Reflectance = (0.25, 0.25, 0.25)
    """Share of light scattered back: a colour of channels 0 to 1, or a texture."""

    transmittance: Reflectance = (0.25, 0.25, 0.25)
    """Share of light scattered to the other side: a colour, or a texture; with `reflectance` at most 1."""

    @model_validator(mode="after")
    def _check_sum(self) -> Self:
        if isinstance(self.reflectance, tuple) and isinstance(self.transmittance, tuple):
            most = max(a + b for a, b in zip(self.reflectance, self.transmittance, strict=True))
            if most > 1 + 1e-6:
                raise refuse(
                    "gives back more light than arrives, with reflectance", got=most, allowed="at most 1",
                    path=("transmittance",),
                )  # fmt: skip
        return self


class Measured(FileReference, BumpyMaterial):
    """A surface whose reflection was measured: a table of MERL (`.binary`) or of RGL (`.bsdf`)."""

    kind: Literal["measured"]
    """Kind of material."""


class Mirror(CoveringMaterial):
    """A perfectly smooth reflector."""

    kind: Literal["mirror"]
    """Kind of material."""

    reflectance: quantities.Albedo = (1.0, 1.0, 1.0)
    """Share of light reflected; a colour of channels 0 to 1."""


class Plastic(RoughMaterial, BumpyMaterial):
    """A matte base under a clear dielectric cover; the cover is smooth without `alpha` and `roughness`."""

    kind: Literal["plastic"]
    """Kind of material."""

    reflectance: Reflectance
    """Share of light that the base reflects: a colour of channels 0 to 1, or a texture."""

    index: Annotated[float, Field(ge=1, le=5), quantities.NUMBER] = 1.5
    """Refractive index of the cover."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (_ROUGHNESS,)


# Absorption [per radius] of the pigments of hair, of concentration 1 (d'Eon et al. 2011).
_EUMELANIN, _PHEOMELANIN = (0.419, 0.697, 1.37), (0.187, 0.4, 1.05)


def _hair_depth(azimuthal: float) -> float:
    """Return the logarithm of the colour of hair over the root of its absorption (Chiang et al. 2016, 4.2)."""
    b = azimuthal
    return 5.969 + b * (-0.215 + b * (2.532 + b * (-10.73 + b * (5.574 + b * 0.245))))


class Hair(SceneModel):
    """A fibre of hair: light is reflected, passes it, and is reflected in it (Chiang et al. 2016); of curves only."""

    kind: Literal["hair"]
    """Kind of material."""

    reflectance: Reflectance | None = None
    """Colour of much hair in even light, by which its absorption is chosen: channels 0 to 1, or a texture."""

    absorption: quantities.Coefficient | None = None
    """Absorption coefficient times the radius of the fibre, in place of `reflectance`; a colour."""

    eumelanin: Annotated[float, Field(ge=0, le=100), quantities.NUMBER] | None = None
    """Concentration of brown pigment, in place of `reflectance`: blond some 0.3, brown 1.3, black 8."""

    pheomelanin: Annotated[float, Field(ge=0, le=100), quantities.NUMBER] = 0.0
    """Concentration of red pigment, beside `eumelanin`."""

    index: Annotated[float, Field(ge=1.01, le=3), quantities.NUMBER] = 1.55
    """Refractive index of the fibre."""

    roughness: Annotated[float, Field(ge=0.01, le=1), quantities.NUMBER] = 0.3
    """Roughness along the fibre."""

    roughness_across: Annotated[float, Field(ge=0.01, le=1), quantities.NUMBER] = 0.3
    """Roughness round the fibre."""

    tilt_degrees: Annotated[float, Field(ge=-10, le=10), quantities.NUMBER] = 2.0
    """By how much the scales of the cuticle stand off, towards the root."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("reflectance", "absorption", "eumelanin"), required=True),
    )

    @model_validator(mode="after")
    def _check_pigment(self) -> Self:
        if self.pheomelanin > 0 and self.eumelanin is None:
            raise refuse("needs eumelanin", got=self.pheomelanin, allowed="eumelanin beside it", path=("pheomelanin",))
        return self

    @property
    def color(self) -> quantities.Colour | Any:
        """Its reflectance; that which stands for its absorption where that is given."""
        if self.reflectance is not None:
            return self.reflectance
        absorption = self.absorption
        if self.eumelanin is not None:
            pairs = zip(_EUMELANIN, _PHEOMELANIN, strict=True)
            red, green, blue = (self.eumelanin * brown + self.pheomelanin * ruddy for brown, ruddy in pairs)
            absorption = (red, green, blue)
        depth = _hair_depth(self.roughness_across)
        assert absorption is not None
        red, green, blue = (math.exp(-math.sqrt(share) * depth) for share in absorption)
        if isinstance(absorption, quantities.SpectralColour):
            return quantities.SpectralColour((red, green, blue), np.exp(-np.sqrt(absorption.samples) * depth))
        return (red, green, blue)

    @property
    def lobes(self) -> tuple[float, float, float, float]:
        """Variance along the fibre, scale round it, sine of the tilt, and what `_hair_depth` returns."""
        m, n = self.roughness, self.roughness_across
        variance = (0.726 * m + 0.812 * m**2 + 3.7 * m**20) ** 2
        scale = math.sqrt(math.pi / 8) * (0.265 * n + 1.194 * n**2 + 5.372 * n**22)
        return variance, scale, math.sin(math.radians(self.tilt_degrees)), _hair_depth(n)


class Boundary(SceneModel):
    """The boundary of a medium without a surface of its own: light passes it as if nothing were there."""

    kind: Literal["boundary"]
    """Kind of material."""

    interior: ScatteringMedium
    """What is behind it, in a closed shape."""

    @model_validator(mode="after")
    def _check_interior(self) -> Boundary:
        refuse_texture(self.interior, ("interior", "color"))
        return self


class Emissive(SceneModel):
    """A lamp: it emits from the side of the normal and reflects nothing."""

    kind: Literal["emissive"]
    """Kind of material."""

    radiance: Emission
    """Radiance emitted [W/(m² sr) per channel]: a colour or a texture."""

    two_sided: bool = Field(default=False, strict=True)
    """Whether the back emits too."""

    @property
    def parameter(self) -> float:
        """The number of its own that the kernels read: 1 where the back emits."""
        return float(self.two_sided)


_Alone = Matte | Translucent | Mirror | Conductor | Dielectric | Plastic | ThinGlass | Principled
Leaf = Annotated[_Alone | Hair | Measured, Field(discriminator="kind")]


class Mix(CoveringMaterial):
    """Two materials beside each other, finer than can be seen: each vertex of a path is of one of them."""

    kind: Literal["mix"]
    """Kind of material."""

    materials: Annotated[tuple[Leaf, Leaf], BeforeValidator(quantities.list_of(2, "two materials"))]
    """The two: names of `materials`, or materials written out; not emissive, not mixed themselves."""

    factor: Share = 0.5
    """Share of the second: a number, or a texture."""

    @model_validator(mode="after")
    def _check_holes(self) -> Self:
        for index, part in enumerate(self.materials):
            if has_holes(part):
                raise refuse(
                    "does not count inside a mix", got=getattr(part, "opacity", 1.0),
                    allowed="the opacity of the mix itself", path=("materials", index, "opacity"),
                )  # fmt: skip
        return self


Material = Annotated[_Alone | Mix | Emissive | Boundary | Hair | Measured, Field(discriminator="kind")]

_GREY = Matte.model_construct(kind="matte", reflectance=(0.5, 0.5, 0.5))


def _find_material(name: str, materials: Mapping[str, Any], path: tuple[str | int, ...]) -> Any:
    if name not in materials:
        without = "a material mapping, or a name once `materials` defines one"
        raise unknown_name("names no material", name, materials, without=without, path=path)
    return materials[name]


def with_parts(material: Any, materials: Mapping[str, Any] | None, path: tuple[str | int, ...]) -> Any:
    """Return a material's mapping with the names in a mix replaced by what they name.

    Parameters
    ----------
    material
        What stands for a material, unchecked.
    materials
        The scene's materials; None where they have errors of their own, which are reported.
    path
        Keys that lead to the material, for errors.
    """
    if not isinstance(material, dict) or material.get("kind") != "mix":
        return material
    parts = material.get("materials")
    if not isinstance(parts, (list, tuple)):
        return material
    resolved = [
        part if not isinstance(part, str) else _GREY if materials is None
        else _find_material(part, materials, (*path, "materials", index))
        for index, part in enumerate(parts)
    ]  # fmt: skip
    return material | {"materials": resolved}


def with_material(item: Any, index: int, materials: Mapping[str, Any] | None) -> Any:
    """Return an object's mapping with the name of its material, or those in it, replaced by the materials."""
    if not isinstance(item, dict) or "material" not in item:
        return item
    path = (index, "material")
    name = item["material"]
    if not isinstance(name, str):
        return item | {"material": with_parts(name, materials, path)}
    # Where the materials have errors, the object's other keys still count.
    return item | {"material": _GREY if materials is None else _find_material(name, materials, path)}
