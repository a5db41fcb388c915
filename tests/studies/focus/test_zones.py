"""Zones from files, points and policies."""

import math
from dataclasses import astuple

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.studies.focus.controller import METHODS, read_zones, zone_at, zones_of_mask
from rptcam_cl.studies.focus.probe import Policy, Zone, choose_zone
from tests.studies.focus.scenes import lens_camera, noise, scene_of, target

GOOD = {
    b".58 .64 .38 .46\n": ((0.58, 0.64, 0.38, 0.46),),
    b"# zones\r\n.2666\t.34\t.5\t.56\r\n\r\n.8 .9 .6 .7 # far\r\n": ((0.2666, 0.34, 0.5, 0.56), (0.8, 0.9, 0.6, 0.7)),
    b"\xef\xbb\xbfxleft xright ytop ybottom\n0, 1, 0, 1\n": ((0.0, 1.0, 0.0, 1.0),),
}  # fmt: skip
BAD = {
    b"": "af.txt: holds no zones",
    b"# nothing\n": "af.txt: holds no zones",
    b".1 .2 .3\n": r"af.txt:1: is not a zone \(got .1 .2 .3; allowed: four numbers",
    b".1 .2 .3 .4\n.1 .2 a .4\n": r"af.txt:2: is not a zone \(got .1 .2 a .4",
    b".1 .2 .3 .4\nxleft xright ytop ybottom\n": "af.txt:2: is not a zone",
    b"a b c\n": r"af.txt:1: is not a zone \(got a b c; allowed: four numbers xleft xright ytop ybottom\)$",
    b"a b c\n.1 .2 .3 .4\n": r"af.txt:1: is not a zone \(got a b c",
    b"xleft xright ytop ybottom\na b c d\n": r"af.txt:2: is not a zone \(got a b c d",
    b".2 .1 .3 .4\n": r"af.txt:1: is not inside the picture \(got .2 .1 .3 .4; allowed: 0 <= xleft < xright <= 1",
    b".1 1.2 .3 .4\n": "af.txt:1: is not inside the picture",
    b".1 nan .3 .4\n": "af.txt:1: is not inside the picture",
    b"\xff\xfe\x00": "af.txt: is not a text file",
    b".1 .2 .3 .4\n" * 1001: "af.txt: is too long",
}


@pytest.mark.parametrize("content", GOOD)
def test_zones_of_the_assignment_are_read(content):
    assert read_zones(content, "af.txt") == GOOD[content]


@pytest.mark.parametrize("content", BAD, ids=range(len(BAD)))
def test_bad_zones_are_refused_with_their_line(content):
    with pytest.raises(InputError, match=f"^{BAD[content]}"):
        read_zones(content, "af.txt")


def test_zones_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(StateError, match="cannot be read"):
        read_zones(tmp_path / "none.txt", "none.txt")


SCENES = [
    ({"zones": []}, r"zones: must be a list of zones"),
    ({"zones": [[0.5, 0.4, 0, 1]]}, r"zones\[0\]: has no area"),
    ({"zones": [[0.1, 0.2, 0.3]]}, r"zones: has 3 numbers instead of 4"),
    ({"zones": [[0.1, 0.2, 0.3, 1.4]]}, r"zones\[0\]\[3\]"),
    ({"zones": [[0.1, 0.2, 0.3, 0.4]], "point": [0.5, 0.5]}, "cannot be given together with zones"),
    ({"zones_from": {"file": "none.txt"}}, "no such file"),
    ({"method": "contrst"}, "method"),
    ("depht", "is no method; did you mean depth"),
    ({"policy": "nearest"}, r"policy: is not a known choice; did you mean closest\? \(got 'nearest'"),
    ({"policy": "furthest"}, r"policy: .* did you mean farthest\?"),
]


@pytest.mark.parametrize(("auto", "message"), SCENES)
def test_scene_with_bad_autofocus_is_refused_with_its_key(auto, message):
    with pytest.raises(InputError, match=rf"camera\.focus\.auto.*{message}"):
        scene_of([], lens_camera("dgauss-50mm", focus={"auto": auto}))


def test_command_line_suggests_the_policy_that_a_word_means(capsys):
    assert main(["focus", "scene.yaml", "--policy", "nearest"]) == 2
    assert "--policy: got nearest; did you mean closest?; allowed closest" in capsys.readouterr().err


def test_api_names_every_method():
    said = rptcam_cl.studies.focus.controller.autofocus.__doc__
    assert [name for name in METHODS if f"``{name}``" not in said] == []


def test_focus_is_either_given_or_found():
    with pytest.raises(InputError, match="cannot be given together"):
        scene_of([], lens_camera("dgauss-50mm", focus={"auto": "depth", "distance_m": 3}))
    with pytest.raises(InputError, match="seeks the film distance, which auto gives already"):
        scene_of([], lens_camera("dgauss-50mm", focus={"auto": "depth", "method": "spot"}))


ZONES = [Zone(0.1, 0.4, 0.1, 0.4), Zone(0.45, 0.55, 0.45, 0.55), Zone(0.7, 0.9, 0.7, 0.9)]
PLACES = {0: 37.0, 1: 38.0, 2: 36.5}  # film distances: zone 1 has what is nearest, zone 2 what is farthest


@pytest.mark.parametrize(
    ("policy", "zone"), [(Policy.CLOSEST, 1), (Policy.FARTHEST, 2), (Policy.CENTRE, 1), (Policy.WEIGHTED, 0)]
)
def test_policy_chooses_its_zone(policy, zone):
    assert choose_zone(policy, ZONES, PLACES) == zone
    assert choose_zone(policy, ZONES, {2: 36.5}) == 2


def test_weights_of_zones_are_their_areas_less_towards_the_corners():
    large = [Zone(0.2, 0.8, 0.2, 0.8), Zone(0.45, 0.55, 0.45, 0.55), Zone(0.4, 0.5, 0.4, 0.5)]
    assert choose_zone(Policy.WEIGHTED, large, {0: 36.0, 1: 38.0, 2: 39.0}) == 0
    assert choose_zone(Policy.WEIGHTED, large, {1: 38.0, 2: 39.0, 0: 40.0}) == 0
    corners = [Zone(0, 0.1, 0, 0.1), Zone(0.9, 1, 0.9, 1), Zone(0.45, 0.55, 0.45, 0.55)]
    assert choose_zone(Policy.WEIGHTED, corners, {0: 36.0, 1: 37.0, 2: 38.0}) == 2
    assert choose_zone(Policy.WEIGHTED, corners, {0: 36.0, 1: 37.0}) == 0


@pytest.mark.parametrize("point", [(0.5, 0.5), (0.0, 1.0), (0.99, 0.02)])
def test_zone_round_a_point_is_square_and_inside(point):
    zone = zone_at(scene_of([], lens_camera("dgauss-50mm")), *point)
    assert 0 <= zone.left < zone.right <= 1
    assert 0 <= zone.top < zone.bottom <= 1
    assert (zone.right - zone.left) * 36 == pytest.approx((zone.bottom - zone.top) * 24)
    assert zone.left <= point[0] <= zone.right
    assert zone.top <= point[1] <= zone.bottom


# Points of the scene, by a thin lens: a point at (x, y, -z) is seen at x f' / z on the film, whose distance is f' then.

HEAD = {
    "shape": "sphere", "name": "head", "radius": 0.1, "material": noise(60), "center": [0, 0, 0],
    "transform": [{"rotate": {"axis": [0, 1, 0], "degrees": 30}}, {"translate": [0.05, 0.03, -1.2]}],
}  # fmt: skip
EYE = (-0.03, 0.02, math.sqrt(0.1**2 - 0.03**2 - 0.02**2))
WALL = target(4.0, 4.0, noise(300))


def thin_scene(*objects, auto, **camera):
    pose = {"eye": [0, 0, 0], "target": [0, 0, -1]}
    thin = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 2, "focus": {"auto": auto}, **pose, **camera}
    return scene_of(list(objects), thin)


def place_of(point, distance):
    """Where a thin lens of 50 mm shows a point when it is focused at a distance, in fractions of 36 x 24 mm."""
    x, y, z = point
    behind = 1 / (1 / 0.05 - 1 / distance)
    return 0.5 + x / -z * behind / 0.036, 0.5 - y / -z * behind / 0.024


def test_point_of_an_object_is_focused_on_where_the_object_is():
    turn = math.radians(30)
    x, y, z = EYE
    world = (
        0.05 + x * math.cos(turn) + z * math.sin(turn), 0.03 + y, -1.2 - x * math.sin(turn) + z * math.cos(turn)
    )  # fmt: skip
    scene = thin_scene(HEAD, WALL, auto={"method": "depth", "object": "head", "at": EYE})
    report = rptcam_cl.autofocus(scene)
    assert report.zone.centre == pytest.approx(place_of(world, -world[2]), abs=2e-4)
    assert report.focus_distance_m == pytest.approx(-world[2], abs=0.003)  # a depth of field is 0.04 m
    again = rptcam_cl.autofocus(thin_scene(HEAD, WALL, auto="depth"), at=world)
    assert again.zone.centre == pytest.approx(report.zone.centre, abs=1e-9)


@pytest.mark.parametrize(
    ("objects", "auto", "message"),
    [
        ((HEAD, WALL), {"object": "head", "at": [0, 0, -0.1]}, "hidden by head"),
        ((HEAD, WALL), {"at": [0.05, 0.03, -3.9]}, "hidden by head"),
        ((HEAD, WALL), {"at": [0, 0, 3]}, "not in the picture"),
        ((HEAD, WALL), {"at": [3, 0, -3]}, "not in the picture"),
        ((HEAD, WALL), {"object": "haed", "at": [0, 0, 0]}, "did you mean head"),
    ],
)
def test_point_that_is_not_seen_is_refused(objects, auto, message):
    with pytest.raises(InputError, match=message):
        rptcam_cl.autofocus(thin_scene(*objects, auto={"method": "depth", **auto}))


def test_each_bright_part_of_a_mask_is_a_zone(tmp_path, capsys):
    y, x = np.mgrid[:400, :600]
    mask = (np.hypot(x - 149.5, y - 99.5) < 60) | ((abs(x - 450) < 40) & (abs(y - 300) < 20))
    disk, bar = zones_of_mask(mask)
    for zone, centre, half in ((disk, (0.25, 0.25), 60 / 2**0.5), (bar, (0.75, 0.75), 20)):
        assert zone.centre == pytest.approx(centre, abs=0.06)  # within the part
        x0, x1, y0, y1 = (round(share * side) for share, side in zip(astuple(zone), (600, 600, 400, 400), strict=True))
        inside = mask[y0:y1, x0:x1]
        assert inside.mean() > 0.97
        assert 0.65 * half < (zone.bottom - zone.top) * 200 < half
    scene = thin_scene(target(2.0, 0.3, noise(40), x=0.4), WALL, auto="depth")
    left = np.zeros((40, 60))
    left[15:25, 5:15] = 1
    assert rptcam_cl.autofocus(scene, mask=left).focus_distance_m == pytest.approx(4.0, rel=1e-3)
    assert rptcam_cl.autofocus(scene, mask=left[:, ::-1]).focus_distance_m == pytest.approx(2.0, rel=1e-3)
    with pytest.raises(InputError, match=r"dark everywhere"):
        rptcam_cl.autofocus(scene, mask=0 * left)


def test_adjustment_goes_so_many_depths_of_focus_farther_away():
    scene = thin_scene(target(2.0, 0.6, noise(60)), auto={"method": "depth", "adjustment": 1.5})
    found, right = rptcam_cl.autofocus(scene), rptcam_cl.autofocus(scene, adjustment=0)
    film_mm = [1 / (1 / 50 - 1e-3 / report.focus_distance_m) for report in (right, found)]
    depth_mm = 2 * 2 * math.hypot(36, 24) / 1500
    assert right.focus_distance_m == pytest.approx(2.0, rel=1e-3)
    assert film_mm[0] - film_mm[1] == pytest.approx(1.5 * depth_mm, rel=0.1)


def test_a_zone_among_others_is_found_as_it_is_alone():
    figure, beside = (0.5, 0.6, 0.4, 0.6), (0.1, 0.2, 0.4, 0.6)
    found = rptcam_cl.autofocus(
        "examples/first_light.yaml", "contrast", zones=[figure, beside], policy="closest", seed=1
    )
    by_rays = rptcam_cl.autofocus("examples/first_light.yaml", "depth", zones=[figure])
    assert astuple(found.zone) == figure
    assert found.focus_distance_m == pytest.approx(by_rays.focus_distance_m, rel=0.02)
