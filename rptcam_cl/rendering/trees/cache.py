"""Trees kept on disk between runs, under the hash of what they were built from.

The cache may be lost at any time and can never break a run: a file that cannot be read or is not a sound tree is built
anew and replaced; a folder that cannot be written is not used.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import time
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np

from rptcam_cl.core.resources import CACHE_VARIABLE, cache_dir, kernels_dir
from rptcam_cl.rendering.trees.wide_tree import Bvh, is_sound

VARIABLE = CACHE_VARIABLE
MOST_BYTES = 2 << 30  # of all kept trees
STRAY_SECONDS = 3600  # after which a file that is still being written has been left behind
ARRAYS = ("bounds", "children", "blocks")


def load_or_build(key: str, build: Callable[[], Bvh], fits: Callable[[Bvh], bool] = lambda tree: True) -> Bvh:
    """Return the tree kept under a key, else the one that ``build`` returns, which is kept.

    Parameters
    ----------
    key
        Names all that the tree depends on, but for this package's code: hash of the boxes, width, leaf size, device.
    build
        Called at most once.
    fits
        Says whether a sound tree is one over what it is wanted for.
    """
    folder = cache_folder()
    path = folder / f"{hashlib.sha256(f'{builder_identity()} {key}'.encode()).hexdigest()}.npz"
    kept = _load(path)
    if kept is not None and fits(kept):
        return kept
    built = build()
    with contextlib.suppress(OSError):  # no place, no permission: no cache
        _keep(path, built)
        _evict(folder, path)
    return built


def cache_folder() -> Path:
    """Return the folder of the trees."""
    return cache_dir("trees")


@lru_cache(maxsize=1)
def builder_identity() -> str:
    """Return a hash of the code that builds trees, so that no tree outlives it."""
    files = [*Path(__file__).parent.glob("*.py"), *(kernels_dir() / "build").iterdir()]
    texts = [path.read_bytes() for path in sorted(files, key=lambda path: path.name)]
    return hashlib.sha256(b"\0".join(texts)).hexdigest()


def _load(path: Path) -> Bvh | None:
    """Return the tree in a file and mark it as used, or None: there is no file, or it is not a sound tree."""
    try:
        with np.load(path, allow_pickle=False) as file:
            tree = Bvh(*(file[name] for name in ARRAYS))
        if not is_sound(tree):
            return None
    except Exception:  # a damaged archive makes zipfile and numpy raise nearly anything; all mean the same here
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return tree


def _keep(path: Path, tree: Bvh) -> None:
    """Write a tree so that readers and other writers meet the old file or the whole new one."""
    if tree.nbytes > MOST_BYTES:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}-{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("xb") as file:
            np.savez(file, **{name: getattr(tree, name) for name in ARRAYS})
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _evict(folder: Path, newest: Path) -> None:
    """Remove the least recently used trees until the rest is small enough, and the remains of killed runs."""
    for stray in folder.glob(".*.tmp"):
        if stray.stat().st_mtime < time.time() - STRAY_SECONDS:
            stray.unlink(missing_ok=True)
    found = sorted((path.stat().st_mtime, path.stat().st_size, path) for path in folder.glob("*.npz") if path != newest)
    excess = sum(size for _, size, _ in found) + newest.stat().st_size - MOST_BYTES
    for _, size, path in found:
        if excess <= 0:
            return
        path.unlink(missing_ok=True)
        excess -= size
