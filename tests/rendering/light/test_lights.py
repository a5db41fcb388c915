"""Spots, measured luminaires and suns against closed forms, as the radiance of a white matte plane: E = pi L."""

import math
from pathlib import Path

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core import LUMENS_PER_WATT
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.lights import read_luminaire
from rptcam_cl.scene.load import load_scene
from tests.rendering.pictures import MATTE, flat_mean, looking, pixels, scene_of, seed_of
from tests.support.cases import slow
from tests.support.statistics import assert_equivalent

GROUND = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": MATTE}
LUMINAIRE = Path(__file__).parents[2] / "data" / "luminaire.ies"


def ground_under(lights, at=(0.0, 0.0), objects=(), depth=2, **rest):
    """The ground seen in so narrow a view that the whole picture is the point ``at``."""
    target = [*map(float, at), 0.0]
    camera = looking([target[0] - 0.1, target[1] - 0.1, 0.03], target, fov=0.0002)
    return scene_of([GROUND, *objects], camera, depth=depth, resolution=(16, 16), lights=lights, **rest)


def irradiance_at(light, at, even=5e-4):
    """Return the irradiance [W/m²] of a light, without noise and even over the picture to a share."""
    film = pixels(load_scene(ground_under([light], at), allow_folders=[LUMINAIRE.parent]), spp=4)
    assert np.ptp(film, axis=(0, 1)).max() <= even * film.max()
    return film.mean(axis=(0, 1)) * math.pi


SPOT = {"kind": "spot", "position": [0, 0, 2], "direction": [0, 0, -5], "intensity": [3, 2, 1]}


@pytest.mark.parametrize("degrees", [0, 10, 19.9, 24, 30, 35, 39, 40.2, 70])
def test_spot_fades_between_its_angles(degrees) -> None:
    angle = math.radians(degrees)
    expected = np.array([3, 2, 1]) * math.cos(angle) ** 3 / 4
    inner, outer = math.cos(math.radians(20)), math.cos(math.radians(40))
    x = min(max((math.cos(angle) - outer) / (inner - outer), 0), 1)
    light = SPOT | {"inner_degrees": 20, "outer_degrees": 40}
    found = irradiance_at(light, (2 * math.tan(angle), 0))
    # where it fades, 1e-5 of the view's width changes the step by less
    np.testing.assert_allclose(found, expected * x * x * (3 - 2 * x), rtol=2e-4, atol=1e-5)


def test_narrow_spot_keeps_its_precision() -> None:
    light = SPOT | {"inner_degrees": 0.01, "outer_degrees": 0.03}
    found = irradiance_at(light, (2 * math.tan(math.radians(0.02)), 0), even=0.01)
    inner, outer = (2 * math.sin(math.radians(a) / 2) ** 2 for a in (0.01, 0.03))
    x = (outer - 2 * math.sin(math.radians(0.02) / 2) ** 2) / (outer - inner)
    np.testing.assert_allclose(found, np.array([3, 2, 1]) / 4 * x * x * (3 - 2 * x), rtol=0.01)


def test_power_of_a_spot_is_that_of_its_closed_form() -> None:
    cosine = np.linspace(-1, 1, 2_000_001)
    inner, outer = math.cos(math.radians(20)), math.cos(math.radians(40))
    x = np.clip((cosine - outer) / (inner - outer), 0, 1)
    assert 2 * math.pi * (x * x * (3 - 2 * x)).mean() * 2 == pytest.approx(math.pi * (2 - inner - outer), rel=1e-5)


def measured_intensity(at):
    """Candela of the made-up luminaire at height 2 towards a point of the ground, from its cosine and its symmetry."""
    angle = np.degrees(np.arctan2(at[1], at[0])) % 180
    angle = min(angle, 180 - angle)
    luminaire = read_luminaire(LUMINAIRE)
    return luminaire.intensity(np.array([np.degrees(np.arctan(np.hypot(*at) / 2))]), np.array([angle]))[0, 0]


@pytest.mark.parametrize("at", [(0.001, 0), (1.3, 0), (0, 1.3), (-1, 0.4), (0.7, -2), (-5, -3)])
def test_luminaire_shines_as_its_file_says(at) -> None:
    light = {"kind": "ies", "file": str(LUMINAIRE), "position": [0, 0, 2]}
    distance2 = 4 + at[0] ** 2 + at[1] ** 2
    expected = measured_intensity(at) * 2 / distance2**1.5
    # a grid of half a degree bends straight lines of 15 degrees at their ends, halves resolve 5e-4
    np.testing.assert_allclose(irradiance_at(light, at), expected, rtol=3e-3)


def test_luminaire_reads_candela_as_its_file_says() -> None:
    luminaire = read_luminaire(LUMINAIRE)
    straight_down = luminaire.intensity(np.array([0.0]), np.array([0.0, 45.0, 90.0, 135.0, 180.0, 300.0]))[0]
    # 2.5 multiplies the file's intensities
    expected = 2.5 * np.array([200, 150, 100, 150, 200, 400 / 3])
    np.testing.assert_allclose(straight_down * LUMENS_PER_WATT, expected, rtol=1e-12)
    assert luminaire.intensity(np.array([100.0]), np.array([0.0]))[0, 0] == 0


def test_luminaire_turns_counter_clockwise_seen_along_its_direction() -> None:
    straight = {"kind": "ies", "file": str(LUMINAIRE), "position": [0, 0, 2]}
    found = irradiance_at(straight | {"rotation_degrees": 60}, (math.cos(math.radians(60)), math.sin(math.radians(60))))
    np.testing.assert_allclose(found, irradiance_at(straight, (1, 0)), rtol=1e-3)
    other = irradiance_at(
        straight | {"rotation_degrees": -60}, (math.cos(math.radians(60)), math.sin(math.radians(60)))
    )
    assert (other < 0.95 * found).all()


def test_luminaire_has_the_colour_and_gain_of_the_light() -> None:
    light = {"kind": "ies", "file": str(LUMINAIRE), "position": [0, 0, 2]}
    plain = irradiance_at(light, (1, 0))
    coloured = irradiance_at(light | {"gain": 2, "color": [4, 2, 0]}, (1, 0))
    expected = 2 * plain[0] * np.array([4, 2, 0]) / (0.2126 * 4 + 0.7152 * 2)
    np.testing.assert_allclose(coloured, expected, rtol=1e-4)


SUN = {"kind": "sun", "direction": [-3, 0, -4], "irradiance": [1, 2, 3]}


@pytest.mark.parametrize("diameter", [0.53, *map(slow, (0.05, 40.0))])
def test_irradiance_of_a_sun_is_that_of_its_cosine(diameter) -> None:
    # a disk that is whole above the horizon has the irradiance pi L sin² radius cos, exactly
    scene = ground_under([SUN | {"diameter_degrees": diameter}])
    mean, error = flat_mean(scene, f"sun {diameter}", spp=256)
    expected = np.array([1, 2, 3]) * 0.8
    assert_equivalent(mean * math.pi, error * math.pi, expected, 0.01 * expected)


def test_camera_sees_the_disk_of_the_sun() -> None:
    sun = SUN | {"direction": [0, 0, -1], "diameter_degrees": 6}
    camera = looking([0, 0, 0], [0, 0, 1], fov=20, up=(0, 1, 0))
    film = pixels(scene_of([], camera, depth=2, resolution=(96, 96), lights=[sun]), seed=seed_of("disk"), spp=64)
    radiance = np.array([1, 2, 3]) / (math.pi * math.sin(math.radians(3)) ** 2)
    np.testing.assert_allclose(film[48, 48], radiance, rtol=1e-6)
    assert (film[0] == 0).all()
    share = math.pi * math.tan(math.radians(3)) ** 2 / (2 * math.tan(math.radians(10))) ** 2
    # 590k samples of a share of 7 %
    assert film[..., 0].mean() / radiance[0] == pytest.approx(share, rel=0.01)


@pytest.mark.slow
def test_mirror_shows_the_sun_and_glossy_metal_weighs_it() -> None:
    # light sampling and BSDF sampling both find a wide sun; a white rough metal shows the same irradiance either way
    sun = SUN | {"direction": [0, 0, -1], "diameter_degrees": 60, "irradiance": 1.0}
    metal = {"kind": "conductor", "reflectance": 1.0, "alpha": 0.3}
    plate = {"shape": "disk", "center": [0, 0, 0], "normal": [0, 0, 1], "radius": 1, "material": metal}
    camera = looking([0.3, 0, 2], [0, 0, 0], fov=0.001, up=(0, 1, 0))
    both = scene_of([plate], camera, depth=2, resolution=(32, 32), lights=[sun])
    mean, error = flat_mean(both, "sun on metal", spp=512)
    # the same disk as an emissive one far away
    radius = 1e4 * math.tan(math.radians(30))
    glow = {"kind": "emissive", "radiance": 1 / (math.pi * math.sin(math.radians(30)) ** 2)}
    lamp = {"shape": "disk", "center": [0, 0, 1e4], "normal": [0, 0, -1], "radius": radius, "material": glow}
    other, other_error = flat_mean(
        scene_of([plate, lamp], camera, depth=2, resolution=(32, 32)), "lamp on metal", spp=512
    )
    assert_equivalent(mean - other, np.hypot(error, other_error), 0, 0.02 * other)


def test_suns_stand_last_and_are_counted() -> None:
    lights = [SUN, {"kind": "point", "position": [0, 0, 2], "intensity": 1}, SUN | {"diameter_degrees": 2}]
    plan = make_plan(load_scene(ground_under(lights)))
    assert plan.surroundings.record["first_sun"] == 1
    assert plan.surroundings.record["suns"] == 2
    assert plan.emitters.records["pick"].sum() == pytest.approx(1)


BAD = {
    "empty": ("", "no line TILT="),
    "a picture": ("\x89PNG\r\n", "no line TILT="),
    "text among numbers": ("TILT=NONE\n1 x 2\n", "text among its numbers"),
    "cut off": ("TILT=NONE\n1 1000 1 2 1 1\n", "is cut off before its angles"),
    "cut off in the table": ("TILT=NONE\n1 1000 1 3 1 1 2 0 0 0 1 1 50 0 45 90 0 5 4\n", "got 6 of 7"),
    "type B": ("TILT=NONE\n1 1000 1 1 1 2 2 0 0 0 1 1 50 0 0 5\n", "photometric type B"),
    "a billion angles": ("TILT=NONE\n1 1000 1 1e9 1 1 2 0 0 0 1 1 50 0 0 5\n", "unusable numbers of angles"),
    "falling angles": ("TILT=NONE\n1 1000 1 2 1 1 2 0 0 0 1 1 50 90 0 0 5 5\n", "vertical angles that do not rise"),
    "half a turn short": ("TILT=NONE\n1 1000 1 1 2 1 2 0 0 0 1 1 50 0 0 100 5 5\n", "horizontal angles"),
    "negative": ("TILT=NONE\n1 1000 1 1 1 1 2 0 0 0 1 1 50 0 0 -5\n", "negative intensity"),
    "not finite": ("TILT=NONE\n1 1000 1 1 1 1 2 0 0 0 1 1 50 0 0 nan\n", "not finite"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_luminaire_is_refused_with_its_place(name, tmp_path: Path) -> None:
    text, message = BAD[name]
    (tmp_path / "bad.ies").write_text(text, "latin-1")
    light = {"kind": "ies", "file": "bad.ies", "position": [0, 0, 2]}
    scene = load_scene(ground_under([light]), base_dir=tmp_path)
    with pytest.raises(InputError, match=rf"^lights\[0\]\.file: .*{message}"):
        rptcam_cl.render(scene, spp=1)


def test_tilt_table_is_left_out() -> None:
    text = LUMINAIRE.read_text().replace("TILT=NONE", "TILT=INCLUDE\n1\n3\n0 45 90\n1 0.9 0.8")
    plain, tilted = read_luminaire(LUMINAIRE), read_luminaire(text.encode())
    np.testing.assert_array_equal(plain.watts, tilted.watts)
