"""Close focus of patents: where lenses focus when they stand as their near columns say.

    python -m benchmarks.close_columns FOLDER

reads Optical Bench files (.txt) and prints for each near column of a lens that is no zoom: the distance from object to
film, how far its groups or the whole lens travel from infinity, by how much the image lies off the film to first order,
less what it lies off at infinity, and by how much farther they would have to travel.
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from rptcam_cl.core.errors import RptcamError
from rptcam_cl.optics.lens import Lens, film_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.surface import FocusState

STEP = 1e-3  # of the travel


def off_film(lens: Lens, state: FocusState, share: float, shift_mm: float) -> float:
    """Return how far behind the film the image of a near object lies at a share of the travel [mm]."""
    whole = {k: lens.surfaces[k].thickness + share * (gap - lens.surfaces[k].thickness) for k, gap in state.gaps}
    surfaces = tuple(replace(s, thickness=whole.get(k, s.thickness)) for k, s in enumerate(lens.surfaces))
    near = replace(lens, surfaces=surfaces, floating=())
    film = film_distance(replace(lens, floating=()), math.inf, "front") + share * shift_mm
    return film_distance(near, state.distance_mm - near.length - film, "front") - film


def column(lens: Lens, state: FocusState, shift_mm: float) -> tuple[float, float, float]:
    """Return travel, image off the film, and travel that lacks [mm]."""
    gaps = [abs(gap - lens.surfaces[k].thickness) for k, gap in state.gaps]
    travel, off = max(*gaps, abs(shift_mm)), off_film(lens, state, 1.0, shift_mm)
    ends = (off_film(lens, state, 1 + step, shift_mm) for step in (STEP, -STEP))
    return travel, off, -travel * off * 2 * STEP / float(np.subtract(*ends))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    print("| file | object to film [mm] | travel [mm] | image off the film [µm] | travel that lacks [µm] |")
    print("|---|--:|--:|--:|--:|")
    for path in sorted(parser.parse_args().folder.glob("*.txt")):
        try:
            lens = load_lens(path)
        except RptcamError as problem:
            print(f"| {path.stem} | {problem} |")
            continue
        for state in lens.floating if not lens.configurations else ():
            if state.film_shift_mm is None:
                print(f"| {path.stem} | {state.distance_mm:.0f} | film not said |")
                continue
            travel, off, lacks = column(lens, state, state.film_shift_mm)
            print(f"| {path.stem} | {state.distance_mm:.0f} | {travel:.3f} | {1e3 * off:.1f} | {1e3 * lacks:.0f} |")


if __name__ == "__main__":
    main()
