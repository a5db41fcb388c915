"""Pull the focus of the portrait in 240 frames, from the doll to the one behind, to the lamps and back.

Run in the folder above: python examples/portrait_pull.py -o docs/images/gallery/portrait_pull.webp
The animated picture has a video of the same name beside it (.mp4, with rptcam_cl[video]); both are denoised (with
rptcam_cl[denoise]). It takes twenty minutes on two cores; the frames are kept in the folder given by --frames,
and a later run goes on with what is missing.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from rptcam_cl.imaging.image import develop

FRAMES, RATE = 240, 24
# Moments [s] and distances in focus [m from the film]: the doll's face, the doll behind, the lamps.
DISTANCES = {
    0: 0.57, 1: 0.57, 2.4: 0.69, 3.5: 0.93, 4.5: 0.93, 5.5: 1.3, 6.2: 1.9, 6.8: 2.8, 7.3: 4.2, 8.3: 4.2, 8.7: 1.8,
    9.1: 1, 9.5: 0.7, 10: 0.57,
}  # fmt: skip


def command(folder: Path, video: Path) -> list[str]:
    """Return the words that render all frames into a folder, and the video."""
    keyframes = [{"time_s": time_s, "value": metres} for time_s, metres in DISTANCES.items()]
    sequence = {"frames_per_second": RATE, "keys": {"camera.focus.distance_m": keyframes}}
    words = ["render", "examples/portrait.yaml", "--set", f"sequence={json.dumps(sequence)}", "--size", "768x960"]
    words += ["--spp", "32", "--denoise", "--frames", f"1-{FRAMES}", "--resume", "-o", str(folder / "f.####.exr")]
    return [sys.executable, "-m", "rptcam_cl", *words, "--video", str(video), "--quiet"]


def picture(path: Path) -> Image.Image:
    """Return a film developed, with 8 bits."""
    return Image.fromarray(np.rint(np.clip(develop(path).developed(), 0, 1) * 255).astype(np.uint8))


def main() -> None:
    """Render all frames and write both."""
    parser = argparse.ArgumentParser()
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--frames", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = given.frames or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        subprocess.run(command(folder, given.output.with_suffix(".mp4")), check=True)
        first, *others = (picture(folder / f"f.{frame:04d}.exr") for frame in range(1, FRAMES + 1))
        shown = [round(1000 / RATE)] * FRAMES
        first.save(given.output, save_all=True, append_images=others, duration=shown, loop=0, quality=75, method=4)


if __name__ == "__main__":
    main()
