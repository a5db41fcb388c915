"""The toroid: the y-z profile turned about an axis parallel to y."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.kinds import SurfaceKind
from rptcam_cl.optics.files.fields import Fields
from rptcam_cl.optics.shapes.biconic import Biconic, read_curvature_x
from rptcam_cl.optics.shapes.form import Form, short_radius
from rptcam_cl.optics.shapes.shape import Profile, sag_of_profile

Array = NDArray[np.float64]


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
        curvature = read_curvature_x(fields, scale)
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

    def paraxial_curvature(self, profile: Profile, section: str) -> float:
        """Return the curvature at the vertex in a section [1/mm]."""
        return self.curvature_x if section == "x" else super().paraxial_curvature(profile, section)

    def sag_and_slopes(self, profile: Profile, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return z, dz/dx and dz/dy."""
        cx = self.curvature_x
        z, slope = sag_of_profile(profile, y * y)
        w = 1.0 - cx * z
        root = np.sqrt(w * w - cx * cx * x * x)
        return z + cx * x * x / (w + root), cx * x / root, 2.0 * y * slope * w / root
