"""Which photons belong to which samples, how they lie in memory, and when a scene has any."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from rptcam_cl.core.records import CAUSTIC_SURFACE, Kind, curves
from rptcam_cl.rendering.photon_map import (
    FIRST_PHOTONS,
    MOST_CELL_WORDS,
    MOST_PHOTONS,
    NEIGHBOURS,
    PILOT_PHOTONS,
    PhotonPass,
    first_radius,
    neighbours2,
    pass_of,
    sorted_by_cell,
    within_passes,
)
from rptcam_cl.rendering.plan.caustics import divided
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.load import load_scene
from tests.device.probes import open_session, run
from tests.rendering.caustics.test_photons import GLASS, LAMP, ball, glasses, lamp, scene


def test_every_sample_sees_one_pass_and_passes_follow_each_other():
    seen = [pass_of(sample) for sample in range(100)]
    assert all(found.first <= sample < found.first + found.samples for sample, found in enumerate(seen))
    assert [found.number for found in seen] == sorted(found.number for found in seen)
    assert len({found.number for found in seen}) == 5 + 6  # 1, 1, 2, 4, 8 samples, then 16 each


@pytest.mark.parametrize(("first", "samples", "most"), [(0, 100, 16), (3, 50, 5), (17, 1, 16), (15, 2, 64)])
def test_pieces_of_a_range_cover_it_and_see_one_pass_each(first, samples, most):
    pieces = list(within_passes(first, samples, most))
    assert [sample for start, count in pieces for sample in range(start, start + count)] == [
        *range(first, first + samples)
    ]
    assert all(count <= most and pass_of(start) == pass_of(start + count - 1) for start, count in pieces)


def test_photons_of_a_pass_are_a_power_of_two_and_fit():
    counts = [pass_of(sample).photons(pixels) for sample in (0, 5, 99) for pixels in (1, 10_000, 10**8)]
    assert all(count & (count - 1) == 0 and count <= MOST_PHOTONS for count in counts)


def test_radius_shrinks_with_the_sixth_root_of_the_samples():
    assert pass_of(640).shrinkage / pass_of(10 * 640).shrinkage == pytest.approx(10 ** (1 / 6), rel=0.01)


def photons_at(places):
    found = np.zeros((len(places), 8), np.float32)
    found[:, :3] = places
    return found


def test_cells_hold_their_photons_in_order():
    photons = photons_at(np.random.default_rng(1).uniform(-3, 5, (500, 3)))
    share = np.arange(500) // 125
    (grid,), order, words = sorted_by_cell(photons, 0.1, share, 4)
    cells, step = np.floor(photons[:, :3] * grid["low"][3]).astype(int).tolist(), int(grid["step"])
    each, period = int(grid["mask_cell"]) + 1, int(grid["mask_byte"]) + 1
    numbers = np.array(
        [own * each + (x + step * y + step**2 * z) % each for own, (x, y, z) in zip(share, cells, strict=True)]
    )
    starts, about = words[: 4 * each + 1], words[4 * each + 1 :].view(np.uint8)
    assert sorted(order) == list(range(500)) and starts[-1] == 500 and len(about) == period
    for number in np.unique(numbers):
        assert list(order[starts[number] : starts[number + 1]]) == list(np.flatnonzero(numbers == number))
    expected = np.zeros(period, int)
    for x, y, z in cells:
        for i in range(8):
            place = (x - (i & 1) + step * (y - (i >> 1 & 1)) + step**2 * (z - (i >> 2))) % period
            expected[place] |= 1 << i
    assert list(about) == list(expected)


@pytest.mark.parametrize("photons", [2, 500, MOST_PHOTONS])
@pytest.mark.parametrize("shares", [1, 8])
def test_cells_about_a_point_have_numbers_of_their_own(photons, shares):
    places = np.random.default_rng(4).uniform(-1, 1, (photons, 3))
    (grid,), _, _ = sorted_by_cell(photons_at(places), 0.01, np.arange(photons) % shares, shares)
    corners = [(i & 1) + int(grid["step"]) * (i >> 1 & 1) + int(grid["step"]) ** 2 * (i >> 2) for i in range(8)]
    for mask in (grid["mask_cell"], grid["mask_byte"]):
        assert len({corner & int(mask) for corner in corners}) == 8


@pytest.mark.parametrize("axis", range(3))
def test_cells_of_a_plane_that_share_a_number_are_far_apart(axis):
    (grid,), _, _ = sorted_by_cell(photons_at(np.random.default_rng(5).uniform(-1, 1, (30_000, 3))), 0.01)
    ahead = np.stack(np.meshgrid(*[np.arange(-400, 401)] * 2), axis=-1).reshape(-1, 2)
    steps = np.delete([1, int(grid["step"]), int(grid["step"]) ** 2 % 2**32], axis)
    same = ahead[((ahead @ steps) & int(grid["mask_cell"]) == 0) & ahead.any(axis=1)]
    assert np.hypot(*same.T).min() > 0.45 * np.sqrt(int(grid["mask_cell"]) + 1)


def test_cells_of_the_largest_pass_fit_their_buffer():
    places = np.random.default_rng(3).uniform(-1, 1, (MOST_PHOTONS, 3))
    _, _, words = sorted_by_cell(photons_at(places), 1e-4, np.arange(MOST_PHOTONS) % 8, 8)
    assert len(words) <= MOST_CELL_WORDS


def test_no_photons_have_no_place():
    grid, order, _ = sorted_by_cell(photons_at(np.zeros((0, 3))), 0.1)
    assert len(order) == 0 and np.all(grid[0]["low"][:3] > grid[0]["high"][:3])


def test_radius_follows_the_density_of_most_photons():
    plane = np.random.default_rng(2).uniform(0, 1, (2048, 3)) * [1, 1, 0]
    near, far = first_radius(photons_at(plane), 10**5), first_radius(photons_at(10 * plane), 10**5)
    assert far == pytest.approx(10 * near, rel=1e-3)
    astray = np.concatenate([plane, np.full((20, 3), 1e4) * np.arange(1, 21)[:, None]])
    assert first_radius(photons_at(astray), 10**5) == pytest.approx(near, rel=0.05)


def test_first_radius_holds_so_many_photons_of_a_pass():
    half = photons_at(np.random.default_rng(4).uniform(0, 0.5, (2000, 3)) * [1, 1, 0])  # on a quarter of a square metre
    per_m2 = 2000 / 0.25 * PhotonPass(0, 0, 1).photons(10**4) / PILOT_PHOTONS  # of a pass of one sample
    assert first_radius(half, 10**4) == pytest.approx((FIRST_PHOTONS / per_m2 / np.pi) ** 0.5, rel=0.1)
    assert first_radius(half[:5], 10**4) == 1  # too few to tell


@pytest.mark.parametrize("count", [9, 70, 1000])
def test_neighbours_are_those_of_a_search_among_all(count):
    places = np.random.default_rng(count).uniform(-1, 1, (3, count))
    places[:, ::7] = places[:, :1]  # some are in one place
    apart = ((places[:, :, None] - places[:, None]) ** 2).sum(axis=0)
    every = np.partition(apart, NEIGHBOURS, axis=1)[:, NEIGHBOURS]
    np.testing.assert_array_equal(np.sort(neighbours2(places)), np.sort(every))


GREY_BALL = {"kind": "matte", "reflectance": 0.5}


GLASS_MESH = {"shape": "mesh", "vertices": [[0, 0, 0.1], [0.1, 0, 0.1], [0, 0.1, 0.1]], "faces": [[0, 1, 2]],
              "material": {"kind": "mirror"}}  # fmt: skip
# A lamp of 20 x 20 cm in 3200 triangles, and a mirror of 20 m that passes 20 cm below a lamp of 4 cm
ACROSS = np.linspace(-0.1, 0.1, 41)
SMALL_TRIANGLES = {
    "shape": "mesh", "vertices": [[float(x), float(y), 0.5] for x in ACROSS for y in ACROSS],
    "faces": [[41 * i + j + k, 41 * i + 41 + j, 41 * i + 1 + j + 41 * k]
              for i in range(40) for j in range(40) for k in (0, 1)],
    "material": {"kind": "emissive", "radiance": 10.0},
}  # fmt: skip
LAMP_OF_4_CM = {"shape": "sphere", "center": [3, 0.5, 0.4], "radius": 0.02, "material": SMALL_TRIANGLES["material"]}
LONG_MIRROR = {"shape": "rectangle", "corner": [-10, 0, 0.2], "edge_u": [20, 0, 0], "edge_v": [0, 1, 0],
           "material": {"kind": "mirror"}}  # fmt: skip
SKY = {"kind": "sky", "sun_elevation_degrees": 30}
# Between the camera and the lamp, and behind the lamp
PANE = {"shape": "box", "min": [-1, -0.005, 0.1], "max": [1, 0.005, 1], "material": GLASS}
PANE_BEHIND = PANE | {"min": [-1, 0.395, 0.1], "max": [1, 0.405, 1]}


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (scene(lamp(0.02), ball(), caustics="auto"), "on: photons"),
        (scene(lamp(0.02), PANE, caustics="auto"), "off: light samples find the lamps"),
        (scene(lamp(0.02), PANE_BEHIND, caustics="auto"), "on: photons"),  # mirrors the lamp to its side
        (scene(lamp(0.02), PANE, lights=[LAMP], caustics="auto"), "on: photons"),  # a point, which no ray meets
        (scene(lamp(0.3), ball(), caustics="auto"), "off: paths find"),
        (scene(lamp(0.06), ball(), caustics="auto"), "off: paths find"),  # 0.028 sr
        (scene(lamp(0.06), GLASS_MESH, caustics="auto"), "off: paths find"),
        (scene(lamp(0.02), GLASS_MESH, caustics="auto"), "on: photons"),
        (scene(SMALL_TRIANGLES, ball(), caustics="auto"), "off: paths find"),
        (scene(lamp(0.3), lamp(0.02, 1000.0), ball(), caustics="auto"), "on: photons"),  # 0.31 of the light
        (scene(lamp(0.3), lamp(0.02, 1.0), ball(), caustics="auto"), "off: paths find"),
        (scene(lamp(0.3), ball(), caustics="auto", environment=SKY), "on: photons"),
        (scene(lamp(0.3), ball(), caustics="auto", lights=[LAMP]), "on: photons"),
        (scene(LAMP_OF_4_CM, LONG_MIRROR, caustics="auto"), "off: paths find"),
        (scene(lamp(), ball() | {"material": GREY_BALL}), "off: no smooth glass"),
        (scene(ball(), environment={"kind": "constant", "radiance": 1.0}), "off: no lamp"),
        (scene(lamp(), ball(alpha=0.2)), "off: no smooth glass"),
    ],
)
def test_choice_says_what_the_scene_has(made, says):
    caustics = make_plan(load_scene(made)).caustics
    assert caustics.choice.startswith(says)
    assert caustics.facts == {"CAUSTICS": int(says.startswith("on")), "PANES_BY_SAMPLES": 0}


THIN_PANE = {"shape": "rectangle", "corner": [-1, -0.4, 0.5], "edge_u": [2, 0, 0], "edge_v": [0, 0.8, 0],
             "material": {"kind": "thin_glass"}}  # fmt: skip
DIM_BOX = {"shape": "box", "min": [2, 2, 0], "max": [3, 3, 1], "material": {"kind": "emissive", "radiance": 0.1}}


@pytest.mark.parametrize(
    ("made", "left"),
    [
        (scene(lamp(0.02), ball(), THIN_PANE), 1),
        (scene(lamp(0.02), ball(), PANE), 0),  # it shifts light
        (scene(lamp(0.02), ball(), THIN_PANE, lights=[LAMP]), 0),  # a point, which no ray meets
        (scene(lamp(0.02), ball(), THIN_PANE, DIM_BOX), 0),  # a lamp that light samples do not follow glass to
        (scene(lamp(0.02), ball(), THIN_PANE, caustics="off"), 0),
    ],
)
def test_what_thin_panes_let_pass_is_left_to_light_samples_where_they_find_every_lamp(made, left):
    plan = make_plan(load_scene(made))
    assert plan.facts["PANES_BY_SAMPLES"] == left
    assert np.count_nonzero(plan.caustics.roles & 4) == left


def test_scene_without_lamps_or_glass_is_left_alone():
    without = scene(lamp(0.02))
    del without["render"]["caustics"]
    found = make_plan(load_scene(without)).caustics
    assert (found.choice, found.active) == (None, False)
    assert make_plan(load_scene(glasses(caustics="off"))).caustics.choice is None


def test_small_lamp_and_glass_have_photons_unless_the_scene_says_otherwise():
    made = scene(lamp(0.02), ball())
    del made["render"]["caustics"]
    assert make_plan(load_scene(made)).caustics.active
    clamped = load_scene(made, ["render.clamp=10"])
    assert make_plan(clamped).caustics.choice.startswith("off: render.clamp")
    assert not make_plan(load_scene(made, ["render.caustics=off"])).caustics.active


COUNT = 1 << 14
# The canonical shapes as maps of the unit square, and their areas.
SHAPES = {
    Kind.DISK: (lambda a, r: (r * np.cos(a), r * np.sin(a), 0 * r), np.pi),
    Kind.RECTANGLE: (lambda a, v: (a / (2 * np.pi), v, 0 * v), 1.0),
    Kind.ELLIPSOID: (lambda a, v: (*(np.sin(np.pi * v) * (np.cos(a), np.sin(a))), np.cos(np.pi * v)), 4 * np.pi),
    Kind.CYLINDER: (lambda a, z: (np.cos(a), np.sin(a), z), 2 * np.pi),
    Kind.CONE: (lambda a, r: (r * np.cos(a), r * np.sin(a), 1 - r), np.sqrt(2) * np.pi),
}  # fmt: skip


def patches(shape, placement):
    """Middles and areas of small pieces of a placed shape."""
    a, v = np.meshgrid(np.linspace(0, 2 * np.pi, 257), np.linspace(0, 1, 257))
    corners = np.moveaxis(np.array(np.broadcast_arrays(*shape(a, v))), 0, -1) @ placement[:, :3].T + placement[:, 3]
    p, q, r, s = corners[:-1, :-1], corners[1:, :-1], corners[:-1, 1:], corners[1:, 1:]
    return (p + q + r + s) / 4, np.linalg.norm(np.cross(s - p, q - r), axis=-1) / 2


@pytest.fixture(scope="module", params=[1, 12], ids=["whole", "in pieces"])
def starts(request):
    """Placements of a surface of each shape and a triangle, whole and in pieces, and where photons start on them."""
    records, placements = CAUSTIC_SURFACE.zeros(len(SHAPES) + 1), []
    for k, (kind, (_, area)) in enumerate(SHAPES.items()):
        turned = Rotation.from_euler("xyz", (0.4 + k, 0.9, 2 * k)).as_matrix() * (1.0, 1.6, 0.5)
        placements.append(np.column_stack([turned, (k, -1.0, 2.0)]))
        records["kind"][k], records["area"][k], records["triangle"][k] = kind, area, -1
        records["row_x"][k], records["row_y"][k], records["row_z"][k] = placements[k]
    records["kind"][-1], records["area"][-1] = Kind.MESH, 0.7
    records["primitive"] = np.arange(len(records))
    pieces, areas, of = divided(records, np.array([3.0, 2.0, 4.0, 3.0, 1.5, 2.5]), np.full(len(records), request.param))
    assert np.bincount(of)[-1] == 1 and np.all(np.abs(np.bincount(of)[:-1] - request.param) <= request.param // 4)
    curve, _ = curves(areas[None] * np.where(np.arange(len(of)) % 2, 1.5, 1.0))
    session = open_session()
    out = session.allocate(4 * 7 * COUNT)
    run(
        session, "probe_photon_start", {"VW": session.lanes}, COUNT // session.lanes, count=np.uint32(COUNT), out=out,
        surfaces=session.upload(pieces), curve=session.upload(curve.ravel()), surface_count=np.int32(len(pieces)),
        **{"in": session.upload(qmc.Sobol(3, seed=3).random(COUNT).T.astype(np.float32, order="C"))},
    )  # fmt: skip
    return placements, session.read(out, np.float32, 7 * COUNT).reshape(7, COUNT).astype(np.float64)


@pytest.mark.parametrize("kind", SHAPES, ids=[kind.name for kind in SHAPES])
def test_starts_stand_for_the_area_of_their_surface(starts, kind) -> None:
    placements, (primitive, *point, area, _, _) = starts
    k = list(SHAPES).index(kind)
    here = primitive == k
    middles, pieces = patches(SHAPES[kind][0], placements[k])
    found, area = np.column_stack(point)[here], area[here]
    assert area.sum() / COUNT == pytest.approx(pieces.sum(), rel=0.01)  # so many points in three dimensions
    middle = np.average(middles.reshape(-1, 3), axis=0, weights=pieces.ravel())
    np.testing.assert_allclose(np.average(found, axis=0, weights=area), middle, atol=0.02)
    spread = np.cov(middles.reshape(-1, 3).T, aweights=pieces.ravel(), ddof=0)
    np.testing.assert_allclose(np.cov(found.T, aweights=area, ddof=0), spread, atol=0.02)
    x, y, z = np.linalg.solve(placements[k][:, :3], (found - placements[k][:, 3]).T)
    flat = kind in (Kind.DISK, Kind.RECTANGLE)
    on_it = {Kind.ELLIPSOID: x**2 + y**2 + z**2 - 1, Kind.CYLINDER: x**2 + y**2 - 1, Kind.CONE: np.hypot(x, y) + z - 1}
    np.testing.assert_allclose(z if flat else on_it[kind], 0, atol=3e-6)  # float32, at coordinates of 5


def test_starts_are_even_over_a_triangle(starts) -> None:
    _, (primitive, _, _, _, area, b1, b2) = starts
    here = primitive == len(SHAPES)
    b1, b2 = b1[here], b2[here]
    assert min(b1.min(), b2.min(), (1 - b1 - b2).min()) >= -1e-6
    assert area[here].sum() / COUNT == pytest.approx(0.7, rel=0.01)
    # means over a triangle of barycentric coordinates and of their products
    np.testing.assert_allclose(
        [b1.mean(), b2.mean(), (b1 * b2).mean(), (b1**2).mean()], [1 / 3, 1 / 3, 1 / 12, 1 / 6], atol=0.005
    )
