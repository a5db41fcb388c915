"""Spots, chief rays and distortion of beams from points in the scene, traced exactly.

Beams lie in the y-z plane unless they say otherwise. The rays of a beam are spread evenly over the plane of the first
vertex.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.chief_rays import unobstructed
from rptcam_cl.optics.first_order import limiting_surface
from rptcam_cl.optics.ray_trace import Rays, Status
from rptcam_cl.optics.wide_beam import grid_points, is_steep, passing_steep_beam, steep_chief_ray

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Beam:
    """Light from one point of the scene.

    Attributes
    ----------
    field_degrees : float
        Angle from the axis, seen from the first vertex; the light travels towards +y for a positive angle.
    object_distance_mm : float
        From the object plane to the first vertex; infinite for a parallel beam.
    azimuth_degrees : float
        Direction from the axis towards which the light of a positive angle travels, from +x towards +y.
    is_diffuse : bool
        Whether a lamp shines as a diffuse plane across the axis does: by the cosine.
    """

    field_degrees: float = 0.0
    object_distance_mm: float = np.inf
    azimuth_degrees: float = 90.0
    is_diffuse: bool = False

    def rays(self, points: Array) -> tuple[Array, Array]:
        """Return origins and directions (n, 3) of the rays through points (n, 2) of the plane of the first vertex."""
        origins = np.column_stack([points, np.zeros(len(points))])
        slope, turn = np.tan(np.radians(self.field_degrees)), np.radians(90.0 - self.azimuth_degrees)
        along = np.array([slope * np.sin(turn), slope * np.cos(turn), 1.0])
        if np.isinf(self.object_distance_mm):
            return origins, np.broadcast_to(along / np.linalg.norm(along), origins.shape)
        source = -along * self.object_distance_mm
        return np.broadcast_to(source, origins.shape), origins - source


@dataclass(frozen=True)
class Spot:
    """Where the rays of a beam meet the film. Lengths in millimetres.

    Attributes
    ----------
    area : float
        Cross-section of the beam that passes, in the plane of the first vertex [mm2].
    centroid : tuple of float
    rms, rms_x, rms_y : float
        Root mean square distance from the centroid.
    best_shift, best_rms : float
        Film shift (along the light) that makes the rms least, and that rms.
    rays : int
        How many rays passed.
    """

    area: float
    centroid: tuple[float, float]
    rms: float
    rms_x: float
    rms_y: float
    best_shift: float
    best_rms: float
    rays: int


def spot(
    lens: Lens,
    film_distance_mm: float,
    beam: Beam | None = None,
    wavelength_nm: float = LINE_D_NM,
    across: int = 256,
) -> Spot:
    """Return the spot of a beam on the film; `across` rays span the beam each way.

    Raises
    ------
    InputError
        When nothing of the beam passes.
    """
    beam = beam or Beam()
    points, rays, cell = passing_beam(lens, beam, wavelength_nm, across)
    film = _at_film(lens, rays, film_distance_mm)
    slopes = lens.sense * rays.directions[:, :2] / rays.directions[:, 2:]
    centroid, drift = film.mean(axis=0), slopes.mean(axis=0)
    off, turn = film - centroid, slopes - drift
    variance = np.mean(off * off, axis=0)
    spread = float(np.mean(np.sum(turn * turn, axis=1)))
    shift = -float(np.mean(np.sum(off * turn, axis=1))) / spread if spread > 0 else 0.0
    best = off + shift * turn
    return Spot(
        area=len(points) * cell,
        centroid=(float(centroid[0]), float(centroid[1])),
        rms=float(np.sqrt(variance.sum())),
        rms_x=float(np.sqrt(variance[0])),
        rms_y=float(np.sqrt(variance[1])),
        best_shift=shift,
        best_rms=float(np.sqrt(np.mean(np.sum(best * best, axis=1)))),
        rays=len(points),
    )


def passing_beam(lens: Lens, beam: Beam, wavelength_nm: float, across: int) -> tuple[Array, Rays, float]:
    """Return the points of the first vertex plane whose rays pass, those rays, and the area of a grid cell [mm2].

    Of a steep field, points and area are those of a plane across the beam.

    Raises
    ------
    InputError
        When nothing of the beam passes.
    """
    if is_steep(beam.field_degrees):
        _check_steep(lens, beam)
        return passing_steep_beam(lens, beam.field_degrees, wavelength_nm, across)
    box = _first_box(lens, beam)
    for count in (64, 64, across):
        for finer in (1, 4, 16):  # a small pupil behind a large first surface slips through the first grid
            points, size = grid_points(box, finer * count)
            rays = lens.trace(*beam.rays(points), wavelength_nm, start="scene")
            good = rays.passed
            if good.any() or count != 64:
                break
        if not good.any():
            raise InputError(f"{lens.name}: nothing of a beam at {beam.field_degrees:g} degrees comes through")
        passing = points[good]
        box = np.stack([passing.min(axis=0) - size, passing.max(axis=0) + size])
    kept = Rays(
        rays.origins[good], rays.directions[good], rays.status[good], rays.surface[good], rays.optical_path[good]
    )
    return passing, kept, float(size[0] * size[1])


def chief_ray(
    lens: Lens, field_degrees: float, wavelength_nm: float = LINE_D_NM, object_distance_mm: float = np.inf
) -> tuple[float, Rays]:
    """Return the ray through the centre of the stop: its height y in the plane of the first vertex [mm], and its trace.

    Of a steep field the height is that across the beam. Obstructions in the middle of the lens do not count.

    Raises
    ------
    InputError
        When no ray of that field reaches the centre of the stop.
    """
    lens = unobstructed(lens)
    stop = limiting_surface(lens, wavelength_nm)
    if is_steep(field_degrees):
        _check_steep(lens, Beam(field_degrees, object_distance_mm))
        return steep_chief_ray(lens, field_degrees, stop, wavelength_nm)
    open_surfaces = tuple(replace(surface, semi_diameter=np.inf, region=None) for surface in lens.surfaces[: stop + 1])
    front = replace(lens, surfaces=open_surfaces)
    beam = Beam(field_degrees, object_distance_mm)

    def miss(heights: Array) -> Array:
        rays = front.trace(*beam.rays(np.column_stack([np.zeros_like(heights), heights])), wavelength_nm, start="scene")
        return np.where(rays.status == Status.ok, rays.origins[:, 1], np.nan)

    box = _first_box(lens, beam)
    heights = np.linspace(box[0, 1], box[1, 1], 401)
    values = miss(heights)
    with np.errstate(invalid="ignore"):
        cross = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) <= 0)
    if not len(cross):
        raise InputError(f"{lens.name}: no ray at {field_degrees:g} degrees reaches the centre of the stop")
    at = cross[np.argmin(np.abs(values[cross]) + np.abs(values[cross + 1]))]
    low, high = heights[at], heights[at + 1]
    for _ in range(6):
        trial = np.linspace(low, high, 65)
        sign = np.sign(miss(trial))
        k = int(np.flatnonzero(sign[:-1] * sign[1:] <= 0)[0])
        low, high = trial[k], trial[k + 1]
    height = float((low + high) / 2)
    return height, lens.trace(*beam.rays(np.array([[0.0, height]])), wavelength_nm, start="scene")


def _check_steep(lens: Lens, beam: Beam) -> None:
    if np.isfinite(beam.object_distance_mm) or beam.azimuth_degrees != 90.0:
        raise InputError(
            f"{lens.name}: nothing of a beam at {beam.field_degrees:g} degrees comes through:"
            " an object plane across the axis does not reach there"
        )


def distortion(lens: Lens, film_distance_mm: float, field_degrees: float, wavelength_nm: float = LINE_D_NM) -> float:
    """Return the chief ray's film height over that of the ideal f tan(angle), less 1, for an object at infinity."""
    _, ray = chief_ray(lens, field_degrees, wavelength_nm)
    ideal = lens.first_order(wavelength_nm).front_focal_length_mm * np.tan(np.radians(field_degrees))
    return float(_at_film(lens, ray, film_distance_mm)[0, 1] / ideal - 1.0)


def _first_box(lens: Lens, beam: Beam) -> Array:
    """Return the corners (2, 2) of a box in the plane of the first vertex that holds every ray to the first surface."""
    first = lens.surfaces[0]
    if not np.isfinite(first.semi_diameter):
        raise InputError(f"{lens.name}: the first surface needs a diameter")
    inside = first.semi_diameter * (1 - 1e-12)  # the rim of a whole hemisphere may lie a rounding beyond its reach
    heights = np.linspace(0.0, inside, 33)
    sags = np.abs([first.rim_sag(height) for height in heights])
    slope = abs(np.tan(np.radians(beam.field_degrees))) + first.semi_diameter / beam.object_distance_mm
    reach = float(np.max(heights + sags * slope)) * 1.001
    return np.array([[-reach, -reach], [reach, reach]])


def _at_film(lens: Lens, rays: Rays, film_distance_mm: float) -> Array:
    """Return x, y (n, 2) where rays meet the film."""
    step = (lens.film_z(film_distance_mm) - rays.origins[:, 2]) / rays.directions[:, 2]
    return rays.origins[:, :2] + rays.directions[:, :2] * step[:, None]
