"""Builds the extension: a zip with the manifest, the modules, and wheels of all that Blender does not bring.

    python -m integrations.blender.build [--output out/blender] [--platform linux-x64 …] [--python 3.11]

Wheels are downloaded by pip for Blender's Python and platform; that of rptcam_cl is built of this checkout. NumPy is
Blender's own. A platform for which wheels are missing is named and left out.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
CHECKOUT = HERE.parents[1]
TAGS = {
    "linux-x64": ["manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"],
    "windows-x64": ["win_amd64"],
    "macos-arm64": ["macosx_11_0_arm64", "macosx_12_0_arm64", "macosx_14_0_arm64"],
}
OF_BLENDER = ("numpy",)  # in Blender's own Python
NOT_NEEDED = ("rich", "markdown_it_py", "mdurl", "pygments")  # of the command line alone
LEFT_OUT = ("build.py", "__pycache__")


def requirements(platform: str) -> list[str]:
    """What the engine needs apart from NumPy, on a platform."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [
        text for text in project["dependencies"] if re.split(r"[<>=~!;\[ ]", text)[0] not in (*OF_BLENDER, "rich")
    ]
    if platform == "linux-x64":
        wanted.append("pocl-binary-distribution")
    elif platform == "windows-x64":
        wanted += ["intel-opencl-rt", "intel-cmplr-lib-rt"]
    return wanted


def download(platform: str, python: str, folder: Path) -> list[Path]:
    """The wheels of a platform; raises `subprocess.CalledProcessError` where one is missing."""
    tags = [part for tag in TAGS[platform] for part in ("--platform", tag)]
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--only-binary=:all:", "--python-version", python]
    subprocess.run([*command, *tags, "--dest", str(folder), *requirements(platform)], check=True)
    wheels = []
    for wheel in sorted(folder.glob("*.whl")):
        name = wheel.name.split("-")[0].lower()
        if name in OF_BLENDER or name in NOT_NEEDED:
            wheel.unlink()
        else:
            wheels.append(wheel)
    return wheels


def own_wheel(folder: Path) -> Path:
    """The wheel of this checkout."""
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(CHECKOUT)]
    subprocess.run(command, check=True)
    return next(folder.glob("rptcam_cl-*.whl"))


def manifest(wheels: list[str], platform: str, python: str) -> str:
    """The manifest with its wheels, for one platform."""
    text = (HERE / "blender_manifest.toml").read_text(encoding="utf-8")
    head, permissions = text.split("[permissions]")
    listed = "".join(f'  "./wheels/{name}",\n' for name in wheels)
    return f'{head}platforms = ["{platform}"]\nwheels = [\n{listed}]\n\n[permissions]{permissions}'


def build(platform: str, python: str, output: Path) -> Path:
    """Write the extension of a platform and return its file."""
    version = tomllib.loads((HERE / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]
    output.mkdir(parents=True, exist_ok=True)
    path = output / f"rptcam-{version}-{platform}.zip"
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        wheels = [*download(platform, python, folder), own_wheel(folder)]
        part = folder / path.name
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("blender_manifest.toml", manifest([wheel.name for wheel in wheels], platform, python))
            for file in sorted(HERE.iterdir()):
                if file.name not in LEFT_OUT and file.name != "blender_manifest.toml" and file.is_file():
                    archive.write(file, file.name)
            for wheel in wheels:
                archive.write(wheel, f"wheels/{wheel.name}", zipfile.ZIP_STORED)
        shutil.move(part, path)
    return path


def main() -> None:
    """Build the extension for some platforms."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=CHECKOUT / "out" / "blender")
    parser.add_argument("--platform", action="append", choices=sorted(TAGS), help="may be repeated (default: all)")
    parser.add_argument("--python", default="3.11", help="version of Blender's Python (default: 3.11)")
    given = parser.parse_args()
    built = []
    for platform in given.platform or sorted(TAGS):
        try:
            built.append(build(platform, given.python, given.output))
        except subprocess.CalledProcessError as problem:
            print(f"{platform}: left out, pip found no wheel for it (exit code {problem.returncode})", file=sys.stderr)
            continue
        print(f"{built[-1]} ({built[-1].stat().st_size / 1e6:.0f} MB)")
    if not built:
        raise SystemExit("no extension was built")


if __name__ == "__main__":
    main()
