"""Aberrations of lenses beside optiland and ray-optics, each figure that they know.

    python -m benchmarks.aberrations [--optics-python PATH] [--json FILE] [--quick]

First-order rays, Seidel sums surface by surface, sums of colour, foci of thin pencils, rays of a fan with their path
differences, and Zernike coefficients. Both programs aim at the entrance pupil of first order, so pencils and fans are
compared on lenses whose stop comes first, and our rays start where theirs do. optiland's sums leave out polynomial
aspheres, and ray-optics' pencils all aspheres: they are compared without.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.optics_worker import FAR_MM
from benchmarks.report import print_table
from benchmarks.worker import Worker, WorkerError
from rptcam_cl.core import LINE_C_NM, LINE_D_NM, LINE_F_NM
from rptcam_cl.optics import aberrations, ray_trace, spots
from rptcam_cl.optics.beams import Beam
from rptcam_cl.optics.waves import ExitRays
from rptcam_cl.rendering.traceable_lens import load_lens

Array = NDArray[np.float64]
Figures = dict[str, Array]

FRONT_STOP = {
    "name": "stop in front",
    "surfaces": [
        {"stop": True, "thickness": 6, "diameter": 10},
        {"radius": 300, "thickness": 4, "glass": "N-BK7", "diameter": 30},
        {"radius": -40, "thickness": 2, "glass": "SF5", "diameter": 30},
        {"radius": -80, "diameter": 30},
    ],
}
CONIC = {
    "name": "conic behind its stop",
    "surfaces": [
        {"stop": True, "thickness": 8, "diameter": 8},
        {"radius": 90, "conic": -0.6, "thickness": 5, "glass": "N-SF11", "diameter": 24},
        {"radius": -110, "conic": 2.0, "diameter": 24},
    ],
}
ASPHERE = {
    "name": "asphere before its stop",
    "surfaces": [
        {
            "radius": 60, "conic": -0.5, "aspheric": {4: 1e-6, 6: 1e-9}, "thickness": 5, "glass": "N-SF11",
            "diameter": 40,
        },
        {"radius": -90, "aspheric": {4: -2e-6}, "thickness": 2, "diameter": 40},
        {"stop": True, "diameter": 10},
    ],
}  # fmt: skip
LENSES = (
    "achromat-100mm", "cooke-triplet-50mm", "tessar-100mm", "dgauss-50mm", "telephoto-250mm", FRONT_STOP, CONIC,
    ASPHERE,
)  # fmt: skip
PROGRAMS = ("rayoptics", "optiland")
FIELD = 5.0  # degrees
ORDER = 14  # of Zernike terms, over the circle of direction cosines that ours have: what is left depends on the rays
PUPIL = (-0.9, -0.5, 0.3, 0.8)  # of the fan, in radii of the entrance pupil
SUMS = ("spherical", "coma", "astigmatism", "petzval", "distortion")


def rows_of(lens: Any) -> list[dict[str, Any]]:
    """Return the surfaces as the worker takes them, indices for F, d and C."""
    indices = lens.indices(np.array([LINE_F_NM, LINE_D_NM, LINE_C_NM]))[1:]
    stop = lens.stop_index
    return [
        {
            "radius": s.radius if s.curvature else None, "thickness": s.thickness, "indices": n.tolist(),
            "stop": k == stop, "conic": s.conic, "aspheric": dict(s.aspheric),
        }
        for k, (s, n) in enumerate(zip(lens.surfaces, indices, strict=True))
    ]  # fmt: skip


def ours(setting: spots.Setting, heights: Array) -> Figures:
    """Return our figures; fans through heights in the plane of the first vertex [mm]."""
    lens, beam = setting.lens, Beam(FIELD, setting.object_distance_mm)
    marginal, chief = aberrations.paraxial_rays(setting, FIELD)
    sums = aberrations.seidel(setting, FIELD, (LINE_F_NM, LINE_C_NM), unit="sums").rows[:-1]
    (pencils,) = aberrations.curvature_rows(setting, [FIELD], [LINE_D_NM])
    exit_rays = ExitRays(lens, beam, LINE_D_NM, setting.film_z)
    points = np.column_stack([np.zeros_like(heights), heights])
    traced = lens.trace(*beam.rays(points), LINE_D_NM, "scene")
    off = ray_trace.at_plane(traced.origins, traced.directions, setting.film_z)[:, 1] - exit_rays.chief[1]
    last = len(lens.surfaces)
    return {
        "first-order rays": np.stack([marginal[:last, 0], chief[:last, 0]]),
        "Seidel sums": np.array([[row[name] for name in SUMS] for row in sums]),
        "colour": np.array([[row["axial_colour"], row["lateral_colour"]] for row in sums]),
        "thin pencils [mm]": np.array([pencils["sagittal_mm"], pencils["tangential_mm"]]),
        "fan [mm]": off,
        "path [waves]": exit_rays.waves(points, traced)[1],
        "Zernikes [waves]": np.array(
            [
                row["noll_waves"]
                for row in sorted(
                    aberrations.zernike(setting, [FIELD], [LINE_D_NM], order=ORDER, rays=None).rows,
                    key=lambda row: row["noll"],
                )
            ][1:]
        ),
    }


def compare(python: str, program: str, spec: Any) -> dict[str, float]:
    """Return by how much figures differ, at most, in parts of the largest of their kind."""
    lens = load_lens(spec)
    setting = spots.setting(lens)
    if program == "rayoptics":  # knows no object at infinity
        setting = replace(setting, object_distance_mm=FAR_MM)
    (*middle,), radius = aberrations.pupil_circle(setting, FIELD, LINE_D_NM)
    worker = Worker(python, "benchmarks.optics_worker", program)
    try:
        answer = worker.ask(
            do="aberrations", rows=rows_of(lens), film=setting.film, field=FIELD, pupil=PUPIL,
            diameter=lens.first_order().entrance_pupil.diameter_mm, terms=(ORDER + 1) * (ORDER + 2) // 2,
            circle=[*middle, radius],
        )  # fmt: skip
    finally:
        worker.close()
    theirs = {name: np.array(values) for name, values in answer["figures"].items()}
    mine = ours(setting, np.array(answer["heights"]))
    if lens.stop_index != 0:
        theirs = {
            name: values
            for name, values in theirs.items()
            if name.split()[0] not in ("thin", "fan", "path", "Zernikes")
        }
    return {
        name: float(np.abs(values - mine[name]).max() / size)
        for name, values in theirs.items()
        if (size := np.abs(mine[name]).max()) > 0
    }


def main() -> int:
    """Compare every lens with both programs and print the table."""
    parser = argparse.ArgumentParser(description="Aberrations beside optiland and ray-optics.")
    parser.add_argument(
        "--optics-python", action="append", metavar="PATH", help="a Python that has one or both of them"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the differences")
    parser.add_argument("--quick", action="store_true", help="two lenses")
    options = parser.parse_args()
    lenses = LENSES[5:7] if options.quick else LENSES
    found: dict[str, dict[str, dict[str, float]]] = {}
    for program in PROGRAMS:
        for python in options.optics_python or [sys.executable]:
            try:
                found[program] = {
                    spec if isinstance(spec, str) else spec["name"]: compare(python, program, spec) for spec in lenses
                }
                break
            except WorkerError as error:
                reason = error
        else:
            print(f"{program} is left out: {reason}", file=sys.stderr)
    for program, of_lenses in found.items():
        heads = list(dict.fromkeys(name for parts in of_lenses.values() for name in parts))
        lines = [
            [name, *(f"{parts[head]:.1e}" if head in parts else "" for head in heads)]
            for name, parts in of_lenses.items()
        ]
        print_table(f"Largest difference from {program}, in parts of the largest figure", ["lens", *heads], lines)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
