"""How far away what a picture can show is."""

import numpy as np
import pytest

from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.tier_models import FAR_MM, VisibleWorld, depth_range_mm
from tests.studies.tradeoff.tiers.cases import BALL, scene_of, truth_of

GREY = BALL["material"]
CAMERA = {"kind": "pinhole", "eye": [0, 0, 0], "target": [0, 0, -1], "fov_degrees": 30}
VIEW = VisibleWorld(10.0, np.zeros(2), np.array([0.3, 0.2]))


def depths_of(*objects, view=VIEW, **keys):
    return depth_range_mm(load_scene({"camera": CAMERA, "objects": objects} | keys), view)


def test_depths_are_those_of_the_boxes_ahead():
    assert depths_of(BALL) == pytest.approx((4500, 5500))


def test_what_lies_behind_or_beside_the_view_does_not_count():
    behind, beside = (BALL | {"center": place} for place in ([0, 0, 3], [3, 0, -2]))
    assert depths_of(BALL, behind, beside) == pytest.approx((4500, 5500))


def test_depths_reach_far_under_a_sky_and_over_a_plane():
    plane = {"shape": "plane", "point": [0, -1, 0], "normal": [0, 1, 0], "material": GREY}
    assert depths_of(BALL, plane) == pytest.approx((4500, FAR_MM))
    wide = VisibleWorld(10.0, np.zeros(2), np.array([0.3, 0.25]))
    assert depths_of(BALL, plane, view=wide) == pytest.approx((4010, FAR_MM))
    assert depths_of(BALL, environment={"kind": "constant", "radiance": 1}) == pytest.approx((4500, FAR_MM))


@pytest.mark.parametrize(
    ("material", "far"),
    [
        ({"kind": "mirror"}, FAR_MM),
        ({"kind": "thin_glass"}, FAR_MM),
        ({"kind": "mix", "materials": [GREY, {"kind": "plastic", "reflectance": 0.5}]}, FAR_MM),
        ({"kind": "mix", "materials": [GREY, GREY]}, 5500),
        ({"kind": "emissive", "radiance": 1}, 5500),
    ],
)
def test_depths_reach_as_far_as_images_in_mirrors_and_glass(material, far):
    assert depths_of(BALL | {"material": material}) == pytest.approx((4500, far))
    assert depths_of(BALL, BALL | {"material": material, "center": [0, 0, 5]}) == pytest.approx((4500, 5500))


def test_plane_that_the_view_does_not_meet_does_not_count():
    plane = {"shape": "plane", "point": [0, 0, 1], "normal": [0, 0, 1], "material": GREY}
    assert depths_of(BALL, plane) == pytest.approx((4500, 5500))


def test_floor_that_runs_on_under_the_camera_is_seen_from_where_the_view_meets_it():
    floor = {"shape": "rectangle", "corner": [-9, -1, 9], "edge_u": [18, 0, 0], "edge_v": [0, 0, -18]}
    assert depths_of(floor | {"material": GREY}) == pytest.approx((5010, 9000))


def test_room_round_the_camera_is_seen_at_its_walls():
    room = {"shape": "box", "min": [-1, -1, -7], "max": [1, 1, 7], "material": GREY}
    near = 10 + 1000 / 0.3  # where the wider slope meets the wall
    assert depths_of(room) == pytest.approx((near, 7000))


def test_volume_round_the_camera_is_as_near_as_the_view_starts():
    around = BALL | {"center": [0, 0, 0], "radius": 9}
    assert depths_of(around) == pytest.approx((10, 9000))


def mesh(*rows, faces):
    return {"shape": "mesh", "vertices": [list(row) for row in rows], "faces": faces, "material": GREY}


def test_mesh_round_the_camera_is_seen_where_its_triangles_are():
    """A floor of two triangles under the camera and a wall far ahead, in one mesh whose box holds the camera."""
    floor = [(-9, -1, 9), (9, -1, 9), (9, -1, -9), (-9, -1, -9)]
    wall = [(-9, 5, -9), (9, 5, -9)]
    room = mesh(*floor, *wall, faces=[[0, 1, 2, 3], [3, 2, 5, 4]])
    assert depths_of(room) == pytest.approx((5010, 9000))
    split = [[x / 15 * 18 - 9, -1, 9 - z / 15 * 18] for x in range(16) for z in range(16)]
    tiles = [[16 * x + z, 16 * x + z + 16, 16 * x + z + 17, 16 * x + z + 1] for x in range(15) for z in range(15)]
    near, far = depths_of(mesh(*split, [0, 5, 9], faces=[*tiles, [0, 1, 256]]))
    assert near == pytest.approx(5010)
    assert far == pytest.approx(9000)


def test_mesh_apart_from_the_camera_counts_by_its_box():
    triangle = mesh((-0.1, 0, -5), (0.1, 0, -5), (0, 0.1, -6), faces=[[0, 1, 2]])
    assert depths_of(triangle) == pytest.approx((5000, 6000))


def test_object_that_moves_counts_while_the_shutter_is_open():
    moving = BALL | {"motion": [{"time_s": 0, "translate": [0, 0, 0]}, {"time_s": 1, "translate": [0, 0, 2]}]}
    assert depths_of(moving, shutter={"time_s": 1}) == pytest.approx((2500, 5500))
    assert depths_of(moving, shutter={"time_s": 0.5}) == pytest.approx((3500, 5500))


def test_view_of_a_lens_holds_the_rays_of_its_corners():
    truth = truth_of(scene_of("dgauss-50mm"))
    normals, offsets = truth.view.sides()
    corner = truth.fields[-1].bundle
    for depth in (truth.view.start_mm, 1e3, 1e6):
        points = np.column_stack([corner.places(depth), np.full(len(corner.weights), depth)])
        assert np.all(points @ normals.T + offsets >= -1e-6 * depth)
