"""Where a scene comes from, and what the page has changed of it: as a scene, as YAML, as a command line."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from rptcam_cl.core.references import named_files
from rptcam_cl.scene import LensCamera, Scene, load_scene, plain, scene_text

_PLACE = re.compile(r"^(?P<where>\S[^:\n]*:\d+:\d+): |^(?P<key>[A-Za-z_][\w.\[\]]*): ")


class Changes:
    """Keys of a scene that were changed, each once, in the order of their last change."""

    def __init__(self, keys: Mapping[str, Any] | None = None) -> None:
        self._keys: dict[str, Any] = {}
        self.add(keys or {})

    def add(self, keys: Mapping[str, Any]) -> None:
        """Take further changes; those of keys below a changed key are forgotten with it."""
        for key, value in keys.items():
            for old in [old for old in self._keys if old == key or old.startswith((f"{key}.", f"{key}["))]:
                del self._keys[old]
            self._keys[key] = value

    def drop(self, prefix: str = "") -> None:
        """Forget the changes of a part, or all."""
        for old in [old for old in self._keys if old.startswith(prefix)]:
            del self._keys[old]

    def as_dict(self) -> dict[str, Any]:
        """Return the values by their keys; None removes a key."""
        return dict(self._keys)


class Origin:
    """The scene file, or the data, that a viewfinder was opened with.

    Parameters
    ----------
    scene
        A path, a mapping as of a scene file, or a scene.
    overrides
        As ``--set`` takes them.
    """

    def __init__(self, scene: Scene | str | Path | Mapping[str, Any], overrides: Iterable[str] = ()) -> None:
        self.path = Path(scene) if isinstance(scene, str | Path) else None
        self._given = scene
        self._overrides = tuple(overrides)
        self._loaded: Scene | None = None
        self.files: frozenset[Path] = frozenset()

    @property
    def name(self) -> str:
        """File name of the scene, without its folder."""
        return "scene.yaml" if self.path is None else self.path.name

    def load(self) -> Scene:
        """Return the scene as it is now in its files; `files` are then those that it names, and its own.

        Raises
        ------
        InputError, StateError
            As `load_scene` does; `files` are then the earlier ones and those that were named up to the error.
        """
        own = frozenset() if self.path is None else frozenset({self.path.resolve()})
        with named_files() as named:
            try:
                scene = self._given if isinstance(self._given, Scene) else load_scene(self._given, self._overrides)
                if isinstance(scene.camera, LensCamera):
                    scene.load_lens()
            except BaseException:
                self.files = self.files | own | named
                raise
        self.files = own | named
        self._loaded = scene
        return scene

    def text(self, shown: Scene) -> str:
        """Return the scene that is shown as YAML."""
        beside = f"; lies beside {self.name}, whose files it names" if len(self.files) > 1 else ""
        return scene_text(_data(shown), (f"{self.name} as the viewfinder showed it{beside}",))

    def command(self, shown: Scene, spp: int) -> str:
        """Return the command that renders what is shown.

        Parameters
        ----------
        spp
            Samples per pixel that it is to have.
        """
        assert self._loaded is not None, "a scene is loaded before it is shown"
        changes = _differences("", _data(self._loaded), _data(shown))
        own = [f"{key}={json.dumps(value, ensure_ascii=False)}" for key, value in changes.items()]
        sets = [word for text in (*self._overrides, *own) for word in ("--set", text)]
        name = self.name if self.path is None else str(self.path)
        output = f"{Path(self.name).stem}.png"
        return shlex.join(["rptcam", "render", name, *sets, "--spp", str(max(spp, 1)), "-o", output])


def _data(scene: Scene) -> dict[str, Any]:
    """Return what a scene file of a scene holds; parts of a scene made in Python are written out."""
    given = {name: value for name, value in scene.made_of.items() if value is not None}
    if all(map(_is_plain, given.values())):
        return dict(plain(given))
    dumped = scene.model_dump(mode="json", exclude_unset=True)
    return {name: plain(value) if _is_plain(value) else dumped.get(name) for name, value in given.items()}


def _is_plain(value: Any) -> bool:
    if isinstance(value, Mapping):
        return all(map(_is_plain, value.values()))
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    return not isinstance(value, BaseModel)


def _differences(path: str, before: Any, after: Any) -> dict[str, Any]:
    """Return the values of keys that make one part of a scene's data the other; None removes a key."""
    if before == after:
        return {}
    if not (isinstance(before, dict) and isinstance(after, dict)):
        return {path: after}
    inside = f"{path}." if path else ""
    found: dict[str, Any] = {f"{inside}{key}": None for key in before if key not in after}
    for key, value in after.items():
        if key not in before:
            found[f"{inside}{key}"] = value
        else:
            found |= _differences(f"{inside}{key}", before[key], value)
    return found


def scene_error(text: str) -> dict[str, Any]:
    """Return the message of an error in the scene file."""
    return {"type": "error", "id": None, "message": text, "where": place_of(text), "source": "scene"}


def place_of(text: str) -> str | None:
    """Return the file, line and column, or else the key path, that an error begins with."""
    found = _PLACE.match(text)
    return None if found is None else found["where"] or found["key"]
