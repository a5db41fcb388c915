"""The command line, as ``rptcam`` and as ``python -m rptcam_cl``."""

import atexit
import codecs
import gc
import io
import os
import signal
import sys

LITTER = 150_000  # objects more than before at which cycles are looked for; what a render imports is fewer
QUICK_TO_START = {
    # Else numpy's threads for linear algebra wait for one another with the processor on: beside other work a fit of 400
    # terms to 9000 rays takes 3 to 8 s of it with two, and 0.5 s with one; and its last bits go by their number.
    "OPENBLAS_NUM_THREADS": "1",
    "PYDANTIC_DISABLE_PLUGINS": "__all__",  # else it reads what every installed package has to offer
}


def run() -> int:
    """Run the command of the process's words and return its exit code.

    Until all is imported, an interrupt ends the process at once and in silence: nothing is begun that could be lost.
    Its end does not take apart what the process has in memory, which the system takes back sooner.
    """
    _open_closed_streams()
    command = None
    if os.environ.get("RPTCAM_RESIDENT") and sys.argv[1:2] != ["resident"]:
        from rptcam_cl.core.errors import InputError
        from rptcam_cl.core.resident import Command

        try:
            command = Command.begun()
        except InputError as problem:
            print(f"error: {problem}", file=sys.stderr)
            return problem.exit_code
        if command is not None and (code := command.run_there()) is not None:
            return code
    python_interrupt = signal.getsignal(signal.SIGINT)
    if python_interrupt is signal.default_int_handler:  # else the caller ignores it, as a shell for what ends with `&`
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    ended_with = _prepare()
    from rptcam_cl.cli import main

    signal.signal(signal.SIGINT, python_interrupt)
    code = main()
    if command is not None:
        command.leave_resident()
    ended_with.append(code)
    return code


def stay(minutes: float) -> int:
    """Be the resident process; in each that it forks for a command, return that one's exit code."""
    from rptcam_cl.core.resident import Resident

    resident = Resident()
    ended_with = _prepare()
    from rptcam_cl.api import job  # noqa: F401 -- what most commands import
    from rptcam_cl.cli import main, render  # noqa: F401
    from rptcam_cl.core.files import example_scenes
    from rptcam_cl.device.drivers import import_binding
    from rptcam_cl.rendering.plan.plan import make_plan
    from rptcam_cl.scene.load import load_scene

    import_binding()
    make_plan(load_scene(example_scenes()["colour_chart"]))  # so that the schema of scenes is there, and much else
    resident.serve(minutes)
    ended_with.append(main())
    return ended_with[0]


def _prepare() -> list[int]:
    """Set what is to be set before anything else is imported; return the list that the exit code goes into."""
    ended_with: list[int] = []
    atexit.register(_leave, ended_with)  # the first, so that it comes last
    gc.set_threshold(LITTER, 20, 20)
    codecs.register_error(_ESCAPES, _escaped)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors=_ESCAPES)
    for name, value in QUICK_TO_START.items():
        os.environ.setdefault(name, value)
    return ended_with


def _open_closed_streams() -> None:
    """Open what the caller has closed, as by ``2>&-``; else the next file would get its number and what is said.

    Standard output that was closed takes no writing, so that data does not vanish in silence.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_WRONLY if name == "stderr" else os.O_RDONLY)
            if opened != number:  # as where one before it is in use again
                os.dup2(opened, number)
                os.close(opened)
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "r" if name == "stdin" else "w", errors="backslashreplace"))


_ESCAPES = "escapes"


def _escaped(problem: UnicodeError) -> tuple[str, int]:
    """Write what the encoding of a stream lacks as JSON has it, so that JSON stays JSON: a degree as ``\\u00b0``."""
    if not isinstance(problem, UnicodeEncodeError):
        raise problem
    units = problem.object[problem.start : problem.end].encode("utf-16-be", "surrogatepass").hex()
    return "".join("\\u" + units[k : k + 4] for k in range(0, len(units), 4)), problem.end


def _leave(ended_with: list[int]) -> None:
    """End the process, after all that was to be done at its end; where a command has not ended, Python goes on."""
    if ended_with:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        except OSError:  # Python says what is wrong
            return
        os._exit(ended_with[0])


if __name__ == "__main__":
    sys.exit(run())
