"""What a mode and a filter will cost, and how far they are from the measurement, before anything is rendered."""

from __future__ import annotations

from ...bake.brdf.record import BrdfRecord
from .text import capital

# Processor time of a camera sample, Principled BSDF = 1: median over 12 materials in 4 lightings
# (`./run bench engine`), and of the filters beside trilinear (`./run bench speed`).
MODE_TIME = {"preview": 1.1, "balanced": 1.6, "exact": 1.6, "reference": 2.3}
# By what samples lamps: one script of OSL, in the same bench; nodes, on Blender 5.2 under a world of one picture
# (`tests/real_blender/noise.py`, median of five materials); of nodes that ask a script what is seen, it is not known.
SCRIPT, NODES, RAY_SCRIPT = "script", "nodes", "ray script"
SAMPLED_TIME = {SCRIPT: 3.6, NODES: 3.0}
FILTER_TIME = {"nearest": 0.98, "trilinear": 1.0, "bspline": 1.1}


def expectation(record: BrdfRecord, mode: str, filter: str, *, sampler: str = "") -> str:
    """Time and error of a measured BRDF's material in words: each as far as it is known, as the time of a sheet is not.

    Parameters
    ----------
    record : the bundle's, or of what a material keeps of it
    mode : of `bake.brdf.modes.MODES`
    filter : of `bake.tables.table.FILTERS`
    sampler : what samples lamps in the shader, of the names above; empty if nothing does
    """
    words, error = [], _error(record, mode, filter)
    time = MODE_TIME.get(mode, 1.0) if not sampler else SAMPLED_TIME.get(sampler)
    if time is not None and record.sheet is None:
        many = f"{time * (FILTER_TIME.get(filter, 1.0) if mode != 'preview' else 1.0):.1f}"
        words.append(f"about {'' if many == '1.0' else f'{many} times '}the render time of a Principled BSDF")
    if error is not None:
        words.append(f"error {100 * error:.2g} % of the reflected light")
    return capital("; ".join(words))


def _error(record: BrdfRecord, mode: str, filter: str) -> float | None:
    """Energy-relative error that the bake measured for this mode, scaled to the filter by its RMS.

    None of a filter that was not measured.
    """
    if mode == "preview":
        return record.preview.error if record.preview else None
    if mode != "reference":
        errors = record.residual.errors if record.residual else None
        return errors.relative if errors else None
    baked, other = (record.rms_by_filter.get(name) for name in (record.table.filter, filter))
    if baked and other is None and filter != record.table.filter:
        return None
    return record.errors.relative * (other / baked if baked and other is not None else 1.0)
