"""Seidel sums against closed forms and against real rays in the limit, Zernike coefficients against both."""

import numpy as np
import pytest

from rptcam_cl import load_lens
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import aberrations, field_measures, ray_trace, spots
from tests.optics.truth import truth

NM, F, C = 587.5618, 486.1327, 656.2725
COUNTED = ("cooke-triplet-50mm", "tessar-100mm", "achromat-100mm", "plano-convex-100mm", "dgauss-50mm")


def sums(lens, degrees, **options):
    return spots.setting(lens), lens.seidel(degrees, **options).rows


def mirror(conic, stop_ahead):
    """f = 100 mm, f/10, its stop so far ahead."""
    return load_lens({
        "name": "mirror",
        "surfaces": [
            {"stop": True, "thickness": stop_ahead, "diameter": 10},
            {"radius": -200, "conic": conic, "mirror": True, "diameter": 60},
        ],
    })  # fmt: skip


def test_a_spherical_mirror_has_the_aberrations_of_textbooks():
    """W040 = y^4 / (4 R^3), the same over the field of a stop in its centre; Petzval's sum."""
    rows = mirror(0.0, 200.0).seidel(2.0).rows
    total = rows[-1]
    assert abs(total["spherical"]) == pytest.approx(8 * 5.0**4 / (4 * 200.0**3), rel=1e-12)
    assert total["coma"] == pytest.approx(0, abs=1e-12)
    assert total["astigmatism"] == pytest.approx(0, abs=1e-12)
    lagrange = 5.0 * np.tan(np.radians(2.0))
    assert abs(total["petzval"]) == pytest.approx(lagrange**2 * 2 / 200.0, rel=1e-12)
    assert total["axial_colour"] == total["lateral_colour"] == 0.0
    assert rows[0]["spherical"] == 0.0


def test_a_paraboloid_has_coma_and_astigmatism_alone():
    """About a stop at the mirror: W131 = y^3 tan / R^2, W222 = y^2 tan^2 / R, whatever the conic constant."""
    total, tangent = mirror(-1.0, 1e-9).seidel(1.0).rows[-1], np.tan(np.radians(1.0))
    assert total["spherical"] == pytest.approx(0, abs=1e-15)
    assert abs(total["coma"]) == pytest.approx(2 * 5.0**3 * tangent / 200.0**2, rel=1e-9)
    assert abs(total["astigmatism"]) == pytest.approx(2 * 5.0**2 * tangent**2 / 200.0, rel=1e-9)
    assert mirror(0.0, 1e-9).seidel(1.0).rows[-1]["coma"] == pytest.approx(total["coma"], rel=1e-9)


@pytest.mark.parametrize("name", COUNTED)
def test_seidel_sums_are_the_limit_of_real_rays(name):
    lens = load_lens(name)
    use, rows = sums(lens, 0.05)
    total = rows[-1]
    slope = aberrations.paraxial_rays(use, 0.05)[0][-1, 1]
    curves = aberrations.curvature_rows(use, [0.05], [NM])[0]
    sagittal = (total["astigmatism"] + total["petzval"]) / (2 * slope**2)
    tangential = (3 * total["astigmatism"] + total["petzval"]) / (2 * slope**2)
    scale = abs(total["astigmatism"]) + abs(total["petzval"])
    assert curves["sagittal_mm"] == pytest.approx(-sagittal, abs=2e-3 * scale / slope**2)
    assert curves["tangential_mm"] == pytest.approx(-tangential, abs=2e-3 * scale / slope**2)
    height = 0.02 * lens.first_order().entrance_pupil.diameter_mm / 2
    ray = lens.trace([[0, height, 0]], [[0, 0, 1]], NM, "scene")
    falls_um = 1e3 * ray_trace.at_plane(ray.origins, ray.directions, use.film_z)[0, 1]
    transverse = lens.seidel(1.0, unit="transverse").rows[-1]
    assert falls_um / 0.02**3 == pytest.approx(transverse["spherical"], rel=5e-3)
    off_mm = field_measures.distortion_table(use, [1.0], [NM], "tan")[0]["distortion_mm"]
    assert 1e3 * off_mm == pytest.approx(transverse["distortion"], rel=2e-2, abs=1e-9)


@pytest.mark.parametrize("name", ["plano-convex-100mm", "cooke-triplet-50mm"])
def test_sums_of_colour_are_the_limit_of_close_wavelengths(name):
    lens = load_lens(name)
    use, near = spots.setting(lens), (NM - 0.5, NM + 0.5)
    total = lens.seidel(1.0, near).rows[-1]
    slope = aberrations.paraxial_rays(use, 1.0)[0][-1, 1]
    focus = [lens.first_order(nm).back_focal_distance_mm for nm in near]
    assert focus[0] - focus[1] == pytest.approx(-total["axial_colour"] / slope**2, rel=1e-4)
    (wide,) = lens.seidel(0.1, near, unit="transverse").rows[-1:]
    heights = [field_measures.film_height(use, 0.1, nm) for nm in near]
    assert 1e3 * (heights[0] - heights[1]) == pytest.approx(wide["lateral_colour"], rel=1e-3)


@pytest.mark.parametrize("name", ["achromat-100mm", "plano-convex-100mm", "cooke-triplet-50mm"])
@pytest.mark.parametrize("distance_m", [None, 0.5])
def test_coma_is_that_of_real_fans_from_far_and_near(name, distance_m):
    """Rays on both sides of the pupil together leave coma alone, at half its height a quarter."""
    use = spots.setting(load_lens(name), 20.0, distance_m)
    coma = aberrations.seidel(use, 0.2, (F, C), unit="transverse").rows[-1]["coma"]
    fan = aberrations.ray_fan(use, [0.2], [NM], 5).rows
    ends = [row["off_um"] for row in fan if row["tangential"] and abs(row["pupil"]) == 0.5]
    assert len(ends) == 2
    assert 2 * sum(ends) == pytest.approx(coma, rel=0.015)


@pytest.mark.parametrize("name", ["achromat-100mm", "mirror-500mm", "tessar-100mm"])
def test_first_order_rays_are_those_of_pupils_and_focal_length(name):
    lens = load_lens(name)
    first, rows = lens.first_order(), lens.paraxial(1.5).rows
    film, last = rows[-1], rows[-2]
    assert last["surface"] == len(lens.surfaces) - 1
    assert rows[0]["marginal_mm"] == pytest.approx(first.entrance_pupil.diameter_mm / 2)
    assert np.isnan(film["surface"])
    assert film["marginal_mm"] == pytest.approx(0, abs=1e-9)
    assert film["chief_mm"] == pytest.approx(first.focal_length_mm * np.tan(np.radians(1.5)), rel=1e-9)
    assert abs(rows[lens.stop_index]["chief_mm"] if lens.stop_index is not None else 0.0) < 1e-9


@pytest.mark.parametrize(("name", "known"), [("plano-convex-100mm", "la1509"), ("achromat-100mm", "ac254_100_a")])
def test_focal_shifts_are_those_of_the_truth_files(name, known):
    """Paraxial foci to 1e-6 mm, zones to what four decimals of the table leave."""
    lens, lines, chromatic = load_lens(name), truth(known)["wavelengths_nm"], truth(known)["chromatic"]
    film = lens.first_order().back_focal_distance_mm
    rows = {(row["wavelength_nm"], row["zone"]): row["shift_mm"] for row in lens.focal_shift(list(lines.values())).rows}
    for line, nm in lines.items():
        assert film + rows[nm, 0.0] == pytest.approx(chromatic[line]["BFL"], abs=1e-6)
        zones = chromatic["real_axial_focus_by_zone"]
        edge = next(zones[zone] for zone in zones if float(zone) == 1.0)
        assert film + rows[nm, 1.0] == pytest.approx(edge[line], abs=2e-4)


def test_focal_shift_of_a_near_object_is_that_of_its_film():
    lens = load_lens("tessar-100mm")
    for distance_m in (0.5, 3.0):
        rows = lens.focal_shift([NM], focus_distance_m=distance_m).rows
        assert rows[0]["shift_mm"] == pytest.approx(0, abs=1e-9)


ODD = {
    "name": "of every kind",
    "surfaces": [
        {"radius": 60, "radius_x": 45, "conic": -0.4, "conic_x": 0.3, "thickness": 5, "glass": "N-BK7", "diameter": 20},
        {"radius": -90, "radius_x": 150, "form": "toroid", "conic": 1.5, "thickness": 2, "diameter": 20},
        {"stop": True, "thickness": 3, "diameter": 12},
        {"radius": 70, "cylinder": "x", "aspheric": {4: 1e-5}, "thickness": 3, "glass": "SF5", "diameter": 20},
        {"radius": 500, "diameter": 20, "decentre": [0.3, -0.2], "tilt_degrees": [1.0, 2.0, 3.0]},
    ],
}


def test_rays_of_the_other_section_are_rays_with_x_and_y_exchanged():
    lens = load_lens(ODD)
    turned = aberrations.in_section(spots.setting(lens), "x").lens
    origins = np.random.default_rng(3).uniform(-4, 4, (50, 3)) * [1, 1, 0]
    directions = np.random.default_rng(4).uniform(-0.1, 0.1, (50, 3)) * [1, 1, 0] + [0, 0, 1]
    swap = [1, 0, 2]
    one = lens.trace(origins, directions, NM, "scene")
    other = turned.trace(origins[:, swap], directions[:, swap], NM, "scene")
    assert one.passed.sum() > 30
    assert (one.status == other.status).all()
    np.testing.assert_allclose(other.origins, one.origins[:, swap], atol=1e-12)
    np.testing.assert_allclose(other.directions, one.directions[:, swap], atol=1e-13)
    assert turned.first_order(NM, "y").focal_length_mm == pytest.approx(lens.first_order(NM, "x").focal_length_mm)


def fit_of_fan(setting, degrees):
    """Factors of y^3, y^2 of a narrow tangential fan about the chief ray on the film [um], at the edge of the pupil."""
    height = 0.05 * setting.lens.first_order().entrance_pupil.diameter_mm / 2
    middle, _ = aberrations.chief_ray(setting.lens, degrees, NM)
    steps = np.linspace(-1, 1, 9)
    points = np.column_stack([np.zeros(9), middle + height * steps])
    rays = setting.lens.trace(*aberrations.Beam(degrees).rays(points), NM, "scene")
    y = ray_trace.at_plane(rays.origins, rays.directions, setting.film_z)[:, 1]
    factors = np.polynomial.polynomial.polyfit(0.05 * steps, 1e3 * y, 5)
    return factors[3], factors[2]


@pytest.mark.parametrize("section", ["y", "x"])
@pytest.mark.parametrize("name", ["anamorphic-100mm", "cylinder-pair", "odd"])
def test_sums_of_a_section_are_the_limit_of_its_real_rays(name, section):
    whole = load_lens(name) if name != "odd" else load_lens(ODD | {"surfaces": ODD["surfaces"][:3]})
    lens = aberrations.in_section(spots.setting(whole), section).lens
    use = spots.setting(lens)  # at the focus of the section
    total = whole.seidel(0.5, unit="transverse", section=section).rows[-1]
    third, second = fit_of_fan(use, 0.5)
    assert third == pytest.approx(total["spherical"], rel=5e-3)
    assert second == pytest.approx(total["coma"], rel=5e-3)
    slope = aberrations.paraxial_rays(use, 0.5)[0][-1, 1]
    (middle, off) = aberrations.curvature_rows(use, [0.0, 0.5], [NM])
    curved = off["tangential_mm"] - middle["tangential_mm"]
    assert 1e3 * curved * slope == pytest.approx(-total["tangential"], rel=0.02, abs=2e-3)
    assert {"astigmatism", "petzval"}.isdisjoint(total)


def test_lenses_beside_the_axis_or_with_odd_powers_have_no_seidel_sums():
    with pytest.raises(InputError, match="beside the axis or tilted"):
        load_lens(ODD).seidel()
    with pytest.raises(InputError, match="surface 0 has r or r"):
        load_lens({"name": "cone", "surfaces": [
            {"radius": 50, "aspheric": {3: 1e-4}, "thickness": 3, "glass": "N-BK7", "diameter": 8}, {"diameter": 8},
        ]}).seidel(1.0)  # fmt: skip
    with pytest.raises(InputError, match='section: must be "x" or "y"'):
        load_lens("achromat-100mm").spot(section="z")
    with pytest.raises(InputError, match="allowed from 1 to 20"):
        load_lens("achromat-100mm").zernike(order=40)


def test_numbers_of_zernike_terms_are_those_of_the_tables():
    """Noll 1976, table I; the fringe order of the University of Arizona."""
    noll = [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (3, -1), (3, 1), (3, -3), (3, 3), (4, 0), (4, 2), (4, -2)]
    assert [aberrations.noll_number(*term) for term in noll] == list(range(1, 14))
    fringe = [
        (0, 0), (1, 1), (1, -1), (2, 0), (2, 2), (2, -2), (3, 1), (3, -1), (4, 0), (3, 3), (3, -3), (4, 2), (4, -2),
        (5, 1), (5, -1), (6, 0),
    ]  # fmt: skip
    assert [aberrations.fringe_number(*term) for term in fringe] == list(range(1, 17))
    x, y = np.random.default_rng(1).uniform(-0.7, 0.7, (2, 9))
    square = x * x + y * y
    np.testing.assert_allclose(aberrations.zernike_term(4, 0, x, y), 6 * square**2 - 6 * square + 1, atol=1e-14)
    np.testing.assert_allclose(aberrations.zernike_term(3, -1, x, y), (3 * square - 2) * y, atol=1e-14)
    np.testing.assert_allclose(aberrations.zernike_term(2, 2, x, y), x * x - y * y, atol=1e-14)


def test_zernike_coefficients_of_a_slow_lens_are_its_seidel_aberrations():
    """Term 9 is a sixth of W040, 8 a third of W131, 5 half of W222; Noll's are those over their norms."""
    lens = load_lens("plano-convex-100mm")
    found = lens.zernike([0.5], f_number=40.0, rays=64).rows
    by_fringe = {row["fringe"]: row for row in found}
    waves = lens.seidel(0.5, unit="waves", f_number=40.0).rows[-1]
    assert by_fringe[9]["fringe_waves"] == pytest.approx(waves["spherical"] / 6, rel=0.01)
    assert abs(by_fringe[8]["fringe_waves"]) == pytest.approx(abs(waves["coma"]) / 3, rel=0.01)
    assert by_fringe[5]["fringe_waves"] == pytest.approx(-waves["astigmatism"] / 2, rel=0.01)
    assert by_fringe[9]["noll_waves"] == pytest.approx(by_fringe[9]["fringe_waves"] / np.sqrt(5))
    assert by_fringe[8]["noll_waves"] == pytest.approx(by_fringe[8]["fringe_waves"] / np.sqrt(8))
    rms = lens.wavefront([0.5], f_number=40.0, rays=64).rows[0]["rms_waves"]
    assert np.hypot.reduce([row["noll_waves"] for row in found if row["fringe"] > 1]) == pytest.approx(rms, rel=0.005)
    assert found[0]["rest_waves"] < 1e-5


def test_paths_of_ray_fans_are_those_of_the_wavefront():
    lens = load_lens("achromat-100mm")
    rows = lens.ray_fan([0.0], [NM], rays=41).rows
    ahead = [row["ahead_waves"] for row in rows]
    assert len(rows) == 82
    said = lens.wavefront([0.0]).rows[0]
    assert max(ahead) - min(ahead) == pytest.approx(said["peak_to_valley_waves"], abs=0.01)


def test_seidel_sums_of_conics_and_aspheres_are_those_of_other_programs():
    """Of optiland 0.6.3 for the conics; of ray-optics 0.9.8, its object 1e10 mm away, for the asphere."""
    conic = load_lens({"name": "conic", "surfaces": [
        {"stop": True, "thickness": 8, "diameter": 8},
        {"radius": 90, "conic": -0.6, "thickness": 5, "glass": "N-SF11", "diameter": 24},
        {"radius": -110, "conic": 2.0, "diameter": 24},
    ]}).seidel(5.0).rows[1:3]  # fmt: skip
    asphere = load_lens({"name": "asphere", "surfaces": [
        {"radius": 60, "conic": -0.5, "aspheric": {4: 1e-6, 6: 1e-9}, "thickness": 5, "glass": "N-SF11",
         "diameter": 40},
        {"radius": -90, "aspheric": {4: -2e-6}, "thickness": 2, "diameter": 40},
        {"stop": True, "diameter": 10},
    ]}).seidel(5.0).rows[:2]  # fmt: skip
    names = ("spherical", "coma", "astigmatism", "petzval", "distortion", "axial_colour", "lateral_colour")
    known = [
        (-7.882605307740274e-05, 0.00015650982627196154, 0.0003924245657937078, 0.0005983091588138811,
         0.0021335752276173394, 0.00304387703180351, 0.006524465969518766),
        (0.00222099889287143, -0.0012506340770188093, 0.000904230418482678, 0.0004895256753931754,
         -0.0009274113058683895, 0.006560498680400926, -0.004431850018512219),
        (0.0048786484854753615, 0.0005541266765655209, 0.0008015897929371411, 0.001655316868275826,
         0.002143818092761132),
        (0.02451343488019338, -0.008732029335953306, 0.004675448405432919, 0.001103544578850551,
         -0.0032054459928741847),
    ]  # fmt: skip
    for row, values, exact in zip((*conic, *asphere), known, (1e-12, 1e-12, 1e-6, 1e-6), strict=True):
        assert [row[name] for name in names[: len(values)]] == pytest.approx(values, rel=exact)
