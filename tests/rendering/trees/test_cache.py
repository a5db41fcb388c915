"""Trees on disk: found again, never trusted, never in the way."""

import multiprocessing
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.rendering import scene_buffers as trees
from rptcam_cl.rendering import tree_build
from rptcam_cl.rendering.scene_buffers import load_or_build
from rptcam_cl.rendering.tree_build import EMPTY, Bvh, build_bvh, is_sound
from tests.rendering.trees.meshes import boxes_of, soup
from tests.rendering.trees.trees import quality


@pytest.fixture(scope="module")
def tree(session):
    return build_bvh(*boxes_of(soup(300)), session=session)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    return tmp_path / "trees"


def limit(monkeypatch, most_bytes):
    """Let all trees take so many bytes together; the heads of their files do not count here."""
    monkeypatch.setattr(trees, "_DISK", replace(trees._DISK, most_bytes=most_bytes))


class Build:
    """Counts how often the tree is built."""

    def __init__(self, tree: Bvh) -> None:
        self.tree, self.calls = tree, 0

    def __call__(self) -> Bvh:
        self.calls += 1
        return self.tree


def same(one: Bvh, two: Bvh) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(two, name)) for name in trees.ARRAYS)


def only_file(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path


def test_second_call_finds_the_tree_of_the_first(folder, tree):
    build = Build(tree)
    assert same(load_or_build("a", build), tree)
    assert same(load_or_build("a", build), tree)
    assert build.calls == 1


def test_other_key_is_another_tree(folder, tree):
    build = Build(tree)
    load_or_build("a", build)
    load_or_build("b", build)
    assert build.calls == 2
    assert len(list(folder.iterdir())) == 2


def test_tree_does_not_outlive_the_code_that_built_it(folder, tree, monkeypatch):
    build = Build(tree)
    load_or_build("a", build)
    monkeypatch.setattr(tree_build, "builder_identity", lambda: "another version")
    load_or_build("a", build)
    assert build.calls == 2


def damages(whole: bytes) -> dict[str, bytes]:
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 0x40
    return {
        "empty": b"",
        "truncated": whole[: len(whole) // 3],
        "without its end": whole[:-1],
        "one bit flipped": bytes(flipped),
        "foreign": b"\x89PNG\r\n\x1a\n" + bytes(5000),
        "zeros": bytes(len(whole)),
    }


@pytest.mark.parametrize("damage", sorted(damages(b"abc")))
def test_damaged_file_is_built_anew_and_replaced(folder, tree, damage):
    load_or_build("a", Build(tree))
    path = only_file(folder)
    whole = path.read_bytes()
    path.write_bytes(damages(whole)[damage])
    build = Build(tree)
    assert same(load_or_build("a", build), tree)
    assert build.calls == 1
    assert same(load_or_build("a", build), tree)
    assert build.calls == 1


def test_no_flipped_bit_gives_another_tree(folder, tree):
    load_or_build("a", Build(tree))
    path = only_file(folder)
    whole = path.read_bytes()
    random = np.random.default_rng(3)
    for place in random.integers(0, len(whole), 200):
        broken = bytearray(whole)
        broken[place] ^= 1 << int(random.integers(8))
        path.write_bytes(broken)
        assert same(load_or_build("a", Build(tree)), tree)


def wrong_trees(tree: Bvh) -> dict[str, dict[str, np.ndarray]]:
    whole = {name: getattr(tree, name) for name in trees.ARRAYS}

    def changed(name, place, value):
        array = whole[name].copy()
        array[place] = value
        return whole | {name: array}

    empty = tuple(np.argwhere(tree.children == EMPTY)[0])
    boxed = changed("bounds", (empty[0], slice(None), empty[1]), [0, 0, 0, 1, 1, 1])
    short = np.flatnonzero((tree.blocks < 0).any(axis=1))[0]
    gapped = changed("blocks", short, tree.blocks[short][::-1])
    # Two nodes that are each other's child, which no ray comes to.
    width = tree.children.shape[1]
    pair = np.full((2, width), EMPTY, np.int32)
    pair[:, 0] = len(tree.children) + 1, len(tree.children)
    boxes = np.repeat(np.repeat([[[np.inf]] * 3 + [[-np.inf]] * 3], 2, axis=0), width, axis=2).astype(np.float32)
    boxes[:, :, 0] = [0, 0, 0, 1, 1, 1]
    apart = whole | {
        "children": np.concatenate([tree.children, pair]), "bounds": np.concatenate([tree.bounds, boxes])
    }  # fmt: skip
    return {
        "circle": changed("children", (0, 0), 0),
        "node out of range": changed("children", (0, 0), len(tree.children)),
        "block out of range": changed("children", (-1, 0), ~len(tree.blocks)),
        "primitive out of range": changed("blocks", (0, 0), 300),
        "primitive twice": changed("blocks", (0, 0), tree.blocks[0, 1]),
        "reversed box": changed("bounds", (0, slice(None), 0), np.roll(tree.bounds[0, :, 0], 3)),
        "box where there is no child": boxed,
        "primitive behind a place without one": gapped,
        "nodes apart from the root": apart,
        "not a number": changed("bounds", (0, 0, 0), np.nan),
        "other type": whole | {"bounds": tree.bounds.astype(np.float64)},
        "other shape": whole | {"bounds": tree.bounds[:-1]},
    }


@pytest.mark.parametrize("wrong", range(12))
def test_unsound_tree_in_a_whole_file_is_not_believed(folder, tree, wrong):
    load_or_build("a", Build(tree))
    arrays = list(wrong_trees(tree).values())[wrong]
    disk = replace(trees._DISK, pack=lambda _: (arrays, {}))
    disk.add((tree_build.builder_identity(), "a"), tree)
    assert only_file(folder)
    build = Build(tree)
    assert same(load_or_build("a", build), tree)
    assert build.calls == 1


def test_tree_over_something_else_is_not_taken(folder, tree):
    load_or_build("a", Build(tree))
    build = Build(tree)
    assert same(load_or_build("a", build, lambda kept: kept.blocks.size < 0), tree)
    assert build.calls == 1


def test_changed_numbers_give_a_sound_tree_or_none(tree):
    """What may be traversed has boxes, and every child, block and primitive is there once."""
    sound = 0
    for changes in range(150):
        random = np.random.default_rng(changes)
        arrays = {name: getattr(tree, name).copy() for name in trees.ARRAYS}
        for _ in range(random.integers(1, 4)):
            array = arrays[str(random.choice(trees.ARRAYS))]
            place = tuple(int(random.integers(size)) for size in array.shape)
            array[place] = random.choice([0, -1, 1, 2, 299, 300, len(tree.children), EMPTY, -(2**31)])
        changed = Bvh(**arrays)
        if is_sound(changed):
            sound += 1
            used = changed.children != EMPTY
            assert (changed.bounds[:, :3] <= changed.bounds[:, 3:]).transpose(0, 2, 1)[used].all(), changes
            assert set(changed.blocks[changed.blocks >= 0].tolist()) == set(range(300)), changes
            assert quality(changed).depth < 100, changes
    assert 0 < sound < 150


def write_many(folder: str, tree: Bvh) -> None:
    os.environ[CACHE_VARIABLE] = folder
    for _ in range(30):
        assert same(load_or_build("a", lambda: tree), tree)
        for path in (Path(folder) / "trees").glob("*"):
            path.unlink(missing_ok=True)


@pytest.mark.slow
def test_writers_at_the_same_time_leave_a_whole_tree(folder, tree):
    context = multiprocessing.get_context("spawn")
    writers = [context.Process(target=write_many, args=(str(folder.parent), tree)) for _ in range(2)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert [writer.exitcode for writer in writers] == [0, 0]
    assert same(load_or_build("a", Build(tree)), tree)
    assert only_file(folder).stat().st_size > tree.nbytes


def test_tree_unused_longest_goes_first(folder, tree, monkeypatch):
    limit(monkeypatch, int(2.5 * tree.nbytes))
    kept = {}
    for key in "ab":
        before = set(folder.glob("*")) if folder.exists() else set()
        load_or_build(key, Build(tree))
        (kept[key],) = set(folder.iterdir()) - before
    old = time.time() - 1000
    os.utime(kept["a"], (old, old))
    os.utime(kept["b"], (old + 100, old + 100))
    load_or_build("a", Build(tree))  # used: now b is the older one
    load_or_build("c", Build(tree))
    assert kept["a"].exists()
    assert not kept["b"].exists()
    assert len(list(folder.iterdir())) == 2


def test_tree_beyond_the_limit_is_not_kept(folder, tree, monkeypatch):
    limit(monkeypatch, tree.nbytes - 1)
    load_or_build("a", Build(tree))
    assert not list(folder.glob("*"))


def test_what_a_killed_run_left_is_removed_after_a_while(folder, tree):
    folder.mkdir()
    fresh, old = folder / ".x-1.tmp", folder / ".x-2.tmp"
    fresh.touch()
    old.touch()
    os.utime(old, (0, 0))
    for key in range(512):  # one in sixteen looks, by a hash that the code has part in: 64 did not do, once
        load_or_build(str(key), Build(tree))
    assert fresh.exists()
    assert not old.exists()


def test_folder_that_cannot_be_made_means_no_cache(tmp_path, tree, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "file"))
    build = Build(tree)
    for _ in range(2):
        assert same(load_or_build("a", build), tree)
    assert build.calls == 2


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_full_disk_means_no_cache_and_no_leftovers(folder, tree, monkeypatch):
    def full(path, mode="r", buffering=-1, **words):
        if path.suffix != ".tmp":
            return plain(path, mode, buffering, **words)
        path.touch()
        return plain(Path("/dev/full"), "wb", buffering=0)

    plain = Path.open
    monkeypatch.setattr(Path, "open", full)
    assert same(load_or_build("a", Build(tree)), tree)
    assert not list(folder.iterdir())


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="these systems have folders of their own")
def test_folder_follows_the_environment(monkeypatch, tmp_path):
    monkeypatch.delenv(CACHE_VARIABLE, raising=False)
    monkeypatch.setenv("HOME", "/home/somebody")
    monkeypatch.setenv("XDG_CACHE_HOME", "/var/caches")
    assert trees.cache_folder() == Path("/var/caches/rptcam_cl/trees")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert trees.cache_folder() == Path("/home/somebody/.cache/rptcam_cl/trees")
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    assert trees.cache_folder() == tmp_path / "trees"
