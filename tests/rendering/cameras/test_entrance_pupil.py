"""Where the metadata of a picture say that the entrance pupil lies."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad

from rptcam_cl.optics.beams import chief_ray
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.surface import StopMask, blades, heart, star
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.cameras.model import opening_irradiance
from rptcam_cl.rendering.cameras.setting import entrance_pupil, lens_setting, pupil_in_world
from rptcam_cl.scene.load import load_scene
from tests.support.cases import one_in

FILM = {"resolution": [36, 24], "size_mm": [36, 24]}


def scene(**camera):
    return load_scene({
        "film": FILM,
        "camera": {"kind": "realistic", "lens": "dgauss-50mm", "eye": [1, 2, 3], "target": [1, 2, -5],
                   "focus": {"distance_m": 1.3}} | camera,
    })  # fmt: skip


def test_pupil_lies_ahead_of_the_eye_in_the_world():
    said = camera_model(scene()).metadata["entrance_pupil"]
    setting = lens_setting(scene())
    ahead = setting.lens.film_z(setting.film_distance_mm) - setting.lens.first_order().entrance_pupil.distance_mm
    assert said["ahead_of_eye_mm"] == pytest.approx(ahead)
    assert ahead == pytest.approx(50.3, abs=0.1)
    assert said["diameter_mm"] == pytest.approx(25, abs=0.3)
    assert pupil_in_world(scene(), said)["world_m"] == pytest.approx([1, 2, 3 - ahead * 1e-3])


def test_pupil_of_other_units_and_models():
    metres = load_scene(scene().model_dump(exclude_defaults=True) | {"metres_per_unit": 0.5})
    said = entrance_pupil(metres, lens_setting(metres)).described()
    assert pupil_in_world(metres, said)["world_m"] == pytest.approx([0.5, 1, 1.5 - said["ahead_of_eye_mm"] * 1e-3])
    thick = camera_model(scene(kind="thick_lens")).metadata["entrance_pupil"]
    assert "drift_mm" not in thick
    assert thick["ahead_of_eye_mm"] == pytest.approx(50.3, abs=0.1)
    own = {"kind": "pinhole", "eye": [1, 2, 3], "target": [0, 0, 0], "fov_degrees": 40}
    pinhole = load_scene({"film": FILM, "camera": own})
    said = camera_model(pinhole).metadata["entrance_pupil"]
    assert (said["ahead_of_eye_mm"], said["diameter_mm"]) == (0, 0)
    assert pupil_in_world(pinhole, said)["world_m"] == pytest.approx([1, 2, 3])


def test_drift_is_where_chief_rays_from_the_scene_cross_the_axis():
    distant = scene(focus={"film_distance_mm": load_lens("dgauss-50mm").first_order().back_focal_distance_mm})
    drift = dict(entrance_pupil(distant, lens_setting(distant)).drift_mm)
    lens, film_z = load_lens("dgauss-50mm"), lens_setting(distant).lens.film_z(lens_setting(distant).film_distance_mm)
    corner = np.hypot(18, 12)
    angles = np.linspace(5, 25, 41)
    heights, crossings = [], []
    for degrees in angles:
        height, ray = chief_ray(lens, degrees)
        heights.append(ray.origins[0, 1] + ray.directions[0, 1] / ray.directions[0, 2] * (film_z - ray.origins[0, 2]))
        crossings.append(-height / np.tan(np.radians(degrees)))
    expected = lens.first_order().entrance_pupil.distance_mm - np.interp([corner / 2, corner], heights, crossings)
    assert [drift[0.5], drift[1.0]] == pytest.approx(expected.tolist(), abs=2e-3)


RADII = [1e-4, 0.05, 0.6]


@pytest.mark.parametrize("radius", one_in(3, RADII))
def test_many_blades_and_fine_masks_come_to_the_circle(radius):
    circle = math.pi * radius**2 / (1 + radius**2)
    assert opening_irradiance(None, radius, 1.0) == circle
    assert opening_irradiance(blades(64, 0.0, 1.0), radius, 1.0) == pytest.approx(circle, rel=1e-3)
    y, x = np.mgrid[-255.5:256, -255.5:256] / 256
    assert opening_irradiance(StopMask(np.hypot(x, y) <= 1), radius, 1.0) == pytest.approx(circle, rel=1e-3)


@pytest.mark.parametrize("radius", RADII)
def test_square_is_the_integral_of_the_fourth_power_of_the_cosine(radius):
    half = radius * math.sqrt(0.5)
    expected, _ = dblquad(lambda y, x: (1 + x * x + y * y) ** -2, -half, half, -half, half, epsrel=1e-9)
    square = blades(4, 45.0, 0.0)
    assert opening_irradiance(square, radius, 1.0) == pytest.approx(expected, rel=1e-9)
    assert opening_irradiance(square, 2 * radius, 2.0) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("shape", [star(5, 0.4, 90.0), heart(0.0)])
def test_far_away_the_area_counts(shape):
    assert opening_irradiance(shape, 1e-3, 1.0) == pytest.approx(shape.area * 1e-6, rel=1e-5)
