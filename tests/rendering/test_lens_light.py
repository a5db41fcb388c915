"""Light through real lenses: a uniform world of radiance 1 gives the film irradiance of the truth tables."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

import rptcam_cl
from rptcam_cl.optics.irradiance import film_irradiance
from rptcam_cl.optics.library import load_lens
from tests.rendering.pictures import WHITE, batches, flat_mean, pixels, scene_of, seed_of
from tests.support.cases import slow
from tests.support.statistics import assert_equivalent, assert_same_tiles

TRUTH = Path(__file__).parents[1] / "data" / "lens_truth"
FILM = 4096  # pixels across the imagined film, of which 16 x 16 are rendered
POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}


def world_through(lens, film_distance_mm, width_mm, *, resolution, exposure="irradiance", crop=None, **options):
    """A white world, and nothing else, through a lens."""
    camera = {"kind": "realistic", "lens": lens, "focus": {"film_distance_mm": film_distance_mm}, **POSE, **options}
    film = {"width_mm": width_mm} | ({"crop": crop} if crop else {})
    return scene_of([], camera, film=film, resolution=resolution, environment=WHITE, exposure=exposure, depth=1)


def truth(name):
    return json.loads((TRUTH / f"{name}.json").read_text())


def prescription(name):
    """The lens of a truth file as a mapping, with the indices at 587.56 nm that its numbers belong to."""
    rows = []
    for surface in truth(name)["surfaces"]:
        row = {"diameter": 2 * surface["semi_diameter"]}
        row |= {"radius": surface["R"]} if surface["R"] else {}
        row |= {"thickness": surface["thickness"]} if surface["thickness"] is not None else {}
        row |= {"stop": True} if surface["is_stop"] else {}
        row |= {"glass": {"index": surface["n_after"]["d"]}} if surface["n_after"]["d"] != 1 else {}
        rows.append(row)
    return {"name": name, "surfaces": rows}


def spot(radius_mm, width_mm):
    """Crop of 16 x 16 pixels whose middle lies at a film radius, along the diagonal in the lower right quarter."""
    step = FILM / width_mm * radius_mm / math.sqrt(2)
    at = min(round(FILM / 2 + step) - 8, FILM - 16)
    return [at / FILM, (at + 16) / FILM] * 2


APERTURES = [("dgauss50", 0), ("dgauss50", 1), ("wide22", 0), ("planar_us583336", 0)]
# The edge of the field, and the middle stopped down; the other rows are slow.
CHOSEN = {("dgauss50", 0, 2), ("dgauss50", 1, 0)}
ROWS = [
    pytest.param(
        name,
        block,
        row,
        id=f"{name} {truth(name)['irradiance'][block]['aperture']} row {row}",
        marks=() if (name, block, row) in CHOSEN else pytest.mark.slow,
    )
    for name, block in APERTURES
    for row in range(5)
]


@pytest.mark.parametrize(("name", "block", "row"), ROWS)
def test_film_irradiance_is_that_of_the_truth_table(name, block, row):
    case = truth(name)["irradiance"][block]
    lens = load_lens(prescription(name))
    radius, expected = case["rows"][row]["r"], case["rows"][row]["E"]
    width = 2.02 * case["half_diagonal"] / math.sqrt(2)  # so that the last radius is just on the film
    scene = world_through(
        prescription(name),
        case["film_z"] - lens.length,
        width,
        resolution=(FILM, FILM),
        crop=spot(radius, width),
        stop_diameter_mm=2 * case["stop_semi_diameter"],
    )
    mean, error = flat_mean(scene, f"{name} {block} {row}", spp=(6000, 6000, 6000, 16000, 48000)[row])
    assert_equivalent(mean[0], error[0], expected, 0.005 * expected)


ASSIGNMENT = {
    "dgauss-50mm": (36.77, 40.0),
    "wide-22mm": (14.54, 40.0),
    "fisheye-10mm": (23.192, 20.0),
    "telephoto-250mm": (123.7439, 50.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fisheye-10mm", "telephoto-250mm"])
def test_light_falls_off_across_the_film_as_in_float64(name):
    distance, width = ASSIGNMENT[name]
    # the right half of a strip through the middle: radii 0 to half the width, averaged over 16 x 16 pixels
    scene = world_through(name, distance, width, resolution=(256, 16), crop=[0.5, 1.0, 0.0, 1.0])
    film = pixels(scene, seed=seed_of(name), spp=4000)[..., 0]
    x, y = np.meshgrid((np.arange(128) + 0.5) * width / 256, (np.arange(16) - 7.5) * width / 256)
    grid = np.linspace(0, np.hypot(width / 2, width / 32), 24)
    smooth = PchipInterpolator(grid, film_irradiance(load_lens(name), distance, grid))
    expected = smooth(np.hypot(x, y))
    got, wanted = (picture.reshape(16, 8, 16).mean((0, 2)) for picture in (film, expected))
    # noise of a million samples, of which few pass at the edge: 0.2 % of the centre in all
    np.testing.assert_allclose(got, wanted, rtol=0.006, atol=0.0015 * wanted[0])


@pytest.mark.parametrize(
    "name",
    [
        "dgauss-50mm",
        *(slow(name) for name in ASSIGNMENT if name != "dgauss-50mm"),
        "human-eye",  # whose film lies in vitreous, not in air
    ],
)
def test_on_axis_irradiance_in_the_metadata_is_that_of_the_film(name):
    distance, width = ASSIGNMENT.get(name, (16.67, 6.0))
    crop = [0.498046875, 0.501953125] * 2  # 16 of 4096 pixels
    scene = world_through(name, distance, width, resolution=(FILM, FILM), crop=crop)
    stated = rptcam_cl.render(scene, spp=1).metadata["on_axis_irradiance"]
    mean, error = flat_mean(scene, f"axis {name}", spp=6000)
    assert_equivalent(mean[0], error[0], stated, 0.005 * stated)
    relative, error = flat_mean(scene | {"exposure": "relative"}, f"relative {name}", spp=6000)
    assert_equivalent(relative[0], error[0], 1.0, 0.005)


@pytest.mark.parametrize(("name", "stop"), [*(slow(name, None) for name in ASSIGNMENT), ("wide-22mm", 3.0)])
def test_every_way_to_aim_at_the_pupil_gives_the_same_picture(name, stop):
    distance, width = ASSIGNMENT[name]
    options = {"stop_diameter_mm": stop} if stop else {}
    pictures = {}
    for pupil in ("rear", "thick", "bounds", "tight"):
        scene = world_through(name, distance, width, resolution=(48, 32), pupil=pupil, **options)
        pictures[pupil] = batches(scene, f"{name} {pupil}", 2, spp=256)
    for pupil in ("thick", "bounds", "tight"):
        assert_same_tiles(pictures["rear"], pictures[pupil])
    # the reason to aim at the true outline
    assert pictures["tight"].variance.sum() < 0.7 * pictures["rear"].variance.sum()


def test_lens_outcomes_count_every_camera_ray_once():
    scene = world_through("wide-22mm", 14.54, 36.0, resolution=(37, 21), pupil="rear")
    image = rptcam_cl.render(scene, spp=13)
    outcomes = image.stats["lens"]
    assert {"passed", "missed", "clipped", "total_internal_reflection"} <= set(outcomes)
    assert sum(outcomes.values()) == image.stats["samples"] == 37 * 21 * 13
    assert 0 < outcomes["passed"] < outcomes["clipped"]


def test_camera_without_a_lens_reports_no_outcomes():
    camera = {"kind": "pinhole", "fov_degrees": 40, **POSE}
    assert "lens" not in rptcam_cl.render(scene_of([], camera, environment=WHITE), spp=1).stats


def test_stopping_down_by_a_stop_halves_the_light():
    means = []
    for f_number in (4, 4 * math.sqrt(2)):
        scene = world_through("dgauss-50mm", 36.77, 1.0, resolution=(16, 16), f_number=f_number)
        means.append(flat_mean(scene, f"f/{f_number}", spp=6000)[0][0])
    # the sine of the cone, not its tangent, counts: a hundredth at f/4
    assert means[0] / means[1] == pytest.approx(2, rel=0.015)


@pytest.mark.parametrize("exposure", ["relative", "irradiance"])
def test_picture_is_upright_unless_it_is_left_as_it_lies_on_the_film(exposure):
    lamp = {"kind": "emissive", "radiance": 1.0}
    # up and to the right of the axis, 10 m ahead
    disk = {"shape": "disk", "center": [1.2, 0.8, -10], "normal": [0, 0, 1], "radius": 0.5, "material": lamp}
    for flip, expected in ((True, (1.2, 0.8)), (False, (-1.2, -0.8))):
        scene = world_through("dgauss-50mm", 36.6, 36.0, resolution=(36, 24), exposure=exposure, flip=flip)
        film = pixels({**scene, "objects": [disk], "environment": None}, spp=64)[..., 0]
        x = (film.sum(0) * (np.arange(36) - 17.5)).sum() / film.sum()
        y = (film.sum(1) * (11.5 - np.arange(24))).sum() / film.sum()
        # a focal length of 50 mm images 10 m at 1 : 199, pixels of 1 mm; distortion and vignetting shift a little
        assert (x, y) == pytest.approx(np.array(expected) * 1000 / 199, abs=0.12)


def test_roulette_does_not_depend_on_the_exposure():
    # weights of a slow lens are tiny; roulette must judge the path, not the exposure
    wall = {
        "shape": "plane",
        "point": [0, 0, -5],
        "normal": [0, 0, 1],
        "material": {"kind": "matte", "reflectance": 1.0},
    }
    noise = {}
    for exposure in ("relative", "irradiance"):
        scene = world_through("dgauss-50mm", 36.6, 4.0, resolution=(32, 32), exposure=exposure, f_number=16)
        scene = {**scene, "objects": [wall], "render": {"max_depth": 4, "roulette_depth": 1}}
        film = pixels(scene, spp=64, seed=seed_of("roulette"))[..., 0]
        noise[exposure] = film.std() / film.mean()
    assert noise["irradiance"] == pytest.approx(noise["relative"], rel=0.01)
