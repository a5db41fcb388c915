"""The lens truth files: 50-digit rays, first-order data, spots and irradiance that three programs agree on."""

import json
import math
from functools import cache
from pathlib import Path

from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import load_lens

FOLDER = Path(__file__).parents[1] / "data" / "lens_truth"


@cache
def truth(name: str) -> dict:
    return json.loads((FOLDER / f"{name}.json").read_text())


def lens_names() -> list[str]:
    return [path.stem for path in sorted(FOLDER.glob("*.json")) if "surfaces" in truth(path.stem)]


NAMES = lens_names()
CASES = [(name, label) for name in NAMES for label in truth(name)["wavelengths_nm"]]


@cache
def truth_lens(name: str, label: str = "d") -> Lens:
    """Return the lens of a truth file with the very indices that its numbers were computed with."""
    rows = [_row(surface, label) for surface in truth(name)["surfaces"]]
    return load_lens({"name": name, "surfaces": rows})


def _row(surface: dict, label: str) -> dict:
    row = {"diameter": 2 * surface["semi_diameter"]}
    if surface["R"]:
        row["radius"] = surface["R"]
    if surface["thickness"] is not None:
        row["thickness"] = surface["thickness"]
    if surface["is_stop"]:
        row["stop"] = True
    if surface["n_after"][label] != 1:
        row["glass"] = {"index": surface["n_after"][label]}
    if surface.get("k"):
        row["conic"] = surface["k"]
    if surface.get("A"):
        row["aspheric"] = surface["A"]
    if surface["kind"] in ("cyl_x", "cyl_y"):
        row["cylinder"] = surface["kind"][-1]
    return row


def radius(case):
    """That of the surface of a case."""
    return math.inf if case["R"] == "inf" else float(case["R"])
