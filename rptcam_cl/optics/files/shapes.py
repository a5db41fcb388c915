"""The keys of a lens file that make a surface more than a centred sphere: asphere, cylinder, tilt, clear part."""

from __future__ import annotations

import math
from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.fields import Fields, as_number
from rptcam_cl.optics.files.keys import CLEAR, HIGHEST_POWER, QCON, SHAPE
from rptcam_cl.optics.files.qcon import FIRST_POWER, even_powers
from rptcam_cl.optics.placement import SurfacePose
from rptcam_cl.optics.region import Region
from rptcam_cl.optics.shapes import FORMS, Form
from rptcam_cl.optics.stop_shape import StopShape, blades, heart, polygon, star


def read_shape(fields: Fields, scale: float) -> dict[str, Any]:
    """Return the arguments of `Surface` that describe its shape, place and clear part."""
    cylinder = fields.get("cylinder")
    if cylinder not in (None, "x", "y"):
        raise fields.fail("cylinder", "allowed: x (power in x only), y (power in y only)")
    return {
        "conic": fields.number("conic", 0.0),
        "aspheric": _with_qcon(fields, scale, _aspheric(fields, scale)),
        "cylinder": cylinder,
        "form": _form(fields, scale),
        "pose": read_pose(fields, scale),
        "region": _region(fields, scale),
        "stop_shape": _stop_shape(fields),
    }


def _form(fields: Fields, scale: float) -> Form | None:
    """Return the one kind of surface with numbers of its own that the keys speak of, None where they do not."""
    found = [form for kind in FORMS if (form := kind.read(fields, scale)) is not None]
    if len(found) > 1:
        raise fields.fail(None, f"is {' and '.join(form.description for form in found)}: leave the keys of one out")
    return found[0] if found else None


def read_pose(fields: Fields, scale: float) -> SurfacePose | None:
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


def _stop_shape(fields: Fields) -> StopShape | None:
    """Return the shape of a stop: `heart`, or one of {blades, star, polygon} with its options."""
    if "shape" not in fields:
        return None
    if not fields.flag("stop"):
        raise fields.fail("shape", "belongs to the stop (mark it with stop: true)")
    try:
        if fields.get("shape") == "heart":
            return heart()
        inner = fields.inner("shape", SHAPE)
        kinds = [kind for kind in ("blades", "star", "polygon") if kind in inner]
        if len(kinds) != 1:
            raise fields.fail("shape", "allowed: heart, {blades: n}, {star: n} or {polygon: [[x, y], ...]}")
        if kinds[0] == "polygon":
            rows = inner.get("polygon")
            if not isinstance(rows, list) or not all(isinstance(row, list) and len(row) == 2 for row in rows):
                raise inner.fail("polygon", "expected a list of points [x, y] in units of the stop's radius")
            places = [[(*inner.path, "polygon", i, axis) for axis in (0, 1)] for i in range(len(rows))]
            return polygon([(as_number(inner.document, x), as_number(inner.document, y)) for x, y in places])
        count = inner.number(kinds[0])
        if count % 1:
            raise inner.fail(kinds[0], "expected a whole number")
        turn = inner.number("rotation_degrees", 0.0 if kinds[0] == "blades" else 90.0)
        if kinds[0] == "blades":
            return blades(int(count), turn, inner.number("curvature", 0.0))
        return star(int(count), inner.number("inner", 0.4), turn)
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
    fault = f"a power of r is a whole number from 1 to {HIGHEST_POWER}"
    powers = fields.paths_by_number("aspheric", 1, HIGHEST_POWER, fault)
    return tuple((power, as_number(fields.document, path) * scale ** (1 - power)) for power, path in powers)


def _with_qcon(fields: Fields, scale: float, terms: tuple[tuple[int, float], ...]) -> tuple[tuple[int, float], ...]:
    """Return the terms of an asphere with those of its Qcon polynomials, by rising power."""
    result = dict(terms)
    if "qcon" in fields:
        inner = fields.inner("qcon", QCON)
        radius, coefficients = inner.positive("radius"), inner.numbers("coefficients")
        most = (HIGHEST_POWER - FIRST_POWER) // 2 + 1
        if len(coefficients) > most:
            raise inner.fail("coefficients", f"at most {most}, which reach r^{HIGHEST_POWER}")
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
    inner = fields.inner("clear", CLEAR)
    width, height = math.inf, math.inf
    if "rectangle" in inner:
        size = inner.numbers("rectangle")
        if len(size) != 2 or min(size) <= 0:
            raise inner.fail("rectangle", "expected [width, height], both above 0")
        width, height = size
    normal = inner.number("half_plane_degrees") if "half_plane_degrees" in inner else None
    edge = inner.number("edge", 0.0) * scale
    return Region(width * scale / 2, height * scale / 2, normal, edge, outside == "block")
