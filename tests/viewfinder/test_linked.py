"""The linked dials by properties: what stays, what follows, that exposure is kept, and that steps lead back."""

import math
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rptcam_cl.viewfinder.panel import (
    EV_STEPS,
    F_NUMBERS,
    SPEEDS,
    TIMES,
    DialLimits,
    Mode,
    Scale,
    Settings,
    ev_text,
    exposure_of,
    f_number_of,
    linked,
)

WIDE = DialLimits((0.01, 1e4), (1e-12, 1e12), (1e-9, 1e12), (1e-9, 1e12), 1 / 50)
CAMERA = DialLimits((1.8, 22.0), (1 / 8000, 30.0), (100.0, 6400.0), (100.0, 6400.0), 1 / 50)
MODES = st.sampled_from(["M", "A", "S", "P"])
SETTINGS = st.builds(
    lambda n, t, s: Settings(F_NUMBERS.value(n), TIMES.value(t), SPEEDS.value(s)),
    st.integers(0, 27), st.integers(-39, 14), st.integers(-3, 30),
)  # fmt: skip


def ideal(f_number: float) -> float:
    return math.pi / (4 * f_number**2)


def fast(f_number: float) -> float:
    """Of a lens that loses light wide open, up to half of it."""
    return math.pi / (4 * f_number**2) * (f_number**2 + 0.5) / (f_number**2 + 1)


@given(SETTINGS, MODES, st.booleans(), st.sampled_from([ideal, fast]), st.integers(-15, 15))
def test_exposure_is_kept_whatever_a_dial_does(settings, mode, auto_iso, light, thirds) -> None:  # type: ignore[no-untyped-def]
    wanted = exposure_of(settings, light)
    moved = {
        "M": Settings(settings.f_number * 2 ** (thirds / 6), settings.time_s, settings.iso),
        "A": Settings(settings.f_number * 2 ** (thirds / 6), settings.time_s, settings.iso),
        "S": Settings(settings.f_number, settings.time_s * 2 ** (thirds / 3), settings.iso),
        "P": Settings(settings.f_number, settings.time_s, settings.iso * 2 ** (thirds / 3)),
    }[mode]
    found = linked(mode, auto_iso, moved, wanted, WIDE, light)
    if mode == "M" and not auto_iso:
        assert found.settings == moved
        assert found.clamped == ()
        return
    assert found.clamped == ()
    assert math.log2(exposure_of(found.settings, light) / wanted) == pytest.approx(0, abs=2e-5)


@given(SETTINGS, st.integers(-6, 6))
def test_a_third_on_one_dial_is_a_third_on_the_other(settings: Settings, thirds: int) -> None:
    wanted = exposure_of(settings, ideal)
    step = F_NUMBERS.nearest(settings.f_number)
    moved = Settings(F_NUMBERS.value(step + thirds), settings.time_s, settings.iso)
    found = linked("A", False, moved, wanted, WIDE, ideal).settings
    assert math.log2(found.time_s / settings.time_s) * 3 == pytest.approx(thirds, abs=1e-12)
    slower = Settings(settings.f_number, settings.time_s * 2 ** (thirds / 3), settings.iso)
    closed = linked("S", False, slower, wanted, WIDE, ideal).settings
    assert math.log2(closed.f_number / settings.f_number) * 6 == pytest.approx(thirds, abs=1e-4)


@given(SETTINGS, MODES, st.booleans(), st.integers(-9, 9))
def test_a_dial_turned_forth_and_back_is_where_it_was(settings, mode, auto_iso, thirds) -> None:  # type: ignore[no-untyped-def]
    wanted = exposure_of(settings, ideal)
    first = linked(mode, auto_iso, settings, wanted, WIDE, ideal).settings
    there = Settings(first.f_number * 2 ** (thirds / 6), first.time_s * 2 ** (thirds / 3), first.iso)
    kept = {"A": "f_number", "S": "time_s"}.get(mode)
    turned = Settings(*(getattr(there if kept == name else first, name) for name in ("f_number", "time_s", "iso")))
    away = linked(mode, auto_iso, turned, wanted, WIDE, ideal).settings
    back = Settings(*(getattr(first if kept == name else away, name) for name in ("f_number", "time_s", "iso")))
    again = linked(mode, auto_iso, back, wanted, WIDE, ideal).settings
    assert [again.f_number, again.time_s, again.iso] == pytest.approx(
        [first.f_number, first.time_s, first.iso], rel=2e-5
    )


@given(SETTINGS, MODES, st.booleans(), st.floats(-14, 14))
def test_limits_hold_and_say_what_is_missing(settings, mode, auto_iso, stops) -> None:  # type: ignore[no-untyped-def]
    wanted = exposure_of(settings, ideal) * 2.0**stops
    start = Settings(
        min(max(settings.f_number, 1.8), 22.0), min(max(settings.time_s, 1 / 8000), 30.0),
        min(max(settings.iso, 100.0), 6400.0),
    )  # fmt: skip
    found = linked(mode, auto_iso, start, wanted, CAMERA, ideal)
    for name in ("f_number", "time_s", "iso"):
        low, high = getattr(CAMERA, name)
        assert low <= getattr(found.settings, name) <= high
    assert math.log2(exposure_of(found.settings, ideal) / wanted) == pytest.approx(found.off_ev, abs=1e-9)
    if mode == "M" and not auto_iso:
        return
    if abs(found.off_ev) > 1e-3:
        assert found.clamped
        too_dark = found.off_ev < 0
        ends = {"f_number": (22.0, 1.8), "time_s": (1 / 8000, 30.0), "iso": (100.0, 6400.0)}  # darkest, brightest
        for name in found.clamped:
            assert getattr(found.settings, name) == ends[name][too_dark]
    else:
        assert found.clamped == ()


def test_automatic_iso_keeps_the_time_that_hands_hold_then_gives_way() -> None:
    start = Settings(2.8, 1 / 125, 100.0)
    at_hand = exposure_of(Settings(2.8, 1 / 50, 100.0), ideal)
    bright, dim, dark = (linked("A", True, start, at_hand * 2.0**k, CAMERA, ideal).settings for k in (-2, 3, 8))
    assert [bright.time_s, bright.iso] == pytest.approx([1 / 200, 100.0])
    assert [dim.time_s, dim.iso] == pytest.approx([1 / 50, 800.0])
    assert [dark.time_s, dark.iso] == pytest.approx([4 / 50, 6400.0])


def test_program_shares_what_is_more_than_hands_need() -> None:
    wide_open = exposure_of(Settings(1.8, 1 / 50, 100.0), ideal)
    found = linked("P", False, Settings(8.0, 1.0, 100.0), wide_open / 2**4, CAMERA, ideal).settings
    assert [found.f_number, found.time_s] == pytest.approx([3.6, 1 / 200], rel=1e-4)
    dim = linked("P", False, Settings(8.0, 1.0, 100.0), wide_open * 4, CAMERA, ideal).settings
    assert [dim.f_number, dim.time_s] == pytest.approx([1.8, 4 / 50])


def test_light_of_a_fast_lens_is_inverted() -> None:
    for f_number in (0.7, 1.0, 1.4, 5.6):
        assert f_number_of(fast(f_number), 22.0, (0.5, 32.0), fast) == pytest.approx(f_number, rel=1e-5)


@pytest.mark.parametrize("scale", [F_NUMBERS, TIMES, SPEEDS], ids=["f-numbers", "times", "ISO"])
def test_steps_are_exact_thirds_and_engravings_near_them(scale: Scale) -> None:
    for step in range(scale.first, scale.last + 1):
        number, value = scale.numbers[step - scale.first], scale.value(step)
        assert abs(math.log2(number / value)) * scale.per_stop < 0.17  # half a third; 1/13 s is the farthest
        assert scale.exact(number) == value
        assert scale.nearest(value) == step
        assert scale.text(value) == scale.text(number)
        if step < scale.last:
            assert math.log2(scale.value(step + 1) / value) * scale.per_stop == pytest.approx(1 / 3, abs=1e-12)


def test_scales_read_as_on_cameras() -> None:
    assert [F_NUMBERS.text(value) for value in (1.4, 2**2.5, 5.6, 8)] == ["f/1.4", "f/5.6", "f/5.6", "f/8"]
    assert [TIMES.text(value) for value in (1 / 125, 2**-7, 0.5, 1 / 3, 30)] == [
        "1/125",
        "1/125",
        "0.5 s",
        "0.3 s",
        "30 s",
    ]
    assert [SPEEDS.text(value) for value in (100, 1250, 25600)] == ["ISO 100", "ISO 1250", "ISO 25600"]
    assert F_NUMBERS.text(200.0) == "f/200"
    assert [ev_text(ev) for ev in (0, 1 / 3, -5 / 3, 2, 0.1)] == ["±0 EV", "+⅓ EV", "-1⅔ EV", "+2 EV", "+0.10 EV"]
    assert len(EV_STEPS) == 31
    assert F_NUMBERS.exact(5.7) == 5.7
    assert set(get_args(Mode)) == {"M", "A", "S", "P", "relative"}
