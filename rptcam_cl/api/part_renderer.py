"""Many parts of one film, each as the content of a file, by kernels that are compiled once."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from functools import partial
from typing import Any

from rptcam_cl.api.image_layers import truth_of
from rptcam_cl.api.settings import RenderSettings
from rptcam_cl.api.stages import arrays_beside, check_divisible, of_picture, resolve
from rptcam_cl.api.wavefronts import devices_of
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.device import open_session
from rptcam_cl.imaging import check_sensor
from rptcam_cl.plan import make_plan
from rptcam_cl.rendering import (
    SUFFIX,
    FilmLayout,
    FilmPart,
    Saver,
    Wavefront,
    aimed_plan,
    forecast,
    ghosting_of,
    render_state,
    window,
)
from rptcam_cl.scene import Scene

SHORT_MEASURE_S = 0.2  # by which parts are made: parts of half or twice the time are no worse


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

    def is_same(self, other: Found) -> bool:
        """Return whether another worker, or the same earlier, has found the same; what it could not measure is nan."""
        return self.text() == other.text()

    def text(self) -> str:
        """Return all of it, as a file has it."""
        return json.dumps(asdict(self), sort_keys=True, default=str)


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
    made_by : dict
        What the parts say of this program.

    Raises
    ------
    InputError, DeviceError
        As `rptcam_cl.render` does.
    """

    def __init__(self, scene: Scene, settings: RenderSettings, device: str | None, found: Found | None = None) -> None:
        scene = settings.applied_to(scene)
        check_sensor(scene, *window(scene)[2:])
        check_divisible(scene)
        end = settings.most_spp(scene)
        assert end is not None, "parts end by samples"
        self._end = end
        session = open_session(device)
        known = found or Found()
        resolved = resolve(scene, session, known.focus, known.metered_cd_m2)
        self.found = found or Found(resolved.focus, resolved.metered_cd_m2)
        self.device = session.info.name
        layout, layers = FilmLayout.of(scene.film), scene.render.layers
        plan, buffers = aimed_plan(make_plan(resolved.scene), session, layers)
        self._wavefront = Wavefront(session, plan, layout, scene.render, buffers=buffers)
        self._wavefront.warm_up()
        ghosting = ghosting_of(resolved.ghosts, plan, session)
        self._saver = Saver(f"part{SUFFIX}", scene, [self.device], [session.info.driver])
        self.made_by = self._saver.makers[0]
        self._saver.focus, self._saver.metered_cd_m2 = self.found.focus, self.found.metered_cd_m2
        self._saver.of_picture = of_picture(scene, resolved, plan, settings)
        truth = truth_of(resolved.scene, plan, self._wavefront, layers, settings)
        self._saver.beside = partial(arrays_beside, resolved.diffraction, ghosting, truth)

    def seconds(self) -> float:
        """Return how long the whole film takes here [s], by a short measurement."""
        return forecast(self._wavefront, 0, self._end, measure_s=SHORT_MEASURE_S).seconds

    def render(self, part: FilmPart) -> tuple[bytes, float]:
        """Render a part; return the content of its file, which `rptcam_cl.merge` reads, and how long it took [s]."""
        begun, wavefront = time.perf_counter(), self._wavefront
        wavefront.clear()
        wavefront.choose_tiles(part.tiles(wavefront.layout.tiles))
        state = render_state(wavefront, self._end, part)
        self._saver.parts_since = lambda done: devices_of(wavefront, part.first, done)
        return self._saver.content(state, part), time.perf_counter() - begun
