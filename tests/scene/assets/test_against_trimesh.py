"""Files that another library writes, and reads as ours does."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from trimesh.visual.material import PBRMaterial

from rptcam_cl.scene.assets.mesh import MeshContents
from rptcam_cl.scene.meshes import read_mesh_file


def knot() -> trimesh.Trimesh:
    """A closed surface with texture coordinates and normals, far from regular."""
    u, v = np.meshgrid(np.linspace(0, 1, 40), np.linspace(0, 1, 12), indexing="ij")
    a, b = 2 * np.pi * u, 2 * np.pi * v
    radius = 2 + 0.5 * np.cos(b) + 0.3 * np.cos(3 * a)
    points = np.stack([radius * np.cos(a), radius * np.sin(a), 0.5 * np.sin(b) + 0.4 * np.sin(3 * a)], axis=-1)
    index = np.arange(u.size).reshape(u.shape)
    corners = [index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]]
    faces = np.stack([corners[k] for k in (0, 1, 2, 0, 2, 3)], axis=-1).reshape(-1, 3)
    uvs = np.stack([u, v], axis=-1).reshape(-1, 2)
    paint = PBRMaterial(baseColorFactor=[51, 102, 153, 255], metallicFactor=0.25)
    visual = trimesh.visual.TextureVisuals(uvs, material=paint)
    return trimesh.Trimesh(points.reshape(-1, 3), faces, visual=visual, process=False)


def soup(contents: MeshContents) -> tuple[np.ndarray, np.ndarray | None]:
    """Triangles in the file's coordinates (m, 3, 3), sorted, and their texture coordinates in the same order."""
    triangles, uvs = [], []
    for part in contents.parts:
        placed = (part.mesh.origin + part.mesh.positions) @ part.placement[:3, :3].T + part.placement[:3, 3]
        triangles.append(placed[part.mesh.faces])
        uvs.append(None if part.mesh.uvs is None else part.mesh.uvs[part.mesh.faces])
    whole = np.concatenate(triangles)
    order = np.lexsort(np.round(whole, 4).reshape(len(whole), 9).T)
    return whole[order], None if uvs[0] is None else np.concatenate([part for part in uvs if part is not None])[order]


EXPORTS: list[tuple[str, dict[str, Any]]] = [
    ("a.ply", {"encoding": "binary"}),
    ("b.ply", {"encoding": "ascii"}),
    ("a.stl", {}),
    ("b.stl", {"file_type": "stl_ascii"}),
    ("a.obj", {"include_normals": True}),
    ("a.glb", {}),
]


@pytest.mark.parametrize(("name", "options"), EXPORTS, ids=[name for name, _ in EXPORTS])
def test_exported_mesh_comes_back(tmp_path: Path, name: str, options: dict[str, Any]) -> None:
    mesh = knot()
    mesh.export(tmp_path / name, **options)
    triangles, uvs = soup(read_mesh_file(tmp_path / name, lambda reference: tmp_path / reference))
    expected = mesh.vertices[mesh.faces]
    order = np.lexsort(np.round(expected, 4).reshape(len(expected), 9).T)
    assert np.allclose(triangles, expected[order], atol=1e-6)
    if name.endswith(("obj", "glb")):
        assert uvs is not None
        assert np.allclose(uvs, mesh.visual.uv[mesh.faces][order], atol=1e-6)


def test_exported_tree_of_nodes_comes_back(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])
    scene.add_geometry(knot(), geom_name="knot", node_name="first", transform=turn)
    shift = trimesh.transformations.translation_matrix([4, 5, 6]) @ trimesh.transformations.scale_matrix(0.5)
    scene.graph.update(frame_to="second", frame_from="first", matrix=shift, geometry="knot")
    scene.export(tmp_path / "a.glb")
    contents = read_mesh_file(tmp_path / "a.glb", lambda reference: tmp_path / reference)
    first, second = contents.parts
    assert first.mesh is second.mesh
    assert first.material is not None and first.material.base_color == pytest.approx((0.2, 0.4, 0.6))
    for part in contents.parts:
        assert part.name is not None
        assert np.allclose(part.placement, scene.graph[part.name][0], atol=1e-6)
