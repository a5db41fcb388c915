"""Lenses made better: exact derivatives, closed forms, bounds, rays that fail, and searches taken up again."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.api.job import render
from rptcam_cl.cli import main
from rptcam_cl.core.colour import luminance
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.device.session import open_session
from rptcam_cl.optics.design import GlassChoice, read_problem, singlet
from rptcam_cl.optics.glass import GLASSES, abbe_number
from rptcam_cl.optics.lens import film_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.optimise import MeritFunction, neighbours, optimise
from rptcam_cl.optics.ray_derivatives import Seeds, trace_with_derivatives
from rptcam_cl.optics.ray_trace import Status, trace
from rptcam_cl.optics.spots import Setting, spot, wavefront
from rptcam_cl.rendering.account import FAR_LENGTHS, TURN, blur_of_zones, board
from rptcam_cl.rendering.tolerance_run import spot_of_copies
from rptcam_cl.scene.changes import set_keys
from tests.support.cases import slow

EVERY_TERM = {
    "spot": 1, "wavefront": 1, "mtf": {"weight": 1, "per_mm": 30}, "distortion": 1, "axial_colour": 1,
    "lateral_colour": 1, "focal_length": 1, "f_number": {"target": 5}, "telecentricity": 1,
}  # fmt: skip
TRIPLET = {
    "lens": "cooke-triplet-50mm", "f_number": 5, "focal_length_mm": 50, "fields_degrees": [0, 14, 20],
    "variables": {"curvatures": "all", "thicknesses": "all"}, "vignetting": False,
}  # fmt: skip


def beam_through(lens, seeds, *, film_mm=30.0, count=40):
    """Rays over the entrance pupil of a lens, with the derivatives that seeds ask for."""
    random = np.random.default_rng(4)
    radius, angle, tilt = random.random(count) ** 0.5, 2 * np.pi * random.random(count), 0.2 * random.random(count)
    pupil = lens.first_order().entrance_pupil
    radius *= 0.4 * pupil.diameter_mm
    points = np.array([radius * np.cos(angle), radius * np.sin(angle), np.full(count, pupil.distance_mm)])
    directions = np.array([0 * tilt, np.sin(tilt), np.cos(tilt)])
    indices = np.repeat(lens.indices(np.array([587.6])), count, axis=1)
    variables = seeds.curvatures.shape[1]
    zero = np.zeros((variables, count))
    beam = trace_with_derivatives(lens, points, directions, np.zeros(count), indices, film_mm, seeds, zero[:, 0], zero)
    return points, directions, beam


@pytest.mark.parametrize("name", ["double-gauss-50mm-f1.8", "phone-5.6mm"])
def test_rays_with_derivatives_are_those_of_the_reference(name):
    lens = load_lens(name)
    points, directions, beam = beam_through(lens, Seeds.none(len(lens.surfaces), 0))
    rays = trace(lens, points.T, directions.T, 587.6, "scene")
    assert np.all(beam.status[rays.passed] == Status.ok) and rays.passed.sum() > 30
    ahead = (lens.film_z(30.0) - rays.origins[:, 2]) / rays.directions[:, 2]
    there = (rays.origins + ahead[:, None] * rays.directions).T[:2]
    np.testing.assert_allclose(beam.points[:2, rays.passed], there[:, rays.passed], atol=1e-12)
    paths = rays.optical_path + ahead
    np.testing.assert_allclose(beam.paths[rays.passed], paths[rays.passed], atol=1e-12)


@pytest.mark.parametrize("surface", [2, 7])
def test_derivatives_through_an_asphere_are_those_of_central_differences(surface):
    lens = load_lens("phone-5.6mm")
    numbers = ["curvature", "thickness", "conic", *[power for power, _ in lens.surfaces[surface].aspheric]]
    seeds = Seeds.none(len(lens.surfaces), len(numbers))
    seeds.curvatures[surface, 0] = seeds.thicknesses[surface, 1] = seeds.conics[surface, 2] = 1.0
    for j, power in enumerate(numbers[3:], start=3):
        seeds.aspheric[surface, power] = np.eye(len(numbers))[j]
    _, _, beam = beam_through(lens, seeds, film_mm=0.5)
    for j, number in enumerate(numbers):
        step, ends = 1e-6, []
        for sign in (1, -1):
            old = lens.surfaces[surface]
            terms = tuple((p, a + sign * step * (p == number)) for p, a in old.aspheric)
            change = {"aspheric": terms} if isinstance(number, int) else {number: getattr(old, number) + sign * step}
            moved = beam_through(lens.with_changes({surface: change}), Seeds.none(len(lens.surfaces), 0), film_mm=0.5)
            ends.append(np.vstack([moved[2].points[:2], moved[2].directions, moved[2].paths]))
        exact = np.vstack([*(beam.points_by[i][j] for i in (0, 1)), *(a[j] for a in beam.directions_by),
                           beam.paths_by[j]])  # fmt: skip
        # rounding of 1e-15 mm over steps of 1e-6
        atol = 4e-9 + 2e-7 * np.abs(exact).max()
        np.testing.assert_allclose((ends[0] - ends[1]) / (2 * step), exact, rtol=1e-5, atol=atol)


@pytest.mark.parametrize("near", [{}, {"object_distance_mm": 180}])
def test_derivatives_of_every_term_bound_and_solve_are_those_of_central_differences(near):
    given = read_problem({
        **TRIPLET, **near, "merit": EVERY_TERM,
        "variables": {"curvatures": [0, 1, 2, 3], "thicknesses": [0, 1, 3, 4], "conics": [2], "aspheric": {5: [4, 6]}},
        "pickups": [{"curvature": 4, "follows": 0, "factor": 0.3}],
        "solves": [{"curvature": 5, "focal_length_mm": 50}, {"thickness": 2, "edge_mm": 1.4}],
        "bounds": {"glass_centre_mm": [4, 5], "air_edge_mm": 9, "length_mm": [10, 20], "back_focal_mm": 70},
    })  # fmt: skip
    merit = MeritFunction(given, {})
    merit.set_hold(10.0)
    x = merit.x0 + 1e-3 * np.random.default_rng(1).normal(size=len(merit.x0))
    _, exact = merit.evaluate(x, True)
    steps = 1e-6 * np.eye(len(x))
    differences = np.array([(merit.evaluate(x + h, False)[0] - merit.evaluate(x - h, False)[0]) / 2e-6 for h in steps])
    rows = np.abs(exact).max(axis=1)
    assert np.count_nonzero(rows) > 100
    np.testing.assert_allclose(differences.T, exact, atol=1e-6 * rows.max(), rtol=1e-5)
    state = merit.state(x, False)
    assert state.lens.first_order(given.wavelengths_nm[given.reference]).focal_length_mm == pytest.approx(50, abs=1e-10)
    assert state.lens.surfaces[4].curvature == pytest.approx(0.3 * state.lens.surfaces[0].curvature, rel=1e-15)


@pytest.mark.parametrize(("degrees", "away"), [(0, math.inf), (1, math.inf), (0, 400.0)])
def test_spot_and_wavefront_of_the_merit_are_those_that_are_measured(degrees, away):
    lens = load_lens("achromat-100mm")
    lens = lens.with_stop_diameter(lens.stop_diameter_for(8))
    film = film_distance(lens, away, "front") - 0.15
    merit = MeritFunction(read_problem({
        "lens": "achromat-100mm", "f_number": 8, "fields_degrees": [degrees], "wavelengths_nm": [587.5618],
        "variables": {"curvatures": [0]}, "film": {"distance_mm": film}, "merit": {"wavefront": 1, "spot": 1},
        "vignetting": False, "rings": 8, "arms": 10, **({"object_distance_mm": away} if away < math.inf else {}),
    }), {})  # fmt: skip
    found = merit.values_of(merit.x0)
    use = Setting(lens, film, away)
    waves = wavefront(use, [degrees], [587.5618], rays=None)["rms_waves_without_tilt"][0]
    assert found["wavefront"] == pytest.approx(waves, rel=0.01)  # the measure has its own rays and sphere
    [spots] = [row for row in spot(use, [degrees], [587.5618], rays=None).rows if row["wavelength_nm"] == 587.5618]
    assert found["spot"] == pytest.approx(spots["rms_um"], rel=0.01)


def test_singlet_bends_to_the_shape_of_least_spherical_aberration():
    # Thin lens, distant object: q = 2 (n^2 - 1) / (n + 2) of (R2 + R1) / (R2 - R1) has the least (Born & Wolf, 5.5).
    glass = GlassChoice(1.5, math.inf, {"index": 1.5})
    found = optimise({
        "lens": singlet(1000.0, glass, 10.0, 0.0), "focal_length_mm": 1000, "f_number": 100, "fields_degrees": [0],
        "wavelengths_nm": [587.5618], "variables": {"curvatures": [0]},
        "solves": [{"curvature": 1, "focal_length_mm": 1000}], "rings": 6,
    })  # fmt: skip
    c1, c2 = (surface.curvature for surface in found.lens.surfaces)
    shape = (c1 + c2) / (c1 - c2)
    assert shape == pytest.approx(2 * (1.5**2 - 1) / (1.5 + 2), abs=5e-3)  # thickness 0.5 mm of 1000


def test_singlet_for_a_picture_of_natural_size_bends_alike_on_both_sides():
    # Thin lens: least spherical aberration at q = 2 (n^2 - 1) / (n + 2) (u + v) / (u - v), which is 0 for u = -v.
    start = singlet(100, GlassChoice(1.5168, math.inf, {"index": 1.5168}), 4, bending=0.6)
    start["surfaces"][0]["stop"] = True
    found = optimise({
        "lens": start, "object_distance_mm": 200, "fields_degrees": [0], "wavelengths_nm": [587.5618], "f_number": 50,
        "variables": {"curvatures": "all"}, "merit": {"spot": 1}, "focal_length_mm": 100,
    })  # fmt: skip
    one, two = (surface.curvature for surface in found.lens.surfaces)
    assert abs((one + two) / (one - two)) < 0.03  # its thickness
    assert found.film_mm == pytest.approx(film_distance(found.lens, 200, "front"), abs=0.1)


def test_doublet_gets_the_powers_of_a_thin_achromat():
    crown, flint = GLASSES["N-BK7"], GLASSES["SF5"]
    found = optimise({
        "lens": {"name": "start", "surfaces": [
            {"radius": 400, "thickness": 0.2, "glass": "N-BK7", "diameter": 6, "stop": True},
            {"radius": -600, "thickness": 0.1, "glass": "SF5", "diameter": 6}, {"radius": -900, "diameter": 6}]},
        "focal_length_mm": 500, "f_number": 100, "fields_degrees": [0],
        "wavelengths_nm": [486.1327, 587.5618, 656.2725], "variables": {"curvatures": [0, 1]},
        "solves": [{"curvature": 2, "focal_length_mm": 500}], "merit": {"axial_colour": 100, "spot": 0.01},
        "bounds": {"glass_edge_mm": -1},
    })  # fmt: skip
    c1, c2, c3 = (surface.curvature for surface in found.lens.surfaces)
    v1, v2 = abbe_number(crown), abbe_number(flint)
    power = (float(crown.index(587.5618)) - 1) * (c1 - c2), (float(flint.index(587.5618)) - 1) * (c2 - c3)
    # 1 / (f (1 - V2 / V1)); what is left is the thickness, 0.3 mm of 500
    assert power[0] == pytest.approx(v1 / (v1 - v2) / 500, rel=3e-3)
    assert power[1] == pytest.approx(-v2 / (v1 - v2) / 500, rel=6e-3)
    assert found.after["axial_colour"] < 1e-3


def test_bounds_hold_and_merit_falls():
    bounds = {"glass_centre_mm": [1.5, 3.0], "glass_edge_mm": 0.9, "air_edge_mm": 0.3, "length_mm": [40, 58]}
    found = optimise({**TRIPLET, "bounds": bounds, "evaluations": 150})
    assert found.after["merit"] < found.before["merit"]
    assert found.lens.first_order(587.5618).focal_length_mm == pytest.approx(50, rel=2e-6)
    gaps = [surface.thickness for surface in found.lens.surfaces]
    assert all(1.5 <= gaps[k] <= 3.0 for k in (0, 2, 4)) and found.lens.length + found.film_mm <= 58
    again = load_lens(json.loads(json.dumps(_as_mapping(found.lens))))
    for one, other in zip(again.surfaces, found.lens.surfaces, strict=True):
        assert one.curvature == pytest.approx(other.curvature, rel=1e-15)
        assert (one.thickness, one.semi_diameter) == (other.thickness, other.semi_diameter)


def _as_mapping(lens):
    from rptcam_cl.core.strict_yaml import read_yaml
    from rptcam_cl.optics.files.export import lens_text

    return read_yaml(lens_text(lens)).data


def triplet_with(surface, curvature):
    """A problem of the triplet with one curvature wrong."""
    lens = load_lens("cooke-triplet-50mm").with_changes({surface: {"curvature": curvature}})
    return read_problem({
        **TRIPLET, "lens": _as_mapping(lens), "bounds": {"glass_edge_mm": -9, "air_edge_mm": -9}, "evaluations": 150,
    })  # fmt: skip


@pytest.mark.parametrize("surface, curvature, reason", [(0, 0.14, "miss"), (0, 0.09, "reflected"), (4, 0.08, "reflec")])
def test_lost_rays_are_a_finite_penalty_with_a_reason(surface, curvature, reason):
    merit = MeritFunction(triplet_with(surface, curvature), {})
    assert any(reason in words and " rays " in words for words in merit.lost_rays(merit.x0))
    values, by = merit.evaluate(merit.x0, True)
    assert np.all(np.isfinite(values)) and np.all(np.isfinite(by))
    whole = MeritFunction(triplet_with(surface, load_lens("cooke-triplet-50mm").surfaces[surface].curvature), {})
    good, _ = whole.evaluate(whole.x0, False)
    assert values @ values > 100 * (good @ good)


@pytest.mark.parametrize("surface, curvature", [(0, 0.09), slow(4, 0.08)])
def test_search_finds_back_from_lost_rays(surface, curvature):
    assert not optimise(triplet_with(surface, curvature)).lost


@pytest.mark.slow
def test_bounds_that_cannot_hold_are_said_in_one_sentence():
    with pytest.raises(
        InputError,
        match=r"bounds\.\w+: .* must be at .* mm, and no values of the variables do it: [0-9.]+ mm are left$",
    ):
        optimise({**TRIPLET, "bounds": {"length_mm": [0, 20], "back_focal_mm": 30}, "evaluations": 60})
    with pytest.raises(InputError, match=r"glass behind surface 0 must be at most 1 mm, and no variable changes it"):
        optimise({**TRIPLET, "variables": {"curvatures": "all"}, "bounds": {"glass_centre_mm": [0.5, 1]}})


def test_a_search_taken_up_again_ends_with_the_same_bits(tmp_path):
    given = {**TRIPLET, "search": {"count": 1, "step": 0.05}, "evaluations": 40, "rings": 2, "arms": 2}
    whole = optimise(given, state=tmp_path / "whole.json")
    state = json.loads((tmp_path / "whole.json").read_text())
    (tmp_path / "cut.json").write_text(json.dumps({**state, "stages": state["stages"][: len(state["stages"]) // 2]}))
    again = optimise(given, state=tmp_path / "cut.json")
    assert again.lens == whole.lens and again.film_mm == whole.film_mm and again.evaluations == whole.evaluations
    with pytest.raises(StateError, match="another problem"):
        optimise({**given, "f_number": 6}, state=tmp_path / "cut.json")


def test_glasses_are_exchanged_for_neighbours_that_are_better():
    given = {**TRIPLET, "variables": {"curvatures": "all", "glasses": {2: {"makers": ["schott"], "tries": 2}}},
             "rings": 2, "arms": 2, "evaluations": 60}  # fmt: skip
    problem = read_problem(given)
    tried = neighbours(GLASSES["F2"], problem.glasses[0], problem.wavelengths_nm)
    away = [abs(float(one.index(587.5618)) - 1.62) for one in tried]
    assert len(tried) == 2 and max(away) < 0.02 and GLASSES["F2"] not in tried
    plain = optimise({**given, "variables": {"curvatures": "all"}})
    found = optimise(given)
    assert found.after["merit"] <= plain.after["merit"]
    assert load_lens(_as_mapping(found.lens)).surfaces[2].glass == found.lens.surfaces[2].glass


@pytest.mark.parametrize("change, words", [
    ({"variables": {"curvature": "all"}}, r"variables\.curvature: unknown key \(did you mean curvatures"),
    ({"variables": {"curvatures": [9]}}, r"variables\.curvatures: expected all, or surfaces from 0 to 5"),
    ({"pickups": [{"curvature": 1, "follows": 1}]}, r"pickups\[0\]\.follows"),
    ({"pickups": [{"curvature": 1, "follows": 0}]}, "curvature 1 is variable, follows or is solved for twice"),
    ({"merit": {"mtf": 1}}, r"merit\.mtf: needs \{weight: 1, per_mm"),
    ({"bounds": {"length_mm": [9, 3]}}, r"bounds\.length_mm: expected the least value"),
    ({"lens": "mirror-500mm"}, r"lens: surface \d+ is no sphere"),
    ({"lens": "zoom-70-200mm"}, "lens: zooms"),
    ({"film": "flat"}, "film: allowed: best, paraxial"),
    ({"vignetting": 3}, "vignetting"),
    ({"zones": [[0.4, 0.3, 0, 1]]}, r"zones: expected \[\[left, right"),
])  # fmt: skip
def test_faults_of_a_problem_name_their_key(change, words):
    with pytest.raises(InputError, match=words):
        read_problem({**TRIPLET, **change})


def test_command_writes_a_lens_that_says_where_it_is_from(tmp_path, capsys):
    problem = tmp_path / "problem.yaml"
    problem.write_text("lens: biconvex-stop\nfields_degrees: [0, 1]\nvariables: {curvatures: all}\n")
    out = tmp_path / "better.yaml"
    assert main(["lens", "optimise", str(problem), "-o", str(out), "--json", "--state", str(tmp_path / "s.json")]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["after"]["merit"] < facts["before"]["merit"]
    lens = load_lens(out)
    assert "optimised by rptcam" in lens.source and "problem.yaml" in lens.source
    assert lens.first_order().f_number == pytest.approx(load_lens("biconvex-stop").first_order().f_number, rel=1e-5)
    assert main(["lens", "optimise", str(problem), "--scene", "board"]) == 2
    assert "--report" in capsys.readouterr().err
    assert Path(out).read_text().startswith("name: ")


@pytest.mark.slow
@pytest.mark.parametrize("kind, count", [("hops", 3), ("evolution", 2)])
def test_global_searches_are_no_worse_than_the_descent_and_repeat(kind, count):
    given = {**TRIPLET, "variables": {"curvatures": "all"}, "rings": 2, "arms": 2, "evaluations": 60}
    plain = optimise(given)
    found = [optimise({**given, "search": {"kind": kind, "count": count, "step": 0.1, "seed": 3}}) for _ in range(2)]
    assert found[0].lens == found[1].lens
    assert found[0].after["merit"] <= plain.after["merit"] * 1.001


@pytest.mark.slow
def test_report_has_drawings_and_pictures_of_three_lenses(tmp_path):
    problem = tmp_path / "problem.yaml"
    problem.write_text("lens: biconvex-stop\nfields_degrees: [0, 5]\nvariables: {curvatures: all}\n")
    folder = tmp_path / "report"
    words = ["lens", "optimise", str(problem), "--report", str(folder), "--scene", "board", "--spp", "2"]
    assert main([*words, "--tolerances", "precision"]) == 0
    assert {"before.svg", "after.svg", "before.png", "after.png", "as_built_90.png", "pictures.png"} <= {
        path.name for path in folder.iterdir()
    }


@pytest.mark.slow
def test_merit_of_copies_falls_and_is_what_their_judge_says_of_the_lens():
    given = TRIPLET | {"variables": {"curvatures": [0, 4]}, "tolerances": "commercial", "evaluations": 8}
    problem = read_problem(given | {"merit": {"as_built": 1}})
    judge = spot_of_copies(problem)
    found = optimise(problem, judge=judge)
    assert found.after["as_built"] < found.before["as_built"]
    assert found.after["as_built"] == pytest.approx(judge(found.lens, found.film_mm), rel=1e-6)
    with pytest.raises(InputError, match="as_built needs a judge"):
        optimise(problem)
    with pytest.raises(InputError, match=r"merit.as_built needs tolerances"):
        read_problem(TRIPLET | {"merit": {"as_built": 1}})


PICTURE = TRIPLET | {"merit": {"picture": 1}, "variables": {"curvatures": [1, 4]}, "zones": [[0.8, 0.825, 0.48, 0.52]]}


def rendered_blur(problem, lens, film_mm):
    """The blur of the one zone of a problem by whole renders of two seeds, without the search's renderer."""
    [(left, right, top, bottom)] = problem.zones
    halves = []
    for seed in (5, 6):
        pictures = []
        for share, colour in ((1.0, "on"), (0.02, "off")):
            own = lens.with_stop_diameter(2 * share * lens.surfaces[lens.stop_index].semi_diameter)
            scene = set_keys(board(problem, FAR_LENGTHS, TURN), {
                "camera.lens": _as_mapping(own), "camera.focus": {"film_distance_mm": film_mm},
                "film.crop": [left, right, top, bottom], "spectrum.lens": colour,
            })  # fmt: skip
            light = luminance(np.asarray(render(scene, spp=256, seed=seed), np.float64))
            y, x = np.indices(light.shape) / len(light)
            trend = np.stack([x**i * y**j for i in range(3) for j in range(3 - i)], axis=-1).reshape(-1, 6)
            flat = light.ravel() / light.mean()
            pictures.append(flat - trend @ np.linalg.lstsq(trend, flat, rcond=None)[0])
        slopes = np.stack([part.ravel() for part in np.gradient(pictures[1].reshape(light.shape))], axis=1)
        off = pictures[0] - pictures[1]
        halves.append((off - slopes @ np.linalg.lstsq(slopes, off, rcond=None)[0], pictures[1]))
    return 100 * math.sqrt((halves[0][0] @ halves[1][0]) / (halves[0][1] @ halves[1][1]))


@pytest.mark.slow
def test_blur_of_a_rendered_zone_is_that_of_whole_renders():
    problem = read_problem(PICTURE)
    merit = MeritFunction(problem, {})
    lens, film = merit.finished(merit.state(merit.x0, False))
    blur = blur_of_zones(problem, open_session(None), 256)
    found = blur(lens, film)
    assert found.value == found.zones[0][0] and 0 < found.error < 0.5
    again = blur_of_zones(problem, open_session(None), 512, seed=9)(lens, film)
    assert abs(found.value - again.value) < 4 * math.hypot(found.error, again.error)
    # the render's pupils are those of the whole film, so that its noise is another
    assert again.value == pytest.approx(rendered_blur(problem, lens, film), abs=0.3)
    assert blur(lens, -99.0).value == math.inf  # no picture at all


@pytest.mark.slow
def test_a_zone_that_shows_nothing_or_gets_less_light_is_no_sharper():
    problem = read_problem(PICTURE | {"zones": [[0.97, 0.985, 0.48, 0.5]]})  # the edge, where searches went astray
    merit = MeritFunction(problem, {})
    lens, film = merit.finished(merit.state(merit.x0, False))[0], 42.25
    blur = blur_of_zones(problem, open_session(None), 64)
    best = np.linalg.norm(blur(lens, film).residuals)
    narrow, dark = (lens.with_changes({0: {"semi_diameter": height}}) for height in (4.4, 1.0))
    assert np.linalg.norm(blur(narrow, film).residuals) > 50 > best  # half of the light is lost in the first rim
    for one, place in ((dark, film), (lens, 1700.0)):  # no light; a field without detail
        assert np.linalg.norm(blur(one, place).residuals) > 500
    with pytest.raises(InputError, match="nothing is seen in zone 0 through the best lens by spots"):
        optimise(problem, judge={"picture": lambda lens, _film: blur(lens, 1700.0)})


def test_edges_of_the_board_blur_alike_wherever_they_lie_between_pixels():
    problem = read_problem(PICTURE | {"focal_length_mm": 50.0213663})
    merit = MeritFunction(problem, {})
    lens, _ = merit.finished(merit.state(merit.x0, False))
    blur = blur_of_zones(problem, open_session(None), 128)
    near, far = (blur(lens, film).value for film in (42.15, 42.182))  # half a pixel; 19.4 and 10.7 by a straight board
    assert abs(near - far) < 3


@pytest.mark.slow
def test_search_by_a_rendered_zone_makes_it_sharper_than_one_by_spots():
    device = open_session(None)
    given = PICTURE | {"variables": {"curvatures": "all"}, "zones": [[0.97, 0.995, 0.48, 0.52]]}
    problem = read_problem(given)
    plain = optimise({**given, "merit": {"spot": 1}})
    found = optimise(problem, judge={"picture": blur_of_zones(problem, device)})
    judge = blur_of_zones(problem, device, 1024, seed=3)  # samples of which the search knows nothing
    before, after = judge(plain.lens, plain.film_mm), judge(found.lens, found.film_mm)
    assert after.value < before.value - 4 * math.hypot(before.error, after.error)
    assert found.after["picture"] == pytest.approx(after.value, abs=5 * after.error + 0.3)
    assert not found.no_better
    with pytest.raises(InputError, match=r"merit.picture needs a judge"):
        optimise(problem)
    with pytest.raises(InputError, match="the film does not reach to 14 degrees"):
        blur_of_zones(read_problem({**PICTURE, "zones": [], "scene": "examples/portrait.yaml"}), device)
