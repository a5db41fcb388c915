"""What a lens is: surfaces in a row from scene to film and its settings. Lengths in millimetres, float64."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.glass import AIR, Medium, known_range
from rptcam_cl.optics.surface import Surface

Array = NDArray[np.float64]
FEW = 16  # wavelengths of which indices are remembered
REMEMBERED = 256  # rows of media at some wavelengths, whose indices are remembered
# f/2, F2.8 and F/1.4 in a name; not f = 50 mm, nor F50
_SPEED = re.compile(r"(?<![A-Za-z])[fF](?:\s?/\s?|(?=\d{1,2}\.\d))(\d{1,2}(?:\.\d+)?)(?![\d.]*\s?mm)")
_INDICES: dict[tuple[object, ...], tuple[tuple[Medium, ...], Array]] = {}


@dataclass(frozen=True)
class Configuration:
    """One published state of a zoom lens.

    Attributes
    ----------
    name : str
    gaps : tuple of (surface, thickness)
        Thickness behind each surface whose gap varies [mm].
    stop_diameter_mm : float or None
        Stop diameter of this state when it differs.
    floating : tuple of FocusState
        Gaps at nearer object planes in this state.
    """

    name: str
    gaps: tuple[tuple[int, float], ...]
    stop_diameter_mm: float | None = None
    floating: tuple[FocusState, ...] = ()


@dataclass(frozen=True)
class FocusingGroup:
    """Neighbouring surfaces that move together to focus.

    Attributes
    ----------
    first, last : int
        Surfaces of the group.
    travel_mm : tuple of float
        Least and greatest shift towards the film; 0 is the place in the table.
    """

    first: int
    last: int
    travel_mm: tuple[float, float]


@dataclass(frozen=True)
class FocusState:
    """The gaps of a lens whose groups float, focused at one distance.

    Attributes
    ----------
    distance_mm : float
        From the object plane to the film.
    gaps : tuple of (surface, thickness)
        Thickness behind each surface whose gap varies [mm].
    film_shift_mm : float or None
        How much farther the film is from the last vertex than at infinity: 0 where neither moves, None where it is not
        said, and the film follows the image.
    """

    distance_mm: float
    gaps: tuple[tuple[int, float], ...]
    film_shift_mm: float | None = None


@dataclass(frozen=True)
class Prescription:
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
    first_sense : float
        Which way light comes to the first surface: 1 to +z; -1 for a part of a lens that begins behind a mirror.
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
    first_sense: float = 1.0

    @property
    def marked_f_number(self) -> float | None:
        """F-number that it is sold with: `marked_f_number` of its file, else the least of source and name."""
        said = self.published.get("marked_f_number")
        if said is not None:
            return float(said)
        title = _SPEED.search(self.name)
        found = [self.published.get("f_number"), float(title[1]) if title else None]
        numbers = [float(n) for n in found if isinstance(n, int | float) and not isinstance(n, bool) and n > 0]
        return min(numbers, default=None)

    @property
    def focuses_by_group(self) -> bool:
        """Whether groups move in it to focus while it is known where the film stands."""
        shifts = [state.film_shift_mm for state in self.floating]
        return self.focusing is not None or (bool(shifts) and None not in shifts)

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
        return self.first_sense * np.concatenate([[1.0], np.cumprod(turns)])

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
        """Return the index before the first surface and after each one, shape (n + 1, *wavelengths); not to be changed.

        Those of few wavelengths are remembered, as all states of a lens have the same media.
        """
        media, nm = self.media, np.asarray(wavelength_nm, np.float64)
        if nm.size > FEW:
            return np.stack([medium.index(wavelength_nm) for medium in media])
        key = nm.tobytes(), nm.shape, *map(id, media)
        known = _INDICES.get(key)
        if known is None:
            found = np.stack([medium.index(wavelength_nm) for medium in media])
            found.flags.writeable = False
            if len(_INDICES) >= REMEMBERED:
                _INDICES.clear()
            known = _INDICES[key] = media, found  # which keeps the media, so that no others get their ids
        return known[1]

    @property
    def known_nm(self) -> tuple[float, float]:
        """Wavelengths that every medium is known for [nm]; without limits, 0 and infinity."""
        media = [self.object_medium, *(surface.glass for surface in self.surfaces)]
        limits = [limit for medium in media if (limit := known_range(medium)) is not None]
        return max((low for low, _ in limits), default=0.0), min((high for _, high in limits), default=float("inf"))

    @property
    def has_power(self) -> bool:
        """Whether any surface bends light: a stop alone, or plane glass, does not."""
        return any(surface.paraxial_curvature(section) for surface in self.surfaces for section in ("x", "y"))

    @property
    def is_rotational(self) -> bool:
        """Whether the lens looks the same from every azimuth."""
        return all(surface.is_rotational for surface in self.surfaces)
