"""How a thin lens sends light of three distances to the film, and the circle of confusion over the distance."""

from __future__ import annotations

from typing import Any

import numpy as np

from examples.figures.blur import confusion, thin_lens_blurs
from examples.figures.figure import shared
from rptcam_cl.optics.charts import add_key, new_figure, series, styled

DISTANCES = (2.0, 3.0, 4.0)  # of the balls [m]; the middle one is in focus
FOCAL_M = 0.75  # of the drawing alone: the blur in the scene does not depend on it
RADII = ("thin_lens_aperture_005", "thin_lens_focus_3", "thin_lens_aperture_02")
OVER_M = np.linspace(1.2, 8.0, 200)
MEASURED_M = (1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.5)


def image_distance(distance_m: float) -> float:
    """Return where a thin lens of the drawing images a point [m behind the lens]."""
    return 1 / (1 / FOCAL_M - 1 / distance_m)


@styled()
def thin_lens_rays() -> Any:
    """Return the diagram of rays: a point in focus, one before and one behind it, and their disks on the film."""
    figure = new_figure("A thin lens focused at 3 m: light of 2, 3 and 4 m on its way to the film", (9.0, 3.6))
    axes = figure.add_subplot()
    radius, film = 0.2, image_distance(DISTANCES[1])
    curves = []
    for number, distance in enumerate(DISTANCES):
        image = image_distance(distance)
        for height in (-radius, 0.0, radius):
            on_film = height * (1 - film / image)
            (curve,) = axes.plot([-distance, 0, film], [0, height, on_film], color=series(number), linewidth=1)
        curve.set_label(f"{distance:g} m")
        axes.plot([-distance], [0], "o", color=series(number), markersize=5)
        curves.append(curve)
    axes.plot([0, 0], [-1.2 * radius, 1.2 * radius], color="black", linewidth=3)
    axes.plot([film, film], [-1.2 * radius, 1.2 * radius], color="gray", linewidth=3)
    axes.annotate("lens", (0, 1.25 * radius), ha="center")
    axes.annotate("film", (film, 1.25 * radius), ha="center")
    axes.set(xlabel="along the axis [m]", ylabel="height [m]", ylim=(-0.3, 0.3))
    add_key(figure, curves)
    return figure


@styled()
def confusion_graph() -> Any:
    """Return the circle of confusion over the distance: curves by formula, points by our camera's own rays."""
    figure = new_figure("Circle of confusion of a thin lens focused at 3 m; points: by our camera's rays", (9.0, 4.2))
    axes = figure.add_subplot()
    curves = []
    for number, name in enumerate(RADII):
        camera: Any = shared(name, "").load().camera
        (curve,) = axes.plot(OVER_M, confusion(camera, OVER_M), color=series(number))
        curve.set_label(f"radius {camera.aperture_radius_m:g} m")
        ours = [thin_lens_blurs(camera, distance)[1] for distance in MEASURED_M]
        axes.plot(MEASURED_M, ours, "o", color=series(number), markersize=5)
        curves.append(curve)
    axes.set(xlabel="distance [m]", ylabel="diameter [pixels of 800]", xlim=(1, 8), ylim=(0, None))
    add_key(figure, curves)
    return figure
