"""The picture of a saved render, made on the host without its scene and without a device."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering.account import clamp_text, of_makers
from rptcam_cl.rendering.checkpoint import Checkpoint
from rptcam_cl.rendering.film import PLANES, TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.film_buffers import outcomes_of, share_removed
from rptcam_cl.rendering.ground_truth import saved_truth
from rptcam_cl.rendering.layers import LayerArrays, LayerPlanes


@dataclass(frozen=True)
class SavedPicture:
    """What an image is made of.

    Attributes
    ----------
    pixels : (height, width, 3) array
        Mean of the film.
    layers : dict
        Auxiliary layers by name.
    metadata, stats : dict
        As those of a render.
    """

    pixels: NDArray[np.float32]
    layers: dict[str, NDArray[Any]]
    metadata: dict[str, Any]
    stats: dict[str, Any]


def picture_of(saved: Checkpoint, layout: FilmLayout) -> SavedPicture:
    """Return the picture of a saved render that is whole."""
    facts, arrays = saved.facts, saved.arrays
    picture, done, counts = facts["picture"], facts["done"], arrays["counts"]
    samples = np.full((layout.height, layout.width), done, np.uint32)
    named: dict[str, NDArray[Any]] = {"samples": samples}
    planes = LayerPlanes(facts["layers"])
    if planes.names:
        in_rows = layout.in_rows(arrays["layers"])
        named |= LayerArrays(planes, in_rows, np.asarray(picture["eye_m"])).arrays()
    tiles = np.full(layout.pixels // TILE_PIXELS, done, np.uint32)
    stats: dict[str, Any] = {
        "samples": int(samples.sum(dtype=np.uint64)),
        "spp": done,
        "device": ", ".join(facts["devices"]),
        "not_finite": int(counts[-2]),
        "parts": picture.get("parts", []),
        "made_by": facts["made_by"],
    }
    if picture["has_lens"]:
        stats["lens"] = outcomes_of(counts)
    if picture["clamp"] is not None:
        stats["clamp"] = {"limit": picture["clamp"], "removed_share": share_removed(arrays["film"])}
    named["direct"] = pixels = layout.picture(arrays["film"][:PLANES], tiles)
    named["ghosts"] = np.zeros_like(pixels)  # they are added by `merge`
    named |= saved_truth(arrays, layout)[0]
    return SavedPicture(
        pixels, {name: named[name] for name in facts["layers"]},
        _metadata(picture["metadata"], stats), stats,
    )  # fmt: skip


def _metadata(before: dict[str, Any], stats: dict[str, Any]) -> dict[str, Any]:
    """Return metadata with what follows from the samples, in the order that a render gives them."""
    found = before | {"spp": stats["spp"], "device": stats["device"]} | of_makers(stats["made_by"])
    found["numerics"] = before["numerics"] | {
        "samples_dropped": stats["not_finite"],
        "rays_not_converged": stats["lens"]["no_convergence"] if "lens" in stats else 0,
    }
    if "clamp" in stats:
        found["clamp"] = clamp_text(**stats["clamp"])
    if len({tuple(part["devices"]) for part in stats["parts"]}) > 1:
        found["parts"] = stats["parts"]
    return found
