"""Show one render under three lights: as rendered, by the window alone, and in the evening.

Run in the folder above: python examples/show_lights.py [SCENE [OUT.png [WIDTHxHEIGHT]]]. It needs rptcam_cl[denoise].
All is rendered twice as large and averaged, as render_fine.py does.
"""

import sys

import numpy as np
from PIL import Image
from render_fine import FINER, mean_light

import rptcam_cl
from rptcam_cl.imaging.development import srgb_from_linear

LIGHTS = (
    [],
    ["lights.rim=0", "lights.lamps=0.05", "lights.environment=0.3"],
    ["lights.window=[0.05,0.08,0.16]", "lights.rim=0.7", "lights.lamps=1.6"],
)


def main(scene: str = "examples/portrait.yaml", out: str = "docs/images/lights.png", size: str = "360x450") -> None:
    """Render once, and write the picture, whose panels have that size."""
    width, height = map(int, size.split("x"))
    size_px = FINER * width, FINER * height
    film = rptcam_cl.render(scene, spp=128, size=size_px, layers=["lights", "albedo", "normal"])
    developed = (rptcam_cl.develop(film, factors).denoised().developed() for factors in LIGHTS)
    panels = [srgb_from_linear(mean_light(np.clip(panel, 0, 1))) for panel in developed]
    codes = (255 * np.concatenate(panels, axis=1) + 0.5).astype(np.uint8)
    Image.fromarray(codes).save(out, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
