"""A chosen device with its context, queue and built programs; one that opens early, and several for one render."""

from __future__ import annotations

import contextlib
import copy
import math
import os
import re
import threading
import warnings
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.remember import Disk, Memory, content_name
from rptcam_cl.device import devices
from rptcam_cl.device import programs as building
from rptcam_cl.device.drivers import begin, instead, is_code_noted, load_opencl, note_code, unfinished_work
from rptcam_cl.device.programs import Parameters, Program, assemble

# A chosen device with its context, queue and built programs.

# llvmpipe is the processor as Mesa's rusticl offers it. Its compiler takes eight work items together, and counts the
# steps of all their loops in one counter; when that has reached 65535, every loop ends after its step, and the kernel
# goes on with what it has, without an error (`LP_MAX_TGSI_LOOP_ITERATIONS` in Mesa's
# `src/gallium/auxiliary/gallivm/lp_bld_limits.h`, "shared between every loop"). Kernels must get their work in pieces
# small enough.
_LLVMPIPE_LOOP_LIMIT = 65535
ORGANISATION = "RPTCAM_ORGANISATION"  # environment variable; PASSES has any device work as a GPU does, for tests
PASSES = "passes"
FEW_SAMPLES = 1 << 20  # of all pictures of a process, up to which quick programs are worth their slowness
_MOST_SOURCE = 8 << 20  # bytes of the programs that a session keeps, as PoCL has ten times as many for them
_opening = threading.Lock()


class NotKeptError(Exception):
    """The driver has to generate the code of a program; raised by sessions that `Session.built_only` returns."""


def is_llvmpipe(handle: Any) -> bool:
    """Return whether a pyopencl device is llvmpipe."""
    return bool(handle.name.startswith("llvmpipe"))


def open_session(spec: str | None = None) -> Session:
    """Return the session of the device that ``spec`` names; kept, so that its programs are built only once."""
    begin()
    with _opening:
        return _session(devices.choose_device(spec).id)


@lru_cache(maxsize=16)
def _session(device_id: str) -> Session:
    return Session(devices.choose_device(device_id))


class Launch:
    """A kernel with its arguments: bound once, enqueued many times (setting them anew costs more than a launch).

    It keeps the buffers that it is bound to, as a kernel does not.

    Parameters
    ----------
    session, program, name
        The device, what was built for it, and the kernel in it.
    arguments : dict
        A buffer, a numpy scalar or a record's bytes for every parameter of the kernel, by its name.

    Attributes
    ----------
    steps : float
        That a work item takes, where it may take many: GPUs get such work in several launches.
    group : int or None
        Work items of a group, where the kernel asks for so many.

    Raises
    ------
    DeviceError
        When the program has no such kernel.
    TypeError
        When an argument is missing, or the kernel has no parameter of its name.
    """

    def __init__(self, session: Session, program: Program, name: str, arguments: Mapping[str, Any]) -> None:
        import pyopencl as cl

        self.name, self.steps = name, 1.0
        self._session, self._program, self._enqueue = session, program, cl.enqueue_nd_range_kernel
        try:
            self._idle = program.idle_kernels(name)
            try:
                self._kernel = self._idle.pop()
            except IndexError:
                self._kernel = cl.Kernel(program.handle, name)
        except cl.Error as error:
            raise DeviceError(f"device {session.info.id} has no kernel {name} in what it built: {error}") from error
        of_group = cl.kernel_work_group_info.COMPILE_WORK_GROUP_SIZE
        self.group = self._kernel.get_work_group_info(of_group, session.info.handle)[0] or None
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
        if unknown := [name for name in arguments if name not in self._index]:
            raise TypeError(
                f"kernel {self.name} has no parameter {', '.join(unknown)} (it has {', '.join(self._index)})"
            )
        for name, value in arguments.items():
            if value is not self._arguments.get(name):
                self._kernel.set_arg(self._index[name], value)
        self._arguments |= arguments

    def enqueue(self, items: int, group: int, first: int = 0) -> Any:
        """Run over ``items`` work items from the ``first`` on, in groups of ``group``; return the event."""
        import pyopencl as cl

        try:
            event = self._enqueue(self._session.queue, self._kernel, (items,), (group,), (first,))
        except cl.Error as error:
            raise DeviceError(f"kernel {self.name} failed on device {self._session.info.id}: {error}") from error
        if not self._program.is_noted:
            self._session.launched(self._program)
        self._session.note_launch(self.name, event)
        return event


class Session:
    """Context, in-order queue and program cache of one device. Programs are built once and kept.

    Attributes
    ----------
    longest : dict
        With profiling, the longest launch of each kernel up to the last `finish` [s]; also of those that build trees.
    """

    def __init__(self, info: devices.DeviceInfo, *, profiling: bool = False) -> None:
        cl = load_opencl()
        self.info = info
        self.profiling = profiling
        wanted = os.environ.get(ORGANISATION, "")
        if wanted not in ("", PASSES):
            raise DeviceError(f"{ORGANISATION}: got {wanted}; allowed: {PASSES}, or no such variable")
        self._works_as_gpu = wanted == PASSES
        problem = devices.problem_of(info)
        if problem is not None:
            raise DeviceError(f"device {info.id} {info.name} cannot be used: {problem}; {instead()}")
        try:
            self.context = cl.Context([info.handle])
            self.queue = self._new_queue()
        except cl.Error as error:
            raise DeviceError(f"device {info.id} {info.name} cannot be used: {error}") from error
        self._library_arch = devices.try_device(info.handle).library_arch
        self._programs: Memory[Program] = Memory(most_bytes=_MOST_SOURCE)
        self._building = threading.Lock()
        self._launched: list[Program] = []  # whose code is not noted
        self._events: list[tuple[str, Any]] = []  # of launches that may not have run
        self.longest: dict[str, float] = {}
        self._foreseen: dict[str, Program] = {}  # by their sources
        self.is_quick = self._takes_built_only = False  # see `quick`, `built_only`
        self._few_left = [FEW_SAMPLES]  # the same list in every copy

    @property
    def kind(self) -> str:
        """How the work is cut up for the device: "cpu" or "gpu".

        Mesa's llvmpipe runs on a processor, but its compiler takes work items together as that of a GPU does.
        With `ORGANISATION` in the environment a processor is given its work so, too: tests see what a GPU would get.
        """
        return "gpu" if self._works_as_gpu or is_llvmpipe(self.info.handle) else self.info.type

    @property
    def generates_late(self) -> bool:
        """Whether the driver generates the code of a kernel when it is launched first, and runs nothing meanwhile."""
        return devices.is_pocl(self.info.handle)

    @property
    def loop_limit(self) -> int | None:
        """Steps that all loops of a work item may take together; None where they may take as many as they like."""
        return _LLVMPIPE_LOOP_LIMIT if is_llvmpipe(self.info.handle) else None

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
        return 16 if self._library_arch == devices.AVX512_ARCH else 8

    @property
    def group(self) -> int:
        """Work items per group that suit the device; small groups spread evenly over few cores.

        PoCL compiles a group as a loop. Without one its compiler takes up to 0.3 less time, and with 16 lanes per item
        three spheres, a lens, a Cornell box and meshes render in 0.98, 0.93, 0.94 and 0.94 of the time of groups of 4.
        A multiprocessor of NVIDIA's compute capability 8.6 holds 16 groups at most, and 48 warps: not by groups of 64.
        """
        if self.kind == "gpu":
            return 128 if "NVIDIA" in self.info.platform else 64
        return 1 if devices.is_pocl(self.info.handle) else 4

    def program(self, files: list[str], facts: Mapping[str, int | str], declarations: str) -> Program:
        """Return the program made of ``files`` under ``kernels/``, specialised by ``facts``; built at first use.

        Raises
        ------
        DeviceError
            When it does not compile.
        NotKeptError
            See `built_only`.
        """
        key = building.source_key(files, facts, declarations)
        keys = [key, ("quick", *key)] if self.is_quick else [key]
        for each in keys:
            known: Program | None = self._programs.find(each)
            if known is not None:
                return known
        source = assemble(files, facts, declarations, library_arch=self._library_arch)
        if (self._takes_built_only or self.is_quick) and not is_code_noted(
            building.program_name(self.info.handle, source)
        ):
            if self._takes_built_only:
                raise NotKeptError
            key, source = keys[1], building.quick_source(source)
        with self._building, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pyopencl reports any text in a build log
            program = self._programs.find(key) or self._foreseen.pop(source, None) or self._built(source)
        self._programs.add(key, program)
        return program

    def _built(self, source: str) -> Program:
        if self.generates_late:
            devices.build_apart(self.info.handle, source, building.options_of(self.info.handle, source))
        return Program(self.context, self.info.handle, source)

    @property
    def programs(self) -> list[Program]:
        """Those that were requested and are kept."""
        return self._programs.values()

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
        if self.generates_late and not devices.builds_apart(self.info.handle):
            self._built(building.small_source(name))

    def beside(self) -> Session:
        """Return a session of the same device, buffers and programs with a queue of its own, for another thread."""
        other = copy.copy(self)
        other.queue = self._new_queue()
        other._launched, other._events = [], []
        return other

    def alone(self) -> Session:
        """Return a session as `beside`, whose programs are not among those of this one."""
        other = self.beside()
        other._programs = Memory(most_bytes=_MOST_SOURCE)
        return other

    def quick(self) -> Session:
        """Return this session with quick programs in place of those whose code the driver has to generate.

        They compile in 0.4 to 0.55 of the time and run at 0.5 to 0.7 of the speed. What they compute is the same.
        """
        other = copy.copy(self)
        other.is_quick = self.generates_late
        return other

    def for_samples(self, samples: int) -> Session:
        """Choose the session that renders a picture soonest: `quick` where all so far have few samples."""
        self._few_left[0] -= samples
        return self.quick() if self._few_left[0] >= 0 else self

    def built_only(self) -> Session:
        """Return this session, but with no programs save those whose code the driver need not generate.

        These are built here or noted in PoCL's cache. Of others it raises a NotKeptError.
        """
        other = copy.copy(self)
        other._takes_built_only = self.generates_late
        return other

    def _new_queue(self) -> Any:
        import pyopencl as cl

        options = {"properties": cl.command_queue_properties.PROFILING_ENABLE} if self.profiling else {}
        return cl.CommandQueue(self.context, self.info.handle, **options)

    def note_launch(self, name: str, event: Any) -> None:
        """Keep the event of a launch until it has run, where launches are timed."""
        if self.profiling:
            self._events.append((name, event))

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
        return self._allocate(lambda: cl.Buffer(self.context, flags, hostbuf=np.ascontiguousarray(array)), array.nbytes)

    def allocate(self, nbytes: int, *, zeroed: bool = False, spare: list[NDArray[np.uint8]] | None = None) -> Any:
        """Return a read-write buffer of ``nbytes``, optionally filled with zeros.

        With ``spare`` a device that shares the host's memory takes numpy's, whose large pages are there sooner: an
        array of that list, to which it returns when nobody has the buffer any longer, so that few pages are new; those
        that do not suit leave it. Kernels must not take it for aligned to more than 16 bytes.
        """
        import pyopencl as cl

        flags = cl.mem_flags
        if spare is not None and self.info.type == "cpu":
            kinds, memory = flags.READ_WRITE | flags.USE_HOST_PTR, spare.pop() if spare else None
            if memory is None or not nbytes <= memory.nbytes < 2 * nbytes:
                memory = np.empty(nbytes, np.uint8)
            held = memory[:nbytes]  # by the buffer alone
            buffer = self._allocate(lambda: cl.Buffer(self.context, kinds, hostbuf=held), nbytes)
            weakref.finalize(held, spare.append, memory).atexit = False
        else:
            buffer = self._allocate(lambda: cl.Buffer(self.context, flags.READ_WRITE, nbytes), nbytes)
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

    def _allocate(self, make: Any, nbytes: int) -> Any:
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
        for name, event in self._events:
            self.longest[name] = max(self.longest.get(name, 0.0), (event.profile.end - event.profile.start) * 1e-9)
        self._events.clear()

    @contextmanager
    def _named_failures(self) -> Iterator[None]:
        """Raise a DeviceError for a device that has stopped, and in a process without its driver."""
        import pyopencl as cl

        begin()
        try:
            yield
        except cl.Error as error:
            raise DeviceError(f"device {self.info.id} {self.info.name} stopped: {error}") from error


#
# The device opened by a thread, while the rest of the program is imported and the scene is read.
#
# A driver takes its time outside Python's lock: to start, to be tried, and to build what the same command had built
# the last time, which is kept. For a command that is new, PoCL reads its library of built-in functions meanwhile,
# which takes it 0.4 s in every process that compiles.
#
# Nothing fails here: what goes wrong does so again where it is wanted, and is reported there.

_Built = list[tuple[str, Parameters]]  # sources, and the names of their kernels' parameters

OPENING = "opening the device"  # name of the thread
_DISK = Disk("commands", ("device",))
_MOST_CHARACTERS = 4 << 20  # of all sources of a command


def open_early(spec: str | None, *command: object) -> Callable[[], None]:
    """Open the device that ``spec`` names in a thread; return what is to be called when the command has ended well.

    All that is imported for it is imported here: two threads that import the same packages can get in each other's way.

    Parameters
    ----------
    command
        What tells commands that build other programs apart; without it, the device is opened and nothing built.
    """
    key = (spec, *command)
    built: _Built = [(source, names) for source, names in _DISK.find(key, [])] if command else []
    try:
        devices.prepare_trial()
        from pyopencl import characterize  # noqa: F401 -- wanted by the first build
    except (DeviceError, ImportError):
        return lambda: None
    name = content_name(key) if command else ""
    threading.Thread(target=_open, args=(spec, name, built), name=OPENING, daemon=True).start()
    return lambda: _keep_built(key, built)


def _open(spec: str | None, name: str, built: _Built) -> None:
    with unfinished_work(), contextlib.suppress(Exception):  # whatever a driver may raise
        session = open_session(spec)
        if built:
            session.foresee(built)
        elif name:
            session.read_library(name)


def _keep_built(key: tuple[Any, ...], before: _Built) -> None:
    """Keep what was built, where that is not what was built before."""
    devices.end_trials()
    programs = open_session(key[0]).programs
    if [program.source for program in programs] == [source for source, _ in before]:
        return
    if sum(len(program.source) for program in programs) <= _MOST_CHARACTERS:
        _DISK.add(key, [(program.source, program.parameters) for program in programs])


# Several devices for one render: which ones are meant, and what share of the work each is to have.

Split = str | Mapping[str, float]
Wanted = str | Session | Sequence[str | Session] | None

ROUNDING = 0.005  # that the sum of the shares may be off by, as that of 0.333, 0.333 and 0.333
_EXAMPLE = "--split 0:0=0.7,1:0=0.3"


def open_sessions(wanted: Wanted = None, split: Split | None = None) -> tuple[list[Session], list[float] | None]:
    """Return the sessions of the devices that are to share a render, and their shares where they are given.

    Parameters
    ----------
    wanted
        One device or several, each as `choose_device` takes it or as a session; ``"all"`` is every device that builds
        a kernel. None: those that ``split`` names, else what the environment says.
    split
        Shares by device, which add up to 1: a mapping, or text as ``0:0=0.7,1:0=0.3``.

    Raises
    ------
    DeviceError
        A device that is unknown, unusable or named twice, or shares that are not those of the devices.
    """
    shares = None if split is None else _shares(split)
    if wanted is None and shares is not None:
        wanted = list(shares)
    sessions = _open_all(wanted)
    seen: set[str] = set()
    for session in sessions:
        if session.info.id in seen:
            raise DeviceError(f"--device: {session.info.id} {session.info.name} twice (name each device once)")
        seen.add(session.info.id)
    return sessions, None if shares is None else _in_order(shares, sessions)


def means_all(wanted: Wanted) -> bool:
    """Return whether `all` devices were requested rather than named ones; one that cannot begin is then left out."""
    if wanted is None:
        return devices.several_of_environment() == [devices.ALL]
    return not isinstance(wanted, Session) and devices.ALL in ([wanted] if isinstance(wanted, str) else wanted)


def means_one(wanted: str | None, split: Split | None = None) -> bool:
    """Return whether a single device is meant, whichever it is."""
    if wanted is None:
        return split is None and devices.several_of_environment() is None
    return devices.parse_devices(wanted) == [wanted.strip()] and wanted.strip() != devices.ALL


def _open_all(wanted: Wanted) -> list[Session]:
    if isinstance(wanted, Session):
        return [wanted]
    if wanted is None:
        wanted = devices.several_of_environment()
        if wanted is None:
            return [open_session(None)]
    entries = [wanted] if isinstance(wanted, str) else list(wanted)
    if not entries:
        raise DeviceError("--device: no device is named (allowed: one or more, or none to have one chosen)")
    words: list[str | Session] = []
    for entry in entries:
        words += devices.parse_devices(entry) if isinstance(entry, str) else [entry]
    if devices.ALL in words:
        if len(words) > 1:
            raise DeviceError("--device: 'all' stands alone (or name the devices)")
        return [open_session(info.id) for info in _usable_devices()]
    return [word if isinstance(word, Session) else open_session(word) for word in words]


def _usable_devices() -> list[devices.DeviceInfo]:
    """Return every device that builds a kernel, with a warning for each that does not.

    Raises
    ------
    DeviceError
        When none does.
    """
    usable, reasons = [], []
    for info in devices.list_devices():
        problem = devices.problem_of(info)
        if problem is None:
            usable.append(info)
        else:
            reasons.append(f"device {info.id} {info.name} cannot be used: {problem}")
    if not usable:
        raise DeviceError(f"{'; '.join(reasons)}; {instead()}")
    for reason in reasons:
        warnings.warn(f"{reason}; it is left out", UserWarning, stacklevel=2)
    return usable


def _shares(split: Split) -> dict[str, float]:
    """Return the shares by the names that were given, in their order."""
    if isinstance(split, str):
        pairs = [part.rpartition("=") for part in split.split(",")]
        given = [(name.strip(), share.strip()) for name, _, share in pairs]
    else:
        given = [(str(name).strip(), str(share)) for name, share in split.items()]
    shares: dict[str, float] = {}
    for name, text in given:
        share = float(text) if re.fullmatch(r"[0-9.]*[0-9][0-9.]*(e-?\d+)?", text) and text.count(".") < 2 else math.nan
        if not name or not 0 < share <= 1:
            what = f"{name}={text}" if name else text
            raise DeviceError(
                f"--split: got {what}; allowed a device and its share, above 0 and up to 1, as {_EXAMPLE}"
            )
        if name in shares:
            raise DeviceError(f"--split: {name} twice (give each device one share)")
        shares[name] = share
    total = math.fsum(shares.values())
    if abs(total - 1) > ROUNDING:
        raise DeviceError(f"--split: the shares add up to {total:g} (allowed: 1, as {_EXAMPLE})")
    return shares


def _in_order(shares: Mapping[str, float], sessions: Sequence[Session]) -> list[float]:
    """Return the shares in the order of the sessions."""
    by_id: dict[str, float] = {}
    for name, share in shares.items():
        identity = name if any(session.info.id == name for session in sessions) else devices.choose_device(name).id
        if identity in by_id:
            raise DeviceError(f"--split: {name} is {identity}, which has a share already (give each device one share)")
        by_id[identity] = share
    chosen = [session.info.id for session in sessions]
    if unknown := [identity for identity in by_id if identity not in chosen]:
        raise DeviceError(
            f"--split: {', '.join(unknown)} is not among the devices of this render, {', '.join(chosen)}"
            " (name the same devices in --device, or leave --device out)"
        )
    if missing := [identity for identity in chosen if identity not in by_id]:
        raise DeviceError(f"--split: no share for device {', '.join(missing)} (give every device one, as {_EXAMPLE})")
    return [by_id[identity] for identity in chosen]
