"""Scenes that are refused: each with the place, the key and the reason."""

import os
import re
import time
from pathlib import Path

import pytest

from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.scene.load import load_scene

from .conftest import EVERYTHING, SMALL, Load

HEAD = "camera: {kind: pinhole, eye: [0, 1, 5], target: [0, 1, 0], fov_degrees: 40}\n"
LAUGHS = "a: &a [x, x]\n" + "".join(f"{b}: &{b} [*{a}, *{a}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True))
MERGES = "a: &a {x: 1}\n" + "".join(f"{b}: &{b} {{<<: [*{a}, *{a}]}}\n" for a, b in zip("abcde", "bcdef", strict=True))

# (id, file content, what the message must match after the file's name)
FILES: list[tuple[str, str | bytes, str]] = [
    ("empty", "", r":1:1: .*is empty"),
    ("only comments", "# nothing\n", r":1:1: .*is empty"),
    ("null", "null\n", r":1:1: the scene is empty"),
    ("empty mapping", "{}\n", r":1:1: the scene is empty"),
    ("list", "[1, 2]\n", r":1:1: a scene must be a mapping \(got \[1, 2\]"),
    ("text", "hello\n", r":1:1: a scene must be a mapping \(got 'hello'"),
    ("tab", "camera:\n\tkind: pinhole\n", r":2:1: a tab"),
    ("two documents", HEAD + "---\nfilm: {}\n", r":2:1: a second document"),
    ("invalid UTF-8", b"camera: \xff\n", r":1:9: invalid UTF-8 at byte 8"),
    ("NUL", b"camera: \x00\n", r":1:9: contains a NUL"),
    ("UTF-16", (HEAD).encode("utf-16"), r":1:1: is UTF-16"),
    ("duplicate key", HEAD + "camera: 1\n", r":2:1: camera: duplicate key \(first on line 1, again on line 2\)"),
    ("tag", "camera: !!python/object/apply:os.system [ls]\n", r":1:9: tags are not allowed"),
    ("alias cycle", "camera: &a [*a]\n", r":1:9: anchors are not allowed"),
    ("billion laughs", LAUGHS, r":1:4: anchors are not allowed"),
    ("merge bomb", MERGES, r":1:4: anchors are not allowed"),
    ("merge key", "camera:\n  <<: {kind: pinhole}\n", r":2:3: merge keys"),
    ("nested too deep", "a: " + "[" * 1000 + "]" * 1000 + "\n", r":1:\d+: nested deeper than 32 levels"),
    ("too long", "# " + "x" * 110_000 + "\n", r": is too large \(got \d+ bytes; allowed: at most 100000"),
    ("too many values", "a: [" + "0," * 20_000 + "]\n", r":1:\d+: more than 10000 values"),
    ("endless integer", HEAD.replace("40", "4" * 5000), r":1:\d+: a number of 5000 digits"),
    ("beyond float64", HEAD.replace("40", "1e400"), r":1:\d+: 1e400 is beyond the range"),
    ("word as key", HEAD + "1: 2\n", r":2:1: \[1\]: unknown key"),
]


@pytest.mark.parametrize(("content", "message"), [row[1:] for row in FILES], ids=[row[0] for row in FILES])
def test_file_is_refused_at_once(
    tmp_path: Path, content: str | bytes, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rptcam_cl.scene.load.LARGEST_FILE", 100_000)
    monkeypatch.setattr("rptcam_cl.scene.load.MOST_VALUES", 10_000)
    path = tmp_path / "scene.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    start = time.thread_time()
    with pytest.raises(InputError, match=f"^{re.escape(str(path))}{message}"):
        load_scene(path)
    assert time.thread_time() - start < 1.0


# Override of the scene that has everything, and what the message must say after the place; … stands for any text.
VALUES = [
    ("camera.aparture=1", "camera.aparture: unknown key"),
    ("film.width=24", "film.width: unknown key; did you mean width_mm?"),
    ("light=[]", "light: unknown key; did you mean lights?"),
    ("camera=null", "camera: is required but missing"),
    ("camera.eye=null", "camera.eye: is required but missing"),
    ("camera.kind=null", "camera.kind: is required but missing"),
    ("objects.0.shape=null", "objects[0].shape: is required but missing"),
    ("objects.0.material=null", "objects[0].material: is required but missing"),
    ("materials.floor.reflectance.kind=null", "reflectance.kind: is required but missing"),
    ("camera.focus.distance_m=inf", "distance_m: must be finite (for infinity write a length far beyond the scene"),
    ("objects.0.radius=big", "radius: is text, not a number (got 'big'; allowed: a number)"),
    ("objects.0.radius=1:30", "radius: is text, not a number (write plain decimal digits"),
    ("objects.0.radius='1.5'", "radius: is text, not a number (write plain decimal digits"),
    ("objects.0.radius=1_000", "radius: is text, not a number (write plain"),
    ("objects.0.radius=2020-01-01", "radius: is text, not a number"),
    ("objects.0.radius=true", "radius: must be a number (got true"),
    ("objects.0.radius=[1]", "radius: must be a number (got [1]"),
    ("camera.flip=on", "camera.flip: must be true or false (got 'on')"),
    ("camera.flip=1", "camera.flip: must be true or false (got 1)"),
    ("camera.eye=[0, 0]", "camera.eye: has 2 numbers instead of 3 (got [0, 0]"),
    ("camera.eye=3", "camera.eye: must be a point or vector"),
    ("camera.eye=[0, x, 0]", "camera.eye[1]: is text, not a number (got 'x'"),
    ("camera.eye=[0, .nan, 0]", "camera.eye[1]: must be finite (got .nan"),
    ("camera.focus.distance_m=.inf", "distance_m: must be finite (got .inf"),
    ("picture.ev=-.inf", "picture.ev: must be finite (got -.inf"),
    ("objects.0.radius=1e39", "radius: is beyond the range of float32 (got 1e+39"),
    ("objects.0.radius=1e-60", "radius: is below the range of float32 (got 1e-60"),
    ("film=[1]", "film: must be a mapping (got [1]"),
    ("objects={a: 1}", "objects: must be a list (got a mapping with a)"),
    ("materials=[1]", "materials: must be a mapping"),
    ("materials={1: {kind: mirror}}", "materials: must be text (got 1)"),
    ("objects.0=3", "objects[0]: must be a mapping (got 3"),
    ("film.resolution=[0, 360]", "film.resolution[0]: is out of range (got 0; allowed: at least 1)"),
    ("film.resolution=[640, -1]", "film.resolution[1]: is out of range (got -1"),
    ("film.resolution=[1.5, 360]", "film.resolution[0]: must be a whole number (got 1.5"),
    ("film.resolution=[1000000, 1000000]", "1000000 x 1000000 pixels would need a film of 1.6e+04 GB"),
    ("film.resolution=[65536, 32768]", "film.resolution: …allowed: fewer than 2^31 pixels"),
    ("film={width_mm: 36, diagonal_mm: 43}", "film.diagonal_mm: cannot be given together with width_mm"),
    ("film.size_mm=[0, 24]", "film.size_mm[0]: is out of range"),
    ("film.crop=[0.5, 0.25, 0, 1]", "film.crop: has no area"),
    ("film.crop=[0, 1.5, 0, 1]", "film.crop[1]: is out of range (got 1.5; allowed: at most 1)"),
    ("render.spp=0", "render.spp: is out of range (got 0; allowed: at least 1)"),
    ("render.spp=-1", "render.spp: is out of range"),
    ("render.spp=4294967296", "render.spp: is out of range (…allowed: at most 4294967295)"),
    ("render.seed=-1", "render.seed: is out of range"),
    ("render.seed=18446744073709551616", "render.seed: …at most 18446744073709551615"),
    ("render.max_depth=0", "render.max_depth: is out of range"),
    ("render.max_depth=-1", "render.max_depth: is out of range"),
    ("render.max_depth=1000000000", "render.max_depth: …at most 1000000)"),
    ("picture.ev=.nan", "picture.ev: must be finite"),
    ("exposure=irradience", "exposure: is not a known choice; did you mean irradiance?"),
    ("metres_per_unit=0", "metres_per_unit: is out of range"),
    ("metres_per_unit=-1", "metres_per_unit: is out of range"),
    ("camera.up=[0, 19, -4.6]", "camera.up: is parallel to the viewing direction"),
    ("camera.up=[0, 0, 0]", "camera.up: must not be the zero vector"),
    ("camera.target=[0, -9.5, 3.2]", "camera.target: equals the eye"),
    ('picture.bits="8"', "picture.bits: is text, not a number (write it without quotes) (got '8'; allowed: 8, 16)"),
    ("camera.kind=pinehole", "camera.kind: is not a known choice; did you mean pinhole?"),
    ("camera.f_number=0", "camera.f_number: is out of range"),
    ("camera.f_number=-4", "camera.f_number: is out of range"),
    ("camera.stop_diameter_mm=0", "camera.stop_diameter_mm: is out of range"),
    ("camera.focus={}", "camera.focus: needs one of distance_m | front_distance_m | point | object | film_distance_mm"),
    ("camera.focus={distance_m: 1, point: [0, 0, 1]}", "camera.focus.point: cannot be given together with distance_m"),
    ("camera.focus={front_distance_m: 0}", "camera.focus.front_distance_m: is out of range"),
    ("camera.focus={point: [0, 0]}", "camera.focus.point: has 2 numbers instead of 3"),
    ("camera.focus={point: [0, -20, 0]}", "camera.focus.point: does not lie in front of the film"),
    ("camera.focus={point: [5, -9.5, 3.2]}", "camera.focus.point: does not lie in front of the film"),
    ("camera.focus.method=best", "camera.focus.method: …allowed: thick, spot"),
    ("camera.focus={film_distance_mm: 36, method: spot}", "camera.focus.method: seeks the film distance"),
    ("camera.focus={distance_m: 5, field: [0.5, 0.5]}", "camera.focus.field: says where the spot is least"),
    ("camera.focus={distance_m: 5, method: spot, field: [0.5, 1.5]}", "camera.focus.field[1]: is out of range"),
    ("camera.zoom=85", "camera.zoom: must be text (got 85)"),
    ("camera.focal_length_mm=0", "camera.focal_length_mm: is out of range"),
    ("camera.focus={distance_m: 1, film_distance_mm: 50}", "film_distance_mm: cannot be given together"),
    ("camera.focus.distance_m=-1", "camera.focus.distance_m: is out of range"),
    ("camera.wavelength_nm=1", "camera.wavelength_nm: is out of range"),
    ("camera.pupil=front", "camera.pupil: …allowed: auto, rear, thick, bounds, tight"),
    ("camera.lens=50", "camera.lens: must be a lens"),
    ("camera.lens=''", "camera.lens: is not a name or file"),
    ("camera.lens={surfaces: [{radius: .nan}]}", "camera.lens.surfaces[0].radius: must be finite"),
    ("camera.lens=own.yaml", "camera.lens: no such file"),
    ("camera.lens=../../etc/passwd", "camera.lens: lies outside the scene's folder"),
    ("camera.lens=/etc/passwd", "camera.lens: lies outside the scene's folder"),
    ("camera.lens=/dev/zero", "camera.lens: lies outside the scene's folder"),
    ("camera.lens=http://example.org/lens.yaml", "camera.lens: no such file"),
    ("camera.lens=./", "camera.lens: is not a regular file"),
    ("objects.0.radius=0", "objects[0].radius: is out of range"),
    ("objects.0.radius=-1", "objects[0].radius: is out of range"),
    ("objects.0.radius=1e13", "objects[0].radius: …allowed: at most 1e+12"),
    ("objects.0.transform=[{scale: 1e9}, {scale: 1e9}]", "transform: stretches or shifts too far"),
    ("objects.0.transform=[{translate: [1e12, 0, 0]}, {scale: 10}]", "transform: stretches or shifts"),
    (
        "objects.0={shape: sphere, center: [1e9, 0, 0], radius: 1, material: red, transform: {scale: 1e6}}",
        "objects[0]: reaches too far",
    ),
    (
        "objects.0={shape: sphere, center: [0, 0, 0], radius: 1e-9, material: red, transform: {scale: 1e-6}}",
        "objects[0]: is too small",
    ),
    ("objects.1.normal=[0, 0, 0]", "objects[1].normal: must not be the zero vector"),
    ("objects.2.edge_v=[1, 0, 0]", "objects[2].edge_v: is parallel to edge_u"),
    ("objects.3.max=[1, -2, 1]", "objects[3].max[1]: is not above min"),
    ("objects.3.max=[1, -1, 1]", "objects[3].max[1]: is not above min"),
    ("objects.4.top=[0, 0, 1]", "objects[4].top: equals base"),
    ("objects.5.apex=[0, 0, 0]", "objects[5].apex: equals base"),
    ("objects.0.shape=spere", "objects[0].shape: is not a known choice; did you mean sphere?"),
    ("objects.0.material=read", "objects[0].material: names no material; did you mean red?"),
    ("objects.0.material=3", "objects[0].material: must be a mapping"),
    ("materials.red.kind=mate", "materials.red.kind: …did you mean matte?"),
    ("materials.red.reflectance=1.5", "reflectance: would reflect more light than arrives (got 1.5"),
    ("materials.red.reflectance=[0, 0, 2]", "reflectance[2]: would reflect more light"),
    ("materials.red.reflectance=-0.1", "materials.red.reflectance: must not be negative"),
    ("materials.red.reflectance=[0, 0]", "reflectance: has 2 channels instead of 3"),
    ("materials.red.reflectance=crimson", "reflectance: must be a colour (got 'crimson'"),
    ("materials.red.reflectance='#fff'", "reflectance: must be a colour (got '#fff'"),
    ("materials.chrome.reflectance={kind: checker, even: 0, odd: 1}", "must be a colour"),
    ("materials.lamp.radiance={kind: checker, even: 0, odd: 2}", "odd: is above 1: a brighter pattern is an image"),
    ("materials.floor.reflectance.kind=chess", "reflectance.kind: …allowed: checker, grid"),
    ("materials.lines.reflectance.line_width=2", "line_width: is out of range"),
    ("materials.steel.alpha=0", "materials.steel.alpha: is out of range (got 0; allowed: at least 0.001)"),
    ("materials.glass.index=0", "materials.glass.index: is out of range"),
    ("materials.lamp.radiance=[1, -1, 1]", "materials.lamp.radiance[1]: must not be negative"),
    ("materials.lamp.radiance=.nan", "materials.lamp.radiance: must be finite"),
    ("materials.lamp.radiance=1e38", "materials.lamp.radiance: is too bright for sums in float32"),
    ("objects.3.transform={scale: [1, 0, 1]}", "transform.scale: cannot be inverted"),
    ("objects.3.transform={matrix: [[1, 0, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0]]}", "matrix: cannot be"),
    ("objects.3.transform={matrix: [[.nan, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}", "must be finite"),
    ("objects.3.transform={matrix: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,1,1]]}", "matrix[3]: is not affine"),
    ("objects.3.transform={matrix: [[1, 0, 0, 0], [0, 1, 0, 0]]}", "transform.matrix: must be 3 or 4 rows"),
    ("objects.3.transform={scale: 2, translate: [1, 0, 0]}", "translate: cannot be given together with scale"),
    ("objects.3.transform=[{}]", "transform[0]: needs one of scale | rotate | translate | matrix"),
    ("objects.3.transform.1.rotate.axis=[0, 0, 0]", "axis: must not be the zero vector"),
    ("objects.3.transform=[" + "{scale: 2}," * 101 + "]", "transform: is too long"),
    ("objects.3.name=" + "x" * 201, "objects[3].name: is too long…at most 200 letters"),
    ("lights.0.kind=tube", "lights[0].kind: …allowed: point, directional, spot, ies, sun"),
    ("lights.0.intensity=-1", "lights[0].intensity: must not be negative"),
    ("lights.1.direction=[0, 0, 0]", "lights[1].direction: must not be the zero vector"),
    ("environment.kind=dome", "environment.kind: …allowed: constant, gradient, image, sky"),
]


def says(message: str) -> str:
    """Return the regular expression of a message that is written with … for any text."""
    return ".*".join(re.escape(part) for part in message.split("…"))


@pytest.mark.parametrize(("override", "message"), VALUES, ids=[row[0][:60] for row in VALUES])
def test_value_is_refused(load: Load, override: str, message: str) -> None:
    with pytest.raises(InputError, match=f"^--set {re.escape(override)}: .*{says(message)}") as caught:
        load(EVERYTHING, override)
    assert "\n" not in str(caught.value)


# Keys of a camera that stands well, and what the message must say.
THIN = "kind: thin_lens, f_number: 2, fov_degrees: 40"
THICK = "kind: thick_lens, lens: dgauss-50mm, focus: {distance_m: 5}"
OPEN = f"{THIN}, focus_distance_m: 3, aperture:"
CAMERAS = [
    ("kind: pinhole, fov_degrees: 0", "fov_degrees: is out of range (got 0; allowed: more than 0)"),
    ("kind: pinhole, fov_degrees: 180", "fov_degrees: is out of range (got 180; allowed: less than 180)"),
    ("kind: pinhole, fov_degrees: 270", "fov_degrees: is out of range"),
    ("kind: pinhole", "camera.fov_degrees: is required but missing"),
    ("kind: pinhole, fov_degrees: 40, fov_axis: vertcal", "did you mean vertical?"),
    ("kind: pinhole, fov_degrees: 40, near_m: -1", "near_m: is out of range"),
    ("kind: environment", "film.resolution: does not fit an environment camera…[720, 360]"),
    ("kind: thin_lens, fov_degrees: 40, focus_distance_m: 3", "needs one of aperture_radius_m | f_number"),
    (
        "kind: thin_lens, fov_degrees: 40, focus_distance_m: 3, aperture_radius_m: 1, f_number: 2",
        "camera.f_number: cannot be given together with aperture_radius_m …exactly one of",
    ),
    ("kind: thin_lens, f_number: 2, focus_distance_m: 3", "needs one of fov_degrees | focal_length_mm"),
    (THIN, "camera: needs one of focus_distance_m | focus"),
    (
        "kind: thin_lens, f_number: 2, focal_length_mm: 50, focus_distance_m: 0.05",
        "focus_distance_m: lies within the focal length…allowed: more than 0.05",
    ),
    (
        f"{OPEN} {{shape: polygon, blades: 1}}",
        "aperture.blades: is out of range (got 1; allowed: at least 3)",
    ),
    (
        f"{OPEN} {{shape: polygon, blades: 1000000}}",
        "aperture.blades: …allowed: at most 64",
    ),
    (
        f"{OPEN} {{shape: square}}",
        "aperture.shape: …allowed: circle, polygon, star, heart, outline, image",
    ),
    ("kind: pinhole, fov_degrees: 40, f_number: 4", "camera.f_number: unknown key"),
    ("kind: thick_lens, focus: {distance_m: 5}", "camera.lens: is required"),
    ("kind: thick_lens, lens: dgauss-50mm", "camera.focus: is required"),
    (f"{THICK}, f_number: 2, stop_diameter_mm: 9", "camera.f_number: cannot be given together with stop_diameter_mm"),
    (f"{THICK}, zoom: tele, focal_length_mm: 85", "camera.focal_length_mm: cannot be given together with zoom"),
    (f"{THICK}, pupil: rear", "camera.pupil: unknown key"),
]


@pytest.mark.parametrize(("keys", "message"), CAMERAS, ids=[row[0][:60] for row in CAMERAS])
def test_camera_is_refused(load: Load, keys: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"scene\.yaml:1:\d+: .*{says(message)}"):
        load(f"camera: {{eye: [0, 1, 5], target: [0, 1, 0], {keys}}}\n")


def test_error_points_at_the_value(load: Load) -> None:
    with pytest.raises(InputError, match=r"scene\.yaml:3:61: objects\[0\]\.material: names no material \(got 'red'"):
        load(HEAD + "objects:\n  - {shape: sphere, center: [0, 1, 0], radius: 1, material: red}\n")


def test_unknown_key_is_pointed_at_itself(load: Load) -> None:
    with pytest.raises(InputError, match=r"scene\.yaml:4:5: objects\[0\]\.colour: unknown key"):
        load(HEAD + "objects:\n  - shape: sphere\n    colour: red\n")


def test_missing_key_points_at_what_lacks_it(load: Load) -> None:
    with pytest.raises(InputError, match=r"scene\.yaml:3:5: objects\[0\]\.center: is required but missing$") as caught:
        load(HEAD + "objects:\n  - {shape: sphere, radius: 1, material: {kind: mirror}}\n")
    assert "allowed" not in str(caught.value)


def test_several_problems_are_listed_together(load: Load) -> None:
    with pytest.raises(InputError) as caught:
        load(SMALL, *(f"render.{key}=-1" for key in ("spp", "seed", "max_depth", "roulette_depth")), "picture.ev=99",
             "environment.radiance=-1")  # fmt: skip
    lines = str(caught.value).splitlines()
    assert len(lines) == 6
    assert lines[-1] == "and 1 more problems"


def test_error_in_a_material_does_not_count_again_where_it_is_used(load: Load) -> None:
    with pytest.raises(InputError) as caught:
        load(EVERYTHING, "materials.red.reflectance=2", "objects.0.radius=-1")
    assert [line.split(": ")[1] for line in str(caught.value).splitlines()] == [
        "materials.red.reflectance", "objects[0].radius",
    ]  # fmt: skip


def test_mapping_from_python_is_checked_alike() -> None:
    with pytest.raises(InputError, match=r"^camera\.kind: is not a known choice; did you mean pinhole\?"):
        load_scene({"camera": {"kind": "pinhol"}})
    with pytest.raises(InputError, match="the scene is empty"):
        load_scene({})


def test_symbolic_link_does_not_lead_out_of_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    (tmp_path / "secret.yaml").write_text("")
    (folder / "lens.yaml").symlink_to(tmp_path / "secret.yaml")
    (folder / "scene.yaml").write_text(EVERYTHING.replace("double_gauss_50mm", "lens.yaml"))
    with pytest.raises(InputError, match="lies outside the scene's folder"):
        load_scene(folder / "scene.yaml")


def test_pipe_is_not_read(tmp_path: Path, load: Load) -> None:
    os.mkfifo(tmp_path / "lens.yaml")
    with pytest.raises(InputError, match=r"camera\.lens: is not a regular file"):
        load(EVERYTHING, "camera.lens=lens.yaml")
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(InputError, match="is not a regular file"):
        load_scene(tmp_path / "pipe.yaml")


def test_missing_scene_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(RptcamError, match=r"nowhere\.yaml: no such file"):
        load_scene(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize(
    ("name", "remedy"),
    [("my.glb", "rptcam new scene.yaml --model .*my.glb makes"), ("old.pbrt", "rptcam convert .*old.pbrt scene.yaml")],
)
def test_file_of_another_kind_is_refused_with_the_command_that_makes_a_scene_of_it(
    name: str, remedy: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(b"glTF\x02\x00\x80")
    with pytest.raises(InputError, match=f"{name}: is no scene file; {remedy}"):
        load_scene(tmp_path / name)
