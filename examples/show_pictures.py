"""Develop a film six times, by tone curve or by white balance: the comparisons of docs/picture.md.

Run in the folder above: python examples/show_pictures.py [tones | white_balance]. It needs rptcam_cl[denoise]. The film
is twice as large, and what is shown of it averaged, as render_fine.py does.
"""

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from render_fine import FINER, averaged

import rptcam_cl

SIZE = (480, 270)

# Lamps and sky of the fifteen balls, all of tungsten.
TUNGSTEN = [
    "objects.16.material.radiance={illuminant: A, luminance: 14}",
    "objects.17.material.radiance={illuminant: A, luminance: 8}",
    "environment={kind: constant, radiance: {illuminant: A, luminance: 0.4}}",
]

COMPARISONS: dict[str, tuple[str, list[str], dict[str, dict[str, Any]]]] = {
    "tones": (
        "examples/first_light.yaml",
        ["picture.ev=1"],
        {
            "srgb": {},
            "srgb, gamut: desaturate": {"gamut": "desaturate"},
            "reinhard": {"tone": "reinhard"},
            "aces": {"tone": "aces"},
            "agx": {"tone": "agx"},
            "agx, white_balance: auto": {"tone": "agx", "white_balance": "auto"},
        },
    ),
    "white_balance": (
        "examples/materials.yaml",
        ["picture={tone: reinhard, ev: 1}", *TUNGSTEN],
        {
            "none": {},
            "A": {"white_balance": "A"},
            "{temperature_k: 3600}": {"white_balance": {"temperature_k": 3600}},
            "{grey: [0.45, 0.2]}, on the table": {"white_balance": {"grey": [0.45, 0.2]}},
            "auto": {"white_balance": "auto"},
            "{light: A, adaptation: bradford}": {"white_balance": {"light": "A", "adaptation": "bradford"}},
        },
    ),
}


def panel(film: rptcam_cl.Image, name: str, settings: dict[str, Any]) -> NDArray[np.uint8]:
    """Return a developed picture with its name in a corner, (height, width, 3)."""
    developed = averaged(rptcam_cl.develop(film, **settings)).developed()
    picture = Image.fromarray((255 * developed + 0.5).astype(np.uint8))
    font = ImageFont.load_default(18)
    ImageDraw.Draw(picture).text((6, 4), name, "white", font, stroke_width=1, stroke_fill="black")
    return np.asarray(picture)


def main(*names: str) -> None:
    """Write the comparisons of these names, or all, each of a film that is rendered once."""
    for name in names or COMPARISONS:
        scene, changes, developments = COMPARISONS[name]
        size = (FINER * SIZE[0], FINER * SIZE[1])
        film = rptcam_cl.render(rptcam_cl.load_scene(scene, changes), spp=160, size=size, denoise=True)
        panels = [panel(film, title, settings) for title, settings in developments.items()]
        rows = [np.concatenate(panels[start : start + 3], axis=1) for start in (0, 3)]
        Image.fromarray(np.concatenate(rows)).save(f"docs/images/{name}.jpg", quality=92, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
