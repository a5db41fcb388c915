"""A scene with all its files as bytes, so that a machine that has none of them can render it."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rptcam_cl.core.atomic import scratch_folder
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.references import named_files, read_whole
from rptcam_cl.scene import Scene, load_scene, plain

LARGEST_FILE = 2 << 30  # bytes


@dataclass(frozen=True)
class Parcel:
    """A scene and its files.

    Attributes
    ----------
    scene : dict
        The data of the scene.
    files : dict
        Contents, by path in the scene's folder, with ``/`` between its parts.
    content_hash : str
        Of the scene as it was packed.
    """

    scene: dict[str, Any]
    files: dict[str, bytes]
    content_hash: str

    @property
    def digest(self) -> str:
        """What tells this parcel from others: the SHA-256 of all that it holds."""
        whole = hashlib.sha256(self.content_hash.encode())
        for name, content in sorted(self.files.items()):
            whole.update(f"\0{name}\0".encode() + hashlib.sha256(content).digest())
        return whole.hexdigest()

    def unpacked(self, folder: Path) -> Scene:
        """Write the files into a folder, and return the scene that reads them there.

        Raises
        ------
        StateError
            It is not the scene that was packed.
        """
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        scene = load_scene(self.scene, base_dir=folder)
        if scene.content_hash() != self.content_hash:
            raise StateError("the scene is not the one that was sent: a file has changed, or a link leads elsewhere")
        return scene


def packed(scene: Scene, *others: Scene) -> Parcel:
    """Return a scene with all the files that it names, directly or by a file of its own, and those of other scenes.

    These are in the same folder. Where they name the files that the scene names, these are not read again.

    Raises
    ------
    InputError
        A file is missing, or lies outside the scene's folder.
    StateError
        One cannot be read.
    """
    if scene.stand_ins:
        raise InputError("the scene lacks files, and a cluster renders whole scenes (allowed: without --missing grey)")
    data = plain_data(scene)
    base = scene.base_dir.resolve()
    with named_files() as named:
        again = load_scene(data, base_dir=base)
        again.solids()
        digest = again.content_hash()
        for other in _with_other_words(data, others):
            other.solids()
            other.content_hash()
    files = {}
    for path in sorted(named):
        if not path.is_relative_to(base):
            raise InputError(f"{path}: lies outside the scene's folder (allowed: files in {base}, which are sent)")
        files[path.relative_to(base).as_posix()] = read_whole(path, LARGEST_FILE)
    parcel = Parcel(data, files, digest)
    if digest != scene.content_hash():
        raise StateError("the scene's files have changed since it was loaded (load it again)")
    return parcel


def plain_data(scene: Scene) -> dict[str, Any]:
    """Return the data of a scene, as a file has them."""
    return {name: _data(value) for name, value in scene.made_of.items()}


def _data(value: Any) -> Any:
    """Return a part of a scene as the data that a file has."""
    return value.model_dump(mode="json", exclude_unset=True) if hasattr(value, "model_dump") else plain(value)


def _with_other_words(data: Any, others: Iterable[Scene]) -> Iterator[Scene]:
    """Yield scenes, loaded anew, that have other words than the data and than those before: names of files, perhaps."""
    known = {_words(data)}
    for other in others:
        own = plain_data(other)
        if (words := _words(own)) not in known:
            known.add(words)
            yield load_scene(own, base_dir=other.base_dir)


def _words(data: Any) -> tuple[str, ...]:
    """Return all texts among data."""
    if isinstance(data, Mapping):
        return tuple(word for value in data.values() for word in _words(value))
    if isinstance(data, list | tuple):
        return tuple(word for value in data for word in _words(value))
    return (data,) if isinstance(data, str) else ()


MOST_KEPT = 3  # scenes, where as many clients have the same workers
_FOLDERS: dict[str, tuple[Any, Scene]] = {}  # of parcels that are unpacked in this process, the last used one last
_ONE = threading.Lock()


def keep_scene(parcel: Parcel) -> None:
    """Unpack a parcel, once in this process; its folder goes with the process, or with others after it."""
    with _ONE:
        if (digest := parcel.digest) not in _FOLDERS:
            folder = scratch_folder()
            _FOLDERS[digest] = folder, parcel.unpacked(Path(folder.name))
            for old in list(_FOLDERS)[:-MOST_KEPT]:
                del _FOLDERS[old]


def has_scene(digest: str) -> bool:
    """Whether the parcel with this digest is unpacked in this process."""
    return digest in _FOLDERS


def scene_of(digest: str) -> Scene:
    """Return the scene of a parcel that is unpacked in this process."""
    with _ONE:
        _FOLDERS[digest] = _FOLDERS.pop(digest)
        return _FOLDERS[digest][1]
