"""What a scene or a lens may read: files of its own folder, regular, of bearable size, and the hash covers them."""

import os
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.core.files import Folders, References, name_errors, open_regular, read_whole
from rptcam_cl.core.strict_yaml import FieldError
from rptcam_cl.optics.library import READERS, SUFFIXES, load_lens, names_a_file
from rptcam_cl.scene.load import load_scene

GLASS = "DATA:\n  - {{type: formula 5, wavelength_range: 0.3 2.0, coefficients: {index}}}\n"
LENS = """
name: one
surfaces:
  - {{radius: 50, thickness: 4, glass: {glass}, diameter: 20, coating: {coating}}}
  - {{radius: -50, thickness: 5, diameter: 20, coating: bare}}
  - {{stop: true, diameter: 10}}
"""
ZEMAX = """MODE SEQ
UNIT MM
SURF 0
  TYPE STANDARD
  DISZ INFINITY
SURF 1
  TYPE STANDARD
  STOP
  CURV {curvature}
  DISZ 5
  GLAS N-BK7
  DIAM 10
SURF 2
  TYPE STANDARD
  CURV -0.02
  DISZ 50
  DIAM 10
SURF 3
  TYPE STANDARD
  DISZ 0
"""
NAMES = {
    "refractiveindex": "{{refractiveindex: {}}}",
    "catalogue": "{{catalogue: {}, name: X}}",
    "reflectance": "{{reflectance: {}}}",
}


def lens_text(glass: str = "N-BK7", coating: str = "bare") -> str:
    return LENS.format(glass=glass, coating=coating)


def naming(key: str, file: str) -> str:
    """A lens file that names a file."""
    value = NAMES[key].format(file)
    return lens_text(coating=value) if key == "reflectance" else lens_text(glass=value)


def scene_of(folder: Path, lens: Any) -> Any:
    camera = {"kind": "realistic", "lens": lens, "eye": [0, 0, 3], "target": [0, 0, 0], "focus": {"distance_m": 3}}
    return load_scene({"camera": camera}, base_dir=folder)


@pytest.fixture(params=sorted(NAMES))
def key(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A folder whose neighbours are not for it."""
    (tmp_path / "home").mkdir()
    (tmp_path / "outside.yml").write_text(GLASS.format(index=1.5))
    (tmp_path / "home" / "link.yml").symlink_to(tmp_path / "outside.yml")
    (tmp_path / "home" / "loop.yml").symlink_to("loop.yml")
    os.mkfifo(tmp_path / "home" / "pipe.yml")
    with (tmp_path / "home" / "huge.yml").open("wb") as file:
        file.truncate(1 << 40)  # takes no space
    return tmp_path / "home"


REFUSED = [
    ("../outside.yml", "lies outside the lens's folder"),
    ("/etc/passwd", "lies outside the lens's folder"),
    ("/dev/zero", "lies outside the lens's folder"),
    ("link.yml", "lies outside the lens's folder"),
    ("loop.yml", "is not a usable path|no such file"),
    ("pipe.yml", "is not a regular file"),
    (".", "is not a regular file"),
    ("huge.yml", "is too large"),
    ("none.yml", "no such file"),
]


@pytest.mark.parametrize(("file", "reason"), REFUSED)
def test_lens_reads_its_own_folder_only(home: Path, key: str, file: str, reason: str) -> None:
    (home / "lens.yaml").write_text(naming(key, file))
    with pytest.raises(InputError, match=f"{key}: ({reason})"):
        load_lens(home / "lens.yaml")


@pytest.mark.parametrize(("file", "reason"), REFUSED)
def test_lens_of_a_scene_reads_the_folder_of_the_scene_only(home: Path, key: str, file: str, reason: str) -> None:
    (home / "lens.yaml").write_text(naming(key, file))
    with pytest.raises(InputError, match=f"{key}: ({reason.replace('lens', 'scene')})"):
        scene_of(home, "lens.yaml").load_lens()


def test_lens_of_a_scene_may_name_a_neighbour_inside_the_folder_of_the_scene(home: Path) -> None:
    for name in ("lenses", "glass"):
        (home / name).mkdir()
    (home / "glass" / "g.yml").write_text(GLASS.format(index=1.5))
    (home / "lenses" / "lens.yaml").write_text(naming("refractiveindex", "../glass/g.yml"))
    scene_of(home, "lenses/lens.yaml").load_lens()
    with pytest.raises(InputError, match="lies outside"):
        load_lens(home / "lenses" / "lens.yaml")


def test_lens_written_in_a_scene_names_files_of_the_scene(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (home / "g.yml").write_text(GLASS.format(index=1.5))
    (home.parent / "g.yml").write_text(GLASS.format(index=1.9))
    monkeypatch.chdir(home.parent)
    rows = [{"radius": 50, "thickness": 4, "diameter": 20, "glass": {"refractiveindex": "g.yml"}}, {"diameter": 20}]
    lens = scene_of(home, {"name": "../x", "surfaces": rows}).load_lens()
    assert float(lens.surfaces[0].glass.index(550.0)) == pytest.approx(1.5)


def test_hash_covers_what_the_files_of_a_lens_say(tmp_path: Path, key: str) -> None:
    texts = {
        "refractiveindex": [GLASS.format(index=n) for n in (1.5, 1.7)],
        "catalogue": [f"NM X 2 0 1.5 60 0\nCD {b} 0.01 0 0 0 0\nLD 0.3 2.0\n" for b in (1.2, 1.3)],
        "reflectance": ["400,0.01\n700,0.01\n", "400,0.01\n700,0.02\n"],
    }
    (tmp_path / "lens.yaml").write_text(naming(key, "a.txt"))
    hashes = set()
    for text in texts[key] * 2:
        (tmp_path / "a.txt").write_text(text)
        scene = scene_of(tmp_path, "lens.yaml")
        assert scene.load_lens().surfaces
        hashes.add(scene.content_hash())
    assert len(hashes) == 2


@pytest.mark.parametrize("suffix", [".zmx", ".ZMX"])
def test_lens_of_another_program_lies_beside_the_scene(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "beside").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / f"mine{suffix}").write_text(ZEMAX.format(curvature=0.01))
    monkeypatch.chdir(tmp_path / "elsewhere")
    with pytest.raises(InputError, match=r"camera\.lens: no such file"):
        scene_of(tmp_path / "beside", f"mine{suffix}")
    hashes = []
    for curvature in (0.02, 0.03):
        (tmp_path / "beside" / f"mine{suffix}").write_text(ZEMAX.format(curvature=curvature))
        scene = scene_of(tmp_path / "beside", f"mine{suffix}")
        assert scene.load_lens().surfaces[0].curvature == pytest.approx(curvature)
        hashes.append(scene.content_hash())
    assert hashes[0] != hashes[1]


def test_name_without_a_suffix_is_never_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine").write_text(lens_text())
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"camera\.lens: mine: no such lens"):
        scene_of(tmp_path, "mine").load_lens()


def test_scene_and_library_know_the_same_lens_files() -> None:
    assert set(READERS) < set(SUFFIXES)
    for suffix in SUFFIXES:
        assert names_a_file(f"lens{suffix}")
        assert names_a_file(f"lens{suffix.upper()}")
    assert not names_a_file("double_gauss_50mm")


@pytest.mark.parametrize("read", [lambda path: read_whole(path, 10), lambda path: open_regular(path, 10).read()])
def test_reader_takes_regular_files_of_bearable_size_only(tmp_path: Path, read: Any) -> None:
    (tmp_path / "small").write_bytes(b"0123456789")
    assert read(tmp_path / "small") == b"0123456789"
    (tmp_path / "large").write_bytes(b"0123456789a")
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "large", tmp_path / "pipe", tmp_path, tmp_path / "none", Path("/dev/zero")):
        with pytest.raises(InputError):
            read(path)


def test_reader_does_not_follow_a_file_that_became_another(tmp_path: Path) -> None:
    files = References(Folders(tmp_path))
    (tmp_path / "a").write_bytes(b"one")
    assert files.read("a", 10) == (tmp_path.resolve() / "a", b"one")
    (tmp_path / "a").unlink()
    (tmp_path / "a").symlink_to("/etc/hostname")
    with pytest.raises(RptcamError, match="lies outside"):
        files.read("a", 1000)
    assert len(files.digests()) == 1


def test_error_that_gets_a_place_keeps_its_kind_and_what_it_holds() -> None:
    words = r"^frame 3: a\.yaml:1:2: x: must be above 0$"
    with pytest.raises(FieldError, match=words) as caught, name_errors("frame 3"):
        raise FieldError("a.yaml:1:2", ("x",), "must be above 0")
    assert caught.value.path == ("x",)
