"""Renders that can be interrupted and continued: when their state is saved, and whether a saved one fits."""

from __future__ import annotations

import contextlib
import math
import os
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rptcam_cl._version import __version__
from rptcam_cl.errors import StateError
from rptcam_cl.imaging.checkpoint import read_checkpoint, write_checkpoint
from rptcam_cl.scene import Scene
from rptcam_cl.wavefront import SavedState
from rptcam_cl.wavefront.parts import Part, joined

INTERVAL = 60.0  # [s]


class Saver:
    """Keeps the state of one render in a file.

    Parameters
    ----------
    path
        The file.
    scene
        What is rendered. A saved state continues it only if everything that decides the picture is the same: scene,
        lens, meshes, pictures, seed, film, layers and version; not the number of samples, the time or the output.
    devices : list of str
        Names of the devices.
    """

    def __init__(self, path: str | os.PathLike[str], scene: Scene, devices: Sequence[str]) -> None:
        self.path = Path(path)
        self._facts = {
            "version": __version__,
            "resolution": list(scene.film.resolution),
            "crop": list(scene.film.crop or ()),
            "seed": scene.render.seed,
            "noise": scene.render.noise,
            "layers": list(scene.render.layers),
            "layers_spp": scene.render.layers_spp if scene.render.layers else None,
            "scene": scene.content_hash(),
        }
        self._devices = list(dict.fromkeys(devices))
        self.parts: list[Part] = []
        """Which device took which samples of the saved render once it is loaded."""
        self.parts_since: Callable[[int], list[Part]] = lambda done: []
        """The same of this one, up to so many samples per pixel."""
        self.metered_cd_m2: float | None = None
        """What the exposure follows from; that of the saved render once it is loaded."""
        self.focus: dict[str, Any] | None = None
        """What autofocus found, likewise."""
        self._saved = time.monotonic()
        self._written = False

    def load(self) -> SavedState | None:
        """Return the saved state; None if there is no file.

        Raises
        ------
        StateError
            The file is damaged, or of another render.
        """
        if not self.path.exists():
            return None
        found = read_checkpoint(self.path)
        for name, value in self._facts.items():
            if found.facts.get(name) != value:
                raise self._misfit(name, found.facts.get(name), value)
        check_facts(self.path, found.facts)
        self._devices = list(dict.fromkeys([*found.facts["devices"], *self._devices]))
        self.metered_cd_m2 = found.facts.get("metered_cd_m2")
        self.focus = found.facts.get("focus")
        self.parts = list(found.facts.get("work", []))
        return SavedState(int(found.facts["done"]), found.arrays)

    def _misfit(self, name: str, saved: Any, wanted: Any) -> StateError:
        saved, wanted = ("not given" if value in (None, []) else value for value in (saved, wanted))
        what = {
            "version": f"it was saved by version {saved}, and this is {wanted}",
            "scene": "it is of another scene, or one that has changed since",
        }.get(name, f"its {name} is {saved}, and this render's {wanted}")
        return StateError(f"{self.path}: does not continue this render: {what} (remove it, or render without --resume)")

    @property
    def devices(self) -> str:
        """Names of all devices that have worked on the picture."""
        return ", ".join(self._devices)

    def save_now_and_then(self, state: Callable[[], SavedState]) -> None:
        """Save if the last time is a minute ago. That a file cannot be written does not end the render."""
        if time.monotonic() - self._saved >= INTERVAL:
            self._try_to_save(state)

    def save(self, state: SavedState) -> None:
        """Save a state in place of the last one."""
        decided = {"metered_cd_m2": self.metered_cd_m2, "focus": self.focus}
        work = joined(self.parts, self.parts_since(state.done))
        facts = {**self._facts, **decided, "done": state.done, "devices": self._devices, "work": work}
        write_checkpoint(self.path, facts, state.arrays)
        self._written = True

    def _try_to_save(self, state: Callable[[], SavedState]) -> bool:
        self._saved = time.monotonic()
        try:
            self.save(state())
        except StateError as error:
            warnings.warn(f"the state of the render is not saved: {error}", UserWarning, stacklevel=2)
            return False
        return True

    def end(self, state: Callable[[], SavedState], *, keep: bool) -> str | None:
        """Save the last state, or remove what this render has saved; return the file's name if it is kept."""
        if keep:
            return str(self.path) if self._try_to_save(state) else None
        if self._written:
            with contextlib.suppress(OSError):
                self.path.unlink()
        return None


def check_facts(path: Path, facts: dict[str, Any]) -> None:
    """Refuse a saved render whose facts are not of the kinds that one writes.

    Raises
    ------
    StateError
        It names the fact.
    """
    light, work = facts.get("metered_cd_m2"), facts.get("work", [])
    known = {
        "done": type(facts.get("done")) is int and 0 <= facts["done"] < 2**31,
        "devices": _are(str, facts.get("devices")),
        "metered_cd_m2": light is None or (type(light) in (int, float) and 0 < light < math.inf),
        "focus": facts.get("focus") is None or isinstance(facts["focus"], dict),
        "work": _are(dict, work),
    }
    for name, right in known.items():
        if not right:
            raise StateError(f"{path}: this saved render is damaged: {name} (remove it, or render without --resume)")


def _are(kind: type, values: Any) -> bool:
    return isinstance(values, list) and all(isinstance(value, kind) for value in values)
