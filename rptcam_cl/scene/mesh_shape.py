"""Meshes: triangles from a file, from the scene's named meshes, or written out."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, PrivateAttr, model_validator

from rptcam_cl.mesh_files import MeshContents, NormalsMode
from rptcam_cl.mesh_files.winding import winding_number
from rptcam_cl.references import Folders
from rptcam_cl.scene.base import Alternatives, SceneModel
from rptcam_cl.scene.file_reference import described
from rptcam_cl.scene.material import Material
from rptcam_cl.scene.mesh_rows import FaceRows, Normals, Pairs, Points, Vectors
from rptcam_cl.scene.refusal import refuse
from rptcam_cl.scene.scene_object import MATERIAL_NAME, Bounds, PlacedObject


def _printable(value: str) -> str:
    if not value.strip() or not value.isprintable():
        raise refuse("is not a path", allowed="the path of a file in the scene's folder")
    return value


FilePath = Annotated[str, Field(max_length=1000), AfterValidator(_printable)]


class MeshSource(SceneModel):
    """Where triangles come from."""

    file: FilePath | None = None
    """Mesh file in the scene's folder: .ply, .obj, .stl, .gltf or .glb."""

    vertices: Points | None = None
    """Vertices [scene units], a list of [x, y, z]."""

    faces: FaceRows | None = None
    """Polygons as lists of 3 or more vertices, which count from 0, counter-clockwise seen from the front."""

    uvs: Pairs | None = None
    """Texture coordinates of the vertices, a list of [u, v]."""

    def given_normals(self) -> Vectors | None:
        """Return the normals that are written out."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _check_lists(self) -> Self:
        if self.vertices is not None and self.faces is None:
            raise refuse("is required beside vertices", got=None, allowed="a list of faces", path=("faces",))
        normals = self.given_normals()
        for key, rows in (("faces", self.faces), ("uvs", self.uvs), ("normals", normals)):
            if rows is None:
                continue
            if self.vertices is None:
                raise refuse("belongs to vertices, which are not given", got="a list", path=(key,))
            if isinstance(rows, Vectors) and len(rows) != len(self.vertices):
                allowed = f"one for each of the {len(self.vertices)} vertices"
                raise refuse("is not one for each vertex", got=len(rows), allowed=allowed, path=(key,))
        return self


class NamedMesh(MeshSource):
    """A mesh that objects use by its name."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (Alternatives(("file", "vertices"), required=True),)

    normals: Points | None = None
    """Normals of the vertices, a list of vectors of any length."""

    def given_normals(self) -> Vectors | None:
        """Return the normals that are written out."""
        return self.normals


class LoadedMesh(NamedTuple):
    """What was found for a mesh object: its parts, and the material of each."""

    contents: MeshContents
    materials: tuple[Material, ...]


class MeshObject(MeshSource, PlacedObject):
    """A mesh of triangles; u and v are the file's, v = 0 at the lower edge of a picture."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (Alternatives(("file", "mesh", "vertices"), required=True),)

    shape: Literal["mesh"]
    """Kind of shape."""

    mesh: Annotated[str, Field(max_length=200)] | None = None
    """Name of one of `meshes`."""

    normals: Normals = "auto"
    """`auto` takes the normals of the file and is flat without them, `smooth` makes them, `flat` leaves them out;
    beside `vertices` also a list of vectors."""

    material: Annotated[Material, MATERIAL_NAME] | None = None
    """Name of one of `materials`, or a material written out; without it, the materials of the file."""

    _loaded: LoadedMesh | None = PrivateAttr(default=None)

    def given_normals(self) -> Vectors | None:
        """Return the normals that are written out."""
        return self.normals if isinstance(self.normals, Vectors) else None

    @property
    def normals_mode(self) -> NormalsMode:
        """Return how normals are made."""
        return "auto" if isinstance(self.normals, Vectors) else self.normals

    @property
    def loaded(self) -> LoadedMesh:
        """Return what was found for the object; loading it is the scene's part."""
        assert self._loaded is not None, "a mesh object is loaded by its scene"
        return self._loaded

    def shown_materials(self) -> tuple[Material, ...]:
        """Return the materials of the parts."""
        return tuple({id(material): material for material in self.loaded.materials}.values())

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of all parts."""
        corners = np.concatenate([part.corners() for part in self.loaded.contents.parts])
        return corners.min(axis=0), corners.max(axis=0)

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point is inside, seen as a solid whose front faces outwards."""
        lower, upper = self.bounds()
        if not (np.all(point > lower) and np.all(point < upper)):
            return False
        turns = 0.0
        for part in self.loaded.contents.parts:
            local = np.linalg.solve(part.placement, (*point, 1.0))[:3] - part.mesh.origin
            turns += winding_number(part.mesh.positions, part.mesh.faces, local)
        return turns > 0.5

    def described(self, folders: Folders) -> dict[str, Any]:
        """Return the parts as plain data: the content of their meshes, their placements and materials of the file."""
        loaded = self.loaded
        parts = [
            {
                "mesh": part.mesh.content_hash,
                "placement": part.placement.tolist(),
                "material": described(material, folders) if self.material is None else None,
            }
            for part, material in zip(loaded.contents.parts, loaded.materials, strict=True)
        ]
        return {"parts": parts}
