"""Maps of a lens as files: float32 OpenEXR pictures and NumPy archives, with what they are in their headers."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.calibration.point_images import PointImages
from rptcam_cl.calibration.stmap import StMaps
from rptcam_cl.calibration.view import View
from rptcam_cl.core.atomic import utf8_name

Pixels = NDArray[np.float32]


def _write_exr(path: Path, channels: Mapping[str, Pixels], said: Mapping[str, Any]) -> None:
    import OpenEXR

    header: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header |= {key: value if isinstance(value, str) else json.dumps(value) for key, value in said.items()}
    named = {name: np.ascontiguousarray(values, np.float32) for name, values in channels.items()}
    with OpenEXR.File(header, named) as file, utf8_name(path) as name:
        file.write(name)


def st_exr(view: View, maps: StMaps, which: Literal["distort", "undistort"], path: Path) -> None:
    """Write one of the ST maps: channels R and G are u and v, B is 1 where they hold."""
    said = {"stmap": which, "lens": view.name, **maps.facts()}
    _write_exr(path, {"RGB": maps.distort if which == "distort" else maps.undistort}, said)


def vignetting_exr(view: View, values: Pixels, path: Path) -> None:
    """Write a vignetting map: channel Y is the light of a pixel over that on the axis."""
    _write_exr(path, {"Y": values}, {"lens": view.name, "map": "vignetting"})


def coc_exr(view: View, values: Pixels, distances_m: Sequence[float], path: Path) -> None:
    """Write circles of confusion [pixels], a channel `coc.K` for each distance; the header has null for far away."""
    channels = {f"coc.{k}": plane for k, plane in enumerate(values)}
    away = [distance if math.isfinite(distance) else None for distance in distances_m]  # JSON has no infinity
    _write_exr(path, channels, {"lens": view.name, "map": "circle of confusion [px]", "distances_m": away})


def psf_npz(images: PointImages) -> bytes:
    """Return point images as a NumPy archive."""
    out = io.BytesIO()
    np.savez_compressed(out, **images.arrays())  # type: ignore[arg-type]
    return out.getvalue()
