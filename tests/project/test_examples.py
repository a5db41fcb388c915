"""The examples: every scene renders, and every picture of the gallery has its command, its scene and its size."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import yaml
from PIL import Image

import rptcam_cl
from rptcam_cl.cli import build_parser
from rptcam_cl.exchange.pbrt.convert import convert_scene
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.plan.primitives import mesh_parts
from rptcam_cl.scene.assets.mesh import MeshPlacement
from rptcam_cl.scene.meshes import MeshObject

ROOT = Path(__file__).resolve().parents[2]
SCENES = sorted(path for path in (ROOT / "examples").rglob("*.yaml") if "\nvary:" not in path.read_text("utf-8"))
STUDIO = ROOT / "examples" / "studio"
LARGEST_PICTURE = 800_000  # bytes; the page shows three dozen
SHOWN = {"first_light"}  # programs of their own take the others seconds each
FOCUSED_FIRST = {path.stem for path in SCENES if "focus: {auto:" in path.read_text("utf-8")}  # no plan before autofocus


def load_script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PAGE = (ROOT / "examples" / "README.md").read_text("utf-8")
COMMANDS = load_script("make_gallery").commands(PAGE)
FINE = ["python", "examples/render_fine.py"]  # takes a part of the options of `rptcam render`
RENDERS = [["render", *words[2:]] for words in COMMANDS if words[:2] in (["rptcam", "render"], FINE)]


def picture_of(words: list[str]) -> str:
    """Return the picture that a command makes, or an empty text."""
    if "-o" in words:
        return words[words.index("-o") + 1]
    return next((word for word in words if word.endswith(".png")), "")


def name_of(arguments: list[str]) -> str:
    return Path(picture_of(arguments)).stem


def shows_something(image: rptcam_cl.Image) -> bool:
    pixels = np.asarray(image)
    return bool(np.isfinite(pixels).all() and pixels.mean() > 0.01 and pixels.std() > 0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", [path for path in SCENES if path.stem not in SHOWN | FOCUSED_FIRST], ids=lambda path: path.stem
)
def test_example_can_be_planned(path: Path) -> None:
    """All that goes before kernels are compiled."""
    assert len(make_plan(rptcam_cl.load_scene(path)).primitives) > 0


def test_examples_that_are_shown_exist() -> None:
    assert {path.stem for path in SCENES} >= SHOWN


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=() if path.stem in SHOWN else pytest.mark.slow) for path in SCENES],
    ids=lambda path: path.stem,
)
def test_example_shows_something(path: Path) -> None:
    scene = rptcam_cl.load_scene(path)
    width, height = scene.film.resolution
    assert shows_something(rptcam_cl.render(scene, spp=2, size=(width // 15, height // 15)))


def test_gallery_shows_the_picture_of_every_command() -> None:
    shown = re.findall(r"!\[[^]]+\]\(\.\./([^)]+)\)", PAGE)
    assert shown == [picture for picture in map(picture_of, COMMANDS) if picture]
    assert len(set(shown)) == len(shown) > 15


@pytest.mark.slow
def test_commands_of_the_gallery_parse_and_their_files_exist() -> None:
    parser = build_parser()
    for arguments in RENDERS:
        parsed, unknown = parser.parse_known_args(arguments)
        assert unknown == []
        scene = rptcam_cl.load_scene(ROOT / parsed.scene, parsed.overrides)
        path = ROOT / picture_of(arguments)
        with Image.open(path) as picture:
            size, crop = parsed.size or scene.film.resolution, scene.film.crop or (0, 1, 0, 1)
            wanted = (size[0] * (crop[1] - crop[0]), size[1] * (crop[3] - crop[2]))
            assert np.abs(np.subtract(picture.size, wanted)).max() <= (1 if scene.film.crop else 0), path
            assert picture.width <= 1920, path
        assert path.stat().st_size < LARGEST_PICTURE, path


@pytest.mark.slow
@pytest.mark.parametrize("arguments", RENDERS, ids=name_of)
def test_command_of_the_gallery_shows_something(arguments: list[str]) -> None:
    parsed = build_parser().parse_args(arguments)
    scene = rptcam_cl.load_scene(ROOT / parsed.scene, parsed.overrides)
    width, height = scene.film.resolution
    assert shows_something(rptcam_cl.render(scene, spp=8, size=(width // 5, height // 5)))


def test_a_rim_that_is_averaged_after_the_curve_has_no_steps() -> None:
    """Of a pixel a quarter of which is 50 times white, a quarter of white is shown; its mean light would be white."""
    averaged = load_script("render_fine").averaged
    film = np.full((4, 6, 3), 0.2, np.float32)
    film[0, 0] = 50
    picture = averaged(rptcam_cl.Image(film))
    assert (picture.width, picture.height) == (3, 2)
    assert np.asarray(picture)[0, 0] == pytest.approx((1 + 3 * 0.2) / 4, abs=1e-6)
    assert np.asarray(picture)[1, 2] == pytest.approx(0.2, abs=1e-6)


def test_page_names_only_commands_that_there_are() -> None:
    for words in COMMANDS:
        assert words[0] in ("rptcam", "python")
        assert words[0] == "rptcam" or (ROOT / words[1]).is_file()


def test_scene_of_pbrt_is_what_its_conversion_gives(tmp_path: Path) -> None:
    conversion = convert_scene(ROOT / "examples" / "still_life.pbrt", tmp_path / "still_life.yaml")
    conversion.write(tmp_path / "still_life.yaml")
    kept = ROOT / "examples" / "still_life.yaml"
    made, wanted = (yaml.safe_load(path.read_text("utf-8")) for path in (tmp_path / "still_life.yaml", kept))
    assert_alike(made, wanted)
    with pytest.raises(AssertionError, match=r"camera: fov_degrees"):
        assert_alike(
            made | {"camera": made["camera"] | {"fov_degrees": 1.0001 * made["camera"]["fov_degrees"]}}, wanted
        )


def assert_alike(made: object, wanted: object, key: str = "scene") -> None:
    """The same data, numbers to a part in 10^9: the last digits of a sine depend on the processor."""
    if isinstance(wanted, dict):
        assert isinstance(made, dict)
        assert list(made) == list(wanted), key
        for name, item in wanted.items():
            assert_alike(made[name], item, f"{key}: {name}")
    elif isinstance(wanted, list):
        assert isinstance(made, list)
        assert len(made) == len(wanted), key
        for first, second in zip(made, wanted, strict=True):
            assert_alike(first, second, key)
    elif isinstance(wanted, float):
        assert made == pytest.approx(wanted, rel=1e-9, abs=1e-12), key
    else:
        assert made == wanted, key


@pytest.mark.slow
def test_studio_is_what_its_script_makes(tmp_path: Path) -> None:
    """Meshes to a rounding step and pictures to the coding of another Pillow; a shifted vertex or colour shows."""
    subprocess.run([sys.executable, STUDIO / "make_studio.py", tmp_path], check=True)
    made = {path.name for path in tmp_path.iterdir()}
    assert made == {path.name for path in STUDIO.iterdir() if path.suffix not in (".py", ".yaml", "")}
    for name in sorted(made):
        ours, kept = tmp_path / name, STUDIO / name
        if ours.suffix in (".jpg", ".png"):
            with Image.open(ours) as first, Image.open(kept) as second:
                difference = np.asarray(first, float) - np.asarray(second, float)
            assert np.abs(difference).mean() < 0.5, name
        else:
            first_bytes, second_bytes = (np.frombuffer(path.read_bytes(), np.uint8) for path in (ours, kept))
            assert len(first_bytes) == len(second_bytes), name
            assert (first_bytes != second_bytes).mean() < 0.02, name


def test_studio_holds_what_it_is_shown_for() -> None:
    def parts_of(scene: str, name: str) -> tuple[MeshPlacement, ...]:
        loaded = rptcam_cl.load_scene(STUDIO / scene)
        (item,) = (item for item in loaded.objects if item.name == name)
        assert isinstance(item, MeshObject)
        return mesh_parts(loaded, item)

    (knot,) = parts_of("tea_table.yaml", "knot")
    assert len(knot.mesh.faces) == 102_144
    tea_set = parts_of("tea_table.yaml", "tea set")  # two saucers, and two cups of china, handle and tea
    assert len(tea_set) == 8 and len({id(part.mesh) for part in tea_set}) == 4
    assert any(part.material.opacity != 1.0 for part in parts_of("tea_table.yaml", "bouquet"))
    stones = parts_of("standing_stones.yaml", "stones")
    assert len(stones) == 1170 and len({id(part.mesh) for part in stones}) == 4
