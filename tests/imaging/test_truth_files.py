"""COCO annotations and masks: pycocotools reads them, with the same areas, boxes and pixels."""

import json
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from pycocotools.coco import COCO

from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.image import Image
from rptcam_cl.imaging.writers import run_lengths, run_text


def picture() -> Image:
    """Four objects of random blobs, one of them without a label."""
    rng = np.random.default_rng(3)
    coarse = rng.integers(-1, 4, (9, 13))
    objects = np.kron(coarse, np.ones((7, 9), int))[:60, :110].astype(np.int32)
    objects[rng.random(objects.shape) < 0.05] = -1
    of_object = [1, 2, 0, 1]
    classes = np.array([*of_object, 0], np.int32)[objects]
    metadata = {
        "object_names": ["a", "b", "c", "d"], "class_names": ["", "cup", "plate"], "object_classes": of_object,
        "occlusion": [0.0, 0.25, None, 1.0],
    }  # fmt: skip
    rays = np.ones((60, 110, 3))
    layers = {"sharp_object_id": objects, "sharp_class_id": classes, "ray_origin": rays, "ray_direction": rays}
    return Image(np.zeros((60, 110, 3), np.float32), metadata, layers=layers)


def test_pycocotools_reads_the_same_areas_boxes_and_pixels(tmp_path: Path) -> None:
    image = picture()
    files = image.save_truth(tmp_path / "truth", "a.png")
    assert [path.name for path in files] == ["coco.json", "instances.png", "classes.png", "rays.npz"]
    objects = image["sharp_object_id"]
    known = COCO(str(files[0]))
    assert [category["name"] for category in known.loadCats(known.getCatIds())] == ["cup", "plate", "object"]
    found = known.loadAnns(known.getAnnIds(imgIds=1))
    assert [each["name"] for each in found] == ["a", "b", "c", "d"]
    assert [each["category_id"] for each in found] == [1, 2, 3, 1]
    assert [each["occlusion"] for each in found] == [0.0, 0.25, None, 1.0]
    import pycocotools.mask

    for index, each in enumerate(found):
        np.testing.assert_array_equal(known.annToMask(each), objects == index)
        runs = known.annToRLE(each)
        assert int(pycocotools.mask.area(runs)) == each["area"] == (objects == index).sum()
        assert pycocotools.mask.toBbox(runs).tolist() == each["bbox"]
        again = pycocotools.mask.encode(np.asfortranarray(objects == index).astype(np.uint8))
        assert again["counts"].decode() == each["segmentation"]["counts"]
    np.testing.assert_array_equal(np.asarray(PIL.Image.open(files[1])), objects + 1)
    np.testing.assert_array_equal(np.asarray(PIL.Image.open(files[2])), image["sharp_class_id"])
    assert np.load(files[3])["ray_direction"].shape == (60, 110, 3)
    assert json.loads(files[0].read_text()) == json.loads(json.dumps(image.coco("a.png")))


def test_long_runs_and_masks_that_begin_on_are_written() -> None:
    mask = np.zeros((300, 200), bool)
    mask[:, 0] = mask[5:7, 150] = True
    assert run_lengths(mask) == [0, 300, 44705, 2, 14993]
    assert run_text([0]) == "0"


def test_without_identifiers_there_are_no_annotations(tmp_path: Path) -> None:
    image = Image(np.zeros((4, 4, 3), np.float32))
    for call in (image.coco, lambda: image.save_truth(tmp_path / "truth")):
        with pytest.raises(InputError, match="annotations need the layers sharp_object_id and sharp_class_id"):
            call()
    assert not (tmp_path / "truth").exists()
