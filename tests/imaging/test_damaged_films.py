"""Whatever is done to a saved film or to its metadata, developing it ends in a picture or in one line."""

import json
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging import writers
from rptcam_cl.imaging.image import Image, read_film
from rptcam_cl.scene.film import PictureSettings, WhiteBalance

SUFFIXES = (".exr", ".npy", ".npz")
ODD = (None, True, -1, 1e300, "", "x" * 50, [], [[]], {}, [1, 2, 3, 4], {"a": [1]}, [None] * 4, float("nan"))
METADATA: dict[str, Any] = {
    "f_number": 2.8, "window": [0, 0, 9, 6], "resolution": [9, 6], "lens": "x", "iso": 100, "film_size_mm": [36, 24],
    "spectrum": "rgb", "picture": {"tone": "agx"}, "marked_zones": [[0.1, 0.4, 0.2, 0.6]],
    "sensor": {"electrons": [[900.0, 0, 0], [0, 900, 0], [0, 0, 900]], "full_well_e": 1000.0, "read_noise_e": 2.0,
               "system_gain_dn_per_e": 4.0, "black_level_dn": 64.0, "bit_depth": 12, "bayer": "RGGB", "origin": [0, 0]},
}  # fmt: skip


def saved(folder: Path, suffix: str, metadata: dict[str, Any]) -> Path:
    """A film in a file."""
    pixels = np.random.default_rng(2).random((6, 9, 3), dtype=np.float32)
    path = folder / f"film{suffix}"
    Image(pixels, metadata).save(path)
    return path


def damaged(whole: bytes, random: np.random.Generator) -> bytes:
    """The bytes with a few of them replaced, removed, doubled or cut off."""
    content = bytearray(whole)
    for _ in range(random.integers(1, 5)):
        place = int(random.integers(len(content) + 1))
        match random.integers(5):
            case 0:
                content[place : place + 1] = random.bytes(1)
            case 1:
                del content[place : place + int(random.integers(1, 30))]
            case 2:
                content[place:place] = random.bytes(int(random.integers(1, 9)))
            case 3:
                content[place : place + 4] = b"\xff" * 4
            case 4 if random.integers(3) == 0:
                del content[place:]
    return bytes(content)


def develop_anyhow(path: Path, capsys: pytest.CaptureFixture[str]) -> int:
    """Develop by the command; its exit code is one of a user's mistakes and its errors are one line."""
    code = main(["develop", str(path), "-o", str(path.with_name("out.png")), "--quiet"])
    said = capsys.readouterr().err
    assert code in (0, 2, 4), said
    assert "Traceback" not in said
    assert code == 0 or len([line for line in said.splitlines() if line.startswith("error:")]) >= 1
    return code


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_damaged_film_is_developed_or_refused(
    tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str], count: int = 40
) -> None:
    path = saved(tmp_path, suffix, METADATA)
    whole, random = path.read_bytes(), np.random.default_rng(len(suffix) + ord(suffix[-1]))
    codes = set()
    for _ in range(count):
        path.write_bytes(damaged(whole, random))
        codes.add(develop_anyhow(path, capsys))
    assert 2 in codes


def replaced(value: Any, random: np.random.Generator) -> Any:
    """A copy of plain data with an odd value somewhere inside."""
    if isinstance(value, dict) and value and random.integers(4):
        key = list(value)[int(random.integers(len(value)))]
        return value | {key: replaced(value[key], random)}
    if isinstance(value, list) and value and random.integers(3):
        place = int(random.integers(len(value)))
        return [*value[:place], replaced(value[place], random), *value[place + 1 :]]
    return ODD[int(random.integers(len(ODD)))]


def test_wrong_metadata_are_left_out_or_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], count: int = 60
) -> None:
    random = np.random.default_rng(5)
    for _ in range(count):
        metadata = json.dumps(replaced(METADATA, random))
        np.savez(tmp_path / "film.npz", rgb=np.ones((6, 9, 3), np.float32), metadata=np.array(metadata))
        develop_anyhow(tmp_path / "film.npz", capsys)


@pytest.mark.parametrize(
    ("key", "value"),
    [("full_well_e", "much"), ("bit_depth", 12.5), ("bit_depth", 400), ("bayer", "XYZW"), ("electrons", None),
     ("origin", [-1, 0]), ("read_noise_e", -1), ("seed", [1]), ("demosaic", "none"), ("colour", 1)],
)  # fmt: skip
def test_wrong_sensor_is_refused_in_one_line(key: str, value: Any) -> None:
    image = Image(np.ones((6, 9, 3), np.float32), METADATA | {"sensor": METADATA["sensor"] | {key: value}})
    with pytest.raises(InputError, match="the metadata describe no sensor"):
        image.raw()


def test_large_film_in_a_small_file_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    head = b"{'descr': '<f4', 'fortran_order': False, 'shape': (4000000, 1000000, 3), }"
    start = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head
    with zipfile.ZipFile(tmp_path / "film.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("rgb.npy", start + bytes(1000))
    (tmp_path / "film.npy").write_bytes(start)
    for name in ("film.npz", "film.npy"):
        with pytest.raises(InputError, match=r"takes 1\.44e\+05 GB to develop, and .* GB of memory are free"):
            read_film(tmp_path / name)


def test_film_developed_in_bands_is_the_same_as_in_one(monkeypatch: pytest.MonkeyPatch) -> None:
    module = sys.modules["rptcam_cl.imaging.development"]  # the package has a function of the same name
    pixels = np.random.default_rng(3).random((50, 20, 3), dtype=np.float32) * 3
    for picture in (
        PictureSettings(tone="agx"),
        PictureSettings(white_balance=WhiteBalance(light="auto"), gamut="desaturate"),
    ):
        whole = module.developed_values(pixels, picture)
        monkeypatch.setattr(module, "BAND_PIXELS", 7 * 20)
        np.testing.assert_allclose(module.developed_values(pixels, picture), whole, rtol=0, atol=2e-7)
        codes = writers.developed_codes(pixels, picture, (0, 1, 0, 1), 16)
        np.testing.assert_allclose(codes, whole * 65535, atol=0.6)
        monkeypatch.undo()
