"""How large the package is, room by room: ``python -m benchmarks.size`` (``make size``).

A line of code is one that is neither blank nor a comment nor part of a docstring. The budget of each room stands in
``[tool.rptcam.budget]`` of pyproject.toml; who adds beyond it raises it in the same commit and says why.
"""

from __future__ import annotations

import ast
import gc
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "rptcam_cl"
TOP = "(top)"  # the modules of the package itself


@dataclass(frozen=True)
class Size:
    """What a file, a room or the package has of each.

    Attributes
    ----------
    files, code, imports, classes, public : int
        Files; lines of code; those of them that import; classes; public names, those of a module without underscore.
    """

    files: int = 0
    code: int = 0
    imports: int = 0
    classes: int = 0
    public: int = 0

    def __add__(self, other: Size) -> Size:
        return Size(*(a + b for a, b in zip(self.row(), other.row(), strict=True)))

    def row(self) -> tuple[int, int, int, int, int]:
        """The numbers in their order."""
        return self.files, self.code, self.imports, self.classes, self.public


@cache
def parsed(source: str) -> ast.Module:
    """The syntax tree of a file; of the same text once.

    Trees stay, nearly a million objects: the garbage collector, which would look through them again and again, takes
    most of the time otherwise.
    """
    tree = ast.parse(source)
    gc.freeze()
    return tree


@cache
def nodes_of(source: str) -> tuple[ast.AST, ...]:
    """All nodes of the syntax tree of a file; of the same text once."""
    return tuple(ast.walk(parsed(source)))


def size_of(source: str) -> Size:
    """Count what one file has."""
    tree, nodes = parsed(source), nodes_of(source)
    docstrings = {line for node in nodes for line in _docstring_lines(node)}
    code = {number for number, line in enumerate(source.splitlines(), 1) if line.strip() and line.strip()[0] != "#"}
    code |= {  # texts keep their blank lines
        line
        for node in nodes
        if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str | bytes))
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    imports = {
        line
        for node in nodes
        if isinstance(node, ast.Import | ast.ImportFrom)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    classes = sum(isinstance(node, ast.ClassDef) for node in nodes)
    public = sum(not name.startswith("_") for node in tree.body for name in _names(node))
    return Size(1, len(code - docstrings), len(imports), classes, public)


def _docstring_lines(node: ast.AST) -> range:
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and node.body:
        first = node.body[0]
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str):
            return range(first.lineno, (first.end_lineno or first.lineno) + 1)
    return range(0)


def _names(node: ast.stmt) -> Iterator[str]:
    if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        yield node.name
    elif isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        yield from (part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name))


def room_of(path: Path) -> str:
    """The room that a file of the package belongs to."""
    first = path.relative_to(PACKAGE).parts[0]
    return TOP if first.endswith(".py") else first


@cache
def rooms() -> dict[str, Size]:
    """The size of each room."""
    sizes: dict[str, Size] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        room = room_of(path)
        sizes[room] = sizes.get(room, Size()) + size_of(path.read_text("utf-8"))
    return sizes


def budget() -> dict[str, int]:
    """The most lines of code that each room may have."""
    table: dict[str, int] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["rptcam"]["budget"]
    return table


def main() -> None:
    """Print the table of CONTRIBUTING.md."""
    sizes, most = rooms(), budget()
    total = sum(sizes.values(), Size())
    print("| room | files | lines of code | budget | of them imports | classes | public names |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    for room, size in sorted(sizes.items()):
        files, code, *others = size.row()
        print(f"| {room} | {files} | {code} | {most.get(room, 0) or ''} | " + " | ".join(map(str, others)) + " |")
    files, code, *others = total.row()
    print(f"| all {len(sizes) - 1} | {files} | {code} | {sum(most.values())} | " + " | ".join(map(str, others)) + " |")


if __name__ == "__main__":
    main()
