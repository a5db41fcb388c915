"""The shape of an aperture for the device: tables to draw points of a thin lens from, or the shape of a stop."""

from __future__ import annotations

import io
import struct
import warnings
import zlib

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.curves import curves
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.references import read_whole
from rptcam_cl.optics import StopMask, StopShape, blades, fitted, heart, polygon, star
from rptcam_cl.scene import Scene
from rptcam_cl.scene import lens_settings as scene_shapes

LARGEST_MASK = 512  # pixels along a side
LARGEST_FILE = 16_000_000  # bytes

# What Pillow raises on damaged pictures.
DAMAGED = (OSError, SyntaxError, ValueError, TypeError, KeyError, IndexError, EOFError, OverflowError, MemoryError,
           struct.error, zlib.error)  # fmt: skip


def stop_shape(scene: Scene, aperture: scene_shapes.Aperture) -> StopShape | StopMask | None:
    """Return the shape of an aperture of radius 1; None for a circle.

    Raises
    ------
    InputError
        When an outline crosses itself, or a picture cannot be used as a mask.
    """
    match aperture:
        case scene_shapes.PolygonAperture():
            return blades(aperture.blades, aperture.rotation_degrees, aperture.curvature)
        case scene_shapes.StarAperture():
            return star(aperture.points, aperture.inner_radius, aperture.rotation_degrees)
        case scene_shapes.HeartAperture():
            return heart(aperture.rotation_degrees)
        case scene_shapes.OutlineAperture():
            return polygon(fitted(aperture.points), aperture.rotation_degrees)
        case scene_shapes.ImageAperture():
            return StopMask(_mask(scene, aperture))
    return None


def aperture_tables(scene: Scene, aperture: scene_shapes.Aperture) -> tuple[NDArray[np.float32], dict[str, int]]:
    """Return the tables of an aperture of radius 1 and its facts, both as `kernels/lens/aperture.h` describes them."""
    shape = stop_shape(scene, aperture)
    facts = {"APERTURE_PARTS": 0, "APERTURE_ROWS": 0}
    if shape is None:
        return np.zeros(1, np.float32), facts
    if isinstance(shape, StopMask):
        cells = shape.cells[::-1].astype(np.float64)
        tables = np.concatenate([curves(cells.sum(axis=1)[None])[0], curves(cells)[0]])
        return tables.ravel(), facts | {"APERTURE_ROWS": len(cells)}
    apex, first, second = (shape.triangles[:, k] for k in range(3))
    corners = np.concatenate([apex, first - apex, second - first], axis=1).astype(np.float32)
    curve, _ = curves(shape.triangle_areas[None])
    return np.concatenate([curve.ravel(), corners.ravel()]), facts | {"APERTURE_PARTS": len(corners)}


def _mask(scene: Scene, aperture: scene_shapes.ImageAperture) -> NDArray[np.bool_]:
    """Return the open cells of a mask picture."""
    from PIL import Image, UnidentifiedImageError

    where = aperture.place.rstrip(": ")
    try:
        content = read_whole(scene.content_of(aperture), LARGEST_FILE)
    except (InputError, StateError) as problem:
        raise type(problem)(f"{where}: {problem}") from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with Image.open(io.BytesIO(content), formats=["PNG", "JPEG", "TIFF"]) as picture:
                if picture.width != picture.height or picture.width > LARGEST_MASK:
                    raise InputError(
                        f"{where}: is {picture.width} x {picture.height} pixels"
                        f" (allowed: square, at most {LARGEST_MASK} x {LARGEST_MASK})"
                    )
                grey = np.asarray(picture.convert("L"))
    except (*DAMAGED, UnidentifiedImageError, Image.DecompressionBombError, Warning) as problem:
        raise InputError(f"{where}: is not a readable PNG, JPEG or TIFF picture ({problem})") from None
    cells = grey > 127
    if not cells.any():
        raise InputError(f"{where}: is dark everywhere, so no light passes (allowed: some pixels brighter than half)")
    return np.asarray(cells)
