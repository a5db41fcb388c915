"""The renderer as a focus probe shows what the picture shows."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import lenses_dir
from rptcam_cl.optics.charts import chart_svg
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.studies.focus import renderer
from rptcam_cl.studies.focus.controller import zone_of_object
from rptcam_cl.studies.focus.probe import FocusReport, ProbeRecord, Zone, ZoneImage, focus_plot
from rptcam_cl.studies.focus.renderer import UNLIMITED, clearer_light, clearness, mean_light, most_light
from tests.rendering.pictures import seed_of
from tests.studies.focus.scenes import CENTRE, checker, lens_camera, noise, probe_of, scene_of, target
from tests.support.cases import fast, slow

CORNER = Zone(0.08, 0.14, 0.1, 0.18)
THIN = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 2, "focus_distance_m": 3}


def with_group():
    """The telephoto lens, whose rear group moves to focus."""
    lens = yaml.safe_load((lenses_dir() / "telephoto-250mm.yaml").read_text("utf-8"))
    return lens | {"name": "tele with group", "focusing": {"surfaces": [4, 6], "travel": [-2.0, 12.0]}}


CAMERAS = {
    "realistic": lens_camera("dgauss-50mm"),
    "no stop": lens_camera("biconvex"),
    "shaped stop": lens_camera("dgauss-50mm", aperture={"shape": "polygon", "blades": 6}),
    "inverted": lens_camera("dgauss-50mm", flip=False),
    "thick": lens_camera("dgauss-50mm", "thick_lens"),
    "group": lens_camera(with_group()),
    "thin": {**THIN, "eye": [0, 0, 0], "target": [0, 0, -1]},
    "thin by field": {
        "kind": "thin_lens", "fov_degrees": 40, "aperture_radius_m": 0.01, "focus_distance_m": 3,
        "eye": [0, 0, 0], "target": [0, 0, -1],
    },
}  # fmt: skip


@pytest.mark.parametrize("more", [{"medium": {"visibility_m": 30}}, {"film": {"transparent": True}}])
def test_white_that_probes_are_divided_by_is_white_in_fog_and_where_pictures_have_no_background(more):
    white = renderer._white_world(scene_of([target(4.0, 4.0, noise(100))], CAMERAS["thin"], **more))
    np.testing.assert_allclose(rptcam_cl.render(white, size=(24, 16), spp=1).pixels, 1.0, rtol=1e-5)


@pytest.mark.parametrize("name", fast(["realistic"], CAMERAS))
def test_probe_sees_what_the_picture_shows(name):
    scene = scene_of([target(4.0, 4.0, noise(100))], CAMERAS[name])
    probe = probe_of(scene)
    zones = [CENTRE, CORNER]
    # through the lens as it stands, in the pixels of the probe
    seen = probe.measure(probe.state, zones, 128, seed_of(name))
    full = change_scene(probe.view.scene, film={"crop": None}, render={"clamp": None})  # probes choose their own limit
    white = scene_of([], CAMERAS[name], film={"resolution": full.film.resolution})
    for zone, image in zip(zones, seen, strict=True):
        x0, x1, y0, y1 = probe.view.pixels_of(zone)
        width, height = full.film.resolution
        crop = (x0 / width, x1 / width, y0 / height, y1 / height)

        def picture(scene, seed, crop=crop):
            return np.asarray(rptcam_cl.render(scene, spp=64, seed=seed, crop=crop)).mean(axis=2)

        halves = [picture(full, seed) / picture(white, seed) for seed in (1, 2)]  # the mean light of rays that pass
        theirs, ours = np.mean(halves, axis=0), image.luminance.mean(axis=0)
        assert ours.shape == theirs.shape
        # relative exposure is by first-order optics here and by exact rays there
        difference = ours / ours.mean() - theirs / theirs.mean()
        error = np.hypot(
            np.sqrt(image.variance.mean()) / ours.mean(), np.std(halves[0] - halves[1]) / 2 / theirs.mean()
        )
        assert np.sqrt(np.mean(difference**2)) < 1.5 * error
        assert ours.std() / ours.mean() > 2 * error  # there was something to see


def test_a_look_leaves_the_camera_as_it_was_and_repeats_itself():
    probe = probe_of(scene_of([target(2.0, 2.0, checker(200))], lens_camera("dgauss-50mm")))
    state = probe.state
    first, second, third = (
        probe.measure(at, [CENTRE], 16, seed=7)[0] for at in (state, state + 0.3, state)
    )  # fmt: skip
    assert probe.state == state
    assert (first.parts == third.parts).all()
    assert not (first.parts == second.parts).all()
    assert not (first.parts[0] == first.parts[1]).all()


@pytest.mark.parametrize("name", CAMERAS)
def test_states_and_distances_invert_each_other(name):
    probe = probe_of(scene_of([target(2.0, 2.0, checker(200))], CAMERAS[name]))
    for distance in (3.2, 5.0, 30.0):
        state = probe.drive.state_for(distance, CENTRE)
        assert probe.drive.state_at(probe.drive.coordinate(state)) == pytest.approx(state, rel=1e-9)
        assert probe.drive.object_distance(state, CENTRE) == pytest.approx(distance, rel=2e-3)
    near, far = (probe.drive.coordinate(probe.drive.state_for(distance, CENTRE)) for distance in (3.2, 30.0))
    assert probe.drive.nearer * (near - far) > 0


@pytest.mark.parametrize("name", fast(["realistic"], CAMERAS))
def test_smaller_stop_deepens_the_focus(name):
    probe = probe_of(scene_of([target(4.0, 4.0, checker(800))], CAMERAS[name]))
    drive = probe.drive
    away = drive.state_at(drive.coordinate(drive.state_for(4.0, CENTRE)) + 5 * drive.nearer * drive.depth_of_focus)

    def contrast(stop):
        image = probe.measure(away, [CENTRE], 64, seed=3, stop=stop)[0].luminance.mean(axis=0)
        return image.std() / image.mean()

    assert contrast(0.1) > 1.3 * contrast(1.0)


def test_depth_of_focus_is_twice_the_f_number_times_the_circle_of_confusion():
    circle = np.hypot(36, 24) / 1500
    for camera in (
        lens_camera("dgauss-50mm", f_number=4),
        THIN | {"f_number": 4, "eye": [0, 0, 0], "target": [0, 0, -1]},
    ):
        assert probe_of(scene_of([], camera)).drive.depth_of_focus == pytest.approx(8 * circle)


def test_state_out_of_range_is_refused():
    probe = probe_of(scene_of([], lens_camera("dgauss-50mm")))
    with pytest.raises(InputError, match="focus state 500 lies outside its range"):
        probe.measure(500.0, [CENTRE], 4, seed=1)


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ({"kind": "pinhole", "fov_degrees": 40}, r"camera\.kind: pinhole: everything it sees is sharp"),
        (THIN | {"f_number": None, "aperture_radius_m": 0}, "0 makes everything sharp"),
    ],
)
def test_camera_without_focus_is_refused(camera, message):
    scene = scene_of([], camera | {"eye": [0, 0, 0], "target": [0, 0, -1]})
    with pytest.raises(InputError, match=message):
        _ = probe_of(scene).drive.depth_of_focus


FILMS = [
    {"format": "full_frame"},
    {"pixel_pitch_um": 100},
    {"width_mm": 36},
    {"diagonal_mm": float(np.hypot(36, 24))},
    {"size_mm": [36, 24], "crop": [0.6, 0.9, 0.1, 0.4]},
]


@pytest.mark.parametrize(
    "film",
    [pytest.param(film, id=next(iter(film)), marks=() if "size_mm" in film else pytest.mark.slow) for film in FILMS],
)
def test_film_is_the_same_whichever_way_its_size_is_said(film):
    sizes = {"size_mm": None} | film
    scene, plain = (
        scene_of([target(4.0, 4.0, checker(20)) | {"name": "wall"}], lens_camera("dgauss-50mm"), film=said)
        for said in (sizes, {})
    )
    probe, same = probe_of(scene), probe_of(plain)
    probe.choose_zones([CENTRE])
    same.choose_zones([CENTRE])
    assert probe.view.scene.film.resolution == same.view.scene.film.resolution
    assert probe.view.scene.film.size_m() == pytest.approx(same.view.scene.film.size_m())
    state, reference = probe.drive.state_for(4.0, CENTRE), probe.drive.limits[0]
    values = [each.measure(state, [CENTRE], 4, 1, reference=reference)[0].parts for each in (probe, same)]
    assert np.allclose(*values)
    assert np.array_equal(probe.objects(), same.objects())


def test_camera_focuses_before_a_film_of_any_kind():
    film = {"size_mm": None, "pixel_pitch_um": 100}
    camera = lens_camera("dgauss-50mm", focus={"auto": {"method": "depth", "object": "wall"}})
    scene = scene_of([target(4.0, 4.0, checker(20)) | {"name": "wall"}], camera, film=film)
    assert rptcam_cl.autofocus(scene).focus_distance_m == pytest.approx(4.0, rel=1e-3)


POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
GLASS, MIRROR = {"kind": "dielectric", "index": 1.5}, {"kind": "mirror"}
BALL = {"shape": "sphere", "center": [0, 0, -2.5], "radius": 1.0, "material": MIRROR}
PANE = {"shape": "box", "min": [-1, -1, -1.2], "max": [1, 1, -1.0], "material": GLASS}


@pytest.mark.parametrize(
    ("before", "behind", "depth"),
    [
        slow(PANE, 3.0, 3.0 - 0.2 * (1 - 1 / 1.5)),
        (target(1.5, 2.0, MIRROR), -2.0, 1.5 + 3.5),
        slow(BALL, -2.0, 1.5 + 1 / (1 / 3.5 + 2 / 1.0)),  # 1/v = 1/u + 2/R behind the vertex
    ],
    ids=["pane", "mirror", "convex mirror"],
)
def test_zone_shows_what_lies_behind_glass_and_in_mirrors_where_it_seems_to_be(before, behind, depth):
    objects = [before | {"name": "front"}, target(behind, 4.0, checker(100)) | {"name": "wall"}]
    scene = scene_of(objects, THIN | POSE)
    probe = probe_of(scene)
    middle = Zone(0.495, 0.505, 0.495, 0.505)
    sight = probe.sight(probe.state, middle)
    assert np.median(sight.depths) == pytest.approx(depth, rel=1e-3)
    assert (sight.objects == 1).all()
    assert (sight.first_objects == 0).all()
    for name in ("wall", "front"):  # the second shows nothing of its own
        zone = zone_of_object(probe, name)
        assert zone.left < 0.5 < zone.right
    report = rptcam_cl.autofocus(scene, "depth", zones=[[0.495, 0.505, 0.495, 0.505]])
    assert report.focus_distance_m == pytest.approx(depth, rel=1e-3)
    assert ("through glass" if before is PANE else "in a mirror") in report.remarks[0]


def report_of(method, quantities):
    probes = [ProbeRecord(40 + k, 40.0 + k, 1.0 / (1 + k), 0.01, 1.0, 9, 0.1, q) for k, q in enumerate(quantities)]
    return FocusReport(method, 41.0, 41.0, 1.0, 1.0, 0.01, 0.1, CENTRE, probes=probes)


def test_each_round_of_a_search_is_a_curve_of_its_own():
    """The same opening shows less contrast in a wider zone, and one line through both would be a saw."""
    report = report_of("contrast", ["contrast"] * 6)
    probes = [replace(p, value=(1 + k // 3) * [0.5, 1, 0.4][k % 3], round=k // 3) for k, p in enumerate(report.probes)]
    figure = focus_plot(replace(report, probes=probes), "title")
    curves = [[np.asarray(container[0].get_ydata(), float) for container in axes.containers] for axes in figure.axes]
    assert np.allclose(curves[0], [[50, 100, 40]] * 2) and np.allclose(curves[1], [[50, 100, 40]])


@pytest.mark.parametrize(
    ("method", "quantities", "shown", "hidden"),
    [
        ("contrast", ["contrast"] * 4, "of the greatest [%]", "displacement"),
        ("phase", ["displacement"] * 2, "displacement of the halves", "of the greatest [%]"),
        ("hybrid", ["displacement"] + ["contrast"] * 3, "displacement of the halves", "nan"),
    ],
)
def test_plot_shows_what_the_method_looked_at(method, quantities, shown, hidden):
    text = chart_svg(focus_plot(report_of(method, quantities), "title"))
    assert shown in text
    assert hidden not in text
    assert "found</text>" in text
    if method == "hybrid":
        assert "of the greatest [%]" in text


def test_too_few_probes_are_no_curve():
    for method, quantity in (("depth", "distance"), ("contrast", "contrast")):
        with pytest.raises(InputError, match="no curve to draw"):
            focus_plot(report_of(method, [quantity]), "title")


def test_rare_bright_samples_are_limited_and_others_stay_whole():
    rng, ones = np.random.default_rng(1), np.ones((2, 40, 50), np.float32)
    texture = np.where(np.indices((40, 50)).sum(axis=0) // 3 % 2 == 0, 0.5, 1.5)
    noisy = (texture * rng.exponential(1.0, ones.shape)).astype(np.float32)
    fireflies = np.where(rng.random(ones.shape) < 0.01, np.float32(1e5), noisy)
    assert 1.8 < most_light(fireflies, ones) < 3.5  # nine tenths stay whole, and the mean is 1
    even = (texture * rng.uniform(0.9, 1.1, ones.shape)).astype(np.float32)
    assert most_light(even, ones) > 1e5
    assert most_light(0 * ones, ones) == UNLIMITED


def test_details_show_more_with_a_limit_unless_they_are_what_it_takes():
    rng, shape = np.random.default_rng(1), (4, 40, 50)
    texture = np.where(np.indices((40, 50)).sum(axis=0) // 3 % 2 == 0, 0.5, 1.5)
    sparks = np.zeros((40, 50))
    sparks[::9, ::9] = 200.0  # bright places, which each sample shows, are what there is to see
    noisy = texture * rng.exponential(1.0, shape)
    rare = np.where(rng.random(shape) < 0.01, 1e5, noisy)
    for picture, better in ((rare, "limited"), (sparks * rng.uniform(0.9, 1.1, shape) + noisy, "whole")):
        clear = []
        for shown in (np.minimum(picture, 3.0), picture):
            clear.append(clearness([ZoneImage(np.repeat(shown[..., None], 3, axis=3).astype(np.float32), 4)]))
        assert clearer_light(*clear) == better


def test_pixels_without_rays_show_what_lies_beside_them():
    rng = np.random.default_rng(2)
    slope = np.repeat(np.linspace(1.0, 3.0, 30)[None, :, None], 20, axis=0)
    weights = np.where(rng.random((20, 30, 1)) < 0.6, 1.0, 0.0).astype(np.float32)
    shown = mean_light((slope * weights).astype(np.float32), weights)
    assert np.abs(shown - slope).max() < 0.2  # the mean of all is up to 1 off
    whole = np.ones((20, 30, 1), np.float32)
    assert np.allclose(mean_light(slope.astype(np.float32), whole), slope)
    assert not mean_light(whole, 0 * whole).any()


@pytest.mark.slow
def test_lamp_out_of_focus_before_a_wall_is_no_noise_of_its_zone():
    glow = {"kind": "emissive", "radiance": 1e5}
    lamp = {"shape": "sphere", "center": [0.01, 0.0, -0.9], "radius": 0.0004, "material": glow}
    scene = scene_of([target(4.0, 4.0, noise(200)), lamp], lens_camera("dgauss-50mm", f_number=2.1))
    probe = probe_of(scene)
    image = probe.measure(probe.drive.state_for(4.0, CENTRE), [CENTRE], 64, 1)[0]
    shown = [np.sqrt(each.variance.mean()) / each.luminance.mean() for each in (image, image.in_light("whole"))]
    assert shown[0] < 0.3 * shown[1]


@pytest.mark.slow
def test_all_of_the_light_is_that_of_a_probe_without_a_limit(monkeypatch):
    # Grey light, as what the limit takes is known as the mean of the channels.
    glow = {"kind": "emissive", "radiance": 1e3}
    lamp = {"shape": "sphere", "center": [0.01, 0.0, -0.9], "radius": 0.004, "material": glow}
    scene = scene_of([target(4.0, 4.0, noise(200)), lamp], lens_camera("dgauss-50mm", f_number=2.1))
    shown = []
    for limited in (True, False):
        if not limited:
            monkeypatch.setattr(renderer, "most_light", lambda *_: 1e9)
        probe = probe_of(scene)
        shown.append(probe.measure(probe.drive.state_for(4.0, CENTRE), [CENTRE], 16, 1)[0])
    one, other = (each.in_light("whole").luminance for each in shown)
    assert shown[0].whole is not None
    assert shown[1].whole is None
    one, other = one / one.mean(), other / other.mean()  # exposures differ
    assert np.abs(one - other).max() < 1e-3 * other.max()
    limited = shown[0].luminance / shown[0].luminance.mean()
    assert np.abs(limited - other).max() > 0.1 * other.max()


@pytest.mark.parametrize("digits", [-80, 24, 70])
def test_probe_of_light_of_another_unit_is_the_same(digits):
    """The first look at the light has a limit, which must leave the most of it whole however bright it is."""
    shown = []
    for unit in (1.0, 2.0**digits):
        glow = [{"kind": "emissive", "radiance": value * unit} for value in (0.2, 300.0)]
        lamps = [{"shape": "sphere", "center": [x, 0, -1.2], "radius": 0.03, "material": glow[1]} for x in (-0.1, 0.1)]
        sky = {"environment": {"kind": "constant", "radiance": unit}}
        objects = [target(4.0, 4.0, noise(200)), target(5.0, 5.0, glow[0]), *lamps]
        probe = probe_of(scene_of(objects, lens_camera("dgauss-50mm", f_number=2.1), **sky))
        shown.append(probe.measure(probe.drive.state_for(4.0, CENTRE), [CENTRE], 16, 1)[0].luminance / np.float32(unit))
    np.testing.assert_array_equal(*shown)
