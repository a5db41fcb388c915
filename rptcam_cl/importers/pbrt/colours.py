"""Colours of parameters: reflectances, lights and indices, whichever way pbrt lets them be written."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.parameters import Parameter
from rptcam_cl.importers.pbrt.source import read_limited
from rptcam_cl.importers.pbrt.spectra import (
    ILLUMINANTS,
    SRGB_FROM_XYZ,
    black_body_srgb,
    illuminant_srgb,
    light_srgb,
    reflectance_srgb,
    srgb_from,
)
from rptcam_cl.importers.pbrt.state import Entity

Array = NDArray[np.float64]
COLOURS = ("rgb", "color", "xyz", "spectrum", "blackbody", "float")
LARGEST_SPECTRUM = 10_000_000


def reflectance(context: Context, entity: Entity, name: str, default: float | Array) -> Array:
    """Return a reflectance or another share, linear sRGB from 0 to 1."""
    item = entity.parameters.get(name, *COLOURS)
    if item is None:
        return np.broadcast_to(np.asarray(default, np.float64), (3,)).copy()
    if item.kind == "spectrum":
        wavelengths, values = samples_of(context, item)
        colour = reflectance_srgb(wavelengths, values)
    else:
        colour = _plain(item, entity)
    if colour.min() < 0 or colour.max() > 1:
        context.report.approximated(item.place, f'{entity.what}: "{name}" is cut to 0 … 1')
    return np.clip(colour, 0, 1)


def light(context: Context, entity: Entity, name: str) -> Array:
    """Return the colour of a light, linear sRGB from 0 up; 1 when the parameter is absent.

    pbrt-v4 scales every light to luminance 1 whose colour is a spectrum; one given as ``rgb`` it takes as it is.
    """
    item = entity.parameters.get(name, *COLOURS)
    if item is None:
        return np.ones(3)
    luminance = 1.0 if context.scene.version == 4 else None
    values = item.values
    if item.kind == "blackbody" and isinstance(values, np.ndarray):
        if len(values) > 2 or not len(values) or not values[0] > 0:
            raise item.place.error(f'{entity.what}: "{name}" needs a temperature above 0 [K] (got {_shown(values)})')
        scale = float(values[1]) if len(values) == 2 else 1.0
        colour = scale * black_body_srgb(float(values[0]), luminance=luminance)
    elif item.kind == "spectrum" and len(values) == 1 and str(values[0]) in ILLUMINANTS:
        colour = illuminant_srgb(str(values[0]))
    elif item.kind == "spectrum":
        colour = light_srgb(*samples_of(context, item), luminance=luminance)
    else:
        colour = _plain(item, entity)
    if colour.min() < 0:
        context.report.approximated(item.place, f'{entity.what}: "{name}" lies outside sRGB; cut at 0')
    return np.maximum(colour, 0)


def scale_factor(context: Context, entity: Entity, name: str = "scale") -> Array:
    """Return the factor on a light: a number in pbrt-v4, a colour in pbrt-v3."""
    item = entity.parameters.get(name, *COLOURS)
    if item is None:
        return np.ones(3)
    if item.kind == "spectrum":
        return np.maximum(reflectance_srgb(*samples_of(context, item)), 0)
    return np.maximum(_plain(item, entity), 0)


def samples_of(context: Context, item: Parameter) -> tuple[Array, Array]:
    """Return wavelengths [nm] and values of a spectrum: of pairs, of a file of pairs, or a single number."""
    if isinstance(item.values, np.ndarray):
        return _pairs(np.asarray(item.values, np.float64), item)
    (name, *others) = (str(value) for value in item.values)
    if others:
        raise item.place.error(f'"{item.name}" needs one spectrum (got {1 + len(others)})')
    text = read_limited(context.find(name, item.place), name, LARGEST_SPECTRUM).decode("latin-1")
    words = [word for line in text.splitlines() for word in line.split("#", 1)[0].replace(",", " ").split()]
    try:
        numbers = np.array(words, np.float64)
    except ValueError:
        raise item.place.error(f"{name}: must hold pairs of a wavelength [nm] and a value") from None
    return _pairs(numbers, item)


def _pairs(numbers: Array, item: Parameter) -> tuple[Array, Array]:
    if len(numbers) == 1:
        return np.array([500.0]), numbers
    if len(numbers) % 2 or not len(numbers) or not np.isfinite(numbers).all():
        raise item.place.error(
            f'"{item.name}" needs pairs of a wavelength [nm] and a value (got {len(numbers)} numbers)'
        )
    return numbers[::2], numbers[1::2]


def _plain(item: Parameter, entity: Entity) -> Array:
    """Return the colour of rgb, xyz or a single number."""
    if item.kind == "blackbody" or not isinstance(item.values, np.ndarray):
        raise item.place.error(f'{entity.what}: "{item.name}" cannot be a {item.kind}')
    values = item.values
    if item.kind == "float" and len(values) == 1:
        return np.full(3, float(values[0]))
    if len(values) != 3:
        raise item.place.error(f'{entity.what}: "{item.name}" needs 3 numbers (got {len(values)})')
    if item.kind == "xyz":
        return np.asarray(SRGB_FROM_XYZ @ values)
    return srgb_from(entity.color_space, values)


def _shown(values: Array) -> str:
    return " ".join(f"{value:g}" for value in values) or "nothing"
