"""Numbers of the rptcam paper that show on the film, beside those of our renders."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from examples.figures.blur import card_blur, thin_lens_blurs
from examples.figures.figure import ROOT
from examples.figures.numbers import Numbers, Row
from examples.figures.paper_lens_numbers import blur_on_film, paper_singlet
from rptcam_cl.api.job import render
from rptcam_cl.imaging.development import srgb_from_linear
from rptcam_cl.optics.charts import add_key, new_figure, series, styled
from rptcam_cl.optics.lens import film_distance
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.focus.controller import autofocus

# Figure 1: lamps by colour; the green one is in focus.
LAMPS = {"pink": (0.5, 4, 1), "orange": (3.15, -0.7, 1.5), "blue": (-1.7, -0.2, 1.1), "white": (1.2, 0.4, 0.5)}
# Figure 2: stop diameter against the blur [pixels of 800] of what is at z = -4, 1, 2 and 3; the film is at z = 7.
HEIGHTS = (-4, 1, 2, 3)
STOPS = {
    0.02: ("0.25", "1.7", "3.1", "7.7"),
    0.05: ("0.63", "4.4", "7.6", "19.3"),
    0.07: ("0.88", "6.1", "10.7", "27"),
}
STOPS_FILM = 3.21918
# Figure 5: distance in focus against the blur of the spheres [pixels of 800] at these distances from the film.
SPHERES = (15, 20, 25, 30)
FOCUSED = {
    15: ("0", "31.9", "49.2", "60.0"),
    20: ("28.5", "0", "15.6", "25.4"),
    25: ("41.7", "14.8", "0", "9.4"),
    30: ("49.5", "23.5", "9.1", "0"),
}
# Figure 8: distances at which the variance of the whole picture is looked at.
LOOKS = (15, 16, 18, 20, 22.5, 25, 27.5, 30, 35)
STEPS = (*range(12, 20), *range(20, 30, 2), *range(30, 51, 4))  # of a climb
STARTS = (15, 50)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def blurs_of_lamps() -> Numbers:
    """Compare the blur of the lamps of figure 1 with that of a thin lens: aperture x (distance - focus) / distance."""
    scene = load_scene(ROOT / "examples" / "paper" / "figure_1.yaml")
    camera: Any = scene.camera
    eye = np.array(camera.eye)
    ahead = (np.array(camera.target) - eye) / np.linalg.norm(np.array(camera.target) - eye)
    rows = []
    for name, centre in LAMPS.items():
        distance = float((np.array(centre) - eye) @ ahead)
        formula, ours = thin_lens_blurs(camera, distance)
        rows.append(Row((name, f"{distance:.2f}"), (f"{formula:.2f}",), (ours,)))
    return Numbers(("lamp", "distance"), ("blur [px of 800]",), rows, False, "thin lens", noise=0.01)


def blurs_of_stops() -> Numbers:
    """Compare the blur on the axis for three stops (figure 2)."""
    rows = []
    for diameter, expected in STOPS.items():
        lens = paper_singlet(diameter=diameter)
        ours = [100 * blur_on_film(lens, STOPS_FILM, 7 - z) for z in HEIGHTS]
        rows.append(Row((f"{diameter}",), expected, ours, more=0.11))
    return Numbers(
        ("stop diameter",),
        [f"z = {z}" for z in HEIGHTS],
        rows,
        document="formula, blur [px of 800]",
        reason="The formula takes the lens as thin: 0.7 % less blur.",
    )


def blurs_of_distances() -> Numbers:
    """Compare the blur on the axis for four distances in focus (figure 5), to first order and as rendered."""
    rows = []
    lens = paper_singlet()
    for focus, expected in FOCUSED.items():
        film = film_distance(lens, focus)
        first = [1000 * blur_on_film(lens, film, distance) for distance in SPHERES]
        seen = [blur_in_picture(focus, distance) for distance in SPHERES]
        rows.append(Row((f"{focus}",), expected, first, ".1f", more=0.1, name="our lens"))
        rows.append(Row((f"{focus}",), expected, seen, ".1f", more=2.7, name="our film"))
    return Numbers(
        ("in focus",),
        [f"object at {distance}" for distance in SPHERES],
        rows,
        document="formula, blur [px of 800]",
        reason="On the film spherical aberration adds to the blur of what is behind the focus and takes"
        " from that of what is before it, and leaves 2 pixels in it. Our lens near the axis is within 0.1 of the"
        " formula, which takes it as thin.",
        noise=0.01,
    )


def blur_in_picture(focus: float, distance: float) -> float:
    """Return the blur [pixels of 800] of a card at a distance from the film: of the beams that the camera traces."""
    surfaces = [
        {"radius": 4, "thickness": 0.01, "glass": {"index": 1.8}, "diameter": 0.4, "stop": True},
        {"radius": -4, "diameter": 0.4},
    ]
    camera = {"kind": "realistic", "lens": {"name": "single lens", "surfaces": surfaces}}
    return card_blur(camera | {"focus": {"distance_m": focus / 1000}}, distance, {"width_mm": 0.8}, 0.001)


def found_by_autofocus() -> Numbers:
    """Compare where autofocus finds the sphere at 25 units of figure 8, and where the picture's variance peaks."""
    rows = []
    for method in ("contrast", "depth"):
        report = autofocus(ROOT / "examples" / "paper" / "autofocus.yaml", method)
        assert report.focus_distance_m is not None
        rows.append(Row((f"sphere at 25, by `{method}`",), ("25",), (1000 * report.focus_distance_m,)))
    values = variances(LOOKS)
    best = LOOKS[int(np.argmax(values))]
    rows.append(
        Row(("greatest variance of the whole picture",), ("27.5",), (float(best),), ".1f", 2.5 / 27.5, more=8.0)
    )
    lost = 100 * (1 - values[LOOKS.index(25)] / values.max())
    return Numbers(
        ("in focus, from the film",),
        ("",),
        rows,
        below=False,
        document="paper's renderer",
        reason=f"The variance has no clear top: at 25 it is {lost:.1f} % below the greatest here, and 0.04 %"
        " in the paper's renderer, with other materials.",
        noise=0.02,
    )


@styled()
def climbs() -> Any:
    """Return the chart of two climbs of the variance of the whole picture, each from step to step while it grows."""
    values = 100 * variances(STEPS) / variances(STEPS).max()
    figure = new_figure("Variance of the whole picture, from two starts, each step the greater neighbour", (9.0, 4.2))
    axes = figure.add_subplot()
    axes.axvline(25, color="gray", linewidth=0.8, linestyle="--")
    axes.annotate("the paper's end: 25", (25.3, values.min()), color="gray")
    (curve,) = axes.plot(STEPS, values, color="gray", linewidth=0.8, label="variance")
    curves = [curve]
    for number, start in enumerate(STARTS):
        steps = climb(values, STEPS.index(start))
        end = f"{STEPS[steps[-1]]:g}"
        (path,) = axes.plot([STEPS[step] for step in steps], values[steps], "o-", color=series(number), markersize=5)
        path.set_label(f"from {start} to {end} units")
        curves.append(path)
    axes.set(xlabel="in focus, from the film [units]", ylabel="of the greatest [%]")
    add_key(figure, curves)
    return figure


def climb(values: NDArray[np.floating], start: int) -> list[int]:
    """Return the steps from one value to the greater of its neighbours, up to one that has none."""
    steps = [start]
    while True:
        near = [step for step in (steps[-1] - 1, steps[-1] + 1) if 0 <= step < len(values)]
        best = max(near, key=lambda step: values[step])
        if values[best] <= values[steps[-1]]:
            return steps
        steps.append(best)


@cache
def variances(distances: tuple[float, ...]) -> Any:
    """Return the variance of the whole picture's encoded luminance, the measure of the paper, at some distances."""
    scene = load_scene(ROOT / "examples" / "paper" / "autofocus.yaml")
    found = []
    for distance in distances:
        there = change_scene(scene, camera={"focus": {"distance_m": distance * 1e-3}})
        shown = srgb_from_linear(np.asarray(render(there, spp=128, size=(200, 150))) * 2**1.5)
        found.append(float(np.var(np.round(255 * shown) / 255 @ LUMINANCE)))
    return np.array(found)
