"""Lenses written for Zemax and CODE V: our reader reads them back as the same lens; what they cannot say is refused."""

import contextlib
import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.export import codev_text, zemax_text
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import list_lenses, load_lens

WRITERS = {".zmx": zemax_text, ".seq": codev_text}


def again(lens: Lens, suffix: str, folder: Path) -> Lens:
    path = folder / f"lens{suffix}"
    path.write_text(WRITERS[suffix](lens), encoding="utf-8")
    return load_lens(path)


def lens_with(**first: Any) -> Lens:
    rows = [
        {"radius": 60.0, "thickness": 4.0, "glass": "N-SK16", "diameter": 20.0},
        {"radius": -70.0, "thickness": 3.0, "diameter": 20.0, **first},
        {"stop": True, "thickness": 4.0, "diameter": 9.0},
        {"radius": 90.0, "thickness": 3.0, "glass": "F2_HIKARI", "diameter": 20.0},
        {"radius": 400.0, "diameter": 20.0},
    ]
    return load_lens({"name": "a 'lens'", "surfaces": rows})


def check_same_rays(one: Lens, two: Lens) -> None:
    rng = np.random.default_rng(7)
    origins = np.column_stack([rng.uniform(-5, 5, (60, 2)), np.full(60, -10.0)])
    directions = np.column_stack([rng.uniform(-0.15, 0.15, (60, 2)), np.ones(60)])
    for wavelength in (486.1327, 587.5618, 656.2725):
        a, b = (lens.trace(origins, directions, wavelength, start="scene") for lens in (one, two))
        assert a.status.tolist() == b.status.tolist()
        assert a.passed.sum() > 5
        np.testing.assert_allclose(a.origins[a.passed], b.origins[a.passed], atol=1e-10)
        np.testing.assert_allclose(a.directions[a.passed], b.directions[a.passed], atol=1e-12)


LIBRARY = [
    "cooke-triplet-50mm",
    "dgauss-50mm",
    "achromat-100mm",
    "planar-1897",
    "biotar-58mm",
    "telephoto-250mm",
    "ball",
]


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("name", LIBRARY)
def test_lenses_of_the_library_come_back(tmp_path: Path, name: str, suffix: str) -> None:
    lens = load_lens(name)
    back = again(lens, suffix, tmp_path)
    assert len(back.surfaces) == len(lens.surfaces)
    assert back.first_order().focal_length_mm == pytest.approx(lens.first_order().focal_length_mm, rel=1e-13)
    for one, two in zip(lens.surfaces, back.surfaces, strict=True):
        assert (one.thickness, one.semi_diameter) == (two.thickness, two.semi_diameter)
        assert two.curvature == pytest.approx(one.curvature, rel=1e-15)
        np.testing.assert_allclose(
            one.glass.index([486.1, 587.6, 656.3]), two.glass.index([486.1, 587.6, 656.3]), atol=1e-6
        )


SHAPES: list[tuple[str, dict[str, Any]]] = [
    ("conic", {"conic": -0.7}),
    ("even asphere", {"conic": -0.7, "aspheric": {4: 1e-5, 6: -2e-8, 10: 1e-13}}),
    ("odd asphere", {"aspheric": {3: 1e-5, 4: 1e-6}}),
    ("r^2", {"aspheric": {2: 1e-4, 16: 1e-20}}),
    ("cylinder in y", {"cylinder": "y", "conic": -0.5}),
    ("cylinder in x", {"cylinder": "x"}),
    ("toroid", {"radius_x": 100.0, "form": "toroid"}),
    ("biconic", {"radius_x": 100.0, "conic_x": 0.3}),
    ("rectangle", {"clear": {"rectangle": [6, 4]}}),
    ("tilted", {"decentre": [0.5, -0.3], "tilt_degrees": [3, -2, 5]}),
    ("along the axis", {"decentre": [0.5, 0, 0.2], "tilt_degrees": [1, 0, 0]}),
    ("constant index", {"glass": {"index": 1.3}}),
    ("model glass", {"glass": {"nd": 1.6234567, "vd": 51.23}}),
    ("fused silica", {"glass": "fused silica"}),
]
UNSAID = {".zmx": set(), ".seq": {"odd asphere", "r^2", "cylinder in x", "biconic"}}


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize(("kind", "first"), SHAPES, ids=[kind for kind, _ in SHAPES])
def test_every_kind_of_surface_comes_back_or_is_refused(
    tmp_path: Path, kind: str, first: dict[str, Any], suffix: str
) -> None:
    lens = lens_with(**first)
    if kind in UNSAID[suffix]:
        with pytest.raises(InputError, match=rf"a {suffix} file cannot say it: .* \(surface 1\)"):
            WRITERS[suffix](lens)
        return
    back = again(lens, suffix, tmp_path)
    if suffix == ".seq" and kind in ("fused silica", "model glass"):  # a private glass is a table
        assert back.first_order().focal_length_mm == pytest.approx(lens.first_order().focal_length_mm, rel=1e-9)
        return
    check_same_rays(lens, back)
    assert back.surfaces[-2].glass.name == "F2_HIKARI"


@pytest.mark.parametrize("suffix", WRITERS)
def test_plates_with_an_opening_before_and_behind_a_lens_come_back(tmp_path: Path, suffix: str) -> None:
    plate = {"thickness": 5.0, "diameter": 7.0}
    front = {"radius": 60.0, "thickness": 4.0, "glass": "N-SK16", "diameter": 20.0, "stop": True}
    rear = {"radius": -70.0, "thickness": 3.0, "diameter": 20.0}
    lens = load_lens({"name": "hood", "surfaces": [plate, front, rear, plate]})
    back = again(lens, suffix, tmp_path)
    assert [surface.semi_diameter for surface in back.surfaces] == [3.5, 10, 10, 3.5]
    check_same_rays(lens, back)


@pytest.mark.parametrize("suffix", WRITERS)
def test_what_neither_can_say_is_refused_by_name(suffix: str) -> None:
    for lens, reason in [
        (load_lens("zoom-70-200mm"), "it is a zoom lens"),
        (lens_with(clear={"half_plane_degrees": 90}), "only a part of it is there"),
        (load_lens({"object_medium": "water", "surfaces": [{"radius": 9, "diameter": 3}]}), "is water, not air"),
    ]:
        with pytest.raises(InputError, match=reason):
            WRITERS[suffix](lens)


@pytest.mark.parametrize("suffix", WRITERS)
def test_convert_writes_them(tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"out{suffix}"
    assert main(["lens", "convert", "dgauss-50mm", "--f-number", "4", "-o", str(path)]) == 0
    lens = load_lens(path)
    assert lens.first_order().f_number == pytest.approx(4)
    assert "N-BK7 0 0" in zemax_text(load_lens("achromat-100mm"))
    assert "NBK7_SCHOTT" in codev_text(load_lens("achromat-100mm"))
    assert main(["lens", "convert", "zoom-70-200mm", "-o", str(path)]) == 2


def test_no_glass_is_written_with_an_abbe_number_of_0(tmp_path: Path) -> None:
    lens = load_lens("dgauss-50mm")
    glasses = [line.split() for line in zemax_text(lens).splitlines() if "GLAS" in line]
    assert [float(words[4]) for words in glasses] == [
        s.glass.index(550) for s in lens.surfaces if s.glass.name != "air"
    ]
    assert {float(words[5]) for words in glasses} == {1e6}
    for suffix in WRITERS:
        back = again(lens, suffix, tmp_path)
        np.testing.assert_array_equal(lens.indices([400, 550, 700]), back.indices([400, 550, 700]))


def test_private_glasses_of_a_sequence_are_called_by_their_index_and_abbe_number(tmp_path: Path) -> None:
    rows: list[dict[str, Any]] = [
        {"radius": 60, "thickness": 4, "glass": {"index": 1.67}},
        {"radius": -70, "thickness": 3, "glass": {"nd": 1.6234567, "vd": 51.23}},
        {"radius": 70, "thickness": 3, "glass": {"cauchy": [1.5, 0.004]}},
        {"radius": 80, "thickness": 3, "glass": {"cauchy": [1.5, 0.004, 1e-9]}},
        {"radius": 90, "stop": True},
    ]
    lens = load_lens({"name": "Zoom", "surfaces": [row | {"diameter": 9} for row in rows]})
    text = codev_text(lens)
    assert "TITLE ' Zoom'" in text  # ray-optics takes a Z for a position
    block = text[text.index("PRV") : text.index("END")]
    kept = dict(re.findall(r"^  '([^']+)' (.+)$", block, re.MULTILINE))
    used = re.findall(r"^S .* '([^']+)'$", text, re.MULTILINE)
    assert len(set(used)) == 4 and set(used) == kept.keys()
    nm = [float(word) for word in re.findall(r"PWL (.+)", block)[0].split()]
    for name, medium in zip(used, lens.media[1:], strict=False):
        nd, vd = map(float, name.split(":"))
        assert nd == pytest.approx(float(medium.index(587.5618)), rel=1e-15)
        f, c = medium.index([486.1327, 656.2725])
        assert vd == pytest.approx((nd - 1) / (f - c) if f > c else 1e6)
        np.testing.assert_allclose([float(word) for word in kept[name].split()], medium.index(nm), rtol=1e-15)
    back = again(lens, ".seq", tmp_path)
    assert back.name == "Zoom"
    np.testing.assert_array_equal(back.indices([450, 700])[:3], lens.indices([450, 700])[:3])


def test_a_cylinder_that_curves_in_x_is_a_line_turned_about_an_axis(tmp_path: Path) -> None:
    lens = lens_with(cylinder="x")
    assert re.search(r"TYPE TOROIDAL\n  CURV 0\.0 .*\n  PARM 1 -70\.0\n", zemax_text(lens))
    assert again(lens, ".zmx", tmp_path).surfaces[1].cylinder == "x"


UNWRITTEN = {("phone-5.6mm", ".zmx"), ("phone-5.6mm", ".seq"), ("cylinder-pair", ".seq"), ("anamorphic-100mm", ".seq")}
EXPORTS = [(name, suffix) for name in list_lenses() for suffix in WRITERS if (name, suffix) not in UNWRITTEN]


def exported(name: str, suffix: str, folder: Path) -> tuple[Lens, str]:
    lens = replace(load_lens(name), configurations=())
    path = folder / f"lens{suffix}"
    path.write_text(WRITERS[suffix](lens))
    return lens, str(path)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("name", "suffix"), EXPORTS)
def test_optiland_reads_every_lens_of_the_library(tmp_path: Path, name: str, suffix: str) -> None:
    files = pytest.importorskip("optiland.fileio")
    lens, path = exported(name, suffix, tmp_path)
    read = (files.load_zemax_file if suffix == ".zmx" else files.load_codev_file)(path).paraxial
    first, index = lens.first_order(), float(lens.indices()[-1])  # behind a lens, its focal lengths are those in air
    assert float(np.ravel(read.f2())[0]) == pytest.approx(first.focal_length_mm / index, rel=1e-4)
    assert float(np.ravel(read.EPD())[0]) == pytest.approx(first.entrance_pupil.diameter_mm, rel=1e-6)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("name", "suffix"), EXPORTS)
def test_ray_optics_reads_every_lens_of_the_library(tmp_path: Path, name: str, suffix: str) -> None:
    environment = pytest.importorskip("rayoptics.environment")
    lens, path = exported(name, suffix, tmp_path)
    with contextlib.redirect_stdout(io.StringIO()):
        model = environment.open_model(path)
        model.update_model()
    read, first = model["analysis_results"]["parax_data"].fod, lens.first_order()
    assert read.efl == pytest.approx(first.focal_length_mm, rel=2e-4)  # its catalogue has older glasses
    assert 2 * read.enp_radius == pytest.approx(first.entrance_pupil.diameter_mm, rel=1e-6)
