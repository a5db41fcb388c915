"""How devices share a picture: how large a share each is worth, its tiles, and the record of who took which samples."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.rendering.film import BLOCK, TILE_PIXELS
from rptcam_cl.rendering.tracer import Wavefront

MEASURED_SECONDS = 0.3  # that each device renders before its share is known
STEPS = 1000  # shares are whole numbers of these parts, so that their text repeats them exactly
GOLDEN = (5**0.5 - 1) / 2  # its multiples, less their whole parts, are spread evenly, however many there are

Part = dict[str, Any]
"""``samples``: first and end; ``split``: shares by device, as ``--split`` takes them; ``dropped``: devices and why."""


def owners(tiles: int, shares: Sequence[float]) -> NDArray[np.intp]:
    """Return which device renders each tile: the place of its share among ``shares``.

    Tiles of one device are spread over the picture, so that each has its part of the costly ones. The choice follows
    from the number of a tile and the shares alone.
    """
    places = np.modf((np.arange(tiles) + 0.5) * GOLDEN)[0]
    ends = np.cumsum(np.asarray(shares, np.float64) / np.sum(shares))[:-1]
    return np.asarray(np.searchsorted(ends, places, side="right"), np.intp)


def measured_speed(wavefront: Wavefront) -> float:
    """Return how many samples per second a device renders of tiles all over the picture; its film is empty after."""
    layout = wavefront.layout
    at_once = max(wavefront.capacity // wavefront.samples_per_wave, BLOCK) // TILE_PIXELS
    step = -(-layout.tiles // at_once)
    wavefront.choose_tiles(np.arange(0, layout.tiles, step, dtype=np.uint32))
    samples, first, begun = 0, 0, time.perf_counter()
    while time.perf_counter() - begun < MEASURED_SECONDS or not samples:
        for wave in wavefront.waves(first, wavefront.samples_per_wave):
            wavefront.enqueue(*wave)
            samples += wave[1] * wave[3]
        first += wavefront.samples_per_wave
        wavefront.finish()
    seconds = time.perf_counter() - begun
    wavefront.clear()
    return samples / seconds


def shares_of(speeds: Sequence[float]) -> list[float]:
    """Return shares in proportion to speeds, in thousandths that add up to 1, each at least one."""
    parts = [max(round(STEPS * speed / sum(speeds)), 1) for speed in speeds]
    parts[int(np.argmax(parts))] += STEPS - sum(parts)
    return [part / STEPS for part in parts]


def split_text(shares: Mapping[str, float]) -> str:
    """Return shares by device as ``--split`` takes them."""
    return ",".join(f"{identity}={share:.15g}" for identity, share in shares.items())


def split_of(text: str) -> dict[str, float]:
    """Return shares by device of what `split_text` returned."""
    return {identity: float(share) for identity, _, share in (part.rpartition("=") for part in text.split(","))}


def begun(parts: Sequence[Part], first: int, split: str, dropped: Mapping[str, str] | None = None) -> list[Part]:
    """Return the parts with one more, from sample ``first`` on; what was recorded of later samples gives way."""
    gone: dict[str, str] = {}
    for part in parts:
        if part["samples"][0] >= first:
            gone |= part.get("dropped", {})
    gone |= dropped or {}
    kept = [part for part in parts if part["samples"][0] < first]
    return [*kept, {"samples": [first, first], "split": split} | ({"dropped": gone} if gone else {})]


def ended(parts: Sequence[Part], done: int) -> list[Part]:
    """Return the parts, each ending where the next begins, the last after ``done`` samples."""
    ends = [*(part["samples"][0] for part in parts[1:]), done][: len(parts)]
    found = [part | {"samples": [part["samples"][0], end]} for part, end in zip(parts, ends, strict=True)]
    return [part for part in found if part["samples"][1] > part["samples"][0]]


def joined(earlier: Sequence[Part], later: Sequence[Part]) -> list[Part]:
    """Return the parts of a render before and after it was interrupted; those with the same shares as one."""
    if not earlier or not later or {"dropped"} & (earlier[-1].keys() | later[0].keys()):
        return [*earlier, *later]
    if earlier[-1]["split"] != later[0]["split"]:
        return [*earlier, *later]
    both = later[0] | {"samples": [earlier[-1]["samples"][0], later[0]["samples"][1]]}
    return [*earlier[:-1], both, *later[1:]]


def is_shared(parts: Sequence[Part]) -> bool:
    """Return whether more than one device took part."""
    return (
        any("dropped" in part for part in parts)
        or len({device for part in parts for device in split_of(part["split"])}) > 1
    )
