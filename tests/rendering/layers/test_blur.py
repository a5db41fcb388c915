"""The circle of confusion against the blur of a small lamp that is rendered, and against closed forms."""

import numpy as np
import pytest

import rptcam_cl
from tests.support.cases import slow

WIDTH_MM, COLUMNS, ROWS = 36.0, 720, 480
FILM = {"resolution": [COLUMNS, ROWS], "width_mm": WIDTH_MM}
FORWARD = {"eye": [0, 0, 0], "target": [0, 0, -1]}
GLASS = {"lens": "dgauss-50mm", "f_number": 2.8, "focus": {"distance_m": 2.0}}
CAMERAS = {
    "thin_lens": {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 2.8, "focus_distance_m": 2.0},
    "thick_lens": {"kind": "thick_lens"} | GLASS,
    "double_gauss": {"kind": "realistic"} | GLASS,
}
CENTRE, CORNER = (0.5, 0.5), (0.85, 0.25)  # places in the picture, as fractions from the left and the top
SHARE = 0.06  # of the picture that is rendered, each way
LAMP_PIXELS = 3.0  # its diameter


def window(place):
    x, y = place
    return {"crop": [x - SHARE, x + SHARE, y - SHARE * 1.5, y + SHARE * 1.5]}


def small_lamp(camera, depth, place):
    """A lamp seen about the middle of a place of the picture, as a mapping."""
    tangents = (place[0] - 0.5) * WIDTH_MM / 51.3, (0.5 - place[1]) * WIDTH_MM * ROWS / COLUMNS / 51.3
    centre = [tangents[0] * depth, tangents[1] * depth, -depth]
    radius = LAMP_PIXELS / 2 * WIDTH_MM / COLUMNS / 51.3 * depth
    lamp = {"shape": "sphere", "center": centre, "radius": radius, "material": {"kind": "emissive", "radiance": 1e3}}
    return {"camera": camera | FORWARD, "film": FILM | window(place), "objects": [lamp], "render": {"max_depth": 1}}


def measured(camera, depth, place):
    """Diameter [pixels] of the disk whose light spreads like that of a point, and the pixel in its middle."""
    light = np.asarray(rptcam_cl.render(small_lamp(camera, depth, place), spp=256))[..., 0].astype(np.float64)
    return spread_of(light)


def spread_of(light):
    """Diameter of the blur of a lamp, and the pixel in its middle, from its picture."""
    assert max(light[0].max(), light[-1].max(), light[:, 0].max(), light[:, -1].max()) == 0  # all of it is there
    rows, columns = np.indices(light.shape) + 0.5
    total = light.sum()
    row, column = (light * rows).sum() / total, (light * columns).sum() / total
    spread = (light * ((rows - row) ** 2 + (columns - column) ** 2)).sum() / total - 2 / 12  # less that of the pixels
    return np.sqrt(8 * spread - LAMP_PIXELS**2), (int(row), int(column))


def of_panel(camera, depth, place):
    """Layer of a panel that faces the camera."""
    panel = {
        "shape": "plane",
        "point": [0, 0, -depth],
        "normal": [0, 0, 1],
        "material": {"kind": "matte", "reflectance": 0},
    }
    scene = {"camera": camera | FORWARD, "film": FILM | window(place), "objects": [panel]}
    return rptcam_cl.render(scene, spp=8, layers=["coc"])["coc"]


@pytest.mark.parametrize(
    ("name", "depth", "place"),
    [
        slow("thin_lens", 6.0, CENTRE),
        slow("thick_lens", 0.8, CORNER),
        slow("double_gauss", 0.8, CORNER),
        slow("double_gauss", 6.0, CENTRE),
    ],
)
def test_circle_of_confusion_is_the_blur_of_a_point_within_5_percent(name, depth, place):
    diameter, middle = measured(CAMERAS[name], depth, place)
    told = of_panel(CAMERAS[name], depth, place)[middle]
    assert diameter > 5
    assert abs(told / diameter - 1) < 0.05  # about twice the noise of the measurement


def test_thin_lens_blurs_a_panel_and_the_sky_behind_it_by_the_closed_form():
    """The panel fills the lower half; by 6 pixels about its edge the lens sees both."""
    focal, stop = 0.05, 0.05 / 2.8
    image_distance = 1 / (1 / focal - 1 / 2.0)
    panel = {"shape": "rectangle", "edge_u": [9, 0, 0], "edge_v": [0, -9, 0], "material": {"kind": "mirror"}}
    for depth in (5.0, 2.0):
        scene = {"camera": CAMERAS["thin_lens"] | FORWARD, "film": FILM | window(CENTRE),
                 "objects": [panel | {"corner": [-4.5, 0, -depth]}]}  # fmt: skip
        coc = rptcam_cl.render(scene, spp=4, layers=["coc"])["coc"]
        middle = len(coc) // 2
        for seen, vergence in ((coc[middle + 6 :], 1 / depth), (coc[: middle - 6], 0.0)):
            expected = stop * image_distance * abs(1 / 2.0 - vergence) * COLUMNS / (WIDTH_MM * 1e-3)
            np.testing.assert_allclose(seen, expected, rtol=2e-6, atol=1e-4 * (expected == 0))


@pytest.mark.slow
def test_centred_lens_blurs_alike_on_both_sides():
    """Between the nodes of the film, at which alone the lens is traced."""
    wall = {"shape": "plane", "point": [0, 0, -0.8], "normal": [0, 0, 1], "material": "dark"}
    scene = {"camera": CAMERAS["double_gauss"] | FORWARD, "film": {"resolution": [48, 32], "width_mm": WIDTH_MM},
             "objects": [wall], "materials": {"dark": {"kind": "matte", "reflectance": 0}}}  # fmt: skip
    told = rptcam_cl.render(scene, spp=16, layers=["coc"])["coc"]
    np.testing.assert_allclose(told[:, ::-1], told, rtol=3e-3)  # rays of a pixel meet the wall at other distances
    np.testing.assert_allclose(told[::-1], told, rtol=3e-3)
    assert np.ptp(told[16]) > 0.05 * told[16, 24]


def test_traced_lens_stopped_down_blurs_like_its_cardinal_points():
    stopped = {name: CAMERAS[name] | {"f_number": 16} for name in ("thick_lens", "double_gauss")}
    thick, traced = (of_panel(camera, 0.6, CENTRE) for camera in stopped.values())
    middle = traced.shape[0] // 2, traced.shape[1] // 2
    assert traced[middle] == pytest.approx(thick[middle], rel=0.03)


TILTED = {
    "name": "A singlet on a tilted board",
    "source": "equal radii, made up for this test",
    "surfaces": [
        {"radius": 50, "thickness": 3, "glass": {"index": 1.5}, "diameter": 20},
        {"radius": -50, "thickness": 1, "diameter": 20},
        {"stop": True, "diameter": 8},
    ],
    "groups": [{"surfaces": [0, 2], "tilt_degrees": [9, -14]}],
}


@pytest.mark.parametrize("place", [(0.15, 0.15), *map(slow, ((0.85, 0.15), (0.15, 0.85)))])
def test_tilted_lens_blurs_each_corner_in_its_own_way(place):
    width_mm, columns, rows, depth = 18.0, 360, 240, 1.2
    film = {"resolution": [columns, rows], "width_mm": width_mm}
    camera = {"kind": "realistic", "lens": TILTED, "focus": {"film_distance_mm": 50.0}, "pupil": "bounds"} | FORWARD
    centre = [(place[0] - 0.5) * width_mm / 50 * depth, (0.5 - place[1]) * width_mm / 75 * depth, -depth]
    radius = LAMP_PIXELS / 2 * width_mm / columns / 50 * depth
    lamp = {"shape": "sphere", "center": centre, "radius": radius, "material": {"kind": "emissive", "radiance": 1e3}}
    scene = {"camera": camera, "film": film, "render": {"max_depth": 1}}
    crop = [max(place[0] - 0.15, 0), min(place[0] + 0.15, 1), max(place[1] - 0.15, 0), min(place[1] + 0.15, 1)]
    light = np.asarray(rptcam_cl.render(scene | {"objects": [lamp]}, spp=128, crop=crop))[..., 0].astype(np.float64)
    diameter, (row, column) = spread_of(light)
    middle = row + round(crop[2] * rows), column + round(crop[0] * columns)
    panel = {"shape": "plane", "point": [0, 0, -depth], "normal": [0, 0, 1], "material": {"kind": "mirror"}}
    told = rptcam_cl.render(scene | {"objects": [panel]}, spp=4, layers=["coc"])["coc"]
    assert abs(told[middle] / diameter - 1) < 0.05
    for turned in (told[::-1], told[:, ::-1], told[::-1, ::-1]):
        assert abs(turned[middle] / diameter - 1) > 0.2  # another corner is quite another matter
