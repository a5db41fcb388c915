"""The data of a new scene: film and camera, lights and surroundings, the model or three balls in its place."""

from __future__ import annotations

import math
from dataclasses import field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes import GltfCamera, GltfLight
from rptcam_cl.assets.pictures import read_picture
from rptcam_cl.cameras import LensSetting, lens_setting
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.importers.starting.copies import Copies
from rptcam_cl.importers.starting.framing import Framing, Projection, View
from rptcam_cl.importers.starting.stage import balls, studio
from rptcam_cl.importers.starting.subject import Subject, read_subject
from rptcam_cl.optics import film_distance, image_circle, load_lens, names_a_file
from rptcam_cl.scene import load_scene

Array = NDArray[np.float64]

UP: dict[str, tuple[float, float, float]] = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
FULL_FRAME_MM = 43.2666  # diagonal of 36 x 24
DEFAULT_LENS = "dgauss-50mm"
LUMENS_PER_WATT = 683.0  # KHR_lights_punctual counts candelas and lux, a scene watts
MOST_OPEN = 2.8  # f-number of a first picture, or the widest of a slower lens
FAR_M = 1e6
FOCUSINGS = 5  # in which the entrance pupil comes to rest where it is wanted; each leaves a tenth of the way at most
PLAIN = {"kind": "plastic", "reflectance": 0.5, "roughness": 0.4}  # of a model whose file has no material
ROUND_TO = 6  # digits
PLAUSIBLE = (0.01, 20.0)  # [m], the longest side of what one takes a picture of
UNITS = (
    0.001,
    0.01,
    100.0,
    1000.0,
)  # what models are wrong by: millimetres and centimetres taken for metres, or twice so


@dataclass(frozen=True)
class Wishes:
    """What a new scene is to hold.

    Attributes
    ----------
    model, hdri : Path or None
    lens : str or None
        A name of the library, or a file; None leaves it to a glTF camera, else it is a double Gauss.
    size : (width, height)
        Of the picture [pixels].
    up : str or None
        Axis of the model that points upwards: x, y or z; None is z for STL files, else y.
    metres_per_unit : float
        Length of a unit of the model [m].
    reframe : bool
        Whether a camera of the model's file does not count.
    """

    model: Path | None = None
    hdri: Path | None = None
    lens: str | None = None
    size: tuple[int, int] = (960, 640)
    up: str | None = None
    metres_per_unit: float = 1.0
    reframe: bool = False


@dataclass
class Start:
    """A new scene, not yet written.

    Attributes
    ----------
    scene : dict
        Its data.
    copies : Copies
        Files that are to lie beside it.
    report : list of str
        What was chosen and what is left out, a sentence each.
    """

    scene: dict[str, Any]
    copies: Copies
    report: list[str] = field(default_factory=list)


def starting_scene(wishes: Wishes, folder: Path) -> Start:
    """Return a scene that shows a model framed, lit, focused and exposed.

    Parameters
    ----------
    wishes
        What to show, and by what light and lens.
    folder
        Where the scene file is to lie.

    Raises
    ------
    InputError
        When the model, the picture or the lens cannot be used, or not be copied to the folder.
    """
    return _Stage(wishes, folder).scene()


class _Stage:
    """The parts of a new scene, one after the other."""

    def __init__(self, wishes: Wishes, folder: Path) -> None:
        self._wishes = wishes
        self._start = Start({"metres_per_unit": wishes.metres_per_unit}, Copies(folder))
        self._subject = balls() if wishes.model is None else read_subject(wishes.model)
        stl = wishes.model is not None and wishes.model.suffix.lower() == ".stl"
        self._up = np.array(UP[wishes.up or ("z" if stl else "y")], dtype=float)

    def scene(self) -> Start:
        """Return the scene."""
        start, subject, wishes = self._start, self._subject, self._wishes
        start.report += subject.notes
        if wishes.model is not None:
            start.report += _doubts_of_size(subject, wishes.metres_per_unit)
        camera = None if wishes.reframe or not subject.cameras else subject.cameras[0]
        width, height = wishes.size
        if camera is not None and camera.aspect is not None:
            height = max(1, round(width / camera.aspect))
        start.scene["film"] = {"resolution": [width, height]}
        if camera is None:
            self._framed()
        else:
            self._by_file(camera)
        start.scene["exposure"] = {"mode": "auto"} | ({} if wishes.hdri or subject.lights else {"ev": 0.5})
        start.scene["render"] = {"spp": 256, "max_depth": 8}
        self._lit()
        self._shown()
        return start

    def _lens_key(self) -> str:
        lens = self._wishes.lens or DEFAULT_LENS
        if not names_a_file(lens):
            load_lens(lens)  # which says which names there are
            return lens
        name = self._start.copies.name_of(Path(lens))
        return name if names_a_file(name) else f"./{name}"

    def _film_mm(self, lens: str, height_mm: float | None = None) -> tuple[float, float]:
        """Set a film of full frame, or as large as the image circle lets it be; return its sides."""
        width, height = self._start.scene["film"]["resolution"]
        found = load_lens(Path(lens) if names_a_file(lens) else lens)
        diagonal = FULL_FRAME_MM if height_mm is None else height_mm * math.hypot(width, height) / height
        circle = 2 * image_circle(found, film_distance(found, np.inf))
        if diagonal > circle:
            diagonal = math.floor(circle * 100) / 100
            self._start.report.append(f"the film has a diagonal of {diagonal:g} mm, the image circle of {found.name}")
        self._start.scene["film"]["diagonal_mm"] = round(diagonal, 4)
        return diagonal * width / math.hypot(width, height), diagonal * height / math.hypot(width, height)

    def _camera(self, lens: str, view: View, target: Array, depth: float) -> dict[str, Any]:
        """Return the keys of a lens camera focused at a depth ahead of it."""
        keys: dict[str, Any] = {"kind": "realistic", "lens": lens}
        found = load_lens(self._lens_source(lens))
        widest = found.first_order().f_number
        if found.stop is not None and widest < MOST_OPEN:
            keys["f_number"] = MOST_OPEN
        pose = {"eye": _rounded(view.eye), "target": _rounded(target), "up": _rounded(self._up)}
        return keys | pose | {"focus": {"distance_m": _digits(depth * self._wishes.metres_per_unit)}}

    def _lens_source(self, lens: str) -> str | Path:
        return Path(self._wishes.lens) if self._wishes.lens and names_a_file(self._wishes.lens) else lens

    def _framed(self) -> None:
        lens, subject, unit = self._lens_key(), self._subject, self._wishes.metres_per_unit
        film = self._film_mm(str(self._lens_source(lens)))

        def set_lens(view: View, depth: float) -> LensSetting:
            return self._set(lens, view, depth)

        framing = Framing(subject.points, _three_quarters(self._up), self._up, film, set_lens, unit)
        view = framing.view()
        ahead = float((framing.target - view.eye) @ view.forward)
        depth = subject.first_hit(view.eye, view.forward) or ahead
        try:
            set_lens(view, depth)
        except InputError:  # the front is nearer than the lens focuses
            depth = ahead
        self._start.scene["camera"] = self._camera(lens, view, framing.target, depth)
        self._start.report.append(
            f"the model is {_size(subject, unit)}; it fills {framing.share:.0%} of the frame from {depth * unit:.3g} m"
        )

    def _set(self, lens: str, view: View, depth: float) -> LensSetting:
        """Return the lens focused at a depth ahead of the middle of the film."""
        source = self._lens_source(lens)
        camera = self._camera(str(source), view, view.eye + view.forward, depth)
        if isinstance(source, Path):
            camera["lens"] = source.name
            return lens_setting(load_scene({"camera": camera}, base_dir=source.resolve().parent))
        return lens_setting(load_scene({"camera": camera}))

    def _by_file(self, camera: GltfCamera) -> None:
        """Take the camera of the model's file: its field of view through the lens, or as a thin lens."""
        if others := ", ".join(other.name for other in self._subject.cameras[1:]):
            self._start.report.append(f"other cameras of the file are left out: {others}")
        eye, forward = np.array(camera.eye), np.array(camera.forward)
        unit = self._wishes.metres_per_unit
        right = np.cross(forward, camera.up)
        view = View(eye, forward, right / np.linalg.norm(right), np.array(camera.up))
        ahead = self._subject.first_hit(eye, forward)
        if ahead is None:
            depths = view.seen(self._subject.points)[:, 2]
            ahead = float(np.median(depths[depths > 0])) if (depths > 0).any() else 5.0 / unit
        degrees = math.degrees(camera.height_radians)
        if self._wishes.lens is None:
            pose = {"eye": _rounded(eye), "target": _rounded(eye + ahead * forward), "up": list(camera.up)}
            self._start.scene["film"]["diagonal_mm"] = FULL_FRAME_MM
            self._start.scene["camera"] = {
                "kind": "thin_lens",
                **pose,
                "fov_degrees": _digits(degrees),
                "fov_axis": "vertical",
                "f_number": MOST_OPEN,
                "focus_distance_m": _digits(ahead * unit),
            }
            self._start.report.append(f"the camera is {camera.name} of the file, as a thin lens at f/{MOST_OPEN}")
            return
        lens = self._lens_key()
        try:
            back, scale = self._behind(lens, view, ahead)
        except InputError as problem:
            raise InputError(f"{camera.name} of the file: {problem} (allowed: another lens, or --reframe)") from None
        self._film_mm(str(self._lens_source(lens)), 2 * scale * math.tan(camera.height_radians / 2))
        there = replace(view, eye=eye - back * forward)
        self._start.scene["camera"] = self._camera(lens, there, eye + ahead * forward, ahead + back)
        self._start.scene["camera"]["up"] = list(camera.up)
        self._start.report.append(
            f"the camera is {camera.name} of the file, {degrees:.3g} degrees high; the film fits that through {lens}"
        )

    def _behind(self, lens: str, view: View, ahead: float) -> tuple[float, float]:
        """Return how far behind a view's eye the film is whose entrance pupil is there, and the scale of the picture.

        Lengths are scene units, the scale is that of `Projection`, upwards. The plane in focus lies ahead of the eye.
        """
        unit = self._wishes.metres_per_unit
        depth = FAR_M / unit  # at first, as a lens may focus no nearer than where its film will be
        for _ in range(FOCUSINGS):
            projection = Projection(self._set(lens, view, depth), unit, 1.0)
            back = (projection.length_mm - float(projection.pupils_mm[1])) * 1e-3 / unit
            depth = ahead + back
        return back, float(projection.scales_mm[1])

    def _lit(self) -> None:
        scene, wishes, lights = self._start.scene, self._wishes, self._subject.lights
        if lights:
            scene["lights"] = [_light(light) for light in lights]
            self._start.report.append(f"{len(lights)} lamp{'s' if len(lights) > 1 else ''} of the file")
        if wishes.hdri is not None:
            name = self._start.copies.name_of(wishes.hdri)
            try:
                read_picture(wishes.hdri)
            except (InputError, StateError) as problem:
                raise type(problem)(f"{wishes.hdri}: {problem}") from None
            scene["environment"] = {"kind": "image", "file": name, "up": _rounded(self._up)}
        elif not lights:
            eye = np.array(scene["camera"]["eye"], dtype=float)
            scene |= studio(self._subject.bounds, eye, self._up)

    def _shown(self) -> None:
        scene, wishes, subject = self._start.scene, self._wishes, self._subject
        if wishes.model is None:
            scene["objects"] = [*subject.objects, *scene.get("objects", [])]
            return
        keys: dict[str, Any] = {"name": "model", "shape": "mesh", "file": self._start.copies.name_of(wishes.model)}
        self._start.copies.add_companions(wishes.model, subject.files)
        if subject.bare:
            keys["material"] = "model"
            scene["materials"] = {"model": PLAIN, **scene.get("materials", {})}
        scene["objects"] = [keys, *scene.get("objects", [])]


def _three_quarters(up: Array) -> Array:
    """Return the direction to a camera that sees front and one side, a little from above."""
    front = np.array([0, 0, 1.0]) if up[2] == 0 else np.array([0, -1.0, 0])
    side = np.cross(up, front)
    return np.asarray(front + 0.45 * side + 0.25 * up)


def _light(light: GltfLight) -> dict[str, Any]:
    amount = [_digits(value / LUMENS_PER_WATT) for value in light.amount]
    if light.kind == "directional":
        return {"kind": "directional", "direction": _rounded(np.array(light.forward)), "irradiance": amount}
    keys = {"kind": light.kind, "position": _rounded(np.array(light.eye)), "intensity": amount}
    if light.kind == "point":
        return keys
    inner, outer = (_digits(math.degrees(angle)) for angle in light.cone_radians)
    return keys | {"direction": _rounded(np.array(light.forward)), "inner_degrees": inner, "outer_degrees": outer}


def _size(subject: Subject, unit: float) -> str:
    low, high = subject.bounds
    return " x ".join(f"{side * unit:.3g}" for side in high - low) + " m"


def _doubts_of_size(subject: Subject, unit: float) -> list[str]:
    """Return what to say of a model that nobody would photograph at that size, so that its unit must be another."""
    low, high = subject.bounds
    size = float((high - low).max()) * unit
    if size == 0 or PLAUSIBLE[0] <= size <= PLAUSIBLE[1]:
        return []
    factors = [factor for factor in UNITS if PLAUSIBLE[0] <= size * factor <= PLAUSIBLE[1]]
    factors = factors or [10.0 ** -math.floor(math.log10(size))]
    ways = " or ".join(f"--metres-per-unit {unit * factor:g} (then {length(size * factor)})" for factor in factors)
    return [f"hint: the model is {length(size)} long; if that is not its true size, say {ways}"]


def length(metres: float) -> str:
    """Return a length in words, in millimetres below a tenth of a metre."""
    return f"{metres:.3g} m" if metres >= 0.1 else f"{1000 * metres:.3g} mm"


def _digits(value: float) -> float:
    return float(f"{value:.{ROUND_TO}g}")


def _rounded(vector: Array) -> list[float]:
    return [_digits(value) for value in vector.tolist()]
