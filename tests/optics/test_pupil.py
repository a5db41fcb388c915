"""Outlines of the exit pupil; that nothing which passes lies outside is tested with the renderer's tables."""

import numpy as np
import pytest

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.film_probe import FilmProbe
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.pupils import pupil_shapes


def test_nodes_end_where_the_light_does():
    shapes = pupil_shapes(load_lens("fisheye-10mm"), 23.192, (25.0, 25.0))
    assert shapes.reach[0] == pytest.approx(13.45, abs=0.3)  # the image circle of the sources


def test_film_in_front_of_the_last_surface_is_an_error():
    with pytest.raises(InputError, match="film must stand behind"):
        pupil_shapes(load_lens("dgauss-50mm"), -1.0, (18.0, 12.0))


def test_outlines_of_a_pupil_much_smaller_than_the_rear_element_are_found():
    lens = load_lens("phone-5.6mm")  # 0.17 mm of 6.8 mm
    film = lens.first_order().back_focal_distance_mm
    shapes = pupil_shapes(lens, film, (2.8, 2.1))
    assert np.all(shapes.axes > 0.07) and np.all(shapes.axes < 0.1)
    probe = FilmProbe(lens, film, LINE_D_NM)
    points = np.stack([np.linspace(0, shapes.reach[0], 41)[:-1], np.zeros(40)], axis=1)
    assert np.all(probe.passes(points, shapes.centres[0, :-1]))
    assert not np.any(probe.passes(points, shapes.centres[0, :-1] + [0.0, 0.15]))
