"""The render session: bits of `render` after any changes, nothing rebuilt that stays, errors that change nothing."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.api.session import Pace, RenderSession
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.device.session import open_session

POSE = {"eye": [0, -6, 1.5], "target": [0, 0, 0.8], "up": [0, 0, 1]}
WORLD: dict[str, Any] = {
    "film": {"resolution": [50, 30]},
    "render": {"seed": 5, "max_depth": 3},
    "materials": {"grey": {"kind": "matte", "reflectance": [0.5, 0.4, 0.3]}},
    "objects": [
        {"shape": "sphere", "center": [0, 0, 1], "radius": 1, "material": "grey", "name": "ball"},
        {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": "grey"},
    ],
    "environment": {"kind": "gradient", "bottom": 0.2, "top": [0.6, 0.8, 1.0]},
}
PINHOLE = WORLD | {"camera": {"kind": "pinhole", "fov_degrees": 40, **POSE}, "exposure": "auto"}


def assert_has_bits_of_render(session: RenderSession, spp: int) -> None:
    image, alone = session.image(), rptcam_cl.render(session.scene, spp=spp)
    np.testing.assert_array_equal(image.pixels, alone.pixels)
    assert image.metadata == alone.metadata
    assert image.layers.keys() == alone.layers.keys()
    for name in alone.layers:
        np.testing.assert_array_equal(image[name], alone[name])


@pytest.fixture(scope="module")
def shared() -> Iterator[RenderSession]:
    with RenderSession(PINHOLE) as session:
        yield session


@pytest.fixture
def session(shared: RenderSession) -> RenderSession:
    shared.replace(PINHOLE | {"exposure": {"mode": "relative"}})
    shared.replace(PINHOLE)  # with an empty film
    return shared


def test_film_has_the_bits_of_render_after_changes_and_glances(session: RenderSession) -> None:
    session.take(2)
    changes: list[dict[str, Any]] = [
        {"camera.eye": [1, -5, 1.2]},
        {"objects.0.radius": 0.7, "materials.grey.reflectance": 0.2},
        {"exposure.ev": 1, "render.layers": ["depth", "sharp_depth", "crypto_object"]},
        {"picture.tone": "agx", "film.filter": {"kind": "tent", "radius_px": 1.5}},
    ]
    for change in changes:
        session.change(change)
        session.glance(0.5)
        session.take()
    assert session.take(4).spp == 5
    session.glance(0.25)
    assert_has_bits_of_render(session, 5)


def test_samples_one_by_one_are_those_of_one_take(session: RenderSession) -> None:
    whole = session.take(5).pixels
    session.change({"render.seed": 6})
    session.change({"render.seed": 5})
    frames = [session.take() for _ in range(5)]
    assert [frame.spp for frame in frames] == [1, 2, 3, 4, 5]
    np.testing.assert_array_equal(frames[-1].pixels, whole)
    np.testing.assert_array_equal(session.pixels(), whole)


def test_kind_of_a_change_is_the_dearest_that_it_took(session: RenderSession) -> None:
    session.take()
    found = [
        session.change(change)
        for change in (
            {"picture.ev": 1.5},
            {"camera.fov_degrees": 35, "exposure.ev": 0.5},
            {"objects.0.radius": 0.9},
            {"render.seed": 5},
        )
    ]
    assert [change.kind for change in found] == ["picture", "camera", "scene", "none"]
    assert found[1].keys == ("camera", "exposure") and all(change.ready for change in found)


def test_picture_settings_keep_the_samples(session: RenderSession) -> None:
    session.take(2)
    generation = session.generation
    session.change({"picture": {"tone": "agx", "ev": 1}})
    assert session.spp == 2 and session.generation == generation + 1
    assert session.image().development.tone.kind == "agx"


def test_change_that_is_refused_leaves_the_session_as_it_was(session: RenderSession) -> None:
    frame, scene = session.take(2), session.scene
    for wrong in ({"camera.fov_degrees": 300, "camera.eye": [9, 9, 9]}, {"camera.lens": "no-such"}, {"objects.5": {}}):
        with pytest.raises(InputError):
            session.change(wrong)
    with pytest.raises(InputError, match="finds no light"):
        session.replace(PINHOLE | {"environment": None})
    assert session.scene is scene and session.spp == 2
    np.testing.assert_array_equal(session.pixels(), frame.pixels)


def test_glance_is_the_same_view_in_fewer_pixels(session: RenderSession) -> None:
    session.change({"exposure": {"mode": "relative"}})
    session.take(2)
    glance = session.glance(0.5)
    assert (glance.spp, glance.scale, session.spp) == (1, 0.5, 2)
    small = rptcam_cl.render(session.scene, size=(25, 15), spp=1)
    np.testing.assert_array_equal(glance.pixels, small.pixels)
    with pytest.raises(InputError, match="scale: is out of range"):
        session.glance(0)


def cancel_after_each_wave(session: RenderSession, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cancel whatever is under way when its first wave is on the device, and make waves far shorter than a sample."""
    count_waves = Pace.count_waves

    def cut(pace: Pace, finish: Callable[[], None], should_stop: Callable[[], bool]) -> Callable[[int], bool]:
        count = count_waves(pace, finish, should_stop)

        def counted(slots: int) -> bool:
            session.cancel()
            return count(slots)

        return counted

    monkeypatch.setattr("rptcam_cl.api.session.QUEUE_SECONDS", 5e-4)
    monkeypatch.setattr(Pace, "count_waves", cut)


def test_cancelled_take_is_gone_on_with(session: RenderSession, monkeypatch: pytest.MonkeyPatch) -> None:
    session.change({"film.resolution": [960, 540]})
    whole = session.take(3).pixels
    session.change({"render.seed": 9})
    session.change({"render.seed": 5})
    with monkeypatch.context() as patched:
        cancel_after_each_wave(session, patched)
        frames = [session.take() for _ in range(3)]
    assert not any(frame.complete or frame.spp for frame in frames)
    assert (frames[0].pixels.max(axis=2) > 0).any() and np.isfinite(frames[0].pixels).all()
    while session.spp < 3:
        session.take(3 - session.spp)
    np.testing.assert_array_equal(session.pixels(), whole)


def test_cancel_without_a_take_is_not_remembered(session: RenderSession) -> None:
    session.cancel()
    assert session.take(2).complete and session.spp == 2


def test_two_sessions_share_a_device(session: RenderSession) -> None:
    other = RenderSession(PINHOLE, device=session.device, seed=8)
    assert other.device is session.device is open_session()
    for _ in range(3):
        session.take()
        other.take()
    assert_has_bits_of_render(session, 3)
    assert_has_bits_of_render(other, 3)
    other.close()
    session.take()
    with pytest.raises(StateError, match="closed"):
        other.take()


def test_image_before_the_first_sample_is_an_error(session: RenderSession) -> None:
    with pytest.raises(InputError, match="no samples yet"):
        session.image()
    assert not session.pixels().any()
