"""``rptcam convert``."""

import json
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.cli import main
from rptcam_cl.scene.load import load_scene
from tests.exchange.pbrt.conftest import HEAD


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "in.pbrt"
    path.write_text(HEAD + 'Accelerator "bvh"\nShape "sphere"\nLightSource "infinite"\n')
    return path


def run(capsys: Any, *words: str) -> tuple[int, str]:
    code = main(["convert", *words])
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "Traceback" not in captured.err
    return code, captured.err


def test_a_scene_is_written_and_the_report_goes_to_standard_error(source: Path, capsys: Any) -> None:
    code, text = run(capsys, "in.pbrt", "out.yaml")
    assert code == 0
    assert text.startswith('in.pbrt:5: ignored: Accelerator "bvh"')
    assert text.endswith("wrote out.yaml: 1 object\n")
    assert Path("out.yaml").read_text("utf-8").startswith("# Converted from in.pbrt.\nfilm:")
    assert not Path("out_files").exists()


def test_warnings_about_the_scene_are_told(source: Path, capsys: Any) -> None:
    source.write_text(HEAD + 'Shape "sphere"')
    assert "warning: nothing in the scene emits light" in run(capsys, "in.pbrt", "out.yaml")[1]


def test_quiet_says_nothing(source: Path, capsys: Any) -> None:
    assert run(capsys, "in.pbrt", "out.yaml", "--quiet") == (0, "")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("in.blend", "out.yaml"),
            "in.blend: only scenes of pbrt, stages of USD and models can be converted (got .blend; allowed: .pbrt",
        ),
        (("in.pbrt", "out.json"), "out.json: a scene file is YAML (got .json; allowed: .yaml, .yml)"),
        (("in.pbrt", "no/out.yaml"), "there is no folder"),
        (("none.pbrt", "out.yaml"), "none.pbrt: no such file"),
    ],
)
def test_wrong_names_are_refused(source: Path, capsys: Any, words: tuple[str, str], message: str) -> None:
    code, text = run(capsys, *words)
    assert code in (2, 4)
    assert message in text
    assert text.count("\n") == 1
    assert not Path("out.yaml").exists()


def test_a_scene_without_objects_is_an_error(source: Path, capsys: Any) -> None:
    source.write_text(HEAD + 'LightSource "infinite"')
    assert run(capsys, "in.pbrt", "out.yaml") == (
        2,
        "error: in.pbrt: 0 objects: the scene has no shapes that are placed\n",
    )
    source.write_text(HEAD + 'Shape "heightfield" Shape "nurbs"')
    code, text = run(capsys, "in.pbrt", "out.yaml")
    assert code == 2
    assert "0 objects: none of its 2 shapes can be shown; in.pbrt:5: ignored: Shape" in text
    assert [path.name for path in source.parent.iterdir()] == ["in.pbrt"]


def test_nothing_is_written_for_a_scene_that_is_wrong(source: Path, capsys: Any) -> None:
    source.write_text(HEAD + 'Shape "sphere" "float zmin" 0\nShape "sphere" "float radius" 0')
    code, text = run(capsys, "in.pbrt", "out.yaml")
    assert code == 2
    assert text.startswith('error: in.pbrt:6:16: Shape "sphere": "radius" must be above 0')
    assert [path.name for path in source.parent.iterdir()] == ["in.pbrt"]


def test_a_root_admits_files_of_a_folder_above(source: Path, capsys: Any) -> None:
    folder = source.parent / "views"
    folder.mkdir()
    (folder / "a.pbrt").write_text(HEAD + 'Include "../geometry/ball.pbrt"\nLightSource "infinite"')
    (source.parent / "geometry").mkdir()
    (source.parent / "geometry" / "ball.pbrt").write_text('Shape "sphere"')
    code, text = run(capsys, "views/a.pbrt", "out.yaml")
    assert code == 2
    assert "lies outside the pbrt scene's folder" in text
    assert run(capsys, "views/a.pbrt", "out.yaml", "--root", ".")[0] == 0


def test_the_report_as_json_counts_objects(source: Path, capsys: Any) -> None:
    ball = 'ObjectBegin "a"\nMaterial "measured"\nShape "sphere"\nObjectEnd\n'
    source.write_text(HEAD + ball + 'ObjectInstance "a"\nTranslate 3 0 0\nObjectInstance "a"\nShape "disk"\n')
    assert main(["convert", "in.pbrt", "out.yaml", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["objects"] == 3
    (item,) = [item for item in printed["report"] if item["message"].startswith("Material")]
    assert item == {"effect": "approximated", "message": 'Material "measured": matte grey 0.5', "lines": ["in.pbrt:6"],
                    "objects": 2}  # fmt: skip


def test_models_become_scenes_with_a_report_of_the_same_form(source: Path, capsys: Any) -> None:
    Path("a.mtl").write_text("newmtl red\nKd 1 0 0\nillum 42\n", "utf-8")
    text = "mtllib a.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 1 0\nf 1 2 3\nf 3 3 4\n"
    Path("a.obj").write_text(text, "utf-8")
    assert main(["convert", "a.obj", "a.yaml", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said.keys() == {"objects", "report", "warnings"}
    assert all(each.keys() == {"effect", "message", "lines", "objects"} for each in said["report"])
    assert any(
        "triangles dropped" in text for text in (*said["warnings"], *(each["message"] for each in said["report"]))
    )
    assert load_scene(Path("a.yaml")).objects[0].file == "a.obj"
