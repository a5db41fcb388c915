"""What light sampling can choose: emissive rectangles, disks and spheres, lights, and a picture of the environment.

Emissive boxes, cylinders, cones, ellipsoids and planes shine as well, but only BSDF sampling finds them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.alias import alias_table
from rptcam_cl.plan.colour import luminance
from rptcam_cl.plan.environment import Surroundings
from rptcam_cl.plan.lights import light_emitter
from rptcam_cl.plan.primitives import Primitive, sphere_of
from rptcam_cl.plan.textures import TextureTable
from rptcam_cl.records import EMITTER, EmitterKind, EnvironmentKind, Kind
from rptcam_cl.scene.material import Emissive
from rptcam_cl.scene.scene import Scene


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
        flats = {EmitterKind.RECTANGLE, EmitterKind.DISK}
        return {
            "HAS_EMITTERS": int(self.count > 0),
            "ONE_EMITTER": int(self.count == 1),
            "EMITTER_FLATS": int(bool(self.kinds & flats)),
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
    material = primitive.material
    if not isinstance(material, Emissive) or primitive.kind not in _SAMPLED or luminance(material.radiance) <= 0:
        return None
    record: np.void = EMITTER.zeros(1)[0]
    kind = _SAMPLED[primitive.kind]
    factor = _sphere(primitive, record) if kind is EmitterKind.SPHERE else _flat(kind, primitive, record)
    record["radiance"][:3] = material.radiance
    record["primitive"] = index
    record["two_sided"] = material.two_sided
    return record, factor * luminance(material.radiance) * (2 if material.two_sided else 1)


def _scene_reach(primitives: list[Primitive]) -> float:
    bounded = [primitive.placement for primitive in primitives if primitive.kind is not Kind.PLANE]
    return max((float(np.linalg.norm(matrix[:3], ord=2)) for matrix in bounded), default=1.0)


def pack_emitters(
    scene: Scene, primitives: list[Primitive], textures: TextureTable, surroundings: Surroundings
) -> Emitters:
    """Return the emitters that light sampling chooses from, picked in proportion to their power; suns come last.

    Writes into the record of the surroundings which emitters are suns and how often the environment is picked.
    """
    chosen: list[tuple[np.void, float]] = []
    of_primitive: dict[int, int] = {}
    for index, primitive in enumerate(primitives):
        if (found := _surface_emitter(index, primitive)) is not None:
            of_primitive[index] = len(chosen)
            chosen.append(found)
    reach = _scene_reach(primitives)
    lights = [light_emitter(light, scene, textures, reach) for light in scene.lights]
    if surroundings.kind is EnvironmentKind.IMAGE:
        lights.append(_environment(surroundings.flux * np.pi * reach**2))
    lights = [(record, power) for record, power in lights if power > 0]
    suns = [found for found in lights if found[0]["kind"] == EmitterKind.SUN]
    chosen += [found for found in lights if found[0]["kind"] != EmitterKind.SUN]
    surroundings.record["first_sun"], surroundings.record["suns"] = len(chosen), len(suns)
    chosen += suns
    records = EMITTER.zeros(len(chosen))
    if chosen:
        powers = np.array([power for _, power in chosen])
        records[:] = np.array([record for record, _ in chosen], EMITTER.dtype)
        records["pick"] = powers / powers.sum()
        records["alias_keep"], records["alias_other"] = alias_table(powers)
        surroundings.record["pick"] = records["pick"][records["kind"] == EmitterKind.ENVIRONMENT].sum()
    kinds = frozenset(EmitterKind(int(record["kind"])) for record, _ in chosen)
    return Emitters(records, of_primitive, kinds, len(chosen))


def _environment(power: float) -> tuple[np.void, float]:
    record: np.void = EMITTER.zeros(1)[0]
    record["kind"], record["primitive"] = EmitterKind.ENVIRONMENT, -1
    return record, power
