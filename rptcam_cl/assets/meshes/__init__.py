"""Triangle meshes from files or lists of numbers. Knows nothing of scenes."""

from rptcam_cl.assets.meshes.clean import Dropped
from rptcam_cl.assets.meshes.contents import Draft, FileMaterial, FileTexture, MeshContents, MeshPlacement, finished
from rptcam_cl.assets.meshes.faces import Polygons, as_triangles
from rptcam_cl.assets.meshes.mesh import Mesh, MeshSurface, NormalsMode
from rptcam_cl.assets.meshes.read import READERS, read_mesh_file
from rptcam_cl.assets.meshes.winding import winding_number
from rptcam_cl.assets.pictures import has_alpha

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
    "finished",
    "has_alpha",
    "read_mesh_file",
    "winding_number",
]
