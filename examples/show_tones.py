"""Show a film with each tone curve side by side, and one white balance: what docs/picture.md compares.

Run in the folder above: python examples/show_tones.py [SCENE [OUT.png [WIDTHxHEIGHT [EV]]]]
"""

import sys
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import rptcam_cl

PANELS: dict[str, dict[str, Any]] = {
    "srgb": {},
    "srgb, gamut: desaturate": {"gamut": "desaturate"},
    "reinhard": {"tone": "reinhard"},
    "filmic": {"tone": "filmic"},
    "agx": {"tone": "agx"},
    "agx, white_balance: auto": {"tone": "agx", "white_balance": "auto"},
}


def panel(film: rptcam_cl.Image, name: str, settings: dict[str, Any]) -> np.ndarray:
    """Return a developed picture with its name in a corner, (height, width, 3) in 8 bits."""
    developed = rptcam_cl.develop(film, **settings).developed()
    picture = Image.fromarray((255 * developed + 0.5).astype(np.uint8))
    ImageDraw.Draw(picture).text(
        (6, 4), name, font=ImageFont.load_default(13), fill="white", stroke_width=1, stroke_fill="black"
    )
    return np.asarray(picture)


def main(
    scene: str = "examples/first_light.yaml",
    out: str = "docs/images/tones.png",
    size: str = "320x180",
    ev: str = "1",
) -> None:
    """Render the film once, or read one that was saved, and develop it six times."""
    if scene.endswith((".exr", ".npz")):
        film = rptcam_cl.develop(scene)
    else:
        width, height = map(int, size.split("x"))
        film = rptcam_cl.render(scene, spp=512, size=(width, height))
    shown = [panel(film, name, {"ev": float(ev), **settings}) for name, settings in PANELS.items()]
    rows = [np.concatenate(shown[start : start + 3], axis=1) for start in (0, 3)]
    Image.fromarray(np.concatenate(rows)).save(out, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
