"""Our own lens form: YAML, JSON or a mapping, one entry per surface, scene side first."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from math import comb, fsum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import References
from rptcam_cl.core.strict_yaml import Document, Fields, KeyPath, as_number, problem
from rptcam_cl.optics import surface as surface_rows
from rptcam_cl.optics.files import keys
from rptcam_cl.optics.files.glasses import apply_coatings, read_glass
from rptcam_cl.optics.glass import AIR, Medium, continued_words
from rptcam_cl.optics.lens import Lens, first_order, in_configuration
from rptcam_cl.optics.shapes import FORMS, PHASES, Form, IdealLens, Phase
from rptcam_cl.optics.surface import Configuration, FocusState, Region, Surface, SurfacePose

#
# Forbes's polynomials, Qcon and Qbfs, by which telephone lenses give their aspheres, as even powers of r.
#
# With u = r / radius they add u^4 (a_0 Q_0(u^2) + a_1 Q_1(u^2) + ...) to the conic. Q_m(x) is the Jacobi polynomial
# P_m^(0,4)(2 x - 1), so that each a_m says by how much the surface leaves the conic (G. Forbes, Shape specification
# for axially symmetric optical surfaces, Opt. Express 15, 5218 (2007), sec. 3).

Array = NDArray[np.float64]

_FIRST_POWER = 4
_BFS_POWERS = 11  # r^2 to r^22, as many as a device takes
_BFS_NODES = 64
SHIFT = 4  # the second index of the Jacobi polynomials


def qcon_coefficients(order: int) -> list[int]:
    """Return the whole numbers c_k of Q_order(x) = sum of c_k x^k."""
    return [(-1) ** (order - k) * comb(order, k) * comb(order + k + SHIFT, order) for k in range(order + 1)]


def even_powers(coefficients: tuple[float, ...], radius: float) -> dict[int, float]:
    """Return the powers of r and their coefficients, for a_0, a_1, ... and the radius at which u is 1.

    The c_k alternate and grow: with ten terms a sum loses seven digits of sixteen, of what a_9 adds.
    """
    table = [qcon_coefficients(order) for order in range(len(coefficients))]
    result = {}
    for k in range(len(coefficients)):
        value = fsum(a * table[order][k] for order, a in enumerate(coefficients) if order >= k)
        result[_FIRST_POWER + 2 * k] = value / radius ** (_FIRST_POWER + 2 * k)
    return result


def bfs_powers(
    coefficients: tuple[float, ...], radius: float, rim: float, curvature: float, conic: float
) -> tuple[dict[int, float], float]:
    """Return even powers of r that add up to Qbfs polynomials within a rim, and their largest error there [unit].

    With u = r / radius they add u^2 (1 - u^2) sqrt(1 - k c^2 r^2) / sqrt(1 - (1 + k) c^2 r^2) (a_0 Q_0(u^2) + ...),
    along the normal of the conic (G. Forbes, Opt. Express 15, 5218 (2007), sec. 4, has the factor of a sphere, k = 0).
    """

    def added(square: Array) -> Array:  # at squares of r, over r^2
        x, bent = square / radius**2, curvature**2 * square
        steep = np.sqrt((1 - conic * bent) / (1 - (1 + conic) * bent))
        return np.asarray((1 - x) * steep * _bfs_sum(coefficients, x) / radius**2)

    domain = (0.0, rim * rim)
    curve = np.polynomial.Chebyshev.interpolate(added, _BFS_POWERS - 1, domain=domain)
    values = curve.convert(kind=np.polynomial.Polynomial).coef
    nodes = np.linspace(*domain, _BFS_NODES)
    error = float(np.max(nodes * np.abs(np.polynomial.Polynomial(values)(nodes) - added(nodes))))
    return {2 * k + 2: float(value) for k, value in enumerate(values) if value}, error


def _bfs_sum(coefficients: tuple[float, ...], x: Array) -> Array:
    """Return the sum of a_m Q_m(x) by the recurrence of G. Forbes, Opt. Express 18, 19700 (2010), eq. A.13 to A.15."""
    f, g, h = [2.0, np.sqrt(19.0) / 2], [-0.5], []
    p, q = [np.full_like(x, 2.0), 6 - 8 * x], [np.ones_like(x), (13 - 16 * x) / np.sqrt(19.0)]
    for m in range(2, len(coefficients)):
        h.append(-m * (m - 1) / (2 * f[m - 2]))
        g.append(-(1 + g[m - 2] * h[m - 2]) / f[m - 1])
        f.append(float(np.sqrt(m * (m + 1) + 3 - g[m - 1] ** 2 - h[m - 2] ** 2)))
        p.append((2 - 4 * x) * p[m - 1] - p[m - 2])
        q.append((p[m] - g[m - 1] * q[m - 1] - h[m - 2] * q[m - 2]) / f[m])
    return np.asarray(sum(a * part for a, part in zip(coefficients, q, strict=False)))


# Geometric sanity of a prescription: what cannot be a lens is refused, what is doubtful becomes a warning.

Report = Callable[[int, str, str], InputError]

LONGEST_PLAUSIBLE_MM = 10_000.0
_DENSER_THAN_AIR = 1e-3
_ROUNDING_MM = 1e-6  # of a thickness that is meant to be 0
_FASTEST = 0.25  # f-number below which something is wrong with the numbers: a lens in air ends at f/0.5
_THINNEST = 1 - 1e-6
_INSIDE_THE_RIM = 1 - 1e-9  # where a surface that is a whole hemisphere still has a sag


def check_lens(lens: Lens, report: Report) -> Lens:
    """Return the lens with its warnings, or raise the `report(surface, key, text)` of its first impossibility."""
    for index, surface in enumerate(lens.surfaces):
        _check_reach(surface, index, report)
        _check_way(surface, lens.senses[index + 1], index, report)
    _check_half_lenses(lens, report)
    return replace(lens, warnings=(*lens.warnings, *_doubts(lens)))


def _check_reach(surface: Surface, index: int, report: Report) -> None:
    """Refuse a surface that ends before its rim."""
    rim = surface.semi_diameter * _INSIDE_THE_RIM
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


def _backward_gaps(lens: Lens) -> tuple[str, ...]:
    """Return a doubt for each negative thickness but those beside the stop, which are common."""
    return tuple(
        f"the thickness behind surface {index} is negative ({surface.thickness:g} mm): surface {index + 1} stands in "
        f"front of it, and rays meet surface {index} first all the same"
        for index, surface in enumerate(lens.surfaces)
        if lens.senses[index + 1] * surface.thickness < -_ROUNDING_MM
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
        height = min(first.semi_diameter, second.semi_diameter) * _INSIDE_THE_RIM
        gap = sense * (first.thickness + second.rim_sag(height) - first.rim_sag(height))
        if gap < -1e-6 * max(1.0, height):
            where = f"they overlap by {-gap:.4g} mm at {height:g} mm from the axis"
            doubts.append(f"surfaces {index} and {index + 1} cross: {where}; rays meet them in their order")
        elif abs(indices[index + 1] - 1) >= _DENSER_THAN_AIR:
            front, rear = (part.rim_sag(part.semi_diameter * _INSIDE_THE_RIM) for part in (first, second))
            edge = sense * (first.thickness + rear - front)
            if edge < -1e-6 * max(first.semi_diameter, second.semi_diameter):
                doubts.append(f"the rims of the glass between surfaces {index} and {index + 1} cross by {-edge:.4g} mm")
    return tuple(doubts)


ACROSS, LOST = 33, 0.005  # rays across the first surface, and the share of them that counts


def _doubts(lens: Lens) -> tuple[str, ...]:
    doubts = []
    data = first_order(lens, LINE_D_NM)
    length = abs(data.focal_length_mm)
    if LONGEST_PLAUSIBLE_MM < length < np.inf:
        doubts.append(f"focal length {data.focal_length_mm:.6g} mm: are the lengths in metres or micrometres?")
    if data.f_number < _FASTEST and max(surface.semi_diameter for surface in lens.surfaces) > length:
        doubts.append(
            f"focal length {data.focal_length_mm:.4g} mm behind an opening of "
            f"{data.entrance_pupil.diameter_mm:.4g} mm, f/{data.f_number:.2g}, cannot be (f/0.5 is the limit): "
            "are the radii curvatures?"
        )
    for index, surface in enumerate(lens.surfaces):
        if surface.aspheric and not _monotone(surface):
            doubts.append(f"surface {index}: its sag turns back inside the rim; check the aspheric coefficients")
    doubts += [*_backward_gaps(lens), *crossed_surfaces(lens), *_in_the_way(lens), *_turned_too_far(lens)]
    doubts += filter(None, dict.fromkeys(continued_words(medium) for medium in lens.media))
    for place, value in enumerate(lens.indices(LINE_D_NM)):
        if value < _THINNEST:
            where = f"behind surface {place - 1}" if place else "in front of the lens"
            doubts.append(
                f"the medium {where} has the index {value:g}, below 1, which no glass has: indices count from air, "
                "not from the medium beside"
            )
    return tuple(doubts)


def _in_the_way(lens: Lens) -> tuple[str, ...]:
    """Return a doubt about the first mirror that stands in light on its way to another one, where nothing says so."""
    backwards = [k for k, s in enumerate(lens.surfaces) if s.is_mirror and lens.senses[k] < 0 and s.pose is None]
    if not backwards or lens.is_obstructed:
        return ()
    return (
        f"surface {backwards[0]}: this mirror stands in the light that enters, which passes it all the same;"
        " inner_diameter on a surface before it would make a ring of the pupil",
    )


def _turned_too_far(lens: Lens) -> tuple[str, ...]:
    """Return a doubt about light that a mirror turns by more than a right angle to its axis."""
    radius = lens.surfaces[0].semi_diameter
    if lens.fold is None or not np.isfinite(radius):
        return ()
    side = np.linspace(-radius, radius, ACROSS)
    x, y = (part.ravel() for part in np.meshgrid(side, side))
    along = np.broadcast_to([0.0, 0.0, 1.0], (len(x), 3))
    there = lens.trace(np.stack([x, y, np.zeros(len(x))], axis=1), along, LINE_D_NM, "scene")
    ends, back = there.origins[there.passed], -there.directions[there.passed]
    lost = 1.0 - float(lens.trace(ends - back, back, LINE_D_NM, "film").passed.mean()) if len(ends) else 0.0
    if lost < LOST:
        return ()
    return (
        f"{100 * lost:.0f} % of the light on the axis is turned by more than a right angle to a mirror's axis: spots"
        " and wavefronts have it, but renders and irradiance on the film lack it",
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


# The keys of a lens file that make a surface more than a centred sphere: asphere, cylinder, tilt, clear part.


def _read_shape(fields: Fields, scale: float) -> dict[str, Any]:
    """Return the arguments of `Surface` that describe its shape, place and clear part."""
    cylinder = fields.get("cylinder")
    if cylinder not in (None, "x", "y"):
        raise fields.fail("cylinder", "allowed: x (power in x only), y (power in y only)")
    return {
        "conic": fields.number("conic", 0.0),
        "aspheric": _with_qcon(fields, scale, _aspheric(fields, scale)),
        "cylinder": cylinder,
        "form": _form(fields, scale),
        "phase": _phase(fields, scale),
        "pose": _read_pose(fields, scale),
        "region": _region(fields, scale),
        "stop_shape": _stop_shape(fields),
    }


def _form(fields: Fields, scale: float) -> Form | None:
    """Return the one kind of surface with numbers of its own that the keys speak of, None where they do not."""
    forms = [form for kind in FORMS if (form := kind.read(fields, scale)) is not None]
    if len(forms) > 1:
        raise fields.fail(None, f"is {' and '.join(form.description for form in forms)}: leave the keys of one out")
    return forms[0] if forms else None


def _phase(fields: Fields, scale: float) -> Phase | None:
    """Return the grating, diffractive surface or ideal lens that the keys speak of, None where they do not."""
    kinds = [kind for kind in PHASES if kind.key in fields]
    if len(kinds) > 1:
        raise fields.fail(kinds[1].key, f"a surface has one of {', '.join(kind.key for kind in kinds)}")
    if not kinds:
        return None
    phase = kinds[0].read(fields.inner(kinds[0].key, kinds[0].keys), scale)
    bent = [key for key in ("radius", "conic", "aspheric", "qcon", "cylinder", "radius_x", "mirror") if key in fields]
    if isinstance(phase, IdealLens) and bent:
        raise fields.fail(bent[0], "an ideal lens is a plane that does not reflect; leave it out")
    return phase


def _read_pose(fields: Fields, scale: float) -> SurfacePose | None:
    """Return the pose of `decentre` [lengths] and `tilt_degrees`, None when neither is given."""
    if "decentre" not in fields and "tilt_degrees" not in fields:
        return None
    decentre = fields.numbers("decentre") if "decentre" in fields else (0.0, 0.0)
    if len(decentre) not in (2, 3):
        raise fields.fail("decentre", "expected [x, y] or [x, y, z]")
    tilt = fields.numbers("tilt_degrees") if "tilt_degrees" in fields else (0.0, 0.0, 0.0)
    if len(tilt) not in (2, 3):
        raise fields.fail("tilt_degrees", "expected turns about [x, y] or [x, y, z]")
    dx, dy, dz = (*(scale * d for d in decentre), 0.0)[:3]
    rx, ry, rz = (*tilt, 0.0)[:3]
    return SurfacePose.of((dx, dy, dz), (rx, ry, rz))


def _stop_shape(fields: Fields) -> surface_rows.StopShape | None:
    """Return the shape of a stop: `heart`, or one of {blades, star, polygon} with its options."""
    if "shape" not in fields:
        return None
    if not fields.flag("stop"):
        raise fields.fail("shape", "belongs to the stop (mark it with stop: true)")
    try:
        if fields.get("shape") == "heart":
            return surface_rows.heart()
        inner = fields.inner("shape", keys.SHAPE)
        kinds = [kind for kind in ("blades", "star", "polygon") if kind in inner]
        if len(kinds) != 1:
            raise fields.fail("shape", "allowed: heart, {blades: n}, {star: n} or {polygon: [[x, y], ...]}")
        if kinds[0] == "polygon":
            rows = inner.get("polygon")
            if not isinstance(rows, list) or not all(isinstance(row, list) and len(row) == 2 for row in rows):
                raise inner.fail("polygon", "expected a list of points [x, y] in units of the stop's radius")
            places = [[(*inner.path, "polygon", i, axis) for axis in (0, 1)] for i in range(len(rows))]
            return surface_rows.polygon(
                [(as_number(inner.document, x), as_number(inner.document, y)) for x, y in places]
            )
        count = inner.number(kinds[0])
        if count % 1:
            raise inner.fail(kinds[0], "expected a whole number")
        turn = inner.number("rotation_degrees", 0.0 if kinds[0] == "blades" else 90.0)
        if kinds[0] == "blades":
            return surface_rows.blades(int(count), turn, inner.number("curvature", 0.0))
        return surface_rows.star(int(count), inner.number("inner", 0.4), turn)
    except InputError as error:
        if str(error).startswith(fields.document.name):
            raise
        raise fields.fail("shape", str(error)) from None


def _aspheric(fields: Fields, scale: float) -> tuple[tuple[int, float], ...]:
    table = fields.get("aspheric")
    if table is None:
        return ()
    if not isinstance(table, dict):
        raise fields.fail("aspheric", "expected a mapping of powers of r to coefficients, such as {4: 1.0e-5}")
    fault = f"a power of r is a whole number from 1 to {keys.HIGHEST_POWER}"
    powers = fields.paths_by_number("aspheric", 1, keys.HIGHEST_POWER, fault)
    return tuple((power, as_number(fields.document, path) * scale ** (1 - power)) for power, path in powers)


def _with_qcon(fields: Fields, scale: float, terms: tuple[tuple[int, float], ...]) -> tuple[tuple[int, float], ...]:
    """Return the terms of an asphere with those of its Qcon polynomials, by rising power."""
    result = dict(terms)
    if "qcon" in fields:
        inner = fields.inner("qcon", keys.QCON)
        radius, coefficients = inner.positive("radius"), inner.numbers("coefficients")
        most = (keys.HIGHEST_POWER - _FIRST_POWER) // 2 + 1
        if len(coefficients) > most:
            raise inner.fail("coefficients", f"at most {most}, which reach r^{keys.HIGHEST_POWER}")
        for power, value in even_powers(tuple(scale * a for a in coefficients), radius * scale).items():
            result[power] = result.get(power, 0.0) + value
    return tuple(sorted(term for term in result.items() if term[1] != 0))


def _region(fields: Fields, scale: float) -> Region | None:
    outside = fields.text("outside", "block")
    if outside not in ("block", "pass"):
        raise fields.fail("outside", "allowed: block (clip the light), pass (nothing there: it goes straight on)")
    if "clear" not in fields:
        if "outside" in fields:
            raise fields.fail("outside", "needs a clear region beside it")
        return None
    inner = fields.inner("clear", keys.CLEAR)
    width, height = math.inf, math.inf
    if "rectangle" in inner:
        size = inner.numbers("rectangle")
        if len(size) != 2 or min(size) <= 0:
            raise inner.fail("rectangle", "expected [width, height], both above 0")
        width, height = size
    normal = inner.number("half_plane_degrees") if "half_plane_degrees" in inner else None
    edge = inner.number("edge", 0.0) * scale
    region = Region(width * scale / 2, height * scale / 2, normal, edge, outside == "block")
    if not any(key in inner for key in ("centre", "diameter", "inner_diameter")):
        return region
    centre = inner.numbers("centre") if "centre" in inner else (0.0, 0.0)
    if len(centre) != 2:
        raise inner.fail("centre", "expected [x, y]")
    radii = (
        inner.positive(key) * scale / 2 if key in inner else other
        for key, other in (("diameter", math.inf), ("inner_diameter", 0.0))
    )
    radius, inner_radius = radii
    if not radius > inner_radius:
        raise inner.fail("inner_diameter", "must be below the diameter")
    return replace(region, centre=(centre[0] * scale, centre[1] * scale), radius=radius, inner_radius=inner_radius)


# The keys `configurations`, `focusing` and `floating` of a lens file: zoom positions and groups that move to focus.


def _read_configurations(top: Fields, count: int, scale: float) -> tuple[Configuration, ...]:
    """Return the zoom positions: a list of {name, gaps: {surface: thickness}}."""
    result = []
    for index, fields in enumerate(top.rows("configurations", keys.CONFIGURATION, "[{name: wide, gaps: {4: 1.9}}]")):
        gaps = _gaps(fields, count, scale)
        stop = fields.positive("stop_diameter") * scale if "stop_diameter" in fields else None
        near = _states(fields, count, scale)
        if near and "focusing" in top:
            raise fields.fail("floating", "a lens with floating groups has no focusing group")
        result.append(Configuration(fields.text("name") or str(index), gaps, stop, near))
    if len({row.name for row in result}) < len(result):
        raise top.fail("configurations", "two configurations have the same name")
    if any({k for k, _ in row.gaps} != {k for k, _ in result[0].gaps} for row in result):
        raise top.fail("configurations", "every configuration must give the same gaps")
    return tuple(result)


def _read_floating(top: Fields, count: int, scale: float) -> tuple[FocusState, ...]:
    """Return the states of floating groups: a list of {distance, gaps: {surface: thickness}}."""
    if "floating" in top and ("focusing" in top or "configurations" in top):
        raise top.fail(
            "floating",
            "a lens with floating groups has neither focusing nor configurations; each of these has its own floating",
        )
    return _states(top, count, scale)


def _states(fields: Fields, count: int, scale: float) -> tuple[FocusState, ...]:
    rows = fields.rows("floating", keys.FLOATING, "[{distance: 450, gaps: {4: 1.9}}]")
    states = [
        FocusState(
            row.positive("distance") * scale,
            _gaps(row, count, scale),
            row.number("film_shift") * scale if "film_shift" in row else None,
        )
        for row in rows
    ]
    if any({k for k, _ in row.gaps} != {k for k, _ in states[0].gaps} for row in states):
        raise fields.fail("floating", "every state must give the same gaps")
    if len({row.film_shift_mm is None for row in states}) > 1:
        raise fields.fail("floating", "every state must give film_shift, or none")
    if len({row.distance_mm for row in states}) < len(states):
        raise fields.fail("floating", "two states have the same distance")
    return tuple(states)


def _gaps(fields: Fields, count: int, scale: float) -> tuple[tuple[int, float], ...]:
    """Return the thickness behind each surface that `gaps` names [mm]."""
    gaps = fields.get("gaps")
    if not isinstance(gaps, dict) or not gaps:
        raise fields.fail(
            "gaps" if "gaps" in fields else None, "needs gaps, such as {4: 1.9}: thickness behind a surface"
        )
    values = []
    for number, path in fields.paths_by_number(
        "gaps", 0, count - 2, f"a gap lies behind a surface from 0 to {count - 2}"
    ):
        gap = as_number(fields.document, path) * scale
        if gap < 0:
            raise problem(fields.document, path, "must not be negative", gaps[path[-1]])
        values.append((number, gap))
    return tuple(sorted(values))


def _read_focusing(top: Fields, count: int, scale: float) -> surface_rows.FocusingGroup | None:
    """Return the focusing group: {surfaces: [first, last], travel: [least, greatest]}."""
    if "focusing" not in top:
        return None
    fields = top.inner("focusing", keys.FOCUSING)
    first, last = fields.span("surfaces", count)
    travel = fields.numbers("travel")
    if first == 0 and last == count - 1:
        raise fields.fail("surfaces", "the group is the whole lens; leave focusing out")
    if len(travel) != 2 or not travel[0] < travel[1]:
        raise fields.fail("travel", "expected [least, greatest] shift towards the film")
    return surface_rows.FocusingGroup(first, last, (travel[0] * scale, travel[1] * scale))


def document_of(mapping: Mapping[str, Any], files: References | None = None) -> Document:
    """Return a mapping made in Python as a document without line numbers; it may name files of the working folder."""
    name = mapping.get("name")
    label = name if isinstance(name, str) and name else "<lens>"
    return Document(_plain(mapping), label, {}, {}, files or References())


def _plain(value: Any) -> Any:
    """Copy a value as mappings, lists and Python's numbers; keys stay, as powers are numbers in errors, too."""
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(inner) for inner in value]
    return value.item() if isinstance(value, np.generic) else value


def read_native(document: Document) -> Lens:
    """Return the lens of a document in our own form."""
    if not isinstance(document.data, dict):
        raise problem(document, (), "expected a mapping with name and surfaces", document.data)
    top = Fields(document, (), keys.LENS)
    scale = _unit(top)
    rows = top.get("surfaces")
    if not isinstance(rows, list) or not rows:
        raise top.fail("surfaces" if "surfaces" in top else None, "a lens needs a list of surfaces")
    object_medium = read_glass(document, ("object_medium",)) if "object_medium" in top else AIR
    surfaces = tuple(_surface(document, i, i == len(rows) - 1, scale) for i in range(len(rows)))
    surfaces = _pose_groups(top, _turn_at_mirrors(document, surfaces, object_medium), scale)
    stops = [i for i, surface in enumerate(surfaces) if surface.is_stop]
    if len(stops) > 1:
        raise problem(
            document, ("surfaces", stops[1], "stop"), f"a second stop; surface {stops[0]} is the stop already"
        )
    published = top.get("published") or {}
    if not isinstance(published, dict):
        raise top.fail("published", "expected a mapping such as {focal_length_mm: 50, f_number: 2}")
    if "marked_f_number" in top:
        published = published | {"marked_f_number": top.positive("marked_f_number")}
    lens = Lens(
        name=top.text("name") or document.name,
        surfaces=apply_coatings(document, surfaces, object_medium),
        stop_index=stops[0] if stops else None,
        source=top.text("source"),
        published=dict(published),
        object_medium=object_medium,
        configurations=_read_configurations(top, len(surfaces), scale),
        focusing=_read_focusing(top, len(surfaces), scale),
        floating=_read_floating(top, len(surfaces), scale),
        fold=_fold(top, scale),
        motor=_motor(top, scale),
    )
    if lens.configurations:
        lens = in_configuration(lens, lens.configurations[0].name)
    return check_lens(lens, lambda index, key, text: problem(document, ("surfaces", index, key), text))


def _motor(top: Fields, scale: float) -> surface_rows.FocusMotor | None:
    """Return the focus drive: {speed, acceleration, source}."""
    if "focus_drive" not in top:
        return None
    fields = top.inner("focus_drive", keys.FOCUS_DRIVE)
    speed, acceleration = (scale * fields.positive(key) for key in ("speed", "acceleration"))
    return surface_rows.FocusMotor(speed, acceleration, fields.text("source"))


def _fold(top: Fields, scale: float) -> SurfacePose | None:
    """Return how the axes of the scene stand in those of the lens, whose gaps are then fixed."""
    if "fold" not in top:
        return None
    for key in ("configurations", "focusing", "floating"):
        if key in top:
            raise top.fail(key, "a lens whose axis is folded focuses by its film alone")
    return _read_pose(top.inner("fold", keys.POSE), scale)


def _unit(top: Fields) -> float:
    unit = top.text("unit", "mm")
    if unit not in keys.UNITS_MM:
        raise top.fail("unit", f"allowed: {', '.join(keys.UNITS_MM)}")
    return keys.UNITS_MM[unit]


def _surface(document: Document, index: int, last: bool, scale: float) -> Surface:
    fields = Fields(document, ("surfaces", index), keys.SURFACE)
    radius = fields.number("radius", math.inf, infinite=True)
    if radius == 0:
        raise fields.fail("radius", "must not be 0: leave it out for a plane, and mark the stop with stop: true")
    if abs(radius * scale) < keys.SHORTEST_MM:
        raise fields.fail("radius", f"must be at least {keys.SHORTEST_MM:g} mm")
    thickness = fields.number("thickness", 0.0 if last else None)
    diameter, inner = (
        fields.positive("diameter"),
        fields.positive("inner_diameter") if "inner_diameter" in fields else 0.0,
    )
    if inner >= diameter:
        raise fields.fail("inner_diameter", f"must be less than the diameter {diameter:g}")
    for key, value in (("thickness", thickness), ("diameter", diameter)):
        if abs(value * scale) > keys.LONGEST_MM:
            raise fields.fail(key, f"must be at most {keys.LONGEST_MM:g} mm")
    glass: Medium = read_glass(document, (*fields.path, "glass")) if "glass" in fields else AIR
    return Surface(
        curvature=1.0 / (radius * scale),
        thickness=0.0 if last else thickness * scale,
        glass=glass,
        semi_diameter=diameter * scale / 2,
        inner_semi_diameter=inner * scale / 2,
        is_stop=fields.flag("stop"),
        is_mirror=fields.flag("mirror"),
        body_per_k=fields.number("body_expansion_per_k") if "body_expansion_per_k" in fields else None,
        **_read_shape(fields, scale),
    )


def _turn_at_mirrors(document: Document, surfaces: tuple[Surface, ...], before: Medium) -> tuple[Surface, ...]:
    """Return the surfaces with the medium before each mirror also behind it, which is the same."""
    result = []
    for k, surface in enumerate(surfaces):
        if surface.is_mirror:
            path: KeyPath = ("surfaces", k)
            if "glass" in document.data["surfaces"][k] and surface.glass != before:
                raise problem(
                    document, (*path, "glass"), "a mirror sends light back into the medium it comes from; leave it out"
                )
            if surface.region is not None and not surface.region.blocks:
                raise problem(document, (*path, "outside"), "nothing passes beside a mirror; leave it out")
            surface = replace(surface, glass=before)
        if surface.body_per_k is not None and not (surface.is_mirror and before == AIR):
            path = ("surfaces", k, "body_expansion_per_k")
            raise problem(document, path, "only a mirror in air has a body of its own; leave it out")
        result.append(surface)
        before = surface.glass
    return tuple(result)


def _pose_groups(top: Fields, surfaces: tuple[Surface, ...], scale: float) -> tuple[Surface, ...]:
    """Return the surfaces with the decentre and tilt of the groups they belong to, about each group's first vertex."""
    result = list(surfaces)
    for fields in top.rows("groups", keys.GROUP, "[{surfaces: [0, 3], tilt_degrees: [1, 0]}]"):
        first, last = fields.span("surfaces", len(surfaces))
        pose = _read_pose(fields, scale)
        if pose is None:
            raise fields.fail(None, "a group needs decentre or tilt_degrees")
        behind = 0.0
        for k in range(first, last + 1):
            result[k] = replace(result[k], pose=(result[k].pose or surface_rows.IN_PLACE).carried_by(pose, behind))
            behind += result[k].thickness
    return tuple(result)
