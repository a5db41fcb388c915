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


GLASS, WOOD = "{kind: dielectric}", "{kind: matte, reflectance: 0.5}"
PRISM = (
    "shape: mesh, vertices: [[0, 0, 0], [0.1, 0, 0], [0, 0, 0.1], [0, 0.1, 0], [0.1, 0.1, 0], [0, 0.1, 0.1]],"
    " faces: [[0, 1, 2], [5, 4, 3], [0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2], [2, 5, 3], [2, 3, 0]]"
)
BLOCK = "shape: box, min: [0, 0, 0], max: [0.1, 0.2, 0.1]"
TABLE = "shape: box, min: [-1, -0.05, -1], max: [1, 0, 1]"
RESTING = {
    "prism on a table": (PRISM, TABLE),
    "box on a floor": (BLOCK, "shape: plane, point: [3, 0, 2], normal: [0, 2, 0]"),
    "box on a sheet": (BLOCK, "shape: rectangle, corner: [-0.3, 0, 0.05], edge_u: [1, 0, 0.1], edge_v: [0, 0, -0.7]"),
    "cylinder on a disk": (
        "shape: cylinder, base: [0.3, 0, 0], top: [0.3, 0.2, 0], radius: 0.1",
        "shape: disk, center: [0, 0, 0], normal: [0, -1, 0], radius: 0.21",
    ),
    "cone on a table": ("shape: cone, base: [0.99, 0, 0.2], apex: [0.99, 0.1, 0.2], radius: 0.02", TABLE),
    "plate under a box": ("shape: rectangle, corner: [-1, 0, -1], edge_u: [2, 0, 0], edge_v: [0, 0, 2]", BLOCK),
}
LIFT = "{translate: [0, 1.0e-5, 0]}"
TURNED = "transform: [{rotate: {axis: [1, 2, 3], degrees: 40}}, {translate: [0.1, 0.7, -1]}]"


def two(glass: str, other: str, materials: tuple[str, str] = (GLASS, WOOD)) -> str:
    """Return SMALL with two objects more, of which the second has the name other."""
    return SMALL.replace(
        "environment:",
        f"  - {{{glass}, name: glass, material: {materials[0]}}}\n"
        f"  - {{{other}, name: other, material: {materials[1]}}}\nenvironment:",
    )


@pytest.mark.parametrize("turned", [False, True], ids=["level", "turned"])
@pytest.mark.parametrize("name", RESTING)
def test_glass_that_rests_in_the_plane_of_another_face_is_warned_of(load: Load, name: str, turned: bool) -> None:
    shape, other = (f"{keys}, {TURNED}" if turned else keys for keys in RESTING[name])
    (warning,) = load(two(shape, other)).warnings
    assert warning.startswith("object 'glass', of glass, has a face in one plane with object 'other': rounding decides")
    assert warning.endswith("(lift it off by 0.01 mm)")
    assert load(two(shape, other, (WOOD, WOOD))).warnings == ()
    lifted = TURNED.replace("[{rot", f"[{LIFT}, {{rot") if turned else f"transform: {LIFT}"
    assert load(two(f"{RESTING[name][0]}, {lifted}", other)).warnings == ()


@pytest.mark.parametrize(
    "other",
    [
        "shape: rectangle, corner: [0.1, 0, 0], edge_u: [1, 0, 0], edge_v: [0, 0, 1]",  # beside it, an edge in common
        "shape: disk, center: [-0.3, 0, 0.05], normal: [0, 1, 0], radius: 0.29",
        "shape: box, min: [-1, -1, -1], max: [-0.1, 0, -0.1]",
    ],
)
def test_faces_of_one_plane_that_share_no_part_of_it_are_not_warned_of(load: Load, other: str) -> None:
    assert load(two(BLOCK, other)).warnings == ()


def test_glass_far_from_the_eye_or_in_other_units_is_to_be_lifted_by_more(load: Load) -> None:
    far = "transform: {translate: [0, 0, -50]}"
    (warning,) = load(two(f"{BLOCK}, {far}", f"{TABLE}, {far}")).warnings
    assert warning.endswith("(lift it off by 0.05 mm)")
    (warning,) = load(two(BLOCK, TABLE), "metres_per_unit=0.001").warnings
    assert warning.endswith("(lift it off by 0.01 mm)")


def test_blocks_of_glass_that_touch_are_named_once_and_not_all_of_many(load: Load) -> None:
    beside = "shape: box, min: [-0.2, 0.05, 0], max: [0, 0.15, 0.1]"
    (warning,) = load(two(BLOCK, beside, (GLASS, GLASS))).warnings
    assert "object 'glass'" in warning and "object 'other'" in warning
    prisms = "".join(f"  - {{{PRISM}, transform: {{translate: [{x}, 0, 0]}}, material: {GLASS}}}\n" for x in range(5))
    long = TABLE.replace("max: [1,", "max: [9,")
    *named, more = load(
        SMALL.replace("environment:", f"{prisms}  - {{{long}, material: {WOOD}}}\nenvironment:")
    ).warnings
    assert [each.split(",")[0] for each in named] == [f"objects[{index}]" for index in (1, 2, 3)]
    assert more == "2 more pairs of objects share planes so"
