"""Lenses by name, by file or from a mapping."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
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
from rptcam_cl.resources import lenses_dir
from rptcam_cl.strict_yaml import MAX_BYTES, read_yaml

NATIVE_SUFFIXES = (".yaml", ".yml", ".json")
READERS: dict[str, Callable[[str, str], Lens]] = {".dat": read_pbrt, ".zmx": read_zemax, ".seq": read_codev}


def list_lenses() -> list[str]:
    """Return the names of the lenses that come with the package, sorted."""
    return sorted(path.stem for path in lenses_dir().glob("*.yaml"))


def load_lens(source: str | Path | Mapping[str, Any]) -> Lens:
    """Return a lens.

    Parameters
    ----------
    source : str, Path or mapping
        A name from `list_lenses`; a path to a lens file: our YAML or JSON, ISET JSON, pbrt ``.dat``, Zemax ``.zmx``,
        CODE V ``.seq`` or Optical Bench ``.txt``; or the content of a file of ours.
    """
    if isinstance(source, Mapping):
        return read_native(document_of(source))
    if isinstance(source, str) and source in list_lenses():
        return read_native(read_yaml(lenses_dir() / f"{source}.yaml"))
    path = Path(source)
    try:
        found = path.exists()
    except (OSError, ValueError):
        found = False
    if not found:
        raise _unknown(str(source))
    suffix = path.suffix.lower()
    if suffix in NATIVE_SUFFIXES:
        document = read_yaml(path)
        return read_iset(document) if is_iset(document) else read_native(document)
    if suffix in READERS:
        return READERS[suffix](_read_text(path), str(path))
    if suffix == ".txt":
        text = _read_text(path)
        return read_optical_bench(text, str(path)) if is_optical_bench(text) else read_pbrt(text, str(path))
    known = ", ".join([*NATIVE_SUFFIXES, *READERS, ".txt"])
    raise InputError(f"{path}: unknown kind of lens file; known: {known}")


def _unknown(name: str) -> InputError:
    known = list_lenses()
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
    hint = f"did you mean {', '.join(near)}?" if near else f"names: {', '.join(known)}"
    return InputError(f"{name}: no such lens file or name; {hint}")


def _read_text(path: Path) -> str:
    try:
        if not path.is_file():
            raise InputError(f"{path}: is not a regular file")
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: is larger than {MAX_BYTES} bytes")
        raw = path.read_bytes()
    except OSError as problem:
        raise StateError(f"{path}: cannot be read ({problem.strerror})") from problem
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16")
    if b"\0" in raw:
        raise InputError(f"{path}: contains NUL bytes; this is not a text file")
    return raw.decode("utf-8-sig", "replace")
