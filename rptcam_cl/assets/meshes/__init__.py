"""Triangle meshes from files or lists of numbers. Knows nothing of scenes."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rptcam_cl.assets.meshes.clean import Dropped
from rptcam_cl.assets.meshes.contents import LAMPS_LEFT_OUT, Draft, MeshContents, MeshPlacement, make_contents
from rptcam_cl.assets.meshes.faces import Polygons, as_triangles
from rptcam_cl.assets.meshes.file_material import FileMaterial, FileTexture
from rptcam_cl.assets.meshes.mesh import Mesh, MeshSurface, NormalsMode, winding_number
from rptcam_cl.assets.meshes.read import READERS, read_mesh_file

if TYPE_CHECKING:
    from rptcam_cl.assets.meshes.gltf_world import GltfCamera, GltfLight, GltfWorld, read_gltf_world

__all__ = [
    "LAMPS_LEFT_OUT",
    "READERS",
    "Draft",
    "Dropped",
    "FileMaterial",
    "FileTexture",
    "GltfCamera",
    "GltfLight",
    "GltfWorld",
    "Mesh",
    "MeshContents",
    "MeshPlacement",
    "MeshSurface",
    "NormalsMode",
    "Polygons",
    "as_triangles",
    "make_contents",
    "read_gltf_world",
    "read_mesh_file",
    "winding_number",
]

# What scenes do not need, and takes long to import
_LATER = {"GltfCamera", "GltfLight", "GltfWorld", "read_gltf_world"}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.gltf_world"), name)
