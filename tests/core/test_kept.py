"""Things kept on disk between runs: whole or not there, and gone when what they follow from has changed."""

import os
import time

import numpy as np
import pytest

from rptcam_cl.core import remember as kept
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.core.remember import (
    Disk,
    Memory,
    OneMaker,
    code_digest,
    content_name,
    identity_of_code,
    made_by,
    remember,
)

ARRAYS = {"table": np.arange(6, dtype=np.float32).reshape(2, 3), "order": np.array([2, 0, 1], np.int32)}
FACTS = {"tier": "tight", "shift": 0.1, "far": float("inf")}


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    return tmp_path


THINGS = Disk("things", pack=lambda value: value, unpack=lambda *value: value)  # arrays and facts
TEXTS = Disk("things")


def test_arrays_come_back_with_the_same_bits():
    THINGS.add("name", (ARRAYS, FACTS))
    arrays, facts = THINGS.find("name")
    assert facts == FACTS
    for key, array in ARRAYS.items():
        assert arrays[key].dtype == array.dtype
        np.testing.assert_array_equal(arrays[key], array)


def test_what_is_not_there_or_damaged_is_as_if_never_kept(folder):
    assert THINGS.find("name") is None
    THINGS.add("name", (ARRAYS, FACTS))
    [file] = (folder / "things").iterdir()
    whole = file.read_bytes()
    for damaged in (b"", whole[:-1], whole[:-1] + b"x", whole[:40]):
        file.write_bytes(damaged)
        assert THINGS.find("name") is None


def test_folder_that_cannot_be_made_breaks_nothing(monkeypatch, folder):
    (folder / "file").touch()
    monkeypatch.setenv(CACHE_VARIABLE, str(folder / "file"))
    assert THINGS.find_or_make("name", lambda: (ARRAYS, FACTS)) == (ARRAYS, FACTS)
    assert THINGS.find("name") is None


@pytest.fixture
def plain_names(monkeypatch):
    """Files have the names of their keys."""
    monkeypatch.setattr(kept, "content_name", lambda code, key: key)


def test_least_recently_used_makes_room(monkeypatch, folder, plain_names):
    for age, name in enumerate(("a", "b", "c")):
        TEXTS.add(name, "x" * 1000)
        os.utime(folder / "things" / name, (1e9 + age, 1e9 + age))
    assert TEXTS.find("a") is not None  # and now it is the latest
    monkeypatch.setattr(kept, "MOST_BYTES", 2500)
    TEXTS.add("0", "x" * 1000)
    assert {path.name for path in (folder / "things").iterdir()} == {"a", "0"}


def test_large_things_make_room_whatever_their_name_and_small_ones_by_one_in_sixteen(monkeypatch, folder, plain_names):
    monkeypatch.setattr(kept, "MOST_BYTES", 40_000)
    for name in ("a", "b"):
        TEXTS.add(name, "")
        os.utime(folder / "things" / name, (1e9, 1e9))
    TEXTS.add("c", "x" * 39_860)
    assert {path.name for path in (folder / "things").iterdir()} == {"c"}
    TEXTS.add("d", "x" * 70)
    assert {path.name for path in (folder / "things").iterdir()} == {"c", "d"}
    assert sum(path.stat().st_size for path in (folder / "things").iterdir()) > 40_000
    TEXTS.add("e", "x" * 50_000)  # larger than all may be
    assert TEXTS.find("e") is None


def test_memory_holds_what_was_used_last_and_no_more_bytes_than_it_may():
    memory = Memory(most=2)
    for key in "aba":
        memory.find_or_make(key, lambda: np.zeros(2))
    memory.add("c", None)
    assert [key in memory for key in "abc"] == [True, False, True]
    assert memory.find_or_make("c", lambda: "made anew") is None
    narrow = Memory(most_bytes=40)
    for key, count in (("a", 2), ("b", 2), ("c", 3), ("d", 6)):
        narrow.add(key, np.zeros(count))
    assert [key in narrow for key in "abcd"] == [False, True, True, False]


def test_function_remembers_by_content_and_between_runs(folder):
    calls = []

    def measured(values, unit="mm"):
        calls.append(unit)
        return [float(value) for value in values]

    def fresh():
        return remember(most=2, by=lambda values, unit="mm": (tuple(values), unit), disk=Disk("sums"))(measured)

    first = fresh()
    assert first([1, 2]) == first([1, 2]) == [1.0, 2.0] and calls == ["mm"]
    assert first([1, 2], unit="m") == [1.0, 2.0] and calls == ["mm", "m"]
    assert fresh()([1, 2]) == [1.0, 2.0] and calls == ["mm", "m"]  # as another run finds it
    for file in (folder / "sums").iterdir():
        file.write_bytes(b"damaged")
    assert fresh()([1, 2]) == [1.0, 2.0] and calls == ["mm", "m", "mm"]


def test_names_differ_where_parts_do():
    assert content_name(1, 2) == content_name(1, 2)
    assert (
        len({content_name(1, 2), content_name(12), content_name("1", 2), content_name((1, 2)), content_name(1.0, 2)})
        == 5
    )


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
