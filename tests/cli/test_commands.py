import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.cli import COMMANDS, build_parser
from rptcam_cl.core.constants import __version__
from rptcam_cl.core.errors import DeviceError

Command = Callable[..., Any]

DEVICES = [
    {
        "id": "0:0", "name": "Quick", "platform": "Some", "type": "gpu", "compute_units": 132,
        "memory_bytes": 150 * 2**30, "fp64": True, "problem": None, "default": True,
    },
    {
        "id": "1:0", "name": "Slow", "platform": "Other", "type": "cpu", "compute_units": 2,
        "memory_bytes": 3 * 2**29, "fp64": False, "problem": None, "default": False,
    },
]  # fmt: skip


def shell(*words: str, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "rptcam_cl", *words], capture_output=True, text=True, check=False, **options
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["rendr"], "did you mean render"),
        (["frobnicate"], "rptcam: there is no command frobnicate; see rptcam --help"),
        (["lens", "lst"], "did you mean list"),
        (["devices", "--jsn"], "unknown argument --jsn; did you mean --json"),
        (["develop", "a.exr", "-o", "a.png", "--ev", "2"], "unknown argument --ev; see"),
        (["--verbose", "devices"], "unknown argument --verbose"),
        (["lens", "info"], "required: LENS"),
        (["lens", "info", "dgauss-50mm", "--f-number", "0"], "allowed a finite number above 0"),
        (["lens", "info", "dgauss-50mm", "--wavelength-nm", "red"], "got red"),
        *(
            (["lens", *words, "--wavelength-nm", given], f"--wavelength-nm: got {given}; allowed")
            for words in (["info", "ball"], ["vignette", "ball"], ["trace", "ball"], ["convert", "ball"])
            for given in ("5e-7", "400,500")
        ),
        (["my scene.yaml", "-o", "a.png"], "to render it: rptcam render 'my scene.yaml' -o OUT.png; see"),
        (["help", "rendr"], "there is no command rendr; did you mean render"),
        (["render", "--set"], "expected one argument"),
        (["demo", "first_lght"], "did you mean first_light"),
        (
            ["demo", "--spp", "many"],
            "demo: argument --spp: got many; allowed a whole number from 1 to 4294967295; see rptcam demo --help",
        ),
    ],
)
def test_misspelt_command_gets_exit_code_2_and_a_hint(rptcam: Command, words: list[str], message: str) -> None:
    run = rptcam(*words)
    assert run.code == 2
    assert run.out == ""
    assert run.err.startswith("error: rptcam")
    assert message in run.err


def test_devices_are_listed_with_the_default_marked(rptcam: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rptcam_cl.api.interface.devices", lambda: DEVICES)
    run = rptcam("devices")
    assert run.code == 0
    assert run.out.splitlines() == [
        "* 0:0   gpu  Quick (Some; 132 compute units, 150 GiB, fp64)",
        "  1:0   cpu  Slow (Other; 2 compute units, 1.5 GiB, fp32 only)",
    ]
    assert json.loads(rptcam("devices", "--json").out) == DEVICES


def test_missing_device_is_exit_code_3_with_the_remedy(rptcam: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise DeviceError("no OpenCL platform was found; install one")

    monkeypatch.setattr("rptcam_cl.api.interface.devices", fail)
    run = rptcam("devices", "--json")
    assert (run.code, run.out, run.err) == (3, "", "error: no OpenCL platform was found; install one\n")


def test_machine_without_opencl_platforms_gets_the_remedy(tmp_path: Path) -> None:
    program = (
        "import sys, pyopencl\n"
        "def none(): raise pyopencl.LogicError('clGetPlatformIDs failed: PLATFORM_NOT_FOUND_KHR')\n"
        "pyopencl.get_platforms = none\n"
        "from rptcam_cl.cli import main; sys.exit(main(['devices']))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert done.stderr.startswith("error: ")
    assert "rptcam_cl[pocl]" in done.stderr
    assert "Traceback" not in done.stderr


def test_schema_is_the_published_one(rptcam: Command, checkout: Path) -> None:
    run = rptcam("schema")
    assert run.code == 0
    assert run.out == (checkout / "docs" / "scene.schema.json").read_text("utf-8")


def test_every_lens_is_listed_by_name_and_title(rptcam: Command, checkout: Path) -> None:
    lines = rptcam("lens", "list").out.splitlines()
    assert [line.split()[0] for line in lines] == sorted(path.stem for path in (checkout / "lenses").glob("*.yaml"))
    assert all(len(line.split()) > 1 for line in lines)


def test_help_and_version_go_to_standard_output() -> None:
    for words in (["--help"], ["render", "--help"], ["lens", "info", "--help"], ["help"], ["help", "lens", "info"]):
        done = shell(*words)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.startswith("usage: rptcam")
    assert shell("--version").stdout == shell("-V").stdout == f"rptcam {__version__}\n"


@pytest.mark.parametrize("words", [[], ["lens"], ["lens", "design"], ["--debug"]])
def test_without_a_command_the_help_is_shown_as_an_error(rptcam: Command, words: list[str]) -> None:
    run = rptcam(*words)
    assert (run.code, run.out) == (2, "")
    assert run.err.startswith(f"usage: {' '.join(['rptcam', *words]).removesuffix(' --debug')} [-h]")
    assert "commands:\n  COMMAND\n" in run.err


def test_help_has_a_line_for_each_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    listed = build_parser().format_help().partition("  COMMAND\n")[2].splitlines()
    assert [line.split()[0] for line in listed] == list(COMMANDS)


def test_help_does_not_load_the_renderer() -> None:
    program = (
        "import sys; from rptcam_cl.cli import build_parser; build_parser().format_help()\n"
        "print([name for name in ('pyopencl', 'numpy', 'pydantic', 'rich') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.stdout == "[]\n", done.stderr


def test_reader_that_leaves_early_is_no_error() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "rptcam_cl", "schema", "--lens"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == b""
    assert process.wait(timeout=120) == 0


def test_interrupt_before_the_renderer_starts_is_130(rptcam: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def press() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("rptcam_cl.api.interface.devices", press)
    run = rptcam("devices")
    assert (run.code, run.err) == (130, "interrupted\n")
