"""What light sampling can choose: emissive rectangles, disks and spheres, lights, and a picture of the environment.

Emissive boxes, cylinders, cones, ellipsoids and planes shine as well, but only BSDF sampling finds them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.alias import alias_table
from rptcam_cl.kinds import EmitterKind, EnvironmentKind
from rptcam_cl.plan.colour import luminance
from rptcam_cl.plan.environment import Surroundings
from rptcam_cl.plan.lights import light_emitter
from rptcam_cl.plan.meshes import corners_of_box
from rptcam_cl.plan.primitives import Primitive, sphere_of
from rptcam_cl.plan.textures import TextureTable
from rptcam_cl.plan.triangle_emitters import triangle_emitters
from rptcam_cl.records import EMITTER, Kind
from rptcam_cl.scene.material import Emissive, Material
from rptcam_cl.scene.principled import Principled
from rptcam_cl.scene.quantities import Colour
from rptcam_cl.scene.scene import Scene

Found = tuple[NDArray[np.void], NDArray[np.float64]]


@dataclass(frozen=True)
class Emitters:
    """Records with their alias table, the sampled emitter of each primitive, and the kinds there are."""

    records: NDArray[np.void]
    of_primitive: dict[int, int]
    kinds: frozenset[EmitterKind]
    count: int

    @property
    def facts(self) -> dict[str, int]:
        """Which kinds of emitter the kernels must know."""
        flats = {EmitterKind.RECTANGLE, EmitterKind.DISK, EmitterKind.TRIANGLE}
        return {
            "HAS_EMITTERS": int(self.count > 0),
            "ONE_EMITTER": int(self.count == 1),
            "EMITTER_FLATS": int(bool(self.kinds & flats)),
            "EMITTER_TRIANGLES": int(EmitterKind.TRIANGLE in self.kinds),
            "EMITTER_DISKS": int(EmitterKind.DISK in self.kinds),
            "EMITTER_SPHERES": int(EmitterKind.SPHERE in self.kinds),
            "EMITTER_POINTS": int(EmitterKind.POINT in self.kinds),
            "EMITTER_SPOTS": int(EmitterKind.SPOT in self.kinds),
            "EMITTER_PROFILES": int(EmitterKind.PROFILE in self.kinds),
            "EMITTER_DIRECTIONS": int(EmitterKind.DIRECTIONAL in self.kinds),
            "EMITTER_SUNS": int(EmitterKind.SUN in self.kinds),
            "ENVIRONMENT_SAMPLED": int(EmitterKind.ENVIRONMENT in self.kinds),
        }


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
    radiance, two_sided = _emitted(primitive.material)
    if primitive.kind not in _SAMPLED or luminance(radiance) <= 0:
        return None
    record: np.void = EMITTER.zeros(1)[0]
    kind = _SAMPLED[primitive.kind]
    factor = _sphere(primitive, record) if kind is EmitterKind.SPHERE else _flat(kind, primitive, record)
    record["radiance"][:3] = radiance
    record["primitive"], record["part"] = index, -1
    record["two_sided"] = two_sided
    return record, factor * luminance(radiance) * (2 if two_sided else 1)


def _emitted(material: Material) -> tuple[Colour, bool]:
    """Return the radiance of a material that shines evenly, else black, and whether its back shines, too."""
    if isinstance(material, Emissive):
        return material.radiance, material.two_sided
    if isinstance(material, Principled) and isinstance(material.emission, tuple):
        return material.emission, False
    return (0.0, 0.0, 0.0), False


def _mesh_emitters(index: int, primitive: Primitive, first_triangle: int, eye: NDArray[np.float64]) -> Found | None:
    """Return records and powers [W, luminance] of the triangles of an emissive mesh, or None when it does not shine."""
    mesh = primitive.mesh
    radiance, two_sided = _emitted(primitive.material)
    if mesh is None or luminance(radiance) <= 0:
        return None
    records, areas = triangle_emitters(mesh, primitive.placement, eye)
    records["radiance"][:, :3] = radiance
    records["primitive"] = index
    records["part"] = first_triangle + np.arange(len(records))
    records["two_sided"] = two_sided
    return records, np.pi * areas * luminance(radiance) * (2 if two_sided else 1)


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


def pack_emitters(
    scene: Scene,
    primitives: list[Primitive],
    first_triangles: Sequence[int],
    textures: TextureTable,
    surroundings: Surroundings,
) -> Emitters:
    """Return the emitters that light sampling chooses from, picked in proportion to their power; suns come last.

    Writes into the record of the surroundings which emitters are suns and how often the environment is picked.

    Parameters
    ----------
    scene
        The scene.
    primitives
        Its primitives, sorted by kind.
    first_triangles
        Of those that are meshes, in their order.
    textures
        Takes the pictures of measured luminaires.
    surroundings
        The environment.
    """
    eye = scene.metres_per_unit * np.array(scene.camera.eye)
    chosen, of_primitive = _surface_emitters(primitives, first_triangles, eye)
    reach = _scene_reach(primitives, eye)
    lights = [light_emitter(light, scene, textures, reach) for light in scene.lights]
    if surroundings.kind is EnvironmentKind.IMAGE:
        lights.append(_environment(surroundings.flux * np.pi * reach**2))
    lights = sorted((found for found in lights if found[1] > 0), key=lambda found: found[0]["kind"] == EmitterKind.SUN)
    chosen += [(np.array([record], EMITTER.dtype), np.array([power])) for record, power in lights]
    suns = sum(int(record["kind"]) == EmitterKind.SUN for record, _ in lights)
    count = sum(len(records) for records, _ in chosen)
    surroundings.record["first_sun"], surroundings.record["suns"] = count - suns, suns
    records = EMITTER.zeros(count)
    if chosen:
        records[:] = np.concatenate([part for part, _ in chosen])
        powers = np.concatenate([power for _, power in chosen])
        records["pick"] = powers / powers.sum()
        records["alias_keep"], records["alias_other"] = alias_table(powers)
        surroundings.record["pick"] = records["pick"][records["kind"] == EmitterKind.ENVIRONMENT].sum()
    kinds = frozenset(EmitterKind(kind) for kind in np.unique(records["kind"][:count]).tolist())
    return Emitters(records, of_primitive, kinds, count)


def _surface_emitters(
    primitives: list[Primitive], first_triangles: Sequence[int], eye: NDArray[np.float64]
) -> tuple[list[Found], dict[int, int]]:
    """Return records and powers of what shines, primitive by primitive, and the first emitter of each of them."""
    chosen: list[Found] = []
    of_primitive: dict[int, int] = {}
    count = 0
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
            chosen.append(found)
    return chosen, of_primitive


def _environment(power: float) -> tuple[np.void, float]:
    record: np.void = EMITTER.zeros(1)[0]
    record["kind"], record["primitive"], record["part"] = EmitterKind.ENVIRONMENT, -1, -1
    return record, power
