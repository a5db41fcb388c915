"""What ``rptcam camera`` writes and says: all files or none, refusals before anything is traced, notes and warnings."""

import json

import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import StateError

SMALL = ["dgauss-50mm", "--size", "96x64"]
MOVING = {
    "film": {"resolution": [96, 64], "size_mm": [36.0, 24.0]},
    "camera": {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40},
    "shutter": {"time_s": 0.5},
}
WAY = [{"time_s": 0}, {"time_s": 1, "eye": [2, 0, 5]}]
ZOOM = {"camera.fov_degrees": [{"time_s": 0, "value": 40}, {"time_s": 1, "value": 80}]}


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--opencv", "{0}/new.yaml", "--colmap", "{0}/there.txt"], "--colmap: {0}/there.txt is no folder"),
        (["--opencv", "{0}/new.yaml", "--colmap", "{0}/none/model"], "there is no folder {0}/none"),
        (["--opencv", "{0}/new.yaml", "--ros", "{0}/new.yaml"], "--ros: {0}/new.yaml is the output of --opencv too"),
        (["--opencv", "{0}/a.svg", "--plot", "{0}/../{1}/a.svg"], "a.svg is the output of --opencv too"),
        (["--coc", "{0}/a.exr", "--vignetting", "{0}/a.exr"], "--coc: {0}/a.exr is the output of --vignetting too"),
        (["--opencv", "{0}/model", "--colmap", "{0}/model"], "--colmap: {0}/model is the output of --opencv too"),
        (["--ros", "{0}/model/images.txt", "--colmap", "{0}/model"], "images.txt is the output of --ros too"),
        (["--usd", "{0}/a.usdc"], "--usd: {0}/a.usdc: such a file is .usda or .usd (got .usdc)"),
        (["--usd", "{0}/a"], "such a file is .usda or .usd (got none)"),
    ],
)
def test_outputs_are_checked_before_any_is_written(words, message, tmp_path, capsys):
    (tmp_path / "there.txt").write_text("kept")
    told = tmp_path, tmp_path.name
    assert main(["camera", *SMALL, *(word.format(*told) for word in words)]) in (2, 4)
    said = capsys.readouterr()
    assert message.format(*told) in said.err
    assert said.err.count("error:") == 1
    assert said.out == ""  # nothing is fitted either
    assert names_in(tmp_path) == ["there.txt"]
    assert (tmp_path / "there.txt").read_text() == "kept"


def test_colmap_into_a_folder_with_a_file_in_the_way_writes_nothing(tmp_path, capsys):
    (tmp_path / "model" / "points3D.txt").mkdir(parents=True)
    words = ["--opencv", str(tmp_path / "new.yaml"), "--colmap", str(tmp_path / "model")]
    assert main(["camera", *SMALL, *words]) == 4
    assert "points3D.txt: is a folder" in capsys.readouterr().err
    assert names_in(tmp_path) == ["model"]
    assert names_in(tmp_path / "model") == ["points3D.txt"]


def test_failure_while_the_last_file_is_written_leaves_none(tmp_path, capsys, monkeypatch):
    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("rptcam_cl.exchange.camera_maps.vignetting_exr", fail)
    files = {"opencv": "cv.yaml", "vignetting": "v.exr", "colmap": "model"}
    words = [word for name, file in files.items() for word in (f"--{name}", str(tmp_path / file))]
    assert main(["camera", "achromat-100mm", "--size", "24x16", *words]) == StateError.exit_code
    assert "v.exr: cannot be written: No space left on device" in capsys.readouterr().err
    assert names_in(tmp_path) == []


def test_files_may_go_into_the_new_folder_of_colmap(tmp_path):
    model = tmp_path / "model"
    assert main(["camera", *SMALL, "--colmap", str(model), "--opencv", str(model / "cv.yaml")]) == 0
    assert names_in(model) == ["cameras.txt", "cv.yaml", "images.txt", "points3D.txt"]


def test_usd_takes_text_under_both_of_its_suffixes(tmp_path):
    Usd = pytest.importorskip("pxr.Usd")
    for name in ("a.usda", "a.usd"):
        assert main(["camera", *SMALL, "--usd", str(tmp_path / name)]) == 0
        assert str(Usd.Stage.Open(str(tmp_path / name)).GetDefaultPrim().GetPath()) == "/Camera"


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({}, False),
        ({"camera": MOVING["camera"] | {"motion": WAY}}, True),
        ({"camera": MOVING["camera"] | {"motion": WAY}, "shutter": {"time_s": 0.5, "open_s": 2}}, False),
        ({"shutter": {"time_s": 0.5, "open_s": 0.25, "keys": ZOOM}}, True),
        ({"shutter": {"time_s": 0.5, "open_s": 1, "keys": ZOOM}}, False),
        ({"shutter": {"time_s": 0.5, "keys": {"environment.radiance": ZOOM["camera.fov_degrees"]}}}, False),
    ],
    ids=["still", "moves", "has moved", "zooms", "has zoomed", "light changes"],
)
def test_camera_that_changes_in_the_exposure_is_that_of_its_opening_and_says_so(changes, says, tmp_path, capsys):
    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps(MOVING | {"environment": {"kind": "constant", "radiance": 1}} | changes))
    assert main(["camera", str(scene)]) == 0
    said = capsys.readouterr().err.splitlines()
    opening = changes.get("shutter", {}).get("open_s", 0)
    note = f"note: the camera changes while the shutter is open; this is its state when it opens, at {opening:g} s"
    assert [line.startswith(note) for line in said] == ([True] if says else [])


def test_camera_in_whose_place_renders_may_have_another_says_so(tmp_path, capsys):
    scene = tmp_path / "scene.json"
    lens = {"kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 0, 2], "target": [0, 0, 0], "accuracy": "auto"}
    scene.write_text(json.dumps({"camera": lens | {"focus": {"distance_m": 2}}}))
    assert main(["camera", str(scene), "--model", "brown_conrady"]) == 0
    said = capsys.readouterr()
    assert "Double Gauss" in said.out
    assert "note: this is the lens, in whose place camera.accuracy may let renders have a simpler camera" in said.err


def test_another_moment_is_had_by_the_opening(tmp_path, capsys):
    scene = tmp_path / "scene.json"
    keys = {"time_s": 0.5, "keys": ZOOM}
    scene.write_text(json.dumps(MOVING | {"camera": MOVING["camera"] | {"motion": WAY}, "shutter": keys}))

    def found(*words):
        assert main(["camera", str(scene), "--json", *words]) == 0
        return json.loads(capsys.readouterr().out)

    at_0, at_1 = found(), found("--set", "shutter.open_s=1")
    assert (at_0["world_from_camera"][0][3], at_1["world_from_camera"][0][3]) == pytest.approx((0, 2))
    assert at_0["models"]["pinhole"]["fx"] > 2 * at_1["models"]["pinhole"]["fx"]


def test_model_that_fits_badly_is_a_warning_that_names_what_fits(capsys):
    assert main(["camera", "phone-5.6mm"]) == 0
    said = capsys.readouterr()
    assert said.err == (
        "warning: rational fits best and errs by 0.152 px;"
        " maps of the lens itself have no residual: --stmap-undistort\n"
    )
    assert "largest error [px]   0.15229" in said.out


@pytest.mark.slow
@pytest.mark.parametrize("words", [["--max-residual-px", "0.2"], ["--model", "rational"], ["--size", "256x192"]])
def test_model_that_is_good_enough_or_chosen_is_no_warning(words, capsys):
    assert main(["camera", "phone-5.6mm", *words]) == 0
    assert capsys.readouterr().err == ""
