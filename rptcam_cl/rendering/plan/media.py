"""Media as the kernels read them: their records, the medium inside of each solid, and those around the camera."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import MEDIUM, Hidden, fill
from rptcam_cl.rendering.plan.materials import Materials
from rptcam_cl.rendering.plan.primitives import Primitive
from rptcam_cl.rendering.plan.textures import KnownSpectra
from rptcam_cl.scene.materials import Boundary, Dielectric, Material, Mix, Principled, ScatteringMedium, has_holes
from rptcam_cl.scene.scene import Scene, Solid, holds_eye, world_corners
from rptcam_cl.scene.shapes import Plane

_MOST_MEDIA = 31  # whose numbers fit into MEDIUM_BITS of kernels/material/medium.h, 0 being empty space
MEDIUM_BITS = 5
_MOST_NESTED = 4
_NOT_SOLID = -1
EMPTY = ScatteringMedium()


@dataclass(frozen=True)
class Media:
    """The media of a scene.

    Attributes
    ----------
    records : array of Medium
        By number; the first is empty space.
    at_camera : int
        Those around the camera, as the stack of ``kernels/material/medium.h``.
    active : bool
        Whether there are any.
    """

    records: NDArray[np.void]
    at_camera: int = 1 << MEDIUM_BITS
    active: bool = False

    @property
    def has_glow(self) -> bool:
        """Whether any of them shines."""
        return bool(self.records["emission"][:, :3].any())

    @property
    def facts(self) -> dict[str, int]:
        """Whether the kernels must know of media, and of one in a layer."""
        return {"HAS_MEDIA": int(self.active), "HAS_LAYERED_FOG": int(self.records["layer"].any())}


def _interior_of(material: Material) -> ScatteringMedium | None:
    """Find the medium inside of a solid of a material, empty space perhaps; None where it is no solid's."""
    solid = isinstance(material, Dielectric | Boundary) or (
        isinstance(material, Principled) and material.transmission != 0
    )
    if not solid:
        return None
    assert isinstance(material, Dielectric | Boundary | Principled)
    if material.interior is not None:
        return material.interior
    return ScatteringMedium(absorption_per_m=material.absorption) if max(material.absorption) > 0 else EMPTY


def pack_media(
    scene: Scene, runs: Sequence[Primitive], shown: Materials, spectra: KnownSpectra
) -> tuple[Media, Materials]:
    """Return the media of a scene and its materials, which know the media inside of solids.

    Absorption in solids becomes a medium where there is any other.

    Raises
    ------
    InputError
        For what does not go with media.
    """
    materials = {id(run.material): run.material for run in runs}
    for material in [*materials.values()]:
        if isinstance(material, Mix):
            materials |= {id(part): part for part in material.materials}
    own = [getattr(material, "interior", None) for material in materials.values()]
    if scene.medium is None and not any(each is not None for each in own):
        return Media(MEDIUM.zeros(1)), shown
    _check(scene, runs, materials.values())
    numbers: dict[str, int] = {EMPTY.model_dump_json(exclude_none=True): 0}
    found = [EMPTY]

    def number_of(medium: ScatteringMedium) -> int:
        key = medium.model_dump_json(exclude_none=True)
        if key not in numbers:
            numbers[key] = len(found)
            found.append(medium)
        return numbers[key]

    around = number_of(scene.medium or EMPTY)
    inside = {
        key: _NOT_SOLID if (medium := _interior_of(material)) is None else number_of(medium)
        for key, material in materials.items()
    }
    inside |= {key: _of_mix(each, inside) for key, each in materials.items() if isinstance(each, Mix)}
    if len(found) > _MOST_MEDIA + 1:
        raise InputError(f"the scene has {len(found) - 1} different media (allowed: {_MOST_MEDIA})")
    records = shown.records.copy()
    records["interior"] = _NOT_SOLID
    for key, number in inside.items():
        records["interior"][shown.index[key]] = number
    shown = replace(shown, records=records, facts=shown.facts | {"HAS_ABSORPTION": 0})
    return Media(_records(found, spectra, scene), _at_camera(scene, around, inside), active=True), shown


def hidden_from(primitive: Primitive) -> int:
    """Return the rays that a primitive is hidden from, also as one that is nothing but the boundary of a medium."""
    is_boundary = isinstance(primitive.material, Boundary)
    return primitive.hidden | is_boundary * (Hidden.FROM_SHADOW | Hidden.FROM_ALL_BUT_WAYS)


def _records(media: Sequence[ScatteringMedium], spectra: KnownSpectra, scene: Scene) -> NDArray[np.void]:
    records = MEDIUM.zeros(len(media))
    for record, medium in zip(records, media, strict=True):
        absorption, scattering, emission = medium.absorption, medium.scattering, medium.emission_per_m
        fill(
            record, asymmetry=medium.mean_cosine, absorption=(*absorption, spectra.number(absorption)),
            scattering=(*scattering, spectra.number(scattering)),
            emission=(*emission, spectra.number(emission, light=True)),
        )  # fmt: skip
        if (layer := getattr(medium, "layer", None)) is not None:
            fill(record, layer=layer.scale_heights(scene.camera.eye, scene.metres_per_unit))
    return records


def _check(scene: Scene, runs: Sequence[Primitive], materials: Collection[Material]) -> None:
    """Refuse what does not go with media."""
    faults = {
        "film.transparent": (scene.film.transparent, "false"),
        "render.caustics": (scene.render.caustics == "on", "off or auto"),
        "camera.ghosts": (getattr(scene.camera, "ghosts", "off") != "off", "off"),
    }
    for key, (wrong, allowed) in faults.items():
        if wrong:
            raise InputError(f"{key}: does not go with media such as fog (allowed: {allowed})")
    medium = scene.medium
    if medium is not None and max(medium.emission_per_m) > 0:
        thinnest = min(a + s for a, s in zip(medium.absorption, medium.scattering, strict=True))
        if thinnest <= 0:
            raise InputError("medium.emission_per_m: shines without end where nothing absorbs or scatters"
                             " (allowed: coefficients above 0 in every channel)")  # fmt: skip
    if any(_interior_of(material) is not None and has_holes(material) for material in materials):
        raise InputError("opacity: solids with holes do not go with media such as fog (allowed: 1)")
    partly = Hidden.FROM_CAMERA | Hidden.FROM_REFLECTION
    bounded = any(isinstance(material, Boundary) for material in materials)
    for primitive in runs:
        if bounded and primitive.hidden & partly not in (0, partly):
            raise InputError(
                f"objects.{primitive.object}.visible: a boundary of a medium makes no difference between camera and"
                " reflection (allowed: both or neither)"
            )


def _of_mix(mix: Mix, inside: dict[int, int]) -> int:
    """Return the number of the medium inside of a solid of mixed materials."""
    numbers = {inside[id(part)] for part in mix.materials} - {_NOT_SOLID}
    if len(numbers) > 1:
        raise InputError("materials of a mix: two solids with different media inside (allowed: the same one)")
    return numbers.pop() if numbers else _NOT_SOLID


def _at_camera(scene: Scene, around: int, inside: dict[int, int]) -> int:
    """Return the stack of the media around the camera, those of the solids that it stands in on top."""
    shutter = scene.shutter
    stacks = {_stack_at(scene, time_s, around, inside) for time_s in shutter.span_s}
    if len(stacks) > 1:
        raise InputError("camera.motion: the camera moves from one medium into another (allowed: to stay in one)")
    return stacks.pop()


def _stack_at(scene: Scene, time_s: float, around: int, inside: dict[int, int]) -> int:
    eye = np.append(scene.camera.pose_at(time_s)[0], 1.0)
    held = []
    for item, solid in zip(scene.objects, scene.solids(), strict=True):
        number = _inside_of_solid(solid, inside)
        if number == _NOT_SOLID or isinstance(item, Plane):
            continue
        if any(holds_eye(solid, places, eye) for places in item.place_blocks(scene.folders, time_s)):
            held.append((float(np.ptp(world_corners(item, solid), axis=1).prod(axis=1).max()), number))
    if len(held) > _MOST_NESTED:
        raise InputError(f"camera.eye: lies in {len(held)} solids at once (allowed: {_MOST_NESTED} beside media)")
    stack = (1 << MEDIUM_BITS) | around
    for _, number in sorted(held, reverse=True):
        stack = (stack << MEDIUM_BITS) | number
    return stack


def _inside_of_solid(solid: Solid, inside: dict[int, int]) -> int:
    return max((inside.get(id(material), _NOT_SOLID) for material in solid.shown_materials()), default=_NOT_SOLID)
