"""Which lenses the viewfinder offers: those of the library, and lens files that lie in the scene's own folder.

A client names a lens of this list and nothing else: no path that it sends is ever opened.
"""

from __future__ import annotations

import contextlib
import math
import os
from dataclasses import asdict
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Literal

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.core.kept import identity_of_code, keep_arrays, kept_arrays, name_of
from rptcam_cl.core.references import Folders, References
from rptcam_cl.core.resources import lenses_dir
from rptcam_cl.optics import Lens, list_lenses, load_lens, named_lens
from rptcam_cl.scene import LensCamera, Scene, listed, near_name

SUFFIXES = (".yaml", ".yml", ".json", ".dat", ".zmx", ".seq", ".txt")
_MIXED = (".yaml", ".yml", ".json")
FOLDERS = ("", "lenses")  # of the scene's folder, that are searched
KEPT = "lens-list"  # folder of the cache on disk
MOST_FILES = 1000
MOST_BYTES = 1 << 20


@dataclass(frozen=True)
class LensEntry:
    """A lens to choose.

    Attributes
    ----------
    name : str
        What the scene says: a name of the library, or a file relative to the scene's folder.
    title : str
        What the lens is called.
    focal_length_mm, f_number : float or None
        At the first position of a zoom; None for a lens without focal length.
    zoom : bool
    kind : str
        ``library`` or ``file``.
    """

    name: str
    title: str
    focal_length_mm: float | None
    f_number: float | None
    zoom: bool
    kind: Literal["library", "file"]

    def as_dict(self) -> dict[str, Any]:
        """Return the entry as plain values."""
        return asdict(self)


def lens_entries(scene: Scene) -> list[LensEntry]:
    """Return the lenses that a scene can be seen through, the library first; a scene's own prescription is not here."""
    return [*_library(), *_files(scene.folders)]


@cache
def _library() -> tuple[LensEntry, ...]:
    """Return the lenses of the library, as kept from an earlier run: reading them all takes longer than a picture."""
    files = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in sorted(lenses_dir().glob("*.yaml"))]
    name = name_of(identity_of_code(("optics", "viewfinder")), files)
    if (kept := kept_arrays(KEPT, name)) is not None:
        return tuple(LensEntry(**entry) for entry in kept[1]["lenses"])
    found = tuple(_entry(name, named_lens(name), "library") for name in list_lenses())
    keep_arrays(KEPT, name, {}, {"lenses": [entry.as_dict() for entry in found]})
    return found


def _entry(name: str, lens: Lens, kind: Literal["library", "file"]) -> LensEntry:
    first = lens.first_order()
    return LensEntry(
        name, lens.name, _finite(first.focal_length_mm), _finite(first.f_number), len(lens.configurations) > 1, kind
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _candidates(folders: Folders) -> list[os.DirEntry[str]]:
    """Return the files of the scene's folders that may be lenses by their suffix, in the order of names."""
    found: list[os.DirEntry[str]] = []
    for folder in FOLDERS:
        with contextlib.suppress(OSError), os.scandir(folders.base / folder) as entries:
            files = [each for each in entries if each.name.lower().endswith(SUFFIXES) and each.is_file()]
            found += sorted(files, key=lambda each: each.path)
    return found


def files_left_out(scene: Scene) -> int:
    """Return how many files in the scene's folders may be lenses and are not looked at, because there are so many."""
    return max(0, len(_candidates(scene.folders)) - MOST_FILES)


def _files(folders: Folders) -> list[LensEntry]:
    """Return the lenses among the files of the scene's folder; what is none is passed over."""
    found = []
    for each in _candidates(folders)[:MOST_FILES]:
        with contextlib.suppress(OSError):  # it has gone meanwhile
            status = each.stat()
            if status.st_size <= MOST_BYTES:
                found.append(_read(each.path, folders, (status.st_mtime_ns, status.st_size, status.st_ino)))
    return [entry for entry in found if entry is not None]


@lru_cache(maxsize=2 * MOST_FILES)
def _read(place: str, folders: Folders, stamp: tuple[int, int, int]) -> LensEntry | None:
    """Return the lens of a file, None where it is something else; read again when it has changed, by its stamp."""
    name = Path(place).relative_to(folders.base).as_posix()
    try:
        path = folders.find(name)
        if path.suffix.lower() in _MIXED and b"surfaces" not in path.read_bytes():
            return None  # a scene, or something else
        return _entry(name, load_lens(path, References(folders.beside(path))), "file")
    except (RptcamError, OSError):
        return None


def chosen_lens(scene: Scene, name: str) -> LensEntry:
    """Return the entry of a lens by its name.

    Raises
    ------
    InputError
        None of that name is offered.
    """
    entries = {entry.name: entry for entry in lens_entries(scene)}
    if name not in entries:
        raise InputError(
            f"lens: is not one of the list{near_name(name, list(entries))}"
            f" (got {name[:80]!r}; allowed: {listed(list(entries))})"
        )
    return entries[name]


def current_name(scene: Scene) -> str | None:
    """Return the name of the scene's lens; of a prescription written out, what it is called; None without one."""
    if not isinstance(scene.camera, LensCamera):
        return None
    lens = scene.camera.design
    return lens if isinstance(lens, str) else str(lens.get("name", "own prescription"))
