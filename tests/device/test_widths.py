"""One lane per work item, as on a GPU, and eight, as on a CPU; waves of passes and the stream: the same pictures."""

import numpy as np
import pytest

import rptcam_cl
from benchmarks.films import EXAMPLES, scenes
from benchmarks.scenes import FULL_SIZE, render_samples, wavefront_of
from rptcam_cl.device.session import Session
from rptcam_cl.rendering import tracer
from tests.device.probes import open_session, run
from tests.rendering.test_determinism import LENS
from tests.rendering.test_world import still_life
from tests.support.cases import slow
from tests.support.statistics import assert_same_tiles, sampled

SIZE, SPP = (48, 32), 32
FEW = [still_life()["objects"][number] for number in (0, 1, 8)]  # a chequered floor, a ball of glass and a lamp
CAMERAS = {"few things": {"objects": FEW, "lights": []}, "pinhole": {}, "lens": {"camera": LENS}}
SLOW = [slow(*pair) for pair in (("pinhole", 1), ("pinhole", 8), ("lens", 1), ("lens", 8))]


def picture(camera, session, seed):
    image = rptcam_cl.render(still_life() | CAMERAS[camera], size=SIZE, spp=SPP, seed=seed, device=session)
    return np.asarray(image).astype(np.float64)


@pytest.mark.parametrize("organisation", ["passes", slow("stream")])
@pytest.mark.parametrize("camera", ["few things", *map(slow, ("pinhole", "lens"))])
def test_one_lane_and_eight_give_pictures_that_agree(camera, organisation, monkeypatch):
    session = open_session()
    eight = [picture(camera, session, seed) for seed in range(4)]
    monkeypatch.setattr(Session, "lanes", 1)
    monkeypatch.setattr(tracer, "ORGANISATION", {"cpu": organisation, "gpu": organisation})
    session = open_session()
    one = [picture(camera, session, seed) for seed in range(8)]
    assert_same_tiles(sampled(eight), sampled(one[4:]))
    # with the same seed they differ by rounding at most, but for the few paths that it sends elsewhere
    assert np.isclose(one[:4], eight, rtol=1e-5, atol=1e-6).mean() > 0.98


@pytest.mark.parametrize(("camera", "lanes"), [slow("few things", 1), *SLOW])
def test_passes_and_stream_give_pictures_that_agree(camera, lanes, monkeypatch):
    monkeypatch.setattr(Session, "lanes", lanes)
    session = open_session()
    pictures = {}
    for organisation in ("passes", "stream"):
        monkeypatch.setattr(tracer, "ORGANISATION", {"cpu": organisation, "gpu": organisation})
        pictures[organisation] = picture(camera, session, 5)
    assert np.isclose(pictures["passes"], pictures["stream"], rtol=1e-5, atol=1e-6).mean() > 0.98


@pytest.mark.slow
@pytest.mark.parametrize("name", [*FULL_SIZE, *(path.stem for path in EXAMPLES.glob("*.yaml"))])
def test_sixteen_lanes_and_eight_give_the_same_film(name, monkeypatch):
    """Where they do not, a compiler is wrong: lamps of `lighthouse` counted twice in sixteen, by stream and passes."""
    films = []
    for lanes in (16, 8):
        monkeypatch.setattr(Session, "lanes", lanes)
        wavefront = wavefront_of(scenes()[name], open_session(), organisation="stream")
        render_samples(wavefront, 32)
        films.append(wavefront.sums())
    np.testing.assert_array_equal(*films)


@pytest.mark.parametrize(("lanes", "plain"), [(1, 0), (8, 0), (16, 0), (16, 1)])
def test_eight_neighbours_of_each_lane_are_read_and_written_whole(session, lanes, plain):
    rng, kept = np.random.default_rng(5), -1.0
    records, places = rng.random((64, 8)).astype(np.float32), (8 * rng.permutation(16)).astype(np.int32)
    columns, copies = session.allocate(4 * 8 * 16), session.upload(np.full((24, 8), kept, np.float32))
    run(session, "probe_eight", {"VW": lanes, "PLAIN": plain}, 16 // lanes, records=session.upload(records),
        places=session.upload(places), columns=columns, copies=copies, count=np.uint32(16))  # fmt: skip
    expected = records[places // 8]
    np.testing.assert_array_equal(session.read(columns, np.float32, 128).reshape(8, 16).T, expected)
    copied = session.read(copies, np.float32, 192).reshape(24, 8)
    np.testing.assert_array_equal(copied[:16], expected)
    assert (copied[16:] == kept).all()
