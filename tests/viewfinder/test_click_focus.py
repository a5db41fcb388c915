"""Focus at a click is the answer of `rptcam focus`, and sets the scene to it."""

import json
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import open_session
from rptcam_cl.rendering.cameras.setting import lens_setting
from rptcam_cl.scene.load import apply_overrides, load_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.controller import autofocus
from rptcam_cl.studies.focus.probe import NoContrast
from rptcam_cl.viewfinder.requests import check_search, describe_focus, focus_at, state_changes
from tests.support.cases import slow

CHECKER = {
    "kind": "matte",
    "reflectance": {"kind": "checker", "even": [0.8, 0.8, 0.8], "odd": [0.1, 0.1, 0.1], "scale": [40, 40]},
}
CONTENT: dict[str, Any] = {
    "film": {"resolution": [96, 64]},
    "camera": {
        "kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 1.5}, "eye": [0, 0, 0],
        "target": [0, 0, -1],
    },
    "objects": [
        {"shape": "rectangle", "corner": [-1, -1, -1], "edge_u": [1, 0, 0], "edge_v": [0, 2, 0], "material": CHECKER},
        {"shape": "rectangle", "corner": [0, -2, -3], "edge_u": [3, 0, 0], "edge_v": [0, 4, 0], "material": CHECKER},
    ],
    "environment": {"kind": "constant", "radiance": [1, 1, 1]},
    "render": {"seed": 5},
}  # fmt: skip


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(CONTENT)


def command(file: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, Any]:
    """What `rptcam focus` prints as JSON."""
    file.write_text(json.dumps(CONTENT), "utf-8")
    assert main(["focus", str(file), "--json", *options]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


@pytest.mark.parametrize("x", [slow(0.25), 0.75])
def test_click_focus_is_the_answer_of_the_command(
    scene: Scene, x: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = autofocus(scene, "depth", point=(x, 0.5), device=open_session(None))
    expected = command(tmp_path / "scene.yaml", capsys, "--point", f"{x},0.5", "--method", "depth")
    said = describe_focus(found)
    assert found.state == expected["state"]
    assert said["distance_m"] == expected["focus_distance_m"] == pytest.approx(1 if x < 0.5 else 3, rel=0.01)
    assert [[probe["position"], probe["score"]] for probe in said["curve"]] == expected["probes"]
    data = json.loads(json.dumps(CONTENT))
    apply_overrides(data, [f"{key}={json.dumps(value)}" for key, value in state_changes(scene, found.state).items()])
    assert lens_setting(load_scene(data)).film_distance_mm == expected["film_distance_mm"]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["contrast", "phase"])
def test_zones_and_curve_are_those_of_the_command(
    scene: Scene, method: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    zone = [0.6, 0.8, 0.4, 0.6]
    found = describe_focus(autofocus(scene, method, zones=[tuple(zone)], device=open_session(None)))
    expected = command(tmp_path / "scene.yaml", capsys, "--zone", "0.6,0.8,0.4,0.6", "--method", method)
    assert found["film_distance_mm"] == expected["film_distance_mm"]
    assert found["zones"] == [zone]
    assert [[probe["position"], probe["score"]] for probe in found["curve"]] == expected["probes"]
    assert len(found["curve"]) == len(expected["details"]) >= 1


def test_click_on_what_has_no_texture_focuses_by_its_distance() -> None:
    blank = {
        "shape": "rectangle", "corner": [-2, -2, -1.2], "edge_u": [4, 0, 0], "edge_v": [0, 4, 0],
        "material": {"kind": "matte", "reflectance": [0.5, 0.5, 0.5]},
    }  # fmt: skip
    scene = load_scene(CONTENT | {"objects": [blank]})
    found = focus_at(scene, 0.5, 0.5, device=open_session(None))
    assert found.method == "depth" and found.failure is None
    assert found.focus_distance_m == pytest.approx(scene.camera.eye[2] + 1.2, rel=1e-3)
    assert any("by distance alone, as by contrast" in remark for remark in found.remarks)


def test_what_cannot_be_focused_is_refused(scene: Scene) -> None:
    device = open_session(None)
    for method in ("sonar", ""):
        with pytest.raises(InputError, match="method"):
            check_search(method, None)
    with pytest.raises(InputError):
        focus_at(scene, 1.5, 0.5, device=device)
    with pytest.raises(InputError, match="too many"):
        check_search(None, [[0, 1, 0, 1]] * 65)
    empty = load_scene(CONTENT | {"objects": []})
    with pytest.raises(NoContrast):
        focus_at(empty, 0.5, 0.5, device=device)
    pinhole = {"kind": "pinhole", "fov_degrees": 40, "eye": [0, 0, 0], "target": [0, 0, -1]}
    with pytest.raises(InputError, match="sharp"):
        focus_at(load_scene(CONTENT | {"camera": pinhole}), 0.5, 0.5, device=device)
