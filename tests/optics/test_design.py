"""Single lenses and achromats from a few numbers, against the closed forms of the paper, corrected."""

import math

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.design import GlassChoice, doublet, doublet_radii, image_distances, singlet
from rptcam_cl.optics.lens import film_distance
from rptcam_cl.optics.library import load_lens
from tests.optics.truth import truth

ACHROMAT = truth("achromat_open")


@pytest.mark.parametrize(
    "row", ACHROMAT["solutions"], ids=lambda row: f"{row['name'][:8]} {row['f']} {row['constraint']}"
)
def test_radii_of_the_achromat(row):
    got = doublet_radii(
        row["f"], GlassChoice(row["n1"], row["v1"]), GlassChoice(row["n2"], row["v2"]), row["constraint"]
    )
    for value, key in zip(got, ("R1", "R2", "R3"), strict=True):
        expected = row["signed_R"][key]
        assert value == (math.inf if expected is None else pytest.approx(float(expected), rel=1e-12))
    again = doublet_radii(row["f"], GlassChoice(row["n1"], row["v1"]), GlassChoice(row["n2"], row["v2"]), "r1", got[0])
    assert [1 / value for value in again] == pytest.approx([1 / value for value in got], abs=1e-15)


def test_the_default_doublet_of_the_paper():
    radii = doublet_radii(2.5, GlassChoice(1.3, 3.0), GlassChoice(1.8, 1.0), "r1", 4.0)
    assert radii == pytest.approx((4.0, -0.5714286, -0.6666667), abs=1e-7)


def test_a_thin_doublet_has_one_power_at_every_wavelength_of_the_linear_law():
    def entry(n, v):
        return GlassChoice(n, v, {"linear_abbe": {"n": n, "v": v}})

    lens = doublet(100.0, entry(1.3, 3.0), entry(1.8, 1.0), 0.2, "r1", 160.0)
    for row in lens["surfaces"]:
        row["diameter"] = 0.002
        if "thickness" in row:
            row["thickness"] = 0.0
    thin = load_lens(lens)
    for wavelength in (400.0, 486.1, 589.3, 656.3, 700.0):
        assert thin.first_order(wavelength).focal_length_mm == pytest.approx(100.0, rel=1e-12)


@pytest.mark.parametrize("row", ACHROMAT["real_glass"], ids=lambda row: f"{row['glass1']} {row['glass2']} {row['f']}")
def test_achromats_of_real_glass(row):
    first, second = (
        GlassChoice(row["nd1"], row["Vd1"], row["glass1"]),
        GlassChoice(row["nd2"], row["Vd2"], row["glass2"]),
    )
    radii = doublet_radii(row["f"], first, second, row["constraint"])
    assert [1 / radius for radius in radii] == pytest.approx(
        [0 if radius is None else 1 / radius for radius in row["signed_R"]], abs=1e-12
    )
    surfaces = [
        {"radius": radii[0], "thickness": row["thicknesses"][0], "glass": row["glass1"], "diameter": 1},
        {"radius": radii[1], "thickness": row["thicknesses"][1], "glass": row["glass2"], "diameter": 1},
        {"radius": radii[2], "diameter": 1},
    ]
    lens = load_lens({"name": "x", "surfaces": surfaces})
    wavelengths = {"d": 587.5618, "F": 486.1327, "C": 656.2725, "e": 546.0740, "g": 435.8343}
    for label, expected in row["thick_paraxial"].items():
        data = lens.first_order(wavelengths[label])
        assert data.focal_length_mm == pytest.approx(expected["EFL"], rel=1e-8)
        assert data.back_focal_distance_mm == pytest.approx(expected["BFL"], rel=1e-8)


@pytest.mark.parametrize("row", ACHROMAT["single_lens"], ids=lambda row: f"n {row['n']}")
def test_single_lens_placed_for_an_object(row):
    surfaces = [
        {"radius": row["R1"], "thickness": row["t"], "glass": {"index": row["n"]}, "diameter": 0.1},
        {"radius": row["R2"], "diameter": 0.1},
    ]
    lens = load_lens({"name": "x", "surfaces": surfaces})
    length = lens.first_order().focal_length_mm
    assert length == pytest.approx(float(row["f_eq3"]), rel=1e-13)
    for case in row["cases"]:
        if case["d_i_eq5"] is None:
            with pytest.raises(InputError, match="the least distance is four focal lengths"):
                image_distances(length, case["d"])
            continue
        near, far = image_distances(length, case["d"])
        assert near == pytest.approx(float(case["d_i_eq5"]), rel=1e-12)
        assert far == pytest.approx(float(case["other_root"]), rel=1e-12)
        assert film_distance(lens, case["d"]) == pytest.approx(float(case["thick_exact"]["back_distance"]), rel=1e-9)


# Object to film distance against image distance: R = 4, n = 1.8, t = 0.01.
PLACED = {11: 3.846303, 15: 3.172281, 18: 3.002085, 20: 2.930898, 25: 2.819336, 30: 2.754253, 50: 2.640874}


def test_placements_of_the_paper():
    surfaces = [{"radius": 4, "thickness": 0.01, "glass": {"index": 1.8}, "diameter": 1}, {"radius": -4, "diameter": 1}]
    length = load_lens({"name": "x", "surfaces": surfaces}).first_order().focal_length_mm
    assert length == pytest.approx(2.5013897, abs=5e-8)
    for distance, expected in PLACED.items():
        assert image_distances(length, distance)[0] == pytest.approx(expected, abs=6e-7)


@pytest.mark.parametrize("bending", [-1.0, 0.0, 0.3, 1.0])
@pytest.mark.parametrize("length", [100.0, -80.0])
def test_designed_singlet_has_the_focal_length(length, bending):
    lens = load_lens(singlet(length, GlassChoice(1.5168, 64.17), 20.0, bending))
    assert lens.first_order().focal_length_mm == pytest.approx(length, rel=1e-10)
    assert lens.warnings == ()


def test_designed_doublet_is_corrected():
    crown, flint = GlassChoice(1.5168, 64.17, "N-BK7"), GlassChoice(1.62004, 36.37, "F2")
    lens = load_lens(doublet(100.0, crown, flint, 20.0))
    single = load_lens(singlet(100.0, crown, 20.0))
    colour = [x.first_order(486.1327).focal_length_mm - x.first_order(656.2725).focal_length_mm for x in (lens, single)]
    assert lens.first_order().focal_length_mm == pytest.approx(100.0, rel=0.02)
    assert abs(colour[0]) < 0.1 < 1.0 < abs(colour[1])


def test_impossible_wishes_are_refused():
    glass = GlassChoice(1.5, 60)
    with pytest.raises(InputError, match="two Abbe numbers that differ"):
        doublet_radii(100, glass, GlassChoice(1.6, 60))
    with pytest.raises(InputError, match="unknown constraint"):
        doublet_radii(100, glass, GlassChoice(1.6, 30), "r4")
    with pytest.raises(InputError, match="too short for a diameter"):
        singlet(10, glass, 40)
    with pytest.raises(InputError, match="focal length must be finite"):
        singlet(0, glass, 4)
    with pytest.raises(InputError, match="forms no real image"):
        image_distances(-10, 100)
