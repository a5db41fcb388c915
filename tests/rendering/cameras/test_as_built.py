"""Cameras behind a copy of their lens: which copy, where its film stands, and that a design stays as it was."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.api.job import render
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.as_built import Heat
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.cameras.setting import design_to_focus, film_for_infinity, lens_setting
from rptcam_cl.scene.changes import change_scene, set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.drives import GroupDrive
from tests.rendering.cameras.beams import PRECISIONS, doubtful, film_beam, on_device

SPEC = """\
copies: 20
merit: {fields_degrees: [0, 14], wavelengths_nm: [587.56]}
tolerances:
  - {radius_percent: 0.2}
  - {index: 0.001}
  - {tilt_arcmin: 6}
  - {decentre_mm: 0.1}
"""
ZERO = (
    "copies: 10\ntolerances: [{radius_percent: 0}, {index: 0}, {abbe_percent: 0}, {tilt_arcmin: 0}, {spacing_mm: 0}]\n"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "shop.yaml").write_text(SPEC)
    (tmp_path / "zero.yaml").write_text(ZERO)
    return tmp_path


def scene(
    folder: Path, lens: Any, focus: dict[str, Any] | None = None, *sets: str, film_mm: float = 30.0, **camera: Any
) -> Scene:
    keys = {"kind": "realistic", "eye": [0, 0, 1], "target": [0, 0, 0], "lens": lens}
    keys |= {"focus": focus or {"distance_m": 1.0}} | camera
    board = {"shape": "rectangle", "corner": [-0.5, -0.4, 0], "edge_u": [1, 0, 0], "edge_v": [0, 0.8, 0]}
    board["material"] = {
        "kind": "matte",
        "reflectance": {"kind": "checker", "even": 0.1, "odd": 0.9, "scale": [40, 32]},
    }
    data = {"film": {"resolution": [24, 16], "width_mm": film_mm}, "camera": keys, "objects": [board]}
    return load_scene(data | {"environment": {"kind": "constant", "radiance": 1}}, sets, base_dir=folder)


def built(percentile: str, spec: str = "shop.yaml", design: Any = "cooke-triplet-50mm") -> dict[str, Any]:
    return {"design": design, "as_built": {"percentile": percentile, "spec": spec}}


def test_zero_tolerances_change_no_bit(folder: Path) -> None:
    design, made = (camera_model(scene(folder, lens)) for lens in ("cooke-triplet-50mm", built("90%", "zero.yaml")))
    assert made.facts == design.facts
    for one, other in ((made.record, design.record), (made.surfaces, design.surfaces), (made.tables, design.tables)):
        assert one.tobytes() == other.tobytes()


def test_design_written_out_is_the_lens_alone(folder: Path) -> None:
    alone, spelled = (scene(folder, lens) for lens in ("cooke-triplet-50mm", {"design": "cooke-triplet-50mm"}))
    one, other = lens_setting(spelled), lens_setting(alone)
    assert (one.lens, one.film_distance_mm, one.metadata) == (other.lens, other.film_distance_mm, other.metadata)


@pytest.mark.slow
def test_device_follows_float64_through_a_copy(folder: Path, session: Any) -> None:
    lens = lens_setting(scene(folder, built("90%"))).lens
    assert not lens.is_rotational
    rays = film_beam(lens, 1500)
    sure, expected = ~doubtful(lens, *rays), lens.trace(*rays)
    both = sure & expected.passed
    assert both.sum() > 400
    for precision in PRECISIONS:
        found = on_device(session, lens, *rays, precision)
        np.testing.assert_array_equal(found.status[sure], expected.status[sure])
        bound = 2e-6 if precision == "single" else 1e-14  # of directions: some roundings, six surfaces
        assert np.abs(found.directions - expected.directions)[both].max() <= bound
        assert np.abs(found.origins - expected.origins)[both].max() <= 20 * bound  # millimetres


def test_worse_percentiles_are_worse_copies(folder: Path) -> None:
    spots = [
        lens_setting(scene(folder, built(percent))).metadata["as_built"]["spot_um"] for percent in ("10%", "50%", "90%")
    ]
    assert spots == sorted(spots)
    assert spots[2] > 1.1 * spots[0]


def test_copy_stays_however_the_lens_is_set(folder: Path) -> None:
    plain = lens_setting(scene(folder, built("50%")))
    for focus, keys in (({"distance_m": 3.0}, {}), ({"distance_m": 1.0}, {"f_number": 8}), ({"point": [0, 0, -1]}, {})):
        other = lens_setting(scene(folder, built("50%"), focus, **keys))
        assert other.metadata["as_built"] == plain.metadata["as_built"]
        for one, two in zip(plain.lens.surfaces, other.lens.surfaces, strict=True):
            assert (one.curvature, one.glass, one.pose) == (two.curvature, two.glass, two.pose)


def test_film_stands_by_the_scale_of_the_design_and_the_adjustment_of_the_copy(folder: Path) -> None:
    design, made = (lens_setting(scene(folder, lens)) for lens in ("cooke-triplet-50mm", built("90%")))
    shift = made.metadata["as_built"]["refocus_mm"]
    assert shift != 0
    assert made.film_distance_mm == design.film_distance_mm + shift
    front = [
        lens_setting(scene(folder, lens, {"front_distance_m": 2.0})) for lens in ("cooke-triplet-50mm", built("90%"))
    ]
    assert front[1].film_distance_mm == front[0].film_distance_mm + shift
    given = lens_setting(scene(folder, built("90%"), {"film_distance_mm": 45.0}))
    assert given.film_distance_mm == 45.0
    assert given.lens == made.lens


def test_lens_that_is_not_refocused_has_the_film_of_its_design(folder: Path) -> None:
    (folder / "fixed.yaml").write_text(f"refocus: false\n{SPEC}")
    design, made = (lens_setting(scene(folder, lens)) for lens in ("cooke-triplet-50mm", built("90%", "fixed.yaml")))
    assert made.film_distance_mm == design.film_distance_mm
    assert made.lens != design.lens


def test_group_that_focuses_keeps_the_film_where_autofocus_has_it(folder: Path) -> None:
    triplet = load_lens("cooke-triplet-50mm")
    rows = [{"radius": s.radius, "thickness": s.thickness, "diameter": 2 * s.semi_diameter} for s in triplet.surfaces]
    for k, glass in ((0, "N-SK16"), (2, "F2"), (4, "N-SK16")):
        rows[k]["glass"] = glass
    design = {"surfaces": rows, "focusing": {"surfaces": [0, 1], "travel": [-1, 1]}}
    made = scene(folder, built("90%", design=design), {"group_shift_mm": -0.2})
    setting, camera = lens_setting(made), made.camera
    state, film_distance_mm = GroupDrive(made, setting.real.lens(design_to_focus(made, camera))).lens_at(-0.2)  # type: ignore[arg-type]
    assert (state, film_distance_mm) == (setting.lens, setting.film_distance_mm)
    shift = setting.metadata["as_built"]["refocus_mm"]
    plain = scene(folder, design, {"group_shift_mm": -0.2})
    assert film_for_infinity(made, camera) == film_for_infinity(plain, plain.camera) + shift  # type: ignore[arg-type]


@pytest.mark.parametrize("lens", ["cooke-triplet-50mm", {"design": "cooke-triplet-50mm"}, "own.yaml", "written"])
def test_option_sets_the_percentile_of_any_lens(folder: Path, checkout: Path, lens: Any) -> None:
    (folder / "own.yaml").write_text((checkout / "lenses" / "cooke-triplet-50mm.yaml").read_text())
    if lens == "written":
        lens = {"surfaces": [{"radius": 50, "thickness": 5, "glass": "N-BK7", "diameter": 12}, {"diameter": 12}]}
    sets = ("camera.lens.as_built.percentile=90%", "camera.lens.as_built.spec=shop.yaml")
    changed = scene(folder, lens, None, *sets).camera
    assert changed.as_built is not None  # type: ignore[union-attr]
    assert (changed.as_built.percent, changed.as_built.spec) == (90.0, "shop.yaml")  # type: ignore[union-attr]
    short = scene(folder, lens, None, "camera.lens.as_built=10%").camera
    assert (short.as_built.percent, short.as_built.spec) == (10.0, "commercial")  # type: ignore[union-attr]


def test_board_of_the_page_is_a_scene(checkout: Path) -> None:
    chart = load_scene(checkout / "examples" / "tolerances" / "chart.yml", ["camera.lens.as_built=90%"])
    assert chart.camera.as_built.percent == 90  # type: ignore[union-attr]


def test_hash_of_a_scene_goes_by_what_the_tolerances_say(folder: Path) -> None:
    plain, made = scene(folder, "cooke-triplet-50mm"), scene(folder, built("90%"))
    assert plain.content_hash() != made.content_hash()
    assert scene(folder, built("50%")).content_hash() != made.content_hash()
    before = made.content_hash()
    (folder / "shop.yaml").write_text(SPEC.replace("0.2", "0.3"))
    assert scene(folder, built("90%")).content_hash() != before


@pytest.mark.parametrize(
    ("lens", "camera", "message"),
    [
        (
            built("90"),
            {},
            r"camera.lens.as_built.percentile: is no percentage of copies \(got '90'; allowed: above 0 %",
        ),
        (built("0%"), {}, "is no percentage of copies"),
        (built("101%"), {}, "is no percentage of copies"),
        (
            {"design": "cooke-triplet-50mm", "as_built": 0.9},
            {},
            "camera.lens.as_built: is no percentage .*got 0.9",
        ),
        (
            {"design": "cooke-triplet-50mm", "built": "9%"},
            {},
            r"camera.lens.built: unknown key; did you mean as_built\?",
        ),
        (built("90%", "gone.yaml"), {}, r"camera.lens.as_built.spec: no such file .*a grade is one of commercial"),
        (built("90%", "../shop.yaml"), {}, "camera.lens.as_built.spec: lies outside the scene's folder"),
        (built("90%"), {"kind": "thick_lens"}, "camera.lens.as_built: has elements beside the axis"),
    ],
)
def test_wrong_copies_are_refused(folder: Path, lens: Any, camera: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        scene(folder, lens, **camera)


def test_tolerances_that_do_not_suit_the_lens_are_refused_with_their_place(folder: Path) -> None:
    (folder / "shop.yaml").write_text(SPEC.replace("{index: 0.001}", "{index: 0.001, elements: [7]}"))
    with pytest.raises(InputError, match=r"shop.yaml:5:31: tolerances\[1\].elements\[0\]: the lens has no element 7"):
        camera_model(scene(folder, built("90%")))


@pytest.mark.slow
def test_picture_says_which_copy_took_it(folder: Path) -> None:
    image = render(scene(folder, built("90%"), pupil="bounds"), spp=16)
    assert image.metadata["as_built"]["percentile"] == 90
    assert image.pixels.mean() == pytest.approx(0.5, abs=0.08)  # of 0.1 and 0.9, darker in the corners


def test_hot_lens_has_its_film_where_the_barrel_took_it(folder: Path) -> None:
    cold = lens_setting(scene(folder, "cooke-triplet-50mm"))
    lens = {"design": "cooke-triplet-50mm", "temperature_c": 70, "barrel": 10e-6}
    hot = lens_setting(scene(folder, lens))
    assert hot.film_distance_mm == pytest.approx(cold.film_distance_mm * (1 + 50 * 10e-6), rel=1e-12)
    assert hot.lens == Heat(70.0, barrel_per_k=10e-6).lens(cold.lens)
    assert (hot.metadata["temperature_c"], hot.metadata["pressure_hpa"]) == (70, 1013.25)
    assert lens_setting(scene(folder, lens, {"film_distance_mm": 44.0})).film_distance_mm == 44.0
    both = lens_setting(scene(folder, built("90%") | {"temperature_c": 70, "barrel": 10e-6}))
    made = lens_setting(scene(folder, built("90%")))
    assert both.film_distance_mm == pytest.approx(made.film_distance_mm * (1 + 50 * 10e-6), rel=1e-12)
    thick = scene(folder, "cooke-triplet-50mm", None, "camera.lens.temperature_c=70", kind="thick_lens")
    assert lens_setting(thick).lens.surfaces[0].curvature == Heat(70.0).lens(cold.lens).surfaces[0].curvature


def test_lens_at_20_degrees_changes_no_bit(folder: Path) -> None:
    plain = camera_model(scene(folder, "cooke-triplet-50mm"))
    same = {"design": "cooke-triplet-50mm", "temperature_c": 20, "pressure_hpa": 1013.25, "barrel": "invar"}
    made = camera_model(scene(folder, same))
    assert (made.record.tobytes(), made.surfaces.tobytes()) == (plain.record.tobytes(), plain.surfaces.tobytes())
    assert made.facts == plain.facts


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"temperature_c": 200}, r"camera.lens.temperature_c: is out of range \(got 200; allowed: at most 140"),
        ({"pressure_hpa": -1}, "camera.lens.pressure_hpa: is out of range"),
        ({"barrel": "aluminum"}, r"camera.lens.barrel: is no material of a barrel; did you mean aluminium\?"),
        ({"barrel": 1}, r"camera.lens.barrel: is no linear expansion .*-1e-05 to 0.001 per kelvin"),
    ],
)
def test_impossible_heat_is_refused(folder: Path, keys: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        scene(folder, {"design": "cooke-triplet-50mm"} | keys)


def test_glass_of_which_nothing_is_known_is_refused_with_its_key(folder: Path) -> None:
    hot = scene(folder, {"design": "dgauss-50mm", "temperature_c": 60})
    with pytest.raises(
        InputError, match=r"camera.lens.temperature_c: Double Gauss .*surfaces\[0\]: nothing says how glass"
    ):
        camera_model(hot)


def test_keys_of_a_lens_may_be_set_later(folder: Path) -> None:
    plain = scene(folder, "cooke-triplet-50mm")
    hot = set_keys(plain, {"camera.lens.temperature_c": 60})
    assert hot.camera.heat == Heat(60.0)  # type: ignore[union-attr]
    both = set_keys(hot, {"camera.lens.as_built": {"percentile": "50%", "spec": "shop.yaml"}})
    assert (both.camera.heat, both.camera.as_built.percent) == (Heat(60.0), 50)  # type: ignore[union-attr]
    assert set_keys(both, {"camera.lens": "dgauss-50mm"}).camera.heat is None  # type: ignore[union-attr]
    stopped = change_scene(both, camera={"f_number": 8})
    assert stopped.camera.lens == both.camera.lens  # type: ignore[union-attr]


@pytest.mark.slow
def test_pictures_of_zero_tolerances_and_of_20_degrees_are_those_of_the_design(folder: Path) -> None:
    design = render(scene(folder, "cooke-triplet-50mm"), spp=16)
    for lens in (built("90%", "zero.yaml"), {"design": "cooke-triplet-50mm", "temperature_c": 20, "barrel": "invar"}):
        assert np.array_equal(render(scene(folder, lens), spp=16).pixels, design.pixels)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cooke-triplet-50mm", "dgauss-50mm", "retrofocus-28mm", "phone-5.6mm"])
def test_most_rays_pass_through_poor_copies(folder: Path, name: str) -> None:
    outcomes = render(
        scene(folder, built("90%", "precision", name), film_mm=(4.0 if "phone" in name else 30.0)), spp=64
    )
    lens = outcomes.stats["lens"]
    assert lens["passed"] >= 0.9 * sum(lens.values())
