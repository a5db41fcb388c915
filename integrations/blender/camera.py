"""Blender's camera as the film and camera of a scene: sensor, fit, shift, focus; a real lens where one is chosen.

Blender's camera looks along −z of its object with +y up, as ours does, and stands at its centre of projection.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError

from .report import Report

Matrix = NDArray[np.float64]

SHOWN_CLIP = 0.101  # above the clip start of new cameras [units]: a greater one was chosen to be seen
NO_STOP = 1e-6  # an opening narrower than this is a pinhole's [m]


@dataclass(frozen=True)
class BlenderCamera:
    """What Blender's camera says, in its own units.

    Attributes
    ----------
    matrix : (4, 4) array
        World from camera, where the shutter opens.
    lens_mm, sensor_mm, sensor_fit, shift
        Focal length, (width, height) of the sensor, ``AUTO``, ``HORIZONTAL`` or ``VERTICAL``, and the shift in parts of
        the side that the sensor's size spans.
    kind : str
        ``PERSP``, ``ORTHO`` or ``PANO``.
    ortho_scale : float
        Length [units] that an orthographic picture shows along the side that `sensor_fit` names.
    f_stop : float or None
        None without depth of field.
    focus_distance : float
        Along the axis [units].
    blades, blades_rotation, ratio
        Corners of the opening, its turn [radians], and its width over its height.
    clip_start : float
        Nearest depth [units] that is seen.
    matrix_end : (4, 4) array or None
        World from camera where the shutter closes, if it moves.
    panorama : str
        Kind of panorama, as Blender names it.
    clip_end : float
        Farthest depth [units] that Blender shows.
    """

    matrix: Matrix
    lens_mm: float = 50.0
    sensor_mm: tuple[float, float] = (36.0, 24.0)
    sensor_fit: str = "AUTO"
    shift: tuple[float, float] = (0.0, 0.0)
    kind: str = "PERSP"
    ortho_scale: float = 6.0
    f_stop: float | None = None
    focus_distance: float = 10.0
    blades: int = 0
    blades_rotation: float = 0.0
    ratio: float = 1.0
    clip_start: float = 0.0
    matrix_end: Matrix | None = None
    panorama: str = "EQUIRECTANGULAR"
    clip_end: float = math.inf


@dataclass(frozen=True)
class Frame:
    """The picture: its size [pixels], the aspect of pixels, and the border (left, right, bottom, top) as fractions."""

    resolution: tuple[int, int]
    pixel_aspect: tuple[float, float] = (1.0, 1.0)
    border: tuple[float, float, float, float] | None = None
    transparent: bool = False

    def window(self) -> tuple[int, int, int, int]:
        """Left, right, bottom and top of the border [pixels], as Blender rounds them."""
        width, height = self.resolution
        if self.border is None:
            return 0, width, 0, height
        left, right, bottom, top = (np.float32(share) for share in self.border)  # Blender's arithmetic
        x0, x1 = int(left * np.float32(width)), int(right * np.float32(width))
        y0, y1 = int(bottom * np.float32(height)), int(top * np.float32(height))
        return x0, max(x1, x0 + 1), y0, max(y1, y0 + 1)


@dataclass(frozen=True)
class LensChoice:
    """The panel's settings of a real lens; without `lens` Blender's own camera is rendered.

    Attributes
    ----------
    lens : str or dict
        Name in the library, or a file, or the keys of a copy of one; empty for none.
    f_number : float or None
        None leaves the stop as the lens file has it.
    match_field : bool
        Whether the film is made larger or smaller until the lens shows what Blender's camera shows.
    focal_length_mm : float
        Of the lens, for that.
    autofocus : str
        Method, or empty for Blender's focus distance.
    keys : dict
        Further keys of the camera, as ``diffraction`` and ``ghosts``.
    """

    lens: str | dict[str, Any] = ""
    f_number: float | None = None
    match_field: bool = False
    focal_length_mm: float = 50.0
    autofocus: str = ""
    keys: dict[str, Any] = field(default_factory=dict)


def film_size_mm(camera: BlenderCamera, frame: Frame) -> tuple[tuple[float, float], float]:
    """Width and height of the picture on the sensor [mm], and the side that counts for fit and shift [mm]."""
    width, height = (side * aspect for side, aspect in zip(frame.resolution, frame.pixel_aspect, strict=True))
    fit = camera.sensor_fit
    if fit == "AUTO":
        fit = "HORIZONTAL" if width >= height else "VERTICAL"
    side = camera.sensor_mm[1] if camera.sensor_fit == "VERTICAL" else camera.sensor_mm[0]
    pixel = side / (width if fit == "HORIZONTAL" else height)
    return (width * pixel, height * pixel), side


def camera_keys(
    camera: BlenderCamera, frame: Frame, choice: LensChoice, metres_per_unit: float, report: Report
) -> dict[str, Any]:
    """The scene's ``film`` and ``camera``."""
    size, side = film_size_mm(camera, frame)
    film: dict[str, Any] = {"resolution": list(frame.resolution), "size_mm": list(size)}
    if frame.transparent:
        film["transparent"] = True
    if frame.border is not None:
        x0, x1, y0, y1 = frame.window()
        width, height = frame.resolution
        film["crop"] = [x0 / width, x1 / width, 1 - y1 / height, 1 - y0 / height]
    if choice.lens:
        return _through_lens(camera, film, side, choice, report)
    if camera.kind == "PANO":
        return {"film": film, "camera": _panorama(camera, frame)}
    if camera.kind == "ORTHO":
        return {"film": film, "camera": _orthographic(camera, film, side, metres_per_unit)}
    return {"film": film, "camera": _ideal(camera, film, side, metres_per_unit, report)}


def pose(matrix: Matrix, distance: float = 1.0) -> dict[str, list[float]]:
    """Eye, target at a distance [units], and up of a camera."""
    up, back = (matrix[:3, i] / np.linalg.norm(matrix[:3, i]) for i in (1, 2))
    eye = matrix[:3, 3]
    return {"eye": eye.tolist(), "target": (eye - distance * back).tolist(), "up": up.tolist()}


def _posed(camera: BlenderCamera, distance: float = 1.0) -> dict[str, Any]:
    return dict(pose(camera.matrix, distance))


def keyframes(camera: BlenderCamera, open_s: float, close_s: float) -> list[dict[str, Any]]:
    """Keyframes of a camera that moves while the shutter is open."""
    if camera.matrix_end is None:
        return []
    ends = ((open_s, camera.matrix), (close_s, camera.matrix_end))
    return [{"time_s": time, **pose(matrix)} for time, matrix in ends]


def _movements(camera: BlenderCamera, side: float) -> dict[str, Any]:
    x, y = (shift * side for shift in camera.shift)
    movements = {key: value for key, value in (("shift_mm", x), ("rise_mm", y)) if value}
    return {"movements": movements} if movements else {}


def _field_of_view(width: float, focal_length: float) -> dict[str, Any]:
    return {"fov_degrees": math.degrees(2 * math.atan(width / 2 / focal_length)), "fov_axis": "horizontal"}


def _ideal(
    camera: BlenderCamera, film: dict[str, Any], side: float, metres_per_unit: float, report: Report
) -> dict[str, Any]:
    """A pinhole, or with depth of field a thin lens, as Cycles has them."""
    keys = _posed(camera) | _field_of_view(film["size_mm"][0], camera.lens_mm) | _movements(camera, side)
    # Cycles takes a unit for a metre, whatever the scene's scale; the blur is to be the same
    radius = 0.0 if camera.f_stop is None else camera.lens_mm * 1e-3 / (2 * camera.f_stop) * metres_per_unit
    if radius < NO_STOP:
        if camera.clip_start > 0:
            keys["near_m"] = camera.clip_start * metres_per_unit
        return {"kind": "pinhole", **keys}
    if camera.ratio != 1:
        report.add("Camera: the anamorphic ratio of the opening is left out; the anamorphic lens has one of its own.")
    if camera.clip_start > SHOWN_CLIP:
        report.add(f"Camera: its clip start of {camera.clip_start:g} cuts nothing off with depth of field.")
    keys["aperture_radius_m"] = radius
    keys["focus_distance_m"] = camera.focus_distance * metres_per_unit
    if camera.blades >= 3:
        keys["aperture"] = {
            "shape": "polygon",
            "blades": camera.blades,
            "rotation_degrees": math.degrees(camera.blades_rotation) % 360,
        }
    return {"kind": "thin_lens", **keys}


def _orthographic(camera: BlenderCamera, film: dict[str, Any], side: float, metres_per_unit: float) -> dict[str, Any]:
    """Parallel rays from the plane of the camera on, moved by the shift."""
    width = camera.ortho_scale * film["size_mm"][0] / side
    keys: dict[str, Any] = {"kind": "orthographic", **_posed(camera), "width_m": width * metres_per_unit}
    right, up = (camera.matrix[:3, i] / np.linalg.norm(camera.matrix[:3, i]) for i in (0, 1))
    move = (right * camera.shift[0] + up * camera.shift[1]) * camera.ortho_scale
    keys |= {key: (np.array(keys[key]) + move).tolist() for key in ("eye", "target")}
    if camera.clip_start > 0:
        keys["near_m"] = camera.clip_start * metres_per_unit
    return keys


def _panorama(camera: BlenderCamera, frame: Frame) -> dict[str, Any]:
    """The whole sphere in longitude and latitude; other panoramas are refused."""
    width, height = frame.resolution
    if camera.panorama != "EQUIRECTANGULAR":
        kind = camera.panorama.replace("_", " ").title()
        raise InputError(
            f"Camera: a panorama of the kind {kind} is not rendered (allowed: Equirectangular, or a lens, such as a "
            "fisheye, under Real Lens)"
        )
    if width != 2 * height:
        raise InputError(
            f"Camera: an equirectangular panorama is twice as wide as high here (got {width} x {height} pixels)"
        )
    return {"kind": "environment", **_posed(camera)}


def _through_lens(
    camera: BlenderCamera, film: dict[str, Any], side: float, choice: LensChoice, report: Report
) -> dict[str, Any]:
    """The traced lens, whose entrance pupil is where Blender's camera stands."""
    keys = _posed(camera)
    if camera.kind != "PERSP":
        kind = "orthographic" if camera.kind == "ORTHO" else "a panorama"
        report.add(f"Camera: {kind} in Blender; the chosen lens has the perspective of its field.")
    if camera.clip_start > SHOWN_CLIP:
        report.add(f"Camera: its clip start of {camera.clip_start:g} cuts nothing off before a real lens.")
    scale = choice.focal_length_mm / camera.lens_mm if choice.match_field and camera.kind == "PERSP" else 1.0
    film = film | {"size_mm": [size * scale for size in film["size_mm"]]}
    keys |= {"kind": "realistic", "lens": choice.lens} | _movements(camera, side * scale)
    if choice.f_number is not None:
        keys["f_number"] = choice.f_number
    if choice.autofocus:
        report.add(
            "Camera: with autofocus the film stands where Blender's camera stands, and not the pupil of the lens."
        )
        keys["focus"] = {"auto": choice.autofocus}
    else:
        keys["stands_at"] = "entrance_pupil"
        matrix = np.asarray(camera.matrix)
        back = matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
        keys["focus"] = {"point": (matrix[:3, 3] - camera.focus_distance * back).tolist()}
    return {"film": film, "camera": keys | choice.keys}
