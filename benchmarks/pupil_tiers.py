"""Noise of every way to sample the exit pupil: the four assignment lenses before a white world.

    python -m benchmarks.pupil_tiers [--spp 64] [--json FILE]

All tiers have the same mean; this measures the share of rays that pass and the variance of one sample, summed over the
film and in units of the squared mean, and from it how many samples a tier needs for the noise of ``tight``. A white
world adds no noise of its own, and samples are independent. Where the radiance along the rays has the relative variance
s2, independent of the weights, that of a sample is (1 + v) (1 + s2) - 1; the last column is for s2 = 1.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import rptcam_cl
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.device.devices import choose_device

TIERS = ("rear", "thick", "bounds", "tight")
# last vertex to film and width of the film [mm]; the film is 3 : 2
LENSES = {
    "dgauss-50mm": (36.77, 36.0),
    "wide-22mm": (14.54, 36.0),
    "fisheye-10mm": (23.192, 20.0),
    "telephoto-250mm": (123.7439, 36.0),
}
RESOLUTION = (48, 32)
PICTURES = 8  # with independent seeds: 7 degrees of freedom for the variance of each of 1536 pixels
GOAL = ("wide-22mm", "rear", 6.0)
COLUMNS = (
    "lens",
    "tier",
    "rays that pass",
    "relative variance",
    "samples for the noise of tight",
    "in a scene with s2 = 1",
)
SCENE_VARIANCE = 1.0


def white_world(lens: str, tier: str) -> dict[str, Any]:
    """Return the scene: nothing but radiance 1 all round."""
    back, width = LENSES[lens]
    return {
        "film": {"resolution": list(RESOLUTION), "width_mm": width},
        "camera": {
            "kind": "realistic",
            "lens": lens,
            "focus": {"film_distance_mm": back},
            "pupil": tier,
            "eye": [0, 0, 0],
            "target": [0, 0, -1],
            "up": [0, 1, 0],
        },
        "render": {"max_depth": 1, "roulette_depth": 0, "sampler": "independent"},
        "objects": [],
        "environment": {"kind": "constant", "radiance": 1},
    }


def measure(lens: str, tier: str, spp: int, device: str | None) -> dict[str, float]:
    """Return the share of rays that pass and the relative variance of one sample."""
    scene = white_world(lens, tier)
    images = [rptcam_cl.render(scene, spp=spp, seed=seed, device=device) for seed in range(PICTURES)]
    films = np.stack([np.asarray(image)[..., 0].astype(np.float64) for image in images])
    outcomes = [image.stats["lens"] for image in images]
    passed = sum(found["passed"] for found in outcomes) / sum(sum(found.values()) for found in outcomes)
    variance = spp * films.var(axis=0, ddof=1).sum() / np.square(films.mean(axis=0)).sum()
    return {"passed": passed, "relative_variance": float(variance)}


def samples_needed(tier: dict[str, float], tight: dict[str, float], scene_variance: float) -> float:
    """Return how many times the samples of ``tight`` a tier needs for the same noise."""
    rival, best = ((1 + x["relative_variance"]) * (1 + scene_variance) - 1 for x in (tier, tight))
    return rival / best


def main() -> None:
    """Measure every lens and tier and print the table."""
    parser = arguments("Pass rate and variance of every way to sample the exit pupil.")
    parser.add_argument("--spp", type=int, default=64, help="samples per pixel of each picture (default 64)")
    options = parser.parse_args()
    spp = 4 if options.quick else options.spp
    facts = machine(choose_device(options.device))
    results = {lens: {tier: measure(lens, tier, spp, options.device) for tier in TIERS} for lens in LENSES}
    lines = []
    for lens, found in results.items():
        for tier, numbers in found.items():
            numbers["samples"] = samples_needed(numbers, found["tight"], 0.0)
            numbers["samples_in_a_scene"] = samples_needed(numbers, found["tight"], SCENE_VARIANCE)
            share, variance = f"{100 * numbers['passed']:.1f} %", f"{numbers['relative_variance']:.3f}"
            lines.append(
                [lens, tier, share, variance, f"{numbers['samples']:.2f}", f"{numbers['samples_in_a_scene']:.2f}"]
            )
    print_machine(facts)
    print_table(f"A white world, {spp} spp, {PICTURES} pictures", COLUMNS, lines)
    lens, tier, goal = GOAL
    reached = results[lens][tier]["samples_in_a_scene"]
    print(f"{tier} needs {reached:.1f} times the samples of tight on {lens}, s2 = 1 (goal: at least {goal:g}).")
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
