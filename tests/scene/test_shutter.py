"""How long the shutter is open: numbers, and fractions as cameras have them."""

import pytest

from rptcam_cl.core.errors import InputError

from .conftest import SMALL, Load


@pytest.mark.parametrize(
    ("text", "seconds"), [("0.02", 0.02), ("1/125", 1 / 125), ('"1 / 8000"', 1 / 8000), ("2.5/10", 0.25), ("30", 30.0)]
)
def test_time_is_a_number_or_a_fraction(load: Load, text: str, seconds: float) -> None:
    assert load(f"{SMALL}shutter: {{time_s: {text}}}\n").shutter.time_s == seconds
    assert load(SMALL, f"shutter.time_s={text}").shutter.time_s == seconds


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1/0", "time_s: divides by zero (got '1/0'"),
        ("0", "time_s: is out of range (got 0; allowed: at least 1e-09)"),
        ("-1/60", "time_s: is neither a number nor a fraction"),
        ("1/60 s", "time_s: is neither a number nor a fraction"),
        ("true", "time_s: must be a number"),
        ("1/99999999999", "time_s: is neither a number nor a fraction"),
    ],
)
def test_other_times_are_refused(load: Load, text: str, message: str) -> None:
    with pytest.raises(InputError, match=r"scene\.yaml:\d+:\d+: shutter\.") as caught:
        load(f"{SMALL}shutter: {{time_s: {text}}}\n")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
