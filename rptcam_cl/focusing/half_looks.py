"""Looks through the two halves of the pupil, with the renderer as a focus probe."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import Split, halved
from rptcam_cl.focusing.phase_match import STEP, HalfView, Halves, places_round
from rptcam_cl.focusing.probe import Zone, ZoneImage
from rptcam_cl.focusing.renderer import ProbeRenderer

MARGIN_STEP = 8  # margins are multiples of so many pixels, so that looks can share their buffers


@dataclass(frozen=True)
class HalfProbe:
    """A look at a zone through the two halves of the pupil.

    Attributes
    ----------
    state, stop : float
        As in `FocusProbe.measure`.
    view : HalfView
        What the halves do to the picture of a plane at any distance.
    halves : Halves
        The pictures.
    samples : int
        Camera rays of all pixels; half of them begin a path.
    seconds : float
    """

    state: float
    stop: float
    view: HalfView
    halves: Halves
    samples: int
    seconds: float


def half_view(probe: ProbeRenderer, state: float, zone: Zone, split: Split, stop: float = 1.0) -> HalfView:
    """Return the halves of the pupil that the middle of a zone sees in a focus state."""
    probe.look_at([zone])
    across, down = zone.centre
    width, height = probe.film.resolution
    middle = min(max(across * width, STEP), width - STEP), min(max(down * height, STEP), height - STEP)
    return HalfView.of(probe.rays(state, places_round(middle), stop), split)


def measure_halves(
    probe: ProbeRenderer, state: float, zones: Sequence[Zone], samples: int, seed: int, split: Split = "x"
) -> list[tuple[ZoneImage, ZoneImage]]:
    """Return what zones show through the left and the right half of the pupil, or the lower and the upper one.

    The parameters are those of `FocusProbe.measure`. Halves are of equal light in the middle of each zone, and of
    independent noise.
    """
    return [_through(probe, half_view(probe, state, zone, split), state, zone, samples, seed, 1.0) for zone in zones]


def half_probe(
    probe: ProbeRenderer,
    view: HalfView,
    state: float,
    zone: Zone,
    samples: int,
    seed: int,
    stop: float = 1.0,
    margin: tuple[int, int] = (0, 0),
) -> HalfProbe:
    """Return a look through halves.

    Parameters
    ----------
    samples
        Per pixel of both halves together.
    margin
        Pixels across and down to see beyond the zone, at least.
    """
    begun = time.perf_counter()
    across, down = (-(-pixels // MARGIN_STEP) * MARGIN_STEP for pixels in margin)
    probe.look_at([zone], (across, down))
    images = _through(probe, view, state, zone, samples, seed, stop)
    pictures: list[NDArray[np.float64]] = [image.luminance.mean(axis=0) for image in images]
    light = [float(picture.mean()) for picture in pictures]
    halves = Halves(
        np.stack([picture / (mean or 1.0) for picture, mean in zip(pictures, light, strict=True)]),
        np.array([image.variance.mean() / (mean or 1.0) ** 2 for image, mean in zip(images, light, strict=True)]),
        probe.margins(zone),
    )
    taken = 2 * images[0].samples * pictures[0].size
    return HalfProbe(state, stop, view, halves, taken, time.perf_counter() - begun)


def _through(
    probe: ProbeRenderer, view: HalfView, state: float, zone: Zone, samples: int, seed: int, stop: float
) -> tuple[ZoneImage, ZoneImage]:
    """Return what a zone shows through the half before the line and that beyond it.

    With the same random numbers the noise of the halves would be each other's negative: hence two seeds.
    """
    camera = probe.camera(state, stop)
    before, beyond = (
        probe.render(halved(camera, view.line, beyond=half), samples, 2 * seed + half)[0] for half in (False, True)
    )
    return before, beyond
