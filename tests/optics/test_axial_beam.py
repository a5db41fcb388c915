"""Irradiance on the axis from kept polynomials: that of the quadrature, in every state of the film and the stop."""

import numpy as np
import pytest

from rptcam_cl.optics import irradiance
from rptcam_cl.optics.irradiance import disk_irradiance, on_axis_irradiance
from rptcam_cl.optics.lens import film_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.surface import blades

NM = 587.56


@pytest.mark.parametrize("name", ["dgauss-50mm", "double-gauss-50mm-f1.1", "fisheye-10mm", "zoom-70-200mm", "biconvex"])
def test_irradiance_of_a_disk_is_that_of_the_quadrature(name: str) -> None:
    lens = load_lens(name)
    for stop, away in ((1.0, 1.0), (0.6, 1.02), (0.17, 1.1)):
        state = lens if lens.stop is None else lens.with_stop_diameter(2 * stop * lens.stop.semi_diameter)
        film_distance_mm = away * film_distance(lens, np.inf)
        found = disk_irradiance(state, film_distance_mm, NM)
        assert found == pytest.approx(
            on_axis_irradiance(state, film_distance_mm, NM), rel=1e-8
        )  # its bisection ends at 2e-9


def test_nothing_is_traced_again_for_another_stop_or_film(monkeypatch: pytest.MonkeyPatch) -> None:
    lens, film_distance_mm = load_lens("dgauss-50mm"), 32.0
    disk_irradiance(lens.with_stop_diameter(8.4), film_distance_mm, NM)
    monkeypatch.setattr(irradiance, "_trace_beam", None)  # whatever traces again fails
    state = lens.with_stop_diameter(8.3)
    assert disk_irradiance(state, 32.1, NM) == pytest.approx(on_axis_irradiance(state, 32.1, NM), rel=1e-8)


@pytest.mark.parametrize("name", ["mirror-500mm", "anamorphic-100mm", "shaped"])
def test_pupils_that_are_no_disk_are_refused(name: str) -> None:
    lens = load_lens("dgauss-50mm").with_stop_shape(blades(6)) if name == "shaped" else load_lens(name)
    assert disk_irradiance(lens, film_distance(lens, np.inf), NM) is None
