"""What a render takes beside its scene."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Sequence
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.device import Session, Split, Wanted
from rptcam_cl.rendering import WHOLE, FilmLayout, FilmPart, Progress, has_ghosts
from rptcam_cl.scene import ADAPTIVE_SPP, MAX_SPP, Scene, change_scene


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
    allow_mixed: bool = False
    device: Wanted = None
    split: Split | None = None
    wave_size: int | None = None
    numerics: bool = False
    strict: bool = False
    part: str | None = None
    samples: tuple[int, int] | None = None
    neighbours: tuple[Scene | None, Scene | None] | None = None
    on_progress: Callable[[Progress], Any] | None = None
    should_stop: Callable[[], bool] | None = None

    def __post_init__(self) -> None:
        if self.seconds is not None and not 0 < self.seconds < math.inf:
            raise InputError(f"seconds: is out of range (got {self.seconds!r}; allowed: a finite number above 0)")
        if self.film_part == WHOLE:
            return
        given = {"seconds": self.seconds, "noise": self.noise, "denoise": self.denoise or None}
        for name, value in given.items():
            if value is not None:
                raise InputError(f"{name}: needs the whole film (allowed: without part and samples)")
        if self.samples is not None and self.spp is not None:
            raise InputError("spp: does not go with samples, which say where they end (allowed: one of the two)")

    @property
    def film_part(self) -> FilmPart:
        """The tiles and samples that are rendered.

        Raises
        ------
        InputError
            ``part`` or ``samples`` is none.
        """
        number, count = (1, 1) if self.part is None else _numbers(self.part)
        first, end = self.samples or (0, None)
        if end is not None and not 0 <= first < end < MAX_SPP:
            raise InputError(f"samples: are out of range (got {first}:{end}; allowed: as 0:64)")
        return FilmPart(number, count, first, end)

    @property
    def keeps_state(self) -> bool:
        """Whether the state of the render is kept at its end: to go on from it, or to be merged."""
        return self.resume or self.part is not None or self.samples is not None

    def applied_to(self, scene: Scene) -> Scene:
        """Return the scene with the keys that the settings replace."""
        render = {"spp": self.spp, "seed": self.seed, "layers": self.layers, "noise": self.noise}
        film = {"resolution": self.size, "crop": self.crop}
        keys: dict[str, dict[str, Any]] = {"render": render, "film": film}
        given = {part: {key: value for key, value in of.items() if value is not None} for part, of in keys.items()}
        return change_scene(scene, **given) if any(given.values()) else scene

    def most_spp(self, scene: Scene) -> int | None:
        """Return the sample to end before: of ``samples`` or ``spp``, else none for ``seconds``, else the scene's."""
        if self.samples is not None:
            return self.samples[1]
        if self.spp is not None:
            return self.spp
        if self.noise is not None:
            return ADAPTIVE_SPP
        return None if self.seconds is not None else scene.render.most_spp

    def soonest(self, scene: Scene, sessions: list[Session]) -> list[Session]:
        """Return the devices, with programs that compile soonest where few samples are all that is to be taken."""
        spp, takes_more = self.most_spp(scene), scene.requested_autofocus is not None or has_ghosts(scene)
        if spp is None or scene.render.noise is not None or takes_more or len(sessions) > 1:
            return sessions
        return [sessions[0].for_samples(spp * FilmLayout.of(scene.film).pixels)]


def _numbers(part: str) -> tuple[int, int]:
    """Return number and count of a part such as ``3/8``."""
    match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", part, re.ASCII)
    number, count = (int(match[1]), int(match[2])) if match else (0, 0)
    if not 1 <= number <= count:
        raise InputError(f"part: is none (got {part}; allowed: as 3/8, from 1/8 to 8/8)")
    return number, count
