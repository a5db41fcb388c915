from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.exchange.pbrt.convert import convert_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

HEAD = """\
LookAt 0 0 5  0 0 0  0 1 0
Camera "perspective" "float fov" 40
Film "rgb" "integer xresolution" 32 "integer yresolution" 24
WorldBegin
"""


@dataclass
class Converted:
    """A scene that was converted, written and read again."""

    keys: dict[str, Any]
    report: list[str]
    scene: Scene
    folder: Path

    @property
    def objects(self) -> list[dict[str, Any]]:
        return list(self.keys.get("objects", []))

    def material(self, index: int = 0) -> dict[str, Any]:
        """The material of an object."""
        found: dict[str, Any] = self.keys["materials"][self.objects[index]["material"]]
        return found

    def says(self, *words: str) -> bool:
        """Whether some message holds all the words."""
        return any(all(word in line for word in words) for line in self.report)


@pytest.fixture
def convert(tmp_path: Path) -> Callable[..., Converted]:
    """Convert a text of pbrt, with other files beside it, and load what came out.

    A text without a shape is given one far above: a scene without objects is an error.
    """

    def run(text: str, head: str = HEAD, **files: str | bytes) -> Converted:
        source = tmp_path / "in.pbrt"
        ball = (
            "" if "Shape" in head + text else 'AttributeBegin Identity Translate 0 1000 0 Shape "sphere" AttributeEnd '
        )
        source.write_text(head + ball + text, "utf-8")
        for name, content in files.items():
            path = tmp_path / name.replace("__", "/").replace("_dot_", ".")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        target = tmp_path / "out.yaml"
        done = convert_scene(source, target)
        done.write(target)
        return Converted(done.scene, list(done.report), load_scene(target), tmp_path)

    return run
