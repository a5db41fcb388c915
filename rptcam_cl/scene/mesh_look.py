"""Materials of mesh files as materials of the scene."""

from __future__ import annotations

from pathlib import Path

from rptcam_cl.mesh_files import Look, Painting
from rptcam_cl.scene.material import Emissive, Material, Matte
from rptcam_cl.scene.texture import ImageTexture


def material_of(look: Look) -> Material:
    """Return the material that shows what a file says about a surface."""
    if max(look.emission) > 0:
        return Emissive(kind="emissive", radiance=look.emission, two_sided=look.both_sides)
    if look.base_painting is not None:
        return Matte(kind="matte", reflectance=_texture(look.base_painting, gain=max(look.base_color)))
    return Matte(kind="matte", reflectance=look.base_color)


def _texture(painting: Painting, *, gain: float) -> ImageTexture:
    found = ImageTexture(
        kind="image",
        file=str(painting.source) if isinstance(painting.source, Path) else painting.name,
        scale=painting.scale,
        offset=painting.offset,
        rotation_degrees=painting.rotation_degrees,
        wrap=painting.wrap,
        filter="nearest" if painting.nearest else "bilinear",
        gain=gain,
    )
    found._place = f"{painting.name}: "
    if isinstance(painting.source, bytes):
        found._data = painting.source
    return found
