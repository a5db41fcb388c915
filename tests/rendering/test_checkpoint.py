"""Checkpoint files: what is written comes back, and anything else is refused."""

import contextlib
import hashlib
import pickle
import struct

import numpy as np
import pytest

from rptcam_cl.core.errors import StateError
from rptcam_cl.rendering.checkpoint import MAGIC, VERSION, check_facts, read_checkpoint, write_checkpoint
from rptcam_cl.rendering.progressive import check_fits

FACTS = {"done": 7, "scene": "ab", "crop": [0.5, 1.0]}
ARRAYS = {
    "film": np.linspace(-1, 1, 24, dtype=np.float32).reshape(6, 4),
    "counts": np.array([1 << 40, 2], np.uint64),
    "empty": np.zeros((0, 4), np.float32),
    "before": np.array([np.pi, np.inf, np.nan]),
}


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "a.rpck"
    write_checkpoint(path, FACTS, ARRAYS)
    return path


def test_facts_and_arrays_come_back(path):
    found = read_checkpoint(path)
    assert found.facts == FACTS
    assert found.arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(found.arrays[name], array)
        assert found.arrays[name].dtype == array.dtype


def test_every_flipped_bit_is_noticed(path):
    whole = path.read_bytes()
    rng = np.random.default_rng(4)
    for place in [*range(16), *rng.integers(16, len(whole), 64)]:
        spoilt = bytearray(whole)
        spoilt[place] ^= 1 << rng.integers(8)
        path.write_bytes(spoilt)
        with pytest.raises(StateError, match=r"a\.rpck"):
            read_checkpoint(path)


@pytest.mark.parametrize("keep", [0, 5, 16, 40, -1, -32])
def test_truncated_file_is_refused(path, keep):
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(StateError, match=r"damaged|is not a saved render"):
        read_checkpoint(path)


def test_longer_file_is_refused(path):
    path.write_bytes(path.read_bytes() + b"\0")
    with pytest.raises(StateError, match="damaged"):
        read_checkpoint(path)


@pytest.mark.parametrize(("version", "which"), [(VERSION - 1, "an earlier"), (VERSION + 1, "a later")])
def test_other_version_is_named(path, version, which):
    path.write_bytes(struct.pack("<8sII", MAGIC, version, 2) + path.read_bytes()[16:])
    with pytest.raises(StateError, match=f"by {which} version .its format is {version}; this one reads {VERSION}"):
        read_checkpoint(path)


def test_header_that_promises_a_terabyte_costs_nothing(path):
    header = b'{"arrays": [{"name": "film", "shape": [1000000000000], "type": "<f4"}], "facts": {}}'
    path.write_bytes(struct.pack("<8sII", MAGIC, VERSION, len(header)) + header + bytes(64))
    with pytest.raises(StateError, match="damaged"):
        read_checkpoint(path)


@pytest.mark.parametrize(
    "header", [b"{}", b"[]", b"\xff", b'{"arrays": [{"name": "a", "shape": [-1], "type": "<f4"}], "facts": {}}',
               b'{"arrays": [{"name": "a", "shape": [1], "type": "|O"}], "facts": {}}', b'{"arrays": 3}',
               b'{"facts": {}, "arrays": [' + b"[" * 60_000,
               b'{"arrays": [{"name": "a", "shape": [1e999], "type": "<f4"}], "facts": {}}']
)  # fmt: skip
def test_nonsense_in_the_header_is_refused(path, header):
    path.write_bytes(struct.pack("<8sII", MAGIC, VERSION, len(header)) + header + bytes(64))
    with pytest.raises(StateError, match="damaged"):
        read_checkpoint(path)


class Bomb:
    def __reduce__(self):
        return (pytest.fail, ("a pickle was executed",))


def test_pickle_is_not_executed(path):
    path.write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(StateError, match="is not a saved render"):
        read_checkpoint(path)


def test_file_that_cannot_be_read_or_written_is_named(tmp_path):
    with pytest.raises(StateError, match=r"none\.rpck: cannot be read"):
        read_checkpoint(tmp_path / "none.rpck")
    with pytest.raises(StateError, match="cannot be read"):
        read_checkpoint(tmp_path)
    with pytest.raises(StateError, match="cannot be written"):
        write_checkpoint(tmp_path / "missing" / "a.rpck", FACTS, ARRAYS)


def test_changed_header_is_refused_however_it_is_signed(path):
    """The digest guards against accidents only: whoever crafts a file signs it too."""
    whole = path.read_bytes()
    length = struct.unpack("<8sII", whole[:16])[2]
    random = np.random.default_rng(6)
    for _ in range(300):
        header = bytearray(whole[16 : 16 + length])
        for _ in range(random.integers(1, 4)):
            header[random.integers(length)] = random.choice(list(b'0123456789[]{}:,"ef-. \xff'))
        signed = struct.pack("<8sII", MAGIC, VERSION, length) + bytes(header) + whole[16 + length : -32]
        path.write_bytes(signed + hashlib.sha256(signed).digest())
        with contextlib.suppress(StateError):
            found = read_checkpoint(path)
            assert isinstance(found.facts, dict)


@pytest.mark.parametrize(
    ("name", "value"), [("done", None), ("done", -1), ("done", True), ("done", 2**40), ("devices", "a"),
                        ("devices", [1]), ("metered_cd_m2", "x"), ("metered_cd_m2", -1.0), ("focus", []), ("work", [1]),
                        ("focus", {"camera": {}}), ("focus", {"camera": 1, "metadata": {}}), ("work", [{}]),
                        ("work", [{"samples": [0], "split": "0:0=1"}]), ("work", [{"samples": [0, 1], "split": "x"}]),
                        ("work", [{"samples": [0, 1], "split": {}}])]
)  # fmt: skip
def test_facts_of_another_kind_are_refused(path, name, value):
    right = {"done": 1, "devices": ["a"], "metered_cd_m2": None, "focus": None}
    check_facts(path, right)
    with pytest.raises(StateError, match=f"damaged: {name}"):
        check_facts(path, right | {name: value})


def test_arrays_that_do_not_fit_are_refused():
    fresh = {"film": np.zeros((4, 8), np.float32), "noise_tiles": np.arange(2, dtype=np.uint32)}
    check_fits(fresh, fresh)
    check_fits(fresh | {"noise_tiles": np.array([1], np.uint32)}, fresh)
    for wrong in ({"film": np.zeros((4, 7), np.float32)}, {"film": np.zeros(32, np.float32)},
                  {"film": np.zeros((4, 8), np.uint32)}, {"noise_tiles": np.array([2], np.uint32)}):  # fmt: skip
        with pytest.raises(StateError, match="does not fit"):
            check_fits(fresh | wrong, fresh)
    with pytest.raises(StateError, match="does not fit"):
        check_fits({}, fresh)
