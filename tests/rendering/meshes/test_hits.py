"""Meshes are watertight, never hit themselves, and the tree finds what testing every triangle finds."""

import numpy as np
import pytest

from rptcam_cl.rendering import scene_buffers
from rptcam_cl.rendering.plan import geometry
from rptcam_cl.studies.selfcheck import (
    RAY_MATTE,
    TracedScene,
    departures,
    directions,
    globe,
    leaks,
    mesh_object,
    mesh_rays_of,
)
from tests.support.cases import slow


def rng_of(name: str) -> np.random.Generator:
    return np.random.default_rng(list(name.encode()))


@pytest.mark.parametrize("place", [slow((0, 0, 0)), (1000, -2000, 500), slow((148376, 1234, -223423))])
def test_no_ray_leaks_through_edges_or_vertices(session, place):
    assert leaks(session, place, rng_of(f"leaks {place}"), 200_000, 100) == 0


@pytest.mark.parametrize("width", [16, *map(slow, (4, 8))])
@pytest.mark.parametrize("kind", [slow("random"), "axis", "denormal"])
@pytest.mark.parametrize("shape", ["globe", "flat grid"])
def test_tree_finds_what_every_triangle_finds(session, monkeypatch, shape, kind, width):
    monkeypatch.setattr(scene_buffers, "WIDTH", {"cpu": width, "gpu": width})
    rng = rng_of(f"{shape} {kind}")
    if shape == "globe":
        points, faces = globe(24, 32)
    else:
        x, y = np.meshgrid(np.arange(-8, 9) / 8, np.arange(-8, 9) / 8, indexing="ij")
        points = np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3)
        k = (np.arange(16)[:, None] * 17 + np.arange(16)).ravel()
        faces = np.concatenate([np.stack([k, k + 17, k + 18], 1), np.stack([k, k + 18, k + 1], 1)])
    scene = TracedScene(session, [mesh_object(points, faces)])
    o, d = (rows.astype(np.float32) for rows in mesh_rays_of(kind, rng, 16384))
    t, triangle = scene.brute(o, d)
    for lanes in sorted({1, 8, session.lanes}):  # 16: side by side
        hits = scene.trace_mesh(o, d, lanes=lanes)
        found = hits.primitive >= 0
        assert (found == (triangle >= 0)).all()
        assert (hits.t[found].view(np.uint32) == t[found].view(np.uint32)).all()
        assert (hits.blocked == found).all()
    assert found.mean() > 0.1


def test_rays_that_leave_a_convex_mesh_do_not_meet_it_again(session):
    rng = rng_of("departures")
    for _ in range(12):
        again, lost = departures(session, 10.0 ** rng.uniform(-5, 5), 10.0 ** rng.uniform(0, 2.5), rng, 16384)
        assert again == 0
        assert lost < 0.02


def test_offset_is_small_beside_the_distance(session):
    """A shadow begins where its object does: the step off the surface is a few roundings."""
    points, faces = globe(12, 16)
    scene = TracedScene(session, [mesh_object(points - np.array([0, 0, 10]), faces)])
    d = np.tile([[0, 0, -1.0]], (128, 1))
    hits = scene.trace_mesh(np.random.default_rng(1).uniform(-0.3, 0.3, (128, 3)) * [1, 1, 0], d)
    assert (hits.offset > 0).all()
    assert (hits.offset < 1e-5).all()


@pytest.mark.parametrize("turn", [slow([]), [{"scale": [-1, 1, 1]}]], ids=["as it is", "mirrored"])
def test_instances_are_met_where_copies_are(session, monkeypatch, turn):
    points, faces = globe(20, 20)
    rng = rng_of("instances")
    placed = [
        [*turn, {"scale": [1, 2, 0.5]}, {"rotate": {"axis": [1, 2, 3], "degrees": 40}}, {"translate": [3, 1, -9]}],
        [*turn, {"translate": [-2, 0, -6]}],
        [*turn, {"scale": 0.25}, {"translate": [0.5, -1, -4]}],
    ]
    meshes = {"globe": {"vertices": points.tolist(), "faces": faces.tolist()}}
    objects = [{"shape": "mesh", "mesh": "globe", "material": RAY_MATTE, "transform": steps} for steps in placed]
    n = 32768
    o = rng.uniform(-1, 1, (n, 3)) + np.array([0, 0, 4])
    d = np.concatenate([rng.uniform(-3, 3, (n // 2, 3)) - np.array([0, 0, 8]) - o[: n // 2], directions(rng, n // 2)])
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    copies = TracedScene(session, objects, meshes=meshes)
    monkeypatch.setattr(geometry, "MOST_COPIED", 0)
    shared = TracedScene(session, objects, meshes=meshes)
    assert copies.plan.facts["HAS_INSTANCES"] == 0
    assert shared.plan.facts["HAS_INSTANCES"] == 1
    assert len(shared.plan.meshes.triangles) == len(faces) == len(copies.plan.meshes.triangles) / 3
    a, b = (scene.trace_mesh(o, d, lanes=session.lanes) for scene in (copies, shared))
    both = (a.primitive >= 0) & (b.primitive >= 0)
    assert ((a.primitive >= 0) != (b.primitive >= 0)).sum() <= 8  # grazing the outline
    assert both.sum() > 3000
    same = both & (a.primitive == b.primitive) & (a.part % len(faces) == b.part)
    assert same.sum() >= both.sum() - 40  # on edges either triangle is right
    assert np.abs(a.t[same] / b.t[same] - 1).max() < 2e-6
    apart = a.point[same] - b.point[same]
    assert np.abs((apart * a.normal[same]).sum(axis=1)).max() < 4e-6
    assert np.abs(apart).max() < 1e-4  # along the surface, where rays graze it
    facing = (a.normal[same] * b.normal[same]).sum(axis=1)
    assert facing.min() > 1 - 1e-5
    assert ((b.normal[same] * d[same]).sum(axis=1) < 0).all()  # outwards, mirrored or not
