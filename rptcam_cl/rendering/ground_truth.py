"""Sharp layers: what the chief ray of each pixel meets, and how it moves. They depend on the scene alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.cameras.chief_rays import CameraRays, seen_places
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.model import exposure_timing
from rptcam_cl.rendering.cameras.setting import on_film
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.layers import SharpHits, SharpPass
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.plan.primitives import object_frame
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.rendering.several import SHARP, array_of_text, text_of_array
from rptcam_cl.scene.camera import pose_matrix
from rptcam_cl.scene.film import SHARP_LAYERS, LayerName
from rptcam_cl.scene.load import at_opening
from rptcam_cl.scene.scene import Scene

#
# Optical flow: where the picture shows at another moment what it shows now, in float64.
#
# A pixel's moment is the middle of its own exposure. A point keeps its coordinates in the frame of its object, so
# flow follows what moves, camera and object alike, whether the point is seen at the other moment or hidden.

Array = NDArray[np.float64]
Indices = NDArray[np.int32]

_ROLLING_ROUNDS = 8  # in which a point is found on a rolling film, whose moment follows from the place
_SAME_PLACE = 1e-7  # pixels, where that search ends


@dataclass(frozen=True)
class Moments:
    """A scene, in focus, whose camera and objects are known at every moment."""

    scene: Scene

    @cached_property
    def chief(self) -> CameraRays:
        """The chief rays of its camera."""
        return camera_of(self.scene).chief_rays()

    @property
    def rolls(self) -> bool:
        """Whether pixels have moments of their own."""
        return self.scene.shutter.kind == "rolling"

    def middles(self, places: Array) -> Array:
        """Return the middle of the exposure (n,) of places (n, 2) of the film, on the clock of keyframes [s]."""
        open_s, start, per_column, per_row = exposure_timing(self.scene.shutter, self.scene.film.resolution)
        columns, rows = np.clip(np.nan_to_num(places), 0.5, np.array(self.scene.film.resolution) - 0.5).T - 0.5
        middle = self.scene.shutter.open_s + start + open_s / 2
        return np.asarray(middle + per_column * columns + per_row * rows)

    def poses(self, times: Array) -> Array:
        """Return the matrices (n, 4, 4) of the camera [m] at moments (n,)."""
        return _at_moments(times, self._pose)

    @cached_property
    def _on_film(self) -> Scene:
        return on_film(self.scene)

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
        places = seen_places(other.chief, in_camera, guess)
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


def ground_truth_of(
    scene: Scene,
    plan: Plan,
    session: Session,
    buffers: Callable[[], SceneBuffers],
    layers: tuple[LayerName, ...],
    neighbours: _Neighbours | None = None,
) -> GroundTruth | None:
    """Return the sharp layers among some layers of a scene in focus; None where there is none."""
    names = tuple(name for name in layers if name in SHARP_LAYERS)
    return GroundTruth(scene, names, plan, session, buffers, neighbours) if names else None
