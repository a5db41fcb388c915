"""Meshes: triangles from a file, from the scene's named meshes, or written out; each is read and held once."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping
from contextlib import suppress
from numbers import Integral
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, PlainSerializer, PlainValidator, WithJsonSchema, model_validator

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import Folders, known_suffix
from rptcam_cl.scene.assets.mesh import (
    Draft,
    Find,
    Mesh,
    MeshContents,
    MeshSurface,
    NormalsMode,
    Polygons,
    as_triangles,
    check_corners,
    distinct_rows,
    make_contents,
    winding_number,
)
from rptcam_cl.scene.assets.pictures import read_picture
from rptcam_cl.scene.base import Alternatives, FileReference, SceneModel, describe, number_at, refuse, unknown_name
from rptcam_cl.scene.file_materials import FileMaterial, material_of
from rptcam_cl.scene.materials import Material
from rptcam_cl.scene.placement import MATERIAL_NAME, Bounds, PlacedObject
from rptcam_cl.scene.quantities import LARGEST_COORDINATE, NUMBER, WHOLE_NUMBER, Moment, TexturePair, Vectors

# Mesh files by their suffix.


def read_draft(path: Path, find: Find, time_s: float | None = None) -> Draft:
    """Read a mesh file of one of `SUFFIXES`, unchecked; one of glTF at a time."""
    if time_s is not None and path.suffix.lower() not in GLTF:
        raise InputError(f"{path}: has no animations, so no time_s (got {time_s:g}; allowed: none, or a glTF file)")
    match path.suffix.lower():  # no scene imports the readers of formats that it does not have
        case ".ply":
            from rptcam_cl.scene.assets.ply import read_ply

            return read_ply(path)
        case ".obj":
            from rptcam_cl.scene.assets.obj import read_obj

            return read_obj(path, find)
        case ".stl":
            from rptcam_cl.scene.assets.ply import read_stl

            return Draft([read_stl(path)])
    from rptcam_cl.scene.assets.gltf import read_gltf

    return read_gltf(path, find, time_s)


GLTF = (".gltf", ".glb")
SUFFIXES = (".ply", ".obj", *GLTF, ".stl")


def read_mesh_file(path: Path, find: Find, *, painted: bool = True, time_s: float | None = None) -> MeshContents:
    """Read a mesh file.

    Parameters
    ----------
    path : Path
        The file; its suffix gives the format.
    find : callable
        Returns the checked path of a further file that this one names.
    painted
        Whether it is shown in its own materials, and so in the colours of its vertices.
    time_s : float, optional
        A moment of the animations of a glTF file; without it the pose is at rest.

    Raises
    ------
    InputError
        When the file does not hold what its format promises, or nothing that can be shown.
    """
    known_suffix(path, SUFFIXES, "is not a mesh file")
    try:
        if not path.stat().st_size:
            raise InputError(f"{path}: is empty")
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is found by looking at the numbers
            return make_contents(read_draft(path, find, time_s), str(path), painted=painted)
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror or problem})") from None


# Lists of vectors and faces written out in a scene, or given as arrays from Python.

_NORMALS_MODES: tuple[NormalsMode, ...] = ("auto", "smooth", "flat")


class FaceLists:
    """Polygons of three or more corners that do not change: `groups` holds them by their number of corners."""

    def __init__(self, groups: list[Polygons]) -> None:
        self.groups = groups

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FaceLists) and self.plain() == other.plain()

    def __hash__(self) -> int:
        return hash(tuple(corners.tobytes() for _, corners in self.groups))

    def plain(self) -> list[Any]:
        """Return the polygons in their order, as lists."""
        numbered = [
            (int(number), row.tolist())
            for numbers, corners in self.groups
            for number, row in zip(numbers, corners, strict=True)
        ]
        return [row for _, row in sorted(numbered)]


def _vectors(size: int, value: Any) -> Vectors:
    meaning = f"rows of {size} numbers"
    if isinstance(value, Vectors):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == 2 and value.shape[1] == size:
        rows = value.astype(np.float64)
    elif isinstance(value, (list, tuple)):
        for index, row in enumerate(value):
            if not isinstance(row, (list, tuple)) or len(row) != size:
                raise refuse(f"must be {size} numbers", got=row, allowed=f"a list of {size} numbers", path=(index,))
        rows = np.array(
            [[number_at(item, (i, j)) for j, item in enumerate(row)] for i, row in enumerate(value)], np.float64
        ).reshape(-1, size)
    else:
        raise refuse(f"must be {meaning}", allowed=f"a list of lists of {size} numbers")
    beyond = ~(np.abs(rows) <= LARGEST_COORDINATE)
    if beyond.any():
        row, column = (int(place) for place in np.argwhere(beyond)[0])
        got = float(rows[row, column])
        raise refuse("is out of range", got=got, allowed=f"up to {LARGEST_COORDINATE:g} in size", path=(row, column))
    if not len(rows):
        raise refuse("is empty", got=[], allowed=meaning)
    return Vectors(rows)


def _shades(value: Any) -> Vectors:
    shades = _vectors(3, value)
    beyond = np.argwhere(~((shades.rows >= 0) & (shades.rows <= 1)))
    if len(beyond):
        row, column = (int(place) for place in beyond[0])
        raise refuse("is out of range", got=float(shades.rows[row, column]), allowed="0 to 1", path=(row, column))
    return shades


def _faces(value: Any) -> FaceLists:
    allowed = "a list of lists of 3 or more vertex numbers, which count from 0"
    if isinstance(value, FaceLists):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "iu" and value.ndim == 2 and value.shape[1] >= 3:
        value = value.astype(np.int64)
        if not len(value):
            raise refuse("is empty", got=[], allowed=allowed)
        return FaceLists([Polygons(np.arange(len(value)), value)])
    if not isinstance(value, (list, tuple)) or not value:
        raise refuse("must be faces", allowed=allowed)
    by_size: dict[int, tuple[list[int], list[Any]]] = {}
    for index, row in enumerate(value):
        if not isinstance(row, (list, tuple)) or len(row) < 3 or not all(_is_index(item) for item in row):
            form = "3 or more vertex numbers, which count from 0"
            raise refuse("is not a face", got=row, allowed=form, path=(index,))
        numbers, rows = by_size.setdefault(len(row), ([], []))
        numbers.append(index)
        rows.append(row)
    return FaceLists([Polygons(np.array(numbers), np.array(rows, np.int64)) for numbers, rows in by_size.values()])


def _is_index(value: Any) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool) and 0 <= int(value) < 2**31


def _normals(value: Any) -> Vectors | str:
    if not isinstance(value, str):
        return _vectors(3, value)
    if value not in _NORMALS_MODES:
        raise unknown_name("is not a known choice", value, _NORMALS_MODES, otherwise=", or a list of vectors")
    return value


def _rows_schema(item: str, least: int, most: int | None) -> dict[str, Any]:
    row: dict[str, Any] = {"type": "array", "items": {"type": item}, "minItems": least}
    if most is not None:
        row["maxItems"] = most
    return {"type": "array", "minItems": 1, "items": row}


_PLAIN = PlainSerializer(lambda value: value if value is None or isinstance(value, str) else value.plain())
_POINTS_SCHEMA = _rows_schema("number", 3, 3)

Points = Annotated[Vectors, PlainValidator(lambda value: _vectors(3, value)), _PLAIN, WithJsonSchema(_POINTS_SCHEMA)]
WidePoints = Annotated[
    Vectors, PlainValidator(lambda value: _vectors(4, value)), _PLAIN, WithJsonSchema(_rows_schema("number", 4, 4))
]
"""Points with a width each."""
Pairs = Annotated[
    Vectors, PlainValidator(lambda value: _vectors(2, value)), _PLAIN, WithJsonSchema(_rows_schema("number", 2, 2))
]
Shades = Annotated[Vectors, PlainValidator(_shades), _PLAIN, WithJsonSchema(_POINTS_SCHEMA)]
_FaceRows = Annotated[FaceLists, PlainValidator(_faces), _PLAIN, WithJsonSchema(_rows_schema("integer", 3, None))]
Normals = Annotated[
    Vectors | NormalsMode,
    PlainValidator(_normals),
    _PLAIN,
    WithJsonSchema({"anyOf": [{"enum": list(_NORMALS_MODES)}, _POINTS_SCHEMA]}),
]


# Displacement: triangles divided, and their corners moved along the normals by a picture of heights.

_MOST_DISPLACED = 1 << 26  # triangles of a mesh


class Displacement(FileReference):
    """Heights that move the surface itself: its triangles are divided when it is loaded."""

    height: Annotated[float, Field(ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE), NUMBER]
    """How far outwards a height of 1 lies beyond one of 0, in the coordinates of the mesh; below 0 inwards."""

    middle: Annotated[float, Field(ge=-1e6, le=1e6), NUMBER] = 0.0
    """Height that stays where the mesh is."""

    steps: Annotated[int, Field(ge=1, le=1024), WHOLE_NUMBER] = 8
    """Into how many parts each edge of the mesh is divided."""

    scale: TexturePair = (1.0, 1.0)
    """Repeats of the picture per unit of u and of v."""

    offset: TexturePair = (0.0, 0.0)
    """Shift of the scaled coordinates [repeats]."""

    def heights(self, folders: Folders, uvs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the heights at texture coordinates (n, 2): the first channel as it is stored, bilinear, repeated."""
        texels = read_picture(self.source(folders)).texels[::-1, :, 0]
        rows = texels / 255 if texels.dtype == np.uint8 else texels.astype(np.float64)
        height, width = rows.shape
        x, y = ((uvs * self.scale + self.offset) * (width, height) - 0.5).T
        left, low = np.floor(x), np.floor(y)
        i, j = left.astype(np.int64) % width, low.astype(np.int64) % height
        right, above = (i + 1) % width, (j + 1) % height
        lower, upper = (rows[k, i] + (x - left) * (rows[k, right] - rows[k, i]) for k in (j, above))
        return np.asarray(lower + (y - low) * (upper - lower))

    def displace(self, mesh: Mesh, folders: Folders) -> Mesh:
        """Return a mesh of smaller triangles, moved along its normals; where it has none, along the mean ones.

        Corners at one place move together, so that no gap opens where texture coordinates agree. A mesh with normals
        gets those of the moved surface, one without stays flat from triangle to triangle.

        Raises
        ------
        InputError
            When it has no texture coordinates, or gets too many triangles.
        """
        if mesh.uvs is None:
            raise InputError("displacement: the mesh has no texture coordinates (allowed: a mesh with u and v)")
        if (count := len(mesh.faces) * self.steps**2) > _MOST_DISPLACED:
            most = max(int((_MOST_DISPLACED / len(mesh.faces)) ** 0.5), 1)
            raise InputError(f"displacement.steps: {count} triangles are too many (allowed: at most {most} steps)")
        normals = mesh.normals if mesh.normals is not None else _mean_normals(mesh.positions, mesh.faces)
        corners = np.concatenate([mesh.positions, normals, mesh.uvs], axis=1).astype(np.float64)
        points, faces = divide(corners, mesh.faces, self.steps)
        moved = points[:, 3:6] / np.maximum(np.linalg.norm(points[:, 3:6], axis=1, keepdims=True), 1e-300)
        lift = self.height * (self.heights(folders, points[:, 6:]) - self.middle)
        positions = points[:, :3] + mesh.origin + lift[:, None] * moved
        shown = None if mesh.normals is None else _mean_normals(positions, faces)
        surface = MeshSurface(positions, faces, shown, points[:, 6:])
        return make_contents(Draft([surface]), "displacement", painted=False).parts[0].mesh


def divide(
    corners: NDArray[np.float64], faces: NDArray[np.int32], steps: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Divide each edge of triangles into equal parts; return points and faces, neighbours sharing those on their edge.

    Parameters
    ----------
    corners
        Numbers of each vertex (n, k), which are linear within a triangle.
    """
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(steps + 1), np.arange(steps + 1), indexing="ij"))
    i, j = i[i + j <= steps], j[i + j <= steps]
    shares = np.stack([steps - i - j, i, j], axis=1)
    place = np.full((steps + 2, steps + 2), -1)
    place[i, j] = np.arange(len(i))
    inner = i + j < steps
    upright = np.stack([place[i, j], place[i + 1, j], place[i, j + 1]], axis=1)[inner]
    turned = np.stack([place[i + 1, j], place[i + 1, j + 1], place[i, j + 1]], axis=1)[i + j < steps - 1]
    within = np.concatenate([upright, turned])
    points = np.einsum("pc,fck->fpk", shares / steps, corners[faces]).reshape(-1, corners.shape[1])
    # A point is known by the vertices that it lies between and by how much; those on an edge have one of no weight.
    weights = np.broadcast_to(shares, (len(faces), *shares.shape)).reshape(-1, 3)
    names = np.where(weights > 0, np.repeat(faces, len(shares), axis=0), -1)
    order = np.argsort(names, axis=1, kind="stable")
    keys = np.concatenate([np.take_along_axis(each, order, axis=1) for each in (names, weights)], axis=1)
    first, number = distinct_rows(keys.astype(np.float64))
    starts = len(shares) * np.arange(len(faces))
    return points[first], number[(within[None] + starts[:, None, None]).reshape(-1, 3)]


def _mean_normals(positions: NDArray[Any], faces: NDArray[Any]) -> NDArray[np.float64]:
    """Return normals of vertices by area, the same for all at one place."""
    _, number = distinct_rows(positions.astype(np.float64))
    a, b, c = (positions[faces[:, k]].astype(np.float64) for k in range(3))
    area = np.cross(b - a, c - a)
    sums = np.zeros((number.max() + 1, 3))
    for k in range(3):
        np.add.at(sums, number[faces[:, k]], area)
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-300)
    return np.asarray(sums[number])


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
        self._known: dict[tuple[Hashable, NormalsMode, bool], MeshContents] = {}
        self._written: dict[Hashable, MeshSource] = {}  # kept so that the identities of its lists stay ones of a kind
        self._meshes: dict[str, Mesh] = {}
        self._materials: dict[FileMaterial, Material] = {}
        self._loaded: dict[int, LoadedMesh] = {}  # by the identity of its item
        self._solids: tuple[tuple[Any, ...], tuple[Any, ...]] = (), ()  # found last, and for which objects

    def begun_anew(self, objects: Iterable[object], absent: list[str]) -> MeshLibrary:
        """Return a library that has of this one what it loaded for some objects, and what these are made of."""
        library = MeshLibrary(self._folders, self._named, absent)
        items = {id(item): item for item in objects if isinstance(item, MeshObject)}
        library._loaded = {key: mesh for key, mesh in self._loaded.items() if key in items}
        sources = {id(source): source for key, item in items.items() if key not in library._loaded
                   for source in [self._source(item)]}  # fmt: skip
        with suppress(InputError):  # of a missing file, which loading it will report
            wanted = {self._key(source) for source in sources.values()}
            used = {id(mesh.contents) for mesh in library._loaded.values()}
            library._known = {at: known for at, known in self._known.items() if at[0] in wanted or id(known) in used}
            library._written = {key: source for key, source in self._written.items() if key in wanted}
        library._materials = self._materials
        for contents in library._known.values():
            contents.sharing(library._meshes)
        return library

    @property
    def count(self) -> int:
        """The number of objects that something is loaded for."""
        return len(self._loaded)

    def _source(self, item: MeshObject) -> MeshSource:
        return item if item.mesh is None else self._named[item.mesh]

    def _key(self, source: MeshSource) -> Hashable:
        """Identify the triangles of a source: by path, size, time and moment of a file, or by the lists written out."""
        if source.file is None:
            return tuple(map(id, (source.vertices, source.faces, source.uvs, source.given_normals, source.colors)))
        path = self._folders.find(source.file)
        state = path.stat()
        return path, state.st_size, state.st_mtime_ns, source.time_s

    def load(self, item: MeshObject) -> LoadedMesh:
        """Return the parts and materials of an object; they are found once.

        Raises
        ------
        InputError
            When its triangles cannot be used, or it has no material.
        """
        key = id(item)
        if key not in self._loaded:
            contents = self._contents(item)
            self._loaded[key] = LoadedMesh(item, contents, self._shown(item, contents))
        return self._loaded[key]

    def solids(self, objects: tuple[Any, ...]) -> tuple[Any, ...]:
        """Return objects with those of meshes as they are loaded."""
        if self._solids[0] is not objects:
            load = self.load
            self._solids = objects, tuple(load(item) if isinstance(item, MeshObject) else item for item in objects)
        return self._solids[1]

    def _contents(self, item: MeshObject) -> MeshContents:
        source, mode, painted = self._source(item), item.normals_mode, item.material is None
        key = self._key(source)
        self._written[key] = source
        if (key, "auto", painted) not in self._known:
            if source.file is None:
                plain = _read_written_mesh(source, painted=painted)
            else:
                path = self._folders.find(source.file)
                find = self._folders.find_beside(path)
                plain = read_mesh_file(path, find, painted=painted, time_s=source.time_s)
            self._known[key, "auto", painted] = plain.sharing(self._meshes)
        if (key, mode, painted) not in self._known:
            plain = self._known[key, "auto", painted]
            self._known[key, mode, painted] = plain.with_normals(mode).sharing(self._meshes)
        plain = self._known[key, mode, painted]
        if (by := item.displacement) is None:
            return plain
        try:
            moved = {part.mesh: by.displace(part.mesh, self._folders) for part in plain.parts}
        except InputError as problem:
            raise type(problem)(f"displacement: {str(problem).removeprefix('displacement: ')}") from None
        return plain.with_meshes(moved)

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


def _read_written_mesh(source: MeshSource, *, painted: bool) -> MeshContents:
    assert source.vertices is not None and source.faces is not None
    positions = source.vertices.rows
    normals = source.given_normals
    for polygons in source.faces.groups:
        check_corners(polygons, len(positions), "the mesh: face")
    surface = MeshSurface(
        positions,
        as_triangles(positions, source.faces.groups, "the mesh: face"),
        None if normals is None else normals.rows,
        None if source.uvs is None else source.uvs.rows,
        colours=None if source.colors is None else source.colors.rows,
    )
    return make_contents(Draft([surface]), "the mesh", painted=painted)


def _printable(value: str) -> str:
    if not value.strip() or not value.isprintable():
        raise refuse("is not a path", allowed="the path of a file in the scene's folder")
    return value


FilePath = Annotated[str, Field(max_length=1000), AfterValidator(_printable)]


WRITTEN_LISTS = ("vertices", "faces", "uvs", "normals", "colors")  # keys of triangles that are written out


class MeshSource(SceneModel):
    """Where triangles come from."""

    file: FilePath | None = None
    """Mesh file in the scene's folder: .ply, .obj, .stl, .gltf or .glb."""

    time_s: Moment | None = None
    """Moment [s] of the animations of a glTF file; without it, the pose is at rest."""

    vertices: Points | None = None
    """Vertices [scene units], a list of [x, y, z]."""

    faces: _FaceRows | None = None
    """Polygons as lists of 3 or more vertices, which count from 0, counter-clockwise seen from the front."""

    uvs: Pairs | None = None
    """Texture coordinates of the vertices, a list of [u, v]."""

    colors: Shades | None = None
    """Colours of the vertices, a list of linear [red, green, blue] from 0 to 1; they show where the object has no
    `material`, as a matte surface that reflects so much."""

    @property
    def given_normals(self) -> Vectors | None:
        """The normals that are written out."""
        normals = getattr(self, "normals", None)
        return normals if isinstance(normals, Vectors) else None

    @model_validator(mode="after")
    def _check_time(self) -> Self:
        if self.time_s is not None and not (self.file or "").lower().endswith(GLTF):
            got, allowed = self.file or "another mesh", " or ".join(GLTF)
            raise refuse("is a moment of a glTF file", got=got, allowed=f"beside a file {allowed}", path=("time_s",))
        return self

    @model_validator(mode="after")
    def _check_lists(self) -> Self:
        if self.vertices is not None and self.faces is None:
            raise refuse("is required beside vertices", got=None, allowed="a list of faces", path=("faces",))
        normals = self.given_normals
        for key, rows in (("faces", self.faces), ("uvs", self.uvs), ("normals", normals), ("colors", self.colors)):
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

    displacement: Displacement | None = None
    """Picture of heights by which the surface itself is moved."""

    material: Annotated[Material, MATERIAL_NAME] | None = None
    """Name of one of `materials`, or a material written out; without it, the materials of the file, or `colors`."""

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

    def flat_faces(self, most: int) -> Iterator[tuple[Material, list[NDArray[np.float64]]]]:
        """Yield the material and the corners (3, 3) of the triangles of each part that has no more than so many."""
        for part, material in zip(self.contents.parts, self.materials, strict=True):
            if len(part.mesh.faces) <= most:
                points = part.mesh.positions + part.mesh.origin
                yield material, [*(points @ part.placement[:3, :3].T + part.placement[:3, 3])[part.mesh.faces]]

    def described(self, folders: Folders) -> dict[str, Any]:
        """Return the parts as plain data: the content of their meshes, their placements and materials of the file."""
        parts = [
            {
                "mesh": part.mesh.content_hash,
                "placement": part.placement.tolist(),
                "material": describe(material, folders) if getattr(self.item, "material", None) is None else None,
            }
            for part, material in zip(self.contents.parts, self.materials, strict=True)
        ]
        return {"parts": parts}
