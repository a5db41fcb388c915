"""Show the first frames of a dataset side by side, larger than it has them and without noise.

Run in the folder above: python examples/show_dataset.py [SPEC [OUT.jpg]]. It needs rptcam_cl[denoise].
"""

import sys
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

import rptcam_cl

SIZE, GAP = (480, 360), 5
COLUMNS, ROWS = 3, 2


def main(specification: str = "examples/dataset/balls.yaml", out: str = "docs/images/dataset.jpg") -> None:
    """Render the frames and write the picture."""
    source = yaml.safe_load(Path(specification).read_text("utf-8"))
    source["scene"] = str(Path(specification).with_name(source["scene"]))
    source["set"] = {"film.resolution": list(SIZE), "render.spp": 96, "render.layers": ["albedo", "normal"]}
    source["camera_model"] = "none"
    steps = [length + GAP for length in SIZE]
    page = Image.new("RGB", (COLUMNS * steps[0] - GAP, ROWS * steps[1] - GAP), "white")
    for frame in rptcam_cl.dataset(source, frames=COLUMNS * ROWS):
        shown = Image.fromarray((255 * frame.image.denoised().developed() + 0.5).astype(np.uint8))
        row, column = divmod(frame.index, COLUMNS)
        page.paste(shown, (column * steps[0], row * steps[1]))
    page.save(out, quality=90, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
