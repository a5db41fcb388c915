"""What a hand changes in a scene: the camera by moves; objects, lamps and surroundings by dials of what is selected."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LUMENS_PER_WATT
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, near_name
from rptcam_cl.core.files import plain
from rptcam_cl.scene.camera import pose_matrix
from rptcam_cl.scene.load import key_path
from rptcam_cl.scene.materials import Emissive, Principled
from rptcam_cl.scene.scene import STRENGTHS, Scene
from rptcam_cl.viewfinder.panel import Panel, Turn, number, word

# A thing is named by its key path in the scene: objects.3, lights.0, materials.candle, environment.

_AXES = ("x", "y", "z")
COLOURS = ("red", "green", "blue")
STEPS = 1000  # of a position, either way
POWERS = [0.0, *(2.0 ** (step / 3) for step in range(-60, 61))]  # thirds of a stop, and none
_COLOUR_KEYS = ("reflectance", "base_color", "transmittance")
_NUMBER_KEYS = {
    "roughness": "roughness", "alpha": "roughness alpha", "metallic": "metallic", "specular": "specular",
    "transmission": "transmission", "clearcoat": "clear coat",
}  # fmt: skip


@dataclass(frozen=True)
class Field:
    """A dial of the thing that is selected: what it stands at, how far it goes, and what turning it changes."""

    name: str
    label: str
    value: Any
    changes: Callable[[Any], Mapping[str, Any]]
    limits: Mapping[str, Any] = field(default_factory=dict)
    kind: str = "number"
    why_not: str | None = None

    @property
    def entry(self) -> dict[str, Any]:
        """The dial as pages draw it."""
        text = "–" if self.value is None else f"{self.value:.3g}" if self.kind == "number" else str(self.value)
        return {
            "name": f"thing_{self.name}", "label": self.label, "kind": self.kind, "value": self.value, "text": text,
            "enabled": self.why_not is None, "linked": self.why_not, "unit": "", **self.limits,
        }  # fmt: skip


def _title_of(scene: Scene, thing: str) -> str:
    """What a thing is called."""
    part, _, name = thing.partition(".")
    if part == "objects":
        index = int(name.removesuffix(".material"))
        return scene.objects[index].name or f"{scene.objects[index].shape} {index + 1}"
    if part == "lights":
        return f"{scene.lights[int(name)].kind} {int(name) + 1}"
    return "surroundings" if part == "environment" else name


def is_there(scene: Scene, thing: str) -> bool:
    """Whether a scene has a thing."""
    part, _, name = thing.partition(".")
    if part in ("objects", "lights"):
        return name.isdecimal() and int(name) < len(getattr(scene, part))
    return name in scene.materials if part == "materials" else thing == "environment" and scene.environment is not None


def fields_of(panel: Panel, thing: str) -> list[Field]:
    """The dials of a thing."""
    scene, (part, _, name) = panel.scene, thing.partition(".")
    if part == "objects":
        return [
            *_material_choice(scene, int(name)),
            *_of_material(panel, _material_of(scene, int(name))),
            *_position(scene, int(name)),
        ]
    if part == "materials":
        return list(_of_material(panel, thing))
    lamp = _model(scene, thing)
    return [*_emission(panel, thing), *_numbers(thing, lamp), *_position_key(scene, thing, lamp)]


def turn_thing(panel: Panel, thing: str | None, name: str, value: Any) -> Turn:
    """Turn a dial of the thing that is selected.

    Raises
    ------
    InputError
        Nothing is selected, it has no such dial, or the value is not one of its kind.
    """
    if thing is None:
        raise InputError(f"{name}: nothing is selected (allowed: dials of what is)")
    fields = {f"thing_{each.name}": each for each in fields_of(panel, thing)}
    if name not in fields:
        raise InputError(f"{name}: {_title_of(panel.scene, thing)} has no such dial{near_name(name, fields)}")
    dial = fields[name]
    if dial.why_not is not None:
        return panel.same(f"{dial.label}: {dial.why_not}")
    if dial.kind == "choice":
        wanted = word(name, value, tuple(each["value"] for each in dial.limits["choices"]))
        return Turn(panel.dials, dial.changes(wanted))
    low, high = dial.limits["min"], dial.limits["max"]
    reached = min(max(number(name, value), low), high)
    messages = () if reached == value else (f"{dial.label} goes from {low:.3g} to {high:.3g}",)
    return Turn(panel.dials, dial.changes(reached), messages)


# What a hand brings to the scene. Lengths are in distances from the camera to what it is focused on.

_Added = Literal["lamp", "card", "backdrop"]
_STANDS: dict[str, tuple[tuple[float, float, float], tuple[float, float], dict[str, Any]]] = {
    # right, up and behind of what is in focus; width and height; material
    "lamp": ((0.6, 0.6, -0.3), (0.3, 0.3), {"kind": "emissive"}),
    "card": ((-0.5, 0.0, -0.1), (0.5, 0.5), {"kind": "matte", "reflectance": [0.9, 0.9, 0.9]}),
    "backdrop": ((0.0, 0.0, 1.0), (5.0, 4.0), {"kind": "matte", "reflectance": [0.5, 0.5, 0.5]}),
}
_AS_GREY_W = 0.18 * 100  # irradiance [W/m²] that a lamp adds where nothing was metered


def add_thing(panel: Panel, view: Viewpoint, what: _Added) -> tuple[dict[str, Any], str]:
    """Return the changes that bring a lamp, a white card or a grey backdrop to a scene, and its name.

    Each is a rectangle that faces what the camera is focused on, or, behind it, the camera. A lamp gives what is in
    focus as much light as the camera meters there.
    """
    scene = panel.scene
    ahead = (view.target - view.eye) / np.linalg.norm(view.target - view.eye)
    right = np.cross(ahead, view.up) / np.linalg.norm(np.cross(ahead, view.up))
    place, (width, height), material = _STANDS[what]
    offset = view.distance * (np.array(place) @ np.stack([right, np.cross(right, ahead), ahead]))
    focus, facing = view.eye + view.distance * ahead, -offset / np.linalg.norm(offset)
    across = np.cross(np.cross(right, ahead), facing)
    across *= view.distance * width / np.linalg.norm(across)
    upwards = np.cross(facing, across) * (height / width)
    corner = focus + offset - (across + upwards) / 2
    material = dict(material)
    if what == "lamp":
        irradiance = _AS_GREY_W if panel.reading_cd_m2 is None else np.pi * panel.reading_cd_m2 / LUMENS_PER_WATT / 0.18
        solid_angle = width * height / float(np.array(place) @ np.array(place))
        material["radiance"] = [float(f"{irradiance / solid_angle:.3g}")] * 3
    edges = {"corner": corner, "edge_u": across, "edge_v": upwards}
    item = {"shape": "rectangle", "name": what, **{key: value.tolist() for key, value in edges.items()}}
    return {"objects": [*scene.made_of["objects"], item | {"material": material}]}, f"objects.{len(scene.objects)}"


# Dials of materials and lamps.


def _material_of(scene: Scene, index: int) -> str | None:
    """The key path of an object's material; None where its file has it."""
    given = _given_value(scene, index, "material")
    if isinstance(given, str):
        return f"materials.{given}" if "." not in given else None
    return f"objects.{index}.material" if isinstance(given, dict) else None


def _material_choice(scene: Scene, index: int) -> Iterator[Field]:
    given = _given_value(scene, index, "material")
    if isinstance(given, str) and len(scene.materials) > 1:
        choices = [{"value": name, "label": name} for name in scene.materials]
        path = f"objects.{index}.material"
        yield Field("material", "material", given, lambda name: {path: name}, {"choices": choices}, "choice")


def _of_material(panel: Panel, path: str | None) -> Iterator[Field]:
    if path is None:
        return
    model = _model(panel.scene, path)
    for key in _COLOUR_KEYS:
        if hasattr(model, key):
            yield from _albedo(path, key, getattr(model, key))
            break
    yield from _emission(panel, path)
    for key, label in _NUMBER_KEYS.items():
        value = getattr(model, key, None)
        if isinstance(value, tuple) and len(set(value)) == 1:
            value = value[0]
        if isinstance(value, float):
            low = 1e-3 if key == "alpha" else 0.0
            yield Field(key, label, value, _setter(f"{path}.{key}"), {"min": low, "max": 1.0, "step": 0.01})


def _albedo(path: str, key: str, value: Any) -> Iterator[Field]:
    why_not = None if _is_rgb(value) else "its colour is a pattern or a spectrum"
    for index, colour in enumerate(COLOURS):

        def changes(wanted: float, index: int = index) -> dict[str, Any]:
            return {f"{path}.{key}": [wanted if place == index else each for place, each in enumerate(value)]}

        here = value[index] if why_not is None else None
        yield Field(colour, colour, here, changes, {"min": 0.0, "max": 1.0, "step": 0.01}, why_not=why_not)


def _emission(panel: Panel, path: str) -> Iterator[Field]:
    """Power and colour of what shines."""
    key = _strength_key(_model(panel.scene, path))
    if key is None:
        return
    value = getattr(_model(panel.scene, path), key)
    why_not = "muted" if f"{path}.{key}" in panel.dials.dark else None
    limits = {"min": 0.0, "max": POWERS[-1], "steps": POWERS}
    if isinstance(value, float):
        yield Field("power", "power", value, _setter(f"{path}.{key}"), limits, why_not=why_not)
        return
    if not _is_rgb(value):
        yield Field("power", "power", None, _setter(path), limits, why_not="its colour is a pattern or a spectrum")
        return
    most = max(value)

    def scaled(wanted: float) -> dict[str, Any]:
        return {f"{path}.{key}": [each * wanted / most if most else wanted for each in value]}

    yield Field("power", "power", most, scaled, limits, why_not=why_not)
    for index, colour in enumerate(COLOURS):

        def changes(wanted: float, index: int = index) -> dict[str, Any]:
            return {f"{path}.{key}": [wanted if place == index else each for place, each in enumerate(value)]}

        yield Field(f"light_{colour}", f"{colour} light", value[index], changes, limits, why_not=why_not)


_LAMP_NUMBERS = {
    "outer_degrees": ("cone", 1.0, 180.0), "sun_elevation_degrees": ("sun's height", 0.0, 90.0),
    "sun_azimuth_degrees": ("sun's azimuth", -360.0, 360.0), "turbidity": ("haze", 2.0, 10.0),
    "rotation_degrees": ("turn", -360.0, 360.0),
}  # fmt: skip


def _numbers(path: str, model: Any) -> Iterator[Field]:
    for key, (label, low, high) in _LAMP_NUMBERS.items():
        if isinstance(getattr(model, key, None), float):
            step = 0.1 if key == "turbidity" else 1.0
            yield Field(
                key, label, getattr(model, key), _setter(f"{path}.{key}"), {"min": low, "max": high, "step": step}
            )


# Where things are.


def _position(scene: Scene, index: int) -> Iterator[Field]:
    """Where the middle of an object is, which is moved by the last step of its transform."""
    item, path = scene.objects[index], f"objects.{index}.transform"
    why_not = "it moves by keyframes" if item.motion else "it stands in several places" if item.instances else None
    if not isinstance(scene.made_of["objects"][index], Mapping):
        why_not = "it was made in Python"
    if item.shape == "plane":
        yield from _position_key(scene, f"objects.{index}", item, "point")
        return
    low, high = scene.solids()[index].bounds()
    matrix = item.placed_at(scene.shutter.open_s)
    middle = (matrix[:3, :3] @ ((np.asarray(low) + np.asarray(high)) / 2) + matrix[:3, 3]).tolist()
    size = float(np.linalg.norm(matrix[:3, :3] @ (np.asarray(high) - np.asarray(low))))
    given = plain(_given_value(scene, index, "transform") or [])
    steps = [dict(each) for each in (given if isinstance(given, list) else [given])]
    for axis, name in enumerate(_AXES):

        def changes(wanted: float, axis: int = axis) -> dict[str, Any]:
            moved = [dict(each) for each in steps]
            if not moved or "translate" not in moved[-1]:
                moved.append({"translate": [0.0, 0.0, 0.0]})
            shift = list(moved[-1]["translate"])
            shift[axis] += wanted - middle[axis]
            moved[-1] = {"translate": shift}
            return {path: moved}

        yield Field(name, name, middle[axis], changes, _around(middle[axis], size / 20), why_not=why_not)


def _position_key(scene: Scene, thing: str, model: Any, key: str = "position") -> Iterator[Field]:
    if not hasattr(model, key):
        return
    value = list(getattr(model, key))
    size = math.dist(scene.camera.eye, scene.camera.target) / 2
    for axis, name in enumerate(_AXES):

        def changes(wanted: float, axis: int = axis) -> dict[str, Any]:
            return {f"{thing}.{key}": [wanted if place == axis else each for place, each in enumerate(value)]}

        yield Field(name, name, value[axis], changes, _around(value[axis], size / 20))


def _around(value: float, step: float) -> dict[str, float]:
    """The limits of a dial without any: steps of 1, 2 or 5 times a power of ten around a value."""
    power = 10.0 ** math.floor(math.log10(max(step, 1e-9)))
    step = max(each * power for each in (1, 2, 5) if each * power <= max(step, 1e-9) * (1 + 1e-9))
    middle = round(value / step) * step
    return {"min": middle - STEPS * step, "max": middle + STEPS * step, "step": step}


# Lamps: all that shines, lit or not.


def _strength_key(model: Any) -> str | None:
    """The key that says how strong something shines; None for what does not."""
    if isinstance(model, Principled):
        value = model.emission
        return "emission" if not isinstance(value, tuple) or max(value) > 0 else None
    if isinstance(model, Emissive):
        return "radiance"
    return next(
        (
            key
            for key in ("intensity", "irradiance", "radiance", "gain", "top")
            if key in STRENGTHS and hasattr(model, key)
        ),
        None,
    )


def lamps_of(panel: Panel) -> list[dict[str, Any]]:
    """All that shines, with what a hand has made of it: ``mute``, ``solo``, and ``lit``."""
    scene, dials = panel.scene, panel.dials
    listed = []
    for thing, label in _lamps(scene, dials.dark):
        lit = not any(path.startswith(f"{thing}.") for path in dials.dark)
        listed.append(
            {"name": thing, "label": label, "mute": thing in dials.mute, "solo": thing in dials.solo, "lit": lit}
        )
    return listed


def _lamps(scene: Scene, dark: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for index, light in enumerate(scene.lights):
        yield f"lights.{index}", f"{light.kind} {index + 1}"
    for path, users in _shining(scene, dark).items():
        name = (
            path.split(".", 1)[1] if path.startswith("materials") else _title_of(scene, path.removesuffix(".material"))
        )
        yield path, f"{name} × {len(users)}" if len(users) > 1 else name
    if scene.environment is not None and _strength_key(scene.environment):
        yield "environment", "surroundings"


def _shining(scene: Scene, dark: Mapping[str, Any]) -> dict[str, list[int]]:
    """The objects of each material that shines, lit or not, by its key path."""
    users: dict[str, list[int]] = {}
    for index in range(len(scene.objects)):
        path = _material_of(scene, index)
        if path is not None:
            users.setdefault(path, []).append(index)
    models = {path: _model(scene, path) for path in users}
    return {
        path: users[path]
        for path, model in models.items()
        if isinstance(model, Emissive | Principled)
        and (_strength_key(model) or any(each.startswith(f"{path}.") for each in dark))
    }


def switch_lamp(panel: Panel, thing: str, mute: bool | None, solo: bool | None) -> Turn:
    """Mute a lamp or have it shine alone, or end that; what is dark has its strength back when it is lit again.

    Raises
    ------
    InputError
        There is no such lamp.
    """
    scene, dials = panel.scene, panel.dials
    names = [name for name, _ in _lamps(scene, dials.dark)]
    if thing not in names:
        raise InputError(f"lamp: there is none of that name{near_name(thing, names)} (got {thing[:80]!r})")
    muted = _switch_name(dials.mute, thing, mute)
    alone = _switch_name(dials.solo, thing, solo)
    dark, changes = dict(dials.dark), {}
    for name in names:
        wanted_dark = name not in alone if alone else name in muted
        own = [path for path in dark if path.startswith(f"{name}.")]
        if wanted_dark and not own:
            model = _model(scene, name)
            for key in (key for key in (*STRENGTHS, "emission") if hasattr(model, key)):
                value = getattr(model, key)
                dark[f"{name}.{key}"] = _data(scene, name).get(key)
                changes[f"{name}.{key}"] = 0.0 if isinstance(value, float) else [0.0, 0.0, 0.0]
        elif own and not wanted_dark:
            changes |= {path: dark.pop(path) for path in own}
    return Turn(replace(dials, dark=dark, mute=muted, solo=alone), changes)


# The light of each lamp apart: how bright each group is shown, of one film.

_GAINS = [0.0, *(2.0 ** (step / 3) for step in range(-18, 19))]  # thirds of a stop, and none
APART, GROUP = "mix", "mix_"  # the dial that keeps lamps apart; those of groups are mix_a, mix_b, in their order


def mix_entries(panel: Panel, groups: Sequence[str]) -> list[dict[str, Any]]:
    """The dials that keep the light of lamps apart and mix it, as pages draw them."""
    on = "lights" in panel.scene.render.layers
    common: dict[str, Any] = {"enabled": True, "linked": None, "unit": ""}
    apart = {"name": APART, "label": "keep lamps apart", "kind": "bool", "value": on, "text": ""}
    entries: list[dict[str, Any]] = [apart | common]
    for place, group in enumerate(groups):
        gain = panel.dials.mix.get(group, 1.0)
        entries.append({
            "name": f"{GROUP}{chr(ord('a') + place)}", "label": group.replace("_", " "), "kind": "number",
            "value": gain, "text": f"× {gain:.3g}", "min": 0.0, "max": _GAINS[-1], "steps": _GAINS, **common,
        })  # fmt: skip
    return entries


def turn_mix(panel: Panel, groups: Sequence[str], name: str, value: Any, together: Sequence[str]) -> Turn:
    """Keep the light of lamps apart, or no longer, or choose how bright a group of them is shown.

    Parameters
    ----------
    groups
        Whose light is kept apart by now.
    together
        What the picture has of all lamps together, which is left out meanwhile: diffraction, ghosts.

    Raises
    ------
    InputError
        There is no such group, or the value is not one of its kind.
    """
    scene, dials, layers = panel.scene, panel.dials, panel.scene.render.layers
    if name == APART:
        if not isinstance(value, bool):
            raise InputError(f"{name}: must be true or false (got {str(value)[:40]!r})")
        if value == ("lights" in layers):
            return panel.same()
        if not value:
            before = dials.unmixed or {"render.layers": [each for each in layers if each != "lights"]}
            return Turn(replace(dials, mix={}, unmixed={}), before)
        keys: dict[str, Any] = {"render.layers": [*layers, "lights"], **{f"camera.{what}": "off" for what in together}}
        unmixed: dict[str, Any] = {}
        for path in keys:
            section, _, key = path.partition(".")
            unmixed[path] = _data(scene, section).get(key) if scene.made_of.get(section) is not None else None
        groups_of = {f"objects.{index}.group": name for index, name in _common_groups(scene, dials.dark)}
        keys, unmixed = keys | groups_of, unmixed | dict.fromkeys(groups_of)
        left_out = (f"left out while lamps are kept apart: {' and '.join(together)}",) if together else ()
        return Turn(replace(dials, mix={}, unmixed=unmixed), keys, left_out)
    place = ord(name.removeprefix(GROUP)[:1] or "a") - ord("a")
    if len(name) != len(GROUP) + 1 or not 0 <= place < len(groups):
        raise InputError(f"{name}: there is no such group of lamps (allowed: {len(groups)} kept apart)")
    if together:
        raise InputError(f"{name}: {together[0]} is light of all lamps together (allowed: camera.{together[0]}: off)")
    gain = min(max(number(name, value), 0.0), _GAINS[-1])
    messages = () if gain == value else (f"lamps are mixed from 0 to {_GAINS[-1]:g} times their light",)
    return Turn(replace(dials, mix={**dials.mix, groups[place]: gain}), {}, messages)


def _common_groups(scene: Scene, dark: Mapping[str, Any]) -> Iterator[tuple[int, str]]:
    """Name a group for objects that are one lamp in the list of lamps: by their material, where they have no name."""
    for path, users in _shining(scene, dark).items():
        for index in users:
            item, is_one = scene.objects[index], len(users) > 1 or scene.objects[index].name is None
            if item.group is None and is_one and path.startswith("materials."):
                yield index, re.sub(r"[^A-Za-z0-9_-]", "_", path.split(".", 1)[1])


def _switch_name(names: frozenset[str], name: str, on: bool | None) -> frozenset[str]:
    return names if on is None else names | {name} if on else names - {name}


def things_message(panel: Panel, selected: str | None) -> dict[str, Any]:
    """What clients hear of it."""
    return {
        "selected": selected,
        "title": None if selected is None else _title_of(panel.scene, selected),
        "lamps": lamps_of(panel),
    }


# The scene's data and models by key path.


def _given_value(scene: Scene, index: int, key: str) -> Any:
    """What the scene file says of an object; nothing of one made in Python."""
    item = scene.made_of["objects"][index]
    return item.get(key) if isinstance(item, Mapping) else None


def _data(scene: Scene, path: str) -> dict[str, Any]:
    found: Any = scene.made_of
    for key in key_path(path):
        found = found[key]
    if not isinstance(found, Mapping):  # made in Python
        found = found.model_dump(mode="json", exclude_unset=True)
    return dict(plain(found))


def _model(scene: Scene, path: str) -> Any:
    found: Any = scene
    for key in key_path(path):
        found = found[key] if isinstance(key, int) or isinstance(found, Mapping) else getattr(found, key)
    return found


def _setter(path: str) -> Callable[[Any], dict[str, Any]]:
    return lambda value: {path: value}


def _is_rgb(value: Any) -> bool:
    return isinstance(value, tuple) and len(value) == 3 and all(isinstance(each, int | float) for each in value)


# Moves of the camera: what a drag or a key does to eye, target and up.

Vector = NDArray[np.float64]
ORBIT = math.pi  # radians that a drag across the whole picture turns the camera about its target
ROLL = math.radians(10)  # a step of roll
DOLLY = 0.05  # share of the distance in focus that a step towards it takes away
_WALK = 0.02  # share of the distance in focus that a step is long
_WIDE = 1.0  # width at distance 1 where no field angle says: of cameras that see all around
_NEAREST_POLE = math.radians(1.0)  # between the view and up


@dataclass(frozen=True)
class Viewpoint:
    """Where a camera is and how it sees, in scene units.

    Attributes
    ----------
    eye, target, up : (3,) array
    distance : float
        From the eye to the plane in focus along the axis.
    field : float
        Width of that plane that the picture shows.
    aspect : float
        Height of the picture over its width.
    """

    eye: Vector
    target: Vector
    up: Vector
    distance: float
    field: float
    aspect: float

    def changes(self, before: Viewpoint) -> dict[str, list[float]]:
        """Return the keys of the scene that bring a camera here from where it was."""
        pairs = {
            "eye": (before.eye, self.eye), "target": (before.target, self.target), "up": (before.up, self.up),
        }  # fmt: skip
        return {f"camera.{name}": new.tolist() for name, (old, new) in pairs.items() if not np.array_equal(old, new)}


def viewpoint_of(scene: Scene) -> Viewpoint:
    """Return where the camera of a scene is when the shutter opens, which is in focus."""
    camera = scene.camera
    eye, target, up = camera.pose_at(scene.shutter.open_s)
    distance = distance_in_focus(scene)
    if distance is None or not math.isfinite(distance):
        distance = float(np.linalg.norm(target - eye))
    width, height = scene.film.size_m()
    return Viewpoint(eye, target, up, distance, field_at_one(scene) * distance, height / width)


def field_at_one(scene: Scene) -> float:
    """Return the width of what the picture shows at distance 1, first-order, of a scene in focus."""
    camera = scene.camera
    width, height = scene.film.size_m()
    if camera.field_of_view is not None:
        degrees, axis = camera.field_of_view
        across = 2 * math.tan(math.radians(degrees) / 2)
        sides = {"horizontal": width, "vertical": height, "diagonal": math.hypot(width, height)}
        return across * width / sides[axis]
    focal_length_mm = None if (lens := camera.lens_camera or camera.ideal_lens) is None else lens.focal_length_mm
    if focal_length_mm is None and camera.lens_camera is not None:
        focal_length_mm = scene.load_lens().first_order().focal_length_mm
    return _WIDE if focal_length_mm is None else width / abs(focal_length_mm * 1e-3)


def distance_in_focus(scene: Scene) -> float | None:
    """Return how far in front of the eye the plane in focus lies [scene units]; None where that is not known."""
    return scene.camera.distance_in_focus(scene.metres_per_unit)


def moved(stand: Viewpoint, kind: str, dx: float, dy: float, dz: float) -> Viewpoint:
    """Return where a camera is after a move; see docs/viewfinder.md for what dx, dy and dz are in each kind."""
    return _MOVES[kind](stand, dx, dy, dz)


def _axes(stand: Viewpoint) -> tuple[Vector, Vector, Vector]:
    """Return right, up and forward of the camera."""
    matrix = pose_matrix(np.array([stand.eye, stand.target, stand.up]))
    return matrix[:3, 0], matrix[:3, 1], -matrix[:3, 2]


def _rotate(vector: Vector, axis: Vector, angle: float) -> Vector:
    """Return a vector turned about a unit axis (Rodrigues)."""
    sine, cosine = math.sin(angle), math.cos(angle)
    along = axis * float(axis @ vector)
    return np.asarray(cosine * vector + sine * np.cross(axis, vector) + (1 - cosine) * along)


def _turn_view(stand: Viewpoint, view: Vector, yaw: float, pitch: float) -> Vector:
    """Return a view turned about up by ``yaw`` and raised by ``pitch``, kept away from the poles."""
    upright = stand.up / np.linalg.norm(stand.up)
    level = math.asin(max(-1.0, min(1.0, float(view @ upright) / float(np.linalg.norm(view)))))
    limit = math.pi / 2 - _NEAREST_POLE
    if abs(level) < limit:
        pitch = max(-limit, min(limit, level + pitch)) - level
    elif pitch * level > 0:  # a camera that looks along up already comes back, and goes no further
        pitch = 0.0
    right = np.cross(view, upright)
    right /= np.linalg.norm(right)
    return _rotate(_rotate(view, right, pitch), upright, yaw)


def _orbit(stand: Viewpoint, dx: float, dy: float, dz: float) -> Viewpoint:
    view = _turn_view(stand, stand.target - stand.eye, -ORBIT * dx, -ORBIT * dy * stand.aspect)
    return replace(stand, eye=stand.target - view)


def _tilt(stand: Viewpoint, dx: float, dy: float, dz: float) -> Viewpoint:
    across = 2 * math.atan(0.5 * stand.field / stand.distance)
    view = _turn_view(stand, stand.target - stand.eye, across * dx, across * stand.aspect * dy)
    return replace(stand, target=stand.eye + view)


def _roll(stand: Viewpoint, dx: float, dy: float, dz: float) -> Viewpoint:
    _, up, forward = _axes(stand)
    return replace(stand, up=_rotate(up, forward, ROLL * dx))


def _shift(stand: Viewpoint, step: Vector) -> Viewpoint:
    return replace(stand, eye=stand.eye + step, target=stand.target + step)


def _pan(stand: Viewpoint, dx: float, dy: float, dz: float) -> Viewpoint:
    right, up, _ = _axes(stand)
    return _shift(stand, stand.field * (-dx * right + dy * stand.aspect * up))


def _walk(stand: Viewpoint, dx: float, dy: float, dz: float) -> Viewpoint:
    right, _, forward = _axes(stand)
    upright = stand.up / np.linalg.norm(stand.up)
    return _shift(stand, _WALK * stand.distance * (dx * right + dy * forward + dz * upright))


def _dolly(stand: Viewpoint, dx: float, dy: float, dz: float) -> Viewpoint:
    _, _, forward = _axes(stand)
    reach = stand.distance * (1 - (1 - DOLLY) ** dy)
    eye = stand.eye + reach * forward
    left = float((stand.target - eye) @ forward)
    # the target stays where it is, unless the camera would pass it
    target = stand.target if left > 1e-3 * stand.distance else stand.target + reach * forward
    return replace(stand, eye=eye, target=target)


_MOVES = {"orbit": _orbit, "tilt": _tilt, "roll": _roll, "pan": _pan, "walk": _walk, "dolly": _dolly}
