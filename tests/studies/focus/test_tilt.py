"""Focus behind a tilted film: each zone has its own distance from the lens, and its own plane in focus."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.device.session import open_session
from rptcam_cl.studies.focus.phase import half_view
from rptcam_cl.studies.focus.probe import OutOfReach, Zone
from rptcam_cl.studies.focus.renderer import ProbeRenderer
from tests.studies.focus.scenes import lens_camera, noise, scene_of, target

TILT = {"movements": {"tilt_degrees": 8}}
POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
UPPER, LOWER = Zone(0.47, 0.53, 0.1, 0.18), Zone(0.47, 0.53, 0.82, 0.9)
FLAT = Zone(0.44, 0.56, 0.13, 0.15)  # from edge to edge of a higher one, the film is more than a depth of focus apart
BY_LENGTH = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 2, "focus_distance_m": 4, **POSE, **TILT}
BY_FIELD = {"kind": "thin_lens", "fov_degrees": 40, "aperture_radius_m": 0.0125, "focus_distance_m": 4, **POSE, **TILT}
WALL = target(3.0, 3.0, noise(900))


def sides(zone):
    return (zone.left, zone.right, zone.top, zone.bottom)


def behind(zone):
    """Return how far the film lies behind its centre [mm]; what is above in the picture lies below on it."""
    return 24 * (sum(sides(zone)[2:]) / 2 - 0.5) * np.sin(np.radians(8))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["depth", "phase", "contrast", "hybrid"])
def test_thin_lens_of_known_focal_length_obeys_the_lens_equation_in_the_zone(method):
    report = rptcam_cl.autofocus(scene_of([WALL], BY_LENGTH), method, zones=[sides(FLAT)])
    image = 1 / (1 / 50 - 1 / 3000)
    miss = report.film_distance_mm + behind(FLAT) - image
    assert abs(miss) < 0.2 * report.depth_of_focus_mm  # depth 0, the others by noise
    assert report.focus_distance_m == pytest.approx(3.0, rel=0.05)
    assert report.warnings == []


def test_thin_lens_of_known_field_obeys_the_lens_equation_in_the_zone():
    film = 18 / np.tan(np.radians(20))
    report = rptcam_cl.autofocus(scene_of([WALL], BY_FIELD), "depth", zones=[sides(UPPER)])
    focal_length = 1 / (1 / film + 1 / (report.state * 1e3))
    assert 1 / (1 / focal_length - 1 / (film + behind(UPPER))) == pytest.approx(3000, rel=1e-6)


@pytest.mark.slow
def test_thin_lens_says_how_far_it_can_focus_in_the_zone():
    farthest = 1 / (1 / 50 - 1 / (50 + behind(LOWER)))
    with pytest.raises(
        OutOfReach, match=f"cannot focus at 3000 mm from the lens; the farthest possible is {farthest:.0f}"
    ):
        rptcam_cl.autofocus(scene_of([WALL], BY_LENGTH), "phase", zones=[sides(LOWER)])


@pytest.mark.parametrize("kind", ["realistic", "thick_lens"])
def test_distances_are_those_of_the_middle_of_the_film_near_natural_size(kind):
    # 0.2 m off by the 1.2 mm that the film leans back would be 1.8 depths of focus
    scene = scene_of([target(0.22, 0.22, noise(400))], lens_camera("dgauss-50mm", kind, f_number=4, **TILT))
    probe = ProbeRenderer(scene, open_session(None))
    for zone in (UPPER, LOWER):
        state = probe.drive.state_for(0.22, zone)
        assert probe.drive.object_distance(state, zone) == pytest.approx(0.22, rel=1e-5)
        # rays from the film, where the drive traces them from the plane; distortion of the beam differs by 1e-4
        assert 1 / half_view(probe, state, zone, "x").sharpest() == pytest.approx(0.22, rel=3e-4)


@pytest.mark.parametrize(
    "camera", [lens_camera("heliar-105mm"), lens_camera("dgauss-50mm", **TILT)], ids=["far", "tilted"]
)
def test_depth_is_sure_of_a_wall_where_first_order_optics_has_no_focus(camera):
    # the least spot lies nearer to the lens than first-order optics has infinity
    scene = scene_of([target(105.0, 105.0, noise(900))], camera)
    report = rptcam_cl.autofocus(scene, "depth", zones=[sides(LOWER)])
    assert report.confidence == 1.0
    assert report.warnings == []
    assert report.focus_distance_m == pytest.approx(105.0, rel=1e-3)
