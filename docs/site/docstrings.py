"""NumPy docstrings as Markdown: sections become bold lines, parameters become lists."""

import re

LISTED = ("Parameters", "Attributes", "Returns", "Yields", "Raises")
SECTIONS = (*LISTED, "Notes", "References", "Examples", "Warns", "See Also")
HEADING = re.compile(rf"^({'|'.join(SECTIONS)})\n-+\n", re.MULTILINE)


def as_markdown(doc: str) -> str:
    """A docstring as a piece of a page."""
    prose, *parts = HEADING.split(doc)
    texts = [paragraphs(prose)]
    for title, body in zip(parts[::2], parts[1::2], strict=True):
        texts.append(f"**{title}**\n\n{listed(body) if title in LISTED else paragraphs(body)}")
    return "\n\n".join(text for text in texts if text.strip())


def paragraphs(text: str) -> str:
    """Prose with code as Markdown has it."""
    return in_code(text).strip()


def in_code(text: str) -> str:
    """Two backquotes, as in docstrings, become one; pages of docs become links, from the folder of the Python pages."""
    return re.sub(r"\bdocs/([\w-]+\.md)", r"[\1](../../\1)", re.sub(r"``([^`]+)``", r"`\1`", text))


def listed(body: str) -> str:
    """Names at the left, what they are below each and indented, as a list."""
    entries = re.findall(r"^(\S[^\n]*)\n?((?:[ \t]+[^\n]*\n?|\n)*)", body, re.MULTILINE)
    return "\n".join(f"- {named(head)}{meaning(text)}" for head, text in entries)


def named(head: str) -> str:
    """``scene : path or mapping`` as code and words."""
    name, _, kind = (part.strip() for part in head.partition(" : "))
    name = name if "`" in name else f"`{name}`"
    return f"{name} ({in_code(kind)})" if kind else name


def meaning(text: str) -> str:
    """What stands below a name, on one line."""
    line = re.sub(r"\s+", " ", in_code(text)).strip()
    return f": {line}" if line else ""
