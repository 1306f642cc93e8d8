"""What is shown of a long task, on a terminal and in a file."""

import io
import time

import pytest

from ftbias_jax.runtime import progress
from ftbias_jax.runtime.progress import Progress, Stages


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    """A clock in seconds that advances only when a test sets it."""
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def shown(stream, clock, seconds, total=10):
    """What is shown if each of ``total`` steps takes ``seconds``."""
    report = Progress("filtering", total, stream)
    for done in range(1, total + 1):
        clock[0] += seconds
        report(done)
    return stream.getvalue()


@pytest.mark.parametrize("stream", [Terminal(), io.StringIO()], ids=["terminal", "file"])
def test_a_short_task_shows_nothing(stream, clock):
    assert shown(stream, clock, 0.1) == ""


def test_a_terminal_shows_one_line_that_moves_and_ends(clock):
    text = shown(Terminal(), clock, 1.0)
    assert text.count("\n") == 1
    assert text.endswith("\n")
    first, *_, last = text.removesuffix("\n").split("\r")[1:]
    assert first == f"[{'#' * 6:<30}] filtering:  20% after 2 s, 8 s left\x1b[K"
    assert last == f"[{'#' * 30}] filtering: 100% after 10 s\x1b[K"


def test_a_file_gets_a_plain_line_every_ten_seconds_and_the_last(clock):
    lines = shown(io.StringIO(), clock, 1.0, total=20).splitlines()
    assert lines == [
        "filtering:  10% after 2 s, 18 s left",
        "filtering:  60% after 12 s, 8 s left",
        "filtering: 100% after 20 s",
    ]


def test_it_writes_to_standard_error_and_survives_an_empty_task(clock, capsys):
    report = Progress("filtering", 0)
    clock[0] += 3
    report(0)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("filtering:   0% after 3 s")


@pytest.fixture
def fast(monkeypatch):
    """Shorten the silent interval to a hundredth."""
    monkeypatch.setattr(progress, "QUIET", 0.02)
    monkeypatch.setattr(progress, "OFTEN", 0.002)


def seen(stream, text):
    """Wait until a text is shown; fails after five seconds."""
    deadline = time.monotonic() + 5
    while text not in stream.getvalue():
        assert time.monotonic() < deadline, stream.getvalue()
        time.sleep(0.002)


def test_a_file_gets_a_plain_line_for_every_stage(fast):
    stream = io.StringIO()
    with Stages("diagnosing log.npz", stream) as stages:
        for stage in ("reading", "looking for cause 1 of at most 3"):
            stages(stage)
            seen(stream, stage)
    assert stream.getvalue() == (
        "diagnosing log.npz: reading, 0 s\ndiagnosing log.npz: looking for cause 1 of at most 3, 0 s\n"
    )


def test_the_stage_on_a_terminal_is_gone_at_the_end(fast):
    stream = Terminal()
    with Stages("diagnosing log.npz", stream) as stages:
        stages("reading")
        seen(stream, "\rdiagnosing log.npz: reading, 0 s\x1b[K")
    assert stream.getvalue().endswith("\r\x1b[K")
    assert "\n" not in stream.getvalue()


def test_stages_of_a_short_task_are_not_shown():
    stream = Terminal()
    with Stages("diagnosing log.npz", stream) as stages:
        stages("reading")
    assert stream.getvalue() == ""


def test_an_error_ends_the_stages(fast):
    stream = io.StringIO()

    def fail():
        with Stages("diagnosing log.npz", stream) as stages:
            stages("reading")
            seen(stream, "reading")
            raise ValueError("wrong")

    with pytest.raises(ValueError, match="wrong"):
        fail()
    before = stream.getvalue()
    time.sleep(0.02)
    assert stream.getvalue() == before
