"""The rooms of the house: which may import which, nothing private, no import leads back; their budgets of code."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from benchmarks.architecture import PICTURE, imports, shortest
from benchmarks.size import TOP, Size, budget, nodes_of, rooms, size_of
from rptcam_cl.scene.camera import CAMERA_KINDS

# From the ground up; each may import rooms that stand above it in this list, those that it names.
ROOMS: dict[str, set[str]] = {
    "core": set(),
    "device": {"core"},
    "optics": {"core"},
    "scene": {"core", "optics"},
    "imaging": {"core", "scene"},
    "rendering": {"core", "device", "optics", "scene"},
    "studies": {"core", "device", "optics", "scene", "imaging", "rendering"},
    "api": {"core", "device", "optics", "scene", "imaging", "rendering", "studies"},
    "exchange": {"core", "optics", "scene", "rendering"},
    "batch": {"core", "device", "scene", "imaging", "rendering", "api", "exchange"},
    "viewfinder": {"core", "device", "optics", "scene", "imaging", "rendering", "studies", "api"},
    "cli": {
        "core",
        "device",
        "optics",
        "scene",
        "imaging",
        "rendering",
        "studies",
        "api",
        "exchange",
        "batch",
        "viewfinder",
    },
}
FACES = {"__init__", "__main__"}
CIRCLES: list[str] = []  # none is to be added
OPENCL = {"pyopencl", "pytools", "siphash24"}


def room_of(path: Path, package: Path) -> str:
    return path.relative_to(package).parts[0].removesuffix(".py")


@cache
def statements(source: str) -> list[ast.Import | ast.ImportFrom]:
    """The imports of a module, wherever in the file."""
    return [node for node in nodes_of(source) if isinstance(node, (ast.Import, ast.ImportFrom))]


def imported(source: str) -> Iterator[str]:
    """Dotted names of all modules that a module imports from."""
    for node in statements(source):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        else:
            assert node.level == 0, f"line {node.lineno}: imports are written in full"
            if node.module == "rptcam_cl":
                yield from (f"rptcam_cl.{alias.name}" for alias in node.names)
            else:
                yield str(node.module)


def wrong_imports(room: str, source: str) -> list[str]:
    """The imports that a room may not have: of a room that the table does not allow it, or of a private name."""
    wrong = []
    for name in imported(source):
        top, *inside = name.split(".")
        if top in OPENCL and room != "device":
            wrong.append(name)
        others = top == "rptcam_cl" and room not in FACES and inside and inside[0] != room
        if others and inside[0] not in ROOMS[room] and (room, inside[0]) != ("cli", "__main__"):  # where all begins
            wrong.append(name)
    return wrong + list(private_imports(source))


def private_imports(source: str) -> Iterator[str]:
    """Names with an underscore that a module takes from another of ours: a module's public names are its face."""
    for node in statements(source):
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "rptcam_cl":
            for alias in node.names:
                if alias.name.startswith("_") and not alias.name.startswith("__"):
                    yield f"{node.module}.{alias.name}"


def modules(checkout: Path) -> list[Path]:
    return sorted((checkout / "rptcam_cl").rglob("*.py"))


def test_every_room_has_its_place_in_the_table(checkout: Path) -> None:
    found = {room_of(path, checkout / "rptcam_cl") for path in modules(checkout)}
    assert found == ROOMS.keys() | FACES


def test_no_module_imports_upwards_or_past_a_face(checkout: Path) -> None:
    wrong = {
        str(path.relative_to(checkout)): found
        for path in modules(checkout)
        if (found := wrong_imports(room_of(path, checkout / "rptcam_cl"), path.read_text("utf-8")))
    }
    assert wrong == {}


def test_table_itself_has_no_circle() -> None:
    order = list(ROOMS)
    for place, room in enumerate(order):
        assert ROOMS[room] <= set(order[:place]), room


def module_name(path: Path, checkout: Path) -> str:
    return ".".join(path.relative_to(checkout).with_suffix("").parts).removesuffix(".__init__")


def imports_between(checkout: Path) -> dict[str, set[str]]:
    """Each module with those that it imports, lazily or for types alone as well."""
    found = {module_name(path, checkout): path for path in modules(checkout)}
    edges: dict[str, set[str]] = {name: set() for name in found}
    for name, path in found.items():
        for node in statements(path.read_text("utf-8")):
            if isinstance(node, ast.ImportFrom) and node.module in found:
                inner = {f"{node.module}.{alias.name}" for alias in node.names}
                edges[name] |= (inner & found.keys()) | ({str(node.module)} if inner - found.keys() else set())
    return {name: targets - {name} for name, targets in edges.items()}


def reached(start: str, edges: dict[str, set[str]]) -> set[str]:
    """All that a module imports, and what that imports, and so on."""
    found: set[str] = set()
    ahead = set(edges[start])
    while ahead:
        found |= ahead
        ahead = set().union(*(edges.get(name, set()) for name in ahead)) - found
    return found


def circle(edges: dict[str, set[str]]) -> list[str]:
    """The modules from which imports lead back to them."""
    return sorted(name for name in edges if name in reached(name, edges))


def test_no_import_leads_back_to_where_it_began(checkout: Path) -> None:
    assert circle(imports_between(checkout)) == CIRCLES


def test_a_circle_is_found() -> None:
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set()}) == ["b", "c"]


@pytest.mark.parametrize(
    ("room", "line"),
    [
        ("optics", "import pyopencl as cl"),
        ("rendering", "from pyopencl.array import Array"),
        ("scene", "def late():\n    from rptcam_cl import render"),
        ("device", "import rptcam_cl.scene.scene"),
        ("imaging", "from rptcam_cl.device.devices import choose_device"),
        ("optics", "from rptcam_cl.api.job import render"),
        ("rendering", "from rptcam_cl.optics.lens import _cached"),
    ],
)
def test_a_wrong_import_is_found(room: str, line: str) -> None:
    assert wrong_imports(room, line)


def test_rooms_are_usable_without_opencl(checkout: Path) -> None:
    without = {"core", "optics", "scene", "imaging", "cli", "exchange"}
    names = [
        module_name(path, checkout) for path in modules(checkout) if room_of(path, checkout / "rptcam_cl") in without
    ]
    program = f"import sys, importlib; sys.modules['pyopencl'] = None; [importlib.import_module(n) for n in {names}]"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


# What takes long to import, and no render of a plain scene needs.
NOT_FOR_A_RENDER = {
    "rptcam_cl.api.combined",
    "rptcam_cl.api.session",
    "rptcam_cl.cli.camera",
    "rptcam_cl.cli.first_steps",
    "rptcam_cl.cli.lens",
    *(f"rptcam_cl.scene.assets.{form}" for form in ("gltf", "obj", "ply")),
    "PIL",
    "matplotlib",
    "scipy",
    "starlette",
}
ROOMS_NOT_FOR_A_RENDER = {"batch", "exchange", "studies", "viewfinder"}
SCENE = """\
film: {resolution: [8, 8]}
camera: {kind: pinhole, eye: [0, 0, 5], target: [0, 0, 0], fov_degrees: 40}
objects: [{shape: sphere, center: [0, 0, 0], radius: 1, material: {kind: matte, reflectance: 0.5}}]
environment: {kind: constant, radiance: 1}
"""


def test_render_imports_nothing_that_it_does_not_need(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE)
    program = (
        "import sys; from rptcam_cl.__main__ import run; sys.argv[0] = 'rptcam'; code = run();"
        "print(code, *sys.modules, file=sys.stderr)"
    )
    words = ["render", str(tmp_path / "scene.yaml"), "--quiet", "-o", str(tmp_path / "picture.png")]
    done = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, check=True)
    code, *found = done.stderr.split()
    assert code == "0"
    assert (tmp_path / "picture.png").exists()
    assert NOT_FOR_A_RENDER & set(found) == set()
    assert {name for name in found if name.split(".")[:1] == ["rptcam_cl"] and name.split(".")[1:2]} & {
        f"rptcam_cl.{room}" for room in ROOMS_NOT_FOR_A_RENDER
    } == set()


MOST_FILES, MOST_ROOMS = 194, 12
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
        for node in nodes_of((checkout / name).read_text("utf-8"))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    assert sum(size <= 40 for size in sizes) >= 0.9 * len(sizes)


def test_a_kind_of_camera_is_named_where_it_is_made_alone(checkout: Path, tracked: list[str]) -> None:
    kinds = {kind.__name__ for kind in CAMERA_KINDS}
    naming = {
        name.removeprefix("rptcam_cl/")
        for name in tracked
        if name.startswith("rptcam_cl/") and name.endswith(".py")
        for node in nodes_of((checkout / name).read_text("utf-8"))
        if (isinstance(node, ast.Name) and node.id in kinds) or (isinstance(node, ast.Attribute) and node.attr in kinds)
    }
    assert naming == FILES_OF_CAMERA_KINDS
