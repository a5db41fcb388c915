"""Things kept on disk between runs: whole or not there, and gone when what they follow from has changed."""

import os
import time

import numpy as np
import pytest

from rptcam_cl.core import files as kept
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.files import (
    CACHE_VARIABLE,
    OneMaker,
    code_digest,
    identity_of_code,
    keep_arrays,
    keep_bytes,
    kept_arrays,
    kept_bytes,
    made_by,
    name_of,
)

ARRAYS = {"table": np.arange(6, dtype=np.float32).reshape(2, 3), "order": np.array([2, 0, 1], np.int32)}
FACTS = {"tier": "tight", "shift": 0.1, "far": float("inf")}


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    return tmp_path


def test_arrays_come_back_with_the_same_bits():
    keep_arrays("things", "name", ARRAYS, FACTS)
    arrays, facts = kept_arrays("things", "name")
    assert facts == FACTS
    for key, array in ARRAYS.items():
        assert arrays[key].dtype == array.dtype
        np.testing.assert_array_equal(arrays[key], array)


def test_what_is_not_there_or_damaged_is_as_if_never_kept(folder):
    assert kept_arrays("things", "name") is None
    keep_arrays("things", "name", ARRAYS, FACTS)
    whole = (folder / "things" / "name").read_bytes()
    for damaged in (b"", whole[:-1], whole[:-1] + b"x", whole[:40]):
        (folder / "things" / "name").write_bytes(damaged)
        assert kept_arrays("things", "name") is None


def test_folder_that_cannot_be_made_breaks_nothing(monkeypatch, folder):
    (folder / "file").touch()
    monkeypatch.setenv(CACHE_VARIABLE, str(folder / "file"))
    keep_arrays("things", "name", ARRAYS, FACTS)
    assert kept_arrays("things", "name") is None


def test_least_recently_used_makes_room(monkeypatch, folder):
    for age, name in enumerate(("a", "b", "c")):
        keep_bytes("things", name, bytes(100))
        os.utime(folder / "things" / name, (1e9 + age, 1e9 + age))
    assert kept_bytes("things", "a") is not None  # and now it is the latest
    monkeypatch.setattr(kept, "MOST_BYTES", 250)
    keep_bytes("things", "0", bytes(100))
    assert {path.name for path in (folder / "things").iterdir()} == {"a", "0"}


def test_large_things_make_room_whatever_their_name_and_small_ones_by_one_in_sixteen(monkeypatch, folder):
    monkeypatch.setattr(kept, "MOST_BYTES", 2560)
    for name in ("a", "b"):
        keep_bytes("things", name, bytes(10))
        os.utime(folder / "things" / name, (1e9, 1e9))
    keep_bytes("things", "c", bytes(2560))
    assert {path.name for path in (folder / "things").iterdir()} == {"c"}
    monkeypatch.setattr(kept, "MOST_BYTES", 1)
    keep_bytes("things", "d", b"")
    assert (folder / "things" / "c").exists()


def test_names_differ_where_parts_do():
    assert name_of(1, 2) == name_of(1, 2)
    assert len({name_of(1, 2), name_of(12), name_of("1", 2), name_of((1, 2)), name_of(1.0, 2)}) == 5


def test_identity_of_code_follows_its_files(monkeypatch, tmp_path):
    file = tmp_path / "room" / "module.py"
    file.parent.mkdir()
    file.write_text("1")
    monkeypatch.setattr(kept, "package_dir", lambda: tmp_path)
    found = []
    for text in ("1", "23"):
        file.write_text(text)
        identity_of_code.cache_clear()
        found.append(identity_of_code(("room",)))
    identity_of_code.cache_clear()
    assert found[0] != found[1]


def test_digest_of_the_code_follows_what_its_files_hold_wherever_they_lie(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))

    monkeypatch.setattr(kept, "STARTED", time.time() + 60)

    def digest(place, **files):
        for name, text in {"module.py": "a\nb\n", "kernels/lens.h": "x", "table.csv": "1,2", **files}.items():
            path = tmp_path / place / name.replace("__", "/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(text.encode())
        monkeypatch.setattr(kept, "package_dir", lambda: tmp_path / place)
        monkeypatch.setattr(kept, "kernels_dir", lambda: tmp_path / place / "kernels")
        code_digest.cache_clear()
        return code_digest()

    first = digest("one")
    assert digest("two") == first == digest("three", **{"module.py": "a\r\nb\r\n", "notes.txt": "nothing"})
    assert first == digest("three", **{"__pycache__/module.py": "none of it", "_data/x.py": "nor that"})
    others = [
        digest(str(number), **files)
        for number, files in enumerate(
            ({"module.py": "a\nc\n"}, {"kernels/lens.h": "y"}, {"table.csv": "1,3"}, {"more.py": ""})
        )
    ]
    assert len({first, *others}) == 5
    assert digest("one", **{"kernels/lens.h": "z"}) not in (first, *others)  # the same size, in the same place
    ran = []
    for began in (time.time() - 60, time.time() - 50):  # before these files were written: other code may be running
        monkeypatch.setattr(kept, "STARTED", began)
        ran.append(digest("two"))
    assert len({first, *ran}) == 3
    code_digest.cache_clear()


def test_other_makers_are_refused_with_what_differs_or_named():
    one = made_by(["driver 1"])
    same = OneMaker()
    for name in ("a", "b"):
        same.add(name, [one])
    for key, message in (
        ("code", "its code is other, and that of a "),
        ("numpy", "its numpy is"),
        ("driver", "its driver"),
    ):
        with pytest.raises(StateError, match=rf"^c: {message}.*--allow-mixed"):
            same.add("c", [one | {key: "other"}])
    for unknown in (None, [], {}, "x", [one | {"code": 1}], [{"code": "a"}]):
        with pytest.raises(StateError, match=r"^c: says nothing of the code that made it, unlike a "):
            same.add("c", unknown)
    assert same.makers == [one]
    mixed = OneMaker(allow_mixed=True)
    mixed.add("a", one)
    with pytest.warns(UserWarning, match="its code is other"):
        mixed.add("b", one | {"code": "other"})
    assert mixed.makers == [one, one | {"code": "other"}]
    lost = OneMaker()
    lost.add("a", None)
    with pytest.raises(StateError, match="says nothing"):
        lost.add("b", None)
