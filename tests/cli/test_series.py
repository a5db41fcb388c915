"""Ellipses in the values of a sweep."""

import pytest

from rptcam_cl.cli.frames import F_NUMBERS, expand_ellipsis
from rptcam_cl.core.errors import InputError


@pytest.mark.parametrize(
    ("key", "values", "wanted"),
    [
        ("camera.f_number", [2, 2.8, "…", 22], [2, 2.8, 4, 5.6, 8, 11, 16, 22]),
        ("camera.f_number", [2, "...", 8], [2, 2.8, 4, 5.6, 8]),
        ("camera.f_number", [2, 2.4, "…", 5.6], [2, 2.4, 2.8, 3.3, 4, 4.8, 5.6]),
        ("camera.f_number", [2, 2.2, "…", 4, 16], [2, 2.2, 2.5, 2.8, 3.2, 3.5, 4, 16]),
        ("camera.f_number", [8, 5.6, "…", 2], [8, 5.6, 4, 2.8, 2]),
        ("camera.focus.distance_m", [1, 1.5, "…", 3], [1, 1.5, 2, 2.5, 3]),
        ("render.seed", [0, 2, "...", 8], [0, 2, 4, 6, 8]),
        ("camera.lens", ["a", "b"], ["a", "b"]),
    ],
)
def test_ellipsis_goes_on_as_the_values_began(key, values, wanted):
    assert expand_ellipsis(key, values, "--over") == wanted


@pytest.mark.parametrize(
    ("key", "values", "match"),
    [
        ("camera.f_number", [2, 2.9, "…", 22], "no series of full, half or third stops"),
        ("camera.f_number", [2, 2.8, "…", 23], "no series of full"),
        ("camera.f_number", ["…", 22], "between numbers"),
        ("camera.f_number", [2, "…"], "between numbers"),
        ("camera.lens", ["a", "…", "b"], "between numbers"),
        ("film.width_mm", [1, 2, "…", 4, "…", 8], "between numbers"),
        ("film.width_mm", [1, "…", 4], "no series of equal steps"),
        ("film.width_mm", [1, 1.5, "…", 2.3], "no series of equal steps"),
        ("film.width_mm", [3, 2, "…", 5], "no series of equal steps"),
        ("film.width_mm", [1, 1, "…", 5], "no series of equal steps"),
    ],
)
def test_what_makes_no_series_is_refused(key, values, match):
    with pytest.raises(InputError, match=match):
        expand_ellipsis(key, values, "--over")


def test_scales_are_stops_apart():
    for scale, stop in zip(F_NUMBERS, (1, 1 / 2, 1 / 3), strict=True):
        exact = [2 ** (round(k) * stop / 2 + (-1 if scale[0] == 0.5 else 0)) for k in range(len(scale))]
        assert all(abs(nominal / value - 1) < 0.06 for nominal, value in zip(scale, exact, strict=True))
