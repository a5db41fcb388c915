"""Refractive indices of metals and glasses: by pbrt's names, as numbers or as spectra."""

from __future__ import annotations

from typing import Any

import numpy as np

from rptcam_cl.importers.pbrt.colours import samples_of
from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.state import Entity
from rptcam_cl.importers.pbrt.textures import shade, value

# Metals of pbrt that ours have by name.
METALS = {"Au": "gold", "Ag": "silver", "Al": "aluminium", "Cu": "copper"}
# Others. Brass: linear sRGB at normal incidence, as physicallybased.info has it. The oxides are transparent: n at the
# sodium D line from the CRC Handbook of Chemistry and Physics, no k.
OTHER_METALS: dict[str, dict[str, Any]] = {
    "CuZn": {"reflectance": [0.910, 0.778, 0.423]},
    "MgO": {"metal": {"n": [1.736] * 3, "k": [1e-3] * 3}},
    "TiO2": {"metal": {"n": [2.609] * 3, "k": [1e-3] * 3}},
}

# Index at the helium d line (587.6 nm), from the makers' catalogues.
GLASSES = {
    "glass-BK7": 1.5168, "glass-BAF10": 1.6700, "glass-F11": 1.6206, "glass-FK51A": 1.4866, "glass-LASF9": 1.8503,
    "glass-SF5": 1.6727, "glass-F5": 1.6034, "glass-SF10": 1.7283, "glass-SF11": 1.7847,
}  # fmt: skip

# Wavelengths near the middle of red, green and blue [nm], at which spectra of n and k are read.
CHANNELS_NM = np.array([610.0, 550.0, 465.0])
LOWEST, HIGHEST = 1e-3, 100.0


def index_of(context: Context, entity: Entity, name: str = "eta", default: float = 1.5) -> float:
    """Return the refractive index of a transparent material: one number, as ours have no dispersion."""
    parameters = entity.parameters
    for key in (name, "index") if name == "eta" else (name,):
        item = parameters.get(key, "float", "spectrum", "rgb", "color", "texture")
        if item is None:
            continue
        if item.kind == "float":
            index = parameters.number(key, default)
        elif item.kind == "spectrum":
            index = _spectral_index(context, entity, key)
        else:
            index = _mean_index(context, entity, key)
            context.report.approximated(item.place, f'{entity.what}: "{key}" as the number {index:g}')
        if not 0.2 <= index <= 5:
            raise item.place.error(f'{entity.what}: "{key}" must lie between 0.2 and 5 (got {index:g})')
        return index
    return default


def _mean_index(context: Context, entity: Entity, key: str) -> float:
    """Return the mean of an index that is a colour, or a texture (of numbers, or of colours that are cut at 1)."""
    values = entity.parameters.items[key].values
    return float(np.mean(values)) if isinstance(values, np.ndarray) else value(context, entity, key, 1.5)


def _spectral_index(context: Context, entity: Entity, key: str) -> float:
    item = entity.parameters.items[key]
    name = str(item.values[0]) if len(item.values) == 1 else ""
    if name in GLASSES:
        index = GLASSES[name]
    else:
        index = float(np.interp(589.0, *_sorted(samples_of(context, item))))
    context.report.approximated(item.place, f'{entity.what}: "{key}" without dispersion, {index:g} at all wavelengths')
    return index


def metal_keys(context: Context, entity: Entity, prefix: str = "") -> dict[str, Any]:
    """Return what a metal reflects, as keys of a conductor: by name, by n and k, or by a colour."""
    parameters = entity.parameters
    if parameters.has(f"{prefix}reflectance"):
        return {"reflectance": shade(context, entity, f"{prefix}reflectance", 1.0).keys()}
    names = [_name(entity, f"{prefix}{key}") for key in ("eta", "k")]
    metals = {name.removeprefix("metal-").removesuffix(f"-{key}") for name, key in zip(names, ("eta", "k"), strict=True)
              if name}  # fmt: skip
    if len(metals) == 1 and all(name.startswith("metal-") or not name for name in names):
        (metal,) = metals
        if metal in METALS:
            parameters.skip(f"{prefix}eta", f"{prefix}k")
            return {"metal": METALS[metal]}
        if metal in OTHER_METALS:
            parameters.skip(f"{prefix}eta", f"{prefix}k")
            context.report.approximated(entity.place, f"{entity.what}: {metal} by constants in three channels")
            return dict(OTHER_METALS[metal])
    if not parameters.has(f"{prefix}eta") and not parameters.has(f"{prefix}k"):
        return {"metal": "copper"}
    n, k = (_channels(context, entity, f"{prefix}{key}", default) for key, default in (("eta", 0.2), ("k", 3.9)))
    return {"metal": {"n": n, "k": k}}


def _name(entity: Entity, key: str) -> str:
    item = entity.parameters.items.get(key)
    if item is None or item.kind != "spectrum" or isinstance(item.values, np.ndarray) or len(item.values) != 1:
        return ""
    return str(item.values[0])


def _channels(context: Context, entity: Entity, key: str, default: float) -> list[float]:
    """Return n or k in red, green and blue."""
    item = entity.parameters.get(key, "spectrum", "rgb", "color", "float")
    if item is None:
        values = np.full(3, default)
    elif item.kind == "spectrum":
        values = np.interp(CHANNELS_NM, *_sorted(samples_of(context, item)))
    else:
        values = np.broadcast_to(np.asarray(item.values, np.float64), (3,))
    return np.clip(values, LOWEST, HIGHEST).tolist()  # type: ignore[no-any-return]


def _sorted(samples: tuple[Any, Any]) -> tuple[Any, Any]:
    order = np.argsort(samples[0], kind="stable")
    return samples[0][order], samples[1][order]
