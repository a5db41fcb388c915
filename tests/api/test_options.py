"""The table of the options of a render agrees with all that takes them: `render`, its docstring, cluster, session."""

import inspect
import re
from dataclasses import fields

import pytest

import rptcam_cl
from rptcam_cl.api.job import RenderOptions
from rptcam_cl.api.options import NOT_WITH, OF_A_CLUSTER, RENDER_OPTIONS, SCENE_KEYS
from rptcam_cl.batch.cluster_run import render_on_cluster
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

NAMES = {option.name for option in RENDER_OPTIONS}
KEYWORDS_ALONE = {"checkpoint", "wave_size", "numerics", "neighbours", "on_progress", "should_stop"}  # no option sets
KEYWORDS = [name for name in inspect.signature(rptcam_cl.render).parameters if name != "scene"]


def test_keywords_of_render_are_options_of_the_table_or_named_beside_it() -> None:
    assert set(KEYWORDS) - NAMES == KEYWORDS_ALONE
    assert [each.name for each in fields(RenderOptions)] == KEYWORDS


def test_docstring_of_render_explains_every_keyword_once() -> None:
    parameters = inspect.getdoc(rptcam_cl.render).partition("Parameters\n")[2].partition("Raises\n")[0]
    explained = [name for line in re.findall(r"^(\w[\w, ]*)$", parameters, re.MULTILINE) for name in line.split(", ")]
    assert explained == ["scene", *KEYWORDS]


def test_a_cluster_takes_the_options_that_replace_keys_of_the_scene() -> None:
    taken = inspect.signature(render_on_cluster).parameters
    assert set(OF_A_CLUSTER) == set(SCENE_KEYS) & set(taken)
    assert set(OF_A_CLUSTER) == set(SCENE_KEYS) - {"noise"}


@pytest.mark.parametrize("name", SCENE_KEYS)
def test_key_that_an_option_replaces_is_one_of_scenes(name: str) -> None:
    section, key = SCENE_KEYS[name].split(".")
    assert key in Scene.model_fields[section].annotation.model_fields


def test_options_replace_keys_of_the_scene_and_leave_the_rest() -> None:
    scene = load_scene(
        {
            "camera": {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40},
            "objects": [
                {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": {"kind": "matte", "reflectance": 0.5}}
            ],
        }
    )
    given = {"spp": 3, "seed": 5, "size": (12, 8), "crop": (0, 0.5, 0, 0.5), "layers": ["depth"], "noise": 0.1}
    changed = RenderOptions(**given).apply_to(scene)
    render, film = changed.render, changed.film
    assert (render.spp, render.seed, render.layers, render.noise) == (3, 5, ("depth",), 0.1)
    assert (film.resolution, film.crop) == ((12, 8), (0, 0.5, 0, 0.5))
    assert changed.objects == scene.objects
    assert RenderOptions().apply_to(scene) is scene


def test_names_flags_and_modes_are_what_they_should_be() -> None:
    flags = [flag for option in RENDER_OPTIONS for flag in option.flags.split()]
    assert len(flags) == len(set(flags))
    assert len(NAMES) == len(RENDER_OPTIONS)
    assert {mode for option in RENDER_OPTIONS for mode in option.not_with.split()} == set(NOT_WITH)


@pytest.mark.parametrize(("name", "value"), [("seconds", 1.0), ("noise", 0.1), ("denoise", True)])
def test_part_goes_with_nothing_that_needs_the_whole_film(name: str, value: object) -> None:
    with pytest.raises(InputError, match=rf"{name}: needs the whole film \(allowed: without part and samples\)"):
        RenderOptions(part="1/2", **{name: value})
