"""Light that an interface lets through: bare (Fresnel), with a quarter-wave layer, or with a measured coating.

Nothing is swallowed at an interface, so what is not reflected passes, and light may be followed either way (Stokes):
swapping the two sides changes nothing. `transmittance` is for unpolarised light: the mean of both polarisations.
`polarised` has the complex amplitudes of each, for light that is followed through several surfaces.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.glass import interpolate

Array = NDArray[np.float64]
Amplitude = NDArray[np.float64] | NDArray[np.complex128]


class Interface(NamedTuple):
    """Rays that cross from one medium into another; arrays that broadcast together.

    Attributes
    ----------
    before, after : float or array
        Indices of refraction.
    cosine_before, cosine_after : array
        Of the angles to the normal on both sides, by Snell's law.
    """

    before: ArrayLike
    after: ArrayLike
    cosine_before: ArrayLike = 1.0
    cosine_after: ArrayLike = 1.0

    @property
    def head_on(self) -> Interface:
        """The same two media met at a right angle."""
        return Interface(self.before, self.after)


class Polarised(NamedTuple):
    """What an interface makes of light of both linear polarisations: factors of its amplitude.

    The square of a factor is a share of the light, so those of reflected and passed light add up to 1. With s across
    the plane of incidence, p = direction x s before and behind the interface; complex where a layer or total
    reflection turns the phase, of light whose phase grows with the path.
    """

    reflected_s: Amplitude
    reflected_p: Amplitude
    passed_s: Amplitude
    passed_p: Amplitude


class Coating(Protocol):
    """What lies on a surface."""

    def transmittance(self, interface: Interface, wavelength_nm: ArrayLike) -> Array:
        """Return the share of unpolarised light that passes, at wavelengths [nm]."""

    def polarised(self, interface: Interface, wavelength_nm: float) -> Polarised:
        """Return the amplitudes of both polarisations at a wavelength [nm]; the cosine behind may be imaginary."""


def amplitudes(interface: Interface) -> tuple[Array, Array]:
    """Return the reflected amplitudes of s and p polarised light (Born and Wolf, Principles of Optics, 1.5.2)."""
    n, m, c, d = (np.asarray(value) for value in interface)
    return (n * c - m * d) / (n * c + m * d), (m * c - n * d) / (m * c + n * d)


@dataclass(frozen=True)
class Bare:
    """No coating: Fresnel's equations."""

    def transmittance(self, interface: Interface, wavelength_nm: ArrayLike) -> Array:
        """Return the share of unpolarised light that passes; it depends on the wavelength by the indices alone."""
        s, p = amplitudes(interface)
        return np.asarray(1.0 - (s * s + p * p) / 2 + np.zeros(np.shape(wavelength_nm)))

    def polarised(self, interface: Interface, wavelength_nm: float) -> Polarised:
        """Return the amplitudes of both polarisations; all light is reflected where these are complex."""
        s, p = amplitudes(interface)
        return Polarised(s, p, *(np.sqrt(np.maximum(1.0 - np.abs(r) ** 2, 0.0)) for r in (s, p)))


BARE = Bare()


@dataclass(frozen=True)
class QuarterWave:
    """One layer whose optical thickness is a quarter of a wavelength.

    The film of the textbooks (Born and Wolf, 1.6.4): with the amplitudes r and t at its two faces and the phase
    2 b = 4 pi n d cos(theta) / L, it reflects (r^2 + t^2 + 2 r t cos 2b) / (1 + r^2 t^2 + 2 r t cos 2b).

    Attributes
    ----------
    index : float
        Of the layer, at every wavelength; not below those of both media.
    wavelength_nm : float
        Four times the index times the thickness [nm].
    """

    index: float
    wavelength_nm: float

    def transmittance(self, interface: Interface, wavelength_nm: ArrayLike) -> Array:
        """Return the share of unpolarised light that passes, at wavelengths [nm]."""
        n, m, c, d = (np.asarray(value, dtype=np.float64) for value in interface)
        inside = np.sqrt(np.maximum(1.0 - (n / self.index) ** 2 * (1.0 - c * c), 0.0))
        front, back = amplitudes(Interface(n, self.index, c, inside)), amplitudes(Interface(self.index, m, inside, d))
        turn = np.cos(np.pi * (self.wavelength_nm / np.asarray(wavelength_nm, dtype=np.float64)) * inside)
        passed: Array = np.zeros(())
        for r, t in zip(front, back, strict=True):
            both = r * t
            passed = passed + (1.0 - r * r) * (1.0 - t * t) / (1.0 + both * both + 2.0 * both * turn) / 2
        return passed

    def polarised(self, interface: Interface, wavelength_nm: float) -> Polarised:
        """Return the amplitudes of both polarisations: the sum over all ways within the layer (Airy)."""
        n, m, c, d = (np.asarray(value) for value in interface)
        square = 1.0 - (n / self.index) ** 2 * (1.0 - c * c)
        inside = np.sqrt(square + 0j if np.any(square < 0) else square)
        front, back = amplitudes(Interface(n, self.index, c, inside)), amplitudes(Interface(self.index, m, inside, d))
        half_turn = np.exp(0.5j * np.pi * (self.wavelength_nm / wavelength_nm) * inside)
        reflected, passed = [], []
        for r, t in zip(front, back, strict=True):
            round_trips = 1.0 + r * t * half_turn**2
            reflected.append((r + t * half_turn**2) / round_trips)
            passed.append(np.sqrt((1.0 - r * r) * (1.0 - t * t) + 0j) * half_turn / round_trips)
        return Polarised(*reflected, *passed)


@dataclass(frozen=True)
class MeasuredReflectance:
    """A coating by its reflectance at normal incidence.

    Away from the normal it passes less in the proportion in which the bare surface does:
    T(angle) = (1 - R) F(angle) / F(0), F being Fresnel's transmittance. That keeps the limits (R on the axis, nothing
    at grazing incidence, the same in both directions), but not the shift of a multilayer's colours with the angle.

    Attributes
    ----------
    wavelengths_nm, values : tuple of float
        Reflectance 0 to 1 at rising wavelengths; a single value holds at every wavelength.
    """

    wavelengths_nm: tuple[float, ...]
    values: tuple[float, ...]

    @property
    def range_nm(self) -> tuple[float, float]:
        """Wavelengths that it is known for [nm]."""
        return (self.wavelengths_nm[0], self.wavelengths_nm[-1]) if len(self.values) > 1 else (0.0, np.inf)

    def reflectance(self, wavelength_nm: ArrayLike) -> Array:
        """Return the reflectance at normal incidence at each wavelength [nm]."""
        return interpolate(wavelength_nm, self.wavelengths_nm, self.values, "reflectance of a coating")

    def transmittance(self, interface: Interface, wavelength_nm: ArrayLike) -> Array:
        """Return the share of unpolarised light that passes, at wavelengths [nm]."""
        slanted = BARE.transmittance(interface, wavelength_nm) / BARE.transmittance(interface.head_on, wavelength_nm)
        return (1.0 - self.reflectance(wavelength_nm)) * np.minimum(slanted, 1.0)

    def polarised(self, interface: Interface, wavelength_nm: float) -> Polarised:
        """Return the amplitudes of both polarisations: alike, and in phase with those of the bare surface.

        A measured reflectance says nothing of either.
        """
        bare = amplitudes(interface)
        fresnel = 1.0 - (np.abs(bare[0]) ** 2 + np.abs(bare[1]) ** 2) / 2
        slanted = np.minimum(fresnel / BARE.transmittance(interface.head_on, wavelength_nm), 1.0)
        passed = (1.0 - self.reflectance(wavelength_nm)) * slanted
        phases = [np.where(r == 0, 1.0, r) / np.where(r == 0, 1.0, np.abs(r)) for r in bare]
        back, through = np.sqrt(1.0 - passed), np.sqrt(passed)
        return Polarised(back * phases[0], back * phases[1], through, through)


def constant_reflectance(share: float) -> MeasuredReflectance:
    """Return the coating that reflects a share of the light at normal incidence, at every wavelength."""
    return MeasuredReflectance((0.0,), (share,))


MAGNESIUM_FLUORIDE = QuarterWave(1.38, 550.0)  # Macleod, Thin-Film Optical Filters, 4th ed., table of materials


# Light that several layers on an interface let through and reflect, by their characteristic matrices.

LEAST_COSINE = 1e-9  # in a layer, along which light does not quite travel


@dataclass(frozen=True)
class Layer:
    """One layer.

    Attributes
    ----------
    index : float
        At every wavelength.
    thickness_nm : float
    extinction : float
        k of the index n + i k, at every wavelength: 0 of a layer that absorbs nothing.
    """

    index: float
    thickness_nm: float
    extinction: float = 0.0


@dataclass(frozen=True)
class LayerStack:
    """Layers on one another.

    The tangential fields in front of a layer follow from those behind it by its matrix (Born and Wolf, 1.6.2; Macleod,
    Thin-Film Optical Filters, chapter 2), here of light whose phase grows with the path.

    Attributes
    ----------
    layers : tuple of Layer
        From the medium of the lower index, such as air, to that of the higher. No index is below those of both media,
        but of layers that absorb.
    """

    layers: tuple[Layer, ...]

    @property
    def absorbs(self) -> bool:
        """Whether any layer does."""
        return any(layer.extinction > 0 for layer in self.layers)

    def from_behind(self, before: ArrayLike, after: ArrayLike) -> tuple[Layer, ...]:
        """Return the layers from the far side, seen by light that crosses from one index to another."""
        return self.layers[::-1] if np.all(np.asarray(before) <= np.asarray(after)) else self.layers

    def transmittance(self, interface: Interface, wavelength_nm: ArrayLike) -> Array:
        """Return the share of unpolarised light that passes, at wavelengths [nm]."""
        (_, s), (_, p) = self._amplitudes(interface, np.asarray(wavelength_nm, dtype=np.float64))
        return np.asarray((np.abs(s) ** 2 + np.abs(p) ** 2) / 2)

    def polarised(self, interface: Interface, wavelength_nm: float) -> Polarised:
        """Return the amplitudes of both polarisations."""
        (s, passed_s), (p, passed_p) = self._amplitudes(interface, np.asarray(wavelength_nm))
        return Polarised(s, p, passed_s, passed_p)

    def _amplitudes(
        self, interface: Interface, wavelength_nm: Array
    ) -> tuple[tuple[Amplitude, Amplitude], tuple[Amplitude, Amplitude]]:
        """Return the reflected and the passed amplitude of s and of p polarised light."""
        n, m, c, d = (np.asarray(value) for value in interface)
        layers: list[tuple[Any, Any, Any]] = []
        for layer in self.from_behind(n, m):
            index = complex(layer.index, layer.extinction) if layer.extinction else layer.index
            inside = np.sqrt(1.0 - (n / index) ** 2 * (1.0 - c * c) + 0j)
            inside = np.where(np.abs(inside) < LEAST_COSINE, LEAST_COSINE, inside)
            layers.append((index, inside, 2 * np.pi * index * layer.thickness_nm / wavelength_nm * inside))
        of_s = _through([(f * cosine, phase) for f, cosine, phase in layers], n * c, m * d)
        return of_s, _through([(cosine / f, phase) for f, cosine, phase in layers], c / n, d / m)


MULTILAYER = LayerStack((Layer(1.38, 99.6), Layer(2.1, 131.0), Layer(1.7, 80.9)))  # quarter, half, quarter of 550 nm


def _through(layers: list[tuple[Amplitude, Amplitude]], front: Array, behind: Array) -> tuple[Amplitude, Amplitude]:
    """Return amplitudes from the admittances and phases of layers, from behind, and the admittances of both media.

    What a layer damps is set apart, so that a thick one leaves numbers of the usual size.
    """
    one, other = np.ones((), dtype=np.complex128), np.asarray(behind, dtype=np.complex128)
    left: Amplitude = np.ones(())
    for admittance, phase in layers:
        if np.any(np.imag(phase)):
            depth = np.imag(phase)
            there, back = np.exp(1j * phase - depth), np.exp(-1j * phase - depth)
            left, cosine, sine = left * np.exp(-depth), (there + back) / 2, (back - there) / 2
        else:
            cosine, sine = np.cos(phase), -1j * np.sin(phase)
        one, other = cosine * one + sine / admittance * other, sine * admittance * one + cosine * other
    whole = front * one + other
    return (front * one - other) / whole, 2.0 * left * np.sqrt(front * np.real(behind)) / whole
