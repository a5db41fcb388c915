"""The tiers of pupil sampling: no ray that passes lies outside, and few that are drawn fail to pass."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.records import PupilKind
from rptcam_cl.core.remember import forget
from rptcam_cl.optics.film_probe import UNMOVED, FilmFrame, FilmProbe
from rptcam_cl.optics.irradiance import image_circle
from rptcam_cl.optics.library import list_lenses, load_lens
from rptcam_cl.optics.pupils import DIRECTIONS
from rptcam_cl.optics.ray_trace import Status
from rptcam_cl.rendering.cameras.pupil import KEPT, _continue_values, pupil_sampling
from tests.device.probes import camera_rays
from tests.rendering.cameras.beams import ASSIGNMENT, back_distance, generator, scene_beam
from tests.support.cases import fast, slow
from tests.support.statistics import Z

TILTED = FilmFrame(centre=(4.0, 3.0), across=(np.cos(0.1), 0.0, np.sin(0.1)))
COUNT = 60_000
AT_A_POINT = 15  # rays that are tried from each point of the film: the box of a point takes longer than a ray
CONTAINED = {**ASSIGNMENT, "anamorphic-100mm": (80.0, 13.7)}
TIERS = [(name, tier) for name in CONTAINED for tier in ("rear", "thick", "bounds", "tight")]


def in_frame(vectors, film, back=False):
    """Turn vectors (n, 2) into the frame of each outline, in which u runs outwards from the axis, or back."""
    radius = np.hypot(*film.T)
    c, s = np.where(radius > 0, film.T / np.maximum(radius, 1e-300), [[1.0], [0.0]])
    u, v = vectors.T
    return np.stack([c * u - s * v, s * u + c * v] if back else [c * u + s * v, c * v - s * u], axis=1)


def along_line(radius, reach, sampling):
    """Place of a film point between the nodes of its line; they are denser towards the end of several lines."""
    share = np.minimum(radius / np.maximum(reach, 1e-300), 1.0)
    return share if sampling.radial else 1.0 - np.sqrt(1.0 - share)


def outlines_at(table, film, sampling):
    """Centre, half axes and radii (n, 4 + directions + 1) between nodes, and which film points any line reaches."""
    nodes, reaches = table
    if sampling.radial:
        line, between = np.zeros(len(film), int), np.zeros(len(film))
    else:
        x, y = film.T
        quarters = np.where(np.abs(x) + np.abs(y) > 0, y / np.maximum(np.abs(x) + np.abs(y), 1e-300), 0.0)
        place = np.where(x >= 0, quarters, 2 - quarters) % 4 * (len(reaches) - 1) / 4
        line = np.minimum(place.astype(int), len(reaches) - 2)
        between = place - line
    ahead = np.minimum(line + 1, len(reaches) - 1)
    reach = reaches[line] + between * (reaches[ahead] - reaches[line])
    radius = np.hypot(*film.T)
    place = along_line(radius, reach, sampling) * (nodes.shape[1] - 1)
    low = np.minimum(place.astype(int), nodes.shape[1] - 2)
    share = (place - low)[:, None]
    first, second = ((1 - share) * nodes[row, low] + share * nodes[row, low + 1] for row in (line, ahead))
    return first + between[:, None] * (second - first), radius <= reach


def reach_of(outline, turn):
    """Radius of outlines in a direction, in 64ths of a turn."""
    rows, at = np.arange(len(turn)), np.minimum(turn.astype(int), DIRECTIONS - 1)
    return outline[rows, 4 + at] + (turn - at) * (outline[rows, 5 + at] - outline[rows, 4 + at])


def share_of_outline(table, film, points, sampling):
    """How far out points lie in the outline that is interpolated between nodes, 1 on its edge."""
    outline, reached = outlines_at(table, film, sampling)
    away = in_frame(points, film) - outline[:, :2]
    u, v = (away / np.maximum(outline[:, 2:4], 1e-300)).T
    turn = np.arctan2(v, u) / (2 * np.pi) % 1 * DIRECTIONS
    return np.where(reached, np.hypot(u, v) / np.maximum(reach_of(outline, turn), 1e-300), np.inf)


def drawn(table, film, rng, sampling, *, in_hole=False):
    """Points that are drawn evenly from the outlines, and which film points see an open pupil at all.

    Those of obstructed lenses have a hole, and directions by its area; `in_hole` draws the rest of the outline.
    """
    outline, reached = outlines_at(table, film, sampling)
    turn, share = rng.random(len(film)), rng.random(len(film))
    if sampling.ring:
        nodes, reaches = table
        knots = outlines_at((of_hole(sampling, nodes, 1), reaches), film, sampling)[0]
        turn = reach_of(knots, turn * DIRECTIONS)
    reach, hole = reach_of(outline, turn * DIRECTIONS), np.zeros(len(film))
    if sampling.ring:
        hole = reach_of(outlines_at((of_hole(sampling, nodes), reaches), film, sampling)[0], turn * DIRECTIONS)
    rho = np.sqrt(share) * hole if in_hole else np.sqrt(hole**2 + share * (reach**2 - hole**2))
    ring = np.stack([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)], axis=1) * rho[:, None]
    points = outline[:, :2] + outline[:, 2:4] * ring
    return in_frame(points, film, back=True), reached & (outline[:, 2] > 0) & (rho > 0)


def nodes_of(sampling):
    """Centre, half axes and radii, the first repeated at the end, of every node in the table of a tight pupil, by
    line, and how far each line goes."""
    if sampling.radial:
        per_mm, _, columns, _ = sampling.parameters
        rows, reaches = 1, np.array([(columns - 1) / per_mm])
    else:
        _, columns, lines = sampling.parameters
        rows = int(lines) + 1
        reaches = sampling.table[-rows:].astype(np.float64)
    count = int(columns) * rows
    frames = sampling.table[: 4 * count].reshape(rows, int(columns), 4)
    start, size = 4 * (count + 1), 4 * count * DIRECTIONS
    radii = sampling.table[start : start + size].reshape(rows, int(columns), DIRECTIONS, 4)[..., 0]
    return np.concatenate([frames, radii, radii[..., :1]], axis=-1).astype(np.float64), reaches


def of_hole(sampling, nodes, following=0):
    """The same with the radii of the holes, from behind those of the outlines in the table, or with the directions up
    to which equal shares of the area lie, which follow."""
    count = nodes.shape[0] * nodes.shape[1]
    size = 4 * (count * DIRECTIONS + 1)
    start = 4 * (count + 1) + size * (1 + following)
    values = sampling.table[start : start + size - 4].reshape(*nodes.shape[:2], DIRECTIONS, 4)
    return np.concatenate([nodes[..., :4], values[..., 0], values[..., -1:, 1]], axis=-1).astype(np.float64)


def outside(sampling, half, film, points):
    """Which points (n, 2) of the plane of the last vertex a tier never aims at from film points (n, 2)."""
    if sampling.kind == PupilKind.CIRCLE:
        a, b = sampling.parameters
        return np.hypot(*(points - a * film).T) > b
    if sampling.kind == PupilKind.BOXES:
        _, _, c, d = sampling.parameters
        columns, rows = (
            np.clip(((film[:, k] / half + 1) / 2 * n).astype(int), 0, int(n) - 1) for k, n in ((0, c), (1, d))
        )
        box = sampling.table.reshape(int(d), int(c), 4)[rows, columns]
        return np.any((points < box[:, :2]) | (points > box[:, :2] + box[:, 2:]), axis=1)
    return share_of_outline(nodes_of(sampling), film, points, sampling) > 1


def passing_rays(lens, back, half):
    """Film points and points on the plane of the last vertex of rays that pass: tried evenly, and from the scene."""
    rng = generator("pupil", lens.name)
    probe = FilmProbe(lens, back, LINE_D_NM)
    spots = rng.uniform(-half, half, (COUNT // AT_A_POINT, 2))
    film, boxes = (np.repeat(rows, AT_A_POINT, axis=0) for rows in (spots, probe.windows(spots)))
    points = boxes[:, ::2] + rng.random((COUNT, 2)) * (boxes[:, 1::2] - boxes[:, ::2])
    passes = probe.passes(film, points)
    slope = 1.5 * half / abs(lens.first_order().focal_length_mm)
    arriving = lens.trace(*scene_beam(lens, rng, COUNT, slope), start="scene")
    origins, directions = arriving.origins[arriving.passed], arriving.directions[arriving.passed]
    rear, landed = (
        (origins + (z - origins[:, 2:]) / directions[:, 2:] * directions)[:, :2]
        for z in (lens.length, lens.length + back)
    )
    on_film = np.all(np.abs(landed) < half, axis=1)
    return np.concatenate([film[passes], landed[on_film]]), np.concatenate([points[passes], rear[on_film]])


def sampling_of(lens, back, half, tier):
    return pupil_sampling(lens, back, (half, half), LINE_D_NM, tier)


@cache
def passing(name):
    lens, (back, diagonal) = load_lens(name), CONTAINED[name]
    half = diagonal / np.sqrt(2)
    return lens, back, half, *passing_rays(lens, back, half)


QUICKLY = [("wide-22mm", "tight"), ("telephoto-250mm", "tight"), *TIERS[:4]]


@pytest.mark.parametrize(("name", "tier"), fast(QUICKLY, TIERS))
def test_no_ray_that_passes_lies_outside_its_pupil(name, tier):
    lens, back, half, film, points = passing(name)
    lost = outside(sampling_of(lens, back, half, tier), half, film, points)
    assert len(lost) > 2000
    assert lost.sum() == 0


STOPPED = [(name, tier) for name in CONTAINED for tier in ("thick", "bounds", "tight")]


@cache
def passing_stopped_down(name):
    lens, (back, diagonal) = load_lens(name), CONTAINED[name]
    stopped, half = lens.with_stop_diameter(lens.stop_diameter_for(22.0)), diagonal / np.sqrt(2)
    return stopped, back, half, *passing_rays(stopped, back, half)


@pytest.mark.parametrize(
    ("name", "tier"),
    [pytest.param(*case, marks=() if case[0] == "dgauss-50mm" else pytest.mark.slow) for case in STOPPED],
)
def test_no_ray_that_passes_at_f_22_lies_outside_its_pupil(name, tier):
    lens, back, half, film, points = passing_stopped_down(name)
    lost = outside(sampling_of(lens, back, half, tier), half, film, points)
    assert len(lost) > 80
    assert lost.sum() == 0


LIT = 0.998  # of the image circle: in what is left of it the pupil is a sliver, thinner than a table's nodes can tell


def film_of(name):
    """A lens, its distance to the film, and the radius of the film that it lights."""
    lens = load_lens(name)
    back = ASSIGNMENT[name][0] if name in ASSIGNMENT else back_distance(lens)
    lit = LIT * image_circle(lens, back)
    # a bare lens lights any film
    return lens, back, min(lit, abs(lens.first_order().focal_length_mm))


QUICK = {"fisheye-10mm"}


@pytest.mark.parametrize("name", [name if name in QUICK else slow(name) for name in list_lenses()])
def test_nine_of_ten_rays_pass(name):
    lens, back, radius = film_of(name)
    forget(KEPT)
    sampling = sampling_of(lens, back, radius, "auto")
    rng = generator("pass rate", name)
    turn, out = 2 * np.pi * rng.random(4000), radius * np.sqrt(rng.random(4000))
    film = np.stack([out * np.cos(turn), out * np.sin(turn)], axis=1)
    points, aimed = drawn(nodes_of(sampling), film, rng, sampling)
    passes = FilmProbe(lens, back, LINE_D_NM).passes(film, points)
    assert not passes[~aimed].any()
    assert passes[aimed].mean() >= 0.90


@pytest.mark.parametrize(
    ("f_number", "wavelength", "frame"),
    [
        (None, LINE_D_NM, UNMOVED), slow(8.0, (LINE_D_NM, 400.0, 700.0), UNMOVED), slow(9.5, LINE_D_NM, UNMOVED),
        slow(8.0, LINE_D_NM, TILTED),
    ],
)  # fmt: skip
def test_no_ray_passes_in_the_hole_of_a_ring_and_nine_of_ten_beside_it(f_number, wavelength, frame):
    lens = load_lens("mirror-500mm")
    back, half, rng = back_distance(lens), (18.0, 12.0), generator("ring", str(f_number))
    if f_number:
        lens = lens.with_stop_diameter(lens.stop_diameter_for(f_number))
    sampling = pupil_sampling(lens, back, half, wavelength, "auto", frame)
    film = frame.points(rng.uniform(-1, 1, (8000, 2)) * half)[:, :2]
    probe = FilmProbe(lens, back, wavelength, frame)
    assert sampling.ring
    blocked, in_hole = drawn(nodes_of(sampling), film, rng, sampling, in_hole=True)
    assert in_hole.mean() > 0.9
    assert not probe.passes(film, blocked).any()
    assert probe.passes(film, drawn(nodes_of(sampling), film, rng, sampling)[0]).mean() >= (
        0.87 if frame.is_moved else 0.90
    )


def test_a_lens_in_the_same_state_finds_its_table_again():
    lens, again = load_lens("dgauss-50mm"), load_lens("dgauss-50mm")
    first = pupil_sampling(lens, 37.0, (18.0, 12.0), LINE_D_NM, "tight")
    assert pupil_sampling(again, 37.0, (18.0, 12.0), LINE_D_NM, "tight") is first
    assert not first.table.flags.writeable


OTHER_STATES = {
    "focus": lambda lens: pupil_sampling(lens, 38.0, (18.0, 12.0), LINE_D_NM, "tight"),
    "film": lambda lens: pupil_sampling(lens, 37.0, (18.0, 15.0), LINE_D_NM, "tight"),
    "wavelength": lambda lens: pupil_sampling(lens, 37.0, (18.0, 12.0), 450.0, "tight"),
    "tier": lambda lens: pupil_sampling(lens, 37.0, (18.0, 12.0), LINE_D_NM, "bounds"),
    "stop": lambda lens: pupil_sampling(lens.with_stop_diameter(9.0), 37.0, (18.0, 12.0), LINE_D_NM, "tight"),
}


@pytest.mark.parametrize("change", OTHER_STATES)
def test_another_state_of_a_lens_has_a_table_of_its_own(change):
    lens = load_lens("achromat-100mm" if change == "wavelength" else "dgauss-50mm")
    lens = replace(lens, stop_index=lens.stop_index or 0)
    first = pupil_sampling(lens, 37.0, (18.0, 12.0), LINE_D_NM, "tight")
    other = OTHER_STATES[change](lens)
    assert other.table.shape != first.table.shape or np.any(other.table != first.table)


def circle_scene(name, back, radius, tier):
    """A film with the image circle inscribed, 48 pixels across."""
    camera = {"kind": "realistic", "lens": name, "focus": {"film_distance_mm": back}, "pupil": tier}
    return {
        "film": {"resolution": [48, 48], "size_mm": [2 * radius, 2 * radius]},
        "camera": camera | {"eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0]},
        "objects": [],
        "environment": {"kind": "constant", "radiance": 1},
    }


@pytest.mark.parametrize("name", fast(["wide-22mm"], ASSIGNMENT))
def test_nine_of_ten_rays_that_the_device_draws_pass(session, name):
    _, back, radius = film_of(name)
    rays = camera_rays(session, circle_scene(name, back, radius, "auto"), 4)
    inside = np.hypot(*(rays.pixel - 23.5).T) < 23
    assert (rays.status == Status.ok)[inside].mean() >= 0.90


@pytest.mark.parametrize("name", ["dgauss-50mm", *map(slow, ("telephoto-250mm", "anamorphic-100mm"))])
def test_the_device_draws_the_pupil_that_its_table_holds(session, name):
    # rays that are drawn a little inside of the outline would all pass, and the light at its edge be lost
    lens, back, radius = film_of(name)
    rays = camera_rays(session, circle_scene(name, back, radius, "tight"), 16)
    sampling = sampling_of(lens, back, radius, "tight")
    rng = generator("drawn", name)
    film = rng.uniform(-radius, radius, (len(rays.status), 2))
    points, _ = drawn(nodes_of(sampling), film, rng, sampling)
    wanted = FilmProbe(lens, back, LINE_D_NM).passes(film, points).mean()
    got = (rays.status == Status.ok).mean()
    assert abs(got - wanted) <= Z * np.sqrt(2 * wanted * (1 - wanted) / len(film))


def test_nodes_that_no_ray_reaches_continue_the_others() -> None:
    row, column = np.indices((7, 7))
    whole = np.stack([row - 2.0 * column, 3.0 * column + row], axis=2)
    some = np.where(((row < 4) & (column < 4))[..., None], whole, np.nan)
    np.testing.assert_allclose(_continue_values(some), whole, atol=1e-9)
    alone = np.full((5, 5, 1), np.nan)
    alone[2, 2] = 1.0  # no line leads on from one node
    np.testing.assert_array_equal(_continue_values(alone), alone)
