"""Light lost in a lens: products over its surfaces, Beer's law in its glass, T-numbers."""

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.glass import BARE, MAGNESIUM_FLUORIDE, Interface
from rptcam_cl.optics.irradiance import film_irradiance, lens_info, on_axis_irradiance
from rptcam_cl.optics.lens import film_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import (
    COATED,
    IDEAL,
    UNCOATED,
    LensTransmission,
    Status,
    axial_transmittance,
    with_coating,
)

GLASS_ALONE = LensTransmission(fresnel=False, coatings=False)
GREY = {"thickness_mm": 10, "wavelengths_nm": [400, 700], "values": [0.8, 0.5]}


def slab(count=1, thickness=5.0, glass="N-BK7"):
    """Plane plates, each with air behind it."""
    rows = []
    for _ in range(count):
        rows += [{"thickness": thickness, "glass": glass, "diameter": 40}, {"thickness": 1.0, "diameter": 40}]
    del rows[-1]["thickness"]
    return load_lens({"name": "plates", "surfaces": rows})


@pytest.mark.parametrize("count", [1, 2, 7])
def test_surfaces_multiply(count):
    lens = slab(count, glass={"index": 1.5})
    assert axial_transmittance(lens, 550.0, UNCOATED) == pytest.approx(0.96 ** (2 * count), rel=1e-12)
    coated = with_coating(lens, MAGNESIUM_FLUORIDE)
    each = 1 - ((1.38**2 - 1.5) / (1.38**2 + 1.5)) ** 2
    assert axial_transmittance(coated, 550.0, COATED) == pytest.approx(each ** (2 * count), rel=1e-12)
    assert axial_transmittance(coated, 550.0, UNCOATED) == pytest.approx(0.96 ** (2 * count), rel=1e-12)
    assert axial_transmittance(lens, 550.0, IDEAL) == 1.0


def test_glass_absorbs_along_the_slanted_way():
    lens = slab(thickness=8.0, glass={"index": 1.5, "transmittance": GREY})
    sine = np.array([0.0, 0.3, 0.7])
    directions = np.stack([sine, np.zeros(3), np.sqrt(1 - sine**2)], axis=1)
    rays = lens.trace([[0, 0, -1]], directions, 400.0, "scene", transmission=GLASS_ALONE)
    ways = 8.0 / np.sqrt(1 - (sine / 1.5) ** 2)
    np.testing.assert_allclose(rays.transmittance, 0.8 ** (ways / 10), rtol=1e-12)
    middle = float(axial_transmittance(lens, 550.0, GLASS_ALONE))  # straight lines in the logarithm
    assert middle == pytest.approx((0.8 * 0.5) ** 0.4, rel=1e-12)


def test_bundled_glass_has_the_catalogues_internal_transmittance():
    lens = slab(thickness=25.0)
    assert axial_transmittance(lens, [400.0, 546.0], GLASS_ALONE) == pytest.approx([0.992, 0.996], abs=1e-12)
    with pytest.raises(InputError, match=r"absorption of N-BK7 is known from 300 to 1060 nm \(requested 1500 nm\)"):
        axial_transmittance(lens, 1500.0, COATED)
    assert axial_transmittance(lens, 1500.0, LensTransmission(absorption=False)) < 1


@pytest.mark.parametrize("losses", [UNCOATED, COATED, GLASS_ALONE])
@pytest.mark.parametrize("name", ["cooke-triplet-50mm", "planar-1897", "achromat-100mm"])
def test_light_that_goes_back_loses_the_same(name, losses):
    lens = with_coating(load_lens(name), MAGNESIUM_FLUORIDE)
    random = np.random.default_rng(5)
    film = lens.length + 50.0
    origins = np.column_stack([random.uniform(-8, 8, (200, 2)), np.full(200, film)])
    aims = np.column_stack([random.uniform(-0.5, 0.5, (200, 2)), np.full(200, lens.length)])
    waves = random.uniform(400, 700, 200)
    rays = lens.trace(origins, aims - origins, waves, transmission=losses)
    good = rays.passed
    assert good.sum() > 50
    assert np.all(rays.transmittance[~good] == 0)
    back = lens.trace(rays.origins[good], -rays.directions[good], waves[good], "scene", transmission=losses)
    np.testing.assert_allclose(back.transmittance, rays.transmittance[good], rtol=1e-9)
    assert np.all(back.transmittance < 1)


def test_axial_ray_has_the_axial_transmittance_at_each_wavelength():
    lens = with_coating(load_lens("planar-1897"), MAGNESIUM_FLUORIDE)
    waves = np.array([420.0, 550.0, 650.0])
    origins = np.tile([0.0, 0.0, lens.length + 50], (3, 1))
    rays = lens.trace(origins, [[0, 0, -1]], waves, transmission=COATED)
    np.testing.assert_allclose(rays.transmittance, axial_transmittance(lens, waves, COATED), rtol=1e-12)


def test_rays_are_the_same_with_and_without_losses():
    lens = load_lens("dgauss-50mm")
    origins = np.array([[0.0, 0.0, 90.0]] * 3)
    directions = np.array([[0, 0, -1], [0.0, 0.1, -1], [0.0, 0.9, -1]])
    plain, lossy = (lens.trace(origins, directions, transmission=losses) for losses in (None, COATED))
    assert plain.transmittance is None
    assert lens.trace(origins, directions, transmission=IDEAL).transmittance is None
    for name in ("origins", "directions", "status", "surface", "optical_path"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(lossy, name))


def test_nothing_comes_through_total_reflection():
    wedge = load_lens(
        {
            "name": "prism",
            "surfaces": [
                {"thickness": 20, "glass": {"index": 1.5}, "diameter": 60},
                {"diameter": 60, "tilt_degrees": [45, 0]},
            ],
        }
    )
    rays = wedge.trace([[0, 0, -5]], [[0, 0, 1]], 550.0, "scene", transmission=COATED)
    assert rays.status[0] == Status.total_internal_reflection
    assert rays.transmittance[0] == 0


def test_light_beside_half_a_lens_loses_nothing():
    half = {"clear": {"half_plane_degrees": 90}, "outside": "pass", "diameter": 40}
    lens = load_lens(
        {
            "name": "split dioptre",
            "surfaces": [{**half, "thickness": 4, "glass": {"index": 1.5, "transmittance": GREY}}, half],
        }
    )
    rays = lens.trace([[0, 5, -5], [0, -5, -5]], [[0, 0, 1]], 400.0, "scene", transmission=COATED)
    np.testing.assert_allclose(rays.transmittance, [0.96**2 * 0.8**0.4, 1.0], rtol=1e-12)


def test_irradiance_falls_by_the_mean_over_the_pupil():
    lens = slab(3)
    stop = {"stop": True, "diameter": 4.0, "thickness": 1.0}
    rows = [{"thickness": s.thickness or 1.0, "glass": "N-BK7" if k % 2 == 0 else "air", "diameter": 40}
            for k, s in enumerate(lens.surfaces)]  # fmt: skip
    rows[-1].pop("thickness")
    lens = load_lens({"name": "plates behind a stop", "surfaces": [stop, *rows]})
    ideal = on_axis_irradiance(lens, 100.0)
    near_axis = float(axial_transmittance(lens, 587.5618, UNCOATED))
    assert on_axis_irradiance(lens, 100.0, transmission=UNCOATED) / ideal == pytest.approx(near_axis, rel=2e-5)
    assert on_axis_irradiance(lens, 100.0, transmission=IDEAL) == ideal


def test_mean_over_a_wide_pupil_is_that_of_many_rays():
    lens = load_lens("double-gauss-50mm-f1.1")
    back = film_distance(lens, np.inf)
    for height in (0.0, 12.0):
        random = np.random.default_rng(1)
        aims = random.uniform(-25, 25, (60_000, 2))
        origin = np.array([height, 0.0, lens.length + back])
        directions = np.column_stack([aims - origin[:2], np.full(len(aims), -back)])
        rays = lens.trace(origin[None], directions, transmission=UNCOATED)
        weights = rays.passed / (directions**2).sum(axis=1) ** 2
        expected = (weights @ rays.transmittance) / weights.sum()
        noise = np.std(rays.transmittance[rays.passed]) / np.sqrt(rays.passed.sum())
        ratio = film_irradiance(lens, back, height, transmission=UNCOATED) / film_irradiance(lens, back, height)
        assert noise < 1e-3
        assert ratio == pytest.approx(expected, abs=4 * noise + 1e-4)


def test_t_number_is_the_working_f_number_over_the_root_of_the_transmittance():
    lens = load_lens("cooke-triplet-50mm")
    passed = float(axial_transmittance(lens, 550.0, UNCOATED))
    info, bare = lens_info(lens, wavelength_nm=550.0), lens_info(lens, wavelength_nm=550.0, transmission=UNCOATED)
    assert info["axial_transmittance"] == 1.0
    assert bare["axial_transmittance"] == passed
    assert bare["t_number"] == pytest.approx(info["t_number"] / np.sqrt(passed), rel=1e-3)
    assert 0.68 < passed < 0.74  # six surfaces of index 1.62


def test_coating_of_the_whole_lens_goes_between_glass_and_air_alone():
    lens = with_coating(load_lens("dgauss-50mm"), MAGNESIUM_FLUORIDE)
    coated = [k for k, surface in enumerate(lens.surfaces) if surface.coating]
    assert coated == [0, 1, 2, 4, 6, 8, 9, 10]  # not the cement of surfaces 3 and 7, nor the stop
    cement = BARE.transmittance(Interface(1.67, 1.699), 550.0)
    assert cement > 0.9999
