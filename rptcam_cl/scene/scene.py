"""The scene: everything that one scene file says."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import product
from operator import is_
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    Field,
    PrivateAttr,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
    model_validator,
)

from rptcam_cl.core import MAX_SPP
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import Folders, References, digest
from rptcam_cl.core.strict_yaml import MAX_BYTES
from rptcam_cl.optics.glass import continued_words
from rptcam_cl.optics.lens import Lens, at_position
from rptcam_cl.optics.library import digests_of_lens, load_lens, named_lens, names_a_file
from rptcam_cl.scene import lens_settings, media
from rptcam_cl.scene.assets.mesh import LAMPS_LEFT_OUT
from rptcam_cl.scene.base import FileReference, SceneModel, file_references, refuse, unknown_name
from rptcam_cl.scene.camera import FOLLOWS_THE_FILM, Camera
from rptcam_cl.scene.exposure import Exposure, ExposureOrMode, FrameSequence, Shutter, check_exposure
from rptcam_cl.scene.film import SHARP_LAYERS, Film, PictureSettings, RenderSettings, Sensor, SpectrumSettings
from rptcam_cl.scene.lights import WITH_UP, Environment, Light
from rptcam_cl.scene.materials import (
    Dielectric,
    Emissive,
    Hair,
    Material,
    Mix,
    Principled,
    ThinGlass,
    with_material,
    with_parts,
)  # fmt: skip
from rptcam_cl.scene.meshes import LoadedMesh, MeshLibrary, MeshObject, NamedMesh
from rptcam_cl.scene.placement import PlacedObject, SceneObject, moments
from rptcam_cl.scene.quantities import LARGEST_COORDINATE, NUMBER, SMALLEST_LENGTH
from rptcam_cl.scene.shapes import Board, Curves, Object, Plane

# Checks across the parts of a scene: errors where float32 is too small, and warnings of probable mistakes.

Solid = SceneObject | Board | LoadedMesh
"""The shape and materials of an object, once its files are read."""

Objects = Sequence[tuple[Object, Solid]]

# Ratio of extents beyond which the 24 bits of a float32 no longer resolve the smallest object.
_LARGEST_EXTENT_RATIO = 1e7

# Largest deviation of a pixel from a square that is taken as rounding.
_SQUARE_TOLERANCE = 0.01


def to_world(item: PlacedObject, points: NDArray[np.float64], folders: Folders | None = None) -> NDArray[np.float64]:
    """Return points of an object's own frame (n, 3) in the world (places, n, 3); without folders, where it is first."""
    places = item.world_from_object[None] if folders is None else item.places(folders, 0.0)
    return np.asarray(points @ np.swapaxes(places[:, :3, :3], 1, 2) + places[:, None, :3, 3])


def world_corners(item: PlacedObject, solid: Solid, folders: Folders | None = None) -> NDArray[np.float64]:
    """Return the eight corners of an object's bounds in the world (places, 8, 3), as `to_world` does."""
    return to_world(item, np.array(list(product(*zip(*solid.bounds(), strict=True)))), folders)


def check_extent(item: Object, solid: Solid, path: tuple[str | int, ...], folders: Folders | None = None) -> None:
    """Refuse an object that its transform, or a table of places, makes too far, too large or too small for float32."""
    if isinstance(item, Plane):
        reach, extent = float(np.abs(to_world(item, np.array([item.point]), folders)).max()), np.inf
    else:
        # of boxes, the bounds of their corners follow from the middle and the half sides, however many places there are
        blocks = [item.world_from_object[None]] if folders is None else item.place_blocks(folders, 0.0)
        low, high = np.array(solid.bounds(), np.float64)
        reach, extent = 0.0, np.inf
        for places in blocks:
            middle = places[:, :3, :3] @ (low / 2 + high / 2) + places[:, :3, 3]
            half = np.abs(places[:, :3, :3]) @ (high / 2 - low / 2)
            reach = max(reach, float((np.abs(middle) + half).max()))
            extent = min(extent, 2 * float(half.max(axis=1).min()))
    if reach > 4 * LARGEST_COORDINATE:
        allowed = f"coordinates up to {LARGEST_COORDINATE:g}"
        raise refuse("reaches too far for float32", got=reach, allowed=allowed, path=path)
    if extent < SMALLEST_LENGTH / 4:
        allowed = f"an extent of at least {SMALLEST_LENGTH:g}"
        raise refuse("is too small for float32", got=extent, allowed=allowed, path=path)


def _check_no_hair(material: Material | None, path: tuple[str | int, ...]) -> None:
    """Refuse hair on what is no curve."""
    if isinstance(material, Mix):
        for index, part in enumerate(material.materials):
            _check_no_hair(part, (*path, "materials", index))
    if isinstance(material, Hair):
        raise refuse("is of fibres, which this shape has none of", got="hair", allowed="shape: curves", path=path)


def _check_focus(camera: Camera, shutter: Shutter) -> None:
    """Refuse a point in focus that a moving camera has behind it when the shutter opens."""
    lens = camera.lens_camera
    if lens is None or lens.focus.point is None or not camera.motion:
        return
    eye, target, _ = camera.pose_at(shutter.open_s)
    if not np.dot(lens.focus.point - eye, target - eye) > 0:
        raise refuse(
            "does not lie in front of the film when the shutter opens",
            got=list(lens.focus.point),
            allowed="a point on the side that the camera looks to at shutter.open_s",
            path=("camera", "focus", "point"),
        )


def _check_followed(camera: Camera, objects: Sequence[Object]) -> None:
    """Refuse a focus that follows an object that is not there, or has no middle."""
    followed, path = camera.followed, ("camera", "focus", "object")
    if followed is None:
        return
    known = [item.name for item in objects if item.name and not isinstance(item, Plane)]
    if followed not in known:
        without = "a name, once an object has one"
        raise unknown_name("is no name of an object", followed, known, without=without, path=path)


def _check_sequence(sequence: FrameSequence | None, shutter: Shutter) -> None:
    """Refuse keys that move twice."""
    if sequence is None:
        return
    for name in sequence.keys.keys() & shutter.keys.keys():
        raise refuse(
            "moves by shutter.keys already",
            got=name,
            allowed="one of the two; those of the shutter move from frame to frame as well",
            path=("sequence", "keys", name),
        )


def _sequence_warnings(sequence: FrameSequence | None, exposure: Exposure, autofocus: bool) -> list[str]:
    """Name what is to follow from frame to frame where nothing is found anew in each."""
    warnings = []
    if sequence is not None and sequence.continuous_focus is not None and not autofocus:
        warnings.append(
            "sequence.continuous_focus follows nothing, as the focus is given (camera.focus: {auto: …} is followed)"
        )
    if sequence is not None and sequence.exposure_time_constant_s is not None and exposure.mode != "auto":
        warnings.append(
            f"sequence.exposure_time_constant_s follows nothing, as the exposure is {exposure.mode} (auto is followed)"
        )
    return warnings


_STAND = ("camera.eye", "camera.target")  # keys of where a camera is, which camera.motion moves as well


def _check_keys_of_shutter(shutter: Shutter, camera: Camera, render: RenderSettings) -> None:
    """Refuse what cannot follow keys that move while the shutter is open."""
    if not shutter.keys:
        return
    faults = {
        ("camera", "diffraction"): camera.diffraction != "off",
        ("camera", "ghosts"): getattr(camera, "ghosts", "off") != "off",
        ("camera", "accuracy"): getattr(camera, "accuracy", None) is not None,
        ("camera", "precision"): getattr(camera, "precision", "single") != "single",
        ("camera", "stands_at"): camera.stands_by_pupil and any(key.startswith(_STAND) for key in shutter.keys),
        ("render", "caustics"): render.caustics == "on",
        ("render", "virtual_lights"): render.virtual_lights == "on",
        ("render", "layers"): bool({"position", *SHARP_LAYERS} & set(render.layers)),
    }
    for path, wrong in faults.items():
        if wrong:
            raise refuse(
                "does not go with keys that move while the shutter is open",
                allowed=f"{path[-1]} left out, or a scene without shutter.keys",
                path=path,
            )


def _scene_warnings(
    camera: Camera,
    film: Film,
    shutter: Shutter,
    objects: Objects,
    lights: Sequence[Light],
    environment: Environment | None,
    folders: Folders,
) -> tuple[str, ...]:
    """Warnings of probable mistakes, one sentence each."""
    warnings: list[str] = []
    if not _any_light(objects, lights, environment):
        warnings.append("nothing in the scene emits light: the image will be black")
    width, height = film.size_m()
    aspect = (width / film.resolution[0]) / (height / film.resolution[1])
    if abs(aspect - 1) > _SQUARE_TOLERANCE:
        warnings.append(f"film.size_mm does not fit film.resolution: pixels are {aspect:.3g} times as wide as high")
    warnings += _extent_warnings(objects, folders)
    warnings += _mesh_warnings(objects, lights)
    warnings += _inside_warnings(camera, shutter, objects, folders)
    warnings += _motion_warnings(camera, shutter, objects)
    shown = (material for _, solid in objects for material in solid.shown_materials())
    glasses = [material.glass for material in shown if isinstance(material, Dielectric) and material.glass is not None]
    warnings += filter(None, dict.fromkeys(map(continued_words, glasses)))
    return tuple(warnings)


# The keys of lights and environments that say how strong they are.
STRENGTHS = ("intensity", "irradiance", "radiance", "bottom", "top", "gain")


def _any_light(objects: Objects, lights: Sequence[Light], environment: Environment | None) -> bool:
    strengths = (getattr(part, key, 0.0) for part in (*lights, environment) for key in STRENGTHS)
    return any(np.max(strength) > 0 for strength in strengths) or any(shines(solid) for _, solid in objects)


def shines(solid: Solid) -> bool:
    """Return whether any material of an object emits light."""
    shown = solid.shown_materials()
    glowing = [material.radiance for material in shown if isinstance(material, Emissive)]
    glowing += [material.emission for material in shown if isinstance(material, Principled)]
    return any(max(colour) > 0 if isinstance(colour, tuple) else True for colour in glowing)


def _extent_warnings(objects: Objects, folders: Folders) -> list[str]:
    bounded = [(item, solid) for item, solid in objects if not isinstance(item, Plane)]
    if not bounded:
        return []
    corners = [world_corners(item, solid, folders) for item, solid in bounded]
    sizes = [float(np.ptp(points, axis=1).max(axis=1).min()) for points in corners]
    whole = float(np.ptp(np.concatenate([points.reshape(-1, 3) for points in corners]), axis=0).max())
    smallest = int(np.argmin(sizes))
    if whole <= _LARGEST_EXTENT_RATIO * sizes[smallest]:
        return []
    return [
        f"{_label(bounded[smallest][0], sizes[smallest])} is more than {_LARGEST_EXTENT_RATIO:g} times smaller than "
        "the scene: float32 cannot resolve it"
    ]


def _label(item: PlacedObject, size: float) -> str:
    return f"object '{item.name}'" if item.name else f"an object of size {size:.3g}"


def _mesh_warnings(objects: Objects, lights: Sequence[Light]) -> list[str]:
    """Notes on parts of mesh files that are left out, each once; a scene with lights is not missing theirs."""
    contents = [solid.contents for _, solid in objects if isinstance(solid, LoadedMesh)]
    notes = dict.fromkeys(note for each in contents for note in each.notes)
    return [note for note in notes if not (lights and note.endswith(LAMPS_LEFT_OUT))]


def _inside_warnings(camera: Camera, shutter: Shutter, objects: Objects, folders: Folders) -> list[str]:
    eye = np.append(camera.pose_at(shutter.open_s)[0], 1.0)
    return [
        f"the camera stands inside objects[{index}]"
        for index, (item, solid) in enumerate(objects)
        if not (isinstance(item, Plane) or _has_medium(solid))
        and any(holds_eye(solid, places, eye) for places in item.place_blocks(folders, shutter.open_s))
    ]


def _has_medium(solid: Solid) -> bool:
    return any(getattr(material, "interior", None) is not None for material in solid.shown_materials())


def holds_eye(solid: Solid, places: NDArray[np.float64], eye: NDArray[np.float64]) -> bool:
    """Return whether the eye is inside a solid at one of its places; of many, those whose box holds it are tried."""
    eyes = np.linalg.solve(places, np.broadcast_to(eye[:, None], (len(places), 4, 1)))[:, :3, 0]
    if len(eyes) > 1:
        lower, upper = solid.bounds()
        eyes = eyes[np.all((eyes >= lower) & (eyes <= upper), axis=1)]
    return any(map(solid.contains, eyes))


def _motion_warnings(camera: Camera, shutter: Shutter, objects: Objects) -> list[str]:
    ghosts = getattr(camera, "ghosts", "off") != "off"
    warnings = [
        f"objects[{index}] shines and moves: light sampling leaves it out, so that what it lights is noisy"
        + (", and it makes no ghosts" if ghosts else "")
        for index, (item, solid) in enumerate(objects)
        if item.trajectory is not None and item.trajectory.moves(*shutter.span_s) and shines(solid)
    ]
    first, *poses = (camera.pose_at(time_s) for time_s in moments(camera.motion, *shutter.span_s))
    if ghosts and any(not np.array_equal(pose, first) for pose in poses):
        warnings.append(
            "camera.motion: ghosts stand where they are when the shutter opens, and what makes them moves on"
        )
    return warnings


# Faces of glass in one plane with others: which of the two light meets is decided by rounding.

_ROUNDING = 2.0**-22  # of a plane's place, over how far from the eye it is: a few roundings of float32
_NEARLY = 1e-3  # sines of angles between planes that are looked at closer
_SLIVER = 1e-6  # of a face, by which it may reach into another and only touch it
_LIFT_M = 1e-5  # which does up to 10 m from the eye
_FEW_TRIANGLES, _FEW_PLACES, _MOST_FACES = 64, 64, 20_000  # of a mesh, of an object, and of all that are looked at
_NAMED = 3  # pairs that are named


class _FlatFace(NamedTuple):
    """A flat face about the eye: its corners (n, 3) in turn, of an infinite plane a point of it, and a unit normal."""

    owner: int
    is_glass: bool
    corners: NDArray[np.float64]
    normal: NDArray[np.float64]

    def lies_in(self, other: _FlatFace) -> bool:
        """Return whether rounding moves its corners as far as they are off the plane of another face."""
        off = np.abs((self.corners - other.corners[0]) @ other.normal).max()
        return bool(len(self.corners) > 1 and off <= _ROUNDING * np.linalg.norm(self.corners, axis=1).max())

    def overlaps(self, other: _FlatFace) -> bool:
        """Return whether it shares some area with a face of its plane: no line along an edge parts the two."""
        if min(len(self.corners), len(other.corners)) == 1:
            return True
        for corners in (self.corners, other.corners):
            across = np.cross(np.roll(corners, -1, axis=0) - corners, self.normal)
            one, two = self.corners @ across.T, other.corners @ across.T
            shared = np.minimum(one.max(axis=0), two.max(axis=0)) - np.maximum(one.min(axis=0), two.min(axis=0))
            if (shared <= _SLIVER * np.minimum(np.ptp(one, axis=0), np.ptp(two, axis=0))).any():
                return False
        return True


def _is_glass(material: Material) -> bool:
    return isinstance(material, Dielectric | ThinGlass)


def _flat_faces(owner: int, solid: Solid, places: NDArray[np.float64], eye: NDArray[np.float64]) -> Iterator[_FlatFace]:
    """Yield the flat faces of an object at some places, of meshes if they have few triangles."""
    parts: Iterable[tuple[Material, list[NDArray[np.float64]]]] = ()
    if isinstance(solid, LoadedMesh):
        parts = solid.flat_faces(_FEW_TRIANGLES)
    elif isinstance(solid, SceneObject):
        parts = [(solid.material, [np.array([solid.point])] if isinstance(solid, Plane) else solid.flat_faces())]
    for (material, polygons), place in product(parts, places):
        for polygon in polygons:
            corners = polygon @ place[:3, :3].T + place[:3, 3] - eye
            if isinstance(solid, Plane):
                normal = np.linalg.solve(place[:3, :3].T, np.array(solid.normal, np.float64))
            else:
                normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            if (size := np.linalg.norm(normal)) > 0:
                yield _FlatFace(owner, _is_glass(material), corners, normal / size)


def _coplanar_pairs(faces: Sequence[_FlatFace]) -> Iterator[tuple[_FlatFace, _FlatFace]]:
    """Yield each face of glass with every face of another object that shares a part of its plane with it."""
    owners, normals = np.array([face.owner for face in faces]), np.array([face.normal for face in faces])
    points = np.array([face.corners[0] for face in faces])
    for glass in (face for face in faces if face.is_glass):
        way = points - glass.corners[0]
        near = np.abs(way @ glass.normal) <= _NEARLY * (np.linalg.norm(way, axis=1) + np.abs(glass.corners).max())
        near &= (np.linalg.norm(np.cross(normals, glass.normal), axis=1) <= _NEARLY) & (owners != glass.owner)
        for other in (faces[index] for index in np.flatnonzero(near).tolist()):
            if (glass.lies_in(other) or other.lies_in(glass)) and glass.overlaps(other):
                yield glass, other


def _coplanar_warnings(
    camera: Camera, shutter: Shutter, objects: Objects, folders: Folders, metres_per_unit: float
) -> list[str]:
    """Name objects of which a face of glass lies in one plane with a face of another, and shares some of it."""
    if not any(_is_glass(material) for _, solid in objects for material in solid.shown_materials()):
        return []
    eye, faces = camera.pose_at(shutter.open_s)[0], list[_FlatFace]()
    for owner, (item, solid) in enumerate(objects):
        if item.instances is None or len(item.instances.matrices(folders)) <= _FEW_PLACES:
            faces += _flat_faces(owner, solid, item.places(folders, shutter.open_s), eye)
    if not 0 < len(faces) <= _MOST_FACES:
        return []
    found = dict[tuple[int, int], float]()
    for glass, other in _coplanar_pairs(faces):
        pair = (glass.owner, other.owner) if (other.owner, glass.owner) not in found else (other.owner, glass.owner)
        found[pair] = max(found.get(pair, 0.0), float(np.linalg.norm(glass.corners, axis=1).max()))
    names = [f"object '{item.name}'" if item.name else f"objects[{index}]" for index, (item, _) in enumerate(objects)]
    warnings = [
        f"{names[glass]}, of glass, has a face in one plane with {names[other]}: rounding decides which of them light"
        f" meets (lift it off by {1e3 * max(_LIFT_M, 4 * _ROUNDING * reach * metres_per_unit):.1g} mm)"
        for (glass, other), reach in list(found.items())[:_NAMED]
    ]
    return [*warnings, *([f"{len(found) - _NAMED} more pairs of objects share planes so"] * (len(found) > _NAMED))]


class Scene(SceneModel):
    """A scene. Made by `load_scene`; attributes are the keys of the file."""

    metres_per_unit: Annotated[float, Field(ge=1e-6, le=1e6), NUMBER] = 1.0
    """Length of one scene unit [m]; scales every coordinate of the scene."""

    film: Film = Film()
    """Resolution and size of the film."""

    camera: Camera
    """Camera model and pose."""

    exposure: ExposureOrMode = Exposure()
    """What a value of 1 on the film stands for."""

    shutter: Shutter = Shutter()
    """How long light falls on the film."""

    sequence: FrameSequence | None = None
    """Keys that change from frame to frame; a single picture goes by the scene as it stands."""

    sensor: Sensor | None = None
    """What turns light on the film into numbers, for pictures and raw files; none by default."""
    spectrum: SpectrumSettings = SpectrumSettings()
    """How the colour of light is carried along paths."""

    render: RenderSettings = Field(default=RenderSettings(), validate_default=True)
    """How the light paths are sampled."""

    picture: PictureSettings = PictureSettings()
    """How the film becomes the picture that a screen shows."""

    materials: Mapping[str, Material] = {}
    """Materials by name, for use in `objects`."""

    meshes: Mapping[str, NamedMesh] = {}
    """Meshes by name, for use in `objects`."""

    objects: tuple[Object, ...] = ()
    """What is in the world."""

    lights: tuple[Light, ...] = ()
    """Lights without a surface."""

    environment: Environment | None = None
    """Light from infinitely far away; black by default."""

    medium: media.SurroundingMedium | None = None
    """What fills the space around camera and objects; nothing by default."""

    _folders: Folders = PrivateAttr(default_factory=Folders)
    _library: MeshLibrary = PrivateAttr()
    _stand_ins: tuple[str, ...] = PrivateAttr(default=())
    _made_of: dict[str, Any] | None = PrivateAttr(default=None)
    _new: list[tuple[int, Object]] | None = PrivateAttr(default=None)
    _replaced: tuple[tuple[Object, ...], dict[int, Material]] = PrivateAttr(default=((), {}))  # see `new_materials`
    _shown: tuple[tuple[Object, ...], tuple[Material, ...]] = PrivateAttr(default=((), ()))  # objects, their materials

    @field_validator("materials", mode="before")
    @classmethod
    def _resolve_mixes(cls, materials: Any) -> Any:
        if not isinstance(materials, Mapping):
            return materials
        return {name: with_parts(item, materials, path=(name,)) for name, item in materials.items()}

    @field_validator("objects", mode="before")
    @classmethod
    def _resolve_materials(cls, objects: Any, info: ValidationInfo) -> Any:
        if not isinstance(objects, (list, tuple)):
            return objects
        resolved = [with_material(item, index, info.data.get("materials")) for index, item in enumerate(objects)]
        for index, item in enumerate(resolved):
            _check_mesh_name(item, index, info.data.get("meshes"))
        return resolved

    @field_validator("objects", mode="wrap")
    @classmethod
    def _validate_new_objects(cls, objects: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        """Validate the objects that the scene before does not have; its own may get the new material of a name."""
        context: dict[str, Any] = info.context or {}
        before, materials = context.get("scene"), info.data.get("materials")
        if before is None or materials is None or not isinstance(objects, (list, tuple)):
            return handler(objects)
        changed = {id(one): name for name, one in before.materials.items() if materials.get(name) is not one}
        if objects is before.objects and not changed:
            context |= {"replaced": before._replaced, "shown": before.shown_materials()}
            return objects
        own = set(map(id, before.objects))
        is_same = len(objects) == len(before.objects) and all(map(is_, objects, before.objects))
        given, fresh = list(objects), set[int]()
        if not is_same:
            fresh = {index for index, item in enumerate(objects) if id(item) not in own}
        replaced = {key: materials[name] for key, name in changed.items() if name in materials}
        for index, item in enumerate(objects if changed else ()):
            key = id(getattr(item, "material", None))
            if key in replaced and index not in fresh:
                given[index] = _with_material(item, replaced[key])
            elif key in changed and index not in fresh:
                given[index] = {key: getattr(item, key) for key in item.model_fields_set} | {"material": changed[key]}
                fresh.add(index)
        places = sorted(fresh)
        try:
            validated = handler([given[index] for index in places]) if places else ()
        except ValidationError:
            return handler(given)  # names the places of the errors
        for index, item in zip(places, validated, strict=True):
            given[index] = item
        context["new"] = [(index, given[index]) for index in places]
        if is_same and not places:
            shown = tuple(replaced.get(id(material), material) for material in before.shown_materials())
            context |= {"replaced": (before.objects, replaced), "shown": shown}
        return tuple(given)

    @field_validator("environment", mode="before")
    @classmethod
    def _default_up(cls, environment: Any, info: ValidationInfo) -> Any:
        has_up = isinstance(environment, dict) and environment.get("kind") in WITH_UP
        return {"up": info.data["camera"].up} | environment if has_up and "camera" in info.data else environment

    @field_validator("medium", mode="before")
    @classmethod
    def _default_up_of_layer(cls, medium: Any, info: ValidationInfo) -> Any:
        layer = medium.get("layer") if isinstance(medium, dict) else None
        if not isinstance(layer, dict) or "camera" not in info.data:
            return medium
        return medium | {"layer": {"up": info.data["camera"].up} | layer}

    @field_validator("render")
    @classmethod
    def _add_coverage(cls, render: RenderSettings, info: ValidationInfo) -> RenderSettings:
        """Have the coverage of every sample recorded for a film without a background."""
        if "film" not in info.data or not info.data["film"].transparent:
            return render
        layers = tuple(dict.fromkeys((*render.layers, "coverage")))
        return render.model_copy(update={"layers": layers, "layers_spp": MAX_SPP})

    @field_validator("lights", mode="before")
    @classmethod
    def _default_down(cls, lights: Any, info: ValidationInfo) -> Any:
        if not isinstance(lights, (list, tuple)) or "camera" not in info.data:
            return lights
        down = tuple(-x for x in info.data["camera"].up)
        hung = [isinstance(light, dict) and light.get("kind") == "ies" for light in lights]
        return [{"direction": down} | light if hangs else light for light, hangs in zip(lights, hung, strict=True)]

    @model_validator(mode="after")
    def _take_files(self, info: ValidationInfo) -> Self:
        """Take over how files are found: the folders of a scene file, or everything from the scene that is changed."""
        context = info.context or {}
        self._made_of = context.get("made_of")
        given = context.get("scene")
        if given is not None:
            self._folders, self._library, self._stand_ins = given._folders, given._library, given._stand_ins
            self._new, self._replaced = context.get("new", []), context.get("replaced", ((), {}))
            if "shown" in context:
                self._shown = self.objects, context["shown"]
        else:
            self._folders = context.get("folders", self._folders)
            self._library = MeshLibrary(self._folders, self.meshes)
        return self

    @model_validator(mode="after")
    def _check_whole(self) -> Self:
        self.camera.check_film(self.film.resolution)
        check_exposure(self.exposure, self.camera)
        self.picture.check_crop(self.film.crop)
        _check_focus(self.camera, self.shutter)
        if self.sensor is None and self.requested_autofocus is not None and self.requested_autofocus.sensor:
            path = ("camera", "focus", "auto", "sensor")
            raise refuse("the scene has none", got=True, allowed="sensor: {} in the scene, or without", path=path)
        _check_sequence(self.sequence, self.shutter)
        _check_followed(self.camera, self.objects)
        _check_keys_of_shutter(self.shutter, self.camera, self.render)
        for index, item in self.new_objects():
            if not isinstance(item, Curves):
                _check_no_hair(getattr(item, "material", None), ("objects", index, "material"))
            if not isinstance(item, MeshObject):
                check_extent(item, item, path=("objects", index))
        return self

    @property
    def folders(self) -> Folders:
        """Where the scene may read files."""
        return self._folders

    @property
    def base_dir(self) -> Path:
        """Folder of the scene file, where relative paths start; the working folder for a scene made in Python."""
        return self._folders.base

    @property
    def made_of(self) -> dict[str, Any]:
        """The data that the scene was made of, by the keys at its top: those of a file, or parts of a scene."""
        if self._made_of is not None:
            return dict(self._made_of)
        return {name: getattr(self, name) for name in self.model_fields_set}

    def report_missing_pictures(self, absent: list[str]) -> None:
        """Let meshes go on without their missing pictures, and add what is missing to a list as they are loaded."""
        self._library = self._library.begun_anew(self.objects, absent)

    def with_stand_ins(self, objects: tuple[Object, ...], stand_ins: tuple[str, ...]) -> Scene:
        """Return the scene with the objects that are left, and what stands in for what is missing."""
        scene = self.model_copy(update={"objects": objects})
        scene._stand_ins, scene._made_of = stand_ins, None
        return scene

    def holds_old_meshes(self) -> bool:
        """Return whether as many meshes are loaded for objects of scenes before as for this one's."""
        return self._library.count > 2 * len(self.objects)

    def new_objects(self) -> Iterable[tuple[int, Object]]:
        """Return index and object of those that the scene before, of which this was made, has not.

        Those that it has with another material of the same name are none.
        """
        return enumerate(self.objects) if self._new is None else self._new

    def new_materials(self, objects: tuple[Object, ...]) -> Mapping[int, Material] | None:
        """Return the new materials by the identity of those before, where they alone have made these objects of others.

        None where more has changed.
        """
        return self._replaced[1] if self._replaced[0] is objects else None

    def load_mesh(self, item: MeshObject | Board) -> LoadedMesh:
        """Return the parts and materials of one of the scene's mesh objects; they are read once.

        Raises
        ------
        InputError
            When the mesh cannot be used, without the place of the object.
        """
        return item.loaded if isinstance(item, Board) else self._library.load(item)

    def solids(self) -> tuple[Solid, ...]:
        """Return the shape and materials of each object, those of meshes from their files."""
        return self._library.solids(self.objects)

    def shown_materials(self) -> tuple[Material, ...]:
        """Return the materials that objects show."""
        if self._shown[0] is not self.objects:
            self._shown = self.objects, self._find_shown_materials()
        return self._shown[1]

    def _find_shown_materials(self) -> tuple[Material, ...]:
        own = {id(material): material for item in self.objects
               if (material := getattr(item, "material", None)) is not None}  # fmt: skip
        others = [item for item in self.objects if getattr(item, "material", None) is None]
        solids = [self.load_mesh(item) for item in others if isinstance(item, (MeshObject, Board))]
        return (*(own | {id(each): each for solid in solids for each in solid.shown_materials()}).values(),)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of probable mistakes, one sentence each."""
        objects = tuple(zip(self.objects, self.solids(), strict=True))
        own = _scene_warnings(
            self.camera, self.film, self.shutter, objects, self.lights, self.environment, self._folders
        )
        coplanar = _coplanar_warnings(self.camera, self.shutter, objects, self._folders, self.metres_per_unit)
        followed = _sequence_warnings(self.sequence, self.exposure, self.requested_autofocus is not None)
        return (*self._stand_ins, *own, *coplanar, *followed, *self.lens_doubts)

    @property
    def lens_doubts(self) -> tuple[str, ...]:
        """Doubts about the lens, and what it really opens to; none about one that cannot be used, which is an error."""
        camera = self.camera.lens_camera
        if camera is None:
            return ()
        try:
            lens = self.load_lens()
            if camera.f_number is None:
                return lens.warnings
            state = at_position(lens, camera.zoom, camera.focal_length_mm, camera.wavelength_nm)
            return (*lens.warnings, *state.speed_note(camera.f_number, camera.wavelength_nm))
        except (InputError, StateError):
            return ()

    @property
    def stand_ins(self) -> tuple[str, ...]:
        """What is missing from the scene's files, and what stands in its place."""
        return self._stand_ins

    @property
    def requested_autofocus(self) -> lens_settings.AutoFocus | None:
        """The settings of autofocus; None where the focus is given."""
        return self.camera.autofocus

    def lens_source(self) -> str | Path | dict[str, Any] | None:
        """The source of the lens: a name, a checked path or a mapping; None without a real lens."""
        camera = self.camera.lens_camera
        if camera is None:
            return None
        lens = camera.design
        return self._folders.find(lens) if isinstance(lens, str) and names_a_file(lens) else lens

    def tolerances_source(self) -> str | Path | None:
        """Return the tolerances of a lens as built: a grade, or a checked path; None for a design."""
        camera = self.camera.lens_camera
        made = None if camera is None else camera.as_built
        if made is None:
            return None
        return made.spec if made.spec in lens_settings.GRADES else self._folders.find(made.spec)

    def load_lens(self) -> Lens:
        """Return the real lens of the camera; its files lie where the scene may read.

        Raises
        ------
        InputError
            When it cannot be used; the message names a lens file, else the key.
        StateError
            When a file cannot be read.
        """
        source = self.lens_source()
        assert source is not None, "only cameras with a real lens have one"
        try:
            if isinstance(source, str):
                return named_lens(source)
            return load_lens(source, References(self._lens_folders(source)))
        except InputError as problem:
            place = "" if isinstance(source, Path) else "camera.lens: "
            raise InputError(f"{place}{problem}") from None

    def _lens_folders(self, source: Path | dict[str, Any]) -> Folders:
        """Return where the files may lie that a lens names."""
        return self._folders.beside(source) if isinstance(source, Path) else self._folders

    def content_of(self, reference: FileReference) -> Path | bytes:
        """Return the checked path of the file that a part of the scene names, or its content where that is known."""
        return reference.source(self._folders)

    def digest_of(self, reference: FileReference) -> str:
        """Return the SHA-256 of the content of the file that a part of the scene names."""
        return reference.content_digest(self._folders)

    def content_hash(self) -> str:
        """Return the SHA-256 of everything that changes the film.

        Left out are the number of samples, layers, the sensor without its response, what follows the film (diffraction,
        ghosts and how the picture is shown), names and labels. Files count by their content. `picture_hash` has more.
        """
        left_out = {"name", "label", "file", "mesh", "vertices", "faces", "uvs", "normals", "colors"}
        content = self.model_dump(
            mode="json",
            exclude={
                "picture": True, "sequence": True, "sensor": True, "camera": FOLLOWS_THE_FILM,
                "materials": True, "meshes": True,
                "render": {"spp", "layers", "layers_spp"}, "objects": {"__all__": left_out},
            },
        )  # fmt: skip
        if "lights" not in self.render.layers:
            for shining in (*content["objects"], *content["lights"], content["environment"] or {}):
                shining.pop("group", None)
        if self.sensor is not None and self.sensor.response is not None:
            content["sensor"] = {"response": self.sensor.response}
        for item, plain in zip(self.objects, content["objects"], strict=True):
            if isinstance(item, MeshObject):
                plain |= self.load_mesh(item).described(self._folders)
        source = self.lens_source()
        if source is not None and not isinstance(source, str):
            digests = digests_of_lens(source, self._lens_folders(source))
            if isinstance(source, Path):
                design = digests.pop("")
                if isinstance(self.camera.lens, lens_settings.RealLens):  # type: ignore[union-attr]
                    content["camera"]["lens"]["design"] = design
                else:
                    content["camera"]["lens"] = design
            if digests:
                content["camera"]["files of the lens"] = digests
        if isinstance(tolerances := self.tolerances_source(), Path):
            content["camera"]["lens"]["as_built"]["spec"] = digest(tolerances, MAX_BYTES)
        followed = getattr(getattr(self.camera, "focus", None), "object", None)
        if followed is not None:  # names of objects are left out
            content["camera"]["focus"]["object"] = [item.name == followed for item in self.objects].index(True)
        for (key, *rest), reference in file_references(self):
            if key != "materials":
                part: Any = content[str(key)]
                for step in rest:
                    part = part[step]
                part["file"] = self.digest_of(reference)
        return _hash(content)

    def picture_hash(self, content_hash: str | None = None) -> str:
        """Return the SHA-256 of everything that changes a picture but samples and layers.

        That is what changes the film (`content_hash`, which may be given), and what follows it: diffraction, ghosts,
        the sensor, and how the picture is shown.
        """
        # Of the camera by itself: pydantic before 2.13 takes no keys of a member of a union that it has not built yet.
        said = self.model_dump(mode="json", include={"sensor", "picture"})
        said["camera"] = self.camera.model_dump(mode="json", include=FOLLOWS_THE_FILM)
        return _hash([content_hash or self.content_hash(), said, *self.picture.content_digests()])


def _hash(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _with_material(item: Object, material: Material) -> Object:
    """Return an object with another material, as `model_copy` does: in a third of its time, for thousands of them."""
    copy, values = object.__new__(type(item)), item.__dict__.copy()
    values["material"] = material
    object.__setattr__(copy, "__dict__", values)
    object.__setattr__(copy, "__pydantic_fields_set__", item.__pydantic_fields_set__)
    object.__setattr__(copy, "__pydantic_extra__", item.__pydantic_extra__)
    object.__setattr__(copy, "__pydantic_private__", item.__pydantic_private__)
    return copy


def _check_mesh_name(item: Any, index: int, meshes: Mapping[str, NamedMesh] | None) -> None:
    """Refuse an object's mapping that names a mesh that is not there."""
    name = item.get("mesh") if isinstance(item, dict) else None
    if not isinstance(name, str) or meshes is None or name in meshes:
        return
    without = "file or vertices, or a name once `meshes` defines one"
    raise unknown_name("names no mesh", name, meshes, without=without, path=(index, "mesh"))
