"""Tables of `.cube` files and views of OpenColorIO: closed forms, and OpenColorIO itself."""

import pickle
import sys

import numpy as np
import pytest

from rptcam_cl.api.compiling import changed_parts
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import Folders
from rptcam_cl.imaging.development import developed_values, srgb_from_linear
from rptcam_cl.imaging.formats import profile
from rptcam_cl.imaging.image import Image, develop, read_film, with_picture_settings
from rptcam_cl.scene.assets.grading import load_table
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.film import PictureSettings
from rptcam_cl.scene.load import load_picture, load_scene

ROUNDING = 5e-7  # some steps of float32 below 1
SCENE = {"camera": {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40}}


def cube(rows, size="LUT_3D_SIZE", head=""):
    count = len(rows) if size == "LUT_1D_SIZE" else round(len(rows) ** (1 / 3))
    return f"{head}{size} {count}\n" + "\n".join(" ".join(f"{value:.9g}" for value in row) for row in rows) + "\n"


def lattice(size, function=lambda colours: colours):
    blue, green, red = np.meshgrid(*[np.linspace(0, 1, size)] * 3, indexing="ij")
    return function(np.stack([red, green, blue], axis=-1).reshape(-1, 3))


def colours(count=2000, low=-0.2, high=1.2):
    values = np.random.default_rng(3).uniform(low, high, (1, count, 3)).astype(np.float32)
    values[0, :3] = 0, 1, 0.5  # corners and a plane of the lattice
    return values


@pytest.fixture
def table(tmp_path):
    def made(text):
        (tmp_path / "t.cube").write_text(text)
        return load_table("t.cube", Folders(tmp_path))

    return made


@pytest.mark.parametrize("size", [2, 5, 17])
def test_identity_of_a_lattice_leaves_values_and_clips_at_its_domain(table, size):
    values = colours()
    np.testing.assert_allclose(table(cube(lattice(size))).apply(values), values.clip(0, 1), rtol=0, atol=ROUNDING)


def test_lattice_is_exact_for_linear_mixtures_and_a_domain_scales_it(table):
    mix = np.array([[0.8, 0.1, 0.1], [0.2, 0.5, 0.3], [-0.4, 0.2, 1.5]])
    text = cube(lattice(4, lambda values: values @ mix.T), head="# film\nDOMAIN_MIN -1 0 0\nDOMAIN_MAX 3 2 1\n")
    values = colours(low=0.0, high=1.0)
    expected = (values - [-1, 0, 0]) / [4, 2, 1] @ mix.T
    np.testing.assert_allclose(table(text).apply(values), expected, rtol=0, atol=2 * ROUNDING)


def test_curves_are_straight_between_their_points_and_stand_before_a_lattice(table):
    rows = np.stack([np.linspace(0, 1, 9) ** power for power in (0.5, 1, 2)], axis=-1)
    values = colours()
    expected = np.stack([np.interp(values[..., i], np.linspace(0, 1, 9), rows[:, i]) for i in range(3)], axis=-1)
    curves = cube(rows, "LUT_1D_SIZE")
    np.testing.assert_allclose(table(curves).apply(values), expected, rtol=0, atol=ROUNDING)
    head, own = curves.split("\n", 1)
    both = f"{head}\nLUT_3D_SIZE 2\nLUT_3D_INPUT_RANGE 0 2\n{own}" + cube(lattice(2)).split("\n", 1)[1]
    np.testing.assert_allclose(table(both).apply(values), expected / 2, rtol=0, atol=ROUNDING)


def test_lattice_is_that_of_opencolorio(table, tmp_path):
    ocio = pytest.importorskip("PyOpenColorIO")
    rows = np.random.default_rng(1).uniform(-0.5, 1.5, (7**3, 3))
    text = cube(rows, head="DOMAIN_MIN -0.1 0 0.1\nDOMAIN_MAX 1.1 1 0.9\n")
    values, ours = colours(), table(text)
    transform = ocio.FileTransform(src=str(tmp_path / "t.cube"), interpolation=ocio.INTERP_TETRAHEDRAL)
    theirs = values.copy()
    ocio.Config.CreateRaw().getProcessor(transform).getDefaultCPUProcessor().applyRGB(theirs)
    np.testing.assert_allclose(ours.apply(values), theirs, rtol=0, atol=5e-6)  # slopes of 12 in a cell; both float32


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("1 0 1", "1 0"), r"t\.cube:7: does not hold 3 numbers \(got '1 0'\)"),
        (("1 0 1", "1 nan 1"), r"t\.cube:7: does not hold 3 numbers"),
        (("1 0 1\n", ""), r"t\.cube:8: ends after 7 rows \(got 7; LUT_3D_SIZE 2 needs 8\)"),
        (("1 0 1", "1 0 1\n1 0 1"), r"t\.cube:10: goes on after 8 rows"),
        (("SIZE 2", "SIZE 500"), r"t\.cube:1: LUT_3D_SIZE is out of range \(got '500'; allowed: 2 to 129\)"),
        (("LUT_3D_SIZE", "LUT_3D_SIZ"), r"t\.cube:1: unknown key; did you mean LUT_3D_SIZE\?"),
        (("LUT_3D", "DOMAIN_MIN 0 1 0\nLUT_3D"), r"t\.cube:1: the domain is empty"),
        (("LUT_3D_SIZE 2\n", ""), r"t\.cube:8: has no size"),
    ],
)
def test_wrong_tables_say_file_and_line(table, change, said):
    good = cube(lattice(2))
    assert change[0] in good
    with pytest.raises(InputError, match=said):
        table(good.replace(*change, 1))


def test_table_of_a_scene_is_applied_to_display_values_and_read_from_its_folder_alone(tmp_path, monkeypatch):
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "negative.cube").write_text(cube([(1, 1, 1), (0, 0, 0)], "LUT_1D_SIZE"))
    scene = load_scene({**SCENE, "picture": {"lut": "negative.cube", "ev": 1}}, base_dir=folder)
    pixels = colours(low=0.0, high=1.0)
    expected = 1 - srgb_from_linear(2 * pixels)
    np.testing.assert_allclose(developed_values(pixels, scene.picture), expected, rtol=0, atol=ROUNDING)
    plain = set_keys(scene, {"picture.lut": None})
    assert plain.picture_hash() != scene.picture_hash()
    (folder / "negative.cube").write_text(cube([(1, 1, 1), (0, 0, 0.5)], "LUT_1D_SIZE"))
    edited = set_keys(scene, {"picture.ev": 1})
    assert edited.picture_hash() != scene.picture_hash()
    assert changed_parts(scene, edited) == ("picture",)  # so that sessions and the viewfinder show it
    assert changed_parts(edited, set_keys(edited, {"picture.ev": 1})) == ()

    monkeypatch.chdir(tmp_path)
    image = with_picture_settings(Image(pixels), scene.picture)  # which knows its table wherever it is
    np.testing.assert_array_equal(develop(image, ev=1).developed(), image.developed())
    image.save(folder / "film.exr")
    with pytest.raises(InputError, match=r"picture\.lut: no such file"):
        develop(folder / "film.exr")
    bare = develop(folder / "film.exr", ["picture.lut=null"]).developed()
    np.testing.assert_allclose(bare, srgb_from_linear(2 * pixels), rtol=0, atol=ROUNDING)
    with pytest.raises(InputError, match="lies outside the scene's folder"):
        load_scene({**SCENE, "picture": {"lut": "../t.cube"}}, base_dir=folder)
    with pytest.raises(InputError, match="is for display values"):
        load_scene({**SCENE, "picture": {"lut": "negative.cube", "tone": "linear"}}, base_dir=folder)


CONFIG = """ocio_profile_version: 2
search_path: luts
roles: {scene_linear: lin, aces_interchange: aces}
displays:
  sRGB: [!<View> {name: Film, colorspace: film}]
  Wall: [!<View> {name: Film, colorspace: film}]
file_rules: [!<Rule> {name: Default, colorspace: lin}]
looks: [!<Look> {name: warm, process_space: lin, transform: !<CDLTransform> {slope: [1.5, 1, 0.5]}}]
colorspaces:
  - !<ColorSpace>
    name: lin
    from_scene_reference: !<BuiltinTransform> {style: "ACES-AP0_to_CIE-XYZ-D65_BFD"}
  - !<ColorSpace> {name: aces}
  - !<ColorSpace>
    name: film
    from_scene_reference: !<FileTransform> {src: halve.cube}
"""


@pytest.fixture
def studio(tmp_path):
    """The folder of a config with a table beside it."""
    pytest.importorskip("PyOpenColorIO")
    (tmp_path / "luts").mkdir()
    (tmp_path / "luts" / "halve.cube").write_text(cube([(0, 0, 0), (0.5, 0.5, 0.5)], "LUT_1D_SIZE"))
    text = CONFIG.replace('"ACES-AP0_to_CIE-XYZ-D65_BFD"', '"UTILITY - ACES-AP0_to_CIE-XYZ-D65_BFD"')
    (tmp_path / "config.ocio").write_text(text)
    return tmp_path


@pytest.mark.parametrize("view", [None, "Un-tone-mapped"])
def test_view_is_that_of_opencolorio(view):
    ocio = pytest.importorskip("PyOpenColorIO")
    pixels = (2.0 ** np.random.default_rng(4).uniform(-12, 8, (1, 500, 3))).astype(np.float32)
    pixels[0, 0] = np.nan, -0.5, np.inf
    shown = developed_values(pixels, PictureSettings(ocio={"view": view}, ev=-1))
    config = ocio.Config.CreateFromFile("ocio://default")
    display = config.getDefaultDisplay()
    view = view or config.getDefaultView(display)
    expected = pixels[0, 1:] / 2
    transform = ocio.DisplayViewTransform(src="Linear Rec.709 (sRGB)", display=display, view=view)
    config.getProcessor(transform).getDefaultCPUProcessor().applyRGB(expected)
    np.testing.assert_allclose(shown[0, 1:], expected.clip(0, 1), rtol=0, atol=2e-5)  # other order of matrices
    assert np.isfinite(shown).all()
    if view == "Un-tone-mapped":
        np.testing.assert_allclose(shown[0, 1:], srgb_from_linear(pixels[0, 1:] / 2), rtol=0, atol=1e-4)


def test_config_of_a_scene_has_its_files_look_and_display(studio, tmp_path):
    pixels = colours(low=0.0, high=1.0)
    to_aces = np.array([[0.4396, 0.3830, 0.1774], [0.0898, 0.8134, 0.0968], [0.0175, 0.1115, 0.8709]])

    def shown(**keys):
        return load_scene({**SCENE, "picture": {"ocio": {"config": "config.ocio", **keys}}}, base_dir=studio).picture

    plain, warm, wall = shown(), shown(look="warm"), shown(display="Wall")
    np.testing.assert_allclose(developed_values(pixels, plain), pixels @ to_aces.T / 2, rtol=0, atol=2e-4)
    assert np.abs(developed_values(pixels, warm) - developed_values(pixels, plain)).max() > 0.05
    assert (plain.is_encoded, wall.is_encoded) == (True, None)
    again = pickle.loads(pickle.dumps(warm))
    np.testing.assert_array_equal(developed_values(pixels, again), developed_values(pixels, warm))
    # The files of a config count by their content.
    (studio / "luts" / "halve.cube").write_text(cube([(0, 0, 0), (0.25, 0.25, 0.25)], "LUT_1D_SIZE"))
    np.testing.assert_allclose(2 * developed_values(pixels, shown()), developed_values(pixels, plain), atol=1e-6)
    assert shown().content_digests() != plain.content_digests()


def test_picture_for_another_display_does_not_say_that_it_is_srgb(studio, tmp_path):
    import PIL.Image

    for display, has in (("sRGB", True), ("Wall", False)):
        picture = load_picture({"ocio": {"config": "config.ocio", "display": display}}, folders=Folders(studio))
        image = with_picture_settings(Image(np.full((8, 8, 3), 0.5, np.float32)), picture)
        for suffix in ("png", "jpg", "tif"):
            image.save(tmp_path / f"{display}.{suffix}")
        assert (b"sRGB" in (tmp_path / f"{display}.png").read_bytes()) is has
        for suffix in ("jpg", "tif"):
            with PIL.Image.open(tmp_path / f"{display}.{suffix}") as file:
                assert file.info.get("icc_profile") == (profile(encoded=True) if has else None)
        image.save(tmp_path / "film.exr")
        np.testing.assert_array_equal(read_film(tmp_path / "film.exr").pixels, image.pixels)


@pytest.mark.parametrize(
    ("keys", "change", "said"),
    [
        ({"view": "Flim"}, (), r"picture\.ocio\.view: is not in the config; did you mean Film\?"),
        ({"display": "TV"}, (), r"picture\.ocio\.display: is not in the config"),
        ({"look": "cold"}, (), r"picture\.ocio\.look: .*'cold', cannot be found"),
        ({}, ("luts", ".."), r"picture\.ocio\.config: .*halve\.cube.* lies outside|could not be located"),
        ({}, ("halve", "none"), r"picture\.ocio\.config: .*none\.cube"),
        ({}, ("roles: {", "roles: ["), r"picture\.ocio\.config: .*line 3, column"),
        ({}, (", aces_interchange: aces", ""), r"picture\.ocio\.config: .*which colours its scene_linear"),
        ({"config": "../config.ocio"}, (), r"picture\.ocio\.config: lies outside the scene's folder"),
        ({"config": "ocio://no"}, (), r"picture\.ocio\.config: .*built-in"),
    ],
)
def test_wrong_views_say_which_key(studio, keys, change, said):
    if change:
        text = (studio / "config.ocio").read_text()
        assert change[0] in text
        (studio / "config.ocio").write_text(text.replace(*change))
    with pytest.raises(InputError, match=said) as caught:
        load_scene({**SCENE, "picture": {"ocio": {"config": "config.ocio", **keys}}}, base_dir=studio)
    assert "\n" not in str(caught.value)


def test_view_takes_the_place_of_the_tone_curve(studio):
    known = {"tone": "agx", "gamut": "desaturate", "ev": 1}
    picture = load_picture(known, ["picture.ocio=ocio://default"])
    assert (picture.tone.kind, picture.gamut, picture.ocio is not None, picture.ev) == ("srgb", "clip", True, 1)
    assert load_picture({"ocio": "ocio://default"}, ["picture.tone=aces"]).ocio is None
    with pytest.raises(InputError, match="cannot be given together with tone"):
        load_picture({"tone": "agx", "ocio": "ocio://default"})


def test_missing_package_is_one_error_that_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "PyOpenColorIO", None)
    with pytest.raises(InputError, match=r'needs the package opencolorio \(pip install "rptcam_cl\[ocio\]"\)'):
        load_picture({"ocio": "ocio://default"})


@pytest.mark.parametrize(
    ("primaries", "space", "name", "red_and_white"),
    [
        ("acescg", "ACEScg", "lin_ap1_scene", (0.713, 0.293, 0.32168, 0.33767)),
        ("rec2020", "Linear Rec.2020", "lin_rec2020_scene", (0.708, 0.292, 0.3127, 0.329)),
    ],
)
def test_film_of_other_primaries_says_so_and_is_read_back(tmp_path, primaries, space, name, red_and_white):
    import OpenEXR

    pixels = colours(high=8.0)
    pixels[0, 0] = 1.0
    layers = {"albedo": pixels / 8, "depth": pixels[..., 0], "lights.key": pixels / 2}
    film = with_picture_settings(Image(pixels, layers=layers), PictureSettings(primaries=primaries))
    film.save(tmp_path / "film.exr")
    with OpenEXR.File(str(tmp_path / "film.exr"), separate_channels=True) as file:
        header, channels = dict(file.header()), file.channels()
        written = np.stack([channels[each].pixels for each in "RGB"], axis=-1)
        albedo = np.stack([channels[f"albedo.{each}"].pixels for each in "RGB"], axis=-1)
        np.testing.assert_array_equal(channels["Z"].pixels, layers["depth"])
    assert header["colorInteropID"] == name
    said = np.ravel(header["chromaticities"])
    np.testing.assert_allclose([*said[:2], *said[6:]], red_and_white, rtol=0, atol=1e-6)
    np.testing.assert_allclose(written[0, 0], 1, rtol=0, atol=2e-7)  # white is white
    np.testing.assert_allclose(albedo, written / 8, rtol=0, atol=2e-7)
    back = read_film(tmp_path / "film.exr")
    np.testing.assert_allclose(back.pixels, pixels, rtol=0, atol=2e-6)
    np.testing.assert_allclose(back["lights.key"], pixels / 2, rtol=0, atol=1e-6)

    ocio = pytest.importorskip("PyOpenColorIO")
    expected = pixels.copy()
    config = ocio.Config.CreateFromFile("ocio://default")
    config.getProcessor("Linear Rec.709 (sRGB)", space).getDefaultCPUProcessor().applyRGB(expected)
    np.testing.assert_allclose(written, expected, rtol=0, atol=5e-6)
