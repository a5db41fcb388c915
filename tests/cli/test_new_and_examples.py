"""`rptcam examples` and `rptcam new`: what they list, write, copy and refuse."""

from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.files import SCENES
from rptcam_cl.scene.load import load_scene


def test_every_scene_that_comes_along_is_listed_with_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["examples"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(SCENES)
    assert all(len(line.split()) > 5 for line in lines)


@pytest.mark.parametrize("name", SCENES)
def test_copied_scenes_load_in_their_new_folder(name: str, tmp_path: Path) -> None:
    assert main(["examples", name, "-o", str(tmp_path / "mine")]) == 0
    assert load_scene(tmp_path / "mine" / f"{name}.yaml").stand_ins == ()


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_copied_scenes_are_rendered_in_their_new_folder(name: str, tmp_path: Path) -> None:
    assert main(["examples", name, "-o", str(tmp_path)]) == 0
    picture = tmp_path / "picture.npy"
    assert main(["render", str(tmp_path / f"{name}.yaml"), "-o", str(picture), "--size=48x32", "--spp=4"]) == 0
    film = np.load(picture)
    assert np.isfinite(film).all() and film.mean() > 0.01 and film.std() > 0.01


def test_commands_to_go_on_with_can_be_pasted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "my scenes"
    assert main(["examples", "prism", "-o", str(folder)]) == 0
    assert capsys.readouterr().err.endswith(f"rptcam render '{folder / 'prism.yaml'}' -o prism.png\n")
    assert main(["new", str(folder / "a b.yaml")]) == 0
    words = f"rptcam render '{folder / 'a b.yaml'}' -o 'a b.png', or rptcam view '{folder / 'a b.yaml'}'\n"
    assert capsys.readouterr().err.endswith(words)


def test_folder_that_is_a_file_is_said_to_be_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "taken").write_text("mine")
    assert main(["examples", "prism", "-o", str(tmp_path / "taken")]) == 4
    assert capsys.readouterr().err == f"error: {tmp_path / 'taken'}: is a file, not a folder\n"


def test_copy_replaces_no_changed_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "prism.yaml").write_text("mine")
    assert main(["examples", "prism", "-o", str(tmp_path)]) == 2
    assert "prism.yaml: is there already and differs" in capsys.readouterr().err
    assert (tmp_path / "prism.yaml").read_text() == "mine"


def test_new_writes_a_scene_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "first.yaml"
    assert main(["new", str(target), "--lens", "tessar-100mm", "--size", "90x60"]) == 0
    assert "67% of the frame" in capsys.readouterr().err
    assert load_scene(target).film.resolution == (90, 60)
    assert main(["new", str(target)]) == 2
    assert "first.yaml: is there already" in capsys.readouterr().err


def test_model_in_place_of_the_scene_is_told_where_it_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("cup.glb").write_bytes(b"")
    assert main(["new", "cup.glb"]) == 2
    assert capsys.readouterr().err.endswith("for a scene of that model: rptcam new cup.yaml --model cup.glb\n")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["s.json"], "a scene file is YAML (got .json; allowed: .yaml, .yml)\n"),
        (["s.yaml", "--model", "lost.glb"], "lost.glb: no such file"),
        (["s.yaml", "--hdri", "lost.hdr"], "lost.hdr: no such file"),
        (["s.yaml", "--hdri", __file__], "test_new_and_examples.py: is not a picture that can be read (allowed: PNG"),
        (["s.yaml", "--lens", "dgaus-50mm"], "did you mean"),
        (["s.yaml", "--lens", "lost/dgauss-50m.yaml"], "no such"),
        (["s.yaml", "--metres-per-unit", "0"], "a finite number above 0"),
    ],
)
def test_new_refuses_what_it_cannot_show_and_writes_nothing(
    words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", *words]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_folder_without_a_scene_to_copy_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["examples", "-o", str(tmp_path / "out")]) == 2
    assert "-o copies one scene; name it, as rptcam examples first_light -o my_scene" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_render_shows_a_model_of_which_a_picture_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.mtl").write_text("newmtl w\nmap_Kd gone.png\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl w\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    assert main(["render", str(tmp_path / "a.obj"), "--plan", "-o", str(tmp_path / "a.png")]) == 0
    assert f"gone.png: no such file (got {tmp_path / 'gone.png'}); grey stands for it" in capsys.readouterr().err
