"""A refracting or reflecting surface, or a stop: its shape about the vertex, its clear region, the medium behind it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.kinds import SurfaceKind
from rptcam_cl.optics.coating import Coating
from rptcam_cl.optics.glass import AIR, Medium
from rptcam_cl.optics.placement import SurfacePose
from rptcam_cl.optics.region import Region
from rptcam_cl.optics.shapes import Form, Hits, Shape, shape_of_profile
from rptcam_cl.optics.stop_shape import StopMask, StopShape

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """An interface between two media or a mirror, in the frame of its vertex (+z towards the film).

    The plain surface is a sphere or plane: curvature alone. With s = x^2 + y^2 (or x^2, or y^2, for a cylinder),

        z = c s / (1 + sqrt(1 - (1 + k) c^2 s)) + sum of a_p s^(p/2).

    Attributes
    ----------
    curvature : float
        c = 1 / radius [1/mm], positive when the centre lies on the film side; 0 is a plane.
    thickness : float
        Distance to the vertex of the next surface along +z [mm], negative where a mirror has sent the light back; 0 on
        the last one, whose distance to the film is the focus.
    glass : Medium
        Medium that the light enters behind the surface; of a mirror the one that it comes from.
    semi_diameter : float
        Clear radius [mm]: rays that meet the surface farther from the axis are clipped.
    inner_semi_diameter : float
        Radius of a hole or an obstruction [mm]: rays that meet the surface nearer to the axis are clipped.
    is_stop : bool
        Whether this is the aperture stop.
    is_mirror : bool
        Whether it reflects the light.
    conic : float
        k: 0 sphere, -1 paraboloid, below -1 hyperboloid.
    aspheric : tuple of (power, coefficient)
        The a_p with their powers p of r, in millimetres.
    cylinder : "x", "y" or None
        The only axis along which the surface curves.
    form : Form or None
        What makes it more than this profile, such as a `Biconic` or a `Toroid`.
    pose : SurfacePose or None
        Decentre and tilt against the nominal vertex frame.
    region : Region or None
        A further limit of the clear area, and what happens outside.
    stop_shape : StopShape, StopMask or None
        Shape of the opening of a stop inside its semi-diameter; None for a round one.
    coating : Coating or None
        What lies on the surface; None where nothing is said.
    """

    curvature: float = 0.0
    thickness: float = 0.0
    glass: Medium = AIR
    semi_diameter: float = np.inf
    inner_semi_diameter: float = 0.0
    is_stop: bool = False
    is_mirror: bool = False
    conic: float = 0.0
    aspheric: tuple[tuple[int, float], ...] = ()
    cylinder: str | None = None
    form: Form | None = None
    pose: SurfacePose | None = None
    region: Region | None = None
    stop_shape: StopShape | StopMask | None = None
    coating: Coating | None = None

    @property
    def radius(self) -> float:
        """Radius of curvature [mm], infinite for a plane."""
        return 1.0 / self.curvature if self.curvature else np.inf

    @property
    def shape(self) -> Shape:
        """The kind of surface that it is."""
        return self.form or shape_of_profile(self)

    @property
    def is_sphere(self) -> bool:
        """Whether it is a sphere or a plane."""
        return self.shape.kind == SurfaceKind.SPHERE

    @property
    def is_rotational(self) -> bool:
        """Whether the surface and its clear region, but for the shape of a stop, look the same from every azimuth."""
        return not (self.cylinder or self.form or self.pose or self.region)

    @property
    def is_even(self) -> bool:
        """Whether the surface and its clear region look the same in a mirror along x, and in one along y."""
        return not (self.pose or self.region)

    def clears(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Return which points of the vertex plane light is not blocked at."""
        square = x * x + y * y
        inside = square <= self.semi_diameter * self.semi_diameter
        if self.inner_semi_diameter:
            inside = inside & (square >= self.inner_semi_diameter * self.inner_semi_diameter)
        if self.region and self.region.blocks:
            inside = inside & self.region.holds(x, y)
        if self.stop_shape:
            inside = inside & self.stop_shape.holds(x / self.semi_diameter, y / self.semi_diameter)
        return inside

    def axes(self) -> tuple[float, float]:
        """Return the weights of x^2 and y^2 in s: 1 where the surface curves."""
        return (0.0 if self.cylinder == "y" else 1.0, 0.0 if self.cylinder == "x" else 1.0)

    def paraxial_curvature(self, section: str = "y") -> float:
        """Return the curvature at the vertex in the y-z or x-z section [1/mm], the r^2 term of an asphere included."""
        return self.shape.paraxial_curvature(self, section)

    def meet(self, points: Array, directions: Array) -> Hits:
        """Return where rays, points and directions (3, n), meet the part of the surface about its vertex."""
        return self.shape.meet(self, points, directions)

    def sag_and_slopes(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return z, dz/dx and dz/dy above points of the vertex plane; NaN where the surface does not reach."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.shape.sag_and_slopes(self, x, y)

    def sag(self, x: Array, y: Array) -> Array:
        """Return z of the surface above points of its vertex plane [mm]; NaN where it does not reach."""
        return self.sag_and_slopes(x, y)[0]

    def rim_sag(self, height: float | None = None) -> float:
        """Return the sag [mm] at a height from the axis, by default at the rim, along the axis where it curves."""
        y = np.array(self.semi_diameter if height is None else height, dtype=np.float64)
        zero = np.zeros(())
        return float(self.sag(y, zero) if self.cylinder == "x" else self.sag(zero, y))
