"""The shape of an aperture for the device: parts to draw points of a thin lens from, or the region of a stop."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.alias import alias_table
from rptcam_cl.errors import InputError
from rptcam_cl.optics import aperture as shapes
from rptcam_cl.optics.aperture import MaskRegion, OutlineRegion
from rptcam_cl.scene import aperture as scene_shapes
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]
LARGEST_MASK = 512  # pixels along a side


def outline_of(aperture: scene_shapes.Aperture) -> Array | None:
    """Return the outline (n, 2) of an aperture of radius 1, or None for a circle or a picture."""
    match aperture:
        case scene_shapes.PolygonAperture():
            outline = shapes.blades(aperture.blades, aperture.curvature)
        case scene_shapes.StarAperture():
            outline = shapes.star(aperture.points, aperture.inner_radius)
        case scene_shapes.HeartAperture():
            outline = shapes.heart()
        case scene_shapes.OutlineAperture():
            outline = shapes.fitted(aperture.points)
        case _:
            return None
    return shapes.turned(outline, aperture.rotation_degrees)


def stop_region(
    scene: Scene, aperture: scene_shapes.Aperture, semi_diameter_mm: float
) -> OutlineRegion | MaskRegion | None:
    """Return the clear region of a stop of a given radius [mm]; None for a circle."""
    if isinstance(aperture, scene_shapes.ImageAperture):
        return MaskRegion(cells=_mask(scene.aperture_file()), half_side=semi_diameter_mm)
    outline = outline_of(aperture)
    if outline is None:
        return None
    shapes.triangles(outline)  # refuses an outline that crosses itself
    return OutlineRegion(vertices=tuple((float(x), float(y)) for x, y in outline * semi_diameter_mm))


def aperture_parts(scene: Scene, aperture: scene_shapes.Aperture) -> tuple[NDArray[np.float32], dict[str, int]]:
    """Return the parts of an aperture of radius 1 and the facts for `kernels/camera/aperture.h`.

    A part is eight floats: a corner, two edges from it, and its cell of the alias table that picks parts by their area.
    """
    if isinstance(aperture, scene_shapes.ImageAperture):
        cells = _mask(scene.aperture_file())
        size = 2.0 / len(cells)
        row, column = np.nonzero(cells)
        corner = np.stack([-1 + column * size, 1 - (row + 1) * size], axis=1)
        edges = np.broadcast_to([size, 0.0, 0.0, size], (len(corner), 4))
        return _table(corner, edges, np.ones(len(corner))), {"APERTURE_PARTS": len(corner), "APERTURE_TRIANGLES": 0}
    outline = outline_of(aperture)
    if outline is None:
        return np.zeros(1, np.float32), {"APERTURE_PARTS": 0, "APERTURE_TRIANGLES": 0}
    parts = shapes.triangles(outline)
    first, second = parts[:, 1] - parts[:, 0], parts[:, 2] - parts[:, 0]
    areas = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    table = _table(parts[:, 0], np.concatenate([first, second], axis=1), areas)
    return table, {"APERTURE_PARTS": len(parts), "APERTURE_TRIANGLES": 1}


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
