"""PLY (Turk 1994) and STL files, text or binary."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import linear_from_srgb
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets import mesh
from rptcam_cl.scene.assets.obj import numbers_of_lines, parse_numbers

# The header of a PLY file (Turk 1994): which elements follow, how many, and how their rows are laid out.

_MOST_HEADER_BYTES = 1 << 16
_MOST_ROWS = 2**31 - 1

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_ByteOrder = Literal["", "<", ">"]  # as numpy writes it, empty for text
_FORMATS: dict[str, _ByteOrder] = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class Property:
    """One value of a row, or a list of values with its length before it.

    Attributes
    ----------
    name : str
    type : numpy dtype
        Of the value or of each entry of the list.
    length : numpy dtype or None
        Of the length; None when it is no list.
    """

    name: str
    type: np.dtype[np.generic]
    length: np.dtype[np.generic] | None = None


@dataclass(frozen=True)
class Element:
    """Rows of one kind."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def lists(self) -> list[Property]:
        """The properties that are lists, by which rows differ in size."""
        return [item for item in self.properties if item.length is not None]

    def smallest_row(self, text: bool) -> int:
        """Return the bytes of a row whose lists are empty; in text a digit and a space for each value."""
        if text:
            return 2 * max(1, len(self.properties))
        return sum((item.length or item.type).itemsize for item in self.properties)


def _read_header(file: BinaryIO, path: Path) -> tuple[_ByteOrder, list[Element], int]:
    """Return byte order, elements and number of lines of the header of a file that is open at its start.

    The file is left at the first row.
    """
    lines = _lines(file, path)
    order: _ByteOrder | None = None
    elements: list[Element] = []
    for number, line in enumerate(lines[1:-1], start=2):
        place = f"{path}:{number}"
        words = line.split()
        match words:
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", name, "1.0"] if name in _FORMATS:
                order = _FORMATS[name]
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 20:
                elements.append(Element(name, int(count), ()))
            case ["property", *form] if elements:
                last = elements[-1]
                elements[-1] = Element(last.name, last.count, (*last.properties, _property(form, order or "<", place)))
            case _:
                raise InputError(f"{place}: is not a line of a PLY header (got {line.strip()[:60]!r})")
    if order is None:
        raise InputError(f"{path}: has no line 'format' in its header (allowed: {', '.join(_FORMATS)})")
    for element in elements:
        names = [item.name for item in element.properties]
        if len(set(names)) < len(names) or [other.name for other in elements].count(element.name) > 1:
            raise InputError(f"{path}: names element {element.name}, or one of its properties, twice")
        if element.count > _MOST_ROWS:
            raise InputError(
                f"{path}: claims {element.count} rows of {element.name} (allowed: at most {_MOST_ROWS}, and no "
                "more than the file has bytes for)"
            )
    return order, elements, len(lines)


def _lines(file: BinaryIO, path: Path) -> list[str]:
    lines: list[str] = []
    size = 0
    while size < _MOST_HEADER_BYTES:
        line = file.readline(_MOST_HEADER_BYTES - size)
        size += len(line)
        lines.append(line.decode("latin-1"))
        if not line or (len(lines) == 1 and line.strip() != b"ply"):
            break
        if line.strip() == b"end_header":
            return lines
    raise InputError(f"{path}: is not a PLY file (allowed: a header from 'ply' to 'end_header')")


def _property(form: list[str], order: str, place: str) -> Property:
    match form:
        case [type_name, name] if type_name in _TYPES:
            return Property(name, np.dtype(order + _TYPES[type_name]))
        case ["list", length, type_name, name] if _TYPES.get(length, "f")[0] in "iu" and type_name in _TYPES:
            return Property(name, np.dtype(order + _TYPES[type_name]), np.dtype(order + _TYPES[length]))
    got, types = " ".join(form)[:60], ", ".join(_TYPES)
    raise InputError(f"{place}: is not a property (got {got!r}; allowed: [list LENGTH] TYPE NAME, of {types})")


# Rows of one element of a PLY file, binary or text.

Lists = list[mesh.Polygons]


class ElementRows(NamedTuple):
    """Rows of one element.

    Attributes
    ----------
    values : dict
        Per property that is no list: an array (n,).
    lists : dict
        Per list property: for each length k that occurs, the numbers of the rows (m,) and their entries (m, k).
    """

    values: dict[str, NDArray[Any]]
    lists: dict[str, Lists]


def _join_rows(parts: list[ElementRows]) -> ElementRows:
    """Return the rows of several parts as one."""
    if len(parts) == 1:
        return parts[0]
    values = {name: np.concatenate([part.values[name] for part in parts]) for name in parts[0].values}
    lists: dict[str, Lists] = {}
    for name in parts[0].lists:
        by_length: dict[int, Lists] = {}
        for part in parts:
            for group in part.lists[name]:
                by_length.setdefault(group[1].shape[1], []).append(group)
        groups = [zip(*each, strict=True) for _, each in sorted(by_length.items())]
        lists[name] = [mesh.Polygons(*(np.concatenate(parts) for parts in each)) for each in groups]
    return ElementRows(values, lists)


def _read_binary(file: BinaryIO, element: Element, path: Path) -> ElementRows:
    """Return the rows of an element that a file is open at, and leave it after them."""
    start = file.tell()
    size = path.stat().st_size
    row = _row_like_the_first(file, element, size)
    file.seek(start)
    if row is not None and start + element.count * row.itemsize <= size:
        rows = np.fromfile(file, row, element.count)
        if all((rows[f"length of {item.name}"] == row[item.name].shape[0]).all() for item in element.lists):
            values = {item.name: rows[item.name] for item in element.properties if item.length is None}
            numbers = np.arange(len(rows))
            lists = {
                item.name: [mesh.Polygons(numbers, np.ascontiguousarray(rows[item.name]))] for item in element.lists
            }
            return ElementRows(values, lists)
        file.seek(start)
    elif not element.lists:
        raise _cut_short(path, element.name, (size - start) // max(1, element.smallest_row(False)))
    return _read_varied_rows(file, element, path)


def _cut_short(path: Path, name: str, number: int) -> InputError:
    return InputError(f"{path}: is cut short: ends inside {name} {number}")


def _row_like_the_first(file: BinaryIO, element: Element, size: int) -> np.dtype[Any] | None:
    """Return the layout of a row whose lists are as long as those of the first; None when the file does not hold it."""
    fields: list[tuple[Any, ...]] = []
    for item in element.properties:
        if item.length is None:
            fields.append((item.name, item.type))
            file.seek(item.type.itemsize, 1)
            continue
        head = file.read(item.length.itemsize)
        if not element.count or len(head) < item.length.itemsize:
            return None
        length = int(np.frombuffer(head, item.length)[0])
        if not 0 <= length * item.type.itemsize <= size:
            return None
        fields += [(f"length of {item.name}", item.length), (item.name, item.type, (length,))]
        file.seek(length * item.type.itemsize, 1)
    return np.dtype(fields)


def _read_varied_rows(file: BinaryIO, element: Element, path: Path) -> ElementRows:
    """Return rows whose lists differ in length: one walk finds where each row's parts begin."""
    data = file.read()
    begun = {item.name: np.empty(element.count, np.int64) for item in element.properties}
    lengths = {item.name: np.empty(element.count, np.int64) for item in element.lists}
    place = 0
    for number in range(element.count):
        for item in element.properties:
            size = item.type.itemsize
            if item.length is not None:
                width, kind = item.length.itemsize, item.length
                order: Literal["big", "little"] = "big" if kind.byteorder == ">" else "little"
                length = int.from_bytes(data[place : place + width], order, signed=kind.kind == "i")
                if length < 0:
                    raise InputError(f"{path}: {element.name} {number} has a list of {length} entries")
                lengths[item.name][number] = length
                place += width
                size *= length
            begun[item.name][number] = place
            place += size
        if place > len(data):
            raise _cut_short(path, element.name, number)
    file.seek(place - len(data), 1)
    values: dict[str, NDArray[Any]] = {}
    lists: dict[str, Lists] = {}
    octets = np.frombuffer(data, np.uint8)
    for item in element.properties:
        if item.length is None:
            spots = begun[item.name][:, None] + np.arange(item.type.itemsize)
            values[item.name] = octets[spots].view(item.type)[:, 0]
        else:
            groups = lists[item.name] = []
            for numbers, entries in mesh.group_lists(lengths[item.name] * item.type.itemsize, begun[item.name], octets):
                has_entries = entries.shape[1] > 0
                typed = np.ascontiguousarray(entries).view(item.type) if has_entries else entries.astype(item.type)
                groups.append(mesh.Polygons(numbers, typed))
    return ElementRows(values, lists)


# Lines read together.
_CHUNK_LINES = 1 << 15


def read_text(file: BinaryIO, element: Element, path: Path, line: int) -> ElementRows:
    """Return the rows of an element, one a line, that a text file is open at; so many lines are before them."""
    parts: list[ElementRows] = []
    done = 0
    while done < element.count or not parts:
        lines = list(islice(file, min(element.count - done, _CHUNK_LINES)))
        if element.count and not lines:
            raise InputError(f"{path}: is cut short: ends after {done} rows of {element.name}")
        numbers = parse_numbers(b" ".join(lines))
        try:
            if numbers is None:
                raise ValueError
            parts.append(_split(element, numbers, len(lines), done))
        except ValueError:
            raise _wrong_row(lines, element, path, line + done + 1) from None
        done += len(lines)
    return _join_rows(parts)


def _wrong_row(lines: list[bytes], element: Element, path: Path, first: int) -> InputError:
    """Return the error for the first of some lines that is wrong."""
    for number, line in enumerate(lines, start=first):
        try:
            _split(element, np.array([float(word) for word in line.split()]), 1, 0)
        except ValueError:
            got = line.decode("latin-1").strip()[:60]
            names = " ".join(item.name if item.length is None else f"COUNT {item.name}…" for item in element.properties)
            return InputError(
                f"{path}:{number}: is not a row of {element.name} (got {got!r}; allowed: numbers {names})"
            )
    return InputError(f"{path}:{first}: holds rows of {element.name} that cannot be read")


def _split(element: Element, numbers: NDArray[np.float64], count: int, first: int) -> ElementRows:
    """Return rows, the first of which has a number; a ValueError when the numbers are not so many whole rows."""
    if not element.lists:
        table = numbers.reshape(count, len(element.properties))
        return ElementRows({item.name: table[:, place] for place, item in enumerate(element.properties)}, {})
    begun = _walk(element, numbers, count)
    values: dict[str, NDArray[Any]] = {}
    lists: dict[str, Lists] = {}
    for item in element.properties:
        places = np.array(begun[item.name], np.intp)
        if item.length is None:
            values[item.name] = numbers[places]
        else:
            groups = lists[item.name] = []
            for rows, entries in mesh.group_lists(numbers[places].astype(np.int64), places + 1, numbers):
                if item.type.kind in "iu":
                    if not (np.abs(entries) < 2**53).all() or not (entries == np.floor(entries)).all():
                        raise ValueError("not whole")
                    entries = entries.astype(np.int64)
                groups.append(mesh.Polygons(rows + first, entries))
    return ElementRows(values, lists)


def _walk(element: Element, numbers: NDArray[np.float64], count: int) -> dict[str, list[int]]:
    """Return, per property, where each row's part begins (for a list, its length)."""
    begun: dict[str, list[int]] = {item.name: [] for item in element.properties}
    parts = [(item.length is not None, begun[item.name].append) for item in element.properties]
    plain = numbers.tolist()
    place = 0
    for _ in range(count):
        for is_list, note in parts:
            note(place)
            if is_list and place < len(plain):
                length = plain[place]
                if not 0 <= length <= len(plain) or length != int(length):
                    raise ValueError("no length of a list")
                place += int(length)
            place += 1
    if place != len(plain):
        raise ValueError("not so many numbers")
    return begun


# PLY files, text or binary: positions, normals, texture coordinates and faces.

_FACE_NAMES = ("face", "tristrips")
_INDEX_NAMES = ("vertex_indices", "vertex_index")
_UV_NAMES = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
_CORNER_UVS = "texcoord"

Columns = NDArray[Any]


def read_ply(path: Path) -> mesh.Draft:
    """Return the surface of a PLY file.

    Raises
    ------
    InputError
        When it is not PLY, holds less than it claims or nothing that can be shown.
    """
    with mesh.open_mesh(path) as file:
        order, elements, line = _read_header(file, path)
        _check_size(elements, path.stat().st_size - file.tell(), path, is_text=not order)
        names = [element.name for element in elements]
        faces = next((name for name in _FACE_NAMES if name in names), None)
        if "vertex" not in names or faces is None:
            missing = "faces" if "vertex" in names else "vertices"
            raise InputError(f"{path}: has no {missing} (allowed: elements vertex and face, or vertex and tristrips)")
        rows: dict[str, ElementRows] = {}
        for element in elements:
            is_text = not order
            rows[element.name] = read_text(file, element, path, line) if is_text else _read_binary(file, element, path)
            line += element.count
    notes = [f"{path}: colours of each face are left out"] if "red" in rows[faces].values else []
    if faces == "tristrips":
        rows[faces] = _without_strips(rows[faces])
    types = {item.name: item.type for element in elements if element.name == "vertex" for item in element.properties}
    return mesh.Draft([_surface(rows["vertex"], rows[faces], path, types)], notes=notes)


def _without_strips(strips: ElementRows) -> ElementRows:
    """Return triangles in place of strips of them, which -1 parts; every second one turns the other way round."""
    lists: dict[str, Lists] = {}
    for name, groups in strips.lists.items():
        runs = [np.append(row, -1) for _, rows in groups for row in np.asarray(rows, np.int64)]
        run = np.concatenate([np.array([-1]), *runs])
        ends = np.flatnonzero(run < 0)
        since = np.arange(len(run)) - np.repeat(ends, np.diff(np.append(ends, len(run))))  # 1 for the first of a strip
        last = np.flatnonzero(since >= 3)
        odd = (since[last] % 2 == 0)[:, None]
        a, b, c = run[last - 2], run[last - 1], run[last]
        triangles = np.where(odd, np.stack([b, a, c], axis=1), np.stack([a, b, c], axis=1))
        lists[name] = [mesh.Polygons(np.arange(len(triangles)), triangles)]
    return ElementRows({}, lists)


def _check_size(elements: list[Element], size: int, path: Path, *, is_text: bool) -> None:
    """Refuse a header that claims more than the file can hold, before anything is allocated."""
    least = sum(element.count * element.smallest_row(is_text) for element in elements)
    if least - is_text > size:
        claims = ", ".join(f"{element.count} of {element.name}" for element in elements)
        raise InputError(
            f"{path}: is cut short: {claims} take at least {least} bytes (got {max(size, 0)} after the header)"
        )


def _surface(
    vertex: ElementRows, face: ElementRows, path: Path, types: Mapping[str, np.dtype[Any]]
) -> mesh.MeshSurface:
    positions = _columns(vertex, ("x", "y", "z"))
    if positions is None:
        raise InputError(f"{path}: its vertices have no position (allowed: properties x, y, z)")
    index = next((name for name in _INDEX_NAMES if name in face.lists), None)
    if index is None:
        raise InputError(f"{path}: its faces have no list of vertices (allowed: a property list vertex_indices)")
    normals = _columns(vertex, ("nx", "ny", "nz"))
    uvs = next((columns for names in _UV_NAMES if (columns := _columns(vertex, names)) is not None), None)
    colours = _colours(vertex, types)
    polygons = face.lists[index]
    if not sum(len(corners) for _, corners in polygons):
        raise InputError(f"{path}: has no faces")
    for group in polygons:
        mesh.check_corners(group, len(positions), f"{path}: face")
    if uvs is None and _CORNER_UVS in face.lists and (corner_uvs := _corner_uvs(polygons, face)) is not None:
        vertices, uvs, polygons = mesh.weld(polygons, corner_uvs)
        positions = positions[vertices]
        normals, colours = (None if rows is None else rows[vertices] for rows in (normals, colours))
    return mesh.MeshSurface(
        positions, mesh.as_triangles(positions, polygons, f"{path}: face"), normals, uvs, colours=colours
    )


def _colours(vertex: ElementRows, types: Mapping[str, np.dtype[Any]]) -> NDArray[np.float32] | None:
    """Return the colours of the vertices, linear: whole numbers are codes as sRGB has them, others are linear."""
    stored = _columns(vertex, ("red", "green", "blue"))
    if stored is None or types["red"].kind == "f":
        return None if stored is None else stored.astype(np.float32)
    codes = np.clip(stored / np.iinfo(types["red"]).max, 0, 1)
    return np.asarray(linear_from_srgb(codes), np.float32)


def _columns(rows: ElementRows, names: tuple[str, ...]) -> Columns | None:
    """Return values (n, len(names)) in float32, or float64 when the file has that."""
    if not all(name in rows.values for name in names):
        return None
    wide = any(rows.values[name].dtype.itemsize == 8 for name in names)
    result = np.empty((len(rows.values[names[0]]), len(names)), np.float64 if wide else np.float32)
    for place, name in enumerate(names):
        result[:, place] = rows.values[name]
    return result


def _corner_uvs(polygons: list[mesh.Polygons], face: ElementRows) -> list[Columns] | None:
    """Return texture coordinates of the corners (m, k, 2) of each group of polygons, None when they do not fit."""
    groups = {len(uvs[0]) // 2: (numbers, uvs) for numbers, uvs in face.lists[_CORNER_UVS]}
    fitting = []
    for numbers, corners in polygons:
        same, uvs = groups.get(corners.shape[1], (None, None))
        if uvs is None or same is None or not np.array_equal(same, numbers):
            return None
        fitting.append(uvs.reshape(len(uvs), -1, 2))
    return fitting


# STL files, binary or text: triangles without anything else.

_HEAD_BYTES = 84
_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_CHUNK_ROWS = 1 << 17
_STL_CHUNK_LINES = 7 << 13

# What each line of a text file begins with, and what may come before it.
_AFTER = {
    b"facet": (b"solid", b"endfacet"), b"outer": (b"facet",), b"vertex": (b"outer", b"vertex"),
    b"endloop": (b"vertex",), b"endfacet": (b"endloop",), b"endsolid": (b"endfacet", b"solid"),
    b"solid": (b"", b"endsolid"),
}  # fmt: skip


def read_stl(path: Path) -> mesh.MeshSurface:
    """Return the surface of an STL file; its triangles share no vertices.

    Raises
    ------
    InputError
        When it is not STL, or holds more or fewer triangles than it says.
    """
    size = path.stat().st_size
    with mesh.open_mesh(path) as file:
        head = file.read(_HEAD_BYTES)
        count = int.from_bytes(head[80:84], "little")
        binary_size = _HEAD_BYTES + count * _ROW.itemsize
        if len(head) == _HEAD_BYTES and size == binary_size:
            corners = _binary(file, count)
        elif head.lstrip().startswith(b"solid") and b"\0" not in head:
            file.seek(0)
            corners = _text(file, path)
        elif len(head) == _HEAD_BYTES:
            raise InputError(f"{path}: says that it has {count} triangles, in {binary_size} bytes (got {size} bytes)")
        else:
            allowed = f"text that begins with 'solid', or a head of {_HEAD_BYTES} bytes"
            raise InputError(f"{path}: is not an STL file (allowed: {allowed})")
    if not len(corners):
        raise InputError(f"{path}: has no faces")
    return mesh.MeshSurface(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))


def _binary(file: BinaryIO, count: int) -> NDArray[np.float32]:
    corners = np.empty((count, 3, 3), np.float32)
    for start in range(0, count, _CHUNK_ROWS):
        rows = np.fromfile(file, _ROW, min(_CHUNK_ROWS, count - start))
        corners[start : start + len(rows)] = rows["corners"]
    return corners.reshape(-1, 3)


def _text(file: BinaryIO, path: Path) -> NDArray[np.float32]:
    parts: list[NDArray[np.float32]] = []
    before, run, done = b"", 0, 0
    while lines := list(islice(file, _STL_CHUNK_LINES)):
        vertices: list[tuple[int, bytes]] = []
        for number, line in enumerate(lines, start=done + 1):
            word, rest = (*line.split(None, 1), b"", b"")[:2]
            word = word.lower()
            if not word:
                continue
            run = run + 1 if word == b"vertex" else run
            if before not in _AFTER.get(word, ()) or run > 3 or (word == b"endloop" and run != 3):
                raise _wrong_line(path, number, line, before)
            if word == b"vertex":
                vertices.append((number, rest))
            elif word == b"endloop":
                run = 0
            before = word
        parts.append(numbers_of_lines(vertices, 3, "a vertex", path).astype(np.float32))
        done += len(lines)
    if before != b"endsolid":
        raise InputError(f"{path}: is cut short: ends without 'endsolid'")
    return np.concatenate(parts).reshape(-1, 3)


def _wrong_line(path: Path, number: int, line: bytes, before: bytes) -> InputError:
    fitting = sorted(word.decode() for word, earlier in _AFTER.items() if before in earlier)
    got = line.decode("latin-1").strip()[:60]
    return InputError(
        f"{path}:{number}: does not belong here (got {got!r}; allowed: {', '.join(fitting)}, three vertices a triangle)"
    )
