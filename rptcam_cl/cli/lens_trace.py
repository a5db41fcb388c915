"""``rptcam lens trace``: the path and fate of single rays."""

import argparse
import sys
from typing import TYPE_CHECKING, Any

from rptcam_cl.cli.lens_options import add_lens, lens_in_use, number, wavelength
from rptcam_cl.cli.lens_rays import RayList, read_rays
from rptcam_cl.cli.output import as_json, print_table
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.constants import LINE_D_NM
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.lenstools import Precision, Setting
    from rptcam_cl.optics import Rays


def add_to(commands: Commands) -> None:
    """Add the command."""
    text = "trace single rays: where they leave the lens, or which surface stops them"
    parser = commands.add_parser(
        "trace", help=text,
        description=text.capitalize() + ". Millimetres; z = 0 at the first vertex, +z towards the film.",
    )  # fmt: skip
    add_lens(parser)
    parser.add_argument(
        "rays", metavar="RAYS", nargs="?",
        help="JSON [{origin, direction, wavelength_nm}], or CSV x,y,z,dx,dy,dz[,wavelength_nm]; - reads standard input",
    )  # fmt: skip
    parser.add_argument("--film-point", type=number, nargs=2, metavar=("X", "Y"), help="one ray from here on the film")
    parser.add_argument(
        "--through", type=number, nargs=2, metavar=("U", "V"), default=(0.0, 0.0),
        help="to this point of the plane of the last vertex (default: 0 0)",
    )  # fmt: skip
    parser.add_argument(
        "--start", choices=("film", "scene"), default="film", help="side where rays begin (default: %(default)s)"
    )
    parser.add_argument(
        "--wavelength-nm", type=wavelength, metavar="W", default=LINE_D_NM,
        help="of rays that have none of their own (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--device", metavar="SPEC",
        help="an index as 0:0, a part of a name, cpu, gpu or auto (default: the float64 reference on the host)",
    )  # fmt: skip
    parser.add_argument("--precision", choices=("single", "double"), help="arithmetic of the device (default: single)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_run, parser=parser)


def _rays(arguments: argparse.Namespace, state: "Setting") -> RayList:
    if (arguments.rays is None) == (arguments.film_point is None):
        raise InputError("rptcam lens trace: needs either a file of rays or --film-point")
    if arguments.rays is not None:
        return read_rays(arguments.rays, arguments.wavelength_nm)
    if arguments.start != "film":
        raise InputError("--film-point: such a ray starts from the film (leave out --start scene)")
    (x, y), (u, v) = arguments.film_point, arguments.through
    return RayList([[x, y, state.film_z]], [[u - x, v - y, -state.film]], [arguments.wavelength_nm])


def _trace(arguments: argparse.Namespace, state: "Setting", rays: RayList) -> "tuple[Rays, str]":
    """The rays behind the lens, and what traced them."""
    from rptcam_cl.optics import trace

    parts = (rays.origins, rays.directions, rays.wavelengths, arguments.start)
    if arguments.device in (None, "none"):
        if arguments.precision is not None:
            raise InputError("--precision: belongs to a device; name one with --device")
        return trace(state.lens, *parts), "in float64 on the host"
    from rptcam_cl.device import open_session
    from rptcam_cl.lenstools import trace_on_device

    session = open_session(arguments.device)
    precision: Precision = arguments.precision or "single"
    name = f"on {session.info.id} {session.info.name}, {precision} precision"
    return trace_on_device(state.lens, session, *parts, precision), name


def _rows(rays: "Rays", wavelengths: list[float]) -> list[dict[str, Any]]:
    from rptcam_cl.optics import Status

    return [
        {
            "status": Status(int(rays.status[i])).name,
            "surface": int(rays.surface[i]) if rays.surface[i] >= 0 else None,
            "origin": rays.origins[i].tolist(),
            "direction": rays.directions[i].tolist(),
            "wavelength_nm": wavelengths[i],
        }
        for i in range(len(wavelengths))
    ]


def _run(arguments: argparse.Namespace) -> int:
    state = lens_in_use(arguments, arguments.wavelength_nm)
    rays = _rays(arguments, state)
    traced, name = _trace(arguments, state, rays)
    rows = _rows(traced, rays.wavelengths)
    print(f"{len(rows)} rays traced {name}", file=sys.stderr)
    if arguments.json:
        print(as_json({"lens": state.lens.name, "start": arguments.start, "rays": rows}))
        return 0
    columns = ("ray", "status", "surface", "x", "y", "z", "dx", "dy", "dz", "wavelength [nm]")
    cells = [
        [i, row["status"].replace("_", " "), row["surface"], *row["origin"], *row["direction"], row["wavelength_nm"]]
        for i, row in enumerate(rows)
    ]
    print_table(columns, cells, f"{state.lens.name}, rays from the {arguments.start}")
    return 0
