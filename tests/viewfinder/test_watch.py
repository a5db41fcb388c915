"""Watching files: an edit is seen once it has come to rest, a missing file when it comes."""

import os
import time
from pathlib import Path

from rptcam_cl.viewfinder.studio import Watch


class Calls:
    """Counts calls and waits for them."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self) -> None:
        self.count += 1

    def reach(self, count: int) -> bool:
        end = time.monotonic() + 30
        while self.count < count and time.monotonic() < end:
            time.sleep(0.005)
        return self.count == count


def test_edits_replacements_and_new_files_are_seen(tmp_path: Path) -> None:
    scene, asset = tmp_path / "scene.yaml", tmp_path / "wood.png"
    scene.write_text("a")
    calls = Calls()
    watch = Watch(lambda: [scene, asset], calls, interval_s=0.02)
    watch.start()
    try:
        scene.write_text("ab")
        assert calls.reach(1)
        other = tmp_path / "new"
        other.write_text("cd")
        os.replace(other, scene)  # noqa: PTH105 -- what editors do
        assert calls.reach(2)
        asset.write_text("came")
        assert calls.reach(3)
        asset.unlink()
        assert calls.reach(4)
        time.sleep(0.1)
        assert calls.count == 4, "nothing changes, nothing is called"
    finally:
        watch.stop()


def test_file_that_is_being_written_is_left_alone(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    looks, called = 0, Calls()

    def files() -> list[Path]:  # asked at each look, from the thread that looks
        nonlocal looks
        looks += called.count == 0
        if looks <= 20:
            scene.write_text("a" * looks)
        return [scene]

    watch = Watch(files, called, interval_s=0.001)
    watch.start()
    try:
        assert called.reach(1)
        assert looks == 21, "the first at which it had stayed as it was"
    finally:
        watch.stop()
