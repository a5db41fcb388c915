"""Meshes: triangles from a file, from the scene's named meshes, or written out; each is read and held once."""

from __future__ import annotations

import math
import warnings
from collections.abc import Hashable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from numbers import Integral
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    Field,
    PlainSerializer,
    PlainValidator,
    ValidationError,
    WithJsonSchema,
    model_validator,
)

from rptcam_cl.core.errors import InputError, MissingFileError
from rptcam_cl.core.files import Folders, known_suffix, name_errors
from rptcam_cl.scene.assets.mesh import (
    Draft,
    FileMaterial,
    FileTexture,
    Find,
    Mesh,
    MeshContents,
    MeshSurface,
    NormalsMode,
    Polygons,
    as_triangles,
    check_corners,
    make_contents,
    winding_number,
)
from rptcam_cl.scene.assets.pictures import has_alpha, read_picture
from rptcam_cl.scene.base import GREY, Alternatives, SceneModel, describe, number_at, one_pixel, refuse, unknown_name
from rptcam_cl.scene.materials import (
    LARGEST_INDEX,
    LEAST_BEND,
    MOST_BEND,
    MOST_INDEX,
    SMALLEST_ALPHA,
    SMALLEST_INDEX,
    Attenuation,
    Dielectric,
    Emissive,
    Material,
    Matte,
    Mix,
    Principled,
    ThinGlass,
    Translucent,
)
from rptcam_cl.scene.placement import MATERIAL_NAME, Bounds, PlacedObject
from rptcam_cl.scene.quantities import LARGEST_COORDINATE, LARGEST_GAIN, LARGEST_RADIANCE, Colour, Moment
from rptcam_cl.scene.textures import AnisotropyMap, Bump, ImageTexture, NormalMap

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


class Vectors:
    """Rows of numbers that do not change: `rows` is an (n, k) float64 array."""

    def __init__(self, rows: NDArray[np.float64]) -> None:
        rows.setflags(write=False)
        self.rows = rows

    def __len__(self) -> int:
        return len(self.rows)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Vectors) and np.array_equal(self.rows, other.rows)

    def __hash__(self) -> int:
        return hash(self.rows.tobytes())

    def plain(self) -> list[Any]:
        """Return the rows as lists."""
        return list(self.rows.tolist())


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
FaceRows = Annotated[FaceLists, PlainValidator(_faces), _PLAIN, WithJsonSchema(_rows_schema("integer", 3, None))]
Normals = Annotated[
    Vectors | NormalsMode,
    PlainValidator(_normals),
    _PLAIN,
    WithJsonSchema({"anyOf": [{"enum": list(_NORMALS_MODES)}, _POINTS_SCHEMA]}),
]


# Materials of mesh files as materials of the scene.

# Below this a number is 0; what float32 cannot hold the scene refuses.
_SMALLEST = 1e-30
_ALONG_U = FileTexture(one_pixel(255, 128, 255), "brushed along u")


def material_of(given: FileMaterial, folders: Folders, absent: list[str] | None = None) -> Material:
    """Return the material that shows what a file says about a surface.

    Parameters
    ----------
    absent
        Takes what there is to say of missing pictures, which grey stands for then.

    Raises
    ------
    InputError
        When a picture is missing, or lies where the scene may not read.
    """
    try:
        return _Translation(given, folders, absent).material()
    except ValidationError as problem:
        reason = problem.errors(include_url=False)[0]
        raise InputError(
            f"material {given.name!r} cannot be shown: {'.'.join(map(str, reason['loc']))} {reason['msg']}"
        ) from None


class _Translation:
    """What a file says about a surface, on the way to a material of the scene."""

    def __init__(self, given: FileMaterial, folders: Folders, absent: list[str] | None) -> None:
        self._absent = absent
        self._given = given
        self._folders = folders
        self._cover = self._covering()
        self._normals: dict[str, Any] = {"normal_map": self._normal_map(given.normals, given.normals_strength)}
        if given.normals is None and given.bumps is not None and given.bumps_height != 0:
            self._normals = self._unevenness(given.bumps, given.bumps_height)

    def material(self) -> Material:
        """Return the material."""
        given = self._given
        emits = max(given.emission) > 0
        black = max(given.base_color) == 0 and given.metallic == 0
        if emits and black and given.matte and given.emission_texture is None:
            radiance = _clip_colour(given.emission, LARGEST_RADIANCE)
            return Emissive(kind="emissive", radiance=radiance, two_sided=given.both_sides)
        if given.matte and not emits:
            return Matte(kind="matte", reflectance=self._base(), **self._normals, **self._cover)
        if given.translucency > 0 and not given.matte:
            return self._sheet()
        if given.transmission == 0 or given.solid:
            return self._solid()
        return self._pane()

    def _solid(self) -> Dielectric | Principled:
        given = self._given
        pictures = given.base_texture or given.transmission_texture
        clear = given.transmission == 1 and min(given.base_color) == 1 and pictures is None
        plain = given.roughness == given.metallic == given.clearcoat == max(*given.emission, *given.sheen) == 0
        if clear and plain:
            return Dielectric(
                kind="dielectric",
                index=_clip(given.index, SMALLEST_INDEX, LARGEST_INDEX),
                **self._absorption(),
                **self._normals,
                **self._cover,
            )
        return self._principled(given.transmission, self._cover)

    def _pane(self) -> Material:
        """Return a pane without thickness, beside what is not transparent."""
        given = self._given
        glass = {
            "index": _clip(given.index, SMALLEST_INDEX, LARGEST_INDEX),
            "transmittance": _clip_colour(given.base_color, 1.0),
        }
        share = self._share(given.transmission * (1 - given.metallic), given.transmission_texture, "r")
        if share == 1:
            return ThinGlass(kind="thin_glass", **glass, **self._cover)
        parts = (self._principled(0.0, {}), ThinGlass(kind="thin_glass", **glass))
        return Mix(kind="mix", materials=parts, factor=share, **self._cover)

    def _sheet(self) -> Material:
        """Return a thin sheet that passes light evenly, beside what does not pass."""
        given = self._given
        share = self._share(given.translucency, self._with_alpha(given.translucency_texture), "a")
        color = self._colour(given.translucency_color, given.translucency_color_texture)
        keys: dict[str, Any] = {"kind": "translucent", "reflectance": (0.0, 0.0, 0.0), "transmittance": color}
        if share == 1:
            return Translucent(**keys, **self._normals, **self._cover)
        parts = (self._principled(0.0, {}), Translucent(**keys, **self._normals))
        return Mix(kind="mix", materials=parts, factor=share, **self._cover)

    def _principled(self, transmission: float, cover: dict[str, Any]) -> Principled:
        given = self._given
        gloss: dict[str, Any] = {"specular": 0.0, "roughness": 1.0} if given.matte else {
            "specular": self._specular(),
            "metallic": self._share(given.metallic, given.metallic_texture, "b"),
            "roughness": self._roughness(),
            "anisotropy_rotation_degrees": given.anisotropy_rotation_degrees,
            "clearcoat": self._share(given.clearcoat, given.clearcoat_texture, "r"),
            "clearcoat_roughness": self._share(given.clearcoat_roughness, given.clearcoat_roughness_texture, "g"),
            "sheen": self._colour(given.sheen, given.sheen_texture),
            "sheen_roughness": given.sheen_roughness,
            **self._stretch(),
            **self._coat_normals(),
        }  # fmt: skip
        return Principled(
            kind="principled",
            base_color=self._base(),
            **self._reflectance(transmission),
            transmission=self._share(transmission, given.transmission_texture, "r"),
            emission=self._emission(),
            **gloss,
            **(self._absorption() if transmission else {}),
            **self._normals,
            **cover,
        )

    def _coat_normals(self) -> dict[str, Any]:
        given = self._given
        if given.clearcoat == 0:
            return {}
        if given.clearcoat_normals is None:
            return {"clearcoat_flat": given.clearcoat_flat and given.normals is not None}
        return {"clearcoat_normal_map": self._normal_map(given.clearcoat_normals, given.clearcoat_normals_strength)}

    def _roughness(self) -> float | ImageTexture:
        """The roughness; where glossiness is painted, a picture of what that leaves of 1."""
        given, gloss = self._given, self._with_alpha(self._given.gloss_texture)
        if gloss is None:
            return self._share(given.roughness, given.roughness_texture, "g")
        with name_errors(f"material {given.name!r}: {gloss.name}"):
            alpha = read_picture(self._source(gloss)).texels[..., 3]
        share = alpha / np.float32(255) if alpha.dtype == np.uint8 else alpha
        stream = BytesIO()
        np.save(stream, np.rint(255 * (1 - (1 - given.roughness) * share)).astype(np.uint8))
        return self._texture(replace(gloss, source=stream.getvalue(), name=f"roughness of {gloss.name}"), channel="r")

    def _specular(self) -> float | ImageTexture:
        return self._share(self._given.specular, self._with_alpha(self._given.specular_texture), "a")

    def _with_alpha(self, file_texture: FileTexture | None) -> FileTexture | None:
        """Return a picture that has an alpha channel, None for one without, where it is 1."""
        return file_texture if file_texture is not None and has_alpha(self._source(file_texture)) else None

    def _reflectance(self, transmission: float) -> dict[str, Any]:
        """Return index and colour of the reflectance head on; the index takes what of the colour exceeds 1."""
        given = self._given
        low, high = (1 + LEAST_BEND, MOST_BEND) if transmission else (1.0, MOST_INDEX)
        index = _clip(given.index, low, high)
        color, normal = given.specular_color, _at_normal(index)
        if not transmission and max(color) > 1 and normal > 0:
            color = _clip_colour(color, _at_normal(MOST_INDEX) / normal)
            root = math.sqrt(max(color) * normal)
            index = (1 + root) / (1 - root)
            color = _scale(color, 1 / max(color))
        return {"index": index, "specular_color": self._colour(color, given.specular_color_texture)}

    def _stretch(self) -> dict[str, Any]:
        """The anisotropy of KHR_materials_anisotropy: as numbers, or as a picture where one varies."""
        given = self._given
        strength = _clip(given.anisotropy, 0.0, 1.0)
        if strength == 0:
            return {}
        if given.anisotropy_texture is None and given.roughness_texture is None:
            return _stretch_keys(given.roughness, strength)
        directions = given.anisotropy_texture or _ALONG_U
        anisotropy_map = AnisotropyMap(**self._texture_keys(directions), strength=strength)
        self._fill(anisotropy_map, directions)
        return {"anisotropy_map": anisotropy_map}

    def _base(self) -> Colour | ImageTexture:
        return self._colour(self._given.base_color, self._given.base_texture)

    def _colour(self, factor: Colour, file_texture: FileTexture | None) -> Colour | ImageTexture:
        factor = _clip_colour(factor, 1.0)
        return factor if file_texture is None or max(factor) == 0 else self._texture(file_texture, gain=factor)

    def _emission(self) -> Colour | ImageTexture:
        given = self._given
        if given.emission_texture is None or max(given.emission) == 0:
            return _clip_colour(given.emission, LARGEST_RADIANCE)
        return self._texture(given.emission_texture, gain=_clip_colour(given.emission, LARGEST_GAIN))

    def _share(self, factor: float, file_texture: FileTexture | None, channel: str) -> float | ImageTexture:
        factor = _clip(factor, 0.0, 1.0)
        if file_texture is None or factor == 0:
            return factor
        return self._texture(file_texture, gain=factor, channel=channel)

    def _absorption(self) -> dict[str, Any]:
        if self._given.attenuation is None:
            return {}
        colour, distance = self._given.attenuation
        left = Attenuation(color=_clip_colour(colour, 1.0), distance_m=_clip(distance, 1e-9, 1e9))
        return {"attenuation": left}

    def _covering(self) -> dict[str, Any]:
        given = self._given
        mask: dict[str, Any] = {}
        if given.opacity_cutoff is not None:
            mask = {"opacity_mode": "mask", "opacity_cutoff": _clip(given.opacity_cutoff, 0.0, 1.0)}
        file_texture = given.opacity_texture
        if file_texture is None:
            return {"opacity": _clip(given.opacity, 0.0, 1.0), **mask}
        transparent = has_alpha(self._source(file_texture))
        if not transparent and file_texture == given.base_texture:
            return {"opacity": _clip(given.opacity, 0.0, 1.0), **mask}
        return {"opacity": self._share(given.opacity, file_texture, "a" if transparent else "r"), **mask}

    def _normal_map(self, normals: FileTexture | None, strength: float) -> NormalMap | None:
        if normals is None:
            return None
        normal_map = NormalMap(**self._texture_keys(normals), strength=_clip(strength, 0.0, 10.0))
        self._fill(normal_map, normals)
        return normal_map

    def _unevenness(self, bumps: FileTexture, height: float) -> dict[str, Any]:
        """Return the key for heights of MTL, or for normals, as many files have under that name.

        MTL has no unit of heights. That of programs that make normals of heights is taken: one texel.
        """
        try:
            source = self._source(bumps)
        except MissingFileError as problem:
            warnings.warn(f"{problem}; the surface stays smooth", UserWarning, stacklevel=2)
            return {}
        with name_errors(f"material {self._given.name!r}: {bumps.name}"):
            texels = read_picture(source or GREY).texels
        red, green, blue = texels[..., :3].mean(axis=(0, 1)) / (255 if texels.dtype == np.uint8 else 1)
        if blue > 0.7 and max(red, green) < 0.65:
            return {"normal_map": self._normal_map(bumps, abs(height))}
        rows, columns = texels.shape[:2]
        per_unit = (columns * abs(bumps.scale[0]) + rows * abs(bumps.scale[1])) / 2
        texture = self._texture(bumps, color_space="linear")
        return {"bump": Bump(texture=texture, height=height / max(per_unit, 1.0), lengths="unit")}

    def _source(self, file_texture: FileTexture) -> Path | bytes:
        if isinstance(file_texture.source, bytes):
            return file_texture.source
        try:
            return self._folders.find(str(file_texture.source))
        except InputError as problem:
            message = f"material {self._given.name!r}: {file_texture.name}: {problem}"
            if self._absent is None or not isinstance(problem, MissingFileError):
                raise type(problem)(message) from None
        if message not in self._absent:
            self._absent.append(message)
        return b""

    def _texture(self, file_texture: FileTexture, **keys: Any) -> ImageTexture:
        texture = ImageTexture(kind="image", **self._texture_keys(file_texture), **keys)
        self._fill(texture, file_texture)
        return texture

    def _texture_keys(self, file_texture: FileTexture) -> dict[str, Any]:
        """Return the keys of a texture that say which picture it is and how it lies."""
        source = self._source(file_texture)
        return {
            "file": file_texture.name if isinstance(source, bytes) else str(source),
            "scale": file_texture.scale,
            "offset": file_texture.offset,
            "rotation_degrees": file_texture.rotation_degrees,
            "wrap": file_texture.wrap,
            "filter": "nearest" if file_texture.nearest else "bilinear",
        }

    def _fill(self, texture: ImageTexture, file_texture: FileTexture) -> None:
        """Give a texture its content, and errors about it their place."""
        texture.locate(f"material {self._given.name!r}: {file_texture.name}: ")
        if isinstance(source := self._source(file_texture), bytes) and (content := source or texture.stand_in):
            texture.hold(content)


def _stretch_keys(roughness: float, strength: float) -> dict[str, float]:
    """Return roughness and anisotropy of ours that have both alphas of KHR_materials_anisotropy.

    Those are alpha across, and alpha + (1 - alpha) strength² along; ours are the mean alpha divided and multiplied by
    the root of their ratio, which is 1 - 0.9 anisotropy and so 0.1 or more.
    """
    across = max(roughness**2, SMALLEST_ALPHA)
    along = across + (1 - across) * strength**2
    return {"roughness": (across * along) ** 0.25, "anisotropy": min(1.0, (1 - across / along) / 0.9)}


def _clip(value: float, low: float, high: float) -> float:
    clipped = min(high, max(low, value))
    return clipped if abs(clipped) > _SMALLEST else 0.0


def _at_normal(index: float) -> float:
    """The reflectance of a dielectric at normal incidence."""
    return ((index - 1) / (index + 1)) ** 2


def _scale(colour: Colour, factor: float) -> Colour:
    red, green, blue = (value * factor for value in colour)
    return (red, green, blue)


def _clip_colour(colour: Colour, high: float) -> Colour:
    red, green, blue = (_clip(value, 0.0, high) for value in colour)
    return (red, green, blue)


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
        return self._known[key, mode, painted]

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

    faces: FaceRows | None = None
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
