"""The arrows of the design: which part may import which, read from the syntax trees."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

GROUND = {"errors", "_version"}
FILES = GROUND | {"references", "resources", "strict_yaml"}
ALLOWED: dict[str, set[str]] = {
    "errors": set(),
    "_version": set(),
    "curves": set(),
    "host_memory": set(),
    "kinds": set(),
    "records": {"kinds"},
    "resources": GROUND,
    "references": GROUND,
    "strict_yaml": GROUND | {"references"},
    "mesh_files": GROUND | {"references"},
    "photometry": GROUND | {"references"},
    "pictures": GROUND | {"references"},
    "spectra": GROUND | {"resources"},
    "sensor": GROUND | {"resources", "spectra"},
    "imaging": GROUND | {"host_memory", "sensor"},
    "optics": FILES,
    "scene": FILES | {"mesh_files", "spectra", "optics"},  # optics: a solid's glass is that of lens files
    "geometry": GROUND | {"mesh_files", "records", "scene"},
    "device": GROUND | {"records", "resources"},
    "acceleration": GROUND | {"records", "resources", "geometry", "device"},
    "cameras": GROUND | {"references", "curves", "photometry", "records", "scene", "optics"},
    "plan": GROUND
    | {"curves", "kinds", "records", "scene", "optics", "geometry", "photometry", "pictures", "cameras"}
    | {"spectra", "sensor"},
    "lensview": FILES | {"optics"},
    "pbrt": FILES | {"imaging", "optics", "mesh_files", "pictures", "spectra"},
    "lens_tracing": GROUND | {"records", "optics", "device", "cameras", "lensview"},
    "wavefront": GROUND | {"host_memory", "records", "scene", "plan", "cameras", "device", "acceleration"},
    "accuracy": GROUND | {"mesh_files", "scene", "optics", "cameras"},
    "autofocus": GROUND
    | {"records", "imaging", "scene", "optics", "cameras", "plan", "device", "wavefront", "lensview"},
    "metering": GROUND | {"photometry", "scene", "cameras", "plan", "device", "wavefront"},
    "sensing": GROUND | {"scene", "sensor"},
    "developing": GROUND | {"imaging", "scene"},
    "saving": GROUND | {"imaging", "scene", "wavefront"},
    "numerics": FILES
    | {"kinds", "records", "scene", "optics", "device", "acceleration", "cameras", "plan", "lens_tracing", "wavefront"},
    "account": GROUND | {"scene", "plan", "cameras", "wavefront", "numerics"},
    "tradeoff": GROUND
    | {"scene", "plan", "device", "wavefront", "accuracy", "autofocus", "metering", "lensview", "numerics"},
}
FACES = {"__init__", "__main__", "api", "cli", "progress"}
OPENCL = {"pyopencl", "pytools", "siphash24"}


def part_of(path: Path, package: Path) -> str:
    return path.relative_to(package).parts[0].removesuffix(".py")


def imported(source: str) -> Iterator[str]:
    """Dotted names of all that a module imports, wherever in the file."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: imports are written in full"
            if node.module == "rptcam_cl":
                yield from (f"rptcam_cl.{alias.name}" for alias in node.names)
            else:
                yield str(node.module)


def wrong_imports(part: str, source: str) -> list[str]:
    """The imports that a part may not have."""
    wrong = []
    for name in imported(source):
        top, _, rest = name.partition(".")
        target = rest.partition(".")[0]
        if top in OPENCL and part != "device":
            wrong.append(name)
        if top == "rptcam_cl" and part not in FACES and target != part and target not in ALLOWED[part]:
            wrong.append(name)
    return wrong


def modules(checkout: Path) -> list[Path]:
    return sorted((checkout / "rptcam_cl").rglob("*.py"))


def test_every_part_has_its_place_in_the_table(checkout: Path) -> None:
    parts = {part_of(path, checkout / "rptcam_cl") for path in modules(checkout)}
    assert parts <= ALLOWED.keys() | FACES


def test_no_module_imports_upwards(checkout: Path) -> None:
    wrong = {
        str(path.relative_to(checkout)): found
        for path in modules(checkout)
        if (found := wrong_imports(part_of(path, checkout / "rptcam_cl"), path.read_text("utf-8")))
    }
    assert wrong == {}


def test_table_itself_has_no_circle() -> None:
    order = list(ALLOWED)
    for place, part in enumerate(order):
        assert ALLOWED[part] <= set(order[:place]), part


@pytest.mark.parametrize(
    ("part", "line"),
    [
        ("optics", "import pyopencl as cl"),
        ("wavefront", "from pyopencl.array import Array"),
        ("scene", "def late():\n    from rptcam_cl import wavefront"),
        ("device", "import rptcam_cl.scene.model"),
        ("imaging", "from rptcam_cl.device import choose"),
        ("optics", "from rptcam_cl.api import devices"),
    ],
)
def test_a_wrong_import_is_found(part: str, line: str) -> None:
    assert wrong_imports(part, line)


@pytest.mark.parametrize("part", ["optics", "scene", "imaging", "cli", "lensview"])
def test_part_is_usable_without_opencl(part: str) -> None:
    program = f"import sys; sys.modules['pyopencl'] = None; import rptcam_cl.{part}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
