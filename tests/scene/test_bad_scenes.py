"""Scenes that are refused: each with the place, the key and the reason."""

import os
import re
import time
from pathlib import Path

import pytest

from rptcam_cl.errors import InputError, RptcamError
from rptcam_cl.scene import load_scene

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
    ("too long", "# " + "x" * 4_100_000 + "\n", r": has \d+ bytes \(at most 4000000; put meshes"),
    ("too many values", "a: [" + "0," * 60_000 + "]\n", r":1:\d+: more than 50000 values"),
    ("endless integer", HEAD.replace("40", "4" * 5000), r":1:\d+: a number of 5000 digits"),
    ("beyond float64", HEAD.replace("40", "1e400"), r":1:\d+: 1e400 is beyond the range"),
    ("word as key", HEAD + "1: 2\n", r":2:1: \[1\]: unknown key"),
]


@pytest.mark.parametrize(("content", "message"), [row[1:] for row in FILES], ids=[row[0] for row in FILES])
def test_file_is_refused_at_once(tmp_path: Path, content: str | bytes, message: str) -> None:
    path = tmp_path / "scene.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    start = time.process_time()
    with pytest.raises(InputError, match=f"^{re.escape(str(path))}{message}"):
        load_scene(path)
    assert time.process_time() - start < 1.0


# (id, override of the scene that has everything, what the message must match after the place)
VALUES: list[tuple[str, str, str]] = [
    ("unknown key", "camera.aparture=1", r"camera\.aparture: unknown key"),
    ("unknown key, near", "film.width=24", r"film\.width: unknown key; did you mean width_mm\?"),
    ("unknown key at the top", "light=[]", r"light: unknown key; did you mean lights\?"),
    ("missing camera", "camera=null", r"camera: is required but missing"),
    ("missing eye", "camera.eye=null", r"camera\.eye: is required but missing"),
    ("missing kind", "camera.kind=null", r"camera\.kind: is required but missing"),
    ("missing shape", "objects.0.shape=null", r"objects\[0\]\.shape: is required but missing"),
    ("missing material", "objects.0.material=null", r"objects\[0\]\.material: is required but missing"),
    ("missing kind of texture", "materials.floor.reflectance.kind=null", r"reflectance\.kind: is required but missing"),
    ("word for number", "objects.0.radius=big", r"radius: is text, not a number \(got 'big'; allowed: a number\)"),
    ("sexagesimal", "objects.0.radius=1:30", r"radius: is text, not a number \(write plain decimal digits"),
    ("quoted number", "objects.0.radius='1.5'", r"radius: is text, not a number \(write plain decimal digits"),
    ("underscores", "objects.0.radius=1_000", r"radius: is text, not a number \(write plain"),
    ("date", "objects.0.radius=2020-01-01", r"radius: is text, not a number"),
    ("true for number", "objects.0.radius=true", r"radius: must be a number \(got true"),
    ("list for number", "objects.0.radius=[1]", r"radius: must be a number \(got \[1\]"),
    ("on for true", "camera.flip=on", r"camera\.flip: must be true or false \(got 'on'\)"),
    ("1 for true", "camera.flip=1", r"camera\.flip: must be true or false \(got 1\)"),
    ("two numbers for a point", "camera.eye=[0, 0]", r"camera\.eye: has 2 numbers instead of 3 \(got \[0, 0\]"),
    ("number for a point", "camera.eye=3", r"camera\.eye: must be a point or vector"),
    ("word in a point", "camera.eye=[0, x, 0]", r"camera\.eye\[1\]: is text, not a number \(got 'x'"),
    ("not a number", "camera.eye=[0, .nan, 0]", r"camera\.eye\[1\]: must be finite \(got \.nan"),
    ("infinite", "camera.focus.distance_m=.inf", r"distance_m: must be finite \(got \.inf"),
    ("minus infinity", "picture.ev=-.inf", r"picture\.ev: must be finite \(got -\.inf"),
    ("beyond float32", "objects.0.radius=1e39", r"radius: is beyond the range of float32 \(got 1e\+39"),
    ("below float32", "objects.0.radius=1e-60", r"radius: is below the range of float32 \(got 1e-60"),
    ("list for mapping", "film=[1]", r"film: must be a mapping \(got \[1\]"),
    ("mapping for list", "objects={a: 1}", r"objects: must be a list \(got a mapping with a\)"),
    ("list for materials", "materials=[1]", r"materials: must be a mapping"),
    ("number as a name", "materials={1: {kind: mirror}}", r"materials: must be text \(got 1\)"),
    ("number for an object", "objects.0=3", r"objects\[0\]: must be a mapping \(got 3"),
    ("no width", "film.resolution=[0, 360]", r"film\.resolution\[0\]: is out of range \(got 0; allowed: at least 1\)"),
    ("negative height", "film.resolution=[640, -1]", r"film\.resolution\[1\]: is out of range \(got -1"),
    ("half a pixel", "film.resolution=[1.5, 360]", r"film\.resolution\[0\]: must be a whole number \(got 1\.5"),
    ("too many pixels", "film.resolution=[1000000, 1000000]", r"1000000 x 1000000 pixels would need a film of 1\.6e\+04 GB"),
    ("2^31 pixels", "film.resolution=[65536, 32768]", r"film\.resolution: .*allowed: fewer than 2\^31 pixels"),
    ("two film sizes", "film={width_mm: 36, diagonal_mm: 43}", r"film\.diagonal_mm: cannot be given together with width_mm"),
    ("film without size", "film.size_mm=[0, 24]", r"film\.size_mm\[0\]: is out of range"),
    ("crop reversed", "film.crop=[0.5, 0.25, 0, 1]", r"film\.crop: has no area"),
    ("crop outside", "film.crop=[0, 1.5, 0, 1]", r"film\.crop\[1\]: is out of range \(got 1\.5; allowed: at most 1\)"),
    ("no samples", "render.spp=0", r"render\.spp: is out of range \(got 0; allowed: at least 1\)"),
    ("negative samples", "render.spp=-1", r"render\.spp: is out of range"),
    ("too many samples", "render.spp=4294967296", r"render\.spp: is out of range \(.*allowed: at most 4294967295\)"),
    ("negative seed", "render.seed=-1", r"render\.seed: is out of range"),
    ("too large a seed", "render.seed=18446744073709551616", r"render\.seed: .*at most 18446744073709551615"),
    ("no depth", "render.max_depth=0", r"render\.max_depth: is out of range"),
    ("negative depth", "render.max_depth=-1", r"render\.max_depth: is out of range"),
    ("too deep", "render.max_depth=1000000000", r"render\.max_depth: .*at most 1000000\)"),
    ("exposure not finite", "picture.ev=.nan", r"picture\.ev: must be finite"),
    ("unknown exposure", "exposure=irradience", r"exposure: is not a known choice; did you mean irradiance\?"),
    ("no scale", "metres_per_unit=0", r"metres_per_unit: is out of range"),
    ("negative scale", "metres_per_unit=-1", r"metres_per_unit: is out of range"),
    ("up along the view", "camera.up=[0, 19, -4.6]", r"camera\.up: is parallel to the viewing direction"),
    ("no up", "camera.up=[0, 0, 0]", r"camera\.up: must not be the zero vector"),
    ("eye on the target", "camera.target=[0, -9.5, 3.2]", r"camera\.target: equals the eye"),
    ("unknown camera", "camera.kind=pinehole", r"camera\.kind: is not a known choice; did you mean pinhole\?"),
    ("f-number 0", "camera.f_number=0", r"camera\.f_number: is out of range"),
    ("negative f-number", "camera.f_number=-4", r"camera\.f_number: is out of range"),
    ("no stop", "camera.stop_diameter_mm=0", r"camera\.stop_diameter_mm: is out of range"),
    ("focus nowhere", "camera.focus={}", r"camera\.focus: needs one of distance_m \| film_distance_mm"),
    ("focus twice", "camera.focus={distance_m: 1, film_distance_mm: 50}", r"film_distance_mm: cannot be given together"),
    ("focus behind", "camera.focus.distance_m=-1", r"camera\.focus\.distance_m: is out of range"),
    ("ultraviolet", "camera.wavelength_nm=1", r"camera\.wavelength_nm: is out of range"),
    ("unknown pupil", "camera.pupil=tight", r"camera\.pupil: .*allowed: auto, rear, bounds"),
    ("lens is a number", "camera.lens=50", r"camera\.lens: must be a lens"),
    ("lens is nothing", "camera.lens=''", r"camera\.lens: is not a name or file"),
    ("lens not finite", "camera.lens={surfaces: [{radius: .nan}]}", r"camera\.lens\.surfaces\[0\]\.radius: must be finite"),
    ("lens file missing", "camera.lens=own.yaml", r"camera\.lens: no such file"),
    ("lens file above", "camera.lens=../../etc/passwd", r"camera\.lens: lies outside the scene's folder"),
    ("lens file elsewhere", "camera.lens=/etc/passwd", r"camera\.lens: lies outside the scene's folder"),
    ("lens is a device", "camera.lens=/dev/zero", r"camera\.lens: lies outside the scene's folder"),
    ("lens is an address", "camera.lens=http://example.org/lens.yaml", r"camera\.lens: no such file"),
    ("lens is a folder", "camera.lens=./", r"camera\.lens: is not a regular file"),
    ("sphere without radius", "objects.0.radius=0", r"objects\[0\]\.radius: is out of range"),
    ("sphere inside out", "objects.0.radius=-1", r"objects\[0\]\.radius: is out of range"),
    ("sphere too large", "objects.0.radius=1e13", r"objects\[0\]\.radius: .*allowed: at most 1e\+12"),
    ("sphere made too large", "objects.0.transform=[{scale: 1e9}, {scale: 1e9}]", r"transform: stretches or shifts too far"),
    ("sphere made too far", "objects.0.transform=[{translate: [1e12, 0, 0]}, {scale: 10}]", r"transform: stretches or shifts"),
    ("coordinates too far", "objects.0={shape: sphere, center: [1e9, 0, 0], radius: 1, material: red, transform: "
     "{scale: 1e6}}", r"objects\[0\]: reaches too far"),
    ("too small", "objects.0={shape: sphere, center: [0, 0, 0], radius: 1e-9, material: red, transform: {scale: 1e-6}}",
     r"objects\[0\]: is too small"),
    ("disk without normal", "objects.1.normal=[0, 0, 0]", r"objects\[1\]\.normal: must not be the zero vector"),
    ("rectangle without area", "objects.2.edge_v=[1, 0, 0]", r"objects\[2\]\.edge_v: is parallel to edge_u"),
    ("box inside out", "objects.3.max=[1, -2, 1]", r"objects\[3\]\.max\[1\]: is not above min"),
    ("flat box", "objects.3.max=[1, -1, 1]", r"objects\[3\]\.max\[1\]: is not above min"),
    ("cylinder without height", "objects.4.top=[0, 0, 0]", r"objects\[4\]\.top: equals base"),
    ("cone without height", "objects.5.apex=[0, 0, 0]", r"objects\[5\]\.apex: equals base"),
    ("unknown shape", "objects.0.shape=spere", r"objects\[0\]\.shape: is not a known choice; did you mean sphere\?"),
    ("unknown material", "objects.0.material=read", r"objects\[0\]\.material: names no material; did you mean red\?"),
    ("material is a number", "objects.0.material=3", r"objects\[0\]\.material: must be a mapping"),
    ("unknown kind of material", "materials.red.kind=mate", r"materials\.red\.kind: .*did you mean matte\?"),
    ("too bright", "materials.red.reflectance=1.5", r"reflectance: would reflect more light than arrives \(got 1\.5"),
    ("too blue", "materials.red.reflectance=[0, 0, 2]", r"reflectance\[2\]: would reflect more light"),
    ("negative reflectance", "materials.red.reflectance=-0.1", r"materials\.red\.reflectance: must not be negative"),
    ("two channels", "materials.red.reflectance=[0, 0]", r"reflectance: has 2 channels instead of 3"),
    ("colour name", "materials.red.reflectance=crimson", r"reflectance: must be a colour \(got 'crimson'"),
    ("short colour", "materials.red.reflectance='#fff'", r"reflectance: must be a colour \(got '#fff'"),
    ("texture in a mirror", "materials.chrome.reflectance={kind: checker, even: 0, odd: 1}", r"must be a colour"),
    ("texture in a lamp", "materials.lamp.radiance={kind: checker, even: 0, odd: 1}", r"radiance: must be a colour"),
    ("unknown texture", "materials.floor.reflectance.kind=chess", r"reflectance\.kind: .*allowed: checker, grid"),
    ("line too wide", "materials.lines.reflectance.line_width=2", r"line_width: is out of range"),
    ("rough", "materials.steel.alpha=0", r"materials\.steel\.alpha: is out of range \(got 0; allowed: at least 0\.001\)"),
    ("index 0", "materials.glass.index=0", r"materials\.glass\.index: is out of range"),
    ("negative radiance", "materials.lamp.radiance=[1, -1, 1]", r"materials\.lamp\.radiance\[1\]: must not be negative"),
    ("radiance not a number", "materials.lamp.radiance=.nan", r"materials\.lamp\.radiance: must be finite"),
    ("blinding", "materials.lamp.radiance=1e38", r"materials\.lamp\.radiance: is too bright for sums in float32"),
    ("flattening scale", "objects.3.transform={scale: [1, 0, 1]}", r"transform\.scale: cannot be inverted"),
    ("singular matrix", "objects.3.transform={matrix: [[1, 0, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0]]}", r"matrix: cannot be"),
    ("matrix not a number", "objects.3.transform={matrix: [[.nan, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}", r"must be finite"),
    ("perspective", "objects.3.transform={matrix: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,1,1]]}", r"matrix\[3\]: is not affine"),
    ("two rows", "objects.3.transform={matrix: [[1, 0, 0, 0], [0, 1, 0, 0]]}", r"transform\.matrix: must be 3 or 4 rows"),
    ("step of two", "objects.3.transform={scale: 2, translate: [1, 0, 0]}", r"translate: cannot be given together with scale"),
    ("step of none", "objects.3.transform=[{}]", r"transform\[0\]: needs one of scale \| rotate \| translate \| matrix"),
    ("turn about nothing", "objects.3.transform.1.rotate.axis=[0, 0, 0]", r"axis: must not be the zero vector"),
    ("endless transform", "objects.3.transform=[" + "{scale: 2}," * 101 + "]", r"transform: is too long"),
    ("endless name", "objects.3.name=" + "x" * 201, r"objects\[3\]\.name: is too long .*at most 200 letters"),
    ("unknown light", "lights.0.kind=spot", r"lights\[0\]\.kind: .*allowed: point, directional"),
    ("negative light", "lights.0.intensity=-1", r"lights\[0\]\.intensity: must not be negative"),
    ("light from nowhere", "lights.1.direction=[0, 0, 0]", r"lights\[1\]\.direction: must not be the zero vector"),
    ("unknown environment", "environment.kind=sky", r"environment\.kind: .*allowed: constant, gradient"),
]  # fmt: skip


@pytest.mark.parametrize(("override", "message"), [row[1:] for row in VALUES], ids=[row[0] for row in VALUES])
def test_value_is_refused(load: Load, override: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"^--set {re.escape(override)}: .*{message}") as caught:
        load(EVERYTHING, override)
    assert "\n" not in str(caught.value)


CAMERAS: list[tuple[str, str, str]] = [
    ("fov 0", "kind: pinhole, fov_degrees: 0", r"fov_degrees: is out of range \(got 0; allowed: more than 0\)"),
    ("fov 180", "kind: pinhole, fov_degrees: 180", r"fov_degrees: is out of range \(got 180; allowed: less than 180\)"),
    ("fov 270", "kind: pinhole, fov_degrees: 270", r"fov_degrees: is out of range"),
    ("no fov", "kind: pinhole", r"camera\.fov_degrees: is required but missing"),
    ("unknown side", "kind: pinhole, fov_degrees: 40, fov_axis: vertcal", r"did you mean vertical\?"),
    ("near behind", "kind: pinhole, fov_degrees: 40, near_m: -1", r"near_m: is out of range"),
    ("not 2:1", "kind: environment", r"film\.resolution: does not fit an environment camera.*\[720, 360\]"),
    ("no opening", "kind: thin_lens, fov_degrees: 40, focus_distance_m: 3", r"needs one of aperture_radius_m \| f_number"),
    ("two openings", "kind: thin_lens, fov_degrees: 40, focus_distance_m: 3, aperture_radius_m: 1, f_number: 2",
     r"camera\.f_number: cannot be given together with aperture_radius_m .*exactly one of"),
    ("no field", "kind: thin_lens, f_number: 2, focus_distance_m: 3", r"needs one of fov_degrees \| focal_length_mm"),
    ("no focus", "kind: thin_lens, f_number: 2, fov_degrees: 40", r"camera\.focus_distance_m: is required"),
    ("within the focal length", "kind: thin_lens, f_number: 2, focal_length_mm: 50, focus_distance_m: 0.05",
     r"focus_distance_m: lies within the focal length.*allowed: more than 0\.05"),
    ("one blade", "kind: thin_lens, f_number: 2, fov_degrees: 40, focus_distance_m: 3, aperture: {shape: polygon, blades: 1}",
     r"aperture\.blades: is out of range \(got 1; allowed: at least 3\)"),
    ("a million blades", "kind: thin_lens, f_number: 2, fov_degrees: 40, focus_distance_m: 3, "
     "aperture: {shape: polygon, blades: 1000000}", r"aperture\.blades: .*allowed: at most 64"),
    ("heart", "kind: thin_lens, f_number: 2, fov_degrees: 40, focus_distance_m: 3, aperture: {shape: heart}",
     r"aperture\.shape: .*allowed: circle, polygon"),
    ("pinhole's f-number", "kind: pinhole, fov_degrees: 40, f_number: 4", r"camera\.f_number: unknown key"),
]  # fmt: skip


@pytest.mark.parametrize(("keys", "message"), [row[1:] for row in CAMERAS], ids=[row[0] for row in CAMERAS])
def test_camera_is_refused(load: Load, keys: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"scene\.yaml:1:\d+: .*{message}"):
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
