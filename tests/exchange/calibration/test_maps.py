"""Maps of a lens: there and back, against chief rays, quadrature and rays from points."""

import json
import sys

import numpy as np
import pytest
import yaml

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import lenses_dir
from rptcam_cl.exchange import camera_maps
from rptcam_cl.exchange.camera_maps import _over_plane, between, coc_map, point_images, st_maps, vignetting_map
from rptcam_cl.exchange.camera_models import subject, view
from rptcam_cl.optics.irradiance import film_irradiance
from rptcam_cl.rendering.cameras.lens_records import stop_shape
from rptcam_cl.scene.load import load_scene
from tests.support.cases import slow

ROUND_TRIP_PX = 0.02


def sampled(pixels, at):
    """Values between the centres of pixels, at places (n, 2) from the corner, as compositors take them."""
    x, y = (np.asarray(at, np.float64) - 0.5).T
    i = np.clip(np.floor(x).astype(int), 0, pixels.shape[1] - 2)
    j = np.clip(np.floor(y).astype(int), 0, pixels.shape[0] - 2)
    right, down = (x - i)[:, None], (y - j)[:, None]
    values = pixels.astype(np.float64)
    upper = values[j, i] * (1 - right) + values[j, i + 1] * right
    lower = values[j + 1, i] * (1 - right) + values[j + 1, i + 1] * right
    return upper * (1 - down) + lower * down


def places_of(values, size):
    """Places [pixels from the top left corner] of values of an ST map of Nuke, whose v counts from the bottom."""
    return np.stack([values[..., 0] * size[0], (1 - values[..., 1]) * size[1]], axis=-1)


@pytest.fixture(scope="module", params=[("dgauss-50mm", (36, 24)), ("fisheye-10mm", (21, 14))], ids=lambda p: p[0])
def bent(request):
    lens, film = request.param
    seen = view(subject(lens, size=(96, 64), film_mm=film))
    return seen, st_maps(seen)


@pytest.mark.parametrize(("good", "degree"), [(np.inf, 4), (1e-9, 6)])
def test_a_map_is_of_the_least_degree_that_is_good_enough(good, degree, monkeypatch):
    monkeypatch.setattr(camera_maps, "DEGREES", (4, 6))
    monkeypatch.setattr(camera_maps, "GOOD_PX", good)
    made = camera_maps.smooth_map(view(subject("dgauss-50mm", size=(96, 64), film_mm=(36, 24))))
    assert made.to_angles.coefficients.shape[0] == degree + 1


def test_st_maps_lead_there_and_back(bent):
    seen, maps = bent
    straight = maps.undistort.shape[1::-1]
    known = maps.distort[..., 2] > 0
    there = places_of(maps.distort[known], straight)
    back = sampled(maps.undistort, there)
    whole = back[:, 2] > 0.999
    rows, columns = np.nonzero(known)
    own = np.stack([columns + 0.5, rows + 0.5], axis=-1)
    off = np.linalg.norm(places_of(back, seen.size) - own, axis=1)[whole]
    assert whole.mean() > 0.95
    assert off.max() <= ROUND_TRIP_PX


def test_st_maps_follow_chief_rays(bent):
    seen, maps = bent
    places = np.array([[10.5, 8.5], [48.5, 32.5], [70.5, 55.5], [30.5, 60.5]])
    columns, rows = (places - 0.5).astype(int).T
    directions, _ = seen.directions(places)
    expected = directions[:, :2] / directions[:, 2:] * maps.focal_px + maps.centre_px
    found = places_of(maps.distort[rows, columns], maps.undistort.shape[1::-1])
    assert found == pytest.approx(expected, abs=0.01)
    assert maps.error_px < 0.005


def test_straight_picture_has_overscan_for_what_the_lens_shows(bent):
    seen, maps = bent
    columns, rows = maps.undistort.shape[1::-1]
    assert (columns, rows) > seen.size  # barrels, both
    assert maps.distort[32, 48, 2] == 1
    corner = maps.undistort[0, 0]
    assert corner[2] in (0, 1)
    assert corner[2] == 1 or corner[:2].tolist() == [-1, -1]
    assert maps.offset_px[0] == pytest.approx((columns - seen.size[0]) / 2, abs=1)


def test_vignetting_map_is_the_irradiance_of_each_pixel():
    seen = view(subject(LIGHT, size=(12, 8)))
    found, lens, back = vignetting_map(seen), seen.setting.lens, seen.setting.film_distance_mm
    expected = film_irradiance(lens, back, [0.0, np.hypot(1.5, 1.5), np.hypot(16.5, 10.5)])
    assert found[4, 6] == pytest.approx(expected[1] / expected[0], rel=1e-3)
    assert found[0, 0] == pytest.approx(expected[2] / expected[0], rel=2e-3)
    assert found == pytest.approx(found[::-1, ::-1], rel=1e-6)


@pytest.mark.slow
def test_vignetting_map_follows_the_edge_of_the_image_circle():
    seen = view(subject("cooke-triplet-50mm", ["camera.f_number=11"], size=(61, 1), film_mm=(60.0, 60.0 / 61)))
    found, lens, back = vignetting_map(seen)[0], seen.setting.lens, seen.setting.film_distance_mm
    columns = np.arange(52, 61)  # where the last rays are cut off
    expected = film_irradiance(lens, back, (columns - 30.0) * 60.0 / 61) / film_irradiance(lens, back, 0.0)
    assert expected.min() == 0.0 < 0.2 < expected.max()
    assert found[columns] == pytest.approx(expected, abs=1e-3)


class Plane:
    """What of a view says where its places lie: 3 x 2 mm, y upwards, the middle off the axis."""

    size = (60, 40)

    def film_points(self, places):
        x, y = np.asarray(places).T / 20
        return np.stack([x - 1.0, 0.75 - y, 0 * x], axis=1)


def test_values_over_a_plane_follow_their_function_where_it_bends():
    """A roof with a ridge along y = x / 3 and even slopes beside: its values at coarse nodes, and near the ridge at
    finer ones; straight lines join them elsewhere."""

    def roof(radius, degrees):
        x, y = radius * np.cos(np.radians(degrees)), radius * np.sin(np.radians(degrees))
        return float(2 + x / 2 - 2 * abs(y - x / 3))

    asked = []
    nodes = _over_plane(Plane(), lambda *given: asked.append(given) or roof(*given))
    assert nodes.shape == (25, 33)
    places = np.stack(np.meshgrid(np.linspace(0, 60, 33), np.linspace(0, 40, 25)), axis=-1)
    x, y, _ = Plane().film_points(places.reshape(-1, 2)).T
    np.testing.assert_allclose(nodes.ravel(), 2 + x / 2 - 2 * abs(y - x / 3), atol=1e-6)
    assert len(asked) == len(set(asked)) < 25 * 33 - 200


def test_values_between_nodes_lie_on_straight_lines():
    rows, columns = np.mgrid[:4, :5]
    found = between(3.0 * columns - 2.0 * rows + columns * rows, (8, 6))
    x, y = np.meshgrid((np.arange(8) + 0.5) / 8 * 4, (np.arange(6) + 0.5) / 6 * 3)
    np.testing.assert_allclose(found, 3 * x - 2 * y + x * y, atol=1e-12)


def test_vignetting_of_ideal_cameras_is_none_or_the_fourth_power_of_a_cosine():
    pinhole = {"kind": "pinhole", "eye": [0, 0, 0], "target": [0, 0, -1], "fov_degrees": 60}
    assert (vignetting_map(view(load_scene({"film": FILM, "camera": pinhole}))) == 1).all()
    seen = view(load_scene({"film": FILM, "camera": CAMERA | {"kind": "thick_lens"}}))
    lens = seen.setting.lens
    away = seen.setting.film_distance_mm - lens.first_order(seen.setting.camera.wavelength_nm).exit_pupil.distance_mm
    x, y = np.meshgrid((np.arange(60) - 29.5) * 0.6, (np.arange(40) - 19.5) * 0.6)
    np.testing.assert_allclose(vignetting_map(seen), np.cos(np.arctan(np.hypot(x, y) / away)) ** 4, rtol=1e-5)


def test_maps_that_no_picture_can_hold_are_refused(monkeypatch):
    tilted = CAMERA | {"movements": {"tilt_degrees": 3}}
    with pytest.raises(InputError, match="--vignetting: is known on a film across the axis alone"):
        vignetting_map(view(load_scene({"film": FILM, "camera": tilted})))
    monkeypatch.setattr("rptcam_cl.exchange.camera_maps.MOST_PIXELS", 60 * 40)
    with pytest.raises(InputError, match=r"straight picture of it would have \d+ x \d+ pixels \(allowed: 2400 in all"):
        st_maps(view(subject("fisheye-10mm", size=(60, 40), film_mm=(21, 14))))


@pytest.mark.slow
def test_vignetting_map_of_a_shaped_stop_follows_the_edge_too():
    film = {"resolution": [181, 181], "size_mm": [28.0, 28.0]}
    blades = {"lens": "fisheye-10mm", "f_number": 8, "aperture": {"shape": "polygon", "blades": 7}}
    crop = {"crop": [0.93, 1.0, 0.49, 0.51]}
    seen = view(load_scene({"film": film | crop, "camera": CAMERA | blades}))
    found, back = vignetting_map(seen), seen.setting.film_distance_mm
    lens = seen.setting.lens.with_stop_shape(stop_shape(seen.scene, seen.scene.camera.aperture))
    at = seen.film_points(np.array([[x + 0.5, 1.5] for x in range(seen.size[0])]))[:, :2]
    expected = [
        float(film_irradiance(lens, back, np.hypot(x, y), azimuth_degrees=np.degrees(np.arctan2(y, x)))) for x, y in at
    ] / film_irradiance(lens, back, 0.0)
    assert expected.min() == 0.0 < 0.2 < expected.max()
    assert found[1] == pytest.approx(expected, abs=2e-3)


LIGHT = "achromat-100mm"  # whose few surfaces are traced soon
FILM = {"resolution": [60, 40], "size_mm": [36.0, 24.0]}
CAMERA = {
    "kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 0, 0], "target": [0, 0, -1], "f_number": 4,
    "focus": {"distance_m": 1.3},
}  # fmt: skip


def test_kernels_sum_to_one_and_their_centroid_is_beside_the_chief_ray():
    seen = view(load_scene({"film": FILM | {"resolution": [600, 400]}, "camera": CAMERA}))
    found = point_images(seen, (3, 3), (486.13, 587.5618), (seen.distance_m, 2 * seen.distance_m), across=64)
    assert found.kernels.sum(axis=(-1, -2)) == pytest.approx(1.0, abs=1e-5)
    assert found.kept == pytest.approx(1.0)
    on_axis = found.centroids[1, 1]
    assert np.abs(on_axis).max() < 1e-6
    side = found.kernels.shape[-1]
    y, x = np.mgrid[:side, :side] - side // 2
    binned = np.stack([(found.kernels * x).sum(axis=(-1, -2)), (found.kernels * y).sum(axis=(-1, -2))], axis=-1)
    assert np.abs(binned - found.centroids).max() < 0.15  # pixels are coarser than the blur
    assert np.abs(found.centroids[..., 1, 0, :]).max() < 0.2  # coma at f/4, in focus
    mirrored = found.centroids[:, ::-1] * [-1, 1]
    assert found.centroids == pytest.approx(mirrored, abs=1e-6)


def test_circle_of_confusion_is_the_width_of_the_kernel():
    seen = view(load_scene({"film": FILM | {"resolution": [1200, 800]}, "camera": CAMERA}))
    pupil_to_front = seen.pupil_ahead_mm - seen.setting.lens.film_z(seen.setting.film_distance_mm)
    found = point_images(seen, (1, 1), (), (2.5,), across=96)
    side = found.kernels.shape[-1]
    y, x = np.mgrid[:side, :side] - side // 2
    width = np.sqrt(8 * (found.kernels[0, 0, 0, 0] * (x * x + y * y)).sum() - 8 / 6)  # less that of square pixels
    blur = coc_map(seen, (2.5 + pupil_to_front * 1e-3,))
    assert blur[0, 400, 600] == pytest.approx(width, rel=0.01)


@pytest.mark.parametrize(
    ("movements", "flip"), [({"shift_mm": -6, "rise_mm": 3}, False), slow({"swing_degrees": 4, "rise_mm": 3}, True)]
)
def test_circle_of_confusion_of_a_film_that_is_moved_is_that_of_its_own_side(movements, flip):
    camera = CAMERA | {"flip": flip, "movements": movements, "f_number": 2.8}
    seen = view(load_scene({"film": FILM | {"resolution": [300, 200]}, "camera": camera}))
    found = point_images(seen, (2, 2), (), (np.inf,), across=64)
    side = found.kernels.shape[-1]
    y, x = np.mgrid[:side, :side] - side // 2
    away = (x, y) - found.centroids[:, :, 0, 0, :, None, None]
    width = np.sqrt(8 * (found.kernels[:, :, 0, 0] * (away**2).sum(axis=2)).sum(axis=(-1, -2)) - 8 / 6)
    assert np.ptp(width) > 0.2 * width.mean()
    blur = coc_map(seen, (np.inf,))[0][np.ix_([50, 150], [75, 225])]
    np.testing.assert_allclose(blur, width, rtol=0.05)  # pixels are coarse


@pytest.mark.slow
def test_kernels_outside_of_the_image_circle_sum_to_nothing():
    seen = view(subject("fisheye-10mm", size=(60, 40), film_mm=(36.0, 24.0)))
    found = point_images(seen, (5, 3), across=24)
    sums, dark = found.kernels.sum(axis=(-1, -2))[..., 0, 0], ~seen.directions(found.places.reshape(-1, 2))[1]
    assert dark.any() and not dark.all()
    assert sums.ravel()[dark].tolist() == [0.0] * int(dark.sum())
    assert sums.ravel()[~dark] == pytest.approx(1.0, abs=1e-5)
    assert np.isnan(found.centroids[..., 0, 0, :]).all(axis=-1).ravel().tolist() == dark.tolist()


def test_maps_of_distances_far_away_are_written_and_the_header_is_json(tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps({"film": FILM, "camera": CAMERA}))
    words = ["--coc", str(tmp_path / "c.exr"), "--psf-grid", str(tmp_path / "p.npz"), "--psf-cells", "1x1"]
    assert main(["camera", str(scene), *words, "--distances-m", "0.8,inf"]) == 0
    with OpenEXR.File(str(tmp_path / "c.exr")) as file:
        header, channels = dict(file.header()), {name: one.pixels for name, one in file.channels().items()}

    def refused(name):
        raise ValueError(name)

    assert json.loads(header["distances_m"], parse_constant=refused) == [0.8, None]
    blur = coc_map(view(load_scene({"film": FILM, "camera": CAMERA})), (0.8, np.inf, 1e9))
    assert channels["coc.1"] == pytest.approx(blur[1])
    assert blur[1] == pytest.approx(blur[2], rel=1e-5)
    with np.load(tmp_path / "p.npz") as found:
        assert found["distances_m"].tolist() == [0.8, np.inf]


@pytest.mark.parametrize("distance", [0.0, -1.0, np.nan])
def test_maps_refuse_distances_that_are_none(distance):
    seen = view(load_scene({"film": FILM, "camera": CAMERA}))
    for made in (lambda: coc_map(seen, [1.0, distance]), lambda: point_images(seen, (1, 1), (), [distance], across=8)):
        with pytest.raises(InputError, match=r"^distances_m: is out of range .* allowed: above 0 m"):
            made()
    with pytest.raises(InputError, match="distances_m: is empty"):
        coc_map(seen, [])


def test_commands_write_maps_whole(tmp_path, capsys):
    OpenEXR = pytest.importorskip("OpenEXR")
    files = {
        "stmap-distort": "d.exr",
        "stmap-undistort": "u.exr",
        "vignetting": "v.exr",
        "coc": "c.exr",
        "psf-grid": "p.npz",
    }
    words = [word for name, file in files.items() for word in (f"--{name}", str(tmp_path / file))]
    scene = tmp_path / "scene.yaml"
    camera = CAMERA | {"lens": LIGHT, "f_number": 8}
    scene.write_text(json.dumps({"film": FILM | {"resolution": [24, 16]}, "camera": camera}))
    more = ["--distances-m", "1,2", "--psf-cells", "1x1"]
    assert main(["camera", str(scene), *words, *more]) == 0
    with OpenEXR.File(str(tmp_path / "u.exr")) as file:
        assert file.channels()["RGB"].pixels.dtype == np.float32
        said = dict(file.header())
    assert json.loads(said["picture_size"]) == [24, 16]
    assert json.loads(said["offset"])[0] >= 0
    with OpenEXR.File(str(tmp_path / "c.exr")) as file:
        assert set(file.channels()) == {"coc.0", "coc.1"}
    with np.load(tmp_path / "p.npz") as found:
        assert found["kernels"].shape[:4] == (1, 1, 1, 2)
    assert "wrote" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["dgauss-50mm", "--vignetting", "{0}/v.png"], "such a file is .exr"),
        (["dgauss-50mm", "--coc", "{0}/c.exr", "--distances-m", "0"], "above 0 m"),
        (["dgauss-50mm", "--coc", "{0}/c.exr", "--distances-m", "1,nan"], "above 0 m, as 0.8,2,inf"),
        (["dgauss-50mm", "--psf-grid", "{0}/p.npz", "--wavelengths", "100"], "from 200 to 3000 nm"),
        (["dgauss-50mm", "--size", "64x48", "--film", "4000x3000", "--stmap-distort", "{0}/d.exr"], "nothing to fit"),
    ],
)
def test_bad_maps_leave_nothing_behind(words, message, tmp_path, capsys):
    assert main(["camera", *(word.format(tmp_path) for word in words)]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_point_images_need_a_lens_and_an_odd_side():
    seen = view(load_scene({"film": FILM, "camera": CAMERA}))
    with pytest.raises(InputError, match="must be odd"):
        point_images(seen, (1, 1), pixels=4)
    thick = view(load_scene({"film": FILM, "camera": CAMERA | {"kind": "thick_lens"}}))
    with pytest.raises(InputError, match="needs a lens to trace"):
        point_images(thick)


def wide_fisheye(f_number=8, conic=0):
    """A view of the fisheye of the library with wider fronts, which sees to 95 degrees from its axis."""
    prescription = yaml.safe_load((lenses_dir() / "fisheye-10mm.yaml").read_text("utf-8"))
    for surface, diameter in zip(prescription["surfaces"], (60.0, 22.7, 30.0, 16.6), strict=False):
        surface["diameter"] = diameter
    prescription["surfaces"][0]["conic"] = conic
    camera = {
        "kind": "realistic", "lens": prescription, "f_number": f_number, "eye": [0, 0, 0], "target": [0, 0, -1],
        "focus": {"distance_m": 2},
    }  # fmt: skip
    return view(load_scene({"film": {"resolution": [2000, 200], "size_mm": [40.0, 4.0]}, "camera": camera}))


STEEP_CELLS, AWAY_M = (5, 1), (0.3, np.inf)


@pytest.mark.slow
def test_point_images_past_85_degrees_lie_on_their_chief_rays():
    seen = wide_fisheye()
    directions, lit = seen.directions(point_images(seen, STEEP_CELLS, across=8).places[0])
    assert lit.all() and np.degrees(np.arccos(directions[0, 2])) > 92.0
    wide, closed = (point_images(wide_fisheye(f), STEEP_CELLS, (), AWAY_M, across=48) for f in (8, 45))
    for found in (wide, closed):
        assert found.kernels.sum(axis=(-1, -2)) == pytest.approx(1.0, abs=1e-5)
        assert found.centroids == pytest.approx(found.centroids[:, ::-1] * [-1, 1], abs=1e-6)
    assert np.abs(closed.centroids).max() < 0.05 < np.abs(wide.centroids[:, 0, ..., 0]).min()  # coma [20 microns]


@pytest.mark.slow
def test_both_ways_of_spreading_rays_make_the_same_point_images(monkeypatch):
    seen = wide_fisheye()
    plane = point_images(seen, STEEP_CELLS, (), AWAY_M, 9, across=96)
    module = sys.modules["rptcam_cl.exchange.camera_maps"]
    monkeypatch.setattr(module, "is_steep", lambda degrees: degrees > 5)
    across = point_images(seen, STEEP_CELLS, (), AWAY_M, 9, across=96)
    flat = seen.directions(plane.places[0])[0][:, 2] > 0.1  # the outermost go the one way alone
    assert flat.sum() == 3
    assert np.abs(plane.centroids - across.centroids)[:, flat].max() < 0.01
    assert np.abs(plane.kernels - across.kernels)[:, flat].max() < 0.02
    assert np.abs(plane.centroids - across.centroids)[:, flat].max() > 0


def test_steep_point_images_need_a_first_surface_that_is_a_sphere():
    with pytest.raises(InputError, match="more than 85 degrees from the axis need a first surface that is spherical"):
        point_images(wide_fisheye(conic=0.01), STEEP_CELLS, across=8)
