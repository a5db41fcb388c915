"""The commands that draw and measure a lens: tables, JSON, pictures and errors."""

import argparse
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.cli import camera, lens_measures
from rptcam_cl.cli.lens_options import coating
from rptcam_cl.optics.files.glasses import WORDS
from rptcam_cl.optics.glass import Layer, LayerStack, QuarterWave, constant_reflectance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.scene.lens_settings import COATINGS
from tests.support.cases import slow

Command = Callable[..., Any]

QUICK = ["--fields", "0,5", "--wavelengths", "550", "--rays", "24"]


def test_drawing_goes_to_standard_output(rptcam: Command) -> None:
    run = rptcam("lens", "draw", "ball", "--device", "none", "--rays", "3")
    assert run.code == 0
    assert run.out.startswith("<svg")
    assert "float64 on the host" in run.err


def test_drawing_is_traced_by_a_device_unless_told_otherwise(rptcam: Command, tmp_path: Path) -> None:
    run = rptcam("lens", "draw", "ball", "--rays", "3", "-o", str(tmp_path / "ball.svg"))
    assert run.code == 0
    assert run.out == ""
    assert "single precision" in run.err
    assert (tmp_path / "ball.svg").read_text().startswith("<svg")


def test_drawing_without_a_device_falls_back_and_says_so(rptcam: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    from rptcam_cl.core.errors import DeviceError

    def fail(spec: str | None) -> None:
        raise DeviceError("no OpenCL platform was found")

    monkeypatch.setattr("rptcam_cl.device.session.open_session", fail)
    run = rptcam("lens", "draw", "ball")
    assert run.code == 0
    assert "no OpenCL device" in run.err
    assert rptcam("lens", "draw", "ball", "--device", "gpu").code == 3


def test_measure_prints_a_table_and_json_and_writes_a_plot(rptcam: Command, tmp_path: Path) -> None:
    plot = tmp_path / "plot.svg"
    run = rptcam("lens", "spot", "tessar-100mm", *QUICK, "-o", str(plot))
    assert run.code == 0, run.err
    assert run.out.startswith("Tessar 100 mm")
    assert len(run.out.splitlines()) > 3
    assert plot.read_text("utf-8").startswith("<svg")
    document = json.loads(rptcam("lens", "spot", "tessar-100mm", *QUICK, "--json").out)
    assert document["film_distance_mm"] > 0
    assert all(row.keys() >= {"rms_um", "centroid_y_mm"} for row in document["spots"])


@pytest.mark.slow
def test_plots_are_written_as_png_too(rptcam: Command, tmp_path: Path) -> None:
    from PIL import Image

    plot = tmp_path / "plot.png"
    assert rptcam("lens", "distortion", "tessar-100mm", "--fields", "0,5,10", "-o", str(plot)).code == 0
    with Image.open(plot) as image:
        assert image.size == (1200, 750)
        assert len(image.getcolors(1 << 20) or []) > 10
    assert rptcam("lens", "draw", "ball", "--device", "none", "-o", str(tmp_path / "ball.pdf")).code == 0
    assert (tmp_path / "ball.pdf").read_bytes().startswith(b"%PDF")


def test_plots_need_their_extra_and_drawings_as_svg_do_not(
    rptcam: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for words in (["spot", "ball", "-o", "a.svg"], ["draw", "ball", "-o", "a.png"], ["psf", "ball", "-o", "a.png"]):
        run = rptcam("lens", *words)
        assert run.code == 2
        assert run.err == 'error: plots need the package matplotlib (pip install "rptcam_cl[plot]")\n'
    assert rptcam("lens", "draw", "ball", "--device", "none", "-o", str(tmp_path / "a.svg")).code == 0
    assert rptcam("lens", "psf", "tessar-100mm", "--rays", "24", "-o", str(tmp_path / "a.npy")).code == 0


def test_point_image_is_written_as_numbers_and_as_picture(rptcam: Command, tmp_path: Path) -> None:
    words = ("lens", "psf", "tessar-100mm", "--field", "5", "--pixels", "32", "--rays", "24")
    assert rptcam(*words, "-o", str(tmp_path / "psf.npy")).code == 0
    shares = np.load(tmp_path / "psf.npy")
    assert shares.shape == (32, 32)
    assert 0.9 < shares.sum() <= 1.000001
    assert rptcam(*words, "-o", str(tmp_path / "psf.png")).code == 0
    assert json.loads(rptcam(*words, "--json").out)["psf"]["rms_um"] > 0


def test_wave_optics_of_a_lens_as_numbers_and_as_pictures(rptcam: Command, tmp_path: Path) -> None:
    lens = ("tessar-100mm", "--f-number", "16", "--rays", "64")
    answer = json.loads(rptcam("lens", "mtf", *lens, "--diffraction", "--fields", "0", "--frequencies", "40",
                               "-o", str(tmp_path / "mtf.svg"), "--json").out)  # fmt: skip
    (row,) = answer["mtf"]
    assert 0.3 < row["tangential"] <= row["tangential_limit"] < 0.6  # f/16 leaves 55 % of 40 cycles/mm at best
    answer = json.loads(rptcam("lens", "psf", *lens, "--diffraction", "--pixels", "32", "-o",
                               str(tmp_path / "psf.npy"), "--json").out)  # fmt: skip
    assert answer["psf"]["airy_radius_um"] == pytest.approx(1.22 * 0.5876 * 16, rel=0.02)
    assert 0.8 < np.load(tmp_path / "psf.npy").sum() < 1.0
    (row,) = json.loads(rptcam("lens", "wavefront", *lens, "--fields", "0", "-o", str(tmp_path / "w.png"),
                               "--json").out)["wavefronts"]  # fmt: skip
    assert 0.8 < row["strehl"] <= row["strehl_at_peak"] <= 1.0
    assert (tmp_path / "mtf.svg").exists() and (tmp_path / "w.png").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["draw", "dgaus-50mm"], "did you mean"),
        (["draw", "ball", "-o", "ball.jpg"], "allowed: .svg, .png, .pdf"),
        (["draw", "ball", "--fields", "0,95"], "allowed angles"),
        (["draw", "ball", "--fields", "wide"], "allowed numbers"),
        (["draw", "ball", "--rays", "0"], "allowed 1 to 2000"),
        (["draw", "ball", "--section", "z"], "invalid choice"),
        (["draw", "dgauss-50mm", "--f-number", "1"], "opens to f/2.03"),
        (["draw", "ball", "--focal-length-mm", "60"], "not a zoom lens"),
        (["draw", "ball", "--zoom", "tele"], "no configuration 'tele'; it has none"),
        (["draw", "ball", "--zoom", "tele", "--focal-length-mm", "60"], "not allowed with"),
        (["draw", "tessar-102mm", "--wavelengths", "100"], "allowed wavelengths from 200 to 3000 nm"),
        (["spot", "biconcave"], "no real image"),
        slow(["spot", "dgauss-50mm", "--fields", "80"], "nothing of a beam"),
        (["spot", "dgauss-50mm", "--wavelengths=-5"], "allowed wavelengths from 200 to 3000 nm"),
        (["mtf", "dgauss-50mm", "--frequencies", "0"], "above 0"),
        (["psf", "dgauss-50mm", "-o", "psf.jpg"], "allowed: .svg, .png, .pdf, .npy"),
        (["psf", "dgauss-50mm", "--field", "nan"], "allowed a finite number"),
        (["psf", "dgauss-50mm", "--field", "140"], "allowed from -130 to 130"),
        (["psf", "biconcave", "--diffraction"], "no real image"),
        (["psf", "dgauss-50mm", "--diffraction", "--field", "100"], "up to 85 degrees"),
        (["mtf", "dgauss-50mm", "--diffraction", "--rays", "8"], "at least 16 rays"),
        (["wavefront", "dgauss-50mm", "--fields", "60"], "nothing of a beam"),
        (["vignette", "biconcave"], "no real image"),
        (["distortion", "biconcave"], "no real image"),
        (["breathing", "dgauss-50mm", "--distances-m", "0"], "allowed distances above 0"),
        (["breathing", "dgauss-50mm", "--focus-distance-m", "2"], "has no effect on breathing"),
        (["breathing", "anamorphic-100mm"], "not the same from every side"),
        (["psf", "dgauss-50mm", "--best-focus-field", "90"], "--best-focus-field: got 90; allowed between -89 and 89"),
        (["draw", "dgauss-50mm", "-o", "lens.jpg"], "lens.jpg: unknown kind of picture"),
        (["ghosts", "ball", "--coating", "1.38:99.6,2.1"], "allowed 1 to 12 layers"),
        (["ghosts", "ball", "--coating", "0.5:99"], "with an index from 1 to 5"),
        (["ghosts", "ball", "--coating", "0.5:nan:1"], "allowed 1 to 12 layers"),
        (["transmittance", "ball", "--coating", "shiny"], "allowed bare, mgf2, multi, a reflectance"),
        (["transmittance", "planar-1897", "--wavelengths", "1200"], "is known from 300 to 1060 nm"),
        (["info", "ball", "--transmission", "coated"], "does not say how it is coated"),
        (["info", "ball", "--transmission", "bare", "--coating", "mgf2"], "has no effect with --transmission bare"),
        slow(["distortion", "dgauss-50mm", "--fields", "80"], "reaches the centre of the stop"),
    ],
)
def test_what_cannot_be_shown_is_said(rptcam: Command, words: list[str], message: str) -> None:
    run = rptcam("lens", *words)
    assert run.code == 2
    assert run.out == ""
    assert message in run.err


def test_unwritable_plot_is_refused_before_anything_is_traced(rptcam: Command, tmp_path: Path) -> None:
    run = rptcam("lens", "draw", "ball", "-o", str(tmp_path / "missing" / "ball.svg"))
    assert run.code == 4
    assert "there is no folder" in run.err
    own = tmp_path / "own.yaml"
    own.write_text("name: own\n")
    assert rptcam("lens", "draw", str(own), "-o", str(own)).code == 2


def test_ghosts_are_listed_with_the_worst_and_drawn(rptcam: Command, tmp_path: Path) -> None:
    out = tmp_path / "ghost.svg"
    run = rptcam("lens", "ghosts", "achromat-100mm", "--source", "2", "--film-mm", "8,6", "--json", "-o", str(out))
    assert run.code == 0, run.err
    (part,) = json.loads(run.out)["ghosts"]
    assert sorted(map(tuple, (way["surfaces"] for way in part["ways"]))) == [(1, 0), (2, 0), (2, 1)]
    assert part["worst"] == part["ways"][0]["surfaces"]
    assert part["ghosts_in_frame"] == pytest.approx(sum(way["share_in_frame"] for way in part["ways"]))
    assert sum(part["account"].values()) == pytest.approx(1.0, abs=1e-4)
    assert "on to the film" in out.read_text()


@pytest.mark.parametrize(
    ("lens", "words", "fault"),
    [
        ("dgauss-50mm", ("--order", "3"), "after an even number"),
        ("dgauss-50mm", ("--coating", "mgf3"), "allowed bare, mgf2"),
        ("biconcave", (), "no real image"),
        ("dgauss-50mm", ("--source", "120"), "does not come from the scene"),
        ("dgauss-50mm", ("--film-reflectance", "1"), "from 0 to below 1"),
    ],
)
def test_ghosts_refuse_what_they_cannot_know(rptcam: Command, lens: str, words: tuple[str, ...], fault: str) -> None:
    run = rptcam("lens", "ghosts", lens, *words)
    assert run.code != 0
    assert fault in run.err


def test_the_option_takes_the_coatings_that_scenes_take():
    clear = LayerStack((Layer(1.38, 99.6), Layer(2.1, 131.0), Layer(1.7, 80.9)))
    assert coating("multi") == coating("1.38:99.6,2.1:131,1.7:80.9") == clear
    assert coating("1.46:70,0.9:3:2.6") == LayerStack((Layer(1.46, 70.0), Layer(0.9, 3.0, 2.6)))
    assert coating("1.38:100") == QuarterWave(1.38, 4 * 1.38 * 100)
    assert set(WORDS) == set(COATINGS)
    # an index from 1 to 5, from above 0 where light is absorbed; an extinction to 20; a thickness above 0
    assert coating("1:1,5:2") == LayerStack((Layer(1.0, 1.0), Layer(5.0, 2.0)))
    assert coating("0.01:3:20,1.5:4:0") == LayerStack((Layer(0.01, 3.0, 20.0), Layer(1.5, 4.0)))
    most = ",".join(12 * ["1.4:100"])
    assert coating(most) == LayerStack(12 * (Layer(1.4, 100.0),))
    wrong = "0.99:1,2:1 5.1:1,2:1 0:1:1,2:1 1.4:0,2:1 1.4:inf,2:1 1.4:1:20.1 1.4:1:-1 1.4:1:1:1 0.99:1:0,2:1 a:b"
    for text in (*wrong.split(), f"{most},1.4:100"):
        with pytest.raises(argparse.ArgumentTypeError, match=r"allowed 1 to 12 layers"):
            coating(text)


def test_reflectance_of_a_coating_is_from_0_to_below_1():
    for text in ("0", "0.005", "0.999"):
        assert coating(text) == constant_reflectance(float(text))
    for text in ("1", "-0.001", "nan", "x", ""):
        with pytest.raises(argparse.ArgumentTypeError, match=r"a reflectance from 0 to below 1"):
            coating(text)


@pytest.mark.parametrize(
    ("read", "values", "refused"),
    [
        (lens_measures.frame, {"36,24": (36, 24), "0.1,2": (0.1, 2)}, ["36", "36,0", "-36,24", "1,2,3"]),
        (lens_measures.order, {"2": 2, "4": 4}, ["0", "1", "3", "6", "2.0", "x"]),
        (lens_measures.share, {"0": 0, "0.999": 0.999}, ["1", "-0.1"]),
        (camera.film, {"36x24": (36, 24), "0.5×2e3": (0.5, 2000), "36X24": (36, 24)},
         ["36", "36x0", "0x24", "-36x24", "1e6x1", "1x1e6", "1x2x3", "nanx1", "axb"]),
        (lens_measures._copies, {"10": 10, str(lens_measures.MOST_COPIES): lens_measures.MOST_COPIES},
         ["9", str(lens_measures.MOST_COPIES + 1), "1e2"]),
        (lens_measures._seed, {"0": 0, str(2**63 - 1): 2**63 - 1}, ["-1", str(2**63)]),
    ],
    ids=["frame", "order", "share", "film", "copies", "seed"],
)  # fmt: skip
def test_words_of_lens_commands_lie_in_their_ranges(read, values, refused):
    for word, value in values.items():
        assert read(word) == value
    for word in refused:
        with pytest.raises(argparse.ArgumentTypeError, match=f"^got {re.escape(word)}"):
            read(word)


@pytest.mark.slow
def test_ghosts_are_printed_from_the_brightest_with_their_sums(rptcam: Command) -> None:
    words = ("lens", "ghosts", "dgauss-50mm", "--source", "5", "--coating", "bare")
    (part,) = json.loads(rptcam(*words, "--json").out)["ghosts"]
    run = rptcam(*words)
    assert run.code == 0, run.err
    lines = run.out.splitlines()
    shares = [row["share_in_frame"] for row in part["ways"]]
    assert shares == sorted(shares, reverse=True) and len(shares) > lens_measures.SHOWN
    rows = lines[2 : 2 + lens_measures.SHOWN]
    assert lines[0].endswith("source at 5°, 550 nm; shares of the image's light")
    assert len(rows) == lens_measures.SHOWN and not any(row.startswith("and ") for row in rows)
    assert lines[2 + lens_measures.SHOWN] == f"and {len(shares) - lens_measures.SHOWN} fainter ones (--all shows them)"
    sums = f"all ghosts: {part['ghosts_in_frame']:.4g} in the frame, {part['ghosts']:.4g} on its plane"
    assert f"{sums}, ± {part['ghosts_error']:.2g}" in lines
    assert len(rptcam(*words, "--all").out.splitlines()) == len(lines) - 1 + len(shares) - lens_measures.SHOWN
    *goes, error = lines[-1].removeprefix("of the light that enters: ").split(", ")
    assert error == f"± {part['account_error']:.2g}"
    assert sum(float(each.rsplit(" ", 1)[1]) for each in goes) == pytest.approx(1, abs=2e-3)


def test_lens_without_a_real_image_is_drawn_without_a_film(rptcam: Command) -> None:
    run = rptcam("lens", "draw", "biconcave", "--device", "none")
    assert run.code == 0 and run.out.startswith("<svg")
    assert "this lens forms no real image of a distant object: no film is drawn" in run.err
    run = rptcam("lens", "draw", "dgauss-50mm", "--device", "none")
    assert run.code == 0 and "no real image" not in run.err


def test_breathing_of_a_zoom_has_a_row_for_each_position_and_distance(rptcam: Command) -> None:
    words = ("lens", "breathing", "zoom-70-200mm", "--distances-m", "5,20", "--json")
    rows = json.loads(rptcam(*words).out)["breathing"]
    positions = list(dict.fromkeys(row["zoom"] for row in rows))
    assert positions == [each.name for each in load_lens("zoom-70-200mm").configurations]
    (zoom,) = {row["zoom"] for row in json.loads(rptcam(*words, "--zoom", positions[0]).out)["breathing"]}
    assert zoom == positions[0]


def test_specification_of_tolerances_is_not_overwritten(rptcam: Command, tmp_path: Path) -> None:
    spec = tmp_path / "spec.svg"
    spec.write_text("radius: {percent: 0.1}\n")
    run = rptcam("lens", "tolerance", "dgauss-50mm", str(spec), "-o", str(spec))
    assert run.code == 2 and "would overwrite the specification" in run.err
    assert spec.read_text() == "radius: {percent: 0.1}\n"


def test_spot_of_all_wavelengths_together_is_called_all(rptcam: Command) -> None:
    words = ("lens", "spot", "dgauss-50mm", "--fields", "0,10", "--wavelengths", "486,656", "--rays", "16")
    rows = json.loads(rptcam(*words, "--json").out)["spots"]
    lines = rptcam(*words).out.splitlines()[2:]
    assert len(lines) == len(rows) and {row["wavelength_nm"] for row in rows} == {486, 656, None}
    for row, line in zip(rows, lines, strict=True):
        cells = line.split()
        assert ("all" in cells) == (row["wavelength_nm"] is None)
        assert row["wavelength_nm"] is None or f"{row['wavelength_nm']:g}" in cells
