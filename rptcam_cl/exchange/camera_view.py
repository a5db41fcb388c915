"""A camera as others see it: which direction each place of its picture shows, in float64."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.optics.beams import fan_chief_rays, film_chief_rays, round_chief_rays
from rptcam_cl.optics.design import image_circle
from rptcam_cl.optics.lens import Lens, film_distance
from rptcam_cl.optics.library import list_lenses, load_lens, names_a_file
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.model import CameraModel
from rptcam_cl.rendering.cameras.setting import (
    EntrancePupil,
    LensSetting,
    film_frame,
    half_film_mm,
    on_film,
    pupil_in_world,
)
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.scene.camera import pose_matrix
from rptcam_cl.scene.load import at_opening, change_scene, load_scene
from rptcam_cl.scene.scene import Scene

#
# A camera as others see it: which direction of the scene each place of its picture shows, in float64.
#
# Places of the picture are pixels from its left and top edges, so that the first pixel covers 0 to 1 and its centre
# is 0.5. Directions are those of computer vision: x to the right, y down, z ahead, seen from the centre of the
# entrance pupil. Through a real lens they are those of its chief rays.

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_UPRIGHT = np.diag([1.0, -1.0, -1.0])  # from the axes of computer vision to those of the camera's frame
_TURNED = np.diag([-1.0, 1.0, -1.0])  # the same of an inverted picture, which a camera on its head takes
_SHAPES = ("plane", "sphere")  # of an object
FAR_M = 1e5  # from where on the object is as good as infinitely far
_PROBES = 9  # places across and down that say how wide the field is
_DRIFT_PLACES = (41, 31)  # across and down, whose chief rays say where the pupil lies at which angle
_DRIFT_ANGLES = 33  # of that table
_ON_AXIS = 1e-3  # angle below which a chief ray does not tell where it crosses the axis [radians]
_STEEP = math.cos(math.radians(75.0))  # of a direction from the axis, beyond which the object is a sphere and no plane


@dataclass(frozen=True, eq=False)
class View:
    """What the picture of a camera shows where.

    Attributes
    ----------
    scene : Scene
        In focus, with the camera in question.
    distance_m : float
        Of the object from the entrance pupil, along the axis; infinite for one far away. It matters where the pupil
        drifts over the field.
    shape : str or None
        Of the object: a ``plane`` across the axis, or a ``sphere`` about the pupil, as boards make that each face the
        camera. By default a plane, unless the field is too wide for one.
    """

    scene: Scene
    distance_m: float = math.inf
    shape: str | None = None

    @property
    def name(self) -> str:
        """What the camera is called."""
        return self.setting.lens.name if self.setting is not None else self.scene.camera.kind.replace("_", " ")

    @cached_property
    def setting(self) -> LensSetting | None:
        """The lens in use; None of a camera without surfaces."""
        return camera_of(self.scene).setting

    @cached_property
    def pupil(self) -> EntrancePupil:
        """The entrance pupil; that of an ideal camera without surfaces is its opening, at the eye."""
        return camera_of(self.scene, self.setting).entrance_pupil()

    @property
    def is_traced(self) -> bool:
        """Whether rays are traced through surfaces; else its intrinsics say all."""
        return self.scene.camera.traced_camera is not None

    @property
    def pupil_ahead_mm(self) -> float:
        """How far the entrance pupil lies ahead of the eye [mm]."""
        return self.pupil.ahead_mm

    @property
    def window(self) -> tuple[int, int, int, int]:
        """The picture in the whole film: x, y, width and height [pixels]."""
        layout = FilmLayout.of(self.scene.film)
        return layout.x, layout.y, layout.width, layout.height

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture [pixels]."""
        return self.window[2:]

    @property
    def is_mirrored(self) -> bool:
        """Whether left and right, and top and bottom of the picture see the same through a round lens."""
        camera, whole = self.scene.camera, self.size == self.scene.film.resolution
        round_ = self.is_traced and self.setting is not None and self.setting.lens.is_rotational
        return round_ and whole and not film_frame(camera).is_moved

    @property
    def is_of_any_stop(self) -> bool:
        """Whether chief rays come from the corners, and are the same to the last bit however wide the stop is."""
        if not self.is_mirrored or self.setting is None:
            return False
        lens, corner = self.setting.lens, float(np.hypot(*half_film_mm(self.scene)))
        point = np.array([[corner, 0.0, lens.film_z(self.setting.film_distance_mm)]])
        rays = fan_chief_rays(lens, point, self.setting.camera.wavelength_nm)
        return rays is not None and bool(rays.clear.all())

    @property
    def axes(self) -> Array:
        """Directions of computer vision (columns) in the camera's frame, (3, 3)."""
        return _UPRIGHT if self.scene.camera.flip else _TURNED

    def pose(self) -> Array:
        """Return the 4x4 matrix from the view's frame to the world [m]: right, down, ahead and the entrance pupil."""
        matrix = pose_matrix(self.scene.camera.pose_at(self.scene.shutter.span_s[0]))
        matrix[:3, 3] *= self.scene.metres_per_unit
        matrix[:3, 3] -= matrix[:3, 2] * self.pupil_ahead_mm * 1e-3
        matrix[:3, :3] = matrix[:3, :3] @ self.axes
        return matrix

    def film_points(self, places: Array) -> Array:
        """Return places of the picture (n, 2) on the film (n, 3), in the frame of the lens with its depth behind [mm].

        A lens inverts: right and up in an upright picture are left and down on the film.
        """
        share = (np.asarray(places, np.float64) + self.window[:2]) / self.scene.film.resolution * 2.0 - 1.0
        sense = -1.0 if self.scene.camera.flip else 1.0
        return film_frame(self.scene.camera).points(sense * share * (1.0, -1.0) * np.array(half_film_mm(self.scene)))

    def directions(self, places: Array) -> tuple[Array, Mask]:
        """Return unit directions (n, 3) of places (n, 2) of the picture, and which of them the lens shows anything at.

        Directions of the others are not-a-number where there are none.
        """
        places = np.atleast_2d(np.asarray(places, np.float64))
        if not self.is_traced:
            return self._ideal(places), np.ones(len(places), dtype=bool)
        probes = self.grid(_PROBES, _PROBES)
        origins, away, lit = self._chief_rays(np.concatenate([probes, places]))
        first, rest = slice(len(probes)), slice(len(probes), None)
        seen = away[rest]
        if self.distance_m < FAR_M:  # where rays meet the object, from the entrance pupil in the camera's axes
            sphere = self._shape_of(away[first], lit[first]) == "sphere"
            along = distance_along(origins[rest], seen, self.distance_m * 1e3, sphere=sphere)
            seen = origins[rest] + seen * along[:, None]
        return seen / np.linalg.norm(seen, axis=1, keepdims=True) @ self.axes, lit[rest]

    def _chief_rays(self, places: Array) -> tuple[Array, Array, Mask]:
        """Return points and directions of chief rays (n, 3) from the entrance pupil, and which places have light."""
        setting, film = self.setting, self.film_points(places)
        assert setting is not None
        lens, back, wavelength = setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm
        z = lens.film_z(back) + lens.sense * film[:, 2]
        round_ = lens.is_rotational and film_frame(self.scene.camera).is_flat
        find = round_chief_rays if round_ else film_chief_rays
        rays = find(lens, np.column_stack([film[:, :2], z]), wavelength)
        lit = rays.clear
        if not lit.all() and round_:
            radii = np.hypot(*film[:, :2].T)
            between = (float(radii[lit].max()), float(radii.max())) if lit.any() else None
            lit = rays.found & (radii < image_circle(lens, back, wavelength, between_mm=between))
        origins = rays.origins - [0.0, 0.0, lens.film_z(back) - self.pupil_ahead_mm]
        return origins, np.where(rays.found[:, None], rays.directions, np.nan), lit

    def _shape_of(self, away: Array, lit: Mask) -> str:
        """The kind of object: a sphere where no plane across the axis lies before all of the field."""
        return self.shape or ("sphere" if np.any(-away[lit, 2] < _STEEP) else "plane")

    @property
    def object_shape(self) -> str | None:
        """What the object is, a ``plane`` or a ``sphere``; None of one far away."""
        if not self.distance_m < FAR_M:
            return None
        if self.shape or not self.is_traced:
            return self.shape or "plane"
        _, away, lit = self._chief_rays(self.grid(_PROBES, _PROBES))
        return self._shape_of(away, lit)

    def drift_by_angle(self) -> tuple[Array, Array] | None:
        """Return angles from the axis [degrees], and how far ahead of the entrance pupil chief rays cross it [mm].

        A point of the scene is seen from there, whatever its distance. None of a lens that is not round, or of none.
        """
        if not self.is_traced or not (self.setting and self.setting.lens.is_rotational):
            return None
        origins, away, lit = self._chief_rays(self.grid(*_DRIFT_PLACES))
        across = np.hypot(away[:, 0], away[:, 1])
        origins, away, across = (values[lit & (across > _ON_AXIS)] for values in (origins, away, across))
        if not len(away):
            return None
        angles = np.arctan2(across, -away[:, 2])
        along = np.sum(origins[:, :2] * away[:, :2], axis=1) / across**2
        ahead = along * away[:, 2] - origins[:, 2]
        order = np.argsort(angles)
        nodes = np.linspace(0.0, angles.max(), _DRIFT_ANGLES)
        return np.degrees(nodes), np.interp(nodes, [0.0, *angles[order]], [0.0, *ahead[order]])

    def _ideal(self, places: Array) -> Array:
        """Return the directions of a camera that has intrinsics and nothing beside."""
        known = camera_of(self.scene).intrinsics()
        at = places + self.window[:2]
        if "matrix" in known:
            seen = np.column_stack([at, np.ones(len(at))]) @ np.linalg.inv(np.array(known["matrix"])).T
            seen *= np.sign(seen[:, 2:]) * [1.0, -1.0, 1.0]
        else:
            seen = np.column_stack([(at - (known["cx"], known["cy"])) / (known["fx"], known["fy"]), np.ones(len(at))])
        return np.asarray(seen / np.linalg.norm(seen, axis=1, keepdims=True) @ (_UPRIGHT @ self.axes))

    def grid(self, columns: int, rows: int) -> Array:
        """Return places (rows x columns, 2) spread evenly over the picture from edge to edge, row by row."""
        return _grid(self.size, columns, rows)

    def facts(self) -> dict[str, Any]:
        """The facts of the camera that programs want beside its projection."""
        sides = zip(half_film_mm(self.scene), self.scene.film.resolution, strict=True)
        facts: dict[str, Any] = {
            "camera": self.name,
            "width": self.size[0],
            "height": self.size[1],
            "pixel_mm": [2 * half / count for half, count in sides],
            "window": list(self.window),
            "object_distance_m": self.distance_m if self.distance_m < FAR_M else None,
            "world_from_camera": self.pose().tolist(),
        }
        if self.setting is not None:
            lens = self.setting.metadata
            facts |= {key: lens[key] for key in ("focal_length_mm", "f_number", "focus_distance_m")}
        return facts | {"entrance_pupil": pupil_in_world(self.scene, self.pupil.described())}


@lru_cache(maxsize=16)
def _grid(size: tuple[int, int], columns: int, rows: int) -> Array:
    x, y = (np.linspace(0.0, side, count) for side, count in zip(size, (columns, rows), strict=True))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def distance_along(origins: Array, directions: Array, distance_mm: float, *, sphere: bool) -> Array:
    """Return how far (n,) it is along rays (n, 3) from the entrance pupil to a plane across the axis or to a sphere."""
    if not sphere:
        return np.asarray((distance_mm + origins[:, 2]) / -directions[:, 2])
    along = np.sum(origins * directions, axis=1)
    inside = along**2 - np.sum(origins**2, axis=1) + distance_mm**2
    return np.asarray(np.sqrt(np.maximum(inside, 0.0)) - along)


def check_distances(distances_m: Sequence[float], name: str = "distances_m") -> None:
    """Refuse distances of objects that are not ahead of the camera, and none at all.

    Raises
    ------
    InputError
    """
    if len(distances_m) == 0:
        raise InputError(f"{name}: is empty (allowed: one distance or more)")
    for distance in distances_m:
        if not distance > 0:
            raise InputError(f"{name}: is out of range (got {distance:g}; allowed: above 0 m, inf for far away)")


def view(
    scene: Scene, distance_m: float | None = None, shape: str | None = None, camera: CameraModel | None = None
) -> View:
    """Return the view of a scene's camera when the shutter opens.

    Parameters
    ----------
    distance_m
        Of the object from the entrance pupil; infinite for one far away; that of the focus when absent.
    shape
        Of the object, ``plane`` or ``sphere``; by the field when absent.
    camera
        The camera of a plan of the scene, where there is one: its lens is not set again.

    Raises
    ------
    InputError
        For a camera that sees all around, or whose focus is yet to be found, or whose pupil is infinitely far away; for
        another shape, and for a distance that is not above 0.
    """
    if shape is not None and shape not in _SHAPES:
        raise InputError(f"shape: is no shape of an object (got {shape}; allowed: {', '.join(_SHAPES)})")
    if distance_m is not None:
        check_distances((distance_m,), "distance_m")
    scene = at_opening(scene if scene.requested_autofocus is not None else on_film(scene))
    if scene.requested_autofocus is not None:
        raise InputError("camera.focus.auto: the focus is yet to be found (write a scene with it by rptcam settle)")
    view = View(scene, shape=shape)
    if camera is not None and camera.setting is not None and camera.pupil is not None:
        view.__dict__.update(setting=camera.setting, pupil=camera.pupil)
    if not math.isfinite(view.pupil_ahead_mm):
        raise InputError(f"{view.name}: its entrance pupil is infinitely far away, so no centre of projection exists")
    if distance_m is None:
        if view.setting is None or view.setting.focus_distance_mm is None:
            return view
        distance_m = (view.setting.focus_distance_mm - view.pupil_ahead_mm) * 1e-3
    there = replace(view, distance_m=distance_m)
    there.__dict__.update(setting=view.setting, pupil=view.pupil)  # which the distance does not change
    return there


# What a camera is taken of: a scene file, or a lens alone with a film that its image circle holds.

_SIZE = (768, 512)  # of the picture of a lens alone [pixels]
_FORMAT_MM = (36.0, 24.0)  # of its film, where the image circle holds that
_FILL = 0.98  # of the image circle's radius that half the diagonal of a smaller film takes


def _is_scene(source: str | Path | Mapping[str, Any]) -> bool:
    """Return whether a name, a file or a mapping is a scene, and no lens."""
    if isinstance(source, Mapping):
        return "camera" in source
    if str(source) in list_lenses():
        return False
    path = Path(source)
    if path.suffix.lower() not in (".yaml", ".yml", ".json"):
        return False
    if not path.is_file():
        raise InputError(
            f"{source}: there is no such file (allowed: a scene or lens file, or a lens of rptcam lens list;"
            " rptcam examples copies scenes)"
        )
    content = read_yaml(path).data
    return isinstance(content, Mapping) and "camera" in content


def subject(
    source: str | Path | Mapping[str, Any] | Scene,
    overrides: Sequence[str] = (),
    *,
    size: tuple[int, int] | None = None,
    film_mm: tuple[float, float] | None = None,
) -> Scene:
    """Return the scene of a source: itself, or one that has nothing but a camera with the lens, focused at infinity.

    Parameters
    ----------
    source
        A scene, its file or content; or a lens by name or file.
    overrides
        Changes such as ``camera.f_number=8`` of a scene file, or of the scene of a lens.
    size
        Resolution [pixels]: in place of the scene's, or that of a lens's picture.
    film_mm
        Width and height of the film [mm], likewise.

    Raises
    ------
    InputError
        For a lens without a real image of a distant object, and whatever is wrong in a file.
    """
    if isinstance(source, Scene):
        scene = source
    elif _is_scene(source):
        scene = load_scene(source, overrides)
    else:
        name = str(source)
        scene = load_scene(_of_lens(name, size or _SIZE, film_mm), overrides, base_dir=Path(name).resolve().parent)
    film: dict[str, Any] = {} if size is None else {"resolution": list(size)}
    if film_mm is not None:
        film |= dict.fromkeys(("format", "width_mm", "diagonal_mm", "pixel_pitch_um")) | {"size_mm": list(film_mm)}
    return change_scene(scene, film=film) if film else scene


def _of_lens(name: str, size: tuple[int, int], film_mm: tuple[float, float] | None) -> dict[str, Any]:
    lens = load_lens(name)
    first = lens.first_order()
    if not (0 < first.focal_length_mm < math.inf and first.back_focal_distance_mm > 0):
        raise InputError(f"{lens.name}: forms no real image of a distant object, so there is no picture of it")
    back = film_distance(lens, math.inf)
    sides = film_mm or _fitting(lens, back, size)
    named = str(Path(name).resolve()) if names_a_file(name) else name
    return {
        "film": {"resolution": list(size), "size_mm": list(sides)},
        "camera": {
            "kind": "realistic", "lens": named, "eye": [0, 0, 0], "target": [0, 0, -1],
            "focus": {"film_distance_mm": back},
        },
    }  # fmt: skip


def _fitting(lens: Lens, back: float, size: tuple[int, int]) -> tuple[float, float]:
    """Return the sides of a film of square pixels [mm]: of the small format, or what the image circle holds of it."""
    radius = image_circle(lens, back, LINE_D_NM)
    half = min(math.hypot(*_FORMAT_MM) / 2, _FILL * radius)
    width, height = size
    scale = 2 * half / math.hypot(width, height)
    return width * scale, height * scale
