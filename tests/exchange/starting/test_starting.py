"""Starting scenes: what they show fills two thirds of the frame, is sharp, lit and exposed, and lies in one folder."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.api.job import render
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import lenses_dir
from rptcam_cl.exchange.camera_models import view
from rptcam_cl.exchange.starting import CopiedFiles, Projection, frame_subject, starting_scene
from rptcam_cl.rendering.cameras.setting import lens_setting
from rptcam_cl.scene.assets.pictures import write_exr
from rptcam_cl.scene.load import load_scene
from tests.scene.assets.gltf_writer import GltfWriter, triangle
from tests.support.cases import slow

OCTAHEDRON = "\n".join(
    ["vt 0 0"]
    + [f"v {x} {y} {z}" for x, y, z in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))]
    + [
        f"f {a}/1 {b}/1 {c}/1"
        for a, b, c in ((1, 3, 5), (3, 2, 5), (2, 4, 5), (4, 1, 5), (3, 1, 6), (2, 3, 6), (4, 2, 6), (1, 4, 6))
    ]
)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    (tmp_path / "elsewhere").mkdir()
    path = tmp_path / "elsewhere" / "gem.obj"
    path.write_text("mtllib gem.mtl\nusemtl red\n" + OCTAHEDRON)
    (path.parent / "gem.mtl").write_text("newmtl red\nKd 0.5 0 0\nmap_Kd pictures/red.png\n")
    return path


@pytest.fixture
def home(tmp_path: Path) -> Path:
    folder = tmp_path / "home"
    folder.mkdir()
    return folder


@pytest.mark.parametrize("lens", ["dgauss-50mm", slow("fisheye-10mm")])
def test_model_fills_two_thirds_of_a_rendered_frame(model: Path, home: Path, lens: str) -> None:
    start = starting_scene(home, model, lens=lens)
    start.copies.write()
    scene = start.scene | {"environment": None, "render": {"spp": 4}, "exposure": "relative"}
    scene["materials"] = {"light": {"kind": "emissive", "radiance": 1, "two_sided": True}}
    scene["objects"] = [{"shape": "mesh", "file": "gem.obj", "material": "light"}]
    film = render(load_scene(scene, base_dir=home, missing="grey"), size=(96, 64), seed=1).pixels
    lit = np.argwhere(film[..., 1] > 0)
    height, width = (lit.max(axis=0) - lit.min(axis=0) + 1) / (64, 96)
    assert max(height, width) == pytest.approx(2 / 3, abs=0.03)  # a pixel is 1 / 64
    middle = (lit.max(axis=0) + lit.min(axis=0) + 1) / 2 / (64, 96)
    assert middle == pytest.approx([0.5, 0.5], abs=0.03)


@pytest.mark.parametrize(("lens", "away"), [("mirror-500mm", 5.0), ("cylinder-pair", 1.0), ("telephoto-400mm", 5.0)])
def test_lenses_that_go_by_first_order_are_framed_by_their_chief_rays(lens: str, away: float) -> None:
    camera = {"kind": "realistic", "lens": lens, "eye": [0, 0, 0], "target": [0, 0, -1], "focus": {"distance_m": away}}
    scene = load_scene({"camera": camera, "film": {"resolution": [960, 640], "diagonal_mm": 20}})
    film = Projection(lens_setting(scene), 1.0, 10.0).film_mm(np.array([[4e-3, 2e-3, 1.0]]) * away)[0]
    seen = view(scene)
    (direction,), _ = seen.directions([[480 + film[0] / 20 * 1153.7764, 320 - film[1] / 20 * 1153.7764]])
    depth = away - seen.pupil_ahead_mm * 1e-3
    np.testing.assert_allclose(direction[:2] / direction[2] * depth, [4e-3 * away, -2e-3 * away], rtol=3e-3)


def test_large_model_fills_two_thirds_through_a_lens_of_one_s_own(model: Path, home: Path, tmp_path: Path) -> None:
    """At first it is wider than the lens sees; far away a picture is f x / z high."""
    for name, lens in (("elsewhere/own.yaml", "own.yaml"), ("home/own.yaml", "own.yaml")):
        (tmp_path / name).write_text((lenses_dir() / "telephoto-400mm.yaml").read_text("utf-8"), "utf-8")
        start = starting_scene(home, model, lens=str(tmp_path / name), metres_per_unit=10.0)
        assert start.scene["camera"]["lens"] == lens
        assert (home / lens in start.copies.pending) == (name[0] == "e")
        eye, target, up = (np.array(start.scene["camera"][key]) for key in ("eye", "target", "up"))
        ahead = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(ahead, up) / np.linalg.norm(np.cross(ahead, up))
        seen = np.concatenate([np.eye(3), -np.eye(3)]) - eye
        image = 400 * np.stack([seen @ right, seen @ np.cross(right, ahead)], axis=1) / (seen @ ahead)[:, None]
        share = np.ptp(image, axis=0) / (36, 24)
        assert share.max() == pytest.approx(2 / 3, rel=0.01)
        assert np.abs(image.max(axis=0) + image.min(axis=0)).max() / 2 < 0.2
        assert "20 x 20 x 20 m; it fills 67% of the frame" in start.report[-1]


def test_files_of_one_name_from_two_folders_are_refused(tmp_path: Path, home: Path) -> None:
    for folder, content in (("a", "one"), ("b", "two"), ("c", "one")):
        (tmp_path / folder / "deep" / "er").mkdir(parents=True)
        (tmp_path / folder / "x.obj").write_text(content)
        (tmp_path / folder / "deep" / "er" / "y.png").write_text(content)
    copies = CopiedFiles(home)
    copies.add_companions(
        tmp_path / "a" / "x.obj", [tmp_path / "a" / "deep" / "er" / "y.png", tmp_path / "b" / "x.obj"]
    )
    assert copies.name_of(tmp_path / "a" / "x.obj") == copies.name_of(tmp_path / "a" / "x.obj") == "x.obj"
    with pytest.raises(InputError, match="have one name; copy them into"):
        copies.name_of(tmp_path / "b" / "x.obj")
    assert [path.relative_to(home).as_posix() for path in copies.write()] == ["deep/er/y.png", "x.obj"]
    assert (home / "deep" / "er" / "y.png").read_text() == "one"
    assert copies.write() == []
    assert CopiedFiles(home).name_of(home / "deep" / "er" / "y.png") == "deep/er/y.png"
    for wrong, problem in (("none.obj", "no such file"), ("a", "is not a regular file")):
        with pytest.raises(InputError, match=f"{wrong}: {problem}"):
            copies.name_of(tmp_path / wrong)


def test_lens_that_focuses_nowhere_frames_nothing() -> None:
    def refuse(view: object, depth: float) -> None:
        raise InputError(f"cannot focus at {depth:g}")

    with pytest.raises(InputError, match="cannot focus at"):
        frame_subject(np.eye(3), np.array([0, 0, 1.0]), np.array([0, 1.0, 0]), (36, 24), refuse, 1.0)  # type: ignore


def test_picture_of_light_is_taken_and_checked(model: Path, home: Path, tmp_path: Path) -> None:
    write_exr({"RGB": np.ones((2, 4, 3))}, tmp_path / "sky.exr")
    start = starting_scene(home, model, hdri=tmp_path / "sky.exr", up="z")
    assert start.scene["environment"] == {"kind": "image", "file": "sky.exr", "up": [0, 0, 1]}
    assert start.scene["exposure"] == {"mode": "auto"}
    assert [item["shape"] for item in start.scene["objects"]] == ["mesh"]
    (tmp_path / "bad.exr").write_text("no picture")
    with pytest.raises(InputError, match=r"bad\.exr: is not a picture"):
        starting_scene(home, model, hdri=tmp_path / "bad.exr")


def test_front_of_the_model_is_in_focus(model: Path, home: Path) -> None:
    start = starting_scene(home, model)
    setting = lens_setting(load_scene({"camera": start.scene["camera"], "film": start.scene["film"]}))
    eye, target = (np.array(start.scene["camera"][key]) for key in ("eye", "target"))
    ahead = (target - eye) / np.linalg.norm(target - eye)
    distance = setting.focus_distance_mm * 1e-3  # type: ignore[operator]
    assert np.abs(eye + distance * ahead).sum() == pytest.approx(1, abs=1e-4)  # the octahedron |x| + |y| + |z| = 1


def test_lens_that_sees_nearly_half_the_world_stands_outside_the_subject(home: Path) -> None:
    start = starting_scene(home, lens="paper-biconvex")
    eye, target = (np.array(start.scene["camera"][key]) for key in ("eye", "target"))
    balls = [ball for ball in start.scene["objects"] if ball["shape"] == "sphere"]
    assert all(np.linalg.norm(eye - ball["center"]) > 1.5 * ball["radius"] for ball in balls)
    assert eye[1] > 0.1  # above the floor and the middles of the balls
    assert np.abs(target - [0, 0.1, 0.04]).max() < 0.15  # half a ball and a bit; it was 0.2 off, beside them


def test_small_model_is_framed_as_near_as_the_lens_focuses(tmp_path: Path, home: Path) -> None:
    (tmp_path / "bead.obj").write_text(OCTAHEDRON)
    start = starting_scene(home, tmp_path / "bead.obj", lens="macro-55mm", metres_per_unit=1e-3)
    lens_setting(
        load_scene(start.scene | {"objects": [], "environment": None})
    )  # which is refused where it is too near
    assert start.scene["camera"]["focus"]["distance_m"] < 0.4


@pytest.mark.parametrize(
    ("scale", "unit", "said"),
    [
        (100, 1, "the model is 200 m long; if that is not its true size, say --metres-per-unit 0.001 (then 0.2 m) or"
                 " --metres-per-unit 0.01 (then 2 m)"),
        (1e-3, 1, "the model is 2 mm long; if that is not its true size, say --metres-per-unit 100 (then 0.2 m) or"
                  " --metres-per-unit 1000 (then 2 m)"),
        (1e7, 1e-3, "--metres-per-unit 1e-06 (then 20 m)"),
        (9, 1, ""), (1, 0.005, ""), (5, 1e-3, ""),
    ],
)  # fmt: skip
def test_unlikely_size_of_a_model_is_said_with_the_unit_that_mends_it(
    tmp_path: Path, home: Path, scale: float, unit: float, said: str
) -> None:
    corners = "".join(f"v {scale * x} {scale * y} 0\n" for x, y in ((-1, 0), (1, 0), (0, 1)))
    (tmp_path / "helmet.obj").write_text(corners + "f 1 2 3\n")
    report = starting_scene(home, tmp_path / "helmet.obj", metres_per_unit=unit).report
    hints = [line for line in report if line.startswith("hint: ")]
    assert len(hints) == bool(said)
    assert all(hint.endswith(said) for hint in hints)


def test_files_from_elsewhere_are_copied_and_others_are_not_replaced(model: Path, home: Path) -> None:
    start = starting_scene(home, model)
    assert {path.name for path in start.copies.write()} == {"gem.obj", "gem.mtl"}
    assert start.scene["objects"][0]["file"] == "gem.obj"
    assert any("red.png" in message and "grey" in message for message in start.report)
    starting_scene(home, model)  # the same files may lie there
    (home / "gem.mtl").write_text("newmtl red\n")
    with pytest.raises(InputError, match=r"a scene reads its own folder only, and another gem\.mtl is there already"):
        starting_scene(home, model)


def test_scene_without_model_or_picture_of_light_is_complete(home: Path) -> None:
    scene = load_scene(starting_scene(home).scene)
    assert len(scene.objects) == 5
    assert scene.exposure.mode == "auto"
    assert scene.warnings == ()


def world(kind: str) -> GltfWriter:
    """A triangle, a camera four metres before it, and a lamp at the camera."""
    writer = triangle()
    lamp = {
        "type": kind,
        "color": [1, 0.5, 0],
        "intensity": 683,
        "spot": {"outerConeAngle": 0.5, "innerConeAngle": 0.2},
    }
    writer.json |= {
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "aspectRatio": 1.25, "znear": 0.1}}],
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [lamp]}},
    }
    writer.json["nodes"] += [
        {"name": "shot", "camera": 0, "translation": [0.2, 0.2, 4]},
        {"rotation": [0, math.sqrt(0.5), 0, math.sqrt(0.5)], "extensions": {"KHR_lights_punctual": {"light": 0}}},
    ]
    writer.json["scenes"] = [{"nodes": [0, 1, 2]}]
    return writer


@pytest.mark.parametrize("lens", [None, "dgauss-50mm"])
def test_camera_of_a_gltf_file_is_taken(home: Path, lens: str | None) -> None:
    (home / "room.glb").write_bytes(world("spot").glb())
    scene = load_scene(starting_scene(home, home / "room.glb", lens=lens).scene, base_dir=home)
    assert scene.film.resolution == (960, 768)
    assert scene.camera.target == (0.2, 0.2, 0)
    if lens is None:
        assert scene.camera.eye == (0.2, 0.2, 4)
        assert scene.camera.fov_degrees == pytest.approx(math.degrees(0.5), rel=1e-5)
        assert scene.camera.focus_distance_m == pytest.approx(4)
    else:
        assert scene.camera.eye[2] > 4.04  # the film, behind the entrance pupil


@pytest.mark.parametrize(
    ("lens", "away", "degrees"),
    [("dgauss-50mm", 1.0, 17.0), ("telephoto-400mm", 8.0, 1.1), ("mirror-500mm", 10.0, 1.1)],
)
def test_perspective_of_a_gltf_camera_is_that_of_the_lens(home: Path, lens: str, away: float, degrees: float) -> None:
    """Chief rays from the upper and the lower edge of the picture, where the camera stands and what is in focus."""
    writer = world("spot")
    writer.json["nodes"][1]["translation"] = [0.2, 0.2, away]
    writer.json["cameras"][0]["perspective"]["yfov"] = math.radians(degrees)
    (home / "room.glb").write_bytes(writer.glb())
    scene = load_scene(starting_scene(home, home / "room.glb", lens=lens).scene, base_dir=home)
    seen = view(scene)
    assert seen.pose()[:3, 3] == pytest.approx([0.2, 0.2, away], abs=5e-5)  # six digits of metres are written
    assert seen.distance_m == pytest.approx(away, abs=5e-5)
    edges, _ = seen.directions([[480, 0], [480, 768]])
    below, above = np.degrees(np.arctan2(edges[:, 1], edges[:, 2]))[::-1]
    assert below - above == pytest.approx(degrees, rel=5e-3)  # distortion, which the first order does not have


def test_gltf_camera_that_is_too_near_for_its_lens_is_refused(home: Path) -> None:
    writer = world("spot")
    writer.json["nodes"][1]["translation"] = [0.2, 0.2, 0.1]
    (home / "room.glb").write_bytes(writer.glb())
    with pytest.raises(InputError, match=r"shot of the file: .* cannot focus at .*\(allowed: another lens, or --ref"):
        starting_scene(home, home / "room.glb", lens="dgauss-50mm")


@pytest.mark.parametrize("kind", ["spot", "point", "directional"])
def test_lamps_of_a_gltf_file_are_taken(home: Path, kind: str) -> None:
    (home / "room.glb").write_bytes(world(kind).glb())
    start = starting_scene(home, home / "room.glb")
    (light,) = load_scene(start.scene, base_dir=home).lights
    assert light.kind == kind
    amount = light.irradiance if kind == "directional" else light.intensity
    assert amount == (1, 0.5, 0)  # 683 lm are a watt
    if kind != "point":
        assert light.direction == pytest.approx((-1, 0, 0))  # -z, turned by 90 degrees about +y
    if kind == "spot":
        assert (light.inner_degrees, light.outer_degrees) == pytest.approx(
            tuple(map(math.degrees, (0.2, 0.5))), rel=1e-5
        )
    assert "environment" not in start.scene


@pytest.mark.parametrize("kind", ["spot", "point", "directional"])
def test_lamps_of_a_gltf_file_light_as_much_whatever_its_unit(home: Path, kind: str) -> None:
    """Candelas over the square of a distance in units, as the ball of radiance L and r units that shines alike."""
    (home / "room.glb").write_bytes(world(kind).glb())
    for unit in (1.0, 0.001, 30.0):
        start = starting_scene(home, home / "room.glb", metres_per_unit=unit)
        (light,) = load_scene(start.scene, base_dir=home).lights
        away, radius, radiance = 4.0, 0.01, 1 / (math.pi * 0.01**2)  # a ball whose light far away is 1 W/sr at 1 m
        ball = math.pi * (radius * unit) ** 2 * radiance / (away * unit) ** 2
        if kind == "directional":
            assert light.irradiance == (1, 0.5, 0)  # lux are those of the surface, at any size
        else:
            assert np.array(light.intensity) / (away * unit) ** 2 == pytest.approx(ball * np.array((1, 0.5, 0)))


@pytest.mark.parametrize("reframe", [False, True])
def test_scene_with_the_lamps_of_its_file_is_not_warned_of_them(reframe: bool, home: Path) -> None:
    (home / "room.glb").write_bytes(world("point").glb())
    written = starting_scene(home, home / "room.glb", reframe=reframe).scene
    assert load_scene(written, base_dir=home).warnings == ()
    sky = {"lights": [], "environment": {"kind": "constant", "radiance": 1}}
    (warning,) = load_scene(written | sky, base_dir=home).warnings
    assert warning.endswith("room.glb: glTF: lamps are left out of an object; `rptcam new` makes a scene with them")


def test_further_cameras_of_a_gltf_file_are_named_once(home: Path) -> None:
    writer = world("point")
    writer.json["nodes"].append({"name": "from above", "camera": 0, "translation": [0, 9, 0]})
    writer.json["scenes"][0]["nodes"].append(3)
    (home / "room.glb").write_bytes(writer.glb())
    start = starting_scene(home, home / "room.glb")
    assert start.report[0] == "other cameras of the file are left out: from above"
    assert load_scene(start.scene, base_dir=home).warnings == ()


def test_reframe_leaves_the_camera_of_the_file_out(home: Path) -> None:
    (home / "room.glb").write_bytes(world("point").glb())
    scene = starting_scene(home, home / "room.glb", reframe=True).scene
    assert scene["camera"]["kind"] == "realistic"
    assert scene["camera"]["eye"] != [0.2, 0.2, 4]


def test_camera_straight_above_the_model_has_a_studio(home: Path) -> None:
    writer = world("point")
    writer.json["nodes"][1] = {
        "camera": 0, "translation": [0.5, 4, 0], "rotation": [-math.sqrt(0.5), 0, 0, math.sqrt(0.5)],
    }  # fmt: skip
    del writer.json["nodes"][2], writer.json["extensions"]
    writer.json["scenes"] = [{"nodes": [0, 1]}]
    (home / "top.glb").write_bytes(writer.glb())
    scene = load_scene(starting_scene(home, home / "top.glb").scene, base_dir=home)
    assert [item.name for item in scene.objects] == ["model", "floor", "soft box"]


def test_gltf_without_indices_of_cameras_is_refused(home: Path) -> None:
    writer = world("point")
    writer.json["nodes"][1]["camera"] = 3
    (home / "room.gltf").write_text(writer.gltf())
    with pytest.raises(InputError, match=r"nodes\[1\]\.camera: must be a whole number in its range"):
        starting_scene(home, home / "room.gltf")
    assert json.loads((home / "room.gltf").read_text())["nodes"][1]["camera"] == 3


def test_model_is_framed_at_its_time(home: Path) -> None:
    writer = triangle()
    keys = {"input": writer.array([0, 1]), "output": writer.array([[0, 0, 0], [8, 0, 0]])}
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    writer.json["animations"] = [{"samplers": [keys], "channels": [channel]}]
    (home / "leaf.glb").write_bytes(writer.glb())
    rest, late = (starting_scene(home, home / "leaf.glb", time_s=time_s).scene for time_s in (None, 0.5))
    assert np.allclose(np.subtract(late["camera"]["eye"], rest["camera"]["eye"]), [4, 0, 0], atol=1e-4)
    assert late["objects"][0]["time_s"] == 0.5
    assert "time_s" not in rest["objects"][0]
    with pytest.raises(InputError, match="time_s: is a moment of a model"):
        starting_scene(home, time_s=0.5)
