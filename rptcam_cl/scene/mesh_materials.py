"""Materials of mesh files as materials of the scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rptcam_cl.assets.meshes import FileMaterial, FileTexture, has_alpha
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.references import Folders
from rptcam_cl.scene.colours import Colour
from rptcam_cl.scene.dielectric import LEAST_BEND, Attenuation, Dielectric, ThinGlass
from rptcam_cl.scene.material import Emissive, Material, Matte, Mix
from rptcam_cl.scene.material_parts import NormalMap
from rptcam_cl.scene.principled import Principled
from rptcam_cl.scene.quantities import LARGEST_GAIN, LARGEST_RADIANCE
from rptcam_cl.scene.texture import ImageTexture

# Below this a number is 0; what float32 cannot hold the scene refuses.
SMALLEST = 1e-30


def material_of(look: FileMaterial, folders: Folders) -> Material:
    """Return the material that shows what a file says about a surface.

    Raises
    ------
    InputError
        When a picture is missing, or lies where the scene may not read.
    """
    try:
        return _Looked(look, folders).material()
    except ValidationError as problem:
        reason = problem.errors(include_url=False)[0]
        raise InputError(
            f"material {look.name!r} cannot be shown: {'.'.join(map(str, reason['loc']))} {reason['msg']}"
        ) from None


class _Looked:
    """A look on the way to a material."""

    def __init__(self, look: FileMaterial, folders: Folders) -> None:
        self._look = look
        self._folders = folders
        self._cover = self._covering()
        self._bumps = self._cover | {"normal_map": self._normal_map()}

    def material(self) -> Material:
        """Return the material."""
        look = self._look
        emits = max(look.emission) > 0
        black = max(look.base_color) == 0 and look.metallic == 0
        if emits and black and look.matte and look.emission_painting is None:
            radiance = _within(look.emission, LARGEST_RADIANCE)
            return Emissive(kind="emissive", radiance=radiance, two_sided=look.both_sides)
        if look.matte and not emits:
            return Matte(kind="matte", reflectance=self._base(), **self._bumps)
        if look.transmission == 0 or look.solid:
            return self._solid()
        return self._pane()

    def _solid(self) -> Dielectric | Principled:
        look = self._look
        clear = min(look.base_color) == 1 and look.base_painting is None and look.roughness == 0
        if look.transmission == 1 and clear and look.metallic == 0 and look.clearcoat == 0 and max(look.emission) == 0:
            return Dielectric(
                kind="dielectric", index=_clipped(look.index, 0.2, 5), **self._absorption(), **self._bumps
            )
        return self._principled(look.transmission)

    def _pane(self) -> Material:
        """Return a pane without thickness, beside what is not transparent."""
        look = self._look
        pane = ThinGlass(
            kind="thin_glass",
            index=_clipped(look.index, 0.2, 5),
            transmittance=_within(look.base_color, 1.0),
            **self._cover,
        )
        if look.transmission == 1 and look.metallic == 0:
            return pane
        rest = self._principled(0.0)
        return Mix(kind="mix", materials=(rest, pane), factor=look.transmission * (1 - look.metallic))

    def _principled(self, transmission: float) -> Principled:
        look = self._look
        gloss: dict[str, Any] = {"specular": 0.0, "roughness": 1.0} if look.matte else {
            "specular": look.specular,
            "metallic": self._share(look.metallic, look.metallic_painting, "b"),
            "roughness": self._share(look.roughness, look.roughness_painting, "g"),
            "clearcoat": look.clearcoat,
            "clearcoat_roughness": look.clearcoat_roughness,
        }  # fmt: skip
        return Principled(
            kind="principled",
            base_color=self._base(),
            index=_clipped(look.index, 1 + LEAST_BEND if transmission else 1.0, 5),
            transmission=transmission,
            emission=self._emission(),
            **gloss,
            **(self._absorption() if transmission else {}),
            **self._bumps,
        )

    def _base(self) -> Colour | ImageTexture:
        look = self._look
        if look.base_painting is None:
            return _within(look.base_color, 1.0)
        return self._texture(look.base_painting, gain=_within(look.base_color, 1.0))

    def _emission(self) -> Colour | ImageTexture:
        look = self._look
        if look.emission_painting is None or max(look.emission) == 0:
            return _within(look.emission, LARGEST_RADIANCE)
        return self._texture(look.emission_painting, gain=_within(look.emission, LARGEST_GAIN))

    def _share(self, factor: float, painting: FileTexture | None, channel: str) -> float | ImageTexture:
        factor = _clipped(factor, 0.0, 1.0)
        if painting is None or factor == 0:
            return factor
        return self._texture(painting, gain=factor, channel=channel)

    def _absorption(self) -> dict[str, Any]:
        if self._look.attenuation is None:
            return {}
        colour, distance = self._look.attenuation
        left = Attenuation(color=_within(colour, 1.0), distance_m=_clipped(distance, 1e-9, 1e9))
        return {"attenuation": left}

    def _covering(self) -> dict[str, Any]:
        look = self._look
        mask: dict[str, Any] = {}
        if look.opacity_cutoff is not None:
            mask = {"opacity_mode": "mask", "opacity_cutoff": _clipped(look.opacity_cutoff, 0.0, 1.0)}
        painting = look.opacity_painting
        if painting is None:
            return {"opacity": _clipped(look.opacity, 0.0, 1.0), **mask}
        transparent = has_alpha(self._source(painting))
        if not transparent and painting == look.base_painting:
            return {"opacity": _clipped(look.opacity, 0.0, 1.0), **mask}
        return {"opacity": self._share(look.opacity, painting, "a" if transparent else "r"), **mask}

    def _normal_map(self) -> NormalMap | None:
        look = self._look
        if look.normals is None:
            return None
        found = NormalMap(**self._laid(look.normals), strength=_clipped(look.normals_strength, 0.0, 10.0))
        self._fill(found, look.normals)
        return found

    def _source(self, painting: FileTexture) -> Path | bytes:
        if isinstance(painting.source, bytes):
            return painting.source
        try:
            return self._folders.find(str(painting.source))
        except InputError as problem:
            raise InputError(f"material {self._look.name!r}: {painting.name}: {problem}") from None

    def _texture(self, painting: FileTexture, **keys: Any) -> ImageTexture:
        found = ImageTexture(kind="image", **self._laid(painting), **keys)
        self._fill(found, painting)
        return found

    def _laid(self, painting: FileTexture) -> dict[str, Any]:
        """Return the keys of a texture that say which picture it is and how it lies."""
        source = self._source(painting)
        return {
            "file": painting.name if isinstance(source, bytes) else str(source),
            "scale": painting.scale,
            "offset": painting.offset,
            "rotation_degrees": painting.rotation_degrees,
            "wrap": painting.wrap,
            "filter": "nearest" if painting.nearest else "bilinear",
        }

    def _fill(self, texture: ImageTexture, painting: FileTexture) -> None:
        """Give a texture its content, and errors about it their place."""
        texture._place = f"material {self._look.name!r}: {painting.name}: "
        if isinstance(painting.source, bytes):
            texture._data = painting.source


def _clipped(value: float, low: float, high: float) -> float:
    clipped = min(high, max(low, value))
    return clipped if abs(clipped) > SMALLEST else 0.0


def _within(colour: Colour, high: float) -> Colour:
    red, green, blue = (_clipped(value, 0.0, high) for value in colour)
    return (red, green, blue)
