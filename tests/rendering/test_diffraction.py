"""Diffraction of films: kernels against closed forms, films in which nothing rings, and a rendered edge."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.special import j0, j1

import rptcam_cl
from benchmarks import edges
from rptcam_cl.core.colour import LUMINANCE
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.optics.beams import Beam
from rptcam_cl.optics.lens import film_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.waves import AIRY, pupil_function, transfer
from rptcam_cl.rendering import diffraction, point_spread, point_waves
from rptcam_cl.rendering.cameras.film_pupil import film_points
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.lens_records import shaped
from rptcam_cl.rendering.diffraction import (
    LOST_CONTRAST,
    SEEN_STAR,
    FilmOpenings,
    describe_film,
    diffraction_of,
    dirt_edges,
    edges_of,
    spread_of,
    star_light,
)
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.lamp_images import FilmLamp, LampImage, brightness, lines_of, without_lamps
from rptcam_cl.rendering.lamps import aimed_plan
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.point_spread import (
    FarLight,
    blur,
    map_of_outlines,
    near_kernel,
    of_wavelength,
    shares_of_white,
    strew,
)
from rptcam_cl.rendering.point_waves import (
    ACROSS,
    conjugates_in,
    finer_opening,
    kernel_of_waves,
    point_wave,
    ray_picture,
    rough_opening,
    stigmatic,
    wave_picture,
)
from rptcam_cl.scene.lens_settings import Dirt
from rptcam_cl.scene.load import load_scene
from tests.rendering.pictures import scene_of
from tests.support.cases import slow

WAVES_NM, SHARES = np.array(point_spread.WAVES_NM), shares_of_white(point_spread.WAVES_NM)
POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
THIN = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 16, "focus_distance_m": 1000, **POSE}


def found_of(width_mm: float = 0.2, resolution: tuple[int, int] = (64, 48), **camera):
    film = {"width_mm": width_mm}
    scene = scene_of([], {**THIN, "diffraction": "on", **camera}, film=film, resolution=resolution)
    return diffraction_of(load_scene(scene))


@cache
def found_at_22():
    """Diffraction by a round opening that many pixels show."""
    return found_of(f_number=22, width_mm=0.3, resolution=(96, 96))


def perfect_mtf(share):
    inside = np.minimum(share, 1.0)
    return 2 / np.pi * (np.arccos(inside) - inside * np.sqrt(1 - inside**2))


@pytest.mark.parametrize("f_number", [16, slow(32)])
def test_kernel_of_a_round_opening_has_the_transfer_of_its_wavelengths(f_number):
    found, pixel = found_of(f_number=f_number), 0.2 / 64
    assert found.airy_radius_px == pytest.approx(1.22 * 550e-6 * f_number / pixel, rel=0.01)
    middle = near_kernel(found.openings.pupils(np.zeros(2)), (pixel, pixel), 200)
    np.testing.assert_allclose(middle.sum(axis=(1, 2)), 1.0, rtol=1e-12)
    assert middle.min() >= 0
    places = np.arange(-200, 201) * pixel
    for plane, shares in zip(middle, SHARES.T, strict=True):
        for frequency in (20, 40, 80):
            exact = shares @ perfect_mtf(frequency * WAVES_NM * 1e-6 * f_number)
            got = [abs(np.sum(plane.sum(axis=axis) * np.exp(2j * np.pi * frequency * places))) for axis in (0, 1)]
            assert got == pytest.approx([exact, exact], abs=0.01)  # the reach leaves out 0.5 % of the light


@pytest.mark.parametrize("pixel_mm", [0.0055, 0.008, 0.012, slow(0.02), 0.05, slow(0.16), slow(0.24), 0.28, slow(0.5)])
def test_kernel_of_wide_pixels_has_the_transfer_of_its_wavelengths_once(pixel_mm):
    """The film of the rays has been averaged over pixels already: of lines of four pixels a kernel keeps all."""
    pupil = found_of(f_number=16).openings.pupils(np.zeros(2), 72)
    reach = point_spread.reach_px(point_spread.unit_px(pupil, (pixel_mm, pixel_mm)), 10_000, point_spread.NEAR)
    kernel, places = near_kernel(pupil, (pixel_mm, pixel_mm), reach), np.arange(-reach, reach + 1)
    assert kernel.min() >= 0
    for across, up in ((0.05, 0.0), (0.15, 0.0), (0.25, 0.0), (0.0, 0.25), (0.2, 0.2), (0.35, 0.0)):
        exact = perfect_mtf(np.hypot(across, up) / pixel_mm * WAVES_NM * 1e-6 * 16) @ SHARES
        turned = np.exp(2j * np.pi * (across * places + up * places[:, None]))
        assert np.abs((kernel * turned).sum(axis=(1, 2))) == pytest.approx(exact, abs=0.012), (across, up)


@pytest.mark.parametrize("pixel_mm", [slow(0.06), slow(0.14), 1.0])
def test_a_pixel_much_larger_than_the_airy_disk_keeps_its_light(pixel_mm):
    found = found_of(width_mm=64 * pixel_mm, f_number=2)
    _, kernels = found.spread.kernels
    plane = kernels[len(kernels) // 2][1]
    v = np.pi * pixel_mm / 2 / (WAVES_NM * 1e-6 * 2)  # to the rim of the largest circle in a pixel
    inside = SHARES[:, 1] @ (1 - j0(v) ** 2 - j1(v) ** 2)
    assert plane[len(plane) // 2, len(plane) // 2] > inside - 0.005  # some of a copy of the image is left
    assert plane.sum() + found.spread._shares[1] == pytest.approx(1)


def test_spikes_stand_across_the_blades_and_keep_their_handedness():
    # Corners at 10, 130 and 250 degrees: edges across 70, 190 and 310, spikes both ways from each.
    found = found_of(aperture={"shape": "polygon", "blades": 3, "rotation_degrees": 10}, resolution=(64, 2))
    _, kernels = found.spread.kernels
    plane = kernels[len(kernels) // 2][1]
    reach = len(plane) // 2
    down, right = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    radius, angle = np.hypot(down, right), np.degrees(np.arctan2(-down, right)) % 180
    ring = (radius > 0.2 * reach) & (radius < 0.7 * reach)  # of 20 wavelengths times f-number
    light = np.bincount((angle[ring] // 2).astype(int), (plane * radius**2)[ring], minlength=90)
    light /= np.bincount((angle[ring] // 2).astype(int), minlength=90)
    spikes = {10, 70, 130}
    brightest = 2 * np.argsort(light)[-3:] + 1.0
    assert all(min(abs(spike - at) for at in brightest) <= 2 for spike in spikes), brightest


def test_light_of_a_lamp_is_where_its_closed_form_has_it_and_comes_back_from_no_border():
    found = found_at_22()
    assert found.spread.edges is not None
    film = np.full((96, 96, 3), 1e-3, np.float32)
    film[48, 48] = 1e9
    spread = found.over(film)[0].astype(float)
    assert spread.min() > 0
    down, right = np.mgrid[:96, :96] - 48
    radii = np.array([12.5, 20.5, 30.5, 46.5])  # of circles [pixels]: 3 to 12 wavelengths times f-number
    inside = [spread[np.hypot(down, right) < radius].sum(axis=0) / 1e9 for radius in radii]
    v = np.pi * radii[:, None] * (0.3 / 96) / (WAVES_NM * 1e-6 * 22.0)
    np.testing.assert_allclose(inside, (1 - j0(v) ** 2 - j1(v) ** 2) @ SHARES, atol=0.003)
    film[48, 48], film[0, 48] = 1e-3, 1e9
    border = found.over(film)[0][:8, 48, 1].astype(float)
    np.testing.assert_allclose(border[1:], spread[49:56, 48, 1], rtol=1e-3)


def test_even_light_stays_even_and_lamps_lose_what_leaves_the_picture():
    random = np.random.default_rng(3)
    kernels = [part / part.sum(axis=(1, 2), keepdims=True) for part in random.random((4, 3, 5, 5))]
    nodes = (np.array([0.0, 30.0]), np.array([0.0, 20.0]))
    film, none = random.random((3, 21, 31)), np.zeros((3, 21, 31))
    np.testing.assert_allclose(blur(np.ones_like(film), none, (0, 0), nodes, kernels), 1.0, rtol=1e-12)
    whole = blur(film, none, (0, 0), nodes, kernels)
    crop = blur(film[:, 5:, 6:], none[:, 5:, 6:], (6, 5), nodes, kernels)
    np.testing.assert_allclose(crop[:, 2:, 2:], whole[:, 7:, 8:], rtol=1e-12)  # beyond the reach of the crop's border
    lamp = none.copy()
    lamp[:, 10, 15] = lamp[:, 0, 0] = 1e9
    spread = blur(lamp, lamp, (0, 0), nodes, kernels)
    inside = 1e9 * (1.0 + kernels[0][:, 2:, 2:].sum(axis=(1, 2)))  # nothing comes back from the border
    assert spread.sum(axis=(1, 2)) == pytest.approx(inside, rel=1e-12)


def test_auto_takes_it_where_the_airy_radius_shows():
    sharp, soft = found_of(width_mm=36, diffraction="auto"), found_of(width_mm=1, diffraction="auto")
    assert not sharp.is_on and sharp.lost_contrast < LOST_CONTRAST < soft.lost_contrast and soft.is_on
    for each in (sharp, soft):
        cycles_over_limit = each.airy_radius_px / AIRY / 2
        assert each.lost_contrast == pytest.approx(1 - perfect_mtf(cycles_over_limit), abs=0.005)
    assert "0.69 px" in soft.metadata["says"]
    film = np.ones((48, 64, 3), np.float32)
    assert sharp.over(film)[0] is film
    assert found_of(diffraction="off") is None
    pinhole = load_scene(scene_of([], {"kind": "pinhole", "fov_degrees": 40, "diffraction": "auto", **POSE}))
    assert diffraction_of(pinhole).metadata["on"] is False


def test_auto_takes_it_where_stars_of_lamps_show():
    """On pixels of 0.56 mm; a round opening has unit / (pi^3 d^3) of a point's light in a pixel at a distance d."""
    found, film = found_of(width_mm=36, diffraction="auto"), np.ones((48, 64, 3), np.float32)
    unit, places = found.airy_radius_px / AIRY, ([24], [32])
    seen = SEEN_STAR * 27 * np.pi**3 / unit  # of a pixel
    film[places] = 0.9 * seen
    same, said = found.over(film)
    assert same is film and not said["on"] and said["star_over_mean"] == pytest.approx(0.027, rel=1e-6)
    film[places] = 1.1 * seen
    spread, said = found.over(film)
    says = describe_film({"diffraction": found.metadata}, said)["diffraction"]["says"]
    assert said["on"] and "3 pixels from a lamp its light is 0.033 of the mean" in says
    assert spread[24, 35, 1] - 1 == pytest.approx(0.033, rel=0.05)  # in bands and in square pixels
    beside = np.array([[67.0, 24.5, *3 * [1.1 * seen], 0, 0, -1]])
    assert star_light(np.ones_like(film), unit, beside, FilmLayout.of(found.scene.film)) == pytest.approx(0.033)


def test_light_that_falls_beside_the_film_is_told():
    found, film = found_at_22(), np.zeros((96, 96, 3), np.float32)
    film[48, 48] = 1.0
    spread, said = found.over(film)
    assert said["share_beside"] == pytest.approx(1 - spread.sum(dtype=float) / 3, abs=1e-5)
    film[48, 48], film[0, 48] = 0.0, 1.0  # half of it
    assert found.over(film)[1]["share_beside"] == pytest.approx(1 - found.over(film)[0].sum(dtype=float) / 3, abs=1e-5)
    says = describe_film({"diffraction": found.metadata}, said)["diffraction"]["says"]
    assert says.endswith(f"{said['share_beside']:.2g} of the light falls beside the film")
    assert "beside" not in describe_film({"diffraction": found.metadata}, {"share_beside": 9e-4})["diffraction"]["says"]


@pytest.mark.parametrize(
    ("lens", "f_number"), [slow("dgauss-50mm", 64.0), ("dgauss-50mm", 128.0), ("fisheye-10mm", 90.0)]
)
def test_openings_far_smaller_than_the_rear_of_the_lens_are_found(lens: str, f_number: float) -> None:
    camera = {"kind": "realistic", "lens": lens, "f_number": f_number, "focus": {"distance_m": 1000}, **POSE}
    scene = scene_of([], {**camera, "diffraction": "auto"}, film={"width_mm": 2}, resolution=(64, 48))
    found = diffraction_of(load_scene(scene))
    assert found.is_on
    assert found.airy_radius_px == pytest.approx(1.22 * 550e-6 * f_number / (2 / 64), rel=0.005)


@pytest.mark.parametrize(
    "camera",
    [
        {"kind": "pinhole", "fov_degrees": 40},
        {"kind": "environment"},
        {"kind": "thin_lens", "fov_degrees": 40, "aperture_radius_m": 0, "focus_distance_m": 3},
    ],
)
def test_a_camera_without_an_opening_is_refused(camera):
    with pytest.raises(InputError, match=r"camera\.diffraction: needs an opening"):
        load_scene(scene_of([], {**camera, "diffraction": "on", **POSE}, resolution=(32, 16)))


def test_an_afocal_lens_is_refused():
    rows = [{"thickness": 5, "diameter": 20, "glass": {"index": 1.5}}, {"thickness": 5, "diameter": 20},
            {"thickness": 1, "diameter": 10, "stop": True}, {"diameter": 20}]  # fmt: skip
    window = {"kind": "realistic", "lens": {"name": "window", "surfaces": rows}, "focus": {"film_distance_mm": 30}}
    scene = scene_of([], {**window, "diffraction": "on", **POSE}, resolution=(32, 16))
    with pytest.raises(InputError, match=r"camera\.diffraction: window: is afocal, so it forms no image"):
        diffraction_of(load_scene(scene))
    scene["camera"]["diffraction"] = "auto"
    assert diffraction_of(load_scene(scene)).is_on is False


def edge_scene(diffraction: str, pixels: int = 48):
    """A lamp with a slanted edge 1 km away, through a double Gauss at f/16 on pixels of 2.5 micrometres."""
    back = film_distance(load_lens("dgauss-50mm").with_stop_diameter(2), 1e6)
    camera = {"kind": "realistic", "lens": "dgauss-50mm", "f_number": 16, "focus": {"film_distance_mm": back}, **POSE}
    slope = float(np.radians(5.0))
    lamp = {
        "shape": "rectangle", "corner": [5 * np.sin(slope), -5 * np.cos(slope), -1000.0],
        "edge_u": [10 * np.cos(slope), 10 * np.sin(slope), 0.0],
        "edge_v": [-10 * np.sin(slope), 10 * np.cos(slope), 0.0],
        "material": {"kind": "emissive", "radiance": 1.0},
    }  # fmt: skip
    return scene_of([lamp], {**camera, "diffraction": diffraction}, depth=1, film={"width_mm": 0.0025 * pixels},
                    resolution=(pixels, pixels), spectrum="rgb")  # fmt: skip


@pytest.fixture(scope="module")
def edge():
    return rptcam_cl.render(edge_scene("on"), spp=256, layers=["direct"])


def test_layer_direct_is_the_film_without_diffraction_and_without_aberrations(edge):
    off = rptcam_cl.render(edge_scene("off"), spp=256)
    assert np.abs(off.pixels - edge["direct"]).max() < 0.03  # at f/16, along the edge alone
    assert (off.pixels == edge["direct"]).mean() > 0.95
    assert off.pixels.sum() == pytest.approx(edge["direct"].sum(), rel=1e-3)
    assert "diffraction" not in off.metadata and off.metadata["scene_hash"] == edge.metadata["scene_hash"]
    assert edge.metadata["diffraction"]["on"]


def test_rendered_edge_has_the_transfer_of_the_waves(edge):
    lens = load_lens("dgauss-50mm")
    lens = lens.with_stop_diameter(lens.stop_diameter_for(16.0))
    back = film_distance(load_lens("dgauss-50mm").with_stop_diameter(2), 1e6)
    frequencies = np.array([20.0, 40.0, 60.0])
    found = edge_transfer(edge.pixels[..., 1].astype(float), 0.12 / 48, frequencies)
    waves = [transfer(pupil_function(lens, back, Beam(), nm, 96), frequencies)[1] for nm in WAVES_NM[::2]]
    shares = SHARES[::2, 1]
    exact = np.abs(np.tensordot(shares / shares.sum(), waves, 1)) * np.sinc(frequencies * 0.12 / 48)
    np.testing.assert_allclose(found, exact, atol=0.03)
    bare = edge_transfer(edge["direct"][..., 1].astype(float), 0.12 / 48, frequencies)
    assert bare[-1] > exact[-1] + 0.3


FULL_FRAME, FINE = {"width_mm": 36}, (14400, 9600)


def lens_scene(lens, f_number, objects=(), resolution=(3600, 2400), distance_m=1000.0, **keys):
    camera = {"kind": "realistic", "lens": lens, "f_number": f_number, "focus": {"distance_m": distance_m},
              "diffraction": "on", **POSE}  # fmt: skip
    return scene_of(list(objects), camera, depth=1, film=FULL_FRAME, resolution=resolution, **keys)


@pytest.mark.parametrize(
    ("lens", "f_number"),
    [("dgauss-50mm", 8.0), slow("wide-22mm", 11.0),
     slow("telephoto-250mm", 8.0)],
)  # fmt: skip
def test_kernels_of_a_lens_have_the_transfer_of_its_waves_off_the_axis(lens, f_number):
    """The pupil function of `optics.waves` is traced from the scene through other code."""
    scene = load_scene(lens_scene(lens, f_number, resolution=FINE, spectrum={"mode": "dispersive", "lens": "on"}))
    found, setting = diffraction_of(scene), camera_of(scene).setting
    openings, pixel, reach = replace(found.openings, order=(3, 2)), 36 / FINE[0], 80
    conjugates, node = openings.conjugates, 1  # above the middle
    places = np.array([[conjugates.columns[node], conjugates.rows[0]]])
    wave = conjugates.waves_at(places[0], openings.points[node], openings.seen[node], splits=True)
    kernel = kernel_of_waves(wave, (-pixel, pixel), reach)[1]
    there = conjugates.at(places)[0]
    front_m = setting.lens.film_z(setting.film_distance_mm) * 1e-3
    ahead = -there[2] / there[3] - front_m
    degrees = float(np.degrees(np.arctan(there[1] / there[3] / ahead)))
    beam, frequencies = Beam(abs(degrees), ahead * 1e3), np.array([10.0, 20.0, 40.0, 80.0])
    turned = np.exp(-2j * np.pi * np.outer(frequencies, np.arange(-reach, reach + 1) * pixel))
    for axis in (0, 1):
        waves = [transfer(pupil_function(setting.lens, setting.film_distance_mm, beam, nm, 96), frequencies)[axis]
                 for nm in WAVES_NM[::2]]  # fmt: skip
        shares = SHARES[::2, 1]
        exact = np.abs(np.tensordot(shares / shares.sum(), waves, 1))
        np.testing.assert_allclose(np.abs(turned @ kernel.sum(axis=1 - axis)), exact, atol=0.015)


def test_waves_of_mirrored_places_are_those_that_are_traced_there():
    scene = load_scene(lens_scene("dgauss-50mm", 5.6, resolution=FINE))
    found = replace(diffraction_of(scene).openings, order=(3, 2))
    conjugates, places = found.conjugates, np.array([[2000.0, 1500.0], [12400.0, 1500.0], [2000.0, 8100.0]])
    for place, point in zip(places, film_points(scene, places)[:, :2], strict=True):
        pupil = found.pupils(point, 72)
        mirrored = conjugates.wave_at(place, point, pupil, 550.0)
        traced = point_wave(found.pupils, pupil, point, conjugates.source(place), 550.0)
        lit = pupil.coverage > 0
        off = (mirrored.path_mm - traced.path_mm)[lit]
        assert np.ptp(off) < 0.01 * 550e-6  # of a wave
        np.testing.assert_allclose(mirrored.places[lit], traced.places[lit], atol=1e-5)
        np.testing.assert_allclose(mirrored.density[lit] / mirrored.density[lit].mean(),
                                   traced.density[lit] / traced.density[lit].mean(), rtol=1e-3)  # fmt: skip
    assert len(conjugates._rays) == 1  # of all three


@pytest.mark.slow
def test_waves_bring_the_aberrations_of_what_is_in_focus_alone():
    """Kernels of waves are those of the plane of focus: a wave out of it they are 0.5 off at f/5.6, and rays 0.2."""
    scene = lens_scene("dgauss-50mm", 5.6, distance_m=2.0, resolution=FINE)
    wall = {"shape": "rectangle", "edge_v": [0, 2, 0], "material": {"kind": "matte", "reflectance": 0.5}}
    radius, film_m, nm = 0.05036 / 5.6 / 2, 0.068, 587.56e-9  # of the entrance pupil; of the film before it, about
    vergence = 1 / (2.0 - film_m) - 0.4 * 2 * nm / radius**2  # 0.4 waves behind the plane of focus
    depths = [2.0 - 1e-3, 1 / vergence + film_m, 3.0]
    sides = zip((-1.2, -0.2, 0.2), (1.0, 0.4, 1.0), depths, strict=True)
    scene["objects"] = [wall | {"corner": [x, -1, -depth], "edge_u": [wide, 0, 0]} for x, wide, depth in sides]
    loaded = load_scene(scene)
    plan, found = make_plan(loaded), diffraction_of(loaded)
    session = Session(choose_device())
    aimed, _ = aimed_plan(plan, session, (), None, found.conjugates)
    shares = conjugates_in(aimed, found.conjugates).shares[ACROSS // 2]
    left, middle, right = shares[4], shares[ACROSS // 2], shares[-5]
    assert (left, right) == pytest.approx((1.0, 0.0), abs=1e-5) and middle == pytest.approx(0.4, abs=0.13)


@pytest.mark.slow
@pytest.mark.parametrize("flip", [True, slow(False)])
def test_rays_go_to_the_conjugates_of_their_film_points(monkeypatch, flip):
    """A small lamp at the conjugate of a place lights that place alone, and through the lens itself others too."""
    monkeypatch.setattr(FilmOpenings, "enough", property(lambda few: few))  # rays and lamp go by the same nodes
    scene = lens_scene("dgauss-50mm", 5.6, distance_m=2.0, spectrum="rgb", resolution=FINE)
    scene["film"] |= {"crop": [1600 / 14400, 1624 / 14400, 1200 / 9600, 1224 / 9600]}
    scene["camera"]["flip"] = flip
    conjugates = diffraction_of(load_scene(scene)).conjugates
    there = conjugates.at(np.array([[1612.5, 1212.5]]))[0]
    assert np.linalg.norm(there[:3]) > 0.9  # all of the aberrations
    lamp = {"shape": "sphere", "center": (there[:3] / there[3]).tolist(), "radius": 2.5e-5,
            "material": {"kind": "emissive", "radiance": 1e4}}  # fmt: skip
    wall = {"shape": "rectangle", "corner": [-5.0, -5.0, float(there[2] / there[3])], "edge_u": [10.0, 0, 0],
            "edge_v": [0, 10.0, 0], "material": {"kind": "matte", "reflectance": 0.0}}  # fmt: skip
    scene["objects"] = [lamp, wall]  # so that what is about the lamp is in focus
    film = rptcam_cl.render(scene, spp=64, layers=["direct"])["direct"].sum(axis=2)
    assert film[12, 12] > 0.999 * film.sum() > 0
    scene["camera"]["diffraction"] = "off"
    assert rptcam_cl.render(scene, spp=64).pixels.sum(axis=2)[12, 12] < 0.9 * film.sum()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lens", "f_number", "degrees"),
    [("dgauss-50mm", 2.8, 12.0), ("dgauss-50mm", 8.0, 9.0), ("tessar-100mm", 11.0, 4.0)],
)
@pytest.mark.parametrize("along", [False, True])
def test_rendered_edges_off_the_axis_have_the_transfer_of_the_waves(monkeypatch, lens, f_number, degrees, along):
    if f_number < 4:  # a window of 96 pixels cuts light that counts 0.025 at 20 cycles/mm
        monkeypatch.setattr(edges, "WINDOW_PX", 192)
    found, exact = edges.errors(lens, f_number, degrees, along)
    np.testing.assert_allclose(found, exact, atol=0.025)


@pytest.mark.parametrize(
    "more",
    [
        {"camera": {"movements": {"rise_mm": 2}}},
        {"camera": {"lens": "plano-convex-100mm", "f_number": 4}},  # too far off for waves at every node
    ],
)
def test_what_has_no_conjugates_keeps_the_rays_of_the_lens(more):
    scene = lens_scene("dgauss-50mm", 8.0, resolution=(36, 24))
    scene["camera"] |= more["camera"]
    found = diffraction_of(load_scene(scene))
    assert found.is_on and found.conjugates is None


def edge_transfer(film, pixel_mm, frequencies):
    """Modulation across a nearly upright edge (slanted-edge method): by the derivative of its profile."""
    rows, columns = np.mgrid[: len(film), : len(film)]
    slope = np.tan(np.radians(5.0))
    across = ((columns - 23.5) - (23.5 - rows) * -slope) * np.cos(np.radians(5.0))
    inside = np.abs(across) < 18
    bins = np.round((across[inside] + 18) * 2).astype(int)
    profile = np.bincount(bins, film[inside]) / np.bincount(bins)
    line = -np.diff(profile)
    places = np.arange(len(line)) * pixel_mm / 2
    turned = np.exp(-2j * np.pi * np.outer(frequencies, places))
    return np.abs(turned @ line) / abs(line.sum()) / np.sinc(frequencies * pixel_mm / 2) ** 2


@pytest.mark.slow
def test_resumed_render_has_the_same_bits(tmp_path):
    small = edge_scene("on", 12)
    whole = rptcam_cl.render(small, spp=4)
    state = tmp_path / "edge.state"
    rptcam_cl.render(small, spp=2, checkpoint=state, resume=True)
    np.testing.assert_array_equal(rptcam_cl.render(small, spp=4, checkpoint=state, resume=True), whole)


def test_parts_are_merged_with_the_diffraction_of_the_whole(tmp_path):
    small = edge_scene("on", 12)
    whole = rptcam_cl.render(small, spp=2, layers=["direct"])
    parts = [tmp_path / "1.rpck", tmp_path / "2.rpck"]
    for number, path in enumerate(parts, 1):
        rptcam_cl.render(small, spp=2, layers=["direct"], part=f"{number}/2", checkpoint=path)
    merged = rptcam_cl.merge(parts)
    np.testing.assert_array_equal(merged, whole)
    np.testing.assert_array_equal(merged["direct"], whole["direct"])
    assert merged.metadata["diffraction"] == whole.metadata["diffraction"]
    assert not np.array_equal(merged, whole["direct"])


@pytest.mark.slow
@pytest.mark.parametrize("radiance", [slow(1e5), 5.0])
def test_parts_whose_film_decides_are_merged_as_the_whole(tmp_path, radiance):
    lamp = {"shape": "sphere", "center": [0, 0, -10], "radius": 0.003, "material": {"kind": "emissive"}}
    lamp["material"]["radiance"] = radiance
    scene = scene_of([lamp], AT_10_M | {"f_number": 8, "diffraction": "auto"}, depth=1, film={"width_mm": 16 * 0.03},
                     resolution=(16, 12)) | {"environment": {"kind": "constant", "radiance": 1.0}}  # fmt: skip
    whole, parts = rptcam_cl.render(scene, spp=4, layers=["direct"]), [tmp_path / "1.rpck", tmp_path / "2.rpck"]
    for number, path in enumerate(parts, 1):
        rptcam_cl.render(scene, spp=4, layers=["direct"], part=f"{number}/2", checkpoint=path)
    merged, shows = rptcam_cl.merge(parts), radiance > 10
    np.testing.assert_array_equal(merged, whole)
    assert merged.metadata["diffraction"] == whole.metadata["diffraction"]
    assert merged.metadata["diffraction"]["on"] == shows
    assert np.array_equal(whole, whole["direct"]) != shows


@pytest.mark.parametrize("blades", [5, slow(6)])
def test_spikes_are_one_for_each_direction_across_a_blade_and_grow_with_the_wavelength(blades):
    found = found_of(f_number=22, aperture={"shape": "polygon", "blades": blades})
    pupil, pixel, reach = found.openings.pupils(np.zeros(2)), 0.2 / 64, 220
    down, right = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    radius, angle = np.hypot(down, right), np.degrees(np.arctan2(-down, right)) % 360
    ring = (radius > 60) & (radius < 200)
    places, lengths = (angle[ring] // 2).astype(int), []
    for nm in (450.0, 600.0):
        light = of_wavelength(pupil, (pixel, pixel), reach, nm)
        around = np.bincount(places, (light * radius**3)[ring]) / np.bincount(places)
        peaks = (around > np.roll(around, 1)) & (around >= np.roll(around, -1)) & (around > 4 * np.median(around))
        assert peaks.sum() == (2 * blades if blades % 2 else blades)
        along = np.bincount(np.rint(radius).astype(int).ravel(), light.ravel())[:reach]
        lengths.append(np.interp(0.97, np.cumsum(along), np.arange(reach)))  # holds 97 % of the light
    assert lengths[1] / lengths[0] == pytest.approx(600 / 450, rel=0.02)


def far_light(edges):
    return FarLight(edges, 1.0, (0.02, 0.02), 20)


def ngon(corners, radius=0.03, turn_degrees=7.0):
    angles = np.radians(turn_degrees) + 2 * np.pi * np.arange(corners) / corners
    return edges_of(radius * np.stack([np.cos(angles), np.sin(angles)], axis=1))


@cache
def light_of(corners):
    return far_light(ngon(corners))


def test_far_light_of_a_round_opening_is_that_of_its_closed_form():
    radii, found = light_of(512).within
    total = found.sum(axis=0)
    for rho in (64.0, 200.0, 500.0):  # 1 - J0^2 - J1^2 of pi rho, without its ripples
        expected = 2 / np.pi**2 * (1 / radii[0] - 1 / rho)
        assert np.interp(rho, radii, total) == pytest.approx(expected, rel=0.01)
    assert found[:, -1] == pytest.approx(found[:, -1].mean(), rel=0.03)  # the same all around


def test_far_light_of_each_pixel_falls_where_its_kernel_says():
    rng = np.random.default_rng(8)
    planes, light = rng.random((3, 4, 6)), rng.random((3, 9, 15))
    expected = np.zeros_like(planes)
    for row, column in np.ndindex(4, 6):  # the middle of the kernel on the pixel
        part = light[:, 4 - row : 8 - row, 7 - column : 13 - column]
        expected += planes[:, row, column, None, None] * part
    np.testing.assert_allclose(strew(planes, light), expected, rtol=1e-12)


def test_light_of_no_lamp_is_strewn_as_its_kernels_have_it():
    """By pixels near by and by squares beyond; lamps keep kernels of all pixels."""
    found = found_of(3.6, (200, 120), aperture={"shape": "polygon", "blades": 6})
    film, spread = np.random.default_rng(3).uniform(0.5, 1.5, (120, 200, 3)).astype(np.float32), found.spread
    film[40:80, 60:140], film[:10] = 3.0, 0.05
    even = np.full(film.shape, 0.7, np.float32)
    np.testing.assert_allclose(found.over(even)[0], even, rtol=1e-4)
    shown, planes = (np.moveaxis(each.astype(float), -1, 0) for each in (found.over(film)[0], film))
    around = spread._shares[:, None, None] - strew(np.ones_like(planes), spread.far)
    mean = planes.mean(axis=(1, 2))[:, None, None]
    exact = blur(planes, np.zeros_like(planes), (0, 0), *spread.kernels) + strew(planes, spread.far) + around * mean
    inside = np.s_[:, 24:-24, 24:-24]  # at the border the nearest pixels of what lies beside are as bright as it
    off, far = np.abs(shown - exact)[inside], strew(planes, spread.far)[inside]
    assert off.max() < 0.02 * far.max() and off.mean() < 0.006 * far.mean()


def test_far_light_that_falls_beside_the_film_is_what_its_kernel_lacks():
    round_opening = light_of(512)
    shares, kernel_sum = round_opening.shares, round_opening.kernel(150, 150).sum(axis=(1, 2))
    unit = [sum(w * round_opening.unit_px(nm) for nm, w in zip(WAVES_NM, row, strict=True)) for row in SHARES.T]
    beyond = 2 / np.pi**2 * np.array(unit) / 150 * 0.9  # of a square of 299 pixels: its mean 1 / distance is 0.9 / half
    assert shares - kernel_sum == pytest.approx(beyond, rel=0.03)


@pytest.mark.parametrize("blades", [slow(5), 6])
def test_far_spikes_stand_across_blades_and_are_one_for_each_direction(blades):
    star = light_of(blades).kernel(160, 160)[1]
    down, right = np.mgrid[-159:160, -159:160]
    radius, angle = np.hypot(down, right), np.degrees(np.arctan2(down, right)) % 360
    ring = (radius > 60) & (radius < 150)
    around = np.bincount(angle[ring].astype(int), star[ring], minlength=360)
    left, right = np.roll(around, 1), np.roll(around, -1)
    peaks = np.flatnonzero((around >= left) & (around > right) & (left + around + right > around.sum() / 40))
    towards = (7 + 180 / blades + 360 / blades * np.arange(blades)) % 360
    expected = np.unique(np.round(np.concatenate([towards, (towards + 180) % 360]), 6))
    assert len(expected) == (2 * blades if blades % 2 else blades)
    assert peaks + 0.5 == pytest.approx(expected, abs=1.0)


def test_far_light_grows_with_the_wavelength():
    red, green, blue = light_of(6).shares  # a share falls as 1 / radius over wavelength
    means = [sum(nm * share for nm, share in zip(WAVES_NM, row, strict=True)) for row in SHARES.T]
    assert red / green == pytest.approx(means[0] / means[1], rel=0.02)
    assert blue / green == pytest.approx(means[2] / means[1], rel=0.02)


def light_by_direction(image, x, y, ring, degrees=4):
    """Light of a ring about the middle, by directions over half a turn; y upwards."""
    radius, angle = np.hypot(x, y[:, None]), np.degrees(np.arctan2(y[:, None], x)) % 180
    lit = (radius > ring[0]) & (radius < ring[1])
    return np.bincount((angle[lit] // degrees).astype(int), image[lit], 180 // degrees)


def test_an_opening_drawn_out_has_the_star_of_one_that_is_drawn_out():
    by, places = np.array([[0.85, -0.1], [-0.05, 0.95]]), (np.arange(-60.0, 61.0), np.arange(-40.0, 41.0))
    corners = ngon(6)[:, :2]
    outline = np.concatenate([corners + k / 64 * (np.roll(corners, -1, axis=0) - corners) for k in range(64)])
    outline = outline[np.argsort(np.arctan2(*outline.T[::-1]))]
    found, off = map_of_outlines(outline, 0.01 + outline @ by.T)
    assert found == pytest.approx(by, abs=1e-3) and off < 1e-3
    assert map_of_outlines(outline, ngon(7)[:, :2])[1] > 0.01
    hexagon, own = light_of(6), far_light(edges_of(corners @ by.T))
    expected = own.at(own.table(80.0), *places)[1]
    away = np.hypot(places[0], places[1][:, None])
    lit = (away > 25) & (away < 75)
    shown = hexagon.at(hexagon.table(80.0), *places, by)[1]
    assert np.abs(shown - expected)[lit].sum() < 0.05 * expected[lit].sum()
    straight = hexagon.at(hexagon.table(80.0), *places)[1]
    assert np.abs(straight - expected)[lit].sum() > 0.5 * expected[lit].sum()


@pytest.mark.slow
@pytest.mark.parametrize(("f_number", "own_openings", "ring"), [(16.0, 0, (55, 140)), (2.8, 1, (16, 40))])
def test_a_lamp_in_the_corner_has_the_star_of_its_own_opening(f_number, own_openings, ring):
    """Its rays are traced forwards; what passes is an opening, and its Fourier transform the star."""
    side, cells, across = 2 * ring[1], 2048, 512
    lamp = {"shape": "sphere", "center": [3.3, 1.75, -10], "radius": 1e-5,
            "material": {"kind": "emissive", "radiance": 1e6}}  # fmt: skip
    data = lens_scene("dgauss-50mm", f_number, [lamp], (9000, 6000), 10.0)
    data["camera"]["aperture"] = {"shape": "polygon", "blades": 6, "rotation_degrees": 10}
    film = {"width_mm": 36, "resolution": [9000, 6000]}
    scene = load_scene(data | {"film": film | {"crop": [0.9, 0.9 + side / 9000, 0.1, 0.1 + side / 6000]}})
    found = diffraction_of(scene)
    spread = replace(found, plan=make_plan(scene), openings=replace(found.openings, order=(1, 1))).spread
    (star,) = spread.lamps
    assert len(spread.outlines) == own_openings == star.opening
    layout = FilmLayout(9000, 6000, 8100, 600, side, side)
    own = spread._star(star, (8100.0 + ring[1], 600.0 + ring[1]), 0.0, 0.0, spread.reach, layout)[1]
    from_middle = np.arange(side) + 0.5 - ring[1]
    shown = light_by_direction(own, from_middle, -from_middle, ring)

    setting = shaped(scene, camera_of(scene).setting)
    source = np.array([3300.0, 1750.0, -10000.0 + setting.lens.film_z(setting.film_distance_mm)])

    def forwards(points):
        ways = np.column_stack([points, np.full(len(points), -1.0)]) - source
        return setting.lens.trace(np.tile(source, (len(ways), 1)), ways, 550.0, "scene")

    grid = 25 * np.stack(np.meshgrid(*2 * [np.linspace(-1, 1, 60)]), axis=-1).reshape(-1, 2)
    middle, turns = grid[forwards(grid).passed].mean(axis=0), 2 * np.pi * np.arange(512) / 512
    towards, near, far = np.stack([np.cos(turns), np.sin(turns)], axis=1), np.zeros(512), np.full(512, 40.0)
    for _ in range(20):
        half = (near + far) / 2
        inside = forwards(middle + half[:, None] * towards).passed
        near, far = np.where(inside, half, near), np.where(inside, far, half)
    rim = forwards(middle + near[:, None] * towards).directions[:, :2]
    rim -= (rim.max(axis=0) + rim.min(axis=0)) / 2
    order, step = np.argsort(np.arctan2(*rim.T[::-1])), 1.02 * np.ptp(rim, axis=0).max() / (2 * across)
    fine = (np.arange(2 * across) + 0.5 - across) * step
    reaches = np.interp(np.arctan2(fine[:, None], fine), np.arctan2(*rim[order].T[::-1]), np.hypot(*rim[order].T),
                        period=2 * np.pi)  # fmt: skip
    mask = (np.hypot(fine, fine[:, None]) < reaches).reshape(across, 2, across, 2).mean(axis=(1, 3))
    light = np.fft.fftshift(np.abs(np.fft.fft2(mask, (cells, cells))) ** 2) / mask.sum() / cells**2
    per_mm = (np.arange(cells) - cells // 2) / (cells * 2 * step)  # times the wavelength, on the film
    exact = sum(share * light_by_direction(light, *2 * [per_mm * nm * 1e-6 / 0.004], ring)
                for nm, share in zip(WAVES_NM, SHARES[:, 1], strict=True))  # fmt: skip
    assert np.abs(shown - exact).sum() < 0.07 * exact.sum()
    of_middle = replace(star, opening=0, own=np.eye(2))  # that of the film's middle
    of_middle = spread._star(of_middle, (8100.0 + ring[1], 600.0 + ring[1]), 0.0, 0.0, spread.reach, layout)[1]
    assert np.abs(light_by_direction(of_middle, from_middle, -from_middle, ring) - exact).sum() > 0.6 * exact.sum()


def test_spikes_of_lines_are_dashed_and_those_of_white_light_are_not():
    """Along an axis of a square the light is sinc^2 of the place times side over wavelength."""
    corners, nm, pixel = 0.03 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]), 589.0, 0.002
    laser = FarLight(edges_of(corners), 1.0, (pixel, pixel), 20, 512, np.array([[nm, 1.0, 1.0, 1.0]]))
    places, within = np.arange(24.0, 80.0), (np.arange(32) + 0.5) / 32 - 0.5
    per_pixel = 0.06 / (nm * 1e-6) * pixel
    exact = (np.sinc((places[:, None] + within) * per_pixel) ** 2).mean(axis=1)
    exact *= (np.sinc(within * per_pixel) ** 2).mean() * per_pixel**2
    by_lines, white = (light.at(light.table(90.0), places, np.zeros(1))[1, 0] for light in
                       (laser, replace(laser, lines=None)))  # fmt: skip
    assert np.abs(by_lines - exact).sum() < 0.15 * exact.sum()
    assert np.corrcoef(by_lines, exact)[0, 1] > 0.98
    assert np.corrcoef(white, exact)[0, 1] < 0.8


@pytest.mark.slow
def test_a_white_lamp_beside_one_of_sodium_has_its_own_star():
    found = found_of(0.4, (128, 96), aperture={"shape": "polygon", "blades": 6})
    white = FilmLamp((4.5, 4.5), 0.5, 0.0, np.zeros((0, 5)))
    sodium = replace(white, lines=np.array([[589.0, 1.0, 1.0, 1.0]]))

    def stars(*lamps):
        spread = replace(found.spread, lamps=lamps)
        layout = FilmLayout.of(found.scene.film)
        return [spread._star(lamp, lamp.place, lamp.size, lamp.radius, spread.reach, layout) for lamp in lamps]

    (of_sodium, beside_sodium), (alone,) = stars(sodium, white), stars(white)
    np.testing.assert_array_equal(beside_sodium, alone)
    assert np.abs(of_sodium - alone).sum() > 0.05 * alone.sum()


@pytest.mark.parametrize(
    ("light", "bands"), [({"lines_nm": {589.0: 2, 589.6: 1}}, (588, 591)), ({"illuminant": "F11"}, ())]
)
def test_lamps_of_few_wavelengths_have_their_lines(light, bands):
    lamp = {"shape": "sphere", "center": [0, 0, -10], "radius": 1e-4,
            "material": {"kind": "emissive", "radiance": light | {"luminance": 1e6}}}  # fmt: skip
    plan = make_plan(load_scene(scene_of([lamp], THIN)))
    lines = lines_of(plan, int(plan.emitters.shining[0]["radiance"][3]))
    assert (lines is None) == (not bands)
    if lines is not None:
        assert lines[:, 0].min() > bands[0] and lines[:, 0].max() < bands[1]
        assert lines[:, 1:].sum(axis=0) == pytest.approx(1)
        assert lines[:, 0] @ lines[:, 1] == pytest.approx(589.2, abs=0.1)


def test_dirt_is_seeded_lies_inside_and_scatters_its_shadow():
    outline = ngon(64, 1.0)[:, :2]
    dirt = Dirt(dust_per_mm2=8.0, dust_um=30.0, scratches_per_mm2=1.0, scratch_um=4.0, seed=5)
    holes = dirt_edges(dirt, outline, 2.0)
    assert np.hypot(*holes.reshape(-1, 2).T).max() < 1.0
    np.testing.assert_array_equal(holes, dirt_edges(dirt, outline, 2.0))
    other = dirt_edges(dirt.model_copy(update={"seed": 6}), outline, 2.0)
    assert holes.shape != other.shape or not np.array_equal(holes, other)
    x, y, to_x, to_y = holes.T
    shadow = -(x * to_y - y * to_x).sum() / 2 / np.pi
    clean, dirty = far_light(0.03 * ngon(64, 1.0)), far_light(0.03 * np.concatenate([ngon(64, 1.0), holes]))
    more = (dirty.within[1][:, -1].sum() - clean.within[1][:, -1].sum()) / shadow
    assert 0.5 < more < 1.05  # Babinet: as much as it stops; part of it falls nearer and farther
    wider = dirt_edges(dirt, outline, 2.5) * 2.5
    close = np.abs(wider[:, None] - 2 * holes[None, :40]).max(axis=2).min(axis=0)
    assert np.median(close) < 1e-12  # the same specks, and more of them


@pytest.mark.slow
def test_far_light_of_a_lamp_does_not_ring_and_is_the_same_once_read():
    shape = {"shape": "polygon", "blades": 6}
    found = found_of(width_mm=4, resolution=(60, 5), f_number=16, aperture=shape, stop={"dirt": {}})
    film = np.full((5, 60, 3), 1e-3, np.float32)
    np.testing.assert_allclose(found.over(film)[0], 1e-3, rtol=1e-5)  # even light stays even
    film[2, 20] = 1e9
    spread = found.over(film)[0].astype(float)
    assert (spread.sum(axis=(0, 1)) < 1e9).all()  # some falls beside the film
    assert spread.min() > 0
    assert (np.diff(spread[2, 34:, 1]) < 0).mean() > 0.9  # it falls evenly, apart from what dirt scatters
    again = spread_of(found.arrays(), (60, 5), (60, 5)).over(film, FilmLayout.of(found.scene.film))[0]
    np.testing.assert_array_equal(again, spread.astype(np.float32))


@pytest.mark.parametrize(
    ("camera", "fault"),
    [
        (
            {"diffraction": "off", "stop": {"dirt": {}}},
            r"camera\.stop\.dirt: scatters light by diffraction",
        ),
        ({"stop": {"dirt": {"dust_um": -1}}}, r"camera\.stop\.dirt\.dust_um"),
        ({"stop": {"dirt": {"dust": 5}}}, r"camera\.stop\.dirt\.dust"),
        ({"stop": {"dirt": "much"}}, r"camera\.stop\.dirt"),
        ({"stop": {"dirt": {"seed": 1.5}}}, r"camera\.stop\.dirt\.seed"),
    ],
)
def test_bad_dirt_is_refused(camera, fault):
    with pytest.raises(InputError, match=fault):
        found_of(**camera)


#
# Lamps out of focus, against full-wave pictures by Debye's integral.

HEXAGON = np.stack([np.cos(np.arange(6) * np.pi / 3), np.sin(np.arange(6) * np.pi / 3)], axis=1)


def full_wave_picture(image_mm, film_mm, nm, places_mm, radius_mm=50 / 11.2, corners=HEXAGON, across=600, finer=4):
    """Light per mm2 on the film of a wave that converges from a polygon to a point: Debye's integral, of 1 altogether.

    Over direction cosines of the light to the film's middle: a point of the pupil sends it sqrt(film^2 + r^2) far, and
    is sqrt(image^2 + r^2) before the point where all light is in step. Even light on the pupil.
    """
    widest = radius_mm / film_mm
    step = 2 * widest / across
    cosines = (np.arange(across) + 0.5) * step - widest
    within = ((np.arange(finer) + 0.5) / finer - 0.5) * step

    def on_pupil(right, up):
        l, m = np.meshgrid(cosines + right, cosines + up)  # noqa: E741
        ahead = np.sqrt(1 - l**2 - m**2)
        return film_mm * l / ahead, film_mm * m / ahead, ahead

    open_share = np.zeros((across, across))
    for right in within:
        for up in within:
            x, y, _ = on_pupil(right, up)
            inside = np.ones(x.shape, bool)
            for start, end in radius_mm * np.stack([corners, np.roll(corners, -1, axis=0)], axis=1):
                inside &= (end[0] - start[0]) * (y - start[1]) >= (end[1] - start[1]) * (x - start[0])
            open_share += inside / finer**2
    x, y, ahead = on_pupil(0.0, 0.0)
    square = x**2 + y**2
    path = np.sqrt(image_mm**2 + square) - image_mm - np.sqrt(film_mm**2 + square) + film_mm
    field = open_share / ahead**2 * np.exp(-2j * np.pi * path / (nm * 1e-6))
    wave = np.exp(2j * np.pi / (nm * 1e-6) * np.outer(places_mm, cosines))
    flux = (open_share / ahead**4).sum() * step**2
    return np.abs(wave @ field @ wave.T) ** 2 * step**4 / flux / (nm * 1e-6) ** 2


def lamp_scene(waves, pixels=160, blades=6, **camera):
    """A lamp of 0.4 micrometres on the film, 200 m away, out of focus by so many waves of 550 nm, 50 mm f/5.6."""
    image = 1 / (1 / 50 - 1 / 200e3)
    film = 1 / (1 / image - 2 * waves * 550e-6 / (50 / 11.2) ** 2)
    shape = {"aperture": {"shape": "polygon", "blades": blades}} if blades else {}
    own = {"f_number": 5.6, "focus_distance_m": 1e-3 / (1 / 50 - 1 / film), "diffraction": "on"}
    lamp = {"shape": "sphere", "center": [0, 0, -200], "radius": 0.0016,
            "material": {"kind": "emissive", "radiance": 1e4}}  # fmt: skip
    scene = scene_of([lamp], {**THIN, **own, **shape, **camera}, depth=1, film={"width_mm": 0.002 * pixels},
                     resolution=(pixels, pixels), spectrum="rgb")  # fmt: skip
    return scene, image, film


@pytest.mark.parametrize("waves", [0.5, 7.5])
def test_a_hexagon_out_of_focus_has_the_picture_of_its_waves(waves):
    scene, image, film = lamp_scene(waves)
    loaded = load_scene(scene)
    pupils, source, middle = camera_of(loaded).film_pupils(), np.array([0.0, 0.0, -200e3]), np.zeros(2)
    rough = rough_opening(pupils, (middle, pupils(middle)), middle, source, 550.0)
    wave = finer_opening(pupils, rough, middle, source).wave(60.0)
    places = (np.arange(160) - 79.5) * 0.0015
    expected = full_wave_picture(image, film, 550.0, places)
    found = wave_picture(wave, 550.0, places, places)
    assert np.abs(found - expected).sum() < 0.01 * expected.sum()
    by_rays = ray_picture(wave, places, places) / 0.0015**2
    assert by_rays.sum() * 0.0015**2 == pytest.approx(1.0, abs=1e-6)
    assert np.abs(by_rays - expected).sum() > 0.25 * expected.sum()


@pytest.mark.parametrize(("degrees", "distance_mm"), [(8.0, 1500.0), (12.0, np.inf)])
def test_light_traced_from_the_film_has_the_paths_of_light_traced_to_it(degrees, distance_mm):
    lens = load_lens("dgauss-50mm").with_stop_diameter(6.0)
    back = film_distance(lens, 1e9)
    expected = pupil_function(lens, back, Beam(degrees, distance_mm), 550.0, 48)
    camera = {"kind": "realistic", "lens": "dgauss-50mm", "stop_diameter_mm": 6, "focus": {"film_distance_mm": back}}
    scene = load_scene(scene_of([], {**camera, "diffraction": "on", **POSE}, resolution=(32, 16)))
    reach = min(distance_mm, 1e8)
    source = np.array([0.0, -np.tan(np.radians(degrees)) * reach, -reach])
    directions = np.stack(np.meshgrid(expected.cosines_x, expected.cosines_y), axis=-1)
    rays = camera_of(scene).film_pupils().arrive(expected.chief, source, 550.0, directions)
    lit = expected.coverage > 0.99
    off = -rays.path_mm.reshape(lit.shape)[lit] / 550e-6 - expected.waves[lit]
    assert np.ptp(off) < (1e-5 if np.isfinite(distance_mm) else 0.01)  # infinity is 100 km away
    ratio = rays.density.reshape(lit.shape)[lit] / expected.density[lit]
    assert np.ptp(ratio) < 1e-6 * ratio.mean()


def test_lamps_are_as_bright_as_their_film_and_those_half_hidden_are_left():
    down, right = np.mgrid[:21, :21] - 10
    disk = np.float32(np.hypot(down, right) < 6)
    rays = np.tile(disk / disk.sum(), (3, 1, 1))
    lamps = [LampImage(column, 5, rays, rays) for column in (2, 8, 60)]
    light = np.array([[300.0, 200.0, 100.0], [50.0, 60.0, 70.0], [90.0, 90.0, 90.0]])
    film = np.full((3, 31, 90), 0.2)
    for lamp, own in zip(lamps, light, strict=True):
        film[:, 5:26, lamp.column : lamp.column + 21] += own[:, None, None] * rays
    noisy = film * (1 + 0.2 * np.random.default_rng(5).standard_normal(film.shape))
    assert brightness(film, (0, 0), lamps) == pytest.approx(light, rel=1e-6)
    assert brightness(noisy, (0, 0), lamps) == pytest.approx(light, rel=0.12)
    left, taken = without_lamps(film, (0, 0), lamps, light)
    np.testing.assert_allclose(left, 0.2, rtol=1e-5)
    assert taken == pytest.approx(light, rel=1e-5)
    left, taken = without_lamps(noisy, (0, 0), lamps, light)  # a film keeps its light, whatever of it is noise
    assert left.sum(axis=(1, 2)) + taken.sum(axis=0) == pytest.approx(noisy.sum(axis=(1, 2)), rel=1e-6)
    film[:, :, 71:] = 0.2  # the last is half behind something
    assert brightness(film, (0, 0), lamps) == pytest.approx(light * [[1], [1], [0]], rel=1e-6)


@pytest.mark.parametrize(("waves", "pixel_mm", "shown"), [(7.5, 0.01, 1), slow(40.0, 0.03, 0), (7.5, 0.3, 0)])
def test_lamps_on_pixels_too_large_for_their_rings_have_the_film_of_the_rays(waves, pixel_mm, shown):
    scene = load_scene(lamp_scene(waves, 32)[0] | {"film": {"width_mm": 32 * pixel_mm, "resolution": [32, 32]}})
    found = replace(diffraction_of(scene), plan=make_plan(scene))
    assert sum(lamp.image is not None for lamp in found.spread.lamps) == shown


@pytest.mark.parametrize(
    ("lens", "f_number", "spectrum"),
    [slow("double-gauss-50mm-f1.1", 8.0, "rgb"), slow("fisheye-10mm", 8.0, "auto"),
     slow("retrofocus-35mm", 5.6, "auto")],
)  # fmt: skip
def test_nothing_moves_and_even_light_stays_even_where_the_image_circle_ends(monkeypatch, lens, f_number, spectrum):
    monkeypatch.setattr(diffraction, "_RAYS_PX", 0.0)  # on pixels as coarse as these rays would do
    monkeypatch.setattr(point_waves, "AS_GOOD", -1.0)
    camera = {"kind": "realistic", "lens": lens, "f_number": f_number, "focus": {"distance_m": 3}, "diffraction": "on"}
    scene = load_scene(scene_of([], {**camera, **POSE}, resolution=(192, 108), spectrum=spectrum))
    found = diffraction_of(scene)
    found = replace(found, plan=stigmatic(make_plan(scene), found.conjugates))
    assert "STIGMATIC" in found.plan.camera.facts
    even = found.spread.over(np.ones((108, 192, 3), np.float32), FilmLayout.of(scene.film))[0]
    assert even == pytest.approx(1.0, abs=1e-4)
    own, reach = found.spread.aberrated, found.spread.reach
    steps = np.arange(-reach, reach + 1)
    there = np.rint(np.stack(np.meshgrid(*own.nodes), axis=-1).reshape(-1, 2)).astype(int)
    shares = own.shares[there[:, 1], there[:, 0]]
    assert 0.1 < shares.mean() < 0.99 and shares.max() == 1
    for near, weights in ((np.stack(found.spread.near), 1.0), (own.near, shares[:, None])):
        middles = np.stack([near.sum(axis=2) @ steps, near.sum(axis=3) @ steps], axis=-1)
        moved = weights * np.linalg.norm(middles, axis=-1)
        assert moved.max() < 0.25  # of a pixel, a node lies 24 farther


@pytest.mark.slow
@pytest.mark.parametrize("columns", [3, slow(10)])
def test_a_window_in_focus_is_even_and_keeps_its_light(columns):
    pixel = 10 / 50 * 0.018  # of 18 um, at 10 m
    width, height = (columns + 0.4) * pixel, 40.3 * pixel
    window = {"shape": "rectangle", "corner": [0.3 * pixel - width / 2, -height / 2, -10], "edge_u": [width, 0, 0]}
    window |= {"edge_v": [0, height, 0], "material": {"kind": "emissive", "radiance": 200.0}}
    scene = {
        "film": {"resolution": [96, 64], "width_mm": 96 * 0.018}, "objects": [window],
        "camera": {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 16, "focus_distance_m": 10,
                   "eye": [0, 0, 0], "target": [0, 0, -1], "diffraction": "on"},
        "environment": {"kind": "constant", "radiance": 0.05}, "render": {"spp": 64, "max_depth": 1},
    }  # fmt: skip
    image = rptcam_cl.render(scene, layers=["direct"])
    inside = image.luminance[20:44, 47:50]
    assert inside.std(axis=0).max() < 0.003 * inside.mean()
    assert image.luminance.sum() == pytest.approx(image["direct"].sum(axis=(0, 1)) @ LUMINANCE, rel=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("waves", [0.5, 7.5])
def test_a_rendered_lamp_out_of_focus_has_rings_and_spikes_as_wide_as_an_edge(waves):
    scene, image, film = lamp_scene(waves)
    picture = rptcam_cl.render(scene, spp=256, layers=["direct"])
    places, expected = (np.arange(480) - 239.5) * 0.002 / 3, np.zeros((160, 160))
    for nm, share in zip(WAVES_NM, SHARES[:, 1], strict=True):
        light = full_wave_picture(image, film, nm, places)
        expected += share * light.reshape(160, 3, 160, 3).mean(axis=(1, 3)) * 0.002**2
    found, rays = (film[..., 1].astype(float) / picture["direct"][..., 1].sum(dtype=float)
                   for film in (picture.pixels, picture["direct"]))  # fmt: skip
    assert np.abs(found - expected).sum() < 0.03 * expected.sum()
    assert np.abs(rays - expected).sum() > 0.25 * expected.sum()


@pytest.mark.slow
def test_parts_of_a_film_with_lamps_are_merged_with_the_bits_of_the_whole(tmp_path):
    small = lamp_scene(3.0, 64)[0]
    whole = rptcam_cl.render(small, spp=8, layers=["direct"])
    parts = [tmp_path / "1.rpck", tmp_path / "2.rpck"]
    for number, path in enumerate(parts, 1):
        rptcam_cl.render(small, spp=8, layers=["direct"], part=f"{number}/2", checkpoint=path)
    np.testing.assert_array_equal(rptcam_cl.merge(parts), whole)
    assert np.abs(whole.pixels - whole["direct"]).sum() > 0.2 * whole["direct"].sum()


BLADES = {"aperture": {"shape": "polygon", "blades": 6, "rotation_degrees": 30}}
REAL = {"kind": "realistic", "lens": "dgauss-50mm", "f_number": 16, "focus": {"distance_m": 10}, **POSE, **BLADES}
AT_10_M = THIN | {"focus_distance_m": 10}
BLURRED = AT_10_M | BLADES | {"focus_distance_m": 3}


def film_beside(right_px, camera, crop=None, wall=(), spp=256):
    """The film, less its even light, of a lamp of 1.5 pixels so far beside its left half: by that half, or by all."""
    pixel = 0.2 * 0.018 * 10 / 9.95  # of 18 um, at 10 m
    shine = {"kind": "emissive", "radiance": 1e6}
    lamp = {
        "shape": "sphere",
        "center": [right_px * pixel, 0.3 * pixel, -10],
        "radius": 0.75 * pixel,
        "material": shine,
    }
    scene = {
        "film": {"resolution": [128, 32], "width_mm": 128 * 0.018, **({} if crop is None else {"crop": crop})},
        "objects": [lamp, *wall], "render": {"spp": spp, "max_depth": 1}, "camera": camera | {"diffraction": "on"},
        "environment": {"kind": "constant", "radiance": 1.0},
    }  # fmt: skip
    return rptcam_cl.render(scene).pixels[:, :64, 1].astype(float) - 1


@pytest.mark.parametrize(
    ("right_px", "camera"),
    [(3.3, AT_10_M)]
    + [slow(*case) for case in (
        (0.3, AT_10_M | BLADES), (0.7, AT_10_M | BLADES), (1.7, AT_10_M | BLADES), (40.0, AT_10_M | BLADES),
        (8.3, BLURRED), (20.3, BLURRED), (3.3, BLURRED | {"f_number": 4}), (0.7, REAL), (8.3, REAL),
    )],
)  # fmt: skip
def test_a_lamp_beside_the_picture_lights_it_as_on_a_larger_film(right_px, camera):
    beside, whole = (film_beside(right_px, camera, crop) for crop in ([0.0, 0.5, 0.0, 1.0], None))
    off = np.abs((beside - whole).sum(axis=0))  # along the columns, as a spike lies in one row or in two
    assert off.sum() < (0.04 if "aperture" in camera else 0.006) * whole.sum()  # noise of the lamp that the larger has
    assert off[:32].sum() < 0.05 * whole[:, :32].sum()
    assert whole[:, :32].sum() > 100


@pytest.mark.slow
def test_a_lamp_beside_the_picture_that_is_hidden_sends_nothing():
    wall = {"shape": "disk", "center": [30.3 * 0.0036, 0, -9.9], "normal": [0, 0, 1], "radius": 0.03,
            "material": {"kind": "emissive", "radiance": 1.0}}  # fmt: skip
    assert np.abs(film_beside(30.3, AT_10_M, [0.0, 0.5, 0.0, 1.0], [wall], 16)).sum() < 1.0  # the lamp would bring 700
