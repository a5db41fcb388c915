"""The kinds of lens surface, each one class with all that the program knows of it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import SurfaceKind
from rptcam_cl.core.strict_yaml import NUMBER, POSITIVE, Fields, Key, as_number, by_number

#
# What every kind of lens surface is: an object that knows its sag, where rays meet it and how a device sees it.
#
# The profile is the surface whose shape it is: its section along the axis, turned about it or, of a cylinder, straight.
# Points and directions are arrays (3, n) in the frame of the vertex. Rays are moved to the plane of the vertex first,
# then to the surface, so that weak curvature costs no accuracy and a plane needs no case of its own.

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class SurfaceProfile(Protocol):
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
    def meet(self, profile: SurfaceProfile, points: Array, directions: Array) -> Hits:
        """Return where rays meet the part of the surface about its vertex."""

    def fill(self, record: Any, sense: float) -> None:
        """Write into the record of a device what the profile does not say; ``sense`` is -1 where z is mirrored."""
        record["kind"] = self.kind

    def sag_and_slopes(self, profile: SurfaceProfile, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return z, dz/dx and dz/dy above points of the vertex plane; NaN where the surface does not reach."""
        wx, wy = profile.axes()
        z, slope = sag_of_profile(profile, wx * x * x + wy * y * y)
        return z, 2.0 * wx * x * slope, 2.0 * wy * y * slope

    def paraxial_curvature(self, profile: SurfaceProfile, section: str) -> float:
        """Return the curvature at the vertex in the y-z or x-z section [1/mm], the r^2 term of an asphere included."""
        weight = profile.axes()[0 if section == "x" else 1]
        return profile.curvature * weight + 2.0 * weight * sum(a for power, a in profile.aspheric if power == 2)

    def fourth_order(self, profile: SurfaceProfile, section: str = "y") -> float:
        """Return 8 times the factor of y^4, or x^4, in the sag: c^3 of a sphere [1/mm3]."""
        weight = profile.axes()[0 if section == "x" else 1]
        return weight * (_conic_fourth(profile.curvature, profile.conic) + 8.0 * _factor_of_r4(profile))


def _conic_fourth(curvature: float, conic: float) -> float:
    """Return 8 times the factor of r^4 in the sag of a conic [1/mm3]."""
    return (1.0 + conic) * curvature**3


def _factor_of_r4(profile: SurfaceProfile) -> float:
    return sum(a for power, a in profile.aspheric if power == 4)


def on_vertex_plane(points: Array, directions: Array) -> tuple[Array, Array, Array]:
    """Return x, y where rays cross the plane of the vertex, and the distance to it."""
    to_plane = -points[2] / directions[2]
    return points[0] + to_plane * directions[0], points[1] + to_plane * directions[1], to_plane


def sag_of_profile(profile: SurfaceProfile, s: Array) -> tuple[Array, Array]:
    """Return z and dz/ds of the profile, s being the squared distance from the axis."""
    c = profile.curvature
    root = np.sqrt(1.0 - (1.0 + profile.conic) * c * c * s)
    z = c * s / (1.0 + root)
    slope = 0.5 * c / root
    more, its_slope = _polynomial_of(profile, s)
    return np.asarray(z + more), np.asarray(slope + its_slope)


def _polynomial_of(profile: SurfaceProfile, s: Array) -> tuple[Array, Array]:
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


# Surfaces that rays meet by Newton's iteration: bounded, and with a reason where it ends without a hit.

ITERATIONS = 24
LAST_STEP = 1e-9  # of the distance scale; a Newton step leaves an error like its square, less than rounding does
WORTH_MOVING = 0.75  # share of rays still under way, below which they are moved together


class Iterated(Shape):
    """A surface met by Newton's iteration on its sag and slopes."""

    def meet(self, profile: SurfaceProfile, points: Array, directions: Array) -> Hits:
        """Return the hits."""
        x0, y0, to_plane = on_vertex_plane(points, directions)
        start = self.first_guess(profile, x0, y0, directions)
        step, converged, crossed = self._iterate(profile, x0, y0, directions, start)
        hits = self.hits_after(profile, x0, y0, to_plane, directions, step)
        return hits._replace(met=hits.met & converged, undecided=np.isfinite(step) & ~converged & crossed)

    def hits_after(
        self, profile: SurfaceProfile, x: Array, y: Array, to_plane: Array, directions: Array, step: Array
    ) -> Hits:
        """Return the hits of rays that are a step away from where they cross the plane of the vertex."""
        hit = np.stack([x + step * directions[0], y + step * directions[1], step * directions[2]])
        normal = self.normal_at(profile, *hit)
        normal /= np.sqrt(np.sum(normal * normal, axis=0))
        cosine = np.sum(normal * directions, axis=0)
        met = np.isfinite(step) & (normal[2] > 0) & (cosine * directions[2] > 0)
        return Hits(hit, to_plane + step, normal, cosine, met)

    def first_guess(self, profile: SurfaceProfile, x: Array, y: Array, directions: Array) -> Array:
        """Return the step from the vertex plane at which the iteration starts: there."""
        return np.zeros_like(x)

    def newton_step(self, profile: SurfaceProfile, x: Array, y: Array, z: Array, d: Array) -> tuple[Array, Array]:
        """Return Newton's step for rays at points, and on which side of the surface these lie, by its sign."""
        with np.errstate(invalid="ignore", divide="ignore"):
            sag, zx, zy = self.sag_and_slopes(profile, x, y)
        return (z - sag) / (d[2] - zx * d[0] - zy * d[1]), z - sag

    def normal_at(self, profile: SurfaceProfile, x: Array, y: Array, z: Array) -> Array:
        """Return normals (3, n) of any length."""
        with np.errstate(invalid="ignore", divide="ignore"):
            _, zx, zy = self.sag_and_slopes(profile, x, y)
        return np.stack([-zx, -zy, np.ones_like(zx)])

    def _iterate(
        self, profile: SurfaceProfile, x0: Array, y0: Array, directions: Array, start: Array
    ) -> tuple[Array, Mask, Mask]:
        """Return the step from the vertex plane to the surface, NaN where lost, which converged, and which crossed it.

        A ray that strays to three clear radii is lost: there the polynomial of an asphere means nothing. One that does
        not converge and was never seen on the other side of the surface does not cross it either.
        """
        step, converged, crossed = start.copy(), np.zeros(start.shape, dtype=bool), np.zeros(start.shape, dtype=bool)
        limit = 9.0 * profile.semi_diameter**2
        rows, t, d, first = np.arange(len(start)), start, directions, None
        last_step, done = LAST_STEP * (np.abs(x0) + np.abs(y0) + np.abs(start)) + 1e-300, converged.copy()
        for _ in range(ITERATIONS):
            x, y = x0 + t * d[0], y0 + t * d[1]
            change, side = self.newton_step(profile, x, y, t * d[2], d)
            first = side if first is None else first
            crossed[rows] |= side * first < 0
            good = done | (x * x + y * y <= limit)
            t = np.where(good, t - change, np.nan)
            done |= np.abs(change) <= last_step
            done &= good
            step[rows], converged[rows] = t, done
            active = good & ~done
            if not active.any():
                break
            if np.count_nonzero(active) < WORTH_MOVING * len(rows):
                kept = (rows, x0, y0, t, last_step, done, first)
                rows, x0, y0, t, last_step, done, first = (values[active] for values in kept)
                d = d[:, active]
        return step, converged, crossed


#
# Kinds of surface with numbers of their own, beside the profile: what a lens file, a trace and a device need of one.
#
# To add one, write a class like `Biconic` and enter it in `FORMS`; CONTRIBUTING walks through it.


class Form(Iterated):
    """A kind of surface that has numbers of its own; its subclasses are frozen dataclasses of them.

    `sag_and_slopes` here is that of the profile, to which a subclass adds or which it replaces.

    Attributes
    ----------
    description : str
        What completes the sentence "it is ...", for formats that cannot say it.
    keys : mapping
        Its keys in a lens file.
    needs : mapping
        Keys that another one of its keys needs beside it.
    facts : tuple of str
        Facts of the program, beyond LENS_GENERAL, that its code on a device is compiled under.
    """

    description: ClassVar[str]
    keys: ClassVar[Mapping[str, Key]]
    needs: ClassVar[Mapping[str, list[str]]] = {}
    facts: ClassVar[tuple[str, ...]] = ()

    @classmethod
    @abstractmethod
    def read(cls, fields: Fields, scale: float) -> Form | None:
        """Return the form that the keys of a surface describe, None where they describe none; lengths times `scale`.

        Raises
        ------
        FieldError
            For a value that cannot be used.
        """

    @abstractmethod
    def written(self) -> dict[str, Any]:
        """Return the keys of a lens file and their values [mm], which `read` takes back."""


def short_radius(curvature: float) -> float:
    """Return the radius with the fewest digits whose inverse is exactly the curvature, else the nearest radius."""
    exact = 1.0 / curvature
    for digits in range(3, 18):
        radius = float(f"{exact:.{digits}g}")
        if 1.0 / radius == curvature:
            return radius
    return exact


# Surfaces that are their profile alone: spheres and planes, conics, cylinders and aspheres.


class Sphere(Shape):
    """The hemisphere about the vertex, or the plane when the curvature is 0."""

    kind = SurfaceKind.SPHERE

    def meet(self, profile: SurfaceProfile, points: Array, directions: Array) -> Hits:
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

    def meet(self, profile: SurfaceProfile, points: Array, directions: Array) -> Hits:
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

    def first_guess(self, profile: SurfaceProfile, x: Array, y: Array, directions: Array) -> Array:
        """Return the step from the vertex plane to the base conic, moved by the polynomial's value there; 0 if none."""
        dx, dy, dz = directions
        (wx, wy), c, q = profile.axes(), profile.curvature, 1.0 + profile.conic
        s = wx * x * x + wy * y * y
        z, _ = _polynomial_of(profile, s)
        f = c * (s + q * z * z) + 2.0 * z
        g = dz - c * (wx * dx * x + wy * dy * y - q * dz * z)
        a = c * (wx * dx * dx + wy * dy * dy + q * dz * dz)
        discriminant = g * g - a * f
        step = f / (g + np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), dz))
        meets = (discriminant >= 0) & (1.0 - c * q * (step * dz - z) > 0)
        return np.where(meets, step, 0.0)

    def newton_step(self, profile: SurfaceProfile, x: Array, y: Array, z: Array, d: Array) -> tuple[Array, Array]:
        """Return Newton's step for rays at points, and on which side of the surface these lie, by its sign."""
        (wx, wy), half_c, q = profile.axes(), 0.5 * profile.curvature, 1.0 + profile.conic
        s, along_s = wx * x * x + wy * y * y, 2.0 * (wx * x * d[0] + wy * y * d[1])
        polynomial, slope = _polynomial_of(profile, s)
        w, along_w = z - polynomial, d[2] - slope * along_s
        side = w - half_c * (s + q * w * w)
        return side / (along_w - half_c * (along_s + 2.0 * q * w * along_w)), side

    def normal_at(self, profile: SurfaceProfile, x: Array, y: Array, z: Array) -> Array:
        """Return normals (3, n) of any length; z is negative on the far sheet of an asphere."""
        (wx, wy), c, q = profile.axes(), profile.curvature, 1.0 + profile.conic
        polynomial, slope = _polynomial_of(profile, wx * x * x + wy * y * y)
        nz = 1.0 - c * q * (z - polynomial)
        sideways = -(c + 2.0 * slope * nz)
        return np.stack([wx * x * sideways, wy * y * sideways, nz])


def shape_of_profile(profile: SurfaceProfile) -> Shape:
    """Return the kind of a surface that is its profile alone."""
    if profile.aspheric:
        return Asphere()
    return Conic() if profile.conic or profile.cylinder else Sphere()


# The biconic: a conic in each section, of its own curvature and conic constant, and a polynomial in r.


@dataclass(frozen=True)
class Biconic(Form):
    """The profile's curvature and conic constant hold in the y-z section.

    Attributes
    ----------
    curvature_x : float
        In the x-z section [1/mm].
    conic_x : float
        Conic constant there.
    """

    curvature_x: float
    conic_x: float = 0.0

    kind = SurfaceKind.BICONIC
    description = "of two curvatures"
    keys: ClassVar = {
        "radius_x": Key("Radius in the x-z section where it differs [unit].", NUMBER),
        "conic_x": Key("k in the x-z section of a biconic.", NUMBER),
        "form": Key("What a surface with radius_x is; biconic by default.", {"enum": ["biconic", "toroid"]}),
    }
    needs: ClassVar = {"form": ["radius_x"], "conic_x": ["radius_x"]}

    @classmethod
    def read(cls, fields: Fields, scale: float) -> Biconic | None:
        """Return the biconic of `radius_x`, unless `form` makes it a toroid."""
        curvature = _read_curvature_x(fields, scale)
        if curvature is None or fields.text("form", "biconic") != "biconic":
            return None
        return cls(curvature, fields.number("conic_x", 0.0))

    def written(self) -> dict[str, Any]:
        """Return the keys of a lens file."""
        row: dict[str, Any] = {"radius_x": short_radius(self.curvature_x) if self.curvature_x else math.inf}
        return row | ({"conic_x": self.conic_x} if self.conic_x else {})

    def fill(self, record: Any, sense: float) -> None:
        """Write the record of a device."""
        super().fill(record, sense)
        record["own"][:2] = sense * self.curvature_x, self.conic_x

    def paraxial_curvature(self, profile: SurfaceProfile, section: str) -> float:
        """Return the curvature at the vertex in a section [1/mm]."""
        if section == "y":
            return super().paraxial_curvature(profile, section)
        return self.curvature_x + 2.0 * sum(a for power, a in profile.aspheric if power == 2)

    def fourth_order(self, profile: SurfaceProfile, section: str = "y") -> float:
        """Return 8 times the factor of y^4, or x^4, in the sag [1/mm3]."""
        if section == "y":
            return super().fourth_order(profile, section)
        return _conic_fourth(self.curvature_x, self.conic_x) + 8.0 * _factor_of_r4(profile)

    def sag_and_slopes(self, profile: SurfaceProfile, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return z, dz/dx and dz/dy."""
        cx, cy = self.curvature_x, profile.curvature
        qx, qy = (1.0 + self.conic_x) * cx * cx, (1.0 + profile.conic) * cy * cy
        top = cx * x * x + cy * y * y
        root = np.sqrt(1.0 - qx * x * x - qy * y * y)
        under = 1.0 + root
        polynomial, slope = _polynomial_of(profile, x * x + y * y)
        zx = 2.0 * cx * x / under + top * qx * x / (root * under * under) + 2.0 * x * slope
        zy = 2.0 * cy * y / under + top * qy * y / (root * under * under) + 2.0 * y * slope
        return top / under + polynomial, zx, zy


def _read_curvature_x(fields: Fields, scale: float) -> float | None:
    """Return the curvature of `radius_x` [1/mm], None without that key."""
    radius = fields.number("radius_x", math.inf, infinite=True)
    if radius == 0:
        raise fields.fail("radius_x", "must not be 0")
    if fields.text("form", "biconic") not in ("biconic", "toroid"):
        raise fields.fail("form", "allowed: biconic, toroid")
    if "radius_x" not in fields and ("form" in fields or "conic_x" in fields):
        raise fields.fail("form" if "form" in fields else "conic_x", "needs radius_x beside it")
    if fields.get("cylinder") and "radius_x" in fields:
        raise fields.fail("cylinder", "a cylinder has one radius; leave out radius_x")
    return 1.0 / (radius * scale) if "radius_x" in fields else None


# The toroid: the y-z profile turned about an axis parallel to y.


@dataclass(frozen=True)
class Toroid(Form):
    """The axis about which the profile turns lies at 1 / curvature_x.

    Attributes
    ----------
    curvature_x : float
        In the x-z section [1/mm].
    """

    curvature_x: float

    kind = SurfaceKind.TOROID
    description = "of two curvatures"
    keys = Biconic.keys

    @classmethod
    def read(cls, fields: Fields, scale: float) -> Toroid | None:
        """Return the toroid of `radius_x` and `form: toroid`."""
        curvature = _read_curvature_x(fields, scale)
        if curvature is None or fields.text("form", "biconic") != "toroid":
            return None
        fields.number("conic_x", 0.0)
        return cls(curvature)

    def written(self) -> dict[str, Any]:
        """Return the keys of a lens file."""
        return {"radius_x": short_radius(self.curvature_x) if self.curvature_x else math.inf, "form": "toroid"}

    def fill(self, record: Any, sense: float) -> None:
        """Write the record of a device."""
        super().fill(record, sense)
        record["own"][0] = sense * self.curvature_x

    def paraxial_curvature(self, profile: SurfaceProfile, section: str) -> float:
        """Return the curvature at the vertex in a section [1/mm]."""
        return self.curvature_x if section == "x" else super().paraxial_curvature(profile, section)

    def fourth_order(self, profile: SurfaceProfile, section: str = "y") -> float:
        """Return 8 times the factor of y^4, or x^4, in the sag: across the profile it is a circle [1/mm3]."""
        return _conic_fourth(self.curvature_x, 0.0) if section == "x" else super().fourth_order(profile, section)

    def sag_and_slopes(self, profile: SurfaceProfile, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return z, dz/dx and dz/dy."""
        cx = self.curvature_x
        z, slope = sag_of_profile(profile, y * y)
        w = 1.0 - cx * z
        root = np.sqrt(w * w - cx * cx * x * x)
        return z + cx * x * x / (w + root), cx * x / root, 2.0 * y * slope * w / root


# A form with its x and y exchanged, by which a lens is measured in its other section; no file and no device has it.


@dataclass(frozen=True)
class Transposed(Form):
    """A form whose x is its y.

    Attributes
    ----------
    form : Form
    """

    form: Form

    description = "turned to be measured in its other section"
    keys: ClassVar = {}

    @classmethod
    def read(cls, fields: Fields, scale: float) -> None:
        """Return nothing, as files have the form itself."""

    def written(self) -> dict[str, Any]:
        """Raise an error, as files have the form itself."""
        raise InputError(f"a surface {self.description} has no place in a lens file")

    def fill(self, record: Any, sense: float) -> None:
        """Raise an error, as devices have the form itself."""
        raise InputError(f"a surface {self.description} has no place on a device")

    def paraxial_curvature(self, profile: SurfaceProfile, section: str) -> float:
        """Return the curvature at the vertex in a section [1/mm]."""
        return self.form.paraxial_curvature(profile, _OTHER[section])

    def fourth_order(self, profile: SurfaceProfile, section: str = "y") -> float:
        """Return 8 times the factor of y^4, or x^4, in the sag [1/mm3]."""
        return self.form.fourth_order(profile, _OTHER[section])

    def sag_and_slopes(self, profile: SurfaceProfile, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return z, dz/dx and dz/dy."""
        z, along_y, along_x = self.form.sag_and_slopes(profile, y, x)
        return z, along_x, along_y


_OTHER = {"x": "y", "y": "x"}

#
# The kinds of lens surface, each one class with all that the program knows of it.
#
# Sphere, conic and asphere follow from the profile of a surface; a `Form` has numbers of its own.

FORMS: tuple[type[Form], ...] = (Biconic, Toroid)


#
# What bends rays at a surface by more than the media beside it: gratings, diffractive surfaces and ideal lenses.
#
# A grating adds an optical path w to a ray, a function of where it meets the surface, and with it the part of grad w
# along the surface to index times direction (Welford, Aberrations of Optical Systems, 1986, sec. 5.6). It is the same
# for light that comes from the film.

MM_PER_NM = 1e-6
_INTEGER = {"type": "integer"}


class Phase(ABC):
    """What a surface does to rays beyond refraction or reflection; its subclasses are frozen dataclasses of numbers.

    Attributes
    ----------
    description : str
        What completes the sentence "it is ...".
    key : str
        Under which a lens file has its `keys`, of which it needs `needs`.
    is_rotational : bool
        Whether it looks the same from every azimuth.
    """

    description: ClassVar[str]
    key: ClassVar[str]
    keys: ClassVar[Mapping[str, Key]]
    needs: ClassVar[tuple[str, ...]]
    is_rotational: ClassVar[bool] = True

    @classmethod
    @abstractmethod
    def read(cls, fields: Fields, scale: float) -> Phase:
        """Return the grating or lens that the keys describe; lengths times `scale`."""

    @abstractmethod
    def written(self) -> dict[str, Any]:
        """Return the keys and their values [mm], which `read` takes back."""

    @abstractmethod
    def power(self, wavelength_nm: float) -> float:
        """Return its power to first order [1/mm]."""

    @abstractmethod
    def bend(self, hits: Hits, d: Array, before: Array, after: Array, nm: Array, mirror: bool) -> tuple[Array, Mask]:
        """Return directions (3, n) behind the surface, and which rays go on.

        Parameters
        ----------
        hits, d
            Where rays meet it and their unit directions, in its frame.
        before, after
            Indices on the side that the ray comes from and on the other, which is the same of a mirror.
        nm
            Wavelengths in vacuum.
        """

    @abstractmethod
    def path(self, hits: Hits, d: Array, bent: Array, before: Array, after: Array, nm: Array, to_film: bool) -> Array:
        """Return the optical path that it adds to rays (n,), to the film or from it [mm]."""


class _Diffracting(Phase):
    """Bends rays by the path that it adds, w(x, y)."""

    @abstractmethod
    def path_and_slopes(self, x: Array, y: Array, nm: Array) -> tuple[Array, Array, Array]:
        """Return w [mm], dw/dx and dw/dy."""

    def bend(self, hits: Hits, d: Array, before: Array, after: Array, nm: Array, mirror: bool) -> tuple[Array, Mask]:
        """Return the directions of the order; where it does not propagate, rays do not go on."""
        along = before * (d - hits.cosines * hits.normals)
        _, wx, wy = self.path_and_slopes(hits.points[0], hits.points[1], nm)
        across = wx * hits.normals[0] + wy * hits.normals[1]
        along = (along - across * hits.normals + np.stack([wx, wy, np.zeros_like(wx)])) / after
        square = 1.0 - np.sum(along * along, axis=0)
        cosine = np.copysign(np.sqrt(np.maximum(square, 0.0)), -hits.cosines if mirror else hits.cosines)
        return along + cosine * hits.normals, square > 0

    def path(self, hits: Hits, d: Array, bent: Array, before: Array, after: Array, nm: Array, to_film: bool) -> Array:
        """Return w."""
        return self.path_and_slopes(hits.points[0], hits.points[1], nm)[0]


@dataclass(frozen=True)
class Grating(_Diffracting):
    """Straight lines, evenly spaced as seen along the axis; w = order x wavelength x lines_per_mm x distance.

    Attributes
    ----------
    lines_per_mm : float
    order : int
        A positive one turns light towards `towards_degrees`.
    towards_degrees : float
        Direction across the lines, from +x towards +y.
    """

    lines_per_mm: float
    order: int = 1
    towards_degrees: float = 90.0

    description = "a grating"
    key = "grating"
    keys: ClassVar = {
        "lines_per_mm": Key("Lines per millimetre, whatever the unit of the file.", POSITIVE),
        "order": Key("Of diffraction; a positive one turns light towards towards_degrees. 1 by default.", _INTEGER),
        "towards_degrees": Key("Direction across the lines, from +x towards +y; 90 by default.", NUMBER),
    }
    needs = ("lines_per_mm",)
    is_rotational = False

    @classmethod
    def read(cls, fields: Fields, scale: float) -> Grating:
        """Return the grating of the keys."""
        return cls(fields.positive("lines_per_mm"), _order(fields), fields.number("towards_degrees", 90.0))

    def written(self) -> dict[str, Any]:
        """Return the keys of a lens file."""
        return {name: getattr(self, name) for name in self.keys}

    def power(self, wavelength_nm: float) -> float:
        """Return 0: it turns the axis, which first order leaves where it is."""
        return 0.0

    def path_and_slopes(self, x: Array, y: Array, nm: Array) -> tuple[Array, Array, Array]:
        """Return w and its slopes."""
        slope = self.order * self.lines_per_mm * MM_PER_NM * np.broadcast_to(nm, x.shape)
        c, s = (turn(math.radians(self.towards_degrees)) for turn in (math.cos, math.sin))
        c, s = (0.0 if abs(value) < 1e-15 else value for value in (c, s))
        return slope * (c * x + s * y), slope * c, slope * s


@dataclass(frozen=True)
class Diffractive(_Diffracting):
    """Rings about the axis; w = order x wavelength / wavelength_nm x sum of a_p r^p.

    Attributes
    ----------
    terms : tuple of (power, coefficient)
        Even powers of r and their a_p, in millimetres.
    wavelength_nm : float
        For which the a_p are.
    order : int
        Of diffraction.
    """

    terms: tuple[tuple[int, float], ...]
    wavelength_nm: float
    order: int = 1

    description = "a diffractive surface"
    key = "diffractive"
    keys: ClassVar = {
        "path": Key("Even powers of r and the coefficients of the path that it adds [unit^(1 - power)].",
                    by_number(NUMBER, minProperties=1)),
        "wavelength_nm": Key("For which these coefficients are [nm]; 587.5618 by default.", POSITIVE),
        "order": Key("Of diffraction; 1 by default.", _INTEGER),
    }  # fmt: skip
    needs = ("path",)

    @classmethod
    def read(cls, fields: Fields, scale: float) -> Diffractive:
        """Return the diffractive surface of the keys."""
        fault = "a power of r is an even number from 2 to 40"
        paths = fields.paths_by_number("path", 2, 40, fault) if isinstance(fields.get("path"), dict) else []
        if not paths or any(power % 2 for power, _ in paths):
            raise fields.fail("path", f"{fault}, such as {{2: -0.001}}")
        terms = tuple((power, as_number(fields.document, path) * scale ** (1 - power)) for power, path in sorted(paths))
        return cls(terms, fields.positive("wavelength_nm", LINE_D_NM), _order(fields))

    def written(self) -> dict[str, Any]:
        """Return the keys of a lens file."""
        return {"path": dict(self.terms), "wavelength_nm": self.wavelength_nm, "order": self.order}

    def power(self, wavelength_nm: float) -> float:
        """Return its power to first order [1/mm]."""
        return -2.0 * self.order * wavelength_nm / self.wavelength_nm * dict(self.terms).get(2, 0.0)

    def path_and_slopes(self, x: Array, y: Array, nm: Array) -> tuple[Array, Array, Array]:
        """Return w and its slopes."""
        terms = dict(self.terms)
        value, slope = _horner([terms.get(2 * k, 0.0) for k in range(max(terms) // 2 + 1)], x * x + y * y)
        scale = self.order * nm / self.wavelength_nm
        return scale * value, scale * 2.0 * slope * x, scale * 2.0 * slope * y


@dataclass(frozen=True)
class IdealLens(Phase):
    """A thin lens that images every plane before it onto a plane, point by point.

    n' s' = n s - h / f of slopes s along the light and heights h. No lens has equal paths between all pairs of planes;
    this one has them between one pair.

    Attributes
    ----------
    focal_length_mm : float
        In air.
    object_per_mm : float
        1 / distance of the plane in front of it from which paths are equal; 0 is far away.
    """

    focal_length_mm: float
    object_per_mm: float = 0.0

    description = "an ideal lens"
    key = "ideal"
    keys: ClassVar = {"focal_length": Key("In air, negative of one that diverges light [unit].", NUMBER)}
    needs = ("focal_length",)

    @classmethod
    def read(cls, fields: Fields, scale: float) -> IdealLens:
        """Return the ideal lens of the keys."""
        if fields.number("focal_length") == 0:
            raise fields.fail("focal_length", "must not be 0")
        return cls(fields.number("focal_length") * scale)

    def written(self) -> dict[str, Any]:
        """Return the keys of a lens file."""
        return {"focal_length": self.focal_length_mm}

    def power(self, wavelength_nm: float) -> float:
        """Return its power [1/mm]."""
        return 1.0 / self.focal_length_mm

    def bend(self, hits: Hits, d: Array, before: Array, after: Array, nm: Array, mirror: bool) -> tuple[Array, Mask]:
        """Return the directions."""
        slopes = (before * d[:2] / np.abs(d[2]) - hits.points[:2] / self.focal_length_mm) / after
        bent = np.stack([*slopes, np.copysign(np.ones_like(d[2]), d[2])])
        return bent / np.sqrt(1.0 + np.sum(slopes * slopes, axis=0)), np.ones(d.shape[1], dtype=bool)

    def path(self, hits: Hits, d: Array, bent: Array, before: Array, after: Array, nm: Array, to_film: bool) -> Array:
        """Return how much shorter than through the middle the way over a point is between the planes of equal paths."""
        ways = (-d[:2] / np.abs(d[2]), before), (bent[:2] / np.abs(bent[2]), after)
        (ahead, near), (behind, far) = ways if to_film else ways[::-1]
        image_per_mm = (1.0 / self.focal_length_mm - near * self.object_per_mm) / far
        h = hits.points[:2]
        return near * _shorter(h, ahead, self.object_per_mm) + far * _shorter(h, behind, image_per_mm)


def _shorter(h: Array, slopes: Array, per_mm: Array | float) -> Array:
    """Return by how much points at 1 / per_mm on rays of some slopes are nearer to h (2, n) than to the middle."""
    from_middle = np.sum((per_mm * h + slopes) ** 2, axis=0)
    longer = per_mm * np.sum(h * h, axis=0) + 2.0 * np.sum(slopes * h, axis=0)
    return np.asarray(longer / (np.sqrt(1.0 + from_middle) + np.sqrt(1.0 + np.sum(slopes * slopes, axis=0))))


def _order(fields: Fields) -> int:
    order = fields.number("order", 1.0)
    if order % 1 or order == 0:
        raise fields.fail("order", "expected a whole number, not 0")
    return int(order)


PHASES: tuple[type[Phase], ...] = (Grating, Diffractive, IdealLens)
