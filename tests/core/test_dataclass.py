"""Dataclasses with late methods are those of the standard library."""

import copy
import dataclasses
import inspect
import pickle
import threading
from collections.abc import Callable
from dataclasses import field
from typing import Any

import pytest

from rptcam_cl.core.dataclass import dataclass

Decorator = Callable[..., Any]


@dataclass(frozen=True)
class Lamp:
    name: str
    power: float = 1.0
    places: list[int] = field(default_factory=list, compare=False, repr=False)

    def __post_init__(self) -> None:
        if self.power < 0:
            raise ValueError("a lamp takes no light away")


@dataclass(frozen=True)
class ColouredLamp(Lamp):
    colour: str = "white"


def make(decorator: Decorator) -> dict[str, Any]:
    """Return classes of all kinds that the program has, made by a decorator."""

    class Plain:
        a: int
        b: int = 2

    class Listed:
        a: int
        b: list[int] = field(default_factory=list, repr=False)

    class Inner:
        a: int
        b: int = field(default=2, kw_only=True)
        c: list[int] = field(default_factory=list, init=False)
        d: int = field(default=5, init=False, hash=False)

    class Own:
        a: int
        b: int = 2

        def __eq__(self, other: object) -> bool:
            return isinstance(other, Own)

        def __repr__(self) -> str:
            return "its own"

    class OwnHash:
        a: int
        b: int = 2

        def __hash__(self) -> int:
            return 7

    ways: dict[str, dict[str, bool]] = {
        "open": {}, "loose": {"eq": False}, "frozen": {"frozen": True}, "frozen thing": {"frozen": True, "eq": False},
        "silent": {"frozen": True, "repr": False}, "named": {"frozen": True, "kw_only": True},
    }  # fmt: skip
    found: dict[str, Any] = {}
    for way, options in ways.items():
        for kind in (Plain, Listed, Inner, Own, OwnHash):
            cls = type(kind.__name__, (), dict(vars(kind)) | {"__doc__": "One"})
            found[f"{way} {kind.__name__}"] = decorator(**options)(cls)
    return found


LATE, AT_ONCE = make(dataclass), make(dataclasses.dataclass)


def outcome(action: Callable[[], Any]) -> str:
    try:
        return str(action())
    except Exception as error:
        return f"{type(error).__name__}: {error}"


@pytest.mark.parametrize("name", LATE)
def test_a_late_class_does_what_that_of_the_standard_library_does(name: str) -> None:
    def results(cls: Any) -> list[str]:
        one, same, other = (cls(a=a, b=[1]) for a in (1, 1, 2))
        attempts: list[Callable[[], Any]] = [
            lambda: cls(1), lambda: cls(1, 2, 3), lambda: cls(b=[3]), lambda: cls(1, c=2), lambda: cls(1, b=4).b, cls,
            lambda: repr(one) if "repr" in vars(cls) or "its own" in repr(one) else repr(one).split(" at ")[0],
            lambda: one == same, lambda: one == other, lambda: one == 1, lambda: cls.__hash__ is None,
            lambda: cls.__hash__ is object.__hash__, lambda: hash(cls(1, 2)) == hash(cls(1, 2)),
            lambda: setattr(one, "a", 5), lambda: setattr(one, "new", 5), lambda: delattr(one, "b"), lambda: vars(one),
            lambda: dataclasses.replace(same, a=9).a, lambda: dataclasses.replace(same, d=9),
            lambda: dataclasses.asdict(same), lambda: [(each.name, each.kw_only) for each in dataclasses.fields(cls)],
            lambda: inspect.signature(cls), lambda: cls.__match_args__, lambda: vars(copy.deepcopy(same)),
            lambda: cls.__dataclass_params__.frozen,
        ]  # fmt: skip
        return [outcome(attempt).split(" object at ")[0] for attempt in attempts]

    assert results(LATE[name]) == results(AT_ONCE[name])


def test_nothing_is_compiled_before_a_method_is_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(source: str, *scopes: dict[str, object]) -> None:
        if "self" in source:  # Python 3.13 runs a text without any method for each class
            raise AssertionError("compiled")
        exec_(source, *scopes)

    exec_ = exec
    monkeypatch.setattr("builtins.exec", run)

    @dataclass(frozen=True)
    class Late:
        """One"""

        a: int

    with pytest.raises(AssertionError, match="compiled"):
        Late(1)


def test_a_class_made_of_a_late_one_takes_its_fields_first() -> None:
    lamp = ColouredLamp("key", 2.0, [1], "red")
    assert lamp == ColouredLamp("key", 2.0, [2], "red") != ColouredLamp("key", 2.0, [1], "blue")
    assert repr(lamp) == "ColouredLamp(name='key', power=2.0, colour='red')"
    with pytest.raises(ValueError, match="takes no light away"):
        ColouredLamp("key", -1.0)
    with pytest.raises(TypeError, match="non-frozen"):
        dataclasses.dataclass(type("Open", (Lamp,), {"__annotations__": {}}))


def test_late_classes_are_pickled_before_and_after_their_methods_are_made() -> None:
    lamp = Lamp("key", 2.0, [1])
    assert pickle.loads(pickle.dumps(lamp)) == lamp == copy.copy(lamp)
    assert pickle.loads(pickle.dumps(lamp)).places == [1]
    match lamp:
        case Lamp(name, power):
            assert (name, power) == ("key", 2.0)


def test_threads_that_want_a_method_together_all_get_it() -> None:
    for _ in range(50):
        cls = dataclass(frozen=True)(type("Late", (), {"__annotations__": {"a": int}, "__doc__": "One"}))
        start, found = threading.Barrier(8), []

        def construct(cls: Any = cls, start: Any = start, found: list[Any] = found) -> None:
            start.wait()
            found.append(cls(3).a)

        threads = [threading.Thread(target=construct) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert found == [3] * 8


def test_a_class_may_have_fields_of_one_base_and_methods_of_another() -> None:
    class Movable:
        def moved(self) -> str:
            return f"{self.name} elsewhere"  # type: ignore[attr-defined]

    @dataclass(frozen=True)
    class Torch(Movable, Lamp):
        battery: int = 2

    torch = Torch("a", battery=3)
    assert (torch.moved(), torch) == ("a elsewhere", Torch("a", 1.0, [4], 3))
    assert hash(torch) == hash(Torch("a", 1.0, [4], 3)) != hash(Torch("a"))
