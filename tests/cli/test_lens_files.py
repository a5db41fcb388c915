"""The commands that trace rays, convert lens files and design lenses."""

import argparse
import json
import re
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.cli import lens_options
from rptcam_cl.optics.library import load_lens

Command = Callable[..., Any]

RAY = {"origin": [0, 3, 70], "direction": [0, 0.05, -1]}


def rays_of(run: Any) -> list[dict[str, Any]]:
    assert run.code == 0, run.err
    rows: list[dict[str, Any]] = json.loads(run.out)["rays"]
    return rows


def test_rays_of_a_file_are_those_of_the_reference(rptcam: Command, tmp_path: Path) -> None:
    rays, table = tmp_path / "rays.json", tmp_path / "rays.csv"
    rays.write_text(json.dumps([RAY, RAY | {"wavelength_nm": 486.1}]))
    table.write_text("x,y,z,dx,dy,dz,wavelength_nm\n0,3,70,0,0.05,-1,587.5618\n# note\n0,3,70,0,0.05,-1,486.1\n")
    exact = load_lens("tessar-100mm").trace([[0, 3, 70]] * 2, [[0, 0.05, -1]] * 2, [587.5618, 486.1])
    rows = rays_of(rptcam("lens", "trace", "tessar-100mm", str(rays), "--json"))
    assert rows == rays_of(rptcam("lens", "trace", "tessar-100mm", str(table), "--json"))
    rays.write_text(json.dumps({"rays": [RAY, RAY | {"wavelength_nm": 486.1}]}))
    assert rows == rays_of(rptcam("lens", "trace", "tessar-100mm", str(rays), "--json"))
    table.write_text("0, 3, 70, 0, 0.05, -1\n\n0,3,70,0,0.05,-1\n", "utf-8-sig")
    words = ("lens", "trace", "tessar-100mm", str(table), "--json", "--wavelength-nm", "486.1")
    assert [rows[1]] * 2 == rays_of(rptcam(*words))
    table.write_bytes(b"\xff\xfe")
    assert "is not text; rays are JSON or CSV" in rptcam(*words).err
    for row, origin, direction in zip(rows, exact.origins, exact.directions, strict=True):
        assert (row["status"], row["surface"]) == ("ok", None)
        assert row["origin"] == origin.tolist()
        assert row["direction"] == direction.tolist()


def test_rays_of_standard_input_say_where_they_fail(rptcam: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", StringIO("0,0,70,0,0,-1\n0,40,70,0,0,-1\n0,12,70,0,-0.1,-1\n"))
    run = rptcam("lens", "trace", "dgauss-50mm", "-")
    assert run.code == 0
    lines = run.out.splitlines()
    assert len(lines) == 5
    assert "missed" in lines[3] or "clipped" in lines[3]
    assert "3 rays traced in float64" in run.err


@pytest.mark.parametrize(("precision", "tolerance"), [("single", 2e-5), ("double", 1e-9)])
def test_film_point_is_traced_on_a_device(rptcam: Command, precision: str, tolerance: float) -> None:
    words = ("lens", "trace", "dgauss-50mm", "--film-point", "5", "-3", "--through", "1", "-0.1", "--json")
    (exact,) = rays_of(rptcam(*words))
    lens = load_lens("dgauss-50mm")
    film = 36.10590523854216  # behind the last vertex, as two other programs say
    ray = lens.trace([[5, -3, 32.04 + film]], [[1 - 5, -0.1 + 3, -film]])
    np.testing.assert_allclose(exact["origin"], ray.origins[0], atol=1e-9)
    np.testing.assert_allclose(exact["direction"], ray.directions[0], atol=1e-9)
    (traced,) = rays_of(rptcam(*words, "--device", "auto", "--precision", precision))
    np.testing.assert_allclose(traced["origin"], exact["origin"], atol=tolerance)
    np.testing.assert_allclose(traced["direction"], exact["direction"], atol=tolerance)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "holds no rays"),
        ("x,y,z,dx,dy,dz\n", "holds no rays"),
        ("1,2,3\n", "got 3 cells"),
        ("1,2,3,4,5,six\n", "expected numbers"),
        ("0,0,1,0,0,0\n", "direction is 0, 0, 0"),
        ("0,0,inf,0,0,1\n", "finite"),
        ("x,z,y,dx,dy,dz\n0,0,0,0,0,1\n", "expected the columns"),
        ("[1, 2", "is not JSON"),
        ('{"points": []}', "expected a list of rays"),
        ('[{"origin": [0, 0, 1]}]', "ray 0: expected"),
        ('[{"origin": [0, 0], "direction": [0, 0, 1]}]', "three numbers each"),
        ('[{"origin": [0, 0, 9], "direction": [0, 0, 1], "wavelength_nm": -1}]', "above 0"),
        ('[{"origin": [0, 0, 9], "direction": [0, 0, 1], "lambda": 1}]', "unknown key 'lambda'"),
        ('[{"origin": [0, 0, 9], "direction": [0, 0, 1]}, {"direction": [0, 0, 1]}]', "ray 1: expected"),
        ("[5]", "ray 0: expected"),
        ('{"rays": 5}', "expected a list of rays"),
        ('{"rays": []}', "holds no rays"),
        ('[{"origin": [0, 0, 1], "direction": [0, 0, 1, 0]}]', "three numbers each"),
        ('[{"origin": [0, 0, true], "direction": [0, 0, 1]}]', "three numbers each"),
        ('[{"origin": [0, 0, 1], "direction": [0, 0, "1"]}]', "three numbers each"),
        ('[{"origin": [0, 0, 1e301], "direction": [0, 0, 1]}]', "three numbers each"),
        ('[{"origin": "009", "direction": [0, 0, 1]}]', "three numbers each"),
        ('[{"origin": [0, 0, 9], "direction": [0, 0, 1], "wavelength_nm": true}]', "wavelength_nm must be a number"),
        ('[{"origin": [0, 0, 9], "direction": [0, 0, 1], "wavelength_nm": "500"}]', "wavelength_nm must be a number"),
        ("0,0,9,0,0,1,0\n", "1: wavelength_nm must be above 0 (got 0)"),
        ("x,y,z,dx,dy,dz,wavelength_nm\n\n0,0,9,0,0,1,inf\n", "3: wavelength_nm must be above 0 (got inf)"),
        ("0,0,9,0,0,1,500,1\n", "got 8 cells"),
        ("x,y,z,dx,dy,dz,nm\n0,0,0,0,0,1,500\n", "expected the columns"),
    ],
)
def test_bad_rays_are_refused_with_their_place(rptcam: Command, tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "rays"
    path.write_text(content)
    run = rptcam("lens", "trace", "ball", str(path))
    assert run.code == 2
    assert str(path) in run.err
    assert message in run.err


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["trace", "ball"], 2, "either a file of rays or --film-point"),
        (["trace", "ball", "no-such-file.csv"], 4, "no-such-file.csv"),
        (["trace", "ball", "--film-point", "0", "x"], 2, "allowed a finite number"),
        (["trace", "ball", "--film-point", "0", "0", "--start", "scene"], 2, "starts from the film"),
        (["trace", "ball", "--film-point", "0", "0", "--precision", "double"], 2, "belongs to a device"),
        (["trace", "biconcave", "--film-point", "0", "0"], 2, "no real image"),
        (["convert", "ball", "-o", "ball.obj"], 2, "allowed: .yaml, .yml, .dat"),
        (["convert", "phone-5.6mm", "-o", "phone.dat"], 2, "aspheric"),
        (["convert", "zoom-70-200mm", "-o", "zoom.dat"], 2, "choose a focal length"),
        (["design", "singlet", "--focal-length-mm", "50"], 2, "--diameter-mm"),
        (["design", "singlet", "--focal-length-mm", "0", "--diameter-mm", "5"], 2, "not 0"),
        (["design", "singlet", "--focal-length-mm", "5", "--diameter-mm", "50"], 2, "too short for a diameter"),
        (["design", "singlet", "--focal-length-mm", "50", "--diameter-mm", "5", "--focus-distance-m", "0.1"],
         2, "four focal lengths"),
        (["design", "doublet", "--focal-length-mm", "50", "--diameter-mm", "5", "--flint", "SF55"], 2, "did you mean"),
        (["design", "doublet", "--focal-length-mm", "50", "--diameter-mm", "5", "--crown", "1.5"], 2, "disperse"),
        (["design", "doublet", "--focal-length-mm", "50", "--diameter-mm", "5", "--flint", "N-BK7"], 2, "differ"),
    ],
)  # fmt: skip
def test_mistakes_are_said(
    rptcam: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], code: int, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    run = rptcam("lens", *words)
    assert run.code == code
    assert run.out == ""
    assert message in run.err
    assert list(tmp_path.iterdir()) == []


def test_conversion_there_and_back(rptcam: Command, tmp_path: Path) -> None:
    table, own = tmp_path / "a.dat", tmp_path / "b.yaml"
    assert rptcam("lens", "convert", "dgauss-50mm", "-o", str(table)).code == 0
    assert rptcam("lens", "convert", str(table), "-o", str(own)).code == 0
    first, second = load_lens("dgauss-50mm").first_order(), load_lens(own).first_order()
    assert second == first


def test_zoom_lens_is_written_as_it_is_set(rptcam: Command, tmp_path: Path) -> None:
    path = tmp_path / "zoom.yaml"
    words = ("--focal-length-mm", "100", "--f-number", "4")
    assert rptcam("lens", "convert", "zoom-70-200mm", *words, "-o", str(path)).code == 0
    first = load_lens(path).first_order()
    assert first.focal_length_mm == pytest.approx(100, rel=1e-9)
    assert first.f_number == pytest.approx(4, rel=1e-9)


def test_dispersion_that_is_lost_is_said(rptcam: Command, tmp_path: Path) -> None:
    run = rptcam("lens", "convert", "takumar-50mm", "-o", str(tmp_path / "a.dat"))
    assert run.code == 0, run.err
    assert "no dispersion" in run.err
    assert "focusing" not in run.err


def test_focusing_group_and_coatings_that_are_lost_are_said(rptcam: Command, tmp_path: Path) -> None:
    lens = tmp_path / "own.yaml"
    lens.write_text(
        "name: own\nsurfaces:\n"
        "- {radius: 40, thickness: 4, glass: {index: 1.6}, diameter: 20, coating: mgf2}\n"
        "- {radius: -60, thickness: 5, diameter: 20}\n- {stop: true, thickness: 5, diameter: 8}\n"
        "- {radius: 90, thickness: 3, glass: {index: 1.5}, diameter: 18}\n- {radius: -80, diameter: 18}\n"
        "focusing: {surfaces: [3, 4], travel: [-1, 1]}\n"
    )
    run = rptcam("lens", "convert", str(lens), "-o", str(tmp_path / "a.dat"))
    assert run.code == 0, run.err
    for words in ("no focusing group: the lens is written focused at infinity", "no coatings: they are left out"):
        assert f"a .dat table has {words}\n" in run.err
    assert "no dispersion" not in run.err


READERS: list[tuple[Callable[[str], Any], dict[str, list[float]], list[str]]] = [
    (lens_options.numbers, {"0,-10,2.5e3": [0, -10, 2500]}, ["", "1,,2", "a", "nan", "inf", "1e12", "-1e12"]),
    (lens_options.angles, {"-88.9,0,88.9": [-88.9, 0, 88.9]}, ["89", "-89", "nan"]),
    (lens_options.wavelengths, {"200,587.56,3000": [200, 587.56, 3000]}, ["199.9", "3000.1", "587,nan", "-500"]),
    (lens_options.count, {"1": 1, "2000": 2000}, ["0", "2001", "1.0", "-1", "\u0663"]),  # type: ignore[dict-item]
    (lens_options.wavelength, {"200": 200, "3000": 3000}, ["199", "3001", "500,600"]),  # type: ignore[dict-item]
]


@pytest.mark.parametrize(("read", "values", "refused"), READERS, ids=range(len(READERS)))
def test_numbers_of_the_command_line_lie_in_their_ranges(
    read: Callable[[str], Any], values: dict[str, Any], refused: list[str]
) -> None:
    for word, value in values.items():
        assert read(word) == value
    for word in refused:
        with pytest.raises(argparse.ArgumentTypeError, match=f"^got {re.escape(word)}; allowed "):
            read(word)


def test_designed_singlet_has_its_focal_length(rptcam: Command, tmp_path: Path) -> None:
    path = tmp_path / "lens.yaml"
    words = ("--focal-length-mm", "-80", "--diameter-mm", "20", "--bending", "0.5", "--glass", "1.7/30")
    assert rptcam("lens", "design", "singlet", *words, "-o", str(path)).code == 0
    assert load_lens(path).first_order().focal_length_mm == pytest.approx(-80, rel=1e-9)


def test_placement_of_a_singlet_is_the_closed_form(rptcam: Command) -> None:
    words = ("--focal-length-mm", "50", "--diameter-mm", "5", "--focus-distance-m", "1")
    run = rptcam("lens", "design", "singlet", *words)
    # x (1000 - x) = 50 * 1000
    near = (1000 - np.sqrt(1000**2 - 4 * 50 * 1000)) / 2
    assert f"{near:.6g} mm" in run.out.splitlines()[0]


@pytest.mark.parametrize("third", [["--constraint", "r2=r3"], ["--constraint", "flat-r3"], ["--r1-mm", "60"], []])
def test_designed_doublet_brings_f_and_c_together(rptcam: Command, tmp_path: Path, third: list[str]) -> None:
    path = tmp_path / "lens.yaml"
    words = ("--focal-length-mm", "100", "--diameter-mm", "5", *third)
    assert rptcam("lens", "design", "doublet", *words, "-o", str(path)).code == 0
    lens = load_lens(path)
    lengths = [lens.first_order(wave).focal_length_mm for wave in (486.1327, 587.5618, 656.2725)]
    assert lengths[1] == pytest.approx(100, rel=0.01)  # thin-lens radii, real thickness
    # the ray of d differs by the secondary spectrum, about f / 2500; an uncorrected lens has f / V = f / 64
    assert max(lengths) - min(lengths) < 0.12


def test_list_of_lenses_as_text_as_json_and_as_a_table(rptcam: Command) -> None:
    text, rows, table = (rptcam("lens", "list", *words).out for words in ([], ["--json"], ["--markdown"]))
    row = next(row for row in json.loads(rows) if row["name"] == "dgauss-50mm")
    source = row.pop("source")
    assert row | {"focal_length_mm": 0, "f_number": 0} == {
        "name": "dgauss-50mm", "lens": "Double Gauss 50 mm f/2", "focal_length_mm": 0, "f_number": 0, "surfaces": 11,
    }  # fmt: skip
    assert (row["focal_length_mm"], row["f_number"]) == (pytest.approx(50, abs=0.5), pytest.approx(2, abs=0.05))
    f, n = f"{row['focal_length_mm']:.4g}", f"{row['f_number']:.3g}"
    assert f"\n| `dgauss-50mm` | Double Gauss 50 mm f/2 | {f} | {n} | 11 | {source} |\n" in table
    lines = text.splitlines()
    assert len(lines) == len(json.loads(rows)) == len(table.splitlines()) - 2
    assert [line.split()[-5:] for line in lines if line.startswith("dgauss-50mm ")] == [
        ["Double", "Gauss", "50", "mm", "f/2"]
    ]


@pytest.mark.parametrize("suffix", ["zmx", "seq"])
def test_lens_for_another_program_keeps_its_first_order_and_what_is_lost_is_said(
    rptcam: Command, tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"lens.{suffix}"
    run = rptcam("lens", "convert", "telephoto-250mm", "-o", str(path))
    assert run.code == 0, run.err
    first, second = load_lens("telephoto-250mm").first_order(), load_lens(path).first_order()
    assert second.focal_length_mm == pytest.approx(first.focal_length_mm, rel=1e-5)
    assert second.f_number == pytest.approx(first.f_number, rel=1e-3)
    assert all(line.startswith((f"a .{suffix} file: ", "wrote ")) for line in run.err.splitlines())
