"""What a render takes beside its scene."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.device import Split, Wanted
from rptcam_cl.rendering import Progress
from rptcam_cl.scene import ADAPTIVE_SPP, Scene, change_scene


@dataclass(frozen=True)
class RenderSettings:
    """The keyword arguments of `render`, which explains each.

    Raises
    ------
    InputError
        ``seconds`` is no time.
    """

    spp: int | None = None
    seconds: float | None = None
    seed: int | None = None
    size: tuple[int, int] | None = None
    crop: tuple[float, float, float, float] | None = None
    layers: Sequence[str] | None = None
    denoise: bool = False
    noise: float | None = None
    checkpoint: str | os.PathLike[str] | None = None
    resume: bool = False
    device: Wanted = None
    split: Split | None = None
    wave_size: int | None = None
    numerics: bool = False
    strict: bool = False
    on_progress: Callable[[Progress], Any] | None = None
    should_stop: Callable[[], bool] | None = None

    def __post_init__(self) -> None:
        if self.seconds is not None and not 0 < self.seconds < math.inf:
            raise InputError(f"seconds: is out of range (got {self.seconds!r}; allowed: a finite number above 0)")

    def applied_to(self, scene: Scene) -> Scene:
        """Return the scene with the keys that the settings replace."""
        render = {"spp": self.spp, "seed": self.seed, "layers": self.layers, "noise": self.noise}
        film = {"resolution": self.size, "crop": self.crop}
        return change_scene(
            scene,
            render={key: value for key, value in render.items() if value is not None},
            film={key: value for key, value in film.items() if value is not None},
        )

    def most_spp(self, scene: Scene) -> int | None:
        """Return the most samples of a pixel: ``spp``, else without limit for ``seconds``, else the scene's."""
        if self.spp is not None:
            return self.spp
        if self.noise is not None:
            return ADAPTIVE_SPP
        return None if self.seconds is not None else scene.render.most_spp
