"""The camera for USD: its perspective, opening and pose against closed forms, and as OpenUSD reads them."""

import numpy as np
import pytest
import yaml

from rptcam_cl.cli import main
from rptcam_cl.exchange.camera_files import usd_text
from rptcam_cl.exchange.camera_models import calibrate, view
from rptcam_cl.optics.library import load_lens
from rptcam_cl.scene.load import load_scene

FILM = {"resolution": [600, 400], "size_mm": [36.0, 24.0]}
POSE = {"eye": [1.0, 2.0, 3.0], "target": [4.0, 1.0, 0.0], "up": [0.1, 1.0, 0.0]}
REAL = {
    "kind": "realistic", "lens": "dgauss-50mm", "f_number": 8, "focus": {"distance_m": 1.0},
    "movements": {"shift_mm": 2.0, "rise_mm": -1.0},
}  # fmt: skip
THIN = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 2, "focus_distance_m": 2}
POINTS = np.array([[3.0, 1.4, 0.9], [4.0, 1.2, 0.3], [3.4, 1.1, 1.0]])  # in the world [m]


def seen_by(camera, **film):
    return view(load_scene({"film": FILM | film, "camera": camera | POSE}))


@pytest.fixture(scope="module")
def real():
    seen = seen_by(REAL)
    return seen, calibrate(seen, "brown_conrady")


def numbers(text):
    """Attributes of the camera, by name."""
    lines = [line.strip().split(" = ") for line in text.splitlines() if line.startswith("    float ")]
    return {name.split()[1]: float(value) for name, value in lines}


def places(text, points):
    """Where the camera of a text sees points of the world [m], by the definitions of UsdGeomCamera [pixels]."""
    said = numbers(text)
    (line,) = (line for line in text.splitlines() if "matrix4d" in line)
    rows = np.array(line.split(" = ")[1].strip("() ").replace("(", "").replace(")", "").split(","), float).reshape(4, 4)
    seen = np.column_stack([points * 100, np.ones(len(points))]) @ np.linalg.inv(rows)
    film = seen[:, :2] / -seen[:, 2:3] * said["focalLength"]
    offset = [said["horizontalApertureOffset"], said["verticalApertureOffset"]]
    share = (film - offset) / [said["horizontalAperture"], said["verticalAperture"]]
    return (share * [1, -1] + 0.5) * [600, 400]


def test_perspective_is_that_of_the_model_without_distortion(real):
    seen, found = real
    pose = np.linalg.inv(seen.pose())
    at = POINTS @ pose[:3, :3].T + pose[:3, 3]
    fx, fy, cx, cy = found.parameters[:4]
    expected = at[:, :2] / at[:, 2:] * [fx, fy] + [cx, cy]
    assert places(usd_text(seen, found), POINTS) == pytest.approx(expected, abs=1e-6)


def test_perspective_of_an_anamorphic_lens_is_another_across_than_down():
    seen = seen_by({"kind": "realistic", "lens": "anamorphic-100mm", "focus": {"distance_m": 3.0}})
    found = calibrate(seen, "pinhole")
    pose = np.linalg.inv(seen.pose())
    points = np.array([[3.6, 1.15, 0.45]])
    at = points @ pose[:3, :3].T + pose[:3, 3]
    assert abs(found.named["fx"] / found.named["fy"] - 1) > 0.2  # squeezed
    assert places(usd_text(seen, found), points) == pytest.approx(found.project(at), abs=1e-6)


def test_blur_is_that_of_the_entrance_pupil(real):
    seen, found = real
    said = numbers(usd_text(seen, found))
    assert said["focalLength"] / said["fStop"] == pytest.approx(seen.pupil.diameter_mm, rel=1e-12)
    assert said["focusDistance"] == pytest.approx((1000 - seen.pupil_ahead_mm) / 10, rel=1e-12)


def test_thin_lens_and_pinhole_have_their_closed_forms():
    thin = seen_by(THIN)
    said = numbers(usd_text(thin, calibrate(thin, "pinhole")))
    film_mm = 1 / (1 / 50 - 1 / 2000)
    assert said["focalLength"] == pytest.approx(film_mm, rel=1e-9)
    assert said["horizontalAperture"] == pytest.approx(36.0)
    assert said["verticalAperture"] == pytest.approx(24.0)
    assert said["focalLength"] / said["fStop"] == pytest.approx(25.0, rel=1e-9)
    assert said["focusDistance"] == pytest.approx(200.0)
    pinhole = seen_by({"kind": "pinhole", "fov_degrees": 40})
    said = numbers(usd_text(pinhole, calibrate(pinhole, "pinhole")))
    assert said["fStop"] == 0
    across = said["horizontalAperture"] / 2 / said["focalLength"]
    assert np.degrees(2 * np.arctan(across)) == pytest.approx(40.0, rel=1e-6)


def test_openusd_reads_the_camera_and_the_lens(real, tmp_path):
    pxr = pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Gf, Usd, UsdGeom

    assert pxr
    seen, found = real
    path = tmp_path / "camera.usda"
    path.write_text(usd_text(seen, found), "utf-8")
    stage = Usd.Stage.Open(str(path))
    camera = UsdGeom.Camera(stage.GetDefaultPrim())
    frustum = camera.GetCamera(Usd.TimeCode.Default()).frustum
    matrix = np.array(frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix())
    clip = np.column_stack([POINTS * 100, np.ones(len(POINTS))]) @ matrix
    at = (clip[:, :2] / clip[:, 3:] * [0.5, -0.5] + 0.5) * [600, 400]
    text = usd_text(seen, found)
    assert at == pytest.approx(places(text, POINTS), abs=1e-3)  # USD's numbers are float32
    assert UsdGeom.GetStageMetersPerUnit(stage) == pytest.approx(0.01)
    assert Gf.Vec3d(*(100 * seen.pose()[:3, 3])) == frustum.GetPosition()
    data = camera.GetPrim().GetCustomDataByKey("rptcam")
    assert data["cameraModel"]["k1"] == found.named["k1"]
    assert len(yaml.safe_load(data["lens"])["surfaces"]) == len(load_lens("dgauss-50mm").surfaces)
    (tmp_path / "lens.yaml").write_text(data["lens"], "utf-8")
    again = load_lens(tmp_path / "lens.yaml").trace([[0, 3, data["filmDistanceMm"] + 60]], [[0, 0, -1]])
    here = seen.setting.lens.trace([[0, 3, data["filmDistanceMm"] + 60]], [[0, 0, -1]])
    assert again.directions == pytest.approx(here.directions, abs=1e-12)


def test_command_writes_the_camera(tmp_path, capsys):
    path = tmp_path / "camera.usda"
    assert main(["camera", "dgauss-50mm", "--size", "96x64", "--usd", str(path)]) == 0
    assert numbers(path.read_text("utf-8"))["focusDistance"] == 1e7  # infinity
    assert "wrote" in capsys.readouterr().err
    assert main(["camera", "dgauss-50mm", "--usd", str(tmp_path / "none" / "camera.usda")]) == 4
