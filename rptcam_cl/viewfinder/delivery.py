"""From what was rendered to the frames and figures that each client wants of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import luminance
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.base import FLOAT32_MIN_NORMAL
from rptcam_cl.viewfinder import instruments as histogram
from rptcam_cl.viewfinder.instruments import OVERLAYS, OverlayName, magnifier, spot_meter
from rptcam_cl.viewfinder.messages import MEDIA, Client, Codes, FrameData, Magnify, encode, shrink
from rptcam_cl.viewfinder.studio import Shown, Slot

#
# How two settings differ: a map in stops, and numbers.
#
# The number of a comparison is relMSE, the mean over the picture of |b - a|^2 / (|a|^2 + (0.01 mean a)^2) with
# vectors of the three channels, |a|^2 averaged over tiles of 8 x 8 pixels, as `rptcam tradeoff` has it; a is the
# picture, b what it is compared with. The noise of both counts in it.

TILE = 8  # pixels
FLOOR = 0.01  # of the mean: what is darker counts as this dark
RANGE_STOPS = 2.0  # that the map shows in its strongest colours
DARKER, EQUAL, BRIGHTER = (40, 90, 220), (244, 244, 244), (214, 48, 40)


def difference_rgb(stops: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Draw by how much a second film is brighter (h, w) as a picture (h, w, 3): blue where it is darker, else red."""
    share = np.clip(stops / np.float32(RANGE_STOPS), -1, 1)[..., None]
    darker, equal, brighter = (np.array(colour, np.float32) for colour in (DARKER, EQUAL, BRIGHTER))
    ends = np.where(share < 0, darker, brighter)
    return np.asarray(np.floor(equal + np.abs(share) * (ends - equal) + 0.5), np.uint8)


LEGEND = [
    {"stops": -RANGE_STOPS, "colour": DARKER},
    {"stops": 0.0, "colour": EQUAL},
    {"stops": RANGE_STOPS, "colour": BRIGHTER},
]
"""Stops and colours of the map's ends and middle."""


def difference(first: NDArray[np.float32], second: NDArray[np.float32]) -> tuple[NDArray[np.float32], dict[str, float]]:
    """Compare a second film (h, w, 3) with a first of the same size.

    Returns
    -------
    stops : (h, w) float32 array
        How much brighter the second is; negative where it is darker.
    numbers : dict
        ``relmse``; ``mean_stops``, the mean of the absolute values of `stops`; ``bias_stops``, how much brighter the
        second is in the mean; ``worst_stops``, the 99.9th percentile of the absolute values: more than noise of single
        pixels.

    Raises
    ------
    InputError
        They have other sizes.
    """
    if first.shape != second.shape:
        raise InputError(f"compare: the films have other sizes (got {first.shape} and {second.shape})")
    a, b = first.astype(np.float64), second.astype(np.float64)
    mean_square = float(np.sum(np.square(a.mean(axis=(0, 1)))))
    squares = _tile_means(np.sum(np.square(a), axis=2)) + FLOOR**2 * mean_square
    error = np.sum(np.square(b - a), axis=2)
    relmse = float(np.mean(np.divide(error, squares, out=np.zeros_like(error), where=squares > 0)))
    bright_a, bright_b = luminance(a), luminance(b)
    floor = FLOOR * max(float(bright_a.mean()), float(bright_b.mean()), FLOAT32_MIN_NORMAL)
    stops = np.log2(np.maximum(bright_b, floor) / np.maximum(bright_a, floor))
    size = np.abs(stops)
    return stops.astype(np.float32), {
        "relmse": relmse,
        "mean_stops": float(size.mean()),
        "bias_stops": float(np.log2(max(bright_b.mean(), floor) / max(bright_a.mean(), floor))),
        "worst_stops": float(np.percentile(size, 99.9)),
    }


def _tile_means(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values (h, w), each replaced by the mean of its tile; tiles at the right and the bottom may be smaller."""
    starts = [np.arange(0, size, TILE) for size in values.shape]
    sums = np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)
    sizes = [np.diff([*start, size]) for start, size in zip(starts, values.shape, strict=True)]
    means = sums / np.outer(*sizes)
    return np.asarray(means.repeat(sizes[0], axis=0).repeat(sizes[1], axis=1))


COUNT_S = 0.2  # between two histograms of a picture that moves


class Delivery:
    """Makes frames of what slots show; only the engine's thread uses it.

    Parameters
    ----------
    hurries
        Tells whether somebody waits for another picture, so that what goes with one of full scale is left for later.
    """

    def __init__(self, hurries: Callable[[], bool]) -> None:
        self._hurries = hurries
        self._made: dict[str, tuple[int, dict[Any, Any]]] = {}  # by slot: picture, and what was made of it
        self._last_count = 0.0

    def deliver(self, slot: Slot, clients: Iterable[Client]) -> bool:
        """Put what a slot shows into the outboxes of those clients that have not had it and have room; tell if any."""
        shown = slot.shown
        if shown is None:
            return False
        lacking = [each for each in clients if each.shown.get(slot.name, 0) < shown.number and each.outbox.has_room]
        for client in lacking:
            client.shown[slot.name] = shown.number
            settings = client.settings
            key = ("picture", settings.width, settings.height, settings.format, settings.quality)
            size, data = self._make_once(slot, shown, key, lambda: _picture(shown.codes, *key[1:]))  # noqa: B023 -- at once
            header = self._header(slot, shown, client, size) | {"media": MEDIA[settings.format]}
            client.outbox.frame((slot.name, "picture"), (header, data))
        self.cover(slot, clients)
        return bool(lacking)

    def cover(self, slot: Slot, clients: Iterable[Client]) -> None:
        """Send what lies over the picture that clients were sent, or beside it; later, where somebody waits."""
        shown = slot.shown
        if shown is None:
            return
        for client in clients:
            if client.covered.get(slot.name, 0) < shown.number == client.shown.get(slot.name):
                if not self._cover(slot, shown, client):
                    return
                client.covered[slot.name] = shown.number

    def _cover(self, slot: Slot, shown: Shown, client: Client) -> bool:
        """Send all that lies over a picture; False where it was left within it."""
        settings, header = client.settings, self._header(slot, shown, client, (0, 0))
        for name in settings.overlays_on():
            if shown.frame.scale == 1 and self._hurries():
                return False
            level = {"zebra": settings.zebra_level, "peaking": settings.peaking_level}.get(name, 0.0)
            wanted = ("overlay", name, level, settings.width, settings.height)
            size, data = self._make_once(slot, shown, wanted, lambda: _overlay(shown, *wanted[1:]))  # noqa: B023 -- called at once
            client.outbox.frame((slot.name, "overlay", name), _png_frame(header, "overlay", size, data, overlay=name))
        if client.magnifier is not None and client.magnifier.place is not None and shown.frame.scale == 1:
            size, data = _magnify(shown.codes, client.magnifier)
            place = {"x": client.magnifier.x, "y": client.magnifier.y}
            client.outbox.frame((slot.name, "magnifier"), _png_frame(header, "magnifier", size, data, **place))
        return True

    def count(self, slot: Slot, clients: Iterable[Client]) -> None:
        """Tell clients the histograms of the picture that they have been sent, which pages paint first."""
        shown = slot.shown
        if shown is None:
            return
        waiting = [
            client
            for client in clients
            if client.counted.get(slot.name, 0) < shown.number == client.shown.get(slot.name)
            and "histogram" in client.settings.panels
        ]
        if not waiting or not self._may_count(shown):
            return
        counts = self._make_once(slot, shown, ("histogram",), lambda: _counts(slot, shown))
        message = {"type": "histogram", "generation": shown.frame.generation, "slot": slot.name, **counts}
        for client in waiting:
            client.counted[slot.name] = shown.number
            client.outbox.news(("histogram", slot.name), message)

    def _may_count(self, shown: Shown) -> bool:
        """Return whether figures of all pixels are due: of a picture that moves, several times a second."""
        now = time.monotonic()
        if shown.moving and now < self._last_count + COUNT_S:
            return False
        self._last_count = now
        return True

    def meter(self, slot: Slot, client: Client) -> None:
        """Tell a client what lies under its pointer."""
        shown = slot.shown
        if shown is None or shown.stale or client.pointer is None or "meter" not in client.settings.panels:
            return
        reading = spot_meter(shown.frame.pixels, slot.resolved, *client.pointer)
        client.outbox.news("meter", {"type": "meter", "generation": shown.frame.generation, **reading})

    def difference(self, a: Slot, b: Slot, clients: Iterable[Client]) -> None:
        """Send how far two pictures lie apart, to those that have room; pictures of other sizes or samples wait."""
        first, second = a.shown, b.shown
        if first is None or second is None or first.frame.pixels.shape != second.frame.pixels.shape:
            return
        if first.frame.spp != second.frame.spp or first.stale or second.stale:
            return
        number = first.number + second.number
        lacking = [each for each in clients if each.shown.get("difference", 0) < number and each.outbox.has_room]
        if not lacking:
            return
        stops, numbers = difference(first.frame.pixels, second.frame.pixels)
        for client in lacking:
            client.shown["difference"] = number
            size, data = _picture(difference_rgb(stops), client.settings.width, client.settings.height, "png", 100)
            header = self._header(b, second, client, size)
            frame = _png_frame(header, "difference", size, data, numbers=numbers, legend=LEGEND)
            client.outbox.frame("difference", frame)

    def _make_once(self, slot: Slot, shown: Shown, key: Any, make: Any) -> Any:
        """Make something of a picture once, for all clients with the same settings."""
        number, made = self._made.get(slot.name, (0, {}))
        if number != shown.number:
            made = {}
            self._made[slot.name] = shown.number, made
        if key not in made:
            made[key] = make()
        return made[key]

    @staticmethod
    def _header(slot: Slot, shown: Shown, client: Client, size: tuple[int, ...]) -> dict[str, Any]:
        frame = shown.frame
        return {
            "type": "frame",
            "generation": frame.generation,
            "slot": slot.name,
            "kind": "picture",
            "width": size[0],
            "height": size[1],
            "full": list(slot.session.resolution),
            "scale": frame.scale,
            "spp": frame.spp,
            "target_spp": slot.target_spp,
            "ms": round(frame.seconds * 1e3, 2),
            "noise": frame.noise,
            "moving": shown.moving,
            "stale": shown.stale,
            "lacks": list(shown.lacks),
            "denoised": shown.clean is not None,
            "clean_at": slot.clean_at(frame),
            "answers": shown.answers.get(client.number),
        }


def _picture(codes: Codes, width: int, height: int, form: Any, quality: int) -> tuple[tuple[int, int], bytes]:
    small = shrink(codes, width, height)
    return (small.shape[1], small.shape[0]), encode(small, form, quality)


def _png_frame(header: dict[str, Any], kind: str, size: tuple[int, int], data: bytes, **more: Any) -> FrameData:
    own = {"kind": kind, "width": size[0], "height": size[1], "media": MEDIA["png"]}
    return header | own | more, data


def _overlay(shown: Shown, name: OverlayName, level: float, width: int, height: int) -> tuple[tuple[int, int], bytes]:
    return _picture(OVERLAYS[name](shown.pixels, level, shown.frame.noise), width, height, "png", 100)


def _magnify(codes: Codes, wanted: Magnify) -> tuple[tuple[int, int], bytes]:
    assert wanted.x is not None and wanted.y is not None
    crop, _ = magnifier(codes, wanted.x, wanted.y, wanted.width, wanted.height)
    return (crop.shape[1], crop.shape[0]), encode(np.ascontiguousarray(crop), "png", 100)


def _counts(slot: Slot, shown: Shown) -> dict[str, Any]:
    """Return the histograms of a picture; of the sensor's numbers once they are there, and None where there is none."""
    pixels = shown.pixels
    counts = histogram.histogram(shown.codes, pixels).as_dict() | {"stops": histogram.stop_histogram(pixels).as_dict()}
    if shown.raw is not None:
        return counts | {"raw": histogram.raw_histogram(shown.raw).as_dict()}
    return counts | ({"raw": None} if slot.scene.sensor is None else {})
