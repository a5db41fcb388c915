"""Light of one source on the front of a lens: rays spread evenly over the first surface, each with its flux."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.placement import IN_PLACE
from rptcam_cl.optics.polarised_beam import Arrival, PolarisedBeam
from rptcam_cl.optics.spot import Beam

Array = NDArray[np.float64]

GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0  # steps that fill a line most evenly: lattices of any number of points


@dataclass(frozen=True)
class Box:
    """A rectangle across the first surface [mm]."""

    low: tuple[float, float]
    high: tuple[float, float]

    @property
    def area(self) -> float:
        """In mm2."""
        return (self.high[0] - self.low[0]) * (self.high[1] - self.low[1])


class Entry:
    """The first surface of a lens in the light of a source.

    Parameters
    ----------
    lens : Lens
    source : Beam
        In the y-z plane: a parallel beam of irradiance 1 across it, or a lamp of intensity 1 at its distance.

    Attributes
    ----------
    is_even : bool
        Whether lens and light are the same left and right, so that rays of one side stand for both.

    Raises
    ------
    InputError
        When the first surface has no rim, and when the light comes from behind the lens.
    """

    def __init__(self, lens: Lens, source: Beam) -> None:
        self.source, self.first = source, lens.surfaces[0]
        if not np.isfinite(self.first.semi_diameter):
            raise InputError(f"{lens.name}: the first surface needs a diameter")
        if not abs(source.field_degrees) < 90:
            raise InputError(
                f"light at {source.field_degrees:g} degrees does not come from the scene (allowed: below 90)"
            )
        self.is_even = lens.is_rotational and all(surface.stop_shape is None for surface in lens.surfaces)

    def everywhere(self, count: int) -> tuple[Array, float]:
        """Return points (n, 2) spread over the surface, and the area that each stands for [mm2]."""
        numbers, reach = np.arange(count), self.first.semi_diameter
        radius, turn = reach * np.sqrt((numbers + 0.5) / count), np.mod(numbers * GOLDEN, 1.0)
        angle = np.pi * (turn - 0.5) if self.is_even else 2.0 * np.pi * turn
        return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1), np.pi * reach**2 / count

    def within(self, box: Box, count: int) -> tuple[Array, float]:
        """Return points (n, 2) spread over a box, and the area that each stands for [mm2]."""
        numbers = np.arange(count)
        places = np.stack([(numbers + 0.5) / count, np.mod((numbers + 0.5) * GOLDEN, 1.0)], axis=1)
        low, high = np.array(box.low), np.array(box.high)
        return low + places * (high - low), box.area / count * (2.0 if self.is_even else 1.0)

    def around(self, points: Array, spacing: float) -> Box:
        """Return the box about points (n, 2) with room of a spacing [mm], on one side where light is even."""
        reach = self.first.semi_diameter
        low, high = np.maximum(points.min(axis=0) - spacing, -reach), np.minimum(points.max(axis=0) + spacing, reach)
        if self.is_even:
            low[0] = max(low[0], 0.0)
        return Box((float(low[0]), float(low[1])), (float(high[0]), float(high[1])))

    def rays(self, points: Array, area: float) -> Arrival:
        """Return the rays that meet the surface above points (n, 2), inside its rim."""
        x, y = points.T
        z, zx, zy = self.first.sag_and_slopes(x, y)
        good = self.first.clears(x, y) & np.isfinite(z)
        pose = self.first.pose or IN_PLACE
        at = np.stack([x, y, z])[:, good]
        slopes = np.stack([-zx, -zy, np.ones_like(zx)])[:, good]
        at, slopes = pose.outward(at, slopes)
        directions, irradiance = self._light(at)
        flux = np.sum(directions * slopes, axis=0) * irradiance * area
        lit = flux > 0
        normals = slopes[:, lit] / np.sqrt(np.sum(slopes[:, lit] ** 2, axis=0))
        beam = PolarisedBeam.unpolarised(at[:, lit].T, directions[:, lit].T, flux[lit])
        return Arrival(beam, normals, np.sum(normals * beam.directions, axis=0), 0.0, 0.0, 0.0)

    def _light(self, at: Array) -> tuple[Array, Array]:
        """Return unit directions (3, n) of the light at points, and its irradiance across them."""
        origins, directions = self.source.rays(np.zeros((1, 2)))
        if np.isinf(self.source.object_distance_mm):
            return np.broadcast_to(directions.T, at.shape), np.ones(at.shape[1])
        way = at - origins.T
        square = np.sum(way * way, axis=0)
        directions = way / np.sqrt(square)
        return directions, (directions[2] if self.source.is_diffuse else 1.0) / square
