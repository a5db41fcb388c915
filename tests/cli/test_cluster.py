"""``--cluster`` and ``--workers``: what a cluster is asked for, and what is said and written of its pictures."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.batch.cluster import TLS
from rptcam_cl.imaging.image import Image
from rptcam_cl.scene.load import load_scene

Command = Callable[..., Any]
AT = ("--cluster", "tls://host:8786")
WORKERS = {"a": {"device": "one", "seconds": 1.0}, "b": {"device": "two", "seconds": 2.0}}


@dataclass
class Cluster:
    """Stands in for workers: keeps what it was asked for."""

    image: Image
    asked: list[dict[str, Any]] = field(default_factory=list)
    interrupted: bool = False

    def picture(self, scene: Any, **options: Any) -> Image:
        self.asked.append({"scene": scene, **options})
        options["folder"].mkdir(exist_ok=True)
        (options["folder"] / "0000.rpck").touch()
        if self.interrupted:
            raise InterruptedError("2 of 3 parts are kept")
        return self.image

    def pictures(self, scenes: Mapping[int, Any], **options: Any) -> Iterator[tuple[int, Image]]:
        self.asked.append({"scenes": scenes, **options})
        for number in reversed(scenes):
            yield number, Image(self.image.pixels, dict(self.image.metadata), self.image.stats)
            if self.interrupted:
                raise InterruptedError("1 of 3 frames is there")


@pytest.fixture
def cluster(renderer: Any, monkeypatch: pytest.MonkeyPatch) -> Cluster:
    renderer.image.stats["cluster"] = {"parts": 3, "workers": WORKERS}
    found = Cluster(renderer.image)
    monkeypatch.setattr("rptcam_cl.batch.cluster_run.render_on_cluster", found.picture)
    monkeypatch.setattr("rptcam_cl.batch.cluster_run.render_scenes_on_cluster", found.pictures)
    return found


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_picture_is_asked_for_with_its_options_and_written(scene: Path, rptcam: Command, cluster: Cluster) -> None:
    words = ("--tls", "ca.pem, cert.pem,key.pem", "--spp", "3", "--seed", "5", "--size", "8x6", "--device", "cpu")
    run = rptcam("render", "scene.yaml", "-o", "a.exr", "-o", "a.png", "--layers", "depth", *AT, *words)
    assert run.code == 0, run.err
    (asked,) = cluster.asked
    assert asked.pop("scene").content_hash() == load_scene(scene).content_hash()
    assert asked.pop("on_progress") is not None and asked.pop("should_stop")() is False
    assert asked == {
        "cluster": "tls://host:8786", "workers": None, "tls": TLS("ca.pem", "cert.pem", "key.pem"), "device": "cpu",
        "allow_mixed": False, "spp": 3, "seed": 5, "size": (8, 6), "crop": None, "layers": ["depth"],
        "folder": Path("a.parts"), "resume": False,
    }  # fmt: skip
    assert names(scene.parent) == ["a.exr", "a.png", "scene.yaml"]  # parts are cleared away
    assert run.err.splitlines() == [
        "cluster: 3 parts by 2 workers on one, two; bits of different devices may differ in the last place",
        "wrote a.exr, a.png: 8 x 6, 4 spp",
    ]


def test_processes_of_this_machine_are_asked_likewise(scene: Path, rptcam: Command, cluster: Cluster) -> None:
    cluster.image.stats["cluster"]["workers"] = {"a": WORKERS["a"]}
    run = rptcam("render", "scene.yaml", "-o", "a.npy", "--workers", "2", "--tls", "none", "--allow-mixed")
    assert run.err.startswith("cluster: 3 parts by 1 worker on one\nwrote a.npy")
    (asked,) = cluster.asked
    assert [asked[key] for key in ("cluster", "workers", "tls", "allow_mixed", "device")] == [
        None,
        2,
        False,
        True,
        None,
    ]
    assert asked["spp"] is None and asked["layers"] == []
    assert rptcam("render", "scene.yaml", "-o", "b.npy", "--workers", "2", "--quiet").err == ""
    assert cluster.asked[1]["on_progress"] is None and cluster.asked[1]["tls"] is None


def test_parts_of_an_earlier_render_are_told_of_and_gone_on_with(
    scene: Path, rptcam: Command, cluster: Cluster
) -> None:
    cluster.interrupted = True
    run = rptcam("render", "scene.yaml", "-o", "a.npy", *AT)
    assert (run.code, run.err) == (130, "interrupted: 2 of 3 parts are kept; --resume goes on from them\n")
    assert names(scene.parent) == ["a.parts", "scene.yaml"]
    cluster.interrupted = False
    note = "note: a.parts holds parts of an earlier render; --resume would go on from it\n"
    assert rptcam("render", "scene.yaml", "-o", "a.npy", *AT).err.startswith(note)
    Path("a.parts").mkdir()
    assert "note" not in rptcam("render", "scene.yaml", "-o", "a.npy", *AT, "--resume").err
    assert [asked["resume"] for asked in cluster.asked] == [False, False, True]


SEQUENCE = """
sequence:
  frames_per_second: 10
  keys: {camera.fov_degrees: [{time_s: 0, value: 40}, {time_s: 1, value: 50}]}
"""


def test_frames_are_written_as_they_come(scene: Path, rptcam: Command, cluster: Cluster) -> None:
    scene.write_text(scene.read_text() + SEQUENCE)
    words = ("render", "scene.yaml", "-o", "a.##.npz", "--frames", "1-3", *AT, "--spp", "2")
    run = rptcam(*words)
    assert run.code == 0, run.err
    (asked,) = cluster.asked
    assert [each.camera.fov_degrees for each in asked["scenes"].values()] == pytest.approx([40, 41, 42])
    assert list(asked["scenes"]) == [1, 2, 3] and asked["settings"]["spp"] == 2
    assert [line.partition(":")[0] for line in run.err.splitlines()] == [f"wrote a.0{k}.npz" for k in (3, 2, 1)]
    assert names(scene.parent) == ["a.01.npz", "a.02.npz", "a.03.npz", "scene.yaml"]
    Path("a.02.npz").unlink()
    cluster.interrupted = True
    run = rptcam(*words, "--quiet")
    assert (run.code, run.err) == (130, "interrupted: 1 of 3 frames is there; --resume goes on with the rest\n")


def test_sweep_has_its_pictures_from_the_cluster(scene: Path, rptcam: Command, cluster: Cluster) -> None:
    words = ("sweep", "scene.yaml", "--over", "picture.ev=0,1", "-o", "out", *AT, "--tls", "none", "--spp", "1")
    run = rptcam(*words)
    assert run.code == 0, run.err
    (asked,) = cluster.asked
    assert [each.picture.ev for each in asked["scenes"].values()] == [0, 1]
    assert (asked["cluster"], asked["tls"], asked["workers"]) == ("tls://host:8786", False, None)
    assert run.err == "ev 0: rendered\nev 1: rendered\n"
    assert [line.split()[-1] for line in run.out.splitlines()] == ["seconds", "3", "3"]  # of both workers


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--tls", "none"], "--tls: is for a cluster (allowed: with --cluster tls://…)"),
        ([*AT, "--tls", "ca.pem,cert.pem"], "--tls: three files (got ca.pem,cert.pem; allowed: as ca.pem,cert.pem,"),
        ([*AT, "--device", "cpu", "--device", "gpu"], "--device: each worker renders on one device (allowed: one name"),
        ([*AT, "--time", "5s"], "--time: does not go with --cluster (allowed: one of the two)"),
        (["--workers", "2", "--denoise"], "--denoise: does not go with --workers (allowed: one of the two)"),
    ],
)
def test_mistake_is_named_before_any_worker_is_asked(
    scene: Path, rptcam: Command, cluster: Cluster, words: list[str], message: str
) -> None:
    run = rptcam("render", "scene.yaml", "-o", "a.png", *words)
    assert run.code == 2
    assert message in run.err
    assert not cluster.asked and names(scene.parent) == ["scene.yaml"]
