"""What a render session does before samples can be taken: plans and kernels, of which only what changes is redone."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.job import Resolved, resolve
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.device.devices import CompileServer
from rptcam_cl.device.session import NotKeptError, Session
from rptcam_cl.rendering.account import reading_cd_m2
from rptcam_cl.rendering.lamps import aimed_plan
from rptcam_cl.rendering.layers import GUIDES
from rptcam_cl.rendering.passes import signature
from rptcam_cl.rendering.plan.plan import Plan, make_plan, serve, with_exposure, with_film, with_lens, with_pose
from rptcam_cl.rendering.plan.primitives import PlanParts
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.rendering.tracer import SMALL, Wavefront, WavefrontPool, order, warm_up_denoiser
from rptcam_cl.scene.camera import ANOTHER_LENS
from rptcam_cl.scene.changes import focus_keys, set_keys
from rptcam_cl.scene.exposure import LEAST_CD_M2, MOST_CD_M2
from rptcam_cl.scene.film import Film, RenderSettings
from rptcam_cl.scene.scene import Scene

# A scene as a session renders it, and what changes of it come to.

ChangeKind = Literal["none", "picture", "camera", "scene", "program"]
"""Kinds of change, as `Change` says them."""

# Facts that choose how light is found.
_WAYS = ("LIGHT_TREE", "CAUSTICS", "PANES_BY_SAMPLES", "TINY_LAMPS", "LAMPS_BEHIND_GLASS")
MOST_GUIDES = 8  # samples of the layers that guide denoising
OF_DEVELOPMENT = {"picture", "sequence"}  # parts of a scene that change no film: a sequence is of frames
OF_LIGHT = {"exposure", "shutter"}  # parts that only scale the film of a scene that stands still
_OF_THE_LENS = {"camera", "exposure", "picture", "sequence", "shutter"}  # parts that objects and lights do not go by


@dataclass(frozen=True, eq=False)
class SceneState:
    """A scene with all that rendering it takes.

    Attributes
    ----------
    scene : Scene
        As requested.
    resolved : Resolved
    plan : Plan
    buffers : SceneBuffers
        The plan on the device.
    is_final : bool
        Whether exposure and pupil are those of a render, and not found in a quicker way for glances.
    is_served : bool
        Whether its kernels were compiled for a scene with more in it; see `serve` of `rendering/plan/plan.py`.
    relief : SceneState or None
        The scene with kernels of its own, where those that serve it find light in another way than a render does.
    """

    scene: Scene
    resolved: Resolved
    plan: Plan
    buffers: SceneBuffers
    is_final: bool
    is_served: bool = False
    relief: SceneState | None = None


def focuses_anew(changes: Mapping[str, Any], scene: Scene) -> bool:
    """Whether a change asks for autofocus in the scene that it leads to, or takes another lens."""
    keys = [key.split(".") for key in changes]
    if any(key[0] == "camera" and (len(key) == 1 or key[1] in ANOTHER_LENS) for key in keys):
        return True
    return scene.requested_autofocus is not None and any(key[:2] == ["camera", "focus"] for key in keys)


def keep_focus(state: SceneState, scene: Scene) -> Scene:
    """Set the focus that was found for an earlier state, in a scene with autofocus."""
    known = state.resolved.focus
    if known is None or scene.requested_autofocus is None:
        return scene
    return set_keys(scene, focus_keys(scene, known["camera"]))


def changed_parts(before: Scene, after: Scene) -> tuple[str, ...]:
    """The sections of a scene that differ; `picture` also by the content of its files."""
    one, other = before.made_of, after.made_of
    differ = {name for name in Scene.model_fields if not _is_same(one.get(name), other.get(name))}
    if before.picture is not after.picture and before.picture.content_digests() != after.picture.content_digests():
        differ.add("picture")
    return tuple(name for name in Scene.model_fields if name in differ)


def _is_same(one: Any, other: Any) -> bool:
    if one is other:
        return True
    try:
        return bool(one == other)
    except ValueError:  # of arrays in them
        return False


def kind_of(before: Plan, after: Plan, compiled: bool, keys: tuple[str, ...]) -> ChangeKind:
    """The most expensive kind of change that another plan is."""
    if not compiled:
        return "program"
    return "camera" if before.facts == after.facts and set(keys) <= {"camera", "exposure", "shutter"} else "scene"


def _plan_for_glances(before: SceneState, scene: Scene, resolved: Scene, parts: PlanParts) -> Plan:
    """The plan of a scene for glances, made of the plan before where nothing but the lens differs."""
    earlier, parts_changed = before.resolved.scene, set(changed_parts(before.scene, scene))
    of_camera = [(each.camera, each.film, each.exposure.mode) for each in (earlier, resolved)]
    if (
        of_camera[0] == of_camera[1]
        and parts_changed <= OF_LIGHT | OF_DEVELOPMENT
        and stands_still(resolved)
        and not before.plan.steps
    ):
        return with_exposure(before.plan, resolved)
    same_time = earlier.shutter == resolved.shutter or _is_still(earlier, resolved)
    far = [(each.environment, each.lights, each.medium) for each in (earlier, resolved)]  # some go by the camera's up
    if same_time and parts_changed <= _OF_THE_LENS and far[0] == far[1]:
        if _moves_alone(before, scene, resolved):
            return with_pose(before.plan, resolved, parts)
        same_lens = earlier.lens_source() == resolved.lens_source()
        return with_lens(before.plan, resolved, coarse=True, colours_stay=same_lens)
    return make_plan(resolved, coarse=True, parts=parts)


def _is_of_another_pupil(before: Plan, after: Plan) -> bool:
    """Whether kernels of two plans differ in how camera rays aim at the pupil, and in nothing else of the camera."""
    one, other = before.camera.facts, after.camera.facts
    names = [name for name in {**one, **other} if one.get(name) != other.get(name)]
    return bool(names) and all(name.startswith("PUPIL_") for name in names)


def stands_still(scene: Scene) -> bool:
    """Whether nothing in a scene moves."""
    return not (scene.camera.motion or scene.shutter.keys or any(each.motion for each in scene.objects))


def _is_still(before: Scene, after: Scene) -> bool:
    """Whether two scenes differ in the moment alone, and nothing in them moves."""
    shutter = before.shutter.model_copy(update={"open_s": after.shutter.open_s})
    return shutter == after.shutter and stands_still(after)


def _moves_alone(before: SceneState, scene: Scene, resolved: Scene) -> bool:
    """Whether nothing but the pose of a camera differs, which focuses by no point of the scene."""
    earlier, camera = before.resolved.scene, resolved.camera
    focus = getattr(scene.camera, "focus", None)
    if getattr(focus, "point", None) or getattr(focus, "object", None):
        return False
    if camera.motion or scene.shutter.keys or before.plan.facts["MOVES"]:
        return False
    place = {"eye": camera.eye, "target": camera.target, "up": camera.up}
    alike = earlier.film == resolved.film and earlier.exposure == resolved.exposure
    return alike and earlier.camera.model_copy(update=place) == camera


def plan_smaller_film(state: SceneState, scale: float, reading: float | None) -> tuple[Plan, Film]:
    """Return the plan of a state with a film of fewer pixels, exposed by a reading of the meter; and that film."""
    film = state.resolved.scene.film
    columns, rows = (max(round(side * scale), 1) for side in film.resolution)
    if state.scene.camera.sees_all_around:
        columns = 2 * rows
    smaller = film.model_copy(update={"resolution": (columns, rows)})
    plan, metered = with_film(state.plan, state.resolved.scene, smaller), state.resolved.metered_cd_m2
    if metered is not None and reading is not None and not state.scene.exposure.lock_cd_m2:
        plan.camera.record["exposure"] *= metered / reading
    return plan, smaller


def reading_of(pixels: NDArray[np.float32], plan: Plan, state: SceneState, film: Film) -> float | None:
    """The reading of the exposure meter for a glance; None where it has seen a part of the film, or hardly light."""
    if film.crop is not None or film.transparent or state.scene.exposure.lock_cd_m2:
        return None
    reading = reading_cd_m2(pixels, state.scene.exposure, film) / plan.camera.value
    return reading if LEAST_CD_M2 <= reading <= MOST_CD_M2 else None


#
# What a session does before samples can be taken: focus, exposure, plans, kernels.
#
# Quick kernels compile in half the time and run twice as long. So the glances of a session that does not wait have
# them until another process has compiled the full ones.

_Wanted = tuple[Plan, SceneBuffers, RenderSettings]
"""What kernels are compiled for."""


def key_of(plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> tuple[Any, ...]:
    """The key of the kernels that a plan takes."""
    return signature(plan, scene, SMALL, settings)


def _compile_here(device: Session, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
    """Compile what a plan needs in this process."""
    wavefront = Wavefront(device, plan, SMALL, settings, buffers=scene, scouts=False)
    wavefront.warm_up()
    warm_up_denoiser(wavefront)


class SceneCompiler:
    """Plans scenes and compiles their kernels, at once or in the background, and knows what is compiled.

    In the background, a process apart compiles first where the driver would stop the device for it.

    Parameters
    ----------
    device
        The device.
    waits
        Whether everything is done with the full kernels.

    Attributes
    ----------
    pool : WavefrontPool
        Wavefronts of the full kernels.
    """

    def __init__(self, device: Session, *, waits: bool) -> None:
        self._device = device
        self.pool, self._parts = WavefrontPool(device), PlanParts()
        self._quick: Session | None = None
        if not waits and device.generates_late and device.lanes > 1:
            self._quick = device.quick()
            self._quick_pool = WavefrontPool(self._quick)
        self._quick_keys: set[Hashable] = set()  # of what quick kernels were compiled for
        self._done: set[Hashable] = set()
        self._failed: set[Hashable] = set()  # in the background
        self._missing: set[Hashable] = set()  # of what the driver has kept
        self._under_way: dict[Hashable, Future[None]] = {}
        self._threads = ThreadPoolExecutor(1, "rptcam-compile")
        self._compiler = CompileServer()
        self._orders: dict[Hashable, Future[bool]] = {}

    def first(self, scene: Scene) -> SceneState:
        """Plan a scene; it is not final where its exposure was metered with quick kernels.

        Autofocus takes millions of samples, for which full kernels are worth their time.
        """
        self._parts.drop_rough()
        resolved, is_final = self._resolve_soon(scene, None)
        return self._plan_state(scene, resolved, make_plan(resolved.scene, parts=self._parts), is_final=is_final)

    def _resolve_soon(self, scene: Scene, reading: float | None) -> tuple[Resolved, bool]:
        """Resolve a scene; with it, whether it was not metered with quick kernels."""
        if self._quick is None or scene.requested_autofocus is not None:
            return resolve(scene, self._device, metered_cd_m2=reading), True
        try:
            return resolve(scene, self._device.built_only(), metered_cd_m2=reading), True
        except NotKeptError:
            return resolve(scene, self._quick, metered_cd_m2=reading), False

    def for_glances(self, before: SceneState, scene: Scene, reading: float | None) -> SceneState:
        """Plan a scene for glances: by the last reading of the meter and coarse tables."""
        resolved, _ = self._resolve_soon(scene, reading)
        self._parts.rough = True
        plan = _plan_for_glances(before, scene, resolved.scene, self._parts)
        state = self._plan_state(scene, resolved, plan, is_final=False)
        if _is_of_another_pupil(before.plan, plan) and not self.is_ready(state):  # as coarse tables may be
            plan = make_plan(resolved.scene, parts=self._parts)
            state = self._plan_state(scene, resolved, plan, is_final=False)
        return state

    def final(self, state: SceneState) -> SceneState:
        """Plan a scene as `render` does."""
        self._parts.drop_rough()
        held = state.plan.facts if state.is_served else None
        resolved = resolve(state.scene, self._device, state.resolved.focus, held=held)
        final = self._plan_state(state.scene, resolved, make_plan(resolved.scene, parts=self._parts), is_final=True)
        if not state.is_served:
            return final
        return replace(self._served_state(final, state.plan.facts) or final, relief=state.relief)

    def served(self, state: SceneState, by: SceneState) -> SceneState | None:
        """Return a state for glances that kernels of another one do for; None where they do not, or are not there."""
        found = self._served_state(state, by.plan.facts)
        if found is None or not self.is_ready(found):
            return None
        same = all(state.plan.facts[name] == found.plan.facts[name] for name in _WAYS)
        return replace(found, relief=None if same else state)

    def _served_state(self, state: SceneState, facts: dict[str, int]) -> SceneState | None:
        plan = serve(state.plan, facts)
        if plan is None and not state.plan.steps:
            self._parts.held = facts
            try:
                held = make_plan(state.resolved.scene, state.plan.camera, parts=self._parts)
            finally:
                self._parts.held = None
            plan = serve(held, facts)
        if plan is None:
            return None
        return replace(state, plan=plan, buffers=self.pool.upload(plan), is_served=True)

    def of_film(self, state: SceneState) -> tuple[Plan, SceneBuffers]:
        """The plan of a final state's film, and its arrays: camera rays may aim at lamps."""
        layers, conjugates = state.scene.render.layers, state.resolved.conjugates
        plan, buffers = aimed_plan(state.plan, self._device, layers, state.buffers, conjugates)
        return plan, buffers or state.buffers

    def close(self) -> None:
        """Compile nothing more, give up what a process apart compiles, and let go of everything on the device."""
        self._compiler.close()
        self._threads.shutdown(wait=True, cancel_futures=True)
        self.pool.close()
        if self._quick is not None:
            self._quick_pool.close()

    @property
    def is_idle(self) -> bool:
        """Whether nothing is being compiled."""
        self._collect()
        return not self._under_way

    def is_ready(self, state: SceneState) -> bool:
        """Whether a state can be shown at once."""
        key = self._key(state)
        self._collect()
        return key in self._quick_keys or key in self._done

    def compile(self, state: SceneState) -> None:
        """Compile what showing a state takes, unless it can be shown."""
        if self.is_ready(state):
            return
        key = self._key(state)
        if key in self._under_way:
            self._under_way[key].result()
        self._collect()
        if key not in self._done:
            _compile_here(self._device, *self._of_glances(state))
            self._done.add(key)

    def compile_fast(self, state: SceneState) -> None:
        """Compile what glances of a state take: quick kernels, unless full ones are cached."""
        if self._quick is None or not self._is_quick(state):
            self.compile(state)
        else:
            _compile_here(self._quick, *self._of_glances(state))
            self._quick_keys.add(self._key(state))

    def begin(self, state: SceneState) -> None:
        """Compile what showing a state takes in the background."""
        self._begin(self._of_glances(state))

    def pool_of_glances(self, state: SceneState) -> WavefrontPool:
        """The wavefronts that glances of a state take."""
        if not self._is_quick(state):
            return self.pool
        self._quick_keys.add(self._key(state))
        return self._quick_pool

    def is_film_ready(self, state: SceneState, of_film: Callable[[], tuple[Plan, SceneBuffers]]) -> bool:
        """Whether the film of a state can have samples at once; otherwise its kernels are compiled meanwhile.

        So are those of its glances, afterwards.

        Parameters
        ----------
        of_film
            Returns the plan of its film and the arrays of that.
        """
        if self._quick is None:
            return True
        if not state.is_final and self._is_quick(state):  # full kernels meter for a film
            self._begin_when_idle(self._of_glances(state))
            return False
        wanted = *of_film(), state.scene.render
        if not self._is_cached(wanted):
            self._begin_when_idle(wanted)
            return False
        if self._is_quick(state):
            self._begin_when_idle(self._of_glances(state))
        return True

    def is_guided(self, state: SceneState) -> bool:
        """Whether pictures of a state can be denoised at once; otherwise kernels for it are compiled meanwhile."""
        wanted = state.plan, state.buffers, of_guides(state.scene)
        key = key_of(*wanted)
        self._collect()
        if key in self._done:
            return True
        if key not in self._failed:  # those that the driver has kept take a part of a second, too
            self._begin_when_idle(wanted)
        return False

    def is_carried_out(self, name: Hashable, order: Callable[[], bytes]) -> bool:
        """Whether another process has carried out an order, successfully or not; it begins where it has not yet.

        Where the driver does not stop the device to compile, there is nothing to be gained by it.

        Parameters
        ----------
        name
            Of what the order compiles.
        order
            Returns what `CompileServer.compile` takes.
        """
        if not self._device.generates_late:
            return True
        if name not in self._orders:
            self._orders[name] = self._threads.submit(self._compiler.compile, order())
        return self._orders[name].done()

    def _is_quick(self, state: SceneState) -> bool:
        """Whether glances of a state have quick kernels."""
        return self._quick is not None and not self._is_cached(self._of_glances(state))

    def _is_cached(self, wanted: _Wanted) -> bool:
        """Whether kernels are there without the compiler: compiled before, or loaded now.

        True, too, where compiling them has failed, which is to be reported.
        """
        key = key_of(*wanted)
        self._collect()
        if key in self._done or key in self._failed:
            return True
        if key in self._missing:
            return False
        try:
            _compile_here(self._device.built_only(), *wanted)
        except NotKeptError:
            self._missing.add(key)
            return False
        self._done.add(key)
        return True

    def _begin(self, wanted: _Wanted) -> None:
        """Compile in the background; what fails there fails again when it is needed."""
        key = key_of(*wanted)
        self._collect()
        if key not in self._done and key not in self._under_way:
            for waiting in self._under_way.values():
                waiting.cancel()
            self._under_way[key] = self._threads.submit(self._compile_in_background, *wanted)

    def _begin_when_idle(self, wanted: _Wanted) -> None:
        """Compile in the background if nothing else is compiled there."""
        if self.is_idle:
            self._begin(wanted)

    def _compile_in_background(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
        device = self._device.beside()
        if device.generates_late:
            try:
                _compile_here(device.built_only(), plan, scene, settings)
                return
            except NotKeptError:
                pass
            wanted = order(device, plan, scene, settings)
            if wanted is not None:
                self._compiler.compile(wanted)
        if not self._compiler.is_closed:
            _compile_here(device, plan, scene, settings)

    def _collect(self) -> None:
        for key, future in list(self._under_way.items()):
            if future.done():
                del self._under_way[key]
                if not future.cancelled():
                    (self._done if future.exception() is None else self._failed).add(key)

    def _of_glances(self, state: SceneState) -> _Wanted:
        """What has to be compiled before a state is shown."""
        settings = state.scene.render if self._quick is None else of_glance(state.scene)
        return state.plan, state.buffers, settings

    def _key(self, state: SceneState) -> Hashable:
        return key_of(*self._of_glances(state))

    def _plan_state(self, scene: Scene, resolved: Resolved, plan: Plan, *, is_final: bool) -> SceneState:
        return SceneState(scene, resolved, plan, self.pool.upload(plan), is_final)


def of_glance(scene: Scene) -> RenderSettings:
    """Return the settings of glances."""
    return scene.render.model_copy(update={"layers": (), "noise": None})


def of_guides(scene: Scene) -> RenderSettings:
    """Return the settings of the layers by which pictures are denoised."""
    return of_glance(scene).model_copy(update={"layers": GUIDES, "layers_spp": MOST_GUIDES, "max_depth": 0})
