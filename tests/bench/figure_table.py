"""Figures of a bench by their names, printed and kept."""

from __future__ import annotations

from collections.abc import Mapping

from record import put
from rich.console import Console
from rich.table import Table


def print_figures(title: str, figures: Mapping[str, float]) -> None:
    """A row for each, which `record.put` keeps under its name."""
    table = Table(title=title)
    table.add_column("")
    table.add_column("", justify="right")
    for name, value in figures.items():
        table.add_row(name, f"{value:,.0f}" if float(value).is_integer() else f"{value:.3g}")
        put(name, value)
    Console(width=100).print(table)
