"""What shadow rays leave out has the whole scene on one side; what lies along the axes is hit where formulas say."""

from zlib import crc32

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.records import Kind
from rptcam_cl.rendering import culling
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.plan.primitives import corners_of_box
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.selfcheck import TracedScene, directions
from tests.support.cases import slow

MATTE = {"kind": "matte", "reflectance": 0.6}
LAMP = {"kind": "emissive", "radiance": 5}
CAMERA = {"kind": "pinhole", "eye": [0.3, 0.2, 0.9], "target": [0, 0, -1], "fov_degrees": 70}


def rng_of(name):
    return np.random.default_rng(crc32(name.encode()))


def wall(corner, u, v, material=MATTE):
    return {"shape": "rectangle", "corner": list(corner), "edge_u": list(u), "edge_v": list(v), "material": material}


# Planes that nothing lies behind.


def outer(scene):
    """The objects of a scene whose plane has no other on one side, by the records."""
    plan = make_plan(load_scene({"camera": CAMERA, **scene}))
    ends = np.min(MESH, axis=0), np.max(MESH, axis=0)
    corners = np.zeros((0, 3)) if plan.meshes is None else corners_of_box(*ends, np.eye(4)) - CAMERA["eye"]
    marked = culling.with_outer_planes(plan, corners)["instance"]
    objects = plan.owners.of_primitive[:, 0].tolist()
    return {objects[first + k] for first in np.flatnonzero(marked < 0) for k in range(-marked[first])}


MESH = [[-0.9, -0.9, -0.9], [0.9, -0.9, -0.9], [0, 0.9, 0.9]]


def reach_along(item, n):
    """How low and high an object reaches along a direction, from the keys of the scene."""
    vector = {name: np.array(value) for name, value in item.items() if name not in ("shape", "material", "transform")}
    if item["shape"] == "rectangle":
        a, u, v = vector["corner"] @ n, vector["edge_u"] @ n, vector["edge_v"] @ n
        return a + min(u, 0) + min(v, 0), a + max(u, 0) + max(v, 0)
    if item["shape"] == "sphere":
        middle, half = vector["center"] @ n, item["radius"]
    elif item["shape"] == "disk":
        unit = vector["normal"] / np.linalg.norm(vector["normal"])
        middle, half = vector["center"] @ n, item["radius"] * np.linalg.norm(np.cross(unit, n))
    elif item["shape"] == "plane":
        unit = vector["normal"] / np.linalg.norm(vector["normal"])
        middle, half = vector["point"] @ n, 0.0 if abs(unit @ n) > 1 - 1e-9 else np.inf
    elif item["shape"] == "mesh":
        low, high = np.min(MESH, axis=0), np.max(MESH, axis=0)  # of the box round it
        middle, half = (low + high) / 2 @ n, np.abs((high - low) / 2) @ np.abs(n)
    else:
        angle = np.radians(item["transform"][0]["rotate"]["degrees"])
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        half = np.abs(turn.T @ n) @ ((vector["max"] - vector["min"]) / 2)
        middle = turn @ ((vector["max"] + vector["min"]) / 2) @ n
    return middle - half, middle + half


def plane_of(item):
    """A unit normal of a flat object and a point on it."""
    if item["shape"] == "rectangle":
        n, point = np.cross(item["edge_u"], item["edge_v"]), item["corner"]
    else:
        n, point = np.array(item["normal"], float), item["center" if item["shape"] == "disk" else "point"]
    return n / np.linalg.norm(n), np.array(point)


def expected_outer(scene):
    found = set()
    flats = [index for index, item in enumerate(scene["objects"]) if item["shape"] in ("rectangle", "disk", "plane")]
    for index in flats:
        n, point = plane_of(scene["objects"][index])
        for side in (n, -n):
            low = min(reach_along(item, side)[0] for item in scene["objects"]) - point @ side
            for light in scene["lights"]:
                if "position" in light:
                    low = min(low, (np.array(light["position"]) - point) @ side)
                else:
                    towards = -np.array(light["direction"]) / np.linalg.norm(light["direction"])
                    low = min(low, 0.0 if towards @ side >= 0 else -1.0)
            if low > -1e-7:
                found.add(index)
    return found


def some_object(rng):
    at = rng.uniform(-0.7, 0.7, 3).tolist()
    axis = rng.choice([*np.eye(3), rng.standard_normal(3)])
    kind = rng.choice(["rectangle", "disk", "sphere", "box", "plane", "mesh"], p=[0.2, 0.2, 0.25, 0.25, 0.05, 0.05])
    if kind == "rectangle":
        u, v = rng.standard_normal((2, 3)) * 0.2
        return wall(at, u.tolist(), v.tolist(), LAMP if rng.random() < 0.5 else MATTE)
    if kind == "mesh":
        return {"shape": "mesh", "vertices": MESH, "faces": [[0, 1, 2]], "material": MATTE}
    own = {
        "disk": {"center": at, "normal": axis.tolist(), "radius": 0.2},
        "sphere": {"center": at, "radius": 0.25},
        "box": {"min": at, "max": (np.array(at) + rng.uniform(0.1, 0.3, 3)).tolist(),
                "transform": [{"rotate": {"axis": [0, 0, 1], "degrees": float(rng.choice([0, 20, 90]))}}]},
        "plane": {"point": (1.1 * axis).tolist(), "normal": axis.tolist()},
    }[kind]  # fmt: skip
    return {"shape": str(kind), "material": MATTE, **own}


def room(rng, size=1.0):
    """Some of the walls of a cube about the origin."""
    sides = []
    for axis in range(3):
        for sign in (-size, size):
            u, v = np.roll(np.eye(3), -axis, axis=0)[1:] * 2 * size
            corner = np.roll([sign, -size, -size], axis)
            sides.append(
                wall(corner.tolist(), *([u.tolist(), v.tolist()] if rng.random() < 0.5 else [v.tolist(), u.tolist()]))
            )
    return [side for side in sides if rng.random() < 0.8]


def some_lights(rng):
    kinds = [{"kind": "point", "position": rng.uniform(-1.3, 1.3, 3).tolist(), "intensity": 1.0},
             {"kind": "directional", "direction": rng.standard_normal(3).tolist(), "irradiance": 1.0}]  # fmt: skip
    return [light for light in kinds if rng.random() < 0.3]


@pytest.mark.parametrize("seed", [0, *map(slow, range(1, 8))])
def test_planes_that_shadow_rays_leave_out_have_all_on_one_side(seed):
    rng = rng_of(f"outer {seed}")
    counts = set()
    for _ in range(40):
        objects = [*room(rng), *(some_object(rng) for _ in range(rng.integers(1, 6)))]
        scene = {"objects": objects, "lights": some_lights(rng)}
        expected = expected_outer(scene)
        assert outer(scene) == expected, scene
        counts.add(len(expected))
    assert len(counts) > 3


CLOSED = [wall([-1, -1, z], [2, 0, 0], [0, 2, 0]) for z in (-1, 1)]


@pytest.mark.parametrize(
    "others",
    [
        {"environment": {"kind": "sky", "sun_elevation_degrees": 40}},
        {"medium": {"visibility_m": 10}},
        {"shutter": {"time_s": 1.0}},
    ],
    ids=["light from everywhere", "light from the air", "something moves"],
)
def test_no_plane_is_left_out_where_much_may_lie_behind(others):
    moves = [{"time_s": 0.0, "translate": [0, 0, 0]}, {"time_s": 1.0, "translate": [0, 0, 5]}]
    ball = {"shape": "sphere", "center": [0, 0, 0], "radius": 0.1, "material": LAMP}
    moving = ball | ({"motion": moves} if "shutter" in others else {})
    assert outer({"objects": [*CLOSED, moving], **others}) == set()
    assert outer({"objects": [*CLOSED, ball]}) == {0, 1}


@pytest.mark.parametrize("place", [(0, 0, 0), (40, -900, 300)], ids=["at the eye", "far off"])
def test_a_wide_ground_hides_what_lies_a_little_below_it(place):
    x, y, z = place
    ground = wall([x - 1e5, y - 1, z - 1e5], [0, 0, 2e5], [2e5, 0, 0])
    side = wall([x - 1, y - 1, z - 1], [0, 2, 0], [0, 0, 2])
    for height, found in ((0.2, {0}), (0.199, set()), (0.1, set())):
        ball = {"shape": "sphere", "center": [x, y - 1 + height, z], "radius": 0.2, "material": LAMP}
        assert outer({"objects": [ground, side, ball]}) == found


def test_pictures_are_those_of_rays_that_meet_every_plane(monkeypatch):
    rng = rng_of("picture")
    while len(walls := room(rng)) < 5:
        pass
    lamp = wall([-0.3, 0.999, -0.3], [0.6, 0, 0], [0, 0, 0.6], LAMP)
    glass = {"kind": "dielectric", "index": 1.5}
    boxes = [
        {"shape": "box", "min": [-0.6, -1, -0.5], "max": [-0.1, 0.2, 0], "material": MATTE},
        {"shape": "sphere", "center": [0.5, -0.6, -0.2], "radius": 0.4, "material": glass},
    ]
    scene = {"camera": CAMERA, "film": {"resolution": [64, 48]}, "objects": [*walls, *boxes, lamp]}
    films = [np.asarray(rptcam_cl.render(scene, spp=16, seed=1))]
    monkeypatch.setattr(culling, "with_outer_planes", lambda plan, corners: plan.primitives)
    monkeypatch.setattr(culling, "aligned", lambda plan: ({}, {}))
    films.append(np.asarray(rptcam_cl.render(scene, spp=16, seed=1)))
    apart = np.abs(films[0] - films[1]).max(axis=2) > 1e-4 * films[1].mean()
    assert films[1].mean() > 0
    assert apart.mean() < 0.02
    assert films[0].mean() == pytest.approx(films[1].mean(), rel=2e-4)


# What lies along the axes.


def aligned_objects(rng, count):
    """Rectangles, disks, a plane and boxes along the axes, with corners on a grid, some after a quarter turn."""
    items = []
    for index in range(count):
        axis = int(rng.integers(3))
        at = np.round(rng.uniform(-1, 1, 3) * 8) / 8
        edges = np.roll(np.eye(3), axis, axis=0)[1:] * rng.choice([-0.75, -0.25, 0.25, 0.5], 2)[:, None]
        if index % 4 == 0:
            high = at + rng.choice([0.125, 0.25, 0.5], 3)
            turn = {"transform": [{"rotate": {"axis": [0, 0, 1], "degrees": 90}}]} if index % 8 == 0 else {}
            items.append({"shape": "box", "min": at.tolist(), "max": high.tolist(), "material": MATTE, **turn})
        elif index % 4 == 1:
            normal = (rng.choice([-1.0, 1.0]) * np.eye(3)[axis]).tolist()
            items.append({"shape": "disk", "center": at.tolist(), "normal": normal, "radius": 0.375, "material": MATTE})
        else:
            items.append(wall(at.tolist(), *edges[:: rng.choice([-1, 1])].tolist()))
    ground = {"shape": "plane", "point": [0, -1.5, 0], "normal": [0, 1, 0], "material": MATTE}
    return [*items, ground]


def hits_by_formula(item, o, d):
    """Distances at which rays meet an object along the axes, and how far inside its edge they pass; float64."""
    with np.errstate(all="ignore"):
        if item["shape"] == "box":
            low, high = np.array(item["min"]), np.array(item["max"])
            if "transform" in item:
                low, high = np.array([-high[1], low[0], low[2]]), np.array([-low[1], high[0], high[2]])
            one, other = (low - o) / d, (high - o) / d
            ends = np.fmin(one, other), np.fmax(one, other)
            near, far = ends[0].max(axis=1), ends[1].min(axis=1)
            inside = ((o >= low) & (o <= high)) | (d != 0)
            t = np.where(near > 0, near, far)
            return np.where((near <= far) & (far > 0) & inside.all(axis=1), t, np.inf), np.nan_to_num(
                far - near, nan=1.0
            )
        n, point = plane_of(item)
        t = (point - o) @ n / (d @ n)
        place = o + t[:, None] * d
        if item["shape"] == "plane":
            edge = np.ones(len(o))
        elif item["shape"] == "disk":
            edge = item["radius"] - np.linalg.norm(place - point, axis=1)
        else:
            u, v = (np.array(item[name]) for name in ("edge_u", "edge_v"))
            shares = [(place - point) @ edge / (edge @ edge) for edge in (u, v)]
            edge = np.min([np.minimum(share, 1 - share) for share in shares], axis=0)
        return np.where((t > 0) & np.isfinite(t) & (edge >= 0), t, np.inf), np.nan_to_num(edge, nan=1.0)


def along_axes(rng, count):
    """Rays along the axes from places off the grid, with zeros of both signs, and some that nearly go so."""
    o, axis = rng.uniform(-1.5, 1.5, (count, 3)), rng.integers(3, size=count)
    d = rng.choice([0.0, -0.0, 1e-30, -1e-7], (count, 3))
    d[np.arange(count), axis] = rng.choice([-1.0, 1.0], count)
    return o, d


@pytest.mark.parametrize("lanes", [8, *map(slow, (1, 16))])
@pytest.mark.parametrize("way", ["random", "along the axes", slow("from afar")])
def test_hits_along_the_axes_are_those_of_formulas(session, way, lanes):
    rng = rng_of(f"aligned {way}")
    objects = aligned_objects(rng, 15)
    scene = TracedScene(session, objects)
    assert scene.buffers.tree_facts == {"ALIGNED_FLATS": 1, "ALIGNED_BOXES": 1}
    o, d = (
        along_axes(rng, 20_000)
        if way == "along the axes"
        else (rng.uniform(-2, 2, (20_000, 3)), directions(rng, 20_000))
    )
    if way == "from afar":
        o -= 300 * d
    o, d = o.astype(np.float32), d.astype(np.float32)
    found = scene.trace_shapes(o, d, lanes=lanes)
    object_of = scene.plan.owners.of_primitive[:, 0]
    every, edges = zip(*(hits_by_formula(item, o.astype(float), d.astype(float)) for item in objects), strict=True)
    t = np.min(every, axis=0)
    sure = (np.abs(edges) > 1e-4).all(axis=0)
    assert sure.mean() > 0.9
    assert (np.isfinite(t) == (found.primitive >= 0))[sure].all()
    hit = sure & np.isfinite(t)
    assert hit.mean() > 0.2
    size = 300 if way == "from afar" else 4
    assert found.t[hit] == pytest.approx(t[hit], rel=1e-6, abs=5e-7 * size)
    ordered = np.sort(np.minimum(every, 1e30), axis=0)
    clear = hit & (ordered[1] - ordered[0] > 1e-5 * size)
    assert (object_of[found.primitive[clear]] == np.argmin(every, axis=0)[clear]).all()
    assert len(set(object_of[found.primitive[clear]].tolist())) >= len(objects) - 1


def test_rays_leave_a_box_along_the_axes_and_flat_ones(session):
    rng = rng_of("leaving")
    box = {"shape": "box", "min": [-0.51, -0.27, -0.13], "max": [0.51, 0.27, 0.13], "material": MATTE}
    scene = TracedScene(session, [box, wall([-2, -2, 1], [4, 0, 0], [0, 4, 0])])
    number = int(np.flatnonzero(np.searchsorted(scene.plan.kind_end, np.arange(2), side="right") == Kind.BOX)[0])
    half = np.array(box["max"])
    o = rng.uniform(-1, 1, (20_000, 3)) * half
    axis, sign = rng.integers(3, size=len(o)), rng.choice([-1, 1], len(o))
    o[np.arange(len(o)), axis] = sign * half[axis]
    d = directions(rng, len(o))
    o, d = o.astype(np.float32), d.astype(np.float32)
    found = scene.trace_shapes(o, d, self_hit=number)
    inwards = d[np.arange(len(o)), axis] * sign < 0
    assert (found.primitive == number)[inwards].all()
    assert not (found.primitive == number)[~inwards].any()
    ways = ((np.sign(d) * half - o) / d).min(axis=1)
    assert found.t[inwards] == pytest.approx(ways[inwards], abs=1e-5)


BOX = {"shape": "box", "min": [2, 0, 0], "max": [3, 1, 1], "material": MATTE}


@pytest.mark.parametrize(
    ("extra", "facts"),
    [
        (BOX | {"transform": [{"rotate": {"axis": [0, 0, 1], "degrees": 1e-3}}]}, (1, 0)),
        (wall([0, 0, 0], [1, 1e-4, 0], [0, 0, 1]), (0, 1)),
        (wall([0, 0, 0], [1, 0, 0], [1, 0, 1]), (0, 1)),
        ({"shape": "disk", "center": [0, 0, 0], "normal": [0, 1, 1e-4], "radius": 1, "material": MATTE}, (0, 1)),
    ],
    ids=["turned box", "turned wall", "skewed wall", "leaning disk"],
)
def test_what_does_not_lie_along_the_axes_takes_its_kind_the_common_way(extra, facts):
    objects = [*CLOSED, *CLOSED, BOX, extra]
    found = culling.aligned(make_plan(load_scene({"camera": CAMERA, "objects": objects})))[1]
    assert (found["ALIGNED_FLATS"], found["ALIGNED_BOXES"]) == facts
