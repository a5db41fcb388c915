"""Thin films: what a smooth ball in even light reflects, against the characteristic matrix of the film in float64."""

import numpy as np
import pytest

from rptcam_cl.core.colour import WAVELENGTHS_NM, srgb_from_reflectance
from tests.rendering.layers.scenes import one_sample
from tests.rendering.pictures import looking, scene_of, seed_of

SKY = {"kind": "constant", "radiance": 1.0}


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
    return srgb_from_reflectance(total)


def index_of(reflectance):
    return (1 + np.sqrt(reflectance)) / (1 - np.sqrt(reflectance))


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
def test_a_film_reflects_as_its_characteristic_matrix_says(keys, bases):
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
    expected = np.clip(expected, 0, 1)
    assert np.ptp(expected[:, 2]) > 0.1
    off = np.abs(np.asarray(image)[seen][clear] - expected)
    # facets of alpha 0.001 stand askew by chance, one ray in a thousand by far more than that
    assert off.mean() < 5e-4 and np.quantile(off, 0.99) < 4e-3, (off.mean(), np.quantile(off, 0.99), off.max())
