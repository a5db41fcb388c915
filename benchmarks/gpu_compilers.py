"""What compilers for GPUs make of every program of the examples and reference scenes, without a GPU.

    make gpu-tools
    python -m benchmarks.gpu_compilers [--targets sm_90 gfx1030 dg2] [--scenes A C …] [--markdown] [--json FILE]

Programs are those that a GPU would be given (``RPTCAM_ORGANISATION=passes``): of every scene, and of small renders that
run every kernel (`tests.device.every_kernel`). Each goes through the compilers that are unpacked. What a program has
shown is kept beside them, by its text, so that a second run compiles only what has changed. Seconds are CPU time.
"""

from __future__ import annotations

import argparse
import hashlib
import inspect
import json
import os
import re
import resource
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from benchmarks.gpu_tools import FOLDER, LIBRARIES, command_of, missing
from benchmarks.report import table, write_json

TIME_LIMIT_S = 300
OPTIONS = "-cl-std=CL1.2"
OTHERS = (
    "media",
    "passes",
    "lens",
    "meshes",
    "denoised",
    "tree of shapes",
    "everything",
    "behind glass",
    "light of lamps",
    "hair",
    "many lamps",
    "ring",
    "layered fog",
    "smoke",
    "conjugates",
    "mixtures",
)  # of tests.device.every_kernel


@dataclass(frozen=True)
class Compiled:
    """What a compiler says of a kernel.

    Attributes
    ----------
    registers : int
        Of a work item, of 32 bits; 0 on Intel, whose threads have 128 of 32 bytes for their lanes.
    stack : int
        Bytes of a work item in memory: arrays that are indexed at run time, and what registers did not hold.
    spilled : int
        Bytes (AMD: registers) of it that registers did not hold.
    lanes : int
        Work items of a thread on Intel, 0 elsewhere.
    warps : int
        Warps or waves that a multiprocessor can hold at once, by registers; 0 on Intel.
    seconds : float
        CPU time of compiling the whole program.
    """

    kernel: str
    registers: int
    stack: int
    spilled: int
    lanes: int
    warps: int
    seconds: float


@dataclass(frozen=True)
class Limit:
    """The most that a kernel may take: registers and bytes on NVIDIA's sm_90, and the least lanes on Intel's dg2."""

    registers: int
    stack: int
    lanes: int


LIMITS = {
    "aim_rays": Limit(32, 0, 32),
    "denoise": Limit(64, 0, 16),
    "fill_blocks": Limit(32, 0, 32),  # whole vertices at once
    "film": Limit(40, 0, 16),
    "gather": Limit(24, 0, 32),
    "generate": Limit(56, 0, 16),
    "ghosts": Limit(40, 0, 16),
    "guides": Limit(80, 224, 8),
    "histogram": Limit(48, 1728, 16),
    "intersect": Limit(64, 0, 8),
    "layers": Limit(168, 0, 8),
    "leaves": Limit(32, 0, 32),
    "light_paths": Limit(168, 64, 8),  # by those of photons and shade, not yet measured
    "occluded": Limit(32, 0, 32),
    "partition": Limit(40, 0, 16),
    "photons": Limit(128, 64, 8),
    "reinsert": Limit(48, 0, 32),
    "search": Limit(48, 1024, 16),
    "shade": Limit(128, 0, 8),
    "shadow": Limit(64, 0, 8),
    "sharp": Limit(64, 0, 8),
    "shift_blocks": Limit(32, 0, 32),  # dg2 has no float64
    "sort": Limit(32, 0, 16),
    "subtree": Limit(168, 2976, 16),
    "trace_copies": Limit(80, 0, 0),
    "trace_lens": Limit(80, 0, 0),
    "trace_rays": Limit(64, 0, 16),
    "travel": Limit(128, 0, 8),
    "C: intersect": Limit(64, 0, 16),
    "C: shadow": Limit(64, 0, 16),
    "A: shade": Limit(40, 0, 16),
    "A_lens: shade": Limit(40, 0, 16),
    "B: shade": Limit(56, 0, 16),
    "C: shade": Limit(64, 0, 16),
    "first_light: shade": Limit(64, 0, 16),
    "lighthouse: shadow": Limit(80, 0, 8),
    "lighthouse: travel": Limit(164, 0, 8),
    "media: travel": Limit(164, 0, 8),  # overlapping solids are left one by one
    "smoke: shadow": Limit(96, 0, 8),
    "smoke: travel": Limit(244, 0, 8),  # which walks through grids at five places
    "tea: shadow": Limit(96, 0, 8),
    "tea: travel": Limit(240, 0, 8),
    "headlamps: travel": Limit(176, 0, 8),  # beams of spots
    "underwater: shadow": Limit(126, 0, 8),  # curves and meshes under water
    "underwater: travel": Limit(204, 0, 8),
    "conjugates: generate": Limit(56, 0, 8),
    "hair: intersect": Limit(80, 0, 8),  # of a curve alone: fourteen numbers, and where on it
    "hair: shadow": Limit(80, 0, 8),
    "leaf: intersect": Limit(80, 0, 8),
    "leaf: shadow": Limit(96, 0, 8),
    "everything: intersect": Limit(106, 0, 8),  # with holes by every texture
    "everything: shadow": Limit(116, 0, 8),
    "everything: photons": Limit(208, 1048, 8),
    "everything: shade": Limit(255, 160, 8),
}


def recorded(scenes: Iterable[str]) -> dict[str, list[str]]:
    """Return the texts of all programs of scenes and of `OTHERS`, each with the names of those that need it."""
    found: dict[str, list[str]] = {}
    names = list(scenes)
    groups = [[name for name in names if name not in OTHERS], *([name] for name in names if name in OTHERS)]
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"RPTCAM_ORGANISATION": "passes", "RPTCAM_CACHE_DIR": folder}  # trees are built
        for group in filter(None, groups):
            path = Path(folder) / "recorded.json"
            command = [sys.executable, "-m", "benchmarks.gpu_compilers", "--record", str(path), "--scenes", *group]
            subprocess.run(command, check=True, env=environment)
            for scene, text in json.loads(path.read_text(encoding="utf-8")):
                found.setdefault(text, []).append(scene)
    return found


def record(scenes: list[str], path: str) -> None:
    """Write the programs of some scenes, which this process plans or renders, to a file."""
    from benchmarks import films
    from rptcam_cl.core.errors import RptcamError
    from rptcam_cl.device import session
    from rptcam_cl.device.devices import choose_device
    from rptcam_cl.rendering import passes
    from rptcam_cl.rendering.film import FilmLayout
    from rptcam_cl.rendering.plan.plan import make_plan
    from rptcam_cl.rendering.tracer import Wavefront
    from tests.device import every_kernel

    texts: list[tuple[str, str]] = []
    assemble, named = session.assemble, [""]

    def noted(*arguments: Any, library_arch: str | None) -> str:
        texts.append((named[0], assemble(*arguments, library_arch=None)))
        return assemble(*arguments, library_arch=library_arch)

    session.assemble = noted
    passes._first_right = lambda *_: 0  # type: ignore[assignment] # the picture by which a driver is tried is of no scene
    for name, scene in films.scenes().items():
        if name in scenes:
            named[0] = name
            try:
                Wavefront(
                    session.Session(choose_device(None)), make_plan(scene), FilmLayout.of(scene.film), scene.render
                )
            except RptcamError as error:
                print(f"{name}: {error}", file=sys.stderr)
    for name in OTHERS:
        if name in scenes:
            named[0] = name
            every_kernel.RENDERS[name][0]()
    Path(path).write_text(json.dumps(list(dict.fromkeys(texts))), encoding="utf-8")


def all_scenes() -> list[str]:
    """Return the names of all scenes whose programs are compiled."""
    from benchmarks import films

    return [*films.scenes(), *OTHERS]


def run(command: list[str], folder: Path) -> tuple[str, float]:
    """Run a compiler; return what it says, and its CPU time [s]. Raises RuntimeError where it fails."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=TIME_LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise RuntimeError(f"not compiled in {TIME_LIMIT_S} s") from error
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    said = done.stdout + done.stderr
    if done.returncode != 0:
        lines = [line for line in said.splitlines() if "error" in line.lower()] or said.splitlines() or [""]
        raise RuntimeError(f"exit code {done.returncode}: {lines[0].strip()[:200]}")
    return said, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


# NvCliCompileProgram(texts, their number, their lengths, options, the log, the PTX), as NVIDIA's OpenCL calls it.
_NVVM = """
import ctypes, sys
library, arch, options = ctypes.CDLL(sys.argv[1]), sys.argv[2], sys.argv[3]
text = open("program.cl", "rb").read()
log, made = ctypes.c_char_p(), ctypes.c_char_p()
options = f"{options} -cl-nv-cstd=CL1.2 -cl-nv-arch {arch} -nv-m64".encode()
code = library.NvCliCompileProgram((ctypes.c_char_p * 1)(text), 1, (ctypes.c_size_t * 1)(len(text)), options,
                                   ctypes.byref(log), ctypes.byref(made))
if code != 0:
    sys.exit((log.value or b"error without a log").decode(errors="replace"))
open("program.ptx", "wb").write(made.value)
"""
_PTXAS = re.compile(
    r"Compiling entry function '(\w+)'.*?(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads"
    r".*?Used (\d+) registers",
    re.DOTALL,
)


def compile_for_nvidia(target: str, folder: Path) -> list[Compiled]:
    """Compile ``program.cl`` in a folder for a compute capability as ``sm_90``."""
    library = next((FOLDER / "nvidia" / LIBRARIES).glob("nvidia/*/libnvidia-nvvm.so.*.*"))
    _, first = run([sys.executable, "-c", _NVVM, str(library), target, OPTIONS], folder)
    assembler = [str(FOLDER / "nvidia/ptxas"), "-v", "-arch", target, "program.ptx", "-o", "program.cubin"]
    said, second = run(assembler, folder)
    return [
        Compiled(name, int(used), int(stack), int(stored), 0, nvidia_warps(int(used), target), first + second)
        for name, stack, stored, _, used in _PTXAS.findall(said)
    ]


def nvidia_warps(registers: int, target: str) -> int:
    """Return how many warps a multiprocessor of 65,536 registers holds: they come in eights and fours."""
    most = 48 if target in ("sm_86", "sm_89", "sm_120") else 64
    return min(most, 65536 // (32 * 8 * -(-max(registers, 1) // 8)) // 4 * 4)


def compile_for_amd(target: str, folder: Path) -> list[Compiled]:
    """Compile ``program.cl`` in a folder for a processor as ``gfx1030``."""
    root = FOLDER / "amd"
    built_ins = next((root / "usr/lib").glob("llvm-*/lib/clang/*/amdgcn/bitcode"))
    options = (
        f"-resource-dir {root}/usr/lib/llvm-19/lib/clang/19 -target amdgcn-amd-amdhsa -mcpu={target} -x cl {OPTIONS}"
        f" -O3 -w --rocm-device-lib-path={built_ins} -S program.cl -o program.s"
    )
    clang = command_of("amd", "usr/lib/llvm-19/bin/clang", "usr/lib/llvm-19/lib")
    _, seconds = run([*clang, *options.split()], folder)
    text = (folder / "program.s").read_text(encoding="utf-8")
    names = re.findall(r"^\s*\.amdhsa_kernel (\w+)", text, re.MULTILINE)
    waves = dict(zip(names, re.findall(r"^; Occupancy: (\d+)", text, re.MULTILINE), strict=False))  # functions follow
    described = yaml.safe_load(text.partition(".amdgpu_metadata")[2].partition("---")[2].partition("\n...")[0])
    return [
        Compiled(
            kernel[".name"], kernel[".vgpr_count"], kernel[".private_segment_fixed_size"],
            kernel[".vgpr_spill_count"], 0, int(waves[kernel[".name"]]), seconds,
        )
        for kernel in described["amdhsa.kernels"]
    ]  # fmt: skip


def compile_for_intel(target: str, folder: Path) -> list[Compiled]:
    """Compile ``program.cl`` in a folder for a device as ``dg2``."""
    ocloc = command_of("intel", "usr/bin/" + next((FOLDER / "intel/usr/bin").glob("ocloc*")).name)
    options = ["compile", "-file", "program.cl", "-device", target, "-options", OPTIONS, "-output", "program"]
    _, seconds = run([*ocloc, *options], folder)
    described = yaml.safe_load(elf_section(next(folder.glob("program*.bin")).read_bytes(), ".ze_info"))
    found = []
    for kernel in described["kernels"]:
        if kernel["name"] == NO_KERNEL:
            continue
        environment = kernel["execution_env"]
        scratch = sum(each["size"] for each in kernel.get("per_thread_memory_buffers", []) if each["type"] == "scratch")
        lanes = environment["simd_size"]
        stack = (environment.get("private_size", 0) or scratch) // lanes  # both are of a thread
        found.append(Compiled(kernel["name"], 0, stack, environment.get("spill_size", 0), lanes, 0, seconds))
    return found


def elf_section(data: bytes, name: str) -> str:
    """Return the text of a section of an ELF file of 64 bits."""
    (start,) = struct.unpack_from("<Q", data, 40)
    size, count, names = struct.unpack_from("<HHH", data, 58)
    heads = [struct.unpack_from("<IIQQQQ", data, start + size * each) for each in range(count)]
    for head in heads:
        label = heads[names][4] + head[0]
        if data[label : data.index(b"\0", label)] == name.encode():
            return data[head[4] : head[4] + head[5]].decode().rstrip("\0")
    raise RuntimeError(f"the program has no section {name}")


Compiler = Callable[[str, Path], list[Compiled]]
COMPILERS: dict[str, tuple[str, Compiler]] = {
    "sm_": ("nvidia", compile_for_nvidia),
    "gfx": ("amd", compile_for_amd),
    "": ("intel", compile_for_intel),
}
TARGETS = ("sm_90", "gfx1030", "dg2")
NO_KERNEL = "Intel_Symbol_Table_Void_Program"  # stands among the kernels of programs whose functions are called
KEPT = "kept"  # folder of a tool that holds what programs have shown; goes with the tool


def tool_of(target: str) -> tuple[str, Compiler]:
    """Return the compiler of a target, by how the target's name begins."""
    return next(found for begins, found in COMPILERS.items() if target.startswith(begins))


def compile_program(text: str, target: str) -> list[Compiled] | str:
    """Compile a program; return its kernels, or why it does not compile."""
    name, compiler = tool_of(target)
    key = hashlib.sha256("\0".join((inspect.getsource(compiler), target, text)).encode()).hexdigest()
    kept = FOLDER / name / KEPT / f"{key}.json"
    if kept.exists():
        answer = json.loads(kept.read_text(encoding="utf-8"))
        return answer if isinstance(answer, str) else [Compiled(**each) for each in answer]
    found: list[Compiled] | str
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "program.cl").write_text(text, encoding="utf-8")
        try:
            found = compiler(target, Path(folder))
        except RuntimeError as error:
            found = str(error)
    kept.parent.mkdir(exist_ok=True)
    kept.write_text(json.dumps(found if isinstance(found, str) else [asdict(each) for each in found]), encoding="utf-8")
    return found


Found = dict[tuple[str, str], dict[str, Compiled]]  # by scene and kernel, then by target


def compile_all(programs: dict[str, list[str]], targets: Iterable[str]) -> tuple[Found, list[str]]:
    """Compile all programs for all targets; return what was found, and what does not compile."""
    found: Found = {}
    failures = []
    for text, scenes in programs.items():
        kernels = re.findall(r"__kernel void (\w+)", text)
        for target in targets:
            answer = compile_program(text, target)
            if isinstance(answer, str):
                failures.append(f"{target}: {', '.join(kernels)} of {', '.join(scenes)}: {answer}")
                continue
            for each in answer:
                for scene in scenes:
                    found.setdefault((scene, each.kernel), {})[target] = each
    return found, failures


def beyond(found: Found) -> list[str]:
    """Return what takes more than `LIMITS` allow."""
    wrong = []
    for (scene, kernel), by_target in found.items():
        limit = LIMITS.get(f"{scene}: {kernel}") or LIMITS.get(kernel)
        nvidia, intel = by_target.get("sm_90"), by_target.get("dg2")
        if limit is None:
            wrong.append(f"{kernel} of {scene} has no limit")
            continue
        if nvidia is not None and (nvidia.registers > limit.registers or nvidia.stack > limit.stack):
            wrong.append(f"sm_90: {kernel} of {scene}: {nvidia.registers} registers, {nvidia.stack} bytes; {limit}")
        if intel is not None and intel.lanes < limit.lanes:
            wrong.append(f"dg2: {kernel} of {scene}: {intel.lanes} lanes; {limit}")
    return wrong


def cell(compiled: Compiled | None) -> str:
    """Return in a few characters what a compiler made of a kernel: registers / stack (spilled) / warps, or lanes."""
    if compiled is None:
        return "-"
    spilled = f" ({compiled.spilled} spilled)" if compiled.spilled else ""
    if compiled.lanes:
        return f"SIMD {compiled.lanes} / {compiled.stack}{spilled}"
    return f"{compiled.registers} / {compiled.stack}{spilled} / {compiled.warps}"


def weight(by_target: dict[str, Compiled]) -> tuple[int, int]:
    """Order what was found of kernels by what they take."""
    return max(each.stack for each in by_target.values()), max(each.registers for each in by_target.values())


SHOWN = ("A", "A_lens", "B", "C", "first_light", "hair", "many lamps", "media")


def rows(found: Found, targets: Iterable[str]) -> list[list[str]]:
    """Return the rows of the table: each kernel of the reference scenes, and of the scene where it takes most."""
    lines = []
    for name in sorted({kernel for _, kernel in found}):
        of_scenes = {scene: by_target for (scene, kernel), by_target in found.items() if kernel == name}
        most = max(of_scenes, key=lambda scene: weight(of_scenes[scene]))
        alike: dict[tuple[str, ...], list[str]] = {}
        for scene in [*(each for each in SHOWN if each in of_scenes and each != most), most]:
            by_target = of_scenes[scene]
            alike.setdefault(tuple(cell(by_target.get(target)) for target in targets), []).append(scene)
        for cells, scenes in alike.items():
            seconds = [f"{of_scenes[scenes[0]][t].seconds:.1f}" if t in of_scenes[scenes[0]] else "-" for t in targets]
            lines.append([f"{name}: {', '.join(scenes)}", *cells, " / ".join(seconds)])
    return lines


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="What compilers for GPUs make of every program.")
    parser.add_argument("--targets", nargs="+", default=TARGETS, help="sm_90, sm_89, gfx1030, gfx1103, dg2, tgllp, …")
    parser.add_argument("--scenes", nargs="+", help="of these scenes alone")
    parser.add_argument("--markdown", action="store_true", help="print the table alone, for docs/devices.md")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to a file, too")
    parser.add_argument("--record", metavar="FILE", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.record:
        record(options.scenes, options.record)
        return 0
    lacking = {target: why for target in options.targets if (why := missing(tool_of(target)[0]))}
    targets = [target for target in options.targets if target not in lacking]
    found, failures = compile_all(recorded(options.scenes or all_scenes()), targets)
    columns = ("kernel: scenes", *targets, "s to compile")
    print(table("", columns, rows(found, targets)).strip())
    if not options.markdown:
        print("\n".join([*lacking.values(), *failures, *beyond(found)]))
    results = {f"{scene} {kernel}": {t: asdict(c) for t, c in each.items()} for (scene, kernel), each in found.items()}
    write_json(options.json, {"targets": targets}, results | {"failures": failures})
    return min(len(failures), 1)


if __name__ == "__main__":
    raise SystemExit(main())
