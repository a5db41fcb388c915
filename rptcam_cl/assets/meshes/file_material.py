"""Materials and textures as mesh files describe them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from rptcam_cl.core.dataclass import dataclass

Colour = tuple[float, float, float]
Wrap = Literal["repeat", "clamp", "mirror"]


@dataclass(frozen=True)
class FileTexture:
    """A picture and how it lies on the surface: at scale * (u, v), turned, then shifted.

    Attributes
    ----------
    source : Path or bytes
        Path of the picture as the file has it, not checked, or its content.
    name : str
        For the reader.
    scale, offset : (u, v)
        v counts upwards from the lower edge.
    rotation_degrees : float
        From u towards v.
    wrap : str
        What continues the picture.
    nearest : bool
        Whether texels are shown as squares.
    """

    source: Path | bytes
    name: str
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    rotation_degrees: float = 0.0
    wrap: Wrap = "repeat"
    nearest: bool = False


@dataclass(frozen=True)
class FileMaterial:
    """A material of a mesh file. Where a number or colour has a painting, it is a factor on that.

    Attributes
    ----------
    base_color : (red, green, blue)
        Linear, 0 to 1.
    matte : bool
        Whether it reflects evenly, without a gloss; metallic and roughness do not count then.
    metallic, roughness : float
        0 to 1; the paintings are read in the channels b and g.
    specular : float
        Factor on the reflectance of the dielectric; the painting is read in its alpha channel.
    specular_color : (red, green, blue)
        Of that reflectance at normal incidence, linear, 0 or more.
    opacity : float
        0 to 1; the painting is read in its alpha channel, or in r when it has none.
    opacity_cutoff : float or None
        Opacity from which on the surface is there; None where it is there by that share.
    normals : FileTexture or None
        Normals in the tangent frame.
    emission : (red, green, blue)
        Radiance, linear.
    both_sides : bool
        Whether the back emits too.
    index : float
        Refractive index, 1 to infinity.
    transmission : float
        Share of the base that is transparent; the painting is read in the channel r.
    solid : bool
        Whether what is transparent is a solid that refracts, and not a pane without thickness.
    attenuation : (colour, distance) or None
        What a transparent solid leaves of white light after a distance [m].
    clearcoat, clearcoat_roughness : float
        0 to 1; the paintings are read in the channels r and g.
    clearcoat_normals : FileTexture or None
        Normals of the coat in the tangent frame.
    clearcoat_flat : bool
        Whether a coat without them does not follow `normals`.
    sheen : (red, green, blue)
        Of fibres at grazing angles, linear, 0 to 1.
    anisotropy : float
        Strength s of the stretch of highlights along u, 0 to 1: alpha along is alpha + (1 - alpha) s²; the painting has
        directions in r and g, along u and v, and strengths in b.
    anisotropy_rotation_degrees : float
        Of those directions, from u towards v.
    """

    name: str = ""
    base_color: Colour = (0.8, 0.8, 0.8)
    base_texture: FileTexture | None = None
    matte: bool = False
    metallic: float = 0.0
    metallic_texture: FileTexture | None = None
    roughness: float = 0.5
    roughness_texture: FileTexture | None = None
    specular: float = 1.0
    specular_texture: FileTexture | None = None
    specular_color: Colour = (1.0, 1.0, 1.0)
    specular_color_texture: FileTexture | None = None
    opacity: float = 1.0
    opacity_texture: FileTexture | None = None
    opacity_cutoff: float | None = None
    normals: FileTexture | None = None
    normals_strength: float = 1.0
    emission: Colour = (0.0, 0.0, 0.0)
    emission_texture: FileTexture | None = None
    both_sides: bool = False
    index: float = 1.5
    transmission: float = 0.0
    transmission_texture: FileTexture | None = None
    solid: bool = False
    attenuation: tuple[Colour, float] | None = None
    clearcoat: float = 0.0
    clearcoat_texture: FileTexture | None = None
    clearcoat_roughness: float = 0.0
    clearcoat_roughness_texture: FileTexture | None = None
    clearcoat_normals: FileTexture | None = None
    clearcoat_normals_strength: float = 1.0
    clearcoat_flat: bool = False
    sheen: Colour = (0.0, 0.0, 0.0)
    sheen_texture: FileTexture | None = None
    sheen_roughness: float = 0.0
    anisotropy: float = 0.0
    anisotropy_texture: FileTexture | None = None
    anisotropy_rotation_degrees: float = 0.0

    @property
    def has_textures(self) -> bool:
        """Whether any picture lies on the surface."""
        return self != self.without_textures()

    def without_textures(self) -> FileMaterial:
        """Return the material of a surface that has no texture coordinates."""
        return replace(
            self, base_texture=None, metallic_texture=None, roughness_texture=None, opacity_texture=None,
            normals=None, emission_texture=None, transmission_texture=None, clearcoat_texture=None,
            clearcoat_roughness_texture=None, sheen_texture=None, anisotropy_texture=None,
            specular_texture=None, specular_color_texture=None, clearcoat_normals=None,
        )  # fmt: skip
