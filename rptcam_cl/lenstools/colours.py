"""Colours of drawings and charts: ink, series of curves, wavelengths and glass, as ``#rrggbb``."""

from __future__ import annotations

import numpy as np

INK, FAINT, GRID, PAPER = "#222222", "#777777", "#dddddd", "#ffffff"
SERIES = ("#1f5fb4", "#c8501e", "#2a8a3c", "#8a3ca0", "#a08214", "#1e9696", "#505050")

# Wavelength [nm] and colour between which others are interpolated: hues as seen, darkened to be read on white paper.
_SPECTRUM = (
    (380.0, (90, 20, 130)),
    (440.0, (40, 40, 200)),
    (490.0, (0, 130, 190)),
    (530.0, (30, 140, 40)),
    (580.0, (190, 150, 0)),
    (620.0, (220, 90, 0)),
    (660.0, (200, 20, 20)),
    (750.0, (110, 0, 0)),
)


def wavelength_colour(wavelength_nm: float) -> str:
    """Return a colour by which wavelengths differ."""
    places = [place for place, _ in _SPECTRUM]
    channels = [np.interp(wavelength_nm, places, [colour[i] for _, colour in _SPECTRUM]) for i in range(3)]
    return "#" + "".join(f"{round(float(channel)):02x}" for channel in channels)


def glass_colour(index: float) -> str:
    """Return a tint of blue, darker for a higher index."""
    share = min(max((index - 1.3) / 0.7, 0.0), 1.0)
    light, dark = np.array([228, 240, 250]), np.array([168, 200, 226])
    return "#" + "".join(f"{round(float(channel)):02x}" for channel in light + share * (dark - light))
