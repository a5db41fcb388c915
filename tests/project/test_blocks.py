"""Every fenced block of README and docs is sound: commands find their files, programs their names, YAML loads.

`test_blocks_run.py` runs them all, as they stand, in the slow suite.
"""

import importlib
import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.batch.dataset import read_specification
from rptcam_cl.cli import build_parser
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.optics.design import read_problem
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.tolerances import specification
from rptcam_cl.scene.load import Missing, load_scene
from rptcam_cl.scene.scene import Scene
from tests.support.pages import (
    FENCE,
    LANGUAGES,
    PROGRAMS,
    ROOT,
    Block,
    all_blocks,
    blocks_of,
    imports,
    pages,
    reduced,
    undefined_names,
)

UNDER = ROOT / "examples" / "first_light.yaml"  # the scene that a piece of a scene is laid over
# Options that name results.
WRITES = {
    "report", "state", "write",
    "output", "outputs", "raws", "stats", "plot", "json", "markdown", "target", "video", "truth",
    "opencv", "ros", "colmap", "openlensio", "osl", "usd", "left", "right", "phase_pixels", "screen",
}  # fmt: skip
READS_LATER = {"tls"}  # files of the reader's own
# Why a block may stay on paper; what else it says is checked all the same.
REASONS = {
    "downloads wheels",
    "leaves a process behind",
    "takes several machines",
    "takes several devices",
    "takes docker",
    "takes the extra denoise",
    "takes the extra ocio",
    "takes compilers for GPUs",
    "takes a minute of a device",
    "serves until Ctrl-C",
}


def named(blocks: list[Block]) -> list[Any]:
    return [pytest.param(block, id=block.name) for block in blocks]


def test_every_fence_is_a_block_in_a_known_language() -> None:
    for page in pages():
        text = (ROOT / page).read_text("utf-8")
        assert 2 * len(FENCE.findall(text)) == sum(line.lstrip().startswith("```") for line in text.splitlines()), page
    blocks = all_blocks()
    assert len(blocks) > 90
    assert [block.name for block in blocks if block.language not in LANGUAGES] == []
    assert {block.why for block in blocks} - {None} <= REASONS


def test_commands_parse_and_their_files_exist_or_are_made_before() -> None:
    parser, made_by_page = build_parser(), dict[str, set[str]]()
    for block in all_blocks("sh", "yaml"):
        made = made_by_page.setdefault(block.page, set())
        if name := block.saved_as():
            made.add(name)
        elif block.language == "sh":
            for words in block.commands():
                if words[0] == "cp":
                    assert [name for name in words[1:-1] if not (ROOT / name).is_file()] == [], block.name
                    made.update(f"{words[-1]}/{Path(name).name}" for name in words[1:-1])
                elif words[0] == "python":
                    assert program_exists(words), (block.name, words)
                elif words[0] == "rptcam":
                    options, unknown = parser.parse_known_args(words[1:])
                    assert unknown == [], (block.name, words)
                    check_files(vars(options), made, block.name)


def program_exists(words: list[str]) -> bool:
    """Whether a file or module that Python is to run is there."""
    return importlib.util.find_spec(words[2]) is not None if words[1] == "-m" else (ROOT / words[1]).is_file()


def check_files(options: dict[str, Any], made: set[str], where: str) -> None:
    """Check that a command's scene loads with its changes and its other files are there; note what it makes."""
    scene, lens = options.get("scene"), options.get("lens")
    if isinstance(scene, Path) and options["command"] != "new" and not is_made(scene, made):
        load_scene(ROOT / scene, options.get("overrides", []))
    if lens is not None and lens not in made:
        load_lens(ROOT / lens if "/" in lens else lens)
    for name, value in options.items():
        paths = [path for path in (value if isinstance(value, list) else [value]) if isinstance(path, Path)]
        if name in WRITES or (name, options["command"]) == ("scene", "new"):
            made.update(map(str, paths))
        elif name not in READS_LATER:
            assert [path for path in paths if not is_made(path, made) and not (ROOT / path).exists()] == [], where


def is_made(path: Path, made: set[str]) -> bool:
    """Whether a command or block before makes this file, or its folder."""
    return not made.isdisjoint({str(path), str(path.parent)} - {"."})


def test_programs_compile_and_find_their_imports_and_names() -> None:
    for block in all_blocks("python"):
        assert undefined_names(block.text) == set(), block.name
        for module, name in imports(block.text):
            found = importlib.import_module(module)
            there = name is None or hasattr(found, name) or importlib.util.find_spec(f"{module}.{name}")
            assert there, (block.name, module, name)


@pytest.mark.parametrize("block", named(all_blocks("yaml")))
def test_yaml_is_a_scene_or_a_piece_of_one_or_a_lens_or_tolerances(block: Block) -> None:
    content = read_yaml(block.text.encode(), block.name).data
    if block.why is not None:
        return
    if "surfaces" in content:
        assert load_lens(content).surfaces
    elif "vary" in content:
        assert read_specification(content).vary
    elif "variables" in content:
        assert read_problem(content).variables
    elif "tolerances" in content:
        assert specification(content)
    else:
        assert content.keys() <= Scene.model_fields.keys()
        whole = "camera" in content and ("objects" in content or "environment" in content)
        missing: Missing = "grey" if block.saved_as() else "error"  # its page copies the files beside it
        load_scene(content if whole else laid_over(content, read_yaml(UNDER).data), missing=missing)


def test_the_scene_of_the_readme_renders() -> None:
    (block,) = (each for each in all_blocks("yaml") if each.name.startswith("README"))
    scene = load_scene(read_yaml(block.text.encode(), block.name).data)
    image = np.asarray(rptcam_cl.render(scene, size=(64, 36), spp=1))
    assert np.isfinite(image).all() and image.mean() > 0


def laid_over(piece: dict[str, Any], under: dict[str, Any]) -> dict[str, Any]:
    """A scene with the keys of a piece in the place of its own; a camera that says not where it stands is joined."""
    if "eye" not in piece.get("camera", {"eye"}):
        piece = piece | {"camera": under["camera"] | piece["camera"]}
    return under | piece


def test_json_parses() -> None:
    for block in all_blocks("json"):
        json.loads(block.text)


PAGE = """
```sh
rptcam render a.yaml \\
    -o b.png  # a comment
pip install c
```

<!-- not run: takes several machines -->
```python
print(d)
```
"""


def test_blocks_commands_and_missing_names_are_found() -> None:
    shell, program = blocks_of("page.md", PAGE)
    assert (shell.name, shell.language, shell.why) == ("page.md:2", "sh", None)
    assert shell.commands() == [["rptcam", "render", "a.yaml", "-o", "b.png"]]
    assert (program.line, program.why) == (9, "takes several machines")
    assert undefined_names(program.text) == {"d"}
    assert undefined_names("import os.path as p\nfor x in p.sep: print([y for y in x], (lambda z: z)(x))") == set()
    assert list(imports("from json import dumps\nimport rptcam_cl\nrptcam_cl.render")) == [
        ("json", "dumps"), ("rptcam_cl", None), ("rptcam_cl", "render"),
    ]  # fmt: skip
    assert set(PROGRAMS) == {"rptcam", "python", "mkdir", "cp"}


def test_pictures_of_tests_are_small_and_of_the_same_shape() -> None:
    words = ["render", "a.yaml", "-o", "b.png", "--size", "640x480", "--spp", "512"]
    assert reduced(words, (1920, 1080)) == [*words[:4], "--spp", "2", "--size", "64x48"]
    assert reduced(["render", "a.yaml", "--time", "60s"], (32, 18)) == [
        "render", "a.yaml", "--time", "1s", "--size", "32x18", "--spp", "2",
    ]  # fmt: skip
    assert reduced(["lens", "info", "dgauss-50mm"], None) == ["lens", "info", "dgauss-50mm"]
