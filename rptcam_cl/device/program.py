"""Kernel programs: sources joined on the host, specialised by facts, built once per identity.

Includes are expanded here with ``#line``, so that one text has one identity and compiler messages name the real file.

What was built is kept for the next run where the driver keeps none itself. PoCL and NVIDIA's driver have caches of
their own. Intel's has none, and takes seconds for a scene. What is kept carries its own hash: drivers do not survive a
damaged program.
"""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.kept import keep_bytes, kept_bytes
from rptcam_cl.core.resources import kernels_dir
from rptcam_cl.device.opencl import AS_BEFORE_POCL_7, load_opencl
from rptcam_cl.device.signature import kernel_parameters
from rptcam_cl.device.trial import AVX512_ARCH, first_error, target_pragma

Parameters = Mapping[str, Sequence[str]]  # names of the parameters of each kernel

BUILD_OPTIONS = ("-cl-std=CL1.2", "-w")  # a program that builds has nothing to say to a user
# Of a program that compiles soonest: what is declared inline is inlined, all else are calls of small functions. PoCL
# optimises them before it generates code, until its version 6 also where the program was built without optimisation.
_QUICK = "#undef inline\n#define inline __attribute__((always_inline))\n"
_SMALL = "#pragma clang attribute push(__attribute__((minsize)), apply_to=function)\n"
_NOT_OPTIMISED = "-cl-opt-disable"
_HASH_BYTES = 32
_GUARD = re.compile(r"^#ifndef (\w+)\n#define \1$", re.MULTILINE)
_CONDITION = re.compile(r"^\s*#\s*(if|ifdef|ifndef|endif)\b")
_INCLUDE = re.compile(r'^\s*#include\s+(?:"([^"]+)"|([A-Z_]+))\s*$')


def expand(files: list[str], facts: Mapping[str, int | str]) -> str:
    """Return the text of ``files`` (paths below ``kernels/``) with every include in place.

    A file is put in once, but again behind an ``#if`` that may have left it out; its guard sees to the rest.

    ``#include NAME`` in capitals takes the path from ``facts[NAME]``.
    """
    seen: set[str] = set()
    lines: list[str] = []
    for name in files:
        _expand(name, facts, seen, lines)
    return "\n".join(lines) + "\n"


def _expand(name: str, facts: Mapping[str, int | str], seen: set[str], lines: list[str]) -> None:
    if name in seen:
        return
    seen.add(name)
    lines.append(f'#line 1 "{name}"')
    text = (kernels_dir() / name).read_text(encoding="utf-8")
    depth = -1 if _GUARD.search(text) else 0
    for number, line in enumerate(text.splitlines(), start=1):
        if "#" not in line:
            lines.append(line)
            continue
        include = _INCLUDE.match(line)
        if include is None:
            condition = _CONDITION.match(line)
            depth += 0 if condition is None else -1 if condition[1] == "endif" else 1
            lines.append(line)
            continue
        _expand(include[1] or str(facts[include[2]]), facts, seen if depth == 0 else set(seen), lines)
        lines.append(f'#line {number + 1} "{name}"')


def assemble(files: list[str], facts: Mapping[str, int | str], declarations: str, *, library_arch: str | None) -> str:
    """Return the complete program text: facts, declarations, sources."""
    head = [f"#define {name} {value}" for name, value in sorted(facts.items()) if isinstance(value, int)]
    if library_arch:
        # PoCL compiles kernels for the exact processor and its built-ins for an older one; LLVM then refuses to inline
        # sqrt, floor, vload8 and the like where the older one has a feature that the exact one is not said to have.
        # The same target for both makes every built-in inline (measured: 9x on the lens kernel).
        head.append("#define CLANG_AVX2 1")
        if library_arch == AVX512_ARCH:
            head.append("#define CLANG_AVX512 1")
        head.append(target_pragma(library_arch).rstrip())
    body = expand(files, facts)
    tail = "#pragma clang attribute pop\n" if library_arch else ""
    return "\n".join(head) + "\n" + declarations + body + tail


def quick_source(source: str) -> str:
    """Return the text of a program that compiles sooner for PoCL, runs slower and computes the same bits."""
    return f"{_QUICK}{_SMALL}{source}#pragma clang attribute pop\n"


def options_of(device: Any, source: str) -> tuple[str, ...]:
    """Return the options that a program is built with for a pyopencl device."""
    version = re.search(r"PoCL (\d+)", device.platform.version)
    if version is None:
        return BUILD_OPTIONS
    if (
        int(version[1]) >= 7
    ):  # its cache tells programs apart by these, but not by the settings that they are built with
        return (*BUILD_OPTIONS, *(f"-D{name}={int(os.environ.get(name) == '1')}" for name in AS_BEFORE_POCL_7))
    return (*BUILD_OPTIONS, _NOT_OPTIMISED) if source.startswith(_QUICK) else BUILD_OPTIONS


def source_key(files: list[str], facts: Mapping[str, int | str], declarations: str) -> tuple[Any, ...]:
    """Return what the text of a program follows from, without reading it."""
    return (kernels_dir(), *files, frozenset(facts.items()), declarations)


class Program:
    """A built program.

    Attributes
    ----------
    name : str
        See `program_name`.
    source : str

    Raises
    ------
    DeviceError
        When the program does not compile: the first compiler error, and a file that holds source and log.
    """

    def __init__(self, context: Any, device: Any, source: str) -> None:
        import pyopencl as cl

        self.identity = hashlib.sha256(source.encode()).hexdigest()
        self.name = program_name(device, source)
        self.is_noted = False  # that its code was generated
        self.source = source
        self._idle: dict[str, list[Any]] = {}
        try:
            self.handle = build_program(context, device, source, list(options_of(device, source)))
        except cl.Error as error:
            raise DeviceError(_build_failure(source, str(error), self.identity)) from error

    def idle_kernels(self, name: str) -> list[Any]:
        """Return the kernels of a name that no launch uses; they are taken from the list and put back.

        PoCL 3.0 keeps 2 KB of each kernel that has had an argument, for good.
        """
        return self._idle.setdefault(name, [])

    @property
    def is_quick(self) -> bool:
        """Whether it is one of `quick_source`."""
        return self.source.startswith(_QUICK)

    @cached_property
    def parameters(self) -> Parameters:
        """The names of the parameters of each kernel, in their order."""
        return kernel_parameters(self.source)


def build_program(context: Any, device: Any, source: str, options: list[str]) -> Any:
    """Return the program built of ``source`` for a pyopencl device; raises what pyopencl raises."""
    cl = load_opencl()
    from pyopencl.characterize import has_src_build_cache

    if has_src_build_cache(device):
        return cl.Program(context, source).build(options=options, devices=[device])
    name = program_name(device, source, options)
    kept = kept_bytes("programs", name) or b""
    if kept and hashlib.sha256(kept[_HASH_BYTES:]).digest() == kept[:_HASH_BYTES]:
        try:
            return cl.Program(context, [device], [kept[_HASH_BYTES:]]).build(options=options, devices=[device])
        except cl.Error:  # of a driver that has changed without a new version
            pass
    program = cl.Program(context, source).build(options=options, devices=[device])
    binary = bytes(program.get_info(cl.program_info.BINARIES)[0])
    keep_bytes("programs", name, hashlib.sha256(binary).digest() + binary)
    return program


def program_name(device: Any, source: str, options: Iterable[str] | None = None) -> str:
    """Return a name for a program and all that what a driver makes of it depends on."""
    platform, words = device.platform, options_of(device, source) if options is None else options
    facts = [platform.name, platform.version, device.name, device.version, device.driver_version, *words, source]
    return hashlib.sha256("\0".join(facts).encode()).hexdigest()


def _build_failure(source: str, log: str, identity: str) -> str:
    message = f"an OpenCL program did not compile: {first_error(log)}"
    try:  # a name that nobody can foresee, as the folder is everybody's
        descriptor, path = tempfile.mkstemp(prefix=f"rptcam_cl-{identity[:12]}-", suffix=".cl.log")
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="replace") as file:
            file.write(f"{log}\n\n/* source */\n{source}")
    except OSError as problem:
        return f"{message} (its log could not be written: {problem.strerror})"
    return f"{message} (source and full log: {path})"
