"""Losses of lenses in pictures: what a white world sends through them, in every exposure and every mode of light."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.glass import MAGNESIUM_FLUORIDE
from rptcam_cl.optics.irradiance import film_irradiance
from rptcam_cl.optics.lens import film_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import COATED, UNCOATED, axial_transmittance, with_coating
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.load import load_scene
from tests.rendering.pictures import WHITE, flat_mean, pixels, scene_of
from tests.support.cases import slow
from tests.support.statistics import assert_equivalent

MGF2 = {"coating": "mgf2"}


def white_through(lens, transmission=None, *, exposure="irradiance", kind="realistic", width_mm=0.4, **rest):
    """A white world on a small film about the axis."""
    back = film_distance(load_lens(lens), np.inf)
    camera = {"kind": kind, "lens": lens, "focus": {"film_distance_mm": back}, "eye": [0, 0, 0], "target": [0, 0, -1]}
    camera |= {} if transmission is None else {"transmission": transmission}
    film = {"width_mm": width_mm}
    return scene_of([], camera, film=film, resolution=(16, 16), environment=WHITE, exposure=exposure, depth=1, **rest)


@pytest.mark.parametrize(
    ("transmission", "coated", "losses"),
    [slow("bare", False, UNCOATED), (MGF2, True, COATED), slow({"coating": "mgf2", "coatings": True}, True, COATED)],
)
def test_lossy_lens_gives_the_irradiance_of_the_reference(transmission, coated, losses):
    lens = load_lens("planar-1897")
    lens = with_coating(lens, MAGNESIUM_FLUORIDE) if coated else lens
    back = film_distance(lens, np.inf)
    expected = float(film_irradiance(lens, back, 0.0, transmission=losses))
    scene = white_through("planar-1897", transmission, spectrum="rgb")
    mean, error = flat_mean(scene, f"losses {transmission}", spp=256)
    assert_equivalent(mean[0], error[0], expected, 0.002 * expected)
    metadata = rptcam_cl.render(scene, spp=1).metadata
    assert metadata["on_axis_irradiance"] == pytest.approx(expected, rel=1e-6)
    assert metadata["t_number"] == pytest.approx(np.sqrt(np.pi / 4 / expected), rel=1e-6)
    clear = float(film_irradiance(lens, back, 0.0))
    assert metadata["transmittance"] == pytest.approx(expected / clear, rel=1e-9)
    assert metadata["working_f_number"] == pytest.approx(np.sqrt(np.pi / 4 / clear), rel=1e-6)


def test_ratio_to_the_ideal_picture_is_the_transmittance():
    def picture(transmission):
        return pixels(white_through("dgauss-50mm", transmission, spectrum="rgb"), seed=3, spp=64)

    lens = load_lens("dgauss-50mm")
    back = film_distance(lens, np.inf)
    expected = film_irradiance(lens, back, 0.0, transmission=UNCOATED) / film_irradiance(lens, back, 0.0)
    ratio = picture("bare") / picture(None)  # of the same rays
    assert ratio.mean() == pytest.approx(float(expected), rel=2e-4)
    assert np.ptp(ratio) < 0.01


@pytest.mark.parametrize("mode", ["rgb", *map(slow, ("dispersive", "spectral"))])
def test_relative_exposure_keeps_white_white(mode):
    scene = white_through("dgauss-50mm", MGF2, exposure="relative", spectrum=mode)
    mean, error = flat_mean(scene, f"white {mode}", spp=512)
    for channel in range(3):
        assert_equivalent(mean[channel], error[channel], 1.0, 0.002)


@pytest.mark.parametrize("mode", ["dispersive", slow("spectral")])
def test_irradiance_shows_the_colour_of_coatings(mode):
    lens = load_lens("dgauss-50mm")
    scene = white_through("dgauss-50mm", MGF2, spectrum=mode)
    mean, error = flat_mean(scene, f"tint {mode}", spp=512)
    ideal = float(film_irradiance(lens, film_distance(lens, np.inf), 0.0))
    green = ideal * float(axial_transmittance(with_coating(lens, MAGNESIUM_FLUORIDE), 545.0, COATED))
    assert_equivalent(mean[1], error[1], green, 0.015 * green)
    assert mean[2] / mean[1] < 0.985  # blue is reflected most: such coatings look purple, and pictures warm
    assert error.max() < 0.002 * green


@pytest.mark.parametrize("transmission", [None, "ideal"])
def test_nothing_is_compiled_unless_asked_for(transmission):
    plan = make_plan(load_scene(white_through("planar-1897", transmission)))
    names = ("LENS_FRESNEL", "LENS_LAYERS", "LENS_ABSORPTION", "LENS_TINTED")
    assert [plan.camera.facts[name] for name in names] == [0] * 4
    plain = make_plan(load_scene(white_through("planar-1897")))
    assert plan.camera.facts == plain.camera.facts
    assert plan.camera.surfaces.tobytes() == plain.camera.surfaces.tobytes()
    assert plan.camera.stop.tobytes() == plain.camera.stop.tobytes()


def test_thick_lens_loses_what_its_lens_loses_on_the_axis():
    lens = load_lens("planar-1897")
    lossy, ideal = (pixels(white_through("planar-1897", t, kind="thick_lens"), seed=1, spp=4) for t in ("bare", None))
    expected = float(axial_transmittance(lens, transmission=UNCOATED))
    np.testing.assert_allclose(lossy, expected * ideal, rtol=1e-5)


@pytest.mark.parametrize(
    ("transmission", "message"),
    [
        ("coated", r"camera\.transmission: .* does not say how it is coated \(allowed: ideal, bare, or a coating"),
        (
            "clear",
            r"camera\.transmission: is not what a lens lets through .*allowed: ideal, bare, coated, mgf2, multi, or a",
        ),
        ({"coating": "shiny"}, r"camera\.transmission\.coating: is no coating .*allowed: bare, mgf2, multi, a"),
        ({"coating": {"layers": [{"index": 0.5, "thickness_nm": 9}]}}, r"coating\.layers\[0\]\.index: .*1"),
        ({"coating": {"layers": []}}, r"coating\.layers"),
        ({"coating": {"layer": []}}, r"coating\.layer: unknown key"),
        ({"coating": 1.5}, r"camera\.transmission\.coating: is no share of light"),
        ({"fresnel": False, "coating": "mgf2"}, r"coating: says nothing where surfaces do not reflect"),
        ({"coatings": False, "coating": "mgf2"}, r"coating: says nothing where coatings do not count"),
    ],
)
def test_losses_that_make_no_sense_are_refused(transmission, message):
    with pytest.raises(InputError, match=message):
        make_plan(load_scene(white_through("dgauss-50mm", transmission)))


def test_a_coating_in_a_word_is_that_coating_and_true_is_on():
    word = white_through("dgauss-50mm", "mgf2")
    spelled = white_through("dgauss-50mm", {"coating": "mgf2"})
    assert load_scene(word).camera.transmission == load_scene(spelled).camera.transmission
    word["camera"] |= {"ghosts": True, "diffraction": False}
    camera = load_scene(word).camera
    assert (camera.ghosts, camera.diffraction) == ("on", "off")


def test_losses_must_be_known_at_the_wavelength_of_the_camera():
    scene = white_through("planar-1897", "bare")
    scene["camera"]["wavelength_nm"] = 1200.0
    with pytest.raises(InputError, match=r"camera\.transmission: what Planar .* known from 350 to 1060 nm \(camera"):
        make_plan(load_scene(scene))
    scene["camera"]["transmission"] = {"absorption": False}
    assert make_plan(load_scene(scene)).camera.facts["LENS_FRESNEL"]


def test_lens_that_says_how_it_is_coated_may_be_coated():
    lens = {
        "name": "singlet",
        "coating": {"reflectance": 0.01},
        "surfaces": [
            {"radius": 50, "thickness": 4, "glass": {"index": 1.5}, "diameter": 10},
            {"radius": -50, "diameter": 10},
        ],
    }
    scene = white_through("biconvex", "coated")
    scene["camera"] |= {"lens": lens, "focus": {"film_distance_mm": 48.0}}
    ideal = make_plan(load_scene(scene | {"camera": scene["camera"] | {"transmission": "ideal"}}))
    ratio = make_plan(load_scene(scene)).camera.on_axis_irradiance / ideal.camera.on_axis_irradiance
    assert ratio == pytest.approx(0.99**2, rel=1e-3)
