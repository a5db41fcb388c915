"""What renders a scene on its devices, made anew or taken over from the picture before."""

from __future__ import annotations

from rptcam_cl.api.settings import RenderSettings
from rptcam_cl.device import Session, means_all
from rptcam_cl.plan import Plan, PlanParts
from rptcam_cl.rendering import (
    AnyWavefront,
    FilmLayout,
    Part,
    SceneBuffers,
    SharedWavefront,
    Wavefront,
    WavefrontPool,
    split_of,
    split_text,
)
from rptcam_cl.scene import Scene


class Kept:
    """What stays from one picture to the next on a device: wavefronts with their buffers, and parts of the plan."""

    def __init__(self, device: Session) -> None:
        self._pool, self.parts = WavefrontPool(device), PlanParts()

    def pool(self, plan: Plan, sessions: list[Session], settings: RenderSettings) -> WavefrontPool | None:
        """Return the wavefronts of which one may render a plan; None where it has to be another."""
        return None if len(sessions) > 1 or settings.checkpoint or settings.wave_size or plan.steps else self._pool


def wavefront_of(
    scene: Scene,
    plan: Plan,
    sessions: list[Session],
    shares: list[float] | None,
    settings: RenderSettings,
    buffers: SceneBuffers | None,
    pool: WavefrontPool | None,
) -> AnyWavefront:
    """Return what renders the scene, compiled and ready: on one device, or on several that share it.

    Parameters
    ----------
    buffers
        The scene on the first device, where it is there already.
    pool
        Where it is taken from, if it can be; the scene is there then.
    """
    layout = FilmLayout.of(scene.film)
    if pool is not None and buffers is not None:
        return pool.wavefront(plan, buffers, layout, scene.render, "film")
    if len(sessions) > 1:
        return SharedWavefront(
            sessions, plan, layout, scene.render, settings.wave_size, shares=shares, lenient=means_all(settings.device)
        )
    wavefront = Wavefront(sessions[0], plan, layout, scene.render, settings.wave_size, buffers=buffers)
    wavefront.warm_up()
    return wavefront


def saved_shares(parts: list[Part], sessions: list[Session]) -> list[float] | None:
    """Return the shares that the same devices had when the render was saved; None where they were others."""
    last = split_of(parts[-1]["split"]) if parts else {}
    ids = [session.info.id for session in sessions]
    return [last[identity] for identity in ids] if last.keys() == set(ids) else None


def devices_of(wavefront: AnyWavefront, first: int, done: int) -> list[Part]:
    """Return which device has taken which samples since a render began or went on after ``first``."""
    if isinstance(wavefront, SharedWavefront):
        return wavefront.parts(done)
    return [{"samples": [first, done], "split": split_text({wavefront.session.info.id: 1.0})}] if done > first else []
