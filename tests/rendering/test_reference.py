"""Radiometry against another renderer: the pictures of tests/data/reference, global means and 8 x 8 tiles."""

from pathlib import Path

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.scene.load import load_scene
from tests.rendering.pictures import batches
from tests.support.cases import fast
from tests.support.mesh_scene import write_meshes
from tests.support.statistics import ALPHA, Sampled, assert_equivalent, overall, sidak, tiles, welch

FOLDER = Path(__file__).parents[1] / "data" / "reference"
BATCHES = 4
SPP = {"A": 32, "A_thin": 32, "A_lens": 48, "B": 32, "C": 48}  # x 4 x 64 pixels: at least 8192 samples a tile


def reference(name: str) -> tuple[Sampled, Sampled]:
    """Return tiles and mean of the other renderer's picture.

    Where its variance was not kept, that of our independent samples, as its are, stands in, scaled to its number: two
    path tracers of the same scene differ in it by far less than the factor of ten or more that their samples differ by.
    """
    with np.load(FOLDER / f"{name}.npz") as file:
        if "tile_variance" in file.files:
            tile_variance, mean_variance = file["tile_variance"].astype(float), file["mean_variance"]
        else:
            scene = rptcam_cl.load_scene(FOLDER / f"{name}.yaml", ["render.sampler=independent"])
            alike = batches(scene, f"reference {name} independent", BATCHES, spp=SPP[name])
            share = BATCHES * SPP[name] / float(file["spp"])
            tile_variance, mean_variance = tiles(alike).variance * share, overall(alike).variance * share
        # one difference of halves per pixel: one degree of freedom each
        return (
            Sampled(file["tile_mean"].astype(float), tile_variance, 64),
            Sampled(file["mean"], mean_variance, float(file["pixels"])),
        )


@pytest.fixture(scope="module", params=fast(["B"], SPP))
def pair(request, tmp_path_factory):
    name = request.param
    scene = FOLDER / f"{name}.yaml"
    if name == "C":  # its meshes are made by formula
        scene = load_scene(read_yaml(scene).data, base_dir=write_meshes(tmp_path_factory.mktemp("meshes")))
    ours = batches(scene, f"reference {name}", BATCHES, spp=SPP[name])
    return name, ours, *reference(name)


def test_mean_is_within_half_a_per_cent_of_the_other_renderer(pair):
    _, ours, _, other = pair
    mean = overall(ours)
    error = np.sqrt(mean.variance + other.variance)
    assert_equivalent(mean.mean, error, other.mean, 0.005 * other.mean)


def test_every_tile_agrees_with_the_other_renderer(pair):
    name, ours, other, _ = pair
    p = welch(tiles(ours), other)
    worst = np.unravel_index(p.argmin(), p.shape)
    assert p.min() > sidak(ALPHA, p.size), f"{name}: tile {worst}, p {p.min():.1e}"


def test_tiles_would_show_a_material_that_is_off_by_a_twentieth(pair):
    name, ours, other, _ = pair
    spoilt = tiles(ours)
    spoilt.mean[10:14, 12:20] *= 1.05
    assert welch(spoilt, other).min() < sidak(ALPHA, other.mean.size), name


def test_irradiance_that_relative_exposure_divides_by_is_that_of_the_other_tracer():
    image = rptcam_cl.render(FOLDER / "A_lens.yaml", size=(16, 9), spp=1)
    # 0.190922 is Monte Carlo over the pupil, known to a few units of its last digit
    assert image.metadata["on_axis_irradiance"] == pytest.approx(0.190922, rel=2e-4)
