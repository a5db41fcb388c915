"""``rptcam focus``: what it prints, draws and refuses."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.focus import controller
from tests.support.cases import slow

SCENE = """\
film: {resolution: [60, 40], size_mm: [36, 24]}
camera: {kind: realistic, lens: dgauss-50mm, f_number: 5.6, eye: [0, 0, 0], target: [0, 0, -1], focus: {distance_m: 9}}
render: {max_depth: 2}
materials: {spots: {kind: matte, reflectance: {kind: noise, low: 0.05, high: 0.95, scale: [200, 200]}}}
objects:
  - {name: wall, shape: rectangle, corner: [-2, -2, -2], edge_u: [4, 0, 0], edge_v: [0, 4, 0], material: spots}
environment: {kind: constant, radiance: 1}
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "wall.yaml"
    path.write_text(SCENE)
    return path


def test_json_has_the_promised_keys_and_the_plot_is_drawn(rptcam: Any, scene: Path, tmp_path: Path) -> None:
    plot = tmp_path / "curve.svg"
    done = rptcam("focus", str(scene), "--zone", "0.45,0.5,0.45,0.52", "--json", "--plot", str(plot))
    assert done.code == 0, done.err
    found = json.loads(done.out)
    assert found["method"] == "contrast"
    assert found["focus_distance_m"] == pytest.approx(2.0, rel=0.05)
    assert found["film_distance_mm"] == pytest.approx(37.4, abs=0.1)
    assert all(len(pair) == 2 for pair in found["probes"])
    assert len(found["probes"]) == len(found["details"]) <= 15
    nearest = max((row for row in found["details"] if row["stop"] == 1), key=lambda row: row["value"])
    assert nearest["film_distance_mm"] == pytest.approx(found["film_distance_mm"], abs=1.0)
    assert found["zone"] == {"left": 0.45, "right": 0.5, "top": 0.45, "bottom": 0.52}
    assert "found</text>" in plot.read_text()


@pytest.mark.parametrize(
    ("words", "given"),
    [
        ([], {"method": None}),
        (["--method", "depth", "--seed", "7", "--device", "cpu"], {"method": "depth", "seed": 7, "device": "cpu"}),
        (["--zone", "0.1,0.2,0.3,0.4", "--zone", "0.5,0.6,0,1"], {"zones": [(0.1, 0.2, 0.3, 0.4), (0.5, 0.6, 0, 1)]}),
        (["--zones", "zones.txt", "--policy", "farthest"], {"zones": [(0.7, 0.75, 0.4, 0.5)], "policy": "farthest"}),
        (["--point", "0.25,0.75", "--set", "render.seed=9"], {"point": (0.25, 0.75)}),
        (["--object", "wall"], {"object": "wall"}),
        (["--object", "wall", "--at", "0,0.5,-1"], {"object": "wall", "at": [0, 0.5, -1]}),
    ],
)
def test_autofocus_is_asked_for_what_the_options_say(
    rptcam: Any, scene: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], given: dict[str, Any]
) -> None:
    monkeypatch.chdir(scene.parent)
    Path("zones.txt").write_text("xleft xright ytop ybottom\n0.7 0.75 0.4 0.5\n")
    asked: list[Any] = []

    def autofocus(scene: Any, method: Any, **options: Any) -> None:
        asked.append((scene, {"method": method, **options}))
        raise InputError("that was all")

    monkeypatch.setattr(controller, "autofocus", autofocus)
    assert rptcam("focus", str(scene), *words).err == "error: that was all\n"
    [(read, options)] = asked
    assert read.render.seed == (9 if "--set" in words else load_scene(scene).render.seed)
    if "zones" in given:
        options["zones"] = [tuple(zone) for zone in options["zones"]]
    keys = ("method", "zones", "mask", "point", "object", "at", "policy", "seed", "device", "criterion", "sensor")
    nothing = dict.fromkeys(keys)
    assert options == nothing | given


def test_table_for_people(rptcam: Any, scene: Path) -> None:
    done = rptcam("focus", str(scene), "--method", "depth", "--object", "wall")
    assert done.code == 0, done.err
    assert re.search(r"sharp at 2 m, confidence 1\.00", done.out)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--method", "contrats"], "did you mean contrast"),
        (["--policy", "near"], "allowed closest, farthest, centre, weighted"),
        (["--zone", "0.5,0.4,0,1"], "got 0.5,0.4,0,1; allowed x0,x1,y0,y1"),
        (["--point", "0.5"], "allowed x,y in 0..1"),
        (["--point", "0.5,0.5", "--object", "wall"], "takes one of --zone, --zones, --mask, --point, --object and"),
        (["--zones", "none.txt"], "none.txt: cannot be read"),
        (["--plot", "curve.jpg"], "unknown kind of picture"),
        (["--method", "depth", "--plot", "curve.svg"], "method depth has no curve"),
        slow(["--set", "objects=[]"], "no contrast in the zone"),
        (["--set", "camera={kind: pinhole, eye: [0, 0, 0], target: [0, 0, -1], fov_degrees: 40}"], "no focus to find"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    rptcam: Any, scene: Path, words: list[str], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(scene.parent)
    done = rptcam("focus", str(scene), *words)
    assert done.code in (2, 4)
    assert done.out == ""
    errors = [line for line in done.err.splitlines() if not line.startswith("warning")]
    assert len(errors) == 1
    assert message in errors[0]
