"""From mesh objects of a scene to placed meshes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.plan.primitives import mesh_parts
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.meshes import MeshObject
from rptcam_cl.scene.scene import Scene

from .conftest import CAMERA, GREY, MeshScene

TRIANGLE: dict[str, Any] = {"vertices": [[0, 0, 0], [2, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]], "material": GREY}
CUBE: dict[str, Any] = {
    "vertices": [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)],
    "faces": [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]],
    "material": GREY,
}
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
2 0 0
0 1 0
3 0 1 2
"""


def objects(scene: Scene) -> list[MeshObject]:
    return [item for item in scene.objects if isinstance(item, MeshObject)]


def test_written_out_triangle_is_one_part(mesh_scene: MeshScene) -> None:
    scene = mesh_scene(TRIANGLE | {"transform": {"translate": [1, 2, 3]}, "name": "blade"})
    (part,) = mesh_parts(scene, objects(scene)[0])
    assert part.mesh.positions.tolist() == [[0, 0, 0], [2, 0, 0], [0, 1, 0]]
    assert part.mesh.faces.tolist() == [[0, 1, 2]]
    assert part.mesh.normals is None and part.mesh.uvs is None
    assert part.placement[:3, 3].tolist() == [1, 2, 3]
    assert part.name == "blade"
    assert part.material is objects(scene)[0].material


def test_arrays_of_a_mesh_have_their_types_and_are_read_only(mesh_scene: MeshScene) -> None:
    uvs, normals = [[0, 0], [1, 0], [0, 1]], [[0, 0, 2]] * 3
    scene = mesh_scene(TRIANGLE | {"uvs": uvs, "normals": normals})
    mesh = mesh_parts(scene, objects(scene)[0])[0].mesh
    assert mesh.normals is not None and mesh.uvs is not None
    assert mesh.normals.tolist() == [[0, 0, 1]] * 3
    assert mesh.uvs.tolist() == uvs
    for rows, dtype in [
        (mesh.origin, np.float64),
        (mesh.positions, np.float32),
        (mesh.faces, np.int32),
        (mesh.normals, np.float32),
        (mesh.uvs, np.float32),
    ]:
        assert rows.dtype == dtype
        assert not rows.flags.writeable


def test_same_mesh_is_held_once(mesh_scene: MeshScene, tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(PLY)
    (tmp_path / "b.ply").write_text(PLY)
    named = {key: TRIANGLE[key] for key in ("vertices", "faces")}
    scene = mesh_scene(
        {"file": "a.ply", "material": GREY},
        {"file": "a.ply", "material": GREY, "transform": {"scale": 2}},
        {"file": "b.ply", "material": GREY},
        {"mesh": "t", "material": GREY},
        TRIANGLE,
        meshes={"t": named},
    )
    assert len({mesh_parts(scene, item)[0].mesh for item in objects(scene)}) == 1
    changed = change_scene(scene, render={"spp": 3})
    assert mesh_parts(changed, objects(changed)[0])[0].mesh is mesh_parts(scene, objects(scene)[0])[0].mesh


def test_smooth_and_flat_share_the_triangles(mesh_scene: MeshScene) -> None:
    scene = mesh_scene(*({"mesh": "t", "normals": mode, "material": GREY} for mode in ("auto", "smooth", "flat")),
                       meshes={"t": {key: CUBE[key] for key in ("vertices", "faces")}})  # fmt: skip
    auto, smooth, flat = (mesh_parts(scene, item)[0].mesh for item in objects(scene))
    assert auto is flat
    assert smooth.positions is auto.positions and smooth.faces is auto.faces
    assert smooth.normals is not None
    assert smooth.content_hash != flat.content_hash


def test_smooth_normal_weighs_by_angle(mesh_scene: MeshScene) -> None:
    scene = mesh_scene(CUBE | {"normals": "smooth"})
    mesh = mesh_parts(scene, objects(scene)[0])[0].mesh
    assert mesh.normals is not None
    assert len(mesh.faces) == 12
    # Each corner of a cube sees three right angles, however the squares are cut.
    assert np.allclose(mesh.normals, mesh.positions / np.sqrt(3), atol=1e-6)


def test_smooth_normals_cross_seams_of_texture_coordinates(mesh_scene: MeshScene) -> None:
    split = [CUBE["vertices"][corner] for face in CUBE["faces"] for corner in face]
    faces = np.arange(24).reshape(6, 4).tolist()
    scene = mesh_scene(
        CUBE | {"vertices": split, "faces": faces, "uvs": [[i, 0] for i in range(24)], "normals": "smooth"}
    )
    mesh = mesh_parts(scene, objects(scene)[0])[0].mesh
    assert mesh.normals is not None
    assert np.allclose(mesh.normals, mesh.positions / np.sqrt(3), atol=1e-6)


def test_faraway_mesh_has_its_own_origin_and_loses_nothing(mesh_scene: MeshScene) -> None:
    vertices = np.array([[1e6, 5e6, 0], [1e6 + 0.5, 5e6, 0], [1e6, 5e6 + 0.25, 1 / 64]])
    scene = mesh_scene({"vertices": vertices, "faces": np.array([[0, 1, 2]]), "material": GREY})
    mesh = mesh_parts(scene, objects(scene)[0])[0].mesh
    assert np.array_equal(mesh.origin + mesh.positions, vertices)
    assert np.abs(mesh.positions).max() < 1


def test_camera_inside_a_closed_mesh_is_warned_of_unless_it_faces_inwards(mesh_scene: MeshScene) -> None:
    big = {"transform": {"scale": 60}, "material": {"kind": "emissive", "radiance": 1}}
    inwards = {"faces": [face[::-1] for face in CUBE["faces"]]}
    assert mesh_scene(CUBE | big).warnings == ("the camera stands inside objects[0]",)
    assert mesh_scene(CUBE | big | inwards).warnings == ()
    assert mesh_scene(CUBE | big | {"transform": {"scale": [-60, 60, 60]}}).warnings != ()
    assert mesh_scene(CUBE | big | {"transform": {"scale": 40}}).warnings == ()


def test_emissive_mesh_is_light_enough(mesh_scene: MeshScene) -> None:
    assert "black" in mesh_scene(CUBE).warnings[0]
    assert mesh_scene(CUBE | {"material": {"kind": "emissive", "radiance": 1}}).warnings == ()


def test_scene_hash_counts_what_a_mesh_file_holds(tmp_path: Path, mesh_scene: MeshScene) -> None:
    def hashed(text: str, name: str = "a.ply", **keys: Any) -> str:
        (tmp_path / name).write_text(text)
        return mesh_scene({"file": name, "material": GREY, **keys}).content_hash()

    first = hashed(PLY)
    assert hashed(PLY.replace("1.0", "1.0\ncomment x")) == first
    assert hashed(PLY, "b.ply") == first
    assert hashed(PLY.replace("2 0 0", "2.5 0 0")) != first
    assert hashed(PLY, normals="smooth") != first
    assert hashed(PLY, transform={"scale": 2}) != first
    assert hashed(PLY, material={"kind": "mirror"}) != first


def test_scene_with_meshes_survives_being_written_out(mesh_scene: MeshScene) -> None:
    scene = mesh_scene(CUBE, TRIANGLE | {"normals": [[0, 0, 1]] * 3, "uvs": [[0, 0]] * 3})
    assert load_scene(scene.model_dump(mode="json")).content_hash() == scene.content_hash()


REFUSED = [
    ({}, "objects[0]: needs one of file | mesh | vertices"),
    ({"file": "a.ply", "mesh": "t"}, "objects[0].mesh: cannot be given together with file"),
    ({"mesh": "u"}, "objects[0].mesh: names no mesh (got 'u'; allowed: t)"),
    ({"mesh": "t"}, "objects[0].mesh: needs the key material"),
    ({"file": "a.ply"}, "objects[0].file: needs the key material: a.ply has none"),
    ({"file": "none.ply"}, "objects[0].file: no such file"),
    ({"file": "../a.ply"}, "objects[0].file: lies outside the scene's folder"),
    ({"file": "/etc/passwd"}, "objects[0].file: lies outside the scene's folder"),
    ({"file": "link.ply"}, "objects[0].file: lies outside the scene's folder"),
    ({"file": "."}, "objects[0].file: is not a regular file"),
    ({"file": ""}, "objects[0].file: is not a path"),
    ({"file": "a.txt"}, "a.txt: is not a mesh file (got .txt; allowed: .ply"),
    ({"file": "empty.ply"}, "empty.ply: is empty"),
    ({"vertices": [[0, 0, 0]]}, "objects[0].faces: is required beside vertices"),
    ({"file": "a.ply", "faces": [[0, 1, 2]]}, "objects[0].faces: belongs to vertices, which are not given"),
    (TRIANGLE | {"faces": [[0, 1]]}, "objects[0].faces[0]: is not a face (got [0, 1]"),
    (TRIANGLE | {"faces": [[0, 1, 2.5]]}, "objects[0].faces[0]: is not a face"),
    (TRIANGLE | {"faces": [[0, 1, -1]]}, "objects[0].faces[0]: is not a face"),
    (TRIANGLE | {"faces": [[0, 1, 2], [0, 1, 3]]}, "face 1 names a vertex that is not there (got 3; allowed: 0 to 2)"),
    (TRIANGLE | {"faces": []}, "objects[0].faces: must be faces"),
    (TRIANGLE | {"vertices": []}, "objects[0].vertices: is empty"),
    (TRIANGLE | {"vertices": [[0, 0]]}, "objects[0].vertices[0]: must be 3 numbers"),
    (TRIANGLE | {"vertices": [[0, 0, float("nan")]]}, "objects[0].vertices[0][2]: must be finite"),
    (TRIANGLE | {"vertices": np.full((3, 3), np.nan)}, "objects[0].vertices[0][0]: is out of range"),
    (TRIANGLE | {"vertices": [[0, 0, 1e13]]}, "objects[0].vertices[0][2]: is out of range"),
    (TRIANGLE | {"vertices": "all"}, "objects[0].vertices: must be rows of 3 numbers"),
    (TRIANGLE | {"normals": [[0, 0, 1]]}, "objects[0].normals: is not one for each vertex (got 1"),
    (TRIANGLE | {"uvs": [[0, 0, 1]] * 3}, "objects[0].uvs[0]: must be 2 numbers"),
    (TRIANGLE | {"normals": "round"}, "objects[0].normals: is not a known choice"),
    (TRIANGLE | {"vertices": [[0, 0, 0], [1, 0, 0], [2, 0, 0]]}, "no triangle that can be shown (dropped: 1 without"),
    (TRIANGLE | {"vertices": [[0, 0, 0], [1e-14, 0, 0], [0, 1e-14, 0]]}, "is too small for float32"),
    (TRIANGLE | {"transform": {"scale": 1e-11}, "vertices": [[0, 0, 0], [1e-5, 0, 0], [0, 1e-5, 0]]},
     "objects[0]: is too small for float32"),
    (TRIANGLE | {"transform": [{"scale": 1e8}, {"scale": 1e3}], "vertices": [[0, 0, 0], [1e5, 0, 0], [0, 1, 0]]},
     "objects[0]: reaches too far for float32"),
]  # fmt: skip


@pytest.mark.parametrize(("keys", "message"), REFUSED)
def test_unusable_mesh_object_is_refused(tmp_path: Path, keys: dict[str, Any], message: str) -> None:
    folder = tmp_path / "scene"
    folder.mkdir()
    for name, text in {"a.ply": PLY, "a.txt": PLY, "empty.ply": ""}.items():
        (folder / name).write_text(text)
    (tmp_path / "a.ply").write_text(PLY)
    (folder / "link.ply").symlink_to(tmp_path / "a.ply")
    named = {"t": {key: TRIANGLE[key] for key in ("vertices", "faces")}}
    with pytest.raises(InputError) as caught:
        load_scene({"camera": CAMERA, "meshes": named, "objects": [{"shape": "mesh", **keys}]}, base_dir=folder)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_error_in_a_mesh_names_the_place_in_the_scene_file(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(PLY.replace("3 0 1 2", "3 0 1 3"))
    path = tmp_path / "scene.yaml"
    path.write_text("camera: {kind: pinhole, eye: [0, 0, 5], target: [0, 0, 0], fov_degrees: 40}\nobjects:\n"
                    "  - shape: mesh\n    file: a.ply\n    material: {kind: mirror}\n")  # fmt: skip
    with pytest.raises(InputError) as caught:
        load_scene(path)
    assert str(caught.value).startswith(f"{path}:4:11: objects[0].file: {tmp_path / 'a.ply'}: face 0 names a vertex")
