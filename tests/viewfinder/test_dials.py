"""Dials on scenes: the changes are the scene's own keys, what they mean for the film, limits, and what is refused."""

import copy
import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from rptcam_cl.core.colour import illuminant, xyz_from_spectrum
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.device.session import open_sessions
from rptcam_cl.optics.lens import in_configuration
from rptcam_cl.optics.library import list_lenses, load_lens
from rptcam_cl.scene.camera import Movements
from rptcam_cl.scene.lens_settings import RealLens
from rptcam_cl.scene.load import apply_overrides, load_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder import dials as lens_choice
from rptcam_cl.viewfinder.delivery import KELVIN, dial_list
from rptcam_cl.viewfinder.dials import DIALS, follow_light, lens_entries, meter_needle, turn_dial, wheel, zoom_by
from rptcam_cl.viewfinder.lens_panel import INFINITY_M, image_circle_mm, lens_state, nearest_focus_m
from rptcam_cl.viewfinder.panel import BODIES, KITS, Dials, Panel, read_dials, value_per_radiance
from tests.support.cases import fast

POSE = {"eye": [0, 0, 0], "target": [0, 0, -2]}
LENS = {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 2}, "f_number": 4, **POSE}
CAMERAS: dict[str, dict[str, Any]] = {
    "traced": LENS,
    "thick": LENS | {"kind": "thick_lens"},
    "thin": {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 4, "focus_distance_m": 2, **POSE},
    "pinhole": {"kind": "pinhole", "fov_degrees": 40, **POSE},
}
READING = 250.0


class Body:
    """A camera with its dials, whose scene follows them; `auto` is resolved as metering does, from a known reading."""

    def __init__(self, camera: str | Mapping[str, Any] = "traced", reading: float = READING, **parts: Any) -> None:
        keys = CAMERAS[camera] if isinstance(camera, str) else camera
        self.data: dict[str, Any] = {"film": {"resolution": [36, 24]}, "camera": dict(keys)} | parts
        self.reading = reading
        self.messages: tuple[str, ...] = ()
        self._load()
        self.dials = read_dials(self.scene)

    def _load(self, overrides: tuple[str, ...] = ()) -> None:
        self.scene = load_scene(self.data, overrides)
        self.resolved = self._exposed(self.scene)

    def _exposed(self, scene: Scene) -> Scene:
        exposure = scene.exposure
        if exposure.mode != "auto":
            return scene
        keys = {"neutral_density_stops": exposure.neutral_density_stops, "f_number": exposure.f_number}
        physical = type(exposure).model_validate({"mode": "physical", "iso": exposure.iso} | keys)
        whole = scene.model_copy(update={"exposure": physical})
        value = (exposure.lock_cd_m2 or self.reading) / 683.002 * value_per_radiance(whole)
        missing = exposure.target * 2**exposure.ev / value
        if exposure.priority == "shutter":
            return whole.model_copy(update={"exposure": physical.model_copy(update={"iso": physical.iso * missing})})
        shutter = scene.shutter.model_copy(update={"time_s": scene.shutter.time_s * missing})
        return whole.model_copy(update={"shutter": shutter})

    def turn(self, name: str, value: Any, reading: float | None = None) -> "Body":
        turned = turn_dial(Panel(self.dials, self.scene, self.resolved, reading or self.reading), name, value)
        return self.take(turned.dials, turned.changes, turned.messages)

    def take(self, dials: Dials, changes: Mapping[str, Any], messages: tuple[str, ...]) -> "Body":
        done = [f"{key}={yaml.safe_dump(value, default_flow_style=True)}" for key, value in changes.items()]
        self.data = load_scene_data(self.data, done)
        self._load()
        self.dials, self.messages = dials, messages
        return self

    @property
    def value(self) -> float:
        """What the film makes of the reading."""
        return self.reading / 683.002 * value_per_radiance(self.resolved)

    def listed(self, name: str) -> dict[str, Any]:
        entries = dial_list(Panel(self.dials, self.scene, self.resolved))
        return next(entry for entry in entries if entry["name"] == name)


def load_scene_data(data: dict[str, Any], overrides: list[str]) -> dict[str, Any]:
    """The content of a scene with `--set` applied."""

    changed = copy.deepcopy(data)
    apply_overrides(changed, overrides)
    return changed


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("mode", ["A", "S", "P"])
def test_metered_part_becomes_middle_grey(camera: str, mode: str) -> None:
    body = Body(camera).turn("mode", mode)
    assert math.log2(body.value / 0.18) == pytest.approx(0, abs=1e-4)
    body.turn("ev", 1)
    assert math.log2(body.value / 0.18) == pytest.approx(1, abs=1e-4)
    assert body.scene.exposure.ev == (1 if mode == "A" else 0)
    assert read_dials(body.scene, body.dials) == body.dials


@pytest.mark.parametrize("camera", CAMERAS)
def test_manual_mode_keeps_what_was_found(camera: str) -> None:
    body = Body(camera, exposure={"mode": "auto", "f_number": 4} if camera == "pinhole" else {"mode": "auto"})
    assert (body.dials.mode, body.scene.exposure.mode) == ("A", "auto")
    before = body.value
    body.turn("mode", "M")
    assert (body.scene.exposure.mode, body.scene.shutter.time_s) == ("physical", body.resolved.shutter.time_s)
    assert body.value == pytest.approx(before, rel=1e-12)


@pytest.mark.parametrize("camera", CAMERAS)
def test_scene_values_become_settings_of_the_same_brightness_and_back(camera: str) -> None:
    body = Body(camera, exposure={"mode": "relative", "ev": 1.5, "neutral_density_stops": 1})
    before = body.value
    body.turn("mode", "M")
    assert body.data["exposure"]["mode"] == "physical"
    assert body.value == pytest.approx(before, rel=1e-9)
    body.turn("mode", "relative")
    assert body.data["exposure"]["mode"] == "relative"
    assert body.value == pytest.approx(before, rel=1e-9)


def test_exposure_follows_the_dial_that_is_turned() -> None:
    body = Body().turn("mode", "A")
    first = body.resolved.shutter.time_s
    body.turn("f_number", 8)
    assert body.scene.camera.f_number == 8  # type: ignore[union-attr]
    assert math.log2(body.resolved.shutter.time_s / first) == pytest.approx(2, abs=0.02)  # a lens is no ideal one
    body.turn("mode", "S").turn("shutter_s", 1 / 125)
    assert body.scene.shutter.time_s == 2**-7
    assert math.log2(body.value / 0.18) == pytest.approx(0, abs=1e-4)
    body.turn("mode", "M").turn("iso", 800)
    assert math.log2(body.value / 0.18) == pytest.approx(3, abs=1e-3)
    assert meter_needle(Panel(body.dials, body.scene, body.resolved, READING)) == pytest.approx(3, abs=1e-3)
    body.turn("auto_iso", True)
    assert body.scene.exposure.priority == "shutter"
    assert body.resolved.exposure.iso == pytest.approx(100, rel=1e-3)
    body.turn("auto_iso", False)
    assert body.scene.exposure.mode == "physical"
    assert body.scene.exposure.iso == pytest.approx(100, rel=1e-3)


def test_dials_that_follow_say_so_and_do_not_turn() -> None:
    body = Body().turn("mode", "S")
    before = dict(body.data)
    assert body.listed("f_number")["linked"] == "computed by exposure mode S"
    assert not body.listed("f_number")["enabled"]
    assert "follows" in body.turn("f_number", 8).messages[0]
    assert body.data == before


def test_light_is_followed_in_every_mode_but_not_while_locked() -> None:
    for mode in ("S", "P"):
        body = Body().turn("mode", mode)
        body.reading = 4 * READING
        turned = follow_light(Panel(body.dials, body.scene, body.resolved, body.reading))
        body.take(turned.dials, turned.changes, turned.messages)
        assert math.log2(body.value / 0.18) == pytest.approx(0, abs=1e-4)
        assert follow_light(Panel(body.dials, body.scene, body.resolved, body.reading * 1.01)).changes == {}
        body.turn("lock", True)
        assert follow_light(Panel(body.dials, body.scene, body.resolved, 100 * READING)).changes == {}
    body = Body().turn("mode", "A")
    assert (
        follow_light(Panel(body.dials, body.scene, body.resolved, 4 * READING)).changes == {}
    )  # the scene's metering follows
    body.turn("lock", True)
    assert body.scene.exposure.lock_cd_m2 == READING
    body.turn("lock", False)
    assert body.scene.exposure.lock_cd_m2 is None


@pytest.mark.parametrize("reading", [1e-20, 1e30])
def test_lock_holds_what_a_scene_may_say(reading: float) -> None:
    body = Body().turn("mode", "A")
    body.reading = reading
    body.turn("lock", True)
    assert body.dials.locked_cd_m2 == min(max(reading, 1e-12), 1e20)


def test_limits_of_the_shutter_hold_back_what_the_meter_asks_for() -> None:
    body = Body(reading=1e7).turn("mode", "A")
    assert body.scene.exposure.mode == "physical"
    assert body.scene.shutter.time_s == 2**-15
    assert "1/32000 is the limit" in body.messages[0] and "too bright" in body.messages[0]
    turned = follow_light(Panel(body.dials, body.scene, body.resolved, READING))
    assert turned.changes["exposure"]["mode"] == "auto"


@pytest.mark.parametrize(
    ("name", "value", "key", "found"),
    [
        ("f_number", 5.6, "camera.f_number", 2**2.5),
        ("f_number", 1.0, "camera.f_number", pytest.approx(2.03015, rel=1e-5)),
        ("f_number", 100, "camera.f_number", 32.0),
        ("shutter_s", 1 / 500, "shutter.time_s", 2**-9),
        ("focus_m", 3.5, "camera.focus", {"distance_m": 3.5}),
        ("focus_m", 2e6, "camera.focus", {"distance_m": INFINITY_M}),
        ("stop", "star", "camera.aperture", {"shape": "star"}),
        ("blades", 5, "camera.aperture", {"shape": "polygon", "blades": 5}),
        ("blades", 0, "camera.aperture", {"shape": "circle"}),
        ("format", "aps_c", "film.format", "aps_c"),
        ("white_balance", "D50", "picture.white_balance", "D50"),
        ("white_balance", 3200, "picture.white_balance", {"temperature_k": 3200.0}),
        ("temperature_k", 100, "picture.white_balance", {"temperature_k": 1800.0}),
        ("tone", "agx", "picture.tone", "agx"),
    ],
)
def test_dial_sets_its_key(name: str, value: Any, key: str, found: Any) -> None:
    body = Body()
    assert turn_dial(Panel(body.dials, body.scene, body.resolved), name, value).changes == {key: found}
    body.turn(name, value)


def test_nearest_focus_is_the_end_of_the_ring() -> None:
    body = Body()
    nearest = nearest_focus_m(body.scene)
    body.turn("focus_m", 0.01)
    assert body.listed("focus_m")["value"] == pytest.approx(nearest)
    assert "nearest focus" in body.messages[0]
    scale = body.listed("focus_m")["scale"]
    assert scale["position"] == pytest.approx(0, abs=1e-9)
    assert [mark["position"] for mark in scale["marks"]] == sorted(mark["position"] for mark in scale["marks"])


def test_every_lens_of_the_library_can_be_mounted_and_the_old_one_again() -> None:
    names = [entry.name for entry in lens_entries(Body().scene)]
    assert names[: len(list_lenses())] == list_lenses()
    body = Body()
    for name in ("zoom-70-200mm", "wide-22mm", "dgauss-50mm"):
        body.turn("lens", name)
        assert body.scene.camera.lens == name  # type: ignore[union-attr]
        assert body.listed("lens")["value"] == name
        assert body.listed("focus_m")["value"] == pytest.approx(2, rel=1e-6)


def test_the_list_of_lenses_is_kept_for_the_next_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Body().scene
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    lens_choice._library.cache_clear()
    found = lens_entries(scene)
    lens_choice._library.cache_clear()
    with monkeypatch.context() as patched:
        patched.setattr(lens_choice, "named_lens", None)
        assert lens_entries(scene) == found
    assert len(list(tmp_path.rglob("*"))) == 2  # a folder and a file


def test_a_lens_without_a_stop_takes_the_blades_away() -> None:
    body = Body().turn("blades", 5).turn("lens", "biconvex")
    assert body.listed("stop")["value"] == "circle"
    assert not body.listed("blades")["enabled"]
    assert any("no stop" in message for message in body.messages)


@pytest.mark.parametrize("camera", ["thin", "pinhole"])
def test_a_lens_on_an_ideal_camera_keeps_its_place_and_focus(camera: str) -> None:
    body = Body(camera).turn("lens", "dgauss-50mm")
    assert (body.scene.camera.kind, body.scene.camera.target) == ("realistic", (0, 0, -2))
    assert body.listed("focus_m")["value"] == pytest.approx(2)


def test_a_lens_on_a_view_camera_leaves_its_film_where_it_stands() -> None:
    body = Body(CAMERAS["thin"] | {"movements": {"rise_mm": 4, "tilt_degrees": 2}}).turn("lens", "dgauss-50mm")
    assert body.scene.camera.kind == "realistic"
    assert body.scene.camera.film_movements == Movements(rise_mm=4, tilt_degrees=2)


def test_a_lens_on_a_thin_lens_has_its_diffraction_stop_and_blades() -> None:
    own = {"diffraction": "on", "stop": {"dirt": {}}, "aperture": {"shape": "polygon", "blades": 5}}
    before = Body(CAMERAS["thin"] | own)
    body = Body(CAMERAS["thin"] | own).turn("lens", "dgauss-50mm")
    assert body.messages == ()
    for name in own:
        assert getattr(body.scene.camera, name) == getattr(before.scene.camera, name), name
    body = Body(CAMERAS["pinhole"] | {"near_m": 1}).turn("lens", "dgauss-50mm")
    assert body.messages == ("a camera with a lens has no near_m: left out",)


def test_another_lens_is_in_the_same_air_where_it_takes_heat() -> None:
    heated = {"design": "cooke-triplet-50mm", "temperature_c": 60, "as_built": "90%"}
    body = Body(LENS | {"lens": heated, "f_number": 8})
    lens = body.turn("lens", "tessar-102mm").scene.camera.lens_camera
    assert lens is not None and isinstance(lens.lens, RealLens)
    assert (lens.design, lens.lens.temperature_c, lens.as_built) == ("tessar-102mm", 60, None)
    assert body.turn("lens", "dgauss-50mm").scene.camera.lens == "dgauss-50mm"  # type: ignore[union-attr]
    assert body.messages[0].startswith("at 20 degrees: camera.lens.temperature_c: Double Gauss 50 mm f/2: surfaces[0]:")


def test_lens_files_are_those_of_the_scenes_folder(tmp_path: Path) -> None:
    source = Path(__file__).parents[2] / "lenses" / "biotar-58mm.yaml"
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "mine.yaml").write_text(source.read_text("utf-8"), "utf-8")
    (folder / "scene.yaml").write_text(yaml.safe_dump({"camera": LENS}), "utf-8")
    (folder / "broken.yaml").write_text("surfaces: 3", "utf-8")
    (tmp_path / "outside.yaml").write_text(source.read_text("utf-8"), "utf-8")
    (folder / "link.yaml").symlink_to(tmp_path / "outside.yaml")
    scene = load_scene(folder / "scene.yaml")
    assert [entry.name for entry in lens_entries(scene) if entry.kind == "file"] == ["mine.yaml"]
    dials = read_dials(scene)
    assert turn_dial(Panel(dials, scene, scene), "lens", "mine.yaml").changes["camera.lens"] == "mine.yaml"
    for name in ("link.yaml", "../outside.yaml", str(tmp_path / "outside.yaml"), "broken.yaml"):
        with pytest.raises(InputError, match="not one of the list"):
            turn_dial(Panel(dials, scene, scene), "lens", name)


def test_every_lens_file_of_a_full_folder_is_offered_and_what_is_too_much_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (Path(__file__).parents[2] / "lenses" / "biconvex.yaml").read_text("utf-8")
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump({"camera": LENS}), "utf-8")
    (tmp_path / "dangling.yaml").symlink_to("nowhere.yaml")
    for number in range(300):
        (tmp_path / f"a{number:03}.png").touch()
        (tmp_path / f"b{number:03}.yaml").write_text("materials: {}", "utf-8")
    (tmp_path / "z.yaml").write_text(text, "utf-8")
    scene = load_scene(tmp_path / "scene.yaml")
    assert [entry.name for entry in lens_entries(scene) if entry.kind == "file"] == ["z.yaml"]
    assert lens_choice.files_left_out(scene) == 0
    (tmp_path / "z.yaml").write_text("materials: {}", "utf-8")  # read again when it has changed
    assert "z.yaml" not in [entry.name for entry in lens_entries(scene)]
    monkeypatch.setattr(lens_choice, "MOST_FILES", 200)
    assert lens_choice.files_left_out(scene) == 102


def test_temperature_begins_at_daylight_or_at_the_light_that_was_chosen() -> None:
    assert Body().listed("temperature_k")["start"] == 6500
    for name, kelvin in KELVIN.items():
        x, y, z = xyz_from_spectrum(illuminant(name))
        n = (x / (x + y + z) - 0.3320) / (0.1858 - y / (x + y + z))
        assert kelvin == pytest.approx(449 * n**3 + 3525 * n**2 + 6823.3 * n + 5520.33, rel=0.01)  # McCamy 1992
        assert Body().turn("white_balance", name).listed("temperature_k")["start"] == kelvin


def test_wheel_zooms_a_zoom_widens_a_pinhole_and_crops_a_prime() -> None:
    zoom = Body(LENS | {"lens": "zoom-70-200mm"})
    thin, pinhole, prime = (Body(name) for name in ("thin", "pinhole", "traced"))
    assert [wheel(body.scene)["does"] for body in (zoom, thin, pinhole, prime)] == ["zoom", "angle", "angle", "crop"]
    for body in (zoom, thin, pinhole, prime):
        start, size = body.listed("zoom")["value"], body.scene.film.size_m()
        for clicks, factor in ((4, 1.03**4), (-4, 1.0)):
            turned = zoom_by(Panel(body.dials, body.scene, body.resolved), clicks)
            body.take(turned.dials, turned.changes, turned.messages)
            assert body.listed("zoom")["value"] == pytest.approx(start * factor, rel=1e-5)
        assert body.scene.film.size_m() == pytest.approx(size, rel=1e-12)
    turned = zoom_by(Panel(prime.dials, prime.scene, prime.resolved), -1)
    assert turned.changes == {} and turned.messages


def test_crop_of_a_prime_outlives_other_changes() -> None:
    body = Body().turn("zoom", 100)
    again = read_dials(body.scene, body.dials)
    assert again.whole_mm == pytest.approx((36, 24))
    body.dials = again
    assert body.listed("zoom")["text"].endswith("× crop")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("nothing", 1), ("mode", "Q"), ("mode", 3), ("f_number", "4"), ("f_number", float("nan")), ("iso", None),
        ("ev", float("inf")), ("auto_iso", 1), ("lock", "yes"), ("metering", "matrix"), ("focus_m", 0),
        ("focus_m", -1), ("zoom", True), ("lens", "no-such-lens"), ("lens", 4), ("stop", "image"), ("blades", 5.5),
        ("format", "vhs"), ("white_balance", "sunny"), ("white_balance", [1]), ("temperature_k", "warm"),
        ("tone", None),
    ],
)  # fmt: skip
def test_what_a_dial_cannot_be_is_refused(name: str, value: Any) -> None:
    body = Body("traced")
    with pytest.raises(InputError):
        turn_dial(Panel(body.dials, body.scene, body.resolved), name, value)


@pytest.mark.parametrize("camera", CAMERAS)
def test_list_has_every_dial_and_is_plain(camera: str) -> None:

    body = Body(camera)
    entries = dial_list(Panel(body.dials, body.scene, body.resolved))
    assert {entry["name"] for entry in entries} == set(DIALS)
    json.dumps(entries, allow_nan=False)
    for entry in entries:
        if entry["kind"] == "number" and entry["enabled"] and entry["value"] is not None:
            assert entry["min"] <= entry["value"] * (1 + 1e-9) and entry["value"] <= entry["max"] * (1 + 1e-9), entry[
                "name"
            ]
        if entry["kind"] == "choice":
            assert entry["value"] in [choice["value"] for choice in entry["choices"]]


SPHERE = {"kind": "environment", **POSE}
NO_STOP = LENS | {"lens": "biconvex"}


@pytest.mark.parametrize(
    ("camera", "before", "name", "value", "words"),
    [
        ("traced", {"mode": "S"}, "f_number", 8, "the f-number follows in S"),
        ("traced", {"mode": "P"}, "f_number", 8, "the f-number follows in P"),
        ("pinhole", {}, "f_number", 8, "the camera has no lens opening: choose M, A, S or P first"),
        ("traced", {"mode": "A"}, "shutter_s", 0.1, "the time follows in A"),
        ("traced", {"mode": "P"}, "shutter_s", 0.1, "the time follows in P"),
        ("traced", {}, "iso", 400, "values stand for radiance, whatever the ISO"),
        ("traced", {}, "auto_iso", True, "values stand for radiance, whatever the ISO"),
        ("traced", {"mode": "M", "auto_iso": True}, "iso", 400, "the ISO is automatic"),
        ("traced", {"mode": "M", "auto_iso": True}, "auto_iso", True, None),
        ("traced", {"mode": "M"}, "lock", True, "nothing follows the meter, so there is nothing to lock"),
        ("traced", {"mode": "M"}, "lock", False, None),
        ("traced", {"mode": "M"}, "mode", "M", None),
        ("pinhole", {}, "focus_m", 2, "everything is sharp through this camera"),
        (SPHERE, {}, "zoom", 50, "a camera that sees the whole sphere has nothing to zoom"),
        (NO_STOP, {}, "stop", "star", "this lens has no stop: its rims limit the light"),
        (NO_STOP, {}, "blades", 7, "this lens has no stop: its rims limit the light"),
        ("traced", {}, "lens", "dgauss-50mm", None),
    ],
)
def test_dial_that_has_nothing_to_turn_says_why_and_changes_nothing(
    camera: Any, before: dict[str, Any], name: str, value: Any, words: str | None
) -> None:
    body = Body(camera, film={"resolution": [48, 24]})
    for dial, setting in before.items():
        body.turn(dial, setting)
    turned = turn_dial(Panel(body.dials, body.scene, body.resolved, body.reading), name, value)
    assert (turned.changes, turned.dials) == ({}, body.dials)
    assert len(turned.messages) == (words is not None) and (words or "") in "".join(turned.messages)


def test_metering_is_that_of_the_scene_and_a_spot_goes_back_to_the_middle() -> None:
    body = Body().turn("mode", "A")
    body.dials = replace(body.turn("metering", "spot").dials, spot_at=(0.25, 0.75))
    body.turn("ev", 1)
    assert (body.scene.exposure.metering, body.scene.exposure.spot_at) == ("spot", (0.25, 0.75))
    body.turn("metering", "average")
    assert (body.scene.exposure.metering, body.dials.spot_at) == ("average", (0.5, 0.5))


@pytest.mark.parametrize("ev", [0, 1.5])
@pytest.mark.parametrize("mode", ["A", "S", "P"])
def test_lock_before_the_meter_has_read_holds_the_exposure_as_it_stands(mode: str, ev: float) -> None:
    body = Body(exposure={"mode": "relative", "neutral_density_stops": 1}).turn("mode", mode).turn("ev", ev)
    turned = turn_dial(Panel(body.dials, body.scene, body.resolved, None), "lock", True)
    assert turned.dials.locked_cd_m2 == pytest.approx(body.reading, rel=1e-3)
    before = body.value
    body.take(turned.dials, turned.changes, turned.messages)
    assert body.value == pytest.approx(before, rel=1e-3)
    body.reading *= 4
    assert body.turn("ev", ev).value == pytest.approx(4 * before, rel=1e-3)  # it holds in other light


def test_blades_keep_the_form_of_the_stop() -> None:
    own = {"shape": "polygon", "blades": 5, "curvature": 0.2, "rotation_degrees": 10}
    body = Body(LENS | {"aperture": own}).turn("blades", 9)
    assert body.data["camera"]["aperture"] == own | {"blades": 9}
    assert body.turn("blades", 0).data["camera"]["aperture"] == {"shape": "circle"}
    assert body.turn("stop", "polygon").data["camera"]["aperture"] == {"shape": "polygon", "blades": 7}
    assert body.turn("stop", "star").data["camera"]["aperture"] == {"shape": "star"}
    with pytest.raises(InputError, match=r"^blades: must be a whole number .got 6\.5"):
        body.turn("blades", 6.5)


def test_zoom_to_a_smaller_opening_closes_the_stop_to_it() -> None:
    lens = LENS | {"lens": "zoom-35-51mm"}
    zoom = load_lens("zoom-35-51mm")
    states = [in_configuration(zoom, each.name) for each in zoom.configurations]
    ends = sorted((each.first_order().focal_length_mm, each.first_order().f_number) for each in states)
    (short, wide), (long, narrow) = ends[0], ends[-1]
    assert narrow > 1.01 * wide
    body = Body(lens | {"focal_length_mm": short * 1.0001, "f_number": wide * 1.001}).turn("zoom", long)
    assert body.scene.camera.f_number == pytest.approx(narrow, rel=2e-3)
    assert body.turn("zoom", short).scene.camera.f_number == pytest.approx(narrow, rel=2e-3)  # which stays
    assert body.turn("zoom", long * 2).messages == (f"it goes from {short:.4g} to {long:.4g} mm",)


def test_a_body_brings_its_sensor_and_its_speeds() -> None:
    body = Body("traced", exposure={"mode": "physical", "iso": 51200}, film={"resolution": [48, 32]})
    body.turn("body", "fujifilm_x_t3")
    assert body.scene.film.size_m() == pytest.approx((23.4e-3, 15.6e-3))  # the largest 3 to 2 on 23.5 x 15.6
    assert body.scene.exposure.iso == 12800
    assert body.messages == ("Fujifilm X-T3 has ISO 160 to 12800",)
    assert body.listed("body")["value"] == "fujifilm_x_t3"
    assert (body.listed("iso")["min"], body.listed("iso")["max"]) == pytest.approx((160, 12800), rel=0.02)
    assert body.turn("iso", 100).scene.exposure.iso == pytest.approx(160, rel=0.02)
    body.turn("format", "full_frame")
    assert body.listed("body")["value"] is None
    assert body.turn("iso", 100).scene.exposure.iso == 100


def test_the_meter_keeps_to_the_speeds_of_a_body() -> None:
    body = Body("traced", exposure={"mode": "auto"}, reading=1e-5)
    body.turn("body", "arri_alexa_mini").turn("auto_iso", True).turn("mode", "P")
    assert body.scene.exposure.iso == 3200
    with pytest.raises(InputError, match="body: is not one of"):
        body.turn("body", "a_box")


def test_kit_is_a_body_with_one_of_its_usual_lenses() -> None:
    body = Body().turn("mode", "M")
    assert body.listed("kit")["value"] is None
    body.turn("kit", "studio: tessar-102mm")
    assert (body.listed("body")["value"], body.listed("lens")["value"]) == ("hasselblad_x1d_ii", "tessar-102mm")
    assert body.listed("kit")["value"] == "studio: tessar-102mm"
    assert body.scene.film.size_m()[0] == pytest.approx(43.8e-3)
    assert body.scene.camera.f_number == pytest.approx(4.5, rel=1e-3)  # type: ignore[union-attr]
    body.turn("lens", "heliar-105mm")
    assert body.listed("kit")["value"] is None
    with pytest.raises(InputError, match="kit"):
        body.turn("kit", "studio")


@pytest.mark.parametrize("kit", fast(("cinema: retrofocus-35mm",), KITS))
def test_image_circle_of_a_lens_of_a_kit_covers_the_sensor(kit: str) -> None:
    name, lens = KITS[kit]
    camera = {"kind": "realistic", "lens": lens, "focus": {"distance_m": 20}, **POSE}
    scene = load_scene({"film": {"resolution": [36, 24], "width_mm": 54}, "camera": camera})
    radius = image_circle_mm(lens_state(scene, open_sessions(None)[0][0]))
    assert radius is None or radius >= math.hypot(*BODIES[name].sensor_mm) / 2
