"""Points on the surfaces of a scene that its lamps may light, for the choice of how light sampling picks a lamp."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.records import Kind
from rptcam_cl.plan.light_tree import Lamps
from rptcam_cl.plan.primitives import Primitive

Array = NDArray[np.float64]

MESH_POINTS = 16  # vertices of a mesh
# Of the canonical shapes of the flat kinds; of others the middle.
PLACES = {
    Kind.RECTANGLE: [[0.5, 0.5, 0.0], [0.2, 0.2, 0.0], [0.8, 0.2, 0.0], [0.2, 0.8, 0.0], [0.8, 0.8, 0.0]],
    Kind.DISK: [[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [-0.6, 0.0, 0.0], [0.0, 0.6, 0.0], [0.0, -0.6, 0.0]],
    Kind.CYLINDER: [[0.0, 0.0, 0.5]],
    Kind.CONE: [[0.0, 0.0, 0.5]],
}


def lit_points(
    primitives: Sequence[Primitive], lamps_of_primitive: Mapping[int, int], lamps: Lamps, eye: Array
) -> Array:
    """Return points (n, 3) [m about the eye] of what is no lamp itself; of a plane the foot of each lamp.

    Parameters
    ----------
    primitives
        Of the scene.
    lamps_of_primitive
        Has those that are lamps as keys.
    lamps
        The lamps.
    eye
        Position of the eye in the scene [m].
    """
    parts = [
        part
        for index, primitive in enumerate(primitives)
        if index not in lamps_of_primitive
        for part in _points(primitive, lamps, eye)
    ]
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def _points(primitive: Primitive, lamps: Lamps, eye: Array) -> Iterator[Array]:
    linear, origin = primitive.placement[:3, :3], primitive.placement[:3, 3]
    if primitive.mesh is not None:
        mesh = primitive.mesh
        some = mesh.positions[:: -(-len(mesh.positions) // MESH_POINTS)]
        yield (some + mesh.origin) @ linear.T + (origin - eye)
    elif primitive.kind is Kind.PLANE:
        normal = np.linalg.inv(linear)[2]
        normal /= np.linalg.norm(normal)
        yield lamps.middle - ((lamps.middle - origin) @ normal)[:, None] * normal
    else:
        yield np.array(PLACES.get(primitive.kind, [[0.0, 0.0, 0.0]])) @ linear.T + origin
