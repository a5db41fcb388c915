"""The sky: constant light and pictures of the surroundings."""

from __future__ import annotations

from rptcam_cl.pbrt.context import Context
from rptcam_cl.pbrt.frame import Frame
from rptcam_cl.pbrt.lights import Keys, Lights


def convert_sky(context: Context, frame: Frame, lights: Lights) -> Keys | None:
    """Return the environment of a scene of ours, None for a black one."""
    for entity in lights.maps:
        context.report.ignored(entity.place, f"{entity.what}: the picture of the sky")
    return {"kind": "constant", "radiance": lights.sky.tolist()} if lights.sky.any() else None
