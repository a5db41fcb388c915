import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging import image as film_files
from rptcam_cl.imaging.development import quantise
from rptcam_cl.imaging.image import Image
from rptcam_cl.scene.film import PictureSettings, WhiteBalance
from rptcam_cl.viewfinder.instruments import PEAKING_COLOUR, peaking

Command = Callable[..., Any]


@pytest.fixture
def film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Image:
    """A film in a folder of its own, which is the working folder; its scene asks for another tone curve."""
    monkeypatch.chdir(tmp_path)
    pixels = np.random.default_rng(1).random((5, 7, 3), dtype=np.float32) * 3
    image = rptcam_cl.develop(Image(pixels, {"lens": "Tessar"}), tone="aces", white_balance="A")
    for name in ("film.exr", "film.npz"):
        image.save(name)
    return image


def codes(path: str) -> np.ndarray:
    with PIL.Image.open(path) as picture:
        return np.asarray(picture)


@pytest.mark.usefixtures("film")
def test_peaking_colours_what_is_sharp_and_nothing_else(rptcam: Command) -> None:
    film = Image(np.full((32, 48, 3), 0.1, np.float32), {})
    film.pixels[:, 24:] = 0.8
    film.save("edge.exr")
    words = ("develop", "edge.exr", "-o")
    assert rptcam(*words, "plain.png").code == rptcam(*words, "marked.png", "--peaking", "0.9").code == 0
    plain, marked = codes("plain.png"), codes("marked.png")
    sharp = peaking(film.seen, 0.9)
    assert 0 < sharp.mean() < 1
    assert (marked[sharp] == PEAKING_COLOUR[:3]).all() and np.array_equal(marked[~sharp], plain[~sharp])
    assert "takes no marks of what is sharp" in rptcam(*words, "marked.tif", "--peaking", "0.9").err


@pytest.mark.usefixtures("film")
def test_a_picture_with_marks_is_written_whole_or_not_at_all(rptcam: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("develop", "film.exr", "-o", "marked.png", "--peaking", "0.9")
    assert rptcam(*words).code == 0
    before = Path("marked.png").read_bytes()

    def fill_the_disk(picture: PIL.Image.Image, path: Path, form: str | None = None) -> None:
        Path(path).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(PIL.Image.Image, "save", fill_the_disk)
    assert "marked.png: cannot be written: No space left" in rptcam(*words).err
    assert Path("marked.png").read_bytes() == before


@pytest.mark.parametrize("name", ["film.exr", "film.npz"])
def test_film_develops_as_its_scene_says(rptcam: Command, film: Image, name: str) -> None:
    run = rptcam("develop", name, "-o", "a.png")
    assert (run.code, run.out, run.err) == (0, "", "wrote a.png: 7 x 5\n")
    film.save("rendered.png")
    assert Path("a.png").read_bytes() == Path("rendered.png").read_bytes()


def test_settings_can_be_replaced_one_by_one(rptcam: Command, film: Image) -> None:
    run = rptcam(
        "develop", "film.exr", "-o", "a.png", "-o", "a.tif", "--quiet", "--set", "picture.tone=reinhard",
        "--set", "picture.tone.white=9", "--set", "picture.ev=1", "--set", "picture.white_balance.gains=[1, 1, 2]",
    )  # fmt: skip
    assert run.code == 2
    assert "picture.tone: is 'reinhard' and has no keys" in run.err
    words = ["--set", "picture.tone={kind: reinhard, white: 9}", "--set", "picture.white_balance.gains=[1, 1, 2]"]
    assert rptcam("develop", "film.exr", "-o", "a.png", "-o", "a.tif", *words).code == 0
    same = rptcam_cl.develop(film, tone={"kind": "reinhard", "white": 9}, white_balance={"gains": [1, 1, 2]})
    assert same.development.tone.shown_white == 9
    assert np.array_equal(codes("a.png"), quantise(same.developed(), 8))
    assert np.array_equal(film.pixels, same.pixels)
    assert same.metadata["picture"] == {
        "tone": {"kind": "reinhard", "white": 9.0},
        "white_balance": {"gains": [1.0, 1.0, 2.0]},
    }


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["film.exr", "-o", "a.exr"],
            "a.exr: is no developed picture (got .exr; allowed: .png, .jpg, .jpeg, .tif, .tiff)",
        ),
        (["film.exr", "-o", "a.png", "--set", "camera.f_number=4"], "the film is there already"),
        (["film.exr", "-o", "a.png", "--set", "picture=agx"], "the film is there already"),
        (["film.exr", "-o", "a.png", "--set", "picture.tone=agy"], "did you mean agx?"),
        (["film.exr", "-o", "a.png", "--set", "picture.tone=filmic"], "did you mean aces?"),
        (["film.exr", "-o", "a.png", "--set", "picture.tone={kind: filmic}"], "did you mean aces?"),
        (["film.exr", "-o", "a.png", "--set", "picture.tne=agx"], "picture.tne: unknown key; did you mean tone?"),
        (["film.png", "-o", "a.png"], "film.png: is no linear film"),
        (["film.exr", "-o", "missing/a.png"], "there is no folder"),
    ],
)
def test_wrong_request_is_one_line(rptcam: Command, film: Image, words: list[str], message: str) -> None:
    run = rptcam("develop", *words)
    assert run.code in (2, 4)
    assert message in run.err
    assert run.err.count("\n") == 1
    assert not Path("a.png").exists()


@pytest.mark.parametrize("suffix", ["exr", "npz", "npy"])
def test_large_film_in_a_small_file_is_refused_by_its_head_unless_told(
    tmp_path: Path, rptcam: Command, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    path = tmp_path / f"film.{suffix}"
    Image(np.zeros((30, 40, 3), np.float32)).save(path)
    monkeypatch.setattr("rptcam_cl.imaging.image.LARGE", 30 * 40 - 1)
    words = ("develop", str(path), "-o", str(tmp_path / "a.png"))
    with monkeypatch.context() as unread:
        unread.setattr(film_files, "_exr", None)
        unread.setattr(film_files, "_numpy", None)
        run = rptcam(*words)
    assert run.code == 2 and re.search(r"has 0\.0012 million pixels .*--large", run.err), run.err
    assert rptcam(*words, "--large").code == 0
    monkeypatch.setattr("rptcam_cl.imaging.image.LARGE", 30 * 40)
    assert rptcam(*words).code == 0


def test_render_develops_as_the_scene_says(tmp_path: Path) -> None:
    scene = {
        "film": {"resolution": [6, 4]},
        "camera": {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40},
        "environment": {"kind": "constant", "radiance": [1.2, 1.0, 0.4]},
        "picture": {"tone": "agx", "white_balance": {"grey": [0.5, 0.5]}, "bits": 16},
    }
    image = rptcam_cl.render(scene, spp=1)
    assert image.metadata["picture"]["tone"] == {"kind": "agx"}
    assert image.development.bits == 16
    assert np.ptp(image.developed()) < 1e-5
    plain = rptcam_cl.render(scene | {"picture": {}}, spp=1)
    assert plain.development == PictureSettings()
    assert "picture" not in plain.metadata
    assert np.array_equal(plain.pixels, image.pixels)
    with pytest.raises(InputError, match=r"picture\.white_balance\.grey: lies outside the part of the film"):
        rptcam_cl.render(scene, spp=1, crop=(0.0, 0.4, 0.0, 1.0))


def test_python_develops_by_the_same_keys(film: Image) -> None:
    image = rptcam_cl.develop("film.npz", tone="srgb", white_balance={"temperature_k": 5000})
    assert image.development.white_balance == WhiteBalance(temperature_k=5000)
    assert image.development.tone.kind == "srgb"
    with pytest.raises(InputError, match=r"picture\.white_balance\.tint: needs temperature_k"):
        rptcam_cl.develop(image, white_balance={"light": "A", "tint": 3})
    with pytest.raises(InputError, match=r"picture\.white_balance\.adaptation: has no use beside gains"):
        rptcam_cl.develop(image, white_balance={"gains": [1, 1, 2], "adaptation": "bradford"})
    with pytest.raises(InputError, match=r"picture\.bits: is not a known choice \(got 9; allowed: 8, 16\)"):
        rptcam_cl.develop(image, bits=9)
    with pytest.raises(InputError, match=r"picture\.white_balance\.temperature_k: cannot be given together with light"):
        rptcam_cl.develop(image, white_balance={"light": "A", "temperature_k": 5000})


POSE = {"eye": [0, 0, 5], "target": [0, 0, 0], "focus_distance_m": 5}


def test_raw_file_of_a_film_is_that_of_its_picture_and_a_squeezed_one_is_widened(
    tmp_path: Path, rptcam: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = {
        "film": {"resolution": [6, 4], "width_mm": 36},
        "camera": {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 4, **POSE},
        "environment": {"kind": "constant", "radiance": 40},
        "exposure": {"mode": "physical", "iso": 100},
        "shutter": {"time_s": 0.01},
        "sensor": {},
    }
    image = rptcam_cl.render(scene, spp=1)
    image.save("film.exr")
    run = rptcam("develop", "film.exr", "-o", "a.png", "--raw", "a.npy")
    assert (run.code, run.err) == (0, "wrote a.png, a.npy: 6 x 4\n")
    np.testing.assert_array_equal(np.load("a.npy"), image.raw().numbers)
    run = rptcam("develop", "film.exr", "-o", "wide.png", "--desqueeze", "1.5")
    assert (run.code, run.err) == (0, "wrote wide.png: 9 x 4\n")
    run = rptcam("develop", "film.exr", "-o", "b.png", "--raw", "b.npy", "--desqueeze", "1.5")
    assert run.code == 2 and "--raw: is what the sensor counts, as it is squeezed" in run.err
    for raw, message in (("film.exr", "film.exr"), ("a.jpg", "a.jpg"), ("b.tif", "same file twice")):
        run = rptcam("develop", "film.exr", "-o", "b.tif", "--raw", raw)
        assert run.code in (2, 4) and message in run.err, run.err
    assert rptcam("develop", "film.exr", "-o", "c.png", "--quiet").err == ""
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npy", "a.png", "c.png", "film.exr", "wide.png"]
