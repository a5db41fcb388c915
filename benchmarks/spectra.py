"""What wavelengths cost: time per sample, noise in brightness and in colour, at equal samples and at equal time.

    python -m benchmarks.spectra [--seeds 8] [--spp 64] [--json FILE]

Each scene is rendered as RGB light, as RGB light with a wavelength per path, and in spectra, in turns in one process;
the least of three times counts. Noise is the standard deviation of a pixel over pictures with independent seeds,
root mean square over the picture without its worst thousandth, as a share of the picture's mean luminance: of the
luminance, and of the colour (the differences of red and of blue to the luminance, together).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.scenes import REFERENCE, reference_scene, render_samples, wavefront_of
from benchmarks.stopwatch import timed
from rptcam_cl.core.colour import LUMINANCE
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

MODES = ("rgb", "dispersive", "spectral")
GLASS = {"kind": "dielectric", "glass": "SF11"}
LENS = {"spectral": {"lens": "on"}}  # however small its colour error
TURNS = 3
ROULETTE = {"roulette_depth": 3}

Array = NDArray[np.float64]


def scenes(shrink: int) -> dict[str, Scene]:
    """Return the scenes: the reference with spheres, by what of it refracts each wavelength separately."""
    plain, lens = (reference_scene(name, shrink=shrink, roulette=True) for name in ("A", "A_lens"))
    content = read_yaml(REFERENCE / "A.yaml").data
    content["objects"][-1]["material"] = GLASS
    glass = change_scene(load_scene(content), film={"resolution": plain.film.resolution}, render=ROULETTE)
    camera = {"lens": "double-gauss-50mm-f1.8", "focus": {"distance_m": 9.8}, "pupil": "tight"}
    return {
        "nothing disperses": plain,
        "a ball of SF11": glass,
        "a lens that disperses": change_scene(lens, camera=camera),
    }


def noise(pictures: Array) -> tuple[float, float]:
    """Return the noise of pictures (seeds, height, width, 3) in luminance and in colour, as shares of the luminance."""
    bright = pictures @ LUMINANCE
    colour = pictures[..., ::2] - bright[..., None]
    variances = bright.var(axis=0, ddof=1).ravel(), colour.var(axis=0, ddof=1).sum(axis=-1).ravel()
    kept = [np.sort(values)[: max(int(0.999 * values.size), 1)] for values in variances]
    luminance, chroma = (float(np.sqrt(values.mean()) / bright.mean()) for values in kept)
    return luminance, chroma


def measure(scene: Scene, session: Session, seeds: int, spp: int) -> dict[str, dict[str, Any]]:
    """Return for each mode the CPU time per sample [ns] and the noise at ``spp`` samples per pixel."""
    found: dict[str, dict[str, Any]] = {}
    asked = {mode: change_scene(scene, spectrum={"mode": mode} | LENS.get(mode, {})) for mode in MODES}
    waves = {mode: wavefront_of(asked[mode], session) for mode in MODES}
    nanoseconds: dict[str, list[float]] = {mode: [] for mode in MODES}
    for _ in range(TURNS):
        for mode, wavefront in waves.items():
            nanoseconds[mode].append(_cost(wavefront, spp))
    for mode, wavefront in waves.items():
        luminance, chroma = noise(np.array([_picture(wavefront, spp, seed) for seed in range(seeds)]))
        found[mode] = {
            "light": make_plan(asked[mode]).spectrum.kind.name.lower(),
            "ns_per_sample": min(nanoseconds[mode]),
            "luminance_noise": luminance,
            "colour_noise": chroma,
        }
    return found


def _cost(wavefront: Wavefront, spp: int) -> float:
    wavefront.clear()
    seconds = timed(lambda: render_samples(wavefront, spp)).cpu
    return seconds / (spp * wavefront.layout.samples_per_spp) * 1e9


def _picture(wavefront: Wavefront, spp: int, seed: int) -> Array:
    wavefront.seed = seed
    wavefront.clear()
    render_samples(wavefront, spp)
    return wavefront.picture(spp).astype(np.float64)


def rows_of(name: str, found: dict[str, dict[str, Any]]) -> list[list[str]]:
    """Return the rows of a table: noise at equal samples, then at the time that RGB takes."""
    rows = []
    for mode, of in found.items():
        slower = np.sqrt(of["ns_per_sample"] / found["rgb"]["ns_per_sample"])
        noises = [100 * of[f"{kind}_noise"] for kind in ("luminance", "colour")]
        shown = mode if mode == of["light"] else f"{mode} (compiled as {of['light']})"
        cells = [f"{value:.2f} %" for value in (*noises, *(slower * value for value in noises))]
        rows.append([name, shown, f"{of['ns_per_sample']:.1f}", *cells])
    return rows


def main() -> None:
    """Measure every mode on every scene and print the table."""
    parser = arguments("What wavelengths cost.")
    parser.add_argument("--seeds", type=int, default=8, help="pictures per measurement (default 8)")
    parser.add_argument("--spp", type=int, default=64, help="samples per pixel (default 64)")
    options = parser.parse_args()
    session = Session(choose_device(options.device))
    facts = machine(session.info)
    seeds, spp = (2, 4) if options.quick else (options.seeds, options.spp)
    results = {name: measure(scene, session, seeds, spp) for name, scene in scenes(40 if options.quick else 4).items()}
    print_machine(facts)
    columns = ["scene", "mode", "ns per sample", "luminance noise", "colour noise", "luminance at equal time",
               "colour at equal time"]  # fmt: skip
    title = f"Time per sample, and noise of a pixel at {spp} samples"
    print_table(title, columns, [row for name, found in results.items() for row in rows_of(name, found)])
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
