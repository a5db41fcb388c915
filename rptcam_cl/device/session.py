"""A chosen device with its context, queue and built programs."""

from __future__ import annotations

import copy
import threading
import warnings
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.choose import choose_device
from rptcam_cl.device.devices import DeviceInfo, problem_of
from rptcam_cl.device.opencl import instead, load_opencl
from rptcam_cl.device.pocl_cache import is_code_noted, note_code
from rptcam_cl.device.program import Parameters, Program, assemble, options_of, program_name, quick_source, source_key
from rptcam_cl.device.trial import AVX512_ARCH, build_apart, builds_apart, is_pocl, try_device

# llvmpipe is the processor as Mesa's rusticl offers it. Its compiler takes eight work items together, and counts the
# steps of all their loops in one counter; when that has reached 65535, every loop ends after its step, and the kernel
# goes on with what it has, without an error (`LP_MAX_TGSI_LOOP_ITERATIONS` in Mesa's
# `src/gallium/auxiliary/gallivm/lp_bld_limits.h`, "shared between every loop"). Kernels must get their work in pieces
# small enough.
LLVMPIPE_LOOP_LIMIT = 65535
FEW_SAMPLES = 1 << 20  # of all pictures of a process, up to which quick programs are worth their slowness
MOST_PROGRAMS = 48  # that a session keeps; those used longest ago are let go
_opening = threading.Lock()


class NotKeptError(Exception):
    """The driver has to generate the code of a program; raised by sessions that `Session.kept_only` returns."""


def is_llvmpipe(handle: Any) -> bool:
    """Return whether a pyopencl device is llvmpipe."""
    return bool(handle.name.startswith("llvmpipe"))


def open_session(spec: str | None = None) -> Session:
    """Return the session of the device that ``spec`` names; kept, so that its programs are built only once."""
    with _opening:
        return _session(choose_device(spec).id)


@lru_cache(maxsize=16)
def _session(device_id: str) -> Session:
    return Session(choose_device(device_id))


class Launch:
    """A kernel with its arguments: bound once, enqueued many times (setting them anew costs more than a launch).

    It keeps the buffers that it is bound to, as a kernel does not.

    Parameters
    ----------
    session, program, name
        The device, what was built for it, and the kernel in it.
    arguments : dict
        A buffer, a numpy scalar or a record's bytes for every parameter of the kernel, by its name.

    Raises
    ------
    DeviceError
        When the program has no such kernel.
    TypeError
        When an argument is missing, or the kernel has no parameter of its name.
    """

    def __init__(self, session: Session, program: Program, name: str, arguments: Mapping[str, Any]) -> None:
        import pyopencl as cl

        self.name = name
        self._session, self._program = session, program
        self._enqueue = cl.enqueue_nd_range_kernel
        try:
            self._idle = program.idle_kernels(name)
            try:
                self._kernel = self._idle.pop()
            except IndexError:
                self._kernel = cl.Kernel(program.handle, name)
        except cl.Error as error:
            raise DeviceError(f"device {session.info.id} has no kernel {name} in what it built: {error}") from error
        self._index = {parameter: index for index, parameter in enumerate(program.parameters[name])}
        assert len(self._index) == self._kernel.num_args, f"kernel {name}: its parameters were not read as they are"
        self._arguments: dict[str, Any] = {}
        if missing := [parameter for parameter in self._index if parameter not in arguments]:
            raise TypeError(f"kernel {name}: no argument for {', '.join(missing)}")
        self.set(**arguments)

    def __del__(self) -> None:
        if hasattr(self, "_kernel"):
            self._idle.append(self._kernel)

    def set(self, **arguments: Any) -> None:
        """Replace arguments, given by the names of the kernel's parameters.

        Raises
        ------
        TypeError
            When the kernel has no parameter of a name; none is replaced then.
        """
        if strangers := [name for name in arguments if name not in self._index]:
            raise TypeError(
                f"kernel {self.name} has no parameter {', '.join(strangers)} (it has {', '.join(self._index)})"
            )
        for name, value in arguments.items():
            if value is not self._arguments.get(name):
                self._kernel.set_arg(self._index[name], value)
        self._arguments |= arguments

    def enqueue(self, items: int, group: int) -> Any:
        """Run over ``items`` work items in groups of ``group``; return the event."""
        import pyopencl as cl

        try:
            event = self._enqueue(self._session.queue, self._kernel, (items,), (group,))
        except cl.Error as error:
            raise DeviceError(f"kernel {self.name} failed on device {self._session.info.id}: {error}") from error
        if not self._program.is_noted:
            self._session.launched(self._program)
        return event


class Session:
    """Context, in-order queue and program cache of one device. Programs are built once and kept."""

    def __init__(self, info: DeviceInfo, *, profiling: bool = False) -> None:
        cl = load_opencl()
        self.info = info
        self.profiling = profiling
        problem = problem_of(info)
        if problem is not None:
            raise DeviceError(f"device {info.id} {info.name} cannot be used: {problem}; {instead()}")
        try:
            self.context = cl.Context([info.handle])
            options = {"properties": cl.command_queue_properties.PROFILING_ENABLE} if profiling else {}
            self.queue = cl.CommandQueue(self.context, info.handle, **options)
        except cl.Error as error:
            raise DeviceError(f"device {info.id} {info.name} cannot be used: {error}") from error
        self._library_arch = try_device(info.handle).library_arch
        self._programs: OrderedDict[tuple[Any, ...], Program] = OrderedDict()
        self._finding, self._building = threading.Lock(), threading.Lock()
        self._launched: list[Program] = []  # whose code is not noted
        self._foreseen: dict[str, Program] = {}  # by their sources
        self.is_quick = self._takes_kept_only = False  # see `quick`, `kept_only`
        self._few_left = [FEW_SAMPLES]  # the same list in every copy

    @property
    def kind(self) -> str:
        """How the work is cut up for the device: "cpu" or "gpu".

        Mesa's llvmpipe runs on a processor, but its compiler takes work items together as that of a GPU does.
        """
        return "gpu" if is_llvmpipe(self.info.handle) else self.info.type

    @property
    def generates_late(self) -> bool:
        """Whether the driver generates the code of a kernel when it is launched first, and runs nothing meanwhile."""
        return is_pocl(self.info.handle)

    @property
    def loop_limit(self) -> int | None:
        """Steps that all loops of a work item may take together; None where they may take as many as they like."""
        return LLVMPIPE_LOOP_LIMIT if is_llvmpipe(self.info.handle) else None

    @property
    def largest_buffer_bytes(self) -> int:
        """How large a buffer may be; a driver offers a quarter of its memory at least."""
        return int(self.info.handle.max_mem_alloc_size)

    @property
    def lanes(self) -> int:
        """Lanes per work item that suit the device: a register's on CPUs, 8 or, with AVX-512, 16; 1 on GPUs.

        PoCL's compiler is known by its processor, others say what their registers hold.

        Measured with AVX-512: 16 render three spheres 1.2 times as fast as 8, a Cornell box and meshes as fast.
        """
        if self.kind != "cpu":
            return 1
        if self._library_arch is None:
            return 16 if self.info.handle.native_vector_width_float >= 16 else 8
        return 16 if self._library_arch == AVX512_ARCH else 8

    @property
    def group(self) -> int:
        """Work items per group that suit the device; small groups spread evenly over few cores.

        PoCL compiles a group as a loop. Without one its compiler takes up to 0.3 less time, and with 16 lanes per item
        three spheres, a lens, a Cornell box and meshes render in 0.98, 0.93, 0.94 and 0.94 of the time of groups of 4.
        """
        if self.kind == "gpu":
            return 64
        return 1 if is_pocl(self.info.handle) else 4

    def program(self, files: list[str], facts: Mapping[str, int | str], declarations: str) -> Program:
        """Return the program made of ``files`` under ``kernels/``, specialised by ``facts``; built at first use.

        Raises
        ------
        DeviceError
            When it does not compile.
        NotKeptError
            See `kept_only`.
        """
        key = source_key(files, facts, declarations)
        keys = [key, ("quick", *key)] if self.is_quick else [key]
        for each in keys:
            if (known := self._known_program(each)) is not None:
                return known
        source = assemble(files, facts, declarations, library_arch=self._library_arch)
        if (self._takes_kept_only or self.is_quick) and not is_code_noted(program_name(self.info.handle, source)):
            if self._takes_kept_only:
                raise NotKeptError
            key, source = keys[1], quick_source(source)
        with self._building, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pyopencl reports any text in a build log
            program = self._known_program(key) or self._foreseen.pop(source, None) or self._built(source)
        with self._finding:
            self._programs[key] = program
            while len(self._programs) > MOST_PROGRAMS:
                self._programs.popitem(last=False)
        return program

    def _built(self, source: str) -> Program:
        if self.generates_late:
            build_apart(self.info.handle, source, options_of(self.info.handle, source))
        return Program(self.context, self.info.handle, source)

    @property
    def programs(self) -> list[Program]:
        """Those that were requested and are kept."""
        with self._finding:
            return list(self._programs.values())

    def foresee(self, programs: Iterable[tuple[str, Parameters]]) -> None:
        """Build programs that will be requested, in another thread than the one that does so.

        Parameters
        ----------
        programs
            Source and `Program.parameters` of each.
        """
        for source, parameters in programs:
            with self._building:
                if all(program.source != source for program in self.programs):
                    self._foreseen[source] = self._built(source)
                    self._foreseen[source].parameters = parameters

    def read_library(self, name: str) -> None:
        """Let PoCL read its built-in functions, which it does for the first program that its cache does not have.

        Parameters
        ----------
        name
            A word that no program before had.
        """
        if self.generates_late and not builds_apart(self.info.handle):
            self._built(f"__kernel void k{name}(__global float *out) {{ out[0] = sqrt(out[0]); }}\n")

    def _known_program(self, key: tuple[Any, ...]) -> Program | None:
        with self._finding:
            if key in self._programs:
                self._programs.move_to_end(key)
            return self._programs.get(key)

    def beside(self) -> Session:
        """Return a session of the same device, buffers and programs with a queue of its own, for another thread."""
        import pyopencl as cl

        other = copy.copy(self)
        other.queue = cl.CommandQueue(self.context, self.info.handle)
        other._launched = []
        return other

    def alone(self) -> Session:
        """Return a session as `beside`, whose programs are not among those of this one."""
        other = self.beside()
        other._programs = OrderedDict()
        return other

    def quick(self) -> Session:
        """Return this session with quick programs in place of those whose code the driver has to generate.

        They compile in 0.4 to 0.55 of the time and run at 0.5 to 0.7 of the speed. What they compute is the same.
        """
        other = copy.copy(self)
        other.is_quick = self.generates_late
        return other

    def for_samples(self, samples: int) -> Session:
        """Return what renders a picture soonest: `quick` where all pictures so far have few samples."""
        self._few_left[0] -= samples
        return self.quick() if self._few_left[0] >= 0 else self

    def kept_only(self) -> Session:
        """Return this session, but with no programs save those whose code the driver need not generate.

        These are built here or noted in PoCL's cache. Of others it raises a NotKeptError.
        """
        other = copy.copy(self)
        other._takes_kept_only = self.generates_late
        return other

    def launched(self, program: Program) -> None:
        """Note, once it has run, that the driver has the code of a program."""
        program.is_noted = True
        if self.generates_late:
            self._launched.append(program)

    def _note_code(self) -> None:
        """Note the code of what was launched and has run."""
        while self._launched:
            note_code(self._launched.pop().name)

    def upload(self, array: NDArray[Any], *, in_place: bool = False) -> Any:
        """Return a read-only buffer that holds ``array``.

        With ``in_place`` a device that shares the host's memory reads the array where it is: it must not change, and
        kernels must not take it for aligned to more than 16 bytes, which is what numpy gives.
        """
        import pyopencl as cl

        in_place = in_place and self.info.type == "cpu" and array.flags.c_contiguous
        flags = cl.mem_flags.READ_ONLY | (cl.mem_flags.USE_HOST_PTR if in_place else cl.mem_flags.COPY_HOST_PTR)
        return self._allocated(
            lambda: cl.Buffer(self.context, flags, hostbuf=np.ascontiguousarray(array)), array.nbytes
        )

    def allocate(self, nbytes: int, *, zeroed: bool = False) -> Any:
        """Return a read-write buffer of ``nbytes``, optionally filled with zeros."""
        import pyopencl as cl

        buffer = self._allocated(lambda: cl.Buffer(self.context, cl.mem_flags.READ_WRITE, nbytes), nbytes)
        if zeroed:
            self.fill_zero(buffer, nbytes)
        return buffer

    def write(self, buffer: Any, array: NDArray[Any]) -> None:
        """Copy ``array`` to the start of ``buffer``."""
        import pyopencl as cl

        with self._named_failures():
            cl.enqueue_copy(self.queue, buffer, array)

    def fill_zero(self, buffer: Any, nbytes: int) -> None:
        """Enqueue filling the first ``nbytes`` of a buffer with zeros."""
        import pyopencl as cl

        with self._named_failures():
            cl.enqueue_fill_buffer(self.queue, buffer, np.zeros(1, np.uint32), 0, nbytes)

    def _allocated(self, make: Any, nbytes: int) -> Any:
        import pyopencl as cl

        try:
            return make()
        except (cl.Error, cl.MemoryError) as error:
            why = str(error).rpartition(": ")[2]
            size = f"{nbytes / 2**30:.3g} GiB" if nbytes >= 2**30 else f"{nbytes / 2**20:.3g} MiB"
            raise DeviceError(f"device {self.info.id} refused a buffer of {size} ({why})") from error

    def read(self, buffer: Any, dtype: Any, count: int) -> NDArray[Any]:
        """Return the first ``count`` items of ``buffer`` once everything enqueued has run."""
        import pyopencl as cl

        out = np.empty(count, dtype)
        with self._named_failures():
            cl.enqueue_copy(self.queue, out, buffer)
        self._note_code()
        return out

    def bind(self, program: Program, kernel: str, /, **arguments: Any) -> Launch:
        """Return a kernel of ``program`` with its arguments in place, which are given by name; see `Launch`."""
        return Launch(self, program, kernel, arguments)

    def finish(self) -> None:
        """Wait until everything enqueued has run."""
        with self._named_failures():
            self.queue.finish()
        self._note_code()

    @contextmanager
    def _named_failures(self) -> Iterator[None]:
        """Raise a DeviceError for a device that has stopped."""
        import pyopencl as cl

        try:
            yield
        except cl.Error as error:
            raise DeviceError(f"device {self.info.id} {self.info.name} stopped: {error}") from error
