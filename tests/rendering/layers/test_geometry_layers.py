"""Where the rays of every camera model met the world, against closed forms and lenses traced in float64."""

import numpy as np
import pytest

from rptcam_cl.rendering.cameras.setting import lens_setting
from rptcam_cl.scene.load import load_scene
from tests.rendering.layers.scenes import (
    BALL,
    CAMERAS,
    EYE,
    FLOOR,
    assert_seen_in_their_pixels,
    in_camera,
    one_sample,
    pixel_grid,
    world,
)
from tests.support.cases import fast

GEOMETRY = ["depth", "distance", "position", "normal", "geometric_normal", "object_id", "uv", "pupil"]


@pytest.fixture(scope="module", params=fast(["environment", "thin_lens", "double_gauss"], CAMERAS))
def camera(request):
    return request.param


@pytest.fixture(scope="module")
def image(camera):
    return one_sample(world(camera), GEOMETRY, seed=3)


def test_points_lie_on_the_objects_that_are_named(image):
    ball, floor = (image["object_id"] == index for index in (0, 1))
    assert ball.sum() > 5
    assert floor.sum() > 60
    outwards = (image["position"][ball] - BALL["center"]) / BALL["radius"]
    np.testing.assert_allclose(np.linalg.norm(outwards, axis=1), 1, atol=2e-6)
    np.testing.assert_allclose(image["normal"][ball], outwards, atol=2e-6)
    np.testing.assert_allclose(image["geometric_normal"][ball], outwards, atol=2e-6)
    u, v = np.array(FLOOR["edge_u"], float), np.array(FLOOR["edge_v"], float)
    up = np.cross(v, u) / np.linalg.norm(np.cross(v, u))
    local = image["position"][floor] - FLOOR["corner"]
    np.testing.assert_allclose(local @ up, 0, atol=2e-5)
    np.testing.assert_allclose(np.abs(image["normal"][floor] @ up), 1, atol=1e-6)
    along = np.linalg.solve(np.stack([u, v, up], axis=1), local.T).T
    np.testing.assert_allclose(image["uv"][floor], along[:, :2], atol=2e-6)


def test_depth_is_the_distance_along_the_axis(camera, image):
    hit = image["object_id"] >= 0
    z = in_camera(world(camera), image["position"][hit])[:, 2]
    np.testing.assert_allclose(image["depth"][hit], -z, rtol=2e-6, atol=1e-6)


def test_normals_are_unit_and_face_the_camera(camera, image):
    hit = image["object_id"] >= 0
    np.testing.assert_allclose(np.linalg.norm(image["normal"][hit], axis=1), 1, atol=1e-6)
    towards = np.sum(image["geometric_normal"][hit] * (image["position"][hit] - EYE), axis=1)
    assert (towards < 0.2).all()  # a lens does not see from the eye itself
    assert np.mean(towards < 0) > 0.99


def test_nothing_seen_is_said_so(image):
    sky = image["object_id"] == -1
    assert sky.sum() > 20
    assert np.isposinf(image["depth"][sky]).all()
    assert np.isposinf(image["distance"][sky]).all()
    assert np.isnan(image["position"][sky]).all()
    assert np.isnan(image["uv"][sky]).all()
    assert (image["normal"][sky] == 0).all()


def test_pinhole_sees_each_point_where_its_intrinsics_say():
    scene = world("pinhole")
    image = one_sample(scene, GEOMETRY, seed=4)
    x, y, z = np.moveaxis(in_camera(scene, image["position"]), -1, 0)
    k = image.metadata["intrinsics"]
    eye = np.array(image.metadata["world_from_camera"])[:3, 3]
    np.testing.assert_allclose(image.metadata["entrance_pupil"]["world_m"], eye, atol=1e-12)
    seen = np.stack([k["cx"] + k["fx"] * x / -z, k["cy"] - k["fy"] * y / -z], axis=-1)
    hit = image["object_id"] >= 0
    assert_seen_in_their_pixels(image, seen, hit, 1e-4)
    np.testing.assert_allclose(image["distance"][hit], np.hypot(np.hypot(x, y), z)[hit], rtol=2e-6)


def test_near_plane_does_not_shorten_distances():
    scene = world("pinhole") | {"camera": world("pinhole")["camera"] | {"near_m": 2.0}}
    near, whole = (one_sample(mapping, GEOMETRY, seed=4) for mapping in (scene, world("pinhole")))
    np.testing.assert_allclose(near["distance"], whole["distance"], rtol=2e-6)


def test_environment_camera_sees_each_point_in_its_direction():
    scene = world("environment")
    image = one_sample(scene, GEOMETRY, seed=4)
    x, y, z = np.moveaxis(in_camera(scene, image["position"]), -1, 0)
    distance = np.sqrt(x * x + y * y + z * z)
    columns = (0.5 + np.arctan2(x, -z) / (2 * np.pi)) * image.width
    rows = (0.5 - np.arcsin(y / distance) / np.pi) * image.height
    hit = image["object_id"] >= 0
    assert_seen_in_their_pixels(image, np.stack([columns, rows], axis=-1), hit, 1e-4)
    np.testing.assert_allclose(image["distance"][hit], distance[hit], rtol=2e-6)


def test_thin_lens_sees_each_point_past_the_pupil_in_the_plane_of_focus():
    scene = world("thin_lens")
    image = one_sample(scene, GEOMETRY, seed=4)
    points = in_camera(scene, image["position"])
    pupil = np.concatenate([0.2 * image["pupil"], np.zeros((image.height, image.width, 1))], axis=-1)
    radii = np.linalg.norm(image["pupil"], axis=-1)
    assert 0.95 < radii.max() < 1 + 1e-6
    focus = pupil + (points - pupil) * (4 / -points[..., 2:])
    k = image.metadata["intrinsics"]
    seen = np.stack([k["cx"] + k["fx"] * focus[..., 0] / 4, k["cy"] - k["fy"] * focus[..., 1] / 4], axis=-1)
    hit = image["object_id"] >= 0
    assert_seen_in_their_pixels(image, seen, hit, 1e-3)
    np.testing.assert_allclose(image["distance"][hit], np.linalg.norm(points - pupil, axis=-1)[hit], rtol=2e-6)


@pytest.mark.parametrize(("name", "reach", "slack"), [("thick_lens", 30, 1e-3), ("double_gauss", 12, 0.1)])
def test_lens_in_focus_projects_from_its_entrance_pupil_as_its_intrinsics_say(name, reach, slack):
    mapping = world(name)
    image = one_sample(mapping, GEOMETRY, seed=4)
    setting = lens_setting(load_scene(mapping))
    entrance = setting.lens.first_order().entrance_pupil
    pupil_z = (entrance.distance_mm - setting.lens.length - setting.film_distance_mm) * 1e-3
    points = in_camera(mapping, image["position"]) - [0, 0, pupil_z]
    pupil = np.pad(image["pupil"] * entrance.diameter_mm / 2e3, ((0, 0), (0, 0), (0, 1)))
    depth = 4 + pupil_z  # of the plane in focus, from the pupil
    focus = pupil + (points - pupil) * (depth / -points[..., 2:])
    k = image.metadata["intrinsics"]
    seen = np.stack([k["cx"] + k["fx"] * focus[..., 0] / depth, k["cy"] - k["fy"] * focus[..., 1] / depth], axis=-1)
    near_the_axis = np.linalg.norm(pixel_grid(image) - [23.5, 11.5], axis=-1) < reach  # the traced lens distorts
    assert_seen_in_their_pixels(image, seen, near_the_axis & (image["object_id"] >= 0), slack)


@pytest.mark.parametrize("name", ["double_gauss", "fisheye"])
def test_lens_traced_back_in_float64_leads_from_each_point_to_its_pixel(name):
    mapping = world(name)
    scene, image = load_scene(mapping), one_sample(mapping, GEOMETRY, seed=4)
    setting = lens_setting(scene)
    lens, film_distance_mm = setting.lens, setting.film_distance_mm
    first_z = (film_distance_mm + lens.length) * 1e-3
    hit = (image["object_id"] >= 0) & np.isfinite(image["pupil"]).all(axis=-1)
    entrance = lens.first_order().entrance_pupil
    pupil = np.column_stack([image["pupil"][hit] * entrance.diameter_mm / 2, np.full(hit.sum(), entrance.distance_mm)])
    points = in_camera(mapping, image["position"][hit]) * [1e3, 1e3, -1e3]  # to the lens's frame, mirrored in z
    points[:, 2] = -(points[:, 2] - first_z * 1e3)
    rays = lens.trace(points, pupil - points, scene.camera.wavelength_nm, start="scene")
    assert rays.passed.mean() > 0.995  # rounding may clip a ray at the very rim
    step = (lens.length + film_distance_mm - rays.origins[:, 2]) / rays.directions[:, 2]
    film = rays.origins[:, :2] + step[:, None] * rays.directions[:, :2]
    width, height = (side * 1e3 for side in scene.film.size_m())
    seen = np.full((image.height, image.width, 2), np.nan)
    seen[hit] = np.stack([(0.5 - film[:, 0] / width) * 48, (0.5 + film[:, 1] / height) * 24], axis=-1)
    good = hit.copy()
    good[hit] = rays.passed
    assert_seen_in_their_pixels(image, seen, good, 5e-3)
