"""Wavelengths at which light of ghosts is traced, and what each source gives the film's colours at them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import LensSetting, ghosts_have_colours, usable_nm
from rptcam_cl.colour import WAVELENGTHS_NM
from rptcam_cl.core.kinds import SpectrumKind
from rptcam_cl.plan import Plan, observer
from rptcam_cl.rendering.diffraction_kernel import shares_of_white
from rptcam_cl.rendering.ghost_sources import Sources
from rptcam_cl.scene import Scene

Array = NDArray[np.float64]

WAVES_NM = (425.0, 475.0, 525.0, 575.0, 625.0, 675.0)  # where colours differ


class Band(NamedTuple):
    """A wavelength [nm] that stands for some, and the light of the sources (n, 3) in them [W/m2]."""

    nm: float
    light: Array


def bands(scene: Scene, plan: Plan, setting: LensSetting, sources: Sources) -> list[Band]:
    """Return wavelengths for light given as red, green and blue, and for each spectrum of a lamp its own.

    A film of red, green and blue knows no spectra. Beyond what the lens is known for its last wavelength stands in.
    """
    tinted, numbers = ghosts_have_colours(setting), sources.known[:, 0].astype(int)
    if plan.spectrum.kind == SpectrumKind.RGB:
        numbers = np.zeros_like(numbers)
    waves = WAVES_NM if tinted else (setting.camera.wavelength_nm,)
    shares = shares_of_white(WAVES_NM) if tinted else np.ones((1, 3))
    limits = usable_nm(setting.lens, setting.transmission) if tinted else (0.0, np.inf)

    def known(nm: float) -> float:
        return float(np.clip(nm, *limits))

    plain, found = numbers == 0, []
    if plain.any() or not len(plain):
        light = np.where(plain[:, None], sources.irradiance, 0.0)
        found = [Band(known(nm), light * share) for nm, share in zip(waves, shares, strict=True)]
    matching = observer(scene)[1]
    for number in np.unique(numbers[~plain]):
        times = np.where(numbers == number, sources.known[:, 1], 0.0)[:, None]
        for nm, seen in _of_spectrum(plan.colours[0].samples[number - 1][:, None] * matching, waves):
            found.append(Band(known(nm), times * seen))
    return found


def _of_spectrum(seen: Array, waves: tuple[float, ...]) -> Iterator[tuple[float, Array]]:
    """Yield the middle [nm] of light (401, 3) in each band about some waves, and its sum (3,); none of dark ones."""
    places = np.argmin(np.abs(WAVELENGTHS_NM[:, None] - np.array(waves)), axis=1)
    for place, wave in enumerate(waves):
        own = seen[places == place]
        strength = np.abs(own).sum(axis=1)
        if strength.any():
            middle = float(WAVELENGTHS_NM[places == place] @ strength / strength.sum())
            yield middle if len(waves) > 1 else wave, own.sum(axis=0)
