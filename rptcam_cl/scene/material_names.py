"""Materials by name: an object, or a mix of two materials, may name one of the scene's `materials`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rptcam_cl.scene.material import Matte
from rptcam_cl.scene.refusal import listed, near_name, refuse

_STAND_IN = Matte(kind="matte", reflectance=(0.5, 0.5, 0.5))


def _named(name: str, materials: Mapping[str, Any], path: tuple[str | int, ...]) -> Any:
    if name not in materials:
        names = list(materials)
        raise refuse(
            f"names no material{near_name(name, names)}",
            got=name,
            allowed=listed(names) if names else "a material mapping, or a name once `materials` defines one",
            path=path,
        )
    return materials[name]


def with_parts(material: Any, materials: Mapping[str, Any] | None, path: tuple[str | int, ...]) -> Any:
    """Return a material's mapping with the names in a mix replaced by what they name.

    Parameters
    ----------
    material
        What stands for a material, unchecked.
    materials
        The scene's materials; None where they have errors of their own, which are reported.
    path
        Keys that lead to the material, for errors.
    """
    if not isinstance(material, dict) or material.get("kind") != "mix":
        return material
    parts = material.get("materials")
    if not isinstance(parts, (list, tuple)):
        return material
    found = [
        part if not isinstance(part, str) else _STAND_IN if materials is None
        else _named(part, materials, (*path, "materials", index))
        for index, part in enumerate(parts)
    ]  # fmt: skip
    return material | {"materials": found}


def with_material(item: Any, index: int, materials: Mapping[str, Any] | None) -> Any:
    """Return an object's mapping with the name of its material, or those in it, replaced by the materials."""
    if not isinstance(item, dict) or "material" not in item:
        return item
    path = (index, "material")
    name = item["material"]
    if not isinstance(name, str):
        return item | {"material": with_parts(name, materials, path)}
    # Where the materials have errors, the object's other keys still count.
    return item | {"material": _STAND_IN if materials is None else _named(name, materials, path)}
