"""Image circle, T-number, working f-number, stop diameter by the sine rule, and the whole of `lens info`."""

import json

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.glass import ConstantIndex
from rptcam_cl.optics.irradiance import film_irradiance, image_circle, lens_info, t_number, working_f_number
from rptcam_cl.optics.lens import Lens, film_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.surface import Surface
from tests.support.cases import slow


@pytest.mark.parametrize(
    ("name", "film", "radius"),
    [
        ("dgauss-50mm", 36.77, 28.30),
        slow("wide-22mm", 14.54, 25.38),
        ("fisheye-10mm", 23.192, 13.45),
        slow("telephoto-250mm", 123.7439, 80.4),
    ],
)
def test_image_circle_of_the_assignment_lenses(name, film, radius):
    lens = load_lens(name)
    circle = image_circle(lens, film)
    assert circle == pytest.approx(radius, rel=7e-4)
    assert not fan_passes(lens, film, circle * 1.001) and fan_passes(lens, film, circle * 0.9995)


@pytest.mark.slow
@pytest.mark.parametrize(("f_number", "middle"), [slow(11.0, True), (12.5, False), slow(13.0, False)])
def test_image_circle_of_a_mirror_lens_ends_with_its_crescents_and_not_in_a_dark_middle(f_number, middle):
    lens = load_lens("mirror-500mm")
    lens = lens.with_stop_diameter(lens.stop_diameter_for(f_number))
    film = film_distance(lens, np.inf)
    circle = image_circle(lens, film)
    aims = np.stack(np.meshgrid(np.linspace(14, 17.5, 900), np.linspace(0, 3.2, 800)), axis=-1).reshape(-1, 2)

    def lit(x):  # two slivers, of a grid of 4 µm
        start = np.array([x, 0, lens.length + film])
        targets = np.column_stack([aims, np.full(len(aims), lens.length)])
        return lens.trace(np.broadcast_to(start, targets.shape), targets - start).passed.any()

    assert lit(0.996 * circle) and not lit(1.001 * circle)
    assert bool(film_irradiance(lens, film, 0.0)) == middle


def fan_passes(lens, film, radius, rays=40_000):
    """Return whether any ray of a dense fan in the plane of axis and film point comes through."""
    start = np.array([radius, 0, lens.length + film])
    aims = np.linspace(-1.5, 1.5, rays) * lens.surfaces[-1].semi_diameter
    targets = np.column_stack([aims, np.zeros(rays), np.full(rays, lens.length)])
    return lens.trace(np.broadcast_to(start, targets.shape), targets - start).passed.any()


def test_t_number_without_losses_follows_the_sine():
    lens = load_lens("dgauss-50mm")
    lens = lens.with_stop_diameter(lens.stop_diameter_for(5.6))
    film = lens.first_order().back_focal_distance_mm
    # E = pi sin^2 theta, so T = 1 / (2 sin theta): the f-number of a lens that obeys the sine condition.
    assert t_number(lens, film) == pytest.approx(5.6, rel=5e-3)
    assert working_f_number(lens, film) == pytest.approx(5.6, rel=1e-9)
    assert working_f_number(lens, film + lens.first_order().focal_length_mm) == pytest.approx(11.2, rel=0.06)


@pytest.mark.parametrize("gap", [20.0, 20.0 * (1 + 1e-9), 19.0])
def test_working_f_number_in_another_medium(gap):
    # A surface of power 1/20 per mm before glass; a stop in its front focal plane has the exit pupil at infinity.
    stop = Surface(thickness=gap, semi_diameter=2.0, is_stop=True)
    lens = Lens("one surface", (stop, Surface(1 / 10, 0.0, ConstantIndex(1.5), 9.0)))
    film = lens.first_order().back_focal_distance_mm
    assert film == pytest.approx(30.0)
    assert working_f_number(lens, film) == pytest.approx(20.0 / 4.0)  # 1 / (2 n' u'), n' u' = 2 mm / 20 mm


@pytest.mark.parametrize(
    "name", ["human-eye", *map(slow, ("biconvex", "dgauss-50mm", "mirror-500mm")), "zoom-80-200mm"]
)
def test_info_is_plain_json_for_every_bundled_lens(name):
    info = lens_info(load_lens(name))
    assert json.loads(json.dumps(info, allow_nan=False)) == info
    for key in ("focal_length_mm", "back_focal_distance_mm", "front_focal_distance_mm", "f_number", "surfaces"):
        assert info[key] is not None
    assert set(info["principal_planes_mm"]) == {"front", "rear"}
    assert set(info["entrance_pupil"]) == set(info["exit_pupil"]) == {"distance_mm", "diameter_mm"}
    if info["film_distance_mm"] is not None:
        ends = name not in ("achromat-100mm", "asphere-1.4mm", "biconvex", "paper-biconvex", "plano-convex-100mm")
        assert (info["image_circle_mm"] is not None) == ends and info["t_number"] > 0.4
        assert 0 < info["half_light_circle_mm"] < (info["image_circle_mm"] or 8 * info["focal_length_mm"])


def test_a_lens_without_a_barrel_has_no_image_circle_and_half_its_light_at_33_degrees(capsys):
    thin = {"surfaces": [{"radius": 50, "thickness": 1e-6, "glass": {"index": 1.5}, "diameter": 0.1, "stop": True}]}
    thin["surfaces"].append({"diameter": 0.1})
    info = lens_info(load_lens(thin))
    half = 2 * 100 * np.tan(np.arccos(0.5**0.25))  # cos^4 of the angle at the lens
    assert info["half_light_circle_mm"] == pytest.approx(half, rel=1e-2)
    assert info["image_circle_mm"] is info["field_of_view_degrees"] is None
    assert main(["lens", "info", "achromat-100mm"]) == 0
    assert "image circle [mm]               without end: no rim of the lens ends it" in capsys.readouterr().out


def test_info_at_an_aperture_and_a_distance():
    info = lens_info(load_lens("dgauss-50mm"), f_number=8, object_distance_mm=1000)
    assert info["f_number"] == pytest.approx(8)
    assert info["film_distance_mm"] == pytest.approx(38.917623766237696, rel=1e-9)
    assert info["working_f_number"] > 8.3
    assert 50 < info["field_of_view_degrees"] < 70
    with pytest.raises(InputError, match="nearest possible"):
        lens_info(load_lens("dgauss-50mm"), object_distance_mm=50)
    assert lens_info(load_lens("biconcave"))["film_distance_mm"] is None
    assert np.isfinite(info["t_number"])
