"""Virtual lights: whether a scene has them, what is learned of it before its first sample, and those of a pass.

Light paths leave a virtual light at each surface that scatters evenly (Keller 1997), and the vertices of camera paths
connect to one of them each. Which of them matter, paths from the eye tell. `kernels/light/virtual_lights.h` says how
connections share their light with the path's own directions, so that the picture stays what it is, with less noise
(Kollig and Keller 2004).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import records as layout
from rptcam_cl.core.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import CAUSTIC_SURFACE, LIGHT_PASS, VIRTUAL_GRID, EmitterKind, Hidden, Kind
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.photon_map import pass_of
from rptcam_cl.rendering.plan.caustics import (
    BOXES,
    WITHOUT_SIZE,
    divided,
    is_clear,
    lamp_centres,
    lamp_sizes,
    surfaces_of,
)
from rptcam_cl.rendering.plan.emitters import Emitters, is_shining
from rptcam_cl.rendering.plan.primitives import Primitives
from rptcam_cl.scene import materials
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

# Whether a scene has virtual lights.

_ON = "on: paths connect to virtual lights"
# What connections do not know of, by the facts that tell; the light of everything else they bring as paths do.
_WITHOUT = {
    "HAS_MEDIA": "media such as fog",
    "HAS_MOTION": "objects that move",
    "HAS_PLANE": "planes without end",
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
    """

    active: bool
    choice: str | None
    surfaces: NDArray[np.void]
    areas: Array
    by_chance: float

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
    reason = _nothing_to_do(scene, emitters, facts)
    if reason is None and wanted == "auto":
        reason = _gains_nothing(primitives, emitters, facts, eye)
    if reason is not None:
        choice = f"off: {reason}" if "virtual_lights" in scene.render.model_fields_set else None
        return replace(without_virtual_lights(scene), choice=choice)
    dull = primitives.of_each(lambda each: int(not isinstance(each.material, materials.Emissive))) > 0
    surfaces, areas = surfaces_of(primitives, first_triangles, dull, eye)[:2]
    surfaces, areas, _ = divided(surfaces, areas, _CELLS * areas / areas.sum())
    return VirtualLights(True, _ON, surfaces, areas, _by_chance(primitives, emitters, facts))


def _reason_against(scene: Scene, primitives: Primitives, facts: Mapping[str, int]) -> str | None:
    if scene.shutter.keys:
        return "keys that move while the shutter is open"
    if any(each.hidden & ~Hidden.FROM_CAMERA for each in primitives.prototypes):
        return "objects that are hidden from reflection or shadow"
    return next((reason for fact, reason in _WITHOUT.items() if facts[fact]), None)


def _nothing_to_do(scene: Scene, emitters: Emitters, facts: Mapping[str, int]) -> str | None:
    if not facts["HAS_MATTE"]:
        return "no matte surface"
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
_MOST_SHAPES, _MOST_LAMPS = 512, 16
_LEAST_CLOSED = 0.7  # of the ways on from what the camera sees that must end in the scene
_MOST_LIT = 0.3  # of the places where they end, that have a quarter of their mean direct light
_R3 = np.array([0.8191725134, 0.6710436067, 0.5497004779])  # a sequence that fills the unit cube evenly


def _gains_nothing(primitives: Primitives, emitters: Emitters, facts: Mapping[str, int], eye: Array) -> str | None:
    """Return why connections are not worth their time, None where they are.

    Paths need them where light comes by detours: where what surrounds the things that the camera sees is lit in few
    places, or where every way of a path is dear, as among meshes; and nowhere, if light leaves the scene.
    """
    if len(primitives) > _MOST_SHAPES:
        return "many objects"
    shapes = _Shapes(primitives, eye)
    across, along, turn = (np.arange(_RAYS)[:, None] * _R3 + 0.5).T % 1.0
    rays = _about(np.broadcast_to(np.array([0.0, 0.0, 1.0]), (_RAYS, 3)), 2 * across - 1, along)  # all round
    unseen = primitives.of_each(lambda each: each.hidden & Hidden.FROM_CAMERA) > 0
    places, facing, met = shapes.meet(np.zeros((_RAYS, 3)), rays, unseen)
    if not met.any():
        return "nothing in front of the camera"
    places, facing, turn, along = places[met], facing[met], turn[met], along[met]
    places, facing, closed = shapes.meet(places, _about(facing, np.sqrt(along), turn))
    if closed.mean() < _LEAST_CLOSED:
        return f"light leaves the scene: {closed.mean():.0%} of the ways on from what the eye sees end in it"
    places, facing, turn, along = places[closed], facing[closed], turn[closed], along[closed]
    light = _direct_light(places, facing, shapes, primitives, emitters)
    if facts["ENVIRONMENT"]:
        light += ~shapes.meet(places, _about(facing, np.sqrt(turn), along))[2] * max(float(light.mean()), 1.0)
    lit = float((light > 0.25 * light.mean()).mean())
    if lit > _MOST_LIT and not facts["HAS_MESH"]:
        return f"lamps light {lit:.0%} of what is around the things that the eye sees"
    return None


def _about(axes: Array, cosines: NDArray[Any], turns: NDArray[Any]) -> Array:
    """Return unit directions (n, 3) at such cosines to axes."""
    helper = np.where(np.abs(axes[:, :1]) < 0.9, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
    x = np.cross(axes, helper)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(axes, x)
    aside, angle = np.sqrt(np.maximum(1 - cosines**2, 0))[:, None], 2 * np.pi * turns[:, None]
    return np.asarray(cosines[:, None] * axes + aside * (np.cos(angle) * x + np.sin(angle) * y))


class _Shapes:
    """Flat shapes, spheres and boxes, and boxes about all others; of those, what a way starts in is not there.

    Nor is clear glass.
    """

    def __init__(self, primitives: Primitives, eye: Array) -> None:
        shapes = list(primitives)
        self._kinds = np.array([each.kind for each in shapes])
        inverse = np.linalg.inv(np.array([each.placement for each in shapes])).astype(np.float64)
        of_meshes = np.where(self._kinds == Kind.MESH, 1.0, 0.0)[:, None] * eye  # they stand about the scene
        inverse[:, :3, 3] += (inverse[:, :3, :3] @ of_meshes[:, :, None])[..., 0]
        self._inverse = inverse
        boxes = [BOXES[each.kind] if each.mesh is None else each.mesh.bounds() for each in shapes]
        self._low, self._high = np.array(boxes, np.float64).transpose(1, 0, 2)
        self._clear = np.array([is_clear(each.material) for each in shapes])

    def meet(
        self, origins: Array, ways: Array, without: int | NDArray[np.bool_] | None = None
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return the places that ways from origins (n, 3) meet first, the normals there towards them, and which do."""
        turn = self._inverse[:, None, :3, :3]
        o = (turn @ origins[None, :, :, None])[..., 0] + self._inverse[:, None, :3, 3]
        d = (turn @ ways[None, :, :, None])[..., 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            t, normal = self._distances(o, d)
        t = np.where(np.isfinite(t) & (t > 1e-6) & ~self._clear[:, None], t, np.inf)
        if without is not None:
            t[without] = np.inf
        first, each = t.argmin(axis=0), np.arange(len(origins))
        nearest = t[first, each]
        met = np.isfinite(nearest)
        out = (np.swapaxes(self._inverse[first, :3, :3], 1, 2) @ normal[first, each, :, None])[..., 0]
        out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-300)
        out *= -np.sign((out * ways).sum(axis=1, keepdims=True))
        return origins + np.where(met, nearest, 0.0)[:, None] * ways, out, met

    def _distances(self, o: Array, d: Array) -> tuple[Array, Array]:
        """Return where rays (shapes, n, 3) in the frames of shapes meet them, NaN or below 0 where they do not."""
        kinds = self._kinds[:, None]
        t = -o[..., 2] / d[..., 2]
        x, y = np.moveaxis(o[..., :2] + t[..., None] * d[..., :2], -1, 0)
        inside = np.where(kinds == Kind.DISK, x * x + y * y < 1, (x > 0) & (x < 1) & (y > 0) & (y < 1))
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
        box = ~ball & ~np.isin(self._kinds, (Kind.RECTANGLE, Kind.DISK))
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


def _direct_light(places: Array, normals: Array, shapes: _Shapes, primitives: Primitives, emitters: Emitters) -> Array:
    """Return the light of the middles of the brightest lamps at places (n, 3) that face normals, in no unit."""
    lamps = emitters.shining[emitters.shining["kind"] != EmitterKind.ENVIRONMENT]
    lamps = lamps[np.argsort(-lamps["pick"], kind="stable")[:_MOST_LAMPS]]
    light = np.zeros(len(places))
    if not len(lamps):
        return light
    sizes = np.where(np.isin(lamps["kind"], WITHOUT_SIZE), 1.0, lamp_sizes(primitives, lamps))
    strengths = sizes * luminance(lamps["radiance"][:, :3].astype(np.float64))
    for lamp, centre, strength in zip(lamps, lamp_centres(lamps), strengths, strict=True):
        afar = lamp["kind"] in (EmitterKind.SUN, EmitterKind.DIRECTIONAL)
        ways = np.broadcast_to(lamp["normal"][:3].astype(np.float64), places.shape) if afar else centre - places
        length = np.maximum(np.linalg.norm(ways, axis=1), 1e-9)
        met, _, blocked = shapes.meet(places, ways / length[:, None], int(lamp["primitive"]))
        if not afar:
            blocked &= np.linalg.norm(met - places, axis=1) < length
        cosine = np.maximum((normals * ways).sum(axis=1) / length, 0)
        light += np.where(blocked, 0.0, strength * cosine / (1.0 if afar else length**2))
    return light


# What is learned of a scene before its first sample, and the virtual lights of a pass.

MOST = 1 << 13  # virtual lights of a pass
SIDE = 8  # cells along the longest side of the scene
_FACINGS = 6
_SEED = 0x517CC1B727220A95  # parts the random numbers of light paths from those of camera paths
# Passes of what is learned: from lamps, from the eye, and again from lamps by what was learned.
_LEARNING, _LOOKING, _LEARNED_ONCE = 2**32 - 1, 2**32 - 2, 2**32 - 3
_LEARNING_PATHS, _ROUGH_PATHS = 1 << 15, 1 << 11
_LEARNING_SEED = 0  # whatever the seed of a render
_LEAST_PATHS, _MOST_PATHS = 1024, 1 << 16  # of a pass
_PATHS_PER_SAMPLE = 1 / 64  # and pixel of the whole film
_MOST_FOUND = 1 << 19  # places that the paths of a pass may meet
LIGHT_PATH_BYTES = 32 * (_MOST_FOUND + MOST)  # as found, and as picked
# Of starts, the share that follows what was learned, the rest goes by area; of importance, what cells count for that no
# path from the eye has met; of the bound, the share that is alike wherever the camera looks; the bound, in densities.
_LEARNED, _LEAST_IMPORTANCE, _ALIKE, _BOUND = 0.8, 0.05, 0.4, 2.0
_MOST_EDGES = 127
_FLOATS, _LIGHT, _NORMAL, _MARK = 8, slice(3, 6), 6, 7  # of a virtual light
_WAY_SHIFT = 24


class VirtualLightBuffers:
    """What the kernels read of virtual lights, as arguments by name; `current` says of which pass they are.

    `learned` is what is known of the scene, by the edges and number of light paths.
    """

    def __init__(self, session: Session) -> None:
        self.found = session.allocate(4 * _FLOATS * max(_MOST_FOUND, _MOST_EDGES * session.lanes))
        self.lights = session.allocate(4 * _FLOATS * MOST)
        self.density = session.allocate(4 * _FACINGS * SIDE**3)
        self.grid = session.upload(VIRTUAL_GRID.zeros(1))
        self.current: tuple[Any, ...] | None = None
        self.learned: dict[tuple[int, int], _Learned] = {}
        self.arguments = {
            "virtual_lights": self.lights, "virtual_density": self.density, "virtual_grid": self.grid,
        }  # fmt: skip


@dataclass(frozen=True)
class _Learned:
    """What is known of a scene.

    Attributes
    ----------
    curve : float32 array
        Picks among the surfaces where paths start.
    low, per_cell
        Corner of the grid [m], and 1 / width of its cells [1/m].
    importance : (cells,) array
        What a light of a cell and facing brings to the camera.
    density : (cells,) float32 array
        Bound of connections [1/m²].
    effective : float
        As how many paths of equal worth a path from there counts.
    """

    curve: Floats
    low: Floats
    per_cell: np.float32
    importance: Array
    density: Floats
    effective: float


class VirtualLightPool:
    """Traces the light paths of a pass when a sample needs them.

    Parameters
    ----------
    session
        The device.
    lights
        Where light paths start.
    facts
        Of the scene and its trees.
    scene : dict
        Arguments for ``SCENE_PARAMETERS``.
    buffers
        Where the virtual lights go.
    max_depth
        Longest path [edges].
    pixels
        Of the whole film, of which a crop or some tiles may be rendered.
    is_rough
        Whether fewer paths learn, for glances.
    """

    def __init__(
        self,
        session: Session,
        lights: VirtualLights,
        facts: Mapping[str, int],
        scene: dict[str, Any],
        buffers: VirtualLightBuffers,
        max_depth: int,
        pixels: int,
        *,
        is_rough: bool,
    ) -> None:
        self._session, self._lights, self._buffers, self._pixels = session, lights, buffers, pixels
        self._edges = min(max(max_depth - 2, 1), _MOST_EDGES)
        self._most_paths = max(1 << (_MOST_FOUND // self._edges).bit_length() - 1, session.lanes)
        paths, self._more = (_ROUGH_PATHS, 0.5) if is_rough else (_LEARNING_PATHS, 0.75)
        self._learning_paths = min(paths, self._most_paths)
        program = session.program(["pass/light_paths.cl"], {**facts, "VW": session.lanes}, layout.device_declarations())
        self._curve = session.upload(self._curve_of(lights.areas))
        self._launch = session.bind(
            program, "light_paths", **scene, surfaces=session.upload(lights.surfaces), surface_curve=self._curve,
            found=buffers.found, **{"pass": bytes(LIGHT_PASS.dtype.itemsize)},
        )  # fmt: skip

    def use(self, sample: int, seed: int) -> None:
        """Have the virtual lights in place that a sample sees."""
        seen = pass_of(sample)
        learning = self._edges, self._learning_paths
        key = (*learning, self._pixels, seed, seen.number)
        if self._buffers.current == key:
            return
        self._buffers.current = key
        if learning not in self._buffers.learned:
            self._buffers.learned[learning] = self._learn()
        learned = self._buffers.learned[learning]
        wanted = max(seen.samples * self._pixels * _PATHS_PER_SAMPLE, _LEAST_PATHS) / learned.effective**self._more
        count = min(1 << int(wanted).bit_length() - 1, _MOST_PATHS, self._most_paths)
        self._session.write(self._curve, learned.curve)
        lights = picked(self._trace(seen.number, count, seed), learned, layout.seed_words(seed ^ seen.number)[1])
        grid = VIRTUAL_GRID.one(low=(*learned.low, learned.per_cell), side=SIDE, count=max(len(lights), 1))
        self._session.write(self._buffers.grid, grid)
        self._session.write(self._buffers.density, learned.density)
        self._session.write(self._buffers.lights, lights if len(lights) else np.zeros((1, _FLOATS), np.float32))

    def _curve_of(self, shares: Array) -> Floats:
        return layout.curves(shares[None])[0].ravel()

    def _trace(self, number: int, count: int, seed: int, *, from_eye: bool = False) -> Floats:
        """Return the places of the paths of a pass, (8, edges, paths); those without a mark are none."""
        record = LIGHT_PASS.one(
            seed=layout.seed_words(seed ^ _SEED), number=number, paths=count,
            max_edges=self._edges, surfaces=len(self._lights.areas), from_eye=from_eye, per_path=1 / count,
            by_chance=self._lights.by_chance,
        )  # fmt: skip
        self._launch.set(**{"pass": record.tobytes()})
        self._launch.enqueue(count // self._session.lanes, self._session.group)
        found = self._session.read(self._buffers.found, np.float32, count * _FLOATS * self._edges)
        return found.reshape(_FLOATS, self._edges, count)

    def _learn(self) -> _Learned:
        """Learn from paths by area and from the eye where light paths should start and which virtual lights matter."""
        areas, count = self._lights.areas, self._learning_paths
        self._session.write(self._curve, self._curve_of(areas))
        paths = self._trace(_LEARNING, count, _LEARNING_SEED)
        seen = self._trace(_LOOKING, count, _LEARNING_SEED, from_eye=True)
        starts, found, met = paths[:, 0], _lights(paths), _lights(seen, first_edge=1)
        low, extent = starts[:3].min(axis=1), float(np.ptp(starts[:3], axis=1).max())
        grid = low, np.float32(SIDE * 0.999 / max(extent, 1e-9))
        cells = _FACINGS * SIDE**3
        # Either side of a surface has its area; few starts of a cell do not tell how little it is.
        one_side = np.bincount(cells_of(starts, *grid), minlength=cells).reshape(-1, 2, SIDE**3)
        area = np.maximum(np.maximum(one_side, one_side[:, ::-1]), 8).ravel() * (areas.sum() / count)
        cell, power = cells_of(found, *grid), _luminance(found)
        importance = np.bincount(cells_of(met, *grid), _luminance(met), cells) / area
        usual = float((importance[cell] * power).sum() / max(power.sum(), 1e-300))
        importance += _LEAST_IMPORTANCE * usual if usual > 0 else 1.0
        worth = power * importance[cell]
        light = np.bincount(cell, worth, cells)
        counts = importance > importance.min()
        alike = counts / max((counts * area).sum(), 1e-300)
        density = _BOUND * ((1 - _ALIKE) * light / max(light.sum(), 1e-300) / area + _ALIKE * alike)
        start_of = found[_MARK].view(np.int32) & (1 << _WAY_SHIFT) - 1
        gain = np.bincount(start_of, worth, len(areas))
        by_area = areas / areas.sum()
        shares = _LEARNED * gain / gain.sum() + (1 - _LEARNED) * by_area if gain.sum() > 0 else by_area
        curve = self._curve_of(shares)
        self._session.write(self._curve, curve)
        again = self._trace(_LEARNED_ONCE, min(_LEAST_PATHS, count), _LEARNING_SEED)
        brings, lit = np.zeros(again.shape[1:]), _lights(again)
        brings[again[_MARK].view(np.int32) >= 0] = _luminance(lit) * importance[cells_of(lit, *grid)]
        of_path = brings.sum(axis=0)
        effective = float(of_path.sum() ** 2 / max((of_path**2).sum(), 1e-300) / len(of_path))
        return _Learned(curve, *grid, importance, density.astype(np.float32), max(effective, 1 / len(of_path)))


def _lights(found: Floats, first_edge: int = 0) -> Floats:
    """Return those of the places of paths (8, edges, paths) that are virtual lights, (8, n)."""
    at = np.flatnonzero(found[_MARK, first_edge:].view(np.int32) >= 0) + first_edge * found.shape[2]
    return np.asarray(found.reshape(_FLOATS, -1).take(at, axis=1))


def _luminance(found: Floats) -> Array:
    return np.asarray(luminance(found[_LIGHT].T))


def cells_of(found: Floats, low: Floats, per_cell: np.float32) -> NDArray[np.int32]:
    """Return the cells of places by where they are and what they face, as `kernels/light/virtual_lights.h` has them."""
    x, y, z = (((places - least) * per_cell).astype(np.int32) for places, least in zip(found[:3], low, strict=True))
    x, y, z = (np.minimum(np.maximum(place, 0), SIDE - 1) for place in (x, y, z))
    nx, ny, nz = _unfolded(found[_NORMAL].view(np.int32))
    ax, ay, az = np.abs(nx), np.abs(ny), np.abs(nz)
    upright, deep = az > np.maximum(ax, ay), ay > ax
    facing = np.where(upright, 4, np.where(deep, 2, 0)) + (np.where(upright, nz, np.where(deep, ny, nx)) < 0)
    return np.asarray(((facing * SIDE + z) * SIDE + y) * SIDE + x)


def from_octahedral(packed: NDArray[np.int32]) -> Floats:
    """Return the unit vectors (n, 3) that `kernels/common/octahedral.h` packs."""
    vectors = np.stack(_unfolded(packed), axis=1)
    return np.asarray(vectors / np.sqrt((vectors * vectors).sum(axis=1, keepdims=True)))


def _unfolded(packed: NDArray[np.int32]) -> tuple[Floats, Floats, Floats]:
    """Return the components of the same, whose absolute values add up to 1."""
    halves = (packed & 0xFFFF, packed >> 16 & 0xFFFF)
    x, y = ((half.astype(np.float32) - np.float32(32767.5)) / np.float32(32767) for half in halves)
    ax, ay = np.abs(x), np.abs(y)
    z = 1 - ax - ay
    below = z < 0
    return np.where(below, np.copysign(1 - ay, x), x), np.where(below, np.copysign(1 - ax, y), y), z


def picked(found: Floats, learned: _Learned, word: int) -> Floats:
    """Return virtual lights that are alike in worth, sorted by place: picking one of them evenly is right on average.

    Resampled with even steps from a random start (systematic resampling), each by its power times the importance of its
    cell.
    """
    found = _lights(found)
    worth = _luminance(found) * learned.importance[cells_of(found, learned.low, learned.per_cell)]
    found, worth = found[:, worth > 0], worth[worth > 0]
    if not len(worth):
        return found.T
    order = np.argsort(_along_curve(found), kind="stable")
    sums = np.cumsum(worth[order])
    count = min(1 << (len(worth) - 1).bit_length(), MOST)
    steps = (np.arange(count) + (word + 0.5) / 2**32) * (sums[-1] / count)
    picks = order[np.minimum(np.searchsorted(sums, steps), len(worth) - 1)]
    lights: Floats = np.ascontiguousarray(found[:, picks].T)
    lights[:, _LIGHT] *= (sums[-1] / worth[picks]).astype(np.float32)[:, None]
    return lights


def _along_curve(found: Floats) -> NDArray[np.uint16]:
    """Return where places lie along a Morton curve, neighbours mostly near to each other."""
    low, extent = found[:3].min(axis=1, keepdims=True), float(np.ptp(found[:3], axis=1).max())
    x, y, z = _SPREAD[((found[:3] - low) * np.float32(31.99 / max(extent, 1e-9))).astype(np.int32)]
    return np.asarray(x | y << 1 | z << 2, np.uint16)


_SPREAD = np.array([sum((i >> bit & 1) << 3 * bit for bit in range(5)) for i in range(32)], np.uint16)
