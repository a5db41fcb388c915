"""A camera as others see it: the direction that each place of its picture shows, and models of computer vision.

Models are fitted to the chief rays of a lens, and it is measured by how much each errs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.optics import irradiance, library
from rptcam_cl.optics.beams import fan_chief_rays, film_chief_rays, round_chief_rays
from rptcam_cl.optics.lens import Lens, film_distance
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
from rptcam_cl.scene import changes, load
from rptcam_cl.scene.camera import pose_matrix
from rptcam_cl.scene.scene import Scene

if TYPE_CHECKING:
    pass


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
class CameraView:
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
            lit = rays.found & (radii < irradiance.image_circle(lens, back, wavelength, between_mm=between))
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
) -> CameraView:
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
    scene = changes.at_opening(scene if scene.requested_autofocus is not None else on_film(scene))
    if scene.requested_autofocus is not None:
        raise InputError("camera.focus.auto: the focus is yet to be found (write a scene with it by rptcam settle)")
    view = CameraView(scene, shape=shape)
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
    if str(source) in library.list_lenses():
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
        scene = load.load_scene(source, overrides)
    else:
        name = str(source)
        scene = load.load_scene(_of_lens(name, size or _SIZE, film_mm), overrides, base_dir=Path(name).resolve().parent)
    film: dict[str, Any] = {} if size is None else {"resolution": list(size)}
    if film_mm is not None:
        film |= dict.fromkeys(("format", "width_mm", "diagonal_mm", "pixel_pitch_um")) | {"size_mm": list(film_mm)}
    return changes.change_scene(scene, film=film) if film else scene


def _of_lens(name: str, size: tuple[int, int], film_mm: tuple[float, float] | None) -> dict[str, Any]:
    lens = library.load_lens(name)
    first = lens.first_order()
    if not (0 < first.focal_length_mm < math.inf and first.back_focal_distance_mm > 0):
        raise InputError(f"{lens.name}: forms no real image of a distant object, so there is no picture of it")
    back = film_distance(lens, math.inf)
    sides = film_mm or _fitting(lens, back, size)
    named = str(Path(name).resolve()) if library.names_a_file(name) else name
    return {
        "film": {"resolution": list(size), "size_mm": list(sides)},
        "camera": {
            "kind": "realistic", "lens": named, "eye": [0, 0, 0], "target": [0, 0, -1],
            "focus": {"film_distance_mm": back},
        },
    }  # fmt: skip


def _fitting(lens: Lens, back: float, size: tuple[int, int]) -> tuple[float, float]:
    """Return the sides of a film of square pixels [mm]: of the small format, or what the image circle holds of it."""
    radius = irradiance.image_circle(lens, back, LINE_D_NM)
    half = min(math.hypot(*_FORMAT_MM) / 2, _FILL * radius)
    width, height = size
    scale = 2 * half / math.hypot(width, height)
    return width * scale, height * scale


#
# Camera models of computer vision: how each projects a direction on the picture.
#
# All but the last see (a, b) = (x / z, y / z) and distort it (Brown 1966; the rational and thin-prism terms as OpenCV
# has them). Kannala and Brandt (IEEE PAMI 28, 2006) go by the angle from the axis instead, so that a fisheye fits.
# Parameters are fx, fy, cx, cy [pixels, from the picture's corner] and then the coefficients in the order of OpenCV.


_INTRINSICS = ("fx", "fy", "cx", "cy")
_BROWN = ("k1", "k2", "p1", "p2", "k3")
COEFFICIENTS: dict[str, tuple[str, ...]] = {
    "pinhole": (),
    "brown_conrady": _BROWN,
    "rational": (*_BROWN, "k4", "k5", "k6"),
    "thin_prism": (*_BROWN, "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
    "kannala_brandt": ("k1", "k2", "k3", "k4"),
}
BY_ANGLE = "kannala_brandt"
_LEAST_AHEAD = 0.02  # z of a unit direction below which a plane in front of the camera has no place for it


def normal_points(model: str, directions: Array) -> Array:
    """The coordinates (n, 2) that a model distorts: tangents, or of the model by angles the angle along its azimuth."""
    across = directions[:, :2]
    with np.errstate(all="ignore"):
        if model != BY_ANGLE:
            return np.asarray(across / directions[:, 2:])
        length = np.linalg.norm(across, axis=1)
        angle = np.arctan2(length, directions[:, 2])
        return np.asarray(across * np.where(length > 1e-12, angle / length, 1.0)[:, None])


def _sees(model: str, parameters: Array, directions: Array) -> NDArray[np.bool_]:
    """Return which directions (n, 3) a model of these parameters sees.

    Those ahead of the camera, z > 0; of the model by angles those up to where its radius no longer grows with the
    angle, beyond 90 degrees too, but for what lies straight behind, which has no azimuth.
    """
    if model != BY_ANGLE:
        return np.asarray(directions[:, 2] > 0)
    across = np.linalg.norm(directions[:, :2], axis=1)
    angle = np.arctan2(across, directions[:, 2])
    return np.asarray((angle < _widest(parameters[4:])) & ((across > 0) | (directions[:, 2] > 0)))


def _widest(coefficients: Array) -> float:
    """Return the angle at which the radius of the model by angles turns back, above 180 degrees if nowhere [rad]."""
    slope = np.append(coefficients[::-1] * [9.0, 7.0, 5.0, 3.0], 1.0)  # of the radius, by powers of the squared angle
    roots = np.roots(slope)
    turns = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
    return float(np.sqrt(turns.min(initial=16.0)))


def project(model: str, parameters: Array, directions: Array) -> Array:
    """Return the places (n, 2) of directions (n, 3) in the picture [pixels from its corner].

    Not-a-number for directions that the model does not see: behind the camera (z <= 0), or for the model by angles,
    which sees beyond 90 degrees, past the angle at which its radius turns back.

    Parameters
    ----------
    model : str
        One of `COEFFICIENTS`.
    parameters : array
        fx, fy, cx, cy, and the coefficients.
    """
    with np.errstate(all="ignore"):
        places = placed(model, parameters, normal_points(model, directions))
    places[~_sees(model, parameters, directions)] = np.nan
    return places


def placed(model: str, parameters: Array, points: Array) -> Array:
    """Return the places (n, 2) in the picture of points of `normal_points` (n, 2) [pixels from its corner]."""
    return np.asarray(distorted(model, parameters[4:], points) * parameters[:2] + parameters[2:4])


def distorted(model: str, coefficients: Array, points: Array) -> Array:
    """Return points of `normal_points` (n, 2) as the coefficients bend them."""
    if model == "pinhole":
        return points
    square = np.sum(points * points, axis=1)
    if model == BY_ANGLE:
        k1, k2, k3, k4 = coefficients
        return np.asarray(points * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))[:, None])
    k1, k2, p1, p2, k3 = coefficients[:5]
    x, y = points.T
    scale = 1 + square * (k1 + square * (k2 + square * k3))
    if len(coefficients) > 5:
        scale = scale / _denominator(coefficients, square)
    bent = [
        x * scale + 2 * p1 * x * y + p2 * (square + 2 * x * x),
        y * scale + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
    ]
    if len(coefficients) > 8:
        s1, s2, s3, s4 = coefficients[8:12]
        bent[0] = bent[0] + square * (s1 + square * s2)
        bent[1] = bent[1] + square * (s3 + square * s4)
    return np.stack(bent, axis=1)


def slopes(model: str, parameters: Array, points: Array) -> Array:
    """Return the derivatives (n, 2, parameters) of places in the picture, of points of `normal_points` (n, 2)."""
    focal, coefficients = parameters[:2], parameters[4:]
    square = np.sum(points * points, axis=1)
    jacobian = np.zeros((len(points), 2, len(parameters)))
    jacobian[:, 0, 0], jacobian[:, 1, 1] = distorted(model, coefficients, points).T
    jacobian[:, 0, 2] = jacobian[:, 1, 3] = 1.0
    by = jacobian[:, :, 4:]
    powers = np.multiply.accumulate(np.repeat(square[:, None], 4, axis=1), axis=1)
    if model == BY_ANGLE:
        by[:] = points[:, :, None] * powers[:, None]
    elif model != "pinhole":
        k1, k2, _, _, k3 = coefficients[:5]
        x, y = points.T
        along = points
        if len(coefficients) > 5:
            below = _denominator(coefficients, square)
            along = points / below[:, None]
            ratio = (1 + square * (k1 + square * (k2 + square * k3))) / below
            by[:, :, 5:8] = -(along * ratio[:, None])[:, :, None] * powers[:, None, :3]
        by[:, :, :2], by[:, :, 4] = along[:, :, None] * powers[:, None, :2], along * powers[:, 2:3]
        by[:, 0, 2], by[:, 1, 2] = 2 * x * y, square + 2 * y * y
        by[:, 0, 3], by[:, 1, 3] = square + 2 * x * x, 2 * x * y
        if len(coefficients) > 8:
            by[:, 0, 8:10] = by[:, 1, 10:12] = powers[:, :2]
    by *= focal[:, None]
    return jacobian


def _denominator(coefficients: Array, square: Array) -> Array:
    """The denominator of the rational model, at squared distances from the axis."""
    k4, k5, k6 = coefficients[5:8]
    return np.asarray(1 + square * (k4 + square * (k5 + square * k6)))


#
# Camera models fitted to the chief rays of a lens, and by how much each errs.
#
# The fit makes the sum of squared errors in the picture least (Levenberg 1944, Marquardt 1963). Its residual is
# measured at more places than those of the fit, to the very corners and to the edge of the light.


FITTED = (25, 19)  # places across and down that the fit goes by, from edge to edge
CHECKED = (37, 29)  # places across and down that the residual is measured at, from edge to edge; 1 more than 4 n
# Times as fine along edges and diagonals, where models err fastest, and between places with and without light.
_FINER = 8
_LEAST_PLACES = 40  # with light, below which nothing can be fitted
_ROUNDS = 120
_DAMPING = 1e-3
_NEAR = 1e-9  # the same for a start that leaves little
_SMALL = 1e-13  # share of the error by which a step has to improve it
# Damping at which no step helps any more, and below which dependent parameters may leave equations singular.
_TOO_HIGH, _TOO_LOW = 1e12, 1e-12


@dataclass(frozen=True)
class Calibration:
    """A camera model that stands for a lens.

    Attributes
    ----------
    model : str
        One of `COEFFICIENTS`.
    parameters : array
        fx, fy, cx, cy [pixels; 0.5 is the centre of the first pixel], and the coefficients in the order of OpenCV.
    max_px, rms_px : float
        Largest and root mean square error over the places of the picture that have light [pixels].
    errors : (rows, columns, 2) array
        Model less lens [pixels], at places spread evenly from edge to edge; not-a-number where it is dark.
    lit_share : float
        Share of the picture that has light.
    """

    model: str
    parameters: Array
    max_px: float
    rms_px: float
    errors: Array
    lit_share: float

    @property
    def named(self) -> dict[str, float]:
        """The parameters by their names."""
        names = (*_INTRINSICS, *COEFFICIENTS[self.model])
        return dict(zip(names, self.parameters.tolist(), strict=True))

    @property
    def coefficients(self) -> list[float]:
        """The coefficients in the order of OpenCV."""
        coefficients: list[float] = self.parameters[4:].tolist()
        return coefficients

    def project(self, directions: Array) -> Array:
        """Return the places (n, 2) of directions (n, 3) in the picture: x right, y down, z ahead [pixels].

        Not-a-number for what the model does not see: z <= 0, behind the camera. ``kannala_brandt`` goes by the angle
        from the axis and sees beyond 90 degrees, up to the angle at which its radius no longer grows. What is seen
        may lie outside of the picture.
        """
        return project(self.model, self.parameters, np.atleast_2d(np.asarray(directions, np.float64)))


@dataclass(frozen=True)
class _Samples:
    """Places of a picture and their directions in the scene, where it has light.

    Attributes
    ----------
    places, directions : (n, 2), (n, 3) arrays
    weights : (n,) array
        How many places of the picture each stands for.
    middle : (2,) array or None
        Of a picture of which a quarter stands for all.
    """

    places: Array
    directions: Array
    weights: Array
    middle: Array | None = None


def calibrate(view: CameraView, model: str) -> Calibration:
    """Return a camera model fitted to a view.

    Raises
    ------
    InputError
        When the picture has too little light to fit anything to, or shows more than the model has places for.
    """
    if model not in COEFFICIENTS:
        raise InputError(f"model: unknown camera model (got {model}; allowed {', '.join(COEFFICIENTS)})")
    seen, checked, evenly_lit, lit_share = _samples(view)
    count = int(seen.weights.sum())
    if count < _LEAST_PLACES:
        raise InputError(
            f"{view.name}: the picture shows nothing to fit a camera model to: light reaches {count} of"
            f" {FITTED[0] * FITTED[1]} places (allowed: a film inside the image circle)"
        )
    ahead = np.concatenate([seen.directions, checked.directions])[:, 2]
    if model != BY_ANGLE and not (ahead > _LEAST_AHEAD).all():
        widest = np.degrees(np.arccos(seen.directions[:, 2].min()))
        raise InputError(
            f"{view.name}: {model} has no place for a direction {widest:.1f} degrees from the axis"
            f" (allowed: {BY_ANGLE}, or a film with less field)"
        )
    parameters = _fit_parameters(model, seen)
    off = placed(model, parameters, normal_points(model, checked.directions)) - checked.places
    errors = np.full((*evenly_lit.shape, 2), np.nan)
    errors[evenly_lit] = off[: np.count_nonzero(evenly_lit)]
    if seen.middle is not None:
        for axis, number in enumerate(CHECKED):
            errors = _mirror_errors(errors, number, axis)
    squares = off[:, 0] ** 2 + off[:, 1] ** 2
    max_px, rms_px = math.sqrt(squares.max()), math.sqrt(float(checked.weights @ squares / checked.weights.sum()))
    return Calibration(model, parameters, max_px, rms_px, errors, lit_share)


def _mirror_errors(errors: Array, count: int, axis: int) -> Array:
    """Return the errors of some columns (axis 0) or rows, given up to the one in the middle, by their mirror image."""
    first = errors[:, : count // 2] if axis == 0 else errors[: count // 2]
    other = np.flip(first, axis=1 - axis) * np.where(np.arange(2) == axis, -1.0, 1.0)
    return np.concatenate([errors, other], axis=1 - axis)


GOOD_PX = 0.05  # residual at which the search for the simplest model ends, where no other is given


def calibrate_best(view: CameraView, models: Sequence[str], allowed_px: float = GOOD_PX) -> Calibration:
    """Return the first model that errs by at most some pixels, or the best of those that fit at all."""
    fits: list[Calibration] = []
    refused: InputError | None = None
    for model in models:
        try:
            fits.append(calibrate(view, model))
        except InputError as problem:
            refused = problem
            continue
        if fits[-1].max_px <= allowed_px:
            return fits[-1]
    if not fits:
        assert refused is not None
        raise refused
    return min(fits, key=lambda fit: fit.max_px)


@lru_cache(maxsize=8)
def _samples(view: CameraView) -> tuple[_Samples, _Samples, Mask, float]:
    """Find the places that a fit goes by, and those that its residual is measured at.

    Returns
    -------
    seen, checked : _Samples
        Those of the residual are some spread evenly; then some along edges and diagonals, and where some of four
        neighbours have light and others none.
    evenly_lit : (rows, columns) array
        Which of the places have light that are spread evenly over a picture from edge to edge, or over its upper left
        quarter to the middle.
    lit_share : float
        Of the picture.
    """
    places, weights, even, lines = _places(view.size, mirrored=view.is_mirrored)
    directions, lit = view.directions(np.concatenate([places, even.reshape(-1, 2), lines]))
    n, m, shape = len(places), len(places) + even.shape[0] * even.shape[1], even.shape[:2]
    middle = np.array(view.size) / 2 if view.is_mirrored else None
    seen = _Samples(places[lit[:n]], directions[:n][lit[:n]], weights[lit[:n]], middle)
    lit_evenly = lit[n:m].reshape(shape)
    bright = lit[n:]
    checked = np.concatenate([even.reshape(-1, 2), lines])[bright]
    away = directions[n:][bright]
    of_lines = np.zeros(np.count_nonzero(lit[m:]))
    if lit_evenly.all():
        weights = np.outer(_simpson(shape[0]), _simpson(shape[1])).ravel()
        return seen, _Samples(checked, away, np.append(weights, of_lines)), lit_evenly, 1.0
    corners = np.stack([lit_evenly[:-1, :-1], lit_evenly[:-1, 1:], lit_evenly[1:, :-1], lit_evenly[1:, 1:]])
    whole = corners.all(axis=0)
    each = np.pad(whole.astype(np.float64), 1) / 4
    weights = (each[:-1, :-1] + each[:-1, 1:] + each[1:, :-1] + each[1:, 1:])[lit_evenly]
    within = (np.stack(np.meshgrid(*[np.arange(_FINER)] * 2), axis=-1).reshape(-1, 2) + 0.5) / _FINER
    mixed = np.argwhere(corners.any(axis=0) & ~whole)[:, None, ::-1]
    edge = (even[0, 0] + (mixed + within) * (even[1, 1] - even[0, 0])).reshape(-1, 2)
    there, shines = view.directions(edge)
    checked, away = np.concatenate([checked, edge[shines]]), np.concatenate([away, there[shines]])
    weights = np.concatenate([weights, of_lines, np.full(np.count_nonzero(shines), 1.0 / _FINER**2)])
    return seen, _Samples(checked, away, weights), lit_evenly, float(weights.sum()) / whole.size


def _simpson(count: int) -> Array:
    """Return the weights of Simpson's rule."""
    return np.array([1.0, *[4.0, 2.0] * ((count - 3) // 2), 4.0, 1.0])


@lru_cache(maxsize=8)
def _places(size: tuple[int, int], *, mirrored: bool) -> tuple[Array, Array, Array, Array]:
    """Return places (n, 2) of the fit and their weights, and those of the residual: spread evenly (rows, columns, 2),
    and along edges and diagonals (n, 2).
    """
    x, y, at_x, at_y = (
        np.linspace(0.0, side, n) for counts in (FITTED, CHECKED) for side, n in zip(size, counts, strict=True)
    )
    if mirrored:
        x, y, at_x, at_y = (values[: (len(values) + 1) // 2] for values in (x, y, at_x, at_y))
    places, even = (np.stack(np.meshgrid(*axes), axis=-1) for axes in ((x, y), (at_x, at_y)))
    weights = (
        np.prod(np.where(places < np.array(size) / 2, 2.0, 1.0), axis=-1) if mirrored else np.ones(places.shape[:2])
    )
    steps = np.linspace(0.0, 1.0, _FINER * max(CHECKED) + 1)
    zero = np.zeros_like(steps)
    rest = () if mirrored else ((steps, zero + 1.0), (zero + 1.0, steps), (steps, 1.0 - steps))
    lines = np.concatenate([np.stack(pair, axis=1) for pair in ((steps, zero), (zero, steps), (steps, steps), *rest)])
    return places.reshape(-1, 2), weights.ravel(), even, lines * (at_x[-1], at_y[-1])


def _fit_parameters(model: str, seen: _Samples) -> Array:
    """Return the parameters whose sum of squared errors is least."""
    points = normal_points(model, seen.directions)
    start = _pinhole(points, seen)
    if model == "pinhole":
        return start
    names = (*_INTRINSICS, *COEFFICIENTS[model])
    # What does not look the same in a mirror is zero where the picture does.
    free = [k for k, name in enumerate(names) if seen.middle is None or name[0] in "fk"]
    fixed, root = np.concatenate([start, np.zeros(len(names) - 4)]), np.sqrt(seen.weights)[:, None]

    def whole(values: Array) -> Array:
        parameters = fixed.copy()
        parameters[free] = values
        return parameters

    def errors(values: Array) -> Array:
        parameters = whole(values)
        bent = distorted(model, parameters[4:], points)
        return np.asarray((bent * parameters[:2] + parameters[2:4] - seen.places) * root).ravel()

    def derivatives(values: Array) -> Array:
        return (slopes(model, whole(values), points)[..., free] * root[..., None]).reshape(2 * len(points), -1)

    count = len(COEFFICIENTS[model])
    if count in (4, 5):
        return whole(_least_squares(errors, derivatives, _radial_start(model, points, seen)[free], _NEAR))
    simpler = _fit_parameters("brown_conrady" if count == 8 else "rational", seen)
    starts = [np.concatenate([simpler, np.zeros(4 + count - len(simpler))])]
    if count == 8:
        starts.append(_rational_start(simpler, points, seen.places))
    square = np.sum(points * points, axis=1)
    solutions = [whole(_least_squares(errors, derivatives, begin[free])) for begin in starts]
    good = [one for one in solutions if _denominator(one[4:], np.linspace(0.0, 1.1 * square.max(), 200)).min() > 0]
    return min(good or [starts[0]], key=lambda one: float(np.sum(errors(one[free]) ** 2)))


def _pinhole(points: Array, seen: _Samples) -> Array:
    """Return fx, fy, cx, cy by a linear fit."""
    weights, places, middle = seen.weights[:, None], seen.places, seen.middle
    none = np.zeros(2)
    centre, mean = (none, middle) if middle is not None else (points.mean(axis=0), places.mean(axis=0))
    across = (points - centre) * weights
    focal = np.sum(across * (places - mean), axis=0) / np.sum(across * (points - centre), axis=0)
    return np.concatenate([focal, mean - focal * centre])


def _radial_start(model: str, points: Array, seen: _Samples) -> Array:
    """Return parameters by a linear fit: of places x that are cx and x times a polynomial of the squared distance."""
    square = np.sum(points * points, axis=1)
    reach, count = square.max(), len(COEFFICIENTS[model]) - 2 * (model != BY_ANGLE)
    powers = np.ones((len(points), count + 1))
    powers[:, 1:] = (square / reach)[:, None]
    np.multiply.accumulate(powers, axis=1, out=powers)
    middle, axes = seen.middle, []
    for k in (0, 1):
        rows, offset = points[:, k, None] * powers, 0.0 if middle is None else middle[k]
        if middle is None:
            rows = np.column_stack([rows, np.ones(len(points))])
        weighted = rows.T * seen.weights
        solution = np.linalg.solve(weighted @ rows, weighted @ (seen.places[:, k] - offset))
        axes.append(solution if middle is None else [*solution, offset])
    (fx, *_, cx), (fy, *_, cy) = axes
    bent = np.mean([np.array(values[1:-1]) / values[0] for values in axes], axis=0) / reach ** np.arange(1, count + 1)
    if model == BY_ANGLE:
        return np.array([fx, fy, cx, cy, *bent])
    k1, k2, k3 = bent
    return np.array([fx, fy, cx, cy, k1, k2, 0.0, 0.0, k3])


def _rational_start(simpler: Array, points: Array, places: Array) -> Array:
    """Return parameters of the rational model by a linear fit: numerator less distortion times denominator is zero."""
    square = np.sum(points * points, axis=1)
    scale = np.sum((places - simpler[2:4]) / simpler[:2] * points, axis=1) / np.maximum(square, 1e-12)
    reach = square.max()
    powers = (square / reach)[:, None] ** [1.0, 2.0, 3.0]
    rows = np.concatenate([powers, -scale[:, None] * powers], axis=1)
    solution = np.linalg.lstsq(rows, scale - 1.0, rcond=1e-10)[0] / np.tile(reach ** np.array([1.0, 2.0, 3.0]), 2)
    k1, k2, k3, k4, k5, k6 = solution
    return np.array([*simpler[:4], k1, k2, 0.0, 0.0, k3, k4, k5, k6])


def _least_squares(
    errors: Callable[[Array], Array], derivatives: Callable[[Array], Array], start: Array, damping: float = _DAMPING
) -> Array:
    """Return the parameters at which the sum of squared errors is least, from a start that is not far."""
    parameters, error = start, errors(start)
    cost = float(error @ error)
    for _ in range(_ROUNDS):
        rows = derivatives(parameters)
        normal, gradient = rows.T @ rows, rows.T @ error
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        while damping < _TOO_HIGH:
            scaled = normal / np.outer(scale, scale) + damping * np.eye(len(scale))
            step = np.linalg.solve(scaled, gradient / scale) / scale
            if gradient @ step <= _SMALL * cost:  # what the step can gain; larger damping gains less
                return parameters
            trial = parameters - step
            with np.errstate(all="ignore"):
                new = errors(trial)
                improved = float(new @ new)
            if improved < cost:
                break
            damping *= 10
        else:
            break
        done = cost - improved <= _SMALL * cost
        parameters, error, cost, damping = trial, new, improved, max(damping / 10, _TOO_LOW)
        if done:
            break
    return parameters
