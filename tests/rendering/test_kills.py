"""Renders, parts, sweeps and sequences that are killed at random moments: no file is damaged, no picture another.

Temporary files of a killed process may stay until the next write; files with their own names are whole at any moment.
"""

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.imaging.image import read_film
from rptcam_cl.rendering.checkpoint import read_checkpoint
from tests.rendering.pictures import seed_of
from tests.rendering.test_world import still_life

KILLS = 10  # of each kind, by turns with every signal
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
SIZE = "160x120"
PROGRAM = """
import sys
from rptcam_cl.rendering import checkpoint
checkpoint.INTERVAL = 0.0
from rptcam_cl.cli import main
sys.exit(main(sys.argv[1:]))
"""
RENDER = ["render", "scene.json", "--size", SIZE, "--resume", "--quiet"]
COMMANDS = {
    "render": [*RENDER, "--spp", "400", "-o", "a.exr"],
    "part": [*RENDER, "--spp", "400", "--part", "1/2", "-o", "1.rpck"],
    "sweep": [
        "sweep",
        "scene.json",
        "--over",
        "picture.ev=0,1,2,3,4,5,6,7",
        "--size",
        SIZE,
        "--spp",
        "40",
        "-o",
        "out",
    ],
    "frames": [*RENDER, "--spp", "40", "--frames", "1-8", "-o", "out.##.exr"],
}


def started(folder: Path, words: list[str]) -> subprocess.Popen:
    root = Path(__file__).resolve().parents[2]
    program = f"import sys; sys.path.insert(0, {str(root)!r})\n{PROGRAM}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([sys.executable, "-c", program, *words], cwd=folder, **quiet)


def check_files(folder: Path) -> None:
    """Every file that has a name of its own can be read."""
    readers = {".rpck": read_checkpoint, ".exr": read_film, ".json": lambda path: json.loads(path.read_text())}
    for path in folder.rglob("*"):
        if path.is_file() and not path.name.startswith("."):
            readers.get(path.suffix, lambda path: None)(path)


def killed(folder: Path, words: list[str], clean: list[str]) -> int:
    """Kill a command at random moments until that has hit it so often; return how often it had come to its end."""
    rng, kills, ends, longest = np.random.default_rng(seed_of(words[0] + words[-1])), 0, 0, 4.0
    while kills < KILLS:
        process = started(folder, words)
        try:
            process.wait(rng.uniform(0.5, longest))
            ends, longest = ends + 1, max(0.7 * longest, 1.5)
            for pattern in clean:  # from the beginning
                for path in folder.glob(pattern):
                    path.unlink()
        except subprocess.TimeoutExpired:
            process.send_signal(SIGNALS[kills % 3])
            process.wait()
            kills, longest = kills + 1, 1.1 * longest
        check_files(folder)
    return ends


@pytest.mark.slow
@pytest.mark.parametrize("kind", COMMANDS)
def test_killed_commands_damage_no_file_and_come_to_the_same_picture(kind, tmp_path):
    (tmp_path / "scene.json").write_text(json.dumps(still_life()))
    words = COMMANDS[kind]
    killed(tmp_path, words, {"render": ["a.*"], "part": ["1.rpck"], "sweep": ["out/*"], "frames": ["out.*"]}[kind])
    assert started(tmp_path, words).wait() == 0
    check_files(tmp_path)
    whole = rptcam_cl.render(tmp_path / "scene.json", size=(160, 120), spp=40 if kind in ("sweep", "frames") else 400)
    if kind in ("sweep", "frames"):
        found = [read_film(path).pixels for path in tmp_path.rglob("*.exr")]
        assert len(found) == 8
    elif kind == "part":
        assert started(tmp_path, [*RENDER, "--spp", "400", "--part", "2/2", "-o", "2.rpck"]).wait() == 0
        found = [rptcam_cl.merge([tmp_path / "1.rpck", tmp_path / "2.rpck"]).pixels]
    else:
        found = [read_film(tmp_path / "a.exr").pixels]
    for pixels in found:
        np.testing.assert_array_equal(pixels, whole.pixels)
