"""Copies of lenses: as lenses and as arrays they are the same, and a copy without errors is the design."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import Session
from rptcam_cl.optics.as_built import Copies, Deviation, check_copies, film_points, first_met
from rptcam_cl.optics.beams import Beam, passing_beam
from rptcam_cl.optics.glass import Melt
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.tolerances import components, elements, limits, specification
from rptcam_cl.rendering.traceable_lens import CopiesTracer
from tests.support.cases import slow

SIZES = {
    "radius": 2e-3,
    "curvature": 1e-4,
    "thickness": 0.05,
    "index": 1e-3,
    "abbe": 8e-3,
    "decentre": 0.05,
    "tilt": 2e-3,
}


def copies_of(lens: Lens, count: int) -> Copies:
    """Copies with every kind of deviation, the first one without any."""
    last = len(lens.surfaces) - 1
    glass = next(k for k, surface in enumerate(lens.surfaces) if surface.glass.index(587.6) > 1)
    deviations = [Deviation("radius", k, k) for k in range(last + 1)]
    deviations += [Deviation("curvature", 0, 0), Deviation("thickness", 0, 0), Deviation("index", glass, glass)]
    deviations += [Deviation("abbe", glass, glass), Deviation("tilt", 1, 1), Deviation("decentre", 0, 1)]
    deviations += [Deviation("tilt", 0, 1)]
    values = np.random.default_rng(1).uniform(-1, 1, (count, len(deviations), 2))
    values *= np.array([SIZES[deviation.kind] for deviation in deviations])[:, None]
    values[0] = 0
    return Copies(lens, deviations, values)


@pytest.mark.parametrize("name", ["dgauss-50mm", "phone-5.6mm", "cylinder-pair", "cooke-triplet-50mm", "human-eye"])
def test_rays_through_all_copies_are_those_through_each(name: str) -> None:
    lens = load_lens(name)
    copies = copies_of(lens, 4)
    beam = Beam(3.0, azimuth_degrees=30.0)
    points, _, _ = passing_beam(lens, beam, 550.0, 12)
    origins, directions = beam.rays(0.8 * points)
    found, slopes = film_points(copies, origins, np.array(directions), 486.0, 20.0)
    for number in range(copies.count):
        copy = copies.copy(number)
        rays = copy.trace(origins, directions, 486.0, "scene")
        slope = rays.directions[:, :2] / rays.directions[:, 2:]
        at = rays.origins[:, :2] + slope * (copy.film_z(20.0) - rays.origins[:, 2:])
        assert rays.passed.sum() > 50
        np.testing.assert_allclose(found[number][rays.passed], at[rays.passed], atol=1e-12)  # roundings of millimetres
        np.testing.assert_allclose(slopes[number][rays.passed], slope[rays.passed], atol=1e-13)


LARGER = [slow(name) for name in ("phone-5.6mm", "cylinder-pair", "human-eye")]


@pytest.mark.parametrize("name", ["cooke-triplet-50mm", *LARGER])
def test_device_traces_copies_as_the_host_does(session: Session, name: str) -> None:
    lens = load_lens(name)
    copies = copies_of(lens, 5)
    beam = Beam(3.0, azimuth_degrees=30.0)
    points, _, _ = passing_beam(lens, beam, 550.0, 12)
    origins, directions = (np.array(rays) for rays in beam.rays(0.8 * points))
    directions /= np.sqrt(np.sum(directions**2, axis=1, keepdims=True))
    expected, slopes = film_points(copies, origins, directions, 486.0, 20.0)
    for precision, enough in (("single", 2e-5), ("double", 1e-12)):  # some roundings of 20 mm
        found, its_slopes = CopiesTracer(session, precision).film_points(copies, origins, directions, 486.0, 20.0)
        assert np.isfinite(found).mean() > 0.9
        np.testing.assert_allclose(found, expected, atol=enough)
        np.testing.assert_allclose(its_slopes, slopes, atol=enough)


def test_copy_without_errors_is_the_design() -> None:
    lens = load_lens("cooke-triplet-50mm")
    assert copies_of(lens, 2).copy(0) == lens


def test_copy_of_a_tilted_group_is_that_of_a_lens_file() -> None:
    design = load_lens("cooke-triplet-50mm")
    deviations = (Deviation("decentre", 2, 3), Deviation("tilt", 2, 3))
    copy = Copies(design, deviations, np.array([[[0.1, -0.2], np.radians([1.0, 0.5])]])).copy(0)
    rows = [{"radius": s.radius, "thickness": s.thickness, "diameter": 2 * s.semi_diameter} for s in design.surfaces]
    group = {"surfaces": [2, 3], "tilt_degrees": [1.0, 0.5]}
    turned = load_lens({"surfaces": rows, "groups": [group]})
    for mine, of_file in zip(copy.surfaces[2:4], turned.surfaces[2:4], strict=True):
        assert mine.pose is not None
        assert of_file.pose is not None
        np.testing.assert_allclose(mine.pose.matrix(), of_file.pose.matrix(), atol=1e-15)
    # the decentre acts first, and is turned with the group
    expected = turned.surfaces[2].pose.matrix() @ [0.1, -0.2, 0.0]  # type: ignore[union-attr]
    np.testing.assert_allclose(copy.surfaces[2].pose.offset, expected, atol=1e-15)  # type: ignore[union-attr]


def test_melt_has_another_index_and_abbe_number() -> None:
    glass = load_lens("cooke-triplet-50mm").surfaces[0].glass
    melt = Melt.of(glass, 0.001, 0.02)  # type: ignore[arg-type]
    wave = [486.13, 587.56, 656.27]
    f, d, c = melt.index(wave) - glass.index(wave)
    assert d == pytest.approx(0.001, abs=1e-12 + 2e-9)  # the d line of the catalogue has more digits
    spread = np.ptp(glass.index(wave))
    assert f - c == pytest.approx(spread * (1 / 1.02 - 1), rel=1e-9)
    assert melt.name == "N-SK16"


MIRROR = load_lens("mirror-500mm")
SECONDARY, TELESCOPE = (6, 7), (3, 4, 9, 10, 11)  # the first mirror's glass has the last three lenses cemented to it


def ring_of_rays() -> tuple[np.ndarray, np.ndarray]:
    turns = 2 * np.pi * np.arange(24) / 24
    origins = np.stack([27 * np.cos(turns), 27 * np.sin(turns), np.zeros(24)], axis=1)
    return origins, np.tile([0.0, np.sin(0.01), np.cos(0.01)], (24, 1))


def test_surface_that_light_meets_again_has_one_error() -> None:
    assert first_met(MIRROR) == (0, 1, 2, 3, 4, 3, 6, 7, 6, 9, 10, 3, 4)
    deviations = [Deviation("radius", 3, 3), Deviation("thickness", 3, 3), Deviation("thickness", 5, 5)]
    deviations += [Deviation("tilt", 3, 3), Deviation("index", 3, 3)]
    values = np.array([[[0.01, 0], [0.2, 0], [0.5, 0], [1e-3, 2e-3], [1e-3, 0]]])
    copy = Copies(MIRROR, deviations, values).copy(0)
    for k, first in enumerate(first_met(MIRROR)):
        assert copy.surfaces[k].curvature == copy.surfaces[first].curvature
        assert copy.surfaces[k].pose == copy.surfaces[first].pose
        assert copy.vertices[k] == pytest.approx(copy.vertices[first], abs=1e-12)
    moved = copy.vertices - MIRROR.vertices
    np.testing.assert_allclose(moved, [0, 0, 0, 0, 0.2, 0, -0.5, -0.5, -0.5, -0.5, -0.5, 0, 0.2], atol=1e-12)
    behind = copy.indices(550.0) - MIRROR.indices(550.0)
    np.testing.assert_allclose(behind[[4, 5, 12]], 1e-3, rtol=1e-3)
    assert np.count_nonzero(behind) == 3


def test_one_part_moved_is_all_others_moved_the_other_way(session: Session) -> None:
    (x, y), (origins, directions) = (0.07, -0.04), ring_of_rays()
    front, last = Deviation("decentre", 0, 1), Deviation("decentre", 3, 4, (9, 10, 11))
    one = Copies(MIRROR, [Deviation("decentre", *SECONDARY)], np.array([[[x, y]]]))
    rest = Copies(MIRROR, [front, last], np.array([[[-x, -y], [-x, -y]]]))
    film = MIRROR.first_order().back_focal_distance_mm
    points, slopes = film_points(one, origins, directions, 550.0, film)
    shifted, same = film_points(rest, origins - [x, y, 0], directions, 550.0, film)
    assert np.isfinite(points).all()
    np.testing.assert_allclose(shifted + np.array([x, y]), points, atol=1e-11)
    np.testing.assert_allclose(same, slopes, atol=1e-13)
    design, _ = film_points(Copies(MIRROR, (), np.zeros((1, 0, 2))), origins, directions, 550.0, film)
    assert np.abs(points - design).max() > 0.09  # it matters
    for precision, enough in (
        ("single", 2e-3),
        ("double", 1e-10),
    ):  # levers of 500 mm
        found, _ = CopiesTracer(session, precision).film_points(one, origins, directions, 550.0, film)
        np.testing.assert_allclose(found, points, atol=enough)


def test_tolerances_of_a_mirror_lens_are_of_what_it_is_made_of() -> None:
    assert elements(MIRROR) == [0, 3, 6, 9, 10]
    assert components(MIRROR) == [(0, 1), (3, 4, 9, 10, 11), SECONDARY]
    tolerances = [{"radius_percent": 0.1}, {"spacing_mm": 0.01}, {"thickness_mm": 0.05}, {"decentre_mm": 0.02}]
    labels = [one.label for one in limits(MIRROR, specification({"tolerances": tolerances}))]
    assert [label.split(" surface ")[1] for label in labels if label.startswith("radius")] == [
        "0",
        "1",
        "3",
        "4",
        "6",
        "7",
        "9",
    ]
    assert [label.split(" surface ")[1] for label in labels if label.startswith("air")] == ["1", "2", "5", "8"]
    assert sum(label.startswith("thickness") for label in labels) == 4  # the last glass fits between two surfaces
    assert labels[-2] == "decentre 0.02 mm of element 1 (surfaces 3, 4, 9, 10, 11)"
    with pytest.raises(InputError, match="light meets surface 3 there once more"):
        limits(MIRROR, specification({"tolerances": [{"radius_percent": 0.1, "surfaces": [5]}]}))


def test_surfaces_that_nearly_coincide_are_asked_about() -> None:
    surfaces = list(MIRROR.surfaces)
    surfaces[10] = replace(surfaces[10], thickness=surfaces[10].thickness + 0.02)  # as the patent prints it
    with pytest.raises(InputError, match=r"surfaces 3 and 11 have one shape and lie 0.02 mm apart"):
        check_copies(replace(MIRROR, surfaces=tuple(surfaces)))
