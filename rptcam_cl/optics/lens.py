"""A lens: surfaces in a row from scene to film, and what can be asked of it. Lengths in millimetres, float64."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.glass import AIR, Medium, known_range
from rptcam_cl.optics.surface import Surface

if TYPE_CHECKING:
    from rptcam_cl.optics.first_order import FirstOrder
    from rptcam_cl.optics.ray_trace import Rays
    from rptcam_cl.optics.stop_shape import StopMask, StopShape
    from rptcam_cl.optics.transmission import LensTransmission
    from rptcam_cl.optics.variable import Configuration, FocusingGroup, FocusState

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Lens:
    """Surfaces from scene to film. The first vertex is the origin; +z points to the film.

    Attributes
    ----------
    name, source : str
        What it is called and where its numbers come from.
    published : mapping
        First-order data that the source claims, such as ``focal_length_mm`` and ``f_number``.
    surfaces : tuple of Surface
        In the order in which light from the scene meets them.
    stop_index : int or None
        Which surface is the aperture stop; None when only the rims limit the light.
    object_medium : Medium
        What lies in front of the first surface.
    configurations : tuple of Configuration
        States of a zoom lens, by rising or falling focal length; the lens itself is in the first one.
    focusing : FocusingGroup or None
        Surfaces that move to focus; None when the whole lens does.
    floating : tuple of FocusState
        Gaps at nearer object planes, of a lens whose groups move each its own way to focus; the lens itself is focused
        at infinity.
    warnings : tuple of str
        Doubts about the prescription that do not make it unusable.
    """

    name: str
    surfaces: tuple[Surface, ...]
    stop_index: int | None = None
    source: str = ""
    published: Mapping[str, Any] = field(default_factory=dict)
    object_medium: Medium = AIR
    configurations: tuple[Configuration, ...] = ()
    focusing: FocusingGroup | None = None
    floating: tuple[FocusState, ...] = ()
    warnings: tuple[str, ...] = ()

    @cached_property
    def vertices(self) -> Array:
        """Position z of each vertex [mm]."""
        gaps = [surface.thickness for surface in self.surfaces[:-1]]
        return np.concatenate([[0.0], np.cumsum(gaps)])

    @property
    def length(self) -> float:
        """Position z of the last vertex [mm]: how far it lies from the first one."""
        return float(self.vertices[-1])

    @cached_property
    def senses(self) -> Array:
        """Which way light from the scene travels before the first surface and behind each one: 1 to +z, -1 to -z."""
        turns = [-1.0 if surface.is_mirror else 1.0 for surface in self.surfaces]
        return np.concatenate([[1.0], np.cumprod(turns)])

    @property
    def sense(self) -> float:
        """Which way light travels to the film: 1 to +z, -1 to -z behind an odd number of mirrors."""
        return float(self.senses[-1])

    @property
    def has_mirrors(self) -> bool:
        """Whether any surface reflects."""
        return any(surface.is_mirror for surface in self.surfaces)

    @property
    def is_obstructed(self) -> bool:
        """Whether any surface has a hole or an obstruction in its middle."""
        return any(surface.inner_semi_diameter > 0 for surface in self.surfaces)

    def film_z(self, distance_mm: float) -> float:
        """Return z of a plane at a distance behind the last vertex, along the light [mm]."""
        return self.length + self.sense * distance_mm

    @property
    def stop(self) -> Surface | None:
        """The surface that is the stop, if there is one."""
        return None if self.stop_index is None else self.surfaces[self.stop_index]

    @property
    def media(self) -> tuple[Medium, ...]:
        """The medium before the first surface and after each one."""
        return (self.object_medium, *(surface.glass for surface in self.surfaces))

    def indices(self, wavelength_nm: ArrayLike = LINE_D_NM) -> Array:
        """Return the index before the first surface and after each one, shape (n + 1, *wavelengths)."""
        return np.stack([medium.index(wavelength_nm) for medium in self.media])

    @property
    def known_nm(self) -> tuple[float, float]:
        """Wavelengths that every medium is known for [nm]; without limits, 0 and infinity."""
        media = [self.object_medium, *(surface.glass for surface in self.surfaces)]
        limits = [limit for medium in media if (limit := known_range(medium)) is not None]
        return max((low for low, _ in limits), default=0.0), min((high for _, high in limits), default=float("inf"))

    def first_order(self, wavelength_nm: float = LINE_D_NM, section: str = "y") -> FirstOrder:
        """Return focal length, cardinal points and pupils at a wavelength [nm], in the "y" or "x" section."""
        from rptcam_cl.optics.first_order import first_order

        return first_order(self, wavelength_nm, section)

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
        from rptcam_cl.optics.ray_trace import trace

        return trace(self, origins, directions, wavelength_nm, start, transmission)

    @property
    def has_power(self) -> bool:
        """Whether any surface bends light: a stop alone, or plane glass, does not."""
        return any(surface.paraxial_curvature(section) for surface in self.surfaces for section in ("x", "y"))

    @property
    def is_rotational(self) -> bool:
        """Whether the lens looks the same from every azimuth."""
        return all(surface.is_rotational for surface in self.surfaces)

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
        if diameter_mm > has * (1 + 1e-9):
            widest = self.first_order().f_number
            speed = f", f/{widest:.3g}" if np.isfinite(widest) else ""
            raise InputError(f"{self.name}: the stop opens to {has:.5g} mm{speed} (asked for {diameter_mm:.5g} mm)")
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
        """Return the stop diameter [mm] of an f-number = focal length / entrance pupil diameter (paraxial)."""
        stop = self._need_stop()
        if not f_number > 0 or not np.isfinite(f_number):
            raise InputError(f"{self.name}: f-number must be above 0 (got {f_number:g})")
        widest = self.first_order(wavelength_nm).f_number
        if not np.isfinite(widest):
            raise InputError(f"{self.name}: has no focal length, so no f-number; set stop_diameter_mm instead")
        diameter = 2 * stop.semi_diameter * widest / f_number
        if f_number < widest * (1 - 1e-9):
            raise InputError(
                f"{self.name}: opens to f/{widest:.4g}, a stop of {2 * stop.semi_diameter:.5g} mm "
                f"(f/{f_number:g} would need {diameter:.5g} mm)"
            )
        return float(min(diameter, 2 * stop.semi_diameter))

    def _need_stop(self) -> Surface:
        if self.stop is None:
            raise InputError(
                f"{self.name}: has no stop to set; only its rims limit the light (mark one with stop: true)"
            )
        return self.stop
