"""The strict YAML reader: numbers of YAML 1.2, refusals with their place, bounded work."""

import math
import time

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import dotted, read_yaml


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1.0e5", 1.0e5),
        ("1E3", 1000.0),
        ("-.5", -0.5),
        ("5.", 5.0),
        ("010", 10),
        ("0x10", 16),
        ("0o17", 15),
        ("+7", 7),
        ("2:8", "2:8"),
        ("on", "on"),
        ("yes", "yes"),
        ("2024-04-27", "2024-04-27"),
        ("1_000", "1_000"),
        ("true", True),
        ("~", None),
        ("null", None),
        (".inf", math.inf),
        ("-.INF", -math.inf),
        ("'1'", "1"),
        ('"true"', "true"),
    ],
)
def test_scalars_follow_the_core_schema_of_yaml_1_2(text, value):
    got = read_yaml(f"a: {text}").data["a"]
    assert got == value
    assert type(got) is type(value)


def test_nan_is_a_number():
    assert math.isnan(read_yaml("a: .nan").data["a"])


def test_every_value_and_key_keeps_its_place():
    document = read_yaml("film:\n  size: [36, 24]\nlens: {surfaces: [{radius: 5}]}\n", "x.yaml")
    assert document.mark(("film", "size", 1)) == (2, 14)
    assert document.key_mark(("film", "size")) == (2, 3)
    assert document.mark(("lens", "surfaces", 0, "radius")) == (3, 28)
    assert document.mark(("film", "missing")) == document.mark(("film",))
    assert document.where(("film", "size")) == "x.yaml:2:9"
    assert dotted(("lens", "surfaces", 0, "radius")) == "lens.surfaces[0].radius"


BAD = [
    ("", r"x:1:1: is empty"),
    ("# only a comment\n", r"x:1:1: is empty"),
    ("a:\n\tb: 1\n", r"x:2:1: a tab where only spaces may indent"),
    ("a: 1\n---\nb: 2\n", r"x:2:1: a second document"),
    (b"a: 1\nb: \xff\xfe\n", r"x:2:4: invalid UTF-8 at byte 8"),
    ("a: 1\0", r"x:1:5: contains a NUL byte"),
    ("a: 1".encode("utf-16"), r"x:1:1: is UTF-16 text; save it as UTF-8"),
    ("a: 1\nb: 2\na: 3\n", r"x:3:1: a: duplicate key \(first on line 1, again on line 3\)"),
    ("a: {b: {c: 1, c: 2}}", r"x:1:15: a.b.c: duplicate key"),
    ("a: !!python/object/apply:os.system ['true']", r"x:1:4: tags are not allowed"),
    ("a: &x [*x]", r"x:1:4: anchors are not allowed \(got &x\)"),
    ("a: *x", r"x:1:4: aliases are not allowed \(got \*x\)"),
    ("<<: {a: 1}", r"x:1:1: merge keys"),
    ("[" * 1000 + "]" * 1000, r"x:1:33: nested deeper than 32 levels"),
    ("a: [" + "1," * 60_000 + "]", r"more than 50000 values"),
    ("a: " + "1" * 5000, r"x:1:4: a number of 5000 digits"),
    ("a: 1e400", r"x:1:4: 1e400 is beyond the range"),
    ("? [1, 2]\n: 3", r"x:1:3: a key must be a word or a number"),
    ("a: [1, 2", r"x:\d+:\d+: not valid YAML"),
    ("a" * 4_000_001, r"x: has 4000001 bytes"),
]


@pytest.mark.parametrize(("text", "message"), BAD, ids=[m[:40] for _, m in BAD])
def test_what_is_not_strict_is_refused_with_its_place(text, message):
    start = time.process_time()
    with pytest.raises(InputError, match=message) as caught:
        read_yaml(text, "x")
    assert "\n" not in str(caught.value)
    assert time.process_time() - start < 20, "seconds; less than one is usual"


def test_a_laughing_bomb_is_refused_at_its_first_anchor():
    bomb = "a: &a [1,1,1,1,1,1,1,1,1]\n" + "\n".join(
        f"{chr(98 + i)}: &{chr(98 + i)} [{','.join(['*' + chr(97 + i)] * 9)}]" for i in range(9)
    )
    with pytest.raises(InputError, match=r"x:1:4: anchors"):
        read_yaml(bomb, "x")


def test_a_byte_order_mark_and_crlf_are_harmless():
    assert read_yaml(b"\xef\xbb\xbfa: 1\r\nb: [2,\r\n 3]\r\n").data == {"a": 1, "b": [2, 3]}


def test_a_file_is_read_and_named(tmp_path):
    path = tmp_path / "lens.yaml"
    path.write_text("a: {b: 1, b: 2}")
    with pytest.raises(InputError, match=r"lens\.yaml:1:11: a\.b: duplicate"):
        read_yaml(path)
    with pytest.raises(InputError, match="no such file"):
        read_yaml(tmp_path / "absent.yaml")
    with pytest.raises(InputError, match="not a regular file"):
        read_yaml(tmp_path)
