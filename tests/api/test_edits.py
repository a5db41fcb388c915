"""An edit of a scene with many triangles costs what it changes, and leaves the bits of a scene loaded with it."""

import copy
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rptcam_cl.rendering.scene_buffers as trees
from rptcam_cl.api.session import RenderSession
from rptcam_cl.device.session import open_session
from rptcam_cl.rendering import tree_build
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.plan.primitives import PlanParts
from rptcam_cl.scene import scene as scene_module
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene
from tests.api.test_session import assert_has_bits_of_render


def plate(side: int) -> dict[str, Any]:
    """The keys of a wavy plate of 2·side² triangles, one unit wide."""
    u, v = np.meshgrid(*2 * (np.linspace(-0.5, 0.5, side + 1),))
    points = np.stack([u, 0.02 * np.sin(20 * u) * np.cos(23 * v), v], axis=-1).reshape(-1, 3)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    corners = np.stack([first, first + side + 1, first + side + 2, first + 1], axis=1)
    return {"vertices": points, "faces": np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])}


def at(*position: float, **more: Any) -> dict[str, Any]:
    return {"shape": "mesh", "material": "white", "transform": [{"translate": list(position)}], **more}


# Three meshes in the world, and 20 instances of 4802 triangles: 14 and more are not copied any longer.
SCENE: dict[str, Any] = {
    "film": {"resolution": [32, 18], "size_mm": [36, 20.25]},
    "camera": {"kind": "pinhole", "eye": [0, 3, 6], "target": [0, 0, 0], "fov_degrees": 50},
    "materials": {
        "white": {"kind": "matte", "reflectance": 0.8},
        "red": {"kind": "matte", "reflectance": [0.7, 0.1, 0.1]},
        "lamp": {"kind": "emissive", "radiance": [9, 8, 7]},
    },
    "meshes": {"tile": plate(49), "ground": plate(30), "leaf": plate(4)},
    "objects": [
        at(0, -0.5 / 6, 0, mesh="ground") | {"transform": [{"scale": 6}, {"translate": [0, -0.5, 0]}]},
        at(1, 0.3, 0, mesh="leaf"),
        at(-1, 0.8, 0.4, mesh="leaf", material="red"),
        at(0, 3, -1, mesh="leaf", material="lamp"),
        {"shape": "sphere", "center": [0, 0.2, 1], "radius": 0.4, "material": "red"},
        *(at(0.7 * (k % 5) - 1.5, 0, 0.7 * (k // 5) - 2, mesh="tile") for k in range(20)),
    ],
    "lights": [{"kind": "point", "position": [2, 5, 3], "intensity": 60}],
    "render": {"max_depth": 3, "caustics": "off"},
}  # fmt: skip
ORBIT = {"camera.eye": [1.5, 2.5, 5.5]}
EDITS: dict[str, dict[str, Any]] = {
    "orbit": ORBIT,
    "material": {"materials.white.reflectance": [0.2, 0.5, 0.3]},
    "mesh in the world": {"objects.1.transform": [{"scale": 2}, {"translate": [0.4, 1, 1]}]},
    "mesh at the edge of the world": {"objects.3.transform": [{"translate": [0.5, 4, -1.2]}]},
    "mesh that is mirrored": {"objects.2.transform": [{"scale": [-1, 1, 1]}, {"translate": [-1, 0.8, 0.4]}]},
    "instance": {"objects.7.transform": [{"scale": 1.4}, {"translate": [0.2, 0.9, 0.3]}]},
    "another instance": {"objects.9.transform": [{"translate": [1.2, 0.4, 1.9]}]},
    "sphere": {"objects.4.radius": 0.3},
    "material of one": {"objects.8.material": "red"},
    "orbit back": {"camera.eye": [0, 3, 6]},
    "one less": {"objects.10": None},
}


@pytest.fixture
def session() -> Iterator[RenderSession]:
    with RenderSession(SCENE) as session:
        yield session


def test_film_has_the_bits_of_render_after_edits(session: RenderSession) -> None:
    for number, change in enumerate(EDITS.values(), 1):
        session.change(change)
        session.glance(0.5)  # of trees that fit roughly
        session.change(ORBIT)
        session.glance(0.5)
        if number % 3 == 0 or number == len(EDITS):
            session.take(1)
            assert_has_bits_of_render(session, 1)


def test_glance_of_a_refitted_tree_is_that_of_a_new_one(session: RenderSession) -> None:
    for name, change in EDITS.items():
        session.change(change)
        with RenderSession(session.scene) as fresh:
            error = np.abs(session.glance(1.0).pixels - fresh.glance(1.0).pixels)
        assert np.mean(error > 1e-4) < 0.002, name  # rounding may send a ray past an edge


def test_edit_builds_no_tree_and_validates_what_it_changes(
    session: RenderSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any, **__: Any) -> Any:
        raise AssertionError("a tree is built, or an object checked, for a glance")

    session.take(1)
    monkeypatch.setattr(tree_build, "build_bvh", refuse)
    monkeypatch.setattr(trees, "load_or_build", refuse)
    monkeypatch.setattr(scene_module, "check_extent", refuse)
    for name in ("orbit", "material", "orbit back"):
        session.change(EDITS[name])
        session.glance(0.5)
    monkeypatch.setattr(scene_module, "check_extent", lambda *_, **__: None)
    for moved in (("instance", "another instance"), ("mesh in the world", "mesh at the edge of the world")):
        for name in moved:
            session.change(EDITS[name])
            session.glance(0.5)
        with pytest.raises(AssertionError, match="a tree is built"):
            session.take(1)  # the film has the tree of `render`


def test_objects_that_stay_are_the_same_instances_with_the_new_material() -> None:
    scene = load_scene(SCENE)
    edited = set_keys(scene, EDITS["material"])
    for before, after in zip(scene.objects, edited.objects, strict=True):
        if before.material is scene.materials["white"]:
            assert after.material is edited.materials["white"] and after.transform is before.transform
        else:
            assert after is before
    assert edited.load_mesh(edited.objects[0]).contents is scene.load_mesh(scene.objects[0]).contents
    moved = set_keys(edited, EDITS["instance"])
    assert [a is b for a, b in zip(edited.objects, moved.objects, strict=True)].count(False) == 1
    assert set_keys(moved, ORBIT).objects is moved.objects


@pytest.mark.parametrize("path", ["objects.3.material", "materials.white.reflectance"])
def test_picture_that_an_edit_names_is_looked_for(path: str) -> None:
    from rptcam_cl.core.errors import InputError

    missing = {"kind": "image", "file": "nowhere.png"}
    value = {"kind": "matte", "reflectance": missing} if path.endswith("material") else missing
    with pytest.raises(InputError, match=r"nowhere\.png"):
        set_keys(load_scene(SCENE), {path: value})


@pytest.mark.parametrize("fp64", [True, False])
def test_leaf_blocks_made_on_the_device_have_the_bits_of_the_host(fp64: bool) -> None:
    device = copy.copy(open_session(None))
    device.info = replace(device.info, fp64=fp64)
    scene = load_scene(SCENE)
    first, second = (make_plan(set_keys(scene, change)).meshes for change in ({}, EDITS["mesh in the world"]))
    assert first is not None and second is not None and len(first.groups) > 1
    second = replace(second, triangles=first.triangles).seen_from(np.array([1.23456789, 3e3, -7.0]))
    triangles = device.upload(first.triangles)
    before = trees.mesh_trees(first, device)
    after = trees.mesh_trees(second, device, before, triangles, rough=True)
    expected = trees.placed_triangles(after)
    count = expected["blocks"].size
    for _ in range(4):  # from the third on in memory of one before
        blocks = trees.placed_blocks(device, after, device.upload(expected["vertices"]), triangles)
        assert device.read(blocks, np.float32, count).tobytes() == expected["blocks"].tobytes()
    del blocks
    assert len(after.spare) == (2 if device.info.type == "cpu" else 0)  # of two that there were at once
    for tree, group in zip(after.groups, second.groups, strict=True):
        faces = second.triangles[group.first_triangle :][:, :3]
        for row, block in zip(*np.nonzero(tree.children < 0), strict=True):
            some = tree.blocks[~tree.children[row, block]]
            points = second.vertices[faces[some[some >= 0]].ravel(), :3]
            np.testing.assert_array_equal(tree.bounds[row, :, block], [*points.min(axis=0), *points.max(axis=0)])


def test_leaf_blocks_that_were_moved_on_the_device_are_not_taken_for_those_that_were_uploaded() -> None:
    device, scene, parts = open_session(None), load_scene(SCENE), PlanParts()
    first = trees.SceneBuffers(device, make_plan(scene, parts=parts))
    parts.rough = True  # as a glance has it
    moved = trees.SceneBuffers(device, make_plan(set_keys(scene, EDITS["mesh in the world"]), parts=parts), first)
    parts.drop_rough()
    again = trees.SceneBuffers(device, make_plan(scene, parts=parts), moved)
    fresh, count = trees.SceneBuffers(device, make_plan(scene)), first._uploaded["blocks"][0].size
    found, before, expected = (
        device.read(each.scene["blocks"], np.float32, count).tobytes() for each in (again, moved, fresh)
    )
    assert found == expected and before != expected


@pytest.mark.parametrize("leaf_size", [1, 4])
def test_refitted_boxes_are_those_of_their_primitives(leaf_size: int, session: RenderSession) -> None:
    generator = np.random.default_rng(5)
    lower = generator.uniform(-1, 1, (300, 3)).astype(np.float32)
    upper = lower + generator.uniform(0, 0.2, (300, 3)).astype(np.float32)
    tree = tree_build.build_bvh(lower, upper, width=4, leaf_size=leaf_size, session=session.device)
    moved = lower + generator.uniform(-0.5, 0.5, (300, 3)).astype(np.float32)
    high = moved + (upper - lower)
    boxes = np.array([[*moved[b[b >= 0]].min(axis=0), *high[b[b >= 0]].max(axis=0)] for b in tree.blocks])
    refitted = tree_build.refit(tree, boxes)
    assert tree_build.is_sound(refitted)

    def held(node: int) -> list[int]:
        """The primitives below a node, each inside of every box on the way."""
        below = []
        for child, box in zip(refitted.children[node], refitted.bounds[node].T, strict=True):
            if child != tree_build.EMPTY:
                some = held(child) if child >= 0 else tree.blocks[~child][tree.blocks[~child] >= 0].tolist()
                np.testing.assert_array_equal(box, [*moved[some].min(axis=0), *high[some].max(axis=0)])
                below += some
        return below

    assert sorted(held(0)) == list(range(300))
