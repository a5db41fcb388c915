"""Where autofocus finds the targets of CS348b's assignment of 2015, beside where they are."""

from __future__ import annotations

from examples.figures.figure import ROOT
from examples.figures.numbers import Numbers, Row
from rptcam_cl import Scene, autofocus, load_scene

SCENE = ROOT / "examples" / "assignment" / "autofocus.yaml"
METHODS = ("contrast", "depth")
# Target: film distance [mm].
TARGETS = {"closest: 125 mm": "61.9", "farthest: 713 mm": "39.8"}
TELEPHOTO = (5619.0, "115.9", (0.70, 0.76, 0.40, 0.46))  # distance from the first vertex, film distance, zone
QUARTER_MM = {"dgauss-50mm": 0.05, "telephoto-250mm": 0.13}  # of a depth of focus


def autofocus_targets() -> Numbers:
    """Compare the film distances that autofocus finds."""
    rows = []
    for target, film in TARGETS.items():
        policy = target.partition(":")[0]
        scene = load_scene(SCENE, [f"camera.focus.auto.policy={policy}"])
        found = [autofocus(scene, method).film_distance_mm or 0.0 for method in METHODS]
        rows.append(_row(f"`dgauss-50mm`, {target}", film, found, "dgauss-50mm"))
    front, film, zone = TELEPHOTO
    wall = far_wall(front, float(film))
    found = [autofocus(wall, method, zones=[zone]).film_distance_mm or 0.0 for method in METHODS]
    rows.append(_row(f"`telephoto-250mm`: {front:g} mm", film, found, "telephoto-250mm"))
    return Numbers(
        ("target",),
        [f"film distance [mm] by `{method}`" for method in METHODS],
        rows,
        reason="Ours may miss by a quarter of the depth of focus: 0.05 mm for the double Gauss at f/2, 0.13"
        " mm for the telephoto.",
        noise=0.003,
    )


def _row(label: str, film: str, found: list[float], lens: str) -> Row:
    return Row((label,), (film,) * len(METHODS), found, more=QUARTER_MM[lens])


def far_wall(front_mm: float, film_mm: float) -> Scene:
    """Return a chequered wall at a distance from the telephoto's first vertex when it is in focus."""
    length = 102.78
    wall = {"kind": "checker", "even": 0.8, "odd": 0.1, "scale": [80, 80]}
    return load_scene(
        {
            "metres_per_unit": 0.001,
            "film": {"resolution": [300, 300], "diagonal_mm": 70},
            "camera": {
                "kind": "realistic",
                "lens": "telephoto-250mm",
                "eye": [0, 0, 0],
                "target": [0, 0, -1],
                "focus": {"auto": "contrast"},
            },
            "objects": [
                {
                    "shape": "rectangle",
                    "corner": [-1000, -1000, -(front_mm + length + film_mm)],
                    "edge_u": [2000, 0, 0],
                    "edge_v": [0, 2000, 0],
                    "material": {"kind": "matte", "reflectance": wall},
                }
            ],
            "environment": {"kind": "constant", "radiance": 1},
        }
    )
