"""A scene in the words of Blender's Cycles, as plain data and files: both renderers read the same scene file.

Covers what the reference scenes use. Cycles has triangles only: a sphere becomes 81,920 of them, smooth, at most
0.00007 of its radius inside it. Flat shapes of one material become one mesh. A sphere or rectangle that shines is a
lamp of Blender's round or before something black, as it lets the light behind it through; a mesh would shine to both
sides. The lens is the shader that ``rptcam camera --osl`` writes.
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
CORE_LEVELS, CORE = 3, 0.999  # of the black ball in a lamp; its radius in that of the lamp
BEHIND = 1e-4  # how far the black back of a flat lamp lies behind it [m]
BLACK = {"kind": "matte", "color": [0.0, 0.0, 0.0]}
NEVER = 1024  # bounces that no path has


def describe(scene: Scene, *, roulette: bool, folder: Path) -> dict[str, Any]:
    """Return what `benchmarks.cycles_worker` makes a scene of; meshes and the shader are files in the folder.

    Parameters
    ----------
    roulette
        Whether Russian roulette ends paths as it does by Cycles' default, or never.
    """
    assert scene.medium is None
    meshes: list[dict[str, Any]] = []
    lamps = [_sun(light) for light in scene.lights]
    flat: dict[Any, list[NDArray[np.float64]]] = {}

    def add(points: NDArray[np.float64], faces: NDArray[np.int64], look: dict[str, Any], smooth: bool = False) -> None:
        path = folder / f"cycles_{len(meshes)}.npz"
        np.savez(path, points=points.astype(np.float32), faces=faces.astype(np.int32))
        meshes.append({"file": str(path), "smooth": smooth, "look": look})

    for item in scene.objects:
        if item.shape == "sphere" and item.material.kind == "emissive":
            points, faces = icosphere(CORE_LEVELS)
            add(np.array(item.center) + CORE * item.radius * points, faces, BLACK)
            look = {"color": _radiance(scene, item), "radius": item.radius}
            lamps.append(look | {"world": _frame(np.eye(3), item.center)})
        elif item.shape == "sphere":
            points, faces = icosphere(LEVELS)
            add(np.array(item.center) + item.radius * points, faces, _look(item.material), smooth=True)
        elif item.shape == "mesh":
            for part in mesh_parts(scene, item):
                assert part.mesh.normals is None
                points = part.mesh.positions + part.mesh.origin
                add(points @ part.placement[:3, :3].T + part.placement[:3, 3], part.mesh.faces, _look(part.material))
        elif item.material.kind == "emissive":
            (quad,) = quads_of(item)
            lamps.append(_panel(quad, item.material.radiance))
            normal = np.cross(quad[1] - quad[0], quad[3] - quad[0])
            add(quad - BEHIND / np.linalg.norm(normal) * normal, np.arange(4).reshape(1, 4), BLACK)
        else:
            flat.setdefault(item.material, []).extend(quads_of(item))
    for material, quads in flat.items():
        add(np.concatenate(quads), np.arange(4 * len(quads)).reshape(-1, 4), _look(material))
    return {
        "size": scene.film.resolution,
        "camera": _camera(scene, folder),
        "meshes": meshes,
        "lamps": lamps,
        "environment": _environment(scene),
        "bounces": scene.render.max_depth - 2,  # Cycles counts those before the last vertex that a lamp lights
        "unshortened": 0 if roulette else NEVER,
    }


def _frame(axes_of: Any, origin: Any) -> list[list[float]]:
    """Return the transform with the given images of x, y and z as rows, and of the origin."""
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = np.transpose(axes_of), origin
    return place.tolist()


def _sun(light: Any) -> dict[str, Any]:
    """Return a lamp without size, which shines along -z of its frame."""
    assert light.kind == "directional"
    forward = np.array(light.direction) / np.linalg.norm(light.direction)
    right = np.cross(forward, np.eye(3)[np.abs(forward).argmin()])
    right /= np.linalg.norm(right)
    place = _frame([right, np.cross(right, forward), -forward], np.zeros(3))
    return {"color": list(light.irradiance), "world": place}


def _panel(quad: NDArray[np.float64], radiance: Any) -> dict[str, Any]:
    """Return a rectangle that shines along -z of its frame."""
    edges = np.stack([quad[3] - quad[0], quad[1] - quad[0]])  # against the normal is z
    assert abs(edges[0] @ edges[1]) < 1e-9
    sides = np.linalg.norm(edges, axis=1)
    right, up = edges / sides[:, None]
    place = _frame([right, up, np.cross(right, up)], quad.mean(axis=0))
    return {"color": list(radiance), "size": sides.tolist(), "world": place}


def _radiance(scene: Scene, lamp: Any) -> list[float]:
    """Return the radiance of a ball as it is outside all glass: Cycles leaves radiance as it is where rays refract."""
    found = np.array(lamp.material.radiance)
    for item in scene.objects:
        if item.shape == "sphere" and item.material.kind == "dielectric":
            is_inside = np.linalg.norm(np.subtract(item.center, lamp.center)) < item.radius
            found = found / item.material.index**2 if is_inside else found
    return found.tolist()


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
    assert camera.kind in ("pinhole", "thin_lens")
    assert camera.fov_axis == "horizontal"
    found |= {"fov_degrees": camera.fov_degrees}
    if camera.kind == "pinhole":
        return found
    return found | {"aperture_radius": camera.aperture_radius_m, "focus_distance": camera.focus_distance_m}


def _look(material: Any) -> dict[str, Any]:
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
