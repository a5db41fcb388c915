"""Cryptomatte: which objects share a pixel and how much of it each covers, as compositing programs read it.

After Friedman and Jones, "Fully automatic ID mattes with support for motion blur and transparency" (SIGGRAPH 2015
posters) and the specification 1.2.0 of Psyop: names become 32-bit floats by MurmurHash3, pairs of these and of
coverages lie in channels by rank, and a manifest in the header says which name is which.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

RANKS = 6  # of a pixel, those with most coverage
NAMES = {"crypto_object": "object_names", "crypto_material": "material_names"}  # metadata with the names of each layer
KEY_DIGITS = 7  # of a layer's hash, in the keys of the header
EXPONENT, LOWEST_OF_EXPONENT = 0x7F800000, 1 << 23
WORD = 0xFFFFFFFF


def rank_channels(layer: str) -> tuple[str, ...]:
    """Return the EXR channels of a layer: identifier and coverage of two ranks in each group of four."""
    groups = range(-(-RANKS // 2))
    return tuple(f"{layer}{group:02d}.{channel}" for group in groups for channel in "RGBA")[: 2 * RANKS]


def murmur3_32(data: bytes, seed: int = 0) -> int:
    """Return MurmurHash3_x86_32 of some bytes (Appleby's public-domain definition)."""
    state, whole = seed, len(data) & ~3
    for start in range(0, whole, 4):
        state ^= _scrambled(int.from_bytes(data[start : start + 4], "little"))
        state = (_rotated(state, 13) * 5 + 0xE6546B64) & WORD
    if tail := data[whole:]:
        state ^= _scrambled(int.from_bytes(tail, "little"))
    state ^= len(data)
    state = ((state ^ state >> 16) * 0x85EBCA6B) & WORD
    state = ((state ^ state >> 13) * 0xC2B2AE35) & WORD
    return state ^ state >> 16


def _scrambled(word: int) -> int:
    return (_rotated((word * 0xCC9E2D51) & WORD, 15) * 0x1B873593) & WORD


def _rotated(word: int, places: int) -> int:
    return (word << places | word >> (32 - places)) & WORD


def name_hash(name: str) -> int:
    """Return the bits of a name's identifier: its hash, changed where as a float it would be no normal number."""
    bits = murmur3_32(name.encode())
    return bits ^ LOWEST_OF_EXPONENT if bits & EXPONENT in (0, EXPONENT) else bits


def identifier(name: str) -> np.float32:
    """Return the float that stands for a name in the channels."""
    return np.uint32(name_hash(name)).view(np.float32)


def ranked(owners: NDArray[np.float64], names: Sequence[str]) -> NDArray[np.float32]:
    """Return identifiers and coverages in turn (height, width, 2 * `RANKS`), most coverage first.

    Things of one name are one thing.

    Parameters
    ----------
    owners : (height, width, slots, 2) array
        Indices of names, and coverages; 0 where a slot is free.
    """
    height, width, slots, _ = owners.shape
    pairs = owners.reshape(-1, slots, 2)
    _, first = np.unique(np.array([name_hash(name) for name in names], np.uint32), return_index=True)
    numbers = {name_hash(names[index]): index for index in first.tolist()}
    merged = np.array([numbers[name_hash(name)] for name in names] or [0])
    index = merged[np.clip(pairs[..., 0].astype(np.int64), 0, len(merged) - 1)]
    cover = pairs[..., 1].copy()
    for slot in range(1, slots):  # what has the name of an earlier slot is added there
        for before in range(slot):
            same = (index[:, slot] == index[:, before]) & (cover[:, before] > 0)
            cover[same, before] += cover[same, slot]
            cover[same, slot] = 0.0
    order = np.lexsort((index, -cover), axis=1)[:, :RANKS]
    cover, index = np.take_along_axis(cover, order, axis=1), np.take_along_axis(index, order, axis=1)
    hashes = np.array([identifier(name) for name in names] or [np.float32(0)], np.float32)
    found = np.zeros((len(pairs), 2 * RANKS), np.float32)
    found[:, 0 : 2 * cover.shape[1] : 2] = np.where(cover > 0, hashes[index], np.float32(0.0))
    found[:, 1 : 2 * cover.shape[1] : 2] = cover
    return found.reshape(height, width, 2 * RANKS)


def header_of(layers: Mapping[str, Any], metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the attributes of an EXR header that describe the Cryptomatte layers among these; none without any."""
    found: dict[str, str] = {}
    for layer, key in NAMES.items():
        if layer in layers:
            prefix = f"cryptomatte/{name_hash(layer):08x}"[: len("cryptomatte/") + KEY_DIGITS]
            manifest = {name: f"{name_hash(name):08x}" for name in metadata.get(key, ())}
            found |= {
                f"{prefix}/name": layer,
                f"{prefix}/hash": "MurmurHash3_32",
                f"{prefix}/conversion": "uint32_to_float32",
                f"{prefix}/manifest": json.dumps(manifest, separators=(",", ":"), ensure_ascii=True),
            }
    return found
