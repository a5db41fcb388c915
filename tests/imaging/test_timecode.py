"""The time of a frame in EXR files, by the library's own types."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from rptcam_cl.imaging.image import Image, read_film


def header_of(path: Path, **metadata: object) -> dict[str, object]:
    Image(np.zeros((4, 4, 3), np.float32), dict(metadata)).save(path)
    with OpenEXR.File(str(path)) as file:
        return dict(file.header())


def test_frames_have_smpte_time_codes(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    header = header_of(path, frame=90_000, timecode="01:02:29:23", frames_per_second=24.0)
    code = header["timeCode"]
    assert (code.hours, code.minutes, code.seconds, code.frame) == (1, 2, 29, 23)  # type: ignore[attr-defined]
    assert not code.dropFrame  # type: ignore[attr-defined]
    assert b"timeCode\x00timecode\x00\x08\x00\x00\x00\x23\x29\x02\x01" in path.read_bytes()  # two digits a byte
    assert header["framesPerSecond"] == Fraction(24)
    assert read_film(path).metadata["timecode"] == "01:02:29:23"


@pytest.mark.parametrize(("rate", "wanted"), [(24000 / 1001, Fraction(24000, 1001)), (12.5, Fraction(25, 2))])
def test_frame_rates_are_rational(tmp_path: Path, rate: float, wanted: Fraction) -> None:
    assert header_of(tmp_path / "a.exr", timecode="00:00:00:00", frames_per_second=rate)["framesPerSecond"] == wanted


@pytest.mark.parametrize("code", ["00:00:00:48", "30:00:00:00", "now"])
def test_what_smpte_cannot_say_is_text_alone(tmp_path: Path, code: str) -> None:
    header = header_of(tmp_path / "a.exr", timecode=code, frames_per_second=60.0)
    assert "timeCode" not in header
    assert header["timecode"] == code
