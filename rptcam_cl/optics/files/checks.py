"""Geometric sanity of a prescription: what cannot be a lens is refused, what is doubtful becomes a warning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.first_order import first_order
from rptcam_cl.optics.glass import continued_words
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.surface import Surface

Report = Callable[[int, str, str], InputError]

LONGEST_PLAUSIBLE_MM = 10_000.0
DENSER_THAN_AIR = 1e-3
ROUNDING_MM = 1e-6  # of a thickness that is meant to be 0
FASTEST = 0.25  # f-number below which something is wrong with the numbers: a lens in air ends at f/0.5
THINNEST = 1 - 1e-6
INSIDE_THE_RIM = 1 - 1e-9  # where a surface that is a whole hemisphere still has a sag


def check_lens(lens: Lens, report: Report) -> Lens:
    """Return the lens with its warnings, or raise the `report(surface, key, text)` of its first impossibility."""
    for index, surface in enumerate(lens.surfaces):
        _check_reach(surface, index, report)
        _check_way(surface, lens.senses[index + 1], index, report)
    _check_half_lenses(lens, report)
    return replace(lens, warnings=(*lens.warnings, *_doubts(lens)))


def _check_reach(surface: Surface, index: int, report: Report) -> None:
    """Refuse a surface that ends before its rim."""
    rim = surface.semi_diameter * INSIDE_THE_RIM
    angles = np.linspace(0.0, np.pi, 9)
    if np.all(np.isfinite(surface.sag(rim * np.cos(angles), rim * np.sin(angles)))) or not np.isfinite(rim):
        return
    diameter = f"the diameter {2 * surface.semi_diameter:g} mm"
    if surface.is_sphere:
        raise report(
            index,
            "diameter",
            f"{diameter} is more than twice the radius {abs(surface.radius):g} mm; the surface does not reach its rim",
        )
    raise report(index, "diameter", f"{diameter} is more than the shape (radius, conic) reaches")


def _check_way(surface: Surface, sense: float, index: int, report: Report) -> None:
    """Refuse a mirror behind which light would go on."""
    if surface.is_mirror and sense * surface.thickness < 0:
        way = "-z: the thickness must not be positive" if sense < 0 else "+z: the thickness must not be negative"
        raise report(index, "thickness", f"the mirror sends light to {way} (got {surface.thickness:g} mm)")


def _check_half_lenses(lens: Lens, report: Report) -> None:
    """Refuse a half lens whose outside is not one medium: what passes beside it would have to be bent somewhere."""
    half = [surface.region if surface.region and not surface.region.blocks else None for surface in lens.surfaces]
    media = [lens.object_medium, *(surface.glass for surface in lens.surfaces)]
    first = 0
    for index, region in enumerate(half):
        if region is None:
            continue
        if index == 0 or half[index - 1] != region:
            first = index
        if (index == len(half) - 1 or half[index + 1] != region) and media[index + 1] != media[first]:
            raise report(index, "glass", "must be the medium before the half lens, which ends with this surface")


def backward_gaps(lens: Lens) -> tuple[str, ...]:
    """Return a doubt for each negative thickness but those beside the stop, which are common."""
    return tuple(
        f"the thickness behind surface {index} is negative ({surface.thickness:g} mm): surface {index + 1} stands in "
        f"front of it, and rays meet surface {index} first all the same"
        for index, surface in enumerate(lens.surfaces)
        if lens.senses[index + 1] * surface.thickness < -ROUNDING_MM
        and not (surface.is_stop or lens.surfaces[index + 1].is_stop)
    )


def crossed_surfaces(lens: Lens) -> tuple[str, ...]:
    """Return a doubt for neighbouring surfaces that cross, inside their rims or, of glass, at them.

    Rays go through such surfaces in their order, back where they must: patents round their numbers, and stops that
    cut flare stand inside lenses. A plane stop has no body to cross.
    """
    doubts = []
    indices = lens.indices(LINE_D_NM)
    for index, (first, second) in enumerate(zip(lens.surfaces, lens.surfaces[1:], strict=False)):
        if first.is_stop or second.is_stop or first.pose or second.pose:
            continue
        sense = lens.senses[index + 1]
        if sense * first.thickness < 0 or not np.isfinite(first.semi_diameter + second.semi_diameter):
            continue
        height = min(first.semi_diameter, second.semi_diameter) * INSIDE_THE_RIM
        gap = sense * (first.thickness + second.rim_sag(height) - first.rim_sag(height))
        if gap < -1e-6 * max(1.0, height):
            where = f"they overlap by {-gap:.4g} mm at {height:g} mm from the axis"
            doubts.append(f"surfaces {index} and {index + 1} cross: {where}; rays meet them in their order")
        elif abs(indices[index + 1] - 1) >= DENSER_THAN_AIR:
            front, rear = (part.rim_sag(part.semi_diameter * INSIDE_THE_RIM) for part in (first, second))
            edge = sense * (first.thickness + rear - front)
            if edge < -1e-6 * max(first.semi_diameter, second.semi_diameter):
                doubts.append(f"the rims of the glass between surfaces {index} and {index + 1} cross by {-edge:.4g} mm")
    return tuple(doubts)


def _doubts(lens: Lens) -> tuple[str, ...]:
    doubts = []
    data = first_order(lens, LINE_D_NM)
    length = abs(data.focal_length_mm)
    if LONGEST_PLAUSIBLE_MM < length < np.inf:
        doubts.append(f"focal length {data.focal_length_mm:.6g} mm: are the lengths in metres or micrometres?")
    if data.f_number < FASTEST and _widest(lens) > length:
        doubts.append(
            f"focal length {data.focal_length_mm:.4g} mm behind an opening of "
            f"{data.entrance_pupil.diameter_mm:.4g} mm, f/{data.f_number:.2g}, cannot be (f/0.5 is the limit): "
            "are the radii curvatures?"
        )
    for index, surface in enumerate(lens.surfaces):
        if surface.aspheric and not _monotone(surface):
            doubts.append(f"surface {index}: its sag turns back inside the rim; check the aspheric coefficients")
    doubts += [*backward_gaps(lens), *crossed_surfaces(lens), *_in_the_way(lens)]
    doubts += filter(None, dict.fromkeys(continued_words(medium) for medium in lens.media))
    for place, value in enumerate(lens.indices(LINE_D_NM)):
        if value < THINNEST:
            where = f"behind surface {place - 1}" if place else "in front of the lens"
            doubts.append(
                f"the medium {where} has the index {value:g}, below 1, which no glass has: indices count from air, "
                "not from the medium beside"
            )
    return tuple(doubts)


def _widest(lens: Lens) -> float:
    return max(surface.semi_diameter for surface in lens.surfaces)


def _in_the_way(lens: Lens) -> tuple[str, ...]:
    """Return a doubt about the first mirror that stands in light on its way to another one, where nothing says so."""
    backwards = [k for k, s in enumerate(lens.surfaces) if s.is_mirror and lens.senses[k] < 0 and s.pose is None]
    if not backwards or lens.is_obstructed:
        return ()
    return (
        f"surface {backwards[0]}: this mirror stands in the light that enters, which passes it all the same;"
        " inner_diameter on a surface before it would make a ring of the pupil",
    )


def _monotone(surface: Surface) -> bool:
    """Return whether the sag of an asphere turns back at most once, as the gull wings of telephone lenses do."""
    height = np.linspace(0.0, min(surface.semi_diameter, 1e9), 64)
    sag = (
        surface.sag(height, np.zeros_like(height))
        if surface.cylinder == "x"
        else surface.sag(np.zeros_like(height), height)
    )
    steps = np.sign(np.diff(sag))
    return int(np.count_nonzero(np.diff(steps[steps != 0]))) <= 1
