"""Client, worker and scheduler killed at random moments: no file is damaged, and the picture is the same in the end."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

import rptcam_cl
from rptcam_cl.imaging.image import read_film
from rptcam_cl.rendering.checkpoint import read_checkpoint
from tests.rendering.pictures import seed_of
from tests.rendering.test_world import still_life

KILLS = int(os.environ.get("RPTCAM_KILLS", "30"))  # of each kind, by turns with every signal
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
ROOT = Path(__file__).resolve().parents[3]
RENDER = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from rptcam_cl.cli import main; sys.exit(main(sys.argv[1:]))"
WORKER = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from distributed.cli.dask_worker import main; main()"
SCHEDULER = "from distributed.cli.dask_scheduler import main; main()"
WORDS = ["render", "scene.json", "--size", "320x240", "--spp", "64", "-o", "a.exr", "--resume", "--quiet"]


class Cluster:
    """A scheduler and two workers as processes, each of which can be killed and begun anew."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.scheduler = self._begun(SCHEDULER, "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        assert self.scheduler.stderr is not None
        for line in self.scheduler.stderr:
            if found := re.search(r"Scheduler at:\s+(tcp://127\.0\.0\.1:\d+)", line):
                self.address = found[1]
                break
        self.workers = [self.worker(), self.worker()]

    def worker(self) -> subprocess.Popen:
        return self._begun(
            WORKER, self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard", err=subprocess.DEVNULL
        )

    def client(self, words: list[str] = WORDS) -> subprocess.Popen:
        return self._begun(RENDER, *words, "--cluster", self.address, "--tls", "none", err=subprocess.PIPE)

    def _begun(self, program: str, *words: str, err: int = subprocess.PIPE) -> subprocess.Popen:
        return subprocess.Popen(
            [sys.executable, "-c", program, *words], cwd=self.folder, stdout=subprocess.DEVNULL, stderr=err, text=True
        )

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


def check_files(folder: Path) -> None:
    """Every file that has a name of its own can be read."""
    readers = {".rpck": read_checkpoint, ".exr": read_film, ".json": lambda path: json.loads(path.read_text())}
    for path in folder.rglob("*"):
        if path.is_file() and not path.name.startswith(".") and "dask" not in str(path):
            readers.get(path.suffix, lambda path: None)(path)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["client", "worker", "scheduler"])
def test_killed_processes_damage_no_file_and_come_to_the_same_picture(kind: str, tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_text(json.dumps(still_life()))
    whole = rptcam_cl.render(tmp_path / "scene.json", size=(320, 240), spp=64)
    rng, kills, ends = np.random.default_rng(seed_of(kind)), 0, 0
    cluster, longest = Cluster(tmp_path), 6.0
    try:
        while kills < KILLS:
            client = cluster.client()
            try:
                client.wait(rng.uniform(0.5, longest))
                longest = max(0.7 * longest, 2.0)
            except subprocess.TimeoutExpired:
                victim = {"client": client, "scheduler": cluster.scheduler, "worker": cluster.workers[kills % 2]}[kind]
                victim.send_signal(SIGNALS[kills % 3])
                victim.wait(60)
                kills, longest = kills + 1, min(1.1 * longest, 12.0)
                if kind == "worker":
                    cluster.workers[(kills - 1) % 2] = cluster.worker()
                    assert client.wait(300) == 0, client.stderr.read()  # the other worker, and the new one, go on
                client.wait(120)
                if kind == "scheduler":
                    cluster.close()
                    cluster = Cluster(tmp_path)
            check_files(tmp_path)
            if client.returncode == 0:
                ends += 1
                np.testing.assert_array_equal(read_film(tmp_path / "a.exr").pixels, whole.pixels)
                (tmp_path / "a.exr").unlink()
                assert not (tmp_path / "a.parts").exists()
        deadline = time.monotonic() + 300
        while (last := cluster.client()).wait(300) != 0:
            assert time.monotonic() < deadline, last.stderr.read()
        np.testing.assert_array_equal(read_film(tmp_path / "a.exr").pixels, whole.pixels)
        assert kind != "worker" or ends >= KILLS
    finally:
        cluster.close()


LONG = ["render", "scene.json", "--size", "480x360", "--spp", "64", "-o", "a.exr", "--resume", "--quiet"]


def wait_for_parts(folder: Path, client: subprocess.Popen, count: int = 2) -> None:
    while len(list((folder / "a.parts").glob("*.rpck"))) < count:
        assert client.poll() is None, client.stderr.read()
        time.sleep(0.05)


def check_whole(folder: Path) -> None:
    whole = rptcam_cl.render(folder / "scene.json", size=(480, 360), spp=64)
    np.testing.assert_array_equal(read_film(folder / "a.exr").pixels, whole.pixels)
    assert not (folder / "a.parts").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "number", "said"),
    [
        ("scheduler", signal.SIGKILL, "the scheduler is gone"),
        ("scheduler", signal.SIGSTOP, "the scheduler is gone"),
        ("workers", signal.SIGKILL, "all workers are gone"),
    ],
)
def test_lost_cluster_is_said_in_one_line_and_the_parts_are_gone_on_from(
    kind: str, number: signal.Signals, said: str, tmp_path: Path
) -> None:
    (tmp_path / "scene.json").write_text(json.dumps(still_life()))
    cluster = Cluster(tmp_path)
    try:
        client = cluster.client(LONG)
        wait_for_parts(tmp_path, client)
        for victim in [cluster.scheduler] if kind == "scheduler" else cluster.workers:
            victim.send_signal(number)
        assert client.wait(120) == 4
        line = client.stderr.read()
        assert line == f"error: cluster: {said}; a.parts holds the parts that came back (--resume goes on)\n"
    finally:
        cluster.close()
    kept = len(list((tmp_path / "a.parts").glob("*.rpck")))
    assert kept >= 2
    cluster = Cluster(tmp_path)
    try:
        client = cluster.client([word for word in LONG if word != "--quiet"])
        assert client.wait(300) == 0, client.stderr.read()
        check_whole(tmp_path)
    finally:
        cluster.close()


@pytest.mark.slow
def test_frozen_worker_holds_neither_the_picture_nor_the_next_one(tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_text(json.dumps(still_life()))
    cluster = Cluster(tmp_path)
    try:
        client = cluster.client(LONG)
        wait_for_parts(tmp_path, client)
        cluster.workers[0].send_signal(signal.SIGSTOP)
        assert client.wait(200) == 0, client.stderr.read()
        check_whole(tmp_path)
        (tmp_path / "a.exr").unlink()
        client = cluster.client(LONG)  # it does not answer from the beginning
        assert client.wait(200) == 0, client.stderr.read()
        check_whole(tmp_path)
    finally:
        cluster.close()


def local(folder: Path) -> subprocess.Popen:
    """A render by two processes of this machine, whose temporary files are in a folder of their own."""
    (folder / "temporary").mkdir(exist_ok=True)
    return subprocess.Popen(
        [sys.executable, "-c", RENDER, *LONG, "--workers", "2"], cwd=folder, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "TMPDIR": str(folder / "temporary")},
    )  # fmt: skip


@pytest.mark.slow
def test_killed_and_frozen_processes_of_this_machine_leave_nothing_after_the_next_run(tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_text(json.dumps(still_life()))
    client = local(tmp_path)
    wait_for_parts(tmp_path, client)
    family = psutil.Process(client.pid).children(recursive=True)
    client.kill()
    client.wait(60)
    assert not psutil.wait_procs(family, timeout=60)[1]
    assert list((tmp_path / "temporary").iterdir())
    client = local(tmp_path)
    wait_for_parts(tmp_path, client, len(list((tmp_path / "a.parts").glob("*.rpck"))) + 1)
    family = psutil.Process(client.pid).children(recursive=True)
    next(child for child in family if "spawn_main" in " ".join(child.cmdline())).suspend()
    assert client.wait(200) == 0, client.stderr.read()
    assert client.stderr.read() == ""
    assert not psutil.wait_procs(family, timeout=60)[1]
    check_whole(tmp_path)
    (tmp_path / "a.exr").unlink()
    client = local(tmp_path)
    assert client.wait(200) == 0, client.stderr.read()
    assert list((tmp_path / "temporary").iterdir()) == []
