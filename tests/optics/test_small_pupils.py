"""Pupils too small for a grid over the rear window: every lens at every stop has its light."""

from itertools import pairwise

import numpy as np
import pytest

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.beams import Beam, chief_ray, passing_beam, passing_steep_beam, steep_chief_ray
from rptcam_cl.optics.film_probe import FilmProbe
from rptcam_cl.optics.irradiance import film_irradiance, lens_info
from rptcam_cl.optics.lens import film_distance
from rptcam_cl.optics.library import list_lenses, load_lens
from rptcam_cl.optics.pupils import pupil_shapes
from tests.support.cases import one_in, slow

STOPS = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0]
# of light, to that of first-order optics, where the pupil is so small that only its real place off it counts
CLOSE = 0.01


def behind_glass(name, distance_mm=0.5, thickness_mm=2.0, diameter_mm=43.3):
    """A bundled lens with a sensor's cover glass so near to the film that the beam is a thread there."""
    lens = load_lens(name)
    path = film_distance(lens, np.inf)
    rows = [
        {
            "radius": float(np.inf) if surface.curvature == 0 else 1 / surface.curvature,
            "thickness": surface.thickness,
            "glass": {"index": float(surface.glass.index(LINE_D_NM))},
            "diameter": 2 * surface.semi_diameter,
            "stop": k == lens.stop_index,
        }
        for k, surface in enumerate(lens.surfaces)
    ]
    for row in rows:
        if np.isinf(row["radius"]):
            del row["radius"]
        if row["glass"]["index"] == 1.0:
            del row["glass"]
        if not row["stop"]:
            del row["stop"]
    rows[-1]["thickness"] = path - distance_mm - thickness_mm / 1.5168
    cover = [
        {"thickness": thickness_mm, "glass": {"index": 1.5168}, "diameter": diameter_mm},
        {"diameter": diameter_mm},
    ]
    return load_lens({"name": f"{name} behind glass", "surfaces": rows + cover})


def closed(lens, f_number):
    return lens.with_stop_diameter(lens.stop_diameter_for(f_number))


def paraxial(lens, back):
    """pi sin^2 of the angle that the exit pupil subtends, times the square of the image space's index."""
    pupil = lens.first_order().exit_pupil
    tangent = pupil.diameter_mm / 2 / (back - pupil.distance_mm)
    ends = lens.indices()[[0, -1]]
    return np.pi * tangent**2 / (1 + tangent**2) * (ends[1] / ends[0]) ** 2


def distance_of(lens):
    try:
        return film_distance(lens, np.inf)
    except InputError:
        return 80.0


def lights(lens, back):
    widest = lens.first_order().f_number
    return {f: float(film_irradiance(closed(lens, f), back, 0.0)) for f in STOPS if f > widest}


def is_full(lens):
    """Whether the middle of the pupil passes: a stop that is closed into a ring's hole leaves no light."""
    return not any(surface.inner_semi_diameter for surface in lens.surfaces)


def stopped_lenses():
    lenses = {name: load_lens(name) for name in list_lenses()}
    return [name for name, lens in lenses.items() if lens.stop is not None and lens.is_rotational and is_full(lens)]


@pytest.mark.parametrize("name", one_in(18, stopped_lenses()))
def test_a_lens_stopped_down_has_the_light_of_first_order_optics(name):
    lens = load_lens(name)
    back = distance_of(lens)
    found = lights(lens, back)
    for f_number, value in found.items():
        if f_number >= 64:
            assert value == pytest.approx(paraxial(closed(lens, f_number), back), rel=CLOSE)
    # the light falls with every stop that is closed, unless a rim limits it before
    values = list(found.values())
    assert all(b < a * 1.001 for a, b in pairwise(values))


@pytest.mark.parametrize("name", [slow("dgauss-50mm"), slow("biotar-58mm"), slow("telephoto-250mm")])
def test_a_cover_glass_before_the_film_takes_no_light(name):
    bare, covered = load_lens(name), behind_glass(name)
    for f_number, value in lights(bare, film_distance(bare, np.inf)).items():
        if f_number >= 4:  # wider open, the plate's spherical aberration shifts the rim that limits the beam
            again = float(film_irradiance(closed(covered, f_number), film_distance(covered, np.inf), 0.0))
            assert again == pytest.approx(value, rel=0.01)


@pytest.mark.parametrize("f_number", [slow(2.8), 8.0, slow(16.0), 128.0])
def test_light_off_the_axis_is_found_behind_a_cover_glass(f_number):
    bare, covered = load_lens("dgauss-50mm"), behind_glass("dgauss-50mm")
    field = [3.0, 9.0]
    before = film_irradiance(closed(bare, f_number), film_distance(bare, np.inf), field)
    after = film_irradiance(closed(covered, f_number), film_distance(covered, np.inf), field)
    np.testing.assert_allclose(after, before, rtol=0.03)


@pytest.mark.slow
def test_the_facts_of_the_phone_lens_at_f_16():
    facts = lens_info(load_lens("phone-5.6mm"), f_number=16.0)
    assert facts["t_number"] == pytest.approx(16.0, rel=0.02)
    assert facts["image_circle_mm"] > 5.0


# A strong meniscus far before its stop: it sees more than a half space.
MENISCUS = {
    "name": "meniscus",
    "surfaces": [
        {"radius": 45, "thickness": 3, "glass": {"index": 1.8}, "diameter": 89},
        {"radius": 12, "thickness": 16, "diameter": 23.7},
        {"stop": True, "diameter": 2},
    ],
}


@pytest.mark.parametrize("field", [40.0, 60.0, 70.0])
def test_both_ways_of_spreading_a_beam_give_the_same_chief_ray(field):
    lens = load_lens("fisheye-10mm")
    _, plane = chief_ray(lens, field)
    _, across = steep_chief_ray(lens, field, lens.stop_index, LINE_D_NM)
    assert plane.passed[0]
    assert across.passed[0]
    assert across.surface[0] == -1
    np.testing.assert_allclose(across.origins, plane.origins, atol=1e-9)
    np.testing.assert_allclose(across.directions, plane.directions, atol=1e-10)


def test_both_ways_give_the_same_beam():
    lens = load_lens("fisheye-10mm")
    _, plane, cell = passing_beam(lens, Beam(70.0), LINE_D_NM, 200)
    _, across, cell_across = passing_steep_beam(lens, 70.0, LINE_D_NM, 200)
    # area of the beam in the plane of the first vertex, and across
    assert len(across.origins) * cell_across == pytest.approx(
        len(plane.origins) * cell * np.cos(np.radians(70.0)), rel=0.02
    )
    np.testing.assert_allclose(across.origins.mean(axis=0), plane.origins.mean(axis=0), atol=2e-3)


def test_light_from_behind_goes_the_way_of_rays_traced_from_the_film_side():
    lens = load_lens(MENISCUS)
    tilts = np.radians([20.0, 35.0, 48.0, 53.0])
    out = np.column_stack([np.zeros(4), -np.sin(tilts), -np.cos(tilts)])
    rays = lens.trace([[0.0, 0.0, lens.length + 1e-9]], out, LINE_D_NM)
    assert rays.passed.all()
    fields = np.degrees(np.arctan2(-rays.directions[:, 1], -rays.directions[:, 2]))
    assert fields.max() > 92
    for field, direction in zip(fields.tolist(), out, strict=True):
        _, forward = steep_chief_ray(lens, field, 2, LINE_D_NM)
        assert forward.passed[0]
        np.testing.assert_allclose(forward.origins[0], [0, 0, lens.length], atol=1e-5)
        np.testing.assert_allclose(forward.directions[0], -direction, atol=1e-6)


@pytest.mark.slow
def test_a_small_pupil_behind_a_wide_front_is_found():
    lens = load_lens(MENISCUS)
    closed = lens.with_stop_diameter(0.5)
    for field in (0.0, 50.0, 92.0):
        points, _, cell = passing_beam(closed, Beam(field), LINE_D_NM, 64)
        wide, _, wide_cell = passing_beam(lens, Beam(field), LINE_D_NM, 64)
        assert len(points) * cell == pytest.approx(len(wide) * wide_cell / 16, rel=0.06)


def test_steep_light_that_no_plane_of_objects_sends_is_refused():
    lens = load_lens(MENISCUS)
    with pytest.raises(InputError, match="does not reach there"):
        passing_beam(lens, Beam(92.0, 1000.0), LINE_D_NM, 32)
    with pytest.raises(InputError, match="spherical"):
        passing_beam(load_lens("biconcave"), Beam(92.0), LINE_D_NM, 32)


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
