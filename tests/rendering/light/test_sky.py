"""The sky: the model's own figures, and what it does to the ground."""

import math

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core import LUMENS_PER_WATT
from rptcam_cl.core.colour import LUMINANCE
from rptcam_cl.rendering.plan.environment import COLUMNS, ROWS, SUN_RADIUS_DEGREES, bake_sky, sun_irradiance
from rptcam_cl.scene.lights import SkyEnvironment
from tests.rendering.light.pictures import irradiance
from tests.rendering.pictures import MATTE, flat_mean, looking, pixels, scene_of
from tests.support.cases import slow
from tests.support.statistics import assert_equivalent


def sky(**keys) -> SkyEnvironment:
    return SkyEnvironment(kind="sky", **keys)


def chromaticity(rgb):
    """Return x and y of linear sRGB (IEC 61966-2-1)."""
    x = rgb @ [0.4124564, 0.3575761, 0.1804375]
    y = rgb @ [0.2126729, 0.7151522, 0.0721750]
    z = rgb @ [0.0193339, 0.1191920, 0.9503041]
    return x / (x + y + z), y / (x + y + z)


def test_zenith_is_as_the_paper_has_it() -> None:
    # turbidity 3, sun at 45 degrees, by hand: chi = 0.65886, Y = 7.1649 tan(chi) + 1.7727 = 7.3218 kcd/m²
    zenith = bake_sky(sky(sun_elevation_degrees=45, turbidity=3))[0][0].mean(axis=0).astype(float)
    # the first row is a third of a degree from the zenith
    assert zenith @ LUMINANCE * LUMENS_PER_WATT == pytest.approx(7321.8, rel=4e-3)
    t = math.pi / 4
    x = 9 * (0.00166 * t**3 - 0.00375 * t**2 + 0.00209 * t) + 3 * (
        -0.02903 * t**3 + 0.06377 * t**2 - 0.03202 * t + 0.00394
    )
    x += 0.11693 * t**3 - 0.21196 * t**2 + 0.06052 * t + 0.25886
    assert chromaticity(zenith)[0] == pytest.approx(x, abs=2e-4)


def test_sky_is_brightest_about_the_sun_and_above_the_horizon_only() -> None:
    baked = bake_sky(sky(sun_elevation_degrees=40, ground_albedo=0.0))[0] @ LUMINANCE
    row, column = np.unravel_index(baked[: ROWS // 2 - 20].argmax(), baked[: ROWS // 2 - 20].shape)
    assert row == pytest.approx(50 / 180 * ROWS, abs=3)
    assert column == pytest.approx(COLUMNS / 2, abs=3)
    assert (baked[ROWS // 2 :] == 0).all()
    assert (baked[: ROWS // 2] > 0).all()


def test_sun_is_as_bright_as_it_was_measured() -> None:
    # direct normal illuminance of a high sun in clear air: 90 to 110 klx; at 20 degrees two thirds of it
    high, low = (sun_irradiance(math.radians(90 - e), 2.0) @ LUMINANCE * LUMENS_PER_WATT for e in (90, 20))
    assert 90_000 < high < 110_000
    assert 0.5 < low / high < 0.7
    # without air: the solar constant of 1361 W/m² as light of 5772 K has 93 lm/W
    assert sun_irradiance(0.0, 0.9952) @ LUMINANCE * LUMENS_PER_WATT < 0.98 * 1361 * 93


def test_low_sun_is_red() -> None:
    red, green, blue = sun_irradiance(math.radians(85), 3.0)
    assert red > 2 * green > 4 * blue


def test_ground_reflects_what_arrives() -> None:
    radiance, sun_light = bake_sky(sky(sun_elevation_degrees=30, ground_albedo=[0.5, 0.2, 0.0]))
    above = np.array(radiance, float)
    above[ROWS // 2 :] = 0
    arriving = irradiance(above, np.array([0.0, 1.0, 0.0]), finer=1) + 0.5 * sun_light
    np.testing.assert_allclose(radiance[-1, 0], arriving * [0.5, 0.2, 0] / np.pi, rtol=2e-3)


@pytest.mark.parametrize("sun", [True, slow(False)])
def test_irradiance_of_the_ground_is_that_of_sky_and_sun(sun) -> None:
    environment = {"kind": "sky", "sun_elevation_degrees": 35, "turbidity": 4, "sun": sun, "sun_azimuth_degrees": 77}
    ground = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": MATTE}
    camera = looking([-0.1, -0.1, 0.03], [0, 0, 0], fov=0.0002)
    scene = scene_of([ground], camera, depth=2, resolution=(64, 64), environment=environment)
    mean, error = flat_mean(scene, f"sky {sun}", spp=512)
    radiance, sun_light = bake_sky(sky(sun_elevation_degrees=35, turbidity=4))
    above = np.array(radiance, float)
    above[ROWS // 2 :] = 0
    expected = irradiance(above, np.array([0.0, 1.0, 0.0]), finer=1)
    expected += math.sin(math.radians(35)) * sun_light * sun
    # the row of the horizon is mixed with the ground: 2e-3
    assert_equivalent(mean * math.pi, error * math.pi, expected, 0.012 * expected)


@pytest.mark.parametrize(("up", "azimuth", "ahead"), [slow([0, 1, 0], 0, [0, 0, -1]), ([0, 0, 1], 90, [-1, 0, 0])])
def test_sun_stands_where_its_angles_say(up, azimuth, ahead) -> None:
    environment = {"kind": "sky", "sun_elevation_degrees": 30, "sun_azimuth_degrees": azimuth, "up": up}
    towards = math.cos(math.radians(30)) * np.array(ahead) + 0.5 * np.array(up)
    camera = looking([0, 0, 0], towards, fov=2.0, up=up)
    film = pixels(scene_of([], camera, depth=1, resolution=(32, 32), environment=environment), spp=16)
    disk = film[..., 0] > 0.5 * film.max()
    assert disk[16, 16]
    share = math.pi * math.tan(math.radians(SUN_RADIUS_DEGREES)) ** 2 / (2 * math.tan(math.radians(1))) ** 2
    assert disk.mean() == pytest.approx(share, rel=0.1)


def test_scene_of_sky_alone_does_not_warn_of_darkness() -> None:
    camera = looking([0, 0, 0], [0, 0, 1], up=(0, 1, 0))
    scene = rptcam_cl.load_scene(scene_of([], camera, environment={"kind": "sky"}))
    assert not any("emits light" in warning for warning in scene.warnings)
