"""The renderer as a focus probe: zones of the film seen through the scene's camera in any focus state.

Programs, trees and textures are made once; a look replaces the camera's records and nothing else.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import CameraModel, PupilRays, exposed
from rptcam_cl.core.errors import InputError
from rptcam_cl.device import Session
from rptcam_cl.focusing.drives import focus_drive
from rptcam_cl.focusing.lens_drive import Drive, circle_of_confusion
from rptcam_cl.focusing.probe import Zone, ZoneImage
from rptcam_cl.plan import Plan, make_plan
from rptcam_cl.rendering import TILE, FilmLayout, SceneBuffers, Wavefront
from rptcam_cl.scene import Exposure, Film, LayerName, RealisticCamera, Scene, at_opening, change_scene

# Shares of the opening's diameter, the first f/100 for a lens of f/2. Where a lens is stopped down so far that rays,
# which aim at boxes, hardly ever find the pupil, the next one is taken.
OPENINGS = (0.02, 0.1, 0.5, 1.0)
ENOUGH = 0.05  # of the rays pass
SAMPLES = 16  # per pixel


def first_hits(
    drive: Drive,
    scene: Scene,
    session: Session,
    state: float,
    zones: Sequence[Zone],
    layout: FilmLayout,
    names: Sequence[LayerName],
    seed: int,
) -> tuple[dict[str, NDArray[Any]], int]:
    """Return layers of what a part of the film sees, (height, width) each, and how many samples they took.

    Parameters
    ----------
    scene
        With the film that `layout` is a part of.
    zones
        Where the layers are needed.
    """
    seen = change_scene(scene, render={"layers": tuple(names), "layers_spp": SAMPLES, "max_depth": 1, "noise": None})
    taken = 0
    for opening in OPENINGS:
        camera = exposed(drive.camera(seen, state, opening, zones), seen)
        wavefront = Wavefront(session, make_plan(seen, camera), layout, seen.render)
        wavefront.seed = seed
        for wave in wavefront.waves(0, SAMPLES):
            wavefront.enqueue(*wave)
        wavefront.finish()
        taken += wavefront.camera_rays
        if wavefront.outcomes()["passed"] >= ENOUGH * wavefront.camera_rays:
            break
    return wavefront.layers(), taken


PARTS = 4  # independent pictures that a look consists of
FEWEST_PIXELS = 40  # across the shorter side of a zone, if its pixels then are not smaller than
ACROSS = 240  # pixels of the picture in which objects are sought
WHOLE = Zone(0.0, 1.0, 0.0, 1.0)
FINEST, COARSEST = 0.5, 1.5  # circles of confusion


class ProbeRenderer:
    """A camera of a scene on a device as a `FocusProbe`.

    The zones are rendered with pixels that suit the circle of confusion, whatever the resolution of the picture.

    Parameters
    ----------
    scene
        Its camera must be one that has a focus.
    session
        The device.

    Attributes
    ----------
    state : float
        Focus state, to begin with that of the scene.
    samples, seconds : int, float
        What the looks so far have taken: camera samples, and time from their start to their end [s].
    """

    def __init__(self, scene: Scene, session: Session, state: float | None = None) -> None:
        self.scene, self.session = _traced(at_opening(scene)), session
        self.drive = focus_drive(self.scene)
        self.state = self.drive.start if state is None else state
        self.samples, self.seconds = 0, 0.0
        self._buffers: SceneBuffers | None = None
        self._zones: tuple[Zone, ...] = ()
        self._margin = (0, 0)
        self._wavefronts: dict[tuple[tuple[str, int], ...], Wavefront] = {}

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest state."""
        return self.drive.limits

    @property
    def depth_of_focus(self) -> float:
        """2 N c in units of the coordinate."""
        return self.drive.depth_of_focus

    @property
    def nearer(self) -> int:
        """The sense along the coordinate in which nearer objects become sharp."""
        return self.drive.nearer

    def coordinate(self, state: float) -> float:
        """Return the coordinate of a state."""
        return self.drive.coordinate(state)

    def state_at(self, coordinate: float) -> float:
        """Return the state of a coordinate."""
        return self.drive.state_at(coordinate)

    def image_scale(self, state: float, reference: float) -> float:
        """Return how large a state draws what is sharp in the state of reference, against that one."""
        return self.drive.image_scale(state, reference)

    def object_distance(self, state: float, zone: Zone | None = None) -> float | None:
        """Return the distance of the plane that is sharpest in a zone, by default on the axis [m]."""
        return self.drive.object_distance(state, zone)

    def film_distance(self, state: float) -> float:
        """Return the distance to the film [mm]."""
        return self.drive.film_distance(state)

    def state_for(self, distance_m: float, zone: Zone) -> float:
        """Return the state that makes a plane sharpest in the middle of a zone, by the lens alone."""
        return self.drive.state_for(distance_m, zone)

    def measure(
        self,
        state: float,
        zones: Sequence[Zone],
        samples: int,
        seed: int,
        stop: float = 1.0,
        reference: float | None = None,
    ) -> list[ZoneImage]:
        """Return what the zones show; see `FocusProbe`. `samples` is rounded up to a multiple of `PARTS`."""
        low, high = self.limits
        if not low - 1e-9 * abs(low) <= state <= high + 1e-9 * abs(high):
            raise InputError(f"focus state {state:g} lies outside its range ({low:g} to {high:g})")
        self.look_at(zones)
        return self.render(self.drive.camera(self._scaled(state, reference), state, stop, self._zones), samples, seed)

    def _scaled(self, state: float, reference: float | None) -> Scene:
        """Return the scene with a film that shows the same part of it as in the state of reference."""
        if reference is None:
            return self._seen
        scale = self.drive.image_scale(state, reference)
        width, height = self._seen.film.size_m()
        film = self._seen.film.model_copy(update={"size_mm": (width * 1e3 * scale, height * 1e3 * scale)})
        return self._seen.model_copy(update={"film": film})

    def camera(self, state: float, stop: float = 1.0) -> CameraModel:
        """Return the camera in a state for the device; it sees the chosen zones and their margin."""
        width, height = self._seen.film.resolution
        shown = [self._shown(zone) for zone in self._zones]
        zones = [Zone(x0 / width, x1 / width, y0 / height, y1 / height) for x0, x1, y0, y1 in shown]
        return self.drive.camera(self._seen, state, stop, zones)

    def rays(self, state: float, places: NDArray[np.float64], stop: float = 1.0) -> PupilRays:
        """Return the rays of places [pixels] of the film that the zones are seen on."""
        return self.drive.rays(self._seen, state, stop, places)

    def look_at(self, zones: Sequence[Zone], margin: tuple[int, int] = (0, 0)) -> None:
        """Choose the zones of the looks that follow, and how many pixels across and down to see beyond them."""
        if (tuple(zones), margin) != (self._zones, self._margin):
            if tuple(zones) != self._zones:
                self.__dict__.pop("_seen", None)
            self._zones, self._margin = tuple(zones), margin
            self._wavefronts.clear()
            self.__dict__.pop("_layout", None)

    @property
    def film(self) -> Film:
        """The film that the zones are seen on."""
        return self._seen.film

    @cached_property
    def _seen(self) -> Scene:
        """The scene with a film whose pixels suit the zones."""
        film = self.scene.film
        size_mm = tuple(side * 1e3 for side in film.size_m())
        sides = [((z.right - z.left) * size_mm[0], (z.bottom - z.top) * size_mm[1]) for z in self._zones]
        circle = circle_of_confusion(self.scene)
        pixel = min(max(min(min(pair) for pair in sides) / FEWEST_PIXELS, FINEST * circle), COARSEST * circle)
        columns, rows = (max(round(side / pixel), 1) for side in size_mm)
        seen = change_scene(self.scene, film=film.whole_in((columns, rows)), render={"layers": (), "noise": None})
        return seen.model_copy(update={"exposure": Exposure()})  # measures take the mean off anyway

    @cached_property
    def _layout(self) -> FilmLayout:
        """The part of the film that holds all zones."""
        width, height = self._seen.film.resolution
        corners = np.array([self._shown(zone) for zone in self._zones])
        (x0, _, y0, _), (_, x1, _, y1) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        return FilmLayout(width, height, x0, y0, x1 - x0, y1 - y0)

    def _pixels_of(self, zone: Zone) -> tuple[int, int, int, int]:
        """Return the columns and rows of a zone: first, behind the last, first, behind the last."""
        width, height = self._seen.film.resolution
        x0, y0 = min(math.floor(zone.left * width), width - 1), min(math.floor(zone.top * height), height - 1)
        return x0, max(math.ceil(zone.right * width), x0 + 1), y0, max(math.ceil(zone.bottom * height), y0 + 1)

    def _shown(self, zone: Zone) -> tuple[int, int, int, int]:
        """Return the columns and rows of a zone with the margin, as far as the film goes."""
        (width, height), (across, down) = self._seen.film.resolution, self._margin
        x0, x1, y0, y1 = self._pixels_of(zone)
        return max(x0 - across, 0), min(x1 + across, width), max(y0 - down, 0), min(y1 + down, height)

    def margins(self, zone: Zone) -> tuple[int, int, int, int]:
        """Return how many pixels are seen beyond a zone: left, right, above, below."""
        (x0, x1, y0, y1), (left, right, top, bottom) = self._pixels_of(zone), self._shown(zone)
        return x0 - left, right - x1, y0 - top, bottom - y1

    def _tiles(self) -> NDArray[np.uint32]:
        """Return the tiles of the layout that zones touch."""
        layout = self._layout
        touched = np.zeros((-(-layout.height // TILE), layout.tiles_across), np.bool_)
        for zone in self._zones:
            x0, x1, y0, y1 = self._shown(zone)
            rows = slice((y0 - layout.y) // TILE, (y1 - layout.y - 1) // TILE + 1)
            touched[rows, (x0 - layout.x) // TILE : (x1 - layout.x - 1) // TILE + 1] = True
        return np.flatnonzero(touched).astype(np.uint32)

    def render(self, camera: CameraModel, samples: int, seed: int) -> list[ZoneImage]:
        """Return what the zones show through a camera."""
        begun = time.perf_counter()
        camera = exposed(camera, self._seen)
        wavefront = self._wavefront(camera)
        wavefront.use_camera(camera)
        count = -(-samples // PARTS)
        parts = []
        for part in range(PARTS):
            wavefront.clear()
            wavefront.seed = seed * PARTS + part
            for wave in wavefront.waves(0, count):
                wavefront.enqueue(*wave)
            wavefront.finish()
            self.samples += wavefront.camera_rays
            parts.append(wavefront.picture(count))
        self.seconds += time.perf_counter() - begun
        return [self._cut(np.stack(parts), zone, count * PARTS) for zone in self._zones]

    def depths(self, state: float, zones: Sequence[Zone], seed: int) -> list[NDArray[np.float64]]:
        """Return how far along the axis what each zone's pixels show lies from the film [m]; infinite for nothing."""
        begun = time.perf_counter()
        self.look_at(zones)
        layers, samples = first_hits(
            self.drive, self._seen, self.session, state, self._zones, self._layout, ("depth",), seed
        )
        self.samples += samples
        self.seconds += time.perf_counter() - begun
        depth = layers["depth"].astype(np.float64)
        x, y = self._layout.x, self._layout.y
        corners = [self._pixels_of(zone) for zone in self._zones]
        return [depth[y0 - y : y1 - y, x0 - x : x1 - x] for x0, x1, y0, y1 in corners]

    def objects(self) -> NDArray[np.int32]:
        """Return which object each part of the picture shows, -1 for none, (height, width) of at most `ACROSS`."""
        film = self.scene.film
        scale = ACROSS / max(film.resolution)
        columns, rows = (max(round(side * scale), 1) for side in film.resolution)
        small = change_scene(self.scene, film=film.whole_in((columns, rows)))
        layout = FilmLayout(columns, rows, 0, 0, columns, rows)
        layers, _ = first_hits(self.drive, small, self.session, self.state, [WHOLE], layout, ("object_id",), 0)
        return np.asarray(layers["object_id"], np.int32)

    def _cut(self, parts: NDArray[np.float32], zone: Zone, samples: int) -> ZoneImage:
        x0, x1, y0, y1 = self._shown(zone)
        x, y = self._layout.x, self._layout.y
        return ZoneImage(np.ascontiguousarray(parts[:, y0 - y : y1 - y, x0 - x : x1 - x]), samples)

    def _wavefront(self, camera: CameraModel) -> Wavefront:
        """Return the wavefront for a camera of these facts, made at first use."""
        facts = tuple(sorted(camera.facts.items()))
        if facts not in self._wavefronts:
            plan = replace(self._plan, camera=camera)
            if self._buffers is None:
                self._buffers = SceneBuffers(self.session, plan)
            self._wavefronts[facts] = Wavefront(
                self.session, plan, self._layout, self._seen.render, buffers=self._buffers
            )
            self._wavefronts[facts].choose_tiles(self._tiles())
        return self._wavefronts[facts]

    @cached_property
    def _plan(self) -> Plan:
        return make_plan(self._seen, self.drive.camera(self._seen, self.state, 1.0, self._zones))


def _traced(scene: Scene) -> Scene:
    """Return a scene whose lens is traced: polynomials would have to be fitted anew in every state."""
    fitted = isinstance(scene.camera, RealisticCamera) and scene.camera.rays == "fitted"
    return change_scene(scene, camera={"rays": "traced"}) if fitted else scene
