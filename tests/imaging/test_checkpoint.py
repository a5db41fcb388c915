"""Checkpoint files: what is written comes back, and anything else is refused."""

import pickle
import struct

import numpy as np
import pytest

from rptcam_cl.errors import StateError
from rptcam_cl.imaging.checkpoint import MAGIC, VERSION, read_checkpoint, write_checkpoint

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


def test_later_version_is_named(path):
    path.write_bytes(struct.pack("<8sII", MAGIC, VERSION + 1, 2) + path.read_bytes()[16:])
    with pytest.raises(StateError, match=f"by a later version .its format is {VERSION + 1}; this one reads {VERSION}"):
        read_checkpoint(path)


def test_header_that_promises_a_terabyte_costs_nothing(path):
    header = b'{"arrays": [{"name": "film", "shape": [1000000000000], "type": "<f4"}], "facts": {}}'
    path.write_bytes(struct.pack("<8sII", MAGIC, VERSION, len(header)) + header + bytes(64))
    with pytest.raises(StateError, match="damaged"):
        read_checkpoint(path)


@pytest.mark.parametrize(
    "header", [b"{}", b"[]", b"\xff", b'{"arrays": [{"name": "a", "shape": [-1], "type": "<f4"}], "facts": {}}',
               b'{"arrays": [{"name": "a", "shape": [1], "type": "|O"}], "facts": {}}', b'{"arrays": 3}']
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
