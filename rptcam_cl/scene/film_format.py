"""Film and sensor formats by name: the sides of the picture [mm], the longer first.

Film frames: ISO 1007 (135), ISO 732 (120), SMPTE ST 59 (35 mm cine), SMPTE ST 201 (super 16), 15/70 camera aperture
(imax); sheets at their nominal size. Four Thirds: the system's standard. No standard fixes the size of other sensors,
which are named after tubes or film; theirs are those that makers publish, of the camera named where these differ.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from rptcam_cl.scene.base import AlsoAccepts

SIDES_MM: dict[str, tuple[float, float]] = {
    "8x10_inch": (254.0, 203.2),
    "4x5_inch": (127.0, 101.6),
    "6x9": (84.0, 56.0),
    "6x7": (70.0, 56.0),
    "6x6": (56.0, 56.0),
    "645": (56.0, 41.5),
    "54x40": (53.4, 40.0),  # Phase One IQ4
    "44x33": (43.8, 32.9),  # Fujifilm GFX
    "imax": (70.41, 52.63),
    "full_frame": (36.0, 24.0),
    "aps_h": (27.9, 18.6),  # Canon EOS-1D Mark IV
    "super35": (24.89, 18.66),
    "half_frame": (24.0, 18.0),
    "aps_c": (23.5, 15.6),  # Sony, Nikon
    "aps_c_canon": (22.3, 14.9),  # Canon
    "micro_four_thirds": (17.3, 13.0),
    "super16": (12.52, 7.41),
    "one_inch": (13.2, 8.8),
    "2/3_inch": (8.8, 6.6),
    "1/1.7_inch": (7.44, 5.58),
    "1/1.8_inch": (7.18, 5.32),
    "1/2_inch": (6.4, 4.8),
    "1/2.3_inch": (6.17, 4.55),
    "1/3_inch": (4.8, 3.6),
    "1/4_inch": (3.6, 2.7),
}

_Name = Literal[
    "8x10_inch", "4x5_inch", "6x9", "6x7", "6x6", "645", "54x40", "44x33", "imax", "full_frame", "aps_h", "super35",
    "half_frame", "aps_c", "aps_c_canon", "micro_four_thirds", "super16", "one_inch", "2/3_inch", "1/1.7_inch",
    "1/1.8_inch", "1/2_inch", "1/2.3_inch", "1/3_inch", "1/4_inch",
]  # fmt: skip


def _as_text(value: Any) -> Any:
    """Return the name that YAML reads as a number."""
    return str(value) if value == 645 and not isinstance(value, str) else value


FormatName = Annotated[_Name, BeforeValidator(_as_text), AlsoAccepts({"const": 645})]


def size_in_format(name: str, resolution: tuple[int, int]) -> tuple[float, float]:
    """Return width and height [mm] of the largest picture of square pixels in a format, upright where it is.

    Parameters
    ----------
    name : str
        One of `SIDES_MM`.
    resolution : pair of int
        Width and height [pixels].
    """
    longer, shorter = SIDES_MM[name]
    width, height = resolution
    across, down = (longer, shorter) if width >= height else (shorter, longer)
    pixel = min(across / width, down / height)
    return (width * pixel, height * pixel) if not math.isclose(across * height, down * width) else (across, down)
