"""``rptcam lens``: the lenses of the package, commands that look at any lens, and one that makes it better."""

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import digits, number
from rptcam_cl.cli import lens_measures, lens_options, output
from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import check_writable, known_suffix, replacing
from rptcam_cl.optics.measures import FDC

if TYPE_CHECKING:
    from rptcam_cl.imaging.image import Image
    from rptcam_cl.optics import design, ray_trace
    from rptcam_cl.optics.lens import Lens
    from rptcam_cl.optics.optimise import Optimised
    from rptcam_cl.rendering import account, tolerance_run
    from rptcam_cl.scene.scene import Scene


# ``rptcam lens convert``: a lens file of any known kind becomes one of ours, of pbrt, of Zemax or of CODE V.

_SUFFIXES = (".yaml", ".yml", ".dat", ".zmx", ".seq")


def _add_lens_convert(commands: output.Commands) -> None:
    """Add the command."""
    text = "write a lens as a file of ours (.yaml), a pbrt table (.dat) or for Zemax (.zmx) or CODE V (.seq)"
    parser = output.add_command(commands, "convert", text, _run_lens_convert)
    parser.add_argument("lens", metavar="LENS", help="a name from the list, or a lens file of any known kind")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", required=True, help=".yaml, .dat, .zmx or .seq")
    lens_options.add_catalogue(parser)
    parser.add_argument("--f-number", type=output.positive, metavar="N", help="stop down (default: as in the file)")
    parser.add_argument(
        "--focal-length-mm", type=output.positive, metavar="F", help="set a zoom lens and write it as it then is"
    )
    parser.add_argument(
        "--model-glasses", action="store_true",
        help="in .zmx and .seq, write glasses by index and Abbe number, for programs whose catalogues have others",
    )  # fmt: skip
    lens_options.add_wavelength(parser, "wavelength of the indices in a .dat table")


def _run_lens_convert(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics.files import export
    from rptcam_cl.optics.lens import zoom_to
    from rptcam_cl.optics.ray_trace import has_coatings

    suffix = known_suffix(arguments.output, _SUFFIXES, "unknown kind of lens file to write")
    lens_options.check_file(arguments.output, arguments.lens)
    lens = lens_options.load(arguments.lens, arguments.catalogue)
    comments = []
    if arguments.focal_length_mm is not None:
        lens = replace(zoom_to(lens, arguments.focal_length_mm), configurations=(), published={})
        comments.append(f"Set to a focal length of {arguments.focal_length_mm:g} mm.")
    if arguments.f_number is not None:
        lens = lens.with_stop_diameter(lens.stop_diameter_for(arguments.f_number))
        lens = replace(lens, published={"marked_f_number": lens.first_order().f_number})
        comments.append(f"Stopped down to f/{arguments.f_number:g}.")
    if suffix in (".zmx", ".seq"):
        lens = export.with_model_glasses(lens) if arguments.model_glasses else lens
        text = export.zemax_text(lens) if suffix == ".zmx" else export.codev_text(lens)
        for note in export.left_out(lens):
            print(f"a {suffix} file: {note}", file=sys.stderr)
    elif suffix != ".dat":
        text = export.lens_text(lens, comments)
    else:
        text = export.pbrt_text(lens, arguments.wavelength_nm)
        if export.loses_dispersion(lens):
            print(f"a .dat table has no dispersion: its indices are those at {arguments.wavelength_nm:g} nm",
                  file=sys.stderr)  # fmt: skip
        if has_coatings(lens):
            print("a .dat table has no coatings: they are left out", file=sys.stderr)
        if lens.focusing is not None:
            print("a .dat table has no focusing group: the lens is written focused at infinity", file=sys.stderr)
    lens_options.write(text.encode(), arguments.output)
    return 0


# ``rptcam lens design``: single lenses and achromats from closed forms, as lens files.

_CONSTRAINTS = ("r1=r2", "r2=r3", "flat-r3")


def _add_lens_design(commands: output.Commands) -> None:
    """Add the command with its own commands."""
    text = "make a lens file of a single lens or an achromatic doublet"
    inner = output.add_command(commands, "design", text, output.run_nothing).add_commands("design_command")
    text = "a single lens by the lensmaker's equation"
    single = output.add_command(inner, "singlet", text, _singlet)
    _add_common(single)
    single.add_argument("--glass", metavar="G", default="N-BK7", help=f"{_GLASS_HELP} (default: %(default)s)")
    single.add_argument(
        "--bending", type=output.finite, metavar="Q", default=0.0,
        help="(R2 + R1) / (R2 - R1): 0 equal radii, 1 plane on the film side, -1 on the scene side (default: 0)",
    )  # fmt: skip
    single.add_argument(
        "--focus-distance-m",
        type=output.positive,
        metavar="D",
        help="also write the distances that focus an object this far from the film",
    )
    text = "a cemented achromat from two glasses and one more condition"
    double = output.add_command(inner, "doublet", text, _doublet)
    _add_common(double)
    double.add_argument("--crown", metavar="G", default="N-BK7", help=f"{_GLASS_HELP} (default: %(default)s)")
    double.add_argument("--flint", metavar="G", default="F2", help="glass on the film side (default: %(default)s)")
    third = double.add_mutually_exclusive_group()
    third.add_argument(
        "--constraint", choices=_CONSTRAINTS, default="r1=r2",
        help="biconvex first lens, biconcave second lens, or plane last surface (default: %(default)s)",
    )  # fmt: skip
    third.add_argument("--r1-mm", type=output.finite, metavar="R", help="first radius, in place of a constraint")


_GLASS_HELP = "a name as N-BK7, n_d/V_d as 1.517/64.2, or an index as 1.5"


def _add_common(parser: output.Parser) -> None:
    parser.add_argument(
        "--focal-length-mm", type=output.finite, required=True, metavar="F", help="below 0: a diverging lens"
    )
    parser.add_argument("--diameter-mm", type=output.positive, required=True, metavar="D", help="clear diameter")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="write here (default: standard output)")


def _glass(text: str) -> "design.GlassChoice":
    """The glass that a word names."""
    from rptcam_cl.optics.design import GlassChoice
    from rptcam_cl.optics.files import glasses, native
    from rptcam_cl.optics.glass import abbe_number

    entry: Any = text
    parts = text.split("/")
    try:
        numbers = [float(part) for part in parts]
        entry = {"index": numbers[0]} if len(numbers) == 1 else {"nd": numbers[0], "vd": numbers[1]}
    except ValueError:
        pass
    medium = glasses.read_glass(native.document_of({"name": "design", "glass": entry}), ("glass",))
    return GlassChoice(float(medium.index(LINE_D_NM)), abbe_number(medium), entry)


def _focal_lengths(lens: "Lens") -> list[str]:
    first = lens.first_order()
    lines = [f"focal length {first.focal_length_mm:.6g} mm at n_d, f/{first.f_number:.4g}"]
    lines.append(f"last surface to rear focal point {first.back_focal_distance_mm:.6g} mm")
    names = zip("FdC", (lens.first_order(wave).focal_length_mm for wave in FDC), strict=True)
    lines.append("focal length at " + ", ".join(f"{name} {length:.6g}" for name, length in names) + " mm")
    return lines


def _write_lens(arguments: argparse.Namespace, lens: "Lens", comments: list[str]) -> int:
    from rptcam_cl.optics.files.export import lens_text

    text = lens_text(lens, [*comments, *_focal_lengths(lens)])
    if arguments.output is None:
        print(text, end="")
    else:
        lens_options.write(text.encode(), arguments.output)
    return 0


def _singlet(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics import design, library
    from rptcam_cl.optics.lens import film_distance

    lens_options.check_file(arguments.output, "")
    glass = _glass(arguments.glass)
    lens = library.load_lens(design.singlet(arguments.focal_length_mm, glass, arguments.diameter_mm, arguments.bending))
    comments = []
    if arguments.focus_distance_m is not None:
        distance = 1000 * arguments.focus_distance_m
        near, far = design.image_distances(arguments.focal_length_mm, distance)
        comments.append(
            f"object {arguments.focus_distance_m:g} m from the film: thin lens {near:.6g} mm (or {far:.6g} mm) before "
            f"the film; this lens: last surface to film {film_distance(lens, distance):.6g} mm"
        )
    return _write_lens(arguments, lens, comments)


def _doublet(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics import design, library

    lens_options.check_file(arguments.output, "")
    crown, flint = _glass(arguments.crown), _glass(arguments.flint)
    if math.isinf(crown.abbe) or math.isinf(flint.abbe):
        raise InputError("an achromat needs glasses that disperse: name them, or give n_d/V_d as 1.517/64.2")
    constraint, r1 = arguments.constraint.replace("-", " "), 0.0
    if arguments.r1_mm is not None:
        constraint, r1 = "r1", arguments.r1_mm
    focal_length = arguments.focal_length_mm
    lens = library.load_lens(design.doublet(focal_length, crown, flint, arguments.diameter_mm, constraint, r1))
    radii = design.doublet_radii(focal_length, crown, flint, constraint, r1)
    shown = ", ".join("plane" if math.isinf(radius) else f"{radius:.6g}" for radius in radii)
    return _write_lens(arguments, lens, [f"thin achromat of {focal_length:g} mm: radii {shown} mm"])


# ``rptcam lens draw``: a lens in cross-section with its rays.


def _add_lens_draw(commands: output.Commands) -> None:
    """Add the command."""
    text = "draw a lens in cross-section, with rays traced by a device"
    description = f"{text.capitalize()}; a red cross is where a ray was blocked."
    parser = output.add_command(commands, "draw", text, _run_lens_draw, description)
    lens_options.add_lens_argument(parser)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help=".svg, .png or .pdf (default: SVG to standard output)"
    )
    parser.add_argument(
        "--section", choices=("y", "x"), default="y", help="the y-z plane or the x-z plane (default: %(default)s)"
    )
    parser.add_argument(
        "--fields", type=lens_options.angles, metavar="A,B,…",
        help="angles from the axis in degrees (default: chosen from the lens)",
    )  # fmt: skip
    lens_options.add_wavelengths(parser, (LINE_D_NM,))
    parser.add_argument(
        "--rays", type=lens_options.count, metavar="N", default=7,
        help="rays that pass, for each field and wavelength (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--only-passing", action="store_true", help="leave out the rays that are blocked")
    parser.add_argument(
        "--device", metavar="SPEC",
        help="traces the rays: an index as 0:0, a part of a name, cpu, gpu, auto, or none for the float64 reference "
        "on the host (default: auto, or the reference where there is no device)",
    )  # fmt: skip


def _run_lens_draw(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics import charts, drawing

    lens_options.check_picture(arguments.output, arguments.lens, charts.DRAWN)
    state = lens_options.lens_in_use(arguments, arguments.wavelengths[len(arguments.wavelengths) // 2])
    tracer, name = lens_options.tracer_of(arguments.device, state.lens)
    view = drawing.View(
        section=arguments.section,
        fields=arguments.fields,
        rays=arguments.rays,
        wavelengths_nm=arguments.wavelengths,
        blocked=not arguments.only_passing,
    )
    picture = drawing.draw_lens(state, view, tracer)
    print(f"rays traced {name}", file=sys.stderr)
    if state.film_distance_mm is None:
        print("this lens forms no real image of a distant object: no film is drawn", file=sys.stderr)
    if arguments.output is None:
        print(charts.svg_text(picture), end="")
    lens_options.write_picture(picture, arguments.output)
    return 0


def add_lens(parser: output.Parser) -> None:
    """Add the commands of the command."""
    inner = parser.add_commands("lens_command")
    text = "list the lenses that come with the package"
    listing = output.add_command(inner, "list", text, _list)
    form = listing.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print JSON, with source, focal length and f-number")
    form.add_argument("--markdown", action="store_true", help="print the same as a table in Markdown")
    text = "print the first-order data of a lens"
    info = output.add_command(inner, "info", text, _info)
    lens_options.add_lens_argument(info)
    lens_options.add_wavelength(info)
    info.add_argument(
        "--transmission", choices=("ideal", "bare", "coated"),
        help="light lost in the lens: none, by bare surfaces and glass, or by coated ones (default: ideal)",
    )  # fmt: skip
    lens_options.add_coating(info)
    info.add_argument("--json", action="store_true", help="print JSON")
    for add in (
        _add_lens_draw,
        lens_measures.add_lens_measurements,
        lens_measures.add_lens_breathing,
        lens_measures.add_lens_focus_scale,
        lens_measures.add_lens_tolerance,
        lens_measures.add_lens_ghosts,
        lens_measures.add_lens_trace,
        _add_lens_convert,
        _add_lens_design,
        _add_lens_optimise,
    ):
        add(inner)


def _list(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics.library import list_lenses, load_lens

    lenses = {name: load_lens(name) for name in list_lenses()}
    if arguments.json or arguments.markdown:
        rows = [_row(name, lens) for name, lens in lenses.items()]
        print(output.as_json(rows) if arguments.json else _markdown(rows))
        return 0
    width = max(map(len, lenses), default=0)
    for name, lens in lenses.items():
        print(f"{name:<{width}}  {lens.name}")
    return 0


def _row(name: str, lens: "Lens") -> dict[str, Any]:
    first = lens.first_order()
    return {
        "name": name,
        "lens": lens.name,
        "focal_length_mm": first.focal_length_mm,
        "f_number": first.f_number,
        "surfaces": first.surfaces,
        "source": lens.source,
    }


def _markdown(rows: list[dict[str, Any]]) -> str:
    lines = ["| name | lens | f [mm] | f/ | surfaces | source |", "|---|---|---|---|---|---|"]
    for row in rows:
        cells = (row["name"], row["lens"], f"{row['focal_length_mm']:.4g}", f"{row['f_number']:.3g}", row["surfaces"])
        source = row["source"].replace("|", "\\|")
        lines.append(f"| `{cells[0]}` | {' | '.join(map(str, cells[1:]))} | {source} |")
    return "\n".join(lines)


def _label(key: str) -> str:
    """A key as words: ``back_focal_distance_mm`` is ``back focal distance [mm]``."""
    for unit in ("mm", "nm", "m", "degrees"):
        if key.endswith(f"_{unit}"):
            return f"{key.removesuffix(f'_{unit}').replace('_', ' ')} [{unit}]"
    return key.replace("_", " ")


def _lines(facts: dict[str, Any], indent: str = "") -> list[str]:
    lines = []
    for key, value in facts.items():
        label = f"{indent}{_label(key)}"
        if isinstance(value, dict):
            lines += [label, *_lines(value, indent + "  ")]
        else:
            shown = f"{value:.6g}" if isinstance(value, float) and math.isfinite(value) else value
            lines.append(f"{label:<32}{'-' if shown is None else shown}")
    return lines


def _transmission(arguments: argparse.Namespace, lens: "Lens") -> "ray_trace.LensTransmission":
    """The losses by the options."""
    from rptcam_cl.optics.ray_trace import BY_NAME, has_coatings

    name = arguments.transmission or ("ideal" if arguments.coating is None else "coated")
    if name != "coated" and arguments.coating is not None:
        raise InputError(f"--coating: has no effect with --transmission {name} (allowed only with coated)")
    if name == "coated" and not has_coatings(lens):
        raise InputError(f"--transmission: {lens.name} does not say how it is coated (give --coating, such as mgf2)")
    return BY_NAME[name]


def _info(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics.irradiance import lens_info

    lens = lens_options.zoomed_lens(arguments, arguments.wavelength_nm)
    distance = math.inf if arguments.focus_distance_m is None else 1000 * arguments.focus_distance_m
    facts = lens_info(lens, arguments.f_number, distance, arguments.wavelength_nm, _transmission(arguments, lens))
    if arguments.json:
        print(output.as_json(facts))
    else:
        del facts["warnings"]  # which standard error has
        if facts["film_distance_mm"] is not None and facts["image_circle_mm"] is None:
            facts["image_circle_mm"] = "without end: no rim of the lens ends it"
        print("\n".join(_lines({"name": facts["name"], "source": facts["source"]} | facts)))
    return 0


# ``rptcam lens optimise``: a lens made better, with drawings, MTF, yield and pictures before and after.

_PERCENT = 90  # of copies that are as good as the one in the picture, or better
_GRADE = "commercial"
STRIP = 70  # pixels of the built-in board that are rendered, from above to below


def _add_lens_optimise(commands: output.Commands) -> None:
    """Add the command."""
    text = "make a lens better: variables, bounds and merit by a file"
    parser = output.add_command(commands, "optimise", text, _run_lens_optimise)
    parser.add_argument("problem", type=Path, metavar="FILE", help="a YAML file: lens, variables, bounds, merit")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="write the lens here, .yaml")
    parser.add_argument(
        "--state", type=Path, metavar="FILE", help="write the state of the search here, and go on from it where it is"
    )
    parser.add_argument(
        "--report", type=Path, metavar="FOLDER", help="write drawings and MTF before and after here, and the pictures"
    )
    parser.add_argument(
        "--scene", metavar="FILE",
        help="render it through the lens before, after, and through the copy that 90 %% equal or surpass; `board` is a "
        "built-in one, from the middle of the picture to its side (needs --report)",
    )  # fmt: skip
    parser.add_argument(
        "--tolerances", metavar="SPEC",
        help="print the yield before and after: a grade or a YAML file (default: as the problem says, else none)",
    )  # fmt: skip
    spp = number(digits, 1, 1_000_000, "1 to 1000000")
    parser.add_argument("--spp", type=spp, metavar="N", help="samples per pixel of the pictures (default: the scene's)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    output.add_device(parser)


def _check_files_to_write(arguments: argparse.Namespace) -> None:
    if arguments.scene is not None and arguments.report is None:
        raise InputError("--scene: needs --report FOLDER, where the pictures go")
    for path in (arguments.output, arguments.state):
        if path is not None:
            check_writable(path, [str(arguments.problem)])
    if arguments.output is not None and arguments.output.suffix not in (".yaml", ".yml"):
        raise InputError(f"{arguments.output}: a lens is written as .yaml (rptcam lens convert writes other forms)")


def _run_lens_optimise(arguments: argparse.Namespace) -> int:
    from rptcam_cl.device.session import open_sessions
    from rptcam_cl.optics.design import read_problem
    from rptcam_cl.optics.files.export import lens_text
    from rptcam_cl.optics.optimise import optimise
    from rptcam_cl.rendering.tolerance_run import spot_of_copies

    _check_files_to_write(arguments)
    problem = read_problem(arguments.problem)
    output.print_warnings(problem.lens.warnings)
    spec = arguments.tolerances or problem.tolerances
    scene = None if arguments.scene is None else _scene(arguments.scene, problem)
    names = {term.name for term in problem.terms}
    judges: dict[str, Any] = {}
    if "as_built" in names:
        judges["as_built"] = spot_of_copies(problem)
    if "picture" in names:
        from rptcam_cl.rendering.account import ZONE_SAMPLES, blur_of_zones

        device = open_sessions(output.device_of(arguments))[0][0]
        judges["picture"] = blur_of_zones(problem, device)
    found = optimise(
        problem, state=arguments.state, on_progress=lambda line: print(line, file=sys.stderr), judge=judges
    )
    output.print_warnings(f"{words} at the end" for words in found.lost)
    both = []
    if "picture" in judges:
        anew = blur_of_zones(problem, device, 4 * ZONE_SAMPLES, seed=1)
        both = [anew(*state) for state in ((found.start, found.start_film_mm), (found.lens, found.film_mm))]
    if found.no_better:
        output.print_warnings([f"the lens is no better by its merit than its start: {found.no_better}"])
    elif both and both[1].value > both[0].value - 2 * math.hypot(both[0].error, both[1].error):
        output.print_warnings(["by other samples the picture is no sharper than that of the start"])
    if arguments.output is not None:
        lens_options.write(lens_text(found.lens).encode(), arguments.output)
    runs = [_tolerance(lens, spec, problem) for lens in (found.start, found.lens)] if spec else []
    if arguments.report is not None:
        arguments.report.mkdir(parents=True, exist_ok=True)
        _write_drawings(found, arguments.report)
        if scene is not None:
            _write_pictures(found, scene, spec or _GRADE, arguments)
    if arguments.json:
        print(output.as_json(_facts(found, runs, both)))
    else:
        _print_found(found, runs, both, spec)
    return 0


def _print_found(found: "Optimised", runs: list[Any], both: list[Any], spec: str | None) -> None:
    """Print the terms of the merit before and after, figures of the picture, if any, and the yield of copies."""
    from rptcam_cl.optics.design import UNITS

    rows = [[name, before, found.after[name], UNITS.get(name, "")] for name, before in found.before.items()]
    length = [lens.first_order().focal_length_mm for lens in (found.start, found.lens)]
    rows.append(["focal length, d line", *length, "mm"])
    if both:
        rows.append(["picture by other samples", *(f"{one.value:.4g} ± {one.error:.2g}" for one in both), "%"])
    output.print_table(("", "before", "after", "unit"), rows, f"{found.lens.name}, {found.evaluations} evaluations")
    if runs:
        output.print_table(("copies [%]", "before", "after"), _yield_rows(runs), f"as built ({spec}), rms spot [µm]")


def _tolerance(lens: "Lens", spec: str, problem: "design.Problem") -> "tolerance_run.ToleranceRun | None":
    """The copies of a lens at the fields and wavelengths of the problem; none of a start that forms no image."""
    from rptcam_cl.optics.lens import film_distance
    from rptcam_cl.rendering import tolerance_run, tolerances

    given = tolerances.specification(spec)
    beams = {"fields_degrees": problem.fields_degrees, "wavelengths_nm": problem.wavelengths_nm}
    state: dict[str, Any] = {"merit": given.tolerances.merit.model_copy(update=beams)}
    if math.isfinite(problem.object_distance_mm):
        film = film_distance(lens, problem.object_distance_mm, "front")
        state["focus_distance_m"] = (problem.object_distance_mm + lens.length + film) / 1000
    try:
        return tolerance_run.tolerance(
            lens, replace(given, tolerances=given.tolerances.model_copy(update=state)), with_sensitivities=False
        )
    except InputError as trouble:
        output.print_warnings([f"no yield: {trouble}"])
        return None


def _yield_rows(runs: "list[tolerance_run.ToleranceRun | None]") -> list[list[Any]]:
    from rptcam_cl.rendering.tolerance_run import PERCENTILES, percentile_rows

    columns = [
        [math.nan] * len(PERCENTILES) if run is None else [row["spot_um"] for row in percentile_rows(run)]
        for run in runs
    ]
    designs = [math.nan if run is None else float(run.design.spot_um[0]) for run in runs]
    rows: list[list[Any]] = [["design", *designs]]
    return rows + [[f"{percent:g}", *values] for percent, *values in zip(PERCENTILES, *columns, strict=True)]


def _facts(
    found: "Optimised", runs: "list[tolerance_run.ToleranceRun | None]", pictures: "list[account.ZoneBlur]"
) -> dict[str, Any]:
    from rptcam_cl.optics.files.export import lens_text

    facts: dict[str, Any] = {
        "before": found.before, "after": found.after, "evaluations": found.evaluations, "lost_rays": found.lost,
        "film_distance_mm": found.film_mm, "focal_length_mm": found.lens.first_order().focal_length_mm,
        "lens": lens_text(found.lens),
    }  # fmt: skip
    if pictures:
        named = zip(("before", "after"), pictures, strict=True)
        facts["picture_by_other_samples"] = {name: {"value": one.value, "error": one.error} for name, one in named}
    if runs:
        facts["as_built_spot_um"] = [
            dict(zip(("copies", "before", "after"), row, strict=True)) for row in _yield_rows(runs)
        ]
    return facts


def _write_drawings(found: "Optimised", folder: Path) -> None:
    """Write the lens and its MTF, before and after; what a start cannot show is said and left out."""
    from importlib.util import find_spec

    from rptcam_cl.optics import charts, drawing, spots

    problem = found.problem
    states = (("before", found.start, found.start_film_mm), ("after", found.lens, found.film_mm))
    for name, lens, film in states:
        use = spots.Setting(lens, film if film > 0 else None, problem.object_distance_mm)
        try:
            picture = drawing.draw_lens(use, drawing.View(fields=problem.fields_degrees))
            lens_options.write(charts.encode(picture, folder / f"{name}.svg"), folder / f"{name}.svg")
            if find_spec("matplotlib") is not None:
                chart = spots.mtf(use, (10.0, 20.0, 40.0), problem.fields_degrees, problem.wavelengths_nm,
                            diffraction=False, rays=None)  # fmt: skip
                chart.save(folder / f"mtf_{name}.svg")
                print(f"wrote {folder / f'mtf_{name}.svg'}", file=sys.stderr)
        except InputError as trouble:
            output.print_warnings([f"{name}: {trouble}"])


def _scene(given: str, problem: "design.Problem") -> "Scene":
    """The scene to be rendered, or the board: squares that fill the film, far enough that they are sharp together."""
    from rptcam_cl.optics.design import BOARD
    from rptcam_cl.rendering.account import BOARD_PIXELS, board
    from rptcam_cl.scene import changes, load

    if given != BOARD:
        scene = load.load_scene(given)
        if scene.camera.kind != "realistic":
            raise InputError(f"{given}: camera.kind: must be realistic, so that a lens takes the picture")
        return scene
    strip = STRIP / (BOARD_PIXELS * 2 / 3) / 2
    return changes.change_scene(board(problem), film={"crop": (0.5, 0.98, 0.5 - strip, 0.5 + strip)})


def _write_pictures(found: "Optimised", scene: "Scene", spec: str, arguments: argparse.Namespace) -> None:
    """Render the scene through the lens before, after, and as built, each a file, and all on one sheet."""
    from rptcam_cl.api.job import render
    from rptcam_cl.core.strict_yaml import read_yaml
    from rptcam_cl.optics.files.export import lens_text
    from rptcam_cl.scene.changes import set_keys

    before, after = (read_yaml(lens_text(lens)).data for lens in (found.start, found.lens))
    copy = {"design": after, "as_built": {"percentile": f"{_PERCENT}%", "spec": spec}}
    pictures: list[tuple[str, Image]] = []
    for name, lens in (("before", before), ("after", after), (f"as_built_{_PERCENT}", copy)):
        print(f"rendering {name}", file=sys.stderr)
        try:
            image = render(set_keys(scene, {"camera.lens": lens}), spp=arguments.spp, device=arguments.device)
        except InputError as trouble:
            output.print_warnings([f"no picture {name}: {trouble}"])
            continue
        image.save(arguments.report / f"{name}.png")
        pictures.append((name.replace("_", " "), image))
    if pictures:
        with replacing(arguments.report / "pictures.png") as temporary:
            _sheet(pictures).save(temporary, format="png")
        print(f"wrote {arguments.report / 'pictures.png'}", file=sys.stderr)


def _sheet(pictures: "list[tuple[str, Image]]") -> Any:
    """One below the other where they are wide, else side by side, at full size with names."""
    import numpy as np
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    shown = [
        (name, Pillow.fromarray(np.uint8(255 * np.clip(image.developed(), 0, 1) + 0.5))) for name, image in pictures
    ]
    width, height = shown[0][1].size
    columns = 1 if width > 2 * height else len(shown)
    font, edge = ImageFont.load_default(18), 26
    sheet = Pillow.new("RGB", (columns * width, -(-len(shown) // columns) * (height + edge)), "white")
    draw = ImageDraw.Draw(sheet)
    for number_, (name, picture) in enumerate(shown):
        x, y = number_ % columns * width, number_ // columns * (height + edge)
        draw.text((x + 4, y + 2), name, "black", font)
        sheet.paste(picture, (x, y + edge))
    return sheet
