"""Ghosts in pictures against those of the lens in float64, and what hides, bounds and colours them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import (
    MAGNESIUM_FLUORIDE,
    Beam,
    Lit,
    blades,
    find_ghosts,
    load_lens,
    steps,
    unfolded,
    with_coating,
)
from rptcam_cl.rendering.diffraction_kernel import shares_of_white
from rptcam_cl.rendering.ghosts import WAVES_NM

FILM = {"resolution": [48, 32], "width_mm": 36}
PIXEL_MM2 = (36 / 48) ** 2
IRRADIANCE = 800.0


def sun(degrees: float, diameter: float = 0.1) -> dict[str, Any]:
    angle = np.radians(degrees)
    return {"kind": "sun", "direction": [0, float(np.sin(angle)), float(np.cos(angle))],
            "irradiance": [IRRADIANCE] * 3, "diameter_degrees": diameter}  # fmt: skip


def ball(height: float) -> dict[str, Any]:
    material = {"kind": "matte", "reflectance": 0.5}
    return {"shape": "sphere", "center": [0, height, -20], "radius": 2, "material": material}


def scene(light: dict[str, Any], *, objects: tuple[dict[str, Any], ...] = (), **camera: Any) -> dict[str, Any]:
    own = {"kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 0, 0], "target": [0, 0, -10], "ghosts": "on",
           "focus": {"distance_m": 100}, "transmission": "bare"}  # fmt: skip
    return {"film": FILM, "camera": own | camera, "lights": [light], "render": {"spp": 1, "layers": ["ghosts"]},
            "objects": [ball(8), *objects]}  # fmt: skip


def expected(image: rptcam_cl.Image, beam: Beam, **lit: Any) -> tuple[float, float]:
    """Return sum and mean y [mm] of the ghosts of irradiance 1, in values of the film, at d or in green."""
    lens = lit.pop("lens", load_lens("dgauss-50mm"))
    film, wave = image.metadata["film_distance_mm"], lit.pop("wave", 587.5618)
    found = find_ghosts(Lit(lens, film, beam, wave, (36.0, 24.0)))
    flux = sum(ghost.flux_in_frame for ghost in found.ghosts)
    middle = sum(ghost.flux_in_frame * ghost.centroid_mm[1] for ghost in found.ghosts if ghost.flux_in_frame > 0)
    return flux * image.metadata["values_per_irradiance"] / PIXEL_MM2, middle / flux


def centre_y(ghosts: np.ndarray) -> float:
    rows = ghosts[..., 1].sum(axis=1, dtype=np.float64)
    return float(((np.arange(32) + 0.5) / 32 - 0.5) @ rows / rows.sum() * 24)


@pytest.fixture(scope="module")
def bare() -> rptcam_cl.Image:
    return rptcam_cl.render(scene(sun(10.0)))


def test_a_sun_has_the_ghosts_of_the_lens(bare: rptcam_cl.Image) -> None:
    total, y = expected(bare, Beam(10.0))
    ghosts, left_out = bare["ghosts"], bare.metadata["ghosts"]["dropped_share"]
    assert 0 < left_out < 1e-3
    assert ghosts[..., 1].sum(dtype=np.float64) == pytest.approx(IRRADIANCE * total * (1 - left_out), rel=5e-3)
    assert centre_y(ghosts) == pytest.approx(y, abs=0.1)  # a seventh of a pixel


def test_ghosts_are_added_to_the_very_picture_without_them(bare: rptcam_cl.Image) -> None:
    off = rptcam_cl.render(scene(sun(10.0), ghosts="off"))
    np.testing.assert_array_equal(bare.pixels, off.pixels + bare["ghosts"])
    assert "ghosts" not in off.metadata
    again = rptcam_cl.render(scene(sun(10.0)), wave_size=4096)
    np.testing.assert_array_equal(again["ghosts"], bare["ghosts"])


def test_what_hides_the_sun_hides_its_ghosts() -> None:
    image = rptcam_cl.render(scene(sun(10.0), objects=(ball(-3.5),)))
    assert not image["ghosts"].any()
    assert image.metadata["ghosts"]["sources"] == 0


def test_a_sun_outside_of_the_frame_has_ghosts_within() -> None:
    image = rptcam_cl.render(scene(sun(20.0)))  # 18 mm from the middle of a frame 24 mm high
    total, _ = expected(image, Beam(20.0))
    left = 1 - image.metadata["ghosts"]["dropped_share"]
    assert image["ghosts"][..., 1].sum(dtype=np.float64) == pytest.approx(IRRADIANCE * total * left, rel=5e-3)


def test_ghosts_take_the_shape_of_the_stop() -> None:
    image = rptcam_cl.render(scene(sun(10.0), f_number=8, aperture={"shape": "polygon", "blades": 3}))
    lens = load_lens("dgauss-50mm")
    lens = lens.with_stop_diameter(lens.stop_diameter_for(8.0)).with_stop_shape(blades(3))
    total, y = expected(image, Beam(10.0), lens=lens)
    left = 1 - image.metadata["ghosts"]["dropped_share"]
    assert image["ghosts"][..., 1].sum(dtype=np.float64) == pytest.approx(IRRADIANCE * total * left, rel=0.01)
    assert centre_y(image["ghosts"]) == pytest.approx(y, abs=0.1)


def test_a_layer_colours_ghosts_as_its_closed_form_says() -> None:
    image = rptcam_cl.render(scene(sun(10.0), transmission={"coating": "mgf2"}))
    lens = with_coating(load_lens("dgauss-50mm"), MAGNESIUM_FLUORIDE)
    sums = np.array([expected(image, Beam(10.0), lens=lens, wave=wave)[0] for wave in WAVES_NM])
    colour = IRRADIANCE * sums @ shares_of_white(WAVES_NM) * (1 - image.metadata["ghosts"]["dropped_share"])
    assert image["ghosts"].sum(axis=(0, 1), dtype=np.float64) == pytest.approx(colour, rel=0.01)
    assert colour[2] > 3 * colour[1] and colour[0] > 1.5 * colour[1]  # purple, as coated lenses are


def test_a_lamp_has_the_ghosts_of_its_distance() -> None:
    lamp = {"kind": "point", "position": [0, -0.3, -2], "intensity": [50, 50, 50]}
    image = rptcam_cl.render(scene(lamp, focus={"distance_m": 2}))
    film_z = image.metadata["film_distance_mm"] + load_lens("dgauss-50mm").length
    away = 2000 - film_z
    total, y = expected(image, Beam(float(np.degrees(np.arctan(300 / away))), away))
    ghosts, left = image["ghosts"][..., 1], 1 - image.metadata["ghosts"]["dropped_share"]
    assert ghosts.sum(dtype=np.float64) == pytest.approx(50e6 * total * left, rel=5e-3)  # W/sr through mm2 at m
    assert centre_y(image["ghosts"]) == pytest.approx(y, abs=0.1)


def test_ghosts_are_those_of_rays_traced_back_from_the_film() -> None:
    lens, film, sun_radius, rng = load_lens("biconvex"), 48.0, np.radians(3.0), np.random.default_rng(5)
    lens = replace(lens, surfaces=tuple(replace(surface, semi_diameter=3.0) for surface in lens.surfaces))
    way, count, side = (1, 0), 400_000, 44.0
    back = unfolded(lens, way)
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


@pytest.mark.parametrize(
    ("camera", "fault"),
    [
        ({"transmission": "ideal"}, "camera.ghosts"),
        ({"kind": "thick_lens"}, "ghosts"),
        ({"movements": {"shift_mm": 5}}, "in its place"),
    ],
)
def test_ghosts_need_surfaces_that_reflect(camera: dict[str, Any], fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        rptcam_cl.render(scene(sun(10.0), **camera))


def test_parts_with_ghosts_are_refused() -> None:
    with pytest.raises(InputError, match="ghosts need the whole film"):
        rptcam_cl.render(scene(sun(10.0)), part="1/2")
