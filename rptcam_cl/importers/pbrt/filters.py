"""Reconstruction filters of pbrt as those of our film."""

from __future__ import annotations

import math
from typing import Any

from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.state import Entity

Keys = dict[str, Any]

# Radius without parameters [pixels], in pbrt-v3 and in pbrt-v4; and our kind.
KINDS = {
    "box": (0.5, 0.5, "box"), "triangle": (2.0, 2.0, "tent"), "gaussian": (2.0, 1.5, "gaussian"),
    "mitchell": (2.0, 2.0, "mitchell"), "sinc": (4.0, 4.0, "mitchell"),
}  # fmt: skip
# Our Gaussian ends three standard deviations out, as that of pbrt-v4 does by default.
SIGMAS = 3.0
THIRD = 1 / 3


def filter_keys(context: Context) -> Keys:
    """Return the filter of a film, nothing for a box of one pixel, which is pbrt-v3's default and ours."""
    entity = context.scene.options.get("PixelFilter")
    third = context.scene.version == 3
    if entity is None:
        return {} if third else {"filter": {"kind": "gaussian", "radius_px": 1.5}}
    if entity.kind not in KINDS:
        raise entity.place.error(f'unknown filter "{entity.kind}" (allowed: {", ".join(KINDS)})')
    *defaults, kind = KINDS[entity.kind]
    radius = _radius(context, entity, float(defaults[0 if third else 1]))
    if kind == "gaussian":
        radius = _gaussian_radius(context, entity, radius)
    if entity.kind == "sinc":
        entity.parameters.skip("tau")
        context.report.approximated(entity.place, f"{entity.what}: Mitchell's filter of radius 2")
        radius = 2.0
    if kind == "mitchell" and entity.kind == "mitchell":
        b, c = (entity.parameters.number(name, THIRD) for name in ("B", "C"))
        if max(abs(b - THIRD), abs(c - THIRD)) > 1e-3:
            context.report.approximated(entity.place, f"{entity.what}: B and C as 1/3")
    if kind == "box" and radius == 0.5:
        return {}
    return {"filter": {"kind": kind, "radius_px": min(max(radius, 0.01), 16.0)}}


def _radius(context: Context, entity: Entity, default: float) -> float:
    """Return the radius, which is the same along x and y."""
    x, y = (
        entity.parameters.number(f"{axis}radius", entity.parameters.number(f"{axis}width", default)) for axis in "xy"
    )
    if not (x > 0 and y > 0):
        raise entity.place.error(f"{entity.what}: the radius must be above 0 (got {x:g} and {y:g})")
    if x != y:
        context.report.approximated(entity.place, f"{entity.what}: the same radius along x and y")
    return (x + y) / 2


def _gaussian_radius(context: Context, entity: Entity, radius: float) -> float:
    """Return the radius of the Gaussian of the same width: sigma, or exp(-alpha x^2) in pbrt-v3."""
    alpha = entity.parameters.number("alpha", 2.0)
    if not alpha > 0:
        raise entity.place.error(f"{entity.what}: alpha must be above 0 (got {alpha:g})")
    sigma = entity.parameters.number("sigma", 1 / math.sqrt(2 * alpha))
    if abs(radius - SIGMAS * sigma) > 1e-6:
        context.report.approximated(
            entity.place, f"{entity.what}: ends {SIGMAS:g} standard deviations out, at {SIGMAS * sigma:g} pixels"
        )
    return SIGMAS * sigma
