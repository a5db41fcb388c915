"""The shape of an aperture: in the thin lens and at the stop of a real lens alike."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image, ImageDraw

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.surface import StopMask
from rptcam_cl.rendering.cameras.lens_records import stop_shape
from tests.support.cases import fast

POSE = {"eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0]}
SHAPES = {
    "hexagon": {"shape": "polygon", "blades": 6, "rotation_degrees": 10},
    "bulging pentagon": {"shape": "polygon", "blades": 5, "curvature": 0.6},
    "star": {"shape": "star"},
    "heart": {"shape": "heart"},
    "letter L": {"shape": "outline", "points": [[0, 0], [2, 0], [2, 1], [1, 1], [1, 3], [0, 3]]},
    "picture": {"shape": "image", "file": "mask.png"},
}


@pytest.fixture
def folder(tmp_path):
    mask = Image.new("L", (64, 64), 0)
    ImageDraw.Draw(mask).ellipse((4, 4, 59, 59), fill=255)
    ImageDraw.Draw(mask).rectangle((20, 10, 30, 40), fill=0)
    mask.save(tmp_path / "mask.png")
    return tmp_path


def scene(camera, folder, **rest):
    mapping = {"camera": {**POSE, **camera}, "film": {"resolution": [64, 64], "size_mm": [4, 4]}, **rest}
    return rptcam_cl.load_scene(mapping, base_dir=folder)


MIDDLE = (0.25, 0.75, 0.25, 0.75)  # where the blurred point is
DISCS: dict[str, np.ndarray] = {}  # of round openings, by the kind of camera


def blur_of_a_point(camera, folder):
    """The picture of a tiny far lamp on the axis, out of focus, as shares of its light."""
    lamp = {"shape": "sphere", "center": [0, 0, -40], "radius": 0.02, "material": {"kind": "emissive", "radiance": 1e4}}
    blurred = scene(camera, folder, objects=[lamp], render={"spp": 3000, "max_depth": 1, "seed": 5})
    picture = np.asarray(rptcam_cl.render(blurred, crop=MIDDLE)).mean(axis=2).astype(float)
    return picture / picture.sum()


THIN = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 2.1, "focus_distance_m": 1.0}
REAL = {"kind": "realistic", "lens": "dgauss-50mm", "f_number": 2.1, "focus": {"distance_m": 1.05}}


# A polygon, an outline and a mask; the other shapes are of the same kinds.
BLURRED = [("thin", "hexagon")]
ALL_BLURRED = [(kind, name) for kind in ("thin", "real") for name in SHAPES]


@pytest.mark.parametrize(("kind", "name"), fast(BLURRED, ALL_BLURRED))
def test_blur_of_a_point_has_the_shape_of_the_aperture(kind, name, folder):
    lens = {"thin": THIN, "real": REAL}[kind]
    picture = blur_of_a_point({**lens, "aperture": SHAPES[name]}, folder)
    loaded = scene({**lens, "aperture": SHAPES[name]}, folder)
    shape = stop_shape(loaded, loaded.camera.aperture)
    rows, columns = np.nonzero(picture > 0.3 * np.quantile(picture[picture > 0], 0.8))
    # The disc of a round opening, measured the same way, gives centre and radius of the blur circle.
    if (disc := DISCS.get(lens["kind"])) is None:
        disc = DISCS[lens["kind"]] = blur_of_a_point(lens, folder)
    lit = np.argwhere(disc > 0.3 * np.quantile(disc[disc > 0], 0.8))
    centre, radius = (lit.min(axis=0) + lit.max(axis=0)) / 2, (lit.max(axis=0) - lit.min(axis=0)).max() / 2 + 0.5
    x, y = (columns - centre[1]) / radius, (centre[0] - rows) / radius
    # Within a pixel of the edge the answer is open; elsewhere every lit pixel lies inside. A lens distorts its pupil.
    fitting = share_within_a_pixel(shape, x, y, 1 / radius)
    assert fitting > (0.99 if lens is THIN else 0.97)
    if name in ("heart", "letter L", "picture", "star"):  # these do not fit when turned by half a turn
        assert share_within_a_pixel(shape, -x, -y, 1 / radius) < fitting - 0.03


def share_within_a_pixel(shape, x, y, pixel):
    """Which share of points lies inside of a shape or within a pixel of it."""
    steps = [(dx * pixel, dy * pixel) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
    return np.mean(np.any([shape.holds(x + dx, y + dy) for dx, dy in steps], axis=0))


@pytest.mark.parametrize("name", fast(["heart"], [name for name in SHAPES if name != "picture"]))
def test_shaped_stop_passes_the_share_of_light_of_its_area(name, folder):
    wall = {"environment": {"kind": "constant", "radiance": 1.0}, "exposure": "irradiance", "render": {"spp": 400}}
    small = {**REAL, "f_number": 8.0}  # where only the stop limits, and the pupil is not distorted
    shaped = scene({**small, "aperture": SHAPES[name]}, folder, **wall)
    pictures = [np.asarray(rptcam_cl.render(given)) for given in (shaped, scene(small, folder, **wall))]
    share = float(pictures[0].mean() / pictures[1].mean())
    shape = stop_shape(shaped, shaped.camera.aperture)
    assert share == pytest.approx(shape.area / np.pi, rel=0.006)  # noise 0.2 %, pupil aberration below 0.3 %


@pytest.mark.slow
def test_relative_exposure_of_a_shaped_stop_is_one_on_the_axis(folder):
    wall = {"environment": {"kind": "constant", "radiance": 1.0}, "render": {"spp": 400}}
    for name in ("star", "picture"):
        picture = np.asarray(rptcam_cl.render(scene({**REAL, "aperture": SHAPES[name]}, folder, **wall)))
        assert picture[28:36, 28:36].mean() == pytest.approx(1.0, rel=0.01)


def test_bad_masks_are_named(folder):
    (folder / "text.png").write_text("no picture")
    Image.new("L", (8, 6), 255).save(folder / "oblong.png")
    Image.new("L", (8, 8), 0).save(folder / "dark.png")
    Image.new("L", (600, 600), 255).save(folder / "large.png")
    for file, message in (
        ("text.png", "is not a readable"),
        ("oblong.png", "is 8 x 6 pixels"),
        ("dark.png", "is dark everywhere"),
        ("large.png", "at most 512"),
        ("absent.png", "absent"),
    ):
        with pytest.raises(InputError, match=message):
            rptcam_cl.render(scene({**THIN, "aperture": {"shape": "image", "file": file}}, folder), spp=1)


def test_outline_that_crosses_itself_is_refused(folder):
    crossed = {"shape": "outline", "points": [[0, 0], [1, 1], [1, 0], [0, 1]]}
    with pytest.raises(InputError, match="crosses itself"):
        rptcam_cl.render(scene({**THIN, "aperture": crossed}, folder), spp=1)


def test_mask_holds_its_open_cells():
    mask = StopMask(np.array([[True, False], [False, False]]))
    x, y = np.array([-0.5, 0.5, -0.5, 2.0]), np.array([0.5, 0.5, -0.5, 0.0])
    assert mask.holds(x, y).tolist() == [True, False, False, False]
