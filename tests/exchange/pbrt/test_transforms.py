"""Where things are: every directive against matrices written from pbrt's book."""

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import PIL.Image
import pytest
from scipy.spatial.transform import Rotation, Slerp

from rptcam_cl.core.errors import InputError
from tests.exchange.pbrt import reference as pbrt

Convert = Callable[..., Any]
HEAD = 'Scale -1 1 1 LookAt 0 0 5  0 0 0  0 1 0 Camera "perspective" WorldBegin LightSource "infinite"\n'
MIRRORED = HEAD.replace("Scale -1 1 1 ", "")
TRIANGLE = 'Shape "trianglemesh" "point3 P" [0 0 0  1 0 0  0 2 .5]\n'
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0.5]], float)

# Text between WorldBegin and the triangle, and the matrix that pbrt makes of it.
CASES = {
    "": np.eye(4),
    "Translate 1 2 3": pbrt.translate(1, 2, 3),
    "Scale 1 2 -3": pbrt.scale(1, 2, -3),
    "Rotate 30 1 0 0": pbrt.rotate_x(30),
    "Rotate 30 0 -2 0": pbrt.rotate_y(-30),
    "Rotate 200 0 0 5": pbrt.rotate_z(200),
    "Translate 1 2 3 Rotate 90 0 0 1 Scale 2 1 1": pbrt.translate(1, 2, 3) @ pbrt.rotate_z(90) @ pbrt.scale(2, 1, 1),
    "LookAt 1 2 3  4 5 7  0 0 1": pbrt.look_at([1, 2, 3], [4, 5, 7], [0, 0, 1]),
    "Scale 5 5 5 Transform [1 0 0 0  0 0 1 0  0 -1 0 0  1 2 3 1]": pbrt.translate(1, 2, 3) @ pbrt.rotate_x(90),
    "Scale 2 2 2 ConcatTransform [1 0 0 0  0 0 1 0  0 -1 0 0  1 2 3 1]": (
        pbrt.scale(2, 2, 2) @ pbrt.translate(1, 2, 3) @ pbrt.rotate_x(90)
    ),
    "ConcatTransform [2 0 0 0  0 2 0 0  0 0 2 0  1 2 3 2]": pbrt.translate(0.5, 1, 1.5),
    "Translate 1 0 0 Identity Translate 0 1 0": pbrt.translate(0, 1, 0),
    "Translate 1 0 0 AttributeBegin Scale 9 9 9 AttributeEnd": pbrt.translate(1, 0, 0),
    "Translate 1 0 0 TransformBegin Scale 9 9 9 TransformEnd": pbrt.translate(1, 0, 0),
    'Translate 1 2 3 CoordinateSystem "a" Scale 9 9 9 CoordSysTransform "a"': pbrt.translate(1, 2, 3),
    'Scale 9 9 9 CoordSysTransform "world"': np.eye(4),
    'CoordSysTransform "camera"': np.linalg.inv(pbrt.scale(-1, 1, 1) @ pbrt.look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])),
    "ActiveTransform EndTime Translate 7 7 7 ActiveTransform All Translate 1 0 0": pbrt.translate(1, 0, 0),
    "ActiveTransform StartTime Translate 1 0 0 ActiveTransform All": pbrt.translate(1, 0, 0),
}


def corners_of(done: Any, index: int = 0) -> np.ndarray:
    """World positions of the vertices of an object, in the order of the file."""
    item = done.scene.objects[index]
    (part,) = done.scene.load_mesh(item).contents.parts
    local = part.mesh.positions.astype(float) + part.mesh.origin
    matrix = item.placed_at(0.0) @ part.placement
    return np.asarray(local @ matrix[:3, :3].T + matrix[:3, 3])


def as_set(points: np.ndarray) -> np.ndarray:
    """Points in an order of their own: meshes may renumber their vertices."""
    return points[np.lexsort(points.round(4).T)]


@pytest.mark.parametrize("text", CASES)
def test_vertices_are_where_pbrt_has_them(convert: Convert, text: str) -> None:
    done = convert(f"{text} {TRIANGLE}", HEAD)
    matrix = CASES[text]
    expected = CORNERS @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(as_set(corners_of(done)), as_set(expected), atol=1e-6)  # a mesh keeps float32
    np.testing.assert_allclose(as_set(np.array(done.objects[0]["vertices"])), as_set(expected), atol=1e-12)


@pytest.mark.parametrize("text", ["", "Scale 1 2 -3", "Translate 1 2 3 Rotate 90 0 0 1 Scale 2 1 1"])
def test_a_left_handed_world_has_its_x_axis_reversed(convert: Convert, text: str) -> None:
    done = convert(f"{text} {TRIANGLE}", MIRRORED)
    matrix = pbrt.scale(-1, 1, 1) @ CASES[text]
    expected = CORNERS @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(as_set(np.array(done.objects[0]["vertices"])), as_set(expected), atol=1e-12)


INSTANCE = """
Translate 0 5 0
ObjectBegin "o"
  Rotate 90 0 0 1
  Shape "trianglemesh" "point3 P" [0 0 0  1 0 0  0 2 .5]
  Shape "sphere" "float radius" .25
ObjectEnd
AttributeBegin Translate 1 0 0 Scale 1 1 -2 ObjectInstance "o" AttributeEnd
ObjectInstance "o"
"""


@pytest.mark.parametrize("head", [HEAD, MIRRORED])
def test_instances_place_the_object_as_it_stood_where_it_was_defined(convert: Convert, head: str) -> None:
    done = convert(INSTANCE, head)
    world = np.eye(4) if head == HEAD else pbrt.scale(-1, 1, 1)
    own = pbrt.translate(0, 5, 0) @ pbrt.rotate_z(90)
    first = world @ pbrt.translate(0, 5, 0) @ pbrt.translate(1, 0, 0) @ pbrt.scale(1, 1, -2) @ own
    second = world @ pbrt.translate(0, 5, 0) @ own
    for index, matrix in ((0, first), (2, second)):
        expected = CORNERS @ matrix[:3, :3].T + matrix[:3, 3]
        np.testing.assert_allclose(as_set(corners_of(done, index)), as_set(expected), atol=1e-5)
    for index, matrix in ((1, first), (3, second)):
        item = done.scene.objects[index]
        centre = item.world_from_object @ [*item.center, 1]
        np.testing.assert_allclose(centre[:3], matrix[:3, 3], atol=1e-12)
    assert list(done.keys["meshes"]) == ["mesh-1"]  # one mesh in two places


def front(done: Any, index: int = 0) -> np.ndarray:
    """Front side of a rectangle, or of the first face of a mesh."""
    keys = done.objects[index]
    if keys["shape"] == "rectangle":
        return np.cross(keys["edge_u"], keys["edge_v"])
    a, b, c = np.array(keys["vertices"])[keys["faces"][0]]
    return np.cross(b - a, c - a)


@pytest.mark.parametrize("head", [HEAD, MIRRORED])
@pytest.mark.parametrize(
    ("text", "flips"),
    [
        ("", False),
        ("ReverseOrientation", True),
        ("ReverseOrientation ReverseOrientation", False),
        ("AttributeBegin ReverseOrientation AttributeEnd", False),
        ("Scale -1 1 1", False),  # the front is carried along: still the side that had it
        ("Scale -1 1 1 ReverseOrientation", True),
    ],
)
@pytest.mark.parametrize("normals", ["", '"normal3 N" [0 0 1 0 0 1 0 0 1]', '"normal3 N" [0 0 -1 0 0 -1 0 0 -1]'])
def test_front_sides_are_those_of_pbrt(convert: Convert, head: str, text: str, flips: bool, normals: str) -> None:
    """pbrt: the right-handed cross product before the transform, turned to the vertex normals where there are some."""
    shape = f'Shape "trianglemesh" "point3 P" [0 0 0  1 0 0  0 1 0] {normals}'
    done = convert(f'{text} AreaLightSource "diffuse" {shape}', head)
    expected = -1 if flips != (" -1" in normals) else 1
    np.testing.assert_allclose(np.sign(front(done)[2]), expected)


@pytest.mark.parametrize("head", [HEAD, MIRRORED])
@pytest.mark.parametrize("corners", [(0, 1, 2, 0, 2, 3), (0, 2, 1, 0, 3, 2)])
def test_squares_with_a_normal_map_keep_their_front(convert: Convert, head: str, corners: tuple[int, ...]) -> None:
    """Seen from the other side bumps would be dents."""
    picture = io.BytesIO()
    PIL.Image.new("RGB", (2, 2), (128, 128, 255)).save(picture, "PNG")
    square = (
        f'Shape "trianglemesh" "integer indices" [{" ".join(map(str, corners))}]'
        ' "point3 P" [-1 -1 0 1 -1 0 1 1 0 -1 1 0] "point2 uv" [0 0 1 0 1 1 0 1]'
    )
    done = convert(f'Material "diffuse" "string normalmap" "n.png" {square}', head, n_dot_png=picture.getvalue())
    assert np.sign(front(done)[2]) == (1 if corners[1] == 1 else -1)


def test_normals_are_turned_and_stretched_as_those_of_an_ellipsoid(convert: Convert) -> None:
    """A facet of an octahedron whose normals are those of the unit sphere, rotated between two uneven stretches.

    The matrix M is not symmetric, so that its inverse and its inverse transposed differ. A point p of the sphere goes
    to q = M p on the ellipsoid q.Q q = 1 with Q = (M M^T)^-1, whose normal is the gradient Q q.
    """
    matrix = pbrt.scale(1, 3, 1) @ pbrt.rotate_z(40) @ pbrt.rotate_x(-25) @ pbrt.scale(2, 0.5, 1)
    points = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    numbers = " ".join(map(str, points.reshape(-1)))
    mesh = f'Shape "trianglemesh" "point3 P" [{numbers}] "normal N" [{numbers}] "integer indices" [0 1 2]'
    done = convert(f"Scale 1 3 1 Rotate 40 0 0 1 Rotate -25 1 0 0 Scale 2 .5 1 {mesh}", HEAD)
    (item,) = done.objects
    linear = matrix[:3, :3]
    moved = points @ linear.T
    np.testing.assert_allclose(item["vertices"], moved, atol=1e-12)
    gradient = moved @ np.linalg.inv(linear @ linear.T)
    np.testing.assert_allclose(item["normals"], gradient / np.linalg.norm(gradient, axis=1, keepdims=True), atol=1e-12)
    wrong = points @ np.linalg.inv(linear).T  # what a forgotten transpose would give: another direction
    cosines = (wrong * gradient).sum(axis=1) / np.linalg.norm(wrong, axis=1) / np.linalg.norm(gradient, axis=1)
    assert cosines.min() < 0.9


ODD = {
    "Scale 1 0 1": "Scale by 0 flattens space; what stands under it is left out",
    "Rotate 30 0 0 0": "Rotate needs an axis",
    "LookAt 0 0 0 0 0 0 0 1 0": "fix no view",
    "Transform [1 0 0 0  0 0 0 0  0 0 1 0  0 0 0 1]": "cannot be inverted: it flattens space",
    "ConcatTransform [1 0 0 2  0 1 0 0  0 0 1 0  0 0 0 1]": "not affine",
    "Scale 1e-200 1e-200 1e200": "",
    "Scale 1e-20 1e-20 1e-20": "",
    "Scale 1e200 1e200 1e200 Scale 1e200 1e200 1e200": "Scale leads beyond the range of numbers",
    "Translate 1e30 0 0": "",
}


@pytest.mark.parametrize("text", ODD)
def test_an_odd_transform_costs_what_stands_under_it_and_no_more(convert: Convert, text: str) -> None:
    things = (
        f'Shape "sphere" Shape "sphere" "float radius" 2\n{TRIANGLE} LightSource "point" LightSource "distant" '
        'LightSource "spot" LightSource "infinite" "string mapname" "none.exr" ObjectInstance "o"\n'
    )
    instance = 'ObjectBegin "o" Shape "disk" ObjectEnd '
    done = convert(f'{instance} AttributeBegin {text} {things} AttributeEnd Shape "cylinder" LightSource "point"', HEAD)
    assert [item["shape"] for item in done.objects] == ["cylinder"]
    assert [light["kind"] for light in done.keys["lights"]] == ["point"]
    assert done.keys["environment"]["kind"] == "constant"
    assert done.says("in.pbrt:2: note: ", ODD[text]) == bool(ODD[text])
    assert not done.says(': "string mapname"')  # what is left out has no parameters to be told of
    for what in ('Shape "sphere"', 'Shape "disk" of "o"', 'LightSource "spot"', 'LightSource "infinite"'):
        assert done.says(f"ignored: {what}: its transform flattens space, or leads beyond"), done.report


def test_an_odd_transform_of_the_camera_is_an_error(convert: Convert) -> None:
    for text in ODD:
        if ODD[text]:
            with pytest.raises(InputError, match=r'in\.pbrt:1:\d+: Camera "perspective": the transform before it'):
                convert(TRIANGLE, HEAD.replace("Scale -1 1 1 LookAt 0 0 5  0 0 0  0 1 0", text))


MOVING_CAMERA = """\
Scale -1 1 1
LookAt 0 0 5  0 0 0  0 1 0
ActiveTransform EndTime
Translate 0 0 1
Camera "perspective" "float fov" 40
WorldBegin
"""


@pytest.mark.parametrize(
    ("head", "text"),
    [
        (HEAD, "Translate 1 2 3 ActiveTransform EndTime Identity ActiveTransform All"),
        (HEAD, "Translate 1 2 3 ActiveTransform EndTime Identity Scale 2 2 2"),
        (MOVING_CAMERA, "Translate 1 2 3"),  # WorldBegin is where both times are set again
    ],
)
def test_what_moves_stands_as_it_does_at_the_start(convert: Convert, head: str, text: str) -> None:
    done = convert(f'{text} Shape "sphere"', head)
    assert done.objects[0]["center"] == [1.0, 2.0, 3.0]
    assert done.objects[0]["radius"] == 1.0


def test_flattened_shapes_are_left_out_where_ours_cannot_hold_them(convert: Convert) -> None:
    triangle = 'Shape "trianglemesh" "point3 P" [0 0 0 1 0 1 0 1 0]'
    done = convert(f'Scale 1 1 1e-7 Shape "sphere" {triangle}')
    assert [item["shape"] for item in done.objects] == ["mesh"]  # whose vertices are as flat as they are
    assert done.says('ignored: Shape "sphere": its transform flattens space')


def between(start: np.ndarray, end: np.ndarray, share: float) -> np.ndarray:
    """Matrix of pbrt's AnimatedTransform: the shift goes straight, the turn (polar decomposition) by slerp."""

    def parts(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u, s, v = np.linalg.svd(matrix[:3, :3])
        sign = np.linalg.det(u @ v)  # a reflection belongs to the stretch
        return sign * u @ v, sign * v.T @ np.diag(s) @ v

    (first, stretch), (last, _) = parts(start), parts(end)
    turn = Rotation.from_matrix(np.stack([first, last]))
    now = np.eye(4)
    now[:3, :3] = Slerp([0, 1], turn)(share).as_matrix() @ stretch
    now[:3, 3] = (1 - share) * start[:3, 3] + share * end[:3, 3]
    return now


MOVING = "ActiveTransform EndTime Translate 3 0 1 Rotate 70 1 2 0 ActiveTransform All Translate .5 1 0 Scale 2 1 1 "


def test_what_moves_goes_as_pbrt_has_it(convert: Convert) -> None:
    """Turns are about the origin of the moving frame, of an instance its own, not that of the shape within."""
    start = pbrt.translate(0.5, 1, 0) @ pbrt.scale(2, 1, 1)
    axis = Rotation.from_rotvec(np.radians(70) * np.array([1, 2, 0]) / np.sqrt(5))
    turn = np.eye(4)
    turn[:3, :3] = axis.as_matrix()
    end = pbrt.translate(3, 0, 1) @ turn @ start
    times = "TransformTimes 0 2 " + HEAD.replace('"perspective"', '"perspective" "float shutterclose" 2')
    done = convert("AttributeBegin " + MOVING + TRIANGLE + "AttributeEnd", times)
    item = done.scene.objects[0]
    assert (done.scene.shutter.open_s, done.scene.shutter.time_s) == (0, 2)
    for share in (0, 0.3, 1):
        placed = item.placed_at(2 * share) @ np.linalg.inv(item.placed_at(0))
        found = corners_of(done) @ placed[:3, :3].T + placed[:3, 3]
        matrix = between(start, end, share)
        np.testing.assert_allclose(as_set(found), as_set(CORNERS @ matrix[:3, :3].T + matrix[:3, 3]), atol=1e-5)
    assert done.report == []

    within = (
        'ObjectBegin "o" Translate 0 2 0 '
        + TRIANGLE
        + "ObjectEnd AttributeBegin "
        + MOVING
        + 'ObjectInstance "o" AttributeEnd'
    )
    done = convert(within, times)
    matrix = between(start, end, 0.5) @ pbrt.translate(0, 2, 0)
    placed = done.scene.objects[0].placed_at(1.0) @ np.linalg.inv(done.scene.objects[0].placed_at(0))
    found = corners_of(done) @ placed[:3, :3].T + placed[:3, 3]
    np.testing.assert_allclose(as_set(found), as_set(CORNERS @ matrix[:3, :3].T + matrix[:3, 3]), atol=1e-5)


def test_what_stretches_over_time_stays_and_is_reported(convert: Convert) -> None:
    done = convert("ActiveTransform EndTime Scale 2 2 2 ActiveTransform All " + TRIANGLE, HEAD)
    assert done.scene.objects[0].motion == ()
    assert done.says('Shape "trianglemesh": it stays as it is at the start')


def test_cameras_move_about_themselves(convert: Convert) -> None:
    head = "ActiveTransform EndTime Rotate -60 0 1 0 Translate 1 0 0 ActiveTransform All " + HEAD
    done = convert(TRIANGLE, head)
    camera = done.scene.camera
    cameras = []
    for matrix in (np.eye(4), pbrt.rotate_y(-60) @ pbrt.translate(1, 0, 0)):
        cameras.append(np.linalg.inv(matrix @ pbrt.scale(-1, 1, 1) @ pbrt.look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])))
    for share in (0, 0.375, 1):
        now = between(*cameras, share)
        eye, target, _ = camera.pose_at(share)
        forward = (target - eye) / np.linalg.norm(target - eye)
        np.testing.assert_allclose(eye, now[:3, 3], atol=1e-5)
        assert forward @ (now[:3, 2] / np.linalg.norm(now[:3, 2])) > 0.99999
