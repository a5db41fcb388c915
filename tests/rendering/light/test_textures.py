"""Textures on the device against float64: bilinear pictures, decoding, wrapping, coordinates, patterns."""

from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.scene.load import load_scene
from tests.device.probes import run
from tests.rendering.light.perlin import perlin, summed
from tests.rendering.light.pictures import save_exr

CAMERA = {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40}
RNG = np.random.default_rng(11)
COUNT = 1 << 13
PLACES = RNG.uniform(-3, 4, (2, COUNT)).astype(np.float32)


def every_kind():
    """A texture of each kind, so that one program does for all."""
    image, ends = (
        {"kind": "image", "file": "speck.exr"},
        {"checker": "even odd", "gradient": "start end", "noise": "low high"},
    )
    plain = [{"kind": kind} | dict.fromkeys(keys.split(), 0.5) for kind, keys in ends.items()]
    in_space = [{"kind": kind, "mapping": {"kind": "round"}} for kind in ("perlin", "marble")]
    mixed = {"kind": "mixture", "first": 0.2, "second": image, "amount": image}
    for _ in range(2):
        mixed = {"kind": "mixture", "first": mixed, "second": mixed}
    return [*plain, *in_space, image, {"kind": "dots", "inside": 1, "outside": 0}, mixed]


def looked_up(session, texture, folder, places=PLACES, lanes=8):
    """Return the colours (n, 3) that the device finds at places (2, n)."""
    save_exr(folder / "speck.exr", np.ones((2, 2, 3)))
    ball = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": {"kind": "matte", "reflectance": texture}}
    others = [ball | {"material": {"kind": "matte", "reflectance": each}} for each in every_kind()]
    plan = make_plan(load_scene({"camera": CAMERA, "objects": [*others, ball]}, base_dir=folder))
    count = places.shape[1]
    out = session.allocate(4 * 3 * count)
    run(session, "probe_texture", plan.facts | {"VW": lanes}, count // lanes, **SceneBuffers(session, plan).scene,
        places=session.upload(places), colours=out, count=np.uint32(count),
        texture=np.int32(len(plan.textures.records) - 1))  # fmt: skip
    return session.read(out, np.float32, 3 * count).reshape(3, count).T.astype(np.float64)


def linear(codes):
    values = codes / 255
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def wrapped(index, count, wrap):
    if wrap == "repeat":
        return index % count
    if wrap == "clamp":
        return np.clip(index, 0, count - 1)
    turned = index % (2 * count)
    return np.where(turned < count, turned, 2 * count - 1 - turned)


def expected_colours(texels, places, wrap, nearest=False):
    """Return colours of linear texels (height, width, 3), the top row first, at places (2, n)."""
    height, width = texels.shape[:2]
    rows = texels[::-1]
    x, y = places[0].astype(float) * width, places[1].astype(float) * height
    if nearest:
        return rows[wrapped(np.floor(y).astype(int), height, wrap), wrapped(np.floor(x).astype(int), width, wrap)]
    left, low = np.floor(x - 0.5), np.floor(y - 0.5)
    right_share, high_share = (x - 0.5 - left)[:, None], (y - 0.5 - low)[:, None]

    def row(j):
        j = wrapped(j.astype(int), height, wrap)
        here, there = (rows[j, wrapped(i.astype(int), width, wrap)] for i in (left, left + 1))
        return here + right_share * (there - here)

    return row(low) + high_share * (row(low + 1) - row(low))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    PIL.Image.fromarray(CODES).save(tmp_path / "codes.png")
    save_exr(tmp_path / "floats.exr", FLOATS)
    return tmp_path


CODES = RNG.integers(0, 256, (9, 14, 3)).astype(np.uint8)
FLOATS = RNG.random((7, 12, 3))


@pytest.mark.parametrize("lanes", [1, 8])
@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
@pytest.mark.parametrize("file", ["codes.png", "floats.exr"])
def test_picture_is_bilinear_between_centres(session, folder, file, wrap, lanes) -> None:
    found = looked_up(session, {"kind": "image", "file": file, "wrap": wrap}, folder, lanes=lanes)
    texels = linear(CODES.astype(float)) if file == "codes.png" else FLOATS
    expected = expected_colours(texels, PLACES, wrap)
    # the fit of the sRGB curve is good to 4e-5, a half to 2.5e-4 of a texel; float32 places to 4e-6 texels
    np.testing.assert_allclose(found, expected, atol=3e-4)
    wrong = expected_colours(texels[:, ::-1], PLACES, wrap)
    assert np.abs(found - wrong).max() > 0.5


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
def test_nearest_texel(session, folder, wrap) -> None:
    found = looked_up(session, {"kind": "image", "file": "codes.png", "wrap": wrap, "filter": "nearest"}, folder)
    expected = expected_colours(linear(CODES.astype(float)), PLACES, wrap, nearest=True)
    # on the edges of texels rounding may pick the neighbour
    assert (np.abs(found - expected).max(axis=1) > 1e-4).sum() < 5


def test_every_code_is_decoded(session, tmp_path) -> None:
    codes = np.arange(256, dtype=np.uint8)
    PIL.Image.fromarray(np.stack([codes] * 3, axis=1)[None]).save(tmp_path / "codes.png")
    centres = np.stack([(np.arange(256) + 0.5) / 256, np.full(256, 0.5)]).astype(np.float32)
    texture = {"kind": "image", "file": "codes.png", "filter": "nearest"}
    srgb = looked_up(session, texture, tmp_path, centres)[:, 1]
    np.testing.assert_allclose(srgb, linear(codes.astype(float)), rtol=4e-5)
    assert (srgb[0], srgb[255]) == (0, 1)
    plain = looked_up(session, texture | {"color_space": "linear"}, tmp_path, centres)[:, 1]
    np.testing.assert_allclose(plain, codes / 255, rtol=2e-7)


def test_single_channels_are_linear_greys(session, tmp_path) -> None:
    codes = RNG.integers(0, 256, (1, 1, 4)).astype(np.uint8)
    PIL.Image.fromarray(codes).save(tmp_path / "one.png")
    for index, channel in enumerate("rgba"):
        found = looked_up(session, {"kind": "image", "file": "one.png", "channel": channel}, tmp_path)
        np.testing.assert_allclose(found, codes[0, 0, index] / 255, rtol=1e-6)


def test_alpha_of_an_opaque_picture_is_refused(folder) -> None:
    texture = {"kind": "image", "file": "codes.png", "channel": "a"}
    with pytest.raises(InputError, match=r"^objects\[8\]\.material\.reflectance\.file: has no alpha channel"):
        looked_up(None, texture, folder)


def test_gain_is_a_factor_and_reflectance_ends_at_one(session, folder) -> None:
    found = looked_up(session, {"kind": "image", "file": "floats.exr", "gain": 2.5}, folder)
    np.testing.assert_allclose(found, np.minimum(2.5 * expected_colours(FLOATS, PLACES, "repeat"), 1), atol=1e-3)
    assert found.max() == 1


def test_coordinates_are_scaled_then_turned_then_shifted(session, folder) -> None:
    keys = {"scale": [2, -0.5], "rotation_degrees": 30, "offset": [0.25, 0.1]}
    found = looked_up(session, {"kind": "image", "file": "floats.exr", **keys}, folder)
    u, v = PLACES[0] * 2.0, PLACES[1] * -0.5
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    moved = np.stack([c * u - s * v + 0.25, s * u + c * v + 0.1])
    np.testing.assert_allclose(found, expected_colours(FLOATS, moved, "repeat"), atol=3e-4)


def test_quarter_turns_are_exact(session, folder) -> None:
    keys = {"kind": "checker", "even": 0.25, "odd": 0.75}
    places = np.floor(RNG.uniform(-8, 8, (2, 512))).astype(np.float32)
    turned = looked_up(session, keys | {"rotation_degrees": 90}, folder, places)
    # on the lines between cells nothing but exact zeros keeps (-v, u) where it belongs
    np.testing.assert_array_equal(turned[:, 0], np.where((places[0] - places[1]) % 2 == 0, 0.25, 0.75))


def test_pictures_of_one_file_share_their_texels(folder) -> None:
    materials = [
        {"kind": "matte", "reflectance": {"kind": "image", "file": "codes.png", "scale": [k, k]}} for k in (1, 2)
    ]
    materials.append({"kind": "matte", "reflectance": {"kind": "image", "file": "codes.png", "channel": "g"}})
    balls = [{"shape": "sphere", "center": [k, 0, 0], "radius": 1, "material": m} for k, m in enumerate(materials)]
    textures = make_plan(load_scene({"camera": CAMERA, "objects": balls}, base_dir=folder)).textures
    assert len(textures.records) == 3
    assert len(textures.texels) == 2 * 9 * 15 + 4


def test_gradient_runs_from_start_to_end(session, folder) -> None:
    found = looked_up(session, {"kind": "gradient", "start": [1, 0, 0.5], "end": [0, 1, 0.5]}, folder)
    k = np.clip(PLACES[0].astype(float), 0, 1)
    np.testing.assert_allclose(found, np.stack([1 - k, k, np.full(COUNT, 0.5)], axis=1), atol=1e-6)


NOISE = {"kind": "noise", "low": 0, "high": 1, "contrast": 0.5}


def test_noise_has_its_mean_and_spread(session, folder) -> None:
    places = RNG.uniform(-500, 500, (2, 1 << 16)).astype(np.float32)
    for octaves in (1, 5):
        found = looked_up(session, NOISE | {"octaves": octaves}, folder, places)[:, 0]
        assert ((found > 0) & (found < 1)).all()
        # 65536 values that are hardly correlated: the mean is good to 5e-4, the spread to 1 %
        assert found.mean() == pytest.approx(0.5, abs=0.003)
        assert found.std() == pytest.approx(0.5 * 0.18, rel=0.03)


def test_noise_is_smooth_where_an_octave_is_and_other_for_other_seeds(session, folder) -> None:
    x = np.linspace(0.2, 3.8, 4096, dtype=np.float32)
    still = np.full_like(x, 0.4)
    for places in ((x, x), (x, still), (still, x)):  # on the diagonal, at whose lattice points all is zero, and beside
        line = looked_up(session, NOISE | {"octaves": 1}, folder, np.stack(places))[:, 0]
        steps = np.diff(line) / np.diff(x)
        assert np.abs(steps).max() < 4
        # no jump across lattice lines: the slope itself changes little from step to step
        assert np.abs(np.diff(steps)).max() < 0.2
    other = looked_up(session, NOISE | {"octaves": 1, "seed": 1}, folder, np.stack([still, x]))[:, 0]
    assert abs(np.corrcoef(line, other)[0, 1]) < 0.9
    assert np.abs(line - other).max() > 0.1


@pytest.mark.slow
def test_picture_stands_upright_on_a_sphere(session, tmp_path) -> None:
    from tests.rendering.pictures import pixels

    top = np.zeros((4, 8, 3))
    top[0] = 0.75
    save_exr(tmp_path / "top.exr", top)
    material = {"kind": "matte", "reflectance": {"kind": "image", "file": "top.exr", "wrap": "clamp"}}
    ball = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": material}
    camera = {**CAMERA, "fov_degrees": 5, "eye": [0, 0, 9], "up": [0, 1, 0]}
    scene = {"camera": camera, "film": {"resolution": [8, 8]}, "objects": [ball]}
    scene |= {"environment": {"kind": "constant", "radiance": 1}, "render": {"max_depth": 2}}
    film = pixels(load_scene(scene, base_dir=tmp_path), spp=64)
    np.testing.assert_allclose(film[4, 4], 0.75, rtol=1e-3)  # +z is the top of a sphere's texture


FRAME = [[2.0, 0.5, 0, 0.3], [-0.4, 3.0, 0.2, -1], [0.1, 0.3, 1.5, 2]]
POINTS = np.stack([*PLACES, PLACES[0] - 0.5 * PLACES[1], np.ones(COUNT)]).astype(np.float64)
POINTS[:3] += np.array(CAMERA["eye"])[:, None]  # the kernels' world has its origin in the eye
FRAMED = np.array(FRAME) @ POINTS
IN_SPACE = {"mapping": {"matrix": FRAME}}


@pytest.mark.parametrize(("form", "lanes"), [("sum", 1), ("sum", 8), ("turbulence", 8), ("wind", 8)])
def test_noise_in_space_is_that_of_perlin(session, tmp_path, form, lanes) -> None:
    texture = {"kind": "perlin", "form": form, "octaves": 3, "gain": 0.4, "high": [1, 0.5, 0]} | IN_SPACE
    found = looked_up(session, texture, tmp_path, lanes=lanes)
    expected = {
        "sum": summed(FRAMED, 3, 0.4),
        "turbulence": summed(FRAMED, 3, 0.4, np.abs) + 0.2 * 0.4**3,
        "wind": np.abs(summed(0.1 * FRAMED, 3)) * summed(FRAMED, 6),
    }[form]
    assert (expected > 0.01).mean() > 0.3
    share = np.clip(expected, 0, 1)
    # places of some 20 have 2e-6 in float32, 35 times that in the finest octave of wind
    np.testing.assert_allclose(found, share[:, None] * [1, 0.5, 0], atol=2e-4)


def test_noise_without_a_mapping_is_over_u_and_v(session, tmp_path) -> None:
    found = looked_up(session, {"kind": "perlin", "octaves": 1, "scale": [2, 3]}, tmp_path)
    places = np.stack([2 * PLACES[0], 3 * PLACES[1], 0 * PLACES[0]]).astype(np.float64)
    np.testing.assert_allclose(found[:, 0], np.clip(perlin(places), 0, 1), atol=2e-5)


@pytest.mark.parametrize(("form", "last"), [("pbrt-v4", 5), ("pbrt-v3", 1)])
def test_marble_is_a_sine_along_y_in_six_cubic_pieces(session, tmp_path, form, last) -> None:
    keys = {"kind": "marble", "octaves": 4, "gain": 0.6, "variation": 1.5, "tint": [1, 0.5, 1], "form": form}
    texture = keys | IN_SPACE
    found = looked_up(session, texture, tmp_path)
    along = 3 + 3 * np.sin(FRAMED[1] + 1.5 * summed(FRAMED, 4, 0.6))
    piece = np.clip(np.floor(along), 0, last).astype(int)
    after = (along - piece)[:, None]
    stone, dull, warm, vein = [0.58, 0.58, 0.6], [0.5, 0.5, 0.5], [0.6, 0.59, 0.58], [0.2, 0.2, 0.33]
    points = np.array([stone, stone, stone, dull, warm, stone, stone, vein, stone])
    first, second, third = ((1 - after) * points[piece + k] + after * points[piece + k + 1] for k in range(3))
    first, second = (1 - after) * first + after * second, (1 - after) * second + after * third
    uncut = 1.5 * ((1 - after) * first + after * second) * [1, 0.5, 1]
    expected = np.clip(uncut, 0, 1)
    assert np.ptp(expected[:, 0]) > 0.2
    # the pieces do not join: on their edges rounding may pick the next
    off = np.abs(found - expected).max(axis=1) > 1e-3
    assert off.mean() < 2e-3
    ground = np.array([0.01, 0.04, 0.17])
    mixed = looked_up(
        session, {"kind": "mixture", "first": ground.tolist(), "second": texture, "amount": 0.1}, tmp_path
    )
    off = np.abs(mixed - np.clip(0.9 * ground + 0.1 * uncut, 0, 1)).max(axis=1) > 1e-3
    assert off.mean() < 2e-3


def test_dots_lie_where_noise_puts_them(session, tmp_path) -> None:
    found = looked_up(session, {"kind": "dots", "inside": 1, "outside": [0, 0.2, 0]}, tmp_path)[:, 0]
    x, y = PLACES.astype(np.float64)
    column, row = np.floor(x + 0.5), np.floor(y + 0.5)

    def noise(right, up):
        return perlin(np.stack([column + right, row + up, np.full(COUNT, 0.5)]))

    aside = np.hypot(x - column - 0.15 * noise(1.5, 2.8), y - row - 0.15 * noise(4.5, 9.8))
    expected = (noise(0.5, 0.5) > 0) & (aside < 0.35)
    assert 0.05 < expected.mean() < 0.5
    assert (found != expected).sum() < 5  # on the rims


def test_checkers_in_space_count_all_three_coordinates(session, tmp_path) -> None:
    found = looked_up(session, {"kind": "checker", "even": 1, "odd": 0} | IN_SPACE, tmp_path)[:, 0]
    expected = np.floor(FRAMED).sum(axis=0) % 2 == 0
    assert (found != expected).mean() < 1e-3


@pytest.mark.parametrize("kind", ["spherical", "cylindrical", "round"])
def test_round_mappings_count_angles_about_z(session, tmp_path, kind) -> None:
    texture = {"kind": "gradient", "start": 0, "end": 1, "mapping": {"kind": kind, "matrix": FRAME}}
    x, y, z = FRAMED
    round_z = np.arctan2(y, x) / (2 * np.pi) % 1
    down = np.arccos(z / np.sqrt(x**2 + y**2 + z**2)) / np.pi
    turned = (np.arctan2(y, x) + np.pi) / (2 * np.pi) % 1
    u, v = {
        "spherical": (down, round_z),
        "cylindrical": (turned, np.clip(z / 20, 0, 1)),
        "round": (turned, np.clip(np.cos(np.pi * down), 0, 1)),  # pbrt-v3's cylindrical
    }[kind]
    found = looked_up(session, texture, tmp_path)[:, 0]
    np.testing.assert_allclose(found, u, atol=2e-6)
    upright = {"rotation_degrees": -90, "scale": [1, 1 / 20 if kind == "cylindrical" else 1]}
    found = looked_up(session, texture | upright, tmp_path)[:, 0]
    jump = np.minimum(v, 1 - v) < 1e-5
    np.testing.assert_allclose(found[~jump], v[~jump], atol=2e-6)


def test_mixtures_are_mixed_channel_by_channel_in_any_order(session, folder) -> None:
    """Against float64: a product of two pictures, mixed with a checker by a picture; both sides of `amount` nest."""
    codes, floats = ({"kind": "image", "file": file} for file in ("codes.png", "floats.exr"))
    checker = {"kind": "checker", "even": [0.2, 0.4, 0.9], "odd": 0.1, "scale": [3, 3]}
    product = {"kind": "mixture", "second": codes, "amount": floats}
    mixture = {"kind": "mixture", "first": checker, "second": product, "amount": {**product, "second": floats}}
    found = looked_up(session, mixture, folder)
    a, b = (expected_colours(each, PLACES, "repeat") for each in (linear(CODES.astype(float)), FLOATS))
    even = (np.floor(3 * PLACES).sum(axis=0) % 2 == 0)[:, None]
    first = np.where(even, [0.2, 0.4, 0.9], 0.1)
    expected = (1 - b * b) * first + b * b * (a * b)
    on_edges = np.abs(3 * PLACES - np.round(3 * PLACES)).min(axis=0) < 1e-5
    np.testing.assert_allclose(found[~on_edges], expected[~on_edges], atol=6e-4)
    assert np.abs(found - ((1 - b) * first + b * (a * b))).max() > 0.05


def test_mixtures_stand_in_each_other_only_so_deep(folder) -> None:
    texture: object = 0.5
    for _ in range(4):
        texture = {"kind": "mixture", "first": texture}
    ball = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": {"kind": "matte", "reflectance": texture}}
    with pytest.raises(InputError, match=r"objects\[0\]\.material\.reflectance.*too many mixtures.*at most 3"):
        load_scene({"camera": CAMERA, "objects": [ball]}, base_dir=folder)
