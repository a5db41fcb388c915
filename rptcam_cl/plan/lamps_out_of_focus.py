"""Lamps that the camera may see out of focus, as it sees them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import SeenLamp
from rptcam_cl.colour import luminance
from rptcam_cl.core.records import Kind
from rptcam_cl.core.vectors import cross
from rptcam_cl.plan.emitters import glow_of
from rptcam_cl.plan.meshes import corners_of_box
from rptcam_cl.plan.optical_constants import KnownSpectra
from rptcam_cl.plan.primitives import Primitive, sphere_of
from rptcam_cl.plan.textures import TextureTable

Array = NDArray[np.float64]

STEPS = 32  # of an outline
ANGLES = np.linspace(0.0, np.pi / 2, 16, endpoint=False)  # at which the least rectangle about a lamp is looked for


def visible_lamps(primitives: Iterable[Primitive], eye: Array, textures: TextureTable) -> tuple[SeenLamp, ...]:
    """Return what shines and stands still, seen from the eye, in the world about it [m].

    Planes, lamps around the eye and those that turn their back to it are left out.
    """
    lamps = (_seen(primitive, eye, textures) for primitive in primitives if primitive.trajectory is None)
    return tuple(lamp for lamp in lamps if lamp is not None)


def _seen(primitive: Primitive, eye: Array, textures: TextureTable) -> SeenLamp | None:
    if primitive.kind is Kind.PLANE:
        return None
    glow = glow_of(primitive.material, textures, KnownSpectra())
    if glow.strength <= 0:
        return None
    found = _outline(primitive, eye, two_sided=glow.two_sided)
    if found is None or np.linalg.norm(found[0]) <= 1.5 * np.linalg.norm(found[1], axis=1).max():
        return None
    centre, axes, is_round = found
    return SeenLamp(centre, axes, is_round, float(luminance(glow.radiance)))


def _outline(primitive: Primitive, eye: Array, *, two_sided: bool) -> tuple[Array, Array, bool] | None:
    """Return middle, half axes and whether it is round, of what the eye sees of a primitive."""
    linear, origin = primitive.placement[:3, :3], primitive.placement[:3, 3]
    if primitive.kind in (Kind.DISK, Kind.RECTANGLE):
        normal = np.linalg.inv(linear)[2]
        if not two_sided and normal @ origin >= 0:
            return None
        if primitive.kind is Kind.DISK:
            return origin, linear[:, :2].T, True
        axes = linear[:, :2].T / 2
        return origin + axes.sum(axis=0), axes, False
    if primitive.kind is Kind.SPHERE:
        centre, radius = sphere_of(primitive.placement)
        across, distance = _across(centre), float(np.linalg.norm(centre))
        share = 1 - (radius / distance) ** 2 if distance > radius else 0.0  # within it, nothing is left
        return centre, across * (radius / np.sqrt(max(share, 0.1))), True
    if primitive.kind is Kind.ELLIPSOID:
        across = _across(origin)
        sizes, directions = np.linalg.eigh(across @ linear @ linear.T @ across.T)
        return origin, np.sqrt(np.maximum(sizes, 0.0))[:, None] * (directions.T @ across), True
    return (*_least_rectangle(_hull(primitive, eye)), False)


def _across(towards: Array) -> Array:
    """Return two unit vectors (2, 3) across a direction; any two where there is none."""
    length = float(np.linalg.norm(towards))
    z = towards / length if length > 0 else np.array([0.0, 0.0, 1.0])
    x = cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.stack([x, cross(z, x)])


def _hull(primitive: Primitive, eye: Array) -> Array:
    """Return points (n, 3) whose hull holds a primitive, about the eye."""
    if primitive.mesh is not None:
        return corners_of_box(*primitive.mesh.bounds(), primitive.placement) - eye
    angle = 2 * np.pi * np.arange(STEPS) / STEPS
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(STEPS)], axis=1)
    match primitive.kind:
        case Kind.CYLINDER:
            points = np.concatenate([ring, ring + np.array([0.0, 0.0, 1.0])])
        case Kind.CONE:
            points = np.concatenate([ring, [[0.0, 0.0, 1.0]]])
        case _:
            points = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, 8).T
    return np.asarray(points @ primitive.placement[:3, :3].T + primitive.placement[:3, 3])


def _least_rectangle(points: Array) -> tuple[Array, Array]:
    """Return middle and half edges of the least rectangle across the view that holds points."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    across = _across(middle)
    flat = (points - middle) @ across.T
    turns = np.stack([np.cos(ANGLES), np.sin(ANGLES), -np.sin(ANGLES), np.cos(ANGLES)], axis=1).reshape(-1, 2, 2)
    turned = np.einsum("kij,nj->kni", turns, flat)
    low, high = turned.min(axis=1), turned.max(axis=1)
    best = int(np.argmin(np.prod(high - low, axis=1)))
    edges = turns[best] @ across
    return middle + (low[best] + high[best]) / 2 @ edges, (high[best] - low[best])[:, None] / 2 * edges
