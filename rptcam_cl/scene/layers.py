"""The names of the auxiliary layers that a render may record beside the picture."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, BeforeValidator

from rptcam_cl.scene.refusal import refuse

LayerName = Literal[
    "depth",
    "distance",
    "position",
    "normal",
    "geometric_normal",
    "albedo",
    "coverage",
    "coc",
    "object_id",
    "material_id",
    "uv",
    "pupil",
    "samples",
    "variance",
]
LAYER_NAMES: tuple[LayerName, ...] = get_args(LayerName)
FILM_LAYERS: tuple[LayerName, ...] = ("samples", "variance")  # of the picture itself, not of what its rays meet


def _as_list(names: object) -> object:
    if not isinstance(names, (list, tuple)):
        raise refuse("must be a list of layers", allowed="as [depth, normal]")
    return names


def _each_once(names: tuple[LayerName, ...]) -> tuple[LayerName, ...]:
    for index, name in enumerate(names):
        if name in names[:index]:
            raise refuse("is listed twice", got=name, allowed="each layer once", path=(index,))
    return names


Layers = Annotated[tuple[LayerName, ...], BeforeValidator(_as_list), AfterValidator(_each_once)]
