"""Materials of pbrt-v4 and pbrt-v3 as materials of ours, one function a kind."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import luminance, srgb_from_reflectance
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.conversion import COAT_INDEX, nested
from rptcam_cl.exchange.pbrt import textures
from rptcam_cl.exchange.pbrt.world import Context, Entity, MaterialName
from rptcam_cl.rendering.plan.textures import metal_spectra
from rptcam_cl.rendering.plan.textures import reflectance as metal_reflectance
from rptcam_cl.scene import media
from rptcam_cl.scene.assets.measured import read_measured
from rptcam_cl.scene.materials import LARGEST_INDEX, LEAST_BEND, SMALLEST_INDEX
from rptcam_cl.scene.textures import MOST_NESTED

# Materials of ours as plain keys, and pbrt's roughness as GGX's alpha.

Keys = dict[str, Any]


# A share of light that is too small to matter.
_NOTHING = 1e-6


def matte(reflectance: textures.Shade | NDArray[np.float64]) -> Keys:
    """Return a surface that scatters evenly."""
    shade = reflectance if isinstance(reflectance, textures.Shade) else textures.Shade(reflectance)
    return {"kind": "matte", "reflectance": shade.keys()}


def conductor(metal: Keys, alphas: tuple[float, float] | None) -> Keys:
    """Return a metal; ours are rough, a smooth one has the least alpha there is."""
    return {"kind": "conductor", **metal, **_alpha_keys(alphas or (0.0, 0.0))}


def dielectric(index: float, alphas: tuple[float, float] | None) -> Keys:
    """Return a transparent solid; one with an index near 1 is smooth, as ours must be."""
    rough = _alpha_keys(alphas) if abs(index - 1) >= LEAST_BEND else {}
    return {"kind": "dielectric", "index": index, **rough}


def _has_effect(shade: textures.Shade) -> bool:
    """Return whether a share is more than nothing."""
    return shade.texture is not None or bool(shade.colour.max() > _NOTHING)


# Ours is smooth below; pbrt-v4 calls a surface smooth below it, too (TrowbridgeReitzDistribution::EffectivelySmooth).
_SMOOTH = 1e-3
_ONLY_V3 = (
    "matte", "plastic", "glass", "metal", "mirror", "uber", "substrate", "translucent", "disney", "kdsubsurface",
    "fourier",
)  # fmt: skip


def alpha_of(roughness: float, *, version: int) -> float:
    """Return GGX's alpha of a roughness that is to be remapped.

    pbrt-v3 fits a polynomial to the logarithm (TrowbridgeReitzDistribution::RoughnessToAlpha), pbrt-v4 takes the root.
    """
    if version == 4:
        return math.sqrt(max(roughness, 0.0))
    x = math.log(max(roughness, 1e-3))
    return 1.62142 + 0.819955 * x + 0.1734 * x**2 + 0.0171201 * x**3 + 0.000640711 * x**4


def alphas(context: Context, entity: Entity, default: float, prefix: str = "") -> tuple[float, float] | None:
    """Return alpha along u and v of a material, None where it is smooth."""
    version = 3 if entity.kind in _ONLY_V3 else 4
    both = textures.value(context, entity, f"{prefix}roughness", default)
    pair = (
        textures.value(context, entity, f"{prefix}uroughness", both),
        textures.value(context, entity, f"{prefix}vroughness", both),
    )
    # 0 is smooth in either release: pbrt-v3 asks before it remaps, pbrt-v4 after
    if max(pair) <= 0:
        entity.parameters.boolean("remaproughness", True)
        return None
    if entity.parameters.boolean("remaproughness", True):
        pair = (alpha_of(pair[0], version=version), alpha_of(pair[1], version=version))
    return None if max(pair) < _SMOOTH else pair


def _alpha_keys(pair: tuple[float, float] | None) -> dict[str, object]:
    """Return the key of a rough material, nothing for a smooth one."""
    if pair is None:
        return {}
    u, v = (min(max(alpha, _SMOOTH), 1.0) for alpha in pair)
    return {"alpha": u if u == v else [u, v]}


# Refractive indices of metals and glasses: by pbrt's names, as numbers or as spectra.

# Metals of pbrt that ours have by name.
_METALS = {"Au": "gold", "Ag": "silver", "Al": "aluminium", "Cu": "copper"}
# Others. Brass: linear sRGB at normal incidence, as physicallybased.info has it. The oxides are transparent: n at the
# sodium D line from the CRC Handbook of Chemistry and Physics, no k.
_OTHER_METALS: dict[str, dict[str, Any]] = {
    "CuZn": {"reflectance": [0.910, 0.778, 0.423]},
    "MgO": {"metal": {"n": [1.736] * 3, "k": [1e-3] * 3}},
    "TiO2": {"metal": {"n": [2.609] * 3, "k": [1e-3] * 3}},
}

# Index at the helium d line (587.6 nm), from the makers' catalogues.
_GLASSES = {
    "glass-BK7": 1.5168, "glass-BAF10": 1.6700, "glass-F11": 1.6206, "glass-FK51A": 1.4866, "glass-LASF9": 1.8503,
    "glass-SF5": 1.6727, "glass-F5": 1.6034, "glass-SF10": 1.7283, "glass-SF11": 1.7847,
}  # fmt: skip

# Wavelengths near the middle of red, green and blue [nm], at which spectra of n and k are read.
_CHANNELS_NM = np.array([610.0, 550.0, 465.0])
_LOWEST, _HIGHEST = 1e-3, 100.0


def _index_of(context: Context, entity: Entity, name: str = "eta", default: float = 1.5) -> float:
    """Return the refractive index of a transparent material: one number, as ours have no dispersion."""
    parameters = entity.parameters
    for key in (name, "index") if name == "eta" else (name,):
        item = parameters.get(key, "float", "spectrum", "rgb", "color", "texture")
        if item is None:
            continue
        if item.kind == "float":
            index = parameters.number(key, default)
        elif item.kind == "spectrum":
            name = str(item.values[0]) if len(item.values) == 1 else ""
            index = _GLASSES.get(name) or float(np.interp(589.0, *_sort_samples(textures.samples_of(context, item))))
            context.approximated(entity, f'"{key}" without dispersion, {index:g} at all wavelengths', item.place)
        else:  # a colour, or a texture of numbers or of colours that are cut at 1
            values = item.values
            index = (
                float(np.mean(values)) if isinstance(values, np.ndarray) else textures.value(context, entity, key, 1.5)
            )
            context.approximated(entity, f'"{key}" as the number {index:g}', item.place)
        if not SMALLEST_INDEX <= index <= LARGEST_INDEX:
            span = f"{SMALLEST_INDEX:g} and {LARGEST_INDEX:g}"
            raise parameters.error(key, f"must lie between {span} (got {index:g})")
        return index
    return default


def _metal_keys(context: Context, entity: Entity, prefix: str = "") -> dict[str, Any]:
    """The keys of a conductor that say how a metal reflects: by name, by n and k, or by a colour."""
    parameters = entity.parameters
    if parameters.has(f"{prefix}reflectance"):
        reflects = textures.shade(context, entity, f"{prefix}reflectance", 1.0)
        if reflects.texture is not None:
            context.approximated(entity, "a metal that reflects its texture at every angle alike")
            return {"reflectance": reflects.keys()}
        return {"metal": _constants_of(reflects.colour)}
    metals = {_metal_named(context, entity, prefix, key) for key in ("eta", "k")} - {""}
    metal = metals.pop() if len(metals) == 1 else ""
    if metal in _METALS or metal in _OTHER_METALS:
        parameters.skip(f"{prefix}eta", f"{prefix}k")
        if metal in _METALS:
            return {"metal": _METALS[metal]}
        context.approximated(entity, f"{metal} by constants in three channels")
        return dict(_OTHER_METALS[metal])
    if not parameters.has(f"{prefix}eta") and not parameters.has(f"{prefix}k"):
        return {"metal": "copper"}
    n, k = (_channels(context, entity, f"{prefix}{key}", default) for key, default in (("eta", 0.2), ("k", 3.9)))
    return {"metal": {"n": n, "k": k}}


def _constants_of(colour: Sequence[float] | NDArray[np.float64]) -> dict[str, list[float]]:
    """Return n and k of the metal that pbrt takes for a colour: n = 1 and the k that reflects it head-on."""
    share = np.clip(np.broadcast_to(np.asarray(colour, np.float64), (3,)), 0, 0.9995)  # k ends at 100
    return {"n": [1.0] * 3, "k": np.maximum(2 * np.sqrt(share / (1 - share)), 1e-3).tolist()}


def _metal_named(context: Context, entity: Entity, prefix: str, key: str) -> str:
    """Return the metal of a named spectrum, or of a missing file that is called as those of pbrt-v3; "" without one."""
    item = entity.parameters.items.get(prefix + key)
    if item is None or item.kind != "spectrum" or isinstance(item.values, np.ndarray) or len(item.values) != 1:
        return ""
    name = str(item.values[0])
    if name.startswith("metal-"):
        return name.removeprefix("metal-").removesuffix(f"-{key}")
    metal = Path(name).name.removesuffix(f".{key}.spd")
    known = metal in _METALS and context.find_or_note(name, item.place, f"{_METALS[metal]} as we have it") is None
    return metal if known else name


def _channels(context: Context, entity: Entity, key: str, default: float) -> list[float]:
    """Return n or k in red, green and blue."""
    item = entity.parameters.get(key, "spectrum", "rgb", "color", "float")
    if item is None:
        values = np.full(3, default)
    elif item.kind == "spectrum":
        values = np.interp(_CHANNELS_NM, *_sort_samples(textures.samples_of(context, item)))
    else:
        values = np.broadcast_to(np.asarray(item.values, np.float64), (3,))
    return np.clip(values, _LOWEST, _HIGHEST).tolist()  # type: ignore[no-any-return]


def _sort_samples(samples: tuple[Any, Any]) -> tuple[Any, Any]:
    order = np.argsort(samples[0], kind="stable")
    return samples[0][order], samples[1][order]


# Materials that pbrt-v3 has and pbrt-v4 has not, or calls by other names.


def _matte(context: Context, material: Entity, name: str = "Kd") -> Keys:
    sigma = textures.value(context, material, "sigma", 0.0)
    rough = {"sigma_degrees": min(sigma, 90.0)} if sigma > 0 else {}
    return matte(textures.shade(context, material, name, 0.5)) | rough


def _plastic(context: Context, material: Entity) -> Keys:
    """Return a matte base under a clear cover.

    pbrt adds a gloss of index 1.5, Ks strong, to the base. Ours shares the light out between the two.
    """
    diffuse, gloss = textures.shade(context, material, "Kd", 0.25), textures.shade(context, material, "Ks", 0.25)
    return _covered_keys(context, material, diffuse, gloss, 1.5, alphas(context, material, 0.1))


def _covered_keys(
    context: Context,
    material: Entity,
    diffuse: textures.Shade,
    gloss: textures.Shade,
    index: float,
    pair: tuple[float, float] | None,
) -> Keys:
    """Return a base under a clear cover of the index that gives the gloss its reflectance head-on."""
    if not _has_effect(gloss) or index <= 1:
        return matte(diffuse)
    if gloss.texture is not None or np.abs(gloss.colour - 1).max() > 0.01:
        context.approximated(material, "its gloss as that of a clear cover with the same reflectance")
    normal = ((index - 1) / (index + 1)) ** 2 * float(luminance(gloss.colour))
    return _plastic_keys(diffuse, max(_index_reflecting(normal), 1.001), pair)


def _plastic_keys(base: textures.Shade, index: float, pair: tuple[float, float] | None) -> Keys:
    return {"kind": "plastic", "reflectance": base.keys(), "index": index, **_alpha_keys(pair)}


def _index_reflecting(share: float) -> float:
    """Return the refractive index that reflects a share of light head-on."""
    root = math.sqrt(share)
    return (1 + root) / (1 - root)


def _mirror(context: Context, material: Entity) -> Keys:
    tint = textures.shade(context, material, "Kr", 0.9)
    if tint.texture is not None:
        context.approximated(material, '"Kr" is its mean, not a texture')
    return {"kind": "mirror", "reflectance": tint.colour.tolist()}


def _glass(context: Context, material: Entity) -> Keys:
    pair = (textures.value(context, material, "uroughness", 0.0), textures.value(context, material, "vroughness", 0.0))
    rough = alphas(context, material, 0.0) if max(pair) > 0 else None
    material.parameters.boolean("remaproughness", True)
    index = _index_of(context, material)
    return dielectric(index, rough) | _tints(context, material, 1.0)


def _tints(context: Context, material: Entity, default: float) -> Keys:
    """Return the keys of what glass reflects and passes, which pbrt-v3 tints; nothing where it is clear."""
    tints = {"reflectance": textures.shade(context, material, "Kr", default),
             "transmittance": textures.shade(context, material, "Kt", default)}  # fmt: skip
    return {key: tint.keys() for key, tint in tints.items() if tint.texture is not None or np.any(tint.colour != 1)}


def _shiny_metal(context: Context, material: Entity) -> Keys:
    """Return the metal of pbrt-v2 that has a rough reflection Ks and a smooth one Kr: the stronger of the two."""
    rough, smooth = textures.shade(context, material, "Ks", 1.0), textures.shade(context, material, "Kr", 1.0)
    exponent = 1 / max(textures.value(context, material, "roughness", 0.1), 1e-4)
    context.approximated(material, "the stronger of its reflections Ks and Kr")
    if float(luminance(smooth.colour)) > float(luminance(rough.colour)):
        return conductor({"reflectance": smooth.keys()}, None)
    alpha = math.sqrt(2 / (exponent + 2))  # of Blinn's lobe with that exponent (Walter et al. 2007)
    return conductor({"reflectance": rough.keys()}, (alpha, alpha))


def _uber(context: Context, material: Entity) -> Keys:
    """Return a glossy base, clear glass, or a mixture of both.

    pbrt adds a matte part Kd, a rough gloss Ks, a smooth one Kr, and what passes Kt, under one index of refraction. The
    stronger gloss is kept.
    """
    diffuse, rough = textures.shade(context, material, "Kd", 0.25), textures.shade(context, material, "Ks", 0.25)
    smooth, through = textures.shade(context, material, "Kr", 0.0), textures.shade(context, material, "Kt", 0.0)
    index = _index_of(context, material)
    if _has_effect(rough) and _has_effect(smooth):
        context.approximated(material, "the stronger gloss of Ks and Kr")
    holes = opacity_keys(context, material, "opacity", _number_or_colour(context, material, "opacity"))
    passing = min(float(luminance(through.colour)), 1.0)
    glass: Keys = {"kind": "dielectric", "index": index}
    if passing > _NOTHING and not _has_effect(diffuse):
        material.parameters.skip("roughness", "uroughness", "vroughness", "remaproughness")
        return glass | holes
    is_smooth = float(luminance(smooth.colour)) > float(luminance(rough.colour))
    if is_smooth:
        material.parameters.skip("roughness", "uroughness", "vroughness", "remaproughness")
    gloss, pair = (smooth, None) if is_smooth else (rough, alphas(context, material, 0.1))
    if passing <= _NOTHING:
        return _covered_keys(context, material, diffuse, gloss, index, pair) | holes
    context.approximated(material, f"{passing:.3g} of it clear glass, the rest opaque")
    opaque = diffuse.scaled(np.full(3, 1 / max(1 - passing, 0.01)))
    base = _covered_keys(context, material, opaque, gloss, index, pair)
    return {"kind": "mix", "materials": [base, glass], "factor": passing} | holes


def _number_or_colour(context: Context, material: Entity, name: str, default: float = 1.0) -> textures.Shade:
    """Return an opacity or the share of a mixture, which pbrt-v3 takes as a colour."""
    item = material.parameters.items.get(name)
    if item is not None and (item.kind == "float" or (item.kind == "texture" and _is_float(material, name))):
        return textures.number_shade(context, material, name, default)
    return textures.shade(context, material, name, default)


def _is_float(material: Entity, name: str) -> bool:
    return ("spectrum", str(material.parameters.items[name].values[0])) not in material.textures


def opacity_keys(context: Context, entity: Entity, name: str, opacity: textures.Shade) -> Keys:
    """Return the key of a surface with holes, nothing where it is whole."""
    if opacity.texture is not None:
        return {"opacity": textures.numbers(context, entity, name, opacity).texture}
    share = textures.single(context, entity, name, opacity)
    return {} if share >= 1 else {"opacity": max(share, 0.0)}


def _substrate(context: Context, material: Entity) -> Keys:
    """Return a matte base under a clear cover whose reflectance at right angles is Ks (Ashikhmin and Shirley)."""
    diffuse, gloss = textures.shade(context, material, "Kd", 0.5), textures.shade(context, material, "Ks", 0.5)
    rough = alphas(context, material, 0.1)
    normal = min(float(luminance(gloss.colour)), 0.4)
    context.approximated(material, f"a clear cover that reflects {normal:.3g} head-on")
    if normal < 1e-4:
        return matte(diffuse)
    return _plastic_keys(diffuse, min(_index_reflecting(normal), 5.0), rough)


def _translucent(context: Context, material: Entity) -> Keys:
    """Return a sheet that scatters light to both sides, or the glossy side that is lit where nothing passes."""
    diffuse, gloss = textures.shade(context, material, "Kd", 0.25), textures.shade(context, material, "Ks", 0.25)
    reflect, transmit = (
        textures.shade(context, material, "reflect", 0.5),
        textures.shade(context, material, "transmit", 0.5),
    )
    rough = alphas(context, material, 0.1)
    back, on = diffuse.scaled(reflect.colour), diffuse.scaled(transmit.colour)
    if not _has_effect(on):
        return _covered_keys(context, material, back, gloss.scaled(reflect.colour), 1.5, rough)
    if _has_effect(gloss):
        context.approximated(material, "without its gloss")
    return _sheet(context, material, back, on)


def _sheet(context: Context, material: Entity, back: textures.Shade, on: textures.Shade) -> Keys:
    """Return a sheet that scatters two shares of light to its sides, cut where they are more than all of it."""
    if back.texture is None and on.texture is None and (most := float((back.colour + on.colour).max())) > 1:
        context.approximated(material, f"its shares divided by {most:.3g}, as they are more than all light")
        back, on = (part.scaled(np.full(3, 1 / most)) for part in (back, on))
    return {"kind": "translucent", "reflectance": back.keys(), "transmittance": on.keys()}


def _disney(context: Context, material: Entity) -> Keys:
    """Return the principled material; sheen, tints of gloss and flatness have no counterpart."""
    keys: Keys = {
        "kind": "principled",
        "base_color": textures.shade(context, material, "color", 0.5).keys(),
        "metallic": _share(context, material, "metallic", 0.0),
        "roughness": _share(context, material, "roughness", 0.5),
        "anisotropy": _cut(textures.value(context, material, "anisotropic", 0.0)),
        "index": max(_index_of(context, material), 1.0),
        "transmission": _cut(textures.value(context, material, "spectrans", 0.0)),
        "clearcoat": _cut(textures.value(context, material, "clearcoat", 0.0)),
    }
    gloss = textures.value(context, material, "clearcoatgloss", 1.0)
    keys["clearcoat_roughness"] = math.sqrt(_cut(0.1 + (0.001 - 0.1) * gloss))  # alpha runs from 0.1 to 0.001
    if keys["transmission"] > 0:
        keys["index"] = max(keys["index"], 1.02)
    left = [name for name in ("sheen", "speculartint", "flatness", "thin", "scatterdistance", "difftrans", "sheentint")
            if material.parameters.has(name)]  # fmt: skip
    if left:
        material.parameters.skip(*left)
        context.ignored(material, ", ".join(left))
    return keys


def _share(context: Context, material: Entity, name: str, default: float) -> object:
    share = textures.number_shade(context, material, name, default)
    return share.texture if share.texture is not None else _cut(textures.single(context, material, name, share))


def _cut(number: float) -> float:
    return min(max(number, 0.0), 1.0)


# Materials of pbrt as materials of ours, one function a kind.

# Mixed deeper than materials are on purpose.
_DEEPEST_MIX = 8


def convert_material(context: Context, material: Entity | None, depth: int = 0) -> Keys | None:
    """Return the keys of a material of ours; None for what has no surface, such as the boundary of a medium."""
    if material is None:
        return matte(np.full(3, 0.5))
    if material.kind in ("", "none", "interface"):
        return None
    if material.kind == "mix":
        return _mix_material(context, material, depth)
    if material.kind not in _KINDS:
        context.approximated(material, "matte, as in pbrt-v3, since there is no such material")
    keys = _KINDS.get(material.kind, _matte)(context, material)
    _take_normal_map(context, material, keys)
    return keys


def _take_normal_map(context: Context, material: Entity, keys: Keys) -> None:
    """Add bumps, or the normal map of pbrt-v4, to keys of ours that take them."""
    parameters = material.parameters
    for name in ("bumpmap", "displacement"):
        if parameters.has(name):
            _take_bumps(context, material, keys, name)
    name = parameters.text("normalmap", "")
    if not name:
        return
    place = parameters.items["normalmap"].place
    path = context.find_or_note(name, place, "the surface stays smooth")
    if path is None:
        return
    if textures.is_readable(path) and keys["kind"] not in ("mirror", "thin_glass", "mix"):
        keys["normal_map"] = {"file": textures.picture_name(context, path, place)}
    else:
        context.ignored(material, f"the normal map {name}", place)


def _take_bumps(context: Context, material: Entity, keys: Keys, name: str) -> None:
    texture, factor = textures.heights(context, material, name)
    if texture is None or factor == 0:
        return
    if keys["kind"] == "thin_glass":
        context.ignored(material, f"{name}; the pane stays smooth", material.parameters.items[name].place)
        return
    if keys["kind"] == "mirror":
        context.approximated(material, "with bumps as a conductor of alpha 0.001")
        keys |= {"kind": "conductor", **_alpha_keys((_SMOOTH, _SMOOTH))}
    for part in keys.get("materials", [keys]):
        if part["kind"] not in ("mirror", "thin_glass"):
            part["bump"] = {"texture": texture, "height": factor}
        else:
            context.ignored(material, f"{name} of its part that is a {part['kind']}")


def bumps_of_mesh(keys: Keys, version: int) -> Keys:
    """Return keys of a material as pbrt shows it on a mesh with vertex normals.

    Lengths on the surface do not count there. pbrt-v4 takes that of u for v as well. pbrt-v3 takes 1 for both, and both
    directions reversed, so that heights over u and v go inwards (Triangle::Intersect).
    """
    if "materials" in keys:
        return keys | {"materials": [bumps_of_mesh(part, version) for part in keys["materials"]]}
    if "bump" not in keys or "mapping" in keys["bump"]["texture"]:
        return keys
    bump, sign = keys["bump"], 1 if version == 4 else -1
    return keys | {"bump": bump | {"height": sign * bump["height"], "lengths": "u" if version == 4 else "unit"}}


def _coated_diffuse(context: Context, material: Entity) -> Keys:
    """Return a matte base under a clear cover; pbrt walks at random between the two, we sum the series."""
    _note_layer(context, material)
    rough = alphas(context, material, 0.0)
    index = _index_of(context, material)
    reflectance = textures.shade(context, material, "reflectance", 0.5)
    return _plastic_keys(reflectance, index, rough) if index > 1 else matte(reflectance)


def _note_layer(context: Context, material: Entity) -> None:
    """Report what lies between cover and base."""
    parameters = material.parameters
    parameters.skip("maxdepth", "nsamples", "thickness", "twosided")
    if parameters.has("albedo") and textures.shade(context, material, "albedo", 0.0).colour.max() > 0:
        context.ignored(material, "scattering between cover and base")
    parameters.skip("g", "albedo")


def _conductor(context: Context, material: Entity, roughness: float = 0.0) -> Keys:
    return conductor(_metal_keys(context, material), alphas(context, material, roughness))


def _coated_conductor(context: Context, material: Entity) -> Keys:
    """Return a metal under a clear coat, in the colour that both have head-on."""
    _note_layer(context, material)
    metal = _metal_keys(context, material, "conductor.")
    cover, base = (alphas(context, material, 0.0, prefix) for prefix in ("interface.", "conductor."))
    index = _index_of(context, material, "interface.eta")
    about = "" if abs(index - COAT_INDEX) < 1e-3 else f" of index {COAT_INDEX}"
    context.approximated(material, f"a metal under a clear coat{about}; what goes to and fro between them as head-on")
    colour = metal.get("reflectance")
    keys: Keys = {
        "kind": "principled", "metallic": 1.0, "clearcoat": 1.0, "roughness": _roughness_of(base),
        "base_color": colour if isinstance(colour, dict) else _colour_below(metal, index),
        "clearcoat_roughness": _roughness_of(cover),
    }  # fmt: skip
    return keys


def _roughness_of(pair: tuple[float, float] | None) -> float:
    """Return the roughness of the principled material with the mean of GGX's alphas."""
    return math.sqrt(_cut(math.sqrt(max(pair[0] * pair[1], 0.0)))) if pair is not None else 0.0


def _colour_below(metal: Keys, index: float) -> list[float]:
    """Return the colour of a metal below a medium of an index, with the light that comes to it again from the cover.

    It is that of smooth faces head-on.
    """
    constants = metal["metal"] if "metal" in metal else _constants_of(metal["reflectance"])
    if isinstance(constants, str):
        n, k = metal_spectra(constants)
    else:
        n, k = np.array(constants["n"]), np.array(constants["k"])
    below = metal_reflectance(np.asarray((n + 1j * k) / index, np.complex128))
    once = srgb_from_reflectance(below) if isinstance(constants, str) else below
    cover = ((COAT_INDEX - 1) / (COAT_INDEX + 1)) ** 2
    colours: list[float] = np.clip(once / (1 - cover * once), 0, 1).tolist()
    return colours


def _dielectric(context: Context, material: Entity) -> Keys:
    return dielectric(_index_of(context, material), alphas(context, material, 0.0))


def _thin_dielectric(context: Context, material: Entity) -> Keys:
    return {"kind": "thin_glass", "index": _index_of(context, material)}


def _diffuse_transmission(context: Context, material: Entity) -> Keys:
    """Return a sheet that scatters light to both sides."""
    scale = np.full(3, textures.value(context, material, "scale", 1.0))
    back, on = (
        textures.shade(context, material, name, 0.25).scaled(scale) for name in ("reflectance", "transmittance")
    )
    return _sheet(context, material, back, on) if _has_effect(on) else matte(back)


# Media of pbrt by its names; where a medium gives no coefficients, they are whole milk's.
_SUBSTANCES_OF = {
    "Apple": "apple", "Chicken1": "chicken", "Cream": "cream", "Ketchup": "ketchup", "Marble": "marble",
    "Potato": "potato", "Skimmilk": "skim_milk", "Skin1": "skin", "Skin2": "skin_pale", "Spectralon": "spectralon",
    "Wholemilk": "whole_milk",
}  # fmt: skip


def medium_keys(context: Context, medium: Entity, preset: str = "preset") -> Keys | None:
    """Return a medium of ours; None, with a report, for one that varies from place to place."""
    if medium.kind != "homogeneous" and preset == "preset":
        medium.parameters.skip_all()
        context.ignored(medium, f'media of the type "{medium.kind}"')
        return None
    parameters = medium.parameters
    name = parameters.text(preset, "")
    if name and name not in _SUBSTANCES_OF:
        context.approximated(medium, f'whole milk in place of "{name}"')
    scattering, absorption = media.SUBSTANCES[_SUBSTANCES_OF.get(name, "whole_milk")]
    scale = textures.value(context, medium, "scale", 1.0) / context.metres_per_unit
    sigma_a = scale * textures.coefficients(context, medium, "sigma_a", absorption)
    keys: Keys = {
        "absorption_per_m": sigma_a.tolist(),
        "scattering_per_m": (scale * textures.coefficients(context, medium, "sigma_s", scattering)).tolist(),
    }
    if g := parameters.number("g", 0.0):
        keys["asymmetry"] = float(np.clip(g, -media.MOST_ASYMMETRY, media.MOST_ASYMMETRY))
    emitted = parameters.number("Lescale", 1.0)
    if parameters.has("Le") and emitted:
        keys["emission_per_m"] = (emitted * sigma_a * textures.light(context, medium, "Le")).tolist()
    return keys


def _subsurface(context: Context, material: Entity) -> Keys:
    """Return rough glass round a medium in which light walks at random, where pbrt has it come out by a table."""
    parameters = material.parameters
    keys = dielectric(_index_of(context, material, default=1.33), alphas(context, material, 0.0))
    colour = next((name for name in ("reflectance", "Kd") if parameters.has(name)), None)
    context.deep = True
    context.approximated(material, "light walks at random below the surface")
    if colour is None:
        return keys | {"interior": medium_keys(context, material, "name")}
    deep = textures.shade(context, material, colour, 0.5)
    way = 1e3 * context.metres_per_unit * textures.coefficients(context, material, "mfp")
    parameters.skip("sigma_a", "sigma_s", "g", "scale")
    color = np.clip(deep.colour, 0, 1).tolist() if deep.texture is None else deep.texture
    inside = {"color": color, "free_path_mm": np.maximum(way, 1e-6).tolist()}
    return keys | {"interior": inside}


def _hair(context: Context, material: Entity) -> Keys:
    parameters = material.parameters
    keys: Keys = {
        "kind": "hair", "index": textures.value(context, material, "eta", 1.55),
        "roughness": textures.value(context, material, "beta_m", 0.3),
        "tilt_degrees": textures.value(context, material, "alpha", 2.0),
        "roughness_across": textures.value(context, material, "beta_n", 0.3),
    }  # fmt: skip
    colour = next((name for name in ("reflectance", "color") if parameters.has(name)), None)
    if parameters.has("sigma_a"):
        return keys | {"absorption": np.maximum(textures.shade(context, material, "sigma_a", 0.0).colour, 0).tolist()}
    if colour is not None:
        return keys | {"reflectance": textures.shade(context, material, colour, 0.5).keys()}
    pigments = {name: textures.value(context, material, name, 0.0) for name in ("eumelanin", "pheomelanin")}
    if not any(map(parameters.has, pigments)):
        pigments["eumelanin"] = 1.3
    return keys | pigments


def _measured(context: Context, material: Entity) -> Keys:
    """Return a measured material; grey for a file that ours does not read, such as one with a direction of its own."""
    if not material.parameters.has("filename"):
        return _grey(context, material)
    name, place = material.file_name()
    path = context.find_or_note(name, place, "matte grey 0.5")
    try:
        if path is not None:
            read_measured(path)
            return {"kind": "measured", "file": context.files.reference(path, place)}
    except InputError as problem:
        context.approximated(material, f"matte grey 0.5, as {name} {problem}", place)
    return matte(np.full(3, 0.5))


def _grey(context: Context, material: Entity) -> Keys:
    material.parameters.skip_all()
    context.approximated(material, "matte grey 0.5")
    return matte(np.full(3, 0.5))


_KINDS: dict[str, Callable[[Context, Entity], Keys]] = {
    "diffuse": partial(_matte, name="reflectance"), "coateddiffuse": _coated_diffuse, "conductor": _conductor,
    "coatedconductor": _coated_conductor, "dielectric": _dielectric, "thindielectric": _thin_dielectric,
    "diffusetransmission": _diffuse_transmission, "subsurface": _subsurface, "measured": _measured, "hair": _hair,
    "matte": _matte, "plastic": _plastic, "mirror": _mirror, "glass": _glass,
    "metal": partial(_conductor, roughness=0.01), "uber": _uber, "substrate": _substrate,
    "translucent": _translucent, "disney": _disney, "kdsubsurface": _subsurface, "fourier": _grey,
    "shinymetal": _shiny_metal,
}  # fmt: skip


def _mix_material(context: Context, material: Entity, depth: int) -> Keys | None:
    """Return a mixture: pbrt-v3 gives the share of the first material, pbrt-v4 that of the second."""
    parameters = material.parameters
    if depth > _DEEPEST_MIX:
        raise material.error(f"materials mix each other more than {_DEEPEST_MIX} deep")
    if parameters.has("materials"):
        item = parameters.get("materials", "string")
        assert item is not None
        names = [str(name) for name in item.values]
    else:
        names = [parameters.text(key, "") for key in ("namedmaterial1", "namedmaterial2")]
    if len(names) != 2 or not all(names):
        raise material.place.error(
            f"{material.what} needs the names of two materials (got {len([*filter(None, names)])})"
        )
    amount = _number_or_colour(context, material, "amount", 0.5)
    if not parameters.has("materials"):
        names.reverse()  # the share of the first material becomes that of the second
    parts = [
        convert_material(context, context.scene.material_of(MaterialName(name, material.place)), depth + 1)
        for name in names
    ]
    first, second = parts
    if first is None or second is None or "mix" in (first["kind"], second["kind"]):
        context.approximated(material, "the one of its materials that is a plain surface")
        return next((part for part in parts if part is not None and part["kind"] != "mix"), first or second)
    mixed = [{key: value for key, value in part.items() if key != "opacity"} for part in (first, second)]
    if mixed != [first, second]:
        context.ignored(material, "the opacity of its materials")
    shown = any(isinstance(part.get("reflectance"), dict) for part in mixed)
    varied = amount.texture is not None or np.ptp(amount.colour) > 0 or shown
    if varied and (blend := _blend(mixed, amount)) is not None:
        return blend
    factor: Any = textures.numbers(context, material, "amount", amount).texture
    if factor is None:
        factor = float(np.clip(textures.single(context, material, "amount", amount), 0, 1))
    return {"kind": "mix", "materials": mixed, "factor": factor}


def _blend(parts: list[Keys], amount: textures.Shade) -> Keys | None:
    """Return two matte colours or textures mixed channel by channel, which is exact; None for other materials."""
    if any(part.keys() != {"kind", "reflectance"} or part["kind"] != "matte" for part in parts):
        return None
    first, second = (part["reflectance"] for part in parts)
    if amount.texture is None and not isinstance(first, dict) and not isinstance(second, dict):
        return matte((1 - amount.colour) * np.array(first) + amount.colour * np.array(second))
    keys: Keys = {"kind": "mixture", "first": first, "second": second, "amount": amount.keys()}
    return {"kind": "matte", "reflectance": keys} if nested(keys) <= MOST_NESTED else None
