"""Our own lens form: YAML, JSON or a mapping, one entry per surface, scene side first."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rptcam_cl.core.references import References
from rptcam_cl.core.strict_yaml import Document, KeyPath
from rptcam_cl.optics.files.checks import check_lens
from rptcam_cl.optics.files.coatings import coated
from rptcam_cl.optics.files.fields import Fields, problem
from rptcam_cl.optics.files.glasses import read_glass
from rptcam_cl.optics.files.keys import GROUP, LENS, LONGEST_MM, SHORTEST_MM, SURFACE, UNITS_MM
from rptcam_cl.optics.files.shapes import read_pose, read_shape
from rptcam_cl.optics.files.variable import read_configurations, read_floating, read_focusing
from rptcam_cl.optics.glass import AIR, Medium
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.placement import IN_PLACE
from rptcam_cl.optics.surface import Surface
from rptcam_cl.optics.variable import configured


def document_of(mapping: Mapping[str, Any], files: References | None = None) -> Document:
    """Return a mapping made in Python as a document without line numbers; it may name files of the working folder."""
    name = mapping.get("name")
    label = name if isinstance(name, str) and name else "<lens>"
    return Document(_plain(mapping), label, {}, {}, files or References())


def _plain(value: Any) -> Any:
    """Return the value with mappings, sequences and numpy scalars as dictionaries, lists and Python numbers."""
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(inner) for inner in value]
    return value.item() if isinstance(value, np.generic) else value


def read_native(document: Document) -> Lens:
    """Return the lens of a document in our own form."""
    if not isinstance(document.data, dict):
        raise problem(document, (), "expected a mapping with name and surfaces", document.data)
    top = Fields(document, (), LENS)
    scale = _unit(top)
    rows = top.get("surfaces")
    if not isinstance(rows, list) or not rows:
        raise top.fail("surfaces" if "surfaces" in top else None, "a lens needs a list of surfaces")
    object_medium = read_glass(document, ("object_medium",)) if "object_medium" in top else AIR
    surfaces = tuple(_surface(document, i, i == len(rows) - 1, scale) for i in range(len(rows)))
    surfaces = _grouped(top, _reflected(document, surfaces, object_medium), scale)
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
        surfaces=coated(document, surfaces, object_medium),
        stop_index=stops[0] if stops else None,
        source=top.text("source"),
        published=dict(published),
        object_medium=object_medium,
        configurations=read_configurations(top, len(surfaces), scale),
        focusing=read_focusing(top, len(surfaces), scale),
        floating=read_floating(top, len(surfaces), scale),
    )
    if lens.configurations:
        lens = configured(lens, lens.configurations[0].name)
    return check_lens(lens, lambda index, key, text: problem(document, ("surfaces", index, key), text))


def _unit(top: Fields) -> float:
    unit = top.text("unit", "mm")
    if unit not in UNITS_MM:
        raise top.fail("unit", f"allowed: {', '.join(UNITS_MM)}")
    return UNITS_MM[unit]


def _surface(document: Document, index: int, last: bool, scale: float) -> Surface:
    fields = Fields(document, ("surfaces", index), SURFACE)
    radius = fields.number("radius", math.inf, infinite=True)
    if radius == 0:
        raise fields.fail("radius", "must not be 0: leave it out for a plane, and mark the stop with stop: true")
    if abs(radius * scale) < SHORTEST_MM:
        raise fields.fail("radius", f"must be at least {SHORTEST_MM:g} mm")
    thickness = fields.number("thickness", 0.0 if last else None)
    diameter, inner = (
        fields.positive("diameter"),
        fields.positive("inner_diameter") if "inner_diameter" in fields else 0.0,
    )
    if inner >= diameter:
        raise fields.fail("inner_diameter", f"must be less than the diameter {diameter:g}")
    for key, value in (("thickness", thickness), ("diameter", diameter)):
        if abs(value * scale) > LONGEST_MM:
            raise fields.fail(key, f"must be at most {LONGEST_MM:g} mm")
    glass: Medium = read_glass(document, (*fields.path, "glass")) if "glass" in fields else AIR
    return Surface(
        curvature=1.0 / (radius * scale),
        thickness=0.0 if last else thickness * scale,
        glass=glass,
        semi_diameter=diameter * scale / 2,
        inner_semi_diameter=inner * scale / 2,
        is_stop=fields.flag("stop"),
        is_mirror=fields.flag("mirror"),
        **read_shape(fields, scale),
    )


def _reflected(document: Document, surfaces: tuple[Surface, ...], before: Medium) -> tuple[Surface, ...]:
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
        result.append(surface)
        before = surface.glass
    return tuple(result)


def _grouped(top: Fields, surfaces: tuple[Surface, ...], scale: float) -> tuple[Surface, ...]:
    """Return the surfaces with the decentre and tilt of the groups they belong to, about each group's first vertex."""
    result = list(surfaces)
    for fields in top.rows("groups", GROUP, "[{surfaces: [0, 3], tilt_degrees: [1, 0]}]"):
        first, last = fields.span("surfaces", len(surfaces))
        pose = read_pose(fields, scale)
        if pose is None:
            raise fields.fail(None, "a group needs decentre or tilt_degrees")
        behind = 0.0
        for k in range(first, last + 1):
            result[k] = replace(result[k], pose=(result[k].pose or IN_PLACE).carried_by(pose, behind))
            behind += result[k].thickness
    return tuple(result)
