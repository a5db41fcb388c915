"""``rptcam sweep``: a grid of pictures over values of any keys, with a contact sheet and a table."""

import argparse
import sys
from pathlib import Path
from typing import Any

from rptcam_cl.cli import cluster
from rptcam_cl.cli import parser as values
from rptcam_cl.cli.interrupt import ENDS_LATER, INTERRUPTED, stop_on_interrupt
from rptcam_cl.cli.output import print_table, print_warnings
from rptcam_cl.cli.parser import Commands
from rptcam_cl.cli.series import expanded
from rptcam_cl.core.errors import InputError


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "sweep",
        help="render a scene with every combination of some values",
        description="Render every combination of values, and write films, a contact sheet and a table. What is there"
        " already is kept.",
    )
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")
    parser.add_argument(
        "--over", action="append", required=True, metavar="key.path=a,b,...", dest="keys",
        help="values of a key of the scene file, as camera.f_number=2,4,8 or 2,2.8,…,22; may be repeated, the last"
        " varies first",
    )  # fmt: skip
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FOLDER", help="folder to write to")
    parser.add_argument("--spp", type=values.spp, metavar="N", help="samples per pixel, in place of the scene's")
    parser.add_argument("--size", type=values.size, metavar="WxH", help="resolution in pixels")
    parser.add_argument("--seed", type=values.seed, metavar="N", help="seed of the random numbers")
    parser.add_argument(
        "--mtf", type=values.point, metavar="x,y",
        help="measure MTF50 of the edge at this point, in fractions of the picture from the left and the top",
    )  # fmt: skip
    values.add_device(parser)
    cluster.add_options(parser)
    values.add_overrides(parser)
    values.add_allow_mixed(parser)
    parser.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    parser.set_defaults(run=_run, parser=parser)


def _over(texts: list[str]) -> dict[str, list[Any]]:
    """Values by key of ``key.path=a,b,c``, each read as YAML."""
    from rptcam_cl.core.strict_yaml import read_yaml

    found: dict[str, list[Any]] = {}
    for text in texts:
        key, _, listed = text.partition("=")
        if not key or not listed.strip():
            raise InputError(f"--over {text}: is not of the form key.path=a,b,... (for instance camera.f_number=2,4,8)")
        if key in found:
            raise InputError(f"--over {text}: {key} twice (allowed: each key once)")
        values = read_yaml(f"[{listed}]", name=f"--over {text}").data
        found[key] = expanded(key, values, f"--over {text}")
    return found


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.api import load_scene, sweep
    from rptcam_cl.scene import set_keys

    over = _over(arguments.keys)
    scene = load_scene(arguments.scene, arguments.overrides)
    print_warnings(scene.warnings)
    rows, said = [], set(scene.warnings)
    with stop_on_interrupt(None if arguments.cluster or arguments.workers else ENDS_LATER) as stop:
        entries = sweep(
            scene, over, arguments.output, spp=arguments.spp, size=arguments.size, seed=arguments.seed,
            mtf_at=arguments.mtf, device=arguments.device, pictures=cluster.pictures_of(arguments, stop.is_set),
            allow_mixed=arguments.allow_mixed,
        )  # fmt: skip
        try:
            for entry in entries:
                rows.append([*entry.values.values(), *entry.measures.values()])
                doubts = [line for line in set_keys(scene, entry.values).lens_doubts if line not in said]
                print_warnings(doubts)
                said.update(doubts)
                if not arguments.quiet:
                    print(f"{entry.label}: {'kept' if entry.kept else 'rendered'}", file=sys.stderr)
                if stop.is_set():
                    raise InterruptedError
        except InterruptedError:
            print("interrupted: the same command goes on with the rest", file=sys.stderr)
            return INTERRUPTED
    print_table([*over, *entry.measures], rows)
    return 0
