"""What compilers for GPUs make of our kernels stays within limits; without a GPU, where the compilers are unpacked."""

import pytest

from benchmarks import gpu_tools
from benchmarks.gpu_compilers import LIMITS, TARGETS, beyond, compile_all, nvidia_warps, recorded, tool_of
from benchmarks.gpu_tools import missing
from rptcam_cl.core.files import kernels_dir

SCENES = (
    "A", "A_lens", "B", "C", "first_light", "materials", "panning", "lens", "meshes", "media", "hair", "many lamps",
    "ring", "layered fog", "smoke", "conjugates", "mixtures", "leaf", "lighthouse", "headlamps", "tea", "underwater",
    "everything",
)  # fmt: skip


def test_warps_follow_from_registers_as_in_nvidias_table():
    # CUDA's occupancy calculator: 65,536 registers, given out by 256 to a warp, and four schedulers
    assert [nvidia_warps(each, "sm_90") for each in (32, 40, 64, 80, 128, 255)] == [64, 48, 32, 24, 16, 8]
    assert nvidia_warps(32, "sm_89") == 48


def test_packages_come_from_the_mirror_of_the_system_over_https(tmp_path, monkeypatch):
    (tmp_path / "sources.list.d").mkdir()
    (tmp_path / "sources.list.d/debian.sources").write_text(
        "Types: deb\nURIs: http://mirror.example/debian/\nSuites: x\n"
    )
    monkeypatch.setattr(gpu_tools, "SOURCES", tmp_path)
    monkeypatch.delenv("DEBIAN_MIRROR", raising=False)
    assert gpu_tools.mirror.__wrapped__() == "https://mirror.example/debian"
    monkeypatch.setenv("DEBIAN_MIRROR", "https://other.example/debian")
    assert gpu_tools.mirror.__wrapped__() == "https://other.example/debian"
    monkeypatch.delenv("DEBIAN_MIRROR")
    (tmp_path / "sources.list.d/debian.sources").unlink()
    with pytest.raises(SystemExit, match="set DEBIAN_MIRROR"):
        gpu_tools.mirror.__wrapped__()


def test_kernels_of_renders_have_limits():
    named = {name.rpartition(": ")[2] for name in LIMITS}
    assert named == {path.stem for folder in ("pass", "build") for path in (kernels_dir() / folder).glob("*.cl")} - {
        "stream"
    }


@pytest.fixture(scope="module")
def programs():
    if all(missing(tool_of(target)[0]) for target in TARGETS):
        pytest.skip("no compiler for GPUs is unpacked (run: make gpu-tools)")
    return recorded(SCENES)


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS)
def test_kernels_stay_within_limits(target, programs):
    if why := missing(tool_of(target)[0]):
        pytest.skip(why)
    found, failures = compile_all(programs, [target])
    assert [each for each in failures if "cl_khr_fp64" not in each] == []  # dg2 has no float64
    assert {"intersect", "shade", "shadow", "subtree"} <= {kernel for _, kernel in found}
    assert beyond(found) == []
