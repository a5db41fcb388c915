"""Photons of caustics: the same light as paths find, closed forms, and the same bits however a render is cut."""

import math

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.photon_map import PhotonMap
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.load import load_scene
from tests.rendering.pictures import batches, looking, pixels, scene_of
from tests.support.statistics import overall

GREY = {"kind": "matte", "reflectance": [0.7, 0.5, 0.3]}
GLASS = {"kind": "dielectric", "index": 1.5}
FLOOR = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": GREY}
ABOVE = looking([0, -0.5, 0.6], [0, 0, 0])


def lamp(radius=0.12, radiance=10.0):
    emitting = {"kind": "emissive", "radiance": [radiance] * 3}
    return {"shape": "sphere", "center": [0.3, 0.2, 0.6], "radius": radius, "material": emitting}


def ball(**material):
    return {"shape": "sphere", "center": [0, 0, 0.08], "radius": 0.06, "material": GLASS | material}


def scene(*objects, caustics="on", size=(32, 32), **rest):
    made = scene_of([FLOOR, *objects], rest.pop("camera", ABOVE), resolution=size, **rest)
    made["render"]["caustics"] = caustics
    return made


def glasses(**rest):
    """Glass, a mirror and a pane, lit by one lamp."""
    mirror = {"shape": "rectangle", "corner": [-0.2, 0.2, 0.02], "edge_u": [0.4, 0, 0], "edge_v": [0, 0.05, 0.2],
              "material": {"kind": "mirror", "reflectance": [0.9, 0.8, 0.7]}}  # fmt: skip
    pane = {"shape": "disk", "center": [0.15, -0.05, 0.1], "normal": [0.3, 0, 1], "radius": 0.05,
            "material": {"kind": "thin_glass"}}  # fmt: skip
    return scene(lamp(), ball(absorption_per_m=[1, 5, 20]), mirror, pane, **rest)


def difference_in_errors(one, other):
    a, b = overall(one), overall(other)
    return (a.mean - b.mean) / np.sqrt(a.variance + b.variance)


@pytest.mark.slow
def test_photons_bring_the_light_that_paths_find():
    name = "photons against paths"
    with_photons, by_paths = (batches(glasses(caustics=c), f"{name} {c}", 8, spp=128) for c in ("on", "off"))
    found = difference_in_errors(with_photons, by_paths)
    assert np.all(np.abs(found) < 4), found


# A point lamp over a pane; beside it a wall of mirror, which lights a point that a card hides from the lamp.
LAMP = {"kind": "point", "position": [0, 0, 1], "intensity": [3.0, 3.0, 3.0]}
PANE = {"shape": "rectangle", "corner": [-0.05, -0.05, 0.5], "edge_u": [0.1, 0, 0], "edge_v": [0, 0.1, 0],
        "material": {"kind": "thin_glass", "index": 1.7}}  # fmt: skip
MIRROR = {"shape": "rectangle", "corner": [1, -0.05, 0.28], "edge_u": [0, 0.1, 0], "edge_v": [0, 0, 0.1],
          "material": {"kind": "mirror", "reflectance": [0.9, 0.6, 0.3]}}  # fmt: skip
CARD = {"shape": "rectangle", "corner": [0.11, -0.1, 0.7], "edge_u": [0.08, 0, 0], "edge_v": [0, 0.2, 0],
        "material": GREY}  # fmt: skip


@pytest.mark.parametrize(
    ("eye", "foot", "irradiance"),
    [
        # of a pane of index n, 2 n / (n² + 1) is left at normal incidence
        pytest.param([0.1, 0, 0.4], [0, 0, 0], np.full(3, 3.0 * 2 * 1.7 / (1.7**2 + 1)), id="lamp behind a pane"),
        # the image of the lamp stands at (2, 0, 1)
        pytest.param([0.6, 0, 0.4], [0.5, 0, 0], 3.0 / 3.25**1.5 * np.array([0.9, 0.6, 0.3]), id="wall of mirror"),
    ],
)
def test_light_of_a_lamp_without_size_is_the_closed_form(eye, foot, irradiance):
    made = scene(PANE, MIRROR, CARD, camera=looking(eye, foot, fov=4), lights=[LAMP], size=(16, 16), depth=3)
    film = pixels(made, spp=1024, seed=1)
    expected = np.array(GREY["reflectance"]) / math.pi * irradiance
    assert film.mean(axis=(0, 1)) == pytest.approx(expected, rel=0.01)  # five times the noise


SUN = {"kind": "sun", "direction": [0.6, 0, -0.8], "irradiance": [2.0, 2.0, 2.0], "diameter_degrees": 0.5}
ROOF = PANE | {"corner": [-9, -9, 0.6], "edge_u": [18, 0, 0], "edge_v": [0, 18, 0]}


@pytest.mark.parametrize("share_of_mirror", [1.0, 0.0], ids=["sun in a mirror", "sun alone"])
def test_light_of_the_sun_through_a_pane_is_the_closed_form(share_of_mirror):
    """Photons bring what a mirror sends on of it, light samples the rest."""
    wall = MIRROR | {"corner": [1, -0.2, 0.05], "edge_u": [0, 0.4, 0], "edge_v": [0, 0, 0.2]}
    x = 0.8875 if share_of_mirror else 0.6
    camera = looking([x, -0.4, 0.4], [x, 0, 0], fov=4)
    made = scene(ROOF, wall, camera=camera, lights=[SUN], size=(16, 16), depth=3 + int(share_of_mirror))
    film = pixels(made, spp=1024, seed=1)
    inside = math.sqrt(1 - (0.6 / 1.7) ** 2)
    across, along = (0.8 - 1.7 * inside) / (0.8 + 1.7 * inside), (1.7 * 0.8 - inside) / (1.7 * 0.8 + inside)
    reflected = (across**2 + along**2) / 2  # by each face, of light that has no polarisation
    passed = (1 - reflected) / (1 + reflected)
    by_mirror = share_of_mirror * np.array([0.9, 0.6, 0.3])
    expected = np.array(GREY["reflectance"]) / math.pi * 2.0 * 0.8 * passed * (1 + by_mirror)
    assert film.mean(axis=(0, 1)) == pytest.approx(expected, rel=0.01 if share_of_mirror else 2e-4)


@pytest.mark.slow
def test_a_room_with_a_window_has_the_light_of_paths():
    """Panes before and behind glass, mirrors and a thin bubble; a low sun as wide as paths find by chance."""
    low = SUN | {"direction": [1, 0.2, -0.7], "diameter_degrees": 25}
    window = {"shape": "rectangle", "corner": [-0.4, -1, 0], "edge_u": [0, 2, 0], "edge_v": [0, 0, 1.5]}
    inner = window | {"corner": [0.05, -0.3, 0.02], "edge_u": [0, 0.3, 0], "edge_v": [0, 0, 0.2]}
    bubble = {"shape": "sphere", "center": [-0.15, 0.15, 0.2], "radius": 0.06}
    mirror = {"shape": "disk", "center": [0.2, 0.2, 0.3], "normal": [-1, -0.3, -0.3], "radius": 0.1}
    thin, shiny = {"kind": "thin_glass", "index": 1.7}, {"kind": "mirror", "reflectance": 0.9}
    objects = [window | {"material": thin}, inner | {"material": thin}, bubble | {"material": thin}, ball(),
               mirror | {"material": shiny}]  # fmt: skip
    with_photons, by_paths = (
        batches(scene(*objects, caustics=c, lights=[low], size=(24, 16), depth=8), f"window {c}", 8, spp=spp)
        for c, spp in (("on", 256), ("off", 1024))
    )
    assert make_plan(load_scene(scene(*objects, lights=[low]))).facts["PANES_BY_SAMPLES"] == 1
    found = difference_in_errors(with_photons, by_paths)
    assert np.all(np.abs(found) < 4), found


def test_photons_start_where_light_comes_from_that_ends_on_receivers(monkeypatch):
    """Not on a mirror that the lamp shines at from behind, nor on a mesh of glass in its shadow."""
    passes, traced = [], PhotonMap._trace

    def kept(photon_map, number, count, *rest, **named):
        parts = traced(photon_map, number, count, *rest, **named)
        passes.append((count, np.concatenate(parts)))
        return parts

    monkeypatch.setattr(PhotonMap, "_trace", kept)
    board = {"shape": "rectangle", "corner": [-1, -1, 0.3], "edge_u": [2, 0, 0], "edge_v": [0, 0.9, 0]}
    corners = [[-0.5, -0.9, 0.2], [0.5, -0.9, 0.2], [0, -0.5, 0.2]]
    hidden = {"shape": "mesh", "vertices": corners, "faces": [[0, 1, 2]], "material": {"kind": "thin_glass"}}
    mirror = {
        "shape": "disk",
        "center": [-1, 0, 0.3],
        "normal": [1, 0, 0],
        "radius": 0.3,
        "material": {"kind": "mirror"},
    }
    tall = {"shape": "rectangle", "corner": [-0.9, -1, 0], "edge_u": [0, 2, 0], "edge_v": [0, 0, 2]}
    made = scene(lamp(0.02), ball(), hidden, mirror, board | {"material": GREY}, tall | {"material": GREY}, size=(8, 8))
    assert np.isfinite(pixels(made, spp=1)).all()
    (count, by_area), (more, learned), *_ = passes
    assert len(by_area) < 0.12 * count and len(learned) > 0.4 * more
    power, again = (each[:, 3:6].sum(axis=0, dtype=np.float64) for each in (by_area, learned))
    assert power == pytest.approx(again, rel=0.05)


@pytest.mark.slow
def test_a_principled_floor_takes_photons():
    made = scene(PANE, camera=looking([0.1, 0, 0.4], [0, 0, 0], fov=4), lights=[LAMP], size=(16, 16), depth=3)
    dull = {"kind": "principled", "base_color": GREY["reflectance"], "specular": 0}  # what is left of it is matte
    made["objects"][0] = FLOOR | {"material": dull}
    film = pixels(made, spp=1024, seed=1)
    expected = np.array(GREY["reflectance"]) / math.pi * 3.0 * 2 * 1.7 / (1.7**2 + 1)
    assert film.mean(axis=(0, 1)) == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_a_mirror_of_slanted_normals_sends_the_sun_where_they_say():
    """A beam that they turn lights the floor as if the mirror stood so: the beam counts, and its slant there."""
    normal, down = np.array([-1, 0, 0.3]) / math.hypot(1, 0.3), np.array([0.6, 0, -0.8])
    wall = {"shape": "mesh", "vertices": [[1, -0.2, 0.05], [1, 0.2, 0.05], [1, 0.2, 0.25], [1, -0.2, 0.25]],
            "faces": [[0, 2, 1], [0, 3, 2]], "normals": [normal.tolist()] * 4,
            "material": {"kind": "mirror", "reflectance": [0.9, 0.6, 0.3]}}  # fmt: skip
    sun = {"kind": "directional", "direction": down.tolist(), "irradiance": [2.0, 2.0, 2.0]}
    camera = looking([0.58, -0.4, 0.4], [0.58, 0, 0], fov=4)
    film = pixels(scene(wall, camera=camera, lights=[sun], size=(16, 16), depth=3), spp=512, seed=1)
    slant = -(down - 2 * (down @ normal) * normal)[2]
    expected = np.array(GREY["reflectance"]) / math.pi * 2.0 * (0.8 + slant * np.array([0.9, 0.6, 0.3]))
    assert film.mean(axis=(0, 1)) == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_floor_in_water_gets_what_the_water_leaves():
    # index 1: light goes straight on, 0.1 m of it in the water; of the way to the eye a path counts nothing
    water = {"kind": "dielectric", "index": 1.0, "absorption_per_m": [0, 3, 10]}
    pool = {"shape": "box", "min": [-0.1, -0.1, -0.1], "max": [0.1, 0.1, 0.1], "material": water}
    camera = looking([0.1, 0, 0.4], [0, 0, 0], fov=4)
    film = pixels(scene(pool, camera=camera, lights=[LAMP], size=(16, 16), depth=4), spp=512, seed=1)
    expected = np.array(GREY["reflectance"]) / math.pi * 3.0 * np.exp([0, -0.3, -1.0])
    assert film.mean(axis=(0, 1)) == pytest.approx(expected, rel=0.01)


AIR = {"kind": "dielectric", "index": 1.0}
SOLIDS = {
    "sphere": {"shape": "sphere", "center": [0, 0, 0.1], "radius": 0.05},
    "ellipsoid": {"shape": "sphere", "center": [0, 0, 0], "radius": 0.05,
                  "transform": [{"scale": [1, 1.4, 0.6]}, {"translate": [0.3, 0, 0.1]}]},
    "cylinder": {"shape": "cylinder", "base": [0.56, 0, 0.1], "top": [0.64, 0, 0.1], "radius": 0.04},
    "cone": {"shape": "cone", "base": [0.9, 0, 0.05], "apex": [0.9, 0, 0.15], "radius": 0.05},
    "disk": {"shape": "disk", "center": [1.2, 0, 0.1], "normal": [0.2, 0, 1], "radius": 0.05},
    "box": {"shape": "box", "min": [1.46, -0.05, 0.05], "max": [1.54, 0.05, 0.15]},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("shape", SOLIDS)
def test_solid_of_index_1_takes_no_light_from_the_floor_behind_it(shape):
    """Whatever its shape: photons that start all over it, by its area, bring what would come without it."""
    place = 0.3 * list(SOLIDS).index(shape)
    sun = {"kind": "directional", "direction": [0, 0, -1], "irradiance": [2.0, 2.0, 2.0]}
    camera = looking([place, -0.4, 0.2], [place, 0, 0], fov=3)
    solids = [solid | {"material": AIR} for solid in SOLIDS.values()]
    film = pixels(scene(*solids, camera=camera, lights=[sun], size=(16, 16), depth=4), spp=512, seed=1)
    expected = np.array(GREY["reflectance"]) / math.pi * 2.0
    assert film.mean(axis=(0, 1)) == pytest.approx(expected, rel=0.04)  # four times the noise of the ball


@pytest.mark.slow
def test_lamp_behind_glass_is_seen_as_it_is(monkeypatch):
    """The light of a lamp seen through glass is that of the path: photons bring what goes on from a receiver alone."""
    monkeypatch.setattr(Session, "lanes", 1)  # where what is true is 1, not -1
    camera = looking([0.3, 0.15, 0.2], [0.3, 0.2, 0.6], fov=3)
    pane = {"shape": "box", "min": [0.2, 0.1, 0.3], "max": [0.4, 0.3, 0.4], "material": AIR}
    film = pixels(scene(lamp(), pane, camera=camera, size=(8, 8), depth=4), spp=4, seed=1)
    assert film == pytest.approx(np.full(film.shape, 10.0), rel=1e-5)


@pytest.fixture(scope="module")
def whole():
    return pixels(glasses(), spp=21, seed=5)


@pytest.mark.parametrize("options", [{"wave_size": 1024}, {"wave_size": 1 << 20}, {"part": "1/1"}])
def test_waves_do_not_change_a_bit(options, whole):
    assert np.array_equal(pixels(glasses(), spp=21, seed=5, **options), whole)


def test_crop_has_the_pixels_of_the_whole(whole):
    found = pixels(glasses(), spp=21, seed=5, crop=(0.25, 0.75, 0.5, 1.0))
    assert np.array_equal(found, whole[16:, 8:24])


def test_parts_of_tiles_merge_to_the_bits_of_the_whole(whole, tmp_path):
    files = [tmp_path / f"{number}.rpck" for number in (1, 2)]
    for number, file in enumerate(files, start=1):
        rptcam_cl.render(glasses(), spp=21, seed=5, part=f"{number}/2", checkpoint=file)
    assert np.array_equal(np.asarray(rptcam_cl.merge(files)).astype(np.float64), whole)


def test_ranges_of_samples_merge_to_the_whole(whole, tmp_path):
    files = [tmp_path / f"{first}.rpck" for first in (0, 3)]
    for (first, end), file in zip(((0, 3), (3, 21)), files, strict=True):
        rptcam_cl.render(glasses(), samples=(first, end), seed=5, checkpoint=file)
    merged = np.asarray(rptcam_cl.merge(files)).astype(np.float64)
    assert merged == pytest.approx(whole, rel=1e-5, abs=1e-7)  # sums of two orders


def test_render_that_is_stopped_goes_on_to_the_same_bits(whole, tmp_path):
    options = {"seed": 5, "checkpoint": tmp_path / "state.rpck", "resume": True}
    for samples in (3, 11, 21):
        film = pixels(glasses(), spp=samples, **options)
    assert np.array_equal(film, whole)


@pytest.mark.slow
def test_passes_have_the_picture_of_the_stream(whole):
    loaded = load_scene(glasses() | {"render": glasses()["render"] | {"seed": 5}})
    wavefront = Wavefront(
        open_session(), make_plan(loaded), FilmLayout.of(loaded.film), loaded.render, organisation="passes"
    )
    for wave in wavefront.waves(0, 21):
        wavefront.enqueue(*wave)
    wavefront.finish()
    assert wavefront.picture(21) == pytest.approx(whole, rel=1e-4, abs=1e-6)


def test_objects_that_move_are_refused():
    moving = ball() | {"motion": [{"time_s": 0, "translate": [0, 0, 0]}, {"time_s": 1, "translate": [0.1, 0, 0]}]}
    with pytest.raises(InputError, match=r"render\.caustics: .*move.*allowed"):
        rptcam_cl.render(scene(lamp(), moving, shutter={"time_s": 1}), spp=1)


def test_bad_value_is_refused():
    with pytest.raises(InputError, match=r"render\.caustics.*'yes'"):
        load_scene(scene(caustics="yes"))
