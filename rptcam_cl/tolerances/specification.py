"""Specifications of tolerances: a grade by its name, a YAML file, or the same as Python data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import Document, KeyPath, dotted, read_yaml
from rptcam_cl.scene import GRADES, Tolerances, grade, input_error


@dataclass(frozen=True)
class Specification:
    """Tolerances, and where each of their keys stands.

    Attributes
    ----------
    tolerances : Tolerances
    where : callable
        Returns what an error about a key path begins with, such as ``tolerances.yaml:3:5: ``.
    """

    tolerances: Tolerances
    where: Callable[[KeyPath], str] = lambda path: ""

    def problem(self, path: KeyPath, text: str) -> InputError:
        """Return the error of a key that does not fit the lens."""
        return InputError(f"{self.where(path)}{dotted(path)}: {text}")


def specification(source: str | Path | bytes | Mapping[str, Any] | Tolerances, name: str = "") -> Specification:
    """Return the specification of a grade's name, a YAML file, its text as bytes, or a mapping of the same form.

    Parameters
    ----------
    source
        One of `GRADES`, or a path.
    name : str
        What errors call text that is not read from a file.

    Raises
    ------
    InputError
        ``FILE:LINE:COL: key.path: problem (got …; allowed …)``.
    StateError
        When the file cannot be read.
    """
    if isinstance(source, Tolerances):
        return Specification(source)
    if isinstance(source, str) and source in GRADES:
        return Specification(grade(source))
    if isinstance(source, Mapping):
        return _checked(dict(source), None)
    if isinstance(source, str | Path) and not Path(source).exists():
        raise InputError(f"{source}: no such file and no grade of tolerances (allowed: {', '.join(GRADES)}, or a file)")
    document = read_yaml(source if isinstance(source, bytes) else Path(source), name or None)
    if not isinstance(document.data, dict):
        raise InputError(f"{document.name}:1:1: a specification must be a mapping (allowed: with the key tolerances)")
    return _checked(document.data, document)


def _checked(data: dict[str, Any], document: Document | None) -> Specification:
    def where(path: KeyPath, at_key: bool = False) -> str:
        if document is None:
            return ""
        line, column = document.key_mark(path) if at_key else document.mark(path)
        return f"{document.name}:{line}:{column}: "

    try:
        return Specification(Tolerances.model_validate(data), where)
    except ValidationError as problem:
        raise input_error(problem, data, where) from None
