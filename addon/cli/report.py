"""Sub-command `report`: what accuracy costs in time and memory, measured on this machine, as one HTML page."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .console.need_blender import need_blender
from .console.progress import Progress
from .console.result import Result


def add_to(commands: Any) -> None:
    """Add `report`."""
    parser = commands.add_parser(
        "report",
        help="measure what accuracy costs on this machine",
        description="Measure what accuracy costs in time and memory on this machine, and write report.html, "
        "report.json and CSV files: tables of measured BRDFs, shading maps of swatches, lobes, and pictures. A run "
        "that was stopped goes on where it ended when it is called again. The built-in inputs take about half an hour "
        "on two cores, each of your own about ten minutes.",
    )
    parser.add_argument(
        "inputs",
        nargs="*",
        type=Path,
        metavar="FILE|FOLDER",
        help="measured BRDFs, folders of photographs, baked shading maps; without any, built-in ones",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out") / "report", metavar="DIR", help="where to (%(default)s)"
    )
    parser.add_argument("--quick", action="store_true", help="one of each kind, coarsely: under three minutes")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(run=run, command="report")


def run(options: argparse.Namespace) -> Result:
    """Measure and write. Raises BakeError."""
    need_blender("report")
    from ..report.inputs import built_in_inputs, read_inputs
    from ..report.run import FULL, QUICK, run_report, stages

    inputs = read_inputs(options.inputs) if options.inputs else built_in_inputs(options.quick)
    sizes = QUICK if options.quick else FULL
    with Progress(stages(inputs, sizes)) as progress:
        progress.start("report")
        path, sections, facts = run_report(inputs, options.out, sizes, progress)
    lines = [f"{chart.title}: {chart.verdict()}" for section in sections for chart in section.charts]
    return Result({"command": "report", "report": str(path), **facts}, [*lines, str(path)])
