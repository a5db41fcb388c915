"""Normal maps and bumps on every shape: the shaded normal against the derivatives of the shape's points by u and v."""

import numpy as np
import pytest
from PIL import Image

from rptcam_cl.rendering.plan.primitives import turn_to
from rptcam_cl.scene.placement import TransformStep, product
from tests.rendering.layers.scenes import one_sample
from tests.rendering.light.perlin import perlin
from tests.rendering.pictures import MATTE, looking, scene_of, seed_of

HALF_TURN = {"axis": [1, 2, 3], "degrees": 35}
PLACED = {
    "as it is": [],
    "stretched and turned": [{"scale": [1, 0.7, 1.3]}, {"rotate": HALF_TURN}],
    "mirrored": [{"scale": [-1, 1, 1]}, {"rotate": HALF_TURN}],
    "mirrored and stretched": [{"scale": [0.8, -1.1, 1.2]}, {"rotate": HALF_TURN}],
}
TOP = [0.3, -0.2, 1.0]  # of the axis of cylinder and cone
CORNERS = np.array([[-1.0, -1.0, 0.0], [1.2, -0.8, 0.3], [-0.7, 1.1, -0.2]])
UVS = np.array([[0.1, 0.2], [0.9, 0.4], [0.3, 0.95]])


def ball(u, v):
    turn, up = 2 * np.pi * u, np.pi * v
    return np.stack([np.sin(up) * np.cos(turn), np.sin(up) * np.sin(turn), -np.cos(up)], axis=-1)


def tube(u, v, lean=0.0):
    turn, axis = 2 * np.pi * u, np.array(TOP)
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * u], axis=-1) @ turn_to(axis).T
    return -axis / 2 + axis * v[..., None] + 0.8 * ring * (1 - lean * v[..., None])


def flat(u, v):
    return np.stack([u, v, 0 * u], axis=-1) @ turn_to([0.2, 0.3, 1]).T


def triangle(u, v):
    edges = (UVS[1:] - UVS[0]).T
    shares = np.linalg.solve(edges, np.stack([u, v], axis=-1)[..., None] - UVS[0][:, None])[..., 0]
    return CORNERS[0] + shares @ (CORNERS[1:] - CORNERS[0])


def mirrored_triangle(u, v):
    return triangle(1 - u, v)


SHAPES = {
    "sphere": ({"shape": "sphere", "center": [0, 0, 0], "radius": 1}, ball),
    "cylinder": (
        {"shape": "cylinder", "base": [-c / 2 for c in TOP], "top": [c / 2 for c in TOP], "radius": 0.8,
         "capped": False}, tube,
    ),
    "cone": (
        {"shape": "cone", "base": [-c / 2 for c in TOP], "apex": [c / 2 for c in TOP], "radius": 0.8, "capped": False},
        lambda u, v: tube(u, v, 1.0),
    ),
    "disk": ({"shape": "disk", "center": [0, 0, 0], "normal": [0.2, 0.3, 1], "radius": 1}, flat),
    "rectangle": (
        {"shape": "rectangle", "corner": [-1, -1, 0], "edge_u": [2, 0.5, 0], "edge_v": [0.4, 2, 0.3]},
        lambda u, v: np.array([-1, -1, 0]) + u[..., None] * [2, 0.5, 0] + v[..., None] * [0.4, 2, 0.3],
    ),
    "mesh": ({"shape": "mesh", "vertices": CORNERS.tolist(), "faces": [[0, 1, 2]], "uvs": UVS.tolist()}, triangle),
    "mesh with mirrored coordinates": (
        {"shape": "mesh", "vertices": CORNERS.tolist(), "faces": [[0, 1, 2]],
         "uvs": [[1 - u, v] for u, v in UVS.tolist()]}, mirrored_triangle,
    ),
}  # fmt: skip
BACK_OF_UVS = {"mesh with mirrored coordinates"}  # u x v points to the back of the surface
HOLLOW = {"cylinder", "cone"}  # their insides are in the shadow
BOXES = {
    "box": {"shape": "box", "min": [-1, -0.9, -1.2], "max": [0.8, 0.9, 0]},
    "sheet": {"shape": "box", "min": [-1, -0.9, -1e-3], "max": [0.8, 0.9, 0]},
}
BARE = {"mesh without coordinates": {"shape": "mesh", "vertices": CORNERS.tolist(), "faces": [[0, 1, 2]]}}
BODIES = {name: body for name, (body, _) in SHAPES.items()} | BOXES | BARE
PLACES = {
    (name, placed): np.array([5.0 * column - 22, 5.0 * row - 7, 0])
    for column, name in enumerate(BODIES)
    for row, placed in enumerate(PLACED)
}
MAP = [0.2, 0.35, np.sqrt(1 - 0.2**2 - 0.35**2)]
EYE = np.array([2.0, -14.0, 33.0])
SUN = np.array([0.5, -0.6, 0.9]) / np.linalg.norm([0.5, -0.6, 0.9])
STEP = 1e-5


PERLIN = {"kind": "perlin", "octaves": 2, "gain": 0.4, "scale": [3, 2], "rotation_degrees": 20, "offset": [0.2, 0]}
BUMPS = {"bump": {"texture": PERLIN, "height": 0.15}}
LEAN = {"normal_map": {"file": "lean.png"}}
ALONG_U = {"kind": "gradient", "start": 0, "end": 1}
PRODUCT = {"kind": "mixture", "first": 0.25, "second": ALONG_U, "amount": ALONG_U | {"rotation_degrees": -90}}
SHEET = {"shape": "rectangle", "corner": [-2, 10, 5], "edge_u": [4, 0, 0], "edge_v": [0, 0, -4],
         "material": MATTE | {"bump": {"texture": PRODUCT, "height": 1.5}}}  # fmt: skip


def height_of(u, v):
    """The height of the bumps, in float64."""
    turn = np.radians(20)
    x = 3 * u * np.cos(turn) - 2 * v * np.sin(turn) + 0.2
    y = 3 * u * np.sin(turn) + 2 * v * np.cos(turn)
    places = np.stack([x, y, 0 * x])
    return 0.15 * (perlin(places) + 0.4 * perlin(1.99 * places))


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """One ray per pixel to every body in every placement, side by side under one sun, and to `SHEET`.

    They wear a constant map in the one picture, and the bumps of `height_of` in the other; with them comes the normal
    that the map's bytes hold.
    """
    bodies = [
        BODIES[name] | {"transform": [*PLACED[placed], {"translate": place.tolist()}]}
        for (name, placed), place in PLACES.items()
    ]
    specks = [BODIES["disk"] | {"transform": [{"scale": 1e-4}, {"translate": [0, 0, 90]}], "material": MATTE | worn}
              for worn in (LEAN, BUMPS)]  # so that one program renders both  # fmt: skip
    sun = {"kind": "directional", "direction": (-SUN).tolist(), "irradiance": [np.pi] * 3}
    code = np.round((np.array(MAP) + 1) / 2 * 255).astype(np.uint8)
    held, found = code / 255 * 2 - 1, []
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("maps"))
        Image.fromarray(np.broadcast_to(code, (4, 4, 3)).copy()).save("lean.png")
        for worn in (LEAN, BUMPS):
            objects = [*(body | {"material": MATTE | worn} for body in bodies), SHEET, *specks]
            scene = scene_of(objects, looking(EYE, [0, -1, 0], fov=78), depth=2, lights=[sun], resolution=(640, 256))
            layers = ["position", "geometric_normal", "uv", "object_id"]
            found.append(one_sample(scene, layers, seed=seed_of("maps")))
    return *found, held / np.linalg.norm(held)


@pytest.fixture(scope="module")
def everything(pictures):
    """The picture of the map, and its normal."""
    return pictures[0], pictures[2]


@pytest.fixture(scope="module")
def uneven(pictures):
    """The picture of the bumps."""
    return pictures[1], None


def of(everything, name, placed):
    """The pixels of one body and the matrix that placed it."""
    image, _ = everything
    number = list(PLACES).index((name, placed))
    matrix = product(tuple(TransformStep.model_validate(step) for step in PLACED[placed]))[:3, :3]
    return image["object_id"] == number, matrix


def assert_lit_as_mapped(picture, seen, points, along_u, along_v, front, *, hollow=False):
    """Fail unless every pixel shows the cosine of the sun to the normal that the map makes of a frame.

    Seen from the back, the whole frame is that of the front, and all of it is turned round.
    """
    image, held = picture
    towards = EYE - points
    x = along_u - np.sum(along_u * front, axis=-1, keepdims=True) * front
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    y = np.cross(front, x)
    y *= np.sign(np.sum(y * along_v, axis=-1, keepdims=True))
    assert_lit(image, seen, towards, held[0] * x + held[1] * y + held[2] * front, front, hollow=hollow)


def assert_lit(image, seen, towards, bent, front, *, hollow=False, atol=3e-4):
    """Fail unless every pixel shows the cosine of the sun to a bent normal, given on the side of the front."""
    facing = np.sign(np.sum(front * towards, axis=-1, keepdims=True))
    bent, true = facing * bent, facing * front
    towards = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    # where neither the eye nor the sun stands behind the surface or behind the bent normal
    clear = np.minimum(bent @ SUN, true @ SUN) > 0.05
    clear &= np.minimum(np.sum(bent * towards, axis=-1), np.sum(true * towards, axis=-1)) > 0.05
    if hollow:
        clear &= facing[:, 0] > 0
    film = np.asarray(image)[seen][:, 0]
    assert clear.sum() > 4
    np.testing.assert_allclose(film[clear], (bent @ SUN)[clear], atol=atol)


@pytest.mark.parametrize("placed", PLACED)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_mapped_normal_leans_along_the_derivatives_of_u_and_v(everything, shape, placed):
    seen, matrix = of(everything, shape, placed)
    surface = SHAPES[shape][1]
    u, v = everything[0]["uv"][seen].astype(np.float64).T
    points = surface(u, v) @ matrix.T + PLACES[shape, placed]
    np.testing.assert_allclose(points, everything[0]["position"][seen], atol=5e-5)  # so u and v are those of the shape
    along_u = (surface(u + STEP, v) - surface(u - STEP, v)) @ matrix.T
    along_v = (surface(u, v + STEP) - surface(u, v - STEP)) @ matrix.T
    front = np.cross(along_u, along_v) * np.sign(np.linalg.det(matrix)) * (-1 if shape in BACK_OF_UVS else 1)
    front /= np.linalg.norm(front, axis=-1, keepdims=True)
    assert_lit_as_mapped(everything, seen, points, along_u, along_v, front, hollow=shape in HOLLOW)


@pytest.mark.parametrize("placed", PLACED)
@pytest.mark.parametrize("box", BOXES)
def test_a_mapped_normal_of_a_box_leans_along_the_axes_of_its_face(everything, placed, box):
    seen, matrix = of(everything, box, placed)
    normal = everything[0]["geometric_normal"][seen].astype(np.float64)
    face = np.argmax(np.abs(normal @ matrix), axis=1)  # normals go by the transpose
    along_u, along_v = (axes[face] @ matrix.T for axes in (np.eye(3)[[1, 0, 0]], np.eye(3)[[2, 2, 1]]))
    assert_lit_as_mapped(everything, seen, everything[0]["position"][seen], along_u, along_v, normal)


@pytest.mark.parametrize("placed", ["as it is", "stretched and turned"])  # mirrored ones name their corners otherwise
def test_a_mesh_without_coordinates_takes_its_first_edge_for_u(everything, placed):
    seen, matrix = of(everything, "mesh without coordinates", placed)
    edges = (CORNERS[1:] - CORNERS[0]) @ matrix.T
    front = np.cross(*edges) * np.sign(np.linalg.det(matrix))
    front = np.broadcast_to(front / np.linalg.norm(front), (seen.sum(), 3))
    along_u = np.broadcast_to(edges[0], front.shape)
    points = everything[0]["position"][seen]
    assert_lit_as_mapped(everything, seen, points, along_u, np.cross(front, along_u), front)


@pytest.mark.parametrize("placed", PLACED)
@pytest.mark.parametrize("shape", SHAPES)
def test_bumps_turn_the_normal_as_the_heights_would_turn_the_surface(uneven, shape, placed):
    seen, matrix = of(uneven, shape, placed)
    image, surface = uneven[0], SHAPES[shape][1]
    u, v = image["uv"][seen].astype(np.float64).T
    along_u = (surface(u + STEP, v) - surface(u - STEP, v)) / (2 * STEP) @ matrix.T
    along_v = (surface(u, v + STEP) - surface(u, v - STEP)) / (2 * STEP) @ matrix.T
    across = np.cross(along_u, along_v)
    front = across * np.sign(np.linalg.det(matrix)) * (-1 if shape in BACK_OF_UVS else 1)
    front /= np.linalg.norm(front, axis=-1, keepdims=True)
    by_u = (height_of(u + STEP, v) - height_of(u - STEP, v)) / (2 * STEP)
    by_v = (height_of(u, v + STEP) - height_of(u, v - STEP)) / (2 * STEP)
    # the derivatives of the displaced surface (Pharr, Jakob and Humphreys 2023, eq. 10.13, without its last term)
    bent = np.cross(along_u + by_u[:, None] * front, along_v + by_v[:, None] * front)
    bent *= np.sign(np.sum(bent * front, axis=-1, keepdims=True))
    bent /= np.linalg.norm(bent, axis=-1, keepdims=True)
    points = image["position"][seen].astype(np.float64)
    # float32 of u and v and of differences over 2^-9 of the pattern
    assert_lit(image, seen, EYE - points, bent, front, hollow=shape in HOLLOW, atol=2e-3)
    flat = np.abs(bent @ SUN - front @ SUN)
    assert flat.max() > 0.05


HILLS = np.random.default_rng(4).random((6, 8))


LENGTHS = {"surface": (3, 2), "unit": (1, 1), "u": (3, 3)}


def hilly(kind, lengths="surface", sign=1):
    """One ray per pixel to a floor of 3 by 2 cm with smooth hills, as heights or as normals of them, under one sun."""
    u, v = LENGTHS[lengths]
    rows, columns = (np.arange(size) / size * 2 * np.pi for size in (96, 128))
    heights = sum(
        HILLS[i, j] * np.cos(i * rows[:, None] + j * columns + 9 * HILLS[i, -j]) / (1 + i * i + j * j)
        for i, j in np.ndindex(6, 8)
    )
    heights = (heights - heights.min()) / np.ptp(heights)
    np.save("heights.npy", np.rint(65535 * heights[::-1]).astype(np.uint16))
    along = (np.roll(heights, -1, 1) - np.roll(heights, 1, 1)) / 2 * 128
    up = (np.roll(heights, -1, 0) - np.roll(heights, 1, 0)) / 2 * 96
    height = 0.03 * u
    normals = np.stack([-height * along / u, -height * up / v, np.ones_like(up)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    np.save("normals.npy", np.rint((normals[::-1] + 1) / 2 * 65535).astype(np.uint16))
    picture = {"kind": "image", "file": f"{kind}.npy", "color_space": "linear"}
    worn = (
        {"normal_map": picture}
        if kind == "normals"
        else {"bump": {"texture": picture, "height": sign * height, "lengths": lengths}}
    )
    floor = {"shape": "rectangle", "corner": [-1.5, -1, 0], "edge_u": [3, 0, 0], "edge_v": [0, 2, 0]}
    camera = looking([0, 0, 3], [0, 0, 0], up=(0, 1, 0), fov=50)
    sun = {"kind": "directional", "direction": (-SUN).tolist(), "irradiance": [np.pi] * 3}
    scene = scene_of([floor | {"material": MATTE | worn}], camera, depth=2, lights=[sun], metres_per_unit=0.01)
    return np.asarray(one_sample(scene, ["uv"], seed=seed_of("hills")))[..., 0]


@pytest.mark.slow
@pytest.mark.parametrize("lengths", LENGTHS)
def test_bumps_are_as_the_normal_map_of_the_same_heights(tmp_path, monkeypatch, lengths):
    monkeypatch.chdir(tmp_path)
    bumps, normals = hilly("heights", lengths), hilly("normals", lengths)
    assert np.ptp(normals[normals > 0]) > 0.15
    # slopes between texels are linear, normals between them nearly
    np.testing.assert_allclose(bumps, normals, atol=4e-3)
    assert np.abs(hilly("heights", lengths, -1) - normals).max() > 0.1


@pytest.mark.slow
def test_bumps_of_instances_have_the_lengths_of_their_places():
    """A sheet that stands twice, stretched, beside a rectangle of the same size and coordinates."""
    side = 100
    grid = np.arange(side + 1) / side
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    step = np.array([[0, side + 1, side + 2], [0, side + 2, 1]])
    points = np.stack([*np.meshgrid(grid, grid, indexing="ij"), np.zeros((side + 1, side + 1))], axis=-1).reshape(-1, 3)
    faces = (corner[:, None, None] + step).reshape(-1, 3)
    sheet = {"vertices": points.tolist(), "faces": faces.tolist(), "uvs": points[:, :2].tolist()}
    waves = {"kind": "perlin", "octaves": 1, "scale": [4, 4]}
    worn = MATTE | {"bump": {"texture": waves, "height": 0.1}}
    meshed = {"shape": "mesh", "mesh": "sheet", "material": worn}
    far = meshed | {"transform": {"translate": [50, 0, 0]}}
    here = meshed | {"transform": [{"scale": [3, 2, 1]}, {"translate": [-1.5, -1, 0]}]}
    flat = {"shape": "rectangle", "corner": [-1.5, -1, 0], "edge_u": [3, 0, 0], "edge_v": [0, 2, 0], "material": worn}
    sun = {"kind": "directional", "direction": (-SUN).tolist(), "irradiance": [np.pi] * 3}
    shown = {"depth": 2, "lights": [sun], "meshes": {"sheet": sheet}}
    camera = looking([0, 0, 3], [0, 0, 0], up=(0, 1, 0), fov=50)
    pictures = [
        np.asarray(one_sample(scene_of(objects, camera, **shown), ["uv"], seed=seed_of("places")))[..., 0]
        for objects in ([here, far], [flat, far])
    ]
    assert np.ptp(pictures[1][pictures[1] > 0]) > 0.2
    np.testing.assert_allclose(*pictures, atol=3e-3)


def test_bumps_of_a_product_lean_by_the_rule_of_products(uneven):
    image = uneven[0]
    seen = image["object_id"] == len(PLACES)
    u, v = (image["uv"][seen][:, k].astype(np.float64) for k in range(2))
    # heights 1.5 (0.25 (1 - v) + u v), over 4 units along x and along -z
    normals = np.stack([-1.5 * v / 4, np.ones_like(u), 1.5 * (u - 0.25) / 4], axis=1)
    within = np.zeros_like(seen)
    within[seen] = np.maximum(np.abs(u - 0.5), np.abs(v - 0.5)) < 0.49  # beyond 0 and 1 a gradient stays
    bent = (normals / np.linalg.norm(normals, axis=1, keepdims=True))[within[seen]]
    assert len(bent) > 500
    towards = EYE - image["position"][within]
    assert_lit(image, within, towards, bent, np.broadcast_to([0.0, 1.0, 0.0], bent.shape))
