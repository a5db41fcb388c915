"""Pictures for tests: seeds that follow from the test, small scenes, and means with their errors."""

import hashlib
from collections.abc import Mapping
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

import rptcam_cl
from tests.support.statistics import Sampled, sampled

WHITE = {"kind": "constant", "radiance": 1.0}
MATTE = {"kind": "matte", "reflectance": 1.0}


def seed_of(name: str) -> int:
    """Return the seed of a test: fixed, so that nothing is flaky, and not chosen, so that nothing is shopped for."""
    return crc32(name.encode())


def pixels(scene: Any, **options: Any) -> NDArray[np.float64]:
    """Return the linear film of a scene, shape (height, width, 3)."""
    return np.asarray(rptcam_cl.render(scene, **options)).astype(np.float64)


def batches(scene: Any, name: str, count: int, **options: Any) -> Sampled:
    """Return the mean of ``count`` pictures with independent seeds, with the variance of each pixel's mean."""
    return sampled([pixels(scene, seed=seed_of(f"{name} {batch}"), **options) for batch in range(count)])


def flat_mean(scene: Any, name: str, **options: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean and standard error per channel of a picture whose pixels all estimate the same number."""
    film = pixels(scene, seed=seed_of(name), **options).reshape(-1, 3)
    return film.mean(axis=0), film.std(axis=0, ddof=1) / np.sqrt(len(film))


def scene_of(
    objects: list[dict[str, Any]],
    camera: Mapping[str, Any],
    *,
    depth: int = 8,
    roulette: int = 0,
    resolution: tuple[int, int] = (32, 32),
    **rest: Any,
) -> dict[str, Any]:
    """Return the mapping of a scene."""
    return {
        "film": {"resolution": list(resolution), **rest.pop("film", {})},
        "camera": dict(camera),
        "render": {"spp": 16, "max_depth": depth, "roulette_depth": roulette, "caustics": "off"},
        "objects": objects,
        **rest,
    }


def looking(eye: Any, target: Any, fov: float = 40.0, up: Any = (0, 0, 1), **rest: Any) -> dict[str, Any]:
    """Return a pinhole camera."""
    pose = {"eye": list(map(float, eye)), "target": list(map(float, target)), "up": list(up)}
    return {"kind": "pinhole", "fov_degrees": fov, **pose, **rest}


def lamp(radiance: Any, *, two_sided: bool = False) -> dict[str, Any]:
    """Return an emissive material."""
    return {"kind": "emissive", "radiance": radiance, "two_sided": two_sided}


def bits(image: rptcam_cl.Image) -> str:
    """The hash of a picture."""
    return hashlib.sha256(np.asarray(image).tobytes()).hexdigest()


def _wall(corner: Any, u: Any, v: Any) -> dict[str, Any]:
    material = {"kind": "matte", "reflectance": [0.7, 0.6, 0.5]}
    return {"shape": "rectangle", "corner": corner, "edge_u": u, "edge_v": v, "material": material}


def room_lit_by_detours(**rest: Any) -> dict[str, Any]:
    """Return a closed room of 2 m whose lamp stands behind a shelf, so that only the ceiling sees it."""
    lamp = {"shape": "rectangle", "corner": [-0.1, 1.45, -0.9], "edge_u": [0, 0, 0.1], "edge_v": [0.2, 0, 0],
            "material": {"kind": "emissive", "radiance": [60, 50, 40]}}  # fmt: skip
    shelf = {"shape": "box", "min": [-0.4, 1.4, -1], "max": [0.4, 1.43, -0.6], "material": MATTE | {"reflectance": 0.6}}
    front = {"shape": "box", "min": [-0.4, 1.4, -0.63], "max": [0.4, 1.6, -0.6], "material": shelf["material"]}
    walls = [
        _wall([-1, 0, -1], [0, 0, 2], [2, 0, 0]), _wall([-1, 2, -1], [2, 0, 0], [0, 0, 2]),
        _wall([-1, 0, -1], [2, 0, 0], [0, 2, 0]), _wall([1, 0, 1], [-2, 0, 0], [0, 2, 0]),
        _wall([1, 0, -1], [0, 0, 2], [0, 2, 0]), _wall([-1, 0, 1], [0, 0, -2], [0, 2, 0]),
    ]  # fmt: skip
    more = rest.pop("objects", [])
    camera = looking([0.3, 1, 0.9], [0, 0.9, -1], fov=60.0, up=(0, 1, 0))
    return scene_of([*walls, shelf, front, *([] if rest.pop("dark", False) else [lamp]), *more], camera, **rest)
