"""What autofocus finds is where exact rays make the least spot."""

from dataclasses import astuple

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import open_session
from rptcam_cl.scene.lens_settings import AutoFocus
from rptcam_cl.studies.focus.controller import find_focus, focused_scene, follow_focus
from rptcam_cl.studies.focus.probe import NoContrast, OutOfReach, Zone
from rptcam_cl.studies.focus.renderer import ProbeRenderer
from tests.studies.focus.scenes import CENTRE, checker, lens_camera, noise, scene_of, target
from tests.studies.focus.test_probe import THIN, with_group
from tests.support.cases import fast, slow
from tests.support.pages import ROOT

OFF = Zone(0.24, 0.29, 0.3, 0.375)
POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}


def wall(distance, focal_length_mm, material=noise):
    """Return a target that fills the picture with two details per mm of film, whatever the distance."""
    half = distance
    return target(distance, half, material(2 * 2 * focal_length_mm))


def missed(scene, distance, zone, **options):
    """Return by how many depths of focus autofocus misses the least spot, and its report."""
    probe = ProbeRenderer(scene, open_session(None))
    best = probe.drive.coordinate(probe.drive.state_for(distance, zone))
    report = rptcam_cl.autofocus(scene, zones=[(zone.left, zone.right, zone.top, zone.bottom)], **options)
    return (probe.drive.coordinate(report.state) - best) / probe.drive.depth_of_focus, report


CASES = {
    "double Gauss f/2": (lens_camera("dgauss-50mm"), 50, 2.0, CENTRE),
    "double Gauss f/2.8 off axis": (lens_camera("dgauss-50mm", f_number=2.8), 50, 0.8, OFF),
    "wide f/5.6": (lens_camera("wide-22mm", f_number=5.6), 22, 3.0, CENTRE),
    "telephoto f/5.6": (lens_camera("telephoto-250mm"), 250, 20.0, CENTRE),
    "singlet f/10": (lens_camera("biconvex-stop"), 50, 2.0, CENTRE),
    "doublet f/8": (lens_camera("achromat-100mm", f_number=8), 100, 5.0, CENTRE),
    "thick lens": (lens_camera("dgauss-50mm", "thick_lens"), 50, 2.0, OFF),
    "thin lens": (THIN | POSE, 50, 2.0, CENTRE),
    "focusing group": (lens_camera(with_group()), 250, 30.0, CENTRE),
}
QUICK = "double Gauss f/2.8 off axis"


@pytest.mark.parametrize("name", fast([QUICK], CASES))
def test_contrast_is_greatest_where_the_spot_is_least(name):
    camera, focal_length, distance, zone = CASES[name]
    scene = scene_of([wall(distance, focal_length)], camera)
    error, report = missed(scene, distance, zone)
    assert abs(error) <= 0.25
    assert report.error <= report.depth_of_focus_mm / 8  # the search takes samples until it is
    assert len(report.probes) <= 15
    rounds = [probe.round for probe in report.probes]
    assert rounds == sorted(rounds)
    for number in rounds:  # each is a curve with one top
        own = sorted((p for p in report.probes if p.round == number), key=lambda p: p.film_distance_mm)
        rises = np.diff([p.value for p in own]) > 0
        assert not (np.diff(rises.astype(int)) > 0).any()
    assert report.confidence > 0.95
    # the lens has it at this distance in first order, but for what the state is off, in vergence [1/m]: a depth of
    # focus of a wide lens is a good part of the distance
    depth = report.depth_of_focus_mm * 1e-3 / (focal_length * 1e-3) ** 2
    assert abs(1 / report.focus_distance_m - 1 / distance) <= 0.05 / distance + abs(error) * depth


@pytest.mark.parametrize("method", ["depth", *(slow(m) for m in ("phase", "contrast"))])
def test_lens_of_mirrors_is_focused_though_its_middle_is_obstructed(method):
    # probes through a small opening look through the middle
    scene = scene_of([target(12.0, 0.6, noise(40))], lens_camera("mirror-500mm"))
    error, report = missed(scene, 12.0, CENTRE, method=method)
    assert abs(error) < 0.25
    assert report.warnings == []


@pytest.mark.slow
def test_noise_of_the_probe_that_hardly_any_rays_pass_does_not_hide_contrast_elsewhere():
    # Through the first stop rays rarely find the pupil, and at the far end of the reach least of all.
    camera = lens_camera("mirror-500mm") | {"focus": {"distance_m": 60.0}}
    scene = scene_of([target(60.0, 6.0, noise(600))], camera)
    error, report = missed(scene, 60.0, CENTRE, method="contrast")
    assert abs(error) < 0.25
    assert report.confidence > 0.95


@pytest.mark.slow
def test_end_of_the_reach_where_no_light_arrives_does_not_end_the_search():
    film = {"size_mm": [5, 3.5]}
    zone = Zone(0.1, 0.16, 0.15, 0.23)  # a film nearest to the lens sees nothing there
    scene = scene_of([target(0.8, 0.5, noise(250))], lens_camera("phone-5.6mm"), film=film)
    error, report = missed(scene, 0.8, zone, method="depth")
    assert abs(error) < 0.01  # searches for the least spot end as near as that, wherever they begin
    assert report.warnings == []


@pytest.mark.slow
@pytest.mark.parametrize("material", [noise, lambda cells: checker(1.7 * cells)], ids=["noise", "checker"])
@pytest.mark.parametrize("zone", [CENTRE, OFF], ids=["axis", "off"])
@pytest.mark.parametrize("distance", [0.6, 2.0, 20.0])
@pytest.mark.parametrize("f_number", [2.1, 2.8, 5.6, 11])
def test_contrast_is_greatest_where_the_spot_is_least_at_every_aperture(f_number, distance, zone, material):
    scene = scene_of([wall(distance, 50, material)], lens_camera("dgauss-50mm", f_number=f_number))
    error, report = missed(scene, distance, zone)
    assert abs(error) <= 0.25
    assert len(report.probes) <= 18


@pytest.mark.slow
@pytest.mark.parametrize(("lens", "stop"), [("dgauss-50mm", 8), ("dgauss-50mm", 22), ("wide-22mm", 11)])
def test_depth_is_found_behind_a_small_stop(lens, stop):
    scene = scene_of([wall(1.5, 30)], lens_camera(lens, f_number=stop))
    miss, report = missed(scene, 1.5, CENTRE, method="depth")
    assert abs(miss) < 0.05
    assert report.confidence > 0.9


@pytest.mark.slow
def test_walk_of_the_paper_ends_on_the_slope_towards_the_focus():
    camera = lens_camera("dgauss-50mm", f_number=2.8, focus={"distance_m": 2.6})
    scene = scene_of([wall(2.0, 50, checker)], camera)
    error, report = missed(scene, 2.0, CENTRE, method="variance")
    assert abs(error) < 2
    assert report.confidence == 0.0
    values = [probe.value for probe in report.probes]
    found = next(probe for probe in report.probes if probe.film_distance_mm == report.film_distance_mm)
    assert found.value == max(values)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["contrast", "laplacian", "phase", "hybrid"])
def test_even_ball_is_found_by_its_edge(method):
    # The front of the ball is 24.5 units away, its rim, which bounds it in the picture, 24.99.
    report = rptcam_cl.autofocus(ROOT / "examples" / "paper" / "autofocus.yaml", method)
    assert 24.5e-3 < report.focus_distance_m < 25.3e-3


NEAR_AND_FAR = [target(1.0, 0.6, noise(120), x=-0.62), target(3.0, 3.0, noise(300), x=3.01)]
LEFT_AND_RIGHT = [[0.24, 0.29, 0.42, 0.495], [0.7, 0.75, 0.42, 0.495]]


@pytest.mark.parametrize("method", ["contrast", slow("depth")])
@pytest.mark.parametrize(("policy", "distance"), [slow("closest", 1.0), slow("farthest", 3.0)])
def test_two_objects_and_two_zones(policy, distance, method):
    auto = {"method": method, "zones": LEFT_AND_RIGHT, "policy": policy}
    scene = scene_of(NEAR_AND_FAR, lens_camera("dgauss-50mm", focus={"auto": auto}))
    report = rptcam_cl.autofocus(scene)
    assert report.focus_distance_m == pytest.approx(distance, rel=0.03)
    assert [report.zone.left, report.zone.right] == LEFT_AND_RIGHT[0 if policy == "closest" else 1][:2]


@pytest.mark.parametrize("method", ["contrast", "phase", slow("hybrid"), slow("laplacian")])
@pytest.mark.parametrize("policy", ["closest", "farthest", slow("centre"), slow("weighted")])
@pytest.mark.parametrize("blank", [0, 1])
def test_zones_that_show_nothing_leave_the_choice_to_the_others(blank, policy, method):
    near, far = [(GREY, noise(300)), (noise(120), GREY)][blank]
    walls = [target(1.0, 0.6, near, x=-0.62), target(3.0, 3.0, far, x=3.01)]
    auto = {"method": method, "zones": LEFT_AND_RIGHT, "policy": policy}
    report = rptcam_cl.autofocus(scene_of(walls, lens_camera("dgauss-50mm", focus={"auto": auto})))
    assert [report.zone.left, report.zone.right] == LEFT_AND_RIGHT[1 - blank][:2]
    assert report.focus_distance_m == pytest.approx([1.0, 3.0][1 - blank], rel=0.03)
    assert [list(astuple(zone)) for zone in report.zones] == LEFT_AND_RIGHT


@pytest.mark.parametrize(("policy", "distance"), [("closest", (1.8, 1.95)), ("farthest", (25.0, 60.0))])
def test_zone_with_a_plain_thing_at_its_side_is_not_left_out(policy, distance):
    # The second zone shows the wall 38 m away, and at its left a plain cone, which rays lead to and which shows nothing
    # of its own. Sharp within a quarter of a depth of focus is from 25 m to 60 m.
    zones = [[0.62, 0.70, 0.52, 0.62], [0.37, 0.45, 0.36, 0.42]]
    auto = f"camera.focus={{auto: {{zones: {zones}, policy: {policy}}}}}"
    report = rptcam_cl.autofocus(rptcam_cl.load_scene(ROOT / "examples" / "assignment" / "cones.yaml", [auto]))
    assert distance[0] < report.focus_distance_m < distance[1]


def test_zones_from_a_file_a_point_and_an_object_lead_to_the_same_focus(tmp_path):
    (tmp_path / "zones.txt").write_text("xleft xright ytop ybottom\n0.70 0.75 0.42 0.495  # the far wall\n")
    walls = [wall | {"name": name} for wall, name in zip(NEAR_AND_FAR, ("near", "far"), strict=True)]
    places = [{"zones_from": {"file": "zones.txt"}}, {"point": [0.725, 0.46]}, {"object": "far"}]
    for place in places:
        auto = {"method": "depth"} | place
        camera = lens_camera("dgauss-50mm", focus={"auto": auto})
        scene = scene_of(walls, camera, base_dir=tmp_path)
        assert rptcam_cl.autofocus(scene).focus_distance_m == pytest.approx(3.0, rel=0.01)


GREY = {"kind": "matte", "reflectance": 0.5}
BLACK = {"kind": "matte", "reflectance": 0.0}
REFUSED = {
    "flat": ([target(2.0, 3.0, GREY)], {}, "no contrast in the zone"),
    "dark": ([target(2.0, 3.0, noise(400))], {"environment": None}, "no contrast in the zone"),
    "black": ([target(2.0, 3.0, BLACK)], {}, "no contrast in the zone"),
    "lines finer than the film sees": ([target(2.0, 3.0, checker(40000))], {}, "no contrast in the zone"),
    "empty": ([], {}, "no contrast in the zone"),
    "too near": ([target(0.07, 0.2, noise(40))], {"metres_per_unit": 1.0}, "cannot focus at 70 mm from the film"),
}


@pytest.mark.parametrize("name", fast(["flat"], REFUSED))
def test_target_without_contrast_is_refused_and_nothing_moves(name):
    objects, rest, message = REFUSED[name]
    scene = scene_of(objects, lens_camera("dgauss-50mm"), **rest)
    probe = ProbeRenderer(scene, open_session(None))
    before = probe.state
    with pytest.raises(OutOfReach if name == "too near" else NoContrast, match=message):
        rptcam_cl.autofocus(scene, "contrast")
    assert probe.state == before
    if name in ("flat", "dark"):  # distance needs no contrast
        assert rptcam_cl.autofocus(scene, "depth").focus_distance_m == pytest.approx(2.0, rel=1e-3)


def test_nothing_to_measure_the_distance_of_is_refused():
    with pytest.raises(NoContrast, match="rays meet no surface"):
        rptcam_cl.autofocus(scene_of([], lens_camera("dgauss-50mm")), "depth")


@pytest.mark.parametrize(
    ("auto", "message"),
    [
        ({"object": "cat"}, r"no object has this name; did you mean cats\? \(got cat; allowed: cats\)"),
        ({"method": "depth", "object": "cats"}, "cats is not in the picture"),
    ],
)
def test_object_that_is_not_there_is_refused(auto, message):
    behind = target(-2.0, 1.0, GREY) | {"name": "cats"}
    scene = scene_of([behind, wall(2.0, 50)], lens_camera("dgauss-50mm", focus={"auto": auto}))
    with pytest.raises(InputError, match=message):
        rptcam_cl.autofocus(scene)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["contrast", "phase"])
def test_what_a_mirror_shows_is_focused_at_its_distance_by_way_of_the_mirror(method):
    mirror = target(0.5, 0.25, {"kind": "mirror"})  # small, as it keeps the sky from what it shows
    behind = target(-0.5, 3.0, noise(800))
    scene = scene_of([mirror, behind], lens_camera("dgauss-50mm", f_number=2.8), render={"max_depth": 3})
    report = rptcam_cl.autofocus(scene, method)
    assert report.focus_distance_m == pytest.approx(0.5 + 1.0, rel=0.01)
    assert report.confidence > 0.95
    assert report.remarks == ("what the zone shows is seen in a mirror",)
    assert rptcam_cl.autofocus(scene, "depth").focus_distance_m == pytest.approx(1.5, rel=1e-3)


@pytest.mark.slow
def test_hybrid_ends_with_contrast_and_repeats_itself_with_a_seed():
    scene = scene_of([wall(2.0, 50)], lens_camera("dgauss-50mm", f_number=2.8))
    found = [rptcam_cl.autofocus(scene, "hybrid", seed=seed) for seed in (1, 5, 5)]
    for report in found:
        assert (report.method, report.notes["finished_by"]) == ("hybrid", "contrast")
        assert report.focus_distance_m == pytest.approx(2.0, rel=0.01)
        assert report.confidence > 0.95
        assert report.as_dict()["samples"] == sum(probe.samples for probe in report.probes)
    assert found[0].state != found[1].state == found[2].state


@pytest.mark.slow
def test_moving_target_is_followed_from_frame_to_frame():
    distances = [2.0, 1.9, 1.8]
    scenes = [scene_of([wall(distance, 50)], lens_camera("dgauss-50mm")) for distance in distances]
    reports = list(follow_focus(scenes, open_session(None), AutoFocus()))
    for report, distance in zip(reports, distances, strict=True):
        assert report.focus_distance_m == pytest.approx(distance, rel=0.01)
    cold, *warm = [len(report.probes) for report in reports]
    assert max(warm) <= cold <= 6


@pytest.mark.slow
def test_frame_without_contrast_keeps_the_focus():
    scenes = [scene_of([target(2.0, 2.0, material)], lens_camera("dgauss-50mm")) for material in (noise(200), GREY)]
    first, second = follow_focus(scenes, open_session(None), AutoFocus())
    assert second.state == first.state
    assert (first.confidence > 0.9, second.confidence) == (True, 0.0)


@pytest.mark.parametrize(
    "camera",
    [
        lens_camera("dgauss-50mm", focus={"auto": "depth"}),
        slow(lens_camera(with_group(), focus={"auto": {"method": "depth"}})),
        slow({"kind": "thin_lens", "fov_degrees": 40, "aperture_radius_m": 0.01, "focus": {"auto": "depth"}, **POSE}),
    ],
    ids=["lens", "group", "thin lens"],
)
def test_render_takes_the_picture_in_focus(camera):
    scene = scene_of([wall(4.0, 50, checker)], camera, film={"resolution": [36, 24]})
    picture = rptcam_cl.render(scene, spp=4)
    found = picture.metadata["autofocus"]
    assert found["method"] == "depth"
    assert found["focus_distance_m"] == pytest.approx(4.0, rel=1e-3)
    assert picture.metadata["focus_distance_m"] == found["focus_distance_m"]
    report = find_focus(scene, open_session(None), AutoFocus(method="depth"))
    same = rptcam_cl.render(focused_scene(scene, report), spp=4)
    assert (np.asarray(same) == np.asarray(picture)).all()
    assert "autofocus" not in same.metadata


def test_render_says_why_it_cannot_focus():
    scene = scene_of([], lens_camera("dgauss-50mm", focus={"auto": "depth"}))
    with pytest.raises(InputError, match=r"camera\.focus\.auto: .*rays meet no surface"):
        rptcam_cl.render(scene, spp=1)
