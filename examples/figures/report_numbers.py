"""Numbers of the camera report after PBRT, chapter 6, beside ours."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from examples.figures.blur import thin_lens_blurs
from examples.figures.blur_graph import MEASURED_M, RADII
from examples.figures.figure import shared
from examples.figures.numbers import Numbers, Row
from examples.figures.paper_lens_numbers import blur_on_film
from examples.figures.shares import passing_share
from rptcam_cl.api.job import render
from rptcam_cl.rendering.traceable_lens import load_lens

BALLS = (2, 3, 4)  # distances [m]
BEFORE_MM = 300.0  # from a point to the middle of the biconcave lens
TRIES = 10  # of the report's renderer per film sample
# Lens, film distance, film radius [mm]: share of rays that pass, and what the report's renderer makes of it.
PASSING = {
    ("dgauss-50mm", 36.77, 0): (".926", "1.000"),
    ("dgauss-50mm", 36.77, 15): (".45", ".997"),
    ("dgauss-50mm", 36.77, 20): (".26", ".951"),
    ("dgauss-50mm", 36.77, 25): (".079", ".56"),
    ("wide-22mm", 14.54, 0): (".139", ".777"),
    ("wide-22mm", 14.54, 20): (".0585", ".45"),
}


def seen() -> Numbers:
    """Compare the fields of the pinhole's picture and of the environment's."""
    pinhole, around = _azimuths("pinhole"), _azimuths("environment")
    width = len(pinhole)
    across = np.polyfit(np.arange(width) + 0.5, np.tan(np.radians(pinhole)), 1)
    edges = np.degrees(np.arctan(np.polyval(across, [0, width])))
    turn = np.polyfit(np.arange(len(around)) + 0.5, np.unwrap(around, period=360), 1)[0] * len(around)
    size = shared("environment", "").size
    return Numbers(
        ("picture",),
        ("",),
        [
            Row(("pinhole: field across [degrees]",), ("90",), (float(edges[1] - edges[0]),)),
            Row(("environment: field across [degrees]",), ("360",), (float(turn),)),
            Row(("environment: width / height",), ("2",), (size[0] / size[1],)),
        ],
        below=False,
    )


def _azimuths(name: str) -> Any:
    """Return where the middle row of a picture of the room looks [degrees to the right of straight ahead]."""
    figure = shared(name, "")
    camera: Any = figure.load().camera
    x, _, z = camera.target
    level = [f"camera.target={[x, camera.eye[1], z]}", "film.crop=[0, 1, 0.5, 0.51]"]
    picture = render(replace(figure, changes=[*figure.changes, *level]).load(), spp=64, layers=["position"])
    away = np.asarray(picture["position"], float)[0] - np.array(camera.eye)
    return np.degrees(np.arctan2(away[:, 0], -away[:, 2]))


def blurs_of_balls() -> Numbers:
    """Compare the blur of the balls through the thin lenses of the report with that by formula."""
    names = [*(f"thin_lens_focus_{distance}" for distance in BALLS), "thin_lens_aperture_005", "thin_lens_aperture_02"]
    rows = []
    for name in names:
        camera: Any = shared(name, "").load().camera
        pairs = [thin_lens_blurs(camera, distance) for distance in BALLS]
        label = (f"{camera.focus_distance_m:g} m", f"{camera.aperture_radius_m:g} m")
        rows.append(Row(label, [f"{formula:.1f}" for formula, _ in pairs], [ours for _, ours in pairs], ".1f"))
    columns = [f"ball at {distance} m" for distance in BALLS]
    return Numbers(("in focus", "radius"), columns, rows, document="formula, blur [px of 800]", noise=0.01)


def focus_of_balls() -> Numbers:
    """Compare where the three thin lenses are sharp, by the blur of cards nearer and farther, with what was set.

    The blur is in proportion to |1 - f / d| for a card at d, so that two cards say where it ends.
    """
    rows = []
    for distance in BALLS:
        camera: Any = shared(f"thin_lens_focus_{distance}", "").load().camera
        near, far = (thin_lens_blurs(camera, share * distance)[1] for share in (0.8, 1.25))
        sharp = (near + far) / (near / (1.25 * distance) + far / (0.8 * distance))
        rows.append(Row((f"{distance} m",), (f"{distance}",), (sharp,), ".4f", error=1e-4))
    return Numbers(("focused at",), ("without blur [m]",), rows, below=False, document="set")


def confusion_points() -> Numbers:
    """Compare the points of the graph, which are our camera's, with its curves, which are the formula's."""
    rows = []
    for name in RADII:
        camera: Any = shared(name, "").load().camera
        pairs = [thin_lens_blurs(camera, distance) for distance in MEASURED_M]
        label = (f"{camera.aperture_radius_m:g} m",)
        rows.append(Row(label, [f"{formula:.2f}" for formula, _ in pairs], [ours for _, ours in pairs]))
    columns = [f"{distance:g} m" for distance in MEASURED_M]
    return Numbers(("radius, focused at 3 m",), columns, rows, document="formula, blur [px of 800]", noise=0.01)


def ball() -> Numbers:
    """Compare the focal length of the ball lens with the closed form."""
    ours = load_lens("ball").first_order().focal_length_mm
    rows = [Row(("R = 20 mm, n = 1.5: n R / (2 (n - 1))",), ("30.000",), (ours,), ".6f")]
    return Numbers(("ball",), ("focal length [mm]",), rows, below=False, document="formula")


def biconcave_disks() -> Numbers:
    """Compare the disk that the biconcave lens leaves of a point with that of a thin lens of its focal length."""
    rows = []
    for name in ("biconcave", "biconcave_small"):
        camera: Any = shared(name, "").load().camera
        lens, film = load_lens(camera.lens), camera.focus.film_distance_mm
        opening = lens.surfaces[0].semi_diameter * 2
        focal, to_film = lens.first_order().focal_length_mm, film + lens.length / 2
        thin = opening * (1 + to_film * (1 / BEFORE_MM - 1 / focal))
        ours = blur_on_film(lens, film, BEFORE_MM + to_film)
        rows.append(Row((f"{opening:g} mm",), (f"{thin:.2g}",), (ours,), ".2f"))
    labels = ("biconcave lens, open to",)
    return Numbers(labels, ("disk of a point 30 cm away [mm]",), rows, below=False, document="thin")


def retries() -> Numbers:
    """Compare what trying up to ten times per sample makes of the share p of rays that pass: 1 - (1 - p)^10."""
    rows = []
    for (lens, film, radius), expected in PASSING.items():
        share = passing_share(lens, film, film_radius_mm=radius)
        ours = (share, 1 - (1 - share) ** TRIES)
        rows.append(Row((f"`{lens}`", f"{radius}"), expected, ours, ".3f", error=0.012))
    labels = ("aimed at the whole rear disk, from", "film radius [mm]")
    return Numbers(labels, ("share that passes", "brightness by ten tries"), rows, below=False)
