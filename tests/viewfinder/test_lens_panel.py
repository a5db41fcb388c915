"""The lens panel: rays against float64, spot, depth of field, breathing and image circle against other formulas."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import open_session
from rptcam_cl.optics.irradiance import image_circle
from rptcam_cl.optics.lens import Lens, film_distance, limiting_surface
from rptcam_cl.optics.spots import Setting, field_mtf, film_spots
from rptcam_cl.rendering.cameras.setting import film_point, lens_setting
from rptcam_cl.scene.camera import LensCamera
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder.lens_panel import LINES_NM, LensPanel, depth_of_field, lens_state
from tests.support.cases import slow

POSE = {"eye": [0, 0, 0], "target": [0, 0, -2]}
POINT_MM = 1e-4  # float32 through up to 34 surfaces, as for mirrors in tests/cameras; 2e-5 is met
DRAWN_MM = 1e-3  # a corner: points are rounded to 1e-4, and so is the direction in which the test starts


def scene(lens: str = "dgauss-50mm", distance_m: float = 2.0, **camera: Any) -> Scene:
    keys = {"kind": "realistic", "lens": lens, "focus": {"distance_m": distance_m}, **POSE}
    return load_scene({"film": {"resolution": [36, 24]}, "camera": keys | camera})


@pytest.fixture(scope="module")
def panel() -> LensPanel:
    return LensPanel(open_session(None))


def behind(lens: Lens, k: int) -> Lens:
    """The surfaces of a lens from one on, with the medium in front of it that was there."""
    index = lens.stop_index
    stop = index - k if index is not None and index >= k else None
    return replace(
        lens, surfaces=lens.surfaces[k:], stop_index=stop, object_medium=lens.media[k], configurations=(),
        focusing=None, floating=(),
    )  # fmt: skip


LENSES = [("dgauss-50mm", 2.0), slow("zoom-70-200mm", 5.0), ("fisheye-10mm", 2.0), ("mirror-500mm", 50.0)]


@pytest.mark.parametrize(("lens", "distance_m"), LENSES)
def test_device_meets_every_surface_where_float64_does(lens: str, distance_m: float) -> None:
    state = lens_state(scene(lens, distance_m), open_session(None))
    surfaces, radius = state.lens.surfaces, state.lens.surfaces[-1].semi_diameter
    targets = np.random.default_rng(1).uniform(-radius, radius, (60, 3))
    targets[:, 2] = state.lens.length
    start = np.tile([1.0, 2.0, state.film_z], (60, 1))
    wavelengths = np.tile(LINES_NM, 20)
    corners, rays = state.from_film.paths(start, targets - start, wavelengths)
    whole = state.lens.trace(start, targets - start, wavelengths, "film")
    assert np.array_equal(rays.status, whole.status)
    assert np.array_equal(rays.surface, whole.surface)
    assert whole.passed.sum() < 60
    assert whole.passed.sum() >= 3 or state.lens.is_obstructed
    for place in range(1, len(surfaces) + 1):
        k = len(surfaces) - place
        shift = np.array([0, 0, state.lens.vertices[k]])
        if state.lens.senses[k] < 0:  # no lens begins between mirrors
            continue
        exact = behind(state.lens, k).trace(start - shift, targets - start, wavelengths, "film")
        met = exact.passed & (rays.surface < k)
        np.testing.assert_allclose(corners[place][met], (exact.origins + shift)[met], rtol=0, atol=POINT_MM)


@pytest.mark.parametrize(("lens", "distance_m"), LENSES)
@pytest.mark.parametrize("place", [(0.5, 0.3), slow((0.6, 0.55))])
def test_rays_are_drawn_where_float64_traces_them(
    panel: LensPanel, lens: str, distance_m: float, place: tuple[float, float]
) -> None:
    resolved = scene(lens, distance_m)
    state = lens_state(resolved, open_session(None))
    assert isinstance(resolved.camera, LensCamera)
    start = np.array([*film_point(resolved, resolved.camera, *place)[:2], state.film_z])
    across = start[:2] / np.hypot(*start[:2]) * np.sign(start[1])
    rays = panel.pointer(resolved, *place)["rays"]
    assert {ray["wavelength_nm"] for ray in rays} == {round(nm, 2) for nm in state.wavelengths_nm}
    assert sum(ray["passed"] for ray in rays) >= 2 * len(state.wavelengths_nm)
    assert not all(ray["passed"] for ray in rays)
    for ray in rays:
        points = np.array(ray["points"])
        assert points[0] == pytest.approx([state.film_z, start[:2] @ across], abs=1e-4)
        towards = np.array([*(points[1, 1] * across), points[1, 0]])
        last = len(state.lens.surfaces) - (0 if ray["passed"] else ray["stopped_by"] + 1)
        for corner in range(1, last + 1):
            k = len(state.lens.surfaces) - corner
            shift = np.array([0, 0, state.lens.vertices[k]])
            if state.lens.senses[k] < 0:
                continue
            met = behind(state.lens, k).trace(start - shift, towards - start, ray["wavelength_nm"], "film").origins[0]
            expected = [met[2] + shift[2], met[:2] @ across]
            assert points[corner] == pytest.approx(expected, abs=DRAWN_MM * corner), k


def test_what_stops_a_ray_is_what_stops_it_in_float64(panel: LensPanel) -> None:
    resolved = scene()
    state = lens_state(resolved, open_session(None))
    assert isinstance(resolved.camera, LensCamera)
    for x in (0.5, 0.3, 0.05):
        start = np.array([*film_point(resolved, resolved.camera, x, 0.5)[:2], state.film_z])
        for ray in panel.pointer(resolved, x, 0.5)["rays"]:
            first = ray["points"][1]
            towards = np.array([first[1], 0.0, first[0]] if abs(start[0]) > 1e-6 else [0.0, first[1], first[0]])
            if start[0] < 0:
                towards[0] *= -1
            exact = state.lens.trace(start, towards - start, ray["wavelength_nm"], "film")
            assert bool(exact.passed[0]) == ray["passed"]
            assert ray["stopped_by"] == (None if ray["passed"] else int(exact.surface[0]))


@pytest.mark.parametrize(("place", "degrees"), [((0.5, 0.5), 0.0), ((0.5, 0.25), None)])
def test_spot_and_transfer_are_those_of_the_lens_tools(
    panel: LensPanel, place: tuple[float, float], degrees: float | None
) -> None:
    resolved = scene("biotar-58mm", f_number=4)
    found, setting = panel.pointer(resolved, *place), lens_setting(resolved)
    assert setting.focus_distance_mm is not None
    front = setting.focus_distance_mm - setting.lens.film_z(setting.film_distance_mm)
    if degrees is None:  # as seen from the first vertex, by the object point of the film point
        per_mm = 1 / abs(lens_magnification(setting.lens, front, setting.film_distance_mm))
        degrees = math.degrees(math.atan(abs(found["film_mm"][1]) * per_mm / front))
    use = Setting(setting.lens, setting.film_distance_mm, front, setting.camera.wavelength_nm)
    spots = film_spots(use, [degrees], lens_state(resolved, open_session(None)).wavelengths_nm, 64)
    together = np.concatenate([spot.points for spot in spots])
    rms = 1e3 * float(np.sqrt(np.sum(np.var(together, axis=0))))
    assert found["spot"]["rms_um"] == pytest.approx(rms, rel=0.01)  # 96 rays across at most against 64
    curves = field_mtf(spots, found["mtf"]["frequencies"])
    assert curves is not None
    for name, curve in zip(("tangential", "sagittal", "tangential_limit", "sagittal_limit"), curves, strict=True):
        assert found["mtf"][name] == pytest.approx(curve.tolist(), abs=0.03), name


def lens_magnification(lens: Lens, front_mm: float, film_mm: float) -> float:
    """Image over object size, by a paraxial chief ray."""
    first = lens.first_order()
    assert limiting_surface(lens) is not None
    image = film_mm - (first.back_focal_distance_mm)
    return -image / first.focal_length_mm


@pytest.mark.parametrize("lens", ["dgauss-50mm", "zoom-70-200mm", "macro-55mm"])
def test_ends_of_the_depth_of_field_blur_to_the_circle(lens: str) -> None:
    resolved = scene(lens, 3.0, f_number=5.6)
    found, setting = depth_of_field(resolved), lens_setting(resolved)
    assert found is not None and found["far_m"] is not None and found["near_m"] is not None
    first, length = setting.lens.first_order(), setting.lens.film_z(setting.film_distance_mm)
    for end_m in (found["near_m"], found["far_m"]):
        image = film_distance(setting.lens, end_m * 1e3 - length, "front")
        cone = first.exit_pupil.diameter_mm / (image - first.exit_pupil.distance_mm)
        assert cone * abs(image - setting.film_distance_mm) == pytest.approx(found["circle_mm"], rel=1e-6)


def test_depth_of_field_of_a_thin_lens_is_the_textbooks() -> None:
    keys = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 4, "focus_distance_m": 3, **POSE}
    found = depth_of_field(load_scene({"film": {"resolution": [36, 24]}, "camera": keys}))
    assert found is not None
    f, n, s, c = 50.0, 4.0, 3000.0, math.hypot(36, 24) / 1500
    hyperfocal = f * f / (n * c)
    assert found["hyperfocal_m"] == pytest.approx(hyperfocal * 1e-3, rel=1e-4)  # to the lens; textbooks add f
    assert found["near_m"] == pytest.approx(s * hyperfocal / (hyperfocal + s - f) * 1e-3, rel=1e-9)
    assert found["far_m"] == pytest.approx(s * hyperfocal / (hyperfocal - s + f) * 1e-3, rel=1e-9)
    assert found["magnification"] == pytest.approx(f / (s - f), rel=1e-9)


@pytest.mark.parametrize(("lens", "share"), [("dgauss-50mm", 0.067), ("macro-55mm", 0.100)])
def test_breathing_is_how_much_larger_a_near_focus_draws(lens: str, share: float) -> None:
    found = depth_of_field(scene(lens, 0.5))
    assert found is not None
    wide, near = (lens_setting(scene(lens, metres)) for metres in (1e6, 0.5))
    images = [setting.film_distance_mm - setting.lens.first_order().exit_pupil.distance_mm for setting in (wide, near)]
    pupils = [setting.lens.first_order() for setting in (wide, near)]
    ratio = [first.entrance_pupil.diameter_mm / first.exit_pupil.diameter_mm for first in pupils]
    assert found["breathing"] == pytest.approx(images[1] * ratio[1] / (images[0] * ratio[0]) - 1, rel=1e-6)
    assert found["breathing"] == pytest.approx(share, abs=0.06)  # of exact rays at 10 degrees


@pytest.mark.parametrize("lens", ["dgauss-50mm", *map(slow, ("fisheye-10mm", "wide-22mm"))])
def test_image_circle_is_where_light_ends(panel: LensPanel, lens: str) -> None:
    resolved = scene(lens)
    setting = lens_setting(resolved)
    ellipse = panel.guides(resolved)["image_circle"]
    expected = image_circle(setting.lens, setting.film_distance_mm)
    assert ellipse["rx"] * 36 == pytest.approx(expected, rel=5e-3)
    assert ellipse["ry"] * 24 == pytest.approx(expected, rel=5e-3)


def test_section_is_made_of_the_lens(panel: LensPanel) -> None:
    resolved = scene()
    section, setting = panel.section(resolved), lens_setting(resolved)
    lens, first = setting.lens, setting.lens.first_order()
    assert {line["surface"] for line in section["surfaces"]} == set(range(len(lens.surfaces))) - {lens.stop_index}
    for line in section["surfaces"]:
        z, height = np.array(line["points"]).T
        surface = lens.surfaces[line["surface"]]
        assert z - lens.vertices[line["surface"]] == pytest.approx(surface.sag(0 * height, height), abs=2e-3)
        assert np.abs(height).max() == pytest.approx(surface.semi_diameter, abs=2e-3)
    assert len(section["glass"]) == 6
    pupil = section["pupils"]["entrance"]
    assert pupil["z_mm"] == pytest.approx(first.entrance_pupil.distance_mm, abs=1e-3)
    assert 2 * pupil["radius_mm"] == pytest.approx(first.entrance_pupil.diameter_mm, abs=2e-3)
    assert section["film"]["points"][0][0] == pytest.approx(lens.film_z(setting.film_distance_mm), abs=1e-3)
    inner = min(abs(point[1]) for blade in section["stop"] for point in blade["points"])
    assert lens.stop is not None and inner == pytest.approx(lens.stop.semi_diameter, abs=1e-3)
    numbers = panel.numbers(resolved)
    assert (numbers["focal_length_mm"], numbers["f_number"]) == (first.focal_length_mm, first.f_number)


CAMERAS: dict[str, dict[str, Any]] = {
    "traced": {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 2}},
    "no focus": {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"film_distance_mm": 30}},
    "infinity": {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 1e6}},
    "anamorphic": {"kind": "realistic", "lens": "anamorphic-100mm", "focus": {"distance_m": 5}},
    "blades": {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 2}, "f_number": 8,
               "aperture": {"shape": "polygon", "blades": 5}},
    "thick": {"kind": "thick_lens", "lens": "dgauss-50mm", "focus": {"distance_m": 2}},
    "thin": {"kind": "thin_lens", "fov_degrees": 40, "aperture_radius_m": 0.01, "focus_distance_m": 2},
    "pinhole": {"kind": "pinhole", "fov_degrees": 40},
    "sphere": {"kind": "environment"},
}  # fmt: skip


@pytest.mark.parametrize("name", CAMERAS)
def test_every_camera_has_a_panel_of_plain_values(panel: LensPanel, name: str) -> None:
    resolved = load_scene({"film": {"resolution": [40, 20]}, "camera": CAMERAS[name] | POSE})
    keys = (
        (panel.section(resolved), {"kind", "surfaces", "glass", "stop", "film", "pupils", "axis"}),
        (panel.numbers(resolved), {"focal_length_mm", "f_number", "near_m", "far_m", "hyperfocal_m", "breathing"}),
        (panel.pointer(resolved, 0.3, 0.6), {"rays", "field_degrees", "spot", "mtf"}),
        (panel.guides(resolved), {"image_circle"}),
    )
    for found, names in keys:
        json.dumps(found, allow_nan=False)
        assert names <= set(found)
    rays = panel.pointer(resolved, 0.3, 0.6)["rays"]
    assert bool(rays) == (name != "sphere")
    assert all(len(ray["points"]) >= 2 for ray in rays)


def test_thick_lens_leads_its_rays_to_one_point_in_focus(panel: LensPanel) -> None:
    resolved = load_scene({"film": {"resolution": [40, 20]}, "camera": CAMERAS["thick"] | POSE})
    state = lens_state(resolved, open_session(None))
    lines = [np.array(ray["points"]) for ray in panel.pointer(resolved, 0.3, 0.6)["rays"]]
    heights = [line[2, 1] + (line[3, 1] - line[2, 1]) / (line[2, 0] - line[3, 0]) * state.object_mm for line in lines]
    assert np.ptp(heights) < 0.05  # of points rounded to 1e-4 mm, 20 lengths away
    thin = load_scene({"film": {"resolution": [40, 20]}, "camera": CAMERAS["thin"] | POSE})
    lines = [np.array(ray["points"]) for ray in panel.pointer(thin, 0.3, 0.6)["rays"]]
    heights = [line[1, 1] + (line[2, 1] - line[1, 1]) / (line[1, 0] - line[2, 0]) * 2000 for line in lines]
    assert np.ptp(heights) < 0.05


def test_pointer_outside_the_picture_is_refused(panel: LensPanel) -> None:
    for place in ((-0.1, 0.5), (0.5, 1.01), (math.nan, 0.5)):
        with pytest.raises(InputError, match="outside"):
            panel.pointer(scene(), *place)


def test_lines_are_those_of_hydrogen_and_helium() -> None:
    assert pytest.approx((486.13, 587.56, 656.27), abs=0.01) == LINES_NM
