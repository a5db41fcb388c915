import io
from argparse import ArgumentTypeError
from types import SimpleNamespace
from typing import Any

import pytest

from rptcam_cl.api.options import duration
from rptcam_cl.cli import output as module
from rptcam_cl.cli.output import as_duration, describe, fraction_done, progress_on_stderr


def report(**changes: Any) -> Any:
    facts = {
        "samples_done": 16, "spp_target": 64, "seconds": 4.0, "msamples_per_second": 12.345, "blocked_share": 0.25,
        "stage": "render", "samples_at_start": 0, "tiles_done": None, "tiles_left": None,
    }  # fmt: skip
    return SimpleNamespace(**{**facts, **changes})


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_line_tells_samples_speed_time_left_and_blocked_share() -> None:
    assert describe(report()) == "16/64 spp, 4 spp/s, 12.3 Msamples/s, 12 s left, lens blocks 25 %"
    assert describe(report(blocked_share=None)).endswith("12 s left")
    assert describe(report(stage="compile")) == "compile ..."


def test_nearer_of_the_two_ends_counts() -> None:
    assert fraction_done(report(), None) == 0.25
    assert fraction_done(report(), 5.0) == 0.8
    assert fraction_done(report(spp_target=None), 8.0) == 0.5
    assert fraction_done(report(spp_target=None), None) is None
    assert fraction_done(report(seconds=9.0), 5.0) == 1.0


def test_resumed_render_counts_what_it_makes_itself() -> None:
    told = describe(report(samples_done=1010, samples_at_start=1000, spp_target=1100))
    assert told.startswith("1010/1100 spp, 2.5 spp/s, 12.3 Msamples/s, 36 s left")
    assert fraction_done(report(samples_done=64, samples_at_start=64), None) is None


def test_noise_target_tells_its_tiles_and_promises_no_time() -> None:
    told = describe(report(tiles_done=0.5))
    assert told == "50 % of the tiles done, 16/64 spp, 4 spp/s, 12.3 Msamples/s, lens blocks 25 %"
    assert fraction_done(report(tiles_done=0.5), None) == 0.5


def test_noise_target_has_a_time_and_a_reason_once_its_noise_is_known() -> None:
    left = SimpleNamespace(count=40, worst=0.041, target=0.02, seconds=12.0, few=False)
    shown = report(tiles_done=0.5, tiles_left=left)
    assert describe(shown).startswith("50 % of the tiles done, about 12 s left, 16/64 spp, ")
    assert fraction_done(shown, None) == 0.25
    left.few = True
    shown = describe(report(tiles_done=0.98, tiles_left=left))
    assert shown.startswith("98 % of the tiles done, about 12 s left, 40 have up to 4.1 % noise for 2 %, ")


def test_last_tiles_that_took_long_are_reported_at_the_end_with_the_reason(capsys: pytest.CaptureFixture[str]) -> None:
    def end_of(reports: list[Any]) -> str:
        with progress_on_stderr() as show:
            for item in reports:
                show(item)
        return capsys.readouterr().err

    left = SimpleNamespace(count=18, worst=0.126, target=0.05, seconds=20.0, few=True)
    reports = [
        report(seconds=10.0),  # before the noise is known
        report(seconds=40.0, tiles_done=0.97, tiles_left=left),
        report(seconds=75.0, tiles_done=0.981, tiles_left=left),
        report(seconds=95.0, tiles_done=0.99, tiles_left=left),
        report(seconds=100.0, tiles_done=1.0),
    ]
    assert end_of(reports).startswith(
        "the last 18 tiles took 25 % of the time: they had up to 13 % noise when all others met 5 %"
    )
    for shortened in (reports[:3], reports[:1], [report(seconds=9.0, tiles_done=0.99, tiles_left=left)]):
        assert end_of(shortened) == ""


def test_start_without_samples_divides_by_nothing() -> None:
    assert describe(report(samples_done=0, seconds=0.0), 10.0) == "0/64 spp, lens blocks 25 %"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.04, "0.0 s"), (9.94, "9.9 s"), (9.96, "10 s"), (59.4, "59 s"), (59.6, "1 min 00 s"), (3725, "1 h 02 min")],
)
def test_duration_is_short(seconds: float, text: str) -> None:
    assert as_duration(seconds) == text


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("60", 60),
        ("1.5m", 90),
        ("1m30s", 90),
        ("1h30m", 5400),
        ("1 h 02 min", 3720),
        ("1H 1min 1s", 3661),
        ("1e3s", 1000),
    ],
)
def test_time_is_read_as_people_write_it(text: str, seconds: float) -> None:
    assert duration(text) == seconds


@pytest.mark.parametrize("text", ["", "m", "1h30", "30s1m", "1m1m", "0m0s", "-1s", "nan", "1..5s"])
def test_time_that_says_nothing_or_two_things_is_refused(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="allowed a time above 0, as 60s"):
        duration(text)


def test_kept_text_gets_a_line_every_ten_seconds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    times = iter([0.0, 3.0, 10.0, 10.0, 15.0])
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: next(times)))
    with progress_on_stderr() as show:
        for done in (1, 2, 3):
            show(report(samples_done=done))
    assert [line.split()[0] for line in capsys.readouterr().err.splitlines()] == ["2/64"]


def test_terminal_gets_a_bar_that_goes_away(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    with progress_on_stderr() as show:
        show(report(stage="compile"))
        show(report())
    assert "16/64 spp" in terminal.getvalue()
    assert terminal.getvalue().endswith("\x1b[2K")  # the line is erased


def test_pipe_gets_nothing_of_a_short_render(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_on_stderr() as show:
        show(report())
    assert capsys.readouterr().err == ""
