"""Lenses written as our YAML and as pbrt tables."""

from __future__ import annotations

import math
from typing import Any

import yaml

from rptcam_cl.errors import InputError
from rptcam_cl.optics.glass import (
    AIR,
    WAVELENGTH_D,
    AbbeCauchy,
    AbbeLinear,
    ConstantIndex,
    Medium,
    PowerSeries,
    Sellmeier,
)
from rptcam_cl.optics.glass_table import GLASSES
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.surface import Surface


def as_mapping(lens: Lens) -> dict[str, Any]:
    """Return a lens in our own form: what `load_lens` reads, numbers unrounded.

    Raises
    ------
    InputError
        For what the form cannot say: tabulated glass and shaped or tilted parts that were made in Python.
    """
    last = len(lens.surfaces) - 1
    rows = [_row(surface, k == last) for k, surface in enumerate(lens.surfaces)]
    result: dict[str, Any] = {"name": lens.name, "source": lens.source, "published": dict(lens.published)}
    result = {key: value for key, value in result.items() if value}
    if lens.object_medium != AIR:
        result["object_medium"] = _glass(lens.object_medium)
    result["surfaces"] = rows
    if lens.configurations:
        result["configurations"] = [
            {"name": state.name, "gaps": dict(state.gaps)}
            | ({"stop_diameter": state.stop_diameter_mm} if state.stop_diameter_mm else {})
            for state in lens.configurations
        ]
    if lens.focusing:
        group = lens.focusing
        result["focusing"] = {"surfaces": [group.first, group.last], "travel": list(group.travel_mm)}
    return result


def write_yaml(lens: Lens) -> str:
    """Return the text of a lens file in our own form, one line a surface."""
    mapping = as_mapping(lens)
    rows = mapping.pop("surfaces")
    tail = {key: mapping.pop(key) for key in ("configurations", "focusing") if key in mapping}
    lines = [_dump(mapping, flow=False).rstrip(), "surfaces:"] if mapping else ["surfaces:"]
    lines += [f"  - {_dump(row, flow=True)}" for row in rows]
    if tail:
        lines.append(_dump(tail, flow=None).rstrip())
    return "\n".join(lines) + "\n"


def write_pbrt(lens: Lens, wavelength_nm: float = WAVELENGTH_D) -> str:
    """Return a four-column table: radius, thickness to the next row, index, diameter; radius and index 0 are the stop.

    Raises
    ------
    InputError
        For surfaces that are not spheres, planes or a stop of their own, which the table cannot hold.
    """
    lines = [f"# {' '.join(lens.name.split())}", "# radius\tthickness\tindex\tdiameter"]
    indices = lens.indices(wavelength_nm)
    if indices[0] != 1:
        raise InputError(f"{lens.name}: a pbrt table cannot hold a medium in front of the lens")
    for k, surface in enumerate(lens.surfaces):
        if surface.kind != "sphere" or surface.pose or surface.region or surface.stop_shape:
            raise InputError(f"{lens.name}: a pbrt table cannot hold surface {k}, which is not a plain sphere or plane")
        if surface.is_stop and (surface.curvature or indices[k] != indices[k + 1]):
            raise InputError(f"{lens.name}: a pbrt table cannot hold the stop on the refracting surface {k}")
        index = 0.0 if surface.is_stop else float(indices[k + 1])
        radius = surface.radius if surface.curvature else 0.0
        values = (radius, surface.thickness, index, 2 * surface.semi_diameter)
        lines.append("\t".join(f"{value:.12g}" for value in values))
    return "\n".join(lines) + "\n"


def _row(surface: Surface, last: bool) -> dict[str, Any]:
    if surface.pose or surface.region or surface.stop_shape:
        raise InputError("tilted, partial and shaped surfaces cannot be written yet; keep the file they came from")
    row: dict[str, Any] = {}
    if surface.is_stop:
        row["stop"] = True
    if surface.curvature:
        row["radius"] = surface.radius
    if not last:
        row["thickness"] = surface.thickness
    if surface.glass != AIR:
        row["glass"] = _glass(surface.glass)
    row["diameter"] = 2 * surface.semi_diameter
    if surface.conic:
        row["conic"] = surface.conic
    if surface.aspheric:
        row["aspheric"] = dict(surface.aspheric)
    if surface.cylinder:
        row["cylinder"] = surface.cylinder
    if surface.curvature_x is not None:
        row["radius_x"] = 1 / surface.curvature_x if surface.curvature_x else math.inf
        row |= {"form": "toroid"} if surface.is_toroid else {"conic_x": surface.conic_x}
    return row


def _glass(medium: Medium) -> Any:
    if medium == AIR:
        return "air"
    if GLASSES.get(medium.name) == medium:
        return medium.name
    named = {"name": medium.name} if medium.name else {}
    match medium:
        case ConstantIndex(value):
            return {"index": value}
        case AbbeCauchy(nd, vd):
            return {"nd": nd, "vd": vd}
        case AbbeLinear(n, v):
            return {"linear_abbe": {"n": n, "v": v}}
        case Sellmeier(b, c, c0, limits):
            extra = {"range_nm": list(limits)} if limits else {}
            return {"sellmeier": {"b": list(b), "c": list(c), "c0": c0}, **extra, **named}
        case PowerSeries(terms, squared, limits):
            return _series(dict(terms), squared, limits, named)
    raise InputError(f"glass {medium.name or type(medium).__name__} cannot be written; name its catalogue in the file")


def _series(terms: dict[float, float], squared: bool, limits: Any, named: dict[str, str]) -> Any:
    extra = ({"range_nm": list(limits)} if limits else {}) | named
    schott = (0.0, 2.0, -2.0, -4.0, -6.0, -8.0)
    if squared and set(terms) <= set(schott):
        return {"schott": [terms.get(power, 0.0) for power in schott], **extra}
    orders = [-power / 2 for power in terms]
    if not squared and all(order >= 0 and order % 1 == 0 for order in orders):
        return {"cauchy": [terms.get(-2.0 * i, 0.0) for i in range(int(max(orders)) + 1)], **extra}
    raise InputError(f"glass {named.get('name', '')} has a formula that a lens file cannot hold; name its catalogue")


def _dump(value: Any, flow: bool | None) -> str:
    return yaml.safe_dump(value, default_flow_style=flow, sort_keys=False, width=10_000, allow_unicode=True).strip()
