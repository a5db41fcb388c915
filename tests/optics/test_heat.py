"""Lenses under heat: indices by the makers' constants, closed forms of single lenses, and what no file says."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.as_built import BARRELS, Heat, thermal_of
from rptcam_cl.optics.files.export import lens_text
from rptcam_cl.optics.files.glasses import MAKERS, find_glass, glasses_of, law_of
from rptcam_cl.optics.glass import AIR, Heated, Medium, Melt, air_index
from rptcam_cl.optics.lens import Lens, in_configuration
from rptcam_cl.optics.library import load_lens

E_NM, G_NM, IR_NM = 546.074, 435.835, 1060.0
D_NM = 587.5618


def index(glass: Medium, celsius: float, wavelength_nm: Any, pressure_hpa: float = 1013.25) -> Any:
    thermal = thermal_of(glass)
    assert thermal is not None
    return Heated.of(glass, thermal, celsius, pressure_hpa).index(wavelength_nm)


# Data sheet of SCHOTT N-BK7: dn/dT relative and absolute [1e-6/K] at 1060 nm, e and g, between two temperatures.
N_BK7 = {
    (-40, -20): (2.4, 2.9, 3.3, 0.3, 0.8, 1.2),
    (20, 40): (2.4, 3.0, 3.5, 1.1, 1.6, 2.1),
    (60, 80): (2.5, 3.1, 3.7, 1.5, 2.1, 2.7),
}


@pytest.mark.parametrize("span", N_BK7)
def test_index_changes_as_the_data_sheet_says(span: tuple[int, int]) -> None:
    glass = find_glass("N-BK7")
    assert glass is not None
    waves = np.array([IR_NM, E_NM, G_NM])
    cold, hot = (index(glass, celsius, waves) for celsius in span)
    relative = (hot - cold) / (span[1] - span[0])
    airs = [air_index(waves, celsius, 1013.25) for celsius in span]
    absolute = (hot * airs[1] - cold * airs[0]) / (span[1] - span[0])
    np.testing.assert_allclose(1e6 * np.concatenate([relative, absolute]), N_BK7[span], atol=0.06)  # its last digit


def test_air_has_its_index() -> None:
    # Edlen, Metrologia 2, 71 (1966): dry air at 20 degrees and 1013.25 hPa, 632.8 nm
    assert air_index(632.8, 20.0, 1013.25) - 1 == pytest.approx(2.7138e-4, abs=5e-7)
    assert air_index(632.8, 20.0, 0.0) == 1
    assert air_index(632.8, 20.0, 506.625) - 1 == pytest.approx((air_index(632.8, 20.0, 1013.25) - 1) / 2)


def test_in_vacuum_the_index_is_absolute() -> None:
    glass = find_glass("N-BK7")
    assert glass is not None
    expected = glass.index(D_NM) * air_index(D_NM, 20.0, 1013.25)
    assert index(glass, 20.0, D_NM, 0.0) == pytest.approx(float(expected), abs=1e-12)


def test_constants_count_from_the_temperature_of_the_catalogue() -> None:
    glass = find_glass("S-BSL7")
    assert glass is not None
    thermal = thermal_of(glass)
    assert thermal is not None
    assert thermal.reference_c == 25
    assert index(glass, 25.0, D_NM) == pytest.approx(float(glass.index(D_NM)), abs=1e-12)


def test_makers_say_how_most_glasses_take_heat() -> None:
    laws = [law_of(glass, glass.name) for maker in MAKERS for glass in glasses_of(maker).values()]
    known = [thermal for law in laws if (thermal := law.thermal) is not None]
    whole = [thermal for thermal in known if thermal.dispersion is not None and thermal.expansion_per_k is not None]
    assert len(whole) == 1317
    assert all(3e-7 < thermal.expansion_per_k < 3e-5 for thermal in whole)  # type: ignore[operator]


def plano_convex(glass: Any = "N-BK7") -> Any:
    return load_lens({"surfaces": [{"radius": 50, "thickness": 6, "glass": glass, "diameter": 20}, {"diameter": 20}]})


@pytest.mark.parametrize("celsius", [-40.0, 60.0])
@pytest.mark.parametrize("glass", ["N-BK7", "SF6", "S-FPL53"])
def test_focal_length_of_a_single_lens_is_its_closed_form(celsius: float, glass: str) -> None:
    cold = plano_convex(glass)
    law, thermal = cold.surfaces[0].glass, thermal_of(cold.surfaces[0].glass)
    hot = Heat(celsius).lens(cold)
    n = float(index(law, celsius, D_NM))
    growth = 1 + thermal.expansion_per_k * (celsius - 20)  # type: ignore[union-attr, operator]
    assert hot.first_order().focal_length_mm == pytest.approx(50 * growth / (n - 1), rel=1e-12)  # R / (n - 1)
    assert hot.surfaces[0].thickness == pytest.approx(6 * growth, rel=1e-14)
    assert hot.surfaces[0].semi_diameter == pytest.approx(10 * growth, rel=1e-14)
    # df/f = alpha dT - dn / (n - 1), to first order
    before = cold.first_order().focal_length_mm
    change = growth - 1 - (n - float(law.index(D_NM))) / (n - 1)
    assert hot.first_order().focal_length_mm / before - 1 == pytest.approx(change, rel=0.01)


def test_air_spaces_grow_as_the_barrel() -> None:
    triplet = load_lens("cooke-triplet-50mm")
    heat = Heat(70.0, barrel_per_k=BARRELS["titanium"])
    hot = heat.lens(triplet)
    assert hot.surfaces[1].thickness == pytest.approx(triplet.surfaces[1].thickness * (1 + 50 * 8.6e-6))
    assert hot.surfaces[1].glass == AIR
    assert heat.film(40.0) == pytest.approx(40 * (1 + 50 * 8.6e-6))


def test_shape_of_an_asphere_grows_alike() -> None:
    rows = [
        {
            "radius": 20,
            "thickness": 4,
            "glass": "N-BK7",
            "diameter": 10,
            "conic": -0.5,
            "aspheric": {4: 1e-5, 6: -2e-7},
        },
        {"diameter": 10},
    ]
    cold = load_lens({"surfaces": rows})
    hot = Heat(120.0).lens(cold)
    growth = 1 + 100 * 7.1e-6
    height, zero = np.array([4.0]), np.zeros(1)
    assert hot.surfaces[0].sag(zero, growth * height) == pytest.approx(growth * cold.surfaces[0].sag(zero, height))


def test_lens_that_grows_alike_everywhere_is_the_lens_in_a_larger_unit() -> None:
    grow = 25e-6
    glass = {"index": 1.5, "expansion_per_k": grow, "thermal": {"d": [0, 0, 0], "e": [0, 0], "resonance_um": 0.2}}
    lens = {
        "surfaces": [
            {"radius": 40, "thickness": 4, "glass": glass, "diameter": 20, "decentre": [0.5, -1, 0.2]},
            {"radius": -60, "thickness": 5, "diameter": 20, "clear": {"rectangle": [12, 8]}},
            {"stop": True, "thickness": 6, "diameter": 9},
            {"radius": 90, "thickness": 3, "glass": glass, "diameter": 18, "tilt_degrees": [2, 0]},
            {"diameter": 18, "clear": {"half_plane_degrees": 90, "edge": -7}},
        ],
        "groups": [{"surfaces": [3, 4], "decentre": [0, 0.3], "tilt_degrees": [1, -1]}],
        "configurations": [
            {"name": "wide", "gaps": {1: 5, 2: 6}, "stop_diameter": 8},
            {"name": "tele", "gaps": {1: 7, 2: 3}, "stop_diameter": 6},
        ],
        "focusing": {"surfaces": [3, 4], "travel": [-1, 2]},
    }
    kelvin = 40.0
    scale = 1 + grow * kelvin
    hot = Heat(20 + kelvin, barrel_per_k=grow).lens(load_lens(lens))
    glass["index"] = float(hot.surfaces[0].glass.index(D_NM))
    larger = load_lens(lens | {"unit": "cm"})  # whose lengths are ten times as long
    assert hot.focusing is not None
    assert hot.focusing.travel_mm == pytest.approx((-scale, 2 * scale))
    tele, reference = in_configuration(hot, "tele"), in_configuration(larger, "tele")
    assert tele.stop is not None
    assert 2 * tele.stop.semi_diameter == pytest.approx(6 * scale)
    points = np.random.default_rng(3).uniform(-6, 6, (200, 2))
    origins = np.column_stack([points, np.full(200, -10.0)])
    directions = np.broadcast_to([0.0, 0.1, 1.0], origins.shape)
    one = tele.trace(scale * origins, directions, D_NM, "scene")
    other = reference.trace(10 * origins, directions, D_NM, "scene")
    assert np.array_equal(one.status, other.status)
    assert len(set(one.surface[~one.passed].tolist())) > 1
    passed = one.passed
    assert 20 < passed.sum() < 180
    np.testing.assert_allclose(one.origins[passed] / scale, other.origins[passed] / 10, atol=1e-9)


def test_lens_at_20_degrees_stays_as_it_is() -> None:
    lens = load_lens("cooke-triplet-50mm")
    assert Heat(20.0).lens(lens) is lens
    assert load_lens("dgauss-50mm") == Heat().lens(load_lens("dgauss-50mm"))  # whatever its glass


def test_melt_takes_heat_as_its_glass() -> None:
    lens = plano_convex()
    glass = lens.surfaces[0].glass
    melt = Melt.of(glass, 0.001, 0.0)
    assert thermal_of(melt) == thermal_of(glass)
    hot = Heated.of(melt, thermal_of(melt), 60.0, 1013.25)  # type: ignore[arg-type]
    assert hot.index(D_NM) - index(glass, 60.0, D_NM) == pytest.approx(0.001, rel=1e-3)


@pytest.mark.parametrize(
    ("glass", "message"),
    [
        ({"nd": 1.6, "vd": 50}, r"surfaces\[0\]: nothing says how glass 1.6 / 50 takes heat: how its index changes"),
        ("CaF2", "nothing says how glass CaF2 takes heat"),
        ({"nd": 1.6, "vd": 50, "thermal": {"d": [0, 0, 0], "e": [0, 0], "resonance_um": 0.2}}, "how it expands"),
    ],
)
def test_glass_of_which_nothing_is_known_is_refused(glass: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Heat(60.0).lens(plano_convex(glass))


def test_what_lies_before_the_lens_takes_heat_as_well() -> None:
    rows = [{"radius": 50, "thickness": 5, "glass": "N-BK7", "diameter": 20}, {"diameter": 20}]
    before = {name: load_lens({"name": "port", "object_medium": name, "surfaces": rows}) for name in ("N-BK7", "water")}
    first, second, _ = Heat(60.0).lens(before["N-BK7"]).indices(D_NM)
    assert first == second != before["N-BK7"].indices(D_NM)[0]
    with pytest.raises(InputError, match="port: object_medium: nothing says how glass water takes heat"):
        Heat(60.0).lens(before["water"])


def mangin(glass: Any, scale: float = 1.0) -> Lens:
    """A lens whose back is a mirror, through which light leaves by its front."""
    rows = [
        {"radius": -80 * scale, "thickness": 6 * scale, "glass": glass, "diameter": 30},
        {"radius": -110 * scale, "thickness": -6 * scale, "mirror": True, "diameter": 30},
        {"radius": -80 * scale, "diameter": 30},
    ]
    return load_lens({"name": "mangin", "surfaces": rows})


def test_mirror_behind_glass_grows_with_it_and_one_before_its_body_is_refused() -> None:
    hot = Heat(60.0).lens(mangin("N-BK7"))
    alike = mangin({"index": float(index(mangin("N-BK7").surfaces[0].glass, 60.0, D_NM))}, 1 + 40 * 7.1e-6)
    assert hot.first_order().focal_length_mm == pytest.approx(alike.first_order().focal_length_mm, rel=1e-12)
    assert hot.surfaces[1].curvature == pytest.approx(-1 / (110 * (1 + 40 * 7.1e-6)), rel=1e-12)
    with pytest.raises(InputError, match="write body_expansion_per_k"):
        Heat(60.0).lens(load_lens({"name": "a", "surfaces": [{"radius": -100, "mirror": True, "diameter": 20}]}))
    with pytest.raises(InputError, match="nothing says how glass"):
        Heat(60.0).lens(load_lens("mirror-500mm"))


def test_mirrors_in_air_grow_as_their_bodies_and_gaps_as_the_barrel(tmp_path: Path) -> None:
    rows = [
        {"radius": -400, "thickness": -140, "mirror": True, "conic": -1, "diameter": 100, "body_expansion_per_k": 8e-6},
        {"radius": -160, "mirror": True, "conic": -2.7777777777777777, "diameter": 34, "body_expansion_per_k": -2e-8},
    ]
    cold = load_lens({"name": "cassegrain", "surfaces": rows})
    hot = Heat(70.0, barrel_per_k=23.6e-6).lens(cold)
    large, small, gap = 200 * (1 + 50 * 8e-6), 80 * (1 - 50 * 2e-8), 140 * (1 + 50 * 23.6e-6)
    left = large - gap  # from the small mirror to the focus of the large one; then 1 / s = 1 / left - 1 / small
    film = 1 / (1 / left - 1 / small)
    assert hot.first_order().focal_length_mm == pytest.approx(large * film / left, rel=1e-12)
    assert hot.first_order().back_focal_distance_mm == pytest.approx(film, rel=1e-12)  # 5 mm from that of the cold one
    assert hot.surfaces[0].semi_diameter == pytest.approx(50 * (1 + 50 * 8e-6), rel=1e-14)
    (tmp_path / "lens.yaml").write_text(lens_text(cold))
    assert load_lens(tmp_path / "lens.yaml").surfaces == cold.surfaces
    with pytest.raises(InputError, match="only a mirror in air has a body"):
        load_lens({"surfaces": [{"radius": 50, "diameter": 20, "body_expansion_per_k": 1e-6}]})


THERMAL = {"d": [1.86e-6, 1.31e-8, -1.37e-11], "e": [4.34e-7, 6.27e-10], "resonance_um": 0.17}


def test_lens_file_says_how_a_glass_takes_heat() -> None:
    own = {"sellmeier": {"b": [1.03961212, 0.231792344, 1.01046945], "c": [0.00600069867, 0.0200179144, 103.560653]}}
    lens = plano_convex(own | {"thermal": THERMAL, "expansion_per_k": 7.1e-6})
    expected = Heat(60.0).lens(plano_convex("N-BK7")).first_order().focal_length_mm
    assert Heat(60.0).lens(lens).first_order().focal_length_mm == pytest.approx(expected, rel=1e-9)


def test_lens_written_as_a_file_keeps_what_is_known_of_heat(tmp_path: Path) -> None:
    lens = plano_convex({"nd": 1.6, "vd": 50, "thermal": THERMAL | {"reference_c": 25}, "expansion_per_k": 7e-6})
    (tmp_path / "lens.yaml").write_text(lens_text(lens))
    assert load_lens(tmp_path / "lens.yaml").surfaces == lens.surfaces


def test_catalogue_of_another_program_says_how_a_glass_takes_heat(tmp_path: Path) -> None:
    (tmp_path / "own.agf").write_text(
        "NM GLASS 2 0 1.5168 64.17\nED 7.1 8.3 2.51 0 0\n"
        "CD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653\n"
        "TD 1.86E-6 1.31E-8 -1.37E-11 4.34E-7 6.27E-10 0.17 20\nLD 0.3 2.5\n"
    )
    (tmp_path / "lens.yaml").write_text(
        "surfaces:\n  - {radius: 50, thickness: 6, glass: {catalogue: own.agf, name: GLASS}, diameter: 20}\n"
        "  - {diameter: 20}\n"
    )
    thermal = thermal_of(load_lens(tmp_path / "lens.yaml").surfaces[0].glass)
    known = thermal_of(plano_convex().surfaces[0].glass)
    assert thermal is not None
    assert known is not None
    assert thermal.dispersion == known.dispersion
    assert thermal.expansion_per_k == pytest.approx(known.expansion_per_k, rel=1e-12)
    assert thermal.reference_c == 20


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"thermal": THERMAL | {"d": [1, 2]}}, r"surfaces\[0\].glass.thermal.d: expected 3 numbers"),
        ({"thermal": {"d": [0, 0, 0]}}, r"surfaces\[0\].glass.thermal"),
        ({"thermal": THERMAL | {"dn": 1}}, r"surfaces\[0\].glass.thermal.dn: unknown key"),
        ({"expansion_per_k": "7e-6 /K"}, r"surfaces\[0\].glass.expansion_per_k: expected a number"),
    ],
)
def test_wrong_constants_are_refused_with_their_place(more: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        plano_convex({"nd": 1.6, "vd": 50} | more)
