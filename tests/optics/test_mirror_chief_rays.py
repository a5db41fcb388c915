"""Chief rays of lenses with mirrors: stops behind mirrors, obstructions in the middle, what is measured along them."""

import numpy as np
import pytest

from rptcam_cl.optics import field_measures
from rptcam_cl.optics.aberrations import curvature_rows
from rptcam_cl.optics.beams import chief_ray, film_chief_rays, without_obstructions
from rptcam_cl.optics.lens import film_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.spots import field_waves, setting

STOP = {"stop": True, "diameter": 20}


def mirror(radius, thickness=0.0, **more):
    return {"radius": radius, "mirror": True, "thickness": thickness, "diameter": 150, **more}


def lens(*rows):
    return load_lens({"name": "mirrors", "surfaces": list(rows)})


NEWTON = lens(mirror(-400, -50), STOP)
CASSEGRAIN = lens(mirror(-400, -140, inner_diameter=30), {**mirror(-160, stop=True), "diameter": 30})


@pytest.mark.parametrize("system", [NEWTON, CASSEGRAIN], ids=["behind one", "on the second"])
def test_chief_rays_go_through_a_stop_behind_a_mirror(system):
    film = np.array([[0.0, 3.0, system.film_z(film_distance(system, np.inf))], [2.0, -1.0, system.film_z(90.0)]])
    found = film_chief_rays(system, film)
    assert found.found.all()
    rays = without_obstructions(system).trace(found.origins + 10 * found.directions, -found.directions, start="scene")
    assert rays.passed.all()
    assert rays.origins[:, :2] == pytest.approx(0, abs=1e-8)  # the stop is the last surface
    ahead = (film[:, 2] - rays.origins[:, 2]) / rays.directions[:, 2]
    assert rays.origins + ahead[:, None] * rays.directions == pytest.approx(film, abs=1e-8)


def test_a_stop_at_the_centre_of_a_spherical_mirror_gives_a_concentric_image_also_behind_an_obstruction():
    for ring in ({}, {"inner_diameter": 12.0}):
        system = lens({**STOP, "thickness": 200.0}, mirror(-200, **ring))
        height, ray = chief_ray(system, 5.0)
        assert height == pytest.approx(0, abs=1e-9)
        assert ray.passed[0]
        assert ray.directions[0] == pytest.approx([0, -np.sin(np.radians(5)), -np.cos(np.radians(5))], abs=1e-12)
        rows = curvature_rows(setting(system), [0.0, 2.0, 5.0], [587.5618])
        for row in rows:  # the sphere of radius 100 about the middle of the stop
            curved = 100 * (1 - np.cos(np.radians(row["field_degrees"])))
            assert row["tangential_mm"] == pytest.approx(curved, abs=2e-6)
            assert row["sagittal_mm"] == pytest.approx(curved, abs=2e-6)


def test_distortion_of_a_mirror_telephoto_is_that_of_its_wavefront():
    state = setting(load_lens("mirror-500mm"))
    rows = field_measures.distortion_table(state, [0.0, 1.0], [587.5618], "tan")
    assert rows[0]["height_mm"] == pytest.approx(0, abs=1e-9)
    wave = field_waves(state, [1.0], [587.5618], 32)[0]
    assert rows[1]["height_mm"] == pytest.approx(wave.chief[1], rel=1e-9)
