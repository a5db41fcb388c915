"""Irradiance of the middle of the film through a round pupil, without tracing anew in each state of film and stop.

Where rays from the axis of the film cross each surface is kept as polynomials in the distance of the film and in the
height of the ray. They say which rim stops rays first, and at which height: the pupil is a disk of that radius.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.chief_fan import geometry_but_stop
from rptcam_cl.optics.film_crossings import crossed
from rptcam_cl.optics.first_order import limiting_surface

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]

FILM_NODES = 6  # in a cell of film distances
HEIGHT_NODES = (16, 32)  # of a beam, where the first are too few
EXACT = 1e-12  # share of a quantity that its last polynomials may have
CELLS_OF_DISTANCE = 16  # while it doubles
STEPS_OF_HEIGHT = 8  # widths of beams while they double
WIDER = 8  # steps by which a beam may have to be wider than first-order optics says
PLACES = 65  # at which a search begins
ROUNDS = 4  # of Newton's method
REMEMBERED = 128  # lenses whose beams are kept

_BEAMS: dict[tuple[object, ...], dict[tuple[int, int], _Beam | None]] = {}


def disk_irradiance(lens: Lens, film_distance_mm: float, wavelength_nm: float = LINE_D_NM) -> float | None:
    """Return what `on_axis_irradiance` does without losses for a lens of whose pupil nothing lies apart.

    None where the lens is not round, has mirrors, a hole or a shaped stop, or its rays are too bent for polynomials.
    """
    shaped = lens.stop is not None and lens.stop.stop_shape is not None
    if shaped or lens.has_mirrors or lens.is_obstructed or not lens.is_rotational:
        return None
    stop, pupil = limiting_surface(lens, wavelength_nm), lens.first_order(wavelength_nm).exit_pupil
    away = film_distance_mm - pupil.distance_mm
    if not (math.isfinite(away) and away != 0):
        return None
    height = abs(pupil.diameter_mm / 2 * film_distance_mm / away)
    cell = math.floor(CELLS_OF_DISTANCE * math.log2(film_distance_mm))
    step = math.ceil(STEPS_OF_HEIGHT * math.log2(height))
    key = geometry_but_stop(lens, stop, wavelength_nm)
    if key not in _BEAMS:
        if len(_BEAMS) >= REMEMBERED:
            _BEAMS.clear()
        _BEAMS[key] = {}
    beams = _BEAMS[key]
    for width in range(step, step + WIDER):
        if (cell, width) not in beams:
            beams[cell, width] = _traced(lens, wavelength_nm, cell, 2.0 ** (width / STEPS_OF_HEIGHT))
        beam = beams[cell, width]
        if beam is None:
            return None
        if (square := beam.square_of_pupil(lens, film_distance_mm)) is not None:
            indices = lens.indices(wavelength_nm)
            return float(math.pi * square / (film_distance_mm**2 + square) * (indices[-1] / indices[0]) ** 2)
    return None


def _traced(lens: Lens, wavelength_nm: float, cell: int, height: float) -> _Beam | None:
    """Return the beam of a cell; None where a ray is lost or polynomials of so low a degree leave errors."""
    ends = 2.0 ** (cell / CELLS_OF_DISTANCE), 2.0 ** ((cell + 1) / CELLS_OF_DISTANCE)
    indices, order = lens.indices(wavelength_nm), range(len(lens.surfaces) - 1, -1, -1)
    at_film, to_film = _nodes(FILM_NODES)
    distances = np.mean(ends) + np.ptp(ends) / 2 * at_film
    for count in HEIGHT_NODES:
        at_height, to_height = _nodes(count)
        heights = height * np.sqrt((1.0 + at_height) / 2)
        far, across = (values.ravel() for values in np.meshgrid(distances, heights, indexing="ij"))
        p, d = np.zeros((3, len(far))), np.stack([across, np.zeros(len(far)), -far])
        p[2] = lens.length + far
        crossings, _, _ = crossed(lens, order, p, d / np.hypot(across, far), indices)
        values = (crossings[..., 0] / across).T.reshape(FILM_NODES, count, -1)
        if not np.isfinite(values).all():
            return None
        polynomials = to_height @ np.tensordot(to_film, values, 1)
        if np.all(np.abs(polynomials[:, -2:]) <= EXACT * np.abs(values).max(axis=(0, 1))):
            return _Beam(height, (float(ends[0]), float(ends[1])), polynomials)
    return None


def _nodes(count: int) -> tuple[Array, Array]:
    """Return nodes from -1 to 1, and the matrix from values there to Chebyshev polynomials."""
    angles = (np.arange(count) + 0.5) * np.pi / count
    matrix = 2.0 / count * np.cos(np.outer(np.arange(count), angles))
    matrix[0] /= 2
    return np.cos(angles), matrix


@dataclass(frozen=True, eq=False)
class _Beam:
    """Rays from the axis of the film.

    Attributes
    ----------
    height : float
        On the plane of the last vertex, up to which they go [mm].
    distances : (float, float)
        Of the film, between which they begin [mm].
    polynomials : (distances, heights, surfaces) array
        Of the distance of the film and the square of the height: where rays cross each surface, over the height.
    """

    height: float
    distances: tuple[float, float]
    polynomials: Array

    @cached_property
    def _begin(self) -> tuple[Array, Array]:
        """Heights, and their Chebyshev polynomials."""
        heights = np.linspace(0.0, self.height, PLACES)
        angles = np.arccos(np.clip(2 * (heights / self.height) ** 2 - 1, -1.0, 1.0))
        return heights, np.cos(np.outer(angles, np.arange(self.polynomials.shape[1])))

    def _terms(self, height: float) -> tuple[Array, Array]:
        """Return the Chebyshev polynomials at a height, and those that their derivatives go by."""
        degrees = np.arange(self.polynomials.shape[1])
        x = 2 * (height / self.height) ** 2 - 1
        angle = math.acos(min(max(x, -1.0), 1.0))
        slopes = degrees * np.sin(degrees * angle) / max(math.sin(angle), 1e-12)
        return np.cos(degrees * angle), slopes * (4 * height / self.height**2)

    def square_of_pupil(self, lens: Lens, film_distance_mm: float) -> float | None:
        """Return the square of the radius of the pupil [mm2]; None where no rim stops rays within the beam."""
        low, high = self.distances
        x = (2 * film_distance_mm - low - high) / (high - low)
        here = np.tensordot(np.cos(np.arange(FILM_NODES) * math.acos(min(max(x, -1.0), 1.0))), self.polynomials, 1)
        heights, terms = self._begin
        rims = np.array([surface.semi_diameter for surface in lens.surfaces])
        beyond = np.abs(heights[:, None] * (terms @ here)) > rims
        rows = beyond.any(axis=1)
        first = int(np.argmax(rows))
        if first == 0:
            return None
        found = [
            self._meeting(here[:, k], float(rims[k]), float(heights[first])) for k in np.flatnonzero(beyond[first])
        ]
        return min(found) ** 2

    def _meeting(self, polynomial: Array, rim: float, height: float) -> float:
        """Return the height of the ray that meets a rim, sought from one near it."""
        for _ in range(ROUNDS):
            terms, slopes = self._terms(height)
            scale = float(terms @ polynomial)
            off = height * scale - math.copysign(rim, scale)
            height -= off / (scale + height * float(slopes @ polynomial))
        return height
