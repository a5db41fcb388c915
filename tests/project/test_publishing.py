"""What a release says of itself is the same everywhere, and its workflows name files and commands that exist."""

import importlib.util
import re
import tomllib
from pathlib import Path
from types import ModuleType

import pytest
import yaml

from rptcam_cl.cli import build_parser
from rptcam_cl.core import __version__


def workflows(checkout: Path) -> list[Path]:
    return sorted((checkout / ".github/workflows").glob("*.yml"))


def test_changelog_and_citation_are_of_this_version(checkout: Path) -> None:
    newest = re.search(
        r"^## (\S+) \((\d{4}-\d\d-\d\d)\)$", (checkout / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE
    )
    citation = yaml.safe_load((checkout / "CITATION.cff").read_text("utf-8"))
    assert newest is not None
    assert (newest[1], newest[2]) == (__version__, str(citation["date-released"]))
    assert str(citation["version"]) == __version__
    assert citation["cff-version"] == "1.2.0"


def steps(path: Path) -> list[str]:
    jobs = yaml.safe_load(path.read_text("utf-8"))["jobs"].values()
    return [line for job in jobs for step in job["steps"] for line in str(step.get("run", "")).splitlines()]


def test_workflows_cover_three_systems_the_wheel_and_the_pages(checkout: Path) -> None:
    assert [path.stem for path in workflows(checkout)] == ["docs", "tests", "wheel"]
    for name in ("tests", "wheel"):
        text = (checkout / f".github/workflows/{name}.yml").read_text("utf-8")
        assert all(f"{system}-latest" in text for system in ("ubuntu", "windows", "macos"))


def test_commands_of_the_workflows_parse_and_their_files_exist(checkout: Path) -> None:
    lines = [line for path in workflows(checkout) for line in steps(path)]
    commands = [line.split()[1:] for line in lines if line.startswith("rptcam ")]
    assert len(commands) > 2
    for words in commands:
        assert build_parser().parse_known_args(words)[1] == [], words
    files = [word for line in lines for word in line.split() if word.startswith("tests/")]
    assert files
    assert all((checkout / file).is_file() for file in files)


@pytest.mark.parametrize("name", ["bug", "lens", "idea"])
def test_issue_forms_have_what_a_form_needs(checkout: Path, name: str) -> None:
    form = yaml.safe_load((checkout / f".github/ISSUE_TEMPLATE/{name}.yml").read_text("utf-8"))
    assert {"name", "description", "body"} <= form.keys()
    assert len({field["id"] for field in form["body"]}) == len(form["body"])
    assert all(field["attributes"]["label"] for field in form["body"])


@pytest.fixture(scope="module")
def page(checkout: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("hatch_build", checkout / "hatch_build.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_package_page_has_no_link_that_leads_nowhere(checkout: Path, page: ModuleType) -> None:
    """With the repository's address all files that links name are there; without one there is no such link."""
    text, address = (checkout / "README.md").read_text("utf-8"), "https://code.example/someone/name"
    relative = [target for _, _, target in page.LINK.findall(text)]
    assert len(relative) > 20 and all((checkout / target.split("#")[0]).exists() for target in relative)
    for given in (address, ""):
        config = {"address": f"{given}/" if given else ""}
        metadata: dict[str, object] = {}
        page.PackagePage(str(checkout), config).update(metadata)
        shown = metadata["readme"]["text"]  # type: ignore[index]
        targets = re.findall(r"\]\(([^)]+)\)", shown)
        assert all(target.startswith("https://") for target in targets)
        ours = [target for target in targets if target.startswith(address)]
        assert ours == ([re.sub(r"^", f"{address}/{kind}/v{__version__}/", target) for kind, target in (
            ("raw" if target.endswith((".jpg", ".png", ".svg")) else "blob", target) for target in relative
        )] if given else [])  # fmt: skip
        assert ("Source" in metadata["urls"]) is bool(given)  # type: ignore[operator]
        assert len(re.findall(r"\w+", shown)) > 500


def test_recipe_and_image_have_what_the_project_depends_on(checkout: Path) -> None:
    project = tomllib.loads((checkout / "pyproject.toml").read_text("utf-8"))["project"]
    recipe = (checkout / "packaging/conda-forge/meta.yaml").read_text("utf-8")
    assert f'set version = "{__version__}"' in recipe
    run = recipe.split("  run:\n")[1].split("\n\n")[0]
    listed = {line.strip()[2:].lower().replace("-python", "").replace(" ", "") for line in run.splitlines()}
    wanted = {f"python{project['requires-python']}", *(each.lower() for each in project["dependencies"])}
    assert listed - {"pocl"} == wanted
    image = (checkout / "packaging/Dockerfile").read_text("utf-8")
    copied = re.findall(r"^COPY (.+) \S+$", image, re.MULTILINE)
    assert copied and all((checkout / name).exists() for line in copied for name in line.split())
