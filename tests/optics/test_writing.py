"""What is written reads back as the same lens."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.errors import InputError
from rptcam_cl.optics import list_lenses, load_lens
from rptcam_cl.optics.files.write import as_mapping, write_pbrt, write_yaml


@pytest.mark.parametrize("name", list_lenses())
def test_our_form_reads_back_the_same(name, tmp_path):
    lens = load_lens(name)
    path = tmp_path / "lens.yaml"
    path.write_text(write_yaml(lens), encoding="utf-8")
    again = load_lens(path)
    assert len(path.read_text().splitlines()) < 60
    for one, two in zip(lens.surfaces, again.surfaces, strict=True):
        assert one.curvature == pytest.approx(two.curvature, rel=1e-15)
        assert replace(one, curvature=0, glass=two.glass) == replace(two, curvature=0)
    np.testing.assert_array_equal(lens.indices([450.0, 550.0, 650.0]), again.indices([450.0, 550.0, 650.0]))
    assert (again.name, again.source, again.published) == (lens.name, lens.source, lens.published)
    assert again.configurations == lens.configurations
    assert load_lens(as_mapping(lens)).surfaces == again.surfaces


@pytest.mark.parametrize("name", ["dgauss-50mm", "wide-22mm", "fisheye-10mm", "telephoto-250mm", "biotar-58mm"])
def test_pbrt_tables_read_back_the_same(name, tmp_path):
    lens = load_lens(name)
    path = tmp_path / "lens.dat"
    path.write_text(write_pbrt(lens))
    again = load_lens(path)
    assert again.stop_index == lens.stop_index
    np.testing.assert_allclose(again.vertices, lens.vertices, rtol=1e-11)
    assert again.first_order().focal_length_mm == pytest.approx(lens.first_order().focal_length_mm, rel=1e-10)


def test_what_a_pbrt_table_cannot_hold_is_named():
    for name, message in [
        ("phone-5.6mm", "cannot hold surface 1, which is not a plain sphere"),
        ("cooke-triplet-50mm", "cannot hold the stop on the refracting surface 3"),
    ]:
        with pytest.raises(InputError, match=message):
            write_pbrt(load_lens(name))


def test_glass_laws_read_back_the_same():
    for glass in (
        {"linear_abbe": {"n": 1.8, "v": 3}},
        {"cauchy": [1.5, 0.004, 1e-5], "range_nm": [300, 900]},
        {"schott": [2.27, -0.01, 0.0106, 2e-4, -7e-6, 4e-7]},
        {"sellmeier": {"b": [1.0, 0.2], "c": [0.006, 0.02]}, "name": "mine"},
    ):
        rows = [{"radius": 50, "thickness": 3, "diameter": 20, "glass": glass}, {"diameter": 20}]
        lens = load_lens({"name": "x", "surfaces": rows})
        assert load_lens(as_mapping(lens)).surfaces == lens.surfaces
