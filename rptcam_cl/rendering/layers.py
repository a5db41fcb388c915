"""Auxiliary layers: planes of the samples and the pass that fills them, and sharp ones of each pixel's chief ray."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import Rows, dataclass
from rptcam_cl.core.records import WAVE, MaterialKind, device_declarations
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.cameras import chief_rays, kinds, model, setting
from rptcam_cl.rendering.film import FilmLayout, array_of_text, text_of_array
from rptcam_cl.rendering.plan.materials import lobes_of
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.plan.primitives import object_frame
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.scene.camera import pose_matrix
from rptcam_cl.scene.changes import at_opening
from rptcam_cl.scene.film import FILM_LAYERS, LAYER_NAMES, SHARP_LAYERS, LayerName
from rptcam_cl.scene.scene import Scene

# What given rays meet, one each: the ground of all layers that know no blur.

Array = NDArray[np.float64]
Indices = NDArray[np.int32]

GROUP = 4  # work items
MOST_RAYS = 1 << 20  # of a launch
NO_PRIMITIVE, PATH_ENDED, NO_TRIANGLE = -1, -2, -1  # as kernels have them
_MOST_SURFACES = 512  # that a ray is followed through


@dataclass(frozen=True)
class SharpHits(Rows):
    """What n rays meet.

    Attributes
    ----------
    points, normals : (n, 3) arrays
        Position about the eye when the shutter opens [m]; normal for shading, towards where the ray comes from. Nothing
        where nothing is met.
    primitives, triangles, objects, materials : (n,) arrays
        Identifiers; -1 for none.
    departures : (n, 3) array
        Where the ray goes on from beyond the surface [m].
    """

    points: Array
    normals: Array
    primitives: Indices
    triangles: Indices
    objects: Indices
    materials: Indices
    departures: Array

    @property
    def met(self) -> NDArray[np.bool_]:
        """Which rays meet something."""
        return np.asarray(self.primitives >= 0)


class SharpPass:
    """The pass that follows given rays to the first surface.

    Parameters
    ----------
    session, plan, buffers
        The device and the scene on it.
    """

    def __init__(self, session: Session, plan: Plan, buffers: SceneBuffers) -> None:
        self._session, self._scene = session, buffers.scene
        facts = plan.facts | buffers.tree_facts | {"VW": session.lanes, "SPECTRAL_COLOURS": 0, "HAS_DISPERSION": 0}
        self._program = session.program(["pass/sharp.cl"], facts, device_declarations())
        self._owners = session.upload(plan.owners.of_primitive)

    def hits(self, origins: Array, directions: Array, times: Array, since: SharpHits | None = None) -> SharpHits:
        """Trace rays to the first surface that they meet.

        Parameters
        ----------
        origins, directions : (n, 3) arrays
            About the eye when the shutter opens [m]; a ray with nan meets nothing.
        times : (n,) array
            Since then [s].
        since : SharpHits, optional
            Surfaces that the rays depart from; a ray that has met none meets nothing.
        """
        parts = [
            self._part(slice(low, low + MOST_RAYS), origins, directions, times, since)
            for low in range(0, len(origins), MOST_RAYS)
        ]
        return SharpHits.joined(parts)

    def all_hits(self, origins: Array, directions: Array, times: Array) -> list[SharpHits]:
        """Trace rays to the first surface, the second and so on, until none meets anything."""
        hits = [self.hits(origins, directions, times)]
        while hits[-1].met.any() and len(hits) < _MOST_SURFACES:
            hits.append(self.hits(hits[-1].departures, directions, times, hits[-1]))
        return hits

    def _part(self, part: slice, origins: Array, directions: Array, times: Array, since: SharpHits | None) -> SharpHits:
        session, count, group = self._session, len(origins[part]), GROUP * self._session.lanes
        capacity = -(-count // group) * group
        rays = np.zeros((7, capacity), np.float32)
        rays[5] = 1.0
        known = np.asarray(np.isfinite(origins[part] + directions[part]).all(axis=1))
        if since is not None:
            known &= since.met[part]
        for row, values in ((0, origins), (3, directions)):
            rays[row : row + 3, :count] = np.where(known, values[part].T, rays[row : row + 3, :count])
        rays[6, :count] = times[part]
        from_surface = np.full((2, capacity), PATH_ENDED, np.int32)
        from_surface[0, :count] = np.where(known, NO_PRIMITIVE if since is None else since.primitives[part], PATH_ENDED)
        from_surface[1, :count] = NO_TRIANGLE if since is None else since.triangles[part]
        points, hits = session.allocate(40 * capacity), session.allocate(16 * capacity)
        launch = session.bind(
            self._program, "sharp", **self._scene, owners=self._owners, rays=session.upload(rays),
            origins=session.upload(from_surface), points=points, hits=hits, capacity=np.uint32(capacity),
        )  # fmt: skip
        launch.enqueue(capacity // session.lanes, GROUP)
        session.finish()
        values = session.read(points, np.float32, 10 * capacity).reshape(10, capacity)[:, :count].astype(np.float64)
        owners = session.read(hits, np.int32, 4 * capacity).reshape(4, capacity)[:, :count].copy()
        return _facing(values, owners, directions[part])


def _facing(values: Array, owners: Indices, directions: Array) -> SharpHits:
    """Make hits of what the pass wrote, with normals that face where rays come from."""
    point, normal, own = (values[row : row + 3].T for row in (0, 3, 6))
    along = np.sum(own * np.nan_to_num(directions), axis=1)
    turn = np.where(along > 0, -1.0, 1.0)[:, None]
    departure = point + np.copysign(values[9], along)[:, None] * own
    met = (owners[0] >= 0)[:, None]
    primitives, triangles, objects, materials = owners
    return SharpHits(point, np.where(met, turn * normal, 0.0), primitives, triangles, objects, materials, departure)


# What rays lead to behind panes and by way of mirrors: the surface that a picture shows there.

_MOST_TURNS = 16  # polished surfaces that a ray is followed through
_MIRROR_ALPHA = 0.02  # GGX's alpha up to which a picture in a surface is one
MOSTLY = 0.5  # of the light: what a ray is followed by
_PASSED = (MaterialKind.DIELECTRIC, MaterialKind.THIN_GLASS)
_REFLECT = (MaterialKind.MIRROR, MaterialKind.CONDUCTOR, MaterialKind.METAL)


@dataclass(frozen=True)
class SeenEnds(Rows):
    """Where n rays end after all polished surfaces on their way.

    Attributes
    ----------
    points, directions : (n, 3) arrays
        End, about the eye when the shutter opens [m], and the unit direction in which it is reached.
    lengths : (n,) array
        Of the way [m]; infinite for a ray that ends nowhere.
    objects, first_objects : (n,) arrays
        The object at the end, and the first one on the way; -1 for none.
    lamps : (n,) array
        Whether the end shines by itself.
    panes, mirrors : (n,) arrays
        How many surfaces let the ray pass, and reflected it.
    """

    points: Array
    directions: Array
    lengths: Array
    objects: Indices
    first_objects: Indices
    lamps: NDArray[np.bool_]
    panes: Indices
    mirrors: Indices


def follow_rays(sharp: SharpPass, plan: Plan, origins: Array, directions: Array, times: Array) -> SeenEnds:
    """Follow rays, as `SharpPass.hits` takes them, to what is not polished; each goes where most of its light does."""
    count = len(origins)
    ends = SeenEnds(
        np.full((count, 3), np.nan), directions.copy(), np.zeros(count), np.full(count, -1, np.int32),
        np.full(count, -1, np.int32), np.zeros(count, np.bool_), np.zeros(count, np.int32), np.zeros(count, np.int32),
    )  # fmt: skip
    within = np.full(count, -1, np.int32)  # the transparent solid that a ray is in
    at, way, hits = origins, directions.copy(), None
    for _ in range(_MOST_TURNS):
        hits = sharp.hits(at, way, times, hits)
        on = hits.met
        ends.lengths[on] += np.linalg.norm(hits.points - at, axis=1)[on]
        ends.lengths[~on & np.isfinite(way).all(axis=1)] = np.inf
        new = on & (ends.first_objects < 0)
        ends.first_objects[new] = hits.objects[new]
        at, way = hits.departures.copy(), np.where(on[:, None], way, np.nan)
        material = np.where(on, plan.primitives["material"][np.maximum(hits.primitives, 0)], -1)
        for index in np.unique(material[on]).tolist():
            mine = np.flatnonzero(material == index)
            bounced, passed = _turn_rays(plan, index, hits, mine, way, within)
            at[bounced] = 2.0 * hits.points[bounced] - hits.departures[bounced]  # on this side of the surface
            ends.mirrors[bounced] += 1
            ends.panes[passed] += 1
            end = np.setdiff1d(mine, np.concatenate([bounced, passed]))
            ends.points[end], ends.directions[end], ends.objects[end] = hits.points[end], way[end], hits.objects[end]
            ends.lamps[end] = _shines(plan.materials[index])
            way[end] = np.nan
        if not np.isfinite(way).all(axis=1).any():
            break
    ends.lengths[np.isfinite(way).all(axis=1)] = np.inf  # lost between mirrors
    return ends


def _shines(record: np.void) -> bool:
    return int(record["kind"]) == MaterialKind.EMISSIVE or bool(record["glow"][:3].max() > 0)


def _turn_rays(
    plan: Plan, index: int, hits: SharpHits, mine: NDArray[np.intp], way: Array, within: Indices
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Turn the rays (`mine`) that meet a material; return those that it reflects and those that it lets pass."""
    none = np.zeros(0, np.intp)
    lobe = next((one for one in lobes_of(plan.materials, index) if _is_clear(one.record, one.share, one.coat)), None)
    if lobe is None or lobe.alpha > _MIRROR_ALPHA:
        return none, none
    kind, normals, along = MaterialKind(int(lobe.record["kind"])), hits.normals[mine], way[mine]
    cosine = np.clip(-np.sum(normals * along, axis=1), 1e-6, 1.0)
    passes = kind in _PASSED or lobe.record["transmission"] >= MOSTLY
    behind = within[mine] == hits.objects[mine]
    reflected = np.ones(len(mine), np.bool_)
    if passes:
        reflected = lobe.reflectance(cosine, behind).mean(axis=1) > MOSTLY
    way[mine] = np.where(reflected[:, None], along + 2.0 * cosine[:, None] * normals, along)
    if passes and kind is not MaterialKind.THIN_GLASS:
        ratio = np.where(behind, float(lobe.record["parameter"]), 1.0 / float(lobe.record["parameter"]))
        inside = np.sqrt(np.maximum(1.0 - ratio**2 * (1.0 - cosine**2), 0.0))
        bent = ratio[:, None] * along + (ratio * cosine - inside)[:, None] * normals
        through = mine[~reflected]
        way[through] = bent[~reflected] / np.linalg.norm(bent[~reflected], axis=1, keepdims=True)
        within[through] = np.where(behind[~reflected], -1, hits.objects[through])
    return mine[reflected], mine[~reflected]


def _is_clear(record: np.void, share: float, coat: bool) -> bool:
    """Whether a polished share of a surface shows what lies behind it or in it, rather than a paint."""
    kind = MaterialKind(int(record["kind"]))
    principled = kind is MaterialKind.PRINCIPLED and max(record["metallic"], record["transmission"]) >= MOSTLY
    return not coat and share >= MOSTLY and (kind in _PASSED or kind in _REFLECT or principled)


# Planes of each layer: means over the rays, and values of the first ray.
_MEANS: dict[LayerName, int] = {
    "depth": 1, "distance": 1, "position": 3, "normal": 3, "geometric_normal": 3, "albedo": 3, "coc": 1,
    "transmittance": 3,
}  # fmt: skip
_FIRSTS: dict[LayerName, int] = {"object_id": 1, "material_id": 1, "uv": 2, "pupil": 2}
_OWNERS: tuple[LayerName, ...] = ("crypto_object", "crypto_material")  # weights of each object or material apart
OWNER_SLOTS = 8  # of them in a pixel
SLOT_PLANES = 3  # identifier, weight and compensation
WEIGHTS = 2  # sums of the weights of rays that pass, and of those that hit something


class LayerPlanes:
    """Where the planes of some layers lie in their buffer.

    Attributes
    ----------
    sums : int
        Planes of sums; as many compensations follow them, then the firsts.
    places : dict
        First plane of a layer, among the sums or among the firsts.
    """

    def __init__(self, names: Sequence[LayerName]) -> None:
        self.names = tuple(name for name in names if name not in (*FILM_LAYERS, *SHARP_LAYERS))
        self.places: dict[LayerName, int] = {}
        self.sums, self.firsts = WEIGHTS, 0
        for name in self.names:
            if name in _MEANS:
                self.places[name] = self.sums
                self.sums += _MEANS[name]
            elif name in _FIRSTS:
                self.places[name] = self.firsts
                self.firsts += _FIRSTS[name]
            elif name in _OWNERS:
                self.places[name] = self.firsts
                self.firsts += OWNER_SLOTS * SLOT_PLANES

    @property
    def owners(self) -> tuple[LayerName, ...]:
        """The layers among them that keep owners apart."""
        return tuple(name for name in self.names if name in _OWNERS)

    @property
    def count(self) -> int:
        """Planes in all."""
        return 2 * self.sums + self.firsts

    @property
    def bytes_per_pixel(self) -> int:
        """Memory of the layers."""
        return 4 * self.count if self.names else 0

    @property
    def facts(self) -> dict[str, int]:
        """Facts for ``kernels/integrator/layers.h``."""
        known = (name for name in LAYER_NAMES if name not in SHARP_LAYERS)
        places = {f"LAYER_{name.upper()}": self.places.get(name, -1) for name in known}
        return places | {"LAYER_SUMS": self.sums, "OWNER_SLOTS": OWNER_SLOTS}


class LayerPass:
    """The pass that adds a wave's camera rays to the layers.

    Parameters
    ----------
    session, plan, layout, buffers
        Of the wavefront.
    planes
        The requested layers, at least one.
    lanes : int
        Per work item.
    state, tiles, capacity
        Buffer that the pass ``generate`` writes, list of tiles, and slots.
    stream : bool
        Whether it writes records for a stream.
    first : LayerPass or None
        Another one, whose layers it adds to.
    """

    def __init__(
        self,
        session: Session,
        plan: Plan,
        layout: FilmLayout,
        buffers: SceneBuffers,
        planes: LayerPlanes,
        *,
        lanes: int,
        state: Any,
        tiles: Any,
        capacity: int,
        stream: bool,
        first: LayerPass | None = None,
    ) -> None:
        self._session, self._layout, self._planes = session, layout, planes
        self._uploaded: dict[str, tuple[bytes, Any]] = {}
        facts = plan.facts | buffers.tree_facts | planes.facts | {"VW": lanes, "STREAM": int(stream)}
        facts |= {"SPECTRAL_COLOURS": 0, "HAS_DISPERSION": 0}  # layers are of no wavelength
        if "uv" in planes.names:
            facts["HAS_TEXTURE"] = 1  # compiles the coordinates of round shapes
        program = session.program(["pass/layers.cl"], facts, device_declarations())
        self._nbytes = planes.bytes_per_pixel * layout.pixels
        self._buffer: Any = session.allocate(self._nbytes, zeroed=True) if first is None else first._buffer
        self.launch = session.bind(
            program,
            "layers",
            **self._of_plan(plan, buffers),
            state=state,
            wave=bytes(WAVE.dtype.itemsize),
            seen=np.uint32(0),
            planes=self._buffer,
            capacity=np.uint32(capacity),
            pixels=np.uint32(layout.pixels),
            tiles=tiles,
        )

    def take_over(self, plan: Plan, buffers: SceneBuffers) -> None:
        """Add the rays of another plan, whose kernels are the same."""
        self.launch.set(**self._of_plan(plan, buffers))

    def _of_plan(self, plan: Plan, buffers: SceneBuffers) -> dict[str, Any]:
        """Return the arguments that a plan has."""
        self._eye_m = plan.eye_m
        self._steps = plan.media.steps if "transmittance" in self._planes.names else 1.0
        view, blur = plan.camera.view.packed(with_blur="coc" in self._planes.names)
        own = {"owners": plan.owners.of_primitive, "blur": blur, "view": view}
        for name, array in own.items():
            content = array.tobytes()
            if name not in self._uploaded or self._uploaded[name][0] != content:
                self._uploaded[name] = content, self._session.upload(array)
        return {
            **buffers.scene,
            **{name: self._uploaded[name][1] for name in own},
            "camera": buffers.camera["camera"],
            **(buffers.trajectory if plan.facts["CAMERA_SEGMENTS"] else {}),
        }

    @property
    def as_guides(self) -> dict[str, Any]:
        """The arguments of the kernel ``guides`` that say where its layers lie."""
        places = [self._planes.places[name] for name in GUIDES]
        return {
            "layers": self._buffer, "places": np.array([*places, 0], np.uint32).tobytes(),
            "sums": np.uint32(self._planes.sums), "pixels": np.uint32(self._layout.pixels),
        }  # fmt: skip

    def set_wave(self, wave: bytes, seen: int) -> None:
        """Choose the wave whose rays are added next, and how many of its samples count."""
        self.launch.set(wave=wave, seen=np.uint32(seen))
        self.launch.steps = max(self._steps * seen, 1.0)

    def clear(self) -> None:
        """Empty the layers."""
        self._session.fill_zero(self._buffer, self._nbytes)

    def planes(self) -> NDArray[np.float32]:
        """Return the content of the buffer, (planes, pixels)."""
        planes = self._session.read(self._buffer, np.float32, self._planes.count * self._layout.pixels)
        return planes.reshape(self._planes.count, -1)

    def restore(self, planes: NDArray[np.float32]) -> None:
        """Put back what `planes` returned."""
        self._session.write(self._buffer, np.ascontiguousarray(planes, np.float32))

    def arrays(self, planes: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
        """Return the layers of such planes by name, (height, width) or (height, width, channels)."""
        return layer_arrays(self._planes, self._layout.in_rows(planes), self._eye_m)


def layer_arrays(planes: LayerPlanes, values: NDArray[np.float32], eye_m: Array) -> dict[str, NDArray[Any]]:
    """Make every layer by name of the planes on the host.

    Parameters
    ----------
    planes
        Which layers.
    values : (planes, height, width) array
        Content of the buffer.
    eye_m : (3,) array
        Position of the eye in the scene [m].
    """
    firsts = values[2 * planes.sums :]
    sums = values[: planes.sums].astype(np.float64) - values[planes.sums : 2 * planes.sums]
    passed, hits = sums[:WEIGHTS]

    def mean(name: LayerName, weight: Array, background: float) -> Array:
        place = planes.places[name]
        ratio = sums[place : place + _MEANS[name]] / _divisor(weight)
        return np.moveaxis(np.where(weight > 0, ratio, background), 0, -1)

    def first(name: LayerName) -> NDArray[np.float32]:
        place = planes.places[name]
        return np.ascontiguousarray(np.moveaxis(firsts[place : place + _FIRSTS[name]], 0, -1))

    def layer(name: LayerName) -> NDArray[Any]:
        match name:
            case "coverage":
                return np.where(passed > 0, hits / _divisor(passed), 0.0).astype(np.float32)
            case "depth" | "distance":
                return mean(name, hits, np.inf)[..., 0].astype(np.float32)
            case "coc":
                return mean(name, passed, np.nan)[..., 0].astype(np.float32)
            case "transmittance":
                return mean(name, passed, np.nan).astype(np.float32)
            case "position":
                return mean(name, hits, np.nan) + eye_m
            case "normal" | "geometric_normal":
                normals = mean(name, hits, 0.0)
                return np.asarray(normals / _divisor(np.linalg.norm(normals, axis=-1, keepdims=True)), np.float32)
            case "albedo":
                return mean(name, hits, 0.0).astype(np.float32)
            case "object_id" | "material_id":
                return np.where(passed > 0, first(name)[..., 0].view(np.int32), -1)
            case "crypto_object" | "crypto_material":
                place = planes.places[name]
                return _coverages(firsts[place : place + OWNER_SLOTS * SLOT_PLANES], passed)
            case "uv" | "pupil":
                return np.where((passed > 0)[..., None], first(name), np.nan)
            case _:
                raise AssertionError(f"{name} has no planes")

    return {name: np.ascontiguousarray(layer(name)) for name in planes.names}


def _coverages(planes: NDArray[np.float32], passed: Array) -> Array:
    """Return identifier and coverage of each owner, (height, width, slots, 2); no coverage where there is none."""
    slots = planes.reshape(OWNER_SLOTS, SLOT_PLANES, *passed.shape)
    weights = np.maximum(slots[:, 1].astype(np.float64) - slots[:, 2], 0.0)
    identifiers = np.ascontiguousarray(slots[:, 0]).view(np.int32)
    pairs = np.stack([identifiers, weights / _divisor(passed)], axis=-1)
    return np.ascontiguousarray(np.moveaxis(pairs, 0, 2))


def _divisor(weight: Array) -> Array:
    return np.where(weight > 0, weight, 1.0)


GUIDES: tuple[LayerName, ...] = ("albedo", "normal", "position")


#
# Sharp layers: what the chief ray of each pixel meets, and how it moves. They depend on the scene alone.
#
# Optical flow is where the picture shows at another moment what it shows now, in float64.
#
# A pixel's moment is the middle of its own exposure. A point keeps its coordinates in the frame of its object, so
# flow follows what moves, camera and object alike, whether the point is seen at the other moment or hidden.

_ROLLING_ROUNDS = 8  # in which a point is found on a rolling film, whose moment follows from the place
_SAME_PLACE = 1e-7  # pixels, where that search ends


@dataclass(frozen=True)
class Moments:
    """A scene, in focus, whose camera and objects are known at every moment."""

    scene: Scene

    @cached_property
    def chief(self) -> chief_rays.CameraRays:
        """The chief rays of its camera."""
        return kinds.camera_of(self.scene).chief_rays()

    @property
    def rolls(self) -> bool:
        """Whether pixels have moments of their own."""
        return self.scene.shutter.kind == "rolling"

    def middles(self, places: Array) -> Array:
        """Return the middle of the exposure (n,) of places (n, 2) of the film, on the clock of keyframes [s]."""
        open_s, start, per_column, per_row = model.exposure_timing(self.scene.shutter, self.scene.film.resolution)
        columns, rows = np.clip(np.nan_to_num(places), 0.5, np.array(self.scene.film.resolution) - 0.5).T - 0.5
        middle = self.scene.shutter.open_s + start + open_s / 2
        return np.asarray(middle + per_column * columns + per_row * rows)

    def poses(self, times: Array) -> Array:
        """Return the matrices (n, 4, 4) of the camera [m] at moments (n,)."""
        return _at_moments(times, self._pose)

    @cached_property
    def _on_film(self) -> Scene:
        return setting.on_film(self.scene)

    def _pose(self, time_s: float) -> Array:
        matrix = pose_matrix(self._on_film.camera.pose_at(time_s))
        matrix[:3, 3] *= self.scene.metres_per_unit
        return matrix

    def frames(self, objects: Indices, times: Array) -> Array:
        """Return the matrices (n, 4, 4) of the frames of objects [scene units] at moments (n,); unity for none."""
        matrices = np.tile(np.eye(4), (len(objects), 1, 1))
        for index in np.unique(objects[objects >= 0]).tolist():
            mine, item = objects == index, self.scene.objects[index]
            if item.motion:
                matrices[mine] = _at_moments(times[mine], partial(object_frame, item))
            else:
                matrices[mine] = object_frame(item, 0.0)
        return matrices

    def kind_of(self, index: int) -> str | None:
        """Return the shape of an object; None where there is no such object."""
        return self.scene.objects[index].shape if index < len(self.scene.objects) else None


def object_at(scene: Scene, plan: Plan, session: Session, x: float, y: float) -> int | None:
    """Return the index of the object that the chief ray of a place meets first; None where it meets none.

    Parameters
    ----------
    scene
        In focus.
    plan
        Of the scene; only its geometry counts.
    x, y
        From the left and the top edge of the picture, 0 to 1.
    """
    moments = Moments(at_opening(scene))
    places = np.array([[x, y]]) * scene.film.resolution
    times = moments.middles(places)
    pose = moments.poses(times)[0]
    origins, directions = (each @ pose[:3, :3].T for each in moments.chief.rays(places))
    sharp = SharpPass(session, plan, SceneBuffers(session, plan))
    hits = sharp.hits(origins + pose[:3, 3] - plan.eye_m, directions, times - scene.shutter.open_s)
    return int(hits.objects[0]) if hits.met[0] else None


def _at_moments(times: Array, matrix: Callable[[float], Array]) -> Array:
    unique, place = np.unique(times, return_inverse=True)
    matrices: Array = np.stack([matrix(time) for time in unique.tolist()]) if len(unique) else np.zeros((0, 4, 4))
    return matrices[place.reshape(-1)]


_Neighbours = tuple[Scene | None, Scene | None]
SHARP = "sharp:"  # begins the names of their arrays
_SAID = "truth_said"  # name of the array with what metadata should say


@dataclass(frozen=True)
class GroundTruth:
    """The sharp layers of a scene in focus.

    Attributes
    ----------
    scene : Scene
    names : tuple of str
        The layers.
    plan, session
    buffers : callable
        Returns the scene on the device.
    neighbours : (before, after) or None
        The frames that flow leads to, in focus, None where there is none; without them it leads to the opening and the
        closing of the shutter.
    """

    scene: Scene
    names: tuple[LayerName, ...]
    plan: Plan
    session: Session
    buffers: Callable[[], SceneBuffers]
    neighbours: _Neighbours | None = None

    @cached_property
    def result(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """The layers by name, and what metadata should say."""
        layout = FilmLayout.of(self.scene.film)
        shape = layout.height, layout.width
        flat = {name: self._layers[name]() for name in self.names}
        layers: dict[str, NDArray[Any]] = {}
        for name, each in flat.items():
            layers[name] = np.ascontiguousarray(each.reshape(*shape, *each.shape[1:]))
        said: dict[str, Any] = {}
        if "occlusion" in self.names:
            said["occlusion"] = [None if np.isnan(share) else share for share in self._hidden.tolist()]
        if "sharp_class_id" in self.names:
            said |= _classes_of(self.scene)
        return layers, said

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of a saved part by which `merge` has the layers without the scene."""
        layers, said = self.result
        layout = FilmLayout.of(self.scene.film)
        return {f"{SHARP}{name}": layout.in_tiles(each) for name, each in layers.items()} | {_SAID: array_of_text(said)}

    @cached_property
    def _layers(self) -> dict[LayerName, Callable[[], NDArray[Any]]]:
        return {
            "sharp_depth": lambda: self._depth.astype(np.float32),
            "pupil_depth": self._pupil_depth,
            "sharp_position": lambda: np.where(self._met, self._points[:, :3], np.nan),
            "sharp_normal": lambda: self._hits.normals.astype(np.float32),
            "sharp_object_id": lambda: self._hits.objects,
            "sharp_material_id": lambda: self._hits.materials,
            "sharp_class_id": self._classes,
            "occlusion": lambda: np.append(self._hidden, np.nan)[self._hits.objects].astype(np.float32),
            "flow_forward": lambda: self._flow(1).astype(np.float32),
            "flow_backward": lambda: self._flow(0).astype(np.float32),
            "motion": self._motion,
            "ray_origin": lambda: self._rays[0],
            "ray_direction": lambda: self._rays[1],
        }

    @cached_property
    def _moments(self) -> Moments:
        return Moments(self.scene)

    @cached_property
    def _places(self) -> Array:
        """The middles of the pixels that are rendered."""
        layout = FilmLayout.of(self.scene.film)
        columns, rows = np.arange(layout.width) + layout.x + 0.5, np.arange(layout.height) + layout.y + 0.5
        return np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)

    @cached_property
    def _times(self) -> Array:
        return self._moments.middles(self._places)

    @cached_property
    def _poses(self) -> Array:
        return self._moments.poses(self._times)

    @cached_property
    def _rays(self) -> tuple[Array, Array]:
        """Origins in the scene [m] and directions."""
        origins, directions = self._moments.chief.rays(self._places)
        turns = self._poses[:, :3, :3]
        turned = (np.einsum("nij,nj->ni", turns, each) for each in (origins, directions))
        return next(turned) + self._poses[:, :3, 3], next(turned)

    @cached_property
    def _pass(self) -> SharpPass:
        return SharpPass(self.session, self.plan, self.buffers())

    @property
    def _of_device(self) -> tuple[Array, Array, Array]:
        """The rays as the device takes them: about the eye, and since the shutter opens."""
        origins, directions = self._rays
        return origins - self.plan.eye_m, directions, self._times - self.scene.shutter.open_s

    @cached_property
    def _all_hits(self) -> list[SharpHits]:
        return self._pass.all_hits(*self._of_device)

    @cached_property
    def _hits(self) -> SharpHits:
        followed = "occlusion" in self.names and self.scene.film.crop is None
        return self._all_hits[0] if followed else self._pass.hits(*self._of_device)

    @property
    def _met(self) -> NDArray[np.bool_]:
        return self._hits.met[:, None]

    @cached_property
    def _points(self) -> Array:
        """What is seen, homogeneous in the scene [m]: points, and directions where nothing is met."""
        far = np.hstack([self._rays[1], np.zeros((len(self._places), 1))])
        origins, directions = self._rays
        away = self._hits.points + self.plan.eye_m - origins  # beside the ray by the rounding of float32
        lengths = np.einsum("ni,ni->n", away, directions)
        near = np.hstack([origins + lengths[:, None] * directions, np.ones((len(self._places), 1))])
        return np.where(self._met, near, far)

    @cached_property
    def _depth(self) -> Array:
        away = self._points[:, :3] - self._poses[:, :3, 3]
        depth = -np.einsum("ni,ni->n", away, self._poses[:, :3, 2])
        return np.where(self._hits.met, depth, np.inf)

    def _pupil_depth(self) -> NDArray[np.float32]:
        """Return depths from the entrance pupil; nan where that is infinitely far away."""
        ahead_mm = self.plan.camera.metadata.get("entrance_pupil", {}).get("ahead_of_eye_mm", 0.0)
        return (self._depth - (np.nan if ahead_mm is None else ahead_mm * 1e-3)).astype(np.float32)

    def _classes(self) -> NDArray[np.int32]:
        of_object = np.array([*_classes_of(self.scene)["object_classes"], 0], np.int32)  # the last for nothing
        return np.asarray(of_object[self._hits.objects])

    @cached_property
    def _hidden(self) -> Array:
        """The share of each object's pixels, of the whole film, that others hide; nan where it has none."""
        if self.scene.film.crop is not None:
            film = self.scene.film.model_copy(update={"crop": None})
            return replace(self, scene=self.scene.model_copy(update={"film": film}))._hidden
        count = len(self.scene.objects)
        seen = np.bincount(self._hits.objects[self._hits.met], minlength=count)
        rows = [np.stack([np.flatnonzero(hits.met), hits.objects[hits.met]], axis=1) for hits in self._all_hits]
        pairs = np.unique(np.concatenate(rows), axis=0)
        whole = np.bincount(pairs[:, 1], minlength=count)
        with np.errstate(invalid="ignore"):
            return np.asarray(1.0 - seen / whole)

    def _places_in(self, other: Moments, times: Array, guess: Array) -> Array:
        """Return where another picture shows at moments (n,) what this one shows; ``guess`` is near there [pixels]."""
        unit, there = self.scene.metres_per_unit, other.scene.metres_per_unit
        points, shown = self._points.copy(), self._hits.objects
        on = shown >= 0
        lacks = [k for k in np.unique(shown[on]).tolist() if self._moments.kind_of(k) != other.kind_of(k)]
        lost = np.isin(shown, lacks)
        on &= ~lost
        objects = shown[on]
        own = np.linalg.inv(self._moments.frames(objects, self._times[on]))
        scaled = points[on] * np.array([1 / unit, 1 / unit, 1 / unit, 1.0])
        new = np.einsum("nij,njk,nk->ni", other.frames(objects, times[on]), own, scaled)
        points[on] = new * np.array([there, there, there, 1.0])
        in_camera = np.einsum("nij,nj->ni", np.linalg.inv(other.poses(times)), points)
        places = chief_rays.seen_places(other.chief, in_camera, guess)
        places[lost] = np.nan
        return places

    def _way(self, places: Array) -> Array:
        """Return the way (n, 2) of what is seen, right and down, to other places [pixels]."""
        way = places - self._places
        if self._moments.chief.wraps:
            width = self.scene.film.resolution[0]
            way[:, 0] -= width * np.round(way[:, 0] / width)
        return way

    @cached_property
    def _over_shutter(self) -> tuple[Array, Array]:
        """The ways to the opening and to the closing of the shutter of each pixel."""
        half = self.scene.shutter.time_s / 2
        opening, closing = (self._places_in(self._moments, self._times + off, self._places) for off in (-half, half))
        return self._way(opening), self._way(closing)

    def _flow(self, side: int) -> Array:
        """Return the way to where a neighbour shows what is seen.

        nan where it does not: behind the camera, beside the field of its lens, or of an object that is not there.
        """
        if self.neighbours is None:
            return self._over_shutter[side]
        if (neighbour := self.neighbours[side]) is None:
            return np.full((len(self._places), 2), np.nan)
        other = Moments(neighbour)
        places = self._places_in(other, other.middles(self._places), self._places)
        for _ in range(_ROLLING_ROUNDS if other.rolls else 0):
            before = places
            places = self._places_in(other, other.middles(before), np.where(np.isfinite(before), before, self._places))
            if np.nanmax(np.abs(places - before), initial=0.0) < _SAME_PLACE:
                break
        return self._way(places)

    def _motion(self) -> NDArray[np.float32]:
        opening, closing = self._over_shutter
        return (closing - opening).astype(np.float32)


def saved_truth(
    arrays: Mapping[str, NDArray[Any]], layout: FilmLayout
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the sharp layers that `GroundTruth.arrays` is of, and what metadata should say.

    Raises
    ------
    ValueError
        They do not fit together.
    """
    layers = {}
    for name, planes in arrays.items():
        if name.startswith(SHARP):
            rows = np.moveaxis(layout.in_rows(planes), 0, -1)
            layers[name.removeprefix(SHARP)] = np.ascontiguousarray(rows if len(planes) > 1 else rows[..., 0])
    return layers, text_of_array(arrays[_SAID]) if _SAID in arrays else {}


def _classes_of(scene: Scene) -> dict[str, Any]:
    """Return the names of the classes that objects are labelled with, what has none first, and the class of each."""
    names = list(dict.fromkeys(["", *(item.label or "" for item in scene.objects)]))
    return {"class_names": names, "object_classes": [names.index(item.label or "") for item in scene.objects]}
