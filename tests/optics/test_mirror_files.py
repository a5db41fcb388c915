"""Mirrors, rings and folds as files of Zemax, CODE V and our own have them, read and written."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.drawing import View, bundles, reference
from rptcam_cl.optics.files.export import codev_text, lens_text, zemax_text
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.spots import setting
from rptcam_cl.optics.waves import pupil_function, rms_waves
from tests.optics.test_mirrors import BEAM, axial, cassegrain, crossing

N_BK7 = 1.5168000345


ZEMAX = """\
MODE SEQ
UNIT MM
SURF 0
  TYPE STANDARD
  DISZ INFINITY
SURF 1
  TYPE STANDARD
  CURV 0
  DISZ 140
  DIAM 60
  OBSC 0 21 0
SURF 2
  STOP
  TYPE STANDARD
  CURV -0.0025
  CONI -1
  DISZ -140
  GLAS MIRROR 0 0 1.5 40 0 0 0 0 0 0
  DIAM 50
  CLAP 15 50 0
SURF 3
  TYPE STANDARD
  CURV -0.00625
  CONI -2.7777777777777777
  DISZ 240
  GLAS MIRROR 0 0 1.5 40 0 0 0 0 0 0
  DIAM 20
SURF 4
  TYPE STANDARD
  CURV 0
"""
CODE_V = """\
LEN
RDM
SO 0 1e11
S 0 140
  CIR 60
  CIR OBS 21
S -400 -140 REFL
  STO
  CIR 50
  CIR HOL 15
  CON
  K -1
S -160 240
  RMD REFL
  CIR 20
  CON
  K -2.7777777777777777
SI 0 0
"""


@pytest.mark.parametrize(("suffix", "text"), [("zmx", ZEMAX), ("seq", CODE_V)])
def test_other_programs_mirrors_and_holes_are_read(tmp_path, suffix, text):
    path = tmp_path / f"cassegrain.{suffix}"
    path.write_text(text)
    found = load_lens(path)
    assert [s.inner_semi_diameter for s in found.surfaces] == [21, 15, 0]
    assert found.first_order().focal_length_mm == pytest.approx(800, abs=1e-10)
    np.testing.assert_allclose(crossing(found.trace(*axial(BEAM[6:]), start="scene")), 240, atol=1e-10)


def test_mirrors_read_back_from_the_text_of_a_lens(tmp_path):
    ring = cassegrain(400.0, 160.0, 140.0, 240.0, obstruction=42.0)
    path = tmp_path / "again.yaml"
    path.write_text(lens_text(ring))
    assert load_lens(path).surfaces == ring.surfaces


@pytest.mark.parametrize(("suffix", "write"), [("zmx", zemax_text), ("seq", codev_text)])
def test_mirrors_read_back_from_other_programs_files(tmp_path, suffix, write):
    ring = cassegrain(400.0, 160.0, 140.0, 240.0, obstruction=42.0)
    path = tmp_path / f"ring.{suffix}"
    path.write_text(write(ring))
    again = load_lens(path)
    keys = ("curvature", "thickness", "conic", "semi_diameter", "inner_semi_diameter", "is_mirror")
    for key in keys:
        np.testing.assert_allclose(
            [getattr(s, key) for s in again.surfaces], [getattr(s, key) for s in ring.surfaces], rtol=1e-14, atol=1e-14
        )


FOLDED = """\
LEN
RDM N
SO 0 1e11
S 0 5
  CIR 4
S 0 -2.25 REFL
  CIR 4
  ADE 60; BEN
S -.67 -.3 NBK7_SCHOTT
  CIR 1
S 0 -.05
  CIR 1
S 0 -.2 NBK7_SCHOTT
  CIR 1
S -.77095 -2.25
  CIR 1
S 0 2.25 REFL
  CIR 4
  ADE -60; BEN
S -.67 .2 NBK7_SCHOTT
  CIR 1
S 0 .05
  CIR 1
S 0 .3 NBK7_SCHOTT
  CIR 1
S -.59225 2.25
  CIR 1
S 0 -5 REFL
  CIR 4
  ADE -45; BEN
SI 0 0
"""


def test_rays_through_folded_lenses_are_those_of_ray_optics(tmp_path):
    """Point and direction on the last mirror, in its frame; the prescription is that of its file folded_lenses.seq."""
    path = tmp_path / "folded.seq"
    path.write_text(FOLDED)
    folded = load_lens(path)
    slope = np.tan(np.radians(0.5))
    rays = folded.trace([[0.1, 0.3, 0], [0.2, -0.25, 0]], [[0, 0, 1], [0, slope, 1]], 555.0, start="scene")
    points, directions = folded.surfaces[-1].pose.inward((rays.origins - [0, 0, folded.length]).T, rays.directions.T)
    expected = [[0.09740373506910906, 0.41324904948158886, 0], [0.1951910244370261, -0.14774518311476026, 0]]
    np.testing.assert_allclose(points.T, expected, atol=1e-13)
    expected = [
        [-0.00011954227907051002, 0.7068531431939981, -0.7073603181310137],
        [-0.0001884995764714903, 0.7134718187434236, -0.700683900433613],
    ]
    np.testing.assert_allclose(directions.T, expected, atol=1e-13)


def test_the_film_of_a_folded_lens_stands_where_its_axis_ends(tmp_path):
    """The axis comes to the middle of the film at a right angle; rays go back the way that they came."""
    path = tmp_path / "folded.seq"
    path.write_text(FOLDED)
    folded = load_lens(path)
    axis = folded.trace([[0, 0, 0]], [[0, 0, 1]], 555.0, "scene")
    np.testing.assert_allclose(axis.origins[0, :2], 0, atol=1e-10)
    np.testing.assert_allclose(axis.directions[0], [0, 0, folded.sense], atol=1e-10)
    there = folded.trace([[0.1, 0.3, 0], [0.2, -0.25, 0]], [[0, 0, 1], [0.01, 0.02, 1]], 555.0, "scene")
    back = folded.trace(there.origins + 3 * there.directions, -there.directions, 555.0, "film")
    start = back.origins - back.directions * (back.origins[:, 2:] / back.directions[:, 2:])
    np.testing.assert_allclose(start, [[0.1, 0.3, 0], [0.2, -0.25, 0]], atol=1e-9)
    np.testing.assert_allclose(back.directions[0], [0, 0, -1], atol=1e-9)
    (tmp_path / "again.yaml").write_text(lens_text(folded))
    again = load_lens(tmp_path / "again.yaml").trace([[0.2, -0.25, 0]], [[0.01, 0.02, 1]], 555.0, "scene")
    np.testing.assert_allclose(again.origins[0], there.origins[1], atol=1e-9)
    with pytest.raises(InputError, match="its axis is folded"):
        zemax_text(folded)


def test_axes_folded_out_of_the_plane_are_those_of_the_file(tmp_path):
    """Five mirrors at 45 degrees turn the axis down, to the side and down: turns by a right angle about y are among
    them, which x and z then share. Two that are moved by 6 and 5 leave the axis 1 beside the film.
    """
    breaks = [
        ((0, 0, 45, 0), -40),
        ((0, 0, -45, 0), 40),
        ((0, 0, 0, -45), -60),
        ((0, -6, 45, 0), 55),
        ((0, 5, 0, -45), -40),
    ]
    lines = ["MODE SEQ", "UNIT MM", "ENPD 4", "SURF 0", "TYPE STANDARD", "DISZ INFINITY"]
    lines += ["SURF 1", "STOP", "TYPE STANDARD", "DISZ 30", "DIAM 2"]
    for (x, y, about_x, about_y), way in breaks:
        for move, thickness in (((x, y), 0), ((0, 0), way)):
            values = (*move, about_x, about_y, 0, 0)
            lines += [
                "SURF 2",
                "TYPE COORDBRK",
                *(f"PARM {k + 1} {v}" for k, v in enumerate(values)),
                f"DISZ {thickness}",
            ]
            if thickness == 0:
                lines += ["SURF 3", "TYPE STANDARD", "GLAS MIRROR 0 0", "DIAM 40", "DISZ 0"]
    for curvature, thickness in ((-1 / 60, -5), (1 / 60, -55)):
        glass = ["GLAS N-BK7 0 0"] if thickness == -5 else []
        lines += ["SURF 4", "TYPE STANDARD", f"CURV {curvature!r}", f"DISZ {thickness}", *glass, "DIAM 11"]
    path = tmp_path / "folded.zmx"
    path.write_text("\n".join([*lines, "SURF 5", "TYPE STANDARD", ""]))
    lens = load_lens(path)
    mirrors = replace(lens, surfaces=lens.surfaces[:-2], stop_index=0)
    rays = mirrors.trace([[0, 0, -10], [0.5, 0.25, -10]], [[0, 0, 1], [0, 0, 1]], start="scene")
    np.testing.assert_allclose(rays.directions, [[0, 0, -1]] * 2, atol=1e-12)
    np.testing.assert_allclose(rays.origins[0, :2], [0, 1], atol=1e-12)
    np.testing.assert_allclose(rays.origins[1, :2] - [0, 1], [0.5, 0.25], atol=1e-12)  # local axes follow mirrors
    assert lens.trace([[0, 0, -10]], [[0, 0, 1]], start="scene").passed.all()


OFF_AXIS = """\
MODE SEQ
UNIT MM
ENPD 50.8
SURF 0
  CURV 0
  DISZ INFINITY
SURF 1
  STOP
  CURV 0
  DISZ 200
  DIAM 25.4
SURF 2
  TYPE COORDBRK
  PARM 2 -190.6
  DISZ 0
SURF 3
  CURV -0.0052465897166841559
  CONI -1
  DISZ -95.3
  GLAS MIRROR 0 0 1.5 40
  DIAM 25.4
  CLAP 0 25.4 0
  OBDC 0 190.6
SURF 4
  CURV 0
  SCBD 1 0 0 0 0 {tilt} 0 0
  DISZ 0
"""


@pytest.mark.parametrize("tilt", [90, -90])
def test_an_image_tilted_in_its_own_line_is_met_at_a_right_angle(tmp_path, tilt):
    """An off-axis paraboloid turns light by 90 degrees, all of it to the focus."""
    path = tmp_path / "off_axis.zmx"
    path.write_text(OFF_AXIS.format(tilt=tilt))
    lens = load_lens(path)
    x, y = (part.ravel() for part in np.meshgrid(*[np.linspace(-17, 17, 9)] * 2))
    rays = lens.trace(np.stack([x, y, 0 * x], axis=1), np.tile([0.0, 0.0, 1.0], (81, 1)), 550.0, "scene")
    assert rays.passed.all()
    film_z = lens.film_z(95.3)
    steps = (film_z - rays.origins[:, 2]) / rays.directions[:, 2]
    np.testing.assert_allclose((rays.origins + steps[:, None] * rays.directions)[:, :2], 0, atol=1e-10)
    np.testing.assert_allclose(rays.directions[40], [0, 0, lens.sense], atol=1e-12)
    assert steps[40] == pytest.approx(190.6)  # p / (1 + cos 90 degrees), p the radius at the vertex
    wave = pupil_function(lens, 95.3, wavelength_nm=550.0, across=40)
    assert rms_waves(wave, wave.waves_on_sphere) < 1e-6
    assert any("52 % of the light on the axis" in note for note in lens.warnings)
    drawn = next(bundles(setting(lens), View(fields=[0.0], rays=3), reference))
    line = drawn.line(setting(lens), 1)
    np.testing.assert_allclose((line[1] - line[0])[:2] / np.linalg.norm(line[1] - line[0]), [0, -1], atol=1e-12)
