"""Lenses written for Zemax and CODE V: our reader reads them back as the same lens; what they cannot say is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.codev_file import codev_text
from rptcam_cl.lenstools.zemax_file import zemax_text
from rptcam_cl.optics import Lens, load_lens

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
