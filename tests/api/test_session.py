"""The render session: bits of `render` after any changes, nothing rebuilt that stays, errors that change nothing."""

import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.api.compiling import focuses_anew
from rptcam_cl.api.session import QueueLimit, RenderSession
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.device.session import Session, open_session

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
THIN_LENS = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 4, "focus_distance_m": 6, **POSE}
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


def test_generation_counts_the_changes_that_are_shown() -> None:
    with RenderSession(PINHOLE) as session:
        assert session.generation == session.take().generation == 0
        for count, change in enumerate(({"camera.eye": [0, -5, 1.5]}, {"picture.ev": 1}, {"objects.0.radius": 0.9}), 1):
            session.change(change)
            session.change(change)  # which changes nothing
            assert session.generation == session.glance(0.5).generation == session.take().generation == count


@pytest.mark.parametrize("method", ["replace", "change"])
def test_change_has_its_kernels_when_it_returns(method: str) -> None:
    device = Session(open_session().info)
    scene = PINHOLE | {"exposure": {"mode": "relative"}}  # a meter would compile them, too
    with RenderSession(scene, device=device) as session:
        session.take()
        session.glance(0.5)
        known = len(device.programs)
        changed = {"camera": THIN_LENS}
        change = session.change(changed) if method == "change" else session.replace(scene | changed)
        assert (change.kind, change.ready, session.is_waiting) == ("program", True, False)
        new = len(device.programs)
        assert new > known
        assert session.glance(0.5).generation == 1
        assert len(device.programs) == new


def until_ready(session: RenderSession) -> None:
    while not session.ready:
        time.sleep(0.01)


def test_session_shows_the_scene_before_until_the_kernels_of_another_are_there() -> None:
    scene = PINHOLE | {"exposure": {"mode": "relative"}}
    with RenderSession(scene, device=Session(open_session().info)) as session:
        session.take()
        change = session.change({"camera": THIN_LENS}, wait=False)
        assert (change.kind, change.ready, session.is_waiting) == ("program", False, True)
        assert (session.scene.camera.kind, session.resolved.camera.kind) == ("thin_lens", "thin_lens")
        change = session.change({"picture.ev": 1}, wait=False)
        assert (change.kind, change.keys, change.ready) == ("picture", ("picture",), False)
        assert (session.generation, session.spp) == (0, 1)
        until_ready(session)
        frame = session.take()
        assert (frame.generation, frame.spp, session.generation, session.is_waiting) == (1, 1, 1, False)
        assert (session.scene.camera.kind, session.scene.picture.ev) == ("thin_lens", 1)
        assert_has_bits_of_render(session, 1)
        assert session.change({"camera": PINHOLE["camera"]}, wait=False).ready  # which is known


def test_change_that_was_prepared_is_shown_at_once() -> None:
    with RenderSession(PINHOLE | {"exposure": {"mode": "relative"}}, device=Session(open_session().info)) as session:
        frame = session.take()
        session.prepare({"camera": THIN_LENS})
        with pytest.raises(InputError, match=r"fov_degrees"):
            session.prepare({"camera.fov_degrees": 400})
        until_ready(session)
        assert (session.scene.camera.kind, session.generation) == ("pinhole", frame.generation)
        change = session.change({"camera": THIN_LENS}, wait=False)
        assert (change.ready, session.is_waiting) == (True, False)


def test_focus_that_was_found_stays_until_it_is_asked_for_again() -> None:
    auto = {"auto": {"method": "depth", "object": "ball"}}
    camera = {key: value for key, value in THIN_LENS.items() if key != "focus_distance_m"} | {"focus": auto}
    with RenderSession(PINHOLE | {"camera": camera, "exposure": {"mode": "relative"}}) as session:
        found = session.resolved.camera.focus_distance_m
        assert session.metadata["autofocus"]["method"] == "depth"
        assert found == pytest.approx(np.hypot(6, 0.5) - 1, rel=0.03)  # the front of the ball, in the mean
        session.change({"camera.eye": [0, -3, 1.5]})
        assert session.scene.camera.focus_distance_m == session.resolved.camera.focus_distance_m == found
        session.change({"camera": camera | {"eye": [0, -3, 1.5]}})
        assert session.resolved.camera.focus_distance_m == pytest.approx(np.hypot(3, 0.5) - 1, rel=0.06)


def test_frames_have_the_size_of_what_is_seen_of_the_film(session: RenderSession) -> None:
    assert session.resolution == (50, 30)
    session.change({"film.crop": [0.2, 0.6, 0.5, 1]})
    assert session.resolution == (20, 15)
    assert session.take().pixels.shape == (15, 20, 3)
    assert session.glance(0.5).pixels.shape[:2] in ((7, 10), (8, 10))


def test_glances_of_a_part_of_the_film_and_of_a_locked_exposure_leave_the_meter_alone(session: RenderSession) -> None:
    session.glance(1)  # whose reading the next goes by
    whole = session.glance(1).pixels
    session.change({"film.crop": [0, 1, 0, 0.25]})  # bright sky
    for _ in range(2):
        np.testing.assert_allclose(session.glance(1).pixels, whole[:8], rtol=1e-5)
    session.change({"film.crop": None, "exposure.lock_cd_m2": session.metadata["metered_cd_m2"] * 2})
    first, second = session.glance(1).pixels, session.glance(1).pixels
    np.testing.assert_array_equal(first, second)
    np.testing.assert_allclose(first, session.take().pixels, rtol=1e-5)


def test_glances_without_a_background_are_as_bright_as_the_film(session: RenderSession) -> None:
    session.change({"film.transparent": True})  # which the meter sees all the same
    film = session.take().pixels
    for _ in range(2):
        np.testing.assert_allclose(session.glance(1).pixels, film, rtol=1e-5)


def test_panorama_keeps_its_shape_in_glances(session: RenderSession) -> None:
    camera = {"kind": "environment", **POSE}
    session.replace(WORLD | {"camera": camera, "film": {"resolution": [50, 25]}})
    assert session.glance(0.26).pixels.shape == (6, 12, 3)


def test_picture_of_a_sample_that_was_left_is_that_of_all_of_it(
    session: RenderSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    session.change({"film.resolution": [960, 540]})
    with monkeypatch.context() as patched:
        cancel_after_each_wave(session, patched)
        assert not session.take().complete
    assert_has_bits_of_render(session, 1)


def test_session_renders_on_one_device(monkeypatch: pytest.MonkeyPatch) -> None:
    device = open_session()
    monkeypatch.setattr("rptcam_cl.api.session.open_sessions", lambda wanted: ([device, device], None))
    with pytest.raises(InputError, match=r"^device: a session renders on one device"):
        RenderSession(PINHOLE)


@pytest.mark.parametrize(
    ("changes", "automatic", "anew"),
    [
        ({"camera": {}}, False, True),
        ({"camera.lens": "tessar-100mm"}, False, True),
        ({"camera.zoom": 0.5}, False, True),
        ({"camera.eye": [0, 0, 1]}, True, False),
        ({"camera.focus": {"auto": {}}}, True, True),
        ({"camera.focus.auto.method": "depth"}, True, True),
        ({"camera.focus.auto.method": "depth"}, False, False),
        ({"camera.focus_distance_m": 2}, False, False),
        ({"objects.0.radius": 2, "film.width_mm": 24}, True, False),
        ({"film.resolution": [3, 2], "camera.kind": "thin_lens"}, False, True),
    ],
)
def test_focus_is_found_anew_where_it_is_asked_for_and_for_another_lens(
    changes: dict[str, Any], automatic: bool, anew: bool
) -> None:
    scene: Any = SimpleNamespace(requested_autofocus=SimpleNamespace() if automatic else None)
    assert focuses_anew(changes, scene) is anew


def test_less_than_a_sample_is_refused(session: RenderSession) -> None:
    with pytest.raises(InputError, match=r"^samples: is out of range \(got 0; allowed: at least 1"):
        session.take(0)
    with pytest.raises(InputError, match=r"^scale: is out of range \(got 1.01; "):
        session.glance(1.01)
    assert session.glance(1).pixels.shape == session.pixels().shape


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


def test_glance_of_a_rolled_camera_has_surroundings_that_stand_as_it_does(session: RenderSession) -> None:
    session.change({"exposure": {"mode": "relative"}})
    session.change({"camera.up": [0.5, 0, 1]})  # which counts as above in the environment, too
    small = rptcam_cl.render(session.scene, size=(25, 15), spp=1)
    np.testing.assert_array_equal(session.glance(0.5).pixels, small.pixels)


def cancel_after_each_wave(session: RenderSession, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cancel whatever is under way when its first wave is on the device, and make waves far shorter than a sample."""
    count_waves = QueueLimit.count_waves

    def cut(queue: QueueLimit, finish: Callable[[], None], should_stop: Callable[[], bool]) -> Callable[[int], bool]:
        count = count_waves(queue, finish, should_stop)

        def counted(slots: int) -> bool:
            session.cancel()
            return count(slots)

        return counted

    monkeypatch.setattr("rptcam_cl.api.session.QUEUE_SECONDS", 5e-4)
    monkeypatch.setattr(QueueLimit, "count_waves", cut)


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
