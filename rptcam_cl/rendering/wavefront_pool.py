"""Wavefronts of one device that are kept for the plans to come, with the scene that they have uploaded."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

from rptcam_cl.device import Session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.buffers import SceneBuffers
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.passes import signature
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene import RenderSettings

MOST = 3  # wavefronts that are kept: one of the picture, two of its glances


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
        self._kept: OrderedDict[tuple[Any, ...], Wavefront] = OrderedDict()

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
        key = (purpose, *signature(plan, scene, layout, settings))
        found = self._kept.pop(key, None)
        if found is None:
            while len(self._kept) >= MOST:
                self._kept.popitem(last=False)
            found = Wavefront(self._session, plan, layout, settings, buffers=scene, scouts=purpose == "film")
        else:
            found.use_plan(plan, scene, settings)
        self._kept[key] = found
        return found

    def close(self) -> None:
        """Let go of everything on the device."""
        self._kept.clear()
        self._scene = None
