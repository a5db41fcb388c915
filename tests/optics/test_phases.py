"""Gratings, diffractive surfaces and ideal lenses: closed forms, Fermat's principle, files, and what refuses them."""

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.as_built import Copies, film_points
from rptcam_cl.optics.beams import Beam
from rptcam_cl.optics.files.export import codev_text, lens_text, pbrt_text, zemax_text
from rptcam_cl.optics.ghosts import check_lens
from rptcam_cl.optics.lens import at_conjugates
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import Status, at_plane, passed_rays
from rptcam_cl.optics.waves import pupil_function
from rptcam_cl.rendering.cameras.lens_records import lens_records

ROWS = {
    "grating": {"radius": 40, "conic": 0.7, "grating": {"lines_per_mm": 300, "order": -2, "towards_degrees": 70}},
    "rings": {"radius": -60, "aspheric": {4: 1e-5}, "glass": {"index": 1.6},
              "diffractive": {"path": {2: -2e-3, 4: 3e-6}, "wavelength_nm": 500}},
    "mirror": {"radius": -90, "mirror": True, "grating": {"lines_per_mm": 600}},
}  # fmt: skip


def lens_of(*rows, **keys):
    return load_lens({"name": "phases", "surfaces": [{"diameter": 30, **row} for row in rows], **keys})


def bundle(count=40, seed=3):
    random = np.random.default_rng(seed)
    points = np.column_stack([*random.uniform(-4, 4, (2, count)), np.full(count, -20.0)])
    directions = np.column_stack([*random.uniform(-0.1, 0.1, (2, count)), np.ones(count)])
    return points, directions / np.linalg.norm(directions, axis=1)[:, None]


@pytest.mark.parametrize("row", ROWS.values(), ids=ROWS)
def test_rays_obey_fermat_and_can_be_reversed(row):
    """The path between a point before and one behind a surface does not change to first order with where they meet."""
    lens, nm = lens_of(row), 633.0
    (surface,), (before, after) = lens.surfaces, lens.indices(nm)
    starts, directions = bundle()
    rays = lens.trace(starts, directions, nm, "scene")
    assert rays.passed.all()
    ends = rays.origins + 15 * rays.directions

    def path(x, y):
        met = np.column_stack([x, y, surface.sag(x, y)])
        added = surface.phase.path_and_slopes(x, y, np.asarray(nm))[0]
        return before * np.linalg.norm(met - starts, axis=1) + added + after * np.linalg.norm(ends - met, axis=1)

    x, y, step = *rays.origins.T[:2], 1e-4
    for dx, dy in ((step, 0.0), (0.0, step)):
        np.testing.assert_allclose((path(x + dx, y + dy) - path(x - dx, y - dy)) / (2 * step), 0, atol=2e-9)
    np.testing.assert_allclose(rays.optical_path + after * 15, path(x, y), atol=1e-12)
    back = lens.trace(ends, -rays.directions, nm)
    np.testing.assert_allclose(back.directions, -directions, atol=1e-13)
    np.testing.assert_allclose(passed_rays(lens, starts, directions, nm, "scene")[2].T, rays.directions, atol=1e-15)


def test_a_plane_grating_turns_light_as_its_equation_says():
    lens = lens_of({"glass": {"index": 1.5}, "grating": {"lines_per_mm": 1000, "order": 1}})
    angles, nm = np.radians([-20.0, 0.0, 20.0, 75.0]), np.array([450.0, 550.0, 650.0, 650.0])
    directions = np.column_stack([0 * angles, np.sin(angles), np.cos(angles)])
    rays = lens.trace(np.zeros((4, 3)) - directions, directions, nm, "scene", transmission=None)
    np.testing.assert_allclose(rays.directions[:3, 1], (np.sin(angles) + nm * 1e-3)[:3] / 1.5, atol=1e-15)
    assert rays.status.tolist() == [Status.ok] * 3 + [Status.total_internal_reflection]  # this order does not propagate


def test_diffractive_power_is_that_of_its_rays():
    lens = lens_of({"diffractive": {"path": {2: -0.005}, "order": 2, "wavelength_nm": 500}})
    assert lens.first_order(550.0).focal_length_mm == pytest.approx(1 / (2 * 2 * 1.1 * 0.005), rel=1e-14)
    ray = lens.trace([[0, 1e-4, -1]], [[0, 0, 1]], 550.0, "scene")
    assert -1e-4 / ray.directions[0, 1] == pytest.approx(lens.first_order(550.0).focal_length_mm, rel=1e-6)


def test_an_ideal_lens_images_planes_onto_planes_by_equal_paths():
    lens = lens_of({"glass": {"index": 1.33}, "ideal": {"focal_length": 50}})
    random = np.random.default_rng(1)
    for away in (200.0, 30.0):
        behind, conjugate = 1.33 / (1 / 50 - 1 / away), at_conjugates(lens, away)
        target = np.column_stack([*random.uniform(-10, 10, (2, 30)), np.zeros(30)])
        source = np.array([7.0, -3.0, -away])
        rays = conjugate.trace(np.tile(source, (30, 1)), target - source, start="scene")
        image = at_plane(rays.origins, rays.directions, behind)
        np.testing.assert_allclose(image, np.tile(image[0], (30, 1)), atol=1e-11)
        assert image[0, :2] == pytest.approx(-behind / 1.33 / away * source[:2])
        whole = rays.optical_path + 1.33 * np.linalg.norm(image - rays.origins, axis=1) * np.sign(behind)
        np.testing.assert_allclose(whole, whole[0], atol=1e-10)
        back = conjugate.trace(rays.origins + 5 * rays.directions, -rays.directions)
        way = np.linalg.norm(target - source, axis=1)
        np.testing.assert_allclose(back.optical_path - 5 * 1.33, rays.optical_path - way, atol=1e-11)
    pair = lens_of({"thickness": 30, "ideal": {"focal_length": -80}}, {"stop": True, "ideal": {"focal_length": 40}})
    waves = pupil_function(pair, pair.first_order().back_focal_distance_mm, Beam(4.0))
    assert np.ptp(waves.waves_on_sphere[waves.coverage > 0.5]) < 1e-5


ALL = [{"thickness": 5, "glass": "N-BK7", **ROWS["rings"]}, {"thickness": 20, "grating": {"lines_per_mm": 50}},
       {"stop": True, "ideal": {"focal_length": 40}}]  # fmt: skip


def test_files_hold_them(tmp_path):
    lens = lens_of(*ALL, unit="cm")
    assert lens.surfaces[2].phase.focal_length_mm == 400 and lens.surfaces[0].phase.terms[0] == (2, -2e-4)
    (tmp_path / "a.yaml").write_text(lens_text(lens))
    assert load_lens(tmp_path / "a.yaml").surfaces == lens.surfaces
    for write, suffix, rows in ((zemax_text, ".zmx", ALL), (codev_text, ".seq", [ALL[0], ALL[2]])):
        some, path = lens_of({"radius": 50, **rows[0], "aspheric": {4: 1e-6}}, *rows[1:]), tmp_path / f"a{suffix}"
        path.write_text(write(some))
        again = load_lens(path)
        assert not again.warnings
        rays = [[[0, 1, -5], [0.5, -1, -5]], [[0, 0.02, 1], [0.01, 0, 1]], 640.0, "scene"]
        np.testing.assert_allclose(again.trace(*rays).directions, some.trace(*rays).directions, atol=1e-14)
    for write, what in ((codev_text, "a grating"), (pbrt_text, "a diffractive surface")):
        with pytest.raises(InputError, match=what):
            write(lens)
    with pytest.raises(InputError, match="a diffractive surface on such a shape"):
        zemax_text(lens_of({"radius": 50, **ALL[0], "aspheric": {3: 1e-6}}, ALL[2]))


def test_foreign_files_say_them(tmp_path):
    (tmp_path / "a.seq").write_text(
        "RDM\nEPD 2\nSO 0 1E11\nS 0 3 1.5:60\n DIF DOE\n HOR 1; HWL 550; HCT R\n HCO C1 -0.001; HCC C1 100\n"
        "S 0 9\n MOD\n MFL 30\nSI 0 0\n"
    )
    rings, ideal = (surface.phase for surface in load_lens(tmp_path / "a.seq").surfaces)
    assert (rings.terms, rings.wavelength_nm, rings.order, ideal.focal_length_mm) == (((2, -0.001),), 550, 1, 30)
    lines = ["MODE SEQ", "UNIT MM", "ENPD 5", "SURF 0", "DISZ INFINITY", "SURF 1", "STOP", "TYPE BINARY_2", "PARM 0 1",
             "XDAT 1 1", "XDAT 2 10", f"XDAT 3 {-100 * np.pi / (587.5618e-6 * 40)}", "DISZ 3", "GLAS N-BK7",
             "SURF 2", "TYPE DGRATING", "PARM 1 0.2", "PARM 2 -1", "DISZ 9", "DIAM 9", "SURF 3", "DISZ 0"]  # fmt: skip
    (tmp_path / "a.zmx").write_text("\n".join(lines))
    lens = load_lens(tmp_path / "a.zmx")
    assert lens.surfaces[0].phase.power(587.5618) == pytest.approx(1 / 40)
    ray = lens.trace([[0, 0, -1]], [[0, 0, 1]], 587.0, "scene")
    assert ray.directions[0] == pytest.approx([0, -0.1174, 0.9930847094], abs=1e-10)  # as optiland 0.6.3 has it


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"grating": {"lines_per_mm": 0}}, r"grating\.lines_per_mm"),
        ({"grating": {"lines_per_mm": 9, "order": 0.5}}, r"grating\.order: expected a whole number, not 0"),
        ({"diffractive": {"path": {3: 1}}}, r"diffractive\.path: a power of r is an even number from 2 to 40"),
        ({"ideal": {"focal_length": 0}}, r"ideal\.focal_length: must not be 0"),
        ({"ideal": {"focal_length": 5}, "radius": 9}, r"radius: an ideal lens is a plane"),
        ({"ideal": {"focal_length": 5}, "grating": {"lines_per_mm": 9}}, "a surface has one of grating, ideal"),
    ],
)
def test_bad_keys_are_named(row, words):
    with pytest.raises(InputError, match=words):
        lens_of(row)


def test_copies_of_the_lens_trace_as_it_does():
    lens = lens_of(*ALL)
    starts, directions = bundle()
    rays = lens.trace(starts, directions, start="scene")
    assert rays.passed.all()
    points, _ = film_points(Copies(lens, (), np.zeros((1, 0, 2))), starts, directions, 587.5618, 40.0)
    np.testing.assert_allclose(points[0], at_plane(rays.origins, rays.directions, lens.film_z(40.0))[:, :2], atol=1e-12)


def test_what_takes_no_such_lens_says_so(tmp_path, capsys):
    lens = lens_of(*ALL[1:])
    assert not lens.is_rotational and lens.of_surfaces(lens.surfaces[1:], 0).is_rotational
    with pytest.raises(InputError, match="phases: surface 0 is a grating; ghosts are of lenses that refract"):
        check_lens(lens)
    with pytest.raises(InputError, match="phases: surface 0 is a grating; devices trace none"):
        lens_records(lens, 550.0, "film", 0.0)
    (tmp_path / "a.yaml").write_text(lens_text(lens))
    assert main(["lens", "seidel", str(tmp_path / "a.yaml")]) == 2
    assert "surface 0 is a grating; Seidel sums are of lenses that refract" in capsys.readouterr().err
    assert main(["lens", "draw", str(tmp_path / "a.yaml"), "-o", str(tmp_path / "a.svg")]) == 0
    assert "in float64 on the host" in capsys.readouterr().err
