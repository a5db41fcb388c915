"""From a pbrt scene file to a scene of ours: its lights and its sky, and the whole."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import LUMENS_PER_WATT
from rptcam_cl.core.colour import LUMINANCE, luminance
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import Folders, plain
from rptcam_cl.exchange import conversion
from rptcam_cl.exchange.conversion import Array, Conversion, Matrix, Place
from rptcam_cl.exchange.pbrt import materials, shapes, textures
from rptcam_cl.exchange.pbrt.camera import (
    CameraFrame,
    camera_motion,
    convert_camera,
    exposure_ev,
    filter_keys,
    frame_of,
    raster_of,
    render_keys,
    shutter_of,
)
from rptcam_cl.exchange.pbrt.world import ODD, Context, Entity, read_world
from rptcam_cl.rendering.plan.environment import axes
from rptcam_cl.scene.assets.pictures import write_exr
from rptcam_cl.scene.load import Missing

Keys = dict[str, Any]

# Lights without a surface: point, spot, distant, and constant light from everywhere.


def _convert_lights(context: Context, frame: CameraFrame) -> tuple[list[Keys], Array, list[Entity]]:
    """Return the lights of a scene of ours, the constant light of its sky, and the maps of the sky as they are."""
    lights: list[Keys] = []
    sky = np.zeros(3)
    maps: list[Entity] = []
    kinds: dict[str, Callable[[Context, Entity, CameraFrame], Keys]] = {
        "point": _point, "goniometric": _picture_lamp, "projection": _picture_lamp, "spot": _spot, "distant": _distant,
    }  # fmt: skip
    for entity in context.scene.lights:
        entity.parameters.skip(*textures.SAMPLING)
        if (entity.kind in kinds or _is_map(entity)) and not conversion.is_bearable(_world(entity, frame)):
            entity.parameters.skip_all()
            context.ignored(entity, ODD)
        elif entity.kind in ("infinite", "exinfinite"):
            if entity.parameters.has("portal"):
                entity.parameters.skip("portal")
                context.ignored(entity, "its portal; the light comes from everywhere")
            if _is_map(entity):
                maps.append(entity)
            else:
                sky = sky + _radiance(context, entity, math.pi)
        elif entity.kind in kinds:
            lights.append(kinds[entity.kind](context, entity, frame))
        else:
            entity.parameters.skip_all()
            context.ignored(entity, f"there is no such light (known: {', '.join(kinds)}, infinite)")
    return lights, sky, maps


def _is_map(entity: Entity) -> bool:
    return entity.parameters.has("mapname") or entity.parameters.has("filename")


def _world(entity: Entity, frame: CameraFrame) -> Matrix:
    return np.asarray(frame.world @ entity.world_from_object)


def _intensity(context: Context, entity: Entity, frame: CameraFrame, solid_angle: float) -> list[float]:
    """Return the radiant intensity; pbrt divides it by distances in its units, we by metres.

    ``power`` of pbrt-v4 is divided by the solid angle that gets it.
    """
    colour = textures.light(context, entity, "I") * textures.coefficients(context, entity, "scale")
    power = entity.parameters.number("power", -1.0)
    colour = colour * (power / solid_angle if power > 0 else 1.0)
    return (colour * frame.metres_per_unit**2).tolist()  # type: ignore[no-any-return]


def _radiance(context: Context, entity: Entity, per_illuminance: float) -> Array:
    """Return the colour L of a light, times its illuminance over what of it a light of 1 gives."""
    colour = textures.light(context, entity, "L") * textures.coefficients(context, entity, "scale")
    illuminance = entity.parameters.number("illuminance", -1.0)
    return colour * illuminance / per_illuminance if illuminance > 0 else colour


_EDGE_STEPS = 64  # of the edge of a cone: between them its fourth power is straight, 1e-3 of the middle off
_STEP_DEGREES = 0.5  # of the directions of a lamp that shines with a picture, those that ours tells apart


def _picture_lamp(context: Context, entity: Entity, frame: CameraFrame) -> Keys:
    """Return a lamp that shines with a picture, goniometric or a projector, as one measured in many directions."""
    parameters = entity.parameters
    fov = parameters.number("fov", 90.0 if context.scene.version == 4 else 45.0) if entity.kind == "projection" else 0.0
    pixels, stem = _lamp_picture(context, entity)
    if not (stem or fov):
        return _point(context, entity, frame)
    world = _world(entity, frame)
    vertical, horizontal = np.arange(0, 180.1, _STEP_DEGREES), np.arange(0, 360.1, _STEP_DEGREES)
    down, around = np.radians(vertical), np.radians(horizontal)[:, None]
    aside = np.sin(down)
    out = np.stack(np.broadcast_arrays(aside * np.cos(around), aside * np.sin(around), -np.cos(down)), axis=-1)
    local = out @ np.linalg.inv(world[:3, :3]).T
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    shown = _project_picture(pixels, local, fov, context.scene.version)
    weights = aside * np.ones_like(around) / (aside.sum() * len(around))  # of the whole sphere
    mean = np.einsum("ij,ijk->k", weights, shown)
    if not mean.any():
        context.approximated(entity, "a point light without its picture, which is black where it is looked up")
        return _point(context, entity, frame)
    tint = mean / float(luminance(mean))
    if np.ptp(tint) > 1e-3:
        context.approximated(entity, "its picture in one colour, the mean")
    pattern = shown @ np.asarray(LUMINANCE)
    if fov:
        context.approximated(entity, f"its beam in steps of {_STEP_DEGREES:g} degrees")
    color = tint * _intensity(context, entity, frame, 4 * math.pi * float(luminance(mean)))
    largest = float(pattern.max())
    file = context.files.add(
        "files", f"{stem or entity.kind}.ies", partial(_write_ies, vertical, horizontal, pattern / largest)
    )
    return _profile_keys(file, largest * color, conversion.apply(world, np.zeros((1, 3)))[0], np.array([0, 0, -1]))


def _lamp_picture(context: Context, entity: Entity) -> tuple[textures.Pixels, str]:
    """Return the picture of a lamp and the stem of its file; white and "", with a report, without one."""
    items = entity.parameters.items
    key = "filename" if "filename" in items else "mapname"
    name = entity.parameters.text(key, "")
    path = context.find_or_note(name, items[key].place, "the lamp shines evenly") if name else None
    if path is not None and textures.is_readable(path):
        return textures.lamp_pixels(context, path, items[key].place), path.stem
    context.approximated(entity, "shines evenly, without a picture")
    return np.ones((1, 1, 3), np.float32), ""


def _profile_keys(file: str, intensity: Array, position: Array, direction: Array) -> Keys:
    """Return a lamp of a pattern whose largest value is 1, with the intensity that it has there."""
    return {
        "kind": "ies", "file": file, "position": conversion.tidy(position), "direction": conversion.tidy(direction),
        "gain": float(luminance(intensity)), "color": (intensity / max(intensity.max(), 1e-30)).tolist(),
    }  # fmt: skip


def _project_picture(pixels: textures.Pixels, local: Array, fov: float, version: int) -> Array:
    """Look up a lamp's picture in directions of its own frame (…, 3): a projector's, or one all round.

    The whole sphere lies on a square of equal area in pbrt-v4, in longitude and latitude about +y in pbrt-v3.
    """
    height, width = pixels.shape[:2]
    x, y, z = np.moveaxis(local, -1, 0)
    inside = np.ones(x.shape, bool)
    if fov:
        aspect = np.array([max(width / height, 1.0), max(height / width, 1.0)])
        ahead = np.maximum(z, 1e-3) * math.tan(math.radians(fov) / 2)
        u, v = (axis / ahead / reach / 2 + 0.5 for axis, reach in zip((x, y), aspect, strict=True))
        inside = (z > 1e-3) & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    elif version == 4:
        u, v = square_of_angles(z, np.arctan2(y, x))
    else:
        u, v = np.arctan2(z, x) / (2 * np.pi) % 1, np.arccos(np.clip(y, -1, 1)) / np.pi
    column, row = (np.clip(share * count, 0, count - 1).astype(np.intp) for share, count in ((u, width), (v, height)))
    return np.asarray(np.where(inside[..., None], pixels[row, column], 0.0), np.float64)


def _write_ies(vertical: Array, horizontal: Array, pattern: Array, path: Path) -> None:
    """Write a pattern of intensities, 1 standing for 1 W/sr, by horizontal and vertical angle."""
    head = f"IESNA:LM-63-2002\nTILT=NONE\n1 -1 {LUMENS_PER_WATT:g} {len(vertical)} {len(horizontal)} 1 2 0 0 0\n1 1 0\n"
    rows = [" ".join(f"{value:.5g}" for value in row) for row in (vertical, horizontal, *pattern)]
    path.write_text(head + "\n".join(rows) + "\n", encoding="ascii")


def _point(context: Context, entity: Entity, frame: CameraFrame) -> Keys:
    position = conversion.apply(_world(entity, frame), entity.parameters.vector("from", (0, 0, 0))[None])[0]
    intensity = _intensity(context, entity, frame, 4 * math.pi)
    return {"kind": "point", "position": conversion.tidy(position), "intensity": intensity}


def _spot(context: Context, entity: Entity, frame: CameraFrame) -> Keys:
    """Return a spot light, whose edge is the smooth step of pbrt-v4; of pbrt-v3 and v2 a lamp measured by angle."""
    parameters = entity.parameters
    outer, delta = parameters.number("coneangle", 30.0), parameters.number("conedeltaangle", 5.0)
    if not 0 < outer <= 180 or delta < 0:
        raise entity.error("coneangle must lie between 0 and 180, conedeltaangle not below 0")
    inner = min(max(outer - delta, 0.0), outer * (1 - 1e-6))  # ours needs an edge
    start, stop = math.cos(math.radians(inner)), math.cos(math.radians(outer))
    origin, direction = _ray(entity, frame)
    if context.scene.version == 3 and not parameters.has("power"):  # which pbrt-v4 alone has
        edge = np.linspace(inner, outer, _EDGE_STEPS + 1)
        pattern = ((np.cos(np.radians(edge)) - stop) / (start - stop)) ** 4
        vertical = np.concatenate([[0.0][: inner > 0], edge, [180.0][: outer < 180]])
        pattern = np.concatenate([[1.0][: inner > 0], pattern, [0.0][: outer < 180]])
        write = partial(_write_ies, vertical, np.zeros(1), pattern[None])
        file = context.files.add("files", f"cone-{outer:g}-{inner:g}.ies", write)
        color = np.array(_intensity(context, entity, frame, math.nan))
        return _profile_keys(file, color, origin, direction)
    if context.scene.version == 3:
        context.approximated(entity, "the edge of its cone as a smooth step")
    return {
        "kind": "spot",
        "position": conversion.tidy(origin),
        "direction": conversion.tidy(direction),
        "intensity": _intensity(context, entity, frame, 2 * math.pi * ((1 - start) + (start - stop) / 2)),
        "outer_degrees": outer,
        "inner_degrees": inner,
    }


def _ray(entity: Entity, frame: CameraFrame) -> tuple[Array, Array]:
    """Return where in the world of ours a light stands, and the direction to what it looks at."""
    world, origin = _world(entity, frame), entity.parameters.vector("from", (0, 0, 0))
    direction = world[:3, :3] @ (entity.parameters.vector("to", (0, 0, 1)) - origin)
    if not np.linalg.norm(direction) > 0:
        raise entity.error('"from" and "to" are the same point')
    return conversion.apply(world, origin[None])[0], direction


def _distant(context: Context, entity: Entity, frame: CameraFrame) -> Keys:
    _, direction = _ray(entity, frame)
    irradiance = _radiance(context, entity, 1.0)
    return {"kind": "directional", "direction": conversion.tidy(direction), "irradiance": irradiance.tolist()}


# The sky: constant light, and pictures of the surroundings.


def _convert_sky(context: Context, frame: CameraFrame, sky: Array, maps: list[Entity]) -> Keys | None:
    """Return the environment of a scene of ours from constant light and maps of the sky, None for a black one."""
    constant: Keys | None = {"kind": "constant", "radiance": sky.tolist()} if sky.any() else None
    used = None
    for entity in maps:
        if used is None:
            used = _of_map(context, entity, frame, sky)
        else:
            entity.parameters.skip_all()
            context.ignored(entity, "a second picture of the sky")
    return used or constant


def _of_map(context: Context, entity: Entity, frame: CameraFrame, sky: Array) -> Keys | None:
    """Return the environment that a picture makes; None, with a report, when it cannot be read."""
    parameters = entity.parameters
    key = "filename" if parameters.has("filename") else "mapname"
    name, place = parameters.text(key, ""), parameters.items[key].place
    path = context.find_or_note(name, place, f"a sky of grey {textures.GREY:g}")
    if path is None:
        parameters.skip_all()
        return {"kind": "constant", "radiance": np.full(3, textures.GREY).tolist()}
    factor = textures.coefficients(context, entity, "scale") * (
        textures.light(context, entity, "L") if key == "mapname" else 1.0
    )
    if (illuminance := parameters.number("illuminance", -1.0)) > 0:
        context.report.noted(
            parameters.items["illuminance"].place,
            f"{entity.what}: a picture with an illuminance is twice as bright as that says, as pbrt has it",
        )
    if not textures.is_readable(path):
        context.report.ignored(place, f"{name}: {textures.NOT_READ} (allowed: {' '.join(textures.READABLE)})")
        return None
    up, rotation_degrees, mirrored = _placement(context, entity, frame)
    keys: Keys = {"kind": "image", "file": "", "up": conversion.tidy(up)}
    if rotation_degrees:
        keys["rotation_degrees"] = rotation_degrees
    as_it_is = path.suffix.lower() in (".exr", ".hdr", ".pfm")  # bytes are linear here, and sRGB in scenes of ours
    if key == "mapname" and as_it_is and not mirrored and np.ptp(factor) == 0 and not sky.any():
        keys["file"] = textures.picture_name(context, path, place)
        return keys | ({"gain": float(factor[0])} if factor[0] != 1 else {})
    pixels = textures.lamp_pixels(context, path, place)
    if key == "filename":
        factor = factor * _photometric(pixels, illuminance, place)
        pixels = in_longitude_and_latitude(pixels, clockwise=mirrored)
        how = "from the equal-area square to longitude and latitude"
    else:
        pixels = pixels[:, ::-1] if mirrored else pixels
        how = "mirrored" if mirrored else "with its factor" if as_it_is else "with its bytes taken as linear"
    pixels = (pixels * factor + sky).astype(np.float32)
    keys["file"] = context.files.add("files", f"{path.stem}-sky.exr", partial(write_exr, {"RGB": pixels}))
    context.report.noted(place, f"{name}: written anew {how}, to {keys['file']}")
    return keys


def _placement(context: Context, entity: Entity, frame: CameraFrame) -> tuple[Array, float, bool]:
    """Return the direction of the top row of a picture of the sky, its turn [degrees], and whether it is mirrored.

    pbrt's column at a quarter looks along +y of the light, the middle one along -x. A mirrored one has columns that run
    against the turn of our longitude.
    """
    matrix = frame.world @ entity.world_from_object
    if not conversion.is_similarity(matrix):
        context.approximated(entity, "without the uneven scaling of its transform")
    x, _, up = (axis / np.linalg.norm(axis) for axis in matrix[:3, :3].T)
    forward = -(x - up * (x @ up))
    right_at_0, _, forward_at_0 = axes(up.tolist(), 0.0)
    turn = math.degrees(math.atan2(-(forward @ right_at_0), forward @ forward_at_0))
    return up, round(turn, 10) + 0.0, not conversion.reflects(matrix)


def _photometric(pixels: textures.Pixels, illuminance: float, place: Place) -> float:
    """Return the factor by which pbrt-v4 brightens a picture for an illuminance of the ground; 1 without a request.

    pbrt counts 2 pi for the sphere of all pixels, whose solid angle is 4 pi: the ground has twice that illuminance.
    """
    size = len(pixels)
    if pixels.shape[1] != size:
        raise place.error(
            f"the picture must be square, an equal-area map of the sphere (got {pixels.shape[1]} x {size} pixels)"
        )
    if illuminance <= 0:
        return 1.0
    own_illuminance = float((pixels @ LUMINANCE * np.clip(square_heights(size), 0, None)).sum()) * 2 * math.pi / size**2
    if not own_illuminance > 0:
        raise place.error("the picture is black above the horizon, so that it cannot give an illuminance")
    return illuminance / own_illuminance


# The equal-area map between the sphere and a square, in which pbrt-v4 stores pictures of the sky.
#
# P. Clarberg, "Fast equal-area mapping of the (hemi)sphere using SIMD", Journal of Graphics Tools 13 (3), 2008: the
# upper half sphere fills the diamond in the middle of the square, the lower one its corners.

# Samples across and down each pixel of a picture in longitude and latitude.
_SAMPLES = 4
_TALLEST = 4096  # rows; twice as many columns are half of the pixels that a picture may have


def square_of_angles(z: ArrayLike, longitude: ArrayLike) -> tuple[Array, Array]:
    """Return the coordinates, 0 to 1 from the left and from the top, of directions.

    Parameters
    ----------
    z
        Cosine of the angle from the pole +z, which is the middle of the square.
    longitude
        Angle from +x over +y [rad].
    """
    height = np.asarray(z, np.float64)
    x, y = np.cos(longitude), np.sin(longitude)
    radius = np.sqrt(np.clip(1 - np.abs(height), 0, 1))
    v = radius * (np.arctan2(np.abs(y), np.abs(x)) * (2 / np.pi))
    u = radius - v
    below = height < 0
    u, v = np.where(below, 1 - v, u), np.where(below, 1 - u, v)
    return (np.copysign(u, x) + 1) / 2, (np.copysign(v, y) + 1) / 2


def square_heights(size: int) -> Array:
    """Return z of the directions of the pixels' centres of a square picture, (size, size)."""
    a = np.abs(2 * (np.arange(size) + 0.5) / size - 1)
    above = 1 - (a[:, None] + a[None, :])
    return np.asarray(np.copysign(1 - (1 - np.abs(above)) ** 2, above))


def in_longitude_and_latitude(square: NDArray[np.float32], *, clockwise: bool) -> NDArray[np.float32]:
    """Return a square picture of the sphere as one in longitude and latitude, twice as wide as high.

    Each pixel is the mean of `_SAMPLES` x `_SAMPLES` pixels that lie under it, spread evenly in longitude and latitude.

    Parameters
    ----------
    square : (n, n, 3) array
    clockwise
        Whether longitude falls from the left edge to the right one; it is 180 degrees in the middle either way.
    """
    size = len(square)
    rows = min(size, _TALLEST)
    longitude = (np.arange(2 * rows * _SAMPLES) + 0.5) / (2 * rows * _SAMPLES) * (2 * np.pi)
    if clockwise:
        longitude = longitude[::-1]
    converted = np.empty((rows, 2 * rows, 3), np.float32)
    for row in range(rows):
        latitude = np.pi * (row + (np.arange(_SAMPLES) + 0.5) / _SAMPLES) / rows
        u, v = square_of_angles(np.cos(latitude)[:, None], longitude[None, :])
        column = np.minimum((u * size).astype(np.intp), size - 1)
        line = np.minimum((v * size).astype(np.intp), size - 1)
        samples = square[line, column].reshape(_SAMPLES, 2 * rows, _SAMPLES, 3)
        converted[row] = samples.mean(axis=(0, 2), dtype=np.float64)
    return converted


_DEEP = 200  # times that light is scattered below a surface, at most


def convert_scene(source: Path, target: Path, *, missing: Missing = "error", root: Path | None = None) -> Conversion:
    """Convert a pbrt scene file to a scene of ours.

    Parameters
    ----------
    source
        A scene file of pbrt-v2, v3 or v4.
    target
        Where the scene of ours is to go; files that it names lie in the folder of it.
    missing
        What becomes of pictures and meshes that are not there: an error that names them all, or grey in place of
        pictures and no object in place of meshes; the report lists them.
    root
        A further folder inside which files of the pbrt scene may lie, such as one above that of the scene.

    Raises
    ------
    InputError
        ``FILE:LINE:COL: problem`` for what is not a pbrt scene, or cannot be said.
    """
    report = conversion.Report()
    folders = Folders(source.parent, () if root is None else (root,), owner="pbrt scene")
    pbrt = read_world(source, report, folders)
    context = Context(pbrt, report, folders, conversion.FileStore(target.parent, target.stem, report), missing)
    scene = _scene_keys(context, source)
    context.refuse_missing()
    _note_unused(context)
    return Conversion(source, scene, report, context.files)


def _scene_keys(context: Context, source: Path) -> dict[str, Any]:
    options = context.scene.options
    camera = options.get("Camera")
    if camera is None:
        raise InputError(f"{source}: has no Camera; is it a part that another file includes?")
    frame = frame_of(camera)
    context.world, context.metres_per_unit = frame.world, frame.metres_per_unit
    film = options.get("Film")
    raster = raster_of(context, film)
    camera_keys, film_keys, own_keys = convert_camera(context, camera, frame, raster)
    if film is not None:
        film.parameters.skip("diagonal")
    scene: dict[str, Any] = {"film": {**film_keys, **filter_keys(context)}, "camera": camera_keys, **own_keys}
    scene["render"] = render_keys(context)
    if frame.metres_per_unit != 1:
        scene["metres_per_unit"] = frame.metres_per_unit
    if ev := exposure_ev(context, film, camera):
        scene["picture"] = {"ev": ev}
    camera_keys |= camera_motion(context, camera)
    objects = shapes.Objects(context, frame)
    objects.add_all()
    scene |= shutter_of(context, camera)
    sections = objects.keys()
    if "objects" not in sections:
        context.refuse_missing()
        raise InputError(_no_objects(context, source))
    scene |= sections
    around = context.scene.media.get(context.scene.around_camera)
    if around is not None and (fog := materials.medium_keys(context, around)) is not None:
        scene["medium"] = fog
    if context.deep and scene["render"].get("max_depth", 8) < _DEEP:
        scene["render"]["max_depth"] = _DEEP
    lights, sky, maps = _convert_lights(context, frame)
    if lights:
        scene["lights"] = lights
    if (environment := _convert_sky(context, frame, sky, maps)) is not None:
        scene["environment"] = environment
    return dict(plain(scene))


def _no_objects(context: Context, source: Path) -> str:
    """Return the error for a scene in which nothing could be seen, with the first reason."""
    count = sum(1 for _ in context.scene.placed())
    if not count:
        return f"{source}: 0 objects: the scene has no shapes that are placed"
    why = next((line for line in context.report if "ignored: Shape" in line), "")
    return f"{source}: 0 objects: none of its {count} shapes can be shown{f'; {why}' if why else ''}"


def _note_unused(context: Context) -> None:
    """Report every parameter that was never looked up, and count the objects that each line says something of."""
    scene = context.scene
    entities = [*scene.options.values(), *scene.lights]
    uses = {id(use): use for use, _, _ in scene.placed()}
    counts = Counter(id(use) for use, _, _ in scene.placed())
    for index, use in uses.items():
        shown = [entity for entity in (use.shape, scene.material_of(use.material), use.lamp) if entity is not None]
        shown += [texture for entity in shown for texture in entity.textures.values()]
        entities += shown
        places = [entity.place for entity in shown]
        places += [item.place for entity in shown for item in entity.parameters.items.values()]
        for line in {(place.source.name, place.line_number) for place in places}:
            context.report.objects[line] += counts[index]
    for parameters in dict.fromkeys(entity.parameters for entity in entities):
        for item in parameters.unused():
            context.report.ignored(item.place, f'{parameters.what}: "{item.kind} {item.name}"')
