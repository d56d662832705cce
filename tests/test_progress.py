"""Progress on the error stream: shares, time estimates, terminals and pipes."""

from __future__ import annotations

import io

import pytest
from measured_materials.addon.progress import Progress, readable_time
from measured_materials.addon.stages import bake_stages, share_done
from measured_materials.bake.bake_brdf import BakeSettings, bake_source
from measured_materials.bake.sources.analytic import by_name


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_estimate_follows_the_stages() -> None:
    clock, stream = Clock(), io.StringIO()
    with Progress({"slow": 9.0, "fast": 1.0}, jobs=2, stream=stream, clock=clock) as progress:
        progress.start("first")
        progress("slow", 0.0)
        assert progress.seconds_left() is None
        clock.now += 9
        progress("fast", 0.0)
        # 9 s for 9 of 20 parts leave 11 s.
        assert progress.overall() == pytest.approx(0.45) and progress.seconds_left() == pytest.approx(11)
        clock.now += 1
        progress.start("second")
        progress("slow", 0.5)
        assert progress.overall() == pytest.approx(0.725)
        progress("unheard of", 0.5)
        assert progress.overall() == pytest.approx(0.5)
    assert stream.getvalue().splitlines()[1] == "1/2 first: fast, 45 %, 11 s left"
    assert "\r" not in stream.getvalue()


def test_plain_lines_are_few_but_come_regularly() -> None:
    clock, stream = Clock(), io.StringIO()
    progress = Progress({"work": 1.0}, stream=stream, clock=clock)
    progress.start("job")
    for step in range(100):
        clock.now += 0.5
        progress("work", step / 100)
    assert 4 <= len(stream.getvalue().splitlines()) <= 7  # 50 s, a line every 10 s


def test_a_terminal_sees_one_line_that_vanishes() -> None:
    clock, stream = Clock(), Terminal()
    with Progress({"work": 1.0}, stream=stream, clock=clock) as progress:
        progress.start("x" * 500)
        for step in range(10):
            clock.now += 1
            progress("work", step / 10)
    text = stream.getvalue()
    assert "\n" not in text and text.endswith("\r\x1b[K") and "#" in text
    assert all(len(line) < 500 for line in text.split("\r"))


def test_a_broken_or_narrow_stream_is_no_error() -> None:
    closed = io.StringIO()
    closed.close()
    ascii_only = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    for stream in (closed, ascii_only):
        progress = Progress({"work": 1.0}, stream=stream)
        progress.start("Blattgr\u00fcn")
        progress("work", 0.5)
        progress.close()
    ascii_only.seek(0)
    assert "Blattgr\\xfcn" in ascii_only.read()


@pytest.mark.parametrize("seconds, words", [(0, "1 s"), (59.1, "1 min 0 s"), (130, "2 min 10 s"), (3900, "1 h 5 min")])
def test_readable_time(seconds: float, words: str) -> None:
    assert readable_time(seconds) == words


@pytest.mark.parametrize("filter", ["trilinear", "bspline"])
def test_stages_of_a_bake_are_known_and_never_go_back(filter: str, tmp_path) -> None:
    settings = BakeSettings(resolution=8, filter=filter)
    stages, shares = bake_stages(settings), []

    def note(stage: str, share: float) -> None:
        assert stage in stages
        shares.append(share_done(stages, stage, share))

    bake_source(by_name("lambert"), tmp_path / "x.mmat", settings, note)
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1)
