"""Kernels compiled ahead of the picture that needs them, on the spot or in the background."""

from __future__ import annotations

import contextlib
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from rptcam_cl.core.errors import RptcamError
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering import SMALL, Compiler, SceneBuffers, Wavefront, order, signature
from rptcam_cl.scene import RenderSettings


class Ahead:
    """Compiles what plans need, and knows what is compiled.

    In the background, a process apart compiles first where the driver would stop the device for it.

    Parameters
    ----------
    device
        The device.
    """

    def __init__(self, device: Session) -> None:
        self._device = device
        self._done: set[tuple[Any, ...]] = set()
        self._under_way: dict[tuple[Any, ...], Future[None]] = {}
        self._threads = ThreadPoolExecutor(1, "rptcam-compile")
        self._compiler = Compiler()

    @property
    def ready(self) -> bool:
        """Whether nothing is being compiled."""
        self._collect()
        return not self._under_way

    def knows(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> bool:
        """Return whether a plan can be rendered at once."""
        self._collect()
        return _key(plan, scene, settings) in self._done

    def compile(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
        """Compile what a plan needs, unless that is done."""
        key = _key(plan, scene, settings)
        if key in self._under_way:
            self._under_way[key].result()
        self._collect()
        if key not in self._done:
            _compile(self._device, plan, scene, settings)
            self._done.add(key)

    def begin(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
        """Compile it in the background; what fails there fails again when it is needed."""
        key = _key(plan, scene, settings)
        if not self.knows(plan, scene, settings) and key not in self._under_way:
            for waiting in self._under_way.values():
                waiting.cancel()
            self._under_way[key] = self._threads.submit(self._compile_beside, plan, scene, settings)

    def close(self) -> None:
        """Begin nothing more; what a process apart compiles is given up."""
        self._compiler.close()
        self._threads.shutdown(wait=True, cancel_futures=True)

    def _compile_beside(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
        device = self._device.beside()
        if device.generates_late:
            wanted = order(device, plan, scene, settings)
            if wanted is not None:
                self._compiler.compile(wanted)
        if not self._compiler.is_closed:
            _compile(device, plan, scene, settings)

    def _collect(self) -> None:
        for key, future in list(self._under_way.items()):
            if future.done():
                del self._under_way[key]
                with contextlib.suppress(RptcamError):
                    if not future.cancelled():
                        future.result()
                        self._done.add(key)


def _key(plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> tuple[Any, ...]:
    return signature(plan, scene, SMALL, settings)


def _compile(device: Session, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
    Wavefront(device, plan, SMALL, settings, buffers=scene).warm_up()
