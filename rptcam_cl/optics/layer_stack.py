"""Light that several layers on an interface let through and reflect, by their characteristic matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.coating import Amplitude, Interface, Polarised

Array = NDArray[np.float64]

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

    @property
    def complex_index(self) -> complex:
        """The index with its extinction."""
        return complex(self.index, self.extinction)


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
        """Return what is reflected and what passes of s and of p polarised light."""
        n, m, c, d = (np.asarray(value) for value in interface)
        layers: list[tuple[Any, Any, Any]] = []
        for layer in self.from_behind(n, m):
            index: complex | float = layer.complex_index if layer.extinction else layer.index
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
