"""The rays by which copies of a lens are judged: for each field the nodes of a quadrature over the beam that passes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

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
OUTLINE = 96  # directions from the middle of a beam in which it is asked what bounds it
SECTIONS, ROUNDS = 16, 4  # into which each round parts what is left between two of them
TERMS, HIGHEST = 0.4, 14  # most terms of a polynomial over a beam, for each of its rays, and its highest degree
MOST_CORNERS = 16  # beyond which rims that coincide make no corners


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
    places : (rays, 2) array
        Where they cross that plane, from the middle of the beam in units of its size.
    finer : ((n, rays), (n,) arrays) or None
        What gives at more places what the rays have at theirs, and the shares of those places.
    """

    beam: Beam
    origins: Array
    directions: Array
    weights: Array
    places: Array
    finer: tuple[Array, Array] | None = None

    def turned(self, beam: Beam) -> FieldRays:
        """Return the rays of the same field seen from another side."""
        angle = np.radians(beam.azimuth_degrees - self.beam.azimuth_degrees)
        turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        return replace(self, beam=beam, origins=self.origins @ turn, directions=self.directions @ turn)

    def filled_in(self, finer: FieldRays) -> FieldRays:
        """Return the same with what gives at the places of other rays, that are more, what these have at theirs.

        It is the polynomial over the beam with the least squared difference.
        """
        degree = min(int(math.sqrt(2 * TERMS * len(self.weights)) - 1.5), HIGHEST)
        root = np.sqrt(self.weights)[:, None]
        fit = np.linalg.pinv(root * _polynomials(self.places, degree)) * root.T
        return replace(self, finer=(_polynomials(finer.places, degree) @ fit, finer.weights))


def _polynomials(places: Array, degree: int) -> Array:
    """Return the products of Legendre polynomials in x and y up to a degree (n, terms)."""
    x, y = (np.polynomial.legendre.legvander(values, degree) for values in places.T)
    return np.stack([x[:, i] * y[:, j] for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)


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


class Field:
    """One angle from the axis, seen from one side or four, and the rays by which it is judged.

    Along directions from the middle of the beam the edge is found by bisection; Gaussian nodes in the squared radius
    lie inside of it (Forbes, J. Opt. Soc. Am. A 5, 1943, 1988, for a beam of any outline). The directions are Gaussian
    nodes too, between corners of the outline, where another rim begins to bound it; they are even where it has none.

    Raises
    ------
    InputError
        When nothing of the beam passes.
    """

    def __init__(self, lens: Lens, beams: Sequence[Beam], wavelength_nm: float) -> None:
        self.lens, self.beams, self.wavelength_nm = lens, beams, wavelength_nm
        self._outlines = [_outline(lens, beam, wavelength_nm) for beam in (beams[:1] if lens.is_rotational else beams)]

    def rays(self, rings: int, arms: int) -> list[FieldRays]:
        """Return the rays of each beam, in rings of about `arms`; of a round lens those of the first, turned."""
        found = [
            _beam_rays(self.lens, beam, self.wavelength_nm, outline, rings, arms)
            for beam, outline in zip(self.beams, self._outlines, strict=False)
        ]
        return [*found, *(found[0].turned(beam) for beam in self.beams[len(found) :])]


def fields_of(lens: Lens, degrees: Sequence[float], object_distance_mm: float, wavelength_nm: float) -> list[Field]:
    """Return fields by their angles from the axis; those beside it are seen from four sides, as copies differ there.

    Raises
    ------
    InputError
        When nothing of a beam passes.
    """
    return [
        Field(
            lens,
            [Beam(angle, object_distance_mm, azimuth) for azimuth in (AZIMUTHS if angle else AZIMUTHS[:1])],
            wavelength_nm,
        )
        for angle in dict.fromkeys(degrees)
    ]


def _outline(lens: Lens, beam: Beam, wavelength_nm: float) -> tuple[Array, float, Array]:
    """Return the middle of a beam, a distance from it beyond its edge, and the angles of its corners about it."""
    points, _, _ = passing_beam(lens, beam, wavelength_nm, COARSE)
    middle, limit = points.mean(axis=0), 2.0 * float(np.ptp(points, axis=0).max())
    return middle, limit, _corners(lens, beam, wavelength_nm, middle, limit)


def _beam_rays(
    lens: Lens, beam: Beam, wavelength_nm: float, outline: tuple[Array, float, Array], rings: int, arms: int
) -> FieldRays:
    middle, limit, corners = outline
    angles, turns = _directions(corners, arms)
    outward = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    edge = _edge(lens, beam, wavelength_nm, middle, outward, limit)
    nodes, shares = np.polynomial.legendre.leggauss(rings)
    radii = np.sqrt((1 + nodes) / 2)
    places = middle + (radii[:, None, None] * (edge[:, None] * outward)).reshape(-1, 2)
    weights = (shares[:, None] * (turns * edge**2)).ravel()
    origins, directions = beam.rays(places)
    directions = directions / np.sqrt(np.sum(directions * directions, axis=1, keepdims=True))
    weights = np.where(lens.trace(origins, directions, wavelength_nm, "scene").passed, weights, 0.0)
    if not weights.sum() > 0:
        raise InputError(f"{lens.name}: nothing of a beam at {beam.field_degrees:g} degrees comes through")
    return FieldRays(beam, np.array(origins), directions, weights / weights.sum(), (places - middle) / edge.max())


def _directions(corners: Array, arms: int) -> tuple[Array, Array]:
    """Return angles about the middle of a beam, and the angle that each stands for."""
    if not len(corners):
        return 2 * np.pi * (np.arange(arms) + 0.5) / arms, np.full(arms, 2 * np.pi / arms)
    angles, turns = [], []
    for start, end in zip(corners, np.append(corners[1:], corners[0] + 2 * np.pi), strict=True):
        nodes, shares = np.polynomial.legendre.leggauss(max(math.ceil(arms * (end - start) / (2 * np.pi)), 2))
        angles.append(start + (end - start) * (nodes + 1) / 2)
        turns.append((end - start) * shares / 2)
    return np.concatenate(angles), np.concatenate(turns)


def _corners(lens: Lens, beam: Beam, wavelength_nm: float, middle: Array, limit: float) -> Array:
    """Return the angles about the middle of a beam, ascending, between which one surface bounds it."""

    def bounds(angles: Array) -> NDArray[np.int32]:
        """Return which surface stops the first ray beyond the edge."""
        outward = np.stack([np.cos(angles), np.sin(angles)], axis=-1).reshape(-1, 2)
        edge = _edge(lens, beam, wavelength_nm, middle, outward, limit)
        beyond = middle + (edge + limit * 2.0 ** (1 - BISECTIONS))[:, None] * outward
        return np.reshape(lens.trace(*beam.rays(beyond), wavelength_nm, "scene").surface, angles.shape)

    angles = 2 * np.pi * np.arange(OUTLINE) / OUTLINE
    surfaces = bounds(angles)
    changes = np.flatnonzero(surfaces != np.roll(surfaces, -1))
    if len(changes) > MOST_CORNERS:
        return np.zeros(0)
    low, step = angles[changes], 2 * np.pi / OUTLINE
    for _ in range(ROUNDS if len(changes) else 0):
        step /= SECTIONS
        same = bounds(low[:, None] + step * np.arange(1, SECTIONS)) == surfaces[changes][:, None]
        low = low + step * np.where(same.all(axis=1), SECTIONS - 1, np.argmin(same, axis=1))
    return np.sort(low + step / 2)


def _edge(lens: Lens, beam: Beam, wavelength_nm: float, middle: Array, outward: Array, limit: float) -> Array:
    """Return how far from the middle of a beam its rays pass, along each direction (n, 2)."""
    low, high = np.zeros(len(outward)), np.full(len(outward), limit)
    for _ in range(BISECTIONS):
        trial = (low + high) / 2
        passed = lens.trace(*beam.rays(middle + trial[:, None] * outward), wavelength_nm, "scene").passed
        low, high = np.where(passed, trial, low), np.where(passed, high, trial)
    return low
