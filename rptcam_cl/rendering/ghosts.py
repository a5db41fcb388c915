"""Ghosts in a picture: light of lamps and suns that surfaces of the lens reflect onto the film.

Light is sent from its sources through every pair of reflecting surfaces, and added to the film in whole numbers: the
result depends on the scene alone, not on samples, waves or devices that share them. docs/flare.md has its limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import device_declarations
from rptcam_cl.core.remember import checkpoint, is_cancellable, remember
from rptcam_cl.device.session import Session
from rptcam_cl.optics import as_built, irradiance
from rptcam_cl.optics import ghosts as lens_ghosts
from rptcam_cl.optics.ghosts import Way, steps
from rptcam_cl.optics.glass import Interface
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import LensTransmission
from rptcam_cl.rendering.cameras.lens_records import WayRecords, ghost_setting
from rptcam_cl.rendering.cameras.pupil import by_content
from rptcam_cl.rendering.film import FilmLayout, array_of_text, text_of_array
from rptcam_cl.rendering.highlights import with_highlights
from rptcam_cl.rendering.lamps import WAVES_NM, bands, sources_of
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.point_spread import shares_of_white
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.scene.camera import SensorGrating
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]

_RADII, _DIMMEST = 13, 1e-3  # of the film, at which its light is known for scatter; least share of the middle's
_SINES, _BESIDE = 1000, 1e9  # steps from the axis to a corner; distance [mm] of what no place of the film sees
_CLOSE = 0.1  # part of their distance from the picture, within which sources scatter as one: within 0.5 %

# Rays of ghosts: from the sources of a scene through boxes on the front of its lens, by a pair of its surfaces.


@dataclass(frozen=True)
class _Opening:
    """A lens at the wavelengths of a band [nm], and the shape of its stop on the device."""

    records: WayRecords
    stop: Any
    nm: float
    half_nm: float


Lit = NDArray[np.bool_] | NDArray[np.intp]
"""Which sources."""
Counts = NDArray[np.intp]
"""Of rays, each a power of two of work groups."""

GROUP = 4
SCOUTS = 1024  # rays of a source that look for the light of each way
SURE = 32.0  # of them that shall come through the opening; where fewer would, they look through wider ones first
LATTICE = 2654435769  # over 2^32, the second coordinate's step from ray to ray: the kernel's
ONE_LIGHT = float(1 << 36)  # units of the device's whole numbers


# What some rays say of the light of ghosts by a pair of surfaces: where it enters, how much arrives, and where.

MORE = 4  # times as many over the whole front, where the opening is small in it
_SECOND_SCOUTS = 6144  # of all sources and wavelengths of a way, where the first have found light
CELLS = (24, 16)  # columns and rows of the coarse film by which rays are shared out


@dataclass(frozen=True)
class Scouted:
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
    by_source : (n,) array
        Share of each source in each wavelength's flux, added up.
    stands_for : float
        How many ways like it it stands for.
    """

    boxes: Array
    flux: Array
    cells: Array
    arriving: float
    largest: float
    by_source: Array
    stands_for: float = 1.0


#
# The light of ghosts on a film: rays of every pair of reflecting surfaces, shared out by the light that they bring.
#
# Scouts tell how much light each pair brings, and where. The others are shared out so that the film errs least, and
# added in whole numbers.

LEAST_SHARE = 1e-3  # of all ghosts in each colour, below which a way is left out
DARK = 0.2  # of the mean light: darker cells are no reason for more rays
PER_PIXEL, _LEAST_RAYS, MOST_RAYS = 40.0, 1 << 20, 1 << 23  # of all ways
_SHARING_LAMPS, _FAINTEST = 0.7, 1e-4  # the same of its sources; least part of the brightest that one counts
MOST_OF_FOUR = 256  # ways of four reflections that are traced, and stand for all of them
_VEIL = 1 / 12  # of the film's longer side, over which the light of a way that stands for others is spread at least
_ON_THE_AXIS = 0.1  # weight of a source there, by which they are chosen as well as by the brightest
_WIDEST = 3.5  # spreads of the film's grating, beyond which its orders have nothing
_SHARING = 0.7  # power to which ways share rays: between alike and by what each needs, found by trial
WIDTH, FINER = 1.4, 1.6  # of the spread of a way's light [pixels], by trial; ratio of one width to the next
LEAST_SPREAD = 2  # steps from one pixel, below which the points of a sun would show
STEP = LATTICE / (1 << 32)
_BAND = 32  # rows of a film that are spread at once
PLASTIC = np.array([0.7548776662466927, 0.5698402909980532])  # steps of the plane's plastic sequence (Roberts 2018)


class GhostFilm:
    """The film of a scene under the light of ghosts."""

    def __init__(self, scene: Scene, plan: Plan, session: Session) -> None:
        self.session = session
        setting = ghost_setting(scene)
        self.lens, self.film_distance, self.transmission = setting.lens, setting.film_distance_mm, setting.transmission
        camera = scene.camera.traced_camera
        self.order = 2 if camera is None else camera.ghost_order
        film_z = self.lens.film_z(self.film_distance)
        buffers = SceneBuffers(session, plan)
        about = scene, plan, buffers, session, self.lens, film_z
        direct, far = sources_of(*about)
        self.sources = with_highlights(direct, far, *about)
        self.grating = None if camera is None else camera.sensor_grating
        self.bands = bands(scene, plan, setting, self.sources, tinted=self.grating is not None)
        self.lenses = [self._opening(self.lens, band.nm, band.half_nm) for band in self.bands]
        middle = len(self.bands) // 2
        wider = [self._opening(lens, self.bands[middle].nm, 0.0) for lens in self._wider()]
        self.openings = [*wider, self.lenses[middle]]
        (self.columns, self.rows), (width, height) = scene.film.resolution, scene.film.size_m()
        sense = -1.0 if scene.camera.flip else 1.0
        across, down = sense * self.columns / (1e3 * width), -sense * self.rows / (1e3 * height)
        self.to_pixels = np.array([self.columns / 2, across, self.rows / 2, down], np.float32)
        pixel_mm2 = 1e6 * width * height / (self.columns * self.rows)
        self.value = plan.camera.metadata["values_per_irradiance"] / pixel_mm2  # of 1 W/m2 over 1 mm2
        self.shape = (self.rows, self.columns, 3)
        places, patches = self.sources.places, self.sources.patches
        self.lamp_of = np.unique(self.sources.known[:, 2], return_inverse=True)[1]
        pencils, sized = int(self.sources.mirrored > 0), int(patches.first.any())
        self.light_rows = np.concatenate([places[:, :4], patches.rows()[:, : 20 * sized], places[:, 4:]], axis=1)
        facts = self.lenses[0].records.facts | {"VW": session.lanes, "DOUBLE": 0}
        facts |= {"GHOST_PENCILS": pencils, "GHOST_PATCHES": sized}
        self.programs = [
            session.program(
                ["pass/ghosts.cl"], facts | {"GHOST_SCOUT": scout, "GHOST_GRATING": grating}, device_declarations()
            )
            for grating in range(1 + (self.grating is not None))
            for scout in (0, 1)
        ]
        if self.grating is not None:
            self._add_grating(self.grating, 500.0 * width, 500.0 * height)

    def _add_grating(self, grating: SensorGrating, *half_mm: float) -> None:
        """Make the lenses whose last surface is the film, and the shares of the film's orders."""
        all_nm = (WAVES_NM[-1] - WAVES_NM[0]) / 2 + self.bands[0].half_nm  # boxes are those of every colour
        middle = len(self.bands) // 2

        def mirrored(lens: Lens, nm: float, half_nm: float) -> _Opening:
            return self._opening(lens_ghosts.with_film(lens, self.film_distance, 1.0), nm, half_nm)

        self.mirrored = [mirrored(self.lens, band.nm, band.half_nm) for band in self.bands]
        self.mirrored_openings = [mirrored(lens, self.bands[middle].nm, all_nm) for lens in [*self._wider(), self.lens]]
        self.half_mm, self.pitch_nm = half_mm, 1e3 * grating.pitch_um
        most = math.ceil(_WIDEST * grating.spread * self.pitch_nm / WAVES_NM[0])
        orders = np.arange(-most, most + 1)
        shares = np.exp(-0.5 * (orders * WAVES_NM[len(WAVES_NM) // 2] / self.pitch_nm / grating.spread) ** 2)
        table = np.zeros((len(orders), 4), np.float32)
        table[:, 0], table[:, 1] = orders, np.cumsum(shares) / shares.sum()
        self.orders, self.order_count = self.session.upload(table), len(orders)

    def _is_of_grating(self, way: Way) -> bool:
        return way[0] == len(self.lens.surfaces)

    def _lens_of(self, way: Way, record: int) -> _Opening:
        """Return the lens of a way in a band, with the film as a mirror where that reflects first."""
        return (self.mirrored if self._is_of_grating(way) else self.lenses)[record]

    @property
    def _reach(self) -> float:
        """Half the side of the square on the plane of the first vertex through which all light comes [mm]."""
        first = self.lens.surfaces[0]
        depth = abs(float(np.nan_to_num(first.rim_sag(first.semi_diameter * (1 - 1e-9)))))
        return first.semi_diameter + depth * self.sources.tilt

    def _wider(self) -> list[Lens]:
        """Return the lens with wider stops, widest first, where few scouts would come through its own."""
        if self.lens.stop_index is None:
            return []
        pupil = self.lens.first_order().entrance_pupil.diameter_mm / 2
        factor = float(np.sqrt(SURE / SCOUTS)) * 2 * self._reach / (float(np.sqrt(np.pi)) * pupil) if pupil > 0 else 1.0
        return lens_ghosts.with_wider_stops(self.lens, factor) if factor > 1 else []

    def _opening(self, lens: Lens, nm: float, half_nm: float) -> _Opening:
        records = WayRecords.of(lens, nm, self.transmission)
        return _Opening(records, self.session.upload(records.stop), nm, half_nm)

    def _land(self, way: Way, opening: _Opening, which: Lit, boxes: Array, rays: int) -> tuple[Array, Array, Array]:
        """Return column, row and share of the light (n, rays) of rays through boxes; no share beside the film."""
        count = len(boxes)
        memory, counts = self.session.allocate(12 * count * rays), np.full(count, rays)
        self._launch(1, way, opening, self._table(which, boxes, np.ones((count, 3)), counts), counts, memory)
        landed = self.session.read(memory, np.float32, 3 * count * rays).astype(np.float64)
        x, y, share = landed.reshape(3, count, rays)
        columns, rows = self.to_pixels[0] + self.to_pixels[1] * x, self.to_pixels[2] + self.to_pixels[3] * y
        with np.errstate(invalid="ignore"):
            inside = (share > 0) & (columns >= 0) & (rows >= 0) & (columns < self.columns) & (rows < self.rows)
        return columns, rows, np.where(inside, share, 0.0)

    def _lit(self, boxes: Array, record: int) -> NDArray[np.bool_]:
        """Find the sources that shine at a wavelength and have boxes."""
        return np.asarray((boxes[:, 2] > 0) & self.bands[record].light.any(axis=1))

    def _whole_groups(self, rays: ArrayLike) -> Any:
        """Return numbers of rays of sources that fill whole work groups, each a power of two of them."""
        step = self.session.lanes * GROUP
        return step << np.rint(np.log2(np.maximum(np.asarray(rays) / step, 1.0))).astype(int)

    def _table(
        self, which: Lit, boxes: Array, weights: Array, rays: Counts, first: ArrayLike = (0.5, 0.0, 0.0, 0.0)
    ) -> Any:
        """Return sources with boxes, weights (n, 3), rays and first points of their lattices on the device."""
        light = self.light_rows[which].reshape(len(boxes), -1, 4)
        table = np.zeros((len(boxes), 4 + light.shape[1], 4), np.float32)
        table[:, 0], table[:, 5:] = light[:, 0], light[:, 1:]
        table[:, 1], table[:, 2, :3], table[:, 3] = boxes, weights, first
        share = table.view(np.uint32)[:, 4]
        share[:, 0], share[:, 1] = (np.cumsum(rays) - rays) // self.session.lanes, rays
        share[:, 2] = [_basis(int(each))[1] for each in rays]
        return self.session.upload(table)

    def _launch(self, scout: int, way: Way, opening: _Opening, table: Any, counts: Counts, out: Any) -> None:
        surfaces, items = opening.records.way(way), int(counts.sum()) // self.session.lanes
        more: dict[str, Any] = {}
        if grating := self._is_of_grating(way):
            surfaces = surfaces[:-1]  # it ends on the film
            sines = (opening.nm - opening.half_nm) / self.pitch_nm, 2.0 * opening.half_nm / self.pitch_nm
            more = {"orders": self.orders, "order_count": np.int32(self.order_count), "film_at": np.int32(way[0]),
                    "grating": np.array([*sines, *self.half_mm], np.float32).tobytes()}  # fmt: skip
        launch = self.session.bind(
            self.programs[2 * grating + scout], "ghosts", surfaces=self.session.upload(surfaces),
            count=np.int32(len(surfaces)), stop=opening.stop, sources=table, source_count=np.uint32(len(counts)),
            items=np.uint32(items), film_distance=np.float32(self.film_distance), pixels=self.to_pixels.tobytes(),
            size=np.array([self.columns, self.rows], np.uint32).tobytes(), film=out, **more,
        )  # fmt: skip
        launch.enqueue(items, GROUP)

    def _scout(self, way: Way) -> Scouted:
        """Look by some rays how much light a way brings at each wavelength, and where."""
        checkpoint()
        boxes, waves = self._boxes(way), len(self.lenses)
        flux, cells = np.zeros((waves, 3)), np.zeros((CELLS[1], CELLS[0], waves))
        sent, arrived, largest, by_source = 0, 0, 0.0, np.zeros(len(boxes))
        for record in range(waves):
            lit = self._lit(boxes, record)
            own, light = boxes[lit], self.bands[record].light[lit]
            if not len(own):
                continue
            sample = int(self._whole_groups(_SECOND_SCOUTS / (len(own) * waves)))
            area = (own[:, 2] * own[:, 3] / sample)[:, None]
            x, y, share = self._land(way, self._lens_of(way, record), lit, own, sample)
            flux[record] = np.abs((share.sum(axis=1)[:, None] * area * light).sum(axis=0))
            hits = share > 0
            at = [(place[hits] * cell / size).astype(int)
                  for place, cell, size in ((y, CELLS[1], self.rows), (x, CELLS[0], self.columns))]  # fmt: skip
            brought = share * area * np.abs(light).sum(axis=1)[:, None]
            brought /= max(float(brought.sum()), 1e-300)
            by_source[lit] += brought.sum(axis=1)
            np.add.at(cells[..., record], tuple(at), brought[hits])
            sent, arrived = sent + sample * len(own), arrived + int(hits.sum())
            largest = max(largest, float(share.max()))
        return Scouted(boxes, flux, cells, max(arrived / max(sent, 1), 1e-3), largest, by_source)

    def _boxes(self, way: Way) -> Array:
        """Return where the light of a way enters (n, 4), by rays over the whole front at a middle wavelength.

        Where few of them would find a small opening, they look for the ways through wider ones first.
        """
        reach = self._reach
        boxes = np.tile([-reach, -reach, 2 * reach, 2 * reach], (len(self.sources.places), 1))
        openings = self.mirrored_openings if self._is_of_grating(way) else self.openings
        for stage, opening in enumerate(openings):
            first_of_several = stage == 0 and len(openings) > 1
            boxes = self._narrow(way, boxes, opening, MORE * SCOUTS if first_of_several else SCOUTS)
        return boxes

    def _narrow(self, way: Way, boxes: Array, opening: _Opening, scouts: int) -> Array:
        """Return the part of each box (n, 4) through which light gets to the film, some room about it."""
        lit = np.flatnonzero(boxes[:, 2] > 0)
        narrow, margin = np.zeros_like(boxes), 1.5 / np.sqrt(scouts)
        if not len(lit):
            return narrow
        inside = self._land(way, opening, lit, boxes[lit], scouts)[2] > 0
        numbers = np.arange(scouts, dtype=np.uint64) * _basis(scouts)[1] % scouts
        u = (numbers + 0.5) / scouts
        v = ((numbers * LATTICE % (1 << 32)) >> 8).astype(np.float64) / (1 << 24)
        for source, hit in zip(lit, inside, strict=True):
            if hit.any():
                low = np.clip([u[hit].min() - margin, v[hit].min() - margin], 0.0, 1.0)
                high = np.clip([u[hit].max() + margin, v[hit].max() + margin], 0.0, 1.0)
                corner, sides = boxes[source, :2], boxes[source, 2:]
                narrow[source] = [*(low * sides + corner), *((high - low) * sides)]
        return narrow

    def light(self) -> tuple[Array, dict[str, Any]]:
        """Return the film's values (rows, columns, 3) of all ghosts, and what metadata should say."""
        sources = self.sources
        metadata: dict[str, Any] = {"sources": len(sources.places)}
        if sources.mirrored:
            metadata["mirrored"] = sources.mirrored
        if sources.left_out:
            metadata["left_out"] = list(sources.left_out)
        if not len(sources.places):
            return np.zeros(self.shape), metadata | {"ways": 0, "dropped_share": 0.0}
        scouted = {way: self._scout(way) for way in lens_ghosts.pairs_of(self.lens)}
        fluxes = {way: one.flux.sum(axis=0) for way, one in scouted.items()}
        total = sum(fluxes.values())
        kept = {way: one for way, one in scouted.items() if np.any(fluxes[way] > LEAST_SHARE * total)}
        ways = {"ways": len(kept)}
        if self.order == 4:
            chosen, of_all = self._ways_of_four()
            more = self._scout_more(chosen)
            kept, ways = kept | more, ways | {"ways_of_four": len(more), "of_four": of_all}
        if self.grating is not None:
            film, partly = len(self.lens.surfaces), sorted({k for way in scouted for k in way})
            more = self._scout_more({(film, k): self.grating.reflectance for k in partly})
            kept, ways = kept | more, ways | {"ways_of_grating": len(more)}
        fluxes |= {way: one.flux.sum(axis=0) for way, one in kept.items()}
        total = sum(fluxes.values())
        dropped = 1.0 - float(sum(fluxes[way].sum() for way in kept) / total.sum()) if kept else 0.0
        dropped = 1.0 - (1.0 - dropped) * (1.0 - sources.dropped_share)
        light = self._splat(kept) if kept else np.zeros(self.shape)
        return light, metadata | ways | {"dropped_share": dropped}

    def _scout_more(self, ways: Mapping[Way, float]) -> dict[Way, Scouted]:
        """Look for the light of ways that stand for so many; leave out those that bring none."""
        found = {way: self._scout(way) for way in ways}
        return {way: replace(one, flux=ways[way] * one.flux, stands_for=ways[way])
                for way, one in found.items() if one.flux.any()}  # fmt: skip

    def _ways_of_four(self) -> tuple[dict[Way, float], int]:
        """Return some ways of four reflections with how many like it each stands for, and the number of all that count.

        Those that bring most are taken as they are. Others are taken in equal steps of their light, so that the sum of
        the light is about that of all (systematic sampling by size).
        """
        turns, at = (
            lens_ghosts.ways_of_four(self.lens),
            self.sources.places[int(np.argmax(luminance(self.sources.irradiance)))],
        )
        waves = np.array([band.nm for band in self.bands])
        away, slopes = -at[2] if at[3] == 1.0 else np.inf, np.array([np.hypot(at[0], at[1]) / abs(at[2]), 0.0])
        film = self.film_distance, float(np.hypot(self.columns / self.to_pixels[1], self.rows / self.to_pixels[3]) / 2)
        passed = _passed_shares(self.lens, self.transmission, waves)
        by_slope = lens_ghosts.light_by_paraxial_rays(self.lens, turns, film, passed, away, slopes)
        light = by_slope[0] + _ON_THE_AXIS * by_slope[1]
        return _some_by_size(turns, light, MOST_OF_FOUR), int(np.count_nonzero(light))

    def beside(self, front: Mapping[str, Any], layout: FilmLayout) -> tuple[Array, Array]:
        """Return sources for `scattered_from_beside`: those whose light does not go to the rendered part of the film.

        Parts of a lamp are taken as one where they lie close together, beside their distance from the picture.
        """
        ways = np.where(self.sources.places[:, 3:4] == 1, -1.0, 1.0) * self.sources.places[:, :3]
        ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
        light = sum((band.light for band in self.bands), np.zeros((len(ways), 3))) * ways[:, 2:]
        sines, (x0, dx, y0, dy) = ways[:, :2] * np.sign(self.to_pixels[1::2]), front["pixels_mm"]
        radii = np.linspace(0.0, front["lit"][0][-1], _SINES)
        of_radii, sine = radii * np.polynomial.Polynomial(front["sines"])(radii**2), np.hypot(*sines.T)
        places = sines * (np.interp(sine, of_radii, radii, right=_BESIDE) / np.maximum(sine, 1e-12))[:, None]
        out = ~layout.holds((places - [x0, y0]) / [dx, dy] + [layout.x, layout.y])
        sines, light, (_, lamp) = sines[out], light[out], np.unique(self.lamp_of[out], return_inverse=True)
        corners = np.array([[x0, y0], [x0 + dx * layout.width, y0 + dy * layout.height]]) * front["sines"][0]
        weight = luminance(light)

        def together(groups: NDArray[np.intp]) -> Array:
            return (np.array([np.bincount(groups, weight * each) for each in sines.T]) / np.bincount(groups, weight)).T

        away = np.linalg.norm(sines - np.clip(sines, *corners), axis=1)
        near = np.linalg.norm(sines - together(lamp)[lamp], axis=1) < _CLOSE * away
        as_one = np.bincount(lamp, ~near) == 0
        groups = np.unique(np.where(as_one[lamp], lamp, len(lamp) + np.arange(len(lamp))), return_inverse=True)[1]
        return together(groups), np.column_stack([np.bincount(groups, each) for each in light.T])

    def _share_out(self, kept: Mapping[Way, Scouted]) -> dict[Way, Array]:
        """How many rays each wavelength of each way gets.

        The mean square of what light on a pixel errs by, relative to all light there, is least when rays are shared
        out by flux / light (Cauchy and Schwarz), over the root of the share of the rays that arrive. Wide faint ways
        are spread more, and need less.
        """
        light = sum(np.einsum("ijk,kc->ijc", one.cells, one.flux) for one in kept.values())
        light = np.maximum(light, DARK * light.mean(axis=(0, 1)))
        weights = {}
        for way, one in kept.items():
            over = np.einsum("ijk,ijc->kc", one.cells, 1.0 / np.maximum(light, 1e-100) ** 2)
            needs = np.sqrt(np.sum(one.flux**2 * over, axis=1))
            weights[way] = needs * needs.sum() ** (_SHARING - 1.0) / np.sqrt(one.arriving)
        total = float(np.clip(PER_PIXEL * self.shape[0] * self.shape[1], _LEAST_RAYS, MOST_RAYS))
        scale = total / sum(float(weight.sum()) for weight in weights.values())
        return {way: scale * weight for way, weight in weights.items()}

    def _needs(self, by_source: Array) -> Array:
        """How many rays sources want, in any unit: patches of a lamp equally many, so that they are even together."""
        lamp, patches = self.lamp_of, np.bincount(self.lamp_of)
        light = np.bincount(lamp, by_source) / patches
        return np.asarray((np.maximum(light, _FAINTEST * light.max()) ** _SHARING_LAMPS)[lamp])

    def _spread_steps(self, one: Scouted, rays: float) -> int:
        """Return over how many steps of `FINER` from one pixel the light of a way is spread, which has got some rays.

        What is spread over a width w errs at its edges, as the edges' length times w, and has noise, as 1 / rays / w^2:
        together least where w^3 goes as the root of the area over the rays that arrive on a pixel of it.
        """
        shares = one.cells.mean(axis=2)
        area = shares.sum() ** 2 / np.sum(shares**2) * self.shape[0] * self.shape[1] / shares.size
        width = WIDTH * np.cbrt(area**1.5 / (rays * one.arriving))
        if one.stands_for > 1.0:  # for others that lie elsewhere: a veil, no spot brighter than any of them
            width = max(width, _VEIL * max(self.shape[:2]))
        return max(round(float(np.log(width) / np.log(FINER))), LEAST_SPREAD)

    def _splat(self, kept: Mapping[Way, Scouted]) -> Array:
        """Return the light of ways on the film, each spread by its own width."""
        shared, largest = self._share_out(kept), 0.0
        launches: dict[int, list[Any]] = {}
        for way, one in kept.items():
            dots = self._is_of_grating(way)
            steps = LEAST_SPREAD if dots else self._spread_steps(one, float(shared[way].sum()))
            alike = launches.setdefault(steps, [])
            for record, (_, light, _) in enumerate(self.bands):
                lit = self._lit(one.boxes, record)
                boxes = one.boxes[lit]
                if not len(boxes):
                    continue
                needs = self._needs(one.by_source)[lit]
                counts = self._whole_groups(shared[way][record] * needs / needs.sum())
                weights = one.stands_for * light[lit] * (boxes[:, 2] * boxes[:, 3] / counts)[:, None]
                brightest = 4.0 * one.largest * float(np.abs(weights).max())  # a ray may bring more than scouts
                largest = max(largest, brightest)
                alike.append((way, record, lit, boxes, weights, counts))
        film, session = np.zeros(self.shape), self.session
        for width, alike in sorted(launches.items()):
            words = session.allocate(8 * film.size, zeroed=True)
            for way, record, lit, boxes, weights, counts in alike:
                checkpoint()
                first = _shifts(len(boxes) * record + np.arange(len(boxes)), counts)
                table = self._table(lit, boxes, weights / largest, counts, first)  # added up in units of `ONE_LIGHT`
                self._launch(0, way, self._lens_of(way, record), table, counts, words)
                if is_cancellable():
                    session.finish()
            units = session.read(words, "<i8", film.size).astype(np.float32)
            film += _spread_light(units.reshape(film.shape), FINER**width)
        return film * (largest / ONE_LIGHT * self.value)


def _some_by_size(ways: NDArray[np.intp], sizes: Array, most: int) -> dict[Way, float]:
    """Return so many ways (n, reflections) at most, with how many like it each stands for, by their sizes (n,)."""
    order = np.argsort(-sizes, kind="stable")[: np.count_nonzero(sizes)]
    sizes = sizes[order]
    if len(order) <= most:
        return {tuple(ways[k].tolist()): 1.0 for k in order}
    rest = np.cumsum(sizes[::-1])[::-1]  # of each and all that are smaller
    sure = int(np.argmax(sizes * (most - np.arange(len(sizes))) < rest))  # smaller ones are less than a step
    step = float(rest[sure]) / (most - sure)
    steps = np.floor(np.concatenate([[0.0], np.cumsum(sizes[sure:])]) / step + 0.5)
    taken = [*range(sure), *(sure + np.flatnonzero(np.diff(steps)))]
    return {tuple(ways[order[k]].tolist()): max(step / float(sizes[k]), 1.0) if k >= sure else 1.0 for k in taken}


def _shifts(numbers: NDArray[np.intp], rays: Counts) -> Array:
    """Return where lattices begin (n, 4) so that all of them together, and some in a row, are even as well.

    The first coordinate is in points of the lattice. They are points of the plane's plastic sequence (Roberts 2018) in
    the shortest basis of the lattice (n / rays, n g mod 1).
    """
    bases = np.array([_basis(int(each))[0] for each in rays]).reshape(-1, 2, 2)
    u, v = np.einsum("ni,nij->jn", np.mod(numbers[:, None] * PLASTIC + 0.5, 1.0), bases)
    whole = np.floor(u * rays)
    aside = np.mod(numbers[:, None] * PLASTIC[::-1] + 0.5, 1.0)  # of the points of patches
    return np.column_stack([u * rays - whole, np.mod(v - whole * STEP, 1.0), aside])


@cache
def _basis(rays: int) -> tuple[Array, int]:
    """Return the shortest basis of a lattice, by Gauss's reduction, and an odd step between numbers of neighbours."""
    a, b = np.array([1.0 / rays, STEP]), np.array([0.0, 1.0])
    while True:
        a, b = (a, b) if a @ a <= b @ b else (b, a)
        steps = np.rint(a @ b / (a @ a))
        if steps == 0:
            break
        b = b - steps * a
    numbers = [round(float(way[0]) * rays) % rays for way in (a, b, a + b)]
    return np.array([a, b]), next(number for number in numbers if number % 2)


def _spread_light(film: NDArray[Any], width: float) -> NDArray[Any]:
    """Return a film whose light is spread by a tent of a half width [pixels], and mirrored at its border."""
    reach = int(np.ceil(width))
    tent = np.maximum(width - np.abs(np.arange(-reach, reach + 1)), 0.0)
    tent /= tent.sum()
    band = sum(weight * np.eye(_BAND, _BAND + 2 * reach, k) for k, weight in enumerate(tent)).astype(film.dtype)
    for _ in range(2):  # along the rows, and along the columns
        size, flat = len(film), film.reshape(len(film), -1)
        places = np.arange(-reach, size + reach) % (2 * size)
        mirrored, spread = np.minimum(places, 2 * size - 1 - places), np.empty_like(flat)
        for first in range(0, size, _BAND):
            out = spread[first : first + _BAND]
            wide = len(out) + 2 * reach
            np.matmul(band[: len(out), :wide], flat[mirrored[first : first + wide]], out=out)
        film = spread.reshape(film.shape).swapaxes(0, 1)
    return np.ascontiguousarray(film)


@dataclass(frozen=True)
class Ghosting:
    """The ghosts of a scene in focus.

    Attributes
    ----------
    scene : Scene
    plan : Plan
    session : Session
    """

    scene: Scene
    plan: Plan
    session: Session

    @cached_property
    def result(self) -> tuple[Array, dict[str, Any]]:
        """The light of all ghosts on the rendered part of the film, in its values, and what metadata should say."""
        film, layout = GhostFilm(self.scene, self.plan, self.session), FilmLayout.of(self.scene.film)
        pixels, metadata = film.light()
        rows, columns = slice(layout.y, layout.y + layout.height), slice(layout.x, layout.x + layout.width)
        pixels = pixels[rows, columns]
        if share := _barrel_share(self.scene):
            metadata["barrel_share"] = share
        if scatter := _front_scatter(self.scene, layout):
            beside = film.beside(scatter["front"], layout)
            metadata["scatter"] = scatter | {"beside": len(beside[0])}
            camera = self.plan.camera.metadata
            value = camera["values_per_irradiance"] * (camera["on_axis_irradiance"] or 0.0)  # of radiance
            pixels = pixels + value * as_built.scattered_from_beside(pixels.shape, **scatter["front"], sources=beside)
        metadata["says"] = _summary(metadata)
        return pixels, metadata

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of a saved part by which `merge` adds them without the scene."""
        light, said = self.result
        return {"ghosts_light": light.astype(np.float32), "ghosts_said": array_of_text(said)}


# A sketch of ghosts for pictures that move: all light of a pair as paraxial rays take it (Lee and Eisemann 2013).

_PARAXIAL_NM, _SKETCHED, _PAIRS, _SKETCH_PX = 550.0, 16, 64, 192  # sources and pairs, the brightest; the longer side


@dataclass(frozen=True, eq=False)
class MatrixWay:
    """A way of light by matrices.

    Attributes
    ----------
    heights : (m, 2) array
        What the height on each surface, and last on the film, has of a ray's height and slope before the lens.
    rims : (m - 1,) array
        Of the surfaces [mm].
    share : (3,) array
        Of white light, that comes through.
    bent : Lens
        The way as a lens of its own.
    """

    heights: Array
    rims: Array
    share: Array
    bent: Lens

    @property
    def flux(self) -> float:
        """The luminance of its light, of a source of irradiance 1 on the axis, over pi [mm2]."""
        return float(luminance(self.share) * (self.rims / np.abs(self.heights[:-1, 0])).min() ** 2)


def _passed_shares(lens: Lens, transmission: LensTransmission, waves: Array) -> Array:
    """Return the shares of light (surfaces, waves) that pass each surface at normal incidence."""
    n = np.array([lens.indices(nm) for nm in waves]).T
    return np.array([
        transmission.coating_of(s).transmittance(Interface(n[k], n[k + 1]), waves) for k, s in enumerate(lens.surfaces)
    ])  # fmt: skip


@remember(most=4, by=by_content)
def matrix_ways(lens: Lens, film_distance_mm: float, transmission: LensTransmission) -> list[MatrixWay]:
    """Return the ways of all pairs of surfaces but of faint ones, brightest first."""
    surfaces, every = lens.surfaces, list[MatrixWay]()
    passed = _passed_shares(lens, transmission, np.array(WAVES_NM))
    for way in lens_ghosts.pairs_of(lens):
        bent, met = lens_ghosts.unfold(lens, way), list(steps(way, len(surfaces)))
        indices, height, slope = bent.indices(_PARAXIAL_NM), np.array([1.0, 0.0]), np.array([0.0, 1.0])
        rows, light = [], np.ones(len(WAVES_NM))
        for k, (surface, step) in enumerate(zip(bent.surfaces, met, strict=True)):
            rows.append(height)
            change = -2.0 * indices[k] if surface.is_mirror else indices[k + 1] - indices[k]
            slope = slope - bent.senses[k] * surface.paraxial_curvature("y") * change * height
            gap = film_distance_mm if k + 1 == len(met) else surface.thickness
            height = height + bent.senses[k + 1] * gap / indices[k + 1] * slope
            if step.reflects or not surface.is_mirror:
                light = light * np.abs(float(step.reflects) - passed[step.surface])
        table = np.array([*rows, height]) * [1.0, indices[0]]
        rims = np.array([surface.semi_diameter for surface in bent.surfaces])
        every.append(MatrixWay(table, rims, light @ shares_of_white(WAVES_NM), bent))
    flux = [way.flux for way in every]
    return [every[k] for k in np.argsort(flux)[::-1][:_PAIRS] if flux[k] >= LEAST_SHARE * sum(flux)]


def sketch_of_ghosts(
    scene: Scene, plan: Plan, buffers: SceneBuffers, session: Session, shape: tuple[int, int]
) -> NDArray[np.float32]:
    """Return about what ghosts give a picture (rows, columns, 3) of a scene in focus, without highlights.

    Of a large picture it is drawn small.
    """
    coarser = max(*shape) / min(max(*shape), _SKETCH_PX)
    whole, shape = shape, (math.ceil(shape[0] / coarser), math.ceil(shape[1] / coarser))
    setting, out = ghost_setting(scene), np.zeros((*shape, 3), np.float32)
    lens, (columns, rows), layout = setting.lens, scene.film.resolution, FilmLayout.of(scene.film)
    if lens.is_split or lens.fold is not None:
        return np.zeros((*whole, 3), np.float32)
    film_z = lens.film_z(setting.film_distance_mm)
    sources, _ = sources_of(scene, plan, buffers, session, lens, film_z)
    sense = -1.0 if scene.camera.flip else 1.0
    width, height = (sense * 1e3 * side for side in scene.film.size_m())
    x = ((layout.x + (np.arange(shape[1]) + 0.5) * layout.width / shape[1]) / columns - 0.5) * width
    y = ((layout.y + (np.arange(shape[0]) + 0.5) * layout.height / shape[0]) / rows - 0.5) * -height
    value = plan.camera.value / (plan.camera.on_axis_irradiance or np.inf)
    for lamp in list(dict.fromkeys(sources.known[:, 2]))[:_SKETCHED]:
        own = sources.known[:, 2] == lamp
        place, light = sources.places[own, :4].mean(axis=0), sources.irradiance[own].sum(axis=0)
        near, slope = -place[3] / place[2], place[:2] / place[2]
        light = light * value / np.sqrt(1.0 + slope @ slope)
        for way in matrix_ways(lens, setting.film_distance_mm, setting.transmission):
            _draw(out, x, y, way, near, slope, light)
    if whole == shape:
        return out
    places = [(np.arange(many) + 0.5) * few / many - 0.5 for many, few in zip(whole, shape, strict=True)]
    down, across = (
        np.maximum(1 - np.abs(np.clip(at, 0, few - 1)[:, None] - np.arange(few)), 0).astype(np.float32)
        for at, few in zip(places, shape, strict=True)
    )
    return np.asarray(np.einsum("ij,jkc,lk->ilc", down, out, across, optimize=True))


def _draw(
    out: NDArray[np.float32], x: Array, y: Array, way: MatrixWay, near: float, slope: Array, light: Array
) -> None:
    """Add the ghost of a lamp to a picture whose columns and rows lie at x and y [mm].

    ``near`` is 1 over its distance from the first vertex [1/mm], ``slope`` that of its light there.
    """
    scales, moved = way.heights[:, 0] + near * way.heights[:, 1], way.heights[:, 1:] * slope
    reach = way.rims / np.maximum(np.abs(scales[:-1]), 1e-9)  # on the plane of the first vertex
    pixel = float(np.ptp(x) / max(len(x) - 1, 1))
    scale = math.copysign(max(abs(scales[-1]), pixel / reach.min()), scales[-1])
    centres = moved[-1] - scale * moved[:-1] / np.where(scales[:-1] == 0, 1e-9, scales[:-1])[:, None]
    radii = abs(scale) * reach  # of what each rim leaves of it
    low, high = (centres - radii[:, None]).max(axis=0), (centres + radii[:, None]).min(axis=0)
    i, j = (np.flatnonzero((at >= low[k]) & (at <= high[k])) for k, at in enumerate((x, y)))
    if not len(i) or not len(j):
        return
    x, y, lit = x[i], y[j][:, None], np.ones((len(j), len(i)), np.bool_)
    farthest = np.hypot(*np.maximum(np.abs(low - centres), np.abs(high - centres)).T)
    for k in np.flatnonzero(farthest > radii):
        lit &= (x - centres[k, 0]) ** 2 + (y - centres[k, 1]) ** 2 <= radii[k] ** 2
    if (stop := way.bent.stop_index) is not None:
        through = [scales[stop] * (at - moved[-1, k]) / scale + moved[stop, k] for k, at in enumerate((x, y))]
        lit &= way.bent.surfaces[stop].clears(*np.broadcast_arrays(*through))
    out[j[0] : j[-1] + 1, i[0] : i[-1] + 1] += lit[..., None] * (light * way.share / scale**2).astype(np.float32)


def saved_ghosts(arrays: Mapping[str, NDArray[Any]]) -> tuple[NDArray[np.float32], dict[str, Any]] | None:
    """Read the arrays of `Ghosting.arrays`; None where there are none.

    Raises
    ------
    ValueError, KeyError
        They do not fit together.
    """
    if "ghosts_light" not in arrays:
        return None
    light, said = arrays["ghosts_light"], text_of_array(arrays["ghosts_said"])
    if light.ndim != 3 or light.shape[2] != 3:
        raise ValueError("ghosts")
    return light.astype(np.float32, copy=False), said


def has_ghosts(scene: Scene) -> bool:
    """Return whether the camera of a scene makes ghosts."""
    camera = scene.camera.traced_camera
    return camera is not None and camera.ghosts == "on"


def ghosting_of(scene: Scene | None, plan: Plan, session: Session) -> Ghosting | None:
    """Return the ghosts of a scene in focus; None where there is none.

    Raises
    ------
    InputError
        When the camera has no surfaces, they are ideal, or the lens is half a lens.
    """
    if scene is None:
        return None
    setting = ghost_setting(scene)
    if setting.lens.is_split:
        raise InputError(
            f"camera.ghosts: {setting.lens.name}: a half lens has ghosts that are not known (allowed: off)"
        )
    if setting.lens.fold is not None:
        raise InputError(f"camera.ghosts: {setting.lens.name}: ghosts of a folded axis are not known (allowed: off)")
    return Ghosting(scene, plan, session)


def _barrel_share(scene: Scene) -> float:
    """Return the light that the barrel adds evenly, in parts of the film's mean; `veiling_glare` estimates it."""
    camera = scene.camera.traced_camera
    if camera is None or not camera.barrel_reflectance:
        return 0.0
    setting = ghost_setting(scene)
    try:
        return irradiance.veiling_glare(
            setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm, setting.transmission,
            barrel_reflectance=camera.barrel_reflectance,
        ).barrel  # fmt: skip
    except InputError as problem:
        raise InputError(f"camera.barrel_reflectance: {problem} (allowed: 0)") from None


def _front_scatter(scene: Scene, layout: FilmLayout) -> dict[str, Any]:
    """Return the arguments of `scattered` beside its film, and the share of its light; nothing of a clean front."""
    camera = scene.camera.traced_camera
    if camera is None or not camera.front_scatter:
        return {}
    setting, (width, height), (columns, rows) = ghost_setting(scene), scene.film.size_m(), scene.film.resolution
    if (share := as_built.scatter_share(camera.front_scatter)) >= 1:
        raise InputError(f"camera.front_scatter: scatters {share:.3g} of the light (allowed: total scatter below 1)")
    try:
        radii = 500.0 * float(np.hypot(width, height)) * np.linspace(0.0, 1.0, _RADII)
        sines = as_built.sines_of_film(setting.lens, setting.film_distance_mm, float(radii[-1]))
        nm, losses = setting.camera.wavelength_nm, setting.transmission
        lit = irradiance.film_irradiance(setting.lens, setting.film_distance_mm, radii, nm, transmission=losses)
    except InputError as problem:
        raise InputError(f"camera.front_scatter: {problem} (allowed: none)") from None
    steps = 1e3 * width / columns, 1e3 * height / rows
    begins = (layout.x - columns / 2) * steps[0], (layout.y - rows / 2) * steps[1]
    pixels = begins[0], steps[0], begins[1], steps[1]
    light = radii.tolist(), np.maximum(lit / lit[0], _DIMMEST).tolist()
    front = {"abg": list(camera.front_scatter), "sines": sines, "pixels_mm": list(pixels), "lit": light}
    return {"share": share, "front": front}


def _summary(metadata: dict[str, Any]) -> str:
    """A line on the ghosts of a picture."""
    points = "1 point" if metadata["sources"] == 1 else f"{metadata['sources']} points"
    four = f" and {metadata['ways_of_four']} of {metadata['of_four']} ways of four" if "of_four" in metadata else ""
    text = f"{metadata['ways']} pairs of surfaces{four} from {points} of light"
    if "ways_of_grating" in metadata:
        text += f"; {metadata['ways_of_grating']} surfaces send back what the sensor reflects"
    if "mirrored" in metadata:
        text += f", {metadata['mirrored']} of them mirrored"
    if metadata["dropped_share"] > 1e-9:  # else a rounding
        text += f"; fainter ones with {metadata['dropped_share']:.1g} of the light are left out"
    if "barrel_share" in metadata:
        text += f"; the barrel adds {metadata['barrel_share']:.2g} of the film's mean light"
    if "scatter" in metadata:
        text += f"; the front scatters {metadata['scatter']['share']:.2g} of the light"
        text += f", also of {beside} beside the picture" if (beside := metadata["scatter"]["beside"]) else ""
    if "left_out" in metadata:
        text += f"; what makes none here: {', '.join(metadata['left_out'])}"
    return text
