"""Zones from files, points and policies."""

import pytest

import rptcam_cl
from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.scene.lens_settings import read_zones
from rptcam_cl.studies.focus.controller import METHODS, zone_at
from rptcam_cl.studies.focus.probe import Policy, Zone, choose_zone
from tests.studies.focus.scenes import lens_camera, scene_of

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
