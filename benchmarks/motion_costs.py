"""What motion costs: the same scene standing still, with a moving camera, and with one object that moves.

    python -m benchmarks.motion_costs [--rounds 7] [--json FILE]

Renders of the same samples one after the other; each is compared with the still one of its round, by CPU time.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from benchmarks.report import arguments, machine, print_machine, print_table, spread, write_json
from benchmarks.scenes import MEANING, reference_scene, render_samples, wavefront_of
from benchmarks.stopwatch import timed
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

SCENES = ("A", "B", "C")
MOVING = {"A": 1, "B": -1, "C": 1}  # the object that moves: a ball, a block, a mesh

STRAIGHT = [{"time_s": 0}, {"time_s": 1, "translate": [0.01, 0, 0]}]
TURN = [{"time_s": 0}, {"time_s": 1, "translate": [0.01, 0, 0], "rotate": {"axis": [0, 0, 1], "degrees": 1}}]
THREE = [*TURN, {"time_s": 2, "translate": [0, 0.01, 0]}, {"time_s": 3}]


def moving_camera(data: dict[str, Any], index: int) -> dict[str, Any]:
    """Return the scene with a camera that goes a little to the side."""
    eye = [data["camera"]["eye"][0] + 0.01, *data["camera"]["eye"][1:]]
    return data | {"camera": data["camera"] | {"motion": [{"time_s": 0}, {"time_s": 1, "eye": eye}]}}


def moving_object(data: dict[str, Any], index: int, way: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the scene with one object that moves."""
    objects = list(data["objects"])
    objects[index] = objects[index] | {"motion": way}
    return data | {"objects": objects}


def cases(name: str, shrink: int) -> Mapping[str, Scene]:
    """Return the scenes to compare, the still one first."""
    still = reference_scene(name, shrink=shrink)
    data = still.model_dump(exclude_unset=True) | {"shutter": {"time_s": 3}}
    found = {
        "camera moves": moving_camera(data, MOVING[name]),
        "object moves straight": moving_object(data, MOVING[name], STRAIGHT),
        "object turns": moving_object(data, MOVING[name], TURN),
        "object turns, three segments": moving_object(data, MOVING[name], THREE),
    }
    return {"still": still} | {key: load_scene(value, base_dir=still.base_dir) for key, value in found.items()}


def main() -> None:
    """Measure and print."""
    parser = arguments("CPU time of motion, relative to the same scene standing still.")
    parser.add_argument("--rounds", type=int, default=7, help="times that all are rendered (default 7)")
    options = parser.parse_args()
    session = Session(choose_device(options.device))
    facts = machine(session.info)
    print_machine(facts)
    rounds, shrink = (1, 8) if options.quick else (options.rounds, 2)
    results: dict[str, Any] = {}
    for name in SCENES:
        fronts = {case: wavefront_of(scene, session) for case, scene in cases(name, shrink).items()}
        spp = next(iter(fronts.values())).samples_per_wave
        seen: dict[str, list[float]] = {case: [] for case in fronts}
        for _ in range(rounds):
            for case, front in fronts.items():
                seen[case].append(timed(partial(render_samples, front, spp)).cpu)
        results[name] = {
            case: [a / b for a, b in zip(times, seen["still"], strict=True)] for case, times in seen.items()
        }
        rows = [[case, spread(ratios)] for case, ratios in results[name].items()]
        print_table(f"Scene {name}: {MEANING[name]}", ("case", "CPU time over that of the still scene"), rows)
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
