"""A camera for USD: the text of a layer with one ``UsdGeomCamera`` at the entrance pupil.

Such a camera is a pinhole with an opening: no distortion, and blur by depth alone. Its focal length is that of the
camera model, so that things lie where the model without its distortion has them; focal length / f-stop is the entrance
pupil and the plane of focus is counted from there, so that the blur is that of an ideal lens with this pupil. What USD
cannot say, distortion and the lens itself, is custom data. Lengths are centimetres, because then focal length and
apertures, which USD has in tenths of the unit, are millimetres.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from rptcam_cl.calibration.fit import Calibration
from rptcam_cl.calibration.view import FAR_M, View
from rptcam_cl.cameras import camera_model
from rptcam_cl.lenstools import lens_text

CM_PER_M = 100.0
NEAREST_CM, FARTHEST_CM = 0.1, 1e6  # what is drawn at most: from 1 mm to 10 km


def usd_text(view: View, calibration: Calibration) -> str:
    """Return the layer, as USDA text; a scene can refer to its default prim.

    Raises
    ------
    InputError
        When the lens cannot be written as text.
    """
    fx, fy, cx, cy = calibration.parameters[:4].tolist()
    width, height = view.size
    focal_mm = fx * view.facts()["pixel_mm"][0]
    pupil_mm, focus_m = _opening(view)
    numbers = {
        "focalLength": focal_mm,
        "horizontalAperture": width * focal_mm / fx,
        "verticalAperture": height * focal_mm / fy,  # of a lens that magnifies otherwise down, as it is across
        "horizontalApertureOffset": (width / 2 - cx) * focal_mm / fx,
        "verticalApertureOffset": (cy - height / 2) * focal_mm / fy,
        "fStop": focal_mm / pupil_mm if pupil_mm else 0.0,  # 0 is a pinhole
        "focusDistance": min(focus_m, FAR_M) * CM_PER_M,
    }
    near = max(_first_vertex_cm(view), NEAREST_CM)
    lines = [
        "#usda 1.0",
        "(",
        '    defaultPrim = "Camera"',
        f"    metersPerUnit = {1 / CM_PER_M!r}",
        '    upAxis = "Y"',
        ")",
        "",
        'def Camera "Camera" (',
        *_custom_data(view, calibration),
        ")",
        "{",
        '    token projection = "perspective"',
        *(f"    float {name} = {value!r}" for name, value in numbers.items()),
        f"    float2 clippingRange = ({near!r}, {FARTHEST_CM!r})",
        f"    matrix4d xformOp:transform = ( {', '.join(map(_row, _pose_rows(view)))} )",
        '    uniform token[] xformOpOrder = ["xformOp:transform"]',
        "}",
    ]
    return "\n".join(lines) + "\n"


def _opening(view: View) -> tuple[float, float]:
    """Return the diameter of the entrance pupil [mm] and the distance from it to the plane of focus [m]."""
    if view.setting is None:
        return view.pupil.diameter_mm, camera_model(view.scene).metadata.get("focus_distance_m", math.inf)
    focus_mm = view.setting.focus_distance_mm
    return view.pupil.diameter_mm, math.inf if focus_mm is None else (focus_mm - view.pupil_ahead_mm) * 1e-3


def _first_vertex_cm(view: View) -> float:
    """Return how far ahead of the entrance pupil the lens begins."""
    if view.setting is None:
        return 0.0
    return (view.setting.lens.film_z(view.setting.film_distance_mm) - view.pupil_ahead_mm) / 10


def _pose_rows(view: View) -> list[list[float]]:
    """Return the pose as USD has it: by rows right, up, back and the place [cm]."""
    pose = view.pose()
    pose[:3, 1:3] *= -1.0
    pose[:3, 3] *= CM_PER_M
    rows: list[list[float]] = np.add(pose.T, 0.0).tolist()  # which makes 0 of -0
    return rows


def _row(values: list[float]) -> str:
    return f"({', '.join(map(repr, values))})"


def _custom_data(view: View, calibration: Calibration) -> list[str]:
    """Return the lines of the custom data: the camera model, and the lens with where its film stands."""
    facts = view.facts()
    model = {"model": calibration.model, **calibration.named}
    data: dict[str, Any] = {
        "camera": view.name,
        "width": view.size[0],
        "height": view.size[1],
        "cameraModel": model | {"largestErrorPx": calibration.max_px, "rmsErrorPx": calibration.rms_px},
        "pupilAheadOfEyeMm": view.pupil_ahead_mm,
    }
    if view.setting is not None:
        data |= {
            "focalLengthMm": facts["focal_length_mm"],
            "fNumber": facts["f_number"],
            "filmDistanceMm": view.setting.film_distance_mm,
            "wavelengthNm": view.setting.camera.wavelength_nm,
            "lens": lens_text(view.setting.lens),
        }
    return ["    customData = {", *_dictionary({"rptcam": data}, "        "), "    }"]


def _dictionary(values: dict[str, Any], indent: str) -> list[str]:
    lines = []
    for name, value in values.items():
        if isinstance(value, dict):
            lines += [f"{indent}dictionary {name} = {{", *_dictionary(value, indent + "    "), f"{indent}}}"]
        elif isinstance(value, str):
            lines.append(f"{indent}string {name} = {_string(value)}")
        elif isinstance(value, int):
            lines.append(f"{indent}int {name} = {value}")
        elif value is not None:
            lines.append(f"{indent}double {name} = {value!r}")
    return lines


def _string(text: str) -> str:
    if "\n" not in text:
        return json.dumps(text, ensure_ascii=False)
    return "'''" + text.replace("\\", "\\\\").replace("'", "\\'") + "'''"
