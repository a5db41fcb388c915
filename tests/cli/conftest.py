from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.remember import made_by
from rptcam_cl.imaging.image import Image

SCENE = """\
film: {resolution: [8, 6]}
camera: {kind: pinhole, eye: [0, 0, 5], target: [0, 0, 0], fov_degrees: 40}
objects:
  - {shape: sphere, center: [0, 0, 0], radius: 1, material: {kind: matte, reflectance: 0.5}}
environment: {kind: constant, radiance: 1}
"""


@dataclass
class Run:
    """What a command did."""

    code: int
    out: str
    err: str


@dataclass
class Renderer:
    """Stands in for the renderer, so that the command line is tested alone: keeps what it was asked for."""

    asked: list[dict[str, Any]] = field(default_factory=list)
    image: Image = field(
        default_factory=lambda: Image(
            np.full((6, 8, 3), 0.5, np.float32),
            metadata={"spp": 4, "made_by": made_by(["fake"])},
            stats={
                "spp": 4,
                "samples": 192,
                "seconds": {"start": 0.1, "compile": 0.2, "render": 0.3, "total": 0.6},
                "msamples_per_second": 1.5,
                "device": "test",
                "lens": {"passed": 3, "clipped": 1},
                "interrupted": False,
            },
        )
    )
    during: Callable[[dict[str, Any]], None] = lambda options: None

    def __call__(self, scene: Any, **options: Any) -> Image:
        self.asked.append({"scene": scene, **options})
        self.during(options)
        return self.image


@pytest.fixture
def renderer(monkeypatch: pytest.MonkeyPatch) -> Renderer:
    stand_in = Renderer()
    monkeypatch.setattr("rptcam_cl.api.job.render", stand_in)
    return stand_in


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene file in a folder of its own, which is the working folder."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE, encoding="utf-8")
    return path


@pytest.fixture
def rptcam(capsys: pytest.CaptureFixture[str]) -> Callable[..., Run]:
    """Runs the command line in this process."""

    def run(*words: str) -> Run:
        capsys.readouterr()
        code = main(words)
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return Run(code, captured.out, captured.err)

    return run
