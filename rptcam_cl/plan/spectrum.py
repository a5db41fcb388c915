"""What the numbers of a path's light are, and which wavelengths paths have."""

from __future__ import annotations

from dataclasses import field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import CameraModel
from rptcam_cl.colour import LUMINANCE, WAVELENGTHS_NM, cie_1931, daylight_65, response_curves, rgb_basis, srgb_from_xyz
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.kinds import SpectrumKind
from rptcam_cl.plan.materials import Materials
from rptcam_cl.plan.optical_constants import KnownSpectra
from rptcam_cl.scene import Scene

Array = NDArray[np.float64]

WAVELENGTH_CELLS = 528  # a multiple of 3, for three wavelengths per path
GREEN_NM = 550.0
WHITE_ON_AXIS = ("relative", "auto")  # exposures that divide out what the lens leaves of white

AxialColour = tuple[Array, Array] | None


@dataclass(frozen=True)
class Spectrum:
    """The kind of light that paths carry.

    Attributes
    ----------
    kind : SpectrumKind
    table : float32 array
        Wavelengths and what they weigh, as ``kernels/common/wavelength.h`` reads them; a single 0 for RGB.
    facts : dict
        Facts for the compilation.
    metadata : dict
        What the picture's metadata should say.
    """

    kind: SpectrumKind
    table: NDArray[np.float32]
    facts: dict[str, int]
    metadata: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, kind: SpectrumKind, table: NDArray[np.float32], **facts: int) -> Spectrum:
        """Return the light of a kind; facts that are not given are 0."""
        absent = {"WAVELENGTH_CELLS": 0, "SPECTRAL_COLOURS": 0, "HAS_SPECTRA": 0, "LENS_SPLITS": 0, "HAS_DISPERSION": 0}
        cells = {"WAVELENGTH_CELLS": WAVELENGTH_CELLS} if kind else {}
        return cls(kind, table, absent | cells | facts | {"SPECTRUM": int(kind)})


def primary_spectra() -> Array:
    """Return how red, green and blue light is spread over `WAVELENGTHS_NM`, shape (401, 3), each of sum 1.

    White light of D65 as the sRGB primaries' matching functions (CIE 1931) see it, their negative parts left out: none
    of red, green and blue can be less than nothing. Each channel then is light of its own, and white a mixture of all.
    """
    matching = cie_1931() @ srgb_from_xyz().T * daylight_65()[:, None]
    spread = np.maximum(matching, 0.0)
    return np.asarray(spread / spread.sum(axis=0))


def wavelength_table(spectra: Array, density: Array, low_nm: float, high_nm: float) -> NDArray[np.float32]:
    """Return `WAVELENGTH_CELLS` equally likely cells as rows: wavelength where it starts, weights of red, green, blue.

    Parameters
    ----------
    spectra : (401, 3) array
        What light of each wavelength of `WAVELENGTHS_NM` adds to the channels.
    density : (401,) array
        How likely each wavelength is to be chosen; above 0 wherever a spectrum is.
    low_nm, high_nm
        Wavelengths that paths may have [nm]; the spectra are cut there and keep their sums.
    """
    grid = np.concatenate([[low_nm], WAVELENGTHS_NM[(low_nm < WAVELENGTHS_NM) & (high_nm > WAVELENGTHS_NM)], [high_nm]])
    columns = np.stack([np.interp(grid, WAVELENGTHS_NM, values) for values in (*spectra.T, density)])
    pieces = (columns[:, 1:] + columns[:, :-1]) / 2 * np.diff(grid)
    sums = np.concatenate([np.zeros((4, 1)), np.cumsum(pieces, axis=1)], axis=1)
    sums *= np.append(spectra.sum(axis=0), 1.0)[:, None] / sums[:, -1:]
    starts = np.interp(np.arange(WAVELENGTH_CELLS + 1) / WAVELENGTH_CELLS, sums[3], grid)
    shares = np.array([np.interp(starts, grid, row) for row in sums[:3]])
    weights = np.append(np.diff(shares, axis=1) * WAVELENGTH_CELLS, np.zeros((3, 1)), axis=1)
    return np.concatenate([starts[None], weights]).T.astype(np.float32)


def seen_by(scene: Scene, camera: CameraModel, spectra: KnownSpectra, materials: Materials) -> Spectrum:
    """Return the kind of light of the paths that a camera sees: as requested, or as needed.

    A mode that nothing in the scene calls for is not compiled: without dispersion, `dispersive` is RGB.
    """
    settings = scene.spectrum
    lens = camera.bends_colours
    low, high = camera.usable_nm
    if low >= GREEN_NM or high <= GREEN_NM:
        raise InputError(
            f"spectrum: the glasses of the lens are not all known for green light ({low:g} to {high:g} nm)"
        )
    axial = camera.axial_colour if scene.exposure.mode in WHITE_ON_AXIS else None
    glass = materials.facts["HAS_DISPERSION"] > 0
    metadata = {}
    if settings.mode == "spectral" or (settings.mode == "auto" and spectra.colours > 0):
        metadata["observer"], matching = observer(scene)
        spectrum = _spectral(matching, axial, spectra, (low, high), lens=lens)
    elif settings.mode != "rgb" and (lens or glass):
        spectrum = _dispersive(axial, (low, high), lens=lens)
    else:
        spectrum = Spectrum.of(SpectrumKind.RGB, np.zeros(1, np.float32))
    metadata |= {"spectrum": spectrum.kind.name.lower(), "spectrum_requested": settings.mode}
    facts = spectrum.facts | {"HAS_DISPERSION": int(glass and spectrum.kind != SpectrumKind.RGB)}
    return replace(spectrum, facts=facts, metadata=metadata)


def _dispersive(axial: AxialColour, range_nm: tuple[float, float], *, lens: bool) -> Spectrum:
    """Return the spectrum of RGB light whose paths have a wavelength each."""
    spectra = primary_spectra()
    table = wavelength_table(spectra, least_noise(spectra), *range_nm)
    table[:, 1:] /= _left_of_white(table, np.ones(WAVELENGTH_CELLS), axial)
    return Spectrum.of(SpectrumKind.DISPERSIVE, table.ravel(), LENS_SPLITS=int(lens))


def least_noise(spectra: Array) -> Array:
    """Return the density of wavelengths with which light of these spectra (401, 3) has the least noise in grey.

    The variances of its luminance and of the differences of red and of blue to it count alike; their sum is least where
    the density goes with the root of the sum of their squares.
    """
    bright = spectra @ LUMINANCE
    return np.asarray(np.sqrt(bright**2 + (spectra[:, 0] - bright) ** 2 + (spectra[:, 2] - bright) ** 2))


def observer(scene: Scene) -> tuple[str, Array]:
    """Return who sees, the scene's sensor or the eye, and the weights (401, 3) that make linear sRGB of spectra."""
    if scene.sensor is not None and scene.sensor.response is not None:
        return scene.sensor.response, response_curves(scene.sensor.response)
    return "cie_1931", cie_1931() @ srgb_from_xyz().T


def _spectral(
    matching: Array, axial: AxialColour, spectra: KnownSpectra, range_nm: tuple[float, float], *, lens: bool
) -> Spectrum:
    """Return the spectrum of light at three wavelengths per path, which ``matching`` (401, 3) makes linear sRGB of.

    The weights of cells are corrected, by about one part in a thousand, so that the primaries that colours are made of
    come out exactly.
    """
    table = wavelength_table(matching, _density(matching, spectra.lights), *range_nm)
    edges = table[:, 0].astype(np.float64)
    colours = np.concatenate([rgb_basis().T, daylight_65()[None]])
    colours = cell_means(colours, edges)
    seen = table[:-1, 1:].T.astype(np.float64) @ (colours[:3] * colours[3]).T / WAVELENGTH_CELLS
    table[:, 1:] = table[:, 1:] @ np.linalg.inv(seen).T
    table[:, 1:] /= _left_of_white(table, colours[3], axial)
    known = cell_means(np.array(spectra.samples), edges) if spectra.samples else np.zeros((0, WAVELENGTH_CELLS))
    parts = np.concatenate([part.ravel() for part in (table, colours.T, known)]).astype(np.float32)
    return Spectrum.of(
        SpectrumKind.SPECTRAL, parts, SPECTRAL_COLOURS=1, HAS_SPECTRA=int(len(known) > 0), LENS_SPLITS=int(lens)
    )


def _density(matching: Array, lights: list[Array]) -> Array:
    """Return how likely wavelengths are: as daylight is seen, and half of them as the lights of known spectra are."""
    sees = np.abs(matching).mean(axis=1)
    found = sees * daylight_65()
    density = found / found.sum()
    shining = [light for light in lights if (light * sees).sum() > 0]
    if shining:
        density = (density + np.mean([light * sees / (light * sees).sum() for light in shining], axis=0)) / 2
    return np.asarray(density)


def cell_means(spectra: Array, edges_nm: Array) -> Array:
    """Return means (n, cells) of spectra (n, 401), linear between `WAVELENGTHS_NM`, over cells of wavelength."""
    grid = np.union1d(WAVELENGTHS_NM, edges_nm)
    values = np.array([np.interp(grid, WAVELENGTHS_NM, row) for row in spectra])
    pieces = (values[:, 1:] + values[:, :-1]) / 2 * np.diff(grid)
    sums = np.concatenate([np.zeros((len(values), 1)), np.cumsum(pieces, axis=1)], axis=1)
    places = np.searchsorted(grid, edges_nm)
    widths = np.diff(edges_nm)
    return np.asarray(np.diff(sums[:, places], axis=1) / np.where(widths > 0, widths, 1.0))


def _left_of_white(table: NDArray[np.float32], white: Array, axial: AxialColour) -> Array:
    """Return what a lens leaves of white on its axis, as a factor on each channel; 1s where the exposure shows it."""
    if axial is None:
        return np.ones(3)
    middles = (table[:-1, 0] + table[1:, 0]) / 2
    seen = np.interp(middles, *axial)
    weights = table[:-1, 1:].astype(np.float64) * white[:, None]
    return np.asarray((weights * seen[:, None]).mean(axis=0) / weights.mean(axis=0))
