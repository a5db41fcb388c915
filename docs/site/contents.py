"""What the site shows: contents by docs/index.md, headings named as GitHub names them, links between pages."""

import posixpath
import re
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"(\]\()([^)#\s]*)(#[^)\s]*)?(\))")
FENCE = re.compile(r"^ *```.*?^ *```[^\n]*$", re.DOTALL | re.MULTILINE)
ENTRY = re.compile(r"^- \[([^]]+)\]\(([^)]+)\)", re.MULTILINE)
Nav = list[dict[str, "str | Nav"]]


def slug(heading: str) -> str:
    """The name of a heading as a target of links."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def outside_fences(text: str, change: Callable[[str], str]) -> str:
    """A page with its prose changed and its fenced blocks as they are."""
    parts, at = [], 0
    for fence in FENCE.finditer(text):
        parts += [change(text[at : fence.start()]), fence[0]]
        at = fence.end()
    return "".join([*parts, change(text[at:])])


def nav_of(index: str, generated: dict[str, Nav]) -> Nav:
    """The contents of the site: sections and entries of the index, with generated pages at the end of their section."""
    nav: Nav = [{"Contents": "index.md"}]
    _, *sections = re.split(r"^## (.+)\n", index, flags=re.MULTILINE)
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        first, *parts = re.split(r"^### (.+)\n", body, flags=re.MULTILINE)
        entries: Nav = entries_of(first)
        for name, rest in zip(parts[::2], parts[1::2], strict=True):
            entries.append({name: entries_of(rest)})
        nav.append({title: entries + generated.get(title, [])})
    return nav


def entries_of(text: str) -> Nav:
    """Titles and pages of the list in a section."""
    return [{title: in_site(posixpath.normpath(posixpath.join("docs", page)))} for title, page in ENTRY.findall(text)]


def in_site(path: str) -> str:
    """The place of a file of the checkout in the site: what is in docs at the top, the rest as in the checkout."""
    if path == "README.md":
        return "index.md"
    return path.removeprefix("docs/")


def in_checkout(page: str) -> str:
    """The place in the checkout of a page of the site."""
    return f"docs/{page}" if (ROOT / "docs" / page).is_file() else page


def targets(page: str, text: str) -> Iterator[str]:
    """Files and folders of the checkout that a page links to, as paths from its root."""
    found: list[str] = []
    outside_fences(text, lambda prose: found.extend(match[2] for match in LINK.finditer(prose)) or "")
    for target in found:
        if target and ":" not in target:
            yield posixpath.normpath(posixpath.join(posixpath.dirname(page), target))


def linked(page: str, text: str, folder: str | None = None) -> str:
    """A page with its links as the site has them; ``page`` is its path in the checkout.

    Pages in another ``folder`` of the site may show pieces of it.
    """
    here = folder or posixpath.dirname(in_site(page)) or "."

    def rewritten(match: re.Match[str]) -> str:
        opening, target, anchor, closing = match.groups()
        anchor = re.sub(r"-(\d+)$", r"_\1", anchor) if anchor and is_repeated(page, target, anchor) else anchor or ""
        if ":" in target or not (target or folder):
            return opening + target + anchor + closing
        path = posixpath.normpath(posixpath.join(posixpath.dirname(page), target)) if target else page
        if (ROOT / path).is_dir():
            path = f"{path}/index.md"
        return opening + posixpath.relpath(in_site(path), here) + anchor + closing

    return outside_fences(text, lambda prose: LINK.sub(rewritten, prose))


def is_repeated(page: str, target: str, anchor: str) -> bool:
    """Whether an anchor such as ``#noise-1`` is of the second heading ``noise``, which the site calls ``noise_1``."""
    path = ROOT / (posixpath.join(posixpath.dirname(page), target) if target else page)
    if path.suffix != ".md" or not path.is_file() or not re.search(r"-\d+$", anchor):
        return False
    names = [slug(heading) for heading in re.findall(r"^#+ (.+)", path.read_text("utf-8"), re.MULTILINE)]
    return anchor[1:] not in names


def spaced(text: str) -> str:
    """A page with an empty line before each list and table, which GitHub does without and Python-Markdown does not."""
    starts = re.compile(r"^(?!\s*(?:- |\d+\. |\||#|$))(.+)\n(?=- |1\. |\| )", re.MULTILINE)
    return outside_fences(text, lambda prose: starts.sub(r"\1\n\n", prose))
