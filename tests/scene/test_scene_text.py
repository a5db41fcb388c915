"""A scene's data as YAML text: it reads back as the same data, whatever its words look like."""

from hypothesis import given
from hypothesis import strategies as st

from rptcam_cl.core.files import plain
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.scene.load import scene_text

WORDS = [
    "1e-3", "0o17", "on", "2:8", "1_000", ".5e3", "0x1F", "null", "~", "12e03", "=", "<<", "a: b", "- a", "#1", "",
    " x", "true", ".inf", ".nan", "ä\u2028b", "'", '"', "1" * 60,
]  # fmt: skip
TEXT = st.text("aeFxo019.-+_:#'\"{}[], ~&*!|>%@ä", max_size=8) | st.sampled_from(WORDS)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(2**63), 2**63) | st.booleans() | st.none()
PARTS = st.sampled_from(["film", "camera", "materials", "objects", "lights", "sensor"])
VALUES = st.recursive(
    NUMBERS | TEXT, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3)
)


@given(st.dictionaries(PARTS, VALUES, min_size=1))
def test_text_reads_back_as_the_same_data(data: dict[str, object]) -> None:
    for name in ("objects", "lights"):
        if name in data:
            data[name] = [data[name]]
    if "materials" in data:
        data["materials"] = dict.fromkeys(WORDS[:4], data["materials"])
    read = read_yaml(scene_text(data)).data
    assert read == plain(data)


def test_objects_stand_on_a_line_each_below_the_comments() -> None:
    text = scene_text({"objects": [{"shape": "sphere"}, {"shape": "box"}], "film": {"width_mm": 36}}, ("one\ntwo",))
    assert text.splitlines() == [
        "# one", "# two", "film: {width_mm: 36}", "objects:", "  - {shape: sphere}", "  - {shape: box}",
    ]  # fmt: skip
