"""What a lens takes from the light that crosses it: reflection at its surfaces, absorption in its glass and mirrors.

Reflected light is lost here; `ghosts` follows it. Each surface counts with the mean of both polarisations.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.coating import BARE, Coating, Interface, MeasuredReflectance, QuarterWave
from rptcam_cl.optics.glass import Medium, attenuation
from rptcam_cl.optics.layer_stack import LayerStack
from rptcam_cl.optics.prescription import Prescription
from rptcam_cl.optics.surface import Surface

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
L = TypeVar("L", bound=Prescription)

AIR_LIKE = 1e-3  # a medium whose index is nearer to 1 takes a lens's own coating like air


@dataclass(frozen=True)
class LensTransmission:
    """Which losses count.

    Attributes
    ----------
    fresnel : bool
        Whether surfaces reflect.
    coatings : bool
        Whether they do so through their coatings, where they have any; otherwise every surface is bare.
    absorption : bool
        Whether glass absorbs, where it is known how much.
    """

    fresnel: bool = True
    coatings: bool = True
    absorption: bool = True

    def __bool__(self) -> bool:
        """Whether anything is lost."""
        return self.fresnel or self.absorption

    def coating_of(self, surface: Surface) -> Coating:
        """Return what a surface lets through."""
        return surface.coating if self.coatings and surface.coating is not None else BARE

    def mirror_share(self, mirror: Surface, wavelength_nm: ArrayLike) -> Array:
        """Return what a mirror reflects at wavelengths [nm]: all light, unless it says how much."""
        coating = self.coating_of(mirror)
        if isinstance(coating, MeasuredReflectance):
            return coating.reflectance(wavelength_nm)
        return np.ones(np.shape(wavelength_nm))


IDEAL = LensTransmission(fresnel=False, coatings=False, absorption=False)
UNCOATED = LensTransmission(coatings=False)
COATED = LensTransmission()
BY_NAME = {"ideal": IDEAL, "bare": UNCOATED, "coated": COATED}


def meets_air(before: Medium, after: Medium) -> bool:
    """Return whether a surface between two media lies between glass and air: where a coating of a whole lens goes."""
    close = [abs(float(medium.index(LINE_D_NM)) - 1.0) < AIR_LIKE for medium in (before, after)]
    return any(close) and not all(close)


def with_coating(lens: L, coating: Coating) -> L:
    """Return the lens with a coating on every surface between glass and air."""
    sides = zip(lens.media, lens.media[1:], strict=False)
    surfaces = [
        replace(surface, coating=coating) if meets_air(*media) else surface
        for surface, media in zip(lens.surfaces, sides, strict=True)
    ]
    return replace(lens, surfaces=tuple(surfaces))


def has_coatings(lens: Prescription) -> bool:
    """Return whether the lens says what lies on any of its surfaces."""
    return any(surface.coating is not None for surface in lens.surfaces)


class Losses:
    """What is left of rays on their way through a lens.

    Parameters
    ----------
    lens : Prescription
    transmission : LensTransmission
    wavelengths : float or (n,) array
        Of the rays [nm].
    count : int
        Number of rays.
    """

    def __init__(self, lens: Prescription, transmission: LensTransmission, wavelengths: Array, count: int) -> None:
        self.transmission = transmission
        self.wavelengths = np.broadcast_to(wavelengths, (count,))
        self.attenuations = [
            np.broadcast_to(attenuation(medium, wavelengths) if transmission.absorption else 0.0, (count,))
            for medium in lens.media
        ]
        self.share = np.ones(count)

    def through(self, medium: int, length: Array, beside: Mask) -> None:
        """Take away what a medium (0 in front of the lens) absorbs over a length [mm], but beside a half lens."""
        if self.transmission.absorption:
            self.share = self.share * np.where(beside, 1.0, np.exp(-self.attenuations[medium] * length))

    def across(self, surface: Surface, interface: Interface, beside: Mask) -> None:
        """Take away what a surface reflects, but beside a half lens."""
        if self.transmission.fresnel:
            passed = self.transmission.coating_of(surface).transmittance(interface, self.wavelengths)
            self.share = self.share * np.where(beside, 1.0, passed)

    def off(self, mirror: Surface) -> None:
        """Take away what a mirror does not reflect."""
        if self.transmission.fresnel:
            self.share = self.share * self.transmission.mirror_share(mirror, self.wavelengths)

    def keep(self, good: Mask) -> None:
        """Forget the other rays."""
        self.share, self.wavelengths = self.share[good], self.wavelengths[good]
        self.attenuations = [values[good] for values in self.attenuations]


def axial_transmittance(
    lens: Prescription, wavelength_nm: ArrayLike = LINE_D_NM, transmission: LensTransmission = COATED
) -> Array:
    """Return the share of light that passes along the axis, from the first vertex to the last, at wavelengths [nm]."""
    wavelengths = np.asarray(wavelength_nm, dtype=np.float64)
    indices = lens.indices(wavelengths)
    passed = np.ones(wavelengths.shape)
    for k, surface in enumerate(lens.surfaces):
        if surface.is_mirror:
            passed = passed * (transmission.mirror_share(surface, wavelengths) if transmission.fresnel else 1.0)
        elif transmission.fresnel and np.any(indices[k] != indices[k + 1]):
            interface = Interface(indices[k], indices[k + 1])
            passed = passed * transmission.coating_of(surface).transmittance(interface, wavelengths)
        if transmission.absorption and k + 1 < len(lens.surfaces):
            passed = passed * np.exp(-attenuation(surface.glass, wavelengths) * abs(surface.thickness))
    return passed


def known_nm(lens: Prescription, transmission: LensTransmission) -> tuple[float, float]:
    """Return the wavelengths for which the losses are known [nm]; without limits, 0 and infinity."""
    limits = [(0.0, np.inf)]
    if transmission.absorption:
        inside = [surface.glass.absorption for surface in lens.surfaces[:-1]]
        limits += [(a.wavelengths_nm[0], a.wavelengths_nm[-1]) for a in inside if a is not None]
    if transmission.fresnel:
        coatings = [transmission.coating_of(surface) for surface in lens.surfaces]
        limits += [c.range_nm for c in coatings if isinstance(c, MeasuredReflectance)]
    return max(low for low, _ in limits), min(high for _, high in limits)


def is_tinted(lens: Prescription, transmission: LensTransmission) -> bool:
    """Return whether coatings or glass take more from one colour than from another."""
    low, high = known_nm(lens, transmission)
    if not low < high:
        return False
    coatings = {transmission.coating_of(surface) for surface in lens.surfaces if transmission.fresnel}
    layers = any(isinstance(coating, QuarterWave | LayerStack) for coating in coatings)
    measured = any(isinstance(coating, MeasuredReflectance) and np.ptp(coating.values) > 0 for coating in coatings)
    inside = [surface.glass.absorption for surface in lens.surfaces[:-1]] if transmission.absorption else []
    return layers or measured or any(absorption is not None and np.ptp(absorption.per_mm) > 0 for absorption in inside)
