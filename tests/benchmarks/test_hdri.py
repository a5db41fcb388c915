"""A picture as environment beside Mitsuba: which way it is turned, how bright it is, and how it lights."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.worker import Worker
from rptcam_cl.rendering.plan.environment import cell_shares, joined_cells
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from tests.benchmarks.comparing import BATCHES, assert_same_mean, assert_same_tiles, theirs
from tests.rendering.light.pictures import save_exr
from tests.rendering.pictures import batches, looking
from tests.support.statistics import Sampled

Array = NDArray[np.float64]
SIZE = (256, 512)
TURN = 40.0  # degrees of the picture about the vertical
# Towards the lights of the picture, how far they reach [rad], and their radiance.
LIGHTS = [((-0.5, -0.6, 0.62), 0.07, (90.0, 75.0, 50.0)), ((0.9, 0.3, 0.1), 0.3, (0.2, 0.5, 2.0))]


def radiance(directions: Array) -> Array:
    """What comes from directions in the world, z upwards: smooth, of a different colour everywhere."""
    z = directions[..., 2:]
    found = np.asarray([0.35, 0.30, 0.25]) * (1 - z) / 2 + np.asarray([0.3, 0.5, 0.9]) * (1 + z) / 2
    for towards, width, colour in LIGHTS:
        cosine = directions @ (np.array(towards) / np.linalg.norm(towards))
        found += np.exp((cosine[..., None] - 1) / width**2) * np.array(colour)
    return found


def angles(rows: Array) -> tuple[Array, Array]:
    """Longitude to the right from the picture's left edge, and angle from its top, of all texels."""
    v, u = np.meshgrid(rows, (np.arange(SIZE[1]) + 0.5) / SIZE[1], indexing="ij")
    return 2 * np.pi * u, np.pi * v


def our_picture() -> Array:
    """The picture by docs/scene.md: its middle straight ahead at +y, turned counter-clockwise seen from above."""
    longitude, polar = angles((np.arange(SIZE[0]) + 0.5) / SIZE[0])
    azimuth = np.pi / 2 - (longitude - np.pi) + np.radians(TURN)  # from +x towards +y
    return radiance(np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], -1))


def their_picture() -> Array:
    """The picture by Mitsuba's envmap: +y up, its left edge at -z, +x a quarter from there; rows end in poles."""
    longitude, polar = angles(np.linspace(0, 1, SIZE[0]))
    x, y, z = np.sin(polar) * np.sin(longitude), np.cos(polar), -np.sin(polar) * np.cos(longitude)
    return radiance(np.stack([x, -z, y], -1))  # its y stands up as our z


TO_WORLD = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]


def scene_turned(folder: Path, degrees: float) -> Scene:
    environment = {"kind": "image", "file": "sky.exr", "rotation_degrees": degrees}
    floor = {"shape": "rectangle", "corner": [-4, -4, 0], "edge_u": [8, 0, 0], "edge_v": [0, 8, 0]}
    objects: list[dict[str, Any]] = [
        floor | {"material": {"kind": "matte", "reflectance": 0.5}},
        {
            "shape": "sphere", "center": [-1, 0, 0.8], "radius": 0.8,
            "material": {"kind": "matte", "reflectance": [0.7, 0.4, 0.2]},
        },
        {
            "shape": "sphere", "center": [1, 0.2, 0.7], "radius": 0.7,
            "material": {"kind": "conductor", "reflectance": [0.9, 0.8, 0.6], "alpha": 0.1},
        },
    ]  # fmt: skip
    return load_scene(
        {
            "film": {"resolution": [96, 64]},
            "camera": looking([3, -6, 2.5], [0, 0, 0.9], fov=50),
            "render": {"max_depth": 5, "roulette_depth": 0, "multiple_scattering": False},
            "environment": environment,
            "objects": objects,
        },
        base_dir=folder,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("hdri")
    save_exr(made / "sky.exr", our_picture())
    save_exr(made / "theirs.exr", their_picture())
    return made


@pytest.fixture(scope="module")
def other(mitsuba: Worker, folder: Path) -> Sampled:
    sky = {"type": "envmap", "filename": str(folder / "theirs.exr"), "to_world": {"matrix": TO_WORLD}}
    return theirs(mitsuba, scene_turned(folder, TURN), {"sky": sky}, 256, folder)


@pytest.fixture(scope="module")
def ours(mitsuba: Worker, folder: Path) -> Sampled:
    return batches(scene_turned(folder, TURN), "hdri", BATCHES, spp=256)


def test_light_samples_go_by_cells_of_several_texels_here() -> None:
    assert joined_cells(cell_shares(our_picture().mean(axis=2))).shape == (64, 128)


def test_mean_is_within_half_a_per_cent_of_mitsuba(ours: Sampled, other: Sampled) -> None:
    assert_same_mean(ours, other)


def test_every_tile_agrees_with_mitsuba(ours: Sampled, other: Sampled) -> None:
    assert_same_tiles(ours, other)


def test_tiles_would_show_a_picture_turned_by_two_degrees(folder: Path, other: Sampled) -> None:
    turned = batches(scene_turned(folder, TURN + 2), "hdri turned", BATCHES, spp=256)
    with pytest.raises(AssertionError, match="tile"):
        assert_same_tiles(turned, other)
