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

PINHOLE = 0.02  # of the opening's diameter: f/100 for a lens of f/2
SAMPLES = 16  # per pixel; on the average one in three passes the pupil


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
    camera = exposed(drive.camera(seen, state, PINHOLE, zones), seen)
    wavefront = Wavefront(session, make_plan(seen, camera), layout, seen.render)
    wavefront.seed = seed
    for wave in wavefront.waves(0, SAMPLES):
        wavefront.enqueue(*wave)
    wavefront.finish()
    return wavefront.layers(), wavefront.camera_rays
