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

from ..atomic_write import replacing_file
from .chart import Chart, number

_STYLE = """
:root { color-scheme: light }
body { font: 15px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff; max-width: 70rem; margin: 2rem auto;
  padding: 0 1rem }
h1 { font-size: 1.7rem } h2 { margin-top: 3rem; border-bottom: 1px solid #ccc }
svg { width: 100%; max-width: 760px; height: auto; font: 12px system-ui, sans-serif; display: block; margin: 1rem 0 }
svg .title { font-weight: 600; font-size: 14px }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums }
th, td { padding: 0.2rem 0.8rem; border-bottom: 1px solid #ddd; text-align: right }
th:first-child, td:first-child { text-align: left }
.gallery { display: flex; flex-wrap: wrap; gap: 0.8rem }
figure { margin: 0; width: 12rem }
figcaption { font-size: 13px; line-height: 1.35; margin-top: 0.3rem }
img { image-rendering: pixelated; width: 100%; height: auto; display: block }
nav ul { columns: 2; padding-left: 1.2rem }
details { margin: 1rem 0 } summary { cursor: pointer }
.scroll { overflow-x: auto }
.verdict { font-weight: 600 } .note { color: #555 }
"""


# A longer table is folded up.
_OPEN_ROWS = 12
_MOST_LETTERS = 50


@dataclass
class Section:
    """A heading, sentences, and what is shown below them."""

    title: str
    words: list[str] = field(default_factory=list)
    charts: list[Chart] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    galleries: list[Gallery] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def html(self, anchor: str) -> str:
        """HTML of the section, which links reach by `anchor`."""
        parts = [f'<h2 id="{anchor}">{escape(self.title)}</h2>']
        parts += [f"<p>{escape(sentence)}</p>" for sentence in self.words]
        for chart in self.charts:
            parts += [chart.svg(), f'<p class="verdict">{escape(chart.verdict())}</p>']
        parts += [gallery.html() for gallery in self.galleries]
        parts += [table.html() for table in self.tables]
        parts += [f'<p class="note">{escape(note)}</p>' for note in self.notes]
        return "\n".join(parts)


@dataclass(frozen=True)
class Table:
    """Rows under a head; numbers are shown to three digits."""

    head: Sequence[str]
    rows: Sequence[Sequence[Any]]

    def html(self) -> str:
        """HTML of the table."""
        head = "".join(f"<th>{escape(str(name))}</th>" for name in self.head)
        rows = "".join("<tr>" + "".join(f"<td>{escape(_cell(v))}</td>" for v in row) + "</tr>" for row in self.rows)
        table = f'<div class="scroll"><table><tr>{head}</tr>{rows}</table></div>'
        if len(self.rows) <= _OPEN_ROWS:
            return table
        return f"<details><summary>All {len(self.rows)} measurements, best first</summary>{table}</details>"

    def csv(self) -> str:
        """CSV of the table with all digits."""
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
        """HTML with the picture inside."""
        data = base64.b64encode(self.png).decode()
        caption = escape(self.caption)
        image = f'<img alt="{caption}" src="data:image/png;base64,{data}">'
        return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


@dataclass(frozen=True)
class Gallery:
    """A row of pictures under a heading."""

    title: str
    pictures: Sequence[Picture]

    def html(self) -> str:
        """HTML of the heading and the pictures."""
        inside = "".join(picture.html() for picture in self.pictures)
        return f'<h3>{escape(self.title)}</h3><div class="gallery">{inside}</div>'


def write_page(
    folder: Path, title: str, about: Iterable[str], sections: Sequence[Section], facts: dict[str, Any]
) -> Path:
    """Write report.html, report.json (`facts`) and a CSV file for each table; each is whole or the older one stays."""
    folder.mkdir(parents=True, exist_ok=True)
    words = "".join(f"<p>{escape(sentence)}</p>" for sentence in about)
    named = _named(sections)
    links = "".join(f'<li><a href="#{name}">{escape(s.title)}</a></li>' for name, s in named.items())
    body = f"<nav><ul>{links}</ul></nav>" + "\n".join(section.html(name) for name, section in named.items())
    page = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{_STYLE}</style></head><body><h1>{escape(title)}</h1>{words}{body}</body></html>\n"
    )
    for name, section in named.items():
        for k, table in enumerate(section.tables):
            _write(folder / f"{name}{'' if k == 0 else f'-{k + 1}'}.csv", table.csv())
    _write(folder / "report.json", json.dumps(facts, indent=1) + "\n")
    path = folder / "report.html"
    _write(path, page)
    return path


def _named(sections: Iterable[Section]) -> dict[str, Section]:
    """Sections by a name of files and links for each, made of the title; materials' names may differ in a sign only."""
    named: dict[str, Section] = {}
    for section in sections:
        # In any script a file system takes names of this length.
        title = re.sub(r"\W+", "_", section.title.lower()).strip("_")[:_MOST_LETTERS]
        name, number = title, 2
        while name in named:
            name, number = f"{title}_{number}", number + 1
        named[name] = section
    return named


def _write(path: Path, text: str) -> None:
    with replacing_file(path) as temporary:
        # A file's name may hold bytes that are no text.
        temporary.write_text(text, encoding="utf-8", errors="replace")


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    return number(value) if isinstance(value, float) else str(value)
