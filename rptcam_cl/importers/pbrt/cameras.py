"""Cameras of pbrt as cameras of ours."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.pictures import read_picture
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.film import DEFAULT_DIAGONAL_MM, Raster, diagonal_mm
from rptcam_cl.importers.pbrt.frame import MILLIMETRE, Frame, in_millimetres
from rptcam_cl.importers.pbrt.source import Place
from rptcam_cl.importers.pbrt.state import Entity
from rptcam_cl.importers.pbrt.transforms import tidy
from rptcam_cl.optics import load_lens

Array = NDArray[np.float64]
Keys = dict[str, Any]

# Distance of the pinhole that stands for a parallel view, in half widths of the picture.
ORTHOGRAPHIC_REACH = 500.0
# Shapes of the stop by name, as near as ours come (pbrt draws them as pictures of its own).
STOPS: dict[str, Keys] = {
    "square": {"shape": "polygon", "blades": 4, "rotation_degrees": 45.0},
    "pentagon": {"shape": "polygon", "blades": 5, "rotation_degrees": 90.0},
    "star": {"shape": "star"},
}


@dataclass(frozen=True)
class CameraKeys:
    """What a camera says in a scene of ours: the keys of ``camera``, ``film`` and of the scene itself."""

    camera: Keys
    film: Keys
    scene: Keys


def convert_camera(context: Context, camera: Entity, frame: Frame, raster: Raster, film: Entity | None) -> CameraKeys:
    """Return a camera as keys of a scene of ours."""
    kinds: dict[str, Callable[..., CameraKeys]] = {
        "perspective": _perspective, "orthographic": _orthographic, "environment": _spherical,
        "spherical": _spherical, "realistic": _realistic,
    }  # fmt: skip
    if camera.kind not in kinds:
        raise camera.place.error(f'unknown camera "{camera.kind}" (allowed: {", ".join(kinds)})')
    if np.any(frame.stretch != 1) and camera.kind != "perspective":
        context.report.ignored(camera.place, "uneven scaling of the camera's space")
    return kinds[camera.kind](context, camera, frame, raster, film)


def _screen(camera: Entity, raster: Raster) -> Array:
    """Return x0, x1, y0, y1 of the screen window, on which the shorter side runs from -1 to 1."""
    window = camera.parameters.numbers("screenwindow")
    aspect = camera.parameters.number("frameaspectratio", raster.width / raster.height)
    if window is None:
        if not aspect > 0:
            raise camera.place.error(f"{camera.what}: frameaspectratio must be above 0 (got {aspect:g})")
        x, y = (aspect, 1.0) if aspect > 1 else (1.0, 1 / aspect)
        return np.array([-x, x, -y, y])
    if len(window) != 4 or window[0] >= window[1] or window[2] >= window[3]:
        raise camera.place.error(f"{camera.what}: screenwindow needs x0 x1 y0 y1 with x0 < x1 and y0 < y1")
    return window


def _centred(context: Context, camera: Entity, raster: Raster) -> tuple[Raster, float, float]:
    """Return a film whose middle is on the axis, and its half width and height on the screen.

    A screen window off the axis is a part of a larger film; its edges come to the nearest half pixel.
    """
    x0, x1, y0, y1 = _screen(camera, raster)
    pixel_x, pixel_y = (x1 - x0) / raster.width, (y1 - y0) / raster.height
    shift_x, shift_y = (x0 + x1) / pixel_x, (y0 + y1) / pixel_y
    across, down = round(shift_x), round(shift_y)
    if abs(across - shift_x) > 1e-6 or abs(down - shift_y) > 1e-6:
        context.report.approximated(camera.place, f"{camera.what}: the screen window moves by part of a half pixel")
    if not across and not down:
        return raster, (x1 - x0) / 2, (y1 - y0) / 2
    wide = raster.widened(across, down)
    return wide, pixel_x * wide.width / 2, pixel_y * wide.height / 2


def _film_keys(raster: Raster, half_x: float, half_y: float) -> Keys:
    """Return the keys of a film whose sides are as two half extents are."""
    keys = raster.keys()
    if abs(half_x / half_y * raster.height / raster.width - 1) > 1e-6:
        keys["size_mm"] = [36.0, 36.0 * half_y / half_x]
    return keys


def _perspective(context: Context, camera: Entity, frame: Frame, raster: Raster, film: Entity | None) -> CameraKeys:
    raster, half_x, half_y = _centred(context, camera, raster)
    half_x, half_y = half_x * frame.stretch[0], half_y * frame.stretch[1]
    fov = camera.parameters.number("fov", 90.0)
    if camera.parameters.has("halffov"):
        fov = 2 * camera.parameters.number("halffov", 45.0)
    if not 0 < fov < 180:
        raise camera.place.error(f"{camera.what}: fov must lie between 0 and 180 degrees (got {fov:g})")
    axis, half = ("vertical", half_y) if half_y < half_x else ("horizontal", half_x)
    if half != 1:
        fov = math.degrees(2 * math.atan(half * math.tan(math.radians(fov) / 2)))
    keys: Keys = {"kind": "pinhole", **frame.pose(), "fov_degrees": fov, "fov_axis": axis}
    radius = camera.parameters.number("lensradius", 0.0)
    distance = camera.parameters.number("focaldistance", 1e6)
    if radius > 0:
        if not distance > 0:
            raise camera.place.error(f"{camera.what}: focaldistance must be above 0 (got {distance:g})")
        keys |= {"kind": "thin_lens", "aperture_radius_m": radius, "focus_distance_m": min(distance, 1e12)}
    return CameraKeys(keys, _film_keys(raster, half_x, half_y), {})


def _orthographic(context: Context, camera: Entity, frame: Frame, raster: Raster, film: Entity | None) -> CameraKeys:
    raster, half_x, half_y = _centred(context, camera, raster)
    reach = ORTHOGRAPHIC_REACH * max(half_x, half_y)
    context.report.approximated(
        camera.place,
        f"{camera.what}: a pinhole {reach:g} units back, so that what lies N times half the picture's width nearer or"
        f" farther than the camera is N/{ORTHOGRAPHIC_REACH:g} too large or small (2.8 % for 14)",
    )
    if camera.parameters.number("lensradius", 0.0) > 0:
        context.report.ignored(camera.place, f"{camera.what}: the lens radius of a parallel view")
    camera.parameters.skip("focaldistance")
    pose = frame.pose()
    forward = frame.forward / np.linalg.norm(frame.forward)
    eye = frame.eye - forward * (reach / frame.metres_per_unit)
    keys = {
        "kind": "pinhole", **pose, "eye": tidy(eye), "near_m": reach,
        "fov_degrees": math.degrees(2 * math.atan(half_x / reach)),
    }  # fmt: skip
    return CameraKeys(keys, _film_keys(raster, half_x, half_y), {})


def _spherical(context: Context, camera: Entity, frame: Frame, raster: Raster, film: Entity | None) -> CameraKeys:
    camera.parameters.skip("lensradius", "focaldistance", "frameaspectratio", "screenwindow")
    mapping = camera.parameters.text("mapping", "equalarea" if camera.kind == "spherical" else "equirectangular")
    if mapping not in ("equalarea", "equirectangular"):
        raise camera.place.error(f'unknown mapping "{mapping}" (allowed: equalarea, equirectangular)')
    if mapping == "equalarea":
        context.report.approximated(
            camera.place, f"{camera.what}: longitude and latitude in place of the equal-area square"
        )
    if raster.width != 2 * raster.height:
        context.report.approximated(
            camera.place,
            f"{camera.what}: the film becomes {2 * raster.height} x {raster.height} pixels, twice as wide as high",
        )
        raster = Raster(2 * raster.height, raster.height, (0, 2 * raster.height, 0, raster.height))
    return CameraKeys({"kind": "environment", **frame.pose()}, raster.keys(), {})


def _realistic(context: Context, camera: Entity, frame: Frame, raster: Raster, film: Entity | None) -> CameraKeys:
    parameters = camera.parameters
    if in_millimetres(camera):
        return _realistic_of_v2(context, camera, frame, raster)
    keys, _ = _lens_keys(context, camera, "lensfile", "aperturediameter")
    keys = {**keys, **frame.pose(), "focus": {"distance_m": parameters.number("focusdistance", 10.0)}}
    keys |= _stop_shape(context, camera)
    weighting = context.scene.version == 3 and parameters.boolean("simpleweighting", True)
    if weighting:
        context.report.approximated(camera.place, f"{camera.what}: simple weighting as exposure relative to the axis")
    scene = {"exposure": "relative" if weighting else "irradiance"}
    return CameraKeys(keys, {**raster.keys(), "diagonal_mm": diagonal_mm(film)}, scene)


def _realistic_of_v2(context: Context, camera: Entity, frame: Frame, raster: Raster) -> CameraKeys:
    """Return the lens camera of pbrt-v2's assignments: its place is that of the front vertex, its film is given.

    Distances are millimetres, and the light is irradiance on the film (the weight A cos^4 / Z^2 of the assignment).
    """
    parameters = camera.parameters
    keys, length_mm = _lens_keys(context, camera, "specfile", "aperture_diameter")
    distance = parameters.number("filmdistance", 70.0)
    diagonal = parameters.number("filmdiag", DEFAULT_DIAGONAL_MM)
    for name, length in (("filmdistance", distance), ("filmdiag", diagonal)):
        if not length > 0:
            raise camera.place.error(f'{camera.what}: "{name}" must be above 0 mm (got {length:g})')
    back = (length_mm + distance) * MILLIMETRE / frame.metres_per_unit
    eye = frame.eye - back * frame.forward / np.linalg.norm(frame.forward)
    pose = {**frame.pose(), "eye": tidy(eye)}
    film = {**raster.keys(), "diagonal_mm": diagonal}
    return CameraKeys({**keys, **pose, "focus": {"film_distance_mm": distance}}, film, {"exposure": "irradiance"})


def _lens_keys(context: Context, camera: Entity, file_key: str, diameter_key: str) -> tuple[Keys, float]:
    """Return the keys of a lens and its stop, and the length of the lens [mm]."""
    parameters = camera.parameters
    name = parameters.text(file_key, "")
    if not name:
        raise camera.place.error(f"{camera.what} needs a lens file")
    place = parameters.items[file_key].place
    path = context.find(name, place)
    lens = load_lens(path)
    keys: Keys = {"kind": "realistic", "lens": _as_path(context.files.reference(path, place))}
    diameter = parameters.number(diameter_key, 1.0)
    if lens.stop is None:
        context.report.ignored(place, "the aperture diameter: the lens has no stop")
    elif diameter > (widest := 2 * lens.stop.semi_diameter):
        context.report.noted(place, f"the stop opens to {widest:g} mm, not to {diameter:g} mm, as in pbrt")
    elif not diameter > 0:
        raise camera.place.error(f'{camera.what}: "{diameter_key}" must be above 0 mm (got {diameter:g})')
    else:
        keys["stop_diameter_mm"] = diameter
    return keys, lens.length


def _as_path(name: str) -> str:
    """Return a name that a scene takes for a path, not for a lens of the library."""
    return name if "/" in name else f"./{name}"


def _stop_shape(context: Context, camera: Entity) -> Keys:
    """Return the shape of the stop; pbrt-v4 knows some by name, others are pictures."""
    shape = camera.parameters.text("aperture", "circular")
    if shape == "circular":
        return {}
    place: Place = camera.parameters.items["aperture"].place
    if shape in STOPS:
        context.report.approximated(place, f'the stop "{shape}" in our shape of the name')
        return {"aperture": STOPS[shape]}
    if shape == "gaussian":
        context.report.ignored(place, 'the stop "gaussian": a stop is open or shut')
        return {}
    file = context.files.reference(context.find(shape, place), place, read_picture)
    return {"aperture": {"shape": "image", "file": file}}
