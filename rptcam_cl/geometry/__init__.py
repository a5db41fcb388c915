"""Geometry of a scene that is not described by a few numbers: meshes."""

from rptcam_cl.geometry.mesh import Mesh, MeshPart, mesh_parts

__all__ = ["Mesh", "MeshPart", "mesh_parts"]
