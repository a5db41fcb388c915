"""Show the portrait's lamps at 16 samples a pixel, by rays that are spread over the pupil and by rays that aim at them.

Run in the folder above: python examples/show_aimed_lamps.py
The layer `object_id` tells what the first ray of a pixel meets, so with it no ray aims at a lamp.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import rptcam_cl

SCENE = "examples/portrait.yaml"
FILE = "docs/images/bokeh.png"
SIZE = (480, 600)
SAMPLES = 16
GAP = 8  # white pixels between the pictures


def picture(layers: Sequence[str]) -> NDArray[np.uint8]:
    """Return the developed picture, (height, width, 3)."""
    image = rptcam_cl.render(SCENE, size=SIZE, spp=SAMPLES, layers=layers)
    return (255 * image.developed() + 0.5).astype(np.uint8)


def main() -> None:
    """Render both ways and write them side by side."""
    gap = np.full((SIZE[1], GAP, 3), 255, np.uint8)
    Image.fromarray(np.hstack([picture(["object_id"]), gap, picture([])])).save(FILE, optimize=True)


if __name__ == "__main__":
    main()
