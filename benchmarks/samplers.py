"""Noise of the samplers: relative variance per sample, what a sample costs, and the product of both.

    python -m benchmarks.samplers [--seeds 8] [--json FILE]

The variance is that of pictures with independent seeds, divided per pixel by the square of the mean (plus the square
of a hundredth of the picture's), averaged over the picture without its worst thousandth, and multiplied by the samples:
what one sample of independent numbers would have. At equal time the noise is the product with the time per sample.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.scenes import reference_scene, render_samples, wavefront_of
from benchmarks.stopwatch import timed
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

SAMPLERS = ("independent", "lattice")
GREY = {"kind": "matte", "reflectance": 0.7}
CHECKER = {"kind": "checker", "even": [0.8] * 3, "odd": [0.1] * 3, "scale": [4, 4]}
FLOOR = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}
POSE = {"fov_degrees": 40, "target": [0, 0, 0.3], "up": [0, 0, 1]}
BOKEH = {
    "camera": {**POSE, "kind": "thin_lens", "aperture_radius_m": 0.06, "focus_distance_m": 2.0, "eye": [0, -2, 1]},
    "objects": [
        {**FLOOR, "material": {"kind": "matte", "reflectance": CHECKER}},
        {"shape": "sphere", "center": [0.4, 1.5, 0.4], "radius": 0.4, "material": GREY},
        {"shape": "sphere", "center": [-0.5, 0.2, 0.3], "radius": 0.3, "material": GREY},
    ],
    "environment": {"kind": "gradient", "bottom": [0.2, 0.2, 0.2], "top": [1, 1, 1.4]},
}
LAMP = {"shape": "rectangle", "corner": [-0.5, -0.5, 3], "edge_u": [0, 1, 0], "edge_v": [1, 0, 0]}
SOFT = {
    "camera": {**POSE, "kind": "pinhole", "eye": [0, -4, 3]},
    "objects": [
        {**FLOOR, "material": GREY},
        {"shape": "sphere", "center": [0, 0, 0.6], "radius": 0.5, "material": GREY},
        {**LAMP, "material": {"kind": "emissive", "radiance": 10.0}},
    ],
    "render": {"max_depth": 3},
}


def scenes(shrink: int) -> dict[str, Scene]:
    """Return the scenes: the references with Russian roulette, a wide-open thin lens, a soft shadow."""
    found = {name: reference_scene(name, shrink=shrink, roulette=True) for name in ("A", "A_lens", "B")}
    film = {"film": {"resolution": [640 // shrink, 360 // shrink]}}
    return found | {"bokeh": load_scene(BOKEH | film), "soft shadow": load_scene(SOFT | film)}


def relative_variance(pictures: NDArray[np.float64]) -> float:
    """Return the mean relative variance of pictures of shape (seeds, height, width, 3), without its worst pixels."""
    mean = pictures.mean(axis=0)
    floor = (0.01 * mean.mean()) ** 2
    relative = np.sort((pictures.var(axis=0, ddof=1) / (mean**2 + floor)).mean(axis=-1), axis=None)
    return float(relative[: max(int(0.999 * relative.size), 1)].mean())


def measure(scene: Scene, session: Session, counts: list[int], seeds: int) -> dict[int, tuple[float, float]]:
    """Return relative variance per sample and device time per sample [ns], by samples per pixel."""
    wavefront = wavefront_of(scene, session)
    found = {}
    for spp in counts:
        pictures, seconds = [], 0.0
        for seed in range(seeds):
            wavefront.seed = seed
            wavefront.clear()
            seconds += timed(lambda spp=spp: render_samples(wavefront, spp)).cpu  # type: ignore[misc]
            pictures.append(wavefront.picture(spp).astype(float))
        samples = seeds * spp * wavefront.layout.samples_per_spp
        found[spp] = (spp * relative_variance(np.array(pictures)), seconds / samples * 1e9)
    return found


def main() -> None:
    """Measure every sampler on every scene and print the table."""
    parser = arguments("Noise of the samplers.")
    parser.add_argument("--seeds", type=int, default=8, help="pictures per measurement (default 8)")
    options = parser.parse_args()
    session = Session(choose_device(options.device))
    facts = machine(session.info)
    counts = [4, 16] if options.quick else [16, 64, 256, 1024]
    rows, results = [], []
    for name, scene in scenes(40 if options.quick else 5).items():
        plain: dict[int, tuple[float, float]] = {}
        for sampler in SAMPLERS:
            found = measure(change_scene(scene, render={"sampler": sampler}), session, counts, options.seeds)
            plain = plain or found
            results.append({"scene": name, "sampler": sampler, "by_spp": found})
            cells = [f"{v:.3f} ({plain[spp][0] / v:.2f}x)" for spp, (v, _) in found.items()]
            nanoseconds = min(ns for _, ns in found.values())
            gain = plain[counts[-1]][0] / found[counts[-1]][0] * min(ns for _, ns in plain.values()) / nanoseconds
            rows.append([name, sampler, *cells, f"{nanoseconds:.1f}", f"{gain:.2f}"])
    print_machine(facts)
    columns = ["scene", "sampler", *(f"{spp} spp" for spp in counts), "ns per sample", "gain at equal time"]
    print_table(
        "Relative variance per sample (and how many times less than that of independent samples)", columns, rows
    )
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
