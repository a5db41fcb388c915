"""Copies of lenses: as lenses and as arrays they are the same, and a copy without errors is the design."""

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import Session
from rptcam_cl.optics.as_built import Copies, Deviation, check_copies, film_points
from rptcam_cl.optics.beams import Beam, passing_beam
from rptcam_cl.optics.glass import Melt
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.traceable_lens import CopiesTracer

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


LARGER = [pytest.param(name, marks=pytest.mark.slow) for name in ("phone-5.6mm", "cylinder-pair", "human-eye")]


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


def test_lens_whose_surfaces_light_meets_twice_is_refused() -> None:
    with pytest.raises(InputError, match="has mirrors"):
        check_copies(load_lens("mirror-500mm"))
