"""Mesh files by their suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from rptcam_cl.assets.meshes.contents import Draft, Find, MeshContents, make_contents
from rptcam_cl.assets.meshes.gltf import read_gltf
from rptcam_cl.assets.meshes.obj import read_obj
from rptcam_cl.assets.meshes.ply import read_ply
from rptcam_cl.assets.meshes.stl import read_stl
from rptcam_cl.core.errors import InputError

READERS: dict[str, Callable[[Path, Find], Draft]] = {
    ".ply": lambda path, _: read_ply(path),
    ".obj": read_obj,
    ".gltf": read_gltf,
    ".glb": read_gltf,
    ".stl": lambda path, _: Draft([read_stl(path)]),
}


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
