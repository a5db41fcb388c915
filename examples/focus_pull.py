"""Pull the focus through the chess board, from the near pawns to the lamps and back: the picture of docs/motion.md.

Run in the folder above: python examples/focus_pull.py; it takes a quarter of an hour on two cores. It needs the extra
`denoise`.
One render session; only the records of the lens change from frame to frame.
"""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rptcam_cl.api.session import RenderSession

SCENE = "examples/first_light.yaml"
FILE = Path("docs/images/focus_pull.webp")
SIZE = (960, 540)
SAMPLES = 128
FRAME_MS = 100
HOLD_MS = 1000
# Where the focus rests [m from the film]: red pawn in front, gold pawn, blue pawn behind, lamps; then back.
STOPS = (0.50, 0.653, 0.82, 6.5, 0.50)
STEPS = (31, 29, 41, 53)  # frames from one to the next


def distances() -> list[tuple[float, int]]:
    """Return focus distances [m] and how long each is shown [ms]: even in 1 / distance, as a ring turns, and eased."""
    found = [(STOPS[0], HOLD_MS)]
    for start, end, steps in zip(STOPS, STOPS[1:], STEPS, strict=False):
        for step in range(1, steps + 1):
            share = (1 - math.cos(math.pi * step / steps)) / 2
            found.append((1 / (1 / start + (1 / end - 1 / start) * share), HOLD_MS if step == steps else FRAME_MS))
    return found


def labelled(developed: NDArray[np.float32], distance_m: float) -> Image.Image:
    """Return a picture with its focus distance in the corner."""
    picture = Image.fromarray(np.rint(developed * 255).astype(np.uint8))
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(32)
    place = (26, SIZE[1] - 56)
    draw.text(place, f"{distance_m:.2f} m", (255, 255, 255), font, stroke_width=3, stroke_fill=(0, 0, 0))
    return picture


def main() -> None:
    """Render all frames and write them."""
    frames, times = [], []
    with RenderSession(SCENE, size=SIZE) as session:
        session.change({"render.layers": ["albedo", "normal"]})
        for distance_m, shown_ms in distances():
            session.change({"camera.focus.distance_m": distance_m})
            session.take(SAMPLES)
            frames.append(labelled(session.image().denoised().developed(), distance_m))
            times.append(shown_ms)
    frames[0].save(FILE, save_all=True, append_images=frames[1:], duration=times, loop=0, quality=62, method=6)
    print(f"{FILE}: {len(frames)} frames, {sum(times) / 1000:g} s, {FILE.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
