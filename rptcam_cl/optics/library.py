"""Lenses by name, by file or from a mapping."""

from __future__ import annotations

import contextlib
import difflib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import Folders, References, digest, lenses_dir, name_errors, read_whole
from rptcam_cl.core.strict_yaml import MAX_BYTES, Document, read_yaml
from rptcam_cl.optics.files import tables
from rptcam_cl.optics.files.glasses import chosen_makers
from rptcam_cl.optics.files.native import document_of, read_native
from rptcam_cl.optics.files.sequential import read_codev, read_zemax
from rptcam_cl.optics.lens import Lens

_NATIVE_SUFFIXES = (".yaml", ".yml", ".json")
_NAMING: dict[str, Callable[[str, str, tuple[str, ...]], Lens]] = {".zmx": read_zemax, ".seq": read_codev}
READERS: dict[str, Callable[[str, str], Lens]] = {".dat": tables.read_pbrt, ".zmx": read_zemax, ".seq": read_codev}
SUFFIXES = (*_NATIVE_SUFFIXES, *READERS, ".txt")
_STRANGE = {
    ".zar": "a Zemax archive", ".zos": "a binary file of OpticStudio", ".zmf": "a catalogue of lenses of Zemax",
    ".len": "a lens of OSLO or an older CODE V", ".roa": "a model of ray-optics", ".agf": "a catalogue of glasses",
}  # fmt: skip


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
    folder = lenses_dir()
    if f"{name}.yaml" not in _names_in(folder, folder.stat().st_mtime_ns):
        raise _unknown_lens_error(name)
    path = folder / f"{name}.yaml"
    return _read_at(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=2)
def _names_in(folder: Path, modified_ns: int) -> frozenset[str]:
    """Return the names of the files in a folder as it was modified last."""
    return frozenset(file.name for file in folder.iterdir())


@lru_cache(maxsize=64)  # the whole library
def _read_at(path: Path, modified_ns: int) -> Lens:
    """Return the lens of a file of the library as it was modified last."""
    return read_native(read_yaml(path))


def load_lens(
    source: str | Path | Mapping[str, Any], files: References | None = None, catalogues: Sequence[str] = ()
) -> Lens:
    """Return a lens.

    Parameters
    ----------
    source : str, Path or mapping
        A name from `list_lenses`; a path to a lens file: our YAML or JSON, ISET or DeepLens JSON, pbrt ``.dat``,
        Zemax ``.zmx``, CODE V ``.seq`` or Optical Bench ``.txt``; or the content of a file of ours.
    files : References, optional
        Reads the files that the lens names: glass catalogues, coatings. By default they lie in the folder of the lens
        file or below it, for a mapping in the working folder.
    catalogues : sequence of str
        Makers such as ``SCHOTT`` whose glasses come first where a file of Zemax or CODE V names one that several have.

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
        exists = path.exists()
    except (OSError, ValueError):
        exists = False
    if not exists:
        raise _unknown_lens_error(str(source))
    makers = chosen_makers(catalogues)
    try:
        return _read(path, files, makers)
    except InputError as problem:
        if str(path) in str(problem):
            raise
        raise InputError(f"{path}: {problem}") from None


def _read(path: Path, files: References | None, makers: tuple[str, ...]) -> Lens:
    """Return the lens of a file, whosever form it has."""
    suffix = path.suffix.lower()
    if suffix in _NATIVE_SUFFIXES:
        document = replace(read_yaml(path), files=files or References(Folders(path.parent, owner="lens")))
        return _of_document(document, makers)
    if suffix in _NAMING:
        return _NAMING[suffix](_read_text(path), str(path), makers)
    if suffix in READERS:
        return READERS[suffix](_read_text(path), str(path))
    if suffix == ".txt":
        text = _read_text(path)
        return (
            tables.read_optical_bench(text, str(path))
            if tables.is_optical_bench(text)
            else tables.read_pbrt(text, str(path))
        )
    what = f"is {_STRANGE[suffix]}, which cannot be read" if suffix in _STRANGE else "unknown kind of lens file"
    raise InputError(f"{path}: {what}; known: {', '.join(SUFFIXES)}")


def _of_document(document: Document, makers: tuple[str, ...]) -> Lens:
    """Return the lens of a JSON or YAML document, whosever form it has."""
    if tables.is_ray_transfer(document):
        raise InputError(
            f"{document.name}: is an ISET ray transfer: polynomials in place of a lens, with no surfaces to trace"
        )
    if tables.is_deeplens(document):
        return tables.read_deeplens(document, makers)
    return tables.read_iset(document, makers) if tables.is_iset(document) else read_native(document)


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
    with contextlib.suppress(InputError, StateError):  # reported where the lens is used
        load_lens(source, files)
    own = {"": digest(source, MAX_BYTES)} if isinstance(source, Path) else {}
    return own | files.digests()


def _unknown_lens_error(name: str) -> InputError:
    known = list_lenses()
    if names_a_file(name):
        near = difflib.get_close_matches(Path(name).stem, known, n=1, cutoff=0.8)
        return InputError(f"{name}: no such lens file" + (f"; did you mean {near[0]}, of the library?" if near else ""))
    near = _like(name, known)
    hint = f"did you mean {', '.join(near)}?" if near else f"names: {', '.join(known)}"
    return InputError(f"{name}: no such lens file or name; {hint}")


def _like(name: str, known: Sequence[str]) -> list[str]:
    """Return the names of lenses most like one: those with a word and the focal length of it, or with one of both."""
    length = re.search(r"\d+(?:\.\d+)?mm", name)
    words = {word for word in re.split(r"[^a-z]+", name.lower().replace("mm", "")) if len(word) > 2}
    same_words = [other for other in known if words & set(re.split(r"[^a-z]+", other))]
    same_length = [other for other in known if length and other.endswith(f"-{length[0]}")]
    both = [other for other in same_words if other in same_length]
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.75)
    return list(dict.fromkeys((*both, *close, *same_words, *same_length)))[:3] or difflib.get_close_matches(
        name, known, n=3, cutoff=0.4
    )


def _read_text(path: Path) -> str:
    with name_errors(path):
        raw = read_whole(path, MAX_BYTES)
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return raw.decode("utf-16")
        except UnicodeDecodeError as problem:
            raise InputError(f"{path}: is not whole UTF-16 text (byte {problem.start})") from None
    if b"\0" in raw:
        raise InputError(f"{path}: contains NUL bytes; this is not a text file")
    return raw.decode("utf-8-sig", "replace")
