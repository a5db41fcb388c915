"""Materials that pbrt-v3 has and pbrt-v4 has not, or calls by other names."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rptcam_cl.colour import luminance
from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.media import index_of, metal_keys
from rptcam_cl.importers.pbrt.state import Entity
from rptcam_cl.importers.pbrt.surfaces import (
    NOTHING,
    Keys,
    alpha_keys,
    alphas,
    conductor,
    dielectric,
    has_effect,
    matte,
)
from rptcam_cl.importers.pbrt.textures import Shade, number_shade, shade, single, value


def note_sigma(context: Context, material: Entity) -> None:
    """Report the roughness of a matte surface (Oren and Nayar), which ours has not."""
    if value(context, material, "sigma", 0.0) > 0:
        context.report.approximated(material.place, f"{material.what}: Lambert's law in place of Oren and Nayar's")


def _matte(context: Context, material: Entity) -> Keys:
    note_sigma(context, material)
    return matte(shade(context, material, "Kd", 0.5))


def _plastic(context: Context, material: Entity) -> Keys:
    """Return a matte base under a clear cover.

    pbrt adds a gloss of index 1.5, Ks strong, to the base. Ours shares the light out between the two.
    """
    diffuse, gloss = shade(context, material, "Kd", 0.25), shade(context, material, "Ks", 0.25)
    return _glossy(context, material, diffuse, gloss, 1.5)


def _glossy(context: Context, material: Entity, diffuse: Shade, gloss: Shade, index: float) -> Keys:
    return _covered(context, material, diffuse, gloss, index, alphas(context, material, 0.1))


def _covered(
    context: Context, material: Entity, diffuse: Shade, gloss: Shade, index: float, pair: tuple[float, float] | None
) -> Keys:
    """Return a base under a clear cover of the index that gives the gloss its reflectance head-on."""
    if not has_effect(gloss) or index <= 1:
        return matte(diffuse)
    if gloss.texture is not None or np.abs(gloss.colour - 1).max() > 0.01:
        context.report.approximated(
            material.place, f"{material.what}: its gloss as that of a clear cover with the same reflectance"
        )
    normal = ((index - 1) / (index + 1)) ** 2 * float(luminance(gloss.colour))
    root = math.sqrt(normal)
    index = max((1 + root) / (1 - root), 1.001)
    return {"kind": "plastic", "reflectance": diffuse.keys(), "index": index, **alpha_keys(pair)}


def _mirror(context: Context, material: Entity) -> Keys:
    tint = shade(context, material, "Kr", 0.9)
    if tint.texture is not None:
        context.report.approximated(material.place, f'{material.what}: "Kr" is its mean, not a texture')
    return {"kind": "mirror", "reflectance": tint.colour.tolist()}


def _glass(context: Context, material: Entity) -> Keys:
    pair = (value(context, material, "uroughness", 0.0), value(context, material, "vroughness", 0.0))
    rough = alphas(context, material, 0.0) if max(pair) > 0 else None
    material.parameters.boolean("remaproughness", True)
    index = index_of(context, material)
    tints = [shade(context, material, name, 1.0) for name in ("Kr", "Kt")]
    if any(tint.texture is not None or np.abs(tint.colour - 1).max() > 0.01 for tint in tints):
        context.report.ignored(
            material.place, f"{material.what}: the tints Kr and Kt; clear glass neither adds nor takes"
        )
    if not has_effect(tints[1]):
        context.report.approximated(material.place, f"{material.what}: without Kt it is a mirror of its index")
        return conductor({"metal": {"n": [index] * 3, "k": [1e-3] * 3}}, rough)
    return dielectric(index, rough)


def _metal(context: Context, material: Entity) -> Keys:
    return conductor(metal_keys(context, material), alphas(context, material, 0.01))


def _shiny_metal(context: Context, material: Entity) -> Keys:
    """Return the metal of pbrt-v2 that has a rough reflection Ks and a smooth one Kr: the stronger of the two."""
    rough, smooth = shade(context, material, "Ks", 1.0), shade(context, material, "Kr", 1.0)
    exponent = 1 / max(value(context, material, "roughness", 0.1), 1e-4)
    context.report.approximated(material.place, f"{material.what}: the stronger of its reflections Ks and Kr")
    if float(luminance(smooth.colour)) > float(luminance(rough.colour)):
        return conductor({"reflectance": smooth.keys()}, None)
    alpha = math.sqrt(2 / (exponent + 2))  # of Blinn's lobe with that exponent (Walter et al. 2007)
    return conductor({"reflectance": rough.keys()}, (alpha, alpha))


def _uber(context: Context, material: Entity) -> Keys:
    """Return a glossy base, clear glass, or a mixture of both.

    pbrt adds a matte part Kd, a rough gloss Ks, a smooth one Kr, and what passes Kt, under one index of refraction. The
    stronger gloss is kept.
    """
    diffuse, rough = shade(context, material, "Kd", 0.25), shade(context, material, "Ks", 0.25)
    smooth, through = shade(context, material, "Kr", 0.0), shade(context, material, "Kt", 0.0)
    index = index_of(context, material)
    if has_effect(rough) and has_effect(smooth):
        context.report.approximated(material.place, f"{material.what}: the stronger gloss of Ks and Kr")
    holes = opacity_keys(context, material, "opacity", number_or_colour(context, material, "opacity"))
    passing = min(float(luminance(through.colour)), 1.0)
    glass: Keys = {"kind": "dielectric", "index": index}
    if passing > NOTHING and not has_effect(diffuse):
        material.parameters.skip("roughness", "uroughness", "vroughness", "remaproughness")
        return glass | holes
    if float(luminance(smooth.colour)) > float(luminance(rough.colour)):
        material.parameters.skip("roughness", "uroughness", "vroughness", "remaproughness")
        pair = None
        gloss = smooth
    else:
        pair = alphas(context, material, 0.1)
        gloss = rough
    if passing <= NOTHING:
        return _covered(context, material, diffuse, gloss, index, pair) | holes
    context.report.approximated(material.place, f"{material.what}: {passing:.3g} of it clear glass, the rest opaque")
    opaque = diffuse.scaled(np.full(3, 1 / max(1 - passing, 0.01)))
    base = _covered(context, material, opaque, gloss, index, pair)
    return {"kind": "mix", "materials": [base, glass], "factor": passing} | holes


def number_or_colour(context: Context, material: Entity, name: str, default: float = 1.0) -> Shade:
    """Return an opacity or the share of a mixture, which pbrt-v3 takes as a colour."""
    item = material.parameters.items.get(name)
    if item is not None and (item.kind == "float" or (item.kind == "texture" and _is_float(material, name))):
        return number_shade(context, material, name, default)
    return shade(context, material, name, default)


def _is_float(material: Entity, name: str) -> bool:
    return ("spectrum", str(material.parameters.items[name].values[0])) not in material.textures


def opacity_keys(context: Context, entity: Entity, name: str, opacity: Shade) -> Keys:
    """Return the key of a surface with holes, nothing where it is whole."""
    if opacity.texture is not None:
        return {"opacity": opacity.texture}
    share = single(context, entity, name, opacity)
    return {} if share >= 1 else {"opacity": max(share, 0.0)}


def _substrate(context: Context, material: Entity) -> Keys:
    """Return a matte base under a clear cover whose reflectance at right angles is Ks (Ashikhmin and Shirley)."""
    diffuse, gloss = shade(context, material, "Kd", 0.5), shade(context, material, "Ks", 0.5)
    rough = alphas(context, material, 0.1)
    normal = min(float(luminance(gloss.colour)), 0.4)
    context.report.approximated(material.place, f"{material.what}: a clear cover that reflects {normal:.3g} head-on")
    if normal < 1e-4:
        return matte(diffuse)
    root = math.sqrt(normal)
    index = min((1 + root) / (1 - root), 5.0)
    return {"kind": "plastic", "reflectance": diffuse.keys(), "index": index, **alpha_keys(rough)}


def _translucent(context: Context, material: Entity) -> Keys:
    """Return the side that is lit; light does not pass."""
    diffuse, gloss = shade(context, material, "Kd", 0.25), shade(context, material, "Ks", 0.25)
    reflect, _ = shade(context, material, "reflect", 0.5), shade(context, material, "transmit", 0.5)
    context.report.approximated(material.place, f"{material.what}: what it reflects; what shines through is left out")
    return _glossy(context, material, diffuse.scaled(reflect.colour), gloss.scaled(reflect.colour), 1.5)


def _disney(context: Context, material: Entity) -> Keys:
    """Return the principled material; sheen, tints of gloss and flatness have no counterpart."""
    found: Keys = {
        "kind": "principled",
        "base_color": shade(context, material, "color", 0.5).keys(),
        "metallic": _share(context, material, "metallic", 0.0),
        "roughness": _share(context, material, "roughness", 0.5),
        "anisotropy": _cut(value(context, material, "anisotropic", 0.0)),
        "index": max(index_of(context, material), 1.0),
        "transmission": _cut(value(context, material, "spectrans", 0.0)),
        "clearcoat": _cut(value(context, material, "clearcoat", 0.0)),
    }
    gloss = value(context, material, "clearcoatgloss", 1.0)
    found["clearcoat_roughness"] = math.sqrt(_cut(0.1 + (0.001 - 0.1) * gloss))  # alpha runs from 0.1 to 0.001
    if found["transmission"] > 0:
        found["index"] = max(found["index"], 1.02)
    left = [name for name in ("sheen", "speculartint", "flatness", "thin", "scatterdistance", "difftrans", "sheentint")
            if material.parameters.has(name)]  # fmt: skip
    if left:
        material.parameters.skip(*left)
        context.report.ignored(material.place, f"{material.what}: {', '.join(left)}")
    return found


def _share(context: Context, material: Entity, name: str, default: float) -> object:
    found = number_shade(context, material, name, default)
    return found.texture if found.texture is not None else _cut(single(context, material, name, found))


def _cut(number: float) -> float:
    return min(max(number, 0.0), 1.0)


def _unknown(context: Context, material: Entity) -> Keys:
    material.parameters.used.update(material.parameters.items)
    context.report.approximated(material.place, f"{material.what}: matte grey 0.5")
    return matte(np.full(3, 0.5))


KINDS: dict[str, Callable[[Context, Entity], Keys]] = {
    "matte": _matte, "plastic": _plastic, "mirror": _mirror, "glass": _glass, "metal": _metal, "uber": _uber,
    "substrate": _substrate, "translucent": _translucent, "disney": _disney, "kdsubsurface": _unknown,
    "fourier": _unknown, "shinymetal": _shiny_metal,
}  # fmt: skip
