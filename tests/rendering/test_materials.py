"""Materials in pictures: closed forms, and materials that must look alike."""

import math

import numpy as np
import pytest
from PIL import Image

from tests.rendering.pictures import MATTE, WHITE, batches, flat_mean, looking, pixels, scene_of, seed_of
from tests.support.cases import one_in, slow
from tests.support.statistics import assert_equivalent, assert_same_tiles

SPHERE = {"shape": "sphere", "center": [0, 0, 0], "radius": 1}
FLOOR = {"shape": "rectangle", "corner": [-2, -2, -1], "edge_u": [4, 0, 0], "edge_v": [0, 4, 0], "material": MATTE}
LAMP = {"kind": "point", "position": [2, -2, 3], "intensity": [60, 50, 40]}
SKY = {"kind": "gradient", "bottom": [0.1, 0.2, 0.1], "top": [0.9, 1, 1.2], "up": [0, 0, 1]}
PLASTIC = {"kind": "plastic", "reflectance": [0.6, 0.2, 0.1]}
GOLD = {"kind": "conductor", "metal": "gold", "roughness": 0.4}


def constant(value):
    return {"kind": "gradient", "start": value, "end": value}


SPECK = {"shape": "sphere", "center": [0, 500, 0], "radius": 1e-3}  # that no ray finds
LAYERS = ("roughness", "metallic", "clearcoat", "clearcoat_roughness", "sheen", "specular", "specular_color",
          "transmission")  # fmt: skip
# With these in every scene one program renders them all.
CROWD = [
    PLASTIC, GOLD, {"kind": "conductor", "reflectance": 0.5, "alpha": [0.1, 0.4], "anisotropy_rotation_degrees": 30},
    {"kind": "principled", "anisotropy": 0.5} | {key: constant(0.5) for key in LAYERS},
    {"kind": "mix", "materials": [PLASTIC, GOLD], "factor": {"kind": "checker", "even": 0.1, "odd": 0.9}},
]  # fmt: skip


def ball(material, depth=5, crowd=CROWD, **rest):
    """A ball of a material over a floor, under a lamp and a sky, and specks of other materials."""
    camera = looking([0.4, -3.4, 1.2], [0, 0, -0.1], fov=42)
    objects = [{**SPHERE, "material": material}, FLOOR, *({**SPECK, "material": other} for other in crowd)]
    return scene_of(objects, camera, depth=depth, lights=[LAMP], environment=SKY, **rest)


TABLES_APART = 3e-3  # of tables for two alphas and for all: on this ball 0.9977 of the values lie within it


def same(one, other, share=0.98, rtol=1e-4, **options):
    """Two scenes give the same samples, but for a few paths that rounding sends elsewhere."""
    a, b = (pixels(scene, seed=seed_of("same"), spp=8, **options) for scene in (one, other))
    assert np.isclose(a, b, rtol=rtol, atol=1e-5).mean() > share
    return a


def slab(material, thickness, degrees=0.0):
    """A slab seen so closely that every pixel's ray meets it at one angle."""
    angle = math.radians(degrees)
    eye = [-10 * math.sin(angle), 0, 10 * math.cos(angle)]
    box = {"shape": "box", "min": [-50, -50, -thickness], "max": [50, 50, 0], "material": material}
    camera = looking(eye, [0, 0, 0], 0.001, up=(0, 1, 0))
    return scene_of([box], camera, depth=6, resolution=(16, 16), environment=WHITE)


def test_light_through_an_absorbing_slab_is_beers_law():
    # index 1: nothing is reflected, and the way is straight
    material = {"kind": "dielectric", "index": 1.0, "absorption_per_m": [0.5, 2.0, 0.0]}
    for degrees in (0, 60):
        way = 0.8 / math.cos(math.radians(degrees))
        expected = np.exp(-np.array([0.5, 2.0, 0.0]) * way)
        film = pixels(slab(material, 0.8, degrees), spp=4)
        # pixels half a field off the middle go through 1.5e-5 more or less of the slab
        np.testing.assert_allclose(film, np.broadcast_to(expected, film.shape), rtol=1e-4)


def test_attenuation_is_the_colour_after_its_distance_in_metres():
    material = {"kind": "dielectric", "index": 1.0, "attenuation": {"color": [0.25, 0.5, 1.0], "distance_m": 0.008}}
    film = pixels(slab(material, 4.0) | {"metres_per_unit": 1e-3}, spp=4)
    np.testing.assert_allclose(film, np.broadcast_to([0.5, math.sqrt(0.5), 1.0], film.shape), rtol=2e-5)


@pytest.mark.parametrize("kind", [{"kind": "dielectric", "alpha": 0.05}, {"kind": "principled", "transmission": 1.0}])
def test_rough_glass_absorbs(kind):
    body = {**kind, "index": 1.5, "absorption_per_m": [0.0, 1.0, 3.0]}
    scene = scene_of([{**SPHERE, "material": body}], looking([0, -3, 0], [0, 0, 0], 10), environment=WHITE)
    film = pixels(scene, spp=16)
    red, green, blue = film.mean((0, 1))
    assert red > 1.5 * green > 2 * blue


def test_pane_from_behind_is_the_same_beside_glass_that_absorbs():
    pane = {"kind": "thin_glass", "transmittance": [1.0, 0.5, 0.1]}
    behind = {"shape": "rectangle", "corner": [-1, 0, -1], "edge_u": [0, 0, 2], "edge_v": [2, 0, 0], "material": pane}
    films = []
    for absorption in (0.0, 1.0):
        ball = {**SPHERE, "center": [9, 0, 0], "material": {"kind": "dielectric", "absorption_per_m": absorption}}
        scene = scene_of([behind, ball], looking([0, -3, 0], [0, 0, 0], 10), environment=WHITE)
        films.append(pixels(scene, spp=4))
    np.testing.assert_allclose(films[1], films[0], rtol=1e-6)


@pytest.mark.parametrize("degrees", [slow(0), slow(60), 80])
def test_pane_passes_what_all_its_reflections_leave(degrees):
    # through the pane one sees a lamp-white half world, off the pane the black other half
    cosine = math.cos(math.radians(degrees))
    inside = math.sqrt(1 - (1 - cosine**2) / 1.5**2)
    s, p = (cosine - 1.5 * inside) / (cosine + 1.5 * inside), (1.5 * cosine - inside) / (1.5 * cosine + inside)
    r = (s**2 + p**2) / 2
    t = np.array([1.0, 0.5, 0.1]) ** (1 / inside)
    expected = (1 - r) ** 2 * t / (1 - r**2 * t**2)
    pane = {"kind": "thin_glass", "transmittance": [1.0, 0.5, 0.1]}
    plane = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": pane}
    lamp = {"shape": "plane", "point": [0, 0, -1], "normal": [0, 0, 1], "material": {"kind": "emissive", "radiance": 1}}
    angle = math.radians(degrees)
    eye = [-math.sin(angle), 0, math.cos(angle)]
    scene = scene_of([plane, lamp], looking(eye, [0, 0, 0], 0.001, up=(0, 1, 0)), depth=3)
    mean, error = flat_mean(scene, f"pane {degrees}", spp=256)
    assert_equivalent(mean, error, expected, 0.01)


@pytest.mark.parametrize("factor", [slow(0.0), 1.0])
def test_mix_of_all_or_nothing_is_its_part(factor):
    mix = {"kind": "mix", "materials": [PLASTIC, GOLD], "factor": factor}
    same(ball(mix), ball(GOLD if factor else PLASTIC))


def test_mix_is_the_mean_of_its_parts_where_light_is_scattered_once():
    parts = [batches(ball(material, 2), f"part {name}", 4, spp=32) for name, material in (("a", PLASTIC), ("b", GOLD))]
    names = {"plastic": PLASTIC, "gold": GOLD}
    mixed = {"kind": "mix", "materials": ["plastic", "gold"], "factor": 0.3}
    mix = batches(ball(mixed, 2, materials=names), "mix", 8, spp=32)
    blend = type(mix)(
        0.7 * parts[0].mean + 0.3 * parts[1].mean, 0.49 * parts[0].variance + 0.09 * parts[1].variance, parts[0].freedom
    )
    assert_same_tiles(mix, blend)
    with pytest.raises(AssertionError):
        assert_same_tiles(mix, parts[0])


def test_mix_by_a_texture_is_its_parts_side_by_side():
    board = {"kind": "checker", "even": 0.0, "odd": 1.0, "scale": [4, 4]}
    dark, light = ({"kind": "matte", "reflectance": value} for value in (0.1, 0.9))
    mixed = {"kind": "mix", "materials": [dark, light], "factor": board}
    checked = {"kind": "matte", "reflectance": {**board, "even": 0.1, "odd": 0.9}}
    same(ball(mixed), ball(checked))


def test_textured_numbers_are_as_constant_ones():
    keys = {"metallic": 0.4, "roughness": 0.3}
    plain = {"kind": "principled", "base_color": [0.7, 0.3, 0.1], "anisotropy": 0.5}
    textured = {key: constant(value) for key, value in keys.items()}
    isotropic = {key: value for key, value in plain.items() if key != "anisotropy"}
    same(ball(isotropic | keys), ball(isotropic | textured))
    # energy of brushed facets is by a table of their own alphas, or by one for all alphas of textures
    same(ball(plain | keys), ball(plain | textured), rtol=TABLES_APART)


@pytest.mark.parametrize(
    "keys",
    one_in(
        3,
        [
            {"clearcoat_roughness": 0.5},
            {"clearcoat": 0.75, "clearcoat_roughness": 0.25},
            {"sheen": [0.5, 0.25, 1]},
            {"specular": 0.5, "specular_color": [0.25, 1, 0.5]},
            {"transmission": 0.75},
        ],
    ),
)
def test_textures_of_layers_are_as_constant_ones(keys):
    plain = {"kind": "principled", "base_color": [0.7, 0.3, 0.1], "roughness": 0.6, "clearcoat": 0.5, "index": 2}
    same(ball(plain | keys), ball(plain | {key: constant(value) for key, value in keys.items()}))


@pytest.mark.parametrize(
    ("key", "values"),
    one_in(
        3,
        [
            ("clearcoat", (0, 1)),
            ("clearcoat_roughness", (0.05, 0.6)),
            ("sheen", (0, [0.9, 0.6, 0.3])),
            ("specular", (0.1, 1)),
            ("specular_color", (1, [0.9, 0.3, 0])),
            ("transmission", (0.1, 0.9)),
        ],
    ),
)
def test_texture_of_a_layer_is_both_of_its_values_side_by_side(key, values):
    plain = {"kind": "principled", "base_color": 0.1, "roughness": 0.6, "clearcoat": 1, "clearcoat_roughness": 0.2}
    plain |= {"clearcoat": 0, "roughness": 0.2, "index": 3} if key.startswith("specular") else {}
    plain |= {"base_color": 0.8} if key == "transmission" else {}
    board = {"kind": "checker", "scale": [4, 4], **dict(zip(("even", "odd"), values, strict=True))}
    halves = [{**plain, key: value} for value in values]
    stripes = {"kind": "checker", "even": 0.0, "odd": 1.0, "scale": [4, 4]}
    a = batches(ball({**plain, key: board}, 2), f"{key} by a texture", 4, spp=16)
    b = batches(ball({"kind": "mix", "materials": halves, "factor": stripes}, 2), f"{key} by a mix", 4, spp=16)
    assert_same_tiles(a, b)
    c = batches(ball(halves[0], 2), f"{key} everywhere", 4, spp=16)
    with pytest.raises(AssertionError):
        assert_same_tiles(a, c)


BRUSHED = {"kind": "conductor", "reflectance": [0.9, 0.7, 0.5]}


def test_brushed_metal_turned_by_a_right_angle_has_its_alphas_exchanged():
    plain, other = ({**BRUSHED, "alpha": alphas} for alphas in ([0.5, 0.1], [0.1, 0.5]))
    a = batches(ball(plain, 2), "exchanged", 4, spp=32)
    assert_same_tiles(a, batches(ball({**other, "anisotropy_rotation_degrees": 90}, 2), "turned", 4, spp=32))
    with pytest.raises(AssertionError):
        assert_same_tiles(a, batches(ball(other, 2), "not turned", 4, spp=32))


@pytest.mark.parametrize("mirrored", [1, slow(-1)])
def test_brushed_metal_turns_from_u_towards_v(mirrored):
    def sheet(u_degrees, turn):
        along, across = (math.radians(angle) for angle in (u_degrees, u_degrees + 90 * mirrored))
        u, v = (np.array([20 * math.cos(angle), 20 * math.sin(angle), 0]) for angle in (along, across))
        material = {**BRUSHED, "alpha": [0.4, 0.1], "anisotropy_rotation_degrees": turn}
        board = {"shape": "rectangle", "corner": (-(u + v) / 2).tolist(), "edge_u": u.tolist(), "edge_v": v.tolist()}
        camera = looking([0, -2, 3], [0, 0, 0], fov=40)
        return scene_of([{**board, "material": material}], camera, depth=2, lights=[LAMP], environment=SKY)

    same(sheet(0, 30 * mirrored), sheet(30, 0))
    with pytest.raises(AssertionError):
        same(sheet(0, -30 * mirrored), sheet(30, 0))


def test_metallic_principled_is_the_conductor_but_for_schlick():
    # at F0 = 1 Schlick's reflectance is 1 at every angle
    shiny = {"kind": "principled", "base_color": 1.0, "metallic": 1.0, "roughness": 0.4}
    a = batches(ball(shiny), "principled metal", 4, spp=16)
    b = batches(ball({"kind": "conductor", "reflectance": 1.0, "roughness": 0.4}), "conductor", 4, spp=16)
    assert_same_tiles(a, b)


@pytest.mark.slow
def test_plain_conductor_does_not_change_beside_every_other_material():
    metal = {"kind": "conductor", "reflectance": [0.9, 0.6, 0.3], "alpha": 0.2}
    others = [
        PLASTIC, GOLD, {"kind": "dielectric", "alpha": 0.3, "absorption_per_m": 1}, {"kind": "thin_glass"},
        {**PLASTIC, "alpha": 0.3}, {"kind": "conductor", "reflectance": 1, "alpha": [0.1, 0.4]}, {"kind": "mirror"},
        {"kind": "principled", "transmission": 0.5, "clearcoat": 1.0, "roughness": constant(0.5)},
    ]  # fmt: skip
    a = batches(ball(metal, crowd=[]), "alone", 4, spp=16)
    b = batches(ball(metal, crowd=others), "in a crowd", 4, spp=16)
    assert_same_tiles(a, b)


@pytest.mark.slow
def test_glowing_surface_lights_as_a_lamp_does():
    panel = {"shape": "rectangle", "corner": [-1, -1, 2], "edge_u": [0, 2, 0], "edge_v": [2, 0, 0]}
    black = {"kind": "principled", "base_color": 0.0, "specular": 0.0}
    camera = looking([0.4, -3.4, 1.2], [0, 0, -0.1], fov=60)

    def lit(material):
        return scene_of([{**panel, "material": material}, {**SPHERE, "material": PLASTIC}, FLOOR], camera, depth=4)

    lamp = batches(lit({"kind": "emissive", "radiance": [3, 2, 1]}), "lamp", 4, spp=32)
    assert_same_tiles(lamp, batches(lit({**black, "emission": [3, 2, 1]}), "glow", 4, spp=32))
    # a texture is met by chance only, and has the same mean
    textured = batches(lit({**black, "emission": constant(0.5)}), "pattern", 4, spp=128)
    grey = batches(lit({"kind": "emissive", "radiance": 0.5}), "grey lamp", 4, spp=32)
    assert_same_tiles(textured, grey)


def normal_picture(path, normal):
    """Write a picture of one normal of the tangent frame; return what its bytes hold of it."""
    code = np.round((np.asarray(normal) + 1) / 2 * 255).astype(np.uint8)
    Image.fromarray(np.broadcast_to(code, (4, 4, 3)).copy()).save(path)
    held = code / 255 * 2 - 1
    return held / np.linalg.norm(held)


@pytest.mark.parametrize("shape", ["rectangle", "mirrored mesh", slow("mesh")])
def test_normal_map_turns_the_normal_in_the_frame_of_u_and_v(tmp_path, monkeypatch, shape):
    monkeypatch.chdir(tmp_path)
    held = normal_picture(tmp_path / "normal.png", [0.3, 0.5, math.sqrt(1 - 0.34)])
    # u runs along y and v along -x: the map's red and green must follow
    corners = [[2, -2, 0], [2, 2, 0], [-2, 2, 0], [-2, -2, 0]]
    surface = {"shape": "rectangle", "corner": corners[0], "edge_u": [0, 4, 0], "edge_v": [-4, 0, 0]}
    along_v = np.array([-1, 0, 0])
    if shape != "rectangle":
        uvs = [[0, 0], [1, 0], [1, 1], [0, 1]]
        if shape == "mirrored mesh":
            uvs, along_v = [[u, -v] for u, v in uvs], -along_v
        surface = {"shape": "mesh", "vertices": corners, "faces": [[0, 1, 2], [0, 2, 3]], "uvs": uvs}
    material = MATTE | {"normal_map": {"file": "normal.png"}}
    towards = np.array([0.4, 0.5, 0.8])
    light = {"kind": "directional", "direction": (-towards).tolist(), "irradiance": [math.pi] * 3}
    scene = scene_of([surface | {"material": material}], looking([0, 0, 3], [0, 0, 0], up=(0, 1, 0)), depth=2,
                     lights=[light])  # fmt: skip
    world = held[0] * np.array([0, 1, 0]) + held[1] * along_v + held[2] * np.array([0, 0, 1])
    expected = world @ towards / np.linalg.norm(towards)
    np.testing.assert_allclose(pixels(scene, spp=4), expected, rtol=1e-4)


def test_highlights_of_a_brushed_floor_turn_with_its_coordinates():
    def floor(corner, u, v, alpha):
        metal = {"kind": "conductor", "reflectance": 0.9, "alpha": alpha}
        rectangle = {"shape": "rectangle", "corner": corner, "edge_u": u, "edge_v": v, "material": metal}
        return scene_of([rectangle], looking([0.5, -3, 2], [0, 0, 0]), depth=2, lights=[LAMP])

    along_x = floor([-2, -2, 0], [4, 0, 0], [0, 4, 0], [0.1, 0.5])
    same(along_x, floor([2, -2, 0], [0, 4, 0], [-4, 0, 0], [0.5, 0.1]))
    with pytest.raises(AssertionError):
        same(along_x, floor([2, -2, 0], [0, 4, 0], [-4, 0, 0], [0.1, 0.5]))


@pytest.mark.parametrize("shape", ["ellipsoid", "box", *map(slow, ("sphere", "cylinder"))])
def test_tangents_of_shapes_run_along_u(tmp_path, monkeypatch, shape):
    # a map that leans along u alone, seen head on, under a light from where u grows and from where it falls
    monkeypatch.chdir(tmp_path)
    held = normal_picture(tmp_path / "lean.png", [0.5, 0, math.sqrt(0.75)])
    up = {"shape": "cylinder", "base": [0, 0, -1], "top": [0, 0, 1], "radius": 1}
    body = {
        "sphere": SPHERE, "ellipsoid": {**SPHERE, "transform": [{"scale": [1, 1, 2]}]}, "cylinder": up,
        "box": {"shape": "box", "min": [-1, -1, -1], "max": [1, 1, 1]},
    }[shape]  # fmt: skip
    material = MATTE | {"normal_map": {"file": "lean.png"}}
    means = []
    for side in (1, -1):
        light = {"kind": "directional", "direction": [-side, 1, 0], "irradiance": [math.pi] * 3}
        camera = looking([0, -5, 0], [0, 0, 0], fov=0.01)
        scene = scene_of([body | {"material": material}], camera, depth=2, lights=[light])
        means.append(pixels(scene, spp=4).mean())
    # at (0, -1, 0) u runs along +x: round the axes from +x over +y, and along x on the face of a box
    expected = [(held[2] + side * held[0]) / math.sqrt(2) for side in (1, -1)]
    np.testing.assert_allclose(means, expected, rtol=2e-3)


def test_flat_normal_map_changes_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Image.fromarray(np.full((2, 2, 3), [128, 128, 255], np.uint8)).save(tmp_path / "flat.png")
    bumpy = PLASTIC | {"normal_map": {"file": "flat.png", "strength": 0.0}}
    same(ball(bumpy), ball(PLASTIC))


@pytest.mark.slow
def test_bumpy_white_body_neither_wins_light_nor_has_black_fringes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    Image.fromarray(rng.integers(0, 256, (32, 32, 3), np.uint8)).save(tmp_path / "wild.png")
    for kind in ({"kind": "matte", "reflectance": 1.0}, {"kind": "conductor", "reflectance": 1.0, "alpha": 0.3}):
        bumpy = {**kind, "normal_map": {"file": "wild.png", "scale": [8, 8]}}
        camera = looking([0, -3, 0], [0, 0, 0], 38)
        scene = scene_of([{**SPHERE, "material": bumpy}], camera, depth=2, environment=WHITE)
        film = pixels(scene, seed=seed_of("wild"), spp=64)
        # the second scattering of facets is sampled by itself: 1.01 with 64 samples, 1.00005 with 8192
        assert film.max() <= (1.02 if kind["kind"] == "conductor" else 1 + 1e-4)
        # what a wild map sends into the surface is left out; without bending normals the metal keeps half its light
        assert film.min() > 0.2
        assert film.mean() > 0.65


GOLDEN = (1 + 5**0.5) / 2
CORNERS = [[s * p[i] for i in order] for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0]) for p in (
    (0, 1, GOLDEN), (0, -1, GOLDEN)) for s in (1, -1)]  # fmt: skip


def icosahedron():
    """A mesh of twenty faces with the normals of a sphere: as coarse as can be."""
    corners = np.array(CORNERS) / math.hypot(1, GOLDEN)
    near = np.linalg.norm(corners[:, None] - corners, axis=2) < 1.1
    triples = [(i, j, k) for i in range(12) for j in range(i) for k in range(j)]
    faces = [(i, j, k) for i, j, k in triples if near[i, j] and near[j, k] and near[i, k]]
    outward = [[i, j, k] if np.linalg.det(corners[[i, j, k]]) > 0 else [i, k, j] for i, j, k in faces]
    return {"shape": "mesh", "vertices": corners.tolist(), "faces": outward, "normals": "smooth"}


@pytest.mark.parametrize(("kind", "least"), [slow("mirror", 1 - 1e-5), ("plastic", 0.98), ("matte", 0.97)])
def test_white_body_of_twenty_faces_has_no_black_rims(kind, least):
    material = {"kind": kind} | ({} if kind == "mirror" else {"reflectance": 1.0})
    body = icosahedron() | {"material": material}
    scene = scene_of([body], looking([0.3, -3, 0.4], [0, 0, 0], 34), depth=20, environment=WHITE)
    film = pixels(scene, seed=seed_of("rims"), spp=64)
    assert film.mean() > least
    assert film.min() > 0.7


def test_materials_side_by_side_are_those_far_apart():
    """Lanes of one work item meet both; what one takes for itself must not reach the other."""
    rough = {"kind": "plastic", "reflectance": [0.6, 0.2, 0.1], "alpha": 0.3}
    gloss = {"kind": "principled", "base_color": [0.2, 0.5, 0.7], "roughness": 0.4}

    def picture(left, right):
        halves = [
            {"shape": "box", "min": [x, -2, -1], "max": [x + 2, 2, 0], "material": material}
            for x, material in ((-2.5, left), (-0.5, right))
        ]
        specks = [{**SPECK, "material": material} for material in (rough, gloss)]
        camera = looking([0, -0.4, 3], [0, 0, 0], up=[0, 1, 0])
        return pixels(scene_of([*halves, *specks], camera, depth=2, resolution=(8, 8), environment=SKY), seed=1)

    both = picture(rough, gloss)
    np.testing.assert_array_equal(both[:, :2], picture(rough, rough)[:, :2])
    np.testing.assert_array_equal(both[:, 3:], picture(gloss, gloss)[:, 3:])
    assert np.abs(both[:, :2].mean((0, 1)) - both[:, 3:].mean((0, 1))).min() > 0.05
