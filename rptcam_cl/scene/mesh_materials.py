"""Materials of mesh files as materials of the scene."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rptcam_cl.assets.meshes import FileMaterial, FileTexture
from rptcam_cl.assets.pictures import has_alpha
from rptcam_cl.core.errors import InputError, MissingFileError
from rptcam_cl.core.references import Folders
from rptcam_cl.scene.dielectric import LEAST_BEND, Attenuation, Dielectric, ThinGlass
from rptcam_cl.scene.file_reference import one_pixel
from rptcam_cl.scene.material import MOST_BEND, MOST_INDEX, Emissive, Material, Matte, Mix, Principled
from rptcam_cl.scene.material_parts import SMALLEST_ALPHA, AnisotropyMap, NormalMap
from rptcam_cl.scene.quantities import LARGEST_GAIN, LARGEST_RADIANCE, Colour
from rptcam_cl.scene.texture import ImageTexture

# Below this a number is 0; what float32 cannot hold the scene refuses.
SMALLEST = 1e-30
ALONG_U = FileTexture(one_pixel(255, 128, 255), "brushed along u")


def material_of(given: FileMaterial, folders: Folders, absent: list[str] | None = None) -> Material:
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
        self._given = given
        self._folders = folders
        self._cover = self._covering()
        self._normals: dict[str, Any] = {"normal_map": self._normal_map(given.normals, given.normals_strength)}

    def material(self) -> Material:
        """Return the material."""
        given = self._given
        emits = max(given.emission) > 0
        black = max(given.base_color) == 0 and given.metallic == 0
        if emits and black and given.matte and given.emission_texture is None:
            radiance = _within(given.emission, LARGEST_RADIANCE)
            return Emissive(kind="emissive", radiance=radiance, two_sided=given.both_sides)
        if given.matte and not emits:
            return Matte(kind="matte", reflectance=self._base(), **self._normals, **self._cover)
        if given.transmission == 0 or given.solid:
            return self._solid()
        return self._pane()

    def _solid(self) -> Dielectric | Principled:
        given = self._given
        pictures = given.base_texture or given.transmission_texture
        clear = given.transmission == 1 and min(given.base_color) == 1 and pictures is None
        plain = given.roughness == given.metallic == given.clearcoat == max(*given.emission, *given.sheen) == 0
        if clear and plain:
            return Dielectric(
                kind="dielectric",
                index=_clipped(given.index, 0.2, 5),
                **self._absorption(),
                **self._normals,
                **self._cover,
            )
        return self._principled(given.transmission, self._cover)

    def _pane(self) -> Material:
        """Return a pane without thickness, beside what is not transparent."""
        given = self._given
        glass = {"index": _clipped(given.index, 0.2, 5), "transmittance": _within(given.base_color, 1.0)}
        share = self._share(given.transmission * (1 - given.metallic), given.transmission_texture, "r")
        if share == 1:
            return ThinGlass(kind="thin_glass", **glass, **self._cover)
        parts = (self._principled(0.0, {}), ThinGlass(kind="thin_glass", **glass))
        return Mix(kind="mix", materials=parts, factor=share, **self._cover)

    def _principled(self, transmission: float, cover: dict[str, Any]) -> Principled:
        given = self._given
        gloss: dict[str, Any] = {"specular": 0.0, "roughness": 1.0} if given.matte else {
            "specular": self._specular(),
            "metallic": self._share(given.metallic, given.metallic_texture, "b"),
            "roughness": self._share(given.roughness, given.roughness_texture, "g"),
            "anisotropy_rotation_degrees": given.anisotropy_rotation_degrees,
            "clearcoat": self._share(given.clearcoat, given.clearcoat_texture, "r"),
            "clearcoat_roughness": self._share(given.clearcoat_roughness, given.clearcoat_roughness_texture, "g"),
            "sheen": self._colour(given.sheen, given.sheen_texture),
            "sheen_roughness": given.sheen_roughness,
            **self._stretch(),
            **self._coat_normals(),
        }  # fmt: skip
        return Principled(
            kind="principled",
            base_color=self._base(),
            **self._reflectance(transmission),
            transmission=self._share(transmission, given.transmission_texture, "r"),
            emission=self._emission(),
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

    def _specular(self) -> float | ImageTexture:
        file_texture = self._given.specular_texture
        painted = file_texture is not None and has_alpha(self._source(file_texture))
        return self._share(self._given.specular, file_texture if painted else None, "a")

    def _reflectance(self, transmission: float) -> dict[str, Any]:
        """Return index and colour of the reflectance head on; the index takes what of the colour exceeds 1."""
        given = self._given
        low, high = (1 + LEAST_BEND, MOST_BEND) if transmission else (1.0, MOST_INDEX)
        index = _clipped(given.index, low, high)
        color, normal = given.specular_color, _at_normal(index)
        if not transmission and max(color) > 1 and normal > 0:
            color = _within(color, _at_normal(MOST_INDEX) / normal)
            root = math.sqrt(max(color) * normal)
            index = (1 + root) / (1 - root)
            color = _scaled(color, 1 / max(color))
        return {"index": index, "specular_color": self._colour(color, given.specular_color_texture)}

    def _stretch(self) -> dict[str, Any]:
        """Return what stretches highlights as KHR_materials_anisotropy says: numbers, or a picture where one varies."""
        given = self._given
        strength = _clipped(given.anisotropy, 0.0, 1.0)
        if strength == 0:
            return {}
        if given.anisotropy_texture is None and given.roughness_texture is None:
            return _stretched(given.roughness, strength)
        directions = given.anisotropy_texture or ALONG_U
        found = AnisotropyMap(**self._laid(directions), strength=strength)
        self._fill(found, directions)
        return {"anisotropy_map": found}

    def _base(self) -> Colour | ImageTexture:
        return self._colour(self._given.base_color, self._given.base_texture)

    def _colour(self, factor: Colour, file_texture: FileTexture | None) -> Colour | ImageTexture:
        factor = _within(factor, 1.0)
        return factor if file_texture is None or max(factor) == 0 else self._texture(file_texture, gain=factor)

    def _emission(self) -> Colour | ImageTexture:
        given = self._given
        if given.emission_texture is None or max(given.emission) == 0:
            return _within(given.emission, LARGEST_RADIANCE)
        return self._texture(given.emission_texture, gain=_within(given.emission, LARGEST_GAIN))

    def _share(self, factor: float, file_texture: FileTexture | None, channel: str) -> float | ImageTexture:
        factor = _clipped(factor, 0.0, 1.0)
        if file_texture is None or factor == 0:
            return factor
        return self._texture(file_texture, gain=factor, channel=channel)

    def _absorption(self) -> dict[str, Any]:
        if self._given.attenuation is None:
            return {}
        colour, distance = self._given.attenuation
        left = Attenuation(color=_within(colour, 1.0), distance_m=_clipped(distance, 1e-9, 1e9))
        return {"attenuation": left}

    def _covering(self) -> dict[str, Any]:
        given = self._given
        mask: dict[str, Any] = {}
        if given.opacity_cutoff is not None:
            mask = {"opacity_mode": "mask", "opacity_cutoff": _clipped(given.opacity_cutoff, 0.0, 1.0)}
        file_texture = given.opacity_texture
        if file_texture is None:
            return {"opacity": _clipped(given.opacity, 0.0, 1.0), **mask}
        transparent = has_alpha(self._source(file_texture))
        if not transparent and file_texture == given.base_texture:
            return {"opacity": _clipped(given.opacity, 0.0, 1.0), **mask}
        return {"opacity": self._share(given.opacity, file_texture, "a" if transparent else "r"), **mask}

    def _normal_map(self, normals: FileTexture | None, strength: float) -> NormalMap | None:
        if normals is None:
            return None
        found = NormalMap(**self._laid(normals), strength=_clipped(strength, 0.0, 10.0))
        self._fill(found, normals)
        return found

    def _source(self, file_texture: FileTexture) -> Path | bytes:
        if isinstance(file_texture.source, bytes):
            return file_texture.source
        try:
            return self._folders.find(str(file_texture.source))
        except InputError as problem:
            message = f"material {self._given.name!r}: {file_texture.name}: {problem}"
            if self._absent is None or not isinstance(problem, MissingFileError):
                raise type(problem)(message) from None
        if message not in self._absent:
            self._absent.append(message)
        return b""

    def _texture(self, file_texture: FileTexture, **keys: Any) -> ImageTexture:
        found = ImageTexture(kind="image", **self._laid(file_texture), **keys)
        self._fill(found, file_texture)
        return found

    def _laid(self, file_texture: FileTexture) -> dict[str, Any]:
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


def _stretched(roughness: float, strength: float) -> dict[str, float]:
    """Return roughness and anisotropy of ours that have both alphas of KHR_materials_anisotropy.

    Those are alpha across, and alpha + (1 - alpha) strength² along; ours are the mean alpha divided and multiplied by
    the root of their ratio, which is 1 - 0.9 anisotropy and so 0.1 or more.
    """
    across = max(roughness**2, SMALLEST_ALPHA)
    along = across + (1 - across) * strength**2
    return {"roughness": (across * along) ** 0.25, "anisotropy": min(1.0, (1 - across / along) / 0.9)}


def _clipped(value: float, low: float, high: float) -> float:
    clipped = min(high, max(low, value))
    return clipped if abs(clipped) > SMALLEST else 0.0


def _at_normal(index: float) -> float:
    """Return what a dielectric reflects at normal incidence."""
    return ((index - 1) / (index + 1)) ** 2


def _scaled(colour: Colour, factor: float) -> Colour:
    red, green, blue = (value * factor for value in colour)
    return (red, green, blue)


def _within(colour: Colour, high: float) -> Colour:
    red, green, blue = (_clipped(value, 0.0, high) for value in colour)
    return (red, green, blue)
