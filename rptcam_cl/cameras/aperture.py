"""The shape of an aperture for the device: parts to draw points of a thin lens from, or the shape of a stop."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.alias import alias_table
from rptcam_cl.errors import InputError
from rptcam_cl.optics.stop_shape import StopMask, StopShape, blades, fitted, heart, polygon, star
from rptcam_cl.scene import aperture as scene_shapes
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]
LARGEST_MASK = 512  # pixels along a side


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
            return StopMask(_mask(scene.aperture_file()))
    return None


def aperture_parts(scene: Scene, aperture: scene_shapes.Aperture) -> tuple[NDArray[np.float32], dict[str, int]]:
    """Return the parts of an aperture of radius 1 and the facts for `kernels/lens/aperture.h`.

    A part is eight floats: a corner, two edges from it, and its cell of the alias table that picks parts by their area.
    """
    shape = stop_shape(scene, aperture)
    if shape is None:
        return np.zeros(1, np.float32), {"APERTURE_PARTS": 0, "APERTURE_TRIANGLES": 0}
    if isinstance(shape, StopMask):
        size = 2.0 / len(shape.cells)
        row, column = np.nonzero(shape.cells)
        corner = np.stack([-1 + column * size, 1 - (row + 1) * size], axis=1)
        edges = np.broadcast_to([size, 0.0, 0.0, size], (len(corner), 4))
        return _table(corner, edges, np.ones(len(corner))), {"APERTURE_PARTS": len(corner), "APERTURE_TRIANGLES": 0}
    corner, first, second = (shape.triangles[:, k] for k in range(3))
    table = _table(corner, np.concatenate([first - corner, second - corner], axis=1), shape.triangle_areas)
    return table, {"APERTURE_PARTS": len(corner), "APERTURE_TRIANGLES": 1}


def _table(corner: Array, edges: Array, areas: Array) -> NDArray[np.float32]:
    keep, other = alias_table(areas)
    return np.concatenate([corner, edges, np.stack([keep, other], axis=1)], axis=1).astype(np.float32).ravel()


def _mask(path: Path) -> NDArray[np.bool_]:
    """Return the open cells of a mask picture."""
    from PIL import Image, UnidentifiedImageError

    where = f"camera.aperture.file: {path.name}"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with Image.open(path, formats=["PNG", "JPEG", "TIFF"]) as picture:
                if picture.width != picture.height or picture.width > LARGEST_MASK:
                    raise InputError(
                        f"{where}: is {picture.width} x {picture.height} pixels"
                        f" (allowed: square, at most {LARGEST_MASK} x {LARGEST_MASK})"
                    )
                grey = np.asarray(picture.convert("L"))
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError, Warning, ValueError, SyntaxError) as problem:
        raise InputError(f"{where}: is not a readable PNG, JPEG or TIFF picture ({problem})") from None
    cells = grey > 127
    if not cells.any():
        raise InputError(f"{where}: is dark everywhere, so no light passes (allowed: some pixels brighter than half)")
    return np.asarray(cells)
