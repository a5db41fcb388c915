"""The map of CONTRIBUTING shows every package, and what it names is there."""

import re
from pathlib import Path

import pytest

ROOTS = (
    "", "kernels", "kernels/pass", "rptcam_cl", "rptcam_cl/studies/focus", "rptcam_cl/api", "kernels/material",
    "integrations",
)  # fmt: skip
FILE = re.compile(r"`([\w./]+(?:/|\.(?:py|h|cl|js|md|json)))`")
WITH_NAMES = re.compile(FILE.pattern + r"\s+\(((?:`\w+`(?:, )?)+)\)")
DEFINES = r"^[ \t]*(?:(?:async )?(?:def|class)\s+{0}\b|{0}\b[^=\n]*=|(?:async\s|static\b.*\s)?{0}\(.*\{{?$)"
TO_BE_WRITTEN = re.compile(r"(^|/)(name|velvet)\.")  # files of whoever adds something


def found(checkout: Path, name: str) -> list[Path]:
    """Where a file or a folder that the page names lies."""
    return [path for root in ROOTS if (path := checkout / root / name).exists()]


@pytest.fixture
def page(checkout: Path) -> str:
    return (checkout / "CONTRIBUTING.md").read_text("utf-8")


def packages(checkout: Path) -> list[str]:
    """Every package below rptcam_cl, as ``optics/files``."""
    root = checkout / "rptcam_cl"
    return sorted(str(path.parent.relative_to(root)) for path in root.rglob("__init__.py") if path.parent != root)


def test_every_package_stands_in_the_map(checkout: Path, page: str) -> None:
    rooms = page.partition("### The rooms")[2].partition("\n###")[0]
    assert [name for name in packages(checkout) if f"`{name}`" not in rooms] == []


def test_rooms_of_the_map_are_packages_in_the_order_of_the_import_table(page: str) -> None:
    from tests.project.test_rooms import ROOMS

    rooms = page.partition("### The rooms")[2].partition("\n###")[0]
    assert re.findall(r"^\| `(\w+)` \|", rooms, re.MULTILINE) == [name for name in ROOMS if not name.startswith("_")]


def test_files_that_the_page_names_are_there(checkout: Path, page: str) -> None:
    named = set(FILE.findall(page))
    assert len(named) > 20
    assert [name for name in sorted(named) if not TO_BE_WRITTEN.search(name) and not found(checkout, name)] == []


def test_names_that_the_page_gives_with_a_file_are_defined_in_it(checkout: Path, page: str) -> None:
    lost = []
    pairs = [(file, name) for file, names in WITH_NAMES.findall(page) for name in re.findall(r"\w+", names)]
    assert len(pairs) > 40
    for file, name in pairs:
        [path, *_] = found(checkout, file)
        if not re.search(DEFINES.format(name), path.read_text("utf-8"), re.MULTILINE):
            lost.append(f"{file}: {name}")
    assert lost == []


def test_folders_of_tests_are_named_like_the_rooms(checkout: Path) -> None:
    from tests.project.test_rooms import ROOMS

    about_no_room = {"benchmarks", "data", "integrations", "project", "support"}
    folders = {path.parent.relative_to(checkout / "tests").parts[0] for path in (checkout / "tests").glob("*/**/*.py")}
    assert len(folders) > 10
    assert sorted(folders - set(ROOMS) - about_no_room) == []
