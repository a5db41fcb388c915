"""Cameras: every point of the world falls on the pixel where pbrt sees it."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.cameras.model import half_tangents
from rptcam_cl.scene.scene import Scene
from tests.exchange.pbrt import reference as pbrt
from tests.exchange.pbrt.test_materials import png

Convert = Callable[..., Any]

POINTS = np.array([[0.3, -0.2, 0.5], [-1, 0.4, -0.3], [0.7, 0.9, 0.2], [0.05, 0.02, -1.5]])
SPHERES = "".join(
    f'AttributeBegin Translate {x} {y} {z} Shape "sphere" "float radius" .01 AttributeEnd\n' for x, y, z in POINTS
)
LIGHT = 'LightSource "infinite"\n'


def head(transform: str, camera: str, size: tuple[int, int] = (64, 48), film: str = "") -> str:
    return (
        f'{transform}\nCamera {camera}\nFilm "rgb" "integer xresolution" {size[0]} "integer yresolution" {size[1]} '
        f"{film}\nWorldBegin\n{LIGHT}"
    )


def seen_at(scene: Scene) -> np.ndarray:
    """Pixel of the cropped film (x right, y down) at which our pinhole sees the centre of each sphere."""
    camera: Any = scene.camera
    world = camera.world_from_camera()
    centres = np.array([item.center for item in scene.objects])
    x, y, z = np.linalg.solve(world[:3, :3], (centres - world[:3, 3]).T)
    across, down = half_tangents(camera.fov_degrees, camera.fov_axis, scene.film)
    width, height = scene.film.resolution
    left, _, top, _ = scene.film.crop or (0, 1, 0, 1)
    return np.stack(
        [(x / -z / across + 1) / 2 * width - left * width, (1 - y / -z / down) / 2 * height - top * height], 1
    )


TRANSFORMS = {
    "LookAt 1 2 6  0 .1 0  0 1 0": pbrt.look_at([1, 2, 6], [0, 0.1, 0], [0, 1, 0]),
    "Scale -1 1 1 LookAt 1 2 6  0 .1 0  0 1 0": pbrt.scale(-1, 1, 1) @ pbrt.look_at([1, 2, 6], [0, 0.1, 0], [0, 1, 0]),
    "LookAt -4 5 1  0 0 0  0 0 1": pbrt.look_at([-4, 5, 1], [0, 0, 0], [0, 0, 1]),
    "Translate .1 .2 7 Rotate 20 1 0 0 Rotate -70 0 1 0 Scale 1 -1 1": (
        pbrt.translate(0.1, 0.2, 7) @ pbrt.rotate_x(20) @ pbrt.rotate_y(-70) @ pbrt.scale(1, -1, 1)
    ),
    "Scale .5 .5 .5 Translate 0 0 9": pbrt.scale(0.5, 0.5, 0.5) @ pbrt.translate(0, 0, 9),
    "Scale 1.5 .8 1 Translate 0 0 6": pbrt.scale(1.5, 0.8, 1) @ pbrt.translate(0, 0, 6),
    "Transform [0 1 0 0  -1 0 0 0  0 0 1 0  .5 0 8 1]": pbrt.translate(0.5, 0, 8) @ pbrt.rotate_z(90),
}


@pytest.mark.parametrize("size", [(64, 48), (30, 50)])
@pytest.mark.parametrize("transform", TRANSFORMS)
def test_points_fall_on_the_pixels_of_pbrt(convert: Convert, transform: str, size: tuple[int, int]) -> None:
    done = convert(SPHERES, head(transform, '"perspective" "float fov" 35', size))
    expected = pbrt.raster_of(TRANSFORMS[transform], POINTS, 35, size)
    np.testing.assert_allclose(seen_at(done.scene), expected, atol=1e-8)


def test_a_mirrored_world_falls_elsewhere(convert: Convert) -> None:
    transform = next(iter(TRANSFORMS))
    done = convert(SPHERES, head("Scale -1 1 1 " + transform, '"perspective" "float fov" 35'))
    expected = pbrt.raster_of(TRANSFORMS[transform], POINTS, 35, (64, 48))
    assert np.abs(seen_at(done.scene) - expected).max() > 5


def test_worlds_of_right_handed_programs_keep_their_coordinates(convert: Convert) -> None:
    done = convert(SPHERES, head("Scale -1 1 1 LookAt 1 2 6  0 .1 0  0 1 0", '"perspective"'))
    np.testing.assert_array_equal([item.center for item in done.scene.objects], POINTS)
    np.testing.assert_allclose(done.scene.camera.eye, [1, 2, 6], atol=1e-12)


def test_shorter_side_has_the_field_of_view_that_is_given(convert: Convert) -> None:
    for size, axis in (((64, 48), "vertical"), ((30, 50), "horizontal"), ((20, 20), "horizontal")):
        camera = convert("", head("", '"perspective" "float fov" 39.3', size)).scene.camera
        assert (camera.fov_degrees, camera.fov_axis) == (39.3, axis)


WINDOWS = {(-0.5, 1.1, -0.25, 0.5): 1e-8, (-1.2125, 0.3875, -1, 1): 1e-8, (-0.8, 1.13, -0.9, 1.0): 0.26}


@pytest.mark.parametrize("window", WINDOWS)
def test_screen_windows_off_the_axis_are_parts_of_a_larger_film(
    convert: Convert, window: tuple[float, float, float, float]
) -> None:
    transform = "LookAt 1 2 6  0 .1 0  0 1 0"
    done = convert(
        SPHERES, head(transform, f'"perspective" "float fov" 35 "float screenwindow" [{" ".join(map(str, window))}]')
    )
    expected = pbrt.raster_of(TRANSFORMS[transform], POINTS, 35, (64, 48), window)
    np.testing.assert_allclose(seen_at(done.scene), expected, atol=WINDOWS[window])
    assert done.says("part of a half pixel") == (WINDOWS[window] > 0.1)
    x0, x1, y0, y1 = np.array(done.scene.film.crop) * np.repeat(done.scene.film.resolution, 2)
    np.testing.assert_allclose([x1 - x0, y1 - y0], [64, 48])


@pytest.mark.parametrize(("aspect", "window"), [(2, (-2, 2, -1, 1)), (0.5, (-1, 1, -2, 2)), (1, (-1, 1, -1, 1))])
def test_aspect_of_the_screen_need_not_be_that_of_the_film(convert: Convert, aspect: float, window: Any) -> None:
    transform = "LookAt 1 2 6  0 .1 0  0 1 0"
    done = convert(SPHERES, head(transform, f'"perspective" "float fov" 35 "float frameaspectratio" {aspect}'))
    expected = pbrt.raster_of(TRANSFORMS[transform], POINTS, 35, (64, 48), window)
    np.testing.assert_allclose(seen_at(done.scene), expected, atol=1e-8)


def test_half_of_the_field_of_view_and_its_default(convert: Convert) -> None:
    assert convert("", head("", '"perspective" "float halffov" 20 "float fov" 9')).scene.camera.fov_degrees == 40
    assert convert("", head("", '"perspective"')).scene.camera.fov_degrees == 90


def test_lens_radius_without_a_distance_is_in_focus_far_away(convert: Convert) -> None:
    assert convert("", head("", '"perspective" "float lensradius" .1')).scene.camera.focus_distance_m == 1e6
    assert convert("", head("", '"perspective" "float focaldistance" 2')).scene.camera.kind == "pinhole"


def test_panorama_of_another_film_is_twice_as_wide_as_high(convert: Convert) -> None:
    done = convert("", head("", '"environment"', (64, 48), '"float cropwindow" [.1 .9 .25 .7]'))
    assert (done.scene.film.resolution, done.scene.film.crop) == ((96, 48), None)
    assert not done.says("equal-area")
    done = convert("", head("", '"environment"', (64, 32), '"float cropwindow" [.25 .75 0 1]'))
    assert (done.scene.film.resolution, done.scene.film.crop) == ((64, 32), (0.25, 0.75, 0, 1))
    assert not done.says("twice as wide")


def test_scales_that_are_rounding_are_none(convert: Convert) -> None:
    """A matrix of six digits, as exporters write it, is a turn whose lengths are 1 but for its digits."""
    turn = pbrt.rotate_x(12) @ pbrt.rotate_y(71)
    matrix = " ".join(f"{value:.5f}" for value in (pbrt.translate(0.1, 0.2, 7) @ turn).T.reshape(-1))
    done = convert(SPHERES, head(f"Transform [{matrix}]", '"perspective" "float fov" 35'))
    assert "metres_per_unit" not in done.keys
    assert "size_mm" not in done.keys["film"]
    assert done.keys["camera"]["fov_degrees"] == 35


def test_crop_is_that_of_pbrt_in_whole_pixels(convert: Convert) -> None:
    film = '"float cropwindow" [.1 .9 .25 .7]'
    scene = convert("", head("", '"perspective"', (64, 48), film)).scene
    np.testing.assert_allclose(np.array(scene.film.crop) * [64, 64, 48, 48], [7, 58, 12, 34])  # pbrt rounds up
    scene = convert("", head("", '"perspective"', (64, 48), '"integer pixelbounds" [3 9 0 48]')).scene
    np.testing.assert_allclose(np.array(scene.film.crop) * [64, 64, 48, 48], [3, 9, 0, 48])


def test_lens_radius_makes_a_thin_lens_in_metres_of_the_camera(convert: Convert) -> None:
    camera = '"perspective" "float fov" 35 "float lensradius" .02 "float focaldistance" 1.5'
    scene = convert("", head("Scale .1 .1 .1 Translate 0 0 9", camera)).scene
    assert scene.camera.kind == "thin_lens"
    assert (scene.camera.aperture_radius_m, scene.camera.focus_distance_m) == (0.02, 1.5)
    assert scene.metres_per_unit == pytest.approx(0.1)


def test_panorama_has_the_directions_of_pbrt(convert: Convert) -> None:
    """Column and row of the middle of each sphere: phi = 2 pi x from +x over +z, theta = pi y from +y."""
    transform = "LookAt .2 .1 .3  1 .5 2  0 1 0"
    done = convert(SPHERES, head(transform, '"spherical" "string mapping" "equirectangular"', (64, 32)))
    matrix = pbrt.look_at([0.2, 0.1, 0.3], [1, 0.5, 2], [0, 1, 0])
    x, y, z = matrix[:3, :3] @ POINTS.T + matrix[:3, 3:]
    expected = [np.arctan2(z, x) / (2 * math.pi) % 1, np.arccos(y / np.sqrt(x * x + y * y + z * z)) / math.pi]
    world = done.scene.camera.world_from_camera()
    centres = np.array([item.center for item in done.scene.objects])
    x, y, z = np.linalg.solve(world[:3, :3], (centres - world[:3, 3]).T)  # ours: the middle looks to -z, right is +x
    column = np.arctan2(x, -z) / (2 * math.pi) + 0.5
    row = np.arccos(y / np.sqrt(x * x + y * y + z * z)) / math.pi
    np.testing.assert_allclose([column, row], expected, atol=1e-9)


def test_parallel_view_is_exact(convert: Convert) -> None:
    window = "[-2 2 -1.5 1.5]"
    done = convert(SPHERES, head("Translate 0 0 6", f'"orthographic" "float screenwindow" {window}'))
    x, y = (POINTS[:, 0] + 2) / 4 * 64, (1.5 - POINTS[:, 1]) / 3 * 48
    camera = done.scene.camera
    centres = np.array([item.center for item in done.scene.objects])
    right, up, _ = ((centres - camera.eye) @ camera.world_from_camera()[:3, :3]).T
    np.testing.assert_allclose(x, (right / camera.width_m + 0.5) * 64, atol=1e-9)
    np.testing.assert_allclose(y, (0.5 - up / camera.width_m * 64 / 48) * 48, atol=1e-9)
    assert not done.says("approximated")


LENS = "# doublet\n40 4 1.6 20\n-60 2 1 20\n0 3 0 8\n50 3 1.5 18\n-80 0 1 18\n"


def test_lens_camera_takes_lens_stop_focus_and_film(convert: Convert) -> None:
    camera = '"realistic" "string lensfile" "my lens.dat" "float aperturediameter" 5 "float focusdistance" 2'
    film = '"float diagonal" 43.2'
    done = convert("", head("Scale .01 .01 .01 Translate 0 0 9", camera, (36, 24), film), **{"my lens.dat": LENS})
    scene = done.scene
    assert scene.camera.kind == "realistic"
    assert scene.camera.stop_diameter_mm == 5
    assert scene.camera.focus.distance_m == 2
    assert scene.film.diagonal_m() == pytest.approx(0.0432)
    assert scene.exposure.mode == "irradiance"
    assert scene.metres_per_unit == pytest.approx(0.01)
    assert load_lens(scene.lens_source()).length == 12


ASSIGNMENT = """\
Scale 5000 5000 5000
Rotate -3 1 0 0
Rotate 52 0 1 0
Translate -2.3 -.05 .5
Camera "realistic" "string specfile" "a.dat" "float filmdistance" 36.77 "float aperture_diameter" 7.1
  "float filmdiag" 70 "float hither" .001 "float yon" 1e30
Film "image" "integer xresolution" 300 "integer yresolution" 300
Sampler "lowdiscrepancy" "integer pixelsamples" 4
SurfaceIntegrator "directlighting"
Renderer "sampler"
VolumeIntegrator "emission"
WorldBegin
AttributeBegin
  AreaLightSource "area" "color L" [40 30 20] "integer nsamples" 4
  Translate 0 9.9 0 Rotate 90 1 0 0
  Shape "disk" "float radius" 8
AttributeEnd
Material "matte" "color Kd" [.2 .3 .5]
Shape "sphere" "float radius" .015
WorldEnd
"""


def test_the_lens_camera_of_the_second_release(convert: Convert) -> None:
    """As the assignments (Stanford CS 348b, HW3) have it: millimetres, the front vertex at the camera's place."""
    done = convert("", ASSIGNMENT, **{"a.dat": LENS})
    camera, scene = done.scene.camera, done.scene
    assert scene.metres_per_unit == pytest.approx(5)
    assert (camera.stop_diameter_mm, camera.focus.film_distance_mm) == (7.1, 36.77)
    assert scene.film.diagonal_m() == pytest.approx(0.07)
    assert (scene.exposure.mode, scene.render.spp) == ("irradiance", 4)
    forward = np.array(camera.target) - camera.eye
    forward /= np.linalg.norm(forward)
    vertex = np.array(camera.eye) + forward * (12 + 36.77) * 1e-3 / 5  # 12 mm of lens before the film distance
    np.testing.assert_allclose(vertex, [-2.3, 0.05, -0.5], atol=1e-12)  # the world is left-handed: x is reversed
    turns = [math.sin(math.radians(52)) * math.cos(math.radians(3)), -math.sin(math.radians(3))]
    np.testing.assert_allclose(forward[:2], turns, atol=1e-12)
    assert done.material(0) == {"kind": "emissive", "radiance": [40, 30, 20]}
    assert done.material(1) == {"kind": "matte", "reflectance": [0.2, 0.3, 0.5]}
    for words in ('"float hither"', 'Renderer "sampler": it steers', 'VolumeIntegrator "emission"', "directlighting"):
        assert done.says("in.pbrt:", words), words


def test_the_lens_camera_of_the_second_release_has_its_defaults(convert: Convert) -> None:
    done = convert("", head("", '"realistic" "string specfile" "a.dat"'), **{"a.dat": LENS})
    camera = done.scene.camera
    assert (camera.stop_diameter_mm, camera.focus.film_distance_mm) == (1, 70)
    assert done.scene.film.diagonal_m() == pytest.approx(0.035)


def test_a_stop_opens_no_wider_than_the_lens_has_it(convert: Convert) -> None:
    camera = '"realistic" "string lensfile" "a.dat" "float aperturediameter" 50'
    done = convert("", head("", camera), **{"a.dat": LENS})
    assert done.scene.camera.stop_diameter_mm is None
    assert done.says("in.pbrt:2: note: the stop opens to 8 mm, not to 50 mm")


@pytest.mark.parametrize("diameter", [8, 0.5])
def test_a_stop_may_be_as_wide_as_the_lens_has_it(convert: Convert, diameter: float) -> None:
    camera = f'"realistic" "string lensfile" "a.dat" "float aperturediameter" {diameter}'
    done = convert("", head("", camera), **{"a.dat": LENS})
    assert done.scene.camera.stop_diameter_mm == diameter
    assert not done.says("the stop opens")


def test_a_lens_without_a_stop_has_no_diameter(convert: Convert) -> None:
    camera = '"realistic" "string lensfile" "a.dat" "float aperturediameter" 2'
    done = convert("", head("", camera), **{"a.dat": LENS.replace("0 3 0 8\n", "")})
    assert done.scene.camera.stop_diameter_mm is None
    assert done.scene.camera.focus.distance_m == 10
    assert done.says("in.pbrt:2: ignored: the aperture diameter: the lens has no stop")


def test_a_picture_is_a_stop(convert: Convert) -> None:
    camera = '"realistic" "string lensfile" "a.dat" "float aperturediameter" 5 "string aperture" "stop.png"'
    done = convert("", head("", camera), **{"a.dat": LENS, "stop.png": png()})
    assert done.keys["camera"]["aperture"] == {"shape": "image", "file": "stop.png"}


def test_simple_weighting_is_exposure_relative_to_the_axis(convert: Convert) -> None:
    text = head("", '"realistic" "string lensfile" "a.dat" "float aperturediameter" 5').replace('"rgb"', '"image"')
    done = convert("WorldEnd", text, **{"a.dat": LENS})
    assert done.scene.exposure.mode == "relative"
    assert done.says("simple weighting")


def test_stop_shapes(convert: Convert) -> None:
    for name, shape in (("pentagon", "polygon"), ("star", "star"), ("gaussian", "circle")):
        camera = f'"realistic" "string lensfile" "a.dat" "float aperturediameter" 5 "string aperture" "{name}"'
        done = convert("", head("", camera), **{"a.dat": LENS})
        assert done.scene.camera.aperture.shape == shape
        assert done.says(f'the stop "{name}"')


BAD = {
    '"perspective" "float fov" 180': "fov must lie between 0 and 180 degrees",
    '"perspective" "float screenwindow" [1 0 0 1]': "x0 < x1",
    '"perspective" "float fov" 0': "fov must lie between 0 and 180 degrees (got 0)",
    '"perspective" "float halffov" 90': "fov must lie between 0 and 180 degrees (got 180)",
    '"perspective" "float screenwindow" [0 0 0 1]': "x0 < x1",
    '"perspective" "float screenwindow" [0 1 1 1]': "y0 < y1",
    '"perspective" "float screenwindow" [0 1 0]': "screenwindow needs x0 x1 y0 y1",
    '"perspective" "float frameaspectratio" 0': "frameaspectratio must be above 0 (got 0)",
    '"perspective" "float lensradius" .1 "float focaldistance" 0': "focaldistance must be above 0 (got 0)",
    '"realistic" "string lensfile" "a.dat" "float aperturediameter" 0': '"aperturediameter" must be above 0 mm (got 0)',
    '"realistic" "string specfile" "a.dat" "float aperture_diameter" -1': '"aperture_diameter" must be above 0 mm',
    '"realistic" "string specfile" "a.dat" "float filmdistance" 0': '"filmdistance" must be above 0 mm (got 0)',
    '"realistic" "string specfile" "a.dat" "float filmdiag" 0': '"filmdiag" must be above 0 mm (got 0)',
    '"fisheye"': 'unknown camera "fisheye" (allowed: perspective',
    '"realistic"': "needs a lens file",
    '"realistic" "string specfile" ""': "needs a lens file",
    '"realistic" "string lensfile" "no.dat"': "in.pbrt:2:20: no.dat: no such file",
    '"spherical" "string mapping" "cube"': "allowed: equalarea, equirectangular",
    '"perspective" "float fov" [40 50]': '"fov" needs one value (got 2)',
}


@pytest.mark.parametrize("camera", BAD)
def test_bad_cameras_are_told(convert: Convert, camera: str) -> None:
    with pytest.raises(InputError, match=r"in\.pbrt:2:") as problem:
        convert("", head("", camera), **{"a.dat": LENS})
    assert BAD[camera] in str(problem.value)


def test_a_part_of_a_scene_has_no_camera(convert: Convert) -> None:
    with pytest.raises(InputError, match="has no Camera; is it a part that another file includes"):
        convert(SPHERES, "WorldBegin\n")
