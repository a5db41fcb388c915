"""What light sampling can choose: emissive rectangles, disks and spheres, point and directional lights.

Emissive boxes, cylinders, cones, ellipsoids and planes shine as well, but only BSDF sampling finds them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.alias import alias_table
from rptcam_cl.plan.meshes import corners_of_box
from rptcam_cl.plan.primitives import Primitive, sphere_of, world_from_scene
from rptcam_cl.plan.triangle_emitters import triangle_emitters
from rptcam_cl.records import EMITTER, EmitterKind, Kind
from rptcam_cl.scene.light import DirectionalLight, PointLight
from rptcam_cl.scene.material import Emissive
from rptcam_cl.scene.scene import Scene

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709


@dataclass(frozen=True)
class Emitters:
    """Records with their alias table, the sampled emitter of each primitive, and the kinds there are."""

    records: NDArray[np.void]
    of_primitive: dict[int, int]
    kinds: frozenset[EmitterKind]
    count: int


def _luminance(color: object) -> float:
    return float(LUMINANCE @ np.asarray(color, dtype=np.float64))


def _flat(kind: EmitterKind, primitive: Primitive, record: np.void) -> float:
    x, y, _, origin = primitive.placement[:3].T
    area = float(np.linalg.norm(np.cross(x, y))) * (np.pi if kind is EmitterKind.DISK else 1.0)
    normal = np.linalg.inv(primitive.placement)[2, :3]
    record["kind"] = kind
    record["a"] = (*origin, area)
    record["u"][:3], record["v"][:3], record["normal"][:3] = x, y, normal / np.linalg.norm(normal)
    return np.pi * area


def _sphere(primitive: Primitive, record: np.void) -> float:
    center, radius = sphere_of(primitive.placement)
    record["kind"] = EmitterKind.SPHERE
    record["a"] = (*center, radius)
    return 4 * np.pi**2 * radius**2


_SAMPLED = {Kind.RECTANGLE: EmitterKind.RECTANGLE, Kind.DISK: EmitterKind.DISK, Kind.SPHERE: EmitterKind.SPHERE}


def _surface_emitter(index: int, primitive: Primitive) -> tuple[np.void, float] | None:
    """Return record and power [W, luminance] of an emissive primitive, or None when it is not sampled."""
    material = primitive.material
    if not isinstance(material, Emissive) or primitive.kind not in _SAMPLED or _luminance(material.radiance) <= 0:
        return None
    record = EMITTER.zeros(1)[0]
    kind = _SAMPLED[primitive.kind]
    factor = _sphere(primitive, record) if kind is EmitterKind.SPHERE else _flat(kind, primitive, record)
    record["radiance"][:3] = material.radiance
    record["primitive"], record["part"] = index, -1
    record["two_sided"] = material.two_sided
    return record, factor * _luminance(material.radiance) * (2 if material.two_sided else 1)


def _mesh_emitters(
    index: int, primitive: Primitive, first_triangle: int, eye: NDArray[np.float64]
) -> tuple[NDArray[np.void], NDArray[np.float64]] | None:
    """Return records and powers [W, luminance] of the triangles of an emissive mesh, or None when it does not shine."""
    material, mesh = primitive.material, primitive.mesh
    if mesh is None or not isinstance(material, Emissive) or _luminance(material.radiance) <= 0:
        return None
    records, areas = triangle_emitters(mesh, primitive.placement, eye)
    records["radiance"][:, :3] = material.radiance
    records["primitive"] = index
    records["part"] = first_triangle + np.arange(len(records))
    records["two_sided"] = material.two_sided
    return records, np.pi * areas * _luminance(material.radiance) * (2 if material.two_sided else 1)


def _light(light: PointLight | DirectionalLight, scene: Scene, reach: float) -> tuple[np.void, float]:
    """Return record and power of a light without a surface; ``reach`` is the radius of the scene [m]."""
    record = EMITTER.zeros(1)[0]
    record["primitive"], record["part"] = -1, -1
    if isinstance(light, PointLight):
        record["kind"] = EmitterKind.POINT
        record["a"][:3] = (world_from_scene(scene) @ (*light.position, 1.0))[:3]
        record["radiance"][:3] = light.intensity
        return record, 4 * np.pi * _luminance(light.intensity)
    record["kind"] = EmitterKind.DIRECTIONAL
    record["normal"][:3] = -np.asarray(light.direction) / np.linalg.norm(light.direction)
    record["radiance"][:3] = light.irradiance
    return record, np.pi * reach**2 * _luminance(light.irradiance)


def _scene_reach(primitives: list[Primitive], eye: NDArray[np.float64]) -> float:
    """Return a radius about the eye that holds all bounded primitives [m]."""
    reach = 0.0
    for primitive in primitives:
        if primitive.mesh is not None:
            corners = corners_of_box(*primitive.mesh.bounds(), primitive.placement)
            reach = max(reach, float(np.linalg.norm(corners - eye, axis=1).max()))
        elif primitive.kind is not Kind.PLANE:
            reach = max(reach, float(np.linalg.norm(primitive.placement[:3], ord=2)))
    return reach or 1.0


def pack_emitters(scene: Scene, primitives: list[Primitive], first_triangles: Sequence[int]) -> Emitters:
    """Return the emitters that light sampling chooses from, picked in proportion to their power.

    Parameters
    ----------
    scene
        The scene.
    primitives
        Its primitives, sorted by kind.
    first_triangles
        Of those that are meshes, in their order.
    """
    chosen: list[NDArray[np.void]] = []
    powers: list[NDArray[np.float64]] = []
    of_primitive: dict[int, int] = {}
    count = 0
    eye = scene.metres_per_unit * np.array(scene.camera.eye)
    first_mesh = len(primitives) - len(first_triangles)
    for index, primitive in enumerate(primitives):
        if primitive.mesh is None:
            single = _surface_emitter(index, primitive)
            found = None if single is None else (np.array([single[0]], EMITTER.dtype), np.array([single[1]]))
        else:
            found = _mesh_emitters(index, primitive, first_triangles[index - first_mesh], eye)
        if found is not None:
            of_primitive[index] = count
            count += len(found[0])
            chosen.append(found[0])
            powers.append(found[1])
    reach = _scene_reach(primitives, eye)
    for light in scene.lights:
        record, power = _light(light, scene, reach)
        if power > 0:
            chosen.append(np.array([record], EMITTER.dtype))
            powers.append(np.array([power]))
            count += 1
    records = EMITTER.zeros(count)
    if chosen:
        records[:] = np.concatenate(chosen)
        weights = np.concatenate(powers)
        records["pick"] = weights / weights.sum()
        records["alias_keep"], records["alias_other"] = alias_table(weights)
    kinds = frozenset(EmitterKind(kind) for kind in np.unique(records["kind"][:count]).tolist())
    return Emitters(records, of_primitive, kinds, count)
