"""Sub-command `report`: what accuracy costs in time and memory, measured on this machine, as one HTML page."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..bake.errors import BakeError
from ..bake.report.journal import Journal
from ..bake.report.lobes import lobes_section, measure_lobes
from ..bake.report.machine import machine_facts
from ..bake.report.page import Section, write_page
from ..bake.report.tables import measure_tables, tables_section
from ..bake.source import BrdfSource
from ..bake.sources import read_source
from ..bake.sources.analytic import by_name
from .cli_render import need_blender
from .cli_result import Result
from .progress import Progress

_TITLE = "Measured Materials: what accuracy costs"
# By formula, so that everyone has them: a sharp coat over flakes, and a matte one.
_BUILT_IN = {"paint": "metallic-paint", "suede": "oren-nayar"}


def add_to(commands: Any) -> None:
    """Add `report`."""
    parser = commands.add_parser(
        "report",
        help="measure what accuracy costs on this machine",
        description="Measure what accuracy costs in time and memory on this machine: report.html, .json and .csv.",
    )
    parser.add_argument(
        "files", nargs="*", type=Path, metavar="FILE", help="measured BRDFs; without any, built-in ones"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out") / "report", metavar="DIR", help="where to (%(default)s)"
    )
    parser.add_argument("--quick", action="store_true", help="one material, small pictures: under three minutes")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(run=run, command="report")


def run(options: argparse.Namespace) -> Result:
    """Measure and write; what the same version has measured of the same inputs is taken up. Raises BakeError."""
    need_blender("report")
    sources = _sources(options)
    machine = machine_facts()
    about = {**machine, "quick": options.quick, "inputs": [_origin(source) for source in sources]}
    journal = Journal(options.out / ".measured" / "journal.jsonl", about)
    per_material = {"tables": 25.0, "pictures": 40.0} if options.quick else {"tables": 240.0, "pictures": 500.0}
    sections: list[Section] = []
    facts: dict[str, Any] = {"machine": machine}
    with Progress(per_material, len(sources)) as progress:
        for source in sources:
            progress.start(source.name)
            for part in (_tables, _pictures):
                section, found = part(source, options, journal, progress)
                sections.append(section)
                facts.setdefault(part.__name__.removeprefix("_"), {})[source.name] = found
    costs = measure_lobes(journal)
    sections.append(lobes_section(costs))
    facts["lobes"] = [vars(cost) for cost in costs]
    said = (
        f"Measured on {machine['processor']}, {machine['cores']} cores, with version {machine['measured_materials']}."
    )
    picks = "A dashed line marks the Pareto front; a ring marks the setting we would pick, the front's knee."
    path = write_page(options.out, _TITLE, [said, picks], sections, facts)
    lines = [f"{section.title}: {chart.verdict()}" for section in sections for chart in section.charts]
    return Result({"command": "report", "report": str(path), **facts}, [*lines, str(path)])


Part = Callable[[BrdfSource, argparse.Namespace, Journal, Progress], tuple[Section, Any]]


def _tables(source: BrdfSource, options: argparse.Namespace, journal: Journal, progress: Progress) -> Any:
    found = measure_tables(source, journal, options.quick, lambda share: progress("tables", share))
    return tables_section(source.name, found), [vars(setting) for setting in found]


def _pictures(source: BrdfSource, options: argparse.Namespace, journal: Journal, progress: Progress) -> Any:
    from .report_pictures import FULL, QUICK, measure_pictures, pictures_section

    sizes, folder = QUICK if options.quick else FULL, options.out / ".measured" / source.name
    folder.mkdir(parents=True, exist_ok=True)
    rendered, pictures = measure_pictures(source, folder, journal, sizes, lambda share: progress("pictures", share))
    return pictures_section(source.name, rendered, pictures), [vars(row) for row in rendered]


def _sources(options: argparse.Namespace) -> list[BrdfSource]:
    if options.files:
        sources = [read_source(file) for file in options.files]
        names = [source.name for source in sources]
        for name in names:
            if names.count(name) > 1:
                raise BakeError(name, "is the name of two inputs", "give one of them another name")
        return sources
    wanted = dict(list(_BUILT_IN.items())[:1]) if options.quick else _BUILT_IN
    return [by_name(model) for model in wanted.values()]


def _origin(source: BrdfSource) -> list[Any]:
    return [source.name, str(source.facts)]
