"""The worker that traces rays and finds aberrations with another lens program, ``optiland`` or ``ray-optics``.

Its Python needs only that. Requests: ``load`` rows of a lens, scene side first (radius, thickness to the next, index
behind, semi-diameter; all in millimetres), ``trace`` rays from a plane before the first vertex, z = 0, and
``aberrations`` of rows with conics and aspheres.
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
FDC = (486.1327, WAVELENGTH_NM, 656.2725)
FAR_MM = 1e7  # a distant object of ray-optics
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


def optiland_aberrations(request: dict[str, Any]) -> dict[str, Any]:
    """Return what optiland knows: first-order rays, Seidel sums of conics, colour, thin pencils, rays of a fan."""
    from optiland.materials import IdealMaterial
    from optiland.optic import Optic

    class Glass(IdealMaterial):
        def __init__(self, indices: Sequence[float]) -> None:
            super().__init__(n=indices[1])
            self.indices = indices

        def _calculate_n(self, wavelength: Any, **more: Any) -> Any:
            return np.interp(wavelength, [nm * 1e-3 for nm in FDC], self.indices)

    optic, rows = Optic(), request["rows"]
    optic.surfaces.add(index=0, thickness=math.inf)
    for k, row in enumerate(rows, start=1):
        shape: dict[str, Any] = {"conic": row["conic"]}
        if row["aspheric"]:
            factors = [row["aspheric"].get(str(power), 0.0) for power in range(2, 14, 2)]
            shape |= {"surface_type": "even_asphere", "coefficients": factors}
        optic.surfaces.add(
            index=k, radius=math.inf if row["radius"] is None else row["radius"], material=Glass(row["indices"]),
            thickness=row["thickness"] if k < len(rows) else request["film"], is_stop=row["stop"], **shape,
        )  # fmt: skip
    optic.surfaces.add(index=len(rows) + 1)
    optic.set_aperture(aperture_type="EPD", value=request["diameter"])
    optic.fields.set_type("angle")
    optic.fields.add(y=0.0)
    optic.fields.add(y=request["field"])
    for nm in FDC:
        optic.wavelengths.add(value=nm * 1e-3, is_primary=nm == WAVELENGTH_NM)
    (heights, slopes), chief = optic.paraxial.marginal_ray(), optic.paraxial.chief_ray()[0]
    spherical, _, coma, _, astigmatism, _, petzval, _, distortion, axial, _, lateral, _ = (
        np.ravel(part) for part in optic.aberrations.third_order()
    )
    converge = 2 * rows[-1]["indices"][1] * float(np.ravel(slopes)[-1])
    figures = {"first-order rays": [np.ravel(part)[1:-1].tolist() for part in (heights, chief)]}
    if not any(row["aspheric"] for row in rows):
        sums = np.stack([spherical, coma, astigmatism, petzval, distortion], axis=1)
        figures["Seidel sums"] = (converge * sums).tolist()
        figures["colour"] = (converge / 2 * np.stack([axial, lateral], axis=1)).tolist()
    rays = optic.trace_generic(0.0, 1.0, 0.0, np.array([0.0, *request["pupil"]]), WAVELENGTH_NM * 1e-3)
    at = np.ravel(rays.y)
    figures["fan [mm]"] = (at[1:] - at[0]).tolist()
    figures["Zernikes [waves]"] = optiland_zernikes(optic, request["circle"], request["terms"])
    return {"figures": figures, "heights": (request["diameter"] / 2 * np.array(request["pupil"])).tolist()}


def optiland_zernikes(optic: Any, circle: Sequence[float], terms: int) -> list[float]:
    """Return optiland's Noll coefficients of its wavefront, but for the first, over a circle of direction cosines."""
    from optiland.wavefront import Wavefront
    from optiland.zernike import ZernikeFit

    field, um = (0.0, 1.0), WAVELENGTH_NM * 1e-3
    waves = Wavefront(optic, fields=[field], wavelengths=[um], num_rays=24, distribution="hexapolar")
    rays = optic.trace(*field, um, None, waves.distribution)
    x, y = ((np.ravel(part) - middle) / circle[2] for part, middle in zip((rays.L, rays.M), circle, strict=False))
    fit = ZernikeFit(x, y, np.ravel(waves.get_data(field, um).opd), "noll", terms)
    return [float(factor) for factor in np.ravel(fit.coeffs)[1:]]


def rayoptics_aberrations(request: dict[str, Any]) -> dict[str, Any]:
    """Return what ray-optics knows: first-order rays, Seidel sums, thin pencils of spheres, a fan with its paths."""
    from rayoptics.elem.profiles import EvenPolynomial
    from rayoptics.environment import FieldSpec, OpticalModel, PupilSpec, WvlSpec
    from rayoptics.parax.thirdorder import compute_third_order
    from rayoptics.raytr import trace

    model, rows = OpticalModel(), request["rows"]
    sequence, optics = model["seq_model"], model["optical_spec"]
    model.radius_mode = True
    optics["pupil"] = PupilSpec(optics, key=["object", "epd"], value=request["diameter"])
    optics["fov"] = FieldSpec(
        optics, key=["object", "angle"], value=request["field"], flds=[0.0, 1.0], is_relative=True
    )
    optics["wvls"] = WvlSpec([(WAVELENGTH_NM, 1.0)], ref_wl=0)
    sequence.gaps[0].thi = FAR_MM
    for k, row in enumerate(rows):
        thickness = row["thickness"] if k + 1 < len(rows) else request["film"]
        glass = [row["indices"][1], 60.0] if row["indices"][1] != 1.0 else []
        sequence.add_surface([row["radius"] or 0.0, thickness, *glass])
        if row["conic"] or row["aspheric"]:
            factors = [row["aspheric"].get(str(power), 0.0) for power in range(2, 14, 2)]
            sequence.ifcs[sequence.cur_surface].profile = EvenPolynomial(
                r=row["radius"], cc=row["conic"], coefs=factors
            )
        if row["stop"]:
            sequence.set_stop()
    model.update_model()
    known = model["analysis_results"]["parax_data"]
    sums, table = np.zeros((len(rows), 5)), compute_third_order(model)
    for name, values in table.iterrows():
        if name != "sum":
            sums[int(str(name).split(".")[0]) - 1] += values.to_numpy()
    field = optics["fov"].fields[1]
    figures: dict[str, Any] = {
        "first-order rays": [[float(ray[0]) for ray in part[1:-1]] for part in (known.ax_ray, known.pr_ray)],
        "Seidel sums": sums.tolist(),
    }
    if not any(row["conic"] or row["aspheric"] for row in rows):
        pencils = trace.trace_astigmatism_coddington_fan(model, field, WAVELENGTH_NM, 0.0)
        figures["thin pencils [mm]"] = [float(part) for part in pencils]
    traced = [trace.trace_with_opd(model, [0.0, p], field, WAVELENGTH_NM, 0.0) for p in (0.0, *request["pupil"])]
    at = [float(ray[-1][0][1]) for ray, *_ in traced]
    figures["fan [mm]"] = [y - at[0] for y in at[1:]]
    figures["path [waves]"] = [float(opd) / (WAVELENGTH_NM * 1e-6) for *_, opd in traced[1:]]
    met, slope = [ray[1][0] for ray, *_ in traced[1:]], math.tan(math.radians(request["field"]))
    return {"figures": figures, "heights": [float(point[1] - point[2] * slope) for point in met]}


ABERRATIONS = {"optiland": optiland_aberrations, "rayoptics": rayoptics_aberrations}
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
        if request["do"] == "aberrations":
            return ABERRATIONS[name](request)
        points, directions = np.array(request["points"]), np.array(request["directions"])
        points, directions = (np.tile(part, (request["copies"], 1)) for part in (points, directions))
        found: list[Array] = []
        times = timed(lambda: found.append(loaded["lens"](points, directions)))
        count = len(request["points"])
        return {"wall": times.wall, "cpu": times.cpu, "rays": len(points), "at": found[0][:count].tolist()}

    return f"{name} {version}", respond


if __name__ == "__main__":
    serve(start)
