"""The camera whose rays come out of polynomials, beside the one that traces them, with the same random numbers."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.api.job import render
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from tests.device.probes import camera_rays
from tests.support.cases import slow

WIDTH = 96
DISTANCE_M = 2.0


def scene_of(lens="dgauss-50mm", width_mm=36.0, **camera):
    return load_scene(
        {
            "film": {"resolution": [WIDTH, WIDTH * 2 // 3], "width_mm": width_mm},
            "camera": {"kind": "realistic", "lens": lens, "eye": [0, 0, DISTANCE_M], "target": [0, 0, 0],
                       "focus": {"distance_m": DISTANCE_M}, **camera},
            "environment": {"kind": "constant", "radiance": 1},
        }
    )  # fmt: skip


def both_ways(session, scene, spoil=None):
    """Return the rays traced and fitted, and by how many pixels they differ in the plane in focus."""
    fitted = change_scene(scene, camera={"rays": "fitted"})

    def spoiled(camera):
        return replace(camera, tables=spoil(camera)) if spoil is not None else camera

    ways = camera_rays(session, scene, 4, 16), camera_rays(session, fitted, 4, 16, change=spoiled)
    lit = (ways[0].weight > 0) & (ways[1].weight > 0)
    planes = [way.origin + way.direction * (-(DISTANCE_M + way.origin[:, 2:]) / way.direction[:, 2:]) for way in ways]
    per_pixel = 2 * np.tan(np.deg2rad(39.3) / 2) * DISTANCE_M / WIDTH if scene.camera.lens == "dgauss-50mm" else None
    apart = np.linalg.norm(planes[0] - planes[1], axis=1)[lit]
    return *ways, apart / per_pixel if per_pixel else apart


def test_rays_and_light_are_those_of_the_traced_lens(session):
    for f_number in (2.2, 5.6):
        traced, fitted, apart_px = both_ways(session, scene_of(f_number=f_number))
        assert apart_px.max() < 0.25
        assert abs(fitted.weight.sum() / traced.weight.sum() - 1) < 2e-3
        assert np.mean((traced.weight > 0) != (fitted.weight > 0)) < 5e-3
        same = (traced.weight > 0) & (fitted.weight > 0)
        np.testing.assert_array_equal(traced.weight[same], fitted.weight[same])


@pytest.mark.parametrize("place", [0, 1, 2, 3, 4, 5, 6, 9, 10, 11], ids=lambda place: f"number {place} of the rays")
def test_every_number_of_the_table_counts(session, place):
    def spoil(camera):
        table, start = camera.tables.copy(), int(camera.record["own"]["realistic"]["first_polynomial"][0])
        table[start + 4 + place] += 100.0 if place % 6 in (0, 1, 4) else 0.02  # millimetres, or parts of a direction
        return table

    *_, apart_px = both_ways(session, scene_of(f_number=2.2), spoil)
    assert apart_px.max() > 0.25


@pytest.mark.slow
def test_the_shape_of_the_stop_is_seen(session):
    heart = scene_of(aperture={"shape": "heart"}, f_number=4)
    traced, fitted, apart_px = both_ways(session, heart)
    assert apart_px.max() < 0.25
    lit = traced.weight > 0
    assert 0.3 < lit.mean() < 0.8  # a good part of the circle is blocked, and by both alike
    assert np.mean(lit != (fitted.weight > 0)) < 0.01


@pytest.mark.slow
def test_each_wavelength_goes_its_own_way():
    scene = scene_of("planar-1897", width_mm=24.0)
    scene = change_scene(
        scene, film={"resolution": [48, 32]}, spectrum={"mode": "dispersive", "lens": "on"}, render={"spp": 4}
    )
    fitted = change_scene(scene, camera={"rays": "fitted"})
    assert make_plan(fitted).camera.facts["MAP_COLOURS"] == 1
    pictures = [np.asarray(render(each, seed=3)) for each in (scene, fitted)]
    np.testing.assert_allclose(pictures[1].mean((0, 1)), pictures[0].mean((0, 1)), rtol=3e-3)


def test_metadata_tells_degree_and_errors():
    metadata = make_plan(scene_of(rays="fitted")).camera.metadata
    assert metadata["lens_rays"] == "fitted"
    assert metadata["lens_degree"] in (3, 5, 7, 9)
    assert 0 < metadata["lens_error_px"] <= 0.25 and metadata["lens_light_error"] <= 2e-3


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"transmission": {"fresnel": True}}, "camera.rays: fitted rays know no losses"),
        ({"precision": "double"}, "camera.rays: fitted rays are float32"),
        ({"pupil": "rear"}, "camera.rays: fitted rays hold for the true pupil alone"),
        slow({"lens": "anamorphic-100mm"}, "camera.rays: .* not the same from every azimuth; use traced"),
    ],
)
def test_what_cannot_be_fitted_is_refused(keys, why):
    with pytest.raises(InputError, match=why):
        make_plan(scene_of(**({"rays": "fitted"} | keys)))


def test_small_errors_are_asked_for_by_accuracy():
    wide = make_plan(scene_of(rays="fitted")).camera.metadata["lens_degree"]
    tight = make_plan(scene_of(rays="fitted", accuracy={"max_error_px": 0.002})).camera.metadata
    assert tight["lens_degree"] > wide and tight["lens_error_px"] <= 0.002
