"""The wavefront path tracer of one device: its memory, waves of paths, and kernels compiled by a process apart."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import free_host_bytes
from rptcam_cl.core.remember import Memory
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.rendering import film as films
from rptcam_cl.rendering import passes
from rptcam_cl.rendering.cameras.model import CameraModel, CameraView
from rptcam_cl.rendering.film import FilmBuffers, FilmLayout, RenderedFilm
from rptcam_cl.rendering.layers import LayerPass, LayerPlanes
from rptcam_cl.rendering.passes import Denoiser
from rptcam_cl.rendering.photon_map import PHOTON_BYTES, PhotonMap
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.rendering.virtual_lights import LIGHT_PATH_BYTES, VirtualLightPool
from rptcam_cl.scene.film import RenderSettings

# What a render will hold on the device, added up before anything is allocated: running out kills a CPU's process.

SHARE = 0.8  # of the memory that a render may plan to use
# Upper bounds over the meshes that were measured (benchmarks/journal.md): nodes and leaf blocks on the device (51 on
# smooth meshes, whose blocks are nine tenths full), and on a CPU what building them takes besides for a while.
_TREE_BYTES_PER_TRIANGLE = 80
_BUILD_BYTES_PER_TRIANGLE = 90
_SMALLER_FILM = "render a part with crop, or lower film.resolution"
_FEWER_TRIANGLES = "use meshes of fewer triangles, or several objects of one mesh"
_SMALLER_PICTURES = "use smaller pictures"


@dataclass(frozen=True)
class MemoryNeeds:
    """Bytes by use.

    Attributes
    ----------
    film, paths, triangles, textures, rest : int
        Sums and layers per pixel; state of a wave; meshes with their trees; texels; all other arrays of the scene.
    building : int
        Needed only while trees are built, and only where device and host share their memory.
    largest : tuple
        The largest buffer: for what it is, its bytes, and what would make it smaller.
    """

    film: int
    paths: int
    triangles: int
    textures: int
    rest: int
    building: int
    largest: tuple[str, int, str] = ("nothing", 0, "")

    @property
    def total(self) -> int:
        """All of it at its highest."""
        return self.film + self.triangles + self.textures + self.rest + max(self.paths, self.building)


def memory_needs(plan: Plan, session: Session, *, film: Sequence[int], paths: Sequence[int]) -> MemoryNeeds:
    """Add up what a plan needs besides the buffers of ``film`` and ``paths`` [bytes each]."""
    triangles = building = 0
    if plan.meshes is not None:
        count = len(plan.meshes.triangles)
        triangles = plan.meshes.vertices.nbytes + plan.meshes.triangles.nbytes + _TREE_BYTES_PER_TRIANGLE * count
        building = _BUILD_BYTES_PER_TRIANGLE * count if session.info.type == "cpu" else 0
    textures = plan.textures.texels.nbytes + plan.surroundings.distribution.nbytes
    rest = plan.primitives.nbytes + plan.materials.nbytes + plan.emitters.records.nbytes + plan.emitters.curve.nbytes
    rest += plan.emitters.tree.nodes.nbytes if plan.emitters.tree is not None else 0
    rest += plan.caustics.surfaces.nbytes + PHOTON_BYTES if plan.caustics.active else 0
    rest += plan.virtual_lights.surfaces.nbytes + LIGHT_PATH_BYTES if plan.virtual_lights.active else 0
    buffers = [
        ("the film", max(film), _SMALLER_FILM),
        ("the paths of a wave", max(paths), "use waves of fewer paths"),
        ("the pixels of pictures", plan.textures.texels.nbytes, _SMALLER_PICTURES),
        ("the picture around the scene", plan.surroundings.distribution.nbytes, _SMALLER_PICTURES),
    ]
    if plan.meshes is not None:
        buffers += [
            ("vertices", plan.meshes.vertices.nbytes, _FEWER_TRIANGLES),
            ("triangles", plan.meshes.triangles.nbytes, _FEWER_TRIANGLES),
        ]
    return MemoryNeeds(
        sum(film), sum(paths), triangles, textures, rest, building, max(buffers, key=lambda each: each[1])
    )


def check_memory(needs: MemoryNeeds, session: Session) -> None:
    """Refuse a render that the device cannot hold, all together or in one of its buffers.

    Raises
    ------
    InputError
        With every use that matters, and what would make it smaller.
    """
    what, size, cure = needs.largest
    if size > session.largest_buffer_bytes:
        raise InputError(
            f"the scene needs {amount(size)} for {what}; device {session.info.id} takes at most"
            f" {amount(session.largest_buffer_bytes)} in one piece ({cure})"
        )
    budget = _memory_budget(session)
    if needs.total <= budget:
        return
    parts = {
        "the film": needs.film,
        "the paths": needs.paths,
        "triangles and their trees": needs.triangles,
        "building those trees": needs.building,
        "textures": needs.textures,
        "the rest of the scene": needs.rest,
    }
    listed = ", ".join(f"{amount(count)} for {name}" for name, count in parts.items() if count >= 0.01 * needs.total)
    cure = max(
        (needs.film, _SMALLER_FILM),
        (needs.triangles + needs.building, _FEWER_TRIANGLES),
        (needs.textures, _SMALLER_PICTURES),
    )[1]
    raise InputError(
        f"the scene needs {amount(needs.total)}: {listed}; device {session.info.id} offers {amount(budget)} ({cure})"
    )


def _memory_budget(session: Session) -> int:
    """How much memory a render may plan with [bytes]; on a CPU also not more than the host has free."""
    offered = session.info.memory_bytes
    if session.info.type == "cpu" and (free := free_host_bytes()) is not None:
        offered = min(offered, free)
    return int(SHARE * offered)


def amount(count: int) -> str:
    """Return a number of bytes as people read it."""
    for unit, size in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count} bytes"


# The wavefront path tracer of one device: waves of paths go through the passes and add to the film.

ORGANISATION = {"cpu": "stream", "gpu": "passes"}


class Wavefront(RenderedFilm):
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
        Depth, roulette and seed. With a depth of 0 camera rays are added to the layers, and the film stays empty.
    wave_size
        Slots of a wave; rounded to a multiple of 256. The film does not depend on it.
    organisation
        "stream" or "passes" (see `rptcam_cl.rendering.passes`); by default what suits the device and is right on it.
    packets
        Of rays that a work item takes through a lens together, on a CPU; not read without ``organisation``.
    buffers
        The scene on the device, where it is there already; by default that of the plan is uploaded.
    scouts
        Whether it looks at the picture before its first sample, to see where paths should survive roulette.
    single
        Whether a wave has one sample of each pixel; that of an exposure in which keys move has.

    Attributes
    ----------
    seed : int
        Of the waves that are enqueued from now on.
    tiles : (n,) array
        List of the tiles to render, filled up to whole blocks.
    needs : MemoryNeeds
        What it holds on the device.

    Raises
    ------
    InputError
        When film and paths do not fit the device.
    DeviceError
        When the lens is to be traced in float64 and the device has none.
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
        *,
        scouts: bool = True,
        single: bool = False,
        packets: int = passes.PACKETS,
    ) -> None:
        self._layers_only = settings.max_depth == 0
        self._scouts = scouts and not self._layers_only
        self.session, self.layout, self.settings = session, layout, settings
        self.seed = settings.seed
        usual = ORGANISATION[session.kind]
        self._way = passes.Way(organisation, packets) if organisation else passes.way_of(session, usual, Wavefront)
        self.organisation = self._way.organisation
        self.tiles = layout.whole_list()
        slots, stream = (
            wave_size or films.wave_slots(session.kind, session.info.compute_units),
            self.organisation == "stream",
        )
        self._waves = films.Waves(
            layout, slots, stream=stream, loop_limit=session.loop_limit,
            in_passes=plan.caustics.active or plan.virtual_lights.active,
            single=single or len(plan.steps) > 1,
        )  # fmt: skip
        self._launches = passes.Launches(session)
        self._held = self._allocate(plan, buffers)
        self._film, self._tile_list = self._held.film, self._held.tiles
        self._bind(plan)
        self._begin(plan)

    def _begin(self, plan: Plan) -> None:
        """Have the picture of a plan looked at before its first sample, where that scales the survival in roulette."""
        self._plan = plan
        self._to_scout = self._scouts and films.plays(self.settings) and not plan.caustics.active

    def _bind(self, plan: Plan) -> None:
        """Bind the passes of a plan, or of each step of its exposure."""
        self._photons, self._virtual_lights = self._photon_map(plan), self._virtual_light_pool(plan)
        if not plan.steps:
            self._bound = [self._passes(plan, self._held, None)]
        else:
            self._bound = []
            scene = self._held.scene
            for step in plan.steps:
                scene = SceneBuffers(self.session, step, scene)
                first = self._bound[0][2] if self._bound else None  # whose planes all add to
                self._bound.append(self._passes(step, replace(self._held, scene=scene), first))
        self._use_step(0)

    def _use_step(self, sample: int) -> None:
        """Have the passes in place of the step of the exposure that a sample is of."""
        steps = len(self._bound)
        bound = self._bound[0 if steps == 1 else films.step_of(sample, steps)]
        self._camera, self._paths, self._layers = bound

    def _passes(self, plan: Plan, held: passes.WaveBuffers, first: LayerPass | None) -> passes.Passes:
        session, stream, packets = self.session, self.organisation == "stream", self._way.packets
        made = passes.makes_rays(plan, self.settings, stream=stream)
        kept = passes.keeps_rays(plan, self.settings, stream=stream)
        camera = None if made else passes.CameraPasses(session, plan, held, stream=stream, packets=packets)
        paths: passes.StreamPass | passes.DepthPasses | None
        if self._layers_only:
            paths = None
        elif stream:
            paths = passes.StreamPass(
                session, plan, self.settings, held, makes_rays=made, keeps_rays=kept, packets=packets
            )
        else:
            paths = passes.DepthPasses(session, plan, self.settings, held)
        return camera, paths, self._layer_pass(plan, held, stream, first)

    def _photon_map(self, plan: Plan) -> PhotonMap | None:
        scene, pixels = self._held.scene, self.layout.full_width * self.layout.full_height
        if scene.photons is None or self._layers_only:
            return None
        facts, depth = plan.facts | scene.tree_facts, self.settings.max_depth
        return PhotonMap(self.session, plan.caustics, facts, scene.scene, scene.photons, depth, pixels)

    def _virtual_light_pool(self, plan: Plan) -> VirtualLightPool | None:
        scene, pixels = self._held.scene, self.layout.full_width * self.layout.full_height
        if scene.virtual_lights is None or self._layers_only:
            return None
        facts, depth = plan.facts | scene.tree_facts, self.settings.max_depth
        return VirtualLightPool(
            self.session, plan.virtual_lights, facts, scene.scene, scene.virtual_lights, depth, pixels,
            is_rough=plan.is_rough,
        )  # fmt: skip

    def _allocate(self, plan: Plan, scene: SceneBuffers | None) -> passes.WaveBuffers:
        session, layout, capacity = self.session, self.layout, self.capacity
        clamped = self.settings.clamp is not None
        stream = self.organisation == "stream"
        keeping = [each for each in plan.steps or (plan,) if passes.keeps_rays(each, self.settings, stream=stream)]
        state = max((passes.bytes_of_state(each, capacity, stream=stream) for each in keeping), default=0)
        groups = plan.facts["LIGHT_GROUPS"]
        bytes_of_planes = 4 * films.planes_of(clamped, groups), LayerPlanes(self.settings.layers).bytes_per_pixel
        film = [each * layout.pixels for each in bytes_of_planes]
        self.needs = memory_needs(plan, session, film=film, paths=[state, passes.bytes_of_lens_rays(plan, capacity)])
        check_memory(self.needs, session)
        tiles = session.allocate(self.tiles.nbytes)
        session.write(tiles, self.tiles)
        survival_scale = session.allocate(films.ALIKE.survival_scale.nbytes)
        session.write(survival_scale, films.ALIKE.survival_scale)
        return passes.WaveBuffers(
            scene=scene or SceneBuffers(session, plan),
            film=FilmBuffers(session, layout, clamped=clamped, groups=groups),
            state=session.allocate(max(state, 4)),
            tiles=tiles,
            survival_scale=survival_scale,
            capacity=capacity,
        )

    def _layer_pass(
        self, plan: Plan, held: passes.WaveBuffers, stream: bool, first: LayerPass | None
    ) -> LayerPass | None:
        planes = LayerPlanes(self.settings.layers)
        if not planes.names:
            return None
        return LayerPass(
            self.session, plan, self.layout, held.scene, planes, lanes=self.session.lanes, state=held.state,
            tiles=held.tiles, capacity=held.capacity, stream=stream, first=first,
        )  # fmt: skip

    @property
    def light_groups(self) -> tuple[str, ...]:
        """The names of the groups of lamps whose light is kept apart."""
        return self._plan.light_groups.names

    @property
    def scene_buffers(self) -> SceneBuffers:
        """The scene on the device."""
        return self._held.scene

    @property
    def capacity(self) -> int:
        """Slots of the path state."""
        return self._waves.capacity

    @property
    def samples_per_wave(self) -> int:
        """Samples per pixel that one wave holds."""
        return self._waves.samples

    @property
    def launches(self) -> int:
        """Kernel launches so far."""
        return self._launches.count

    @property
    def passes(self) -> dict[str, float]:
        """With profiling, the time of each pass since the last `clear`, up to the last `finish` [s]."""
        return self._launches.seconds

    def warm_up(self) -> None:
        """Run a smallest wave, because PoCL generates code at the first launch; then clear the film."""
        for sample in range(len(self._bound)):
            self.enqueue(0, min(films.BLOCK, self._waves.pixels), sample, 1)
        self.finish()
        self.clear()

    def generate_code(self) -> None:
        """Run a wave without samples, because PoCL generates code at the first launch; no path looks at the scene.

        Photons do, where there are any.
        """
        pixels = min(films.BLOCK, self._waves.pixels)
        record, run = self._waves.record((0, pixels, 0, 0), self.seed), self._launches.run
        self._use_passes(0)
        if self._camera is not None:
            self._camera.enqueue(record, pixels, run)
        if self._layers is not None:
            self._layers.set_wave(record, 0)
            run(self._layers.launch, pixels // self.session.lanes)
        if self._paths is not None:
            self._paths.enqueue(record, pixels, pixels, run)
        self._launches.finish()

    def clear(self) -> None:
        """Empty the film and every counter."""
        self._film.clear()
        self._launches.seconds.clear()
        if self._layers is not None:
            self._layers.clear()

    def choose_tiles(self, tiles: NDArray[np.uint32]) -> None:
        """Render these tiles of the film from now on; before, and without any, they are all."""
        before, self.tiles = self.tiles, self.layout.filled_list(tiles)
        if len(self.tiles) and not np.array_equal(before, self.tiles):
            self.session.write(self._tile_list, self.tiles)

    def use_plan(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
        """Render another plan from now on, on an empty film; its `signature` is that of the first."""
        self.settings, self.seed = settings, settings.seed
        self._held = replace(self._held, scene=scene)
        if not self._take_over(plan):
            self._bind(plan)
        self._begin(plan)
        self.choose_tiles(np.arange(self.layout.tiles, dtype=np.uint32))
        self.clear()

    def _take_over(self, plan: Plan) -> bool:
        """Have the passes as they are bound render another plan; return whether they can."""
        scene = self._held.scene
        kept = self._photons, self._virtual_lights, scene.photons, scene.virtual_lights
        if plan.steps or len(self._bound) > 1 or any(each is not None for each in kept):
            return False
        if isinstance(self._paths, passes.DepthPasses) or not (self._camera is None or self._camera.take_over(scene)):
            return False
        if self._paths is not None:
            self._paths.take_over(scene, self.settings)
        if self._layers is not None:
            self._layers.take_over(plan, scene)
        return True

    def use_camera(self, camera: CameraModel) -> None:
        """Look through another state of the camera from now on; its kernel and its facts are those of the plan."""
        if self._camera is not None:
            self._camera.use_camera(camera)
        elif isinstance(self._paths, passes.StreamPass):
            self._paths.use_camera(camera)

    def waves(self, first_sample: int, samples: int) -> list[films.Wave]:
        """Return ``(first pixel, pixels, first sample, samples)`` of the waves that render a range of samples."""
        return self._waves.over(len(self.tiles), first_sample, samples)

    def enqueue(self, first_pixel: int, pixels: int, first_sample: int, samples: int) -> None:
        """Enqueue every pass of one wave."""
        if self._to_scout:
            self._use_roulette(self._scout())
        wave = (first_pixel, pixels, first_sample, samples)
        record, slots, run = self._waves.record(wave, self.seed), pixels * samples, self._launches.run
        self._film.expect(self._waves.rays_of(wave, self.tiles))
        self._use_passes(first_sample)
        if len(self._bound) > 1:
            self._use_step(first_sample)
        if self._camera is not None:
            self._camera.enqueue(record, slots, run)
        if self._layers is not None and first_sample < self.settings.layers_spp:
            seen = min(samples, self.settings.layers_spp - first_sample)
            self._layers.set_wave(record, seen)
            run(self._layers.launch, pixels // self.session.lanes)
        if self._paths is not None:
            self._paths.enqueue(record, pixels, slots, run)

    def _use_passes(self, sample: int) -> None:
        """Have in place what a sample sees of photons and of virtual lights."""
        if self._photons is not None:
            self._photons.use(sample, self.seed)
        if self._virtual_lights is not None:
            self._virtual_lights.use(sample, self.seed)

    def _scout(self) -> films.Roulette:
        """Render a few tiles of the picture, and scale the survival in roulette by them."""
        plan = self._plan.steps[0] if self._plan.steps else self._plan
        scene = SceneBuffers(self.session, plan, self._held.scene) if self._plan.steps else self._held.scene
        layout, settings = films.scout_layout(self.layout), self.settings.model_copy(update={"layers_spp": 0})
        scout = Wavefront(
            self.session, plan, layout, settings, layout.pixels, self.organisation, scene, scouts=False, single=True,
            packets=self._way.packets,
        )  # fmt: skip
        scout.seed = films.SCOUTING_SEED
        for wave in scout.waves(0, 1):
            scout.enqueue(*wave)
        scout.finish()
        picture = scout.picture(1)
        if settings.clamp is not None:  # which changes no path
            picture += layout.in_rows(scout.planes()[films.PLANES : films.PLANES + 1])[0, ..., None]
        return films.roulette_of(picture, layout)

    def _use_roulette(self, roulette: films.Roulette) -> None:
        self._to_scout = False
        survival_scale = self.session.allocate(roulette.survival_scale.nbytes)
        self.session.write(survival_scale, roulette.survival_scale)
        for paths in (paths for _, paths, _ in self._bound if paths is not None):
            paths.use_roulette(roulette.limits(self.settings), survival_scale)

    def finish(self) -> None:
        """Wait for everything enqueued and take over its counters."""
        self._launches.finish()
        self._film.finish()

    def planes(self) -> NDArray[np.float32]:
        """Return all of the film, (planes, pixels of the buffer)."""
        return self._film.planes()

    def picture(self, spp: int | NDArray[np.uint32]) -> NDArray[np.float32]:
        """Return the film's mean, shape (height, width, 3), over the samples per pixel, of all or of each tile."""
        tiles = np.broadcast_to(np.asarray(spp, np.uint32), self.layout.whole_list().shape)
        return self.layout.picture(self.sums(), tiles)

    def state(self) -> dict[str, NDArray[Any]]:
        """The arrays from which `restore` goes on as if nothing had happened."""
        arrays: dict[str, NDArray[Any]] = {"film": self.planes(), "counts": self.counts()}
        return arrays if self._layers is None else arrays | {"layers": self._layers.planes()}

    def counts(self) -> NDArray[np.uint64]:
        """Return rays by status, samples that were not finite, and camera rays, up to the last `finish`."""
        return self._film.all_counts()

    def clear_counts(self) -> None:
        """Count from 0 on."""
        self._film.clear_counts()

    def restore(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Go on from what `state` returned."""
        self._film.restore(arrays["film"], arrays["counts"])
        if self._layers is not None:
            self._layers.restore(arrays["layers"])

    def layers(self) -> dict[str, NDArray[Any]]:
        """Return the auxiliary layers by name, (height, width) or (height, width, channels)."""
        return {} if self._layers is None else self._layers.arrays(self._layers.planes())

    @property
    def photon_radius(self) -> float | None:
        """Radius over which photons were spread last [m]; None where there are none."""
        return None if self._photons is None else self._photons.radius

    @property
    def layer_pass(self) -> LayerPass | None:
        """The pass that fills the layers, where there are any."""
        return self._layers


# Wavefronts of one device for the plans to come, beside the scene that was uploaded last, from which the next one takes
# what it shares.

MOST = 5  # wavefronts that are kept: one of the picture, two of its glances, and those of what guides denoising


class WavefrontPool:
    """Makes wavefronts, and uses again those that fit: then only what has changed is uploaded.

    Parameters
    ----------
    session
        The device.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._scene: SceneBuffers | None = None
        self._wavefronts: Memory[Wavefront] = Memory(MOST)

    def upload(self, plan: Plan) -> SceneBuffers:
        """Return the arrays of a plan on the device; those that the last plan had too are there already."""
        self._scene = SceneBuffers(self._session, plan, self._scene)
        return self._scene

    def wavefront(
        self, plan: Plan, scene: SceneBuffers, layout: FilmLayout, settings: RenderSettings, purpose: str
    ) -> Wavefront:
        """Return a wavefront for a plan, with an empty film; it is the caller's until the next one of its purpose.

        Parameters
        ----------
        scene
            The plan, uploaded.
        purpose
            Wavefronts of another purpose stay as they are.
        """
        key = (purpose, *passes.signature(plan, scene, layout, settings))
        wavefront: Wavefront | None = self._wavefronts.find(key)
        if wavefront is None:
            self._wavefronts.make_room()
            wavefront = Wavefront(self._session, plan, layout, settings, buffers=scene, scouts=purpose == "film")
            self._wavefronts.add(key, wavefront)
        else:
            wavefront.use_plan(plan, scene, settings)
        return wavefront

    def close(self) -> None:
        """Let go of everything on the device."""
        self._wavefronts.clear()
        self._scene = None


#
# Kernels compiled by a process apart, which fills the driver's cache: the device goes on with the picture meanwhile.
#
# PoCL generates the code of a kernel when it is launched first, for seconds in which its device runs nothing else.
# What another process has launched once comes out of the cache.
#
# The process gets what programs follow from: the plan without its large arrays, and the arrays of the scene cut
# short. It runs a wave without samples, in which no path looks at them.

SMALL = FilmLayout(16, 16, 0, 0, 16, 16)  # programs do not depend on the film's size
MOST_BYTES = 1 << 16  # of each array of the scene
_MOST_WITH_PHOTONS = 1 << 26  # of each array, where photons look at the scene


def _compile_plan(device: str, plan: Plan, buffers: SceneBuffers, settings: RenderSettings) -> None:
    """Compile in this process what a plan needs on a device; the arrays of the plan are on the host."""
    session = open_session(device)
    wavefront = Wavefront(session, plan, SMALL, settings, buffers=buffers.uploaded_to(session))
    wavefront.generate_code()
    warm_up_denoiser(wavefront)


def warm_up_denoiser(wavefront: Wavefront) -> None:
    """Have the code of denoising generated, where a small wavefront is of the layers that guide it."""
    if wavefront.settings.max_depth == 0 and wavefront.layer_pass is not None:
        width, height = SMALL.width, SMALL.height
        Denoiser(wavefront.session, width, height).clean(
            np.zeros((height, width, 3), np.float32), wavefront.layer_pass, 1
        )


def order(session: Session, plan: Plan, buffers: SceneBuffers, settings: RenderSettings) -> bytes | None:
    """Pickle `_compile_plan` and its arguments for `CompileServer.compile`; None where they cannot be sent."""
    most = _MOST_WITH_PHOTONS if plan.caustics.active else MOST_BYTES
    if plan.caustics.active and buffers.most_bytes > most:
        return None
    light = replace(
        plan,
        camera=replace(plan.camera, view=CameraView(), reach=None, shares=None),  # which hold functions, or much
        meshes=None,
        textures=replace(plan.textures, texels=plan.textures.texels[:1]),
        surroundings=replace(plan.surroundings, distribution=plan.surroundings.distribution[:1]),
    )
    try:
        return pickle.dumps((_compile_plan, (session.info.id, light, buffers.on_host(light, most), settings)))
    except (pickle.PicklingError, AttributeError, TypeError):  # something in it holds a function
        return None
