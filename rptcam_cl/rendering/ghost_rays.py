"""Rays of ghosts: from the sources of a scene through boxes on the front of its lens, by a pair of its surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.cameras import WayRecords, ghost_setting
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.buffers import SceneBuffers
from rptcam_cl.rendering.ghost_colours import bands
from rptcam_cl.rendering.ghost_sources import Sources, ghost_sources
from rptcam_cl.scene import Scene

Array = NDArray[np.float64]
Way = tuple[int, ...]

GROUP = 4
LATTICE = 2654435769  # over 2^32, the second coordinate's step from ray to ray: the kernel's
ONE_LIGHT = float(1 << 36)  # units of the device's whole numbers


class GhostRays:
    """What sends light of ghosts onto the film of a scene."""

    def __init__(self, scene: Scene, plan: Plan, session: Session) -> None:
        self.session = session
        setting = ghost_setting(scene)
        self.lens, self.film_distance = setting.lens, setting.film_distance_mm
        film_z = self.lens.film_z(self.film_distance)
        buffers = SceneBuffers(session, plan)
        self.sources: Sources = ghost_sources(scene, plan, buffers, session, self.lens, film_z)
        self.bands = bands(scene, plan, setting, self.sources)
        self.records = [WayRecords.of(self.lens, band.nm, setting.transmission) for band in self.bands]
        (self.columns, self.rows), (width, height) = scene.film.resolution, scene.film.size_m()
        sense = -1.0 if scene.camera.flip else 1.0
        across, down = sense * self.columns / (1e3 * width), -sense * self.rows / (1e3 * height)
        self.to_pixels = np.array([self.columns / 2, across, self.rows / 2, down], np.float32)
        self.pixel_mm2 = 1e6 * width * height / (self.columns * self.rows)
        pencils = int(self.sources.mirrored > 0)
        facts = self.records[0].facts | {"VW": session.lanes, "DOUBLE": 0, "GHOST_PENCILS": pencils}
        self.programs = {
            scout: session.program(["pass/ghosts.cl"], facts | {"GHOST_SCOUT": scout}, device_declarations())
            for scout in (0, 1)
        }
        self.stop = session.upload(self.records[0].stop)

    def add(
        self, film: Any, way: Way, record: int, places: Array, boxes: Array, weights: Array, first: Array, rays: int
    ) -> None:
        """Add rays of sources to a film, each with its weight in the film's colours and its lattice's first point.

        Its buffer holds whole numbers, of which `ONE_LIGHT` is 1.
        """
        self._launch(0, way, record, self._table(places, boxes, weights, first), len(boxes), rays, film)

    def landed(self, way: Way, record: int, places: Array, boxes: Array, rays: int) -> tuple[Array, Array, Array]:
        """Return column, row and share of the light (n, rays) of rays through boxes; no share beside the film."""
        count = len(places)
        memory = self.session.allocate(12 * count * rays)
        self._launch(1, way, record, self._table(places, boxes, np.ones((count, 3))), count, rays, memory)
        landed = self.session.read(memory, np.float32, 3 * count * rays).astype(np.float64)
        x, y, share = landed.reshape(3, count, rays)
        columns, rows = self.to_pixels[0] + self.to_pixels[1] * x, self.to_pixels[2] + self.to_pixels[3] * y
        with np.errstate(invalid="ignore"):
            inside = (share > 0) & (columns >= 0) & (rows >= 0) & (columns < self.columns) & (rows < self.rows)
        return columns, rows, np.where(inside, share, 0.0)

    def lit(self, boxes: Array, record: int) -> NDArray[np.bool_]:
        """Return which sources shine at a wavelength and have boxes."""
        return np.asarray((boxes[:, 2] > 0) & self.bands[record].light.any(axis=1))

    def whole_groups(self, rays: float) -> int:
        """Return a number of rays of a source that fills whole work groups."""
        step = self.session.lanes * GROUP
        return max(int(np.ceil(rays / step)) * step, step)

    def _table(self, places: Array, boxes: Array, weights: Array, first: ArrayLike = (0.5, 0.0)) -> Any:
        """Return sources with their boxes, weights (n, 3) and first points of their lattices on the device."""
        table = np.zeros((len(boxes), 3 + places.shape[1] // 4, 4), np.float32)
        table[:, 0], table[:, 1], table[:, 2, :3], table[:, 3, :2] = places[:, :4], boxes, weights, first
        table[:, 4:] = places[:, 4:].reshape(len(boxes), -1, 4)
        return self.session.upload(table)

    def _launch(self, scout: int, way: Way, record: int, table: Any, count: int, rays: int, out: Any) -> None:
        surfaces = self.records[record].way(way)
        launch = self.session.bind(
            self.programs[scout], "ghosts", surfaces=self.session.upload(surfaces), count=np.int32(len(surfaces)),
            stop=self.stop, sources=table, source_count=np.uint32(count), rays=np.uint32(rays),
            film_distance=np.float32(self.film_distance), pixels=self.to_pixels.tobytes(),
            size=np.array([self.columns, self.rows], np.uint32).tobytes(), film=out,
        )  # fmt: skip
        launch.enqueue(count * rays // self.session.lanes, GROUP)
