"""Where rays meet a surface: closed forms for spheres, conics and cylinders, bounded iteration for the rest.

Points and directions are arrays (3, n) in the frame of the vertex. Rays are moved to the plane of the vertex first,
then to the surface, so that weak curvature costs no accuracy and a plane needs no case of its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from rptcam_cl.optics.surface import Surface

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ITERATIONS = 24
LAST_STEP = 1e-9  # of the distance scale; a Newton step leaves an error like its square, less than rounding does
WORTH_MOVING = 0.75  # share of rays still under way, below which they are moved together


class Hits(NamedTuple):
    """Hit points and unit normals (3, n), distances and cosines (n,), which rays hit and which were left undecided.

    The normal has positive z; the cosine between it and the ray has the sign of the ray's z, so that the ray crosses
    the surface in the sense in which it travels.
    """

    points: Array
    distances: Array
    normals: Array
    cosines: Array
    met: Mask
    undecided: Mask | None = None


def meet(surface: Surface, points: Array, directions: Array) -> Hits:
    """Return where rays meet the part of a surface about its vertex."""
    if surface.kind == "sphere":
        return meet_sphere(surface.curvature, points, directions)
    if surface.kind == "conic":
        return meet_conic(surface, points, directions)
    return meet_general(surface, points, directions)


def meet_sphere(curvature: float, points: Array, directions: Array) -> Hits:
    """Return the hits with the hemisphere about the vertex, or with the plane when the curvature is 0."""
    dx, dy, dz = directions
    x, y, to_plane = _on_vertex_plane(points, directions)
    f = curvature * (x * x + y * y)
    g = dz - curvature * (dx * x + dy * y)
    discriminant = g * g - curvature * f
    cosine = np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), dz)
    step = f / (g + cosine)
    hit = np.stack([x + step * dx, y + step * dy, step * dz])
    normal = -curvature * hit
    normal[2] += 1.0
    return Hits(hit, to_plane + step, normal, cosine, (discriminant >= 0) & (normal[2] > 0))


def meet_conic(surface: Surface, points: Array, directions: Array) -> Hits:
    """Return the hits with the sheet about the vertex of a conic of revolution or a (conic) cylinder."""
    dx, dy, dz = directions
    wx, wy = surface.axes()
    c, k = surface.curvature, surface.conic
    x, y, to_plane = _on_vertex_plane(points, directions)
    f = c * (wx * x * x + wy * y * y)
    g = dz - c * (wx * dx * x + wy * dy * y)
    a = c * (wx * dx * dx + wy * dy * dy + (1.0 + k) * dz * dz)
    discriminant = g * g - a * f
    root = np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), dz)
    step = f / (g + root)
    hit = np.stack([x + step * dx, y + step * dy, step * dz])
    normal = np.stack([-c * wx * hit[0], -c * wy * hit[1], 1.0 - c * (1.0 + k) * hit[2]])
    met = (discriminant >= 0) & (normal[2] > 0)
    length = np.sqrt(np.sum(normal * normal, axis=0))
    return Hits(hit, to_plane + step, normal / length, root / length, met)


def meet_general(surface: Surface, points: Array, directions: Array) -> Hits:
    """Return the hits with an asphere, biconic or toroid, by Newton's iteration."""
    dx, dy, dz = directions
    x0, y0, to_plane = _on_vertex_plane(points, directions)
    start = _first_guess(surface, x0, y0, directions) if surface.curvature_x is None else np.zeros_like(x0)
    step, settled, crossed = _iterate(surface, x0, y0, directions, start)
    hit = np.stack([x0 + step * dx, y0 + step * dy, step * dz])
    normal = _normal_at(surface, *hit)
    normal /= np.sqrt(np.sum(normal * normal, axis=0))
    cosine = np.sum(normal * directions, axis=0)
    reached = np.isfinite(step)
    met = reached & settled & (normal[2] > 0) & (cosine * dz > 0)
    return Hits(hit, to_plane + step, normal, cosine, met, reached & ~settled & crossed)


def _first_guess(surface: Surface, x: Array, y: Array, directions: Array) -> Array:
    """Return the step from the vertex plane to the base conic, moved by the polynomial's value there; 0 if none."""
    dx, dy, dz = directions
    (wx, wy), c, q = surface.axes(), surface.curvature, 1.0 + surface.conic
    s = wx * x * x + wy * y * y
    z, _ = _polynomial(surface, s)
    f = c * (s + q * z * z) + 2.0 * z
    g = dz - c * (wx * dx * x + wy * dy * y - q * dz * z)
    a = c * (wx * dx * dx + wy * dy * dy + q * dz * dz)
    discriminant = g * g - a * f
    step = f / (g + np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), dz))
    found = (discriminant >= 0) & (1.0 - c * q * (step * dz - z) > 0)
    return np.where(found, step, 0.0)


def _iterate(surface: Surface, x0: Array, y0: Array, directions: Array, start: Array) -> tuple[Array, Mask, Mask]:
    """Return the step from the vertex plane to the surface, NaN where lost, which settled, and which crossed it.

    A ray that strays to three clear radii is lost: there the polynomial of an asphere means nothing. One that does not
    settle and was never seen on the other side of the surface does not cross it either.
    """
    step, settled, crossed = start.copy(), np.zeros(start.shape, dtype=bool), np.zeros(start.shape, dtype=bool)
    limit = 9.0 * surface.semi_diameter**2
    rows, t, d, first = np.arange(len(start)), start, directions, None
    last_step, done = LAST_STEP * (np.abs(x0) + np.abs(y0) + np.abs(start)) + 1e-300, settled.copy()
    for _ in range(ITERATIONS):
        x, y = x0 + t * d[0], y0 + t * d[1]
        change, side = _newton_step(surface, x, y, t * d[2], d)
        first = side if first is None else first
        crossed[rows] |= side * first < 0
        good = done | (x * x + y * y <= limit)
        t = np.where(good, t - change, np.nan)
        done |= np.abs(change) <= last_step
        done &= good
        step[rows], settled[rows] = t, done
        active = good & ~done
        if not active.any():
            break
        if np.count_nonzero(active) < WORTH_MOVING * len(rows):
            kept = (rows, x0, y0, t, last_step, done, first)
            rows, x0, y0, t, last_step, done, first = (values[active] for values in kept)
            d = d[:, active]
    return step, settled, crossed


def _newton_step(surface: Surface, x: Array, y: Array, z: Array, d: Array) -> tuple[Array, Array]:
    """Return Newton's step for rays at points, and on which side of the surface these lie, by its sign.

    With w = z - polynomial an asphere is the conic w = c (s + (1 + k) w^2) / 2: no root, and one division.
    """
    if surface.curvature_x is not None:
        sag, zx, zy = sag_and_slopes(surface, x, y)
        return (z - sag) / (d[2] - zx * d[0] - zy * d[1]), z - sag
    (wx, wy), half_c, q = surface.axes(), 0.5 * surface.curvature, 1.0 + surface.conic
    s, along_s = wx * x * x + wy * y * y, 2.0 * (wx * x * d[0] + wy * y * d[1])
    polynomial, slope = _polynomial(surface, s)
    w, along_w = z - polynomial, d[2] - slope * along_s
    side = w - half_c * (s + q * w * w)
    return side / (along_w - half_c * (along_s + 2.0 * q * w * along_w)), side


def _normal_at(surface: Surface, x: Array, y: Array, z: Array) -> Array:
    """Return normals (3, n) of any length; z is negative on the far sheet of an asphere."""
    if surface.curvature_x is not None:
        _, zx, zy = sag_and_slopes(surface, x, y)
        return np.stack([-zx, -zy, np.ones_like(zx)])
    (wx, wy), c, q = surface.axes(), surface.curvature, 1.0 + surface.conic
    polynomial, slope = _polynomial(surface, wx * x * x + wy * y * y)
    nz = 1.0 - c * q * (z - polynomial)
    sideways = -(c + 2.0 * slope * nz)
    return np.stack([wx * x * sideways, wy * y * sideways, nz])


def sag_and_slopes(surface: Surface, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return z, dz/dx and dz/dy of a surface above points of its vertex plane; NaN where it does not reach."""
    with np.errstate(invalid="ignore", divide="ignore"):
        if surface.curvature_x is None:
            wx, wy = surface.axes()
            z, slope = _profile(surface, wx * x * x + wy * y * y)
            return z, 2.0 * wx * x * slope, 2.0 * wy * y * slope
        if surface.is_toroid:
            return _toroid(surface, x, y)
        return _biconic(surface, x, y)


def _profile(surface: Surface, s: Array) -> tuple[Array, Array]:
    """Return z and dz/ds of the profile, s being the squared distance from the axis."""
    c = surface.curvature
    root = np.sqrt(1.0 - (1.0 + surface.conic) * c * c * s)
    z = c * s / (1.0 + root)
    slope = 0.5 * c / root
    polynomial, its_slope = _polynomial(surface, s)
    return np.asarray(z + polynomial), np.asarray(slope + its_slope)


def _polynomial(surface: Surface, s: Array) -> tuple[Array, Array]:
    """Return the sum of a_p s^(p/2) and its derivative by s: Horner in s or, with odd powers, in r = sqrt(s)."""
    if not surface.aspheric:
        return np.zeros_like(s), np.zeros_like(s)
    terms = dict(surface.aspheric)
    if all(power % 2 == 0 for power in terms):
        return _horner([terms.get(2 * i, 0.0) for i in range(max(terms) // 2 + 1)], s)
    r = np.sqrt(s)
    z, by_r = _horner([terms.get(i, 0.0) for i in range(max(terms) + 1)], r)
    return z, np.where(r > 0, by_r / (2.0 * r), terms.get(2, 0.0))


def _horner(coefficients: list[float], x: Array) -> tuple[Array, Array]:
    """Return a polynomial, coefficients by rising power, and its derivative."""
    value, slope = np.full_like(x, coefficients[-1]), np.zeros_like(x)
    for a in reversed(coefficients[:-1]):
        slope = slope * x + value
        value = value * x + a
    return value, slope


def _biconic(surface: Surface, x: Array, y: Array) -> tuple[Array, Array, Array]:
    assert surface.curvature_x is not None
    cx, cy = surface.curvature_x, surface.curvature
    qx, qy = (1.0 + surface.conic_x) * cx * cx, (1.0 + surface.conic) * cy * cy
    top = cx * x * x + cy * y * y
    root = np.sqrt(1.0 - qx * x * x - qy * y * y)
    under = 1.0 + root
    polynomial, slope = _polynomial(surface, x * x + y * y)
    zx = 2.0 * cx * x / under + top * qx * x / (root * under * under) + 2.0 * x * slope
    zy = 2.0 * cy * y / under + top * qy * y / (root * under * under) + 2.0 * y * slope
    return top / under + polynomial, zx, zy


def _toroid(surface: Surface, x: Array, y: Array) -> tuple[Array, Array, Array]:
    assert surface.curvature_x is not None
    cx = surface.curvature_x
    z, slope = _profile(surface, y * y)
    w = 1.0 - cx * z
    root = np.sqrt(w * w - cx * cx * x * x)
    return z + cx * x * x / (w + root), cx * x / root, 2.0 * y * slope * w / root


def _on_vertex_plane(points: Array, directions: Array) -> tuple[Array, Array, Array]:
    """Return x, y where rays cross the plane of the vertex, and the distance to it."""
    to_plane = -points[2] / directions[2]
    return points[0] + to_plane * directions[0], points[1] + to_plane * directions[1], to_plane
