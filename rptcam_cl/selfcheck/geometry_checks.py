"""Checks of what rays meet: watertight meshes, trees, rays that leave a surface, spheres far away."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.device import Session
from rptcam_cl.selfcheck.check import Check
from rptcam_cl.selfcheck.rays import MATTE, MeshScene, ObjectRays, mesh_object
from rptcam_cl.selfcheck.scenes import axis_rays, crowd, directions, globe, random_rays

Array = NDArray[np.float64]

PLACES = ((0.0, 0.0, 0.0), (1000.0, -2000.0, 500.0), (148376.0, 1234.0, -223423.0))
WIDEST = 8  # lanes of a work item of the probes


def lanes_of(session: Session) -> int:
    """Return the lanes that probes of a device have per work item."""
    return min(session.lanes, WIDEST)


def leaks(session: Session, place: Any, rng: np.random.Generator, rays: int, rings: int) -> int:
    """Return how many rays from inside a closed mesh at a place leave it, aimed at its edges and corners."""
    points, faces = globe(rings, rings)
    scene = MeshScene(session, [mesh_object(points * 2 + place, faces)])
    assert scene.plan.meshes is not None
    stored = scene.trees.vertices[:, :3].astype(np.float64)  # where the device has them
    corners = stored[scene.plan.meshes.triangles[:, :3]]
    inside = np.asarray(place) + 0.9 * directions(rng, rays) * rng.random((rays, 1))
    chosen = corners[rng.integers(len(corners), size=rays)]
    edge = np.where(rng.random(rays) < 2 / 3, rng.random(rays), 0.0)[:, None]  # a third at a corner
    origin = inside.astype(np.float32)
    d = chosen[:, 0] * (1 - edge) + chosen[:, 1] * edge - origin
    d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
    hits = scene.trace(origin, d, lanes=lanes_of(session))
    return int(((hits.primitive != 0) | ~hits.blocked).sum())


def leak_check(session: Session) -> Check:
    """Watertightness near and far from the eye."""
    rng, rays = np.random.default_rng(7), 50_000
    lost = sum(leaks(session, place, rng, rays, 50) for place in PLACES)
    return Check("mesh: leaks at edges and corners, near and far", lost, 0, f"of {rays * len(PLACES)} rays")


def mesh_rays_of(kind: str, rng: np.random.Generator, n: int) -> tuple[Array, Array]:
    """Return rays at what fills [-1, 1]^3: "random", along an "axis", or with "denormal" components."""
    d = directions(rng, n)
    o = 3 * directions(rng, n)
    if kind == "random":
        return o, (rng.uniform(-1, 1, (n, 3)) - o)
    if kind == "axis":  # along an axis, in the planes of the grid that tree boxes share, with zeros of both signs
        o = np.round(rng.uniform(-1.5, 1.5, (n, 3)) * 8) / 8
        d = np.zeros((n, 3))
        axis = rng.integers(3, size=n)
        d[np.arange(n), axis] = rng.choice([-1.0, 1.0], n)
        o[np.arange(n), axis] = -3 * d[np.arange(n), axis]
        return o, np.where(rng.random((n, 3)) < 0.5, d, d + 0.0 * -1.0)
    # nearly along z, the rest so small that its inverse is not finite, or zero of either sign
    o = np.concatenate([rng.uniform(-1, 1, (n, 2)), np.full((n, 1), 3.0)], axis=1)
    small = rng.choice([1e-42, -1e-42, 0.0, -0.0, 1e-30, 1e-3], (n, 2))
    return o, np.concatenate([small, np.full((n, 1), -1.0)], axis=1)


def mesh_tree_check(session: Session) -> Check:
    """The tree over triangles against all triangles, one after the other."""
    rng, rays = np.random.default_rng(11), 8192
    points, faces = globe(24, 32)
    scene = MeshScene(session, [mesh_object(points, faces)])
    wrong = 0
    kinds = ("random", "axis", "denormal")
    for kind in kinds:
        o, d = (rows.astype(np.float32) for rows in mesh_rays_of(kind, rng, rays))
        t, triangle = scene.brute(o, d)
        hits = scene.trace(o, d, lanes=lanes_of(session))
        found = triangle >= 0
        apart = hits.t.view(np.uint32) != t.view(np.uint32)
        wrong += int((((hits.primitive >= 0) != found) | (found & apart) | (hits.blocked != found)).sum())
    return Check("mesh: tree against every triangle", wrong, 0, f"of {rays * len(kinds)} rays differ in a bit")


def object_tree_check(session: Session) -> Check:
    """The tree over shapes against all shapes, one after the other."""
    rng, rays = np.random.default_rng(13), 16384
    tree = ObjectRays(session, crowd(rng, 150))
    loop = tree.without_tree()
    wrong = 0
    for make in (random_rays, axis_rays):
        o, d = (rows.astype(np.float32) for rows in make(rng, rays))
        found, expected = (scene.trace(o, d, lanes=lanes_of(session)) for scene in (tree, loop))
        wrong += int(found.unlike(expected).sum())
    return Check("shapes: tree against every shape", wrong, 0, f"of {2 * rays} rays differ in a bit")


def departures(session: Session, size: float, away: float, rng: np.random.Generator, rays: int) -> tuple[int, float]:
    """Return how many rays that leave a convex mesh of a size meet it again, and the share that never met it.

    ``away`` is the distance of the mesh from the eye over its size.
    """
    points, faces = globe(12, 16)
    place = directions(rng, 1)[0] * size * away
    scene = MeshScene(session, [mesh_object(points * size + place, faces)])
    o = place + size * 2 * directions(rng, rays)
    d = place + size * rng.uniform(-0.6, 0.6, (rays, 3)) - o
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    again = scene.departures(o, d, directions(rng, rays), lanes_of(session))
    return int((again == 1).sum()), float((again == -1).mean())


def departure_check(session: Session) -> Check:
    """Self-hits at ten decades of scale."""
    rng, rays, again, lost = np.random.default_rng(17), 16384, 0, 0.0
    scales = [(size, away) for size in (1e-5, 1e-2, 1e1, 1e5) for away in (1.0, 300.0)]
    for size, away in scales:
        hits, missed = departures(session, size, away, rng, rays)
        again, lost = again + hits, max(lost, missed)
    measured = again if lost < 0.02 else np.nan
    note = "" if lost < 0.02 else f"{lost:.0%} of the rays never met the mesh"
    return Check("self-hits, sizes 1e-5 to 1e5 m", measured, 0, f"of {rays * len(scales)} rays", note)


def far_sphere_errors(session: Session, distance: float, rng: np.random.Generator, rays: int) -> tuple[float, int]:
    """Return how far from a unit sphere rays meet it, over the distance that they come from, and how many miss it."""
    sphere = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": MATTE}
    scene = ObjectRays(session, [sphere])
    o = (distance * directions(rng, rays)).astype(np.float32)
    d = 0.8 * directions(rng, rays) * rng.random((rays, 1)) - o
    d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
    met = scene.trace(o, d, lanes=lanes_of(session))
    hit = met.primitive >= 0
    points = (o.astype(np.float64) + met.t.astype(np.float64)[:, None] * d)[hit]
    return float(np.abs(np.linalg.norm(points, axis=1) - 1).max(initial=0.0)) / distance, int((~hit).sum())


def far_sphere_checks(session: Session) -> list[Check]:
    """Spheres seen from 10 to 1e6 radii."""
    rng, rays = np.random.default_rng(19), 4096
    found = [far_sphere_errors(session, 10.0**power, rng, rays) for power in range(1, 7)]
    return [
        Check("spheres from 10 to 1e6 radii: points", max(e for e, _ in found), 1.6e-6, "of the distance"),
        Check("spheres from 10 to 1e6 radii: misses", sum(n for _, n in found), 0, f"of {rays * len(found)} rays"),
    ]
