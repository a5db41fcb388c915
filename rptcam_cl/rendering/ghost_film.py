"""The light of ghosts on a film: rays of every pair of reflecting surfaces, shared out by the light that they bring.

Some rays over the whole front find where the light of a pair enters, and some more there how much of it arrives, at
which wavelengths and where. The others are then shared out so that the film errs least, and added in whole numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.cameras import WayRecords, ghost_setting
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device import Session
from rptcam_cl.optics import Lens
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.buffers import SceneBuffers
from rptcam_cl.rendering.ghost_colours import bands
from rptcam_cl.rendering.ghost_sources import Sources, ghost_sources
from rptcam_cl.scene import Scene

Array = NDArray[np.float64]
Way = tuple[int, ...]

SCOUTS = 1024  # rays of a source over the whole front, for each way
SECOND_SCOUTS = 4096  # of all sources and wavelengths of a way, where the first have found light
LEAST_SHARE = 1e-3  # of all ghosts in each colour, below which a way is left out
CELLS = (24, 16)  # columns and rows of the coarse film by which rays are shared out
DARK = 0.2  # of the mean light: darker cells are no reason for more rays
PER_PIXEL, LEAST_RAYS, MOST_RAYS = 40.0, 1 << 20, 1 << 25  # of all ways
SHARING = 0.7  # power to which ways share rays: between alike and by what each needs, found by trial
WIDTH, FINER = 1.7, 1.6  # of the spread of a way's light [pixels], by trial; ratio of one width to the next
LEAST_SPREAD = 2  # steps from one pixel, below which the points of a sun would show
ONE_LIGHT = float(1 << 36)  # units of the device's whole numbers
GROUP = 4
STEP = 2654435769 / (1 << 32)  # of the lattices, the kernel's
PLASTIC = np.array([0.7548776662466927, 0.5698402909980532])  # steps of the plane's plastic sequence (Roberts 2018)


@dataclass(frozen=True)
class _Scouted:
    """What some rays say of a way.

    Attributes
    ----------
    boxes : (n, 4) array
        Of each source on the plane of the first vertex: corner and sides [mm]; without sides where nothing arrives.
    flux : (waves, 3) array
        Of all sources on the film, of each wavelength in the film's colours [W/m2 mm2].
    cells : (rows, columns, waves) array
        Share of each wavelength's flux in the cells of a coarse film.
    arriving : float
        Share of rays through the boxes that reach the film.
    largest : float
        Largest share of a ray's light that arrives.
    """

    boxes: Array
    flux: Array
    cells: Array
    arriving: float
    largest: float


class GhostFilm:
    """The film of a scene under the light of ghosts."""

    def __init__(self, scene: Scene, plan: Plan, session: Session) -> None:
        self.plan, self.session = plan, session
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
        pixel_mm2 = 1e6 * width * height / (self.columns * self.rows)
        self.value = float(plan.camera.metadata["values_per_irradiance"]) / pixel_mm2  # of 1 W/m2 over 1 mm2
        pencils = int(self.sources.mirrored > 0)
        facts = self.records[0].facts | {"VW": session.lanes, "DOUBLE": 0, "GHOST_PENCILS": pencils}
        self.programs = {
            scout: session.program(["pass/ghosts.cl"], facts | {"GHOST_SCOUT": scout}, device_declarations())
            for scout in (0, 1)
        }
        self.stop = session.upload(self.records[0].stop)

    def light(self) -> tuple[Array, dict[str, Any]]:
        """Return the film's values (rows, columns, 3) of all ghosts, and what metadata should say."""
        metadata: dict[str, Any] = {"sources": len(self.sources.places)}
        if self.sources.mirrored:
            metadata["mirrored"] = self.sources.mirrored
        if self.sources.left_out:
            metadata["left_out"] = list(self.sources.left_out)
        if not len(self.sources.places):
            return np.zeros((self.rows, self.columns, 3)), metadata | {"ways": 0, "dropped_share": 0.0}
        scouted = {way: self._scouted(way) for way in _pairs(self.lens)}
        fluxes = {way: found.flux.sum(axis=0) for way, found in scouted.items()}
        total = sum(fluxes.values())
        kept = {way: found for way, found in scouted.items() if np.any(fluxes[way] > LEAST_SHARE * total)}
        dropped = 1.0 - float(sum(fluxes[way].sum() for way in kept) / total.sum()) if kept else 0.0
        dropped = 1.0 - (1.0 - dropped) * (1.0 - self.sources.dropped_share)
        film = self._splatted(kept) if kept else np.zeros((self.rows, self.columns, 3))
        return film, metadata | {"ways": len(kept), "dropped_share": dropped}

    def _table(self, places: Array, boxes: Array, weights: Array, first: ArrayLike = (0.5, 0.0)) -> Any:
        """Return sources with their boxes, weights (n, 3) and first points of their lattices on the device."""
        table = np.zeros((len(boxes), 3 + places.shape[1] // 4, 4), np.float32)
        table[:, 0], table[:, 1], table[:, 2, :3], table[:, 3, :2] = places[:, :4], boxes, weights, first
        table[:, 4:] = places[:, 4:].reshape(len(boxes), -1, 4)
        return self.session.upload(table)

    def _launched(self, scout: int, way: Way, record: int, table: Any, count: int, rays: int, out: Any) -> None:
        surfaces = self.records[record].way(way)
        launch = self.session.bind(
            self.programs[scout], "ghosts", surfaces=self.session.upload(surfaces), count=np.int32(len(surfaces)),
            stop=self.stop, sources=table, source_count=np.uint32(count), rays=np.uint32(rays),
            film_distance=np.float32(self.film_distance), pixels=self.to_pixels.tobytes(),
            size=np.array([self.columns, self.rows], np.uint32).tobytes(), film=out,
        )  # fmt: skip
        launch.enqueue(count * rays // self.session.lanes, GROUP)

    def _landed(self, way: Way, record: int, places: Array, boxes: Array, rays: int) -> tuple[Array, Array, Array]:
        """Return column, row and share of the light (n, rays) of rays through boxes; no share beside the film."""
        count = len(places)
        memory = self.session.allocate(12 * count * rays)
        self._launched(1, way, record, self._table(places, boxes, np.ones((count, 3))), count, rays, memory)
        landed = self.session.read(memory, np.float32, 3 * count * rays).astype(np.float64)
        x, y, share = landed.reshape(3, count, rays)
        columns, rows = self.to_pixels[0] + self.to_pixels[1] * x, self.to_pixels[2] + self.to_pixels[3] * y
        with np.errstate(invalid="ignore"):
            inside = (share > 0) & (columns >= 0) & (rows >= 0) & (columns < self.columns) & (rows < self.rows)
        return columns, rows, np.where(inside, share, 0.0)

    def _boxes(self, way: Way) -> Array:
        """Return where the light of a way enters (n, 4), by rays over the whole front at a middle wavelength."""
        count, first = len(self.sources.places), self.lens.surfaces[0]
        depth = abs(float(np.nan_to_num(first.rim_sag(first.semi_diameter * (1 - 1e-9)))))
        reach = first.semi_diameter + depth * self.sources.tilt
        whole = np.tile([-reach, -reach, 2 * reach, 2 * reach], (count, 1))
        inside = self._landed(way, len(self.records) // 2, self.sources.places, whole, SCOUTS)[2] > 0
        numbers = np.arange(SCOUTS, dtype=np.uint64)
        u = (numbers + 0.5) / SCOUTS
        v = ((numbers * 2654435769 % (1 << 32)) >> 8).astype(np.float64) / (1 << 24)
        boxes, margin = np.zeros((count, 4)), 1.5 / np.sqrt(SCOUTS)
        for source in np.flatnonzero(inside.any(axis=1)):
            rays = inside[source]
            low = np.clip([u[rays].min() - margin, v[rays].min() - margin], 0.0, 1.0)
            high = np.clip([u[rays].max() + margin, v[rays].max() + margin], 0.0, 1.0)
            boxes[source] = [*(low * 2 * reach - reach), *((high - low) * 2 * reach)]
        return boxes

    def _scouted(self, way: Way) -> _Scouted:
        """Return how much light a way brings at each wavelength, and where."""
        boxes, waves = self._boxes(way), len(self.records)
        flux, cells = np.zeros((waves, 3)), np.zeros((CELLS[1], CELLS[0], waves))
        sent, arrived, largest = 0, 0, 0.0
        for record in range(waves):
            lit = self._lit(boxes, record)
            own, light = boxes[lit], self.bands[record].light[lit]
            if not len(own):
                continue
            rays = self._steps(SECOND_SCOUTS / (len(own) * waves))
            area = (own[:, 2] * own[:, 3] / rays)[:, None]
            x, y, share = self._landed(way, record, self.sources.places[lit], own, rays)
            flux[record] = np.abs((share.sum(axis=1)[:, None] * area * light).sum(axis=0))
            hits = share > 0
            at = [(place[hits] * cell / size).astype(int)
                  for place, cell, size in ((y, CELLS[1], self.rows), (x, CELLS[0], self.columns))]  # fmt: skip
            carried = (share * area * np.abs(light).sum(axis=1)[:, None])[hits]
            np.add.at(cells[..., record], tuple(at), carried / max(float(carried.sum()), 1e-300))
            sent, arrived = sent + rays * len(own), arrived + int(hits.sum())
            largest = max(largest, float(share.max()))
        return _Scouted(boxes, flux, cells, max(arrived / max(sent, 1), 1e-3), largest)

    def _lit(self, boxes: Array, record: int) -> NDArray[np.bool_]:
        """Return which sources shine at a wavelength and have boxes."""
        return np.asarray((boxes[:, 2] > 0) & self.bands[record].light.any(axis=1))

    def _steps(self, rays: float) -> int:
        """Return a number of rays of a source that fills whole work groups."""
        step = self.session.lanes * GROUP
        return max(int(np.ceil(rays / step)) * step, step)

    def _rays(self, kept: Mapping[Way, _Scouted]) -> dict[Way, Array]:
        """Return how many rays each wavelength of each way gets.

        The mean square of what light on a pixel errs by, relative to all light there, is least when rays are shared
        out by flux / light (Cauchy and Schwarz), over the root of the share of the rays that arrive. Wide faint ways
        are spread more, and need less.
        """
        light = sum(np.einsum("ijk,kc->ijc", found.cells, found.flux) for found in kept.values())
        light = np.maximum(light, DARK * light.mean(axis=(0, 1)))
        weights = {}
        for way, found in kept.items():
            over = np.einsum("ijk,ijc->kc", found.cells, 1.0 / np.maximum(light, 1e-100) ** 2)
            needs = np.sqrt(np.sum(found.flux**2 * over, axis=1))
            weights[way] = needs * needs.sum() ** (SHARING - 1.0) / np.sqrt(found.arriving)
        total = float(np.clip(PER_PIXEL * self.rows * self.columns, LEAST_RAYS, MOST_RAYS))
        scale = total / sum(float(weight.sum()) for weight in weights.values())
        return {way: scale * weight for way, weight in weights.items()}

    def _spread_steps(self, found: _Scouted, rays: float) -> int:
        """Return over how many steps of `FINER` from one pixel the light of a way is spread, which has got some rays.

        What is spread over a width w errs at its edges, as the edges' length times w, and has noise, as 1 / rays / w^2:
        together least where w^3 goes as the root of the area over the rays that arrive on a pixel of it.
        """
        shares = found.cells.mean(axis=2)
        area = shares.sum() ** 2 / np.sum(shares**2) * self.rows * self.columns / shares.size
        width = WIDTH * np.cbrt(area**1.5 / (rays * found.arriving))
        return max(round(float(np.log(width) / np.log(FINER))), LEAST_SPREAD)

    def _splatted(self, kept: Mapping[Way, _Scouted]) -> Array:
        """Return the light of ways on the film, each spread by its own width."""
        rays, largest = self._rays(kept), 0.0
        launches: dict[int, list[Any]] = {}
        for way, found in kept.items():
            alike = launches.setdefault(self._spread_steps(found, float(rays[way].sum())), [])
            for record, band in enumerate(self.bands):
                lit = self._lit(found.boxes, record)
                boxes = found.boxes[lit]
                if not len(boxes):
                    continue
                count = self._steps(rays[way][record] / len(boxes))
                weights = band.light[lit] * (boxes[:, 2] * boxes[:, 3] / count)[:, None]
                largest = max(
                    largest, float(np.abs(weights).max()) * 4.0 * found.largest
                )  # a ray may bring more than scouts
                alike.append((way, record, self.sources.places[lit], boxes, weights, count))
        film = np.zeros((self.rows, self.columns, 3))
        for steps, alike in sorted(launches.items()):
            words = self.session.allocate(8 * film.size, zeroed=True)
            for way, record, places, boxes, weights, count in alike:
                first = _shifts(len(boxes) * record + np.arange(len(boxes)), count)
                table = self._table(places, boxes, weights / largest, first)
                self._launched(0, way, record, table, len(boxes), count, words)
            units = self.session.read(words, "<i8", film.size).astype(np.float64)
            film += _spread(units.reshape(film.shape), FINER**steps)
        return film * (largest / ONE_LIGHT * self.value)


def _shifts(numbers: NDArray[np.intp], rays: int) -> Array:
    """Return where lattices begin (n, 2) so that all of them together, and some in a row, are even as well.

    The first coordinate is in points of the lattice. They are points of the plane's plastic sequence (Roberts 2018) in
    the shortest basis of the lattice (n / rays, n g mod 1), which Gauss's reduction finds.
    """
    a, b = np.array([1.0 / rays, STEP]), np.array([0.0, 1.0])
    while True:
        a, b = (a, b) if a @ a <= b @ b else (b, a)
        steps = np.rint(a @ b / (a @ a))
        if steps == 0:
            break
        b = b - steps * a
    u, v = (np.mod(numbers[:, None] * PLASTIC + 0.5, 1.0) @ np.array([a, b])).T
    whole = np.floor(u * rays)
    return np.column_stack([u * rays - whole, np.mod(v - whole * STEP, 1.0)])


def _pairs(lens: Lens) -> Iterator[Way]:
    """Yield the pairs of surfaces that reflect: the first one, and one before it."""
    indices = lens.indices(550.0)
    partly = [k for k, s in enumerate(lens.surfaces) if not s.is_mirror and indices[k] != indices[k + 1]]
    for j in partly:
        yield from ((j, i) for i in partly if i < j)


def _spread(film: Array, width: float) -> Array:
    """Return a film whose light is spread by a tent of a half width [pixels], and mirrored at its border."""
    reach = int(np.ceil(width))
    tent = np.maximum(width - np.abs(np.arange(-reach, reach + 1)), 0.0)
    tent /= tent.sum()
    if len(tent) <= 3 and tent[1] == 1.0:
        return film
    for axis in (0, 1):
        widths = [(0, 0)] * 3
        widths[axis] = (reach, reach)
        padded = np.pad(film, widths, mode="symmetric")
        size = film.shape[axis]
        film = np.zeros_like(film)
        for i, weight in enumerate(tent):
            film += weight * (padded[i : i + size] if axis == 0 else padded[:, i : i + size])
    return film
