"""Camera models as files: read back by OpenCV and by eye, and the same camera in each."""

import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.camera_files import colmap_texts, opencv_text, openlensio_text, ros_text
from rptcam_cl.exchange.camera_models import calibrate, view
from rptcam_cl.scene.load import load_scene

SCENE = {
    "film": {"resolution": [600, 400], "size_mm": [36.0, 24.0]},
    "camera": {
        "kind": "realistic", "lens": "dgauss-50mm", "eye": [1.0, 2.0, 3.0], "target": [4.0, 1.0, 0.0],
        "up": [0.1, 1.0, 0.0], "f_number": 8, "focus": {"distance_m": 1.0}, "movements": {"shift_mm": 2.0},
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def seen():
    return view(load_scene(SCENE))


@pytest.fixture(scope="module")
def brown(seen):
    return calibrate(seen, "brown_conrady")


POINTS = np.array([[3.0, 1.4, 0.9], [4.0, 1.2, 0.3], [3.4, 1.1, 1.0], [5.0, 0.4, -0.8]])  # in the world [m]


def ours(seen, found):
    pose = np.linalg.inv(seen.pose())
    return found.project(POINTS @ pose[:3, :3].T + pose[:3, 3])


def test_opencv_reads_its_file_and_sees_the_world(seen, brown, tmp_path):
    cv2 = pytest.importorskip("cv2")
    (tmp_path / "camera.yaml").write_text(opencv_text(seen, brown))
    file = cv2.FileStorage(str(tmp_path / "camera.yaml"), cv2.FILE_STORAGE_READ)
    matrix, rotation, translation, bent = (
        file.getNode(name).mat() for name in ("camera_matrix", "rotation", "translation", "distortion_coefficients")
    )
    assert file.getNode("image_width").real() == 600
    at, _ = cv2.projectPoints(POINTS, cv2.Rodrigues(rotation)[0], translation, matrix, bent)
    assert at.reshape(-1, 2) + 0.5 == pytest.approx(ours(seen, brown), abs=1e-6)


def test_points_lie_where_the_lens_sees_them(seen, brown):
    places = ours(seen, brown)
    directions, lit = seen.directions(places)
    pose = seen.pose()
    away = POINTS - pose[:3, 3]
    assert lit.all()
    assert directions @ pose[:3, :3].T == pytest.approx(away / np.linalg.norm(away, axis=1)[:, None], abs=1e-6)


def test_ros_and_opencv_count_from_the_centre_and_colmap_from_the_corner(seen, brown):
    ros = yaml.safe_load(ros_text(seen, brown))
    assert ros["distortion_model"] == "plumb_bob"
    assert ros["camera_matrix"]["data"][2] == pytest.approx(brown.named["cx"] - 0.5)
    assert ros["projection_matrix"]["data"][5] == pytest.approx(brown.named["fy"])
    assert len(ros["distortion_coefficients"]["data"]) == 5
    line = colmap_texts(seen, brown, "a.png")["cameras.txt"].splitlines()[-1].split()
    assert line[:4] == ["1", "FULL_OPENCV", "600", "400"]
    assert float(line[6]) == brown.named["cx"]
    assert len(line) == 4 + 12


def test_colmap_pose_is_that_of_the_view(seen, brown):
    line = colmap_texts(seen, brown, "a.png")["images.txt"].splitlines()[1].split()
    w, x, y, z = map(float, line[1:5])
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    pose = np.linalg.inv(seen.pose())
    assert turn == pytest.approx(pose[:3, :3], abs=1e-12)
    assert list(map(float, line[5:8])) == pytest.approx(pose[:3, 3])


def test_openlensio_has_millimetres(seen, brown):
    sample = json.loads(openlensio_text(seen, brown))
    lens, named = sample["lens"], brown.named
    assert lens["pinholeFocalLength"] == pytest.approx(named["fx"] * 36 / 600, rel=1e-4)
    assert lens["entrancePupilOffset"] == pytest.approx(seen.pupil_ahead_mm * 1e-3)
    assert lens["projectionOffset"]["x"] == pytest.approx(-2.0, abs=1e-3)
    turn = sample["transforms"][0]["rotation"]
    pan, tilt, roll = (np.radians(turn[name]) for name in ("pan", "tilt", "roll"))
    about_z = np.array([[np.cos(pan), -np.sin(pan), 0], [np.sin(pan), np.cos(pan), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    about_y = np.array([[np.cos(roll), 0, np.sin(roll)], [0, 1, 0], [-np.sin(roll), 0, np.cos(roll)]])
    swap = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    # right, ahead and up of the camera in its world
    axes = swap @ seen.pose()[:3, :3] @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    assert about_z @ about_x @ about_y == pytest.approx(axes, abs=1e-9)
    place = sample["transforms"][0]["translation"]
    assert [place["x"], place["y"], place["z"]] == pytest.approx([1.0, -3.0, 2.0], abs=1e-9)  # the eye


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"f_number": None, "focus": {"distance_m": 1e9}, "movements": {}},
        {"kind": "thick_lens", "movements": {}, "lens": "cooke-triplet-50mm"},
        {"kind": "pinhole", "fov_degrees": 40, "lens": None, "f_number": None, "focus": None, "movements": {}},
    ],
)
def test_openlensio_is_what_the_published_schema_allows(changes):
    schema = json.loads((Path(__file__).parents[2] / "data/opentrackio.schema.json").read_text())
    camera = {key: value for key, value in (SCENE["camera"] | changes).items() if value is not None}
    seen = view(load_scene(SCENE | {"camera": camera}))
    for model in ("brown_conrady", "rational"):
        text = openlensio_text(seen, calibrate(seen, model))
        assert "Infinity" not in text and "NaN" not in text
        validator = jsonschema.Draft202012Validator(schema)
        assert [error.message for error in validator.iter_errors(json.loads(text))] == []


def by_openlensio(sample, directions):
    """Places on the picture by equations 2, 8, 16 and 17 of OpenLensIO 1.0, its way from undistorted to distorted."""
    lens, camera = sample["lens"], sample["static"]["camera"]
    (distortion,) = lens["distortion"]
    assert distortion["model"] == "Brown-Conrady U-D"
    projected = lens["pinholeFocalLength"] * directions[:, :2] / directions[:, 2:]
    centre = [lens["distortionOffset"][axis] for axis in "xy"]
    x, y = (projected - centre).T
    r2, (k1, k2, k3, k4, k5, k6), (p1, p2) = x**2 + y**2, distortion["radial"], distortion["tangential"]
    ratio = (1 + k1 * r2 + k3 * r2**2 + k5 * r2**3) / (1 + k2 * r2 + k4 * r2**2 + k6 * r2**3)
    bent = np.stack([
        x * ratio + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * ratio + 2 * p2 * x * y + p1 * (r2 + 2 * y**2),
    ], axis=1)  # fmt: skip
    film = bent + centre + [lens["projectionOffset"][axis] for axis in "xy"]
    size_mm, size = camera["activeSensorPhysicalDimensions"], camera["activeSensorResolution"]
    return (film / [size_mm["width"], size_mm["height"]] + 0.5) * [size["width"], size["height"]]


@pytest.mark.parametrize("model", ["brown_conrady", "rational"])
@pytest.mark.parametrize("lens", ["wide-22mm", "retrofocus-28mm"])
def test_openlensio_projects_as_the_model_does(lens, model):
    camera = SCENE["camera"] | {"lens": lens, "f_number": None, "movements": {"shift_mm": 3, "rise_mm": -2}}
    seen = view(load_scene(SCENE | {"camera": camera}))
    fitted = calibrate(seen, model)
    directions, lit = seen.directions(seen.grid(13, 9))
    directions = directions[lit]
    places = by_openlensio(json.loads(openlensio_text(seen, fitted)), directions)
    assert np.abs(places - fitted.project(directions)).max() <= 0.02  # the file has one focal length for fx and fy


def test_openlensio_refuses_another_scale_down_than_across(brown):
    wide = SCENE | {"camera": SCENE["camera"] | {"lens": "anamorphic-100mm", "f_number": None, "movements": {}}}
    seen = view(load_scene(wide))
    with pytest.raises(InputError, match="another focal length across"):
        openlensio_text(seen, calibrate(seen, "brown_conrady"))


def test_command_writes_files_and_prints_all_models(tmp_path, capsys):
    names = {"opencv": "cv.yaml", "ros": "ros.yaml", "plot": "residual.svg", "colmap": "model"}
    words = [word for name, file in names.items() for word in (f"--{name}", str(tmp_path / file))]
    size = ["--size", "96x64"]
    assert main(["camera", "dgauss-50mm", *size, "--json", *words]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["chosen"] == "brown_conrady"
    assert said["pixel_centre"] == 0.5
    assert said["models"]["rational"]["max_px"] < said["models"]["pinhole"]["max_px"]
    assert said["entrance_pupil"]["ahead_of_eye_mm"] == pytest.approx(48.199, abs=1e-3)
    assert said["object_distance_m"] is said["object_shape"] is None
    drift = said["entrance_pupil"]["drift_by_angle"]
    assert drift["degrees"][0] == drift["ahead_mm"][0] == 0.0
    assert drift["ahead_mm"][-1] < -1.0 and 20.0 < drift["degrees"][-1] < 24.0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cv.yaml", "model", "residual.svg", "ros.yaml"]
    assert len(list((tmp_path / "model").iterdir())) == 3


def test_files_say_for_which_object_they_are_right(tmp_path):
    def said(*words):
        size = ["--size", "96x64", "--set", "camera.focus.film_distance_mm=null", "--set", "camera.focus.distance_m=2"]
        path = tmp_path / "cv.yaml"
        assert main(["camera", "dgauss-50mm", *size, *words, "--opencv", str(path)]) == 0
        return path.read_text()

    assert "for a plane 1.9" in said()
    assert "for a sphere 3 m from the entrance pupil" in said("--distance-m", "3", "--object", "sphere")
    assert "for objects far away" in said("--distance-m", "inf")


@pytest.mark.parametrize(
    ("words", "message", "code"),
    [
        (["petzval-50mm", "--model", "pinhole", "--max-residual-px", "0.0005"], "pinhole errs by", 2),
        (["dgauss-50mm", "--opencv", "{0}/none/cv.yaml"], "there is no folder", 4),
        (["dgauss-50mm", "--model", "thin_prism", "--ros", "{0}/ros.yaml"], "cannot say thin_prism", 2),
        (["dgaus-50mm"], "did you mean dgauss-50mm", 2),
        (["examples/none.yaml"], "examples/none.yaml: there is no such file", 2),
        (["dgauss-50mm", "--size", "64x48", "--film", "4000x3000"], "nothing to fit", 2),
        (["biconcave"], "no real image", 2),
    ],
)
def test_bad_requests_leave_nothing_behind(words, message, code, tmp_path, capsys):
    assert main(["camera", *(word.format(tmp_path) for word in words)]) == code
    said = capsys.readouterr()
    assert message in said.err
    assert said.err.count("error:") == 1
    assert list(tmp_path.iterdir()) == []


def test_command_needs_no_opencl_and_no_opencv():
    program = (
        "import sys; sys.modules['pyopencl'] = None; sys.modules['cv2'] = None;"
        "from rptcam_cl.cli import main; sys.exit(main(['camera', 'dgauss-50mm', '--size', '96x64']))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
