"""Tables of the exit pupil for every lens of the library: how long they take to make, and the share of rays that pass.

    python -m benchmarks.pupil_tables [--json FILE]

The film is a disk as large as the image circle, or one focal length in radius, whichever is less; each lens is focused
at infinity. Time is that of the processor, the least of two, with nothing remembered; then the time of asking again.
The share is of 8000 rays from all over that disk, traced in float64.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import PupilKind
from rptcam_cl.core.remember import forget
from rptcam_cl.device.devices import choose_device
from rptcam_cl.optics.film_probe import FilmProbe
from rptcam_cl.optics.irradiance import image_circle
from rptcam_cl.optics.lens import Lens, film_distance
from rptcam_cl.optics.library import list_lenses, load_lens
from rptcam_cl.optics.pupils import DIRECTIONS
from rptcam_cl.rendering.cameras.pupil import (
    KEPT,
    PupilCircle,
    PupilGrid,
    PupilSampling,
    outline_radii,
    outlines_around,
    pupil_sampling,
)

Array = NDArray[np.float64]
TIERS = ("rear", "thick", "bounds", "tight")
RAYS = 8000
GOAL_S, GOAL_SHARE = 0.5, 0.9
COLUMNS = ("lens", "surfaces", "tight, s", "again, ms", *(f"{tier}, %" for tier in TIERS), "goals met")


def film_of(name: str) -> tuple[Lens, float, float]:
    """Return a lens, its distance to the film and the radius of the film [mm]."""
    lens = load_lens(name)
    length = abs(lens.first_order().focal_length_mm)
    try:
        back = film_distance(lens, np.inf)
    except InputError:
        back = length
    return lens, back, min(image_circle(lens, back), length)


def share_that_passes(lens: Lens, film_distance_mm: float, radius_mm: float, sampling: PupilSampling) -> float:
    """Return the share of rays that pass of those that a table aims from all over a disk of film."""
    random = np.random.default_rng(1)
    turn, out = 2 * np.pi * random.random(RAYS), radius_mm * np.sqrt(random.random(RAYS))
    film = np.stack([out * np.cos(turn), out * np.sin(turn)], axis=1)
    points, aimed = aims(sampling, film, radius_mm, random)
    return float(FilmProbe(lens, film_distance_mm, LINE_D_NM).passes(film[aimed], points[aimed]).mean())


def aims(
    sampling: PupilSampling, film: Array, radius_mm: float, random: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """Return points of the plane of the last vertex as `kernels/lens/pupil.h` draws them, and which are drawn."""
    u, v = random.random((2, len(film)))
    turns = np.stack([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u)], axis=1)
    ring = turns * np.sqrt(v)[:, None]
    if isinstance(sampling.parameters, PupilCircle):
        a, b = sampling.parameters
        return a * film + b * ring, np.ones(len(film), dtype=bool)
    if sampling.kind == PupilKind.BOXES:
        assert isinstance(sampling.parameters, PupilGrid)
        _, _, c, d = sampling.parameters
        columns, rows = (
            np.clip(((film[:, k] / radius_mm + 1) / 2 * n).astype(int), 0, int(n) - 1) for k, n in ((0, c), (1, d))
        )
        box = sampling.table.reshape(int(d), int(c), 4)[rows, columns]
        return box[:, :2] + np.stack([u, v], axis=1) * box[:, 2:], box[:, 2] > 0
    return _outline_aims(sampling, film, u, v, turns)


def _outline_aims(
    sampling: PupilSampling, film: Array, u: Array, v: Array, turns: Array
) -> tuple[Array, NDArray[np.bool_]]:
    nodes, start, corners, turn = outlines_around(sampling, on_radius(film) if sampling.radial else film)
    frames = sampling.table[: 4 * nodes].reshape(-1, 4)
    radii = outline_radii(sampling, nodes, start)
    if sampling.ring:
        u = _at_share(radii[2], corners, u)
        turns = np.stack([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u)], axis=1)
    frame = sum((share[:, None] * frames[node] for node, share in corners), np.zeros((len(film), 4)))
    reach, hole = np.zeros((2, len(film)))
    for found, table in zip((reach, hole), radii, strict=False):
        found += _at_share(np.concatenate([table, table[:, :1]], axis=1), corners, u)
    aim = frame[:, :2] + frame[:, 2:] * turns * np.sqrt(hole**2 + v * (reach**2 - hole**2))[:, None]
    if sampling.radial:
        turn = film / np.maximum(np.hypot(*film.T), 1e-300)[:, None]
    c, s = turn.T
    points = np.stack([c * aim[:, 0] - s * aim[:, 1], s * aim[:, 0] + c * aim[:, 1]], axis=1)
    lit = (frame[:, 2] > 0) & (reach > 0)
    if isinstance(sampling.parameters, PupilGrid):
        lit &= np.hypot(*film.T) * sampling.parameters.per_mm_across < sampling.parameters.across - 1
    return points, lit


def _at_share(table: Array, corners: list[tuple[NDArray[np.int64], Array]], u: Array) -> Array:
    """Return a table (nodes, DIRECTIONS + 1) at shares of a turn, between nodes."""
    place = np.minimum((u * DIRECTIONS).astype(int), DIRECTIONS - 1)
    between, found = u * DIRECTIONS - place, np.zeros(len(u))
    for node, share in corners:
        near, ahead = table[node, place], table[node, place + 1]
        found += share * (near + between * (ahead - near))
    return found


def on_radius(film: Array) -> Array:
    """Return film points turned to +x."""
    return np.stack([np.hypot(*film.T), np.zeros(len(film))], axis=1)


def measure(name: str) -> dict[str, float | None]:
    """Return the times of the tight table [s] and the share of rays that pass of every tier; None where it has none."""
    lens, back, radius = film_of(name)
    given = (lens, back, (radius, radius), LINE_D_NM)
    found: dict[str, float | None] = {"surfaces": len(lens.surfaces), "seconds": np.inf}
    for _ in range(2):
        forget(KEPT)
        began = time.process_time()
        pupil_sampling(*given, "tight")
        found["seconds"] = min(found["seconds"] or 0.0, time.process_time() - began)
    began = time.process_time()
    pupil_sampling(*given, "tight")
    found["again"] = time.process_time() - began
    for tier in TIERS:
        try:
            found[tier] = share_that_passes(lens, back, radius, pupil_sampling(*given, tier))  # type: ignore[arg-type]
        except InputError:
            found[tier] = None  # an exit pupil behind the film bounds no rays
    return found


def main() -> None:
    """Measure every lens and print the table."""
    parser = arguments("Time of pupil tables and share of rays that pass, for every lens of the library.")
    options = parser.parse_args()
    facts = machine(choose_device(options.device))
    results = {name: measure(name) for name in (list_lenses()[:3] if options.quick else list_lenses())}
    lines = []
    for name, found in results.items():
        shares = ["-" if found[tier] is None else f"{100 * (found[tier] or 0):.0f}" for tier in TIERS]
        met = (found["seconds"] or 0) <= GOAL_S and (found["tight"] or 0) >= GOAL_SHARE
        times = (f"{found['seconds']:.3f}", f"{1e3 * (found['again'] or 0):.2f}")
        lines.append([name, f"{found['surfaces']:.0f}", *times, *shares, "yes" if met else "no"])
    print_machine(facts)
    print_table("Pupil tables: at most 0.5 s, and at least 90 % of rays pass", COLUMNS, lines)
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
