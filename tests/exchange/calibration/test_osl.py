"""The shader for Cycles: what it refuses, its numbers, and what Cycles makes of it beside rays in float64."""

import importlib.util
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.camera_files import osl_text
from rptcam_cl.exchange.camera_maps import vignetting_map
from rptcam_cl.exchange.camera_models import view
from rptcam_cl.scene.load import load_scene
from tests.support.cases import one_in

CONIC = {
    "name": "conics",
    "surfaces": [
        {"radius": 30, "conic": -0.6, "thickness": 6, "glass": {"index": 1.6}, "diameter": 24},
        {"radius": -120, "conic": 2.0, "thickness": 3, "diameter": 24},
        {"stop": True, "thickness": 3, "diameter": 9},
        {"thickness": 2, "glass": {"index": 1.5}, "diameter": 20},
        {"diameter": 20},
    ],
}
EVEN = {
    "name": "even aspheres",
    "surfaces": [
        {"radius": 28, "conic": -0.8, "aspheric": {4: 2e-6, 6: -3e-9}, "thickness": 6, "glass": {"index": 1.6},
         "diameter": 24},
        {"radius": -110, "aspheric": {2: 1e-4, 4: 8e-6, 6: -2e-8, 8: 3e-11}, "thickness": 3, "diameter": 24},
        {"stop": True, "diameter": 9},
    ],
}  # fmt: skip
MOVED = {"f_number": 8, "movements": {"shift_mm": 2.0, "rise_mm": -1.0, "tilt_degrees": 3}}
CAMERAS = {  # camera, film
    "at full aperture": ({"lens": "dgauss-50mm", "focus": {"distance_m": 1.0}}, {}),
    "moved and cropped": (
        {"lens": "cooke-triplet-50mm", "focus": {"distance_m": 2.0}} | MOVED, {"crop": [0, 0.5, 0.25, 1]},
    ),
    "conics": ({"lens": CONIC, "focus": {"distance_m": 2.0}}, {}),
    "even aspheres": ({"lens": EVEN, "focus": {"distance_m": 2.0}}, {}),
    "aspheres of a telephone": ({"lens": "phone-5.6mm", "focus": {"distance_m": 1.0}}, {"size_mm": [5.6, 4.2]}),
    "a short asphere": ({"lens": "asphere-1.4mm", "focus": {"distance_m": 0.1}}, {"size_mm": [0.6, 0.4]}),
    "cylinders": ({"lens": "anamorphic-100mm", "focus": {"distance_m": 3.0}}, {}),
}  # fmt: skip
TOROID = {"name": "toroid", "surfaces": [
    {"radius": 30, "radius_x": 31, "form": "toroid", "thickness": 6, "glass": {"index": 1.6}, "diameter": 24},
    {"radius": -120, "thickness": 3, "diameter": 24}, {"stop": True, "diameter": 9},
]}  # fmt: skip
FAR = {"focus": {"distance_m": 1.0}}
CHANCES = (0.5, 0.6)
NEAR = {"aspheres of a telephone": (0.05, 0.6)}  # whose pupil moves about, so that little of the disk serves all fields
PLANES_F = (2.4, 5.0)  # focal lengths ahead of the film, two, so that places and directions are right
FARTHEST_MM = 300.0  # of them: farther away a rounding of float32 in the direction is 1e-4 mm


def seen_by(camera, film, resolution=(48, 32)):
    camera = {"kind": "realistic", "eye": [0, 0, 0], "target": [0, 0, -1]} | camera
    return view(load_scene({"film": {"resolution": list(resolution), "size_mm": [36, 24]} | film, "camera": camera}))


def number(pattern, text):
    return float(re.search(pattern.replace("<>", r"(-?[\d.]+(?:e[-+]\d+)?)"), text).group(1))


def rays_of(seen, text, chances):
    """Rays in float64 from the middles of pixels to the point of the shader's disk that two random numbers choose."""
    setting = seen.setting
    film_z = setting.lens.film_z(setting.film_distance_mm)
    radius, azimuth = number(r"radius = <> \*", text) * np.sqrt(chances[0]), 2 * np.pi * chances[1]
    disk_z = film_z - number(r"sin\(azimuth\), <>\)", text)
    target = np.array([radius * np.cos(azimuth), radius * np.sin(azimuth), disk_z])
    columns, rows = seen.size
    origins = seen.film_points(
        np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), axis=-1).reshape(-1, 2)
    )
    origins[:, 2] += film_z
    return setting.lens.trace(origins, target - origins), film_z


@pytest.mark.parametrize(("camera", "film"), one_in(3, CAMERAS.values()))
def test_disk_holds_all_light_and_little_more(camera, film):
    seen = seen_by(camera, film)
    text = osl_text(seen)
    assert not any(rays_of(seen, text, (1.0, turn))[0].passed.any() for turn in np.linspace(0, 1, 8))
    inside = [rays_of(seen, text, (share, turn))[0].passed.any() for share in (0.5, 0.7) for turn in (0.0, 0.3, 0.6)]
    assert any(inside)


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ({"lens": TOROID} | FAR, "surface 0 is of two curvatures"),
        ({"lens": "mirror-500mm", "focus": {"distance_m": 5}}, "has an opening that is not round"),
        ({"lens": "dgauss-50mm", "aperture": {"shape": "polygon", "blades": 6}} | FAR, "aperture is not round"),
        ({"kind": "pinhole", "fov_degrees": 40}, "needs a camera of kind realistic"),
    ],
)
def test_what_it_cannot_trace_is_refused(camera, message):
    with pytest.raises(InputError, match=message):
        osl_text(seen_by(camera, {}))


def test_command_writes_the_shader(tmp_path):
    path = tmp_path / "lens.osl"
    assert main(["camera", "dgauss-50mm", "--size", "96x64", "--osl", str(path)]) == 0
    assert number(r"#define COUNT <>", path.read_text("utf-8")) == 11
    assert main(["camera", "mirror-500mm", "--osl", str(tmp_path / "none.osl")]) == 2
    assert [file.name for file in tmp_path.iterdir()] == ["lens.osl"]


def by_cycles(folder, text, ahead_mm, size, samples, shown):
    """What Cycles of Blender shows of a plane through a shader, (rows, columns, 3)."""
    if importlib.util.find_spec("bpy") is None or int(version("bpy").partition(".")[0]) < 5:
        pytest.skip("bpy 5.0 or later is not installed: cameras of earlier ones take no shader")
    oiio = pytest.importorskip("OpenImageIO")
    (folder / "lens.osl").write_text(text)
    program = Path(__file__).with_name("cycles_plane.py")
    words = [folder / "lens.osl", folder / "seen.exr", ahead_mm, *size, samples, shown]
    done = subprocess.run([sys.executable, program, *map(str, words)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return oiio.ImageInput.open(str(folder / "seen.exr")).read_image(format="float")[..., :3].astype(np.float64)


@pytest.mark.slow
@pytest.mark.parametrize("name", CAMERAS)
def test_rays_of_cycles_are_those_in_float64(name, tmp_path):
    seen, chances = seen_by(*CAMERAS[name]), NEAR.get(name, CHANCES)
    text, (columns, rows) = osl_text(seen), seen.size
    middles = f"(floor(share[0] * {columns}) + 0.5) / {columns}.0, (floor(share[1] * {rows}) + 0.5) / {rows}.0, 0.0"
    known = text.replace("raster_position();", f"raster_position();\n  share = point({middles});")
    known = known.replace("camera_shader_random_sample()", f"vector({chances[0]}, {chances[1]}, 0.0)")
    known = known.replace("throughput = weight", "throughput = 1.0")
    rays, film_z = rays_of(seen, text, chances)
    for ahead_mm in np.minimum(np.multiply(PLANES_F, seen.setting.metadata["focal_length_mm"]), FARTHEST_MM):
        picture = by_cycles(tmp_path, known, ahead_mm, seen.size, 1, "position").reshape(-1, 3)
        along = (film_z - ahead_mm - rays.origins[:, 2:]) / rays.directions[:, 2:]
        expected = (rays.origins + rays.directions * along)[:, :2]
        lit = picture.any(axis=1)
        assert np.array_equal(lit, rays.passed)  # the same rays are stopped
        assert lit.mean() > 0.3
        assert np.abs((picture[lit, :2] - 0.125) * 1e3 - expected[lit]).max() <= 1e-4


@pytest.mark.slow
def test_white_field_of_cycles_falls_off_like_the_vignetting_map(tmp_path):
    seen = seen_by({"lens": "dgauss-50mm", "f_number": 2.8, "focus": {"distance_m": 1.0}}, {}, (24, 16))
    picture = by_cycles(tmp_path, osl_text(seen), 100, seen.size, 4096, "white")[..., 0]
    expected = vignetting_map(seen).astype(np.float64)
    assert expected.min() < 0.5
    blocks = [values.reshape(4, 4, 6, 4).mean(axis=(1, 3)) for values in (picture, expected)]
    assert blocks[0] == pytest.approx(blocks[1], rel=5e-3)
