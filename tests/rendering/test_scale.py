"""A scene that is a power of two times as large gives the same picture to the bit, and so does one with so much more
light: neither a length nor a radiance stands in the code."""

import numpy as np
import pytest

from tests.rendering.pictures import looking, pixels, scene_of
from tests.support.cases import slow

LENGTHS = ("eye", "target", "corner", "edge_u", "edge_v", "center", "radius", "min", "max", "position")


def room(material, scale, light=1.0):
    """Return a scene of lamps of several shapes over a ball and a pane."""
    glass = {"kind": "dielectric", "index": 1.5, "absorption_per_m": [0.3, 0.1, 0.5]}
    lamp = {"kind": "emissive", "radiance": [3 * light, 2 * light, light]}
    objects = [
        {"shape": "rectangle", "corner": [-4, -4, 0], "edge_u": [8, 0, 0], "edge_v": [0, 8, 0], "material": {
            "kind": "matte", "reflectance": {"kind": "checker", "even": 0.8, "odd": 0.2, "scale": [9, 9]}}},
        {"shape": "sphere", "center": [-0.7, 0, 0.6], "radius": 0.6, "material": glass},
        {"shape": "box", "min": [0.3, -0.3, 0.1], "max": [0.9, 0.3, 0.7], "material": material},
        {"shape": "rectangle", "corner": [-2, 1.2, 0], "edge_u": [4, 0, 0], "edge_v": [0, 0.2, 1],
         "material": {"kind": "thin_glass", "transmittance": [0.9, 0.5, 0.7]}},
        {"shape": "rectangle", "corner": [-1, 2, 2], "edge_u": [2, 0, 0], "edge_v": [0, 0.5, -0.5], "material": lamp},
        {"shape": "sphere", "center": [1.5, -1, 2.5], "radius": 0.1, "material": lamp},
        {"shape": "disk", "center": [-1.5, -1, 2.5], "normal": [0, 0, -1], "radius": 0.2, "material": lamp},
    ]  # fmt: skip
    lights = [{"kind": "point", "position": [0, -2, 3], "intensity": [scale**2 * light] * 3}]
    glass["absorption_per_m"] = [each / scale for each in glass["absorption_per_m"]]
    camera = looking([0.5, -4, 1.6], [0, 0, 0.4], 40)
    for each in (camera, *objects, *lights):
        each |= {key: (np.array(each[key]) * scale).tolist() for key in LENGTHS if key in each}
    return scene_of(objects, camera, depth=9, resolution=(48, 32), lights=lights, environment={
        "kind": "constant", "radiance": [0.1 * light, 0.1 * light, 0.2 * light]})  # fmt: skip


@pytest.mark.parametrize("exponent", [-90, 80])
def test_light_of_any_unit_gives_the_same_bits(exponent):
    material = {"kind": "conductor", "metal": "gold", "roughness": 0.3}
    film = pixels(room(material, 1.0), spp=8)
    scaled = pixels(room(material, 1.0, 2.0**exponent), spp=8)
    assert film.min() > 0
    np.testing.assert_array_equal(np.ldexp(scaled, -exponent), film)


@pytest.mark.slow  # what they are made of adds to `test_world.py`, where the sizes are
@pytest.mark.parametrize(
    "material",
    [
        {"kind": "plastic", "reflectance": [0.6, 0.2, 0.1]},
        {"kind": "conductor", "metal": "gold", "roughness": 0.3},
        {"kind": "principled", "base_color": [0.6, 0.2, 0.1], "roughness": 0.4, "clearcoat": 1.0, "sheen": 0.5},
    ],
    ids=lambda material: material["kind"],
)
def test_scenes_of_any_size_give_the_same_bits(material):
    film = pixels(room(material, 1.0), spp=8)
    assert film.min() > 0
    for exponent in (-13, 20):
        np.testing.assert_array_equal(pixels(room(material, 2.0**exponent), spp=8), film)


def sheet(corners, scale, material, **keys):
    """Return two triangles with texture coordinates and normals."""
    uvs = [[0, 0], [1, 0], [1, 1], [0, 1]]
    points = (np.array(corners) * scale).tolist()
    faces = [[0, 1, 2], [0, 2, 3]]
    return {"shape": "mesh", "vertices": points, "faces": faces, "uvs": uvs, "material": material, **keys}


def sheets(scale, instance=1.0):
    """Return meshes: a lamp over a smooth floor and a brushed wall; ``instance`` of the scale is a transform."""
    brushed = {"kind": "conductor", "metal": "gold", "roughness": 0.3, "anisotropy": 0.8}
    own = scale / instance
    placed = {"transform": [{"scale": instance}]} if instance != 1.0 else {}
    objects = [
        sheet([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], own, MATTE, normals="smooth", **placed),
        sheet([[-1, 0.8, 0], [1, 0.8, 0], [1, 0.8, 0.5], [-1, 0.8, 0.5]], own, brushed, **placed),
        sheet([[-0.5, 0.5, 0.6], [0.5, 0.5, 0.6], [0.5, -0.5, 0.6], [-0.5, -0.5, 0.6]], own, LAMP, **placed),
    ]
    camera = looking((np.array([0.1, -0.9, 0.5]) * scale).tolist(), (np.array([0.1, 0.2, 0.0]) * scale).tolist(), 30)
    return scene_of(objects, camera, depth=2, resolution=(16, 16))


MATTE, LAMP = {"kind": "matte", "reflectance": 0.5}, {"kind": "emissive", "radiance": 1.0}


@pytest.mark.parametrize(
    ("exponent", "instance"), [(38, 0), (-38, -38), *(slow(*case) for case in ((34, 0), (34, 34), (-38, 0)))]
)
def test_meshes_of_any_size_within_the_limit_give_the_same_bits(exponent, instance):
    film = pixels(sheets(1.0), spp=16)
    np.testing.assert_array_equal(pixels(sheets(2.0**exponent, 2.0**instance), spp=16), film)


@pytest.mark.slow
def test_floor_of_a_mesh_under_a_lamp_of_ten_billion_metres_is_as_bright_as_the_integral():
    scale = 1e10
    x, y = np.meshgrid(*[(np.arange(400) + 0.5) / 400 - 0.5] * 2)
    squared = (x - 0.1) ** 2 + (y - 0.2) ** 2 + 0.6**2
    expected = 0.5 / np.pi * np.mean(0.6**2 / squared**2)  # of a square metre
    scene = sheets(scale)
    scene["objects"].pop(1)
    film = pixels(scene | {"film": {"resolution": [15, 15]}}, spp=4096)
    assert film[7, 7] == pytest.approx(expected, rel=0.02)
