"""Wavefronts, Strehl ratios, transfer, spread and encircled energy against two independent programs' numbers.

The tables hold six lenses, three stops, four fields, three wavelengths, two film planes; a number is None where the
two programs differ by more than 2 %.
"""

import json
from functools import cache

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import aberrations, spots
from rptcam_cl.optics.beams import Beam
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.waves import (
    AIRY,
    ExitRays,
    PupilFunction,
    centroid,
    encircled_function,
    peak_to_valley,
    pupil_function,
    rms_waves,
    spread,
    strehl,
    transfer,
)
from tests.optics.truth import FOLDER, truth
from tests.support.cases import slow

WAVES = FOLDER.parent / "wave_truth"
NAMES = ["ac254_100_a", "cooke50", "dgauss50", "petzval_laikin", "planar_us583336", "wide22"]
# A case on the axis, one that is aberrated, one that is sharp and one of a near object; the others are slow.
CHOSEN = {"ac254_100_a": 0, "cooke50": 52, "dgauss50": 100, "wide22": 62}


@cache
def table(name: str) -> dict:
    return json.loads((WAVES / f"wave_{name}.json").read_text())


def lens_of(name: str, case: dict) -> Lens:
    rows = []
    for surface, index in zip(truth(name)["surfaces"], table(name)["indices"][f"{case['nm']:.0f}"], strict=True):
        row = {"diameter": 2 * surface["semi_diameter"], "thickness": surface["thickness"], "stop": surface["is_stop"]}
        row |= {"radius": surface["R"]} if surface["R"] else {}
        row |= {"glass": {"index": index}} if index != 1 else {}
        rows.append({key: value for key, value in row.items() if value})
    rows = [row if "thickness" in row or k == len(rows) - 1 else row | {"thickness": 0} for k, row in enumerate(rows)]
    return load_lens({"name": name, "surfaces": rows}).with_stop_diameter(2 * case["stop_sd"])


def pupil_of(name: str, case: dict) -> PupilFunction:
    lens = lens_of(name, case)
    beam = Beam(case["deg"], case["object"] or np.inf)
    sphere = table(name)["reference_sphere_z"]
    return pupil_function(lens, case["film_z"] - lens.length, beam, case["nm"], sphere_z=sphere)


def check(name: str, case: dict) -> None:
    """All numbers of a row, in the tolerances that its tables state."""
    pupil, dev = pupil_of(name, case), case["dev"]
    assert pupil.chief[1] == pytest.approx(case["chief_y"], abs=1e-6)
    assert centroid(pupil)[1] == pytest.approx(case["centroid_dy"], abs=0.02 * case["ray_rms"] + 1e-5)
    rms = (
        rms_waves(pupil, pupil.waves_on_sphere),
        rms_waves(pupil, pupil.waves),
        rms_waves(pupil, pupil.waves_on_sphere, without_tilt=True),
    )
    # Where the rim is steep the two programs themselves differ by up to 2 %.
    agree("rms", rms, case["rms"], [0.01 * abs(v or 0) + 0.002 + (d or 0) * abs(v or 0)
                                    for v, d in zip(case["rms"], dev["rms"], strict=True)])  # fmt: skip
    ranges = peak_to_valley(pupil, pupil.waves_on_sphere), peak_to_valley(pupil, pupil.waves)
    agree("pv", ranges, case["pv"], [0.04 * (v or 0) for v in case["pv"]])
    ratio = strehl(pupil)
    agree("strehl", (ratio.at_chief_ray, ratio.at_peak), case["strehl"],
          [0.02 * v if v is not None and v > 0.1 else 0.005 for v in case["strehl"]])  # fmt: skip
    tangential, sagittal = transfer(pupil, table(name)["frequencies_lp_per_mm"])
    agree("mtf_t", np.abs(tangential), case["mtf_t"], [0.004] * 4)
    agree("mtf_s", np.abs(sagittal), case["mtf_s"], [0.004] * 4)
    about = (0.0, case["centroid_dy"])
    half, most, share = case["ee"]
    if half is not None:  # 2 % of the radius
        low, high = encircled_function(pupil, about)(np.array([0.98 * half, 1.02 * half]))
        assert low < 0.5 < high
    if most is not None:
        low, high = encircled_function(pupil, about)(np.array([0.98 * most, 1.02 * most]))
        assert low < 0.8 < high
    if share is not None:
        agree("ee", encircled_function(pupil, about)(np.array([AIRY * case["nm"] * 1e-6 * case["N"]])), [share], [0.01])
    if case.get("psf"):
        places = (np.arange(9) - 4) * case["psf"]["step"]
        values = np.array(case["psf"]["values"])
        assert np.abs(spread(pupil, places, places).T * 1e-6 - values).max() <= 0.02 * values.max()
    if case.get("first_min"):
        assert first_minimum(pupil, case["first_min"]) == pytest.approx(case["first_min"], rel=0.01)


def first_minimum(pupil: PupilFunction, near_mm: float) -> float:
    """The first dark ring along x [mm]."""
    places = np.linspace(0.7, 1.3, 601) * near_mm
    light = spread(pupil, places, [0.0])[0]
    low = np.flatnonzero((light[1:-1] < light[:-2]) & (light[1:-1] <= light[2:]))[0] + 1
    return float(places[low])


def agree(what: str, found, expected: list, allowed: list) -> None:
    for one, other, most in zip(found, expected, allowed, strict=True):
        assert other is None or abs(one - other) <= most, (what, one, other)


@pytest.mark.parametrize(("name", "row"), CHOSEN.items())
def test_wavefronts_images_and_transfer(name: str, row: int) -> None:
    check(name, table(name)["cases"][row])


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_wavefronts_images_and_transfer_of_all(name: str) -> None:
    for case in table(name)["cases"]:
        check(name, case)


# A plane and a hyperboloid of n = 1.5 draw the point at infinity without aberration.
PERFECT = {
    "name": "Perfect lens",
    "surfaces": [
        {"thickness": 3, "glass": {"index": 1.5}, "diameter": 26, "stop": True},
        {"radius": -25, "conic": -2.25, "diameter": 26},
    ],
}


@pytest.mark.parametrize("f_number", [8, *(slow(n) for n in (11, 16, 22, 32))])
def test_a_lens_without_aberrations_has_the_airy_pattern(f_number: float) -> None:
    lens = load_lens(PERFECT)
    lens = lens.with_stop_diameter(50 / f_number)
    pupil = pupil_function(lens, lens.first_order().back_focal_distance_mm, wavelength_nm=550.0)
    ring = AIRY * 550e-6 * f_number
    assert strehl(pupil).at_chief_ray == pytest.approx(1.0, abs=1e-9)
    assert first_minimum(pupil, ring) == pytest.approx(ring, rel=0.01)
    assert encircled_function(pupil, (0.0, 0.0))(np.array([ring]))[0] == pytest.approx(0.838, abs=0.01)
    share = np.linspace(0.0, 0.95, 20)
    exact = 2 / np.pi * (np.arccos(share) - share * np.sqrt(1 - share**2))
    for curve in transfer(pupil, share / (550e-6 * f_number)):  # 0.4 % of the lens's own at f/8: it breaks the sines
        np.testing.assert_allclose(np.abs(curve), exact, atol=0.005)


def test_wavefront_of_a_lens_whose_exit_pupil_is_at_infinity() -> None:
    def waves(to_stop: float) -> np.ndarray:
        rows = [{"stop": True, "thickness": to_stop, "diameter": 10},
                {"radius": 50, "thickness": 5, "glass": {"index": 1.5}, "diameter": 24}, {"diameter": 24}]  # fmt: skip
        lens = load_lens({"name": "Telecentric", "surfaces": rows})
        assert np.isinf(lens.first_order().exit_pupil.distance_mm) == (to_stop == 100.0)
        return pupil_function(lens, lens.first_order().back_focal_distance_mm, Beam(2.0), across=64).waves_on_sphere

    np.testing.assert_allclose(waves(100.0), waves(100.0 + 1e-9), atol=1e-4)


@pytest.mark.parametrize("shape", [0, slow(1), 2])
def test_stop_shapes_have_their_closed_patterns(shape: int) -> None:
    from rptcam_cl.optics.surface import polygon

    expected = json.loads((WAVES / "stop_shapes.json").read_text())
    row, n = expected["shapes"][shape], 16.0
    lens = load_lens(PERFECT).with_stop_diameter(50 / n).with_stop_shape(polygon(row["vertices"]))
    pupil = pupil_function(lens, lens.first_order().back_focal_distance_mm, wavelength_nm=550.0)
    unit = 550e-6 * n
    radii = np.array(expected["encircled_energy_radii_lamN"]) * unit
    np.testing.assert_allclose(encircled_function(pupil, (0.0, 0.0))(radii), row["encircled_energy"], atol=0.01)
    places = (np.arange(9) - 4) * row["samples"]["step_lamN"] * unit
    light = spread(pupil, places, places)
    # The image of the stop is turned by half, which the pattern does not show.
    np.testing.assert_allclose(light.T / light.max(), row["samples"]["relative_to_peak"], atol=0.01)


def test_what_has_no_wavefront_is_refused() -> None:
    lens = load_lens("dgauss-50mm")
    film = lens.first_order().back_focal_distance_mm
    with pytest.raises(InputError, match="up to 85 degrees"):
        pupil_function(lens, film, Beam(88.0))
    with pytest.raises(InputError, match="at least 16"):
        pupil_function(lens, film, across=8)
    with pytest.raises(InputError, match="nothing of a beam"):
        pupil_function(lens, film, Beam(60.0))


@pytest.mark.parametrize(
    ("name", "degrees"), [slow("dgauss-50mm", 6.0), ("petzval-50mm", 0.0), slow("mirror-500mm", 1.0)]
)
def test_errors_of_wave_figures_hold_what_four_times_the_cells_change(name: str, degrees: float) -> None:
    use = spots.setting(load_lens(name))
    few, many = (spots.wavefront(use, [degrees], [587.5618], across).rows[0] for across in (80, 160))
    assert abs(few["strehl"] - many["strehl"]) <= 1.5 * few["strehl_error"] < 0.3 * many["strehl"]
    moved = abs(few["peak_to_valley_waves"] - many["peak_to_valley_waves"])
    assert moved <= 1.5 * few["range_error_waves"] + 1e-3
    curves = [
        spots.mtf(use, [20.0, 40.0], [degrees], [587.5618], diffraction=True, rays=across).rows for across in (80, 160)
    ]
    for less, more in zip(*curves, strict=True):
        moved = max(abs(less[name] - more[name]) for name in ("tangential", "sagittal"))
        assert moved <= 1.5 * less["error"] < 0.2


def test_ray_fans_end_where_the_beam_does() -> None:
    """The end of the fan is the highest of 2001 rays along it that passes, within their steps."""
    use = spots.setting(load_lens("achromat-100mm"))
    lens, first = use.lens, use.lens.surfaces[0]
    rows = aberrations.ray_fan(use, [0.0], [587.5618], 3).rows
    edge = next(row["off_um"] for row in rows if row["pupil"] == 1.0 and row["tangential"])
    heights = np.linspace(0.9, 1.0, 2001) * first.semi_diameter
    rays = lens.trace(
        np.stack([0 * heights, heights, 0 * heights], axis=1), np.tile([0.0, 0.0, 1.0], (2001, 1)), 587.5618, "scene"
    )
    last = int(np.flatnonzero(rays.passed)[-1])
    step = (use.film_z - rays.origins[last, 2]) / rays.directions[last, 2]
    assert edge == pytest.approx(1e3 * (rays.origins[last, 1] + step * rays.directions[last, 1]), rel=1e-3)


@pytest.mark.parametrize(
    ("name", "degrees"), [("dgauss-50mm", 13.0), *map(slow, ("mirror-500mm", "phone-5.6mm"), (1.9, 0.0))]
)
def test_interpolated_wavefronts_are_those_of_rays_in_every_cell(name, degrees, monkeypatch):
    from rptcam_cl.optics import waves

    use = spots.setting(load_lens(name))
    quick = waves.pupil_function(use.lens, use.film, Beam(degrees), across=100)
    monkeypatch.setattr(waves, "NODES", ())
    traced = waves.pupil_function(use.lens, use.film, Beam(degrees), across=100)
    both = (quick.coverage > 0) & (traced.coverage > 0)
    assert abs(quick.waves_on_sphere - traced.waves_on_sphere)[both].max() < 1e-5
    assert quick.flux.sum() == pytest.approx(traced.flux.sum(), rel=1e-4)
    assert abs(quick.coverage - traced.coverage).max() < 0.1
    assert strehl(quick).at_peak == pytest.approx(strehl(traced).at_peak, rel=1e-3)


@pytest.mark.parametrize("across", [40, 41])
def test_half_of_an_even_pupil_says_what_all_of_its_cells_do(across: int) -> None:
    whole, half = (ExitRays(load_lens("tessar-100mm"), Beam(12.0), 550.0, 190.0) for _ in range(2))
    whole.is_even = False
    for name in ("cosines_x", "coverage", "density", "waves", "waves_on_sphere"):
        expected, found = (getattr(rays.on_grid(across), name) for rays in (whole, half))
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max(), err_msg=name)


def test_radii_of_light_have_no_steps() -> None:
    """Of a disk of light: r^2 = share, within an eighth of the square of a step, 48 / 17^3, over the radius."""
    from rptcam_cl.optics.waves import radius_of_share

    def within(radii: np.ndarray) -> np.ndarray:
        return np.minimum(radii, 1.0) ** 2

    for share in (0.311, 0.5, 0.95):
        assert radius_of_share(within, share, 48.0) == pytest.approx(
            np.sqrt(share), abs=(48 / 17**3) ** 2 / 8 / np.sqrt(share)
        )
    assert radius_of_share(within, 0.5, 0.3) == 0.3
