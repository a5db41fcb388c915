"""Waves of passes with one lane per work item, as a GPU gets them, make the pictures of a processor's stream."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.device.session import Session
from tests.device.probes import open_session
from tests.device.test_kernels import sheet
from tests.rendering.test_determinism import LENS
from tests.rendering.test_world import still_life

SIZE, SPP = (24, 16), 8
MATTE = {"kind": "matte", "reflectance": [0.7, 0.5, 0.3]}
SHEET = {"shape": "mesh", "mesh": "sheet", "material": MATTE}


def few(**keys):
    """A floor, a ball of glass and a lamp."""
    scene = still_life()
    return scene | {"objects": [scene["objects"][k] for k in (0, 1, 7)]} | keys


def meshes():
    upright = {"rotate": {"axis": [1, 0, 0], "degrees": 75}}
    two = [SHEET | {"transform": [upright, {"translate": [x, -0.9, 0.1]}]} for x in (-1.6, 0.7)]
    return few(objects=[*few()["objects"], *two], meshes={"sheet": sheet(40)})  # held once for both


def crowd():
    balls = [{"shape": "sphere", "center": [k % 10 / 3 - 1.5, k // 10 / 3 - 1, 0.1], "radius": 0.1} for k in range(80)]
    return few(objects=[*few()["objects"], *(ball | {"material": MATTE} for ball in balls)])


def moving():
    scene = few()
    way = [{"time_s": 0}, {"time_s": 1, "translate": [0.3, 0, 0]}]
    scene["objects"][1] = scene["objects"][1] | {"motion": way}
    seen = [{"time_s": 0}, {"time_s": 1, "eye": [0.6, -5, 2]}]
    return scene | {"camera": scene["camera"] | {"motion": seen}, "shutter": {"time_s": 1}}


def meshes_shapes_and_motion():
    """All of these at once: a tree over shapes, instances of meshes, and what moves: a mesh, a shape and the camera."""
    scene, other = moving(), meshes()
    one, two = other["objects"][3:]
    two |= {"motion": [{"time_s": 0}, {"time_s": 1, "rotate": {"axis": [0, 1, 0], "degrees": 20}}]}
    return scene | {"objects": [*scene["objects"], *crowd()["objects"][3:], one, two], "meshes": other["meshes"]}


KINDS = {
    "a lens that disperses": lambda: few(camera=LENS | {"transmission": {"coating": "mgf2"}}, spectrum="dispersive"),
    "a lens in float64": lambda: few(camera=LENS | {"precision": "double"}),
    "instances of a mesh": meshes,
    "a tree over shapes": crowd,
    "motion": moving,
    "spectra": lambda: few(spectrum="spectral"),
    "meshes, shapes and motion": meshes_shapes_and_motion,
}


def taken(kind, session):
    image = rptcam_cl.render(KINDS[kind](), size=SIZE, spp=SPP, seed=3, device=session)
    return np.asarray(image).astype(np.float64)


# The first has tests of its own way through the lens; wavelengths are carried as behind a lens that disperses. What the
# others have is in the last.
SLOW = ("a lens in float64", "spectra", "instances of a mesh", "a tree over shapes", "motion")
# all shapes, lamps and textures are in test_widths.py


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=[pytest.mark.slow] * (kind in SLOW)) for kind in KINDS])
def test_passes_of_single_lanes_make_the_picture_of_the_stream(kind, monkeypatch):
    stream = taken(kind, open_session())
    monkeypatch.setattr(Session, "kind", "gpu")
    session = open_session()
    assert session.lanes == 1
    passes = taken(kind, session)
    assert stream.std() > 0.05
    # rounding that differs sends a few paths elsewhere; all others agree
    assert np.isclose(passes, stream, rtol=1e-5, atol=1e-6).mean() > 0.98
    assert abs(passes.mean() / stream.mean() - 1) < 0.005
