"""Measures of contrast compared: which one finds the focus best?

Targets of several textures stand at the focus of a 50 mm double Gauss. Every measure is taken of one zone from
32 depths of focus before the sharpest place to 32 behind it, as often as there are seeds. The tables tell, by measure:

monotonic   share of the steps that fall on the way out from the top, over both sides (1 is a curve of one hill)
half width  distance from the top at which half of it is left [depths of focus]
noise       standard error of the greatest value, relative
miss        root mean square distance, from the place of the least spot, of the top laid through three probes four
            depths of focus apart, over targets and seeds [depths of focus]
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import rptcam_cl
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.studies.focus.probe import LEAST_DETAIL, MEASURES, Estimate, Measure, Probe, Zone, energy, peak_of
from rptcam_cl.studies.focus.renderer import ProbeRenderer

ZONE = Zone(0.47, 0.53, 0.46, 0.54)
DISTANCE_M = 2.0
TRIPLES = (-2.5, 1.5, 5.5)  # not even about the focus, as no search knows where that is
SWEEP = sorted([0.0, *TRIPLES, *(sign * 2.0**k for k in range(6) for sign in (-1, 1))])
SAMPLES = (16, 256)  # per pixel
TEXTURES: dict[str, dict[str, Any]] = {
    "fine spots": {"kind": "noise", "low": 0, "high": 1, "scale": [150, 150], "octaves": 6, "contrast": 2},
    "coarse spots": {"kind": "noise", "low": 0, "high": 1, "scale": [30, 30], "octaves": 3, "contrast": 2},
    "faint spots": {"kind": "noise", "low": 0.4, "high": 0.6, "scale": [150, 150], "octaves": 6},
    "checks": {"kind": "checker", "even": 0.9, "odd": 0.1, "scale": [400, 400]},
    "an edge": {"kind": "checker", "even": 0.9, "odd": 0.1, "scale": [2, 2]},
}


Array = NDArray[np.float64]


def normalised_variance(parts: Array) -> list[Array]:
    """What differs from the mean."""
    return [parts - parts.mean(axis=(1, 2), keepdims=True)]


def tenengrad(parts: Array) -> list[Array]:
    """Sobel's gradient (Tenenbaum 1970, Krotkov 1987)."""
    across = parts[:, :, 2:] - parts[:, :, :-2]
    down = parts[:, 2:] - parts[:, :-2]
    return [
        across[:, :-2] + 2 * across[:, 1:-1] + across[:, 2:],
        down[:, :, :-2] + 2 * down[:, :, 1:-1] + down[:, :, 2:],
    ]


def brenner(parts: Array) -> list[Array]:
    """Differences two pixels apart (Brenner 1976), here both ways."""
    return [parts[:, :, 2:] - parts[:, :, :-2], parts[:, 2:] - parts[:, :-2]]


def energy_of_laplacian(parts: Array) -> list[Array]:
    """Energy of Laplacian (Subbarao 1993), by the nine-point operator."""
    inner = parts[:, 1:-1]
    sides = inner[:, :, :-2] + inner[:, :, 2:] + parts[:, :-2, 1:-1] + parts[:, 2:, 1:-1]
    corners = parts[:, :-2, :-2] + parts[:, :-2, 2:] + parts[:, 2:, :-2] + parts[:, 2:, 2:]
    return [(4 * sides + corners - 20 * inner[:, :, 1:-1]) / 6]


COMPARED = MEASURES | {
    each.__name__: Measure(energy(each), LEAST_DETAIL)
    for each in (normalised_variance, tenengrad, brenner, energy_of_laplacian)
}


def scene_of(texture: dict[str, Any]) -> rptcam_cl.Scene:
    """Return a wall of one texture before a double Gauss that is focused elsewhere."""
    wall = {
        "shape": "rectangle", "corner": [-2, -2, -DISTANCE_M], "edge_u": [4, 0, 0], "edge_v": [0, 4, 0],
        "material": {"kind": "matte", "reflectance": texture},
    }  # fmt: skip
    camera = {"kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 0, 0], "target": [0, 0, -1]}
    return rptcam_cl.load_scene(
        {
            "film": {"resolution": [640, 427], "size_mm": [36, 24]},
            "camera": camera | {"focus": {"distance_m": 10}},
            "render": {"max_depth": 2},
            "objects": [wall],
            "environment": {"kind": "constant", "radiance": 1},
        }
    )


def probes_of(probe: ProbeRenderer, steps: list[float], samples: int, seed: int) -> dict[str, list[Probe]]:
    """Return probes of places around the focus, in depths of focus, by every measure."""
    best, depth = probe.drive.state_for(DISTANCE_M, ZONE), probe.drive.depth_of_focus
    found: dict[str, list[Probe]] = {name: [] for name in COMPARED}
    for step in sorted(steps):
        state = best + step * depth
        [image] = probe.measure(state, [ZONE], samples, seed, reference=best)
        for name, measure in COMPARED.items():
            scale = probe.drive.image_scale(state, best)
            found[name].append(Probe(state, 1.0, best, scale, [measure.of(image)], 0, 0.0))
    return found


def monotonic(values: list[Estimate]) -> float:
    """Return the share of steps that fall on the way out from the top."""
    curve = np.array([value.value for value in values])
    top = int(curve.argmax())
    out = np.concatenate([np.diff(curve[top:]), np.diff(curve[top::-1])])
    return float(np.mean(out < 0))


def half_width(steps: list[float], values: list[Estimate]) -> float:
    """Return the distance from the top at which half is left, the mean of both sides [depths of focus]."""
    curve, places = np.array([value.value for value in values]), np.array(sorted(steps))
    top = int(curve.argmax())
    sides = []
    for side in (slice(top, None), slice(top, None, -1)):
        below = np.flatnonzero(curve[side] < curve[top] / 2)
        sides.append(abs(places[side][below[0]] - places[top]) if len(below) else np.inf)
    return float(np.mean(sides))


def compared(session: Session, name: str, samples: int, seeds: int, sweep: list[float]) -> dict[str, dict[str, Any]]:
    """Return the figures of every measure on one target."""
    probe = ProbeRenderer(scene_of(TEXTURES[name]), session)
    best, depth = probe.drive.state_for(DISTANCE_M, ZONE), probe.drive.depth_of_focus
    curves = [probes_of(probe, sweep, samples, seed) for seed in range(seeds)]
    found: dict[str, dict[str, Any]] = {}
    for measure in COMPARED:
        values = [[one.measures[0] for one in curve[measure]] for curve in curves]
        triples = [
            [one for one in curve[measure] if np.isclose((one.place - best) / depth, TRIPLES).any()] for curve in curves
        ]
        tops = np.array([value.value for row in values for value in row]).reshape(seeds, -1).max(axis=1)
        found[measure] = {
            "monotonic": float(np.mean([monotonic(row) for row in values])),
            "half_width": float(np.median([half_width(sweep, row) for row in values])),
            "noise": float(tops.std(ddof=1) / abs(tops.mean())),
            "argmax": [(peak_of(triple, 0).place - best) / depth for triple in triples],
        }
    return found


def root_mean_square(values: list[float]) -> float:
    """Return it."""
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    """Compare, print and write."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--seeds", type=int, default=6, help="probes of every place (default 6)")
    options = parser.parse_args()
    session = Session(choose_device(options.device))
    facts, results = machine(session.info), {}
    print_machine(facts)
    textures = list(TEXTURES)[:1] if options.quick else list(TEXTURES)
    for samples in SAMPLES[:1] if options.quick else SAMPLES:
        found = {
            name: compared(session, name, samples, 2 if options.quick else options.seeds, SWEEP) for name in textures
        }
        results[samples] = found
        rows = []
        for measure in COMPARED:
            own = [found[name][measure] for name in textures]
            missed = [root_mean_square(figures["argmax"]) for figures in own]
            rows.append(
                [
                    measure.replace("_", " "),
                    f"{np.mean([figures['monotonic'] for figures in own]):.2f}",
                    f"{np.median([figures['half_width'] for figures in own]):.1f}",
                    f"{np.median([figures['noise'] for figures in own]):.3f}",
                    *(f"{miss:.2f}" for miss in missed),
                    f"{root_mean_square(missed):.2f}",
                ]
            )
        columns = ["measure", "monotonic", "half width", "noise", *textures, "all targets"]
        print_table(f"{samples} samples per pixel; the last columns: root mean square miss of the top", columns, rows)
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
