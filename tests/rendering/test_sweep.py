"""Sweeps: each picture is the one that its scene gives alone; what is there is kept; mistakes come before any work."""

import csv
import json

import numpy as np
import pytest
from PIL import Image as Pillow

import rptcam_cl
from rptcam_cl.api import combined
from rptcam_cl.api.job import SeriesRenderer
from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.scene.changes import set_keys
from tests.rendering.pictures import MATTE, WHITE, looking, scene_of
from tests.rendering.test_world import still_life

OVER = {"camera.fov_degrees": [30, 50.0], "picture.ev": [0, 1, 2]}
OPTIONS = {"size": (24, 16), "spp": 2, "seed": 5}
BALL = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": MATTE}
SMALL = scene_of([BALL], looking([0, -4, 0], [0, 0, 0]), environment=WHITE)


@pytest.fixture
def swept(tmp_path):
    return list(rptcam_cl.sweep(still_life(), OVER, tmp_path / "out", mtf_at=(0.5, 0.5), **OPTIONS))


def test_each_picture_is_that_of_its_scene_alone(swept, tmp_path):
    assert [tuple(entry.values.values()) for entry in swept] == [(f, e) for f in (30, 50.0) for e in (0, 1, 2)]
    scene = rptcam_cl.load_scene(still_life(), ["camera.fov_degrees=50", "picture.ev=1"])
    alone = rptcam_cl.render(scene, **OPTIONS)
    np.testing.assert_array_equal(swept[4].image.pixels, alone.pixels)
    np.testing.assert_array_equal(swept[4].image.developed(), alone.developed())
    assert swept[4].measures["mean"] == pytest.approx(float(alone.luminance.mean()))
    assert swept[4].label == "fov_degrees 50, ev 1"


def test_tables_and_sheet_hold_every_entry(swept, tmp_path):
    rows = list(csv.DictReader((tmp_path / "out/table.csv").open()))
    plain = json.loads((tmp_path / "out/table.json").read_text())
    assert list(rows[0]) == [*OVER, "mean", "noise", "spp", "seconds", "mtf50", "file"]
    assert len(rows) == len(plain) == 6
    assert [float(row["mean"]) for row in rows] == [entry.measures["mean"] for entry in swept]
    assert all((tmp_path / "out" / row["file"]).exists() for row in rows)
    with Pillow.open(tmp_path / "out/contact_sheet.png") as sheet:
        assert sheet.width > 3 * 160  # the last key goes across
        assert sheet.width > sheet.height


def test_what_is_there_is_kept_and_the_rest_rendered(swept, tmp_path, monkeypatch):
    swept[1].file.unlink()
    swept[2].file.write_bytes(swept[2].file.read_bytes()[:500])
    swept[3].file.with_suffix(".json").unlink()
    rendered = []
    real = SeriesRenderer.render

    def counted(self, scene):
        rendered.append(scene)
        return real(self, scene)

    monkeypatch.setattr(SeriesRenderer, "render", counted)
    again = list(rptcam_cl.sweep(still_life(), OVER, tmp_path / "out", mtf_at=(0.5, 0.5), **OPTIONS))
    assert [entry.kept for entry in again] == [True, False, False, False, True, True]
    assert len(rendered) == 3
    for one, other in zip(swept, again, strict=True):
        np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
        np.testing.assert_array_equal(one.image.developed(), other.image.developed())
    longer = list(rptcam_cl.sweep(still_life(), OVER, tmp_path / "out", **(OPTIONS | {"spp": 3})))
    assert not any(entry.kept for entry in longer)


def test_film_of_another_entry_or_with_other_measures_is_made_anew(swept, tmp_path):
    again = list(rptcam_cl.sweep(still_life(), OVER, tmp_path / "out", mtf_at=(0.5, 0.5), **OPTIONS))
    assert all(entry.kept for entry in again)
    swept[1].file.write_bytes(swept[4].file.read_bytes())
    for entry, text in ((swept[2], "[]"), (swept[3], json.dumps({"key": "other", "measures": {}}))):
        entry.file.with_suffix(".json").write_text(text)
    again = list(rptcam_cl.sweep(still_life(), OVER, tmp_path / "out", mtf_at=(0.5, 0.5), **OPTIONS))
    assert [entry.kept for entry in again] == [True, False, False, False, True, True]
    for one, other in zip(swept, again, strict=True):
        np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
        assert one.measures | {"seconds": 0} == other.measures | {"seconds": 0}


def test_film_whose_measures_cannot_be_written_is_not_kept(tmp_path, monkeypatch):
    real = combined.replacing

    def full(path, *more):
        if path.suffix == ".json":
            raise StateError(f"{path}: no space left on device")
        return real(path, *more)

    monkeypatch.setattr(combined, "replacing", full)
    with pytest.raises(StateError, match="no space left"):
        list(rptcam_cl.sweep(still_life(), {"picture.ev": [1]}, tmp_path / "out", **OPTIONS))
    assert list((tmp_path / "out").iterdir()) == []


def test_pictures_that_are_made_elsewhere_are_those_of_this_process(swept, tmp_path):
    asked = []

    def elsewhere(scenes):
        asked.extend(scenes)
        for number in reversed(scenes):
            image = rptcam_cl.render(scenes[number])
            image.stats["cluster"] = {"workers": {"one": {"seconds": 1.5}, "two": {"seconds": 2.25}}}
            yield number, image

    swept[2].file.unlink()
    swept[5].file.unlink()
    options = OPTIONS | {"mtf_at": (0.5, 0.5), "pictures": elsewhere}
    found = list(rptcam_cl.sweep(still_life(), OVER, tmp_path / "out", **options))
    assert asked == [2, 5]
    assert [entry.kept for entry in found] == [True, True, False, True, True, False]
    for one, other in zip(swept, found, strict=True):
        assert one.values == other.values
        np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
    assert [found[k].measures["seconds"] for k in (2, 5)] == [3.75, 3.75]


LENS = {"kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 1, 6], "target": [0, 0, 0], "focus": {"distance_m": 6}}


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ({}, "no key to vary"),
        ({"camera.fov_degrees": []}, "has no list of values"),
        ({"camera.fov_degrees": "30"}, "has no list of values"),
        ({"camera.fov": [30]}, r"camera\.fov=30: .*fov_degrees"),
        ({"camera.fov_degrees": [30, 400]}, r"^camera\.fov_degrees=400: "),
        ({"camera.fov_degrees": [30, 30]}, "is the same picture as"),
        ({"render.seed": list(range(10_001))}, "10001 combinations are too many"),
        ({"render.seed": list(range(101)), "picture.ev": list(range(100))}, "10100 combinations are too many"),
        ({"camera": [LENS], "camera.f_number": [4, 0.1]}, r"camera\.f_number=0\.1: .*opens to"),
    ],
)
def test_mistakes_are_named_before_any_work(over, message, tmp_path, monkeypatch):
    monkeypatch.setattr("rptcam_cl.api.combined.render", None)
    with pytest.raises(InputError, match=message):
        rptcam_cl.sweep(still_life(), over, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("place", [(1.5, 0.5), (0.5, -0.1), (0.5, 1.01)])
def test_edge_beside_the_picture_is_refused(place):
    with pytest.raises(InputError, match=r"^mtf_at: is no point of the picture"):
        rptcam_cl.sweep(still_life(), OVER, mtf_at=place)


def test_values_on_labels_and_in_tables_are_as_people_write_them(tmp_path):
    over = {"film.crop": [[0, 1, 0, 0.5]], "picture.ev": [1 / 3], "picture.tone": ["agx"], "render.seed": [7]}
    (entry,) = rptcam_cl.sweep(still_life(), over, tmp_path / "out", **OPTIONS)
    assert entry.label == "crop [0, 1, 0, 0.5], ev 0.333333, tone agx, seed 7"
    (row,) = csv.DictReader((tmp_path / "out/table.csv").open())
    assert [row[key] for key in over] == ["[0, 1, 0, 0.5]", str(1 / 3), "agx", "7"]
    assert row["file"] == entry.file.name and row["mean"] == str(entry.measures["mean"])


@pytest.mark.slow
def test_a_marked_speed_begins_a_series_and_is_told_once(tmp_path, capsys):
    path = tmp_path / "scene.yaml"
    path.write_text(json.dumps(still_life() | {"camera": LENS}))
    series = ["--over", "camera.f_number=2,2.8,…,8", "--over", "render.seed=1,2"]
    assert main(["sweep", str(path), *series, "-o", str(tmp_path / "out"), "--spp", "1", "--size", "12x8"]) == 0
    said = capsys.readouterr().err
    assert said.count("is marked f/2 and opens to f/2.03") == 1
    assert said.count(": rendered") == 10


@pytest.mark.slow
def test_what_follows_the_film_is_another_picture(tmp_path):
    scene = still_life()
    over = {"camera": [LENS], "camera.f_number": [16], "camera.diffraction": ["off", "on"]}
    first, second = rptcam_cl.sweep(scene, over, tmp_path / "out", **OPTIONS)
    assert "diffraction" not in first.image.metadata and "diffraction" in second.image.metadata
    assert first.image.metadata["scene_hash"] == second.image.metadata["scene_hash"]
    assert [entry.kept for entry in rptcam_cl.sweep(scene, over, tmp_path / "out", **OPTIONS)] == [True, True]


def test_film_without_the_layers_of_the_scene_is_made_anew(tmp_path):
    kept = []
    for layers in ([], ["depth"], ["depth"]):
        scene = set_keys(rptcam_cl.load_scene(SMALL), {"render.layers": layers})
        (entry,) = rptcam_cl.sweep(scene, {"camera.fov_degrees": [30]}, tmp_path / "out", **OPTIONS)
        kept.append(entry.kept)
    assert kept == [False, False, True]


def test_folder_that_cannot_be_written_is_named_before_any_work(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(StateError, match="file: is a file, not a folder"):
        rptcam_cl.sweep(still_life(), OVER, tmp_path / "file")


def test_sweep_without_a_folder_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (entry,) = rptcam_cl.sweep(still_life(), {"picture.ev": [1]}, **OPTIONS)
    assert (entry.file, entry.kept, list(tmp_path.iterdir())) == (None, False, [])
