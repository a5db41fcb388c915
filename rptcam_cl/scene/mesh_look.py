"""Materials of mesh files as materials of the scene."""

from __future__ import annotations

from rptcam_cl.mesh_files import Look
from rptcam_cl.scene.material import Emissive, Material, Matte


def material_of(look: Look) -> Material:
    """Return the material that shows what a file says about a surface."""
    if max(look.emission) > 0:
        return Emissive(kind="emissive", radiance=look.emission, two_sided=True)
    return Matte(kind="matte", reflectance=look.base_colour)
