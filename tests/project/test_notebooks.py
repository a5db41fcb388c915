"""The notebooks: what they import and name is there, they keep no outputs, and each runs to its end."""

import importlib
import importlib.util
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.support.pages import ROOT, imports, undefined_names

FOLDER = ROOT / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
SECONDS = 600  # that a cell may take on a busy machine


def cells(path: Path, kind: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(path.read_text("utf-8"))["cells"]
    return [cell for cell in found if cell["cell_type"] == kind]


def test_there_are_notebooks_and_a_page_names_each(checkout: Path) -> None:
    shipped = {"lens_bench", "speed_against_accuracy", "scene_to_raw", "calibrate_a_lens", "exact_depth_and_blur"}
    assert shipped <= {path.stem for path in NOTEBOOKS}
    page = (checkout / "docs" / "notebooks.md").read_text("utf-8")
    assert [path.name for path in NOTEBOOKS if f"examples/notebooks/{path.name}" not in page] == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_clean_and_finds_its_imports_and_names(path: Path) -> None:
    code = cells(path, "code")
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    program = "\n".join("".join(cell["source"]) for cell in code)
    assert undefined_names(program) == set()
    for module, name in imports(program):
        found = importlib.import_module(module)
        assert name is None or hasattr(found, name) or importlib.util.find_spec(f"{module}.{name}"), (module, name)
    heading = "".join(cells(path, "markdown")[0]["source"])
    assert heading.startswith("# ") and "?" in heading  # the reader's question


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_to_its_end(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = nbformat.read(path, as_version=4)
    resources = {"metadata": {"path": str(tmp_path / "examples" / "notebooks")}}
    nbclient.NotebookClient(notebook, timeout=SECONDS, kernel_name="python3", resources=resources).execute()
    assert all(cell.execution_count for cell in notebook.cells if cell.cell_type == "code")
    assert any(output.output_type == "display_data" for cell in notebook.cells for output in cell.get("outputs", []))
