"""Real rays, float64, against the 50-digit tables, both ways through the lens."""

import numpy as np
import pytest

from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import Status, passed_rays, refract
from rptcam_cl.optics.surface import Surface
from tests.optics.truth import CASES, NAMES, truth, truth_lens

POSITION = 1e-9  # mm; the tables agree with two other programs to 1e-12
DIRECTION = 1e-12


def compare(rays, rows, label):
    expected = [row["result"][label] for row in rows]
    passed = np.array([result["status"] == "pass" for result in expected])
    np.testing.assert_array_equal(rays.passed, passed)
    assert np.all(rays.surface[passed] == -1)
    assert np.all(rays.surface[~passed] >= 0)
    assert np.all(np.isfinite(rays.origins)) and np.all(np.isfinite(rays.directions))
    for index in np.flatnonzero(passed):
        result = expected[index]
        assert np.abs(rays.origins[index] - result["exit_point"]).max() < POSITION
        assert np.abs(rays.directions[index] - result["exit_dir"]).max() < DIRECTION
        if "optical_path" in result:
            assert rays.optical_path[index] == pytest.approx(result["optical_path"], abs=POSITION)


@pytest.mark.parametrize(("name", "label"), CASES)
def test_rays_from_the_film(name, label):
    rows = truth(name)["rays_film_to_scene"]
    starts = np.array([row["start"] for row in rows])
    targets = np.array([row["through"] for row in rows])
    compare(truth_lens(name, label).trace(starts, targets - starts), rows, label)


@pytest.mark.parametrize(("name", "label"), CASES)
def test_rays_from_the_scene(name, label):
    rows = truth(name)["rays_scene_to_film"]
    starts, directions = [row["start"] for row in rows], [row["dir"] for row in rows]
    rays = truth_lens(name, label).trace(starts, directions, start="scene")
    compare(rays, rows, label)
    film_z = truth(name)["film_z"]
    for index, row in enumerate(rows):
        if "film_xy" in row["result"][label]:
            at, along = rays.origins[index], rays.directions[index]
            film = at + along * (film_z - at[2]) / along[2]
            assert np.abs(film[:2] - row["result"][label]["film_xy"]).max() < POSITION


@pytest.mark.parametrize("name", NAMES)
def test_rays_close_on_themselves_when_sent_back(name):
    lens = truth_lens(name)
    rng = np.random.default_rng(11)
    film_z, half = truth(name)["film_z"], truth(name)["half_diagonal"]
    starts = np.column_stack([rng.uniform(-half, half, (2000, 2)), np.full(2000, film_z)])
    rear = lens.surfaces[-1].semi_diameter
    targets = np.column_stack([rng.uniform(-rear, rear, (2000, 2)), np.full(2000, lens.length)])
    out = lens.trace(starts, targets - starts)
    ahead = out.origins - out.directions * -(out.origins[:, 2:] + 10) / out.directions[:, 2:]
    back = lens.trace(ahead[out.passed], -out.directions[out.passed], start="scene")
    assert back.passed.mean() > 0.999
    film = back.origins + back.directions * (film_z - back.origins[:, 2:]) / back.directions[:, 2:]
    assert np.abs(film - starts[out.passed])[back.passed].max() < 1e-9 * max(1, film_z)


def test_rays_of_several_wavelengths_go_in_one_call():
    lens = truth_lens("cooke50")
    rows = truth("cooke50")["rays_film_to_scene"]
    starts = np.array([row["start"] for row in rows])
    directions = np.array([row["through"] for row in rows]) - starts
    together = lens.trace(
        np.vstack([starts, starts]), np.vstack([directions, directions]), np.full(2 * len(rows), 550.0)
    )
    apart = lens.trace(starts, directions, 550.0)
    np.testing.assert_array_equal(together.origins[len(rows) :], apart.origins)


def test_a_failed_ray_has_a_reason_and_a_surface():
    lens = truth_lens("dgauss50")
    rays = lens.trace(
        [[0, 0, 68.0], [0, 0, 68.0], [0, 0, 68.0], [0, 0, 68.0]], [[0, 0, -1], [0, 0.5, -1], [0, 5, -1], [0, 0, 1]]
    )
    assert rays.status.tolist() == [Status.ok, Status.clipped, Status.missed, Status.missed]
    assert rays.surface.tolist() == [-1, 10, 10, 10]
    assert np.all(np.isfinite(rays.origins))


def test_total_internal_reflection_is_named():
    from rptcam_cl.optics.library import load_lens

    wedge = load_lens(
        {
            "name": "hemisphere",
            "surfaces": [
                {"radius": 10, "thickness": 10, "glass": {"index": 1.5}, "diameter": 20},
                {"diameter": 20},
            ],
        }
    )
    rays = wedge.trace([[0, 8.0, -5], [0, 0, -5]], [[0, 0, 1], [0, 0, 1]], start="scene")
    assert rays.status.tolist() == [Status.ok, Status.ok]
    inside = wedge.trace([[0, 9.0, 30.0]], [[0, 0, -1.0]])
    assert (inside.status[0], inside.surface[0]) == (Status.total_internal_reflection, 0)


LENSES = ("dgauss-50mm", "fisheye-10mm", "mirror-500mm", "phone-5.6mm", "anamorphic-100mm", "zoom-70-200mm")


@pytest.mark.parametrize("start", ["film", "scene"])
@pytest.mark.parametrize("name", LENSES)
def test_rays_that_pass_are_those_of_the_trace(name: str, start: str) -> None:
    lens, rng = load_lens(name), np.random.default_rng(5)
    size = lens.surfaces[0].semi_diameter
    if start == "scene":
        origins = np.column_stack([rng.uniform(-1.3, 1.3, (3000, 2)) * size, np.full(3000, -3 * size)])
        directions = np.column_stack([rng.normal(0, 0.01, (3000, 2)), np.ones(3000)])
    else:
        z = lens.film_z(lens.first_order().focal_length_mm)
        origins = np.column_stack([rng.uniform(-0.3, 0.3, (3000, 2)) * size, np.full(3000, z)])
        directions = (
            np.column_stack([rng.uniform(-1.3, 1.3, (3000, 2)) * size, np.full(3000, lens.length / 2)]) - origins
        )
    rays = lens.trace(origins, directions, 550.0, start)
    rows, points, after = passed_rays(lens, origins, directions, 550.0, start)
    assert 0 < len(rows) < 3000
    assert np.array_equal(rows, np.flatnonzero(rays.passed))
    assert points.T.tobytes() == rays.origins[rows].tobytes()
    assert after.T.tobytes() == rays.directions[rows].tobytes()


def test_no_ray_may_pass() -> None:
    lens = load_lens("dgauss-50mm")
    rows, points, directions = passed_rays(
        lens, np.array([[0.0, 500.0, -9.0]]), np.array([[0.0, 0.0, 1.0]]), 550.0, "scene"
    )
    assert len(rows) == 0 and points.shape == directions.shape == (3, 0)


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
