"""Client, worker and scheduler of a sequence killed with -9 at random moments: in the end its frames have the bytes of
one machine.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest

from tests.batch.cluster.test_cluster_kills import RENDER, Cluster, check_files
from tests.rendering.pictures import seed_of
from tests.rendering.test_world import still_life

KILLS = int(os.environ.get("RPTCAM_KILLS", "12"))  # by turns of each process
FRAMES = 12
WORDS = ["render", "scene.json", "--size", "160x120", "--spp", "64", "--frames", f"1-{FRAMES}", "--resume", "--quiet"]
OUT = [*WORDS, "-o", "out.##.exr"]


def run(folder: Path, *words: str) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-c", RENDER, *words], cwd=folder, stderr=subprocess.PIPE, text=True)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a scene and the frames that one machine renders."""
    ways = {"camera.fov_degrees": [{"time_s": 0, "value": 30}, {"time_s": 0.5, "value": 50}]}
    (tmp_path / "scene.json").write_text(json.dumps(still_life() | {"sequence": {"keys": ways}}))
    alone = run(tmp_path, *WORDS, "-o", "alone.##.exr")
    assert alone.wait(600) == 0, alone.stderr.read()
    assert len(list(tmp_path.glob("alone.*.exr"))) == FRAMES
    return tmp_path


def check_frames(folder: Path) -> None:
    """All frames are there, with the bytes of one machine; and go, for the next time."""
    for path in sorted(folder.glob("alone.*.exr")):
        frame = folder / path.name.replace("alone", "out")
        assert frame.read_bytes() == path.read_bytes()
        frame.unlink()


def some_moments(rng: np.random.Generator, client: subprocess.Popen, longest: float) -> bool:
    """Wait for some moments; return whether the client runs still."""
    try:
        client.wait(rng.uniform(0.5, longest))
    except subprocess.TimeoutExpired:
        return True
    return False


def finish(client: subprocess.Popen) -> None:
    assert client.wait(600) == 0, client.stderr.read()


@pytest.mark.slow
def test_frames_of_a_cluster_survive_kills_of_client_worker_and_scheduler(folder: Path) -> None:
    rng, kills, cluster, longest = np.random.default_rng(seed_of("frames")), 0, Cluster(folder), 12.0
    try:
        while kills < KILLS:
            client = cluster.client(OUT)
            if some_moments(rng, client, longest):
                kind = ("worker", "client", "scheduler")[kills % 3]
                victim = {"client": client, "scheduler": cluster.scheduler, "worker": cluster.workers[0]}[kind]
                victim.kill()
                victim.wait(60)
                kills += 1
                if kind == "worker":
                    cluster.workers = [cluster.workers[1], cluster.worker()]
                    finish(client)
                client.wait(120)
                if kind == "scheduler":
                    cluster.close()
                    cluster = Cluster(folder)
            else:
                longest = max(0.7 * longest, 2.0)
            check_files(folder)
            if client.returncode == 0:
                check_frames(folder)
        finish(cluster.client(OUT))
        check_frames(folder)
    finally:
        cluster.close()


@pytest.mark.slow
def test_frames_of_local_workers_survive_kills_and_leave_no_process(folder: Path) -> None:
    rng, kills, longest = np.random.default_rng(seed_of("here")), 0, 15.0
    while kills < KILLS // 2:
        client = run(folder, *OUT, "--workers", "2")
        if some_moments(rng, client, longest):
            family = psutil.Process(client.pid).children(recursive=True)
            workers = [child for child in family if "spawn_main" in " ".join(child.cmdline())]
            if kills % 2 and workers:
                workers[0].send_signal(signal.SIGKILL)
                finish(client)
            else:
                client.kill()
                client.wait(60)
            kills += 1
            assert not psutil.wait_procs(family, timeout=60)[1]  # whoever is left has seen that the client is gone
        else:
            longest = max(0.7 * longest, 2.0)
        check_files(folder)
        if client.returncode == 0:
            check_frames(folder)
    finish(run(folder, *OUT, "--workers", "2"))
    check_frames(folder)
