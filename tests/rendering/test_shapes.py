"""Every shape, turned, stretched and mirrored: each pixel of one sample against float64 geometry.

The shape is a mirror in a world whose brightness tells the direction, so that a pixel shows hit or miss, the place of
the hit and the normal there. The camera's probe says which ray a pixel took.
"""

import math

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.records import seed_words
from rptcam_cl.scene.load import load_scene
from tests.conftest import PLAIN_KINDS
from tests.device.probes import camera_rays, open_session
from tests.rendering.pictures import looking, pixels, scene_of

KERNELS_KNOW_OF = PLAIN_KINDS
SKY = {"kind": "gradient", "bottom": [0.0, 1.0, 0.3], "top": [1.0, 0.0, 0.6], "up": [1, 2, 2]}
MIRROR = {"kind": "mirror", "reflectance": 1.0}
UP = np.array([1, 2, 2]) / 3
TURN, AXIS, SHIFT = 50.0, np.array([1, -2, 2]) / 3, np.array([0.3, -0.2, 0.1])


def quadratic(a, b, c):
    """Both roots of a t^2 + 2 b t + c; NaN where there is none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(b * b - a * c)
        return [(-b - root) / a, (-b + root) / a]


def at(o, d, t):
    return o + t[:, None] * d


def sphere(o, d):
    roots = quadratic((d * d).sum(1), (o * d).sum(1), (o * o).sum(1) - 1)
    return [(t, at(o, d, t)) for t in roots]


def box(o, d):
    low, high = (np.array([-0.7, -0.5, -0.3]) - o) / d, (np.array([0.7, 0.5, 0.3]) - o) / d
    near, far = np.minimum(low, high).max(1), np.maximum(low, high).min(1)
    t = np.where(near <= far, near, np.nan)
    p = at(o, d, t) / [0.7, 0.5, 0.3]
    face = np.abs(p).argmax(1)
    normal = np.zeros_like(p)
    normal[np.arange(len(p)), face] = np.sign(p[np.arange(len(p)), face])
    return [(t, normal)]


def slope(o, d, lean):
    """Roots and normals of x^2 + y^2 = (r - lean (z + 0.5))^2 between z = -0.5 and 0.7."""
    radius = 0.6 - lean * (o[:, 2] + 0.5)
    a = d[:, 0] ** 2 + d[:, 1] ** 2 - (lean * d[:, 2]) ** 2
    b = o[:, 0] * d[:, 0] + o[:, 1] * d[:, 1] + radius * lean * d[:, 2]
    c = o[:, 0] ** 2 + o[:, 1] ** 2 - radius**2
    for t in quadratic(a, b, c):
        p = at(o, d, t)
        t = np.where((p[:, 2] >= -0.5) & (p[:, 2] <= 0.7), t, np.nan)
        yield t, np.column_stack([p[:, :2], lean * (0.6 - lean * (p[:, 2] + 0.5))])


def flat(o, d, inside, height=0.0):
    t = (height - o[:, 2]) / d[:, 2]
    return [(np.where(inside(at(o, d, t)), t, np.nan), np.tile([0.0, 0.0, 1.0], (len(o), 1)))]


def disk(o, d):
    return flat(o, d, lambda p: p[:, 0] ** 2 + p[:, 1] ** 2 <= 1)


def rectangle(o, d):
    return flat(o, d, lambda p: (np.abs(p[:, 0]) <= 1) & (np.abs(p[:, 1]) <= 0.5))


def plane(o, d):
    return flat(o, d, lambda p: np.ones(len(p), bool), -0.3)


SHAPES = {
    "sphere": ({"shape": "sphere", "center": [0, 0, 0], "radius": 1}, sphere),
    "box": ({"shape": "box", "min": [-0.7, -0.5, -0.3], "max": [0.7, 0.5, 0.3]}, box),
    "cylinder": (
        {"shape": "cylinder", "base": [0, 0, -0.5], "top": [0, 0, 0.7], "radius": 0.6, "capped": False},
        lambda o, d: slope(o, d, 0.0),
    ),
    "cone": (
        {"shape": "cone", "base": [0, 0, -0.5], "apex": [0, 0, 0.7], "radius": 0.6, "capped": False},
        lambda o, d: slope(o, d, 0.5),
    ),
    "disk": ({"shape": "disk", "center": [0, 0, 0], "normal": [0, 0, 1], "radius": 1}, disk),
    "rectangle": ({"shape": "rectangle", "corner": [-1, -0.5, 0], "edge_u": [2, 0, 0], "edge_v": [0, 1, 0]}, rectangle),
    "plane": ({"shape": "plane", "point": [0, 0, -0.3], "normal": [0, 0, 1]}, plane),
}
SCALES = {"turned": [1, 1, 1], "stretched": [1.3, 0.6, 0.9], "mirrored": [-1.0, 1.0, 1.0], "shrunk": [0.5, 0.5, 0.5]}


def rotation():
    """Rodrigues' formula."""
    angle = math.radians(TURN)
    cross = np.cross(np.eye(3), AXIS)  # row i is e_i x axis: the matrix of axis x v
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def sky(d):
    share = (0.5 + 0.5 * d @ UP)[:, None]
    return np.array(SKY["bottom"]) * (1 - share) + np.array(SKY["top"]) * share


@pytest.fixture(scope="module")
def probing():
    return open_session()


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("shape", SHAPES)
def test_shape_is_met_where_and_as_it_should(probing, shape, scale):
    description, candidates = SHAPES[shape]
    turn = {"rotate": {"axis": AXIS.tolist(), "degrees": TURN}}
    steps = [{"scale": SCALES[scale]}, turn, {"translate": SHIFT.tolist()}]
    camera = looking([0.4, -2.5, 1.2], SHIFT, fov=45)
    mapping = scene_of(
        [{**description, "material": MIRROR, "transform": steps}], camera, depth=2, resolution=(64, 64), environment=SKY
    )
    scene = load_scene(mapping)
    rays = camera_rays(probing, scene, 1, seed=seed_words(9))
    frame = scene.camera.world_from_camera()
    o, d = np.broadcast_to(frame[:3, 3], rays.origin.shape), rays.direction @ frame[:3, :3].T
    matrix = rotation() @ np.diag(SCALES[scale])
    inverse = np.linalg.inv(matrix)
    distance, normal = np.full(len(o), np.inf), np.zeros_like(o)
    for t, n in candidates((o - SHIFT) @ inverse.T, d @ inverse.T):
        closer = (t > 0) & (t < distance)
        distance[closer], normal[closer] = t[closer], (n @ inverse)[closer]
    hit = np.isfinite(distance)
    assert hit.mean() > 0.05
    normal[hit] /= np.linalg.norm(normal[hit], axis=1, keepdims=True)
    mirrored = d - 2 * (d * normal).sum(1, keepdims=True) * normal
    expected = np.where(hit[:, None], sky(mirrored), sky(d))
    film = pixels(mapping, spp=1, seed=9)[rays.pixel[:, 1], rays.pixel[:, 0]]
    # a normal turns fast near the apex of a cone and float32 places the hit to 1e-6: up to 3e-4
    wrong = np.abs(film - expected).max(axis=1) > 5e-4
    # seen from inside, an open shape may meet itself again: such a path ends black
    again = ((d * normal).sum(axis=1) > 0) & (film == 0).all(axis=1)
    # a ray within 1e-6 of an edge may go either way: fewer than one in a thousand of 4096
    assert (wrong & ~again).sum() <= 4
    assert again.sum() < 0.5 * hit.sum()


def test_probe_and_picture_take_the_same_rays(probing):
    mapping = scene_of([], looking([0, 0, 0], [1, 2, 3], fov=90), resolution=(64, 64), environment=SKY)
    rays = camera_rays(probing, load_scene(mapping), 1, seed=seed_words(9))
    d = rays.direction @ load_scene(mapping).camera.world_from_camera()[:3, :3].T
    film = pixels(mapping, spp=1, seed=9)[rays.pixel[:, 1], rays.pixel[:, 0]]
    np.testing.assert_allclose(film, sky(d), atol=1e-6)


@pytest.mark.parametrize("radius", [2e4, 1e5, 6.371e6])
def test_the_ground_of_a_globe_lies_where_it_is_under_the_eye(radius):
    grey = {"kind": "matte", "reflectance": 0.5}
    globe = {"shape": "sphere", "center": [0, -radius, 0], "radius": radius, "material": grey}
    ball = {"shape": "sphere", "center": [0, 0.5, -3], "radius": 0.5, "material": grey}
    camera = looking([0, 1.7, 0], [0, 0.7, -1.2], 80, (0, 1, 0))
    scene = scene_of([globe, ball], camera, resolution=(64, 64))
    layers = rptcam_cl.render(scene, spp=1, layers=["position", "object_id"]).layers
    places, on_ball = (layers["position"][layers["object_id"] == index].astype(np.float64) for index in (0, 1))
    height = places[:, 1] + (places**2).sum(1) / (2 * radius)  # over the globe, to first order
    assert len(places) > 3000
    assert np.abs(height).max() < 2e-6
    assert len(on_ball) > 50
    assert np.abs(np.linalg.norm(on_ball - [0, 0.5, -3], axis=1) - 0.5).max() < 2e-6
