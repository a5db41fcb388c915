"""Autofocus on 500 random targets of all kinds: how often each method ends in focus, refuses, or errs in silence.

    python -m benchmarks.focus_success [--cases 60] [--kinds textured,mirror] [--methods hybrid] [--electrons 200]
        [--quick] [--json FILE]

A run that was ended goes on with `--json FILE --resume`, from what the file holds.

Case number n is of the kind n modulo their count, so that any first part of the 500 holds all kinds; it is the same
on every machine. A method is right where the state lies within half of a depth of focus, 2 N c, of that of the least
spot of exact rays in float64 for one of the distances that the zone shows. Those follow from the scene by formulas:
behind a pane of thickness t an object seems t (1 - 1/n) nearer, in a mirror as far as the light goes; of example scenes
they are the layer `sharp_depth`. For methods that seek contrast, states count too from there to where details of four
and eight pixels are clearest. A *silent error* is a state that is wrong and has no failure in its report.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.api.job import render
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.scene.changes import change_scene, set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.controller import BY_DETAILS, focus_of
from rptcam_cl.studies.focus.phase import DETAILS, half_view
from rptcam_cl.studies.focus.probe import FocusReport, Policy, Zone
from rptcam_cl.studies.focus.renderer import ProbeRenderer, Task

METHODS = ("contrast", "laplacian", "phase", "hybrid", "depth", "variance")
CASES = 500
SHARP, FINE = 0.5, 0.125  # depths of focus
LENSES: dict[str, tuple[float, tuple[float | None, ...]]] = {  # focal length [mm] and apertures
    "dgauss-50mm": (50, (2.2, 2.8, 4, 8)),
    "wide-22mm": (22, (2.8, 4)),
    "telephoto-250mm": (250, (5.6, 8)),
    "achromat-100mm": (100, (None,)),
    "plano-convex-100mm": (100, (None,)),
    "tessar-100mm": (100, (4.5, 8)),
    "double-gauss-50mm-f1.8": (50, (2, 4)),
    "thin lens": (50, (1.4, 2.8, 5.6)),
}
PHONE = "phone-5.6mm"
WELL_CORRECTED = ("dgauss-50mm", "wide-22mm", "tessar-100mm", "double-gauss-50mm-f1.8", "thin lens")
POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
FILM = {"resolution": [640, 427], "size_mm": [36, 24]}
SENSOR = {"pixel_pitch_um": 4.4, "read_noise_e": 3.0, "bit_depth": 14}
PHONE_FILM = {"resolution": [640, 480], "size_mm": [5.6, 4.2]}
BLANK_EVERY = 10
EXAMPLES = (
    "first_light", "portrait", "boards", "still_life", "colour_chart", "sun_ghosts",
    "sharpness", "assignment/cards", "assignment/bunnies", "studio/evening", "studio/tea_table", "studio/workshop",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A scene to focus on.

    Attributes
    ----------
    scene : Scene
    zone : Zone
    distances_m : tuple of float
        Of what the zone shows; each may be focused on.
    start : float
        Where to start, from 0 (far) to 1 (near); 0 for the state of the scene.
    blank : bool
        Whether there is nothing to see, so that a refusal is right.
    words : str
    kind : str
    """

    scene: Scene
    zone: Zone
    distances_m: tuple[float, ...]
    start: float
    blank: bool
    words: str
    kind: str = "textured"


def random_case(number: int) -> Case:
    """Return a case; the same for the same number."""
    rng = np.random.default_rng(number)
    lens = str(rng.choice(list(LENSES)))
    focal_length, apertures = LENSES[lens]
    f_number = apertures[rng.integers(len(apertures))]
    distance = float(focal_length * 1e-3 * np.exp(rng.uniform(np.log(15), np.log(300))))
    blank = number % BLANK_EVERY == BLANK_EVERY - 1
    contrast = 0.0 if blank else float(rng.choice([0.9, 0.5, 0.25]))
    x, y = rng.uniform(0.2, 0.74), rng.uniform(0.2, 0.72)
    camera: dict[str, Any] = {"kind": "realistic", "lens": lens, "focus": {"distance_m": 3 * distance}, **POSE}
    if lens == "thin lens":
        camera = {"kind": "thin_lens", "focal_length_mm": focal_length, "focus_distance_m": 3 * distance, **POSE}
    if f_number is not None:
        camera["f_number"] = f_number
    scene = load_scene(
        {
            "film": FILM,
            "camera": camera,
            "render": {"max_depth": 3},
            "environment": {"kind": "constant", "radiance": 1.0},
            "objects": [_target(rng, distance, focal_length, contrast)],
        }
    )
    words = f"{lens}, f/{f_number or 'open'}, {distance:.3g} m, contrast {contrast:g}"
    start = float(rng.uniform(0, 1)) ** 3
    return Case(
        scene, Zone(x, x + 0.06, y, y + 0.08), (distance,), start, blank, words, "blank" if blank else "textured"
    )


def _target(rng: np.random.Generator, distance: float, focal_length: float, contrast: float) -> dict[str, Any]:
    """Return a square across the picture with spots or a chess board of 0.2 to 1 mm on the film."""
    half = distance * 30 / focal_length
    cells = 60 / float(np.exp(rng.uniform(np.log(0.2), np.log(1.0))))
    low, high = 0.5 * (1 - contrast), 0.5 * (1 + contrast)
    reflectance: Any = {"kind": "noise", "low": low, "high": high, "scale": [cells, cells], "octaves": 2}
    if rng.random() < 0.3:
        reflectance = {"kind": "checker", "even": low, "odd": high, "scale": [cells, 0.83 * cells]}
    return {
        "shape": "rectangle",
        "corner": [-half, -half, -distance],
        "edge_u": [2 * half, 0, 0],
        "edge_v": [0, 2 * half, 0],
        "material": {"kind": "matte", "reflectance": 0.5 if contrast == 0 else reflectance},
    }


def textured_case(number: int) -> Case:
    """Return the texture of that number among the cases that have one."""
    return random_case(number + number // (BLANK_EVERY - 1))


def blank_case(number: int) -> Case:
    """Return a grey wall."""
    return random_case(BLANK_EVERY * number + BLANK_EVERY - 1)


class Stage:
    """What a case is built of: a camera with a lens of a kind, and squares and balls before it."""

    def __init__(self, number: int, kind: str, lenses: Sequence[str] = WELL_CORRECTED) -> None:
        self.rng = np.random.default_rng([number, *kind.encode()])
        self.kind, self.lens = kind, str(self.rng.choice(list(lenses)))
        self.focal_length, apertures = (LENSES | {PHONE: (5.55, (None,))})[self.lens]
        self.f_number = apertures[self.rng.integers(len(apertures))]
        self.distance = self.focal_length * 1e-3 * self.between(20, 100)
        self.objects: list[dict[str, Any]] = []

    def between(self, low: float, high: float) -> float:
        """Draw a number, evenly in its logarithm."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def wall(
        self, z: float, contrast: float, left: float = -1.0, right: float = 1.0, seems: float | None = None
    ) -> None:
        """Add a square with texture, its edges in half pictures; ``seems`` is its distance in a mirror."""
        distance = seems or -z
        half = distance * 30 / self.focal_length
        picture = distance * FILM["size_mm"][0] / 2 / self.focal_length
        reach = [edge * (half if abs(edge) == 1.0 else picture) for edge in (left, right)]
        cells = (reach[1] - reach[0]) / half * 30 / self.between(0.2, 1.0)
        texture = {"kind": "noise", "low": 0.5 * (1 - contrast), "high": 0.5 * (1 + contrast), "octaves": 2}
        texture["scale"] = [cells, cells * 2 * half / (reach[1] - reach[0])]
        self.square(reach, half, z, {"kind": "matte", "reflectance": texture})

    def square(self, reach: Sequence[float], half: float, z: float, material: dict[str, Any]) -> None:
        """Add a rectangle across the axis."""
        self.objects.append({
            "shape": "rectangle", "corner": [reach[0], -half, z], "edge_u": [reach[1] - reach[0], 0, 0],
            "edge_v": [0, 2 * half, 0], "material": material,
        })  # fmt: skip

    def lamp(self, x: float, y: float, distance: float, size: float, radiance: float) -> None:
        """Add a ball that shines, at a place in half pictures from the middle, so large in pictures."""
        unit = distance * FILM["size_mm"][0] / 2 / self.focal_length
        self.objects.append({
            "shape": "sphere", "center": [x * unit, y * unit * 2 / 3, -distance], "radius": size * unit,
            "material": {"kind": "emissive", "radiance": radiance},
        })  # fmt: skip

    def case(self, distances: Sequence[float], zone: Zone | None = None, **rest: Any) -> Case:
        """Return the case, with a zone of a usual size anywhere unless one is given."""
        x, y = self.rng.uniform(0.3, 0.64), self.rng.uniform(0.3, 0.62)
        zone = zone or Zone(x, x + 0.06, y, y + 0.08)
        focus: dict[str, Any] = {"focus": {"distance_m": 3 * self.distance}}
        camera: dict[str, Any] = {"kind": "realistic", "lens": self.lens, **focus, **POSE}
        if self.lens == "thin lens":
            camera = {"kind": "thin_lens", "focal_length_mm": self.focal_length, **POSE}
            camera["focus_distance_m"] = 3 * self.distance
        film = PHONE_FILM if self.lens == PHONE else FILM
        if self.f_number is not None:
            camera["f_number"] = self.f_number
        light = {"environment": {"kind": "constant", "radiance": 1.0}, "render": {"max_depth": 6}}
        scene = load_scene({"film": film, "camera": camera, "objects": self.objects} | light)
        words = f"{self.kind}: {self.lens}, f/{self.f_number or 'open'}, {', '.join(f'{d:.3g}' for d in distances)} m"
        return Case(scene, zone, tuple(distances), rest.get("start", 0.0), rest.get("blank", False), words, self.kind)


def lamps_case(number: int) -> Case:
    """Return a wall with texture, and lamps before it beside the zone."""
    stage = Stage(number, "lamps beside")
    stage.wall(-stage.distance, float(stage.rng.choice([0.9, 0.5])))
    x, y = stage.rng.uniform(0.3, 0.6, 2)
    for _ in range(int(stage.rng.integers(1, 4))):
        side = 0.10 + 0.06 * stage.rng.random()
        turn = stage.rng.uniform(0, 2 * np.pi)
        place = 2 * (x + 0.03) - 1 + 2 * side * np.cos(turn), 1 - 2 * (y + 0.04) + 3 * side * np.sin(turn)
        size = stage.between(0.003, 0.03)
        stage.lamp(*place, stage.distance * stage.rng.uniform(0.8, 0.98), size, stage.between(370, 1e4))
    return stage.case([stage.distance], Zone(x, x + 0.06, y, y + 0.08))


def distant_lamps_case(number: int) -> Case:
    """Return a poster that fills the zone, and lamps far behind it that show beside it."""
    stage = Stage(number, "distant lamps")
    distance = 2.0 * stage.focal_length / 50
    stage.distance = distance
    edge = 0.12 + 0.05 * stage.rng.random()
    stage.wall(-distance, 0.9, -edge, edge)
    for side in (-1, 1):
        for _ in range(4):
            place = side * (edge + stage.rng.uniform(0.005, 0.08)), stage.rng.uniform(-0.2, 0.2)
            stage.lamp(*place, distance * stage.between(8, 40), 0.004, stage.between(370, 1e4))
    return stage.case([distance], Zone(0.45, 0.55, 0.44, 0.56))


def glass_case(number: int) -> Case:
    """Return a wall behind a pane, thin or of some thickness."""
    stage = Stage(number, "behind glass")
    stage.wall(-stage.distance, 0.9)
    pane, index = stage.distance * stage.rng.uniform(0.3, 0.8), float(stage.rng.uniform(1.45, 1.6))
    seems = stage.distance
    if stage.rng.random() < 0.5:
        reach = stage.distance
        stage.square([-reach, reach], reach, -pane, {"kind": "thin_glass", "index": index})
    else:
        thick, reach = 0.02 * stage.distance, stage.distance
        low, high = [-reach, -reach, -pane], [reach, reach, -pane + thick]
        glass = {"kind": "dielectric", "index": index}
        stage.objects.append({"shape": "box", "min": low, "max": high, "material": glass})
        seems -= thick * (1 - 1 / index)
    return stage.case([seems])


def mirror_case(number: int) -> Case:
    """Return a mirror that shows a wall behind the camera."""
    stage = Stage(number, "in a mirror")
    mirror = stage.distance * stage.rng.uniform(0.3, 0.45)
    stage.square([-stage.distance, stage.distance], stage.distance, -mirror, {"kind": "mirror", "reflectance": 0.9})
    stage.wall(stage.distance - 2 * mirror, 0.9, seems=stage.distance)
    return stage.case([stage.distance])


def faint_case(number: int) -> Case:
    """Return a texture of 12 % contrast, 0.47 to 0.53."""
    stage = Stage(number, "contrast 12 %")
    stage.wall(-stage.distance, 0.06)
    return stage.case([stage.distance], start=float(stage.rng.random()) ** 3)


def fainter_case(number: int) -> Case:
    """Return one of 3 %, which may be refused."""
    stage = Stage(number, "contrast 3 %")
    stage.wall(-stage.distance, 0.015)
    return stage.case([stage.distance], blank=True)


def edge_case(number: int) -> Case:
    """Return a board before a wall, whose edge runs through the zone."""
    stage = Stage(number, "two depths")
    x, behind = stage.rng.uniform(0.3, 0.6), stage.distance * stage.between(1.3, 4)
    edge = 2 * (x + 0.06 * stage.rng.uniform(0.3, 0.7)) - 1
    stage.wall(-stage.distance, 0.9, -1.0, edge)
    stage.wall(-behind, 0.9)
    return stage.case([stage.distance, behind], Zone(x, x + 0.06, 0.44, 0.54))


def phone_case(number: int) -> Case:
    """Return a wall before the lens of a telephone."""
    stage = Stage(number, "phone lens", [PHONE])
    stage.distance = stage.between(0.08, 2.0)
    stage.wall(-stage.distance, float(stage.rng.choice([0.9, 0.5])))
    x, y = stage.rng.uniform(0.35, 0.55), stage.rng.uniform(0.35, 0.55)
    return stage.case([stage.distance], Zone(x, x + 0.1, y, y + 0.1), start=float(stage.rng.random()) ** 3)


def example_case(number: int) -> Case:
    """Return a zone of an example scene that shows no glass and no mirror."""
    rng = np.random.default_rng([number, 77])
    name = EXAMPLES[number % len(EXAMPLES)]
    scene = load_scene(Path(__file__).parents[1] / "examples" / f"{name}.yaml")
    if scene.requested_autofocus is not None:
        scene = change_scene(scene, camera={"focus": {"distance_m": 3.0}})
    film = scene.film.whole_in((240, 160))
    small = change_scene(scene, film=film, render={"layers": ("sharp_depth", "sharp_object_id"), "spp": 1})
    layers = render(small).layers
    depth, names = np.asarray(layers["sharp_depth"]), np.asarray(layers["sharp_object_id"])
    for _ in range(100):
        x, y = rng.uniform(0.05, 0.87), rng.uniform(0.05, 0.85)
        zone = Zone(x, x + 0.08, y, y + 0.1)
        rows, columns = (slice(int(a * n), int(b * n)) for a, b, n in ((y, y + 0.1, 160), (x, x + 0.08, 240)))
        shown = [scene.objects[int(k)] for k in np.unique(names[rows, columns]) if k >= 0]
        if np.isfinite(depth[rows, columns]).mean() > 0.9 and all(_is_plain(item) for item in shown):
            met = depth[rows, columns][np.isfinite(depth[rows, columns])]
            return Case(
                scene, zone, tuple(np.unique(met).tolist()), 0.0, False, f"examples: {name}, {zone}", "examples"
            )
    raise ValueError(f"{name}: no zone without glass")


def _is_plain(item: Any) -> bool:
    kind = getattr(getattr(item, "material", None), "kind", "matte")
    return kind not in ("mirror", "dielectric", "thin_glass", "conductor")


KINDS: dict[str, Callable[[int], Case]] = {
    "textured": textured_case,
    "blank": blank_case,
    "lamps beside": lamps_case,
    "distant lamps": distant_lamps_case,
    "behind glass": glass_case,
    "in a mirror": mirror_case,
    "contrast 12 %": faint_case,
    "contrast 3 %": fainter_case,
    "two depths": edge_case,
    "phone lens": phone_case,
    "examples": example_case,
}


def case_of(number: int) -> Case:
    """Return one of the 500."""
    return list(KINDS.values())[number % len(KINDS)](number // len(KINDS))


def outcome(case: Case, method: str, session: Session, electrons: float | None = None) -> dict[str, Any]:
    """Return how a method ends in a case; with the noise of a sensor of so many electrons for white, if given."""
    scene = case.scene
    if electrons is not None:
        scene = set_keys(scene, {"sensor": {**SENSOR, "full_well_e": electrons}})
    begun, used = time.perf_counter(), time.process_time()
    probe = ProbeRenderer(scene, session, sensor=electrons is not None)
    if case.start:
        low, high = (probe.drive.coordinate(limit) for limit in probe.drive.limits)
        far, near = (low, high) if probe.drive.nearer > 0 else (high, low)
        probe.state = probe.drive.state_at(far + case.start * (near - far))
    found: dict[str, Any] = {
        "case": case.words, "kind": case.kind, "method": method, "blank": case.blank, "reason": "", "failure": "",
        "remarks": [], "miss": math.nan, "confidence": math.nan,
    }  # fmt: skip
    report = None
    try:
        report = focus_of(Task(probe, (case.zone,), Policy.CLOSEST, 1), method)
        found["probes"] = len(report.probes)
    except InputError as problem:
        found["reason"] = str(problem)
    seconds, cpu = time.perf_counter() - begun, time.process_time() - used
    if report is not None:
        found |= {"failure": report.failure or "", "remarks": list(report.remarks), "confidence": report.confidence}
        found["from_spot"] = miss_of(probe, case, report, by_details=False)
        found["miss"] = miss_of(probe, case, report, by_details=method in BY_DETAILS)
    samples = probe.samples
    good = found["miss"] <= SHARP or (case.blank and bool(found["reason"]))
    silent = not found["reason"] and not found["failure"] and not found["miss"] <= SHARP
    return found | {"seconds": seconds, "cpu_seconds": cpu, "samples": samples, "good": good, "silent": silent}


def miss_of(probe: ProbeRenderer, case: Case, report: FocusReport, *, by_details: bool) -> float:
    """Return how far a state lies from the nearest that is right where the zone was looked at [depths of focus]."""
    drive, zone = probe.drive, Zone(*report.notes.get("part", astuple(case.zone)))
    far = 0.0 if report.focus_distance_m is None else 1 / report.focus_distance_m
    place, misses = drive.coordinate(report.state), [math.inf]
    for distance in sorted(case.distances_m, key=lambda one: abs(1 / one - far))[:2]:
        try:
            best = drive.state_for(distance, zone)
        except InputError:
            continue
        right = [drive.coordinate(best)]
        if by_details:
            view = half_view(probe, best, zone, "x")
            clear = [view.clearest(cycles) for cycles in DETAILS]
            shifts = [(each - view.sharpest()) / drive.sharp_vergence(best) * drive.depth_of_focus for each in clear]
            right += [right[0] - drive.nearer * shift for shift in shifts]
        misses.append(max(min(right) - place, place - max(right), 0.0) / drive.depth_of_focus)
    return min(misses)


def wilson(good: int, count: int, z: float = 1.96) -> tuple[float, float]:
    """Return the interval of a success rate that 95 % of such experiments hold (Wilson 1927)."""
    if count == 0:
        return 0.0, 1.0
    share, more = good / count, z * z / count
    middle, half = share + more / 2, z * math.sqrt(share * (1 - share) / count + more / (4 * count))
    return (middle - half) / (1 + more), (middle + half) / (1 + more)


def table_of(found: list[dict[str, Any]], methods: Sequence[str]) -> list[list[str]]:
    """Return a row for each kind and method."""
    rows = []
    for kind in dict.fromkeys(row["kind"] for row in found):
        for method in methods:
            own = [row for row in found if (row["kind"], row["method"]) == (kind, method)]
            misses = np.array([row["miss"] for row in own])
            refused = sum(bool(row["reason"]) for row in own)
            doubted = sum(bool(row["failure"]) and not row["miss"] <= SHARP for row in own)
            counts = [
                np.sum(misses <= SHARP),
                np.sum(misses <= FINE),
                refused,
                doubted,
                sum(row["silent"] for row in own),
            ]
            cpu = [row["cpu_seconds"] for row in own]
            costs = [f"{np.median(cpu):.2f}", f"{max(cpu):.2f}"]
            rows.append([kind, method, str(len(own)), *(str(int(count)) for count in counts), *costs])
    return rows


def main() -> None:
    """Run the cases and print the tables."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--cases", type=int, default=CASES, help="how many of the 500, from the first on")
    parser.add_argument("--kinds", help="only these, with commas between them")
    parser.add_argument("--methods", default=",".join(METHODS), help="several with commas between them")
    parser.add_argument(
        "--electrons", type=float, metavar="N", help="probe as a sensor of 4.4 µm whose pixels are white at N electrons"
    )
    parser.add_argument("--resume", action="store_true", help="keep what the file of --json holds, and go on")
    given = parser.parse_args()
    if given.resume and given.json is None:
        parser.error("--resume: give the file to go on with (--json FILE)")
    methods = given.methods.split(",")
    session = Session(choose_device(given.device))
    begun_on = machine(session.info)
    print_machine(begun_on)
    found: list[dict[str, Any]] = []
    if given.resume and given.json.exists():
        found = json.loads(given.json.read_text(encoding="utf-8"))["results"]
    known = {(row["number"], row["method"]) for row in found}
    for number in range(2 if given.quick else given.cases):
        if given.kinds and list(KINDS)[number % len(KINDS)] not in given.kinds.split(","):
            continue
        left = [method for method in methods if (number, method) not in known]
        if not left:
            continue
        case = case_of(number)
        for method in left:
            row = outcome(case, method, session, given.electrons) | {"number": number}
            found.append(row)
            if row["silent"] or not row["good"]:
                end = row["reason"] or f"{row['miss']:.2f} depths of focus off, {row['failure'] or 'IN SILENCE'}"
                print(f"{number} {method}: {row['case']}: {end}", flush=True)
        write_json(given.json, begun_on, found)  # what is measured stays when it is ended
    columns = [
        "kind",
        "method",
        "targets",
        "<= 1/2",
        "<= 1/8",
        "refused",
        "doubted",
        "silent errors",
        "CPU s",
        "at most",
    ]
    print_table("Success by kind and method; <= 1/2 and 1/8 depth of focus", columns, table_of(found, methods))
    for method in methods:
        rows = [row for row in found if row["method"] == method and not row["blank"]]
        good = sum(row["good"] for row in rows)
        low, high = wilson(good, len(rows))
        print(f"{method}: {good} of {len(rows)} in focus, {low:.1%} to {high:.1%} by 95 % of such experiments")


if __name__ == "__main__":
    main()
