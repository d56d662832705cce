"""Sheets whose shader samples lamps in a real Blender, against quadrature: `python sheets.py DIR|BLENDER [CASE ...]`.

`--parts` alone tells what the time of a sample is made of.

A thin cloth with a highlight on both sides is seen along one direction. Of each case its picture may be off by noise
and 0.2 %; 1 % would be found, and 2 % that are planted are. Beside it are told noise at equal samples and processor
time of a sample, in parts of those of Diffuse and Translucent BSDF of the same colours, and of a mirror that is aimed;
quiet is a camera whose lens gives numbers more even than the shader's own.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from application import HERE, Blender

sys.path.insert(1, str(HERE.parent))
from mathutils import Matrix, Vector
from measured_materials.bake.brdf.bake import bake_source
from measured_materials.bake.brdf.record import BrdfRecord
from measured_materials.bake.source import Array
from support.sheet_scenes import GLAZED, SETTINGS, T_OF_PARTS, lit_by, record_of, under_sky

NO_RAYCAST = "no Raycast node in this Blender"  # as sheets_inside.py has it
PARTS = "--parts"
TOLERANCE, FINDS, PLANTED = 2e-3, 0.01, 1.02
# theta of the viewer, where a square area lamp is, its edge, and whether the camera sees it; or a sky without a lamp,
# at which what would sample is aimed.
CASES = {
    "lamp behind": (40.0, (1, 1, -3), 1.0, True),
    "lamp behind, seen at 80 degrees": (80.0, (1, 1, -3), 1.0, True),
    "lamp behind, hidden from the camera": (80.0, (1, 1, -3), 1.0, False),
    "large lamp behind": (60.0, (1, 1, -1.5), 6.0, True),
    "lamp before": (40.0, (1, 1, 3), 1.0, True),
    "seen from the back": (130.0, (1, 1, 3), 1.0, True),
    "even sky": (40.0, None, 0.0, True),
}


def truth(record: BrdfRecord, case: tuple[float, tuple[float, ...] | None, float, bool]) -> Array:
    """Radiance (3,)."""
    theta, place, size, _ = case
    if place is None:
        return under_sky(record, "exact", theta, lambda wi: np.ones(wi.shape))
    eye = Vector(place)
    matrix = Matrix.Translation(eye) @ (-eye).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    lamp = SimpleNamespace(data=SimpleNamespace(size=size, energy=300.0), matrix_world=matrix)
    return lit_by(record, "exact", theta, lamp)  # type: ignore[arg-type]


def verdict(parts: Array, expected: Array) -> tuple[bool, str]:
    """Whether the parts (K, 3) of a picture have the mean expected, and figures in words."""
    ratio = parts / expected
    off = ratio.mean(0) - 1
    reach = T_OF_PARTS * ratio.std(0, ddof=1) / len(ratio) ** 0.5 + TOLERANCE
    found = np.abs(PLANTED * ratio.mean(0) - 1) > reach
    good = bool((np.abs(off) < reach).all() and (reach < FINDS).all() and found.all())
    return good, f"off by {100 * np.abs(off).max():.2f} % of {100 * reach.max():.2f} %"


def tell_parts(taken: dict[str, float]) -> None:
    """Microseconds of a sample: of native closures, of the whole, and without parts."""
    base, before = taken.pop("native"), None
    print(f"sheets: native {base:.2f} us a sample", flush=True)
    for name, spent in taken.items():
        words = name if before is None else f"less {name} ({before - spent:.2f})"
        print(f"sheets: {words}: {spent:.2f} us, {spent / base:.2f} of native's", flush=True)
        before = spent


def main(place: Path, names: list[str]) -> None:
    """A line for each case; ends with 1 where one is biased, or too noisy to tell."""
    whole = [name for name in names if name != PARTS]
    cases = {name: CASES[name] for name in (whole if names else CASES)}
    with tempfile.TemporaryDirectory() as folder:
        share = Path(folder)
        share.chmod(0o755)
        record = record_of(bake_source(GLAZED, share / "glazed", SETTINGS))
        (share / "sheets.json").write_text(json.dumps(cases), encoding="utf-8")
        for name in ("common", "sheets_inside"):
            shutil.copy(HERE / f"{name}.py", share)
        blender = Blender(place, share)
        print(f"sheets: {blender.install()}", flush=True)
        told = blender.run(
            "--python-exit-code", "9", "--python", "sheets_inside.py", *([] if whole == names else ["--", PARTS])
        )
        if NO_RAYCAST in told:
            print(f"sheets: skipped: {NO_RAYCAST}, by which nodes tell what a lamp lights", flush=True)
            return
        failed = 0
        for name, case in cases.items():
            found = json.loads((share / f"{name}.json").read_text(encoding="utf-8"))
            good, words = verdict(np.array(found["sampled"]["parts"]), truth(record, case))
            told = found["native"]
            figures = [f"native {100 * told['noise']:.2f} %, {told['time']:.1f} s per million"]
            pairs = [("aimed", "native")]
            if case[1] is not None:
                pairs = [("sampled", "native"), ("sampled", "aimed"), ("quiet", "native")]
            figures += [
                f"{name}: {what} {found[name][what] / found[other][what]:.2f} of {other}'s"
                for name, other in pairs
                for what in ("noise", "time")
            ]
            print(f"sheets: {'ok  ' if good else 'FAIL'} {name}: {words}; {', '.join(figures)}", flush=True)
            failed += not good
        if whole != names:
            tell_parts(json.loads((share / "parts.json").read_text(encoding="utf-8")))
    sys.exit(failed > 0)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
