"""Render the pictures of the gallery with the very commands that its page prints.

Run in the folder above: python examples/make_gallery.py [PART_OF_A_NAME …]
"""

import re
import shlex
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).with_name("README.md")


def commands(page: str) -> list[list[str]]:
    """Return the words of the command in every shell block of a Markdown page."""
    blocks = re.findall(r"^```sh\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    return [shlex.split(block.replace("\\\n", "")) for block in blocks]


def started(words: list[str]) -> list[str]:
    """Return what runs a command with the Python that runs this script."""
    return [sys.executable, *(["-m", "rptcam_cl"] if words[0] == "rptcam" else []), *words[1:]]


def main(wanted: list[str]) -> int:
    """Render the pictures whose command holds one of the wanted texts, or all; return the exit code."""
    root = PAGE.parent.parent
    for words in commands(PAGE.read_text("utf-8")):
        line = shlex.join(words)
        if wanted and not any(part in line for part in wanted):
            continue
        print(line, flush=True)
        quiet = ["--quiet"] if words[1] == "render" else []
        done = subprocess.run(started(words) + quiet, cwd=root, check=False)
        if done.returncode:
            return done.returncode
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
