"""Checks of a device: numbers, and what rays meet, by the kernels that render, on scenes that are hard."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import RayStatus, device_declarations
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.scene_buffers import SceneBuffers, scene_trees
from rptcam_cl.scene.load import load_scene

# A check of a device: what was measured and what it may be; and the kernels that show what a device computes.


@dataclass(frozen=True)
class Check:
    """One line of the report.

    Attributes
    ----------
    name : str
        What was checked.
    measured, allowed : float
        The check is passed when the first is at most the second; what is not a number fails.
    unit : str
        Of both.
    note : str
        Anything else worth saying; for a check that could not be made, why.
    skipped : bool
        Whether it needs what the device does not offer; it then neither passes nor fails.
    """

    name: str
    measured: float
    allowed: float
    unit: str
    note: str = ""
    skipped: bool = False

    @property
    def passed(self) -> bool:
        """Whether the device computes what it should."""
        return bool(self.measured <= self.allowed)

    @property
    def failed(self) -> bool:
        """Whether the check was made, and the device computes something else."""
        return not self.passed and not self.skipped


def needs_float64(name: str, unit: str) -> Check:
    """Return a check that was not made because the device has no float64."""
    return Check(name, math.nan, math.nan, unit, "the device has no float64", skipped=True)


GROUP = 16  # most work items per group


def run_probe(session: Session, probe: str, facts: Mapping[str, int | str], items: int, /, **arguments: Any) -> None:
    """Run a kernel of ``kernels/probe`` over ``items`` work items; its arguments are given by name."""
    program = session.program([f"probe/{probe}.cl"], facts, device_declarations())
    session.bind(program, probe, **arguments).enqueue(items, 1 if session.group == 1 else min(GROUP, items))
    session.finish()


def random_numbers(
    session: Session,
    pixel: ArrayLike,
    sample: ArrayLike,
    dimension: ArrayLike,
    seed: tuple[int, int],
    *,
    lanes: int,
    lattice: bool = False,
) -> NDArray[np.float32]:
    """Return the four random numbers (n, 4) of each counter; ``n`` must be a multiple of ``lanes`` times 16."""
    counters = [np.ascontiguousarray(part.ravel(), np.uint32) for part in np.broadcast_arrays(pixel, sample, dimension)]
    pixels, samples, dimensions = map(session.upload, counters)
    count = counters[0].size
    out = session.allocate(16 * count)
    facts = {"VW": lanes, "SAMPLER_LATTICE": int(lattice)}
    words = np.array(seed, np.uint32).tobytes()
    run_probe(
        session, "probe_random", facts, count // lanes, pixels=pixels, samples=samples, dimensions=dimensions, out=out,
        capacity=np.uint32(count), seed=words,
    )  # fmt: skip
    return session.read(out, np.float32, 4 * count).reshape(4, count).T


# Scenes and rays that are hard: many primitives of every kind, a closed mesh, rays along axes.


def globe(rings: int, segments: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points and faces of a unit sphere of rings and segments, facing outwards, convex and closed."""
    theta = np.pi * np.arange(1, rings) / rings
    phi = 2 * np.pi * np.arange(segments) / segments
    ring = np.stack([np.outer(np.sin(theta), np.cos(phi)), np.outer(np.sin(theta), np.sin(phi)),
                     np.outer(np.cos(theta), np.ones(segments))], axis=-1)  # fmt: skip
    points = np.concatenate([[[0, 0, 1]], ring.reshape(-1, 3), [[0, 0, -1]]])
    last = len(points) - 1
    faces = []
    for j in range(segments):
        k = (j + 1) % segments
        faces.append((0, 1 + j, 1 + k))
        faces.append((last, last - segments + k, last - segments + j))
        for i in range(rings - 2):
            a, b = 1 + i * segments + j, 1 + i * segments + k
            faces += [(a, a + segments, b + segments), (a, b + segments, b)]
    return points, np.array(faces)


def directions(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Return unit vectors, evenly over the sphere."""
    v = rng.standard_normal((count, 3))
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


Array = NDArray[np.float64]
MATTE = {"kind": "matte", "reflectance": 0.6}
NET = {"kind": "matte", "reflectance": 0.6, "opacity": {"kind": "checker", "even": 1, "odd": 0.3, "scale": [6, 6]}}
LAMP = {"kind": "emissive", "radiance": 4}
KINDS = ("sphere", "ellipsoid", "rectangle", "disk", "box", "cylinder", "cone")


def _turned_object(kind: str, center: Array, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Return an object of a kind about a place, turned at random."""
    a, b = directions(rng, 2) * size
    at = center.tolist()
    shapes: dict[str, dict[str, Any]] = {
        "sphere": {"shape": "sphere", "center": at, "radius": size},
        "ellipsoid": {
            "shape": "sphere", "center": [0, 0, 0], "radius": size,
            "transform": [{"scale": [1, 0.3, 2]}, {"rotate": {"axis": a.tolist(), "degrees": 50}}, {"translate": at}],
        },
        "rectangle": {"shape": "rectangle", "corner": at, "edge_u": (2 * a).tolist(), "edge_v": (a + b).tolist()},
        "disk": {"shape": "disk", "center": at, "normal": a.tolist(), "radius": size},
        "box": {
            "shape": "box", "min": [-size, -size, -size], "max": [size, 0.3 * size, 2 * size],
            "transform": [{"rotate": {"axis": b.tolist(), "degrees": 70}}, {"translate": at}],
        },
        "cylinder": {"shape": "cylinder", "base": at, "top": (center + 2 * a).tolist(), "radius": 0.4 * size},
        "cone": {"shape": "cone", "base": at, "apex": (center + 3 * a).tolist(), "radius": size},
    }  # fmt: skip
    return shapes[kind]


def _upright_object(kind: str, center: Array, size: float) -> dict[str, Any]:
    """Return an object of a kind whose planes and axes are those of the world: its box is flat, or touched all over."""
    at, x, y = center.tolist(), [size, 0, 0], [0, size, 0]
    shapes: dict[str, dict[str, Any]] = {
        "sphere": {"shape": "sphere", "center": at, "radius": size},
        "ellipsoid": {"shape": "sphere", "center": at, "radius": size, "transform": [{"scale": [1, 1, 0.5]}]},
        "rectangle": {"shape": "rectangle", "corner": at, "edge_u": x, "edge_v": y},
        "disk": {"shape": "disk", "center": at, "normal": [0, 1, 0], "radius": size},
        "box": {"shape": "box", "min": at, "max": (center + size).tolist()},
        "cylinder": {"shape": "cylinder", "base": at, "top": (center + x).tolist(), "radius": size / 2},
        "cone": {"shape": "cone", "base": at, "apex": (center + y).tolist(), "radius": size / 2},
    }
    return shapes[kind]


def crowd(rng: np.random.Generator, count: int, place: Any = (0, 0, 0), holes: bool = True) -> list[dict[str, Any]]:
    """Return ``count`` objects of every kind within [-1, 1]^3 about a place, a few of them twice, and a plane below."""
    place = np.asarray(place, np.float64)
    grid = np.round(rng.uniform(-1, 1, (count, 3)) * 8) / 8
    items = []
    for index, center in enumerate(grid):
        kind, size = KINDS[index % len(KINDS)], float(rng.choice([0.03, 0.125, 0.25]))
        item = (
            _upright_object(kind, place + center, size)
            if index % 3 == 0
            else _turned_object(kind, place + center, size, rng)
        )
        items.append(item | {"material": NET if holes and index % 5 == 0 else MATTE})
    items += items[:: max(count // 15, 1)]  # at equal distance: the first of the list counts
    plane = {"shape": "plane", "point": (place - [0, 1.5, 0]).tolist(), "normal": [0, 1, 0]}
    plane["material"] = NET if holes else MATTE
    return [*items, plane]


def random_rays(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Return rays from in and about [-1, 1]^3."""
    return rng.uniform(-2, 2, (count, 3)), directions(rng, count)


def axis_rays(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Return rays along an axis, through the planes that upright objects lie in, with zeros of both signs."""
    o = np.round(rng.uniform(-1.5, 1.5, (count, 3)) * 16) / 16
    axis, sign = rng.integers(3, size=count), rng.choice([-1.0, 1.0], count)
    d = np.where(rng.random((count, 3)) < 0.5, 0.0, -0.0)
    d[np.arange(count), axis] = sign
    return o, d


# Rays against the meshes and the objects of a scene, by the kernels that render.

RAY_MATTE = {"kind": "matte", "reflectance": 0.5}


def mesh_object(points: Any, faces: Any, **keys: Any) -> dict[str, Any]:
    """Return the mapping of a mesh that is written out."""
    return {
        "shape": "mesh",
        "vertices": np.asarray(points, np.float64).tolist(),
        "faces": np.asarray(faces).tolist(),
        "material": RAY_MATTE,
    } | keys


NOTHING = -1
_TREE_ARGUMENTS = ("primitive_nodes", "primitive_leaves")


@dataclass(frozen=True)
class RayHits:
    """Distance and primitive of the nearest hit of each ray, and whether anything lay in the way; more on a mesh."""

    t: NDArray[np.float32]
    primitive: NDArray[np.int32]
    blocked: NDArray[np.bool_]
    part: Any = None
    weights: Any = None
    point: Any = None
    normal: Any = None
    offset: Any = None

    def unlike(self, other: RayHits) -> NDArray[np.bool_]:
        """Return which rays met something else, to the last bit."""
        return np.asarray(
            (self.t.view(np.int32) != other.t.view(np.int32))
            | (self.primitive != other.primitive)
            | (self.blocked != other.blocked)
        )


class TracedScene:
    """Objects and meshes on a device, the eye where requested, to be traced by the kernels of a render."""

    def __init__(self, session: Session, objects: list[dict[str, Any]], eye: Any = (0, 0, 0), **keys: Any) -> None:
        target = [eye[0], eye[1], eye[2] - 1]
        camera = {"kind": "pinhole", "eye": list(eye), "target": target, "up": [0, 1, 0], "fov_degrees": 40}
        self.plan = make_plan(load_scene({"camera": camera, "objects": objects, **keys}))
        self.session = session
        self.buffers = SceneBuffers(session, self.plan)

    @property
    def has_tree(self) -> bool:
        """Whether rays walk a tree over the primitives."""
        return "HAS_PRIMITIVE_TREE" in self.buffers.tree_facts

    def without_tree(self) -> TracedScene:
        """Return the same objects, all of which every ray is tested against; they must hold no mesh."""
        assert self.has_tree
        assert self.plan.meshes is None
        other = copy.copy(self)
        other.buffers = copy.copy(self.buffers)
        other.buffers.scene = {name: value for name, value in self.buffers.scene.items() if name not in _TREE_ARGUMENTS}
        other.buffers.tree_facts = {}
        return other

    @cached_property
    def mesh_trees(self) -> Mapping[str, NDArray[Any]]:
        """The arrays of the trees over triangles."""
        assert self.plan.meshes is not None
        return scene_trees(self.plan.meshes, self.session)[0]

    def _run(self, probe: str, items: int, lanes: int, **arguments: Any) -> None:
        facts = self.plan.facts | self.buffers.tree_facts | {"VW": lanes}
        run_probe(self.session, probe, facts, items, **self.buffers.scene, **arguments)

    def trace_shapes(
        self, o: Any, d: Any, self_hit: Any = NOTHING, reach: Any = 3e38, target: Any = NOTHING, lanes: int = 8
    ) -> RayHits:
        """Trace rays (n, 3) from points on the primitives ``self_hit`` against the shapes, in the world of the eye."""
        n = len(o)
        count = -(-n // (GROUP * 8)) * GROUP * 8
        rays = np.zeros((9, count), np.float32)
        rays[:3, :n], rays[3:6, :n], rays[7, :n] = np.asarray(o).T, np.asarray(d).T, reach
        rays[6] = np.int32(-2).view(np.float32)
        rays[6, :n] = np.broadcast_to(np.int32(self_hit), n).view(np.float32)
        rays[8, :n] = np.broadcast_to(np.int32(target), n).view(np.float32)
        hits, dark = self.session.allocate(8 * count), self.session.allocate(4 * count)
        held = self.session.allocate(rays.nbytes)  # aligned for packs, as the host's array need not be
        self.session.write(held, rays)
        arguments = {"rays": held, "hits": hits, "blocked": dark, "count": np.uint32(count)}
        self._run("probe_primitives", count // lanes, lanes, **arguments)
        t, primitive = self.session.read(hits, np.float32, 2 * count).reshape(2, count)[:, :n]
        return RayHits(t, primitive.view(np.int32), self.session.read(dark, np.int32, count)[:n] != 0)

    def trace_mesh(self, o: Any, d: Any, lanes: int = 8) -> RayHits:
        """Trace rays (n, 3) against the meshes."""
        n = len(o)
        count = -(-n // (GROUP * 8)) * GROUP * 8
        rays = np.zeros((9, count), np.float32)
        rays[:3, :n], rays[3:6, :n] = np.asarray(o).T, np.asarray(d).T
        rays[3, n:] = 1
        rays[6:8] = np.int32(-1).view(np.float32)
        rays[8, :n] = 3e38
        out, dark = self.session.allocate(48 * count), self.session.allocate(4 * count)
        held = self.session.upload(rays)
        self._run("probe_hits", count // lanes, lanes, rays=held, hits=out, blocked=dark, count=np.uint32(count))
        rows = self.session.read(out, np.float32, 12 * count).reshape(12, count)[:, :n]
        blocked = self.session.read(dark, np.int32, count)[:n] != 0
        primitive, part = rows[1:3].view(np.int32)
        return RayHits(rows[0], primitive, blocked, part, rows[3:5].T, rows[5:8].T, rows[8:11].T, rows[11])

    def brute(self, o: Any, d: Any) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return distance and triangle of the nearest hits, without the tree."""
        count = len(o)
        rays = np.zeros((9, count), np.float32)
        rays[:3], rays[3:6] = np.asarray(o).T, np.asarray(d).T
        out, blocks = self.session.allocate(8 * count), np.uint32(len(self.mesh_trees["blocks"]))
        held = self.session.upload(rays)
        self._run("probe_brute", count, 1, rays=held, hits=out, block_count=blocks, count=np.uint32(count))
        rows = self.session.read(out, np.float32, 2 * count).reshape(2, count)
        return rows[0], rows[1].view(np.int32)

    def departures(self, o: Any, d: Any, onward: Any, lanes: int = 8) -> NDArray[np.int32]:
        """Return 1 where a ray that leaves the point met goes on to meet something, 0 where not, -1 without a point."""
        count = len(o)
        rays = np.concatenate([np.asarray(rows, np.float32).T for rows in (o, d, onward)])
        out = self.session.allocate(4 * count)
        held = self.session.upload(np.ascontiguousarray(rays))
        self._run("probe_departure", count // lanes, lanes, rays=held, again=out, count=np.uint32(count))
        return self.session.read(out, np.int32, count)


# Checks of the ground that all else stands on: random numbers, roots and quotients, sums of the film.

MASK = (1 << 32) - 1
MULTIPLIER, INCREMENT = 1664525, 1013904223
CORNERS = (0, 1, 2, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFE, 0xFFFFFFFF)
SEED = (12345, 67890)
_ADDITIONS = 1 << 22  # to a pixel of the film
_PER_LAUNCH = 1 << 15  # steps of a loop that no kernel of a render exceeds
_LOOPS = 1000  # steps of the inner one
_FILM_PIXELS = 16
_WORST_ULPS = 3.0  # what OpenCL 1.2 allows a root, and more than it allows a quotient


def pcg4d(x: int, y: int, z: int, w: int) -> tuple[int, int, int, int]:
    """Return the permutation of four words as published (Jarzynski and Olano 2020), in Python's integers."""
    x, y, z, w = ((v * MULTIPLIER + INCREMENT) & MASK for v in (x, y, z, w))
    for mix in (False, True):
        if mix:
            x, y, z, w = (v ^ (v >> 16) for v in (x, y, z, w))
        x = (x + y * w) & MASK
        y = (y + z * x) & MASK
        z = (z + x * y) & MASK
        w = (w + y * z) & MASK
    return x, y, z, w


def _known_counters() -> NDArray[np.int64]:
    """Return 512 counters (512, 3): every corner of their range, and some between."""
    rng = np.random.default_rng(2)
    grid = np.array([(a, b, c) for a in CORNERS for b in CORNERS for c in CORNERS])
    return np.concatenate([rng.integers(0, 1 << 32, (512 - len(grid), 3)), grid])


def wrong_random_numbers(session: Session, lanes: int) -> int:
    """Return how many of the 2048 random numbers of the known counters differ from those of the published hash."""
    counters = _known_counters()
    pixel, sample, dimension = counters.T
    got = random_numbers(session, pixel, sample, dimension, SEED, lanes=lanes)
    words = [pcg4d(int(a), int(b), int(c) ^ SEED[1], SEED[0]) for a, b, c in counters]
    expected = (np.array(words, np.uint64) >> np.uint64(8)).astype(np.float32) * np.float32(2**-24)
    return int((got != expected).sum())


def random_check(session: Session) -> Check:
    """Known answers of the random numbers."""
    return Check("random numbers: known answers", wrong_random_numbers(session, session.lanes), 0, "of 2048 differ")


def arithmetic_checks(session: Session) -> list[Check]:
    """Roots and quotients, and the test for what is not finite."""
    rng = np.random.default_rng(3)
    count = 4096
    a, b = (np.ldexp(rng.uniform(0.5, 1, count), rng.integers(-60, 60, count)).astype(np.float32) for _ in range(2))
    strange = np.array([np.nan, -np.nan, np.inf, -np.inf, 3.4e38, -3.4e38, 0.0, 1e-45], np.float32)
    a[: len(strange)] = strange
    out = session.allocate(12 * count)
    run_probe(
        session, "probe_arithmetic", {"VW": session.lanes}, count // session.lanes,
        a=session.upload(a), b=session.upload(b), out=out, count=np.uint32(count),
    )  # fmt: skip
    root, quotient, flags = session.read(out, np.float32, 3 * count).reshape(3, count)
    wrong = int(((flags != 0) != ~np.isfinite(a)).sum())
    tame = slice(len(strange), None)
    exact = (np.sqrt(a[tame].astype(np.float64)), a[tame].astype(np.float64) / b[tame])
    worst = max(
        float((np.abs(got - true) / np.spacing(true.astype(np.float32))).max())
        for got, true in zip((root[tame], quotient[tame]), exact, strict=True)
    )
    return [
        Check("roots and quotients", worst, _WORST_ULPS, "units in the last place"),
        Check("what is not finite is recognised", wrong, 0, f"of {count} wrong"),
    ]


def _film_errors(session: Session) -> tuple[float, int]:
    """Return the largest relative error of sums on the film, and how many not-finite samples were not counted.

    Every pixel gets numbers that are even over [0, 1), numbers of which one in 4096 is 1000, and tenths; the last
    sample of each is not a number.
    """
    lanes = session.lanes
    sums, counters = session.allocate(24 * _FILM_PIXELS, zeroed=True), session.allocate(64, zeroed=True)
    for first in range(0, _ADDITIONS, _PER_LAUNCH):
        run_probe(
            session, "probe_film", {"VW": lanes, "CLAMP": 0}, _FILM_PIXELS // lanes, sums=sums, counters=counters,
            pixels=np.uint32(_FILM_PIXELS), first=np.uint32(first),
            samples=np.uint32(min(_PER_LAUNCH, _ADDITIONS - first)), last=np.uint32(_ADDITIONS - 1),
        )  # fmt: skip
    planes = session.read(sums, np.float32, 6 * _FILM_PIXELS).reshape(6, _FILM_PIXELS).astype(np.float64)
    counted = session.read(counters, np.uint32, 16)[len(RayStatus)]
    expected = np.array([_film_sums(pixel, _ADDITIONS - 1) for pixel in range(_FILM_PIXELS)]).T
    return float(np.abs((planes[:3] - planes[3:]) / expected - 1).max()), abs(int(counted) - _FILM_PIXELS)


def film_values(pixel: int, count: int) -> NDArray[np.float32]:
    """Return the first samples (3, count) that `_film_errors` adds to a pixel."""
    index = np.arange(count, dtype=np.uint32) * np.uint32(_FILM_PIXELS) + np.uint32(pixel)
    word = index * np.uint32(2654435761)
    even = (word >> np.uint32(8)).astype(np.float32) * np.float32(2**-24)
    rare = np.where(word >> np.uint32(20), even, np.float32(1000))
    return np.stack([even, rare, np.full(count, 0.1, np.float32)])


def _film_sums(pixel: int, count: int) -> NDArray[np.float64]:
    sums: NDArray[np.float64] = film_values(pixel, count).sum(axis=1, dtype=np.float64)
    return sums


def loop_check(session: Session) -> Check:
    """Loops run to their end, as far as the device is known to let them: more than a kernel of a render takes."""
    steps = 1 << 20 if session.loop_limit is None else session.loop_limit - 1
    outer = steps // (_LOOPS + 1)  # a step of the outer loop counts, too
    out = session.allocate(4)
    run_probe(session, "probe_loops", {"VW": 1}, 1, out=out, outer=np.uint32(outer), inner=np.uint32(_LOOPS))
    done = int(session.read(out, np.uint32, 1)[0])
    return Check(f"loops: {outer * _LOOPS} steps", abs(outer * _LOOPS - done), 0, "not taken")


def film_checks(session: Session) -> list[Check]:
    """Sums of many samples, and samples that are not numbers."""
    error, uncounted = _film_errors(session)
    return [
        Check(f"film: {_ADDITIONS} samples in a pixel", error, 1e-7, "relative"),
        Check("film: samples that are not numbers", uncounted, 0, f"of {_FILM_PIXELS} not dropped and counted"),
    ]


# Checks of what rays meet: watertight meshes, trees, rays that leave a surface, spheres far away.

PLACES = ((0.0, 0.0, 0.0), (1000.0, -2000.0, 500.0), (148376.0, 1234.0, -223423.0))
WIDEST = 8  # lanes of a work item of the probes


def _lanes_of(session: Session) -> int:
    """Return the lanes that probes of a device have per work item."""
    return min(session.lanes, WIDEST)


def leaks(session: Session, place: Any, rng: np.random.Generator, rays: int, rings: int) -> int:
    """Return how many rays from inside a closed mesh at a place leave it, aimed at its edges and corners."""
    points, faces = globe(rings, rings)
    scene = TracedScene(session, [mesh_object(points * 2 + place, faces)])
    assert scene.plan.meshes is not None
    stored = scene.mesh_trees["vertices"][:, :3].astype(np.float64)  # where the device has them
    corners = stored[scene.plan.meshes.triangles[:, :3]]
    inside = np.asarray(place) + 0.9 * directions(rng, rays) * rng.random((rays, 1))
    chosen = corners[rng.integers(len(corners), size=rays)]
    edge = np.where(rng.random(rays) < 2 / 3, rng.random(rays), 0.0)[:, None]  # a third at a corner
    origin = inside.astype(np.float32)
    d = chosen[:, 0] * (1 - edge) + chosen[:, 1] * edge - origin
    d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
    hits = scene.trace_mesh(origin, d, lanes=_lanes_of(session))
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
    scene = TracedScene(session, [mesh_object(points, faces)])
    wrong = 0
    kinds = ("random", "axis", "denormal")
    for kind in kinds:
        o, d = (rows.astype(np.float32) for rows in mesh_rays_of(kind, rng, rays))
        t, triangle = scene.brute(o, d)
        hits = scene.trace_mesh(o, d, lanes=_lanes_of(session))
        is_hit = triangle >= 0
        apart = hits.t.view(np.uint32) != t.view(np.uint32)
        wrong += int((((hits.primitive >= 0) != is_hit) | (is_hit & apart) | (hits.blocked != is_hit)).sum())
    return Check("mesh: tree against every triangle", wrong, 0, f"of {rays * len(kinds)} rays differ in a bit")


def object_tree_check(session: Session) -> Check:
    """The tree over shapes against all shapes, one after the other."""
    rng, rays = np.random.default_rng(13), 16384
    tree = TracedScene(session, crowd(rng, 150))
    loop = tree.without_tree()
    wrong = 0
    for make in (random_rays, axis_rays):
        o, d = (rows.astype(np.float32) for rows in make(rng, rays))
        by_tree, expected = (scene.trace_shapes(o, d, lanes=_lanes_of(session)) for scene in (tree, loop))
        wrong += int(by_tree.unlike(expected).sum())
    return Check("shapes: tree against every shape", wrong, 0, f"of {2 * rays} rays differ in a bit")


def departures(session: Session, size: float, away: float, rng: np.random.Generator, rays: int) -> tuple[int, float]:
    """Return how many rays that leave a convex mesh of a size meet it again, and the share that never met it.

    ``away`` is the distance of the mesh from the eye over its size.
    """
    points, faces = globe(12, 16)
    place = directions(rng, 1)[0] * size * away
    scene = TracedScene(session, [mesh_object(points * size + place, faces)])
    o = place + size * 2 * directions(rng, rays)
    d = place + size * rng.uniform(-0.6, 0.6, (rays, 3)) - o
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    again = scene.departures(o, d, directions(rng, rays), _lanes_of(session))
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


def _far_sphere_errors(session: Session, distance: float, rng: np.random.Generator, rays: int) -> tuple[float, int]:
    """Return how far from a unit sphere rays meet it, over the distance that they come from, and how many miss it."""
    sphere = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": RAY_MATTE}
    scene = TracedScene(session, [sphere])
    o = (distance * directions(rng, rays)).astype(np.float32)
    d = 0.8 * directions(rng, rays) * rng.random((rays, 1)) - o
    d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
    met = scene.trace_shapes(o, d, lanes=_lanes_of(session))
    hit = met.primitive >= 0
    points = (o.astype(np.float64) + met.t.astype(np.float64)[:, None] * d)[hit]
    return float(np.abs(np.linalg.norm(points, axis=1) - 1).max(initial=0.0)) / distance, int((~hit).sum())


def far_sphere_checks(session: Session) -> list[Check]:
    """Spheres seen from 10 to 1e6 radii."""
    rng, rays = np.random.default_rng(19), 4096
    errors = [_far_sphere_errors(session, 10.0**power, rng, rays) for power in range(1, 7)]
    return [
        Check("spheres from 10 to 1e6 radii: points", max(e for e, _ in errors), 1.6e-6, "of the distance"),
        Check("spheres from 10 to 1e6 radii: misses", sum(n for _, n in errors), 0, f"of {rays * len(errors)} rays"),
    ]
