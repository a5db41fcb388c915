"""Lights: where they shine, how brightly, and pictures of the sky."""

import io
import math
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.pbrt.convert import in_longitude_and_latitude, square_heights, square_of_angles
from rptcam_cl.exchange.pbrt.textures import black_body_srgb
from rptcam_cl.scene.lights import read_luminaire
from tests.exchange.pbrt import reference as pbrt
from tests.support.cases import one_in

Convert = Callable[..., Any]
RIGHT = 'Scale -1 1 1 LookAt 0 0 9  0 0 0  0 1 0 Camera "perspective" WorldBegin\n'
LEFT = RIGHT.replace("Scale -1 1 1 ", "")
BALL = '\nShape "sphere"\n'


def light_of(done: Any) -> dict[str, Any]:
    (found,) = done.keys["lights"]
    return dict(found)


def test_point_lights(convert: Convert) -> None:
    text = 'Translate 1 2 3 LightSource "point" "point3 from" [1 0 0] "rgb I" [1 2 3] "float scale" 2'
    assert light_of(convert(text, RIGHT)) == {"kind": "point", "position": [2, 2, 3], "intensity": [2, 4, 6]}
    assert light_of(convert(text, LEFT))["position"] == [-2, 2, 3]


def test_lights_have_the_places_and_cones_of_pbrt_where_nothing_is_said(convert: Convert) -> None:
    lights = convert('Translate 1 2 3 LightSource "point" LightSource "spot" LightSource "distant"', RIGHT).keys[
        "lights"
    ]
    assert lights == [
        {"kind": "point", "position": [1, 2, 3], "intensity": [1, 1, 1]},
        {"kind": "spot", "position": [1, 2, 3], "direction": [0, 0, 1], "intensity": [1, 1, 1],
         "outer_degrees": 30, "inner_degrees": 25},
        {"kind": "directional", "direction": [0, 0, 1], "irradiance": [1, 1, 1]},
    ]  # fmt: skip


@pytest.mark.parametrize(("angle", "delta", "inner"), [(40, 10, 30), (20, 40, 0), (90, 0, 90 * (1 - 1e-6))])
def test_power_of_a_spot_fills_its_cone_and_half_of_its_edge(
    convert: Convert, angle: float, delta: float, inner: float
) -> None:
    """pbrt's book, 12.2.1: 2 pi ((1 - cos inner) + (cos inner - cos outer) / 2)."""
    text = f'LightSource "spot" "float power" .5 "float coneangle" {angle} "float conedeltaangle" {delta}'
    done = convert(text, RIGHT)
    found = light_of(done)
    assert (found["outer_degrees"], found["inner_degrees"]) == (angle, pytest.approx(inner))
    start, stop = math.cos(math.radians(inner)), math.cos(math.radians(angle))
    np.testing.assert_allclose(found["intensity"], 0.5 / (2 * math.pi * (1 - (start + stop) / 2)), rtol=1e-6)
    assert not done.says("smooth step")
    assert convert(text + "\nWorldEnd", RIGHT).says("in.pbrt:2: ", "the edge of its cone as a smooth step")


def test_spectra_of_lights_are_scaled_to_luminance_one_by_the_fourth_release(convert: Convert) -> None:
    """Equal energy is 1.2048, 0.9483, 0.9089 in linear sRGB of luminance 1 (white E: x = y = 1/3)."""
    text = 'LightSource "point" "spectrum I" [400 3 700 3] "spectrum scale" [400 .5 700 .5]'
    for end, factor in (("", 0.5), ("\nWorldEnd", 1.5)):
        found = light_of(convert(text + end, RIGHT))["intensity"]
        np.testing.assert_allclose(found, np.array([1.2048, 0.9483, 0.9089]) * factor, rtol=1e-3)
    assert light_of(convert('LightSource "point" "spectrum I" [400 0 700 0]', RIGHT))["intensity"] == [0, 0, 0]


def test_power_is_spread_over_the_sphere(convert: Convert) -> None:
    found = light_of(convert('LightSource "point" "float power" 100', RIGHT))
    np.testing.assert_allclose(found["intensity"], 100 / (4 * math.pi))


def test_intensity_follows_the_unit_of_length(convert: Convert) -> None:
    """The same irradiance on a wall one unit away, which is a hundredth of a metre here."""
    found = light_of(convert('LightSource "point"', RIGHT.replace("LookAt", "Scale .01 .01 .01 LookAt")))
    np.testing.assert_allclose(found["intensity"], 1e-4)


@pytest.mark.parametrize("head", [RIGHT, LEFT])
def test_spot_lights_are_those_of_pbrt(convert: Convert, head: str) -> None:
    text = 'Rotate 90 0 0 1 LightSource "spot" "point3 from" [0 1 0] "point3 to" [3 1 0] "float coneangle" 40'
    found = light_of(convert(text + ' "float conedeltaangle" 10', head))
    sign = 1 if head == RIGHT else -1
    np.testing.assert_allclose(found["position"], [-sign, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found["direction"], [0, 3, 0], atol=1e-12)
    assert (found["kind"], found["outer_degrees"], found["inner_degrees"]) == ("spot", 40, 30)


def test_distant_lights(convert: Convert) -> None:
    text = 'LightSource "distant" "point3 from" [0 3 1] "point3 to" [0 0 1] "blackbody L" 3000 "float scale" 2'
    found = light_of(convert(text, RIGHT))
    assert found["direction"] == [0, -3, 0]
    np.testing.assert_allclose(found["irradiance"], 2 * black_body_srgb(3000, luminance=1))
    found = light_of(convert('LightSource "distant" "float illuminance" 50', LEFT))
    assert (found["direction"], found["irradiance"]) == ([0, 0, 1], [50] * 3)


def test_black_bodies_of_the_third_release_have_their_peak_at_one(convert: Convert) -> None:
    found = light_of(convert('LightSource "distant" "blackbody L" [3000 2]\nWorldEnd', RIGHT))
    np.testing.assert_allclose(found["irradiance"], 2 * black_body_srgb(3000, luminance=None))


def test_named_illuminants_have_luminance_one(convert: Convert) -> None:
    for name, white in (("stdillum-D65", (1, 1, 1)), ("stdillum-A", (1.845, 0.826, 0.233))):
        found = light_of(convert(f'LightSource "point" "spectrum I" "{name}"', RIGHT))
        np.testing.assert_allclose(found["intensity"], white, atol=2e-3)
        assert np.dot(found["intensity"], (0.2126, 0.7152, 0.0722)) == pytest.approx(1, abs=1e-3)


def test_constant_light_from_everywhere_adds_up(convert: Convert) -> None:
    text = 'LightSource "infinite" "rgb L" [1 2 3]\nLightSource "infinite" "float illuminance" 3'
    done = convert(text + BALL, RIGHT)
    np.testing.assert_allclose(done.keys["environment"]["radiance"], np.add([1, 2, 3], 3 / math.pi))


def test_lights_in_three_colours_of_scale(convert: Convert) -> None:
    found = light_of(convert('LightSource "point" "rgb I" [1 2 3] "rgb scale" [2 2 1]\nWorldEnd', RIGHT))
    assert found["intensity"] == [2, 4, 3]


def test_lamps_have_the_radiance_of_pbrt(convert: Convert) -> None:
    text = 'Material "diffuse" "rgb reflectance" [0 0 0] AreaLightSource "diffuse" "rgb L" [1 2 3] "float scale" 2'
    done = convert(text + ' "bool twosided" true' + BALL, RIGHT)
    assert done.material() == {"kind": "emissive", "radiance": [2, 4, 6], "two_sided": True}
    assert done.report == []


@pytest.mark.parametrize(
    ("shape", "area"),
    [
        ('"sphere" "float radius" 2', 16 * math.pi),
        ('"disk" "float radius" 2', 4 * math.pi),
        ('"cylinder" "float radius" 2 "float zmin" 0 "float zmax" 3', 12 * math.pi),
        ('"bilinearmesh" "point3 P" [0 0 0 2 0 0 0 3 0 2 3 0]', 6),
        ('"trianglemesh" "point3 P" [0 0 0 2 0 0 2 3 0 0 3 0] "integer indices" [0 1 2 0 2 3]', 3),  # each triangle
    ],
)
@pytest.mark.parametrize("sides", [1, 2])
def test_power_of_lamps_is_spread_over_their_area(convert: Convert, shape: str, area: float, sides: int) -> None:
    lamp = f'AreaLightSource "diffuse" "float power" 0.6 "bool twosided" {"true" if sides == 2 else "false"}'
    done = convert(f"{lamp} Shape {shape}", RIGHT)
    np.testing.assert_allclose(done.material()["radiance"], 0.6 / (math.pi * area * sides))


def test_lamps_in_objects_do_not_shine(convert: Convert) -> None:
    done = convert(f'ObjectBegin "a" AreaLightSource "diffuse" {BALL} ObjectEnd ObjectInstance "a"', RIGHT)
    assert done.material()["kind"] == "matte"
    assert done.says("in.pbrt:2: ignored: AreaLightSource", "do not shine, as in pbrt")


def test_a_lamp_that_reflects_is_reported(convert: Convert) -> None:
    assert convert(f'AreaLightSource "diffuse" {BALL}', RIGHT).says("in.pbrt:2: approximated", "reflects nothing")


BAD = {
    'LightSource "distant" "point3 from" [1 1 1] "point3 to" [1 1 1]': "are the same point",
    'LightSource "spot" "float coneangle" 0': "coneangle must lie between 0 and 180",
    'LightSource "spot" "float coneangle" 181': "coneangle must lie between 0 and 180",
    'LightSource "spot" "float conedeltaangle" -1': "conedeltaangle not below 0",
    'LightSource "point" "point3 from" [0 0 0 1 1 1]': '"from" needs 3 numbers (got 6)',
    'LightSource "point" "blackbody I" [1 2 3]': "a temperature above 0 [K] (got 1 2 3)",
    'LightSource "point" "blackbody I" []': "a temperature above 0 [K] (got nothing)",
    'LightSource "infinite" "string filename" "black.exr" "float illuminance" 1': "the picture is black above",
    'LightSource "point" "blackbody I" -3': "a temperature above 0",
    'LightSource "infinite" "string filename" "no.exr"': "no such file",
    'LightSource "infinite" "string filename" "wide.exr"': "must be square",
    'LightSource "infinite" "string filename" "bad.exr"': "bad.exr: ",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_lights_are_told(convert: Convert, text: str, tmp_path: Path) -> None:
    write_exr(tmp_path / "wide.exr", np.ones((2, 4, 3)))
    write_exr(tmp_path / "black.exr", np.zeros((8, 8, 3)))
    with pytest.raises(InputError, match=r"in\.pbrt:2:") as problem:
        convert(text, RIGHT, **{"bad.exr": b"no picture"})
    assert BAD[text] in str(problem.value)


def write_exr(path: Path, pixels: Any) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels, np.float32)}) as file:
        file.write(str(path))


def test_square_covers_equal_solid_angles() -> None:
    z, longitude = np.random.default_rng(1).random((2, 200_000))
    u, v = square_of_angles(2 * z - 1, 2 * np.pi * longitude)  # even over the sphere
    counts = np.histogram2d(u, v, bins=8, range=[[0, 1], [0, 1]])[0]
    assert np.abs(counts / 3125 - 1).max() < 5 / math.sqrt(3125)
    np.testing.assert_allclose(square_of_angles([1, -1, 0, 0, 0, 0], [0, 0, 0, np.pi / 2, np.pi, -np.pi / 2]),
                               [[0.5, 1, 1, 0.5, 0, 0.5], [0.5, 1, 0.5, 1, 0.5, 0]], atol=1e-7)  # fmt: skip


def test_heights_are_those_of_the_pixels() -> None:
    z = square_heights(64)
    u, v = square_of_angles(z, 0.3)  # a ring; every pixel of it has a height near that
    assert z.mean() == pytest.approx(0, abs=1e-12)
    row, column = (v * 64).astype(int).clip(0, 63), (u * 64).astype(int).clip(0, 63)
    assert np.abs(z[row, column] - z).max() < 0.1


def test_resampling_keeps_the_light() -> None:
    square = np.random.default_rng(2).random((64, 64, 3)).astype(np.float32)
    found = in_longitude_and_latitude(square, clockwise=False)
    rows = -np.diff(np.cos(np.linspace(0, np.pi, 65))) / 2
    np.testing.assert_allclose((found.mean(axis=1) * rows[:, None]).sum(axis=0), square.mean(axis=(0, 1)), rtol=3e-3)
    np.testing.assert_array_equal(found[:, ::-1], in_longitude_and_latitude(square, clockwise=True))


def direction_colours(directions: np.ndarray) -> np.ndarray:
    """A radiance that tells every direction apart."""
    return np.asarray(0.6 + 0.5 * directions)


def sky_of_pbrt(kind: str, size: int) -> np.ndarray:
    """A picture of pbrt, (rows, columns, 3), that shows each direction of the light's space in its colour."""
    if kind == "mapname":
        phi = 2 * np.pi * (np.arange(2 * size) + 0.5)[None, :] / (2 * size)
        theta = np.pi * (np.arange(size) + 0.5)[:, None] / size
        x, y, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi
        return direction_colours(np.stack([x, y, z], axis=-1))
    p = 2 * (np.arange(size) + 0.5) / size - 1
    u, v = np.meshgrid(p, p)
    # pbrt's book, section 3.8.3, written out for a pixel at a time
    d = 1 - (abs(u) + abs(v))
    r = 1 - abs(d)
    phi = np.where(r == 0, 1, (abs(v) - abs(u)) / np.where(r == 0, 1, r) + 1) * np.pi / 4
    ring = r * np.sqrt(2 - r * r)
    x, y = np.copysign(np.cos(phi), u) * ring, np.copysign(np.sin(phi), v) * ring
    return direction_colours(np.stack([x, y, np.copysign(1 - r * r, d)], axis=-1))


TURNS = ["", "Rotate -90 1 0 0", "Rotate 37 1 -2 .5", "Scale -1 1 1 Rotate -90 1 0 0", "Rotate 90 1 0 0"]


@pytest.mark.parametrize(("kind", "head", "turn"), one_in(3, product(("mapname", "filename"), (RIGHT, LEFT), TURNS)))
def test_sky_shows_each_direction_where_pbrt_has_it(
    convert: Convert, tmp_path: Path, kind: str, head: str, turn: str
) -> None:
    write_exr(tmp_path / "sky.exr", sky_of_pbrt(kind, 64))
    camera = head.replace('"perspective"', '"perspective" "float fov" 60').replace("WorldBegin", (
        'Film "rgb" "integer xresolution" 16 "integer yresolution" 12 WorldBegin'))  # fmt: skip
    done = convert(f'{turn} LightSource "infinite" "string {kind}" "sky.exr"', camera)
    matrices = {
        "": np.eye(4), "Rotate -90 1 0 0": pbrt.rotate_x(-90), "Rotate 90 1 0 0": pbrt.rotate_x(90),
        "Scale -1 1 1 Rotate -90 1 0 0": pbrt.scale(-1, 1, 1) @ pbrt.rotate_x(-90),
    }  # fmt: skip
    world_from_light = matrices.get(turn)
    if world_from_light is None:
        axis = np.array([1, -2, 0.5]) / np.linalg.norm([1, -2, 0.5])
        c, s = math.cos(math.radians(37)), math.sin(math.radians(37))
        world_from_light = np.eye(4)
        world_from_light[:3, :3] = c * np.eye(3) + s * np.cross(np.eye(3), axis) + (1 - c) * np.outer(axis, axis)
    camera_from_world = (pbrt.scale(-1, 1, 1) if head == RIGHT else np.eye(4)) @ pbrt.look_at(
        [0, 0, 9], [0, 0, 0], [0, 1, 0]
    )
    y, x = np.mgrid[0:12, 0:16] + 0.5
    tangent = math.tan(math.radians(30))
    rays = np.stack([(2 * x / 16 - 1) * 16 / 12 * tangent, (1 - 2 * y / 12) * tangent, np.ones_like(x)], axis=-1)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ camera_from_world[:3, :3]  # back by the transpose
    expected = direction_colours(rays @ np.linalg.inv(world_from_light[:3, :3]).T)
    picture = np.asarray(rptcam_cl.render(done.scene, spp=64, seed=1))
    # a pixel spans 0.08 rad and a texel 0.05, of which the mean is seen: colours change by 0.5 a radian
    assert np.abs(picture - expected).max() < 0.02


def test_sky_of_a_left_handed_scene_is_referenced(convert: Convert, tmp_path: Path) -> None:
    write_exr(tmp_path / "sky.exr", sky_of_pbrt("mapname", 8))
    done = convert('LightSource "infinite" "string mapname" "sky.exr" "float scale" 3', LEFT)
    assert done.keys["environment"]["file"] == "sky.exr"
    assert done.keys["environment"]["gain"] == 3
    assert done.report == []


def test_illuminance_of_a_sky_is_that_of_pbrt_on_the_ground(convert: Convert, tmp_path: Path) -> None:
    """pbrt-v4 makes the sum over pixels of luminance times the cosine to +z, times 2 pi / pixels, the illuminance: the
    pixels share 4 pi, so that the ground has twice as much."""
    write_exr(tmp_path / "sky.exr", sky_of_pbrt("filename", 128))
    done = convert('LightSource "infinite" "string filename" "sky.exr" "float illuminance" 10', LEFT)
    with OpenEXR.File(str(tmp_path / done.keys["environment"]["file"])) as file:
        pixels = file.channels()["RGB"].pixels @ (0.2126, 0.7152, 0.0722)
    theta = np.pi * (np.arange(128) + 0.5) / 128
    weights = np.clip(np.cos(theta), 0, None) * np.sin(theta) * (np.pi / 128) ** 2
    assert (pixels * weights[:, None]).sum() == pytest.approx(20, rel=5e-3)
    assert done.says("in.pbrt:", "twice as bright as that says")


def test_no_illuminance_leaves_a_sky_as_it_is(convert: Convert, tmp_path: Path) -> None:
    write_exr(tmp_path / "sky.exr", sky_of_pbrt("filename", 16))
    for text in ("", '"float illuminance" 0'):
        done = convert(f'LightSource "infinite" "string filename" "sky.exr" {text}', LEFT)
        with OpenEXR.File(str(tmp_path / done.keys["environment"]["file"])) as file:
            pixels = file.channels()["RGB"].pixels
        np.testing.assert_allclose(pixels.max(), sky_of_pbrt("filename", 16).max(), rtol=0.02)
        assert not done.says("twice as bright")


def test_a_sky_has_one_picture_and_no_uneven_scale(convert: Convert, tmp_path: Path) -> None:
    write_exr(tmp_path / "sky.exr", sky_of_pbrt("mapname", 8))
    sky = 'LightSource "infinite" "string mapname" "sky.exr"'
    done = convert(f'Scale 1 2 1 {sky} "float scale" 3\n{sky} "float scale" 2', LEFT)
    assert done.keys["environment"]["gain"] == 3
    assert done.says("in.pbrt:2: approximated: ", "without the uneven scaling of its transform")
    assert done.says("in.pbrt:3: ignored: ", "a second picture of the sky")
    assert len(done.report) == 2


def test_constant_light_adds_to_the_picture_of_a_sky(convert: Convert, tmp_path: Path) -> None:
    write_exr(tmp_path / "sky.exr", sky_of_pbrt("mapname", 8))
    text = 'LightSource "infinite" "rgb L" [1 2 3] LightSource "infinite" "string mapname" "sky.exr" "rgb L" [2 1 1]'
    done = convert(text, LEFT)
    assert "gain" not in done.keys["environment"]
    with OpenEXR.File(str(tmp_path / done.keys["environment"]["file"])) as file:
        pixels = file.channels()["RGB"].pixels
    np.testing.assert_allclose(pixels, sky_of_pbrt("mapname", 8) * [2, 1, 1] + [1, 2, 3], rtol=1e-6)
    assert done.says("written anew with its factor, to out_files/sky-sky.exr")


def test_pictures_of_the_sky_of_other_kinds_are_reported(convert: Convert) -> None:
    done = convert('LightSource "infinite" "string mapname" "sky.gif"' + BALL, RIGHT, **{"sky.gif": b"GIF"})
    assert done.says("in.pbrt:2: ignored: sky.gif: a kind of picture that is not read")


V3_HEAD = 'Scale -1 1 1 LookAt 0 0 9  0 0 0  0 1 0 Camera "perspective" Film "image" WorldBegin\n'
V4_HEAD = V3_HEAD.replace(' Film "image"', "")
LAMP = 'AttributeBegin Translate 1 2 3 {}LightSource "{}" "rgb I" [4 4 4] "string {}" "a.png" {} AttributeEnd\n'
EAST, NORTH = (90, 0), (180, 0)  # vertical and horizontal angles of our +x and +z


def picture(pixels: Any) -> bytes:
    """A PNG of levels from 0 to 1, given in rows from the top."""
    stream = io.BytesIO()
    Image.fromarray(np.round(np.array(pixels) * 255).astype(np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def intensities(done: Any, tmp_path: Path, *angles: tuple[float, float]) -> list[float]:
    (lamp,) = done.keys["lights"]
    assert (lamp["kind"], lamp["position"], lamp["direction"]) == ("ies", [1, 2, 3], [0, 0, -1])
    luminaire = read_luminaire(tmp_path / lamp["file"])
    return [lamp["gain"] * float(luminaire.intensity(np.array([v]), np.array([h]))[0, 0]) for v, h in angles]


def test_goniometric_lamps_shine_as_their_picture_says(convert: Convert, tmp_path: Path) -> None:
    # in longitude and latitude about +y: the upper half, and of it first that of z > 0
    text = LAMP.format("", "goniometric", "mapname", "") + 'Shape "sphere"'
    done = convert(text, V3_HEAD, **{"a.png": picture([[1, 1, 0, 0], [0, 0, 0, 0]])})
    found = intensities(done, tmp_path, (100, 90), (100, 45), (100, 315), (135, 45), (45, 45))
    assert found == pytest.approx([4, 4, 0, 4, 0], abs=0.01)
    turned = LAMP.format("Rotate 90 0 0 1 ", "goniometric", "mapname", "") + 'Shape "sphere"'
    done = convert(turned, V3_HEAD, **{"a.png": picture([[1], [0]])})
    assert intensities(done, tmp_path, (90, 180), EAST) == pytest.approx([4, 0], abs=0.01)  # +y of the lamp is our -x


@pytest.mark.parametrize(("head", "level"), [(V3_HEAD, 0.4), (V4_HEAD, ((0.4 + 0.055) / 1.055) ** 2.4)])
def test_bytes_of_a_lamps_picture_are_linear_in_pbrt_v3_and_srgb_in_v4(
    convert: Convert, tmp_path: Path, head: str, level: float
) -> None:
    """``ReadImage`` of pbrt-v3 divides by 255; its textures alone have a gamma."""
    key = "mapname" if head == V3_HEAD else "filename"
    done = convert(LAMP.format("", "goniometric", key, "") + BALL, head, **{"a.png": picture([[0.4] * 2] * 2)})
    assert intensities(done, tmp_path, EAST) == pytest.approx([4 * level], rel=1e-3)
    sky = f'LightSource "infinite" "string {key}" "a.png"' + BALL
    done = convert(sky, head, **{"a.png": picture([[0.4] * 2] * 2)})
    environment = done.keys["environment"]
    if head == V3_HEAD:
        with OpenEXR.File(str(tmp_path / environment["file"])) as file:
            np.testing.assert_allclose(file.channels()["RGB"].pixels, level, rtol=1e-3)


def test_the_edge_of_a_spot_of_pbrt_v3_is_a_fourth_power(convert: Convert, tmp_path: Path) -> None:
    """Its ``Falloff``: ((cos a - cos outer) / (cos inner - cos outer))^4 between the two angles."""
    text = 'LightSource "spot" "rgb I" [4 4 4] "float coneangle" 40 "float conedeltaangle" 30'
    (lamp,) = convert(text + BALL, V3_HEAD).keys["lights"]
    pattern = read_luminaire(tmp_path / lamp["file"]).intensity(np.arange(0.5, 180), np.zeros(180))[:, 0] * lamp["gain"]
    degrees = np.radians(np.arange(0.5, 180))
    start, stop = math.cos(math.radians(10)), math.cos(math.radians(40))
    expected = 4 * np.clip((np.cos(degrees) - stop) / (start - stop), 0, 1) ** 4
    np.testing.assert_allclose(pattern, expected, atol=4e-3)


def test_goniometric_lamps_of_pbrt_v4_lie_on_a_square(convert: Convert, tmp_path: Path) -> None:
    # the middle of the square is +z, its corners are -z
    pixels = np.zeros((8, 8))
    pixels[3:5, 3:5] = 1
    text = LAMP.format("", "goniometric", "filename", "") + 'Shape "sphere"'
    done = convert(text, V4_HEAD, **{"a.png": picture(pixels)})
    assert intensities(done, tmp_path, NORTH, (0, 0), EAST) == pytest.approx([4, 0, 0], abs=0.01)
    # of the power that is given, all comes out, times I
    done = convert(text.replace('"a.png" ', '"a.png" "float power" 100 '), V4_HEAD, **{"a.png": picture(pixels)})
    (lamp,) = done.keys["lights"]
    luminaire = read_luminaire(tmp_path / lamp["file"])
    vertical, horizontal = (np.arange(180) + 0.5, np.arange(360) + 0.5)
    mean = luminaire.intensity(vertical, horizontal).mean(axis=1)
    weights = np.sin(np.radians(vertical))
    assert lamp["gain"] * 4 * np.pi * (weights @ mean) / weights.sum() == pytest.approx(400, rel=0.02)


def test_projectors_show_their_picture_upside_down_as_pbrt_does(convert: Convert, tmp_path: Path) -> None:
    text = LAMP.format("", "projection", "filename", '"float fov" 60') + 'Shape "sphere"'
    done = convert(text, V4_HEAD, **{"a.png": picture([[1, 0], [0, 0]])})
    # 20 degrees from +z towards -x and -y, +x and -y, -x and +y; 40 degrees are beyond the edge
    aside = [(160, 225), (160, 315), (160, 135), (140, 225 + 45)]
    assert intensities(done, tmp_path, *aside) == pytest.approx([4, 0, 0, 0], abs=0.01)
    assert done.says("steps of 0.5 degrees")


@pytest.mark.parametrize("head", [V3_HEAD, V4_HEAD])
def test_projector_without_its_picture_lights_the_square_of_its_cone(
    convert: Convert, tmp_path: Path, head: str
) -> None:
    text = LAMP.replace('"string {}" "a.png"', "").format("", "projection", '"float fov" 60') + BALL
    done = convert(text, head)
    # 29 and 31 degrees from +z across, 38 and 40 degrees into a corner (39.2), and behind
    aside = [(151, 0), (149, 0), (142, 45), (140, 45), (0, 0)]
    assert intensities(done, tmp_path, *aside) == pytest.approx([4, 0, 4, 0, 0], abs=0.01)
    assert done.says("shines evenly, without a picture")
