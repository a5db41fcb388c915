"""Surfaces moved by pictures of heights when they are loaded."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.load import load_scene

CAMERA = {"kind": "pinhole", "eye": [0, 0, 9], "target": [0, 0, 0], "fov_degrees": 40}
SHEET = {
    "shape": "mesh", "vertices": [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], "faces": [[0, 1, 2, 3]],
    "uvs": [[0, 0], [1, 0], [1, 1], [0, 1]], "material": {"kind": "matte", "reflectance": 0.5},
}  # fmt: skip


def displaced(folder: Path, item: dict[str, Any], heights: Any, **keys: Any) -> Any:
    np.save(folder / "h.npy", np.asarray(heights, np.float32))
    moved = {"displacement": {"file": np.asarray(heights, np.float32), **keys}}
    scene = load_scene({"camera": CAMERA, "objects": [item | moved]}, base_dir=folder)
    (part,) = scene.load_mesh(scene.objects[0]).contents.parts
    return part.mesh


def test_a_sheet_takes_the_heights_of_its_picture(tmp_path: Path) -> None:
    """Against bilinear heights written out here: texels between their centres, the first row of the file on top."""
    heights = np.random.default_rng(3).random((4, 6))
    mesh = displaced(tmp_path, SHEET, np.repeat(heights[:, :, None], 3, axis=2), height=0.3, middle=0.5, steps=12)
    points = mesh.positions + mesh.origin
    u, v = points[:, 0] / 2, points[:, 1]
    np.testing.assert_allclose(mesh.uvs, np.stack([u, v], axis=1), atol=1e-6)
    x, y = u * 6 - 0.5, v * 4 - 0.5
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    rows = heights[::-1]
    expected = sum(
        (1 - abs(x - i - k)) * (1 - abs(y - j - m)) * rows[(j + m) % 4, (i + k) % 6] for k in (0, 1) for m in (0, 1)
    )
    np.testing.assert_allclose(points[:, 2], 0.3 * (expected - 0.5), atol=1e-6)
    assert len(mesh.faces) == 2 * 12**2
    assert len(points) == 13**2  # the diagonal's points belong to both triangles
    assert mesh.normals is None


def test_a_ball_moved_evenly_is_a_larger_ball_without_gaps(tmp_path: Path) -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(3)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    apart = [[4 * k, 4 * k + 1, 4 * k + 2, 4 * k + 3] for k in range(6)]  # no face shares a vertex with another
    box = {
        "shape": "mesh", "vertices": corners[np.ravel(faces)].tolist(), "faces": apart,
        "uvs": np.zeros((24, 2)).tolist(), "material": SHEET["material"],
    }  # fmt: skip
    mesh = displaced(tmp_path, box, np.full((2, 2, 3), 0.5), height=1.0, steps=5)
    points = mesh.positions + mesh.origin
    corner = np.abs(points).min(axis=1) > 0.8
    np.testing.assert_allclose(np.linalg.norm(points[corner], axis=1), 1.5, atol=1e-6)  # out along the mean normal

    # every edge of the moved surface belongs to two triangles: there is no gap
    _, place = np.unique(points.round(5), axis=0, return_inverse=True)
    edges = place[mesh.faces][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    counts = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)[1]
    assert set(counts.tolist()) == {2}


def test_smooth_meshes_have_the_normals_of_what_they_become(tmp_path: Path) -> None:
    ramp = np.repeat(np.linspace(0, 1, 8)[None, :, None], 4, axis=0) * np.ones(3)
    mesh = displaced(tmp_path, SHEET | {"normals": "smooth"}, ramp, height=7 / 8, steps=16, scale=[0.5, 1])
    inner = (mesh.positions + mesh.origin)[:, 0]
    flat = (inner > 0.5) & (inner < 1.5)  # the height grows by 1 over seven eighths of two repeats of u
    slope = 7 / 8 * (8 / 7) / (2 / 0.5)
    expected = np.array([-slope, 0, 1]) / np.hypot(slope, 1)
    np.testing.assert_allclose(mesh.normals[flat], np.tile(expected, (flat.sum(), 1)), atol=1e-5)


@pytest.mark.parametrize(
    ("item", "keys", "message"),
    [
        ({key: value for key, value in SHEET.items() if key != "uvs"}, {}, "no texture coordinates"),
        (SHEET | {"faces": [[0, 1, 2, 3]] * 1}, {"steps": 2000}, "is out of range"),
    ],
)
def test_what_cannot_be_displaced_says_why(tmp_path: Path, item: Any, keys: Any, message: str) -> None:
    with pytest.raises(InputError, match=rf"objects\[0\].*displacement.*{message}"):
        displaced(tmp_path, item, np.zeros((2, 2, 3)), height=1.0, **keys)


def test_a_missing_picture_of_heights_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"displacement: .*none\.png"):
        load_scene(
            {"camera": CAMERA, "objects": [SHEET | {"displacement": {"file": "none.png", "height": 1}}]},
            base_dir=tmp_path,
        )
