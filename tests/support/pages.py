"""The fenced blocks of README and docs/*.md: where they stand, what they hold, and what of it tests run.

A block is `sh`, `python`, `yaml`, `json`, or `text` for what a program prints. The comment ``<!-- not run: why -->``
above a block keeps it from being run: its commands are checked like any other.
"""

import ast
import builtins
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LANGUAGES = {"sh", "python", "yaml", "json", "text"}
FENCE = re.compile(
    r"^(?:<!-- not run: (?P<why>[^\n]+) -->\n)?(?P<indent> *)```(?P<language>\w*)\n(?P<text>.*?)^(?P=indent)```[ ]*$",
    re.DOTALL | re.MULTILINE,
)
PROGRAMS = ("rptcam", "python", "mkdir", "cp")  # whose commands are checked and run; others are the reader's business


@dataclass(frozen=True)
class Block:
    """One fenced block: its page and line, its language, its text, and why it is not run."""

    page: str
    line: int
    language: str
    text: str
    why: str | None

    @property
    def name(self) -> str:
        """Where it stands, as ``docs/layers.md:12``."""
        return f"{self.page}:{self.line}"

    def commands(self) -> list[list[str]]:
        """Words of each command to run in a block of `sh`, without comments; lines may go on behind a backslash."""
        lines = self.text.replace("\\\n", " ").splitlines()
        words = [shlex.split(re.sub(r"(^|\s)#\s.*", "", line)) for line in lines if line.startswith(PROGRAMS)]
        return [found for found in words if found and found[0] in PROGRAMS]

    def saved_as(self) -> str | None:
        """The file that a block of YAML is to be saved as, which a comment in its first line names."""
        named = re.match(r"# ([\w./-]+\.ya?ml)\n", self.text)
        return named[1] if named and self.language == "yaml" else None


def pages() -> list[str]:
    """README and every page of docs, as paths from the checkout."""
    return ["README.md", *sorted(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md"))]


def blocks_of(page: str, text: str) -> Iterator[Block]:
    """Every block of a page, from its top to its end."""
    for found in FENCE.finditer(text):
        line = text[: found.start("language")].count("\n") + 1
        yield Block(page, line, found["language"], found["text"], found["why"])


def all_blocks(*languages: str) -> list[Block]:
    """Every block of all pages in one of the languages, or in any."""
    found = [block for page in pages() for block in blocks_of(page, (ROOT / page).read_text("utf-8"))]
    return [block for block in found if not languages or block.language in languages]


def undefined_names(program: str) -> set[str]:
    """Names that a program reads and nothing in it defines, as where an import is missing."""
    tree = ast.parse(program)
    read, given = set(), set(dir(builtins))
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            (read if isinstance(node.ctx, ast.Load) else given).add(node.id)
        elif isinstance(node, ast.alias):
            given.add((node.asname or node.name).partition(".")[0])
        elif isinstance(node, ast.FunctionDef | ast.ClassDef | ast.ExceptHandler):
            given.add(node.name or "")
        elif isinstance(node, ast.arg):
            given.add(node.arg)
    return read - given


def imports(program: str) -> Iterator[tuple[str, str | None]]:
    """Modules that a program imports, and the names that it takes out of them or, by a dot, from ``rptcam_cl``."""
    for node in ast.walk(ast.parse(program)):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.module or "", alias.name) for alias in node.names)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "rptcam_cl":
            yield "rptcam_cl", node.attr


LONGEST_SIDE, SAMPLES = 64, 2  # pixels and samples per pixel of a picture that a test makes of a page's command
SHORTENED = {"--spp": str(SAMPLES), "--time": "1s", "--frames": "1-2", "--copies": "20", "--budget": "20s"}
SIZED = ("demo", "render", "sweep")  # commands that make pictures of a scene


def reduced(words: list[str], size: tuple[int, int] | None) -> list[str]:
    """A command of ours for a test: a small picture of few samples, short times, few frames; the rest as it stands.

    ``size`` is that of the scene's film where the command makes pictures of it.
    """
    short = [SHORTENED.get(option, word) for option, word in zip(["", *words], words, strict=False)]
    if size is None or words[0] not in SIZED:
        return short
    if "--size" in short:
        at = short.index("--size")
        width, height = map(int, short[at + 1].split("x"))
        size, short = (width, height), short[:at] + short[at + 2 :]
    scale = min(1.0, LONGEST_SIDE / max(size))
    small = "x".join(str(max(1, round(scale * side))) for side in size)
    return [*short, "--size", small, *([] if "--spp" in short else ["--spp", str(SAMPLES)])]
