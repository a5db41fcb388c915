"""Vertices and triangles of a glTF primitive, from accessors or from data that Draco compressed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.gltf_data import Data
from rptcam_cl.assets.meshes.gltf_json import JsonNode
from rptcam_cl.assets.meshes.gltf_packed import DRACO, draco_arrays

TRIANGLES, STRIP, FAN = 4, 5, 6


class Vertices:
    """What a primitive says of its vertices.

    Raises
    ------
    InputError
        When it is compressed and cannot be read.
    """

    def __init__(self, primitive: JsonNode, data: Data) -> None:
        self._primitive, self._data = primitive, data
        self._attributes = primitive.part("attributes")
        self._faces: NDArray[np.int64] | None = None
        self._unpacked: Mapping[str, NDArray[Any]] = {}
        self._count: int | None = None
        for packed in primitive.extensions(DRACO):
            octets, _ = data.view(packed.whole("bufferView", below=data.views))
            self._faces, self._unpacked = draco_arrays(packed, octets.tobytes())

    def rows(self, key: str, types: tuple[str, ...]) -> NDArray[Any] | None:
        """Return the numbers of an attribute in float32, None when it is not there; the first one says how many."""
        if not self._attributes.has(key):
            return None
        index = self._attributes.whole(key, below=self._data.count)
        if key in self._unpacked:
            rows = self._data.scaled(index, self._unpacked[key])
        else:
            rows = self._data.array(index, types)
        if self._count is None:
            self._count = len(rows)
        if len(rows) != self._count:
            raise self._attributes.wrong(key, f"has {len(rows)} entries", f"{self._count}, as POSITION has")
        return rows.astype(np.float32, copy=False)

    def corners(self, mode: int) -> NDArray[np.int64]:
        """Return the vertices of each triangle (m, 3)."""
        if self._faces is not None:
            return self._faces
        primitive, data = self._primitive, self._data
        if primitive.has("indices"):
            order = data.array(primitive.whole("indices", below=data.count), ("SCALAR",))[:, 0]
            if order.dtype.kind != "u":
                raise primitive.wrong("indices", "are not whole numbers", "an accessor of unsigned numbers")
        else:
            order = np.arange(self._count or 0)
        if mode == TRIANGLES:
            return order[: len(order) // 3 * 3].reshape(-1, 3)
        count = max(0, len(order) - 2)
        first = np.arange(count)
        if mode == FAN:
            return np.stack([order[first * 0], order[first + 1], order[first + 2]], axis=1)
        odd = first % 2
        return np.stack([order[first + odd], order[first + 1 - odd], order[first + 2]], axis=1)
