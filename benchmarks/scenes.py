"""The reference scenes of the tests, at the size and with the roulette that a benchmark wants."""

from __future__ import annotations

import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

from benchmarks import hard_light
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from tests.support.mesh_scene import write_meshes

REFERENCE = Path(__file__).resolve().parents[1] / "tests" / "data" / "reference"
STUDIO = REFERENCE.parents[2] / "examples" / "studio"  # the meshes and the light of D
FULL_SIZE = dict.fromkeys(("A", "A_thin", "A_lens", "C", "D"), (640, 360)) | {"B": (512, 512)}
MEANING = {
    "A": "three spheres on a checker, pinhole",
    "A_thin": "the same, thin lens",
    "A_lens": "the same, double Gauss of eleven surfaces",
    "B": "Cornell box, pinhole",
    "C": "two meshes of 303,104 triangles, pinhole",
    "D": "a room of meshes, a picture of light and two lamps, the double Gauss",
}


@lru_cache(maxsize=1)
def _mesh_folder() -> Path:
    folder = Path(tempfile.gettempdir()) / "rptcam_cl-benchmark-meshes"
    folder.mkdir(exist_ok=True)
    return write_meshes(folder)


def reference_scene(name: str, *, shrink: int = 1, roulette: bool = False, **render: Any) -> Scene:
    """Return a reference scene.

    Parameters
    ----------
    name
        A, A_thin, A_lens, B, C, whose meshes are made by formula in a temporary folder, or D; or one of
        `benchmarks.hard_light`.
    shrink
        Divides width and height of the full size.
    roulette
        Whether Russian roulette ends paths from the default edge on, or never.
    **render
        Other settings of the scene's ``render``.
    """
    folder = _mesh_folder() if name == "C" else REFERENCE if name in FULL_SIZE and name != "D" else STUDIO
    keys = hard_light.SCENES[name]() if name not in FULL_SIZE else read_yaml(REFERENCE / f"{name}.yaml").data
    scene = load_scene(keys, base_dir=folder)
    width, height = FULL_SIZE.get(name, scene.film.resolution)
    defaults = type(scene.render)()
    if name == "A_lens":  # its file aims as the other renderer of the tests did; benchmarks are of what users get
        scene = change_scene(scene, camera={"pupil": type(scene.camera).model_fields["pupil"].default})
    settings = {"roulette_depth": defaults.roulette_depth if roulette else 0, **render}
    return change_scene(scene, film={"resolution": (width // shrink, height // shrink)}, render=settings)


def wavefront_of(
    scene: Scene, session: Session, wave_size: int | None = None, organisation: str | None = None
) -> Wavefront:
    """Return the compiled wavefront of a scene, ready to render."""
    wavefront = Wavefront(session, make_plan(scene), FilmLayout.of(scene.film), scene.render, wave_size, organisation)
    wavefront.warm_up()
    return wavefront


def render_samples(wavefront: Wavefront, spp: int) -> None:
    """Render ``spp`` samples of every pixel into the film, and wait."""
    for first in range(0, spp, wavefront.samples_per_wave):
        for wave in wavefront.waves(first, min(wavefront.samples_per_wave, spp - first)):
            wavefront.enqueue(*wave)
    wavefront.finish()
