"""The dials of the optics: focus, zoom, lens, shape of the stop, film format."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import configured
from rptcam_cl.scene import (
    SIDES_MM,
    CircularAperture,
    EnvironmentCamera,
    LensCamera,
    PinholeCamera,
    PolygonAperture,
    RealisticCamera,
    Scene,
    ThickLensCamera,
    ThinLensCamera,
    change_scene,
    with_camera,
)
from rptcam_cl.viewfinder.depth_of_field import INFINITY_M, focus_keys, nearest_focus_m, perspective
from rptcam_cl.viewfinder.lens_choice import chosen_lens, current_name
from rptcam_cl.viewfinder.panel import (
    Panel,
    Turned,
    f_number_of_camera,
    f_numbers,
    film_mm,
    focal_length_mm,
    is_same_size,
    number,
    word,
)
from rptcam_cl.viewfinder.remembered import by_optics

CLICK = 1.03  # of the focal length
MOST_CROP = 8.0
WIDEST_DEGREES, NARROWEST_DEGREES = 170.0, 0.5
SHAPES = ("circle", "polygon", "star", "heart")
BLADES = (3, 64)
DEFAULT_BLADES = 7
INFINITE_M = 1e5  # from here on the focus is at infinity

ZoomKind = Literal["zoom", "angle", "crop", "none"]
ZOOM_TEXTS: dict[ZoomKind, str] = {
    "zoom": "the lens zooms",
    "angle": "the camera's field of view changes",
    "crop": "a prime cannot zoom: the film is cropped, as by an extender",
    "none": "a camera that sees the whole sphere has nothing to zoom",
}


def turn_focus(panel: Panel, value: Any) -> Turned:
    """Focus at a distance [m]; from 100 km on at infinity."""
    metres, camera = number("focus_m", value), panel.scene.camera
    if not isinstance(camera, (LensCamera, ThinLensCamera)):
        return panel.same("everything is sharp through this camera: there is no focus to set")
    if not metres > 0:
        raise InputError(f"focus_m: must be above 0 (got {metres:g})")
    nearest = nearest_focus_m(panel.view)
    reached = INFINITY_M if metres >= INFINITE_M else max(metres, nearest or 0.0)
    messages = (f"the nearest focus is {nearest:.3g} m",) if nearest is not None and metres < nearest else ()
    return Turned(panel.dials, _as_paths(focus_keys(panel.scene, reached)), messages)


def _as_paths(keys: dict[str, Any]) -> dict[str, Any]:
    """Return keys of the camera as key paths of the scene; those that others replace are left out."""
    return {f"camera.{name}": value for name, value in keys.items() if value is not None}


@by_optics
def zoom_kind(scene: Scene) -> ZoomKind:
    """Return what zooming does with a camera."""
    camera = scene.camera
    if isinstance(camera, EnvironmentCamera):
        return "none"
    if isinstance(camera, LensCamera):
        return "zoom" if len(scene.load_lens().configurations) > 1 else "crop"
    return "angle"


def zoom_range(panel: Panel) -> tuple[float, float] | None:
    """Return the shortest and the longest focal length to zoom to [mm]; of a crop, as behind the whole film."""
    focal_mm = focal_length_mm(panel.view)
    kind = zoom_kind(panel.scene)
    if focal_mm is None or kind == "none":
        return None
    if kind == "zoom":
        return _zoom_ends(panel.scene)
    if kind == "crop":
        return focal_mm, focal_mm * MOST_CROP
    half = panel.view.film.diagonal_m() * 1e3 / 2
    ends = tuple(half / math.tan(math.radians(degrees) / 2) for degrees in (WIDEST_DEGREES, NARROWEST_DEGREES))
    return ends[0], ends[1]


@by_optics
def _zoom_ends(scene: Scene) -> tuple[float, float]:
    assert isinstance(scene.camera, LensCamera)
    lens, wavelength_nm = scene.load_lens(), scene.camera.wavelength_nm
    states = [configured(lens, state.name) for state in lens.configurations]
    lengths = [state.first_order(wavelength_nm).focal_length_mm for state in states]
    return min(lengths), max(lengths)


def zoomed_mm(panel: Panel) -> float | None:
    """Return the focal length that the camera is zoomed to [mm]; of a crop, as behind the whole film."""
    focal_mm = focal_length_mm(panel.view)
    if focal_mm is None or zoom_kind(panel.scene) != "crop":
        return focal_mm
    return focal_mm * panel.dials.whole_mm[0] / panel.dials.cropped_mm[0]


def zoom_by(panel: Panel, clicks: float) -> Turned:
    """Zoom by clicks of a wheel."""
    here = zoomed_mm(panel)
    if here is None:
        return panel.same(ZOOM_TEXTS["none"])
    return turn_zoom(panel, here * CLICK ** number("zoom", clicks))


def turn_zoom(panel: Panel, value: Any) -> Turned:
    """Zoom to a focal length [mm]."""
    wanted, ends = number("zoom", value), zoom_range(panel)
    if ends is None:
        return panel.same(ZOOM_TEXTS["none"])
    reached = min(max(wanted, ends[0]), ends[1])
    messages = (f"it goes from {ends[0]:.4g} to {ends[1]:.4g} mm",) if abs(reached - wanted) > 1e-9 * wanted else ()
    kind = zoom_kind(panel.scene)
    if kind == "crop":
        return _cropped(panel, reached / ends[0], messages)
    if kind == "zoom":
        return Turned(panel.dials, _zoomed(panel, reached), messages)
    return Turned(panel.dials, _widened(panel, reached), messages)


def _cropped(panel: Panel, factor: float, messages: tuple[str, ...]) -> Turned:
    """Return a film that is smaller by a factor than the whole one."""
    width, height = panel.dials.whole_mm
    size = (width / factor, height / factor) if factor > 1 + 1e-9 else (width, height)
    dials = replace(panel.dials, cropped_mm=size)
    if is_same_size(size, film_mm(panel.scene)):
        return Turned(dials, {}, messages)
    return Turned(dials, {"film.size_mm": list(size)}, messages)


SIZES = ("format", "size_mm", "width_mm", "diagonal_mm", "pixel_pitch_um")


def _zoomed(panel: Panel, focal_mm: float) -> dict[str, Any]:
    """Return the changes that zoom a lens; an f-number beyond the zoomed lens's widest becomes that."""
    changes: dict[str, Any] = {"camera.focal_length_mm": focal_mm}
    camera = panel.scene.camera
    assert isinstance(camera, LensCamera)
    if camera.f_number is not None:
        keys = {"focal_length_mm": focal_mm, "zoom": None, "f_number": None}
        widest = f_numbers(change_scene(panel.scene, camera=keys))[0]
        if camera.f_number < widest:
            changes["camera.f_number"] = widest
    return changes


def _widened(panel: Panel, focal_mm: float) -> dict[str, Any]:
    """Return the changes that give an ideal camera another field."""
    camera, here = panel.scene.camera, focal_length_mm(panel.view)
    assert isinstance(camera, (PinholeCamera, ThinLensCamera)) and here is not None
    if camera.fov_degrees is None:
        return {"camera.focal_length_mm": focal_mm}
    tangent = math.tan(math.radians(camera.fov_degrees) / 2) * here / focal_mm
    return {"camera.fov_degrees": math.degrees(2 * math.atan(tangent))}


def turn_lens(panel: Panel, value: Any) -> Turned:
    """Change the lens for another of the list; f-number and focus stay as far as it reaches."""
    if not isinstance(value, str):
        raise InputError(f"lens: must be a name of the list (got {str(value)[:40]!r})")
    scene = panel.scene
    if value == current_name(scene) and isinstance(scene.camera, LensCamera):
        return panel.same()
    entry = chosen_lens(scene, value)
    changed = with_camera(scene, _keys_behind(panel, entry.name, {"distance_m": INFINITY_M}))
    messages: tuple[str, ...] = ()
    keys: dict[str, Any] = {"camera.lens": entry.name}
    f_number, (widest, narrowest) = f_number_of_camera(panel.view), f_numbers(changed)
    if f_number is not None and widest < narrowest:
        keys["camera.f_number"] = min(max(f_number, widest), narrowest)
        if f_number < widest * (1 - 1e-9):
            messages = (f"{entry.title} opens to f/{widest:.3g}",)
    nearest, metres = nearest_focus_m(changed), _focus_m(panel.view)
    if nearest is not None and metres < nearest:
        messages, metres = (*messages, f"its nearest focus is {nearest:.3g} m"), nearest
    keys["camera.focus"] = {"distance_m": metres}
    shape = getattr(scene.camera, "aperture", CircularAperture()).shape
    if isinstance(scene.camera, RealisticCamera) and shape != "circle" and changed.load_lens().stop is None:
        keys["camera.aperture"] = {"shape": "circle"}
        messages = (*messages, f"{entry.title} has no stop to shape: its rims are round")
    if not isinstance(scene.camera, LensCamera):
        camera = _keys_behind(panel, entry.name, keys["camera.focus"])
        f_keys = {"f_number": keys["camera.f_number"]} if "camera.f_number" in keys else {}
        return Turned(panel.dials, {"camera": _plain(camera | f_keys)}, messages)
    return Turned(panel.dials, keys | _without(scene.camera, keys), messages)


def _without(camera: LensCamera, keys: dict[str, Any]) -> dict[str, Any]:
    """Return the removals of keys that belong to the lens that was taken off."""
    gone = [name for name in ("zoom", "focal_length_mm") if getattr(camera, name) is not None]
    if camera.stop_diameter_mm is not None and "camera.f_number" not in keys:
        gone.append("stop_diameter_mm")
    if camera.f_number is not None and "camera.f_number" not in keys:
        gone.append("f_number")
    return {f"camera.{name}": None for name in gone}


def _keys_behind(panel: Panel, lens: str, focus: dict[str, Any]) -> dict[str, Any]:
    """Return the keys of the scene's camera behind another lens, wide open."""
    camera = panel.scene.camera
    pose = {name: getattr(camera, name) for name in ("eye", "target", "up", "flip", "motion")}
    kept = {}
    if isinstance(camera, LensCamera):
        own = ("lens", "zoom", "focal_length_mm", "stop_diameter_mm", "f_number", "focus", "kind")
        kept = {name: getattr(camera, name) for name in camera.model_fields_set if name not in own}
    kind = camera.kind if isinstance(camera, LensCamera) else "realistic"
    return pose | kept | {"kind": kind, "lens": lens, "focus": focus}


def _plain(keys: dict[str, Any]) -> dict[str, Any]:
    """Return keys of a camera as plain values of YAML, without a motion that is none."""
    plain = {name: list(value) if isinstance(value, tuple) else value for name, value in keys.items()}
    motion = [frame.model_dump(mode="json", exclude_none=True) for frame in plain.pop("motion")]
    return plain | ({"motion": motion} if motion else {})


def _focus_m(scene: Scene) -> float:
    """Return the distance of the plane in focus [m], to the film of a real lens; infinity where there is none."""
    found = perspective(scene)
    if found is not None and math.isfinite(found.focus_mm):
        return min(found.focus_mm * 1e-3, INFINITY_M)
    if isinstance(scene.camera, PinholeCamera):
        return float(math.dist(scene.camera.eye, scene.camera.target)) * scene.metres_per_unit
    return INFINITY_M


def turn_stop(panel: Panel, value: Any) -> Turned:
    """Give the stop another shape."""
    shape = word("stop", value, SHAPES)
    if (words := stop_is_fixed(panel.scene)) is not None:
        return panel.same(words)
    aperture: dict[str, Any] = {"shape": shape}
    if shape == "polygon":
        aperture["blades"] = DEFAULT_BLADES
    return Turned(panel.dials, {"camera.aperture": aperture})


def turn_blades(panel: Panel, value: Any) -> Turned:
    """Make the stop of so many blades; 0 makes it round."""
    count = number("blades", value)
    if count != round(count):
        raise InputError(f"blades: must be a whole number (got {count:g})")
    if (words := stop_is_fixed(panel.scene)) is not None:
        return panel.same(words)
    if count == 0:
        return Turned(panel.dials, {"camera.aperture": {"shape": "circle"}})
    blades = int(min(max(count, BLADES[0]), BLADES[1]))
    messages = () if blades == count else (f"a stop has from {BLADES[0]} to {BLADES[1]} blades",)
    aperture = getattr(panel.scene.camera, "aperture", None)
    kept = {}
    if isinstance(aperture, PolygonAperture):
        kept = {name: getattr(aperture, name) for name in ("curvature", "rotation_degrees") if getattr(aperture, name)}
    return Turned(panel.dials, {"camera.aperture": {"shape": "polygon", "blades": blades} | kept}, messages)


@by_optics
def stop_is_fixed(scene: Scene) -> str | None:
    """Return why the stop of a camera cannot be shaped; None where it can."""
    camera = scene.camera
    if isinstance(camera, ThickLensCamera):
        return "the stop of a thick lens is round"
    if isinstance(camera, RealisticCamera):
        return None if scene.load_lens().stop is not None else "this lens has no stop: its rims limit the light"
    return None if isinstance(camera, ThinLensCamera) else "this camera has no opening"


def turn_format(panel: Panel, value: Any) -> Turned:
    """Put another film behind the lens."""
    name = word("format", value, tuple(SIDES_MM))
    film = change_scene(panel.scene, film=dict.fromkeys(SIZES) | {"format": name})
    size = film_mm(film)
    return Turned(replace(panel.dials, whole_mm=size, cropped_mm=size), {"film.format": name})
