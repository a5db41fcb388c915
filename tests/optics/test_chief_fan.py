"""Chief rays from one fan out of the stop: as if traced one by one, for all states of the film and the stop."""

from typing import Any

import numpy as np
import pytest

from rptcam_cl.optics import beams, field_measures
from rptcam_cl.optics.aberrations import curvature_rows
from rptcam_cl.optics.beams import chief_ray, film_chief_rays, round_chief_rays, without_obstructions
from rptcam_cl.optics.lens import Lens, film_distance, zoom_to
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.spots import field_waves, setting

NM = 587.56


def points(lens: Lens, film_distance_mm: float, radius_mm: float) -> np.ndarray:
    turns = np.linspace(0.0, 6.0, 23)
    across = np.linspace(0.0, radius_mm, 23)
    return np.column_stack([across * np.cos(turns), across * np.sin(turns), np.full(23, lens.film_z(film_distance_mm))])


def check(lens: Lens, film_distance_mm: float, radius_mm: float) -> None:
    film = points(lens, film_distance_mm, radius_mm)
    fan, each = round_chief_rays(lens, film, NM), film_chief_rays(lens, film, NM)
    # The search that traces ends at 1e-10 of the stop's radius.
    for name in ("origins", "aims"):
        np.testing.assert_allclose(getattr(fan, name)[each.found], getattr(each, name)[each.found], atol=1e-8)
    np.testing.assert_allclose(fan.directions[each.found], each.directions[each.found], atol=1e-9)
    np.testing.assert_array_equal(fan.found, each.found)
    np.testing.assert_array_equal(fan.clear, each.clear)


def states(name: str) -> tuple[Lens, float]:
    lens = load_lens(name)
    return (zoom_to(lens, 120.0) if name == "zoom-70-200mm" else lens), film_distance(lens, np.inf)


@pytest.mark.parametrize(
    ("name", "radius_mm"),
    [("dgauss-50mm", 21.6), ("fisheye-10mm", 12.0), ("wide-22mm", 18.0), ("zoom-70-200mm", 15.0), ("biconvex", 5.0)],
)
def test_rays_of_a_fan_are_those_that_are_traced(name: str, radius_mm: float, monkeypatch: pytest.MonkeyPatch) -> None:
    lens, film_distance_mm = states(name)
    check(lens, film_distance_mm, radius_mm)
    monkeypatch.setattr(beams, "film_chief_rays", None)  # whatever traces each ray fails
    round_chief_rays(lens, points(lens, film_distance_mm, radius_mm), NM)


def test_a_fan_serves_all_states_of_film_and_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    lens, film_distance_mm = states("retrofocus-35mm")
    check(lens, film_distance_mm, 18.0)
    monkeypatch.setattr(beams, "_with_nodes", None)  # whatever traces another fan fails
    check(lens.with_stop_diameter(1.0), film_distance_mm, 18.0)
    check(lens, 1.01 * film_distance_mm, 18.1)
    with pytest.raises(TypeError):
        check(lens, film_distance_mm, 9.0)


@pytest.mark.parametrize("name", ["mirror-500mm", "microscope-20x"], ids=["mirrors", "film beyond the light"])
def test_where_no_fan_goes_rays_are_traced(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    lens, film_distance_mm = states(name)
    film = points(lens, film_distance_mm, 2 * abs(lens.first_order().focal_length_mm))
    calls: list[Any] = []
    monkeypatch.setattr(beams, "film_chief_rays", lambda *args: calls.append(args) or film_chief_rays(*args))
    found = round_chief_rays(lens, film, NM)
    assert len(calls) == 1
    np.testing.assert_array_equal(found.clear, film_chief_rays(lens, film, NM).clear)


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
