"""Checks across the parts of a scene: errors where float32 is too small, and warnings of probable mistakes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes import LAMPS_LEFT_OUT
from rptcam_cl.optics import continued_words
from rptcam_cl.scene.base import listed, near_name, refuse
from rptcam_cl.scene.camera import Camera, LensCamera, ThinLensCamera
from rptcam_cl.scene.dielectric import Dielectric
from rptcam_cl.scene.exposure import Exposure, Shutter
from rptcam_cl.scene.film import Film
from rptcam_cl.scene.light import (
    ConstantEnvironment,
    DirectionalLight,
    Environment,
    GradientEnvironment,
    ImageEnvironment,
    Light,
    PointLight,
    ProfileLight,
    SkyEnvironment,
    SpotLight,
    SunLight,
)
from rptcam_cl.scene.material import Emissive, Principled
from rptcam_cl.scene.mesh import LoadedMesh
from rptcam_cl.scene.motion import moments
from rptcam_cl.scene.quantities import LARGEST_COORDINATE, SMALLEST_LENGTH, Colour
from rptcam_cl.scene.render_settings import SHARP_LAYERS, RenderSettings
from rptcam_cl.scene.scene_object import PlacedObject, Solid
from rptcam_cl.scene.sequence import FrameSequence
from rptcam_cl.scene.shape import Object, Plane

# Objects of the scene, each with what is known once its files are read.
Objects = Sequence[tuple[Object, Solid]]

# Ratio of extents beyond which the 24 bits of a float32 no longer resolve the smallest object.
LARGEST_EXTENT_RATIO = 1e7

# Largest deviation of a pixel from a square that is taken as rounding.
SQUARE_TOLERANCE = 0.01


def to_world(item: PlacedObject, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points of an object's own frame (n, 3) in the world."""
    return np.asarray(points @ item.world_from_object[:3, :3].T + item.world_from_object[:3, 3])


def world_corners(item: PlacedObject, solid: Solid) -> NDArray[np.float64]:
    """Return the eight corners of an object's bounds in the world (8, 3)."""
    return to_world(item, np.array(list(product(*zip(*solid.bounds(), strict=True)))))


def check_extent(item: Object, solid: Solid, path: tuple[str | int, ...]) -> None:
    """Refuse an object that its transform makes too far, too large or too small for float32."""
    if isinstance(item, Plane):
        corners = to_world(item, np.array([item.point]))
        extent = np.inf
    else:
        corners = world_corners(item, solid)
        extent = float(np.ptp(corners, axis=0).max())
    if (reach := float(np.abs(corners).max())) > 4 * LARGEST_COORDINATE:
        allowed = f"coordinates up to {LARGEST_COORDINATE:g}"
        raise refuse("reaches too far for float32", got=reach, allowed=allowed, path=path)
    if extent < SMALLEST_LENGTH / 4:
        allowed = f"an extent of at least {SMALLEST_LENGTH:g}"
        raise refuse("is too small for float32", got=extent, allowed=allowed, path=path)


def check_focus(camera: Camera, shutter: Shutter) -> None:
    """Refuse a point in focus that a moving camera has behind it when the shutter opens."""
    if not isinstance(camera, LensCamera) or camera.focus.point is None or not camera.motion:
        return
    eye, target, _ = camera.pose_at(shutter.open_s)
    if not np.dot(camera.focus.point - eye, target - eye) > 0:
        raise refuse(
            "does not lie in front of the film when the shutter opens",
            got=list(camera.focus.point),
            allowed="a point on the side that the camera looks to at shutter.open_s",
            path=("camera", "focus", "point"),
        )


def check_followed(camera: Camera, objects: Sequence[Object]) -> None:
    """Refuse a focus that follows an object that is not there, or has no middle."""
    if not isinstance(camera, LensCamera | ThinLensCamera) or camera.focus is None or camera.focus.object is None:
        return
    followed, path = camera.focus.object, ("camera", "focus", "object")
    known = [item.name for item in objects if item.name and not isinstance(item, Plane)]
    if followed not in known:
        allowed = listed(known) or "a name, once an object has one"
        raise refuse(f"is no name of an object{near_name(followed, known)}", got=followed, allowed=allowed, path=path)


def check_sequence(sequence: FrameSequence | None, shutter: Shutter, exposure: Exposure, autofocus: bool) -> None:
    """Refuse what is to follow from frame to frame where nothing is found anew in each, and keys that move twice."""
    if sequence is None:
        return
    for name in sequence.keys.keys() & shutter.keys.keys():
        raise refuse(
            "moves by shutter.keys already",
            got=name,
            allowed="one of the two; those of the shutter move from frame to frame as well",
            path=("sequence", "keys", name),
        )
    if sequence.continuous_focus is not None and not autofocus:
        raise refuse(
            "says how autofocus follows, and the focus is given",
            allowed="camera.focus: {auto: …} beside it",
            path=("sequence", "continuous_focus"),
        )
    if sequence.exposure_time_constant_s is not None and exposure.mode != "auto":
        raise refuse(
            "says how auto exposure follows the light",
            got=exposure.mode,
            allowed="exposure: auto beside it",
            path=("sequence", "exposure_time_constant_s"),
        )


def check_keys_of_shutter(shutter: Shutter, camera: Camera, render: RenderSettings) -> None:
    """Refuse what cannot follow keys that move while the shutter is open."""
    if not shutter.keys:
        return
    faults = {
        ("camera", "diffraction"): camera.diffraction != "off",
        ("camera", "ghosts"): getattr(camera, "ghosts", "off") != "off",
        ("camera", "accuracy"): getattr(camera, "accuracy", None) is not None,
        ("camera", "precision"): getattr(camera, "precision", "single") != "single",
        ("render", "caustics"): render.caustics == "on",
        ("render", "layers"): bool({"position", *SHARP_LAYERS} & set(render.layers)),
    }
    for path, wrong in faults.items():
        if wrong:
            raise refuse(
                "does not go with keys that move while the shutter is open",
                allowed=f"{path[-1]} left out, or a scene without shutter.keys",
                path=path,
            )


def scene_warnings(
    camera: Camera,
    film: Film,
    shutter: Shutter,
    objects: Objects,
    lights: Sequence[Light],
    environment: Environment | None,
) -> tuple[str, ...]:
    """Return what is allowed but probably not meant, one sentence each."""
    found: list[str] = []
    if not _any_light(objects, lights, environment):
        found.append("nothing in the scene emits light: the image will be black")
    width, height = film.size_m()
    aspect = (width / film.resolution[0]) / (height / film.resolution[1])
    if abs(aspect - 1) > SQUARE_TOLERANCE:
        found.append(f"film.size_mm does not fit film.resolution: pixels are {aspect:.3g} times as wide as high")
    found += _extent_warnings(objects)
    found += _mesh_warnings(objects, lights)
    found += _inside_warnings(camera, shutter, objects)
    found += _motion_warnings(camera, shutter, objects)
    shown = (material for _, solid in objects for material in solid.shown_materials())
    glasses = [material.glass for material in shown if isinstance(material, Dielectric) and material.glass is not None]
    found += filter(None, dict.fromkeys(map(continued_words, glasses)))
    return tuple(found)


def _any_light(objects: Objects, lights: Sequence[Light], environment: Environment | None) -> bool:
    given = [*_light_colours(lights), *_environment_colours(environment)]
    return any(max(colour) > 0 for colour in given) or any(_shines(solid) for _, solid in objects)


def _shines(solid: Solid) -> bool:
    shown = solid.shown_materials()
    glowing = [material.radiance for material in shown if isinstance(material, Emissive)]
    glowing += [material.emission for material in shown if isinstance(material, Principled)]
    return any(max(colour) > 0 if isinstance(colour, tuple) else True for colour in glowing)


def _light_colours(lights: Sequence[Light]) -> list[Colour]:
    colours = []
    for light in lights:
        match light:
            case PointLight() | SpotLight():
                colours.append(light.intensity)
            case DirectionalLight() | SunLight():
                colours.append(light.irradiance)
            case ProfileLight():
                colours.append((light.gain, light.gain, light.gain))
    return colours


def _environment_colours(environment: Environment | None) -> list[Colour]:
    match environment:
        case ConstantEnvironment():
            return [environment.radiance]
        case GradientEnvironment():
            return [environment.bottom, environment.top]
        case ImageEnvironment() | SkyEnvironment():
            return [(environment.gain, environment.gain, environment.gain)]
    return []


def _extent_warnings(objects: Objects) -> list[str]:
    bounded = [(item, solid) for item, solid in objects if not isinstance(item, Plane)]
    if not bounded:
        return []
    corners = [world_corners(item, solid) for item, solid in bounded]
    sizes = [float(np.ptp(points, axis=0).max()) for points in corners]
    whole = float(np.ptp(np.concatenate(corners), axis=0).max())
    smallest = int(np.argmin(sizes))
    if whole <= LARGEST_EXTENT_RATIO * sizes[smallest]:
        return []
    return [
        f"{_label(bounded[smallest][0], sizes[smallest])} is more than {LARGEST_EXTENT_RATIO:g} times smaller than "
        "the scene: float32 cannot resolve it"
    ]


def _label(item: PlacedObject, size: float) -> str:
    return f"object '{item.name}'" if item.name else f"an object of size {size:.3g}"


def _mesh_warnings(objects: Objects, lights: Sequence[Light]) -> list[str]:
    """Return what was left out of the meshes, said once for each; a scene with lights is not missing theirs."""
    contents = [solid.contents for _, solid in objects if isinstance(solid, LoadedMesh)]
    notes = dict.fromkeys(note for each in contents for note in each.notes)
    return [note for note in notes if not (lights and note.endswith(LAMPS_LEFT_OUT))]


def _inside_warnings(camera: Camera, shutter: Shutter, objects: Objects) -> list[str]:
    eye = np.append(camera.pose_at(shutter.open_s)[0], 1.0)
    return [
        f"the camera stands inside objects[{index}]"
        for index, (item, solid) in enumerate(objects)
        if not isinstance(item, Plane) and solid.contains(np.linalg.solve(item.placed_at(shutter.open_s), eye)[:3])
    ]


def _motion_warnings(camera: Camera, shutter: Shutter, objects: Objects) -> list[str]:
    ghosts = getattr(camera, "ghosts", "off") != "off"
    found = [
        f"objects[{index}] shines and moves: light sampling leaves it out, so that what it lights is noisy"
        + (", and it makes no ghosts" if ghosts else "")
        for index, (item, solid) in enumerate(objects)
        if item.trajectory is not None and item.trajectory.moves(*shutter.span_s) and _shines(solid)
    ]
    first, *poses = (camera.pose_at(time_s) for time_s in moments(camera.motion, *shutter.span_s))
    if ghosts and any(not np.array_equal(pose, first) for pose in poses):
        found.append("camera.motion: ghosts stand where they are when the shutter opens, and what makes them moves on")
    return found
