"""Focus and zoom of lens cameras: what is asked to be sharp is, and a zoom position has its field of view."""

import math
from itertools import product

import numpy as np
import pytest
import yaml

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import lenses_dir
from rptcam_cl.optics.beams import Beam, spot
from rptcam_cl.optics.best_focus import best_film_distance_at
from rptcam_cl.optics.lens import nearest_object_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.cameras.setting import lens_setting
from tests.rendering.pictures import lamp, pixels, scene_of, seed_of
from tests.support.cases import fast, one_in, slow

KINDS = ["thick_lens", "realistic"]
LAMP = lamp(1.0)


def camera_of(kind, lens, focus, **options):
    """A camera whose film is at the origin and that looks along -z."""
    return {"kind": kind, "lens": lens, "focus": focus, "eye": [0, 0, 0], "target": [0, 0, -1], **options}


def state_of(camera, **rest):
    """The lens of a camera as it is set."""
    return lens_setting(rptcam_cl.load_scene(scene_of([], camera, **rest)))


def with_group(travel=(-2.0, 12.0)):
    """The telephoto lens, whose rear group moves to focus."""
    lens = yaml.safe_load((lenses_dir() / "telephoto-250mm.yaml").read_text("utf-8"))
    return lens | {"name": "tele with group", "focusing": {"surfaces": [4, 6], "travel": list(travel)}}


def spread(camera, distance_m, radius_m, width_mm):
    """Root mean square radius of the image of a small disk on the axis [mm]."""
    disk = {"shape": "disk", "center": [0, 0, -distance_m], "normal": [0, 0, 1], "radius": radius_m, "material": LAMP}
    scene = scene_of([disk], camera, film={"width_mm": width_mm}, depth=1)
    film = pixels(scene, seed=seed_of("spread"), spp=512)[..., 0]
    place = ((np.arange(32) + 0.5) / 32 - 0.5) * width_mm
    return math.sqrt(float((film * (place[None] ** 2 + place[:, None] ** 2)).sum() / film.sum()))


SHARP = [
    ("thick_lens", "dgauss-50mm", {}, "thick", 0.2),
    ("realistic", "dgauss-50mm", {}, "spot", 0.1),
    slow("realistic", "dgauss-50mm", {"f_number": 11}, "thick", 0.4),
    slow("realistic", "biconvex", {}, "spot", 1.0),
    slow("realistic", "zoom-70-200mm", {"zoom": "135 mm"}, "spot", 0.2),
    ("thick_lens", "zoom-80-200mm", {"focal_length_mm": 120}, "thick", 0.2),
]


@pytest.mark.parametrize(("kind", "lens", "options", "method", "step"), SHARP)
def test_small_disk_in_focus_has_its_smallest_image(kind, lens, options, method, step):
    focus = {"distance_m": 2.5, "method": method}
    found = state_of(camera_of(kind, lens, focus, **options))
    scale = found.lens.first_order().focal_length_mm / 2500
    f_number = found.lens.first_order().f_number
    width = 4 * (step / f_number + 0.02)
    sizes = [
        spread(
            camera_of(kind, lens, {"film_distance_mm": found.film_distance_mm + shift}, **options),
            2.5, 0.1 * width / scale / 1e3, width,
        )
        for shift in (-step, 0.0, step)
    ]  # fmt: skip
    assert sizes[1] < 0.9 * min(sizes[0], sizes[2])
    # halfway on either side it is the smaller one, so the least lies in the middle half
    assert abs(sizes[0] - sizes[2]) < (sizes[0] + sizes[2]) / 2 - sizes[1]


def test_least_spot_of_a_ball_is_far_from_the_paraxial_focus():
    states = [
        state_of(camera_of("realistic", "ball", {"distance_m": 0.4, "method": method})) for method in ("thick", "spot")
    ]
    thick, least = (
        spot(state.lens, state.film_distance_mm, Beam(0, 400 - state.lens.length - state.film_distance_mm)).rms
        for state in states
    )
    assert states[0].film_distance_mm - states[1].film_distance_mm > 1
    assert least < 0.6 * thick


@pytest.mark.parametrize(
    ("kind", "method", "lens"), one_in(3, product(KINDS, ("thick", "spot"), ("dgauss-50mm", with_group())))
)
def test_ways_to_say_what_is_in_focus_agree(kind, method, lens):
    turned = {"eye": [1, 2, 3], "target": [1, 2, 7], "metres_per_unit": 0.5}
    options = {key: turned.pop(key) for key in ("eye", "target")}
    one = state_of(camera_of(kind, lens, {"distance_m": 5.0, "method": method}) | options, **turned)
    # ten units of half a metre along the axis, and somewhere beside it
    other = state_of(camera_of(kind, lens, {"point": [-4, 9, 13], "method": method}) | options, **turned)
    assert other.film_distance_mm == pytest.approx(one.film_distance_mm, rel=1e-9)
    front = 5.0 - (one.lens.length + one.film_distance_mm) * 1e-3
    third = state_of(camera_of(kind, lens, {"front_distance_m": front, "method": method}))
    assert third.film_distance_mm == pytest.approx(one.film_distance_mm, rel=1e-7)
    assert third.focus_distance_mm == pytest.approx(5000, rel=1e-9)


@pytest.mark.parametrize("flip", [True, False])
def test_spot_is_least_where_the_picture_says(flip):
    tilted = [
        {"radius": 50, "thickness": 4, "glass": {"index": 1.5}, "diameter": 20, "tilt_degrees": [4, 3]},
        {"radius": -50, "thickness": 5, "diameter": 20, "tilt_degrees": [4, 3]},
        {"stop": True, "diameter": 6},
    ]
    lens = load_lens({"name": "tilted", "surfaces": tilted})
    focus = {"front_distance_m": 4.0, "method": "spot", "field": [0.8, 0.1]}
    camera = camera_of("realistic", {"name": "tilted", "surfaces": tilted}, focus, flip=flip)
    state = state_of(camera)
    width, height = (side * 1e3 for side in rptcam_cl.load_scene(scene_of([], camera)).film.size_m())
    # right and high in an upright picture is left and low on the film
    sense = -1 if flip else 1
    there = best_film_distance_at(lens, (sense * 0.3 * width, sense * 0.4 * height), 4000.0, "front")
    mirrored = best_film_distance_at(lens, (-sense * 0.3 * width, -sense * 0.4 * height), 4000.0, "front")
    assert state.film_distance_mm == pytest.approx(there, rel=1e-9)
    assert abs(state.film_distance_mm - mirrored) > 0.1
    assert state.metadata["focus_field"] == [0.8, 0.1]


@pytest.mark.slow
@pytest.mark.parametrize("kind", fast(["realistic"], KINDS))
def test_focusing_group_makes_its_distance_sharpest_on_a_film_that_stays(kind):
    method = "spot" if kind == "realistic" else "thick"
    camera = camera_of(kind, with_group(), {"distance_m": 6.0, "method": method}, f_number=11)
    state, plain = state_of(camera), load_lens(with_group())
    whole = plain.length + plain.first_order().back_focal_distance_mm
    assert state.lens.length + state.film_distance_mm == pytest.approx(whole)
    assert state.lens.length > plain.length + 1
    sizes = [spread(camera, distance, 4e-4, 0.5) for distance in (5.5, 6.0, 6.6)]
    assert sizes[1] < 0.7 * min(sizes[0], sizes[2])


@pytest.mark.parametrize("focus", [{"distance_m": 3.0}, {"front_distance_m": 3.0}])
def test_group_of_the_front_surfaces_keeps_its_distance_from_the_film(focus):
    lens = yaml.safe_load((lenses_dir() / "telephoto-250mm.yaml").read_text("utf-8"))
    lens |= {"focusing": {"surfaces": [0, 2], "travel": [-40, 2]}}
    state, plain = state_of(camera_of("realistic", lens, focus)), load_lens(lens)
    assert state.film_distance_mm == pytest.approx(plain.first_order().back_focal_distance_mm)
    assert state.lens.length > plain.length + 5  # the front group has moved towards the object
    assert state.focus_distance_mm is not None
    front = state.focus_distance_mm - state.lens.length - state.film_distance_mm
    assert (state.focus_distance_mm if "distance_m" in focus else front) == pytest.approx(3000)


ENDS = [
    ("zoom-80-200mm", "80 mm", 80.0),
    ("zoom-80-200mm", "200 mm", 200.0),
    ("zoom-70-200mm", "72 mm", 72.1),
    ("zoom-70-200mm", "194 mm", 194.0),
    ("zoom-35-51mm", "35 mm", 35.0),
    ("zoom-35-51mm", "51 mm", 51.0),
]


@pytest.mark.parametrize("kind", fast(["realistic"], KINDS))
@pytest.mark.parametrize(("lens", "zoom", "focal_length"), one_in(3, ENDS))
def test_zoom_position_has_its_published_field_of_view(kind, lens, zoom, focal_length):
    # two lamps a kilometre away, a quarter of the published field of 36 mm to either side
    away = 1000 * 9 / focal_length
    lamps = [
        {"shape": "disk", "center": [x, 0, -1000], "normal": [0, 0, 1], "radius": 600 / focal_length, "material": LAMP}
        for x in (-away, away)
    ]
    camera = camera_of(kind, lens, {"distance_m": 1000}, zoom=zoom)
    scene = scene_of(lamps, camera, film={"size_mm": [36, 4]}, resolution=(144, 16), depth=1)
    image = rptcam_cl.render(scene, spp=64)
    light = np.asarray(image)[..., 0].sum(axis=0)
    place = (np.arange(144) - 71.5) / 4
    left, right = (float((place * light)[side].sum() / light[side].sum()) for side in (place < 0, place > 0))
    # the patents round to half a percent, and distortion at a quarter of the field is below one
    tolerance = 0.005 if kind == "thick_lens" else 0.015
    assert (right - left) / 2 == pytest.approx(9, rel=tolerance)
    assert image.metadata["zoom"] == zoom
    assert image.metadata["focal_length_mm"] == pytest.approx(focal_length, rel=3e-3)


@pytest.mark.slow
def test_metadata_say_what_was_done():
    scene = scene_of([], camera_of("realistic", "zoom-70-200mm", {"front_distance_m": 4}, focal_length_mm=100))
    found = rptcam_cl.render(scene, spp=1).metadata
    assert (found["camera"], found["focus_method"], found["focused_by"]) == ("realistic", "thick", "whole lens")
    assert found["focal_length_mm"] == pytest.approx(100)
    assert "zoom" not in found
    lens = state_of(scene["camera"]).lens
    assert found["focus_distance_m"] == pytest.approx(4 + (lens.length + found["film_distance_mm"]) * 1e-3)
    scene["camera"] |= {"lens": with_group(), "focal_length_mm": None, "focus": {"distance_m": 6, "method": "spot"}}
    found = rptcam_cl.render(scene, spp=1).metadata
    assert (found["focus_method"], found["focused_by"], found["focus_distance_m"]) == ("spot", "group", 6)
    scene["camera"] |= {"kind": "thick_lens", "lens": "dgauss-50mm", "focus": {"film_distance_mm": 30}}
    found = rptcam_cl.render(scene, spp=1).metadata  # nearer than infinity: nothing is ever sharp
    assert not {"focus_method", "focused_by", "focus_distance_m"} & set(found)
    assert (found["camera"], found["film_distance_mm"]) == ("thick_lens", 30)


REFUSED = [
    ("dgauss-50mm", {"distance_m": 0.1}, {}, r"the nearest possible is 195\.\d+ mm"),
    ("dgauss-50mm", {"distance_m": 0.1, "method": "spot"}, {}, r"the nearest possible is 195\.\d+ mm"),
    ("dgauss-50mm", {"front_distance_m": 0.02}, {}, r"in front of the lens; the nearest possible is 27\.\d+ mm"),
    ("dgauss-50mm", {"point": [3, 0, -0.1]}, {}, "cannot focus at 100 mm from the film"),
    (with_group((0.0, 1.0)), {"distance_m": 1.0}, {}, r"its group focuses from \d+\.?\d* to \w+ mm from the film"),
    (with_group((0.0, 1.0)), {"front_distance_m": 1.0}, {}, "its group focuses from"),
    ("dgauss-50mm", {"distance_m": 5}, {"zoom": "tele"}, "no configuration 'tele'; it has none"),
    ("zoom-70-200mm", {"distance_m": 5}, {"zoom": "tele"}, "it has 72 mm, 135 mm, 194 mm"),
    ("zoom-70-200mm", {"distance_m": 5}, {"focal_length_mm": 300}, r"zooms from 72\.1\d* to 193\.\d+ mm"),
    ("dgauss-50mm", {"distance_m": 5}, {"focal_length_mm": 60}, "is not a zoom lens"),
]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("lens", "focus", "options", "message"), REFUSED, ids=[row[3][:40] for row in REFUSED])
def test_what_is_out_of_reach_is_refused_with_what_is_not(kind, lens, focus, options, message):
    with pytest.raises(InputError, match=message):
        state_of(camera_of(kind, lens, focus, **options))


def test_nearest_possible_distance_is_within_reach():
    nearest = nearest_object_distance(load_lens("dgauss-50mm")) * 1e-3
    assert state_of(camera_of("realistic", "dgauss-50mm", {"distance_m": nearest * 1.0001})).film_distance_mm > 80


def test_lens_of_an_unknown_name_is_named_with_its_key():
    scene = scene_of([], camera_of("realistic", "fisheye", {"distance_m": 1}))
    with pytest.raises(InputError, match=r"^camera\.lens: fisheye: no such lens .* did you mean fisheye-10mm"):
        rptcam_cl.render(scene, spp=1)
