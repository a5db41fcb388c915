"""What an installed package holds: the code, and exactly the kernels and lenses under version control."""

import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder
from packaging.requirements import Requirement

from rptcam_cl.core.files import EXAMPLES, SCENES
from rptcam_cl.studies.selfcheck_suite import SPEED_SCENES

ONE_FILE = [f"examples/{name}.yaml" for name in EXAMPLES]
REFERENCE = (f"tests/data/reference/{name}.yaml" for name in SPEED_SCENES)
DATA = ("kernels/", "lenses/", *REFERENCE, *(f"examples/{file}" for files in SCENES.values() for file in files))


def wheel_of(root: Path, folder: Path) -> Path:
    return Path(next(WheelBuilder(str(root)).build(directory=str(folder), versions=["standard"])))


def contents(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return {name for name in archive.namelist() if ".dist-info/" not in name}


@pytest.fixture(scope="module")
def clone(checkout: Path, tracked: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tracked files as they are now, with rubbish beside them that is ignored."""
    root = tmp_path_factory.mktemp("clone")
    for name in tracked:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(checkout / name, root / name)
    for rubbish in ("kernels/__pycache__/old.pyc", "rptcam_cl/__pycache__/old.pyc", "out/picture.png"):
        (root / rubbish).parent.mkdir(parents=True, exist_ok=True)
        (root / rubbish).write_bytes(b"")
    return root


@pytest.fixture(scope="module")
def wheel(clone: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return wheel_of(clone, tmp_path_factory.mktemp("wheel"))


def test_wheel_holds_the_tracked_files_and_no_other(wheel: Path, tracked: list[str]) -> None:
    code = {name for name in tracked if name.startswith("rptcam_cl/")}
    data = {f"rptcam_cl/_data/{name}" for name in tracked if name.startswith(DATA)}
    assert contents(wheel) == code | data
    assert any(name.endswith(".cl") for name in data)
    assert any(name.startswith("rptcam_cl/_data/lenses/") for name in data)


@pytest.mark.slow
def test_wheel_made_from_the_source_distribution_is_the_same(clone: Path, wheel: Path, tmp_path: Path) -> None:
    archive = next(SdistBuilder(str(clone)).build(directory=str(tmp_path)))
    with tarfile.open(archive) as file:
        file.extractall(tmp_path, filter="data")
    (unpacked,) = (path for path in tmp_path.iterdir() if path.is_dir())
    assert contents(wheel_of(unpacked, tmp_path / "wheel")) == contents(wheel)


def test_installed_package_finds_its_kernels_and_lenses(wheel: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    program = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
        "from rptcam_cl.optics.library import list_lenses, load_lens\n"
        "from rptcam_cl.core.files import kernels_dir, lenses_dir\n"
        "assert list_lenses()\n"
        "print(kernels_dir(), lenses_dir(), sep='\\n')"
    )
    done = subprocess.run([sys.executable, "-I", "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    folders = [tmp_path.resolve() / "rptcam_cl" / "_data" / name for name in ("kernels", "lenses")]
    assert done.stdout.split() == [str(folder) for folder in folders]


def test_scenes_of_the_readme_are_in_the_wheel_and_need_nothing_beside_them(checkout: Path) -> None:
    readme = (checkout / "README.md").read_text("utf-8")
    assert set(re.findall(r"examples/\w+\.yaml", readme)) <= {*ONE_FILE}
    for name in ONE_FILE:
        assert not re.search(r"\.(ply|png|hdr|jpg|glb|csv)\b", (checkout / name).read_text("utf-8")), name


@pytest.mark.slow
def test_installed_package_renders_the_first_picture_anywhere(wheel: Path, tmp_path: Path) -> None:
    package, elsewhere = tmp_path / "package", tmp_path / "elsewhere"
    elsewhere.mkdir()
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(package)
    program = (
        f"import sys; sys.path.insert(0, {str(package)!r})\n"
        "from rptcam_cl.cli import main\n"
        "sys.exit(main(['demo', '--size', '32x18', '--spp', '1']))"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-c", program], cwd=elsewhere, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert [path.name for path in elsewhere.iterdir()] == ["first_light.png"]
    assert "wrote first_light.png: 32 x 18" in done.stderr


LINUX_X86 = {"sys_platform": "linux", "platform_machine": "x86_64"}
WINDOWS = {"sys_platform": "win32", "platform_machine": "AMD64"}
MAC_ARM = {"sys_platform": "darwin", "platform_machine": "arm64"}
MAC_X86 = {"sys_platform": "darwin", "platform_machine": "x86_64"}
LINUX_ARM = {"sys_platform": "linux", "platform_machine": "aarch64"}
INTEL = {"intel-opencl-rt", "intel-cmplr-lib-rt"}


@pytest.mark.parametrize(
    ("extra", "system", "brought"),
    [
        ("pocl", LINUX_X86, {"pyopencl[pocl]"}),
        ("pocl", WINDOWS, INTEL),
        ("pocl", MAC_ARM, set()),
        ("pocl", MAC_X86, set()),
        ("pocl", LINUX_ARM, set()),
        ("intel", LINUX_X86, INTEL),
        ("intel", WINDOWS, INTEL),
        ("intel", MAC_ARM, set()),
        ("intel", MAC_X86, set()),
        ("intel", LINUX_ARM, set()),
    ],
)
@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
def test_extras_ask_only_for_what_has_a_wheel_there(
    wheel: Path, extra: str, system: dict[str, str], brought: set[str], python: str
) -> None:
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        text = archive.read(name).decode()
    asked = [Requirement(line.partition(": ")[2]) for line in text.splitlines() if line.startswith("Requires-Dist")]
    there = {**system, "python_version": python, "extra": extra}
    wanted = {str(each).partition(";")[0] for each in asked if each.marker and each.marker.evaluate(there)}
    assert wanted == brought


def test_version_is_the_same_everywhere(wheel: Path) -> None:
    from rptcam_cl.core import __version__

    assert wheel.name == f"rptcam_cl-{__version__}-py3-none-any.whl"
