"""Waves of passes with one lane per work item, as a GPU gets them, make the pictures of a processor's stream."""

from dataclasses import replace

import numpy as np
import pytest

import rptcam_cl
from benchmarks.scenes import reference_scene, render_samples, wavefront_of
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.files import kernels_dir
from rptcam_cl.core.records import MATERIAL, PRIMITIVE, STATE_FIELDS, WAVE, MaterialKind, device_declarations
from rptcam_cl.device import programs, session
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.layers import NO_PRIMITIVE, PATH_ENDED
from rptcam_cl.rendering.passes import SORTED, SORTERS
from rptcam_cl.studies.selfcheck_suite import run_suite
from tests.device.probes import open_session
from tests.device.test_kernels import all_facts, sheet
from tests.rendering.test_determinism import LENS
from tests.rendering.test_world import still_life
from tests.support.approximate import FLUSHED, approximate
from tests.support.cases import slow

SIZE, SPP = (24, 16), 8
IN_AIR = -3  # what is hit where a medium scatters
MATTE = {"kind": "matte", "reflectance": [0.7, 0.5, 0.3]}
SHEET = {"shape": "mesh", "mesh": "sheet", "material": MATTE}


DISPERSING = {"camera": LENS | {"transmission": {"coating": "mgf2"}}, "spectrum": "dispersive"}


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


def everything():
    """All at once: a tree over shapes, instances of meshes, what moves (a mesh, a shape, the camera), and the lens."""
    scene, other = moving(), meshes()
    one, two = other["objects"][3:]
    two |= {"motion": [{"time_s": 0}, {"time_s": 1, "rotate": {"axis": [0, 1, 0], "degrees": 20}}]}
    scene |= {"objects": [*scene["objects"], *crowd()["objects"][3:], one, two], "meshes": other["meshes"]}
    return scene | DISPERSING | {"camera": DISPERSING["camera"] | {"motion": scene["camera"]["motion"]}}


KINDS = {
    "a lens that disperses": lambda: few(**DISPERSING),
    "a lens in float64": lambda: few(camera=LENS | {"precision": "double"}),
    "instances of a mesh": meshes,
    "a tree over shapes": crowd,
    "motion": moving,
    "spectra": lambda: few(spectrum="spectral"),
    "everything": everything,
}


def taken(kind, session):
    image = rptcam_cl.render(KINDS[kind](), size=SIZE, spp=SPP, seed=3, device=session)
    return np.asarray(image).astype(np.float64)


# A lens in float64 has tests of its own way through it; all shapes, lamps and textures are in test_widths.py.
FAST = "a lens that disperses"


@pytest.mark.slow
@pytest.mark.parametrize("kind", [pytest.param(kind, marks=[pytest.mark.slow] * (kind != FAST)) for kind in KINDS])
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


@pytest.mark.slow
def test_work_items_take_living_paths_alone_and_the_host_waits_for_nothing_inside_a_wave(monkeypatch):
    monkeypatch.setattr(Session, "kind", "gpu")
    device = open_session()
    device.info = replace(device.info, platform="NVIDIA CUDA")
    assert device.group == 128
    wavefront = wavefront_of(reference_scene("B", shrink=16), device, 3 * SORTED)
    wave = wavefront.waves(0, SPP)[0]
    with monkeypatch.context() as waiting:
        for name in ("finish", "read"):
            waiting.delattr(Session, name)  # a wave that waits fails
        wavefront.enqueue(*wave)
    run, held, taken = wavefront._launches.run, wavefront._held, []

    def fields():
        return device.read(held.state, np.int32, wavefront.needs.paths // 4).reshape(-1, held.capacity)

    def half(launch, items):  # leaves the later half of each block's paths out of the shading
        if launch.name != "shade":
            run(launch, items)
            return
        before = fields()
        queue = before[STATE_FIELDS.index("QUEUE")].view(np.uint16)
        blocks = range(-(-items // SORTED))
        listed = [queue[SORTED * k :][: queue[held.capacity + k]].astype(int) + SORTED * k for k in blocks]
        met = before[STATE_FIELDS.index("HIT"), :items] != NO_PRIMITIVE
        goes_on = (before[STATE_FIELDS.index("ORIGIN"), :items] != PATH_ENDED) & met  # there is no sky
        wanted = np.flatnonzero(goes_on) if not taken else np.intersect1d(taken[-1], np.flatnonzero(goes_on))
        np.testing.assert_array_equal(np.sort(np.concatenate(listed)), wanted)
        for k in blocks:
            queue[held.capacity + k] //= 2
        device.write(held.state, before)
        run(launch, items)
        taken.append(np.sort(np.concatenate([each[: len(each) // 2] for each in listed])))
        np.testing.assert_array_equal(np.flatnonzero((fields() != before).any(axis=0)), taken[-1])

    monkeypatch.setattr(wavefront._launches, "run", half)
    wavefront.enqueue(*wave)
    assert 100 < len(taken[2]) < len(taken[1]) < len(taken[0])


def test_a_processor_works_as_a_gpu_where_the_environment_says_so(monkeypatch):
    monkeypatch.setenv("RPTCAM_ORGANISATION", "passes")
    device = Session(choose_device(None))
    assert (device.kind, device.lanes, device.info.type) == ("gpu", 1, "cpu")
    monkeypatch.setenv("RPTCAM_ORGANISATION", "waves")
    with pytest.raises(DeviceError, match="got waves; allowed: passes"):
        Session(choose_device(None))


def film_of(name):
    """A reference scene on a device that nothing was built for."""
    wavefront = wavefront_of(reference_scene(name, shrink=4), Session(choose_device(None)))
    render_samples(wavefront, 16)
    return wavefront.picture(16).astype(np.float64)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["A", "A_lens", "B", "C"])
def test_reference_scenes_agree_to_the_bit(name, monkeypatch):
    stream = film_of(name)
    monkeypatch.setenv("RPTCAM_ORGANISATION", "passes")
    np.testing.assert_array_equal(film_of(name), stream)


@pytest.mark.parametrize("sky", [slow(0), 1])
def test_paths_of_a_block_are_sorted_by_what_they_met_and_those_that_ended_left_out(sky):
    slots = 2 * SORTED + 512  # the last block is not full
    random = np.random.default_rng(5)
    kinds = random.permutation(len(MaterialKind))
    materials, primitives = np.zeros(len(kinds), MATERIAL.dtype), np.zeros(len(kinds), PRIMITIVE.dtype)
    materials["kind"], primitives["material"] = kinds, np.arange(len(kinds))[::-1]
    session = open_session()
    session.write(
        state := session.allocate(4 * len(STATE_FIELDS) * slots), np.zeros(slots * len(STATE_FIELDS), np.int32)
    )
    program = session.program(
        ["pass/sort.cl"], all_facts() | {"ENVIRONMENT": sky, "EMITTER_SUNS": 0, "VW": 1}, device_declarations()
    )
    wave = np.zeros(1, WAVE.dtype)
    wave["pixels"], wave["samples"] = slots // 2, 2
    launch = session.bind(
        program, "sort", primitives=session.upload(primitives), materials=session.upload(materials), state=state,
        capacity=np.uint32(slots), wave=wave.tobytes(), depth=np.uint32(1),
    )  # fmt: skip
    order = [np.arange(first, min(first + SORTED, slots)) for first in range(0, slots, SORTED)]
    fields = session.read(state, np.int32, slots * len(STATE_FIELDS)).reshape(-1, slots)
    queue = fields[STATE_FIELDS.index("QUEUE")].view(np.uint16)
    queue[:slots] = np.arange(slots) % SORTED  # as the search leaves it
    for depth in (1, 2, 3):
        origin = np.where(random.random(slots) < 0.4, PATH_ENDED, random.integers(-1, 3, slots))
        hit = random.choice([NO_PRIMITIVE, IN_AIR, *range(len(kinds))], slots)
        fields[STATE_FIELDS.index("ORIGIN")], fields[STATE_FIELDS.index("HIT")] = origin, hit
        session.write(state, fields)
        launch.set(depth=np.uint32(depth))
        launch.enqueue(len(order) * SORTERS, SORTERS)
        fields = session.read(state, np.int32, fields.size).reshape(-1, slots)
        queue = fields[STATE_FIELDS.index("QUEUE")].view(np.uint16)
        goes_on = (origin != PATH_ENDED) & ((hit != NO_PRIMITIVE) | (sky > 0))
        rank = np.where(hit >= 0, kinds[::-1][hit], len(kinds) + (hit == NO_PRIMITIVE))
        for block, before in enumerate(order):
            living = before[goes_on[before]]
            order[block] = living[np.argsort(rank[living], kind="stable")]
            assert queue[slots + block] == len(living) > 50
            first = block * SORTED
            np.testing.assert_array_equal(first + queue[first : first + len(living)].astype(int), order[block])


@pytest.fixture
def as_gpus_compute(monkeypatch):
    """The device of the tests with a GPU's work, its division and roots, and without its denormal numbers."""
    monkeypatch.setenv("RPTCAM_ORGANISATION", "passes")

    def begin():
        exact = session.assemble
        monkeypatch.setattr(
            session, "assemble", lambda *given, library_arch: approximate(exact(*given, library_arch=library_arch))
        )
        monkeypatch.setattr(programs, "BUILD_OPTIONS", (*programs.BUILD_OPTIONS, FLUSHED))

    return begin


def test_divisors_and_roots_are_off_by_a_unit_but_constants_are_not():
    text = approximate("x = a / (b + c).y / 2.0f / SIZE / -d[i / j] + sqrt(e); // a / b")
    assert text.endswith("x = a / off((b + c).y) / 2.0f / SIZE / off(-d[i / off(j)]) + near_sqrt(e);  ")


def test_declarations_of_built_in_functions_stand_as_they_are_before_the_simulated_division():
    declared = programs.expand(["common/builtins.h"], {})
    text = approximate(declared + "x = sqrt(a);")
    assert "sqrt(type)" in declared and text.startswith(declared) and text.endswith("x = near_sqrt(a);")


def test_division_can_be_simulated_in_every_kernel():
    for path in kernels_dir().glob("*/*.[hc]*"):
        approximate(path.read_text(encoding="utf-8"))  # raises where a divisor ends in another line


@pytest.mark.slow
@pytest.mark.parametrize("name", ["A", "A_lens", "B", "C"])
def test_pictures_survive_the_division_of_gpus(name, as_gpus_compute):
    exact = film_of(name)
    as_gpus_compute()
    film = film_of(name)
    assert (film != exact).mean() > 0.1  # it was off
    # measured: 0, 0.07, 0.008 and 0.05 % of the values are those of paths sent elsewhere; means agree to 1.3e-5
    assert np.isclose(film, exact, rtol=1e-5, atol=1e-6).mean() > 0.998
    assert abs(film.mean() / exact.mean() - 1) < 1e-4


@pytest.mark.slow
def test_numerics_hold_with_the_division_of_gpus(as_gpus_compute):
    as_gpus_compute()
    found = [check for checks, _ in run_suite(Session(choose_device(None))) for check in checks]
    assert [check.name for check in found if check.failed] == []
    assert len(found) == 28


@pytest.mark.slow
@pytest.mark.parametrize("entries", [0, 1])
def test_rays_whose_short_stack_is_shorter_meet_the_same(entries, monkeypatch):
    monkeypatch.setenv("RPTCAM_ORGANISATION", "passes")
    kind = "instances of a mesh"
    five = taken(kind, Session(choose_device(None)))
    exact = session.assemble
    seen = []

    def shorter(files, facts, *given, library_arch):
        seen.append(facts.get("SHORT_STACK"))
        fewer = {"SHORT_ENTRIES": entries, "PLACES_HELD": entries}
        return exact(files, facts | fewer, *given, library_arch=library_arch)

    monkeypatch.setattr(session, "assemble", shorter)
    np.testing.assert_array_equal(taken(kind, Session(choose_device(None))), five)
    assert 1 in seen
