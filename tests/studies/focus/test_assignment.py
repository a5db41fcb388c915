"""The targets of the autofocus scenes of CS348b (2015), assignment 3: textured cones before its lenses."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.device.session import open_session
from rptcam_cl.optics.library import load_lens
from rptcam_cl.studies.focus.probe import Zone
from rptcam_cl.studies.focus.renderer import ProbeRenderer
from tests.studies.focus.scenes import lens_camera, scene_of, target
from tests.support.cases import slow

FILM_MM = 49.497  # 70 mm across the corners
CLOSEUP = ("dgauss-50mm", 125.0, 62.09, (0.58, 0.64, 0.38, 0.46))
BACKGROUND = ("dgauss-50mm", 713.0, 39.80, (0.37, 0.45, 0.36, 0.42))
TELEPHOTO = ("telephoto-250mm", 5180.0, 116.85, (0.70, 0.76, 0.4, 0.46))  # 5619 mm is for first-order optics
TEXTURES = {
    "noise": {"kind": "noise", "low": 0.05, "high": 0.95, "scale": [60, 60]},
    "checks": {"kind": "checker", "even": 0.9, "odd": 0.1, "scale": [48, 32]},
    "large and dark": {"kind": "checker", "even": 0.1, "odd": 0.5, "scale": [12, 8]},
}


def cone_before(lens, front_mm, film_mm, zone, texture, method):
    """Return a scene whose zone shows the side of a cone so far from the first vertex, and a wall behind it."""
    glass = load_lens(lens)
    planes, to_film = glass.first_order().principal_planes_mm, glass.length + film_mm
    view = (front_mm + planes.front) / (film_mm - planes.rear) * FILM_MM * 1e-3
    x, y = ((zone[0] + zone[1]) / 2 - 0.5) * view, (0.5 - (zone[2] + zone[3]) / 2) * view
    height, away = max(0.4 * view, 0.06), (front_mm + to_film) * 1e-3
    cone = {
        "shape": "cone",
        "base": [x, y - height / 2, -away - height / 6],
        "apex": [x, y + height / 2, -away - height / 6],
        "radius": height / 3,
        "material": {"kind": "matte", "reflectance": TEXTURES[texture]},
    }
    wall = target(3 * away, 6 * away, {"kind": "matte", "reflectance": 0.3})
    camera = lens_camera(lens, focus={"auto": {"method": method, "zones": [list(zone)]}})
    return scene_of([cone, wall], camera, film={"resolution": [300, 300], "size_mm": [FILM_MM, FILM_MM]})


CASES = [
    (TELEPHOTO, "checks", "contrast"),
]
MORE = [
    (place, texture, method)
    for place in (CLOSEUP, BACKGROUND, TELEPHOTO)
    for texture in TEXTURES
    for method in ("laplacian", "contrast", "depth")
    if (place, texture, method) not in CASES
]


@pytest.mark.slow
@pytest.mark.parametrize(("place", "texture", "method"), [*CASES, *(slow(*case) for case in MORE)])
def test_targets_of_the_assignment_are_found(place, texture, method):
    _, _, film_mm, zone = place
    scene = cone_before(*place, texture, method)
    report = rptcam_cl.autofocus(scene)
    assert report.method == method
    assert report.film_distance_mm == pytest.approx(film_mm, abs=0.5)
    probe = ProbeRenderer(scene, open_session(None))
    shown = probe.sight(report.state, Zone(*zone)).depths
    ends = [probe.drive.state_for(float(depth), Zone(*zone)) for depth in np.percentile(shown, [75, 25])]
    assert ends[0] - 0.25 * probe.drive.depth_of_focus <= report.state <= ends[1] + 0.25 * probe.drive.depth_of_focus
