"""Show a room lit by a sconce at 16 samples a pixel, by paths alone and with virtual lights.

Run in the folder above: python examples/show_virtual_lights.py
"""

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import rptcam_cl

SCENE = "examples/sconce.yaml"
FILE = "docs/images/virtual_lights.png"
SAMPLES = 16
GAP = 8  # white pixels between the pictures


def picture(choice: str) -> NDArray[np.uint8]:
    """Return the developed picture, (height, width, 3)."""
    scene = rptcam_cl.load_scene(SCENE, [f"render.virtual_lights={choice}"])
    image = rptcam_cl.render(scene, spp=SAMPLES)
    return (255 * image.developed() + 0.5).astype(np.uint8)


def main() -> None:
    """Render both ways and write them side by side."""
    off, auto = picture("off"), picture("auto")
    gap = np.full((len(off), GAP, 3), 255, np.uint8)
    Image.fromarray(np.hstack([off, gap, auto])).save(FILE, optimize=True)


if __name__ == "__main__":
    main()
