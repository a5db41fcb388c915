"""Tables that aim camera rays at lamps out of focus: their places in the pupil do lead to the lamp, by exact rays."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.rendering.cameras import lamp_aim
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.cameras.lamp_aim import SeenLamp, aimed_at_lamps
from rptcam_cl.rendering.cameras.setting import lens_setting
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene
from tests.device.probes import camera_rays
from tests.support.cases import slow
from tests.support.statistics import Z, moment_scores

LAMP = 18  # floats of a lamp in a block
RADIUS = 0.004
EYE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
REALISTIC = EYE | {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 1.0}}
THIN = EYE | {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 2, "focus_distance_m": 1.0}
ON_FILM = {"centre": [0.0, 0.0, -3.0], "aside": [0.15, -0.1, -2.5]}


def scene_with(camera):
    return load_scene({"camera": camera, "film": {"resolution": [96, 64], "width_mm": 9}})


def round_lamp(centre):
    return SeenLamp(np.array(centre), np.array([[RADIUS, 0, 0], [0, RADIUS, 0]]), True, 200.0)


def everything(sights):
    return np.ones(len(sights.origins), dtype=bool)


def blocks_of(model):
    """Middle of each block on the film, in the kernel's coordinates, and its lamp."""
    record = model.record[0]
    table = model.tables[record["lamp_table"] :].astype(np.float64)
    across, down = int(record["lamp_across"]), int(record["lamp_down"])
    size = 1 << int(record["lamp_shift"])
    for block in range(across * down):
        first, count = (int(value) for value in table[1 + 2 * block : 3 + 2 * block])
        column, row = (block % across + 0.5) * size, (block // across + 0.5) * size
        place = np.array([2 * column / 96 - 1, 1 - 2 * row / 64]) * model.reach.film_scale
        for k in range(count):
            yield place, table[first + k * LAMP : first + (k + 1) * LAMP]


def seen_through(lamp, film):
    return lamp[[1, 4]] + lamp[[2, 3, 5, 6]].reshape(2, 2) @ film


@pytest.mark.parametrize(
    "lamp",
    [
        {"shape": "sphere", "center": [0, 0, 0], "radius": 2},
        {"shape": "sphere", "center": [0, 0, 0], "radius": 2, "transform": {"scale": [1, 1, 0.5]}},
        {"shape": "box", "min": [-2, -2, -2], "max": [2, 2, 2]},
        {"shape": "cylinder", "base": [0, 0, -2], "top": [0, 0, 2], "radius": 2, "capped": False},
    ],
    ids=["sphere", "ellipsoid", "box", "cylinder"],
)
def test_lamps_with_the_eye_in_their_middle_are_left_out(lamp):
    shining = lamp | {"material": {"kind": "emissive", "radiance": 1, "two_sided": True}}
    with np.errstate(invalid="raise"):
        assert make_plan(load_scene({"camera": THIN, "objects": [shining]})).emitters.seen == ()


@pytest.mark.parametrize("centre", ON_FILM.values(), ids=ON_FILM)
def test_rays_through_the_middle_of_a_lamp_in_the_pupil_meet_the_lamp(centre):
    scene = scene_with(REALISTIC)
    model = aimed_at_lamps(camera_model(scene), [round_lamp(centre)], everything)
    found = list(blocks_of(model))
    assert len(found) > 20
    film, aims = np.array([place for place, _ in found]), np.array([seen_through(lamp, place) for place, lamp in found])
    setting = lens_setting(scene)
    lens, back = setting.lens, setting.film_distance_mm
    start = np.column_stack([film, np.full(len(film), lens.film_z(back))])
    rays = lens.trace(start, np.column_stack([aims - film, np.full(len(film), -back)]), 587.56)
    assert rays.passed.sum() > 20
    ahead = (centre[2] * 1e3 + lens.film_z(back) - rays.origins[:, 2]) / rays.directions[:, 2]
    there = rays.origins[:, :2] + rays.directions[:, :2] * ahead[:, None]
    off = np.linalg.norm(there * 1e-3 - centre[:2], axis=1)[rays.passed]
    assert np.quantile(off, 0.9) < RADIUS  # but for rims, where the lens folds its light
    assert np.median(off) < 0.3 * RADIUS


def test_a_thin_lens_sees_a_point_through_the_place_that_first_order_optics_gives():
    centre = np.array([0.2, 0.1, -3.0])
    model = aimed_at_lamps(camera_model(scene_with(THIN)), [round_lamp(centre)], everything)
    found = list(blocks_of(model))
    assert found
    for tangents, lamp in found:
        on_lens = (centre[:2] - tangents * 3.0) / (1 - 3.0 / 1.0)  # of the ray that meets tangents * 1 m in focus
        assert seen_through(lamp, tangents) == pytest.approx(on_lens / 0.0125, abs=1e-4)


def test_shares_are_the_same_in_light_of_another_unit():
    """They go by what the disk brings beside a tenth of grey, but at most beside 0.02 of white."""

    def shares(unit, irradiance):
        lamp = replace(round_lamp([0.2, 0.1, -3.0]), radiance=unit * 200.0)
        model = aimed_at_lamps(camera_model(scene_with(THIN)), [lamp], everything, irradiance=unit * irradiance)
        return np.array([lamp[0] for _, lamp in blocks_of(model)])

    dim = shares(1.0, 1.0)
    assert 0.3 < dim.max() < 0.7
    for digits in (-90, -20):
        np.testing.assert_array_equal(shares(2.0**digits, 1.0), dim)
    assert np.all(shares(1.0, 0.01) > dim) and np.all(dim > shares(1.0, 100.0))
    np.testing.assert_array_equal(shares(1.0, 100.0), shares(1.0, np.inf))


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"lights": [{"kind": "point", "position": [0, 3, -1], "intensity": [5, 5, 5]}]}, 5 / 10),
        ({"lights": [{"kind": "sun", "direction": [0, -1, 0], "irradiance": [5, 5, 5]}]}, 5),
        ({"lights": [{"kind": "directional", "direction": [0, -1, 0], "irradiance": [5, 5, 5]}]}, 5),
        ({"environment": {"kind": "constant", "radiance": 5}}, 5 * np.pi),
        ({"environment": {"kind": "gradient", "bottom": 2, "top": 8}}, 5 * np.pi),
        ({"objects": [{"shape": "sphere", "center": [0, 3, -1], "radius": 0.1,
                       "material": {"kind": "emissive", "radiance": 5}}]}, 5 * np.pi * 0.01 / 10),
        ({}, 0),
    ],
)  # fmt: skip
def test_irradiance_of_the_eye(keys, expected):
    seen = {"shape": "sphere", "center": [0, 0, -3], "radius": RADIUS, "material": {"kind": "emissive", "radiance": 1}}
    scene = load_scene({"camera": THIN} | keys | {"objects": [seen, *keys.get("objects", [])]})
    assert make_plan(scene).emitters.irradiance == pytest.approx(expected, rel=0.01, abs=1e-4)


def test_shares_stay_below_one_however_many_lamps_a_pixel_sees():
    lamps = [round_lamp([0.01 * i, 0.0, -3.0]) for i in range(12)]
    model = aimed_at_lamps(camera_model(scene_with(THIN)), lamps, everything)
    sums: dict[tuple[float, float], float] = {}
    for place, lamp in blocks_of(model):
        sums[tuple(place)] = sums.get(tuple(place), 0.0) + lamp[0]
    assert 0.6 < max(sums.values()) <= 0.7
    assert model.metadata["lamps_aimed_at"] == 12


@pytest.mark.parametrize(
    ("camera", "radius"), [(THIN, 0.0125), slow(THIN | {"aperture": {"shape": "polygon", "blades": 5}}, 0.0125)],
    ids=["round", "polygon"],
)  # fmt: skip
def test_rays_that_aim_at_lamps_weigh_as_if_all_filled_the_pupil_evenly(session, camera, radius):
    lamps = [round_lamp([0, 0, -3.0]), round_lamp([0.01, -0.005, -2.5])]
    scene = set_keys(scene_with(camera), {"film.resolution": [24, 16], "film.width_mm": 0.5})
    rays = camera_rays(session, scene, 1024, change=lambda model: aimed_at_lamps(model, lamps, everything))
    x, y = rays.origin[:, :2].T / radius
    blades = 5 if "aperture" in camera else 0
    mean = (2 + np.cos(2 * np.pi / blades)) / 12 if blades else 1 / 4  # of x^2
    moments = np.stack([np.ones(len(x)), x, y, x**2, y**2, x * y], 1) * rays.weight[:, None]
    assert np.abs(moment_scores(moments, [1, 0, 0, mean, mean, 0])).max() < Z
    ahead = rays.origin + rays.direction * ((-3.0 - rays.origin[:, 2]) / rays.direction[:, 2])[:, None]
    meet = np.hypot(*ahead[:, :2].T) < RADIUS  # the lamp on the axis, through 3 % of the pupil
    assert 0.2 < meet.mean() < 0.6
    assert rays.weight[meet].max() < 0.2


@pytest.mark.parametrize(
    "lamp",
    [
        round_lamp([0, 0, -1.0]),  # in focus
        round_lamp([0, 0, 3.0]),  # behind the camera
        round_lamp([9.0, 0, -3.0]),  # beside the picture
    ],
    ids=["in focus", "behind", "beside"],
)
@pytest.mark.parametrize("camera", [THIN, REALISTIC], ids=["thin", "realistic"])
def test_lamps_that_other_rays_find_or_none_change_nothing(camera, lamp):
    model = camera_model(scene_with(camera))
    assert aimed_at_lamps(model, [lamp], everything) is model


def test_hidden_lamps_change_nothing():
    model = camera_model(scene_with(THIN))
    hidden = aimed_at_lamps(model, [round_lamp([0, 0, -3.0])], lambda sights: ~everything(sights))
    assert hidden is model


class FoundAnewError(Exception):
    """Tables that were to be kept."""


@pytest.mark.parametrize("camera", [THIN, REALISTIC, REALISTIC | {"kind": "thick_lens"}], ids=["thin", "lens", "thick"])
@pytest.mark.parametrize("shows", [True, False])
def test_tables_are_kept_for_the_same_camera_lamps_and_sights_alone(monkeypatch, tmp_path, camera, shows):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    lamp_aim._seen_lamps.clear()
    lamp, model = round_lamp([0, 0, -3.0]), camera_model(scene_with(camera))
    made = aimed_at_lamps(model, [lamp], lambda sights: everything(sights) & shows, "sights")
    assert (made is not model) == shows

    def refuse(*_):
        raise FoundAnewError

    monkeypatch.setattr(lamp_aim, "_seen", refuse)
    lamp_aim._seen_lamps.clear()
    kept = aimed_at_lamps(camera_model(scene_with(camera)), [lamp], everything, "sights")
    for name in ("record", "tables"):
        assert getattr(kept, name).tobytes() == getattr(made, name).tobytes()
    assert (kept.facts, kept.metadata) == (made.facts, made.metadata)

    nearer = camera_model(scene_with(camera | {"f_number": 4}))
    others = [(nearer, [lamp]), (model, [replace(lamp, radiance=1.0)]), (model, [lamp, lamp])]
    for other, lamps in others:
        with pytest.raises(FoundAnewError):
            aimed_at_lamps(other, lamps, everything, "sights")
    for sights in ("others", None):
        with pytest.raises(FoundAnewError):
            aimed_at_lamps(model, [lamp], everything, sights)
    for file in (tmp_path / lamp_aim._DISK.kind).iterdir():
        file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(FoundAnewError):
        aimed_at_lamps(model, [lamp], everything, "sights")


@pytest.mark.parametrize("camera", [THIN, REALISTIC], ids=["thin", "lens"])
def test_lamps_that_shine_in_another_way_are_found_where_they_were(monkeypatch, camera):
    lamp_aim._seen_lamps.clear()
    lamp, model = round_lamp([0, 0, -3.0]), camera_model(scene_with(camera))
    dim = [replace(lamp, radiance=1.0)]
    expected = aimed_at_lamps(model, dim, everything)
    bright = aimed_at_lamps(model, [lamp], everything, "sights", on_disk=False)

    def refuse(*_):
        raise FoundAnewError

    monkeypatch.setattr(lamp_aim, "_seen", refuse)
    found = aimed_at_lamps(model, dim, everything, "sights", on_disk=False)
    assert found.tables.tobytes() == expected.tables.tobytes() != bright.tables.tobytes()
    for other, lamps, sights in ((model, [round_lamp([0.1, 0, -3.0])], "sights"), (model, [lamp], "others")):
        with pytest.raises(FoundAnewError):
            aimed_at_lamps(other, lamps, everything, sights, on_disk=False)


@pytest.mark.parametrize("camera", [THIN, REALISTIC, REALISTIC | {"kind": "thick_lens"}], ids=["thin", "lens", "thick"])
def test_a_film_of_another_size_sees_lamps_through_the_same_places(monkeypatch, camera):
    lamps = [round_lamp([0, 0, -3.0]), round_lamp([0.15, -0.1, -2.5])]
    wide = scene_with(camera)
    narrow = camera_model(set_keys(wide, {"film.width_mm": 7.5}))
    lamp_aim._small_lamp_fits.clear()
    expected = aimed_at_lamps(narrow, lamps, everything)
    lamp_aim._small_lamp_fits.clear()
    before = aimed_at_lamps(camera_model(wide), lamps, everything)

    def refuse(*_):
        raise FoundAnewError

    monkeypatch.setattr(lamp_aim, "fits_of_small", refuse)
    found = aimed_at_lamps(narrow, lamps, everything)
    assert found.tables.tobytes() == expected.tables.tobytes() != before.tables.tobytes()
    stopped = {"camera.f_number": 4}
    with pytest.raises(FoundAnewError):
        aimed_at_lamps(camera_model(set_keys(wide, stopped)), lamps, everything)
    with pytest.raises(FoundAnewError):
        aimed_at_lamps(narrow, lamps[:1], everything)
