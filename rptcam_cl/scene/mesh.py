"""Meshes: triangles from a file, from the scene's named meshes, or written out; each is read and held once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from rptcam_cl.assets.meshes import (
    Draft,
    FileMaterial,
    Mesh,
    MeshContents,
    MeshSurface,
    NormalsMode,
    as_triangles,
    make_contents,
    read_mesh_file,
    winding_number,
)
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.references import Folders
from rptcam_cl.scene.base import Alternatives, SceneModel, refuse
from rptcam_cl.scene.file_reference import described
from rptcam_cl.scene.material import Material
from rptcam_cl.scene.mesh_materials import material_of
from rptcam_cl.scene.mesh_rows import FaceRows, Normals, Pairs, Points, Vectors
from rptcam_cl.scene.scene_object import MATERIAL_NAME, Bounds, PlacedObject


class MeshLibrary:
    """Reads the meshes that objects name.

    Parameters
    ----------
    folders : Folders
        Where files may lie.
    named : mapping of str to NamedMesh
        The scene's `meshes`.
    absent : list of str, optional
        Takes what there is to say of missing pictures, which grey stands for then; without it they are errors.
    """

    def __init__(self, folders: Folders, named: Mapping[str, NamedMesh], absent: list[str] | None = None) -> None:
        self._absent = absent
        self._folders = folders
        self._named = named
        self._known: dict[tuple[Path | _Same, NormalsMode], MeshContents] = {}
        self._meshes: dict[str, Mesh] = {}
        self._materials: dict[FileMaterial, Material] = {}
        self._loaded: dict[_Same, LoadedMesh] = {}

    def begun_anew(self, objects: Iterable[object], absent: list[str]) -> MeshLibrary:
        """Return a library that has of this one what it loaded for some objects, and reads files again for others."""
        library = MeshLibrary(self._folders, self._named, absent)
        wanted = {_Same(item) for item in objects if isinstance(item, MeshObject)}
        library._loaded |= {key: mesh for key, mesh in self._loaded.items() if key in wanted}
        return library

    def load(self, item: MeshObject) -> LoadedMesh:
        """Return the parts and materials of an object; they are found once.

        Raises
        ------
        InputError
            When its triangles cannot be used, or it has no material.
        """
        key = _Same(item)
        if key not in self._loaded:
            source: MeshSource = item if item.mesh is None else self._named[item.mesh]
            contents = self._contents(source, item.normals_mode)
            self._loaded[key] = LoadedMesh(item, contents, self._shown(item, contents))
        return self._loaded[key]

    def _contents(self, source: MeshSource, mode: NormalsMode) -> MeshContents:
        path = self._folders.find(source.file) if source.file is not None else None
        key = path or _Same(source)
        if (key, "auto") not in self._known:
            plain = _written_out(source) if path is None else read_mesh_file(path, self._folders.find_beside(path))
            self._known[key, "auto"] = plain.sharing(self._meshes)
        if (key, mode) not in self._known:
            self._known[key, mode] = self._known[key, "auto"].with_normals(mode).sharing(self._meshes)
        return self._known[key, mode]

    def _shown(self, item: MeshObject, contents: MeshContents) -> tuple[Material, ...]:
        """Return the material of each part: the object's, or those of the file."""
        if item.material is not None:
            return (item.material,) * len(contents.parts)
        given = [part.material for part in contents.parts if part.material is not None]
        if len(given) < len(contents.parts):
            why = "; ".join((f"{item.file or 'a mesh that is written out or named'} has none", *contents.notes))
            raise InputError(f"needs the key material: {why} (allowed: a material mapping, or the name of one)")
        for material in given:
            if material not in self._materials:
                self._materials[material] = material_of(material, self._folders, self._absent)
        return tuple(self._materials[material] for material in given)


class _Same:
    """Stands for one instance of a model, which would otherwise count as equal to others."""

    def __init__(self, source: MeshSource) -> None:
        self._source = source

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other._source is self._source

    def __hash__(self) -> int:
        return id(self._source)


def _written_out(source: MeshSource) -> MeshContents:
    assert source.vertices is not None and source.faces is not None
    positions = source.vertices.rows
    normals = source.given_normals()
    surface = MeshSurface(
        positions,
        as_triangles(positions, source.faces.groups, "the mesh: face"),
        None if normals is None else normals.rows,
        None if source.uvs is None else source.uvs.rows,
    )
    return make_contents(Draft([surface]), "the mesh")


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

    def given_normals(self) -> Vectors | None:
        """Return the normals that are written out."""
        return self.normals if isinstance(self.normals, Vectors) else None

    @property
    def normals_mode(self) -> NormalsMode:
        """Return how normals are made."""
        return "auto" if isinstance(self.normals, Vectors) else self.normals


class LoadedMesh(NamedTuple):
    """What was found for a mesh object or a board: its parts, and the material of each."""

    item: PlacedObject
    contents: MeshContents
    materials: tuple[Material, ...]

    def shown_materials(self) -> tuple[Material, ...]:
        """Return the materials of the parts."""
        return tuple({id(material): material for material in self.materials}.values())

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of all parts."""
        corners = np.concatenate([part.corners() for part in self.contents.parts])
        return corners.min(axis=0), corners.max(axis=0)

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point of the object's frame is inside, seen as a solid whose front faces outwards."""
        lower, upper = self.bounds()
        if not (np.all(point > lower) and np.all(point < upper)):
            return False
        turns = 0.0
        for part in self.contents.parts:
            local = np.linalg.solve(part.placement, (*point, 1.0))[:3] - part.mesh.origin
            turns += winding_number(part.mesh.positions, part.mesh.faces, local)
        return turns > 0.5

    def described(self, folders: Folders) -> dict[str, Any]:
        """Return the parts as plain data: the content of their meshes, their placements and materials of the file."""
        parts = [
            {
                "mesh": part.mesh.content_hash,
                "placement": part.placement.tolist(),
                "material": described(material, folders) if getattr(self.item, "material", None) is None else None,
            }
            for part, material in zip(self.contents.parts, self.materials, strict=True)
        ]
        return {"parts": parts}
