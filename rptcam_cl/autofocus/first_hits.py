"""What the rays of a camera meet first: distances and objects, seen through a pinhole in the place of the stop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from rptcam_cl.autofocus.drive import Drive
from rptcam_cl.autofocus.probe import Zone
from rptcam_cl.cameras.exposure import exposed
from rptcam_cl.device import Session
from rptcam_cl.plan import make_plan
from rptcam_cl.scene import Scene, change_scene
from rptcam_cl.scene.layers import LayerName
from rptcam_cl.wavefront import Wavefront
from rptcam_cl.wavefront.film import FilmLayout

# Shares of the opening's diameter, the first f/100 for a lens of f/2. Where a lens is stopped down so far that rays,
# which aim at boxes, hardly ever find the pupil, the next one is taken.
OPENINGS = (0.02, 0.1, 0.5, 1.0)
ENOUGH = 0.05  # of the rays pass
SAMPLES = 16  # per pixel


def first_hits(
    drive: Drive,
    scene: Scene,
    session: Session,
    state: float,
    zones: Sequence[Zone],
    layout: FilmLayout,
    names: Sequence[LayerName],
    seed: int,
) -> tuple[dict[str, NDArray[Any]], int]:
    """Return layers of what a part of the film sees, (height, width) each, and how many samples they took.

    Parameters
    ----------
    scene
        With the film that `layout` is a part of.
    zones
        Where the layers are needed.
    """
    seen = change_scene(scene, render={"layers": tuple(names), "layers_spp": SAMPLES, "max_depth": 1, "noise": None})
    taken = 0
    for opening in OPENINGS:
        camera = exposed(drive.camera(seen, state, opening, zones), seen)
        wavefront = Wavefront(session, make_plan(seen, camera), layout, seen.render)
        wavefront.seed = seed
        for wave in wavefront.waves(0, SAMPLES):
            wavefront.enqueue(*wave)
        wavefront.finish()
        taken += wavefront.camera_rays
        if wavefront.outcomes()["passed"] >= ENOUGH * wavefront.camera_rays:
            break
    return wavefront.layers(), taken
