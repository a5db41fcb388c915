"""Mesh files by their suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from rptcam_cl.assets.meshes.contents import Draft, Find, MeshContents, make_contents
from rptcam_cl.core.errors import InputError


def _ply(path: Path, find: Find) -> Draft:
    from rptcam_cl.assets.meshes.ply import read_ply  # no scene imports the readers of formats that it does not have

    return read_ply(path)


def _obj(path: Path, find: Find) -> Draft:
    from rptcam_cl.assets.meshes.obj import read_obj

    return read_obj(path, find)


def _gltf(path: Path, find: Find) -> Draft:
    from rptcam_cl.assets.meshes.gltf import read_gltf

    return read_gltf(path, find)


def _stl(path: Path, find: Find) -> Draft:
    from rptcam_cl.assets.meshes.stl import read_stl

    return Draft([read_stl(path)])


READERS: dict[str, Callable[[Path, Find], Draft]] = {
    ".ply": _ply, ".obj": _obj, ".gltf": _gltf, ".glb": _gltf, ".stl": _stl,
}  # fmt: skip


def read_mesh_file(path: Path, find: Find) -> MeshContents:
    """Return what a mesh file holds.

    Parameters
    ----------
    path : Path
        The file; its suffix gives the format.
    find : callable
        Returns the checked path of a further file that this one names.

    Raises
    ------
    InputError
        When the file does not hold what its format promises, or nothing that can be shown.
    """
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise InputError(f"{path}: is not a mesh file (got {suffix or 'no suffix'}; allowed: {', '.join(READERS)})")
    try:
        if not path.stat().st_size:
            raise InputError(f"{path}: is empty")
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is found by looking at the numbers
            return make_contents(READERS[suffix](path, find), str(path))
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror or problem})") from None
