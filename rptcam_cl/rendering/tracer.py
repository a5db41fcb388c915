"""The wavefront path tracer: programs, buffers and the order of passes.

A wave is a batch of camera rays, one per slot, made by the pass generate. Two organisations take it to the film:

passes
    Per edge of the paths the kernels intersect, shade and shadow run over all slots, then film adds the radiances.
    State lives in memory and stays in place; groups of slots without a living path are skipped.
stream
    One kernel carries a few neighbouring pixels through all samples of the wave, with the same steps; a lane whose path
    has ended starts the next camera ray of its pixel. No state in memory, no idle lanes, three launches fewer per edge.
    Measured on two CPU cores: 1.15 times the passes on three spheres, 1.55 on a Cornell box.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import CameraModel
from rptcam_cl.core.records import LIMITS, WAVE, RayStatus, device_declarations, floats_per_slot
from rptcam_cl.device import Launch, Session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.buffers import SceneBuffers, camera_buffers
from rptcam_cl.rendering.film import BLOCK, PLANES, TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.layers import LayerPass, LayerPlanes
from rptcam_cl.rendering.memory import check_memory, memory_needs
from rptcam_cl.rendering.precise_lens import BYTES_PER_SLOT, PreciseLens, traces_in_float64
from rptcam_cl.scene import RenderSettings

# Paths of a wave. On two CPU cores 256k render meshes 1.3 times as fast as 64k, whose ends leave a core idle.
WAVE_SLOTS = {"cpu": 1 << 18, "gpu": 1 << 20}
STREAM_SAMPLES = 16  # samples per pixel of a wave: what a lane may run through before it idles
GROUP = {"cpu": 4, "gpu": 64}  # work items per group; small ones spread evenly over few cores
ORGANISATION = {"cpu": "stream", "gpu": "passes"}
LENS_LANES = 16  # lanes per work item that trace a lens on a CPU: its surfaces are long chains of roots
STEPS_OF_SAMPLE = 4096  # that all loops of a kernel take for one sample, at most: those of trees and lenses


class Wavefront:
    """The passes of one scene on one device, with their buffers.

    Parameters
    ----------
    session
        The device.
    plan
        Facts and records of the scene.
    layout
        Which pixels to render.
    settings
        Depth, roulette and seed.
    wave_size
        Slots of a wave; rounded to a multiple of 256. The film does not depend on it.
    organisation
        "stream" or "passes"; by default what suits the device.
    buffers
        The scene on the device, where it is there already; by default that of the plan is uploaded.

    Raises
    ------
    InputError
        When film and paths do not fit the device.
    """

    def __init__(
        self,
        session: Session,
        plan: Plan,
        layout: FilmLayout,
        settings: RenderSettings,
        wave_size: int | None = None,
        organisation: str | None = None,
        buffers: SceneBuffers | None = None,
    ) -> None:
        self.session = session
        self.layout = layout
        self.settings = settings
        self.seed = settings.seed
        self.organisation = organisation or ORGANISATION[session.kind]
        self._emitters = plan.emitters.count
        self._size_wave(wave_size or WAVE_SLOTS[session.kind])
        self._group = GROUP[session.kind]
        self.tiles = layout.whole_list()
        self._enqueued, self._rays = 0, 0  # camera rays of the picture, since the last and up to the last `finish`
        self._events: list[tuple[str, Any]] = []
        self.passes: dict[str, float] = {}
        lanes = session.lanes
        self._precise = traces_in_float64(plan.camera)
        traces = plan.camera.crosses_surfaces and not self._precise
        self._packets = 2 if traces and lanes > 1 else 1  # of lanes per work item that trace a lens
        self._lanes = {"trace": lanes, "camera": LENS_LANES if plan.camera.has_lens and lanes > 1 else lanes}
        self._allocate(plan, buffers)
        self._build(plan)
        self._bind(plan)

    def _size_wave(self, slots: int) -> None:
        at_least = STREAM_SAMPLES if self.organisation == "stream" else 1
        self._wave_pixels = min(max(slots // at_least // BLOCK, 1) * BLOCK, self.layout.pixels)
        most = (self.session.loop_limit or slots * STEPS_OF_SAMPLE) // STEPS_OF_SAMPLE
        self._wave_samples = min(max(slots // self._wave_pixels, 1), most)

    @property
    def capacity(self) -> int:
        """Slots of the path state."""
        return self._wave_pixels * self._wave_samples

    def _build(self, plan: Plan) -> None:
        declarations = device_declarations()
        passes = ["pass/intersect.cl", "pass/shade.cl", "pass/shadow.cl", "pass/film.cl"]
        trace = ["pass/stream.cl"] if self.organisation == "stream" else passes
        self._trace = self.session.program(
            trace, plan.facts | self._buffers.tree_facts | {"VW": self._lanes["trace"]}, declarations
        )
        self._camera_facts: dict[str, int | str] = {
            **plan.camera.facts,
            "CAMERA_FILE": plan.camera.kernel,
            "CAMERA_HAS_LENS": int(plan.camera.has_lens),
            "HAS_EMITTERS": plan.facts["HAS_EMITTERS"],
            "SAMPLER_LATTICE": plan.facts["SAMPLER_LATTICE"],
            "HAS_MESH": plan.facts["HAS_MESH"],
            "FILTER": plan.camera_filter.cells,
            **plan.spectrum.facts,
            "MOVES": plan.facts["MOVES"],
            "CAMERA_SEGMENTS": plan.facts["CAMERA_SEGMENTS"],
            "STREAM": int(self.organisation == "stream"),
            "CAMERA_PACKETS": self._packets,
            "VW": self._lanes["camera"],
        }
        self._camera = self.session.program(["pass/generate.cl"], self._camera_facts, declarations)

    def _allocate(self, plan: Plan, buffers: SceneBuffers | None) -> None:
        floats = floats_per_slot(
            stream=self.organisation == "stream",
            emitters=self._emitters > 0,
            meshes=plan.facts["HAS_MESH"] > 0,
            moves=plan.facts["MOVES"] > 0,
            colours=plan.facts["SPECTRUM"] > 0,
        )
        state_bytes = 4 * floats * self.capacity
        lens_bytes = BYTES_PER_SLOT * self.capacity if self._precise else 0
        planes = LayerPlanes(self.settings.layers)
        self._film_planes = PLANES + (self.settings.clamp is not None)
        self._film_bytes = 4 * self._film_planes * self.layout.pixels
        film_bytes = self._film_bytes + planes.bytes_per_pixel * self.layout.pixels
        check_memory(memory_needs(plan, self.session, film=film_bytes, paths=state_bytes + lens_bytes), self.session)
        session = self.session
        self._state = session.allocate(state_bytes)
        self._film = session.allocate(self._film_bytes, zeroed=True)
        self._counts = np.zeros(len(RayStatus) + 1, np.uint64)  # rays by status, then samples that were not finite
        self._counters = session.allocate(4 * len(self._counts), zeroed=True)
        self._tile_list = session.allocate(self.tiles.nbytes)
        session.write(self._tile_list, self.tiles)
        self._buffers = buffers or SceneBuffers(session, plan)
        self._layers = None
        if planes.names:
            self._layers = LayerPass(
                session, plan, self.layout, self._buffers, planes, lanes=self._lanes["trace"], state=self._state,
                tiles=self._tile_list, capacity=self.capacity, stream=self.organisation == "stream",
            )  # fmt: skip

    def _bind(self, plan: Plan) -> None:
        session, capacity, empty = self.session, np.uint32(self.capacity), bytes(WAVE.dtype.itemsize)
        scene, pixels = self._buffers.scene, np.uint32(self.layout.pixels)
        self._lens = None
        if self._precise:
            self._lens = PreciseLens(
                session, plan.camera, self._camera_facts, self.capacity, self._buffers.camera, self._tile_list,
                self._buffers.filter, self._buffers.colours,
            )  # fmt: skip
        self._generate = session.bind(
            self._camera, "generate", **self._buffers.camera, counters=self._counters, state=self._state,
            capacity=capacity, wave=empty, tiles=self._tile_list, filter=self._buffers.filter,
            colours=self._buffers.colours, **self._buffers.trajectory,
            **({} if self._lens is None else {"traced": self._lens.rays}),
        )  # fmt: skip
        if self.organisation == "stream":
            self._stream = session.bind(
                self._trace, "stream", **scene, rays=self._state, wave=empty, limits=self._limits(), sums=self._film,
                counters=self._counters, pixels=pixels, tiles=self._tile_list,
            )  # fmt: skip
            return
        self._intersect = session.bind(self._trace, "intersect", **scene, state=self._state, capacity=capacity)
        self._shadow = session.bind(self._trace, "shadow", **scene, state=self._state, capacity=capacity)
        self._shade = [
            session.bind(
                self._trace, "shade", **scene, state=self._state, capacity=capacity, wave=empty, limits=self._limits(),
                depth=np.uint32(depth), tiles=self._tile_list,
            )
            for depth in range(1, self.settings.max_depth + 1)
        ]  # fmt: skip
        self._add_to_film = session.bind(
            self._trace, "film", state=self._state, sums=self._film, counters=self._counters, wave=empty,
            capacity=capacity, pixels=pixels, tiles=self._tile_list,
            **({"colours": self._buffers.colours} if plan.facts["SPECTRUM"] else {}),
        )  # fmt: skip

    def _limits(self) -> bytes:
        record = LIMITS.zeros(1)
        record["max_depth"], record["roulette_depth"] = self.settings.max_depth, self.settings.roulette_depth
        return record.tobytes()

    def warm_up(self) -> None:
        """Run a smallest wave, because PoCL generates code at the first launch; then clear the film."""
        self.enqueue(0, min(BLOCK, self._wave_pixels), 0, 1)
        self.session.finish()
        self._events.clear()
        self.clear()

    def clear(self) -> None:
        """Empty the film and every counter."""
        self.session.fill_zero(self._film, self._film_bytes)
        self.session.fill_zero(self._counters, 4 * len(self._counts))
        self._counts[:] = 0
        self._enqueued, self._rays = 0, 0
        self.passes.clear()
        if self._layers is not None:
            self._layers.clear()

    def choose_tiles(self, tiles: NDArray[np.uint32]) -> None:
        """Render these tiles of the film from now on; before, and without any, they are all."""
        self.tiles = self.layout.filled_list(tiles)
        if len(self.tiles):
            self.session.write(self._tile_list, self.tiles)

    def use_camera(self, camera: CameraModel) -> None:
        """Look through another state of the camera from now on; its kernel and its facts are those of the plan."""
        buffers = camera_buffers(self.session, camera)
        self._generate.set(**buffers)
        if self._lens is not None:
            self._lens.use_camera(buffers)

    def waves(self, first_sample: int, samples: int) -> list[tuple[int, int, int, int]]:
        """Return ``(first pixel, pixels, first sample, samples)`` of the waves that render a range of samples."""
        found, pixels = [], len(self.tiles) * TILE_PIXELS
        for start in range(first_sample, first_sample + samples, self._wave_samples):
            count = min(self._wave_samples, first_sample + samples - start)
            for pixel in range(0, pixels, self._wave_pixels):
                found.append((pixel, min(self._wave_pixels, pixels - pixel), start, count))
        return found

    @property
    def samples_per_wave(self) -> int:
        """Samples per pixel that one wave holds."""
        return self._wave_samples

    def enqueue(self, first_pixel: int, pixels: int, first_sample: int, samples: int) -> None:
        """Enqueue every pass of one wave."""
        wave = self._wave_bytes(first_pixel, pixels, first_sample, samples)
        slots = pixels * samples
        tiles = self.tiles[first_pixel // TILE_PIXELS : (first_pixel + pixels) // TILE_PIXELS]
        self._enqueued += samples * int(self.layout.pixels_of_tile[tiles].sum())
        if self._lens is not None:
            self._lens.enqueue(wave, slots, self._run)
        self._generate.set(wave=wave)
        self._run(self._generate, slots // (self._packets * self._lanes["camera"]))
        if self._layers is not None and first_sample < self.settings.layers_spp:
            seen = min(samples, self.settings.layers_spp - first_sample)
            self._layers.set_wave(self._wave_bytes(first_pixel, pixels, first_sample, seen))
            self._run(self._layers.launch, pixels // self._lanes["trace"])
        if self.organisation == "stream":
            self._stream.set(wave=wave)
            self._run(self._stream, pixels // self._lanes["trace"])
            return
        items = slots // self._lanes["trace"]
        for shade in self._shade:
            self._run(self._intersect, items)
            shade.set(wave=wave)
            self._run(shade, items)
            if self._emitters and shade is not self._shade[-1]:
                self._run(self._shadow, items)
        self._add_to_film.set(wave=wave)
        self._run(self._add_to_film, pixels // self._lanes["trace"])

    def _run(self, launch: Launch, items: int) -> None:
        event = launch.enqueue(items, min(self._group, items))
        if self.session.profiling:
            self._events.append((launch.name, event))

    def _wave_bytes(self, first_pixel: int, pixels: int, first_sample: int, samples: int) -> bytes:
        layout = self.layout
        record = WAVE.zeros(1)
        record["seed"][0] = seed_words(self.seed)
        record["first_pixel"], record["pixels"] = first_pixel, pixels
        record["first_sample"], record["samples"] = first_sample, samples
        record["tiles_across"], record["full_width"] = layout.tiles_across, layout.full_width
        record["width"], record["height"] = layout.width, layout.height
        record["crop_x"], record["crop_y"] = layout.x, layout.y
        return record.tobytes()

    def finish(self) -> None:
        """Wait for everything enqueued and take over its counters; with profiling, add pass times to ``passes`` [s]."""
        self.session.finish()
        self._rays += self._enqueued
        self._enqueued = 0
        self._counts += self.session.read(self._counters, np.uint32, len(self._counts))  # 32 bits would wrap
        self.session.fill_zero(self._counters, 4 * len(self._counts))
        for name, event in self._events:
            self.passes[name] = self.passes.get(name, 0.0) + (event.profile.end - event.profile.start) * 1e-9
        self._events.clear()

    def sums(self) -> NDArray[np.float32]:
        """Return the film's sums and their compensations, shape (6, pixels of the buffer)."""
        return self.planes()[:PLANES]

    def planes(self) -> NDArray[np.float32]:
        """Return all of the film, (planes, pixels of the buffer)."""
        count = self._film_planes * self.layout.pixels
        return self.session.read(self._film, np.float32, count).reshape(self._film_planes, -1)

    def removed_share(self) -> float:
        """Return the share of the light that the limit of the samples has removed."""
        return share_removed(self.planes())

    def picture(self, spp: int | NDArray[np.uint32]) -> NDArray[np.float32]:
        """Return the film's mean, shape (height, width, 3), over the samples per pixel, of all or of each tile."""
        tiles = np.broadcast_to(np.asarray(spp, np.uint32), self.layout.whole_list().shape)
        return self.layout.picture(self.sums(), tiles)

    @property
    def camera_rays(self) -> int:
        """Samples of the picture's pixels, up to the last `finish`."""
        return self._rays

    def state(self) -> dict[str, NDArray[Any]]:
        """Return what `restore` needs to go on as if nothing had happened."""
        arrays: dict[str, NDArray[Any]] = {
            "film": self.planes(),
            "counts": self.counts(),
        }
        return arrays if self._layers is None else arrays | {"layers": self._layers.planes()}

    def counts(self) -> NDArray[np.uint64]:
        """Return rays by status, samples that were not finite, and camera rays, up to the last `finish`."""
        return np.append(self._counts, np.uint64(self._rays))

    def clear_counts(self) -> None:
        """Count from 0 on."""
        self._counts[:] = 0
        self._rays = 0

    def restore(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Go on from what `state` returned."""
        self.session.write(self._film, np.ascontiguousarray(arrays["film"], np.float32))
        self._counts[:], self._rays = arrays["counts"][:-1], int(arrays["counts"][-1])
        if self._layers is not None:
            self._layers.restore(arrays["layers"])

    def layers(self) -> dict[str, NDArray[Any]]:
        """Return the auxiliary layers by name, (height, width) or (height, width, channels)."""
        return {} if self._layers is None else self._layers.arrays(self._layers.planes())

    @property
    def layer_pass(self) -> LayerPass | None:
        """The pass that fills the layers, where there are any."""
        return self._layers

    def outcomes(self) -> dict[str, int]:
        """Return how many camera rays passed the lens, and how many failed and why, up to the last `finish`."""
        return outcomes_of(self.counts())

    def not_finite(self) -> int:
        """Return how many samples were dropped because they were not finite, up to the last `finish`."""
        return int(self._counts[-1])


def outcomes_of(counts: NDArray[np.uint64]) -> dict[str, int]:
    """Return how many camera rays passed the lens, and how many failed and why, of what `Wavefront.counts` returns."""
    stopped = {status.name.lower(): int(counts[status]) for status in list(RayStatus)[1:]}
    return {"passed": int(counts[-1]) - sum(stopped.values()), **stopped}


def share_removed(planes: NDArray[np.float32]) -> float:
    """Return the share of the light of a whole film that the limit of the samples has removed."""
    exact = planes.astype(np.float64)
    removed, kept = exact[PLANES:].sum(), np.abs(exact[:3] - exact[3:PLANES]).sum() / 3
    return float(removed / (removed + kept)) if removed else 0.0


def seed_words(seed: int) -> tuple[int, int]:
    """Return two 32-bit words of a 64-bit seed, mixed so that neighbouring seeds are unrelated (splitmix64)."""
    mask = (1 << 64) - 1
    z = (seed + 0x9E3779B97F4A7C15) & mask
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
    z ^= z >> 31
    return z & 0xFFFFFFFF, z >> 32
