"""Rays of ghosts: from the sources of a scene through boxes on the front of its lens, by a pair of its surfaces."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.cameras import WayRecords, ghost_setting
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device import Session
from rptcam_cl.optics import Lens, LensTransmission, with_wider_stop
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.buffers import SceneBuffers
from rptcam_cl.rendering.ghost_colours import bands
from rptcam_cl.rendering.ghost_sources import Sources, ghost_sources
from rptcam_cl.scene import Scene

Array = NDArray[np.float64]
Way = tuple[int, ...]

GROUP = 4
SCOUTS = 1024  # rays of a source that look for the light of each way
SURE = 32.0  # of them that shall come through the opening; where fewer would, they look through wider ones first
CLOSING = 4.0  # how far the stop is then closed at a time
LATTICE = 2654435769  # over 2^32, the second coordinate's step from ray to ray: the kernel's
ONE_LIGHT = float(1 << 36)  # units of the device's whole numbers


class Opening(NamedTuple):
    """A lens at a wavelength, and the shape of its stop on the device."""

    records: WayRecords
    stop: Any


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
        self.lenses = [self._opening(self.lens, band.nm, setting.transmission) for band in self.bands]
        middle = len(self.bands) // 2
        wider = [self._opening(lens, self.bands[middle].nm, setting.transmission) for lens in self._wider()]
        self.openings = [*wider, self.lenses[middle]]
        (self.columns, self.rows), (width, height) = scene.film.resolution, scene.film.size_m()
        sense = -1.0 if scene.camera.flip else 1.0
        across, down = sense * self.columns / (1e3 * width), -sense * self.rows / (1e3 * height)
        self.to_pixels = np.array([self.columns / 2, across, self.rows / 2, down], np.float32)
        self.pixel_mm2 = 1e6 * width * height / (self.columns * self.rows)
        pencils = int(self.sources.mirrored > 0)
        facts = self.lenses[0].records.facts | {"VW": session.lanes, "DOUBLE": 0, "GHOST_PENCILS": pencils}
        self.programs = {
            scout: session.program(["pass/ghosts.cl"], facts | {"GHOST_SCOUT": scout}, device_declarations())
            for scout in (0, 1)
        }

    @property
    def reach(self) -> float:
        """Half the side of the square on the plane of the first vertex through which all light comes [mm]."""
        first = self.lens.surfaces[0]
        depth = abs(float(np.nan_to_num(first.rim_sag(first.semi_diameter * (1 - 1e-9)))))
        return first.semi_diameter + depth * self.sources.tilt

    def _wider(self) -> list[Lens]:
        """Return the lens with wider stops, widest first, where few scouts would come through its own."""
        if self.lens.stop_index is None:
            return []
        pupil = self.lens.first_order().entrance_pupil.diameter_mm / 2
        factor = float(np.sqrt(SURE / SCOUTS)) * 2 * self.reach / (float(np.sqrt(np.pi)) * pupil) if pupil > 0 else 1.0
        stages = range(int(np.log(factor) / np.log(CLOSING)) + 1) if factor > 1 else range(0)
        return [with_wider_stop(self.lens, factor / CLOSING**k) for k in stages]

    def _opening(self, lens: Lens, nm: float, transmission: LensTransmission) -> Opening:
        records = WayRecords.of(lens, nm, transmission)
        return Opening(records, self.session.upload(records.stop))

    def add(
        self, film: Any, way: Way, record: int, places: Array, boxes: Array, weights: Array, first: Array, rays: int
    ) -> None:
        """Add rays of sources to a film, each with its weight in the film's colours and its lattice's first point.

        Its buffer holds whole numbers, of which `ONE_LIGHT` is 1.
        """
        self._launch(0, way, self.lenses[record], self._table(places, boxes, weights, first), len(boxes), rays, film)

    def landed(self, way: Way, opening: Opening, places: Array, boxes: Array, rays: int) -> tuple[Array, Array, Array]:
        """Return column, row and share of the light (n, rays) of rays through boxes; no share beside the film."""
        count = len(places)
        memory = self.session.allocate(12 * count * rays)
        self._launch(1, way, opening, self._table(places, boxes, np.ones((count, 3))), count, rays, memory)
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

    def _launch(self, scout: int, way: Way, opening: Opening, table: Any, count: int, rays: int, out: Any) -> None:
        surfaces = opening.records.way(way)
        launch = self.session.bind(
            self.programs[scout], "ghosts", surfaces=self.session.upload(surfaces), count=np.int32(len(surfaces)),
            stop=opening.stop, sources=table, source_count=np.uint32(count), rays=np.uint32(rays),
            film_distance=np.float32(self.film_distance), pixels=self.to_pixels.tobytes(),
            size=np.array([self.columns, self.rows], np.uint32).tobytes(), film=out,
        )  # fmt: skip
        launch.enqueue(count * rays // self.session.lanes, GROUP)
