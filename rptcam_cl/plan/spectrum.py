"""What the numbers of a path's light are, and which wavelengths paths have."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import CameraModel, LensColour, camera_model
from rptcam_cl.kinds import SpectrumKind
from rptcam_cl.scene.scene import Scene
from rptcam_cl.spectra import WAVELENGTHS_NM, cie_1931, daylight_65, srgb_from_xyz

Array = NDArray[np.float64]

HUE_CELLS = 512


@dataclass(frozen=True)
class Spectrum:
    """The kind of light that paths carry.

    Attributes
    ----------
    kind : SpectrumKind
    table : float32 array
        Wavelengths and what they weigh, as ``kernels/common/wavelength.h`` reads them; a single 0 for RGB.
    metadata : dict
        What the picture's metadata should say.
    """

    kind: SpectrumKind
    table: NDArray[np.float32] = field(default_factory=lambda: np.zeros(1, np.float32))
    metadata: dict[str, Any] = field(default_factory=dict)

    @property
    def facts(self) -> dict[str, int]:
        """Facts for the compilation."""
        return {"SPECTRUM": int(self.kind)} | ({"HUE_CELLS": HUE_CELLS} if self.kind else {})


def primary_spectra() -> Array:
    """Return how red, green and blue light is spread over `WAVELENGTHS_NM`, shape (401, 3), each of sum 1.

    White light of D65 as the sRGB primaries' matching functions (CIE 1931) see it, their negative parts left out: none
    of red, green and blue can be less than nothing. Each channel then is light of its own, and white a mixture of all.
    """
    matching = cie_1931() @ srgb_from_xyz().T * daylight_65()[:, None]
    spread = np.maximum(matching, 0.0)
    return np.asarray(spread / spread.sum(axis=0))


def hue_table(spectra: Array, density: Array, low_nm: float, high_nm: float) -> NDArray[np.float32]:
    """Return rows (wavelength where the cell starts, weights of red, green, blue): `HUE_CELLS` equally likely cells.

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
    starts = np.interp(np.arange(HUE_CELLS + 1) / HUE_CELLS, sums[3], grid)
    shares = np.array([np.interp(starts, grid, row) for row in sums[:3]])
    weights = np.append(np.diff(shares, axis=1) * HUE_CELLS, np.zeros((3, 1)), axis=1)
    return np.concatenate([starts[None], weights]).T.astype(np.float32)


def seen_by(scene: Scene) -> tuple[CameraModel, Spectrum]:
    """Return the camera of a scene and the kind of light that its paths carry: what was asked for, or what is needed.

    A mode that nothing in the scene calls for is not compiled: without dispersion, `dispersive` is RGB.
    """
    mode = scene.spectrum.mode
    lens_colour: LensColour = "off" if mode == "rgb" else "auto" if mode == "auto" else "on"
    camera = camera_model(scene, lens_colour)
    disperses = camera.facts.get("LENS_DISPERSION", 0) > 0
    spectrum = dispersive(camera) if disperses else Spectrum(SpectrumKind.RGB)
    told = {"spectrum": spectrum.kind.name.lower(), "spectrum_mode": mode}
    return camera, replace(spectrum, metadata=told)


def dispersive(camera: CameraModel) -> Spectrum:
    """Return the spectrum of RGB light whose paths have a wavelength each."""
    spectra = primary_spectra()
    table = hue_table(spectra, spectra.mean(axis=1), *camera.usable_nm)
    table[:, 1:] /= balance(table, camera)
    return Spectrum(SpectrumKind.DISPERSIVE, table)


def balance(table: NDArray[np.float32], camera: CameraModel) -> Array:
    """Return what a lens leaves of white on its axis, as a factor on each channel; 1s where the exposure shows it."""
    if camera.axial_colour is None:
        return np.ones(3)
    middles = (table[:-1, 0] + table[1:, 0]) / 2
    seen = np.interp(middles, *camera.axial_colour)
    weights = table[:-1, 1:].astype(np.float64)
    return np.asarray((weights * seen[:, None]).mean(axis=0) / weights.mean(axis=0))
