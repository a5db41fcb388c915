"""Every fenced block of README and docs runs to its end, as it stands: page by page, in a copy of the examples.

YAML whose first line is a comment with a file's name is saved under it. Pictures that commands make have few pixels
and samples, and times and frames are short (`tests.support.pages.reduced`); programs run as they are. Other YAML and
JSON are checked by `test_blocks.py`.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rptcam_cl.cli import build_parser, main
from rptcam_cl.scene.load import load_scene
from tests.support.pages import ROOT, all_blocks, reduced

BLOCKS = [block for block in all_blocks("sh", "python", "yaml") if block.why is None]
FOLDERS = ("docs/images/figures", "docs/images/gallery")  # that commands write to


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with the examples and the folders of pictures, as the checkout has them."""
    for name in ("examples", "lenses", "benchmarks"):
        shutil.copytree(ROOT / name, tmp_path / name)
    for name in FOLDERS:
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "tests").symlink_to(ROOT / "tests")  # data of benchmarks
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{ROOT}")
    yield tmp_path


def film_of(words: list[str]) -> tuple[int, int] | None:
    """Size of the film of a command's scene, where it has one."""
    options, _ = build_parser().parse_known_args(words)
    scene = getattr(options, "scene", None)
    if scene is None or words[0] not in ("render", "sweep"):
        return None
    return load_scene(scene, options.overrides if words[0] == "render" else ()).film.resolution


def run_command(words: list[str]) -> int:
    if words[0] != "rptcam":
        program = sys.executable if words[0] == "python" else words[0]
        return subprocess.run([program, *words[1:]], check=False).returncode
    return main(reduced(words[1:], (32, 18) if words[1] == "demo" else film_of(words[1:])))


@pytest.mark.slow
@pytest.mark.parametrize("page", sorted({block.page for block in BLOCKS}))
def test_blocks_of_page_run_in_their_order(page: str, place: Path) -> None:
    for block in (block for block in BLOCKS if block.page == page):
        if block.language == "python":
            exec(compile(block.text, block.name, "exec"), {"__name__": "__main__"})
        elif (name := block.saved_as()) is not None:
            Path(name).write_text(block.text, "utf-8")
        elif block.language == "sh":
            for words in block.commands():
                assert run_command(words) == 0, (block.name, words)
