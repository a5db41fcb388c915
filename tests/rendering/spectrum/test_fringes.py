"""How wide the colours of figures 4 and 7 of the rptcam paper are blurred: first order, float64 rays and pictures.

The edge of a white wall is seen through the lens, a straight line across the middle of the film. It is blurred by a
spot whose rays lie where the reference traces them: for an even disk of diameter D the variance across the edge is
(D / 4)^2, and so 4 standard deviations are called the width of a blur, whatever the spot's shape.
"""

import numpy as np
import pytest

from rptcam_cl.core.colour import LUMINANCE, WAVELENGTHS_NM, cie_1931, daylight_65, srgb_from_xyz
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.plan.plan import least_noise, primary_spectra
from tests.rendering.pictures import WHITE, looking, pixels, scene_of, seed_of
from tests.rendering.spectrum.scenes import (
    DOUBLET_BACK_MM,
    PAPER_NM,
    PAPER_PIXEL_MM,
    SINGLET_BACK_MM,
    doublet,
    opening,
    paper_camera,
    room,
    singlet,
    white_wall,
)
from tests.rendering.spectrum.test_modes import FORCED, GLASS_BALL
from tests.support.cases import fast, slow
from tests.support.statistics import assert_equivalent

# Blur of an object 18 from the film when 15 is in focus, in pixels of the paper's film: figure 4.
FIGURE_4 = {200: (2.2, 2.0, 1.9, 1.8, 1.8), 10: (6.8, 4.6, 1.9, 0.15, 1.0), 3: (18, 11, 1.9, 3.9, 7.7)}
# Distances from the film that are in focus: figure 7.
IN_FOCUS = {"singlet": (7.67, 9.80, 18.06, 74.4, -46.5), "doublet": (16.31, 16.95, 17.67, 18.01, 18.12)}
FIGURE_7 = {"singlet": (singlet(3, 0.1), SINGLET_BACK_MM[18]), "doublet": (doublet(), DOUBLET_BACK_MM)}
OBJECT_MM = 18.0


def thin_blur(lens, film_distance_mm, wavelength_nm):
    """Diameter of the disk that a point of the axis is spread to [mm], the lens taken for a thin one in its middle."""
    film = film_distance_mm + lens.length / 2
    image = 1 / (1 / lens.first_order(wavelength_nm).focal_length_mm - 1 / (OBJECT_MM - film))
    return 2 * lens.surfaces[0].semi_diameter * abs(film / image - 1)


def spot(lens, film_distance_mm, wavelength_nm):
    """Where the rays of an object point on the axis meet the film, along x [mm]."""
    there = -(OBJECT_MM - film_distance_mm - lens.length)
    aims = np.column_stack([opening(lens), np.zeros(4096)])
    start = np.array([0.0, 0.0, there])
    rays = lens.trace(np.tile(start, (len(aims), 1)), aims - start, wavelength_nm, "scene")
    z = lens.length + film_distance_mm - rays.origins[:, 2]
    return (rays.origins[:, 0] + z * rays.directions[:, 0] / rays.directions[:, 2])[rays.passed]


def edge(lens, film_distance_mm, window_mm, name, spp=64, **rest):
    """Picture of the edge of a wall of light (rows, columns, channels), and the width of a pixel [mm]."""
    wall = {"shape": "rectangle", "corner": [0, -9, -OBJECT_MM], "edge_u": [9, 0, 0], "edge_v": [0, 18, 0]}
    wall["material"] = {"kind": "emissive", "radiance": 1.0}
    camera = paper_camera(lens, film_distance_mm, **rest.pop("camera", {}))
    film = {"size_mm": [window_mm, window_mm / 2]}
    scene = scene_of([wall], camera, depth=1, film=film, resolution=(128, 64), metres_per_unit=1e-3, **rest)
    return pixels(scene, seed=seed_of(name), spp=spp), window_mm / 128


def edge_width(lens, film_distance_mm, window_mm, name, wavelength_nm):
    """Four standard deviations of the edge in a picture by light of one wavelength [mm]."""
    rows, pixel = edge(
        lens, film_distance_mm, window_mm, name, spp=256, camera={"wavelength_nm": wavelength_nm}, spectrum="rgb"
    )
    seen = rows[..., 1].mean(axis=0)
    steps = np.diff(seen) / (seen[-1] - seen[0])
    x = np.arange(1, 128) * pixel
    return 4 * np.sqrt(x**2 @ steps - (x @ steps) ** 2 - pixel**2 / 12)


@pytest.mark.slow
@pytest.mark.parametrize("v", fast([3], FIGURE_4))
def test_blur_of_figure_4(v):
    lens, film_distance_mm = load_lens(singlet(v)), SINGLET_BACK_MM[15]
    for wavelength, published in zip(PAPER_NM, FIGURE_4[v], strict=True):
        thin = thin_blur(lens, film_distance_mm, wavelength)
        assert thin / PAPER_PIXEL_MM == pytest.approx(published, rel=0.05)
        traced = 4 * spot(lens, film_distance_mm, wavelength).std()
        width = edge_width(singlet(v), film_distance_mm, 2 * traced, f"figure 4 {v} {wavelength}", wavelength)
        assert width == pytest.approx(traced, rel=0.02)
        # The principal planes lie 0.003 from the middle of the lens: a thirtieth of a pixel, of which 0.15 feels much.
        assert width == pytest.approx(thin, rel=0.05, abs=0.03 * PAPER_PIXEL_MM)


@pytest.mark.slow  # that edges are blurred as the float64 rays say, in white light below
@pytest.mark.parametrize("name", fast(["doublet"], FIGURE_7))
def test_blur_of_figure_7(name):
    prescription, film_distance_mm = FIGURE_7[name]
    lens = load_lens(prescription)
    for wavelength, published in zip(PAPER_NM, IN_FOCUS[name], strict=True):
        first = lens.first_order(wavelength)
        image = film_distance_mm - first.principal_planes_mm.rear
        from_principal = 1 / (1 / first.focal_length_mm - 1 / image)
        in_focus = from_principal - first.principal_planes_mm.front + lens.length + film_distance_mm
        assert in_focus == pytest.approx(published, rel=2e-3)
        wanted = 4 * spot(lens, film_distance_mm, wavelength).std()
        width = edge_width(prescription, film_distance_mm, 2 * wanted, f"figure 7 {name} {wavelength}", wavelength)
        assert width == pytest.approx(wanted, rel=0.02)


def test_doublet_of_figure_7_has_a_tenth_of_the_colour():
    widths = {
        name: [spot(load_lens(lens), film_distance_mm, wavelength).std() for wavelength in PAPER_NM]
        for name, (lens, film_distance_mm) in FIGURE_7.items()
    }
    assert max(widths["doublet"]) < 0.1 * max(widths["singlet"])


def white_as_seen(mode):
    """How much of white each wavelength adds to red, green and blue, shares (401, 3)."""
    seen = primary_spectra() if mode == "dispersive" else (cie_1931() @ srgb_from_xyz().T) * daylight_65()[:, None]
    return seen / seen.sum(axis=0)


def profile(lens, film_distance_mm, window_mm, mode):
    """Mean of the columns of the edge's picture in white light (128, 3), from float64 rays of 101 wavelengths."""
    nodes = np.linspace(380, 780, 101)
    borders = np.arange(129) * window_mm / 128 - window_mm / 2
    columns = []
    for wavelength in nodes:
        x = np.sort(spot(lens, film_distance_mm, wavelength))
        below = np.concatenate([[0.0], np.cumsum(x)])
        found = np.searchsorted(x, borders)
        columns.append(np.diff(borders * found - below[found]) * 128 / window_mm / len(x))  # mean share of rays before
    shares = np.array([np.interp(WAVELENGTHS_NM, nodes, column) for column in np.transpose(columns)])
    return shares @ white_as_seen(mode)


@pytest.mark.parametrize(
    ("v", "mode"),
    [
        (3, "dispersive"),
        *(slow(*case) for case in ((3, "spectral"), (10, "dispersive"), (10, "spectral"))),
    ],
)
def test_edge_in_white_light_has_its_fringes(v, mode):
    lens, film_distance_mm = load_lens(singlet(v)), SINGLET_BACK_MM[15]
    window = 5 * max(spot(lens, film_distance_mm, wavelength).std() for wavelength in (380, 780))
    kind = {"mode": mode, "lens": "on"}
    rows, _ = edge(singlet(v), film_distance_mm, window, f"white {mode} {v}", spectrum=kind, spp=1024)
    expected = profile(lens, film_distance_mm, window, mode)
    mean, error = rows.mean(axis=0), rows.std(axis=0, ddof=1) / 8
    assert_equivalent(mean, error, expected, 0.02)
    grey = np.abs(expected - expected[:, 1:2]).max()
    assert grey > 0.1  # five times what is allowed


def noise(values, weights=None):
    """Variances of the luminance of colours (n, 3), and of the differences of red and blue to it together."""
    bright = values @ LUMINANCE
    parts = np.column_stack([bright, values[:, 0] - bright, values[:, 2] - bright])
    mean = np.average(parts, axis=0, weights=weights)
    variance = np.average((parts - mean) ** 2, axis=0, weights=weights)
    return variance[0], variance[1] + variance[2]


def sky(**rest):
    world = looking([0, 0, 0], [0, 1, 0])
    scene = scene_of([], world, environment=WHITE, depth=1, resolution=(128, 128), **rest)
    return {**scene, "render": {**scene["render"], "sampler": "independent"}}


def test_three_wavelengths_of_white_leave_little_noise():
    film = pixels(sky(spectrum="spectral"), seed=seed_of("three"), spp=1).reshape(-1, 3)
    luminance, colour = noise(film)
    assert luminance < 0.02
    assert colour < 0.25  # 11 with one wavelength


@pytest.mark.slow
def test_noise_of_one_wavelength_is_the_least_that_there_is():
    spectra = primary_spectra()
    found = {}
    for name, density in {"least": least_noise(spectra), "mean": spectra.mean(axis=1)}.items():
        seen = density > 0
        share = (density / density.sum())[seen]
        found[name] = noise(spectra[seen] / share[:, None], share)
    assert sum(found["least"]) < 0.96 * sum(found["mean"])
    scene = white_wall(singlet(1e9), SINGLET_BACK_MM[15], resolution=(128, 128), spectrum=FORCED["dispersive"])
    scene["film"]["size_mm"] = [0.005, 0.005]
    scene["render"]["sampler"] = "independent"
    film = pixels(scene, seed=seed_of("one"), spp=1).reshape(-1, 3)
    lit = film[film.max(axis=1) > 0]
    share = len(lit) / len(film)  # of rays, the others are stopped
    luminance, colour = noise(lit * share)
    assert luminance == pytest.approx(found["least"][0], rel=0.05)
    assert colour == pytest.approx(found["least"][1], rel=0.05)


def test_light_that_meets_no_dispersive_glass_has_the_noise_of_rgb():
    pictures = {mode: pixels({**room(GLASS_BALL), "spectrum": mode}, seed=3, spp=4) for mode in ("rgb", "dispersive")}
    same = np.isclose(pictures["rgb"], pictures["dispersive"], rtol=1e-5, atol=1e-6).all(axis=-1)
    assert 0.5 < same.mean() < 0.98  # sample by sample, away from the ball and what it lights
