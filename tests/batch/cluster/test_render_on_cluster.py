"""Renders on a cluster: the bits of one run, whoever renders which part; a cluster that cannot render says why."""

import contextlib
import functools
import json
import math
import multiprocessing
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import Mock

import dask
import distributed
import numpy as np
import psutil
import pytest
from PIL import Image as Picture

import rptcam_cl
from rptcam_cl.api.job import RenderJob, merge
from rptcam_cl.api.options import RenderOptions
from rptcam_cl.batch import cluster as client
from rptcam_cl.batch import cluster as tasks
from rptcam_cl.batch import cluster as tasks_out
from rptcam_cl.batch import cluster_run
from rptcam_cl.batch.cluster import TLS, pack_scene, survey
from rptcam_cl.batch.cluster_run import render_on_cluster
from rptcam_cl.core.errors import DeviceError, InputError, StateError
from rptcam_cl.rendering.checkpoint import read_checkpoint, read_part, write_checkpoint
from rptcam_cl.rendering.several import FilmPart
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene
from tests.batch.cluster.conftest import cluster

WORLD: dict[str, Any] = {
    "film": {"resolution": [50, 30]},
    "camera": {"kind": "pinhole", "fov_degrees": 40, "eye": [0, -6, 1.5], "target": [0, 0, 0.8], "up": [0, 0, 1]},
    "exposure": "auto",
    "render": {"seed": 5, "max_depth": 3, "spp": 8},
    "materials": {"dots": {"kind": "matte", "reflectance": {"kind": "image", "file": "pictures/dots.png"}}},
    "objects": [
        {"shape": "sphere", "center": [0, 0, 1], "radius": 1, "material": "dots"},
        {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": "dots"},
    ],
    "environment": {"kind": "gradient", "bottom": 0.2, "top": [0.6, 0.8, 1.0]},
}


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = tmp_path / "scene" / "scene.json"
    (path.parent / "pictures").mkdir(parents=True)
    Picture.fromarray(np.random.default_rng(3).integers(0, 255, (8, 8, 3), np.uint8)).save(
        path.parent / "pictures/dots.png"
    )
    path.write_text(json.dumps(WORLD))
    return path


def test_picture_has_the_bits_and_the_metadata_of_one_run(address: str, scene_file: Path, tmp_path: Path) -> None:
    seen = []
    image = render_on_cluster(
        scene_file, address, tls=False, spp=9, layers=["depth"], folder=tmp_path / "parts", on_progress=seen.append
    )
    alone = rptcam_cl.render(scene_file, spp=9, layers=["depth"])
    np.testing.assert_array_equal(image.pixels, alone.pixels)
    np.testing.assert_array_equal(image["depth"], alone["depth"])
    assert image.metadata == alone.metadata
    count = image.stats["cluster"]["parts"]
    assert count >= 8  # four for each worker
    assert sum(row["parts"] for row in image.stats["cluster"]["workers"].values()) == count
    assert [round(progress.tiles_done * count) for progress in seen] == list(range(1, count + 1))


def test_lost_and_damaged_parts_alone_are_rendered_again(address: str, scene_file: Path, tmp_path: Path) -> None:
    folder = tmp_path / "parts"
    first = render_on_cluster(scene_file, address, tls=False, folder=folder)
    (folder / "2.rpck").unlink()
    (folder / "3.rpck").write_bytes((folder / "3.rpck").read_bytes()[:-1])
    image = render_on_cluster(scene_file, address, tls=False, folder=folder, resume=True)
    np.testing.assert_array_equal(image.pixels, first.pixels)
    assert sum(row["parts"] for row in image.stats["cluster"]["workers"].values()) == 2
    whole = render_on_cluster(scene_file, "tcp://127.0.0.1:1", tls=False, folder=folder, resume=True)  # nothing to do
    np.testing.assert_array_equal(whole.pixels, first.pixels)
    with pytest.raises(StateError, match="parts of another render: its spp is 8, not 9"):
        render_on_cluster(scene_file, address, tls=False, folder=folder, resume=True, spp=9)
    with pytest.raises(StateError, match=r"parts of another render: its layers is \[\], not \['depth'"):
        render_on_cluster(scene_file, address, tls=False, folder=folder, resume=True, layers=["depth"])
    brighter = set_keys(load_scene(scene_file), {"picture.ev": 1})
    with pytest.raises(StateError, match="parts of another render: its scene is"):
        render_on_cluster(brighter, address, tls=False, folder=folder, resume=True)


def test_render_is_prepared_once_for_all_parts_of_a_worker(
    scene_file: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, plain = [], RenderJob.prepare_parts

    def counted(*words: Any) -> RenderJob:
        made.append(words)
        return plain(*words)

    monkeypatch.setattr(RenderJob, "prepare_parts", counted)
    image = render_on_cluster(scene_file, address, tls=False, spp=3)  # another number than before: not prepared yet
    assert image.stats["cluster"]["parts"] >= 8
    assert len(made) == 1  # both workers are threads of this process


def test_what_two_workers_find_is_the_same_though_it_holds_what_is_no_number() -> None:
    found = {"focus": {"metadata": {"blur_m": math.nan}}, "metered_cd_m2": 3.0}
    assert tasks.is_same_findings(found, pickle.loads(pickle.dumps(found)))
    assert not tasks.is_same_findings(found, found | {"focus": {"metadata": {"blur_m": 1.0}}})
    assert not tasks.is_same_findings(found, found | {"metered_cd_m2": 3.1})


def test_part_after_a_measurement_of_speed_has_all_tiles(scene_file: Path, tmp_path: Path) -> None:
    scene, settings = load_scene(scene_file), RenderOptions(size=(640, 480), spp=1)  # more than a wave holds
    renderer = RenderJob.prepare_parts(scene, settings)
    renderer.forecast(0.2)
    (tmp_path / "1.rpck").write_bytes(renderer.part(FilmPart())[0])
    whole = merge([tmp_path / "1.rpck"])
    np.testing.assert_array_equal(whole.pixels, rptcam_cl.render(scene, size=(640, 480), spp=1).pixels)


@pytest.mark.slow
def test_parts_of_a_worker_have_the_sharp_layers_of_their_tiles(scene_file: Path, tmp_path: Path) -> None:
    layers = ("sharp_depth", "sharp_object_id", "crypto_object")
    scene, settings = load_scene(scene_file), RenderOptions(size=(24, 16), spp=2, layers=layers)
    renderer = RenderJob.prepare_parts(scene, settings)
    paths = [tmp_path / f"{number}.rpck" for number in (1, 2)]
    sizes = []
    for number, path in enumerate(paths, 1):
        path.write_bytes(renderer.part(FilmPart(number, 2))[0])
        sizes.append(path.stat().st_size)
    merged, whole = merge(paths), rptcam_cl.render(scene, size=(24, 16), spp=2, layers=layers)
    for name in layers:
        np.testing.assert_array_equal(merged[name], whole[name])
    (tmp_path / "all.rpck").write_bytes(renderer.part(FilmPart())[0])
    assert max(sizes) < 0.7 * (tmp_path / "all.rpck").stat().st_size  # each has its own tiles alone


def test_workers_of_this_machine_spend_no_time_on_watching_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []
    profiled = "distributed.worker.profile.enabled"
    monkeypatch.setattr(distributed, "LocalCluster", lambda **words: seen.append((words, dask.config.get(profiled))))
    client.workers_here(2, threads=3)
    words, found = seen[0]
    assert found is False
    assert words["env"]["POCL_CPU_MAX_CU_COUNT"] == "3"
    assert dask.config.get(profiled) is True  # what others do in this process is theirs


def family() -> list[psutil.Process]:
    """This process and those that it has begun."""
    here = psutil.Process()
    return [here, *here.children(recursive=True)]


def listening() -> set[int]:
    """The ports at which the family listens."""
    return {c.laddr.port for each in family() for c in each.net_connections() if c.status == psutil.CONN_LISTEN}


def test_who_has_not_the_credentials_of_workers_of_this_machine_is_refused_by_each_of_their_ports() -> None:
    before = listening()
    with client.workers_here(1, threads=1) as local:
        address = local.scheduler_address.partition("://")[2]
        for scheme, security in (("tcp", None), ("tls", distributed.Security.temporary())):
            with pytest.raises(OSError, match=r"Timed out|certificate|closed"):
                distributed.Client(f"{scheme}://{address}", security=security, timeout=2.0)
        ports = listening() - before
        assert len(ports) >= 3  # scheduler, nanny and worker
        for port in ports:
            with socket.create_connection(("127.0.0.1", port), timeout=10) as plain:
                plain.sendall(b"GET /info/main/workers.html HTTP/1.0\r\n\r\n")
                with contextlib.suppress(ConnectionResetError):
                    assert b"200 OK" not in plain.recv(4096)
        with distributed.Client(local, set_as_default=False) as known:
            assert list(known.run(os.getpid).values()) == [family()[-1].pid]


def test_without_cryptography_workers_of_this_machine_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cryptography", None)
    with pytest.raises(InputError, match=r"workers: need cryptography .install rptcam_cl\[cluster\]"):
        client.workers_here(1, threads=1)


def test_workers_of_this_machine_leave_interrupts_to_the_client(monkeypatch: pytest.MonkeyPatch) -> None:
    asks = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()))"
    context = multiprocessing.get_context("spawn")
    heard: list[object] = []

    def local_cluster(**words: object) -> str:
        worker = context.Process(target=int)  # as the engine starts them
        worker.start()
        worker.join()
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)  # other threads of the tests hear of it at once
        heard.append("not yet")
        return subprocess.run([sys.executable, "-c", asks], stdout=subprocess.PIPE, text=True, check=True).stdout

    monkeypatch.setattr(distributed, "LocalCluster", local_cluster)
    before = signal.signal(signal.SIGINT, lambda *_: heard.append("now"))  # whatever other tests have left there
    try:
        assert client.workers_here(2, threads=1) == "True\n"
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == ["not yet", "now"]
    assert subprocess.run([sys.executable, "-c", asks], stdout=subprocess.PIPE, check=True).stdout == b"False\n"


def test_workers_that_are_lost_at_their_start_are_started_again(monkeypatch: pytest.MonkeyPatch) -> None:
    failures = [RuntimeError("Nanny failed to start."), RuntimeError("Nanny failed to start.")]

    def local_cluster(**words: object) -> str:
        if failures:
            raise failures.pop()
        return "a cluster"

    monkeypatch.setattr(distributed, "LocalCluster", local_cluster)
    assert client.workers_here(2, threads=1) == "a cluster"
    failures += [RuntimeError("Nanny failed to start.")] * client.STARTS
    with pytest.raises(DeviceError, match=r"the workers of this machine do not start \(Nanny failed to start\.\)"):
        client.workers_here(2, threads=1)


def test_stopped_render_keeps_its_parts(address: str, scene_file: Path, tmp_path: Path) -> None:
    done: list[Any] = []
    with pytest.raises(InterruptedError, match="parts"):
        render_on_cluster(
            scene_file, address, tls=False, folder=tmp_path / "parts", on_progress=done.append,
            should_stop=lambda: len(done) >= 3,
        )  # fmt: skip
    files = sorted((tmp_path / "parts").glob("*.rpck"))
    assert len(files) == 3
    assert all(read_part(file).done == 8 for file in files)


def test_file_where_parts_are_to_be_kept_is_refused_before_any_work(scene_file: Path, tmp_path: Path) -> None:
    (tmp_path / "parts").touch()
    with pytest.raises(StateError, match=r"parts: is no folder, and parts are kept there"):
        render_on_cluster(scene_file, "tcp://127.0.0.1:1", tls=False, folder=tmp_path / "parts")


def test_workers_need_no_file_of_the_client(scene_file: Path, tmp_path: Path) -> None:
    parcel = pack_scene(load_scene(scene_file))
    assert list(parcel.files) == ["pictures/dots.png"]
    elsewhere = parcel.unpacked(tmp_path / "elsewhere")
    assert elsewhere.content_hash() == load_scene(scene_file).content_hash()
    assert elsewhere.base_dir == tmp_path / "elsewhere"
    other = Picture.new("RGB", (8, 8))
    other.save(scene_file.parent / "pictures/dots.png")
    assert pack_scene(load_scene(scene_file)).digest != parcel.digest


def test_files_outside_the_folder_are_not_sent(scene_file: Path, tmp_path: Path) -> None:
    picture = {"kind": "image", "file": "../scene/pictures/dots.png"}
    world = WORLD | {"materials": {"dots": {"kind": "matte", "reflectance": picture}}}
    scene = load_scene(world, base_dir=tmp_path / "elsewhere", allow_folders=[scene_file.parent])
    with pytest.raises(InputError, match="lies outside"):
        pack_scene(scene)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({}, "one of the two"),
        ({"cluster": "tcp://127.0.0.1:8786", "workers": 2}, "one of the two"),
        ({"workers": 0}, "got 0; allowed: 1 to 256"),
        ({"cluster": "127.0.0.1:8786"}, "is no address"),
        ({"cluster": "tcp://127.0.0.1:99999"}, "is no address"),
        ({"cluster": "tcp://192.168.0.7:8786"}, "is open to the network"),
        ({"cluster": "tcp://farm.example:8786"}, "is open to the network"),
        ({"cluster": "tls://farm.example:8786"}, "needs certificates"),
        ({"cluster": "tls://farm.example:8786", "tls": TLS("no.pem", "no.pem", "no.pem")}, "no.pem: no such file"),
        ({"cluster": "tcp://[::1]:8786", "tls": TLS("a", "b", "c")}, "is not encrypted"),
        ({"workers": 2, "tls": TLS("a", "b", "c")}, "make their own"),
        ({"workers": 2, "tls": False}, "make their own"),
        ({"cluster": "tcp://127.0.0.1:8786"}, "asks for no credentials, and every user of this machine"),
        ({"cluster": "tls://127.0.0.1:8786", "tls": False}, "needs certificates"),
        ({"cluster": "tcp://192.168.0.7:8786", "tls": False}, "is open to the network"),
    ],
)
def test_wrong_addresses_are_refused(words: dict[str, Any], message: str, scene_file: Path) -> None:
    with pytest.raises(InputError, match=message):
        render_on_cluster(scene_file, **words)


def test_addresses_of_this_machine_need_no_certificates_where_all_its_users_are_trusted() -> None:
    for address in ("tcp://127.0.0.1:8786", "tcp://localhost:8786", "tcp://[::1]:8786", "tcp://127.1.2.3:1"):
        client.check_cluster(address, None, tls=False)


def test_cluster_that_cannot_render_is_refused_before_any_work(
    scene_file: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client, "WAIT_S", 1.0)
    with pytest.raises(DeviceError, match=r"no scheduler answers at tcp://127\.0\.0\.1:1 "):
        render_on_cluster(scene_file, "tcp://127.0.0.1:1", tls=False)
    with cluster(0) as empty, pytest.raises(DeviceError, match=r"has no worker .start one: dask worker tcp"):
        render_on_cluster(scene_file, empty, tls=False)
    with pytest.raises(DeviceError, match=r"cannot render: .*fits no OpenCL device"):
        render_on_cluster(scene_file, address, tls=False, device="nothing-like-it")
    monkeypatch.setattr(tasks, "survey", lambda device=None: survey(device) | {"version": "0.0.1"})
    with pytest.raises(StateError, match=r"has version 0\.0\.1, and this is"):
        render_on_cluster(scene_file, address, tls=False)


def test_worker_that_is_lost_while_it_is_surveyed_does_not_end_the_render() -> None:
    """As where it is killed at that moment: the engine returns an error of the connection in place of its answer."""
    answers = iter([{"a": OSError("closed")}, {"a": OSError("closed"), "b": tasks.survey()}])
    fake = SimpleNamespace(
        wait_for_workers=lambda *words, **more: None, nthreads=lambda: {"all": 1}, run=lambda *w, **m: next(answers)
    )
    assert client._check_workers(fake, "tcp://127.0.0.1:1", None) == ["b"]
    assert next(answers, None) is None
    missing = SimpleNamespace(**{**vars(fake), "run": lambda *w, **m: {"a": ModuleNotFoundError("")}})
    with pytest.raises(DeviceError, match="a worker lacks"):
        client._check_workers(missing, "tcp://127.0.0.1:1", None)


def test_worker_that_is_lost_while_the_scene_is_sent_does_not_end_the_render(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tasks_out, "SEND_AGAIN_S", 0.0)
    monkeypatch.setattr(tasks_out, "COUNT_WORKERS_S", 0.0)
    answers: list[Any] = [OSError("Stream is closed"), TimeoutError("No valid workers"), AttributeError("scatter")]
    workers = {"a": 1}

    def submit(*words: Any, **more: Any) -> Any:
        if answers:
            raise answers.pop(0)
        return Mock()

    parcel = SimpleNamespace(digest="", files={})
    engine = SimpleNamespace(status="running", submit=submit, nthreads=lambda: workers, scatter=lambda *w, **m: None)
    out = tasks_out.TasksOut(engine, cast("Any", parcel), ["a"], "; all is kept")
    out._tasks[0] = tasks.render_part, ()
    out._send(0)
    assert next(iter(out._out.values()))[0] == 0
    workers.clear()
    monkeypatch.setattr(tasks_out, "SILENCE_S", 0.01)
    time.sleep(0.02)
    with pytest.raises(StateError, match="all workers are gone; all is kept"):
        out.check_reached()
    engine.status = "closed"
    with pytest.raises(StateError, match="the scheduler is gone; all is kept"):
        out.check_reached()


def test_worker_that_joins_with_another_version_ends_the_render(
    scene_file: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client, "_check_workers", lambda engine, *words: list(engine.nthreads()))
    monkeypatch.setattr(tasks, "__version__", "0.0.1")
    with pytest.raises(StateError, match=r"a worker runs version 0\.0\.1, and the client"):
        render_on_cluster(scene_file, address, tls=False)


def test_workers_and_parts_of_other_code_are_refused_or_named(
    scene_file: Path, address: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    mine = tasks.survey()["made_by"]
    with monkeypatch.context() as other:
        other.setattr(
            tasks, "survey", lambda device: {"version": rptcam_cl.__version__, "made_by": mine | {"code": "other"}}
        )
        other.setattr(client, "survey", tasks.survey)
        with pytest.raises(
            StateError, match=r"^cluster: the worker tcp://.*: its code is other, and that of this program "
        ):
            render_on_cluster(scene_file, address, tls=False)
    with monkeypatch.context() as late:  # it joins after the survey
        late.setattr(client, "_check_workers", lambda engine, *words: list(engine.nthreads()))
        late.setattr(cluster_run, "Job", functools.partial(tasks.Job, code=mine | {"numpy": "other", "driver": ""}))
        with pytest.raises(StateError, match=r"^cluster: a worker: its numpy is .*, and that of the client other "):
            render_on_cluster(scene_file, address, tls=False)

    rendered: list[float] = []
    words: dict[str, Any] = {"folder": tmp_path / "parts", "resume": True, "on_progress": rendered.append}
    with pytest.raises(InterruptedError):
        render_on_cluster(scene_file, address, tls=False, should_stop=lambda: len(rendered) > 0, **words)
    plan = json.loads((tmp_path / "parts/plan.json").read_text())
    assert plan["made_by"] == mine
    (tmp_path / "parts/plan.json").write_text(json.dumps(plan | {"made_by": mine | {"driver": "old"}}))
    with pytest.raises(StateError, match=r"its driver is .*, and that of .*parts old .*--allow-mixed"):
        render_on_cluster(scene_file, address, tls=False, **words)
    (tmp_path / "parts/plan.json").write_text(json.dumps(plan | {"made_by": mine | {"code": "old"}}))
    with pytest.raises(StateError, match=r"^this program: its code is .*, and that of .*parts old .*--allow-mixed"):
        render_on_cluster(scene_file, address, tls=False, **words)
    (tmp_path / "parts/plan.json").write_text(json.dumps(plan))
    [part, *_] = (tmp_path / "parts").glob("*.rpck")
    saved = read_checkpoint(part)
    write_checkpoint(part, saved.facts | {"made_by": [mine | {"code": "old"}]}, saved.arrays)
    with pytest.warns(UserWarning, match="its code is "):
        image = render_on_cluster(scene_file, address, tls=False, allow_mixed=True, **words)
    assert {each["code"] for each in image.metadata["mixed"]} == {mine["code"], "old"}
    with pytest.raises(StateError, match=r"its code is .*--allow-mixed"):
        render_on_cluster(scene_file, address, tls=False, **words)


def test_scenes_that_cannot_be_divided_are_refused(scene_file: Path, address: str) -> None:
    with pytest.raises(InputError, match="variance needs the whole film"):
        render_on_cluster(scene_file, address, tls=False, layers=["variance"])


def test_without_dask_the_extra_is_named(scene_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"install rptcam_cl\[cluster\]"):
        render_on_cluster(scene_file, workers=2)
