"""Draw the rooms of the package from its code into docs/images/architecture.svg: ``python -m benchmarks.architecture``.

Rooms stand above all that they import. Of the arrows between them, those that follow from others are left out. The bar
of a room is its lines of code, by `benchmarks.size`.
"""

from __future__ import annotations

import ast
import re
from html import escape
from pathlib import Path

from benchmarks.size import PACKAGE, ROOT, TOP, nodes_of, room_of, rooms

KERNELS = ROOT / "kernels"
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
PLACE = {  # column, and what the room is for
    "cli": (1, "the command rptcam"),
    "batch": (0, "clusters, datasets"),
    "viewfinder": (1, "live view: dials, page, notebook"),
    "api": (1, "render, session, sweep"),
    "exchange": (0, "pbrt scenes, camera models"),
    "studies": (1, "autofocus, trade-off, doctor"),
    "rendering": (0, "cameras, plan, waves, film"),
    "imaging": (2, "sensor, development, files"),
    "scene": (2, "the scene file, its assets"),
    "kernels": (0, "OpenCL C: lens, paths, light"),
    "device": (1, "OpenCL: programs, buffers"),
    "optics": (2, "lenses in float64, no OpenCL"),
    "core": (1, "records, spectra, files, errors"),
}
WIDTH, HEIGHT, GAP_X, GAP_Y, MARGIN = 210, 62, 26, 46, 24  # [px] of boxes and between them
FONT = "font-family='system-ui, sans-serif'"


def imports() -> dict[str, set[str]]:
    """The rooms that each room imports, anywhere in its code."""
    found: dict[str, set[str]] = {room: set() for room in rooms() if room != TOP}
    for path in PACKAGE.rglob("*.py"):
        if (room := room_of(path)) not in found:
            continue
        for node in nodes_of(path.read_text("utf-8")):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("rptcam_cl."):
                found[room].add(str(node.module).split(".")[1])
    return {room: (named & found.keys()) - {room} for room, named in found.items()}


def levels(edges: dict[str, set[str]]) -> dict[str, int]:
    """The level of each room: 0 imports none, others stand one above the highest that they import."""
    found: dict[str, int] = {}
    while len(found) < len(edges):
        for room, named in edges.items():
            if room not in found and named <= found.keys():
                found[room] = 1 + max((found[other] for other in named), default=-1)
    return found


def shortest(edges: dict[str, set[str]]) -> dict[str, set[str]]:
    """The imports that do not follow from others."""

    def below(room: str) -> set[str]:
        return edges[room].union(*(below(other) for other in edges[room]))

    return {room: {a for a in named if not any(a in below(b) for b in named - {a})} for room, named in edges.items()}


def places(edges: dict[str, set[str]]) -> dict[str, tuple[float, float]]:
    """The upper left corner of each room's box [px], and of the kernels' beside the device's."""
    heights = levels(edges)
    heights["kernels"] = heights["device"]
    top = max(heights.values())
    return {
        room: (MARGIN + PLACE[room][0] * (WIDTH + GAP_X), MARGIN + (top - level) * (HEIGHT + GAP_Y))
        for room, level in heights.items()
    }


def _box(room: str, place: tuple[float, float], lines: int, most: int) -> str:
    x, y = place
    fill = "#fff4e0" if room == "kernels" else "#eef4fb"
    return (
        f"<g><rect x='{x}' y='{y}' width='{WIDTH}' height='{HEIGHT}' rx='6' fill='{fill}' stroke='#557'/>"
        f"<text x='{x + 10}' y='{y + 20}' {FONT} font-size='15' font-weight='600' fill='#223'>{room}</text>"
        f"<text x='{x + WIDTH - 10}' y='{y + 20}' {FONT} font-size='11' text-anchor='end'"
        f" fill='#667'>{lines:,} lines</text>"
        f"<text x='{x + 10}' y='{y + 39}' {FONT} font-size='12' fill='#334'>{escape(PLACE[room][1])}</text>"
        f"<rect x='{x + 10}' y='{y + 48}' width='{(WIDTH - 20) * lines / most:.1f}' height='5' fill='#88a8cc'/></g>"
    )


def _arrow(a: str, b: str, at: dict[str, tuple[float, float]], dashed: bool = False) -> str:
    (x0, y0), (x1, y1) = at[a], at[b]
    x0, x1, y0, bend = x0 + WIDTH / 2, x1 + WIDTH / 2, y0 + HEIGHT, 0.5 * GAP_Y
    style = " stroke-dasharray='4 3'" if dashed else ""
    curve = f"M{x0},{y0} C{x0},{y0 + bend} {x1},{y1 - bend} {x1},{y1 - 3}"
    return f"<path id='{a}-{b}' d='{curve}' fill='none' stroke='#99a' marker-end='url(#tip)'{style}/>"


def svg() -> str:
    """The drawing."""
    edges, sizes = imports(), rooms()
    at = places(edges)
    sources = [
        re.sub(r"/\*.*?\*/|//[^\n]*", "", path.read_text("utf-8"), flags=re.S) for path in KERNELS.rglob("*.[ch]*")
    ]
    code = sum(bool(line.strip()) for source in sources for line in source.splitlines())
    most = max(code, *(size.code for size in sizes.values()))
    width, height = (
        max(place[k] for place in at.values()) + extent + MARGIN for k, extent in ((0, WIDTH), (1, HEIGHT))
    )
    tip = "<marker id='tip' markerWidth='8' markerHeight='8' refX='6' refY='4' orient='auto'><path d='M0,1 L7,4 L0,7' "
    parts = [
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width:g} {height:g}' width='{width:g}' role='img'>",
        "<title>The rooms of rptcam_cl and their imports</title>",
        f"<rect width='{width:g}' height='{height:g}' fill='white'/>",
        f"<defs>{tip}fill='none' stroke='#99a'/></marker></defs>",
        *(_arrow(a, b, at) for a, named in sorted(shortest(edges).items()) for b in sorted(named)),
        _arrow("rendering", "kernels", at, dashed=True),
        *(_box(room, at[room], sizes[room].code, most) for room in sorted(edges)),
        _box("kernels", at["kernels"], code, most),
        "</svg>\n",
    ]
    return "\n".join(parts)


def main() -> None:
    """Write the drawing."""
    PICTURE.write_text(svg(), "utf-8")
    print(Path(PICTURE).relative_to(ROOT))


if __name__ == "__main__":
    main()
