"""The passes of one scene: its kernels, compiled and bound to their buffers, and the order in which a wave takes them.

A wave is a batch of camera rays, one per slot, made by the pass generate, or by the stream itself where no layers want
the rays and no lens is traced in float64. Two organisations take it to the film:

passes
    Per depth of the paths the kernels intersect, shade and shadow run over all slots, then film adds the radiances.
    State lives in memory and stays in place; groups of slots without a living path are skipped.
stream
    One kernel carries a few neighbouring pixels through all samples of the wave, with the same steps; a lane whose path
    has ended starts the next camera ray of its pixel. No state in memory, no idle lanes, three launches a depth fewer.
    Measured on two CPU cores: 1.15 times the passes on three spheres, 1.55 on a Cornell box. Rays without a lens are
    made by the lanes that start them, 1.2 to 1.3 times as fast as with generate; those behind a lens by each work item
    for its pixels, packets side by side, before it starts: 1.15 times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rptcam_cl.cameras import CameraModel
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import WAVE, device_declarations, floats_per_slot
from rptcam_cl.device import Launch, Program, Session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.buffers import SceneBuffers, camera_buffers
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.film_buffers import FilmBuffers
from rptcam_cl.rendering.layers import LayerPass, LayerPlanes
from rptcam_cl.rendering.precise_lens import BYTES_PER_SLOT, PreciseLens, traces_in_float64
from rptcam_cl.rendering.roulette import ALIKE
from rptcam_cl.scene import RenderSettings

LENS_LANES = 16  # lanes per work item that trace a lens on a CPU: its surfaces are long chains of roots
PACKETS = 4  # of lanes that a work item of a CPU takes through a lens side by side

Run = Callable[[Launch, int], None]
"""Enqueues a launch over a number of work items."""


@dataclass(frozen=True)
class WaveBuffers:
    """What the passes of a wave read and write.

    Attributes
    ----------
    scene, film
        The scene on the device, and the film.
    state : buffer
        Of the paths, ``bytes_of_state`` large.
    tiles : buffer
        List of the tiles to render.
    kindness : buffer
        Of roulette that is as kind everywhere.
    capacity : int
        Slots of a wave.
    """

    scene: SceneBuffers
    film: FilmBuffers
    state: Any
    tiles: Any
    kindness: Any
    capacity: int

    @property
    def slots(self) -> dict[str, Any]:
        """The arguments that every pass over slots has."""
        return {"state": self.state, "capacity": np.uint32(self.capacity)}


def makes_rays(plan: Plan, settings: RenderSettings, *, stream: bool) -> bool:
    """Return whether the pass that takes camera rays to the film makes them itself: nothing else wants them."""
    return stream and not traces_in_float64(plan.camera) and not LayerPlanes(settings.layers).names


def keeps_rays(plan: Plan, settings: RenderSettings, *, stream: bool) -> bool:
    """Return whether camera rays lie in memory before paths start: all that lanes do not make when they need one."""
    aims = plan.camera.facts.get("LAMP_AIM", 0)
    return not makes_rays(plan, settings, stream=stream) or plan.camera.has_lens or bool(aims)


def bytes_of_state(plan: Plan, capacity: int, *, stream: bool) -> int:
    """Return how large the state of the paths is, without the rays of a lens traced in float64."""
    floats = floats_per_slot(
        stream=stream,
        emitters=plan.emitters.count > 0,
        meshes=plan.facts["HAS_MESH"] > 0,
        moves=plan.facts["MOVES"] > 0,
        colours=plan.facts["SPECTRUM"] > 0,
        light_tree=plan.facts["LIGHT_TREE"] > 0,
        caustics=plan.facts["CAUSTICS"] > 0,
    )
    return 4 * floats * capacity


def bytes_of_lens_rays(plan: Plan, capacity: int) -> int:
    """Return how large the rays of a lens traced in float64 are; 0 for other cameras."""
    return BYTES_PER_SLOT * capacity if traces_in_float64(plan.camera) else 0


class Launches:
    """Enqueues launches, in groups that suit the device.

    Attributes
    ----------
    seconds : dict
        With profiling, what the kernel of each name took, up to the last `finish`.
    count : int
        Launches enqueued.
    """

    def __init__(self, session: Session) -> None:
        self._session, self._group = session, session.group
        self._events: list[tuple[str, Any]] = []
        self.seconds: dict[str, float] = {}
        self.count = 0

    def run(self, launch: Launch, items: int) -> None:
        """Enqueue a launch over ``items`` work items."""
        self.count += 1
        event = launch.enqueue(items, min(self._group, items))
        if self._session.profiling:
            self._events.append((launch.name, event))

    def finish(self) -> None:
        """Wait for everything enqueued."""
        self._session.finish()
        for name, event in self._events:
            self.seconds[name] = self.seconds.get(name, 0.0) + (event.profile.end - event.profile.start) * 1e-9
        self._events.clear()


class CameraPasses:
    """The pass ``generate``, which makes the camera rays of a wave, and those before it that trace a lens in float64.

    Raises
    ------
    DeviceError
        When the lens is to be traced in float64 and the device has none.
    """

    def __init__(self, session: Session, plan: Plan, buffers: WaveBuffers, *, stream: bool, packets: int) -> None:
        self._session, camera, scene = session, plan.camera, buffers.scene
        precise = traces_in_float64(camera)
        lanes = LENS_LANES if camera.has_lens and session.lanes > 1 else session.lanes
        most = 2 if camera.crosses_surfaces and not precise and session.lanes > 1 else 1  # that an item traces
        packets = min(most, packets)
        self._slots_per_item = packets * lanes
        facts = _camera_facts(plan) | {"STREAM": int(stream), "CAMERA_PACKETS": packets, "VW": lanes}
        program = session.program(["pass/generate.cl"], facts, device_declarations())
        self._lens = None
        if precise:
            self._lens = PreciseLens(
                session, camera, facts, buffers.capacity, scene.camera, buffers.tiles, scene.filter, scene.colours
            )
        self._generate = session.bind(
            program, "generate", **buffers.slots, **scene.camera, counters=buffers.film.counters, wave=_NO_WAVE,
            tiles=buffers.tiles, filter=scene.filter, colours=scene.colours, **scene.trajectory,
            **({} if self._lens is None else {"traced": self._lens.rays}),
        )  # fmt: skip

    def take_over(self, scene: SceneBuffers) -> bool:
        """Make the rays of another plan, whose kernels are the same; return whether that can be."""
        if self._lens is not None:
            return False
        self._generate.set(**scene.camera, **scene.trajectory, filter=scene.filter, colours=scene.colours)
        return True

    def use_camera(self, camera: CameraModel) -> None:
        """Look through another state of the camera; its kernel and its facts are those of the plan."""
        buffers = camera_buffers(self._session, camera)
        self._generate.set(**buffers)
        if self._lens is not None:
            self._lens.use_camera(buffers)

    def enqueue(self, wave: bytes, slots: int, run: Run) -> None:
        """Make the camera rays of a wave."""
        if self._lens is not None:
            self._lens.enqueue(wave, slots, run)
        self._generate.set(wave=wave)
        run(self._generate, slots // self._slots_per_item)


class StreamPass:
    """The pass ``stream``, which takes camera rays to the film in one kernel, and perhaps makes them."""

    def __init__(
        self,
        session: Session,
        plan: Plan,
        settings: RenderSettings,
        buffers: WaveBuffers,
        *,
        makes_rays: bool,
        keeps_rays: bool,
        packets: int,
    ) -> None:
        self._session, self._lanes, scene = session, session.lanes, buffers.scene
        self._camera_names = ("camera", "tables", "surfaces", "stop") if keeps_rays else ("camera", "tables")
        kept = {"rays": buffers.state} if keeps_rays else {}
        facts: dict[str, int | str] = {"RAYS_FILE": "integrator/read_rays.h"}
        if not makes_rays or keeps_rays:
            facts["BLOCKS_MANY"] = int(plan.camera.blocks_many)
        made: dict[str, Any] = {}
        if makes_rays:
            together = packets if plan.camera.crosses_surfaces and session.lanes > 1 else 1
            facts |= _camera_facts(plan) | {"CAMERA_PACKETS": together}
            facts["RAYS_FILE"] = f"integrator/{'kept' if keeps_rays else 'made'}_rays.h"
            made = {**self._of_camera(scene.camera), "filter": scene.filter, **scene.trajectory}
        self._makes_rays, self._alike = makes_rays, buffers.kindness
        program = _tracing_program(session, plan, buffers, ["pass/stream.cl"], facts)
        self._stream = session.bind(
            program, "stream", **scene.scene, **kept, **made, wave=_NO_WAVE, limits=ALIKE.limits(settings),
            sums=buffers.film.sums, counters=buffers.film.counters, pixels=np.uint32(buffers.film.pixels),
            tiles=buffers.tiles, kindness=buffers.kindness,
        )  # fmt: skip

    def take_over(self, scene: SceneBuffers, settings: RenderSettings) -> None:
        """Trace another plan, whose kernels are the same."""
        made = {**self._of_camera(scene.camera), "filter": scene.filter, **scene.trajectory} if self._makes_rays else {}
        self._stream.set(**scene.scene, **made, limits=ALIKE.limits(settings), kindness=self._alike)

    def use_roulette(self, limits: bytes, kindness: Any) -> None:
        """Play roulette by other limits, and by another buffer of how kind it is."""
        self._stream.set(limits=limits, kindness=kindness)

    def use_camera(self, camera: CameraModel) -> None:
        """Look through another state of the camera, where this pass makes its rays."""
        self._stream.set(**self._of_camera(camera_buffers(self._session, camera)))

    def enqueue(self, wave: bytes, pixels: int, slots: int, run: Run) -> None:
        """Trace a wave."""
        self._stream.set(wave=wave)
        run(self._stream, pixels // self._lanes)

    def _of_camera(self, buffers: dict[str, Any]) -> dict[str, Any]:
        return {name: buffers[name] for name in self._camera_names}


class DepthPasses:
    """The passes ``intersect``, ``shade`` and ``shadow`` for every depth of the paths, then ``film``."""

    def __init__(self, session: Session, plan: Plan, settings: RenderSettings, buffers: WaveBuffers) -> None:
        self._lanes = session.lanes
        files = ["pass/intersect.cl", "pass/shade.cl", "pass/shadow.cl", "pass/film.cl"]
        program, scene = _tracing_program(session, plan, buffers, files), buffers.scene.scene
        self._intersect = session.bind(program, "intersect", **scene, **buffers.slots)
        self._shadow = session.bind(program, "shadow", **scene, **buffers.slots) if plan.emitters.count else None
        self._shade = [
            session.bind(
                program, "shade", **scene, **buffers.slots, wave=_NO_WAVE, limits=ALIKE.limits(settings),
                depth=np.uint32(depth), tiles=buffers.tiles, kindness=buffers.kindness,
            )
            for depth in range(1, settings.max_depth + 1)
        ]  # fmt: skip
        self._film = session.bind(
            program, "film", **buffers.slots, sums=buffers.film.sums, counters=buffers.film.counters, wave=_NO_WAVE,
            pixels=np.uint32(buffers.film.pixels), tiles=buffers.tiles,
            **({"colours": buffers.scene.colours} if plan.facts["SPECTRUM"] else {}),
        )  # fmt: skip

    def use_roulette(self, limits: bytes, kindness: Any) -> None:
        """Play roulette by other limits, and by another buffer of how kind it is."""
        for shade in self._shade:
            shade.set(limits=limits, kindness=kindness)

    def enqueue(self, wave: bytes, pixels: int, slots: int, run: Run) -> None:
        """Trace a wave."""
        items = slots // self._lanes
        for shade in self._shade:
            run(self._intersect, items)
            shade.set(wave=wave)
            run(shade, items)
            if self._shadow is not None and shade is not self._shade[-1]:
                run(self._shadow, items)
        self._film.set(wave=wave)
        run(self._film, pixels // self._lanes)


@dataclass(frozen=True)
class Passes:
    """What takes a wave from the camera to the film and the layers."""

    camera: CameraPasses | None
    paths: StreamPass | DepthPasses
    layers: LayerPass | None


_NO_WAVE = bytes(WAVE.dtype.itemsize)
_NO_FACTS: Mapping[str, int | str] = {}


def _camera_facts(plan: Plan) -> dict[str, int | str]:
    """Return what the scene requires of the passes that make camera rays."""
    names = ("HAS_EMITTERS", "SAMPLER_LATTICE", "HAS_MESH", "MOVES", "CAMERA_SEGMENTS")
    return {
        **plan.camera.facts,
        **plan.spectrum.facts,
        **{name: plan.facts[name] for name in names},
        "CAMERA_FILE": plan.camera.kernel,
        "CAMERA_HAS_LENS": int(plan.camera.has_lens),
        "FILTER": plan.camera_filter.cells,
    }


def _tracing_program(
    session: Session, plan: Plan, buffers: WaveBuffers, files: list[str], more: Mapping[str, int | str] = _NO_FACTS
) -> Program:
    facts = {**plan.facts, **buffers.scene.tree_facts, "VW": session.lanes, **more}
    return session.program(files, facts, device_declarations())


def signature(plan: Plan, scene: SceneBuffers, layout: FilmLayout, settings: RenderSettings) -> tuple[Any, ...]:
    """Return all that programs and sizes of a `Wavefront` follow from: one can render all plans of its signature."""
    camera = plan.camera
    facts = (plan.facts, camera.facts, scene.tree_facts, plan.spectrum.facts)
    compiled = tuple(tuple(sorted(each.items())) for each in facts)
    film = layout, settings.layers, settings.clamp is None
    return compiled, camera.kernel, camera.has_lens, plan.camera_filter.cells, film
