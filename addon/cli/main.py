"""The command line: `python -m measured_materials` and `blender --background --command measured_materials`.

Results go to the output stream, everything else to the error stream. Exit codes: 0 done, 1 bad input (one line
each), 2 wrong usage, 130 interrupted, 141 the reader of the output has gone.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TextIO

from ...bake.bundle.checked_json import dump_json
from ...bake.errors import BakeError
from . import assets, bake_brdf, check, demo, inspect, library, maps, render, report
from .console.interrupts import INTERRUPTED, keyboard_interrupts, told
from .console.result import Result, complain
from .console.streams import results_stream, silence_output

PROGRAM = "measured_materials"
NOBODY_READS = 141


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a sub-command and return the exit code; no exception but a defect's leaves it."""
    try:
        options = parser().parse_args(arguments)
    except SystemExit as leaving:  # Blender would go on with its own end
        return leaving.code if isinstance(leaving.code, int) else 2
    with keyboard_interrupts(), results_stream(options.json) as stream:
        try:
            result = options.run(options)
        except BakeError as error:
            result = Result({"command": options.command}, [], [error])
        except argparse.ArgumentTypeError as error:
            complain(f"{options.command}: {error}")
            return 2
        except KeyboardInterrupt:
            told()
            return INTERRUPTED
        except OSError as error:
            result = Result({"command": options.command}, [], [_system_error(error, options.command)])
        except MemoryError:
            result = Result({"command": options.command}, [], [_out_of_memory(options.command)])
        return _tell(result, options.json, stream)


def parser() -> argparse.ArgumentParser:
    """Parser of all sub-commands and their options."""
    top = argparse.ArgumentParser(
        prog=PROGRAM, description="Measured BRDFs as path-traced materials in stock Blender Cycles."
    )
    commands = top.add_subparsers(metavar="COMMAND", required=True)
    kinds = bake_brdf.add_to(commands)
    for kind in (library, maps):
        kind.add_to(kinds)
    for module in (inspect, render, assets, check, report, demo):
        module.add_to(commands)
    return top


def _tell(result: Result, as_json: bool, stream: TextIO) -> int:
    for error in result.errors:
        complain(str(error))
    code = 1 if result.errors else 0
    try:
        if as_json:
            errors = [vars(error) for error in result.errors]
            stream.write(dump_json({**result.document, "errors": errors}, PROGRAM, limit=None))
        else:
            stream.writelines(f"{line}\n" for line in result.lines)
        stream.flush()
    except BrokenPipeError:
        silence_output(stream)
        return NOBODY_READS
    except BakeError as error:
        complain(str(error))
        return 1
    return code


def _out_of_memory(command: str) -> BakeError:
    return BakeError(command, "ran out of memory", "choose a lower resolution or close other programs")


def _system_error(error: OSError, command: str) -> BakeError:
    file = error.filename if isinstance(error.filename, str) else command
    return BakeError(file, error.strerror or str(error), "check the path, its permissions and the free space")
