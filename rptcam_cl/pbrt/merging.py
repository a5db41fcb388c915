"""Meshes of one material put together, for scenes of more objects than a scene file holds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from rptcam_cl.pbrt.mesh import MeshData

# Of the 50 000 values that a scene file may hold (see strict_yaml), with room for what is not objects.
MOST_VALUES = 45_000


def count_values(value: Any) -> int:
    """Return the number of values that a part of a scene takes in a file: lists, mappings, keys and scalars."""
    if isinstance(value, Mapping):
        return 1 + sum(1 + count_values(item) for item in value.values())
    if isinstance(value, list | tuple):
        return 1 + sum(map(count_values, value))
    return count_values(value.tolist()) if isinstance(value, np.ndarray) else 1


def form_of(mesh: MeshData) -> tuple[bool, bool]:
    """Return what meshes must have in common to be put together: normals and texture coordinates."""
    return mesh.normals is not None, mesh.uvs is not None


def joined(meshes: Iterable[MeshData]) -> MeshData:
    """Return meshes of one form as one."""
    parts = list(meshes)
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    normals, uvs = [part.normals for part in parts], [part.uvs for part in parts]
    return MeshData(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        np.concatenate([rows for rows in normals if rows is not None]) if normals[0] is not None else None,
        np.concatenate([rows for rows in uvs if rows is not None]) if uvs[0] is not None else None,
    )
