import sys

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.image import Image

BALL = {"shape": "sphere", "center": [0, 1, 0], "radius": 1}
FLOOR = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 1, 0]}
SCENE = {
    "film": {"resolution": [64, 48]},
    "camera": {"kind": "pinhole", "eye": [0, 1, 5], "target": [0, 0.8, 0], "fov_degrees": 40},
    "objects": [
        BALL | {"material": {"kind": "matte", "reflectance": [0.6, 0.3, 0.1]}},
        FLOOR | {"material": {"kind": "matte", "reflectance": 0.5}},
    ],
    "environment": {"kind": "gradient", "bottom": 0.1, "top": [0.5, 0.8, 2.0]},
}


@pytest.fixture
def missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyoidn", None)


def test_missing_denoiser_is_said_before_rendering(missing: None) -> None:
    with pytest.raises(
        InputError, match=r"denoising needs the package pyoidn \(pip install \"rptcam_cl\[denoise\]\"\)"
    ):
        rptcam_cl.render(SCENE, denoise=True)


def test_image_without_its_guides_cannot_be_denoised() -> None:
    with pytest.raises(InputError, match=r"needs the layers albedo and normal \(missing: albedo, normal\)"):
        Image(np.zeros((4, 4, 3), np.float32)).denoised()


def test_denoised_picture_is_nearer_to_the_truth_and_says_so() -> None:
    pytest.importorskip("pyoidn")
    truth = np.asarray(rptcam_cl.render(SCENE, spp=1024, seed=1))
    noisy = rptcam_cl.render(SCENE, spp=8, seed=2, layers=["depth"])
    clean = rptcam_cl.render(SCENE, spp=8, seed=2, layers=["depth"], denoise=True)
    before, after = (np.mean((np.asarray(image) - truth) ** 2) for image in (noisy, clean))
    assert after < 0.5 * before
    assert list(clean.layers) == ["depth"]  # what guides the denoiser is not kept unasked
    assert "biased" in clean.metadata["denoised"]
    assert clean.stats["denoised"] == clean.metadata["denoised"]
    assert "denoised" not in noisy.metadata
    again = rptcam_cl.render(SCENE, spp=8, seed=2, layers=["albedo", "normal"]).denoised()
    np.testing.assert_allclose(np.asarray(again), np.asarray(clean), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("digits", [-90, -24, 60])
def test_light_of_another_unit_is_denoised_alike(digits: int) -> None:
    """The network takes light below 1e-8 for none: a dim picture was black."""
    pytest.importorskip("pyoidn")
    noisy = rptcam_cl.render(SCENE, spp=4, seed=2, layers=["albedo", "normal"])
    layers = {name: noisy[name] for name in ("albedo", "normal")}
    dim = Image(np.ldexp(np.asarray(noisy), digits), layers=layers).denoised()
    np.testing.assert_array_equal(np.ldexp(np.asarray(dim), -digits), np.asarray(noisy.denoised()))


def test_colours_outside_the_triangle_of_srgb_stay_there() -> None:
    """Green light of 520 nm has less than no red; the denoiser takes such a channel for black."""
    pytest.importorskip("pyoidn")
    colour = np.array([-0.12, 0.4, -0.02], np.float32)
    noise = np.random.default_rng(3).normal(0.0, 0.02, (64, 80, 3))
    layers = {"albedo": np.full((64, 80, 3), 0.5, np.float32), "normal": np.zeros((64, 80, 3), np.float32)}
    clean = Image(np.float32(colour + noise), layers=layers).denoised().pixels[8:-8, 8:-8]
    assert clean.mean(axis=(0, 1)) == pytest.approx(colour, abs=0.02)  # the network is 3 % off on even fields
    assert clean.std(axis=(0, 1)).max() < 0.01


@pytest.mark.parametrize("size", [(61, 83), (3, 2), (1, 1)])
def test_corners_are_as_bright_as_the_middle(size):
    """The denoiser by itself makes corners of 63 x 77 pixels a third darker, and a single pixel black."""
    pytest.importorskip("pyoidn")
    noise = np.random.default_rng(3).normal(0.0, 0.01, (*size, 3))
    normal = np.zeros((*size, 3), np.float32)
    normal[..., 2] = 1
    layers = {"albedo": np.full((*size, 3), 0.5, np.float32), "normal": normal}
    clean = Image(np.float32(0.4 + noise), layers=layers).denoised().pixels
    assert clean.shape == (*size, 3)
    assert clean == pytest.approx(0.4, rel=0.1)  # a single pixel is 6 % off


@pytest.mark.parametrize("suffix", [".exr", ".npz"])
def test_denoised_films_that_are_lit_anew_are_denoised_anew(suffix, tmp_path):
    """The clean film less lamps with their noise has that noise, with its sign turned."""
    pytest.importorskip("pyoidn")
    rng = np.random.default_rng(3)
    layers = {"albedo": np.full((48, 64, 3), 0.5, np.float32), "normal": np.zeros((48, 64, 3), np.float32)}
    layers |= {f"lights.{name}": np.float32(rng.exponential(0.4, (48, 64, 3))) for name in ("key", "fill")}
    Image(layers["lights.key"] + layers["lights.fill"], layers=layers).denoised().save(tmp_path / f"film{suffix}")
    film = rptcam_cl.develop(tmp_path / f"film{suffix}", ["lights.key=0.3"])
    dark = rptcam_cl.develop(film, ["lights.key=0", "lights.fill=0"])
    assert np.abs(dark.pixels).max() < 1e-6
    dim = rptcam_cl.develop(film, ["lights.fill=0.1"])  # beside 0.3 of the key, which stays so
    assert dim.pixels.mean() == pytest.approx(0.4 * 0.4, rel=0.1)
    assert dim.pixels[8:-8, 8:-8].std() < 0.02  # of the samples it is 0.13
