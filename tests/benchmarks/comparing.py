"""Pictures of both renderers, and whether they are the same."""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.mitsuba_scene import describe
from benchmarks.worker import Worker
from rptcam_cl.scene.scene import Scene
from tests.support.statistics import ALPHA, Sampled, assert_equivalent, overall, sampled, sidak, tiles, welch

BATCHES = 4
TEXEL = 5e-4  # of a tile: half floats and 8-bit codes of texels, rounded differently by two renderers


def theirs(worker: Worker, scene: Scene, others: dict[str, Any], spp: int, folder: Path) -> Sampled:
    """Return Mitsuba's mean of a scene whose environment and meshes are described by hand."""
    description = describe(scene, roulette=False, folder=folder, others=others)
    worker.ask(do="load", description=description, **{"as": str(folder)})
    pictures = []
    for seed in range(BATCHES):
        path = folder / f"{seed}.npy"
        worker.ask(do="render", spp=spp, seed=seed, save=str(path), **{"as": str(folder)})
        pictures.append(np.load(path))
    return sampled(pictures)


def assert_same_mean(a: Sampled, b: Sampled) -> None:
    """Fail unless the means of both pictures agree to 0.5 %."""
    mean, other = overall(a), overall(b)
    assert_equivalent(mean.mean, np.sqrt(mean.variance + other.variance), other.mean, 0.005 * other.mean)


def assert_same_tiles(a: Sampled, b: Sampled) -> None:
    """Fail when tiles differ by more than noise and the rounding of texels explain."""
    left, right = tiles(a), tiles(b)
    rounded = Sampled(left.mean, left.variance + (TEXEL * left.mean) ** 2, left.freedom)
    p = welch(rounded, right)
    at = np.unravel_index(p.argmin(), p.shape)
    assert p.min() > sidak(ALPHA, p.size), f"tile {at}: {left.mean[at]} against {right.mean[at]}, p {p.min():.1e}"
