"""Show six layers of a scene side by side: picture, depth, normal, albedo, objects and circle of confusion.

Run in the folder above: python examples/show_layers.py [SCENE [OUT.png [WIDTHxHEIGHT]]]. It needs rptcam_cl[denoise].
All is rendered twice as large and averaged, as render_fine.py does.
"""

import sys

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from render_fine import FINER, mean_light

import rptcam_cl
from rptcam_cl.imaging.development import srgb_from_linear

Panel = NDArray[np.floating]


def grey(values: Panel) -> Panel:
    """Return a grey panel of values 0 to 1."""
    return np.repeat(srgb_from_linear(values)[..., None], 3, axis=-1)


def panels(image: rptcam_cl.Image) -> list[Panel]:
    """Return the panels, (height, width, 3) from 0 to 1."""
    depth, blur, objects = image["depth"], np.nan_to_num(image["coc"]), image["object_id"]
    colours = np.random.default_rng(4).uniform(0.2, 1.0, (objects.max() + 2, 3))
    colours[0] = 0  # of nothing, which is -1
    return [
        image.developed(),
        grey(depth.min() / depth),  # white is nearest, black infinitely far
        image["normal"] / 2 + 0.5,
        srgb_from_linear(image["albedo"]),
        colours[objects + 1],
        grey(blur / max(np.percentile(blur, 98), 1e-9)),
    ]


def main(scene: str = "examples/first_light.yaml", out: str = "docs/images/layers.png", size: str = "480x270") -> None:
    """Render the layers and write the picture, whose panels have that size."""
    width, height = map(int, size.split("x"))
    names = ["depth", "normal", "albedo", "object_id", "coc"]
    shown = panels(rptcam_cl.render(scene, spp=64, size=(FINER * width, FINER * height), layers=names, denoise=True))
    shown = [srgb_from_linear(mean_light(np.clip(panel, 0, 1))) for panel in shown]
    rows = [np.concatenate(shown[start : start + 3], axis=1) for start in (0, 3)]
    Image.fromarray((255 * np.concatenate(rows) + 0.5).astype(np.uint8)).save(out, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
