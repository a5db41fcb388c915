"""``rptcam lens optimise``: a lens made better, with drawings, MTF, yield and pictures before and after."""

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import digits, number
from rptcam_cl.cli import lens_options
from rptcam_cl.cli.output import as_json, print_table, print_warnings
from rptcam_cl.cli.parser import Commands, add_command, add_device
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.imaging.image import Image
    from rptcam_cl.optics.lens import Lens
    from rptcam_cl.optics.optimise import Optimised, Problem
    from rptcam_cl.rendering.tolerances import ToleranceRun
    from rptcam_cl.scene.scene import Scene

PERCENT = 90  # of copies that are as good as the one in the picture, or better
GRADE = "commercial"
ACROSS, STRIP = 1800, 70  # pixels of the built-in board over the film, and of the strip that is rendered
SQUARE = 10  # pixels of a square of the board


def add_lens_optimise(commands: Commands) -> None:
    """Add the command."""
    text = "make a lens better: variables, bounds and merit by a file"
    parser = add_command(commands, "optimise", text, _run_lens_optimise)
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
    add_device(parser)


def _run_lens_optimise(arguments: argparse.Namespace) -> int:
    from rptcam_cl.core.files import check_writable
    from rptcam_cl.optics.files.export import lens_text
    from rptcam_cl.optics.optimise import UNITS, optimise, read_problem

    if arguments.scene is not None and arguments.report is None:
        raise InputError("--scene: needs --report FOLDER, where the pictures go")
    for path in (arguments.output, arguments.state):
        if path is not None:
            check_writable(path, [str(arguments.problem)])
    if arguments.output is not None and arguments.output.suffix not in (".yaml", ".yml"):
        raise InputError(f"{arguments.output}: a lens is written as .yaml (rptcam lens convert writes other forms)")
    problem = read_problem(arguments.problem)
    print_warnings(problem.lens.warnings)
    spec = arguments.tolerances or problem.tolerances
    scene = None if arguments.scene is None else _scene(arguments.scene, problem)
    found = optimise(problem, state=arguments.state, on_progress=lambda line: print(line, file=sys.stderr))
    print_warnings(f"{words} at the end" for words in found.lost)
    if arguments.output is not None:
        lens_options.write(lens_text(found.lens).encode(), arguments.output)
    runs = [_tolerance(lens, spec, problem) for lens in (found.start, found.lens)] if spec else []
    if arguments.report is not None:
        arguments.report.mkdir(parents=True, exist_ok=True)
        _write_drawings(found, arguments.report)
        if scene is not None:
            _write_pictures(found, scene, spec or GRADE, arguments)
    if arguments.json:
        print(as_json(_facts(found, runs)))
        return 0
    rows = [[name, before, found.after[name], UNITS.get(name, "")] for name, before in found.before.items()]
    length = [lens.first_order().focal_length_mm for lens in (found.start, found.lens)]
    rows.append(["focal length, d line", *length, "mm"])
    print_table(("", "before", "after", "unit"), rows, f"{found.lens.name}, {found.evaluations} evaluations")
    if runs:
        print_table(("copies [%]", "before", "after"), _yield_rows(runs), f"as built ({spec}), rms spot [µm]")
    return 0


def _tolerance(lens: "Lens", spec: str, problem: "Problem") -> "ToleranceRun | None":
    """The copies of a lens at the fields and wavelengths of the problem; none of a start that forms no image."""
    from rptcam_cl.rendering.tolerances import specification, tolerance

    given = specification(spec)
    beams = {"fields_degrees": problem.fields_degrees, "wavelengths_nm": problem.wavelengths_nm}
    merit = given.tolerances.merit.model_copy(update=beams)
    try:
        return tolerance(
            lens, replace(given, tolerances=given.tolerances.model_copy(update={"merit": merit})),
            with_sensitivities=False,
        )  # fmt: skip
    except InputError as trouble:
        print_warnings([f"no yield: {trouble}"])
        return None


def _yield_rows(runs: "list[ToleranceRun | None]") -> list[list[Any]]:
    from rptcam_cl.rendering.tolerances import PERCENTILES, percentile_rows

    columns = [
        [math.nan] * len(PERCENTILES) if run is None else [row["spot_um"] for row in percentile_rows(run)]
        for run in runs
    ]
    designs = [math.nan if run is None else float(run.design.spot_um[0]) for run in runs]
    rows: list[list[Any]] = [["design", *designs]]
    return rows + [[f"{percent:g}", *values] for percent, *values in zip(PERCENTILES, *columns, strict=True)]


def _facts(found: "Optimised", runs: "list[ToleranceRun | None]") -> dict[str, Any]:
    from rptcam_cl.optics.files.export import lens_text

    facts: dict[str, Any] = {
        "before": found.before, "after": found.after, "evaluations": found.evaluations, "lost_rays": found.lost,
        "film_distance_mm": found.film_mm, "focal_length_mm": found.lens.first_order().focal_length_mm,
        "lens": lens_text(found.lens),
    }  # fmt: skip
    if runs:
        facts["as_built_spot_um"] = [
            dict(zip(("copies", "before", "after"), row, strict=True)) for row in _yield_rows(runs)
        ]
    return facts


def _write_drawings(found: "Optimised", folder: Path) -> None:
    """Write the lens and its MTF, before and after; what a start cannot show is said and left out."""
    from importlib.util import find_spec

    from rptcam_cl.optics.charts import encode
    from rptcam_cl.optics.drawing import View, draw_lens
    from rptcam_cl.optics.image_quality import Setting, mtf

    problem = found.problem
    states = (("before", found.start, found.start_film_mm), ("after", found.lens, found.film_mm))
    for name, lens, film in states:
        use = Setting(lens, film if film > 0 else None)
        try:
            picture = draw_lens(use, View(fields=problem.fields_degrees))
            lens_options.write(encode(picture, folder / f"{name}.svg"), folder / f"{name}.svg")
            if find_spec("matplotlib") is not None:
                chart = mtf(use, (10.0, 20.0, 40.0), problem.fields_degrees, problem.wavelengths_nm,
                            diffraction=False, rays=None)  # fmt: skip
                chart.save(folder / f"mtf_{name}.svg")
                print(f"wrote {folder / f'mtf_{name}.svg'}", file=sys.stderr)
        except InputError as trouble:
            print_warnings([f"{name}: {trouble}"])


def _scene(given: str, problem: "Problem") -> "Scene":
    """The scene to be rendered, or the board: squares that fill the film, far enough that they are sharp together."""
    from rptcam_cl.scene.load import load_scene

    if given != "board":
        scene = load_scene(given)
        if scene.camera.kind != "realistic":
            raise InputError(f"{given}: camera.kind: must be realistic, so that a lens takes the picture")
        return scene
    length = problem.focal_length_mm
    half = length * math.tan(math.radians(max(problem.fields_degrees) or 5.0))
    away, height = 0.1 * length, 2 * half * 2 / 3  # 100 focal lengths [m]
    size = [away / length * 2 * half * 1.1, away / length * height * 1.1]
    squares = 1.1 * ACROSS / SQUARE
    strip = STRIP / (ACROSS * 2 / 3) / 2
    crop = [0.5, 0.98, 0.5 - strip, 0.5 + strip]
    checks = {"kind": "checker", "even": 0.04, "odd": 0.85, "scale": [squares, squares * 2 / 3]}
    return load_scene({
        "film": {"resolution": [ACROSS, ACROSS * 2 // 3], "width_mm": 2 * half, "crop": crop},
        "camera": {"kind": "realistic", "eye": [0, 0, away], "target": [0, 0, 0], "lens": "cooke-triplet-50mm",
                   "focus": {"distance_m": away, "method": "spot"}},
        "render": {"spp": 128},
        "objects": [{"shape": "rectangle", "corner": [-size[0] / 2, -size[1] / 2, 0], "edge_u": [size[0], 0, 0],
                     "edge_v": [0, size[1], 0], "material": {"kind": "matte", "reflectance": checks}}],
        "environment": {"kind": "constant", "radiance": 1},
    })  # fmt: skip


def _write_pictures(found: "Optimised", scene: "Scene", spec: str, arguments: argparse.Namespace) -> None:
    """Render the scene through the lens before, after, and as built, each a file, and all on one sheet."""
    from rptcam_cl.api.interface import render
    from rptcam_cl.core.files import replacing
    from rptcam_cl.core.strict_yaml import read_yaml
    from rptcam_cl.optics.files.export import lens_text
    from rptcam_cl.scene.load import set_keys

    before, after = (read_yaml(lens_text(lens)).data for lens in (found.start, found.lens))
    copy = {"design": after, "as_built": {"percentile": f"{PERCENT}%", "spec": spec}}
    pictures: list[tuple[str, Image]] = []
    for name, lens in (("before", before), ("after", after), (f"as_built_{PERCENT}", copy)):
        print(f"rendering {name}", file=sys.stderr)
        try:
            image = render(set_keys(scene, {"camera.lens": lens}), spp=arguments.spp, device=arguments.device)
        except InputError as trouble:
            print_warnings([f"no picture {name}: {trouble}"])
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
