"""Colours of vertices as a picture: two by two texels for each triangle.

The corners of a triangle lie on the centres of three texels. With the fourth as the sum of two less the third,
bilinear interpolation between them is the linear one over the triangle, so that no kernel has to know of such colours.
"""

from __future__ import annotations

import io
import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.file_material import FileTexture
from rptcam_cl.assets.meshes.mesh import MeshSurface
from rptcam_cl.assets.pictures import LARGEST_PIXELS

MOST_TRIANGLES = LARGEST_PIXELS // 4


def painted(surface: MeshSurface, colours: NDArray[np.float32]) -> tuple[MeshSurface, FileTexture]:
    """Return a surface whose triangles share no vertices, and the picture that lies on it.

    Parameters
    ----------
    surface
        Of at most `MOST_TRIANGLES`.
    colours : (n, 3) array
        Of each vertex, linear.
    """
    count = len(surface.faces)
    columns = math.ceil(math.sqrt(count))
    rows = math.ceil(count / columns)
    corners = np.clip(colours, 0, 1)[surface.faces]
    blocks = np.zeros((rows * columns, 2, 2, 3), np.float32)
    blocks[:count, 0, 0], blocks[:count, 0, 1], blocks[:count, 1, 0] = corners[:, 0], corners[:, 1], corners[:, 2]
    blocks[:count, 1, 1] = np.clip(corners[:, 1] + corners[:, 2] - corners[:, 0], 0, 1)
    texels = blocks.reshape(rows, columns, 2, 2, 3).swapaxes(1, 2).reshape(2 * rows, 2 * columns, 3)
    place = np.arange(count)
    left, top = 2 * (place % columns) + 0.5, 2 * (place // columns) + 0.5
    u = np.stack([left, left + 1, left], axis=1) / (2 * columns)
    v = 1 - np.stack([top, top, top + 1], axis=1) / (2 * rows)
    flat = surface.faces.ravel()
    alone = replace(
        surface,
        positions=surface.positions[flat],
        faces=np.arange(3 * count).reshape(-1, 3),
        normals=None if surface.normals is None else surface.normals[flat],
        uvs=np.column_stack([u.ravel(), v.ravel()]),
    )
    return alone, FileTexture(_png(texels), "colours of vertices", wrap="clamp")


def _png(linear: NDArray[np.float32]) -> bytes:
    import PIL.Image

    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    stream = io.BytesIO()
    PIL.Image.fromarray(np.round(255 * encoded).astype(np.uint8)).save(stream, "PNG", compress_level=1)
    return stream.getvalue()
