"""Which direction is the light: what each reading predicts of the twelve genuine RGL files' left-out directions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from materials import rgl_files
from measured_materials.bake.inspection.readings import READINGS, held_out
from measured_materials.bake.inspection.survey import survey
from measured_materials.bake.sources import read_source
from record import put


def run(out: Path, quick: bool) -> None:
    """All of them, which takes seconds; --quick is the same."""
    print("RMS at every second incident elevation, left out, as a share of the signal's; and what exchanging changes")
    print(f"{'':26s}" + "".join(f"{name:>12s}" for name in READINGS) + f"{'exchange RMS':>15s}{'median':>10s}")
    errors: dict[str, list[float]] = {name: [] for name in READINGS}
    for file in rgl_files():
        source = read_source(file)
        found: Any = held_out(source)
        reciprocity: Any = survey(source)["reciprocity"]
        for name in READINGS:
            errors[name].append(found[name])
        words = "".join(f"{100 * found[name]:10.1f} %" for name in READINGS)
        print(f"{file.stem:26s}{words}{100 * reciprocity['rms']:13.1f} %{100 * reciprocity['median']:8.1f} %")
    medians = {name: float(np.median(values)) for name, values in errors.items()}
    print(f"{'median':26s}" + "".join(f"{100 * value:10.1f} %" for value in medians.values()))
    least = [min(READINGS, key=lambda name, k=k: errors[name][k]) for k in range(len(errors["measured"]))]
    print(", ".join(f"{name} errs least on {least.count(name)}" for name in READINGS))
    for name, value in medians.items():
        put(f"left-out RMS, {name}", value)
    put("files best as measured", least.count("measured"))
