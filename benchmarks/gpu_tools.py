"""Unpacks compilers for GPUs into a folder of the checkout, without a GPU and without touching the system.

    python -m benchmarks.gpu_tools            (or: make gpu-tools)

NVIDIA's OpenCL compiler (Debian's libnvidia-nvvm4) and assembler (ptxas of PyPI's nvidia-cuda-nvcc-cu12), AMD's back
end (clang with rocm-device-libs) and Intel's (intel-ocloc), about 800 MB on x86-64 with `dpkg`. Programs come with the
C library of their suite and are run by its loader, so that they start on any Linux. Packages come from the mirror of
this system's sources, or that of DEBIAN_MIRROR; their sums are those of its index, which is read over https.
"""

from __future__ import annotations

import argparse
import hashlib
import lzma
import os
import shutil
import subprocess
import sys
import tempfile
import urllib.request
import zipfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / ".gpu-tools"
SOURCES = Path("/etc/apt")
LIBRARIES = "usr/lib/x86_64-linux-gnu"
# What compiles no kernel: clang depends on it for programs of this machine.
NOT_NEEDED = ("libstdc++-", "libgcc-", "libobjc-", "libc6-dev", "binutils", "gcc-", "debconf", "libc-gconv")
WHEEL = "nvidia-cuda-nvcc-cu12"


@dataclass(frozen=True)
class Tool:
    """Packages of a suite; libraries that are opened by name are among them, their dependencies follow."""

    suite: str
    areas: tuple[str, ...]
    packages: tuple[str, ...]


TOOLS = {
    "nvidia": Tool("trixie", ("non-free",), ("libnvidia-nvvm4",)),
    "amd": Tool("trixie", ("main",), ("clang-19", "rocm-device-libs-17")),
    "intel": Tool("sid", ("main",), ("intel-ocloc", "libigc2", "libigdfcl2")),
}
_ROOTS = {"nvidia": False, "amd": True, "intel": True}  # whether it brings its own C library


@lru_cache(maxsize=1)
def mirror() -> str:
    """Return the address of a mirror of Debian."""
    lists = (SOURCES / "sources.list", *sorted((SOURCES / "sources.list.d").glob("*")))
    words = [word for each in lists if each.is_file() for word in each.read_text("utf-8", errors="replace").split()]
    known = [os.environ.get("DEBIAN_MIRROR", ""), *(word for word in words if word.rstrip("/").endswith("/debian"))]
    for address in known:
        if address.startswith(("http://", "https://")):
            return f"https://{address.partition('://')[2].rstrip('/')}"
    raise SystemExit("this system's sources name no mirror of Debian (set DEBIAN_MIRROR to the address of one)")


def fetched(address: str) -> bytes:
    """Return what stands at an address."""
    with urllib.request.urlopen(address, timeout=60) as answer:
        return bytes(answer.read())


@lru_cache(maxsize=4)
def index(suite: str, area: str) -> dict[str, dict[str, str]]:
    """Return the fields of every package of an area, by its name and by the names that it provides."""
    text = lzma.decompress(fetched(f"{mirror()}/dists/{suite}/{area}/binary-amd64/Packages.xz")).decode()
    found: dict[str, dict[str, str]] = {}
    provided: dict[str, dict[str, str]] = {}
    for entry in text.split("\n\n"):
        fields = dict(line.split(": ", 1) for line in entry.splitlines() if ": " in line and not line.startswith(" "))
        if fields:
            found[fields["Package"]] = fields
            provided |= {name.split()[0]: fields for name in fields.get("Provides", "").split(", ") if name}
    return provided | found


def closure(tool: Tool, *, follow: bool) -> dict[str, dict[str, str]]:
    """Return the packages of a tool and, with ``follow``, all that they depend on to run."""
    known = {name: fields for area in tool.areas for name, fields in index(tool.suite, area).items()}
    wanted, found = list(tool.packages), {}
    while wanted:
        name = wanted.pop()
        is_needed = name in tool.packages or not (name.startswith(NOT_NEEDED) and name != "libgcc-s1")
        if name in found or not is_needed:
            continue
        found[name] = known[name]
        depends = known[name].get("Depends", "") if follow else ""
        wanted += [each.split("|")[0].split()[0].split(":")[0] for each in depends.split(", ") if each]
    return found


def unpack(name: str) -> None:
    """Fetch the packages of a tool, check their sums and unpack them into its folder."""
    root = FOLDER / name
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir(parents=True)
    for package, fields in closure(TOOLS[name], follow=_ROOTS[name]).items():
        data = fetched(f"{mirror()}/{fields['Filename']}")
        if hashlib.sha256(data).hexdigest() != fields["SHA256"]:
            raise SystemExit(f"{package}: what was fetched is not what Debian's index says (try again)")
        with tempfile.NamedTemporaryFile(suffix=".deb") as file:
            file.write(data)
            file.flush()
            subprocess.run(["dpkg", "-x", file.name, str(root)], check=True)
        print(f"{name}: {package} {fields['Version']}", flush=True)


def unpack_ptxas() -> None:
    """Take NVIDIA's assembler out of the wheel of its compilers."""
    with tempfile.TemporaryDirectory() as folder:
        fetch = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", folder, WHEEL]
        subprocess.run(fetch, check=True)
        wheel = next(Path(folder).glob("*.whl"))
        with zipfile.ZipFile(wheel) as archive:
            name = next(each for each in archive.namelist() if each.endswith("bin/ptxas"))
            (FOLDER / "nvidia/ptxas").write_bytes(archive.read(name))
    (FOLDER / "nvidia/ptxas").chmod(0o755)
    print(f"nvidia: ptxas of {wheel.stem}", flush=True)


def command_of(tool: str, program: str, *libraries: str) -> list[str]:
    """Return how to start a program of a tool by the loader and the libraries that were unpacked beside it."""
    root = FOLDER / tool
    paths = ":".join(str(root / each) for each in (LIBRARIES, *libraries))
    return [str(root / LIBRARIES / "ld-linux-x86-64.so.2"), "--library-path", paths, str(root / program)]


def missing(tool: str) -> str | None:
    """Return why a tool cannot be used, None where it is there."""
    signs = {"nvidia": "ptxas", "amd": "usr/lib/llvm-19/bin/clang", "intel": f"{LIBRARIES}/libigc.so.2"}
    if (FOLDER / tool / signs[tool]).exists():
        return None
    return f"the compiler of {tool} is not unpacked (run: make gpu-tools)"


def main() -> None:
    """Unpack what the command line names."""
    parser = argparse.ArgumentParser(description="Unpack compilers for GPUs.")
    parser.add_argument("tools", nargs="*", default=list(TOOLS), help="nvidia, amd, intel; by default all")
    for name in parser.parse_args().tools:
        unpack(name)
        if name == "nvidia":
            unpack_ptxas()


if __name__ == "__main__":
    main()
