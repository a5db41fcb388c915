"""Identifiers and prose use the standard words of CONTRIBUTING's glossary, and no home-made ones of old."""

import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

# Words that no identifier has, alone or between others.
RETIRED = {
    "hue", "hues", "course", "courses", "leg", "legs", "finish", "finishes", "painting", "paintings", "told", "settled",
    "decided", "asked", "look", "looks", "likeness", "lobby", "strangers", "wishes", "patience", "courtesy", "linger",
    "kindness", "judged", "manner",
}  # fmt: skip
# Ordinary words that once meant something else: as whole names, in these folders of kernels and in records.
RETIRED_IN_KERNELS = {"self", "part", "edge"}
FOLDERS = ("pass", "integrator", "geometry", "material", "light")
CLASSES = {"Stand", "Painting"}
STANDARD = {"finish", "look", "setLooksOverride", "setLooksOverrideEnabled"}  # OpenCL's clFinish; OpenColorIO's looks
# In comments, docstrings and pages: those that have a standard word in every sense.
COMMANDS = r"(?<!rptcam )(?<!rptcam_cl\.)(?<!### )"  # names that the program offers
RIDDLE = "(?-i:Return what)"  # at the head of a docstring, which says what a thing is or does
RETIRED_IN_PROSE = re.compile(
    rf"\b(told|{COMMANDS}settle[sd]?|hangs? on|asked for|never asks|{RIDDLE})\b", re.IGNORECASE
)
PAGES = ("README.md", "CHANGELOG.md", "docs/*.md", "benchmarks/*.md", "examples/README.md")


def words(name: str) -> set[str]:
    """The words of an identifier, in lower case."""
    return {word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)}


@cache
def is_retired(name: str) -> bool:
    return name in CLASSES or (name not in STANDARD and bool(words(name) & RETIRED))


@cache
def read_python(path: Path) -> tuple[set[str], list[tuple[int, str]]]:
    """The retired names of a file; its comments and texts of several lines, with the lines that they begin at.

    Tokens take long, so that a file is taken apart only where a word could be wrong, in whatever it stands.
    """
    text = path.read_text("utf-8")
    if not any(map(is_retired, set(re.findall(r"[A-Za-z_]\w*", text)))) and not RETIRED_IN_PROSE.search(text):
        return set(), []
    names, texts = set(), []
    with path.open("rb") as stream:
        for token in tokenize.tokenize(stream.readline):
            if token.type == tokenize.NAME:
                names.add(token.string)
            elif token.type == tokenize.COMMENT or (token.type == tokenize.STRING and '"""' in token.string):
                texts.append((token.start[0], token.string))
    return set(filter(is_retired, names)), texts


def names_of_kernel(text: str) -> list[str]:
    code = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL)
    return re.findall(r"\b[A-Za-z_]\w*", code)


def found(checkout: Path) -> dict[str, set[str]]:
    """Retired names by the file they stand in."""
    retired = {str(path.relative_to(checkout)): read_python(path)[0] for path in (checkout / "rptcam_cl").rglob("*.py")}
    kernels = [path for path in (checkout / "kernels").rglob("*") if path.suffix in (".h", ".cl")]
    for path in kernels:
        names = set(names_of_kernel(path.read_text("utf-8")))
        wrong = RETIRED_IN_KERNELS if path.parent.name in FOLDERS else set()
        retired[str(path.relative_to(checkout))] = set(filter(is_retired, names)) | (names & wrong)
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


def prose(checkout: Path) -> Iterator[tuple[Path, int, str]]:
    """All prose of the checkout: a file, the line where a piece begins, and the piece."""
    for path in (checkout / "rptcam_cl").rglob("*.py"):
        yield from ((path, number, text) for number, text in read_python(path)[1])
    for path in (checkout / "kernels").rglob("*.[hc]*"):
        lines = enumerate(path.read_text("utf-8").splitlines(), 1)
        yield from ((path, number, line.partition("//")[2]) for number, line in lines)
    for path in (path for pattern in PAGES for path in checkout.glob(pattern)):
        yield from ((path, number, line) for number, line in enumerate(path.read_text("utf-8").splitlines(), 1))


def test_prose_has_no_retired_word(checkout: Path) -> None:
    pieces = list(prose(checkout))
    assert len(pieces) > 10_000
    said = ((path, number, RETIRED_IN_PROSE.search(text)) for path, number, text in pieces)
    assert [f"{path} from line {number} on: {word[0]}" for path, number, word in said if word] == []


def test_retired_words_are_found_in_prose_and_not_in_others() -> None:
    assert all(
        map(
            RETIRED_IN_PROSE.search,
            ["as it was told.", "Settled", "it hangs on noise", "the size asked for", "Return what is."],
        )
    )
    assert not any(
        map(RETIRED_IN_PROSE.search, ["stold", "unsettling", "hanging on a wall", "asked politely", "return what"])
    )
