"""The tree of nodes of a glTF file: which mesh is where."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.mesh_files.gltf_json import Part

# Ratio of the smallest to the largest stretch of a transform that can be inverted in float32 (as for objects).
SMALLEST_STRETCH_RATIO = 1e-6


def placed_meshes(document: Part) -> Iterator[tuple[int, NDArray[np.float64], str | None]]:
    """Yield the meshes of the default scene with their placement and name, parents before children."""
    nodes = document.parts("nodes")
    meshes = len(document.parts("meshes"))
    waiting = [(index, np.eye(4)) for index in reversed(_roots(document, nodes))]
    seen: set[int] = set()
    while waiting:
        index, parent = waiting.pop()
        node = nodes[index]
        if index in seen:
            raise InputError(f"{node.place}: is reached twice (allowed: a tree of nodes)")
        seen.add(index)
        with np.errstate(over="ignore", invalid="ignore"):  # refused where a mesh is shown
            placement = parent @ _matrix(node)
        waiting += [(child, placement) for child in reversed(node.wholes("children", below=len(nodes)))]
        if node.has("mesh") and _can_be_shown(placement, node):
            yield node.whole("mesh", below=meshes), placement, node.text("name") or None


def _roots(document: Part, nodes: list[Part]) -> list[int]:
    scenes = document.parts("scenes")
    if scenes:
        return scenes[document.whole("scene", 0, below=len(scenes))].wholes("nodes", below=len(nodes))
    children = {child for node in nodes for child in node.wholes("children", below=len(nodes))}
    return [index for index in range(len(nodes)) if index not in children]


def _matrix(node: Part) -> NDArray[np.float64]:
    """Return the transform of a node: its matrix (by columns), or scale, then rotation, then translation."""
    if node.has("matrix"):
        matrix = np.array(node.numbers("matrix", (0.0,) * 16)).reshape(4, 4).T
        if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-6):
            raise node.wrong("matrix", "is not affine", "a last row of 0 0 0 1")
        matrix[3] = (0, 0, 0, 1)
        return np.asarray(matrix)
    result = np.eye(4)
    x, y, z, w = node.numbers("rotation", (0.0, 0.0, 0.0, 1.0))
    length = np.sqrt(x * x + y * y + z * z + w * w)
    if not length > 0:
        raise node.wrong("rotation", "is the zero quaternion", "a unit quaternion")
    x, y, z, w = x / length, y / length, z / length, w / length
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    result[:3, :3] = turn * node.numbers("scale", (1.0, 1.0, 1.0))
    result[:3, 3] = node.numbers("translation", (0.0, 0.0, 0.0))
    return result


def _can_be_shown(placement: NDArray[np.float64], node: Part) -> bool:
    """Return whether a mesh has a size there; refuse a place that flattens space."""
    if not np.isfinite(placement).all():
        raise InputError(f"{node.place}: its transform is beyond floating point")
    stretches = np.linalg.svd(placement[:3, :3], compute_uv=False)
    if stretches[0] == 0:
        return False
    if stretches[-1] < SMALLEST_STRETCH_RATIO * stretches[0]:
        allowed = f"stretches whose ratio is at least {SMALLEST_STRETCH_RATIO:g}"
        raise InputError(f"{node.place}: its transform flattens space (allowed: {allowed})")
    return True
