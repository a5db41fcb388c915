"""A lens as text of our own form, which reads back as the same lens. Lengths in millimetres."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from functools import singledispatch
from typing import Any

import numpy as np

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import (
    AIR,
    BARE,
    MAGNESIUM_FLUORIDE,
    AbbeCauchy,
    AbbeLinear,
    Absorption,
    Coating,
    ConstantIndex,
    FocusState,
    Law,
    Layer,
    LayerStack,
    Lens,
    MeasuredReflectance,
    Medium,
    PowerSeries,
    QuarterWave,
    Region,
    Sellmeier,
    StopShape,
    Surface,
    SurfacePose,
    TabulatedIndex,
    Thermal,
    glass_named,
    short_radius,
)

WRITTEN_THICKNESS_MM = 10.0
SCHOTT_POWERS = (0.0, 2.0, -2.0, -4.0, -6.0, -8.0)


def lens_text(lens: Lens, comments: Sequence[str] = ()) -> str:
    """Return the YAML of a lens, comments above.

    Raises
    ------
    InputError
        When the form cannot say something about the lens.
    """
    if lens.first_sense != 1.0:
        raise InputError(f"{lens.name}: begins behind a mirror, which a lens file cannot say")
    lines = [f"# {line}" for comment in comments for line in comment.splitlines()]
    lines.append(f"name: {_flow(lens.name)}")
    if lens.source:
        lines.append(f"source: {_flow(lens.source)}")
    if published := {key: value for key, value in lens.published.items() if key != "marked_f_number"}:
        lines.append(f"published: {_flow(published)}")
    if "marked_f_number" in lens.published:
        lines.append(f"marked_f_number: {_flow(lens.published['marked_f_number'])}")
    if lens.object_medium != AIR:
        lines.append(f"object_medium: {_flow(_medium(lens.object_medium))}")
    lines.append("surfaces:")
    last = len(lens.surfaces) - 1
    lines += [f"  - {_flow(_surface(lens, k, k == last))}" for k in range(last + 1)]
    if lens.configurations:
        lines.append("configurations:")
        for state in lens.configurations:
            row: dict[str, Any] = {"name": state.name, "gaps": dict(state.gaps)}
            if state.stop_diameter_mm is not None:
                row["stop_diameter"] = state.stop_diameter_mm
            if state.floating:
                row["floating"] = list(map(_focus_state, state.floating))
            lines.append(f"  - {_flow(row)}")
    if lens.focusing is not None:
        group = lens.focusing
        entry = {"surfaces": [group.first, group.last], "travel": list(group.travel_mm)}
        lines.append(f"focusing: {_flow(entry)}")
    if lens.floating and not lens.configurations:
        lines.append("floating:")
        lines += [f"  - {_flow(_focus_state(state))}" for state in lens.floating]
    return "\n".join([*lines, ""])


def _focus_state(state: FocusState) -> dict[str, Any]:
    row: dict[str, Any] = {"distance": state.distance_mm, "gaps": dict(state.gaps)}
    return row if state.film_shift_mm is None else row | {"film_shift": state.film_shift_mm}


def _surface(lens: Lens, k: int, last: bool) -> dict[str, Any]:
    surface = lens.surfaces[k]
    where = f"{lens.name}: surface {k}"
    if not math.isfinite(surface.semi_diameter):
        raise InputError(f"{where}: has no diameter, which a lens file needs")
    row: dict[str, Any] = {}
    if surface.is_stop:
        row["stop"] = True
    if surface.is_mirror:
        row["mirror"] = True
    if surface.curvature:
        row["radius"] = short_radius(surface.curvature)
    if not last:
        row["thickness"] = surface.thickness
    if surface.glass != AIR and not surface.is_mirror:
        row["glass"] = _medium(surface.glass)
    row["diameter"] = 2 * surface.semi_diameter
    if surface.inner_semi_diameter:
        row["inner_diameter"] = 2 * surface.inner_semi_diameter
    if surface.coating is not None:
        row["coating"] = _coating(surface.coating, where)
    row |= _shape(surface)
    if surface.pose is not None:
        row |= _pose(surface.pose)
    if surface.region is not None:
        row |= _region(surface.region, where)
    if isinstance(surface.stop_shape, StopShape):
        row["shape"] = {"polygon": [list(point) for point in surface.stop_shape.vertices]}
    return row


def _shape(surface: Surface) -> dict[str, Any]:
    row: dict[str, Any] = {}
    if surface.conic:
        row["conic"] = surface.conic
    if surface.aspheric:
        row["aspheric"] = dict(surface.aspheric)
    if surface.cylinder:
        row["cylinder"] = surface.cylinder
    return row | (surface.form.written() if surface.form else {})


def _pose(pose: SurfacePose) -> dict[str, Any]:
    """Return decentre and tilt: the matrix is a turn about x, then y, then z."""
    r = pose.matrix()
    tilt = [math.atan2(r[2, 1], r[2, 2]), math.asin(float(np.clip(-r[2, 0], -1, 1))), math.atan2(r[1, 0], r[0, 0])]
    row: dict[str, Any] = {}
    if any(pose.offset) or not any(tilt):
        row["decentre"] = list(pose.offset)
    if any(tilt):
        row["tilt_degrees"] = [math.degrees(angle) for angle in tilt]
    return row


def _region(region: Region, where: str) -> dict[str, Any]:
    if region.inverted:
        raise InputError(f"{where}: is clear outside of a region, which a lens file cannot say")
    clear: dict[str, Any] = {}
    if math.isfinite(region.half_width):
        clear["rectangle"] = [2 * region.half_width, 2 * region.half_height]
    if region.normal_degrees is not None:
        clear |= {"half_plane_degrees": region.normal_degrees, "edge": region.edge}
    return {"clear": clear} if region.blocks else {"clear": clear, "outside": "pass"}


def _layer(layer: Layer) -> dict[str, float]:
    dark = {"extinction": layer.extinction} if layer.extinction else {}
    return {"index": layer.index, "thickness_nm": layer.thickness_nm, **dark}


def _coating(coating: Coating, where: str) -> Any:
    if coating == BARE:
        return "bare"
    if coating == MAGNESIUM_FLUORIDE:
        return "mgf2"
    if isinstance(coating, QuarterWave):
        return {"quarter_wave": {"index": coating.index, "wavelength_nm": coating.wavelength_nm}}
    if isinstance(coating, LayerStack):
        return {"layers": [_layer(layer) for layer in coating.layers]}
    if not isinstance(coating, MeasuredReflectance):
        raise InputError(f"{where}: has a coating that a lens file cannot say ({type(coating).__name__})")
    if len(coating.values) == 1:
        return {"reflectance": coating.values[0]}
    return {"reflectance": {"wavelengths_nm": list(coating.wavelengths_nm), "values": list(coating.values)}}


def _medium(medium: Medium) -> Any:
    """Return a glass with what it absorbs, where its name does not say that."""
    if medium.name and glass_named(medium.name) == medium:
        return medium.name
    entry = _glass(medium)
    if isinstance(entry, str):
        return entry
    thermal = _thermal(medium.thermal) if isinstance(medium, Law) and medium.thermal is not None else {}
    absorbs = {} if medium.absorption is None else {"transmittance": _transmittance(medium.absorption)}
    return entry | absorbs | thermal


def _thermal(thermal: Thermal) -> dict[str, Any]:
    """Return what is said about heat."""
    row: dict[str, Any] = {}
    if thermal.dispersion is not None:
        d, e = list(thermal.dispersion[:3]), list(thermal.dispersion[3:5])
        row["thermal"] = {"d": d, "e": e, "resonance_um": thermal.dispersion[5], "reference_c": thermal.reference_c}
    return row if thermal.expansion_per_k is None else row | {"expansion_per_k": thermal.expansion_per_k}


def _transmittance(absorption: Absorption) -> dict[str, Any]:
    """Return the internal transmittance over 10 mm."""
    values = np.exp(-WRITTEN_THICKNESS_MM * np.asarray(absorption.per_mm)).tolist()
    return {"thickness_mm": WRITTEN_THICKNESS_MM, "wavelengths_nm": list(absorption.wavelengths_nm), "values": values}


@singledispatch
def _glass(medium: Any) -> Any:
    raise InputError(f"a lens file cannot say the glass {medium.name!r} ({type(medium).__name__})")


@_glass.register
def _constant(medium: ConstantIndex) -> Any:
    entry: dict[str, Any] = {"index": medium.value}
    return entry if medium.name in ("", f"n = {medium.value:g}") else entry | {"name": medium.name}


@_glass.register
def _abbe(medium: AbbeCauchy) -> Any:
    entry: dict[str, Any] = {"nd": medium.nd, "vd": medium.vd}
    return entry if medium.name in ("", f"{medium.nd:g} / {medium.vd:g}") else entry | {"name": medium.name}


@_glass.register
def _linear(medium: AbbeLinear) -> Any:
    entry: dict[str, Any] = {"linear_abbe": {"n": medium.n, "v": medium.v}}
    return entry if medium.name in ("", f"{medium.n:g} / {medium.v:g} linear") else entry | {"name": medium.name}


@_glass.register
def _sellmeier(medium: Sellmeier) -> Any:
    law: dict[str, Any] = {"b": list(medium.b), "c": list(medium.c)}
    if medium.c0:
        law["c0"] = medium.c0
    return _ranged({"sellmeier": law}, medium)


@_glass.register
def _series(medium: PowerSeries) -> Any:
    powers, values = zip(*medium.terms, strict=True)
    if medium.squared and powers == SCHOTT_POWERS:
        return _ranged({"schott": list(values)}, medium)
    if not medium.squared and powers == tuple(-2.0 * i for i in range(len(powers))):
        return _ranged({"cauchy": list(values)}, medium)
    raise InputError(f"a lens file cannot say the glass {medium.name!r}: its powers are {powers}")


@_glass.register
def _table(medium: TabulatedIndex) -> Any:
    table = {"wavelengths_nm": list(medium.wavelengths_nm), "values": list(medium.values)}
    return {"table": table, "name": medium.name} if medium.name else {"table": table}


def _ranged(entry: dict[str, Any], medium: Sellmeier | PowerSeries) -> dict[str, Any]:
    if medium.range_nm is not None:
        entry["range_nm"] = list(medium.range_nm)
    if medium.name:
        entry["name"] = medium.name
    return entry


def _flow(value: Any) -> str:
    """Return a value on one line of YAML."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(key)}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, bool | int | str) or value is None:
        return json.dumps(value, ensure_ascii=False)
    number = float(value)
    if math.isinf(number):
        return ".inf" if number > 0 else "-.inf"
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)


def _key(key: Any) -> str:
    return key if isinstance(key, str) and key.isidentifier() else _flow(key)
