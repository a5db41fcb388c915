"""Kernels compiled ahead of the picture that needs them, on the spot or in the background."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from rptcam_cl.device import NotKeptError, Session
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
        self._failed: set[tuple[Any, ...]] = set()  # in the background
        self._missing: set[tuple[Any, ...]] = set()  # of what the driver has kept
        self._under_way: dict[tuple[Any, ...], Future[None]] = {}
        self._threads = ThreadPoolExecutor(1, "rptcam-compile")
        self._compiler = Compiler()
        self._orders: dict[Hashable, Future[bool]] = {}

    @property
    def ready(self) -> bool:
        """Whether nothing is being compiled."""
        self._collect()
        return not self._under_way

    def knows(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> bool:
        """Return whether a plan can be rendered at once."""
        self._collect()
        return key_of(plan, scene, settings) in self._done

    def compile(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
        """Compile what a plan needs, unless that is done."""
        key = key_of(plan, scene, settings)
        if key in self._under_way:
            self._under_way[key].result()
        self._collect()
        if key not in self._done:
            compile_here(self._device, plan, scene, settings)
            self._done.add(key)

    def takes_kept(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> bool:
        """Return whether a plan can be rendered without the compiler: its kernels are there, or loaded now.

        So it is, too, where compiling them has failed, which is to be reported.
        """
        key = key_of(plan, scene, settings)
        self._collect()
        if key in self._done or key in self._failed:
            return True
        if key in self._missing:
            return False
        try:
            compile_here(self._device.kept_only(), plan, scene, settings)
        except NotKeptError:
            self._missing.add(key)
            return False
        self._done.add(key)
        return True

    def begin(self, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
        """Compile it in the background; what fails there fails again when it is needed."""
        key = key_of(plan, scene, settings)
        if not self.knows(plan, scene, settings) and key not in self._under_way:
            for waiting in self._under_way.values():
                waiting.cancel()
            self._under_way[key] = self._threads.submit(self._compile_beside, plan, scene, settings)

    def is_carried_out(self, name: Hashable, order: Callable[[], bytes]) -> bool:
        """Return whether another process has carried out an order, successfully or not; it begins where it has not yet.

        Where the driver does not stop the device to compile, there is nothing to be gained by it.

        Parameters
        ----------
        name
            Of what the order compiles.
        order
            Returns what `Compiler.compile` takes.
        """
        if not self._device.generates_late:
            return True
        if name not in self._orders:
            self._orders[name] = self._threads.submit(self._compiler.compile, order())
        return self._orders[name].done()

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
            compile_here(device, plan, scene, settings)

    def _collect(self) -> None:
        for key, future in list(self._under_way.items()):
            if future.done():
                del self._under_way[key]
                if not future.cancelled():
                    (self._done if future.exception() is None else self._failed).add(key)


def key_of(plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> tuple[Any, ...]:
    """Return what the kernels of a plan follow from."""
    return signature(plan, scene, SMALL, settings)


def compile_here(device: Session, plan: Plan, scene: SceneBuffers, settings: RenderSettings) -> None:
    """Compile what a plan needs in this process."""
    Wavefront(device, plan, SMALL, settings, buffers=scene, scouts=False).warm_up()
