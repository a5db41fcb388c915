"""Extreme radii, distances, angles, indices and units: right reasons, bounded errors, no NaN."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.optics.glass import AIR, ConstantIndex
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import Status, refract
from rptcam_cl.optics.surface import Surface
from tests.optics.truth import radius, truth, truth_lens

EXTREMES = truth("extremes_open")


def column(values):
    vector = np.array(values, dtype=np.float64)
    return (vector / np.linalg.norm(vector))[:, None]


@pytest.mark.parametrize("group", sorted({case["group"] for case in EXTREMES["intersect"]}))
def test_intersections(group):
    worst = 0.0
    for case in EXTREMES["intersect"]:
        if case["group"] != group:
            continue
        surface = Surface(curvature=1 / radius(case))
        with np.errstate(all="ignore"):
            hits = surface.meet(np.array(case["p"], dtype=float)[:, None], column(case["d"]))
        expected = case["expected"]
        assert bool(hits.met[0]) == (expected["status"] == "hit"), case["id"]
        if expected["status"] == "hit":
            error = np.abs(hits.points[:, 0] - expected["point"]).max()
            # Input rounding: the start times the ratio of path to cosine of incidence.
            reach = np.abs(case["p"]).max() + abs(expected["t"])
            allowed = max(case["tol_float64_abs"], 4e-16 * reach / max(abs(expected["cos_incidence"]), 1e-6), 1e-300)
            assert error <= 8 * allowed, (case["id"], error, allowed)
            worst = max(worst, error)
            assert np.abs(hits.normals[:, 0] - expected["normal"]).max() < 1e-9
    assert np.isfinite(worst)


@pytest.mark.parametrize("group", sorted({case["group"] for case in EXTREMES["refract"]}))
def test_refractions(group):
    for case in EXTREMES["refract"]:
        if case["group"] != group:
            continue
        direction, normal = column(case["d"]), column(case["normal"])
        cosine = np.sum(direction * normal, axis=0)
        bent, through = refract(direction, normal, cosine, np.array(case["n1"] / case["n2"]))
        expected = case["expected"]
        assert bool(through[0]) == (expected["status"] == "refract"), case["id"]
        if through[0]:
            # The error of the angle near the critical one is inherent: one rounding of k over its root.
            allowed = max(case.get("tol_float64_abs", 0), 8e-16 / max(expected["cos_refracted"], 1e-8))
            assert np.abs(bent[:, 0] - expected["dir"]).max() <= 4 * allowed, case["id"]


def scaled(lens, factor):
    surfaces = tuple(
        replace(
            s, curvature=s.curvature / factor, thickness=s.thickness * factor, semi_diameter=s.semi_diameter * factor
        )
        for s in lens.surfaces
    )
    return replace(lens, surfaces=surfaces)


def test_units_do_not_matter():
    system = EXTREMES["systems"]["unit_scaling_dgauss50"]
    lens = truth_lens("dgauss50")
    for scale in system["scales"]:
        other = scaled(lens, scale["s"])
        for ray in system["rays"]:
            start, through = np.array(ray["start_mm"]) * scale["s"], np.array(ray["through_mm"]) * scale["s"]
            out = other.trace(start, through - start)
            assert out.status[0] == Status.ok
            assert np.abs(out.origins[0] / scale["s"] - ray["exit_point_mm"]).max() < 1e-12
            assert np.abs(out.directions[0] - ray["exit_dir"]).max() < 1e-13


def test_index_one_everywhere_leaves_rays_straight():
    lens = truth_lens("dgauss50")
    bare = replace(lens, surfaces=tuple(replace(s, glass=AIR) for s in lens.surfaces))
    for ray in EXTREMES["systems"]["n_equal_1_dgauss50"]:
        start = np.array(ray["start"], dtype=float)
        out = bare.trace(start, np.array(ray["through"]) - start)
        assert out.status[0] == Status.ok
        assert np.abs(out.directions[0] - ray["exit_dir"]).max() < 1e-15
        assert np.abs(out.origins[0] - ray["exit_point"]).max() < 1e-13


def test_a_plate_of_no_thickness_changes_nothing():
    case = EXTREMES["systems"]["zero_thickness"][0]
    plain = [
        {"radius": 51.5, "thickness": 3.6, "glass": {"index": case["n"]}, "diameter": 25.4},
        {"thickness": 0, "diameter": 25.4},
    ]
    plate = [{"thickness": 0, "glass": {"index": case["n"]}, "diameter": 25.4}, {"diameter": 25.4}]
    start, direction = np.array(case["start"], dtype=float), case["dir_unnormalised"]
    for rows, suffix in (([plain[0], {"diameter": 25.4}], "plain"), (plain + plate, "with_plate")):
        out = load_lens({"name": "x", "surfaces": rows}).trace(start, direction)
        assert np.abs(out.origins[0] - case[f"exit_point_{suffix}"]).max() < 1e-13
        assert np.abs(out.directions[0] - case[f"exit_dir_{suffix}"]).max() < 1e-14


def test_focal_length_over_fifteen_decades_of_radius():
    for row in EXTREMES["systems"]["plano_convex_EFL"]:
        surfaces = (
            Surface(1 / row["R1"], 0.0, ConstantIndex(row["n"]), row["R1"] / 2),
            Surface(semi_diameter=row["R1"] / 2),
        )
        assert Lens("x", surfaces).first_order().focal_length_mm == pytest.approx(row["EFL"], rel=1e-14)


def test_ball_lens_up_to_its_rim():
    for row in EXTREMES["systems"]["ball_lens_parallel_rays"]["rows"]:
        glass = ConstantIndex(row["n"])
        lens = Lens("ball", (Surface(1.0, 2.0, glass, 1.0), Surface(-1.0, 0.0, AIR, 1.0)))
        out = lens.trace([[row["h_over_R"], 0, -3.0]], [[0, 0, 1.0]], start="scene")
        assert np.all(np.isfinite(out.origins)) and np.all(np.isfinite(out.directions))
        if not row.get("exit_on_rear_hemisphere", False):
            assert out.status[0] in (Status.ok, Status.missed, Status.clipped, Status.total_internal_reflection)
            continue
        assert (out.status[0] == Status.ok) == (row["status"] == "pass")
        if out.status[0] == Status.ok:
            assert out.origins[0, 0] == pytest.approx(row["exit_x_over_R"], abs=1e-12)
            assert np.arcsin(-out.directions[0, 0]) == pytest.approx(np.arcsin(np.sin(row["deviation_rad"])), abs=1e-7)


def test_weierstrass_points_are_stigmatic():
    # Light from R / n beyond the centre seems, once outside, to come from n R beyond it: exactly, at every angle.
    n, r = 1.5, 10.0
    angles = np.radians(np.linspace(-56, 56, 20))
    source = np.array([[0.0], [0.0], [-r - r / n]]) * np.ones(20)
    directions = np.stack([np.zeros(20), np.sin(angles), np.cos(angles)])
    hits = Surface(curvature=-1 / r).meet(source, directions)
    bent, through = refract(directions, hits.normals, hits.cosines, np.array(n))
    assert np.all(through) and np.all(hits.met)
    crossing = hits.points[2] - hits.points[1] / bent[1] * bent[2]
    np.testing.assert_allclose(crossing, -r - n * r, atol=1e-11)
    wrong, _ = refract(directions, hits.normals, hits.cosines, np.array(n + 1e-4))
    assert np.abs(hits.points[2] - hits.points[1] / wrong[1] * wrong[2] + r + n * r).max() > 1e-4
