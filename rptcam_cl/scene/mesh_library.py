"""The meshes of a scene, each read once and held once."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rptcam_cl.errors import InputError
from rptcam_cl.mesh_files import (
    Draft,
    Look,
    Mesh,
    MeshContents,
    NormalsMode,
    Surface,
    as_triangles,
    finished,
    read_mesh_file,
)
from rptcam_cl.references import Folders
from rptcam_cl.scene.material import Material
from rptcam_cl.scene.mesh_look import material_of
from rptcam_cl.scene.mesh_shape import LoadedMesh, MeshObject, MeshSource, NamedMesh


class MeshLibrary:
    """Reads the meshes that objects name.

    Parameters
    ----------
    folders : Folders
        Where files may lie.
    named : mapping of str to NamedMesh
        The scene's `meshes`.
    """

    def __init__(self, folders: Folders, named: Mapping[str, NamedMesh]) -> None:
        self._folders = folders
        self._named = named
        self._known: dict[tuple[Path | _Same, NormalsMode], MeshContents] = {}
        self._meshes: dict[str, Mesh] = {}
        self._materials: dict[Look, Material] = {}

    def load(self, item: MeshObject) -> None:
        """Find the parts and materials of an object, unless it has them.

        Raises
        ------
        InputError
            When its triangles cannot be used, or it has no material.
        """
        if item._loaded is not None:
            return
        source: MeshSource = item if item.mesh is None else self._named[item.mesh]
        contents = self._contents(source, item.normals_mode)
        item._loaded = LoadedMesh(contents, self._shown(item, contents))

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
        looks = [part.look for part in contents.parts if part.look is not None]
        if len(looks) < len(contents.parts):
            why = "; ".join((f"{item.file or 'a mesh that is written out or named'} has none", *contents.notes))
            raise InputError(f"needs the key material: {why} (allowed: a material mapping, or the name of one)")
        for look in looks:
            if look not in self._materials:
                self._materials[look] = material_of(look, self._folders)
        return tuple(self._materials[look] for look in looks)


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
    surface = Surface(
        positions,
        as_triangles(positions, source.faces.groups, "the mesh: face"),
        None if normals is None else normals.rows,
        None if source.uvs is None else source.uvs.rows,
    )
    return finished(Draft([surface]), "the mesh")
