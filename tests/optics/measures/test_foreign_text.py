"""Lenses written for Zemax and CODE V: our reader reads them back as the same lens; what they cannot say is refused."""

import contextlib
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.export import codev_text, with_model_glasses, zemax_text
from rptcam_cl.optics.lens import Lens, brought_to_focus, in_configuration
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
    assert main(["lens", "convert", "zoom-70-200mm", "-o", str(path)]) == 0
    assert len(load_lens(path).configurations) == 3
    assert main(["lens", "convert", "zoom-70-200mm", "-o", str(path.with_suffix(".dat"))]) == 2
    assert main(["lens", "convert", "achromat-100mm", "--model-glasses", "-o", str(path)]) == 0
    assert "N-BK7" not in path.read_text() and load_lens(path).first_order().focal_length_mm == pytest.approx(
        load_lens("achromat-100mm").first_order().focal_length_mm, rel=1e-12
    )


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
    lens = with_model_glasses(load_lens(name))  # catalogues of programs differ
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
    assert float(np.ravel(read.f2())[0]) == pytest.approx(first.focal_length_mm / index, rel=1e-6)
    assert float(np.ravel(read.EPD())[0]) == pytest.approx(first.entrance_pupil.diameter_mm, rel=1e-6)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("name", "suffix"), EXPORTS)
def test_ray_optics_reads_every_lens_of_the_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, suffix: str
) -> None:
    monkeypatch.chdir(tmp_path)  # it writes logs
    environment = pytest.importorskip("rayoptics.environment")
    lens, path = exported(name, suffix, tmp_path)
    with contextlib.redirect_stdout(io.StringIO()):
        model = environment.open_model(path)
        model.update_model()
    read, first = model["analysis_results"]["parax_data"].fod, lens.first_order()
    assert read.efl == pytest.approx(first.focal_length_mm, rel=1e-6)
    assert 2 * read.enp_radius == pytest.approx(first.entrance_pupil.diameter_mm, rel=1e-6)


def floating_zoom() -> Lens:
    rows: list[dict[str, Any]] = [
        {"radius": 60, "thickness": 4, "glass": {"nd": 1.6, "vd": 55}, "diameter": 20},
        {"radius": -90, "thickness": 3, "diameter": 20},
        {"radius": -70, "thickness": 2, "glass": {"nd": 1.7, "vd": 30}, "diameter": 18, "tilt_degrees": [0.1, 0]},
        {"radius": 90, "thickness": 5, "diameter": 18},
        {"stop": True, "thickness": 2, "diameter": 12},
        {"radius": 40, "thickness": 4, "glass": {"nd": 1.6, "vd": 55}, "diameter": 18},
        {"radius": -60, "diameter": 18},
    ]
    zoom = [
        {"name": "wide", "gaps": {1: 3, 3: 9}, "floating": [
            {"distance": 900, "gaps": {1: 4, 3: 8}}, {"distance": 600, "gaps": {1: 5, 3: 7}}]},
        {"name": "long", "gaps": {1: 8, 3: 4}, "stop_diameter": 11, "floating": [
            {"distance": 1200, "gaps": {1: 8.5, 3: 3.5}}, {"distance": 800, "gaps": {1: 9, 3: 3}}]},
    ]  # fmt: skip
    return load_lens({"name": "Zoom", "surfaces": rows, "configurations": zoom})


@pytest.mark.parametrize("suffix", WRITERS)
def test_zoom_positions_and_near_states_are_read_back(tmp_path: Path, suffix: str) -> None:
    lens = floating_zoom()
    back = again(lens, suffix, tmp_path)
    assert [each.name for each in back.configurations] == (["1", "2"] if suffix == ".zmx" else ["wide", "long"])
    for ours, read in zip(lens.configurations, back.configurations, strict=True):
        one, other = in_configuration(lens, ours.name), in_configuration(back, read.name)
        pupil = one.first_order().entrance_pupil.diameter_mm
        assert other.first_order().entrance_pupil.diameter_mm == pytest.approx(pupil, rel=1e-12)
        assert len(read.floating) == len(ours.floating) == 2
        for near, state in zip(ours.floating, read.floating, strict=True):
            assert state.distance_mm == pytest.approx(near.distance_mm, rel=1e-12)
            mine, film = brought_to_focus(one, near.distance_mm)
            read_back, its_film = brought_to_focus(other, near.distance_mm)
            assert its_film == pytest.approx(film, rel=1e-9)
            assert read_back.first_order().focal_length_mm == pytest.approx(
                mine.first_order().focal_length_mm, rel=1e-9
            )


ZOOMED = """RDM;LEN
TITLE 'Two lenses'
EPD 8
DIM M
SO 0 1E13
S 60 4 1.6:55
S -60 5
S -90 2 1.7:30
S 90 6
STO
SI 0 0
ZOO 3
{}
GO
"""


@pytest.mark.parametrize(
    "lines",
    [
        "ZOO THI S2 5 9 7\nZOO THI S4 80 90 95\nZOO THI SO 1E13 1E13 1E13\nTIT Z2 'long'",
        "THI S2 Z1 5; THI S2 Z2 9; THI S2 Z3 7; TIT Z2 'long'",
    ],
    ids=["in a row", "one by one"],
)
def test_positions_of_a_sequence_are_read_however_they_are_written(tmp_path: Path, lines: str) -> None:
    path = tmp_path / "zoom.seq"
    path.write_text(ZOOMED.format(lines))
    lens = load_lens(path)
    assert [(each.name, dict(each.gaps)) for each in lens.configurations] == [
        ("1", {1: 5.0}), ("long", {1: 9.0}), ("3", {1: 7.0}),
    ]  # fmt: skip
    assert lens.surfaces[1].thickness == 5.0
    assert [note.split(": ", 1)[1][:9] for note in lens.warnings] == ["diameters"]


def test_what_positions_differ_in_beside_spaces_is_said(tmp_path: Path) -> None:
    path = tmp_path / "zoom.seq"
    path.write_text(ZOOMED.format("ZOO THI S2 5 9 7\nCIR S1 Z2 4\nZOO YAN F1 3 2 1"))
    notes = "; ".join(load_lens(path).warnings)
    assert "zoom.seq:14: CIR of position Z2 is ignored" in notes and "zoom.seq:15: YAN of the positions" in notes
    path.write_text(ZOOMED.format("ZOO THI S4 80 90 95"))
    assert "its 3 positions move no surfaces: it is read as saved" in "; ".join(load_lens(path).warnings)
