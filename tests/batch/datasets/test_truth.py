"""Labels of datasets: masks and annotations of each frame, beside files that stay as they are without."""

import hashlib
import json
import tarfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import PIL.Image
import pytest
from pycocotools.coco import COCO

from rptcam_cl.api.job import render
from rptcam_cl.batch.dataset import dataset, read_specification
from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.writers import LABELS
from tests.support.cases import slow

SCENE = """\
film: {resolution: [32, 24], width_mm: 36}
camera: {kind: thin_lens, focal_length_mm: 50, f_number: 4, eye: [0, 1, 5], target: [0, 0.5, 0], focus_distance_m: 4}
materials:
  grey: {kind: matte, reflectance: 0.5}
objects:
  - {shape: sphere, center: [-0.6, 0.5, 0], radius: 0.5, material: grey, name: left, label: ball}
  - {shape: sphere, center: [0.6, 0.5, 0], radius: 0.5, material: grey}
  - {shape: board, kind: checker, columns: 4, rows: 3, pitch: 0.2, name: target, transform: {translate: [0, 1.5, 0]}}
environment: {kind: constant, radiance: 1}
render: {spp: 2}
"""
PLAIN = """\
scene: scene.yaml
frames: 4
set: {render.layers: [depth]}
files: [npz, png]
vary:
  camera.f_number: {choice: [2.8, 8]}
  objects.0.radius: {uniform: [0.3, 0.5]}
"""
LABELLED = PLAIN.replace("vary:", "truth: true\nvary:")
TRUTH = ("coco.json", "instances.png", "classes.png", "depth.npy")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "scene.yaml").write_text(SCENE, "utf-8")
    (tmp_path / "plain.yaml").write_text(PLAIN, "utf-8")
    (tmp_path / "spec.yaml").write_text(LABELLED, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.slow
def test_truth_of_a_frame_is_that_of_the_picture_of_its_scene(place: Path) -> None:
    *_, frame = dataset("spec.yaml", "out")
    image = render(read_specification("spec.yaml").frame(3)[1], layers=LABELS)
    files = image.save_truth(place / "alone", "000003.png", image_id=3, prefix="000003.")
    assert [path.name for path in files] == [f"000003.{name}" for name in TRUTH]
    for path in files:
        assert (place / "out" / path.name).read_bytes() == path.read_bytes()
        assert frame.record["files"][path.name] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert list(frame.record["files"]) == [f"000003.{name}" for name in ("npz", "png", *TRUTH)]
    assert frame.image.coco()["annotations"]
    plain = render(read_specification("spec.yaml").frame(3)[1], layers=LABELS).coco("000003.png")
    said = json.loads((place / "out/000003.coco.json").read_text())
    assert said["images"] == [{"id": 3, "file_name": "000003.png", "width": 32, "height": 24}]
    for one, other in zip(said["annotations"], plain["annotations"], strict=True):
        assert one | {"id": 0, "image_id": 0} == other | {"id": 0, "image_id": 0}


def test_annotations_of_all_frames_can_be_joined(place: Path) -> None:
    list(dataset("spec.yaml", "out"))
    joined: dict[str, Any] = {"images": [], "annotations": []}
    for path in sorted((place / "out").glob("*.coco.json")):
        said = json.loads(path.read_text())
        joined["categories"] = said["categories"]
        joined["images"] += said["images"]
        joined["annotations"] += said["annotations"]
    (place / "all.json").write_text(json.dumps(joined))
    known = COCO(str(place / "all.json"))
    assert known.getImgIds() == [0, 1, 2, 3]
    assert len(known.anns) == len(joined["annotations"]) == 12  # no two have one identifier
    assert [each["name"] for each in known.loadCats(known.getCatIds())] == ["ball", "object"]
    for number in range(4):
        with PIL.Image.open(place / f"out/{known.imgs[number]['file_name'][:6]}.instances.png") as picture:
            instances = np.asarray(picture)
        [ball] = known.loadAnns(known.getAnnIds(imgIds=number, catIds=1))
        np.testing.assert_array_equal(known.annToMask(ball), instances == 1)


def test_pictures_and_records_are_those_without_truth(place: Path) -> None:
    labelled, plain = list(dataset("spec.yaml", "labelled")), list(dataset("plain.yaml", "plain"))
    for one, other in zip(labelled, plain, strict=True):
        assert np.array_equal(one.image.pixels, other.image.pixels)
        mine = {key: value for key, value in one.record.items() if key not in ("files", "boards")}
        assert mine == {key: value for key, value in other.record.items() if key != "files"}
        assert list(other.record["files"]) == [f"{one.index:06d}.npz", f"{one.index:06d}.png"]
        assert one.record["boards"] == one.image.metadata["boards"] and len(one.record["boards"][0]["corners"]) == 6
    with np.load(place / "labelled/000002.npz") as arrays, np.load(place / "plain/000002.npz") as others:
        assert arrays.files == others.files and np.array_equal(arrays["depth"], others["depth"])


def test_a_dataset_without_truth_is_the_same_whether_it_says_so(place: Path) -> None:
    silent = read_specification("plain.yaml")
    (place / "plain.yaml").write_text(LABELLED.replace("true", "false"), "utf-8")
    assert read_specification("plain.yaml").key == silent.key != read_specification("spec.yaml").key
    assert "truth" not in silent.content


def test_frames_with_truth_have_the_same_bytes_alone_damaged_and_in_shards(place: Path, capsys: Any) -> None:
    list(dataset("spec.yaml", "all"))
    whole = bytes_of(place / "all")
    assert len(whole) == 4 * 7 + 2
    list(dataset("spec.yaml", "one", only=[2]))
    alone = bytes_of(place / "one")
    assert sum(name.startswith("000002.") for name in alone) == 7
    assert all(content == whole[name] for name, content in alone.items() if name.startswith("000002."))

    (place / "all/000001.instances.png").write_bytes(b"broken")
    (place / "all/000002.coco.json").unlink()
    (place / "all/000003.json").unlink()
    assert main(["dataset", "spec.yaml", "-o", "all"]) == 0
    assert "3 frames rendered, 1 kept" in capsys.readouterr().err
    assert bytes_of(place / "all") == whole

    command = ["dataset", "spec.yaml", "-o", "packed", "--shard", "3"]
    assert main([*command, "--frames", "0-1", "--quiet"]) == 0
    assert main(command) == 0
    assert "2 frames rendered, 2 kept" in capsys.readouterr().err
    assert main(command) == 0
    assert "0 frames rendered, 4 kept" in capsys.readouterr().err
    assert sorted(path.name for path in (place / "packed").iterdir()) == [
        "dataset.json", "manifest.jsonl", "shard-000000.tar", "shard-000001.tar",
    ]  # fmt: skip
    with tarfile.open(place / "packed/shard-000000.tar") as shard:
        assert shard.getnames() == [f"{n:06d}.{suffix}" for n in range(3) for suffix in ("npz", "png", *TRUTH, "json")]
        for member in shard:
            content = shard.extractfile(member)
            assert content is not None and content.read() == whole[member.name]
    assert (place / "packed/manifest.jsonl").read_bytes() == whole["manifest.jsonl"]


DRAWN = {
    "a label": "objects.1.label: {choice: [cup, mug, vase]}",
    "a label, in brackets": "'objects[1].label': {grid: [mug, cup, null]}",
    "whole objects": """objects: {grid: [
    [{shape: sphere, center: [0.6, 0.5, 0], radius: 0.5, material: grey, label: mug},
     {shape: sphere, center: [-0.6, 0.5, 0], radius: 0.4, material: grey}],
    [{shape: sphere, center: [-0.6, 0.5, 0], radius: 0.4, material: grey, label: crate},
     {shape: sphere, center: [0.6, 0.5, 0], radius: 0.5, material: grey, label: ball}]]}""",
}


@pytest.mark.parametrize("drawn", ["whole objects", *(slow(each) for each in DRAWN if each != "whole objects")])
def test_a_class_has_one_number_in_all_frames_masks_and_annotations(place: Path, drawn: str) -> None:
    text = LABELLED.replace("objects.0.radius: {uniform: [0.3, 0.5]}", DRAWN[drawn])
    text = text.replace("[depth]", "[sharp_class_id]").replace("frames: 4", "frames: 6")
    (place / "spec.yaml").write_text(text, "utf-8")
    seen: dict[str, set[int]] = {}
    for frame in dataset("spec.yaml", "out"):
        scene = read_specification("spec.yaml").frame(frame.index)[1]
        said = json.loads((place / f"out/{frame.index:06d}.coco.json").read_text())
        instances, classes = (
            np.asarray(PIL.Image.open(place / f"out/{frame.index:06d}.{name}.png")) for name in ("instances", "classes")
        )
        layer = np.load(place / f"out/{frame.index:06d}.npz")["sharp_class_id"]
        assert said["categories"] == json.loads((place / "out/dataset.json").read_text())["categories"]
        of_object = {each["id"] % 65536 - 1: each["category_id"] for each in said["annotations"]}
        assert of_object
        for index, category in of_object.items():
            label = scene.objects[index].label
            seen.setdefault(label or "object", set()).add(category)
            assert set(classes[instances == index + 1].tolist()) == {category if label else 0}
            assert set(layer[instances == index + 1].tolist()) == {category if label else 0}
    assert len(seen) >= 3 and all(len(numbers) == 1 for numbers in seen.values())
    assert len(set.union(*seen.values())) == len(seen)
    known = json.loads((place / "out/dataset.json").read_text())["categories"]
    assert known[-1]["name"] == "object" and {each["name"]: {each["id"]} for each in known}.items() >= seen.items()


BOARD = """\
scene:
  film: {resolution: [160, 120], width_mm: 36}
  camera: {kind: realistic, lens: dgauss-50mm, eye: [0.3, 0.5, 1.2], target: [0, 0, 0], focus: {distance_m: 1.3}}
  objects:
    - {shape: board, kind: checker, columns: 9, rows: 7, pitch: 0.2, name: target}
  environment: {kind: constant, radiance: 1}
set: {render.layers: [sharp_position, sharp_depth], render.spp: 1, film.crop: [0.1, 0.95, 0, 1]}
files: [exr, png]
frames: 2
truth: true
vary: {camera.lens: {grid: [dgauss-50mm, retrofocus-35mm]}}
"""


@pytest.mark.slow
def test_depths_of_frames_unproject_by_their_matrix_and_pose_to_where_the_board_is(place: Path) -> None:
    """By OpenCV, whose pixels have their centres half a pixel earlier."""
    (place / "board.yaml").write_text(BOARD, "utf-8")
    for frame in dataset("board.yaml", "out"):
        depth, camera = np.load(place / f"out/{frame.index:06d}.depth.npy").astype(np.float64), frame.record["camera"]
        matrix = np.array(camera["matrix"]) - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
        bent = np.array([camera["parameters"].get(name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3")])
        assert camera["model"] in ("pinhole", "brown_conrady")
        rows, columns = np.nonzero(np.isfinite(depth))
        pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2).astype(np.float64)
        ends = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
        away = cv2.undistortPoints(pixels, matrix, bent, None, None, None, ends).reshape(-1, 2)
        seen = np.column_stack([away, np.ones(len(away))]) * depth[rows, columns, None]
        points = seen @ np.array(camera["world_from_camera"])[:3, :3].T + np.array(camera["world_from_camera"])[:3, 3]
        assert len(points) > 8000
        assert np.abs(points[:, 2]).max() < 1e-4  # the board is the plane z = 0
        away_m = np.linalg.norm(points - frame.image["sharp_position"][rows, columns], axis=1)
        assert away_m.max() < 2e-4 and np.median(away_m) < 5e-5  # along a ray that leaves the drifting pupil
        film = frame.image["sharp_depth"][rows, columns] - depth[rows, columns]
        np.testing.assert_allclose(film, camera["entrance_pupil"]["ahead_of_eye_mm"] * 1e-3, atol=1e-6)

        with OpenEXR.File(str(place / f"out/{frame.index:06d}.exr")) as file:  # rows times the matrix, y up, z back
            moved = np.column_stack([points, np.ones(len(points))]) @ np.array(file.header()["worldToCamera"])
        np.testing.assert_allclose(moved[:, :3], seen * [1, -1, -1], atol=1e-6)
        np.testing.assert_allclose(moved[:, 3], 1, atol=1e-6)


def test_frames_that_were_labelled_otherwise_are_not_kept(place: Path) -> None:
    before = read_specification("spec.yaml")
    plain = read_specification("plain.yaml")
    (place / "scene.yaml").write_text(SCENE.replace("label: ball", "label: globe"), "utf-8")
    assert read_specification("spec.yaml").key != before.key
    assert before.classes == ("", "ball") and plain.classes == before.classes


def test_annotations_name_the_first_file_where_no_frame_has_a_picture(place: Path) -> None:
    (place / "spec.yaml").write_text(LABELLED.replace("[npz, png]", "[npz]"), "utf-8")
    list(dataset("spec.yaml", "out", only=[1]))
    assert json.loads((place / "out/000001.coco.json").read_text())["images"][0]["file_name"] == "000001.npz"


@pytest.mark.parametrize("value", ["maybe", "1", "[coco]", ""])
def test_truth_is_true_or_false(place: Path, value: str) -> None:
    (place / "spec.yaml").write_text(LABELLED.replace("true", value), "utf-8")
    with pytest.raises(InputError, match=r"^spec.yaml:5:(7|8): truth: must be true or false \(got "):
        read_specification("spec.yaml")
