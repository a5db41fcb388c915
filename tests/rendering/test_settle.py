"""A scene that is resolved once and written has the bits of the scene that left its focus and exposure open."""

import json

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError, StateError
from tests.rendering.test_world import still_life

SIZE = [40, 24]
CAMERA = {
    "kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 1, 6], "target": [0, 0.5, 0],
    "focus": {"auto": {"method": "depth"}},
}  # fmt: skip
LOOSE = {"max_error_px": 5, "max_illumination_error": 0.9}
CHEAP = CAMERA | {"f_number": 22, "focus": {"distance_m": 6}, "accuracy": LOOSE}


def scene(camera):
    return still_life() | {"camera": camera, "exposure": "auto", "film": {"resolution": SIZE}}


@pytest.mark.parametrize("camera", [CAMERA, CHEAP], ids=["focus and exposure", "camera model"])
def test_resolved_scene_has_the_bits_of_the_open_one(camera, tmp_path):
    path = tmp_path / "resolved.yaml"
    found = rptcam_cl.settle(scene(camera), path).found
    resolved = rptcam_cl.load_scene(path)
    assert resolved.exposure.lock_cd_m2 is not None
    if camera is CAMERA:
        assert resolved.camera.focus.auto is None
        assert found[0].startswith("focus: at ")
    else:
        assert resolved.camera.kind != "realistic"
        assert found[0] == f"camera model: {resolved.camera.kind}"
    one, other = (rptcam_cl.render(each, spp=1) for each in (scene(camera), path))
    np.testing.assert_array_equal(one.pixels, other.pixels)


def test_lens_that_stays_traced_has_no_accuracy_left_to_be_found(tmp_path):
    exact = {"max_error_px": 0.01, "max_illumination_error": 0.001}
    given = scene(CAMERA | {"f_number": 4, "focus": {"distance_m": 6}, "accuracy": exact})
    found = rptcam_cl.settle(given, tmp_path / "resolved.yaml").found
    assert found[0] == "camera model: realistic"
    resolved = rptcam_cl.load_scene(tmp_path / "resolved.yaml")
    assert resolved.camera.kind == "realistic" and resolved.camera.accuracy is None
    one, other = (rptcam_cl.render(each, spp=1) for each in (given, tmp_path / "resolved.yaml"))
    np.testing.assert_array_equal(one.pixels, other.pixels)


@pytest.mark.parametrize(("diffraction", "kind"), [("off", "thin_lens"), ("on", "realistic")])
def test_thin_lens_is_written_in_place_of_a_lens_unless_diffraction_goes_by_that(diffraction, kind):
    camera = CAMERA | {"lens": "achromat-100mm", "eye": [0, 1, 3], "f_number": 6, "focus": {"distance_m": 3}}
    camera |= {"accuracy": {"max_error_px": 0.5, "max_illumination_error": 0.9}, "diffraction": diffraction}
    ball = {"shape": "sphere", "center": [0, 0.5, 0], "radius": 0.5, "material": {"kind": "matte", "reflectance": 0.5}}
    light = {"environment": {"kind": "constant", "radiance": 1}, "spectrum": "rgb"}
    given = {"camera": camera, "film": {"resolution": [24, 16]}, "objects": [ball]} | light
    settled = rptcam_cl.settle(given)
    assert settled.found[0].startswith("camera model: thin_lens")
    written = rptcam_cl.load_scene(settled.scene).camera
    assert (written.kind, written.diffraction) == (kind, diffraction)


def test_scene_that_leaves_nothing_open_is_written_as_it_is(tmp_path):
    found = rptcam_cl.settle(still_life(), tmp_path / "a.yaml")
    assert found.found == ()
    assert rptcam_cl.load_scene(tmp_path / "a.yaml").content_hash() == rptcam_cl.load_scene(still_life()).content_hash()


def test_scene_that_names_files_stays_in_its_folder(tmp_path, monkeypatch):
    (tmp_path / "lens.yaml").write_text("surfaces:\n- {stop: true, diameter: 10}\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rptcam_cl.api.job.open_sessions", None)
    (tmp_path / "other").mkdir()
    with pytest.raises(InputError, match=r"other/a\.yaml: the scene names files in its own folder .allowed: a name in"):
        rptcam_cl.settle(still_life() | {"camera": CAMERA | {"lens": "lens.yaml"}}, "other/a.yaml")


@pytest.mark.parametrize("there", ["scene.yaml", "./scene.yaml", "none/a.yaml"])
def test_file_that_cannot_be_written_is_named_before_anything_is_measured(there, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rptcam_cl.api.job.open_sessions", None)
    given = json.dumps(scene(CAMERA))
    (tmp_path / "scene.yaml").write_text(given)
    with pytest.raises((InputError, StateError), match=there.split("/")[0]):
        rptcam_cl.settle("scene.yaml", there)
    assert (tmp_path / "scene.yaml").read_text() == given
    assert [path.name for path in tmp_path.iterdir()] == ["scene.yaml"]
