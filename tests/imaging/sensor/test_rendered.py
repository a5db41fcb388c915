"""Rendered films through a sensor: photon transfer, physical numbers, files."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import rawpy

import rptcam_cl
from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import Session
from rptcam_cl.imaging.development import SensorModel, expose
from tests.imaging.sensor.sensors import photon_transfer
from tests.support.statistics import assert_equivalent

CAMERA = {
    "kind": "thin_lens", "eye": [0, 0, 5], "target": [0, 0, 0], "focal_length_mm": 50, "f_number": 4,
    "focus_distance_m": 5,
}  # fmt: skip
WALL: dict[str, Any] = {
    "camera": CAMERA,
    "environment": {"kind": "constant", "radiance": 1},
    "film": {"resolution": [512, 512], "pixel_pitch_um": 0.01},  # so near the axis that the field is even
    "exposure": {"mode": "physical", "iso": 100},
    "sensor": {
        "bayer": "monochrome", "quantum_efficiency": 0.5, "pixel_pitch_um": 4.0, "full_well_e": 12000,
        "read_noise_e": 7.0, "system_gain_dn_per_e": 1.2, "prnu": 0.01,
    },
}  # fmt: skip
SCENE = """\
film: {resolution: [12, 8], width_mm: 24}
camera: {kind: pinhole, eye: [0, 0, 5], target: [0, 0, 0], fov_degrees: 30}
environment: {kind: gradient, bottom: [0.1, 0.2, 0.3], top: [0.8, 0.6, 0.4]}
render: {spp: 4}
sensor: {full_well_e: 900}
"""


@pytest.mark.slow
def test_photon_transfer_of_a_rendered_flat_field_gives_back_what_was_put_in(session: Session) -> None:
    films: dict[float, rptcam_cl.Image] = {}

    def frame(level: float, seed: int) -> np.ndarray:
        if level not in films:
            shot = {**WALL, "shutter": {"time_s": level * 1e-3}} if level else {**WALL, "environment": None}
            films[level] = rptcam_cl.render(shot, spp=1, device=session)
        sensor = SensorModel.from_description(films[level].metadata["sensor"])
        return expose(films[level].pixels, replace(sensor, seed=seed))

    electrons_per_ms = exposed_electrons(1e-3)
    levels = [share * 12000 / electrons_per_ms for share in (0.02, 0.1, 0.25, 0.45, 0.7)]
    found = photon_transfer(frame, levels, 2 * 12000 / electrons_per_ms)
    for (value, error), put_in in ((found.gain, 1.2), (found.read_noise_e, 7.0), (found.full_well_e, 12000.0)):
        assert_equivalent(value, error, put_in, 0.02 * put_in)
    mean = (frame(levels[3], 0).mean() - 512) / 1.2
    assert mean == pytest.approx(0.45 * 12000, rel=0.002)  # photons by the closed form, through the lens


def exposed_electrons(time_s: float) -> float:
    """Electrons of a pixel behind a thin lens focused at 5 m before a field of radiance 1: light of three colours."""
    image_distance = 0.05 * 5 / (5 - 0.05)
    sine_squared = 1 / (1 + (image_distance / (0.05 / 8)) ** 2)
    photons = np.array([610e-9, 545e-9, 465e-9]).sum() / (6.62607015e-34 * 299792458.0)
    return float(0.5 * np.pi * sine_squared * 16e-12 * time_s * photons)


def test_picture_shows_the_raw_numbers_and_the_film_stays(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE, "utf-8")
    image = rptcam_cl.render(path, device=session)
    plain = rptcam_cl.render(rptcam_cl.load_scene(path, ["sensor=null"]), device=session)
    assert np.array_equal(image.pixels, plain.pixels)
    assert np.array_equal(plain.seen, plain.pixels)
    assert np.array_equal(image.seen, image.raw().linear())
    assert 0.005 < np.abs(image.seen - image.pixels).mean() < 0.05  # noise of 900 electrons at most
    image.save(tmp_path / "seen.png")
    plain.save(tmp_path / "film.png")
    assert (tmp_path / "seen.png").read_bytes() != (tmp_path / "film.png").read_bytes()
    image.save(tmp_path / "film.npy")
    assert np.array_equal(np.load(tmp_path / "film.npy"), image.pixels)
    with pytest.raises(InputError, match="the image has no raw numbers"):
        plain.raw()


def test_crop_has_its_part_of_the_mosaic(session: Session) -> None:
    shot = {**WALL, "film": {"resolution": [10, 10], "pixel_pitch_um": 0.01}, "sensor": {}, "shutter": {"time_s": 0.01}}
    whole = rptcam_cl.render(shot, spp=1, device=session).raw()
    part = rptcam_cl.render(shot, spp=1, crop=(0.3, 0.9, 0.2, 0.8), device=session).raw()
    assert (whole.sensor.pattern, part.sensor.pattern) == ("RGGB", "GRBG")
    assert part.numbers.shape == (6, 6)


def test_command_writes_raw_files_the_same_for_the_same_seed(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE, "utf-8")
    names = ("a.dng", "b.dng", "c.dng", "a.tif", "a.npy")
    for name, seed in zip(names, (3, 3, 4, 3, 3), strict=True):
        arguments = [
            "render",
            str(tmp_path / "scene.yaml"),
            "-o",
            str(tmp_path / "x.png"),
            "--seed",
            str(seed),
            "--size",
            "48x32",
        ]
        assert main([*arguments, "--raw", str(tmp_path / name)]) == 0
        assert name in capsys.readouterr().err
    first, second, other = ((tmp_path / name).read_bytes() for name in names[:3])
    assert first == second != other
    with rawpy.imread(str(tmp_path / "a.dng")) as file:
        assert np.array_equal(file.raw_image, np.load(tmp_path / "a.npy"))


@pytest.mark.parametrize("suffix", [".exr", ".npz"])
def test_saved_film_gives_the_same_picture_and_raw_file(tmp_path: Path, suffix: str) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE, "utf-8")
    film, names = (
        str(tmp_path / f"film{suffix}"),
        [str(tmp_path / name) for name in ("a.png", "a.npy", "b.png", "b.npy")],
    )
    assert main(["render", str(tmp_path / "scene.yaml"), "-o", names[0], "-o", film, "--raw", names[1]]) == 0
    assert main(["develop", film, "-o", names[2], "--raw", names[3]]) == 0
    assert Path(names[1]).read_bytes() == Path(names[3]).read_bytes()
    with PIL.Image.open(names[0]) as first, PIL.Image.open(names[2]) as second:
        assert np.array_equal(np.asarray(first), np.asarray(second))


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (["--raw", "x.png"], "the suffix sets the raw format"),
        (["--raw", "x.dng", "--set", "sensor=null"], "--raw: the scene has no sensor"),
        (["--raw", "nowhere/x.dng"], "there is no folder"),
        (["--size", "1x5"], "sensor.bayer: a mosaic needs more pixels (got 1 x 5; allowed: at least 2 x 2, or"),
        (["--crop", "0,0.1,0,1"], "sensor.bayer: a mosaic needs more pixels (got 1 x 8"),
        (["--raw", "x.dng", "--raw", "x.dng"], "-o, --raw: the same file twice"),
    ],
)
def test_command_refuses_raw_files_before_rendering(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any, extra: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text(SCENE, "utf-8")
    assert main(["render", "scene.yaml", "-o", "o.png", *extra]) in (2, 4)
    captured = capsys.readouterr().err
    assert message in captured and "Traceback" not in captured
    assert [path.name for path in Path().iterdir()] == ["scene.yaml"]
