"""The examples: every scene renders, and every picture of the gallery has its command, its scene and its size."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image

import rptcam_cl
from rptcam_cl.cli import build_parser

ROOT = Path(__file__).resolve().parents[2]
SCENES = sorted((ROOT / "examples").rglob("*.yaml"))
LARGEST_PICTURE = 150_000  # bytes; the page shows two dozen


def load_gallery() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_gallery", ROOT / "examples" / "make_gallery.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PAGE = (ROOT / "examples" / "README.md").read_text("utf-8")
COMMANDS = load_gallery().commands(PAGE)


def picture_of(arguments: list[str]) -> str:
    return arguments[arguments.index("-o") + 1]


def name_of(arguments: list[str]) -> str:
    return Path(picture_of(arguments)).stem


def shows_something(image: rptcam_cl.Image) -> bool:
    pixels = np.asarray(image)
    return bool(np.isfinite(pixels).all() and pixels.mean() > 0.01 and pixels.std() > 0.01)


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_example_shows_something(path: Path) -> None:
    scene = rptcam_cl.load_scene(path)
    width, height = scene.film.resolution
    assert shows_something(rptcam_cl.render(scene, spp=2, size=(width // 15, height // 15)))


def test_gallery_shows_the_picture_of_every_command() -> None:
    shown = re.findall(r"!\[[^]]+\]\(\.\./([^)]+)\)", PAGE)
    assert shown == [picture_of(arguments) for arguments in COMMANDS]
    assert len(set(shown)) == len(shown) > 15


@pytest.mark.parametrize("arguments", COMMANDS, ids=name_of)
def test_command_of_the_gallery_parses_and_its_files_exist(arguments: list[str]) -> None:
    parsed, unknown = build_parser().parse_known_args(arguments)
    assert unknown == []
    scene = rptcam_cl.load_scene(ROOT / parsed.scene, parsed.overrides)
    path = ROOT / picture_of(arguments)
    with Image.open(path) as picture:
        assert picture.size == (parsed.size or scene.film.resolution)
        assert picture.width <= 320
    assert path.stat().st_size < LARGEST_PICTURE


@pytest.mark.slow
@pytest.mark.parametrize("arguments", COMMANDS, ids=name_of)
def test_command_of_the_gallery_shows_something(arguments: list[str]) -> None:
    parsed = build_parser().parse_args(arguments)
    scene = rptcam_cl.load_scene(ROOT / parsed.scene, parsed.overrides)
    width, height = scene.film.resolution
    assert shows_something(rptcam_cl.render(scene, spp=8, size=(width // 5, height // 5)))


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)#]+)\)", PAGE))
def test_links_of_the_gallery_lead_to_files(link: str) -> None:
    assert (ROOT / "examples" / link).exists()
