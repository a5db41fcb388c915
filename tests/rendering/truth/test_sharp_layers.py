"""Sharp layers: of the chief rays, so that they lie where the picture shows things; against closed forms."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import StateError
from rptcam_cl.rendering.cameras.chief_rays import seen_places
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.scene.load import load_scene
from tests.support.cases import slow

GREY = {"kind": "matte", "reflectance": 0.5}
POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
PINHOLE = {"kind": "pinhole", "fov_degrees": 40} | POSE
GLASS = {"kind": "realistic", "lens": "dgauss-50mm", "f_number": 2.8, "focus": {"distance_m": 2}} | POSE
SKY = {"kind": "constant", "radiance": 1.0}


def panel(z: float, half: float, x: float = 0.0, **rest: Any) -> dict[str, Any]:
    """A square that faces the camera."""
    edges = {"corner": [x - half, -half, z], "edge_u": [2 * half, 0, 0], "edge_v": [0, 2 * half, 0]}
    return {"shape": "rectangle", "material": GREY} | edges | rest


CHECKS = {"kind": "checker", "even": 0.3, "odd": 0.8, "scale": [4, 4]}
# Behind the camera, so that one program does for all worlds.
SPECKS = [
    {"shape": "sphere", "center": [0, 0, 9], "radius": 0.1, "material": GREY | {"opacity": CHECKS}},
    {"shape": "mesh", "vertices": [[0, 0, 9], [1, 0, 9], [0, 1, 9]], "faces": [[0, 1, 2]], "material": GREY},
    panel(9.0, 0.1),
]


def world(camera: dict[str, Any], *objects: dict[str, Any], **rest: Any) -> dict[str, Any]:
    shown = {"film": {"resolution": [48, 32]}, "camera": camera, "objects": [*objects, *SPECKS], "environment": SKY}
    return shown | rest


@pytest.mark.parametrize("camera", [PINHOLE, slow(GLASS)], ids=["pinhole", "lens"])
def test_depth_of_a_flat_wall_is_flat_to_1e_minus_5(camera: dict[str, Any]) -> None:
    wall = panel(-5.0, 9.0)
    image = rptcam_cl.render(world(camera, wall), spp=1, layers=["sharp_depth", "sharp_position", "sharp_normal"])
    assert np.abs(image["sharp_depth"] - 5.0).max() < 1e-5
    assert np.abs(image["sharp_position"][..., 2] + 5.0).max() < 1e-5
    np.testing.assert_array_equal(image["sharp_normal"], np.broadcast_to([0, 0, 1], (32, 48, 3)))


@pytest.mark.parametrize("kind", ["mesh", *map(slow, ("rectangle", "sphere"))])
def test_surfaces_with_holes_are_there_from_an_opacity_of_one_half_on(kind: str) -> None:
    """Not here and there at random, as rays of the picture find them."""
    wall, names = panel(-6.0, 9.0), ["sharp_object_id", "sharp_depth"]
    veil = panel(-2.0, 0.4)
    if kind == "mesh":
        corners = [[-0.4, -0.4, -2], [0.4, -0.4, -2], [0.4, 0.4, -2], [-0.4, 0.4, -2]]
        veil = {"shape": "mesh", "vertices": corners, "faces": [[0, 1, 2, 3]]}
    elif kind == "sphere":
        veil = {"shape": "sphere", "center": [0, 0, -2], "radius": 0.4}
    tangent = np.tan(np.radians(20)) / 24
    x, y = np.meshgrid((np.arange(48) - 23.5) * tangent, (15.5 - np.arange(32)) * tangent)
    inside = (
        np.hypot(x, y) < np.tan(np.arcsin(0.2)) if kind == "sphere" else (np.abs(2 * x) < 0.4) & (np.abs(2 * y) < 0.4)
    )
    for opacity, there in ((0.5, True), (0.75, True), (0.45, False), (0.05, False)):
        thin = veil | {"material": GREY | {"opacity": opacity}}
        image = rptcam_cl.render(world(PINHOLE, thin, wall), spp=1, layers=names)
        np.testing.assert_array_equal(image["sharp_object_id"], np.where(inside & there, 0, 1))
        assert (image["sharp_depth"] < 3).sum() == inside.sum() * there


def test_textured_holes_end_where_opacity_is_one_half() -> None:
    veil = panel(-2.0, 0.4) | {"material": GREY | {"opacity": CHECKS}}
    image = rptcam_cl.render(world(PINHOLE, veil, panel(-6.0, 9.0)), spp=1, layers=["sharp_object_id"])
    tangent = np.tan(np.radians(20)) / 24
    x, y = np.meshgrid((np.arange(48) - 23.5) * tangent, (15.5 - np.arange(32)) * tangent)
    u, v = 2 * x / 0.8 + 0.5, 2 * y / 0.8 + 0.5
    odd = (np.floor(4 * u) + np.floor(4 * v)) % 2 == 1
    inside = (np.abs(u - 0.5) < 0.5) & (np.abs(v - 0.5) < 0.5)
    np.testing.assert_array_equal(image["sharp_object_id"], np.where(inside & odd, 0, 1))


def test_sharp_layers_of_a_pinhole_are_those_of_the_middles_of_its_pixels() -> None:
    near, far = panel(-3.0, 0.5, name="near", label="card"), panel(-6.0, 1.0, x=0.6, name="far")
    names = ["sharp_object_id", "sharp_class_id", "sharp_depth", "ray_origin", "ray_direction", "occlusion"]
    image = rptcam_cl.render(world(PINHOLE, near, far), spp=1, layers=names)
    tangent = np.tan(np.radians(20)) / 24
    x, y = np.meshgrid((np.arange(48) - 23.5) * tangent, (15.5 - np.arange(32)) * tangent)
    in_near = (np.abs(3 * x) < 0.5) & (np.abs(3 * y) < 0.5)
    in_far = (np.abs(6 * x - 0.6) < 1.0) & (np.abs(6 * y) < 1.0)
    ids = np.where(in_near, 0, np.where(in_far, 1, -1))
    np.testing.assert_array_equal(image["sharp_object_id"], ids)
    np.testing.assert_array_equal(image["sharp_class_id"], np.where(in_near, 1, 0))
    assert image.metadata["class_names"] == ["", "card"]
    assert image.metadata["object_classes"][:2] == [1, 0]
    np.testing.assert_allclose(image["sharp_depth"], np.select([in_near, in_far], [3.0, 6.0], np.inf), rtol=1e-6)
    away = np.stack([x, y, -np.ones_like(x)], axis=-1)
    np.testing.assert_allclose(image["ray_direction"], away / np.linalg.norm(away, axis=-1, keepdims=True), atol=1e-12)
    assert not image["ray_origin"].any()
    hidden = (in_near & in_far).sum() / in_far.sum()
    assert image.metadata["occlusion"][:2] == [0.0, pytest.approx(hidden)]
    np.testing.assert_allclose(image["occlusion"], np.select([in_near, in_far], [0.0, hidden], np.nan), rtol=1e-6)


def test_sharp_layers_of_a_mesh_lie_on_it() -> None:
    corners = [[-2, -1, -2], [2, -1, -6], [2, 1, -6], [-2, 1, -2]]  # a wall aslant: z = -4 - x
    wall = {"shape": "mesh", "vertices": corners, "faces": [[0, 1, 2], [0, 2, 3]], "material": GREY}
    image = rptcam_cl.render(world(PINHOLE, wall), spp=1, layers=["sharp_position", "sharp_depth"])
    tangent = np.tan(np.radians(20)) / 24
    x, y = np.meshgrid((np.arange(48) - 23.5) * tangent, (15.5 - np.arange(32)) * tangent)
    depth = 4 / (1 - x)  # of the middles of the pixels
    on_wall = (np.abs(x * depth) < 2) & (np.abs(y * depth) < 1)
    expected = np.where(on_wall[..., None], np.stack([x * depth, y * depth, -depth], axis=-1), np.nan)
    np.testing.assert_allclose(image["sharp_position"], expected, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(image["sharp_depth"], np.where(on_wall, depth, np.inf), rtol=1e-5)
    assert 0 < on_wall.sum() < on_wall.size


def test_occlusion_counts_whole_solids_once_and_says_none_of_what_is_out_of_the_picture() -> None:
    ball = {"shape": "sphere", "center": [0, 0, -4], "radius": 0.5, "material": GREY}
    behind = panel(-9.0, 0.2, name="behind the ball")
    beside = panel(-5.0, 0.2, x=50.0)
    image = rptcam_cl.render(world(PINHOLE, ball, behind, beside), spp=1, layers=["occlusion"])
    assert image.metadata["occlusion"][:3] == [0.0, 1.0, None]


@pytest.mark.slow
def test_sharp_places_are_where_the_lens_draws_small_lamps() -> None:
    # A lens stopped down draws them at the place of the chief ray; the picture is lit by nothing else.
    camera = GLASS | {"f_number": 16}
    points = np.array([[0.0, 0.0, -2.0], [0.5, 0.3, -2.0], [-0.55, -0.36, -2.0]])
    lamps = [
        {"shape": "sphere", "center": place, "radius": 0.004, "material": {"kind": "emissive", "radiance": 1.0}}
        for place in points.tolist()
    ]
    film = {"resolution": [240, 160]}
    scene = world(camera, *lamps, film=film, environment={"kind": "constant", "radiance": 0.0})
    light = np.asarray(rptcam_cl.render(scene, spp=64))[..., 1].astype(np.float64)
    seen = seen_places(camera_of(load_scene(scene)).chief_rays(), np.hstack([points, np.ones((3, 1))]))
    rows, columns = np.indices(light.shape) + 0.5
    for column, row in seen:
        near = light * (np.hypot(columns - column, rows - row) < 6)
        centre = np.array([(near * columns).sum(), (near * rows).sum()]) / near.sum()
        assert np.abs(centre - (column, row)).max() < 0.05


def test_what_no_chief_ray_meets_is_empty() -> None:
    layers = ["sharp_depth", "sharp_position", "sharp_normal", "sharp_object_id", "sharp_material_id", "occlusion"]
    image = rptcam_cl.render(world(PINHOLE, panel(-5.0, 0.5)), spp=1, layers=layers)
    assert image["sharp_depth"][0, 0] == np.inf
    assert np.isnan(image["sharp_position"][0, 0]).all()
    assert not image["sharp_normal"][0, 0].any()
    assert image["sharp_object_id"][0, 0] == image["sharp_material_id"][0, 0] == -1
    assert np.isnan(image["occlusion"][0, 0])


ALL_SHARP = [
    "sharp_depth", "sharp_position", "sharp_normal", "sharp_object_id", "sharp_material_id", "sharp_class_id",
    "occlusion", "flow_forward", "flow_backward", "motion", "ray_origin", "ray_direction",
]  # fmt: skip


def test_parts_by_tiles_have_the_layers_of_one_run_to_the_byte(tmp_path: Path) -> None:
    scene = world(PINHOLE, {**panel(-5.0, 0.5), "label": "panel"}, panel(-7.0, 2.0))
    options: dict[str, Any] = {"size": (21, 13), "spp": 3, "layers": [*ALL_SHARP, "crypto_object", "crypto_material"]}
    parts = [tmp_path / f"{number}.rpck" for number in (1, 2, 3)]
    for number, path in enumerate(parts, 1):
        rptcam_cl.render(scene, part=f"{number}/3", checkpoint=path, **options)
    rptcam_cl.render(scene, **options).save(tmp_path / "whole.exr")
    merged = rptcam_cl.merge(parts, checkpoint=tmp_path / "all.rpck")
    merged.save(tmp_path / "merged.exr")
    assert (tmp_path / "merged.exr").read_bytes() == (tmp_path / "whole.exr").read_bytes()
    assert merged.metadata["class_names"] == ["", "panel"]
    again = rptcam_cl.render(scene, resume=True, checkpoint=tmp_path / "all.rpck", **options | {"spp": 5})
    for name, layer in rptcam_cl.render(scene, **options | {"spp": 5}).layers.items():
        np.testing.assert_array_equal(again[name], layer)


@pytest.mark.slow
def test_ranges_of_samples_add_up_the_coverage_of_each_object(tmp_path: Path) -> None:
    scene = world(PINHOLE, *(panel(-4.0 - k, 0.2 * (k + 1)) for k in range(3)))
    options: dict[str, Any] = {"size": (21, 13), "layers": ["crypto_object", "sharp_depth"]}
    parts = [tmp_path / f"{first}.rpck" for first in (0, 5, 9)]
    for path, samples in zip(parts, ((0, 5), (5, 9), (9, 16)), strict=True):
        rptcam_cl.render(scene, samples=samples, checkpoint=path, **options)
    whole, merged = rptcam_cl.render(scene, spp=16, **options), rptcam_cl.merge(parts)
    np.testing.assert_array_equal(merged["sharp_depth"], whole["sharp_depth"])
    np.testing.assert_array_equal(merged["crypto_object"][..., ::2], whole["crypto_object"][..., ::2])
    np.testing.assert_allclose(merged["crypto_object"][..., 1::2], whole["crypto_object"][..., 1::2], rtol=3e-7)
    mixed = np.count_nonzero(whole["crypto_object"][..., 1::2], axis=-1)
    assert mixed.max() >= 2


def test_a_saved_state_without_its_sharp_layers_is_refused_by_its_name(tmp_path: Path) -> None:
    scene, path = world(PINHOLE, panel(-5.0, 0.5)), tmp_path / "whole.rpck"
    rptcam_cl.render(scene, spp=2, layers=["sharp_depth"], checkpoint=path, should_stop=lambda: True)
    with pytest.raises(StateError, match=r"whole.rpck: was saved whole, or .* merge the layer sharp_depth"):
        rptcam_cl.merge([path])
