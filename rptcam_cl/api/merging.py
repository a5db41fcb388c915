"""Parts of a render, made anywhere, become its picture."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.image_layers import named_layers
from rptcam_cl.api.stages import with_ghosts
from rptcam_cl.core.atomic import check_writable
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.imaging import Image, develop
from rptcam_cl.rendering import (
    Checkpoint,
    FilmLayout,
    FilmSpread,
    SavedPicture,
    layout_of,
    merged_state,
    picture_of,
    saved_ghosts,
    saved_truth,
    spread_of,
    write_checkpoint,
)


def merge(
    parts: Sequence[str | os.PathLike[str]],
    *,
    checkpoint: str | os.PathLike[str] | None = None,
    allow_mixed: bool = False,
) -> Image:
    """Return the picture of a render that was made in parts; needs neither its scene nor a device.

    Parts by tiles give the bits of one render on equal devices. Ranges of samples of the same tiles are added in
    float64, and differ from one render by the rounding of float32.

    Parameters
    ----------
    parts
        Files that `render` kept with ``part`` or ``samples``, or a checkpoint of the whole film.
    checkpoint
        File for the state of the whole, to go on from: ``render(..., checkpoint=that, resume=True)`` adds samples.
    allow_mixed
        Whether parts are taken that other code, another numpy or another driver has made; the metadata name all under
        ``mixed``.

    Raises
    ------
    InputError
        There are no parts, or the checkpoint is one of them.
    StateError
        A file cannot be read or is damaged; parts are of another scene, lens, seed or version, overlap, or leave gaps,
        which are named.
    """
    if not parts:
        raise InputError("parts: there are none (allowed: at least one file)")
    if checkpoint is not None:
        check_writable(checkpoint, parts)
    state = merged_state(parts, allow_mixed=allow_mixed)
    layout = layout_of(state.facts)
    found, spread, ghosts, said = _beside(state, layout)
    if checkpoint is not None:
        write_checkpoint(checkpoint, state.facts, state.arrays)
    metadata = dict(found.metadata)
    layers = named_layers(state.facts["layers"], found.layers, ({}, said), metadata)
    image = Image(found.pixels, metadata, found.stats, layers=layers)
    if ghosts is not None:
        image = with_ghosts(image, *ghosts)
    if spread is not None:
        image = replace(image, pixels=spread.over(image.pixels, layout))
    try:
        return develop(image)
    except InputError as problem:  # of keys that every render has checked
        raise StateError(f"{parts[0]}: this saved render is damaged: {problem}") from None


def _beside(
    state: Checkpoint, layout: FilmLayout
) -> tuple[SavedPicture, FilmSpread | None, tuple[NDArray[np.float32], dict[str, Any]] | None, dict[str, Any]]:
    """Return the picture of a saved render, what diffraction does to it, its ghosts, and what its sharp layers say."""
    try:
        spread = spread_of(state.arrays, tuple(state.facts["resolution"]))
        return picture_of(state, layout), spread, saved_ghosts(state.arrays), saved_truth(state.arrays, layout)[1]
    except (ValueError, KeyError, TypeError) as problem:
        raise StateError(f"this saved render is damaged: {problem} (render it again)") from None
