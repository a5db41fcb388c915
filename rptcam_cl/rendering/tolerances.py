"""What may be off in a lens as made: specifications of tolerances, what they mean for it, and chances of copies."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import NormalDist
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import Document, KeyPath, dotted, read_yaml
from rptcam_cl.optics.as_built import Deviation, first_met, is_free_gap
from rptcam_cl.optics.glass import AIR, abbe_number
from rptcam_cl.optics.lens import Lens
from rptcam_cl.scene.lens_settings import GRADES, OF_EITHER, Distribution, Tolerance, Tolerances, grade
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


def specification(source: str | Path | bytes | Mapping[str, Any] | Tolerances, name: str = "") -> Specification:
    """Return the specification of a grade's name, a YAML file, its text as bytes, or a mapping of the same form.

    Parameters
    ----------
    source
        One of `GRADES`, or a path.
    name : str
        What errors call text that is not read from a file.

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
    document = read_yaml(source if isinstance(source, bytes) else Path(source), name or None)
    if not isinstance(document.data, dict):
        raise InputError(f"{document.name}:1:1: a specification must be a mapping (allowed: with the key tolerances)")
    return _check_specification(document.data, document)


def _check_specification(data: dict[str, Any], document: Document | None) -> Specification:
    def where(path: KeyPath, at_key: bool = False) -> str:
        if document is None:
            return ""
        line, column = document.key_mark(path) if at_key else document.mark(path)
        return f"{document.name}:{line}:{column}: "

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


#
# The random numbers of a tolerance run, each keyed by seed, tolerance and copy.
#
# A copy is therefore the same however many are made, and a tolerance added at the end of a specification leaves what
# the others draw as it was.

Array = NDArray[np.float64]

_NORMAL = np.vectorize(NormalDist().inv_cdf, otypes=[np.float64])


def draw_values(limits: Sequence[Limit], copies: int, seed: int) -> Array:
    """Draw values (copies, limits, 2) of all that may be off.

    A single number lies within ± its size: evenly, by a normal distribution cut off there, or at one of the two ends. A
    pair lies in the disc of that radius: evenly over its area, by the normal distribution of both cut off at its rim,
    or on the rim.
    """
    values = np.zeros((copies, len(limits), 2))
    for number, limit in enumerate(limits):
        key = np.random.SeedSequence([seed, *limit.key])
        chances = np.random.Generator(np.random.Philox(key)).random((copies, 2))
        values[:, number] = _pairs(limit, chances) if limit.deviation.is_pair else _numbers(limit, chances)
    return values


def _numbers(limit: Limit, chances: Array) -> Array:
    chance = chances[:, 0]
    match limit.distribution:
        case "uniform":
            share = 2.0 * chance - 1.0
        case "end_point":
            share = np.where(chance < 0.5, -1.0, 1.0)
        case "normal":
            outside = NormalDist().cdf(-limit.sigmas)
            share = np.clip(_NORMAL(outside + chance * (1.0 - 2.0 * outside)) / limit.sigmas, -1.0, 1.0)
    return np.stack([limit.size * share, np.zeros_like(share)], axis=1)


def _pairs(limit: Limit, chances: Array) -> Array:
    chance, angle = chances[:, 0], 2.0 * np.pi * chances[:, 1]
    match limit.distribution:
        case "uniform":
            share = np.sqrt(chance)
        case "end_point":
            share = np.ones_like(chance)
        case "normal":  # the distance from the middle has the distribution of Rayleigh
            inside = -np.expm1(-0.5 * limit.sigmas**2)
            share = np.sqrt(-2.0 * np.log1p(-chance * inside)) / limit.sigmas
    return np.asarray((limit.size * share)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))


# Shares and percentiles of a sample, each with the interval in which that of all copies lies.

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Interval:
    """An estimate and the bounds that hold it with a given confidence; each may be infinite."""

    value: float
    low: float
    high: float

    def __iter__(self) -> Iterator[float]:
        return iter((self.value, self.low, self.high))


def share(hits: int, count: int, confidence: float = CONFIDENCE) -> Interval:
    """The share of all copies that is good, of how many of a sample are (Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    ratio, weight = hits / count, 1.0 / (1.0 + z * z / count)
    middle = weight * (ratio + z * z / (2 * count))
    half = weight * z * math.sqrt(ratio * (1 - ratio) / count + (z / (2 * count)) ** 2)
    low, high = (0.0 if hits == 0 else middle - half), (1.0 if hits == count else middle + half)
    return Interval(ratio, low, high)


def rank(percent: float, count: int) -> int:
    """Return the place, from 0, of a percentile among sorted copies: that percent of them are at most as bad.

    Raises
    ------
    InputError
        For a percentile that is not above 0 and at most 100.
    """
    if not 0 < percent <= 100:
        raise InputError(f"a percentile must be above 0 and at most 100 % (got {percent:g} %)")
    return max(math.ceil(percent / 100 * count - 1e-9), 1) - 1


def percentile(ordered: Array, percent: float, confidence: float = CONFIDENCE) -> Interval:
    """Return a percentile of sorted numbers, and the bounds that hold that of all copies, whatever their distribution.

    How many of a sample lie below the true percentile is binomial, so the bounds are two of the sorted numbers (David
    and Nagaraja, Order Statistics, 3rd ed., 7.1); a sample too small for the confidence has its ends.
    """
    count, p = len(ordered), percent / 100
    place = rank(percent, count)
    below = np.cumsum(_binomial(count, p))  # chance that at most k of the sample lie below it
    tail = (1 - confidence) / 2
    low = int(np.searchsorted(below, tail, side="right")) - 1
    high = int(np.searchsorted(below, 1 - tail, side="left"))
    low, high = max(low, 0), min(high, count - 1)
    return Interval(float(ordered[place]), float(ordered[min(low, place)]), float(ordered[max(high, place)]))


def _binomial(count: int, p: float) -> Array:
    """Return the chance of k hits of `count`, for k from 0 to `count`."""
    if p >= 1:
        return np.asarray(np.eye(count + 1)[-1])
    k = np.arange(count + 1)
    factorials = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, count + 1)))])
    logarithm = factorials[-1] - factorials[k] - factorials[count - k] + k * math.log(p) + (count - k) * math.log1p(-p)
    return np.asarray(np.exp(logarithm))
