"""Extreme radii, distances, angles, indices and units, in float64 and on the device: right reasons, bounded errors.

Every case of the extremes file is a lens of one surface. Intersections: air on both sides, so that the hit point comes
out alone. Refractions: a plane between two media, met at its vertex; where the normal is oblique the plane is tilted.
What the file gives as a normal is not seen from outside; the refracted direction stands for it. The focal lengths of
its plano-convex lenses are not rays and are tested with the first-order data.
"""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.optics.glass import AIR, ConstantIndex
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import Status
from rptcam_cl.optics.surface import Surface, SurfacePose
from rptcam_cl.studies.selfcheck_suite import surface_errors
from tests.optics.truth import radius, truth, truth_lens
from tests.rendering.cameras.beams import PRECISIONS, film_beam, generator, on_device, scaled

EXTREMES = truth("extremes_open")
GROUPS = sorted({case["group"] for case in EXTREMES["intersect"]})
CRITICAL = 1e-6  # of cos^2 behind the surface: nearer to the critical angle the device blocks the ray
EPS = {"single": 2.0**-24, "double": 2.0**-53, "reference": 2.0**-53}
TRACERS = ("reference", *PRECISIONS)


def traced(session, lens, origins, directions, tracer, start="film"):
    """Rays by the reference, or by the device in single or double precision."""
    if tracer == "reference":
        return lens.trace(origins, directions, start=start)
    return on_device(session, lens, origins, directions, tracer, start)


def unit(vector):
    return np.array(vector, dtype=float) / np.linalg.norm(vector)


def decided(case, precision):
    return precision != "single" or case.get("float32_decidable", True)


@pytest.mark.parametrize("precision", TRACERS)
@pytest.mark.parametrize("group", GROUPS)
def test_intersections(session, group, precision):
    for case in EXTREMES["intersect"]:
        if case["group"] != group:
            continue
        lens = Lens(case["id"], (Surface(curvature=1 / radius(case)),))
        start = "scene" if case["d"][2] > 0 else "film"
        rays = traced(session, lens, case["p"], case["d"], precision, start)
        hit = case["expected"]["status"] == "hit"
        assert np.isfinite(rays.origins).all() and np.isfinite(rays.directions).all(), case["id"]
        if decided(case, precision):
            assert rays.status[0] == (Status.ok if hit else Status.missed), case["id"]
        if hit and rays.passed[0]:
            allowed = case["tol_float32_abs" if precision == "single" else "tol_float64_abs"]
            assert np.abs(rays.origins[0] - case["expected"]["point"]).max() <= allowed, case["id"]


def plane_between(case):
    """A plane between the media of a case, turned to its normal."""
    normal = unit(case["normal"])
    side = unit(np.cross(normal, [1.0, 0, 0] if abs(normal[0]) < 0.9 else [0, 1.0, 0]))
    columns = np.column_stack([side, np.cross(normal, side), normal])
    pose = None if normal[2] > 1 - 1e-12 else SurfacePose._from(np.zeros(3), columns)
    surface = Surface(glass=ConstantIndex(case["n2"]), pose=pose)
    return Lens(case["id"], (surface,), object_medium=ConstantIndex(case["n1"]))


def refraction_errors(session, groups, precision):
    """Yield the cases of some groups that are refracted, and the error of the direction."""
    for case in EXTREMES["refract"]:
        if case["group"] not in groups:
            continue
        rays = traced(session, plane_between(case), [0, 0, 0], case["d"], precision, "scene")
        expected = case["expected"]
        assert np.isfinite(rays.directions).all(), case["id"]
        bent = expected["status"] == "refract"
        if decided(case, precision):
            reason = Status.ok if bent else Status.total_internal_reflection
            assert rays.status[0] == reason, case["id"]
        else:
            assert rays.passed[0] == bent or abs(expected["k_exact"]) < 2 * CRITICAL, case["id"]
        if bent and rays.passed[0]:
            yield case, np.abs(rays.directions[0] - expected["dir"]).max()


@pytest.mark.parametrize("precision", TRACERS)
def test_refractions(session, precision):
    for case, error in refraction_errors(session, ("angle_sweep", "oblique_normal"), precision):
        assert error <= case["tol_float32_abs" if precision == "single" else "tol_float64_abs"], case["id"]


@pytest.mark.parametrize("precision", TRACERS)
def test_refractions_beside_the_critical_angle(session, precision):
    for case, error in refraction_errors(session, ("critical_float32", "critical_float64"), precision):
        # 1 - k^2 (1 - cos^2) is wrong by a few roundings of 1 and of k^2, and its root by that over twice itself
        ratio2 = (case["n1"] / case["n2"]) ** 2
        allowed = EPS[precision] * (2 + ratio2) / max(case["expected"]["cos_refracted"], np.sqrt(EPS[precision]))
        assert error <= 3 * allowed, case["id"]


def test_refractions_beside_the_critical_angle_are_as_good_as_float32_can_be(session):
    for case, error in refraction_errors(session, ("critical_float32",), "single"):
        assert error <= case["tol_float32_abs"], case["id"]


@pytest.mark.parametrize("precision", TRACERS)
def test_units_do_not_matter(session, precision):
    system = EXTREMES["systems"]["unit_scaling_dgauss50"]
    lens = truth_lens("dgauss50")
    position, direction = (4.1e-5, 3e-6) if precision == "single" else (1e-12, 1e-13)
    for scale in (*(row["s"] for row in system["scales"]), 1e-12, 1e-9, 1e9, 1e12):
        starts = np.array([ray["start_mm"] for ray in system["rays"]]) * scale
        aims = np.array([ray["through_mm"] for ray in system["rays"]]) * scale
        rays = traced(session, scaled(lens, scale), starts, aims - starts, precision)
        assert rays.passed.all()
        assert np.abs(rays.origins / scale - [r["exit_point_mm"] for r in system["rays"]]).max() <= position
        assert np.abs(rays.directions - [r["exit_dir"] for r in system["rays"]]).max() <= direction


@pytest.mark.parametrize("precision", PRECISIONS)
def test_lenses_written_in_micrometres_and_in_kilometres_pass_the_same_rays(session, precision):
    lens = load_lens("dgauss-50mm")
    origins, directions = film_beam(lens, 1000)
    wanted = on_device(session, lens, origins, directions, precision)
    for factor in (2.0**-20, 2.0**20):  # powers of two: no rounding differs
        got = on_device(session, scaled(lens, factor), origins * factor, directions, precision)
        np.testing.assert_array_equal(got.status, wanted.status)
        np.testing.assert_array_equal(got.surface, wanted.surface)
        np.testing.assert_array_equal(got.origins / factor, wanted.origins)
        np.testing.assert_array_equal(got.directions, wanted.directions)


@pytest.mark.parametrize(("tracer", "position", "direction"), [("reference", 1e-13, 1e-15), ("single", 2e-5, 1.2e-7)])
def test_index_one_everywhere_leaves_rays_straight(session, tracer, position, direction):
    bare = truth_lens("dgauss50")
    bare = replace(bare, surfaces=tuple(replace(s, glass=AIR) for s in bare.surfaces))
    for ray in EXTREMES["systems"]["n_equal_1_dgauss50"]:
        start = np.array(ray["start"], dtype=float)
        rays = traced(session, bare, start, np.array(ray["through"]) - start, tracer)
        assert rays.passed[0]
        # nothing is computed where nothing bends: the input's rounding and one normalisation are all
        assert np.abs(rays.directions[0] - ray["exit_dir"]).max() <= direction
        assert np.abs(rays.origins[0] - ray["exit_point"]).max() <= position


@pytest.mark.parametrize("precision", TRACERS)
def test_a_plate_of_no_thickness_changes_nothing(session, precision):
    case = EXTREMES["systems"]["zero_thickness"][0]
    front = {"radius": 51.5, "thickness": 3.6, "glass": {"index": case["n"]}, "diameter": 25.4}
    plane = {"thickness": 0, "diameter": 25.4}
    plate = [{**plane, "glass": {"index": case["n"]}}, {"diameter": 25.4}]
    for rows, suffix in (([front, {"diameter": 25.4}], "plain"), ([front, plane, *plate], "with_plate")):
        lens = load_lens({"name": suffix, "surfaces": rows})
        rays = traced(session, lens, case["start"], case["dir_unnormalised"], precision)
        position, direction = (1.4e-5, 1.2e-6) if precision == "single" else (1e-12, 1e-13)
        assert np.abs(rays.origins[0] - case[f"exit_point_{suffix}"]).max() <= position
        assert np.abs(rays.directions[0] - case[f"exit_dir_{suffix}"]).max() <= direction


@pytest.mark.parametrize("tracer", ["reference", "single"])
def test_ball_lens_up_to_its_rim(session, tracer):
    for row in EXTREMES["systems"]["ball_lens_parallel_rays"]["rows"]:
        lens = Lens("ball", (Surface(1.0, 2.0, ConstantIndex(row["n"]), 1.0), Surface(-1.0, 0.0, AIR, 1.0)))
        rays = traced(session, lens, [row["h_over_R"], 0, -3.0], [0, 0, 1.0], tracer, "scene")
        assert np.isfinite(rays.origins).all() and np.isfinite(rays.directions).all()
        if not row["exit_on_rear_hemisphere"] or (tracer == "single" and (row["h_over_R"] > 0.9999 or row["n"] == 1.0)):
            continue  # float32 does not know on which side of the rim these are
        assert rays.passed[0] == (row["status"] == "pass")
        if rays.passed[0]:
            # dx/dh grows as 1 / cos of the incidence, and the roundings of h with it
            allowed = (1e-12 if tracer == "reference" else 1e-6) / np.sqrt(1 - row["h_over_R"] ** 2)
            assert abs(rays.origins[0, 0] - row["exit_x_over_R"]) <= allowed
            assert abs(-rays.directions[0, 0] - np.sin(row["deviation_rad"])) <= 2 * allowed


RADII = [sign * 10.0**power for power in range(-3, 13) for sign in (-1, 1)]


@pytest.mark.parametrize("index", [0.75, 1.0, 1.5, 4.0])
@pytest.mark.parametrize("start", ["film", "scene"])
def test_radii_of_fifteen_decades_with_every_index(session, start, index):
    rng = generator("radii", start, index)
    for r in (*RADII, np.inf):
        position, direction, wrong = surface_errors(session, r, index, start, rng)
        assert wrong == 0
        # six roundings of the size of the start, which 0.25 is the least cosine of incidence to enlarge
        assert position <= 24 * EPS["single"]
        assert direction <= 12


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(("start", "before", "after"), [("film", 1.5, 1.0), ("scene", 1.5, 1.0), ("scene", 1.0, 0.75)])
def test_total_reflection_from_both_sides(session, start, before, after, precision):
    first, last = (before, after) if start == "scene" else (after, before)
    for curvature in (0.0, 1e-6, -1e-6):
        lens = Lens("step", (Surface(curvature, 0.0, ConstantIndex(last), 5.0),), object_medium=ConstantIndex(first))
        critical = np.arcsin(after / before)
        angles = critical + np.array([-1e-1, -1e-2, -1e-3, -1e-4, 1e-4, 1e-3, 1e-2, 1e-1])
        sense = 1.0 if start == "scene" else -1.0
        directions = np.column_stack([np.zeros(8), np.sin(angles), sense * np.cos(angles)])
        rays = on_device(session, lens, -directions, directions, precision, start)
        expected = [Status.ok] * 4 + [Status.total_internal_reflection] * 4
        assert rays.status.tolist() == expected
        assert (rays.surface[4:] == 0).all()


def test_grazing_rays_end_with_a_reason(session):
    angles = np.radians([89.0, 89.9, 89.99, 89.999, 89.9999, 90.0, 90.0001])
    for curvature in (0.0, 1e-3, -1e-3, 0.2, -0.2):
        lens = Lens("grazed", (Surface(curvature, 1.0, ConstantIndex(1.5), 4.0), Surface(0.0, 0.0, AIR, 5.0)))
        for start, sense in (("scene", 1.0), ("film", -1.0)):
            directions = np.column_stack([np.sin(angles), np.zeros(7), sense * np.cos(angles)])
            origins = np.tile([-1.0, 0.0, -0.01 if start == "scene" else 1.01], (7, 1))
            for precision in PRECISIONS:
                rays = on_device(session, lens, origins, directions, precision, start)
                assert np.isfinite(rays.origins).all() and np.isfinite(rays.directions).all()
                assert ((rays.surface >= 0) == ~rays.passed).all()
                assert not rays.passed[-2:].any()  # these do not travel towards the lens


@pytest.mark.parametrize("precision", PRECISIONS)
def test_hemispheres_up_to_their_rim(session, precision):
    heights = np.concatenate([np.linspace(0, 0.999, 50), 1 - np.logspace(-3, -9, 13), [1.0, 1 + 1e-6, 2.0]]) * 10
    lens = Lens("dome", (Surface(0.1, 10.0, ConstantIndex(1.5), 10.0), Surface(0.0, 0.0, AIR, 20.0)))
    origins = np.column_stack([heights, np.zeros_like(heights), np.full_like(heights, -1.0)])
    rays = on_device(session, lens, origins, np.tile([0, 0, 1.0], (len(heights), 1)), precision, "scene")
    assert np.isfinite(rays.origins).all() and np.isfinite(rays.directions).all()
    inside = heights < 10 * (1 - 2e-7)
    assert (rays.status[inside] != Status.missed).all()
    assert (rays.status[heights > 10 * (1 + 5e-7)] == Status.missed).all()
    # sin of the angle in the glass is h / (n R); the plane behind bends it on, beyond 60 degrees not at all
    wanted = lens.trace(origins, np.tile([0, 0, 1.0], (len(heights), 1)), start="scene")
    np.testing.assert_array_equal(rays.status[inside], wanted.status[inside])


def test_nothing_at_all_comes_out_of_a_ray_that_never_reaches_the_lens(session):
    lens = load_lens("dgauss-50mm")
    away = [[0, 0, 1.0], [1, 0, 0], [0, 1, 1e-30]]
    rays = on_device(session, lens, [[0, 0, 70.0]] * 3, away)
    assert (rays.status == Status.missed).all()
    assert (rays.surface == len(lens.surfaces) - 1).all()
    assert np.isfinite(rays.origins).all() and np.isfinite(rays.directions).all()
