"""The suite of `rptcam doctor --numerics`: checks of lenses and of whole pictures, and what a render runs on."""

from __future__ import annotations

import hashlib
import math
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_D_NM, __version__, files, strict_yaml
from rptcam_cl.core.errors import DeviceError, InputError
from rptcam_cl.device.devices import (
    default_device,
    device_details,
    driver_answers,
    fitting_devices,
    list_devices,
    opencl_version,
)
from rptcam_cl.device.drivers import pocl_cache_folder
from rptcam_cl.device.session import Session
from rptcam_cl.optics.glass import AIR, ConstantIndex
from rptcam_cl.optics.lens import Lens, film_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import Rays, Status, at_plane, axis_points
from rptcam_cl.optics.surface import Surface
from rptcam_cl.rendering.account import film_rays
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.passes import PACKETS, Way, fault_of
from rptcam_cl.rendering.plan.plan import Plan, make_plan
from rptcam_cl.rendering.progressive import render_plan
from rptcam_cl.rendering.scene_buffers import cache_folder
from rptcam_cl.rendering.traceable_lens import Precision, trace_on_device
from rptcam_cl.rendering.tracer import ORGANISATION, Wavefront
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies import selfcheck

# Checks of lenses at their extremes: the device in float32 against float64 and against closed forms.

Array = NDArray[np.float64]

EPS = 2.0**-24  # half a unit in the last place of float32 at 1
RADII = tuple(sign * 10.0**power for power in range(10) for sign in (-1, 1))  # [mm]; planes besides
LENSES = ("dgauss-50mm", "wide-22mm", "fisheye-10mm", "telephoto-250mm", "asphere-1.4mm", "anamorphic-100mm")
_SURFACE_RAYS = 200
STEPS = np.array([-1e-1, -1e-2, -1e-3, -1e-4, 1e-4, 1e-3, 1e-2, 1e-1])  # about the critical angle [radians]


def surface_errors(
    session: Session, radius_mm: float, index: float, start: str, rng: np.random.Generator
) -> tuple[float, float, int]:
    """What float32 does wrong for rays that meet a surface of some radius, up to 30 mm, into or out of some index.

    Returns
    -------
    position : float
        Largest error of the point, over the size of the surface.
    direction : float
        Largest error of the direction, over what it may be: an error of the cosine behind the surface grows as the
        critical angle comes near.
    wrong : int
        Rays with another fate than in float64, but for those within 0.2 degrees of the critical angle, and rays that
        are not finite.
    """
    sense = 1.0 if start == "scene" else -1.0
    size = min(abs(radius_mm), 30.0)
    lens = Lens(f"{radius_mm:g}", (Surface(1 / radius_mm, 0.0, ConstantIndex(index), 0.9 * size),))
    directions = np.column_stack([rng.uniform(-0.6, 0.6, (_SURFACE_RAYS, 2)), np.full(_SURFACE_RAYS, sense)])
    aims = np.column_stack([rng.uniform(-0.6, 0.6, (_SURFACE_RAYS, 2)) * size, np.zeros(_SURFACE_RAYS)])
    origins = aims - directions * size
    wanted = lens.trace(origins, directions, start=start)
    got = trace_on_device(lens, session, origins, directions, LINE_D_NM, start, "single")
    finite = np.isfinite(got.origins).all(axis=1) & np.isfinite(got.directions).all(axis=1)
    cosine = _cosines_behind(lens, wanted, directions, start)
    far = cosine >= 3e-3
    both = got.passed & wanted.passed
    turned = np.abs(got.directions - wanted.directions).max(axis=1)[both]
    position = float(np.abs(got.origins - wanted.origins)[both].max(initial=0.0)) / size
    direction = float((turned * cosine[both] / (EPS * (2 + index**2))).max(initial=0.0))
    return position, direction, int((far & (got.status != wanted.status)).sum() + (~finite).sum())


def _cosines_behind(lens: Lens, rays: Rays, directions: Array, start: str) -> Array:
    """Return the cosine of the angle behind the only surface of a lens; 1 for rays that do not reach it."""
    c = lens.surfaces[0].curvature
    normal = np.column_stack([-c * rays.origins[:, :2], 1 - c * rays.origins[:, 2]])
    d = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    before, after = lens.indices()[:: 1 if start == "scene" else -1]
    square = 1 - (before / after) ** 2 * (1 - np.sum(d * normal, axis=1) ** 2)
    reached = (rays.status == Status.ok) | (rays.status == Status.total_internal_reflection)
    return np.where(reached, np.sqrt(np.abs(square)), 1.0)


def _radius_checks(session: Session) -> list[selfcheck.Check]:
    """Spheres of ten decades of radius and planes, from both sides, into denser and thinner media."""
    rng = np.random.default_rng(5)
    errors = [
        surface_errors(session, radius, index, start, rng)
        for radius in (*RADII, np.inf)
        for index, start in ((0.75, "scene"), (1.5, "scene"), (1.5, "film"), (4.0, "film"))
    ]
    positions, turns, wrong = zip(*errors, strict=True)
    return [
        # six roundings of the size of the start, which 0.25, the least cosine of incidence, enlarges
        selfcheck.Check("lens: points on R = 1 to 1e9 mm and planes", max(positions), 24 * EPS, "of the size"),
        selfcheck.Check("lens: directions behind them", max(turns), 12, "roundings"),
        selfcheck.Check("lens: fates there", sum(wrong), 0, f"of {200 * len(errors)} rays wrong"),
    ]


def _reflection_check(session: Session) -> selfcheck.Check:
    """Rays beside the critical angle, from both sides, through planes and almost planes."""
    wrong = count = 0
    for start, first, last in (("scene", 1.5, 1.0), ("film", 1.0, 1.5), ("scene", 1.0, 0.75)):
        before, after = (first, last) if start == "scene" else (last, first)
        angles = np.arcsin(after / before) + STEPS
        sense = 1.0 if start == "scene" else -1.0
        directions = np.column_stack([np.zeros(len(angles)), np.sin(angles), sense * np.cos(angles)])
        for curvature in (0.0, 1e-6, -1e-6):
            surface = Surface(curvature, 0.0, ConstantIndex(last), 5.0)
            lens = Lens("step", (surface,), object_medium=ConstantIndex(first))
            rays = trace_on_device(lens, session, -directions, directions, LINE_D_NM, start, "single")
            expected = np.where(STEPS < 0, Status.ok, Status.total_internal_reflection)
            wrong, count = wrong + int((rays.status != expected).sum()), count + len(angles)
    return selfcheck.Check("lens: total reflection within 1e-4 of its angle", wrong, 0, f"of {count} rays wrong")


def parallel(heights: Array) -> tuple[Array, Array]:
    """Return rays along the axis at heights, all round it."""
    turn = np.arange(len(heights)) * 2.4
    origins = np.column_stack([heights * np.cos(turn), heights * np.sin(turn), np.full(len(heights), -20.0)])
    return origins, np.tile([0, 0, 1.0], (len(heights), 1))


def spot(rays: Rays, z: float) -> Array:
    """Return the distances [mm] from the axis at which rays cross a plane."""
    return np.asarray(np.hypot(*at_plane(rays.origins, rays.directions, z)[:, :2].T))


def plano_hyperbolic(conic: float, n: float = 1.5, focal: float = 20.0) -> tuple[Lens, float]:
    """Return a lens that takes collimated light through a plane and out of a conic, and where it has its focus [mm].

    With a conic constant of -n^2, a hyperboloid, the focus is a point.
    """
    front = Surface(0.0, 10.0, ConstantIndex(n), 12.0)
    return Lens("hyperboloid", (front, Surface(-1 / (focal * (n - 1)), 0, AIR, 12.0, conic=conic))), 10.0 + focal


def ellipsoidal(conic: float, n: float = 1.5, focal: float = 20.0) -> tuple[Lens, float]:
    """Return a lens that takes collimated light into a conic of glass, and the focus inside; a point for -1 / n^2."""
    surface = Surface(n / (focal * (n - 1)), 0, ConstantIndex(n), 5.5, conic=conic)
    return Lens("ellipsoid", (surface,)), focal


def weierstrass_error(session: Session, index: float, precision: Precision) -> float:
    """Return the largest error [mm] of the image of the aplanatic point of a sphere of 10 mm and index 1.5."""
    n, r = 1.5, 10.0
    lens = Lens("aplanatic", (Surface(-1 / r, 0, AIR, r),), object_medium=ConstantIndex(index))
    angles, turn = np.radians(np.linspace(2, 56, 60)), np.arange(60) * 2.4  # atan n is where the hemisphere ends
    directions = np.column_stack([np.sin(angles) * np.cos(turn), np.sin(angles) * np.sin(turn), np.cos(angles)])
    origins = np.tile([0, 0, -r - r / n], (60, 1))
    rays = trace_on_device(lens, session, origins, directions, LINE_D_NM, "scene", precision)
    return float(np.abs(axis_points(rays.origins, rays.directions) + r + n * r).max()) if rays.passed.all() else np.inf


def _stigmatic_checks(session: Session) -> list[selfcheck.Check]:
    """Lenses that image a point sharply, whatever the angle: conics and the aplanatic sphere."""
    worst = 0.0
    for (lens, focus), height in ((plano_hyperbolic(-2.25), 9.0), (ellipsoidal(-1 / 2.25), 5.0)):
        beam = parallel(np.linspace(0.1, height, 60))
        rays = trace_on_device(lens, session, *beam, LINE_D_NM, "scene", "single")
        size = float(np.sqrt(np.mean(spot(rays, focus) ** 2))) if rays.passed.all() else np.inf
        worst = max(worst, size)
    return [
        selfcheck.Check("lens: spot of stigmatic conics", worst, 1e-4, "mm"),
        selfcheck.Check("lens: aplanatic point of a sphere", weierstrass_error(session, 1.5, "single"), 1e-4, "mm"),
    ]


def _library_errors(session: Session, name: str, precision: Precision) -> tuple[float, float, int]:
    """Return the largest errors of position [mm] and direction of 512 rays through a lens of the library, and how many
    pass that should not or the other way round."""
    lens = load_lens(name)
    try:
        film_distance_mm = film_distance(lens, 1e7)
    except InputError:
        film_distance_mm = abs(lens.first_order().focal_length_mm)
    half_film_mm = 0.3 * abs(lens.first_order().focal_length_mm)
    origins, directions = film_rays(lens, film_distance_mm, (half_film_mm, half_film_mm), LINE_D_NM)
    exact = lens.trace(origins, directions)
    got = trace_on_device(lens, session, origins, directions, LINE_D_NM, "film", precision)
    both = exact.passed & got.passed
    position = np.abs(got.origins - exact.origins)[both].max(initial=0.0)
    direction = np.abs(got.directions - exact.directions)[both].max(initial=0.0)
    return float(position), float(direction), int((exact.passed != got.passed).sum())


def _library_checks(session: Session) -> list[selfcheck.Check]:
    """Rays through lenses of the library, aspheres and cylinders among them, against the float64 reference."""
    errors = np.array([_library_errors(session, name, "single") for name in LENSES])
    checks = [
        selfcheck.Check(f"lens: points behind {len(LENSES)} real lenses", errors[:, 0].max(), 6e-5, "mm"),
        selfcheck.Check("lens: directions behind them", errors[:, 1].max(), 3e-6, "of 1"),
        # a ray within a millionth of a rim may go either way
        selfcheck.Check(
            "lens: fates in them", errors[:, 2].sum(), 2, f"of {512 * len(LENSES)} rays other than in float64"
        ),
    ]
    precise = "lens: the first of them in float64", "mm"
    if not session.info.fp64:
        return [*checks, selfcheck.needs_float64(*precise)]
    name, unit = precise
    return [*checks, selfcheck.Check(name, max(_library_errors(session, LENSES[0], "double")), 1e-11, unit)]


# Checks of whole pictures: light that is neither lost nor made, and the same bits however the work is cut up.

Picture = NDArray[np.float32]

DEPTH = 6
REFLECTANCE = 0.8
UNLIKE = 0.02  # share of the values that rounding may change by more than 1e-5, by sending paths elsewhere
# By how much a picture may change, over its mean: by roundings that send paths elsewhere, by parts of a pixel.
ROUNDED = 0.02
FITTED = 0.2
_OF_MEAN = "of the mean, root mean square"
_SPHERE_RADII = (1e-3, 1.0, 1e4)  # of cavities [m]

MATTE = {"kind": "matte", "reflectance": REFLECTANCE}
STUDIO: dict[str, Any] = {
    "film": {"resolution": [48, 32]},
    "camera": {
        "kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 5.0}, "eye": [0.5, -5, 2],
        "target": [0, 0, 0.5], "up": [0, 0, 1],
    },
    "render": {"spp": 16, "max_depth": 5},
    "environment": {"kind": "constant", "radiance": 0.2},
    "objects": [
        {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": MATTE},
        {"shape": "sphere", "center": [-0.7, 0, 0.6], "radius": 0.6, "material": {"kind": "dielectric", "index": 1.5}},
        {"shape": "box", "min": [0.3, 0, 0], "max": [1.1, 0.8, 0.9], "material": MATTE},
        {
            "shape": "rectangle", "corner": [-1, -1, 3], "edge_u": [0, 1, 0], "edge_v": [1, 0, 0],
            "material": {"kind": "emissive", "radiance": 8},
        },
    ],
}  # fmt: skip


def cavity(radius: float, reflectance: float = REFLECTANCE, depth: int = DEPTH) -> dict[str, Any]:
    """Return a scene inside a matte sphere with a point light in its middle: every sample is the same."""
    wall = {"shape": "sphere", "center": [0, 0, 0], "radius": radius, "material": MATTE | {"reflectance": reflectance}}
    eye = [0.3 * radius, -0.4 * radius, 0.1 * radius]
    return {
        "film": {"resolution": [16, 16]},
        "camera": {
            "kind": "pinhole", "fov_degrees": 100, "eye": eye, "target": [radius, radius, 0], "up": [0, 0, 1],
        },
        "render": {"spp": 4, "max_depth": depth, "roulette_depth": 0},
        "objects": [wall],
        "lights": [{"kind": "point", "position": [0, 0, 0], "intensity": radius**2 * math.pi}],
    }  # fmt: skip


def picture(
    session: Session,
    scene: Scene,
    plan: Plan,
    *,
    wave_size: int | None = None,
    organisation: str | None = None,
) -> Picture:
    """Return the film of a scene."""
    wavefront = Wavefront(session, plan, FilmLayout.of(scene.film), scene.render, wave_size, organisation)
    wavefront.warm_up()
    return render_plan(wavefront, spp=scene.render.most_spp, seconds=None, has_lens=plan.camera.has_lens).pixels


def _cavity_error(session: Session, mapping: Mapping[str, Any], reflectance: float, depth: int) -> float:
    """Return the largest relative error of the pixels of a cavity: vertex k adds reflectance^k."""
    scene = load_scene(mapping)
    series = sum(reflectance**k for k in range(1, depth))
    return float(np.abs(picture(session, scene, make_plan(scene)).astype(np.float64) / series - 1).max())


def _energy_check(session: Session) -> selfcheck.Check:
    """Light in closed rooms from a millimetre to ten kilometres against the truncated series."""
    worst = max(_cavity_error(session, cavity(radius), REFLECTANCE, DEPTH) for radius in _SPHERE_RADII)
    return selfcheck.Check("pictures: light in closed rooms of 1e-3 to 1e4 m", worst, 2e-6 + 1e-6 * DEPTH, "relative")


def _organisation_checks(session: Session) -> list[selfcheck.Check]:
    """One picture through a lens with waves of two sizes, and by both ways to organise the work."""
    scene = load_scene(STUDIO)
    plan = make_plan(scene)
    whole = picture(session, scene, plan)
    small = picture(session, scene, plan, wave_size=1024)
    stream, passes = (picture(session, scene, plan, organisation=name) for name in ("stream", "passes"))
    unlike = 1 - float(np.isclose(stream, passes, rtol=1e-5, atol=1e-6).mean())
    bits = int((whole.view(np.uint32) != small.view(np.uint32)).sum())
    return [
        selfcheck.Check("pictures: small waves and large", bits, 0, f"of {whole.size} values differ in a bit"),
        selfcheck.Check("pictures: stream and passes", unlike, UNLIKE, "of the values differ by 1e-5"),
        selfcheck.Check(
            "pictures: values that are not finite", int((~np.isfinite(whole)).sum()), 0, f"of {whole.size}"
        ),
    ]


def _lens_checks(session: Session) -> list[selfcheck.Check]:
    """One picture through a lens traced in float32, in float64 where the device has it, and by fitted rays."""
    scene = load_scene(STUDIO)
    single = picture(session, scene, make_plan(scene)).astype(np.float64)

    def beside(name: str, camera: dict[str, str], allowed: float) -> selfcheck.Check:
        other = change_scene(scene, camera=camera)
        apart = picture(session, other, make_plan(other)) - single
        return selfcheck.Check(name, float(np.sqrt(np.mean(apart**2)) / single.mean()), allowed, _OF_MEAN)

    name = "pictures: lens in float32 and float64"
    precise = (
        beside(name, {"precision": "double"}, ROUNDED) if session.info.fp64 else selfcheck.needs_float64(name, _OF_MEAN)
    )
    return [precise, beside("pictures: rays traced and fitted", {"rays": "fitted"}, FITTED)]


# What a render runs on: versions, devices with their drivers, caches, and settings from the environment.

_PACKAGES = (
    "numpy",
    "pyopencl",
    "pocl-binary-distribution",
    "pydantic",
    "OpenEXR",
    "pillow",
    "tifffile",
    "pyoidn",
    "matplotlib",
)
_PREFIXES = ("RPTCAM_", "PYOPENCL_CTX", "POCL_", "OCL_ICD_", "CUDA_VISIBLE")


def environment(device: str | None = None) -> dict[str, Any]:
    """Collect versions, devices and caches as plain data; ``no_device`` says why no device can be used, if so.

    Parameters
    ----------
    device
        The devices to report, as ``--device`` on the command line; all of them when absent.
    """
    report: dict[str, Any] = {
        "version": __version__,
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": _processor(),
        "processors": os.cpu_count(),
        "packages": {name: _version(name) for name in _PACKAGES},
        "pyopencl": opencl_version(),
        "variables": {name: value for name, value in sorted(os.environ.items()) if name.startswith(_PREFIXES)},
        "caches": {"trees": _folder(cache_folder()), "kernels": _folder(pocl_cache_folder())},
        "devices": [],
    }
    try:
        devices = list_devices()
    except DeviceError as problem:
        return report | {"no_device": str(problem)}
    shown = devices if device is None else fitting_devices(devices, device)[0]
    try:
        default = default_device(devices).id
    except DeviceError as problem:
        default = None
        report["no_device"] = str(problem)
    report["devices"] = [device_details(each) | {"default": each.id == default} for each in shown]
    return report


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _processor() -> str:
    """Return the name of the processor, as far as the system tells."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _folder(path: Path) -> dict[str, Any]:
    """Return where a cache is, how large it is, and whether anything can be kept there."""
    size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file()) if path.is_dir() else 0
    place = next((folder for folder in (path, *path.parents) if folder.is_dir()), path)
    home = os.path.expanduser("~")  # noqa: PTH111 -- Path.home() raises where there is none
    shown = str(path).replace(home, "~", 1) if home != "~" else str(path)
    return {"folder": shown, "bytes": size, "writable": os.access(place, os.W_OK)}


def as_lines(report: dict[str, Any]) -> list[str]:
    """Return the lines of a report on what `environment` found."""
    packages = ", ".join(f"{name} {version}" for name, version in report["packages"].items() if version)
    lines = [
        f"rptcam_cl {report['version']}, Python {report['python']} on {report['system']}",
        f"{report['processor']}, {report['processors']} logical processors",
        packages,
    ]
    lines += [f"{name}={value}" for name, value in report["variables"].items()]
    for name, cache in report["caches"].items():
        barred = "" if cache["writable"] else ", NOT WRITABLE"
        lines.append(f"cache of {name}: {cache['folder']} ({cache['bytes'] / 2**20:.1f} MiB{barred})")
    for device in report["devices"]:
        lines += _device_lines(device)
    return lines + ([f"no device: {report['no_device']}"] if "no_device" in report else [])


def _device_lines(device: dict[str, Any]) -> list[str]:
    head = f"{'*' if device['default'] else ' '} {device['id']} {device['type']}  {device['name']}"
    barred = [f"    CANNOT BE USED: {device['problem']}"] if device["problem"] else []
    if device["largest_buffer_bytes"] is None:
        return [head, f"    {device['platform']}", *barred]
    target = device["kernel_target"]
    precision = "fp64" if device["fp64"] else "fp32 only"
    memory, largest = (device[name] / 2**30 for name in ("memory_bytes", "largest_buffer_bytes"))
    return [
        head,
        f"    {device['platform']}: {device['platform_version']}; driver {device['driver_version']}",
        f"    {device['compute_units']} compute units at {device['clock_mhz']} MHz, {memory:.2f} GiB,"
        f" buffers to {largest:.2f} GiB, {precision}" + (f"; kernels compiled for {target}" if target else ""),
        *(
            f"    PoCL takes the processor for {old!r}, for which it cannot compile; it compiles for {new!r}"
            for old, new in ([device["renamed"]] if device["renamed"] else [])
        ),
        *barred,
    ]


# The suite of checks: what `rptcam doctor --numerics` runs on a device, and the tests on theirs.


_CheckMaker = Callable[[Session], selfcheck.Check | Sequence[selfcheck.Check]]

SUITE: dict[str, _CheckMaker] = {
    "random numbers": selfcheck.random_check,
    "arithmetic": selfcheck.arithmetic_checks,
    "loops": selfcheck.loop_check,
    "film": selfcheck.film_checks,
    "lens surfaces": _radius_checks,
    "total reflection": _reflection_check,
    "stigmatic lenses": _stigmatic_checks,
    "real lenses": _library_checks,
    "leaks": selfcheck.leak_check,
    "tree of a mesh": selfcheck.mesh_tree_check,
    "tree of shapes": selfcheck.object_tree_check,
    "self-hits": selfcheck.departure_check,
    "far spheres": selfcheck.far_sphere_checks,
    "light in closed rooms": _energy_check,
    "organisation": _organisation_checks,
    "ways through a lens": _lens_checks,
}


def run_suite(
    session: Session, suite: Mapping[str, _CheckMaker] = SUITE
) -> Iterator[tuple[Sequence[selfcheck.Check], float]]:
    """Yield the checks of each part of a suite and how long they took [s].

    A device that fails in one part is still tried in the next.
    """
    for name, make in suite.items():
        begun = time.perf_counter()
        try:
            made = make(session)
        except Exception as error:  # whatever a driver throws belongs in the report
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            made = selfcheck.Check(name, np.nan, 0, "could not be checked", reason)
        yield (made,) if isinstance(made, selfcheck.Check) else made, time.perf_counter() - begun


# The report of a card: what `rptcam doctor --gpu` finds out, each step of it on its own.

SPEED_SCENES = ("A", "A_lens", "B", "C")  # of tests/data/reference
FULL_SIZE = {"A": (640, 360), "A_lens": (640, 360), "B": (512, 512), "C": (640, 360)}
_THUMBNAIL = (16, 8)  # blocks of pixels whose means stand in the report
_KNOWN_SIZE, _KNOWN_SPP = 8, 16  # divides width and height; samples of a pixel
KNOWN_MEANS = {"A": 0.5421156, "A_lens": 0.3248519, "B": 0.1215812, "C": 0.3166448}  # of the film: PoCL 3.0
OFF = 1e-3  # by which such a mean may be off, relative: approximate roots and quotients change it by 1.3e-5
LIMIT_S = 540.0  # after which no further step begins
END_S = 600.0  # after which a step that has not ended is given up, and all behind it

Triangles = tuple[Array, NDArray[np.int64]]
Make = Callable[[], tuple[Any, str, bool]]
Step = tuple[str, str, Make]
"""Section of the report, what it is about, and what makes its value, a word for people and whether it is right."""


def torus_knot(along: int = 2048, around: int = 54) -> Triangles:
    """Points and faces of a tube of radius 0.26 round a (2, 3) torus knot, facing outwards."""
    scale, tube, center = 0.40, 0.26, np.array([-1.05, 0.0, 1.45])

    def curve(t: Array, core: float = 0.0) -> Array:
        reach = 2 + (1 - core) * np.cos(3 * t)
        return scale * np.stack([reach * np.cos(2 * t), -(1 - core) * np.sin(3 * t), reach * np.sin(2 * t)], axis=1)

    t = 2 * np.pi * np.arange(along) / along
    tangent = curve(t + 1e-4) - curve(t - 1e-4)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    out = curve(t) - curve(t, core=1.0)  # from the circle within the torus
    out -= (out * tangent).sum(axis=1, keepdims=True) * tangent
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    side = np.cross(tangent, out)
    turn = 2 * np.pi * np.arange(around) / around
    ring = np.cos(turn)[None, :, None] * out[:, None] + np.sin(turn)[None, :, None] * side[:, None]
    points = center + curve(t)[:, None] + tube * ring
    i, j = np.meshgrid(np.arange(along), np.arange(around), indexing="ij")
    a, b = i * around + j, (i + 1) % along * around + j
    c, d = (i + 1) % along * around + (j + 1) % around, i * around + (j + 1) % around
    faces = np.stack([a, c, b, a, d, c], axis=-1).reshape(-1, 3)
    return points.reshape(-1, 3), faces


def icosphere(levels: int) -> Triangles:
    """An icosahedron whose triangles are divided in four ``levels`` times, on the unit sphere."""
    g = (1 + 5**0.5) / 2
    corners: list[tuple[float, float, float]] = [
        (-1, g, 0),
        (1, g, 0),
        (-1, -g, 0),
        (1, -g, 0),
        (0, -1, g),
        (0, 1, g),
        (0, -1, -g),
        (0, 1, -g),
    ]
    corners += [(g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    points = np.array(corners) / np.hypot(1, g)
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    near = np.abs(distance - np.sort(distance[0])[1]) < 1e-9
    faces = np.array(
        [(a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a, b] & near[b, c] & near[c, a]]
    )
    for _ in range(levels):
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        middle = points[unique].sum(axis=1)
        m = len(points) + index.reshape(-1, 3)
        points = np.concatenate([points, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        (a, b, c), (ab, bc, ca) = faces.T, m.T
        faces = np.concatenate([np.stack(x, 1) for x in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    corner = points[faces]
    inwards = (np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) * corner[:, 0]).sum(axis=1) < 0
    faces[inwards] = faces[inwards][:, [0, 2, 1]]
    return points, faces


def bumpy_ball(levels: int = 6) -> Triangles:
    """Points and faces of a sphere of radius about 1 with bumps of two sizes."""
    points, faces = icosphere(levels)
    x, y, z = points.T
    bumps = 0.10 * np.sin(5 * x + 1) * np.sin(6 * y + 2) * np.sin(7 * z + 3)
    bumps += 0.04 * np.sin(17 * x) * np.sin(19 * y) * np.sin(23 * z)
    return points * (1 + bumps)[:, None] + np.array([1.55, 0.6, 1.20]), faces


def speed_scene(name: str, shrink: int = 1) -> Scene:
    """A reference scene, as it is rendered to see how fast a device is: without roulette."""
    data = dict(strict_yaml.read_yaml(files.reference_dir() / f"{name}.yaml").data)
    meshes: dict[str, Callable[[], Triangles]] = {"knot.ply": torus_knot, "ball.ply": bumpy_ball}
    data["objects"] = [
        {key: value for key, value in each.items() if key != "file"}
        | (dict(zip(("vertices", "faces"), meshes[each["file"]](), strict=True)) if "file" in each else {})
        for each in data["objects"]
    ]
    width, height = FULL_SIZE[name]
    camera = {"pupil": "auto"} if name == "A_lens" else {}
    return change_scene(load_scene(data), film={"resolution": (width // shrink, height // shrink)}, camera=camera)


class CardReport:
    """What is found out about one device, step by step; a step that fails is reported and the next one is taken.

    Parameters
    ----------
    session
        The device; with profiling, or no launch is timed.
    scenes, suite
        What is rendered, and the checks of numerics.
    shrink
        Divides width and height of the pictures that are timed.
    seconds
        That each of them is rendered for.

    Attributes
    ----------
    found : dict
        The report so far, as plain data.
    failed : list of str
        Steps that failed or whose result is wrong.
    """

    def __init__(
        self,
        session: Session,
        scenes: Sequence[str] = SPEED_SCENES,
        suite: Mapping[str, _CheckMaker] = SUITE,
        shrink: int = 1,
        seconds: float = 5.0,
    ) -> None:
        self._session, self._shrink, self._seconds = session, shrink, seconds
        self._wavefronts: dict[str, Wavefront] = {}
        self.found: dict[str, Any] = {}
        self.failed: list[str] = []
        ways = dict.fromkeys((Way(ORGANISATION[session.kind], PACKETS if session.lanes > 1 else 1), Way("passes", 1)))
        self._steps: list[Step] = [
            ("driver", "answers", self._answers),
            *(("numerics", name, partial(self._numerics, name, make)) for name, make in suite.items()),
            *(("trial", str(way), partial(self._trial, way)) for way in ways),
        ]
        for name in scenes:
            self._steps += [
                ("builds", name, partial(self._build, name)),
                ("pictures", name, partial(self._picture, name)),
                ("speeds", name, partial(self._speed, name)),
            ]
        self._steps += [
            ("kernels", "figures of the driver", self._kernels),
            ("launches", "longest of each kernel", self._launches),
        ]

    def run(self, limit_s: float = LIMIT_S) -> Iterator[str]:
        """Take every step that begins within a limit, and yield a line of each."""
        begun = time.perf_counter()
        for number, (section, name, make) in enumerate(self._steps, 1):
            before = time.perf_counter()
            self.failed.append(f"{section}, {name}")  # as it is if it never ends
            self.found.setdefault(section, {})[name] = {"right": False, "value": {"error": "did not end"}}
            if before - begun > limit_s:
                value, word, right = {"left_out": f"{limit_s:.0f} s were over"}, "left out, as time is over", True
            else:
                try:
                    value, word, right = make()
                except Exception as error:  # whatever a driver throws belongs in the report
                    word = f"{type(error).__name__}: {' '.join(str(error).split())}"
                    value, right = {"error": word}, False
            if right:
                self.failed.pop()
            seconds = time.perf_counter() - before
            self.found[section][name] = {"seconds": seconds, "right": right, "value": value}
            verdict = "" if right else "FAIL "
            yield f"[{number}/{len(self._steps)}] {section}, {name}: {verdict}{word} ({seconds:.1f} s)"

    def _answers(self) -> tuple[Any, str, bool]:
        answers = driver_answers(self._session.info)
        return answers, f"{len(answers)} answers", True

    def _numerics(self, name: str, make: _CheckMaker) -> tuple[Any, str, bool]:
        ((checks, _),) = run_suite(self._session, {name: make})
        made = [check for check in checks if not check.skipped]
        passed = sum(check.passed for check in made)
        value = [{**vars(check), "passed": check.passed} for check in checks]
        return value, f"{passed} of {len(made)} checks passed", passed == len(made)

    def _trial(self, way: Way) -> tuple[Any, str, bool]:
        fault = fault_of(self._session, way, Wavefront)
        return {"fault": fault}, fault or "the known picture", fault is None

    def _picture(self, name: str) -> tuple[Any, str, bool]:
        """A small picture: its mean beside the known one, a hash of its bits, and means of its blocks."""
        scene = speed_scene(name, _KNOWN_SIZE)
        wavefront = Wavefront(self._session, make_plan(scene), FilmLayout.of(scene.film), scene.render)
        film = render_plan(wavefront, spp=_KNOWN_SPP, seconds=None, has_lens=False).pixels
        mean = float(film.mean(dtype=np.float64))
        off = abs(mean / KNOWN_MEANS[name] - 1)
        height, width = (size // blocks for size, blocks in zip(film.shape, _THUMBNAIL[::-1], strict=False))
        cut = film[: height * _THUMBNAIL[1], : width * _THUMBNAIL[0]].astype(np.float64)
        blocks = cut.reshape(_THUMBNAIL[1], height, _THUMBNAIL[0], width, 3).mean(axis=(1, 3))
        sha256 = hashlib.sha256(np.ascontiguousarray(film, "<f4").tobytes()).hexdigest()
        value = {"mean": mean, "off": off, "sha256": sha256, "blocks": blocks.round(5).ravel().tolist()}
        return value, f"mean {mean:.6f}, off by {off:.1e}", off <= OFF

    def _build(self, name: str) -> tuple[Any, str, bool]:
        """Everything up to the first sample of a picture of full size, as kernels and trees lie in caches or not."""
        scene = speed_scene(name, self._shrink)
        wavefront = Wavefront(self._session, make_plan(scene), FilmLayout.of(scene.film), scene.render)
        wavefront.warm_up()
        self._wavefronts[name] = wavefront
        value: dict[str, Any] = {"slots": wavefront.capacity, "samples_of_wave": wavefront.samples_per_wave}
        value |= {"bytes": dict(vars(wavefront.needs)), "organisation": wavefront.organisation}
        return value, f"{wavefront.capacity} slots, as {wavefront.organisation}", True

    def _speed(self, name: str) -> tuple[Any, str, bool]:
        """Paths from the camera per second: whole waves by the clock, and what each pass has of the time."""
        wavefront, first, rounds = self._wavefronts.pop(name), 0, list[float]()
        wavefront.clear()
        samples, pixels = wavefront.samples_per_wave, wavefront.layout.width * wavefront.layout.height
        while len(rounds) < 2 or sum(rounds) < self._seconds:
            begun = time.perf_counter()
            for wave in wavefront.waves(first, samples):
                wavefront.enqueue(*wave)
            wavefront.finish()
            seconds = time.perf_counter() - begun
            first += samples
            if seconds < self._seconds / 20:  # so that a wait for the last wave does not count
                samples *= 2
            else:
                rounds.append(seconds)
        rates = [samples * pixels / seconds for seconds in rounds]
        value: dict[str, Any] = {
            "paths_per_second": statistics.median(rates),
            "fastest": max(rates),
            "rounds": len(rounds),
        }
        value |= {"passes_seconds": dict(wavefront.passes), "samples": first}
        return value, f"{value['paths_per_second'] / 1e6:.3g} million paths a second", True

    def _kernels(self) -> tuple[Any, str, bool]:
        session = self._session
        value = [program.figures(session.context, session.info.handle) for program in session.programs]
        return value, f"{len(value)} programs, built in {sum(each['build_seconds'] for each in value):.1f} s", True

    def _launches(self) -> tuple[Any, str, bool]:
        self._session.finish()
        longest = self._session.longest
        name = max(longest, key=lambda each: longest[each])
        return dict(longest), f"{name}, {longest[name]:.3f} s", True
