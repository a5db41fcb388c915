"""What the commands that look at a lens have in common: the lens in use, its tracer, and files to write."""

import argparse
import csv
import json
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import digits, number
from rptcam_cl.cli.output import positive, print_warnings
from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import DeviceError, InputError
from rptcam_cl.core.files import check_writable, replacing
from rptcam_cl.optics.measures import STEEPEST

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rptcam_cl.optics.charts import Drawing
    from rptcam_cl.optics.drawing import Tracer
    from rptcam_cl.optics.glass import Coating, Layer
    from rptcam_cl.optics.lens import Lens
    from rptcam_cl.optics.spots import Setting


def number_list(
    allowed: str, is_allowed: Callable[[float], bool], read: Callable[[str], list[float]] | None = None
) -> Callable[[str], list[float]]:
    """Make the reader of numbers with commas between.

    Parameters
    ----------
    allowed
        What they may be, in words.
    is_allowed
        Whether a number may be; not a number may not.
    read
        A reader that refuses more; any numbers are read without it.
    """

    def parse(text: str) -> list[float]:
        try:
            values = [float(part) for part in text.split(",")] if read is None else read(text)
        except ValueError:
            values = [math.nan]
        if not all(map(is_allowed, values)):
            raise argparse.ArgumentTypeError(f"got {text}; allowed {allowed}")
        return values

    return parse


numbers = number_list("numbers with commas between, as 0,10,20", lambda value: -1e12 < value < 1e12)
angles = number_list("angles between -89 and 89 degrees", lambda angle: abs(angle) < 89, numbers)
steep_angles = number_list(
    f"angles from -{STEEPEST:g} to {STEEPEST:g} degrees", lambda angle: abs(angle) <= STEEPEST, numbers
)
# As `wavelength_nm` of cameras: glasses are known there.
wavelengths = number_list("wavelengths from 200 to 3000 nm", lambda value: 200 <= value <= 3000, numbers)
distances = number_list("distances above 0 m, as 0.8,2,inf", lambda value: value > 0)
count = number(digits, 1, 2000, "1 to 2000")  # of rays or points
temperature = number(float, -100, 140, "-100 to 140 degrees Celsius")  # at which the constants of glasses hold
pressure = number(float, 0, 2000, "0 to 2000 hPa")  # of air
expansion = number(float, -1e-5, 1e-3, "-1e-05 to 0.001 per kelvin")


def wavelength(text: str) -> float:
    """One wavelength [nm]."""
    values = wavelengths(text)
    if len(values) != 1:
        raise argparse.ArgumentTypeError(f"got {text}; allowed one wavelength from 200 to 3000 nm")
    return values[0]


def add_lens_argument(parser: argparse.ArgumentParser) -> None:
    """Add the lens and how it is set."""
    parser.add_argument("lens", metavar="LENS", help="a name from the list, or a lens file")
    parser.add_argument("--f-number", type=positive, metavar="N", help="stop down (default: as in the file)")
    parser.add_argument(
        "--focus-distance-m", type=positive, metavar="D",
        help="distance from the object to the film in metres (default: infinity)",
    )  # fmt: skip
    add_catalogue(parser)
    parser.add_argument(
        "--temperature-c", type=temperature, metavar="T", default=20.0,
        help="temperature of lens and air in degrees Celsius; the film is focused anew (default: 20)",
    )  # fmt: skip
    parser.add_argument(
        "--pressure-hpa", type=pressure, metavar="P", default=1013.25, help="of the air (default: %(default)s)"
    )
    parser.add_argument(
        "--barrel", type=barrel, metavar="M", default="aluminium",
        help="what holds the elements: a material, or its linear expansion per kelvin (default: aluminium)",
    )  # fmt: skip
    zoom = parser.add_mutually_exclusive_group()
    zoom.add_argument("--zoom", metavar="NAME", help="position of a zoom lens, by its name (default: the first)")
    zoom.add_argument(
        "--focal-length-mm", type=positive, metavar="F", help="set a zoom lens, between its positions too"
    )


def barrel(text: str) -> str | float:
    """A material, or a linear expansion [1/K]."""
    from rptcam_cl.optics.as_built import BARRELS

    if text in BARRELS:
        return text
    try:
        return expansion(text)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(
            f"got {text}; allowed {', '.join(BARRELS)}, or an expansion as 2.4e-5"
        ) from None


def add_catalogue(parser: argparse.ArgumentParser) -> None:
    """Add the glass makers to try first."""
    parser.add_argument(
        "--catalogue", action="append", default=[], metavar="MAKER",
        help="glass maker to try first for lens files of other programs, such as SCHOTT; may be repeated "
        "(default: as the file says, else SCHOTT, OHARA, HOYA, ...)",
    )  # fmt: skip


def coating(text: str) -> "Coating":
    """The coating of a word, of a reflectance such as 0.005, or of layers such as 1.38:99.6,2.1:131."""
    from rptcam_cl.optics.files.glasses import WORDS, coating_of

    if text in WORDS:
        return coating_of(text)
    if ":" in text:
        return coating_of(_layers(text))
    try:
        share = float(text)
    except ValueError:
        share = math.nan
    if not 0 <= share < 1:
        raise argparse.ArgumentTypeError(
            f"got {text}; allowed {', '.join(WORDS)}, a reflectance from 0 to below 1, or layers as 1.38:99.6,2.1:131"
        )
    return coating_of(share)


def _layers(text: str) -> "tuple[Layer, ...]":
    """The layers of ``index:nm`` or ``index:nm:extinction`` with commas between, from the air to the glass."""
    from rptcam_cl.core.records import MOST_LAYERS
    from rptcam_cl.optics.glass import Layer

    try:
        rows = [[float(value) for value in part.split(":")] for part in text.split(",")]
    except ValueError:
        rows = []
    right = [
        2 <= len(row) <= 3 and 0 <= (k := row[2] if row[2:] else 0) <= 20
        and (1 <= row[0] <= 5 or (0 < row[0] <= 5 and k > 0)) and 0 < row[1] < math.inf
        for row in rows
    ]  # fmt: skip
    if not 1 <= len(rows) <= MOST_LAYERS or not all(right):
        raise argparse.ArgumentTypeError(
            f"got {text}; allowed 1 to {MOST_LAYERS} layers from the air to the glass, each index:nm, as"
            " 1.38:99.6,2.1:131, with an index from 1 to 5, or index:nm:extinction of one that absorbs"
        )
    return tuple(Layer(*row) for row in rows)


def add_coating(parser: argparse.ArgumentParser) -> None:
    """Add the coating of the surfaces between glass and air."""
    parser.add_argument(
        "--coating", type=coating, metavar="C",
        help="of all surfaces between glass and air: bare, mgf2, multi, a reflectance as 0.005, or "
        "layers as 1.38:99.6,2.1:131 [nm] (default: as in the file)",
    )  # fmt: skip


def add_wavelengths(parser: argparse.ArgumentParser, default: tuple[float, ...]) -> None:
    """Add the wavelengths to trace."""
    shown = ",".join(f"{value:g}" for value in default)
    parser.add_argument(
        "--wavelengths", type=wavelengths, metavar="W,W,…", default=list(default),
        help=f"in nanometres (default: {shown})",
    )  # fmt: skip


def add_wavelength(parser: argparse.ArgumentParser, text: str = "wavelength in nanometres") -> None:
    """Add one wavelength, the d line by default."""
    parser.add_argument(
        "--wavelength-nm", type=wavelength, metavar="W", default=LINE_D_NM, help=f"{text} (default: %(default)s)"
    )


def add_plot(parser: argparse.ArgumentParser, *, has_chart: bool = True, has_array: bool = False) -> None:
    """Add JSON and the plot, where there is one; perhaps an array in its place."""
    parser.add_argument("--json", action="store_true", help="print JSON")
    if has_chart:
        text = "write the share of light per pixel, .npy, or plot it, .svg, .png or .pdf"
        text = text if has_array else "write the plot, .svg, .png or .pdf"
        parser.add_argument("-o", "--output", type=Path, metavar="FILE", help=text)


def lens_in_use(arguments: argparse.Namespace, wavelength_nm: float = LINE_D_NM) -> "Setting":
    """The lens as the options set it; doubts about it go to standard error."""
    from rptcam_cl.optics.spots import setting

    lens = zoomed_lens(arguments, wavelength_nm)
    return setting(lens, arguments.f_number, arguments.focus_distance_m, wavelength_nm)


def zoomed_lens(arguments: argparse.Namespace, wavelength_nm: float) -> "Lens":
    """The lens at the focal length, temperature and coating by the options; doubts about it go to standard error."""
    from rptcam_cl.optics.as_built import BARRELS, Heat
    from rptcam_cl.optics.lens import at_position
    from rptcam_cl.optics.ray_trace import with_coating

    lens = load(arguments.lens, arguments.catalogue)
    lens = at_position(lens, arguments.zoom, arguments.focal_length_mm, wavelength_nm)
    if arguments.f_number is not None:
        print_warnings(lens.speed_note(arguments.f_number, wavelength_nm))
    held = arguments.barrel if isinstance(arguments.barrel, float) else BARRELS[arguments.barrel]
    lens = Heat(arguments.temperature_c, arguments.pressure_hpa, held).lens(lens)
    coating = getattr(arguments, "coating", None)
    return lens if coating is None else with_coating(lens, coating)


def load(source: str, catalogues: Sequence[str] = ()) -> "Lens":
    """A lens; doubts about it go to standard error."""
    from rptcam_cl.optics.library import load_lens

    lens = load_lens(source, catalogues=catalogues)
    print_warnings(lens.warnings)
    return lens


def tracer_of(spec: str | None, lens: "Lens") -> "tuple[Tracer, str]":
    """What traces rays from the scene, and how it is called: a device, or the float64 reference.

    Parameters
    ----------
    spec
        ``none`` for the reference, else as ``--device``. When absent, the default device if there is one that takes
        the lens.
    """
    from rptcam_cl.device.session import open_session
    from rptcam_cl.optics.drawing import reference
    from rptcam_cl.rendering.traceable_lens import device_tracer

    if spec == "none" or (spec is None and lens.phases):
        return reference, "in float64 on the host"
    try:
        session = open_session(spec)
    except DeviceError:
        if spec is not None:
            raise
        return reference, "in float64 on the host (no OpenCL device)"
    return device_tracer(session), f"on {session.info.id} {session.info.name}, single precision"


def check_file(output: Path | None, lens: str) -> None:
    """Refuse, before anything is traced, a file that could not be written."""
    if output is not None:
        check_writable(output, [lens])


def check_picture(output: Path | None, lens: str, plain: Sequence[str] = ()) -> None:
    """Refuse, before anything is traced, a picture that could not be written; `plain` suffixes need no matplotlib."""
    from rptcam_cl.optics.charts import check_suffix

    if output is not None:
        check_suffix(output, plain)
        check_file(output, lens)


def write(data: bytes, output: Path) -> None:
    """Write a file, whole or not at all, and say so."""
    with replacing(output) as temporary:
        temporary.write_bytes(data)
    print(f"wrote {output}", file=sys.stderr)


def write_picture(picture: "Drawing | Figure", output: Path | None) -> None:
    """Write a picture, if a file is given."""
    from rptcam_cl.optics.charts import encode

    if output is not None:
        write(encode(picture, output), output)


# Rays from files: JSON, or CSV with columns x, y, z, dx, dy, dz and perhaps wavelength_nm.

COLUMNS = ("x", "y", "z", "dx", "dy", "dz")

_Ray = tuple[list[float], float | None]  # point and direction, and perhaps a wavelength


RayList = tuple[list[list[float]], list[list[float]], list[float]]
"""Rays to trace: points [mm], directions and wavelengths [nm]."""


def read_rays(name: str, wavelength_nm: float) -> RayList:
    """The rays of a file, or of standard input for ``-``; those without a wavelength get the one given."""
    try:
        if name == "-":
            text = sys.stdin.read()
        else:
            with open(name, encoding="utf-8-sig") as file:  # noqa: PTH123, as a Path would turn "-" into a name
                text = file.read()
    except UnicodeDecodeError:
        raise InputError(f"{name}: is not text; rays are JSON or CSV") from None
    start = text.lstrip()[:1]
    if not start:
        raise InputError(f"{name}: holds no rays")
    rows = _from_json(text, name) if start in "[{" else _from_csv(text, name)
    if not rows:
        raise InputError(f"{name}: holds no rays")
    for place, (values, wavelength) in rows:
        _check(place, values, wavelength)
    rays = [ray for _, ray in rows]
    wavelengths_nm = [wavelength_nm if wavelength is None else wavelength for _, wavelength in rays]
    return [values[:3] for values, _ in rays], [values[3:] for values, _ in rays], wavelengths_nm


def _check(place: str, values: list[float], wavelength: float | None) -> None:
    if not all(map(math.isfinite, values)):
        raise InputError(f"{place}: every number must be finite")
    if not any(values[3:]):
        raise InputError(f"{place}: the direction is 0, 0, 0")
    if wavelength is not None and not 0 < wavelength < math.inf:
        raise InputError(f"{place}: wavelength_nm must be above 0 (got {wavelength:g})")


def _from_json(text: str, name: str) -> list[tuple[str, _Ray]]:
    try:
        data = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise InputError(f"{name}: is not JSON: {error}") from None
    rows = data.get("rays") if isinstance(data, dict) else data
    if not isinstance(rows, list):
        raise InputError(f'{name}: expected a list of rays, or {{"rays": [...]}}')
    return [(f"{name}: ray {i}", _from_mapping(row, f"{name}: ray {i}")) for i, row in enumerate(rows)]


def _from_mapping(row: Any, place: str) -> _Ray:
    form = '{"origin": [x, y, z], "direction": [dx, dy, dz], "wavelength_nm": w}'
    if not isinstance(row, dict) or not {"origin", "direction"} <= row.keys():
        raise InputError(f"{place}: expected {form}")
    unknown = row.keys() - {"origin", "direction", "wavelength_nm"}
    if unknown:
        raise InputError(f"{place}: unknown key {sorted(unknown)[0]!r}; expected {form}")
    values = [row["origin"], row["direction"]]
    if not all(isinstance(part, list) and len(part) == 3 and all(map(_is_number, part)) for part in values):
        raise InputError(f"{place}: origin and direction are three numbers each")
    wavelength = row.get("wavelength_nm")
    if wavelength is not None and not _is_number(wavelength):
        raise InputError(f"{place}: wavelength_nm must be a number")
    return [float(value) for part in values for value in part], None if wavelength is None else float(wavelength)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _from_csv(text: str, name: str) -> list[tuple[str, _Ray]]:
    rows: list[tuple[str, _Ray]] = []
    for line, words in enumerate(csv.reader(text.splitlines()), start=1):
        place = f"{name}:{line}"
        cells = [word.strip() for word in words]
        if not any(cells) or cells[0].startswith("#"):
            continue
        if not rows and cells[0] == COLUMNS[0]:
            if tuple(cells[:6]) != COLUMNS or cells[6:] not in ([], ["wavelength_nm"]):
                raise InputError(f"{place}: expected the columns {', '.join(COLUMNS)} and perhaps wavelength_nm")
            continue
        if len(cells) not in (6, 7):
            raise InputError(
                f"{place}: expected {', '.join(COLUMNS)} and perhaps wavelength_nm (got {len(cells)} cells)"
            )
        try:
            values = [float(cell) for cell in cells]
        except ValueError as error:
            raise InputError(f"{place}: expected numbers ({error})") from None
        rows.append((place, (values[:6], values[6] if len(values) == 7 else None)))
    return rows
