"""A scene in Mitsuba's words, as plain data: both renderers read the same scene file.

Covers what the reference scenes use, in the form that was fastest in Mitsuba: the flat shapes of one plain material as
one mesh (measured on the Cornell box: 1.1 times the speed of single rectangles), but a lamp as a rectangle (1.2 times).
Meshes of files are written anew as flat triangles in the world.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.mitsuba_lens import prescription
from rptcam_cl.rendering.plan.environment import axes
from rptcam_cl.rendering.plan.primitives import mesh_parts
from rptcam_cl.scene.assets.pictures import read_picture, write_exr
from rptcam_cl.scene.scene import Scene
from tests.support.mesh_scene import write_ply

NO_ROULETTE = 1 << 20  # an edge that no path reaches
Quad = NDArray[np.float64]  # four corners in order, shape (4, 3)


def describe(scene: Scene, *, roulette: bool, folder: Path, others: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return a dictionary for Mitsuba's ``load_dict`` in which transforms stand as ``{"matrix": rows}``.

    Parameters
    ----------
    roulette
        Whether Russian roulette ends paths as it does by Mitsuba's default, or never.
    folder
        Where meshes are written.
    others
        Descriptions that stand for the environment and for the meshes of the scene.
    """
    inside = [getattr(item.material, "interior", None) for item in scene.objects if others is None]
    has_media = scene.medium is not None or any(medium is not None for medium in inside)
    integrator = {"type": "volpath" if has_media else "path", "max_depth": scene.render.max_depth}
    description: dict[str, Any] = {
        "type": "scene",
        "integrator": integrator if roulette else integrator | {"rr_depth": NO_ROULETTE},
        "sensor": _sensor(scene),
    }
    if others is not None:
        shapes = scene.model_copy(update={"objects": tuple(item for item in scene.objects if item.shape != "mesh")})
        return description | others | _objects(shapes, folder)
    if scene.environment is not None:
        description["environment"] = _environment(scene, folder)
    for number, light in enumerate(scene.lights):
        if light.kind == "spot":
            description[f"light_{number}"] = _spot(light)
            continue
        assert light.kind == "directional"
        place = {"direction": list(light.direction), "irradiance": _rgb(light.irradiance)}
        description[f"light_{number}"] = {"type": "directional"} | place
    if scene.medium is not None:
        description["sensor"] |= {"medium": _medium(scene.medium)}
    return description | _objects(scene, folder)


def _medium(medium: Any) -> dict[str, Any]:
    """Return an even medium."""
    extinction = np.add(medium.scattering, medium.absorption)
    most = float(extinction.max())  # their colours end at 1
    return {
        "type": "homogeneous", "sigma_t": _rgb((extinction / most).tolist()), "scale": most,
        "albedo": _rgb((np.array(medium.scattering) / extinction).tolist()),
        "phase": {"type": "hg", "g": medium.mean_cosine},
    }  # fmt: skip


def _spot(light: Any) -> dict[str, Any]:
    """Return a spot with a sharp edge."""
    assert light.outer_degrees - light.inner_degrees < 0.01
    z = np.array(light.direction, float) / np.linalg.norm(light.direction)
    x = np.cross([0.0, 1.0, 0.0], z) / np.linalg.norm(np.cross([0.0, 1.0, 0.0], z))
    angles = {"cutoff_angle": light.outer_degrees, "beam_width": light.inner_degrees}
    place = {"to_world": _matrix(x, np.cross(z, x), z, np.array(light.position))}
    return {"type": "spot", "intensity": _rgb(light.intensity)} | angles | place


def _environment(scene: Scene, folder: Path) -> dict[str, Any]:
    environment = scene.environment
    if environment.kind == "constant":
        return {"type": "constant", "radiance": _rgb(environment.radiance)}
    assert environment.kind == "image"
    # The middle of Mitsuba's picture lies along +z of its own frame, and longitude grows towards -x.
    right, up, forward = axes(environment.up, environment.rotation_degrees)
    place = _matrix(-right, up, forward, np.zeros(3))
    path = folder / "environment.exr"
    rows = _rows_from_poles(read_picture(scene.content_of(environment)).texels[..., :3])
    write_exr({name: rows[..., k] for k, name in enumerate("RGB")}, path)
    return {"type": "envmap", "filename": str(path), "scale": environment.gain, "to_world": place}


def _rows_from_poles(texels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the same picture with rows in both poles, as Mitsuba has them, where ours end half a row before.

    Between the middles of rows both are linear: with rows in all middles and half-way between them they are the same.
    """
    ends = np.concatenate([texels[:1], texels, texels[-1:]])
    rows = np.empty((2 * len(texels) + 1, *texels.shape[1:]), np.float32)
    rows[1::2], rows[::2] = texels, (ends[:-1] + ends[1:]) / 2
    return rows


def _rgb(color: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": list(color)}


def _matrix(*columns: Any) -> dict[str, Any]:
    """Return the affine transform with the given images of x, y, z and of the origin."""
    rows = np.eye(4)
    rows[:3] = np.stack(columns, axis=1)
    return {"matrix": rows.tolist()}


def _sensor(scene: Scene) -> dict[str, Any]:
    camera = scene.camera
    world = camera.world_from_camera()[:3]
    lens: dict[str, Any] = {}
    if camera.kind == "realistic":
        lens = {"type": "spheres_lens", "prescription": json.dumps(prescription(scene))}
    else:
        assert camera.kind in ("pinhole", "thin_lens") and camera.fov_axis == "horizontal"
        lens = {"type": "perspective", "fov": camera.fov_degrees, "fov_axis": "x"}
    if camera.kind == "thin_lens":
        lens |= {"type": "thinlens", "aperture_radius": camera.aperture_radius_m}
        lens |= {"focus_distance": camera.focus_distance_m}
    width, height = scene.film.resolution
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}
    return {
        # Mitsuba's cameras look along +z of their own frame and have +x on the left.
        "to_world": _matrix(-world[:, 0], world[:, 1], -world[:, 2], camera.eye),
        "film": film | {"pixel_format": "rgb", "component_format": "float32"},
        "sampler": {"type": "independent"},
    } | lens


def _objects(scene: Scene, folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = {}
    meshes: dict[Any, list[Quad]] = {}
    for number, item in enumerate(scene.objects):
        look = _look(item.material)
        if getattr(item.material, "interior", None) is not None:
            look |= {"interior": _medium(item.material.interior)}
            look |= {"exterior": _medium(scene.medium)} if scene.medium is not None else {}
        plain = isinstance(getattr(item.material, "reflectance", None), tuple)
        if item.shape == "sphere":
            found[f"object_{number}"] = look | {"type": "sphere", "center": list(item.center), "radius": item.radius}
        elif item.shape == "mesh":
            found |= _mesh(scene, item, f"object_{number}", folder)
        elif item.shape == "rectangle" and not plain:
            u, v = np.array(item.edge_u), np.array(item.edge_v)
            centre = np.array(item.corner) + u / 2 + v / 2
            found[f"object_{number}"] = look | {
                "type": "rectangle",
                "to_world": _matrix(u / 2, v / 2, np.cross(u, v) / np.linalg.norm(np.cross(u, v)), centre),
            }
        else:
            meshes.setdefault(item.material, []).extend(quads_of(item))
    for number, (material, quads) in enumerate(meshes.items()):
        path = folder / f"mesh_{number}.ply"
        _write_ply(path, quads)
        found[f"mesh_{number}"] = _look(material) | {"type": "ply", "filename": str(path), "face_normals": True}
    return found


def _mesh(scene: Scene, item: Any, name: str, folder: Path) -> dict[str, Any]:
    """Return the parts of a mesh object, which must be flat."""
    found = {}
    for number, part in enumerate(mesh_parts(scene, item)):
        assert part.mesh.normals is None
        points = part.mesh.positions + part.mesh.origin
        path = folder / f"{name}_{number}.ply"
        write_ply(path, points @ part.placement[:3, :3].T + part.placement[:3, 3], part.mesh.faces)
        shape = {"type": "ply", "filename": str(path), "face_normals": True}
        found[f"{name}_{number}"] = _look(part.material) | shape
    return found


def _look(material: Any) -> dict[str, Any]:
    """Return BSDF and emitter of a material."""
    if material.kind == "emissive":
        black = {"type": "diffuse", "reflectance": _rgb((0.0, 0.0, 0.0))}
        return {"bsdf": black, "emitter": {"type": "area", "radiance": _rgb(material.radiance)}}
    if material.kind == "matte":
        return {"bsdf": {"type": "diffuse", "reflectance": _reflectance(material.reflectance)}}
    if material.kind == "mirror":
        return {"bsdf": {"type": "conductor", "material": "none", "specular_reflectance": _rgb(material.reflectance)}}
    if material.kind == "conductor":
        along, across = material.alphas
        metal = {"type": "roughconductor", "material": "none", "specular_reflectance": _rgb(material.reflectance)}
        return {"bsdf": metal | {"distribution": "ggx", "alpha_u": along, "alpha_v": across}}
    if material.kind == "plastic":
        base = {"diffuse_reflectance": _reflectance(material.reflectance), "nonlinear": True}
        cover = {"distribution": "ggx", "alpha": material.alphas[0], "int_ior": material.index}
        return {"bsdf": {"type": "roughplastic", **base, **cover}}
    assert material.kind == "dielectric"
    glass = {"int_ior": material.index, "ext_ior": 1.0}
    if material.alphas is not None:
        return {"bsdf": {"type": "roughdielectric", "distribution": "ggx", "alpha": material.alphas[0], **glass}}
    return {"bsdf": {"type": "dielectric", **glass}}


def _reflectance(reflectance: Any) -> dict[str, Any]:
    if isinstance(reflectance, tuple):
        return _rgb(reflectance)
    assert reflectance.kind == "checker" and reflectance.offset == (0, 0)
    scale_u, scale_v = reflectance.scale  # a period of Mitsuba's checkerboard has two cells
    to_uv = {"matrix": np.diag([scale_u / 2, scale_v / 2, 1.0, 1.0]).tolist()}
    colors = {"color0": _rgb(reflectance.even), "color1": _rgb(reflectance.odd)}
    return {"type": "checkerboard", "to_uv": to_uv} | colors


def quads_of(item: Any) -> list[Quad]:
    """Return the faces of a rectangle or box in the world, their normals outwards."""
    matrix = item.world_from_object
    if item.shape == "rectangle":
        corner, u, v = np.array(item.corner), np.array(item.edge_u), np.array(item.edge_v)
        faces = [np.array([corner, corner + u, corner + u + v, corner + v])]
    else:
        faces = _box_faces(np.array(item.min), np.array(item.max))
    return [face @ matrix[:3, :3].T + matrix[:3, 3] for face in faces]


def _box_faces(low: NDArray[np.float64], high: NDArray[np.float64]) -> list[Quad]:
    faces = []
    for axis, outwards in itertools.product(range(3), (False, True)):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        corners = np.tile(low, (4, 1))
        corners[:, axis] = high[axis] if outwards else low[axis]
        corners[[1, 2], u] = high[u]
        corners[[2, 3], v] = high[v]
        faces.append(corners if outwards else corners[::-1])
    return faces


def _write_ply(path: Path, quads: list[Quad]) -> None:
    corners = np.concatenate(quads)
    lines = ["ply", "format ascii 1.0", f"element vertex {len(corners)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"element face {2 * len(quads)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(f"{value:.9g}" for value in corner) for corner in corners]
    for first in range(0, len(corners), 4):
        lines += [f"3 {first} {first + 1} {first + 2}", f"3 {first} {first + 2} {first + 3}"]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
