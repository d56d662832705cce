"""Progress on the error stream: shares, time estimates, terminals and pipes."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_materials.addon.cli.console.progress import Progress
from measured_materials.addon.summary.bake_stages import bake_stages, share_done
from measured_materials.addon.summary.progress_estimate import readable_time
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.settings import BakeSettings
from measured_materials.bake.photographs.settings import StackSettings
from measured_materials.bake.sampling.half_vector_cells import SamplerLayout
from measured_materials.bake.shading_maps.against_light import ThroughSettings
from measured_materials.bake.shading_maps.bake import ArcSettings, bake_arc
from measured_materials.bake.sources.analytic import by_name
from support.stacks import write_stack


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


class Told:
    """Shares of the whole, as the stages that a bake has reported make them."""

    def __init__(self, settings: BakeSettings | ArcSettings) -> None:
        self.stages = bake_stages(settings)
        self.shares: list[float] = []

    def __call__(self, stage: str, share: float) -> None:
        assert stage in self.stages, f"no time is known for the stage {stage!r}"
        self.shares.append(share_done(self.stages, stage, share))

    def check(self, largest_step: float) -> None:
        """Never back, to the end, and no stage passes all at once that takes much of the time."""
        assert self.shares == sorted(self.shares) and self.shares[-1] == pytest.approx(1)
        steps = np.diff([0.0, *self.shares])
        assert steps.max() < largest_step, (steps.argmax(), steps.max())


BRUSHED = {"alpha": 0.3, "alpha_y": 0.5}
SMALL = {"resolution": 8, "sampler": SamplerLayout(8, 8, 8)}


@pytest.mark.parametrize(
    "model, parameters, options",
    [
        ("lambert", {}, {}),
        ("lambert", {}, {"filter": "bspline"}),
        ("lambert", {}, {"filter": "auto", "envelope": False}),
        ("thin-cloth", {}, {}),
        ("thin-cloth", {}, {"envelope": False}),
        ("lambert", {}, {"envelope": False, "parameterization": "uniform", "basis": "normal"}),
        pytest.param("ggx", BRUSHED, {}, marks=pytest.mark.slow),
        ("ggx", BRUSHED, {"envelope": False, "basis": "normal", "filter": "bspline"}),
        pytest.param("ggx", BRUSHED, {"envelope": False, "basis": "half", "storage": "log"}, marks=pytest.mark.slow),
    ],
)
def test_progress_of_a_bake(model: str, parameters: dict[str, float], options: dict[str, Any], tmp_path: Path) -> None:
    """Of every kind: isotropic and anisotropic, each filter and basis, with and without an envelope."""
    settings = BakeSettings(**SMALL, **options, viewers=(6, 2))
    told = Told(settings)
    if settings.filter == "auto":
        assert told.stages["fitting spline"] > 0
    bake_source(by_name(model, **parameters), tmp_path / "x.mmat", settings, told)
    told.check(0.45)


@pytest.mark.parametrize(
    "options",
    [{}, {"compression": "basis"}, {"compression": "power", "lobe_auto": True}, {"tileable": "quilt"}],
)
def test_progress_of_photographs(options: dict[str, Any], tmp_path: Path) -> None:
    settings = ArcSettings(**options)
    told = Told(settings)
    bake_arc(write_stack(tmp_path / "felt", size=(40, 40)), tmp_path / "x.mmat", settings, told)
    told.check(0.45)


@pytest.mark.parametrize("align", ["auto", "off"])
def test_progress_of_photographs_against_the_light(align: str, tmp_path: Path) -> None:
    """The second stack is read after the first, and nothing begins again."""
    behind = write_stack(tmp_path / "behind", size=(40, 40))
    settings = ArcSettings(through=ThroughSettings(behind), stack=StackSettings(align=align))
    told = Told(settings)
    bake_arc(write_stack(tmp_path / "felt", size=(40, 40)), tmp_path / "x.mmat", settings, told)
    told.check(0.45)
