"""When every path has the same time, an exposure is the still picture of that moment, path by path."""

from pathlib import Path

import numpy as np
import pytest

from tests.rendering.motion.pictures import FLOOR, film, scene_with
from tests.rendering.motion.test_object_motion import SHAPES, WAY, moved, place_at
from tests.support.cases import slow
from tests.support.mutants import changed_kernels

IMAGE = str(Path(__file__).parents[3] / "examples" / "studio" / "tiles.jpg")
NORMALS = str(Path(__file__).parents[3] / "examples" / "studio" / "tiles_normals.png")
HOLES = {
    "kind": "checker",
    "even": 1.0,
    "odd": 0.0,
    "scale": [4, 4],
}  # nothing that chance decides: it hangs on the ray
BRUSHED = {"kind": "conductor", "metal": "gold", "alpha": [0.05, 0.4]}
TILES = {"kind": "matte", "reflectance": {"kind": "image", "file": IMAGE}, "normal_map": {"file": NORMALS}}
GLASS = {"kind": "dielectric", "index": 1.5, "absorption_per_m": [1, 2, 0.5]}
NET = {"kind": "matte", "reflectance": 0.8, "opacity": HOLES}
MIX = {"kind": "mix", "materials": [{"kind": "mirror"}, {"kind": "plastic", "reflectance": 0.5, "roughness": 0.3}]}
SHINING_NET = {"kind": "principled", "emission": [2.0, 2.0, 2.0], "opacity": HOLES}
# Each shape with its material; light sampling leaves the lamps out when they stand, too, for their holes.
GROUPS = {
    "coated": [("sphere", BRUSHED), ("box", TILES), ("mesh", GLASS), ("cylinder", MIX)],
    "bent": [("ellipsoid", TILES), ("cone", BRUSHED), ("disk", TILES), ("mesh", MIX)],
    "open": [("sphere", NET), ("ellipsoid", SHINING_NET), ("rectangle", NET), ("box", SHINING_NET)],
}
LAMPS = [{"kind": "point", "position": [2, 4, 3], "intensity": 20.0}]


def near(moment, still):
    """Share of pixels that agree, and how far the pictures are from each other in the mean."""
    return np.isclose(moment, still, rtol=2e-3, atol=1e-4).mean(), np.abs(moment - still).mean() / still.mean()


SHARE = 0.2  # of the exposure, after which all paths fall on the film in a copy of the kernels


@pytest.mark.parametrize("t", [slow(0.4), 1.7])
@pytest.mark.parametrize("group", [slow("coated"), slow("bent"), "open"])
def test_exposure_at_one_time_is_the_still_picture(session, group, t):
    items = [
        moved(SHAPES[shape] | {"material": material}, [{"scale": 0.5}, {"translate": [k % 2 - 0.6, 0.7 * (k // 2), 0]}])
        for k, (shape, material) in enumerate(GROUPS[group])
    ]
    options = {"lights": LAMPS, "spp": 8}
    moving = [FLOOR, *(item | {"motion": WAY} for item in items)]
    with changed_kernels("shutter.x * u;", f"shutter.x * {SHARE}f;"):
        moving = film(scene_with(moving, shutter={"time_s": t / SHARE}, **options), session)

    def still(moment):
        return film(scene_with([FLOOR, *(moved(item, place_at(moment)) for item in items)], **options), session)

    same, off = near(moving, still(t))
    assert same > 0.9
    assert off < 0.01
    assert near(moving, still(t - 0.1))[1] > 0.03
