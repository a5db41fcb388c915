"""Light that lenses leave to rays on the device is that of the reference, for one wavelength and for one per ray."""

import numpy as np
import pytest

from rptcam_cl.optics.glass import MAGNESIUM_FLUORIDE, Layer, LayerStack, MeasuredReflectance, QuarterWave
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import COATED, IDEAL, UNCOATED, LensTransmission, Rays, with_coating
from rptcam_cl.rendering.cameras.lens_records import lens_records
from rptcam_cl.rendering.traceable_lens import LensTracer, trace_on_device
from tests.rendering.cameras.beams import PRECISIONS, film_beam
from tests.support.cases import slow

# float32 loses about a rounding per surface; in float64 the cosine of a layer's phase is a polynomial good to 4e-7, and
# so are indices over the wavelength.
TOLERANCE = {"single": 5e-6, "double": 5e-7}
MEASURED = MeasuredReflectance((385.0, 500.0, 770.0), (0.02, 0.004, 0.01))
THREE = LayerStack((Layer(1.38, 100.0), Layer(2.1, 131.0), Layer(1.7, 81.0)))
DARK = LayerStack((Layer(1.46, 70.0), Layer(0.9, 6.0, 2.6), Layer(1.7, 40.0)))
GLASS_ALONE = LensTransmission(fresnel=False, coatings=False)
GREY = {"thickness_mm": 10, "wavelengths_nm": [390, 450, 760], "values": [0.7, 0.9, 0.8]}
HALF = {"clear": {"half_plane_degrees": 90}, "outside": "pass", "diameter": 30}


def split_dioptre():
    """Half a lens that absorbs, before a whole one."""
    glass = {"nd": 1.6, "vd": 40, "transmittance": GREY}
    rows = [
        {**HALF, "radius": 200, "thickness": 4, "glass": glass},
        {**HALF, "thickness": 3},
        {"radius": 80, "thickness": 5, "glass": glass, "diameter": 30},
        {"radius": -80, "diameter": 30},
    ]
    return load_lens({"name": "split dioptre", "surfaces": rows})


LENSES = {
    "dgauss-50mm": lambda: load_lens("dgauss-50mm"),
    "planar-1897": lambda: load_lens("planar-1897"),
    "asphere-1.4mm": lambda: load_lens("asphere-1.4mm"),
    "split dioptre": split_dioptre,
    "human-eye": lambda: load_lens("human-eye"),
}
LOSSES = {
    "bare": (None, UNCOATED),
    "mgf2": (MAGNESIUM_FLUORIDE, COATED),
    "thick layer": (QuarterWave(1.9, 1900.0), COATED),
    "three layers": (THREE, COATED),
    "a layer of metal": (DARK, COATED),
    "measured": (MEASURED, COATED),
    "glass": (None, GLASS_ALONE),
}


# Each kind of loss once, and kinds of lenses with those that they could get wrong; all pairs are slow.
CHOSEN = [
    *(("dgauss-50mm", losses) for losses in ("bare", "mgf2", "a layer of metal", "measured")),
    ("planar-1897", "glass"),
    ("split dioptre", "bare"),
    ("split dioptre", "glass"),
    ("human-eye", "glass"),
]
CHOSEN_OF_MANY = [
    ("dgauss-50mm", "mgf2"),
    ("planar-1897", "measured"),
    ("split dioptre", "glass"),
]


def pairs(names, chosen):
    every = [(name, losses) for name in names for losses in LOSSES]
    return [pytest.param(*pair, marks=() if pair in chosen else pytest.mark.slow) for pair in every]


class ColouredTracer(LensTracer):
    """A lens on the device whose rays bring their wavelengths [nm]."""

    def __init__(self, lens, session, wavelengths_nm, start, precision, transmission):
        super().__init__(lens, session, 550.0, start, precision, transmission)
        double = precision == "double"
        records = lens_records(lens, 550.0, start, 0.0, double=double, dispersive=True, transmission=transmission)
        self.facts |= records.facts
        self.lens |= {"surfaces": session.upload(records.surfaces), "stop": session.upload(records.stop)}
        self.wavelengths_nm = wavelengths_nm

    def _pack(self, points, vectors, table):
        super()._pack(points, vectors, table)
        table[6] = 550.0
        table[6, : len(points)] = self.wavelengths_nm


def coated(name, losses):
    coating, transmission = LOSSES[losses]
    lens = LENSES[name]()
    return (lens if coating is None else with_coating(lens, coating)), transmission


def assert_alike(got, expected, tolerance):
    both = got.passed & expected.passed
    assert both.sum() > 200
    np.testing.assert_allclose(got.transmittance[both], expected.transmittance[both], rtol=0, atol=tolerance)
    assert not got.transmittance[~got.passed].any()


@pytest.mark.parametrize("precision", ["single", slow("double")])
@pytest.mark.parametrize(("name", "losses"), pairs(LENSES, CHOSEN))
def test_rays_of_one_wavelength_keep_what_the_reference_says(session, name, losses, precision):
    lens, transmission = coated(name, losses)
    origins, directions = film_beam(lens, 1500)
    for wavelength in (420.0, 650.0):
        given = (origins, directions, wavelength)
        expected = lens.trace(*given, transmission=transmission)
        rays = trace_on_device(lens, session, *given, "film", precision, transmission)
        assert_alike(rays, expected, TOLERANCE[precision])


@pytest.mark.parametrize("precision", ["single", slow("double")])
@pytest.mark.parametrize(("name", "losses"), pairs(["dgauss-50mm", "planar-1897", "split dioptre"], CHOSEN_OF_MANY))
def test_rays_of_many_wavelengths_keep_what_the_reference_says(session, name, losses, precision):
    lens, transmission = coated(name, losses)
    origins, directions = film_beam(lens, 1500)
    count = len(origins)
    wavelengths = np.random.default_rng(7).uniform(391, 759, count)
    tracer = ColouredTracer(lens, session, wavelengths, "film", precision, transmission)
    rays = Rays(np.empty((count, 3)), np.empty((count, 3)), np.empty(count, np.int32), np.empty(count, np.int32),
                np.empty(0), np.empty(count))  # fmt: skip
    tracer.trace(origins, directions, rays, slice(0, count))
    assert_alike(rays, lens.trace(origins, directions, wavelengths, transmission=transmission), TOLERANCE[precision])


@pytest.mark.parametrize("precision", PRECISIONS)
def test_light_from_the_scene_keeps_the_same_share(session, precision):
    lens, transmission = coated("planar-1897", "mgf2")
    rays = trace_on_device(lens, session, *film_beam(lens, 1500), 500.0, "film", precision, transmission)
    good = rays.passed
    back = trace_on_device(lens, session, rays.origins[good], -rays.directions[good], 500.0, "scene", precision, COATED)
    arrived = back.passed
    assert arrived.sum() > 200
    sent = rays.transmittance[good][arrived]
    np.testing.assert_allclose(back.transmittance[arrived], sent, rtol=0, atol=2 * TOLERANCE[precision])


def test_what_is_not_asked_for_is_not_compiled():
    lens = with_coating(load_lens("planar-1897"), MAGNESIUM_FLUORIDE)
    keys = ("LENS_FRESNEL", "LENS_LAYERS", "LENS_ABSORPTION", "LENS_TINTED")

    def facts(transmission, each=lens, **options):
        found = lens_records(each, 550.0, "film", 0.0, transmission=transmission, **options).facts
        return tuple(found[key] for key in keys)

    assert facts(IDEAL) == facts(IDEAL, dispersive=True) == (0, 0, 0, 0)
    assert facts(COATED) == (1, 1, 1, 0)
    assert facts(COATED, dispersive=True) == (1, 1, 1, 1)
    assert facts(UNCOATED) == (1, 0, 1, 0)
    assert facts(GLASS_ALONE) == (0, 0, 1, 0)
    assert facts(LensTransmission(absorption=False)) == (1, 1, 0, 0)
    keys = ("LENS_STACKS", "LENS_DARK_LAYERS")
    assert facts(COATED, with_coating(lens, THREE)) == (1, 0)
    assert facts(COATED, with_coating(lens, DARK)) == (1, 1)
    keys = ("LENS_FRESNEL", "LENS_LAYERS", "LENS_ABSORPTION", "LENS_TINTED")
    clear = load_lens("dgauss-50mm")  # glass whose absorption is not known
    assert facts(UNCOATED, clear) == facts(UNCOATED, clear, dispersive=True) == (1, 0, 0, 0)
    assert facts(GLASS_ALONE, clear) == (0, 0, 0, 0)
