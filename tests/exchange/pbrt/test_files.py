"""Files that a pbrt scene names: from its own folder only, and written last, when all else is good."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.pbrt.convert import convert_scene
from rptcam_cl.scene.load import load_scene
from tests.exchange.pbrt.conftest import HEAD
from tests.exchange.pbrt.test_materials import IMAGE, png

BALL = '\nShape "sphere"\n'
TRIANGLE = b"""ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""
NAMED = {
    "plymesh": 'Shape "plymesh" "string filename" "{}"',
    "picture": IMAGE.format("").replace("a.png", "{}") + BALL,
    "normal map": 'Material "diffuse" "string normalmap" "{}"' + BALL,
    "spectrum": 'Material "diffuse" "spectrum reflectance" "{}"' + BALL,
    "sky": 'LightSource "infinite" "string filename" "{}"' + BALL,
    "include": 'Include "{}"' + BALL,
    "import": 'Import "{}"' + BALL,
}


def places(folder: Path) -> tuple[Path, Path]:
    """Folders of a pbrt scene and of the scene that it becomes, neither inside the other."""
    source, target = folder / "pbrt", folder / "ours"
    source.mkdir()
    target.mkdir()
    return source / "in.pbrt", target / "out.yaml"


def everything(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


@pytest.mark.parametrize("kind", NAMED)
@pytest.mark.parametrize("name", ["/etc/passwd", "../secret.png", "link.png", "folder/../../secret.png"])
def test_nothing_outside_the_folder_of_the_scene_is_read(tmp_path: Path, kind: str, name: str) -> None:
    source, target = places(tmp_path)
    (tmp_path / "secret.png").write_bytes(png())
    (source.parent / "link.png").symlink_to(tmp_path / "secret.png")
    (source.parent / "folder").mkdir()
    name = f"{name}.png" if kind in ("picture", "normal map", "sky") and name == "/etc/passwd" else name
    source.write_text(HEAD + NAMED[kind].format(name))
    with pytest.raises(InputError, match=r"in\.pbrt:\d+:\d+: .*lies outside the pbrt scene's folder") as problem:
        convert_scene(source, target)
    assert "\n" not in str(problem.value)
    assert everything(target.parent) == []


def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    source, target = places(tmp_path)
    for kind, text in NAMED.items():
        name = f"{kind.replace(' ', '-')}.png"
        os.mkfifo(source.parent / name)
        source.write_text(HEAD + text.format(name))
        with pytest.raises(InputError, match="is not a regular file"):
            convert_scene(source, target)


def test_files_of_the_scene_are_copied_beside_ours(tmp_path: Path) -> None:
    source, target = places(tmp_path)
    (source.parent / "a.png").write_bytes(png())
    (source.parent / "a.ply").write_bytes(TRIANGLE)
    source.write_text(HEAD + NAMED["plymesh"].format("a.ply") + IMAGE.format("") + BALL)
    done = convert_scene(source, target)
    assert everything(target.parent) == []
    done.write(target)
    assert everything(target.parent) == ["out.yaml", "out_files", "out_files/a.ply", "out_files/a.png"]
    assert (target.parent / "out_files" / "a.png").read_bytes() == png()
    assert len(load_scene(target).objects) == 2


@pytest.mark.parametrize(
    ("kind", "name"),
    [("plymesh", "text.ply"), ("picture", "text.png"), ("normal map", "text.png"), ("sky", "text.exr")],
)
def test_what_is_not_of_its_kind_is_not_copied(tmp_path: Path, kind: str, name: str, capsys: Any) -> None:
    """And what came before it leaves nothing behind: all is checked before anything is in its place."""
    source, target = places(tmp_path)
    (source.parent / name).write_text("root:x:0:0:root:/root:/bin/sh\n")
    (source.parent / "a.png").write_bytes(png())
    source.write_text(HEAD + IMAGE.format("") + BALL + NAMED[kind].format(name))
    assert main(["convert", str(source), str(target)]) == 2
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    assert name in text
    assert ".rptcam" not in text
    assert everything(target.parent) == []


def test_a_scene_that_cannot_be_used_is_not_written(tmp_path: Path, capsys: Any) -> None:
    """The mesh is good for pbrt, too large for float32; the scene that was there before stays."""
    source, target = places(tmp_path)
    (source.parent / "a.ply").write_bytes(TRIANGLE.replace(b"1 0 0", b"1e30 0 0"))
    (source.parent / "a.png").write_bytes(png())
    source.write_text(HEAD + NAMED["plymesh"].format("a.ply") + IMAGE.format("") + BALL)
    target.write_text("before")
    assert main(["convert", str(source), str(target)]) == 2
    text = capsys.readouterr().err
    assert text.startswith(f"error: {source}: became a scene that cannot be used: ")
    assert (text.count("\n"), ".rptcam" in text) == (1, False)
    assert everything(target.parent) == ["out.yaml"]
    assert target.read_text() == "before"


def test_a_picture_that_lies_elsewhere_is_refused_or_stood_in_for_and_never_read(tmp_path: Path, capsys: Any) -> None:
    source, target = places(tmp_path)
    (tmp_path / "secret.png").write_bytes(png())
    source.write_text(HEAD + NAMED["picture"].format("../secret.png"))
    assert main(["convert", str(source), str(target)]) == 2
    assert "lies outside the pbrt scene's folder" in capsys.readouterr().err
    assert main(["convert", str(source), str(target), "--missing", "grey"]) == 0
    assert "approximated: ../secret.png: lies outside the folder of the scene; " in capsys.readouterr().err
    assert "secret" not in target.read_text()


def test_all_that_is_missing_is_named_at_once_or_stood_in_for(tmp_path: Path, capsys: Any) -> None:
    source, target = places(tmp_path)
    missing = {"plymesh": "a.ply", "picture": "b.png", "normal map": "c.png", "sky": "d.exr"}
    source.write_text(HEAD + "\n".join(NAMED[kind].format(name) for kind, name in missing.items()))
    assert main(["convert", str(source), str(target)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == len(missing)
    for name in missing.values():
        assert sum(f"{name}: no such file (got {source.parent / name})" in line for line in lines) == 1
    assert everything(target.parent) == []
    assert main(["convert", str(source), str(target), "--missing", "grey"]) == 0
    told = capsys.readouterr().err
    for name in missing.values():
        assert f"approximated: {name}: no such file; " in told
    scene = load_scene(target)
    assert len(scene.objects) == 3
    assert scene.stand_ins == ()


def test_missing_spectra_are_flat_and_those_of_metals_are_ours(tmp_path: Path, capsys: Any) -> None:
    source, target = places(tmp_path)
    metal = '"metal" "spectrum eta" "spds/Au.eta.spd" "spectrum k" "spds/Au.k.spd"'
    source.write_text(HEAD + f"Material {metal}{BALL}" + NAMED["spectrum"].format("a.spd"))
    assert main(["convert", str(source), str(target), "--missing", "grey"]) == 0
    told = capsys.readouterr().err
    assert "a.spd: no such file; a spectrum that is 1 everywhere" in told
    assert told.count("no such file; gold as we have it") == 2
    gold, flat = (item.material for item in load_scene(target).objects)
    assert gold.metal == "gold"
    np.testing.assert_allclose(flat.reflectance, 1, atol=1e-3)
    assert main(["convert", str(source), str(tmp_path / "b.yaml")]) == 2
