"""Camera rays that go through their lens in float64: ray by ray what the float64 reference says, rounded to float32."""

from dataclasses import replace

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.cameras.lens_records import stop_shape
from rptcam_cl.rendering.cameras.model import CELLS
from rptcam_cl.rendering.cameras.setting import lens_setting
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.passes import PreciseLens
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.scene_buffers import camera_buffers
from rptcam_cl.rendering.traceable_lens import trace_on_device
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from tests.device.probes import wave_record
from tests.support.cases import fast

POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
ROUNDING = 2.0**-24
FLIPPED = [1, 1, -1]  # the device's z runs along the travel
CAMERAS = {
    "coated, coloured, five blades": {
        "lens": "double-gauss-50mm-f1.4",
        "focus": {"distance_m": 2.0},
        "transmission": {"coating": "mgf2", "absorption": False},
        "aperture": {"shape": "polygon", "blades": 5},
        "f_number": 2.0,
    },
    "aspheres": {"lens": "phone-5.6mm", "focus": {"distance_m": 2.0}},
    "cylinders": {"lens": "cylinder-pair", "focus": {"film_distance_mm": 100.0}},
    "fisheye": {"lens": "fisheye-10mm", "focus": {"distance_m": 2.0}, "pupil": "rear"},
}
EVERY_CAMERA = fast(["coated, coloured, five blades"], CAMERAS)


def scene_through(name, **more):
    size = [5.0, 4.0] if "phone" in CAMERAS[name]["lens"] else [24.0, 16.0]
    spectrum = {"mode": "spectral", "lens": "on"} if "coloured" in name else {"mode": "rgb"}
    camera = {"kind": "realistic", "precision": "double", **CAMERAS[name], **POSE, **more}
    return load_scene({
        "film": {"resolution": [24, 16], "size_mm": size}, "camera": camera, "spectrum": spectrum,
        "environment": {"kind": "constant", "radiance": 1}, "objects": [],
    })  # fmt: skip


def rays_between(session, scene, lanes=None):
    """What the first pass writes and what the second makes of it, (8, slots) each."""
    plan = make_plan(scene)
    layout, samples = FilmLayout.of(scene.film), 16
    capacity = layout.pixels * samples
    facts = {
        **plan.camera.facts, **plan.spectrum.facts, "CAMERA_FILE": plan.camera.kernel, "SAMPLER_LATTICE": 1,
        "CAMERA_HAS_LENS": 1, "FILTER": CELLS if len(plan.camera_filter) > 1 else 0, "VW": lanes or 16,
    }  # fmt: skip
    tables = [session.upload(a) for a in (layout.whole_list(), plan.camera_filter, plan.spectrum.table)]
    lens = PreciseLens(session, plan.camera, facts, capacity, camera_buffers(session, plan.camera), *tables)
    seen = []

    def run(launch, items):
        launch.enqueue(items, min(items, 4))
        seen.append(session.read(lens.rays, np.float32, 8 * capacity).reshape(8, capacity))

    lens.enqueue(wave_record(layout, samples, (7, 11)).tobytes(), capacity, run)
    inside = np.tile(layout.inside, samples)
    aims, out = (rows[:, inside] for rows in seen)
    return aims[:5].astype(np.float64), out


def lens_of(scene):
    """The lens in use and its losses."""
    setting = lens_setting(scene)
    shape = stop_shape(scene, scene.camera.aperture)
    return (setting.lens if shape is None else setting.lens.with_stop_shape(shape)), setting.transmission


def aimed(scene, lens, aims):
    """Points on the film and directions in the frame of the lens, of what the first pass has written."""
    back = lens_setting(scene).film_distance_mm
    film = np.column_stack([aims[0], aims[1], np.full(aims.shape[1], lens.length + back)])
    return film, np.column_stack([aims[2], aims[3], np.full(aims.shape[1], lens.length)]) - film


def errors(exact, origins, directions, status):
    """Largest errors of positions, over the size of the lens, and of directions, and how many fates differ."""
    passed = (status == 0) & exact.passed
    assert passed.sum() > 500
    apart, turned = (origins - exact.origins)[passed], (directions - exact.directions)[passed]
    return (
        np.abs(apart).max() / np.abs(exact.origins[passed]).max(),
        np.abs(turned).max(),
        (status != exact.status).sum(),
    )


@pytest.mark.parametrize("name", EVERY_CAMERA)
def test_rays_are_those_of_the_reference_rounded_once(session, name):
    scene = scene_through(name)
    aims, out = rays_between(session, scene)
    lens, transmission = lens_of(scene)
    exact = lens.trace(*aimed(scene, lens, aims), aims[4], "film", transmission=transmission)
    position, direction, other = errors(exact, out[:3].T * FLIPPED, out[3:6].T * FLIPPED, out[6])
    assert position <= ROUNDING
    assert direction <= ROUNDING
    assert other == 0
    if exact.transmittance is not None:  # whose sines and exponentials are those of float32
        np.testing.assert_allclose(out[7], exact.transmittance, atol=3e-6)


@pytest.mark.slow
def test_rays_in_single_precision_err_by_more(session):
    """The control: in float32 the same rays are not those of the reference."""
    scene = scene_through("aspheres")
    aims, _ = rays_between(session, scene)
    lens, _ = lens_of(scene)
    rays = aimed(scene, lens, aims)
    single = trace_on_device(lens, session, *rays, aims[4], "film", "single")
    position, direction, _ = errors(
        lens.trace(*rays, aims[4], "film"), single.origins, single.directions, single.status
    )
    assert position > 2 * ROUNDING
    assert direction > 2 * ROUNDING


@pytest.mark.slow
@pytest.mark.parametrize("name", ["aspheres", "coated, coloured, five blades"])
def test_one_lane_and_eight_make_the_same_rays(session, name, monkeypatch):
    scene = scene_through(name)
    _, eight = rays_between(session, scene)
    monkeypatch.setattr(Session, "lanes", 1)
    _, one = rays_between(session, scene, lanes=1)
    rows = 8 if lens_of(scene)[1] else 7  # the last is left as it was by a lens without losses
    np.testing.assert_array_equal(one[6], eight[6])
    passed = eight[6] == 0
    np.testing.assert_allclose(one[:rows, passed], eight[:rows, passed], rtol=4 * ROUNDING, atol=1e-9)


def test_device_without_float64_is_named_with_the_key(session, monkeypatch):
    lacking = replace(session.info, fp64=False)
    monkeypatch.setattr(session, "info", lacking)
    with pytest.raises(DeviceError, match=r"^camera\.precision: double needs float64, which device .* lacks"):
        rptcam_cl.render(scene_through("fisheye"), spp=1, device=session)
    assert rptcam_cl.render(
        change_scene(scene_through("fisheye"), camera={"precision": "single"}), spp=1, device=session
    )
