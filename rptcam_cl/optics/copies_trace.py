"""Rays through many copies of a lens at once, in float64: those of `ray_trace.trace`, but that rims stop none.

A tolerance run compares copies by the same rays, which pass the design. What the rim of a decentred surface takes from
the edge of a beam is left out: it would make the number of rays jump, and with it every sensitivity.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.copies import Copies
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import refract
from rptcam_cl.optics.shapes import Hits, Iterated
from rptcam_cl.optics.surface import Surface

Array = NDArray[np.float64]

RAYS_TOGETHER = 8192  # whose components stay in the processor's cache
NEWTON_STEPS = 24
LAST_STEP = 1e-9  # of the distance scale, as in `optics.shapes.iterated`


def check_copies(lens: Lens) -> None:
    """Refuse a lens whose copies cannot be traced.

    Raises
    ------
    InputError
        For mirrors, whose surfaces light may meet twice, and parts of lenses that light passes beside.
    """
    if lens.has_mirrors:
        raise InputError(
            f"{lens.name}: has mirrors, so light may meet a surface twice, whose errors are the same both times;"
            " tolerances are for lenses without"
        )
    if any(surface.region is not None and not surface.region.blocks for surface in lens.surfaces):
        raise InputError(f"{lens.name}: light passes beside some of its surfaces; tolerances are for whole lenses")


def film_points(
    copies: Copies, origins: Array, directions: Array, wavelength_nm: float, film_distance_mm: float
) -> tuple[Array, Array]:
    """Return where rays from the scene meet the films of all copies, and their slopes there.

    Parameters
    ----------
    copies : Copies
    origins, directions : (rays, 3) arrays
        The same for all copies [mm]; directions of unit length.
    wavelength_nm : float
    film_distance_mm : float
        From the last vertex of each copy to its film.

    Returns
    -------
    points, slopes : (copies, rays, 2) arrays
        x and y [mm], and dx/dz and dy/dz; NaN for rays that miss a surface or are totally reflected.
    """
    rays = len(origins)
    points, slopes = np.empty((2, copies.count, rays, 2))
    step = max(1, RAYS_TOGETHER // rays)
    with np.errstate(all="ignore"):
        for low in range(0, copies.count, step):
            some = copies.part(low, low + step)
            p, d = _through(some, origins, directions, wavelength_nm)
            slope = d[:2] / d[2]
            at = p[:2] + slope * (np.repeat(some.vertices[:, -1], rays) + film_distance_mm - p[2])
            shape = (2, some.count, rays)
            points[low : low + step] = np.moveaxis(at.reshape(shape), 0, -1)
            slopes[low : low + step] = np.moveaxis(slope.reshape(shape), 0, -1)
    return points, slopes


def _through(copies: Copies, origins: Array, directions: Array, wavelength_nm: float) -> tuple[Array, Array]:
    """Return points and directions (3, copies * rays) behind the last surface."""
    rays, indices = len(origins), copies.indices(wavelength_nm)
    p, d = np.tile(origins.T, copies.count), np.tile(directions.T, copies.count)
    for k, surface in enumerate(copies.lens.surfaces):
        shift = np.zeros((3, 1)) + np.repeat(copies.vertices[:, k], rays) * [[0.0], [0.0], [1.0]]
        pose = copies.poses.get(k)
        q, v = (p - shift, d) if pose is None else _inward(pose, p - shift, d, rays)
        hits = _meet(surface, np.repeat(copies.curvatures[:, k], rays), q, v)
        good = hits.met & np.isfinite(hits.distances) & (v[2] > 0)
        if not np.array_equal(indices[:, k], indices[:, k + 1]):
            v, through = refract(v, hits.normals, hits.cosines, np.repeat(indices[:, k] / indices[:, k + 1], rays))
            good &= through
        q = np.where(good, hits.points, np.nan)
        q, v = (q, v) if pose is None else _outward(pose, q, v, rays)
        p, d = q + shift, v
    return p, d


def _inward(pose: tuple[Array, Array], p: Array, d: Array, rays: int) -> tuple[Array, Array]:
    rotation, offset = pose
    return _turned(np.swapaxes(rotation, 1, 2), p - np.repeat(offset.T, rays, axis=1), d, rays)


def _outward(pose: tuple[Array, Array], p: Array, d: Array, rays: int) -> tuple[Array, Array]:
    rotation, offset = pose
    p, d = _turned(rotation, p, d, rays)
    return p + np.repeat(offset.T, rays, axis=1), d


def _turned(rotation: Array, p: Array, d: Array, rays: int) -> tuple[Array, Array]:
    """Return points and directions (3, copies * rays), those of each copy turned by its matrix."""
    m = [[np.repeat(rotation[:, i, j], rays) for j in range(3)] for i in range(3)]
    turned = (np.stack([row[0] * v[0] + row[1] * v[1] + row[2] * v[2] for row in m]) for v in (p, d))
    return next(turned), next(turned)


def _meet(surface: Surface, curvatures: Array, p: Array, d: Array) -> Hits:
    """Return where rays meet surfaces that differ in their curvature alone (rays,)."""
    profile = replace(surface, curvature=curvatures)  # type: ignore[arg-type]
    shape = surface.shape
    if not isinstance(shape, Iterated):
        return shape.meet(profile, p, d)
    to_plane = -p[2] / d[2]
    x, y = p[0] + to_plane * d[0], p[1] + to_plane * d[1]
    step = shape.first_guess(profile, x, y, d)
    least = LAST_STEP * (np.abs(x) + np.abs(y) + np.abs(step)) + 1e-300
    for _ in range(NEWTON_STEPS):
        change, _side = shape.newton_step(profile, x + step * d[0], y + step * d[1], step * d[2], d)
        step = step - change
        if np.all((np.abs(change) <= least) | ~np.isfinite(change)):
            break
    hit = np.stack([x + step * d[0], y + step * d[1], step * d[2]])
    normal = shape.normal_at(profile, *hit)
    normal /= np.sqrt(np.sum(normal * normal, axis=0))
    cosine = np.sum(normal * d, axis=0)
    return Hits(hit, to_plane + step, normal, cosine, np.isfinite(step) & (normal[2] > 0) & (cosine > 0))
