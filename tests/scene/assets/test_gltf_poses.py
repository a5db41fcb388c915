"""Animations, morph targets and skins of glTF files, against what the format says, written here in float64."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets.gltf import read_gltf_world
from rptcam_cl.scene.assets.mesh import MeshContents
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.meshes import read_mesh_file

from .gltf_writer import GltfWriter, triangle

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])


def at(tmp_path: Path, writer: GltfWriter, time_s: float | None) -> MeshContents:
    (tmp_path / "a.glb").write_bytes(writer.glb())
    return read_mesh_file(tmp_path / "a.glb", lambda reference: tmp_path / reference, time_s=time_s)


def corners(contents: MeshContents, part: int = 0) -> NDArray[np.float64]:
    """Return the vertices of a part in the frame of its file."""
    placed = contents.parts[part]
    rows = placed.mesh.positions.astype(float) + placed.mesh.origin
    return np.asarray(rows @ placed.placement[:3, :3].T + placed.placement[:3, 3])


def animate(writer: GltfWriter, path: str, times: Any, values: Any, way: str | None = None, node: int = 0) -> None:
    """Add an animation with one channel."""
    sampler = {"input": writer.array(times), "output": writer.array(values)} | ({"interpolation": way} if way else {})
    target = {"node": node, "path": path}
    animation = {"name": f"clip of {path}", "samplers": [sampler], "channels": [{"sampler": 0, "target": target}]}
    writer.json.setdefault("animations", []).append(animation)


def rotated(quaternion: Any, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn rows by a unit quaternion (x, y, z, w): v + 2 q × (q × v + w v)."""
    *axis, real = np.asarray(quaternion, float) / np.linalg.norm(quaternion)
    return np.asarray(rows + 2 * np.cross(axis, np.cross(axis, rows) + real * rows))


TIMES = [1.0, 2.0, 4.0]
PLACES = np.array([[1, 0, 0], [0, 2, 0], [3, 3, 3.0]])


@pytest.mark.parametrize(
    ("time_s", "linear", "step"),
    [
        (-9, [1, 0, 0], [1, 0, 0]), (1, [1, 0, 0], [1, 0, 0]), (1.25, [0.75, 0.5, 0], [1, 0, 0]),
        (2, [0, 2, 0], [0, 2, 0]), (3, [1.5, 2.5, 1.5], [0, 2, 0]), (4, [3, 3, 3], [3, 3, 3]), (99, [3] * 3, [3] * 3),
    ],
)  # fmt: skip
def test_places_are_interpolated_and_held_at_the_ends(tmp_path: Path, time_s: float, linear: Any, step: Any) -> None:
    for way, place in ((None, linear), ("STEP", step)):
        writer = triangle()
        animate(writer, "translation", TIMES, PLACES, way)
        assert np.allclose(corners(at(tmp_path, writer, time_s)), CORNERS + place, atol=1e-7)


def test_splines_go_by_their_tangents(tmp_path: Path) -> None:
    """A cubic is its own Hermite spline, whatever the distances of its keys."""
    powers = np.array([[1, 2, -3], [0.5, -1, 2], [0.25, 0.5, -0.75], [0.125, -0.25, 0.5]])

    def place(time: float) -> NDArray[np.float64]:
        return np.asarray([1, time, time**2, time**3] @ powers)

    def slope(time: float) -> NDArray[np.float64]:
        return np.asarray([0, 1, 2 * time, 3 * time**2] @ powers)

    writer = triangle()
    animate(writer, "translation", TIMES, [row for t in TIMES for row in (slope(t), place(t), slope(t))], "CUBICSPLINE")
    for time_s in (1, 1.3, 2, 2.6, 3.9, 4):
        assert np.allclose(corners(at(tmp_path, writer, time_s)), CORNERS + place(time_s), atol=1e-5)


@pytest.mark.parametrize("sign", [1, -1])
def test_turns_go_the_shorter_way_at_even_speed(tmp_path: Path, sign: int) -> None:
    axis = np.array([1, 2, 2]) / 3
    turns = [[*(np.sin(angle / 2) * axis), np.cos(angle / 2)] for angle in (0.2, 2.6)]
    writer = triangle()
    animate(writer, "rotation", [0, 1], [turns[0], sign * np.array(turns[1])])
    animate(writer, "scale", [0, 1], [[1, 1, 1], [2, 3, 4]])
    for time_s in (0, 0.1, 0.75, 1):
        half = (0.2 + 2.4 * time_s) / 2
        expected = rotated([*(np.sin(half) * axis), np.cos(half)], CORNERS * (1 + time_s * np.array([1, 2, 3])))
        assert np.allclose(corners(at(tmp_path, writer, time_s)), expected, atol=1e-6)


def test_turns_of_splines_are_made_of_unit_length(tmp_path: Path) -> None:
    first, second, tangent = np.array([0, 0, 0, 1]), np.array([0, 0.6, 0, 0.8]), np.array([0.5, 0, 0.25, 0])
    zero = np.zeros(4)
    writer = triangle()
    animate(writer, "rotation", [0, 2], [zero, first, tangent, tangent, second, zero], "CUBICSPLINE")
    quaternion = 0.5 * first + 2 / 8 * tangent + 0.5 * second - 2 / 8 * tangent
    assert np.allclose(corners(at(tmp_path, writer, 1)), rotated(quaternion, CORNERS), atol=1e-6)
    quaternion = 0.84375 * first + 2 * 0.140625 * tangent + 0.15625 * second - 2 * 0.046875 * tangent
    assert np.allclose(corners(at(tmp_path, writer, 0.5)), rotated(quaternion, CORNERS), atol=1e-6)


def test_without_a_time_the_pose_is_at_rest(tmp_path: Path) -> None:
    writer = triangle()
    writer.json["nodes"][0]["translation"] = [7, 0, 0]
    bare = at(tmp_path, writer, None)
    (note,) = at(tmp_path, writer, 1.0).notes
    assert note.endswith("has no animations, so `time_s` changes nothing")
    animate(writer, "translation", TIMES, PLACES)
    rest = at(tmp_path, writer, None)
    assert corners(rest).tolist() == corners(bare).tolist() == (CORNERS + PLACES[0] * 7).tolist()
    assert rest.parts[0].mesh.content_hash == bare.parts[0].mesh.content_hash
    assert rest.notes[0].endswith("the pose is at rest; `time_s` gives a moment of them")


def test_a_second_clip_of_one_node_is_left_out_and_other_nodes_play(tmp_path: Path) -> None:
    writer = triangle()
    writer.json["nodes"].append({"mesh": 0})
    writer.json["scenes"] = [{"nodes": [0, 1]}]
    animate(writer, "translation", TIMES, PLACES)
    animate(writer, "translation", TIMES, -PLACES)
    animate(writer, "translation", TIMES, 2 * PLACES, node=1)
    contents = at(tmp_path, writer, 2)
    assert contents.notes[0].endswith("clip of translation moves what an earlier animation moves and is left out")
    assert np.allclose([corners(contents, part)[0] for part in (0, 1)], [[0, 2, 0], [0, 4, 0]])


STEPS = np.array([[[0, 0, 1], [0, 0, 2], [0, 0, 4]], [[1, 0, 0], [0, 0, 0], [0, 3, 0.0]]])
NORMALS = np.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8]])


def morphing(**mesh: Any) -> GltfWriter:
    """Return a triangle with two morph targets, the first of which turns its normals, too."""
    writer = triangle()
    first, second = (writer.array(steps) for steps in STEPS)
    primitive = writer.json["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": first, "NORMAL": writer.array(STEPS[0][:, ::-1])}, {"POSITION": second}]
    primitive["attributes"]["NORMAL"] = writer.array(NORMALS)
    writer.json["meshes"][0] |= mesh
    return writer


def check_morph(contents: MeshContents, weights: Any, part: int = 0) -> None:
    assert np.allclose(corners(contents, part), CORNERS + np.tensordot(weights, STEPS, 1), atol=1e-6)
    normals = NORMALS + weights[0] * STEPS[0][:, ::-1]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    found = contents.parts[part].mesh.normals
    assert found is not None
    assert np.allclose(found, normals, atol=1e-6)


def test_weights_are_of_the_node_or_the_mesh_or_none(tmp_path: Path) -> None:
    writer = morphing(weights=[0.25, -0.5])
    writer.json["nodes"].append({"mesh": 0, "weights": [1, 0.5]})
    writer.json["scenes"] = [{"nodes": [0, 1]}]
    contents = at(tmp_path, writer, None)
    check_morph(contents, [0.25, -0.5], 0)
    check_morph(contents, [1, 0.5], 1)
    check_morph(at(tmp_path, morphing(), None), [0, 0])


def test_weights_are_animated(tmp_path: Path) -> None:
    writer = morphing(weights=[9, 9])
    animate(writer, "weights", [0, 2], [0, 1, 1, 0.5])
    check_morph(at(tmp_path, writer, 0.5), [0.25, 0.875])
    check_morph(at(tmp_path, writer, None), [9, 9])
    spline = morphing()
    animate(spline, "weights", [0, 2], [0, 0, 0, 1, 2, 0, 0, 0, 1, 0.5, 0, 0], "CUBICSPLINE")
    check_morph(at(tmp_path, spline, 1), [0.5 * 0 + 0.25 * 2 + 0.5 * 1, 0.5 * 1 + 0.5 * 0.5])


BIND = np.array([[[1, 0, 0, -1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
                 [[2, 0, 0, 0], [0, 1, 0, 3], [0, 0, 1, 0], [0, 0, 0, 1.0]]])  # fmt: skip
SHARES = np.array([[1, 0, 0, 0], [0.25, 0.75, 0, 0], [0.5, 0.25, 0, 0]])  # the last one sums to 3/4
MORE = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0.25, 0]])  # in the second set


def skinned(sets: bool = True, scale: Any = (1, 1, 1)) -> GltfWriter:
    """Return a triangle bound to two joints: node 1, and node 2 below it."""
    writer = triangle()
    attributes = writer.json["meshes"][0]["primitives"][0]["attributes"]
    attributes |= {"JOINTS_0": writer.array([[0, 1, 9, 9]] * 3, "u1"), "WEIGHTS_0": writer.array(SHARES)}
    attributes["NORMAL"] = writer.array(NORMALS)
    if sets:
        attributes |= {"JOINTS_1": writer.array([[0, 0, 1, 0]] * 3, "u2"), "WEIGHTS_1": writer.array(MORE)}
    matrices = np.swapaxes(BIND, 1, 2).reshape(2, 16)
    view = writer.view(matrices.astype("<f4").tobytes())
    writer.json["accessors"].append({"bufferView": view, "componentType": 5126, "count": 2, "type": "MAT4"})
    bind = len(writer.json["accessors"]) - 1
    writer.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": bind}]
    writer.json["nodes"] = [
        {"mesh": 0, "skin": 0, "translation": [50, 60, 70]},  # which does not count
        {"translation": [0, 5, 0], "scale": list(scale), "children": [2]},
        {"rotation": [0, 0, 0.6, 0.8]},
    ]
    writer.json["scenes"] = [{"nodes": [0, 1]}]
    return writer


def check_skin(contents: MeshContents, quaternion: Any, scale: Any = (1, 1, 1), sets: bool = True) -> None:
    """Blend both joints' matrices by hand."""
    parent = np.diag([*scale, 1.0])
    parent[1, 3] = 5
    turn = np.eye(4)
    turn[:3, :3] = rotated(quaternion, np.eye(3)).T
    joints = np.stack([parent @ BIND[0], parent @ turn @ BIND[1]])
    shares = SHARES[:, :2] + (MORE[:, [0, 2]] if sets else 0)
    matrices = np.einsum("nj,jab->nab", shares / shares.sum(axis=1, keepdims=True), joints)
    expected = np.einsum("nab,nb->na", matrices, np.column_stack([CORNERS, np.ones(3)]))[:, :3]
    assert np.allclose(corners(contents), expected, atol=1e-5)
    normals = np.einsum("nba,nb->na", np.linalg.inv(matrices[:, :3, :3]), NORMALS)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    found = contents.parts[0].mesh.normals
    assert found is not None
    assert np.allclose(found, normals, atol=1e-5)
    first, second, third = corners(contents)[contents.parts[0].mesh.faces[0]]
    plain = np.linalg.det(matrices[0, :3, :3]) > 0
    facing = np.cross(second - first, third - first) @ np.cross(*(expected[1:] - expected[0]))
    assert (facing > 0) == plain  # a mirror image keeps its front


@pytest.mark.parametrize("sets", [True, False])
@pytest.mark.parametrize("scale", [(1, 1, 1), (1, 2, 3), (-1, 1, 1)])
def test_skins_blend_the_matrices_of_their_joints(tmp_path: Path, sets: bool, scale: Any) -> None:
    contents = at(tmp_path, skinned(sets, scale), None)
    assert contents.notes == ()
    check_skin(contents, [0, 0, 0.6, 0.8], scale, sets)


def test_skins_follow_animated_joints(tmp_path: Path) -> None:
    writer = skinned()
    animate(writer, "rotation", [0, 1], [[0, 0, 0, 1], [1, 0, 0, 0]], node=2)
    check_skin(at(tmp_path, writer, 0.5), [np.sqrt(0.5), 0, 0, np.sqrt(0.5)])


def test_cameras_and_lamps_move(tmp_path: Path) -> None:
    writer = triangle()
    writer.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}]
    writer.json["nodes"] += [{"camera": 0}]
    writer.json["scenes"] = [{"nodes": [0, 1]}]
    animate(writer, "translation", TIMES, PLACES, node=1)
    at(tmp_path, writer, None)
    (camera,), _, _ = read_gltf_world(tmp_path / "a.glb", lambda path: path, 3.0)
    assert camera.eye == (1.5, 2.5, 1.5)


def test_scene_shows_a_file_at_two_times(tmp_path: Path) -> None:
    writer = triangle()
    animate(writer, "translation", TIMES, PLACES)
    (tmp_path / "a.glb").write_bytes(writer.glb())
    camera = {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40}
    scene = {
        "camera": camera,
        "meshes": {"late": {"file": "a.glb", "time_s": 4}},
        "objects": [
            {"shape": "mesh", "file": "a.glb"}, {"shape": "mesh", "file": "a.glb", "time_s": 2},
            {"shape": "mesh", "mesh": "late"},
        ],
    }  # fmt: skip
    loaded = load_scene(scene, base_dir=tmp_path)
    places = [corners(loaded.load_mesh(item).contents)[0].tolist() for item in loaded.objects]
    assert places == [[0, 0, 0], [0, 2, 0], [3, 3, 3]]


@pytest.mark.parametrize(
    "mesh", [{"file": "a.obj"}, {"mesh": "late"}, {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}]
)
def test_time_is_refused_for_other_meshes(mesh: dict[str, Any], tmp_path: Path) -> None:
    camera = {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40}
    item = {"shape": "mesh", "time_s": 1, "material": {"kind": "mirror"}, **mesh}
    with pytest.raises(InputError, match=r"time_s: is a moment of a glTF file"):
        load_scene({"camera": camera, "meshes": {"late": {"file": "a.obj"}}, "objects": [item]}, base_dir=tmp_path)
    with pytest.raises(InputError, match=r"a\.ply: has no animations, so no time_s"):
        (tmp_path / "a.ply").write_text("ply")
        read_mesh_file(tmp_path / "a.ply", lambda path: path, time_s=1.0)


BAD: list[tuple[Any, dict[str, Any], str]] = [
    (triangle, {"times": [2, 1]}, "input: has no times that rise"),
    (triangle, {"values": [[0, 0, 0]] * 3}, "output: has 3 entries"),
    (triangle, {"way": "BEZIER"}, "interpolation: is not known"),
    (triangle, {"path": "colour"}, "path: is not known"),
    (triangle, {"matrix": [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}, "matrix: is beside an animation"),
    (morphing, {"weights": [1]}, "weights: must be 2 finite numbers"),
    (triangle, {"skin": 0, "skins": [{"joints": [0]}]}, "is shown with a skin, but has no JOINTS_0"),
    (skinned, {"skins": [{"joints": [1]}]}, "names a joint that is not there (got 1; allowed: below 1)"),
    (skinned, {"nodes": [{}], "skins": [{"joints": [1, 3]}]}, "joints: are not in the scene that is shown"),
]


@pytest.mark.parametrize(("make", "changes", "message"), BAD)
def test_wrong_poses_are_refused(tmp_path: Path, make: Any, changes: dict[str, Any], message: str) -> None:
    writer = make()
    changes = {"times": [1, 2], "values": [[0, 0, 0]] * 2, "way": "LINEAR", "path": "translation"} | changes
    animate(writer, *(changes.pop(key) for key in ("path", "times", "values", "way")))
    writer.json["nodes"] += changes.pop("nodes", [])
    writer.json["skins"] = changes.pop("skins", writer.json.get("skins", []))
    writer.json["nodes"][0] |= changes
    with pytest.raises(InputError, match=re.escape(message)):
        at(tmp_path, writer, 1)
