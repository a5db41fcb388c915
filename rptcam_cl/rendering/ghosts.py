"""Ghosts in a picture: light of lamps and suns that surfaces of the lens reflect onto the film.

Light is sent from its sources through every pair of reflecting surfaces, and added to the film in whole numbers: the
result depends on the scene alone, not on samples, waves or devices that share them. docs/flare.md has its limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import WayRecords, ghost_setting, ghosts_have_colours
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device import Session
from rptcam_cl.optics import Lens
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.buffers import SceneBuffers
from rptcam_cl.rendering.diffraction_kernel import shares_of_white
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.ghost_sources import Sources, ghost_sources
from rptcam_cl.scene import RealisticCamera, Scene

Array = NDArray[np.float64]
Way = tuple[int, ...]

WAVES_NM = (425.0, 475.0, 525.0, 575.0, 625.0, 675.0)  # where colours differ
SCOUTS = 1024  # rays of a source over the whole front, for each way
LEAST_SHARE = 1e-3  # of all ghosts, below which a way is left out
PER_PIXEL = 16.0  # rays of a way in each pixel that it lights
LEAST_RAYS, MOST_RAYS = 1 << 15, 1 << 22  # of a way and wavelength
SMOOTH = 200.0  # rays that the light of a pixel is spread over neighbours for
WIDTHS = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # half widths of that spread [pixels]
ROOM = 0.05  # beside the box that scouts have found, in its sides
ONE_LIGHT = float(1 << 36)  # units of the device's whole numbers
GROUP = 4


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
    def found(self) -> tuple[Array, dict[str, Any]]:
        """The light of all ghosts on the rendered part of the film, in its values, and what metadata should say."""
        pixels, metadata = _Film(self.scene, self.plan, self.session).light()
        metadata["says"] = _says(metadata)
        layout = FilmLayout.of(self.scene.film)
        rows, columns = slice(layout.y, layout.y + layout.height), slice(layout.x, layout.x + layout.width)
        return pixels[rows, columns], metadata


def has_ghosts(scene: Scene) -> bool:
    """Return whether the camera of a scene makes ghosts."""
    return isinstance(scene.camera, RealisticCamera) and scene.camera.ghosts == "on"


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
    if any(surface.region is not None and not surface.region.blocks for surface in setting.lens.surfaces):
        raise InputError(
            f"camera.ghosts: {setting.lens.name}: a half lens has ghosts that are not known (allowed: off)"
        )
    return Ghosting(scene, plan, session)


def _says(found: dict[str, Any]) -> str:
    """Return a line on what was found."""
    text = f"{found['ways']} pairs of surfaces from {found['sources']} points of light"
    if found["dropped_share"] > 0:
        text += f"; fainter ones with {found['dropped_share']:.1g} of the light are left out"
    if "left_out" in found:
        text += f"; what makes none here: {', '.join(found['left_out'])}"
    return text


@dataclass(frozen=True)
class _Scouted:
    """What rays over the whole front say of a way.

    Attributes
    ----------
    boxes : (n, 4) array
        Of each source on the plane of the first vertex: corner and sides [mm]; without sides where nothing arrives.
    flux : (n, 3) array
        Of each source on the film, in its colours [W/m2 mm2].
    pixels : float
        That a source lights, at most.
    share : float
        Largest share of a ray's light that arrives.
    """

    boxes: Array
    flux: Array
    pixels: float
    share: float


class _Film:
    """The film of a scene under the light of ghosts."""

    def __init__(self, scene: Scene, plan: Plan, session: Session) -> None:
        self.plan, self.session = plan, session
        setting = ghost_setting(scene)
        self.lens, self.film_distance = setting.lens, setting.film_distance_mm
        film_z = self.lens.film_z(self.film_distance)
        buffers = SceneBuffers(session, plan)
        self.sources: Sources = ghost_sources(scene, plan, buffers, session, self.lens, film_z)
        tinted = ghosts_have_colours(setting)
        waves = WAVES_NM if tinted else (setting.camera.wavelength_nm,)
        self.shares = shares_of_white(WAVES_NM) if tinted else np.ones((1, 3))
        self.records = [WayRecords.of(self.lens, nm, setting.transmission) for nm in waves]
        (self.columns, self.rows), (width, height) = scene.film.resolution, scene.film.size_m()
        sense = -1.0 if scene.camera.flip else 1.0
        across, down = sense * self.columns / (1e3 * width), -sense * self.rows / (1e3 * height)
        self.to_pixels = np.array([self.columns / 2, across, self.rows / 2, down], np.float32)
        pixel_mm2 = 1e6 * width * height / (self.columns * self.rows)
        self.value = float(plan.camera.metadata["values_per_irradiance"]) / pixel_mm2  # of 1 W/m2 over 1 mm2
        facts = self.records[0].facts | {"VW": session.lanes, "DOUBLE": 0}
        self.programs = {
            scout: session.program(["pass/ghosts.cl"], facts | {"GHOST_SCOUT": scout}, device_declarations())
            for scout in (0, 1)
        }
        self.stop = session.upload(self.records[0].stop)

    def light(self) -> tuple[Array, dict[str, Any]]:
        """Return the film's values (rows, columns, 3) of all ghosts, and what metadata should say."""
        film = np.zeros((self.rows, self.columns, 3))
        metadata: dict[str, Any] = {"sources": len(self.sources.places)}
        if self.sources.left_out:
            metadata["left_out"] = list(self.sources.left_out)
        if not len(self.sources.places):
            return film, metadata | {"ways": 0, "dropped_share": 0.0}
        scouted = {way: self._scouted(way) for way in _pairs(self.lens)}
        fluxes = {way: float(found.flux.sum()) for way, found in scouted.items()}
        total = sum(fluxes.values())
        kept = [way for way, flux in fluxes.items() if flux > LEAST_SHARE * total]
        by_width: dict[float, Array] = {}
        for way in kept:
            width, light = self._splatted(way, scouted[way], np.sqrt(fluxes[way] / max(fluxes.values())))
            by_width[width] = by_width[width] + light if width in by_width else light
        for width, light in by_width.items():
            film += _spread(light, width)
        dropped = 1.0 - sum(fluxes[way] for way in kept) / total if total else 0.0
        dropped = 1.0 - (1.0 - dropped) * (1.0 - self.sources.dropped_share)
        return film, metadata | {"ways": len(kept), "dropped_share": dropped}

    def _table(self, places: Array, boxes: Array, weights: Array) -> Any:
        """Return sources with their boxes and weights (n, 3) on the device."""
        table = np.zeros((len(boxes), 3, 4), np.float32)
        table[:, 0], table[:, 1], table[:, 2, :3] = places, boxes, weights
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

    def _scouted(self, way: Way) -> _Scouted:
        """Return where the light of a way enters, by rays over the whole front at a middle wavelength."""
        count, first = len(self.sources.places), self.lens.surfaces[0]
        depth = abs(float(np.nan_to_num(first.rim_sag(first.semi_diameter * (1 - 1e-9)))))
        reach = first.semi_diameter + depth * self.sources.tilt
        whole = np.tile([-reach, -reach, 2 * reach, 2 * reach], (count, 1))
        memory = self.session.allocate(12 * count * SCOUTS)
        middle = len(self.records) // 2
        self._launched(
            1, way, middle, self._table(self.sources.places, whole, np.ones((count, 3))), count, SCOUTS, memory
        )
        landed = self.session.read(memory, np.float32, 3 * count * SCOUTS).astype(np.float64)
        x, y, share = landed.reshape(3, count, SCOUTS)
        columns, rows = self.to_pixels[0] + self.to_pixels[1] * x, self.to_pixels[2] + self.to_pixels[3] * y
        with np.errstate(invalid="ignore"):
            inside = (share > 0) & (columns >= 0) & (rows >= 0) & (columns < self.columns) & (rows < self.rows)
        numbers = np.arange(SCOUTS, dtype=np.uint64)
        u = (numbers + 0.5) / SCOUTS
        v = ((numbers * 2654435769 % (1 << 32)) >> 8).astype(np.float64) / (1 << 24)
        boxes, lit = np.zeros((count, 4)), 0.0
        margin = 1.5 / np.sqrt(SCOUTS)
        for source in np.flatnonzero(inside.any(axis=1)):
            rays = inside[source]
            low = np.array([u[rays].min() - margin, v[rays].min() - margin])
            high = np.array([u[rays].max() + margin, v[rays].max() + margin])
            low, high = np.clip(low, 0.0, 1.0), np.clip(high, 0.0, 1.0)
            boxes[source] = [*(low * 2 * reach - reach), *((high - low) * 2 * reach)]
            lit = max(lit, float(np.ptp(columns[source, rays]) * np.ptp(rows[source, rays])))
        area = (2 * reach) ** 2 / SCOUTS
        flux = (np.where(inside, share, 0.0).sum(axis=1) * area)[:, None] * self.sources.irradiance
        return _Scouted(boxes, flux, max(float(lit), 1.0), float(share[inside].max(initial=0.0)))

    def _splatted(self, way: Way, found: _Scouted, strength: float) -> tuple[float, Array]:
        """Return the light of a way on the film, and over how many pixels it is to be spread."""
        reaches = found.boxes[:, 2] > 0
        boxes, places = found.boxes[reaches], self.sources.places[reaches]
        reached = boxes[:, 2] * boxes[:, 3]
        count, lanes = len(reached), self.session.lanes
        total = int(np.clip(PER_PIXEL * found.pixels * strength, LEAST_RAYS, MOST_RAYS))
        step = lanes * GROUP
        rays = max(-(-total // (count * len(self.records)) // step) * step, step)
        weights = self.sources.irradiance[reaches] * (reached / rays)[:, None]
        largest = float(weights.max()) * 4.0 * found.share  # a ray may bring more than any scout did
        words = self.session.allocate(24 * self.rows * self.columns, zeroed=True)
        for record, shares in enumerate(self.shares):
            self._launched(0, way, record, self._table(places, boxes, weights * shares / largest), count, rays, words)
        units = self.session.read(words, "<u8", 3 * self.rows * self.columns).astype(np.float64)
        film = units.reshape(self.rows, self.columns, 3) * (largest / ONE_LIGHT * self.value)
        per_pixel = rays * count * len(self.records) / found.pixels
        wanted = float(np.sqrt(SMOOTH / per_pixel)) / 1.5
        return min((width for width in WIDTHS if width >= wanted), default=WIDTHS[-1]), film


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
