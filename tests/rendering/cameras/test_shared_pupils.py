"""Tables of pupils that states of a lens share: they hold each pupil, waste few rays, follow from the state alone."""

from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.core.remember import forget
from rptcam_cl.optics.film_probe import FilmProbe, spread_points
from rptcam_cl.rendering.cameras import realistic
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.cameras.pupil import PupilSampling, left_out
from rptcam_cl.rendering.cameras.setting import film_frame, half_film_mm, lens_setting
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from tests.support.cases import slow

NM = 587.56
POSE = {"kind": "realistic", "eye": [0, 0, 3], "target": [0, 0, 0], "wavelength_nm": NM, "pupil": "shared"}


def scene_of(lens: str, width_mm: float, distance_m: float, **camera: Any) -> Scene:
    return load_scene({
        "film": {"resolution": [48, 32], "width_mm": width_mm},
        "camera": POSE | {"lens": lens, "focus": {"distance_m": distance_m}} | camera,
    })  # fmt: skip


def shared(scene: Scene) -> PupilSampling:
    found = realistic.shared_sampling(scene, lens_setting(scene), NM)
    assert found is not None and found.tier == "shared"
    return found


def lost_and_passing(scene: Scene, sampling: PupilSampling) -> tuple[float, float]:
    """Share of the passing rays that a table leaves out, and of those that it draws which pass."""
    setting = lens_setting(scene)
    radius = float(np.hypot(*film_frame(scene.camera).corners(half_film_mm(scene))[:, :2].T).max())
    film = np.stack([np.linspace(0.0, radius, 25), np.zeros(25)], axis=1)
    probe = FilmProbe(setting.lens, setting.film_distance_mm, NM)
    points = spread_points(probe.windows(film), 6000).reshape(-1, 2)
    film = np.repeat(film, 6000, axis=0)
    passes, out = probe.passes(film, points), left_out(sampling, (radius, radius), film, points)
    return float((passes & out).sum() / passes.sum()), float(passes[~out].mean())


@pytest.mark.parametrize(
    "lens, width_mm, nearest_m, method, traced",
    [
        ("dgauss-50mm", 36, 0.6, "thick", False),
        slow("dgauss-50mm", 36, 0.6, "spot", True),
        slow("retrofocus-35mm", 28, 0.5, "thick", False),
        slow("zoom-70-200mm", 30, 3, "thick", False),
        slow("double-gauss-50mm-f1.1", 28, 1, "thick", False),
        slow("double-gauss-50mm-f1.1", 36, 1, "thick", True),  # no chief ray comes from the corners
    ],
)
def test_a_cell_holds_the_pupils_of_all_its_states(
    lens: str, width_mm: float, nearest_m: float, method: str, traced: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    random = np.random.default_rng(3)
    base = scene_of(lens, width_mm, nearest_m, focus={"distance_m": nearest_m, "method": method})
    if not traced:
        monkeypatch.setattr(realistic, "shared_shapes", None)  # whatever traces a table fails
    widest = lens_setting(base).lens.first_order(NM).f_number
    for _ in range(2):
        number, vergence = widest * 2 ** random.uniform(0.02, 2), random.uniform(0.05, 1) / nearest_m
        scene = set_keys(base, {"camera.f_number": number, "camera.focus.distance_m": 1 / vergence})
        lost, passing = lost_and_passing(scene, shared(scene))
        assert lost < 3e-5
        assert passing > (0.83 if traced else 0.88)  # stops differ by 9 % of the area in a cell


@pytest.mark.slow
@pytest.mark.parametrize(
    "lens, lengths_mm, method",
    [
        ("zoom-70-200mm", (72.1, 193), "thick"),
        slow("zoom-70-200mm", (130, 140), "spot"),  # about the middle configuration
        slow("zoom-35-51mm", (35.1, 51), "thick"),
        slow("zoom-80-200mm", (80.1, 199), "thick"),
    ],
)
def test_a_cell_of_zoom_holds_the_pupils_of_all_its_states(
    lens: str, lengths_mm: tuple[float, float], method: str
) -> None:
    random = np.random.default_rng(5)
    base = scene_of(lens, 24, 5, focus={"distance_m": 5, "method": method}, focal_length_mm=lengths_mm[1])
    for _ in range(2):
        at = {
            "camera.focal_length_mm": random.uniform(*lengths_mm),
            "camera.focus.distance_m": 1 / random.uniform(0, 0.2),
        }
        opened = set_keys(base, at)
        number = lens_setting(opened).lens.first_order(NM).f_number * 2 ** random.uniform(0.02, 2)
        scene = set_keys(opened, {"camera.f_number": number})
        lost, passing = lost_and_passing(scene, shared(scene))
        assert lost < 3e-5
        assert passing > 0.8


@pytest.mark.slow
def test_focal_lengths_of_a_cell_have_one_table(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of("zoom-70-200mm", 24, 5, focal_length_mm=101.0, stop_diameter_mm=12.1)
    first = shared(scene)
    for trace in ("shared_shapes", "stopped_pupils"):
        monkeypatch.setattr(realistic, trace, None)  # whatever traces another table fails
    assert shared(set_keys(scene, {"camera.focal_length_mm": 103.0})).table is first.table
    with pytest.raises(TypeError):
        shared(set_keys(scene, {"camera.focal_length_mm": 106.0}))


@pytest.mark.slow
@pytest.mark.parametrize("lens", ["dgauss-50mm", slow("retrofocus-35mm")])
def test_a_film_that_is_shifted_has_the_table_of_a_larger_one(lens: str, monkeypatch: pytest.MonkeyPatch) -> None:
    base = scene_of(lens, 16, 4, f_number=4.1, movements={"rise_mm": 3.0, "shift_mm": -2.0})
    assert camera_model(base).metadata["pupil"] == "shared"
    found = shared(base)
    lost, passing = lost_and_passing(base, found)
    assert lost < 3e-5
    assert passing > 0.88
    for trace in ("shared_shapes", "stopped_pupils"):
        monkeypatch.setattr(realistic, trace, None)  # whatever traces another table fails
    near = set_keys(base, {"camera.movements.rise_mm": 2.9, "camera.movements.shift_mm": 2.1})
    assert shared(near).table is found.table


@pytest.mark.parametrize("method", ["thick", slow("spot")])
def test_states_of_a_cell_have_one_table_and_others_their_own(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of("dgauss-50mm", 30, 1.5, stop_diameter_mm=8.1, focus={"distance_m": 1.5, "method": method})
    first = shared(scene)
    for trace in ("shared_shapes", "stopped_pupils"):
        monkeypatch.setattr(realistic, trace, None)  # whatever traces another table fails
    beside = {"camera.stop_diameter_mm": 8.3, "camera.focus.distance_m": 1.52, "film.width_mm": 29.5}
    near = shared(set_keys(scene, beside))
    assert near.table is first.table
    assert near.parameters != first.parameters  # the film stands elsewhere
    for key, value in {"camera.focus.distance_m": 0.9, "film.width_mm": 20}.items():
        with pytest.raises(TypeError):
            shared(set_keys(scene, {key: value}))
    stopped = set_keys(scene, {"camera.stop_diameter_mm": 7.9})
    if method == "thick":  # the same rays say what another stop lets through
        assert not np.array_equal(shared(stopped).table, first.table)
    else:
        with pytest.raises(TypeError):
            shared(stopped)


def test_a_cell_is_the_same_from_disk_and_whatever_state_comes_first(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Any
) -> None:
    scene = scene_of("dgauss-50mm", 30, 1.5, stop_diameter_mm=8.1)
    other = set_keys(scene, {"camera.stop_diameter_mm": 8.3})
    found = []
    for place, order in (("one", (scene, other)), ("one", (scene,)), ("two", (other, scene))):
        monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / place))
        forget()
        tables = {id(each): camera_model(each) for each in order}
        found.append(tables[id(scene)])
    for model in found[1:]:
        np.testing.assert_array_equal(model.tables, found[0].tables)
        assert model.record.tobytes() == found[0].record.tobytes()
    forget()


@pytest.mark.slow
@pytest.mark.parametrize("colour", ["off", "on"])
def test_light_on_the_axis_is_that_of_a_state_with_its_own_table(colour: Any) -> None:
    scene = scene_of("retrofocus-35mm", 30, 1.5, stop_diameter_mm=8.1)
    own = camera_model(set_keys(scene, {"camera.pupil": "tight"}), lens_colour=colour)
    model = camera_model(scene, lens_colour=colour)
    assert model.metadata["pupil"] == "shared"
    assert model.on_axis_irradiance == pytest.approx(own.on_axis_irradiance, rel=1e-8)
    if colour == "on":
        assert model.axial_colour is not None and own.axial_colour is not None
        np.testing.assert_allclose(model.axial_colour[1], own.axial_colour[1], rtol=2e-8)


@pytest.mark.parametrize(
    "lens, camera",
    [
        pytest.param("anamorphic-100mm", {}, marks=pytest.mark.slow),
        slow("mirror-500mm", {}),
        ("dgauss-50mm", {"movements": {"tilt_degrees": 3}}),
        ("dgauss-50mm", {"focus": {"film_distance_mm": 20.0}}),
    ],
    ids=["not round", "mirrors", "tilted", "nowhere sharp"],
)
def test_what_shares_no_table_has_its_own(lens: str, camera: dict[str, Any]) -> None:
    scene = scene_of(lens, 20, 9.0, **camera)
    assert realistic.shared_sampling(scene, lens_setting(scene), NM) is None
    assert camera_model(scene).metadata["pupil"] == "tight"
