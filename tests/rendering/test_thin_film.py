"""Thin films: their reflectance against the characteristic matrix in float64, and against what glTF has for it."""

import numpy as np
import pytest

from rptcam_cl.core.colour import WAVELENGTHS_NM, srgb_from_reflectance
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.plan.materials import FILM_COSINES, film_colours
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.materials import Principled
from tests.device.scattering import direction, scatter
from tests.rendering.layers.scenes import one_sample
from tests.rendering.pictures import looking, scene_of, seed_of

SKY = {"kind": "constant", "radiance": 1.0}
COSINES = np.linspace(0, 1, FILM_COSINES)


def stack(cosine, thickness_nm, index, base):
    """Unpolarised reflectance of a layer, by its characteristic matrix (Macleod, Thin-Film Optical Filters)."""
    sine2 = 1 - cosine[:, None] ** 2
    layer, behind = np.sqrt(1 - sine2 / index**2), np.sqrt(1 - sine2 / base**2)
    delta = 2 * np.pi * index * thickness_nm * layer / WAVELENGTHS_NM
    total = 0.0
    for power in (1, -1):
        air, own, last = cosine[:, None] ** power, index * layer**power, base * behind**power
        upper = np.cos(delta) + 1j * np.sin(delta) * last / own
        lower = last * np.cos(delta) + 1j * own * np.sin(delta)
        total = total + np.abs((air * upper - lower) / (air * upper + lower)) ** 2 / 2
    return np.clip(srgb_from_reflectance(total), 0, 1)


def gltf(cosine, thickness_nm, index, base):
    """The formula of KHR_materials_iridescence (Belcour and Barla 2017)."""

    def of_indices(a, b):
        return ((a - b) / (a + b)) ** 2

    def schlick(f0, c):
        return f0 + (1 - f0) * (1 - c) ** 5

    inside = np.sqrt(1 - (1 - cosine**2) / index**2)
    first, second = schlick(of_indices(index, 1.0), cosine), schlick(of_indices(base, index), inside)
    passed = 1 - first
    shift = np.pi + (np.pi if base < index else 0.0)
    both = np.clip(first * second, 1e-5, 0.9999)
    own = passed**2 * second / (1 - both)
    total = np.repeat((first + own)[:, None], 3, axis=1)
    part = own - passed
    into_rgb = np.array([[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560],
                         [0.0556434, -0.2040259, 1.0572252]])  # fmt: skip
    for order in (1, 2):
        part = part * np.sqrt(both)
        phase = (2 * np.pi * order * 2 * index * thickness_nm * 1e-9 * inside)[:, None]

        def lobe(height, place, width, phase=phase, order=order):
            wave = np.cos(place * phase + order * shift) * np.exp(-width * phase**2)
            return height * np.sqrt(2 * np.pi * width) * wave

        xyz = lobe(*np.array([[5.4856e-13, 4.4201e-13, 5.2481e-13], [1.6810e6, 1.7953e6, 2.2084e6],
                              [4.3278e9, 9.3046e9, 6.6121e9]]))  # fmt: skip
        xyz[:, :1] += lobe(9.7470e-14, 2.2399e6, 4.5282e9)
        total += part[:, None] * 2 * (xyz / 1.0685e-7) @ into_rgb.T
    return np.clip(total, 0, 1)


def index_of(reflectance):
    return (1 + np.sqrt(reflectance)) / (1 - np.sqrt(reflectance))


def filmed(thickness_nm, index, **keys):
    film = {"thickness_nm": thickness_nm, "index": index}
    return {"kind": "principled", "base_color": [0.9, 0.6, 0.3], "metallic": 1.0, "thin_film": film} | keys


@pytest.mark.parametrize("index", [1.0, 1.33, 2.2, 5.0])
@pytest.mark.parametrize("thickness_nm", [0, 3, 60, 250, 700, 2000, 20_000])
def test_a_film_reflects_as_its_characteristic_matrix_says(thickness_nm, index):
    material = Principled.model_validate(filmed(thickness_nm, index))
    dielectric, metal = film_colours(material, material.thin_film)
    inner = np.maximum(COSINES, 1e-6)
    np.testing.assert_allclose(dielectric, stack(inner, thickness_nm, index, 1.5), atol=1e-6)
    for channel, reflectance in enumerate((0.9, 0.6, 0.3)):
        of_channel = stack(inner, thickness_nm, index, index_of(reflectance))[:, channel]
        np.testing.assert_allclose(metal[:, channel], of_channel, atol=1e-6)


@pytest.mark.parametrize(("least_cosine", "most"), [(0.8, 0.025), (0.6, 0.07)])
def test_films_look_about_as_the_formula_of_gltf_says(least_cosine, most):
    # which has three broad sensitivities, two orders and Schlick's rise: further off the nearer to grazing
    clear = COSINES[least_cosine < COSINES]
    for thickness_nm in (150, 300, 450, 600):
        for index, base in ((1.3, 1.5), (1.8, 1.5), (1.3, 4.0)):
            off = np.abs(gltf(clear, thickness_nm, index, base) - stack(clear, thickness_nm, index, base))
            assert off.max() < most


def test_facets_reflect_by_the_table_of_the_film(session):
    material = filmed(420, 1.7, roughness=0.5, metallic=1.0)
    rng = np.random.default_rng(seed_of("facets"))
    wi, wo = (direction(rng.uniform(0.1, 1, 2048), rng.random(2048)) for _ in range(2))
    white = scatter(session, {"kind": "conductor", "reflectance": 1.0, "roughness": 0.5}, wi, wo).value
    got = scatter(session, material, wi, wo).value
    half = (wi + wo) / np.linalg.norm(wi + wo, axis=1, keepdims=True)
    cosine = np.sum(wi * half, axis=1)
    given = Principled.model_validate(material)
    _, metal = film_colours(given, given.thin_film)
    expected = np.stack([np.interp(cosine, COSINES, metal[:, k]) for k in range(3)], axis=1)
    assert np.ptp(expected, axis=0).min() > 0.1
    np.testing.assert_allclose(got, white * expected, rtol=1e-4, atol=1e-6)


def test_a_film_is_refused_where_it_cannot_lie():
    for keys in (
        {"metallic": 0.0, "transmission": 0.5},
        {"specular": {"kind": "noise", "low": 0.1, "high": 0.9}},
        {"base_color": {"kind": "noise", "low": 0.1, "high": 0.9}},
    ):
        with pytest.raises(InputError, match=r"thin_film: does not count here .*allowed: beside numbers for metallic"):
            load_scene(scene_of([], looking([0, -4, 0], [0, 0, 0]), materials={"oil": filmed(300, 1.4, **keys)}))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("keys", "bases"),
    [
        ({"base_color": 0.0, "index": 1.5, "thin_film": {"thickness_nm": 480, "index": 2.0}}, [1.5] * 3),
        (
            {"base_color": [0.9, 0.6, 0.3], "metallic": 1.0, "thin_film": {"thickness_nm": 320, "index": 1.4}},
            [index_of(0.9), index_of(0.6), index_of(0.3)],
        ),
    ],
)
def test_a_smooth_ball_in_even_light_shows_the_reflectance_of_its_film(keys, bases):
    material = {"kind": "principled", "roughness": 0.0, **keys}
    ball = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": material}
    scene = scene_of([ball], looking([0, -4, 0], [0, 0, 0], fov=30), depth=2, environment=SKY, resolution=(96, 96))
    image = one_sample(scene, ["position", "geometric_normal", "object_id"], seed=seed_of("film"))
    seen = image["object_id"] == 0
    towards = np.array([0, -4, 0]) - image["position"][seen]
    cosine = np.sum(towards * image["geometric_normal"][seen], axis=1) / np.linalg.norm(towards, axis=1)
    clear = cosine > 0.3  # nearer to the rim the facets of the least alpha blur the colours
    film = keys["thin_film"]
    expected = np.stack(
        [stack(cosine[clear], film["thickness_nm"], film["index"], base)[:, k] for k, base in enumerate(bases)], axis=1
    )
    assert np.ptp(expected[:, 2]) > 0.1
    off = np.abs(np.asarray(image)[seen][clear] - expected)
    # facets of alpha 0.001 stand askew by chance, one ray in a thousand by far more than that
    assert off.mean() < 5e-4 and np.quantile(off, 0.99) < 4e-3, (off.mean(), np.quantile(off, 0.99), off.max())
