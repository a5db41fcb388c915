"""Identifiers speak the standard words of CONTRIBUTING's glossary, and no home-made ones of old."""

import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

# Words that no identifier has, alone or between others.
RETIRED = {
    "hue", "hues", "course", "courses", "leg", "legs", "finish", "finishes", "painting", "paintings", "told", "settled",
    "decided", "asked", "look", "looks",
}  # fmt: skip
# Ordinary words that once meant something else: as whole names, in these folders of kernels and in records.
RETIRED_IN_KERNELS = {"self", "part", "edge"}
FOLDERS = ("pass", "integrator", "geometry", "material", "light")
CLASSES = {"Stand", "Painting"}
STANDARD = {"finish"}  # of a queue, as OpenCL's clFinish


def words(name: str) -> set[str]:
    """The words of an identifier, in lower case."""
    return {word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)}


def is_retired(name: str) -> bool:
    return name in CLASSES or (name not in STANDARD and bool(words(name) & RETIRED))


def names_of_python(path: Path) -> Iterator[str]:
    with path.open("rb") as stream:
        yield from (token.string for token in tokenize.tokenize(stream.readline) if token.type == tokenize.NAME)


def names_of_kernel(text: str) -> list[str]:
    code = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL)
    return re.findall(r"\b[A-Za-z_]\w*", code)


def found(checkout: Path) -> dict[str, set[str]]:
    """Retired names by the file they stand in."""
    names = {path: set(names_of_python(path)) for path in (checkout / "rptcam_cl").rglob("*.py")}
    kernels = [path for path in (checkout / "kernels").rglob("*") if path.suffix in (".h", ".cl")]
    names |= {path: set(names_of_kernel(path.read_text("utf-8"))) for path in kernels}
    retired = {str(path.relative_to(checkout)): set(filter(is_retired, all_)) for path, all_ in names.items()}
    for path in kernels:
        if path.parent.name in FOLDERS:
            retired[str(path.relative_to(checkout))] |= names[path] & RETIRED_IN_KERNELS
    return {file: those for file, those in sorted(retired.items()) if those}


def test_no_identifier_has_a_retired_word(checkout: Path) -> None:
    assert found(checkout) == {}


def test_no_member_of_a_record_has_a_retired_word() -> None:
    from rptcam_cl.core import records

    all_records = [value for value in vars(records).values() if isinstance(value, records.Record)]
    assert len(all_records) > 10
    members = {member.partition("[")[0] for record in all_records for _, member in record.members}
    assert [
        name for name in sorted(members) if is_retired(name) or name in RETIRED_IN_KERNELS - {"edge"}
    ] == []  # a region has edges


def test_retired_words_are_found_in_names_and_not_in_others() -> None:
    assert all(
        map(is_retired, ["hue", "TOLD_BY", "_look_of", "onLook", "LegCount", "settled_", "Stand", "read_finish"])
    )
    assert not any(map(is_retired, ["finish", "stand_in", "standard", "legendre", "lookup", "undecided", "Outlook"]))
