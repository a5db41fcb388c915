"""Renderers in processes of their own, asked by lines of JSON.

Each side keeps its own interpreter, threads and compiled kernels, so that imports and compilation do not count and no
thread pool is shared. This module imports nothing but the standard library: a worker's Python may lack everything else.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
OLD_LLVM = (
    "an LLVM that has no instruction for what it is to do ends its process, as LLVM 15 does with AVX-512 («Cannot "
    "select»): name a newer library in DRJIT_LIBLLVM_PATH"
)


class WorkerError(Exception):
    """A worker could not start, or a request failed; the message is the worker's."""


class Worker:
    """A running worker.

    Parameters
    ----------
    python
        The interpreter to run it with.
    module
        The module, one of `benchmarks`, that calls `serve`.
    """

    def __init__(self, python: str, module: str, *options: str) -> None:
        command = [python, "-m", module, *options]
        pipe = subprocess.PIPE
        try:
            self._process = subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True)
        except OSError as error:
            raise WorkerError(f"{python} cannot be started: {error}") from error
        self.description = module
        self.description = self._answer()["description"]

    def ask(self, **request: Any) -> dict[str, Any]:
        """Return the answer to a request."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            raise WorkerError(self._how_it_ended()) from None
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise WorkerError(self._how_it_ended())
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            self._process.wait()
            raise WorkerError(answer["error"])
        return answer

    def _how_it_ended(self) -> str:
        code = self._process.wait()
        if code >= 0:
            return f"the worker {self.description} ended with exit code {code}"
        why = f"; {OLD_LLVM}" if "llvm" in self.description else ""
        return f"the worker {self.description} was ended by {signal.Signals(-code).name}{why}"

    def close(self) -> None:
        """Let the worker end."""
        self._process.communicate()


def serve(start: Callable[[], tuple[str, Callable[[dict[str, Any]], dict[str, Any]]]]) -> None:
    """Answer requests from standard input until it closes.

    Parameters
    ----------
    start
        Called once; returns the description of the renderer and the function that answers a request. What it raises
        becomes the error that the other side sees.
    """
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever a library prints goes to the log, not between the answers

    def say(answer: dict[str, Any]) -> None:
        answers.write(json.dumps(answer) + "\n")
        answers.flush()

    try:
        description, respond = start()
        say({"description": description})
        for line in sys.stdin:
            say(respond(json.loads(line)))
    except Exception as error:
        say({"error": str(error) if isinstance(error, WorkerError) else f"{type(error).__name__}: {error}"})
        raise SystemExit(1) from error
