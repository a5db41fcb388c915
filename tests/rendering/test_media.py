"""Light in media: closed forms and quadrature in float64 of what they absorb, emit and scatter, and furnaces."""

from functools import partial

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering import tracer
from rptcam_cl.rendering.plan import media
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.media import Droplets
from tests.rendering.pictures import WHITE, bits, flat_mean, looking, pixels, scene_of, seed_of
from tests.support.cases import one_in, slow
from tests.support.statistics import assert_equivalent

ABSORPTION, SCATTERING, ASYMMETRY = np.array([0.05, 0.02, 0.01]), np.array([0.1, 0.2, 0.3]), 0.5
FOG = {"absorption_per_m": ABSORPTION.tolist(), "scattering_per_m": SCATTERING.tolist(), "asymmetry": ASYMMETRY}
BLACK = {"kind": "matte", "reflectance": 0.0}
WALL = {"shape": "plane", "point": [0, 5, 0], "normal": [0, -1, 0], "material": BLACK}
EYE = looking([0, 0, 0], [0, 1, 0], fov=20)
BALL = {"shape": "sphere", "center": [0, 0, 0], "radius": 1}


def henyey_greenstein(g, cosine):
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def directions(fov, count):
    """Unit directions spread evenly over the film of a camera like `EYE`."""
    half = np.tan(np.radians(fov / 2))
    x, z = np.meshgrid(*[((np.arange(count) + 0.5) / count * 2 - 1) * half] * 2)
    d = np.stack([x.ravel(), np.ones(count**2), z.ravel()], axis=1)
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def scattered_once(lamps, intensity, phase_of=lambda cosine: henyey_greenstein(ASYMMETRY, cosine), share_of=None):
    """Mean radiance that fog before the wall scatters once from points of light, by Gauss's quadrature.

    ``share_of`` is what a lamp of a number sends in a direction.
    """
    nodes, weights = np.polynomial.legendre.leggauss(200)
    d = directions(20, 48)
    length = 5 / d[:, 1]
    t = length[:, None] * (nodes + 1) / 2
    total = np.zeros(3)
    for number, lamp in enumerate(lamps):
        to = np.array(lamp) - t[..., None] * d[:, None]
        r = np.linalg.norm(to, axis=-1)
        phase = phase_of(np.einsum("ijk,ik->ij", to, d) / r)
        phase *= 1 if share_of is None else share_of(number, -to / r[..., None])
        left = np.exp(-(ABSORPTION + SCATTERING) * (t + r)[..., None])
        each = SCATTERING * left * (phase / r**2 * weights * length[:, None] / 2)[..., None]
        total += intensity * each.sum(axis=1).mean(axis=0)
    return total


NOISE = 1e-3  # five standard errors of the mean of 1024 pixels
LAMPS = [[1.6, 2.5, 0.3], [-1.4, 1.0, 0.9], [0.2, 4.0, -1.8]]


def fog_of_points(lamps, **rest):
    lights = [{"kind": "point", "position": at, "intensity": 1.0} for at in lamps]
    return scene_of([WALL], EYE, depth=2, medium=FOG, lights=lights, **rest)


def test_fog_scatters_light_of_points_once_as_quadrature_does():
    mean = pixels(fog_of_points(LAMPS), seed=seed_of("points in fog"), spp=256).mean(axis=(0, 1))
    np.testing.assert_allclose(mean, scattered_once(LAMPS, 1.0), rtol=NOISE)


# Position, axis and angle of spots: across the view, along it from aside and from behind, towards it, and a wide one.
SPOTS = [
    ([1.6, 2.5, 0.3], [-1, 0.2, -0.1], 15), ([-1.4, 1.0, 0.9], [0.5, 1, -0.3], 40),
    ([0.2, -0.5, -0.1], [0, 1, 0.1], 20), ([0.3, 4.8, 0.2], [-0.1, -1, 0], 12), ([-1.5, 3.0, 0.2], [1, 0, 0.1], 120),
]  # fmt: skip


@pytest.mark.parametrize("number", one_in(2, range(len(SPOTS))))
def test_fog_scatters_the_beam_of_a_spot_once_as_quadrature_does(number):
    position, axis, angle = SPOTS[number]
    light = {"kind": "spot", "position": position, "direction": axis, "outer_degrees": angle, "inner_degrees": 0}

    def share(_, way):
        outer = np.cos(np.radians(angle))
        x = np.clip((way @ axis / np.linalg.norm(axis) - outer) / (1 - outer), 0, 1)
        return x * x * (3 - 2 * x)

    scene = fog_of_points([]) | {"lights": [light | {"intensity": 1.0}]}
    mean = pixels(scene, seed=seed_of("beam in fog"), spp=256).mean(axis=(0, 1))
    np.testing.assert_allclose(mean, scattered_once([position], 1.0, share_of=share), rtol=3 * NOISE)


def test_thin_beam_is_seen_next_to_its_lamp_from_afar():
    lamp, half, cap = np.array([0, 40.0, 0]), np.tan(np.radians(0.4)), 1 - np.cos(np.radians(4))
    spot = {"kind": "spot", "position": lamp.tolist(), "direction": [1, 0.1, 0], "intensity": 1.0}
    lights = [spot | {"outer_degrees": 4, "inner_degrees": 3.999}]
    thin = {"absorption_per_m": 0.01, "scattering_per_m": 0.02, "asymmetry": ASYMMETRY}
    wall = WALL | {"point": [0, 60, 0]}
    scene = scene_of([wall], looking([0, 0, 0], [0, 1, 0], fov=0.8), depth=2, medium=thin, lights=lights)
    # Right of the pixels about the lamp, which have most of the noise.
    mean = pixels(scene, seed=seed_of("lamp afar"), spp=256)[:, 17:].sum() / 32**2 / 3
    # What each direction of the cone sends between the edges of these, over the solid angle of the picture.
    versine, turn = np.meshgrid((np.arange(30) + 0.5) / 30 * cap, (np.arange(60) + 0.5) / 60 * 2 * np.pi)
    axis, up = np.array([1, 0.1, 0]) / np.hypot(1, 0.1), np.array([0, 0, 1.0])
    sine = np.sqrt(versine * (2 - versine))
    across = np.cos(turn)[..., None] * up + np.sin(turn)[..., None] * np.cross(axis, up)
    ways = ((1 - versine)[..., None] * axis + sine[..., None] * across).reshape(-1, 3)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    near, far = (edge * 40 / (ways[:, 0] - edge * ways[:, 1]) for edge in (half / 16, half))
    r = near[:, None] + (far - near)[:, None] * (nodes + 1) / 2
    place = lamp + r[..., None] * ways[:, None]
    distance = np.linalg.norm(place, axis=-1)
    phase = henyey_greenstein(ASYMMETRY, -np.einsum("ijk,ik->ij", place, ways) / distance)
    light = 0.02 * phase * np.exp(-0.03 * (r + distance)) * distance / place[..., 1] ** 3
    total = (light * weights).sum(axis=1) @ (far - near) / 2 / len(ways) * 2 * np.pi * cap / (2 * half) ** 2
    np.testing.assert_allclose(mean, total, rtol=5 * NOISE)


@pytest.mark.slow
@pytest.mark.parametrize("spectrum", ["rgb", "spectral"])
def test_many_lamps_of_a_light_tree_light_fog_as_quadrature_does(spectrum):
    random = np.random.default_rng(3)
    lamps = (random.uniform([1.2, 0.2, -2], [3, 5, 2], (60, 3)) * random.choice([-1, 1], (60, 1)) ** [1, 0, 0]).tolist()
    scene = fog_of_points(lamps, spectrum=spectrum)
    mean = pixels(scene, seed=seed_of("tree in fog"), spp=512).mean(axis=(0, 1))
    # a spectrum between three channels is not theirs
    np.testing.assert_allclose(mean, scattered_once(lamps, 1.0), rtol=NOISE if spectrum == "rgb" else 0.05)


@pytest.mark.slow
def test_both_organisations_render_the_same_fog(monkeypatch):
    scene = fog_of_points(LAMPS[:2])
    films = []
    for organisation in ("stream", "passes"):
        monkeypatch.setattr(tracer, "ORGANISATION", dict.fromkeys(tracer.ORGANISATION, organisation))
        films.append(bits(rptcam_cl.render(scene, spp=4, seed=1)))
    assert films[0] == films[1]


def ball_of(medium, material=None, **rest):
    interior = {"interior": medium}
    ball = BALL | {"material": (material or {"kind": "boundary"}) | interior}
    return scene_of([ball], looking([0, -3, 0], [0, 0, 0], fov=0.2), resolution=(8, 8), **rest)


def test_ball_absorbs_as_its_thickness_does():
    absorption = np.array([0.3, 0.7, 2.0])
    film = pixels(ball_of({"absorption_per_m": absorption.tolist()}, environment=WHITE), spp=4)
    np.testing.assert_allclose(film.mean(axis=(0, 1)), np.exp(-2 * absorption), rtol=2e-4)  # rays are not all central


def test_ball_emits_what_its_thickness_lets_out():
    absorption, emission = np.array([0.0, 0.7, 2.0]), np.array([1.0, 2.0, 0.5])
    medium = {"absorption_per_m": absorption.tolist(), "emission_per_m": emission.tolist()}
    film = pixels(ball_of(medium), spp=4)
    thickness = [2.0, *(1 - np.exp(-2 * absorption[1:])) / absorption[1:]]
    np.testing.assert_allclose(film.mean(axis=(0, 1)), emission * thickness, rtol=2e-4)


WAX = {"color": [0.2, 0.5, 0.8], "free_path_mm": [2, 4, 8]}


def wax_of(color):
    """A ball of a medium of a colour, hardly of glass, in a white world."""
    ball = BALL | {"radius": 0.3, "material": {"kind": "dielectric", "index": 1.01, "interior": WAX | {"color": color}}}
    return scene_of([ball], looking([0, -3, 0], [0, 0, 0], fov=14), environment=WHITE, depth=60)


def checker(first, second):
    """A pattern of quarters round a ball."""
    return {"kind": "checker", "even": first, "odd": second, "scale": [4, 1]}


@pytest.mark.slow
def test_medium_takes_its_colour_from_the_texture_where_light_enters(monkeypatch):
    """Of one colour the texture is that colour; of two each quarter of a ball looks as if all of it had its own."""
    one, other = WAX["color"], [0.8, 0.1, 0.4]
    plain, same, second = (pixels(wax_of(color), spp=16, seed=4) for color in (one, checker(one, one), other))
    np.testing.assert_allclose(same, plain, rtol=1e-5, atol=1e-5)
    film = pixels(wax_of(checker(one, other)), spp=16, seed=4)
    left, right = np.s_[10:22, 8:13], np.s_[10:22, 19:24]
    first_side, second_side = (left, right) if film[left][..., 0].mean() < film[right][..., 0].mean() else (right, left)
    np.testing.assert_allclose(film[first_side], plain[first_side], rtol=1e-5)
    np.testing.assert_allclose(film[second_side], second[second_side], rtol=1e-5)
    monkeypatch.setattr(tracer, "ORGANISATION", dict.fromkeys(tracer.ORGANISATION, "passes"))
    np.testing.assert_array_equal(pixels(wax_of(checker(one, other)), spp=16, seed=4), film)


@pytest.mark.parametrize("asymmetry", [slow(0.0), 0.8])
def test_ball_that_only_scatters_vanishes_in_a_white_world(asymmetry):
    scene = ball_of({"scattering_per_m": 3.0, "asymmetry": asymmetry}, environment=WHITE, depth=400)
    # the same in every channel, so that each sample is 1, but for the few of more than 400 edges
    film = pixels(scene, spp=16, seed=seed_of(str(asymmetry)))
    np.testing.assert_allclose(film, 1, rtol=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("material", [{"kind": "boundary"}, {"kind": "dielectric", "index": 1.3}])
@pytest.mark.parametrize("spectrum", ["rgb", "spectral", "dispersive"])
def test_coloured_ball_that_only_scatters_vanishes_in_a_white_world(material, spectrum):
    medium = {"scattering_per_m": [1.0, 2.0, 4.0], "asymmetry": 0.3}
    scene = ball_of(medium, material, environment=WHITE, depth=400, spectrum=spectrum)
    mean, error = flat_mean(scene, f"{material} {spectrum}", spp=8192)
    assert_equivalent(mean, error, 1.0, 0.015)


def droplets(diameter):
    """The phase function of droplets of 5 to 50 micrometres by Jendersie and d'Eon (2023)."""
    g, alpha = np.exp(-2.20679 / (diameter + 3.91029) - 0.428934), np.exp(3.62489 - 8.29288 / (diameter + 5.52825))
    share = np.exp(-0.599085 / (diameter - 0.641583) - 0.665888)

    def phase(cosine):
        draine = henyey_greenstein(g, cosine) * (1 + alpha * cosine**2) / (1 + alpha * (1 + 2 * g**2) / 3)
        forwards = henyey_greenstein(np.exp(-0.0990567 / (diameter - 1.67154)), cosine)
        return (1 - share) * forwards + share * draine

    return phase


def test_mean_cosine_of_droplets_is_that_of_their_phase_function():
    s, weights = np.polynomial.legendre.leggauss(100)
    s = (s + 1) / 2
    nodes, weights = 1 - 2 * s**4, weights * 4 * s**3  # dense where droplets scatter, forwards: good to 1e-11
    for diameter in (5.0, 12.0, 50.0):
        phase = droplets(diameter)(nodes) * weights * 2 * np.pi
        np.testing.assert_allclose([phase.sum(), phase @ nodes], [1, Droplets.of(diameter).mean_cosine], rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("diameter", [5, 20])
def test_droplets_scatter_light_of_points_once_as_quadrature_does(diameter):
    of_droplets = droplets(diameter)
    expected = scattered_once(LAMPS, 1.0, of_droplets)
    fog = {key: FOG[key] for key in ("absorption_per_m", "scattering_per_m")} | {"droplets_um": diameter}
    mean = pixels(fog_of_points(LAMPS) | {"medium": fog}, seed=seed_of("droplets"), spp=512).mean(axis=(0, 1))
    np.testing.assert_allclose(mean, expected, rtol=2 * NOISE)


@pytest.mark.parametrize("diameter", [None, slow(5), slow(20)])
def test_ball_scatters_the_sky_once_as_quadrature_does(diameter):
    """Of a gradient of radiance z / 2 + 1 / 2 over directions, which phase sampling alone finds."""
    medium = {"scattering_per_m": 0.4} | ({"asymmetry": 0.6} if diameter is None else {"droplets_um": diameter})
    phase = partial(henyey_greenstein, 0.6) if diameter is None else droplets(diameter)
    sky = {"kind": "gradient", "bottom": 0.0, "top": 1.0, "up": [0, 1, 0]}
    mean, error = flat_mean(ball_of(medium, environment=sky, depth=2), "sky in a ball", spp=16384)
    t_nodes, t_weights = np.polynomial.legendre.leggauss(60)
    c_nodes, c_weights = np.polynomial.legendre.leggauss(200 if diameter is None else 2000)
    total = np.exp(-0.8) * 1.0  # straight on, towards +y
    for t, weight in zip(t_nodes + 1, t_weights, strict=True):
        at = t - 1  # on the axis
        way = -at * c_nodes + np.sqrt(1 - at**2 * (1 - c_nodes**2))
        scattered = 2 * np.pi * phase(c_nodes) * np.exp(-0.4 * way) * (0.5 + 0.5 * c_nodes)
        total += weight * 0.4 * np.exp(-0.4 * t) * (scattered * c_weights).sum()
    assert_equivalent(mean, error, total, 4e-3)


@pytest.mark.slow
@pytest.mark.parametrize("layer", [None, {"scale_height_m": 0.8, "base": 0.5}])
def test_beams_give_what_paths_that_meet_them_by_chance_give(layer):
    fog = {"scattering_per_m": [0.25, 0.3, 0.35], "absorption_per_m": 0.05, "asymmetry": 0.5, "layer": layer}
    spots = [([-1.5, 1.2, 0.5], [1, 0.02, -0.15], 25, 40), ([1.5, 3, -1], [-0.3, -1, 0.3], 35, 12)]
    names = ("position", "direction", "outer_degrees", "intensity")
    lights = [{"kind": "spot"} | dict(zip(names, spot, strict=True)) for spot in spots]
    glass = {"kind": "dielectric", "index": 1.5, "roughness": 0.3}
    plastic = {"kind": "plastic", "reflectance": 0.5, "roughness": 0.4}
    objects = [
        {"shape": "plane", "point": [0, 0, 0], "normal": [0, 1, 0], "material": {"kind": "matte", "reflectance": 0.6}},
        BALL | {"center": [0.6, 1, 0.3], "radius": 0.4, "material": plastic},
        BALL | {"center": [-0.8, 0.5, 0.8], "radius": 0.4, "material": glass},
    ]
    # Where there is a boundary, if only of nothing and out of sight, paths have but chance.
    away = BALL | {"center": [0, 1, 90], "material": {"kind": "boundary", "interior": {}}}
    camera = looking([0, 1.2, 4], [0, 1, 0], fov=60) | {"up": [0, 1, 0]}
    found = []
    for number, each in enumerate((objects, [*objects, away])):
        scene = scene_of(each, camera, lights=lights, depth=4, medium=fog)
        seeds = [seed_of(f"beams {number} {place}") for place in range(8)]
        found.append(np.array([pixels(scene, seed=seed, spp=512).mean(axis=(0, 1)) for seed in seeds]))
    (own, noise), (other, chance) = ((each.mean(axis=0), each.std(axis=0, ddof=1) / 8**0.5) for each in found)
    assert_equivalent(own - other, np.hypot(noise, chance), 0, 0.03 * other)


@pytest.mark.slow
def test_boundary_alone_is_not_there():
    empty = {"interior": {}}
    objects = [
        BALL | {"material": {"kind": "boundary"} | empty},
        {
            "shape": "plane",
            "point": [0, 0, -1.5],
            "normal": [0, 0, 1],
            "material": {"kind": "matte", "reflectance": 0.5},
        },
    ]
    lights = [{"kind": "point", "position": [0, 0, 3], "intensity": 5.0}]
    camera = looking([0, -4, 1], [0, 0, 0])
    with_it = scene_of(objects, camera, lights=lights, depth=3)
    without = scene_of(objects[1:], camera, lights=lights, depth=3)
    layers = ["depth", "object_id"]
    one, other = (rptcam_cl.render(scene, spp=4, seed=5, layers=layers) for scene in (with_it, without))
    np.testing.assert_allclose(np.asarray(one), np.asarray(other), rtol=2e-5)
    np.testing.assert_array_equal(one.layers["depth"], other.layers["depth"])


@pytest.mark.slow
def test_fog_dims_a_wall_of_light_behind_a_lens():
    """Rays from a lens in the middle of a glowing ball go the same way through fog, but for the size of the lens."""
    camera = {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 5}} | {
        key: EYE[key] for key in ("eye", "target", "up")
    }
    wall = BALL | {"radius": 10, "material": {"kind": "emissive", "radiance": 1.0, "two_sided": True}}
    scene = scene_of([wall], camera, depth=1, exposure="relative")
    clear = pixels(scene, spp=64)
    foggy = pixels(scene | {"medium": {"absorption_per_m": [0.05, 0.1, 0.2]}}, spp=64)
    ratio = (foggy.mean(axis=(0, 1)) / clear.mean(axis=(0, 1))).tolist()
    np.testing.assert_allclose(ratio, np.exp(-10 * np.array([0.05, 0.1, 0.2])), rtol=0.2 * 0.1)  # 0.1 m of way


def test_camera_in_a_ball_looks_through_what_fills_it():
    water = BALL | {"radius": 2, "material": {"kind": "boundary", "interior": {"absorption_per_m": 0.5}}}
    scene = scene_of([water], looking([0, 1, 0], [0, 2, 0], fov=0.5), environment=WHITE, resolution=(8, 8))
    np.testing.assert_allclose(pixels(scene, spp=1).mean(), np.exp(-0.5), rtol=1e-4)


def layer_of(absorption, low, high):
    """A box of a medium across the z axis, or all below a height."""
    material = {"kind": "boundary", "interior": {"absorption_per_m": absorption}}
    if low is None:
        return {"shape": "plane", "point": [0, 0, high], "normal": [0, 0, 1], "material": material}
    return {"shape": "box", "min": [-9, -9, low], "max": [9, 9, high], "material": material}


ACROSS = {"kind": "orthographic", "width_m": 4} | {key: EYE[key] for key in ("eye", "target", "up")}
UP = looking([0, 0, -1], [0, 0, 1], up=[0, 1, 0], fov=0.1)


def test_light_samples_are_left_out_where_glass_stops_them_all(monkeypatch):
    milk = BALL | {
        "material": {"kind": "dielectric", "interior": {"scattering_per_m": [4, 5, 6], "absorption_per_m": 0.1}}
    }
    lamp = {"shape": "sphere", "center": [0.2, 0, 0.1], "radius": 0.2, "material": {"kind": "emissive", "radiance": 5}}
    above = lamp | {"center": [0, 0, 3]}
    open_milk = milk | {"material": milk["material"] | {"kind": "boundary"}}
    cases = {
        1: [[milk, above]],
        0: [
            [milk, lamp],
            [milk, above | {"radius": 2.5}],
            [open_milk, above],
            [milk | {"visible": {"shadow": False}}, above],
        ],
    }
    for marked, scenes in cases.items():
        for objects in scenes:
            scene = scene_of(objects, looking([0, -4, 1], [0, 0, 0], fov=40), depth=40, resolution=(32, 32))
            assert make_plan(rptcam_cl.load_scene(scene)).media.records["in_shade"][1:].tolist() == [marked], objects
    scene = scene_of([milk, above], looking([0, -4, 1], [0, 0, 0], fov=40), depth=40, resolution=(32, 32))
    left_out = pixels(scene, spp=4)
    monkeypatch.setattr(media, "_mark_shade", lambda *_: None)
    np.testing.assert_array_equal(pixels(scene, spp=4), left_out)


def test_walks_in_shade_miss_nothing_nearer_than_where_they_scatter(monkeypatch):
    """Milk round a white ball keeps no light in a white world; a step that misses a surface never comes out."""
    milk = BALL | {"material": {"kind": "dielectric", "index": 1.2, "interior": {"scattering_per_m": 4}}}
    inner = BALL | {"center": [0.3, 0, 0.2], "radius": 0.4, "material": {"kind": "matte", "reflectance": 1.0}}
    eye = looking([0, -4, 1], [0, 0, 0], fov=22)
    scene = scene_of([milk, inner], eye, depth=2000, resolution=(16, 16), environment=WHITE)
    left = pixels(scene, spp=4)
    np.testing.assert_allclose(left, 1, rtol=1e-5)  # the same in every channel, so that each sample is 1
    monkeypatch.setattr(media, "_mark_shade", lambda *_: None)
    np.testing.assert_array_equal(pixels(scene, spp=4), left)


def test_rays_lose_what_media_on_their_way_take():
    """From the near plane in a sea, through two boxes that overlap, where the last entered counts, and many more."""
    objects = [layer_of(0.5, None, 0), layer_of(0.2, 1, 4), layer_of(0.3, 2, 6)]
    objects += [layer_of(0.02, z, z + 0.5) for z in range(7, 107)]
    scene = scene_of(objects, UP | {"near_m": 0.25}, environment=WHITE, resolution=(8, 8))
    assert pixels(scene, spp=1).mean() == pytest.approx(np.exp(-0.5 * 0.75 - 0.2 * 1 - 0.3 * 4 - 1), rel=1e-5)


def test_medium_before_a_lens_is_that_of_its_front():
    """The film lies outside of the box, and the front of the lens inside."""
    lens = {
        "kind": "realistic",
        "lens": "dgauss-50mm",
        "focus": {"distance_m": 5},
        "eye": [0, 0, 0],
        "target": [0, 0, 1],
    }
    film = {"resolution": [8, 8], "width_mm": 1}
    scene = scene_of([layer_of(0.5, 0.03, 3)], lens | {"up": [0, 1, 0]}, environment=WHITE, exposure="relative")
    assert pixels(scene | {"film": film}, spp=8).mean() == pytest.approx(np.exp(-0.5 * 2.9), rel=0.03)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"film": {"transparent": True, "resolution": [8, 8]}}, "film.transparent: does not go with media"),
        ({"render": {"caustics": "on"}}, "render.caustics: does not go with media"),
        ({"medium": {"emission_per_m": 1}}, "medium.emission_per_m: shines without end"),
        ({"medium": {"visibility_m": 10, "scattering_per_m": 1}}, "visibility_m"),
        ({"medium": {"albedo": 0.5}}, "needs visibility_m"),
        ({"medium": WAX | {"color": checker(0.1, 0.2)}}, "medium.color: is a texture, but paths do not enter here"),
        (wax_of(checker(0.1, 0.2)) | {"camera": EYE}, "camera.eye: lies in a medium whose color is a texture"),
        ({"medium": FOG, "objects": [BALL | {"material": {"kind": "dielectric", "opacity": 0.5}}]}, "holes"),
        ({"objects": [layer_of(0.1, 0, 4), layer_of(0.1, 1, 3)] * 3}, "objects.0: lies in 5 other solids"),
        ({"objects": [wax_of(checker(0.1, share))["objects"][0] for share in (0.2, 0.3)]}, "color is a texture"),
        ({"objects": [layer_of(0.1, -0.5, 0.5)], "camera": ACROSS}, "camera: its rays begin in different media"),
    ],
)
def test_what_does_not_go_with_media_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        rptcam_cl.render(fog_of_points(LAMPS) | change, spp=1)


def test_visibility_leaves_a_twentieth_of_light():
    medium = rptcam_cl.load_scene(fog_of_points(LAMPS) | {"medium": {"visibility_m": 40, "albedo": [0.5, 1, 0]}}).medium
    extinction = np.add(medium.scattering, medium.absorption)
    np.testing.assert_allclose(np.exp(-40 * extinction), 0.05)
    np.testing.assert_allclose(np.divide(medium.scattering, extinction), [0.5, 1, 0])
