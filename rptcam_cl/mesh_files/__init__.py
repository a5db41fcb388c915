"""Triangle meshes from files or lists of numbers. Knows nothing of scenes."""

from rptcam_cl.mesh_files.alpha import has_alpha
from rptcam_cl.mesh_files.clean import Dropped
from rptcam_cl.mesh_files.contents import Draft, MeshContents, PlacedMesh, finished
from rptcam_cl.mesh_files.faces import Polygons, as_triangles
from rptcam_cl.mesh_files.looks import Look, Painting
from rptcam_cl.mesh_files.mesh import Mesh, NormalsMode, Surface
from rptcam_cl.mesh_files.read import READERS, read_mesh_file

__all__ = [
    "READERS",
    "Draft",
    "Dropped",
    "Look",
    "Mesh",
    "MeshContents",
    "NormalsMode",
    "Painting",
    "PlacedMesh",
    "Polygons",
    "Surface",
    "as_triangles",
    "finished",
    "has_alpha",
    "read_mesh_file",
]
