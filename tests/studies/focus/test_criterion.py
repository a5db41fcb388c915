"""What is called sharpest: the focus against a through-focus scan of rays from the object to the film, in float64."""

import numpy as np
import pytest

from rptcam_cl import InputError, autofocus
from rptcam_cl.cli import main
from rptcam_cl.optics.best_focus import best_film_distance_at
from rptcam_cl.optics.lens import Lens
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.focus.drives import focus_drive
from rptcam_cl.studies.focus.probe import Zone
from tests.studies.focus.scenes import CENTRE, lens_camera, noise, scene_of, target
from tests.support.cases import slow

DISTANCE_M = 4.0
ACROSS = 96  # rays over the first surface, of which about a third passes


def rays_of(lens: Lens, film_mm: float, point: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return places on a film and slopes of the light of the object point seen there, by all rays that pass."""
    reach = 1.1 * max(surface.semi_diameter for surface in lens.surfaces[:2])
    side = np.linspace(-reach, reach, ACROSS)
    through = np.stack([*(each.ravel() for each in np.meshgrid(side, side)), np.zeros(ACROSS**2)], axis=1)
    front = 1e3 * DISTANCE_M - lens.length - film_mm
    first = lens.first_order(587.5618)
    scale = -(front + first.entrance_pupil.distance_mm) / first.focal_length_mm
    aim = np.array(point) * scale
    for _ in range(6):  # until the middle of its light lies where it should
        source = np.array([*aim, -front])
        rays = lens.trace(np.broadcast_to(source, through.shape), through - source, start="scene")
        ends, ways = rays.origins[rays.passed], rays.directions[rays.passed]
        slopes = ways[:, :2] / ways[:, 2:]
        places = ends[:, :2] + (lens.length + film_mm - ends[:, 2:]) * slopes
        aim = aim - (places.mean(axis=0) - point) * scale
    return places, slopes


def sharpest(places: np.ndarray, slopes: np.ndarray, per_mm: float, reach_mm: float) -> float:
    """Return the shift of the film at which lines across and lines down keep most contrast together."""
    shifts = np.linspace(-reach_mm, reach_mm, 401)
    kept = [np.abs(np.exp(2j * np.pi * per_mm * (places + shift * slopes)).mean(axis=0)).sum() for shift in shifts]
    return float(shifts[int(np.argmax(kept))])


@pytest.mark.parametrize(
    ("lens", "zone", "f_number"),
    [
        ("dgauss-50mm", Zone(0.7, 0.75, 0.6, 0.66), 2.8),
        slow("tessar-100mm", CENTRE, 4.5),
        slow("tessar-100mm", Zone(0.75, 0.8, 0.3, 0.36), 4.5),
        slow("dgauss-50mm", CENTRE, 2.2),
        slow("double-gauss-50mm-f1.8", Zone(0.15, 0.2, 0.2, 0.26), 2.0),
    ],
)
def test_focus_by_a_criterion_is_where_a_scan_through_the_focus_has_it(lens, zone, f_number):
    opening = {} if f_number is None else {"f_number": f_number}
    scene = scene_of([target(DISTANCE_M, 3.0, noise(300))], lens_camera(lens, **opening))
    drive, where = focus_drive(scene), [[zone.left, zone.right, zone.top, zone.bottom]]
    spot = autofocus(scene, "depth", zones=where, criterion="spot")
    point = tuple((1 - 2 * share) * side for share, side in zip(zone.centre, (18.0, -12.0), strict=True))
    places, slopes = rays_of(drive.lens, spot.film_distance_mm, point)
    away, turned = places - places.mean(axis=0), slopes - slopes.mean(axis=0)
    least = -float((away * turned).sum() / (turned**2).sum())
    assert abs(least) < 0.06 * drive.depth_of_focus  # the least spot of both is the same
    moved = []
    for criterion, per_mm in (("mtf@30", 30.0), ("mtf@10", 10.0), ("pixel", 360 / 36 / 4)):
        report = autofocus(scene, "depth", zones=where, criterion=criterion)
        expected = sharpest(places, slopes, per_mm, 4 * drive.depth_of_focus) - least
        moved.append((report.film_distance_mm - spot.film_distance_mm) / drive.depth_of_focus)
        assert moved[-1] == pytest.approx(expected / drive.depth_of_focus, abs=0.12)
        assert report.notes["beyond_spot"] == pytest.approx(moved[-1], abs=0.02)
    if lens == "dgauss-50mm" and zone != CENTRE:
        assert max(map(abs, moved)) > 0.3  # they differ by more than the tolerance


def test_focus_shift_of_a_smaller_stop_is_that_of_the_least_spot():
    scene = scene_of([target(DISTANCE_M, 3.0, noise(300))], lens_camera("tessar-100mm", f_number=4.5))
    report, drive = autofocus(scene, "depth", criterion="spot"), focus_drive(scene)
    lens = drive.lens
    smaller = lens.with_stop_diameter(lens.stop.semi_diameter)
    films = [best_film_distance_at(each, (0.01, 0.0), 1e3 * DISTANCE_M) for each in (lens, smaller)]
    goes = -(films[1] - films[0]) / drive.depth_of_focus  # a film that stays is sharp nearer where the image goes back
    assert abs(goes) > 0.3
    assert report.notes["shift_when_stopped"] == pytest.approx(goes, abs=0.1)


def test_bad_criteria_say_what_is_right(tmp_path, capsys):
    scene = scene_of([target(DISTANCE_M, 3.0, noise(300))], lens_camera("dgauss-50mm"))
    for bad in ("mtf@0", "mtf@", "mtf@1e9", "sharp"):
        with pytest.raises(InputError, match=r"spot, pixel, or mtf@30"):
            autofocus(scene, "depth", criterion=bad)
    with pytest.raises(InputError, match="method: depth or phase"):
        autofocus(scene, "contrast", criterion="pixel")
    path = tmp_path / "scene.yaml"
    path.write_text(
        "camera: {kind: realistic, lens: dgauss-50mm, eye: [0, 0, 0], target: [0, 0, -1],\n"
        "  focus: {auto: {criterion: pixel}}}\n",
        encoding="utf-8",
    )
    with pytest.raises(InputError, match=r"scene.yaml:2:.*camera.focus.auto.criterion"):
        load_scene(path)
    assert main(["focus", str(path)]) == 2
    assert "camera.focus.auto.criterion" in capsys.readouterr().err


def test_criterion_is_in_what_the_command_prints(tmp_path, capsys):
    path = tmp_path / "scene.yaml"
    path.write_text(
        "camera: {kind: realistic, lens: tessar-100mm, eye: [0, 0, 0], target: [0, 0, -1],\n"
        "  focus: {auto: {method: depth, criterion: mtf@30}}}\n"
        "objects: [{shape: rectangle, corner: [-3, -3, -4], edge_u: [6, 0, 0], edge_v: [0, 6, 0],\n"
        "  material: {kind: matte, reflectance: 0.5}}]\n",
        encoding="utf-8",
    )
    assert main(["focus", str(path)]) == 0
    assert "sharpest by mtf@30: " in capsys.readouterr().out
