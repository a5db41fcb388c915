"""Ghosts of lamps and suns that mirrors show to the lens, against those of lamps where their images are."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.optics.library import load_lens
from tests.device.probes import open_session
from tests.rendering.test_ghosts import ghosts_alone, scene

TILT = np.array([0.0, np.sin(np.radians(10)), np.cos(np.radians(10))])  # normal of the mirror
MIDDLE = np.array([0.0, -0.2, -1.5])
IMAGE = np.array([0.1, -0.45, -3.4])
LAMP = IMAGE - 2 * ((IMAGE - MIDDLE) @ TILT) * TILT  # behind the camera
BALL, RADIUS = np.array([0.1, -0.1, -1.0]), 0.02
SUN = np.array([0.2, 0.6, 0.5]) / np.linalg.norm([0.2, 0.6, 0.5])


def point(place: np.ndarray, intensity: float = 50.0) -> dict[str, Any]:
    return {"kind": "point", "position": place.tolist(), "intensity": [intensity] * 3}


def mirror(side: float = 1.2, **material: Any) -> dict[str, Any]:
    u, v = side * np.array([1.0, 0, 0]), side * np.cross(TILT, [1.0, 0, 0])
    corner = MIDDLE - (u + v) / 2
    return {"shape": "rectangle", "corner": corner.tolist(), "edge_u": u.tolist(), "edge_v": v.tolist(),
            "material": {"kind": "mirror"} | material}  # fmt: skip


def shown(light: dict[str, Any], *objects: dict[str, Any], distance_m: float = 2.0) -> rptcam_cl.Image:
    plain = {"render": {"spp": 1, "layers": ["ghosts"], "caustics": "off"}}  # photons would take kernels of their own
    return rptcam_cl.render(scene(light, objects=objects, focus={"distance_m": distance_m}) | plain)


def total(image: rptcam_cl.Image) -> np.ndarray:
    return np.asarray(image["ghosts"].sum(axis=(0, 1), dtype=np.float64))


@pytest.fixture(scope="module")
def mirrored() -> rptcam_cl.Image:
    return shown(point(LAMP), mirror())


def test_a_world_without_objects_has_the_ghosts_of_its_lamp() -> None:
    bare, beside_one = (
        ghosts_alone(open_session(), scene(point(IMAGE), objects=objects, focus={"distance_m": 2.0}))
        for objects in ((), (mirror() | {"corner": [0, 0, 9]},))
    )
    assert total(bare) == pytest.approx(total(beside_one), rel=1e-3)
    assert total(bare).all()


@pytest.mark.slow
def test_a_lamp_in_a_mirror_has_the_ghosts_of_one_behind_an_opening(mirrored: rptcam_cl.Image) -> None:
    unseen = mirror() | {"corner": [0, 0, 9]}  # so that the kernels are the same
    direct = shown(point(IMAGE), unseen)
    assert direct.metadata["ghosts"].get("mirrored", 0) == 0
    assert mirrored.metadata["ghosts"]["mirrored"] == 1
    assert "1 of them mirrored" in mirrored.metadata["ghosts"]["says"]
    assert direct["ghosts"].any()
    off = np.abs(mirrored["ghosts"] - direct["ghosts"]).sum(dtype=np.float64)
    assert off < 1e-3 * direct["ghosts"].sum(dtype=np.float64)


def test_a_mirrors_reflectance_scales_its_ghosts(mirrored: rptcam_cl.Image) -> None:
    dim = shown(point(LAMP), mirror(reflectance=[0.5, 0.25, 0.1]))
    assert total(dim) == pytest.approx(total(mirrored) * [0.5, 0.25, 0.1], rel=1e-4)


@pytest.mark.parametrize("what", ["between lamp and mirror", "between mirror and lens", "beside the mirror"])
def test_what_hides_the_image_hides_its_ghosts(what: str) -> None:
    away = MIDDLE + np.array([0.05, -0.03, 0.0])  # about where the lamp is seen
    place = {"between lamp and mirror": (LAMP + away) / 2, "between mirror and lens": away / 2}.get(what)
    material = {"kind": "matte", "reflectance": 0.5}
    hiding = (
        [] if place is None else [{"shape": "sphere", "center": place.tolist(), "radius": 0.2, "material": material}]
    )
    image = shown(point(LAMP), mirror(0.02) if place is None else mirror(), *hiding)
    assert not image["ghosts"].any()
    assert image.metadata["ghosts"]["sources"] == image.metadata["ghosts"]["dropped_share"] == 0


@pytest.mark.slow
def test_a_lamp_of_a_size_has_the_ghosts_of_its_image(mirrored: rptcam_cl.Image) -> None:
    def lamp(place: np.ndarray) -> dict[str, Any]:
        return {"shape": "sphere", "center": place.tolist(), "radius": 0.05,
                "material": {"kind": "emissive", "radiance": [5000.0] * 3}}  # fmt: skip

    dark = point(np.array([0.0, 0.0, 50.0]), 1e-9)
    direct, seen = shown(dark, lamp(IMAGE)), shown(dark, lamp(LAMP), mirror())
    assert seen.metadata["ghosts"]["mirrored"] == 16
    assert total(seen) == pytest.approx(total(direct), rel=5e-3)


@pytest.fixture(scope="module")
def glint() -> rptcam_cl.Image:
    ball = {"shape": "sphere", "center": BALL.tolist(), "radius": RADIUS, "material": {"kind": "mirror"}}
    return shown(sun(), ball, distance_m=1.0)


def sun() -> dict[str, Any]:
    return {"kind": "sun", "direction": (-SUN).tolist(), "irradiance": [800.0] * 3, "diameter_degrees": 0.53}


@pytest.mark.slow
def test_a_sun_in_a_chrome_ball_has_the_ghosts_of_its_small_image(glint: rptcam_cl.Image) -> None:
    film_z = glint.metadata["film_distance_mm"] + load_lens("dgauss-50mm").length
    eye, at = np.array([0.0, 0.0, -film_z * 1e-3]), BALL.copy()
    for _ in range(100):
        half = (eye - at) / np.linalg.norm(eye - at) + SUN
        half /= np.linalg.norm(half)
        at = BALL + RADIUS * half
    away, cosine = np.linalg.norm(eye - at), half @ SUN
    behind = (
        RADIUS * cosine / 2,
        RADIUS / (2 * cosine),
    )  # the image, in the plane of reflection and across
    irradiance = 800.0 / np.prod([1 + away / each for each in behind])
    place = at + (at - eye) / away * np.mean(behind)
    direct = shown(point(place, irradiance * (away + np.mean(behind)) ** 2), distance_m=1.0)
    assert total(glint) == pytest.approx(total(direct), rel=2e-3)
    assert np.abs(glint["ghosts"] - direct["ghosts"]).sum() < 0.01 * direct["ghosts"].sum()


@pytest.mark.slow
def test_a_ball_of_triangles_is_a_ball(glint: rptcam_cl.Image, tmp_path: Path) -> None:
    around, up = 128, 64
    turn, fall = np.meshgrid(2 * np.pi * np.arange(around) / around, np.pi * np.arange(up + 1) / up)
    out = np.stack([np.sin(fall) * np.cos(turn), np.cos(fall), np.sin(fall) * np.sin(turn)], axis=-1).reshape(-1, 3)
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in BALL + RADIUS * out]
    lines += [f"vn {x:.9f} {y:.9f} {z:.9f}" for x, y, z in out]
    for row in range(up):
        for column in range(around):
            a, b = 1 + row * around + column, 1 + row * around + (column + 1) % around
            faces = (a, b, b + around), (a, b + around, a + around)
            lines += ["f " + " ".join(f"{corner}//{corner}" for corner in face) for face in faces]
    (tmp_path / "ball.obj").write_text("\n".join(lines))
    mesh = {"shape": "mesh", "file": "ball.obj", "material": {"kind": "mirror"}}
    text = scene(sun(), objects=(mesh,), focus={"distance_m": 1.0})
    (tmp_path / "scene.yaml").write_text(json.dumps(text))
    image = rptcam_cl.render(tmp_path / "scene.yaml")
    assert total(image) == pytest.approx(total(glint), rel=0.01)


def test_parts_have_the_ghosts_of_highlights(mirrored: rptcam_cl.Image, tmp_path: Path) -> None:
    text = scene(point(LAMP), objects=(mirror(),), focus={"distance_m": 2.0})
    text["render"]["caustics"] = "off"
    parts = [tmp_path / "1.rpck", tmp_path / "2.rpck"]
    for number, path in enumerate(parts, 1):
        rptcam_cl.render(text, part=f"{number}/2", checkpoint=path)
    merged = rptcam_cl.merge(parts)
    np.testing.assert_array_equal(merged.pixels, mirrored.pixels)
    np.testing.assert_array_equal(merged["ghosts"], mirrored["ghosts"])
    assert merged.metadata["ghosts"] == mirrored.metadata["ghosts"]
