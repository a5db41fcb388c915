"""Rooms keep to their budgets of code, and functions are short enough to read in one go."""

import ast
import re
from pathlib import Path

from benchmarks.architecture import PICTURE, imports, shortest
from benchmarks.size import TOP, Size, budget, parsed, rooms, size_of
from rptcam_cl.scene.camera import CAMERA_KINDS

MOST_FILES, MOST_ROOMS = 191, 12
# Keys of each kind of camera; its optics; the drive of an ideal lens, whose state is its plane of focus.
FILES_OF_CAMERA_KINDS = {"scene/camera.py", "rendering/cameras/kinds.py", "studies/focus/drives.py"}


def test_rooms_keep_to_budgets_that_are_what_they_need() -> None:
    sizes, most = rooms(), budget()
    assert {*sizes} - {TOP} == {*most}
    assert {room: size.code for room, size in sizes.items() if room != TOP and size.code > most[room]} == {}

    # A budget far above what there is bounds nothing.
    assert {room: size for room, size in most.items() if size > 1.05 * sizes[room].code + 50} == {}
    assert len(sizes) - 1 <= MOST_ROOMS
    assert sum(sizes.values(), Size()).files <= MOST_FILES


def test_drawing_of_the_house_has_its_rooms_and_their_imports() -> None:
    edges, drawn = imports(), re.findall(r"<path id='(\w+)-(\w+)'", PICTURE.read_text("utf-8"))
    assert {*drawn} - {("rendering", "kernels")} == {(a, b) for a, named in shortest(edges).items() for b in named}
    assert {*re.findall(r">(\w+)</text>", PICTURE.read_text("utf-8"))} >= {*edges}


def test_code_is_what_is_neither_blank_nor_comment_nor_docstring() -> None:
    head = '"""A\nmodule."""\n\nimport math  # why\n# a comment\n\n\n'
    source = head + 'class A:\n    """One."""\n\n    b = """not\n    one"""\n_c = 1\n'
    assert size_of(source) == Size(files=1, code=5, imports=1, classes=1, public=1)


def test_nine_of_ten_functions_have_at_most_40_lines(checkout: Path, tracked: list[str]) -> None:
    sizes = [
        (node.end_lineno or node.lineno) - node.lineno + 1
        for name in tracked
        if name.startswith("rptcam_cl/") and name.endswith(".py")
        for node in ast.walk(parsed((checkout / name).read_text("utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    assert sum(size <= 40 for size in sizes) >= 0.9 * len(sizes)


def test_a_kind_of_camera_is_named_where_it_is_made_alone(checkout: Path, tracked: list[str]) -> None:
    kinds = {kind.__name__ for kind in CAMERA_KINDS}
    naming = {
        name.removeprefix("rptcam_cl/")
        for name in tracked
        if name.startswith("rptcam_cl/") and name.endswith(".py")
        for node in ast.walk(parsed((checkout / name).read_text("utf-8")))
        if (isinstance(node, ast.Name) and node.id in kinds) or (isinstance(node, ast.Attribute) and node.attr in kinds)
    }
    assert naming == FILES_OF_CAMERA_KINDS
