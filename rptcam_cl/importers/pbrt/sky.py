"""The sky: constant light, and pictures of the surroundings."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.pictures import SUFFIXES
from rptcam_cl.colour import LUMINANCE
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.colours import light, scale_factor
from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.equal_area import heights, in_longitude_and_latitude
from rptcam_cl.importers.pbrt.frame import Frame
from rptcam_cl.importers.pbrt.lights import Keys, Lights
from rptcam_cl.importers.pbrt.pictures import OTHERS, is_readable, linear_pixels, picture_name, write_exr
from rptcam_cl.importers.pbrt.source import Place
from rptcam_cl.importers.pbrt.state import Entity
from rptcam_cl.importers.pbrt.textures import GREY
from rptcam_cl.importers.pbrt.transforms import is_similarity, reflects, tidy

Array = NDArray[np.float64]
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
