"""What an edit of a scene costs a session: CPU time of the change alone, in a large mesh and among many instances.

    python -m benchmarks.edits [--times 5] [--json FILE]

*one mesh* is a wavy plate of 1.01 million triangles beside a small one; *instances* are 10,000 of a plate of 5,000
triangles. *orbit* moves the camera about its target, *f-number* closes the lens, *material* changes the colour of what
is large, *transform* moves a small object or an instance, *large* the large mesh. Each figure is the median of the
processor's time: of the call after which frames can be taken, of a glance after it, and of the film's first sample,
which wants the trees of a render.
"""

from __future__ import annotations

import gc
import math
import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.api.session import RenderSession
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

SIZE = [320, 180]


def plate(side: int) -> dict[str, Any]:
    """Return the keys of a wavy plate of 2·side² triangles, one unit wide."""
    u, v = np.meshgrid(*2 * (np.linspace(-0.5, 0.5, side + 1),))
    points = np.stack([u, 0.02 * np.sin(20 * u) * np.cos(23 * v), v], axis=-1).reshape(-1, 3)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    corners = np.stack([first, first + side + 1, first + side + 2, first + 1], axis=1)
    faces: NDArray[np.int64] = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    return {"vertices": points, "faces": faces}


def scene_of(meshes: dict[str, Any], objects: list[dict[str, Any]]) -> Scene:
    """Return a scene seen by a double Gauss, lit by a lamp."""
    return load_scene(
        {
            "film": {"resolution": SIZE, "size_mm": [36, 20.25]},
            "camera": {
                "kind": "realistic", "lens": "dgauss-50mm", "f_number": 4, "eye": [0, 3, 6], "target": [0, 0, 0],
                "focus": {"distance_m": 6.7},
            },
            "materials": {
                "large": {"kind": "matte", "reflectance": 0.5},
                "small": {"kind": "matte", "reflectance": 0.2},
            },
            "meshes": meshes,
            "objects": objects,
            "lights": [{"kind": "point", "position": [2, 5, 3], "intensity": 900}],
        }
    )  # fmt: skip


def one_mesh(shrink: int) -> Scene:
    """Return a scene with a mesh of a million triangles."""
    large = {"shape": "mesh", "mesh": "large", "material": "large", "transform": [{"scale": 4}]}
    small = {"shape": "mesh", "mesh": "small", "material": "small", "transform": [{"translate": [0, 1, 0]}]}
    return scene_of({"large": plate(711 // shrink), "small": plate(10)}, [large, small])


def instances(shrink: int) -> Scene:
    """Return a scene with ten thousand instances of a mesh."""
    side = 100 // shrink
    objects = [
        {
            "shape": "mesh", "mesh": "tile", "material": "large" if (i + j) % 2 else "small",
            "transform": [{"scale": 0.05}, {"translate": [0.06 * (i - side / 2), 0.0, 0.06 * (j - side / 2)]}],
        }
        for i in range(side) for j in range(side)
    ]  # fmt: skip
    return scene_of({"tile": plate(50)}, objects)


def edits(index: int) -> dict[str, dict[str, Any]]:
    """Return the changes to be measured, others for each index."""
    angle = 0.02 * index
    return {
        "orbit": {"camera.eye": [6 * math.sin(angle), 3, 6 * math.cos(angle)]},
        "f-number": {"camera.f_number": 4 + 0.1 * index},
        "material": {"materials.large.reflectance": 0.5 - 0.01 * index},
        "transform": {"objects.1.transform": [{"scale": 0.05}, {"translate": [0, 1 + 0.01 * index, 0]}]},
        "large": {"objects.0.transform": [{"scale": 4}, {"translate": [0, 0.01 * index, 0]}]},
    }


def measure(session: RenderSession, name: str, times: int) -> dict[str, float]:
    """Return medians of the processor's time for a change, a glance after it, and a sample of the film [s]."""
    steps: dict[str, list[float]] = {"change": [], "glance": [], "sample": []}
    for index in range(times + 1):
        keys = edits(index + 1)[name]
        calls: dict[str, Callable[[], object]] = {
            "change": partial(session.change, keys),
            "glance": partial(session.glance, 0.25),
            "sample": session.take,
        }
        gc.collect()
        for step, call in calls.items():
            begun = time.process_time()
            call()
            steps[step].append(time.process_time() - begun)
    return {step: statistics.median(times[1:]) for step, times in steps.items()}


def main() -> None:
    """Measure the edits and print them."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=5, help="changes of each kind (default 5)")
    given = parser.parse_args()
    scenes: dict[str, Callable[[int], Scene]] = {"one mesh": one_mesh, "instances": instances}
    results, rows, facts = {}, [], None
    for title, make in scenes.items():
        with RenderSession(make(10 if given.quick else 1), device=given.device) as session:
            if facts is None:
                facts = machine(session.device.info)
                print_machine(facts)
            session.glance(0.25)
            for name in edits(0):
                if name == "large" and title != "one mesh":
                    continue
                results[f"{title}, {name}"] = figures = measure(session, name, 1 if given.quick else given.times)
                rows.append([f"{title}, {name}", *(f"{figure:.3f}" for figure in figures.values())])
    print_table("CPU seconds", ["edit", "change", "glance", "sample"], rows)
    assert facts is not None
    write_json(given.json, facts, results)


if __name__ == "__main__":
    main()
