"""Whether a picture has an alpha channel, told by its head alone."""

from __future__ import annotations

from pathlib import Path

from rptcam_cl.references import open_regular

PNG = b"\x89PNG\r\n\x1a\n"
WITH_ALPHA = (4, 6)  # colour types: grey and alpha; red, green, blue and alpha
HEAD_BYTES = 1 << 16
LARGEST_FILE = 2 << 30  # bytes


def has_alpha(source: Path | bytes) -> bool:
    """Return whether a PNG says that it has alpha; pictures of other kinds count as opaque.

    A PNG has it by its colour type, or by a tRNS chunk before its first data (PNG specification, 11.2 and 11.3).
    """
    if isinstance(source, Path):
        with open_regular(source, LARGEST_FILE) as file:
            head = file.read(HEAD_BYTES)
    else:
        head = source[:HEAD_BYTES]
    if not head.startswith(PNG) or len(head) < 26:
        return False
    return head[25] in WITH_ALPHA or b"tRNS" in head.partition(b"IDAT")[0]
