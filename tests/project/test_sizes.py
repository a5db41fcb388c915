"""Files small enough to read in one go."""

import ast
from pathlib import Path

MOST_LINES = 600
CODE = (".py", ".cl", ".h")


def lines(path: Path) -> int:
    return len(path.read_text("utf-8").splitlines())


def test_no_file_is_longer_than_600_lines(checkout: Path, tracked: list[str]) -> None:
    long = {name: n for name in tracked if name.endswith(CODE) and (n := lines(checkout / name)) > MOST_LINES}
    assert long == {}


def test_one_module_in_ten_at_most_is_shorter_than_60_lines(checkout: Path, tracked: list[str]) -> None:
    # One idea a file: what is shorter is mostly a piece of a neighbour's idea. The faces of rooms and commands are not.
    modules = [name for name in tracked if name.startswith("rptcam_cl/") and name.endswith(".py")]
    sizes = [lines(checkout / name) for name in modules if "__" not in name and "/cli/" not in name]
    assert sum(size < 60 for size in sizes) <= 0.1 * len(sizes)


def test_nine_of_ten_functions_have_at_most_40_lines(checkout: Path, tracked: list[str]) -> None:
    sizes = [
        (node.end_lineno or node.lineno) - node.lineno + 1
        for name in tracked
        if name.startswith("rptcam_cl/") and name.endswith(".py")
        for node in ast.walk(ast.parse((checkout / name).read_text("utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    assert sum(size <= 40 for size in sizes) >= 0.9 * len(sizes)
