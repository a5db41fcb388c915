"""Parts of a scene that name a file: found once all is validated, so that errors can name the place in the scene."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, get_args

from pydantic import Field, PrivateAttr

from rptcam_cl.core.references import Folders, digest
from rptcam_cl.scene.base import SceneModel


def one_pixel(red: int, green: int, blue: int) -> bytes:
    """Return the PNG file of a single pixel, 8 bits a channel (PNG specification, sections 5 and 11)."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    header = (1).to_bytes(4, "big") * 2 + bytes([8, 2, 0, 0, 0])
    row = zlib.compress(bytes([0, red, green, blue]))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", row) + chunk(b"IEND", b"")


GREY = one_pixel(188, 188, 188)  # 0.503 once decoded from sRGB
LARGEST_FILE = 2 << 30  # bytes, of a picture, the largest kind of file that parts of a scene name
_PLAIN = {str, int, float, bool}
FileName = Annotated[str, Field(min_length=1, max_length=1000)]


class FileReference(SceneModel):
    """A part of a scene whose content is in a file of the scene's folder, or was taken out of another file."""

    stand_in: ClassVar[bytes | None] = None
    """Content that takes the place of a missing file, where a scene may go on without it."""

    file: FileName
    """File in the scene's folder."""

    _data: bytes | None = PrivateAttr(None)
    """Content of the file, where it comes from inside another file; `file` is a name for the reader then."""

    _place: str = PrivateAttr("")
    """Where the scene names the file, ``scene.yaml:3:9: materials.wood.reflectance.file: ``; for errors."""

    @property
    def place(self) -> str:
        """What an error about the file begins with."""
        return self._place or f"{self.file}: "

    def locate(self, place: str) -> None:
        """Say where the scene names the file, unless that is known."""
        self._place = self._place or place

    def hold(self, content: bytes) -> None:
        """Take content in place of the file's."""
        self._data = content

    def source(self, folders: Folders) -> Path | bytes:
        """Return the real path of the file, or its content where that is known.

        Raises
        ------
        InputError
            When the file is missing, not a regular file, or not in a folder where the scene may read.
        """
        return self._data if self._data is not None else folders.find(self.file)

    def content_digest(self, folders: Folders) -> str:
        """Return the SHA-256 of the content."""
        source = self.source(folders)
        return hashlib.sha256(source).hexdigest() if isinstance(source, bytes) else digest(source, LARGEST_FILE)


def described(value: SceneModel, folders: Folders) -> dict[str, Any]:
    """Return a part of a scene as plain data in which files stand by their content."""
    content = value.model_dump(mode="json")
    for path, reference in file_references(value):
        part: Any = content
        for step in path:
            part = part[step]
        part["file"] = reference.content_digest(folders)
    return content


def file_references(
    value: Any, path: tuple[str | int, ...] = ()
) -> Iterator[tuple[tuple[str | int, ...], FileReference]]:
    """Yield every part below a value that names a file, with the keys that lead to it."""
    if isinstance(value, SceneModel):
        if isinstance(value, FileReference):
            yield path, value
        items: Iterable[tuple[str | int, Any]] = [
            (name, getattr(value, name)) for name in _fields_with_files(type(value))
        ]
    elif isinstance(value, tuple):
        items = enumerate(value)
    elif isinstance(value, Mapping):
        items = value.items()
    else:
        return
    for key, item in items:
        if item is not None and type(item) not in _PLAIN:
            yield from file_references(item, (*path, key))


@lru_cache(maxsize=256)
def _fields_with_files(model: type[SceneModel]) -> tuple[str, ...]:
    """Return the fields of a model below which its types allow a part that names a file."""
    return tuple(name for name, field in model.model_fields.items() if _may_name_files(field.annotation, set()))


def _may_name_files(annotation: Any, seen: set[type]) -> bool:
    """Return whether a type allows a part that names a file, in types that were not seen before."""
    if isinstance(annotation, type) and issubclass(annotation, SceneModel):
        if annotation in seen:
            return False
        seen.add(annotation)
        fields = annotation.model_fields.values()
        return issubclass(annotation, FileReference) or any(_may_name_files(each.annotation, seen) for each in fields)
    return annotation is Any or any(_may_name_files(part, seen) for part in get_args(annotation))
