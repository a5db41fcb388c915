"""The curve that the autofocus of the rptcam paper climbs (its figure 8), beside that of contrast in a zone.

The scene of its figure 5 is photographed at many focus distances. The paper maximises the variance of the luminance of
the whole picture, from 8-bit values encoded for a screen; beside it stands the wavelet contrast of the zone on the
sphere at 25 units. Both are given as shares of their greatest, with the standard error over seeds.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import rptcam_cl
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.core.colour import LUMINANCE
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.imaging.development import srgb_from_linear
from rptcam_cl.optics.charts import add_key, encode, new_chart, series, styled
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.studies.focus.probe import BEST, MEASURES, Zone
from rptcam_cl.studies.focus.renderer import ProbeRenderer

SCENE = Path(__file__).parents[1] / "examples" / "paper" / "autofocus.yaml"
DISTANCES = [15, 16, 18, 20, 22.5, 24, 25, 26, 27.5, 30, 32.5, 35, 40, 45, 50, 55, 60]  # units: mm
Curve = NDArray[np.float64]


def variances(scene: rptcam_cl.Scene, session: Session, distances: list[float], spp: int, seeds: int) -> Curve:
    """Return the variance of the encoded luminance of the whole picture, (distances, seeds)."""
    found = []
    for distance in distances:
        there = change_scene(scene, camera={"focus": {"distance_m": distance * 1e-3}})
        pictures = [
            rptcam_cl.render(there, spp=spp, seed=seed, size=(200, 150), device=session) for seed in range(seeds)
        ]
        shown = [np.round(255 * srgb_from_linear(np.asarray(picture) * 2**1.5)) / 255 for picture in pictures]
        found.append([float(np.var(picture @ LUMINANCE)) for picture in shown])
    return np.array(found)


def contrasts(scene: rptcam_cl.Scene, session: Session, distances: list[float], seeds: int) -> Curve:
    """Return the wavelet contrast of the scene's zone, (distances, seeds)."""
    settings = scene.requested_autofocus
    assert settings is not None and settings.zones is not None
    zone, probe = Zone(*settings.zones[0]), ProbeRenderer(scene, session)
    states = [probe.drive.state_for(distance * 1e-3, zone) for distance in distances]
    return np.array(
        [
            [MEASURES[BEST].of(probe.measure(state, [zone], 128, seed)[0]).value for seed in range(seeds)]
            for state in states
        ]
    )


@styled()
def plotted(distances: list[float], curves: dict[str, Curve], path: Path) -> None:
    """Draw curves as shares of their greatest, with bars of two standard errors."""
    shares = {name: curve / curve.mean(axis=1).max() for name, curve in curves.items()}
    labels = ("focus distance [units of the paper]", "of the greatest [%]")
    figure, axes = new_chart("The scene of figures 5 and 8 of the paper", labels, (distances[0] - 2, distances[-1] + 2))
    bars = []
    for number, (name, share) in enumerate(shares.items()):
        mean, error = share.mean(axis=1), share.std(axis=1, ddof=1) / np.sqrt(share.shape[1])
        bars.append(axes.errorbar(distances, 100 * mean, yerr=200 * error, fmt=".-", color=series(number), label=name))
    axes.set_ylim(bottom=0.0)
    add_key(figure, bars)
    path.write_bytes(encode(figure, path))


def main() -> None:
    """Measure, print, draw and write."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--seeds", type=int, default=4, help="pictures per distance (default 4)")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the curves, .svg, .png or .pdf")
    options = parser.parse_args()
    session = Session(choose_device(options.device))
    facts = machine(session.info)
    scene = rptcam_cl.load_scene(SCENE)
    distances = [float(distance) for distance in ([20, 25, 30] if options.quick else DISTANCES)]
    spp = 4 if options.quick else 128
    curves = {
        "variance of the picture": variances(scene, session, distances, spp, options.seeds),
        "wavelet contrast of the zone": contrasts(scene, session, distances, options.seeds),
    }
    print_machine(facts)
    rows = []
    for k, distance in enumerate(distances):
        cells = [f"{distance:g}"]
        for curve in curves.values():
            error = curve[k].std(ddof=1) / np.sqrt(options.seeds)
            cells += [f"{curve[k].mean():.6f} ± {error:.6f}", f"{curve[k].mean() / curve.mean(axis=1).max():.4f}"]
        rows.append(cells)
    columns = ["distance", *(cell for name in curves for cell in (name, "share of the greatest"))]
    print_table(f"The scene of figures 5 and 8, {spp} samples per pixel", columns, rows)
    if options.plot is not None:
        plotted(distances, curves, options.plot)
    write_json(options.json, facts, {name: curve.tolist() for name, curve in curves.items()} | {"distances": distances})


if __name__ == "__main__":
    main()
