"""What mesh files say of materials, in one form for all formats, and the material of the scene that shows it."""

from __future__ import annotations

import math
import warnings
from dataclasses import fields, replace
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError

from rptcam_cl.core.colour import LUMINANCE
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, MissingFileError, OutsideFolderError
from rptcam_cl.core.files import Folders, name_errors
from rptcam_cl.scene import materials
from rptcam_cl.scene.assets.pictures import has_alpha, read_picture
from rptcam_cl.scene.base import GREY, one_pixel
from rptcam_cl.scene.media import MOST_ASYMMETRY, AbsorbingMaterial, Attenuation, ScatteringMedium, albedo_for
from rptcam_cl.scene.quantities import LARGEST_GAIN, LARGEST_RADIANCE, Colour
from rptcam_cl.scene.textures import AnisotropyMap, Bump, ImageTexture, NormalMap

# Materials and textures as mesh files describe them.

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
    luminance : bool
        Whether a number is the luminance of what the picture stores, and not one of its channels.
    """

    source: Path | bytes
    name: str
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    rotation_degrees: float = 0.0
    wrap: Wrap = "repeat"
    nearest: bool = False
    luminance: bool = False


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
    bumps : FileTexture or None
        Heights in place of normals, or a picture of normals that a file calls heights.
    bumps_height : float
        Of a white texel over a black one [texels].
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
    scattering : (colour, asymmetry) or None
        Colour of a deep body of what is in such a solid, linear, 0 to 1, and the mean cosine of scattering. What
        attenuation takes away on straight ways is then scattered in part.
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
    film : (share, index, thickness) or None
        Of a thin film on the surface [1, 1, nm].
    gloss_texture : FileTexture or None
        Its alpha channel is a factor on 1 - roughness, in place of the painting of roughness.
    translucency : float
        Share of the surface that is a thin sheet which passes light evenly to its other side; the painting is read in
        its alpha channel.
    translucency_color : (red, green, blue)
        Of the light that passes, linear, 0 to 1.
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
    bumps: FileTexture | None = None
    bumps_height: float = 1.0
    normals_strength: float = 1.0
    emission: Colour = (0.0, 0.0, 0.0)
    emission_texture: FileTexture | None = None
    both_sides: bool = False
    index: float = 1.5
    transmission: float = 0.0
    transmission_texture: FileTexture | None = None
    solid: bool = False
    attenuation: tuple[Colour, float] | None = None
    scattering: tuple[Colour, float] | None = None
    scattering_texture: FileTexture | None = None
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
    film: tuple[float, float, float] | None = None
    gloss_texture: FileTexture | None = None
    translucency: float = 0.0
    translucency_texture: FileTexture | None = None
    translucency_color: Colour = (1.0, 1.0, 1.0)
    translucency_color_texture: FileTexture | None = None

    @property
    def has_textures(self) -> bool:
        """Whether any picture lies on the surface."""
        return self is not self.without_textures()

    def without_textures(self) -> FileMaterial:
        """Return the material of a surface that has no texture coordinates."""
        names = [each.name for each in fields(self) if isinstance(getattr(self, each.name), FileTexture)]
        nothing: dict[str, Any] = dict.fromkeys(names)
        return replace(self, **nothing) if names else self


# Materials of mesh files as materials of the scene.

# Below this a number is 0; what float32 cannot hold the scene refuses.
_SMALLEST = 1e-30
_ALONG_U = FileTexture(one_pixel(255, 128, 255), "brushed along u")


def material_of(given: FileMaterial, folders: Folders, absent: list[str] | None = None) -> materials.Material:
    """Return the material that shows what a file says about a surface.

    Parameters
    ----------
    absent
        Takes what there is to say of missing pictures, which grey stands for then.

    Raises
    ------
    InputError
        When a picture is missing, or lies where the scene may not read.
    """
    try:
        return _Translation(given, folders, absent).material()
    except ValidationError as problem:
        reason = problem.errors(include_url=False)[0]
        raise InputError(
            f"material {given.name!r} cannot be shown: {'.'.join(map(str, reason['loc']))} {reason['msg']}"
        ) from None


class _Translation:
    """What a file says about a surface, on the way to a material of the scene."""

    def __init__(self, given: FileMaterial, folders: Folders, absent: list[str] | None) -> None:
        self._absent = absent
        if given.film is not None and given.transmission > 0:
            what = f"material {given.name!r}: its thin film is left out, beside transmission"
            warnings.warn(what, UserWarning, stacklevel=3)
            given = replace(given, film=None)
        self._given = given
        self._folders = folders
        self._cover = self._covering()
        self._normals: dict[str, Any] = {"normal_map": self._normal_map(given.normals, given.normals_strength)}
        if given.normals is None and given.bumps is not None and given.bumps_height != 0:
            self._normals = self._unevenness(given.bumps, given.bumps_height)

    def material(self) -> materials.Material:
        """Return the material."""
        given = self._given
        emits = max(given.emission) > 0
        black = max(given.base_color) == 0 and given.metallic == 0
        if emits and black and given.matte and given.emission_texture is None:
            radiance = _clip_colour(given.emission, LARGEST_RADIANCE)
            return materials.Emissive(kind="emissive", radiance=radiance, two_sided=given.both_sides)
        if given.matte and not emits:
            return materials.Matte(kind="matte", reflectance=self._base(), **self._normals, **self._cover)
        if given.translucency > 0 and not given.matte:
            return self._sheet()
        if given.transmission == 0 or given.solid:
            return self._solid()
        return self._pane()

    def _solid(self) -> materials.Dielectric | materials.Principled:
        given = self._given
        pictures = given.base_texture or given.transmission_texture
        clear = given.transmission == 1 and min(given.base_color) == 1 and pictures is None
        plain = given.roughness == given.metallic == given.clearcoat == max(*given.emission, *given.sheen) == 0
        if clear and plain:
            return materials.Dielectric(
                kind="dielectric",
                index=_clip(given.index, materials.SMALLEST_INDEX, materials.LARGEST_INDEX),
                **self._absorption(),
                **self._normals,
                **self._cover,
            )
        return self._principled(given.transmission, self._cover)

    def _pane(self) -> materials.Material:
        """Return a pane without thickness, beside what is not transparent."""
        given = self._given
        glass = {
            "index": _clip(given.index, materials.SMALLEST_INDEX, materials.LARGEST_INDEX),
            "transmittance": _clip_colour(given.base_color, 1.0),
        }
        share = self._share(given.transmission * (1 - given.metallic), given.transmission_texture, "r")
        if share == 1:
            return materials.ThinGlass(kind="thin_glass", **glass, **self._cover)
        parts = (self._principled(0.0, {}), materials.ThinGlass(kind="thin_glass", **glass))
        return materials.Mix(kind="mix", materials=parts, factor=share, **self._cover)

    def _sheet(self) -> materials.Material:
        """Return a thin sheet that passes light evenly, beside what does not pass."""
        given = self._given
        share = self._share(given.translucency, self._with_alpha(given.translucency_texture), "a")
        color = self._colour(given.translucency_color, given.translucency_color_texture)
        keys: dict[str, Any] = {"kind": "translucent", "reflectance": (0.0, 0.0, 0.0), "transmittance": color}
        if share == 1:
            return materials.Translucent(**keys, **self._normals, **self._cover)
        parts = (self._principled(0.0, {}), materials.Translucent(**keys, **self._normals))
        return materials.Mix(kind="mix", materials=parts, factor=share, **self._cover)

    def _principled(self, transmission: float, cover: dict[str, Any]) -> materials.Principled:
        given = self._given
        plain = self._without_film(transmission, cover)
        return plain if given.film is None or given.matte else self._filmed(plain)

    def _filmed(self, plain: materials.Principled) -> materials.Principled:
        """Return a material with its thin film; without it, with a warning, where that cannot lie on it."""
        assert self._given.film is not None
        share, index, thickness = self._given.film
        if not plain.takes_film:
            what = f"material {self._given.name!r}: its thin film is left out, beside textures of what reflects"
            warnings.warn(what, UserWarning, stacklevel=2)
            return plain
        film = materials.ThinFilm(
            share=share, index=_clip(index, 1.0, 5.0), thickness_nm=_clip(thickness, 0.0, 20_000.0)
        )
        return plain.model_copy(update={"thin_film": film})

    def _without_film(self, transmission: float, cover: dict[str, Any]) -> materials.Principled:
        given = self._given
        gloss: dict[str, Any] = {"specular": 0.0, "roughness": 1.0} if given.matte else {
            "specular": self._specular(),
            "metallic": self._share(given.metallic, given.metallic_texture, "b"),
            "roughness": self._roughness(),
            "anisotropy_rotation_degrees": given.anisotropy_rotation_degrees,
            "clearcoat": self._share(given.clearcoat, given.clearcoat_texture, "r"),
            "clearcoat_roughness": self._share(given.clearcoat_roughness, given.clearcoat_roughness_texture, "g"),
            "sheen": self._colour(given.sheen, given.sheen_texture),
            "sheen_roughness": given.sheen_roughness,
            **self._stretch(),
            **self._coat_normals(),
        }  # fmt: skip
        return materials.Principled(
            kind="principled",
            base_color=self._base(),
            **self._reflectance(transmission),
            transmission=self._share(transmission, given.transmission_texture, "r"),
            emission=self._emission(),
            two_sided=given.both_sides and max(given.emission) > 0,
            **gloss,
            **(self._absorption() if transmission else {}),
            **self._normals,
            **cover,
        )

    def _coat_normals(self) -> dict[str, Any]:
        given = self._given
        if given.clearcoat == 0:
            return {}
        if given.clearcoat_normals is None:
            return {"clearcoat_flat": given.clearcoat_flat and given.normals is not None}
        return {"clearcoat_normal_map": self._normal_map(given.clearcoat_normals, given.clearcoat_normals_strength)}

    def _roughness(self) -> float | ImageTexture:
        """The roughness; where glossiness is painted, a picture of what that leaves of 1."""
        given, gloss = self._given, self._with_alpha(self._given.gloss_texture)
        if gloss is None:
            return self._share(given.roughness, given.roughness_texture, "g")
        with name_errors(f"material {given.name!r}: {gloss.name}"):
            alpha = read_picture(self._source(gloss)).texels[..., 3]
        share = alpha / np.float32(255) if alpha.dtype == np.uint8 else alpha
        stream = BytesIO()
        np.save(stream, np.rint(255 * (1 - (1 - given.roughness) * share)).astype(np.uint8))
        return self._texture(replace(gloss, source=stream.getvalue(), name=f"roughness of {gloss.name}"), channel="r")

    def _specular(self) -> float | ImageTexture:
        return self._share(self._given.specular, self._with_alpha(self._given.specular_texture), "a")

    def _with_alpha(self, file_texture: FileTexture | None) -> FileTexture | None:
        """Return a picture that has an alpha channel, None for one without, where it is 1."""
        return file_texture if file_texture is not None and has_alpha(self._source(file_texture)) else None

    def _reflectance(self, transmission: float) -> dict[str, Any]:
        """Return index and colour of the reflectance head on; the index takes what of the colour exceeds 1."""
        given = self._given
        low, high = (1 + materials.LEAST_BEND, materials.MOST_BEND) if transmission else (1.0, materials.MOST_INDEX)
        index = _clip(given.index, low, high)
        color, normal = given.specular_color, _at_normal(index)
        if not transmission and max(color) > 1 and normal > 0:
            color = _clip_colour(color, _at_normal(materials.MOST_INDEX) / normal)
            root = math.sqrt(max(color) * normal)
            index = (1 + root) / (1 - root)
            color = _scale(color, 1 / max(color))
        return {"index": index, "specular_color": self._colour(color, given.specular_color_texture)}

    def _stretch(self) -> dict[str, Any]:
        """The anisotropy of KHR_materials_anisotropy: as numbers, or as a picture where one varies."""
        given = self._given
        strength = _clip(given.anisotropy, 0.0, 1.0)
        if strength == 0:
            return {}
        if given.anisotropy_texture is None and given.roughness_texture is None:
            return _stretch_keys(given.roughness, strength)
        directions = given.anisotropy_texture or _ALONG_U
        anisotropy_map = AnisotropyMap(**self._texture_keys(directions), strength=strength)
        self._fill(anisotropy_map, directions)
        return {"anisotropy_map": anisotropy_map}

    def _base(self) -> Colour | ImageTexture:
        return self._colour(self._given.base_color, self._given.base_texture)

    def _colour(self, factor: Colour, file_texture: FileTexture | None) -> Colour | ImageTexture:
        factor = _clip_colour(factor, 1.0)
        return factor if file_texture is None or max(factor) == 0 else self._texture(file_texture, gain=factor)

    def _emission(self) -> Colour | ImageTexture:
        given = self._given
        if given.emission_texture is None or max(given.emission) == 0:
            return _clip_colour(given.emission, LARGEST_RADIANCE)
        return self._texture(given.emission_texture, gain=_clip_colour(given.emission, LARGEST_GAIN))

    def _share(self, factor: float, file_texture: FileTexture | None, channel: str) -> float | ImageTexture:
        factor = _clip(factor, 0.0, 1.0)
        if file_texture is None or factor == 0:
            return factor
        if file_texture.luminance and channel != "a":
            file_texture = self._grey(file_texture)
        return self._texture(file_texture, gain=factor, channel=channel)

    def _grey(self, file_texture: FileTexture) -> FileTexture:
        """Return a picture of the luminance of one that is coloured; one that is grey, or missing, as it is."""
        with name_errors(f"material {self._given.name!r}: {file_texture.name}"):
            texels = read_picture(self._source(file_texture) or GREY).texels[..., :3]
        if not np.ptp(texels, axis=-1).any():
            return file_texture
        grey, stream = texels @ np.asarray(LUMINANCE, np.float32), BytesIO()
        np.save(stream, np.rint(grey).astype(np.uint8) if texels.dtype == np.uint8 else grey.astype(np.float32))
        return replace(file_texture, source=stream.getvalue(), name=f"luminance of {file_texture.name}")

    def _absorption(self) -> dict[str, Any]:
        if self._given.attenuation is None:
            return {}
        colour, distance = self._given.attenuation
        left = Attenuation(color=_clip_colour(colour, 1.0), distance_m=_clip(distance, 1e-9, 1e9))
        if self._given.scattering is not None:
            return {"interior": self._interior(left, *self._given.scattering)}
        return {"attenuation": left}

    def _interior(self, left: Attenuation, deep: Colour, asymmetry: float) -> ScatteringMedium:
        """Return a medium of the extinction that attenuation says and the colour of a deep body of it."""
        asymmetry = _clip(asymmetry, -MOST_ASYMMETRY, MOST_ASYMMETRY)
        extinction = AbsorbingMaterial(attenuation=left).absorption
        shares = [albedo_for(channel) for channel in deep]
        # of all scattering, that which is left were it even is what a colour says
        ways = [(1 - asymmetry * (1 - a)) / (1 - asymmetry) for a in shares]
        free_path_mm = [
            _clip(1e3 * way / max(rate, 1e-9), 1e-6, 1e9) for way, rate in zip(ways, extinction, strict=True)
        ]
        color = self._colour(deep, self._given.scattering_texture)
        return ScatteringMedium(color=color, free_path_mm=free_path_mm, asymmetry=asymmetry)

    def _covering(self) -> dict[str, Any]:
        given = self._given
        mask: dict[str, Any] = {}
        if given.opacity_cutoff is not None:
            mask = {"opacity_mode": "mask", "opacity_cutoff": _clip(given.opacity_cutoff, 0.0, 1.0)}
        file_texture = given.opacity_texture
        if file_texture is None:
            return {"opacity": _clip(given.opacity, 0.0, 1.0), **mask}
        transparent = has_alpha(self._source(file_texture))
        if not transparent and replace(file_texture, luminance=False) == given.base_texture:
            return {"opacity": _clip(given.opacity, 0.0, 1.0), **mask}
        return {"opacity": self._share(given.opacity, file_texture, "a" if transparent else "r"), **mask}

    def _normal_map(self, normals: FileTexture | None, strength: float) -> NormalMap | None:
        if normals is None:
            return None
        normal_map = NormalMap(**self._texture_keys(normals), strength=_clip(strength, 0.0, 10.0))
        self._fill(normal_map, normals)
        return normal_map

    def _unevenness(self, bumps: FileTexture, height: float) -> dict[str, Any]:
        """Return the key for heights of MTL, or for normals, as many files have under that name.

        MTL has no unit of heights. That of programs that make normals of heights is taken: one texel.
        """
        try:
            source = self._source(bumps)
        except MissingFileError as problem:
            warnings.warn(f"{problem}; the surface stays smooth", UserWarning, stacklevel=2)
            return {}
        with name_errors(f"material {self._given.name!r}: {bumps.name}"):
            texels = read_picture(source or GREY).texels
        red, green, blue = texels[..., :3].mean(axis=(0, 1)) / (255 if texels.dtype == np.uint8 else 1)
        if blue > 0.7 and max(red, green) < 0.65:
            return {"normal_map": self._normal_map(bumps, abs(height))}
        rows, columns = texels.shape[:2]
        per_unit = (columns * abs(bumps.scale[0]) + rows * abs(bumps.scale[1])) / 2
        texture = self._texture(bumps, color_space="linear")
        return {"bump": Bump(texture=texture, height=height / max(per_unit, 1.0), lengths="unit")}

    def _source(self, file_texture: FileTexture) -> Path | bytes:
        if isinstance(file_texture.source, bytes):
            return file_texture.source
        try:
            return self._folders.find(str(file_texture.source))
        except InputError as problem:
            message = f"material {self._given.name!r}: {file_texture.name}: {problem}"
            if self._absent is None or not isinstance(problem, MissingFileError | OutsideFolderError):
                raise type(problem)(message) from None
        if message not in self._absent:
            self._absent.append(message)
        return b""

    def _texture(self, file_texture: FileTexture, **keys: Any) -> ImageTexture:
        texture = ImageTexture(kind="image", **self._texture_keys(file_texture), **keys)
        self._fill(texture, file_texture)
        return texture

    def _texture_keys(self, file_texture: FileTexture) -> dict[str, Any]:
        """Return the keys of a texture that say which picture it is and how it lies."""
        source = self._source(file_texture)
        return {
            "file": file_texture.name if isinstance(source, bytes) else str(source),
            "scale": file_texture.scale,
            "offset": file_texture.offset,
            "rotation_degrees": file_texture.rotation_degrees,
            "wrap": file_texture.wrap,
            "filter": "nearest" if file_texture.nearest else "bilinear",
        }

    def _fill(self, texture: ImageTexture, file_texture: FileTexture) -> None:
        """Give a texture its content, and errors about it their place."""
        texture.locate(f"material {self._given.name!r}: {file_texture.name}: ")
        if isinstance(source := self._source(file_texture), bytes) and (content := source or texture.stand_in):
            texture.hold(content)


def _stretch_keys(roughness: float, strength: float) -> dict[str, float]:
    """Return roughness and anisotropy of ours that have both alphas of KHR_materials_anisotropy.

    Those are alpha across, and alpha + (1 - alpha) strength² along; ours are the mean alpha divided and multiplied by
    the root of their ratio, which is 1 - 0.9 anisotropy and so 0.1 or more.
    """
    across = max(roughness**2, materials.SMALLEST_ALPHA)
    along = across + (1 - across) * strength**2
    return {"roughness": (across * along) ** 0.25, "anisotropy": min(1.0, (1 - across / along) / 0.9)}


def _clip(value: float, low: float, high: float) -> float:
    clipped = min(high, max(low, value))
    return clipped if abs(clipped) > _SMALLEST else 0.0


def _at_normal(index: float) -> float:
    """The reflectance of a dielectric at normal incidence."""
    return ((index - 1) / (index + 1)) ** 2


def _scale(colour: Colour, factor: float) -> Colour:
    red, green, blue = (value * factor for value in colour)
    return (red, green, blue)


def _clip_colour(colour: Colour, high: float) -> Colour:
    red, green, blue = (_clip(value, 0.0, high) for value in colour)
    return (red, green, blue)
