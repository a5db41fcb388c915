"""Lenses with mirrors: first-order data and exact rays against closed forms, rings, and what a file may say."""

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.beams import Beam, shift_to_least_spot
from rptcam_cl.optics.best_focus import best_film_distance
from rptcam_cl.optics.irradiance import lens_info, on_axis_irradiance, t_number
from rptcam_cl.optics.lens import film_distance, object_distance, thick_lens_of
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import COATED, Status, passing
from rptcam_cl.rendering.cameras.ray_map import ray_map

N_BK7 = 1.5168000345


def lens(*rows, **more):
    return load_lens({"name": "mirrors", "surfaces": list(rows), **more})


PARABOLOID = lens({"radius": -200, "conic": -1, "mirror": True, "diameter": 150})


def cassegrain(primary, secondary, separation, back, conics=(-1.0, None), obstruction=None):
    """Two mirrors, with what the second one obstructs where it is given; `back` is from that to the focus."""
    magnification = back / (primary / 2 - separation)
    classical = -(((magnification + 1) / (magnification - 1)) ** 2)
    front = [] if obstruction is None else [{"thickness": separation, "diameter": 200, "inner_diameter": obstruction}]
    return lens(
        *front,
        {"radius": -primary, "conic": conics[0], "mirror": True, "thickness": -separation, "diameter": 100,
         "inner_diameter": 30},
        {"radius": -secondary, "conic": conics[1] if conics[1] is not None else classical, "mirror": True,
         "diameter": 40},
    )  # fmt: skip


# f1 = 200, separation 140, magnification 4: the secondary 60 before the primary's focus images it 240 behind itself.
CASSEGRAIN = cassegrain(400.0, 160.0, 140.0, 240.0)
BEAM = np.linspace(16, 49, 34)


def axial(heights, z=-500.0):
    zero = np.zeros_like(heights)
    return np.column_stack([zero, heights, zero + z]), np.tile([0.0, 0.0, 1.0], (len(heights), 1))


def crossing(rays):
    """Return z where meridional rays cross the axis."""
    return rays.origins[:, 2] - rays.origins[:, 1] * rays.directions[:, 2] / rays.directions[:, 1]


def test_concave_mirror_has_half_its_radius_as_focal_length():
    data = PARABOLOID.first_order()
    assert data.focal_length_mm == pytest.approx(100.0, abs=1e-12)
    assert data.back_focal_distance_mm == pytest.approx(100.0, abs=1e-12)
    assert data.front_focal_distance_mm == pytest.approx(-100.0, abs=1e-12)
    assert PARABOLOID.film_z(100.0) == -100.0


def test_paraboloid_is_stigmatic_for_infinity():
    rays = PARABOLOID.trace(*axial(np.linspace(1, 74, 80)), start="scene")
    assert rays.passed.all()
    np.testing.assert_allclose(crossing(rays), -100.0, atol=1e-12)
    assert np.all(rays.directions[:, 2] < 0)
    np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=1), 1.0, atol=1e-15)


def test_optical_path_to_the_focus_of_a_paraboloid_is_the_same_for_every_ray():
    rays = PARABOLOID.trace(*axial(np.linspace(1, 74, 80)), start="scene")
    to_focus = np.linalg.norm(rays.origins - [0.0, 0.0, -100.0], axis=1)
    np.testing.assert_allclose(rays.optical_path + to_focus, 600.0, atol=1e-11)


def test_ellipsoid_images_one_focus_into_the_other():
    near, far = 60.0, 300.0
    radius, eccentricity = 2 * near * far / (near + far), (far - near) / (far + near)
    mirror = lens({"radius": -radius, "conic": -(eccentricity**2), "mirror": True, "diameter": 60})
    heights = np.linspace(1, 29, 20)
    through = np.column_stack([0 * heights, heights, 0 * heights])
    source = np.array([0.0, 0.0, -far])
    rays = mirror.trace(np.tile(source, (20, 1)), through - source, start="scene")
    np.testing.assert_allclose(crossing(rays), -near, atol=1e-12)


def test_sphere_reflects_rays_of_its_centre_back_to_it():
    mirror = lens({"radius": -80, "mirror": True, "diameter": 120})
    heights = np.linspace(-55, 55, 40)
    toward = np.column_stack([0 * heights, heights, 0 * heights])
    source = np.array([0.0, 0.0, -80.0])
    rays = mirror.trace(np.tile(source, (40, 1)), toward - source, start="scene")
    assert rays.passed.all()
    np.testing.assert_allclose(np.sum(rays.directions * (rays.origins - source), axis=1), -80.0, atol=1e-12)


def test_classical_cassegrain_is_stigmatic_at_the_focus_of_its_formula():
    data = CASSEGRAIN.first_order()
    assert data.focal_length_mm == pytest.approx(800.0, abs=1e-10)
    assert data.back_focal_distance_mm == pytest.approx(240.0, abs=1e-10)
    rays = CASSEGRAIN.trace(*axial(BEAM), start="scene")
    assert rays.passed.all()
    np.testing.assert_allclose(crossing(rays), -140.0 + 240.0, atol=1e-10)


def ritchey_chretien():
    """Conics without spherical aberration and coma of the third order (Wilson, Reflecting Telescope Optics I)."""
    magnification, behind = 4.0, 240.0 / 140.0
    first = -1.0 - 2.0 * behind / magnification**3
    second = -1.0 - 2.0 * (magnification * (2 * magnification - 1) + behind) / (magnification - 1) ** 3
    return cassegrain(400.0, 160.0, 140.0, 240.0, (first, second))


def coma(system):
    """Return the coma of a beam at 0.2 degrees: how far the mean of both its rims lies from that of inner rays [mm]."""

    def at(height):
        opened = system.trace(*Beam(0.2).rays(np.array([[0.0, height], [0.0, -height]])), start="scene")
        step = (system.film_z(240.0) - opened.origins[:, 2]) / opened.directions[:, 2]
        return opened.origins[:, 1] + step * opened.directions[:, 1]

    return at(45.0).mean() - at(18.0).mean()


def test_ritchey_chretien_has_no_coma_where_the_classical_form_has():
    assert abs(coma(ritchey_chretien())) < 0.02 * abs(coma(CASSEGRAIN))


def test_rays_sent_back_from_the_film_return():
    rays = CASSEGRAIN.trace(*axial(BEAM), start="scene")
    back = CASSEGRAIN.trace(rays.origins + 300 * rays.directions, -rays.directions, start="film")
    assert back.passed.all()
    np.testing.assert_allclose(back.directions, -axial(BEAM)[1], atol=1e-14)
    np.testing.assert_allclose(back.origins[:, 1], BEAM, atol=1e-11)
    assert passing(CASSEGRAIN, rays.origins + 300 * rays.directions, -rays.directions).all()


def test_rays_that_travel_the_wrong_way_miss():
    rays = PARABOLOID.trace([[0.0, 10.0, -50.0]], [[0.0, 0.0, -1.0]], start="scene")
    assert rays.status[0] == Status.missed
    rays = PARABOLOID.trace([[0.0, 10.0, -50.0]], [[0.0, 0.0, -1.0]], start="film")
    assert rays.status[0] == Status.missed


def test_a_hole_and_an_obstruction_clip():
    rays = CASSEGRAIN.trace(*axial(np.array([14.9, 15.1])), start="scene")
    assert rays.status.tolist() == [Status.clipped, Status.ok]
    assert rays.surface.tolist() == [0, -1]
    ring = cassegrain(400.0, 160.0, 140.0, 240.0, obstruction=42.0)
    rays = ring.trace(*axial(np.array([20.9, 21.1])), start="scene")
    assert (rays.status.tolist(), rays.surface.tolist()) == ([Status.clipped, Status.ok], [0, -1])


def test_ring_passes_the_light_of_its_area():
    full = cassegrain(400.0, 160.0, 140.0, 240.0, obstruction=30.0)
    ring = cassegrain(400.0, 160.0, 140.0, 240.0, obstruction=60.0)
    share = on_axis_irradiance(ring, 240.0) / on_axis_irradiance(full, 240.0)
    assert share == pytest.approx((50**2 - 30**2) / (50**2 - 15**2), rel=1e-3)
    assert t_number(ring, 240.0) == pytest.approx(8.0 / np.sqrt(1 - 0.36), rel=2e-3)


def test_thickness_of_a_mangin_mirror_counts_on_both_ways():
    """A lens and a mirror of the same glass unfolded: twice the lens, and a mirror of n / R between them."""
    rows = [
        {"radius": -150, "thickness": 8, "glass": {"index": 1.5}, "diameter": 60},
        {"radius": -220, "thickness": -8, "mirror": True, "diameter": 60},
        {"radius": -150, "diameter": 60},
    ]
    surface = np.array([[1, 0], [-(1 / -150) * 0.5, 1]])
    gap, mirror = np.array([[1, 8 / 1.5], [0, 1]]), np.array([[1, 0], [2 * 1.5 / -220, 1]])
    back = np.array([[1, 0], [-(1 / 150) * -0.5, 1]])
    matrix = back @ gap @ mirror @ gap @ surface
    data = lens(*rows).first_order()
    assert data.focal_length_mm == pytest.approx(-1 / matrix[1, 0], rel=1e-13)
    assert data.back_focal_distance_mm == pytest.approx(-matrix[0, 0] / matrix[1, 0], rel=1e-13)
    ray = lens(*rows).trace([[0, 1e-4, 0]], [[0, 0, 1]], start="scene")
    assert -crossing(ray)[0] == pytest.approx(data.back_focal_distance_mm, rel=1e-7)


@pytest.mark.parametrize("system", [PARABOLOID, CASSEGRAIN], ids=["film before the mirror", "film behind"])
def test_focus_distances_are_those_of_rays(system):
    back = film_distance(system, 5000.0)
    assert object_distance(system, back) == pytest.approx(5000.0, rel=1e-12)
    front = 5000.0 - system.film_z(back)
    height = 1e-3 if system is PARABOLOID else 15.5
    opened = system.trace([[0, 0, -front]], [[0, height, front]], start="scene")
    assert crossing(opened)[0] == pytest.approx(system.film_z(back), abs=1e-6 if system is PARABOLOID else 0.5)


@pytest.mark.parametrize("system", [PARABOLOID, CASSEGRAIN], ids=["disk", "ring"])
def test_least_spot_of_zones_is_that_of_a_grid_of_rays(system):
    best = best_film_distance(system, 5000.0)
    beam = Beam(0.0, 5000.0 - system.film_z(best))
    assert abs(shift_to_least_spot(system, best, beam)) < 5e-3
    assert shift_to_least_spot(system, best + 0.1, beam) == pytest.approx(-0.1, abs=5e-3)


def test_info_of_a_mirror_lens_has_every_number():
    info = lens_info(cassegrain(400.0, 160.0, 140.0, 240.0, obstruction=42.0))
    assert info["focal_length_mm"] == pytest.approx(800.0)
    assert info["f_number"] == pytest.approx(8.0)
    assert info["t_number"] > info["working_f_number"] == pytest.approx(8.0)
    assert info["image_circle_mm"] > 0


def test_a_mirror_reflects_the_share_that_it_says():
    silvered = lens(
        {"radius": -200, "thickness": -60, "mirror": True, "diameter": 60, "coating": {"reflectance": 0.95}},
        {"radius": -150, "mirror": True, "diameter": 60, "coating": {"reflectance": 0.5}},
    )
    rays = silvered.trace([[0, 3, -300]], [[0, 0, 1]], start="scene", transmission=COATED)
    assert rays.transmittance[0] == pytest.approx(0.475, rel=1e-12)
    assert lens_info(silvered, transmission=COATED)["axial_transmittance"] == pytest.approx(0.475, rel=1e-12)


MIRROR = {"radius": -200, "mirror": True, "diameter": 60}
WRONG = {
    "glass behind a mirror": ([{**MIRROR, "thickness": -9, "glass": "N-BK7"}, {"diameter": 60}],
                              "surfaces[0].glass: a mirror sends light back into the medium it comes from"),
    "thickness through a mirror": ([{**MIRROR, "thickness": 9}, {"diameter": 60}],
                                   "surfaces[0].thickness: the mirror sends light to -z"),
    "thickness after two mirrors": ([{**MIRROR, "thickness": -9}, {**MIRROR, "thickness": -9}, {"diameter": 60}],
                                    "surfaces[1].thickness: the mirror sends light to +z"),
    "hole as large as the rim": ([{**MIRROR, "inner_diameter": 60}],
                                 "surfaces[0].inner_diameter: must be less than the diameter 60"),
    "layer on a mirror": ([{**MIRROR, "coating": "mgf2"}], "a mirror takes its reflectance alone"),
    "half a mirror": ([{**MIRROR, "clear": {"half_plane_degrees": 0}, "outside": "pass"}],
                      "surfaces[0].outside: nothing passes beside a mirror"),
    "not a truth value": ([{**MIRROR, "mirror": "yes"}], "surfaces[0].mirror: expected true or false"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_a_mirror_is_refused_with_its_place(name):
    rows, text = WRONG[name]
    with pytest.raises(InputError) as error:
        lens(*rows)
    assert text in str(error.value)


def test_a_mirror_that_stands_in_the_light_is_told():
    rows = [{**MIRROR, "thickness": -60}, {"radius": -150, "mirror": True, "diameter": 20}]
    assert any("surface 1: this mirror stands in the light" in text for text in lens(*rows).warnings)
    rows[0]["inner_diameter"] = 20
    assert not lens(*rows).warnings


def test_models_of_a_full_pupil_refuse_a_ring():
    ring = cassegrain(400.0, 160.0, 140.0, 240.0, obstruction=42.0)
    with pytest.raises(InputError, match="its pupil is a ring"):
        thick_lens_of(ring, 240.0, 587.56)
    with pytest.raises(InputError, match="has mirrors or a ring"):
        ray_map(ring, 240.0, (18.0, 12.0), 587.56, 100.0, (1e6,))


# Rays by ray-optics 0.9.8: x, y in the plane of the first vertex, angle towards +y [degrees], then point and direction
# the last surface. The prescriptions are those of its test files mangin.seq and rc_f16.seq.
MANGIN = [
    {"radius": -1200, "thickness": 10, "glass": "N-BK7", "diameter": 240},
    {"radius": -1000, "thickness": -10, "mirror": True, "diameter": 240},
    {"radius": -1200, "diameter": 240},
]
TELESCOPE = [
    {"radius": -21335.137, "thickness": -7490.46, "mirror": True, "conic": -1.0961, "diameter": 7924.8},
    {"radius": -9576.712, "mirror": True, "conic": -5.1628, "diameter": 3000},
]
TRACED = [
    (MANGIN, 555.0, 0.0, 60.0, 0.0, (0.0, 59.16514918803047, -1.4594353458210563),
     (0.0, -0.13098083101735933, -0.9913849009875039)),
    (MANGIN, 555.0, 20.0, 45.0, 0.3, (19.71874733424573, 44.42885147493292, -0.9848840985420972),
     (-0.04369935677656016, -0.09314957608678961, -0.9946926775100772)),
    (TELESCOPE, 550.0, 0.0, 2000.0, 0.0, (0.0, 598.0194074080911, -18.596548781128803),
     (0.0, -0.06308671785069657, 0.9980080490811816)),
    (TELESCOPE, 550.0, 700.0, 1500.0, 0.3, (209.10165127466004, 487.37776247528814, -14.63804129157419),
     (-0.022100413562796024, -0.03398383220171855, 0.9991779975906385)),
]  # fmt: skip


@pytest.mark.parametrize(("rows", "wavelength", "x", "y", "angle", "point", "direction"), TRACED)
def test_rays_are_those_of_ray_optics(rows, wavelength, x, y, angle, point, direction):
    system = lens(*rows)
    rays = system.trace([[x, y, 0]], [[0, np.tan(np.radians(angle)), 1]], wavelength, start="scene")
    np.testing.assert_allclose(rays.origins[0] - [0, 0, system.length], point, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(rays.directions[0], direction, atol=1e-13)


def test_focal_lengths_are_those_of_ray_optics():
    mangin, telescope = lens(*MANGIN).first_order(555.0), lens(*TELESCOPE).first_order(550.0)
    assert mangin.focal_length_mm == pytest.approx(457.1217083117136, rel=1e-12)  # it calls it negative, as z is there
    assert mangin.back_focal_distance_mm == pytest.approx(450.5539648880832, rel=1e-12)
    assert telescope.focal_length_mm == pytest.approx(31702.215601505046, rel=1e-12)
    assert telescope.back_focal_distance_mm == pytest.approx(9441.83097173215, rel=1e-12)
