"""Scenes to focus on: flat targets square to the axis, and cameras that look along -z from the origin."""

from typing import Any

import rptcam_cl
from rptcam_cl.device.session import open_session
from rptcam_cl.studies.focus.probe import Zone
from rptcam_cl.studies.focus.renderer import ProbeRenderer

CENTRE = Zone(0.475, 0.525, 0.4625, 0.5375)


def noise(scale: float) -> dict[str, Any]:
    """Return a matte material of soft spots, so many along the side of its rectangle."""
    return {"kind": "matte", "reflectance": {"kind": "noise", "low": 0.05, "high": 0.95, "scale": [scale, scale]}}


def checker(cells: float) -> dict[str, Any]:
    """Return a matte chess board of so many cells along the side of its rectangle."""
    return {"kind": "matte", "reflectance": {"kind": "checker", "even": 0.9, "odd": 0.1, "scale": [cells, cells]}}


def target(distance: float, half: float, material: Any, x: float = 0.0) -> dict[str, Any]:
    """Return a square at a distance from the film, with its centre x beside the axis."""
    sides = {"edge_u": [2 * half, 0, 0], "edge_v": [0, 2 * half, 0]}
    return {"shape": "rectangle", "corner": [x - half, -half, -distance], **sides, "material": material}


def lens_camera(lens: Any, kind: str = "realistic", **options: Any) -> dict[str, Any]:
    """Return a camera with a lens, focused at 5 m unless told otherwise."""
    pose = {"eye": [0, 0, 0], "target": [0, 0, -1]}
    return {"kind": kind, "lens": lens, "focus": {"distance_m": 5}, **pose, **options}


# Behind the camera, so that one program does for targets of every texture.
SPECKS = [target(-50.0, 0.1, material) for material in (noise(1), checker(1))]


def scene_of(objects: list[Any], camera: dict[str, Any], base_dir: Any = None, **rest: Any) -> rptcam_cl.Scene:
    """Return a scene under an even sky, on a film of 36 x 24 mm."""
    film = {"resolution": [360, 240], "size_mm": [36, 24], **rest.pop("film", {})}
    light = {"environment": {"kind": "constant", "radiance": 1.0}}
    parts = {"film": film, "camera": camera, "render": {"max_depth": 2}, "objects": [*objects, *SPECKS]}
    return rptcam_cl.load_scene(parts | light | rest, base_dir=base_dir)


def probe_of(scene: rptcam_cl.Scene) -> ProbeRenderer:
    """Return the probe of a scene on the default device."""
    return ProbeRenderer(scene, open_session(None))
