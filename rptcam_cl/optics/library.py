"""Lenses by name, by file or from a mapping."""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rptcam_cl.errors import InputError, StateError
from rptcam_cl.optics.files.codev import read_codev
from rptcam_cl.optics.files.iset import is_iset, read_iset
from rptcam_cl.optics.files.native import document_of, read_native
from rptcam_cl.optics.files.optical_bench import is_optical_bench, read_optical_bench
from rptcam_cl.optics.files.pbrt import read_pbrt
from rptcam_cl.optics.files.zemax import read_zemax
from rptcam_cl.optics.lens import Lens
from rptcam_cl.references import Folders, References, digest, read_whole
from rptcam_cl.resources import lenses_dir
from rptcam_cl.strict_yaml import MAX_BYTES, read_yaml

NATIVE_SUFFIXES = (".yaml", ".yml", ".json")
READERS: dict[str, Callable[[str, str], Lens]] = {".dat": read_pbrt, ".zmx": read_zemax, ".seq": read_codev}
SUFFIXES = (*NATIVE_SUFFIXES, *READERS, ".txt")


def list_lenses() -> list[str]:
    """Return the names of the lenses that come with the package, sorted."""
    return sorted(path.stem for path in lenses_dir().glob("*.yaml"))


def names_a_file(reference: str) -> bool:
    """Return whether a scene's word for its lens is a path and not a name of the library."""
    return "/" in reference or "\\" in reference or reference.lower().endswith(SUFFIXES)


def named_lens(name: str) -> Lens:
    """Return a lens that comes with the package.

    Raises
    ------
    InputError
        When none has that name.
    """
    if name not in list_lenses():
        raise _unknown(name)
    return read_native(read_yaml(lenses_dir() / f"{name}.yaml"))


def load_lens(source: str | Path | Mapping[str, Any], files: References | None = None) -> Lens:
    """Return a lens.

    Parameters
    ----------
    source : str, Path or mapping
        A name from `list_lenses`; a path to a lens file: our YAML or JSON, ISET JSON, pbrt ``.dat``, Zemax ``.zmx``,
        CODE V ``.seq`` or Optical Bench ``.txt``; or the content of a file of ours.
    files : References, optional
        Reads the files that the lens names: glass catalogues, coatings. By default they lie in the folder of the lens
        file or below it, for a mapping in the working folder.

    Raises
    ------
    InputError
        When there is no such lens, or it is not as its form demands.
    StateError
        When a file cannot be read.
    """
    if isinstance(source, Mapping):
        return read_native(document_of(source, files))
    if isinstance(source, str) and source in list_lenses():
        return named_lens(source)
    path = Path(source)
    try:
        found = path.exists()
    except (OSError, ValueError):
        found = False
    if not found:
        raise _unknown(str(source))
    suffix = path.suffix.lower()
    if suffix in NATIVE_SUFFIXES:
        document = replace(read_yaml(path), files=files or References(Folders(path.parent, owner="lens")))
        return read_iset(document) if is_iset(document) else read_native(document)
    if suffix in READERS:
        return READERS[suffix](_read_text(path), str(path))
    if suffix == ".txt":
        text = _read_text(path)
        return read_optical_bench(text, str(path)) if is_optical_bench(text) else read_pbrt(text, str(path))
    raise InputError(f"{path}: unknown kind of lens file; known: {', '.join(SUFFIXES)}")


def digests_of_lens(source: Path | Mapping[str, Any], folders: Folders) -> dict[str, str]:
    """Return the SHA-256 of a lens file and of all files that it names, by their names.

    Parameters
    ----------
    source : Path or mapping
        A lens file, or the content of one.
    folders : Folders
        Where the files may lie that it names.
    """
    files = References(folders)
    with contextlib.suppress(InputError, StateError):  # told where the lens is used
        load_lens(source, files)
    own = {"": digest(source, MAX_BYTES)} if isinstance(source, Path) else {}
    return own | files.digests()


def _unknown(name: str) -> InputError:
    known = list_lenses()
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
    hint = f"did you mean {', '.join(near)}?" if near else f"names: {', '.join(known)}"
    return InputError(f"{name}: no such lens file or name; {hint}")


def _read_text(path: Path) -> str:
    try:
        raw = read_whole(path, MAX_BYTES)
    except (InputError, StateError) as problem:
        raise type(problem)(f"{path}: {problem}") from None
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16")
    if b"\0" in raw:
        raise InputError(f"{path}: contains NUL bytes; this is not a text file")
    return raw.decode("utf-8-sig", "replace")
