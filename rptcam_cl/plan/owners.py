"""Whose primitives are: identifiers of objects and materials for the layers, and the names that they stand for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.plan.primitives import Primitive
from rptcam_cl.scene.scene import Scene


@dataclass(frozen=True)
class Owners:
    """Identifiers by primitive, and names by identifier.

    Attributes
    ----------
    of_primitive : (n, 2) array
        Identifier of the object, its index in the scene's list, and of the material.
    objects : tuple of str
        Name of each object; its place in the scene where it has none.
    materials : tuple of str
        Name of each material: first the scene's named ones in their order, then those written out in an object, by
        their place.
    """

    of_primitive: NDArray[np.int32]
    objects: tuple[str, ...]
    materials: tuple[str, ...]


def owners_of(scene: Scene, primitives: Sequence[Primitive]) -> Owners:
    """Return the owners of the primitives of a scene."""
    objects = tuple(item.name or f"objects.{index}" for index, item in enumerate(scene.objects))
    names = list(scene.materials)
    identifiers = {id(material): index for index, material in enumerate(scene.materials.values())}
    rows = np.zeros((max(len(primitives), 1), 2), np.int32)  # as OpenCL has no empty buffers
    for primitive in sorted(primitives, key=lambda primitive: primitive.object):
        if id(primitive.material) not in identifiers:
            identifiers[id(primitive.material)] = len(names)
            names.append(f"objects.{primitive.object}.material")
    for row, primitive in zip(rows, primitives, strict=False):
        row[:] = primitive.object, identifiers[id(primitive.material)]
    return Owners(rows, objects, tuple(names))
