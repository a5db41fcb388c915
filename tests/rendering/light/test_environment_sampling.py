"""Light sampling of a picture of the environment: radiance and density agree, and counts follow the density."""

from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.core.colour import LUMINANCE
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.plan.environment import LARGEST_SECOND_MOMENT, cell_shares, compensate, joined_cells
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.scene.load import load_scene
from tests.device.probes import run
from tests.rendering.light.pictures import bilinear, direction_of, rough_sky, save_exr
from tests.rendering.pictures import MATTE, looking, pixels, scene_of
from tests.support.statistics import ALPHA, chi_squared

CAMERA = {"kind": "environment", "eye": [0, 0, 0], "target": [0, 0, -1]}
FILM = {"resolution": [64, 32]}


def sampled(session, folder, sky, count, lanes=8, **keys):
    """Return what the probe writes for random pairs: direction, radiance, density, radiance again, density again."""
    save_exr(folder / "sky.exr", sky)
    environment = {"kind": "image", "file": "sky.exr", "up": [0, 1, 0], **keys}
    plan = make_plan(load_scene({"camera": CAMERA, "film": FILM, "environment": environment}, base_dir=folder))
    # 24 bits as the kernels' random numbers have
    numbers = np.random.default_rng(5).integers(0, 1 << 24, (2, count)).astype(np.float32) / np.float32(1 << 24)
    out = session.allocate(4 * 11 * count)
    run(session, "probe_environment", plan.facts | {"VW": lanes}, count // lanes, **SceneBuffers(session, plan).scene,
        numbers=session.upload(numbers), out=out, count=np.uint32(count))  # fmt: skip
    rows = session.read(out, np.float32, 11 * count).reshape(11, count).astype(np.float64)
    return rows[:3].T, rows[3:6].T, rows[6], rows[7:10].T, rows[10]


def place(direction):
    """Return where on a picture, with +y up, directions lie: from the left and from the top."""
    u = 0.5 + np.arctan2(direction[:, 0], -direction[:, 2]) / (2 * np.pi)
    return u, np.arctan2(np.hypot(direction[:, 0], direction[:, 2]), direction[:, 1]) / np.pi


@pytest.mark.parametrize("lanes", [1, 8])
def test_sample_agrees_with_what_is_met(session: Session, tmp_path: Path, lanes: int) -> None:
    sky = rough_sky()
    direction, radiance, density, met, met_density = sampled(session, tmp_path, sky, 1 << 14, lanes)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, atol=5e-7)
    expected = bilinear(sky, *place(direction))
    # halves resolve 5e-4; float32 angles are good to 2e-7 turns, 1e-5 texels, at slopes up to 300 per texel
    np.testing.assert_allclose(radiance, expected, rtol=1e-3, atol=6e-3)
    np.testing.assert_allclose(met, expected, rtol=1e-3, atol=6e-3)
    # on the edge of a cell rounding may pick the neighbour
    same = np.isclose(density, met_density, rtol=2e-4)
    assert same.mean() > 0.999


def smooth_sky():
    """A picture of 32 x 64 texels whose light rises to one side, in cells of 4 x 4 for light sampling."""
    v, u = np.meshgrid((np.arange(32) + 0.5) / 32, (np.arange(64) + 0.5) / 64, indexing="ij")
    return (1 + 0.9 * np.sin(np.pi * v) * np.cos(2 * np.pi * u))[..., None] * np.array([1.0, 0.8, 0.6])


@pytest.mark.parametrize("sky", [rough_sky(), smooth_sky()], ids=["rough", "smooth"])
def test_counts_follow_the_density(session: Session, tmp_path: Path, sky) -> None:
    count = 1 << 20
    direction, _, _, _, density = sampled(session, tmp_path, sky, count)
    u, v = place(direction)
    rows, columns = sky.shape[0], sky.shape[1]
    cells = np.minimum((v * rows).astype(int), rows - 1) * columns + np.minimum((u * columns).astype(int), columns - 1)
    observed = np.bincount(cells, minlength=rows * columns)
    # within a cell directions are even in longitude and polar angle: its probability is density * sine * area
    expected = np.full(rows * columns, np.nan)
    expected[cells] = density * np.sin(np.pi * v) * 2 * np.pi**2 / (rows * columns)
    found = np.isfinite(expected)
    above = compensate(joined_cells(cell_shares(sky @ LUMINANCE)))[::-1] > 0
    size = rows // len(above)
    np.testing.assert_array_equal(found, above.repeat(size, axis=0).repeat(size, axis=1).ravel())
    observed, expected = observed[found], expected[found]
    assert expected.sum() == pytest.approx(1, abs=1e-4)
    assert chi_squared(observed, expected / expected.sum() * count) > ALPHA
    wrong = np.roll(expected, 1)
    assert chi_squared(observed, wrong / wrong.sum() * count) < 1e-12


def test_cells_are_joined_while_light_samples_are_nearly_as_good() -> None:
    shares = cell_shares(smooth_sky() @ LUMINANCE)
    joined, fine = joined_cells(shares), compensate(shares)
    assert joined.shape == (8, 16)
    assert joined.sum() == pytest.approx(shares.sum())

    def second_moment(cells):  # of light over the probability of its texel
        size = 32 // len(cells)
        chance = np.kron(compensate(cells), np.ones((size, size))) / size**2
        lit = chance > 0
        return (fine[lit] ** 2 / chance[lit]).sum() * chance.sum() / fine.sum() ** 2

    assert second_moment(shares) == pytest.approx(1)
    assert 1 < second_moment(joined) < LARGEST_SECOND_MOMENT
    assert second_moment(joined.reshape(4, 2, 8, 2).sum(axis=(1, 3))) > LARGEST_SECOND_MOMENT
    with_a_lamp = smooth_sky()
    with_a_lamp[10, 20] *= 1000
    assert joined_cells(cell_shares(with_a_lamp @ LUMINANCE)).shape == (32, 64)


def test_light_samples_take_what_is_above_the_mean() -> None:
    shares = cell_shares(rough_sky() @ LUMINANCE)
    bands = -np.diff(np.cos(np.linspace(0, np.pi, 33))) * 2 * np.pi / 64
    mean = shares.sum() / (4 * np.pi)
    np.testing.assert_allclose(compensate(shares), np.maximum(shares - mean * bands[:, None], 0), atol=1e-12)


def test_even_sky_has_no_light_samples() -> None:
    assert (compensate(cell_shares(np.full((32, 64), 0.3))) == 0).all()


def test_even_sky_is_as_bright_as_it_says(tmp_path: Path) -> None:
    save_exr(tmp_path / "sky.exr", np.full((8, 16, 3), 0.25))
    environment = {"kind": "image", "file": "sky.exr", "up": [0, 0, 1]}
    ground = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": MATTE}
    scene = scene_of([ground], looking([0, 0, 1], [1, 0, 0]), depth=2, resolution=(8, 8), environment=environment)
    loaded = load_scene(scene, base_dir=tmp_path)
    assert make_plan(loaded).emitters.count == 0
    np.testing.assert_allclose(pixels(loaded, spp=4), 0.25, rtol=1e-5)


def test_positions_within_a_cell_are_even(session: Session, tmp_path: Path) -> None:
    sky = np.array([[1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 1.0]])[..., None] * np.ones(3)
    direction, _, _, _, _ = sampled(session, tmp_path, sky, 1 << 18)
    u, v = place(direction)
    counts, _, _ = np.histogram2d(u * 4 % 1, v * 2 % 1, bins=16, range=[[0, 1], [0, 1]])
    assert chi_squared(counts.ravel(), np.full(256, counts.sum() / 256)) > ALPHA


def test_bright_texel_at_the_pole_is_sampled(session: Session, tmp_path: Path) -> None:
    sky = np.full((64, 128, 3), 1e-3)
    sky[0] = 1000.0
    direction, radiance, density, _, _ = sampled(session, tmp_path, sky, 1 << 16)
    # radiance / density is an estimate of the flux: even near the pole, where rows of texels shrink to a point
    flux = radiance[:, 0] / density
    v, u = np.meshgrid((np.arange(6400) + 0.5) / 6400, (np.arange(64) + 0.5) / 64, indexing="ij")
    expected = (bilinear(sky[..., :1], u, v)[..., 0] * np.sin(np.pi * v)).sum() * np.pi / 6400 * 2 * np.pi / 64
    assert flux.mean() == pytest.approx(expected, abs=5 * flux.std() / 256)
    assert flux.std() < flux.mean()  # even directions over the sphere would give 15 times the mean
    assert np.arccos(direction[:, 1]).max() < 0.2 or (direction[:, 1] < 0.98).mean() < 0.02


@pytest.mark.parametrize(
    ("keys", "middle", "right"),
    [
        ({}, [0, 0, -1], [1, 0, 0]),
        ({"rotation_degrees": 90}, [-1, 0, 0], [0, 0, -1]),
        ({"up": [0, 0, 1]}, [0, 1, 0], [1, 0, 0]),
        ({"up": [0, 0, 1], "rotation_degrees": 90}, [-1, 0, 0], [0, 1, 0]),
        ({"up": [0, -2, 0]}, [0, 0, 1], [1, 0, 0]),
    ],
)
def test_middle_of_the_picture_lies_where_the_reference_says(session, tmp_path, keys, middle, right):
    sky = np.full((32, 64, 3), 1e-4)
    sky[15:17, 31:33] = [1, 0, 0]
    sky[15:17, 47:49] = [0, 1, 0]
    direction, radiance, *_ = sampled(session, tmp_path, sky, 1 << 12, **keys)
    for channel, expected in ((0, middle), (1, right)):
        bright = direction[radiance[:, channel] > 0.5].mean(axis=0)
        np.testing.assert_allclose(bright / np.linalg.norm(bright), expected, atol=0.02)


def test_direction_of_the_tests_is_inverted_by_place() -> None:
    u, v = np.array([0.1, 0.5, 0.8]), np.array([0.2, 0.5, 0.9])
    np.testing.assert_allclose(place(direction_of(u, v)), (u, v), atol=1e-12)
