"""Chief rays from one fan out of the stop: as if traced one by one, for all states of the film and the stop."""

from typing import Any

import numpy as np
import pytest

from rptcam_cl.optics import beams
from rptcam_cl.optics.beams import film_chief_rays, round_chief_rays
from rptcam_cl.optics.lens import Lens, film_distance, zoom_to
from rptcam_cl.optics.library import load_lens

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
