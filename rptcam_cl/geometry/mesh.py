"""Mesh objects of a scene as placed meshes, each with its material."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.mesh_files import Mesh
from rptcam_cl.scene import Material, MeshObject, Scene

__all__ = ["Mesh", "MeshPart", "mesh_parts"]


@dataclass(frozen=True, eq=False)
class MeshPart:
    """A mesh where an object has it.

    Attributes
    ----------
    mesh : Mesh
        The same object wherever the same triangles are used.
    placement : (4, 4) float64
        From the mesh's own coordinates (its origin added to its positions) to the world [scene units], when the shutter
        opens. A reflection
        carries the front side along: it stays where the corners run counter-clockwise in the mesh's own coordinates.
    material : Material
    name : str or None
        Of the object, or of the part in its file.
    """

    mesh: Mesh
    placement: NDArray[np.float64]
    material: Material
    name: str | None


def mesh_parts(scene: Scene, item: MeshObject) -> tuple[MeshPart, ...]:
    """Return the parts of one of a scene's mesh objects, in the order of the file.

    Raises
    ------
    InputError
        When the mesh cannot be used; a scene from `load_scene` has been checked.
    """
    loaded = scene.load_mesh(item)
    return tuple(
        MeshPart(part.mesh, item.placed_at(scene.shutter.open_s) @ part.placement, material, part.name or item.name)
        for part, material in zip(loaded.contents.parts, loaded.materials, strict=True)
    )
