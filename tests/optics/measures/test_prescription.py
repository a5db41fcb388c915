"""Lenses written as text read back as the same lenses."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.export import lens_text, loses_dispersion, pbrt_text
from rptcam_cl.optics.glass import PowerSeries, TabulatedIndex
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import list_lenses, load_lens
from rptcam_cl.optics.shapes import short_radius
from rptcam_cl.optics.surface import Surface

PLAIN: list[dict[str, Any]] = [
    {"radius": 30, "thickness": 4, "glass": {"index": 1.6}, "diameter": 12},
    {"stop": True, "thickness": 2, "diameter": 8},
    {"radius": -30, "thickness": 4, "glass": {"nd": 1.5, "vd": 60}, "diameter": 12},
    {"radius": 70.5, "diameter": 14},
]
SPECIAL = [
    {"conic": -1.5, "aspheric": {4: 1e-5, 7: -2.5e-8}},
    {"cylinder": "x"},
    {"radius_x": 44.1, "conic_x": 0.3},
    {"radius_x": 44.1, "form": "toroid"},
    {"clear": {"rectangle": [8, 6]}},
    {"clear": {"half_plane_degrees": 90, "edge": -0.5}},
    {"decentre": [0.1, -0.2, 0.05]},
    {"glass": "SF5"},
    {"glass": {"linear_abbe": {"n": 1.6, "v": 10}}},
    {"glass": {"cauchy": [1.5, 0.004]}, "thickness": 3},
    {"glass": {"schott": [2.27, -0.0101, 0.0106, 2.0e-4, -6.5e-6, 4.5e-7], "range_nm": [400, 700], "name": "K"}},
    {"glass": {"sellmeier": {"b": [1.04, 0.23], "c": [0.006, 0.02], "c0": 0.1}}},
]  # fmt: skip


def read(text: str, folder: Path) -> Lens:
    path = folder / "lens.yaml"
    path.write_text(text, encoding="utf-8")
    return load_lens(path)


def with_first(**changes: Any) -> dict[str, Any]:
    return {"name": "Test lens", "surfaces": [PLAIN[0] | changes, *PLAIN[1:]]}


@pytest.mark.parametrize("name", list_lenses())
def test_every_lens_reads_back_as_itself(name: str, tmp_path: Path) -> None:
    lens = load_lens(name)
    assert read(lens_text(lens), tmp_path) == lens


@pytest.mark.parametrize("changes", SPECIAL)
def test_every_kind_of_surface_and_glass_reads_back(changes: dict[str, Any], tmp_path: Path) -> None:
    lens = load_lens(with_first(**changes))
    assert read(lens_text(lens), tmp_path) == lens


def test_stop_shapes_read_back(tmp_path: Path) -> None:
    for shape in ("heart", {"blades": 6, "curvature": 0.3}, {"star": 5}):
        rows = [PLAIN[0], PLAIN[1] | {"shape": shape}, *PLAIN[2:]]
        lens = load_lens({"name": "Shaped", "surfaces": rows})
        assert read(lens_text(lens), tmp_path) == lens


def test_tilts_read_back_up_to_rounding(tmp_path: Path) -> None:
    lens = load_lens(with_first(tilt_degrees=[3, -20, 45], decentre=[0.5, 0]))
    pose, again = lens.surfaces[0].pose, read(lens_text(lens), tmp_path).surfaces[0].pose
    assert pose is not None
    assert again is not None
    assert again.offset == pose.offset
    np.testing.assert_allclose(again.matrix(), pose.matrix(), atol=1e-15)


def test_split_dioptre_zoom_and_focusing_group_read_back(tmp_path: Path) -> None:
    half = {"clear": {"half_plane_degrees": 90}, "outside": "pass"}
    lens = load_lens(
        {
            "name": 'A "zoom": 1 # 2',
            "source": "line\nbreak",
            "object_medium": "water",
            "surfaces": [PLAIN[0] | half, {"thickness": 3, "glass": "water", "diameter": 12} | half, *PLAIN[1:]],
            "configurations": [{"name": "wide", "gaps": {2: 2}}, {"name": "far", "gaps": {2: 1.1}, "stop_diameter": 7}],
            "focusing": {"surfaces": [0, 1], "travel": [-1, 1]},
        }
    )
    assert read(lens_text(lens, ["two\nlines"]), tmp_path) == lens


def test_writer_knows_every_field_of_a_lens() -> None:
    assert {field.name for field in fields(Lens)} == {
        "name", "surfaces", "stop_index", "source", "published", "object_medium", "configurations", "focusing",
        "floating", "warnings", "first_sense", "fold", "motor",
    }  # fmt: skip
    assert {field.name for field in fields(Surface)} == {
        "curvature", "thickness", "glass", "semi_diameter", "is_stop", "conic", "aspheric", "cylinder", "form",
        "pose", "region", "stop_shape", "coating", "inner_semi_diameter", "is_mirror", "phase", "body_per_k",
    }  # fmt: skip


@pytest.mark.parametrize("radius", [12.5, 0.1, -1 / 3, 3.7e9, 29.475])
def test_short_radius_has_the_same_curvature(radius: float) -> None:
    assert 1 / short_radius(1 / radius) == pytest.approx(1 / radius, rel=2e-16)
    assert len(repr(short_radius(1 / 29.475))) == len("29.475")


def test_what_a_file_cannot_say_is_refused() -> None:
    lens = load_lens(with_first())
    odd = PowerSeries(((0.0, 1.5), (-1.0, 0.01)), False, name="measured")
    surfaces = (Surface(glass=odd, semi_diameter=5.0, thickness=1.0),)
    with pytest.raises(InputError, match="measured"):
        lens_text(Lens("x", (*surfaces, *lens.surfaces)))
    with pytest.raises(InputError, match="no diameter"):
        lens_text(Lens("x", (Surface(),)))
    with pytest.raises(InputError, match="behind a mirror"):
        lens_text(replace(lens, first_sense=-1.0))


@pytest.mark.parametrize(
    "glass", ["S-LAL8", "F2_HIKARI", {"table": {"wavelengths_nm": [400, 700], "values": [1.6, 1.5]}}]
)
def test_glasses_of_the_makers_and_tables_read_back(tmp_path: Path, glass: Any) -> None:
    lens = load_lens(with_first(glass=glass))
    path = tmp_path / "lens.yaml"
    path.write_text(lens_text(lens), encoding="utf-8")
    assert load_lens(path).surfaces == lens.surfaces
    assert isinstance(lens.surfaces[0].glass, TabulatedIndex) == isinstance(glass, dict)


def test_table_reads_back_with_the_same_surfaces(tmp_path: Path) -> None:
    lens = load_lens("dgauss-50mm")
    path = tmp_path / "lens.dat"
    path.write_text(pbrt_text(lens), encoding="utf-8")
    again = load_lens(path)
    assert not loses_dispersion(lens)
    assert again.stop_index == lens.stop_index
    for one, two in zip(lens.surfaces, again.surfaces, strict=True):
        assert (one.curvature, one.thickness, one.semi_diameter) == (two.curvature, two.thickness, two.semi_diameter)
    assert again.indices().tolist() == lens.indices().tolist()


def test_table_takes_the_indices_of_its_wavelength(tmp_path: Path) -> None:
    lens = load_lens("takumar-50mm")
    path = tmp_path / "lens.dat"
    path.write_text(pbrt_text(lens, 486.1), encoding="utf-8")
    assert loses_dispersion(lens)
    np.testing.assert_array_equal(load_lens(path).indices(), lens.indices(486.1))


@pytest.mark.parametrize(
    ("lens", "reason"),
    [
        ("phone-5.6mm", "aspheric"),
        ("cylinder-pair", "cylindrical"),
        ("human-eye", "a stop that is not in air"),
        ("zoom-70-200mm", "zoom lens"),
        ("plano-convex-100mm", "a plane, which a table has for the stop only (surface 1)"),
        ("achromat-100mm", "a stop on curved glass"),
        (with_first(tilt_degrees=[1, 0]), "tilted or decentred (surface 0)"),
        (with_first(clear={"rectangle": [1, 1]}), "not round"),
        (with_first() | {"object_medium": "water"}, "begins in air"),
    ],
)
def test_table_refuses_with_the_reason(lens: Any, reason: str) -> None:
    with pytest.raises(InputError) as caught:
        pbrt_text(load_lens(lens))
    assert reason in str(caught.value)
