"""Lights without a surface: point, spot, distant, and constant light from everywhere."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.colours import light, scale_factor
from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.frame import Frame
from rptcam_cl.importers.pbrt.state import Entity
from rptcam_cl.importers.pbrt.transforms import ODD, Matrix, apply, is_bearable, tidy

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
