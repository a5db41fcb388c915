"""A lens, and what is most used of it: first-order data, rays through it, its stop set. Millimetres, float64."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.first_order import FirstOrder, first_order
from rptcam_cl.optics.prescription import Prescription
from rptcam_cl.optics.ray_trace import Rays, trace
from rptcam_cl.optics.stop_shape import StopMask, StopShape
from rptcam_cl.optics.surface import Surface
from rptcam_cl.optics.transmission import LensTransmission

WORTH_A_WORD = 0.995  # a marked f-number nearer than this to the true one is that


@dataclass(frozen=True)
class Lens(Prescription):
    """A `Prescription`, which says what it is made of, and the methods most used on one."""

    def first_order(self, wavelength_nm: float = LINE_D_NM, section: str = "y") -> FirstOrder:
        """Return focal length, cardinal points and pupils at a wavelength [nm], in the "y" or "x" section."""
        known = self._first_orders.get((wavelength_nm, section))
        if known is None:
            known = self._first_orders[wavelength_nm, section] = first_order(self, wavelength_nm, section)
        return known

    @cached_property
    def _first_orders(self) -> dict[tuple[float, str], FirstOrder]:
        return {}

    def trace(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        wavelength_nm: ArrayLike = LINE_D_NM,
        start: str = "film",
        *,
        transmission: LensTransmission | None = None,
    ) -> Rays:
        """Return rays traced through every surface in float64, from the film or from the scene. See `optics.trace`."""
        return trace(self, origins, directions, wavelength_nm, start, transmission)

    def with_warnings(self, more: tuple[str, ...]) -> Lens:
        """Return the lens with further doubts noted."""
        return replace(self, warnings=(*self.warnings, *more))

    def with_stop_diameter(self, diameter_mm: float) -> Lens:
        """Return the lens with its stop closed to a diameter [mm]."""
        stop = self._need_stop()
        assert self.stop_index is not None
        has = 2 * stop.semi_diameter
        if not diameter_mm > 0 or not np.isfinite(diameter_mm):
            raise InputError(f"{self.name}: stop diameter must be above 0 mm (got {diameter_mm:g})")
        if diameter_mm > max(has * (1 + 1e-9), *_printed(has)):
            widest = self.first_order().f_number
            speed = f", f/{widest:.3g}" if np.isfinite(widest) else ""
            raise InputError(f"{self.name}: the stop opens to {has:.5g} mm{speed} (requested {diameter_mm:.5g} mm)")
        surfaces = list(self.surfaces)
        surfaces[self.stop_index] = replace(stop, semi_diameter=min(diameter_mm, has) / 2)
        return replace(self, surfaces=tuple(surfaces))

    def with_stop_shape(self, shape: StopShape | StopMask | None) -> Lens:
        """Return the lens with its stop shaped; None makes it round."""
        stop = self._need_stop()
        assert self.stop_index is not None
        surfaces = list(self.surfaces)
        surfaces[self.stop_index] = replace(stop, stop_shape=shape)
        return replace(self, surfaces=tuple(surfaces))

    def stop_diameter_for(self, f_number: float, wavelength_nm: float = LINE_D_NM) -> float:
        """Return the stop diameter [mm] of an f-number = focal length / entrance pupil diameter (paraxial).

        The f-number that the lens is marked with, and that which it opens to as it is printed, are its full opening.
        """
        stop = self._need_stop()
        if not f_number > 0 or not np.isfinite(f_number):
            raise InputError(f"{self.name}: f-number must be above 0 (got {f_number:g})")
        widest = self.first_order(wavelength_nm).f_number
        if not np.isfinite(widest):
            raise InputError(f"{self.name}: has no focal length, so no f-number; set stop_diameter_mm instead")
        diameter = 2 * stop.semi_diameter * widest / f_number
        least = min(widest * (1 - 1e-9), *_printed(widest))
        if f_number < least and f_number < (self.marked_f_number or widest) * (1 - 1e-9):
            raise InputError(
                f"{self.name}: opens to f/{widest:.4g}, a stop of {2 * stop.semi_diameter:.5g} mm "
                f"(f/{f_number:g} would need {diameter:.5g} mm)"
            )
        return float(min(diameter, 2 * stop.semi_diameter))

    def speed_note(self, f_number: float, wavelength_nm: float = LINE_D_NM) -> tuple[str, ...]:
        """Return what to say of a marked f-number that the lens does not reach; else nothing."""
        widest, marked = self.first_order(wavelength_nm).f_number, self.marked_f_number
        if self.stop is None or marked is None or not marked <= f_number < WORTH_A_WORD * widest:
            return ()
        return (f"{self.name}: is marked f/{marked:g} and opens to f/{widest:.4g}, which is taken",)

    def _need_stop(self) -> Surface:
        if self.stop is None:
            raise InputError(
                f"{self.name}: has no stop to set; only its rims limit the light (mark one with stop: true)"
            )
        return self.stop


def _printed(value: float) -> tuple[float, float, float]:
    """Return a number as messages and tables print it, with three to five digits."""
    return float(f"{value:.3g}"), float(f"{value:.4g}"), float(f"{value:.5g}")
