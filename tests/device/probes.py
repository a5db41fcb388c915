"""Small kernels that show what device code computes: they include the very files that render.

`Session.program` takes files below ``kernels/``; an absolute path leads out of there to the probes beside this file,
whose own includes are found in ``kernels/`` again.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.records import WAVE, device_declarations
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.cameras.model import CameraModel
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

FOLDER = Path(__file__).parent / "kernels"
GROUP = 16


def open_session() -> Session:
    """Return a session on the device that the tests run on."""
    return Session(choose_device())


def run(session: Session, probe: str, facts: Mapping[str, Any], items: int, /, **arguments: Any) -> None:
    """Run a probe over ``items`` work items; its arguments are given by name."""
    program = session.program([str(FOLDER / f"{probe}.cl")], facts, device_declarations())
    session.bind(program, probe, **arguments).enqueue(items, 1 if session.group == 1 else min(GROUP, items))
    session.finish()


@dataclass(frozen=True)
class CameraRays:
    """Rays of the pixels of a film in the camera's frame [m], with the pixel of each and what its lens did to it."""

    origin: NDArray[np.float64]
    direction: NDArray[np.float64]
    weight: NDArray[np.float64]
    status: NDArray[np.int64]
    pixel: NDArray[np.int64]
    sample: NDArray[np.int64]


def wave_record(layout: FilmLayout, samples: int, seed: tuple[int, int]) -> NDArray[np.void]:
    """Return the record of a wave that holds all pixels."""
    record = WAVE.zeros(1)
    record["seed"][0] = seed
    record["pixels"], record["samples"] = layout.pixels, samples
    record["tiles_across"], record["full_width"] = layout.tiles_across, layout.full_width
    record["width"], record["height"] = layout.width, layout.height
    record["crop_x"], record["crop_y"] = layout.x, layout.y
    return record


def camera_slots(
    session: Session,
    scene: Scene,
    samples: int,
    lanes: int = 8,
    seed: tuple[int, int] = (7, 11),
    beyond: float = 0.0,
    lattice: bool = False,
    change: Callable[[CameraModel], CameraModel] = lambda camera: camera,
) -> NDArray[np.float64]:
    """Return what the probe writes of every slot, those of padding too, shape (12, slots).

    The camera's tables are followed by a million values ``beyond``: what reads past their end depends on them.
    """
    camera = change(make_plan(scene).camera)
    layout = FilmLayout.of(scene.film)
    slots = layout.pixels * samples
    facts = {**camera.facts, "CAMERA_FILE": camera.kernel, "VW": lanes, "SAMPLER_LATTICE": int(lattice)}
    tables = np.concatenate([camera.tables, np.full(1 << 20, beyond, np.float32)])
    out = session.allocate(12 * 4 * slots)
    run(
        session, "probe_camera", facts, slots // lanes, camera=session.upload(camera.record),
        tables=session.upload(tables), surfaces=session.upload(camera.surfaces), stop=session.upload(camera.stop),
        out=out, capacity=np.uint32(slots), wave=wave_record(layout, samples, seed).tobytes(),
        tiles=session.upload(layout.whole_list()),
    )  # fmt: skip
    return session.read(out, np.float32, 12 * slots).reshape(12, slots).astype(np.float64)


def camera_rays(
    session: Session,
    given: Scene | Mapping[str, Any],
    samples: int,
    lanes: int = 8,
    seed: tuple[int, int] = (7, 11),
    lattice: bool = False,
    change: Callable[[CameraModel], CameraModel] = lambda camera: camera,
) -> CameraRays:
    """Return the camera rays of the pixels of a scene's film, ``samples`` per pixel."""
    scene = given if isinstance(given, Scene) else load_scene(given)
    fields = camera_slots(session, scene, samples, lanes, seed, lattice=lattice, change=change)
    fields = fields[:, fields[11] == 1]
    whole = fields[7:11].astype(np.int64)
    return CameraRays(fields[:3].T, fields[3:6].T, fields[6], whole[0], whole[1:3].T, whole[3])
