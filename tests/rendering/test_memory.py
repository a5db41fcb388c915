"""A scene that does not fit says so before anything is allocated."""

from dataclasses import replace

import numpy as np
import pytest

import rptcam_cl.rendering.tracer as memory
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.passes import way_of
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.tracer import MemoryNeeds, Wavefront, check_memory, memory_needs
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.selfcheck import globe
from tests.rendering.pictures import MATTE, looking, scene_of

VIEW = looking([0, -5, 0], [0, 0, 0])


@pytest.fixture(scope="module")
def session() -> Session:
    made = Session(choose_device())
    way_of(made, "stream", Wavefront)  # so that no test sees the trial of the driver
    return made


def test_every_array_of_a_scene_of_meshes_is_counted(session):
    points, faces = globe(60, 60)
    ball = {"shape": "mesh", "vertices": points.tolist(), "faces": faces.tolist(), "material": MATTE}
    scene = load_scene(scene_of([ball], VIEW))
    allocated = []
    watched = Session(session.info)
    watched.upload = lambda array, **keys: allocated.append(array.nbytes) or Session.upload(watched, array, **keys)
    plan = make_plan(scene)
    Wavefront(watched, plan, FilmLayout.of(scene.film), scene.render)
    needs = memory_needs(plan, session, film=[0], paths=[0])
    assert sum(allocated) <= needs.triangles + needs.textures + needs.rest + 65536  # records of camera, lens and tables
    assert needs.triangles <= 2.2 * sum(allocated)


def test_scene_too_large_for_the_device_names_what_it_needs(session, monkeypatch):
    small = replace(session.info, memory_bytes=10**9)
    monkeypatch.setattr(session, "info", small)
    needs = MemoryNeeds(film=10**6, paths=10**6, triangles=3 * 10**9, textures=0, rest=0, building=10**9)
    with pytest.raises(
        InputError, match=r"needs 4 GB: 3 GB for triangles.*, 1 GB for building.*offers .*fewer triangles"
    ):
        check_memory(needs, session)


def test_buffer_larger_than_the_driver_takes_is_refused_before_anything_is_allocated(session, monkeypatch):
    monkeypatch.setattr(Session, "largest_buffer_bytes", 4_000_000)  # of a device of many gigabytes
    monkeypatch.setattr(Session, "allocate", lambda *_, **__: pytest.fail("allocated before it was refused"))
    scene = load_scene(scene_of([], VIEW, resolution=(640, 360)))
    with pytest.raises(InputError, match=r"5.54 MB for the film; device .* at most 4 MB in one piece \(render a part"):
        Wavefront(session, make_plan(scene), FilmLayout.of(scene.film), scene.render)
    points, faces = globe(50, 100)
    ball = {"shape": "mesh", "vertices": points.tolist(), "faces": faces.tolist(), "material": MATTE}
    needs = memory_needs(make_plan(load_scene(scene_of([ball], VIEW))), session, film=[0], paths=[0])
    monkeypatch.setattr(Session, "largest_buffer_bytes", 100_000)
    with pytest.raises(InputError, match=r"1\d{5} bytes for (triangles|vertices); .* \(use meshes of fewer triangles"):
        check_memory(needs, session)


def test_host_memory_bounds_what_a_cpu_may_plan_with(session, monkeypatch):
    monkeypatch.setattr(memory, "free_host_bytes", lambda: 2_000_000)
    scene = load_scene(scene_of([], VIEW, resolution=(640, 360)))
    allocate = Session.allocate
    monkeypatch.setattr(Session, "allocate", lambda *_, **__: pytest.fail("allocated before it was refused"))
    with pytest.raises(InputError, match=r"needs .* MB: .* for the film.* offers 1.6 MB \(render a part with crop"):
        Wavefront(session, make_plan(scene), FilmLayout.of(scene.film), scene.render)
    monkeypatch.setattr(Session, "allocate", allocate)


def test_large_arrays_are_not_copied_for_a_cpu(session):
    array = np.arange(1 << 20, dtype=np.float32)
    buffer = session.upload(array, in_place=True)
    assert (session.read(buffer, np.float32, len(array)) == array).all()
