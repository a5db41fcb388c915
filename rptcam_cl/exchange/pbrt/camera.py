"""Cameras, films and filters of pbrt as ours, and which way round the world of ours is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.exchange.conversion import Array, Matrix, apply, is_invertible, mean_scale, motion_between, tidy
from rptcam_cl.exchange.pbrt.world import Context, Entity
from rptcam_cl.optics.library import load_lens
from rptcam_cl.scene.assets.pictures import read_picture
from rptcam_cl.scene.placement import ObjectKeyframe, Trajectory

#
# Where the camera stands, and which way round the world of ours is.
#
# pbrt's world is left-handed: the same numbers in our right-handed one would show everything in a mirror, unless the
# file begins with ``Scale -1 1 1`` as those do that come from right-handed programs. So the x axis is reversed if,
# and only if, a picture would be mirrored otherwise; scenes of right-handed programs keep their coordinates.

# Scales that are 1 but for the digits of a matrix that was written out.
_ROUNDING = 1e-4

_MILLIMETRE = 1e-3  # metres

_CAMERA_STEPS = 8  # keyframes of a camera go straight: a turn of a right angle is within 0.5 degrees

MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])

# What each axis of pbrt's camera is in the picture: right, up and the middle of what is seen.
_AXES = {
    "perspective": np.eye(3),
    # phi of its picture runs from +x over +z: the middle column looks to -x, what lies right of it to -z
    "environment": np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
}


@dataclass(frozen=True, eq=False)
class CameraFrame:
    """The camera's place, in the world of ours.

    Attributes
    ----------
    world : (4, 4) array
        Maps pbrt's world to ours: the identity, or `MIRROR`.
    eye, forward, up : (3,) arrays
    metres_per_unit : float
        Length of a unit of the world, when one unit of the camera's space is a metre, as pbrt has it for lenses (or a
        millimetre, see `_in_millimetres`).
    stretch : (2,) array
        Factors that uneven scaling puts on the width and height of what is seen; 1 for nearly every scene.
    """

    world: Matrix
    eye: Array
    forward: Array
    up: Array
    metres_per_unit: float
    stretch: Array

    def pose(self) -> dict[str, Any]:
        """Return the keys of a camera's pose; the target lies one unit before the eye."""
        return {
            "eye": tidy(self.eye),
            "target": tidy(self.eye + self.forward),
            "up": tidy(self.up),
        }


def _in_millimetres(camera: Entity) -> bool:
    """Return whether a unit of the camera's space is a millimetre: for the lens camera that plugs into pbrt-v2.

    It is that of the course assignments (Stanford CS 348b, HW3), whose lens files and film are in millimetres.
    """
    return camera.kind == "realistic" and camera.parameters.has("specfile")


def frame_of(camera: Entity) -> CameraFrame:
    """Return the frame of a camera.

    Raises
    ------
    InputError
        When its transform cannot be inverted.
    """
    if not is_invertible(camera.world_from_object):
        raise camera.error("the transform before it cannot be inverted")
    world_from_camera = np.asarray(np.linalg.inv(camera.world_from_object), np.float64)
    whole = camera.kind in ("environment", "spherical")
    axes = _AXES["environment" if whole else "perspective"]
    right, up, forward = (world_from_camera[:3, :3] @ axes.T).T
    world = MIRROR if right @ np.cross(forward, up) < 0 else np.eye(4)
    eye = apply(world, world_from_camera[None, :3, 3])[0]
    lengths = np.linalg.norm(world_from_camera[:3, :3], axis=0)
    stretch = lengths[:2] / lengths[2]
    if np.allclose(stretch, 1, rtol=0, atol=_ROUNDING):
        stretch = np.ones(2)
    unit = mean_scale(camera.world_from_object) * (_MILLIMETRE if _in_millimetres(camera) else 1.0)
    forward, up = (world[:3, :3] @ (axis / np.linalg.norm(axis)) for axis in (forward, up))
    reach = max(1.0, float(np.abs(eye).max()) * 1e-3)  # so that eye + forward keeps its digits
    return CameraFrame(world, eye, forward * reach, up, 1.0 if abs(unit - 1) < _ROUNDING else unit, stretch)


def camera_motion(context: Context, camera: Entity) -> dict[str, Any]:
    """Return the keyframes of a camera that moves, nothing for one at rest; pbrt turns it about itself."""
    if camera.at_end is None:
        return {}
    start = np.asarray(np.linalg.inv(camera.world_from_object), np.float64)
    end = np.asarray(np.linalg.inv(camera.at_end), np.float64) if is_invertible(camera.at_end) else None
    frames = None if end is None else motion_between(start, end, context.scene.times)
    if frames is None:
        context.approximated(camera, "it stays as it is at the start, as it does more than turn and shift")
        return {}
    context.moves = True
    way = Trajectory([ObjectKeyframe.model_validate(each) for each in frames])
    rest = start.copy()
    rest[:3, 3] = 0
    poses = []
    for time_s in np.linspace(*context.scene.times, _CAMERA_STEPS + 1):
        now = np.asarray(np.linalg.inv(way.at(float(time_s)) @ rest), np.float64)
        poses.append({"time_s": float(time_s), **frame_of(replace(camera, world_from_object=now)).pose()})
    return {"motion": poses}


def shutter_of(context: Context, camera: Entity) -> dict[str, Any]:
    """Return the shutter of a scene in which something moves, nothing where nothing does."""
    opens, closes = (camera.parameters.number(f"shutter{name}", at) for name, at in (("open", 0.0), ("close", 1.0)))
    if not context.moves:
        return {}
    if not closes > opens:
        context.approximated(camera, "its shutter is open for 1 µs, and not for no time at all")
    return {"shutter": {"open_s": opens, "time_s": max(closes - opens, 1e-6)}}


# Reconstruction filters of pbrt as those of our film.

Keys = dict[str, Any]

# Radius without parameters [pixels], in pbrt-v3 and in pbrt-v4; and our kind.
_KINDS = {
    "box": (0.5, 0.5, "box"), "triangle": (2.0, 2.0, "tent"), "gaussian": (2.0, 1.5, "gaussian"),
    "mitchell": (2.0, 2.0, "mitchell"), "sinc": (4.0, 4.0, "mitchell"),
}  # fmt: skip
# Our Gaussian ends three standard deviations out, as that of pbrt-v4 does by default.
_SIGMAS = 3.0
_THIRD = 1 / 3


def filter_keys(context: Context) -> Keys:
    """Return the filter of a film, nothing for a box of one pixel, which is pbrt-v3's default and ours."""
    entity = context.scene.options.get("PixelFilter")
    third = context.scene.version == 3
    if entity is None:
        return {} if third else {"filter": {"kind": "gaussian", "radius_px": 1.5}}
    if entity.kind not in _KINDS:
        raise entity.unknown("filter", _KINDS)
    *defaults, kind = _KINDS[entity.kind]
    radius = _radius(context, entity, float(defaults[0 if third else 1]))
    if kind == "gaussian":
        radius = _gaussian_radius(context, entity, radius)
    if entity.kind == "sinc":
        entity.parameters.skip("tau")
        context.approximated(entity, "Mitchell's filter of radius 2")
        radius = 2.0
    if kind == "mitchell" and entity.kind == "mitchell":
        b, c = (entity.parameters.number(name, _THIRD) for name in ("B", "C"))
        if max(abs(b - _THIRD), abs(c - _THIRD)) > 1e-3:
            context.approximated(entity, "B and C as 1/3")
    if kind == "box" and radius == 0.5:
        return {}
    return {"filter": {"kind": kind, "radius_px": min(max(radius, 0.01), 16.0)}}


def _radius(context: Context, entity: Entity, default: float) -> float:
    """Return the radius, which is the same along x and y."""
    x, y = (
        entity.parameters.number(f"{axis}radius", entity.parameters.number(f"{axis}width", default)) for axis in "xy"
    )
    if not (x > 0 and y > 0):
        raise entity.error(f"the radius must be above 0 (got {x:g} and {y:g})")
    if x != y:
        context.approximated(entity, "the same radius along x and y")
    return (x + y) / 2


def _gaussian_radius(context: Context, entity: Entity, radius: float) -> float:
    """Return the radius of the Gaussian of the same width: sigma, or exp(-alpha x^2) in pbrt-v3."""
    alpha = entity.parameters.number("alpha", 2.0)
    if not alpha > 0:
        raise entity.error(f"alpha must be above 0 (got {alpha:g})")
    sigma = entity.parameters.number("sigma", 1 / math.sqrt(2 * alpha))
    if abs(radius - _SIGMAS * sigma) > 1e-6:
        context.approximated(entity, f"ends {_SIGMAS:g} standard deviations out, at {_SIGMAS * sigma:g} pixels")
    return _SIGMAS * sigma


# Film, sampler and integrator of pbrt as film and render settings of ours.

_DEFAULT_DIAGONAL_MM = 35.0
_DEFAULT_SAMPLES = 16
_DEFAULT_DEPTH = 5
# Film parameters that name or store the picture.
_STORAGE = ("filename", "savefp16", "coordinatesystem")
# Sampler parameters that change the pattern of samples, not their number.
_PATTERNS = ("jitter", "seed", "randomization", "dimensions", "samplepixelcenter")
_LIGHT_CHOICE = ("lightsamplestrategy", "lightsampler", "rrthreshold")


@dataclass(frozen=True)
class Raster:
    """The pixels of a film.

    Attributes
    ----------
    width, height : int
        Of the whole film.
    window : tuple of int
        The pixels to render: first and past-the-last column, first and past-the-last row, from the top left.
    """

    width: int
    height: int
    window: tuple[int, int, int, int]

    def widened(self, across: int, down: int) -> Raster:
        """Return a larger film of which this one is a part, whose middle lies off its own.

        Parameters
        ----------
        across, down
            By how many half pixels the middle of this film lies right of and above that of the larger one.
        """
        left, top = (across + abs(across)) // 2, (abs(down) - down) // 2
        x0, x1, y0, y1 = self.window
        window = (x0 + left, x1 + left, y0 + top, y1 + top)
        return replace(self, width=self.width + abs(across), height=self.height + abs(down), window=window)

    def keys(self) -> dict[str, Any]:
        """Return the keys of a film."""
        keys: dict[str, Any] = {"resolution": [self.width, self.height]}
        if self.window != (0, self.width, 0, self.height):
            sides = (self.width, self.width, self.height, self.height)
            keys["crop"] = [pixel / side for pixel, side in zip(self.window, sides, strict=True)]
        return keys


def raster_of(context: Context, film: Entity | None) -> Raster:
    """Return the pixels of a film; pbrt's default is 1280 x 720."""
    if film is None:
        return Raster(1280, 720, (0, 1280, 0, 720))
    parameters = film.parameters
    width, height = parameters.integer("xresolution", 1280), parameters.integer("yresolution", 720)
    if width < 1 or height < 1:
        raise film.error(f"the resolution must be at least 1 x 1 (got {width} x {height})")
    crop = parameters.numbers("cropwindow")
    bounds = parameters.numbers("pixelbounds", "integer", "float")
    if any(window is not None and len(window) != 4 for window in (crop, bounds)):
        raise film.error("a window needs 4 numbers, x0 x1 y0 y1")
    if crop is not None:
        sides = np.array([width, width, height, height])
        bounds = np.ceil(np.clip(np.stack([crop[:2], crop[2:]]), 0, 1).reshape(-1) * sides - 1e-9)
    if bounds is None:
        return Raster(width, height, (0, width, 0, height))
    x0, x1, y0, y1 = (int(value) for value in np.clip(bounds, 0, [width, width, height, height]))
    if x0 >= x1 or y0 >= y1:
        raise film.error("the window to render is empty")
    return Raster(width, height, (x0, x1, y0, y1))


def _diagonal_mm(context: Context) -> float:
    """Return the diagonal of the film [mm], of use to lens cameras only."""
    film = context.scene.options.get("Film")
    return _DEFAULT_DIAGONAL_MM if film is None else film.parameters.number("diagonal", _DEFAULT_DIAGONAL_MM)


def exposure_ev(context: Context, film: Entity | None, camera: Entity) -> float:
    """Return by how many stops pbrt brightens what its film records.

    pbrt-v3 has a factor ``scale``; the sensor of pbrt-v4 multiplies by exposure time x ISO / 100. Our linear film has
    neither, the tone-mapped picture takes them as ``picture.ev``.
    """
    shutter = camera.parameters.number("shutterclose", 1.0) - camera.parameters.number("shutteropen", 0.0)
    if film is None:
        return 0.0
    parameters = film.parameters
    parameters.skip(*_STORAGE)
    factor = parameters.number("scale", 1.0)
    name = "scale"
    if context.scene.version == 4:
        factor, name = parameters.number("iso", 100.0) / 100 * shutter, "sensor (exposure time x ISO / 100)"
        sensor = parameters.text("sensor", "cie1931")
        if sensor != "cie1931":
            context.report.ignored(film.place, f'the sensor "{sensor}": its colours and its imaging ratio')
    if not factor > 0 or factor == 1:
        return 0.0
    context.report.approximated(
        film.place, f"the film's {name} of {factor:g} goes to picture.ev; the linear film is not scaled"
    )
    return math.log2(factor)


def render_keys(context: Context) -> dict[str, Any]:
    """Return samples per pixel and path depth; pbrt loses what its facets scatter more than once."""
    options = context.scene.options
    keys = {"spp": _DEFAULT_SAMPLES, "max_depth": _DEFAULT_DEPTH + 1, "multiple_scattering": False}
    if (sampler := options.get("Sampler")) is not None:
        sampler.parameters.skip(*_PATTERNS)
        parameters = sampler.parameters
        if sampler.kind == "stratified":
            keys["spp"] = parameters.integer("xsamples", 4) * parameters.integer("ysamples", 4)
        else:
            keys["spp"] = parameters.integer("pixelsamples", _DEFAULT_SAMPLES)
        if keys["spp"] < 1:
            raise sampler.error(f"needs at least 1 sample per pixel (got {keys['spp']})")
    if (integrator := options.get("Integrator")) is not None:
        _note_integrator(context, integrator)
        depth = integrator.parameters.integer("maxdepth", _DEFAULT_DEPTH)
        if depth < 0:
            raise integrator.error(f"maxdepth must not be negative (got {depth})")
        keys["max_depth"] = depth + 1  # pbrt counts bounces, we count edges with the camera's
    return keys


def _note_integrator(context: Context, integrator: Entity) -> None:
    integrator.parameters.skip(*_LIGHT_CHOICE)
    if integrator.kind in ("volpath", "simplevolpath"):
        context.approximated(integrator, "paths without media")
    elif integrator.kind in ("bdpt", "mlt", "sppm", "lightpath"):
        context.approximated(integrator, "paths from the camera only")
    elif integrator.kind not in ("path", "simplepath"):
        context.report.approximated(
            integrator.place, f"{integrator.what} is another picture than paths of light give, which we compute"
        )


# Cameras of pbrt as cameras of ours.

# Shapes of the stop by name, as near as ours come (pbrt draws them as pictures of its own).
_STOPS: dict[str, Keys] = {
    "square": {"shape": "polygon", "blades": 4, "rotation_degrees": 45.0},
    "pentagon": {"shape": "polygon", "blades": 5, "rotation_degrees": 90.0},
    "star": {"shape": "star"},
}


_CameraKeys = tuple[Keys, Keys, Keys]  # of `camera`, of `film` and of the scene itself


def convert_camera(context: Context, camera: Entity, frame: CameraFrame, raster: Raster) -> _CameraKeys:
    """Return a camera as keys of a scene of ours."""
    kinds: dict[str, Callable[..., _CameraKeys]] = {
        "perspective": _perspective, "orthographic": _orthographic, "environment": _spherical,
        "spherical": _spherical, "realistic": _realistic,
    }  # fmt: skip
    if camera.kind not in kinds:
        raise camera.unknown("camera", kinds)
    if np.any(frame.stretch != 1) and camera.kind != "perspective":
        context.report.ignored(camera.place, "uneven scaling of the camera's space")
    return kinds[camera.kind](context, camera, frame, raster)


def _screen(camera: Entity, raster: Raster) -> Array:
    """Return x0, x1, y0, y1 of the screen window, on which the shorter side runs from -1 to 1."""
    window = camera.parameters.numbers("screenwindow")
    aspect = camera.parameters.number("frameaspectratio", raster.width / raster.height)
    if window is None:
        if not aspect > 0:
            raise camera.error(f"frameaspectratio must be above 0 (got {aspect:g})")
        x, y = (aspect, 1.0) if aspect > 1 else (1.0, 1 / aspect)
        return np.array([-x, x, -y, y])
    if len(window) != 4 or window[0] >= window[1] or window[2] >= window[3]:
        raise camera.error("screenwindow needs x0 x1 y0 y1 with x0 < x1 and y0 < y1")
    return window


def _centre_screen(context: Context, camera: Entity, raster: Raster) -> tuple[Raster, float, float]:
    """Return a film whose middle is on the axis, and its half width and height on the screen.

    A screen window off the axis is a part of a larger film; its edges come to the nearest half pixel.
    """
    x0, x1, y0, y1 = _screen(camera, raster)
    pixel_x, pixel_y = (x1 - x0) / raster.width, (y1 - y0) / raster.height
    shift_x, shift_y = (x0 + x1) / pixel_x, (y0 + y1) / pixel_y
    across, down = round(shift_x), round(shift_y)
    if abs(across - shift_x) > 1e-6 or abs(down - shift_y) > 1e-6:
        context.approximated(camera, "the screen window moves by part of a half pixel")
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


def _perspective(context: Context, camera: Entity, frame: CameraFrame, raster: Raster) -> _CameraKeys:
    raster, half_x, half_y = _centre_screen(context, camera, raster)
    half_x, half_y = half_x * frame.stretch[0], half_y * frame.stretch[1]
    fov = camera.parameters.number("fov", 90.0)
    if camera.parameters.has("halffov"):
        fov = 2 * camera.parameters.number("halffov", 45.0)
    if not 0 < fov < 180:
        raise camera.error(f"fov must lie between 0 and 180 degrees (got {fov:g})")
    axis, half = ("vertical", half_y) if half_y < half_x else ("horizontal", half_x)
    if half != 1:
        fov = math.degrees(2 * math.atan(half * math.tan(math.radians(fov) / 2)))
    keys: Keys = {"kind": "pinhole", **frame.pose(), "fov_degrees": fov, "fov_axis": axis}
    radius = camera.parameters.number("lensradius", 0.0)
    distance = camera.parameters.number("focaldistance", 1e6)
    if radius > 0:
        if not distance > 0:
            raise camera.error(f"focaldistance must be above 0 (got {distance:g})")
        keys |= {"kind": "thin_lens", "aperture_radius_m": radius, "focus_distance_m": min(distance, 1e12)}
    return keys, _film_keys(raster, half_x, half_y), {}


def _orthographic(context: Context, camera: Entity, frame: CameraFrame, raster: Raster) -> _CameraKeys:
    raster, half_x, half_y = _centre_screen(context, camera, raster)
    if camera.parameters.number("lensradius", 0.0) > 0:
        context.ignored(camera, "the lens radius of a parallel view")
    camera.parameters.skip("focaldistance")
    keys = {"kind": "orthographic", **frame.pose(), "width_m": 2 * half_x}
    return keys, _film_keys(raster, half_x, half_y), {}


def _spherical(context: Context, camera: Entity, frame: CameraFrame, raster: Raster) -> _CameraKeys:
    camera.parameters.skip("lensradius", "focaldistance", "frameaspectratio", "screenwindow")
    mapping = camera.parameters.text("mapping", "equalarea" if camera.kind == "spherical" else "equirectangular")
    if mapping not in ("equalarea", "equirectangular"):
        raise camera.place.error(f'unknown mapping "{mapping}" (allowed: equalarea, equirectangular)')
    if mapping == "equalarea":
        context.approximated(camera, "longitude and latitude in place of the equal-area square")
    if raster.width != 2 * raster.height:
        context.approximated(
            camera, f"the film becomes {2 * raster.height} x {raster.height} pixels, twice as wide as high"
        )
        raster = Raster(2 * raster.height, raster.height, (0, 2 * raster.height, 0, raster.height))
    return {"kind": "environment", **frame.pose()}, raster.keys(), {}


def _realistic(context: Context, camera: Entity, frame: CameraFrame, raster: Raster) -> _CameraKeys:
    parameters = camera.parameters
    if _in_millimetres(camera):
        return _realistic_of_v2(context, camera, frame, raster)
    keys, _ = _lens_keys(context, camera, "lensfile", "aperturediameter")
    keys = {**keys, **frame.pose(), "focus": {"distance_m": parameters.number("focusdistance", 10.0)}}
    keys |= _stop_shape(context, camera)
    weighting = context.scene.version == 3 and parameters.boolean("simpleweighting", True)
    if weighting:
        context.approximated(camera, "simple weighting as exposure relative to the axis")
    scene = {"exposure": "relative" if weighting else "irradiance"}
    return keys, {**raster.keys(), "diagonal_mm": _diagonal_mm(context)}, scene


def _realistic_of_v2(context: Context, camera: Entity, frame: CameraFrame, raster: Raster) -> _CameraKeys:
    """Return the lens camera of pbrt-v2's assignments: its place is that of the front vertex, its film is given.

    Distances are millimetres, and the light is irradiance on the film (the weight A cos^4 / Z^2 of the assignment).
    """
    parameters = camera.parameters
    keys, length_mm = _lens_keys(context, camera, "specfile", "aperture_diameter")
    distance = parameters.number("filmdistance", 70.0)
    diagonal = parameters.number("filmdiag", _DEFAULT_DIAGONAL_MM)
    for name, length in (("filmdistance", distance), ("filmdiag", diagonal)):
        if not length > 0:
            raise camera.error(f'"{name}" must be above 0 mm (got {length:g})')
    back = (length_mm + distance) * _MILLIMETRE / frame.metres_per_unit
    eye = frame.eye - back * frame.forward / np.linalg.norm(frame.forward)
    pose = {**frame.pose(), "eye": tidy(eye)}
    film = {**raster.keys(), "diagonal_mm": diagonal}
    return {**keys, **pose, "focus": {"film_distance_mm": distance}}, film, {"exposure": "irradiance"}


def _lens_keys(context: Context, camera: Entity, file_key: str, diameter_key: str) -> tuple[Keys, float]:
    """Return the keys of a lens and its stop, and the length of the lens [mm]."""
    parameters = camera.parameters
    name = parameters.text(file_key, "")
    if not name:
        raise camera.place.error(f"{camera.what} needs a lens file")
    place = parameters.items[file_key].place
    path = context.find(name, place)
    lens = load_lens(path)
    file = context.files.reference(path, place)
    # a name without a folder is that of a lens of the library
    keys: Keys = {"kind": "realistic", "lens": file if "/" in file else f"./{file}"}
    diameter = parameters.number(diameter_key, 1.0)
    if lens.stop is None:
        context.report.ignored(place, "the aperture diameter: the lens has no stop")
    elif diameter > (widest := 2 * lens.stop.semi_diameter):
        context.report.noted(place, f"the stop opens to {widest:g} mm, not to {diameter:g} mm, as in pbrt")
    elif not diameter > 0:
        raise camera.error(f'"{diameter_key}" must be above 0 mm (got {diameter:g})')
    else:
        keys["stop_diameter_mm"] = diameter
    return keys, lens.length


def _stop_shape(context: Context, camera: Entity) -> Keys:
    """Return the shape of the stop; pbrt-v4 knows some by name, others are pictures."""
    shape = camera.parameters.text("aperture", "circular")
    if shape == "circular":
        return {}
    place = camera.parameters.items["aperture"].place
    if shape in _STOPS:
        context.report.approximated(place, f'the stop "{shape}" in our shape of the name')
        return {"aperture": _STOPS[shape]}
    if shape == "gaussian":
        context.report.ignored(place, 'the stop "gaussian": a stop is open or shut')
        return {}
    file = context.files.reference(context.find(shape, place), place, read_picture)
    return {"aperture": {"shape": "image", "file": file}}
