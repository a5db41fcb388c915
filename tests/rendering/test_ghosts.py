"""Ghosts in pictures against those of the lens in float64, and what hides, bounds and colours them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.colour import lines_on_grid, luminance, srgb_from_spectrum
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import Session
from rptcam_cl.optics.beams import Beam
from rptcam_cl.optics.film_probe import FilmProbe, grid
from rptcam_cl.optics.ghosts import Lit, find_ghosts, ghost_image, pairs_of, steps, unfold
from rptcam_cl.optics.glass import MAGNESIUM_FLUORIDE, Coating, Layer, LayerStack, QuarterWave
from rptcam_cl.optics.irradiance import film_irradiance, veiling_glare
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import UNCOATED, with_coating
from rptcam_cl.optics.surface import blades
from rptcam_cl.rendering import ghosts as ghost_film
from rptcam_cl.rendering.cameras.lens_records import ghost_setting
from rptcam_cl.rendering.ghosts import (
    MOST_OF_FOUR,
    STEP,
    GhostFilm,
    Ghosting,
    _basis,
    _some_by_size,
    _spread_light,
    matrix_ways,
    sketch_of_ghosts,
)
from rptcam_cl.rendering.lamps import WAVES_NM, _as_one, _even_cells, _on_sphere
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.point_spread import shares_of_white
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.scene.load import load_scene
from tests.device.probes import open_session
from tests.support.cases import slow

LENS, MANY_PAIRS = "cooke-triplet-50mm", "dgauss-50mm"  # the first has fifteen pairs of surfaces
FILM = {"resolution": [48, 32], "width_mm": 36}
PIXEL_MM2 = (36 / 48) ** 2
IRRADIANCE = 800.0
THREE = {"layers": [{"index": 1.38, "thickness_nm": 99.6}, {"index": 2.1, "thickness_nm": 131.0},
                    {"index": 1.7, "thickness_nm": 80.9}]}  # fmt: skip

METAL = {"layers": [{"index": 1.46, "thickness_nm": 70}, {"index": 0.9, "thickness_nm": 3, "extinction": 2.6}]}


def sun(degrees: float, diameter: float = 0.1) -> dict[str, Any]:
    angle = np.radians(degrees)
    return {"kind": "sun", "direction": [0, float(np.sin(angle)), float(np.cos(angle))],
            "irradiance": [IRRADIANCE] * 3, "diameter_degrees": diameter}  # fmt: skip


def ball(height: float) -> dict[str, Any]:
    material = {"kind": "matte", "reflectance": 0.5}
    return {"shape": "sphere", "center": [0, height, -20], "radius": 2, "material": material}


def scene(light: dict[str, Any], *, objects: tuple[dict[str, Any], ...] = (), **camera: Any) -> dict[str, Any]:
    own = {"kind": "realistic", "lens": LENS, "eye": [0, 0, 0], "target": [0, 0, -10], "ghosts": "on",
           "focus": {"distance_m": 100}, "transmission": "bare"}  # fmt: skip
    return {"film": FILM, "camera": own | camera, "lights": [light], "render": {"spp": 1, "layers": ["ghosts"]},
            "objects": [ball(8), *objects]}  # fmt: skip


def expected(image: rptcam_cl.Image, beam: Beam, **lit: Any) -> tuple[float, float]:
    """Return sum and mean y [mm] of the ghosts of irradiance 1, in values of the film, at d or in green."""
    lens = lit.pop("lens", load_lens(LENS))
    film, wave = image.metadata["film_distance_mm"], lit.pop("wave", 587.5618)
    found = find_ghosts(Lit(lens, film, beam, wave, (36.0, 24.0)))
    flux = sum(ghost.flux_in_frame for ghost in found.ghosts)
    middle = sum(ghost.flux_in_frame * ghost.centroid_mm[1] for ghost in found.ghosts if ghost.flux_in_frame > 0)
    return flux * image.metadata["values_per_irradiance"] / PIXEL_MM2, middle / flux


def ghosts_alone(session: Session, text: dict[str, Any] | Path) -> rptcam_cl.Image:
    """The ghosts of a scene without its picture, whose kernels take longest to compile."""
    loaded = load_scene(text)
    plan = make_plan(loaded)
    film = GhostFilm(loaded, plan, session)
    pixels, said = film.light()
    known = dict(plan.camera.metadata) | {"film_distance_mm": film.film_distance, "ghosts": said}
    return rptcam_cl.Image(pixels.astype(np.float32), metadata=known, layers={"ghosts": pixels.astype(np.float32)})


def centre_y(ghosts: np.ndarray) -> float:
    rows = ghosts[..., 1].sum(axis=1, dtype=np.float64)
    return float(((np.arange(32) + 0.5) / 32 - 0.5) @ rows / rows.sum() * 24)


@pytest.fixture(scope="module")
def bare() -> rptcam_cl.Image:
    return rptcam_cl.render(scene(sun(10.0)))


def test_a_sun_has_the_ghosts_of_the_lens() -> None:
    image = ghosts_alone(open_session(), scene(sun(10.0), lens=MANY_PAIRS))
    total, y = expected(image, Beam(10.0), lens=load_lens(MANY_PAIRS))
    ghosts, left_out = image["ghosts"], image.metadata["ghosts"]["dropped_share"]
    assert 0 < left_out < 1e-3
    assert ghosts[..., 1].sum(dtype=np.float64) == pytest.approx(IRRADIANCE * total * (1 - left_out), rel=5e-3)
    assert centre_y(ghosts) == pytest.approx(y, abs=0.1)  # a seventh of a pixel


def test_ghosts_are_added_to_the_very_picture_without_them() -> None:
    lit = {"environment": {"kind": "constant", "radiance": 0.1}}
    on, off = (rptcam_cl.render(scene(sun(10.0), ghosts=ghosts) | lit) for ghosts in ("on", "off"))
    assert off.pixels.any()
    np.testing.assert_array_equal(on.pixels, off.pixels + on["ghosts"])
    assert "ghosts" not in off.metadata
    again = rptcam_cl.render(scene(sun(10.0)) | lit, wave_size=4096)
    np.testing.assert_array_equal(again["ghosts"], on["ghosts"])


@pytest.mark.slow
def test_a_sun_in_a_picture_has_the_ghosts_of_a_sun(tmp_path: Path) -> None:
    sky = np.full((180, 360, 3), 1e-4, np.float32)
    sky[90 + 10, 180] = 1e5  # a texel 10.5 degrees below the horizon, 0.5 beside the middle
    rptcam_cl.Image(sky, {}, {}).save(tmp_path / "sky.exr")
    text = scene(sun(10.0)) | {"lights": [], "environment": {"kind": "image", "file": "sky.exr"}}
    text["camera"]["target"] = [0, 0, -10]
    (tmp_path / "scene.yaml").write_text(json.dumps(text))
    image = rptcam_cl.render(tmp_path / "scene.yaml")
    solid = np.radians(1.0) ** 2 * np.cos(np.radians(10.5))
    away = float(np.degrees(np.arccos(np.cos(np.radians(10.5)) * np.cos(np.radians(0.5)))))
    total, y = expected(image, Beam(away))
    left = 1 - image.metadata["ghosts"]["dropped_share"]
    assert image.metadata["ghosts"]["sources"] == 1
    assert image["ghosts"][..., 1].sum(dtype=np.float64) == pytest.approx(1e5 * solid * total * left, rel=0.02)
    assert centre_y(image["ghosts"]) == pytest.approx(y, abs=0.1)  # from below, as that of `sun`


@pytest.mark.slow
def test_a_barrel_adds_its_share_of_the_mean_film() -> None:
    bare, image = (rptcam_cl.render(scene(sun(170.0), objects=(ball(0),), **own))
                   for own in ({}, {"barrel_reflectance": 0.1}))  # fmt: skip
    film, lens = image.metadata["film_distance_mm"], load_lens(LENS)
    share = veiling_glare(lens, film, 587.5618, UNCOATED, barrel_reflectance=0.1).barrel
    direct = bare.pixels - bare["ghosts"]
    veil = image["ghosts"] - bare["ghosts"]
    assert 1e-5 < share < 1e-2
    assert direct.max() > 0
    np.testing.assert_allclose(veil, np.broadcast_to(share * direct.mean(axis=(0, 1)), veil.shape), rtol=1e-3)
    with pytest.raises(InputError, match="barrel_reflectance: is light of ghosts"):
        rptcam_cl.render(scene(sun(10.0), barrel_reflectance=0.1, ghosts="off"))


def test_what_the_front_scatters_is_taken_from_the_direct_light() -> None:
    clean, dusty = (rptcam_cl.render(scene(sun(170.0), objects=(ball(0),), **own))  # from behind: no ghosts
                    for own in ({}, {"front_scatter": [3e-3, 1e-4, 2.0]}))  # fmt: skip
    share, glow = np.pi * 3e-3 * np.log(1 + 1e4), dusty["ghosts"]
    assert dusty.metadata["ghosts"]["scatter"]["share"] == pytest.approx(share, rel=1e-6)
    np.testing.assert_allclose(dusty.pixels, clean.pixels * (1 - share) + glow, rtol=1e-5)
    assert glow.min() > 0
    assert 0.2 * share < glow.sum() / clean.pixels.sum() < share  # the rest falls beside the film
    with pytest.raises(InputError, match="front_scatter: is light of ghosts"):
        rptcam_cl.render(scene(sun(10.0), front_scatter=[3e-3, 1e-4, 2.0], ghosts="off"))
    with pytest.raises(InputError, match="front_scatter: scatters 8"):
        rptcam_cl.render(scene(sun(10.0), front_scatter=[0.3, 1e-4, 2.0]))


DUSTY = {"front_scatter": [3e-3, 1e-4, 2.0]}


@pytest.mark.slow
def test_the_front_scatters_a_sun_beside_the_frame_as_rays_of_the_pupil_say(session: Session) -> None:
    travels = 0.2, 0.5, 0.842615

    def light(*objects: dict[str, Any], **camera: Any) -> tuple[np.ndarray, dict[str, Any]]:
        loaded = load_scene(scene(sun(30.0) | {"direction": travels}, objects=objects, **camera))
        return Ghosting(loaded, make_plan(loaded), session).result

    (dusty, said), (clean, _) = light(**DUSTY), light()
    assert said["scatter"]["beside"] == 1
    hooded, none = light(ball(0) | {"center": [-2, -5, -8.4], "radius": 1}, **DUSTY)
    assert none["scatter"]["beside"] == 0 and not hooded.any()
    loaded = load_scene(scene(sun(30.0)))
    setting = ghost_setting(loaded)
    distance, a, b = setting.film_distance_mm, 3e-3, 1e-4
    probe = FilmProbe(setting.lens, distance, 587.5618)
    value = make_plan(loaded).camera.metadata["values_per_irradiance"]
    for row, column in ((3, 5), (28, 40)):
        film = np.array([-(column + 0.5 - 24) * 0.75, (row + 0.5 - 16) * 0.75])
        rear = grid(probe.windows(film[None]), 60, 60)[0]
        rays = probe.trace(film, rear)
        weight = rays.passed / (distance**2 + ((rear - film) ** 2).sum(axis=1)) ** 2
        away2 = np.sum((rays.directions[:, :2] + travels[:2]) ** 2, axis=1)
        radiance = IRRADIANCE * travels[2] * (weight @ (a / (b + away2))) / weight.sum()
        radius = float(np.hypot(*film))
        lit = film_irradiance(setting.lens, distance, radius, 587.5618, transmission=setting.transmission)
        assert (dusty - clean)[row, column, 1] == pytest.approx(radiance * lit * value, rel=5e-3)


@pytest.mark.slow
def test_a_crop_has_the_glow_of_a_sun_in_the_rest_of_the_frame() -> None:
    lit = scene(sun(9.0, 2.0), objects=(ball(200),), **DUSTY) | {"render": {"spp": 64, "layers": ["ghosts"]}}
    whole = rptcam_cl.render(lit)
    crop = rptcam_cl.render(lit | {"film": FILM | {"crop": [0, 1, 0, 0.5]}})
    assert whole.metadata["ghosts"]["scatter"]["beside"] == 0
    assert 0.6 < whole.metadata["ghosts"]["scatter"]["on_film"] < 0.7
    np.testing.assert_allclose(crop["ghosts"], whole["ghosts"][:16], rtol=8e-3)  # the sun is of noise there


def test_a_sketch_has_the_light_of_ghosts_about_where_they_are(session: Session) -> None:
    setting = ghost_setting(load_scene(scene(sun(10.0))))
    lens, distance = setting.lens, setting.film_distance_mm
    found = [way.heights[-1] for way in matrix_ways(lens, distance, setting.transmission)]
    images = [ghost_image(lens, way, distance, 550.0) for way in pairs_of(lens)]
    known = np.array([(image.film_per_height, image.film_per_slope) for image in images])
    assert len(found) > 8
    for row in found:
        assert np.abs(known / row - 1).max(axis=1).min() < 1e-9

    def sketch(*objects: dict[str, Any]) -> np.ndarray:
        loaded = load_scene(scene(sun(10.0), objects=objects))
        plan = make_plan(loaded)
        return sketch_of_ghosts(loaded, plan, SceneBuffers(session, plan), session, (32, 48))

    exact, drawn = ghosts_alone(session, scene(sun(10.0)))["ghosts"], sketch()
    assert drawn.sum() == pytest.approx(exact.sum(), rel=0.1)
    assert np.abs(drawn - exact).sum() < 0.22 * exact.sum() < np.abs(drawn[::-1] - exact).sum()
    assert not sketch(ball(-3.5)).any()


def test_rays_come_from_all_of_a_sun_that_nothing_hides(session: Session) -> None:
    def sources(*objects: dict[str, Any]) -> Any:
        loaded = load_scene(scene(sun(10.0, 0.53), objects=objects))
        return GhostFilm(loaded, make_plan(loaded), session).sources

    whole, half = sources(), sources(ball(-3.53) | {"center": [0.11, -3.53, -20], "radius": 0.1})
    np.testing.assert_allclose(whole.irradiance, [[IRRADIANCE] * 3], rtol=1e-6)
    np.testing.assert_allclose(whole.patches.cell, [[0, 0, 1, 1]])
    assert 1 < len(half.places) < 16  # parts, some of them dark
    assert half.irradiance[:, 0].min() < 0.9 * half.irradiance[:, 0].max()


def test_what_hides_the_sun_hides_its_ghosts(session: Session) -> None:
    image = ghosts_alone(session, scene(sun(10.0), objects=(ball(-3.5),)))
    assert not image["ghosts"].any()
    assert image.metadata["ghosts"]["sources"] == 0


def test_ghosts_are_of_what_the_camera_sees(bare: rptcam_cl.Image, session: Session) -> None:
    unseen = {"visible": {"camera": False}}
    image = ghosts_alone(session, scene(sun(10.0) | unseen))
    assert not image["ghosts"].any()
    assert image.metadata["ghosts"]["sources"] == 0
    behind = ghosts_alone(session, scene(sun(10.0), objects=(ball(-3.5) | unseen,)))
    np.testing.assert_array_equal(behind["ghosts"], bare["ghosts"])


@pytest.mark.slow
def test_a_sun_outside_of_the_frame_has_ghosts_within(session: Session) -> None:
    image = ghosts_alone(session, scene(sun(20.0), lens=MANY_PAIRS))  # 18 mm from the middle of a frame 24 mm high
    total, _ = expected(image, Beam(20.0), lens=load_lens(MANY_PAIRS))
    left = 1 - image.metadata["ghosts"]["dropped_share"]
    assert image["ghosts"][..., 1].sum(dtype=np.float64) == pytest.approx(IRRADIANCE * total * left, rel=5e-3)


@pytest.mark.parametrize(("name", "degrees"), [slow("fisheye-10mm", 30.0), slow("zoom-70-200mm", 3.0)])
def test_a_small_opening_behind_a_wide_front_has_its_ghosts(name: str, degrees: float, session: Session) -> None:
    image = ghosts_alone(session, scene(sun(degrees), lens=name, f_number=16))
    lens = load_lens(name)
    lens = lens.with_stop_diameter(lens.stop_diameter_for(16.0))
    total, y = expected(image, Beam(degrees), lens=lens)
    left = 1 - image.metadata["ghosts"]["dropped_share"]
    assert image["ghosts"][..., 1].sum(dtype=np.float64) == pytest.approx(IRRADIANCE * total * left, rel=0.02)
    assert centre_y(image["ghosts"]) == pytest.approx(y, abs=0.1)


def test_a_small_opening_far_behind_its_front_has_the_ghost_of_it(session: Session, tmp_path: Path) -> None:
    rows = [{"radius": 60, "thickness": 6, "glass": {"index": 1.6}, "diameter": 50},
            {"radius": -200, "thickness": 30, "diameter": 50}, {"stop": True, "diameter": 1}]  # fmt: skip
    lens = {"name": "Far stop", "surfaces": rows}
    image = ghosts_alone(session, scene(sun(5.0), lens=lens))
    (tmp_path / "lens.json").write_text(json.dumps(lens))
    total, y = expected(image, Beam(5.0), lens=load_lens(tmp_path / "lens.json"))
    assert image["ghosts"][..., 1].sum(dtype=np.float64) == pytest.approx(IRRADIANCE * total, rel=0.01)
    assert centre_y(image["ghosts"]) == pytest.approx(y, abs=0.1)


def test_a_coating_measured_over_few_wavelengths_keeps_its_last_values_beyond(session: Session) -> None:
    def ghosts(reflectance: Any) -> np.ndarray:
        rows = [{"radius": 60, "thickness": 6, "glass": {"index": 1.6}, "diameter": 24, "stop": True},
                {"radius": -60, "diameter": 24}]  # fmt: skip
        rows = [row | {"coating": {"reflectance": reflectance}} for row in rows]
        lens = {"name": "Single lens", "surfaces": rows}
        return ghosts_alone(session, scene(sun(10.0), lens=lens, transmission="coated"))["ghosts"]

    measured = {"wavelengths_nm": [500, 550, 600], "values": [0.02, 0.02, 0.020001]}
    np.testing.assert_allclose(ghosts(measured).sum(axis=(0, 1)), ghosts(0.02).sum(axis=(0, 1)), rtol=2e-3)


@pytest.mark.slow
def test_ghosts_lose_what_the_glass_takes_on_each_of_their_three_ways_through_it(tmp_path: Path) -> None:
    inside = {"thickness_mm": 6, "wavelengths_nm": [300, 900], "values": [0.8, 0.8]}
    rows = [{"radius": 60, "thickness": 6, "glass": {"index": 1.6, "transmittance": inside}, "diameter": 24,
             "stop": True}, {"radius": -60, "diameter": 24}]  # fmt: skip
    lens = {"name": "Single lens", "surfaces": rows}
    image = rptcam_cl.render(scene(sun(10.0), lens=lens))
    (tmp_path / "lens.json").write_text(json.dumps(lens))
    total, _ = expected(image, Beam(10.0), lens=load_lens(tmp_path / "lens.json"))
    left = 1 - image.metadata["ghosts"]["dropped_share"]
    assert image["ghosts"].sum(axis=(0, 1), dtype=np.float64) == pytest.approx(IRRADIANCE * total * left, rel=5e-3)


@pytest.mark.slow
def test_ghosts_take_the_shape_of_the_stop() -> None:
    image = rptcam_cl.render(scene(sun(10.0), f_number=8, aperture={"shape": "polygon", "blades": 3}))
    lens = load_lens(LENS)
    lens = lens.with_stop_diameter(lens.stop_diameter_for(8.0)).with_stop_shape(blades(3))
    greens = shares_of_white(WAVES_NM)[:, 1]  # the coating gives 1 % more of white light than of the d line
    totals, heights = np.array([expected(image, Beam(10.0), lens=lens, wave=nm) for nm in WAVES_NM]).T
    total, y = greens @ totals, greens @ (totals * heights) / (greens @ totals)
    left = 1 - image.metadata["ghosts"]["dropped_share"]
    assert image["ghosts"][..., 1].sum(dtype=np.float64) == pytest.approx(IRRADIANCE * total * left, rel=0.01)
    assert centre_y(image["ghosts"]) == pytest.approx(y, abs=0.1)


@pytest.mark.parametrize(
    ("written", "coating", "purple"),
    [
        slow("mgf2", MAGNESIUM_FLUORIDE, True),
        slow({"layers": [{"index": 1.38, "thickness_nm": 70}]}, QuarterWave(1.38, 386.4), False),  # for violet: yellow
        slow(METAL, LayerStack((Layer(1.46, 70.0), Layer(0.9, 3.0, 2.6))), True),
        slow(THREE, LayerStack((Layer(1.38, 99.6), Layer(2.1, 131.0), Layer(1.7, 80.9))), True),
    ],
    ids=["a quarter wave", "thinner", "metal", "three layers"],
)
def test_layers_colour_ghosts_as_their_closed_form_says(
    written: Any, coating: Coating, purple: bool, session: Session
) -> None:
    image = ghosts_alone(session, scene(sun(10.0), transmission={"coating": written}))
    lens = with_coating(load_lens(LENS), coating)
    sums = np.array([expected(image, Beam(10.0), lens=lens, wave=wave)[0] for wave in WAVES_NM])
    colour = IRRADIANCE * sums @ shares_of_white(WAVES_NM) * (1 - image.metadata["ghosts"]["dropped_share"])
    assert image["ghosts"].sum(axis=(0, 1), dtype=np.float64) == pytest.approx(colour, rel=0.01)
    assert bool(colour[2] > colour[1]) is purple  # as coated lenses are


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["dispersive", *map(slow, ("auto", "rgb"))])
def test_ghosts_of_a_line_have_the_reflectance_at_its_wavelength(mode: str, session: Session) -> None:
    line = 589.3
    text = scene(sun(10.0) | {"irradiance": {"lines_nm": {line: 1.0}, "scale": 800.0}})
    text["camera"]["transmission"] = {"coating": {"layers": [{"index": 1.38, "thickness_nm": 70}]}}
    image = ghosts_alone(session, text | {"spectrum": mode})
    pixels = image["ghosts"].astype(np.float64)
    lens = with_coating(load_lens(LENS), QuarterWave(1.38, 386.4))
    total = expected(image, Beam(10.0), lens=lens, wave=line)[0] * (1 - image.metadata["ghosts"]["dropped_share"])
    colour = srgb_from_spectrum(800.0 * lines_on_grid([[line, 1.0]]))
    assert colour[2] < 0  # a line lies outside of sRGB
    if mode == "rgb":  # by the bands of red and green, where the layer reflects otherwise
        assert abs(pixels[..., 0].sum() / (colour[0] * total) - 1) > 0.02
    else:
        assert pixels.sum(axis=(0, 1)) == pytest.approx(colour * total, rel=0.01)


@pytest.mark.slow  # 7 CPU seconds
def test_every_colour_of_coated_ghosts_errs_by_less_than_5_percent(monkeypatch: pytest.MonkeyPatch) -> None:
    text = scene(sun(10.0, 0.53), lens=MANY_PAIRS, f_number=4, transmission={"coating": "mgf2"})
    text["film"] = {"resolution": [480, 320], "width_mm": 36}
    ghosts = rptcam_cl.render(text)["ghosts"]
    monkeypatch.setattr(ghost_film, "PER_PIXEL", 16 * ghost_film.PER_PIXEL)
    monkeypatch.setattr(ghost_film, "MOST_RAYS", 1 << 30)
    monkeypatch.setattr(ghost_film, "LEAST_SPREAD", 0)
    exact = rptcam_cl.render(text)["ghosts"].astype(np.float64)
    lit = luminance(exact) > 0.2 * luminance(exact).mean()
    errors = np.sqrt(np.mean((ghosts[lit] / exact[lit] - 1) ** 2, axis=0))
    assert np.all(errors < 0.05)  # all pairs spread alike: 8 % of green
    assert np.all(errors > 0.005)


@pytest.mark.slow  # its kernels take long to compile
def test_ghosts_of_a_coloured_sun_are_the_same_with_wavelengths(bare: rptcam_cl.Image) -> None:
    text = scene(sun(10.0) | {"irradiance": [800.0, 400.0, 100.0]})
    text["spectrum"] = "spectral"
    image = rptcam_cl.render(text)
    np.testing.assert_allclose(image["ghosts"], bare["ghosts"] * [1, 0.5, 0.125], rtol=1e-5)


def test_a_lamp_has_the_ghosts_of_its_distance(session: Session) -> None:
    lamp = {"kind": "point", "position": [0, -0.3, -2], "intensity": [50, 50, 50]}
    image = ghosts_alone(session, scene(lamp, lens=MANY_PAIRS, focus={"distance_m": 2}))
    lens = load_lens(MANY_PAIRS)
    film_z = image.metadata["film_distance_mm"] + lens.length
    away = 2000 - film_z
    total, y = expected(image, Beam(float(np.degrees(np.arctan(300 / away))), away), lens=lens)
    ghosts, left_out = image["ghosts"][..., 1], image.metadata["ghosts"]["dropped_share"]
    assert 0 < left_out < 1e-3
    assert ghosts.sum(dtype=np.float64) == pytest.approx(
        50e6 * total * (1 - left_out), rel=5e-3
    )  # W/sr through mm2 at m
    assert centre_y(image["ghosts"]) == pytest.approx(y, abs=0.1)


@pytest.mark.slow
def test_a_bright_and_a_dim_lamp_have_the_ghosts_of_both(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ghost_film, "_LEAST_RAYS", 1 << 18)

    def lamps(*watts: float) -> np.ndarray:
        lights = [{"kind": "point", "position": [x, -0.3, -2], "intensity": [power] * 3}
                  for x, power in zip((0.1, -0.2), watts, strict=True)]  # fmt: skip
        return ghosts_alone(session, scene(lights[0]) | {"lights": lights})["ghosts"].astype(np.float64)

    both, bright, dim = lamps(300, 30), lamps(300, 0), lamps(0, 30)
    assert both.sum() == pytest.approx(bright.sum() + dim.sum(), rel=2e-3)
    assert np.abs(both - bright - dim).sum() < 0.02 * both.sum()  # the dim one has a quarter of the rays


def test_a_lamp_with_a_picture_has_the_ghosts_of_its_texels(session: Session, tmp_path: Path) -> None:
    picture = np.array([[[8, 1, 0.5], [0.1, 0.2, 0.1]], [[1, 1, 1], [0.3, 0, 2]]], np.float32)
    rptcam_cl.Image(picture, {}, {}).save(tmp_path / "texels.exr")

    def box(x: float, y: float, side: float, radiance: Any) -> dict[str, Any]:
        return {"shape": "rectangle", "corner": [x, y, -3], "edge_u": [side, 0, 0], "edge_v": [0, side, 0],
                "material": {"kind": "emissive", "radiance": radiance}}  # fmt: skip

    def lit(*boxes: dict[str, Any]) -> np.ndarray:
        text = scene(sun(10.0) | {"irradiance": 0}, objects=boxes, focus={"distance_m": 3})
        (tmp_path / "scene.yaml").write_text(json.dumps(text))
        return ghosts_alone(session, tmp_path / "scene.yaml")["ghosts"].astype(np.float64)

    image = {"kind": "image", "file": "texels.exr", "filter": "nearest"}
    whole = lit(box(0.1, 0.3, 0.8, image))
    parts = lit(*(box(0.1 + 0.4 * x, 0.3 + 0.4 * y, 0.4, picture[1 - y, x].tolist()) for x in (0, 1) for y in (0, 1)))
    np.testing.assert_allclose(whole.sum(axis=(0, 1)), parts.sum(axis=(0, 1)), rtol=5e-3)
    assert np.sqrt(np.mean((whole - parts) ** 2) / np.mean(parts**2)) < 0.03  # an even lamp of their mean: 0.3


def test_a_picture_is_parted_where_it_is_uneven() -> None:
    picture = np.full((64, 64, 3), 0.5)
    picture[8:24, 40:44] = [9.0, 5.0, 1.0]
    cells, colours = _even_cells(picture, 1, 64)
    bright = colours[:, 0] > 1
    assert cells[:, 2:].prod(axis=1).sum() == pytest.approx(1)
    assert cells[bright, 2:].prod(axis=1).sum() == 16 * 4 / 64**2
    assert cells[bright, :2].min(axis=0) == pytest.approx([40 / 64, 8 / 64])
    np.testing.assert_allclose(colours, np.where(bright[:, None], [9.0, 5.0, 1.0], 0.5), rtol=1e-12)
    assert len(_even_cells(np.random.default_rng(1).random((64, 64, 3)), 4, 20)[0]) == 20


@pytest.mark.parametrize("rays", [32, 1024, 1 << 20])
def test_rays_are_traced_beside_their_neighbours(rays: int) -> None:
    step = _basis(rays)[1]
    aside = np.array([step / rays, step * STEP])
    assert step % 2 == 1  # so that it leads to all of a power of two
    assert np.hypot(*(aside - np.rint(aside))) < 2 / np.sqrt(rays)


@pytest.mark.slow
@pytest.mark.parametrize("azimuth", [0.0, 45.0, 90.0])
def test_an_anamorphic_has_the_streaks_of_the_exact_tracer(azimuth: float, session: Session) -> None:
    def lit(place: np.ndarray) -> rptcam_cl.Image:
        lamp = {"kind": "point", "position": [*map(float, place), -20], "intensity": [50, 50, 50]}
        return ghosts_alone(session, scene(lamp, lens="anamorphic-100mm", focus={"distance_m": 20}))

    aside = np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))])
    image, lens = lit(-2.0 * aside), load_lens("anamorphic-100mm")
    away = 20000 - image.metadata["film_distance_mm"] - lens.length
    beam = Beam(float(np.degrees(np.arctan(2000 / away))), away, azimuth)
    ghosts = find_ghosts(Lit(lens, image.metadata["film_distance_mm"], beam, 550.0, (36.0, 24.0))).ghosts
    flux = np.array([ghost.flux_in_frame for ghost in ghosts])
    middle = flux @ np.nan_to_num([ghost.centroid_mm for ghost in ghosts]) / flux.sum()
    green = image["ghosts"][..., 1].astype(np.float64)
    total = 50e6 * flux.sum() * image.metadata["values_per_irradiance"] / PIXEL_MM2
    assert green.sum() == pytest.approx(total * (1 - image.metadata["ghosts"]["dropped_share"]), rel=5e-3)
    x = -36 * ((np.arange(48) + 0.5) / 48 - 0.5) @ green.sum(axis=0) / green.sum()  # of the film, behind the picture
    assert (x, centre_y(image["ghosts"])) == pytest.approx(tuple(middle), abs=0.1)
    moved = [lit(-2.0 * aside - [0.0, 0.0015 * step])["ghosts"][..., 1].astype(np.float64) for step in range(4)]
    sums = np.sum(moved, axis=(1, 2))  # a tenth of a pixel of 480 across the film at a time
    assert np.abs(np.diff(sums, 2)).max() < 1e-3 * sums.mean()
    assert np.abs(np.diff(moved, 2, axis=0)).sum(axis=(1, 2)).max() < 0.02 * sums.mean()  # nothing jumps


@pytest.mark.slow
def test_a_softbox_has_the_ghosts_of_the_many_small_lamps_that_it_is_made_of() -> None:
    def lit(columns: int, rows: int) -> Any:
        side, height = 0.9 / columns, 0.7 / rows
        material = {"kind": "emissive", "radiance": 50}
        boxes = [
            {"shape": "rectangle", "corner": [0.1 + x * side, 0.3 + y * height, -3], "edge_u": [side, 0, 0],
             "edge_v": [0, height, 0], "material": material} for x in range(columns) for y in range(rows)
        ]  # fmt: skip
        lamp = sun(10.0) | {"irradiance": 0}
        focus = {"distance_m": 3}
        image = rptcam_cl.render(scene(lamp, lens=MANY_PAIRS, objects=tuple(boxes), f_number=4, focus=focus))
        return image["ghosts"][..., 1].astype(np.float64)

    whole, parts = lit(1, 1), lit(6, 5)
    assert whole.sum() == pytest.approx(parts.sum(), rel=5e-3)
    assert np.sqrt(np.mean((whole - parts) ** 2) / np.mean(parts**2)) < 0.02  # 16 points in its place: 0.3


def test_ghosts_are_those_of_rays_traced_back_from_the_film() -> None:
    lens, film, sun_radius, rng = load_lens("biconvex"), 48.0, np.radians(3.0), np.random.default_rng(5)
    lens = replace(lens, surfaces=tuple(replace(surface, semi_diameter=3.0) for surface in lens.surfaces))
    way, count, side = (1, 0), 400_000, 44.0
    back = unfold(lens, way)
    rear, film_z = lens.surfaces[-1].semi_diameter, lens.film_z(film)
    at = np.column_stack([(rng.random((count, 2)) - 0.5) * side, np.full(count, film_z)])
    through = rear * np.sqrt(rng.random(count))[:, None] * np.exp(2j * np.pi * rng.random(count))[:, None].view(float)
    to = np.column_stack([through, np.full(count, lens.length)]) - at
    length = np.linalg.norm(to, axis=1)
    rays = back.trace(at, to, 587.5618, "film")
    towards_sun = -rays.directions[:, 2] > np.cos(sun_radius)
    n = float(lens.indices(587.5618)[1])
    share = ((n - 1) / (n + 1)) ** 2  # near the axis
    light = share**2 * (1 - share) ** 2 * (rays.passed & towards_sun)
    cosine = film / length
    solid = 2 * np.pi * (1 - np.cos(sun_radius))
    flux = np.mean(light * cosine**2 / length**2) * side**2 * np.pi * rear**2 / solid
    forward = find_ghosts(Lit(lens, film, Beam(0.0), 587.5618, (side, side))).ghosts[0]
    assert [step.reflects for step in steps(way, 2)] == [False, True, True, False]
    assert flux == pytest.approx(forward.flux_in_frame, rel=0.03)  # a wide sun for a point, slanted rays for straight


GLASS = {"index": 2.2}
SINGLET = {"name": "Single lens", "surfaces": [{"radius": 200, "thickness": 6, "glass": GLASS, "diameter": 8},
                                               {"radius": -300, "diameter": 8, "stop": True}]}  # fmt: skip


def four_reflections(film: float, degrees: float) -> tuple[float, float]:
    """Flux in the frame and mean y of light of irradiance 1 that the singlet reflects four times, by Fresnel."""
    n, rim, count = 2.2, 4.0, 50_000
    radii, vertices = (200.0, -300.0), (0.0, 6.0)
    radius, angle = rim * np.sqrt((np.arange(count) + 0.5) / count), 2.399963229728653 * np.arange(count)
    p = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, -20.0)])
    d = np.tile([[0.0], [np.sin(np.radians(degrees))], [np.cos(np.radians(degrees))]], count)
    p[1] -= 20.0 * np.tan(np.radians(degrees))
    light = np.full(count, np.pi * rim**2 / count * np.cos(np.radians(degrees)))
    inside = False
    for k, reflects in ((0, False), (1, True), (0, True), (1, True), (0, True), (1, False)):
        away = p - np.array([[0.0], [0.0], [vertices[k] + radii[k]]])
        b = np.sum(away * d, axis=0)
        root = np.sqrt(b**2 - np.sum(away**2, axis=0) + radii[k] ** 2)
        near = np.array([-b - root, -b + root])
        at = p + d * near[np.argmin(np.abs((p + d * near[:, None])[:, 2] - vertices[k]), axis=0), np.arange(count)]
        light = np.where(np.hypot(at[0], at[1]) <= rim, light, 0.0)
        normal = (at - np.array([[0.0], [0.0], [vertices[k] + radii[k]]])) / radii[k]
        cosine = np.sum(normal * d, axis=0)
        normal, cosine = normal * np.sign(cosine), np.abs(cosine)
        eta = n if inside else 1 / n
        behind = np.sqrt(1 - eta**2 * (1 - cosine**2))
        s, t = (eta * cosine - behind) / (eta * cosine + behind), (cosine - eta * behind) / (cosine + eta * behind)
        share = (s**2 + t**2) / 2
        d = d - 2 * cosine * normal if reflects else eta * d + (behind - eta * cosine) * normal
        light, p, inside = light * (share if reflects else 1 - share), at, inside if reflects else not inside
    x, y = (p + d * ((6.0 + film - p[2]) / d[2]))[:2]
    light = np.where((np.abs(x) < 18) & (np.abs(y) < 12), light, 0.0)
    return float(light.sum()), float(light @ y / light.sum())


def test_four_reflections_are_those_of_rays_at_spheres(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ghost_film, "_LEAST_RAYS", 1 << 18)
    two, four = (ghosts_alone(session, scene(sun(3.0), lens=SINGLET, ghost_order=order)) for order in (2, 4))
    assert four.metadata["ghosts"]["ways_of_four"] == 1 and "ways_of_four" not in two.metadata["ghosts"]
    more = (four["ghosts"].astype(np.float64) - two["ghosts"])[..., 1]
    flux, y = four_reflections(four.metadata["film_distance_mm"], 3.0)
    scale = IRRADIANCE * four.metadata["values_per_irradiance"] / PIXEL_MM2
    assert more.sum() == pytest.approx(flux * scale, rel=0.01)
    assert centre_y(np.repeat(more[..., None], 3, axis=2)) == pytest.approx(y, abs=0.2)


@pytest.mark.slow
def test_some_ways_of_four_stand_for_all(session: Session) -> None:
    two, four = (ghosts_alone(session, scene(sun(10.0), lens=MANY_PAIRS, ghost_order=order)) for order in (2, 4))
    lit = Lit(load_lens(MANY_PAIRS), four.metadata["film_distance_mm"], Beam(10.0), 587.5618, (36.0, 24.0))
    flux = sum(ghost.flux_in_frame for ghost in find_ghosts(lit, 4).ghosts if len(ghost.way) == 4)
    more = (four["ghosts"].sum(axis=(0, 1), dtype=np.float64) - two["ghosts"].sum(axis=(0, 1), dtype=np.float64))[1]
    scale = IRRADIANCE * four.metadata["values_per_irradiance"] / PIXEL_MM2
    assert four.metadata["ghosts"]["ways_of_four"] <= MOST_OF_FOUR < 1000 < four.metadata["ghosts"]["of_four"]
    assert more == pytest.approx(flux * scale, rel=0.05)


def test_a_way_that_stands_for_others_makes_no_spot_as_bright_as_all_of_them(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ghost_film, "_LEAST_RAYS", 1 << 16)
    loaded = load_scene(scene(sun(10.0), lens=MANY_PAIRS) | {"film": {"resolution": [120, 80], "width_mm": 36}})
    film = GhostFilm(loaded, make_plan(loaded), session)
    one, many = (film._splat(film._scout_more({(6, 2): stands_for}))[..., 1] for stands_for in (1.0, 40.0))
    assert many.sum() == pytest.approx(40 * one.sum(), rel=0.02)
    assert many.max() / many.sum() < 0.5 * one.max() / one.sum()


def test_ways_that_stand_for_others_have_the_sum_of_all() -> None:
    sizes = np.random.default_rng(3).random(500) ** 12
    sizes[7] = 0.0
    chosen = _some_by_size(np.arange(500)[:, None], sizes, 40)
    assert len(chosen) == 40 and (7,) not in chosen
    assert chosen[(int(np.argmax(sizes)),)] == 1.0
    assert sum(many * sizes[way] for (way,), many in chosen.items()) == pytest.approx(sizes.sum(), rel=1e-9)
    assert set(_some_by_size(np.arange(500)[:, None], sizes, 499).values()) == {1.0}


@pytest.mark.parametrize(
    ("camera", "fault"),
    [
        ({"transmission": "ideal"}, "camera.ghosts"),
        ({"ghosts": "off", "ghost_order": 4}, "ghost_order: is light of ghosts"),
        ({"kind": "thick_lens"}, "ghosts"),
        ({"movements": {"shift_mm": 5}}, "in its place"),
    ],
)
def test_ghosts_need_surfaces_that_reflect(camera: dict[str, Any], fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        rptcam_cl.render(scene(sun(10.0), **camera))


def test_parts_are_merged_with_their_ghosts(bare: rptcam_cl.Image, tmp_path: Path) -> None:
    parts = [tmp_path / "1.rpck", tmp_path / "2.rpck"]
    for number, path in enumerate(parts, 1):
        rptcam_cl.render(scene(sun(10.0)), part=f"{number}/2", checkpoint=path)
    merged = rptcam_cl.merge(parts)
    np.testing.assert_array_equal(merged.pixels, bare.pixels)
    np.testing.assert_array_equal(merged["ghosts"], bare["ghosts"])
    assert merged.metadata["ghosts"] == bare.metadata["ghosts"]


@pytest.mark.parametrize("share", [1.0, 0.25])
def test_ghosts_are_spread_by_the_pixels_that_they_cover(share: float) -> None:
    film = object.__new__(ghost_film.GhostFilm)
    film.shape = (400, 600)
    cells = np.zeros((16, 24, 1))
    cells[: round(16 * share)] = 1.0
    way = ghost_film.Scouted(np.zeros((1, 4)), np.ones((1, 3)), cells, 0.5, 1.0, np.ones(1))
    pixels, rays = 400 * 600 * share, 4000.0
    width = ghost_film.WIDTH * (pixels**0.5 / (0.5 * rays / pixels)) ** (1 / 3)
    steps = np.log(width) / np.log(ghost_film.FINER)
    assert abs(film._spread_steps(way, rays) - steps) <= 0.5


def test_lamp_that_shows_small_is_one_source_of_all_its_light() -> None:
    lamp, front = np.array([0.2, -0.1, -10.0, 0.01]), np.zeros(3)
    places, areas, patches = _on_sphere(lamp, front)
    points = np.column_stack([places, np.ones(len(places))]), areas[:, None] * [1.0, 2.0, 3.0], np.zeros((16, 2))
    (at, light, target), whole = _as_one(points, patches, front)
    assert len(at) == len(target) == len(whole) == 1
    assert at[0, :3] == pytest.approx(lamp[:3], abs=1e-12)
    assert light[0] == pytest.approx(np.pi * 1e-4 * np.array([1.0, 2.0, 3.0]), rel=1e-5)
    edge = whole.at(np.ones(8), np.arange(8) / 8) - lamp[:3]
    assert np.linalg.norm(edge, axis=1) == pytest.approx(0.01)
    assert _as_one(points, patches, np.array([0.0, 0.0, -9.0]))[0][0] is points[0]  # from 1 m it shows large


def test_light_is_spread_by_a_tent_and_mirrored_at_the_border() -> None:
    film, width = np.random.default_rng(1).random((70, 9, 3)), 2.56
    tent = np.maximum(width - np.abs(np.arange(-3, 4)), 0.0)
    wide = np.pad(film, [(3, 3), (3, 3), (0, 0)], mode="symmetric")
    by_rows = np.apply_along_axis(np.convolve, 0, wide, tent / tent.sum(), "valid")
    expected = np.apply_along_axis(np.convolve, 1, by_rows, tent / tent.sum(), "valid")
    assert _spread_light(film, width) == pytest.approx(expected, rel=1e-12)


COVERED = {"name": "Covered", "surfaces": [
    {"radius": 200, "thickness": 6, "glass": GLASS, "diameter": 2, "stop": True},
    {"radius": -300, "thickness": 93, "diameter": 8},
    {"thickness": 1, "glass": {"index": 1.5}, "diameter": 40}, {"diameter": 40},
]}  # fmt: skip


def test_orders_of_the_sensor_come_back_from_its_cover_glass(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ghost_film, "_LEAST_RAYS", 1 << 18)
    monkeypatch.setattr(ghost_film, "LEAST_SPREAD", 0)
    pitch, line, reflectance, spread, side = 5.0, 600.0, 0.2, 0.15, 0.1

    light = sun(0.0) | {"irradiance": {"lines_nm": {line: 1.0}, "scale": IRRADIANCE}}
    grating = {"pitch_um": pitch, "reflectance": reflectance, "spread": spread}
    text = scene(light, lens=COVERED, sensor_grating=grating) | {"spectrum": "spectral"}
    loaded = load_scene(text | {"film": {"resolution": [90, 60], "width_mm": 90 * side}})
    plan = make_plan(loaded)
    film = GhostFilm(loaded, plan, session)
    assert film.light()[1]["ways_of_grating"] == 4
    dots = film._splat(film._scout_more({(4, face): reflectance for face in (2, 3)}))[..., 0]  # no noise of pairs
    shares = np.exp(-0.5 * (np.arange(-99, 100) * 0.575 / pitch / spread) ** 2)
    shares /= shares.sum()
    lens, face = (1.2 / 3.2) ** 2, (0.5 / 2.5) ** 2
    arriving = (
        np.pi * (1 - lens) ** 2 * (1 - face) ** 2 * srgb_from_spectrum(IRRADIANCE * lines_on_grid([[line, 1]]))[0]
    )
    y, x = (np.array(np.indices(dots.shape)) + 0.5) * side - [[[3.0]], [[4.5]]]
    for m, n in ((1, 0), (0, -1), (-1, 1), (2, 0)):
        sines = np.array([m, n]) * line * 1e-3 / pitch
        sine2 = float(sines @ sines)
        to_rear = film.film_distance / np.sqrt(1 - sine2)
        faces = 2 * np.outer(
            [to_rear, to_rear + 1.0 / np.sqrt(1.5**2 - sine2)], sines
        )  # of the glass, where they send it
        middle = np.array([1.0, (1 - face) ** 2]) @ faces / (1 + (1 - face) ** 2)
        near = (np.abs(x - middle[0]) < 0.72) & (np.abs(y - middle[1]) < 0.72)
        light = arriving * reflectance * shares[99 + m] * shares[99 + n] * face * (1 + (1 - face) ** 2)
        scale = plan.camera.metadata["values_per_irradiance"] / side**2
        assert dots[near].sum() == pytest.approx(light * scale, rel=0.04)  # orders are drawn: 1 to 3 %
        place = [float(dots[near] @ each[near] / dots[near].sum()) for each in (x, y)]
        assert place == pytest.approx(middle.tolist(), abs=0.01)
