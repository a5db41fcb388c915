"""Cryptomatte as another program reads it: by OpenImageIO, after the specification alone."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO
import pytest

import rptcam_cl
from rptcam_cl.imaging.writers import identifier, murmur3_32, name_hash, ranked
from tests.rendering.truth.test_sharp_layers import GREY, PINHOLE, SKY, panel

THIN = {"kind": "thin_lens", "fov_degrees": 40, "aperture_radius_m": 0.3, "focus_distance_m": 3} | {
    "eye": [0, 0, 0], "target": [0, 0, -1],
}  # fmt: skip


def read(path: Path) -> tuple[dict[str, dict[str, str]], dict[str, np.ndarray]]:
    """Return what the header says of each Cryptomatte, by its name, and every channel of a file."""
    file = OpenImageIO.ImageInput.open(str(path))
    assert file is not None, OpenImageIO.geterror()
    spec, pixels = file.spec(), np.asarray(file.read_image(OpenImageIO.FLOAT))
    file.close()
    entries: dict[str, dict[str, str]] = {}
    for attribute in spec.extra_attribs:
        if attribute.name.startswith("cryptomatte/"):
            _, key, word = attribute.name.split("/")
            entries.setdefault(key, {})[word] = attribute.value
    assert all(spec.channelformats[i] == OpenImageIO.FLOAT for i in range(len(spec.channelformats)))
    channels = {name: pixels[..., index] for index, name in enumerate(spec.channelnames)}
    for key, entry in entries.items():
        assert f"{murmur3_32(entry['name'].encode()):08x}"[:7] == key  # names of these layers are normal floats
    return {entry["name"]: entry for entry in entries.values()}, channels


def matte(path: Path, layer: str, name: str) -> np.ndarray:
    """The matte of a name as a compositing program draws it: the sum of the coverages of its identifier."""
    entries, channels = read(path)
    entry = entries[layer]
    assert (entry["hash"], entry["conversion"]) == ("MurmurHash3_32", "uint32_to_float32")
    wanted = np.frombuffer(int(json.loads(entry["manifest"])[name], 16).to_bytes(4, "little"), np.float32)[0]
    total, group = 0.0, 0
    while f"{layer}{group:02d}.R" in channels:
        r, g, b, a = (channels[f"{layer}{group:02d}.{letter}"] for letter in "RGBA")
        total = total + np.where(r == wanted, g, 0.0) + np.where(b == wanted, a, 0.0)
        group += 1
    assert group == 3
    return np.asarray(total)


def shares(scene: dict[str, Any]) -> np.ndarray:
    """The share of each pixel that each of three objects covers: they shine in red, green and blue."""
    objects = [
        item | {"material": {"kind": "emissive", "radiance": colour, "two_sided": True}}
        for colour, item in zip(np.eye(3).tolist(), scene["objects"], strict=True)
    ]
    dark = scene | {"objects": objects, "environment": {"kind": "constant", "radiance": 0.0}, "materials": {}}
    dark |= {"render": {"max_depth": 1}}
    return np.asarray(rptcam_cl.render(dark, spp=16))


def test_mattes_are_the_shares_of_the_light_that_objects_cover(tmp_path: Path) -> None:
    near, far = panel(-2.0, 0.3, x=-0.2, name="vorn: näher"), panel(-6.0, 1.5, x=0.6, name="far")
    ball = {"shape": "sphere", "center": [0.3, 0.2, -4], "radius": 0.4, "name": "ball", "material": "red"}
    scene: dict[str, Any] = {
        "film": {"resolution": [24, 16]}, "camera": THIN, "objects": [near, far, ball], "environment": SKY,
        "materials": {"red": {"kind": "matte", "reflectance": [0.8, 0.1, 0.1]}},
    }  # fmt: skip
    image = rptcam_cl.render(scene, spp=16, layers=["crypto_object", "crypto_material", "coverage"])
    path = tmp_path / "picture.exr"
    image.save(path)
    found = [matte(path, "crypto_object", name) for name in ("vorn: näher", "far", "ball")]
    np.testing.assert_allclose(np.stack(found, axis=-1), shares(scene), atol=2e-6)
    np.testing.assert_allclose(np.sum(found, axis=0), image["coverage"], atol=1e-6)
    assert max(float(each.max()) for each in found) <= 1 + 1e-6
    assert sum(bool(((each > 0.01) & (each < 0.99)).any()) for each in found) == 3
    np.testing.assert_array_equal(matte(path, "crypto_material", "red"), found[2])
    layer = image["crypto_object"]
    assert (np.diff(layer[..., 1::2], axis=-1) <= 0).all()  # most coverage first
    assert np.isfinite(layer).all()


@pytest.mark.slow
def test_objects_of_one_name_are_one_matte() -> None:
    scene = {
        "film": {"resolution": [8, 8]}, "camera": PINHOLE, "environment": SKY,
        "objects": [panel(-2.0, 0.5, x=x, name="twin", material=GREY) for x in (-0.5, 0.5)],
    }  # fmt: skip
    image = rptcam_cl.render(scene, spp=16, layers=["crypto_object", "coverage"])
    layer = image["crypto_object"]
    np.testing.assert_allclose(layer[..., 1], image["coverage"], atol=1e-6)
    assert not layer[..., 2:].any()
    assert set(np.unique(layer[..., 0]).tolist()) == {0.0, float(identifier("twin"))}


@pytest.mark.slow
def test_more_objects_than_a_pixel_keeps_apart_change_no_other_layer() -> None:
    width = 2 * 3.0 * np.tan(np.radians(20)) / 12
    strips = [panel(-3.0, width / 2, x=(k - 5.5) * width, name=f"strip {k}") for k in range(12)]
    strips = [strip | {"corner": [strip["corner"][0], -12, -3], "edge_v": [0, 24, 0]} for strip in strips]
    scene = {"film": {"resolution": [1, 8]}, "camera": PINHOLE | {"fov_axis": "horizontal"}, "environment": SKY,
             "objects": strips}  # fmt: skip
    others = ["object_id", "material_id", "uv"]
    image = rptcam_cl.render(scene, spp=64, layers=["crypto_object", *others])
    alone = rptcam_cl.render(scene, spp=64, layers=others)
    for name in others:
        np.testing.assert_array_equal(image[name], alone[name])
    assert (image["crypto_object"][..., -1] > 0).all()


@pytest.mark.parametrize(
    ("text", "seed", "expected"),
    [
        (b"", 0, 0), (b"", 1, 0x514E28B7), (b"test", 0, 0xBA6BD213), (b"Hello, world!", 0x9747B28C, 0x24884CBA),
        (b"aaaa", 0x9747B28C, 0x5A97808A), (b"aaa", 0x9747B28C, 0x283E0130), (b"aa", 0x9747B28C, 0x5D211726),
        (b"The quick brown fox jumps over the lazy dog", 0x9747B28C, 0x2FA826CD),
    ],
)  # fmt: skip
def test_murmur3_gives_published_values(text: bytes, seed: int, expected: int) -> None:
    assert murmur3_32(text, seed) == expected


def test_identifiers_are_normal_floats() -> None:
    # Of 20000 names about 156 hash to an exponent of all zeros or all ones.
    bits = np.array([name_hash(f"object {k}") for k in range(20_000)], np.uint32)
    plain = np.array([murmur3_32(f"object {k}".encode()) for k in range(20_000)], np.uint32)
    exponent = bits >> 23 & 0xFF
    assert ((exponent > 0) & (exponent < 255)).all()
    changed = bits != plain
    assert 100 < changed.sum() < 220
    assert set((bits ^ plain)[changed].tolist()) == {1 << 23}


def test_ranks_hold_the_largest_and_merge_names() -> None:
    owners = np.zeros((1, 1, 8, 2))
    owners[0, 0, :, 0], owners[0, 0, :, 1] = range(8), [0.05, 0.3, 0.1, 0.2, 0.02, 0.25, 0.05, 0.03]
    names = ["a", "b", "c", "d", "e", "a", "g", "h"]
    layer = ranked(owners, names)[0, 0]
    assert layer[::2].tolist() == [float(identifier(name)) for name in ("a", "b", "d", "c", "g", "h")]
    np.testing.assert_allclose(layer[1::2], [0.3, 0.3, 0.2, 0.1, 0.05, 0.03], rtol=1e-6)
