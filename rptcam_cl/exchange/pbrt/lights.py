"""Lights without a surface: point, spot, distant, and constant light from everywhere."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import LUMINANCE
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.exchange.pbrt.camera import Frame
from rptcam_cl.exchange.pbrt.files import (
    OTHERS,
    Context,
    heights,
    in_longitude_and_latitude,
    is_readable,
    linear_pixels,
    picture_name,
    write_exr,
)
from rptcam_cl.exchange.pbrt.source import Place
from rptcam_cl.exchange.pbrt.textures import GREY, light, scale_factor
from rptcam_cl.exchange.pbrt.world import ODD, Entity, Matrix, apply, is_bearable, is_similarity, reflects, tidy
from rptcam_cl.scene.assets.pictures import SUFFIXES

Array = NDArray[np.float64]
Keys = dict[str, Any]

# Parameters that say how many samples a light gets.
SAMPLING = ("nsamples", "samples")


@dataclass
class Lights:
    """The lights of a scene of ours."""

    items: list[Keys] = field(default_factory=list)
    sky: Array = field(default_factory=lambda: np.zeros(3))
    maps: list[Entity] = field(default_factory=list)


def convert_lights(context: Context, frame: Frame) -> Lights:
    """Return all the lights; maps of the sky stay as they are."""
    found = Lights()
    kinds: dict[str, Callable[[Context, Entity, Frame], Keys]] = {
        "point": _point, "goniometric": _point, "projection": _point, "spot": _spot, "distant": _distant,
    }  # fmt: skip
    for entity in context.scene.lights:
        entity.parameters.skip(*SAMPLING)
        if (entity.kind in kinds or _is_map(entity)) and not is_bearable(_world(entity, frame)):
            entity.parameters.used.update(entity.parameters.items)
            context.report.ignored(entity.place, f"{entity.what}: {ODD}")
        elif entity.kind in ("infinite", "exinfinite"):
            _infinite(context, entity, found)
        elif entity.kind in kinds:
            found.items.append(kinds[entity.kind](context, entity, frame))
        else:
            allowed = ", ".join((*kinds, "infinite"))
            raise entity.place.error(f'unknown light "{entity.kind}" (allowed: {allowed})')
    return found


def _is_map(entity: Entity) -> bool:
    return entity.parameters.has("mapname") or entity.parameters.has("filename")


def _world(entity: Entity, frame: Frame) -> Matrix:
    return np.asarray(frame.world @ entity.world_from_object)


def _power(entity: Entity, solid_angle: float) -> float:
    """Return the factor that ``power`` of pbrt-v4 stands for: power over the solid angle that gets it."""
    power = entity.parameters.number("power", -1.0)
    return power / solid_angle if power > 0 else 1.0


def _intensity(context: Context, entity: Entity, frame: Frame, solid_angle: float) -> list[float]:
    """Return the radiant intensity; pbrt divides it by distances in its units, we by metres."""
    colour = light(context, entity, "I") * scale_factor(context, entity) * _power(entity, solid_angle)
    return (colour * frame.metres_per_unit**2).tolist()  # type: ignore[no-any-return]


def _point(context: Context, entity: Entity, frame: Frame) -> Keys:
    if entity.kind != "point":
        entity.parameters.skip("filename", "mapname", "fov")
        context.report.approximated(entity.place, f"{entity.what}: a point light without its picture")
    position = apply(_world(entity, frame), entity.parameters.vector("from", (0, 0, 0))[None])[0]
    intensity = _intensity(context, entity, frame, 4 * math.pi)
    return {"kind": "point", "position": tidy(position), "intensity": intensity}


def _spot(context: Context, entity: Entity, frame: Frame) -> Keys:
    """Return a spot light; its edge is the smooth step of pbrt-v4, where pbrt-v3 has a fourth power."""
    parameters = entity.parameters
    outer, delta = parameters.number("coneangle", 30.0), parameters.number("conedeltaangle", 5.0)
    if not 0 < outer <= 180 or delta < 0:
        raise entity.place.error(f"{entity.what}: coneangle must lie between 0 and 180, conedeltaangle not below 0")
    if context.scene.version == 3:
        context.report.approximated(entity.place, f"{entity.what}: the edge of its cone as a smooth step")
    inner = min(max(outer - delta, 0.0), outer * (1 - 1e-6))  # ours needs an edge
    start, stop = math.cos(math.radians(inner)), math.cos(math.radians(outer))
    world = _world(entity, frame)
    origin = parameters.vector("from", (0, 0, 0))
    direction = world[:3, :3] @ (parameters.vector("to", (0, 0, 1)) - origin)
    if not np.linalg.norm(direction) > 0:
        raise entity.place.error(f'{entity.what}: "from" and "to" are the same point')
    return {
        "kind": "spot",
        "position": tidy(apply(world, origin[None])[0]),
        "direction": tidy(direction),
        "intensity": _intensity(context, entity, frame, 2 * math.pi * ((1 - start) + (start - stop) / 2)),
        "outer_degrees": outer,
        "inner_degrees": inner,
    }


def _distant(context: Context, entity: Entity, frame: Frame) -> Keys:
    parameters = entity.parameters
    way = parameters.vector("to", (0, 0, 1)) - parameters.vector("from", (0, 0, 0))
    direction = _world(entity, frame)[:3, :3] @ way
    if not np.linalg.norm(direction) > 0:
        raise entity.place.error(f'{entity.what}: "from" and "to" are the same point')
    colour = light(context, entity, "L") * scale_factor(context, entity)
    illuminance = parameters.number("illuminance", -1.0)
    if illuminance > 0:
        colour = colour * illuminance
    return {"kind": "directional", "direction": tidy(direction), "irradiance": colour.tolist()}


def _infinite(context: Context, entity: Entity, found: Lights) -> None:
    parameters = entity.parameters
    if parameters.has("portal"):
        parameters.skip("portal")
        context.report.ignored(entity.place, f"{entity.what}: its portal; the light comes from everywhere")
    if _is_map(entity):
        found.maps.append(entity)
        return
    colour = light(context, entity, "L") * scale_factor(context, entity)
    illuminance = parameters.number("illuminance", -1.0)
    if illuminance > 0:
        colour = colour * illuminance / math.pi
    found.sky = found.sky + colour


def lamp_radiance(context: Context, lamp: Entity, area: float) -> tuple[Array, bool]:
    """Return the radiance of a shape that shines, and whether its back does too.

    Parameters
    ----------
    area
        Of the part that pbrt takes for a lamp [square units]; 0 if unknown.
    """
    parameters = lamp.parameters
    parameters.skip(*SAMPLING)
    if lamp.kind not in ("diffuse", "area"):
        raise lamp.place.error(f'unknown area light "{lamp.kind}" (allowed: diffuse)')
    two_sided = parameters.boolean("twosided", False)
    colour = light(context, lamp, "L") * scale_factor(context, lamp)
    power = parameters.number("power", -1.0)
    if power > 0 and area > 0:
        colour = colour * power / (math.pi * area * (2 if two_sided else 1))
    elif power > 0:
        context.report.ignored(lamp.place, f'{lamp.what}: "power" of a shape whose area is in another file')
    if parameters.has("filename"):
        parameters.skip("filename")
        context.report.ignored(lamp.place, f"{lamp.what}: the picture that it shines with")
    return colour, two_sided


# The sky: constant light, and pictures of the surroundings.

Pixels = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class _Placement:
    """How a picture in longitude and latitude lies round our world.

    Attributes
    ----------
    up : (3,) array
        Direction of its top row.
    rotation_degrees : float
    mirrored : bool
        Whether pbrt's picture must be mirrored: its columns run against the turn of our longitude.
    """

    up: Array
    rotation_degrees: float
    mirrored: bool


def convert_sky(context: Context, frame: Frame, lights: Lights) -> Keys | None:
    """Return the environment of a scene of ours, None for a black one."""
    constant: Keys | None = {"kind": "constant", "radiance": lights.sky.tolist()} if lights.sky.any() else None
    used = None
    for entity in lights.maps:
        if used is None:
            used = _of_map(context, entity, frame, lights.sky)
        else:
            entity.parameters.used.update(entity.parameters.items)
            context.report.ignored(entity.place, f"{entity.what}: a second picture of the sky")
    return used or constant


def _of_map(context: Context, entity: Entity, frame: Frame, sky: Array) -> Keys | None:
    """Return the environment that a picture makes; None, with a report, when it cannot be read."""
    parameters = entity.parameters
    key = "filename" if parameters.has("filename") else "mapname"
    name, place = parameters.text(key, ""), parameters.items[key].place
    path = context.find_or_note(name, place, f"a sky of grey {GREY:g}")
    if path is None:
        parameters.used.update(parameters.items)
        return {"kind": "constant", "radiance": np.full(3, GREY).tolist()}
    factor = scale_factor(context, entity) * (light(context, entity, "L") if key == "mapname" else 1.0)
    if (illuminance := parameters.number("illuminance", -1.0)) > 0:
        context.report.noted(
            parameters.items["illuminance"].place,
            f"{entity.what}: a picture with an illuminance is twice as bright as that says, as pbrt has it",
        )
    if not is_readable(path):
        allowed = " ".join((*SUFFIXES, *OTHERS))
        context.report.ignored(place, f"{name}: a kind of picture that is not read (allowed: {allowed})")
        return None
    placement = _placement(context, entity, frame)
    keys: Keys = {"kind": "image", "file": "", "up": tidy(placement.up)}
    if placement.rotation_degrees:
        keys["rotation_degrees"] = placement.rotation_degrees
    if key == "mapname" and not placement.mirrored and np.ptp(factor) == 0 and not sky.any():
        keys["file"] = picture_name(context, path, place)
        return keys | ({"gain": float(factor[0])} if factor[0] != 1 else {})
    pixels = linear_pixels(path, place)
    if key == "filename":
        factor = factor * _photometric(pixels, illuminance, place)
        pixels = in_longitude_and_latitude(pixels, clockwise=placement.mirrored)
        how = "from the equal-area square to longitude and latitude"
    else:
        pixels = pixels[:, ::-1] if placement.mirrored else pixels
        how = "mirrored" if placement.mirrored else "with its factor"
    pixels = (pixels * factor + sky).astype(np.float32)
    keys["file"] = context.files.add("files", f"{path.stem}-sky.exr", partial(write_exr, pixels))
    context.report.noted(place, f"{name}: written anew {how}, to {keys['file']}")
    return keys


def _placement(context: Context, entity: Entity, frame: Frame) -> _Placement:
    """Return how the picture lies: pbrt's column at a quarter looks along +y of the light, the middle one along -x."""
    matrix = frame.world @ entity.world_from_object
    if not is_similarity(matrix):
        context.report.approximated(entity.place, f"{entity.what}: without the uneven scaling of its transform")
    x, _, up = (axis / np.linalg.norm(axis) for axis in matrix[:3, :3].T)
    forward = -(x - up * (x @ up))
    right_at_0, forward_at_0 = _axes(up)
    turn = math.degrees(math.atan2(-(forward @ right_at_0), forward @ forward_at_0))
    return _Placement(up, round(turn, 10) + 0.0, mirrored=not reflects(matrix))


def _axes(up: Array) -> tuple[Array, Array]:
    """Return right and forward of an unturned environment: where the short turn from +y to ``up`` takes +x and -z."""
    if up[1] < -1 + 1e-12:
        turn = np.diag([1.0, -1.0, -1.0])
    else:
        cross = np.array([[0.0, up[0], 0.0], [-up[0], 0.0, -up[2]], [0.0, up[2], 0.0]])
        turn = np.eye(3) + cross + cross @ cross / (1 + up[1])
    return turn[:, 0], -turn[:, 2]


def _photometric(pixels: Pixels, illuminance: float, place: Place) -> float:
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
    found = float((pixels @ LUMINANCE * np.clip(heights(size), 0, None)).sum()) * 2 * math.pi / size**2
    if not found > 0:
        raise place.error("the picture is black above the horizon, so that it cannot give an illuminance")
    return illuminance / found
