"""The passes of one scene: kernels compiled, bound and ordered; rays of lenses in float64; the trial of a driver."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.records import WAVE, device_declarations, floats_per_slot
from rptcam_cl.core.remember import Disk, checkpoint, is_cancellable
from rptcam_cl.device.devices import driver_name, is_proven, refuse
from rptcam_cl.device.programs import Program
from rptcam_cl.device.session import Launch, Session
from rptcam_cl.rendering.cameras.model import CELLS, CameraModel
from rptcam_cl.rendering.film import ALIKE, QUARTER, FilmBuffers, FilmLayout
from rptcam_cl.rendering.layers import LayerPass, LayerPlanes
from rptcam_cl.rendering.plan.plan import Plan, make_plan
from rptcam_cl.rendering.scene_buffers import SceneBuffers, camera_buffers
from rptcam_cl.scene.film import RenderSettings
from rptcam_cl.scene.load import load_scene

#
# Two passes in front of `generate` that take the rays of a wave through the lens in float64.
#
# The first chooses film point and aim in float32, as `generate` does; the second, compiled for double, traces.

DOUBLE_LANES = 8  # per work item of a CPU
_PRECISE_PACKETS = 2  # of lanes that a work item traces side by side
_BYTES_PER_SLOT = 32  # see kernels/lens/float64.h


def traces_in_float64(camera: CameraModel) -> bool:
    """Return whether a camera's rays go through its lens in float64."""
    return camera.facts.get("LENS_FLOAT64", 0) > 0


def check_precision(session: Session, camera: CameraModel) -> None:
    """Refuse a camera that a device cannot trace.

    Raises
    ------
    DeviceError
        When its lens is to be traced in float64 and the device has none.
    """
    if traces_in_float64(camera) and not session.info.fp64:
        raise DeviceError(
            f"camera.precision: double needs float64, which device {session.info.id} {session.info.name} lacks"
            " (use single, or another device)"
        )


class PreciseLens:
    """The passes ``aim_rays`` and ``trace_lens`` with the rays between them.

    Parameters
    ----------
    session
        The device.
    camera
        Whose lens it is; its kernel and its facts are those of every later camera.
    facts
        Of the pass ``generate``, whose random numbers, film points and aims are used.
    capacity
        Slots of a wave.
    buffers
        Of the camera, as `rptcam_cl.rendering.scene_buffers.camera_buffers` returns them.
    tiles, filter_table, colours : buffers
        As ``generate`` takes them.

    Raises
    ------
    DeviceError
        When the device has no float64.
    """

    def __init__(
        self,
        session: Session,
        camera: CameraModel,
        facts: dict[str, int | str],
        capacity: int,
        buffers: Mapping[str, Any],
        tiles: Any,
        filter_table: Any,
        colours: Any,
    ) -> None:
        check_precision(session, camera)
        self.rays = session.allocate(_BYTES_PER_SLOT * capacity)
        self._aim_lanes = int(facts["VW"])
        lanes = DOUBLE_LANES if session.lanes > 1 else 1
        self._trace_lanes = _PRECISE_PACKETS * lanes
        aiming = session.program(["pass/aim_rays.cl"], facts, device_declarations())
        tracing = session.program(
            ["pass/trace_lens.cl"], camera.facts | {"VW": lanes, "DOUBLE": 1}, device_declarations()
        )
        slots, empty = np.uint32(capacity), bytes(WAVE.dtype.itemsize)
        self._aim = session.bind(
            aiming, "aim_rays", **_of(buffers, "camera", "tables"), wave=empty, tiles=tiles, filter=filter_table,
            colours=colours, rays=self.rays, capacity=slots,
        )  # fmt: skip
        self._trace = session.bind(
            tracing, "trace_lens", **_of(buffers, "surfaces", "stop"), count=np.int32(len(camera.surfaces)),
            rays=self.rays, capacity=slots,
        )  # fmt: skip

    def use_camera(self, buffers: Mapping[str, Any]) -> None:
        """Trace for another camera: its record, tables, surfaces and stop on the device."""
        self._aim.set(**_of(buffers, "camera", "tables"))
        self._trace.set(**_of(buffers, "surfaces", "stop"))

    def enqueue(self, wave: bytes, slots: int, run: Callable[[Launch, int], None]) -> None:
        """Enqueue both passes over a wave; ``run`` takes a launch and the number of its work items."""
        self._aim.set(wave=wave)
        run(self._aim, slots // self._aim_lanes)
        run(self._trace, slots // self._trace_lanes)


def _of(buffers: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {name: buffers[name] for name in names}


#
# The passes of one scene: its kernels, compiled and bound to their buffers, and the order in which a wave takes them.
#
# A wave is a batch of camera rays, one per slot, made by the pass generate, or by the stream itself where no layers
# want the rays and no lens is traced in float64. Two organisations take it to the film:
#
# passes Per depth of the paths the kernels intersect, shade and shadow run over all slots, then film adds the
# radiances. State lives in memory and stays in place; groups of slots without a living path are skipped. stream One
# kernel carries a few neighbouring pixels through all samples of the wave, with the same steps; a lane whose path has
# ended starts the next camera ray of its pixel. No state in memory, no idle lanes, three launches a depth fewer.
# Measured on two CPU cores: 1.15 times the passes on three spheres, 1.55 on a Cornell box. Rays without a lens are
# made by the lanes that start them, 1.2 to 1.3 times as fast as with generate; those behind a lens by each work item
# for its pixels, packets side by side, before it starts: 1.15 times.

_LENS_LANES = 16  # lanes per work item that trace a lens on a CPU: its surfaces are long chains of roots
PACKETS = 4  # of lanes that a work item of a CPU takes through a lens side by side

SORTED, SORTERS = 2048, 64  # slots that are sorted together, and work items that do it: kernels/pass/sort.cl

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
    survival_scale : buffer
        Of roulette, the same everywhere.
    capacity : int
        Slots of a wave.
    """

    scene: SceneBuffers
    film: FilmBuffers
    state: Any
    tiles: Any
    survival_scale: Any
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
    """How large the state of the paths is, without the rays of a lens traced in float64."""
    return 4 * floats_per_slot(plan.facts, stream=stream) * capacity


def bytes_of_lens_rays(plan: Plan, capacity: int) -> int:
    """How large the rays of a lens traced in float64 are; 0 for other cameras."""
    return _BYTES_PER_SLOT * capacity if traces_in_float64(plan.camera) else 0


STEPS_OF_LAUNCH = 1 << 25  # 0.3 s of a laptop's GPU: docs/devices.md, "How long a launch takes"
_TRACKED = 5  # ways through grids of density at a vertex: where it is, what shines, to a point, and from two to lamps


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
        """Enqueue a launch over ``items`` work items, in pieces where a GPU would take too long for all."""
        group = launch.group or min(self._group, items)
        most = items
        if self._session.kind == "gpu":
            most = max(int(STEPS_OF_LAUNCH / launch.steps) // group, 1) * group
        for first in range(0, items, most):
            self.count += 1
            event = launch.enqueue(min(most, items - first), group, first)
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
        lanes = _LENS_LANES if camera.has_lens and session.lanes > 1 else session.lanes
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
            program, "generate", **buffers.slots, **_arguments_of(scene), counters=buffers.film.counters, wave=_NO_WAVE,
            tiles=buffers.tiles, **({} if self._lens is None else {"traced": self._lens.rays}),
        )  # fmt: skip

    def take_over(self, scene: SceneBuffers) -> bool:
        """Make the rays of another plan, whose kernels are the same; return whether that can be."""
        if self._lens is not None:
            return False
        self._generate.set(**_arguments_of(scene))
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


def _arguments_of(scene: SceneBuffers) -> dict[str, Any]:
    """The arguments of ``generate`` that a scene decides."""
    return {**scene.camera, **scene.trajectory, "filter": scene.filter, "colours": scene.colours}


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
        if makes_rays:
            together = packets if plan.camera.crosses_surfaces and session.lanes > 1 else 1
            facts |= _camera_facts(plan) | {"CAMERA_PACKETS": together}
            facts["RAYS_FILE"] = f"integrator/{'kept' if keeps_rays else 'made'}_rays.h"
        self._makes_rays, self._alike = makes_rays, buffers.survival_scale
        program = _tracing_program(session, plan, buffers, ["pass/stream.cl"], facts)
        self._stream = session.bind(
            program, "stream", **self._of_scene(scene), **kept, wave=_NO_WAVE, limits=ALIKE.limits(settings),
            sums=buffers.film.sums, counters=buffers.film.counters, pixels=np.uint32(buffers.film.pixels),
            tiles=buffers.tiles, survival_scale=buffers.survival_scale,
        )  # fmt: skip

    def take_over(self, scene: SceneBuffers, settings: RenderSettings) -> None:
        """Trace another plan, whose kernels are the same."""
        self._stream.set(**self._of_scene(scene), limits=ALIKE.limits(settings), survival_scale=self._alike)

    def use_roulette(self, limits: bytes, survival_scale: Any) -> None:
        """Play roulette by other limits, and by another buffer of survival scales."""
        self._stream.set(limits=limits, survival_scale=survival_scale)

    def use_camera(self, camera: CameraModel) -> None:
        """Look through another state of the camera, where this pass makes its rays."""
        self._stream.set(**self._of_camera(camera_buffers(self._session, camera)))

    def enqueue(self, wave: bytes, pixels: int, slots: int, run: Run) -> None:
        """Trace a wave."""
        self._stream.set(wave=wave)
        run(self._stream, pixels // self._lanes)

    def _of_scene(self, scene: SceneBuffers) -> dict[str, Any]:
        """The arguments that a scene decides, its camera among it where this pass makes the rays."""
        own = {**self._of_camera(scene.camera), "filter": scene.filter, **scene.trajectory} if self._makes_rays else {}
        return scene.scene | own

    def _of_camera(self, buffers: dict[str, Any]) -> dict[str, Any]:
        return {name: buffers[name] for name in self._camera_names}


class DepthPasses:
    """The passes ``intersect``, ``sort``, ``shade`` and ``shadow`` for every depth of the paths, then ``film``.

    Where a scene has media, ``travel`` stands in place of ``intersect``. Only paths of one lane are sorted.
    """

    def __init__(self, session: Session, plan: Plan, settings: RenderSettings, buffers: WaveBuffers) -> None:
        self._lanes, self._max_depth, scene = session.lanes, settings.max_depth, buffers.scene.scene
        has_media = plan.facts["HAS_MEDIA"] > 0
        names = ("travel" if has_media else "intersect", "sort", "shade", "shadow", "film")
        program = _tracing_program(session, plan, buffers, [f"pass/{name}.cl" for name in names])
        of_depth = {**buffers.slots, "depth": np.uint32(1)}
        of_wave = {"wave": _NO_WAVE, "tiles": buffers.tiles}
        of_path = {**scene, **of_depth, **of_wave, "limits": ALIKE.limits(settings)}
        self._search = session.bind(program, names[0], **(of_path if has_media else {**scene, **of_depth}))
        self._search.steps = max(_TRACKED * plan.media.steps, 1.0)
        materials = {name: scene[name] for name in ("primitives", "materials")}
        self._sort = session.bind(program, "sort", **materials, **of_depth, wave=_NO_WAVE)
        self._shade = session.bind(program, "shade", **of_path, survival_scale=buffers.survival_scale)
        self._of_depth, self._shadow = [self._search, self._sort, self._shade], None
        self._of_wave = self._of_depth[0 if has_media else 1 :]
        tracks = plan.facts["HAS_DENSITY"] > 0  # whether shadow rays take random numbers
        self._follows = plan.facts["LAMPS_BEHIND_GLASS"] > 0
        if plan.emitters.count:
            more: dict[str, Any] = {"left": np.int32(0)} if self._follows else {}
            more |= {**of_depth, **of_wave} if tracks else buffers.slots
            self._shadow = session.bind(program, "shadow", **scene, **more)
            self._shadow.steps = max(plan.media.steps, 1.0)
            self._of_depth += [self._shadow] * tracks
            self._of_wave += [self._shadow] * tracks
        self._film = session.bind(
            program, "film", **buffers.slots, sums=buffers.film.sums, counters=buffers.film.counters, wave=_NO_WAVE,
            pixels=np.uint32(buffers.film.pixels), tiles=buffers.tiles,
            **({"colours": buffers.scene.colours} if plan.facts["SPECTRUM"] else {}),
        )  # fmt: skip

    def use_roulette(self, limits: bytes, survival_scale: Any) -> None:
        """Play roulette by other limits, and by another buffer of survival scales."""
        self._shade.set(limits=limits, survival_scale=survival_scale)

    def enqueue(self, wave: bytes, pixels: int, slots: int, run: Run) -> None:
        """Trace a wave."""
        items = slots // self._lanes
        for launch in (*self._of_wave, self._film):
            launch.set(wave=wave)
        for depth in range(1, self._max_depth + 1):
            for launch in self._of_depth:
                launch.set(depth=np.uint32(depth))
            run(self._search, items)
            if self._lanes == 1:
                run(self._sort, -(-slots // SORTED) * SORTERS)
            run(self._shade, items)
            if self._shadow is not None and depth < self._max_depth:
                if self._follows:
                    self._shadow.set(left=np.int32(self._max_depth - depth))
                run(self._shadow, items)
        run(self._film, pixels // self._lanes)


Passes = tuple[CameraPasses | None, StreamPass | DepthPasses | None, LayerPass | None]
"""What takes a wave from the camera to the film and the layers."""


_NO_WAVE = bytes(WAVE.dtype.itemsize)
_NO_FACTS: Mapping[str, int | str] = {}


def _camera_facts(plan: Plan) -> dict[str, int | str]:
    """The facts of the scene for the passes that make camera rays."""
    names = ("HAS_EMITTERS", "SAMPLER_LATTICE", "HAS_MESH", "MOVES", "CAMERA_SEGMENTS", "LIGHT_GROUPS")
    return {
        **plan.camera.facts,
        **plan.spectrum.facts,
        **{name: plan.facts[name] for name in names},
        "CAMERA_FILE": plan.camera.kernel,
        "CAMERA_HAS_LENS": int(plan.camera.has_lens),
        "FILTER": CELLS if len(plan.camera_filter) > 1 else 0,
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
    film = layout, settings.layers, settings.clamp is None, settings.max_depth == 0
    return compiled, camera.kernel, camera.has_lens, len(plan.camera_filter), film


#
# Whether a driver renders right pictures: one small known scene, rendered the way that a picture will be.
#
# A compiler may make garbage of a kernel that it builds and runs without an error: PoCL 7.1 did so of rays that go
# through a lens side by side. So the first picture on a driver waits until it has rendered a scene whose film is
# known: a lens in front of a mesh that a lamp lights, and of a lamp. Where the usual way is wrong, others are tried.
# What passes is kept for this driver, device and version, and costs the next run nothing. Of quick programs, which
# the compiler takes otherwise, there is a trial of their own. PoCL from pip needs none: all tests are its trial.

SCALE = 256
SAMPLES = 2 * PACKETS  # two steps of a work item that keeps rays
# The left half shows the mesh, the upper right the lamp, the lower right nothing.
SCENE: dict[str, Any] = {
    "film": {"resolution": [16, 16]},
    "camera": {
        "kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 0.5}, "eye": [0, 0, 0],
        "target": [0, 0, -1], "up": [0, 1, 0],
    },
    "render": {"spp": SAMPLES, "max_depth": 3, "roulette_depth": 8},
    "objects": [
        {
            "shape": "mesh", "vertices": [[-2, -2, -2], [0, -2, -2], [0, 2, -2], [-2, 2, -2]],
            "faces": [[0, 1, 2], [0, 2, 3]], "material": {"kind": "matte", "reflectance": 0.5},
        },
        {
            "shape": "rectangle", "corner": [0.05, 0.05, -2], "edge_u": [2, 0, 0], "edge_v": [0, 2, 0],
            "material": {"kind": "emissive", "radiance": 1},
        },
    ],
    "lights": [{"kind": "point", "position": [-0.3, 0, -1], "intensity": 3}],
}  # fmt: skip
KNOWN = bytes.fromhex(
    "0d11161a1a211b152f6c69624a4b372e0f181f1c26222a2b3c747f656a5a4136191b242831353731309d81877a6958421f1f333b3c374639519ba69f8e7a6658"
    "252e3a444b51524f40c9b8a79d897361282a393e56595d5c47dacdbc91977e6826363a535b6456334fe9dacbb498855f283248465e685b492158374d2e4b3120"
    "30334859626a714a00000000000000002d3944535f63684700000000000000002a35373e52595f4e00000000000000001c2f39443c4c52360d00000000000000"
    "1d292f363f4245450b000000000000001822242c29353931080000000000000013191b2426272b2406000000000000000a10121b1c1a20150000000000000000"
)  # the film, row by row: SCALE times the radiance
PASSED = 1971  # of 2048 rays, through the lens
CLOSE = 2  # by which rounding may change a pixel, in the same unit
_ELSEWHERE = 0.03  # share of pixels that paths rounding sends elsewhere may change

_passed: dict[tuple[Any, ...], Way] = {}
_trying = threading.Lock()


@dataclass(frozen=True)
class Way:
    """How a device renders: "stream" or "passes", and packets of rays that go through a lens together."""

    organisation: str
    packets: int

    def __str__(self) -> str:
        together = "" if self.packets == 1 else f" with {self.packets} packets of rays together"
        return f"{self.organisation}{together}"


_DISK = Disk("devices")


def way_of(session: Session, organisation: str, wavefront: Callable[..., Any]) -> Way:
    """Return the way in which a device renders right pictures: the usual one, else one that goes round its fault.

    Parameters
    ----------
    organisation
        The usual one.
    wavefront
        `rptcam_cl.rendering.tracer.Wavefront`.

    Raises
    ------
    DeviceError
        When the device renders wrong pictures in every way.
    """
    many = (Way(organisation, PACKETS),) if session.lanes > 1 else ()
    ways: tuple[Way, ...] = tuple(dict.fromkeys((*many, Way(organisation, 1), Way("passes", 1))))
    if is_proven(session.info.handle):
        return ways[0]
    facts = session.lanes, session.is_quick, ways
    with _trying:
        key = session.info.id, *facts
        if key not in _passed:
            named = driver_name(session.info.handle), facts
            place = _DISK.find_or_make(named, lambda: _first_right(session, ways, wavefront))
            if place > 0:
                device = f"device {session.info.id} {session.info.name}"
                warnings.warn(
                    f"{device}: its driver renders wrong pictures as {ways[0]}, so it renders as {ways[place]}, slower",
                    stacklevel=1,
                )
            _passed[key] = ways[place]
        return _passed[key]


def _first_right(session: Session, ways: tuple[Way, ...], wavefront: Callable[..., Any]) -> int:
    """Return the place of the first way that passes."""
    faults = []
    for place, way in enumerate(ways):
        fault = fault_of(session, way, wavefront)
        if fault is None:
            return place
        faults.append(f"as {way}, {fault}")
    raise DeviceError(refuse(session.info, f"its driver renders wrong pictures: {'; '.join(faults)}"))


def fault_of(session: Session, way: Way, wavefront: Callable[..., Any]) -> str | None:
    """Find what is wrong with the known picture as a device renders it in a way; None where it is right."""
    scene = load_scene(SCENE)
    made = wavefront(
        session.alone(), make_plan(scene), FilmLayout.of(scene.film), scene.render, organisation=way.organisation,
        packets=way.packets, scouts=False,
    )  # fmt: skip
    for wave in made.waves(0, SAMPLES):
        made.enqueue(*wave)
    made.finish()
    film = made.picture(SAMPLES).astype(np.float64).mean(axis=2).ravel()
    known = np.frombuffer(KNOWN, np.uint8) / SCALE
    wrong = int((~(np.abs(film - known) <= CLOSE / SCALE)).sum())
    if wrong > _ELSEWHERE * known.size:
        return f"{wrong} of {known.size} pixels (mean {film.mean():.3g} for {known.mean():.3g})"
    passed = made.outcomes()["passed"]
    return None if abs(passed - PASSED) <= _ELSEWHERE * PASSED else f"{passed} rays through the lens for {PASSED}"


#
# A picture of few samples made smooth by what its layers say of surfaces, for a viewfinder: soon, and biased.
#
# A wavelet with holes (Dammertz et al., HPG 2010), joint bilateral on albedo, normal and depth; luminance counts by its
# variance among neighbours, so that the filter does ever less as samples come in (Schied et al., HPG 2017).

STEPS = (1, 1, 3, 9)  # between neighbours [pixels]: of the first, which measures the noise, and without holes in all
MARGIN = 16  # more than the largest step
_GUIDE_PLANES, _LIGHT_PLANES = 11, 11


class Denoiser:
    """Smooths pictures of one size on a device.

    Parameters
    ----------
    session
        The device.
    width, height
        Of the pictures [pixels].
    """

    def __init__(self, session: Session, width: int, height: int) -> None:
        self._session, self._lanes = session, session.lanes
        self._size = width, height
        wide = -(-width // self._lanes) * self._lanes
        self._row, rows = wide + 2 * MARGIN, height + 2 * MARGIN
        self._plane = self._row * rows
        self._groups = wide // self._lanes
        self._sizes = np.array([width, height, self._row, MARGIN], np.uint32)
        self._guides = session.allocate(4 * _GUIDE_PLANES * self._plane, zeroed=True)
        self._lights = [session.allocate(4 * _LIGHT_PLANES * self._plane, zeroed=True) for _ in range(2)]
        self._read = session.program(["pass/guides.cl"], {}, device_declarations())
        self._picture = session.allocate(12 * width * height)
        self._passes = [
            (session.program(["pass/denoise.cl"], {"VW": self._lanes, **_facts_of(number)}, ""), step)
            for number, step in enumerate(STEPS)
        ]

    def _items(self, count: int) -> int:
        """A number of work items, filled up to whole groups."""
        return -(-count // self._session.group) * self._session.group

    def clean(
        self, pixels: NDArray[np.float32], layers: LayerPass, samples: int, blur: tuple[float, float] = (0.0, 0.0)
    ) -> NDArray[np.float32]:
        """Return a picture (height, width, 3) smoothed by layers of the same film: `GUIDES`, of so many samples.

        Parameters
        ----------
        blur
            Blur of what is 1 / m nearer than the focus [pixels], and 1 / the distance of that [1 / m].
        """
        session, (width, height) = self._session, self._size
        session.write(self._picture, np.ascontiguousarray(pixels))
        session.bind(self._read, "guides", **layers.as_guides, picture=self._picture, out=self._guides,
            light=self._lights[0], sizes=self._sizes.tobytes(), plane=np.uint32(self._plane),
            camera=np.array([1 / samples, *blur, 0], np.float32).tobytes(),
        ).enqueue(self._items(-(-width // QUARTER) * height), session.group)  # fmt: skip
        source, target = self._lights
        for program, step in self._passes:
            session.bind(
                program, "denoise", guides=self._guides, light=source,
                out=self._picture if step == STEPS[-1] else target,
                sizes=self._sizes.tobytes(), plane=np.uint32(self._plane), step=np.int32(step),
            ).enqueue(self._items(self._groups * height), session.group)  # fmt: skip
            source, target = target, source
            if is_cancellable():
                session.finish()
                checkpoint()
        return session.read(self._picture, np.float32, 3 * width * height).reshape(height, width, 3)


def _facts_of(number: int) -> dict[str, int]:
    """What the kernel ``denoise`` does in a step: blur hides what albedo does to the far ones."""
    return {
        "FIRST": int(number == 0),
        "TINTED": int(0 < number < len(STEPS) - 1),
        "LAST": int(number == len(STEPS) - 1),
    }
