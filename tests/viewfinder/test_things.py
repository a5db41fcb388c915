"""Things are selected through the lens and turned by dials, lamps are muted and shine alone; all of it is undone."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import rptcam_cl
from rptcam_cl.imaging.image import read_film
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.viewfinder.panel import Panel, read_dials
from rptcam_cl.viewfinder.things import add_thing, fields_of, lamps_of, switch_lamp, turn_thing, viewpoint_of
from tests.viewfinder.page_client import Page, at_rest, reset_page, serving_text

SCENE = """
film: {resolution: [48, 32], width_mm: 36}
camera: {kind: realistic, lens: dgauss-50mm, eye: [0, 0, 1], target: [0, 0, 0], focus: {distance_m: 0.95}}
render: {spp: 8, max_depth: 2}
materials:
  white: {kind: matte, reflectance: [0.7, 0.6, 0.5]}
  shiny: {kind: plastic, reflectance: [0.1, 0.2, 0.3], roughness: 0.2}
  warm: {kind: emissive, radiance: [4, 3, 2]}
objects:
  - {shape: sphere, center: [-0.1, 0, 0], radius: 0.08, material: white}
  - name: ball
    shape: sphere
    center: [0, 0, 0]
    radius: 0.05
    material: shiny
    transform: {translate: [0.12, 0.02, 0]}
  - {shape: disk, center: [0, 1, 0], normal: [0, -1, 0], radius: 0.3, material: warm}
lights:
  - {kind: point, position: [0.3, 0.5, 0.5], intensity: [1, 1, 1]}
environment: {kind: constant, radiance: [0.4, 0.5, 0.6]}
"""


def panel(**changes: Any) -> Panel:
    scene = rptcam_cl.load_scene(yaml.safe_load(SCENE), [f"{key}={value}" for key, value in changes.items()])
    return Panel(read_dials(scene), scene, scene)


def turned(panel: Panel, thing: str, name: str, value: float | str) -> rptcam_cl.Scene:
    return set_keys(panel.scene, turn_thing(panel, thing, name, value).changes)


def value(panel: Panel, thing: str, name: str) -> Any:
    return next(each.value for each in fields_of(panel, thing) if each.name == name)


@pytest.mark.parametrize(
    ("thing", "name", "wanted"),
    [
        ("objects.0", "red", 0.25), ("objects.1", "roughness", 0.6), ("objects.1", "blue", 0.9),
        ("objects.0", "x", 0.3), ("objects.1", "y", -0.07), ("objects.1", "z", 0.2), ("objects.2", "power", 32.0),
        ("objects.2", "light_green", 7.0), ("lights.0", "power", 5.0), ("lights.0", "y", 0.75),
        ("environment", "light_red", 0.1), ("materials.warm", "power", 0.5),
    ],
)  # fmt: skip
def test_every_dial_comes_to_where_it_is_turned(thing: str, name: str, wanted: float) -> None:
    before = panel()
    scene = turned(before, thing, f"thing_{name}", wanted)
    after = Panel(before.dials, scene, scene)
    assert value(after, thing, name) == pytest.approx(wanted)
    others = {each.name for each in fields_of(before, thing)} - {name}
    if not (name == "power" or name.startswith("light_")):
        assert all(value(after, thing, each) == pytest.approx(value(before, thing, each)) for each in others)


def test_a_thing_is_moved_by_its_transform_alone() -> None:
    scene = turned(panel(), "objects.1", "thing_x", 0.5)
    assert scene.objects[1].placed_at(0) @ [0, 0, 0, 1] == pytest.approx([0.5, 0.02, 0, 1])
    assert len(scene.objects[1].transform) == 1


def test_power_scales_the_colour_of_the_light() -> None:
    scene = turned(panel(), "objects.2", "thing_power", 8.0)
    assert scene.materials["warm"].radiance == pytest.approx((8, 6, 4))


def test_another_material_of_the_scene_is_chosen() -> None:
    assert turned(panel(), "objects.0", "thing_material", "shiny").objects[0].material.kind == "plastic"


def lit(panel: Panel) -> list[str]:
    return [each["name"] for each in lamps_of(panel) if each["lit"]]


def switched(panel: Panel, name: str, **how: Any) -> Panel:
    found = switch_lamp(panel, name, how.get("mute"), how.get("solo"))
    scene = set_keys(panel.scene, found.changes)
    return Panel(found.dials, scene, scene)


def test_lamps_are_muted_and_shine_alone_and_have_their_strength_back() -> None:
    first = panel()
    names = ["lights.0", "materials.warm", "environment"]
    assert lit(first) == names
    muted = switched(first, "materials.warm", mute=True)
    assert lit(muted) == ["lights.0", "environment"]
    assert muted.scene.materials["warm"].radiance == (0, 0, 0)
    alone = switched(muted, "lights.0", solo=True)
    assert lit(alone) == ["lights.0"]
    assert alone.scene.environment is not None
    assert alone.scene.environment.radiance == (0, 0, 0)
    two = switched(alone, "materials.warm", solo=True)
    assert lit(two) == names[:2]
    back = switched(switched(two, "materials.warm", solo=False), "lights.0", solo=False)
    assert lit(back) == ["lights.0", "environment"]  # what was muted is
    assert switched(back, "materials.warm", mute=False).scene.made_of == first.scene.made_of


@pytest.mark.parametrize(
    ("thing", "name", "value", "words"),
    [
        (None, "thing_red", 1.0, "nothing is selected"),
        ("objects.0", "thing_power", 1.0, "no such dial"),
        ("objects.0", "thing_red", "much", "must be a finite number"),
        ("objects.0", "thing_material", "gold", "is not one of"),
    ],
)
def test_what_cannot_be_turned_is_one_sentence(thing: str | None, name: str, value: Any, words: str) -> None:
    with pytest.raises(rptcam_cl.InputError, match=words) as found:
        turn_thing(panel(), thing, name, value)
    assert "\n" not in str(found.value)


def test_patterns_and_keyframes_say_why_they_are_not_turned() -> None:
    patterned = panel(**{"materials.white.reflectance": "{kind: checker, even: [1, 1, 1], odd: [0, 0, 0]}"})
    assert "pattern" in turn_thing(patterned, "objects.0", "thing_red", 0.5).messages[0]
    moving = panel(**{"objects.0.motion": "[{time_s: 0}, {time_s: 1, translate: [1, 0, 0]}]"})
    assert "keyframes" in turn_thing(moving, "objects.0", "thing_x", 0.5).messages[0]


@pytest.mark.parametrize("what", ["lamp", "card", "backdrop"])
def test_what_is_added_faces_what_is_in_focus(what: Any) -> None:
    before = panel()
    view = viewpoint_of(before.resolved)
    changes, name = add_thing(before, view, what)
    scene = set_keys(before.scene, changes)
    assert name == f"objects.{len(scene.objects) - 1}"
    added = scene.objects[-1]
    middle = np.array(added.corner) + (np.array(added.edge_u) + np.array(added.edge_v)) / 2
    normal = np.cross(added.edge_u, added.edge_v)
    focus = np.array([0, 0, 1 - view.distance])
    towards = focus - middle
    assert normal @ towards == pytest.approx(np.linalg.norm(normal) * np.linalg.norm(towards))
    assert (middle[2] < focus[2]) == (what == "backdrop")
    assert [each["name"] for each in lamps_of(Panel(before.dials, scene, scene))][2:-1] == (
        [f"{name}.material"] if what == "lamp" else []
    )


def test_a_lamp_that_is_added_lights_as_much_as_the_camera_meters() -> None:
    """A surface of 18 % that faces the lamp, which is seen at 0.81 distances, shines as what was metered."""
    metered = replace(panel(), reading_cd_m2=50.0)
    changes, _ = add_thing(metered, viewpoint_of(metered.resolved), "lamp")
    added = set_keys(metered.scene, changes).objects[-1]
    area, middle = np.linalg.norm(np.cross(added.edge_u, added.edge_v)), viewpoint_of(metered.resolved).distance
    distance = middle * np.linalg.norm([0.6, 0.6, 0.3])
    luminance = 683 * 0.18 / np.pi * added.material.radiance[0] * area / distance**2
    assert luminance == pytest.approx(50, rel=0.01)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    with serving_text(tmp_path_factory.mktemp("scene"), SCENE) as server:
        yield server


@pytest.fixture
def client(server: Any) -> Iterator[Page]:
    with reset_page(server) as found:
        yield found


def test_a_click_selects_what_the_picture_shows_there(client: Page) -> None:
    """A camera at distance 1 with 50 mm before 36 mm shows 0.72 across."""
    for number, (x, name) in enumerate(
        ((0.5 - 0.1 / 0.72, "objects.0"), (0.5 + 0.12 / 0.72, "objects.1"), (0.98, None))
    ):
        assert client.ask(10 + number, "select", x=x, y=0.47).header["name"] == name
    assert client.ask(20, "select", name="materials.nothing").header["name"] is None


def test_a_click_that_another_has_overtaken_is_answered(client: Page) -> None:
    for number in range(30, 35):
        client.send("select", id=number, x=0.3, y=0.5)
    answers = [client.wait(lambda m, n=n: m.header.get("id") == n).header for n in range(30, 35)]  # type: ignore[misc]
    assert answers[-1]["type"] == "selected"
    assert all(answer["type"] == "selected" or answer["superseded"] for answer in answers)


def test_a_selected_thing_is_turned_and_a_lamp_muted_and_both_undone(client: Page) -> None:
    before = client.ask(10, "scene").header["yaml"]
    client.ask(11, "select", x=0.5 + 0.12 / 0.72, y=0.47)
    client.ask(12, "dial", name="thing_red", value=0.9)
    client.ask(13, "lamp", name="environment", mute=True)
    scene = rptcam_cl.load_scene(yaml.safe_load(client.ask(14, "scene").header["yaml"]))
    assert scene.materials["shiny"].reflectance[0] == 0.9
    assert scene.environment is not None
    assert np.max(scene.environment.radiance) == 0
    client.send("history", id=15, do="undo")
    state = client.wait(lambda m: m.type == "state" and m.header["things"]["lamps"][-1]["lit"]).header
    assert not state["things"]["lamps"][-1]["mute"]
    client.ask(16, "history", do="undo")
    assert client.ask(17, "scene").header["yaml"] == before
    assert "no" in client.ask(18, "lamp", name="lights.9", mute=True).header["message"]


def test_in_the_dark_the_camera_goes_on_without_its_meter(client: Page, server: Any) -> None:
    client.ask(50, "dial", name="mode", value="A")
    client.send("lamp", id=51, name="materials.warm", mute=True)
    client.send("lamp", id=52, name="lights.0", mute=True)
    client.send("lamp", id=53, name="environment", mute=True)
    problem = client.wait(lambda m: m.type == "error").header
    assert "finds no light" in problem["message"]
    assert problem["source"] == "change"  # the device is not let go of
    client.wait(lambda m: m.type == "state" and m.header["dials"][0]["value"] == "relative")
    client.frame(lambda header: header["kind"] == "picture" and header["scale"] == 1 and header["spp"] >= 1)


@pytest.mark.slow
def test_a_lamp_is_added_selected_and_undone(client: Page) -> None:
    client.ask(40, "add", what="lamp")
    state = client.wait(lambda m: m.type == "state" and m.header["things"]["selected"] == "objects.3").header
    assert [each["label"] for each in state["things"]["lamps"]] == ["point 1", "warm", "lamp", "surroundings"]
    assert {"thing_power", "thing_x"} <= {each["name"] for each in state["dials"]}
    client.ask(41, "history", do="undo")
    client.wait(lambda m: m.type == "state" and m.header["things"]["selected"] is None)
    assert "what" in client.ask(42, "add", what="chair").header["message"]


@pytest.mark.slow
def test_a_lamp_is_put_out_without_waiting_for_other_kernels(client: Page, tmp_path: Path) -> None:
    client.seen.clear()
    client.send("lamp", id=30, name="materials.warm", mute=True)
    shown = client.frame(lambda header: (header["answers"] or 0) >= 30)
    assert not shown.header["stale"]
    client.frame(lambda header: at_rest(header) and not header["denoised"])
    assert not any(message.header.get("busy") is True for message in client.seen if message.type == "compiling")
    scene = yaml.safe_load(client.ask(31, "scene").header["yaml"])
    (tmp_path / "a.exr").write_bytes(client.ask(32, "save", format="exr", name="a").data)
    assert np.array_equal(read_film(tmp_path / "a.exr").pixels, rptcam_cl.render(scene, spp=8).pixels)
