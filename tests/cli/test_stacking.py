"""Focus stacking against what a pinhole sees and the depth that rays find; parts of the opening by a thin lens."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.api.combined import _blend, dual_pixels, focus_stack, focusing_screen, resized
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.image import read_film
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene

FLOOR = """
film: {resolution: [180, 120]}
camera:
  kind: thin_lens
  focal_length_mm: 85
  f_number: 2
  eye: [0, 0.35, 0]
  target: [0, -0.1, -2]
  focus_distance_m: 2
render: {spp: 32}
objects:
  - shape: rectangle
    corner: [-3, -0.4, 0]
    edge_u: [6, 0, 0]
    edge_v: [0, 0.9, -4]
    material: {kind: matte, reflectance: {kind: checker, odd: 0.2, even: 0.8, scale: [140, 100]}}
environment: {kind: constant, radiance: 1}
"""


FLAT = {
    "film": {"resolution": [90, 60]}, "render": {"spp": 1}, "environment": {"kind": "constant", "radiance": 1},
    "camera": {"kind": "pinhole", "fov_degrees": 40, "eye": [0, 0, 0], "target": [0, 0, -1]},
}  # fmt: skip


def test_stack_is_as_sharp_as_a_pinhole_and_its_depth_is_that_of_rays(rptcam, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "floor.yaml"
    path.write_text(FLOOR, "utf-8")
    run = rptcam("stack", "floor.yaml", "--near-m", "1.25", "--far-m", "3", "-o", "sharp.npz", "-o", "sharp.png")
    assert run.code == 0, run.err
    stack = read_film("sharp.npz")
    near = set_keys(load_scene(path), {"camera.focus_distance_m": 1.25})
    once = rptcam_cl.render(near, layers=("sharp_depth",))
    pinhole = rptcam_cl.render(set_keys(near, {"camera.f_number": 64}))
    truth = once["sharp_depth"]
    assert truth.min() > 1.25
    assert truth.max() < 3
    inner = (slice(6, -6), slice(6, -6))
    off = np.abs(np.load("sharp.npz")["depth"] / truth - 1)[inner]
    assert np.median(off) < 0.02  # a pixel of blur is 8 % at 2 m
    assert np.percentile(off, 90) < 0.06

    def missed(image):
        return np.sqrt(np.mean((image.pixels - pinhole.pixels)[inner] ** 2))

    def steps(image):
        return np.abs(np.diff(image.luminance[inner], axis=1)).mean()

    assert missed(stack) < 0.3 * missed(once)
    assert steps(stack) == pytest.approx(steps(pinhole), rel=0.1)
    assert stack.metadata["focus_stack"]["pictures"] == stack.metadata["focus_stack"]["needed"]


@pytest.mark.slow
def test_films_that_are_rendered_already_are_stacked_by_their_own_focus(rptcam, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("floor.yaml").write_text(FLOOR, "utf-8")
    scene = load_scene("floor.yaml")
    distances = [2.0, 1.3, 1.5, 1.75, 2.4]
    for distance, seed in [(each, seed) for each in distances for seed in (0, 1)]:
        near = set_keys(scene, {"camera.focus_distance_m": distance, "render.spp": 16, "render.seed": seed})
        rptcam_cl.render(near).save(f"{distance}-{seed}.exr")
    films = sorted(map(str, Path().glob("*.exr")))
    run = rptcam("stack", "floor.yaml", "-o", "sharp.npz", "--films", *films)
    assert run.code == 0, run.err
    near = set_keys(scene, {"camera.focus_distance_m": 1.3})
    truth = rptcam_cl.render(near, spp=1, layers=("sharp_depth",))["sharp_depth"]
    depth = np.load("sharp.npz")["depth"]
    inner = (truth > 1.35) & (truth < 2.3)
    assert np.median(np.abs(depth / truth - 1)[inner]) < 0.04  # half a pixel of blur
    for words, message in (
        (["--films", *films[:2]], "focused at 1 distances"),
        (["--near-m", "1"], "takes --near-m and --far-m, or --films"),
    ):
        assert message in rptcam("stack", "floor.yaml", "-o", "sharp.npz", *words).err


def test_noise_is_no_depth():
    rng = np.random.default_rng(1)
    flat = rptcam_cl.render(FLAT)
    noisy = [replace(flat, pixels=rng.gamma(0.5, 2.0, flat.pixels.shape).astype(np.float32)) for _ in range(20)]
    known = _blend(zip(noisy[::2], noisy[1::2], strict=True), [1.0] * 10)[3]
    assert known.mean() < 0.02


def test_pictures_are_drawn_larger_about_their_middle():
    y, x = np.mgrid[:41, :61]

    def wave(scale):
        return np.sin((x - 30) / scale / 3) * np.cos((y - 20) / scale / 4)

    drawn = resized(np.repeat(wave(1.0)[..., None], 3, axis=2), 1.1)
    assert drawn[..., 1] == pytest.approx(wave(1.1), abs=2e-3)  # the error of the cubic: (1/3)^4 / 10 and less


def test_what_cannot_be_stacked_is_refused(tmp_path):
    path = tmp_path / "floor.yaml"
    path.write_text(FLOOR, "utf-8")
    for arguments, message in (
        ({"near_m": 3, "far_m": 1}, "need 0 < near < far"),
        ({"near_m": 1, "far_m": 2, "steps": 2}, "steps: is out of range"),
        ({"near_m": 0.1, "far_m": 2}, "cannot focus at 100 mm"),
    ):
        with pytest.raises(InputError, match=message):
            focus_stack(path, **arguments)


# Parts of the opening, by a thin lens of radius R = f / 2N with its film at v: what is sharp at w is seen through the
# point X of the lens at X (1 - v / w) beside where the centre sees it.

STRIP = {
    "film": {"resolution": [360, 240], "size_mm": [36, 24]},
    "camera": {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 1.4, "focus_distance_m": 4,
               "eye": [0, 0, 0], "target": [0, 0, -1]},
    "render": {"spp": 32},
    "objects": [{"shape": "rectangle", "corner": [-0.005, -2, -1.5], "edge_u": [0.01, 0, 0], "edge_v": [0, 4, 0],
                 "material": {"kind": "emissive", "radiance": 1}}],
}  # fmt: skip
FLOOR_OF_LENS = {
    "film": {"resolution": [120, 80], "size_mm": [36, 24]}, "render": {"spp": 16},
    "environment": {"kind": "constant", "radiance": 1}, "objects": [
        {"shape": "sphere", "center": [0, 0, -3], "radius": 0.3, "material": {"kind": "matte", "reflectance": 0.5}}],
    "camera": {"kind": "realistic", "lens": "dgauss-50mm", "f_number": 2.8, "focus": {"distance_m": 4},
               "aperture": {"shape": "polygon", "blades": 5}, "eye": [0, 0, 0], "target": [0, 0, -1]},
}  # fmt: skip
RADIUS_MM = 50 / 2.8
V, W = (1 / (1 / 50 - 1 / distance) for distance in (4000, 1500))


def middle_mm(rows):
    """Where the light of some rows lies to the right of their middle, in pixels of 0.1 mm."""
    light = rows.sum(axis=0)
    return (np.arange(len(light)) + 0.5 - len(light) / 2) @ light / light.sum() * 0.1


def test_dual_pixels_part_what_is_out_of_focus_by_the_middles_of_half_disks(rptcam, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("strip.yaml").write_text(json.dumps(STRIP), "utf-8")
    run = rptcam("halves", "strip.yaml", "--left", "l.exr", "--right", "r.exr", "--phase-pixels", "p.exr")
    assert run.code == 0, run.err
    left, right, masked = (read_film(f"{name}.exr") for name in "lrp")
    expected = 4 / (3 * math.pi) * RADIUS_MM * (V / W - 1)
    assert expected < -0.15  # a pixel is 0.1 mm
    assert middle_mm(left.luminance) == pytest.approx(-expected, abs=0.01)
    assert middle_mm(right.luminance) == pytest.approx(expected, abs=0.01)
    whole = rptcam_cl.render(STRIP)
    assert left.luminance.mean() == pytest.approx(whole.luminance.mean(), rel=5e-3)
    assert masked.pixels[4::8, 0::4] == pytest.approx(left.pixels[4::8, 0::4] / 2)
    assert masked.pixels[4::8, 2::4] == pytest.approx(right.pixels[4::8, 2::4] / 2)
    assert masked.pixels[0] == pytest.approx((left.pixels[0] + right.pixels[0]) / 2)


@pytest.mark.slow
def test_split_image_is_parted_by_the_cone_of_its_wedges_and_goes_dark_when_stopped_down():
    screen = focusing_screen(STRIP).luminance
    middle = slice(165, 195)  # columns within the circle of 3 mm
    upper, lower = (middle_mm(screen[rows, middle]) for rows in (slice(109, 120), slice(120, 131)))
    expected = 1.4 / 8 * RADIUS_MM * (V / W - 1)
    assert upper == pytest.approx(-expected, abs=0.02)
    assert lower == pytest.approx(expected, abs=0.02)
    assert upper > 0.05
    at_16 = focusing_screen(set_keys(load_scene(STRIP), {"camera.f_number": 16}))
    assert at_16.luminance[109:131, middle].max() == 0
    pinhole = {"kind": "pinhole", "fov_degrees": 40, "eye": [0, 0, 0], "target": [0, 0, -1]}
    with pytest.raises(InputError, match="no opening"):
        focusing_screen(set_keys(load_scene(STRIP), {"camera": pinhole}))


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["irradiance", "physical", "auto"])
def test_halves_are_as_bright_as_the_whole_in_every_mode_of_exposure(mode):
    scene = load_scene(FLOOR_OF_LENS | {"exposure": {"mode": mode}})
    whole = rptcam_cl.render(scene).luminance.mean()
    for part in (*dual_pixels(scene), focusing_screen(scene)):
        assert part.luminance.mean() == pytest.approx(whole, rel=0.01)
