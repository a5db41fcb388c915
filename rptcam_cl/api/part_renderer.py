"""Many parts of one film, each kept in a file, by kernels that are compiled once."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rptcam_cl.api.settings import RenderSettings
from rptcam_cl.api.stages import check_divisible, devices_of, of_picture, resolve
from rptcam_cl.device import open_session
from rptcam_cl.imaging import check_sensor
from rptcam_cl.plan import make_plan
from rptcam_cl.rendering import FilmLayout, FilmPart, Saver, Wavefront, aimed_plan, forecast, render_plan, window
from rptcam_cl.scene import Scene

SHORT_MEASURE_S = 0.5


@dataclass(frozen=True)
class Found:
    """What is found once for all parts of a film.

    Attributes
    ----------
    focus : dict or None
        What autofocus found.
    metered_cd_m2 : float or None
        The luminance that the exposure follows from.
    """

    focus: dict[str, Any] | None = None
    metered_cd_m2: float | None = None


class PartRenderer:
    """Renders parts of one film by tiles; `rptcam_cl.merge` puts them together.

    Parameters
    ----------
    scene
        The scene.
    settings
        What replaces its keys.
    device
        As for `rptcam_cl.choose_device`.
    found
        Focus and exposure, where they were found before; else they are found here.

    Attributes
    ----------
    found : Found
    device : str
        Name of the device.

    Raises
    ------
    InputError, DeviceError
        As `rptcam_cl.render` does.
    """

    def __init__(self, scene: Scene, settings: RenderSettings, device: str | None, found: Found | None = None) -> None:
        self._settings = settings
        self._scene = scene = settings.applied_to(scene)
        check_sensor(scene, *window(scene)[2:])
        check_divisible(scene)
        session = open_session(device)
        known = found or Found()
        resolved = resolve(scene, session, known.focus, known.metered_cd_m2)
        self.found = found or Found(resolved.focus, resolved.metered_cd_m2)
        self.device = session.info.name
        layout, layers = FilmLayout.of(scene.film), scene.render.layers
        self._plan, buffers = aimed_plan(make_plan(resolved.scene), session, layers)
        self._wavefront = Wavefront(session, self._plan, layout, scene.render, buffers=buffers)
        self._wavefront.warm_up()
        self._diffraction = resolved.diffraction
        self._of_picture = of_picture(scene, resolved, self._plan, settings)

    def seconds(self) -> float:
        """Return how long the whole film takes here [s], by a short measurement."""
        return forecast(self._wavefront, 0, self._end, measure_s=SHORT_MEASURE_S).seconds

    @property
    def _end(self) -> int:
        end = self._settings.most_spp(self._scene)
        assert end is not None, "parts end by samples"
        return end

    def render(self, part: FilmPart, path: Path, should_stop: Callable[[], bool] | None = None) -> float:
        """Render a part into a file, and return how long it took [s]; stopped, there is no file."""
        begun, wavefront = time.perf_counter(), self._wavefront
        wavefront.clear()
        rendering = render_plan(
            wavefront, spp=self._end, seconds=None, has_lens=self._plan.camera.has_lens, part=part,
            should_stop=should_stop,
        )  # fmt: skip
        if not rendering.interrupted:
            saver = Saver(path, self._scene, [self.device], part)
            saver.focus, saver.metered_cd_m2 = self.found.focus, self.found.metered_cd_m2
            saver.of_picture = self._of_picture
            if self._diffraction is not None:
                saver.beside = self._diffraction.arrays
            saver.parts_since = lambda done: devices_of(wavefront, part.first, done)
            saver.save(rendering.state())
        return time.perf_counter() - begun
