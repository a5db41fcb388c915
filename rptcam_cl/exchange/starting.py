"""A first scene round a model: framed, lit, focused and exposed, to be changed from there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import Folders, name_errors, named_files, read_whole, replacing
from rptcam_cl.exchange.conversion import LARGEST_COPY
from rptcam_cl.optics import beams, irradiance
from rptcam_cl.optics.lens import film_distance
from rptcam_cl.optics.library import load_lens, names_a_file
from rptcam_cl.rendering.cameras.setting import LensSetting, lens_setting
from rptcam_cl.scene.assets.gltf import GltfCamera, read_gltf_world
from rptcam_cl.scene.assets.mesh import LAMPS_LEFT_OUT, MeshPlacement
from rptcam_cl.scene.assets.pictures import read_picture
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.meshes import GLTF, read_mesh_file

# Files that a new scene names: those elsewhere are copied beside it, because a scene reads its own folder only.


@dataclass
class CopiedFiles:
    """Where the files of a new scene are to lie.

    Attributes
    ----------
    folder : Path
        Of the scene.
    pending : dict
        What is to be copied: the target, and the file that it comes from.
    """

    folder: Path
    pending: dict[Path, Path] = field(default_factory=dict)

    def name_of(self, path: Path) -> str:
        """Return the name by which the scene reads a file, which is copied if it lies elsewhere.

        Raises
        ------
        InputError
            When there is no such file.
        """
        real, home = _check_file(path), self.folder.resolve()
        if real.is_relative_to(home):
            return real.relative_to(home).as_posix()
        self._add(real, home / real.name)
        return real.name

    def add_companions(self, path: Path, named: Iterable[Path]) -> None:
        """Let further files follow one that is copied: those that it names, at the same places beside it."""
        real, home = path.resolve(), self.folder.resolve()
        if real.is_relative_to(home):
            return
        for other in sorted(set(named)):
            if other != real and other.is_file() and other.is_relative_to(real.parent):
                self._add(other, home / other.relative_to(real.parent))

    def _add(self, source: Path, target: Path) -> None:
        if self.pending.get(target, source) != source:
            raise InputError(
                f"{source} and {self.pending[target]} have one name; copy them into {self.folder} yourself"
            )
        if target.exists() and not (target.is_file() and _content(target) == _content(source)):
            raise InputError(
                f"{source}: a scene reads its own folder only, and another {target.name} is there already "
                f"(got {target}; allowed: a model in the scene's folder, or a folder without that file)"
            )
        self.pending[target] = source

    def write(self) -> list[Path]:
        """Copy what is not there yet, and return it."""
        written = [target for target in self.pending if not target.exists()]
        for target in written:
            content = _content(self.pending[target])
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
            except OSError as problem:
                raise StateError(f"{target.parent}: cannot be made ({problem.strerror})") from None
            with replacing(target) as temporary:
                temporary.write_bytes(content)
        return written


def _content(path: Path) -> bytes:
    with name_errors(path):
        return read_whole(path, LARGEST_COPY)


def _check_file(path: Path) -> Path:
    """Return the real path of a file; refuse what is none."""
    real = path.resolve()
    if not real.is_file():
        raise InputError(f"{path}: {'is not a regular file' if real.exists() else 'no such file'}")
    return real


# What a new scene shows: the points of a model, what its file says of cameras and lamps, and what a ray meets.

Array = NDArray[np.float64]
_MOST_POINTS = 20_000  # of a part, which say how large it looks to a hundredth of a per cent


@dataclass(frozen=True)
class ShownModel:
    """What is to be shown.

    Attributes
    ----------
    points : (n, 3) array
        Vertices, in scene units; of large meshes some of them, the outermost of each axis included.
    triangles : (m, 3, 3) array
        Corners of the triangles.
    cameras, lights : list
        Of a glTF file.
    notes : tuple of str
        What of the file is left out.
    files : frozenset of Path
        Files that were read.
    bare : bool
        Whether the file says nothing of its material.
    objects : tuple of dict
        Objects of a scene that are it, where no file is.
    """

    points: Array
    triangles: Array
    cameras: list[GltfCamera]
    lights: list[dict[str, Any]]
    notes: tuple[str, ...] = ()
    files: frozenset[Path] = frozenset()
    bare: bool = False
    objects: tuple[dict[str, Any], ...] = ()

    @property
    def bounds(self) -> tuple[Array, Array]:
        """The lowest and the highest corner."""
        return self.points.min(axis=0), self.points.max(axis=0)

    def first_hit(self, origin: Array, direction: Array) -> float | None:
        """Return how far along a ray its first triangle is (Möller and Trumbore 1997), None where it meets none."""
        first, along = self.triangles[:, 0], self.triangles[:, 1:] - self.triangles[:, :1]
        across = np.cross(direction, along[:, 1])
        scale = np.einsum("ij,ij->i", along[:, 0], across)
        with np.errstate(all="ignore"):
            away = origin - first
            u = np.einsum("ij,ij->i", away, across) / scale
            turned = np.cross(away, along[:, 0])
            v = turned @ direction / scale
            distance = np.einsum("ij,ij->i", along[:, 1], turned) / scale
            met = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
        return float(distance[met].min()) if met.any() else None


def _read_subject(path: Path, time_s: float | None = None) -> ShownModel:
    """Read the subject of a mesh file, one of glTF at a time.

    Raises
    ------
    InputError
        When it cannot be used as an object of a scene.
    """
    real = _check_file(path)
    folders = Folders(real.parent, owner="model")
    with named_files() as files:
        find = folders.find_beside(real)
        contents = read_mesh_file(real, find, time_s=time_s)
        cameras, lights, left_out = read_gltf_world(real, find, time_s) if real.suffix.lower() in GLTF else ([], [], [])
        bare = any(part.material is None for part in contents.parts)
        missing = () if bare else _missing_pictures(real)
    points, triangles = zip(*map(_place_part, contents.parts), strict=True)
    return ShownModel(
        points=_fewer(np.concatenate(points)),
        triangles=np.concatenate(triangles),
        cameras=cameras,
        lights=lights,
        notes=(*(note for note in contents.notes if not note.endswith(LAMPS_LEFT_OUT)), *left_out, *missing),
        files=frozenset(files),
        bare=bare,
    )


def _missing_pictures(path: Path) -> tuple[str, ...]:
    """Return which pictures of a model's materials are missing; those that are there become known as named files."""
    camera = {"kind": "pinhole", "eye": [0, 0, 1], "target": [0, 0, 0], "fov_degrees": 40}
    shown = {"camera": camera, "objects": [{"shape": "mesh", "file": path.name}]}
    return load_scene(shown, base_dir=path.parent, missing="grey").stand_ins


def _place_part(part: MeshPlacement) -> tuple[Array, Array]:
    """Return points and triangles of a part in the frame of its file."""
    mesh = part.mesh
    vertices = (mesh.positions + mesh.origin) @ part.placement[:3, :3].T + part.placement[:3, 3]
    used = vertices[np.unique(mesh.faces)]
    return _fewer(used), vertices[mesh.faces]


def _fewer(points: Array) -> Array:
    """Return at most `_MOST_POINTS` of many points, and the outermost of each axis."""
    ends = points[np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])]
    return np.concatenate([points[:: 1 + len(points) // _MOST_POINTS], ends])


# What stands in where nothing is given: three balls for a model, a floor and a soft box for a picture of light.

_BALLS = (
    ((-0.24, 0.1, 0.0), {"kind": "plastic", "reflectance": [0.5, 0.06, 0.04], "roughness": 0.3}),
    ((0.0, 0.1, 0.08), {"kind": "dielectric", "index": 1.5}),
    ((0.24, 0.1, 0.0), {"kind": "conductor", "metal": "gold", "roughness": 0.2}),
)
_RADIUS = 0.1


def _balls() -> ShownModel:
    """Return three balls on y = 0: glossy, glass and gold."""
    turns = np.linspace(0, 2 * np.pi, 33)[:-1]
    rings = np.concatenate(
        [
            _RADIUS
            * np.column_stack([np.sin(a) * np.cos(turns), np.cos(a) * np.ones_like(turns), np.sin(a) * np.sin(turns)])
            for a in np.linspace(0, np.pi, 17)
        ]
    )
    points = np.concatenate([rings + center for center, _ in _BALLS])
    objects = tuple({"shape": "sphere", "center": list(at), "radius": _RADIUS, "material": made} for at, made in _BALLS)
    return ShownModel(points, np.empty((0, 3, 3)), [], [], objects=objects)


def _studio(bounds: tuple[Array, Array], eye: Array, up: Array) -> dict[str, Any]:
    """Return surroundings of even light, a floor below the subject and a soft box beside the camera."""
    low, high = bounds
    size, middle = float(np.linalg.norm(high - low)) or 1.0, (low + high) / 2
    flat = (eye - middle) * (1 - up)
    if not flat.any():  # straight above the subject or below it no side is in front
        flat = np.roll(up, 1)
    front = flat / np.linalg.norm(flat)
    left = np.cross(front, up)
    floor = middle * (1 - up) + low * up - 1e-3 * size * up
    lamp = middle + size * (1.1 * front + 1.3 * left + 1.4 * up)
    return {
        "environment": {"kind": "gradient", "bottom": 0.25, "top": 0.6, "up": up.tolist()},
        "materials": {
            "floor": {"kind": "matte", "reflectance": 0.45},
            "soft box": {"kind": "emissive", "radiance": [9, 8.4, 7.6]},
        },
        "objects": [
            {"name": "floor", "shape": "plane", "point": _short(floor), "normal": up.tolist(), "material": "floor"},
            {
                "name": "soft box", "shape": "disk", "center": _short(lamp), "normal": _short((middle - lamp) / size),
                "radius": float(f"{0.45 * size:.4g}"), "material": "soft box",
            },
        ],
    }  # fmt: skip


def _short(vector: Array) -> list[float]:
    return [float(f"{value:.4g}") for value in vector.tolist()]


# Where a camera stands so that a subject fills a share of its film, through the lens that it has.

Vector = tuple[float, float, float]

_FILL = 2 / 3  # of the film's width or height, whichever the subject fills more of
_HEIGHTS = 65  # chief rays between the axis and the corner of the film
_FEWEST = 4  # of them that must pass the lens
_ROUNDS = 60
_CLOSE_ENOUGH = 2e-3  # relative, of the share that is filled


@dataclass(frozen=True)
class CameraAxes:
    """A camera in scene units; `forward`, `right` and `up` are unit vectors at right angles."""

    eye: Array
    forward: Array
    right: Array
    up: Array

    @classmethod
    def towards(cls, target: Array, direction: Array, distance: float, up: Array) -> CameraAxes:
        """Return the view from a place that lies in a direction from what it looks at."""
        forward = -direction / np.linalg.norm(direction)
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        return cls(target - distance * forward, forward, right, np.cross(right, forward))

    def seen(self, points: Array) -> Array:
        """Return points (n, 3) as (right, up, depth) from the eye."""
        return np.asarray((points - self.eye) @ np.stack([self.right, self.up, self.forward], axis=1))


# From a view and the depth of the plane in focus to the lens of the camera there.
_SetLens = Callable[[CameraAxes, float], LensSetting]


class Projection:
    """Where chief rays of a focused lens put points of the scene on its film.

    Rays are traced through a lens that is the same on all sides, so that distortion counts. Others go by first order.

    Parameters
    ----------
    setting : LensSetting
    metres_per_unit : float
    corner_mm : float
        From the middle of the film to its corner.

    Attributes
    ----------
    length_mm : float
        From the first vertex to the film.
    pupils_mm : (2,) array
        From the first vertex to the entrance pupil, across and up.
    scales_mm : (2,) array
        On the film per unit of the tangent from there, on the axis.
    """

    def __init__(self, setting: LensSetting, metres_per_unit: float, corner_mm: float) -> None:
        lens, back = setting.lens, setting.film_distance_mm
        self._unit_mm = metres_per_unit * 1e3
        self.length_mm = lens.length + lens.sense * back  # from the first vertex to the film
        self.pupils_mm, self.scales_mm = np.transpose([_perspective(setting, section) for section in "xy"])
        self._heights = np.linspace(0, 1.2 * corner_mm, _HEIGHTS)
        self._rays = _chief_rays(setting, self._heights)

    def film_mm(self, seen: Array) -> Array:
        """Return the places (n, 2) on an upright film [mm] of points as a view sees them; infinite behind the lens."""
        depth = seen[:, 2] * self._unit_mm - self.length_mm
        across = seen[:, :2] * self._unit_mm
        if self._rays is None:
            ahead = depth[:, None] + self.pupils_mm
            with np.errstate(all="ignore"):
                return np.where((ahead > 0).all(axis=1, keepdims=True), across / ahead * self.scales_mm, np.inf)
        radius = np.hypot(across[:, 0], across[:, 1])
        starts, slopes = self._rays
        reached = starts + slopes * depth[:, None]
        cell = np.clip((reached < radius[:, None]).sum(axis=1), 1, len(slopes) - 1)
        rows = np.arange(len(depth))
        low, high = reached[rows, cell - 1], reached[rows, cell]
        height = self._heights[cell - 1] + (radius - low) / (high - low) * self._heights[1]
        height[(depth <= 0) | (radius > high)] = np.inf
        with np.errstate(all="ignore"):
            return np.where(radius[:, None] > 0, across * (height / radius)[:, None], 0.0)

    def bounds_mm(self, seen: Array) -> tuple[Array, Array]:
        """Return the lowest and the highest place on the film of points as a view sees them.

        Raises
        ------
        InputError
            When the lens does not see all of them.
        """
        image = self.film_mm(seen)
        if not np.isfinite(image).all():
            raise InputError("is wider than the lens sees")
        return image.min(axis=0), image.max(axis=0)


def _perspective(setting: LensSetting, section: str) -> tuple[float, float]:
    """Return how far behind the first vertex the entrance pupil lies, and what a unit of the tangent from there is on
    the film [mm], to first order: chief rays leave the exit pupil flatter by the ratio of the pupils (Lagrange)."""
    lens, back, wavelength = setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm
    first = lens.first_order(wavelength, section)
    entrance, leaving = first.entrance_pupil, first.exit_pupil
    if not np.isfinite(entrance.distance_mm):  # all that is in focus is as large, however far
        return 0.0, first.focal_length_mm + back - first.back_focal_distance_mm
    if not np.isfinite(leaving.distance_mm):  # the entrance pupil is the focus before the lens
        return entrance.distance_mm, first.focal_length_mm
    behind = float(lens.indices(wavelength)[-1])
    scale = abs(back - leaving.distance_mm) * entrance.diameter_mm / leaving.diameter_mm / behind
    return entrance.distance_mm, scale


def _chief_rays(setting: LensSetting, heights: Array) -> tuple[Array, Array] | None:
    """Return distance from the axis at the first vertex [mm] and slope of the rays through the middle of the pupil."""
    lens, wavelength = setting.lens, setting.camera.wavelength_nm
    pupil = lens.first_order(wavelength).exit_pupil.distance_mm
    if not lens.is_rotational or lens.has_mirrors or not np.isfinite(pupil):
        return None
    origins = np.column_stack([heights, 0 * heights, np.full(len(heights), lens.film_z(setting.film_distance_mm))])
    directions = np.array([0, 0, lens.length + pupil]) - origins
    if directions[0, 2] >= 0:
        return None
    rays = beams.crossings(lens, origins, directions, wavelength)
    with np.errstate(all="ignore"):
        slopes = rays.directions[:, 0] / rays.directions[:, 2]
        starts = rays.origins[:, 0] - slopes * rays.origins[:, 2]
        rising = np.diff(slopes) > 0  # also false for what does not pass
    last = len(heights) if rising.all() else 1 + int(rising.argmin())
    return (-starts[:last], slopes[:last]) if last >= _FEWEST else None


def frame_subject(
    points: Array, direction: Array, up: Array, film_mm: tuple[float, float], set_lens: _SetLens, metres_per_unit: float
) -> tuple[CameraAxes, Array, float]:
    """Return the view that two thirds fill, else the nearest from outside the subject that the lens can focus.

    Parameters
    ----------
    points : (n, 3) array
        The subject, in scene units.
    direction : (3,) array
        From the subject to the camera.
    up : (3,) array
    film_mm : (width, height)
    set_lens
        Focuses the lens on the middle of the subject, raises InputError where it cannot.
    metres_per_unit : float

    Returns
    -------
    view : CameraAxes
    target : (3,) array
        What the camera looks at.
    share : float
        How much of the film's width or height the subject fills, whichever is more.

    Raises
    ------
    InputError
        When the lens can focus nowhere.
    """
    half, unit_mm = np.asarray(film_mm) / 2, metres_per_unit * 1e3
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - target, axis=1).max())
    distance, nearest = 4 * radius + 100 / unit_mm, radius  # nearer, a wide lens would stand among the parts
    view, refused = None, InputError("")
    for _ in range(_ROUNDS):
        try:
            tried = CameraAxes.towards(target, direction, distance, up)
            projection = Projection(set_lens(tried, distance), unit_mm * 1e-3, float(np.hypot(*half)))
            low, high = projection.bounds_mm(tried.seen(points))
        except InputError as problem:
            refused, nearest, distance = problem, distance, 1.25 * distance
            continue
        view, share, middle = tried, float(((high - low) / 2 / half).max()), (low + high) / 2
        before_lens = distance - projection.length_mm / unit_mm
        shift = middle / projection.scales_mm * before_lens
        target = target + shift[0] * view.right + shift[1] * view.up
        wanted = distance - before_lens + before_lens * share / _FILL
        is_centred = float(np.abs(middle / half).max()) < _CLOSE_ENOUGH
        is_nearest = share < _FILL and wanted <= nearest * 1.01
        if is_centred and (abs(share / _FILL - 1) < _CLOSE_ENOUGH or is_nearest):
            break
        distance = max(wanted, nearest * 1.01)
    if view is None:
        raise refused
    return view, target, share


# The data of a new scene: film and camera, lights and surroundings, the model or three balls in its place.

_UP: dict[str, tuple[float, float, float]] = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
_FULL_FRAME_MM = 43.2666  # diagonal of 36 x 24
_DEFAULT_LENS = "dgauss-50mm"
_MOST_OPEN = 2.8  # f-number of a first picture, or the widest of a slower lens
_FAR_M = 1e6
_FOCUSINGS = 5  # in which the entrance pupil comes to rest where it is wanted; each leaves a tenth of the way at most
PLAIN = {"kind": "plastic", "reflectance": 0.5, "roughness": 0.4}  # of a model whose file has no material
_ROUND_TO = 6  # digits
_PLAUSIBLE = (0.01, 20.0)  # [m], the longest side of what one takes a picture of
_UNITS = (0.001, 0.01, 100.0, 1000.0)  # models are wrong by: millimetres, centimetres taken for metres, or twice so


def starting_scene(folder: Path, model: Path | None = None, **options: Any) -> Start:
    """A scene that shows a model framed, lit, focused and exposed; `options` are fields of `Start`.

    Raises
    ------
    InputError
        When the model, the picture or the lens cannot be used, or not be copied to the folder.
    """
    start = Start(folder, model, **options)
    start.build()
    return start


@dataclass
class Start:
    """A new scene, not yet written: its parts are made one after the other.

    Attributes
    ----------
    folder : Path
        Where the scene file is to lie.
    model, hdri : Path or None
        What to show, and by what light.
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
    time_s : float or None
        Moment of the animations of a glTF file; None is the pose at rest.
    scene : dict
        Its data.
    report : list of str
        What was chosen and what is left out, a sentence each.
    """

    folder: Path
    model: Path | None = None
    hdri: Path | None = None
    lens: str | None = None
    size: tuple[int, int] = (960, 640)
    up: str | None = None
    metres_per_unit: float = 1.0
    reframe: bool = False
    time_s: float | None = None
    scene: dict[str, Any] = field(default_factory=dict)
    report: list[str] = field(default_factory=list)

    @cached_property
    def copies(self) -> CopiedFiles:
        """Files that are to lie beside it."""
        return CopiedFiles(self.folder)

    @cached_property
    def _subject(self) -> ShownModel:
        return _balls() if self.model is None else _read_subject(self.model, self.time_s)

    @cached_property
    def _up(self) -> Array:
        stl = self.model is not None and self.model.suffix.lower() == ".stl"
        return np.array(_UP[self.up or ("z" if stl else "y")], dtype=float)

    def build(self) -> None:
        """Make the scene."""
        if self.time_s is not None and self.model is None:
            raise InputError(f"time_s: is a moment of a model (got {self.time_s:g} without one; allowed: a glTF file)")
        subject = self._subject
        self.scene["metres_per_unit"] = self.metres_per_unit
        self.report += subject.notes
        if self.model is not None:
            self.report += _doubts_of_size(subject, self.metres_per_unit)
        camera = None if self.reframe or not subject.cameras else subject.cameras[0]
        width, height = self.size
        if camera is not None and camera.aspect is not None:
            height = max(1, round(width / camera.aspect))
        self.scene["film"] = {"resolution": [width, height]}
        if camera is None:
            self._frame_subject()
        else:
            self._take_camera(camera)
        self.scene["exposure"] = {"mode": "auto"} | ({} if self.hdri or subject.lights else {"ev": 0.5})
        self.scene["render"] = {"spp": 256, "max_depth": 8}
        self._light_scene()
        self._place_objects()

    def _lens_key(self) -> str:
        lens = self.lens or _DEFAULT_LENS
        if not names_a_file(lens):
            load_lens(lens)  # which says which names there are
            return lens
        name = self.copies.name_of(Path(lens))
        return name if names_a_file(name) else f"./{name}"

    def _film_mm(self, lens: str, height_mm: float | None = None) -> tuple[float, float]:
        """Set a film of full frame, or as large as the image circle lets it be; return its sides."""
        width, height = self.scene["film"]["resolution"]
        design = load_lens(Path(lens) if names_a_file(lens) else lens)
        diagonal = _FULL_FRAME_MM if height_mm is None else height_mm * math.hypot(width, height) / height
        circle = 2 * irradiance.image_circle(design, film_distance(design, np.inf))
        if diagonal > circle:
            diagonal = math.floor(circle * 100) / 100
            self.report.append(f"the film has a diagonal of {diagonal:g} mm, the image circle of {design.name}")
        self.scene["film"]["diagonal_mm"] = round(diagonal, 4)
        return diagonal * width / math.hypot(width, height), diagonal * height / math.hypot(width, height)

    def _camera(self, lens: str, view: CameraAxes, target: Array, depth: float) -> dict[str, Any]:
        """Return the keys of a lens camera focused at a depth ahead of it."""
        keys: dict[str, Any] = {"kind": "realistic", "lens": lens}
        design = load_lens(self._lens_source(lens))
        widest = design.first_order().f_number
        if design.stop is not None and widest < _MOST_OPEN:
            keys["f_number"] = _MOST_OPEN
        pose = {"eye": _round(view.eye), "target": _round(target), "up": _round(self._up)}
        return keys | pose | {"focus": {"distance_m": _digits(depth * self.metres_per_unit)}}

    def _lens_source(self, lens: str) -> str | Path:
        return Path(self.lens) if self.lens and names_a_file(self.lens) else lens

    def _frame_subject(self) -> None:
        lens, subject, unit = self._lens_key(), self._subject, self.metres_per_unit
        film = self._film_mm(str(self._lens_source(lens)))

        def set_lens(view: CameraAxes, depth: float) -> LensSetting:
            return self._set(lens, view, depth)

        direction = _three_quarters(self._up)
        view, target, share = frame_subject(subject.points, direction, self._up, film, set_lens, unit)
        ahead = float((target - view.eye) @ view.forward)
        depth = subject.first_hit(view.eye, view.forward) or ahead
        try:
            set_lens(view, depth)
        except InputError:  # the front is nearer than the lens focuses
            depth = ahead
        self.scene["camera"] = self._camera(lens, view, target, depth)
        low, high = subject.bounds
        size = " x ".join(f"{side * unit:.3g}" for side in high - low)
        self.report.append(f"the model is {size} m; it fills {share:.0%} of the frame from {depth * unit:.3g} m")

    def _set(self, lens: str, view: CameraAxes, depth: float) -> LensSetting:
        """Return the lens focused at a depth ahead of the middle of the film."""
        source = self._lens_source(lens)
        camera = self._camera(str(source), view, view.eye + view.forward, depth)
        if isinstance(source, Path):
            camera["lens"] = source.name
            return lens_setting(load_scene({"camera": camera}, base_dir=source.resolve().parent))
        return lens_setting(load_scene({"camera": camera}))

    def _take_camera(self, camera: GltfCamera) -> None:
        """Take the camera of the model's file: its field of view through the lens, or as a thin lens."""
        if others := ", ".join(other.name for other in self._subject.cameras[1:]):
            self.report.append(f"other cameras of the file are left out: {others}")
        eye, forward = np.array(camera.eye), np.array(camera.forward)
        unit = self.metres_per_unit
        right = np.cross(forward, camera.up)
        view = CameraAxes(eye, forward, right / np.linalg.norm(right), np.array(camera.up))
        ahead = self._subject.first_hit(eye, forward)
        if ahead is None:
            depths = view.seen(self._subject.points)[:, 2]
            ahead = float(np.median(depths[depths > 0])) if (depths > 0).any() else 5.0 / unit
        degrees = math.degrees(camera.height_radians)
        if self.lens is None:
            pose = {"eye": _round(eye), "target": _round(eye + ahead * forward), "up": list(camera.up)}
            self.scene["film"]["diagonal_mm"] = _FULL_FRAME_MM
            self.scene["camera"] = {
                "kind": "thin_lens",
                **pose,
                "fov_degrees": _digits(degrees),
                "fov_axis": "vertical",
                "f_number": _MOST_OPEN,
                "focus_distance_m": _digits(ahead * unit),
            }
            self.report.append(f"the camera is {camera.name} of the file, as a thin lens at f/{_MOST_OPEN}")
            return
        lens = self._lens_key()
        try:
            back, scale = self._behind(lens, view, ahead)
        except InputError as problem:
            raise InputError(f"{camera.name} of the file: {problem} (allowed: another lens, or --reframe)") from None
        self._film_mm(str(self._lens_source(lens)), 2 * scale * math.tan(camera.height_radians / 2))
        there = replace(view, eye=eye - back * forward)
        self.scene["camera"] = self._camera(lens, there, eye + ahead * forward, ahead + back)
        self.scene["camera"]["up"] = list(camera.up)
        self.report.append(
            f"the camera is {camera.name} of the file, {degrees:.3g} degrees high; the film fits that through {lens}"
        )

    def _behind(self, lens: str, view: CameraAxes, ahead: float) -> tuple[float, float]:
        """Return how far behind a view's eye the film is whose entrance pupil is there, and the scale of the picture.

        Lengths are scene units, the scale is that of `Projection`, upwards. The plane in focus lies ahead of the eye.
        """
        unit = self.metres_per_unit
        depth = _FAR_M / unit  # at first, as a lens may focus no nearer than where its film will be
        for _ in range(_FOCUSINGS):
            projection = Projection(self._set(lens, view, depth), unit, 1.0)
            back = (projection.length_mm - float(projection.pupils_mm[1])) * 1e-3 / unit
            depth = ahead + back
        return back, float(projection.scales_mm[1])

    def _light_scene(self) -> None:
        """Take the lamps of the file, whose intensities glTF divides by distances in its units, we by metres."""
        scene, lights = self.scene, self._subject.lights
        for light in lights:
            if "intensity" in light:
                light["intensity"] = [channel * self.metres_per_unit**2 for channel in light["intensity"]]
        if lights:
            scene["lights"] = [{key: _round_value(value) for key, value in light.items()} for light in lights]
            self.report.append(f"{len(lights)} lamp{'s' if len(lights) > 1 else ''} of the file")
        if self.hdri is not None:
            name = self.copies.name_of(self.hdri)
            with name_errors(self.hdri):
                read_picture(self.hdri)
            scene["environment"] = {"kind": "image", "file": name, "up": _round(self._up)}
        elif not lights:
            eye = np.array(scene["camera"]["eye"], dtype=float)
            scene |= _studio(self._subject.bounds, eye, self._up)

    def _place_objects(self) -> None:
        scene, subject = self.scene, self._subject
        if self.model is None:
            scene["objects"] = [*subject.objects, *scene.get("objects", [])]
            return
        keys: dict[str, Any] = {"name": "model", "shape": "mesh", "file": self.copies.name_of(self.model)}
        if self.time_s is not None:
            keys["time_s"] = self.time_s
        self.copies.add_companions(self.model, subject.files)
        if subject.bare:
            keys["material"] = "model"
            scene["materials"] = {"model": PLAIN, **scene.get("materials", {})}
        scene["objects"] = [keys, *scene.get("objects", [])]


def _three_quarters(up: Array) -> Array:
    """Return the direction to a camera that sees front and one side, a little from above."""
    front = np.array([0, 0, 1.0]) if up[2] == 0 else np.array([0, -1.0, 0])
    side = np.cross(up, front)
    return np.asarray(front + 0.45 * side + 0.25 * up)


def _round_value(value: Any) -> Any:
    """A number, or each of several, rounded; a word as it is."""
    if isinstance(value, str):
        return value
    return _digits(value) if isinstance(value, float) else _round(np.array(value))


def _doubts_of_size(subject: ShownModel, unit: float) -> list[str]:
    """A hint for a model that nobody would photograph at that size, so that its unit must be another."""
    low, high = subject.bounds
    size = float((high - low).max()) * unit
    if size == 0 or _PLAUSIBLE[0] <= size <= _PLAUSIBLE[1]:
        return []
    factors = [factor for factor in _UNITS if _PLAUSIBLE[0] <= size * factor <= _PLAUSIBLE[1]]
    factors = factors or [10.0 ** -math.floor(math.log10(size))]
    ways = " or ".join(f"--metres-per-unit {unit * factor:g} (then {_length(size * factor)})" for factor in factors)
    return [f"hint: the model is {_length(size)} long; if that is not its true size, say {ways}"]


def _length(metres: float) -> str:
    """Return a length in words, in millimetres below a tenth of a metre."""
    return f"{metres:.3g} m" if metres >= 0.1 else f"{1000 * metres:.3g} mm"


def _digits(value: float) -> float:
    return float(f"{value:.{_ROUND_TO}g}")


def _round(vector: Array) -> list[float]:
    return [_digits(value) for value in vector.tolist()]
