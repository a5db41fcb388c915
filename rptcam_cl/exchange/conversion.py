"""What conversions of other programs' scenes share: places in text, a report, files beside the scene, and the whole.

Also transforms, triangle meshes and subdivision surfaces on their way to a scene of ours.
"""

from __future__ import annotations

import gzip
import math
import re
import tempfile
import zlib
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import replacing
from rptcam_cl.scene.assets.mesh import as_triangles, distinct_rows, group_lists
from rptcam_cl.scene.load import load_scene, scene_text
from rptcam_cl.scene.placement import SMALLEST_STRETCH_RATIO
from rptcam_cl.scene.quantities import LARGEST_COORDINATE

# The text of a file, and places in it.

_LONGEST_MESSAGE = 1000


@dataclass(frozen=True, eq=False)
class Source:
    """The text of one file.

    Attributes
    ----------
    name : str
        File name for messages.
    text : str
    path : Path
        Where it was read from.
    """

    name: str
    text: str = field(repr=False)
    path: Path

    @cached_property
    def _line_starts(self) -> list[int]:
        if self.text.isascii():
            characters: NDArray[Any] = np.frombuffer(self.text.encode("ascii"), np.uint8)
        else:
            characters = np.frombuffer(self.text.encode("utf-32-le"), np.uint32)
        ends = np.flatnonzero(characters == ord("\n"))
        return [0, *(ends + 1).tolist()]

    def line_and_column(self, offset: int) -> tuple[int, int]:
        """Return line and column, from 1, of a character."""
        line = bisect_right(self._line_starts, offset)
        return line, offset - self._line_starts[line - 1] + 1


@dataclass(frozen=True)
class Place:
    """A character of a file."""

    source: Source
    offset: int

    @property
    def line_number(self) -> int:
        """Line, from 1."""
        return self.source.line_and_column(self.offset)[0]

    @property
    def line(self) -> str:
        """``FILE:LINE``."""
        return f"{self.source.name}:{self.line_number}"

    def error(self, problem: str) -> InputError:
        """Return the error of this place: ``FILE:LINE:COL: problem``."""
        line, column = self.source.line_and_column(self.offset)
        return InputError(f"{self.source.name}:{line}:{column}: {one_line(problem)}")


def one_line(message: str) -> str:
    """Return a message fit for one line of a terminal: names of a file may hold anything."""
    shown = message if len(message) <= _LONGEST_MESSAGE else message[:_LONGEST_MESSAGE] + "…"
    return "".join(mark if mark.isprintable() else f"\\x{ord(mark):02x}" for mark in shown)


def read_limited(path: Path, name: str, limit: int) -> bytes:
    """Return the content of a regular file of at most ``limit`` bytes; a .gz file is unpacked, to no more than that."""
    try:
        if not path.is_file():
            raise InputError(f"{name}: {'is not a regular file' if path.exists() else 'no such file'} (got {path})")
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as file:
            raw = file.read(limit + 1)
    except (zlib.error, EOFError, gzip.BadGzipFile) as problem:
        raise InputError(f"{name}: is not a whole gzip file ({problem})") from None
    except OSError as problem:
        raise StateError(one_line(f"{name}: cannot be read ({problem.strerror})")) from None
    except ValueError as problem:  # a NUL byte in the name
        raise InputError(f"{name!r}: is not a usable path ({problem})") from None
    if len(raw) > limit:
        raise InputError(f"{name}: holds more than {limit} bytes")
    return raw


def nested(keys: Any) -> int:
    """How many mixtures stand in each other in a texture of ours."""
    if not isinstance(keys, dict) or keys["kind"] != "mixture":
        return 0
    return 1 + max(nested(keys.get(name)) for name in ("first", "second", "amount"))


# What a conversion ignored or approximated, with the lines of the source.

# Lines named per message; a scene of ten thousand shapes may break one rule ten thousand times.
_LINES_NAMED = 8


@dataclass
class Report:
    """Messages in the order of files and lines, each with all the lines that it concerns.

    Attributes
    ----------
    objects : Counter
        How many objects each line of the source says something of, by file and line.
    """

    objects: Counter[tuple[str, int]] = field(default_factory=Counter)
    _lines: dict[str, set[tuple[str, int]]] = field(default_factory=dict)

    def ignored(self, place: Place, what: str) -> None:
        """Note something that the scene of ours does not have."""
        self._note(place, f"ignored: {what}")

    def approximated(self, place: Place, what: str) -> None:
        """Note something that the scene of ours has in another way."""
        self._note(place, f"approximated: {what}")

    def noted(self, place: Place, what: str) -> None:
        """Note something that a user may want to know, such as a file that was copied."""
        self._note(place, f"note: {what}")

    def _note(self, place: Place, message: str) -> None:
        self._lines.setdefault(one_line(message), set()).add((place.source.name, place.line_number))

    def described(self) -> list[dict[str, Any]]:
        """List the messages as plain data: what becomes of what, in which lines, and of how many objects."""
        return [
            {"effect": effect, "message": text, "lines": [f"{file}:{line}" for file, line in places],
             "objects": sum(self.objects[place] for place in places)}
            for places, message in self._sorted()
            for effect, _, text in [message.partition(": ")]
        ]  # fmt: skip

    def _sorted(self) -> list[tuple[list[tuple[str, int]], str]]:
        return sorted((sorted(places), message) for message, places in self._lines.items())

    def __iter__(self) -> Iterator[str]:
        for ((file, line), *others), message in self._sorted():
            named = ", ".join(
                str(other) if name == file else f"{name}:{other}" for name, other in others[:_LINES_NAMED]
            )
            rest = len(others) - _LINES_NAMED
            more = f" (also on {named}{f' and {rest} more' if rest > 0 else ''})" if others else ""
            yield f"{file}:{line}: {message}{more}"

    def __len__(self) -> int:
        return len(self._lines)


TABLED = 32  # places from which a table holds them
COAT_INDEX = 1.5  # of the clear coat of principled materials


# Files that the scene of ours names: referenced where a scene may read them, copied beside it otherwise.

LARGEST_COPY = 4 << 30  # bytes


@dataclass
class FileStore:
    """Names of the files beside a scene, and what is to be written there once all is converted.

    Attributes
    ----------
    folder : Path
        Of the scene file of ours; a scene may read files below it only.
    stem : str
        Of its name: new files go to ``STEM_files/`` and ``STEM_meshes/``.
    """

    folder: Path
    stem: str
    report: Report
    _pending: dict[str, Callable[[Path], object]] = field(default_factory=dict)
    _copied: dict[Path, str] = field(default_factory=dict)
    _referenced: set[str] = field(default_factory=set)

    def reference(self, path: Path, place: Place, check: Callable[[Path], object] | None = None) -> str:
        """Return the name under which the scene of ours reads a file.

        Parameters
        ----------
        check
            Reads a file that is to be copied, and raises an InputError when it is not of the kind that is meant.

        Raises
        ------
        InputError
            When there is no such file, or not one of its kind.
        """
        real = self._real(path, place)
        home = self.folder.resolve()
        packed = real.suffix.lower() == ".gz"
        if real.is_relative_to(home) and not packed:
            name = real.relative_to(home).as_posix()
            if name in self._pending:
                raise place.error(
                    f"lies where a new file goes (got {name}; allowed: another name or folder for the scene)"
                )
            self._referenced.add(name)
            return name
        if real not in self._copied:
            if check is not None:
                _check_file(check, real, place)
            name = self.new_name("files", real.name.removesuffix(".gz") if packed else real.name)
            self._copied[real] = name
            self._pending[name] = lambda target: _copy(real, target)
            reason = "unpacked" if packed else "copied, as it lies outside the folder of the scene"
            self.report.noted(place, f"its file: {reason}, to {self.stem}_files/")
        return self._copied[real]

    def new_name(self, kind: str, name: str) -> str:
        """Return a name below ``STEM_KIND/`` that nothing of this conversion has."""
        stem, dot, suffix = re.sub(r"[^\w.-]+", "-", name).rpartition(".")
        wanted = f"{self.stem}_{kind}/{stem or suffix}{dot}{suffix if stem else ''}".rstrip(".")
        count = 1
        taken = {name.lower() for name in (*self._pending, *self._referenced)}
        while wanted.lower() in taken:
            count += 1
            wanted = f"{self.stem}_{kind}/{stem}-{count}{dot}{suffix}"
        return wanted

    def add(self, kind: str, name: str, write: Callable[[Path], object]) -> str:
        """Return the name of a new file below ``STEM_KIND/``, to be written by a function of its path."""
        chosen = self.new_name(kind, name)
        self._pending[chosen] = write
        return chosen

    def stage(self, folder: Path) -> None:
        """Write the files below a folder, from which they are moved to their places once the whole is good.

        Parameters
        ----------
        folder
            An empty one beside the scene file.
        """
        for name, write in self._pending.items():
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            write(target)

    def place(self, staged: Path) -> None:
        """Move the files that were staged to their places, each at once."""
        for name in self._pending:
            target = self.folder / name
            target.parent.mkdir(exist_ok=True)
            (staged / name).replace(target)

    def named_in(self, staged: Path, value: Any) -> Any:
        """Return a part of the scene in which new files have their names below the staging folder."""
        if isinstance(value, dict):
            return {key: self.named_in(staged, item) for key, item in value.items()}
        if isinstance(value, list):
            return [self.named_in(staged, item) for item in value]
        if not isinstance(value, str) or value not in self._pending:
            return value
        return (staged / value).relative_to(self.folder).as_posix()

    def _real(self, path: Path, place: Place) -> Path:
        try:
            real = path.resolve()
            if not real.is_file():
                raise place.error(f"no such file (got {path})")
        except (OSError, ValueError, RuntimeError) as problem:
            raise place.error(f"is not a usable path ({problem})") from None
        return real


def _check_file(check: Callable[[Path], object], path: Path, place: Place) -> None:
    try:
        check(path)
    except InputError as problem:
        raise place.error(f"{path.name}: is not copied: {problem}") from None


def _copy(source: Path, target: Path) -> None:
    try:
        target.write_bytes(read_limited(source, str(source), LARGEST_COPY))
    except MemoryError:
        raise InputError(f"{source}: is too large to be copied") from None


# A whole scene.


@dataclass(frozen=True, eq=False)
class Conversion:
    """A converted scene, not yet written.

    Attributes
    ----------
    scene : dict
        The mapping of a scene of ours.
    report : Report
        What was ignored or approximated.
    files : FileStore
        The files that the scene needs beside it.
    """

    source: Path
    scene: dict[str, Any]
    report: Report
    files: FileStore = field(repr=False)

    def write(self, target: Path) -> tuple[str, ...]:
        """Write the scene file and the files beside it, once the whole is known to be a scene that can be used.

        All is written to a hidden folder first and read from there; then the files are moved to their places, the
        scene file last.

        Returns
        -------
        tuple of str
            Warnings about the scene.

        Raises
        ------
        InputError
            When what the pbrt scene became cannot be used; nothing is left of it.
        StateError
            When the files cannot be written.
        """
        try:
            with tempfile.TemporaryDirectory(prefix=".rptcam-convert-", dir=target.parent) as name:
                staged = Path(name)
                self.files.stage(staged)
                warnings = self._load_staged(staged, target)
                self.files.place(staged)
        except OSError as problem:
            raise StateError(f"{target}: cannot be written ({problem.strerror})") from None
        text = scene_text(self.scene, (f"Converted from {self.source.name}.",))
        with replacing(target) as temporary:
            temporary.write_text(text, "utf-8")
        return warnings

    def _load_staged(self, staged: Path, target: Path) -> tuple[str, ...]:
        """Return the warnings of the scene with its staged files, which have their later names there."""
        prefix = f"{staged.name}/"
        try:
            scene = load_scene(self.files.named_in(staged, self.scene), base_dir=target.parent)
            return tuple(text.replace(prefix, "") for text in scene.warnings)
        except InputError as problem:
            reason = str(problem).replace(prefix, "")
            raise InputError(f"{self.source}: became a scene that cannot be used: {reason}") from None


# Transforms: 4x4 matrices that act on columns, in float64.

Array = NDArray[np.float64]
Matrix = NDArray[np.float64]
Faces = NDArray[np.int64]
SMALLEST = 1e-12  # stretch, relative to the largest, below which a transform counts as one that flattens space

# Decimal digits that coordinates keep: far more than float32 has, fewer than float64 leaves after an inverse.
_DIGITS = 13


def is_invertible(matrix: Matrix) -> bool:
    """Return whether a transform is finite, and its linear part keeps three dimensions apart."""
    if not np.isfinite(matrix).all():
        return False
    stretches = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return bool(stretches[-1] > SMALLEST * stretches[0])


def is_bearable(matrix: Matrix) -> bool:
    """Return whether a transform places things where a scene of ours can hold them."""
    if not is_invertible(matrix):
        return False
    stretches = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return bool(stretches[-1] > SMALLEST and max(stretches[0], np.abs(matrix[:3, 3]).max()) < LARGEST_COORDINATE)


_RIGID = 1e-5  # by which what only turns may miss doing so


def motion_between(start: Matrix, end: Matrix, times: tuple[float, float]) -> list[dict[str, Any]] | None:
    """Return keyframes from the place of a frame to another, for what has its origin at 0; None where they stretch."""
    turn = end[:3, :3] @ np.linalg.inv(start[:3, :3])
    if not is_bearable(end) or np.abs(turn.T @ turn - np.eye(3)).max() > _RIGID or np.linalg.det(turn) < 0:
        return None
    axes = np.linalg.svd(turn)
    rows = np.column_stack([axes[0] @ axes[2], end[:3, 3]])
    first, last = times
    return [{"time_s": first, "translate": tidy(start[:3, 3])}, {"time_s": last, "matrix": rows.tolist()}]


def is_transform_of_ours(matrix: Matrix) -> bool:
    """Whether a scene of ours takes a matrix as the transform of an object; vertices may be flattened further."""
    stretches = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return bool(stretches[-1] > SMALLEST_STRETCH_RATIO * (1 + SMALLEST_STRETCH_RATIO) * stretches[0])


def is_usable(matrix: Matrix) -> bool:
    """Return whether an object of ours can stand where a transform places it."""
    return is_bearable(matrix) and is_transform_of_ours(matrix)


def apply(matrix: Matrix, points: Matrix) -> Matrix:
    """Return points (n, 3) transformed."""
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _apply_to_normals(matrix: Matrix, normals: Matrix) -> Matrix:
    """Return unit normals (n, 3) transformed: by the inverse transpose."""
    turned = normals @ np.linalg.inv(matrix[:3, :3])
    lengths = np.linalg.norm(turned, axis=1, keepdims=True)
    return np.asarray(turned / np.where(lengths > 0, lengths, 1))


def reflects(matrix: Matrix) -> bool:
    """Return whether a transform makes a left hand of a right one."""
    return bool(np.linalg.det(matrix[:3, :3]) < 0)


def is_similarity(matrix: Matrix) -> bool:
    """Return whether the linear part turns, reflects and scales evenly, and nothing else."""
    gram = matrix[:3, :3].T @ matrix[:3, :3]
    return bool(np.allclose(gram, gram[0, 0] * np.eye(3), rtol=0, atol=1e-5 * gram[0, 0]))


def tidy(values: ArrayLike) -> list[Any]:
    """Return an array as nested lists, rounded to `_DIGITS` of its largest number: what inverses leave vanishes."""
    array = np.asarray(values, np.float64)
    largest = float(np.abs(array).max(initial=0))
    if not 0 < largest < math.inf:
        return list(array.tolist())
    decimals = _DIGITS - 1 - math.floor(math.log10(largest))
    return list((np.round(array, decimals) + 0.0).tolist())  # + 0.0 makes no zero negative


def mean_scale(matrix: Matrix) -> float:
    """Return the factor of lengths of a similarity; of another transform the mean over its axes."""
    return float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))


# Triangle meshes.

# Corners of two triangles of a parallelogram agree to this, relative to its size: files carry six digits or so.
_PARALLELOGRAM_TOLERANCE = 1e-5
_CORNERS_UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64)


@dataclass(frozen=True, eq=False)
class MeshData:
    """A mesh; the front side is that from which a face runs counter-clockwise.

    Attributes
    ----------
    vertices : (n, 3) array
    faces : (m, 3) array of int
    normals : (n, 3) array or None
    uvs : (n, 2) array or None
    colours : (n, 3) array or None
        Linear, from 0 to 1.
    """

    vertices: Array
    faces: Faces
    normals: Array | None = None
    uvs: Array | None = None
    colours: Array | None = None

    def transformed(self, matrix: Matrix) -> MeshData:
        """Return the mesh in another place; its front side is carried along, also by a reflection."""
        normals = None if self.normals is None else _apply_to_normals(matrix, self.normals)
        faces = self.faces[:, ::-1] if reflects(matrix) else self.faces
        return replace(self, vertices=apply(matrix, self.vertices), faces=faces, normals=normals)

    def reversed(self) -> MeshData:
        """Return the mesh with front and back exchanged."""
        return replace(self, faces=self.faces[:, ::-1], normals=None if self.normals is None else -self.normals)

    def facing_its_normals(self) -> MeshData:
        """Return the mesh with the front of each face on the side of its vertex normals, as pbrt takes it."""
        if self.normals is None:
            return self
        behind = (self.crosses() * self.normals[self.faces].sum(axis=1)).sum(axis=1) < 0
        return replace(self, faces=np.where(behind[:, None], self.faces[:, ::-1], self.faces))

    def with_corners_apart(self, uvs: Sequence[tuple[float, float]]) -> MeshData:
        """Return the mesh with vertices of its own, and these texture coordinates, at the corners of each face."""
        flat, normals = self.faces.reshape(-1), self.normals
        own = MeshData(self.vertices[flat], np.arange(len(flat)).reshape(self.faces.shape))
        spread = np.tile(np.asarray(uvs, np.float64), (len(self.faces), 1))
        return replace(own, normals=None if normals is None else normals[flat], uvs=spread)

    def crosses(self) -> Array:
        """Return the cross product of two edges of each face (m, 3): its normal, twice its area long."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return np.cross(b - a, c - a)

    def areas(self) -> Array:
        """Return the area of each face (m,)."""
        return np.asarray(np.linalg.norm(self.crosses(), axis=1) / 2)

    def keys(self) -> dict[str, Any]:
        """Return the keys of a mesh that is written out."""
        keys: dict[str, Any] = {"vertices": tidy(self.vertices), "faces": self.faces.tolist()}
        if self.normals is not None:
            keys["normals"] = tidy(self.normals)
        if self.uvs is not None:
            keys["uvs"] = self.uvs.tolist()
        return keys

    def write_ply(self, path: Path) -> None:
        """Write the mesh as a binary PLY file."""
        parts = [(self.vertices, "x y z"), (self.normals, "nx ny nz"), (self.uvs, "u v"),
                 (self.colours, "red green blue")]  # fmt: skip
        columns = [rows for rows, _ in parts if rows is not None]
        names = " ".join(names for rows, names in parts if rows is not None).split()
        rows = np.zeros(len(self.faces), np.dtype([("count", "u1"), ("vertices", "<i4", 3)]))
        rows["count"], rows["vertices"] = 3, self.faces
        header = [
            "ply", "format binary_little_endian 1.0", f"element vertex {len(self.vertices)}",
            *(f"property float {name}" for name in names),
            f"element face {len(self.faces)}", "property list uchar int vertex_indices", "end_header\n",
        ]  # fmt: skip
        vertices = np.concatenate(columns, axis=1).astype("<f4")
        path.write_bytes("\n".join(header).encode() + vertices.tobytes() + rows.tobytes())


def rectangle_of(mesh: MeshData, *, textured: bool, oriented: bool) -> dict[str, Any] | None:
    """Return the keys of a rectangle for a mesh of two triangles that are one; None when they are not.

    Parameters
    ----------
    textured
        Whether the texture coordinates must be those of a rectangle, from (0, 0) to (1, 1).
    oriented
        Whether the front must stay the front.
    """
    ring = _ring(mesh)
    if ring is None:
        return None
    a, b, c, d = corners = mesh.vertices[ring]
    size = np.ptp(corners, axis=0).max()
    if np.abs(a + c - b - d).max() > _PARALLELOGRAM_TOLERANCE * size or not _is_flat(mesh, ring):
        return None
    if textured:
        if mesh.uvs is None:
            return None
        turns = [ring] if oriented else [ring, ring[::-1]]
        fits = [
            turn for way in turns for turn in _rotations(way) if np.allclose(mesh.uvs[turn], _CORNERS_UV, atol=1e-6)
        ]
        if not fits:
            return None
        ring = fits[0]
    a, b, _, d = mesh.vertices[ring]
    if np.linalg.norm(np.cross(b - a, d - a)) < 1e-9 * size * size:
        return None
    return {"shape": "rectangle", "corner": tidy(a), "edge_u": tidy(b - a), "edge_v": tidy(d - a)}


def _ring(mesh: MeshData) -> list[int] | None:
    """Return the four corners of two triangles that share an edge, from the first corner on, in its order."""
    if len(mesh.faces) != 2 or len(set(mesh.faces.reshape(-1).tolist())) != 4:
        return None
    first, second = mesh.faces.tolist()
    for k in range(3):
        apex, p, q = first[k], first[(k + 1) % 3], first[(k + 2) % 3]
        for j in range(3):
            if (second[j], second[(j + 1) % 3]) == (q, p):
                ring = [apex, p, second[(j + 2) % 3], q]
                start = ring.index(first[0])
                return ring[start:] + ring[:start]
    return None


def _rotations(ring: list[int]) -> list[list[int]]:
    return [ring[k:] + ring[:k] for k in range(4)]


def _is_flat(mesh: MeshData, ring: list[int]) -> bool:
    """Return whether the vertex normals, if any, are the normal of the plane."""
    if mesh.normals is None:
        return True
    normal = mesh.crosses()[0]
    length = np.linalg.norm(normal)
    lengths = np.linalg.norm(mesh.normals[ring], axis=1)
    return bool(np.all(mesh.normals[ring] @ normal > (1 - 1e-6) * length * lengths))


# Subdivision surfaces after Loop, of triangles.


def limit_of_loop(mesh: MeshData, steps: int) -> MeshData:
    """Return a mesh subdivided after Loop (1987), with its vertices moved to the surface that further steps lead to."""
    vertices, faces = mesh.vertices, mesh.faces
    for _ in range(steps):
        vertices, faces = _loop_step(vertices, faces)
    edges, _, borders = _edges_of(faces)
    valence, sums = _neighbours(len(vertices), edges, vertices)
    gamma = 1 / (valence + 3 / (8 * _loop_weight(valence)))
    limit = (1 - valence * gamma)[:, None] * vertices + gamma[:, None] * sums
    return MeshData(_on_borders(vertices, edges[borders], limit, 1 / 6), faces)


def _loop_step(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    """Divide each triangle into four: new vertices on the edges, the others moved (Loop; Hoppe 1994 at borders)."""
    edges, of_faces, borders = _edges_of(faces)
    valence, sums = _neighbours(len(vertices), edges, vertices)
    beta = _loop_weight(valence)
    moved = (1 - valence * beta)[:, None] * vertices + beta[:, None] * sums
    moved = _on_borders(vertices, edges[borders], moved, 1 / 8)
    ends = vertices[edges].sum(axis=1)
    apexes = np.zeros_like(ends)
    for corner in range(3):
        np.add.at(apexes, of_faces[:, corner], vertices[faces[:, (corner + 2) % 3]])
    middles = np.where(borders[:, None], ends / 2, 3 / 8 * ends + apexes / 8)
    ab, bc, ca = (of_faces[:, k] + len(vertices) for k in range(3))
    a, b, c = faces.T
    parts = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return np.concatenate([moved, middles]), np.concatenate([np.stack(part, axis=1) for part in parts])


def _edges_of(faces: Faces) -> tuple[Faces, Faces, NDArray[np.bool_]]:
    """Return the edges (e, 2), those of each face (m, 3) from corner to corner, and which have not two faces."""
    pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, numbers, counts = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
    return edges, numbers.reshape(-1, 3), counts != 2


def _neighbours(count: int, edges: Faces, vertices: Array) -> tuple[Array, Array]:
    """Return how many neighbours each vertex has, at least one counted, and the sum of their positions."""
    valence, sums = np.zeros(count), np.zeros((count, 3))
    for end in range(2):
        np.add.at(valence, edges[:, end], 1)
        np.add.at(sums, edges[:, end], vertices[edges[:, 1 - end]])
    return np.maximum(valence, 1), sums


def _loop_weight(valence: Array) -> Array:
    """Return the weight of each neighbour (Warren 1995, as pbrt has it)."""
    return np.where(valence == 3, 3 / 16, 3 / (8 * valence))


def _on_borders(vertices: Array, borders: Faces, inside: Array, weight: float) -> Array:
    """Return vertices, those on a border from their neighbours along it alone."""
    count, sums = _neighbours(len(vertices), borders, vertices)
    on = np.zeros(len(vertices), bool)
    on[borders] = True
    along = (1 - 2 * weight) * vertices + 2 * weight * sums / count[:, None]
    return np.where(on[:, None], along, inside)


# Subdivision surfaces after Catmull and Clark, of polygons.


@dataclass(frozen=True, eq=False)
class PolygonMesh:
    """Faces of any number of corners.

    Attributes
    ----------
    points : (n, 3) array
    counts : (m,) array of int
        Corners of each face.
    corners : (c,) array of int
        Points of the corners, face by face.
    uvs, normals, colours : (c, 2), (c, 3) and (c, 3) arrays or None
        Of the corners.
    creases, sharpness : (k, 2) and (k,) arrays or None
        Edges, by the points at their ends, which stay sharp for so many divisions.
    spikes : (n,) array or None
        For how many divisions each point stays where it is.
    """

    points: Array
    counts: Faces
    corners: Faces
    uvs: Array | None = None
    normals: Array | None = None
    creases: Faces | None = None
    sharpness: Array | None = None
    spikes: Array | None = None
    colours: Array | None = None

    @property
    def starts(self) -> Faces:
        """The first corner of each face."""
        return np.concatenate([[0], np.cumsum(self.counts)[:-1]]).astype(np.int64)

    @property
    def following(self) -> Faces:
        """The corner that follows each corner round its face."""
        following = np.arange(1, len(self.corners) + 1)
        following[self.starts + self.counts - 1] = self.starts
        return following

    def subdivided(self) -> PolygonMesh:
        """Divide faces into quadrilaterals; borders are splines, but points of a border that only one face has stay.

        Sources: E. Catmull and J. Clark, "Recursively generated B-spline surfaces on arbitrary topological meshes",
        Computer-Aided Design 10, 1978; creases by T. DeRose, M. Kass and T. Truong, "Subdivision surfaces in
        character animation", SIGGRAPH 1998.
        """
        points, corners, following = self.points, self.corners, self.following
        count = len(points)
        face_of = np.repeat(np.arange(len(self.counts)), self.counts)
        middles = _sum_by(face_of, points[corners], len(self.counts)) / self.counts[:, None]
        keys, edge_of, uses = np.unique(_edge_keys(corners, corners[following], count), return_inverse=True,
                                        return_counts=True)  # fmt: skip
        edges = np.stack(np.divmod(keys, count), axis=1)
        sharp = self._sharpness_of(keys, uses)
        ends = points[edges].sum(axis=1)
        smooth_edges = (ends + _sum_by(edge_of, middles[face_of], len(edges))) / 4
        on_edges = _blend(smooth_edges, ends / 2, np.where(uses == 2, sharp, np.inf))
        moved = self._moved(edges, ends, middles[face_of], sharp)
        before = np.empty_like(following)
        before[following] = np.arange(len(following))
        quads = np.stack(
            [corners, count + edge_of, count + len(edges) + face_of, count + edge_of[before]], axis=1
        )  # fmt: skip
        lasting = np.flatnonzero((sharp > 1) & (uses == 2))
        halves = np.stack([edges[lasting].ravel(), np.repeat(count + lasting, 2)], axis=1)
        return PolygonMesh(
            np.concatenate([moved, on_edges, middles]), np.full(len(quads), 4), quads.ravel(),
            None if self.uvs is None else self._even(self.uvs, face_of, following, before),
            colours=None if self.colours is None else self._even(self.colours, face_of, following, before),
            creases=halves, sharpness=np.repeat(sharp[lasting] - 1, 2),
            spikes=None if self.spikes is None else np.concatenate(
                [np.maximum(self.spikes - 1, 0), np.zeros(len(edges) + len(middles))]
            ),
        )  # fmt: skip

    def _sharpness_of(self, keys: Faces, uses: Faces) -> Array:
        """Return for how many divisions each edge stays sharp, those by creases and for ever the borders."""
        sharp = np.where(uses == 2, 0.0, np.inf)
        if self.creases is not None and self.sharpness is not None:
            named = _edge_keys(self.creases[:, 0], self.creases[:, 1], len(self.points))
            at = np.minimum(np.searchsorted(keys, named), len(keys) - 1)
            there = keys[at] == named
            np.maximum.at(sharp, at[there], self.sharpness[there])
        return sharp

    def _moved(self, edges: Faces, ends: Array, middles: Array, sharp: Array) -> Array:
        """Return where the points go, by the sums of the ends of edges and the middles of the faces of corners."""
        points, corners, count = self.points, self.corners, len(self.points)
        valence = np.bincount(edges.ravel(), minlength=count).astype(np.float64)
        faces = np.bincount(corners, minlength=count).astype(np.float64)
        q = _sum_by(corners, middles, count) / np.maximum(faces, 1)[:, None]
        r = _sum_by(edges.ravel(), np.repeat(ends / 2, 2, axis=0), count) / np.maximum(valence, 1)[:, None]
        n = np.maximum(valence, 1)[:, None]
        # A point of two sharp edges lies on their spline, one of more is a corner; by less than 1, in between.
        kept = sharp > 0
        crease, its_sharpness = edges[kept], np.repeat(sharp[kept], 2)
        meeting = np.bincount(crease.ravel(), minlength=count)
        along = _sum_by(crease.ravel(), points[crease[:, ::-1].ravel()], count)
        mean = np.bincount(crease.ravel(), its_sharpness, count) / np.maximum(meeting, 1)
        on_spline = (meeting == 2) & (faces > 1)
        ruled = np.where(on_spline[:, None], 0.75 * points + along / 8, points)
        moved = _blend((q + 2 * r + (n - 3) * points) / n, ruled, np.where(meeting >= 2, mean, 0.0))
        moved = moved if self.spikes is None else _blend(moved, points, self.spikes)
        return np.where((faces > 0)[:, None], moved, points)

    def _even(self, values: Array, face_of: Faces, following: Faces, before: Faces) -> Array:
        """Return the values of corners at those of the quadrilaterals that each face is divided into."""
        middle = (_sum_by(face_of, values, len(self.counts)) / self.counts[:, None])[face_of]
        parts = [values, (values + values[following]) / 2, middle, (values + values[before]) / 2]
        return np.stack(parts, axis=1).reshape(-1, values.shape[1])

    def triangles(self, faces: Faces | None = None, *, smooth: bool = False) -> MeshData:
        """Return some faces, or all, as triangles."""
        chosen = np.arange(len(self.counts)) if faces is None else faces
        chosen = chosen[self.counts[chosen] > 2]
        places = group_lists(self.counts[chosen], self.starts[chosen], np.arange(len(self.corners)))
        corners = np.zeros((0, 3), np.int64)
        if places:
            corners = as_triangles(self.points[self.corners], places, "face").astype(np.int64)
        normals = self.normals
        if smooth:
            mesh = MeshData(self.points, self.corners[corners])
            crosses = np.repeat(mesh.crosses(), 3, axis=0)
            normals = _sum_by(mesh.faces.ravel(), crosses, len(self.points))[self.corners]
        of_corners = normals, self.uvs, self.colours
        columns = [part for part in of_corners if part is not None]
        if not columns:
            used, numbers = np.unique(self.corners[corners], return_inverse=True)
            return MeshData(self.points[used], numbers.reshape(-1, 3))
        first, numbers = distinct_rows(np.hstack([self.corners[:, None], *columns])[corners.ravel()])
        kept = corners.ravel()[first]
        return MeshData(self.points[self.corners[kept]], numbers.reshape(-1, 3),
                        *(None if part is None else part[kept] for part in of_corners))  # fmt: skip


def _sum_by(index: Faces, rows: Array, count: int) -> Array:
    return np.stack([np.bincount(index, column, count) for column in rows.T], axis=1)


def _edge_keys(a: Faces, b: Faces, count: int) -> Faces:
    """Return a number for each pair of points, whichever comes first."""
    return np.minimum(a, b).astype(np.int64) * count + np.maximum(a, b)


def _blend(smooth: Array, sharp: Array, sharpness: Array) -> Array:
    share = np.minimum(sharpness, 1.0)[:, None]
    return (1 - share) * smooth + share * sharp
