"""The table of the options of a render agrees with all that takes them: `render`, its docstring, cluster, session."""

import argparse
import inspect
import re
from collections.abc import Callable
from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import pytest

import rptcam_cl
from rptcam_cl.api import options
from rptcam_cl.api.options import NOT_WITH, OF_A_CLUSTER, RENDER_OPTIONS, SCENE_KEYS, RenderOptions
from rptcam_cl.batch.cluster_run import render_on_cluster
from rptcam_cl.core import MAX_SPP
from rptcam_cl.core.errors import InputError
from rptcam_cl.device import devices as opencl
from rptcam_cl.scene.film import SINGLE_LAYERS
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


WORDS: list[tuple[Callable[[str], Any], dict[str, Any], list[str]]] = [
    (options.spp, {"1": 1, "1e6": 1_000_000, "3.0": 3, str(MAX_SPP): MAX_SPP},
     ["0", "-1", "1.5", "x", "", str(MAX_SPP + 1), "inf", "nan"]),
    (options.seed, {"0": 0, str(2**64 - 1): 2**64 - 1}, ["-1", str(2**64), "1e3", "1.0"]),
    (options.share, {"0.02": 0.02, "2%": 0.02, " 50 % ": 0.5, "1e-3": 1e-3}, ["0", "1", "100%", "-1%", "nan", "2%%"]),
    (options.duration, {"60": 60, "60s": 60, "2min": 120, "2m": 120, "1h": 3600, "1h30m": 5400, "1m30s": 90,
                        "1h 2 min 3s": 3723, "1e3": 1000, "1e9": 1e9},
     ["0", "0s", "-1", "1d", "", "s", "1s2m", "1.2.3s", "1e10", "nan"]),
    (options.number(options.digits, 1, 12, "1 to 12"), {"1": 1, "12": 12, "007": 7},
     ["0", "13", "-1", "+1", "1_0", " 7", "²", "1.0", ""]),
    (options.sample_range, {"0:1": (0, 1), "64:128": (64, 128), f"0:{MAX_SPP}": (0, MAX_SPP)},
     ["1:1", "2:1", "1", "0:", "a:b", "-1:2", f"0:{MAX_SPP + 1}", "0:1:2"]),
    (options.part, {"1/1": "1/1", "8/8": "8/8", "3/8": "3/8"}, ["0/8", "9/8", "1", "1/0", "-1/2", "a/b"]),
    (options.size, {"640x360": (640, 360), "1X1": (1, 1)}, ["0x1", "1x0", "640", "640x", "-1x1", "1.5x1"]),
    (options.crop, {"0,1,0,1": (0, 1, 0, 1), "0.25,0.5,0.75,1": (0.25, 0.5, 0.75, 1)},
     ["0,0,0,1", "0,1,1,1", "-1,1,0,1", "0,1.1,0,1", "0,1,0", "0,1,0,1,1", "a,1,0,1", "0,1,-1,1", "0,1,0,2"]),
    (options.layers, {"depth": ("depth",), "depth, normal": ("depth", "normal"), "all": SINGLE_LAYERS},
     ["depht", "depth,depth", "depth,", "", "all,depth"]),
    (options.frame_range, {"7": range(7, 8), "1-240": range(1, 241), "1-240:2": range(1, 241, 2), "5-5:9": range(5, 6)},
     ["0", "0-3", "3-2", "1-5:0", "a", "1-", "-3", "12345678", "1-2-3"]),
]  # fmt: skip


@pytest.mark.parametrize(("read", "values", "refused"), WORDS, ids=[str(k) for k in range(len(WORDS))])
def test_words_of_the_command_line_are_what_they_say(
    read: Callable[[str], Any], values: dict[str, Any], refused: list[str]
) -> None:
    for word, value in values.items():
        assert read(word) == (pytest.approx(value) if isinstance(value, float) else value)
    for word in refused:
        with pytest.raises(argparse.ArgumentTypeError, match="allowed") as caught:
            read(word)
        assert word.split(",")[0] in str(caught.value)


def test_a_layer_that_is_not_known_is_told_the_nearest() -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=r"^got depht; did you mean depth\?; allowed all, "):
        options.layers("depht")


@pytest.mark.parametrize(("function", "wrong"), [(rptcam_cl.render, "ssp"), (render_on_cluster, "noise")])
def test_keywords_that_a_function_does_not_take_are_refused(function: Callable[..., Any], wrong: str) -> None:
    with pytest.raises(TypeError, match=f"got an unexpected keyword argument '{wrong}'"):
        function({}, **{wrong: 1})


@pytest.mark.parametrize("usable", [True, False])
def test_devices_tell_which_one_is_taken_and_what_is_wrong_with_others(
    monkeypatch: pytest.MonkeyPatch, usable: bool
) -> None:
    facts = {"name": "n", "platform": "p", "type": "cpu", "compute_units": 2, "memory_bytes": 3, "fp64": True}
    listed = [SimpleNamespace(id=name, **facts) for name in ("0:0", "0:1")]
    monkeypatch.setattr(opencl, "list_devices", lambda: listed)
    monkeypatch.setattr(opencl, "problem_of", lambda device: None if usable and device is listed[1] else "broken")
    monkeypatch.setattr(opencl, "choose_device", lambda name: listed[1])
    first, second = opencl.devices()
    assert first == {"id": "0:0", **facts, "problem": "broken", "default": False}
    assert second == {"id": "0:1", **facts, "problem": None if usable else "broken", "default": usable}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"spp": 3, "samples": (0, 4)}, "spp: does not go with samples, which say where they end"),
        ({"part": "9/8"}, "part: is none (got 9/8; allowed: as 3/8, from 1/8 to 8/8)"),
        ({"samples": (4, 4)}, "samples: are out of range (got 4:4; allowed: as 0:64)"),
        ({"samples": (-1, 4)}, "samples: are out of range (got -1:4"),
        ({"samples": (0, MAX_SPP)}, f"samples: are out of range (got 0:{MAX_SPP}"),
        ({"seconds": 0}, "seconds: is out of range"),
        ({"seconds": float("inf")}, "seconds: is out of range"),
    ],
)
def test_options_that_exclude_each_other_or_are_out_of_range_are_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match="^" + re.escape(message)):
        RenderOptions(**given)


@pytest.mark.parametrize("given", [{"seconds": 1e-3}, {"samples": (0, 1)}, {"samples": (MAX_SPP - 2, MAX_SPP - 1)}])
def test_options_at_the_ends_of_their_ranges_are_taken(given: dict[str, Any]) -> None:
    assert {name: getattr(RenderOptions(**given), name) for name in given} == given


def test_merge_needs_a_part() -> None:
    with pytest.raises(InputError, match=r"^parts: there are none"):
        rptcam_cl.merge([])
