"""Pictures of light whose spectrum is known in closed form: `spectral` gives its colour, products of channels do not.

Each scene has the same light from every direction, or none but the environment's is seen, so that every path of a
wavelength carries the same. What is left is the noise of the wavelengths.
"""

import numpy as np
import pytest

import rptcam_cl
from benchmarks.upsampling import color_checker
from rptcam_cl.core.colour import WAVELENGTHS_NM, illuminant, metal_optics, srgb_from_spectrum
from rptcam_cl.rendering.plan.textures import reflectance

EVERY_5 = [float(x) for x in WAVELENGTHS_NM[::5]]
LAMP = {"illuminant": "F11", "luminance": 1}
TOLERANCE = 0.004  # of the brightest channel; light is known in cells of about 1 nm


def table(spectrum):
    return {"wavelengths_nm": EVERY_5, "values": [float(x) for x in spectrum[::5]]}


def known(spectrum):
    """The spectrum that the renderer reads from `table`."""
    return np.interp(WAVELENGTHS_NM, EVERY_5, spectrum[::5])


def coloured_glass(share):
    return {"kind": "thin_glass", "index": 1.5, "transmittance": table(share)}


def metal(n, k):
    tables = {"n": [float(x) for x in n[::5]], "k": [float(x) for x in k[::5]]}
    return {"kind": "conductor", "alpha": 1e-3, "metal": {"wavelengths_nm": EVERY_5} | tables}


def absorbing(coefficient):
    return {"kind": "dielectric", "index": 1.0, "absorption_per_m": table(coefficient)}


def ground(material):
    """A square that nothing is seen beside of."""
    return {
        "shape": "rectangle",
        "corner": [-9, 0, -9],
        "edge_u": [0, 0, 18],
        "edge_v": [18, 0, 0],
        "material": material,
    }


def solid(material):
    return {"shape": "box", "min": [-1, -0.25, -1], "max": [1, 0.25, 1], "material": material}


# Specks behind the camera of everything that is shown: one program renders all.
HALF = np.full(len(WAVELENGTHS_NM), 0.5)
KINDS = ({"kind": "matte", "reflectance": table(HALF)}, coloured_glass(HALF), metal(2 * HALF, HALF), absorbing(HALF))
SPECKS = [
    shape(material) | {"transform": [{"scale": 1e-4}, {"translate": [0, 90, 0]}]}
    for material in KINDS
    for shape in (ground, solid)
    if shape is ground or material is not KINDS[1]  # panes are no solids
]


def picture(spectrum="spectral", **parts):
    """Mean of a picture that looks straight down, and its standard error."""
    scene = {
        "camera": {"kind": "pinhole", "eye": [0, 2, 0], "target": [0, 0, 0], "up": [0, 0, 1], "fov_degrees": 4},
        "film": {"resolution": [32, 32]},
        "render": {"spp": 256, "max_depth": 8, "roulette_depth": 8},
        "environment": {"kind": "constant", "radiance": LAMP},
        "spectrum": spectrum,
    }
    pixels = np.asarray(rptcam_cl.render(scene | parts)).astype(float).reshape(-1, 3)
    return pixels.mean(axis=0), pixels.std(axis=0) / np.sqrt(len(pixels))


def check(shown, light):
    """A picture shows light of a spectrum; that of its colours multiplied does not."""
    expected, parts = srgb_from_spectrum(light), {"objects": [shown, *SPECKS]}
    mean, error = picture(**parts)
    bound = TOLERANCE * expected.max()
    assert (3.9 * error < bound / 2).all(), "inconclusive: too noisy"
    assert (np.abs(mean - expected) + 3.9 * error < bound).all(), (mean, expected)
    channels, _ = picture("rgb", **parts)
    assert np.abs(channels - expected).max() > 3 * bound


@pytest.mark.slow
def test_paint_under_a_lamp_of_lines():
    green = color_checker()["bluish green"]
    check(ground({"kind": "matte", "reflectance": table(green)}), known(green) * illuminant("F11"))


@pytest.mark.slow
def test_pane_of_coloured_glass():
    share = 0.9 * np.exp(-(((WAVELENGTHS_NM - 545) / 12) ** 2)) + 0.01  # passes one band of the lamp
    n = 1.5
    once = ((n - 1) / (n + 1)) ** 2
    tau = known(share)
    passed = (1 - once) ** 2 * tau / (1 - once**2 * tau**2)
    reflected = once + (1 - once) ** 2 * once * tau**2 / (1 - once**2 * tau**2)
    check(ground(coloured_glass(share)), (passed + reflected) * illuminant("F11"))


@pytest.mark.slow
def test_solid_that_absorbs():
    coefficient = 8 * np.exp(-(((WAVELENGTHS_NM - 610) / 15) ** 2))
    check(solid(absorbing(coefficient)), np.exp(-0.5 * known(coefficient)) * illuminant("F11"))


def test_metal_by_its_table():
    n, k = metal_optics("gold")
    check(ground(metal(n, k)), reflectance(known(n) + 1j * known(k)) * illuminant("F11"))


def test_sky_between_two_spectra():
    low, high = {"lines_nm": {589.0: 1}}, {"illuminant": "LED-B5", "luminance": 2}
    parts = {"environment": {"kind": "gradient", "up": [1, 0, 0], "bottom": low, "top": high}, "objects": []}
    mean, error = picture(**parts)
    line = np.interp(WAVELENGTHS_NM, [588, 589, 590], [0, 1, 0])
    expected = srgb_from_spectrum(0.5 * line + 0.5 * 2 * illuminant("LED-B5"))
    assert (np.abs(mean - expected) + 3.9 * error < TOLERANCE * expected.max()).all(), (mean, expected)
    assert expected[2] != pytest.approx(float(np.asarray(picture("rgb", **parts)[0])[2]), rel=0.01)
