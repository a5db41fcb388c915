"""A lens: first-order data, where the film must stand, its zoom positions and moving groups. Millimetres, float64."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.optics import surface as surface_rows
from rptcam_cl.optics.ray_trace import LensTransmission, Rays, trace
from rptcam_cl.optics.shapes import Biconic, Grating, IdealLens, Transposed
from rptcam_cl.optics.surface import FocusState, Prescription, Region, StopMask, StopShape, Surface, SurfacePose

#
# First-order optics: focal length, cardinal points and pupils from 2 x 2 matrices on (height, index * angle).
#
# Distances are signed along the light from the scene to the film: mirrors are unfolded, so that behind one z, and
# with it thicknesses and curvatures, change their sign.

Array = NDArray[np.float64]

_AFOCAL = 1e-13  # power of the whole below this share of the curvatures' sum is rounding


@dataclass(frozen=True)
class Planes:
    """A pair of planes: `front` from the first vertex, `rear` from the last vertex [mm]."""

    front: float
    rear: float


@dataclass(frozen=True)
class Pupil:
    """Image of the stop on the axis.

    Attributes
    ----------
    distance_mm : float
        From the first vertex (entrance pupil) or from the last vertex (exit pupil); infinite when telecentric.
    diameter_mm : float
    """

    distance_mm: float
    diameter_mm: float


@dataclass(frozen=True)
class FirstOrder:
    """First-order data at one wavelength. Lengths in millimetres, signed along the light from scene to film.

    Attributes
    ----------
    wavelength_nm : float
    focal_length_mm : float
        Rear focal length P'F'; infinite for an afocal system.
    front_focal_length_mm : float
        FP; equal to the rear one when the same medium lies on both sides.
    back_focal_distance_mm : float
        Last vertex to the rear focal point F'.
    front_focal_distance_mm : float
        First vertex to the front focal point F (negative when F lies in front of the lens).
    principal_planes_mm, nodal_points_mm : Planes
    entrance_pupil, exit_pupil : Pupil
    f_number : float
        Focal length / entrance pupil diameter.
    length_mm : float
        z of the last vertex from the first one.
    surfaces : int
        Number of surfaces, the stop included.
    """

    wavelength_nm: float
    focal_length_mm: float
    front_focal_length_mm: float
    back_focal_distance_mm: float
    front_focal_distance_mm: float
    principal_planes_mm: Planes
    nodal_points_mm: Planes
    entrance_pupil: Pupil
    exit_pupil: Pupil
    f_number: float
    length_mm: float
    surfaces: int

    def as_dict(self) -> dict[str, Any]:
        """Return the data as nested dictionaries, for JSON."""
        return asdict(self)


def first_order(lens: Prescription, wavelength_nm: float = LINE_D_NM, section: str = "y") -> FirstOrder:
    """Return the first-order data of a lens at a wavelength [nm], in its y-z or x-z section."""
    if section not in ("x", "y"):
        raise InputError(f'section must be "x" or "y" (got {section!r})')
    (a, _), (c, d) = system_matrix(lens, wavelength_nm, section=section).tolist()
    entrance, exit_ = _pupils(lens, wavelength_nm, section)
    front, rear = _focal_lengths(lens, c, wavelength_nm, section)
    if np.isinf(rear):
        planes = Planes(-np.inf, np.inf)
    else:
        planes = Planes((1 - d) * front, (a - 1) * rear)
    step = 0.0 if rear == front else rear - front  # of the nodal points, where the media on the two sides differ
    return FirstOrder(
        wavelength_nm=float(wavelength_nm),
        focal_length_mm=rear,
        front_focal_length_mm=front,
        back_focal_distance_mm=planes.rear + rear,
        front_focal_distance_mm=planes.front - front,
        principal_planes_mm=planes,
        nodal_points_mm=Planes(planes.front + step, planes.rear + step),
        entrance_pupil=entrance,
        exit_pupil=exit_,
        f_number=abs(rear) / entrance.diameter_mm,
        length_mm=lens.length,
        surfaces=len(lens.surfaces),
    )


def focal_length_mm(lens: Prescription, wavelength_nm: float = LINE_D_NM) -> float:
    """Return the rear focal length of a lens in its y-z section, as `first_order` has it, alone [mm]."""
    return _focal_lengths(lens, float(system_matrix(lens, wavelength_nm)[1, 0]), wavelength_nm, "y")[1]


def _focal_lengths(lens: Prescription, c: float, wavelength_nm: float, section: str) -> tuple[float, float]:
    """Return the front and the rear focal length [mm] of a lens whose system matrix has `c` below on the left."""
    if abs(c) <= _AFOCAL * sum(abs(surface.paraxial_curvature(section)) for surface in lens.surfaces):
        return np.inf, np.inf
    indices = lens.indices(wavelength_nm)
    return -float(indices[0]) / c, -float(indices[-1]) / c


def system_matrix(
    lens: Prescription,
    wavelength_nm: float,
    first: int = 0,
    last: int | None = None,
    refract_last: bool = True,
    section: str = "y",
) -> Array:
    """Return the matrix from just before surface `first` to just after (or, without refraction, at) surface `last`.

    Surfaces that are moved along the axis count where they stand; the whole begins and ends at the places of its
    vertices.
    """
    indices, surfaces, shifts = lens.indices(wavelength_nm), lens.surfaces, lens.axial_shifts
    end = len(surfaces) - 1 if last is None else last
    matrix = np.eye(2)
    if first == 0 and shifts[0]:
        matrix[0, 1] = lens.senses[0] * shifts[0] / indices[0]
    for k in range(first, end + 1):
        surface = surfaces[k]
        if k < end or refract_last:
            change = -2.0 * indices[k] if surface.is_mirror else indices[k + 1] - indices[k]
            power = lens.senses[k] * surface.paraxial_curvature(section) * change
            power += surface.phase.power(wavelength_nm) if surface.phase else 0.0
            matrix = np.array([[1.0, 0.0], [-power, 1.0]]) @ matrix
        if k < end or (last is None and shifts[k]):
            to = surface.thickness + shifts[k + 1] if k < end else 0.0
            gap = lens.senses[k + 1] * (to - shifts[k])
            matrix = np.array([[1.0, gap / indices[k + 1]], [0.0, 1.0]]) @ matrix
    return matrix


def at_conjugates(lens: Lens, object_distance_mm: float, wavelength_nm: float = LINE_D_NM) -> Lens:
    """Return the lens with paths equal in its ideal lenses for points of an object plane, before its first vertex."""
    changes: dict[int, dict[str, Any]] = {}
    for k, surface in enumerate(lens.surfaces):
        if isinstance(surface.phase, IdealLens):
            far, index = np.isinf(object_distance_mm), lens.indices(wavelength_nm)
            ray = [1.0, 0.0] if far else [object_distance_mm, float(index[0])]
            height, slope = system_matrix(lens, wavelength_nm, 0, k, False) @ ray
            near = float(slope / (index[k] * height)) if height else 0.0  # an ideal lens in an image shifts all alike
            changes[k] = {"phase": replace(surface.phase, object_per_mm=near)}
    return lens.with_changes(changes) if changes else lens


def limiting_surface(lens: Prescription, wavelength_nm: float = LINE_D_NM, section: str = "y") -> int:
    """Return the index of the stop, or of the rim that limits an axial beam from infinity when there is none."""
    if lens.stop_index is not None:
        return lens.stop_index
    ratios = []
    for k, surface in enumerate(lens.surfaces):
        height = abs(float(system_matrix(lens, wavelength_nm, 0, k, False, section)[0, 0]))
        ratios.append(surface.semi_diameter / height if height > 0 else np.inf)
    return int(np.argmin(ratios))


def _pupils(lens: Prescription, wavelength_nm: float, section: str) -> tuple[Pupil, Pupil]:
    """Return the images of the stop, taken at the plane of its vertex, through what lies before and behind it."""
    indices = lens.indices(wavelength_nm)
    stop = limiting_surface(lens, wavelength_nm, section)
    diameter = np.float64(2 * lens.surfaces[stop].semi_diameter)
    (a, b), _ = system_matrix(lens, wavelength_nm, 0, stop, False, section).tolist()
    behind = system_matrix(lens, wavelength_nm, stop, section=section)
    if stop == 0:  # the whole begins at the place of the vertex, not at the stop
        behind = behind @ [[1.0, -lens.senses[0] * lens.axial_shifts[0] / indices[0]], [0.0, 1.0]]
    (_, rear_b), (_, rear_d) = behind.tolist()
    with np.errstate(divide="ignore", invalid="ignore"):
        entrance = Pupil(float(np.float64(b) * indices[0] / a), float(diameter / abs(a)))
        exit_ = Pupil(float(0.0 - np.float64(rear_b) * indices[-1] / rear_d), float(diameter / abs(rear_d)))
    return entrance, exit_


# A lens, and what is most used of it: first-order data, rays through it, its stop set. Millimetres, float64.

_WORTH_A_WORD = 0.995  # a marked f-number nearer than this to the true one is that


@dataclass(frozen=True)
class Lens(Prescription):
    """A `Prescription`, which says what it is made of, and the methods most used on one."""

    def __hash__(self) -> int:
        return hash((self.name, self.surfaces, self.configurations))

    def first_order(self, wavelength_nm: float = LINE_D_NM, section: str = "y") -> FirstOrder:
        """Return focal length, cardinal points and pupils at a wavelength [nm], in the "y" or "x" section."""
        known = self._first_orders.get((wavelength_nm, section))
        if known is None:
            known = self._first_orders[wavelength_nm, section] = first_order(self, wavelength_nm, section)
        return known

    @cached_property
    def _first_orders(self) -> dict[tuple[float, str], FirstOrder]:
        return {}

    def trace(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        wavelength_nm: ArrayLike = LINE_D_NM,
        start: str = "film",
        *,
        transmission: LensTransmission | None = None,
    ) -> Rays:
        """Return rays traced through every surface in float64, from the film or from the scene. See `optics.trace`."""
        checkpoint()
        return trace(self, origins, directions, wavelength_nm, start, transmission)

    def with_warnings(self, more: tuple[str, ...]) -> Lens:
        """Return the lens with further doubts noted."""
        return replace(self, warnings=(*self.warnings, *more))

    def with_stop_diameter(self, diameter_mm: float) -> Lens:
        """Return the lens with its stop closed to a diameter [mm]."""
        stop = self._need_stop()
        assert self.stop_index is not None
        has = 2 * stop.semi_diameter
        if not diameter_mm > 0 or not np.isfinite(diameter_mm):
            raise InputError(f"{self.name}: stop diameter must be above 0 mm (got {diameter_mm:g})")
        if diameter_mm > max(has * (1 + 1e-9), *_printed_range(has)):
            widest = self.first_order().f_number
            speed = f", f/{widest:.3g}" if np.isfinite(widest) else ""
            raise InputError(f"{self.name}: the stop opens to {has:.5g} mm{speed} (requested {diameter_mm:.5g} mm)")
        return self.with_changes({self.stop_index: {"semi_diameter": min(diameter_mm, has) / 2}})

    def with_stop_shape(self, shape: StopShape | StopMask | None) -> Lens:
        """Return the lens with its stop shaped; None makes it round."""
        self._need_stop()
        assert self.stop_index is not None
        return self.with_changes({self.stop_index: {"stop_shape": shape}})

    def stop_diameter_for(self, f_number: float, wavelength_nm: float = LINE_D_NM) -> float:
        """Return the stop diameter [mm] of an f-number = focal length / entrance pupil diameter (paraxial).

        The f-number that the lens is marked with, and that which it opens to as it is printed, are its full opening.
        """
        stop = self._need_stop()
        if not f_number > 0 or not np.isfinite(f_number):
            raise InputError(f"{self.name}: f-number must be above 0 (got {f_number:g})")
        widest = self.first_order(wavelength_nm).f_number
        if not np.isfinite(widest):
            raise InputError(f"{self.name}: has no focal length, so no f-number; set stop_diameter_mm instead")
        diameter = 2 * stop.semi_diameter * widest / f_number
        least = min(widest * (1 - 1e-9), *_printed_range(widest))
        if f_number < least and f_number < (self.marked_f_number or widest) * (1 - 1e-9):
            raise InputError(
                f"{self.name}: opens to f/{widest:.4g}, a stop of {2 * stop.semi_diameter:.5g} mm "
                f"(f/{f_number:g} would need {diameter:.5g} mm)"
            )
        return float(min(diameter, 2 * stop.semi_diameter))

    def speed_note(self, f_number: float, wavelength_nm: float = LINE_D_NM) -> tuple[str, ...]:
        """Return a note on a marked f-number that the lens does not reach; else nothing."""
        widest, marked = self.first_order(wavelength_nm).f_number, self.marked_f_number
        if self.stop is None or marked is None or not marked <= f_number < _WORTH_A_WORD * widest:
            return ()
        return (f"{self.name}: is marked f/{marked:g} and opens to f/{widest:.4g}, which is taken",)

    def _need_stop(self) -> Surface:
        if self.stop is None:
            raise InputError(
                f"{self.name}: has no stop to set; only its rims limit the light (mark one with stop: true)"
            )
        return self.stop


def _printed_range(value: float) -> tuple[float, float, float]:
    """Return a number as messages and tables print it, with three to five digits."""
    return float(f"{value:.3g}"), float(f"{value:.4g}"), float(f"{value:.5g}")


#
# Where the film must stand for an object, and the other way round, by the lens's cardinal points (a thick lens).
#
# With x the distance from the object to the front focal point and x' that from the rear focal point to the film, both
# positive for a real image, Newton's equation x x' = f f' holds exactly to first order: a ray traced close to the
# axis crosses it at the distance returned here.

MEASURED_FROM = ("film", "front")


def film_distance(
    lens: Lens, object_distance_mm: float, measured_from: str = "film", wavelength_nm: float = LINE_D_NM
) -> float:
    """Return the distance from the last vertex to the film that images an object plane sharply [mm].

    Parameters
    ----------
    lens : Lens
    object_distance_mm : float
        Distance of the object plane, infinite allowed.
    measured_from : "film" or "front"
        Whether that distance ends at the film (as engraved on lenses) or at the first vertex.
        From the film there are two solutions; the one with the object farther from the lens is returned.
    wavelength_nm : float

    Raises
    ------
    InputError
        Without a real image, or when the object is nearer than the lens can focus.
    """
    if measured_from not in MEASURED_FROM:
        raise InputError(f'measured_from must be "film" or "front" (got {measured_from!r})')
    if not object_distance_mm > 0:
        raise InputError(f"{lens.name}: the object distance must be above 0 mm (got {object_distance_mm:g})")
    data = _imaging(lens, wavelength_nm)
    if np.isinf(object_distance_mm):
        return _behind_lens(lens, data.back_focal_distance_mm)
    to_focal_point = _newton_distance(lens, data, object_distance_mm, measured_from)
    extension = data.focal_length_mm * data.front_focal_length_mm / to_focal_point
    return _behind_lens(lens, data.back_focal_distance_mm + extension)


def object_distance(lens: Lens, film_distance_mm: float, wavelength_nm: float = LINE_D_NM) -> float:
    """Return the distance from the film to the object plane that it images sharply [mm]; infinite at the focal point.

    Raises
    ------
    InputError
        When the film stands where only a virtual object could be sharp.
    """
    data = _imaging(lens, wavelength_nm)
    extension = film_distance_mm - data.back_focal_distance_mm
    if abs(extension) <= 1e-12 * abs(data.focal_length_mm):
        return np.inf
    to_focal_point = data.focal_length_mm * data.front_focal_length_mm / extension
    from_front = to_focal_point - data.front_focal_distance_mm
    if extension < 0 or from_front < 0:
        raise InputError(
            f"{lens.name}: nothing in front of the lens is sharp with the film {film_distance_mm:.6g} mm behind the "
            f"last vertex (infinity is sharp at {data.back_focal_distance_mm:.6g} mm, nearer objects farther back)"
        )
    return float(from_front + data.length_mm + lens.sense * film_distance_mm)


def nearest_object_distance(lens: Lens, measured_from: str = "film", wavelength_nm: float = LINE_D_NM) -> float:
    """Return the least object distance that has a real image behind the lens [mm]."""
    data = _imaging(lens, wavelength_nm)
    product = data.focal_length_mm * data.front_focal_length_mm
    if measured_from == "front":
        return float(max(0.0, -data.front_focal_distance_mm))
    if lens.sense < 0:  # the film stands before the last mirror, so that object and film may meet
        return 0.0
    to_focal_point = max(np.sqrt(product), data.front_focal_distance_mm)
    span = data.length_mm + data.back_focal_distance_mm - data.front_focal_distance_mm
    return float(span + to_focal_point + product / to_focal_point)


def _newton_distance(lens: Lens, data: FirstOrder, object_distance_mm: float, measured_from: str) -> float:
    """Return the distance from the object to the front focal point [mm]."""
    nearest = nearest_object_distance(lens, measured_from, data.wavelength_nm)
    place = "from the film" if measured_from == "film" else "in front of the lens"
    if object_distance_mm < nearest or (measured_from == "front" and object_distance_mm == nearest):
        raise InputError(
            f"{lens.name}: cannot focus at {object_distance_mm:.6g} mm {place}; "
            f"the nearest possible is {nearest:.6g} mm"
        )
    if measured_from == "front":
        return object_distance_mm + data.front_focal_distance_mm
    span = object_distance_mm - data.length_mm - lens.sense * data.back_focal_distance_mm + data.front_focal_distance_mm
    product = lens.sense * data.focal_length_mm * data.front_focal_length_mm
    return float((span + np.sqrt(max(span * span - 4 * product, 0.0))) / 2)


def _imaging(lens: Lens, wavelength_nm: float) -> FirstOrder:
    data = lens.first_order(wavelength_nm)
    if not lens.has_power:
        raise InputError(f"{lens.name}: has no power, so it focuses nothing; set film_distance_mm instead")
    if not np.isfinite(data.focal_length_mm):
        raise InputError(f"{lens.name}: is afocal, so it forms no image; set film_distance_mm instead")
    if data.focal_length_mm < 0:
        raise InputError(
            f"{lens.name}: forms no real image (focal length {data.focal_length_mm:.6g} mm); "
            "set film_distance_mm instead"
        )
    return data


def _behind_lens(lens: Lens, distance_mm: float) -> float:
    if not distance_mm > 0:
        raise InputError(f"{lens.name}: the image lies inside the lens, {-distance_mm:.6g} mm before its last vertex")
    return float(distance_mm)


# The thick lens: what the cardinal points and the pupils of a lens say, and nothing of its aberrations and rims.

_AT_THE_PUPIL = 1e-9  # distance from film to exit pupil, as a share of the film distance, that counts as none


@dataclass(frozen=True)
class ThickLens:
    """The ray that leads from a film point through a point of the pupil, both sides of the lens to first order.

    Every number is a factor for the film point [mm] and one for the point of the unit disk that the pupil is, in x and
    y alike. To first order the exit pupil, the entrance pupil and the stop are images of each other, so a point of that
    disk is a point of each. In this form nothing is infinite when a pupil is (a telecentric lens).

    Attributes
    ----------
    film_slope : tuple of float
        Sideways per unit towards the film, between the exit pupil and the film.
    height : tuple of float
        Where the ray meets the plane of the first vertex [mm].
    slope : tuple of float
        Sideways per unit towards the scene, in the scene.
    """

    film_slope: tuple[float, float]
    height: tuple[float, float]
    slope: tuple[float, float]

    @property
    def pupil_solid_angle(self) -> float:
        """Area of the exit pupil over the square of its distance from the film."""
        return math.pi * self.film_slope[1] ** 2

    def film_per_tangent(self, width_m: float, height_m: float) -> tuple[float, float]:
        """Return how many widths and heights of a film the image moves per unit of the tangent in the scene."""
        per_mm = 1e-3 / abs(self.slope[0])
        return per_mm / width_m, per_mm / height_m

    @property
    def lever(self) -> float:
        """Slope of chief rays at the film over that in the scene: the pupil's size there over its size at the film."""
        return self.film_slope[0] / abs(self.slope[0])

    @property
    def axial_cone(self) -> float:
        """Projected solid angle of the pupil from the centre of the film: pi sin^2 of the half angle."""
        square = self.film_slope[1] ** 2
        return math.pi * square / (1.0 + square)


def thick_lens_of(lens: Lens, film_distance_mm: float, wavelength_nm: float) -> ThickLens:
    """Return the thick lens of a lens and a film at a distance from its last vertex [mm].

    With matrices on (height, index * slope), front from the first vertex to the stop and rear from the stop to the
    film, a film point h and a stop point s belong to h = A s + B v, v being the slope at the stop times the index.

    Raises
    ------
    InputError
        For a lens that has no cardinal points, or other ones in x than in y, or whose exit pupil lies on the film.
    """
    _check_thick(lens, wavelength_nm)
    stop = limiting_surface(lens, wavelength_nm)
    radius = lens.surfaces[stop].semi_diameter
    indices = lens.indices(wavelength_nm)
    n_scene, n_film = float(indices[0]), float(indices[-1])
    to_film = np.array([[1.0, film_distance_mm / n_film], [0.0, 1.0]])
    (at, along), (_, turn) = (to_film @ system_matrix(lens, wavelength_nm, stop)).tolist()
    (a, b), (c, d) = system_matrix(lens, wavelength_nm, 0, stop, refract_last=False).tolist()
    if abs(along) <= _AT_THE_PUPIL * film_distance_mm:
        raise InputError(f"{lens.name}: its exit pupil lies on the film, {film_distance_mm:g} mm behind the lens")
    return ThickLens(
        film_slope=(turn / along / n_film, -radius / along / n_film),
        height=(-b / along, radius * (d + b * at / along)),
        slope=(-a / along / n_scene, radius * (c + a * at / along) / n_scene),
    )


def _check_thick(lens: Lens, wavelength_nm: float) -> None:
    if not lens.is_rotational:
        raise InputError(
            f"{lens.name}: is not the same from every side, so no single thick lens stands for it;"
            " take camera.kind: realistic"
        )
    if not math.isfinite(lens.first_order(wavelength_nm).focal_length_mm):
        raise InputError(f"{lens.name}: is afocal, so it has no cardinal points; take camera.kind: realistic")
    if lens.is_obstructed:
        raise InputError(
            f"{lens.name}: its pupil is a ring, for which no thick lens stands; take camera.kind: realistic"
        )
    if lens.stop is not None and lens.stop.stop_shape is not None:
        raise InputError(f"{lens.name}: its stop is not round; take camera.kind: realistic")


# Lenses whose gaps vary: zoom positions as named configurations, and a group that moves to focus.

STEPS = 64
BEYOND = (-0.05, 1.1)  # of the way to the nearest published state that floating groups may go
NEARLY = 5e-3  # by which a film that is known allows nearer objects than published, where a file rounds
FEW = 8  # zoom lenses whose focal lengths are remembered
REMEMBERED = 64  # and states


def float_groups(lens: Lens, distance_mm: float, wavelength_nm: float = LINE_D_NM) -> Lens:
    """Return the lens with its floating groups set for an object plane, at a distance from the film [mm].

    The gaps go from their values in the table, for infinity, along straight lines through those of the published
    distances: so far that the object is sharp where the film stands. Where nobody says where that is, they go in
    proportion to 1 / distance, as far as a lens moves for an object. A lens without such groups stays.

    Raises
    ------
    InputError
        For an object nearer than the nearest published distance, which is named.
    """
    if not lens.floating:
        return lens
    _check_near(lens, distance_mm)
    if not np.isfinite(distance_mm):
        return replace(lens, floating=())
    if lens.focuses_by_group:
        film = film_distance(lens, np.inf, wavelength_nm=wavelength_nm)
        return replace(focused_by_group(lens, distance_mm, film, wavelength_nm)[0], floating=())
    nearest = min(state.distance_mm for state in lens.floating)
    return replace(_at_share(lens, nearest / distance_mm), floating=())


def _check_near(lens: Lens, distance_mm: float) -> None:
    """Refuse an object that is nearer than the nearest published distance."""
    nearest = min(state.distance_mm for state in lens.floating)
    if distance_mm < nearest * (1 - (NEARLY if lens.focuses_by_group else 1e-9)):
        raise InputError(
            f"{lens.name}: its floating groups focus down to {nearest:.6g} mm from the film "
            f"(requested {distance_mm:.6g} mm)"
        )


def brought_to_focus(lens: Lens, distance_mm: float, wavelength_nm: float = LINE_D_NM) -> tuple[Lens, float]:
    """Return the lens focused by first-order optics on an object plane, at a distance from the film, and the distance
    from its last vertex to the film [mm]: by its groups where the lens file has some, else as a whole."""
    if np.isfinite(distance_mm) and lens.focuses_by_group:
        film = film_distance(lens, np.inf, wavelength_nm=wavelength_nm)
        return focused_by_group(lens, distance_mm, film, wavelength_nm)
    lens = float_groups(lens, distance_mm, wavelength_nm)
    return lens, film_distance(lens, distance_mm, wavelength_nm=wavelength_nm)


@dataclass(frozen=True)
class _Rail:
    """How floating groups move: `values` (states, gaps and film shift) over `shares` of 1 / distance, 1 the nearest."""

    places: tuple[int, ...]
    shares: Array
    values: Array

    @property
    def leading(self) -> int:
        """The gap that changes most."""
        return int(np.argmax(np.abs(self.values[-1, :-1] - self.values[0, :-1])))

    @property
    def reach(self) -> float:
        """How much it changes [mm]; 1 where none does."""
        return float(self.values[-1, self.leading] - self.values[0, self.leading]) or 1.0

    def at(self, share: float) -> Array:
        """Return gaps and film shift [mm]; beyond the ends the straight lines go on."""
        k = int(np.clip(np.searchsorted(self.shares, share) - 1, 0, len(self.shares) - 2))
        part = (share - self.shares[k]) / (self.shares[k + 1] - self.shares[k])
        return np.asarray(self.values[k] + part * (self.values[k + 1] - self.values[k]))


def _rail(lens: Lens) -> _Rail:
    states = sorted(lens.floating, key=lambda state: -state.distance_mm)
    places = tuple(k for k, _ in states[0].gaps)
    rows = [[lens.surfaces[k].thickness for k in places] + [0.0]]
    rows += [[gap for _, gap in state.gaps] + [state.film_shift_mm or 0.0] for state in states]
    away = np.array([0.0, *(1 / state.distance_mm for state in states)])
    return _Rail(places, away / away[-1], np.array(rows))


def _at_share(lens: Lens, share: float) -> Lens:
    rail = _rail(lens)
    gaps = zip(rail.places, rail.at(share).tolist(), strict=False)  # the last value is the film's
    return lens.with_changes({k: {"thickness": gap} for k, gap in gaps})


def in_configuration(lens: Lens, name: str) -> Lens:
    """Return a zoom lens in one of its named configurations."""
    for configuration in lens.configurations:
        if configuration.name == name:
            return _set(lens, configuration)
    names = ", ".join(configuration.name for configuration in lens.configurations)
    raise InputError(f"{lens.name}: no configuration {name!r}; it has {names or 'none'}")


def at_position(lens: Lens, zoom: str | None, focal_length_mm: float | None, wavelength_nm: float = LINE_D_NM) -> Lens:
    """Return a lens in a named configuration or at a focal length; as it is where neither is said."""
    if zoom is not None:
        lens = in_configuration(lens, zoom)
    return lens if focal_length_mm is None else zoom_to(lens, focal_length_mm, wavelength_nm)


def zoom_to(lens: Lens, focal_length_mm: float, wavelength_nm: float = LINE_D_NM) -> Lens:
    """Return a zoom lens at a focal length, its gaps interpolated between neighbouring configurations.

    Raises
    ------
    InputError
        For a lens without configurations, or a focal length outside their range, which is named.
    """
    if len(lens.configurations) < 2:
        raise InputError(f"{lens.name}: is not a zoom lens (it has no configurations)")
    return _zoom_to(lens, float(focal_length_mm), float(wavelength_nm))


def zoom_range_mm(lens: Lens, wavelength_nm: float = LINE_D_NM) -> tuple[float, float]:
    """Return the least and the greatest focal length of a zoom lens."""
    lengths = _zoom_table(lens, float(wavelength_nm))[1]
    return float(lengths.min()), float(lengths.max())


@lru_cache(maxsize=FEW)
def _zoom_table(lens: Lens, wavelength_nm: float) -> tuple[Array, Array]:
    """Return states between the configurations, and the focal length of each [mm]."""
    steps = len(lens.configurations) - 1
    states = np.linspace(0.0, float(steps), 1 + STEPS * steps)
    return states, np.array([focal_length_mm(_between(lens, state), wavelength_nm) for state in states])


@lru_cache(maxsize=REMEMBERED)
def _zoom_to(lens: Lens, wanted_mm: float, wavelength_nm: float) -> Lens:
    states, lengths = _zoom_table(lens, wavelength_nm)
    above = lengths >= wanted_mm
    change = np.flatnonzero(above[1:] != above[:-1])
    if not len(change):
        near = states[np.argmin(np.abs(lengths - wanted_mm))]
        if abs(lengths - wanted_mm).min() <= 1e-9 * wanted_mm:
            return _between(lens, float(near))
        raise InputError(
            f"{lens.name}: zooms from {lengths.min():.5g} to {lengths.max():.5g} mm (requested {wanted_mm:g} mm)"
        )
    low, high = float(states[change[0]]), float(states[change[0] + 1])
    while low < (middle := (low + high) / 2) < high:  # until no number lies between
        longer = focal_length_mm(_between(lens, middle), wavelength_nm) >= wanted_mm
        low, high = (middle, high) if longer == above[change[0]] else (low, middle)
    return _between(lens, middle)


def travel_mm(lens: Lens) -> tuple[float, float]:
    """Return the least and the greatest shift of what moves to focus [mm]: of the group towards the film; of floating
    groups the change of the gap that changes most, from a little beyond infinity to a little nearer than published."""
    if lens.floating:
        ends = [_rail(lens).reach * share for share in BEYOND]
        return min(ends), max(ends)
    return _group(lens).travel_mm


def move_group(lens: Lens, shift_mm: float) -> Lens:
    """Return the lens with what moves to focus shifted, as `travel_mm` counts [mm]."""
    if lens.floating:
        return _at_share(lens, shift_mm / _rail(lens).reach)
    group, gaps = _group(lens), {}
    if group.first > 0:
        gaps[group.first - 1] = lens.surfaces[group.first - 1].thickness + shift_mm
    if group.last < len(lens.surfaces) - 1:
        gaps[group.last] = lens.surfaces[group.last].thickness - shift_mm
    return lens.with_changes({k: {"thickness": gap} for k, gap in gaps.items()})


def film_behind(lens: Lens, shift_mm: float, film_distance_mm: float) -> float:
    """Return the distance from the last vertex to the film when what moves to focus has shifted [mm]."""
    if lens.floating:
        rail = _rail(lens)
        return film_distance_mm + float(rail.at(shift_mm / rail.reach)[-1])
    return film_distance_mm - shift_mm if _group(lens).last == len(lens.surfaces) - 1 else film_distance_mm


def shift_of(lens: Lens, state: Lens) -> float:
    """Return how far what moves to focus in a lens has shifted in one of its states [mm]."""
    if lens.floating:
        rail = _rail(lens)
        lead, gaps = state.surfaces[rail.places[rail.leading]].thickness, rail.values[:, rail.leading]
        inside = [k for k in range(len(gaps) - 1) if min(gaps[k : k + 2]) <= lead <= max(gaps[k : k + 2])]
        k = inside[0] if inside else 0 if abs(lead - gaps[0]) < abs(lead - gaps[-1]) else len(gaps) - 2
        step = float(gaps[k + 1] - gaps[k]) or 1.0
        share = rail.shares[k] + (lead - gaps[k]) / step * (rail.shares[k + 1] - rail.shares[k])
        return float(share * rail.reach)
    group = _group(lens)
    if group.first > 0:
        return state.surfaces[group.first - 1].thickness - lens.surfaces[group.first - 1].thickness
    return lens.surfaces[group.last].thickness - state.surfaces[group.last].thickness


def focused_by_group(
    lens: Lens, object_distance_mm: float, film_distance_mm: float, wavelength_nm: float = LINE_D_NM
) -> tuple[Lens, float]:
    """Return the lens with its groups moved so that an object is sharp on the film, and the film distance.

    The film stays where it is, or moves with floating groups as their file says.

    Parameters
    ----------
    lens : Lens
    object_distance_mm : float
        From the film to the object plane.
    film_distance_mm : float
        From the last vertex to the film before the groups move. The distance after it differs only if the last surface
        moves.

    Raises
    ------
    InputError
        When the distance lies outside the reach of the group, which is named.
    """
    if lens.floating:
        _check_near(lens, object_distance_mm)
    low, high = travel_mm(lens)
    shifts = np.linspace(low, high, 2 * STEPS + 1)
    errors = np.array([_defocus(lens, float(s), object_distance_mm, film_distance_mm, wavelength_nm) for s in shifts])
    with np.errstate(invalid="ignore"):
        change = np.flatnonzero(np.sign(errors[:-1]) * np.sign(errors[1:]) <= 0)
    if not len(change):
        near, far = focus_reach_mm(lens, film_distance_mm, wavelength_nm)
        raise InputError(
            f"{lens.name}: its group focuses from {near:.6g} to {far:.6g} mm from the film "
            f"(requested {object_distance_mm:.6g} mm)"
        )
    low, high = float(shifts[change[0]]), float(shifts[change[0] + 1])
    sign = np.sign(errors[change[0]])
    for _ in range(80):
        middle = (low + high) / 2
        same = np.sign(_defocus(lens, middle, object_distance_mm, film_distance_mm, wavelength_nm)) == sign
        low, high = (middle, high) if same else (low, middle)
    shift = (low + high) / 2
    return move_group(lens, shift), film_behind(lens, shift, film_distance_mm)


def _defocus(lens: Lens, shift: float, distance: float, film_distance_mm: float, wavelength: float) -> float:
    """Return how far behind the film the image of an object plane lies [mm]; NaN when there is none."""
    state, there = move_group(lens, shift), film_behind(lens, shift, film_distance_mm)
    front = distance - state.length - state.sense * there
    if not front > 0:
        return float("nan")
    try:
        return film_distance(state, front, "front", wavelength) - there
    except InputError:
        return float("nan")


def focus_reach_mm(lens: Lens, film_distance_mm: float, wavelength: float) -> tuple[float, float]:
    """Return the nearest and farthest object plane that some shift makes sharp [mm from the film]."""
    distances = []
    for shift in np.linspace(*travel_mm(lens), 2 * STEPS + 1).tolist():
        try:
            there = film_behind(lens, shift, film_distance_mm)
            distances.append(object_distance(move_group(lens, shift), there, wavelength))
        except InputError:
            continue
    if not distances:
        where = f"{film_distance_mm:g} mm behind the lens"
        raise InputError(f"{lens.name}: no shift of its group makes anything sharp {where}")
    return min(distances), max(distances)


def _group(lens: Lens) -> surface_rows.FocusingGroup:
    if lens.focusing is None:
        raise InputError(f"{lens.name}: has no focusing group; move the whole lens instead")
    return lens.focusing


def _between(lens: Lens, state: float) -> Lens:
    """Return the lens between two configurations, the whole numbers being the configurations themselves."""
    first = int(min(np.floor(state), len(lens.configurations) - 2))
    share = state - first
    one, two = lens.configurations[first], lens.configurations[first + 1]
    later = dict(two.gaps)
    gaps = tuple((k, (1 - share) * gap + share * later.get(k, gap)) for k, gap in one.gaps)
    stop = one.stop_diameter_mm
    if stop is not None and two.stop_diameter_mm is not None:
        stop = (1 - share) * stop + share * two.stop_diameter_mm
    near: tuple[FocusState, ...] = ()
    if len(one.floating) == len(two.floating):
        pairs = zip(one.floating, two.floating, strict=True)
        near = tuple(_between_states(first, second, share) for first, second in pairs)
    return _set(lens, surface_rows.Configuration(f"{one.name} to {two.name}", gaps, stop, near))


def _between_states(one: FocusState, two: FocusState, share: float) -> FocusState:
    """Return a state of focus between those of two zoom positions."""
    away = (1 - share) / one.distance_mm + share / two.distance_mm
    gaps = tuple(
        (k, (1 - share) * gap + share * other) for (k, gap), (_, other) in zip(one.gaps, two.gaps, strict=True)
    )
    if one.film_shift_mm is None or two.film_shift_mm is None:
        return FocusState(1 / away, gaps)
    return FocusState(1 / away, gaps, (1 - share) * one.film_shift_mm + share * two.film_shift_mm)


def _set(lens: Lens, configuration: surface_rows.Configuration) -> Lens:
    changes: dict[int, dict[str, float]] = {k: {"thickness": gap} for k, gap in configuration.gaps}
    if configuration.stop_diameter_mm is not None and lens.stop_index is not None:
        changes.setdefault(lens.stop_index, {})["semi_diameter"] = configuration.stop_diameter_mm / 2
    return lens.with_changes(changes, floating=configuration.floating)


# A lens with its x and y exchanged: fields along x are those along y of such a lens.


def exchange_axes(lens: Lens) -> Lens:
    """Return a lens with x and y exchanged, whose name says so; itself where that makes no difference."""
    if lens.is_rotational and lens.fold is None and not (lens.stop and lens.stop.stop_shape):
        return lens
    surfaces = tuple(_exchange_in_surface(surface) for surface in lens.surfaces)
    fold = None if lens.fold is None else _exchange_in_pose(lens.fold)
    return replace(lens, name=f"{lens.name}, fields along x", surfaces=surfaces, fold=fold)


def _exchange_in_surface(surface: Surface) -> Surface:
    shape, form, conic, curvature = surface.stop_shape, surface.form, surface.conic, surface.curvature
    if isinstance(form, Biconic):
        form, curvature, conic = Biconic(curvature, conic), form.curvature_x, form.conic_x
    elif form is not None:
        form = Transposed(form)
    if isinstance(shape, StopMask):
        shape = StopMask(shape.cells[::-1, ::-1].T)
    elif shape is not None:
        shape = StopShape(tuple((y, x) for x, y in shape.vertices))
    other = {"x": "y", "y": "x", None: None}
    phase = surface.phase
    if isinstance(phase, Grating):
        phase = replace(phase, towards_degrees=90.0 - phase.towards_degrees)
    return replace(
        surface, curvature=curvature, conic=conic, form=form, stop_shape=shape, cylinder=other[surface.cylinder],
        pose=_exchange_in_pose(surface.pose) if surface.pose else None,
        region=_exchange_in_region(surface.region) if surface.region else None, phase=phase,
    )  # fmt: skip


def _exchange_in_region(region: Region) -> Region:
    normal = None if region.normal_degrees is None else 90.0 - region.normal_degrees
    return replace(region, half_width=region.half_height, half_height=region.half_width,
                   centre=region.centre[::-1], normal_degrees=normal)  # fmt: skip


def _exchange_in_pose(pose: SurfacePose) -> SurfacePose:
    x, y, z = pose.offset
    ((a, b, c), (d, e, f), (g, h, i)) = pose.rotation
    return SurfacePose((y, x, z), ((e, d, f), (b, a, c), (h, g, i)))
