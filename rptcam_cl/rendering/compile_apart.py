"""Kernels compiled by a process apart, which fills the driver's cache: the device goes on with the picture meanwhile.

PoCL generates the code of a kernel when it is launched first, for seconds in which its device runs nothing else. What
another process has launched once comes out of the cache.

The process gets what programs follow from: the plan without its large arrays, and the arrays of the scene cut short.
It runs a wave without samples, in which no path looks at them.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import struct
import subprocess
import sys
import threading
from dataclasses import replace
from typing import BinaryIO

from rptcam_cl.cameras import CameraView
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.device import Session, end_work, open_session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.buffers import SceneBuffers
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene import RenderSettings

SMALL = FilmLayout(16, 16, 0, 0, 16, 16)  # programs do not depend on the film's size
SECONDS_TO_END = 0.2  # that a process has to end by itself
MOST_BYTES = 1 << 16  # of each array of the scene
MOST_WITH_PHOTONS = 1 << 26  # of each array, where photons look at the scene
_CHILD = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from rptcam_cl.rendering import compile_apart; "
    "compile_apart.serve(sys.stdin.buffer, sys.stdout.buffer)"
)
_DONE, _FAILED = b"compiled\n", b"failed\n"


@dataclass(frozen=True)
class Order:
    """What is to be compiled: a device's id, a plan, its arrays on the host, and the settings of a render."""

    device: str
    plan: Plan
    buffers: SceneBuffers
    settings: RenderSettings

    def carry_out(self) -> None:
        """Compile it, in this process."""
        session = open_session(self.device)
        buffers = self.buffers.uploaded_to(session)
        Wavefront(session, self.plan, SMALL, self.settings, buffers=buffers).generate_code()


def order(session: Session, plan: Plan, buffers: SceneBuffers, settings: RenderSettings) -> bytes | None:
    """Return what `Compiler.compile` takes; None where it cannot be sent, or is too large."""
    most = MOST_WITH_PHOTONS if plan.caustics.active else MOST_BYTES
    if plan.caustics.active and buffers.most_bytes > most:
        return None
    light = replace(
        plan,
        camera=replace(plan.camera, view=CameraView(), reach=None),  # which hold functions
        meshes=None,
        textures=replace(plan.textures, texels=plan.textures.texels[:1]),
        surroundings=replace(plan.surroundings, distribution=plan.surroundings.distribution[:1]),
    )
    try:
        return pickle.dumps(Order(session.info.id, light, buffers.on_host(light, most), settings))
    except (pickle.PicklingError, AttributeError, TypeError):  # something in it holds a function
        return None


class Compiler:
    """A process that compiles; started at the first order, and kept for the next ones."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()
        self._closed = False

    @property
    def is_closed(self) -> bool:
        """Whether it compiles nothing more."""
        return self._closed

    def compile(self, wanted: bytes) -> bool:
        """Carry out a pickled `Order`, or another one that can; return whether that was done.

        The process may fail, crash or be closed.
        """
        try:
            process = self._running()
            if process is None or process.stdin is None or process.stdout is None:
                return False
            process.stdin.write(struct.pack("<Q", len(wanted)) + wanted)
            process.stdin.flush()
            for line in process.stdout:
                if line in (_DONE, _FAILED):
                    return line == _DONE
        except (OSError, ValueError):  # no process can be started, or it has gone
            pass
        self._end()
        return False

    def close(self) -> None:
        """End the process, whatever it does."""
        self._closed = True
        self._end()

    def _running(self) -> subprocess.Popen[bytes] | None:
        with self._lock:
            if self._process is None and not self._closed and sys.executable:
                self._process = subprocess.Popen(
                    [sys.executable, "-c", _CHILD, json.dumps(sys.path)],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,  # Ctrl-C is for the parent, which ends this one
                )
            return self._process

    def _end(self) -> None:
        with self._lock:
            process, self._process = self._process, None
        if process is not None:
            with contextlib.suppress(OSError):
                if process.stdin is not None:
                    process.stdin.close()  # it ends by itself if it has nothing to do
            try:
                process.wait(SECONDS_TO_END)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            for pipe in (process.stdin, process.stdout):
                with contextlib.suppress(OSError):
                    if pipe is not None:
                        pipe.close()


def serve(orders: BinaryIO, answers: BinaryIO) -> None:
    """Compile what arrives until nothing more does; a line for each order says whether that succeeded."""
    while len(head := orders.read(8)) == 8:
        content = orders.read(struct.unpack("<Q", head)[0])
        try:
            pickle.loads(content).carry_out()
        except Exception:  # the parent compiles it itself then, and reports what is wrong
            answers.write(b"\n" + _FAILED)
        else:
            answers.write(b"\n" + _DONE)
        answers.flush()
    end_work()
    os._exit(0)  # nothing to tidy up, and a driver may take its time for it
