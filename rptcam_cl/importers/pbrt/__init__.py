"""Scene files of pbrt-v3 and pbrt-v4, read and said again as a scene of ours."""

from rptcam_cl.importers.pbrt.convert import Conversion, convert_scene

__all__ = [
    "Conversion",
    "convert_scene",
]
