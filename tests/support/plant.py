"""Mutation as a number: plants random faults in a room, one at a time, and counts those that its tests find.

``make mutants ROOM=optics COUNT=30 SEED=1`` works in a throw-away copy of the checkout. A Python fault changes the
syntax tree: a comparison, an operator, a number, a sign, two arguments the other way round, a condition, a statement
that is left out. A fault in a kernel (``ROOM=kernels/lens``) changes a token or leaves out a statement.

The tests of the room run once first, with a trace of which of them runs which line (in kernels: has it in a program
that it launches); a fault is then given to those that run its line, the fastest first, up to the first that fails.
Faults in lines that no test of the room runs survive.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import importlib
import json
import multiprocessing
import os
import random
import re
import shutil
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
TRACE, TRACED = "RPTCAM_TRACE_TO", "RPTCAM_TRACE_OF"  # variables of the environment by which the trace is asked for
LIBRARIES = "numpy scipy.stats pydantic yaml hypothesis xdist PIL.Image"  # that most tests import
LIMIT_S = 600.0  # of all tests of one fault; what never ends is found

# Where the tests of a room are, beside the folder of its name.
TESTS = {
    "imaging": "cli/test_develop rendering/truth/test_cryptomatte",
    "scene": "rendering/plan imaging/sensor core/colour rendering/tolerances/test_specification"
    " rendering/cameras/test_losses rendering/test_transmission",
    "scene/assets": "scene/test_boards exchange/starting",
    "optics": "rendering/tolerances rendering/layers/test_blur cli/test_lens_views cli/test_lens cli/test_breathing"
    " cli/test_lens_tolerance rendering/cameras/test_as_built rendering/cameras/test_extremes",
    "core": "device/test_layout device/test_signatures rendering/test_world scene/assets/test_remembered_pictures"
    " imaging/sensor",
    "device": "rendering/several",
    "rendering/plan": "rendering/light rendering/caustics rendering/test_emitters scene/test_warnings"
    " rendering/test_shapes",
    "cli": "exchange/calibration/test_camera_outputs exchange/calibration/test_camera_files exchange/pbrt/test_command"
    " exchange/calibration/test_maps studies/tradeoff/test_command optics/measures/test_lens_views"
    " studies/selfcheck/test_suite",
    "api": "rendering/test_honest_errors cli/test_sweep cli/test_render cli/test_parts"
    " cli/test_frames_that_follow"
    " rendering/test_sweep rendering/test_settle rendering/test_resume rendering/several/test_shared_renders"
    " rendering/test_merge rendering/test_ghosts rendering/test_diffraction rendering/test_stages imaging/test_denoise"
    " cli/test_watch_and_preview studies/focus/test_doubts",
    "kernels/lens": "device/test_camera_rays optics/test_surfaces rendering/test_lens_float64"
    " rendering/cameras/test_losses optics/test_mirrors rendering/cameras/test_ray_map optics/test_coatings"
    " rendering/test_lens_light rendering/test_ghosts rendering/cameras/test_lamp_aim rendering/cameras/test_shapes"
    " rendering/cameras/test_mirrors rendering/cameras/test_wavelengths device/test_aperture_points",
    "kernels/camera": "device/test_camera_rays rendering/test_thick_lens rendering/test_filters"
    " rendering/cameras/test_fitted_camera rendering/cameras/test_movements rendering/test_apertures rendering/motion"
    " rendering/test_lens_light rendering/cameras/test_lamp_aim",
    "kernels/material": "device/test_bsdf_values device/test_bsdf_sampling device/test_sheen device/test_covers"
    " rendering/light/test_textures rendering/test_opacity rendering/test_materials rendering/test_normal_maps"
    " rendering/test_material_maps rendering/test_furnaces rendering/layers/test_means",
    "kernels/light": "rendering/light/test_light_tree rendering/light/test_solid_lamps rendering/test_emitters"
    " rendering/light",
    "kernels/geometry": "rendering/primitives rendering/test_shapes rendering/test_meshes rendering/meshes"
    " rendering/motion rendering/test_opacity",
    "kernels/integrator": "rendering/test_furnaces rendering/layers rendering/test_world rendering/test_determinism"
    " rendering/test_samples rendering/test_checkpoint rendering/test_roulette device/test_kernels"
    " rendering/truth/test_cryptomatte",
    "kernels/caustics": "rendering/caustics",
    "kernels/build": "rendering/trees",
    "kernels/common": "device/test_random device/test_kernels device/test_lattice device/test_widths"
    " device/test_bsdf_values device/test_bsdf_sampling device/test_aperture_points"
    " rendering/light/test_environment_pictures rendering/spectrum core/colour/test_spectral_pictures",
}

# Faults that change nothing a user could notice: the file and the line with the fault, and why.
EQUIVALENT = {
    r"""scene/assets/obj.py: while end > 0 and content[max(0, end - 2) : end].rstrip(b"\r").endswith(b"\\"):""": "none "
    "goes on before the first byte",
    "scene/assets/obj.py: if numbers is not None and width >= each and all(len(text.split()) != width for _, text in"
    " lines):": "line by line it takes longer",
    "core/errors.py: matches = [same] if same in lower else get_close_matches(given, lower, n=2, cutoff=0.6)": (
        "the first is the one that is shown"
    ),
    "scene/assets/mesh.py: rows = rows.copy() if base.base is not None and base.nbytes > rows.nbytes else "
    "np.ascontiguousarray(rows)": "takes more memory",
    "scene/assets/mesh.py: cancelled = (sums * sums).sum(axis=0) <= 1e-18": "sums are far smaller or far larger",
    'cli/output.py: print("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=False)).rstrip())': (
        "rows are as long as their head"
    ),
    "cli/output.py: Path(name).unlink(missing_ok=False)": "the file was made a moment before",
    "core/files.py: path.unlink(missing_ok=False)": "the caller passes over it, and the next call deletes what is left",
    'imaging/formats.py: planarconfig="contig" if (not (raw.numbers.ndim == 3)) else None,': "tifffile finds the same",
    "rendering/cameras/pupil.py: cell = np.clip(0, (film / half_film_mm + 1) / 2 * count, count - 1).astype(int)": "the"
    " middle of the three either way",
    "rendering/highlights.py: close = np.linalg.norm(half - normal, axis=1) < 2.0 * spread + slack": "only"
    " distances that are equal to the last bit",
    "optics/ghosts.py: turns = np.full((len(entered), max(map(len, ways), default=0) + 2), NOWHERE)": "more room",
    "optics/files/native.py: backwards = [k for k, s in enumerate(lens.surfaces) if s.is_mirror and lens.senses[k] <= 0"
    " and s.pose is None]": "a sense is 1 or -1",
    "optics/ray_trace.py: return Hits(hit, to_plane + step, normal, cosine, np.isfinite(step) & (normal[2] > 0)"
    " & (cosine >= 0))": "only rays along the surface itself",
    'viewfinder/instruments.py: ColourBand("VI", 0.5, 1.5, (150, 196, 61)),': "a shade",
    'viewfinder/delivery.py: "A": 2856, "D50": 5003, "D55": 5503, "D65": 6504, "D75": 7504, "E": 5455, "F2": 4231, '
    '"F7": 6500, "F11": 4000,': "a kelvin",
    'viewfinder/lens_panel.py: {"points": np.round(line, 5).tolist(), "wavelength_nm": round(nm, 2), "colour": '
    "wavelength_colour(nm),": "a tenth of a micrometre of a drawing",
    "studies/tradeoff_errors.py: noise=(*(_over_tiles(noise, scales) for noise in noises[:(1)]), last),": "of two",
    "studies/tradeoff_errors.py: sum_of_blocks = sum_of_blocks + np.where(rest >= LEAST, block**2 * self.even(block),"
    " 0.0)": "a millionth of a sample",
    'studies/focus/probe.py: axes.axvline(report.film_distance_mm, color=INK, linestyle="--", '
    "linewidth=1.7999999999999998)": "a dashed line a little thicker",
    "kernels/light/solids.h: *pdf = ((rho2 > 1.0f) & (line.density >= 0.0f) & (line.density < NEVER)) ? line.density"
    " : ZERO;": "a density of 0 is 0 either way",
    "kernels/light/solids.h: F share = ((x > y) & (x >= z)) ? f.share.x : (y >= z ? f.share.y : f.share.z);": "only"
    " rays through the edge of a box",
    "kernels/light/light_tree.h: I here = open & ((left <= light) | ((I)(e) == scene.emitter_count - 1));": "a single"
    " random number",
    "kernels/light/solids.h: I on_y = NOT(on_x) & ((pick - of_x <= of_y) | (of_z <= 0.0f));": "a single random number",
    "kernels/caustics/gather.h: on = on & (p.x >= grid->low.x) & (p.y >= grid->low.y) & (p.z > grid->low.z)": "only"
    " points on the rim of the grid",
    "kernels/caustics/gather.h: I end = on ? GATHER(I, scene.photon_cells, cell + 1, ) : TRUE;": "of lanes that are"
    " off",
    "kernels/caustics/photon.h: return on ? GATHER(I, scene.caustic_roles, known, ) : TRUE;": "of lanes that are off",
    "kernels/caustics/photon.h: I known = (on | (primitive >= 0)) ? primitive : FALSE;": "of lanes that are off",
    "kernels/caustics/gather.h: Eight photon = load_eight(scene.photons, (more ? k : TRUE) * 8);": "of lanes that are"
    " off",
    "kernels/caustics/gather.h: I k = on ? GATHER(I, scene.photon_cells, cell, ) : TRUE;": "of lanes that are off",
    "kernels/caustics/photon.h: I known = (on & (primitive > 0)) ? primitive : FALSE;": "primitive 0 is FALSE",
    "kernels/lens/coating.h: if (first < 1)": "the shape of the stop takes one number or more before the first table",
    "kernels/lens/aperture.h: I at = within ? (row + 1) * CURVE(APERTURE_ROWS) + 2 * column : TRUE;": "of lanes that"
    " are off",
    "kernels/camera/thick_lens.h: if (ANY(lamps.rest < 1.5f)) {": "the weight of rays is 1 either way where none aims",
    "kernels/camera/packets.h: paths[i].crossed = TRUE;       // where a camera ray fails is of no interest": "not"
    " read",
    "kernels/build/reinsert.cl: if (won < 0.0f) {": "a move that wins nothing costs nothing",
    "kernels/build/splits.h: else if (middle > i)": "what is before the middle is not above the rest either way",
    "kernels/build/splits.h: bin_scale(span.lower.z, span.upper.z), 1.0f);": "the fourth is not read",
    "kernels/build/splits.h: for (int bin = BINS - 1; bin >= 0; --bin) {": "the cost of bin 0 is not read",
    "kernels/pass/stream.cl: path.since_receiver = TRUE;": "every path sets it as it starts",
    "kernels/pass/shade.cl: if (ANY(shadow.reach >= 0.0f)) {": "a shadow ray of no reach is not read",
    "kernels/geometry/triangle.h: F3 each = f3(MAX(absolute(a.x), absolute(b.x)), MAX(absolute(a.y), absolute(b.y)),"
    " MIN(absolute(a.z), absolute(b.z)));": "a power of two, which only slivers 1e19 times as long as wide need",
    "kernels/geometry/triangle.h: I instance = on ? GATHER(I, scene.primitives, on ? hit.primitive : FALSE, .instance)"
    " : TRUE;": "of lanes that are off",
    "kernels/geometry/bvh.h: int z_leads = az >= ax && az > ay;": "y leads as well where both are as long",
}


@dataclass(frozen=True)
class Fault:
    """A piece of a file and what replaces it."""

    path: str
    start: int
    end: int
    text: str
    kind: str

    def planted(self, source: str) -> str:
        """Return the source with the fault."""
        return source[: self.start] + self.text + source[self.end :]

    def line(self, source: str) -> int:
        """Return the number of its line, from 1."""
        return source.count("\n", 0, self.start) + 1

    def shown(self, source: str) -> str:
        """Return its file and the line with it."""
        line = self.planted(source).splitlines()[self.line(source) - 1].strip()
        return f"{self.path.removeprefix('rptcam_cl/')}: {line}"


SWAPS = {
    ast.Lt: "< <=", ast.LtE: "<= <", ast.Gt: "> >=", ast.GtE: ">= >", ast.Eq: "== !=", ast.NotEq: "!= ==",
    ast.In: "in not_in", ast.NotIn: "not_in in", ast.Is: "is is_not", ast.IsNot: "is_not is", ast.And: "and or",
    ast.Or: "or and", ast.Add: "+ -", ast.Sub: "- +", ast.Mult: "* /", ast.Div: "/ *", ast.FloorDiv: "// *",
    ast.Mod: "% *", ast.Pow: "** *", ast.BitAnd: "& |", ast.BitOr: "| &", ast.LShift: "<< >>", ast.RShift: ">> <<",
}  # fmt: skip
PAIRS = ("min max", "minimum maximum", "sin cos", "any all", "floor ceil")
NAMES = dict((pair.split() for pair in PAIRS), **{b: a for a, b in map(str.split, PAIRS)})
EITHER_WAY = {"min", "max", "minimum", "maximum", "hypot", "isclose", "array_equal", "union1d", "Record"}


def _left_out(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what of a node stays as it is: texts, types, decorators."""
    match node:
        case ast.JoinedStr():
            yield from node.values
        case ast.FunctionDef() | ast.AsyncFunctionDef():
            yield from filter(None, (*node.decorator_list, node.returns))
        case ast.ClassDef():
            yield from (*node.decorator_list, *node.bases, *node.keywords)
        case ast.arg(annotation=ast.expr() as kind) | ast.AnnAssign(annotation=kind):
            yield kind
        case ast.If(test=ast.Name(id="TYPE_CHECKING")):
            yield from (node.test, *node.body)
        case ast.BinOp(left=left, right=right):
            yield from (
                side for side in (left, right) if isinstance(side, ast.Constant) and isinstance(side.value, str)
            )


def python_faults(path: str, source: str) -> list[Fault]:
    """Return the faults of a module."""
    starts, tree = [0, *(match.end() for match in re.finditer("\n", source))], ast.parse(source)
    kept = {below for node in ast.walk(tree) for out in _left_out(node) for below in ast.walk(out)}
    found: list[Fault] = []

    def span(node: Any) -> tuple[int, int]:
        """Return where a node begins and ends in the text; the tree counts bytes."""
        ends = ((node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset))
        begin, end = (
            starts[line - 1] + len(source[starts[line - 1] :].split("\n", 1)[0].encode()[:at].decode())
            for line, at in ends
        )
        return begin, end

    def put(begin: int, end: int, text: str, kind: str) -> None:
        found.append(Fault(path, begin, end, text, kind))

    def between(left: ast.AST, right: ast.AST, operator: ast.AST, kind: str) -> None:
        old, new = (word.replace("_", " ") for word in SWAPS.get(type(operator), "@ *").split())
        begin, end = span(left)[1], span(right)[0]
        pattern = rf"\b{old}\b".replace(" ", r"\s+") if old[0].isalpha() else re.escape(old)
        if at := re.search(pattern, re.sub(r"#[^\n]*", lambda match: " " * len(match[0]), source[begin:end])):
            put(begin + at.start(), begin + at.end(), new, kind)

    for node in ast.walk(tree):
        if node in kept:
            continue
        match node:
            case ast.Raise() | ast.AugAssign() | ast.Continue() | ast.Break() | ast.Expr(value=ast.Call()):
                put(*span(node), "pass", "statement dropped")
            case ast.Assign(targets=[ast.Attribute() | ast.Subscript(), *_]):
                put(*span(node), "pass", "statement dropped")
            case ast.If() | ast.IfExp():
                begin, end = span(node.test)
                put(begin, end, f"(not ({source[begin:end]}))", "condition")
            case ast.Constant(value=bool()):
                put(*span(node), str(not node.value), "constant")
            case ast.Constant(value=int() | float() as number):
                put(*span(node), repr(number + 1 if isinstance(number, int) else number * 1.5 or 1.0), "constant")
            case ast.UnaryOp(op=ast.USub() | ast.Not()):
                put(*span(node), f"({source[slice(*span(node.operand))]})", "sign")
            case ast.BinOp() if not {node.left, node.right} & kept:
                between(node.left, node.right, node.op, "operator")
            case ast.BoolOp():
                between(node.values[0], node.values[1], node.op, "operator")
            case ast.Compare():
                between(node.left, node.comparators[0], node.ops[0], "comparison")
            case ast.Call(func=ast.Name() | ast.Attribute() as named):
                name, end = named.id if isinstance(named, ast.Name) else named.attr, span(named)[1]
                if name in NAMES:
                    put(end - len(name), end, NAMES[name], "function")
                if len(node.args) > 1 and name not in EITHER_WAY:
                    (a, b), (c, d) = span(node.args[0]), span(node.args[1])
                    put(a, d, source[c:d] + source[b:c] + source[a:b], "arguments swapped")
    return found


TOKEN = re.compile(
    r"(?P<number>(?<![\w.])\d+\.?\d*(?:e[-+]?\d+)?f?\b)|(?P<name>\b(?:MIN|MAX|sin|cos|TRUE|FALSE)\b)"
    r"|(?P<compare>(?<=\s)(?:<=|>=|<|>|==|!=)(?=\s))|(?P<operator>(?<=\s)[-+*/&|](?=\s))|(?P<sign>(?<=[(])-(?=\w))"
)
CHANGES = "MIN MAX, sin cos, TRUE FALSE, < <=, > >=, == !=, + -, * /, & |"
IN_KERNELS = {pair.split()[k]: pair.split()[1 - k] for pair in CHANGES.split(",") for k in (0, 1)}
STATEMENT = re.compile(r"^ +(?P<all>[\w.>\[\]-]+ (?:[-+*&|]?=) [^;{}]*;)$")


def kernel_faults(path: str, source: str) -> list[Fault]:
    """Return the faults of a file of kernels: tokens outside of comments and directives, and assignments left out."""
    found, start, directive = list[Fault](), 0, False
    for line in source.splitlines(keepends=True):
        code = line.split("//")[0].rstrip("\n")
        if directive := directive or code.lstrip().startswith("#"):
            directive, code = code.endswith("\\"), ""
        for match in TOKEN.finditer(code):
            old, kind = match[0], str(match.lastgroup)
            new = "" if kind == "sign" else IN_KERNELS.get(old, "")
            if kind == "number":
                new = str(int(old) + 1) if old.isdigit() else f"{float(old.rstrip('f')) * 1.5 or 1.0!r}f"
            found.append(Fault(path, start + match.start(), start + match.end(), new, kind))
        if dropped := STATEMENT.match(code):
            found.append(Fault(path, *(start + at for at in dropped.span("all")), ";", "statement dropped"))
        start += len(line)
    return found


def folder_of(room: str, tree: Path) -> Path:
    """Return the folder of a room."""
    return tree / room if room.startswith("kernels/") else tree / "rptcam_cl" / room


def faults_of(room: str, tree: Path) -> list[Fault]:
    """Return all faults that there are for a room: a package of rptcam_cl, or a folder ``kernels/…``."""
    folder = folder_of(room, tree)
    if not folder.is_dir():
        raise SystemExit(f"ROOM={room}: is no folder (allowed: one of rptcam_cl, as optics, or kernels/NAME)")
    found: list[Fault] = []
    for path in sorted(folder.rglob("*")):
        of_suffix = {".py": python_faults, ".h": kernel_faults, ".cl": kernel_faults}.get(path.suffix)
        found += of_suffix(path.relative_to(tree).as_posix(), path.read_text("utf-8")) if of_suffix else []
    return found


def drawn(faults: list[Fault], count: int, seed: str, tree: Path) -> Iterator[Fault]:
    """Yield faults at random, each kind as often, one a line, without those known to change nothing."""
    chance, taken = random.Random(seed), set()
    kinds = sorted({fault.kind for fault in faults})
    by_kind = {kind: [fault for fault in faults if fault.kind == kind] for kind in kinds}
    while len(taken) < count and by_kind:
        kind = chance.choice(list(by_kind))
        fault = by_kind[kind].pop(chance.randrange(len(by_kind[kind])))
        by_kind = {kind: left for kind, left in by_kind.items() if left}
        source = (tree / fault.path).read_text("utf-8")
        place = fault.path, fault.line(source)
        if place not in taken and fault.shown(source) not in EQUIVALENT:
            taken.add(place)
            yield fault


# The trace: a plugin of pytest that notes what each test takes and runs of the room.
_LINES: dict[str, set[int]] = defaultdict(set)


def _tracer(frame: Any, event: str, arg: object) -> Any:
    if not frame.f_code.co_filename.startswith(os.environ[TRACED]):
        return None
    lines = _LINES[frame.f_code.co_filename]

    def within(frame: Any, event: str, arg: object) -> Any:
        lines.add(frame.f_lineno)
        return within

    return within(frame, event, arg)


@lru_cache
def compiled_lines(source: str) -> dict[str, set[int]]:
    """Return the lines of each file of kernels that the conditions of a program leave."""
    path, number, directive, marked = "", 0, False, []
    for line in source.splitlines():
        number += 1
        if place := re.match(r'#line (\d+) "(.*)"', line):
            path, number = f"kernels/{place[2]}", int(place[1]) - 1
            continue
        directive = directive or line.lstrip().startswith("#")
        marked.append(line if directive else f"@{path}:{number}@ {line}")
        directive = directive and line.endswith("\\")
    from rptcam_cl.device.programs import _COMMENT, _active_lines

    lines: dict[str, set[int]] = defaultdict(set)
    for line in _active_lines(_COMMENT.sub(" ", "\n".join(marked)), {}):
        if at := re.match(r"@(.+):(\d+)@", line):
            lines[at[1]].add(int(at[2]))
    return lines


def pytest_configure() -> None:
    """Note the lines of kernels that launches run, where the trace of kernels is asked for."""
    room = os.environ.get(TRACED, "").removeprefix(f"{ROOT}{os.sep}")
    if not room.startswith("kernels"):
        return
    from rptcam_cl.device.session import Launch

    enqueue = Launch.enqueue

    def noted(launch: Any, *where: int) -> Any:
        for path, lines in compiled_lines(launch._program.source).items():
            if path.startswith(room):
                _LINES[path] |= lines
        return enqueue(launch, *where)

    Launch.enqueue = noted  # type: ignore[method-assign]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[Any]:
    """Note the lines of the room that a test runs, with its fixtures, and its time."""
    if TRACE not in os.environ:
        return (yield)
    _LINES.clear()
    begin = time.process_time()
    if os.environ[TRACED].startswith(f"{ROOT / 'rptcam_cl'}{os.sep}"):
        threading.settrace(_tracer)
        sys.settrace(_tracer)
    try:
        return (yield)
    finally:
        sys.settrace(None)
        threading.settrace(None)  # type: ignore[arg-type]
        root = str(ROOT) + os.sep
        lines = {name.removeprefix(root): sorted(lines) for name, lines in _LINES.items()}
        with Path(os.environ[TRACE]).open("a", encoding="utf-8") as file:
            file.write(json.dumps([item.nodeid, time.process_time() - begin, lines]) + "\n")


def _tests(tree: Path, arguments: tuple[str, ...], variables: dict[str, str], written: Path) -> None:
    """Run pytest in a process forked before any import of the project; libraries are there already."""
    file = os.open(written, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(file, 1)
    os.dup2(file, 2)
    os.chdir(tree)
    os.environ |= variables
    sys.path[:] = [str(tree), *(place for place in sys.path if Path(place).resolve() != ROOT)]
    for name in [name for name in sys.modules if name.split(".")[0] in ("tests", "rptcam_cl")]:
        del sys.modules[name]
    code = pytest.main(["-q", "-rfE", "-n", "0", "-p", "no:cacheprovider", *arguments])
    sys.stdout.flush()  # which what ends at once does not do
    os._exit(code)


class Copy:
    """A throw-away copy of the checkout in which tests run."""

    def __init__(self, room: str, folder: Path) -> None:
        self.room, self.folder, self.tree = room, folder, folder / "tree"
        shutil.copytree(ROOT, self.tree, ignore=shutil.ignore_patterns(".*", "__pycache__", "out", "dist"))
        names = [f"tests/{name}" for name in (room, *TESTS.get(room, "").split())]
        places = [name if (self.tree / name).is_dir() else f"{name}.py" for name in names]
        self.tests = [place for place in places if (self.tree / place).exists()]
        self.runs: list[tuple[str, float, dict[str, set[int]]]] = []
        self.writes = 0

    def write(self, path: Path, text: str) -> None:
        """Write a module, with a time of its own, so that no compiled one is taken for it."""
        path.write_text(text, "utf-8")
        self.writes += 10
        os.utime(path, (time.time() + self.writes,) * 2)

    def run(self, *arguments: str, limit_s: float | None = LIMIT_S, **variables: str) -> tuple[int, str]:
        """Return the exit code of pytest, and what it wrote; -1 where it took too long."""
        own = {"PYTHONPATH": str(self.tree), "XDG_CACHE_HOME": str(self.folder / "cache")}
        if not self.room.startswith("kernels/"):  # what the driver has compiled is true for every fault
            own["POCL_CACHE_DIR"] = os.environ.get("POCL_CACHE_DIR", str(Path.home() / ".cache/pocl/kcache"))
        written = self.folder / "written"
        process = multiprocessing.get_context("fork").Process(
            target=_tests, args=(self.tree, arguments, own | variables, written)
        )
        process.start()
        process.join(limit_s)
        if process.exitcode is None:
            process.kill()
            process.join()
            return -1, ""
        return process.exitcode, written.read_text("utf-8", errors="replace")

    def trace(self, kept: Path) -> None:
        """Learn which tests run which lines, from a run of them all, kept in a file; what does not pass is left out."""
        if not kept.exists():
            to = {TRACE: str(self.folder / "trace"), TRACED: f"{folder_of(self.room, self.tree)}{os.sep}"}
            paths = [self.tree / place for place in self.tests]
            files = [file for path in paths for file in (sorted(path.rglob("test_*.py")) if path.is_dir() else [path])]
            failed: set[str] = set()
            for file in dict.fromkeys(files):  # apart, as what is remembered would run in the first of them alone
                _, text = self.run("-p", "tests.support.plant", str(file.relative_to(self.tree)), limit_s=None, **to)
                failed |= set(re.findall(r"^(?:FAILED|ERROR) (\S+)", text, re.MULTILINE))
            lines = Path(to[TRACE]).read_text("utf-8").splitlines(keepends=True)
            kept.write_text("".join(line for line in lines if json.loads(line)[0].split(" ")[0] not in failed), "utf-8")
        for line in kept.read_text("utf-8").splitlines():
            name, seconds, runs = json.loads(line)
            self.runs.append((name, seconds, {path: set(numbers) for path, numbers in runs.items()}))

    def tests_for(self, fault: Fault, source: str) -> list[str]:
        """Return the tests to ask, the fastest of those that run the statement first, then the others of their files.

        Fixtures are shared, so that a test may see what another one has run. What a module does as it is imported, all
        tests of the room may see.
        """
        first = fault.line(source)
        if not fault.path.endswith(".py"):
            own = {name for name, _, runs in self.runs if first in runs.get(fault.path, ())}
            files = {name.split("::")[0] for name in own}
            near = {name for name, _, runs in self.runs if not runs and name.split("::")[0] in files}
            asked = [(name in near, seconds, name) for name, seconds, _ in self.runs if name in own | near]
            return [name for _, _, name in sorted(asked)]
        holders = [
            node for node in ast.walk(ast.parse(source))
            if isinstance(node, ast.stmt) and node.lineno <= first <= (node.end_lineno or 0)
        ]  # fmt: skip
        statement = max(holders, key=lambda node: node.lineno)
        body = getattr(statement, "body", None)
        lines = set(range(statement.lineno, body[0].lineno if body else (statement.end_lineno or first) + 1))
        inside = any(isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) for node in holders if node != statement)
        own = {name for name, _, runs in self.runs if fault.path in runs and (not inside or runs[fault.path] & lines)}
        files = {name.split("::")[0] for name in (own if inside else {name for name, _, _ in self.runs})}
        asked = [(name not in own, seconds, name) for name, seconds, _ in self.runs if name.split("::")[0] in files]
        return [name for _, _, name in sorted(asked)]

    def verdict(self, fault: Fault, source: str) -> tuple[bool, str]:
        """Return whether tests find a fault, and which one does or why none."""
        tests, listed = self.tests_for(fault, source), self.folder / "tests.txt"
        if not tests:
            return False, "no test runs the line"
        listed.write_text("\n".join(tests), "utf-8")
        try:
            self.write(self.tree / fault.path, fault.planted(source))
            code, text = self.run("-x", f"@{listed}")
        finally:
            self.write(self.tree / fault.path, source)
        if code == 0:
            return False, f"{len(tests)} tests pass"
        if "ERROR: not found" in text:
            raise SystemExit("the trace names tests that are no longer there: delete its file")
        by = re.search(r"^(?:FAILED|ERROR) (\S+)", text, re.MULTILINE)
        return True, by[1] if by else "out of time" if code == -1 else f"pytest ends with {code}"


def main() -> None:
    """Plant random faults in a room, and count those that its tests find."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("room", help="a package of rptcam_cl, or kernels/FOLDER")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", default="1")
    parser.add_argument("--trace", type=Path, help="file that keeps which tests run which lines")
    given = parser.parse_args()
    for library in LIBRARIES.split():
        importlib.import_module(library)
    with tempfile.TemporaryDirectory(prefix="rptcam-mutants-") as scratch:
        copy, survivors = Copy(given.room, Path(scratch)), 0
        faults = list(drawn(faults_of(given.room, copy.tree), given.count, f"{given.room} {given.seed}", copy.tree))
        copy.trace(given.trace or Path(scratch) / "kept")
        for number, fault in enumerate(faults, 1):
            source, begin = (copy.tree / fault.path).read_text("utf-8"), time.monotonic()
            killed, why = copy.verdict(fault, source)
            place, word = f"{fault.path}:{fault.line(source)}", "killed" if killed else "SURVIVED"
            print(f"{number:3} {word:8} {place} {fault.kind} ({why}, {time.monotonic() - begin:.0f} s)", flush=True)
            if not killed:
                survivors += 1
                both = source.splitlines(), fault.planted(source).splitlines()
                print(*difflib.unified_diff(*both, place, place, n=1, lineterm=""), sep="\n", flush=True)
        share = 100 * (1 - survivors / max(len(faults), 1))
        print(f"| {given.room} | {len(faults)} | {len(faults) - survivors} | {survivors} | {share:.0f} % |")


if __name__ == "__main__":
    main()
