"""Frames of datasets: the same bytes alone, together, in shards and after a kill; cameras; errors."""

import errno
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tarfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.api.job import render
from rptcam_cl.batch import dataset as frames
from rptcam_cl.batch.dataset import dataset, read_specification, values_of_frame
from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError, NumericError, StateError
from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.core.remember import forget
from rptcam_cl.exchange.camera_models import CameraView, calibrate_best, project
from rptcam_cl.imaging.image import read_film
from tests.support.cases import slow

SCENE = """\
film: {resolution: [16, 12], width_mm: 36}
camera: {kind: realistic, lens: dgauss-50mm, eye: [0, 1, 5], target: [0, 0.5, 0], focus: {distance_m: 4}}
objects:
  - {shape: sphere, center: [0, 0.5, 0], radius: 0.5, material: {kind: matte, reflectance: [0.6, 0.2, 0.1]}}
environment: {kind: constant, radiance: 1}
render: {spp: 2}
"""
SPECIFICATION = """\
scene: scene.yaml
frames: 5
seed: 7
set: {render.layers: [depth]}
files: [exr, png]
camera_model: brown_conrady
vary:
  camera.f_number: {choice: [2.8, 8]}
  camera.eye: {uniform: [[-1, 1, 5], [1, 2, 6]]}
  objects.0.radius: {grid: [0.4, 0.5, 0.6]}
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "scene.yaml").write_text(SCENE, "utf-8")
    (tmp_path / "spec.yaml").write_text(SPECIFICATION, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def bytes_of(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir() if path.is_file()}


def test_frames_have_the_same_bytes_alone_together_and_damaged(place: Path, capsys: Any) -> None:
    assert main(["dataset", "spec.yaml", "-o", "all", "--quiet"]) == 0
    whole = bytes_of(place / "all")
    assert len(whole) == 5 * 3 + 2
    assert main(["dataset", "spec.yaml", "-n", "9", "-o", "one", "--frames", "3", "--quiet"]) == 0
    alone = bytes_of(place / "one")
    assert {name: digest for name, digest in alone.items() if name in whole and name.startswith("000003")} == {
        name: digest for name, digest in whole.items() if name.startswith("000003")
    }
    (place / "all/000001.png").write_bytes(b"broken")
    (place / "all/000002.json").unlink()
    assert main(["dataset", "spec.yaml", "-o", "all"]) == 0
    assert "2 frames rendered, 3 kept" in capsys.readouterr().err
    assert bytes_of(place / "all") == whole


@pytest.mark.parametrize("packed", [False, True], ids=["before its shard is written", "before its frames are removed"])
def test_a_run_killed_after_the_last_frame_of_a_shard_leaves_what_the_next_one_packs(place: Path, packed: bool) -> None:
    command = ["dataset", "spec.yaml", "-o", "out", "--shard", "2", "--quiet"]
    assert main(command) == 0
    whole = bytes_of(place / "out")
    (place / "out/manifest.jsonl").unlink()
    with tarfile.open(place / "out/shard-000001.tar") as shard:
        (place / "out/unfinished").mkdir()
        for member in shard:
            file = shard.extractfile(member)
            assert file is not None
            (place / "out/unfinished" / member.name).write_bytes(file.read())
    if not packed:
        (place / "out/shard-000001.tar").unlink()
    assert main(command) == 0
    assert bytes_of(place / "out") == whole
    assert not (place / "out/unfinished").exists()


def test_two_runs_share_a_folder_of_shards(place: Path) -> None:
    """The first to end leaves the folder of loose frames to the other."""
    list(dataset("spec.yaml", "whole", shard=2))
    late, early = (dataset("spec.yaml", "out", shard=2, only=only) for only in ([2, 3], [0, 1, 4]))
    list(early)
    list(late)
    assert bytes_of(place / "out") == bytes_of(place / "whole")
    assert not (place / "out/unfinished").exists()


@pytest.mark.parametrize(
    "words",
    [
        ("dataset", "spec.yaml"),
        *(slow(one) for one in (("dataset", "spec.yaml", "--shard", "5"), ("sweep", "scene.yaml"))),
    ],
)
def test_links_in_a_folder_are_replaced_and_not_written_through(place: Path, words: tuple[str, ...]) -> None:
    more = ("--over", "film.width_mm=36,40") if words[0] == "sweep" else ()
    command = [*words, *more, "-o", "out", "--quiet"]
    assert main(command) == 0
    names = sorted(path.name for path in (place / "out").iterdir())
    whole = bytes_of(place / "out")
    shutil.rmtree(place / "out")
    (place / "out").mkdir()
    (place / "elsewhere").mkdir()
    for name in names:
        (place / "elsewhere" / name).write_text("mine")
        (place / "out" / name).symlink_to(place / "elsewhere" / name)
    (place / "out/unfinished").symlink_to(place / "elsewhere")
    if words[0] == "dataset":
        for path in (place / "out").glob("*.json"):
            path.unlink()  # other files than frames are refused
    assert main(command) == 0
    assert {path.read_text() for path in (place / "elsewhere").iterdir()} == {"mine"}
    made = {path.name for path in (place / "out").iterdir() if not path.is_symlink()}
    assert made >= set(names)
    if words[0] == "dataset":
        assert {name: digest for name, digest in bytes_of(place / "out").items() if name in whole} == whole


@pytest.mark.parametrize("shard", [None, 2])
def test_full_disk_leaves_nothing_of_the_frame_under_way(
    place: Path, monkeypatch: pytest.MonkeyPatch, shard: int | None, capsys: Any
) -> None:
    command = ["dataset", "spec.yaml", "-o", "out", *(() if shard is None else ("--shard", str(shard))), "--quiet"]
    folder = place / ("out" if shard is None else "out/unfinished")
    sync, calls = os.fsync, iter(range(3))

    def full(descriptor: int) -> None:
        if (folder / "000001.exr").exists() and next(calls, None) is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        sync(descriptor)

    with monkeypatch.context() as disk:
        disk.setattr(os, "fsync", full)
        assert main(command) == 4
    assert "000001" in capsys.readouterr().err and next(calls, None) is None
    assert sorted(path.name for path in folder.glob("0*")) == ["000000.exr", "000000.json", "000000.png"]
    assert main(command) == 0
    assert main([*command[:3], "other", *command[4:]]) == 0
    assert bytes_of(place / "out") == bytes_of(place / "other")


@pytest.mark.slow
def test_states_drawn_from_a_continuum_share_pupils_and_frames_stay_what_they_are_alone(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = SPECIFICATION.replace("{choice: [2.8, 8]}", "{uniform: [2.8, 3.1]}")
    (place / "drawn.yaml").write_text(drawn + "  camera.focus.distance_m: {uniform: [3.8, 4.2]}\n", "utf-8")
    assert read_specification("spec.yaml").scene.camera.pupil == "auto"
    assert read_specification("drawn.yaml").scene.camera.pupil == "shared"
    monkeypatch.setenv(CACHE_VARIABLE, str(place / "one"))
    forget()
    whole = list(dataset("drawn.yaml", "all"))
    assert sum(path.stat().st_size > 20_000 for path in (place / "one/pupils").iterdir()) < len(whole)
    monkeypatch.setenv(CACHE_VARIABLE, str(place / "two"))
    forget()
    [alone] = dataset("drawn.yaml", "some", only=[4])
    forget()
    assert alone.record == whole[4].record and alone.image.metadata["pupil"] == "shared"
    assert np.array_equal(alone.image.pixels, render(read_specification("drawn.yaml").frame(4)[1]).pixels)


@pytest.mark.parametrize(
    "key, lens",
    [
        slow("camera.focal_length_mm: {uniform: [100, 101]}", "zoom-70-200mm"),
        slow("camera.movements.rise_mm: {uniform: [-2, 2]}", "dgauss-50mm"),
    ],
)
def test_zooms_and_shifts_drawn_from_a_continuum_share_pupils(key: str, lens: str, place: Path) -> None:
    lens_too = SPECIFICATION.replace("[depth]}", f"[depth], camera.lens: {lens}}}")
    drawn, chosen = (
        lens_too.replace("camera.f_number: {choice: [2.8, 8]}", each)
        for each in (key, key.replace("uniform", "choice"))
    )
    (place / "drawn.yaml").write_text(drawn, "utf-8")
    assert read_specification("drawn.yaml").scene.camera.pupil == "shared"
    (place / "chosen.yaml").write_text(chosen, "utf-8")
    assert read_specification("chosen.yaml").scene.camera.pupil == "auto"
    forget()
    whole = list(dataset("drawn.yaml", "all", frames=3))
    forget()
    [alone] = dataset("drawn.yaml", "some", only=[2])
    assert alone.record == whole[2].record and alone.image.metadata["pupil"] == "shared"
    assert np.array_equal(alone.image.pixels, whole[2].image.pixels)


@pytest.mark.parametrize(("width_mm", "fits"), [(36, 1), slow(50, 3)], ids=["light in the corners", "dark corners"])
def test_f_numbers_share_a_camera_model_and_frames_stay_what_they_are_alone(
    place: Path, width_mm: float, fits: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = {
        "scene": "scene.yaml",
        "frames": 3,
        "set": {"film.width_mm": width_mm},
        "camera_model": "auto",
        "vary": {"camera.f_number": {"uniform": [2.8, 16]}},
    }
    calls: list[CameraView] = []
    monkeypatch.setattr(
        frames, "calibrate_best", lambda seen, *others: calls.append(seen) or calibrate_best(seen, *others)
    )
    whole = list(dataset(source))
    assert len(calls) == fits
    [alone] = dataset(source, only=[2])
    assert alone.record == whole[2].record


def test_a_frame_is_the_picture_of_its_scene_and_its_camera_that_of_the_picture(place: Path) -> None:
    [frame] = dataset("spec.yaml", only=[4])
    values, scene = read_specification("spec.yaml").frame(4)
    assert frame.values == values and values["objects.0.radius"] == 0.5
    again = render(scene)
    assert np.array_equal(frame.image.pixels, again.pixels) and not frame.kept
    camera = frame.record["camera"]
    assert camera["entrance_pupil"] == frame.image.metadata["entrance_pupil"]
    assert camera["largest_error_px"] < 0.01
    # The middle of the ball, through the camera of the record, lies where the layer of depth has the ball.
    pose = np.array(camera["world_from_camera"])
    seen = pose[:3, :3].T @ (np.array([0, 0.5, 0]) - pose[:3, 3])
    [[x, y]] = project(camera["model"], np.array(list(camera["parameters"].values())), seen[None])
    assert np.isfinite(frame.image.layers["depth"][int(y), int(x)])
    assert np.linalg.norm(seen) == pytest.approx(frame.image.layers["depth"][int(y), int(x)] + 0.5, abs=0.1)


def test_frames_differ_in_what_is_drawn_and_in_their_noise(place: Path) -> None:
    frames = list(dataset("spec.yaml", "out", only=[0, 1]))
    assert frames[0].values != frames[1].values
    assert frames[0].record["seed"] != frames[1].record["seed"]
    kept = next(iter(dataset("spec.yaml", "out", only=[0])))
    assert kept.kept and kept.record == frames[0].record
    assert read_film(place / "out/000001.exr").metadata["scene_hash"] == frames[1].record["scene_hash"]


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("camera.f_number", "camera.aparture", "spec.yaml:8:20: vary: camera.aparture: unknown key"),
        ("[2.8, 8]", "[0.1, 8]", "spec.yaml:8:20: vary: .*opens to f/2.03"),
        ("{grid: [0.4", "{grid: [-1", r"spec.yaml:10:21: vary: objects\[0\].radius"),
        ("{choice: [2.8, 8]}", "{chance: [2.8, 8]}", "spec.yaml:8:20: vary.camera.f_number: needs exactly one kind"),
        ("frames: 5", "frames: 0", r"spec.yaml:2:9: frames: is out of range \(got 0; allowed: 1 to 100000000\)"),
        ("frames: 5", "frames: 2.5", "spec.yaml:2:9: frames: must be a whole number"),
        ("seed: 7", "seed: -1", "spec.yaml:3:7: seed: is out of range"),
        ("frames: 5\n", "", "frames: is missing"),
        ("files: [exr, png]", "files: [gif]", "spec.yaml:5:8: files: unknown suffix"),
        ("brown_conrady", "brown", "spec.yaml:6:15: camera_model: unknown model"),
        ("scene.yaml", "../scene.yaml", "spec.yaml:1:8: scene: lies outside"),
        ("seed: 7", "sead: 7", "sead: unknown key"),
        (
            "set: {render.layers: [depth]}",
            "set: {render.leyers: [depth]}",
            "spec.yaml:4:6: set: render.leyers: unknown",
        ),
    ],
)
def test_what_is_wrong_is_said_with_its_place_before_anything_is_made(
    place: Path, old: str, new: str, words: str
) -> None:
    (place / "spec.yaml").write_text(SPECIFICATION.replace(old, new), "utf-8")
    with pytest.raises(InputError, match=words):
        dataset("spec.yaml", "out")
    assert not (place / "out").exists()


@pytest.mark.parametrize(
    "given, words",
    [
        ({"frames": 2.5}, r"frames: must be a whole number \(got 2.5; allowed: 1 to 100000000\)"),
        ({"frames": "3"}, "frames: must be a whole number"),
        ({"frames": 0}, "frames: is out of range"),
        ({"shard": "a", "folder": "out"}, "shard: must be a whole number"),
        ({"shard": 0, "folder": "out"}, "shard: is out of range"),
        ({"shard": 3}, "shard: needs a folder"),
        ({"folder": 3}, "folder: must be a path"),
        ({"only": 2}, r"only: must be a list of numbers of frames \(got 2; allowed: 0 to 4, as \[0\]\)"),
        ({"only": [0, 1.5]}, r"only: must be a list of whole numbers \(got 1.5 in it"),
        ({"only": []}, "only: names no frame"),
        ({"only": [0, 9]}, r"frames: 9 is none of the dataset's 5 \(allowed: 0 to 4\)"),
    ],
)
def test_wrong_arguments_are_refused_in_one_line(place: Path, given: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=f"^{words}"):
        dataset("spec.yaml", **given)
    with pytest.raises(InputError, match=f"^{words}"):
        dataset(read_specification("spec.yaml"), **given)


def test_a_dataset_is_a_file_or_a_mapping() -> None:
    with pytest.raises(InputError, match="a dataset must be a file or a mapping"):
        dataset(5)  # type: ignore[arg-type]


def test_frames_may_be_an_array_and_replace_those_of_a_specification(place: Path) -> None:
    [frame] = dataset(read_specification("spec.yaml"), "out", frames=9, only=np.array([7]))
    assert frame.record["frame"] == 7
    assert len([*(place / "out/manifest.jsonl").open()]) == 1


def test_a_focus_that_a_lens_does_not_reach_is_said_with_the_number_of_the_frame(place: Path) -> None:
    focus = {"camera.focus.distance_m": {"normal": {"mean": 0.9, "sd": 0.3}}}
    wanted = read_specification({"scene": "scene.yaml", "frames": 2000, "camera_model": "none", "vary": focus})
    near = next(n for n in range(2000) if 0.05 < values_of_frame(wanted.vary, 0, n)["camera.focus.distance_m"] < 0.19)
    with pytest.raises(InputError, match=f"^frame {near}: .*cannot focus at"):
        list(dataset(wanted, only=[near]))


def test_records_describe_the_camera_model_that_took_the_picture(place: Path) -> None:
    loose = {"max_error_px": 9, "max_illumination_error": 9}
    wall = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": {"kind": "emissive", "radiance": 1}}
    fixed = {"camera.accuracy": loose, "objects": [wall], "film.resolution": [48, 32], "render.layers": ["position"]}
    vary = {"camera.f_number": {"choice": [16]}}
    [frame] = dataset({"scene": "scene.yaml", "frames": 1, "set": fixed, "vary": vary})
    assert frame.image is not None and frame.image.metadata["camera"] == "pinhole"
    known = frame.record["camera"]
    assert known["model"] == "pinhole"
    seen = np.linalg.inv(known["world_from_camera"]) @ np.append(frame.image["position"][0, 0], 1.0)
    at = np.array(known["matrix"]) @ seen[:3] / seen[2]
    assert np.abs(at[:2] - 0.5).max() < 0.5  # in the pixel at the corner, from which the lens is half a pixel off


def test_autofocus_that_fails_is_said_with_the_number_of_the_frame(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*given: Any, **named: Any) -> None:
        raise NumericError("no light", "the picture")

    monkeypatch.setattr("rptcam_cl.studies.focus.controller.in_focus", fails)
    vary = {"camera.focus": {"choice": [{"auto": {"method": "contrast"}}]}}
    with pytest.raises(NumericError, match=r"^frame 3: no light") as found:
        list(dataset({"scene": "scene.yaml", "frames": 5, "vary": vary}, only=[3]))
    assert found.value.image == "the picture"


def test_wrong_frames_and_folders_are_refused(place: Path) -> None:
    list(dataset("spec.yaml", "out", only=[0]))
    (place / "spec.yaml").write_text(SPECIFICATION.replace("seed: 7", "seed: 8"), "utf-8")
    with pytest.raises(StateError, match="holds frames of another dataset"):
        dataset("spec.yaml", "out")
    (place / "spec.yaml").write_text(SPECIFICATION, "utf-8")
    layers = read_specification("spec.yaml", ["render.layers=[normal]"])
    assert layers.key != read_specification("spec.yaml").key  # files hold them
    (place / "full").mkdir()
    (place / "full/notes.json").write_text("{}")
    with pytest.raises(StateError, match="holds other files"):
        dataset("spec.yaml", "full")
    (place / "file").write_text("")
    with pytest.raises(StateError, match="cannot be made"):
        dataset("spec.yaml", "file/out")


@pytest.mark.slow
def test_a_run_killed_at_random_goes_on_to_the_same_bytes(place: Path) -> None:
    command = [sys.executable, "-m", "rptcam_cl", "dataset", "spec.yaml", "-n", "1000", "--quiet", "--shard", "64"]
    assert subprocess.run([*command, "-o", "whole"], check=False).returncode == 0
    chance, kills = random.Random(5), 0
    while not (place / "broken/manifest.jsonl").exists():
        run = subprocess.Popen([*command, "-o", "broken"], start_new_session=True)
        try:
            run.wait(timeout=chance.uniform(1, 4))
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
            run.wait()
            kills += 1
        time.sleep(0.05)
    assert kills >= 5
    assert bytes_of(place / "broken") == bytes_of(place / "whole")
    assert len([*(place / "broken/manifest.jsonl").open()]) == 1000
    assert json.loads((place / "broken/dataset.json").read_text())["shard"] == 64
