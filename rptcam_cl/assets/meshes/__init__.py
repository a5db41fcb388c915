"""Triangle meshes from files or lists of numbers. Knows nothing of scenes."""

from rptcam_cl.assets.meshes.clean import Dropped
from rptcam_cl.assets.meshes.contents import Draft, MeshContents, MeshPlacement, make_contents
from rptcam_cl.assets.meshes.faces import Polygons, as_triangles
from rptcam_cl.assets.meshes.file_material import FileMaterial, FileTexture
from rptcam_cl.assets.meshes.mesh import Mesh, MeshSurface, NormalsMode, winding_number
from rptcam_cl.assets.meshes.read import READERS, read_mesh_file

__all__ = [
    "READERS",
    "Draft",
    "Dropped",
    "FileMaterial",
    "FileTexture",
    "Mesh",
    "MeshContents",
    "MeshPlacement",
    "MeshSurface",
    "NormalsMode",
    "Polygons",
    "as_triangles",
    "make_contents",
    "read_mesh_file",
    "winding_number",
]
