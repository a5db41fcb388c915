"""Lamps are mixed at once, of one film: what is shown and saved is that film with the light of groups times factors."""

import io
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image as Pillow

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.image import read_film, relit
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.viewfinder.panel import Dials, Panel
from rptcam_cl.viewfinder.things import mix_entries, turn_mix
from tests.viewfinder.page_client import SCENE, Page, at_rest, page, serving

LIT = SCENE + "lights:\n  - {kind: point, position: [0.5, 0.5, 0.6], intensity: 0.4, group: key}\n"


def panel(text: str = LIT, **dials: Any) -> Panel:
    scene = load_scene(yaml.safe_load(text))
    return Panel(Dials("relative", **dials), scene, scene, None)


def test_lamps_are_kept_apart_without_what_is_of_all_together_and_all_is_as_before_afterwards() -> None:
    here = panel()
    turned = turn_mix(here, (), "mix", True, ["diffraction"])
    assert turned.changes == {"render.layers": ["lights"], "camera.diffraction": "off"}
    assert "diffraction" in turned.messages[0]
    there = Panel(turned.dials, set_keys(here.scene, turned.changes), here.resolved, None)
    back = turn_mix(there, ("key", "environment"), "mix", False, [])
    assert set_keys(there.scene, back.changes).content_hash() == here.scene.content_hash()
    assert (back.dials.mix, back.dials.unmixed) == ({}, {})


def test_objects_of_a_material_that_several_have_are_one_group() -> None:
    lamps = "".join(f"  - {{shape: sphere, center: [{x}, 0, 0], radius: 0.01, material: bulb}}\n" for x in range(1, 21))
    text = SCENE.replace("materials:\n", "materials:\n  bulb: {kind: emissive, radiance: [1, 1, 1]}\n")
    here = panel(text.replace("environment:", f"{lamps}environment:"))
    turned = turn_mix(here, (), "mix", True, [])
    there = Panel(turned.dials, set_keys(here.scene, turned.changes), here.resolved, None)
    assert make_plan(there.scene).light_groups.names == ("bulb", "environment")
    back = turn_mix(there, ("bulb", "environment"), "mix", False, [])
    assert set_keys(there.scene, back.changes).content_hash() == here.scene.content_hash()


def test_dials_of_groups_turn_within_their_limits() -> None:
    groups = ("key", "environment")
    turned = turn_mix(panel(), groups, "mix_b", 0.5, [])
    assert (turned.dials.mix, turned.changes) == ({"environment": 0.5}, {})
    assert turn_mix(panel(), groups, "mix_a", -1, []).dials.mix == {"key": 0.0}
    entries = mix_entries(panel(mix={"key": 0.25}), groups)
    assert [(each["name"], each["label"], each["value"]) for each in entries] == [
        ("mix", "keep lamps apart", False), ("mix_a", "key", 0.25), ("mix_b", "environment", 1.0),
    ]  # fmt: skip
    for name, value, together in (("mix_c", 1.0, []), ("mixed", 1.0, []), ("mix", 1.0, []), ("mix_a", 1.0, ["ghosts"])):
        with pytest.raises(InputError):
            turn_mix(panel(), groups, name, value, together)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    path = tmp_path_factory.mktemp("scene") / "lit.yaml"
    path.write_text(LIT)
    with serving(path) as (_, server), page(server) as found:
        found.ask(1, "denoise", on=False)
        found.frame(at_rest)
        yield found


def codes(data: bytes) -> Any:
    return np.asarray(Pillow.open(io.BytesIO(data)).convert("RGB"), np.int16)


@pytest.mark.slow
def test_what_is_shown_saved_undone_and_commanded_has_the_mix(client: Page, tmp_path: Path) -> None:
    client.ask(2, "view", format="png", width=48, height=32)
    client.ask(3, "dial", name="mix", value=True)
    state = client.wait(lambda m: m.type == "state" and any(d["name"] == "mix_b" for d in m.header["dials"])).header
    names = {dial["label"]: dial["name"] for dial in state["dials"] if dial["name"].startswith("mix_")}
    assert {*names} == {"key", "environment"}
    client.frame(lambda header: at_rest(header) and not header["stale"])

    client.ask(4, "dial", name=names["environment"], value=0.25)
    shown = client.frame(lambda header: header["answers"] == 4)
    assert at_rest(shown.header)  # all samples at once
    client.ask(5, "dial", name=names["key"], value=2.0)
    shown = client.frame(lambda header: header["answers"] == 5)
    assert shown.header["generation"] == state["generation"]

    scene = load_scene(yaml.safe_load(LIT))
    film = rptcam_cl.render(set_keys(scene, {"render.layers": ["lights"]}), spp=8)
    truth = relit(film, {"environment": 0.25, "key": 2})
    (tmp_path / "a.exr").write_bytes(client.ask(6, "save", format="exr", name="a").data)
    saved = read_film(tmp_path / "a.exr")
    assert np.array_equal(saved.pixels, truth.pixels)
    assert saved.metadata["relit"] == {"environment": 0.25, "key": 2.0}
    picture = client.ask(7, "save", format="png", name="a").data
    assert np.abs(codes(picture) - codes(shown.data)).max() <= 1
    assert "not mixed" in client.ask(8, "stack", near_m=0.8, far_m=1.2).header["message"]

    render, develop = client.ask(9, "command").header["text"].split(" && ")
    assert shlex.split(render)[-1] == shlex.split(develop)[2] == "lit.exr"
    assert {"lights.environment=0.25", "lights.key=2"} < {*shlex.split(develop)}

    client.ask(10, "history", do="undo")
    client.wait(lambda m: m.type == "state" and _dial(m.header, names["key"]) == 1)
    client.ask(11, "save", format="exr", name="a")
    client.ask(12, "history", do="redo")
    client.wait(lambda m: m.type == "state" and _dial(m.header, names["key"]) == 2)

    client.ask(13, "dial", name="mix", value=False)
    client.wait(lambda m: m.type == "state" and _dial(m.header, names["key"]) is None)
    assert "layers" not in client.ask(14, "scene").header["yaml"]


def _dial(state: dict[str, Any], name: str) -> Any:
    return next((dial["value"] for dial in state["dials"] if dial["name"] == name), None)
