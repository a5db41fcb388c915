"""Surfaces that are their profile alone: spheres and planes, conics, cylinders and aspheres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.kinds import SurfaceKind
from rptcam_cl.optics.shapes.iterated import Iterated
from rptcam_cl.optics.shapes.shape import Hits, Profile, Shape, on_vertex_plane, polynomial_of

Array = NDArray[np.float64]


class Sphere(Shape):
    """The hemisphere about the vertex, or the plane when the curvature is 0."""

    kind = SurfaceKind.SPHERE

    def meet(self, profile: Profile, points: Array, directions: Array) -> Hits:
        """Return the hits; the normal of a sphere has unit length by construction."""
        curvature = profile.curvature
        dx, dy, dz = directions
        x, y, to_plane = on_vertex_plane(points, directions)
        f = curvature * (x * x + y * y)
        g = dz - curvature * (dx * x + dy * y)
        discriminant = g * g - curvature * f
        cosine = np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), dz)
        step = f / (g + cosine)
        hit = np.empty((3, *step.shape))
        hit[0], hit[1], hit[2] = x + step * dx, y + step * dy, step * dz
        normal = -curvature * hit
        normal[2] += 1.0
        return Hits(hit, to_plane + step, normal, cosine, (discriminant >= 0) & (normal[2] > 0))


class Conic(Shape):
    """The sheet about the vertex of a conic of revolution or a (conic) cylinder."""

    kind = SurfaceKind.CONIC_KIND

    def meet(self, profile: Profile, points: Array, directions: Array) -> Hits:
        """Return the hits."""
        dx, dy, dz = directions
        wx, wy = profile.axes()
        c, k = profile.curvature, profile.conic
        x, y, to_plane = on_vertex_plane(points, directions)
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


class Asphere(Iterated):
    """A conic and a polynomial in r, turned about the axis or straight.

    With w = z - polynomial the conic w = c (s + (1 + k) w^2) / 2: the iteration needs no root, and one division.
    """

    kind = SurfaceKind.ASPHERE

    def first_guess(self, profile: Profile, x: Array, y: Array, directions: Array) -> Array:
        """Return the step from the vertex plane to the base conic, moved by the polynomial's value there; 0 if none."""
        dx, dy, dz = directions
        (wx, wy), c, q = profile.axes(), profile.curvature, 1.0 + profile.conic
        s = wx * x * x + wy * y * y
        z, _ = polynomial_of(profile, s)
        f = c * (s + q * z * z) + 2.0 * z
        g = dz - c * (wx * dx * x + wy * dy * y - q * dz * z)
        a = c * (wx * dx * dx + wy * dy * dy + q * dz * dz)
        discriminant = g * g - a * f
        step = f / (g + np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), dz))
        found = (discriminant >= 0) & (1.0 - c * q * (step * dz - z) > 0)
        return np.where(found, step, 0.0)

    def newton_step(self, profile: Profile, x: Array, y: Array, z: Array, d: Array) -> tuple[Array, Array]:
        """Return Newton's step for rays at points, and on which side of the surface these lie, by its sign."""
        (wx, wy), half_c, q = profile.axes(), 0.5 * profile.curvature, 1.0 + profile.conic
        s, along_s = wx * x * x + wy * y * y, 2.0 * (wx * x * d[0] + wy * y * d[1])
        polynomial, slope = polynomial_of(profile, s)
        w, along_w = z - polynomial, d[2] - slope * along_s
        side = w - half_c * (s + q * w * w)
        return side / (along_w - half_c * (along_s + 2.0 * q * w * along_w)), side

    def normal_at(self, profile: Profile, x: Array, y: Array, z: Array) -> Array:
        """Return normals (3, n) of any length; z is negative on the far sheet of an asphere."""
        (wx, wy), c, q = profile.axes(), profile.curvature, 1.0 + profile.conic
        polynomial, slope = polynomial_of(profile, wx * x * x + wy * y * y)
        nz = 1.0 - c * q * (z - polynomial)
        sideways = -(c + 2.0 * slope * nz)
        return np.stack([wx * x * sideways, wy * y * sideways, nz])


def shape_of_profile(profile: Profile) -> Shape:
    """Return the kind of a surface that is its profile alone."""
    if profile.aspheric:
        return Asphere()
    return Conic() if profile.conic or profile.cylinder else Sphere()
