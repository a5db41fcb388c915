import pytest

from .conftest import EVERYTHING, SMALL, Load


def test_scene_without_light_is_warned_of(load: Load) -> None:
    (warning,) = load(SMALL, "environment=null").warnings
    assert warning == "nothing in the scene emits light: the image will be black"
    assert load(SMALL, "environment.radiance=0").warnings == (warning,)


@pytest.mark.parametrize(
    "override",
    [
        "objects.0.material={kind: emissive, radiance: [0, 1, 0]}",
        "lights=[{kind: point, position: [0, 5, 0], intensity: 1}]",
        "lights=[{kind: directional, direction: [0, -1, 0], irradiance: 1}]",
        "environment={kind: gradient, bottom: 0, top: 1}",
    ],
)
def test_any_light_will_do(load: Load, override: str) -> None:
    assert load(SMALL, "environment=null", override).warnings == ()


def test_scene_with_everything_has_no_warning(load: Load) -> None:
    assert load(EVERYTHING).warnings == ()


def test_oblong_pixels_are_warned_of(load: Load) -> None:
    (warning,) = load(SMALL, "film.size_mm=[36, 36]").warnings
    assert "pixels are 0.562 times as wide as high" in warning


def test_object_too_small_for_float32_is_warned_of(load: Load) -> None:
    speck = "{shape: sphere, center: [0, 0, 0], radius: 1e-9, material: {kind: mirror}, name: speck}"
    (warning,) = load(SMALL.replace("environment", f"  - {speck}\nenvironment")).warnings
    assert warning.startswith("object 'speck' is more than 1e+07 times smaller than the scene")


def test_camera_inside_a_solid_is_warned_of(load: Load) -> None:
    (warning,) = load(SMALL, "objects.0.transform={scale: 6}", "objects.0.center=[0, 0, 0]").warnings
    assert warning == "the camera stands inside objects[0]"


LENS = "{kind: realistic, lens: dgauss-50mm, eye: [0, 0, 5], target: [0, 0, 0], focus: {distance_m: 5}"
GHOSTS = "transmission: {coating: mgf2}, ghosts: 'on'"
MOVING = "motion: [{time_s: 0}, {time_s: 1/60, target: [1, 0, 0]}]"
LAMP = "objects.0.material={kind: emissive, radiance: 1}"
PUSHED = "objects.0.motion=[{time_s: 0}, {time_s: 1, translate: [1, 0, 0]}]"


CROSSED = "{surfaces: [{radius: 40, thickness: 1, diameter: 40, glass: N-BK7}, {radius: -40, diameter: 40}]}"


def test_doubts_about_the_lens_are_those_of_the_scene(load: Load) -> None:
    lens = LENS.replace("dgauss-50mm", CROSSED)
    (warning,) = load(SMALL, f"camera={lens}}}").warnings
    assert warning.startswith("surfaces 0 and 1 cross: they overlap by 9.718 mm")


def test_what_a_lens_opens_to_is_told_where_its_marked_f_number_is_requested(load: Load) -> None:
    (warning,) = load(SMALL, f"camera={LENS}, f_number: 2}}").warnings
    assert warning == "Double Gauss 50 mm f/2: is marked f/2 and opens to f/2.03, which is taken"
    for number in (2.03, 2.8):
        assert load(SMALL, f"camera={LENS}, f_number: {number}}}").warnings == ()


def test_ghosts_of_what_moves_are_warned_of(load: Load) -> None:
    assert load(SMALL, f"camera={LENS}, {GHOSTS}}}").warnings == ()
    assert load(SMALL, f"camera={LENS}, {MOVING}}}").warnings == ()
    assert load(SMALL, f"camera={LENS}, {GHOSTS}, {MOVING}}}", "shutter.open_s=2").warnings == ()  # it has arrived
    (warning,) = load(SMALL, f"camera={LENS}, {GHOSTS}, {MOVING}}}").warnings
    assert warning.startswith("camera.motion: ghosts stand where they are when the shutter opens")
    (warning,) = load(SMALL, f"camera={LENS}, {GHOSTS}}}", LAMP, PUSHED).warnings
    assert warning.endswith("so that what it lights is noisy, and it makes no ghosts")
