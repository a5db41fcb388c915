import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rptcam_cl.cli import COMMANDS, build_parser, output
from rptcam_cl.core import __version__
from rptcam_cl.core.errors import DeviceError
from tests.support.cases import slow

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
    monkeypatch.setattr("rptcam_cl.device.devices.devices", lambda: DEVICES)
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

    monkeypatch.setattr("rptcam_cl.device.devices.devices", fail)
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


@pytest.mark.parametrize(("words", "name"), [slow([], "scene"), (["--lens"], "lens")])
def test_schema_is_the_published_one(rptcam: Command, checkout: Path, words: list[str], name: str) -> None:
    run = rptcam("schema", *words)
    assert run.code == 0
    assert run.out == (checkout / "docs" / f"{name}.schema.json").read_text("utf-8")


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

    monkeypatch.setattr("rptcam_cl.device.devices.devices", press)
    run = rptcam("devices")
    assert (run.code, run.err) == (130, "interrupted\n")


@pytest.mark.parametrize(
    ("words", "given", "served"),
    [
        ([], {}, {}),
        (["--size", "32x18", "--device", "cpu", "--set", "camera.fov_degrees=50"],
         {"size": (32, 18), "device": "cpu", "overrides": ["camera.fov_degrees=50"]}, {}),
        (["--port", "8123", "--no-browser", "--host", "::1"], {}, {"port": 8123, "browse": False, "host": "::1"}),
        (["--host", "0.0.0.0", "--let-others-in"], {}, {"host": "0.0.0.0"}),
    ],
)  # fmt: skip
def test_view_opens_the_scene_where_it_is_told(
    scene: Path, rptcam: Command, monkeypatch: pytest.MonkeyPatch, words: list[str], given: Any, served: Any
) -> None:
    made: list[Any] = []

    def finder(path: Path, overrides: list[str], **options: Any) -> Any:
        made.append({"path": path, "overrides": overrides, **options})
        return SimpleNamespace(warnings=["the film is small"])

    def serve(finder: Any, *, announce: Callable[[str], None], **options: Any) -> None:
        made.append(options)
        announce("http://127.0.0.1:8123/#token")

    monkeypatch.setattr("rptcam_cl.viewfinder.engine.Viewfinder", finder)
    monkeypatch.setattr("rptcam_cl.viewfinder.server.serve", serve)
    monkeypatch.setattr("rptcam_cl.device.session.open_early", lambda device: made.append(device))
    run = rptcam("view", "scene.yaml", *words)
    assert (run.code, run.err) == (0, "warning: the film is small\n")
    printed, told, more = run.out.partition("On a telephone: http://")
    assert printed == "scene.yaml is at http://127.0.0.1:8123/#token\nCtrl-C ends it.\n"
    assert bool(told) == (served.get("host") == "0.0.0.0")
    assert not told or ":8123/#token\n" in more
    early, opened, options = made
    assert early == given.get("device")
    assert opened == {"path": Path("scene.yaml"), "overrides": [], "device": None, "size": None} | given
    assert options == {"host": "127.0.0.1", "port": 0, "browse": True} | served


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "render.example"])
def test_view_lets_nobody_in_without_consent(
    scene: Path, rptcam: Command, monkeypatch: pytest.MonkeyPatch, host: str
) -> None:
    monkeypatch.setattr("rptcam_cl.device.session.open_early", lambda device: None)
    monkeypatch.setattr("rptcam_cl.viewfinder.engine.Viewfinder", None)
    run = rptcam("view", "scene.yaml", "--host", host)
    assert run.code == 2
    assert run.err.startswith(f"error: --host {host}: lets other machines in, over a connection that is not encrypted")


def test_table_on_a_terminal_is_ruled_and_holds_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [["[a]", 1.23456789, None], ["b", float("nan"), 1e-15]]
    output.print_table(["name", "[mm]", "left"], rows, "a [title]")
    plain = capsys.readouterr().out
    assert plain == "a [title]\nname    [mm]  left\n [a]  1.2346     -\n   b       -     0\n"
    with pytest.MonkeyPatch.context() as terminal:
        terminal.setattr("sys.stdout.isatty", lambda: True, raising=False)
        output.print_table(["name", "[mm]", "left"], rows, "a [title]")
    ruled = re.sub(r"\x1b\[\d*m", "", capsys.readouterr().out)
    assert "a [title]" in ruled and "┃" in ruled
    cells = [[cell.strip() for cell in line.strip("│┃").replace("┃", "│").split("│")] for line in ruled.splitlines()]
    assert ["name", "[mm]", "left"] in cells and ["[a]", "1.2346", "-"] in cells and ["b", "-", "0"] in cells


def test_bytes_are_written_with_the_largest_unit_of_which_there_is_one() -> None:
    sizes = (0, 1023, 1024, 1536, 5 << 20, 3 << 30, 2000 << 30)
    assert [output.as_bytes(size) for size in sizes] == [
        "0 B", "1023 B", "1 KiB", "1.5 KiB", "5 MiB", "3 GiB", "2000 GiB",
    ]  # fmt: skip


def test_devices_that_share_a_render_are_named_with_what_each_took() -> None:
    devices = [
        {"id": "0:0", "name": "one", "share": 0.7, "msamples_per_second": 12.34},
        {"id": "1:0", "name": "two", "share": 0.3, "msamples_per_second": 5.0},
    ]
    work = [{"split": "0:0=0.7,1:0=0.3"}]
    assert output.shared_text({"devices": devices, "work": work}) == (
        "devices: 0:0 one took 70.0% at 12.3 Msamples/s, 1:0 two took 30.0% at 5 Msamples/s;"
        " --split 0:0=0.7,1:0=0.3 repeats it"
    )
    devices[1]["dropped"] = True
    assert output.shared_text({"devices": devices, "work": [*work, {"split": "0:0=1"}]}) == (
        "devices: 0:0 one took 70.0% at 12.3 Msamples/s, 1:0 two was dropped at 5 Msamples/s"
    )
    assert output.shared_text({"devices": devices[:1]}) is output.shared_text({}) is None
