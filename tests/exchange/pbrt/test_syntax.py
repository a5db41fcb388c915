"""Reading pbrt files: what is allowed, and one clear error for what is not."""

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.conversion import Report, one_line, read_limited
from rptcam_cl.exchange.pbrt.source import Statement, read_statements
from rptcam_cl.exchange.pbrt.world import Instance, ShapeUse, read_world
from tests.exchange.pbrt.conftest import HEAD
from tests.support.counting import calls

Reader = Callable[..., list[Statement]]


@pytest.fixture
def read(tmp_path: Path) -> Reader:
    def run(text: str | bytes, **files: str | bytes) -> list[Statement]:
        for name, content in {"a.pbrt": text, **{k.replace("_", "."): v for k, v in files.items()}}.items():
            (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        return list(read_statements(tmp_path / "a.pbrt"))

    return run


def only(statements: list[Statement]) -> Any:
    (statement,) = statements
    return statement.with_parameters()


def test_values_stand_in_brackets_or_alone(read: Reader) -> None:
    text = 'Camera "perspective" "float fov" 45 "float lensradius" [ 1e-2 ] "string x" "a b" "string y" ["c" "d"]'
    given = only(read(text))
    assert given.number("fov", 0) == 45
    assert given.number("lensradius", 0) == 0.01
    assert given.text("x", "") == "a b"
    assert given.get("y", "string").values == ("c", "d")


def test_truth_is_a_word_or_text(read: Reader) -> None:
    given = only(read('Shape "sphere" "bool a" true "bool b" [ false ] "bool c" "true" "bool d" ["false"]'))
    assert [given.boolean(name, default) for name, default in zip("abcd", (False, True, False, True), strict=True)] == [
        True, False, True, False,
    ]  # fmt: skip


def test_comments_stand_anywhere(read: Reader) -> None:
    text = '# head "\nTranslate 1 # one ]\n 2 3\nShape "trianglemesh" "point3 P" [ 0 0 0 # first [ "\n 1 1 1 ]\n#'
    translate, shape = read(text)
    assert translate.numbers.tolist() == [1, 2, 3]
    assert shape.with_parameters().rows("P", 3, "point3").tolist() == [[0, 0, 0], [1, 1, 1]]


def test_escapes_of_strings(read: Reader) -> None:
    (statement,) = read(r'Include "say \"hi\"\\ \t"'.replace("Include", "NamedMaterial"))
    assert statement.texts == ('say "hi"\\ \t',)


def test_numbers_of_every_form(read: Reader) -> None:
    given = only(read('Shape "x" "float a" [1 -1. +.5 1e3 1E-3 -.5e+2]'))
    assert given.numbers("a").tolist() == [1, -1, 0.5, 1000, 0.001, -50]


def test_names_of_files_start_at_the_scene_file(read: Reader, tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "b.pbrt").write_text('Identity Include "sub/c.pbrt" WorldEnd')
    (tmp_path / "sub" / "c.pbrt").write_text("ReverseOrientation")
    found = read('WorldBegin Include "sub/b.pbrt" ObjectEnd')
    assert [statement.directive for statement in found] == [
        "WorldBegin", "Identity", "ReverseOrientation", "WorldEnd", "ObjectEnd",
    ]  # fmt: skip


def test_an_imported_file_keeps_its_state_to_itself(read: Reader) -> None:
    found = read('Import "b.pbrt" Identity', b_pbrt="Translate 1 0 0")
    assert [item.directive for item in found] == ["AttributeBegin", "Translate", "AttributeEnd", "Identity"]


def test_packed_files_are_read(read: Reader) -> None:
    found = read('Include "b.pbrt.gz"', b_pbrt_gz=gzip.compress(b"Identity"))
    assert [item.directive for item in found] == ["Identity"]


BAD = {
    'Shape "sphere': 'a.pbrt:1:7: this " has no partner on its line',
    'Shape "sphere" "float radius" [1': "a.pbrt:1:31: this [ is never closed",
    'Shape "sphere" "float radius" ["1" 2]': "mixes text with other values",
    'Shape "sphere" "float radius"': "has no value: the file ends here",
    'Shape "sphere" "float radius" Shape "x"': "has no value; Shape follows",
    'Shape "sphere" "float radius" [nan]': "expected a number (got nan)",
    'Shape "sphere" "float radius" 1_0': "expected a number (got 1_0)",
    'Shape "sphere" "float radius" 1e999': "beyond the range of numbers",
    'Shape "sphere" "float" 1': 'expected a parameter such as "float fov"',
    'Shape "sphere" "double r" 1': "unknown type double of parameter r (allowed: float",
    'Shape "sphere" "string r" 1': "must hold text in quotes",
    'Shape "sphere" "point3 P" [1 2]': "holds 2 numbers, not a multiple of 3",
    'Shape "sphere" "float r" [1 [2]]': "a second [",
    "Shape sphere": "needs 1 text in quotes (got sphere)",
    "\n\n  Shap": "a.pbrt:3:3: expected a directive (got Shap); did you mean Shape?",
    "12": "expected a directive (got 12)",
    "SearchPath": "a directive of pbrt-v1 or of LuxRender",
    "LookAt 1 2 3": "LookAt needs 9 numbers (got 3)",
    "Translate [1 2 3 4]": "Translate needs 3 numbers (got 4)",
    "Translate ] 1 2 3": "a.pbrt:1:11: Translate needs 3 numbers (got 0)",
    "Translate 1 [2 3]": "a.pbrt:1:13: Translate needs 3 numbers (got 1)",
    "Translate 1 2": "a.pbrt:1:1: Translate needs 3 numbers (got 2)",
    'Shape "sphere" "float r" [1e999]': "beyond the range of numbers",
    'Shape "sphere" "float r" [-inf]': "expected a number (got -inf)",
    'Shape "sphere" "float r" true': '"float r" must hold numbers or text, not true or false',
    'Shape "sphere" "float r" "1"': '"float r" must hold numbers, not text',
    'Shape "sphere" "bool b" [1]': '"bool b" must hold true or false',
    'Shape "sphere" "bool b" [true "false"]': 'a.pbrt:1:31: expected true or false (got "false")',
    'Shape "sphere" "bool b" [true no]': "a.pbrt:1:31: expected true or false (got no)",
    'Shape "sphere" "float r" ]': 'a.pbrt:1:26: expected the value of "float r" (got ])',
    'Shape "sphere" "string s" ["a]" "b"': "a.pbrt:1:27: this [ is never closed",
    'MediumInterface "a': "has no partner on its line",
    "MediumInterface 5": "MediumInterface needs 2 texts in quotes (got 5)",
    "NamedMaterial": "NamedMaterial needs 1 text in quotes (got the end of the file)",
    "ActiveTransform": "(got the end of the file)",
    "Quux": "expected a directive (got Quux) such as Shape or Camera",
    "ActiveTransform Sometimes": "StartTime, EndTime, All",
    r'NamedMaterial "a\wood"': r"unknown escape \w in a string",
    'Include "missing.pbrt"': "no such file",
    'Include "."': "is not a regular file",
    'Include "a.pbrt"': "a.pbrt includes itself",
    'Include "b.pbrt.gz"': "is not a whole gzip file",
    "\0": "contains a NUL byte",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_text_is_told_by_line_and_column(read: Reader, text: str) -> None:
    with pytest.raises(InputError) as problem:
        read(text, b_pbrt_gz=b"no gzip")
    assert BAD[text] in str(problem.value)
    assert "a.pbrt:" in str(problem.value)


FORGIVEN = {
    "AttributeEnd": "note: AttributeEnd without AttributeBegin",
    "AttributeBegin": "in.pbrt:1: note: AttributeBegin is never closed",
    "AttributeBegin TransformEnd": "note: TransformEnd closes the AttributeBegin of",
    "WorldBegin WorldBegin": "ignored: WorldBegin: stands inside the world",
    "WorldEnd": "ignored: WorldEnd: stands before WorldBegin",
    'WorldBegin Camera "perspective"': "ignored: Camera: stands inside the world",
    'WorldBegin WorldEnd Shape "sphere"': "ignored: Shape: stands after WorldEnd",
    'Shape "sphere"': "ignored: Shape: stands before WorldBegin",
    'LightSource "point"': "ignored: LightSource: stands before WorldBegin",
    'CoordSysTransform "x"': 'ignored: CoordSysTransform "x": no coordinate system has the name',
    'ObjectBegin "a" ObjectBegin "b"': 'ObjectBegin "b" inside "a", which ends here',
    'WorldBegin ObjectBegin "a" ObjectInstance "b"': "ignored: ObjectInstance: stands inside an object",
    'Texture "a" "vector" "constant"': 'no texture has the type "vector"',
    'MakeNamedMaterial "a"': 'matte, as it has no "string type"',
}


@pytest.mark.parametrize("text", FORGIVEN)
def test_what_pbrt_skips_with_a_warning_is_reported(tmp_path: Path, text: str) -> None:
    path = tmp_path / "in.pbrt"
    path.write_text(text)
    report = Report()
    read_world(path, report)
    assert any(FORGIVEN[text] in line for line in report)


def test_blocks_may_overlap_as_in_pbrt_v3(tmp_path: Path) -> None:
    path = tmp_path / "in.pbrt"
    path.write_text(
        'WorldBegin Material "mirror" AttributeBegin Translate 1 0 0 Material "glass" ObjectBegin "a" Translate 0 2 0\n'
        'Shape "sphere" AttributeEnd Shape "disk" ObjectEnd Shape "cone" ObjectInstance "a"'
    )
    scene = read_world(path, Report())
    assert [use.shape.kind for use in scene.objects["a"]] == ["sphere", "disk"]
    sphere, disk = scene.objects["a"]
    np.testing.assert_array_equal(sphere.shape.world_from_object[:3, 3], (1, 2, 0))
    np.testing.assert_array_equal(disk.shape.world_from_object[:3, 3], (1, 0, 0))  # of the beginning of the object
    cone, instance = scene.shapes
    assert isinstance(cone, ShapeUse)
    assert isinstance(instance, Instance)
    np.testing.assert_array_equal(cone.shape.world_from_object[:3, 3], 0)  # of the beginning of the attributes
    assert [getattr(use.material, "kind", None) for use in (disk, cone)] == ["glass", "mirror"]


STATE = {
    'ColorSpace "cmyk"': "unknown ColorSpace",
    'Attribute "tree" "float x" 1': "unknown target",
}


@pytest.mark.parametrize("text", STATE)
def test_bad_order_is_told(tmp_path: Path, text: str) -> None:
    path = tmp_path / "in.pbrt"
    path.write_text(text)
    with pytest.raises(InputError, match=r"in\.pbrt:1:") as problem:
        read_world(path, Report())
    assert STATE[text] in str(problem.value)


def test_a_million_nested_blocks_are_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "in.pbrt"
    path.write_text("AttributeBegin\n" * 1_000_000)

    def refuse() -> None:
        with pytest.raises(InputError, match=r"in.pbrt:10001:1: .*nested more than 10000 deep"):
            read_world(path, Report())

    assert calls(refuse) < 500_000  # most of the million are never looked at


def test_files_that_include_each_other_without_end_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rptcam_cl.exchange.pbrt.source.MOST_FILES", 500)
    for number in range(20):  # no circle, but two to the power of twenty files
        (tmp_path / f"{number}.pbrt").write_text(f'Include "{number + 1}.pbrt"\n' * 2)
    (tmp_path / "20.pbrt").write_text("")
    with pytest.raises(InputError, match="more than 500 files are included"):
        read_world(tmp_path / "0.pbrt", Report())


def test_long_lists_are_read_fast(tmp_path: Path) -> None:
    path = tmp_path / "in.pbrt"
    numbers = np.arange(600_000) % 1000 / 8
    text = " ".join(map(str, numbers.tolist()))
    path.write_text(f'Shape "trianglemesh" "point3 P" [ {text} ]')
    found: list[Statement] = []
    assert calls(lambda: found.extend(read_statements(path))) < 10_000  # not one by one
    (statement,) = found
    np.testing.assert_array_equal(statement.with_parameters().numbers("P", "point3"), numbers)


def test_errors_are_one_line_whatever_is_named(read: Reader) -> None:
    for name in ("a\\nb", "x" * 100_000, "\x1b[31m", "\x85"):
        with pytest.raises(InputError) as problem:
            read(f'Include "{name}.pbrt"')
        text = str(problem.value)
        assert text.isprintable()
        assert len(text) < 1200


def test_places_count_characters_not_bytes(read: Reader) -> None:
    with pytest.raises(InputError, match=r"a\.pbrt:2:26: expected a directive"):
        read('# été\nCoordinateSystem "öäü é" Shap')


def test_an_old_text_file_in_latin_1_is_read(read: Reader) -> None:
    assert [item.directive for item in read(b"# \xe9t\xe9\nIdentity")] == ["Identity"]


def test_the_head_of_the_tests_is_read(tmp_path: Path) -> None:
    path = tmp_path / "in.pbrt"
    path.write_text(HEAD)
    assert set(read_world(path, Report()).options) == {"Camera", "Film"}


def test_numbers_of_directives_stand_with_brackets_or_without(read: Reader) -> None:
    found = read("Translate 1 2 3 Translate [4 5 6] Translate [7 8 # nine follows\n 9] Identity")
    assert [item.numbers.tolist() for item in found] == [[1, 2, 3], [4, 5, 6], [7, 8, 9], []]


def test_a_medium_interface_has_one_name_or_two(read: Reader) -> None:
    found = read('MediumInterface "in" "out" MediumInterface "in" Identity')
    assert [item.texts for item in found] == [("in", "out"), ("in",), ()]


def test_text_in_utf_16_and_files_beyond_their_limit_are_refused(read: Reader, tmp_path: Path) -> None:
    for code in ("utf-16-le", "utf-16-be"):
        with pytest.raises(InputError, match=r"a\.pbrt:1:1: is UTF-16 text; save it as UTF-8"):
            read("\ufeffIdentity".encode(code))
    assert [item.directive for item in read("\ufeffIdentity")] == ["Identity"]
    (tmp_path / "b.gz").write_bytes(gzip.compress(b"x" * 5000))
    (tmp_path / "b").write_bytes(b"x" * 5000)
    for name in ("b", "b.gz"):
        assert read_limited(tmp_path / name, name, 5000) == b"x" * 5000
        with pytest.raises(InputError, match=f"^{name}: holds more than 4999 bytes"):
            read_limited(tmp_path / name, name, 4999)


def test_lines_end_as_on_any_system(read: Reader) -> None:
    with pytest.raises(InputError, match=r"a\.pbrt:4:2: expected a directive"):
        read(b"Identity\r\nIdentity\rIdentity\n 1")


@pytest.mark.parametrize("length", [1000, 1001])
def test_messages_end_at_a_thousand_characters(length: int) -> None:
    assert one_line("x" * length) == "x" * 1000 + "\u2026" * (length > 1000)
