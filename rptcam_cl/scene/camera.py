"""The camera models, where a camera stands and looks, and the movements of a view camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.as_built import Heat
from rptcam_cl.scene import lens_settings, quantities
from rptcam_cl.scene.base import AlsoAccepts, Alternatives, SceneModel, read_switch, refuse
from rptcam_cl.scene.placement import CameraMotion, Vector, place_between

#
# The movements of a view camera: how its film stands behind the lens.
#
# The lens stays where the pose has it, on the line from the eye to the target; the eye is the point of the axis where
# the film stands without movements. The film is first turned about its centre, then moved. Rise and shift are named
# by what the picture gains: as a lens turns the picture over, the film itself goes down and to the left. Tilt and
# swing turn the film about the right and the up of the camera, by the right-hand rule. The lower half of the picture
# lies on the upper half of the film, so that a film whose top leans back focuses nearer at the bottom of the picture.

Turn = Annotated[float, Field(ge=-80, le=80), quantities.NUMBER]
_Scatter = Annotated[
    tuple[
        Annotated[float, Field(ge=0), quantities.NUMBER],
        Annotated[float, Field(ge=1e-12), quantities.NUMBER],
        Annotated[float, Field(ge=0, le=10), quantities.NUMBER],
    ],
    BeforeValidator(quantities.list_of(3, "three numbers [A, B, g]")),
]
Move = Annotated[float, Field(ge=-1e6, le=1e6), quantities.NUMBER]


class SensorGrating(SceneModel):
    """Light that the pixels of the sensor reflect in orders, as a grating does."""

    pitch_um: Annotated[float, Field(ge=0.5, le=100), quantities.NUMBER]
    """Period of what reflects, along rows and columns [um]: a pixel, or two where colours of pixels differ."""

    reflectance: Annotated[float, Field(ge=0, lt=1), quantities.NUMBER] = 0.05
    """Share of the light that all orders have together."""

    spread: Annotated[float, Field(gt=0, le=1), quantities.NUMBER] = 0.2
    """Sine between a mirrored ray and orders that have exp(-1/2) of its light, along rows or columns."""


Triple = tuple[float, float, float]


class Movements(SceneModel):
    """How the film stands behind the lens: rise and shift move it, tilt and swing turn it about its centre."""

    rise_mm: Move = 0.0
    """How far the film goes down, so that the picture shows more of what is above [mm]."""

    shift_mm: Move = 0.0
    """How far the film goes to the left, so that the picture shows more of what is on the right [mm]."""

    tilt_degrees: Turn = 0.0
    """Turn about the horizontal; positive: the top of the film leans back, what is low in the picture is sharp near."""

    swing_degrees: Turn = 0.0
    """Turn about the vertical, after the tilt; positive: the left of the film leans back, what is right in the picture
    is sharp near."""

    @property
    def turns(self) -> bool:
        """Whether the film is turned out of the plane across the axis."""
        return self.tilt_degrees != 0.0 or self.swing_degrees != 0.0

    def sides(self) -> tuple[Triple, Triple]:
        """Return unit vectors along the film to the right and up: x to the right, y up, z away from the lens."""
        tilt, swing = math.radians(self.tilt_degrees), math.radians(self.swing_degrees)
        across = (math.cos(swing), 0.0, -math.sin(swing))
        up = (math.sin(swing) * math.sin(tilt), math.cos(tilt), math.cos(swing) * math.sin(tilt))
        return across, up


NO_MOVEMENTS = Movements()


# Where a camera stands and looks, at rest and while it moves.

# Sine of the smallest angle between up and the viewing direction that still fixes the roll in float32.
_SMALLEST_ROLL_SINE = 1e-6


class Pose(SceneModel):
    """Where a camera stands and looks. It looks along -z of its own frame, with +y up and +x to the right."""

    eye: quantities.Position
    """Where the camera stands [scene units]; with a `lens`, the centre of the film, unless it `stands_at` another
    place."""

    target: quantities.Position
    """A point that the camera looks at [scene units]."""

    up: quantities.Direction = (0.0, 1.0, 0.0)
    """Direction that appears upwards; any length, not parallel to the view."""

    flip: bool = Field(default=True, strict=True)
    """Whether the picture is turned upright; false keeps the inverted image as it lies on the film."""

    motion: CameraMotion = ()
    """Where it is over time; without keyframes it stands still."""

    diffraction: Annotated[Literal["off", "auto", "on"], BeforeValidator(read_switch)] = "off"
    """Whether the opening diffracts the light; `auto`: where the Airy radius is half a pixel or more."""

    stop: lens_settings.Stop = lens_settings.CLEAN
    """What lies in the plane of the stop."""

    @model_validator(mode="after")
    def _check_stop(self) -> Self:
        if self.stop.dirt is not None and self.diffraction == "off":
            raise refuse(
                "scatters light by diffraction, which is off",
                allowed="with diffraction: on or auto",
                path=("stop", "dirt"),
            )
        return self

    @model_validator(mode="after")
    def _check_pose(self) -> Self:
        forward = np.subtract(self.target, self.eye)
        distance = float(np.linalg.norm(forward))
        if distance < quantities.SMALLEST_LENGTH:
            raise refuse("equals the eye, so there is no viewing direction", got=list(self.target), path=("target",))
        roll = quantities.cross(forward / distance, np.divide(self.up, np.linalg.norm(self.up)))
        if np.linalg.norm(roll) < _SMALLEST_ROLL_SINE:
            raise refuse(
                "is parallel to the viewing direction", got=list(self.up), allowed="any other direction", path=("up",)
            )
        return self

    @model_validator(mode="after")
    def _check_motion(self) -> Self:
        if not self.motion:
            return self
        own = np.array([self.eye, self.target, self.up])
        poses = np.array([self._pose_of(index, own) for index in range(len(self.motion))])
        following = np.concatenate([poses[1:], poses[-1:]])
        for index in np.flatnonzero(~_turns_little(poses, following)).tolist():
            if not _keeps_a_view(poses[index], following[index]):
                raise refuse(
                    "leads to a moment without a viewing direction, or with one parallel to up",
                    got=self.motion[index].time_s,
                    allowed="eye, target and up that give a view at every moment; keyframes in between help",
                    path=("motion", index),
                )
        return self

    def pose_at(self, time_s: float) -> Vector:
        """Return eye, target and up at a moment, (3, 3): each goes straight from keyframe to keyframe."""
        own = np.array([self.eye, self.target, self.up])
        if not self.motion:
            return own
        index, share = place_between(self.motion, time_s)
        first, second = (self._pose_of(place, own) for place in (index, min(index + 1, len(self.motion) - 1)))
        return np.asarray(first + share * (second - first))

    def _pose_of(self, index: int, own: Vector) -> Vector:
        frame = self.motion[index]
        given = (frame.eye, frame.target, frame.up)
        return np.array([row if value is None else value for value, row in zip(given, own, strict=True)])

    def world_from_camera(self) -> NDArray[np.float64]:
        """Return the 4x4 matrix whose columns are right, up, back and eye, in scene units; keyframes do not count."""
        return pose_matrix(np.array([self.eye, self.target, self.up]))


def pose_matrix(pose: Vector) -> Vector:
    """Return the 4x4 matrix whose columns are right, up, back and eye, of eye, target and up (3, 3)."""
    eye, target, up = pose
    back = (eye - target) / np.linalg.norm(eye - target)
    right = quantities.cross(up, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = right, quantities.cross(back, right), back, eye
    return matrix


def _turns_little(first: Vector, second: Vector) -> NDArray[np.bool_]:
    """Return where (n,) a camera between two poses (n, 3, 3) surely keeps a view, because its turn is small."""
    view, up = first[:, 1] - first[:, 0], first[:, 2]
    view_step, up_step = second[:, 1] - second[:, 0] - view, second[:, 2] - up
    view_length, up_length, view_change, up_change = (
        np.linalg.norm(vectors, axis=1) for vectors in (view, up, view_step, up_step)
    )
    side = np.linalg.norm(np.cross(up, view), axis=1)
    change = up_change * view_length + up_length * view_change + up_change * view_change
    return np.asarray(side - change > 0.01 * view_length * up_length)


def _keeps_a_view(first: Vector, second: Vector) -> bool:
    """Return whether a camera that goes from one pose to another always has a view and an upright."""
    Polynomial = np.polynomial.Polynomial  # whose module is read where it is used
    views = [Polynomial([a, b - a]) for a, b in zip(first[1] - first[0], second[1] - second[0], strict=True)]
    ups = [Polynomial([a, b - a]) for a, b in zip(first[2], second[2], strict=True)]
    sides = [ups[k] * views[k - 2] - ups[k - 2] * views[k] for k in (1, 2, 0)]
    side2, view2, up2 = (sum((part * part for part in parts), Polynomial([0.0])) for parts in (sides, views, ups))
    turning = np.real(side2.deriv().roots())
    least = _SMALLEST_ROLL_SINE**2 * max(view2(0.0), view2(1.0)) * max(up2(0.0), up2(1.0))
    return all(side2(share) > least for share in (0.0, 1.0, *turning[(turning > 0) & (turning < 1)]))


# Cameras of all kinds: what the other parts of the program ask of one.

Degrees = Annotated[float, Field(gt=0, lt=180), quantities.NUMBER]
_FovAxis = Literal["horizontal", "vertical", "diagonal"]
Keys = dict[str, Any]
NOT_FOUND_YET = "camera.focus.auto: the focus is found by render() or autofocus(), before the camera can be used"
FNumber = Annotated[float, Field(ge=1e-2, le=1e6), quantities.NUMBER]


class CameraKind(Pose):
    """A camera of any kind: what its keys answer to the rest of the program, here as a camera without a lens does.

    A kind overrides what it has. What needs the lens itself, or rays, stands in `rendering/cameras/kinds.py`.
    """

    if TYPE_CHECKING:
        kind: str  # declared by each kind, after its other keys

    alternatives: ClassVar[tuple[Alternatives, ...]] = ()
    sees_all_around: ClassVar[bool] = False
    opens: ClassVar[bool] = False
    """Whether it has a lens opening, that diffracts and lights the film."""

    focuses: ClassVar[bool] = False
    """Whether there is a plane in focus."""

    fixed_outline: ClassVar[str | None] = "this camera has no opening"
    """Why the outline of the opening cannot be chosen; None where it can."""

    @property
    def lens_camera(self) -> LensCamera | None:
        """This camera, where it has a lens of surfaces."""
        return None

    @property
    def traced_camera(self) -> RealisticCamera | None:
        """This camera, where rays are traced through its surfaces."""
        return None

    @property
    def ideal_lens(self) -> ThinLensCamera | None:
        """This camera, where it has an ideal lens and no surfaces."""
        return None

    @property
    def has_opening(self) -> bool:
        """Whether its opening has a size, so that the exposure goes by its light."""
        return self.opens

    @property
    def stands_by_pupil(self) -> bool:
        """Whether its eye is the entrance pupil of a lens, so that where its film is follows from the lens."""
        return getattr(self, "stands_at", "film") == "entrance_pupil"

    @property
    def film_movements(self) -> Movements:
        """How its film stands; straight where it has no key for that."""
        movements: Movements = getattr(self, "movements", NO_MOVEMENTS)
        return movements

    @property
    def outline(self) -> lens_settings.Aperture:
        """The outline of its opening; round where it has no key for that."""
        aperture: lens_settings.Aperture = getattr(self, "aperture", lens_settings.ROUND)
        return aperture

    @property
    def field_of_view(self) -> tuple[float, _FovAxis] | None:
        """Full field of view [degrees] and the side of the film that it spans, where keys say so."""
        degrees: float | None = getattr(self, "fov_degrees", None)
        return None if degrees is None else (degrees, getattr(self, "fov_axis", "horizontal"))

    @property
    def autofocus(self) -> lens_settings.AutoFocus | None:
        """The settings of autofocus; None where the focus is given, or there is none."""
        focus = getattr(self, "focus", None)
        return None if focus is None else focus.auto

    @property
    def followed(self) -> str | None:
        """The name of the object that the focus follows."""
        focus = getattr(self, "focus", None)
        return None if focus is None else focus.object

    def check_film(self, resolution: tuple[int, int]) -> None:
        """Raise if the film is not one for this camera."""

    def focus_keys(self, distance_m: float) -> Keys:
        """Return the keys that focus it at a distance [m]; None removes a key."""
        raise self.lacks("a focus to set")

    def following(self, middle: tuple[float, float, float], ahead_m: float) -> Keys:
        """Return the values that focus it on an object, by its middle [scene units] and how far that lies ahead."""
        raise self.lacks("a focus to set")

    def distance_in_focus(self, metres_per_unit: float) -> float | None:
        """Return how far in front of the eye the plane in focus lies [scene units]; None where keys do not say."""
        return None

    def f_number_keys(self, f_number: float) -> Keys | None:
        """Return the keys that set an f-number; None without an opening that has one."""
        return None

    def zoom_keys(self, focal_mm: float, now_mm: float) -> Keys | None:
        """Return the keys that change the field of view as from one focal length to another [mm]; None without any."""
        field = self.field_of_view
        if field is None:
            return None
        tangent = math.tan(math.radians(field[0]) / 2) * now_mm / focal_mm
        return {"fov_degrees": math.degrees(2 * math.atan(tangent))}

    def lacks(self, what: str) -> InputError:
        """Return the error of asking a camera for what its kind has not."""
        return InputError(f"camera.kind: {self.kind} lacks {what}")

    @model_validator(mode="after")
    def _check_diffraction(self) -> Self:
        if self.diffraction == "on" and not self.has_opening:
            *others, last = kinds_where(lambda kind: kind.opens)
            raise refuse(
                "needs an opening of a size, which this camera has not",
                got="on",
                allowed=f"off or auto, or a camera with an f-number: {', '.join(others)} or {last}",
                path=("diffraction",),
            )
        if self.diffraction == "on" and self.film_movements.turns:
            raise refuse(
                "is known on a film across the axis alone",
                got="on",
                allowed="off or auto with tilt or swing",
                path=("diffraction",),
            )
        return self


class PinholeCamera(CameraKind):
    """A camera without a lens: everything is sharp."""

    kind: Literal["pinhole"]
    """Camera model."""

    fov_degrees: Degrees
    """Full field of view along `fov_axis` [degrees]."""

    fov_axis: _FovAxis = "horizontal"
    """Side of the film that `fov_degrees` spans."""

    near_m: Annotated[float, Field(ge=0, le=1e12), quantities.NUMBER] = 0.0
    """Distance along the axis below which nothing is seen [m]."""

    movements: Movements = NO_MOVEMENTS
    """How the film stands behind the lens; straight across its axis by default."""


class OrthographicCamera(CameraKind):
    """A parallel view, without perspective: of plans, elevations and maps. Rays start in the plane of the eye."""

    kind: Literal["orthographic"]
    """Camera model."""

    width_m: Annotated[float, Field(ge=1e-9, le=1e12), quantities.NUMBER]
    """Width of what the picture shows [m]; its height follows from the sides of the film."""

    near_m: Annotated[float, Field(ge=0, le=1e12), quantities.NUMBER] = 0.0
    """Distance along the axis below which nothing is seen [m]."""

    def zoom_keys(self, focal_mm: float, now_mm: float) -> Keys | None:
        """Return the keys that change the width as a focal length would change the field of view."""
        return {"width_m": self.width_m * now_mm / focal_mm}


class EnvironmentCamera(CameraKind):
    """A camera that sees the whole sphere: 360 degrees across, 180 degrees down. The film must be 2:1."""

    sees_all_around: ClassVar[bool] = True

    kind: Literal["environment"]
    """Camera model."""

    def check_film(self, resolution: tuple[int, int]) -> None:
        """Raise if the film is not twice as wide as high."""
        width, height = resolution
        if width != 2 * height:
            raise refuse(
                "does not fit an environment camera, which sees 360 by 180 degrees",
                got=[width, height],
                allowed=f"twice as wide as high, for instance [{2 * height}, {height}]",
                path=("film", "resolution"),
            )


class ThinLensCamera(CameraKind):
    """An ideal lens of no thickness: one plane is sharp.

    Exactly one of `fov_degrees` and `focal_length_mm`, of `aperture_radius_m` and `f_number`, and of
    `focus_distance_m` and `focus`.
    """

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("fov_degrees", "focal_length_mm"), required=True),
        Alternatives(("aperture_radius_m", "f_number"), required=True),
        Alternatives(("focus_distance_m", "focus"), required=True),
    )

    opens = focuses = True
    fixed_outline = None

    kind: Literal["thin_lens"]
    """Camera model."""

    fov_degrees: Degrees | None = None
    """Full field of view along `fov_axis` [degrees]."""

    fov_axis: _FovAxis = "horizontal"
    """Side of the film that `fov_degrees` spans."""

    focal_length_mm: quantities.Millimetres | None = None
    """Focal length [mm]."""

    aperture_radius_m: Annotated[float, Field(ge=0, le=1e12), quantities.NUMBER] | None = None
    """Radius of the lens opening [m]; 0 makes a pinhole."""

    f_number: FNumber | None = None
    """Focal length divided by the diameter of the opening."""

    focus_distance_m: quantities.Metres | None = None
    """Distance of the plane of focus from the eye along the axis [m]."""

    focus: lens_settings.FoundFocus | None = None
    """Autofocus, or an object to follow, in its place."""

    aperture: lens_settings.Aperture = lens_settings.ROUND
    """Outline of the opening."""

    movements: Movements = NO_MOVEMENTS
    """How the film stands behind the lens; straight across its axis by default."""

    @property
    def ideal_lens(self) -> ThinLensCamera:
        """This camera."""
        return self

    @property
    def has_opening(self) -> bool:
        """Whether its opening has a size, so that the exposure goes by its light."""
        return self.aperture_radius_m != 0

    def focus_keys(self, distance_m: float) -> Keys:
        """Return the keys that focus it at a distance from the lens [m]."""
        return {"focus_distance_m": distance_m, "focus": None}

    def following(self, middle: tuple[float, float, float], ahead_m: float) -> Keys:
        """Return the values that focus it on the plane of an object."""
        return {"focus": None, "focus_distance_m": ahead_m}

    def distance_in_focus(self, metres_per_unit: float) -> float | None:
        """Return the distance of the plane of focus [scene units]; None before it is found."""
        return None if self.focus_distance_m is None else self.focus_distance_m / metres_per_unit

    def f_number_keys(self, f_number: float) -> Keys | None:
        """Return the keys that set an f-number; None without an opening."""
        return {"f_number": f_number, "aperture_radius_m": None} if self.has_opening else None

    def zoom_keys(self, focal_mm: float, now_mm: float) -> Keys | None:
        """Return the keys that change the focal length, or the field of view where that is given."""
        return super().zoom_keys(focal_mm, now_mm) or {"focal_length_mm": focal_mm}

    @property
    def plane_m(self) -> float:
        """Distance of the plane of focus [m].

        Raises
        ------
        InputError
            Before autofocus has found it.
        """
        if self.focus_distance_m is None:
            raise InputError(NOT_FOUND_YET)
        return self.focus_distance_m

    @model_validator(mode="after")
    def _check_focus(self) -> Self:
        plane = self.focus_distance_m
        if self.focal_length_mm is not None and plane is not None and plane * 1e3 <= self.focal_length_mm:
            raise refuse(
                "lies within the focal length, so no real image forms",
                got=self.focus_distance_m,
                allowed=f"more than {self.focal_length_mm * 1e-3:g}",
                path=("focus_distance_m",),
            )
        return self


class LensCamera(CameraKind):
    """A camera with a lens of surfaces.

    At most one of `stop_diameter_mm` and `f_number`, and at most one of `zoom` and `focal_length_mm`.
    """

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("stop_diameter_mm", "f_number"), required=False),
        Alternatives(("zoom", "focal_length_mm"), required=False),
    )

    opens = focuses = True

    lens: lens_settings.LensOrDesign
    """The lens: a name, a file in the scene's folder, or a prescription written out as a mapping; or a mapping with one
    of these as `design` and how the lens differs from it."""

    zoom: Annotated[str, Field(max_length=200)] | None = None
    """Position of a zoom lens by its name in the lens file; the first one by default."""

    focal_length_mm: quantities.Millimetres | None = None
    """Focal length that a zoom lens is set to, between its named positions [mm]."""

    focus: lens_settings.Focus
    """Where the lens is focused."""

    stop_diameter_mm: quantities.Millimetres | None = None
    """Diameter of the stop [mm]; as in the lens file by default."""

    f_number: FNumber | None = None
    """F-number that the stop is set to; as in the lens file by default."""

    wavelength_nm: Annotated[float, Field(ge=200, le=3000), quantities.NUMBER] = LINE_D_NM
    """Wavelength of the indices of refraction [nm]; the helium d line by default."""

    transmission: Annotated[lens_settings.Transmission, AlsoAccepts(lens_settings.EVERY_FORM)] = lens_settings.IDEAL
    """What the lens takes from the light; nothing by default."""

    movements: Movements = NO_MOVEMENTS
    """How the film stands behind the lens; straight across its axis by default."""

    stands_at: Literal["film", "entrance_pupil"] = "film"
    """What of the camera is at the eye: the centre of its film, or the lens's entrance pupil, the centre of its
    perspective."""

    @property
    def lens_camera(self) -> LensCamera:
        """This camera."""
        return self

    def focus_keys(self, distance_m: float) -> Keys:
        """Return the keys that focus it at a distance from the film [m], by the method of before."""
        focus = self.focus
        kept = {} if focus.method == "thick" else {"method": focus.method, "field": focus.field}
        return {"focus": {"distance_m": distance_m} | {key: value for key, value in kept.items() if value is not None}}

    def following(self, middle: tuple[float, float, float], ahead_m: float) -> Keys:
        """Return the values that focus it on the middle of an object."""
        return {"focus": lens_settings.Focus(point=middle, method=self.focus.method, field=self.focus.field)}

    def distance_in_focus(self, metres_per_unit: float) -> float | None:
        """Return the distance that is set [scene units]; None where the film or the group is placed, or to be."""
        if self.focus.point is not None:
            return self.ahead(self.focus.point)
        distance_m = self.focus.distance_m or self.focus.front_distance_m
        return None if distance_m is None else distance_m / metres_per_unit

    def f_number_keys(self, f_number: float) -> Keys | None:
        """Return the keys that set an f-number."""
        return {"f_number": f_number, "stop_diameter_mm": None}

    @property
    def design(self) -> str | dict[str, Any]:
        """The name, file or prescription of the lens."""
        return self.lens.design if isinstance(self.lens, lens_settings.RealLens) else self.lens

    @property
    def as_built(self) -> lens_settings.AsBuilt | None:
        """Which copy of the lens it is; None for the design."""
        return self.lens.as_built if isinstance(self.lens, lens_settings.RealLens) else None

    @property
    def heat(self) -> Heat | None:
        """What the lens is exposed to; None at 20 degrees and standard pressure."""
        return self.lens.heat if isinstance(self.lens, lens_settings.RealLens) else None

    def ahead(self, point: tuple[float, float, float]) -> float:
        """Return how far in front of the eye a point lies along the axis [scene units]."""
        return float(np.dot(np.subtract(self.eye, point), self.world_from_camera()[:3, 2]))

    @model_validator(mode="after")
    def _check_focus(self) -> Self:
        if self.focus.point is not None and not self.ahead(self.focus.point) > 0:
            raise refuse(
                "does not lie in front of the film",
                got=list(self.focus.point),
                allowed="a point on the side that the camera looks to",
                path=("focus", "point"),
            )
        if self.stands_by_pupil and self.focus.auto is not None:
            raise refuse(
                "moves the film, which autofocus has in its place",
                got=self.stands_at,
                allowed="film, or a focus at a distance, a point or an object",
                path=("stands_at",),
            )
        return self


class ThickLensCamera(LensCamera):
    """A lens by its cardinal points and pupils: every aberration and every rim but the stop left out."""

    fixed_outline = "the stop of a thick lens is round"

    kind: Literal["thick_lens"]
    """Camera model."""

    @model_validator(mode="after")
    def _check_copy(self) -> Self:
        if self.as_built is not None:
            raise refuse(
                "has elements beside the axis, which a thick lens leaves out",
                got=self.as_built.percentile,
                allowed="kind: realistic, or no as_built",
                path=("lens", "as_built"),
            )
        return self


class RealisticCamera(LensCamera):
    """A real lens: every ray is traced through every surface."""

    fixed_outline = None

    kind: Literal["realistic"]
    """Camera model."""

    aperture: lens_settings.Aperture = lens_settings.ROUND
    """Shape of the stop, within the circle of its diameter."""

    pupil: Literal["auto", "rear", "thick", "bounds", "tight", "shared"] = "auto"
    """Where rays aim: the whole rear element, the paraxial exit pupil, a box per film cell, the pupil's true outline
    (auto), or one that the states of a lens nearby share, for many pictures. It changes noise only."""

    rays: Literal["traced", "fitted"] = "traced"
    """How rays come through the lens: traced through every surface, or by polynomials fitted to such rays, with
    an error of a quarter of a pixel at most."""

    precision: Literal["single", "double"] = "single"
    """Arithmetic in which rays go through the lens: float32, or float64 on devices that have it; everything else is
    float32."""

    accuracy: Annotated[lens_settings.Accuracy, AlsoAccepts(lens_settings.AUTO)] | None = None
    """Largest error of a cheaper camera model that may replace the lens; by default every ray is traced."""

    ghosts: Annotated[Literal["off", "on"], BeforeValidator(read_switch)] = "off"
    """Whether lamps and suns make ghosts: light that two surfaces reflect onto the film. Needs a `transmission`."""

    ghost_order: Literal[2, 4] = 2
    """Most reflections of ghosts: 4 adds ways that four surfaces reflect."""

    barrel_reflectance: Annotated[float, Field(ge=0, lt=1), quantities.NUMBER] = 0.0
    """Share that rims behind the stop scatter evenly to the film, with `ghosts`; they count as lit like the film."""

    front_scatter: _Scatter | None = None
    """A, B and g of what the front of the lens scatters, with `ghosts`: radiance over irradiance is A / (B + d^g), d
    being how far the sines of the directions lie apart."""

    sensor_grating: SensorGrating | None = None
    """Light that the sensor reflects in orders and the lens sends back, with `ghosts`."""

    @property
    def traced_camera(self) -> RealisticCamera:
        """This camera."""
        return self

    @model_validator(mode="after")
    def _check_ghosts(self) -> Self:
        fault = "" if self.transmission.fresnel else "needs surfaces that reflect, and transmission: ideal has none"
        if self.movements != NO_MOVEMENTS:
            fault = "are known of a film in its place alone"
        for key in ("ghost_order", "barrel_reflectance", "front_scatter", "sensor_grating"):
            default = type(self).model_fields[key].default
            if (given := getattr(self, key)) != default and self.ghosts == "off":
                allowed = f"{'none' if default is None else f'{default:g}'}, or ghosts: on beside it"
                raise refuse("is light of ghosts", got=given, allowed=allowed, path=(key,))
        if self.ghosts == "on" and fault:
            allowed = "off, or without movements and with a transmission: bare, coated or {coating: mgf2}"
            raise refuse(fault, got="on", allowed=allowed, path=("ghosts",))
        return self

    @model_validator(mode="after")
    def _check_movements(self) -> Self:
        for key, given in (("rays", self.rays == "fitted"), ("accuracy", self.accuracy is not None)):
            if given and self.movements != NO_MOVEMENTS:
                raise refuse(
                    "stands for a film across the axis alone",
                    got=getattr(self, key) if key == "rays" else self.accuracy.model_dump() if self.accuracy else None,
                    allowed="movements with traced rays, without camera.accuracy",
                    path=(key,),
                )
        return self


Camera = Annotated[
    PinholeCamera | OrthographicCamera | EnvironmentCamera | ThinLensCamera | ThickLensCamera | RealisticCamera,
    Field(discriminator="kind"),
]


CAMERA_KINDS: tuple[type[CameraKind], ...] = get_args(get_args(Camera)[0])


def kinds_where(has: Callable[[type[CameraKind]], bool]) -> list[str]:
    """Return the names of the kinds that have something."""
    return [get_args(kind.model_fields["kind"].annotation)[0] for kind in CAMERA_KINDS if has(kind)]


# Cameras made of others. What each key belongs to says what goes with it; a key that belongs to nothing fails a test.

KEY_GROUPS: dict[str, set[str]] = {
    "kind": {"kind"},
    "pose": {"eye", "target", "up", "motion"},
    "reference": {"stands_at"},
    "film": {"flip", "movements"},
    "near": {"near_m"},
    "view": {"fov_degrees", "fov_axis", "width_m"},
    "lens": {"lens", "zoom", "focal_length_mm"},
    "focus": {"focus", "focus_distance_m"},
    "opening": {"aperture_radius_m", "f_number", "stop_diameter_mm"},
    "outline": {"aperture"},
    "diffraction": {"diffraction", "stop"},
    "glass": {"wavelength_nm", "transmission"},
    "rays": {"pupil", "rays", "precision", "accuracy"},
    "ghosts": {"ghosts", "ghost_order", "barrel_reflectance", "front_scatter", "sensor_grating"},
}
FOLLOWS_THE_FILM = KEY_GROUPS["diffraction"] | KEY_GROUPS["ghosts"]
ANOTHER_LENS = KEY_GROUPS["kind"] | KEY_GROUPS["lens"]  # after which a focus that was found is void


def keys_as(camera: CameraKind, own: Keys, *, without: Iterable[str] = ()) -> tuple[Keys, tuple[str, ...]]:
    """Return the keys of a camera of another kind, or with another lens, and the names of those that it leaves out.

    It keeps every key that was given and that its kind has, but for those of an opening where it has none.

    Parameters
    ----------
    camera
        The camera in whose place it stands.
    own
        Its `kind`, and the keys that are its own.
    without
        Names of `KEY_GROUPS` that its own keys replace.
    """
    kind = next(each for each in CAMERA_KINDS if get_args(each.model_fields["kind"].annotation)[0] == own["kind"])
    replaced = set[str]().union(*(KEY_GROUPS[group] for group in ("kind", *without)))
    unknown = set[str]() if kind.opens else KEY_GROUPS["diffraction"]
    given = {name: getattr(camera, name) for name in camera.model_fields_set if name not in own.keys() | replaced}
    kept = {name: value for name, value in given.items() if name in kind.model_fields and name not in unknown}
    fields = type(camera).model_fields
    left_out = [name for name in fields if name in given.keys() - kept and given[name] != fields[name].default]
    return kept | own, tuple(left_out)


def plain_keys(camera: CameraKind) -> Keys:
    """Return the keys of a camera as a scene file has them, without those that are as by default."""
    return camera.model_dump(mode="json", exclude_none=True, exclude_defaults=True) | {"kind": camera.kind}
