"""Pictures without their noise: nearer to the truth, less so with every sample, and never in a file."""

import io
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from PIL import Image as Pillow

from rptcam_cl.api.job import render
from rptcam_cl.api.session import Frame, RenderSession
from rptcam_cl.scene.load import load_scene
from rptcam_cl.viewfinder import slot as module
from rptcam_cl.viewfinder.slot import CLEAN, DARKEST, Slot, visible_noise
from tests.viewfinder.page_client import ALIVE_WITHIN_S, SCENE, page, serving

Film = NDArray[np.float32]


def scene(**changes: Any) -> Any:
    """A ball on a chequered floor under a small lamp, which few samples show with much noise."""
    given = yaml.safe_load(SCENE)
    given["film"]["resolution"] = [192, 128]
    given["render"] = {"spp": 400, "max_depth": 3}
    checker = {"kind": "checker", "odd": 0.2, "even": 0.8, "scale": [40, 40]}
    given["materials"]["floor"] = {"kind": "matte", "reflectance": checker}
    given["objects"] += [
        {"shape": "plane", "point": [0, -0.15, 0], "normal": [0, 1, 0], "material": "floor"},
        {"shape": "sphere", "center": [0.5, 0.7, 0.2], "radius": 0.2, "material": {"kind": "emissive", "radiance": 20}},
    ]
    return load_scene(given | changes)


def denoised(session: RenderSession, frame: Frame) -> Film:
    """Return a frame without its noise, once the kernels are there."""
    end = time.monotonic() + ALIVE_WITHIN_S
    while (found := session.denoised(frame)) is None:
        assert time.monotonic() < end
        time.sleep(0.02)
    return found


def error(film: Film, truth: Film) -> float:
    """Relative mean square error of what a screen shows, which ends at 1."""
    shown, true = np.minimum(film, 1.0), np.minimum(truth, 1.0)
    return float(np.mean((shown - true) ** 2) / np.mean(true**2))


@pytest.mark.slow
def test_denoised_picture_is_nearer_to_the_finished_one_and_changes_less_with_samples() -> None:
    with RenderSession(scene()) as session:
        few = session.take(2)
        clean = denoised(session, few)
        many = session.take(62)
        later = denoised(session, many)
        truth = session.take(336).pixels
    assert error(clean, truth) < error(few.pixels, truth) / 3
    assert np.mean((later - many.pixels) ** 2) < np.mean((clean - few.pixels) ** 2) / 8


@pytest.mark.slow
def test_glance_is_denoised_by_layers_of_its_own_size() -> None:
    with RenderSession(scene()) as session:
        truth = session.take(256).pixels.reshape(64, 2, 96, 2, 3).mean(axis=(1, 3))
        glance = session.glance(0.5)
        clean = denoised(session, glance)
    assert clean.shape == glance.pixels.shape == (64, 96, 3)
    assert error(clean, truth) < error(glance.pixels, truth) / 3


@pytest.mark.slow
def test_what_has_no_noise_stays_as_it_is() -> None:
    even = scene(objects=[], environment={"kind": "constant", "radiance": [0.4, 0.5, 0.6]})
    pinhole = {"kind": "pinhole", "eye": [0, 0, 1], "target": [0, 0, 0], "fov_degrees": 40}
    with RenderSession(load_scene(even.made_of | {"camera": pinhole})) as session:
        frame = session.take(1)
        np.testing.assert_allclose(denoised(session, frame), frame.pixels, rtol=1e-5)


@pytest.mark.slow
def test_edges_between_things_stay_where_they_are() -> None:
    """A black ball before a white world: nothing of one goes over to the other."""
    black = {"shape": "sphere", "center": [0, 0, 0], "radius": 0.15, "material": {"kind": "matte", "reflectance": 0}}
    pinhole = {"kind": "pinhole", "eye": [0, 0, 1], "target": [0, 0, 0], "fov_degrees": 40}
    given = scene().made_of | {
        "objects": [black],
        "camera": pinhole,
        "environment": {"kind": "constant", "radiance": 1},
    }
    with RenderSession(load_scene(given)) as session:
        frame = session.take(16)
        clean = denoised(session, frame)
    inside = frame.pixels.max(axis=2) == 0
    assert inside.sum() > 200
    assert clean[inside].max() < 0.05  # at its rim, where some rays of a pixel pass it
    outside = frame.pixels.min(axis=2) == 1
    assert clean[outside].min() > 0.98


def test_page_sees_denoised_pictures_and_files_and_the_last_one_are_as_they_are(tmp_path: Path) -> None:
    file = tmp_path / "ball.yaml"
    file.write_text(SCENE.replace("spp: 8", "spp: 64"))
    with RenderSession(load_scene(file)) as session:  # so that the kernels are there before the picture is done
        denoised(session, session.take(2))
    with serving(file) as (_, server), page(server) as client:
        client.frame(lambda header: header["denoised"])
        last = client.frame(lambda header: header["spp"] == 64)
        assert not last.header["denoised"]
        whole = render(file, spp=64)
        whole.save(tmp_path / "whole.png")
        saved = client.ask(7, "save", format="png", name="a")
        assert np.array_equal(
            np.asarray(Pillow.open(io.BytesIO(saved.data))), np.asarray(Pillow.open(tmp_path / "whole.png"))
        )
        client.ask(8, "denoise", on=False)
        client.ask(9, "dial", name="f_number", value=4.0)
        seen = client.frame(lambda header: header["spp"] == 64)
        after = [each.header for each in client.seen if each.type == "frame" and each.header["answers"] == 9]
        assert seen.header in after
        assert not any(header["denoised"] for header in after)


def test_noise_that_is_seen_is_that_of_most_pixels_below_white() -> None:
    clean = np.full((200, 300, 3), 0.4, np.float32)
    factors = np.random.default_rng(1).normal(1.0, 0.1, (200, 300, 1)).astype(np.float32)
    factors[::50, ::50] = 1e4  # fireflies
    assert visible_noise(clean * factors, clean) == pytest.approx(0.1 * 0.4 / (0.4 + DARKEST), rel=0.03)
    assert visible_noise(clean * factors * 10, clean * 10) == 0  # white
    assert visible_noise(clean, clean) == 0


@pytest.mark.slow
def test_time_to_clean_falls_with_the_square_of_the_noise() -> None:
    with RenderSession(scene()) as session:
        frame = session.take(4)
        denoised(session, frame)
        slot = Slot("A", session, {})
        slot.show(frame, False, {})
        found = slot.clean_at(frame)
        assert found is not None
        assert slot.shown is not None and slot.shown.clean is not None
        assert found["noise"] == visible_noise(frame.pixels, slot.shown.clean)
        assert found["spp"] == pytest.approx(4 * (found["noise"] / CLEAN) ** 2)


@pytest.mark.slow
def test_the_network_cleans_the_picture_at_rest_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pyoidn")
    monkeypatch.setattr(module, "NETWORK_S", 0.0)
    with RenderSession(scene()) as session:
        denoised(session, session.take(2))
        slot = Slot("A", session, {})
        slot.show(slot.glance(), False, {})
        assert not slot.wants_network
        slot.show(slot.refine(lambda: True) or session.frame(), False, {})
        assert slot.wants_network
        _, frame, clean = made = slot.network_later()()
        slot.show_network(made)
        assert slot.shown is not None
        assert slot.shown.clean is clean
        assert not slot.wants_network  # until the samples have doubled
        assert error(clean, session.take(400).pixels) < 0.3 * error(frame.pixels, session.pixels())
        slot.show(session.frame(), False, {})  # 400 samples
        slot.show_network(made)
        assert slot.shown.frame.spp >= 400
        slot.change({"camera.f_number": 5.6})
        slot.show(slot.glance(), False, {})
        slot.show_network(made)  # too late
        assert slot.shown.frame.scale < 1 or slot.shown.clean is not clean
