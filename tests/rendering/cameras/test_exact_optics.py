"""Optics with exact answers, on the device: Snell's law, the ball, the sphere of Weierstrass, stigmatic conics."""

import numpy as np
import pytest

from rptcam_cl.optics.glass import AIR, ConstantIndex
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import Status, axis_points
from rptcam_cl.optics.surface import Surface
from rptcam_cl.studies.selfcheck_suite import ellipsoidal, parallel, plano_hyperbolic, spot, weierstrass_error
from tests.rendering.cameras.beams import PRECISIONS, generator, on_device


@pytest.mark.parametrize("start", ["film", "scene"])
def test_snells_law_holds_on_the_ray_that_comes_out(session, start):
    rng = generator("snell", start)
    sense = 1.0 if start == "scene" else -1.0
    for _ in range(50):
        radius = 10 ** rng.uniform(0, 7) * rng.choice([-1, 1])
        before, after = rng.uniform(1, 2.5, 2)
        size = min(abs(radius), 10.0)
        first, last = (before, after) if start == "scene" else (after, before)
        lens = Lens(
            "step", (Surface(1 / radius, 0, ConstantIndex(last), 0.9 * size),), object_medium=ConstantIndex(first)
        )
        d1 = np.column_stack([rng.uniform(-0.7, 0.7, (2000, 2)), np.full(2000, sense)])
        d1 /= np.linalg.norm(d1, axis=1, keepdims=True)
        aims = np.column_stack([rng.uniform(-0.6, 0.6, (2000, 2)) * size, np.zeros(2000)])
        rays = on_device(session, lens, aims - d1 * size, d1, "single", start)
        d2 = rays.directions
        normal = np.column_stack([-rays.origins[:, :2] / radius, 1 - rays.origins[:, 2] / radius])
        tangential = before * np.cross(normal, d1) - after * np.cross(normal, d2)
        sine2 = (before / after) ** 2 * (1 - np.sum(d1 * normal, axis=1) ** 2)
        reached = (rays.status == Status.ok) | (rays.status == Status.total_internal_reflection)
        sure = reached & (np.abs(sine2 - 1) > 1e-5)
        np.testing.assert_array_equal(rays.passed[sure], (sine2 < 1)[sure])
        ok = rays.passed
        assert ok.sum() > 300
        # float32 inputs and outputs, each half a unit of 6e-8 in three components; the hit point adds as much over size
        assert np.abs(tangential[ok]).max() <= 6e-7 * max(before, after)
        assert np.abs(np.linalg.norm(d2, axis=1) - 1).max() <= 5e-7
        assert np.abs(np.sum(np.cross(d1, d2) * normal, axis=1))[ok].max() <= 6e-7
        assert (np.sum(d2 * normal, axis=1) * sense)[ok].min() > 0


def ball(index, radius=5.0):
    return Lens(
        "ball", (Surface(1 / radius, 2 * radius, ConstantIndex(index), radius), Surface(-1 / radius, 0, AIR, radius))
    )


def ball_error(session, index, precision):
    """Largest difference [mm] of axis crossings from the closed form for n = 1.5 at heights up to 3 of 5 mm."""
    heights, n, r = np.linspace(0.5, 3.0, 60), 1.5, 5.0
    rays = on_device(session, ball(index), *parallel(heights), precision, "scene")
    assert rays.passed.all()
    expected = heights / np.sin(2 * (np.arcsin(heights / r) - np.arcsin(heights / (n * r)))) - r
    return np.abs(axis_points(rays.origins, rays.directions) - 2 * r - expected).max()


def test_ball_lens_has_its_spherical_aberration(session):
    assert ball_error(session, 1.5, "single") <= 1e-4
    assert ball_error(session, 1.5, "double") <= 1e-11
    assert ball_error(session, 1.5 + 1e-3, "single") > 1e-3


def test_ball_lens_focuses_behind_itself_in_the_limit_of_small_heights(session):
    # D (2 - n) / (4 (n - 1)): 2.5 mm of a ball of 10 mm; an index of 2 focuses on its own surface
    for index, distance in ((1.5, 2.5), (2.0, 0.0)):
        rays = on_device(session, ball(index), *parallel(np.full(20, 1e-3)), "double", "scene")
        np.testing.assert_allclose(axis_points(rays.origins, rays.directions) - 10, distance, atol=1e-6)


def test_the_aplanatic_point_of_a_sphere_is_imaged_sharply_at_every_angle(session):
    assert weierstrass_error(session, 1.5, "single") <= 1e-4
    assert weierstrass_error(session, 1.5, "double") <= 1e-11
    assert weierstrass_error(session, 1.5 + 1e-4, "single") > 4e-4  # a ten-thousandth of the index shows


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(("make", "conic", "height"), [(plano_hyperbolic, -2.25, 9.0), (ellipsoidal, -1 / 2.25, 5.0)])
def test_stigmatic_conics_have_a_point_for_a_spot(session, make, conic, height, precision):
    beam = parallel(np.linspace(0.1, height, 60))
    lens, focus = make(conic)
    rays = on_device(session, lens, *beam, precision, "scene")
    assert rays.passed.all()
    assert np.sqrt(np.mean(spot(rays, focus) ** 2)) <= (1e-4 if precision == "single" else 1e-12)
    for wrong in (0.0, -conic, conic * 1.01):
        lens, focus = make(wrong)
        rays = on_device(session, lens, *beam, precision, "scene")
        assert not rays.passed.all() or np.sqrt(np.mean(spot(rays, focus) ** 2)) > 1e-3
