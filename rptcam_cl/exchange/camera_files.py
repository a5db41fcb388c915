"""Cameras as files of other programs: OpenCV, ROS, COLMAP, OpenTrackIO, USD, and an OSL shader for Cycles."""

from __future__ import annotations

import json
import math
import re
import uuid
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.camera_models import BY_ANGLE, FAR_M, Calibration, CameraView
from rptcam_cl.optics.files.export import lens_text
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import passing
from rptcam_cl.rendering.cameras.setting import LensSetting
from rptcam_cl.scene import lens_settings, placement

#
# A camera for Cycles: an OSL shader for its custom camera, which traces every ray through the surfaces of the lens.
#
# The shader takes points of the film to points of a disk on the plane of the exit pupil (of the last vertex, where
# the pupil is no help) and on through the lens, as `optics.trace` does: spheres and conics by their roots, aspheres
# by Newton's iteration from there, refraction by Snell's law, one wavelength. It is float32, as Cycles is. The disk
# holds all light that comes through anywhere on the film, as traced in float64 here.

Array = NDArray[np.float64]

_FIELDS = 5  # places across and down the picture from which the pupil is seen
_STEPS = 48  # points across the last surface, and across the pupil, that rays from each are aimed at
_NARROWED = 3  # times that the pupil is narrowed down

_FAR_MM = 1e4  # from where on a pupil ahead of the film is as good as infinitely far
_ROUNDS = 12  # of Newton's iteration, which needs three to five
_SMALL = 4e-7  # last step of it, over the size of the place: a few roundings in float32
_AXIS_RAYS = (1024, 64)  # outwards and round the disk, by which the light in the middle of the film is found

PROGRAM = """\
// {about}
// A custom camera for Cycles (Open Shading Language). The camera of the scene stands in the middle of the film.
// Millimetres inside; x right, y up, z ahead of the film's middle.

#define COUNT {count}
// Coefficients of the polynomials of aspheres, of r^0, r^1, ...; 0 without any
#define TERMS {terms}
#define COEFFICIENTS {size}

#if TERMS
// A polynomial's value and its derivative by s = r^2
void polynomial(float a[COEFFICIENTS], int k, float s, output float value, output float slope)
{{
  float r = sqrt(s);
  value = 0.0;
  float by_r = 0.0;
  for (int i = TERMS - 1; i >= 0; i--) {{
    by_r = by_r * r + value;
    value = value * r + a[k * TERMS + i];
  }}
  slope = r > 0.0 ? by_r / (2.0 * r) : a[k * TERMS + 2];
}}
#endif

shader camera(
    float metres_per_unit = 1.0,
    output point position = 0.0,
    output vector direction = vector(0.0, 0.0, 1.0),
    output color throughput = 0.0)
{{
  // Surfaces from film to scene: vertex, curvature, 1 + conic constant, squared clear radius, index before / after
  float vertex[COUNT] = {{{vertex}}};
  float curvature[COUNT] = {{{curvature}}};
  float shape[COUNT] = {{{shape}}};
  float clear[COUNT] = {{{clear}}};
  float ratio[COUNT] = {{{ratio}}};
  // 1, or 0 for the axis along which a cylinder is straight
  float across_x[COUNT] = {{{across_x}}};
  float across_y[COUNT] = {{{across_y}}};
#if TERMS
  int aspheric[COUNT] = {{{aspheric}}};
  float a[COEFFICIENTS] = {{{coefficients}}};
#endif

  point share = camera_shader_raster_position();
  vector chance = camera_shader_random_sample();
  point p = point({corner}) + share[0] * vector({across}) + share[1] * vector({up});
  float radius = {radius} * sqrt(chance[0]);
  float azimuth = {turn} * chance[1];
  vector away = point(radius * cos(azimuth), radius * sin(azimuth), {disk}) - p;
  float square = dot(away, away);
  vector d = away / sqrt(square);
  // The disk's share of the light, such that the middle of the film has 1.
  float weight = {scale} * abs(d[2] * dot(d, vector({normal}))) / square;

  for (int k = 0; k < COUNT; k++) {{
    // Scene is towards +z here, so that a surface's curvature is that of the prescription with its sign turned.
    float to_plane = (vertex[k] - p[2]) / d[2];
    float x = p[0] + to_plane * d[0];
    float y = p[1] + to_plane * d[1];
    float c = curvature[k];
    float wx = across_x[k];
    float wy = across_y[k];
    float bump = 0.0;
    float slope = 0.0;
#if TERMS
    if (aspheric[k])
      polynomial(a, k, wx * x * x + wy * y * y, bump, slope);
#endif
    // The conic, moved by the polynomial
    float f = c * (wx * x * x + wy * y * y + shape[k] * bump * bump) + 2.0 * bump;
    float g = d[2] - c * (wx * d[0] * x + wy * d[1] * y - shape[k] * d[2] * bump);
    float square_term = c * (wx * d[0] * d[0] + wy * d[1] * d[1] + shape[k] * d[2] * d[2]);
    float discriminant = g * g - square_term * f;
    float root = sqrt(max(discriminant, 0.0));
    float step = f / (g + root);
#if TERMS
    if (aspheric[k]) {{
      if (discriminant < 0.0)
        step = 0.0;
      discriminant = -1.0;
      for (int i = 0; i < {rounds}; i++) {{
        float u = x + step * d[0];
        float v = y + step * d[1];
        float s = wx * u * u + wy * v * v;
        if (s > 9.0 * clear[k])
          return;
        float along_s = 2.0 * (wx * u * d[0] + wy * v * d[1]);
        polynomial(a, k, s, bump, slope);
        float w = step * d[2] - bump;
        float along_w = d[2] - slope * along_s;
        float side = w - 0.5 * c * (s + shape[k] * w * w);
        float change = side / (along_w - 0.5 * c * (along_s + 2.0 * shape[k] * w * along_w));
        step -= change;
        if (abs(change) <= {small} * (abs(x) + abs(y) + abs(step))) {{
          discriminant = 1.0;
          break;
        }}
      }}
    }}
#endif
    if (discriminant < 0.0)
      return;
    float z = step * d[2];
    x += step * d[0];
    y += step * d[1];
#if TERMS
    if (aspheric[k])
      polynomial(a, k, wx * x * x + wy * y * y, bump, slope);
#endif
    float ahead = 1.0 - c * shape[k] * (z - bump);
    float aside = -(c + 2.0 * slope * ahead);
    vector facing = vector(wx * x * aside, wy * y * aside, ahead);
    if (facing[2] <= 0.0 || x * x + y * y > clear[k])
      return;
    float size = length(facing);
    facing /= size;
    float cosine = root / size;
#if TERMS
    if (aspheric[k])
      cosine = dot(facing, d);
    if (cosine <= 0.0)
      return;
#endif
    float bent = 1.0 - ratio[k] * ratio[k] * (1.0 - cosine * cosine);
    if (bent < 0.0)
      return;
    d = normalize(ratio[k] * d + (sqrt(bent) - ratio[k] * cosine) * facing);
    if (d[2] <= 0.0)
      return;
    p = point(x, y, vertex[k] + z);
  }}
  position = p * 0.001 / metres_per_unit;
  direction = d;
  throughput = weight;
}}
"""


def osl_text(view: CameraView) -> str:
    """Return the shader of a scene's camera.

    Raises
    ------
    InputError
        For a camera without surfaces, or a lens with mirrors, toroids, biconics, or surfaces or openings off its axis.
    """
    setting = view.setting
    if setting is None or not view.is_traced:
        raise InputError("--osl: needs a camera of kind realistic, whose lens is traced (others fit into --usd)")
    _check(setting.lens)
    if not isinstance(view.scene.camera.outline, lens_settings.CircularAperture):
        raise InputError(f"--osl: {setting.lens.name}: camera.aperture is not round (allowed: circle)")
    lens, wavelength = setting.lens, setting.camera.wavelength_nm
    film_z = lens.film_z(setting.film_distance_mm)
    width, height = view.size
    corners = view.film_points(np.array([[0.0, height], [width, height], [0.0, 0.0]]))
    corners[:, 2] += film_z
    corner, across, up = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    normal = np.cross(across, up)
    normal /= np.linalg.norm(normal)
    plane, radius = _disk(view, setting)
    middle = corner + (across + up) / 2
    return PROGRAM.format(
        about=f"{view.name}, film {setting.film_distance_mm:.6g} mm behind it, {wavelength:g} nm",
        **_columns_of_surfaces(lens, film_z, wavelength),
        rounds=_ROUNDS,
        small=_SMALL,
        corner=_vector_text(corner, film_z),
        across=_vector_text(across),
        up=_vector_text(up),
        normal=_vector_text(normal),
        radius=repr(radius),
        turn=repr(2 * math.pi),
        disk=repr(float(film_z - plane)),
        scale=repr(1.0 / _on_axis(lens, middle, normal, plane, radius, wavelength)),
    )


def _columns_of_surfaces(lens: Lens, film_z: float, wavelength_nm: float) -> dict[str, Any]:
    """List the surfaces from film to scene, column by column, by the names in the text of the shader."""
    indices = lens.indices(wavelength_nm)
    rows = range(len(lens.surfaces) - 1, -1, -1)
    surfaces = [lens.surfaces[k] for k in rows]
    axes = [surface.axes() for surface in surfaces]
    terms = max((max(power, 2) + 1 for surface in surfaces for power, _ in surface.aspheric), default=0)
    return {
        "count": len(surfaces),
        "vertex": _numbers_text(film_z - float(lens.vertices[k]) for k in rows),
        "curvature": _numbers_text(-surface.curvature for surface in surfaces),
        "shape": _numbers_text(1.0 + surface.conic for surface in surfaces),
        "clear": _numbers_text(min(surface.semi_diameter, 1e6) ** 2 for surface in surfaces),
        "ratio": _numbers_text(float(indices[k + 1] / indices[k]) for k in rows),
        "across_x": _numbers_text(x for x, _ in axes),
        "across_y": _numbers_text(y for _, y in axes),
        "terms": terms,
        "size": terms * len(surfaces),
        "aspheric": ", ".join(str(int(bool(surface.aspheric))) for surface in surfaces),
        "coefficients": _numbers_text(
            -dict(surface.aspheric).get(i, 0.0) for surface in surfaces for i in range(terms)
        ),
    }


def _check(lens: Lens) -> None:
    """Refuse what the shader cannot trace."""
    for k, surface in enumerate(lens.surfaces):
        if surface.is_mirror:
            fault = "is a mirror"
        elif surface.form is not None:
            fault = f"is {surface.form.description}"
        elif surface.pose is not None:
            fault = "stands beside the axis or tilted"
        elif surface.region is not None or surface.stop_shape or surface.inner_semi_diameter:
            fault = "has an opening that is not round"
        else:
            continue
        raise InputError(
            f"--osl: {lens.name}: surface {k} {fault}"
            " (allowed: spheres, conics, cylinders, aspheres and planes about one axis, with round openings)"
        )


def _disk(view: CameraView, setting: LensSetting) -> tuple[float, float]:
    """Return z and radius [mm] of a disk on the plane of the exit pupil that all light to the picture passes.

    By rays in float64, in the frame of the lens.
    """
    lens = setting.lens
    film_z, last = lens.film_z(setting.film_distance_mm), lens.length
    pupil_z = last + lens.first_order(setting.camera.wavelength_nm).exit_pupil.distance_mm
    plane = pupil_z if setting.film_distance_mm / 2 < film_z - pupil_z < _FAR_MM else last
    film = view.film_points(view.grid(_FIELDS, _FIELDS))
    film[:, 2] += film_z
    rear = lens.surfaces[-1].semi_diameter
    radius = _reach(lens, film, last, rear, setting.camera.wavelength_nm)
    if plane != last:
        spread = float(np.max((film[:, 2] - plane) / (film[:, 2] - last)))
        radius = radius * spread + abs(spread - 1.0) * float(np.hypot(*film[:, :2].T).max())
    for _ in range(_NARROWED):
        radius = min(radius, _reach(lens, film, plane, radius, setting.camera.wavelength_nm))
    return float(plane), radius


def _reach(lens: Lens, film: Array, plane: float, half: float, wavelength_nm: float) -> float:
    """Return how far from the axis light to film points crosses a plane, within a square of half side ``half`` [mm]."""
    line = np.linspace(-half, half, _STEPS)
    x, y = (values.ravel() for values in np.meshgrid(line, line))
    origins = np.repeat(film, x.size, axis=0)
    targets = np.tile(np.column_stack([x, y, np.full(x.size, plane)]), (len(film), 1))
    through = passing(lens, origins, targets - origins, wavelength_nm)
    if not through.any():
        raise InputError(f"--osl: {lens.name}: no light comes through to the film")
    step = float(line[1] - line[0]) * math.sqrt(2)
    return float(np.max(np.hypot(*targets[through, :2].T)) + step)


def _on_axis(lens: Lens, middle: Array, normal: Array, plane: float, reach: float, wavelength_nm: float) -> float:
    """Return the mean over the disk of what the middle of the film gets, before it is scaled to 1 [1/mm^2]."""
    shares, turns = ((np.arange(count) + 0.5) / count for count in _AXIS_RAYS)
    radius, azimuth = (part.ravel() for part in np.meshgrid(reach * np.sqrt(shares), 2 * math.pi * turns))
    targets = np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.full(radius.size, plane)])
    away = targets - middle
    square = np.sum(away * away, axis=1)
    lit = passing(lens, np.tile(middle, (len(away), 1)), away, wavelength_nm)
    directions = away / np.sqrt(square)[:, None]
    weights = np.where(lit, np.abs(directions[:, 2] * (directions @ normal)) / square, 0.0)
    if not weights.any():
        raise InputError(f"--osl: {lens.name}: no light comes to the middle of the picture")
    return float(np.mean(weights))


def _vector_text(vector: Array, film_z: float = 0.0) -> str:
    """Return a vector of the frame of the lens, whose z runs to the film, with z towards the scene."""
    x, y, z = np.asarray(vector, np.float64).tolist()
    return _numbers_text((x, y, film_z - z))


def _numbers_text(values: Iterable[float], between: str = ", ") -> str:
    return between.join(repr(float(value)) for value in values)


#
# A camera for USD: the text of a layer with one ``UsdGeomCamera`` at the entrance pupil.
#
# Such a camera is a pinhole with an opening: no distortion, and blur by depth alone. Its focal length is that of the
# camera model, so that things lie where the model without its distortion has them; focal length / f-stop is the
# entrance pupil and the plane of focus is counted from there, so that the blur is that of an ideal lens with this
# pupil. What USD cannot say, distortion and the lens itself, is custom data. Lengths are centimetres, because then
# focal length and apertures, which USD has in tenths of the unit, are millimetres.

_CM_PER_M = 100.0
_NEAREST_CM, _FARTHEST_CM = 0.1, 1e6  # what is drawn at most: from 1 mm to 10 km


def usd_text(view: CameraView, calibration: Calibration) -> str:
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
        "focusDistance": min(focus_m, FAR_M) * _CM_PER_M,
    }
    setting = view.setting  # the lens begins so far ahead of the entrance pupil
    ahead_cm = 0.0 if setting is None else (setting.lens.film_z(setting.film_distance_mm) - view.pupil_ahead_mm) / 10
    near = max(ahead_cm, _NEAREST_CM)
    lines = [
        "#usda 1.0",
        "(",
        '    defaultPrim = "Camera"',
        f"    metersPerUnit = {1 / _CM_PER_M!r}",
        '    upAxis = "Y"',
        ")",
        "",
        'def Camera "Camera" (',
        *_custom_data(view, calibration),
        ")",
        "{",
        '    token projection = "perspective"',
        *(f"    float {name} = {value!r}" for name, value in numbers.items()),
        f"    float2 clippingRange = ({near!r}, {_FARTHEST_CM!r})",
        f"    matrix4d xformOp:transform = ( {', '.join(f'({_numbers_text(row)})' for row in _pose_rows(view))} )",
        '    uniform token[] xformOpOrder = ["xformOp:transform"]',
        "}",
    ]
    return "\n".join(lines) + "\n"


def _opening(view: CameraView) -> tuple[float, float]:
    """Return the diameter of the entrance pupil [mm] and the distance from it to the plane of focus [m]."""
    if view.setting is None:
        return view.pupil.diameter_mm, view.scene.camera.distance_in_focus(1.0) or math.inf
    focus_mm = view.setting.focus_distance_mm
    return view.pupil.diameter_mm, math.inf if focus_mm is None else (focus_mm - view.pupil_ahead_mm) * 1e-3


def _pose_rows(view: CameraView) -> list[list[float]]:
    """Return the pose as USD has it: by rows right, up, back and the place [cm]."""
    pose = view.pose()
    pose[:3, 1:3] *= -1.0
    pose[:3, 3] *= _CM_PER_M
    rows: list[list[float]] = np.add(pose.T, 0.0).tolist()  # which makes 0 of -0
    return rows


def _custom_data(view: CameraView, calibration: Calibration) -> list[str]:
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
            on_lines = "'''" + value.replace("\\", "\\\\").replace("'", "\\'") + "'''"
            text = on_lines if "\n" in value else json.dumps(value, ensure_ascii=False)
            lines.append(f"{indent}string {name} = {text}")
        elif isinstance(value, int):
            lines.append(f"{indent}int {name} = {value}")
        elif value is not None:
            lines.append(f"{indent}double {name} = {value!r}")
    return lines


#
# Camera models as files of other programs: OpenCV, ROS, COLMAP, OpenTrackIO (OpenLensIO), and JSON with everything.
#
# OpenCV and ROS count from the centre of the first pixel, so that their cx and cy are half a pixel smaller than ours;
# COLMAP counts from its corner, as we do. Poses are from the world of the scene to x right, y down, z ahead at the
# entrance pupil.

_PIXEL_CENTRE = 0.5  # of the first pixel, as we and COLMAP count; OpenCV and ROS call it 0
_ROS = {
    "pinhole": "plumb_bob",
    "brown_conrady": "plumb_bob",
    "rational": "rational_polynomial",
    BY_ANGLE: "equidistant",
}
_COLMAP = {"pinhole": "PINHOLE", "brown_conrady": "FULL_OPENCV", "rational": "FULL_OPENCV", BY_ANGLE: "OPENCV_FISHEYE"}
ALL = ("pinhole", "brown_conrady", "rational", "thin_prism", BY_ANGLE)
HELD: dict[str, tuple[str, ...]] = {
    "opencv": ALL,
    "ros": tuple(_ROS),
    "colmap": tuple(_COLMAP),
    "openlensio": ("pinhole", "brown_conrady", "rational"),
    "usd": ALL,
    "osl": ALL,
}
_OPENTRACKIO_VERSION = [1, 0, 1]
_LONGEST_NAME = 1023  # characters, by its schema
_SAME_FOCUS = 1e-3  # share by which fx and fy may differ [mm] where a file has one focal length


def check_held(form: str, model: str) -> None:
    """Refuse a camera model that a kind of file cannot say."""
    if model not in HELD[form]:
        raise InputError(f"--{form}: such a file cannot say {model} (allowed: {', '.join(HELD[form])})")


def _opencv_matrix(view: CameraView, calibration: Calibration) -> list[float]:
    fx, fy, cx, cy = calibration.parameters[:4].tolist()
    return [fx, 0.0, cx - _PIXEL_CENTRE, 0.0, fy, cy - _PIXEL_CENTRE, 0.0, 0.0, 1.0]


def _about(view: CameraView, calibration: Calibration) -> str:
    return (
        f"{view.name}: {calibration.model}, errs by {calibration.max_px:.3g} px at most,"
        f" rms {calibration.rms_px:.3g} px, {object_text(view)}; pose at the entrance pupil,"
        f" {view.pupil_ahead_mm:.4f} mm ahead of the eye"
    )


def object_text(view: CameraView) -> str:
    """The distance that a view's models are fitted at; at others they err by the drift of the pupil."""
    shape = view.object_shape
    if shape is None:
        return "for objects far away"
    return f"for a {shape} {view.distance_m:.6g} m from the entrance pupil"


def opencv_text(view: CameraView, calibration: Calibration) -> str:
    """Return the file for OpenCV's FileStorage; `fisheye_model: 1` is for its module fisheye."""
    coefficients = calibration.coefficients or [0.0] * 5
    pose = np.asarray(np.linalg.inv(view.pose()))

    def matrix(name: str, rows: int, columns: int, values: Sequence[float]) -> list[str]:
        shape = [f"   rows: {rows}", f"   cols: {columns}", "   dt: d"]
        return [f"{name}: !!opencv-matrix", *shape, f"   data: [ {_numbers_text(values)} ]"]

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


def ros_text(view: CameraView, calibration: Calibration) -> str:
    """Return the file of `camera_info` of ROS; its frame is the optical one at the entrance pupil."""
    matrix = _opencv_matrix(view, calibration)
    coefficients = calibration.coefficients or [0.0] * 5
    projection = [*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0]

    def block(name: str, rows: int, columns: int, values: Sequence[float]) -> list[str]:
        return [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: [{_numbers_text(values)}]"]

    lines = [
        f"# {_about(view, calibration)}",
        f"image_width: {view.size[0]}",
        f"image_height: {view.size[1]}",
        f"camera_name: {'_'.join(re.findall('[A-Za-z0-9]+', view.name)) or 'camera'}",
        *block("camera_matrix", 3, 3, matrix),
        f"distortion_model: {_ROS[calibration.model]}",
        *block("distortion_coefficients", 1, len(coefficients), coefficients),
        *block("rectification_matrix", 3, 3, np.eye(3).ravel().tolist()),
        *block("projection_matrix", 3, 4, projection),
    ]
    return "\n".join(lines) + "\n"


def colmap_texts(view: CameraView, calibration: Calibration, picture: str) -> dict[str, str]:
    """Return the text files of a COLMAP model with one camera, one picture of a name, and no points."""
    coefficients = calibration.coefficients
    if calibration.model == "brown_conrady":
        coefficients = [*coefficients, 0.0, 0.0, 0.0]
    width, height = view.size
    values = _numbers_text([*calibration.parameters[:4], *coefficients], " ")
    pose = np.asarray(np.linalg.inv(view.pose()))
    x, y, z, w = placement.quaternion_of(pose[:3, :3])
    return {
        "cameras.txt": f"# {_about(view, calibration)}\n# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
        f"1 {_COLMAP[calibration.model]} {width} {height} {values}\n",
        "images.txt": "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then POINTS2D[] of it\n"
        f"1 {_numbers_text((w, x, y, z, *pose[:3, 3]), ' ')} 1 {picture}\n\n",
        "points3D.txt": "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n",
    }


def openlensio_text(view: CameraView, calibration: Calibration) -> str:
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
        "protocol": {"name": "OpenTrackIO", "version": _OPENTRACKIO_VERSION},
        "sampleId": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_OID, text)}",
        "static": {
            "camera": {
                "activeSensorPhysicalDimensions": {
                    "width": view.size[0] * pixel_mm[0],
                    "height": view.size[1] * pixel_mm[1],
                },
                "activeSensorResolution": {"width": view.size[0], "height": view.size[1]},
            },
            "lens": {"model": view.name[:_LONGEST_NAME]},
        },
        "lens": lens,
        "transforms": [_transform(view)],
    }
    return json.dumps(sample, indent=2, ensure_ascii=False) + "\n"


def _openlensio_lens(view: CameraView, calibration: Calibration, pixel_mm: list[float]) -> dict[str, Any]:
    """Return the lens of `openlensio_text`: focal length, offsets and distortion."""
    focal = [value * mm for value, mm in zip(calibration.parameters[:2].tolist(), pixel_mm, strict=True)]
    if abs(focal[0] - focal[1]) > _SAME_FOCUS * focal[0]:
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


def _transform(view: CameraView) -> dict[str, Any]:
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


def document(view: CameraView, calibrations: Sequence[Calibration], refused: dict[str, str]) -> dict[str, Any]:
    """Return everything for JSON: the camera, and each model with its residual, or why it does not fit."""
    facts, drift = view.facts(), view.drift_by_angle()
    if drift is not None:
        degrees, ahead_mm = (values.tolist() for values in drift)
        facts["entrance_pupil"] |= {"drift_by_angle": {"degrees": degrees, "ahead_mm": ahead_mm}}
    return {
        **facts,
        "object_shape": view.object_shape,
        "pixel_centre": _PIXEL_CENTRE,
        "conventions": {
            "pixels": "from the left and top edges of the picture: the first pixel covers 0 to 1, its centre is 0.5",
            "axes": "x right, y down, z ahead; world_from_camera by rows [m], at the entrance pupil",
        },
        "models": {
            each.model: each.named | {"max_px": each.max_px, "rms_px": each.rms_px, "lit_share": each.lit_share}
            for each in calibrations
        },
        **({"refused": refused} if refused else {}),
    }


WRITTEN: dict[str, Callable[[CameraView, Calibration], str]] = {
    "opencv": opencv_text,
    "ros": ros_text,
    "openlensio": openlensio_text,
    "usd": usd_text,
    "osl": lambda view, _: osl_text(view),  # the lens itself
}
