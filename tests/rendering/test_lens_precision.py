"""Pictures through a lens traced in float64: those of float32 sample by sample, whatever else the render is."""

import json

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.cli import main
from rptcam_cl.rendering import tracer
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from tests.rendering.test_determinism import LENS
from tests.rendering.test_world import still_life
from tests.support.cases import slow

SIZE, SPP = (48, 32), 16
MOVING = {
    "camera": LENS | {"motion": [{"time_s": 0, "eye": [0.5, -5, 2]}, {"time_s": 1, "eye": [0.6, -5, 2]}]},
    "shutter": {"time_s": 1},
}
SCENES = {
    "everything": still_life()
    | {
        "camera": LENS
        | {"aperture": {"shape": "heart"}, "transmission": {"coating": "mgf2"}, "lens": "double-gauss-50mm-f1.4"},
        "film": {"filter": {"kind": "mitchell"}},
        "spectrum": {"mode": "spectral", "lens": "on"},
    },
    "moving": still_life() | MOVING,
}


def both(scene, **options):
    """A picture in single and in double."""
    return [
        rptcam_cl.render(change_scene(scene, camera={"precision": precision}), size=SIZE, spp=SPP, seed=5, **options)
        for precision in ("single", "double")
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "organisation"),
    [("moving", "passes"), slow("everything", "stream"), slow("everything", "passes"), slow("moving", "stream")],
)
def test_picture_is_that_of_float32_but_for_paths_that_rounding_sends_elsewhere(name, organisation, monkeypatch):
    monkeypatch.setattr(tracer, "ORGANISATION", {"cpu": organisation, "gpu": organisation})
    single, double = both(load_scene(SCENES[name]))
    one, other = (np.asarray(image).astype(np.float64) for image in (single, double))
    assert (one != other).any()
    assert np.isclose(one, other, rtol=1e-4, atol=1e-6).mean() > 0.98
    assert other.mean() == pytest.approx(one.mean(), rel=1e-3)
    assert single.stats["lens"] == double.stats["lens"]
    assert [image.metadata["lens_precision"] for image in (single, double)] == ["single", "double"]


@pytest.mark.slow
def test_wave_size_does_not_change_a_bit():
    scene = change_scene(load_scene(SCENES["moving"]), camera={"precision": "double"})
    one, other = (np.asarray(rptcam_cl.render(scene, size=SIZE, spp=3, wave_size=size)) for size in (1024, None))
    np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_margin_of_the_lens_is_that_of_float64():
    single, double = both(load_scene(SCENES["moving"]), numerics=True)
    assert "float32_lens" not in double.stats["numerics"]
    coarse, fine = single.stats["numerics"]["float32_lens"], double.stats["numerics"]["float64_lens"]
    assert fine["position_mm"] < 1e-12 < coarse["position_mm"]
    assert double.metadata["numerics"]["float64_lens_px"] == fine["pixels"] < 1e-9


def test_state_of_a_render_is_of_one_precision(tmp_path, capsys):
    scene, out, state = (str(tmp_path / name) for name in ("scene.yaml", "out.npy", "out.rpck"))
    (tmp_path / "scene.yaml").write_text(json.dumps(still_life() | {"camera": LENS}))
    command = ["render", scene, "-o", out, "--size", "16x16", "--spp", "4", "--resume", "--quiet"]
    assert main(command) == 0
    assert (tmp_path / state).exists()
    assert main([*command, "--set", "camera.precision=double"]) == 4
    assert "another" in capsys.readouterr().err


@pytest.mark.slow
def test_autofocus_by_phase_finds_the_same_plane_in_double():
    scene = load_scene(still_life() | {"camera": LENS | {"focus": {"auto": {"method": "phase"}}}})
    found = [
        rptcam_cl.autofocus(change_scene(scene, camera={"precision": precision}, film={"resolution": [96, 64]}))
        for precision in ("single", "double")
    ]
    assert found[1].focus_distance_m == pytest.approx(found[0].focus_distance_m, rel=1e-3)
