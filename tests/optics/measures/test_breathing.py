"""Breathing against closed forms of first-order optics."""

import math

import pytest

from rptcam_cl.optics.lens import in_configuration
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import UNCOATED, axial_transmittance
from rptcam_cl.rendering.cameras.chief_rays import breathing_csv, breathing_table

NM = 587.5618


def test_field_of_view_goes_by_magnification_and_entrance_pupil():
    lens = load_lens("dgauss-50mm")
    rows = breathing_table([("", lens)], (math.inf, 2.0, 0.6), 36.0, NM)
    first = lens.first_order(NM)
    assert rows[0]["field_of_view_degrees"] == pytest.approx(
        2 * math.degrees(math.atan(18 / first.focal_length_mm)), rel=1e-9
    )
    for row, distance in zip(rows[1:], (2000.0, 600.0), strict=True):
        ahead = distance - lens.length - row["film_distance_mm"]  # of the first vertex; Newton: m = f / x
        magnification = first.focal_length_mm / (ahead + first.front_focal_distance_mm)
        assert row["magnification"] == pytest.approx(magnification, rel=1e-9)
        tangent = 18 / magnification / (ahead + first.entrance_pupil.distance_mm)
        assert row["field_of_view_degrees"] == pytest.approx(2 * math.degrees(math.atan(tangent)), rel=1e-9)
        shares = tangent / (18 / first.focal_length_mm)
        assert row["breathing_percent"] == pytest.approx(100 * (shares - 1), rel=1e-7)


def test_t_number_is_the_f_number_with_the_losses_of_the_axis():
    lens = load_lens("dgauss-50mm").with_stop_diameter(5.0)
    (row,) = breathing_table([("", lens)], (math.inf,), 36.0, NM, UNCOATED)
    passed = float(axial_transmittance(lens, NM, UNCOATED))
    assert row["t_number"] == pytest.approx(row["working_f_number"] / math.sqrt(passed), rel=2e-3)


def test_every_zoom_position_has_its_rows():
    lens = load_lens("zoom-35-51mm")
    positions = [(each.name, in_configuration(lens, each.name)) for each in lens.configurations]
    rows = breathing_table(positions, (math.inf, 3.0), 36.0, NM)
    assert [row["zoom"] for row in rows] == [name for name, _ in positions for _ in range(2)]
    lines = breathing_csv(rows).splitlines()
    assert len(lines) == 1 + len(rows)
    assert lines[0].startswith("zoom,focus_distance_m,focal_length_mm")
    assert lines[1].split(",")[1] == ""
