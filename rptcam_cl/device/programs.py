"""Kernel programs: sources joined on the host, specialised by facts, built once; their parameters by name."""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.files import kernels_dir
from rptcam_cl.core.remember import Disk
from rptcam_cl.device.devices import AVX512_ARCH, first_error, read_or_none, target_pragma
from rptcam_cl.device.drivers import AS_BEFORE_POCL_7, load_opencl

#
# Names of the parameters of kernels, read from the source text of a program, so that arguments are bound by name.
#
# A parameter may depend on the facts of the program, and lists of them are macros (``SCENE_PARAMETERS`` of
# ``kernels/common/scene.h``). So conditions and macros are resolved here as a C preprocessor does it, as far as the
# heads of kernels need it. OpenCL can report the names, too, but not every driver does, and none of a program that it
# has kept.

_Macros = dict[str, tuple[tuple[str, ...] | None, str]]  # parameters, None for a macro without, and body

_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*|\\\n", re.DOTALL)
_DIRECTIVE = re.compile(r"\s*#\s*(define|undef|ifdef|ifndef|if|elif|else|endif)\b\s*(.*)")
_DEFINITION = re.compile(r"(\w+)(?:\(([^)]*)\))?\s*(.*)")
_DEFINED = re.compile(r"\bdefined\s*\(?\s*(\w+)\s*\)?")
_KERNEL = re.compile(r"__kernel\s+void\s+(\w+)\s*\((.*)\)\s*\{")
_WORD = re.compile(r"\b[A-Za-z_]\w*")


def kernel_parameters(source: str) -> dict[str, tuple[str, ...]]:
    """Return the names of the parameters of every kernel of a program, in their order."""
    macros: _Macros = {}
    parameters: dict[str, tuple[str, ...]] = {}
    head = ""
    for line in _active_lines(_COMMENT.sub(" ", source), macros):
        if head or line.lstrip().startswith("__kernel"):
            head += f" {line}"
            if "{" in line:
                kernel = _KERNEL.match(_expand_macros(head.lstrip(), macros))
                assert kernel is not None, head
                parameters[kernel[1]] = tuple(_WORD.findall(each)[-1] for each in kernel[2].split(","))
                head = ""
    return parameters


def _active_lines(text: str, macros: _Macros) -> Iterator[str]:
    """Yield the lines that conditions leave; keep ``macros`` as they are at each of them."""
    taken: list[tuple[bool, bool]] = []  # of each open condition: whether its branch at hand is in, and any before it
    active = True  # all of them are in
    for line in text.splitlines():
        directive = _DIRECTIVE.match(line) if "#" in line else None  # most lines have none, and a look costs less
        if directive is None:
            if active:
                yield line
            continue
        word, rest = directive.groups()
        if word in ("if", "ifdef", "ifndef"):
            holds = active and _holds(rest if word == "if" else f"{'!' * (word == 'ifndef')}defined({rest})", macros)
            taken.append((holds, holds))
            active = holds
        elif word in ("elif", "else"):
            _, before = taken.pop()
            outside = all(branch for branch, _ in taken)
            active = outside and not before and (word == "else" or _holds(rest, macros))
            taken.append((active, before or active))
        elif word == "endif":
            taken.pop()
            active = all(branch for branch, _ in taken)
        elif active and word == "undef":
            macros.pop(rest.strip(), None)
        elif active:
            _define(rest, macros)


def _define(rest: str, macros: _Macros) -> None:
    match = _DEFINITION.match(rest)
    assert match is not None
    name, parameters, body = match.groups()
    macros[name] = (None if parameters is None else tuple(each.strip() for each in parameters.split(",")), body)


def _holds(condition: str, macros: _Macros) -> bool:
    """Return whether the condition of an ``#if`` holds; a name that is no macro counts as 0."""
    text = _DEFINED.sub(lambda match: str(int(match[1] in macros)), condition)
    text = _WORD.sub("0", _expand_macros(text, macros))
    text = re.sub(r"(?<=\d)[uUlL]+\b", "", text).replace("&&", " and ").replace("||", " or ")
    return bool(eval(re.sub(r"!(?!=)", " not ", text), {"__builtins__": {}}))  # digits and operators of our own kernels


def _expand_macros(text: str, macros: _Macros, within: frozenset[str] = frozenset()) -> str:
    """Return a text with its macros in place, but those ``within`` whose expansion it stands."""
    out, position = "", 0
    while match := _WORD.search(text, position):
        name = match[0]
        out += text[position : match.start()]
        position = match.end()
        if name not in macros or name in within:
            out += name
            continue
        parameters, body = macros[name]
        if parameters is not None:
            given, position = _arguments(text, position)
            values = dict(zip(parameters, given, strict=True))
            body = _WORD.sub(lambda word, values=values: values.get(word[0], word[0]), body)  # type: ignore[misc]
        out += _expand_macros(body, macros, within | {name})
    return out + text[position:]


def _arguments(text: str, position: int) -> tuple[list[str], int]:
    """Return the arguments of a macro from its opening bracket on, and where the text goes on behind them."""
    depth, begin, arguments = 0, text.index("(", position) + 1, []
    for place in range(begin - 1, len(text)):
        depth += {"(": 1, ")": -1}.get(text[place], 0)
        if depth == 0 or (depth == 1 and text[place] == ","):
            arguments.append(text[begin:place].strip())
            begin = place + 1
        if depth == 0:
            return arguments, begin
    raise AssertionError(f"brackets do not close: {text}")


#
# Kernel programs: sources joined on the host, specialised by facts, built once per identity.
#
# Includes are expanded here with ``#line``, so that one text has one identity and compiler messages name the real
# file.
#
# What was built is kept for the next run where the driver keeps none itself. PoCL and NVIDIA's driver have caches of
# their own. Intel's has none, and takes seconds for a scene. What is kept carries its own hash: drivers do not
# survive a damaged program.

Parameters = Mapping[str, Sequence[str]]  # names of the parameters of each kernel

BUILD_OPTIONS = ("-cl-std=CL1.2", "-w")  # a program that builds has nothing to say to a user
# Of a program that compiles soonest: what is declared inline is inlined, all else are calls of small functions. PoCL
# optimises them before it generates code, until its version 6 also where the program was built without optimisation.
_QUICK = "#undef inline\n#define inline __attribute__((always_inline))\n"
_SMALL = "#pragma clang attribute push(__attribute__((minsize)), apply_to=function)\n"
_NOT_OPTIMISED = "-cl-opt-disable"
# PoCL 3.0 reads a header of 18,500 lines before each program, which takes a fifth of a build and nearly all of a small
# one. With its guard defined there is none, and `_BUILTINS` declare what kernels use.
_BUILTINS = "common/builtins.h"
_DECLARED = ("-D_OPENCL_H_", "-DDECLARES_BUILTINS")
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
    return expand([_BUILTINS], {}) + "\n".join(head) + "\n" + declarations + body + tail


def small_source(name: str) -> str:
    """Return the text of a program that needs PoCL's built-in functions and little else; ``name`` is a word."""
    text = f"__kernel void k{name}(__global float *out) {{ out[0] = sqrt(out[0]); }}\n"
    return assemble([], {}, text, library_arch=None)


def quick_source(source: str) -> str:
    """Return the text of a program that compiles sooner for PoCL, runs slower and computes the same bits."""
    return f"{_QUICK}{_SMALL}{source}#pragma clang attribute pop\n"


def options_of(device: Any, source: str) -> tuple[str, ...]:
    """Return the options that a program is built with for a pyopencl device."""
    version = re.search(r"PoCL (\d+)\.(\d+)", device.platform.version)
    if version is None:
        return BUILD_OPTIONS
    if (
        int(version[1]) >= 7
    ):  # its cache tells programs apart by these, but not by the settings that they are built with
        return (*BUILD_OPTIONS, *(f"-D{name}={int(os.environ.get(name) == '1')}" for name in AS_BEFORE_POCL_7))
    options = (*BUILD_OPTIONS, _NOT_OPTIMISED) if source.startswith(_QUICK) else BUILD_OPTIONS
    return (*options, *_DECLARED) if version[0] == "PoCL 3.0" and _BUILTINS in source else options


def source_key(files: list[str], facts: Mapping[str, int | str], declarations: str) -> tuple[Any, ...]:
    """Key a program by what its text follows from, without reading it."""
    return (kernels_dir(), *files, frozenset(facts.items()), declarations)


class Program:
    """A built program.

    Attributes
    ----------
    name : str
        See `program_name`.

    Raises
    ------
    DeviceError
        When the program does not compile: the first compiler error, and a file that holds source and log.
    """

    def __init__(self, context: Any, device: Any, source: str) -> None:
        import pyopencl as cl

        self._text = source.encode()  # half of what a string with one Greek letter takes
        self.identity = hashlib.sha256(self._text).hexdigest()
        self.name = program_name(device, source)
        self.is_noted = False  # that its code was generated
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
    def source(self) -> str:
        """OpenCL C, all of it."""
        return self._text.decode()

    @property
    def nbytes(self) -> int:
        """Bytes of its source."""
        return len(self._text)

    @property
    def is_quick(self) -> bool:
        """Whether it is one of `quick_source`."""
        return self._text.startswith(_QUICK.encode())

    @cached_property
    def parameters(self) -> Parameters:
        """The names of the parameters of each kernel, in their order."""
        return kernel_parameters(self.source)

    def figures(self, context: Any, device: Any) -> dict[str, Any]:
        """What a driver says of the program when it builds it anew, past every cache: seconds, log and kernels.

        A kernel has bytes of private and of local memory, the largest group and what group sizes are multiples of.
        NVIDIA's compiler writes the registers of each kernel into the log.
        """
        import pyopencl as cl

        source = f"{self.source}\n// {uuid.uuid4()}\n"
        verbose = ["-cl-nv-verbose"] if "cl_nv_compiler_options" in device.extensions else []
        no_cache: Any = False  # as pyopencl documents it, past its own types
        begun = time.perf_counter()
        handle = cl.Program(context, source).build([*options_of(device, source), *verbose], [device], no_cache)
        seconds = time.perf_counter() - begun
        queries = cl.kernel_work_group_info
        kinds = {name: getattr(queries, name) for name in _KERNEL_FIGURES}
        return {
            "build_seconds": seconds,
            "log": handle.get_build_info(device, cl.program_build_info.LOG).strip()[:_LONGEST_LOG],
            "kernels": {
                kernel.function_name: {
                    name.lower(): read_or_none(partial(kernel.get_work_group_info, kind, device))
                    for name, kind in kinds.items()
                }
                for kernel in handle.all_kernels()
            },
        }


_KERNEL_FIGURES = ("PRIVATE_MEM_SIZE", "LOCAL_MEM_SIZE", "WORK_GROUP_SIZE", "PREFERRED_WORK_GROUP_SIZE_MULTIPLE")
_LONGEST_LOG = 20_000  # characters


_BINARIES = Disk(
    "programs",
    pack=lambda binary: ({"binary": np.frombuffer(binary, np.uint8)}, {}),
    unpack=lambda arrays, _: arrays["binary"].tobytes(),
)


def build_program(context: Any, device: Any, source: str, options: list[str]) -> Any:
    """Return the program built of ``source`` for a pyopencl device; raises what pyopencl raises."""
    cl = load_opencl()
    from pyopencl.characterize import has_src_build_cache

    if has_src_build_cache(device):
        return cl.Program(context, source).build(options=options, devices=[device])
    name = program_name(device, source, options)
    kept: bytes | None = _BINARIES.find(name)
    if kept is not None:
        try:
            return cl.Program(context, [device], [kept]).build(options=options, devices=[device])
        except cl.Error:  # of a driver that has changed without a new version
            pass
    program = cl.Program(context, source).build(options=options, devices=[device])
    binary = bytes(program.get_info(cl.program_info.BINARIES)[0])
    _BINARIES.add(name, binary)
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
