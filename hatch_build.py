"""What the package page shows: the README with links that lead there from anywhere, and the project's addresses.

`address` in `[tool.hatch.metadata.hooks.custom]` of pyproject.toml is that of the repository. Without one, links into
the repository become plain words and pictures their descriptions, so that the page has no dead link.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\((?!https?://|#|mailto:)([^)\s]+)\)")


def with_absolute_links(text: str, address: str, tag: str) -> str:
    """Return Markdown whose links into the repository lead to its files at a tag."""

    def replaced(match: re.Match[str]) -> str:
        is_picture, words, target = match.groups()
        if not address:
            return words
        return f"{is_picture}[{words}]({address}/{'raw' if is_picture else 'blob'}/{tag}/{target})"

    return LINK.sub(replaced, text)


def addresses(address: str) -> dict[str, str]:
    """Return the rows of the package page's list of links."""
    if not address:
        return {}
    parts = {"Source": "", "Documentation": "/blob/main/docs/index.md", "Changes": "/blob/main/CHANGELOG.md"}
    return {name: address + part for name, part in (parts | {"Issues": "/issues"}).items()}


class PackagePage(MetadataHookInterface):
    """Fills in `readme` and `urls`."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Write both into the project's metadata."""
        root, address = Path(self.root), str(self.config.get("address", "")).rstrip("/")
        version = re.search(r'__version__ = "([^"]+)"', (root / "rptcam_cl/core/__init__.py").read_text("utf-8"))
        assert version is not None
        text = with_absolute_links((root / "README.md").read_text("utf-8"), address, f"v{version[1]}")
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
        metadata["urls"] = addresses(address)
