"""The options of ``rptcam camera`` that write maps of the lens: a value for each pixel, a kernel for each field."""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.lens_options import wavelengths
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.calibration import View

EXR = ("stmap_distort", "stmap_undistort", "vignetting", "coc")
NAMES = (*EXR, "psf_grid")


def distances(text: str) -> list[float]:
    """Distances of ``a,b,c``, which may be far away: ``inf`` [m]."""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if not found or not all(value > 0 for value in found):
        raise argparse.ArgumentTypeError(f"got {text}; allowed distances above 0 m, as 0.8,2,inf")
    return found


def add_maps(parser: argparse.ArgumentParser) -> None:
    """Add the maps and what they need."""
    maps = parser.add_argument_group("maps of the lens")
    for name, text in (
        ("--stmap-distort", "ST map that bends a straight picture as the lens does"),
        ("--stmap-undistort", "ST map that makes a picture of the lens straight, with overscan"),
        ("--vignetting", "light of each pixel over that on the axis"),
        ("--coc", "circle of confusion of each pixel [px], at --distances-m"),
    ):
        maps.add_argument(name, type=Path, metavar="F.exr", help=text)
    maps.add_argument("--psf-grid", type=Path, metavar="F.npz", help="images of points over the picture, as kernels")
    maps.add_argument("--psf-cells", type=values.size, metavar="WxH", default=(5, 3), help="of them (default: 5x3)")
    maps.add_argument(
        "--distances-m",
        type=distances,
        metavar="D,D,…",
        help="of points, in metres or inf (default: the plane of focus)",
    )
    maps.add_argument("--wavelengths", type=wavelengths, metavar="W,W,…", help="in nanometres (default: the camera's)")


def check_maps(arguments: argparse.Namespace) -> None:
    """Refuse maps whose names say another kind of file."""
    for name in NAMES:
        path: Path | None = getattr(arguments, name)
        if path is None:
            continue
        suffix = ".exr" if name in EXR else ".npz"
        if path.suffix.lower() != suffix:
            option = f"--{name.replace('_', '-')}"
            raise InputError(f"{option}: {path}: such a file is {suffix} (got {path.suffix or 'none'})")


def written_maps(arguments: argparse.Namespace, seen: "View") -> Iterator[tuple[Path, Callable[[Path], object]]]:
    """Yield files and what writes them, each map having been made."""
    from rptcam_cl import calibration as made

    if arguments.stmap_distort is not None or arguments.stmap_undistort is not None:
        maps = made.st_maps(seen)
        if arguments.stmap_distort is not None:
            yield arguments.stmap_distort, lambda path: made.st_exr(seen, maps, "distort", path)
        if arguments.stmap_undistort is not None:
            yield arguments.stmap_undistort, lambda path: made.st_exr(seen, maps, "undistort", path)
    if arguments.vignetting is not None:
        light = made.vignetting_map(seen)
        yield arguments.vignetting, lambda path: made.vignetting_exr(seen, light, path)
    away = arguments.distances_m or [seen.distance_m]
    if arguments.coc is not None:
        blur = made.coc_map(seen, away)
        yield arguments.coc, lambda path: made.coc_exr(seen, blur, away, path)
    if arguments.psf_grid is not None:
        data = made.psf_npz(made.point_images(seen, arguments.psf_cells, arguments.wavelengths or (), away))
        yield arguments.psf_grid, lambda path: path.write_bytes(data)
