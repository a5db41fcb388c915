"""A scene in the words of Blender's Cycles, as plain data and files: both renderers read the same scene file.

Covers what the reference scenes use. Cycles has triangles only: a sphere becomes 81,920 of them, smooth, at most
0.00007 of its radius inside it. Flat shapes of one material become one mesh, a lamp too: Blender's own lamps let the
light behind them through. The lens is the shader that ``rptcam camera --osl`` writes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.mitsuba_scene import quads_of
from rptcam_cl.exchange.camera_files import osl_text
from rptcam_cl.exchange.camera_models import view
from rptcam_cl.rendering.plan.environment import axes
from rptcam_cl.rendering.plan.primitives import mesh_parts
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.selfcheck_suite import icosphere

LEVELS = 6  # how often the icosahedron of a sphere is divided
NEVER = 1024  # bounces that no path has


def describe(scene: Scene, *, roulette: bool, folder: Path) -> dict[str, Any]:
    """Return what `benchmarks.cycles_worker` makes a scene of; meshes and the shader are files in the folder.

    Parameters
    ----------
    roulette
        Whether Russian roulette ends paths as it does by Cycles' default, or never.
    """
    assert not scene.lights and scene.medium is None
    meshes: list[dict[str, Any]] = []
    flat: dict[Any, list[NDArray[np.float64]]] = {}

    def add(points: NDArray[np.float64], faces: NDArray[np.int64], material: Any, smooth: bool = False) -> None:
        path = folder / f"cycles_{len(meshes)}.npz"
        np.savez(path, points=points.astype(np.float32), faces=faces.astype(np.int32))
        meshes.append({"file": str(path), "smooth": smooth, "look": _look(material)})

    for item in scene.objects:
        if item.shape == "sphere":
            points, faces = icosphere(LEVELS)
            add(np.array(item.center) + item.radius * points, faces, item.material, smooth=True)
        elif item.shape == "mesh":
            for part in mesh_parts(scene, item):
                assert part.mesh.normals is None
                points = part.mesh.positions + part.mesh.origin
                add(points @ part.placement[:3, :3].T + part.placement[:3, 3], part.mesh.faces, part.material)
        else:
            flat.setdefault(item.material, []).extend(quads_of(item))
    for material, quads in flat.items():
        add(np.concatenate(quads), np.arange(4 * len(quads)).reshape(-1, 4), material)
    return {
        "size": scene.film.resolution,
        "camera": _camera(scene, folder),
        "meshes": meshes,
        "environment": _environment(scene),
        "bounces": scene.render.max_depth - 2,  # Cycles counts those before the last vertex that a lamp lights
        "unshortened": 0 if roulette else NEVER,
    }


def _environment(scene: Scene) -> dict[str, Any]:
    """Return the colour all round, or a picture with the directions right, up and forward of its middle."""
    environment = scene.environment
    if environment is None or environment.kind == "constant":
        return {"color": [0.0, 0.0, 0.0] if environment is None else list(environment.radiance)}
    assert environment.kind == "image"
    ways = axes(environment.up, environment.rotation_degrees).tolist()
    return {"file": str(scene.content_of(environment)), "gain": environment.gain, "axes": ways}


def _camera(scene: Scene, folder: Path) -> dict[str, Any]:
    camera = scene.camera
    found = {"world": camera.world_from_camera().tolist()}
    if camera.kind == "realistic":
        shader = folder / "cycles_lens.osl"
        shader.write_text(osl_text(view(scene)), encoding="utf-8")
        return found | {"shader": str(shader)}
    assert camera.kind == "pinhole"
    assert camera.fov_axis == "horizontal"
    return found | {"fov_degrees": camera.fov_degrees}


def _look(material: Any) -> dict[str, Any]:
    if material.kind == "emissive":
        return {"kind": "lamp", "color": list(material.radiance)}
    if material.kind == "dielectric":
        alpha = 0.0 if material.alphas is None else material.alphas[0]
        return {"kind": "glass", "index": material.index, "roughness": float(np.sqrt(alpha))}
    if material.kind == "conductor":
        along, across = material.alphas
        assert along == across
        return {"kind": "metal", "color": list(material.reflectance), "roughness": float(np.sqrt(along))}
    if material.kind == "mirror":
        return {"kind": "metal", "color": list(material.reflectance), "roughness": 0.0}
    assert material.kind == "matte"
    reflectance = material.reflectance
    if isinstance(reflectance, tuple):
        return {"kind": "matte", "color": list(reflectance)}
    assert reflectance.kind == "checker"
    assert reflectance.offset == (0, 0)
    return {"kind": "matte", "even": list(reflectance.even), "odd": list(reflectance.odd)}
