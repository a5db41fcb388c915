"""What a session does before samples can be taken: focus, exposure, plans, kernels.

Quick kernels compile in half the time and run twice as long. So the glances of a session that does not wait have them
until another process has compiled the full ones.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable

from rptcam_cl.api.ahead import Ahead, compile_here, key_of
from rptcam_cl.api.scene_state import SceneState, plan_beside
from rptcam_cl.api.stages import Resolved, resolve
from rptcam_cl.device import NotKeptError, Session
from rptcam_cl.plan import Plan, PlanParts, make_plan
from rptcam_cl.rendering import SceneBuffers, WavefrontPool, aimed_plan
from rptcam_cl.scene import RenderSettings, Scene


class Preparation:
    """Makes scenes ready on a device.

    Parameters
    ----------
    device
        The device.
    waits
        Whether everything is done with the full kernels.

    Attributes
    ----------
    ahead : Ahead
        What is compiled, and under way.
    pool : WavefrontPool
        Wavefronts of the full kernels.
    """

    def __init__(self, device: Session, *, waits: bool) -> None:
        self._device = device
        self.ahead, self.pool = Ahead(device), WavefrontPool(device)
        self._parts = PlanParts()
        self._quick: Session | None = None
        if not waits and device.generates_late and device.lanes > 1:
            self._quick = device.quick()
            self._quick_pool = WavefrontPool(self._quick)
        self._quick_keys: set[Hashable] = set()  # of what quick kernels were compiled for

    def first(self, scene: Scene) -> SceneState:
        """Return a scene ready to be rendered; not final where its exposure was metered with quick kernels."""
        found, is_final = self._resolved(scene)
        return self._planned(scene, found, make_plan(found.scene, parts=self._parts), is_final=is_final)

    def beside(self, before: SceneState, scene: Scene, reading: float | None) -> SceneState:
        """Return a scene ready for glances: by the last reading of the meter and coarse tables."""
        found = resolve(scene, self._device, metered_cd_m2=reading)
        plan = plan_beside(before, scene, found.scene, self._parts)
        if plan.camera.facts != before.plan.camera.facts:  # coarse tables may be of another kind
            plan = make_plan(found.scene, parts=self._parts)
        return self._planned(scene, found, plan, is_final=False)

    def final(self, state: SceneState) -> SceneState:
        """Return a state as `render` has it."""
        found = resolve(state.scene, self._device, state.found.focus)
        return self._planned(state.scene, found, make_plan(found.scene, parts=self._parts), is_final=True)

    def of_film(self, state: SceneState) -> tuple[Plan, SceneBuffers]:
        """Return the plan of a final state's film, and its arrays: camera rays may aim at lamps."""
        plan, buffers = aimed_plan(state.plan, self._device, state.scene.render.layers, state.buffers)
        return plan, buffers or state.buffers

    def close(self) -> None:
        """Compile nothing more; let go of everything on the device."""
        self.ahead.close()
        self.pool.close()
        if self._quick is not None:
            self._quick_pool.close()

    def knows(self, state: SceneState) -> bool:
        """Return whether a state can be shown at once."""
        return self._key(state) in self._quick_keys or self.ahead.knows(*self._of_glances(state))

    def compile(self, state: SceneState) -> None:
        """Compile what showing a state takes, unless it can be shown."""
        if not self.knows(state):
            self.ahead.compile(*self._of_glances(state))

    def compile_soonest(self, state: SceneState) -> None:
        """Compile what glances of a state take: quick kernels, unless full ones are kept."""
        if self._quick is None or not self.is_quick(state):
            self.compile(state)
        else:
            compile_here(self._quick, *self._of_glances(state))
            self._quick_keys.add(self._key(state))

    def begin(self, state: SceneState) -> None:
        """Compile it in the background."""
        self.ahead.begin(*self._of_glances(state))

    def is_quick(self, state: SceneState) -> bool:
        """Return whether glances of a state have quick kernels."""
        return self._quick is not None and not self.ahead.takes_kept(*self._of_glances(state))

    def pool_of_glances(self, state: SceneState) -> WavefrontPool:
        """Return the wavefronts that glances of a state take."""
        if not self.is_quick(state):
            return self.pool
        self._quick_keys.add(self._key(state))
        return self._quick_pool

    def is_film_ready(self, state: SceneState, of_film: Callable[[], tuple[Plan, SceneBuffers]]) -> bool:
        """Return whether the film of a state can have samples at once; otherwise its kernels are compiled meanwhile.

        So are those of its glances, afterwards.

        Parameters
        ----------
        of_film
            Returns the plan of its film and the arrays of that.
        """
        if self._quick is None:
            return True
        if not state.is_final and self.is_quick(state):  # full kernels meter for a film
            return self._begun(self._of_glances(state))
        plan, buffers = of_film()
        wanted = plan, buffers, state.scene.render
        if not self.ahead.takes_kept(*wanted):
            return self._begun(wanted)
        if self.is_quick(state):
            self._begun(self._of_glances(state))
        return True

    def _begun(self, wanted: tuple[Plan, SceneBuffers, RenderSettings]) -> bool:
        """Compile something in the background as soon as nothing else is; return False, as it is not ready."""
        if self.ahead.ready:
            self.ahead.begin(*wanted)
        return False

    def _of_glances(self, state: SceneState) -> tuple[Plan, SceneBuffers, RenderSettings]:
        """Return what has to be compiled before a state is shown."""
        settings = state.scene.render if self._quick is None else of_glance(state.scene)
        return state.plan, state.buffers, settings

    def _key(self, state: SceneState) -> Hashable:
        return key_of(*self._of_glances(state))

    def _planned(self, scene: Scene, found: Resolved, plan: Plan, *, is_final: bool) -> SceneState:
        return SceneState(scene, found, plan, self.pool.upload(plan), is_final)

    def _resolved(self, scene: Scene) -> tuple[Resolved, bool]:
        """Return a scene resolved as soon as can be, and whether full kernels were at it.

        Autofocus takes millions of samples, for which full kernels are worth their time.
        """
        if self._quick is None or scene.requested_autofocus is not None:
            return resolve(scene, self._device), True
        try:
            return resolve(scene, self._device.kept_only()), True
        except NotKeptError:
            return resolve(scene, self._quick), False


def of_glance(scene: Scene) -> RenderSettings:
    """Return the settings of glances."""
    return scene.render.model_copy(update={"layers": (), "noise": None})
