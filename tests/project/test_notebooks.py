"""The notebooks: what they import and name is there, each runs to its end, and the outputs that they keep are those."""

import base64
import importlib
import importlib.util
import io
import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import PIL.Image
import pytest

from tests.support.pages import ROOT, imports, undefined_names

FOLDER = ROOT / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
LARGEST = 300_000  # bytes
MEASURED = {"speed_against_accuracy"}  # what it shows depends on times
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def load_storing() -> ModuleType:
    spec = importlib.util.spec_from_file_location("store_outputs", FOLDER / "store_outputs.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


STORING = load_storing()


def cells(path: Path, kind: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(path.read_text("utf-8"))["cells"]
    return [cell for cell in found if cell["cell_type"] == kind]


def test_there_are_notebooks_and_a_page_names_each(checkout: Path) -> None:
    shipped = {"lens_bench", "speed_against_accuracy", "scene_to_raw", "calibrate_a_lens", "exact_depth_and_blur",
               "five_aberrations"}  # fmt: skip
    assert shipped <= {path.stem for path in NOTEBOOKS}
    page = (checkout / "docs" / "notebooks.md").read_text("utf-8")
    assert [path.name for path in NOTEBOOKS if f"examples/notebooks/{path.name}" not in page] == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_finds_its_imports_and_names(path: Path) -> None:
    code = cells(path, "code")
    program = "\n".join("".join(cell["source"]) for cell in code)
    assert undefined_names(program) == set()
    for module, name in imports(program):
        found = importlib.import_module(module)
        assert name is None or hasattr(found, name) or importlib.util.find_spec(f"{module}.{name}"), (module, name)
    heading = "".join(cells(path, "markdown")[0]["source"])
    assert heading.startswith("# ") and "?" in heading  # the reader's question


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_keeps_small_outputs_of_its_program_as_it_is(path: Path) -> None:
    code = cells(path, "code")
    of = json.loads(path.read_text("utf-8"))["metadata"]["outputs_of"]
    assert of == STORING.digest(code), "run python examples/notebooks/store_outputs.py"
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert {output["output_type"] for output in outputs} <= {"stream", "display_data", "execute_result"}
    assert all(output.get("name", "stdout") == "stdout" for output in outputs)
    assert any(kind.startswith("image/") for output in outputs for kind in output.get("data", {}))
    assert path.stat().st_size < LARGEST


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_to_its_end_and_shows_what_it_keeps(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = STORING.stored(STORING.executed(path))
    made = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for kept, cell in zip(cells(path, "code"), made, strict=True):
        assert len(kept["outputs"]) == len(cell.outputs)
        for before, now in zip(kept["outputs"], cell.outputs, strict=True):
            assert_alike(before, now, exactly=path.stem not in MEASURED)


def assert_alike(before: dict[str, Any], now: dict[str, Any], *, exactly: bool) -> None:
    """Two outputs of a cell say the same words with nearly the same numbers, and show nearly the same picture."""
    assert before["output_type"] == now["output_type"]
    assert before.get("data", {}).keys() == now.get("data", {}).keys()
    if not exactly:
        return
    if "text" in before:
        old, new = "".join(before["text"]), "".join(now["text"])
        assert NUMBER.sub("#", old) == NUMBER.sub("#", new)
        numbers = [[float(found) for found in NUMBER.findall(text)] for text in (old, new)]
        np.testing.assert_allclose(*numbers, rtol=0.1, atol=0.05)  # other devices round otherwise
    for kind in ("image/png", "image/jpeg"):
        if kind in before.get("data", {}):
            old, new = (
                np.asarray(
                    PIL.Image.open(io.BytesIO(base64.b64decode("".join(output["data"][kind])))).convert("RGB"), float
                )
                for output in (before, now)
            )
            assert old.shape == new.shape
            assert np.abs(old - new).mean() < 2.5  # of 255
