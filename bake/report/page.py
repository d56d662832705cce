"""A report as one HTML file that needs nothing beside it: text, tables, charts, pictures."""

from __future__ import annotations

import base64
import csv
import io
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from ..atomic import replacing_file
from .chart import Chart

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff; max-width: 70rem; margin: 2rem auto;
  padding: 0 1rem }
h1 { font-size: 1.7rem } h2 { margin-top: 3rem; border-bottom: 1px solid #ccc }
svg { width: 100%; max-width: 760px; height: auto; font: 12px system-ui, sans-serif; display: block; margin: 1rem 0 }
svg .title { font-weight: 600; font-size: 14px }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums }
th, td { padding: 0.2rem 0.8rem; border-bottom: 1px solid #ddd; text-align: right }
th:first-child, td:first-child { text-align: left }
figure { display: inline-block; margin: 0 0.6rem 1rem 0; vertical-align: top }
figcaption { font-size: 13px; max-width: 14rem }
img { image-rendering: pixelated; width: 14rem; height: auto; display: block }
.verdict { font-weight: 600 } .note { color: #555 }
"""


@dataclass
class Section:
    """A heading, sentences, and what is shown below them."""

    title: str
    words: list[str] = field(default_factory=list)
    charts: list[Chart] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def html(self) -> str:
        """Of the section."""
        parts = [f"<h2>{escape(self.title)}</h2>"]
        parts += [f"<p>{escape(sentence)}</p>" for sentence in self.words]
        for chart in self.charts:
            parts += [chart.svg(), f'<p class="verdict">{escape(chart.verdict())}</p>']
        parts += [picture.html() for picture in self.pictures]
        parts += [table.html() for table in self.tables]
        parts += [f'<p class="note">{escape(note)}</p>' for note in self.notes]
        return "\n".join(parts)


@dataclass(frozen=True)
class Table:
    """Rows under a head; numbers are shown to three digits."""

    head: Sequence[str]
    rows: Sequence[Sequence[Any]]

    def html(self) -> str:
        """Of the table."""
        head = "".join(f"<th>{escape(str(name))}</th>" for name in self.head)
        rows = "".join("<tr>" + "".join(f"<td>{escape(_cell(v))}</td>" for v in row) + "</tr>" for row in self.rows)
        return f"<table><tr>{head}</tr>{rows}</table>"

    def csv(self) -> str:
        """The same with all digits."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerows([self.head, *self.rows])
        return stream.getvalue()


@dataclass(frozen=True)
class Picture:
    """A PNG file's bytes and what it shows."""

    png: bytes
    caption: str

    def html(self) -> str:
        """With the picture inside."""
        data = base64.b64encode(self.png).decode()
        caption = escape(self.caption)
        image = f'<img alt="{caption}" src="data:image/png;base64,{data}">'
        return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def write_page(
    folder: Path, title: str, about: Iterable[str], sections: Sequence[Section], facts: dict[str, Any]
) -> Path:
    """Write report.html, report.json (`facts`) and a CSV file for each table; each is whole or the older one stays."""
    folder.mkdir(parents=True, exist_ok=True)
    words = "".join(f"<p>{escape(sentence)}</p>" for sentence in about)
    body = "\n".join(section.html() for section in sections)
    page = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{_STYLE}</style></head><body><h1>{escape(title)}</h1>{words}{body}</body></html>\n"
    )
    for section in sections:
        for k, table in enumerate(section.tables):
            name = re.sub(r"[^a-z0-9]+", "_", section.title.lower()).strip("_")
            _write(folder / f"{name}{'' if k == 0 else f'_{k + 1}'}.csv", table.csv())
    _write(folder / "report.json", json.dumps(facts, indent=1) + "\n")
    path = folder / "report.html"
    _write(path, page)
    return path


def _write(path: Path, text: str) -> None:
    with replacing_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _cell(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
