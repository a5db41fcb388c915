"""Nothing is left out in silence."""

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.exchange.conversion import Place, Report, Source
from rptcam_cl.exchange.pbrt.convert import convert_scene
from rptcam_cl.scene.load import load_scene
from tests.exchange.pbrt.conftest import HEAD
from tests.exchange.pbrt.test_materials import png

Convert = Callable[..., Any]
BALL = 'Shape "sphere"\n'

# Before WorldBegin and after it: text and what the report says of it.
OPTIONS = {
    'PixelFilter "gaussian" "float xradius" 2': "the same radius along x and y",
    'PixelFilter "gaussian" "float xradius" 2 "float yradius" 2': "ends 3 standard deviations out, at 1.5 pixels",
    'PixelFilter "mitchell" "float B" .5': "B and C as 1/3",
    'PixelFilter "sinc"': "Mitchell's filter of radius 2",
    'PixelFilter "box" "float other" 1': 'ignored: PixelFilter "box": "float other"',
    'Accelerator "kdtree"': 'ignored: Accelerator "kdtree"',
    'Option "bool disablepixeljitter" true': "ignored: Option",
    'Integrator "bdpt"': 'approximated: Integrator "bdpt": paths from the camera only',
    'Integrator "ao" "float maxdistance" 2': "another picture than paths of light give",
    'Integrator "path" "bool regularize" true': 'ignored: Integrator "path": "bool regularize"',
    'Integrator "volpath"': 'approximated: Integrator "volpath": paths without media',
    'Camera "orthographic" "float lensradius" 1': "the lens radius of a parallel view",
    'Camera "spherical"': "longitude and latitude in place of the equal-area square",
    'Camera "environment"': "the film becomes 1440 x 720 pixels, twice as wide as high",
    'Scale 2 1 1 Camera "environment"': "ignored: uneven scaling of the camera's space",
    'Sampler "sobol" Sampler "halton"': "ignored: Sampler: a later one takes its place",
    'Sampler "halton" "float other" 2': 'ignored: Sampler "halton": "float other"',
    'Film "rgb" "float maxcomponentvalue" 5': 'ignored: Film "rgb": "float maxcomponentvalue"',
    'Film "rgb" "string sensor" "canon_eos_5d"': 'ignored: the sensor "canon_eos_5d"',
    'Film "rgb" "float iso" 200': "sensor (exposure time x ISO / 100) of 2 goes to picture.ev",
    'Film "image" "float scale" 4': "scale of 4 goes to picture.ev",
    'Camera "perspective" "float other" 1': 'ignored: Camera "perspective": "float other"',
}
WORLD = {
    'MakeNamedMedium "f" "string type" "cloud" MediumInterface "f" "" Material "dielectric" Shape "sphere"': (
        'media of the type "cloud"'
    ),
    'LightSource "infinite" "point3 portal" [0 0 0 1 0 0 1 1 0 0 1 0]': 'ignored: LightSource "infinite": its portal',
    'LightSource "point" "float other" 1': 'ignored: LightSource "point": "float other"',
    'Shape "sphere" "float other" 1': 'ignored: Shape "sphere": "float other"',
    'Attribute "shape" "float other" 1 Shape "sphere"': '"float other"',
    'Material "diffuse" "float other" 1 Shape "sphere"': 'ignored: Material "diffuse": "float other"',
    'Texture "t" "spectrum" "constant" "float other" 1 Material "diffuse" "texture reflectance" "t" Shape "sphere"': (
        'ignored: Texture "t" "spectrum" "constant": "float other"'
    ),
    'ObjectBegin "o" Shape "sphere" ObjectEnd Shape "sphere"': 'object "o" is never placed',
    'ObjectBegin "o" ObjectEnd ObjectBegin "o" ObjectEnd Shape "sphere"': 'note: object "o" is defined again',
    'MakeNamedMaterial "m" "string type" "mirror" MakeNamedMaterial "m" "string type" "mirror"': (
        'note: material "m" is defined again'
    ),
    'AreaLightSource "diffuse" "float power" 5 Shape "paraboloid"': '"power" of a shape whose area is not known',
    'LightSource "point" "xyz I" [0 1 0]': 'approximated: LightSource "point": "I" lies outside sRGB; cut at 0',
    'Material "mirror" "string normalmap" "a.png" Shape "sphere"': 'Material "mirror": the normal map a.png',
    'Material "diffuse" "string normalmap" "a.gif" Shape "sphere"': 'Material "diffuse": the normal map a.gif',
    'AreaLightSource "diffuse" "string filename" "a.exr" Shape "sphere"': "the picture that it shines with",
    'AreaLightSource "diffuse" Shape "sphere" "float alpha" .5': "alpha of a lamp",
}


@pytest.mark.parametrize("text", OPTIONS)
def test_every_option_that_is_left_out_is_reported(convert: Convert, text: str) -> None:
    head = f'Camera "perspective"\n{text}\nWorldBegin\n'
    if text.startswith("Camera"):
        head = f"\n{text}\nWorldBegin\n"
    done = convert(BALL, head)
    assert done.says("in.pbrt:2: ", OPTIONS[text]), done.report


@pytest.mark.parametrize("text", WORLD)
def test_everything_of_the_world_that_is_left_out_is_reported(convert: Convert, text: str) -> None:
    done = convert(text, **{"a.png": png(), "a.gif": b"x"})
    assert done.says("in.pbrt:5: ", WORLD[text]), done.report


@pytest.mark.parametrize("text", ['Integrator "path"', 'Integrator "simplepath"', 'Sampler "halton" "integer seed" 3'])
def test_options_that_change_no_picture_are_not_reported(convert: Convert, text: str) -> None:
    assert convert(BALL, f'Camera "perspective"\n{text}\nWorldBegin LightSource "infinite"\n').report == []


WRONG_OPTIONS = {
    'Film "rgb" "integer xresolution" 0': "the resolution must be at least 1 x 1 (got 0 x 720)",
    'Film "rgb" "integer yresolution" 0': "the resolution must be at least 1 x 1 (got 1280 x 0)",
    'Film "rgb" "float xresolution" 1.5': '"xresolution" must be a whole number (got 1.5)',
    'Film "rgb" "float cropwindow" [0 1 0]': "a window needs 4 numbers, x0 x1 y0 y1",
    'Film "rgb" "integer pixelbounds" [0 1 0]': "a window needs 4 numbers, x0 x1 y0 y1",
    'Film "rgb" "float cropwindow" [.5 .5 0 1]': "the window to render is empty",
    'Film "rgb" "float cropwindow" [0 1 .5 .5]': "the window to render is empty",
    'Sampler "halton" "integer pixelsamples" 0': "needs at least 1 sample per pixel (got 0)",
    'Sampler "stratified" "integer xsamples" 0': "needs at least 1 sample per pixel (got 0)",
    'Integrator "path" "integer maxdepth" -1': "maxdepth must not be negative (got -1)",
}


@pytest.mark.parametrize("text", WRONG_OPTIONS)
def test_wrong_options_are_refused(convert: Convert, text: str) -> None:
    with pytest.raises(InputError, match=r"^in\.pbrt:2:|/in\.pbrt:2:") as problem:
        convert(BALL, f'Camera "perspective"\n{text}\nWorldBegin\n')
    assert WRONG_OPTIONS[text] in str(problem.value)


def test_a_scene_of_what_ours_has_is_reported_with_nothing(convert: Convert) -> None:
    text = 'LightSource "infinite" "rgb L" [1 1 1] Material "diffuse" "rgb reflectance" [.5 .5 .5] ' + BALL
    assert convert(text).report == []


def test_defaults_of_attributes_are_those_of_what_follows(convert: Convert) -> None:
    text = 'Attribute "shape" "float radius" 3 Shape "sphere" Shape "sphere" "float radius" 2'
    assert [item["radius"] for item in convert(text).objects] == [3, 2]


def test_a_message_names_its_lines() -> None:
    report = Report()
    source = Source("a.pbrt", "\n" * 50, Path("a.pbrt"))
    for line in (20, 3, 4, 3, *range(30, 40)):
        report.ignored(Place(source, line - 1), "hair")
    report.noted(Place(source, 1), "first")
    assert list(report) == [
        "a.pbrt:2: note: first",
        "a.pbrt:3: ignored: hair (also on 4, 20, 30, 31, 32, 33, 34, 35 and 4 more)",
    ]
    assert len(report) == 2


def test_settings_of_the_picture(convert: Convert) -> None:
    head = (
        'Camera "perspective" Sampler "stratified" "integer xsamples" 3 "integer ysamples" 5 '
        'Integrator "path" "integer maxdepth" 7 Film "image" "float scale" 8\nWorldBegin\n'
    )
    scene = convert(BALL, head).scene
    assert (scene.render.spp, scene.render.max_depth, scene.picture.ev) == (15, 8, 3)
    assert scene.film.resolution == (1280, 720)
    defaults = convert(BALL, 'Camera "perspective" WorldBegin\n').scene
    assert (defaults.render.spp, defaults.render.max_depth) == (16, 6)
    assert (defaults.film.resolution, defaults.film.crop) == ((1280, 720), None)
    options = 'Sampler "stratified" "integer xsamples" 1 "integer ysamples" 1 Integrator "path" "integer maxdepth" 0'
    least = convert(BALL, f'{options} Camera "perspective" WorldBegin\n').scene.render
    assert (least.spp, least.max_depth) == (1, 1)
    assert not least.multiple_scattering  # pbrt's facets lose that light
    default = convert(BALL, 'Sampler "stratified" Camera "perspective" WorldBegin\n').scene.render
    assert default.spp == 16


@pytest.mark.parametrize(
    ("options", "stops"),
    [
        ('Film "rgb" "float iso" 400 Camera "perspective" "float shutteropen" .25 "float shutterclose" .5', 0.0),
        ('Film "rgb" "float iso" 200 Camera "perspective" "float shutterclose" 4', 3.0),
        ('Film "rgb" "float iso" 0 Camera "perspective"', 0.0),
        ('Film "rgb" "float scale" 8 Camera "perspective"', 0.0),  # of pbrt-v3 only
        ('Film "image" "float scale" .5 Camera "perspective" "float shutterclose" 4', -1.0),
    ],
)
def test_exposure_goes_to_the_picture(convert: Convert, options: str, stops: float) -> None:
    done = convert(BALL, f'{options} WorldBegin LightSource "infinite"\n')
    assert done.keys.get("picture") == ({"ev": stops} if stops else None)
    assert done.says("goes to picture.ev") == bool(stops)


FILTERS = {
    "": {"kind": "gaussian", "radius_px": 1.5},  # the default of pbrt-v4
    'PixelFilter "gaussian"': {"kind": "gaussian", "radius_px": 1.5},
    'PixelFilter "gaussian" "float sigma" .25 "float xradius" .75 "float yradius" .75': {
        "kind": "gaussian", "radius_px": 0.75},
    'PixelFilter "box"': None,
    'PixelFilter "box" "float xradius" 1 "float yradius" 1': {"kind": "box", "radius_px": 1.0},
    'PixelFilter "triangle"': {"kind": "tent", "radius_px": 2.0},
    'PixelFilter "mitchell"': {"kind": "mitchell", "radius_px": 2.0},
    'Film "image"': None,  # the default of pbrt-v3 is a box
    'Film "image" PixelFilter "gaussian" "float alpha" 8 "float xwidth" .75 "float ywidth" .75': {
        "kind": "gaussian", "radius_px": 0.75},
}  # fmt: skip


@pytest.mark.parametrize("text", FILTERS)
def test_filters_are_those_of_pbrt(convert: Convert, text: str) -> None:
    done = convert(BALL, f'Camera "perspective" {text}\nWorldBegin LightSource "infinite"\n')
    assert done.keys["film"].get("filter") == FILTERS[text]
    assert done.report == []


@pytest.mark.parametrize("text", ['"wavelet"', '"box" "float xradius" 0', '"gaussian" "float alpha" 0'])
def test_bad_filters_are_told(convert: Convert, text: str) -> None:
    with pytest.raises(InputError, match=r"in\.pbrt:1:"):
        convert(BALL, f'PixelFilter {text} Camera "perspective"\nWorldBegin\n')


TREE = (
    HEAD
    + """
Texture "c" "spectrum" "checkerboard" "rgb tex1" [.1 .1 .1] "float uscale" 4
MakeNamedMaterial "m" "string type" "conductor" "spectrum eta" "metal-Au-eta" "float roughness" .1
AttributeBegin
  Material "diffuse" "texture reflectance" "c"
  Rotate 30 0 1 0
  Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "integer indices" [0 1 2]
AttributeEnd
NamedMaterial "m"
Shape "sphere" "float radius" .5 "bool flag" true # end
LightSource "point" "blackbody I" [3000] "float power" 10
Texture "w" "color" "uv" Texture "s" "color" "scale" "texture tex1" "w" "color tex2" [.5 .4 .3]
Texture "x" "spectrum" "mix" "texture tex1" "s" "rgb amount" [.1 .2 .3]
Material "shinymetal" "color Ks" [.5 .4 .3] "texture Kr" "x" Scale 1 2 3 Shape "disk" "float radius" 1 "float radius" 2
"""
)


def test_spoilt_scenes_are_converted_or_refused_in_one_line(tmp_path: Path) -> None:
    rng = random.Random(7)
    words = ["[", "]", '"', "#", "-1", "0", "1e30", "nan", "AttributeEnd", '"float"', '"rgb L"', "Shape", "\\", "é"]
    source = tmp_path / "in.pbrt"
    outcomes = {"converted": 0, "refused": 0}
    for _ in range(200):
        text = TREE
        for _ in range(rng.randint(1, 2)):
            at = rng.randrange(len(text))
            text = text[:at] + rng.choice([*words, ""]) + text[at + rng.choice([0, 1, 8]) :]
        source.write_text(text, "utf-8")
        try:
            convert_scene(source, tmp_path / "out.yaml")
            outcomes["converted"] += 1
        except InputError as problem:
            assert "in.pbrt" in str(problem)
            assert "\n" not in str(problem)
            outcomes["refused"] += 1
        except RptcamError as problem:  # a file that is not there, say
            assert "\n" not in str(problem)
    assert min(outcomes.values()) > 20


def test_the_example_is_converted_without_a_word(checkout: Path, tmp_path: Path) -> None:
    done = convert_scene(checkout / "examples" / "still_life.pbrt", tmp_path / "still_life.yaml")
    assert list(done.report) == []
    done.write(tmp_path / "still_life.yaml")
    scene = load_scene(tmp_path / "still_life.yaml")
    assert len(scene.objects) == 28
    assert scene.warnings == ()
