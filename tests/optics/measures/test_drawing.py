"""Drawings: what is in them agrees with the reference, and every lens of the library can be drawn."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import open_session
from rptcam_cl.optics.charts import Path
from rptcam_cl.optics.drawing import View, draw_lens, glass, profile, ray_paths, reference, svg
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import Status
from rptcam_cl.optics.spots import default_fields, section_rays, setting, widest_field
from rptcam_cl.rendering.traceable_lens import device_tracer
from rptcam_cl.rendering.traceable_lens import load_lens as traced_lens
from tests.support.lenses import each_lens

SPHERE = {
    "name": "Thick ball",
    "surfaces": [
        {"radius": 20, "thickness": 12, "glass": {"index": 1.5}, "diameter": 20},
        {"stop": True, "radius": -20, "diameter": 16},
    ],
}


@pytest.mark.parametrize("name", each_lens())
def test_every_lens_is_drawn_with_rays_that_reach_the_film(name: str) -> None:
    lens = load_lens(name)
    picture = draw_lens(setting(lens), View(rays=3, fields=(0.0,), blocked=False))
    rays = [shape for shape in picture.shapes if isinstance(shape, Path) and shape.width == 0.9]
    assert len(rays) == 3
    assert len({len(ray.points) for ray in rays}) == 1
    assert len(rays[0].points) == len(lens.surfaces) + 2


def test_svg_is_well_formed_and_always_the_same() -> None:
    lens = load_lens("dgauss-50mm")
    text = svg(lens, f_number=4, rays=3)
    root = ElementTree.fromstring(text)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert "nan" not in text
    assert text == svg(lens, f_number=4, rays=3)


def test_a_notebook_shows_the_drawing() -> None:
    assert traced_lens("tessar-100mm")._repr_svg_().startswith("<svg")


def test_profile_lies_on_the_surface_up_to_its_rim() -> None:
    lens = load_lens(SPHERE)
    z, height = profile(lens, 0, "y").T
    np.testing.assert_allclose((z - 20) ** 2 + height**2, 400, rtol=1e-12)
    np.testing.assert_allclose(height[[0, -1]], [-10, 10])
    ((index, outline),) = glass(lens, "y", 587.56)
    assert index == 1.5
    assert outline[:, 1].max() == pytest.approx(10)


def test_corners_of_a_ray_lie_on_the_surfaces_and_obey_snell() -> None:
    lens = load_lens(SPHERE)
    origins, directions = section_rays(setting(lens), 10.0, np.array([[0.0, -3.0], [0.0, 2.0]]), "y")
    paths = ray_paths(lens, origins, directions, 587.56, reference)
    for ray in range(2):
        _, first, second = paths.corners(ray)
        assert first[1] ** 2 + (first[2] - 20) ** 2 == pytest.approx(400)
        assert second[1] ** 2 + (second[2] + 8) ** 2 == pytest.approx(400)
        normal = (np.array([0, 0, 20]) - first) / 20
        inside = (second - first) / np.linalg.norm(second - first)
        before, after = np.cross(directions[ray], normal), np.cross(inside, normal)
        np.testing.assert_allclose(before, 1.5 * after, atol=1e-12)


@pytest.mark.parametrize("name", ["dgauss-50mm", "phone-5.6mm", "cylinder-pair"])
def test_rays_of_the_device_are_those_of_the_reference(name: str) -> None:
    state = setting(load_lens(name))
    points = np.column_stack([np.zeros(9), np.linspace(-0.8, 0.8, 9) * state.lens.surfaces[0].semi_diameter])
    origins, directions = section_rays(state, 5.0, points, "y")
    by_device = ray_paths(state.lens, origins, directions, 587.56, device_tracer(open_session(None)))
    exact = ray_paths(state.lens, origins, directions, 587.56, reference)
    np.testing.assert_array_equal(by_device.last.status, exact.last.status)
    np.testing.assert_array_equal(by_device.last.surface, exact.last.surface)
    passed = exact.last.passed
    # float32 over a few centimetres of glass keeps about 1e-5 mm: a ten-thousandth of a drawn pixel
    np.testing.assert_allclose(by_device.points[:, passed], exact.points[:, passed], atol=1e-4)


def test_blocked_rays_are_marked_where_and_with_what_stopped_them() -> None:
    state = setting(load_lens(SPHERE))
    origins, directions = section_rays(state, 0.0, np.array([[0.0, 0.0], [0.0, 9.9], [0.0, 25.0]]), "y")
    paths = ray_paths(state.lens, origins, directions, 587.56, reference)
    assert paths.last.status.tolist() == [Status.ok, Status.clipped, Status.missed]
    assert [len(paths.corners(ray)) for ray in range(3)] == [3, 3, 2]
    assert paths.corners(2)[-1][2] == pytest.approx(0)
    text = svg(state.lens, fields=(0.0,), rays=41)
    assert re.search(r"<title>clipped at surface 1</title>", text)
    assert "clipped: " in text
    assert "clipped" not in svg(state.lens, fields=(0.0,), rays=5, blocked=False)


def test_sections_of_a_cylinder_differ() -> None:
    lens = load_lens("cylinder-pair")
    flat, curved = profile(lens, 0, "x"), profile(lens, 0, "y")
    assert np.ptp(flat[:, 0]) == 0
    assert np.ptp(curved[:, 0]) > 0.5
    assert svg(lens, section="x") != svg(lens, section="y")


def test_widest_field_of_the_wide_angle_is_near_what_its_source_says() -> None:
    assert widest_field(setting(load_lens("wide-22mm"))) == pytest.approx(38, abs=5)
    fields = default_fields(setting(load_lens("telephoto-400mm")))
    assert fields[0] == 0
    assert fields == sorted(fields)


def test_lens_without_a_real_image_is_drawn_without_film() -> None:
    text = svg(load_lens("biconcave"))
    assert "<title>film</title>" not in text


@pytest.mark.parametrize(("options", "message"), [({"section": "z"}, "section"), ({"rays": 0}, "at least one ray")])
def test_impossible_views_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        svg(load_lens("ball"), **options)
