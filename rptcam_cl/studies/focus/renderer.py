"""The probes of a search: zones of the film seen through the scene's camera in any focus state, and measured.

Programs, trees and textures are made once; a probe replaces the camera's records and nothing else.
"""

from __future__ import annotations

import math
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import checkpoint, is_cancellable
from rptcam_cl.device.session import Session
from rptcam_cl.imaging.development import binned_exposure, pixel_area_m2, sensor_of
from rptcam_cl.rendering.account import resolve_exposure
from rptcam_cl.rendering.cameras.film_pupil import PupilRays
from rptcam_cl.rendering.cameras.model import CameraModel, exposed
from rptcam_cl.rendering.film import PLANES, TILE, FilmLayout
from rptcam_cl.rendering.layers import Moments, SeenEnds, SharpPass, follow_rays
from rptcam_cl.rendering.plan.plan import Plan, make_plan
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.changes import at_opening, change_scene
from rptcam_cl.scene.exposure import Exposure
from rptcam_cl.scene.lights import ConstantEnvironment
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.drives import Drive, focus_drive
from rptcam_cl.studies.focus.probe import (
    BEST,
    MEASURES,
    FocusReport,
    Measure,
    NoContrast,
    Policy,
    Probe,
    ProbeRecord,
    Zone,
    ZoneImage,
    circle_of_confusion,
    rich_part,
)

_SMALL_WAVE = 1 << 14  # slots, of work that may be given up: so few hold up nothing else on the device


def _take_samples(wavefront: Wavefront, samples: int) -> None:
    """Take samples of every pixel; where they may be given up, the queue of the device is kept short."""
    for wave in wavefront.waves(0, samples):
        wavefront.enqueue(*wave)
        if is_cancellable():
            wavefront.finish()
            checkpoint()
    wavefront.finish()


PARTS = 4  # independent pictures that a probe consists of
_MOST_WHITE, _MOST_NOISE = 0.5, 1.0  # share of white pixels, and noise over light, that are worth a word
_FEWEST_PIXELS = 40  # across the shorter side of a zone, if its pixels then are not smaller than
ACROSS = 240  # pixels of the picture in which objects are sought
WHOLE = Zone(0.0, 1.0, 0.0, 1.0)
FINEST, COARSEST = 0.5, 1.5  # circles of confusion
Ranges = tuple[int, int, int, int]  # columns and rows: first, behind the last, first, behind the last


@dataclass(frozen=True)
class ZoneView:
    """Zones on a film whose pixels suit them.

    Attributes
    ----------
    scene : Scene
        With that film.
    zones : tuple of Zone
    margin : (across, down)
        Pixels to show beyond each zone.
    """

    scene: Scene
    zones: tuple[Zone, ...]
    margin: tuple[int, int]

    @classmethod
    def of(cls, scene: Scene, zones: tuple[Zone, ...], margin: tuple[int, int]) -> ZoneView:
        """Return a view of zones of a scene, with pixels that suit the circle of confusion and the smallest zone."""
        film = scene.film
        size_mm = tuple(side * 1e3 for side in film.size_m())
        sides = [((z.right - z.left) * size_mm[0], (z.bottom - z.top) * size_mm[1]) for z in zones]
        circle = circle_of_confusion(scene)
        pixel = min(max(min(min(pair) for pair in sides) / _FEWEST_PIXELS, FINEST * circle), COARSEST * circle)
        columns, rows = (max(round(side / pixel), 1) for side in size_mm)
        seen = change_scene(scene, film=film.whole_in((columns, rows)), render={"layers": (), "noise": None})
        # measures take the mean off anyway, so the exposure does not matter
        return cls(seen.model_copy(update={"exposure": Exposure()}), zones, margin)

    @property
    def resolution(self) -> tuple[int, int]:
        """Width and height of the whole film [pixels]."""
        return self.scene.film.resolution

    @cached_property
    def layout(self) -> FilmLayout:
        """The part of the film that holds all zones."""
        width, height = self.resolution
        corners = np.array([self.shown(zone) for zone in self.zones])
        (x0, _, y0, _), (_, x1, _, y1) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        return FilmLayout(width, height, x0, y0, x1 - x0, y1 - y0)

    def pixels_of(self, zone: Zone) -> Ranges:
        """Return the columns and rows of a zone."""
        width, height = self.resolution
        x0, y0 = min(math.floor(zone.left * width), width - 1), min(math.floor(zone.top * height), height - 1)
        return x0, max(math.ceil(zone.right * width), x0 + 1), y0, max(math.ceil(zone.bottom * height), y0 + 1)

    def shown(self, zone: Zone) -> Ranges:
        """Return the columns and rows of a zone with the margin, as far as the film goes."""
        (width, height), (across, down) = self.resolution, self.margin
        x0, x1, y0, y1 = self.pixels_of(zone)
        return max(x0 - across, 0), min(x1 + across, width), max(y0 - down, 0), min(y1 + down, height)

    def shown_zones(self) -> list[Zone]:
        """Return the zones with their margins."""
        width, height = self.resolution
        shown = [self.shown(zone) for zone in self.zones]
        return [Zone(x0 / width, x1 / width, y0 / height, y1 / height) for x0, x1, y0, y1 in shown]

    def margins(self, zone: Zone) -> Ranges:
        """Return how many pixels are shown beyond a zone: left, right, above, below."""
        (x0, x1, y0, y1), (left, right, top, bottom) = self.pixels_of(zone), self.shown(zone)
        return x0 - left, right - x1, y0 - top, bottom - y1

    def in_layout(self, ranges: Ranges) -> tuple[slice, slice]:
        """Return where some columns and rows lie in an array (height, width) of the layout."""
        (x0, x1, y0, y1), x, y = ranges, self.layout.x, self.layout.y
        return slice(y0 - y, y1 - y), slice(x0 - x, x1 - x)

    def samples_in(self, samples: int) -> int:
        """Return how many samples per pixel so many of all pixels shown are, at least one of each part."""
        shown = map(self.shown, self.zones)
        return max(samples // sum((x1 - x0) * (y1 - y0) for x0, x1, y0, y1 in shown), PARTS)

    def tiles(self) -> NDArray[np.uint32]:
        """Return the tiles of the layout that zones touch."""
        layout = self.layout
        touched = np.zeros((-(-layout.height // TILE), layout.tiles_across), np.bool_)
        for zone in self.zones:
            x0, x1, y0, y1 = self.shown(zone)
            rows = slice((y0 - layout.y) // TILE, (y1 - layout.y - 1) // TILE + 1)
            touched[rows, (x0 - layout.x) // TILE : (x1 - layout.x - 1) // TILE + 1] = True
        return np.flatnonzero(touched).astype(np.uint32)

    def scaled(self, scale: float) -> Scene:
        """Return the scene with the film scaled."""
        width, height = self.scene.film.size_m()
        film = self.scene.film.model_copy(update={"size_mm": (width * 1e3 * scale, height * 1e3 * scale)})
        return self.scene.model_copy(update={"film": film})


# What chief rays of a zone show: how far away it seems to lie, through panes and by mirrors.

SIGHT_ACROSS = 16  # places of a zone, across and down
ALIKE = 0.2  # depths of focus between states in which places show the same: the image grows by less than their step
_BESIDE_M = 1e-3  # between the rays whose difference tells how far away something seems to be
_BESIDE_RAD = 1e-3
Follow = Callable[[NDArray[np.float64], NDArray[np.float64], Any], SeenEnds]


@dataclass(frozen=True)
class Sight:
    """What n places of a zone show.

    Attributes
    ----------
    depths : (n,) array
        How far from the film along the axis it seems to lie [m]; infinite for nothing, nan for places without light.
    objects, first_objects : (n,) arrays
        What is seen, and what it is seen through or in where these differ; -1 for nothing.
    lamps, panes, mirrors : (n,) bool arrays
        Whether it shines by itself, is seen through glass, and in a mirror.
    """

    depths: NDArray[np.float64]
    objects: NDArray[np.int32]
    first_objects: NDArray[np.int32]
    lamps: NDArray[np.bool_]
    panes: NDArray[np.bool_]
    mirrors: NDArray[np.bool_]


def sight_of(origins: NDArray[np.float64], directions: NDArray[np.float64], follow: Follow) -> Sight:
    """Find what some chief rays show.

    Parameters
    ----------
    origins, directions : (n, 3) arrays
        In the camera's frame [m].
    follow
        Returns where rays end that belong to some of them, by index.
    """
    every = np.arange(len(origins))
    ends = follow(origins, directions, every)
    apart = ends.lengths.copy()
    turned = np.flatnonzero((ends.panes + ends.mirrors > 0) & np.isfinite(ends.lengths))
    if len(turned):
        apart[turned] = _distances_apart(origins[turned], directions[turned], ends[turned], turned, follow)
    depths = np.full(len(origins), np.inf)
    met = np.isfinite(apart)
    depths[met] = -(origins[met, 2] + apart[met] * directions[met, 2])
    depths[~np.isfinite(directions).all(axis=1)] = np.nan
    return Sight(depths, ends.objects, ends.first_objects, ends.lamps, ends.panes > 0, ends.mirrors > 0)


def _distances_apart(
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    ends: SeenEnds,
    rays: NDArray[np.intp],
    follow: Follow,
) -> NDArray[np.float64]:
    """Return how far away the ends of rays seem to be, by rays beside them: curved glass and mirrors change it.

    A shift x of the ray's start moves its end by B x, and a turn w by A w: seen from beside, the end lies in the
    direction -A^-1 B x, which is -x / D at a distance of D. What passed other surfaces than the ray counts by the way.
    """
    first = np.cross(directions, np.where(np.abs(directions[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    sides = first, np.cross(directions, first)
    across = np.cross(ends.directions, np.where(np.abs(ends.directions[:, :1]) < 0.9, [1.0, 0, 0], [0, 1.0, 0]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    frame = np.stack([across, np.cross(ends.directions, across)], axis=1)
    steps = [(shift * side, turn * side) for shift, turn in ((_BESIDE_M, 0.0), (0.0, _BESIDE_RAD)) for side in sides]
    starts, ways = (np.concatenate(each) for each in zip(
        *((origins + shift, directions + turn) for shift, turn in steps), strict=True))  # fmt: skip
    every = follow(starts, ways, np.tile(rays, len(steps)))
    moved, alike = [], np.ones(len(rays), np.bool_)
    for first_row in range(0, len(every), len(rays)):
        beside = every[first_row : first_row + len(rays)]
        away = beside.points - ends.points
        step = np.sum(away * ends.directions, axis=1) / np.sum(beside.directions * ends.directions, axis=1)
        moved.append(np.einsum("nij,nj->ni", frame, away - step[:, None] * beside.directions))
        alike &= (beside.panes == ends.panes) & (beside.mirrors == ends.mirrors) & np.isfinite(beside.lengths)
    shifted, turned = np.stack(moved[:2], axis=2) / _BESIDE_M, np.stack(moved[2:], axis=2) / _BESIDE_RAD
    alike &= np.abs(np.linalg.det(np.where(np.isfinite(turned), turned, 0.0))) > 0
    vergence = 1.0 / ends.lengths
    vergence[alike] = np.trace(np.linalg.solve(turned[alike], shifted[alike]), axis1=1, axis2=2) / 2
    return np.where(vergence > 0, 1.0 / np.where(vergence > 0, vergence, 1.0), np.inf)


class ProbeRenderer:
    """A camera of a scene on a device, to be probed in any focus state.

    The zones are rendered with pixels that suit the circle of confusion, whatever the resolution of the picture.

    Parameters
    ----------
    scene
        Its camera must be one that has a focus.
    session
        The device.
    sensor
        Whether probes are what the scene's sensor makes of the light in four exposures.

    Attributes
    ----------
    drive : Drive
        What moves when the camera focuses.
    state : float
        Focus state, to begin with that of the scene.
    samples, seconds : int, float
        What the probes so far have taken: camera samples, and time from their start to their end [s].
    fault : str or None
        What about the exposure of the sensor hides what the brightest probe shows.
    """

    def __init__(self, scene: Scene, session: Session, *, sensor: bool = False) -> None:
        traced = _with_traced_lens(at_opening(scene))
        self.scene = traced if sensor else change_scene(traced, render={"clamp": _LIMIT})
        self.session, self._has_sensor = session, sensor
        self.drive = focus_drive(self.scene)
        self.state = self.drive.start
        self.samples, self.seconds = 0, 0.0
        self.fault: str | None = None
        self._most_light = 0.0
        self._view: ZoneView | None = None
        self._plan: Plan | None = None
        self._buffers: SceneBuffers | None = None
        self._wavefronts: dict[tuple[tuple[str, int], ...], Wavefront] = {}
        self._white: tuple[Plan, SceneBuffers] | None = None
        self._sharp: SharpPass | None = None
        self._sights: dict[Zone, dict[float, Sight]] = {}
        self._rays: dict[tuple[float, float, tuple[int, int], bytes], PupilRays] = {}
        self._wholes: dict[Zone, Zone] = {}  # of parts of zones
        self._most: dict[tuple[Zone, ...], float] = {}  # light that counts in full

    @property
    def view(self) -> ZoneView:
        """The zones chosen last, on their film."""
        assert self._view is not None
        return self._view

    def choose_zones(self, zones: Sequence[Zone], margin: tuple[int, int] = (0, 0)) -> ZoneView:
        """Choose the zones of the probes that follow, and how many pixels across and down to show beyond them."""
        chosen, view = tuple(zones), self._view
        if view is None or view.zones != chosen:
            wholes = tuple(self._wholes.get(zone, zone) for zone in chosen)
            view = replace(ZoneView.of(self.scene, wholes, margin), zones=chosen)
        elif view.margin != margin:
            view = replace(view, margin=margin)
        if view is not self._view:
            self._view = view
            self._wavefronts.clear()
        return view

    def part_of(self, zone: Zone, ranges: Ranges) -> Zone:
        """Return some columns and rows of a zone of the view as a zone of its own, which is seen in the same pixels."""
        (x, _, y, _), (width, height) = self.view.pixels_of(zone), self.view.resolution
        left, right, top, bottom = (each + side for each, side in zip(ranges, (0.25, -0.25) * 2, strict=True))
        part = Zone((x + left) / width, (x + right) / width, (y + top) / height, (y + bottom) / height)
        self._wholes[part] = self._wholes.get(zone, zone)
        return part

    def measure(
        self,
        state: float,
        zones: Sequence[Zone],
        samples: int,
        seed: int,
        stop: float = 1.0,
        reference: float | None = None,
    ) -> list[ZoneImage]:
        """Render zones in a focus state.

        Parameters
        ----------
        state
            Within the limits of the drive; the camera's own state stays as it is.
        zones
            Parts of the picture.
        samples
            Per pixel, rounded up to a multiple of `PARTS`.
        seed
            Of the random numbers: the same for two states makes their noise alike.
        stop
            Share of the diameter of the opening at which the camera takes its picture.
        reference
            State in which the zones are given. The image grows as the film goes away from the lens, so the film is
            scaled with it to show the same part of the scene in every state; by default it is not.

        Raises
        ------
        InputError
            When the state is out of range.
        """
        low, high = self.drive.limits
        if not low - 1e-9 * abs(low) <= state <= high + 1e-9 * abs(high):
            raise InputError(f"focus state {state:g} lies outside its range ({low:g} to {high:g})")
        view = self.choose_zones(zones)
        seen = view.scene if reference is None else view.scaled(self.drive.image_scale(state, reference))
        return self.render(self.drive.camera(seen, state, stop, view.zones), samples, seed)

    def camera(self, state: float, stop: float = 1.0) -> CameraModel:
        """Return the camera in a state for the device; it sees the chosen zones and their margin."""
        return self.drive.camera(self.view.scene, state, stop, self.view.shown_zones())

    def rays(self, state: float, places: NDArray[np.float64], stop: float = 1.0) -> PupilRays:
        """Return the rays of places [pixels] of the film that the zones are seen on."""
        key = state, stop, self.view.resolution, places.tobytes()
        if key not in self._rays:
            self._rays[key] = self.drive.rays(self.view.scene, state, stop, places)
        return self._rays[key]

    def render(self, camera: CameraModel, samples: int, seed: int) -> list[ZoneImage]:
        """Render the chosen zones through a camera: the mean of the light of the rays that pass it.

        Rays that a lens blocks would be most of the noise. With the same random numbers an empty white world is seen
        by the same rays, so that its picture tells how many passed.
        """
        begun, view = time.perf_counter(), self.view
        camera = exposed(camera, self._exposed_scene if self._has_sensor else view.scene)
        count = -(-samples // PARTS)
        both = [self._wavefront(camera, empty=empty) for empty in (False, True)]
        if not self._has_sensor:
            camera = self._limited(camera, both[0], both[1], seed * PARTS)
        for wavefront in both:
            wavefront.use_camera(camera)
        pictures: list[list[NDArray[np.float32]]] = [[], []]
        for part in range(PARTS):
            for wavefront in both:
                wavefront.clear()
                wavefront.seed = seed * PARTS + part
                _take_samples(wavefront, count)
            self.samples += both[0].camera_rays
            light, weights = (wavefront.picture(count) for wavefront in both)
            if self._has_sensor:
                light = self._read_sensor(light, weights > 0, camera, seed * PARTS + part)
            pictures[0].append(mean_light(light, weights))
            removed = None if self._has_sensor else view.layout.in_rows(both[0].planes()[PLANES : PLANES + 1])[0]
            if removed is not None and removed.any():
                pictures[1].append(mean_light(light + removed[..., None] / count, weights))
            else:
                pictures[1].append(pictures[0][-1])
        self.seconds += time.perf_counter() - begun
        limited, whole = (np.stack(each) for each in pictures)
        bright = any(one is not other for one, other in zip(*pictures, strict=True))
        shown = [(slice(None), *view.in_layout(view.shown(zone))) for zone in view.zones]
        return [ZoneImage(limited[at].copy(), count * PARTS, whole[at].copy() if bright else None) for at in shown]

    def _limited(self, camera: CameraModel, light: Wavefront, white: Wavefront, seed: int) -> CameraModel:
        """Return a camera whose exposure brings the most light that counts in full to the limit of a sample.

        What is limited is a function of the place in the scene, as its light is, and is sharp where that is.
        """

        def sample(wavefront: Wavefront, seed: int, factor: float = 1.0) -> NDArray[np.float32]:
            record = camera.record.copy()
            record["exposure"] *= factor
            wavefront.use_camera(replace(camera, record=record))
            wavefront.clear()
            wavefront.seed = seed
            _take_samples(wavefront, 1)
            return np.asarray(wavefront.picture(1).max(axis=2))

        weights = sample(white, seed)
        passed = weights > 0
        if not passed.any():
            return camera
        key = tuple(self._wholes.get(zone, zone) for zone in self.view.zones)
        if key not in self._most:
            faint = 1e-6 / float(weights.max())
            while _is_limited(one := sample(light, seed, faint)):
                faint *= 2.0**-20  # powers of two keep light of another unit alike, bit for bit
            pairs = [(one, weights), (sample(light, seed + 1, faint), sample(white, seed + 1))]
            self._most[key] = most_light(*np.stack([(each / faint, other) for each, other in pairs], axis=1))
        record = camera.record.copy()
        record["exposure"] *= _LIMIT / (self._most[key] * float(weights[passed].mean()))
        return replace(camera, record=record)

    @cached_property
    def _exposed_scene(self) -> Scene:
        """The scene in focus somewhere, with the exposure of its picture."""
        focused = change_scene(self.scene, camera=self.drive.camera_keys(self.state))
        return resolve_exposure(focused, self.session)[0]

    def _read_sensor(
        self, light: NDArray[np.float32], is_lit: NDArray[np.bool_], camera: CameraModel, seed: int
    ) -> NDArray[np.float32]:
        """Expose the scene's sensor to the light of a probe, on each of whose pixels lie as many of its as fit.

        Its noise is that of an exposure of its own for each camera: only what is random in rendering is shared.
        """
        scene, view = self._exposed_scene, self.view
        sensor = sensor_of(scene, {**camera.metadata, "window": (0, 0, *view.resolution)})
        assert sensor is not None
        width, height = scene.film.size_m()
        pixels = width * height / math.prod(view.resolution) / pixel_area_m2(scene)
        seen = binned_exposure(light, sensor, pixels, zlib.crc32(camera.record.tobytes(), seed))
        shown = light[is_lit.any(axis=2)]
        mean = float(shown.mean()) if len(shown) else 0.0
        if mean >= self._most_light:  # those through smaller openings are dark on purpose
            white_e = (sensor.white_level_dn - sensor.dark_level_dn) / sensor.system_gain_dn_per_e
            white = float(np.mean((shown @ sensor.electrons >= white_e).any(axis=1))) if len(shown) else 0.0
            off = seen[is_lit.any(axis=2)] - shown
            noise = float(np.sqrt(np.mean(off**2))) / mean if mean > 0 else math.inf
            self._most_light, self.fault = mean, None
            if white >= _MOST_WHITE:
                self.fault = f"{white:.0%} of it is white in this exposure"
            elif noise > _MOST_NOISE:
                self.fault = f"it is dark in this exposure: the noise of a probe is {noise:.2g} times its light"
        return seen

    def sight(self, state: float, zone: Zone) -> Sight:
        """Find what a zone shows in a state, by the chief rays of a grid of places.

        Raises
        ------
        InputError
            When no light reaches it.
        """
        known = self._sights.setdefault(zone, {})
        for other, sight in known.items():
            if abs(self.drive.coordinate(other) - self.drive.coordinate(state)) <= ALIKE * self.drive.depth_of_focus:
                return sight
        across, down = (np.linspace(*ends, 2 * SIGHT_ACROSS + 1)[1::2] for ends in (
            (zone.left, zone.right), (zone.top, zone.bottom)))  # fmt: skip
        known[state] = self._sight_of(state, np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2))
        return known[state]

    def objects(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return which object each part of the picture shows, and which stands first there, as clear glass may.

        Both are -1 for none, (height, width) of at most `ACROSS`.
        """
        resolution = self.scene.film.resolution
        columns, rows = (max(round(side * ACROSS / max(resolution)), 1) for side in resolution)
        places = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
        sight = self._sight_of(self.state, np.stack(places, axis=-1).reshape(-1, 2))
        return sight.objects.reshape(rows, columns), sight.first_objects.reshape(rows, columns)

    def _sight_of(self, state: float, shares: NDArray[np.float64]) -> Sight:
        """Find what places, in fractions of the picture, show in a state."""
        (left, top), (right, bottom) = shares.min(axis=0).tolist(), shares.max(axis=0).tolist()
        begun, plan = time.perf_counter(), self._scene_plan(Zone(left, right, top, bottom))
        chief, moments = self.drive.chief_rays(self.scene, state), Moments(self.scene)
        places = shares * self.scene.film.resolution
        few = len(places) == SIGHT_ACROSS**2
        origins, directions = chief.rays_of_few(places) if few else chief.rays(places)
        dark = ~np.isfinite(directions).all(axis=1)
        if dark.all():
            raise InputError("no light reaches the zone")
        sharp = self._sharp = self._sharp or SharpPass(self.session, plan, self._scene_buffers())
        times = moments.middles(places)
        poses, since_s = moments.poses(times), times - self.scene.shutter.open_s

        def follow(origins: NDArray[np.float64], directions: NDArray[np.float64], rays: Any) -> SeenEnds:
            turns = poses[rays, :3, :3]
            world = np.einsum("nij,nj->ni", turns, origins) + poses[rays, :3, 3] - plan.eye_m
            along = np.einsum("nij,nj->ni", turns, directions)
            return follow_rays(sharp, plan, world, along, since_s[rays])

        sight = sight_of(origins, directions, follow)
        self.samples += len(places)
        self.seconds += time.perf_counter() - begun
        return sight

    def _scene_plan(self, zone: Zone = WHOLE) -> Plan:
        """Return the plan of the scene, made at first use by a zone; its camera is replaced for each probe."""
        if self._plan is None:
            seen = (self._view or ZoneView.of(self.scene, (WHOLE,), (0, 0))).scene
            self._plan = make_plan(seen, self.drive.camera(seen, self.state, 1.0, [zone]))
        return self._plan

    def _scene_buffers(self) -> SceneBuffers:
        if self._buffers is None:
            self._buffers = SceneBuffers(self.session, self._scene_plan())
        return self._buffers

    def _white_plan(self, camera: CameraModel) -> tuple[Plan, SceneBuffers]:
        if self._white is None:
            plan = make_plan(_white_world(self.view.scene), camera)
            self._white = plan, SceneBuffers(self.session, plan)
        return self._white

    def _wavefront(self, camera: CameraModel, *, empty: bool) -> Wavefront:
        """Return the wavefront for a camera of these facts, made at first use, for the scene or an empty world."""
        facts = (*sorted(camera.facts.items()), ("empty", int(empty)))
        if facts not in self._wavefronts:
            view = self.view
            plan, buffers = self._white_plan(camera) if empty else (self._scene_plan(), self._scene_buffers())
            plan = replace(plan, camera=camera)
            wave_size = _SMALL_WAVE if is_cancellable() else None
            self._wavefronts[facts] = Wavefront(
                self.session, plan, view.layout, view.scene.render, wave_size, buffers=buffers, scouts=False
            )
            self._wavefronts[facts].choose_tiles(view.tiles())
        return self._wavefronts[facts]


_LIMIT = 1.0  # `render.clamp` of probes
UNLIMITED = 1e6  # times the mean light
_NOISY = 0.5  # standard deviation of a sample over its mean, from which on it is
LIMITED = 16  # rounds of finding it
USUAL, _LIT_SHARE = 2.0, 0.9  # times the mean of what is left; share of the samples with light that stay whole
_HELPS = 0.75  # of the standard errors by which details show in all of the light: few samples know little of rare ones


def _is_limited(light: NDArray[np.float32]) -> bool:
    """Whether more than a few samples with light are at the limit of probes, so that they say little of the light."""
    lit = light[light > 0]
    return bool(lit.size) and float(np.quantile(lit, _LIT_SHARE)) > _LIMIT / 2


def most_light(light: NDArray[np.float32], weights: NDArray[np.float32]) -> float:
    """Return the light from which on samples are limited, where two of each pixel scatter much.

    Fireflies of lamps would be most of the noise, but bright places may be most of what there is to see: probes show
    both, with the limit and in all of the light, and searches go on with what shows more (`clearer_light`).

    Parameters
    ----------
    light, weights : (2, height, width) arrays
        Samples of each pixel, and the weights of their rays.
    """
    passed = weights > 0
    mean = float(light.sum(dtype=np.float64)) / max(float(weights.sum(dtype=np.float64)), 1e-30)
    whole = UNLIMITED * (mean or 1.0)
    both = passed.all(axis=0)
    if not (mean > 0 and both.any()):
        return whole
    one, other = light[:, both] / weights[:, both]
    own = float(one.mean(dtype=np.float64) + other.mean(dtype=np.float64)) / 2
    if float(np.square(one - other, dtype=np.float64).mean()) / 2 <= (_NOISY * own) ** 2:
        return whole
    seen = light[passed] / weights[passed]
    most, least = whole, float(np.quantile(seen[seen > 0], _LIT_SHARE))
    for _ in range(LIMITED):
        most = max(USUAL * float(np.minimum(seen, most).mean(dtype=np.float64)), least)
    return most


def clearer_light(limited: float, whole: float) -> Literal["limited", "whole"]:
    """Return in which light a search goes on: by how many standard errors its first probe shows what it looks for."""
    return "limited" if limited > whole else "whole"


def clearness(images: Sequence[ZoneImage]) -> float:
    """Return by how many standard errors details show in some zones, or in the part of one that shows most."""
    clear = 0.0
    for image in images:
        parts = image.parts
        chosen = rich_part(image.luminance)
        for left, right, above, below in [(0, parts.shape[2], 0, parts.shape[1]), *([chosen] if chosen else [])]:
            shown = ZoneImage(parts[:, above:below, left:right], image.samples)
            found = MEASURES[BEST].of(shown)
            as_many = math.sqrt(parts[0].size / shown.parts[0].size)  # samples in all
            clear = max(clear, as_many * found.value / found.error if found.error > 0 else 0.0)
    return clear


_LEAST_PASSED = 0.05  # of the mean weight: pixels with less have hardly any rays
_WIDEST_GAP = 3  # doublings of the squares, from 3 pixels on, within which such pixels are filled from rays beside them


def mean_light(light: NDArray[np.float32], weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the mean light of the rays of each pixel (height, width, n), or of those beside it where hardly any pass.

    A mean of all would be the noise of a texture where few rays of each pixel pass: of the lens of a telephone a fifth.
    """
    mean = float(weights.mean())
    if not mean > 0:
        return np.zeros_like(light)
    passed = weights > _LEAST_PASSED * mean
    share = light / np.where(passed, weights, 1.0)
    for doubling in range(_WIDEST_GAP):
        if passed.all():
            return np.asarray(share, np.float32)
        side = (2 << doubling) + 1
        near_light, near_weights = (_sum_around(each, side) for each in (light, weights))
        near = ~passed & (near_weights > _LEAST_PASSED * mean)
        share = np.where(near, near_light / np.where(near, near_weights, 1.0), share)
        passed = passed | near
    return np.asarray(np.where(passed, share, float(light.mean()) / mean), np.float32)


def _sum_around(picture: NDArray[np.float32], side: int) -> NDArray[np.float64]:
    """Return the sum of a picture (height, width, n) over the square of a side round each pixel, 0 beyond its edges."""
    half = side // 2
    sums = np.pad(picture.astype(np.float64), [(half + 1, half)] * 2 + [(0, 0)]).cumsum(0).cumsum(1)
    return np.asarray(sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side])


def _white_world(scene: Scene) -> Scene:
    """Return a scene of nothing but white all round, seen by the camera and not through fog, with its camera rays."""
    white = ConstantEnvironment(kind="constant", radiance=(1.0, 1.0, 1.0))
    empty = {"objects": (), "lights": (), "environment": white, "medium": None}
    settings = scene.render.model_copy(update={"clamp": None, "caustics": "off", "virtual_lights": "off"})
    film = scene.film.model_copy(update={"transparent": False})
    return scene.model_copy(update=empty | {"render": settings, "film": film})


def _with_traced_lens(scene: Scene) -> Scene:
    """Return a scene whose lens is traced: polynomials would have to be fitted anew in every state."""
    camera = scene.camera.traced_camera
    fitted = camera is not None and camera.rays == "fitted"
    return change_scene(scene, camera={"rays": "traced"}) if fitted else scene


# The probes of a search: the task that a method is given, and what each probe measured.

NEAR = 8.0  # depths of focus to either side within which the focus is searched when it was found a moment ago


@dataclass(frozen=True)
class Task:
    """A camera to focus.

    Attributes
    ----------
    renderer : ProbeRenderer
    zones : tuple of Zone
    policy : Policy
        Which zone decides.
    seed : int
        Of every probe: their noise is alike, so that differences between states are seen through it.
    near : float or None
        State near which the focus is expected; None for anywhere.
    reach : float
        How far from there it is searched to either side [depths of focus].
    on_probe : callable or None
        Called with every probe.
    on_state : callable or None
        Called with every state that the focus is taken to be in by now.
    criterion : str or None
        What is called sharpest at a distance; the least spot by default.
    """

    renderer: ProbeRenderer
    zones: tuple[Zone, ...]
    policy: Policy
    seed: int = 0
    near: float | None = None
    reach: float = NEAR
    on_probe: Callable[[Probe], None] | None = None
    on_state: Callable[[float], None] | None = None
    criterion: str | None = None

    def note_state(self, state: float) -> None:
        """Report a state that the focus is taken to be in."""
        if self.on_state is not None:
            self.on_state(state)

    @property
    def drive(self) -> Drive:
        """What moves when the camera focuses."""
        return self.renderer.drive

    def probes(self, measure: Measure) -> Probes:
        """Return a search of the zones with a measure, with no probe so far."""
        return Probes(self, measure)

    def near_place(self, probes: Probes) -> tuple[float, float] | None:
        """Return where the focus is expected and how far to either side of it to search [mm]."""
        return None if self.near is None else (probes.place_of(self.near), self.reach * self.drive.depth_of_focus)

    def report(
        self,
        method: str, state: float, zone: Zone, error: float, confidence: float, probes: list[ProbeRecord],
        distance_m: float | None = None,
    ) -> FocusReport:  # fmt: skip
        """Return the report of a focus that was found; by default it finds which distance the lens has it at."""
        drive = self.drive
        return FocusReport(
            method=method, state=state, film_distance_mm=drive.film_distance(state),
            focus_distance_m=drive.object_distance(state, zone) if distance_m is None else distance_m,
            confidence=confidence, error=error, depth_of_focus_mm=drive.depth_of_focus, zone=zone, zones=self.zones,
            probes=probes,
        )  # fmt: skip


def probability_within(tolerance: float, error: float) -> float:
    """Return the probability that a normal error of a standard deviation stays within a tolerance."""
    return math.erf(tolerance / (math.sqrt(2) * error)) if error > 0 else 1.0


MOST_SAMPLES = 512  # per pixel
MOST_OF_SEARCH = 2_000_000  # samples of all pixels: what is not decided by then is refused, or as uncertain as it says
PRECISE = 8.0  # parts of a depth of focus, of which a focus may err by one
DEAR = 200_000  # samples of all pixels, after which a search is content with the error of `CONTENT`
CONTENT = 0.2  # depths of focus: four times of five the focus then lies within a quarter
HOPELESS = 0.5  # depths of focus: error by all samples that are left, roughly known, above which they are not taken
MOST_PROBES = 40  # after which a search gives up


@dataclass
class Probes:
    """The probes of a task with one measure, so far.

    Attributes
    ----------
    task : Task
    measure : Measure
    most : int
        Samples per pixel of a probe that a search takes at most.
    budget : int
        Samples of all pixels that it takes at most.
    light : str
        Whether its pictures are with the limit on bright samples, or in all of the light.
    """

    task: Task
    measure: Measure
    made: list[Probe] = field(default_factory=list)
    most: int = MOST_SAMPLES
    budget: int = MOST_OF_SEARCH
    light: Literal["limited", "whole"] = "limited"

    @property
    def drive(self) -> Drive:
        """What moves when the camera focuses."""
        return self.task.drive

    @property
    def affordable(self) -> int:
        """Samples per pixel that each of three probes more takes at most."""
        left = self.budget - sum(probe.samples for probe in self.made)
        return min(MOST_SAMPLES, self.task.renderer.choose_zones(self.task.zones).samples_in(left // 3))

    @property
    def enough(self) -> int:
        """Samples per pixel of each of three probes more, after which an error of `CONTENT` is enough."""
        return self.task.renderer.choose_zones(self.task.zones).samples_in(DEAR // 3)

    @property
    def enough_error(self) -> float:
        """Standard error of the place that is enough [mm]."""
        spent = sum(probe.samples for probe in self.made)
        return (CONTENT if spent >= DEAR else 1 / PRECISE) * self.drive.depth_of_focus

    @property
    def ends(self) -> tuple[float, float]:
        """Lowest and highest place."""
        sense = self.drive.nearer
        low, high = sorted(sense * self.drive.coordinate(state) for state in self.drive.limits)
        return low, high

    def state_of(self, place: float) -> float:
        """Return the focus state of a place."""
        low, high = self.drive.limits
        return min(max(self.drive.state_at(self.drive.nearer * place), low), high)

    def place_of(self, state: float) -> float:
        """Return the place of a focus state."""
        return self.drive.nearer * self.drive.coordinate(state)

    def at(self, place: float, samples: int, stop: float = 1.0, reference: float | None = None) -> Probe:
        """Probe a place; the zones are given in the place of reference (see `ProbeRenderer.measure`).

        Raises
        ------
        NoContrast
            After more probes than a search ever needs.
        """
        if len(self.made) >= MOST_PROBES:
            raise NoContrast(f"no focus found in the zone after {MOST_PROBES} probes")
        begun = time.perf_counter()
        fixed = None if reference is None else self.state_of(reference)
        images = self.task.renderer.measure(self.state_of(place), self.task.zones, samples, self.task.seed, stop, fixed)
        if not self.made and any(image.whole is not None for image in images):
            whole = [image.in_light("whole") for image in images]
            self.light = clearer_light(clearness(images), _HELPS * clearness(whole))
        images = [image.in_light(self.light) for image in images]
        pixels = sum(image.parts.shape[1] * image.parts.shape[2] for image in images)
        measures = [self.measure.of(image) for image in images]
        scale = self.drive.image_scale(self.state_of(place), self.state_of(self.ends[0]) if fixed is None else fixed)
        taken, seconds = pixels * images[0].samples, time.perf_counter() - begun
        before = [(each.round, (each.stop, each.samples // each.images[0].samples)) for each in self.made[-1:]]
        number = sum(last + (kind != (stop, pixels)) for last, kind in before)
        probe = Probe(place, stop, reference, scale, measures, taken, seconds, images, number)
        self.made.append(probe)
        if self.task.on_probe is not None:
            self.task.on_probe(probe)
        return probe

    def records(self, zone: int) -> list[ProbeRecord]:
        """List the measures of one zone, a record for each probe."""
        return [self._record(probe, zone) for probe in self.made]

    def _record(self, probe: Probe, zone: int) -> ProbeRecord:
        state, measure = self.state_of(probe.place), probe.measures[zone]
        return ProbeRecord(
            state, self.drive.film_distance(state), measure.value, measure.error, probe.stop, probe.samples,
            probe.seconds, round=probe.round,
        )  # fmt: skip
