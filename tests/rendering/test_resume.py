"""Interrupted renders go on to the same bits, and nothing else is taken for them."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.api.job import RenderJob
from rptcam_cl.api.options import RenderOptions
from rptcam_cl.core.errors import StateError
from rptcam_cl.rendering import checkpoint as saving
from rptcam_cl.scene.load import load_scene
from tests.rendering.pictures import bits, seed_of
from tests.rendering.test_determinism import LENS
from tests.rendering.test_world import still_life

SIZE = (50, 37)


def scene(name):
    return still_life() | ({"camera": LENS} if name == "lens" else {})


def until(count):
    """A function that asks for the end at its call number ``count``."""
    calls = iter(range(count - 1))
    return lambda: next(calls, None) is None


@pytest.mark.parametrize("name", ["pinhole", "lens"])
def test_render_in_parts_has_the_bits_and_counts_of_the_whole(name, tmp_path):
    options = {"size": SIZE, "seed": 3, "layers": ["depth", "object_id", "samples", "position"]}
    whole = rptcam_cl.render(scene(name), spp=41, **options)
    state = tmp_path / "a.rpck"
    for spp, wave_size in ((1, None), (20, 1024), (41, 1 << 18)):
        part = rptcam_cl.render(scene(name), spp=spp, wave_size=wave_size, checkpoint=state, resume=True, **options)
        assert part.stats["spp"] == spp
    assert bits(part) == bits(whole)
    assert part.stats["resumed_from"] == 20
    assert part.stats.get("lens") == whole.stats.get("lens")
    assert part.stats["samples"] == whole.stats["samples"] == 41 * SIZE[0] * SIZE[1]
    for layer in options["layers"]:
        np.testing.assert_array_equal(part[layer], whole[layer])


def test_noise_target_goes_on_from_the_middle_of_a_run(tmp_path):
    options = {"size": SIZE, "noise": 0.08, "layers": ["samples", "variance"]}
    whole = rptcam_cl.render(scene("pinhole"), **options)
    state = tmp_path / "a.rpck"
    stops = 0
    while True:
        part = rptcam_cl.render(
            scene("pinhole"),
            checkpoint=state,
            resume=True,
            wave_size=4096 + 1024 * stops,
            should_stop=until(5),
            **options,
        )
        if not part.stats["interrupted"]:
            break
        stops += 1
    assert stops >= 3
    assert bits(part) == bits(whole)
    for layer in options["layers"]:
        np.testing.assert_array_equal(part[layer], whole[layer])
    assert part.stats["noise"] == whole.stats["noise"]


RUNS = {"noise": {"noise": 0.08}, "variance": {"layers": ["variance"]}}


@pytest.mark.parametrize("asked", RUNS)
@pytest.mark.parametrize("how", ["interrupted", "saved on the way", "few samples"])
def test_state_before_the_first_run_of_samples_is_kept(asked, how, tmp_path, monkeypatch):
    state, options = tmp_path / "a.rpck", {"size": SIZE, "seed": 3} | RUNS[asked]
    stop = until(2) if how == "interrupted" else None
    if how == "saved on the way":
        monkeypatch.setattr(saving, "INTERVAL", 0.0)
    spp = 70 if how == "interrupted" else 4
    part = rptcam_cl.render(
        scene("pinhole"), spp=spp, wave_size=1, checkpoint=state, resume=True, should_stop=stop, **options
    )
    assert part.stats["spp"] < 16
    assert part.stats["checkpoint"] == str(state)
    rest = rptcam_cl.render(scene("pinhole"), spp=70, checkpoint=state, resume=True, **options)
    assert rest.stats["resumed_from"] == part.stats["spp"]
    whole = rptcam_cl.render(scene("pinhole"), spp=70, **options)
    assert bits(rest) == bits(whole)
    assert rest.stats["noise"] == whole.stats["noise"]


@pytest.mark.slow
def test_another_process_goes_on_to_the_same_bits(tmp_path):
    state = tmp_path / "a.rpck"
    rptcam_cl.render(scene("pinhole"), size=SIZE, spp=5, checkpoint=state, resume=True)
    program = (
        "import rptcam_cl; from tests.rendering import test_resume as t;"
        "image = rptcam_cl.render("
        f"t.scene('pinhole'), size=t.SIZE, spp=12, checkpoint={str(state)!r}, resume=True);"
        "print(t.bits(image))"
    )
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=root)
    assert done.stdout.split() == [bits(rptcam_cl.render(scene("pinhole"), size=SIZE, spp=12))], done.stderr


def test_interrupted_render_leaves_its_state_and_a_finished_one_does_not(tmp_path):
    state = tmp_path / "a.rpck"
    image = rptcam_cl.render(scene("pinhole"), size=SIZE, spp=500, checkpoint=state, should_stop=until(2))
    assert image.stats["interrupted"]
    assert image.stats["checkpoint"] == str(state)
    assert state.exists()
    rest = rptcam_cl.render(scene("pinhole"), size=SIZE, spp=image.stats["spp"] + 2, checkpoint=state, resume=True)
    assert rest.stats["resumed_from"] == image.stats["spp"]
    assert state.exists()
    state.unlink()
    assert rptcam_cl.render(scene("pinhole"), size=SIZE, spp=2, checkpoint=state).stats["checkpoint"] is None
    assert not state.exists()


def test_state_is_saved_now_and_then_and_removed_at_the_end(tmp_path, monkeypatch):
    monkeypatch.setattr(saving, "INTERVAL", 0.0)
    state, seen = tmp_path / "a.rpck", []

    def look():
        seen.append(state.exists())
        return False

    rptcam_cl.render(scene("pinhole"), size=SIZE, spp=64, wave_size=1, checkpoint=state, should_stop=look)
    assert all(seen)
    assert list(tmp_path.iterdir()) == []


ENDLESS = """
import rptcam_cl
from rptcam_cl.rendering import checkpoint as saving
from tests.rendering import test_resume as t
saving.INTERVAL = 0.0
rptcam_cl.render(t.scene("pinhole"), size=t.SIZE, spp=10**6, wave_size=1, checkpoint={state!r}, resume=True)
"""


@pytest.mark.slow
def test_killed_render_goes_on_to_the_same_bits(tmp_path):
    state, root = tmp_path / "a.rpck", Path(__file__).resolve().parents[2]
    for delay in np.random.default_rng(seed_of("kill")).uniform(0, 1, 4):
        before = state.stat().st_mtime_ns if state.exists() else None
        process = subprocess.Popen([sys.executable, "-c", ENDLESS.format(state=str(state))], cwd=root)
        while process.poll() is None and (not state.exists() or state.stat().st_mtime_ns == before):
            time.sleep(0.01)
        time.sleep(delay)
        process.kill()
        assert process.wait() < 0
    saved = rptcam_cl.render(scene("pinhole"), size=SIZE, spp=1, checkpoint=state, resume=True).stats["resumed_from"]
    part = rptcam_cl.render(scene("pinhole"), size=SIZE, spp=saved + 5, checkpoint=state, resume=True)
    assert part.stats["resumed_from"] == saved > 16
    assert bits(part) == bits(rptcam_cl.render(scene("pinhole"), size=SIZE, spp=saved + 5))
    assert [path.name for path in tmp_path.iterdir()] == ["a.rpck"]  # no half-written ones


def test_more_samples_than_asked_for_are_kept(tmp_path):
    state = tmp_path / "a.rpck"
    whole = rptcam_cl.render(scene("pinhole"), size=SIZE, spp=9, checkpoint=state, resume=True)
    again = rptcam_cl.render(scene("pinhole"), size=SIZE, spp=4, checkpoint=state, resume=True)
    assert bits(again) == bits(whole)
    assert again.stats["spp"] == 9


OTHERS = {
    "seed": ({"seed": 4}, "its seed is 3, and this render's 4"),
    "resolution": ({"size": (50, 38)}, r"its resolution is \[50, 37\], and this render's \[50, 38\]"),
    "crop": ({"crop": (0, 0.5, 0, 1)}, "its crop is not given"),
    "noise": ({"noise": 0.1}, "its noise is not given, and this render's 0.1"),
}


@pytest.mark.parametrize("other", OTHERS)
def test_state_of_another_render_is_refused(other, tmp_path):
    changes, message = OTHERS[other]
    state = tmp_path / "a.rpck"
    options = {"size": SIZE, "seed": 3, "spp": 2, "checkpoint": state, "resume": True}
    rptcam_cl.render(scene("pinhole"), **options)
    before = state.read_bytes()
    with pytest.raises(StateError, match=message):
        rptcam_cl.render(scene("pinhole"), **(options | changes))
    assert state.read_bytes() == before


def test_state_of_another_scene_lens_or_version_is_refused(tmp_path, monkeypatch):
    state = tmp_path / "a.rpck"
    options = {"size": SIZE, "spp": 2, "checkpoint": state, "resume": True}
    rptcam_cl.render(scene("lens"), **options)
    other = [still_life(), scene("lens") | {"camera": LENS | {"f_number": 8}}]
    for changed in other:
        with pytest.raises(StateError, match="another scene, or one that has changed"):
            rptcam_cl.render(changed, **options)
    rptcam_cl.render(scene("lens") | {"picture": {"ev": 2}}, **options)  # which changes no sample
    monkeypatch.setattr(saving, "__version__", "99.0")
    with pytest.raises(StateError, match=r"saved by version .*, and this is 99\.0"):
        rptcam_cl.render(scene("lens"), **options)


def test_state_that_cannot_be_written_does_not_end_the_render(tmp_path):
    with pytest.warns(UserWarning, match="is not saved: .*no folder|is not saved: .*cannot be written"):
        image = rptcam_cl.render(
            scene("pinhole"), size=SIZE, spp=2, checkpoint=tmp_path / "missing" / "a.rpck", resume=True
        )
    assert image.stats["checkpoint"] is None
    assert image.stats["spp"] == 2


GLASS = "DATA:\n  - {{type: formula 5, wavelength_range: 0.3 2.0, coefficients: {index}}}\n"
ONE_LENS = {
    "name": "one",
    "surfaces": [
        {"radius": 50, "thickness": 4, "glass": {"refractiveindex": "g.yml"}, "diameter": 20},
        {"radius": -50, "thickness": 5, "diameter": 20},
        {"stop": True, "diameter": 10},
    ],
}


def test_picture_of_one_glass_is_not_gone_on_with_through_another(tmp_path):
    def part(index, spp):
        (tmp_path / "g.yml").write_text(GLASS.format(index=index))
        taken = load_scene(scene("pinhole") | {"camera": LENS | {"lens": ONE_LENS}}, base_dir=tmp_path)
        return rptcam_cl.render(taken, size=(8, 8), spp=spp, checkpoint=tmp_path / "a.rpck", resume=True)

    part(1.5, 1)
    with pytest.raises(StateError, match="it is of another scene, or one that has changed since"):
        part(1.7, 2)
    assert part(1.5, 2).stats["resumed_from"] == 1


@pytest.mark.slow
def test_layers_of_so_many_samples_are_not_gone_on_with_by_others(tmp_path):
    options = {"size": (8, 8), "layers": ["depth"], "checkpoint": tmp_path / "a.rpck", "resume": True}
    rptcam_cl.render(scene("pinhole") | {"render": {"layers_spp": 2}}, spp=1, **options)
    with pytest.raises(StateError, match="its layers_spp is 2, and this render's 3"):
        rptcam_cl.render(scene("pinhole") | {"render": {"layers_spp": 3}}, spp=2, **options)
    again = rptcam_cl.render(scene("pinhole") | {"render": {"layers_spp": 2}}, spp=2, **options)
    assert again.stats["resumed_from"] == 1


@pytest.mark.slow  # it fits no polynomials, but bounds the errors of the lens: 2 s
def test_a_render_that_goes_on_keeps_the_camera_that_its_accuracy_chose(tmp_path):
    """Of 40 000 samples polynomials are worth their fit (2.1e9 surfaces), of two they are not."""
    lens = {"kind": "realistic", "lens": "dgauss-50mm", "f_number": 2.8, "eye": [0, -4, 1], "target": [0, 0, 1],
            "up": [0, 0, 1], "focus": {"distance_m": 4}, "accuracy": "auto"}  # fmt: skip
    options = {"size": (64, 48), "checkpoint": tmp_path / "a.rpck", "resume": True}
    first = RenderJob.prepare(still_life() | {"camera": lens}, RenderOptions(spp=2, **options))
    assert first.resolved.scene.camera.rays == "traced"
    first.report(first.run())
    later = RenderJob.prepare(still_life() | {"camera": lens}, RenderOptions(spp=40_000, **options))
    assert (later.first, later.resolved.scene.camera.rays) == (2, "traced")
