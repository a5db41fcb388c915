"""Film and sensor formats by name, and films by the pitch of their pixels."""

import math
import re
from pathlib import Path
from typing import Any, get_args

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.film import SIDES_MM, Film, _Name
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

CAMERA = {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40}


def film(**keys: Any) -> Film:
    scene: Scene = load_scene({"camera": CAMERA, "environment": {"kind": "constant", "radiance": 1}, "film": keys})
    return scene.film


def test_names_of_the_table_and_of_the_model_are_the_same() -> None:
    assert get_args(_Name) == tuple(SIDES_MM)
    assert all(longer >= shorter > 0 for longer, shorter in SIDES_MM.values())


@pytest.mark.parametrize(
    ("name", "resolution", "size_mm"),
    [
        ("full_frame", (3000, 2000), (36, 24)),
        ("full_frame", (1920, 1080), (36, 20.25)),
        ("full_frame", (1080, 1920), (20.25, 36)),
        ("full_frame", (100, 100), (24, 24)),
        ("micro_four_thirds", (400, 300), (17.3, 12.975)),
        ("6x6", (3000, 2000), (56, 112 / 3)),
        ("1/2.3_inch", (617, 455), (6.17, 4.55)),
        (645, (560, 415), (56, 41.5)),
    ],
)
def test_format_holds_the_largest_picture_of_square_pixels(
    name: str | int, resolution: tuple[int, int], size_mm: tuple[float, float]
) -> None:
    width, height = film(format=name, resolution=resolution).size_m()
    assert (width * 1e3, height * 1e3) == pytest.approx(size_mm)
    assert width / resolution[0] == pytest.approx(height / resolution[1])


def test_pixel_pitch_gives_the_size() -> None:
    assert film(pixel_pitch_um=4.5, resolution=[6000, 4000]).size_m() == pytest.approx((0.027, 0.018))
    assert film(pixel_pitch_um=4.5, resolution=[6000, 4000]).diagonal_m() == pytest.approx(math.hypot(0.027, 0.018))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"format": "fullframe"}, "film.format: is not a known choice; did you mean full_frame?"),
        ({"format": 35}, "film.format: is not a known choice"),
        ({"format": "aps_c", "width_mm": 36}, "film.width_mm: cannot be given together with format"),
        ({"pixel_pitch_um": 4, "diagonal_mm": 43}, "film.pixel_pitch_um: cannot be given together with diagonal_mm"),
        ({"pixel_pitch_um": 0}, "film.pixel_pitch_um: is out of range"),
    ],
)
def test_bad_formats_are_refused(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        film(**keys)
    assert message in str(caught.value)


def test_documentation_lists_every_format(checkout: Path) -> None:
    text = (checkout / "docs" / "sensor.md").read_text("utf-8")
    rows = re.findall(r"`([^`]+)` \| ([\d.]+) x ([\d.]+) ", text)
    assert {name: (float(longer), float(shorter)) for name, longer, shorter in rows} == SIDES_MM
