"""Sub-command `check`: settings of a .blend that bias or slow its measured materials."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ...bake.errors import BakeError
from ..summary.text import one_line
from .console.need_blender import need_blender
from .console.result import Result

_SUFFIX = ".blend"
# A .blend as it is, compressed by zstd, or by gzip before 3.0.
_BEGINNINGS = (b"BLENDER", b"\x28\xb5\x2f\xfd", b"\x1f\x8b")


def add_to(commands: Any) -> None:
    """Add `check`."""
    parser = commands.add_parser(
        "check",
        help="settings of a .blend that bias or slow measured materials",
        description="List every setting of a .blend that biases or slows its measured materials, and fix them if "
        "requested. Scripts of the file are not run. Needs Blender or its Python module. The exit code is 0 where "
        "the file loaded whole and nothing is left that biases the picture.",
    )
    parser.add_argument("file", type=Path, metavar="FILE.blend")
    parser.add_argument("--fix", "--mend", dest="mend", action="store_true", help="fix all but notes, and save")
    parser.add_argument("--out", type=Path, metavar="OTHER.blend", help="with --fix: save there instead")
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    parser.set_defaults(run=run, command="check")


def run(options: argparse.Namespace) -> Result:
    """Check one file. Raises BakeError."""
    out = options.out
    if out is not None and not options.mend:
        raise argparse.ArgumentTypeError("--out is where --fix saves; give both")
    if out is not None and out.suffix.lower() != _SUFFIX:
        raise argparse.ArgumentTypeError(f"--out {out} is not a FILE.blend")
    _require_blend(options.file)
    need_blender("check")
    return _check(options.file, options.mend, out)


def _require_blend(file: Path) -> None:
    try:
        with open(file, "rb") as stream:
            beginning = stream.read(8)
    except (OSError, ValueError) as error:
        cause = f"cannot be read ({getattr(error, 'strerror', None) or error})"
        raise BakeError(file, cause, "check the path and its permissions") from error
    if not beginning.startswith(_BEGINNINGS):
        raise BakeError(file, "is not a .blend file", "give a file that Blender has saved")


def _check(file: Path, mend: bool, out: Path | None) -> Result:
    import bpy

    from ..scene_check.check import check_scene, measured_names, mend_scene
    from ..scene_check.file_rules import not_whole, with_missing_parts
    from ..scene_check.findings import SEVERITIES, WRONG

    _open(file)
    written_by = ".".join(map(str, bpy.data.version[:2]))
    if mend and bpy.data.version[:2] > bpy.app.version[:2]:
        remedy = f"fix it there: this is {bpy.app.version_string}, which would lose what is new"
        raise BakeError(file, f"was saved by Blender {written_by}", remedy)
    materials = sorted({name for scene in bpy.data.scenes for name in measured_names(scene)})
    mended, left, saved = {}, {}, None
    for scene in bpy.data.scenes:
        # The one table of lamps can be that of one scene only.
        without = () if scene == bpy.context.scene else ("lamp_table",)
        if mend:
            mended |= {finding.key: finding for finding in mend_scene(scene, without)}
        left |= {f.key: f for f in check_scene(scene) or () if f.rule not in without}  # what scenes share: once
    found = with_missing_parts(list(left.values())) or []
    findings = sorted(found, key=lambda finding: SEVERITIES.index(finding.severity))
    if mended or out is not None:
        saved = _save(out or file)
    lines = [f.mended_line for f in mended.values()] + [f.line for f in findings]
    if not materials:
        lines.append(f"{file}: shows no measured material" + (", as far as it loaded" if not_whole(found) else ""))
    elif not findings:
        lines.append(
            f"{file}: nothing biases or slows its {len(materials)} measured material{'s' * (len(materials) > 1)}"
        )
    missing = not_whole(found)
    wrong = [finding for finding in findings if finding.severity == WRONG and finding not in missing]
    errors = [_not_whole(file, missing)] if missing else []
    errors += [_verdict(file, wrong)] if wrong else []
    document = {
        "command": "check",
        "file": str(file),
        "blender": written_by,
        "materials": materials,
        "findings": [finding.facts() for finding in findings],
        "mended": [finding.facts() for finding in mended.values()],
        "saved": str(saved) if saved else None,
    }
    return Result(document, list(map(one_line, lines)), errors)


def _not_whole(file: Path, missing: list[Any]) -> BakeError:
    cause = f"did not load whole: {one_line(missing[0].setting)}"
    more = f", and {len(missing) - 1} more, see above" if len(missing) > 1 else ""
    return BakeError(file, cause + more, "bring back what is missing, or fix its path in Blender")


def _verdict(file: Path, wrong: list[Any]) -> BakeError:
    mendable = sum(finding.mend is not None for finding in wrong)
    settings = f"{len(wrong)} setting{'s bias' if len(wrong) > 1 else ' biases'} its measured materials"
    remedy = f"--fix fixes {mendable} of them" if mendable else "only you can decide, see above"
    return BakeError(file, settings, remedy)


def _open(file: Path) -> None:
    """Load a .blend of any version into this Blender."""
    import bpy

    try:
        bpy.ops.wm.open_mainfile(filepath=str(file.resolve()), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise BakeError(file, f"cannot be opened ({_reason(error)})", "open and save it in Blender") from error


def _save(target: Path) -> Path:
    """Blender writes beside the file and renames, and keeps the older one as FILE.blend1."""
    import bpy

    from ..lights.light_tables import pack_tables

    pack_tables()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        bpy.ops.wm.save_as_mainfile(filepath=str(target.resolve()), check_existing=False)
    except (OSError, RuntimeError) as error:
        cause = f"cannot be written ({_reason(error)})"
        raise BakeError(target, cause, "choose another place for it by --out") from error
    return target


def _reason(error: Exception) -> str:
    text = getattr(error, "strerror", None) or str(error)
    return one_line(text).rsplit(": ", 1)[-1].rstrip(".")  # Blender repeats the path before it
