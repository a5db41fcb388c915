"""Camera models fitted to lenses: against chief rays traced the other way, OpenCV, and the formulas themselves."""

import json

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.camera_models import (
    CHECKED,
    COEFFICIENTS,
    FITTED,
    calibrate,
    calibrate_best,
    distorted,
    normal_points,
    placed,
    project,
    slopes,
    subject,
    view,
)
from rptcam_cl.optics.beams import chief_ray, film_chief_rays, round_chief_rays
from rptcam_cl.optics.library import load_lens
from rptcam_cl.scene.load import load_scene
from tests.support.cases import slow
from tests.support.pages import ROOT

ALLOWED_PX = 0.05
# Lens, model, size of the picture [pixels] and of the film [mm].
LENSES = [
    ("dgauss-50mm", "brown_conrady", (768, 512), (36.0, 24.0)),
    ("wide-22mm", "brown_conrady", (768, 512), (36.0, 24.0)),
    ("retrofocus-28mm", "brown_conrady", (768, 512), (36.0, 24.0)),
    ("zoom-35-51mm", "brown_conrady", (768, 512), (36.0, 24.0)),
    ("fisheye-10mm", "kannala_brandt", (768, 576), (21.0, 15.75)),
    ("phone-5.6mm", "rational", (256, 192), (5.6, 4.2)),
]
QUICK = ("dgauss-50mm", "fisheye-10mm")  # a lens for each of two models
EACH_LENS = [case if case[0] in QUICK else slow(*case) for case in LENSES]


def camera(lens, size=(768, 512), film=(36.0, 24.0), overrides=()):
    return view(subject(lens, overrides, size=size, film_mm=film))


def corners(size, columns=9, rows=7, margin=0.03):
    """Places of a board's corners in the picture, out to its edges."""
    x, y = (np.linspace(margin * side, (1 - margin) * side, n) for side, n in zip(size, (columns, rows), strict=True))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("name", ["dgauss-50mm", "wide-22mm", "fisheye-10mm", "takumar-50mm"])
def test_chief_rays_from_film_and_from_scene_are_the_same(name):
    lens = load_lens(name)
    film_z = lens.film_z(lens.first_order().back_focal_distance_mm)
    for degrees in (5.0, 20.0):
        _, there = chief_ray(lens, degrees)
        at = there.origins + there.directions * ((film_z - there.origins[:, 2]) / there.directions[:, 2])[:, None]
        back = film_chief_rays(lens, at)
        expected = [0.0, np.sin(np.radians(degrees)), np.cos(np.radians(degrees))]
        assert back.clear.all()
        assert -back.directions[0] == pytest.approx(expected, abs=1e-8)  # the search from the scene ends at 1e-8


@pytest.mark.parametrize(("lens", "model", "size", "film"), EACH_LENS)
def test_opencv_sees_corners_where_the_lens_does(lens, model, size, film):
    cv2 = pytest.importorskip("cv2")
    seen = camera(lens, size, film)
    found = calibrate(seen, model)
    places = corners(size)
    directions, lit = seen.directions(places)
    matrix = np.array([[found.parameters[0], 0, found.parameters[2] - 0.5],
                       [0, found.parameters[1], found.parameters[3] - 0.5], [0, 0, 1]])  # fmt: skip
    points, zero = directions[lit].reshape(-1, 1, 3) * 3.0, np.zeros(3)
    if model == "kannala_brandt":
        at, _ = cv2.fisheye.projectPoints(points, zero, zero, matrix, np.array(found.coefficients))
    else:
        at, _ = cv2.projectPoints(points, zero, zero, matrix, np.array(found.coefficients))
    off = np.linalg.norm(at.reshape(-1, 2) + 0.5 - places[lit], axis=1)
    assert lit.mean() > 0.85
    assert off.max() <= ALLOWED_PX
    assert np.abs(at.reshape(-1, 2) + 0.5 - found.project(directions[lit])).max() < 1e-9


def test_rational_and_thin_prism_terms_are_those_of_opencv():
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(3)
    coefficients = rng.normal(0, 0.05, 12)
    directions = np.column_stack([rng.uniform(-0.5, 0.5, (50, 2)), np.ones(50)])
    at, _ = cv2.projectPoints(
        directions.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), np.diag([400.0, 500.0, 1.0]), coefficients
    )
    ours = project("thin_prism", np.array([400.0, 500.0, 0.0, 0.0, *coefficients]), directions)
    assert ours == pytest.approx(at.reshape(-1, 2), abs=1e-9)


def test_brown_and_kannala_brandt_by_their_formulas():
    x, y = 0.3, -0.2
    r2 = x * x + y * y
    k1, k2, p1, p2, k3 = 0.1, -0.05, 0.01, -0.02, 0.03
    scale = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    expected = (
        100 * (x * scale + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + 7,
        200 * (y * scale + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + 9,
    )
    found = project("brown_conrady", np.array([100, 200, 7, 9, k1, k2, p1, p2, k3]), np.array([[x, y, 1.0]]))
    assert found[0] == pytest.approx(expected)
    angle = 1.9  # behind the camera
    direction = np.array([[np.sin(angle), 0.0, np.cos(angle)]])
    found = project("kannala_brandt", np.array([100, 200, 7, 9, 0.01, 0.0, 0.0, 0.0]), direction)
    assert found[0] == pytest.approx((100 * angle * (1 + 0.01 * angle**2) + 7, 9))


@pytest.mark.parametrize("model", COEFFICIENTS)
def test_points_that_a_model_does_not_see_have_no_place(model):
    parameters = np.concatenate([[20.0, 20.0, 20.0, 15.0], np.full(len(COEFFICIENTS[model]), 0.01)])
    points = np.array([[0.1, 0.05, -1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.1, 0.05, 1.0]])
    seen = np.isfinite(project(model, parameters, points)).all(axis=1)
    by_angle = model == "kannala_brandt"  # which sees to the sides and behind, where that has an azimuth
    assert seen.tolist() == [by_angle, by_angle, False, False, True]
    assert np.isnan(project(model, parameters, points)[~seen]).all()


def test_model_by_angles_sees_up_to_where_its_radius_turns_back():
    turning = 2.0  # [rad]: the slope 1 + 3 k1 angle^2 is zero there
    parameters = np.array([100.0, 100.0, 0.0, 0.0, -1 / (3 * turning**2), 0.0, 0.0, 0.0])
    angles = np.array([0.0, 1.6, 1.99, 2.01, 3.0])
    places = project("kannala_brandt", parameters, np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)]))
    assert np.isfinite(places[:, 0]).tolist() == [True, True, True, False, False]
    assert places[2, 0] == pytest.approx(100 * turning * 2 / 3, abs=0.01)


def test_calibration_projects_one_point_or_many_and_none_from_behind():
    found = calibrate(camera("dgauss-50mm", (96, 64)), "pinhole")
    one = found.project([0.1, 0.05, 1.0])
    assert one.shape == (1, 2)
    assert found.project([[0.1, 0.05, 1.0], [0.1, 0.05, -1.0]])[0] == pytest.approx(one[0])
    assert np.isnan(found.project([0.1, 0.05, -1.0])).all()


def test_residual_is_that_of_the_corners_without_opencv():
    seen = camera("wide-22mm")
    found = calibrate(seen, "brown_conrady")
    places = corners(seen.size)
    directions, lit = seen.directions(places)
    off = np.linalg.norm(found.project(directions[lit]) - places[lit], axis=1)
    assert off.max() <= found.max_px <= ALLOWED_PX
    assert found.rms_px < found.max_px
    assert np.nanmax(np.linalg.norm(found.errors, axis=-1)) == pytest.approx(found.max_px)


@pytest.mark.parametrize(
    ("lens", "model", "size", "film"),
    [
        ("phone-5.6mm", "brown_conrady", (240, 180), (5.3, 4.0)),  # once 0.19 for 0.42 px, which lie in the corners
        slow("phone-5.6mm", "rational", (240, 180), (5.3, 4.0)),  # along the edges
        slow("phone-5.6mm", "rational", (240, 180), (6.1, 4.6)),  # at the edge of the light
        ("fisheye-10mm", "rational", (1024, 768), (21.0, 15.75)),
        ("anamorphic-100mm", "brown_conrady", (600, 400), (36.0, 24.0)),
    ],
)
def test_residual_is_that_of_the_whole_picture_to_its_edges(lens, model, size, film):
    seen = camera(lens, size, film, ("camera.focus.film_distance_mm=null", "camera.focus.distance_m=1e6"))
    found = calibrate(seen, model)
    places = seen.grid(121, 91)
    directions, lit = seen.directions(places)
    off = np.linalg.norm(found.project(directions[lit]) - places[lit], axis=1)
    assert found.max_px > 0.98 * off.max()  # between places the error may be a little larger
    assert found.max_px < (1.01 if lit.all() else 1.15) * off.max()  # the grid misses the very edge of the light
    at_edge = np.any((places == 0) | (places == size), axis=1)
    area = np.where(at_edge, 0.5, 1.0)
    assert found.lit_share == (1.0 if lit.all() else pytest.approx(area @ lit / area.sum(), abs=2e-4))
    assert found.rms_px == pytest.approx(np.sqrt(area[lit] @ off**2 / area[lit].sum()), rel=0.03)


def test_model_that_errs_in_the_corners_alone_is_refused(capsys):
    words = ["--size", "240x180", "--film", "5.3x4", "--set", "camera.focus.film_distance_mm=null"]
    words += ["--set", "camera.focus.distance_m=1e6", "--model", "brown_conrady", "--max-residual-px", "0.35"]
    assert main(["camera", "phone-5.6mm", *words]) == 2
    assert "brown_conrady errs by 0.42 px" in capsys.readouterr().err


def test_simplest_model_that_fits_is_chosen():
    assert calibrate_best(camera("dgauss-50mm"), list(COEFFICIENTS), 0.05).model == "brown_conrady"
    fisheye = camera("fisheye-10mm", (768, 576), (21.0, 15.75))
    assert calibrate_best(fisheye, list(COEFFICIENTS), 0.005).model == "kannala_brandt"


FILM = {"resolution": [600, 400], "size_mm": [36.0, 24.0]}
CAMERA = {
    "kind": "realistic", "lens": "dgauss-50mm", "eye": [1.0, 2.0, 3.0], "target": [1.0, 2.0, -4.0], "f_number": 8,
    "focus": {"distance_m": 1.0},
}  # fmt: skip


def test_terms_that_a_lens_does_not_need_leave_no_equations_unsolved(capsys):
    burst = ROOT / "examples" / "zoom_burst.yaml"  # whose equations were singular to the last digit
    assert main(["camera", str(burst), "--set", "shutter.open_s=1", "--model", "rational", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["models"]["rational"]["rms_px"] < 1e-4


def test_shifted_and_cropped_films_move_the_principal_point():
    whole = calibrate(view(load_scene({"film": FILM, "camera": CAMERA})), "brown_conrady")
    assert whole.parameters[2:4] == pytest.approx((300, 200), abs=1e-6)
    crop = {"film": FILM | {"crop": [0.25, 1.0, 0.5, 1.0]}, "camera": CAMERA}
    part = view(load_scene(crop))
    assert part.size == (450, 200)
    cropped = calibrate(part, "brown_conrady")
    # without its middle in sight the fit knows the centre less well than the residual
    assert cropped.parameters[2:4] == pytest.approx((150, 0), abs=0.01)
    assert cropped.parameters[0] == pytest.approx(whole.parameters[0], rel=1e-5)
    moved = CAMERA | {"movements": {"shift_mm": 3.0, "rise_mm": 1.5}}
    shifted = calibrate(view(load_scene({"film": FILM, "camera": moved})), "brown_conrady")
    # the picture shows more of the right and of what is above: the axis lies farther left and lower in it
    assert shifted.parameters[2:4] == pytest.approx((300 - 3 * 600 / 36, 200 + 1.5 * 400 / 24), abs=0.01)


def test_centre_is_the_entrance_pupil():
    seen = view(load_scene({"film": FILM, "camera": CAMERA}))
    setting = seen.setting
    ahead = setting.lens.film_z(setting.film_distance_mm) - setting.lens.first_order().entrance_pupil.distance_mm
    assert seen.pupil_ahead_mm == pytest.approx(ahead)
    assert ahead == pytest.approx(51.0, abs=0.1)
    assert seen.pose()[:3, 3] == pytest.approx((1.0, 2.0, 3.0 - ahead * 1e-3))
    assert seen.distance_m == pytest.approx(1.0 - ahead * 1e-3)
    assert seen.pose()[:3, :3] == pytest.approx(np.diag([1.0, -1.0, -1.0]))


def test_object_distance_counts_as_the_pupil_drifts():
    scene = load_scene({"film": FILM, "camera": CAMERA})
    near, far = (view(scene, distance) for distance in (0.5, np.inf))
    corner = np.array([[0.0, 0.0]])
    turn = np.linalg.norm(near.directions(corner)[0] - far.directions(corner)[0])
    drift_mm = dict(near.pupil.drift_mm)[1.0]
    sine = np.sin(np.arccos(far.directions(corner)[0][0, 2]))
    assert drift_mm < -1.0
    assert turn == pytest.approx(abs(drift_mm) * 1e-3 / 0.5 * sine, rel=0.1)  # to first order in drift over distance


def fisheye_at_2_m():
    return camera("fisheye-10mm", (480, 360), (21.0, 15.75), ["camera.focus={distance_m: 2}"]).scene


@pytest.mark.parametrize("distance_m", [0.2, 0.5, 2.0])
@pytest.mark.parametrize("shape", ["plane", "sphere"])
def test_model_of_far_objects_and_the_drift_of_the_pupil_know_every_distance(distance_m, shape):
    scene = fisheye_at_2_m()
    seen, far = view(scene, distance_m, shape), view(scene, np.inf)
    places = corners(seen.size)
    directions, lit = seen.directions(places)
    points = (directions / (directions[:, 2:] if shape == "plane" else 1.0) * distance_m)[lit]
    degrees, ahead_mm = far.drift_by_angle()
    there = points
    for _ in range(3):
        angle = np.degrees(np.arctan2(np.hypot(there[:, 0], there[:, 1]), there[:, 2]))
        there = points - np.interp(angle, degrees, ahead_mm)[:, None] * [0.0, 0.0, 1e-3]
    model = calibrate(far, "kannala_brandt")
    off = np.linalg.norm(model.project(there) - places[lit], axis=1)
    assert off.max() < 5e-3  # 480 pixels of a lens whose models err by 3e-4; the rest is between angles of the table
    assert np.linalg.norm(model.project(points) - places[lit], axis=1).max() > 0.08


def test_boards_that_face_a_fisheye_are_no_plane():
    scene = fisheye_at_2_m()
    plane, sphere = view(scene), view(scene, None, "sphere")
    assert (plane.object_shape, sphere.object_shape, view(scene, np.inf).object_shape) == ("plane", "sphere", None)
    places = corners(plane.size)
    directions, lit = sphere.directions(places)
    by_plane, by_sphere = (calibrate(seen, "kannala_brandt") for seen in (plane, sphere))
    assert np.linalg.norm(by_sphere.project(directions[lit]) - places[lit], axis=1).max() < 1e-3
    assert 0.2 < np.linalg.norm(by_plane.project(directions[lit]) - places[lit], axis=1).max() < 0.3


def test_pupil_of_a_lens_that_is_not_round_has_no_one_drift():
    assert camera("anamorphic-100mm", (48, 32)).drift_by_angle() is None
    assert view(load_scene({"film": FILM, "camera": CAMERA | {"kind": "thick_lens"}})).drift_by_angle() is None


@pytest.mark.parametrize("flip", [True, False])
@pytest.mark.parametrize("kind", ["pinhole", "thin_lens", "thick_lens"])
def test_ideal_cameras_are_pinholes(kind, flip):
    own = {
        "pinhole": {"fov_degrees": 40},
        "thin_lens": {"fov_degrees": 40, "aperture_radius_m": 0.01, "focus_distance_m": 2},
        "thick_lens": {"lens": "dgauss-50mm", "focus": {"distance_m": 2}},
    }[kind]
    pose = {"eye": [0, 0, 0], "target": [0, 0, -1], "flip": flip}
    seen = view(load_scene({"film": FILM, "camera": {"kind": kind, **pose, **own}}))
    found = calibrate(seen, "pinhole")
    assert found.max_px < 1e-8
    assert found.parameters[0] == pytest.approx(found.parameters[1])
    if kind != "thick_lens":
        assert found.parameters[0] == pytest.approx(300 / np.tan(np.radians(20)))
        diameter_mm = seen.facts()["entrance_pupil"]["diameter_mm"]
        assert diameter_mm == pytest.approx(20.0 if kind == "thin_lens" else 0.0)


def test_inverted_picture_is_that_of_a_camera_on_its_head():
    upright = view(load_scene({"film": FILM, "camera": CAMERA}))
    inverted = view(load_scene({"film": FILM, "camera": CAMERA | {"flip": False}}))
    place = np.array([[100.0, 50.0]])
    world = [one.pose()[:3, :3] @ one.directions(at)[0][0]
             for one, at in ((upright, place), (inverted, np.array([[500.0, 350.0]])))]  # fmt: skip
    assert world[0] == pytest.approx(world[1], abs=1e-12)
    assert calibrate(inverted, "brown_conrady").parameters[0] > 0


def test_tilted_film_is_no_model_and_says_so():
    tilted = CAMERA | {"movements": {"tilt_degrees": 8.0}}
    seen = view(load_scene({"film": FILM, "camera": tilted}))
    assert calibrate(seen, "brown_conrady").max_px > 0.5


def test_refused_models_and_cameras():
    with pytest.raises(InputError, match="unknown camera model"):
        calibrate(view(load_scene({"film": FILM, "camera": CAMERA})), "nothing")
    dark = camera("achromat-100mm", (64, 48), (80e3, 60e3))  # whose middle pixel alone has light
    with pytest.raises(InputError, match="shows nothing to fit"):
        calibrate(dark, "brown_conrady")
    around = {"kind": "environment", "eye": [0, 0, 0], "target": [0, 0, -1]}
    with pytest.raises(InputError, match="sees all around"):
        view(load_scene({"film": {"resolution": [64, 32]}, "camera": around}))
    auto = CAMERA | {"focus": {"auto": {"method": "contrast"}}}
    with pytest.raises(InputError, match="yet to be found"):
        view(load_scene({"film": FILM, "camera": auto}))


def test_refused_objects():
    scene = load_scene({"film": FILM, "camera": CAMERA})
    with pytest.raises(InputError, match=r"shape: is no shape of an object \(got cube; allowed: plane, sphere\)"):
        view(scene, 1.0, "cube")
    for distance in (np.nan, -1.0, 0.0, -np.inf):
        with pytest.raises(InputError, match=r"^distance_m: is out of range .* allowed: above 0 m, inf for far away"):
            view(scene, distance)


def test_fisheye_is_known_past_75_degrees_and_dark_beyond_its_circle():
    seen = camera("fisheye-10mm", (270, 200), (27.0, 20.0))
    places = np.array([135.0, 100.0]) + np.array([[132.0, 0.0], [134.5, 0.0], [0.0, 0.0]])
    directions, lit = seen.directions(places)
    assert lit.tolist() == [True, False, True]
    assert 75.0 < np.degrees(np.arccos(directions[0, 2])) < 77.0
    found = calibrate(seen, "kannala_brandt")
    assert found.max_px <= ALLOWED_PX
    assert 0.8 < found.lit_share < 1.0


@pytest.mark.parametrize("model", COEFFICIENTS)
def test_slopes_of_a_model_are_those_of_differences(model: str) -> None:
    random = np.random.default_rng(4)
    points = random.uniform(-0.6, 0.6, (50, 2))
    parameters = np.concatenate([[900.0, 950.0, 320.0, 240.0], random.uniform(-0.1, 0.1, len(COEFFICIENTS[model]))])

    def places(values: np.ndarray) -> np.ndarray:
        return distorted(model, values[4:], points) * values[:2] + values[2:4]

    found = slopes(model, parameters, points)
    for k, value in enumerate(parameters):
        step = np.zeros(len(parameters))
        step[k] = 1e-5 * max(abs(value), 0.1)
        there = (places(parameters + step) - places(parameters - step)) / (2 * step[k])
        np.testing.assert_allclose(found[..., k], there, rtol=1e-6, atol=1e-5)


def test_chief_rays_of_a_round_lens_are_those_that_are_traced_one_by_one() -> None:
    scene = load_scene({
        "film": {"resolution": [48, 32], "width_mm": 36},
        "camera": {"kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 0, 2], "target": [0, 0, 0],
                   "focus": {"distance_m": 2}},
    })  # fmt: skip
    seen = view(scene)
    lens, back = seen.setting.lens, seen.setting.film_distance_mm
    film = seen.film_points(seen.grid(13, 11))
    each = film_chief_rays(lens, np.column_stack([film[:, :2], np.full(len(film), lens.film_z(back))]), 587.56)
    together = round_chief_rays(lens, np.column_stack([film[:, :2], np.full(len(film), lens.film_z(back))]), 587.56)
    np.testing.assert_allclose(together.directions, each.directions, atol=1e-9)
    np.testing.assert_allclose(together.origins, each.origins, atol=1e-7)
    np.testing.assert_array_equal(together.clear, each.clear)


@pytest.mark.parametrize(("lens", "model", "size", "film"), EACH_LENS)
def test_no_other_parameters_leave_less(lens, model, size, film):
    seen = camera(lens, size, film)
    found = calibrate(seen, model).parameters
    places = seen.grid(*FITTED)
    directions, lit = seen.directions(places)

    def left(parameters):
        return np.sum((project(model, parameters, directions[lit]) - places[lit]) ** 2)

    least = left(found)
    for k in range(len(found)):
        for share in (1e-6, -1e-6):
            other = found.copy()
            other[k] += share * max(abs(found[k]), 0.01)
            assert left(other) >= least


def test_errors_over_the_whole_picture_are_those_of_each_place():
    """A round lens is asked over a quarter of the picture alone."""
    seen = camera("dgauss-50mm", (96, 64))
    found = calibrate(seen, "brown_conrady")
    places = seen.grid(*CHECKED)
    directions, _ = seen.directions(places)
    off = placed("brown_conrady", found.parameters, normal_points("brown_conrady", directions)) - places
    np.testing.assert_allclose(found.errors, off.reshape(*CHECKED[::-1], 2), atol=1e-6)


@pytest.mark.parametrize("movements", [{"rise_mm": 3}, {"tilt_degrees": 4, "shift_mm": -5}, {"swing_degrees": -6}])
@pytest.mark.parametrize("flip", [False, True])
def test_ideal_lens_on_a_moved_film_sees_what_the_lens_itself_does_but_for_its_distortion(movements, flip):
    pose = {"lens": "dgauss-50mm", "eye": [0, 0, 0], "target": [0, 0, -1], "focus": {"distance_m": 2}}
    film = {"resolution": [60, 40], "size_mm": [36.0, 24.0]}
    keys = pose | {"movements": movements, "flip": flip}
    kinds = (view(load_scene({"film": film, "camera": keys | {"kind": kind}})) for kind in ("realistic", "thick_lens"))
    exact, ideal = (seen.directions([[30, 20], [45, 20], [30, 32], [12, 10]])[0] for seen in kinds)
    np.testing.assert_allclose(ideal, exact, atol=4e-3)


def test_lens_alone_stands_at_the_origin_and_looks_along_minus_z():
    seen = camera("dgauss-50mm")
    assert seen.scene.camera.eye == (0, 0, 0)
    matrix = seen.pose()
    np.testing.assert_allclose(matrix[:3, :3], np.diag([1, -1, -1]), atol=1e-12)
    np.testing.assert_allclose(matrix[:3, 3], [0, 0, -seen.pupil_ahead_mm * 1e-3], atol=1e-12)
