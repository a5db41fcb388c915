"""Checks of lenses at their extremes: the device in float32 against float64 and against closed forms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.device import Session
from rptcam_cl.lenstools import Precision, trace_on_device
from rptcam_cl.optics import AIR, ConstantIndex, Lens, Rays, Status, Surface, film_distance, load_lens
from rptcam_cl.rendering import film_rays
from rptcam_cl.selfcheck.check import Check, needs_float64

Array = NDArray[np.float64]

EPS = 2.0**-24  # half a unit in the last place of float32 at 1
RADII = tuple(sign * 10.0**power for power in range(10) for sign in (-1, 1))  # [mm]; planes besides
LENSES = ("dgauss-50mm", "wide-22mm", "fisheye-10mm", "telephoto-250mm", "asphere-1.4mm", "anamorphic-100mm")
STEPS = np.array([-1e-1, -1e-2, -1e-3, -1e-4, 1e-4, 1e-3, 1e-2, 1e-1])  # about the critical angle [radians]


@dataclass(frozen=True)
class SurfaceErrors:
    """What float32 does wrong at a single surface.

    Attributes
    ----------
    position : float
        Largest error of the point, over the size of the surface.
    direction : float
        Largest error of the direction, over what it may be: an error of the cosine behind the surface grows as the
        critical angle comes near.
    wrong : int
        Rays with another fate than in float64, but for those within 0.2 degrees of the critical angle, and rays that
        are not finite.
    """

    position: float
    direction: float
    wrong: int


def surface_errors(
    session: Session, radius_mm: float, index: float, start: str, rng: np.random.Generator, count: int = 200
) -> SurfaceErrors:
    """Return the errors of rays that meet a surface of some radius, up to 30 mm of it, into or out of some index."""
    sense = 1.0 if start == "scene" else -1.0
    size = min(abs(radius_mm), 30.0)
    lens = Lens(f"{radius_mm:g}", (Surface(1 / radius_mm, 0.0, ConstantIndex(index), 0.9 * size),))
    directions = np.column_stack([rng.uniform(-0.6, 0.6, (count, 2)), np.full(count, sense)])
    aims = np.column_stack([rng.uniform(-0.6, 0.6, (count, 2)) * size, np.zeros(count)])
    origins = aims - directions * size
    wanted = lens.trace(origins, directions, start=start)
    got = trace_on_device(lens, session, origins, directions, LINE_D_NM, start, "single")
    finite = np.isfinite(got.origins).all(axis=1) & np.isfinite(got.directions).all(axis=1)
    cosine = cosines_behind(lens, wanted, directions, start)
    far = cosine >= 3e-3
    both = got.passed & wanted.passed
    turned = np.abs(got.directions - wanted.directions).max(axis=1)[both]
    return SurfaceErrors(
        position=float(np.abs(got.origins - wanted.origins)[both].max(initial=0.0)) / size,
        direction=float((turned * cosine[both] / (EPS * (2 + index**2))).max(initial=0.0)),
        wrong=int((far & (got.status != wanted.status)).sum() + (~finite).sum()),
    )


def cosines_behind(lens: Lens, rays: Rays, directions: Array, start: str) -> Array:
    """Return the cosine of the angle behind the only surface of a lens; 1 for rays that do not reach it."""
    c = lens.surfaces[0].curvature
    normal = np.column_stack([-c * rays.origins[:, :2], 1 - c * rays.origins[:, 2]])
    d = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    before, after = lens.indices()[:: 1 if start == "scene" else -1]
    square = 1 - (before / after) ** 2 * (1 - np.sum(d * normal, axis=1) ** 2)
    reached = (rays.status == Status.ok) | (rays.status == Status.total_internal_reflection)
    return np.where(reached, np.sqrt(np.abs(square)), 1.0)


def radius_checks(session: Session) -> list[Check]:
    """Spheres of ten decades of radius and planes, from both sides, into denser and thinner media."""
    rng = np.random.default_rng(5)
    found = [
        surface_errors(session, radius, index, start, rng)
        for radius in (*RADII, np.inf)
        for index, start in ((0.75, "scene"), (1.5, "scene"), (1.5, "film"), (4.0, "film"))
    ]
    return [
        # six roundings of the size of the start, which 0.25, the least cosine of incidence, enlarges
        Check("lens: points on R = 1 to 1e9 mm and planes", max(e.position for e in found), 24 * EPS, "of the size"),
        Check("lens: directions behind them", max(e.direction for e in found), 12, "roundings"),
        Check("lens: fates there", sum(e.wrong for e in found), 0, f"of {200 * len(found)} rays wrong"),
    ]


def reflection_check(session: Session) -> Check:
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
    return Check("lens: total reflection within 1e-4 of its angle", wrong, 0, f"of {count} rays wrong")


def parallel(heights: Array, z: float = -20.0) -> tuple[Array, Array]:
    """Return rays along the axis at heights, all round it."""
    turn = np.arange(len(heights)) * 2.4
    origins = np.column_stack([heights * np.cos(turn), heights * np.sin(turn), np.full(len(heights), z)])
    return origins, np.tile([0, 0, 1.0], (len(heights), 1))


def spot(rays: Rays, z: float) -> Array:
    """Return the distances [mm] from the axis at which rays cross a plane."""
    step = (z - rays.origins[:, 2]) / rays.directions[:, 2]
    places = rays.origins + step[:, None] * rays.directions
    return np.asarray(np.hypot(places[:, 0], places[:, 1]))


def crossings(rays: Rays) -> Array:
    """Return where rays come nearest to the axis, z [mm]."""
    p, d = rays.origins, rays.directions
    return np.asarray(p[:, 2] - np.sum(p[:, :2] * d[:, :2], axis=1) / np.sum(d[:, :2] ** 2, axis=1) * d[:, 2])


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
    return float(np.abs(crossings(rays) + r + n * r).max()) if rays.passed.all() else np.inf


def stigmatic_checks(session: Session) -> list[Check]:
    """Lenses that image a point sharply, whatever the angle: conics and the aplanatic sphere."""
    worst = 0.0
    for (lens, focus), height in ((plano_hyperbolic(-2.25), 9.0), (ellipsoidal(-1 / 2.25), 5.0)):
        beam = parallel(np.linspace(0.1, height, 60))
        rays = trace_on_device(lens, session, *beam, LINE_D_NM, "scene", "single")
        size = float(np.sqrt(np.mean(spot(rays, focus) ** 2))) if rays.passed.all() else np.inf
        worst = max(worst, size)
    return [
        Check("lens: spot of stigmatic conics", worst, 1e-4, "mm"),
        Check("lens: aplanatic point of a sphere", weierstrass_error(session, 1.5, "single"), 1e-4, "mm"),
    ]


def library_errors(session: Session, name: str, precision: Precision) -> tuple[float, float, int]:
    """Return the largest errors of position [mm] and direction of 512 rays through a lens of the library, and how many
    pass that should not or the other way round."""
    lens = load_lens(name)
    try:
        back_mm = film_distance(lens, 1e7)
    except InputError:
        back_mm = abs(lens.first_order().focal_length_mm)
    half_mm = 0.3 * abs(lens.first_order().focal_length_mm)
    origins, directions = film_rays(lens, back_mm, (half_mm, half_mm), LINE_D_NM)
    exact = lens.trace(origins, directions)
    got = trace_on_device(lens, session, origins, directions, LINE_D_NM, "film", precision)
    both = exact.passed & got.passed
    position = np.abs(got.origins - exact.origins)[both].max(initial=0.0)
    direction = np.abs(got.directions - exact.directions)[both].max(initial=0.0)
    return float(position), float(direction), int((exact.passed != got.passed).sum())


def library_checks(session: Session) -> list[Check]:
    """Rays through lenses of the library, aspheres and cylinders among them, against the float64 reference."""
    found = np.array([library_errors(session, name, "single") for name in LENSES])
    checks = [
        Check(f"lens: points behind {len(LENSES)} real lenses", found[:, 0].max(), 6e-5, "mm"),
        Check("lens: directions behind them", found[:, 1].max(), 3e-6, "of 1"),
        # a ray within a millionth of a rim may go either way
        Check("lens: fates in them", found[:, 2].sum(), 2, f"of {512 * len(LENSES)} rays other than in float64"),
    ]
    precise = "lens: the first of them in float64", "mm"
    if not session.info.fp64:
        return [*checks, needs_float64(*precise)]
    name, unit = precise
    return [*checks, Check(name, max(library_errors(session, LENSES[0], "double")), 1e-11, unit)]
