"""The exposure meter: luminance from the film, as the metering of `exposure: auto` sees it.

The film knows no saturation, so that one picture, however exposed, tells the luminance of everything in it: its values
over what radiance 1 gives. A reading in EV is that of a reflected-light meter at ISO 100, 2^EV = L S / K with K = 12.5
(ISO 2720).
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import values_per_irradiance
from rptcam_cl.colour import LUMENS_PER_WATT, LUMINANCE, luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering import SPOT_AREA, metering_weights, window
from rptcam_cl.scene import Exposure, Scene
from rptcam_cl.viewfinder.histogram import MIDDLE_GREY
from rptcam_cl.viewfinder.light import irradiance_per_radiance, value_per_radiance
from rptcam_cl.viewfinder.overlays import FALSE_COLOUR

METER_CONSTANT = 12.5  # K [cd s/m²], ISO 2720

Film = NDArray[np.float32]


def film_reading(pixels: Film, resolved: Scene, settings: Exposure | None = None) -> float | None:
    """Return the mean luminance [cd/m²] of the metered part of the frame, as `exposure: auto` would find it.

    None where there is no light to go by.

    Parameters
    ----------
    pixels
        The film (h, w, 3) of the whole frame, or of its crop, at any resolution.
    resolved
        The scene that it was rendered from, with its exposure resolved.
    settings
        Whose metering counts; by default that of the scene. With a crop, what is left of the metered part counts.
    """
    counts = _shares(pixels, resolved, settings or resolved.exposure)
    if not counts.any():
        return None
    value = float(np.sum(luminance(pixels) * counts) / counts.sum())
    return value / value_per_radiance(resolved) * LUMENS_PER_WATT if value > 0 else None


def _shares(pixels: Film, scene: Scene, settings: Exposure) -> NDArray[np.float64]:
    """Return how much each pixel (h, w) counts."""
    rows, columns = pixels.shape[:2]
    film = scene.film
    if film.crop is None:
        return metering_weights(settings, film.model_copy(update=film.whole_in((columns, rows))))
    left, top, width, height = window(scene)
    whole = metering_weights(settings, film.model_copy(update={"crop": None}))
    part = whole[top : top + height, left : left + width]
    return part[np.ix_(_places(rows, height), _places(columns, width))]


def _places(count: int, size: int) -> NDArray[np.intp]:
    """Return the places of `count` samples spread evenly over `size` pixels."""
    return ((np.arange(count) + 0.5) * size / count).astype(np.intp)


@dataclass(frozen=True)
class SpotReading:
    """What a spot meter shows.

    Attributes
    ----------
    x, y : float
        Middle of the spot, in fractions of the picture from its left and top.
    cd_m2 : float
        Luminance.
    ev : float or None
        At ISO 100; None where there is no light.
    value : float
        Luminance of the film, 1 being white.
    stops : float or None
        From middle grey, 0.18 on the film.
    zone : str
        In the scale of false colour.
    rgb : tuple of float
        Film values.
    time_s : float or None
        Exposure time that would bring the spot to middle grey at the f-number and ISO set; None without a film.
    """

    x: float
    y: float
    cd_m2: float
    ev: float | None
    value: float
    stops: float | None
    zone: str
    rgb: tuple[float, float, float]
    time_s: float | None

    def as_dict(self) -> dict[str, Any]:
        """Return the reading as plain values."""
        return asdict(self)


def spot_meter(pixels: Film, resolved: Scene, x: float, y: float, area: float = SPOT_AREA) -> SpotReading:
    """Return what a spot of the film shows.

    Parameters
    ----------
    pixels, resolved
        As for `film_reading`, the whole frame.
    x, y
        Middle of the spot, in fractions of the picture from its left and top.
    area
        Of the spot as a share of the frame; by default that of `metering: spot`. The nearest pixel always counts.
    """
    inside = _disk(pixels, resolved, x, y, area)
    red, green, blue = (float(channel) for channel in pixels[inside].mean(axis=0, dtype=np.float64))
    value = float(np.dot((red, green, blue), LUMINANCE))
    cd_m2 = value / value_per_radiance(resolved) * LUMENS_PER_WATT
    stops = math.log2(value / MIDDLE_GREY) if value > 0 else None
    return SpotReading(
        x=x,
        y=y,
        cd_m2=cd_m2,
        ev=ev100(cd_m2) if cd_m2 > 0 else None,
        value=value,
        stops=stops,
        zone=next(band.name for band in FALSE_COLOUR if band.high_ev is None or (stops or -99.0) < band.high_ev),
        rgb=(red, green, blue),
        time_s=_time_for(resolved, cd_m2),
    )


def ev100(cd_m2: float) -> float:
    """Return the exposure value at ISO 100 of a luminance [cd/m²]."""
    return math.log2(cd_m2 * 100.0 / METER_CONSTANT)


def _disk(pixels: Film, scene: Scene, x: float, y: float, area: float) -> NDArray[np.bool_]:
    """Return the pixels (h, w) in a disk of a share of the frame, at least the nearest."""
    rows, columns = pixels.shape[:2]
    width, height = scene.film.size_m()
    across = (np.arange(columns) + 0.5) / columns * width - x * width
    down = (np.arange(rows) + 0.5) / rows * height - y * height
    square = across[None, :] ** 2 + down[:, None] ** 2
    return np.asarray(square <= max(area * width * height / math.pi, float(square.min())))


def _time_for(scene: Scene, cd_m2: float) -> float | None:
    """Return the exposure time [s] that brings a luminance to middle grey; None without light or film."""
    light = irradiance_per_radiance(scene)
    if light is None or cd_m2 <= 0:
        return None
    irradiance = cd_m2 / LUMENS_PER_WATT * light * 2.0**-scene.exposure.neutral_density_stops
    return float(MIDDLE_GREY / irradiance / values_per_irradiance(1.0, scene.exposure.iso))
