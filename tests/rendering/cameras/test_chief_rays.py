"""Chief rays: through the middle of the opening, and back from points to the places that see them."""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.camera_models import view
from rptcam_cl.optics.lens import limiting_surface
from rptcam_cl.rendering.cameras import kinds
from rptcam_cl.rendering.cameras.chief_rays import PerspectiveRays, seen_places
from rptcam_cl.rendering.cameras.kinds import camera_model, camera_of
from rptcam_cl.rendering.cameras.model import CameraModel
from rptcam_cl.rendering.cameras.pupil import FilmGrid
from rptcam_cl.rendering.cameras.setting import lens_setting
from rptcam_cl.scene.camera import CameraKind
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.drives import focus_drive
from rptcam_cl.viewfinder.delivery import dial_list
from rptcam_cl.viewfinder.lens_panel import camera_numbers
from rptcam_cl.viewfinder.panel import Panel, focal_length_mm, read_dials
from tests.support.cases import fast

POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
MOVED = {"movements": {"tilt_degrees": 8, "rise_mm": 3}}
IDEAL: dict[str, dict[str, Any]] = {
    "pinhole": {"kind": "pinhole", "fov_degrees": 50},
    "pinhole inverted": {"kind": "pinhole", "fov_degrees": 50, "flip": False},
    "thin": {"kind": "thin_lens", "fov_degrees": 40, "aperture_radius_m": 0.2, "focus_distance_m": 4},
    "thin moved": {"kind": "thin_lens", "fov_degrees": 40, "aperture_radius_m": 0.2, "focus_distance_m": 4} | MOVED,
    "thick": {"kind": "thick_lens", "lens": "dgauss-50mm", "focus": {"distance_m": 4}},
}
LENSES = {"dgauss-50mm": 36, "fisheye-10mm": 24, "phone-5.6mm": 6, "anamorphic-100mm": 22, "mirror-500mm": 36}


def scene_of(camera: dict[str, Any], width_mm: float = 36) -> Scene:
    return load_scene({"film": {"resolution": [96, 48], "width_mm": width_mm}, "camera": camera | POSE, "objects": []})


def lens_scene(lens: str, **rest: Any) -> Scene:
    distance = 20 if lens == "mirror-500mm" else 4
    camera = {"kind": "realistic", "lens": lens, "focus": {"distance_m": distance}} | rest
    return scene_of(camera, LENSES[lens])


def places_of(step: int) -> np.ndarray:
    """Middles of pixels all over the picture."""
    return np.stack(np.meshgrid(np.arange(0, 96, step) + 0.5, np.arange(0, 48, step) + 0.5), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("name", IDEAL)
def test_ideal_cameras_project_as_their_intrinsics_say(name: str) -> None:
    scene, places = scene_of(IDEAL[name]), places_of(6)
    model = camera_model(scene)
    origins, directions = camera_of(scene).chief_rays().rays(places)
    pupil = np.array([0.0, 0.0, model.view.pupil_z_m])
    points = origins + directions * 7.0 - pupil
    said = model.metadata["intrinsics"]
    if "matrix" in said:
        x, y, w = np.array(said["matrix"]) @ (points * (1.0, 1.0, -1.0)).T
        seen = np.stack([x / w, y / w], axis=1)
    else:
        x, y, z = points.T
        seen = np.stack([said["cx"] - said["fx"] * x / z, said["cy"] + said["fy"] * y / z], axis=1)
    np.testing.assert_allclose(seen, places, atol=1e-9)


@pytest.mark.parametrize("lens", fast(LENSES.keys() - {"phone-5.6mm"}, LENSES))
def test_places_of_points_on_chief_rays_are_those_of_the_rays(lens: str) -> None:
    chief, places = camera_of(lens_scene(lens)).chief_rays(), places_of(5)
    origins, directions = chief.rays(places)
    good = np.isfinite(origins).all(axis=1)
    assert good.mean() > 0.6
    points = np.hstack([origins + 5.0 * directions, np.ones((len(places), 1))])[good]
    np.testing.assert_allclose(seen_places(chief, points), places[good], atol=1e-5)
    far = np.hstack([directions, np.zeros((len(places), 1))])[good]
    towards = chief.rays(seen_places(chief, far, places[good] + 2.0))[1]
    inner = np.isfinite(towards).all(axis=1)  # at the rim, what is at infinity may be seen where no chief ray passes
    np.testing.assert_allclose(towards[inner], far[inner, :3], atol=1e-8)


def test_chief_rays_cross_the_middle_of_the_stop() -> None:
    scene, places = lens_scene("dgauss-50mm"), places_of(8)
    setting = lens_setting(scene)
    origins, directions = camera_of(scene).chief_rays().rays(places)
    lens, stop = setting.lens, limiting_surface(setting.lens, setting.camera.wavelength_nm)
    origin_mm = origins * 1e3 + [0, 0, lens.film_z(setting.film_distance_mm)]
    from dataclasses import replace

    front = replace(lens, surfaces=lens.surfaces[: stop + 1])
    there = front.trace(origin_mm + 50 * directions, -directions, setting.camera.wavelength_nm, start="scene")
    assert there.passed.all()
    assert np.abs(there.origins[:, :2]).max() < 1e-4 * lens.surfaces[stop].semi_diameter  # [mm]


def test_no_chief_ray_passes_beside_the_image_circle() -> None:
    wide = scene_of({"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 4}}, width_mm=90)
    origins, directions = camera_of(wide).chief_rays().rays(np.array([[48.0, 24.0], [0.5, 0.5]]))
    assert np.isfinite(origins[0]).all()
    assert np.isnan(origins[1]).all()
    assert np.isnan(directions[1]).all()


@pytest.mark.parametrize("name", ["pinhole", "dgauss-50mm"])
def test_what_lies_behind_the_camera_is_seen_nowhere(name: str) -> None:
    chief = camera_of(scene_of(IDEAL[name]) if name in IDEAL else lens_scene(name)).chief_rays()
    behind = np.array([[0.1, 0.2, 3.0, 1.0], [0.0, 0.0, 1.0, 0.0], [np.nan, 0.0, -1.0, 1.0]])
    assert np.isnan(seen_places(chief, behind)).all()
    assert seen_places(chief, behind[:0]).shape == (0, 2)


def test_points_are_found_where_rays_are_parallel_as_well() -> None:
    scene, per_mm = scene_of(IDEAL["pinhole"]), 0.08
    chief = PerspectiveRays(scene, -per_mm, 0.0, 0.0, 0.0)  # all rays look ahead, from places of a plane
    half_m = per_mm * 500 * np.array(scene.film.size_m())
    points = np.array([[share * half_m[0], -share * half_m[1], -near] for share in (0.1, 0.9) for near in (0.2, 7.0)])
    expected = (np.array([[share, share] for share in (0.1, 0.1, 0.9, 0.9)]) + 1) / 2 * scene.film.resolution
    found = seen_places(chief, np.hstack([points, np.ones((4, 1))]))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_environment_camera_sees_every_direction() -> None:
    chief, places = camera_of(scene_of({"kind": "environment"})).chief_rays(), places_of(5)
    origins, directions = chief.rays(places)
    assert not origins.any()
    np.testing.assert_allclose(seen_places(chief, np.hstack([directions, np.zeros((len(places), 1))])), places)


def test_a_grid_gives_cubics_exactly_and_continues_parabolas() -> None:
    sides = np.linspace(-1.25, 1.25, 11)
    x, y = np.meshgrid(sides, sides)
    values = np.stack([x**3 - 2 * x * y**2 + y, x**2 + x * y - y**2], axis=-1)
    rng = np.random.default_rng(4)
    places = rng.uniform(-1.2, 1.2, (50, 2))
    a, b = places.T
    expected = np.stack([a**3 - 2 * a * b**2 + b, a**2 + a * b - b**2], axis=-1)
    np.testing.assert_allclose(FilmGrid(values, 1.25).at(places), expected, atol=1e-12)
    holed = values.copy()
    holed[np.hypot(x, y) > 1.1] = np.nan
    np.testing.assert_allclose(FilmGrid(holed, 1.25).at(places)[:, 1], expected[:, 1], atol=1e-12)
    assert np.isnan(FilmGrid(values, 1.25).at(np.array([[1.3, 0.0]]))).all()


class Throwaway(CameraKind):
    """A camera of a kind that has keys and nothing else."""

    kind: Literal["throwaway"]


class ThrowawayOptics(kinds.CameraOptics):
    """What it needs to be rendered, and nothing else."""

    def model(self, lens_colour: Any = "off", coarse: bool = False, windows: Any = ()) -> CameraModel:
        return camera_model(scene_of({"kind": "environment"}))


def throwaway() -> Scene:
    scene = scene_of(IDEAL["pinhole"])
    pose = {name: getattr(scene.camera, name) for name in ("eye", "target", "up")}
    return scene.model_copy(update={"camera": Throwaway(kind="throwaway", **pose)})


@pytest.mark.parametrize("door", [camera_model, camera_of, view, focal_length_mm])
def test_a_kind_without_optics_is_refused(door: Callable[[Scene], object]) -> None:
    with pytest.raises(InputError, match=r"camera.kind: throwaway lacks its optics"):
        door(throwaway())


@pytest.mark.parametrize(
    ("door", "message"),
    [
        (lambda scene: camera_of(scene).chief_rays(), "camera.kind: throwaway lacks its chief rays"),
        (lambda scene: camera_of(scene).film_pupils(), "camera.diffraction: the camera has no opening that diffracts"),
        (lambda scene: camera_of(scene).pupil_rays(np.zeros((1, 2))), "camera.kind: throwaway has no pupil"),
        (lambda scene: camera_of(scene).intrinsics(), "camera.kind: throwaway lacks intrinsics"),
        (focus_drive, "camera.kind: throwaway: everything it sees is sharp"),
        (view, "camera.kind: throwaway lacks an entrance pupil"),
        (lens_setting, "camera.kind: throwaway lacks a lens of surfaces"),
        (lambda scene: scene.camera.focus_keys(2.0), "camera.kind: throwaway lacks a focus to set"),
    ],
)
def test_a_kind_says_what_it_lacks(
    door: Callable[[Scene], object], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(kinds._KINDS, "throwaway", ThrowawayOptics)
    with pytest.raises(InputError, match=message):
        door(throwaway())


def test_a_new_kind_has_dials_and_numbers_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(kinds._KINDS, "throwaway", ThrowawayOptics)
    scene = throwaway()
    assert camera_model(scene).kernel == "camera/environment.h"
    assert focal_length_mm(scene) is None
    entries = {entry["name"]: entry for entry in dial_list(Panel(read_dials(scene), scene, scene))}
    assert not entries["focus_m"]["enabled"] and not entries["zoom"]["enabled"]
    assert camera_numbers(scene)["f_number"] is None
