"""Run notebooks of this folder and keep what they show: python examples/notebooks/store_outputs.py [NAME ...]

Their outputs, made small, are read where nothing is run, as on the pages of a code host. It takes nbclient, ipykernel.
"""

import base64
import hashlib
import io
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import PIL.Image

FOLDER = Path(__file__).parent
SECONDS = 3600  # that a cell may take on a busy machine
COLOURS = 256  # of a plot; what has more is a picture, as JPEG smaller
QUALITY = 80
LONG = 1000  # characters of a text beside a better form of the same


def digest(cells: list[Any]) -> str:
    """Return what changes with the program of a notebook: SHA-256 of its code cells."""
    return hashlib.sha256("\0".join("".join(cell["source"]) for cell in cells).encode()).hexdigest()


def executed(path: Path) -> Any:
    """Return a notebook with its outputs, run in a copy of the examples, as some write files."""
    import nbclient
    import nbformat

    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        there = shutil.copytree(FOLDER.parent, Path(folder) / "examples") / FOLDER.name
        resources = {"metadata": {"path": str(there)}}
        nbclient.NotebookClient(notebook, timeout=SECONDS, kernel_name="python3", resources=resources).execute()
    return notebook


def small(png: bytes) -> tuple[str, bytes]:
    """Return kind and bytes of a picture of few colours as PNG, else as JPEG where that is smaller."""
    picture = PIL.Image.open(io.BytesIO(png)).convert("RGB")
    plot, photo = io.BytesIO(), io.BytesIO()
    picture.quantize(COLOURS, dither=PIL.Image.Dither.NONE).save(plot, "PNG", optimize=True)
    picture.save(photo, "JPEG", quality=QUALITY, optimize=True)
    if plot.tell() <= photo.tell():
        return "image/png", plot.getvalue()
    return "image/jpeg", photo.getvalue()


def joined(outputs: list[Any]) -> list[Any]:
    """Return outputs whose lines of text are one piece, however they came."""
    found: list[Any] = []
    for output in outputs:
        if found and output.output_type == "stream" == found[-1].output_type and output.name == found[-1].name:
            found[-1].text += output.text
        else:
            found.append(output)
    return found


def stored(notebook: Any) -> Any:
    """Return an executed notebook as it is kept: small pictures, no times, and the digest of its program."""
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for cell in code:
        cell.metadata.pop("execution", None)
        cell.outputs = joined(cell.outputs)
        for output in cell.outputs:
            if len(output.get("data", {})) > 1 and len(output.data.get("text/plain", "")) > LONG:
                del output.data["text/plain"]
            if "image/png" in output.get("data", {}):
                kind, content = small(base64.b64decode(output.data.pop("image/png")))
                output.data[kind] = base64.b64encode(content).decode()
                output.metadata = {}
    notebook.metadata.pop("language_info", None)
    notebook.metadata["language_info"] = {"name": "python"}
    notebook.metadata["outputs_of"] = digest(code)
    return notebook


def main(names: list[str]) -> None:
    """Run the notebooks of these names, or all."""
    import nbformat

    for path in sorted(FOLDER.glob("*.ipynb")):
        if not names or path.stem in names:
            nbformat.write(stored(executed(path)), path)
            print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
