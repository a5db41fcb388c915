"""What a frame of a dataset costs beside its rays: setup and files, for each kind of key that is drawn.

    python -m benchmarks.dataset_setup [--frames 24] [--json FILE]

Frames of 320x240 pixels at 16 samples per pixel, by processor time of all threads. ``rays`` is the taking of samples;
``files`` the writing of a PNG and an EXR; ``setup`` all else: values, lens, plan, camera model. Caches are empty
folders; frames before those that count compile the kernels and find the tables that states of a lens share.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rptcam_cl.api.job as job
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.batch.dataset import DatasetFolder, dataset
from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.core.remember import forget
from rptcam_cl.device.devices import choose_device
from rptcam_cl.rendering.cameras.pupil import KEPT

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
FIRST, FIRST_OF_STATES = 4, 60  # frames that do not count; where states of a lens share tables
STATES = ("focus", "f-number", "film", "zoom", "rise")
GOAL = 0.1
COLUMNS = ("scene", "drawn", "rays, ms", "setup, ms", "share, %", "files, ms", "goal met")
LENSES: dict[str, Any] = {"grid": ["dgauss-50mm", "dgauss-100mm"]}
FIXED = {"film.resolution": [320, 240], "film.width_mm": 30, "render.spp": 16, "render.layers": ["depth"]}
ANY: dict[str, Any] = {
    "lens seen before": {"camera.lens": LENSES},
    "f-number": {"camera.f_number": {"uniform": [2.8, 11]}},
    "film": {"film.width_mm": {"uniform": [20, 30]}},
}
SCENES: dict[str, tuple[Path, dict[str, Any], dict[str, Any]]] = {
    "dataset": (
        EXAMPLES / "dataset" / "table.yaml",
        {},
        {
            "pose": {"camera.eye": {"uniform": [[-0.6, 0.3, 1.3], [0.6, 0.9, 1.8]]}},
            "light": {"materials.window.radiance": {"uniform": [[9, 6, 6], [16, 11, 12]]}},
            "material": {"materials.blue.reflectance": {"uniform": [[0.02, 0.02, 0.02], [0.8, 0.8, 0.8]]}},
            "focus": {"camera.focus.distance_m": {"uniform": [1.2, 2.2]}},
            **ANY,
        },
    ),
    "movements": (
        EXAMPLES / "dataset" / "table.yaml",
        {},
        {
            "rise": {"camera.movements.rise_mm": {"uniform": [-4, 4]}},
            "tilt": {"camera.movements.tilt_degrees": {"uniform": [-4, 4]}},
        },
    ),
    "zoom": (
        EXAMPLES / "dataset" / "table.yaml",
        {"camera.lens": "zoom-70-200mm", "camera.f_number": 4, "camera.focus.distance_m": 2.5},
        {"zoom": {"camera.focal_length_mm": {"uniform": [80, 180]}}},
    ),
    "first_light": (
        EXAMPLES / "first_light.yaml",
        {},
        {
            "pose": {"camera.eye": {"uniform": [[-20, -70, 12], [20, -60, 25]]}},
            "light": {"materials.key.radiance": {"uniform": [[9, 6, 6], [16, 11, 12]]}},
            "material": {"materials.blue.reflectance": {"uniform": [[0.02, 0.02, 0.02], [0.8, 0.8, 0.8]]}},
            "focus": {"camera.focus.distance_m": {"uniform": [0.6, 1.2]}},
            **ANY,
        },
    ),
    "tea_table": (
        EXAMPLES / "studio" / "tea_table.yaml",
        {"render.noise": None},
        {
            "pose": {"camera.eye": {"uniform": [[-9, 20, 80], [9, 30, 95]]}},
            "material": {"materials.edge.reflectance": {"uniform": [[0.02, 0.02, 0.02], [0.8, 0.8, 0.8]]}},
            "focus": {"camera.focus": {"choice": [{"distance_m": 0.7 + 0.01 * step} for step in range(40)]}},
            **ANY,
        },
    ),
}


class Clock:
    """Adds up the processor time of the taking of samples and of the writing of files [s]."""

    def __init__(self) -> None:
        self.rays = self.files = 0.0

    @contextmanager
    def running(self) -> Iterator[None]:
        """Count both meanwhile."""
        plain, keep = job.render_plan, DatasetFolder.keep
        job.render_plan = self._counted(plain, "rays")
        DatasetFolder.keep = self._counted(keep, "files")  # type: ignore[method-assign]
        try:
            yield
        finally:
            job.render_plan, DatasetFolder.keep = plain, keep  # type: ignore[method-assign]

    def _counted(self, work: Callable[..., Any], part: str) -> Callable[..., Any]:
        def counted(*args: Any, **options: Any) -> Any:
            begun = time.process_time()
            try:
                return work(*args, **options)
            finally:
                setattr(self, part, getattr(self, part) + time.process_time() - begun)

        return counted


def measure(
    scene: Path, fixed: dict[str, Any], vary: dict[str, Any], first: int, count: int, device: str | None
) -> dict[str, float]:
    """Return what rays, files and setup of a frame take, with empty caches [s]."""
    source = {"scene": scene.name, "seed": 7, "set": FIXED | fixed, "vary": vary, "files": ["png", "exr"]}
    clock = Clock()
    with tempfile.TemporaryDirectory() as place, clock.running():
        os.environ[CACHE_VARIABLE] = f"{place}/own"
        forget(KEPT)
        frames = dataset(source, Path(place, "out"), frames=first + count, device=device)
        for _ in range(first):
            next(frames)
        clock.rays, clock.files, begun = 0.0, 0.0, time.process_time()
        for _ in range(count):
            next(frames)
        whole = time.process_time() - begun
    return {
        "rays": clock.rays / count,
        "setup": (whole - clock.rays - clock.files) / count,
        "files": clock.files / count,
    }


def main() -> None:
    """Measure every kind of key on every scene and print the table."""
    parser = arguments("What a frame of a dataset costs beside its rays.")
    parser.add_argument("--frames", type=int, default=24, help="frames of each kind (default 24)")
    parser.add_argument("--kinds", nargs="+", help="of keys (default all)")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    options = parser.parse_args()
    facts = machine(choose_device(options.device))
    results: dict[str, dict[str, dict[str, float]]] = {}
    lines = []
    for name in options.scenes[:1] if options.quick else options.scenes:
        path, fixed, kinds = SCENES[name]
        os.chdir(path.parent)
        results[name] = {}
        for kind in list(kinds)[:2] if options.quick else options.kinds or kinds:
            first, count = FIRST_OF_STATES if kind in STATES else FIRST, options.frames
            first, count = (1, 2) if options.quick else (first, count)
            found = measure(path, fixed, kinds[kind], first, count, options.device)
            results[name][kind] = found
            share = found["setup"] / (found["rays"] + found["setup"])
            times = [f"{1e3 * found[part]:.1f}" for part in ("rays", "setup", "files")]
            met = "yes" if share <= GOAL else "no"
            lines.append([name, kind, *times[:2], f"{100 * share:.0f}", times[2], met])
    print_machine(facts)
    print_table("Setup of a frame: at most a tenth of it", COLUMNS, lines)
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
