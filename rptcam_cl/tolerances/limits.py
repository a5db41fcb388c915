"""What a specification means for a lens: each thing of it that may be off, by how much and by what distribution."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import KeyPath
from rptcam_cl.optics import AIR, Deviation, Lens, abbe_number
from rptcam_cl.scene import Distribution, Tolerance
from rptcam_cl.tolerances.specification import Specification

FRINGE_MM = 632.8e-6 / 2  # of sag, against a test glass
ARCMIN = math.pi / 180 / 60
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


@dataclass(frozen=True)
class _Item:
    """Surfaces that a tolerance concerns, what they are called, and the key of the specification that names them."""

    first: int
    last: int
    name: str


def elements(lens: Lens) -> list[int]:
    """Return the first surface of each element: those with glass behind them."""
    return [k for k in range(len(lens.surfaces) - 1) if lens.surfaces[k].glass != AIR]


def components(lens: Lens) -> list[tuple[int, int]]:
    """Return first and last surface of each element, or of elements that are cemented."""
    found: list[tuple[int, int]] = []
    for k in elements(lens):
        if found and found[-1][1] == k:
            found[-1] = (found[-1][0], k + 1)
        else:
            found.append((k, k + 1))
    return found


def limits(lens: Lens, specification: Specification) -> list[Limit]:
    """Return all that may be off: what concerns surfaces first, then elements, then groups, as poses act.

    Raises
    ------
    InputError
        When a tolerance names what the lens does not have.
    """
    given = specification.tolerances
    found: list[tuple[int, Limit]] = []
    for entry, tolerance in enumerate(given.tolerances):
        distribution = tolerance.distribution or given.distribution
        sigmas = tolerance.sigmas or given.sigmas
        rank = 2 if tolerance.group else 1 if tolerance.surfaces is None and tolerance.of == "element" else 0
        rank = 0 if tolerance.quantity.startswith("wedge") else rank
        for number, item in enumerate(_items(lens, specification, entry)):
            deviation, size, text = _deviation(lens, tolerance, item)
            if size is not None:
                label = f"{text} {'behind' if tolerance.quantity == 'spacing_mm' else 'of'} {item.name}"
                found.append((rank, Limit(deviation, size, label, distribution, sigmas, (entry, number))))
    if not found:
        raise InputError(f"{lens.name}: none of the tolerances concerns anything of this lens")
    return [limit for _, limit in sorted(found, key=lambda pair: pair[0])]


def _items(lens: Lens, specification: Specification, entry: int) -> Iterator[_Item]:
    """Return what a tolerance concerns."""
    tolerance = specification.tolerances.tolerances[entry]
    path: KeyPath = ("tolerances", entry)
    quantity = tolerance.quantity
    if tolerance.group is not None:
        first, last = tolerance.group
        _check(specification, (*path, "group"), "surface", last, len(lens.surfaces))
        yield _Item(first, last, f"surfaces {first} to {last}")
    elif quantity.startswith(("decentre", "tilt")) and tolerance.of == "element" and tolerance.surfaces is None:
        every = components(lens)
        for k in _chosen(specification, path, "elements", "element", len(every)):
            first, last = every[k]
            yield _Item(first, last, f"element {k} (surfaces {first} to {last})")
    elif quantity.startswith(("radius", "spacing", "decentre", "tilt")):
        chosen = _chosen(specification, path, "surfaces", "surface", len(lens.surfaces))
        for k in chosen:
            if _concerns(lens, quantity, k):
                yield _Item(k, k, f"surface {k}")
            elif tolerance.surfaces is not None:
                place = (*path, "surfaces", tolerance.surfaces.index(k))
                what = "no air space is behind it" if quantity == "spacing_mm" else "light does not bend there"
                raise specification.problem(place, f"{what} (got {k})")
    else:
        glasses = elements(lens)
        for k in _chosen(specification, path, "elements", "element", len(glasses)):
            yield _Item(glasses[k], glasses[k] + 1, f"element {k} (surfaces {glasses[k]} to {glasses[k] + 1})")


def _concerns(lens: Lens, quantity: str, k: int) -> bool:
    """Return whether a surface has what a tolerance is of."""
    if quantity == "spacing_mm":
        return k < len(lens.surfaces) - 1 and lens.surfaces[k].glass == AIR
    has_radius = lens.surfaces[k].curvature != 0 or quantity not in ("radius_percent", "radius_mm")
    return lens.media[k] != lens.media[k + 1] and has_radius


def _chosen(specification: Specification, path: KeyPath, key: str, noun: str, count: int) -> list[int]:
    """Return the numbers that a key of a tolerance names, all without it."""
    given = getattr(specification.tolerances.tolerances[int(path[1])], key)
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
    """Return what a tolerance of one item is a limit of, its size, and its words; no size where it is of no effect."""
    quantity, k = tolerance.quantity, item.first
    value = float(getattr(tolerance, quantity))
    surface = lens.surfaces[k]
    match quantity:
        case "radius_percent":
            return Deviation("radius", k, k), value / 100, f"radius ±{value:g} %"
        case "radius_mm":
            return Deviation("radius", k, k), min(value * abs(surface.curvature), HALF), f"radius ±{value:g} mm"
        case "radius_fringes":
            size = 2 * value * FRINGE_MM / surface.semi_diameter**2
            return Deviation("curvature", k, k), size, f"power ±{value:g} fringes"
        case "spacing_mm":
            size = min(value, abs(surface.thickness))
            return Deviation("thickness", k, k), size or None, f"air space ±{value:g} mm"
        case "thickness_mm":
            return Deviation("thickness", k, k), min(value, surface.thickness), f"thickness ±{value:g} mm"
        case "thickness_percent":
            return Deviation("thickness", k, k), value / 100 * surface.thickness, f"thickness ±{value:g} %"
        case "index":
            return Deviation("index", k, k), value, f"index ±{value:g}"
        case "abbe_percent":
            disperses = math.isfinite(abbe_number(surface.glass))
            return Deviation("abbe", k, k), value / 100 if disperses else None, f"Abbe number ±{value:g} %"
        case "wedge_arcmin":
            return Deviation("tilt", k + 1, k + 1), value * ARCMIN, f"wedge {value:g}′"
        case "wedge_um":
            angle = 1e-3 * value / (2 * lens.surfaces[k + 1].semi_diameter)
            return Deviation("tilt", k + 1, k + 1), angle, f"wedge {value:g} µm"
        case "decentre_mm":
            return Deviation("decentre", k, item.last), value, f"decentre {value:g} mm"
        case "tilt_arcmin":
            return Deviation("tilt", k, item.last), value * ARCMIN, f"tilt {value:g}′"
    return Deviation("tilt", k, item.last), 1e-3 * value / (2 * surface.semi_diameter), f"tilt {value:g} µm"
