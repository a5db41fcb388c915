"""The rays by which copies of a lens are judged: for each field the nodes of a quadrature over the beam that passes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Beam, Lens, passing_beam

Array = NDArray[np.float64]

SHARES = (0.0, 0.7, 1.0)  # of the widest field, that are seen by default
LEFT_OPEN = 0.5  # of the beam on the axis, that the widest field keeps
LARGEST_SPOT = 0.02  # rms in focal lengths that it may have, unless that on the axis is larger
STEEPEST = 60.0  # degrees
SEARCH = 32  # rays across a beam that seek the widest field
COARSE = 48  # rays across a beam that seek its middle
AZIMUTHS = (90.0, 0.0, 270.0, 180.0)
BISECTIONS = 24


@dataclass(frozen=True)
class FieldRays:
    """The rays of one field.

    Attributes
    ----------
    beam : Beam
    origins, directions : (rays, 3) arrays
        In the frame of the lens [mm]; directions of unit length.
    weights : (rays,) array
        The share of the beam's area, in the plane of the first vertex, that each stands for.
    """

    beam: Beam
    origins: Array
    directions: Array
    weights: Array

    def turned(self, beam: Beam) -> FieldRays:
        """Return the rays of the same field seen from another side."""
        angle = np.radians(beam.azimuth_degrees - self.beam.azimuth_degrees)
        turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        return FieldRays(beam, self.origins @ turn, self.directions @ turn, self.weights)


def default_fields(lens: Lens, film_distance_mm: float, object_distance_mm: float, wavelength_nm: float) -> list[float]:
    """Return the axis, 0.7 of the widest field and that field [degrees], rounded to be read.

    The widest field keeps half of the beam on the axis, and its light together.
    """

    half = lens.surfaces[0].semi_diameter * (1 - 1e-12)
    across = np.linspace(-half, half, SEARCH)
    x, y = (axis.ravel() for axis in np.meshgrid(across, across))
    sags = np.nan_to_num(lens.surfaces[0].sag(x, y))

    def seen(degrees: float) -> tuple[float, float]:
        """Return how many rays of a field pass, spread over the first surface, and their rms on the film [mm]."""
        beam = Beam(degrees, object_distance_mm)
        _, directions = beam.rays(np.stack([x, y], axis=1))
        at = np.stack([x, y], axis=1) - sags[:, None] * directions[:, :2] / directions[:, 2:]
        rays = lens.trace(*beam.rays(at), wavelength_nm, "scene")
        good = rays.passed
        slopes = rays.directions[good, :2] / rays.directions[good, 2:]
        film = rays.origins[good, :2] + slopes * (lens.film_z(film_distance_mm) - rays.origins[good, 2:])
        return float(good.sum()), float(np.sqrt(np.var(film, axis=0).sum())) if good.any() else math.inf

    area, blur = seen(0.0)
    largest = max(LARGEST_SPOT * abs(lens.first_order(wavelength_nm).focal_length_mm), 2 * blur)
    low, high = 0.0, STEEPEST
    for _ in range(9):
        middle = (low + high) / 2
        left, spread = seen(middle)
        low, high = (middle, high) if left >= LEFT_OPEN * area and spread <= largest else (low, middle)
    digits = max(1 - math.floor(math.log10(low)), 0) if low > 0 else 0
    return [round(share * low, digits) for share in SHARES]


def beams_of(fields: Sequence[float], object_distance_mm: float) -> list[Beam]:
    """Return the beams of angles from the axis [degrees]: those beside it from four sides, as copies differ there."""
    return [
        Beam(field, object_distance_mm, azimuth)
        for field in dict.fromkeys(fields)
        for azimuth in (AZIMUTHS if field else AZIMUTHS[:1])
    ]


def rays_of(lens: Lens, beams: Sequence[Beam], wavelength_nm: float, rings: int, arms: int) -> list[FieldRays]:
    """Return the rays of several beams; a lens that looks the same from every azimuth has those of one, turned.

    Raises
    ------
    InputError
        When nothing of a beam passes.
    """
    found: list[FieldRays] = []
    for beam in beams:
        same = found and found[-1].beam.field_degrees == beam.field_degrees
        if same and lens.is_rotational:
            found.append(found[-1].turned(beam))
        else:
            found.append(field_rays(lens, beam, wavelength_nm, rings, arms))
    return found


def field_rays(lens: Lens, beam: Beam, wavelength_nm: float, rings: int, arms: int) -> FieldRays:
    """Return the rays of a beam that passes the design.

    Along each of `arms` directions from the middle of the beam, the edge is found by bisection; `rings` Gaussian nodes
    in the squared radius lie inside of it (Forbes, J. Opt. Soc. Am. A 5, 1943, 1988, for a beam of any outline).

    Raises
    ------
    InputError
        When nothing of the beam passes.
    """
    points, _, _ = passing_beam(lens, beam, wavelength_nm, COARSE)
    middle = points.mean(axis=0)
    angles = 2 * np.pi * (np.arange(arms) + 0.5) / arms
    outward = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    edge = _edge(lens, beam, wavelength_nm, middle, outward, 2.0 * float(np.ptp(points, axis=0).max()))
    nodes, shares = np.polynomial.legendre.leggauss(rings)
    radii = np.sqrt((1 + nodes) / 2)
    places = middle + (radii[:, None, None] * (edge[:, None] * outward)).reshape(-1, 2)
    weights = (shares[:, None] * edge**2).ravel()
    origins, directions = beam.rays(places)
    directions = directions / np.sqrt(np.sum(directions * directions, axis=1, keepdims=True))
    weights = np.where(lens.trace(origins, directions, wavelength_nm, "scene").passed, weights, 0.0)
    if not weights.sum() > 0:
        raise InputError(f"{lens.name}: nothing of a beam at {beam.field_degrees:g} degrees comes through")
    return FieldRays(beam, np.array(origins), directions, weights / weights.sum())


def _edge(lens: Lens, beam: Beam, wavelength_nm: float, middle: Array, outward: Array, limit: float) -> Array:
    """Return how far from the middle of a beam its rays pass, along each direction (n, 2)."""
    low, high = np.zeros(len(outward)), np.full(len(outward), limit)
    for _ in range(BISECTIONS):
        trial = (low + high) / 2
        passed = lens.trace(*beam.rays(middle + trial[:, None] * outward), wavelength_nm, "scene").passed
        low, high = np.where(passed, trial, low), np.where(passed, high, trial)
    return low
