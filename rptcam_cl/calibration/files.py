"""Camera models as files of other programs: OpenCV, ROS, COLMAP, OpenTrackIO (OpenLensIO), and JSON with everything.

OpenCV and ROS count from the centre of the first pixel, so that their cx and cy are half a pixel smaller than ours;
COLMAP counts from its corner, as we do. Poses are from the world of the scene to x right, y down, z ahead at the
entrance pupil.
"""

from __future__ import annotations

import json
import math
import uuid
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.calibration.fit import Calibration
from rptcam_cl.calibration.models import BY_ANGLE
from rptcam_cl.calibration.osl import osl_text
from rptcam_cl.calibration.usd import usd_text
from rptcam_cl.calibration.view import View
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene import quaternion_of

Array = NDArray[np.float64]

PIXEL_CENTRE = 0.5  # of the first pixel, as we and COLMAP count; OpenCV and ROS call it 0
ROS = {
    "pinhole": "plumb_bob",
    "brown_conrady": "plumb_bob",
    "rational": "rational_polynomial",
    BY_ANGLE: "equidistant",
}
COLMAP = {"pinhole": "PINHOLE", "brown_conrady": "FULL_OPENCV", "rational": "FULL_OPENCV", BY_ANGLE: "OPENCV_FISHEYE"}
ALL = ("pinhole", "brown_conrady", "rational", "thin_prism", BY_ANGLE)
HELD: dict[str, tuple[str, ...]] = {
    "opencv": ALL,
    "ros": tuple(ROS),
    "colmap": tuple(COLMAP),
    "openlensio": ("pinhole", "brown_conrady", "rational"),
    "usd": ALL,
    "osl": ALL,
}
OPENTRACKIO_VERSION = [1, 0, 1]
LONGEST_NAME = 1023  # characters, by its schema
SAME_FOCUS = 1e-3  # share by which fx and fy may differ [mm] where a file has one focal length


def check_held(form: str, model: str) -> None:
    """Refuse a camera model that a kind of file cannot say."""
    if model not in HELD[form]:
        raise InputError(f"--{form}: such a file cannot say {model} (allowed: {', '.join(HELD[form])})")


def _opencv_matrix(view: View, calibration: Calibration) -> list[float]:
    fx, fy, cx, cy = calibration.parameters[:4].tolist()
    return [fx, 0.0, cx - PIXEL_CENTRE, 0.0, fy, cy - PIXEL_CENTRE, 0.0, 0.0, 1.0]


def _camera_from_world(view: View) -> Array:
    return np.asarray(np.linalg.inv(view.pose()))


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(repr(float(value)) for value in values)


def _about(view: View, calibration: Calibration) -> str:
    return (
        f"{view.name}: {calibration.model}, errs by {calibration.max_px:.3g} px at most,"
        f" rms {calibration.rms_px:.3g} px, {object_text(view)}; pose at the entrance pupil,"
        f" {view.pupil_ahead_mm:.4f} mm ahead of the eye"
    )


def object_text(view: View) -> str:
    """Return what a view's models are fitted to; at other distances they err by the drift of the pupil."""
    shape = view.object_shape
    if shape is None:
        return "for objects far away"
    return f"for a {shape} {view.distance_m:.6g} m from the entrance pupil"


def opencv_text(view: View, calibration: Calibration) -> str:
    """Return the file for OpenCV's FileStorage; `fisheye_model: 1` is for its module fisheye."""
    coefficients = calibration.coefficients or [0.0] * 5
    pose = _camera_from_world(view)

    def matrix(name: str, rows: int, columns: int, values: Sequence[float]) -> list[str]:
        shape = [f"   rows: {rows}", f"   cols: {columns}", "   dt: d"]
        return [f"{name}: !!opencv-matrix", *shape, f"   data: [ {_numbers(values)} ]"]

    lines = [
        "%YAML:1.0",
        "---",
        f"# {_about(view, calibration)}",
        "# pixels count from the centre of the first one, as OpenCV does",
        f"image_width: {view.size[0]}",
        f"image_height: {view.size[1]}",
        f"fisheye_model: {int(calibration.model == BY_ANGLE)}",
        *matrix("camera_matrix", 3, 3, _opencv_matrix(view, calibration)),
        *matrix("distortion_coefficients", 1, len(coefficients), coefficients),
        f"avg_reprojection_error: {calibration.rms_px!r}",
        f"max_reprojection_error: {calibration.max_px!r}",
        *matrix("rotation", 3, 3, pose[:3, :3].ravel().tolist()),
        *matrix("translation", 3, 1, pose[:3, 3].tolist()),
    ]
    return "\n".join(lines) + "\n"


def ros_text(view: View, calibration: Calibration) -> str:
    """Return the file of `camera_info` of ROS; its frame is the optical one at the entrance pupil."""
    matrix = _opencv_matrix(view, calibration)
    coefficients = calibration.coefficients or [0.0] * 5
    projection = [*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0]

    def block(name: str, rows: int, columns: int, values: Sequence[float]) -> list[str]:
        return [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: [{_numbers(values)}]"]

    lines = [
        f"# {_about(view, calibration)}",
        f"image_width: {view.size[0]}",
        f"image_height: {view.size[1]}",
        f"camera_name: {_plain_name(view.name)}",
        *block("camera_matrix", 3, 3, matrix),
        f"distortion_model: {ROS[calibration.model]}",
        *block("distortion_coefficients", 1, len(coefficients), coefficients),
        *block("rectification_matrix", 3, 3, np.eye(3).ravel().tolist()),
        *block("projection_matrix", 3, 4, projection),
    ]
    return "\n".join(lines) + "\n"


def _plain_name(name: str) -> str:
    return "_".join("".join(c if c.isascii() and c.isalnum() else " " for c in name).split()) or "camera"


def colmap_texts(view: View, calibration: Calibration, picture: str) -> dict[str, str]:
    """Return the text files of a COLMAP model with one camera, one picture of a name, and no points."""
    coefficients = calibration.coefficients
    if calibration.model == "brown_conrady":
        coefficients = [*coefficients, 0.0, 0.0, 0.0]
    width, height = view.size
    values = " ".join(repr(value) for value in [*calibration.parameters[:4].tolist(), *coefficients])
    pose = _camera_from_world(view)
    x, y, z, w = quaternion_of(pose[:3, :3]).tolist()
    turn = " ".join(repr(value) for value in (w, x, y, z))
    move = " ".join(repr(value) for value in pose[:3, 3].tolist())
    return {
        "cameras.txt": f"# {_about(view, calibration)}\n# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
        f"1 {COLMAP[calibration.model]} {width} {height} {values}\n",
        "images.txt": "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then POINTS2D[] of it\n"
        f"1 {turn} {move} 1 {picture}\n\n",
        "points3D.txt": "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n",
    }


def openlensio_text(view: View, calibration: Calibration) -> str:
    """Return a sample of OpenTrackIO, whose lens is by the model of OpenLensIO 1.0 (2025): coefficients per millimetre.

    Radial coefficients alternate between numerator and denominator (its equation 17), and the offset of the distortion
    counts from that of the projection (equation 15). Its world is right-handed with z up; ours has y up, so that
    x, y, z become x, -z, y.

    Raises
    ------
    InputError
        When pixels are not square on the film, as OpenLensIO knows one focal length.
    """
    facts = view.facts()
    pixel_mm = facts["pixel_mm"]
    lens = _openlensio_lens(view, calibration, pixel_mm)
    if facts.get("f_number"):
        lens["fStop"] = facts["f_number"]
    if facts.get("focus_distance_m"):
        lens["focusDistance"] = facts["focus_distance_m"]
    text = json.dumps([facts["world_from_camera"], calibration.parameters.tolist()])
    sample = {
        "protocol": {"name": "OpenTrackIO", "version": OPENTRACKIO_VERSION},
        "sampleId": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_OID, text)}",
        "static": {
            "camera": {
                "activeSensorPhysicalDimensions": {
                    "width": view.size[0] * pixel_mm[0],
                    "height": view.size[1] * pixel_mm[1],
                },
                "activeSensorResolution": {"width": view.size[0], "height": view.size[1]},
            },
            "lens": {"model": view.name[:LONGEST_NAME]},
        },
        "lens": lens,
        "transforms": [_transform(view)],
    }
    return json.dumps(sample, indent=2, ensure_ascii=False) + "\n"


def _openlensio_lens(view: View, calibration: Calibration, pixel_mm: list[float]) -> dict[str, Any]:
    """Return the lens of `openlensio_text`: focal length, offsets and distortion."""
    focal = [value * mm for value, mm in zip(calibration.parameters[:2].tolist(), pixel_mm, strict=True)]
    if abs(focal[0] - focal[1]) > SAME_FOCUS * focal[0]:
        raise InputError(
            f"--openlensio: {view.name} has another focal length across ({focal[0]:.4f} mm)"
            f" than down ({focal[1]:.4f} mm); such a file holds one"
        )
    focal_mm = (focal[0] + focal[1]) / 2
    named = calibration.named
    offset = [
        (centre - side / 2) * mm
        for centre, side, mm in zip(calibration.parameters[2:4].tolist(), view.size, pixel_mm, strict=True)
    ]
    return {
        "pinholeFocalLength": focal_mm,
        "entrancePupilOffset": view.pupil_ahead_mm * 1e-3,
        "projectionOffset": {"x": offset[0], "y": offset[1]},
        "distortionOffset": {"x": 0.0, "y": 0.0},
        "distortion": [
            {
                "model": "Brown-Conrady U-D",
                "radial": [
                    named.get(f"k{k}", 0.0) / focal_mm ** (2 * power) for power in (1, 2, 3) for k in (power, power + 3)
                ],
                "tangential": [named.get(name, 0.0) / focal_mm**2 for name in ("p1", "p2")],
            }
        ],
    }


def _transform(view: View) -> dict[str, Any]:
    """Return the pose of the film's plane: z up, the camera ahead along y; pan, tilt and roll [degrees]."""
    pose = view.pose()
    swap = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    right, down, ahead = (swap @ pose[:3, k] for k in range(3))
    place = swap @ pose[:3, 3] - ahead * view.pupil_ahead_mm * 1e-3
    level = math.hypot(ahead[0], ahead[1])
    pan, tilt = math.atan2(-ahead[0], ahead[1]), math.atan2(ahead[2], level)
    flat = np.array([math.cos(pan), math.sin(pan), 0.0])  # where right points without roll
    roll = math.atan2(-float(flat @ down), float(flat @ right))  # about the view, by the right-hand rule
    return {
        "id": "Camera",
        "translation": dict(zip("xyz", place.tolist(), strict=True)),
        "rotation": {"pan": math.degrees(pan), "tilt": math.degrees(tilt), "roll": math.degrees(roll)},
    }


def document(view: View, calibrations: Sequence[Calibration], refused: dict[str, str]) -> dict[str, Any]:
    """Return everything for JSON: the camera, and each model with its residual, or why it does not fit."""
    facts, drift = view.facts(), view.drift_by_angle()
    if drift is not None:
        degrees, ahead_mm = (values.tolist() for values in drift)
        facts["entrance_pupil"] |= {"drift_by_angle": {"degrees": degrees, "ahead_mm": ahead_mm}}
    return {
        **facts,
        "object_shape": view.object_shape,
        "pixel_centre": PIXEL_CENTRE,
        "conventions": {
            "pixels": "from the left and top edges of the picture: the first pixel covers 0 to 1, its centre is 0.5",
            "axes": "x right, y down, z ahead; world_from_camera by rows [m], at the entrance pupil",
        },
        "models": {
            found.model: {
                **found.named,
                "max_px": found.max_px,
                "rms_px": found.rms_px,
                "lit_share": found.lit_share,
            }
            for found in calibrations
        },
        **({"refused": refused} if refused else {}),
    }


WRITTEN: dict[str, Callable[[View, Calibration], str]] = {
    "opencv": opencv_text,
    "ros": ros_text,
    "openlensio": openlensio_text,
    "usd": usd_text,
    "osl": lambda view, _: osl_text(view),  # the lens itself
}
