"""``rptcam render --plan``: memory, kernel launches and time of a render, without rendering it."""

import argparse
import time
from typing import TYPE_CHECKING

from rptcam_cl.cli.progress import as_duration
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.api import RenderSettings
    from rptcam_cl.rendering import Forecast
    from rptcam_cl.scene import Scene


def add_option(parser: argparse.ArgumentParser) -> None:
    """Add the option."""
    parser.add_argument(
        "--plan", action="store_true",
        help="print the memory, the kernel launches and the time that the render will take, and render nothing",
    )  # fmt: skip


def print_plan(scene: "Scene", settings: "RenderSettings") -> int:
    """Print what a render will take, and return the exit code."""
    from rptcam_cl.api import prepare
    from rptcam_cl.rendering import forecast

    begun = time.perf_counter()
    prepared = prepare(scene, settings)
    end = settings.most_spp(prepared.scene)
    if end is None:
        raise InputError("--plan: --time says how long it takes (allowed: without --time)")
    preparing = time.perf_counter() - begun
    first = settings.film_part.first if prepared.saved is None else prepared.saved.done
    found = forecast(prepared.wavefront, min(first, end), end, settings.film_part)
    for line in described(found, preparing):
        print(line)
    return 0


def described(found: "Forecast", preparing: float) -> list[str]:
    """The lines of a plan."""
    from rptcam_cl.rendering import amount

    memory = [f"{amount(needs.total)} on device {device}" for device, needs in found.devices.items()]
    limit = "at most " if found.at_most else ""
    speed = found.samples / max(found.seconds, 1e-9) / 1e6
    return [
        f"samples: {limit}{found.samples:,}, {limit}{found.launches:,} kernel launches",
        f"memory:  {', '.join(memory)}; {amount(found.saved_bytes)} for its state on disk",
        f"time:    {limit}{as_duration(found.seconds)} of rendering at {speed:.3g} Msamples/s (measured for"
        f" {found.measured_seconds:.1f} s), after {as_duration(preparing)} of preparing",
    ]
