"""The biconic: a conic in each section, of its own curvature and conic constant, and a polynomial in r."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.kinds import SurfaceKind
from rptcam_cl.optics.files.fields import Fields
from rptcam_cl.optics.files.key import NUMBER, Key
from rptcam_cl.optics.shapes.form import Form, short_radius
from rptcam_cl.optics.shapes.shape import Profile, polynomial_of

Array = NDArray[np.float64]


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
        curvature = read_curvature_x(fields, scale)
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

    def paraxial_curvature(self, profile: Profile, section: str) -> float:
        """Return the curvature at the vertex in a section [1/mm]."""
        if section == "y":
            return super().paraxial_curvature(profile, section)
        return self.curvature_x + 2.0 * sum(a for power, a in profile.aspheric if power == 2)

    def sag_and_slopes(self, profile: Profile, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return z, dz/dx and dz/dy."""
        cx, cy = self.curvature_x, profile.curvature
        qx, qy = (1.0 + self.conic_x) * cx * cx, (1.0 + profile.conic) * cy * cy
        top = cx * x * x + cy * y * y
        root = np.sqrt(1.0 - qx * x * x - qy * y * y)
        under = 1.0 + root
        polynomial, slope = polynomial_of(profile, x * x + y * y)
        zx = 2.0 * cx * x / under + top * qx * x / (root * under * under) + 2.0 * x * slope
        zy = 2.0 * cy * y / under + top * qy * y / (root * under * under) + 2.0 * y * slope
        return top / under + polynomial, zx, zy


def read_curvature_x(fields: Fields, scale: float) -> float | None:
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
