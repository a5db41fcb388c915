"""First-order optics: focal length, cardinal points and pupils from 2 x 2 matrices on (height, index * angle).

Distances are signed along the light from the scene to the film: mirrors are unfolded, so that behind one z, and with it
thicknesses and curvatures, change their sign.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.prescription import Prescription

Array = NDArray[np.float64]

AFOCAL = 1e-13  # power of the whole below this share of the curvatures' sum is rounding


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
    return FirstOrder(
        wavelength_nm=float(wavelength_nm),
        focal_length_mm=rear,
        front_focal_length_mm=front,
        back_focal_distance_mm=planes.rear + rear,
        front_focal_distance_mm=planes.front - front,
        principal_planes_mm=planes,
        nodal_points_mm=_nodal(planes, rear, front),
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
    if abs(c) <= AFOCAL * sum(abs(surface.paraxial_curvature(section)) for surface in lens.surfaces):
        return np.inf, np.inf
    indices = lens.indices(wavelength_nm)
    return -float(indices[0]) / c, -float(indices[-1]) / c


def _nodal(principal: Planes, rear: float, front: float) -> Planes:
    """Return the nodal points; they leave the principal points when the media on the two sides differ."""
    step = 0.0 if rear == front else rear - front
    return Planes(principal.front + step, principal.rear + step)


def system_matrix(
    lens: Prescription,
    wavelength_nm: float,
    first: int = 0,
    last: int | None = None,
    refract_last: bool = True,
    section: str = "y",
) -> Array:
    """Return the matrix from just before surface `first` to just after (or, without refraction, at) surface `last`."""
    indices = lens.indices(wavelength_nm)
    end = len(lens.surfaces) - 1 if last is None else last
    matrix = np.eye(2)
    for k in range(first, end + 1):
        surface = lens.surfaces[k]
        if k < end or refract_last:
            change = -2.0 * indices[k] if surface.is_mirror else indices[k + 1] - indices[k]
            power = lens.senses[k] * surface.paraxial_curvature(section) * change
            matrix = np.array([[1.0, 0.0], [-power, 1.0]]) @ matrix
        if k < end:
            gap = lens.senses[k + 1] * surface.thickness
            matrix = np.array([[1.0, gap / indices[k + 1]], [0.0, 1.0]]) @ matrix
    return matrix


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
    (_, rear_b), (_, rear_d) = system_matrix(lens, wavelength_nm, stop, section=section).tolist()
    with np.errstate(divide="ignore", invalid="ignore"):
        entrance = Pupil(float(np.float64(b) * indices[0] / a), float(diameter / abs(a)))
        exit_ = Pupil(float(0.0 - np.float64(rear_b) * indices[-1] / rear_d), float(diameter / abs(rear_d)))
    return entrance, exit_
