"""The worker that traces rays with another lens program, ``optiland`` or ``ray-optics``; its Python needs only that.

Requests: ``load`` rows of a lens, scene side first (radius, thickness to the next, index behind, semi-diameter; all in
millimetres), ``trace`` rays from a plane before the first vertex, z = 0.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.stopwatch import timed
from benchmarks.worker import WorkerError, serve

Array = NDArray[np.float64]
Trace = Callable[[Array, Array], Array]  # points and directions (n, 3) -> points (n, 2) on the last surface
Row = dict[str, Any]
WAVELENGTH_NM = 587.5618
BEFORE_MM = 1.0  # of the first vertex, where rays start


def optiland_tracer(rows: Sequence[Row]) -> Trace:
    """Return optiland's trace of many rays at once, with numpy."""
    from optiland.materials import IdealMaterial
    from optiland.optic import Optic
    from optiland.rays import RealRays

    optic = Optic()
    optic.surfaces.add(index=0, thickness=math.inf)
    for number, row in enumerate(rows, start=1):
        radius = math.inf if row["radius"] is None else row["radius"]
        optic.surfaces.add(
            index=number,
            radius=radius,
            thickness=row["thickness"],
            material=IdealMaterial(n=row["index"]),
            is_stop=row["stop"],
        )
    optic.surfaces.add(index=len(rows) + 1)
    optic.wavelengths.add(value=WAVELENGTH_NM * 1e-3, is_primary=True)
    surfaces = [optic.surfaces[k] for k in range(1, len(rows) + 1)]

    def trace(points: Array, directions: Array) -> Array:
        ones = np.ones(len(points))
        rays = RealRays(*points.T.copy(), *directions.T.copy(), ones, ones * WAVELENGTH_NM * 1e-3)
        for surface in surfaces:
            rays = surface.trace(rays)
        return np.stack([rays.x, rays.y], axis=1)

    return trace


def rayoptics_tracer(rows: Sequence[Row]) -> Trace:
    """Return ray-optics' trace, one ray after the other."""
    from rayoptics.environment import OpticalModel
    from rayoptics.raytr import raytrace

    model = OpticalModel()
    sequence = model["seq_model"]
    sequence.gaps[0].thi = BEFORE_MM
    model.radius_mode = True
    for row in rows:
        glass = [row["index"], 60.0] if row["index"] != 1.0 else []
        sequence.add_surface([0.0 if row["radius"] is None else row["radius"], row["thickness"], *glass])
    model.update_model()

    def trace(points: Array, directions: Array) -> Array:
        found = np.empty((len(points), 2))
        starts = points + np.array([0.0, 0.0, BEFORE_MM])
        for k, (point, direction) in enumerate(zip(starts, directions, strict=True)):
            segments, _, _ = raytrace.trace(sequence, point, direction, WAVELENGTH_NM)
            found[k] = segments[-2][0][:2]  # the last is the image
        return found

    return trace


PROGRAMS: dict[str, Callable[[Sequence[Row]], Trace]] = {"optiland": optiland_tracer, "rayoptics": rayoptics_tracer}


def start() -> tuple[str, Callable[[dict[str, Any]], dict[str, Any]]]:
    """Return the description of the program and its answers."""
    import importlib.metadata

    name = sys.argv[1]
    try:
        version = importlib.metadata.version(name)
        __import__(name)
    except ImportError as error:
        raise WorkerError(f"{name} cannot be imported ({error}); pip install {name}") from error
    loaded: dict[str, Trace] = {}

    def respond(request: dict[str, Any]) -> dict[str, Any]:
        if request["do"] == "load":
            loaded["lens"] = PROGRAMS[name](request["rows"])
            return {}
        points, directions = np.array(request["points"]), np.array(request["directions"])
        points, directions = (np.tile(part, (request["copies"], 1)) for part in (points, directions))
        found: list[Array] = []
        times = timed(lambda: found.append(loaded["lens"](points, directions)))
        count = len(request["points"])
        return {"wall": times.wall, "cpu": times.cpu, "rays": len(points), "at": found[0][:count].tolist()}

    return f"{name} {version}", respond


if __name__ == "__main__":
    serve(start)
