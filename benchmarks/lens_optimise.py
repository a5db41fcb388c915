"""Our lens optimiser beside optiland's, from the same disturbed lenses, with the same variables and merit, in one run.

    python -m benchmarks.lens_optimise [--optics-python PATH] [--cases triplet,doublet] [--json FILE]

Each runs in a process of its own on one thread; CPU seconds are those of the search, imports and set-up left out. Both
results are judged by `judged`, which traces with `rptcam_cl.optics.ray_trace` and knows neither optimiser: 400 rays of
each field and wavelength over the whole paraxial entrance pupil, the lens scaled to its focal length. The PATH is a
Python that has optiland; without it that column is left out.

The bar: a spot no larger in at most a fifth of the time. optiland is ended after ``--seconds`` of its own.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

WAVELENGTHS_NM = (486.1327, 587.5618, 656.2725)
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")

# Lens, f-number, fields, how far curvatures are disturbed (share, at random), seed, what varies beside curvatures.
CASES: dict[str, dict[str, Any]] = {
    "doublet": {"lens": "achromat-100mm", "f_number": 4, "fields": [0, 1, 2], "share": 0.8, "seed": 1},
    "triplet": {"lens": "cooke-triplet-50mm", "f_number": 5, "fields": [0, 14, 20], "share": 0.25, "seed": 3},
    "double gauss": {"lens": "double-gauss-50mm-f1.8", "f_number": 2.8, "fields": [0, 9, 14], "share": 0.3, "seed": 2},
    "phone": {"lens": "phone-5.6mm", "f_number": 3.5, "fields": [0, 15, 25], "share": 0.1, "seed": 4,
              "powers": [4, 6]},
}  # fmt: skip
GLASS_MM, AIR_MM = (0.02, 0.25), (0.0, 0.4)  # bounds of thicknesses, in focal lengths


def disturbed(case: dict[str, Any]) -> Any:
    """Return the lens of a case with other curvatures, and aspheric terms as much off."""
    import numpy as np

    from rptcam_cl.optics.library import load_lens

    lens, random = load_lens(case["lens"]), np.random.default_rng(case["seed"])
    changes: dict[int, dict[str, Any]] = {}
    for k, surface in enumerate(lens.surfaces):
        factor = 1 + case["share"] * random.uniform(-1, 1)
        aspheric = tuple((p, a * (1 + case["share"] * random.uniform(-1, 1))) for p, a in surface.aspheric)
        changes[k] = {"curvature": surface.curvature * factor, "aspheric": aspheric}
    return lens.with_changes(changes)


def varied(lens: Any, case: dict[str, Any]) -> dict[str, Any]:
    """Return the surfaces whose curvatures and thicknesses vary, and powers of r."""
    bends = [k for k in range(len(lens.surfaces)) if lens.media[k] != lens.media[k + 1]]
    flat = [k for k in bends if lens.surfaces[k].curvature == 0]
    gaps = [k for k, surface in enumerate(lens.surfaces[:-1]) if surface.thickness and k not in flat]
    aspheric = {k: case["powers"] for k in bends if lens.surfaces[k].aspheric} if "powers" in case else {}
    return {"curvatures": [k for k in bends if k not in flat], "thicknesses": gaps, "aspheric": aspheric}


def limits(case: dict[str, Any]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return least and greatest thickness of glass and of air [mm]."""
    length = case["focal_length_mm"]
    return (GLASS_MM[0] * length, GLASS_MM[1] * length), (AIR_MM[0] * length, AIR_MM[1] * length)


def our_worker(case: dict[str, Any]) -> dict[str, Any]:
    """Search with ours."""
    from rptcam_cl.core.strict_yaml import read_yaml
    from rptcam_cl.optics.design import read_problem
    from rptcam_cl.optics.files.export import lens_text
    from rptcam_cl.optics.optimise import optimise

    lens = disturbed(case)
    data = read_yaml(lens_text(lens)).data
    glass, air = limits(case)
    given = read_problem({
        "lens": data, "f_number": case["f_number"], "focal_length_mm": case["focal_length_mm"],
        "fields_degrees": case["fields"], "wavelengths_nm": WAVELENGTHS_NM, "variables": varied(lens, case),
        "bounds": {"glass_centre_mm": list(glass), "air_centre_mm": list(air), "air_edge_mm": -1e3,
                   "glass_edge_mm": -1e3},
        "vignetting": False, "evaluations": 600,
    })  # fmt: skip
    begin = time.process_time()
    found = optimise(given)
    seconds = time.process_time() - begin
    rows = [[s.curvature, s.thickness, s.conic, list(s.aspheric)] for s in found.lens.surfaces]
    return {"cpu_s": seconds, "evaluations": found.evaluations, "rows": rows, "film_mm": found.film_mm}


def optiland_worker(case: dict[str, Any]) -> dict[str, Any]:
    """Search with optiland: its least squares, curvatures as variables, spots as operands; a last step ends it."""
    from optiland.optimization import LeastSquares

    optic = _optiland_lens(case)
    problem = _optiland_problem(optic, case)
    begin = time.process_time()

    def stop_in_time(*_: Any, **__: Any) -> None:
        if time.process_time() - begin > case["seconds"]:
            raise StopIteration

    result = LeastSquares(problem).optimize(
        maxiter=case["iterations"], tol=1e-6, callback=stop_in_time, method_choice="trf", x_scale="jac"
    )
    seconds = time.process_time() - begin
    found = _optiland_rows(optic, case["rows"])
    return {
        "cpu_s": seconds, "evaluations": int(result.nfev), "rows": found, "film_mm": found[-1][1],
        "ended": "out of time" if seconds > case["seconds"] else str(result.message),
    }  # fmt: skip


def _optiland_lens(case: dict[str, Any]) -> Any:
    """Return the disturbed lens of a case with its fields and wavelengths."""
    import numpy as np
    from optiland.materials import BaseMaterial
    from optiland.optic import Optic

    class Glass(BaseMaterial):
        def __init__(self, values: list[float]) -> None:
            super().__init__()
            self.values = values

        def _calculate_n(self, wavelength: Any, **_: Any) -> Any:
            return np.interp(wavelength, np.array(WAVELENGTHS_NM) * 1e-3, self.values)

        def _calculate_k(self, wavelength: Any, **_: Any) -> Any:
            return 0.0 * np.asarray(wavelength)

    optic, rows = Optic(), case["rows"]
    optic.surfaces.add(index=0, thickness=math.inf)
    for number, row in enumerate(rows, start=1):
        more: dict[str, Any] = {}
        if row["aspheric"]:
            powers = dict(row["aspheric"])
            more = {"surface_type": "odd_asphere", "coefficients": [powers.get(p, 0.0) for p in range(1, 11)]}
        optic.surfaces.add(
            index=number, radius=1 / row["curvature"] if row["curvature"] else math.inf, conic=row["conic"],
            thickness=case["film_mm"] if number == len(rows) else row["thickness"],
            material=Glass(row["indices"]) if row["is_glass"] else "air", is_stop=row["stop"], **more,
        )  # fmt: skip
    optic.surfaces.add(index=len(rows) + 1)
    optic.set_aperture(aperture_type="EPD", value=case["focal_length_mm"] / case["f_number"])
    optic.fields.set_type("angle")
    for degrees in case["fields"]:
        optic.fields.add(y=degrees)
    for nm in WAVELENGTHS_NM:
        optic.wavelengths.add(value=nm * 1e-3, is_primary=nm == WAVELENGTHS_NM[1])
    return optic


def _optiland_problem(optic: Any, case: dict[str, Any]) -> Any:
    """Return what varies, and the spots of all fields and the focal length as what is sought."""
    from optiland.optimization import OptimizationProblem

    problem, rows = OptimizationProblem(), case["rows"]
    glass, air = (tuple(pair) for pair in case["limits"])
    for k in case["varied"]["curvatures"]:
        problem.add_variable(optic, "reciprocal_radius", surface_number=k + 1)
    for k in case["varied"]["thicknesses"]:
        low, high = glass if rows[k]["is_glass"] else air
        problem.add_variable(optic, "thickness", surface_number=k + 1, min_val=low, max_val=high)
    problem.add_variable(optic, "thickness", surface_number=len(rows))
    for k, powers in case["varied"]["aspheric"].items():
        for power in powers:
            problem.add_variable(optic, "asphere_coeff", surface_number=int(k) + 1, coeff_number=power - 1)
    most = max(case["fields"])
    for degrees in case["fields"]:
        data = {"optic": optic, "surface_number": -1, "Hx": 0, "Hy": degrees / most, "num_rays": 6,
                "wavelength": "all", "distribution": "hexapolar", "nan_policy": "omit"}  # fmt: skip
        problem.add_operand("rms_spot_size", target=0, weight=1e3, input_data=data)
    problem.add_operand("f2", target=case["focal_length_mm"], weight=1e3, input_data={"optic": optic})
    return problem


def _optiland_rows(optic: Any, rows: list[dict[str, Any]]) -> list[list[Any]]:
    """Return curvature, thickness, conic and aspheric terms of each surface as found."""
    import numpy as np

    found = []
    for number, row in enumerate(rows, start=1):
        surface = optic.surfaces[number]
        radius = float(surface.geometry.radius)
        aspheric = [list(pair) for pair in row["aspheric"]]
        if row["aspheric"]:
            aspheric = [
                [p, float(c)] for p, c in zip(range(1, 11), surface.geometry.coefficients, strict=False) if p > 1 and c
            ]
        gap = float(np.ravel(surface.thickness)[0])
        found.append([1 / radius if math.isfinite(radius) else 0.0, gap, row["conic"], aspheric])
    return found


def request(case: dict[str, Any]) -> dict[str, Any]:
    """Return what optiland's worker needs: it does not know our lens files."""
    import numpy as np

    lens = disturbed(case)
    indices = lens.indices(np.array(WAVELENGTHS_NM))
    rows = [
        {"curvature": s.curvature, "thickness": s.thickness, "conic": s.conic, "aspheric": list(s.aspheric),
         "stop": k == lens.stop_index, "is_glass": float(indices[k + 1, 1]) > 1.001, "indices": indices[k + 1].tolist()}
        for k, s in enumerate(lens.surfaces)
    ]  # fmt: skip
    film = lens.first_order(WAVELENGTHS_NM[1]).back_focal_distance_mm
    return {**case, "rows": rows, "film_mm": film, "varied": varied(lens, case), "limits": limits(case)}


def judged(case: dict[str, Any], rows: list[Any] | None, film_mm: float | None) -> dict[str, Any]:
    """Return the rms spot over fields and wavelengths [µm] about the centroid and about the d line's, and lost rays.

    The film goes where the spots are least; a length of all that is off is scaled away.
    """
    import numpy as np

    from rptcam_cl.optics.ray_trace import trace

    lens = disturbed(case)
    if rows is not None:
        names = ("curvature", "thickness", "conic")
        lens = lens.with_changes({
            k: dict(zip(names, row[:3], strict=True)) | {"aspheric": tuple(map(tuple, row[3]))}
            for k, row in enumerate(rows)
        })  # fmt: skip
    first = lens.first_order(WAVELENGTHS_NM[1])
    scale = case["focal_length_mm"] / first.focal_length_mm
    film = first.back_focal_distance_mm if film_mm is None else film_mm
    lens = lens.with_changes({k: {"semi_diameter": math.inf} for k in range(len(lens.surfaces))})
    radius = abs(first.focal_length_mm) / case["f_number"] / 2
    n = np.arange(400)
    r, a = radius * np.sqrt((n + 0.5) / 400), n * math.pi * (3 - math.sqrt(5))  # a spiral that covers a disc evenly
    origins = np.stack([r * np.cos(a), r * np.sin(a), np.full(400, first.entrance_pupil.distance_mm)], axis=1)
    centred, about_d, lost, count = [], [], 0, 0
    for degrees in case["fields"]:
        angle, points = math.radians(degrees), []
        for nm in WAVELENGTHS_NM:
            rays = trace(lens, origins, [0, math.sin(angle), math.cos(angle)], nm, "scene")
            p, d = rays.origins[rays.passed], rays.directions[rays.passed]
            points.append(p[:, :2] + d[:, :2] / d[:, 2:] * (lens.film_z(film) - p[:, 2])[:, None])
            lost, count = lost + int((~rays.passed).sum()), count + len(rays.passed)
        every = np.concatenate(points)
        centred.append(float(np.mean(np.sum((every - every.mean(axis=0)) ** 2, axis=1))))
        about_d.append(float(np.mean(np.sum((every - points[1].mean(axis=0)) ** 2, axis=1))))
    um = 1e3 * abs(scale)
    return {
        "spot_um": um * math.sqrt(np.mean(centred)), "about_d_um": um * math.sqrt(np.mean(about_d)),
        "lost_percent": 100 * lost / count, "focal_length_mm": first.focal_length_mm,
    }  # fmt: skip


def run(python: str, which: str, case: dict[str, Any]) -> dict[str, Any]:
    """Run a worker in a process of its own; what it raised is an entry ``error``."""
    command = [python, str(Path(__file__).resolve()), "--worker", which]
    done = subprocess.run(
        command, input=json.dumps(case), capture_output=True, text=True, env={**os.environ, **THREADS}
    )
    if done.returncode:
        return {"error": done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "ended"}
    return dict(json.loads(done.stdout.splitlines()[-1]))


def has_optiland(python: str) -> bool:
    """Return whether a Python has optiland."""
    return subprocess.run([python, "-c", "import optiland"], capture_output=True).returncode == 0


def main() -> None:
    """Run all cases and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--optics-python", default=sys.executable, metavar="PATH")
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--iterations", type=int, default=200, help="steps that optiland may take")
    parser.add_argument("--seconds", type=float, default=300, help="CPU seconds for optiland")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--worker", choices=("ours", "optiland"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        case = json.load(sys.stdin)
        print(json.dumps((our_worker if arguments.worker == "ours" else optiland_worker)(case)))
        return
    from rptcam_cl.optics.library import load_lens

    beside = has_optiland(arguments.optics_python)
    if not beside:
        print(f"{arguments.optics_python} has no optiland: its column is left out (--optics-python)")
    results = {}
    for name in arguments.cases.split(","):
        length = load_lens(CASES[name]["lens"]).first_order(WAVELENGTHS_NM[1]).focal_length_mm
        case = {
            **CASES[name],
            "focal_length_mm": length,
            "iterations": arguments.iterations,
            "seconds": arguments.seconds,
        }
        rows: dict[str, Any] = {"start": judged(case, None, None)}
        for which, python in (("ours", sys.executable), ("optiland", arguments.optics_python)):
            if which == "ours" or beside:
                found = run(python, which, request(case) if which == "optiland" else case)
                rows[which] = found if "error" in found else found | judged(case, found["rows"], found["film_mm"])
        results[name] = rows
        print(name)
        for which, row in rows.items():
            if "error" in row:
                print(f"  {which:9} {row['error']}")
                continue
            cost = f"{row['cpu_s']:8.2f} s CPU, {row['evaluations']:5} evaluations" if "cpu_s" in row else ""
            cost += f" ({row['ended']})" if "ended" in row else ""
            print(
                f"  {which:9} spot {row['spot_um']:9.3f} µm (about d {row['about_d_um']:9.3f}), "
                f"f {row['focal_length_mm']:8.3f} mm, lost {row['lost_percent']:4.1f} %{cost}"
            )
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
