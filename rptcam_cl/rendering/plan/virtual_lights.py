"""Whether a scene has virtual lights, and where the light paths start that leave them.

The vertices of camera paths connect to them, see `rptcam_cl/rendering/virtual_lights.py`. Rooms gain that are lit by
detours; whether a scene is one, a rough look at it on the host tells before anything is compiled.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import CAUSTIC_SURFACE, FLAT_EMITTERS, EmitterKind, Hidden, Kind
from rptcam_cl.core.remember import Memory
from rptcam_cl.rendering.plan.caustics import (
    BOXES,
    WITHOUT_SIZE,
    divided,
    is_clear,
    lamp_centres,
    lamp_sizes,
    shape_surfaces,
    surfaces_of,
)
from rptcam_cl.rendering.plan.emitters import Emitters, is_shining
from rptcam_cl.rendering.plan.primitives import Primitive, Primitives, Prototype, affine
from rptcam_cl.scene import materials
from rptcam_cl.scene.assets.mesh import Mesh
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]

_ON = "on: paths connect to virtual lights"
# What connections do not know of, by the facts that tell; the light of everything else they bring as paths do.
_WITHOUT = {
    "HAS_MEDIA": "media such as fog",
    "HAS_MOTION": "objects that move",
    "HAS_CURVE": "curves",
    "HAS_DISPERSION": "glass that disperses",
    "LIGHT_GROUPS": "the layer lights, as virtual lights do not know their lamp",
}
_LEAST_DEPTH = 3  # of a path from the eye by a vertex and a virtual light to a lamp [edges]
_CELLS = 1024  # into which rectangles are divided, for starts to follow the light


@dataclass(frozen=True)
class VirtualLights:
    """Where light paths start.

    Attributes
    ----------
    active : bool
        Whether there are any.
    choice : str or None
        What was decided and why; None where the scene does not ask and is none that they could gain anything in.
    surfaces : array of CausticSurface
        All surfaces; rectangles and the faces of boxes in pieces.
    areas : (n,) array
        Of them [m²].
    by_chance : float
        Chance of a start to look for light in a random direction: 0 where light samples find all of it.
    box : (2, 3) array or None
        Corners of the cube beyond which planes have none [m], the eye at the origin; None without planes.
    """

    active: bool
    choice: str | None
    surfaces: NDArray[np.void]
    areas: Array
    by_chance: float
    box: Array | None = None

    @property
    def facts(self) -> dict[str, int]:
        """Whether the kernels must know of them."""
        return {"VIRTUAL_LIGHTS": int(self.active)}


def without_virtual_lights(scene: Scene, reason: str | None = None) -> VirtualLights:
    """Have none, for what they do not go with, where there is such.

    Raises
    ------
    InputError
        With ``render.virtual_lights: on`` and such a reason.
    """
    if scene.render.virtual_lights == "on" and reason is not None:
        raise InputError(f"render.virtual_lights: there are none with {reason} (allowed: off or auto)")
    return VirtualLights(False, None, CAUSTIC_SURFACE.zeros(1), np.ones(1), 0.0)


def pack_virtual_lights(
    scene: Scene,
    primitives: Primitives,
    first_triangles: NDArray[np.int32],
    emitters: Emitters,
    facts: Mapping[str, int],
    eye: Array,
) -> VirtualLights:
    """Return the virtual lights of a scene, inactive where it leaves them off or they would gain nothing.

    Parameters
    ----------
    scene
        The scene; ``render.virtual_lights`` says what is wanted.
    primitives, first_triangles, emitters
        Its primitives, meshes last; of those their first triangles; its lamps.
    facts
        All others of the scene.
    eye
        (3,), where the camera stands [m].

    Raises
    ------
    InputError
        With ``render.virtual_lights: on`` where they do not know of something in the scene.
    """
    wanted = scene.render.virtual_lights
    if wanted == "off":
        return without_virtual_lights(scene)
    if reason := _reason_against(scene, primitives, facts):
        return without_virtual_lights(scene, reason)
    reason = _nothing_to_do(scene, primitives, emitters, facts)
    if reason is None and wanted == "auto":
        reason = _gains_nothing(primitives, emitters, facts, eye)
    if reason is not None:
        choice = f"off: {reason}" if "virtual_lights" in scene.render.model_fields_set else None
        return replace(without_virtual_lights(scene), choice=choice)
    dull = primitives.of_each(lambda each: int(_is_dull(each) and each.kind is not Kind.PLANE)) > 0
    surfaces, areas = CAUSTIC_SURFACE.zeros(1)[:0], np.zeros(0)
    if dull.any():
        surfaces, areas = surfaces_of(primitives, first_triangles, dull, eye)[:2]
    box = None
    if facts["HAS_PLANE"]:
        low, high = _Shapes(primitives, eye).bounds()
        margin = 1e-3 * (high - low).max()  # shapes at its sides lie in it, however places are rounded
        box = np.array([low - margin, low + (high - low).max() + margin])
        for index, plane in primitives.among(lambda each: each.kind is Kind.PLANE and _is_dull(each)):
            records, sizes = shape_surfaces(_spread_about(plane, box))
            records["primitive"] = index
            surfaces, areas = np.concatenate([surfaces, records]), np.append(areas, sizes)
    surfaces, areas, _ = divided(surfaces, areas, _CELLS * areas / areas.sum())
    return VirtualLights(True, _ON, surfaces, areas, _by_chance(primitives, emitters, facts), box)


def _is_dull(each: Primitive | Prototype) -> bool:
    return not isinstance(each.material, materials.Emissive)


def _scatters_evenly(each: Primitive) -> bool:
    """Return whether virtual lights lie on it, where its normals are those of the surface."""
    material = each.material
    is_bumpy = isinstance(material, materials.Matte) and (material.normal_map, material.bump) != (None, None)
    return isinstance(material, materials.Matte) and not material.parameter and not is_bumpy


def _spread_about(plane: Primitive, box: Array) -> Primitive:
    """Return a plane whose canonical form, over which paths start most about its origin, stands beside a cube."""
    x, y, z, _ = np.linalg.inv(plane.placement) @ np.append(box.mean(axis=0), 1.0)
    size = math.hypot(float(np.linalg.norm(box[1] - box[0])) / 2, z)
    return plane._replace(placement=plane.placement @ affine(np.diag([size, size, 1]), [x, y, 0]))


def _reason_against(scene: Scene, primitives: Primitives, facts: Mapping[str, int]) -> str | None:
    if scene.shutter.keys:
        return "keys that move while the shutter is open"
    if any(each.hidden & ~Hidden.FROM_CAMERA for each in primitives.prototypes):
        return "objects that are hidden from reflection or shadow"
    return next((reason for fact, reason in _WITHOUT.items() if facts[fact]), None)


def _nothing_to_do(scene: Scene, primitives: Primitives, emitters: Emitters, facts: Mapping[str, int]) -> str | None:
    if not facts["HAS_MATTE"]:
        return "no matte surface"
    if all(each.kind is Kind.PLANE for each in primitives.prototypes):
        return "nothing but planes"
    if not (emitters.count or facts["ENVIRONMENT"] or facts["HAS_EMISSIVE"]):
        return "no light"
    short = scene.render.max_depth < _LEAST_DEPTH
    return f"paths of fewer than {_LEAST_DEPTH} edges (render.max_depth)" if short else None


def _by_chance(primitives: Primitives, emitters: Emitters, facts: Mapping[str, int]) -> float:
    """Return how often starts look for light in a random direction: where light samples do not find all of it."""
    if not emitters.count:
        return 1.0
    shining = (*primitives.among(lambda each: is_shining(each.material)),)
    found = all(
        index in emitters.of_primitive and isinstance(each.material, materials.Emissive) and not each.material.two_sided
        for index, each in shining
    )
    return 0.0 if found and not facts["ENVIRONMENT"] else 0.5


# Whether they gain enough to be worth their time: a rough look at the scene on the host, by boxes about most shapes.

_RAYS = 256  # ways from the eye
_MOST_SHAPES, _MOST_LAMPS = 1024, 16
_LEAST_CLOSED = 0.7  # of the ways on from what the camera sees that must end in the scene
_LEAST_MATTE = 0.5  # of the places where they end, where there can be virtual lights
# Mean square of the direct light of the places where they end, over its squared mean: about that of a path's light by
# two edges. Rooms from 5 on gained 1 to 16 times, most others 0.5 to 0.8. Among meshes a path's ways cost more: rooms
# from 3.5 on gained 0.7 to 19 times, those from 1.9 on 0.7 to 2, those below 0.6 (benchmarks/journal.md).
_LEAST_UNEVEN, _LEAST_AMONG_MESHES = 5.0, 1.9
_R3 = np.array([0.8191725134, 0.6710436067, 0.5497004779])  # a sequence that fills the unit cube evenly


def _gains_nothing(primitives: Primitives, emitters: Emitters, facts: Mapping[str, int], eye: Array) -> str | None:
    """Return why connections are not worth their time, None where they are.

    Paths need them where light comes by detours: where what surrounds the things that the camera sees is lit unevenly;
    and nowhere, if light leaves the scene.
    """
    if len(primitives) > _MOST_SHAPES:
        return "many objects"
    shapes = _Shapes(primitives, eye)
    across, along, turn = (np.arange(_RAYS)[:, None] * _R3 + 0.5).T % 1.0
    towards, cosine = shapes.cone()
    rays = _about(np.broadcast_to(towards, (_RAYS, 3)), 1 - (1 - cosine) * across, along)
    unseen = primitives.of_each(lambda each: each.hidden & Hidden.FROM_CAMERA) > 0
    places, facing, shape = shapes.meet(np.zeros((_RAYS, 3)), rays, unseen)
    met = shape >= 0
    if not met.any():
        return "nothing in front of the camera"
    places, facing, turn, along = places[met], facing[met], turn[met], along[met]
    places, facing, shape = shapes.meet(places, _about(facing, np.sqrt(along), turn))
    closed = shape >= 0
    if closed.mean() < _LEAST_CLOSED:
        return f"light leaves the scene: {closed.mean():.0%} of the ways on from what the eye sees end in it"
    if (matte := float(shapes.even[shape[closed]].mean())) < _LEAST_MATTE:
        return f"{matte:.0%} of what is around the things that the eye sees is plain matte"
    places, facing, turn, along = places[closed], facing[closed], turn[closed], along[closed]
    light = _direct_light(places, facing, shapes, primitives, emitters)
    if facts["ENVIRONMENT"]:
        sees = shapes.meet(places, _about(facing, np.sqrt(turn), along))[2] < 0
        light += sees * (float(light.mean()) or 1.0)
    uneven = float((light**2).mean() / light.mean() ** 2) if light.any() else math.inf
    least = _LEAST_AMONG_MESHES if facts["HAS_MESH"] else _LEAST_UNEVEN
    if uneven < least:
        return f"lamps light what is around evenly enough: the mean of its square is {uneven:.2g} of {least:g}"
    return None


def _about(axes: Array, cosines: NDArray[Any], turns: NDArray[Any]) -> Array:
    """Return unit directions (n, 3) at such cosines to axes."""
    helper = np.where(np.abs(axes[:, :1]) < 0.9, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
    x = np.cross(axes, helper)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(axes, x)
    aside, angle = np.sqrt(np.maximum(1 - cosines**2, 0))[:, None], 2 * np.pi * turns[:, None]
    return np.asarray(cosines[:, None] * axes + aside * (np.cos(angle) * x + np.sin(angle) * y))


_NO_BOX = ((0, 0, 0), (0, 0, 0))  # of planes


class _Shapes:
    """Flat shapes, spheres and boxes, cells of meshes, and boxes about all others; without clear glass.

    A box about a shape is not there for ways that start in it.
    """

    def __init__(self, primitives: Primitives, eye: Array) -> None:
        shapes = list(primitives)
        self._kinds = np.array([each.kind for each in shapes])
        inverse = np.linalg.inv(np.array([each.placement for each in shapes])).astype(np.float64)
        of_meshes = np.where(self._kinds == Kind.MESH, 1.0, 0.0)[:, None] * eye  # they stand about the scene
        inverse[:, :3, 3] += (inverse[:, :3, :3] @ of_meshes[:, :, None])[..., 0]
        self._inverse = inverse
        boxes = [BOXES.get(each.kind, _NO_BOX) if each.mesh is None else each.mesh.bounds() for each in shapes]
        self._low, self._high = np.array(boxes, np.float64).transpose(1, 0, 2)
        self._clear = np.array([is_clear(each.material) for each in shapes])
        self.even = np.array([_scatters_evenly(each) for each in shapes])
        self._meshes = np.flatnonzero(self._kinds == Kind.MESH)
        scales = np.abs(np.linalg.det(inverse[self._meshes, :3, :3])) ** (-1 / 3)
        self._grids = _Grids([each.mesh for each in shapes if each.mesh is not None], scales)

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and highest corner of all but planes [m], the eye at the origin."""
        ends = self._kinds != Kind.PLANE
        boxes = np.stack([self._low[ends], self._high[ends]], axis=1)
        corners = boxes[:, np.indices((2, 2, 2)).reshape(3, 8), np.arange(3)[:, None]].swapaxes(1, 2)
        placed = np.linalg.inv(self._inverse[ends])
        corners = corners @ placed[:, :3, :3].swapaxes(1, 2) + placed[:, None, :3, 3]
        return corners.min(axis=(0, 1)), corners.max(axis=(0, 1))

    def cone(self) -> tuple[Array, float]:
        """Return where from the eye these lie: the axis of a cone and its least cosine, -1 from among them."""
        low, high = self.bounds()
        away, radius = float(np.linalg.norm(low + high)) / 2, float(np.linalg.norm(high - low)) / 2
        if away <= radius:
            return np.array([0.0, 0.0, 1.0]), -1.0
        return (low + high) / (2 * away), float(np.sqrt(1 - (radius / away) ** 2))

    def meet(
        self, origins: Array, ways: Array, without: int | NDArray[np.bool_] | None = None, ends: Array | None = None
    ) -> tuple[Array, Array, NDArray[np.int64]]:
        """Return the places that ways from origins (n, 3) meet first, the normals there towards them, and the shapes.

        Those that meet none have the shape -1.

        Shapes may be left out, and ways may have ends (n,), beside which meshes count no more than beside origins.
        """
        turn = self._inverse[:, :3, :3].swapaxes(1, 2)
        o, d = origins @ turn + self._inverse[:, None, :3, 3], ways @ turn
        with np.errstate(divide="ignore", invalid="ignore"):
            t, normal = self._distances(o, d, np.full(len(origins), np.inf) if ends is None else ends)
        t = np.where(np.isfinite(t) & (t > 1e-6) & ~self._clear[:, None], t, np.inf)
        if without is not None:
            t[without] = np.inf
        first, each = t.argmin(axis=0), np.arange(len(origins))
        nearest = t[first, each]
        out = (np.swapaxes(self._inverse[first, :3, :3], 1, 2) @ normal[first, each, :, None])[..., 0]
        out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-300)
        out *= np.where((out * ways).sum(axis=1, keepdims=True) > 0, -1.0, 1.0)
        met = np.isfinite(nearest)
        return origins + np.where(met, nearest, 0.0)[:, None] * ways, out, np.where(met, first, -1)

    def _distances(self, o: Array, d: Array, most: Array) -> tuple[Array, Array]:
        """Return where rays (shapes, n, 3) in the frames of shapes meet them, NaN or below 0 where they do not."""
        kinds = self._kinds[:, None]
        t = -o[..., 2] / d[..., 2]
        x, y = np.moveaxis(o[..., :2] + t[..., None] * d[..., :2], -1, 0)
        inside = np.where(kinds == Kind.DISK, x * x + y * y < 1, (x > 0) & (x < 1) & (y > 0) & (y < 1))
        inside |= kinds == Kind.PLANE
        t, normal = np.where(inside, t, np.nan), np.broadcast_to(np.array([0.0, 0, 1]), d.shape)
        ball = ((kinds == Kind.SPHERE) | (kinds == Kind.ELLIPSOID))[..., 0]
        if ball.any():
            oo, dd = o[ball], d[ball]
            a, b, c = (dd * dd).sum(axis=-1), (oo * dd).sum(axis=-1), (oo * oo).sum(axis=-1) - 1
            root = np.sqrt(b * b - a * c)
            near, far = (-b - root) / a, (-b + root) / a
            t[ball] = np.where(near > 1e-6, near, far)
            normal = normal.copy()
            normal[ball] = oo + t[ball][..., None] * dd
        if len(meshes := self._meshes):
            normal = normal.copy()
            t[meshes], normal[meshes] = self._grids.meet(o[meshes], d[meshes], most)
        box = ~ball & ~np.isin(self._kinds, (Kind.RECTANGLE, Kind.DISK, Kind.PLANE, Kind.MESH))
        if box.any():
            oo, dd = o[box], d[box]
            ends = np.stack([(side[box][:, None] - oo) / dd for side in (self._low, self._high)])
            enters, leaves = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
            solid = (self._kinds[box] == Kind.BOX)[:, None]
            t[box] = np.where(enters < leaves, np.where((enters > 1e-6) | ~solid, enters, leaves), np.nan)
            axis = np.where(enters > 1e-6, ends.min(axis=0).argmax(axis=-1), ends.max(axis=0).argmin(axis=-1))
            normal = normal.copy()
            normal[box] = np.eye(3)[axis]
        return t, normal


_MOST_CELLS = 1 << 22  # of all meshes
_FEWEST_ACROSS, _MOST_ACROSS = 8, 40  # cells along the longest side of a mesh
_STEP = 0.5  # of a cell, from one look at a way to the next, and between looks at a triangle
_CLEAR = 1.5  # cells at the start of a way, where it may leave the mesh
_MOST_SMALL = 1 << 14  # triangles within a cell of a mesh
_MOST_POINTS = 1 << 20  # on triangles, at once


@dataclass(frozen=True, eq=False)
class _Cells:
    """The cells of a mesh's box, which triangle passes through each, or -1, and the planes of triangles.

    Attributes
    ----------
    counts : (3,) int64 array
        Of cells along each axis.
    triangles : (cells,) int32 array
    planes : (n, 4) array
        A normal of any length, and its product with a point of the plane.
    """

    counts: NDArray[np.int64]
    triangles: NDArray[np.int32]
    planes: Array

    @property
    def nbytes(self) -> int:
        return self.triangles.nbytes + self.planes.nbytes

    @classmethod
    def of(cls, mesh: Mesh, side: float) -> _Cells:
        """Look at a mesh by cells of about such a side."""
        low, high = mesh.bounds()
        counts = np.maximum(np.rint((high - low) / side), 1).astype(np.int64)
        corners = mesh.positions[mesh.faces].astype(np.float64)
        longest = np.ptp(corners, axis=1).max(axis=1)
        # of small ones as many as are enough
        kept = (np.arange(len(corners)) % (len(corners) // _MOST_SMALL + 1) == 0) | (longest > side)
        corners = mesh.origin + corners[kept]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        triangles = np.full(counts.prod(), -1, np.int32)
        for numbers, points in _points_on(corners, side):
            triangles[_cell(points - low, counts / np.maximum(high - low, 1e-30), counts)] = numbers
        return cls(counts, triangles, np.column_stack([normals, (normals * corners[:, 0]).sum(axis=1)]))


_cells = Memory[_Cells](most_bytes=1 << 26)


def _cell(points: Array, per_cell: Array, counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the numbers of the cells that points (..., 3) from the corners of boxes lie in."""
    x, y, z = np.moveaxis(np.clip((points * per_cell).astype(np.int64), 0, counts - 1), -1, 0)
    return np.asarray((x * counts[..., 1] + y) * counts[..., 2] + z)


class _Grids:
    """Meshes as the cells of their boxes that triangles pass through, each with the plane of one of these.

    Parameters
    ----------
    meshes, scales
        Of each shape, and by how much it is magnified; many may share one.
    """

    def __init__(self, meshes: Sequence[Mesh], scales: Array) -> None:
        distinct = {id(mesh): mesh for mesh in meshes}
        number = {key: place for place, key in enumerate(distinct)}
        self._of = np.array([number[id(mesh)] for mesh in meshes], np.int64)
        boxes = np.array([mesh.bounds() for mesh in distinct.values()]).reshape(-1, 2, 3)
        self._low, self._high = boxes.transpose(1, 0, 2)
        longest, sizes = (self._high - self._low).max(axis=1, initial=1e-30), np.zeros(len(distinct))
        np.maximum.at(sizes, self._of, scales * longest[self._of])
        most = min(_MOST_ACROSS, (_MOST_CELLS / max(len(distinct), 1)) ** (1 / 3))
        across = np.rint(np.maximum(most * np.sqrt(sizes / sizes.max(initial=1e-300)), _FEWEST_ACROSS))
        self._side = longest / across
        cells = [
            _cells.find_or_make((mesh.content_hash, side), partial(_Cells.of, mesh, side))
            for mesh, side in zip(distinct.values(), self._side.tolist(), strict=True)
        ]
        self._counts = np.array([each.counts for each in cells], np.int64).reshape(-1, 3)
        self._per_cell = self._counts / np.maximum(self._high - self._low, 1e-30)
        self._first = np.cumsum([0, *(len(each.triangles) for each in cells)])
        self._plane = np.cumsum([0, *(len(each.planes) for each in cells)])
        self._triangles = np.concatenate([np.zeros(0, np.int32), *(each.triangles for each in cells)])
        self._planes = np.concatenate([np.zeros((0, 4)), *(each.planes for each in cells)])

    def meet(self, o: Array, d: Array, most: Array) -> tuple[Array, Array]:
        """Return where rays (shapes, n, 3) in the frames of the shapes meet them, NaN where not, and the normals there.

        A ray goes to ``most`` (n,).
        """
        t, normal = np.full(o.shape[:2], np.nan), np.zeros(o.shape)
        ends = np.stack([(side[self._of][:, None] - o) / d for side in (self._low, self._high)])
        enters, leaves = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
        shape, ray = np.nonzero((enters <= leaves) & (leaves > 1e-6))
        cell = (self._side[self._of][:, None] / np.linalg.norm(d, axis=-1))[shape, ray]
        last = np.minimum(leaves[shape, ray], most[ray] - _CLEAR * cell)
        first = np.where(enters[shape, ray] > 1e-3 * cell, enters[shape, ray], _CLEAR * cell)
        place, left = first.copy(), np.flatnonzero(first <= last)
        while len(left):
            at, start, way = place[left], o[shape[left], ray[left]], d[shape[left], ray[left]]
            mesh = self._of[shape[left]]
            points = start + at[:, None] * way - self._low[mesh]
            triangle = self._triangles[self._first[mesh] + _cell(points, self._per_cell[mesh], self._counts[mesh])]
            plane = self._planes[self._plane[mesh] + np.maximum(triangle, 0)]
            exact = (plane[:, 3] - (plane[:, :3] * start).sum(axis=1)) / (plane[:, :3] * way).sum(axis=1)
            at = np.where(np.abs(exact - at) < 2 * cell[left], exact, at)
            met = (triangle >= 0) & (np.abs(exact) > 0.5 * first[left])  # else along the face that it leaves
            own = shape[left[met]], ray[left[met]]
            t[own], normal[own] = at[met], plane[met, :3]
            place[left] += _STEP * cell[left]
            left = left[~met & (place[left] <= last[left])]
        return t, normal


def _points_on(corners: Array, side: float) -> Iterator[tuple[NDArray[np.int64], Array]]:
    """Yield points on triangles, in rows along their longest sides, and of which triangles they are.

    They leave out none of the cells that a triangle passes through, but for corners of them.
    """
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    order = (edges.argmax(axis=1)[:, None] + np.arange(3)) % 3
    corners = corners[np.arange(len(corners))[:, None], order]
    longest = np.maximum(edges.max(axis=1), 1e-300)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    steps = np.stack([longest, areas / longest], axis=1) / (_STEP * side)
    powers = np.ceil(np.log2(np.maximum(steps, 1))).astype(np.int64) @ [1, 64]
    for power in np.unique(powers).tolist():
        along, across = 1 << power % 64, 1 << power // 64
        u, v = np.meshgrid(np.arange(along + 1) / along, np.arange(across + 1) / across)
        shares = np.stack([(1 - u) * (1 - v), u * (1 - v), v], axis=-1).reshape(-1, 3)
        numbers = np.flatnonzero(powers == power)
        for some in np.array_split(numbers, len(numbers) * len(shares) // _MOST_POINTS + 1):
            yield np.repeat(some, len(shares)), (shares @ corners[some]).reshape(-1, 3)


def _direct_light(places: Array, normals: Array, shapes: _Shapes, primitives: Primitives, emitters: Emitters) -> Array:
    """Return the light at places (n, 3) that face normals by a point of each of the brightest lamps, in no unit."""
    lamps = emitters.shining[emitters.shining["kind"] != EmitterKind.ENVIRONMENT]
    lamps = lamps[np.argsort(-lamps["pick"], kind="stable")[:_MOST_LAMPS]]
    light = np.zeros(len(places))
    if not len(lamps):
        return light
    sizes = np.where(np.isin(lamps["kind"], WITHOUT_SIZE), 0.0, lamp_sizes(primitives, lamps))
    strengths = np.where(sizes > 0, sizes, 1.0) * luminance(lamps["radiance"][:, :3].astype(np.float64))
    draws = np.arange(len(places))[:, None] * _R3[:2]
    for number, (lamp, centre) in enumerate(zip(lamps, lamp_centres(lamps), strict=True)):
        afar = lamp["kind"] in (EmitterKind.SUN, EmitterKind.DIRECTIONAL)
        normal, points = lamp["normal"][:3].astype(np.float64), np.broadcast_to(centre, places.shape)
        if lamp["kind"] == EmitterKind.RECTANGLE:  # whose middle may lie behind the bars of a window
            points = centre + ((draws + number / len(lamps)) % 1.0 - 0.5) @ np.stack([lamp["u"][:3], lamp["v"][:3]])
        ways = np.broadcast_to(normal, places.shape) if afar else points - places
        length = np.maximum(np.linalg.norm(ways, axis=1), 1e-9)
        own = int(lamp["primitive"]) if lamp["primitive"] >= 0 else None
        met, _, shape = shapes.meet(places, ways / length[:, None], own, None if afar else length)
        blocked = shape >= 0
        if not afar:
            blocked &= np.linalg.norm(met - places, axis=1) < length
        cosine = np.maximum((normals * ways).sum(axis=1) / length, 0)
        if lamp["kind"] in FLAT_EMITTERS:
            behind = -(ways @ normal) / length
            cosine *= np.abs(behind) if lamp["two_sided"] else np.maximum(behind, 0)
        light += np.where(blocked, 0.0, strengths[number] * cosine / (1.0 if afar else length**2 + sizes[number]))
    return light
