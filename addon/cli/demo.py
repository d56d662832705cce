"""Sub-command `demo`: the demonstration of the README."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .console.need_blender import need_blender
from .console.progress import Progress
from .console.result import Result


def add_to(commands: Any) -> None:
    """Add `demo`."""
    parser = commands.add_parser(
        "demo",
        help="bake, build and render the demonstration",
        description="Bake, build and render the demonstration.",
    )
    parser.add_argument("--out", type=Path, default=Path("out"), metavar="DIR", help="where to (%(default)s)")
    parser.add_argument(
        "--arc", action="store_true", help="of shading maps: photograph fabrics, bake them, compare with their geometry"
    )
    parser.add_argument("--quick", action="store_true", help="small pictures, for a first look")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(run=run, command="demo")


def run(options: argparse.Namespace) -> Result:
    """Run it. Raises BakeError."""
    need_blender("demo")
    if options.arc:
        found = _run_arc(options)
    else:
        found = _run_paint(options)
    return Result({"command": options.command, **found}, [str(line) for line in found.get("lines", [])])


def _run_paint(options: argparse.Namespace) -> dict[str, Any]:
    from ..demo.paint import run_demo

    stages = {"simulating a measurement": 2, "baking": 25, "rendering": 15 if options.quick else 60}
    with Progress(stages) as progress:
        progress.start("")
        return run_demo(options.out, quick=options.quick, progress=progress)


def _run_arc(options: argparse.Namespace) -> dict[str, Any]:
    from ..demo.fabric import SHOWN, run_arc_demo

    seconds = {"photographing": 10, "baking": 1, "comparing": 2, "rendering": 12}
    if not options.quick:
        seconds = {"photographing": 40, "baking": 2, "comparing": 12, "rendering": 45}
    stages = {f"{stage} {name}": cost for name in SHOWN for stage, cost in seconds.items()}
    with Progress(stages) as progress:
        progress.start("")
        return run_arc_demo(options.out, quick=options.quick, progress=progress)
