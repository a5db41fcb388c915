"""Render at twice the size, develop, and average 2 x 2 pixels: rims of lamps brighter than white become smooth.

Run in the folder above: python examples/render_fine.py SCENE -o OUT.jpg [--size WxH] [--spp N] [--denoise] [--set …]
The options are those of `rptcam render`; SPP samples go to each of the four pixels. A film holds the mean light of a
pixel, and where a lamp of 50 times white covers a tenth of it, the picture is white there and its rim has steps. The
mean of what is shown of parts of a pixel has none.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import rptcam_cl
from rptcam_cl.api import options
from rptcam_cl.core.colour import linear_from_srgb

FINER = 2  # pixels along each side of one of the picture


def mean_light(shown: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the mean light of `FINER` by `FINER` pixels of a developed picture, (height, width, 3), linear."""
    height, width = shown.shape[0] // FINER, shown.shape[1] // FINER
    parts = linear_from_srgb(shown[: height * FINER, : width * FINER]).reshape(height, FINER, width, FINER, 3)
    return parts.mean(axis=(1, 3))


def averaged(film: rptcam_cl.Image) -> rptcam_cl.Image:
    """The picture of a film, developed, with the mean light of `FINER` by `FINER` of its pixels in each of its own."""
    kept = {key: value for key, value in film.metadata.items() if key != "sensor"}  # it has been applied
    return rptcam_cl.Image(mean_light(film.developed()), kept | {"averaged": f"{FINER} x {FINER} pixels"})


def main(words: list[str]) -> None:
    """Render and write one picture."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scene", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--size", type=options.size)
    parser.add_argument("--spp", type=options.spp)
    parser.add_argument("--denoise", action="store_true")
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    given = parser.parse_args(words)
    scene = rptcam_cl.load_scene(given.scene, given.overrides)
    width, height = given.size or scene.film.resolution
    size = (FINER * width, FINER * height)
    averaged(rptcam_cl.render(scene, spp=given.spp, size=size, denoise=given.denoise)).save(given.output)


if __name__ == "__main__":
    main(sys.argv[1:])
