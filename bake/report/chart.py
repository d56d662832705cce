"""Scatter charts on logarithmic axes as SVG, with their Pareto front and the setting one would pick.

Blender ships no plotting library, and a report is to be made wherever the extension runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

# Okabe & Ito's palette, distinct for colour-blind readers too, and two more; black is the front's.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7a5195", "#8c564b")
# Beyond the colours, series differ by their marks: a second round of the palette is of squares.
_MARKS = ("circle", "square", "triangle")
_WIDTH, _HEIGHT = 860, 440
_LEFT, _RIGHT, _TOP, _BOTTOM = 84, 236, 40, 56
_SMALLEST = 1e-12
_LEGEND_STEP = 18
# Times closer than this factor are reported as equal: they differ as much from run to run.
SAME_TIME = 1.15
# Of both shares' difference: a front closer than this to a straight line has no knee.
_LEAST_GAIN = 0.08


@dataclass(frozen=True)
class Point:
    """One measured setting: what it costs, its error, and its name."""

    cost: float
    error: float
    label: str


@dataclass(frozen=True)
class Chart:
    """Points of several series, less being better on both axes.

    Parameters
    ----------
    title, cost, error : words above and beside the axes, units included
    series : name to points
    joined : whether a line joins the points of a series, in order of cost
    same : factor up to which two costs count as equal, as of times that differ from run to run
    knee : pick the front's knee; otherwise, of noise that falls with time, the most accurate
    apart : series shown for comparison, neither on the front nor picked
    """

    title: str
    cost: str
    error: str
    series: dict[str, list[Point]] = field(default_factory=dict)
    joined: bool = True
    same: float = 1.0
    knee: bool = True
    apart: tuple[str, ...] = ()

    @property
    def points(self) -> list[Point]:
        """Points of all series."""
        return [point for points in self.series.values() for point in points]

    def front(self) -> list[Point]:
        """The Pareto front: points that none is both cheaper (or as cheap) and more accurate than, by rising cost."""
        found: list[Point] = []
        rivals = [point for name, points in self.series.items() if name not in self.apart for point in points]
        for point in sorted(rivals, key=lambda p: (p.cost, p.error)):
            if not found or point.error < found[-1].error:
                found.append(point)
        # Dropped only now: of a chain of points each just dearer than the one before, the most accurate stays.
        beaten = (any(q.error < p.error and q.cost <= p.cost * self.same for q in found) for p in found)
        return found if self.same == 1 else [p for p, drop in zip(found, beaten, strict=True) if not drop]

    def pick(self) -> Point | None:
        """The front's knee: where the share of the front's accuracy gained most exceeds the share of its cost paid.

        Both shares are of decades. Left of the knee a little cost buys much accuracy, right of it the reverse. A front
        without a knee, as of noise that falls with time, has no such point: there it is the most accurate one.
        """
        front = self.front()
        if len(front) < 3 or not self.knee:
            return front[-1] if front else None
        x, y = [_log(p.cost) for p in front], [_log(p.error) for p in front]
        run, fall = x[-1] - x[0], y[0] - y[-1]
        if run <= 0 or fall <= 0:
            return front[-1]
        gain = [(y[0] - b) / fall - (a - x[0]) / run for a, b in zip(x, y, strict=True)]
        best = max(range(len(front)), key=gain.__getitem__)
        return front[best if gain[best] > _LEAST_GAIN else -1]

    def svg(self) -> str:
        """The picture, self-contained."""
        if not self.points:
            return f"<p>{escape(self.title)}: nothing was measured.</p>"
        across = _Axis.of([p.cost for p in self.points], _LEFT, _WIDTH - _RIGHT)
        up = _Axis.of([p.error for p in self.points], _HEIGHT - _BOTTOM, _TOP)
        parts = [f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="#fff"/>', _grid(across, up)]
        parts += [self._series(k, name, across, up) for k, name in enumerate(self.series)]
        parts += [self._front(across, up), self._words(), self._picked(across, up)]
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" font-family="system-ui, '
            f'sans-serif" font-size="12" role="img" aria-label="{escape(self.title, True)}">'
        )
        return head + "".join(parts) + "</svg>"

    def _front(self, across: _Axis, up: _Axis) -> str:
        return _polyline([(across.at(p.cost), up.at(p.error)) for p in self.front()], "#000", 'stroke-dasharray="5 4"')

    def _series(self, k: int, name: str, across: _Axis, up: _Axis) -> str:
        colour, points = COLOURS[k % len(COLOURS)], self.series[name]
        mark = _MARKS[k // len(COLOURS) % len(_MARKS)]
        ordered = sorted(points, key=lambda p: (p.cost, -p.error))
        line = [(across.at(p.cost), up.at(p.error)) for p in ordered]
        parts = [_polyline(line, colour, 'opacity="0.5"')] if self.joined else []
        for point in points:
            tip = f"{name}, {point.label}: {number(point.cost)}, error {number(point.error)}"
            parts.append(_mark(mark, across.at(point.cost), up.at(point.error), colour, tip))
        y = _TOP + 12 + _LEGEND_STEP * k
        parts.append(_mark(mark, _WIDTH - _RIGHT + 18, y - 4, colour))
        parts.append(f'<text x="{_WIDTH - _RIGHT + 32}" y="{y}">{escape(name)}</text>')
        return "".join(parts)

    def _words(self) -> str:
        middle_x, middle_y = (_LEFT + _WIDTH - _RIGHT) / 2, (_TOP + _HEIGHT - _BOTTOM) / 2
        left = _WIDTH - _RIGHT + 10
        y = _TOP + 16 + _LEGEND_STEP * len(self.series)
        # What stands apart may well lie below the front.
        front = "Pareto front of the others" if self.apart else "Pareto front: nothing beats it"
        return (
            f'<text x="{_LEFT}" y="22" font-size="14" font-weight="600">{escape(self.title)}</text>'
            f'<text x="{middle_x}" y="{_HEIGHT - 12}" text-anchor="middle">{escape(self.cost)}</text>'
            f'<text transform="translate(18 {middle_y}) rotate(-90)" text-anchor="middle">{escape(self.error)}</text>'
            f'<line x1="{left}" x2="{left + 16}" y1="{y - 4}" y2="{y - 4}" stroke="#000" stroke-dasharray="5 4"/>'
            f'<text x="{left + 22}" y="{y}">{front}</text>'
            f'<circle cx="{left + 8}" cy="{y + _LEGEND_STEP - 4}" r="7" fill="none" stroke="#000" stroke-width="2"/>'
            f'<text x="{left + 22}" y="{y + _LEGEND_STEP}">our pick</text>'
        )

    def _picked(self, across: _Axis, up: _Axis) -> str:
        point = self.pick()
        if point is None:
            return ""
        x, y = across.at(point.cost), up.at(point.error)
        others = [(across.at(p.cost), up.at(p.error)) for p in self.points if p != point]
        left, base, right = _label_place(x, y, 7.5 * len(point.label), others)
        place = f'x="{left:.1f}" y="{base:.1f}"'
        text = f'<text {place} text-anchor="{"start" if right else "end"}" font-weight="600" paint-order="stroke" '
        words = f'{text}stroke="#fff" stroke-width="4">{escape(point.label)}</text>'
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="9" fill="none" stroke="#000" stroke-width="2"/>{words}'

    def verdict(self) -> str:
        """The setting one would pick, in words."""
        point = self.pick()
        if point is None:
            return "Nothing was measured."
        name = next(name for name, points in self.series.items() if point in points)
        label = "" if point.label == name else f", {point.label}"
        found = f"error {number(point.error)} at {_amount(point.cost, _unit(self.cost))}"
        return f"Our pick: {name}{label} ({found})."


@dataclass(frozen=True)
class _Axis:
    """Logarithmic, from `low` to `high` in value and from `start` to `end` in the picture."""

    low: float
    high: float
    start: float
    end: float

    @classmethod
    def of(cls, values: Sequence[float], start: float, end: float) -> _Axis:
        """Axis that holds all values with a margin."""
        low, high = min(map(_log, values)), max(map(_log, values))
        margin = max(0.06 * (high - low), 0.08)
        return cls(low - margin, high + margin, start, end)

    def at(self, value: float) -> float:
        """Place of a value in the picture."""
        return self.start + (_log(value) - self.low) / (self.high - self.low) * (self.end - self.start)

    def ticks(self) -> list[float]:
        """Values to label: powers of ten, and steps between where there is room."""
        span = self.high - self.low
        steps = (1.0,) if span > 2.5 else (1.0, 2.0, 5.0) if span > 0.5 else (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0)
        decades = range(math.floor(self.low), math.ceil(self.high) + 1)
        every = max(1, math.ceil(span / 8))
        values = [step * 10.0**d for d in decades if d % every == 0 for step in steps]
        return [v for v in values if self.low <= math.log10(v) <= self.high]


def _grid(across: _Axis, up: _Axis) -> str:
    parts = [
        f'<rect x="{_LEFT}" y="{_TOP}" width="{_WIDTH - _LEFT - _RIGHT}" height="{_HEIGHT - _TOP - _BOTTOM}" '
        'fill="none" stroke="#999"/>'
    ]
    for value in across.ticks():
        x = across.at(value)
        parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{_TOP}" y2="{_HEIGHT - _BOTTOM}" stroke="#e4e4e4"/>')
        parts.append(f'<text x="{x:.1f}" y="{_HEIGHT - _BOTTOM + 17}" text-anchor="middle">{number(value)}</text>')
    for value in up.ticks():
        y = up.at(value)
        parts.append(f'<line x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e4e4e4"/>')
        parts.append(f'<text x="{_LEFT - 7}" y="{y + 4:.1f}" text-anchor="end">{number(value)}</text>')
    return "".join(parts)


def _mark(kind: str, x: float, y: float, colour: str, tip: str = "") -> str:
    """A sign of 8 pixels with its words for a resting pointer."""
    inside = f"<title>{escape(tip)}</title>" if tip else ""
    if kind == "circle":
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}">{inside}</circle>'
    if kind == "square":
        return f'<rect x="{x - 4:.1f}" y="{y - 4:.1f}" width="8" height="8" fill="{colour}">{inside}</rect>'
    path = f"M{x:.1f} {y - 5:.1f}L{x + 5:.1f} {y + 4:.1f}H{x - 5:.1f}Z"
    return f'<path d="{path}" fill="{colour}">{inside}</path>'


def _polyline(places: Sequence[tuple[float, float]], colour: str, more: str) -> str:
    if len(places) < 2:
        return ""
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    return f'<polyline points="{points}" fill="none" stroke="{colour}" {more}/>'


def _log(value: float) -> float:
    return math.log10(max(value, _SMALLEST))


def _unit(words: str) -> str:
    """Of an axis's words: "bytes" of "bytes in the file, before compression"."""
    return words.split(",")[0].split(" in ")[0]


def _label_place(x: float, y: float, width: float, others: Sequence[tuple[float, float]]) -> tuple[float, float, bool]:
    """Anchor of the words at the ring (x, y), and whether they go to its right: where they hide the fewest points."""
    # Above the ring, on the side where the frame has room, unless another place is better.
    roomy = x < (_LEFT + _WIDTH - _RIGHT) / 2
    found: list[tuple[bool, int, int, tuple[float, float, bool]]] = []
    for away, base in ((11, max(y - 11, _TOP + 12)), (14, y + 4), (11, y + 20)):
        for right in (roomy, not roomy):
            anchor = x + away if right else x - away
            start, end = (anchor, anchor + width) if right else (anchor - width, anchor)
            outside = start < _LEFT or end > _WIDTH - _RIGHT or base > _HEIGHT - _BOTTOM - 3
            hidden = sum(start - 6 < a < end + 6 and base - 16 < b < base + 8 for a, b in others)
            found.append((outside, hidden, len(found), (anchor, base, right)))
    return min(found)[3]


def _amount(value: float, unit: str) -> str:
    """With its unit: "82.9 kB", "957 bytes", "667 ns per lookup"."""
    words = number(value)
    return f"{words}B" if unit == "bytes" and words[-1].isalpha() else f"{words} {unit}"


def number(value: float) -> str:
    """Three digits, with a letter for large numbers: 0.0123, 45.6, 1980, 82.9 k, 1.2 M."""
    for least, letter in ((1e9, "G"), (1e6, "M"), (1e4, "k")):
        if abs(value) >= least:
            return f"{value / (1e3 if letter == 'k' else least):.3g} {letter}"
    return f"{round(value, -1):.0f}" if abs(value) >= 1000 else f"{value:.3g}"
