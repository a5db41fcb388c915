"""What an installed package holds: the code, and exactly the kernels and lenses under version control."""

import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder

DATA = ("kernels/", "lenses/")


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
        "from rptcam_cl.optics import list_lenses, load_lens\n"
        "from rptcam_cl.resources import kernels_dir, lenses_dir\n"
        "assert list_lenses()\n"
        "print(kernels_dir(), lenses_dir(), sep='\\n')"
    )
    done = subprocess.run([sys.executable, "-I", "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    folders = [tmp_path.resolve() / "rptcam_cl" / "_data" / name for name in ("kernels", "lenses")]
    assert done.stdout.split() == [str(folder) for folder in folders]


def test_version_is_the_same_everywhere(wheel: Path) -> None:
    from rptcam_cl._version import __version__

    assert wheel.name == f"rptcam_cl-{__version__}-py3-none-any.whl"
