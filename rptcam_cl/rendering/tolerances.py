"""What may be off in a lens as made: specifications of tolerances, what they mean for it, and chances of copies."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import Document, KeyPath, dotted, read_yaml
from rptcam_cl.optics.as_built import Copies, Deviation, film_points, first_met, is_free_gap
from rptcam_cl.optics.beams import Beam, passing_beam
from rptcam_cl.optics.glass import AIR, abbe_number
from rptcam_cl.optics.lens import Lens, film_distance
from rptcam_cl.optics.spots import parts_of_field, widest_by
from rptcam_cl.optics.waves import diffraction_mtf
from rptcam_cl.scene.lens_settings import GRADES, OF_EITHER, Distribution, Merit, Tolerance, Tolerances, grade
from rptcam_cl.scene.load import input_error

# Specifications of tolerances: a grade by its name, a YAML file, or the same as Python data.


@dataclass(frozen=True)
class Specification:
    """Tolerances, and where each of their keys stands.

    Attributes
    ----------
    tolerances : Tolerances
    where : callable
        Returns what an error about a key path begins with, such as ``tolerances.yaml:3:5: ``.
    """

    tolerances: Tolerances
    where: Callable[[KeyPath], str] = lambda path: ""

    def problem(self, path: KeyPath, text: str) -> InputError:
        """Return the error of a key that does not fit the lens."""
        return InputError(f"{self.where(path)}{dotted(path)}: {text}")


def specification(source: str | Path | bytes | Mapping[str, Any] | Tolerances) -> Specification:
    """Return the specification of a grade's name, a YAML file, its text as bytes, or a mapping of the same form.

    Parameters
    ----------
    source
        One of `GRADES`, or a path.

    Raises
    ------
    InputError
        ``FILE:LINE:COL: key.path: problem (got …; allowed …)``.
    StateError
        When the file cannot be read.
    """
    if isinstance(source, Tolerances):
        return Specification(source)
    if isinstance(source, str) and source in GRADES:
        return Specification(grade(source))
    if isinstance(source, Mapping):
        return _check_specification(dict(source), None)
    if isinstance(source, str | Path) and not Path(source).exists():
        raise InputError(f"{source}: no such file and no grade of tolerances (allowed: {', '.join(GRADES)}, or a file)")
    document = read_yaml(source if isinstance(source, bytes) else Path(source))
    if not isinstance(document.data, dict):
        raise InputError(f"{document.name}:1:1: a specification must be a mapping (allowed: with the key tolerances)")
    return _check_specification(document.data, document)


def _check_specification(data: dict[str, Any], document: Document | None) -> Specification:
    def where(path: KeyPath, at_key: bool = False) -> str:
        return "" if document is None else f"{document.where(path, at_key)}: "

    try:
        return Specification(Tolerances.model_validate(data), where)
    except ValidationError as problem:
        raise input_error(problem, data, where) from None


# What a specification means for a lens: each thing of it that may be off, by how much and by what distribution.

_FRINGE_MM = 632.8e-6 / 2  # of sag, against a test glass
_ARCMIN = math.pi / 180 / 60
HALF = 0.5  # of a radius, the most that may be off


@dataclass(frozen=True)
class Limit:
    """A deviation and how large it may be.

    Attributes
    ----------
    deviation : Deviation
    size : float
        Largest size either way, in the unit of the deviation.
    label : str
        What is off, and by how much at most: ``radius of surface 3 ± 0.2 %``.
    distribution : "uniform", "normal" or "end_point"
    sigmas : float
        How many standard deviations of a normal distribution the size is.
    key : (entry, item)
        Its place in the specification: what its random numbers are keyed by.
    """

    deviation: Deviation
    size: float
    label: str
    distribution: Distribution
    sigmas: float
    key: tuple[int, int]


Key = Literal["tolerances", "compensators"]
_Item = tuple[tuple[int, ...], str]
"""The surfaces that a tolerance concerns, and what they are called."""


def elements(lens: Lens) -> list[int]:
    """Return the first surface of each element: those with glass behind them that light has not crossed before."""
    spaces = [frozenset(pair) for pair in itertools.pairwise(first_met(lens))]
    return [k for k, space in enumerate(spaces) if lens.surfaces[k].glass != AIR and space not in spaces[:k]]


def components(lens: Lens) -> list[tuple[int, ...]]:
    """Return the surfaces of each element, or of elements that are cemented."""
    met, parts = first_met(lens), list[tuple[int, ...]]()
    for k in elements(lens):
        joined = {met[k], met[k + 1]}
        touching = [part for part in parts if joined & {met[j] for j in part}]
        parts = [part for part in parts if part not in touching]
        parts.append(tuple(sorted({k, k + 1}.union(*touching))))
    return sorted(parts)


def limits(lens: Lens, specification: Specification, key: Key = "tolerances") -> list[Limit]:
    """List all that may be off: what concerns surfaces first, then elements, then groups, as poses act.

    With ``compensators`` as the key it is what is adjusted, and within which range.

    Raises
    ------
    InputError
        When a tolerance names what the lens does not have.
    """
    wanted = specification.tolerances
    ranked: list[tuple[int, Limit]] = []
    for entry, tolerance in enumerate(getattr(wanted, key)):
        distribution = tolerance.distribution or wanted.distribution
        sigmas = tolerance.sigmas or wanted.sigmas
        rank = 2 if tolerance.group else 1 if tolerance.surfaces is None and tolerance.of == "element" else 0
        rank = 0 if tolerance.quantity.startswith("wedge") else rank
        for number, item in enumerate(_items(lens, specification, entry, key)):
            deviation, size, text = _deviation(lens, tolerance, item)
            if size is not None:
                label = f"{text} {'behind' if tolerance.quantity == 'spacing_mm' else 'of'} {item[1]}"
                ranked.append((rank, Limit(deviation, size, label, distribution, sigmas, (entry, number))))
    if not ranked and key == "tolerances":
        raise InputError(f"{lens.name}: none of the tolerances concerns anything of this lens")
    return [limit for _, limit in sorted(ranked, key=lambda pair: pair[0])]


def _items(lens: Lens, specification: Specification, entry: int, key: Key = "tolerances") -> Iterator[_Item]:
    """Yield what a tolerance concerns."""
    tolerance: Tolerance = getattr(specification.tolerances, key)[entry]
    path: KeyPath = (key, entry)
    quantity = tolerance.quantity
    if tolerance.group is not None:
        first, last = tolerance.group
        _check(specification, (*path, "group"), "surface", last, len(lens.surfaces))
        yield (tuple(range(first, last + 1)), f"surfaces {first} to {last}")
    elif quantity.startswith(("decentre", "tilt")) and tolerance.of == "element" and tolerance.surfaces is None:
        every = components(lens)
        for k in _chosen(specification, path, "elements", "element", len(every)):
            yield (every[k], f"element {k} ({_words(every[k])})")
    elif quantity.startswith(("radius", "spacing", "decentre", "tilt")):
        chosen = _chosen(specification, path, "surfaces", "surface", len(lens.surfaces))
        for k in chosen:
            if _concerns(lens, quantity, k):
                yield ((k,), f"surface {k}")
            elif tolerance.surfaces is not None:
                place = (*path, "surfaces", tolerance.surfaces.index(k))
                what = "no air space is behind it" if quantity == "spacing_mm" else "light does not bend there"
                if (met := first_met(lens)[k]) != k:
                    what = f"light meets surface {met} there once more, whose errors it has"
                raise specification.problem(place, f"{what} (got {k})")
    else:
        glasses = elements(lens)
        for k in _chosen(specification, path, "elements", "element", len(glasses)):
            item = (glasses[k], glasses[k] + 1)
            yield (item, f"element {k} ({_words(item)})")


def _words(surfaces: tuple[int, ...]) -> str:
    """Name the surfaces of an element; of those in a row the ends."""
    first, last = surfaces[0], surfaces[-1]
    if surfaces == tuple(range(first, last + 1)):
        return f"surfaces {first} to {last}"
    return f"surfaces {', '.join(map(str, surfaces))}"


def alone(lens: Lens, specification: Specification, limit: Limit, factor: float) -> dict[str, Any]:
    """Return a limit as a tolerance of its own, in the form of a file, so many times as large: rounded down."""
    entry, number = limit.key
    tolerance = specification.tolerances.tolerances[entry]
    quantity, item = tolerance.quantity, list(_items(lens, specification, entry))[number]
    size = factor * float(getattr(tolerance, quantity))
    digit = 10.0 ** (math.floor(math.log10(size)) - 1) if size > 0 else 1.0
    written: dict[str, Any] = {quantity: float(f"{math.floor(size / digit * (1 + 1e-12)) * digit:.2g}")}
    if tolerance.group is not None:
        return written | {"group": list(tolerance.group)}
    if item[1].startswith("element"):
        return written | {"elements": [int(item[1].split()[1])]}
    return written | {"surfaces": [item[0][0]]} | ({"of": "surface"} if quantity in OF_EITHER else {})


def _concerns(lens: Lens, quantity: str, k: int) -> bool:
    """Return whether a surface has what a tolerance is of."""
    if quantity == "spacing_mm":
        return lens.surfaces[k].glass == AIR and is_free_gap(lens, k)
    has_radius = lens.surfaces[k].curvature != 0 or quantity not in ("radius_percent", "radius_mm")
    bends = lens.media[k] != lens.media[k + 1] or lens.surfaces[k].is_mirror
    return first_met(lens)[k] == k and bends and has_radius


def _chosen(specification: Specification, path: KeyPath, key: str, noun: str, count: int) -> list[int]:
    """Return the numbers that a key of a tolerance names, all without it."""
    given = getattr(getattr(specification.tolerances, str(path[0]))[int(path[1])], key)
    if given is None:
        return list(range(count))
    for place, number in enumerate(given):
        _check(specification, (*path, key, place), noun, number, count)
    return list(dict.fromkeys(given))


def _check(specification: Specification, path: KeyPath, noun: str, number: int, count: int) -> None:
    if number >= count:
        allowed = f"0 to {count - 1}" if count else "none, the lens has no such thing"
        raise specification.problem(path, f"the lens has no {noun} {number} (got {number}; allowed: {allowed})")


def _deviation(lens: Lens, tolerance: Tolerance, item: _Item) -> tuple[Deviation, float | None, str]:
    """The deviation that a tolerance of one item limits, its size, and its words; no size where it is of no effect."""
    quantity, (k, *more) = tolerance.quantity, item[0]
    last = next((j for j in range(k, len(lens.surfaces)) if j + 1 not in more), k)
    others = tuple(j for j in more if j > last)
    value = float(getattr(tolerance, quantity))
    surface = lens.surfaces[k]
    size: float | None
    match quantity:
        case "radius_percent":
            return Deviation("radius", k, k), value / 100, f"radius ±{value:g} %"
        case "radius_mm":
            return Deviation("radius", k, k), min(value * abs(surface.curvature), HALF), f"radius ±{value:g} mm"
        case "radius_fringes":
            size = 2 * value * _FRINGE_MM / surface.semi_diameter**2
            return Deviation("curvature", k, k), size, f"power ±{value:g} fringes"
        case "spacing_mm":
            size = min(value, abs(surface.thickness))
            return Deviation("thickness", k, k), size or None, f"air space ±{value:g} mm"
        case "thickness_mm":
            size = min(value, abs(surface.thickness)) if is_free_gap(lens, k) else None
            return Deviation("thickness", k, k), size, f"thickness ±{value:g} mm"
        case "thickness_percent":
            size = value / 100 * abs(surface.thickness) if is_free_gap(lens, k) else None
            return Deviation("thickness", k, k), size, f"thickness ±{value:g} %"
        case "index":
            return Deviation("index", k, k), value, f"index ±{value:g}"
        case "abbe_percent":
            disperses = math.isfinite(abbe_number(surface.glass))
            return Deviation("abbe", k, k), value / 100 if disperses else None, f"Abbe number ±{value:g} %"
        case "wedge_arcmin":
            return Deviation("tilt", k + 1, k + 1), value * _ARCMIN, f"wedge {value:g}′"
        case "wedge_um":
            angle = 1e-3 * value / (2 * lens.surfaces[k + 1].semi_diameter)
            return Deviation("tilt", k + 1, k + 1), angle, f"wedge {value:g} µm"
        case "decentre_mm":
            return Deviation("decentre", k, last, others), value, f"decentre {value:g} mm"
        case "tilt_arcmin":
            return Deviation("tilt", k, last, others), value * _ARCMIN, f"tilt {value:g}′"
    return Deviation("tilt", k, last, others), 1e-3 * value / (2 * surface.semi_diameter), f"tilt {value:g} µm"


Array = NDArray[np.float64]


# What copies are worth: the rays that judge them, their spots and modulation, compensators set.

FilmPoints = Callable[[Copies, Array, Array, float, float], tuple[Array, Array]]
"""Traces rays to the films of copies, as `rptcam_cl.optics.as_built.film_points` does on the host."""

# The rays by which copies of a lens are judged: for each field the nodes of a quadrature over the beam that passes.

STEEPEST = 60.0  # degrees
SEARCH = 32  # rays across a beam that seek the widest field
COARSE = 48  # rays across a beam that seek its middle
AZIMUTHS = (90.0, 0.0, 270.0, 180.0)
BISECTIONS = 24
OUTLINE = 96  # directions from the middle of a beam in which it is asked what bounds it
SECTIONS, _CORNER_ROUNDS = 16, 3  # into which each round parts what is left between two of them
TERMS, HIGHEST = 0.4, 14  # most terms of a polynomial over a beam, for each of its rays, and its highest degree
_MOST_CORNERS = 16  # beyond which rims that coincide make no corners


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

    def turn(self, beam: Beam) -> FieldRays:
        """Return the rays of the same field seen from another side."""
        angle = np.radians(beam.azimuth_degrees - self.beam.azimuth_degrees)
        turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        return replace(self, beam=beam, origins=self.origins @ turn, directions=self.directions @ turn)

    def filled_in(self, finer: FieldRays) -> FieldRays:
        """The same with what gives at the places of other rays, that are more, what these have at theirs.

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

    def see(degrees: float) -> tuple[float, float]:
        """How many rays of a field pass, spread over the first surface, and their rms on the film [mm]."""
        beam = Beam(degrees, object_distance_mm)
        _, directions = beam.rays(np.stack([x, y], axis=1))
        at = np.stack([x, y], axis=1) - sags[:, None] * directions[:, :2] / directions[:, 2:]
        rays = lens.trace(*beam.rays(at), wavelength_nm, "scene")
        good = rays.passed
        slopes = rays.directions[good, :2] / rays.directions[good, 2:]
        film = rays.origins[good, :2] + slopes * (lens.film_z(film_distance_mm) - rays.origins[good, 2:])
        return float(good.sum()), float(np.sqrt(np.var(film, axis=0).sum())) if good.any() else math.inf

    return parts_of_field(widest_by(see, lens.first_order(wavelength_nm).focal_length_mm, 9, STEEPEST))


Sampler = Callable[[int, int], list[FieldRays]]
"""Makes the rays of each beam of a field, in so many rings of about so many arms."""


def sample_field(lens: Lens, degrees: float, object_distance_mm: float, wavelength_nm: float) -> Sampler:
    """Find the outlines of the beams of a field; one beside the axis is seen from four sides, as copies differ there.

    Along directions from the middle of the beam the edge is found by bisection; Gaussian nodes in the squared radius
    lie inside of it (Forbes, J. Opt. Soc. Am. A 5, 1943, 1988, for a beam of any outline). The directions are Gaussian
    nodes too, between corners of the outline, where another rim begins to bound it; they are even where it has none.

    Raises
    ------
    InputError
        When nothing of a beam passes.
    """
    beams = [Beam(degrees, object_distance_mm, azimuth) for azimuth in (AZIMUTHS if degrees else AZIMUTHS[:1])]
    see = beams[:1] if lens.is_rotational else beams
    outlines = [_outline(lens, beam, wavelength_nm) for beam in see]

    def rays(rings: int, arms: int) -> list[FieldRays]:
        own = [
            _beam_rays(lens, beam, wavelength_nm, outline, rings, arms)
            for beam, outline in zip(see, outlines, strict=True)
        ]
        return [*own, *(own[0].turn(beam) for beam in beams[len(own) :])]  # of a round lens those of the first

    return rays


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
    inner, edge = _edges(lens, beam, wavelength_nm, middle, outward, limit)
    nodes, shares = np.polynomial.legendre.leggauss(rings)
    hole = inner / edge
    radii = np.sqrt(hole**2 + (1 - hole**2) * (1 + nodes[:, None]) / 2)
    places = middle + (radii[..., None] * (edge[:, None] * outward)).reshape(-1, 2)
    weights = (shares[:, None] * (turns * (edge**2 - inner**2))).ravel()
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
        """Find the surface that stops the first ray beyond the edge."""
        outward = np.stack([np.cos(angles), np.sin(angles)], axis=-1).reshape(-1, 2)
        edge = _edges(lens, beam, wavelength_nm, middle, outward, limit)[1]
        beyond = middle + (edge + limit * 2.0 ** (1 - BISECTIONS))[:, None] * outward
        return np.reshape(lens.trace(*beam.rays(beyond), wavelength_nm, "scene").surface, angles.shape)

    angles = 2 * np.pi * np.arange(OUTLINE) / OUTLINE
    surfaces = bounds(angles)
    changes = np.flatnonzero(surfaces != np.roll(surfaces, -1))
    if len(changes) > _MOST_CORNERS:
        return np.zeros(0)
    low, step = angles[changes], 2 * np.pi / OUTLINE
    for _ in range(_CORNER_ROUNDS if len(changes) else 0):
        step /= SECTIONS
        same = bounds(low[:, None] + step * np.arange(1, SECTIONS)) == surfaces[changes][:, None]
        low = low + step * np.where(same.all(axis=1), SECTIONS - 1, np.argmin(same, axis=1))
    return np.sort(low + step / 2)


def _edges(
    lens: Lens, beam: Beam, wavelength_nm: float, middle: Array, outward: Array, limit: float
) -> tuple[Array, Array]:
    """How far from the middle of a beam rays begin to pass, and how far they do, along each direction (n, 2)."""

    def passes(radii: Array) -> NDArray[np.bool_]:
        return lens.trace(*beam.rays(middle + radii[:, None] * outward), wavelength_nm, "scene").passed

    def bisected(inside: Array, outside: Array) -> Array:
        for _ in range(BISECTIONS):
            trial = (inside + outside) / 2
            passed = passes(trial)
            inside, outside = np.where(passed, trial, inside), np.where(passed, outside, trial)
        return inside

    none = np.zeros(len(outward))
    if not lens.is_obstructed:
        return none, bisected(none, np.full(len(outward), limit))
    steps = limit * np.arange(COARSE + 1) / COARSE
    passed = np.stack([passes(np.full(len(outward), radius)) for radius in steps])
    first, last = np.argmax(passed, axis=0), COARSE - np.argmax(passed[::-1], axis=0)
    outer = bisected(steps[last], steps[np.minimum(last + 1, COARSE)])
    return np.where(first > 0, bisected(steps[first], steps[np.maximum(first - 1, 0)]), 0.0), outer


# How good copies of a lens are: spots and modulation over fields, with the film where it is or at its best.

_POINTS_TOGETHER = 2**20  # on the films of some copies, which are held at a time
ROUNDS = 3  # in which compensators are set
_SWEEPS = 60  # of the columns in each: they are few, and seldom alike


@dataclass(frozen=True)
class Scores:
    """What copies are worth.

    Attributes
    ----------
    spots_um : (copies, fields) array
        Rms distance from the centroid of all wavelengths together [micrometres]; infinite where no ray comes through.
    mtf : (copies, fields) array
        Modulation at the frequency of the merit, the mean of tangential and sagittal.
    shifts_mm : (copies,) array
        How far the film was moved along the light to refocus [mm].
    """

    spots_um: Array
    mtf: Array
    shifts_mm: Array

    @property
    def spot_um(self) -> Array:
        """Rms over the fields (copies,) [micrometres]."""
        return np.asarray(np.sqrt(np.mean(self.spots_um**2, axis=1)))

    @property
    def modulation(self) -> Array:
        """Mean over the fields (copies,)."""
        return np.asarray(np.mean(self.mtf, axis=1))

    def by(self, merit: str) -> Array:
        """Return the numbers (copies,) that rank copies: ``spot``, smaller is better, or ``mtf``, larger is."""
        return self.spot_um if merit == "spot" else self.modulation


class Judge:
    """Gives copies of one lens their scores.

    Parameters
    ----------
    lens : Lens
        The design.
    rays : sequence of FieldRays
        Of each field.
    merit : Merit
    film_distance_mm : float
        From the last vertex to the film before it is moved.
    compensators : sequence of Limit
        What is adjusted in copies, and how far.
    trace : FilmPoints
    """

    def __init__(
        self,
        lens: Lens,
        rays: Sequence[FieldRays],
        merit: Merit,
        film_distance_mm: float,
        compensators: Sequence[Limit] = (),
        trace: FilmPoints = film_points,
    ) -> None:
        self.lens, self.merit, self.film, self.compensators = lens, merit, film_distance_mm, compensators
        self.trace = trace
        self.origins = np.concatenate([field.origins for field in rays])
        self.directions = np.concatenate([field.directions for field in rays])
        self.finer = [field.finer for field in rays]
        self.counts = np.array([len(field.weights) for field in rays])
        self.starts = np.cumsum(self.counts) - self.counts
        waves = len(merit.wavelengths_nm)
        self.weights = np.tile(np.concatenate([field.weights for field in rays]) / waves, (waves, 1))
        turns = np.radians([field.beam.azimuth_degrees for field in rays])
        self.radial = np.repeat(np.stack([np.cos(turns), np.sin(turns)], axis=1), self.counts, axis=0)
        self.limits = self._limits(lens)

    def best_shift(self, lens: Lens) -> float:
        """How far the film must move along the light for the least spots of the design in all fields [mm]."""
        points, slopes = (
            self._centre(self.weights[None], values) for values in self._film(Copies(lens, (), np.zeros((1, 0, 2))))
        )
        together, spread = (self._moment(self.weights, slopes, values).sum() for values in (points, slopes))
        return -float(together / spread)

    def scores(self, copies: Copies, refocus: bool, shifts_mm: Array | None = None) -> Scores:
        """Score copies, each with its film at the least spots of all fields where `refocus` says so.

        With `shifts_mm` (copies,) the film of each is moved by so much.
        """
        together = max(_POINTS_TOGETHER // self.weights.size, 1)
        parts = [
            self._part(copies.part(low, low + together), refocus, None if shifts_mm is None else shifts_mm[low:])
            for low in range(0, copies.count, together)
        ]
        return Scores(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def adjusted(self, copies: Copies, refocus: bool) -> Copies:
        """Return copies whose compensators stand where the spots of all fields are least, the film refocused or not.

        Rays move on the film as those of the design do, so that each step solves least squares within the ranges; a
        copy keeps what was best of `ROUNDS` steps.
        """
        if not self.compensators:
            return copies
        deviations = (*copies.deviations, *(limit.deviation for limit in self.compensators))
        axes = [(k, axis) for k, limit in enumerate(self.compensators) for axis in range(1 + limit.deviation.is_pair)]
        sizes = np.array([self.compensators[k].size for k, _ in axes])
        moves = self._moves(axes, sizes, refocus)
        square = self._products(moves)
        drawn = len(copies.deviations)

        def state(part: Copies, settings: Array) -> Copies:
            more = np.zeros((part.count, len(self.compensators), 2))
            for column, (k, axis) in enumerate(axes):
                more[:, k, axis] = settings[:, column] * sizes[column]
            return Copies(part.lens, deviations, np.concatenate([part.values[:, :drawn], more], axis=1))

        together = max(_POINTS_TOGETHER // self.weights.size, 1)
        every = []
        for low in range(0, copies.count, together):
            part = copies.part(low, low + together)
            best, least = np.zeros((part.count, len(axes))), np.full(part.count, np.inf)
            place = best
            for _ in range(ROUNDS + 1):
                size, toward = self._toward(state(part, place), moves, refocus)
                better = size < least
                best, least = np.where(better[:, None], place, best), np.where(better, size, least)
                place = _settle(square, toward, place)
            every.append(state(part, best))
        return Copies(copies.lens, deviations, np.concatenate([one.values for one in every]))

    def _moves(self, axes: Sequence[tuple[int, int]], sizes: Array, refocus: bool) -> Array:
        """Return how rays of the design move about the middle of their field (columns, wavelengths, rays, 2).

        A column for each axis of the compensators, by its size; the film's shift is taken out of all where it follows.
        """
        step = 1e-3
        values = np.zeros((2 * len(axes) + 1, len(self.compensators), 2))
        for column, (k, axis) in enumerate(axes):
            values[2 * column : 2 * column + 2, k, axis] = [step * sizes[column], -step * sizes[column]]
        points, slopes = self._film(Copies(self.lens, tuple(one.deviation for one in self.compensators), values))
        moves = (points[:-1:2] - points[1:-1:2]) / (2 * step)
        weights = np.repeat(self.weights[None], len(moves), axis=0)
        moves = self._centre(weights, np.nan_to_num(moves))
        slope = self._centre(self.weights[None], slopes[-1:])
        return self._refocus(weights, moves, np.broadcast_to(slope, moves.shape)) if refocus else moves

    def _refocus(self, weights: Array, points: Array, slopes: Array) -> Array:
        """Return points about the middle of their fields with the film where they lie nearest to it."""
        return np.asarray(points + self._best_shifts(weights, points, slopes)[:, None, None, None] * slopes)

    def _best_shifts(self, weights: Array, points: Array, slopes: Array) -> Array:
        """Return how far the film of each copy moves (copies,) [mm] to where points about their middles lie nearest."""
        together, spread = (self._moment(weights, slopes, one).sum(axis=1) for one in (points, slopes))
        return np.asarray(-together / np.where(spread > 0, spread, 1.0))

    def _trace_about_middles(self, copies: Copies) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Return weights of rays, points and slopes on the film about the middle of their field, and which are dark."""
        points, slopes = self._film(copies)
        weights = self.weights[None] * np.isfinite(points[..., 0] + slopes[..., 0])
        totals = self._sums(weights)
        weights = weights / self._each(np.where(totals == 0, 1.0, totals))
        points, slopes = (self._centre(weights, np.nan_to_num(values)) for values in (points, slopes))
        return weights, points, slopes, totals == 0

    def _toward(self, copies: Copies, moves: Array, refocus: bool) -> tuple[Array, Array]:
        """Return the sum of squared spots of copies, and its half derivative by each column (copies, columns)."""
        weights, points, slopes, dark = self._trace_about_middles(copies)
        points = self._refocus(weights, points, slopes) if refocus else points
        size = self._moment(weights, points, points).sum(axis=1)
        toward = [self._moment(weights, np.broadcast_to(move, points.shape), points).sum(axis=1) for move in moves]
        return np.where(dark.any(axis=1), np.inf, size), np.stack(toward, axis=1)

    def _products(self, moves: Array) -> Array:
        """Return the mean products of columns, summed over the fields (columns, columns)."""
        weights = np.repeat(self.weights[None], len(moves), axis=0)
        rows = [self._moment(weights, np.broadcast_to(move, moves.shape), moves).sum(axis=1) for move in moves]
        return np.stack(rows)

    def _part(self, copies: Copies, refocus: bool, shifts: Array | None) -> tuple[Array, Array, Array]:
        weights, points, slopes, dark = self._trace_about_middles(copies)
        if shifts is None:
            shifts = np.zeros(copies.count)
            if refocus:  # but for the design, which stands at its best already
                changed = np.any(copies.values != 0, axis=(1, 2))
                shifts = np.where(changed, self._best_shifts(weights, points, slopes), 0.0)
        shifts = shifts[: copies.count]
        points = points + shifts[:, None, None, None] * slopes
        spots = 1e3 * np.sqrt(self._moment(weights, points, points))
        return np.where(dark, np.inf, spots), self._modulation(weights, points), shifts

    def _film(self, copies: Copies) -> tuple[Array, Array]:
        """Find where rays meet the film and their slopes there, each (copies, wavelengths, rays, 2)."""
        pairs = [
            self.trace(copies, self.origins, self.directions, wavelength, self.film)
            for wavelength in self.merit.wavelengths_nm
        ]
        return tuple(np.stack([pair[k] for pair in pairs], axis=1) for k in (0, 1))  # type: ignore[return-value]

    def _sums(self, values: Array) -> Array:
        """Return the sums (copies, fields, …) of values (copies, wavelengths, rays, …)."""
        return np.asarray(np.add.reduceat(values.sum(axis=1), self.starts, axis=1))

    def _each(self, values: Array) -> Array:
        """Return values (copies, fields, …) for each ray (copies, 1, rays, …)."""
        return np.repeat(values, self.counts, axis=1)[:, None]

    def _centre(self, weights: Array, values: Array) -> Array:
        """Return values (copies, wavelengths, rays, 2) from the mean of their field."""
        return values - self._each(self._sums(weights[..., None] * values))

    def _moment(self, weights: Array, one: Array, other: Array) -> Array:
        """Return the mean product of centred vectors in each field (copies, fields)."""
        return self._sums(weights * (one[..., 0] * other[..., 0] + one[..., 1] * other[..., 1]))

    def _axes(self) -> tuple[Array, Array]:
        """Return the directions along the field of each ray and across it, each (rays, 2)."""
        return self.radial, np.stack([-self.radial[:, 1], self.radial[:, 0]], axis=1)

    def _modulation(self, weights: Array, points: Array) -> Array:
        """Return the mean of tangential and sagittal modulation, as `lens mtf` has them, of centred points.

        Where a field has finer places, what the points are there counts, of copies that let all rays through.
        """
        mean = np.zeros((len(points), len(self.counts)))
        for limit, axis in zip(self.limits, self._axes(), strict=True):
            along = 2 * np.pi * self.merit.mtf_per_mm * (points[..., 0] * axis[:, 0] + points[..., 1] * axis[:, 1])
            cosines, sines = (self._sums(weights * function(along)) for function in (np.cos, np.sin))
            modulation = np.hypot(cosines, sines)
            for k, finer in enumerate(self.finer):
                rays = slice(self.starts[k], self.starts[k] + self.counts[k])
                if finer is not None:
                    full = np.all((weights[..., rays] > 0) == (self.weights[:, rays] > 0), axis=(1, 2))
                    there = along[full][..., rays] @ finer[0].T
                    both = ((function(there) @ finer[1]).mean(axis=1) for function in (np.cos, np.sin))
                    modulation[full, k] = np.hypot(*both)
            mean += modulation * limit / 2
        return mean

    def _limits(self, lens: Lens) -> Array:
        """Return the modulation that diffraction leaves the design (2, fields), along the field and across it."""
        _, slopes = self._film(Copies(lens, (), np.zeros((1, 0, 2))))
        cosines = slopes / np.sqrt(1.0 + np.sum(slopes**2, axis=-1, keepdims=True))
        mean = np.zeros((2, len(self.counts)))
        for place, wavelength in enumerate(self.merit.wavelengths_nm):
            index = float(lens.indices(wavelength)[-1])
            weights = self.weights[None, [place]] * len(self.merit.wavelengths_nm)
            for number, axis in enumerate(self._axes()):
                along = np.sum(cosines[:, [place]] * axis, axis=-1)
                off = along - self._each(self._sums(weights * along))
                apertures = 2 * index * np.sqrt(self._sums(weights * off**2)[0])
                mean[number] += [diffraction_mtf([self.merit.mtf_per_mm], na, wavelength)[0] for na in apertures]
        return mean / len(self.merit.wavelengths_nm)


def _settle(square: Array, toward: Array, place: Array) -> Array:
    """Return settings (copies, columns) in -1 to 1 that make a sum of squares least, one column after the other.

    Parameters
    ----------
    square : (columns, columns) array
        Mean products of what the columns do.
    toward : (copies, columns) array
        The half derivative of the sum at the place.
    """
    ends = place.copy()
    for _ in range(_SWEEPS):
        for k in range(len(square)):
            if square[k, k] > 0:
                slope = toward[:, k] + (ends - place) @ square[:, k]
                ends[:, k] = np.clip(ends[:, k] - slope / square[k, k], -1.0, 1.0)
    return ends


# As many rays as the figures need.

RINGS = (6, 8, 10, 12, 16, 24, 32, 48)  # of rays in a beam, with twice as many in a ring, till figures stay
_SPOTS_STAY, _MODULATION_STAYS = 0.0025, 0.005  # share of a spot, and modulation, by which more rays may change a field


def judge_of(
    given: Specification, tried: Copies, front: float, compensators: Sequence[Limit], trace: FilmPoints = film_points
) -> tuple[Judge, tuple[float, ...], tuple[float, float]]:
    """Make what gives scores, with the film of the design at its best; the fields; and the errors of its rays.

    Each field has as many rays as leave the scores of some copies, the first of which is the design, where they are.
    """
    lens, merit = tried.lens, given.tolerances.merit
    wave = merit.wavelengths_nm[len(merit.wavelengths_nm) // 2]
    film = film_distance(lens, front, "front", wave)
    degrees = tuple(dict.fromkeys(merit.fields_degrees or default_fields(lens, film, front, wave)))
    try:
        fields = [sample_field(lens, each, front, wave) for each in degrees]
        rays = [sample(RINGS[1], 2 * RINGS[1]) for sample in fields]
    except InputError as problem:
        raise given.problem(("merit", "fields_degrees"), str(problem)) from None

    def judge(rays: Sequence[list[FieldRays]], film: float) -> Judge:
        return Judge(lens, [one for each in rays for one in each], merit, film, compensators, trace)

    film += judge(rays, film).best_shift(lens)
    shifts = judge(rays, film).scores(tried, given.tolerances.refocus).shifts_mm
    enough = [_enough(sample, merit, film, tried, shifts, trace) for sample in fields]
    rays = [field_rays for field_rays, _ in enough]
    few, many = (_join([scores[k] for _, scores in enough]) for k in (0, 1))
    film += judge(rays, film).best_shift(lens)
    errors = _moves(few.spot_um, many.spot_um, many.spot_um), _moves(few.modulation, many.modulation, 1.0)
    final = judge(rays, film)
    if trace is not film_points:  # what the arithmetic of a device changes counts as well
        exact = Judge(lens, [one for each in rays for one in each], merit, film)
        ours, theirs = (one.scores(tried, given.tolerances.refocus) for one in (final, exact))
        errors = (
            errors[0] + _moves(ours.spot_um, theirs.spot_um, theirs.spot_um),
            errors[1] + _moves(ours.modulation, theirs.modulation, 1.0),
        )
    return final, degrees, errors


def _enough(
    sample: Sampler, merit: Merit, film: float, tried: Copies, shifts: Array, trace: FilmPoints = film_points
) -> tuple[list[FieldRays], tuple[Scores, Scores]]:
    """Return the rays of a field, and what some copies are worth by them and by more.

    They are as many as spots need. Modulation needs many more where spots are large: what rays do between these is by
    polynomials, which traced rays confirm.
    """

    def score(rays: list[FieldRays]) -> Scores:
        return Judge(tried.lens, rays, merit, film, (), trace).scores(tried, False, shifts)

    def spots_move(few: Scores, many: Scores) -> float:
        return _moves(few.spots_um, many.spots_um, many.spots_um)

    def modulation_moves(few: Scores, many: Scores) -> float:
        return _moves(few.modulation, many.modulation, 1.0)

    if merit.rings is not None or merit.arms is not None:
        rings = merit.rings or max(2, (merit.arms or 0) // 2)
        rays = sample(rings, merit.arms or 2 * rings)
        return rays, (score(rays), score(sample(2 * rings, 2 * (merit.arms or 2 * rings))))
    tries = [sample(rings, 2 * rings) for rings in RINGS[:2]]
    scores = [score(rays) for rays in tries]
    while len(tries) < len(RINGS) and (
        spots_move(*scores[-2:]) > _SPOTS_STAY or modulation_moves(*scores[-2:]) > _MODULATION_STAYS
    ):
        tries.append(sample(RINGS[len(tries)], 2 * RINGS[len(tries)]))
        scores.append(score(tries[-1]))
    # Where figures do not come to rest, as those of copies that lose rays at an edge do, few rays are as good as many.
    allowed = max(_SPOTS_STAY, 2 * spots_move(*scores[-2:])), max(_MODULATION_STAYS, 2 * modulation_moves(*scores[-2:]))
    for number, rays in enumerate(tries[:-2]):
        if spots_move(scores[number], scores[-1]) <= allowed[0]:
            filled = [few.filled_in(many) for few, many in zip(rays, tries[-2], strict=True)]
            by_few = score(filled)
            if modulation_moves(by_few, scores[-1]) <= allowed[1]:
                return filled, (by_few, scores[-1])
    return tries[-2], (scores[-2], scores[-1])


def _join(scores: Sequence[Scores]) -> Scores:
    """Return the scores of several fields as those of one lens."""
    spots, mtf = (np.concatenate([getattr(one, name) for one in scores], axis=1) for name in ("spots_um", "mtf"))
    return Scores(spots, mtf, scores[0].shifts_mm)


def _moves(one: Array, other: Array, scale: Array | float) -> float:
    """Return the largest difference, in units of a scale, of numbers that are finite."""
    with np.errstate(invalid="ignore", divide="ignore"):
        moved = np.abs(one - other) / scale
    return float(np.max(moved, where=np.isfinite(moved), initial=0.0))
