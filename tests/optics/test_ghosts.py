"""Ghosts against the truth file: two programs with Fresnel's and the layer's amplitudes carried along every path."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.as_built import scatter_share, scattered, sines_of_film
from rptcam_cl.optics.beams import Beam, film_chief_rays
from rptcam_cl.optics.ghosts import (
    NOWHERE,
    Entry,
    Ghosts,
    Lit,
    find_ghosts,
    ghost_image,
    light_by_paraxial_rays,
    pairs_of,
    paraxial_steps,
    together,
    unfold,
    ways_of_four,
)
from rptcam_cl.optics.glass import (
    BARE,
    MAGNESIUM_FLUORIDE,
    Interface,
    Layer,
    LayerStack,
    QuarterWave,
    constant_reflectance,
)
from rptcam_cl.optics.irradiance import veiling_glare
from rptcam_cl.optics.lens import Lens, system_matrix
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import UNCOATED, axial_transmittance, with_coating
from tests.optics.truth import truth
from tests.support.cases import one_in, slow

TRUTH = json.loads((Path(__file__).parents[1] / "data" / "wave_truth" / "ghosts.json").read_text())
DGAUSS = TRUTH["dgauss50"]


def lens_of(name: str, nm: float = 550.0, stop: float | None = None) -> Lens:
    indices = TRUTH[name]["indices"][f"{nm:.0f}"]
    rows = []
    for surface, index in zip(truth(name)["surfaces"], indices, strict=True):
        semi = stop if stop is not None and surface["is_stop"] else surface["semi_diameter"]
        row = {"diameter": 2 * semi} | ({"stop": True} if surface["is_stop"] else {})
        row |= {"radius": surface["R"]} if surface["R"] else {}
        row |= {"thickness": surface["thickness"]} if surface["thickness"] is not None else {}
        rows.append(row | ({"glass": {"index": index}} if index != 1 else {}))
    return load_lens({"name": name, "surfaces": rows})


@cache
def ghosts_of(name: str, number: int, coating: str) -> Ghosts:
    case = TRUTH[name]["cases"][number]
    lens = lens_of(name, case["nm"], case["stop_semi_diameter"])
    lens = with_coating(lens, MAGNESIUM_FLUORIDE) if coating == "mgf2" else lens
    source = case["source"]
    if source["kind"] == "infinity":
        beam = Beam(source["deg"])
    else:
        _, y, z = source["point"]
        beam = Beam(float(np.degrees(np.arctan(y / z))), -z)
    film = TRUTH[name]["film_z"] - lens.length
    return find_ghosts(Lit(lens, film, beam, case["nm"], tuple(TRUTH[name]["film_mm"])))


def cases(name: str, *numbers: int) -> list[tuple[str, int, str]]:
    return [(name, number, coating) for number in numbers for coating in ("bare", "mgf2")]


def total(found: Ghosts) -> float:
    return sum(ghost.flux_in_frame for ghost in found.ghosts) / found.reference


@pytest.mark.parametrize("name", TRUTH)
def test_pairs_have_the_paraxial_images_of_the_truth(name: str) -> None:
    lens, film = lens_of(name), TRUTH[name]["film_z"]
    for (i, j), row in zip(TRUTH[name]["pairs"], TRUTH[name]["paraxial"]["550"], strict=True):
        far = ghost_image(lens, (j, i), film - lens.length, 550.0)
        near = ghost_image(lens, (j, i), film - lens.length, 550.0, 1000.0)
        _, (c, d) = system_matrix(unfold(lens, (j, i)), 550.0)
        scale = 1.0 / (d + 1000.0 * c)  # of an object so far before the first vertex, in air
        ours = [far.image_distance_mm, far.focal_length_mm, far.film_per_height, far.film_per_slope,
                near.image_distance_mm, scale]  # fmt: skip
        assert ours == pytest.approx(row, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "number", "coating"), [*one_in(2, cases("dgauss50", 3)), slow("wide22", 1, "mgf2"), ("cooke50", 2, "bare")]
)
def test_sums_over_pairs_are_those_of_the_truth(name: str, number: int, coating: str) -> None:
    found, case = ghosts_of(name, number, coating), TRUTH[name]["cases"][number]
    true = case[coating]
    assert found.account.entered == pytest.approx(case["entered"], rel=1e-3)
    assert found.image.flux == pytest.approx(true["direct_flux_plane"], rel=3e-3)
    assert total(found) == pytest.approx(true["sum_rect"], rel=0.01 + 2 * true["sum_rect_grid_change"])
    plane = sum(ghost.flux for ghost in found.ghosts) / found.reference
    assert plane == pytest.approx(true["sum_plane"], rel=0.015)  # the light far beside the film gets fewer rays


def test_brightest_ghosts_lie_where_the_truth_has_them() -> None:
    found, height = ghosts_of("dgauss50", 3, "bare"), DGAUSS["film_mm"][1]
    by_way = {ghost.way: ghost for ghost in found.ghosts}
    for row, share, y, rms, change in DGAUSS["cases"][3]["bare"]["brightest"]:
        i, j = DGAUSS["pairs"][row]
        ghost = by_way[j, i]
        assert ghost.flux_in_frame / found.reference == pytest.approx(share, rel=0.03)
        assert ghost.centroid_mm == pytest.approx((0.0, y), abs=0.005 * height + change)
        assert ghost.rms_mm == pytest.approx(rms, abs=0.005 * height + change)


@pytest.mark.slow
def test_the_double_gauss_has_its_known_ghosts() -> None:
    bare, coated = ghosts_of("dgauss50", 0, "bare"), ghosts_of("dgauss50", 1, "mgf2")
    assert total(bare) == pytest.approx(3.596e-2, rel=0.01)
    assert sum(ghost.flux_in_frame / bare.reference > 1e-5 for ghost in bare.ghosts) == 28
    assert total(coated) == pytest.approx(2.63e-4, rel=0.01)
    f8 = next(n for n, case in enumerate(DGAUSS["cases"]) if case["stop_semi_diameter"] < 3)
    assert total(ghosts_of("dgauss50", f8, "bare")) == pytest.approx(0.081, rel=0.01)


@pytest.mark.slow
def test_a_layer_for_green_leaves_more_of_the_other_colours() -> None:
    assert total(ghosts_of("dgauss50", 0, "mgf2")) == pytest.approx(1.21e-3, rel=0.01)  # 450 nm
    assert total(ghosts_of("dgauss50", 2, "mgf2")) == pytest.approx(9.4e-4, rel=0.01)  # 650 nm


CLEAR, DARK = QuarterWave(1.38, 550.0), LayerStack((Layer(1.46, 70.0), Layer(0.9, 3.0, 2.6)))


@pytest.mark.parametrize(
    ("name", "order", "coating"),
    [("achromat-100mm", 4, CLEAR), slow("planar-1897", 2, DARK), slow("planar-1897", 2, CLEAR)],
)
def test_no_light_is_lost_or_made(name: str, order: int, coating: QuarterWave | LayerStack) -> None:
    lens = with_coating(load_lens(name), coating)  # whose glass absorbs
    lit = Lit(lens, lens.first_order().back_focal_distance_mm, Beam(14.0), 440.0, film_reflectance=0.1)
    account = find_ghosts(lit, order).account
    parts = (account.image, account.ghosts, account.absorbed, account.blocked, account.missed, account.out)
    assert min(parts) > 0
    assert sum(parts) + account.reflected_on == pytest.approx(account.entered, rel=1e-9)
    assert account.reflected_on < 1e-3 * account.entered


def test_four_reflections_add_their_ways_to_those_of_two() -> None:
    lens = load_lens("achromat-100mm")
    lit = Lit(lens, lens.first_order().back_focal_distance_mm, Beam(1.0))
    two, four = find_ghosts(lit, 2), find_ghosts(lit, 4)
    twice = {ghost.way: ghost.flux for ghost in two.ghosts}
    for ghost in four.ghosts:
        if len(ghost.way) == 2:
            assert ghost.flux == pytest.approx(twice[ghost.way], rel=0.02)
    assert any(len(ghost.way) == 4 for ghost in four.ghosts)
    # What is totally reflected between front and back goes on for ever, so that this falls slowly
    assert four.account.reflected_on < 0.8 * two.account.reflected_on
    assert four.account.ghosts > two.account.ghosts


def test_two_plates_have_the_ghosts_of_the_geometric_series() -> None:
    rows = [{"thickness": 2, "diameter": 30, "glass": {"index": 1.5}}, {"thickness": 1, "diameter": 30},
            {"thickness": 1, "diameter": 20, "stop": True}, {"radius": 1e6, "diameter": 40}]  # fmt: skip
    found = find_ghosts(Lit(load_lens({"name": "plate", "surfaces": rows}), 50.0, film_reflectance=0.3))
    r, by_way = 0.04, {ghost.way: ghost.flux / found.image.flux for ghost in found.ghosts}
    assert by_way[1, 0] == pytest.approx(r * r, rel=1e-3)
    assert by_way[4, 1] == pytest.approx(0.3 * r, rel=1e-3)  # of the film, which is surface 4, back to the plate
    assert by_way[4, 0] == pytest.approx(0.3 * r * (1 - r) ** 2, rel=1e-3)
    assert by_way.keys() == {(1, 0), (4, 1), (4, 0)}


def test_amplitudes_have_the_transmittance_and_keep_the_light() -> None:
    cosine = np.cos(np.radians([0.0, 20.0, 50.0, 75.0]))
    behind = np.sqrt(1.0 - (1.0 - cosine**2) / 1.7**2)
    three = LayerStack((Layer(1.38, 100.0), Layer(2.1, 131.0), Layer(1.7, 81.0)))
    for coating in (BARE, MAGNESIUM_FLUORIDE, QuarterWave(1.9, 480.0), constant_reflectance(0.01), three):
        for interface in (Interface(1.0, 1.7, cosine, behind), Interface(1.7, 1.0, behind, cosine)):
            wave = coating.polarised(interface, 610.0)
            shares = [np.abs(part) ** 2 for part in wave]
            assert shares[0] + shares[2] == pytest.approx(np.ones(4), abs=1e-12)
            assert shares[1] + shares[3] == pytest.approx(np.ones(4), abs=1e-12)
            passed = coating.transmittance(interface, 610.0)
            assert (shares[2] + shares[3]) / 2 == pytest.approx(passed, abs=1e-12)


def test_a_frustrated_layer_reflects_less_than_all() -> None:
    angle = np.radians(50.0)  # beyond the critical angle of 1.7 to 1.0, and of 1.7 to the layer
    behind = np.sqrt(1.0 - (1.7 * np.sin(angle)) ** 2 + 0j)
    wave = QuarterWave(1.2, 550.0).polarised(Interface(1.7, 1.0, np.cos(angle), behind), 550.0)
    assert np.abs(wave.reflected_s) == pytest.approx(1.0, abs=1e-12)  # nothing can leave behind the layer


def test_a_stop_of_a_hundredth_of_the_front_has_its_image_and_ghosts() -> None:
    lens = load_lens("tessar-100mm")
    first = lens.first_order()
    small = lens.with_stop_diameter(lens.stop_diameter_for(180.0))
    found = find_ghosts(Lit(small, first.back_focal_distance_mm, wavelength_nm=LINE_D_NM))
    closed = np.pi / 4 * (first.focal_length_mm / 180.0) ** 2 * axial_transmittance(small, LINE_D_NM, UNCOATED)
    assert found.image.flux == pytest.approx(closed, rel=5e-3)
    assert total(found) > 1e-3


def test_ghosts_say_what_they_do_not_know() -> None:
    lens = load_lens("dgauss-50mm")
    with pytest.raises(InputError, match="even number"):
        find_ghosts(Lit(lens, 36.0), 3)
    with pytest.raises(InputError, match="does not come from the scene"):
        find_ghosts(Lit(lens, 36.0, Beam(95.0)))
    with pytest.raises(InputError, match="reflects a share"):
        find_ghosts(Lit(lens, 36.0, film_reflectance=1.5))
    endless = replace(lens, surfaces=(replace(lens.surfaces[0], semi_diameter=np.inf), *lens.surfaces[1:]))
    with pytest.raises(InputError, match="needs a diameter"):
        find_ghosts(Lit(endless, 36.0))


@pytest.mark.slow
def test_pairs_whose_light_enters_by_a_small_part_of_a_wide_front_are_found() -> None:
    lens = load_lens("fisheye-10mm")
    lit = Lit(lens, lens.first_order().back_focal_distance_mm, Beam(20.0), 550.0, (36.0, 24.0))
    found = {ghost.way: ghost.flux for ghost in find_ghosts(lit).ghosts}
    entry = Entry(lens, lit.source)
    front = entry.rays(*entry.everywhere(1 << 18))
    for way in ((3, 1), (7, 1), (7, 3)):  # a quarter of all light
        turns = np.tile([*way, NOWHERE], (len(front.cosines), 1))
        whole = together(lit, replace(front, beam=replace(front.beam, rows=np.arange(len(turns)))), turns)
        assert found[way] == pytest.approx(whole.light.sum(), rel=0.03)  # of 100 to 1900 rays


def plates(count: int, index: float = 1.5):
    """Windows far before a small stop, through which the film sees the whole sky: rays are nearly upright."""
    rows = []
    for _ in range(count):
        rows += [{"thickness": 1, "diameter": 300, "glass": {"index": index}}, {"thickness": 1, "diameter": 300}]
    rows += [{"thickness": 1, "diameter": 2, "stop": True}, {"radius": 1e7, "diameter": 2}]
    return load_lens({"name": "window", "surfaces": rows})


@pytest.mark.parametrize("count", [1, 2])
def test_windows_have_the_glare_of_all_pairs_of_their_surfaces(count: int) -> None:
    r = 0.04
    found = veiling_glare(plates(count), 20.0)
    pairs = sum((1 - r) ** (2 * (j - i - 1)) for j in range(2 * count) for i in range(j))
    assert found.surfaces == pytest.approx(r * r * pairs, rel=0.01)
    assert found.index == pytest.approx(found.surfaces / (1 + found.surfaces), rel=1e-12)


def test_light_that_a_film_scatters_comes_back_from_a_window() -> None:
    found = veiling_glare(plates(1), 20.0, film_reflectance=0.5, barrel_reflectance=0.1)
    r, there, back = 0.04, 24.0, 24.0 + 2 / 1.5  # to the rear surface again, of rays at small angles
    returned = r / (1 + there**2) + r * (1 - r) ** 2 / (1 + back**2)
    assert found.film == pytest.approx(0.5 * returned, rel=0.01)
    assert found.barrel >= 0


@pytest.mark.slow
def test_layers_take_most_of_the_glare_away() -> None:
    lens = load_lens("dgauss-50mm")
    bare = veiling_glare(lens, 36.1)
    coated = veiling_glare(with_coating(lens, MAGNESIUM_FLUORIDE), 36.1)
    assert 0.02 < bare.surfaces < 0.12
    assert coated.surfaces < 0.15 * bare.surfaces
    lit = veiling_glare(lens, 36.1, film_reflectance=0.1, barrel_reflectance=0.02)
    assert lit.surfaces == bare.surfaces and lit.film > 0 and lit.barrel > 0


def test_glare_says_what_it_does_not_know() -> None:
    with pytest.raises(InputError, match="without mirrors"):
        veiling_glare(load_lens("mirror-500mm"), 50.0)
    with pytest.raises(InputError, match="the film reflects a share"):
        veiling_glare(load_lens("dgauss-50mm"), 36.1, film_reflectance=1.0)


def test_the_front_scatters_the_integral_of_its_bsdf() -> None:
    lens, distance, abg = load_lens("dgauss-50mm"), 36.1, (3e-4, 1e-6, 2.0)
    assert scatter_share(abg) == pytest.approx(np.pi * abg[0] * np.log(1 + 1 / abg[1]), rel=1e-6)
    step, film = 36 / 96, np.zeros((64, 96, 1))
    film[20, 70] = 1000.0
    glow = scattered(film, abg, sines_of_film(lens, distance, 21.7), (-18, step, -12, step), ((0, 22), (1, 1)))[..., 0]

    def sines(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        x, y = (each.ravel() for each in np.broadcast_arrays(x, y))
        points = np.column_stack([x, y, np.full(x.size, lens.film_z(distance))])
        return film_chief_rays(lens, points).directions[:, :2]

    across = sines(-18 + step * (np.arange(96) + 0.5), -12 + step * (np.arange(64)[:, None] + 0.5))
    x, y = -18 + step * (70 + (np.arange(6) + 0.5) / 6), -12 + step * (20 + (np.arange(6)[:, None] + 0.5) / 6)
    right, left, below, above = sines(
        np.array([71, 70, 70.5, 70.5]) * step - 18, np.array([20.5, 20.5, 21, 20]) * step - 12
    )
    (a, b), (c, d) = right - left, below - above
    away = np.linalg.norm(across[:, None] - sines(x, y), axis=2)
    exact = (1000.0 * abs(a * d - b * c) * (abg[0] / (abg[1] + away ** abg[2])).mean(axis=1)).reshape(64, 96)
    assert glow.sum() == pytest.approx(exact.sum(), rel=5e-3)
    far = np.hypot(*np.meshgrid(np.arange(96) - 70, np.arange(64) - 20)) > 6
    np.testing.assert_allclose(glow[far], exact[far], rtol=0.05)
    assert np.sqrt(np.mean((glow[far] / exact[far] - 1) ** 2)) < 0.01


@pytest.mark.parametrize("name", ["wide-22mm", "mirror-500mm"])
def test_many_ways_at_once_have_the_paraxial_heights_of_each(name: str) -> None:
    lens = load_lens(name)
    for turns in (np.array(pairs_of(lens)), ways_of_four(lens)[::37]):
        *_, (surface, ways, _, heights) = paraxial_steps(lens, turns, 40.0)
        assert surface == len(lens.surfaces) and ways.tolist() == [*range(len(turns))]
        images = [ghost_image(lens, tuple(way), 40.0, 550.0) for way in turns.tolist()]
        known = np.array([(image.film_per_height, image.film_per_slope) for image in images])
        np.testing.assert_allclose(heights.T, known, rtol=1e-9, atol=1e-11 * np.abs(known).max())


def test_light_by_paraxial_rays_is_what_rims_and_surfaces_leave_of_a_beam() -> None:
    lens = load_lens({"name": "Slab", "surfaces": [
        {"thickness": 3, "glass": {"index": 1.5}, "diameter": 8}, {"diameter": 8, "stop": True}
    ]})  # fmt: skip
    passed, slope = np.array([[0.9], [0.8]]), 0.1
    (straight, slanted) = light_by_paraxial_rays(
        lens, np.array([[1, 0, 1, 0]]), (10.0, 4.0), passed, np.inf, np.array([0.0, slope])
    )[:, 0]
    share = 0.9 * 0.2 * 0.1 * 0.2 * 0.1 * 0.8
    assert straight == pytest.approx(share * 8**2)
    assert slanted == pytest.approx(share * (8 - slope * (5 * 3 / 1.5 + 10)) ** 2)
