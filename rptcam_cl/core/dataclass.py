"""Dataclasses whose methods are made when they are wanted first.

`dataclasses` compiles six methods of a frozen class, which takes it half a millisecond. The program has hundreds
of classes, and a render has instances of a few: the others were a ninth of the processor time of its start.
"""

from __future__ import annotations

import copy
import dataclasses
import inspect
import re
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, Concatenate, NoReturn, ParamSpec, Self, TypeVar, dataclass_transform, overload

Class = TypeVar("Class", bound=type)


@overload
def dataclass(cls: Class, /) -> Class: ...
@overload
def dataclass(
    *, frozen: bool = False, eq: bool = True, repr: bool = True, kw_only: bool = False
) -> Callable[[Class], Class]: ...
@dataclass_transform(field_specifiers=(dataclasses.field,))
def dataclass(cls: Any = None, /, **options: bool) -> Any:
    """Return a class as `dataclasses.dataclass` does, but with ``__init__`` and its like made at their first use."""
    return _dataclass(cls, options) if cls is not None else lambda cls: _dataclass(cls, options)


def _dataclass(cls: type, options: dict[str, bool]) -> type:
    frozen, eq = options.get("frozen", False), options.get("eq", True)
    derived = any(map(dataclasses.is_dataclass, cls.__bases__))
    if derived and not frozen:
        return dataclasses.dataclass(**options)(cls)
    # a frozen class has no base that is not, and none that is not has a frozen one
    only_fields = options | {"init": False, "repr": False, "eq": False, "frozen": derived}
    own = {name for name, value in vars(cls).items() if value is not None}  # no hash goes with an own __eq__
    dataclasses.dataclass(**only_fields)(cls)
    for name, is_wanted in (
        ("__init__", True), ("__repr__", options.get("repr", True)), ("__eq__", eq), ("__hash__", eq and frozen),
    ):  # fmt: skip
        if is_wanted and name not in own:
            setattr(cls, name, _Late(cls, name, frozen=frozen))
    if eq and not frozen and "__hash__" not in own:
        cls.__hash__ = None  # type: ignore[assignment]
    if frozen:
        cls.__setattr__ = _refuse_to_set  # type: ignore[method-assign, assignment]
        cls.__delattr__ = _refuse_to_delete  # type: ignore[method-assign, assignment]
        cls.__dataclass_params__.frozen = True  # type: ignore[attr-defined]
    return cls


class _Late:
    """A method that, when it is looked up first, puts the function that it stands for in its own place."""

    def __init__(self, cls: type, name: str, *, frozen: bool) -> None:
        self._cls, self._name, self._frozen = cls, name, frozen

    def __get__(self, instance: object, owner: type | None = None) -> Any:
        made = (
            _init(self._cls, frozen=self._frozen) if self._name == "__init__" else _make_method(self._cls, self._name)
        )
        setattr(self._cls, self._name, made)
        return getattr(owner if instance is None else instance, self._name)


class _Factory:
    def __repr__(self) -> str:
        return "<factory>"


_FACTORY = _Factory()


def _init(cls: Any, *, frozen: bool) -> Any:
    """Return the ``__init__`` of a class; `dataclasses` cannot make it alone where the class is frozen."""
    scope: dict[str, Any] = {"_FACTORY": _FACTORY, "_set": object.__setattr__}
    words, lines, types = ["self"], [], {}
    fields = sorted(dataclasses.fields(cls), key=lambda each: bool(each.kw_only))
    for each in fields:
        name, value = each.name, each.name
        if each.default_factory is not dataclasses.MISSING:
            scope[f"_default_{name}"], default = each.default_factory, "=_FACTORY"
            value = f"_default_{name}() if {name} is _FACTORY else {name}" if each.init else f"_default_{name}()"
        else:
            scope[f"_default_{name}"], default = each.default, f"=_default_{name}"
        if each.init:
            words += ["*"] if each.kw_only and "*" not in words else []
            words.append(name if each.default is each.default_factory else name + default)
            types[name] = each.type
        elif each.default_factory is dataclasses.MISSING:
            continue  # the class has the value, or nobody yet
        lines.append(f"_set(self, {name!r}, {value})" if frozen else f"self.{name} = {value}")
    lines += ["self.__post_init__()"] if hasattr(cls, "__post_init__") else []
    exec(f"def __init__({', '.join(words)}):\n " + "\n ".join(lines or ["pass"]), scope)
    made = scope["__init__"]
    made.__qualname__, made.__module__ = f"{cls.__qualname__}.__init__", cls.__module__
    made.__annotations__ = types | {"return": None}
    return made


def _make_method(cls: Any, name: str) -> Any:
    """Return a method of a class that tells what its instances hold."""
    other = dataclasses.make_dataclass(
        cls.__qualname__,
        [(each.name, each.type, copy.copy(each)) for each in dataclasses.fields(cls)],
        namespace={"__doc__": cls.__doc__},  # else one is made
        init=False,
        repr=name == "__repr__",
        eq=name == "__eq__",
        unsafe_hash=name == "__hash__",
    )
    return vars(other)[name]


def _refuse_to_set(self: object, name: str, value: object) -> NoReturn:
    raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")


def _refuse_to_delete(self: object, name: str) -> NoReturn:
    raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")


class Rows:
    """Some of them, and several lists as one: for dataclasses of arrays, each with a row for every one of n things."""

    def __len__(self) -> int:
        return len(getattr(self, dataclasses.fields(self)[0].name))  # type: ignore[arg-type]

    def __getitem__(self, which: Any) -> Self:
        return type(self)(*(getattr(self, each.name)[which] for each in dataclasses.fields(self)))  # type: ignore[arg-type]

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Put several lists one behind the other."""
        import numpy as np  # late, as help texts need none of it

        columns = []
        for each in dataclasses.fields(cls):  # type: ignore[arg-type]
            values = [getattr(part, each.name) for part in parts]
            own = type(values[0])
            columns.append(own.joined(values) if issubclass(own, Rows) else np.concatenate(values))
        return cls(*columns)


# Functions whose keywords are the fields of a dataclass, declared and explained there.

Keywords = ParamSpec("Keywords")
Result = TypeVar("Result")
First = TypeVar("First")


def takes_options(
    options: Callable[Keywords, Any],
) -> Callable[[Callable[Concatenate[First, ...], Result]], Callable[Concatenate[First, Keywords], Result]]:
    """Let a function have the fields of a dataclass in place of its ``**options``: in its signature and its help."""

    def decorate(function: Callable[Concatenate[First, ...], Result]) -> Callable[Concatenate[First, Keywords], Result]:
        explained = str(options.__doc__).partition("----------\n")[2].partition("\n    Raises\n")[0]
        function.__doc__ = re.sub(r"    \*\*options\n.*\n", lambda match: explained, str(function.__doc__))
        return with_keywords(options, *(each.name for each in dataclasses.fields(options)))(function)  # type: ignore[arg-type]

    return decorate


def with_keywords(options: Callable[..., Any], *names: str) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """Let a function have some fields of a dataclass, and no others, in place of its ``**``."""

    def decorate(function: Callable[..., Result]) -> Callable[..., Result]:
        own, fields = inspect.signature(function), inspect.signature(options).parameters
        named = [each for each in own.parameters.values() if each.kind is not each.VAR_KEYWORD]
        signature = own.replace(parameters=[*named, *(fields[name] for name in names)])

        @wraps(function)
        def call(*arguments: Any, **keywords: Any) -> Result:
            return function(**signature.bind(*arguments, **keywords).arguments)

        call.__signature__ = signature  # type: ignore[attr-defined]
        return call

    return decorate
