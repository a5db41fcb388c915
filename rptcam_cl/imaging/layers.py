"""Auxiliary layers of a picture: what each is called in files, and the check of their arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.cryptomatte import rank_channels

Layer = NDArray[Any]

# EXR channels by layer, as compositors know them: a plain Z is the depth, N the normal.
CHANNELS: dict[str, tuple[str, ...]] = {
    "depth": ("Z",),
    "distance": ("distance.X",),
    "position": ("position.X", "position.Y", "position.Z"),
    "normal": ("N.X", "N.Y", "N.Z"),
    "geometric_normal": ("Ng.X", "Ng.Y", "Ng.Z"),
    "albedo": ("albedo.R", "albedo.G", "albedo.B"),
    "coverage": ("coverage.X",),
    "coc": ("coc.X",),
    "object_id": ("object_id.X",),
    "material_id": ("material_id.X",),
    "uv": ("uv.U", "uv.V"),
    "pupil": ("pupil.X", "pupil.Y"),
    "samples": ("samples.X",),
    "variance": ("variance.Y",),
    "direct": ("direct.R", "direct.G", "direct.B"),
    "ghosts": ("ghosts.R", "ghosts.G", "ghosts.B"),
    "crypto_object": rank_channels("crypto_object"),
    "crypto_material": rank_channels("crypto_material"),
    "sharp_depth": ("sharp.Z",),
    "pupil_depth": ("pupil_depth.Z",),
    "sharp_position": ("sharp_position.X", "sharp_position.Y", "sharp_position.Z"),
    "sharp_normal": ("sharp_N.X", "sharp_N.Y", "sharp_N.Z"),
    "sharp_object_id": ("sharp_object_id.X",),
    "sharp_material_id": ("sharp_material_id.X",),
    "sharp_class_id": ("sharp_class_id.X",),
    "occlusion": ("occlusion.X",),
    "flow_forward": ("forward.u", "forward.v"),
    "flow_backward": ("backward.u", "backward.v"),
    "motion": ("motion.u", "motion.v"),
    "ray_origin": ("ray_origin.X", "ray_origin.Y", "ray_origin.Z"),
    "ray_direction": ("ray_direction.X", "ray_direction.Y", "ray_direction.Z"),
}


def check_layers(layers: Mapping[str, Layer], height: int, width: int) -> None:
    """Refuse layers that are not of a picture of this size.

    Raises
    ------
    InputError
        A layer is not one of `CHANNELS`, or its shape does not fit the picture.
    """
    for name, values in layers.items():
        if name not in CHANNELS:
            raise InputError(f"layers: unknown layer (got {name}; allowed {', '.join(CHANNELS)})")
        count = len(CHANNELS[name])
        shape = (height, width) if count == 1 else (height, width, count)
        if np.shape(values) != shape:
            raise InputError(f"layers: {name}: wrong shape (got {np.shape(values)}; allowed {shape})")


def exr_channels(layers: Mapping[str, Layer]) -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Yield name and values (height, width) of each EXR channel; identifiers are floats there, as readers expect."""
    for name, values in layers.items():
        planes = values[..., None] if values.ndim == 2 else values
        for index, channel in enumerate(CHANNELS[name]):
            yield channel, np.ascontiguousarray(planes[..., index], np.float32)
