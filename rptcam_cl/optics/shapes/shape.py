"""What every kind of lens surface is: an object that knows its sag, where rays meet it and how a device sees it.

Points and directions are arrays (3, n) in the frame of the vertex. Rays are moved to the plane of the vertex first,
then to the surface, so that weak curvature costs no accuracy and a plane needs no case of its own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.kinds import SurfaceKind

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Profile(Protocol):
    """What the shapes read of a `Surface`: its section along the axis, turned about it or, of a cylinder, straight."""

    @property
    def curvature(self) -> float:
        """At the vertex [1/mm]."""

    @property
    def conic(self) -> float:
        """Conic constant."""

    @property
    def aspheric(self) -> tuple[tuple[int, float], ...]:
        """Powers of r with their coefficients."""

    @property
    def cylinder(self) -> str | None:
        """The only axis along which it curves, if there is one."""

    @property
    def semi_diameter(self) -> float:
        """Clear radius [mm]."""

    def axes(self) -> tuple[float, float]:
        """Return the weights of x^2 and y^2 in s."""


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


class Shape(ABC):
    """A kind of surface.

    Attributes
    ----------
    kind : SurfaceKind
        Its number on a device.
    """

    kind: ClassVar[SurfaceKind]

    @abstractmethod
    def meet(self, profile: Profile, points: Array, directions: Array) -> Hits:
        """Return where rays meet the part of the surface about its vertex."""

    def fill(self, record: Any, sense: float) -> None:
        """Write into the record of a device what the profile does not say; ``sense`` is -1 where z is mirrored."""
        record["kind"] = self.kind

    def sag_and_slopes(self, profile: Profile, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return z, dz/dx and dz/dy above points of the vertex plane; NaN where the surface does not reach."""
        wx, wy = profile.axes()
        z, slope = sag_of_profile(profile, wx * x * x + wy * y * y)
        return z, 2.0 * wx * x * slope, 2.0 * wy * y * slope

    def paraxial_curvature(self, profile: Profile, section: str) -> float:
        """Return the curvature at the vertex in the y-z or x-z section [1/mm], the r^2 term of an asphere included."""
        weight = profile.axes()[0 if section == "x" else 1]
        return profile.curvature * weight + 2.0 * weight * sum(a for power, a in profile.aspheric if power == 2)


def on_vertex_plane(points: Array, directions: Array) -> tuple[Array, Array, Array]:
    """Return x, y where rays cross the plane of the vertex, and the distance to it."""
    to_plane = -points[2] / directions[2]
    return points[0] + to_plane * directions[0], points[1] + to_plane * directions[1], to_plane


def sag_of_profile(profile: Profile, s: Array) -> tuple[Array, Array]:
    """Return z and dz/ds of the profile, s being the squared distance from the axis."""
    c = profile.curvature
    root = np.sqrt(1.0 - (1.0 + profile.conic) * c * c * s)
    z = c * s / (1.0 + root)
    slope = 0.5 * c / root
    more, its_slope = polynomial_of(profile, s)
    return np.asarray(z + more), np.asarray(slope + its_slope)


def polynomial_of(profile: Profile, s: Array) -> tuple[Array, Array]:
    """Return the sum of a_p s^(p/2) and its derivative by s: Horner in s or, with odd powers, in r = sqrt(s)."""
    if not profile.aspheric:
        return np.zeros_like(s), np.zeros_like(s)
    terms = dict(profile.aspheric)
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
