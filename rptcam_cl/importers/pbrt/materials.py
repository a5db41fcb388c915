"""Materials of pbrt as materials of ours: one function a kind, those of pbrt-v3 in a module of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rptcam_cl.importers.pbrt import materials_v3 as v3
from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.media import index_of, metal_keys
from rptcam_cl.importers.pbrt.pictures import is_readable, picture_name
from rptcam_cl.importers.pbrt.state import Entity, MaterialName
from rptcam_cl.importers.pbrt.surfaces import Keys, alpha_keys, alphas, conductor, dielectric, has_effect, matte
from rptcam_cl.importers.pbrt.textures import Array, shade, single, value

# Mixed deeper than materials are on purpose.
DEEPEST = 8


def convert_material(context: Context, material: Entity | None, depth: int = 0) -> Keys | None:
    """Return the keys of a material of ours; None for what has no surface, such as the boundary of a medium."""
    if material is None:
        return matte(np.full(3, 0.5))
    if material.kind in ("", "none", "interface"):
        return None
    if material.kind == "mix":
        return _mix(context, material, depth)
    kinds = {**_KINDS, **v3.KINDS}
    if material.kind not in kinds:
        raise material.place.error(f'unknown material "{material.kind}" (allowed: {", ".join(kinds)}, mix, interface)')
    found = kinds[material.kind](context, material)
    _note_bumps(context, material, found)
    return found


def _note_bumps(context: Context, material: Entity, found: Keys) -> None:
    """Take the normal map of pbrt-v4 where ours has the key; other bumps are left out."""
    parameters = material.parameters
    for name in ("bumpmap", "displacement"):
        if parameters.has(name):
            parameters.skip(name)
            context.report.ignored(parameters.items[name].place, f"{material.what}: {name}; the surface stays smooth")
    name = parameters.text("normalmap", "")
    if not name:
        return
    place = parameters.items["normalmap"].place
    path = context.find_or_note(name, place, "the surface stays smooth")
    if path is None:
        return
    if is_readable(path) and found["kind"] not in ("mirror", "thin_glass", "mix"):
        found["normal_map"] = {"file": picture_name(context, path, place)}
    else:
        context.report.ignored(place, f"{material.what}: the normal map {name}")


def _diffuse(context: Context, material: Entity) -> Keys:
    v3.note_sigma(context, material)
    return matte(shade(context, material, "reflectance", 0.5))


def _coated_diffuse(context: Context, material: Entity) -> Keys:
    """Return a matte base under a clear cover; pbrt walks at random between the two, we sum the series."""
    _note_layer(context, material)
    rough = alpha_keys(alphas(context, material, 0.0))
    index = index_of(context, material)
    reflectance = shade(context, material, "reflectance", 0.5)
    if index <= 1:
        return matte(reflectance)
    return {"kind": "plastic", "reflectance": reflectance.keys(), "index": index, **rough}


def _note_layer(context: Context, material: Entity) -> None:
    """Report what lies between cover and base."""
    parameters = material.parameters
    parameters.skip("maxdepth", "nsamples", "thickness", "twosided")
    if parameters.has("albedo") and shade(context, material, "albedo", 0.0).colour.max() > 0:
        context.report.ignored(material.place, f"{material.what}: scattering between cover and base")
    parameters.skip("g", "albedo")


def _conductor(context: Context, material: Entity) -> Keys:
    return conductor(metal_keys(context, material), alphas(context, material, 0.0))


def _coated_conductor(context: Context, material: Entity) -> Keys:
    """Return the metal alone with the roughness that both faces have together."""
    _note_layer(context, material)
    metal = metal_keys(context, material, "conductor.")
    pairs = [alphas(context, material, 0.0, prefix) for prefix in ("interface.", "conductor.")]
    index_of(context, material, "interface.eta")
    context.report.approximated(material.place, f"{material.what}: the metal without its clear cover")
    known = [pair for pair in pairs if pair is not None]
    return conductor(metal, (max(pair[0] for pair in known), max(pair[1] for pair in known)) if known else None)


def _dielectric(context: Context, material: Entity) -> Keys:
    return dielectric(index_of(context, material), alphas(context, material, 0.0))


def _thin_dielectric(context: Context, material: Entity) -> Keys:
    return {"kind": "thin_glass", "index": index_of(context, material)}


def _diffuse_transmission(context: Context, material: Entity) -> Keys:
    """Return the matte side; light does not pass."""
    scale = value(context, material, "scale", 1.0)
    found = shade(context, material, "reflectance", 0.25).scaled(np.full(3, scale))
    through = shade(context, material, "transmittance", 0.25)
    if has_effect(through):
        context.report.approximated(
            material.place, f"{material.what}: matte of the reflectance; what shines through is left out"
        )
    return matte(found)


def _subsurface(context: Context, material: Entity) -> Keys:
    material.parameters.used.update(material.parameters.items)
    context.report.approximated(material.place, f"{material.what}: plastic; light does not pass below the surface")
    given = material.parameters.has("reflectance")
    colour = shade(context, material, "reflectance", 0.5) if given else shade(context, material, "Kd", 0.5)
    return {"kind": "plastic", "reflectance": colour.keys(), "index": index_of(context, material, default=1.33),
            **alpha_keys(alphas(context, material, 0.0))}  # fmt: skip


def _plain(context: Context, material: Entity) -> Keys:
    material.parameters.used.update(material.parameters.items)
    context.report.approximated(material.place, f"{material.what}: matte grey 0.5")
    return matte(np.full(3, 0.5))


_KINDS: dict[str, Callable[[Context, Entity], Keys]] = {
    "diffuse": _diffuse, "coateddiffuse": _coated_diffuse, "conductor": _conductor,
    "coatedconductor": _coated_conductor, "dielectric": _dielectric, "thindielectric": _thin_dielectric,
    "diffusetransmission": _diffuse_transmission, "subsurface": _subsurface, "measured": _plain, "hair": _plain,
}  # fmt: skip


def _mix(context: Context, material: Entity, depth: int) -> Keys | None:
    """Return a mixture: pbrt-v3 gives the share of the first material, pbrt-v4 that of the second."""
    parameters = material.parameters
    if depth > DEEPEST:
        raise material.place.error(f"{material.what}: materials mix each other more than {DEEPEST} deep")
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
    amount = v3.number_or_colour(context, material, "amount", 0.5)
    if not parameters.has("materials"):
        names.reverse()  # the share of the first material becomes that of the second
        if amount.texture is not None:
            context.report.approximated(material.place, f"{material.what}: the textured amount is inverted")
    parts = [
        convert_material(context, context.scene.material_of(MaterialName(name, material.place)), depth + 1)
        for name in names
    ]
    first, second = parts
    if first is None or second is None or "mix" in (first["kind"], second["kind"]):
        context.report.approximated(
            material.place, f"{material.what}: the one of its materials that is a plain surface"
        )
        return next((part for part in parts if part is not None and part["kind"] != "mix"), first or second)
    mixed = [{key: value for key, value in part.items() if key != "opacity"} for part in (first, second)]
    if mixed != [first, second]:
        context.report.ignored(material.place, f"{material.what}: the opacity of its materials")
    if amount.texture is None and np.ptp(amount.colour) > 0 and (blend := _blended(mixed, amount.colour)) is not None:
        return blend
    factor: Any = amount.texture
    if factor is None:
        factor = float(np.clip(single(context, material, "amount", amount), 0, 1))
    return {"kind": "mix", "materials": mixed, "factor": factor}


def _blended(parts: list[Keys], amount: Array) -> Keys | None:
    """Return two matte colours mixed channel by channel, which is exact; None for other materials."""
    if any(part.keys() != {"kind", "reflectance"} or part["kind"] != "matte" for part in parts):
        return None
    first, second = (part["reflectance"] for part in parts)
    if isinstance(first, dict) or isinstance(second, dict):
        return None
    return matte((1 - amount) * np.array(first) + amount * np.array(second))
