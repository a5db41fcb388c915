"""Copies of a lens, each with its own errors of manufacture: one of them as a lens, or all of them as arrays.

A `Deviation` is one number, or one pair of numbers, that may be off. Its values over the copies make the `Copies`. A
copy whose values are all 0 has the numbers of the lens to the last bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.glass import Law, Melt
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.placement import IN_PLACE, SurfacePose

Array = NDArray[np.float64]

DeviationKind = Literal["radius", "curvature", "thickness", "index", "abbe", "decentre", "tilt"]
PAIRS = ("decentre", "tilt")  # deviations across the axis, which have an x and a y


@dataclass(frozen=True)
class Deviation:
    """One thing that manufacture may get wrong.

    Attributes
    ----------
    kind : str
        ``radius`` as a share of the radius, ``curvature`` [1/mm], ``thickness`` [mm], ``index``, ``abbe`` as a share of
        the Abbe number, ``decentre`` along x and y [mm], or ``tilt`` about x and y [radians].
    first, last : int
        Surfaces that move together about the vertex of the first; of the other kinds the one surface, which has the
        radius or is followed by the gap or the glass.
    """

    kind: DeviationKind
    first: int
    last: int

    @property
    def is_pair(self) -> bool:
        """Whether it has an x and a y."""
        return self.kind in PAIRS


@dataclass(frozen=True)
class Copies:
    """Copies of a lens.

    Attributes
    ----------
    lens : Lens
        The design.
    deviations : sequence of Deviation
        Those of surfaces before those of what carries them: tilts and decentres act in this order.
    values : (copies, deviations, 2) array
        In the units of `Deviation`; a deviation that is no pair has its value in the first place.
    """

    lens: Lens
    deviations: Sequence[Deviation]
    values: Array

    @property
    def count(self) -> int:
        """How many copies there are."""
        return len(self.values)

    def part(self, low: int, high: int) -> Copies:
        """Return the copies of a range."""
        return Copies(self.lens, self.deviations, self.values[low:high])

    @cached_property
    def curvatures(self) -> Array:
        """Curvature of each surface (copies, surfaces) [1/mm]."""
        of_design = self._rows([surface.curvature for surface in self.lens.surfaces])
        return of_design / (1.0 + self._sums("radius")) + self._sums("curvature")

    @cached_property
    def thicknesses(self) -> Array:
        """Thickness behind each surface (copies, surfaces) [mm]."""
        return self._rows([surface.thickness for surface in self.lens.surfaces]) + self._sums("thickness")

    @cached_property
    def vertices(self) -> Array:
        """Position z of each vertex (copies, surfaces) [mm]."""
        places = np.zeros_like(self.thicknesses)
        np.cumsum(self.thicknesses[:, :-1], axis=1, out=places[:, 1:])
        return places

    def indices(self, wavelength_nm: float) -> Array:
        """Return the index before the first surface and after each one (copies, surfaces + 1)."""
        found = self._rows(self.lens.indices(wavelength_nm))
        shift, share = self._sums("index"), self._sums("abbe")
        found[:, 1:] += shift
        for k in np.flatnonzero(np.any(share != 0, axis=0)).tolist():
            glass = self.lens.surfaces[k].glass
            off_d = float(glass.index(wavelength_nm) - glass.index(LINE_D_NM))
            found[:, k + 1] += off_d * (1.0 / (1.0 + share[:, k]) - 1.0)
        return found

    @cached_property
    def poses(self) -> dict[int, tuple[Array, Array]]:
        """Rotation (copies, 3, 3) and offset (copies, 3) [mm] of each surface that has any."""
        found: dict[int, tuple[Array, Array]] = {}
        for k, surface in enumerate(self.lens.surfaces):
            if surface.pose is not None:
                found[k] = (self._rows(surface.pose.matrix()), self._rows(surface.pose.offset))
        for number, deviation in enumerate(self.deviations):
            if not deviation.is_pair:
                continue
            value = self.values[:, number]
            for k in range(deviation.first, deviation.last + 1):
                start = (self._rows(np.eye(3)), np.zeros((self.count, 3)))
                arm = float(self.lens.vertices[k] - self.lens.vertices[deviation.first])
                found[k] = _moved(*found.get(k, start), deviation, value, arm)
        return found

    def copy(self, number: int) -> Lens:
        """Return one of the copies as a lens."""
        one = self.part(number, number + 1)
        surfaces = list(self.lens.surfaces)
        shift, share = one._sums("index")[0], one._sums("abbe")[0]
        for k, surface in enumerate(surfaces):
            if shift[k] or share[k]:
                surface = replace(surface, glass=Melt.of(_law(surface.glass), float(shift[k]), float(share[k])))
            curvature, thickness = float(one.curvatures[0, k]), float(one.thicknesses[0, k])
            surfaces[k] = replace(surface, curvature=curvature, thickness=thickness, pose=one._pose(k))
        return replace(self.lens, surfaces=tuple(surfaces))

    def _pose(self, k: int) -> SurfacePose | None:
        """Return the pose of a surface of the first copy; None where it stands as the design has it, without one."""
        if k not in self.poses:
            return None
        rotation, offset = self.poses[k][0][0], self.poses[k][1][0]
        pose = SurfacePose(tuple(offset.tolist()), tuple(tuple(row) for row in rotation.tolist()))  # type: ignore[arg-type]
        return None if pose == IN_PLACE and self.lens.surfaces[k].pose is None else pose

    def _rows(self, of_lens: ArrayLike) -> Array:
        """Return numbers of the design for each copy."""
        values = np.asarray(of_lens, dtype=np.float64)
        return np.repeat(values[None], self.count, axis=0)

    def _sums(self, kind: DeviationKind) -> Array:
        """Return the deviations of a kind, added up over what concerns each surface (copies, surfaces)."""
        total = np.zeros((self.count, len(self.lens.surfaces)))
        for number, deviation in enumerate(self.deviations):
            if deviation.kind == kind:
                total[:, deviation.first] += self.values[:, number, 0]
        return total


def _moved(rotation: Array, offset: Array, deviation: Deviation, value: Array, arm: float) -> tuple[Array, Array]:
    """Return poses after a further tilt or decentre about a vertex that lies `arm` [mm] before theirs.

    As `SurfacePose.carried_by`, for many copies.
    """
    if deviation.kind == "decentre":
        return rotation, offset + np.pad(value, ((0, 0), (0, 1)))
    turn, place = turns(value[:, 0], value[:, 1]), np.array([0.0, 0.0, arm])
    return turn @ rotation, np.einsum("mij,mj->mi", turn, offset + place) - place


def turns(about_x: Array, about_y: Array) -> Array:
    """Return matrices (n, 3, 3) of turns about x, then y [radians], right handed."""
    (cx, sx), (cy, sy) = ((np.cos(angle), np.sin(angle)) for angle in (about_x, about_y))
    zero = np.zeros_like(cx)
    rows = [[cy, sy * sx, sy * cx], [zero, cx, -sx], [-sy, cy * sx, cy * cx]]
    return np.moveaxis(np.array(rows), -1, 0)


def _law(glass: object) -> Law:
    assert isinstance(glass, Law)
    return glass
