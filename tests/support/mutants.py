"""Deliberate faults in a copy of the kernels, each of which certain tests must find.

A fault is a piece of kernel text and what replaces it; the text must occur in exactly one place, so that a kernel that
was rewritten asks for its mutant to be rewritten, too.
"""

import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rptcam_cl.device import programs


class Mutant:
    """A fault, and the tests of which each must find it."""

    def __init__(self, name: str, text: str, fault: str, *killers: Callable[..., object]) -> None:
        assert killers, f"no test finds mutant «{name}»"
        self.name, self.text, self.fault, self.killers = name, text, fault, killers


def each_mutant(mutants: Iterable[Mutant]) -> pytest.MarkDecorator:
    """Return what runs a test once for each mutant, named by it."""
    return pytest.mark.parametrize("mutant", mutants, ids=lambda mutant: mutant.name)


def place_of(text: str, folder: Path) -> Path:
    """Return the one file of kernels that a piece of text stands in."""
    holders = [path for path in folder.rglob("*.[ch]*") for _ in range(path.read_text("utf-8").count(text))]
    assert len(holders) == 1, f"«{text}» stands in {len(holders)} places of the kernels"
    return holders[0]


@contextmanager
def changed_kernels(text: str, other: str) -> Iterator[None]:
    """Build programs from a copy of the kernels in which a piece of text is another."""
    with tempfile.TemporaryDirectory() as scratch, pytest.MonkeyPatch.context() as patch:
        folder = Path(scratch) / "kernels"
        shutil.copytree(programs.kernels_dir(), folder)
        place = place_of(text, folder)
        place.write_text(place.read_text("utf-8").replace(text, other), "utf-8")
        patch.setattr(programs, "kernels_dir", lambda: folder)
        yield


def assert_found(mutant: Mutant, *given: object) -> None:
    """Fail unless each of the mutant's tests, called with what is ``given``, fails on the faulty kernels."""
    with changed_kernels(mutant.text, mutant.fault):
        assert_killed(mutant.killers, *given)


def assert_killed(killers: Iterable[Callable[..., object]], *given: object) -> None:
    """Fail unless each of the tests, called with what is ``given``, fails."""
    for killer in killers:
        with pytest.raises(AssertionError):
            killer(*given)


def assert_alive(mutants: Iterable[Mutant], *given: object) -> None:
    """Fail unless the tests of all the mutants pass on the true kernels."""
    for killer in {killer for mutant in mutants for killer in mutant.killers}:
        killer(*given)
